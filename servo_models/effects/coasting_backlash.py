"""Play before an output mass that coasts through it."""

import math
from typing import Annotated

from servo_models.core.block import Ambiguity, Hints, Param, effect

SOURCE = "Nordin, Gutman, Automatica 38 (2002) 1633, sec. 2.2 (two masses, contact with damping)"
STEP_ANGLE = 0.13  # phase of the contact's oscillation in an internal step [rad]

HalfWidth = Annotated[
    float,
    Param("{angle}", "half of the play", high=0.2, switch=True, typical=0.01, display="deg"),
]
Share = Annotated[
    float,
    Param("1", "part of the accelerated inertia behind the play", 0.2, 0.01, 0.95, fixed=True),
]
Contact = Annotated[
    float,
    Param("Hz", "natural frequency of the output on the gear", 60.0, 5.0, 1e3, fixed=True),
]


@effect("shaft_inertia", "coasting_inertia", source=SOURCE)
def divided_inertia(
    shaft_inertia: float, coasting_inertia: float, half_width: HalfWidth, share: Share
) -> tuple[float, float]:
    """Inertias [kg m^2] that turn with the motor and behind the play."""
    if half_width <= 0.0:
        return shaft_inertia, coasting_inertia
    return (1.0 - share) * shaft_inertia, share * shaft_inertia


@effect("internal_step", source="accuracy of the classical Runge-Kutta method")
def contact_step(
    internal_step: float, half_width: HalfWidth, share: Share, contact: Contact
) -> float:
    """The internal step follows the oscillation of both masses in contact."""
    if half_width <= 0.0:
        return internal_step
    limit = STEP_ANGLE * math.sqrt(1.0 - share) / (2.0 * math.pi * contact)
    return limit if limit < internal_step else internal_step


@effect("load", "coasting_torque", source=SOURCE)
def coasting_load(
    load: float,
    coasting_torque: float,
    coasting_inertia: float,
    play_twist: float,
    play_slip: float,
    half_width: HalfWidth,
    contact: Contact,
    damping: Annotated[float, Param("1", "damping ratio of the output in contact", 0.3, 0.0, 2.0)],
) -> tuple[float, float]:
    """The gear pushes the output outside the play and never pulls; the load acts on the output."""
    if half_width <= 0.0:
        return load, coasting_torque
    frequency = 2.0 * math.pi * contact
    drag = 2.0 * damping * frequency * play_slip
    push = 0.0
    if play_twist > half_width:
        push = coasting_inertia * (frequency * frequency * (play_twist - half_width) + drag)
        if push < 0.0:
            push = 0.0
    if play_twist < -half_width:
        push = coasting_inertia * (frequency * frequency * (play_twist + half_width) + drag)
        if push > 0.0:
            push = 0.0
    return push, push - load


@effect(
    "friction",
    "coasting_acceleration",
    source="Moreau's time stepping: Acary, Brogliato, Numerical Methods for Nonsmooth Dynamical"
    " Systems, 2008, ch. 10",
)
def coasting_friction(
    friction: float,
    coasting_acceleration: float,
    coasting_torque: float,
    start_coasting_speed: float,
    coasting_inertia: float,
    internal_step: float,
    half_width: HalfWidth,
    friction_share: Annotated[
        float, Param("1", "part of the dry friction behind the play", 0.3, 0.0, 1.0)
    ],
) -> tuple[float, float]:
    """The output's own friction takes what stops it within a step, and at most its level."""
    if half_width <= 0.0:
        return friction, coasting_acceleration
    level = friction_share * friction
    brake = coasting_inertia * start_coasting_speed / internal_step + coasting_torque
    if brake > level:
        brake = level
    if brake < -level:
        brake = -level
    return friction - level, (coasting_torque - brake) / coasting_inertia


@effect(
    "angle",
    "rate",
    "play_twist",
    "play_slip",
    "coasting_rate",
    source=SOURCE,
    name="coasting_backlash",
    parts=(divided_inertia, contact_step, coasting_load, coasting_friction),
    hints=Hints(
        says="{half_width} of play to either side, before an output that coasts",
        assumed=("contact", "damping"),
        ambiguity=Ambiguity(
            "log a motor-side signal or the current; a one-sided load removes the play",
            ("coasting_backlash",),
            ("backlash", "dead_zone", "hysteresis", "gear_compliance"),
        ),
    ),
)
def coasting_output(
    angle: float,
    rate: float,
    play_twist: float,
    play_slip: float,
    coasting_rate: float,
    coasting_angle: float,
    coasting_speed: float,
    half_width: HalfWidth,
) -> tuple[float, float, float, float, float]:
    """The output is the mass behind the play."""
    if half_width <= 0.0:
        return angle, rate, play_twist, play_slip, coasting_rate
    twist, slip = angle - coasting_angle, rate - coasting_speed
    return coasting_angle, coasting_speed, twist, slip, coasting_speed
