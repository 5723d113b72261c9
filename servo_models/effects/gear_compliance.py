"""Gear compliance with a load inertia behind it."""

import math
from typing import Annotated

from servo_models.core.block import Ambiguity, Hints, Param, effect

RIGID = 1e-6  # compliance of a rigid gear [rad/(N m)]: its resonance would only cost steps
SOURCE = "two-mass model, e.g. Ellis, Control System Design Guide, 2012, ch. 16"

Compliance = Annotated[
    float,
    Param(
        "{shaft_angle}/{load}", "twist per torque", high=0.5, switch=True, typical=0.1, fixed=True
    ),
]
Inertia = Annotated[
    float,
    Param(
        "{shaft_inertia}",
        "inertia behind the compliance",
        default=0.2,
        low=2e-7,
        high=200.0,
        fixed=True,
    ),
]


@effect("load", "load_acceleration", source=SOURCE)
def compliant_load(
    load: float,
    load_acceleration: float,
    shaft_angle: float,
    shaft_speed: float,
    load_angle: float,
    load_speed: float,
    angle_unit: float,
    compliance: Compliance,
    inertia: Inertia,
    damping: Annotated[
        float,
        Param("1", "damping ratio of the load on its spring", default=0.05, low=0.0, high=1.0),
    ],
) -> tuple[float, float]:
    """The shaft feels the spring; the spring and the load torque move the inertia."""
    if compliance < RIGID:
        return load, load_acceleration
    drag = 2.0 * damping * math.sqrt(inertia / compliance)
    twist = (shaft_angle - load_angle) / angle_unit
    spring = twist / compliance + drag * (shaft_speed - load_speed)
    return spring, (spring - load) / inertia


@effect("internal_step", source="accuracy of the classical Runge-Kutta method: 0.13 rad a step")
def resonance_step(
    internal_step: float, shaft_inertia: float, compliance: Compliance, inertia: Inertia
) -> float:
    """The internal step follows the resonance of shaft and load."""
    if compliance < RIGID:
        return internal_step
    both = 1.0 / (1.0 / inertia + 1.0 / shaft_inertia)
    limit = 0.13 * math.sqrt(compliance * both)
    return limit if limit < internal_step else internal_step


@effect(
    "angle",
    "rate",
    "load_rate",
    source=SOURCE,
    name="gear_compliance",
    parts=(compliant_load, resonance_step),
    hints=Hints(
        says="the gear twists by {compliance}",
        inertia="inertia",
        ambiguity=Ambiguity(
            "a chirp through the resonance, sampled 20 times faster than it",
            ("gear_compliance",),
            ("lag", "transport_delay"),
        ),
    ),
)
def compliant_output(
    angle: float,
    rate: float,
    load_rate: float,
    load_angle: float,
    load_speed: float,
    angle_unit: float,
    compliance: Compliance,
) -> tuple[float, float, float]:
    """The output is the load's side of the spring."""
    if compliance >= RIGID:
        return load_angle, angle_unit * load_speed, angle_unit * load_speed
    return angle, rate, load_rate
