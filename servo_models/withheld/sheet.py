"""A withheld check on the terminal and as JSON, its figures beside the bars set for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

from servo_models.diagnosis.verdict import OUTSIDE
from servo_models.report.sheets import Sheet, Table
from servo_models.withheld.interval import Figure
from servo_models.withheld.run import Check
from servo_models.withheld.score import FIGURES, Case, Cases, calibration, confusion, false_causes

VERSION = 1
"""Of the schema: it counts up when a reader of the one before would go wrong."""
MOST_WANTED = 300
"""Cases behind a figure from which it can stand beside its bar."""
SHOWN = 12
"""Confusions on the terminal."""

AT_LEAST, AT_MOST = ">=", "<="
Bar = tuple[str, float]
RICH: dict[str, Bar] = {
    "both_named": (AT_LEAST, 0.80),
    "false_causes": (AT_MOST, 0.03),
    "foreign_recall": (AT_LEAST, 0.85),
    "left_out_recall": (AT_LEAST, 0.85),
    "wrong_abstention": (AT_MOST, 0.05),
    "closed_vs_oracle": (AT_LEAST, 0.97),
}
QUICK: dict[str, Bar] = {"seconds_per_case": (AT_MOST, 3.0)}
BARS: dict[str, dict[str, Bar]] = {
    "easy": {"first_place": (AT_LEAST, 0.95), "not_identifiable": (AT_MOST, 0.05), **RICH, **QUICK},
    "hard": {
        "first_place": (AT_LEAST, 0.85),
        "set_holds": (AT_LEAST, 0.95),
        "set_coverage": (AT_LEAST, 0.95),
        "mean_set_size": (AT_MOST, 2.5),
        **RICH,
        **QUICK,
    },
    "poor": {"owns_up": (AT_LEAST, 0.90), **QUICK},
}
COLUMNS = ("figure", "value", "95 %", "cases", "bar", "")


def met(figure: Figure, bar: Bar) -> bool | None:
    """Return whether a figure meets a bar; None without cases."""
    if figure.value is None:
        return None
    way, limit = bar
    return figure.value >= limit if way == AT_LEAST else figure.value <= limit


def standing(figure: Figure, bar: Bar) -> str:
    """Return in words where a figure stands against its bar, "so far" while too few cases do."""
    said = "met" if met(figure, bar) else "missed"
    return said if figure.n >= MOST_WANTED else f"{said} so far"


def by_tier(check: Check) -> dict[str, Cases]:
    """Return the cases of each tier that has some."""
    found = {tier: [it for it in check.cases if it.tier == tier] for tier in check.tiers}
    return {tier: cases for tier, cases in found.items() if cases}


def check_sheet(check: Check) -> Sheet:
    """Return the figures of every tier, what was mistaken for what, and the calibration."""
    failed = [case.said for case in check.cases if case.said.why]
    texts = [
        "A case counts for first_place, both_named and recall where the noise-free log separates"
        f" the truth from its best rival.  Fewer than {MOST_WANTED} cases leave a figure open.",
        *(f"Case {said.case} failed: {said.why}" for said in failed),
    ]
    tables = []
    for tier, cases in by_tier(check).items():
        wrong = tuple(_mistaken(cases))
        tables.append(Table(f"{tier}, {len(cases)} cases", COLUMNS, tuple(_rows(tier, cases))))
        if wrong:
            title = f"{tier}: most frequent confusions"
            tables.append(Table(title, ("truth", "said", "cases"), wrong))
    curve = tuple(_curve(check.cases))
    if curve:
        title = "Calibration, all tiers"
        tables.append(Table(title, ("probability", "mean", "there", "95 %", "cases"), curve))
    return Sheet(f"Withheld check, seed {check.seed}", tuple(texts), tuple(tables))


def _rows(tier: str, cases: Cases) -> Iterator[tuple[str, ...]]:
    for define in FIGURES:
        figure, bar = define(cases), BARS[tier].get(define.__name__)
        if figure.value is None:
            continue
        beside = ("", "")
        if bar:
            beside = (f"{bar[0]} {bar[1]:g}", standing(figure, bar))
        yield (define.__name__, f"{figure.value:.3g}", _interval(figure), str(figure.n), *beside)


def _interval(figure: Figure) -> str:
    return f"{figure.low:.3g}..{figure.high:.3g}"


def _mistaken(cases: Cases) -> Iterator[tuple[str, ...]]:
    """Truths and other answers, the most frequent first."""
    wrong = [case for case in cases if not _good(case)]
    found = [
        (truth, answer, count)
        for truth, answers in confusion(wrong).items()
        for answer, count in answers.items()
    ]
    for truth, answer, count in sorted(found, key=lambda it: -it[2])[:SHOWN]:
        yield truth, answer, str(count)


def _good(case: Case) -> bool:
    """Whether the answer to a case is the truth."""
    if case.kind == "nothing":
        return not false_causes([case]).value
    outside = case.said.verdict == OUTSIDE
    return outside if case.kind == "foreign" else case.right and not outside


def _curve(cases: Cases) -> Iterator[tuple[str, ...]]:
    for one in calibration(cases):
        yield (
            f"{one.low:g}..{one.high:g}",
            f"{one.probability:.3g}",
            f"{one.right.value:.3g}",
            _interval(one.right),
            str(one.right.n),
        )


def document(check: Check, versions: Mapping[str, str]) -> dict[str, Any]:
    """Return a check as what JSON is made of, by the schema in ``schema.json``."""
    return {
        "schema_version": VERSION,
        "seed": check.seed,
        "n": len(check.cases),
        "seal": check.seal,
        "versions": dict(versions),
        "tiers": {tier: _tier(tier, cases) for tier, cases in by_tier(check).items()},
        "cases": [_case(case) for case in check.cases],
    }


def _tier(tier: str, cases: Cases) -> dict[str, Any]:
    figures = {define.__name__: define(cases) for define in FIGURES}
    return {
        "n": len(cases),
        **{name: asdict(figure) for name, figure in figures.items()},
        "bars": {
            name: {"bar": " ".join(map(str, bar)), "met": met(figures[name], bar)}
            for name, bar in BARS[tier].items()
        },
        "confusion": confusion(cases),
        "calibration": [asdict(one) for one in calibration(cases)],
    }


def _case(case: Case) -> dict[str, Any]:
    return {
        "case": case.said.case,
        "tier": case.tier,
        "actuator": case.actuator,
        "kind": case.kind,
        "truth": sorted(case.truth),
        "hidden": sorted(case.hidden),
        "right": case.right,
        "covered": case.covered,
        "said": asdict(case.said),
        "oracle": asdict(case.known) if case.known else None,
    }
