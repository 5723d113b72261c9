"""Begin a log description: guess what the columns of a file are, and say what was guessed."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuators, model, of_one_variant
from servo_models.core.own_actuator import key_from
from servo_models.core.plant import Actuator, Plant, Variant, Wire
from servo_models.core.types import Array
from servo_models.data.clock import dithered
from servo_models.data.readers import Columns, read_tables
from servo_models.data.readers.lerobot import INDICES
from servo_models.data.schema import quoted as _quoted
from servo_models.data.sensor import difference_noise
from servo_models.errors import UserError, printable
from servo_models.files import write_whole
from servo_models.report.numbers import plural
from servo_models.units import WRITTEN_IN, exponents, factor

CHECK = "# guessed"
COUNTS_PER_TURN = (1024, 4096, 8192, 16384, 65536)  # counts in a turn of usual encoders
LARGEST_DEGREES = 400.0  # largest angle of a joint in degrees; whole numbers beyond are counts
HEAD_BYTES = 4096  # bytes at the beginning of a file in which it may name the motor
LONGEST_SENTENCE = 4000  # characters of a sentence about columns, whose names are anybody's


@dataclass(frozen=True, eq=False)
class Draft:
    """A first description.

    Attributes:
        path: the log.
        actuator: actuator that is thought to have made it, ``given`` if that was told.
        variant: variant of the actuator, the default one unless the file names another or has the
            command of another.
        time: its column and unit, None if no column rises.
        matches: columns and their signals, all in the table of the time or an input's.
        unused: columns left over, of all tables.
        left_out: columns that are not numbers throughout.
    """

    path: Path
    actuator: Actuator
    variant: Variant
    given: bool
    time: tuple[Column, str] | None
    matches: tuple[Match, ...]
    unused: tuple[Column, ...]
    left_out: tuple[LeftOut, ...] = ()

    @property
    def plant(self) -> Plant:
        return self.actuator.plant_of(self.variant.name)

    @property
    def main(self) -> str:
        """Name of the input that moves it."""
        return self.actuator.step_of(self.variant.name)[0]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Columns that seem to be measured but cannot be used, one sentence each."""
        return tuple(
            printable(f"not used: {column.why}", LONGEST_SENTENCE)
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
                names.setdefault(_why_not(column, self), []).append(column.key)
            else:
                names.setdefault("what else is in other tables", []).append(column.table or "")
        if words := [column.key for column in self.left_out if not column.damaged]:
            names["not numbers throughout"] = words
        listed = {why: ", ".join(map(_quoted, dict.fromkeys(keys))) for why, keys in names.items()}
        told = (f"not used, {why}: {keys}" for why, keys in listed.items())
        return tuple(printable(text, LONGEST_SENTENCE) for text in told)

    def text(self, folder: Path) -> str:
        """Return the description as TOML, to stand in ``folder``."""
        return "\n".join(_lines(self, folder)) + "\n"


def draft(path: Path, actuator: str | None = None) -> Draft:
    """Look at the columns of a measured file and guess what they are.

    Args:
        path: the file, of any format that can be read.
        actuator: what made it, as of ``of_one_variant``; None chooses the one whose command and
            motion the columns tell most clearly; of several, a general one only where no other
            fits, and then the one that they fit best.

    Raises:
        UserError: a file that cannot be read or has no numbers, an unknown actuator, or
            columns that fit several equally well.
    """
    return drafts(path, actuator)[0]


def drafts(path: Path, actuator: str | None = None) -> list[Draft]:
    """Return ``draft``, one for each table where several alike have command and reading each.

    Raises:
        UserError: see ``draft``.
    """
    columns, left_out = _columns_of(path)
    if actuator:
        made = [_draft(path, columns, of_one_variant(actuator), given=True)]
    else:
        made = _rivals(path, columns)
    best = max(made, key=_score)
    if [_score(one) for one in made].count(_score(best)) > 1:
        names = ", ".join(actuators())
        raise UserError(f"'{path}' does not tell what made it: give --actuator, one of {names}")
    best = replace(best, left_out=tuple(left_out))
    if not _is_whole(best):
        return [best]
    alike = _alike([*columns, *left_out], best.table)
    every = [_filled(best, columns, it, [other for other in alike if other != it]) for it in alike]
    return [one for one in every if _is_whole(one)]


def _is_whole(made: Draft) -> bool:
    """Whether a table has both what moves the actuator and what it does."""
    own = {match.wire.name for match in made.matches if match.column.table == made.table}
    return made.main in own and bool(own.intersection(made.plant.outputs))


def _alike(columns: Sequence[Column | LeftOut], table: str | None) -> list[str | None]:
    """The tables with the headings of one, such as the messages of each servo on a bus."""
    headings: dict[str | None, set[str | int]] = {}
    for column in columns:
        headings.setdefault(column.table, set()).add(column.key)
    return [it for it, keys in headings.items() if keys == headings[table]]


def _rivals(path: Path, columns: Sequence[Column]) -> list[Draft]:
    """The drafts that tell command and motion most clearly; the general ones if no other fits."""
    every = [_draft(path, columns, found, given=False) for found in actuators().values()]
    clearest = max(map(_clarity, every))
    every = [made for made in every if _clarity(made) == clearest]
    specific = [made for made in every if not made.actuator.general]
    return specific if any(map(_score, specific)) else every


def _score(made: Draft) -> float:
    return sum(match.score for match in made.matches if match.converts)


def _clarity(made: Draft) -> int:
    """How clearly headings tell what moves the actuator, where they tell a motion as well.

    0 not at all or without a motion, 1 by a quantity or unit, 2 by a word of that input; 2 more
    by a word for a command or a unit that only commands have.
    """
    wires = {match.wire.name: match for match in made.matches if match.converts}
    command = wires.get(made.main)
    if not command or not any(_tells_motion(match, made.plant) for match in wires.values()):
        return 0
    words = set(command.column.words)
    is_command = bool(words & COMMAND)
    if words & SUPPLY or (_only_wobbles(command) and not is_command):
        return 0
    is_own = bool(_own_words(command.wire) & words)
    if not (is_own or command.told or _is_of_quantity(words, command.wire)):
        return 0
    return 1 + is_own + 2 * (is_command or (command.told and _is_of_commands(command.wire.unit)))


def _only_wobbles(match: Match) -> bool:
    """Whether a column stays so near one value, away from rest, that it is held and no command."""
    away = match.column.values * factor(match.unit, match.wire.unit) - float(match.wire.rest)
    return bool(np.ptp(away) < WOBBLE_PER_SIZE * np.abs(away).max())


def _is_of_commands(unit: str) -> bool:
    """Whether no actuator has an output in such a unit, as in that of a pulse width."""
    plants = [other.plant for other in actuators().values()]
    outputs = (plant.wire[name].unit for plant in plants for name in plant.outputs)
    return not any(_dimension(unit) == _dimension(output) for output in outputs)


def _tells_motion(match: Match, plant: Plant) -> bool:
    """Whether the heading of a column is that of the first output, or of its rate."""
    unit = plant.wire[plant.outputs[0]].unit
    is_motion = match.wire.unit in (unit, f"{unit}/s") and match.wire.name in plant.outputs
    return is_motion and _tells(match.column, plant)


def _draft(path: Path, columns: Sequence[Column], actuator: Actuator, given: bool) -> Draft:
    """The draft of the variant and table that fit best as outputs; inputs may be in others."""
    tables = list(dict.fromkeys(column.table for column in columns))
    offered = given or is_servo(actuator)  # the goal of a servo looks like that of a motor's loop
    variants = [actuator.variants[0], *(it for it in actuator.variants if it.command and offered)]
    motors = _motors_in(path)
    variants = [it for it in actuator.variants if it.name in motors] or variants
    blank = [Draft(path, actuator, variant, given, None, (), ()) for variant in variants]
    made = [_filled(draft, columns, table) for draft in blank for table in tables]
    return max(made, key=_score)


def is_servo(actuator: Actuator) -> bool:
    """Whether it reads the angle of a joint, which a motor by itself does not."""
    return READING in actuator.plant.outputs


def _motors_in(path: Path) -> set[str]:
    """Words with a letter and a digit in the name of a file and at its beginning, as those of
    motors are."""
    try:
        with path.open("rb") as stream:
            text = stream.read(HEAD_BYTES).decode("utf-8", "ignore")
    except OSError:  # such as a folder
        text = ""
    words = set(re.findall(r"[a-z0-9_]+", f"{path.stem} {text}".lower()))
    return {it for it in words if re.search("[a-z]", it) and re.search("[0-9]", it)}


def _filled(
    blank: Draft,
    columns: Sequence[Column],
    table: str | None,
    others: Sequence[str | None] = (),
) -> Draft:
    """A draft with a signal for each column that fits one, and the time of that table.

    Columns of ``others`` are those of something else.
    """
    time = _time_of([column for column in columns if column.table == table])
    times = {_time_of([c for c in columns if c.table == column.table]) for column in columns}
    stamps = [stamp[0] for stamp in times if stamp]
    fit = [column for column in columns if column.table not in others]
    numbers = [c for c in fit if not (c.dates or c.counts or c in stamps)]
    matches = tuple(
        match
        for match in _matches([c for c in numbers if c.moves], blank)
        if match.column.table == table or match.wire in blank.plant.inputs
    )
    matches += tuple(_constant_inputs(numbers, blank.plant, [match.wire for match in matches]))
    used = {id(match.column) for match in matches} | {id(stamp) for stamp in stamps}
    unused = tuple(column for column in columns if id(column) not in used)
    return replace(blank, time=time, matches=matches, unused=unused)


def write_draft(made: Draft, path: Path) -> None:
    """Write a draft as TOML.

    Raises:
        UserError: there is a file of that name already, or it cannot be written.
    """
    if os.path.exists(path):
        raise UserError(f"'{path}' exists: edit it, remove it, or name another with --out")
    write_whole(path, made.text(path.parent).encode())


def _lines(made: Draft, folder: Path) -> Iterator[str]:
    others = sorted(actuators().values(), key=lambda other: (other.general, other.name))
    named = ", ".join(
        f"{other.name} (general)" if other.general else other.name
        for other in others
        if other.name != made.actuator.name
    )
    yield "# First description of a log. Lines marked 'guessed' are to be checked."
    doubt = "" if made.given else f"  {CHECK}; there are also {named}"
    yield f"actuator = {_quoted(key_from(made.actuator, folder))}{doubt}"
    variant = f"variant = {_quoted(made.variant.name)}"
    if len(made.actuator.variants) == 1:
        yield variant
    elif made.variant.command:
        yield f"{variant}  {CHECK}: the one whose command is {made.main}"
    elif made.variant is not made.actuator.variants[0]:
        yield f"{variant}  {CHECK}: the file names it"
    else:
        yield f"# {variant}  # others: servo-models list"
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
    again = bool((np.diff(column.values) == 0.0).any())
    even = again and dithered(column.values, factor(unit, "s")) is not None
    repeats = ', repeats = "drop"' if again and not even else ""
    doubt = f"  {CHECK}: the unit" if column.unit != unit else ""
    written = "" if column.dates else f", unit = {_quoted(unit)}"
    yield f"time = {{ column = {_quoted(column.key)}{written}{repeats} }}{doubt}"


def _signal_lines(match: Match, made: Draft) -> Iterator[str]:
    plant = made.plant
    role = "inputs" if match.wire in plant.inputs else "outputs"
    entry = f"column = {_quoted(match.column.key)}, unit = {_quoted(match.unit)}"
    doubts = [] if match.told else ["the unit"]
    turn = match.column.turn
    if turn and match.unit == "deg":
        zero = "" if match.column.values.min() < 0.0 else ", offset = -180"
        entry += f", scale = {360.0 / turn}{zero}"
        doubts = [f"the unit, counts of an encoder with {turn} a turn"]
    if not match.converts:
        unit, scale, offset = _through_the_model(match, made.actuator)
        entry = f"column = {_quoted(match.column.key)}, unit = {_quoted(unit)}"
        entry += f", scale = {scale:.6g}, offset = {offset:.6g}"
        doubts = [f"scale and offset from {match.unit} to {unit} by the model's static gain"]
    if match.column.gaps:
        entry += ', missing = "hold"' if role == "inputs" else ', missing = "drop"'
        doubts = [*doubts, f"{plural(match.column.gaps, 'cell')} without a value"]
    if match.column.table != made.table:
        entry += f", table = {_quoted(match.column.table or '')}"
    if not _tells(match.column, plant):
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
    name, size = actuator.step_of()
    unit = wire.display or wire.unit
    to_unit, rest = factor(wire.unit, unit), float(wire.rest)
    wanted = _dimension(match.unit)
    follower = next((o for o in plant.outputs if _dimension(plant.wire[o].unit) == wanted), None)
    if follower is None:
        return unit, 1.0, rest * to_unit
    chosen = model(actuator)
    times = np.linspace(0.0, chosen.stop_time, 1001)
    reached = simulate(chosen, times, {name: size})[follower]
    gain = (reached[-1] - reached[0]) / (size - rest)
    scale = factor(match.unit, plant.wire[follower].unit) / gain
    return unit, scale * to_unit, (rest - scale * float(match.column.values[0])) * to_unit


def _open_ends(made: Draft) -> Iterator[str]:
    plant = made.plant
    matched = [match.wire.name for match in made.matches]
    missing = [wire for wire in plant.settable if wire.name not in matched]
    mains = (made.main, made.actuator.step[0])
    assumed = [wire for wire in missing if wire.rest and wire.name not in mains]
    others = [wire.name for wire in missing if wire not in assumed]
    if not any(name in plant.outputs for name in matched):
        yield '# no column fits an output: write outputs.NAME = { column = "...", unit = "..." }'
    yield f"# outputs there are: {', '.join(plant.outputs)}"
    if assumed:
        values = ", ".join(f"{wire.name} = {_resting(wire)}" for wire in assumed)
        yield f"constants = {{ {values} }}  {CHECK}: those of variant '{made.variant.name}'"
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


# Which column is which signal

TIME = {"t", "time", "times", "timestamp", "stamp", "zeit", "temps", "clock"}
READING = "angle_reading"  # output of a servo that is the angle of its joint
COMMAND = {"cmd", "command", "commanded", "ref", "reference", "goal", "target", "setpoint"}
COMMAND |= {"desired", "sp", "demand", "soll", "u", "input", "action"}
MEASURED = {"meas", "measured", "actual", "act", "present", "ist", "feedback", "y", "output"}
MEASURED |= {"observation", "observed"}
SUPPLY = {"battery", "batt", "bat", "vbat", "vin", "supply"}  # words of what feeds an actuator
QUANTITIES = {
    "angle theta phi position pos horn tilt": "rad",
    "rate speed velocity vel omega gyro gyr": "rad/s",
    "voltage volt volts drive": "V",
    "current amp amps": "A",
    "torque tau": "N.m",
    "force": "N",
    "pulse pwm servo": "s",
    "position pos displacement stroke": "m",
}
"""Words that tell a quantity, and its SI unit."""
KNOWN = {word for text in QUANTITIES for word in text.split()}
SIDE_SCORE = 4.0  # score from which a column is taken for another input than the command
NEAR_REST = 1.2  # distance of an input from its rest in full scales, at most
WOBBLE_PER_SIZE = 0.1  # range of a column over its distance from rest, below which it is no command
LEAST_SCORE = 2.0  # score from which a column is taken for the command or a reading
LONGEST_STEP = 0.5  # longest sampling step [s], which decides the unit of times without one


@dataclass(frozen=True)
class Match:
    """A column for a signal.

    Attributes:
        wire: the signal.
        unit: unit of the column.
        told: the column's name tells its unit, and it is one of the signal.
        converts: whether the unit is one of the signal's at all.
        score: fit of column and signal, above 0.
    """

    wire: Wire
    column: Column
    unit: str
    told: bool
    converts: bool
    score: float


def _time_of(columns: Sequence[Column]) -> tuple[Column, str] | None:
    """Return the column that is the time, and its unit; None if there is none."""
    rising = [column for column in columns if column.rising and column.moves and not column.gaps]
    if not rising:
        return None
    best = max(rising, key=lambda column: 2 * bool(TIME & set(column.words)) + _is_time(column))
    if best.unit and _is_time(best):
        return best, best.unit
    step = float(np.median(np.diff(best.values)))
    return best, next((u for u in WRITTEN_IN["s"] if step * factor(u, "s") <= LONGEST_STEP), "ns")


def _is_time(column: Column) -> bool:
    return column.unit is not None and _dimension(column.unit) == {"s": 1}


def _matches(columns: Sequence[Column], made: Draft) -> list[Match]:
    """Return a column for each signal that one fits, best first; a column serves one signal.

    Where the names tell no reading, columns are told by their numbers: the command is the one
    that stands still most often, or else the one with the least noise.
    """
    by_name = _chosen(columns, made, None, blind=False)
    if any(match.wire.name in made.plant.outputs for match in by_name):
        return by_name
    nameless = [column for column in columns if not _tells(column, made.plant)]
    named = any(COMMAND & set(column.words) for column in columns)
    command = None if named else max(nameless, key=_calm, default=None)
    return _chosen(columns, made, command, blind=True)


def _constant_inputs(
    columns: Sequence[Column], plant: Plant, matched: Sequence[Wire]
) -> Iterator[Match]:
    """Inputs that are the same in the whole log, from columns that are called like them."""
    for wire in plant.settable:
        same = [c for c in columns if not c.moves and "_".join(c.words) == wire.name]
        match = _match(wire, same[0], plant, main=False, command=False) if same else None
        if match and match.converts and match.score and wire not in matched:
            yield match


def _why_not(column: Column, made: Draft) -> str:
    """Say why a column is taken for no signal."""
    plant = made.plant
    if not column.moves:
        return "constant"
    if column.counts:
        return "it counts rows, or runs of them"
    if not _tells(column, plant):
        return "the name does not tell what it is"
    best = max(_offers(column, made), key=lambda match: match.score)
    for match in made.matches:
        if match.wire is best.wire and best.score >= LEAST_SCORE:
            return f'{match.wire.name} is taken from "{match.column.key}"'
    return f"it fits no signal of {made.actuator.name}"


def _chosen(
    columns: Sequence[Column], made: Draft, command: Column | None, blind: bool
) -> list[Match]:
    plant, main = made.plant, made.main
    offered = [
        match
        for column in columns
        if blind or _tells(column, plant)
        for match in _offers(column, made, column is command)
    ]
    sides = [wire for wire in plant.inputs if wire.name != main]
    chosen: list[Match] = []
    for match in sorted(offered, key=lambda match: (-match.score, match.wire in sides)):
        unlike = command is not None and _is_unlike_rate(match, command, plant)
        taken = any(match.wire is other.wire or match.column is other.column for other in chosen)
        least = SIDE_SCORE if match.wire in sides else LEAST_SCORE
        if match.score >= least and not unlike and not taken:
            chosen.append(match)
    return _with_command(chosen, [match for match in offered if match.wire.name == main], plant)


def _with_command(chosen: list[Match], commands: Sequence[Match], plant: Plant) -> list[Match]:
    """The matches with a command, where a column has a word of it and another tells a motion.

    A current is an output of many an actuator, and the command of a motor on a current.
    """
    if any(match.wire is command.wire for match in chosen for command in commands):
        return chosen
    for command in sorted(commands, key=lambda match: -match.score):
        others = [match for match in chosen if match.column is not command.column]
        called = bool(_own_words(command.wire) & set(command.column.words))
        if called and command.converts and any(_tells_motion(it, plant) for it in others):
            return [command, *others]
    return chosen


def _offers(column: Column, made: Draft, command: bool = False) -> list[Match]:
    """How a column fits every signal."""
    plant, mains = made.plant, (made.main, made.plant.outputs[0])
    names = (*(wire.name for wire in plant.settable), *plant.outputs)
    return [_match(plant.wire[n], column, plant, n in mains, command) for n in names]


def _match(wire: Wire, column: Column, plant: Plant, main: bool, command: bool) -> Match:
    """How well a column fits a wire, the ``main`` input or output or another; ``command`` if its
    numbers are those of a command."""
    words, name_words = set(column.words), set(wire.name.split("_"))
    output = wire.name in plant.outputs
    told = column.unit is not None and _dimension(column.unit) == _dimension(wire.unit)
    unit = column.unit or _likely_unit(wire, column)
    converts = told or (column.unit is None and _near_rest(wire, column, unit))
    is_command, is_measured = command or bool(words & COMMAND), bool(words & MEASURED)
    score = 4.0 * (words == name_words) + 1.5 * len(words & name_words)
    score += 2.0 * told + LEAST_SCORE * _is_of_quantity(words, wire)
    score += LEAST_SCORE * bool(words & set(wire.words))
    feeds, is_fed = bool(name_words & SUPPLY), _is_fed(column, plant)
    is_command &= not is_fed
    score += SIDE_SCORE * (feeds and is_fed)
    if output:
        score += 1.0 * is_measured - 4.0 * is_command + LEAST_SCORE * (not _tells(column, plant))
        score += LEAST_SCORE * (main and is_measured and not words & KNOWN)
    else:
        score += 3.0 * (main and is_command) - 1.5 * is_measured
    if output and (feeds or is_fed):  # what is measured of a supply drives the model
        score = 0.0
    if not converts:
        score = LEAST_SCORE if main and is_command and not output else 0.0
        unit = column.unit or "deg"
    return Match(wire, column, unit, told, converts, 0.0 if wire.flag else score)


def _is_fed(column: Column, plant: Plant) -> bool:
    """Whether a column is called a supply, or input volts where no voltage is a command."""
    words = set(column.words)
    in_volts = column.unit is not None and _dimension(column.unit) == _dimension("V")
    commanded = any(wire.unit == "V" and wire.name not in SUPPLY for wire in plant.inputs)
    return bool(words & SUPPLY) or ("input" in words and in_volts and not commanded)


def _tells(column: Column, plant: Plant) -> bool:
    """Return whether the name of a column says anything about what is in it."""
    wire_words = {word for wire in plant.wire.values() for word in wire.words}
    known = KNOWN | COMMAND | MEASURED | wire_words
    return column.unit is not None or bool(known & set(column.words))


def _own_words(wire: Wire) -> set[str]:
    return {*wire.name.split("_"), *wire.words}


def _dimension(unit: str) -> dict[str, int]:
    return exponents(unit)[1]


def _is_of_quantity(words: Iterable[str], wire: Wire) -> bool:
    units = [unit for text, unit in QUANTITIES.items() if set(text.split()) & set(words)]
    return any(_dimension(unit) == _dimension(wire.unit) for unit in units)


def _likely_unit(wire: Wire, column: Column) -> str:
    """The unit in which the column's range comes nearest to the full scale of the signal."""
    if wire.unit == "rad" and column.turn:
        return "deg"
    reach = float(np.abs(column.values).max()) or 1.0
    units = WRITTEN_IN.get(wire.unit, (wire.unit,))
    return min(units, key=lambda it: abs(math.log(reach * factor(it, wire.unit) / wire.scale)))


def _near_rest(wire: Wire, column: Column, unit: str) -> bool:
    """Whether an input that rests at some value other than 0 is in its neighbourhood."""
    if not isinstance(wire.rest, float) or wire.rest == 0.0:
        return True
    away = column.values * factor(unit, wire.unit) - wire.rest
    return bool(np.abs(away).max() <= NEAR_REST * wire.scale)


def _calm(column: Column) -> tuple[float, float]:
    if not column.moves:
        return -1.0, 0.0
    still = float(np.mean(np.diff(column.values) == 0.0))
    return round(still, 1), -difference_noise(column.values) / float(np.ptp(column.values))


def _is_unlike_rate(match: Match, command: Column, plant: Plant) -> bool:
    """Whether a nameless column follows the command as a rate and the signal is none, or reversed.

    A rate follows the command only once it is added up.
    """
    column = match.column
    told = _tells(column, plant)
    if told or column is command or len(column.values) != len(command.values):
        return False
    if not column.moves:
        return True
    plain = np.corrcoef(column.values, command.values)[0, 1]
    added = np.corrcoef(np.cumsum(column.values - np.median(column.values)), command.values)[0, 1]
    return bool((abs(added) > abs(plain)) != ("/s" in match.wire.unit))


# What the columns of a file are

UNIT_SUFFIXES = {
    "s": "s",
    "sec": "s",
    "ms": "ms",
    "us": "us",
    "ns": "ns",
    "rad": "rad",
    "mrad": "mrad",
    "deg": "deg",
    "rad_s": "rad/s",
    "radps": "rad/s",
    "deg_s": "deg/s",
    "dps": "deg/s",
    "rpm": "rpm",
    "m": "m",
    "mm": "mm",
    "um": "um",
    "m_s": "m/s",
    "mm_s": "mm/s",
    "v": "V",
    "mv": "mV",
    "volts": "V",
    "a": "A",
    "ma": "mA",
    "n": "N",
    "nm": "N.m",
    "mnm": "mN.m",
}
"""Units by the suffix that authors write behind an underscore, in lower case."""


@dataclass(frozen=True, eq=False)
class Column:
    """A column of numbers.

    Attributes:
        key: name, or number from 1 where the file names none.
        table: topic, None where the file has but one table.
        words: words of its name, in lower case, without the unit.
        unit: as the name tells it, None where it does not.
        values: shape (n,).
        dates: they were dates and times, which are no signal.
        gaps: cells without a value, which have the one before here.
    """

    key: str | int
    table: str | None
    words: tuple[str, ...]
    unit: str | None
    values: Array
    dates: bool = False
    gaps: int = 0

    @cached_property
    def turn(self) -> int | None:
        """Counts a turn of an encoder that it may be of, None for other numbers than counts."""
        low, high = float(self.values.min()), float(self.values.max())
        if self.unit or (self.values % 1.0).any() or max(-low, high) <= LARGEST_DEGREES:
            return None
        largest = high + 1.0 if low >= 0.0 else 2.0 * max(-low, high)
        return next((counts for counts in COUNTS_PER_TURN if largest <= counts), None)

    @cached_property
    def rising(self) -> bool:
        """Whether it never falls, and repeats at most now and then: as times do."""
        steps = np.diff(self.values)
        return bool(len(steps) and (steps >= 0.0).all() and np.mean(steps > 0.0) > 0.5)

    @property
    def moves(self) -> bool:
        return bool(np.ptp(self.values))

    @cached_property
    def counts(self) -> bool:
        """Whether it rises by one in each row, or is called like a count of episodes or tasks."""
        one_more = len(self.values) > 1 and bool(np.all(np.diff(self.values) == 1.0))
        return one_more or self.key in INDICES


@dataclass(frozen=True)
class LeftOut:
    """A column that is not numbers throughout.

    Attributes:
        key, table: as of a ``Column``.
        why: file, row and cell in words, with the cure.
        damaged: most of its cells are numbers, so it was meant to be one of them.
    """

    key: str | int
    table: str | None
    why: str
    damaged: bool


def _columns_of(path: Path) -> tuple[list[Column], list[LeftOut]]:
    """Return the columns of a file that are numbers throughout, and the others, table by table.

    Raises:
        UserError: see ``readers.read_columns``; or there is no column of numbers.
    """
    every = [
        _column(columns, place, table)
        for table, columns in _tables(path)
        for place in range(len(columns.names))
    ]
    numeric = [column for column in every if isinstance(column, Column)]
    left_out = [column for column in every if isinstance(column, LeftOut)]
    if not numeric:
        why = next((f": {column.why}" for column in left_out if column.damaged), "")
        raise UserError(
            f"'{path}' has no column of numbers throughout: repair one, then --init{why}"
        )
    return numeric, left_out


def _tables(path: Path) -> Iterator[tuple[str | None, Columns]]:
    """Tables of a file, by name where it has several."""
    tables = read_tables(path)
    for name, columns in tables.items():
        yield (name, columns) if len(tables) > 1 else (None, replace(columns, table=""))


def _column(columns: Columns, place: int, table: str | None) -> Column | LeftOut:
    name = columns.names[place]
    key = place + 1 if name.isdigit() or columns.names.count(name) > 1 else name
    try:
        begin = columns.begin(key)
        gaps = int(columns.empty(key)[begin:].sum())
        columns = columns.held(key) if gaps else columns
        dates = columns.dates(key, slice(begin, None))
        values = columns.numbers(key, slice(begin, None)) if dates is None else dates
    except UserError as error:
        return LeftOut(key, table, str(error), _is_mostly_numbers(columns, place))
    if not len(values):
        return LeftOut(key, table, f"{columns.where(key)} has no rows: record it again", False)
    values = np.concatenate([np.full(begin, values[0]), values])
    words, unit = heading(name)
    unit = unit if dates is None else "s"
    name_words = () if isinstance(key, int) and name.isdigit() else words
    return Column(key, table, name_words, unit, values, dates is not None, gaps)


def _is_mostly_numbers(columns: Columns, place: int) -> bool:
    import polars as pl

    cells = columns.cells[place]
    if not (cells.dtype.is_numeric() or cells.dtype == pl.String):
        return False
    values = cells.cast(pl.Float64, strict=False)
    return 2 * int(values.is_finite().sum()) > len(values)


def heading(name: str) -> tuple[tuple[str, ...], str | None]:
    """Return the words of a column's name, in lower case, and its unit if it tells one.

    ``angle [deg]``, ``angle (deg)`` and ``angle_deg`` tell one, the index of ``angle[0]`` does not.
    """
    bracket = re.fullmatch(r"\s*(.*?)\s*[\[(]\s*([^\])]+?)\s*[\])]\s*", name)
    if bracket:
        return _words(bracket[1]), _known(bracket[2])
    parts = re.split(r"[_\s]+", name.strip())
    if len(parts) == 1:  # TimeUS, of a letter alone nobody knows
        parts = re.sub(r"([a-z])([A-Z]{2,}|[A-Z][a-z]+)$", r"\1_\2", parts[0]).split("_")
    for count in (2, 1):
        suffix = "_".join(parts[-count:]).lower()
        if len(parts) > count and suffix in UNIT_SUFFIXES:
            return _words("_".join(parts[:-count])), UNIT_SUFFIXES[suffix]
    return _words(name), None


def _known(unit: str) -> str | None:
    if not re.search("[^\\W\\d]|[%°]", unit):  # an index
        return None
    try:
        exponents(unit)
    except UserError:
        return None
    return unit


def _words(name: str) -> tuple[str, ...]:
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name)
    return tuple(word for word in re.split(r"[^A-Za-z]+", spaced.lower()) if word)
