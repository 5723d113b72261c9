"""A withheld check as people and programs read it, its figures beside the bars set for them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Annotated, Any, ClassVar

from msgspec import Meta, Struct, defstruct

from servo_models.report.document import Digest, Document, about, choice, constant
from servo_models.report.numbers import Quantity
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Card, Cell, Mark, Section, Table
from servo_models.withheld.generator.cases import KINDS, TIERS
from servo_models.withheld.oracle import Diagnosed, Known
from servo_models.withheld.run import Check
from servo_models.withheld.score import (
    FIGURES,
    Bin,
    Case,
    Cases,
    Statistic,
    calibration,
    confusion,
    good,
)

VERSION = 1  # of the schema: it counts up when a reader of the one before would go wrong
MOST_WANTED = 300  # cases behind a figure from which it can stand beside its bar
SHOWN = 12  # confusions on the terminal

AT_LEAST, AT_MOST = ">=", "<="
Bar = tuple[str, float]
RICH: dict[str, Bar] = {
    "both_named": (AT_LEAST, 0.80),
    "false_causes": (AT_MOST, 0.03),
    "foreign_recall": (AT_LEAST, 0.85),
    "wrong_abstention": (AT_MOST, 0.05),
    "closed_vs_oracle": (AT_LEAST, 0.97),
}
TRUE_TO_WORD: dict[str, Bar] = {
    "calibration_error": (AT_MOST, 0.015),
    "sure_ones_right": (AT_LEAST, 0.90),
    "told_surely": (AT_LEAST, 0.40),
}
QUICK: dict[str, Bar] = {"seconds_per_case": (AT_MOST, 3.0)}
BARS: dict[str, dict[str, Bar]] = {
    "easy": {
        "first_place": (AT_LEAST, 0.95),
        "not_identifiable": (AT_MOST, 0.05),
        "left_out_recall": (AT_LEAST, 0.88),
        **RICH,
        **TRUE_TO_WORD,
        **QUICK,
    },
    "hard": {
        "first_place": (AT_LEAST, 0.85),
        "set_holds": (AT_LEAST, 0.95),
        "set_coverage": (AT_LEAST, 0.95),
        "mean_set_size": (AT_MOST, 2.7),
        "left_out_recall": (AT_LEAST, 0.75),
        **RICH,
        **TRUE_TO_WORD,
        **QUICK,
    },
    "poor": {"owns_up": (AT_LEAST, 0.90), **TRUE_TO_WORD, **QUICK},
    "rough": {**TRUE_TO_WORD, **QUICK},
}
COLUMNS = ("figure", "value (95 %)", "cases", "bar", "")


def met(figure: Statistic, bar: Bar) -> bool | None:
    """Return whether a figure meets a bar; None without cases."""
    if figure.value is None:
        return None
    way, limit = bar
    return figure.value >= limit if way == AT_LEAST else figure.value <= limit


def standing(figure: Statistic, bar: Bar, wanted: int = MOST_WANTED) -> str:
    """Return in words where a figure stands against its bar, "so far" while too few cases do."""
    said = "met" if met(figure, bar) else "missed"
    return said if figure.n >= wanted else f"{said} so far"


def figure_rows(
    figures: Iterable[Callable[[Any], Statistic]],
    bars: Mapping[str, Bar],
    cases: Any,
    wanted: int = MOST_WANTED,
) -> Iterator[tuple[Cell, ...]]:
    """Yield a row of ``COLUMNS`` for each figure that has cases."""
    for define in figures:
        figure, bar = define(cases), bars.get(define.__name__)
        if figure.n:
            beside: tuple[Cell, Cell] = ("", "")
            if bar:
                said = standing(figure, bar, wanted)
                beside = (f"{bar[0]} {bar[1]:g}", Mark(said, met(figure, bar)))
            yield (define.__name__, quantity(figure), figure.n, *beside)


def by_tier(check: Check) -> dict[str, Cases]:
    """Return the cases of each tier that has some."""
    found = {tier: [it for it in check.cases if it.tier == tier] for tier in check.tiers}
    return {tier: cases for tier, cases in found.items() if cases}


@report_of.register(Check)
def report(check: Check, date: str = "") -> Report:
    """Return the figures of every tier, what was mistaken for what, and the calibration."""
    tiers = by_tier(check)
    counts = {tier: _bars_met(tier, cases) for tier, cases in tiers.items()}
    failed = [case.said for case in check.cases if case.said.why]
    return Report(
        f"withheld check, seed {check.seed}",
        f"{len(check.cases)} cases; " + "; ".join(f"{t}: {text}" for t, text in counts.items()),
        cards=tuple(Card(tier, text, section=_title(tier)) for tier, text in counts.items()),
        remarks=(
            "A case counts for first_place, both_named and recall where the noise-free log"
            " separates the truth from its best rival. Fewer than"
            f" {MOST_WANTED} cases leave a figure open.",
            *(f"Case {said.case} failed: {said.why}" for said in failed),
        ),
        sections=(
            *(_tier_section(tier, cases) for tier, cases in tiers.items()),
            _calibration(check.cases),
        ),
        date=date,
    )


def _title(tier: str) -> str:
    return f"Tier {tier}"


def _bars_met(tier: str, cases: Cases) -> str:
    bars = BARS[tier]
    found = [
        met(define(cases), bars[define.__name__]) for define in FIGURES if define.__name__ in bars
    ]
    judged = [one for one in found if one is not None]
    return f"{sum(judged)} of {len(judged)} bars met"


def _tier_section(tier: str, cases: Cases) -> Section:
    columns = ("truth", "said", "cases")
    rows = tuple(figure_rows(FIGURES, BARS[tier], cases))
    mistaken = Table(f"{tier}: most frequent confusions", columns, _mistaken(cases))
    figures = Table(f"{tier}, {len(cases)} cases", COLUMNS, rows)
    return Section(_title(tier), tables=(figures, mistaken))


def quantity(figure: Statistic) -> Quantity:
    """Return a figure with its interval; it has cases."""
    assert figure.value is not None
    assert figure.low is not None
    assert figure.high is not None
    return Quantity(figure.value, interval=(figure.low, figure.high), digits=3)


def _mistaken(cases: Cases) -> tuple[tuple[Cell, ...], ...]:
    """Truths and other answers, the most frequent first."""
    wrong = [case for case in cases if not good(case)]
    found = [
        (truth, answer, count)
        for truth, answers in confusion(wrong).items()
        for answer, count in answers.items()
    ]
    return tuple(sorted(found, key=lambda one: -one[2])[:SHOWN])


def _calibration(cases: Cases) -> Section:
    rows = tuple(
        (f"{one.low:g} to {one.high:g}", one.probability, quantity(one.right), one.right.n)
        for one in calibration(cases)
    )
    columns = ("probability", "mean", "effect is there (95 %)", "cases")
    return Section("Calibration, all tiers", tables=(Table("", columns, rows),), folded=True)


# the document


class Standing(Document, frozen=True):
    """What was set for a figure; met is null without cases."""

    bar: Annotated[str, Meta(pattern="^[<>]= [0-9.]+$")]
    met: bool | None


Count = Annotated[int, Meta(ge=1)]
Confusion = Annotated[
    dict[str, dict[str, Count]], about("Cases by truth and answer, effects joined by ' + '.")
]
PARTS = [("bars", dict[str, Standing]), ("confusion", Confusion), ("calibration", list[Bin])]
KEYS = [("n", Count), *((define.__name__, Statistic) for define in FIGURES), *PARTS]
Tier = defstruct("Tier", KEYS, bases=(Document,))
TierName = Annotated[str, choice(*TIERS)]


class JudgedCase(Document, frozen=True):
    """``said`` is by the diagnosis; ``oracle``, null where nothing is wrong, could have been."""

    case: str
    tier: TierName
    actuator: str
    kind: Annotated[str, choice(*KINDS)]
    truth: list[str]
    hidden: list[str]
    right: bool
    covered: bool
    said: Diagnosed
    oracle: Known | None


class CheckDocument(Document, frozen=True):
    """Every figure is defined by the docstring of its function in servo_models/withheld/score.py;
    separated and absorbed in servo_models/withheld/oracle.py. Errors are RMS in noise floors. null
    is a figure that does not exist."""

    title: ClassVar[str] = f"servo-models blind --json, schema_version {VERSION}"

    schema_version: Annotated[int, constant(VERSION)]
    seed: Annotated[int, Meta(ge=0)]
    n: Annotated[Count, about("Cases of all tiers.")]
    seal: Annotated[
        Digest, about("SHA-256 of answers.json, printed before anything was diagnosed.")
    ]
    versions: dict[str, str]
    tiers: Annotated[dict[TierName, Tier], Meta(min_length=1)]  # type: ignore[valid-type]
    cases: Annotated[list[JudgedCase], Meta(min_length=1)]


@document_of.register(Check)
def document(check: Check) -> CheckDocument:
    """Return a check as what JSON is made of."""
    return CheckDocument.made_from(
        check,
        schema_version=VERSION,
        n=len(check.cases),
        tiers={tier: _tier(tier, cases) for tier, cases in by_tier(check).items()},
        cases=[_case(case) for case in check.cases],
    )


def _tier(tier: str, cases: Cases) -> Struct:
    figures = {define.__name__: define(cases) for define in FIGURES}
    bars = {
        n: Standing(f"{way} {limit}", met(figures[n], (way, limit)))
        for n, (way, limit) in BARS[tier].items()
    }
    return Tier(len(cases), *figures.values(), bars, confusion(cases), calibration(cases))


def _case(case: Case) -> JudgedCase:
    return JudgedCase.made_from(
        case,
        case=case.said.case,
        truth=sorted(case.truth),
        hidden=sorted(case.hidden),
        oracle=case.known,
    )
