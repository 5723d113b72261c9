"""Mistakes that people make with logs: what ``check`` says of each, on fresh rigs.

    python -m studies withheld.generator CASES --cases 300 --seed 20265001
    python -m studies mistakes CASES --out found.jsonl            # resumable; then the table
    python -m studies mistakes CASES --out found.jsonl --only swapped --show
    python -m studies mistakes CASES --out found.jsonl --clean 300 # the same logs as they are
    python -m studies mistakes CASES --out led.jsonl --leads      # does diagnose begin with it?
    python -m studies mistakes REAL --out real.jsonl --each 9 --lay-out \
        examples/real_logs/diagnosis/{xl330,so101_rotation,sg90_video}.toml

A mistake is made in a copy of a case whose columns allow it.  It is *named* where a sentence of
``check``, or the error that refuses the file, says what it is; a *misleading* answer warns of
something else alone; the rest is *silent*.  Sentences that the log as it is gets as well do not
count.  Clean logs of whose columns something is asked are *accused*.  What reading has mended
stands in a note, and nothing is led with.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.diagnosis.diagnose import diagnose
from servo_models.errors import UserError
from servo_models.files import scratch
from servo_models.identification.check import check
from servo_models.units import factor
from servo_models.withheld.score import share
from studies.golden import located

SERVOS = ("smart_servo", "second_order_servo", "sg90")
MOTORS = ("dc_motor", "dc_motor_current", "dc_motor_speed", "torque_motor")
EVERY = SERVOS + MOTORS
Random = np.random.Generator
NOTE = "note: "
Row = dict[str, Any]
"""A ``mistake``, "" for none, the ``case``, and what is ``said`` of it alone."""


@dataclass
class Rig:
    """A case in a folder of its own: the text of its description, and the columns of its logs.

    Attributes:
        actuator: its name.
        text: of the description.
        logs: columns of each log by their names; the first is the time, the second the command.
        other: a log of another rig of the same actuator with the same columns, None without one.
    """

    actuator: str
    text: str
    logs: dict[str, dict[str, Array]]
    other: dict[str, Array] | None = None

    @property
    def first(self) -> dict[str, Array]:
        return next(iter(self.logs.values()))

    @property
    def time(self) -> str:
        return next(iter(self.first))

    @property
    def command(self) -> str:
        return list(self.first)[1]

    @property
    def reading(self) -> str:
        """The column of the first output."""
        found = re.search(r'^outputs\.\w+ = \{ column = "([^"]+)"', self.text, re.M)
        assert found
        return found[1]

    @property
    def interval(self) -> float:
        """Between two rows [s]."""
        return 1e-3 * float(np.median(np.diff(self.first[self.time])))

    def each(self, change: Callable[[dict[str, Array]], None]) -> None:
        """Change the columns of every log."""
        for columns in self.logs.values():
            change(columns)

    def map(self, name: str, change: Callable[[Array], Array]) -> None:
        """Change one column of every log."""
        self.each(lambda columns: columns.update({name: change(columns[name])}))

    def unit(self, name: str, unit: str) -> None:
        """Declare another unit of a column."""
        pattern = rf'(column = "{re.escape(name)}", unit = )"[^"]+"'
        self.text = re.sub(pattern, rf'\1"{unit}"', self.text)

    def unit_of(self, name: str) -> str:
        found = re.search(rf'column = "{re.escape(name)}", unit = "([^"]+)"', self.text)
        assert found
        return found[1]

    def write(self, folder: Path) -> Path:
        """Write the description and its logs."""
        for file, columns in self.logs.items():
            table = np.column_stack(list(columns.values()))
            header = ",".join(columns)
            np.savetxt(folder / file, table, "%.10g", ",", header=header, comments="")
        path = folder / "description.toml"
        path.write_text(self.text, encoding="utf-8")
        return path


@dataclass(frozen=True)
class Mistake:
    """A mistake: ``make`` it, in rigs of these ``actuators``; ``says`` is how it may be named."""

    make: Callable[[Rig, Random], None]
    says: str
    actuators: tuple[str, ...] = EVERY


def swapped(rig: Rig, _: Random) -> None:
    def swap(columns: dict[str, Array]) -> None:
        a, b = columns[rig.command], columns[rig.reading]
        columns[rig.command], columns[rig.reading] = b, a

    rig.each(swap)


def rate_as_angle(rig: Rig, _: Random) -> None:
    def differ(columns: dict[str, Array]) -> None:
        seconds = columns[rig.time] * 1e-3
        smooth = np.convolve(np.pad(columns[rig.reading], 4, "edge"), np.ones(9) / 9.0, "valid")
        columns[rig.reading] = np.gradient(smooth, seconds)

    rig.each(differ)


def command_as_angle(rig: Rig, _: Random) -> None:
    """The reading is the goal, in its own unit."""

    def copy(columns: dict[str, Array]) -> None:
        goal = columns[rig.command]
        if rig.actuator != "smart_servo":  # what a firmware would report of a pulse
            goal = 0.09 * (goal - 1500.0)
        columns[rig.reading] = goal.copy()

    rig.each(copy)


def wrapped(rig: Rig, _: Random) -> None:
    """A turn in which the reading passes the end of its range."""
    turn = 360.0 if rig.unit_of(rig.reading) == "deg" else 2.0 * np.pi

    def wrap(values: Array) -> Array:
        shifted = values - np.median(values) + 0.5 * turn if np.ptp(values) < turn else values
        return (shifted + 0.5 * turn) % turn - 0.5 * turn

    rig.map(rig.reading, wrap)


def joined(rig: Rig, _: Random) -> None:
    """The same log twice, one run after the other, as if time had gone on."""

    def join(columns: dict[str, Array]) -> None:
        time = columns[rig.time]
        cut = {name: values[: 3 * len(time) // 4] for name, values in columns.items()}
        for name, values in columns.items():
            columns[name] = np.concatenate([cut[name], values])
        later = cut[rig.time][-1] + np.median(np.diff(time)) + time - time[0]
        columns[rig.time] = np.concatenate([cut[rig.time], later])

    rig.each(join)


def normalised(rig: Rig, _: Random) -> None:
    """The command as a share of its largest, as a policy or a transmitter gives it."""
    rest = 1500.0 if rig.actuator != "smart_servo" and rig.actuator in SERVOS else 0.0
    rig.map(rig.command, lambda it: (it - rest) / np.max(np.abs(it - rest)))


def overflow(rig: Rig, _: Random) -> None:
    """Counts of 16 bits that pass their end, and come back scaled."""

    def over(values: Array) -> Array:
        count = np.max(np.abs(values)) / 40_000.0
        return np.asarray(((np.round(values / count) + 32_768.0) % 65_536.0 - 32_768.0) * count)

    rig.map(rig.reading, over)


def glitches(rig: Rig, random: Random) -> None:
    def hit(values: Array) -> Array:
        which = random.choice(np.arange(5, len(values) - 5), 4, replace=False)
        found = values.copy()
        found[which] += random.choice([-1.0, 1.0], 4) * random.uniform(2.0, 6.0, 4) * np.ptp(values)
        return found

    rig.map(rig.reading, hit)


def sentinels(rig: Rig, random: Random) -> None:
    def lose(values: Array) -> Array:
        found = values.copy()
        found[random.random(len(values)) < 0.01] = -999.0
        return found

    rig.map(rig.reading, lose)


def clipped(rig: Rig, _: Random) -> None:
    def clip(values: Array) -> Array:
        low, high = np.min(values), np.max(values)
        return np.clip(values, low + 0.2 * (high - low), high - 0.2 * (high - low))

    rig.map(rig.reading, clip)


def offset(rig: Rig, _: Random) -> None:
    quarter = 90.0 if rig.unit_of(rig.reading) == "deg" else 0.5 * np.pi
    rig.map(rig.reading, lambda it: it + quarter)


def dead(rig: Rig, _: Random) -> None:
    def hold(values: Array) -> Array:
        found = values.copy()
        found[len(values) // 4 :] = values[len(values) // 4]
        return found

    rig.map(rig.reading, hold)


def drift(rig: Rig, _: Random) -> None:
    """The command was logged by a clock that goes 3 % faster than that of the reading."""

    def stretch(columns: dict[str, Array]) -> None:
        time = columns[rig.time]
        late = time[0] + 0.97 * (time - time[0])
        columns[rig.command] = columns[rig.command][np.searchsorted(time, late, "right") - 1]

    rig.each(stretch)


def lost_rows(rig: Rig, random: Random) -> None:
    def lose(columns: dict[str, Array]) -> None:
        count = len(columns[rig.time])
        keep = np.ones(count, dtype=bool)
        for begin in random.integers(count // 5, 4 * count // 5, 4):
            keep[begin : begin + max(count // 60, 3)] = False
        for name, values in columns.items():
            columns[name] = values[keep]

    rig.each(lose)


def two_servos(rig: Rig, _: Random) -> None:
    """A second log in the description, of another one of the same kind."""
    assert rig.other is not None
    file = next(iter(rig.logs))
    block = rig.text[rig.text.index("[[logs]]") :].split("[[logs]]")[1]
    rig.text += f"\n[[logs]]{block.replace(file, 'other.csv')}"
    rig.logs["other.csv"] = rig.other


def gear_ratio(rig: Rig, _: Random) -> None:
    """Read on the motor's side of a gear."""
    rig.map(rig.reading, lambda it: 6.0 * it)


