"""The SG90 that people have: identified from a real servo's steps.

A gyro on the horn recorded 52 steps between 0 and 10 to 135 degrees.  Fitted to every second
amplitude by simulation error with drive saturation and a delay; the other amplitudes are met
to 4.48 counts RMS in the 0.8 s after a command, a count being 7.4 deg/s.  The description
that did it stands in examples/real_logs.

What that log fixes and what it cannot: the speed at full drive, not the gear ratio and the
motor's gain apart (K_R = 24 and a supply of 5 V are kept); the loop gain, not the amplifier
and K_f apart (K_f = 0.1 is kept).  The gyro's scale was not known, so a commanded degree
counts as a degree of the horn, with pulses of 544 us at 0 and 2400 us at 180 degrees
(the Arduino library that commanded it).  The delay holds half of the 20 ms frame in which
pulses come.
"""

from __future__ import annotations

import math

from servo_models.core.plant import Variant

PULSE_PER_ANGLE = (2400e-6 - 544e-6) / math.pi
"""Seconds of pulse per radian."""
FEEDBACK = 0.1
SUPPLY, FRAME = 5.0, 0.02

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
)
