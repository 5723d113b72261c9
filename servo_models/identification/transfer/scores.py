"""How well a transfer function describes the evidence, fitted and held out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.analysis.statistics import dependence, whiteness
from servo_models.core.types import Array
from servo_models.identification.transfer.evidence import Evidence, Point, Record
from servo_models.identification.transfer.functions import TransferFunction

BLOCKS = 20
"""Held-out samples are compared in so many blocks, since neighbours are not independent."""


@dataclass(frozen=True, eq=False)
class Score:
    """What the errors of a transfer function look like.

    Attributes:
        errors, held_out_errors: by name of the evidence; SI for records; for frequency
            responses logarithm of gain, then phase [rad], over the points' spread.
        fit, held_out: share of the records' movement that is described, 1 for all of it,
            on fitted and on held-out samples; None without any.
        white: least probability, over the records, of such autocorrelations in white noise.
        independent: least probability of such correlations with past inputs if there is none;
            both None without records.
    """

    errors: Mapping[str, Array]
    held_out_errors: Mapping[str, Array]
    fit: float | None
    held_out: float | None
    white: float | None
    independent: float | None

    @property
    def rms(self) -> dict[str, float]:
        """Root mean square of the fitted errors by evidence."""
        return {name: float(np.sqrt(np.mean(e**2))) for name, e in self.errors.items() if len(e)}

    def losses(self, noise: Mapping[str, float]) -> Array:
        """Mean square of the held-out errors, over their noise, block by block."""
        parts = [(e / noise[name]) ** 2 for name, e in self.held_out_errors.items()]
        joined = np.concatenate([p for p in parts if len(p)] or [np.zeros(0)])
        blocks = np.array_split(joined, min(BLOCKS, len(joined)) or 1)
        return np.array([float(np.mean(b)) for b in blocks if len(b)])


def score(function: TransferFunction, evidence: Sequence[Evidence]) -> Score:
    """Compare a transfer function with all evidence."""
    fitted: dict[str, Array] = {}
    hidden: dict[str, Array] = {}
    chances: list[tuple[float, float]] = []
    point = Point.of(function)
    for one in evidence:
        with np.errstate(all="ignore"):
            error, _ = one.errors(point, False)
        out = one.rows_held_out
        fitted[one.name], hidden[one.name] = error[~out], error[out]
        if isinstance(one, Record) and not np.all(out):
            chances.append((whiteness(error, ~out), dependence(error, one.given, ~out)))
    white = min((chance for chance, _ in chances), default=None)
    independent = min((chance for _, chance in chances), default=None)
    return Score(
        fitted,
        hidden,
        _described(evidence, fitted, held_out=False),
        _described(evidence, hidden, held_out=True),
        white,
        independent,
    )


def _described(
    evidence: Sequence[Evidence], errors: Mapping[str, Array], held_out: bool
) -> float | None:
    """1 - norm of the errors over norm of the movement, over all records."""
    missed = moved = 0.0
    for one in evidence:
        if isinstance(one, Record):
            y = one.measured[one.held_out == held_out]
            if len(y):
                missed += float(np.sum(errors[one.name] ** 2))
                moved += float(np.sum((y - np.mean(y)) ** 2))
    return 1.0 - float(np.sqrt(missed / moved)) if moved > 0.0 else None
