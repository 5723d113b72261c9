"""The tolerance file of a comparison: TOML, by output."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from servo_models.data.schema import Seconds, Share, Table, named, quantity, read_toml
from servo_models.errors import UserError

KEYS = ("atol", "rtol", "time")


class OutputTable(Table):
    """What one output may be off by::

    [outputs.angle]
    atol = "0.1 deg"    # in value; a number is in the unit of the output
    rtol = "0.5 %"      # in value, of the range of the reference
    time = "2 ms"       # in time
    """

    atol: float | str | None = None
    rtol: Share | None = None
    time: Seconds | None = None


class ToleranceTable(OutputTable):
    """The file; outside a table stands what holds for every output::

    rtol = "0.5 %"
    time = "2 ms"
    hold = true         # inputs keep the value of their row, no line to the next
    start = { gain = 2.0, mode = "fast" }
    outputs = { angle = { atol = "0.1 deg" } }
    """

    hold: bool = False
    start: dict[str, Any] = {}
    outputs: dict[str, Any] = {}


@dataclass(frozen=True)
class Tolerance:
    """Tolerances that were asked for; None is the default.

    Attributes:
        every: by key, for all outputs.
        outputs: by output, then by key; ``atol`` in the unit of the output.
        hold: inputs are held between their rows.
        start: start values of variables.
    """

    every: Mapping[str, float | None] = field(default_factory=dict)
    outputs: Mapping[str, Mapping[str, float | None]] = field(default_factory=dict)
    hold: bool = False
    start: Mapping[str, float | bool | str] = field(default_factory=dict)

    def of(self, output: str) -> dict[str, float | None]:
        """Return ``atol``, ``rtol`` and ``time`` of an output."""
        return {key: self.every.get(key) for key in KEYS} | dict(self.outputs.get(output, {}))


def read_tolerance(path: Path, units: Mapping[str, str], variables: Collection[str]) -> Tolerance:
    """Read a tolerance file; ``units`` are those of the outputs that are compared, ``variables``
    may be given start values.

    Raises:
        UserError: a key, an output or a variable that there is not, a value of another kind or
            below 0.
    """
    whole = read_toml(path)
    table = whole.read(ToleranceTable)
    if isinstance(table.atol, str):
        whole.fail("atol", "a unit for all outputs; write for example [outputs.angle] and atol")
    every = {"atol": table.atol, "rtol": table.rtol, "time": table.time}
    _check(whole, every)
    tables = named(
        whole.section("outputs"), "output", units, lambda inner: not inner.keys() <= set(KEYS)
    )
    outputs = {}
    for name in tables:
        section = tables.at(name)
        inner = section.read(OutputTable, "{ atol = 0.1 }")
        given = {
            "atol": None if inner.atol is None else quantity(section, "atol", units[name] or "1"),
            "rtol": inner.rtol,
            "time": inner.time,
        }
        _check(section, given)
        outputs[name] = {key: value for key, value in given.items() if value is not None}
    start = named(whole.section("start"), "variable", dict.fromkeys(variables))
    for name in start:
        start.at(name).read(bool | float | str, f"{name} = 2.0")  # type: ignore[arg-type]
    return Tolerance(every, outputs, table.hold, start.content)


def _check(section: Any, given: Mapping[str, Any]) -> None:
    for key, value in given.items():
        if value is not None and not 0.0 <= value < float("inf"):
            raise UserError(
                f"'{section.file}', {f'{section.name}.' if section.name else ''}{key}: {value} is"
                f" no tolerance; write a number from 0 on, such as {key} = 0.01"
            )