def counts(rig: Rig, _: Random) -> None:
    """Counts of an encoder with 4 096 a turn, read as what the column was."""
    turn = 360.0 if rig.unit_of(rig.reading) == "deg" else 2.0 * np.pi
    rig.map(rig.reading, lambda it: np.round(4096.0 / turn * it))


def filtered(rig: Rig, _: Random) -> None:
    """Forwards and backwards, as by ``filtfilt``."""
    from scipy.signal import butter, filtfilt

    def smooth(columns: dict[str, Array]) -> None:
        nyquist = 0.5 / rig.interval  # Hz
        share = min(4.0 / nyquist, 0.5)
        columns[rig.reading] = filtfilt(*butter(2, share), columns[rig.reading])

    rig.each(smooth)


def averaged(rig: Rig, _: Random) -> None:
    """A moving average about each row."""
    width = 2 * round(0.06 / rig.interval) + 1
    kernel = np.ones(width) / width
    rig.map(rig.reading, lambda it: np.convolve(np.pad(it, width // 2, "edge"), kernel, "valid"))


def resampled(rig: Rig, _: Random) -> None:
    """Every column was read at an eighth of the rate, with straight lines between."""

    def thin(columns: dict[str, Array]) -> None:
        time = columns[rig.time]
        for name in list(columns)[1:]:
            columns[name] = np.interp(time, time[::8], columns[name][::8])

    rig.each(thin)


def shifted(seconds: float) -> Callable[[Rig, Random], None]:
    """The command of another row: one of a logger at 15 Hz."""

    def shift(rig: Rig, _: Random) -> None:
        rows = round(seconds / rig.interval)

        def move(values: Array) -> Array:
            found = np.roll(values, rows)
            if rows > 0:
                found[:rows] = values[0]
            else:
                found[rows:] = values[-1]
            return found

        rig.map(rig.command, move)

    return shift


def reversed_sign(rig: Rig, _: Random) -> None:
    rig.map(rig.reading, lambda it: -it)


def declared(which: str, unit: str) -> Callable[[Rig, Random], None]:
    """A column in its own unit, declared as another."""

    def declare(rig: Rig, _: Random) -> None:
        rig.unit(getattr(rig, which), unit)

    return declare


def radians_as_degrees(rig: Rig, _: Random) -> None:
    if rig.unit_of(rig.reading) == "deg":
        rig.map(rig.reading, np.radians)
    else:
        rig.unit(rig.reading, "deg")


def degrees_as_radians(rig: Rig, _: Random) -> None:
    if rig.unit_of(rig.reading) == "deg":
        rig.unit(rig.reading, "rad")
    else:
        rig.map(rig.reading, np.degrees)


def seconds_as_ms(rig: Rig, _: Random) -> None:
    rig.map(rig.time, lambda it: 1e-3 * it)


def pulses_in_ms(rig: Rig, _: Random) -> None:
    rig.map(rig.command, lambda it: 1e-3 * it)


def twice(rig: Rig, _: Random) -> None:
    """Every row is there twice."""

    def double(columns: dict[str, Array]) -> None:
        for name, values in columns.items():
            columns[name] = np.repeat(values, 2)

    rig.each(double)


def constant_command(rig: Rig, _: Random) -> None:
    rig.map(rig.command, lambda it: np.full(len(it), it[0]))


def backwards(rig: Rig, _: Random) -> None:
    """The rows in the order of a list that grows at its head."""

    def turn(columns: dict[str, Array]) -> None:
        for name, values in columns.items():
            columns[name] = values[::-1]

    rig.each(turn)


def coarse_stamps(rig: Rig, _: Random) -> None:
    """Stamps in whole units that many rows share."""

    def round_(columns: dict[str, Array]) -> None:
        time = columns[rig.time]
        step = 6.0 * float(np.median(np.diff(time)))
        columns[rig.time] = np.floor(time / step) * step

    rig.each(round_)


def not_numbers(rig: Rig, random: Random) -> None:
    def lose(values: Array) -> Array:
        found = values.copy()
        begin = int(random.integers(len(values) // 4, len(values) // 2))
        found[begin : begin + len(values) // 20] = np.nan
        return found

    rig.map(rig.reading, lose)


def rows_as_time(rig: Rig, _: Random) -> None:
    """The number of the row instead of the time."""
    rig.map(rig.time, lambda it: np.arange(len(it), dtype=float) * 50.0)


def switched_off(rig: Rig, _: Random) -> None:
    """The drive was off in the last third: it stands while commands go on."""

    def stand(values: Array) -> Array:
        from_here = int(0.66 * len(values))
        found = values.copy()
        noise = np.diff(values[: max(len(values) // 50, 10)])
        found[from_here:] = values[from_here] + np.resize(noise, len(values) - from_here)
        return found

    rig.map(rig.reading, stand)


def gains_changed(rig: Rig, _: Random) -> None:
    """Somebody lowers a gain in the middle of the log: from there on it answers slowly."""
    from scipy.signal import lfilter

    def change(columns: dict[str, Array]) -> None:
        values, half = columns[rig.reading].copy(), len(columns[rig.time]) // 2
        share = min(rig.interval / 0.15, 1.0)
        later = values[half:] - values[half]
        values[half:] = values[half] + lfilter([share], [1.0, share - 1.0], later)
        columns[rig.reading] = values

    rig.each(change)


MISTAKES = {
    "columns swapped": Mistake(swapped, r"swap|each other's place", SERVOS),
    "rate as angle": Mistake(rate_as_angle, r"\brate\b|speed", SERVOS),
    "command as angle": Mistake(command_as_angle, r"copy|is the command", SERVOS),
    "wrapped angle": Mistake(wrapped, r"wrap|turn", ("dc_motor", "dc_motor_current")),
    "two runs joined": Mistake(joined, r"joined|two runs|another run", SERVOS),
    "command of +-1": Mistake(normalised, r"scale|unit", SERVOS),
    "16 bits overflow": Mistake(overflow, r"overflow|wrap|bits", SERVOS),
    "glitches": Mistake(glitches, r"jumps away from its neighbours|stands for", EVERY),
    "sentinels": Mistake(sentinels, r"-999|sentinel|stands for", SERVOS),
    "clipped": Mistake(clipped, r"clip", SERVOS),
    "offset of 90 deg": Mistake(offset, r"offset|zero", SERVOS),
    "dead sensor": Mistake(dead, r"stuck|dead|does not change|same value", EVERY),
    "clock drift": Mistake(drift, r"clock|drift", SERVOS),
    "lost rows": Mistake(lost_rows, r"lost|missing|gap", EVERY),
    "two servos": Mistake(two_servos, r"another|not the same|not one", SERVOS),
    "gear ratio": Mistake(gear_ratio, r"scale|gear", SERVOS),
    "counts as angle": Mistake(counts, r"count|scale", SERVOS),
    "filtered both ways": Mistake(filtered, r"filter|smoothed|before", SERVOS),
    "moving average": Mistake(averaged, r"average|filter|smoothed|before", SERVOS),
    "resampled": Mistake(resampled, r"resampl|straight line|interpolat", EVERY),
    "command rows late": Mistake(shifted(0.067), r"late|before the command", SERVOS),
    "command rows early": Mistake(shifted(-0.067), r"early|rows? later", SERVOS),
    "gains changed": Mistake(gains_changed, r"midway|from .* on|changed", SERVOS),
    "reversed sign": Mistake(reversed_sign, r"sign|against", EVERY),
    "rad as deg": Mistake(radians_as_degrees, r"unit|scale", SERVOS),
    "deg as rad": Mistake(degrees_as_radians, r"unit|scale", SERVOS),
    "s as ms": Mistake(seconds_as_ms, r"time.*unit", EVERY),
    "ms as s": Mistake(declared("time", "s"), r"time.*unit", EVERY),
    "pulse in ms as us": Mistake(pulses_in_ms, r"unit|us\b|bounds", ("second_order_servo", "sg90")),
    "pulse in us as ms": Mistake(
        declared("command", "ms"), r"unit|bounds", ("second_order_servo", "sg90")
    ),
    "rows twice": Mistake(twice, r"twice|same time|not after|increase"),
    "constant command": Mistake(constant_command, r"no input ever changes"),
    "rows backwards": Mistake(backwards, r"backward|order|not after|increase"),
    "coarse stamps": Mistake(coarse_stamps, r"round|same time|stamp|not after"),
    "no number": Mistake(not_numbers, r"nan|number|missing", EVERY),
    "row number as time": Mistake(rows_as_time, r"\btime\b", EVERY),
    "switched off": Mistake(switched_off, r"stand|does not move|stuck|no longer", SERVOS),
    "rev/min as rad/s": Mistake(declared("reading", "rpm"), r"unit|scale", ("dc_motor_speed",)),
}


def rigs(cases: Path) -> Iterator[tuple[str, Rig]]:
    """Cases of a folder, each with a log of another one of its kind."""
    found: list[tuple[str, Rig]] = []
    for path in sorted((cases / "cases").glob("*/description.toml")):
        text = path.read_text("utf-8")
        logs = {}
        for name in re.findall(r'^file = "([^"]+)"', text, re.M):
            header = (path.parent / name).read_text("utf-8").split("\n", 1)[0].split(",")
            table = np.loadtxt(path.parent / name, delimiter=",", skiprows=1, ndmin=2)
            logs[name] = dict(zip(header, table.T))
        actuator = re.search(r'^actuator = "(\w+)"', text, re.M)
        assert actuator
        found.append((path.parent.name, Rig(actuator[1], text, logs)))
    for k, (name, rig) in enumerate(found):
        after = [*found[k + 1 :], *found[:k]]
        alike = (it for _, it in after if it.actuator == rig.actuator)
        others = (it.first for it in alike if list(it.first) == list(rig.first))
        rig.other = next(others, None)
        yield name, rig


SHOWN_IN = {"rad": "deg", "rad/s": "deg/s", "s": "us"}
"""Units in which a column is written, by those that a signal has."""
HEAD = re.compile(r"^\[\[logs\]\]", re.M)


def lay_out(description: Path, cases: Path) -> None:
    """Write the first log of a description as a case: one file of columns in usual units."""
    text, found = description.read_text("utf-8"), read_description(_with_logs(description, cases))
    log, wires = found.logs[0], found.model.plant.wire
    columns, lines = {"time_ms": 1e3 * log.times}, ['time = { column = "time_ms", unit = "ms" }']
    for kind, signals in (("inputs", log.inputs), ("outputs", log.outputs)):
        for name, values in signals.items():
            unit = SHOWN_IN.get(wires[name].unit, wires[name].unit)
            column = f"{name}_{unit}"
            columns[column] = values / factor(unit, wires[name].unit)
            lines.append(f'{kind}.{name} = {{ column = "{column}", unit = "{unit}" }}')
    lines += [f"constants.{name} = {float(value)}" for name, value in log.constants.items()]
    lines += [f'settle = "{float(log.settle)} s"'] if log.settle else ['start = "rest"']
    head = HEAD.split(text)[0]
    logs = "\n".join(["[[logs]]", 'file = "log.csv"', *lines, ""])
    folder = cases / "cases" / f"{len(list(cases.glob('cases/*'))):04d}"
    folder.mkdir(parents=True)
    Rig(found.model.actuator.name, head + logs, {"log.csv": columns}).write(folder)


def _with_logs(description: Path, folder: Path) -> Path:
    """A description of real logs, where these are."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / description.name
    path.write_text(located(description.read_text("utf-8")), encoding="utf-8")
    return path


def said(rig: Rig) -> list[str]:
    """What ``check`` says of a rig: warnings, notes, or why it is refused."""
    with scratch() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = rig.write(folder)
        try:
            found = check(path, jobs=1)
        except UserError as error:
            return [str(error).replace(str(folder), "")]
        notes = [NOTE + note for log in found.description.logs for note in log.notes]
        return [*found.warnings, *notes]


def led(rig: Rig) -> str:
    """What ``diagnose`` leads with: the mistake, or why it is refused; "" for an effect."""
    with scratch() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = rig.write(folder)
        try:
            return diagnose(path, jobs=1).mistake
        except UserError as error:
            return str(error).replace(str(folder), "")


def numberless(text: str) -> str:
    """A sentence without its figures, which a mistake moves a little."""
    return re.sub(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?", "#", text)


def made(rig: Rig, mistake: Mistake, seed: int) -> Rig:
    """A copy of a rig with a mistake in it."""
    logs = {file: {k: v.copy() for k, v in columns.items()} for file, columns in rig.logs.items()}
    copy = Rig(rig.actuator, rig.text, logs, rig.other)
    mistake.make(copy, np.random.default_rng(seed))
    return copy


def work(cases: Path, out: Path, each: int, only: str, clean: int, leads: bool) -> None:
    """Append what is said of each mistake in ``each`` rigs, and of clean logs."""
    done = {(row["mistake"], row["case"]) for row in read(out)}
    every = list(rigs(cases))
    for number, (name, mistake) in enumerate(MISTAKES.items()):
        if only and name != only:
            continue
        fit = [it for it in every if it[1].actuator in mistake.actuators]
        fit = [it for it in fit if name != "two servos" or it[1].other]
        rare = slice(number % 3, None, 3) if len(fit) >= 3 * each else slice(None)
        for case, rig in fit[rare][:each]:
            if (name, case) not in done:
                texts = said(made(rig, mistake, int(case)))
                before = {numberless(text) for text in said(rig)}
                new = [text for text in texts if numberless(text) not in before]
                row = {"mistake": name, "case": case, "said": new}
                if leads and judged(row) == "named":
                    row["led"] = led(made(rig, mistake, int(case)))
                add(out, row)
    for case, rig in every[:clean]:
        if ("", case) not in done:
            row = {"mistake": "", "case": case, "said": said(rig)}
            if leads and _is_asked(row):
                row["led"] = led(rig)
            add(out, row)


def add(path: Path, row: Row) -> None:
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")
    print(row["mistake"], row["case"], file=sys.stderr, flush=True)


def read(path: Path) -> list[Row]:
    return [json.loads(it) for it in path.read_text("utf-8").splitlines()] if path.exists() else []


def judged(row: Row) -> str:
    """Whether a mistake is "named", answered in a "misleading" way, or "silent"."""
    if _says(row["mistake"], row["said"]):
        return "named"
    return "misleading" if row["said"] else "silent"


def _is_asked(row: Row) -> bool:
    return any("checked = true" in text for text in row["said"])


def _is_mended(row: Row) -> bool:
    """Whether a mistake is named by notes alone, on what reading has changed."""
    return not _says(row["mistake"], (it for it in row["said"] if not it.startswith(NOTE)))


def _says(mistake: str, texts: Iterable[str]) -> bool:
    return bool(re.search(MISTAKES[mistake].says, " ".join(texts).lower()))


def table(rows: list[Row]) -> Iterator[str]:
    """Lines of a table, and of what all kinds come to."""
    yield "| mistake | of | named | misleading | silent |"
    yield "|---|---|---|---|---|"
    made_in = [row for row in rows if row["mistake"]]
    for name in MISTAKES:
        found = [judged(row) for row in made_in if row["mistake"] == name]
        if found:
            counts = (found.count(it) for it in ("named", "misleading", "silent"))
            yield f"| {name} | {len(found)} | {' | '.join(map(str, counts))} |"
    yield ""
    for word in ("named", "misleading", "silent"):
        yield f"{word}: {_share(judged(row) == word for row in made_in)}"
    leads = [(row, _says(row["mistake"], [row["led"]])) for row in made_in if "led" in row]
    yield f"diagnose leads with what is named: {_share(led for _, led in leads)}"
    asked = [led for row, led in leads if not _is_mended(row)]
    yield f"and what reading has not mended: {_share(asked)}"
    clean = [row for row in rows if not row["mistake"]]
    yield f"clean logs accused: {_share(map(_is_asked, clean))}"
    yield f"clean logs that diagnose leads with: {_share(bool(row.get('led')) for row in clean)}"


def _share(flags: Iterable[bool]) -> str:
    found = share(flags)
    if found.value is None:
        return "none tried"
    return f"{found.value:.2f} ({found.low:.2f} to {found.high:.2f}) of {found.n}"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("cases", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--each", type=int, default=6, help="rigs that a mistake is made in")
    parser.add_argument("--clean", type=int, default=0, help="logs that are checked as they are")
    parser.add_argument(
        "--lay-out", type=Path, nargs="+", default=(), metavar="TOML", help="cases of real logs"
    )
    parser.add_argument("--only", default="", choices=("", *MISTAKES), help="one mistake")
    parser.add_argument("--leads", action="store_true", help="diagnose what is named as well")
    parser.add_argument("--show", action="store_true", help="what was said")
    given = parser.parse_args()
    for description in given.lay_out:
        lay_out(description, given.cases)
    work(given.cases, given.out, given.each, given.only, given.clean, given.leads)
    rows = [row for row in read(given.out) if given.only in ("", row["mistake"])]
    for row in rows if given.show else ():
        verdict = judged(row) if row["mistake"] else "clean"
        print(row["mistake"], row["case"], verdict, *row["said"], sep="\n    ")
    print(*table(rows), sep="\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
