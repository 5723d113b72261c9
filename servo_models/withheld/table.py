"""Cases of a withheld check as rows of a table: what their figures are made of, and no more."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from servo_models.withheld.oracle import Known
from servo_models.withheld.said import Said
from servo_models.withheld.score import Case

Row = dict[str, str]

UNASKED = "?"
"""What a row says of effects that parameters imitate where none was looked for."""


def row_of(case: Mapping[str, Any]) -> Row:
    """Return a case of a run's JSON as a row; errors are in noise floors, times in seconds.

    Without an oracle, since nothing was wrong with the rig, its columns are empty.
    """
    said, known = case["said"], case["oracle"] or {}
    imitated = said.get("imitated")  # earlier runs have not looked
    return {
        "case": said["case"],
        "tier": case["tier"],
        "actuator": case["actuator"],
        "kind": case["kind"],
        "truth": " ".join(case["truth"]),
        "hidden": " ".join(case["hidden"]),
        "verdict": said["verdict"],
        "named": " ".join(said["named"]),
        "members": " ".join(said["members"]),
        "chances": " ".join(f"{name}={chance!r}" for name, chance in said["chances"].items()),
        "before": _text(said["before"]),
        "after": _text(said["after"]),
        "seconds": _text(round(said["seconds"], 3)),
        "separated": _text(known.get("separated")),
        "absorbed": _text(known.get("absorbed")),
        "truth_leaves": _text(known.get("truth")),
        "parameters_leave": _text(known.get("parameters")),
        "rival": " ".join(known.get("rival_effects", ())),
        "rival_leaves": _text(known.get("rival")),
        "after_when_told": _text(known.get("after")),
        "when_left_out": known.get("without", ""),
        "imitated": UNASKED if imitated is None else " ".join(imitated),
    }


def case_of(row: Mapping[str, str]) -> Case:
    """Return the case of a row, without what no figure asks for, such as all that was tried."""
    imitated = row.get("imitated", UNASKED)  # no column in tables of earlier runs
    chances = dict(entry.split("=") for entry in row["chances"].split())
    said = Said(
        case=row["case"],
        verdict=row["verdict"],
        seconds=float(row["seconds"]),
        named=row["named"].split(),
        members=row["members"].split(),
        chances={name: float(chance) for name, chance in chances.items()},
        before=_number(row["before"]),
        after=_number(row["after"]),
        imitated=None if imitated == UNASKED else imitated.split(),
    )
    known = Known(
        case=row["case"],
        truth=_number(row["truth_leaves"]) if row["truth_leaves"] else None,
        parameters=_number(row["parameters_leave"]),
        rival=_number(row["rival_leaves"]),
        rival_effects=row["rival"].split(),
        separated=row["separated"] == "True",
        absorbed=row["absorbed"] == "True",
        after=_number(row["after_when_told"]) if row["after_when_told"] else None,
        without=row["when_left_out"],
    )
    return Case(
        tier=row["tier"],
        actuator=row["actuator"],
        kind=row["kind"],
        truth=frozenset(row["truth"].split()),
        hidden=frozenset(row["hidden"].split()),
        said=said,
        known=known if row["separated"] else None,
    )


def _text(value: float | None) -> str:
    """JSON has no number for what is infinite: it comes as None."""
    return "" if value is None else repr(value)


def _number(text: str) -> float:
    return float(text) if text else float("inf")
