"""servo-models diagnose: what it refuses in one line, before the work, and what it doubts."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.description import read_description
from servo_models.diagnosis.preconditions import check_duration
from servo_models.errors import UserError
from servo_models.validation.linear_drive.reference import G_TAU, K_V
from tests.conftest import Run
from tests.support.delayed_motor import DESCRIPTION, RATE, describe
from tests.support.schemas import check_schema

BAD = {
    "no file": ("", "no file", "absent.csv"),
    "another actuator's input": (
        DESCRIPTION.format("").replace("inputs.voltage", "inputs.pulse_width"),
        "pulse_width",
        "rig.toml",
    ),
    "another actuator's parameters": (
        DESCRIPTION.format("").replace('actuator = "torque_motor"', 'actuator = "sg90"'),
        "variant",
        "rig.toml",
    ),
}


@pytest.mark.parametrize("tolerance", ["nan", "inf"])
def test_a_tolerance_that_is_no_number_is_refused(tolerance: str, run: Run, tmp_path: Path) -> None:
    code, _, err = run("diagnose", describe(tmp_path), "--tolerance", tolerance)
    assert code == 2
    assert len(err.splitlines()) == 1
    assert "--tolerance" in err


@pytest.mark.thorough
@pytest.mark.parametrize(("seconds", "short"), [(0.03, True), (0.04, False)])
def test_a_record_too_short_to_know_its_noise_is_told(
    seconds: float, short: bool, run: Run, tmp_path: Path
) -> None:
    """120 and 160 samples."""
    _, out, _ = run("diagnose", describe(tmp_path, seconds=seconds), "--format", "json")
    told = [it for it in json.loads(out)["warnings"] if "fewer than 128 samples" in it]
    assert len(told) == short
    assert all("'log'" in it and "log longer" in it for it in told)


def with_flag(folder: Path, outputs: str) -> Path:
    """The log of a rig with a flag that is never raised."""
    path = describe(folder, DESCRIPTION.format("").replace("outputs.angle", outputs))
    head, *rows = (folder / "log.csv").read_text().splitlines()
    lines = [f"{head},stop", *(f"{row},0" for row in rows)]
    (folder / "log.csv").write_text("\n".join(lines))
    return path


@pytest.mark.thorough
def test_a_flag_is_not_judged(run: Run, tmp_path: Path) -> None:
    """Whatever it is, all figures are those without it, and a warning says so."""
    (tmp_path / "flag").mkdir()
    (tmp_path / "plain").mkdir()
    flag = 'outputs.at_stop = { column = "stop" }\noutputs.angle'
    found = []
    for path in (with_flag(tmp_path / "flag", flag), describe(tmp_path / "plain")):
        code, out, _ = run("diagnose", path, "--format", "json")
        assert code == 1
        found.append(json.loads(out))
    told, plain = found
    assert told["gap"] == plain["gap"]
    assert told["effects"] == plain["effects"]
    (more,) = set(told["warnings"]) - set(plain["warnings"])
    assert "'at_stop' is a flag, 0 or 1" in more


def test_a_log_of_a_flag_alone_is_refused(run: Run, tmp_path: Path) -> None:
    alone = 'outputs.at_stop = { column = "stop" }\n#'
    code, _, err = run("diagnose", with_flag(tmp_path, alone))
    assert code == 2
    assert "'log'" in err
    assert "'at_stop'" in err
    assert len(err.splitlines()) == 1


@pytest.mark.thorough
def test_a_log_on_which_the_diagnosed_model_runs_away_stops_nothing(
    run: Run, tmp_path: Path
) -> None:
    """Held out, without stops and with a spring so soft that, bent as the other log tells, it
    gives way."""
    path = describe(tmp_path)
    times = np.arange(0.0, 0.3, 1.0 / RATE)
    voltage = 14.0 * np.sign(np.sin(2.0 * np.pi * 12.0 * times))
    effects = {"transport_delay.time": 0.0, "stiffness_hardening.coefficient": -160.0}
    rig = model("torque_motor", "identified", effects)
    angle = np.rad2deg(simulate(rig, times, {"voltage": voltage})["angle"])
    noisy = angle + 1e-3 * np.random.default_rng(1).standard_normal(len(times))
    rows = np.column_stack([times, voltage, noisy])
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", delimiter=",", header="t,u,angle", comments="")
    log = DESCRIPTION[DESCRIPTION.index("[[logs]]") :].format("")
    soft = f'{log}name = "soft"\nheld_out = true\nconstants.stiffness = 0.3\n'
    soft += "constants.end_stops.half_range = 0.0\n"
    path.write_text(DESCRIPTION.format("") + soft)
    page = tmp_path / "d.html"
    code, out, err = run("diagnose", path, "--format", "json", "--report", page)
    assert code == 1, err
    told = json.loads(out)
    check_schema(told)
    assert any(one["name"] == "stiffness_hardening" and one["taken"] for one in told["effects"])
    (soft_,) = [one for one in told["held_out"] if one["log"] == "soft"]
    assert soft_["worse"]
    assert soft_["after"] is None
    assert soft_["retuned"] > 0.0
    confirmed = told["confirmation"]["outputs"]["angle"]
    assert confirmed["held_out"]["after"] is None
    assert confirmed["fit"]["after"] > 0.0
    assert any("'soft'" in text and "cannot be simulated" in text for text in told["warnings"])
    assert page.exists()


@pytest.mark.thorough
def test_a_platform_that_runs_no_fmu_gets_its_diagnosis(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object) -> None:
        raise UserError("FMU 'diagnosed.fmu' cannot be initialised: no binary for this platform")

    monkeypatch.setattr("servo_models.diagnosis.confirm.confirm", none)
    written = [tmp_path / name for name in ("d.json", "d.html", "d.toml")]
    options = zip(("--json", "--report", "--out"), written)
    path = describe(tmp_path, seconds=0.1)
    code, out, err = run("diagnose", path, *(word for option in options for word in option))
    assert code == 1, err
    assert all(file.exists() for file in written)
    told = json.loads(written[0].read_text())
    check_schema(told)
    assert told["confirmation"] is None
    assert any("no binary for this platform" in text for text in told["warnings"])
    assert "no binary for this platform" in out
    assert "after as the FMU" not in out
    assert "no binary for this platform" in written[1].read_text()


@pytest.mark.parametrize(
    ("option", "name"),
    [
        ("--out", "rig.toml"),
        ("--out", "values.toml"),
        ("--json", "log.json"),
        ("--signals", "log.mcap"),
    ],
)
def test_what_is_read_is_not_written(option: str, name: str, run: Run, tmp_path: Path) -> None:
    log = name if name.startswith("log") else "log.json"
    path = describe(tmp_path, DESCRIPTION.format("").replace("log.csv", log))
    path.write_text('params = "values.toml"\n' + path.read_text())
    for other in ("values.toml", log):
        (tmp_path / other).write_text("kept")
    before = (tmp_path / name).read_text()
    for command in ("diagnose", "identify") if option == "--out" else ("diagnose",):
        code, out, err = run(command, path, option, tmp_path / name)
        assert (code, out) == (2, "")
        assert err.count("\n") == 1
        assert f"{name}' is read, not written: choose another name" in err
        assert (tmp_path / name).read_text() == before


@pytest.mark.parametrize("name", BAD)
def test_bad_input_is_one_line_and_leaves_no_file(name: str, run: Run, tmp_path: Path) -> None:
    text, what, where = BAD[name]
    path = describe(tmp_path, text or DESCRIPTION.format("").replace("log.csv", "absent.csv"))
    code, out, err = run("diagnose", path, "--json", tmp_path / "d.json")
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert what in err
    assert where in err
    assert not (tmp_path / "d.json").exists()


def test_a_log_shorter_than_the_slowest_time_constant_is_refused(run: Run, tmp_path: Path) -> None:
    """The slowest pole of eq. 12 is at -120 rad/s: 8.33 ms."""
    path = describe(tmp_path, seconds=0.008)
    code, _, err = run("diagnose", path)
    assert code == 2
    assert "0.00833 s" in err
    assert "'log' lasts 0.00775 s" in err
    assert len(err.splitlines()) == 1


class Loop(NamedTuple):
    """An actuator with the second-order law of its loop: inertia and damping."""

    name: str
    variant: str
    input: str
    output: str
    inertia: float
    damping: float

    @property
    def slowest(self) -> float:
        """Time constant [s] with which an oscillation dies."""
        return 2.0 * self.inertia / self.damping


STALL_TORQUE, NO_LOAD_SPEED = 19.5 * 0.0980665, 52.0 * 2.0 * np.pi / 60.0
LOOPS = (
    Loop("sg90", "measured", "pulse_width", "angle", 0.0347, 1.0),
    Loop("linear_drive", "simple", "reference", "position", 100.0, 250.0 + G_TAU * K_V),
    Loop("smart_servo", "sts3215", "goal", "angle_reading", 0.03, STALL_TORQUE / NO_LOAD_SPEED),
)


def describe_loop(folder: Path, loop: Loop, seconds: float) -> Path:
    """A short log of it: a step at once, and any reading that moves."""
    rest = {"pulse_width": 1.5e-3}.get(loop.input, 0.0)
    rows = np.linspace([0.0, rest, 0.0], [seconds, 1.01 * rest + 1e-4, 0.01], 40)
    np.savetxt(folder / "log.csv", rows, "%.9g", delimiter=",", header="t,u,y", comments="")
    path = folder / "rig.toml"
    path.write_text(
        f'actuator = "{loop.name}"\nvariant = "{loop.variant}"\n[[logs]]\nfile = "log.csv"\n'
        f'time = "t"\ninputs.{loop.input} = "u"\noutputs.{loop.output} = "y"\n'
    )
    return path


@pytest.mark.parametrize("loop", LOOPS, ids=lambda it: it.name)
def test_a_log_shorter_than_what_the_loop_needs_to_settle_is_refused(
    loop: Loop, run: Run, tmp_path: Path
) -> None:
    """A clock of the controller moves its poles a little: by less than a tenth."""
    path = describe_loop(tmp_path, loop, 0.9 * loop.slowest)
    code, out, err = run("diagnose", path)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    told = re.search(rf"slowest time constant of '{loop.name}' is (\S+) s", err)
    assert told
    assert float(told[1]) == pytest.approx(loop.slowest, rel=0.1)
    long_enough = read_description(describe_loop(tmp_path, loop, 1.1 * loop.slowest))
    check_duration(long_enough.model, long_enough.logs)


def test_a_motor_that_nothing_holds_may_be_logged_for_a_moment(tmp_path: Path) -> None:
    """Its angle has no place to settle at; its speed alone would take J / b = 5 s."""
    motor = Loop("dc_motor_current", "direct", "current_command", "encoder_angle", 1e-5, 2e-6)
    told = read_description(describe_loop(tmp_path, motor, 0.5))
    check_duration(told.model, told.logs)


def test_names_of_outputs_are_looked_at_before_the_work(run: Run, tmp_path: Path) -> None:
    path = describe(tmp_path)
    for option, name in (
        ("--json", "d.txt"),
        ("--out", "p.json"),
        ("--report", "d.pdf"),
        ("--signals", "s.txt"),
    ):
        code, _, err = run("diagnose", path, option, tmp_path / name)
        assert code == 2
        assert "let the name end in" in err
        assert not (tmp_path / name).exists()


@pytest.mark.thorough
def test_a_log_of_something_else_is_doubted(run: Run, tmp_path: Path) -> None:
    """Readings that have nothing to do with the command: noise."""
    path = describe(tmp_path, seconds=0.1)
    rows = np.loadtxt(tmp_path / "log.csv", delimiter=",", skiprows=1)
    rows[:, 2] = np.random.default_rng(1).standard_normal(len(rows))
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,u,angle", comments="")
    _, out, _ = run("diagnose", path, "--format", "json", "--tolerance", "0.1")
    document = json.loads(out)
    floor = document["gap"]["outputs"]["angle"]["floor"]
    assert floor == pytest.approx(np.deg2rad(1.0), rel=0.1)
    assert any("hardly anything of 'angle'" in text for text in document["warnings"])


HEAD = """actuator = "torque_motor"
variant = "identified"
free = ["torque_constant", "inductance"]
[uncertainty]
torque_constant = "20 %"
inductance = "20 %"
"""
LOG = """[[logs]]
file = "{0}.csv"
time = "t"
inputs.voltage = "u"
outputs.angle = "angle"
{1}
"""
TIMES = np.arange(0.0, 0.3, 1e-3)
SQUARE = 8.0 * np.sign(np.sin(2.0 * np.pi * 12.0 * TIMES))
STILL = np.zeros(len(TIMES))


def recorded(folder: Path, name: str, voltage: Array, load: float = 0.0) -> None:
    rig = model("torque_motor", "identified")
    loads = np.full(len(TIMES), load)
    angle = simulate(rig, TIMES, {"voltage": voltage, "load_torque": loads})["angle"]
    angle = angle + 1e-4 * np.random.default_rng(1).standard_normal(len(TIMES))
    rows = np.column_stack([TIMES, voltage, angle, loads])
    np.savetxt(
        folder / f"{name}.csv", rows, "%.9g", delimiter=",", header="t,u,angle,load", comments=""
    )


def description(folder: Path, *logs: str, head: str = HEAD) -> Path:
    path = folder / "rig.toml"
    path.write_text(head + "".join(logs))
    return path


AWAY = (
    "[parameters]\nstiffness = 0.3\nend_stops.half_range = 0\n"
    "stiffness_hardening.coefficient = -200\n"
)
"""A spring that softens until the rotor runs away."""


@pytest.mark.parametrize(
    ("head", "logs", "said"),
    [
        (HEAD, [("still", "")], "no input ever changes, neither in a log nor from one to another"),
        (HEAD, [("still", ""), ("square", "held_out = true")], "no input ever changes"),
        (HEAD, [("square", 'held_out = { from = "2 ms" }')], "2 samples to fit for 2 free param"),
        (HEAD, [("square", "held_out = true")], "rig.toml' holds out every sample"),
        (f'method = "simulation"\nsweeps = []\n{HEAD}', [], "rig.toml', sweeps: has no table"),
        (HEAD + AWAY, [("square", "")], "the nominal model cannot be simulated on log 'square'"),
    ],
)
def test_both_commands_refuse_in_the_same_words(
    run: Run, tmp_path: Path, head: str, logs: list[tuple[str, str]], said: str
) -> None:
    recorded(tmp_path, "still", STILL)
    recorded(tmp_path, "square", SQUARE)
    path = description(tmp_path, *(LOG.format(*log) for log in logs), head=head)
    told = []
    for command in ("identify", "diagnose"):
        code, out, err = run(command, path)
        assert (code, out) == (2, "")
        told.append(err)
    assert told[0] == told[1]
    assert told[0].count("\n") == 1
    assert said in told[0]


@pytest.mark.thorough
@pytest.mark.parametrize("command", ["check", "identify", "diagnose"])
def test_runs_with_an_input_that_does_not_change_in_them(
    command: str, run: Run, tmp_path: Path
) -> None:
    """Each run has its own load, and one of them stands still."""
    mapped = 'inputs.load_torque = "load"\nsettle = 0'
    runs = {"free": (SQUARE, 0.0), "loaded": (SQUARE, 2e-3), "still": (STILL, 2e-3)}
    for name, (voltage, load) in runs.items():
        recorded(tmp_path, name, voltage, load)
    path = description(tmp_path, *(LOG.format(name, mapped) for name in runs))
    code, out, err = run(command, path, *(["--format", "json"] if command == "diagnose" else []))
    assert code == 0, err
    assert "ever changes" not in out
    if command == "diagnose":
        assert json.loads(out)["verdict"] == "no-gap"


NOISE = 1e-3
LEVELS = (0.0, 0.5, -0.3, 0.2, 0.8, -0.5, 0.0)  # commanded angles [rad]
AS_TORQUE_MOTOR = """
actuator = "torque_motor"
variant = "estimated"
[uncertainty]
torque_constant = "10 %"
stiffness = "10 %"
[[logs]]
file = "log.csv"
time = "t"
inputs.voltage = { column = "command", unit = "V", scale = 10 }
outputs.angle = "angle"
"""
AS_SG90 = """
actuator = "sg90"
[[logs]]
file = "log.csv"
time = "t"
inputs.pulse_width = { column = "command", unit = "us", scale = 590.8, offset = 1500 }
outputs.angle = "angle"
"""


def record(folder: Path, text: str, times: Array, command: Array, angle: Array) -> Path:
    """Write a log beside a description of it."""
    reading = angle + NOISE * np.random.default_rng(1).standard_normal(len(times))
    rows = np.column_stack([times, command, reading])
    names = "t,command,angle"
    np.savetxt(folder / "log.csv", rows, "%.9g", delimiter=",", header=names, comments="")
    path = folder / "rig.toml"
    path.write_text(text)
    return path


def smart_servo(times: Array, command: Array) -> Array:
    return simulate(model("smart_servo", "sts3215"), times, {"goal": command})["angle"]


def linear_drive(times: Array, command: Array) -> Array:
    """A carriage that pulls a drum of 50 mm."""
    chosen = model("linear_drive", "identified")
    return simulate(chosen, times, {"reference": 0.05 * command})["position"] / 0.05


@pytest.mark.parametrize(
    ("rig", "step", "described", "doubt"),
    [
        pytest.param(
            *(smart_servo, 2.5e-3, AS_TORQUE_MOTOR, "that the log is of 'torque_motor'"),
            id="a smart servo as a torque motor",
            marks=pytest.mark.thorough,
        ),
        pytest.param(
            *(linear_drive, 1e-2, AS_SG90, "moved further than their uncertainties allow"),
            id="a linear drive as an SG90",
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_log_of_another_actuator_is_outside_the_catalogue(
    rig: Callable[[Array, Array], Array],
    step: float,
    described: str,
    doubt: str,
    run: Run,
    tmp_path: Path,
) -> None:
    command = np.repeat(LEVELS, 30)
    times = np.asarray(step * np.arange(len(command)), dtype=np.float64)
    path = record(tmp_path, described, times, command, rig(times, command))
    code, out, _ = run("diagnose", path, "--format", "json")
    document = json.loads(out)
    assert code == 1
    assert document["verdict"] == "outside-catalogue"
    assert document["sentence"].startswith("Outside the catalogue: ")
    assert document["gap"]["after"] > 10.0
    assert any(doubt in text for text in document["warnings"])


def test_a_log_of_a_quick_actuator_is_refused_under_a_slow_one(run: Run, tmp_path: Path) -> None:
    """A torque motor settles in milliseconds, an SG90 in a tenth of a second."""
    times = np.asarray(2.5e-4 * np.arange(200), dtype=np.float64)
    command = np.repeat([0.0, 0.5], 100)
    angle = simulate(model("torque_motor"), times, {"voltage": 10.0 * command})["angle"]
    code, out, err = run("diagnose", record(tmp_path, AS_SG90, times, command, angle))
    assert (code, out) == (2, "")
    assert "correct the unit of its time or the actuator" in err
    assert len(err.splitlines()) == 1
