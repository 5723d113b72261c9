"""Begin a description for each joint of a robot's recording: a command beside its reading."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from servo_models.core.catalogue import actuator as find_actuator
from servo_models.core.catalogue import actuators
from servo_models.core.own_actuator import key_from
from servo_models.core.plant import Actuator, Variant
from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.data.lag import lags
from servo_models.data.readers import Columns, is_bag, read_columns, read_tables
from servo_models.data.readers.lerobot import Info, episodes, is_data_set, read_info, root_of
from servo_models.data.readers.ros import HEADER_STAMP
from servo_models.data.scaffold import CHECK, LONGEST_SENTENCE
from servo_models.data.scaffold import COMMAND as WORDS_OF_COMMANDS
from servo_models.data.schema import quoted
from servo_models.data.signals import LEAST_SAMPLES
from servo_models.errors import UserError, printable
from servo_models.files import write_whole
from servo_models.units import exponents

GENERAL = "second_order_servo"
"""What is proposed for a joint of which nothing but its goal and its angle is known."""
MOST_EPISODES = 10  # in a first description: more of them take longer and tell little more
HELD_OUT_FROM = 3  # episodes from which the last one is held out
COMMAND, READING = "action", "observation.state"
OF_TOPICS = (".mcap", ".db3")
CONTROLLER = (
    ("reference.positions", "feedback.positions"),
    ("desired.positions", "actual.positions"),
)
"""Fields of control_msgs/JointTrajectoryControllerState, of now and before ROS 2 Iron."""
JOINT_STATE = "position"
"""Field of sensor_msgs/JointState."""
BY_HEADER = "the stamps in the headers, not those of arrival"
BY_ARRIVAL = (
    "those of arrival at the recorder, since the headers have no common stamps: a late message"
    " looks like a late joint"
)
ARRAY, TRAJECTORY = "data[", "points[0].positions"
"""Fields of std_msgs/Float64MultiArray and trajectory_msgs/JointTrajectory."""
TURN_OF_COUNTS = 4096  # counts a turn of the encoders in servos on a bus
NORMALISED = 100.5  # end of the range of normalised positions, and rounding
ROUNDED_STAMP = 1e-2  # frames by which a nominal time stamp is rounded
RADIANS = 6.6  # largest angle of a joint in rad, a turn and some more
LARGEST_DEGREES = 400.0
"""Largest angle of a joint in degrees; whole numbers beyond are counts."""
UNSURE = (
    "degrees, or -100..100 (a gripper 0..100) of the calibrated range? Of the latter add scale ="
    f" (range_max - range_min) / 200 (a gripper: / 100) * 360 / {TURN_OF_COUNTS} from the"
    " calibration file; without it, read 'deg' in every result as that hundredth"
)
NOMINAL = "time stamps are nominal, frame / {fps:g} Hz, so that no jitter can be seen"
NO_GOAL = ": if its command is no angle to go to, such as a step or a rate, name another column"
CLIPPED = "the action is what was asked for, before the robot clipped it"


@dataclass(frozen=True)
class Joint:
    """A joint of a recording.

    Attributes:
        name: as the recording calls it.
        log: lines of its ``[[logs]]`` above the signals, with ``{file}`` for where it lies.
        command, reading: columns, as keys of a signal; ``unit`` is that of both, with its scale.
        guessed: what is, and ``doubt`` why.
        runs: lines below the signals.
    """

    name: str
    log: Sequence[str]
    command: str
    reading: str
    unit: str
    guessed: str
    doubt: str
    runs: Sequence[str] = ()


@dataclass(frozen=True)
class Recording:
    """The joints of a recording, and what is said once about all, or of those that are left out."""

    path: Path
    joints: tuple[Joint, ...]
    notes: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()


def recording(path: Path) -> Recording | None:
    """Return the joints of a robot's recording, None for a log of something else.

    Raises:
        UserError: it cannot be read, or no joint has both a command and a reading.
    """
    if is_data_set(path) or episodes(path):
        found = _data_set(path)
    elif is_bag(path) or path.suffix.lower() in OF_TOPICS:
        found = _bag(path)
        if not (found.joints or found.left_out):
            return None
    else:
        return None
    if not found.joints:
        raise UserError(
            f"'{path}' has no joint with a command and a reading: {'; '.join(found.left_out)}"
        )
    return found


def write_joints(
    found: Recording, folder: Path | None, actuator: str | None, trust: bool
) -> Iterator[tuple[str, bool]]:
    """Write a description for each joint, and yield what is to be told, and whether it is a fault.

    Args:
        found: the recording.
        folder: to write into; None for beside it, behind its name.
        actuator: name of what all joints are, None for a general one.

    Raises:
        UserError: a file that is there already, an actuator without a goal, or
            no joint whose description can be read.
    """
    path = found.path
    chosen, variant = _chosen(actuator or GENERAL)
    whole = path.resolve()
    stem = "" if folder else f"{whole.stem if whole.is_file() else whole.name}_"
    place = folder or path.parent if path.name else whole.parent
    files: dict[Path, Joint] = {}
    for joint in found.joints:
        files[_free(place, stem + _as_file(joint.name), files)] = joint
    for file in files:
        if os.path.exists(file):
            raise UserError(f"'{file}' exists: edit it, remove it, or name a folder with --out")
    written = 0
    for file, joint in files.items():
        write_whole(file, _text(found, joint, chosen, variant, file.parent).encode())
        try:
            description = read_description(file, trust)
        except UserError as error:
            file.unlink()
            yield f"{_told(joint.name)}: no description, since {error}", True
            continue
        written += 1
        plant = description.model.plant
        found_lags = list(lags(description.logs, plant))
        said = "; ".join(lag.sentence(plant.wire[lag.output]) for lag in found_lags)
        cure = "" if all(lag.follows for lag in found_lags) else NO_GOAL
        yield f"wrote '{file}': {said}{cure}", bool(cure)
    if not written:
        raise UserError(f"'{path}': no joint can be described; each says why above")
    doubts = dict.fromkeys(f"guessed, {it.guessed}: {it.doubt}" for it in files.values())
    for text in (*found.notes, *doubts):
        yield printable(text, LONGEST_SENTENCE), False
    for text in found.left_out:
        yield printable(text, LONGEST_SENTENCE), True


def _told(name: str) -> str:
    return printable(name, 60)


def _as_file(name: str) -> str:
    """A name that is one of a file on every system."""
    return re.sub(r"[^\w.-]+", "_", name)[:60].strip("._") or "joint"


def _free(folder: Path, stem: str, taken: Mapping[Path, Joint]) -> Path:
    names = (folder / f"{stem}{more}.toml" for more in ("", *(f"_{n}" for n in range(2, 10_000))))
    return next(name for name in names if name not in taken)


def _chosen(name: str) -> tuple[Actuator, Variant]:
    """An actuator, and its first variant that takes an angle as goal.

    Raises:
        UserError: none does.
    """
    found = find_actuator(name)
    variant = _with_a_goal(found)
    if not variant:
        raise UserError(f"{name} takes no angle as its goal: give {' or '.join(_others(''))}")
    return found, variant


def _others(name: str) -> list[str]:
    """Actuators but this one that take an angle as goal."""
    return [key for key, it in actuators().items() if key != name and _with_a_goal(it)]


def _with_a_goal(found: Actuator) -> Variant | None:
    for variant in found.variants:
        wire = found.plant_of(variant.name).wire[variant.command or found.step[0]]
        if exponents(wire.unit) == exponents("rad"):
            return variant
    return None


def _text(found: Recording, joint: Joint, chosen: Actuator, variant: Variant, folder: Path) -> str:
    """A description of a joint, to stand in ``folder``."""
    plant = chosen.plant_of(variant.name)
    output = "angle_reading" if "angle_reading" in plant.outputs else plant.outputs[0]
    goal = variant.command or chosen.step[0]
    file = quoted(Path(os.path.relpath(found.path.resolve(), folder.resolve())).as_posix())
    others = ", ".join(_others(chosen.name))
    doubt = f"  {CHECK}: {joint.guessed}"
    lines = [
        f"# Joint {_told(joint.name)}. Lines marked 'guessed' are to be checked.",
        f"actuator = {quoted(key_from(chosen, folder))}  {CHECK}; there is also {others}",
        f"variant = {quoted(variant.name)}",
        "",
        "[[logs]]",
        f"file = {file}",
        *joint.log,
        *(f"# {printable(text, LONGEST_SENTENCE)}" for text in found.notes),
        f"# guessed, {joint.guessed}: {printable(joint.doubt, LONGEST_SENTENCE)}",
        f"inputs.{goal} = {{ {joint.command}, {joint.unit} }}{doubt}",
        f"outputs.{output} = {{ {joint.reading}, {joint.unit} }}{doubt}",
        *joint.runs,
    ]
    return "\n".join(lines) + "\n"


# LeRobot data sets


def _data_set(path: Path) -> Recording:
    info = read_info(path if is_data_set(path) else root_of(path))
    known = episodes(path)
    usable = [number for number, (_, frames) in known.items() if frames >= LEAST_SAMPLES]
    short = {*range(info.episodes), *known}.difference(usable) if is_data_set(path) else set()
    left_out = []
    if short:
        left_out.append(f"{_listed(short)} left out: fewer than {LEAST_SAMPLES} frames")
    read = {n: read_columns(known[n][0], f"episode {n}") for n in usable[:MOST_EPISODES]}
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
            own = _moving(read, command, reading)
        except UserError as error:
            left_out.append(f"{name}: no description, since {error}")
            continue
        columns = [f"column = {quoted(column)}" for column in (command, reading)]
        time = 'time = { column = "timestamp" }'
        joints.append(Joint(name, (time,), *columns, unit, "the unit", doubt, _runs(own)))
    fps = info.fps or _rate(next(iter(read.values())))
    nominal = all(_is_nominal(columns, fps) for columns in read.values())
    notes = [*([NOMINAL.format(fps=fps)] if nominal else []), CLIPPED]
    if not info.names:
        notes.append(
            "without meta/info.json joints have numbers: copy the data set whole for names"
        )
    if len(usable) > MOST_EPISODES:
        notes.append(
            f"of {len(usable)} episodes the first {MOST_EPISODES}: add others to 'episode'"
        )
    return Recording(path, tuple(joints), tuple(notes), tuple(left_out))


def _rate(columns: Columns) -> float:
    """Frames in a second by the stamps."""
    return float(1.0 / np.median(np.diff(columns.numbers("timestamp"))))


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
        own = reading.removeprefix(READING)
        command = commands[place] if alike else named.get(own.removeprefix("."))
        yield own.strip(".[]").removesuffix(".pos"), command, reading


def _items(columns: Columns, name: str) -> list[str]:
    return [it for it in columns.names if re.match(rf"{re.escape(name)}[.\[]", it) or it == name]


def _moving(read: Mapping[int, Columns], command: str, reading: str) -> list[int]:
    """Episodes in which a joint moves.

    Raises:
        UserError: none, or one in which a cell is no number.
    """
    own = [
        number
        for number, columns in read.items()
        if np.ptp(columns.numbers(reading)) and np.isfinite(columns.numbers(command)).all()
    ]
    if not own:
        raise UserError("it stands still in every episode: record one in which it moves")
    return own


def _runs(own: Sequence[int]) -> list[str]:
    if len(own) < HELD_OUT_FROM:
        return [f"episode = {list(own)}"]
    return [
        "repeat = [",
        f"    {{ episode = {list(own[:-1])} }},",
        f"    {{ episode = {own[-1]}, held_out = true }},  {CHECK}: held out to judge a fit by",
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
            values.append(columns.numbers(name))
        except UserError:  # told where that joint is looked at
            continue
    every = np.concatenate(values) if values else np.zeros(1)
    reach = float(np.abs(every).max())
    if reach <= RADIANS:
        return "rad", reach
    if reach > LARGEST_DEGREES and not (every % 1.0).any():
        return "counts", reach
    return "deg", reach


# Bags of ROS 2


def _bag(path: Path) -> Recording:
    tables = read_tables(path)
    joints: list[Joint] = []
    left_out: list[str] = []
    notes: dict[str, None] = {}
    for topic, columns in tables.items():
        for command, reading in CONTROLLER:
            for name in _joints_of(columns, reading):
                if f"{command}.{name}" not in columns.names:
                    left_out.append(_uncommanded(name, topic))
                    continue
                pair = (f"{command}.{name}", f"{reading}.{name}")
                joints.append(_joint(name, topic, (columns, columns), pair, notes))
    controlled = {joint.name for joint in joints}
    commands = {topic: it for topic, it in tables.items() if _is_command(topic)}
    for topic, columns in tables.items():
        names = [] if topic in commands else _joints_of(columns, JOINT_STATE)
        for place, name in enumerate(names):
            if name in controlled:
                continue
            given = _commanded(name, place, len(names), commands)
            if given:
                pair = (given[1], f"{JOINT_STATE}.{name}")
                tables_ = (commands[given[0]], columns)
                joints.append(_joint(name, topic, tables_, pair, notes, given[0]))
            else:
                left_out.append(_uncommanded(name, topic))
    sent = [topic for topic, it in tables.items() if _joints_of(it, TRAJECTORY)]
    if sent and left_out:
        left_out.append(
            f"'{sent[0]}' has goals to be reached later, and not what is commanded meanwhile:"
            " record the controller's state"
        )
    return Recording(path, tuple(joints), tuple(notes), tuple(left_out))


def _joints_of(columns: Columns, field: str) -> list[str]:
    return [it.removeprefix(f"{field}.") for it in columns.names if it.startswith(f"{field}.")]


def _uncommanded(name: str, topic: str) -> str:
    return (
        f"{name}: no description, since '{topic}' has its reading and no topic its command: record"
        " that, or the controller's state"
    )


def _is_command(topic: str) -> bool:
    return bool(WORDS_OF_COMMANDS.union({"commands"}) & set(re.split(r"[^a-z]+", topic.lower())))


def _commanded(
    name: str, place: int, count: int, commands: Mapping[str, Columns]
) -> tuple[str, str] | None:
    """Topic and column of the command of a joint: by its name, else by its place in a list."""
    for topic, columns in commands.items():
        if name in _joints_of(columns, JOINT_STATE):
            return topic, f"{JOINT_STATE}.{name}"
    for topic, columns in commands.items():
        items = [column for column in columns.names if column.startswith(ARRAY)]
        if len(items) == count:
            return topic, items[place]
    return None


def _joint(
    name: str,
    topic: str,
    tables: tuple[Columns, Columns],
    pair: tuple[str, str],
    notes: dict[str, None],
    source: str = "",
) -> Joint:
    """A joint of a bag; ``source`` is the topic of its command if it is another one."""
    by_header = all(map(_has_stamps, tables)) and _overlap(*tables)
    times = f"times of '{topic}'" + (f" and '{source}'" if source else "")
    notes[f"{times} are {BY_HEADER if by_header else BY_ARRIVAL}"] = None
    column = HEADER_STAMP if by_header else "log_time"
    again = (np.diff(tables[1].numbers(column)) == 0.0).any()
    repeats = ', repeats = "drop"' if again else ""
    held = f", table = {quoted(source)}" if source else ""
    guessed, doubt = "the unit", "rad, as ROS has it for joints that turn; one that slides is in m"
    if pair[0].startswith(ARRAY):
        guessed = "the unit and the place in the list"
        doubt = f"{doubt}; '{source}' names no joints, so theirs may be in another order"
    return Joint(
        name,
        (
            f"table = {quoted(topic)}",
            f'time = {{ column = {quoted(column)}, unit = "ns"{repeats} }}',
        ),
        f"column = {quoted(pair[0])}{held}",
        f"column = {quoted(pair[1])}",
        'unit = "rad"',
        guessed,
        doubt,
    )


def _has_stamps(columns: Columns) -> bool:
    """Whether every header has a stamp, and these rise."""
    if HEADER_STAMP not in columns.names:
        return False
    try:
        steps = np.diff(columns.numbers(HEADER_STAMP))
    except UserError:
        return False
    return bool((steps >= 0.0).all() and (steps > 0.0).any())


def _overlap(one: Columns, other: Columns) -> bool:
    """Whether both are stamped by one clock, as far as one can see."""
    stamps = [columns.numbers(HEADER_STAMP) for columns in (one, other)]
    return bool(max(it[0] for it in stamps) < min(it[-1] for it in stamps))
