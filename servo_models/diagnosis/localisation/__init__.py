"""Where a gap lies: shares of the squared error before and after, by what the actuator did."""

from __future__ import annotations

from servo_models.diagnosis.localisation.breakdown import Bin, Breakdown
from servo_models.diagnosis.localisation.open_loop import by_block
from servo_models.diagnosis.localisation.regimes import (
    by_amplitude,
    by_position,
    by_reversal,
    by_signal,
    by_speed,
    by_time,
)
from servo_models.diagnosis.localisation.samples import collect
from servo_models.diagnosis.localisation.spectrum import by_frequency
from servo_models.diagnosis.search.selection import Selection

__all__ = ["Bin", "Breakdown", "where"]


def localise(selection: Selection) -> tuple[Breakdown, ...]:
    """Break a gap down by signal, block, time, frequency, command amplitude, speed, reversals,
    position.

    Errors before are those of the nominal model; errors after are on blocks of time that no
    fit has seen, but for blocks of the actuator, which run with what all samples say.  All
    outputs count together, in noise floors.
    """
    samples = collect(selection)
    breakdowns = (
        by_signal(samples),
        by_block(selection),
        by_time(samples),
        by_frequency(samples),
        by_amplitude(samples),
        by_speed(samples),
        by_reversal(samples),
        by_position(samples),
    )
    return tuple(one for one in breakdowns if one)
