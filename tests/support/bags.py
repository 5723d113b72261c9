"""Bags of ROS 2, written with ``rosbags``."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STATE = "control_msgs/msg/JointTrajectoryControllerState"
STATE_FIELDS = """std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint reference
trajectory_msgs/JointTrajectoryPoint feedback
trajectory_msgs/JointTrajectoryPoint error
trajectory_msgs/JointTrajectoryPoint output
"""
"""Source: ros-controls/control_msgs, JointTrajectoryControllerState.msg of ROS 2 Jazzy, without
the fields of wheels and arms in several dimensions at its end."""
EPOCH = 1_700_000_000_000_000_000  # ns
ROS = get_typestore(Stores.LATEST)
ROS.register(get_types_from_msg(STATE_FIELDS, STATE))
Message = tuple[int, Any]
"""When it arrived [ns], and the message."""


def ns(seconds: float) -> int:
    return round(1e9 * seconds)


def stamp(time: int) -> Any:
    time_ = ROS.types["builtin_interfaces/msg/Time"](time // 10**9, time % 10**9)
    return ROS.types["std_msgs/msg/Header"](time_, "base")


def joint_state(time: int, names: Sequence[str], positions: Sequence[float]) -> Any:
    none = np.zeros(0)
    kind = ROS.types["sensor_msgs/msg/JointState"]
    return kind(stamp(time), list(names), np.array(positions), none, none)


def point(positions: Sequence[float]) -> Any:
    duration = ROS.types["builtin_interfaces/msg/Duration"](0, 0)
    none = np.zeros(0)
    kind = ROS.types["trajectory_msgs/msg/JointTrajectoryPoint"]
    return kind(np.array(positions), none, none, none, duration)


def controller_state(
    time: int, names: Sequence[str], reference: Sequence[float], feedback: Sequence[float]
) -> Any:
    error = np.subtract(reference, feedback)
    points = [point(it) for it in (reference, feedback, error, error)]
    return ROS.types[STATE](stamp(time), list(names), *points)


def place_of(height: float) -> Any:
    """A pose, which has a position and no joints."""
    at = ROS.types["geometry_msgs/msg/Point"](0.0, 0.0, height)
    turn = ROS.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    return ROS.types["geometry_msgs/msg/Pose"](at, turn)


def wrench(force: float) -> Any:
    of = ROS.types["geometry_msgs/msg/Vector3"]
    return ROS.types["geometry_msgs/msg/Wrench"](of(force, 0.0, 0.0), of(0.0, 0.0, 0.0))


def array(values: Sequence[float]) -> Any:
    layout = ROS.types["std_msgs/msg/MultiArrayLayout"]([], 0)
    return ROS.types["std_msgs/msg/Float64MultiArray"](layout, np.array(values))


def bag(folder: Path, topics: Mapping[str, Sequence[Message]], storage: str = "mcap") -> Path:
    """Write the messages of topics, and return the folder."""
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        for topic, messages in topics.items():
            kind = messages[0][1].__msgtype__
            connection = writer.add_connection(topic, kind, typestore=ROS)
            for arrived, message in messages:
                writer.write(connection, EPOCH + arrived, ROS.serialize_cdr(message, kind))
    return folder


def sampled(make: Callable[[float], Message], period: float, duration: float) -> list[Message]:
    return [make(float(time)) for time in np.arange(0.0, duration, period)]
