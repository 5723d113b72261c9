"""Section: what each effect leaves of the gap, singly and in pairs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from servo_models.diagnosis.belief import COVERED
from servo_models.diagnosis.fitting.explanation import Explanation
from servo_models.diagnosis.gap import DRAWS
from servo_models.diagnosis.page.stages import together
from servo_models.diagnosis.page.verdict import percent
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.verdict import OUTSIDE, chances_of
from servo_models.report.parts import NONE, Line, Section, Table, number
from servo_models.report.style import Picture, colour, drawing, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TITLE = "Evidence"
ROW, MARGIN = 0.44, 0.8
"""Height of a row and of everything else [inch]."""
DOTTED = (0, (1, 1.5))
BEYOND = 3.0
"""Errors above this many times that of the nominal model are drawn at the edge."""
COLUMNS = ("effects", "error left [noise floors]", "95 % interval", "probability", "set", "search")
NUMBERS = ("error left [noise floors]", "95 % interval", "probability")


def section(found: Diagnosis) -> Section | None:
    """Return the error that every fitted effect and pair leaves; None if none was fitted."""
    causes = found.causes
    if not causes.singles:
        return None
    pictures = [_picture(found, causes.singles, "singles", "What each effect leaves")]
    tables = [_table(found, causes.singles, "Effects, fitted one at a time")]
    if causes.pairs:
        pictures.append(_picture(found, causes.pairs, "pairs", "What two effects leave"))
        tables.append(_table(found, causes.pairs, "Pairs of effects"))
    if causes.more:
        title = f"What {len(causes.more[0].effects)} effects leave"
        pictures.append(_picture(found, causes.more, "more", title))
        tables.append(_table(found, causes.more, "More effects together"))
    return Section(
        "evidence",
        TITLE,
        "Held-out error with each effect switched on and fitted, nominal parameters free inside"
        " their uncertainty. What counts is whether an effect predicts blocks of time that its"
        f" fit has not seen. {_about_set(found)} Read probabilities as a ranking: they come out"
        f" too sure.{_about_taken(found)}",
        tuple(tables),
        tuple(pictures),
    )


def _about_set(found: Diagnosis) -> str:
    aim = (
        f"The set is meant to hold a cause of the catalogue with {100 * COVERED:.0f} % probability"
    )
    outside = found.verdict.kind == OUTSIDE
    beyond = "here something beyond it is missing"
    return f"{aim}; {beyond}." if outside else f"{aim}."


def _about_taken(found: Diagnosis) -> str:
    """What fitting to the end made of the explanation that is told everywhere else."""
    taken = found.causes.taken
    left = {one.effects: number(one.evidence.rms, 3) for one in found.causes.alike}
    now = number(taken.evidence.rms, 3)
    then = left.get(taken.effects, now)
    if now == then:
        return ""
    return (
        f" All fits ended as soon as they could be compared; the one with {together(taken.effects)}"
        f" was then fitted to the end, and leaves {now} instead of {then}."
    )


def intervals(explanations: Sequence[Explanation]) -> list[tuple[float, float]]:
    """Return 95 % intervals of the errors left [noise floors], as compared with the best.

    Blocks are drawn again, the same for all, and the ratio to the best explanation is what
    varies: one whose interval reaches the best's error does as well.
    """
    losses = np.array([one.evidence.losses for one in explanations])
    best = int(np.argmin(losses.sum(axis=1)))
    blocks = losses.shape[1]
    draws = np.random.default_rng(0).integers(0, blocks, (DRAWS, blocks))
    drawn = losses[:, draws].sum(axis=2)
    ratios = np.sqrt(drawn / drawn[best])
    scale = explanations[best].evidence.rms
    limits = scale * np.quantile(ratios, (0.025, 0.975), axis=1)
    return [(float(low), float(high)) for low, high in limits.T]


def _chances(found: Diagnosis, explanations: Sequence[Explanation]) -> list[str]:
    """Probabilities among explanations of as many effects as were taken, "" for others."""
    if explanations is not found.causes.alike or not found.causes.taken.effects:
        return [""] * len(explanations)
    return [percent(float(chance)) for chance in chances_of(found.causes, found.verdict.rest)]


def _table(found: Diagnosis, explanations: Sequence[Explanation], caption: str) -> Table:
    rows = zip(explanations, intervals(explanations), _chances(found, explanations))
    lines = tuple(
        Line(
            (
                together(one.effects),
                number(one.evidence.rms),
                f"{number(low)} to {number(high)}",
                chance or NONE,
                "in the set" if one in found.verdict.rivals else "",
                "converged" if one.converged else "did not converge",
            )
        )
        for one, (low, high), chance in rows
    )
    return Table(caption, COLUMNS, lines, NUMBERS, folded=True)


def _picture(
    found: Diagnosis, explanations: Sequence[Explanation], name: str, title: str
) -> Picture:
    causes = found.causes
    count = len(explanations)
    edge = BEYOND * causes.before.rms
    with drawing(name, height=MARGIN + ROW * (count + 1)) as (figure, (axes,)):
        rows = zip(explanations, intervals(explanations), _chances(found, explanations))
        for row, (one, interval, chance) in enumerate(rows):
            member = one in found.verdict.rivals
            _row(axes, row, one.evidence.rms, interval, edge, member)
            _words(axes, row, together(one.effects), chance, member)
        _reference(axes, count, causes.retuned.evidence.rms, edge)
        _words(axes, count, "nominal parameters alone", "", False)
        best = explanations[0].evidence.rms
        for row in range(count + 1):
            axes.vlines(1.0, row - 0.18, row + 0.22, color=colour("ink"), lw=0.9)
            axes.vlines(best, row - 0.18, row + 0.22, color=colour("blue"), lw=0.8, ls=DOTTED)
        low = min(1.0, best)
        axes.set(xscale="log", xlim=(0.75 * low, 1.25 * edge), ylim=(count + 0.5, -0.75))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set(xlabel="held-out error [noise floors]", yticks=[])
        axes.spines["left"].set_visible(False)
        return picture(
            figure,
            name,
            title,
            "Upright marks: the noise floor; dotted: the best. Lines: 95 % intervals of the"
            " comparison with the best, over blocks: one that reaches the best does as well."
            " Filled: in the set.",
        )


def _row(
    axes: Axes, row: int, error: float, interval: tuple[float, float], edge: float, member: bool
) -> None:
    tint = colour("blue" if member else "muted")
    if error > edge:
        axes.plot(edge, row, ">", color=tint, mfc="none")
        return
    axes.plot(np.minimum(interval, edge), [row, row], color=tint, lw=1.6)
    axes.plot(error, row, "o", color=tint, mfc=tint if member else colour("paper"))


def _reference(axes: Axes, row: int, error: float, edge: float) -> None:
    axes.plot(min(error, edge), row, "D", color=colour("green"), ms=4.5)


def _words(axes: Axes, row: int, left: str, right: str, member: bool) -> None:
    """Write above a row, so that a phone needs no column for it."""
    for at, text, align in ((0.0, left, "left"), (1.0, right, "right")):
        axes.text(
            at,
            row - 0.2,
            text,
            transform=axes.get_yaxis_transform(),
            ha=align,
            va="bottom",
            fontsize=8.5,
            color=colour("ink" if member else "muted"),
        ).set_in_layout(False)
