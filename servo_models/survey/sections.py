"""A survey as people read it: the worst first, whose causes they are, what varies and changed."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Annotated

import numpy as np

from servo_models.diagnosis.verdict import NO_GAP, NOT_IDENTIFIABLE, PARAMETERS
from servo_models.report.curves import DASHED, draw_label
from servo_models.report.document import Document, Figure, about, choice
from servo_models.report.numbers import Quantity, listed, number, percent, plural, with_unit
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Card, Cell, Mark, Picture, Section, Table
from servo_models.report.style import colour
from servo_models.survey.belonging import BATCH, MODEL, SINGLE, UNIT, Belonging
from servo_models.survey.job import Cause, Estimate, Outcome
from servo_models.survey.result import (
    BETTER,
    GONE,
    MOST_SPLITS,
    NEW,
    OTHER,
    WORSE,
    Survey,
    Value,
    Variation,
    badness,
    causes,
    values_of,
    verdict,
)
from servo_models.survey.variation import told
from servo_models.units import factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DISPLAY = {"s": "ms", "rad": "deg", "rad/s": "deg/s", "m": "mm", "m/s": "mm/s"}
"""Units in which people read what is in SI."""
MOST_UNITS = 200  # rows of the matrix
MOST_COLUMNS = 12  # of the matrix, which else has the joints as rows, if those are more than units
MOST_WORST = 10
MOST_SINGLES = 20  # causes of single joints that are listed
MOST_PICTURES = 4
MOST_DRAWN = 12  # units of a picture
MOST_CHANGES = 50  # rows
MOST_OUTLIERS = 50  # rows
MOST_NAMES = 3  # examples of a reason
NORMAL_95 = 1.96  # standard errors of an interval of 95 %
ROW = 0.42  # height of a unit in a picture [inch]
MATRIX, WORST, WHOSE, CHANGES = "Verdicts", "The worst", "Whom causes belong to", "Since before"
VALUES, OUTLIERS, LEFT_OUT = "Parameters", "Units that stand out", "Failed and left out"
PARTS = ("unit", "episode", "rest")
KINDS = (WORSE, BETTER, NEW, GONE, OTHER)
SPECIFIC = re.compile(r"'[^']*'|\d+(?:\.\d+)?")
"""What differs between reports of one reason."""


@report_of.register(Survey)
def report(survey: Survey, date: str = "") -> Report:
    """Return the report of a survey."""
    return Report(
        f"Survey of {survey.name}",
        _sentence(survey),
        cards=tuple(_cards(survey)),
        sections=(
            _matrix(survey),
            Section(WORST, tables=(_worst(survey),)),
            _whose(survey),
            _changes(survey),
            _values(survey),
            Section(OUTLIERS, tables=(_outliers(survey),)),
            Section(LEFT_OUT, tables=tuple(_left_out(survey))),
        ),
        date=date,
    )


def _sentence(survey: Survey) -> str:
    if not survey.outcomes:
        return "Nothing was diagnosed"
    failed = sum(bool(outcome.failure) for outcome in survey.outcomes)
    gaps = sum(badness(outcome)[0] > 1 for outcome in survey.outcomes)
    units, joints = ({getattr(it, key) for it in survey.outcomes} for key in ("unit", "joint"))
    done = len(survey.outcomes) - failed
    whole = f"{gaps or 'None'} of {done} diagnosed show a gap, {plural(len(units), 'unit')}"
    ends = f"; {failed} failed" if failed else ""
    return f"{whole} with {plural(len(joints), 'joint')}{ends}"


def _cards(survey: Survey) -> Iterator[Card]:
    for worst in survey.worst[:1]:
        name = f"{worst.unit}, {worst.joint}"
        said = listed(_names(worst)) if causes(worst) else verdict(worst)
        yield Card("worst", f"{name}: {said}, {_gap(worst)}", section=WORST)
    shared = [words(it) for it in survey.belongings if it.owner in (MODEL, BATCH, UNIT)]
    if shared:
        more = [f"and {len(shared) - MOST_NAMES} more"] if len(shared) > MOST_NAMES else []
        yield Card("shared causes", "\n".join([*shared[:MOST_NAMES], *more]), section=WHOSE)
    kinds = Counter(it.kind for it in survey.differences)
    if survey.earlier:
        told = ", ".join(f"{kinds[kind]} {kind}" for kind in KINDS if kinds[kind])
        yield Card("since before", told or "nothing changed", section=CHANGES)
    failed = sum(bool(it.failure) for it in survey.outcomes)
    if failed or survey.notes:
        yield Card(
            LEFT_OUT.lower(), f"{failed} failed, {len(survey.notes)} left out", section=LEFT_OUT
        )


def _names(outcome: Outcome) -> list[str]:
    return [cause.effect for cause in causes(outcome)]


def _gap(outcome: Outcome) -> str:
    return f"{number(outcome.gap_before, 3)} noise floors"


def quantity(value: float, unit: str, error: float | None = None) -> Quantity:
    """Return a figure in SI as a person reads it."""
    shown = DISPLAY.get(unit, unit)
    scale = 1.0 if shown == unit else factor(unit, shown)
    return Quantity(scale * value, shown, None if error is None else scale * error)


def _mark(survey: Survey, outcome: Outcome, text: str = "") -> Mark:
    """A verdict with its gap, and the way to its page where there is one."""
    page = f"reports/{outcome.key}.html"
    there = survey.folder is not None and (survey.folder / page).exists()
    neither = outcome.verdict in (PARAMETERS, NOT_IDENTIFIABLE)
    passed = None if neither else outcome.verdict == NO_GAP
    gap = "" if outcome.failure else f" {number(outcome.gap_before, 2)}"
    return Mark(f"{verdict(outcome)}{gap}", passed, page if there else "")


def _matrix(survey: Survey) -> Section:
    """Verdicts by joint and unit, the worst unit first."""
    places = survey.by_place
    units = list(dict.fromkeys(outcome.unit for outcome in survey.worst))
    joints = list(dict.fromkeys(joint for _, joint in sorted(places, key=lambda it: it[1])))
    across = len(joints) > max(MOST_COLUMNS, len(units))
    if across:
        joints = list(dict.fromkeys(outcome.joint for outcome in survey.worst))
    rows, columns = (joints, sorted(units)) if across else (units, joints)
    shown = rows[:MOST_UNITS]

    def cell(row: str, column: str) -> Cell:
        found = places.get((column, row) if across else (row, column))
        return _mark(survey, found) if found else None

    more = len(rows) - len(shown)
    others = (
        f" The worst {len(shown)} of {len(rows)}: all are in the table of joints." if more else ""
    )
    table = Table(
        "",
        ("joint" if across else "unit", *columns),
        tuple((row, *(cell(row, column) for column in columns)) for row in shown),
    )
    lead = f"Each with the gap of its model [noise floors], the worst first.{others}"
    return Section(MATRIX, lead, tables=(table,))


def _worst(survey: Survey) -> Table:
    return Table(
        "",
        ("unit", "joint", "verdict", "causes", "probability", "left", "held out"),
        tuple(
            (
                it.unit,
                it.joint,
                _mark(survey, it),
                ", ".join(map(_cause, causes(it))),
                percent(causes(it)[0].probability) if causes(it) else "",
                Quantity(np.nan if it.gap_after is None else it.gap_after, digits=3),
                Quantity(np.nan if it.held_out is None else it.held_out, digits=3),
            )
            for it in survey.worst[:MOST_WORST]
            if badness(it)[0]
        ),
    )


def _cause(cause: Cause) -> str:
    return " ".join([cause.effect, *(str(_size(size)) for size in cause.sizes[:1])])


def _size(estimate: Estimate) -> Quantity:
    error = estimate.standard_error
    return quantity(estimate.value, estimate.unit, np.nan if error is None else error)


def words(it: Belonging) -> str:
    """Return whose a cause is, in a sentence."""
    joints = f" {listed(it.joints)}" if it.joints else ""
    units = f"on {len(it.units)} of {plural(it.asked, 'unit')}"
    unit = it.whose if it.whose.startswith("unit") else f"unit {it.whose}"
    of, on = {
        MODEL: (f"the model{' of' if joints else ''}{joints}", units),
        BATCH: (f"units of {it.whose}{',' if joints else ''}{joints}", units),
        UNIT: (unit, f"on {len(it.places)} of {plural(it.asked, 'joint')}"),
        SINGLE: (f"{unit},{joints}", ""),
    }[it.owner]
    return " ".join(filter(None, (f"{it.name} belongs to {of}:", _sizes(it), on)))


def _sizes(it: Belonging) -> str:
    if it.size is None:
        return "of no size that the logs tell"
    if it.alike:
        return str(quantity(it.size.mean, it.measure, it.size.spread))
    low, high = (quantity(size, it.measure) for size in (it.smallest, it.largest))
    return with_unit(f"{number(low.value, 3)} to {number(high.value, 3)}", low.unit)


def _whose(survey: Survey) -> Section:
    shared = [it for it in survey.belongings if it.owner != SINGLE]
    singles = [it for it in survey.belongings if it.owner == SINGLE]
    more = len(singles) - MOST_SINGLES
    rest = [f"{more} more of single joints: see the table of joints"] if more > 0 else []
    sets = Table(
        "What the logs leave open, of one and of all together",
        ("cause", "belongs to", "jobs", "explanations of one", "of all", "which"),
        tuple(
            (
                it.name,
                it.owner if it.owner == MODEL else f"{it.owner} {it.whose}",
                len(it.places),
                Quantity(it.single_set, digits=2),
                len(it.fleet_set),
                listed([" with ".join(names) or "nothing" for names in it.fleet_set], "or"),
            )
            for it in shared
        ),
        folded=True,
    )
    return Section(
        WHOSE,
        "To the model what most units have, to a batch or a unit what few others have. Behind the"
        " sign: the standard deviation between units with the error of the mean. A range: the"
        " sizes are not alike.",
        (*map(words, [*shared, *singles[:MOST_SINGLES]]), *rest),
        tables=(sets,),
    )


def _changes(survey: Survey) -> Section:
    ordered = sorted(survey.differences, key=lambda it: KINDS.index(it.kind))
    passed = {WORSE: False, BETTER: True}
    rows = ((Mark(it.kind, passed.get(it.kind)), it.unit, it.joint, it.why) for it in ordered)
    more = len(ordered) - MOST_CHANGES
    return Section(
        CHANGES,
        "Worse: it failed and did not; a gap, where there was none; a cause more; the interval of"
        " the gap is above the earlier one. Better is the reverse.",
        (f"{more} more of {len(ordered)}",) if more > 0 else (),
        tables=(Table("", ("change", "unit", "joint", "why"), tuple(rows)[:MOST_CHANGES]),),
    )


def _values(survey: Survey) -> Section:
    chosen = survey.variations[:MOST_SPLITS]
    more = len(survey.variations) - len(chosen)
    others = f" These {len(chosen)} of {len(survey.variations)} vary most." if more else ""
    drawn = [it for it in chosen if len(it.values) + len(it.episodes) > 1][:MOST_PICTURES]
    missing = (survey.no_splits,) if survey.no_splits else ()
    return Section(
        VALUES,
        "Means of the units that do not stand out, with the standard deviation between units."
        " Shares of the variance of single episodes: between units, between the episodes of one,"
        f" and what their standard errors explain.{others}",
        missing,
        tables=(
            Table(
                "",
                ("joint", "parameter", "nominal", "mean", "between", "units", *PARTS),
                tuple(_row(it, survey) for it in chosen),
            ),
        ),
        pictures=tuple(_picture(it, survey) for it in drawn),
    )


def _row(it: Variation, survey: Survey) -> tuple[Cell, ...]:
    split = survey.splits.get((it.joint, it.name))
    shares = map(percent, split.shares) if split else [""] * len(PARTS)
    return (
        it.joint,
        it.name,
        quantity(it.nominal, it.measure),
        quantity(it.common.mean, it.measure, it.common.error),
        quantity(it.common.between, it.measure) if it.common.count > 1 else None,
        it.common.count,
        *shares,
    )


def _picture(it: Variation, survey: Survey) -> Picture:
    """Values of a parameter, a row a unit: together, and each episode in the order of its name."""
    ordered = sorted(it.values, key=lambda value: value.estimate.value)
    middle = len(ordered) - MOST_DRAWN
    half = MOST_DRAWN // 2
    chosen = [*ordered[:half], *ordered[-half:]] if middle > 0 else ordered
    of_joint = (outcome for outcome in survey.earlier if outcome.joint == it.joint)
    before = {
        value.unit: value.estimate.value
        for value in values_of(of_joint)
        if value.estimate.name == it.name and value.episode is None
    }
    scale, unit = (quantity(1.0, it.measure).value, quantity(1.0, it.measure).unit)

    def draw(panels: Sequence[Axes]) -> None:
        (axes,) = panels
        low, high = (it.common.mean + side * 2.0 * it.common.spread for side in (-1.0, 1.0))
        axes.axvspan(scale * low, scale * high, color=colour("grid"), alpha=0.6, lw=0, zorder=0)
        axes.axvline(scale * it.nominal, color=colour("orange"), ls=DASHED, lw=1.1)
        for row, value in enumerate(chosen):
            mine = [one for one in it.episodes if one.unit == value.unit]
            mine.sort(key=lambda one: one.episode or "")
            _draw_value(axes, value, -row, scale, "blue", 2.2)
            for place, one in enumerate(mine, 1):
                _draw_value(axes, one, -row - 0.6 * place / (len(mine) + 1), scale, "muted", 0.8)
            if value.unit in before:
                axes.plot(scale * before[value.unit], -row, "D", color=colour("orange"), mfc="none")
            draw_label(axes, 0.08 - row, value.unit)
        axes.set(xlabel=f"{it.name} [{unit}]", ylim=(-len(chosen) + 0.2, 0.5), yticks=[])
        axes.spines["left"].set_visible(False)

    fewer = f" The lowest and highest {half} of {len(ordered)}." if middle > 0 else ""
    old = " Diamond: before." if before else ""
    return Picture(
        f"{it.joint}, {it.name}",
        draw,
        "Blue: a unit, of all its logs, with an interval of 95 %. Grey, below it: its episodes, in"
        f" the order of their names. Band: mean and two standard deviations. Dashed: nominal.{old}"
        f"{fewer}",
        height=0.7 + ROW * len(chosen),
    )


def _draw_value(
    axes: Axes, value: Value, row: float, scale: float, tint: str, width: float
) -> None:
    known = told(value.estimate)
    if known:
        axes.errorbar(
            scale * known.value,
            row,
            xerr=scale * NORMAL_95 * known.error,
            fmt="o",
            ms=2.0 + width,
            lw=width,
            color=colour(tint),
        )


def _outliers(survey: Survey) -> Table:
    rows = (
        (
            value.unit,
            it.joint,
            it.name,
            _size(value.estimate),
            quantity(it.common.mean, it.measure, it.common.spread),
        )
        for it in survey.variations
        for value in it.outliers
    )
    columns = ("unit", "joint", "parameter", "value", "of the others")
    return Table("", columns, tuple(islice(rows, MOST_OUTLIERS)))


def _left_out(survey: Survey) -> Iterator[Table]:
    failed = [(it.failure, f"{it.unit}, {it.joint}") for it in survey.outcomes if it.failure]
    notes = [(note, (re.findall("'([^']*)'", note) or [note])[0]) for note in survey.notes]
    for title, told_ in (("Failed", failed), ("Left out", notes)):
        rows = [
            (reason, len(names), "; ".join(names[:MOST_NAMES])) for reason, names in grouped(told_)
        ]
        yield Table(title, ("why", "times", "such as"), tuple(rows))


def grouped(reasons: Iterable[tuple[str, str]]) -> list[tuple[str, list[str]]]:
    """Return reasons that differ in names and numbers alone, as the first of each is told, with
    the names that have it; the most frequent first."""
    found: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for reason, name in reasons:
        found[SPECIFIC.sub("", reason)].append((reason, name))
    often = sorted(found.values(), key=len, reverse=True)
    return [(every[0][0], [name for _, name in every]) for every in often]


class JobEntry(Document, frozen=True):
    """A joint of a unit; its diagnosis is in ``jobs/KEY.json``. Gaps are in noise floors."""

    key: str
    unit: str
    joint: str
    conditions: dict[str, str]
    verdict: str
    causes: list[str]
    gap_before: Figure
    gap_after: Figure
    held_out: Figure
    failure: str


class SizeEntry(Document, frozen=True):
    """A mean [SI], its standard error, and the standard deviation between units."""

    mean: float
    error: float
    between: float
    count: int


class CauseEntry(Document, frozen=True):
    """A cause, and whom it belongs to; no joints are all."""

    name: str
    owner: Annotated[str, choice(MODEL, BATCH, UNIT, SINGLE)]
    whose: str
    joints: Sequence[str]
    places: Sequence[tuple[str, str]]
    asked: int
    size: SizeEntry | None
    alike: bool
    measure: str
    single_set: Annotated[float, about("Explanations in the set of a job, mean.")]
    fleet_set: Annotated[Sequence[Sequence[str]], about("Those of all jobs together.")]
    sentence: str


class VarianceEntry(Document, frozen=True):
    """Variances [SI squared] of the values of single episodes."""

    unit: float
    episode: float
    rest: float


class ParameterEntry(Document, frozen=True):
    """A parameter of a joint over the units [SI]."""

    joint: str
    name: str
    measure: str
    nominal: float
    common: SizeEntry
    outliers: list[str]
    variance: Annotated[VarianceEntry | None, about("Of the parameters that vary most.")]


class ChangeEntry(Document, frozen=True):
    unit: str
    joint: str
    kind: Annotated[str, choice(*KINDS)]
    why: str


class SurveyDocument(Document, frozen=True):
    """What was found of many joints, episodes and units."""

    title = "servo-models survey"

    name: str
    sentence: str
    jobs: list[JobEntry]
    causes: list[CauseEntry]
    parameters: list[ParameterEntry]
    changes: list[ChangeEntry]
    left_out: Sequence[str]


@document_of.register(Survey)
def document(survey: Survey) -> SurveyDocument:
    """Return a survey as what JSON is made of."""
    return SurveyDocument(
        survey.name,
        _sentence(survey),
        [JobEntry.made_from(it, verdict=verdict(it), causes=_names(it)) for it in survey.outcomes],
        [
            CauseEntry.made_from(
                it, size=it.size and SizeEntry.made_from(it.size), sentence=words(it)
            )
            for it in survey.belongings
        ],
        [
            ParameterEntry.made_from(
                it,
                common=SizeEntry.made_from(it.common),
                outliers=[value.unit for value in it.outliers],
                variance=split and VarianceEntry.made_from(split),
            )
            for it in survey.variations
            for split in (survey.splits.get((it.joint, it.name)),)
        ],
        [ChangeEntry.made_from(it) for it in survey.differences],
        survey.notes,
    )
