"""Drafts of descriptions: what ``check --init`` makes of a log of any format."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import scipy.io
from scipy.signal import lfilter

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import actuators, model
from servo_models.data import scaffold
from servo_models.data.description import read_description
from servo_models.data.scaffold import draft, drafts, heading
from tests.conftest import Run
from tests.support.noisy_motor import TIMES, VOLTAGE, described, frame, motor_log


@pytest.fixture
def csv(tmp_path: Path) -> Path:
    path = tmp_path / "bench log.csv"
    frame(motor_log()).write_csv(path)
    return path


def test_a_log_alone_asks_for_init(run: Run, csv: Path) -> None:
    code, _, err = run("check", csv)
    assert code == 2
    assert "--init" in err
    code, _, err = run("check", described(csv), "--out", "x.toml")
    assert code == 2
    assert "add --init" in err


@pytest.mark.parametrize("more", [(), ("--init",)])
def test_a_folder_asks_for_init_of_a_log_in_it(run: Run, csv: Path, more: tuple[str, ...]) -> None:
    (csv.parent / "a notes.md").write_text("none")
    code, _, err = run("check", csv.parent, *more)
    assert code == 2
    assert f"is a folder, no description; begin one with 'servo-models check {csv} --init'" in err
    csv.unlink()
    code, _, err = run("check", csv.parent, *more)
    assert code == 2
    assert "is a folder without a log" in err


def test_a_description_that_is_there_is_named_before_another_is_begun(run: Run, csv: Path) -> None:
    (csv.parent / "a.toml").write_text('actuator = "sg90"\n[parameters]\n')
    (csv.parent / "b.toml").write_text("= no TOML")
    for given in (csv.parent, csv):
        for command in ("check", "identify", "diagnose"):
            code, out, err = run(command, given)
            assert (code, out) == (2, "")
            assert f"no description; begin one with 'servo-models check {csv} --init'" in err
    told = described(csv).rename(csv.with_suffix(".toml"))
    for given in (csv.parent, csv):
        code, _, err = run("check", given)
        assert code == 2
        assert f"no description; there is one: '{told}'" in err


def write(table: pl.DataFrame, path: Path) -> None:
    if path.suffix == ".parquet":
        table.write_parquet(path)
    elif path.suffix == ".json":
        path.write_text(json.dumps({"rig": "bench", "entries": table.to_dicts()}))
    elif path.suffix == ".mat":
        scipy.io.savemat(path, {name: table[name].to_numpy() for name in table.columns})
    else:
        table.write_csv(path, separator="\t" if path.suffix == ".tsv" else ",")


@pytest.mark.thorough
@pytest.mark.parametrize("suffix", [".csv", ".tsv", ".parquet", ".json", ".mat"])
def test_a_draft_of_every_format_reads_back(run: Run, tmp_path: Path, suffix: str) -> None:
    log, path = motor_log(), tmp_path / f"log{suffix}"
    write(frame(log), path)
    code, _, err = run("check", path, "--init")
    assert (code, err) == (0, "")
    told = read_description(path.with_suffix(".toml"))
    assert told.actuator.name == "torque_motor"
    (read,) = told.logs
    assert read.times == pytest.approx(log.times, abs=1e-12)
    assert read.inputs["voltage"] == pytest.approx(log.inputs["voltage"])
    assert read.outputs["angle"] == pytest.approx(log.outputs["angle"])
    assert run("check", path.with_suffix(".toml"))[0] in (0, 1)


def test_a_draft_finds_signals_in_several_topics(run: Run, tmp_path: Path) -> None:
    writer = pytest.importorskip("mcap.writer")
    log, path = motor_log(), tmp_path / "log.mcap"
    with path.open("wb") as stream:
        out = writer.Writer(stream)
        out.start()
        schema = out.register_schema("sample", "jsonschema", b"{}")
        topics = {
            "/drive": ("voltage_V", log.inputs["voltage"]),
            "/encoder": ("angle_deg", np.degrees(log.outputs["angle"])),
        }
        for topic, (name, values) in topics.items():
            channel = out.register_channel(topic, "json", schema)
            for time, value in zip(log.times, values):
                at = round(1e9 * time)
                out.add_message(channel, at, json.dumps({name: value}).encode(), at)
        out.finish()
    code, _, err = run("check", path, "--init")
    assert (code, err) == (0, "")
    (read,) = read_description(path.with_suffix(".toml")).logs
    assert read.inputs["voltage"] == pytest.approx(log.inputs["voltage"])
    assert read.outputs["angle"] == pytest.approx(log.outputs["angle"])


@pytest.mark.parametrize(
    ("time", "command", "reading"),
    [
        ("Time [ms]", "Coil Voltage (mV)", "angle_deg"),
        ("t_us", "cmd_V", "theta_rad"),
        ("timestamp", "voltage", "angle [mrad]"),
    ],
)
def test_units_are_taken_from_headings(
    tmp_path: Path, time: str, command: str, reading: str
) -> None:
    log = motor_log()
    sizes = {"ms": 1e3, "us": 1e6, "mV": 1e3, "deg": 180.0 / np.pi, "mrad": 1e3}
    factors = [sizes.get(heading(name)[1] or "", 1.0) for name in (time, command, reading)]
    signals = (log.times, log.inputs["voltage"], log.outputs["angle"])
    names = (time, command, reading)
    table = pl.DataFrame({n: f * s for n, f, s in zip(names, factors, signals)})
    table.write_csv(tmp_path / "log.csv")
    target = tmp_path / "d.toml"
    target.write_text(draft(tmp_path / "log.csv", "torque_motor").text(tmp_path))
    (read,) = read_description(target).logs
    assert read.times == pytest.approx(log.times, abs=1e-9)
    assert read.inputs["voltage"] == pytest.approx(signals[1])
    assert read.outputs["angle"] == pytest.approx(signals[2])


@pytest.mark.parametrize(
    ("name", "words", "unit"),
    [
        ("angle_deg", ("angle",), "deg"),
        ("velocity_rad_s", ("velocity",), "rad/s"),
        ("goalPosition", ("goal", "position"), None),
        ("rate [deg/s]", ("rate",), "deg/s"),
        ("drive (V)", ("drive",), "V"),
        ("state (on)", ("state",), None),
        ("position[0]", ("position",), None),
        ("effort(12)", ("effort",), None),
        ("q[0,1]", ("q",), None),
        ("joint[0].velocity [rad/s]", ("joint", "velocity"), "rad/s"),
        ("slip [%]", ("slip",), "%"),
        ("turns [1/min]", ("turns",), "1/min"),
        ("s", ("s",), None),
        ("TimeUS", ("time",), "us"),
        ("angleDeg", ("angle",), "deg"),
        ("motorA", ("motor", "a"), None),
    ],
)
def test_headings(name: str, words: tuple[str, ...], unit: str | None) -> None:
    assert heading(name) == (words, unit)


def test_a_file_without_header_is_told_by_its_numbers(run: Run, tmp_path: Path) -> None:
    log, path = motor_log(), tmp_path / "log.csv"
    columns = [np.round(1e3 * log.times), log.inputs["voltage"], np.degrees(log.outputs["angle"])]
    np.savetxt(path, np.column_stack(columns), delimiter=",", fmt="%.6g")
    code, _, err = run("check", path, "--init")
    assert (code, "--actuator" in err) == (2, True)
    code, _, _ = run("check", path, "--init", "--actuator", "torque_motor")
    assert code == 0
    text = path.with_suffix(".toml").read_text()
    assert text.count("guessed") >= 4
    (read,) = read_description(path.with_suffix(".toml")).logs
    assert read.times == pytest.approx(log.times)
    assert read.inputs["voltage"] == pytest.approx(log.inputs["voltage"])
    assert read.outputs["angle"] == pytest.approx(log.outputs["angle"], abs=1e-6)


def test_a_draft_never_overwrites(run: Run, csv: Path) -> None:
    path = csv.with_suffix(".toml")
    path.write_text("mine")
    code, _, err = run("check", csv, "--init")
    assert code == 2
    assert "exists" in err
    assert path.read_text() == "mine"
    other = csv.with_name("other.toml")
    assert run("check", csv, "--init", "--out", other)[0] == 0
    assert other.exists()


def test_a_draft_that_is_not_complete_says_what_is_missing(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    pl.DataFrame({"time_s": TIMES, "voltage_V": VOLTAGE}).write_csv(path)
    code, out, _ = run("check", path, "--init", "--actuator", "torque_motor")
    assert code == 1
    assert "completed first" in out
    assert "no column fits an output" in path.with_suffix(".toml").read_text()


@pytest.mark.parametrize(
    ("content", "words"),
    [("", "empty"), ("a,b\nx,y\nz,w\n", "no column of numbers"), (None, "cannot read")],
)
def test_a_draft_of_nothing_is_refused(
    run: Run, tmp_path: Path, content: str | None, words: str
) -> None:
    path = tmp_path / "log.csv"
    if content is not None:
        path.write_text(content)
    code, _, err = run("check", path, "--init")
    assert code == 2
    assert words in err
    assert not path.with_suffix(".toml").exists()
    assert run("check", path, "--init", "--actuator", "sg09")[0] == 2


@pytest.mark.thorough
def test_real_files_are_drafted(run: Run, logs_folder: Path, tmp_path: Path) -> None:
    cases = {
        "emps/DATA_EMPS.mat": ("linear_drive", {"reference", "position"}),
        "sg90_steps/log.csv": ("sg90", {"pulse_width", "rate"}),
        "so101/wrist_roll-multisine.csv": ("sg90", {"pulse_width", "angle", "rate"}),
    }
    for number, (file, (name, signals)) in enumerate(cases.items()):
        assert name in actuators()
        path = tmp_path / f"{number}.toml"
        code, _, err = run("check", logs_folder / file, "--init", "--out", path, "--actuator", name)
        assert (code, err) == (0, "")
        (log,) = read_description(path).logs
        assert signals <= {*log.inputs, *log.outputs}


@pytest.mark.parametrize(
    ("columns", "name"),
    [
        (("time_ms", "pulse_width_us", "angle_deg"), "sg90"),
        (("time_ms", "pulse_us", "position_deg"), "sg90"),
        (("time_s", "goal_rad", "angle_rad"), "smart_servo"),
        (("time_s", "voltage_V", "angle_deg"), "torque_motor"),
    ],
)
def test_a_general_actuator_stays_behind_those_that_are_made(
    run: Run, tmp_path: Path, columns: tuple[str, ...], name: str
) -> None:
    """Pulses and goals fit ``second_order_servo`` as well: nobody is asked, and it is named."""
    times = np.arange(0.0, 400.0)
    swing = np.sin(0.05 * times)
    command = 1500.0 + 300.0 * swing if columns[1].endswith("us") else swing
    path = tmp_path / "log.csv"
    pl.DataFrame(dict(zip(columns, (times, command, 0.7 * swing)))).write_csv(path)
    assert run("check", path, "--init")[0] in (0, 1)
    text = path.with_suffix(".toml").read_text()
    assert f'actuator = "{name}"' in text
    assert "second_order_servo (general)" in text
    if name in ("sg90", "smart_servo"):
        assert draft(path, "second_order_servo").matches


def test_a_general_actuator_is_proposed_where_no_other_fits(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    pl.DataFrame(
        {"time_s": TIMES, "goal_rad": np.sin(TIMES), "angle_rad": np.cos(TIMES)}
    ).write_csv(path)
    every = {k: v for k, v in actuators().items() if k in ("linear_drive", "second_order_servo")}
    monkeypatch.setattr(scaffold, "actuators", lambda: every)
    assert draft(path).actuator.name == "second_order_servo"


@pytest.mark.parametrize("actuator_name", list(actuators()))
def test_a_draft_writes_what_it_assumes_of_inputs_that_are_not_logged(
    run: Run, tmp_path: Path, actuator_name: str
) -> None:
    """The supply that a simulation would take by default stands in the description as a value."""
    found = actuators()[actuator_name]
    main, size = found.step
    times = np.linspace(0.0, 1.0, 200)
    chosen = model(found)
    response = simulate(chosen, times, {main: size})
    output = found.plant.outputs[0]
    wires = {name: found.plant.wire[name] for name in (main, output)}
    table = pl.DataFrame({"t [s]": times, "u": response[main], "y": response[output]})
    path = tmp_path / "log.csv"
    table.rename({"u": f"{main} [{wires[main].unit}]"}).rename(
        {"y": f"{output} [{wires[output].unit}]"}
    ).write_csv(path)
    rests = {w.name: w.rest for w in found.plant.inputs if w.rest and w.name != main}
    assert run("check", path, "--init", "--actuator", actuator_name)[0] == 0
    (log,) = read_description(path.with_suffix(".toml")).logs
    assert {name: log.constants.get(name) for name in rests} == rests


@pytest.mark.parametrize("cell", ["nan", ""])
def test_a_column_with_an_empty_cell_is_used(run: Run, csv: Path, cell: str) -> None:
    """Rows without the reading are left out, and a command without a value holds."""
    rows = [line.split(",") for line in csv.read_text().splitlines()]
    for row, place in ((17, 1), (18, 2), (19, 2)):
        rows[row][place] = cell
    csv.write_text("\n".join(",".join(row) for row in rows))
    assert run("check", csv, "--init")[0] == 0
    text = csv.with_suffix(".toml").read_text()
    assert 'missing = "hold" }  # guessed: 1 cell without a value' in text
    assert 'missing = "drop" }  # guessed: 2 cells without a value' in text
    (log,) = read_description(csv.with_suffix(".toml")).logs
    whole = motor_log()
    kept = np.delete(np.arange(len(TIMES)), [17, 18])
    assert log.times == pytest.approx(whole.times[kept], abs=1e-9)
    assert log.inputs["voltage"][16] == pytest.approx(whole.inputs["voltage"][15])
    assert log.outputs["angle"] == pytest.approx(whole.outputs["angle"][kept])
    assert {*log.rows} == {*(kept + 2)}


def test_a_draft_goes_into_a_folder_that_is_there(run: Run, tmp_path: Path) -> None:
    log, path = motor_log(), tmp_path / "log.csv"
    columns = {"time_s": log.times, "voltage_V": log.inputs["voltage"]}
    pl.DataFrame({**columns, "angle_rad": log.outputs["angle"]}).write_csv(path)
    (tmp_path / "drafts").mkdir()
    assert run("check", path, "--init", "--out", tmp_path / "drafts")[0] == 0
    assert (tmp_path / "drafts" / "log.toml").exists()


def test_tables_with_a_command_of_their_own_are_drafted_each(tmp_path: Path) -> None:
    """Three gyros beside one command are of one servo, and what stands still is of none."""
    times, path = (0.01 * np.arange(300)).tolist(), tmp_path / "log.json"
    swing = np.sin(times)

    def table(*values: np.ndarray) -> list[dict[str, float]]:
        names = ("time_s", "angle_deg", "goal_deg")
        return [dict(zip(names, row)) for row in zip(times, *values)]

    still = 0.0 * swing
    servos = {f"servo {k}": table(k * swing, 9.0 * swing) for k in (1, 2)}
    servos |= {"servo 3": table(still, 9.0 * swing)}
    for number, servo in enumerate(servos.values()):  # one of them does not tell its current
        servo[:] = [{**row, "current_A": None if number else 0.1} for row in servo]
    path.write_text(json.dumps(servos))
    assert [one.table for one in drafts(path, "smart_servo")] == ["servo 1", "servo 2"]
    assert {m.column.table for m in drafts(path, "smart_servo")[1].matches} == {"servo 2"}
    sensors = {f"sensor {k}": table(k * swing) for k in (1, 2, 3)}
    goals = [{"time_s": t, "goal_deg": 9.0 * g} for t, g in zip(times, swing.tolist())]
    path.write_text(json.dumps({**sensors, "command": goals}))
    (one,) = drafts(path, "smart_servo")
    assert {match.column.table for match in one.matches} == {"sensor 1", "command"}


def test_topics_that_were_merged_into_a_table(run: Run, tmp_path: Path) -> None:
    """A row has a command or a reading, as tools merge what came at other times."""
    log, path = motor_log(), tmp_path / "log.csv"
    command = [None if k % 3 else value for k, value in enumerate(log.inputs["voltage"])]
    reading = [value if k % 3 else None for k, value in enumerate(log.outputs["angle"])]
    columns = {"time_s": log.times, "voltage_V": command, "angle_rad": reading}
    pl.DataFrame(columns).write_csv(path)
    assert run("check", path, "--init")[0] == 0
    (read,) = read_description(path.with_suffix(".toml")).logs
    kept = np.flatnonzero(np.arange(len(log.times)) % 3)
    assert read.readings.outputs["angle"] == pytest.approx(log.outputs["angle"][kept])
    sent = log.inputs["voltage"][::3]
    place = np.searchsorted(log.times[::3], read.times + read.begin + 1e-9, side="right") - 1
    assert read.inputs["voltage"] == pytest.approx(sent[place])
    assert np.count_nonzero(np.diff(sent)) == np.count_nonzero(np.diff(read.inputs["voltage"]))


@pytest.mark.parametrize(
    ("low", "high", "turn"),
    [(0, 4095, 4096), (1500, 2600, 4096), (-2000, 2047, 4096), (0, 9000, 16384)],
)
def test_counts_of_an_encoder_are_no_thousandths_of_a_radian(
    tmp_path: Path, low: int, high: int, turn: int
) -> None:
    swing = 0.5 + 0.5 * np.sin(0.05 * np.arange(400.0))
    counts = np.round(low + (high - low) * swing)
    columns = {"time_s": 0.01 * np.arange(400), "goal_position": counts, "present_position": counts}
    path = tmp_path / "log.csv"
    pl.DataFrame(columns).write_csv(path)
    made = draft(path, "smart_servo")
    text = made.text(tmp_path)
    assert "mrad" not in text
    assert text.count(f"guessed: the unit, counts of an encoder with {turn} a turn") == 2
    (tmp_path / "rig.toml").write_text(text)
    (log,) = read_description(tmp_path / "rig.toml").logs
    assert np.ptp(log.inputs["goal"]) == pytest.approx(2.0 * np.pi * np.ptp(counts) / turn)
    assert np.abs(log.inputs["goal"]).max() <= np.pi


@pytest.mark.parametrize("cell", ["-", "inf"])
def test_a_column_with_one_bad_cell_is_told(run: Run, csv: Path, cell: str) -> None:
    rows = [line.split(",") for line in csv.read_text().splitlines()]
    rows = [[*row, f"0.{i}"] for i, row in enumerate(rows)]
    rows[0][-1] = "coil_current"
    rows[17][-1] = cell
    csv.write_text("\n".join(",".join(row) for row in rows))
    code, out, _ = run("check", csv, "--init")
    assert code == 1
    assert "row 18, column 'coil_current'" in out
    assert "column 'coil_current'" in csv.with_suffix(".toml").read_text()


def test_an_index_is_no_unit_and_what_is_left_out_is_told(run: Run, tmp_path: Path) -> None:
    """As ROS writes arrays of joints."""
    log, path = motor_log(), tmp_path / "log.csv"
    angle = np.degrees(log.outputs["angle"])
    pl.DataFrame(
        {
            "time_s": log.times,
            "voltage [V]": log.inputs["voltage"],
            "position[0]": angle,
            "position[1]": 0.5 * angle,
            "effort[0]": np.zeros(len(angle)),
            "humidity": np.cos(log.times),
            "mode": ["run"] * len(angle),
        }
    ).write_csv(path)
    code, out, _ = run("check", path, "--init", "--actuator", "torque_motor")
    assert code == 0
    draft_text = path.with_suffix(".toml").read_text()
    (told,) = (line for line in draft_text.splitlines() if line.startswith("outputs.angle"))
    assert 'column = "position[0]", unit = "deg"' in told
    assert "# guessed" in told
    for sentence in (
        'not used, angle is taken from "position[0]": "position[1]"',
        'not used, constant: "effort[0]"',
        'not used, the name does not tell what it is: "humidity"',
        'not used, not numbers throughout: "mode"',
    ):
        assert sentence in out.splitlines()
        assert f"# {sentence}" in draft_text.splitlines()


def episode(rows: int = 200) -> tuple[list[dict[str, object]], np.ndarray, np.ndarray]:
    """Frames as LeRobot records them, with the actions and readings [deg] of two joints."""
    times = np.arange(rows) / 50.0
    action = np.array([40.0 * np.sign(np.sin(3.0 * (1 + k) * times)) for k in range(2)]).T
    random = np.random.default_rng(0)
    state = lfilter([0.2], [1.0, -0.8], action, axis=0) + 0.05 * random.standard_normal((rows, 2))
    frames: list[dict[str, object]] = [
        {
            "timestamp": float(times[k]),
            "frame_index": k,
            "episode_index": 0,
            "index": 1000 + k,
            "observation": {"state": list(state[k])},
            "action": list(action[k]),
        }
        for k in range(rows)
    ]
    return frames, action, state


@pytest.mark.parametrize("actuator", ["smart_servo", "sg90"])
def test_an_action_is_a_command_and_an_observation_a_reading(tmp_path: Path, actuator: str) -> None:
    frames, action, state = episode()
    path = tmp_path / "episode.jsonl"
    path.write_text("\n".join(map(json.dumps, frames)))
    made = draft(path, actuator)
    (command,) = [match for match in made.matches if match.wire in made.actuator.plant.inputs]
    (reading,) = [match for match in made.matches if match.wire not in made.actuator.plant.inputs]
    assert (command.column.key, command.wire.name) == ("action[0]", made.actuator.step[0])
    assert np.array_equal(command.column.values, action[:, 0])
    assert (reading.column.key, reading.wire.name) == ("observation.state[0]", "angle")
    assert np.array_equal(reading.column.values, state[:, 0])
    assert 'not used, it counts rows, or runs of them: "frame_index", "index"' in made.not_used
    assert any('taken from "action[0]": "action[1]"' in text for text in made.not_used)
    target = tmp_path / "rig.toml"
    target.write_text(made.text(tmp_path))
    (log,) = read_description(target).logs
    assert list(log.inputs) == [made.actuator.step[0]]
    assert log.outputs["angle"] == pytest.approx(np.radians(state[:, 0]))


def test_joints_by_name_are_paired(tmp_path: Path) -> None:
    frames, _, _ = episode()
    rows = [
        {
            "timestamp": frame["timestamp"],
            "action.pan.pos": frame["action"][0],  # type: ignore[index]
            "observation.state.pan.pos": frame["observation"]["state"][0],  # type: ignore[index]
        }
        for frame in frames
    ]
    path = tmp_path / "episode.csv"
    pl.DataFrame(rows).write_csv(path)
    matched = {match.wire.name: match.column.key for match in draft(path, "smart_servo").matches}
    assert matched == {"goal": "action.pan.pos", "angle": "observation.state.pan.pos"}


def test_an_input_that_never_changes_is_kept_where_its_name_is_its_own(tmp_path: Path) -> None:
    log, path = motor_log(), tmp_path / "log.csv"
    columns = {"time_s": log.times, "voltage [V]": log.inputs["voltage"]}
    columns["angle_deg"] = np.degrees(log.outputs["angle"])
    columns["load_torque [mN.m]"] = np.full(len(log.times), 2.0)
    columns["stiffness"] = np.full(len(log.times), 1.0)
    pl.DataFrame(columns).write_csv(path)
    made = draft(path, "torque_motor")
    assert 'not used, constant: "stiffness"' in made.not_used
    target = tmp_path / "rig.toml"
    target.write_text(made.text(tmp_path))
    (read,) = read_description(target).logs
    assert read.inputs["load_torque"] == pytest.approx(2e-3)


def table_of(path: Path, heading: str, command: np.ndarray, reading: np.ndarray) -> Path:
    columns = [0.02 * np.arange(len(command)), command, reading]
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=heading, comments="")
    return path


STEP = np.where(np.arange(100) < 20, 0.0, 0.5)
LATER = lfilter([0.2], [1.0, -0.8], STEP)
RAMP = np.maximum(np.arange(100) - 19.0, 0.0)


@pytest.mark.parametrize(
    ("heading", "command", "reading", "actuator", "signals"),
    [
        ("t,voltage,encoder", 12 * STEP, RAMP, "dc_motor", ("voltage", "encoder_angle")),
        (
            "t,current,speed_rpm",
            STEP,
            RAMP,
            "dc_motor_current",
            ("current_command", "encoder_speed"),
        ),
        (
            "t,velocity_setpoint,velocity",
            STEP,
            RAMP,
            "dc_motor_speed",
            ("speed_command", "encoder_speed"),
        ),
        ("time,action,observation.state", STEP, LATER, "second_order_servo", ("goal", "angle")),
        ("timestamp,action,position", STEP, LATER, "second_order_servo", ("goal", "angle")),
        (
            "t,action_deg,position_deg",
            60 * STEP,
            60 * LATER,
            "second_order_servo",
            ("goal", "angle"),
        ),
        ("t,action_rad,position_rad", STEP, LATER, "second_order_servo", ("goal", "angle")),
        ("t,goal_position,present_position", STEP, LATER, "smart_servo", ("goal", "angle")),
        ("t,voltage,angle", 12 * STEP, 0.1 * LATER, "torque_motor", ("voltage", "angle")),
        ("t,pwm_us,angle", 1500 + 500 * STEP, LATER, "sg90", ("pulse_width", "angle")),
    ],
)
def test_the_actuator_is_one_that_has_a_command_and_a_reading_of_these_words(
    tmp_path: Path,
    heading: str,
    command: np.ndarray,
    reading: np.ndarray,
    actuator: str,
    signals: tuple[str, str],
) -> None:
    path = table_of(tmp_path / "log.csv", heading, command, reading)
    made = draft(path)
    assert made.actuator.name == actuator
    _, first, second = heading.split(",")
    matched = {match.column.key: match.wire.name for match in made.matches}
    assert matched == dict(zip((first, second), signals))
    target = tmp_path / "log.toml"
    target.write_text(made.text(tmp_path))
    assert read_description(target).actuator.name == actuator


@pytest.mark.parametrize(
    ("heading", "given", "proposed"),
    [
        (
            "t,position_command,encoder_angle",
            "dc_motor_speed",
            ("dc_motor_speed", "odrive_position"),
        ),
        ("t,speed_command,encoder_speed", "dc_motor_speed", ("dc_motor_speed", "direct")),
        ("t,target_position_deg,encoder", None, ("smart_servo", "xl330")),
    ],
)
def test_a_motor_in_a_position_loop_is_proposed_where_it_is_named(
    tmp_path: Path, heading: str, given: str | None, proposed: tuple[str, str]
) -> None:
    made = draft(table_of(tmp_path / "log.csv", heading, STEP, LATER), given)
    assert (made.actuator.name, made.variant.name) == proposed


BATTERY = 7.4 - 0.02 * LATER + 0.01 * np.cos(np.arange(100))
"""A battery [V] that sags a little under load."""


@pytest.mark.parametrize(
    ("heading", "first", "fourth", "actuator", "command"),
    [
        ("t,pwm_us,angle,battery_voltage", 1500 + 500 * STEP, BATTERY, "sg90", "pwm_us"),
        ("t,pwm_us,angle_deg,voltage", 1500 + 500 * STEP, BATTERY, "sg90", "pwm_us"),
        ("t,pwm_us,angle_deg,voltage", 1500 + 500 * STEP, 12 * LATER, "sg90", "pwm_us"),
        ("t,pwm,angle_deg,voltage", 1500 + 500 * STEP, BATTERY, "sg90", "pwm"),
        ("t,goal_deg,angle_deg,voltage", 60 * STEP, BATTERY, "smart_servo", "goal_deg"),
        ("t,cmd_deg,angle_deg,voltage", 60 * STEP, 12 * LATER, "smart_servo", "cmd_deg"),
        ("t,goal_rad,position_rad,input_volts", STEP, BATTERY, "smart_servo", "goal_rad"),
        ("t,command_rad,position_rad,current", STEP, LATER, "smart_servo", "command_rad"),
        ("t,voltage,angle,supply", 12 * STEP, BATTERY, "torque_motor", "voltage"),
        ("t,loop_us,angle,voltage", 900 + 30 * LATER, 12 * STEP, "torque_motor", "voltage"),
    ],
)
def test_a_command_is_told_from_a_battery_and_other_readings(
    tmp_path: Path,
    heading: str,
    first: np.ndarray,
    fourth: np.ndarray,
    actuator: str,
    command: str,
) -> None:
    """A unit or a word that only a command has counts as much as the name of another input."""
    columns = (0.02 * np.arange(100), first, LATER, fourth)
    path = tmp_path / "log.csv"
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=heading, comments="")
    made = draft(path)
    assert made.actuator.name == actuator
    matched = {match.column.key: match.wire for match in made.matches}
    assert matched[command].name == made.main
    feeds = ("battery_voltage", "supply", "input_volts")
    assert all("supply" in matched[key].name for key in feeds if key in matched)
    assert "input_volts" not in heading or "input_volts" in matched
    target = tmp_path / "log.toml"
    target.write_text(made.text(tmp_path))
    assert read_description(target).actuator.name == actuator


@pytest.mark.parametrize(
    ("heading", "command", "variant", "entry"),
    [
        (
            "t,action_deg,position_deg",
            60 * STEP,
            "bus",
            'inputs.goal = { column = "action_deg", unit = "deg" }',
        ),
        ("t,action,position", STEP, "bus", 'inputs.goal = { column = "action", unit = "rad" }'),
        (
            "t,pulse_us,position_deg",
            1500 + 600 * STEP,
            "pulse",
            'inputs.pulse_width = { column = "pulse_us", unit = "us" }',
        ),
    ],
)
def test_the_variant_is_the_one_of_the_command(
    tmp_path: Path, heading: str, command: np.ndarray, variant: str, entry: str
) -> None:
    path = table_of(tmp_path / "log.csv", heading, command, np.ptp(command) * LATER)
    target = tmp_path / "log.toml"
    text = draft(path, "second_order_servo").text(tmp_path)
    target.write_text(text)
    assert read_description(target).variant == variant
    assert entry in text


@pytest.mark.parametrize(("name", "volts"), [("sts3215", "7.4 V"), ("sts3215_12v", "12 V")])
def test_the_motor_that_a_file_names_gives_variant_and_supply(
    tmp_path: Path, name: str, volts: str
) -> None:
    entries = [
        {"timestamp": time, "goal_position": goal, "position": angle}
        for time, goal, angle in zip(0.02 * np.arange(len(STEP)), STEP, LATER)
    ]
    log = {"motor": name.upper(), "entries": entries}
    (tmp_path / "arm.json").write_text(json.dumps(log))
    text = draft(tmp_path / "arm.json", "smart_servo").text(tmp_path)
    (tmp_path / "log.toml").write_text(text)
    assert read_description(tmp_path / "log.toml").variant == name
    assert f'supply = "{volts}"' in text
