"""The autopilot: attitude loops of roll and pitch, a yaw damper, four servo pulses at 50 Hz.

Structure: R. Beard, T. McLain, Small Unmanned Aircraft, 2012, secs. 6.3 and 6.4 (proportional,
integral and rate feedback).  All of it runs once a frame: readings are taken, commands are held.
"""

from __future__ import annotations

import math
from typing import Annotated

from servo_models import Actuator, Clock, Memory, Param, Plant, Variant, Wire, block

SOURCE = "Beard, McLain, Small Unmanned Aircraft, secs. 6.3 and 6.4"
CENTRE = 1.5e-3  # s, the pulse at which a servo stands in the middle

Gain = Annotated[float, Param("1", "surface per error of the angle", high=10.0)]
Integral = Annotated[float, Param("1/s", "surface per integral of the error", high=10.0)]
Damping = Annotated[float, Param("s", "surface against the rate", high=2.0)]


@block("aileron", "elevator", "rudder", source=SOURCE)
def control(
    roll_command: float,
    pitch_command: float,
    roll: float,
    pitch: float,
    roll_rate: float,
    pitch_rate: float,
    yaw_rate: float,
    aileron_test: float,
    elevator_test: float,
    due: float,
    frame: Annotated[
        float,
        Param("s", "time from run to run", 0.02, low=1e-3, high=0.1, display="ms", fixed=True),
    ],
    roll_gain: Gain,
    roll_integral: Integral,
    roll_damping: Damping,
    pitch_gain: Gain,
    pitch_integral: Integral,
    pitch_damping: Damping,
    yaw_damping: Damping,
    turn_rate: Annotated[
        float, Param("rad/s", "gravity over airspeed", 9.81 / 25.0, low=0.1, high=1.0)
    ],
    tick: Annotated[float, Clock()],
    roll_sum: Annotated[float, Memory()],
    pitch_sum: Annotated[float, Memory()],
    held_aileron: Annotated[float, Memory()],
    held_elevator: Annotated[float, Memory()],
    held_rudder: Annotated[float, Memory()],
) -> tuple[float, float, float, float, float, float, float, float, float]:
    """Surfaces [rad], new at every tick: roll right, nose up and yaw right need +, -, -.

    The rudder opposes the yaw rate that a coordinated turn does not have.
    """
    if due >= tick:
        tick = (math.floor(due / frame) + 1.0) * frame
        error = roll_command - roll
        held_aileron = roll_gain * error + roll_integral * roll_sum - roll_damping * roll_rate
        held_aileron = held_aileron + aileron_test
        roll_sum = roll_sum + frame * error
        error = pitch_command - pitch
        held_elevator = pitch_damping * pitch_rate - pitch_gain * error - pitch_integral * pitch_sum
        held_elevator = held_elevator + elevator_test
        pitch_sum = pitch_sum + frame * error
        held_rudder = yaw_damping * (yaw_rate - turn_rate * math.sin(roll))
    return (
        held_aileron,
        held_elevator,
        held_rudder,
        tick,
        roll_sum,
        pitch_sum,
        held_aileron,
        held_elevator,
        held_rudder,
    )


@block("left_aileron_pulse", "right_aileron_pulse", "elevator_pulse", "rudder_pulse")
def pulses(
    aileron: float,
    elevator: float,
    rudder: float,
    pulse_per_angle: Annotated[
        float, Param("s/rad", "of the servos", 1856e-6 / math.pi, low=1e-4, high=1e-3)
    ],
) -> tuple[float, float, float, float]:
    """Pulses [s]; the ailerons go against each other."""
    swing = pulse_per_angle * aileron
    return (
        CENTRE + swing,
        CENTRE - swing,
        CENTRE + pulse_per_angle * elevator,
        CENTRE + pulse_per_angle * rudder,
    )


def angle(name: str, about: str) -> Wire:
    """A signal that is an angle."""
    return Wire(name, "rad", about, 0.5, low=-3.2, high=3.2, display="deg")


def rate(name: str, about: str) -> Wire:
    """A signal that is an angular rate."""
    return Wire(name, "rad/s", about, 1.0, low=-50.0, high=50.0, display="deg/s")


def pulse(name: str) -> Wire:
    """The pulse of one servo."""
    return Wire(f"{name}_pulse", "s", f"pulse of the servo, {name}", 1e-3, CENTRE, display="us")


PLANT = Plant(
    inputs=(
        angle("roll_command", "commanded roll"),
        angle("pitch_command", "commanded pitch, from trim"),
        angle("roll", "measured roll"),
        angle("pitch", "measured pitch, from trim"),
        rate("roll_rate", "measured roll rate"),
        rate("pitch_rate", "measured pitch rate"),
        rate("yaw_rate", "measured yaw rate"),
        angle("aileron_test", "added to the aileron, to measure the loop"),
        angle("elevator_test", "added to the elevator, to measure the loop"),
    ),
    wires=(
        angle("aileron", "aileron command"),
        angle("elevator", "elevator command"),
        angle("rudder", "rudder command"),
        *(pulse(name) for name in ("left_aileron", "right_aileron", "elevator", "rudder")),
    ),
    constants={"internal_step": Param("s", "integration", default=1e-2, low=1e-5, high=1e-2)},
    chain=(control, pulses),
    states=(),
    outputs=(
        "aileron",
        "elevator",
        "rudder",
        "left_aileron_pulse",
        "right_aileron_pulse",
        "elevator_pulse",
        "rudder_pulse",
    ),
)

ACTUATOR = Actuator(
    name="autopilot",
    title="Attitude autopilot",
    about="Roll and pitch loops and a yaw damper for a small fixed-wing UAV.",
    source=SOURCE,
    plant=PLANT,
    variants=(
        Variant(
            "cruise",
            "tuned for the Aerosonde at 25 m/s",
            {
                "roll_gain": 1.0,
                "roll_integral": 0.5,
                "roll_damping": 0.03,
                "pitch_gain": 2.0,
                "pitch_integral": 1.0,
                "pitch_damping": 0.2,
                "yaw_damping": 0.2,
            },
            "this example",
        ),
    ),
    stop_time=1.0,
    step_size=0.001,
    step=("roll_command", 0.35),
)
