"""Joints of ROS 2 bags: states of controllers, or states of joints beside a topic of commands."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from servo_models.data.joints.recording import Joint, Recording, column_keys
from servo_models.data.readers import Columns, read_tables
from servo_models.data.readers.ros import HEADER_STAMP, LISTS_OF_NAMES
from servo_models.data.scaffold import COMMAND
from servo_models.data.schema import quoted
from servo_models.errors import UserError

OF_TOPICS = (".mcap", ".db3")  # suffixes of recordings of topics
CONTROLLER = (
    ("reference.positions", "feedback.positions"),
    ("desired.positions", "actual.positions"),
)
"""Fields of control_msgs/JointTrajectoryControllerState, since ROS 2 Iron and before."""
JOINT_STATE = "position"  # field of sensor_msgs/JointState
ARRAY = "data["  # field of std_msgs/Float64MultiArray
TRAJECTORY = "points[0].positions"  # field of trajectory_msgs/JointTrajectory
BY_HEADER = "the stamps in the headers, not those of arrival"
BY_ARRIVAL = "those of arrival at the recorder, since {}: a late message looks like a late joint"


def bag(path: Path) -> Recording:
    """Return the joints of a bag, none where it has no topic of joints."""
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
    """Joints that a field has; that of a pose, ``position.x``, has none."""
    if not any(f"{names}[0]" in columns.names for names in LISTS_OF_NAMES):
        return []
    return [it.removeprefix(f"{field}.") for it in columns.names if it.startswith(f"{field}.")]


def _uncommanded(name: str, topic: str) -> str:
    return (
        f"{name}: no description, since '{topic}' has its reading and no topic its command: record"
        " that, or the controller's state"
    )


def _is_command(topic: str) -> bool:
    return bool(COMMAND.union({"commands"}) & set(re.split(r"[^a-z]+", topic.lower())))


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
    topics = {topic: tables[1], **({source: tables[0]} if source else {})}
    why = _no_common_stamps(topics)
    times = f"times of {' and '.join(map(repr, topics))}"
    notes[f"{times} are {BY_ARRIVAL.format(why) if why else BY_HEADER}"] = None
    column = "log_time" if why else HEADER_STAMP
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
        column_keys(pair[0], tables[:1], "hold") + held,
        column_keys(pair[1], tables[1:], "drop"),
        'unit = "rad"',
        guessed,
        doubt,
    )


def _no_common_stamps(topics: Mapping[str, Columns]) -> str:
    """Why headers do not give the times of topics: none, none that rise, or of two clocks."""
    ends = []
    for topic, columns in topics.items():
        if HEADER_STAMP not in columns.names:
            return f"'{topic}' has no stamps in headers"
        try:
            stamps = columns.numbers(HEADER_STAMP)
        except UserError:
            return f"'{topic}' has headers without a stamp"
        back = np.diff(stamps) < 0.0
        if back.any():
            return (
                f"stamps in the headers of '{topic}' run backward at message {np.argmax(back) + 2}"
            )
        if stamps[-1] == stamps[0]:
            return f"stamps in the headers of '{topic}' are all alike"
        ends.append((stamps[0], stamps[-1]))
    if max(begin for begin, _ in ends) >= min(end for _, end in ends):
        return f"stamps in the headers of {' and '.join(map(repr, topics))} share no time"
    return ""
