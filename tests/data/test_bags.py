"""Bags of ROS 2: joints by name, commands beside readings, which stamps count."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.data.readers import read_columns
from servo_models.errors import UserError
from tests.conftest import Run
from tests.support.bags import (
    EPOCH,
    Message,
    array,
    bag,
    controller_state,
    joint_state,
    ns,
    place_of,
    sampled,
    wrench,
)

NAMES = ("shoulder", "elbow")
LATE = 0.05  # s, by which readings follow commands
TRANSPORT = 0.013  # s, from a stamp to the arrival
STORAGES = ("mcap", "sqlite3")


def goals(time: float) -> list[float]:
    return [float(np.sin(1.5 * time)), float(0.7 * np.sin(2.5 * time + 1.0))]


def places(time: float) -> list[float]:
    return goals(time - LATE)


def controller(time: float) -> Message:
    message = controller_state(EPOCH + ns(time), NAMES, goals(time), places(time))
    return ns(time + TRANSPORT), message


def state(time: float) -> Message:
    return ns(time + TRANSPORT), joint_state(EPOCH + ns(time), NAMES, places(time))


def state_backwards(time: float) -> Message:
    """Every other message has its joints the other way round."""
    turn = 1 if round(100 * time) % 2 else -1
    message = joint_state(EPOCH + ns(time), NAMES[::turn], places(time)[::turn])
    return ns(time + TRANSPORT), message


def command(time: float) -> Message:
    return ns(time), joint_state(EPOCH + ns(time), NAMES, goals(time))


def command_list(time: float) -> Message:
    return ns(time), array(goals(time))


def init(run: Run, path: Path, *more: str) -> tuple[int, str]:
    code, out, err = run("check", path, "--init", *more)
    return code, out + err


def held(times: Array, period: float, place: int) -> Array:
    """Goals that were sent every ``period`` [s] for 4 s, as they are at other times."""
    sent = np.minimum(np.floor(times / period + 1e-9) * period, 4.0 - period)
    return np.array([goals(float(time))[place] for time in sent])


@pytest.mark.parametrize("storage", STORAGES)
def test_a_controller_s_state_is_found_by_itself(run: Run, tmp_path: Path, storage: str) -> None:
    folder = bag(tmp_path / "rig", {"/arm/state": sampled(controller, 0.01, 4.0)}, storage)
    code, out = init(run, folder)
    assert code == 0
    assert out.count("(5.0 rows) later") == 2
    assert "times of '/arm/state' are the stamps in the headers" in out
    for place, name in enumerate(NAMES):
        (log,) = read_description(tmp_path / f"rig_{name}.toml").logs
        assert log.times == pytest.approx(np.arange(0.0, 4.0, 0.01), abs=1e-7)
        expected = np.array([goals(float(time))[place] for time in log.times])
        assert log.inputs["goal"] == pytest.approx(expected, abs=1e-6)
        expected = np.array([places(float(time))[place] for time in log.times])
        assert log.outputs["angle_reading"] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("storage", STORAGES)
def test_joints_keep_their_names_and_a_command_holds(
    run: Run, tmp_path: Path, storage: str
) -> None:
    topics = {
        "/joint_states": sampled(state_backwards, 0.01, 4.0),
        "/joint_command": sampled(command, 0.04, 4.0),
    }
    code, out = init(run, bag(tmp_path / "rig", topics, storage))
    assert code == 0
    assert "times of '/joint_states' and '/joint_command' are the stamps in the headers" in out
    for place, name in enumerate(NAMES):
        (log,) = read_description(tmp_path / f"rig_{name}.toml").logs
        expected = np.array([places(float(time))[place] for time in log.times])
        assert log.outputs["angle_reading"] == pytest.approx(expected, abs=1e-6)
        assert log.inputs["goal"] == pytest.approx(held(log.times, 0.04, place), abs=1e-6)


def test_a_command_between_two_readings_holds_from_its_own_stamp(run: Run, tmp_path: Path) -> None:
    """Moved to the next reading it would be 7 ms late, and so would every delay be short."""

    def command_between(time: float) -> Message:
        return command(time + 0.003 if time else 0.0)

    topics = {
        "/joint_states": sampled(state, 0.01, 4.0),
        "/joint_command": sampled(command_between, 0.02, 4.0),
    }
    assert init(run, bag(tmp_path / "rig", topics))[0] == 0

    (log,) = read_description(tmp_path / "rig_elbow.toml").logs

    assert log.between is not None
    assert log.readings.times == pytest.approx(np.arange(0.0, 4.0, 0.01), abs=1e-7)
    assert log.times[log.between] == pytest.approx(0.003 + np.arange(0.02, 4.0, 0.02), abs=1e-7)
    assert not log.counted[log.between].any()
    sent = np.append(0.0, 0.003 + np.arange(0.02, 4.0, 0.02))
    place = np.searchsorted(sent, log.times + 1e-6, side="right") - 1
    expected = [goals(float(time))[1] for time in sent[place]]
    assert log.inputs["goal"] == pytest.approx(expected, abs=1e-6)
    assert "before its row" not in run("check", tmp_path / "rig_elbow.toml")[1]


def test_headers_whose_stamps_run_backward_are_told(run: Run, tmp_path: Path) -> None:
    def disordered(time: float) -> Message:
        early = 0.015 if round(100 * time) == 100 else 0.0
        message = controller_state(EPOCH + ns(time - early), NAMES, goals(time), places(time))
        return ns(time + TRANSPORT), message

    folder = bag(tmp_path / "rig", {"/arm/state": sampled(disordered, 0.01, 4.0)})
    out = init(run, folder)[1]
    assert "since stamps in the headers of '/arm/state' run backward at message 101" in out


def test_two_senders_share_a_topic(run: Run, tmp_path: Path) -> None:
    """Each message has the joints of one, as those of an arm and of its gripper."""

    def one(time: float) -> Message:
        place = round(100 * time) % 2
        message = joint_state(EPOCH + ns(time), [NAMES[place]], [places(time)[place]])
        return ns(time), message

    topics = {"/joint_states": sampled(one, 0.01, 4.0), "/cmd": sampled(command, 0.01, 4.0)}
    assert init(run, bag(tmp_path / "rig", topics))[0] == 0
    for place, name in enumerate(NAMES):
        (log,) = read_description(tmp_path / f"rig_{name}.toml").logs
        times = 0.01 * place + 0.02 * np.arange(200)
        log = log.readings
        assert log.times == pytest.approx(times - times[0], abs=1e-7)
        expected = [places(float(time))[place] for time in times]
        assert log.outputs["angle_reading"] == pytest.approx(expected, abs=1e-6)


def test_without_a_header_arrival_counts_and_places_are_guessed(run: Run, tmp_path: Path) -> None:
    topics = {
        "/joint_states": sampled(state, 0.01, 4.0),
        "/controller/commands": sampled(command_list, 0.02, 4.0),
    }
    code, out = init(run, bag(tmp_path / "rig", topics))
    assert code == 0
    assert "are those of arrival at the recorder" in out
    assert "names no joints" in out
    assert 'log_time", unit = "ns"' in (tmp_path / "rig_elbow.toml").read_text()
    (log,) = read_description(tmp_path / "rig_elbow.toml").logs
    arrived = log.times + TRANSPORT
    assert log.inputs["goal"] == pytest.approx(held(arrived, 0.02, 1), abs=1e-6)


@pytest.mark.parametrize("storage", STORAGES)
def test_a_single_file_of_a_bag(run: Run, tmp_path: Path, storage: str) -> None:
    folder = bag(tmp_path / "rig", {"/arm/state": sampled(controller, 0.01, 2.0)}, storage)
    suffix = {"mcap": ".mcap", "sqlite3": ".db3"}[storage]
    (file,) = (path for path in folder.iterdir() if path.suffix == suffix)
    code, _ = init(run, file, "--out", str(tmp_path / "own"))
    assert code == 0
    for name in NAMES:
        assert len(read_description(tmp_path / "own" / f"{name}.toml").logs[0].times) == 200
    columns = read_columns(file)
    assert columns.index("feedback.positions[1]") == columns.index("feedback.positions.elbow")


def test_a_place_in_a_list_that_changes_is_no_column(tmp_path: Path) -> None:
    folder = bag(tmp_path / "rig", {"/joint_states": sampled(state_backwards, 0.01, 1.0)})
    columns = read_columns(folder)
    assert "position.elbow" in columns.names
    with pytest.raises(UserError, match="no column"):
        columns.index("position[1]")


def test_a_bag_without_joints_is_a_log_like_others(run: Run, tmp_path: Path) -> None:
    def pulse(time: float) -> Message:
        return ns(time), wrench(goals(time)[0])

    def pose(time: float) -> Message:
        return ns(time), place_of(places(time)[0])

    folder = bag(
        tmp_path / "rig", {"/u": sampled(pulse, 0.01, 2.0), "/pose": sampled(pose, 0.01, 2.0)}
    )
    code, out = init(run, folder)
    assert code in (0, 1)
    assert "has no joint" not in out
    assert 'column = "position.z"' in (tmp_path / "rig.toml").read_text()
    topics = {"/joint_states": sampled(state, 0.01, 2.0)}
    code, out = init(run, bag(tmp_path / "arm", topics), "--actuator", "torque_motor")
    assert "has no joint" not in out
    assert (tmp_path / "arm.toml").exists()


def test_a_large_message_is_read_only_where_it_is_asked_for(tmp_path: Path) -> None:
    def image(time: float) -> Message:
        return ns(time), array(np.zeros(4000))

    def few(time: float) -> Message:
        return ns(time), array([1.0])

    topics: dict[str, Sequence[Any]] = {
        "/image": sampled(image, 0.1, 1.0),
        "/few": sampled(few, 0.1, 1.0),
    }
    folder = bag(tmp_path / "rig", topics)
    assert len(read_columns(folder).names) == 3
    assert "data[3999]" in read_columns(folder, "/image").names
    with pytest.raises(UserError, match="has no table '/imag'; did you mean '/image'"):
        read_columns(folder, "/imag")
