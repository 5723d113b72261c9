"""Stretches that a description holds out: what the effects do to each, beside parameters alone.

An effect that serves on the whole may spoil one kind of motion.  There it stands for something
else, or something more is missing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from servo_models.core.types import Array
from servo_models.diagnosis.localisation.breakdown import grows
from servo_models.diagnosis.search.crossval import BLOCKS
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.search.selection import Selection


@dataclass(frozen=True)
class HeldOut:
    """Samples of a log that no fit of a diagnosis has seen, RMS in noise floors.

    Attributes:
        log: its name.
        retuned: left by nominal parameters alone, NaN where these cannot be simulated.
        after: left by the fitted model that was taken, NaN where it cannot be simulated.
        worse: it leaves more, beyond what blocks of time scatter; never without ``retuned``.
    """

    log: str
    retuned: float
    after: float
    worse: bool


def held_out_scores(selection: Selection) -> tuple[HeldOut, ...]:
    """Return what the fitted model that was taken does to each log with samples held out."""
    found = []
    pairs = zip(held_out_squares(selection.retuned), held_out_squares(selection.taken))
    for log, (old, new) in zip(selection.taken.problem.logs, pairs):
        if len(old):
            parts = np.arange(len(old)) * BLOCKS // len(old)
            retuned, after = (float(np.sqrt(part.mean())) for part in (old, new))
            grown = np.isnan(after) or grows(old, new, np.zeros_like(parts), parts, 1)[0]
            found.append(HeldOut(log.name, retuned, after, bool(grown) and not np.isnan(retuned)))
    return tuple(found)


def held_out_squares(found: FittedModel) -> list[Array]:
    """Return squared errors [noise floors^2] at samples held out, mean of all outputs, by log."""
    squares = []
    for run in found.problem.runs:
        log, columns = run.log, run.outputs_or_nan(found.values).T
        errors = [
            (column - measured)[log.checked] / found.problem.sigma[name]
            for column, (name, measured) in zip(columns, log.outputs.items())
        ]
        squares.append(np.mean(np.square(errors), axis=0))
    return squares
