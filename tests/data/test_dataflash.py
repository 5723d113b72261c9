"""DataFlash logs of ArduPilot, written as its documentation of the format says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from servo_models.data.description import read_description
from servo_models.data.readers import read_columns
from servo_models.errors import UserError
from servo_models.survey.plan import plan
from tests.conftest import Run
from tests.support.dataflash import HEAD, flight_log

pytest.importorskip("pymavlink.DFReader")

TIMES = 0.02 * np.arange(200)


def log(path: Path) -> Path:
    """Two servos, of which the second has every goal a row late, and the pulses of RCOU."""
    rows = range(len(TIMES))
    commanded = np.array([goal(k) for k in rows])
    measured = {servo: np.array([goal(k - servo) for k in rows]) for servo in (1, 2)}
    return flight_log(path, TIMES, {servo: (it, commanded) for servo, it in measured.items()})


def goal(row: int) -> float:
    return float(np.float32(30.0 * np.sin(0.05 * row)))


def test_messages_and_their_instances_are_tables(tmp_path: Path) -> None:
    path = log(tmp_path / "flight.bin")
    columns = read_columns(path, "CSRV[2]")
    assert columns.names == ("TimeUS", "Id", "Pos", "PosCmd")
    rows = range(len(TIMES))
    assert list(columns.numbers("PosCmd")) == [goal(k) for k in rows]
    assert list(columns.numbers("Pos")) == [goal(k - 2) for k in rows]
    assert list(read_columns(path, "RCOU").numbers("C2")) == [1500.0 + k for k in rows]
    with pytest.raises(UserError, match=r"has no table 'CSRV'"):
        read_columns(path, "CSRV")


def test_each_servo_with_command_and_reading_has_a_description(run: Run, tmp_path: Path) -> None:
    path = log(tmp_path / "flight.bin")
    code, out, err = run("check", path, "--init", "--actuator", "smart_servo")
    assert (code, err, out.count("wrote")) == (0, "", 2)
    for servo in (1, 2):
        (read,) = read_description(tmp_path / f"flight_CSRV_{servo}.toml").logs
        assert read.times == pytest.approx(TIMES, abs=1e-9)
        assert [read.channels[name].column for name in ("goal", "angle")] == ["PosCmd", "Pos"]
        late = [goal(k - servo) for k in range(len(TIMES))]
        assert np.degrees(read.outputs["angle"]) == pytest.approx(late, abs=1e-9)
    code, out, err = run("check", path, "--init", "--actuator", "smart_servo")
    assert (code, "flight_CSRV_1.toml' exists" in err) == (2, True)


def test_a_survey_has_a_job_for_each_servo(tmp_path: Path) -> None:
    path = log(tmp_path / "flight.bin")
    for _ in range(2):  # what is there already is kept
        found = plan(path, tmp_path / "out", "smart_servo")
        assert [job.joint for job in found.jobs] == ["flight_CSRV_1", "flight_CSRV_2"]
        assert all(read_description(job.description).logs for job in found.jobs)


def test_pulses_hold_beside_an_angle_of_another_message(tmp_path: Path) -> None:
    log(tmp_path / "flight.bin")
    path = tmp_path / "flap.toml"
    path.write_text(
        'actuator = "sg90"\n[[logs]]\nfile = "flight.bin"\ntable = "CSRV[1]"\n'
        'time = { column = "TimeUS", unit = "us" }\n'
        'inputs.pulse_width = { column = "C2", unit = "us", table = "RCOU" }\n'
        'outputs.angle = { column = "Pos", unit = "deg" }\n'
    )
    (read,) = read_description(path).logs
    assert read.inputs["pulse_width"] == pytest.approx(1e-6 * (1500.0 + np.arange(len(TIMES))))


@pytest.mark.parametrize("content", [b"", b"\x00" * 1000, HEAD * 500])
def test_what_is_no_log_is_damaged_and_told_once(
    tmp_path: Path, content: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "flight.bin"
    path.write_bytes(content)
    with pytest.raises(UserError, match="is damaged or no DataFlash file"):
        read_columns(path)
    assert capfd.readouterr() == ("", "")


def test_what_a_crash_has_cut_off_is_left_out(tmp_path: Path) -> None:
    path = log(tmp_path / "flight.bin")
    path.write_bytes(path.read_bytes()[:-30])
    assert len(read_columns(path, "CSRV[1]").numbers("Pos")) == len(TIMES)
    assert len(read_columns(path, "CSRV[2]").numbers("Pos")) == len(TIMES) - 1
