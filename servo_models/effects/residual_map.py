"""Residual map: a shape without a name, learnt from logs.

It is a sum of broken lines, each of one thing that the actuator does.  Three sizes say where it
acts: on the load torque, on the drive, or on the reading in the loop.  No law of physics is
claimed, so no search tries it as a cause; ``diagnosis.residual_map`` learns it.
"""

import math
from typing import Annotated

from servo_models.core.block import Hints, Memory, Mode, Notice, Param, effect

SOURCE = "Hastie, Tibshirani, Generalized Additive Models, 1990, ch. 4 (additive curves)"
KNOTS = 9  # knots of each curve, evenly spaced from its low to its high end
LAST = KNOTS - 1.0  # place of the last knot in knot distances from the first
ROUNDING = 1e-6  # distance beyond an end, in knot distances, that counts as the end
BEYOND = (
    "'{regressor}' went beyond the range of its curve, which is held at its edge there (and is off"
    " if its ends are crossed); learn it again from logs that go as far"
)
LEARNT = Hints(learnt=True)

Weight = Annotated[
    float, Param("1", "weight of the curve", low=0.0, high=1.0, switch=True, typical=1.0)
]


def _value(where: str, default: float) -> Param:
    return Param("1", f"value at {where}", default, low=-1.0, high=1.0)


@effect("since_reversal", source="definition", hints=LEARNT)
def time_since_reversal(
    since_reversal: float,
    shaft_speed: float,
    elapsed: float,
    reversal: Weight,
    lasted: Annotated[float, Memory()],
    direction: Annotated[float, Mode()],
) -> tuple[float, float, float]:
    """Time [s] since the motion turned, negative while it is negative.

    A turn is located in time, so that the response does not hang on the internal step.
    """
    if reversal <= 0.0:
        return since_reversal, lasted, direction
    lasted = lasted + elapsed
    if shaft_speed != 0.0 and shaft_speed * direction <= 0.0:
        lasted = 0.0
        direction = math.copysign(1.0, shaft_speed)
    return direction * lasted, lasted, direction


@effect("residual", source=SOURCE, hints=LEARNT)
def curve(
    residual: float,
    regressor: float,
    weight: Weight,
    low: Annotated[float, Param("{regressor}", "low end", -1.0, -1e3, 1e3)],
    high: Annotated[float, Param("{regressor}", "high end", 1.0, -1e3, 1e3)],
    knot_1: Annotated[float, _value("the low end", -1.0)],
    knot_2: Annotated[float, _value("knot 2", -0.75)],
    knot_3: Annotated[float, _value("knot 3", -0.5)],
    knot_4: Annotated[float, _value("knot 4", -0.25)],
    knot_5: Annotated[float, _value("the middle", 0.0)],
    knot_6: Annotated[float, _value("knot 6", 0.25)],
    knot_7: Annotated[float, _value("knot 7", 0.5)],
    knot_8: Annotated[float, _value("knot 8", 0.75)],
    knot_9: Annotated[float, _value("the high end", 1.0)],
    beyond: Annotated[float, Notice(message=BEYOND)],
) -> tuple[float, float]:
    """Adds a broken line through values at evenly spaced knots, held at both ends.

    It is written as a sum of distances to the knots, each times the bend of the line there.
    """
    if weight <= 0.0:
        return residual, beyond
    if high <= low:
        return residual, 1.0
    at = LAST * (regressor - low) / (high - low)
    if at < -ROUNDING or at > LAST + ROUNDING:
        beyond = 1.0
    bent = (knot_2 - knot_1) * abs(at)
    bent += (knot_3 - 2.0 * knot_2 + knot_1) * abs(at - 1.0)
    bent += (knot_4 - 2.0 * knot_3 + knot_2) * abs(at - 2.0)
    bent += (knot_5 - 2.0 * knot_4 + knot_3) * abs(at - 3.0)
    bent += (knot_6 - 2.0 * knot_5 + knot_4) * abs(at - 4.0)
    bent += (knot_7 - 2.0 * knot_6 + knot_5) * abs(at - 5.0)
    bent += (knot_8 - 2.0 * knot_7 + knot_6) * abs(at - 6.0)
    bent += (knot_9 - 2.0 * knot_8 + knot_7) * abs(at - 7.0)
    bent += (knot_8 - knot_9) * abs(at - LAST)
    return residual + weight * 0.5 * (knot_1 + knot_9 + bent), beyond


@effect("driven", source=SOURCE, hints=LEARNT)
def residual_drive(
    driven: float,
    residual: float,
    drive: Annotated[
        float, Param("{driven}", "size on the drive", high=1.0, switch=True, typical=0.05)
    ],
) -> float:
    """Adds the curves to the drive."""
    return driven + drive * residual


@effect("sensed", source=SOURCE, hints=LEARNT)
def residual_reading(
    sensed: float,
    residual: float,
    reading: Annotated[
        float, Param("{sensed}", "size on the reading", high=1.0, switch=True, typical=0.05)
    ],
) -> float:
    """Adds the curves to what the loop reads."""
    return sensed + reading * residual


CURVES = {
    key: curve.keyed(
        {**{name: f"{key}_{name}" for name in (*curve.params, *curve.memory)}, "weight": key}
    )
    for key in ("rate", "position", "command", "load", "reversal")
}
"""Curve of each argument that the map may have, by the key of its weight."""


@effect(
    "load",
    source=SOURCE,
    name="residual_map",
    parts=(time_since_reversal, *CURVES.values(), residual_drive, residual_reading),
    hints=LEARNT,
)
def residual_torque(
    load: float,
    residual: float,
    torque: Annotated[
        float, Param("{load}", "size on the load torque", high=1.0, switch=True, typical=0.05)
    ],
) -> float:
    """Adds the curves to the load torque."""
    return load + torque * residual
