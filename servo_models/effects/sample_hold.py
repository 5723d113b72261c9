"""Sample and hold: the command is read on its own clock."""

import math
from typing import Annotated

from servo_models.core.block import Clock, Grid, Hints, Memory, Param, effect

MULTIPLIER = 16807.0  # multiplier of the generator of Park and Miller
MODULUS = 2147483647.0  # 2^31 - 1
SHORTEST = 1e-6  # frame [s] below which the signal counts as continuous


@effect(
    "signal",
    source="SG90 paper sec. 4.1 (20 ms frame); Park, Miller, CACM 31 (1988) 1192",
    hints=Hints(
        says="the {wire} is read every {period}",
        family="delay",
        grid=Grid(low=0.15, high=10.0, least_spacing=0.0015, divides="duration"),
        assumed=("jitter",),
        signature="clock",
    ),
)
def sample_hold(
    signal: float,
    due: float,
    period: Annotated[
        float,
        Param("{time}", "frame", high=0.1, switch=True, typical=0.02, display="ms", fixed=True),
    ],
    jitter: Annotated[
        float, Param("1", "largest lateness of a sample, as a fraction of the frame", high=0.9)
    ],
    held: Annotated[float, Memory("rest")],
    next_sample: Annotated[float, Clock()],
    random: Annotated[float, Memory(20260.0)],
) -> tuple[float, float, float, float]:
    """y = u at the latest tick; ticks at k period, each late by up to jitter period.

    The lateness comes from a small generator whose state is part of the model's state, so
    a run can be repeated and resumed.
    """
    if period < SHORTEST:
        return signal, held, next_sample, random
    if due < next_sample:
        return held, held, next_sample, random
    random = MULTIPLIER * random
    random = random - MODULUS * math.floor(random / MODULUS)
    late = jitter * (random / MODULUS)
    next_sample = (math.floor(due / period) + 1.0 + late) * period
    return signal, signal, next_sample, random
