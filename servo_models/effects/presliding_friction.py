"""Dry friction that gives before it slides, as a spring and a damper."""

import math
from typing import Annotated

from servo_models.core.block import Ambiguity, Hints, Memory, Param, effect


@effect(
    "load",
    source="Dahl, AIAA J. 14 (1976) 1675, exponent 1; damping as in Canudas de Wit et al., IEEE"
    " Trans. Automatic Control 40 (1995) 419, which fades with the speed",
    hints=Hints(
        trial_values=(0.1, 0.7, 5.0),
        says="dry friction of {level} that gives before it slides",
        family="friction",
        ambiguity=Ambiguity(
            "triangles from a tenth of a degree up, slow and ten times faster: friction that gives"
            " makes a loop in position however small they are, that of a drive shrinks with it, and"
            " stiff friction holds still",
            ("presliding_friction",),
            ("hysteresis", "coulomb_friction", "stribeck_friction", "viscous_friction"),
        ),
    ),
)
def presliding_friction(
    load: float,
    shaft_angle: float,
    shaft_speed: float,
    angle_unit: float,
    full_speed: float,
    level: Annotated[
        float, Param("signal", "sliding friction torque", high=0.5, switch=True, typical=0.05)
    ],
    stiffness: Annotated[
        float, Param("{load}/{shaft_angle}", "stiffness at rest", default=10.0, high=500.0)
    ],
    speed: Annotated[
        float,
        Param("1", "speed above which it slides, of full speed", default=0.05, low=5e-4, high=0.5),
    ],
    last: Annotated[float, Memory()],
    bend: Annotated[float, Memory()],
) -> tuple[float, float, float]:
    """Adds level z. After a reversal z turns to the new direction within a travel of level /
    stiffness, or as soon as ``speed`` is passed.

    level z' = stiffness (v - abs(v) z), solved exactly between two commits; the damping at rest,
    level / speed, makes z the tanh(v / speed) that this speed alone would make.  Without stiffness
    it is Coulomb friction that creeps; with a higher ``speed`` it would be viscous friction.
    """
    if level <= 0.0 or full_speed <= 0.0:
        return load, last, bend
    moved = shaft_angle - last
    if moved != 0.0 and stiffness > 0.0 and angle_unit > 0.0:
        end = 1.0 if moved > 0.0 else -1.0
        bend = end + (bend - end) * math.exp(-stiffness * (abs(moved) / angle_unit / level))
    end = 1.0 if shaft_speed > 0.0 else -1.0
    held = math.exp(-2.0 * abs(shaft_speed) / (speed * full_speed))
    share = end + (bend - end) * 2.0 * held / (1.0 + held)
    return load + level * share, shaft_angle, bend
