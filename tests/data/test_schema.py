"""Schemas of TOML files: they read their own examples, and every fault has key and cure."""

from __future__ import annotations

import datetime
import sys
import textwrap
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from msgspec import Meta, field

from servo_models.data.description import DescriptionTable
from servo_models.data.parameters import EstimateTable, FigureTable, ParameterFile
from servo_models.data.schema import Column, Number, Seconds, Section, Table, nested
from servo_models.data.signals import LogTable, Signal
from servo_models.errors import UserError
from servo_models.identification.elements.identify import ElementTable, GearTable
from servo_models.identification.elements.loop import Wish
from servo_models.identification.transfer.sweeps import SweepTable

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

EXAMPLES: list[type[Table]] = [
    DescriptionTable,
    ElementTable,
    EstimateTable,
    FigureTable,
    GearTable,
    LogTable,
    ParameterFile,
    Signal,
    SweepTable,
    Wish,
]


@pytest.mark.parametrize("kind", EXAMPLES, ids=lambda kind: kind.__name__)
def test_the_example_of_a_schema_has_its_keys_and_is_read(kind: type[Table]) -> None:
    example = tomllib.loads(textwrap.dedent(str(kind.__doc__).split("::\n", 1)[1]))
    if kind is Signal:  # whose column stands in the example of what it is in
        example["column"] = "angle"
    assert set(example) == set(kind.__struct_encode_fields__)
    Section(Path("rig.toml"), "", example).read(kind)


class Inner(Table):
    """A table inside."""

    column: Column
    kind: Literal["even", "odd"] = "even"


class Outer(Table):
    """A table.

    Written as::

        name = "steps"
        day = 2026-01-31
        gain = 2.0
        late = "2 ms"
        teeth = [8, 48]
        shown = true
        inner = { column = "u" }    # or its name alone
        names = ["a", "b"]
    """

    name: str
    day: datetime.date | None = None
    gain: Number = 1.0
    late: Seconds = Seconds(0.0)
    teeth: tuple[Annotated[int, Meta(gt=0)], Annotated[int, Meta(gt=0)]] = (1, 1)
    shown: bool | Inner = True
    inner: Column | Inner | None = None
    names: list[str] = field(default_factory=list)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"nmae": 1}, "a.nmae: unknown key 'nmae'; did you mean 'name'?"),
        ({"name": None}, 'a.name: missing; write for example name = "steps"'),
        ({"name": 3}, 'a.name: no text; write for example name = "steps"'),
        ({"day": "2026-01-31"}, "a.day: no day; write for example day = 2026-01-31"),
        ({"gain": "2"}, "a.gain: no number; write for example gain = 2.0"),
        ({"gain": True}, "a.gain: no number; write for example gain = 2.0"),
        ({"gain": float("inf")}, "a.gain: inf is not finite; write for example gain = 2.0"),
        ({"late": "2 V"}, "a.late: unit 'V' does not convert to 's'; give a unit like s"),
        ({"late": True}, 'a.late: no number; give one in s, or a text such as "1 s"'),
        ({"teeth": [8]}, "a.teeth: no pair; write for example teeth = [8, 48]"),
        ({"teeth": [0, 8]}, "a.teeth: no pair; write for example teeth = [8, 48]"),
        ({"shown": 1}, "a.shown: neither true nor false; write for example shown = true"),
        ({"inner": {}}, 'a.inner.column: missing; write for example inner = { column = "u" }'),
        ({"inner": []}, 'a.inner: no text; write for example inner = { column = "u" }'),
        (
            {"inner": {"column": 1, "kind": "od"}},
            "a.inner.kind: 'od' is unknown; did you mean 'odd'?",
        ),
        ({"names": ["a", 1]}, 'a.names: no list; write for example names = ["a", "b"]'),
    ],
)
def test_what_does_not_fit_is_told_with_its_key_and_an_example(
    change: dict[str, Any], complaint: str
) -> None:
    content = {key: value for key, value in ({"name": "b"} | change).items() if value is not None}
    with pytest.raises(UserError) as caught:
        Section(Path("rig.toml"), "a", content).read(Outer)
    assert str(caught.value) == f"'rig.toml', {complaint}"


def test_what_fits_is_read_in_si() -> None:
    content = {"name": "b", "late": "2 ms", "gain": 3, "inner": {"column": 2}, "shown": False}
    table = Section(Path("rig.toml"), "a", content).read(Outer)
    assert (table.name, table.late, table.gain, table.shown) == ("b", 2e-3, 3.0, False)
    assert table.inner == Inner(column=2)
    assert table.names == []


def test_dotted_names_are_nested_as_toml_nests_them() -> None:
    assert nested({"a.b": 1, "a.c": 2, "d": 3}) == tomllib.loads("a.b = 1\na.c = 2\nd = 3")
