"""Variants of the general servo: what holds of most, with the spread that data sheets show.

Start from them, state what you know, and identify the rest from logs.  Only data sheets of speed
and torque stand behind the numbers; natural frequency, damping and delay are printed nowhere, and
their uncertainty says so.
"""

from __future__ import annotations

import math

from servo_models.actuators.second_order_servo.plant import BUS_PLANT
from servo_models.core.plant import Variant

STALL_TORQUE = 0.18  # N m: 1.8 kg cm of a 9 g servo on pulses
BUS_STALL_TORQUE = 1.8  # N m
ACCELERATION = 300.0  # rad/s2: 9 rad/s in 30 ms
BUS_ACCELERATION = 200.0  # rad/s2: 6 rad/s in 30 ms
FRAME = 0.02  # s

UNKNOWN = {
    "natural_frequency": 0.5,
    "damping_ratio": 0.3,
    "transport_delay.time": 0.5,
    "acceleration_limit": 0.5,
    "inertia": 0.5,
}

VARIANTS = (
    Variant(
        "pulse",
        "any hobby servo on pulses of 50 Hz: a first guess, to be identified",
        {
            "natural_frequency": 30.0,
            "damping_ratio": 0.8,
            "speed_limit": math.radians(60.0) / 0.12,
            "acceleration_limit": ACCELERATION,
            "inertia": STALL_TORQUE / ACCELERATION,
            "transport_delay.time": 0.5 * FRAME,
        },
        "data sheets of hobby servos: 60 degrees in 0.08 to 0.2 s, about 90 degrees per ms,"
        " 1.8 kg cm; delay: half a frame; of the rest nothing is known",
        uncertainty={**UNKNOWN, "pulse_gain": 0.2, "speed_limit": 0.4},
    ),
    Variant(
        "bus",
        "any servo with a goal on a bus: a first guess, to be identified",
        {
            "natural_frequency": 30.0,
            "damping_ratio": 0.8,
            "speed_limit": math.radians(60.0) / 0.18,
            "acceleration_limit": BUS_ACCELERATION,
            "inertia": BUS_STALL_TORQUE / BUS_ACCELERATION,
            "transport_delay.time": 0.005,
        },
        "data sheets of bus servos: 60 degrees in 0.1 to 0.3 s, 18 kg cm; angles are given in"
        " degrees or counts, so the gain is 1; of the rest nothing is known",
        plant=BUS_PLANT,
        uncertainty={
            **UNKNOWN,
            "gain": 0.02,
            "speed_limit": 0.4,
            # of the servo alone; a bus, a ROS node or a camera makes it 20 to 150 ms
            "transport_delay.time": 10.0,
        },
        command="goal",
    ),
)
