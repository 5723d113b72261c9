"""Judged cases of a withheld check, made by hand."""

from __future__ import annotations

from typing import Any

from msgspec.structs import replace

from servo_models.withheld.oracle import Diagnosed, Known
from servo_models.withheld.score import Case


def case(
    kind: str,
    truth: str,
    verdict: str,
    named: str = "",
    members: str = "",
    hidden: str = "",
    chance: float = 1.0,
    after: float = 1.0,
    imitated: str | None = None,
    **known: Any,
) -> Case:
    """A case with names as words; the gap before is 11, and 1 after when told."""
    oracle = {
        "truth": 0.0,
        "parameters": 9.0,
        "rival": 9.0,
        "rival_effects": [],
        "separated": True,
        "absorbed": False,
        "after": None if kind == "foreign" else 1.0,
        "without": "",
        **known,
    }
    words = named.split()
    chances = {words[0]: chance} if words else {}
    said = Diagnosed(
        "0", verdict, 2.0, "", words, members.split() or words, chances, chances, before=11.0
    )
    return Case(
        "easy",
        "sg90",
        kind,
        frozenset(truth.split()),
        frozenset(hidden.split()),
        replace(said, after=after, imitated=imitated and imitated.split()),
        None if kind == "nothing" else Known(case="0", **oracle),
    )


ABSORBED = {"separated": False, "absorbed": True}
MADE = [
    case("one", "a", "effect", "a", chance=0.95, without="outside-catalogue"),
    case("one", "a", "effect", "a b", hidden="b", chance=0.6, without="effect"),
    case("one", "a", "effects", "a c", chance=0.95, after=6.0, without="outside-catalogue"),
    case("one", "a", "outside-catalogue", "b", "b a", chance=0.65),
    case("one", "quantisation", "parameters", imitated="quantisation b", **ABSORBED),
    case("one", "a", "parameters", imitated="b", **ABSORBED),
    case("one", "a", "parameters", **ABSORBED),
    case("one", "a", "effect", "b", "b c", "b", chance=0.3, separated=False, absorbed=True),
    case("one", "reading_quantisation", "not-identifiable", "b", "b c d e", chance=0.3),
    case("one", "reading_quantisation", "parameters", after=16.0),
    case("one", "a", "failed", after=11.0),
    case("two", "a b", "effects", "b a", after=0.0),
    case("two", "a b", "effect", "a"),
    case("two", "a b", "outside-catalogue", separated=False),
    case("nothing", "", "parameters"),
    case("nothing", "", "no-gap"),
    case("nothing", "", "effect", "a"),
    case("nothing", "", "outside-catalogue"),
    case("foreign", "drag", "outside-catalogue", "a"),
    case("foreign", "drag", "effect", "a"),
    case("foreign", "drag", "parameters"),
    case("foreign", "drag", "effect", "a", separated=False),
]
