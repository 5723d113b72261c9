"""Variants of the SG90: a real servo, and those of its paper.

*measured* is identified from a real servo's steps: a gyro on the horn recorded 52 of them between 0
and 10 to 135 degrees.  Fitted to every second amplitude by simulation error with drive saturation
and a delay; the other amplitudes are met to 4.48 counts RMS in the 0.8 s after a command, a count
being 7.4 deg/s.  The description that did it stands in examples/real_logs.

What that log determines and what it does not: the speed at full drive, not the gear ratio and the
motor's gain apart (K_R = 24 and a supply of 5 V are kept); the loop gain, not the amplifier
and K_f apart (K_f = 0.1 is kept).  The gyro's scale was not known, so a commanded degree
counts as a degree of the horn, with pulses of 544 us at 0 and 2400 us at 180 degrees
(the Arduino library that commanded it).  The delay holds half of the 20 ms frame in which
pulses come.

*airframe* is the same servo for a larger model, in which it is loaded, driven too far, or not at
all.  Friction is what the same steps show, 0.00355 +- 0.0009 N m.  Stops are 95 degrees to either
side of the middle of those pulses: 90 by the data sheet, but the steps overshoot.  Without pulses
there is no torque.  It meets the held-out amplitudes to 4.51 counts.

*printed*, *linear* and *oscillatory_motor* are those of S. Kochuk et al., "Methodology of synthesis
nonlinear mathematical model of a servo" (the *SG90 paper*).
"""

from __future__ import annotations

import math
from dataclasses import replace

from servo_models.actuators.sg90.plant import HALF_RANGE, OSCILLATORY_PLANT, PAPER_PLANT
from servo_models.core.plant import Variant

PULSES = (544e-6, 2400e-6)  # s, that ask for 0 and 180 degrees, as a film of one shows
PULSE_PER_ANGLE = (PULSES[1] - PULSES[0]) / math.pi  # seconds of pulse per radian
MIDDLE_PULSE = 0.5 * sum(PULSES)
STALL = 0.1765  # N m at 4.8 V
FEEDBACK = 0.1  # feedback coefficient K_f
SUPPLY = 5.0  # V
FRAME = 0.02  # s

MEASURED = Variant(
    "measured",
    "a real SG90 at 5 V: drive saturation and delay identified from its steps",
    {
        "angle_unit": 1.0,
        "gear_ratio": 24.0,
        "motor_time_constant": 0.0347,
        "motor_gain": 51.1,
        "amplifier_gain": 77.7,
        "feedback_coefficient": FEEDBACK,
        "potentiometer_gain": SUPPLY / FRAME * PULSE_PER_ANGLE / FEEDBACK,
        "stall_voltage": 4.8,
        "no_load_speed": 51.1 * 4.8,
        "supply_limit.share": 1.0,
        "transport_delay.time": 0.0289,
    },
    "gyro log of 52 steps; stall torque: data sheet",
    uncertainty={
        "motor_time_constant": 0.2,
        "motor_gain": 0.1,
        "amplifier_gain": 0.2,
        "transport_delay.time": 0.35,
        "potentiometer_gain": 0.05,
    },
    stop_time=1.0,
    step_size=1e-3,
    checked={"pulse_width": PULSES},
)

AIRFRAME = replace(
    MEASURED,
    name="airframe",
    about="the measured servo with end stops and friction, limp without pulses: for a larger model",
    values={
        **MEASURED.values,
        "middle_pulse": MIDDLE_PULSE,
        "shortest_pulse": 400e-6,
        "end_stops.half_range": math.radians(95.0),
        "coulomb_friction.level": 0.00355,
    },
    source="gyro log of 52 steps; travel, stall torque: data sheet",
    checked={
        "pulse_width": PULSES,
        "load_torque": (-STALL, STALL),
        "supply_voltage": (4.8, SUPPLY),
    },
)

TIME_CONSTANT = 1.0 / 1.307  # s
DYNAMIC_GAIN = 633.3 / 1.307  # rad/s/V, of eq. 6
GAIN_LOADED = 7.47  # V/V
GAIN_UNLOADED = 5.79  # V/V
STATIC_GAIN = 425.64  # rad/s/V, of the motor characteristic
LINEAR = {
    "motor_time_constant": TIME_CONSTANT,
    "motor_gain": DYNAMIC_GAIN,
    "amplifier_gain": GAIN_LOADED,
    "potentiometer_gain": 0.025 * 180.0 / math.pi,
    "feedback_coefficient": 0.1,
}
PRINTED = {
    **LINEAR,
    "motor_gain": STATIC_GAIN,
    "edge_positive": 0.5,
    "edge_negative": 0.6,
    "zero_positive": 0.6 - 106.76 / STATIC_GAIN,
    "zero_negative": 1.5 - 544.0 / STATIC_GAIN,
    "top_positive": 670.0,
    "top_negative": 544.0,
    "supply_limit.share": 1.0,
    "sample_hold.period": 0.02,
    "command_quantisation.step": 5.0 / 1024.0,
    "command_quantisation.rounding": 0.0,
    "end_stops.half_range": HALF_RANGE,
}
SLOW = (
    "the printed model is 20 to 80 times slower than a real SG90, which turns 60 degrees in"
    " 0.1 s; use it to reproduce the paper"
)


def published() -> tuple[Variant, ...]:
    """Linear and printed sets for every printed K_f and both amplifier gains."""
    made: list[Variant] = []
    kinds = (
        ("printed", "nonlinear servo as printed", PRINTED),
        (
            "linear",
            "linear servo without limits, as eq. 7; the supply does nothing",
            LINEAR,
        ),
    )
    for kind, about, values in kinds:
        for unloaded in (False, True):
            for k_f in (0.1, 0.18, 0.05):
                gain = GAIN_UNLOADED if unloaded else GAIN_LOADED
                name = kind + ("_unloaded" if unloaded else "")
                name += "" if k_f == 0.1 else f"_kf{k_f:g}".replace("0.", "0")
                amplifier = "unloaded" if unloaded else "loaded"
                made.append(
                    Variant(
                        name,
                        f"{about}; K_f = {k_f:g}, {amplifier} amplifier gain {gain:g}",
                        {**values, "amplifier_gain": gain, "feedback_coefficient": k_f},
                        "SG90 paper secs. 4 to 6, eq. 7",
                        plant=PAPER_PLANT,
                        warning=SLOW,
                        checked={"pulse_width": (0.5e-3, 2.4e-3)},
                    )
                )
    return tuple(made)


OSCILLATORY = Variant(
    "oscillatory_motor",
    "model 1 of the motor, rejected by the paper since it does not settle",
    {**LINEAR, "motor_gain": 686.9 / 2.255},
    "SG90 paper eq. 5",
    plant=OSCILLATORY_PLANT,
    warning="rejected by the paper: the motor is undamped",
)

VARIANTS = (MEASURED, AIRFRAME, *published(), OSCILLATORY)
