"""A rehearsal as people read it: what would be found, what not, and what is confused with what."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from servo_models.report.numbers import Quantity, listed, number, percent, plural
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Card, Cell, Mark, Picture, Section, Table
from servo_models.report.style import colour
from servo_models.survey.rehearsal.rehearse import (
    AMONG,
    BEYOND,
    FAILED,
    FOUND,
    NO_EFFECT,
    OTHER,
    TOLD,
    Answer,
    Rehearsal,
)
from servo_models.survey.sections import quantity

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST_WEIGHT = 0.05  # of what is told in a row
CELL = 0.3  # width and height of a cell [inch]
NAMES = 2.4  # room for names beside and below the cells [inch]
PASSED = {FOUND: True, NO_EFFECT: True, AMONG: None, FAILED: None}  # the rest did not
CRIME = (
    "The logs are made by the equations that are fitted, with white noise: an upper bound. What is"
    " not found here will hardly be found in a real log; what is found here, one may still hide."
)
EACH, MATRIX = "Effect by effect", "What is taken for what"


@report_of.register(Rehearsal)
def report(rehearsal: Rehearsal, date: str = "") -> Report:
    """Return the report of a rehearsal."""
    gaps = dict.fromkeys(it.wanted for it in rehearsal.answers if it.effect)
    columns = ("effect", "size", "gap", "told", "names")
    stopped = f"Stopped: {plural(rehearsal.unfinished, 'log')} not tried."
    return Report(
        f"Rehearsal of {rehearsal.name}",
        "; ".join(_sentence(rehearsal, gap) for gap in gaps) or "nothing was tried",
        cards=tuple(_cards(rehearsal, max(gaps))) if gaps else (),
        remarks=(*([stopped] if rehearsal.unfinished else []), CRIME, *rehearsal.notes),
        sections=(
            Section(
                EACH,
                "Each effect alone in the model, at the least size that makes the gap, RMS in noise"
                f" floors. Noise floors: {_floors(rehearsal)}.",
                tables=(Table("", columns, tuple(map(_row, rehearsal.answers))),),
            ),
            Section(
                MATRIX,
                "Rows: what was put in. Columns: what is told, with its weight in percent.",
                pictures=tuple(filter(None, (_matrix(rehearsal, gap) for gap in gaps))),
            ),
        ),
        date=date,
    )


def _at(rehearsal: Rehearsal, gap: float) -> list[Answer]:
    return [it for it in rehearsal.answers if it.effect and it.wanted == gap]


def _sentence(rehearsal: Rehearsal, gap: float) -> str:
    told = [it.told for it in _at(rehearsal, gap)]
    among = told.count(AMONG)
    return (
        f"gap of {number(gap, 3)} noise floors: {told.count(FOUND)} of {len(told)} effects found"
        f"{f', {among} as one of several' if among else ''}"
    )


def _cards(rehearsal: Rehearsal, gap: float) -> Iterator[Card]:
    """Names by what is told of them at the largest gap."""
    answers = _at(rehearsal, gap)
    for told in TOLD:
        names = [it.effect for it in answers if it.told == told]
        if names:
            yield Card(
                told, listed(names), told == FOUND or None, MATRIX if told == AMONG else EACH
            )


def _floors(rehearsal: Rehearsal) -> str:
    every = rehearsal.sensors.items()
    return listed(f"{name} {quantity(it.floor, it.unit)}" for name, it in every)


def _row(answer: Answer) -> tuple[Cell, ...]:
    size = "" if answer.size is None else str(quantity(answer.size, answer.unit))
    gap = None if answer.gap is None else Quantity(answer.gap, digits=3)
    told = Mark(answer.told, PASSED.get(answer.told, False))
    weights = sorted(answer.weights.items(), key=lambda it: -it[1])
    what = ", ".join(f"{name} {percent(it)}" for name, it in weights if it >= LEAST_WEIGHT)
    others = {AMONG: what, OTHER: what, BEYOND: ", ".join(answer.named), FAILED: answer.failure}
    return (answer.effect or NO_EFFECT, size, gap, told, others.get(answer.told, ""))


def _matrix(rehearsal: Rehearsal, gap: float) -> Picture | None:
    """The weights of what is told, a row an effect that was put in."""
    answers = [it for it in rehearsal.answers if it.weights and it.wanted in (gap, 0.0)]
    rows = [it.effect or NO_EFFECT for it in answers]
    told = {name for it in answers for name, weight in it.weights.items() if weight >= LEAST_WEIGHT}
    columns = [*(name for name in rows if name in told), *sorted(told.difference(rows))]
    if not told:
        return None

    def draw(panels: Sequence[Axes]) -> None:
        (axes,) = panels
        for row, answer in enumerate(answers):
            for name, weight in answer.weights.items():
                if weight < LEAST_WEIGHT:
                    continue
                right = name == answer.effect or answer.told == NO_EFFECT
                column, tint = columns.index(name), colour("blue" if right else "orange")
                axes.bar(column, 1.0, 1.0, row - 0.5, color=tint, alpha=0.75 * weight, lw=0)
                text = f"{100.0 * weight:.0f}"
                axes.text(column, row, text, ha="center", va="center", fontsize=6.5)
        axes.grid(False)
        axes.set_xticks(range(len(columns)), columns, rotation=90)
        axes.set_yticks(range(len(rows)), rows)
        axes.set(xlim=(-0.5, len(columns) - 0.5), ylim=(len(rows) - 0.5, -0.5))

    return Picture(
        f"Gap of {number(gap, 3)} noise floors",
        draw,
        "Blue: the right one. Orange: another one.",
        height=CELL * len(rows) + NAMES,
        width=CELL * len(columns) + NAMES,
    )


@document_of.register(Rehearsal)
def document(rehearsal: Rehearsal) -> dict[str, Any]:
    """Return a rehearsal as what JSON is made of, figures in SI."""
    return {
        "name": rehearsal.name,
        "remark": CRIME,
        "noise_floors": {name: it.floor for name, it in rehearsal.sensors.items()},
        "answers": [*rehearsal.answers],
        "unfinished": rehearsal.unfinished,
    }
