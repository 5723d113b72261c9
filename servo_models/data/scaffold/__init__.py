"""Begin a log description: guess what the columns of a file are, and say what was guessed."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from servo_models.core.catalogue import actuator as find_actuator
from servo_models.core.catalogue import actuators
from servo_models.core.own_actuator import key_from
from servo_models.core.plant import Actuator, Wire
from servo_models.core.simulate import model, simulate
from servo_models.data.scaffold.columns import Column, LeftOut, columns_of
from servo_models.data.scaffold.guess import Match, matches, tells, time_of, why_not
from servo_models.errors import UserError, printable
from servo_models.files import write_whole
from servo_models.units import exponents, factor

__all__ = ["Draft", "draft", "write_draft"]

CHECK = "# guessed"
LONGEST = 4000
"""Characters of a sentence about columns, whose names are anybody's."""


@dataclass(frozen=True, eq=False)
class Draft:
    """A first description.

    Attributes:
        path: the log.
        actuator: what is thought to have made it, ``given`` if that was told.
        time: its column and unit, None if no column rises.
        matches: columns and their signals, all in the table of the time or an input's.
        unused: columns left over, of all tables.
        left_out: columns that are not numbers throughout.
    """

    path: Path
    actuator: Actuator
    given: bool
    time: tuple[Column, str] | None
    matches: tuple[Match, ...]
    unused: tuple[Column, ...]
    left_out: tuple[LeftOut, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Columns that seem to be measured but cannot be used, one sentence each."""
        return tuple(
            printable(f"not used: {column.why}", LONGEST)
            for column in self.left_out
            if column.damaged
        )

    @property
    def table(self) -> str | None:
        """The table of the time and the outputs, None where the file has but one."""
        return self.time[0].table if self.time else None

    @property
    def not_used(self) -> tuple[str, ...]:
        """Columns left out that are not damaged, a sentence for each reason."""
        names: dict[str, list[str | int]] = {}
        for column in self.unused:
            if column.table == self.table:
                why = why_not(column, self.matches, self.actuator)
                names.setdefault(why, []).append(column.key)
            else:
                names.setdefault("what else is in other tables", []).append(column.table or "")
        words = [column.key for column in self.left_out if not column.damaged]
        if words:
            names["not numbers throughout"] = words
        return tuple(
            printable(f"not used, {why}: {', '.join(map(_quoted, dict.fromkeys(keys)))}", LONGEST)
            for why, keys in names.items()
        )

    def text(self, folder: Path) -> str:
        """Return the description as TOML, to stand in ``folder``."""
        return "\n".join(_lines(self, folder)) + "\n"


def draft(path: Path, actuator: str | None = None) -> Draft:
    """Look at the columns of a measured file and guess what they are.

    Args:
        path: the file, of any format that can be read.
        actuator: name of what made it; None chooses the one that the columns fit best.

    Raises:
        UserError: a file that cannot be read or has no numbers, an unknown actuator, or
            columns that fit several equally well.
    """
    columns, left_out = columns_of(path)
    asked = [find_actuator(actuator)] if actuator else list(actuators().values())
    drafts = [_draft(path, columns, candidate, bool(actuator)) for candidate in asked]
    best = max(drafts, key=_score)
    if [_score(made) for made in drafts].count(_score(best)) > 1:
        names = ", ".join(candidate.name for candidate in asked)
        raise UserError(f"'{path}' does not tell what made it: give --actuator, one of {names}")
    return replace(best, left_out=tuple(left_out))


def _score(made: Draft) -> float:
    return sum(match.score for match in made.matches if match.converts)


def _draft(path: Path, columns: Sequence[Column], actuator: Actuator, given: bool) -> Draft:
    """The draft with the table whose columns fit best as outputs; inputs may be in others."""
    tables = list(dict.fromkeys(column.table for column in columns))
    made = [_draft_on(path, columns, actuator, given, table) for table in tables]
    return max(made, key=_score)


def _draft_on(
    path: Path, columns: Sequence[Column], actuator: Actuator, given: bool, table: str | None
) -> Draft:
    own = [column for column in columns if column.table == table]
    time = time_of(own)
    times = {time_of([c for c in columns if c.table == column.table]) for column in columns}
    stamps = [found[0] for found in times if found]
    rest = [c for c in columns if c.moves and c not in stamps]
    found = tuple(
        match
        for match in matches(rest, actuator)
        if match.column.table == table or match.wire in actuator.plant.inputs
    )
    used = {id(match.column) for match in found} | {id(stamp) for stamp in stamps}
    unused = tuple(column for column in columns if id(column) not in used)
    return Draft(path, actuator, given, time, found, unused)


def write_draft(made: Draft, path: Path) -> None:
    """Write a draft as TOML.

    Raises:
        UserError: there is a file of that name already, or it cannot be written.
    """
    if os.path.exists(path):
        raise UserError(f"'{path}' exists: edit it, remove it, or name another with --out")
    write_whole(path, made.text(path.parent).encode())


def _lines(made: Draft, folder: Path) -> Iterator[str]:
    others = ", ".join(name for name in actuators() if name != made.actuator.name)
    yield "# First description of a log. Lines marked 'guessed' are to be checked."
    doubt = "" if made.given else f"  {CHECK}; there are also {others}"
    yield f"actuator = {_quoted(key_from(made.actuator, folder))}{doubt}"
    yield f"# variant = {_quoted(made.actuator.default_variant)}  # others: servo-models list"
    yield '# free = ["..."]  # parameters to be estimated, see servo-models explain'
    yield ""
    yield "[[logs]]"
    relative = os.path.relpath(made.path.resolve(), folder.resolve())
    yield f"file = {_quoted(Path(relative).as_posix())}"
    if made.table:
        yield f"table = {_quoted(made.table)}"
    yield from _time_lines(made)
    for match in made.matches:
        yield from _signal_lines(match, made)
    yield from _open_ends(made)


def _time_lines(made: Draft) -> Iterator[str]:
    if not made.time:
        yield "# no column rises as a time does: write it here"
        yield '# time = { column = "...", unit = "s" }'
        return
    column, unit = made.time
    repeats = ', repeats = "drop"' if (np.diff(column.values) == 0.0).any() else ""
    doubt = f"  {CHECK}: the unit" if column.unit != unit else ""
    yield f"time = {{ column = {_quoted(column.key)}, unit = {_quoted(unit)}{repeats} }}{doubt}"


def _signal_lines(match: Match, made: Draft) -> Iterator[str]:
    plant = made.actuator.plant
    role = "inputs" if match.wire in plant.inputs else "outputs"
    entry = f"column = {_quoted(match.column.key)}, unit = {_quoted(match.unit)}"
    doubts = [] if match.told else ["the unit"]
    if not match.converts:
        unit, scale, offset = _through_the_model(match, made.actuator)
        entry = f"column = {_quoted(match.column.key)}, unit = {_quoted(unit)}"
        entry += f", scale = {scale:.6g}, offset = {offset:.6g}"
        doubts = [f"scale and offset from {match.unit} to {unit} by the model's static gain"]
    if match.column.table != made.table:
        entry += f", table = {_quoted(match.column.table or '')}"
    if not tells(match.column):
        doubts = ["the signal", *doubts]
    low, high = match.column.values.min(), match.column.values.max()
    doubt = f"  {CHECK}: {' and '.join(doubts)}" if doubts else ""
    yield f"# {match.wire.about}; in the file from {low:.6g} to {high:.6g}"
    yield f"{role}.{match.wire.name} = {{ {entry} }}{doubt}"


def _through_the_model(match: Match, actuator: Actuator) -> tuple[str, float, float]:
    """Unit, scale and offset of a command that was logged in the unit of an output.

    The scale is the step of the input over the change of the output that it makes in the
    end; the first number is taken for rest.
    """
    plant, wire = actuator.plant, match.wire
    name, size = actuator.step
    unit = wire.display or wire.unit
    to_unit, rest = factor(wire.unit, unit), float(wire.rest)
    quantity = {out: exponents(plant.wire[out].unit)[1] for out in plant.outputs}
    follower = next((o for o in quantity if quantity[o] == exponents(match.unit)[1]), None)
    if follower is None:
        return unit, 1.0, rest * to_unit
    chosen = model(actuator)
    times = np.linspace(0.0, chosen.stop_time, 1001)
    reached = simulate(chosen, times, {name: size})[follower]
    gain = (reached[-1] - reached[0]) / (size - rest)
    scale = factor(match.unit, plant.wire[follower].unit) / gain
    return unit, scale * to_unit, (rest - scale * float(match.column.values[0])) * to_unit


def _open_ends(made: Draft) -> Iterator[str]:
    plant = made.actuator.plant
    matched = [match.wire.name for match in made.matches]
    missing = [wire for wire in plant.inputs if wire.name not in matched]
    main = made.actuator.step[0]
    assumed = [wire for wire in missing if wire.rest and wire.name != main]
    others = [wire.name for wire in missing if wire not in assumed]
    if not any(name in plant.outputs for name in matched):
        yield '# no column fits an output: write outputs.NAME = { column = "...", unit = "..." }'
    yield f"# outputs there are: {', '.join(plant.outputs)}"
    if assumed:
        values = ", ".join(f"{wire.name} = {_resting(wire)}" for wire in assumed)
        variant = made.actuator.default_variant
        yield f"constants = {{ {values} }}  {CHECK}: those of variant '{variant}'"
    if others:
        yield f"# at rest, or give them in constants = {{ ... }}: {', '.join(others)}"
    for sentence in (*made.not_used, *made.warnings):
        yield f"# {sentence}"


def _resting(wire: Wire) -> str:
    """The value at which an input rests, as TOML."""
    if wire.flag:
        return "true" if wire.rest else "false"
    unit = wire.display or wire.unit
    return _quoted(f"{float(wire.rest) * factor(wire.unit, unit):.6g} {unit}")


def _quoted(value: str | int) -> str:
    return json.dumps(value, ensure_ascii=False)
