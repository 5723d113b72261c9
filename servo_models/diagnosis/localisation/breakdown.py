"""Shares of the squared error by one dimension, such as speed: the table, and it in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from servo_models.core.types import Array
from servo_models.diagnosis.search.crossval import closed
from servo_models.report.document import Document, Unbounded

Rows = NDArray[np.int64]

MOVING = 3.0  # local amplitude [noise floors] from which a relative error says something
STANDS_OUT = 2.0  # relative error over that of everything from which it is worth saying
CONCENTRATED = 0.1  # share of the squared error less that of the samples that is worth saying
WORSE = 1.1  # error after over error before from which a regime gets worse
SURE = 3.0  # standard errors by which it does, scattered as blocks of time or as samples


class Bin(Document, frozen=True):
    """One row of a breakdown.

    Attributes:
        label: what a person reads, with units.
        low, high: edges in the unit of the breakdown, nan where there are none.
        share_before, share_after: of the squared error at that stage [1].
        rms_before, rms_after: error in noise floors.
        relative_before, relative_after: error RMS over the RMS of the local amplitude of
            the response [1], nan where nothing moves.
        count: samples; 0 for a band of frequency, in which all of them have a part.
        worse: the error after is larger than before, beyond chance.
        closed: share of the error above the noise floor that is closed, None where there is none
            or, of a band of frequency, where it is not known.
    """

    label: str
    low: Unbounded
    high: Unbounded
    share_before: Unbounded
    share_after: Unbounded
    rms_before: Unbounded
    rms_after: Unbounded
    relative_before: Unbounded
    relative_after: Unbounded
    count: Annotated[int, Meta(ge=0)]
    worse: bool
    closed: float | None


class Breakdown(Document, frozen=True):
    """Where the squared error lies along one dimension; the shares of all bins make 1.

    Attributes:
        dimension: one word or two, such as ``"speed"``.
        unit: of the edges, as a person reads them.
        bins: in order.
        sentence: it in words.
    """

    dimension: str
    unit: str
    bins: tuple[Bin, ...]
    sentence: str

    @property
    def worse(self) -> tuple[Bin, ...]:
        """Regimes that get worse."""
        return tuple(one for one in self.bins if one.worse)


@dataclass(frozen=True, eq=False)
class Sums:
    """Sums by bin that a breakdown is made of, each of shape (k,).

    Attributes:
        before, after: squared errors [noise floors^2].
        amplitude: squared local amplitudes of the response [noise floors^2].
        weight: number of samples that the sums are of.
        worse: see ``Bin``.
    """

    before: Array
    after: Array
    amplitude: Array
    weight: Array
    worse: NDArray[np.bool_]


def tabulate(
    dimension: str,
    unit: str,
    edges: Sequence[tuple[str, float, float]],
    sums: Sums,
    phrase: str,
    samples: bool = True,
) -> Breakdown:
    """Make a breakdown of label and edges of every bin, and its sums; empty bins are left out.

    Args:
        dimension, unit: see ``Breakdown``.
        edges: label, low and high of every bin.
        sums: of the same bins.
        phrase: words that go before a label in a sentence.
        samples: whether a bin has samples of its own.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        rms = [np.sqrt(part / sums.weight) for part in (sums.before, sums.after)]
        relative = [np.sqrt(part / sums.amplitude) for part in (sums.before, sums.after)]
    shares = [part / (part.sum() or 1.0) for part in (sums.before, sums.after)]
    moved = sums.amplitude > 0.0
    bins = tuple(
        Bin(
            label,
            float(low),
            float(high),
            share_before=float(shares[0][k]),
            share_after=float(shares[1][k]),
            rms_before=float(rms[0][k]),
            rms_after=float(rms[1][k]),
            relative_before=float(relative[0][k]) if moved[k] else np.nan,
            relative_after=float(relative[1][k]) if moved[k] else np.nan,
            count=int(sums.weight[k]) if samples else 0,
            worse=bool(sums.worse[k]),
            closed=closed(float(rms[0][k]), float(rms[1][k]), 1.0) if samples else None,
        )
        for k, (label, low, high) in enumerate(edges)
        if sums.weight[k] > 0
    )
    whole = float(np.sqrt(sums.before.sum() / (sums.amplitude.sum() or np.inf)))
    return Breakdown(dimension, unit, bins, _sentence(dimension, bins, phrase, whole))


def _sentence(dimension: str, bins: Sequence[Bin], phrase: str, whole: float) -> str:
    """Where most of the error lies, where it is large for what moves there, and where it grows.

    ``whole`` is the relative error of everything.
    """
    total = sum(one.count for one in bins)
    excess = [one.share_before - one.count / max(total, 1) for one in bins]
    top = bins[int(np.argmax(excess))]
    if len(bins) > 1 and max(excess) < CONCENTRATED:
        text = f"The squared error is spread evenly over {dimension}."
    else:
        of = f", {_percent(top.count / total)} of the samples" if top.count < total else ""
        text = (
            f"{_percent(top.share_before)} of the squared error lies {phrase}{top.label}{of};"
            f" its RMS there goes from {plain(top.rms_before)} to {plain(top.rms_after)} noise"
            " floors."
        )
    moving = [one for one in bins if one.rms_before > MOVING * one.relative_before]
    small = max(moving, key=lambda one: one.relative_before, default=None)
    if small and small.relative_before > STANDS_OUT * whole:
        text += (
            f" Over the local amplitude it is largest {phrase}{small.label}:"
            f" {_percent(small.relative_before)} before, {_percent(small.relative_after)} after."
        )
    grown = [one.label for one in bins if one.worse]
    if not grown:
        return text
    several = ", ".join(grown[:-1])
    return f"{text} It grows {phrase}{several}{' and ' if several else ''}{grown[-1]}."


def plain(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, without a power of ten up to 10^10."""
    return f"{float(f'{value:.{digits}g}'):.10g}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.2g} %" if share < 0.1 else f"{100.0 * share:.0f} %"


def grows(before: Array, after: Array, at: Rows, parts: Rows, count: int) -> NDArray[np.bool_]:
    """Return for each bin whether its error grows, beyond what blocks of time scatter.

    Args:
        before, after: squared errors, shape (n,).
        at: bin of each, shape (n,).
        parts: block of time of each, shape (n,).
        count: number of bins.
    """
    blocks = int(parts.max()) + 1
    cell = at * blocks + parts

    def summed(values: Array | None) -> Array:
        return np.bincount(cell, values, count * blocks).reshape(count, blocks).astype(float)

    change, samples = summed(after - before), summed(None)
    total, floor = change.sum(axis=1), samples.sum(axis=1)
    mean = total / np.maximum(floor, 1.0)
    between = np.sqrt(((change - mean[:, None] * samples) ** 2).sum(axis=1))
    scatter = np.maximum(between, np.sqrt(np.bincount(at, (after - before) ** 2, count)))
    old, new = np.bincount(at, before, count), np.bincount(at, after, count)
    return np.asarray((new > WORSE**2 * np.maximum(old, floor)) & (total > SURE * scatter))
