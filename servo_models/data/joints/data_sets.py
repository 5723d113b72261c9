"""Joints of LeRobot data sets: an action beside an observed state, in a unit that is not told."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from servo_models.core.types import Array
from servo_models.data.joints.recording import Joint, Recording, column_keys
from servo_models.data.readers import Columns, read_columns
from servo_models.data.readers.lerobot import Info, episodes, is_data_set, read_info, root_of
from servo_models.data.scaffold import CHECK, LARGEST_DEGREES
from servo_models.data.signals import LEAST_SAMPLES
from servo_models.errors import UserError

MOST_READ = 50  # episodes that are looked at, at most
MOST_EPISODES = 10  # episodes in a first description, at most: more take long and tell little
HELD_OUT_PERIOD = 3  # of so many episodes, by how far they move, one is held out
COMMAND = "action"  # feature with the commands
READING = "observation.state"  # feature with the readings
TURN_OF_COUNTS = 4096  # counts in a turn of the encoders in servos on a bus
NORMALISED = 100.5  # end of the range of normalised positions, with rounding
ROUNDED_STAMP = 1e-2  # rounding of a nominal time stamp, in frames
RADIANS = 6.6  # largest angle of a joint in rad, a turn and some more
UNSURE = (
    "degrees, or -100..100 (a gripper 0..100) of the calibrated range? The data do not say. For the"
    f" latter, scale = (range_max - range_min) / 200 (a gripper: / 100) * 360 / {TURN_OF_COUNTS} of"
    " the calibration file makes degrees; without it, 'deg' in every result is one such unit"
)
NOMINAL = "time stamps are nominal, frame / {fps:g} Hz, so that no jitter can be seen"
CLIPPED = "the action is what was asked for, before the robot clipped it"


def data_set(path: Path) -> Recording:
    """Return the joints of a data set, or of a file of one."""
    info = read_info(path if is_data_set(path) else root_of(path))
    known = episodes(path)
    usable = [number for number, (_, frames) in known.items() if frames >= LEAST_SAMPLES]
    short = {*range(info.episodes), *known}.difference(usable) if is_data_set(path) else set()
    left_out = []
    if short:
        left_out.append(f"{_listed(short)} left out: fewer than {LEAST_SAMPLES} frames")
    spread = np.linspace(0, len(usable) - 1, min(len(usable), MOST_READ)).round().astype(int)
    looked_at = [usable[k] for k in spread]
    read = {n: read_columns(known[n][0], f"episode {n}") for n in looked_at}
    odd, unit, doubt = _units(read)
    left_out += odd.values()
    read = {number: columns for number, columns in read.items() if number not in odd}
    if not read:
        return Recording(path, (), (), (*left_out, "no episode is left"))
    joints: list[Joint] = []
    for name, command, reading in _pairs(next(iter(read.values())), info):
        try:
            if command is None:
                raise UserError("a reading without a command, so nothing says what it was to do")
            moving = _most_moving(read, reading)
        except UserError as error:
            left_out.append(f"{name}: no description, since {error}")
            continue
        joints.append(
            Joint(
                name,
                ('time = { column = "timestamp" }',),
                column_keys(command, (read[number] for number in moving), "hold"),
                column_keys(reading, (read[number] for number in moving), "drop"),
                unit,
                "the unit",
                doubt,
                _runs(moving),
            )
        )
    notes = [CLIPPED]
    if all(_is_nominal(columns, info.fps) for columns in read.values()):
        notes.insert(0, NOMINAL.format(fps=info.fps))
    if not info.names:
        notes.append(
            "without meta/info.json joints have numbers: copy the data set whole for names"
        )
    if len(usable) > MOST_EPISODES:
        notes.append(
            f"of {len(usable)} episodes the {MOST_EPISODES} in which the joint moves most: add"
            " others to 'episode'"
        )
    return Recording(path, tuple(joints), tuple(notes), tuple(left_out))


def _is_nominal(columns: Columns, fps: float) -> bool:
    """Whether stamps are the numbers of the frames, times the period."""
    off = columns.numbers("timestamp") * fps - columns.numbers("frame_index")
    return bool(np.abs(off).max() < ROUNDED_STAMP)


def _listed(numbers: set[int]) -> str:
    shown = [str(number) for number in sorted(numbers)]
    more = f" and {len(shown) - 8} more" if len(shown) > 8 else ""
    return f"episode{'s' if len(shown) > 1 else ''} {', '.join(shown[:8])}{more}"


def _pairs(columns: Columns, info: Info) -> Iterator[tuple[str, str | None, str]]:
    """Name, command and reading of each joint; None for one that is not commanded."""
    commands, readings = (_items(columns, name) for name in (COMMAND, READING))
    if not readings:
        raise UserError(
            f"{columns.where(1)}: there is no list '{READING}': name the columns of"
            " command and reading in a description of your own"
        )
    named = {column.removeprefix(f"{COMMAND}."): column for column in commands}
    alike = len(commands) == len(readings) and not (
        info.names.get(COMMAND) and info.names.get(READING)
    )
    for place, reading in enumerate(readings):
        suffix = reading.removeprefix(READING)
        command = commands[place] if alike else named.get(suffix.removeprefix("."))
        yield suffix.strip(".[]").removesuffix(".pos"), command, reading


def _items(columns: Columns, name: str) -> list[str]:
    return [it for it in columns.names if re.match(rf"{re.escape(name)}[.\[]", it) or it == name]


def _most_moving(read: Mapping[int, Columns], reading: str) -> list[int]:
    """Episodes in which a joint moves, those first in which it travels furthest."""
    travel = {
        number: float(np.abs(np.diff(_known(columns, reading))).sum())
        for number, columns in read.items()
    }
    moving = sorted((number for number in travel if travel[number]), key=lambda n: -travel[n])
    if not moving:
        raise UserError("it stands still in every episode: record one in which it moves")
    return moving[:MOST_EPISODES]


def _known(columns: Columns, column: str) -> Array:
    """A column from its first value on; a cell without one has that of the row before."""
    return columns.held(column).numbers(column, slice(columns.begin(column), None))


def _runs(numbers: Sequence[int]) -> list[str]:
    held_out = sorted(numbers[HELD_OUT_PERIOD - 1 :: HELD_OUT_PERIOD])
    fitted = sorted(set(numbers).difference(held_out))
    if not held_out:
        return [f"episode = {fitted}"]
    return [
        "repeat = [",
        f"    {{ episode = {fitted} }},",
        f"    {{ episode = {held_out}, held_out = true }},  {CHECK}: held out to judge a fit by",
        "]",
    ]


def _units(read: Mapping[int, Columns]) -> tuple[dict[int, str], str, str]:
    """Episodes in another unit than most, with a sentence; the keys of the unit, and a doubt."""
    kinds = {number: _kind(columns) for number, columns in read.items()}
    frames = {kind: 0 for kind, _ in kinds.values()}
    for number, (kind, _) in kinds.items():
        frames[kind] += len(read[number].cells[0])
    usual = max(frames, key=frames.__getitem__, default="deg")
    reach = max((size for kind, size in kinds.values() if kind == usual), default=0.0)
    odd = {
        number: f"episode {number} left out: its joints reach {size:.3g} and those of the others"
        f" {reach:.3g}, so it is in another unit; describe it by itself"
        for number, (kind, size) in kinds.items()
        if kind != usual
    }
    if usual == "rad":
        return odd, 'unit = "rad"', f"no joint reaches more than {reach:.3g}, as in rad"
    if usual == "counts":
        unit = f'unit = "deg", scale = {360.0 / TURN_OF_COUNTS}'
        return odd, unit, f"whole numbers up to {reach:.4g}, as counts with {TURN_OF_COUNTS} a turn"
    if reach > NORMALISED:
        return odd, 'unit = "deg"', f"joints reach {reach:.4g}, as in degrees"
    return odd, 'unit = "deg"', UNSURE


def _kind(columns: Columns) -> tuple[str, float]:
    """Whether the readings of an episode look like rad, degrees or counts, and how far they go."""
    values: list[Array] = []
    for name in _items(columns, READING):
        try:
            values.append(_known(columns, name))
        except UserError:  # told where that joint is looked at
            continue
    every = np.concatenate(values) if values else np.zeros(1)
    reach = float(np.abs(every).max())
    if reach <= RADIANS:
        return "rad", reach
    if reach > LARGEST_DEGREES and not (every % 1.0).any():
        return "counts", reach
    return "deg", reach
