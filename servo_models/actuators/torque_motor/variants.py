"""Variants of the torque motor: Tables 1 and 2 and eq. 12 of the valve paper."""

from __future__ import annotations

from servo_models.actuators.torque_motor.plant import STOP
from servo_models.core.plant import GreyBox, Variant

TABLE_1 = {
    "torque_constant": 6.432,
    "back_emf_constant": 0.08,
    "resistance": 3630.0,
    "inductance": 34.0,
    "rotor_inertia": 7.246e-7,
    "friction_coefficient": 2.7e-4,
    "stiffness": 1.1,
    "end_stops.half_range": STOP,
}
TABLE_2 = {
    **TABLE_1,
    "torque_constant": 5.23,
    "back_emf_constant": 0.08,
    "inductance": 29.9,
    "friction_coefficient": 2.7e-4,
}


def grey_box(
    gain: float,
    s2: float,
    s1: float,
    s0: float,
    resistance: float = TABLE_1["resistance"],
    rotor_inertia: float = TABLE_1["rotor_inertia"],
    stiffness: float = TABLE_1["stiffness"],
) -> dict[str, float]:
    """Torque motor constants from the coefficients of eq. 12, with R, J, K_s known.

    Solves eq. 9 = gain / (s^3 + s2 s^2 + s1 s + s0) for L, K_t, K_f, K_b in this order.
    Source: valve paper sec. 5, the four linear equations behind Table 2.
    """
    inductance = resistance * stiffness / (rotor_inertia * s0)
    torque_constant = gain * rotor_inertia * inductance
    friction = rotor_inertia * (s2 - resistance / inductance)
    rest = s1 * rotor_inertia * inductance - resistance * friction - stiffness * inductance
    return {
        "inductance": inductance,
        "torque_constant": torque_constant,
        "friction_coefficient": friction,
        "back_emf_constant": rest / torque_constant,
    }


GREY_BOX = GreyBox(
    source="voltage",
    output="angle",
    coefficients=("gain", "s2", "s1", "s0"),
    known=("resistance", "rotor_inertia", "stiffness"),
    solve=grey_box,
    delay="transport_delay.time",
)

EQ_12 = (241560.0, 492.0, 1582240.0, 184512000.0)
EQ_12_DELAY = 0.0011  # s
CHECKED = {"voltage": (-40.0, 40.0)}  # V, of the paper's responses

_uncertain = {
    "torque_constant": 0.25,
    "inductance": 0.25,
    "back_emf_constant": 0.5,
    "friction_coefficient": 0.5,
    "resistance": 0.01,
    "rotor_inertia": 0.01,
    "stiffness": 0.01,
}

VARIANTS = (
    Variant(
        "identified",
        "transfer function of eq. 12 as physical constants, with its 1.1 ms delay",
        {**TABLE_1, **grey_box(*EQ_12), "transport_delay.time": EQ_12_DELAY},
        "valve paper eq. 12, unrounded; R, J, K_s from Table 1",
        checked=CHECKED,
    ),
    Variant(
        "measured",
        "constants measured one by one",
        TABLE_1,
        "valve paper Table 1",
        uncertainty=_uncertain,
        checked=CHECKED,
    ),
    Variant(
        "estimated",
        "constants estimated from eq. 12, as printed",
        TABLE_2,
        "valve paper Table 2",
        checked=CHECKED,
    ),
)
