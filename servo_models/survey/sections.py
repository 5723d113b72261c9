"""A survey as people read it: the worst first, whose causes they are, what varies and changed."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from servo_models.diagnosis.verdict import NO_GAP, NOT_IDENTIFIABLE, OUTSIDE, PARAMETERS
from servo_models.errors import UserError
from servo_models.identification.doubts import is_stated
from servo_models.report.curves import DASHED, draw_label
from servo_models.report.document import Document
from servo_models.report.numbers import Quantity, listed, number, percent, plural, with_unit
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Card, Cell, Mark, Picture, Section, Table
from servo_models.report.style import colour
from servo_models.survey.belonging import MODEL, SINGLE, UNIT, Belonging, Place
from servo_models.survey.job import FAILED, Estimate, Outcome
from servo_models.survey.result import (
    BETTER,
    MOST_SPLITS,
    WORSE,
    Difference,
    Survey,
    Value,
    Variation,
    told_arrays,
    values_of,
)
from servo_models.survey.variation import Split
from servo_models.units import factor

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DISPLAY = {"s": "ms", "rad": "deg", "m": "mm", "m/s": "mm/s"}
"""Units in which people read what is in SI."""
MOST_UNITS = 200  # rows of the matrix,
OPEN_UNITS = 20  # of which so many are not behind a click
MOST_WORST = 10  # rows
MOST_ITEMS = 20  # sentences or rows of a kind
MOST_PICTURES = 4
MOST_DRAWN = 12  # units of a picture
MOST_NAMES = 3  # examples of a reason
ALIKE_SHARE = 0.5  # variation of sizes over their mean, up to which they are alike
NORMAL_95 = 1.96  # standard errors of an interval of 95 %
ROW = 0.42  # height of a unit in a picture [inch]
WORST, WHOSE, LEFT_OUT = "The worst", "Whom causes belong to", "Failed, and notes"
SPECIFIC = re.compile(r"'([^']*)'|0x[0-9a-f]+|\d+(?:\.\d+)?")
"""What differs between reports of one reason."""
MEANS = "Means of the units that do not stand out, with the standard deviation between units."
NOBODYS = "the diagnosis was stopped, or the cause is outside the catalogue"
STOPPED = " Stopped: its search ended early, and a longer one may say something else."
LEFT = "Left: errors of the diagnosed model [noise floors]. Held out: on logs that no fit has seen."
SHARES = ("unit share", "episode share", "rest")
SPLIT = (
    " Shares of the variance of single episodes: between units, between the episodes of one, and"
    " what their standard errors explain."
)


@report_of.register(Survey)
def report(survey: Survey, date: str = "") -> Report:
    """Return the report of a survey."""
    return Report(
        f"Survey of {survey.name}",
        _sentence(survey),
        cards=tuple(_cards(survey)),
        sections=(
            _matrix(survey),
            Section(WORST, LEFT, tables=(_worst(survey),)),
            _whose(survey),
            _changes(survey),
            _values(survey),
            Section(LEFT_OUT, tables=tuple(_left_out(survey))),
        ),
        date=date,
    )


def _sentence(survey: Survey) -> str:
    units, joints = (len({*names}) for names in zip(*survey.by_place))
    counts = Counter(outcome.said for outcome in survey.outcomes)
    told = {NO_GAP: "without a gap", PARAMETERS: "explained by parameters", FAILED: "failed"}
    others = len(survey.outcomes) - sum(counts[kind] for kind in told)
    parts = [f"{others} of {len(survey.outcomes)} lack something" if others else ""]
    parts += [f"{counts[kind]} {words}" for kind, words in told.items() if counts[kind]]
    size = f"{plural(units, 'unit')} with {plural(joints, 'joint')}"
    stopped = sum(bool(outcome.stopped) for outcome in survey.outcomes)
    parts += [f"{stopped} stopped early"] if stopped else []
    return f"{size}: {', '.join(filter(None, parts))}"


def _cards(survey: Survey) -> Iterator[Card]:
    worst = survey.worst[0]
    if worst.badness[0] > 1:
        said = _causes(worst) or worst.said
        gap = f"{number(worst.gap_before, 3)} noise floors"
        yield Card("worst", f"{worst.unit}, {worst.joint}: {said}; {gap}", section=WORST)
    shared = [it for it in survey.belongings if it.owner != SINGLE]
    if shared:
        lines = [*map(words, shared[:MOST_NAMES]), *_more(shared, MOST_NAMES)]
        yield Card("shared causes", "\n".join(lines), section=WHOSE)


def quantity(value: float, unit: str, error: float | None = None) -> Quantity:
    """Return a figure in SI as a person reads it."""
    shown = DISPLAY.get(unit, unit)
    scale = 1.0 if shown == unit else factor(unit, shown)
    return Quantity(scale * value, shown, None if error is None else scale * error)


def _size(estimate: Estimate) -> Quantity:
    error = estimate.standard_error
    return quantity(estimate.value, estimate.unit, np.nan if error is None else error)


def _mark(survey: Survey, outcome: Outcome) -> Mark:
    """A verdict with its gap, and the way to its page where there is one."""
    page = f"reports/{outcome.key}.html"
    neither = outcome.verdict in (PARAMETERS, NOT_IDENTIFIABLE)
    gap = "" if outcome.failure else f" {number(outcome.gap_before, 2)}"
    return Mark(
        f"{outcome.said}{gap}{', stopped' * bool(outcome.stopped)}",
        None if neither else outcome.verdict == NO_GAP,
        page if (survey.folder / page).exists() else "",
    )


def _matrix(survey: Survey) -> Section:
    """Verdicts by joint and unit, the worst first."""
    units, joints = (
        [*dict.fromkeys(getattr(it, key) for it in survey.outcomes)] for key in ("unit", "joint")
    )
    turned = len(joints) > len(units)  # a page is longer than wide
    columns = units if turned else joints
    rows = [*dict.fromkeys(it.joint if turned else it.unit for it in survey.worst)]

    def cell(row: str, column: str) -> Cell:
        found = survey.by_place.get((column, row) if turned else (row, column))
        return _mark(survey, found) if found else None

    shown = tuple((row, *(cell(row, it) for it in columns)) for row in rows[:MOST_UNITS])
    cut = (
        f"{len(shown)} of {len(rows)}, all are in the table" if len(rows) > len(shown) else "first"
    )
    headings = ("joint" if turned else "unit", *columns)
    others = shown[OPEN_UNITS:]
    return Section(
        "Verdicts",
        "Each with the gap of its model [noise floors]."
        f"{STOPPED * any(it.stopped for it in survey.outcomes)} The worst {cut}.",
        tables=(
            Table("", headings, shown[:OPEN_UNITS]),
            Table(f"The next {len(others)}", headings, others, folded=True),
        ),
    )


def _worst(survey: Survey) -> Table:
    rows = [
        (
            *(it.unit, it.joint, _mark(survey, it)),
            it.failure or _causes(it),
            percent(it.taken[0].probability) if it.taken else "",
            *(it.gap_after, it.held_out),
        )
        for it in survey.worst[:MOST_WORST]
        if it.badness[0]
    ]
    columns = ("unit", "joint", "verdict", "why", "probability", "left", "held out")
    return Table("", columns, tuple(rows))


def _causes(it: Outcome) -> str:
    """Its effects with their sizes; what is nearest to an unknown cause is told as that."""
    every = (" ".join([one.effect, *map(_known, one.sizes[:1])]) for one in it.taken)
    return "nearest: " * (it.verdict == OUTSIDE and bool(it.taken)) + ", ".join(every)


def _known(size: Estimate) -> str:
    known = size.standard_error is not None and is_stated(size.value, size.standard_error)
    return str(_size(size)) if known else "of unknown size"


def words(it: Belonging) -> str:
    """Return whose a cause is, in a sentence."""
    unit = it.whose if it.whose.startswith("unit") else f"unit {it.whose}"
    of = "the model" if it.owner == MODEL else f"units of {it.whose}"
    of = unit if it.owner in (UNIT, SINGLE) else of
    joints = f", {listed(it.joints)}" if it.joints else ""
    count = len({place[it.owner == UNIT] for place in it.places})
    what = plural(it.asked, "joint" if it.owner == UNIT else "unit")
    on = "" if it.owner == SINGLE else f" on {count} of {what}"
    return f"{it.name} belongs to {of}{joints}: {_sizes(it)}{on}"


def _sizes(it: Belonging) -> str:
    size, low, high = it.size, it.smallest, it.largest
    if size is None or low is None or high is None:
        return "of no common size" if len(it.places) > 1 else "of no size that the logs tell"
    if size.between <= ALIKE_SHARE * abs(size.mean):
        return str(quantity(size.mean, it.measure, size.spread))
    limits = [quantity(limit, it.measure) for limit in (low, high)]
    return with_unit(" to ".join(number(it.value, 3) for it in limits), limits[0].unit)


def _whose(survey: Survey) -> Section:
    shared = [it for it in survey.belongings if it.owner != SINGLE]
    singles = [it for it in survey.belongings if it.owner == SINGLE]
    chosen = [*shared[:MOST_ITEMS], *singles[:MOST_ITEMS]]
    rows = (
        (
            *(it.name, it.whose or it.owner, len(it.places), Quantity(it.single_set, digits=2)),
            *(len(it.fleet_set), listed([" with ".join(e) or "none" for e in it.fleet_set], "or")),
        )
        for it in shared[:MOST_ITEMS]
    )
    columns = ("cause", "of", "jobs", "explanations of one", "of all", "which")
    unsure = sum(not (it.failure or it.conclusive) for it in survey.outcomes)
    said = [f"{plural(unsure, 'joint')} left out: {NOBODYS}"] if unsure else []
    return Section(
        WHOSE,
        "Most units have what belongs to the model; most of a batch or of a unit's joints, and few"
        " others, what belongs to these. Behind a size: its standard deviation between units,"
        " with the error of the mean; a range where sizes are not alike.",
        (*map(words, chosen), *_more([*shared, *singles], len(chosen)), *said),
        tables=(Table("What logs leave open, alone and together", columns, tuple(rows), True),),
    )


def _more(every: Sequence[object], shown: int) -> list[str]:
    return [f"and {len(every) - shown} more"] if len(every) > shown else []


def _changes(survey: Survey) -> Section:
    passed = {WORSE: False, BETTER: True}
    kinds = Counter(it.kind for it in survey.differences)
    told = ", ".join(f"{count} {kind}" for kind, count in kinds.items()) or "nothing changed"
    rows = (
        (Mark(it.kind, passed.get(it.kind)), it.unit, it.joint, it.why)
        for it in survey.differences[:MOST_ITEMS]
    )
    return Section(
        "Since before",
        "Worse: it failed and did not; a gap, where there was none; the interval of the gap is"
        " above the earlier one; a cause more. Better is the reverse. The first of these decides.",
        (told, *_more(survey.differences, MOST_ITEMS)) if survey.earlier else (),
        tables=(Table("", ("change", "unit", "joint", "why"), tuple(rows)),),
    )


def _values(survey: Survey) -> Section:
    chosen = survey.variations[:MOST_SPLITS]
    far = [it for it in survey.variations if it.outliers]
    splits: dict[Place, Split | None] = {}
    missing, rows = [], []
    try:
        splits = survey.splits
    except UserError as error:
        missing = [str(error)]
    headings = SHARES if any(splits.values()) else ()
    several = any(it.common.count > 1 for it in chosen)
    for it in chosen:
        parts = splits.get((it.joint, it.name))
        shares = map(percent, parts.shares) if parts else [""] * len(headings)
        mean = it.common
        between = quantity(mean.between, it.measure) if mean.count > 1 else None
        rows.append(
            (
                *(it.joint, it.name, quantity(it.nominal, it.measure)),
                quantity(mean.mean, it.measure, mean.error),
                *((between, mean.count) if several else ()),
                *shares,
            )
        )
    units = ("between", "units") if several else ()
    columns = ("joint", "parameter", "nominal", "mean", *units, *headings)
    every = len(survey.variations)
    most = f" The {len(chosen)} of {every} that vary most." if every > len(chosen) else ""
    return Section(
        "Parameters",
        f"{MEANS * several}{SPLIT * bool(headings)}{most}",
        (*missing, *map(_outliers, far[:MOST_ITEMS]), *_more(far, MOST_ITEMS)),
        tables=(Table("", columns, tuple(rows)),),
        pictures=tuple(_picture(survey, it) for it in chosen[:MOST_PICTURES]),
    )


def _outliers(it: Variation) -> str:
    others = quantity(it.common.mean, it.measure, it.common.spread)
    units = [f"{unit} ({quantity(value, it.measure)})" for unit, value in it.outliers.items()]
    told = ", ".join([*units[:MOST_NAMES], *_more(units, MOST_NAMES)])
    return f"{it.name} of {it.joint} stands out on {told}; the others have {others}"


def _picture(survey: Survey, it: Variation) -> Picture:
    """Values of a parameter, a row a unit: together, and each episode in the order of its name."""
    values = survey.values[it.joint, it.name]
    ordered = sorted(
        (value for value in values if value.episode is None), key=lambda it: it.estimate.value
    )
    half = MOST_DRAWN // 2
    many = len(ordered) > MOST_DRAWN
    chosen = [*ordered[:half], *ordered[-half:]] if many else ordered
    of_joint = (outcome for outcome in survey.earlier if outcome.joint == it.joint)
    before = {
        value.unit: value.estimate.value
        for value in values_of(of_joint)
        if value.estimate.name == it.name and value.episode is None
    }
    scale, unit = quantity(1.0, it.measure).value, quantity(1.0, it.measure).unit

    def draw(panels: Sequence[Axes]) -> None:
        (axes,) = panels

        def interval(value: Value, row: float, tint: str, width: float) -> None:
            mean, error = scale * told_arrays([value])[:, 0]
            reach = NORMAL_95 * error
            size = 2.0 + width
            axes.errorbar(mean, row, xerr=reach, fmt="o", ms=size, lw=width, color=colour(tint))

        low, high = (it.common.mean + side * 2.0 * it.common.spread for side in (-1.0, 1.0))
        axes.axvspan(scale * low, scale * high, color=colour("grid"), alpha=0.6, lw=0, zorder=0)
        axes.axvline(scale * it.nominal, color=colour("orange"), ls=DASHED, lw=1.1)
        for row, value in enumerate(chosen):
            mine = [one for one in values if one.unit == value.unit and one.episode is not None]
            mine.sort(key=lambda one: one.episode or "")
            interval(value, -row, "blue", 2.2)
            for place, one in enumerate(mine, 1):
                interval(one, -row - 0.6 * place / (len(mine) + 1), "muted", 0.8)
            if value.unit in before:
                axes.plot(scale * before[value.unit], -row, "D", color=colour("orange"), mfc="none")
            draw_label(axes, 0.08 - row, value.unit)
        axes.set(xlabel=f"{it.name} [{unit}]", ylim=(0.2 - len(chosen), 0.5), yticks=[])
        axes.spines["left"].set_visible(False)

    return Picture(
        f"{it.joint}, {it.name}",
        draw,
        "Blue: a unit, of all its logs, with an interval of 95 %. Grey, below it: its episodes, in"
        " the order of their names. Band: mean and two standard deviations. Dashed: nominal."
        f"{' Diamond: before.' * bool(before)}"
        f"{f' The lowest and highest {half} of {len(ordered)} units.' * many}",
        height=0.7 + ROW * len(chosen),
    )


def _left_out(survey: Survey) -> Iterator[Table]:
    failed = [(it.failure, f"{it.unit}, {it.joint}") for it in survey.outcomes if it.failure]
    quoted = [(note, re.search("'([^']+)'", note)) for note in survey.notes]
    notes = [(note, found[1] if found else "") for note, found in quoted]
    for title, reasons in (("Failed", failed), ("Notes", notes)):
        every = grouped(reasons)
        rows = [
            (why, len(it), "; ".join(name for name in it[:MOST_NAMES] if name not in why))
            for why, it in every[:MOST_ITEMS]
        ]
        more = [(text, None, "") for text in _more(every, MOST_ITEMS)]
        yield Table(title, ("why", "times", "such as"), (*rows, *more))


def grouped(reasons: Iterable[tuple[str, str]]) -> list[tuple[str, list[str]]]:
    """Return reasons that differ in names and numbers alone, as the first of each is told, with
    the names that have it; the most frequent first."""
    found: dict[str, list[tuple[str, str]]] = defaultdict(list)
    for reason, name in reasons:
        found[SPECIFIC.sub("", reason)].append((reason, name))
    often = sorted(found.values(), key=len, reverse=True)
    return [(every[0][0], [name for _, name in every]) for every in often]


class SurveyDocument(Document, frozen=True):
    """What was found of many joints, episodes and units; the tables beside it have each job."""

    title = "servo-models survey"

    name: str
    sentence: str
    verdicts: dict[str, int]
    causes: list[Belonging]
    parameters: list[Variation]
    changes: list[Difference]
    left_out: Sequence[str]


@document_of.register(Survey)
def document(survey: Survey) -> SurveyDocument:
    """Return what a survey says together as what JSON is made of."""
    return SurveyDocument(
        survey.name,
        _sentence(survey),
        Counter(outcome.said for outcome in survey.outcomes),
        survey.belongings,
        survey.variations,
        survey.differences,
        survey.notes,
    )
