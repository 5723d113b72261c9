"""Exports: what a law can hold is recovered, what it cannot is told, and errors are measured."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from servo_models.data.parameters import Estimate, ParameterSet, write_parameters
from servo_models.diagnosis.comparison.compare import compare
from servo_models.effects import effects
from servo_models.errors import UserError
from servo_models.simulators import simulators
from servo_models.simulators.export import export
from servo_models.simulators.sections import ExportDocument
from servo_models.simulators.simulator import EXACT, LOST, NO_FIELD, Simulator
from tests.conftest import Run
from tests.support.document import ROOT, code_blocks, follow
from tests.support.schemas import check_schema

UAV = ROOT / "examples" / "uav"
PAGE = (ROOT / "docs" / "simulators.md").read_text(encoding="utf-8")
FREQUENCY, RATIO, SPEED, MASS = 30.0, 0.9, 5.0, 0.01  # rad/s, 1, rad/s, kg m2
MOTION = {
    "natural_frequency": FREQUENCY,
    "damping_ratio": RATIO,
    "speed_limit": SPEED,
    "acceleration_limit": 1e7,
    "inertia": MASS,
    "transport_delay.time": 0.02,
}


def written(folder: Path, values: dict[str, float], actuator: str = "second_order_servo") -> Path:
    path = folder / "servo.toml"
    variant = {"second_order_servo": "bus", "torque_motor": "measured"}[actuator]
    given = tuple(Estimate(name, value) for name, value in values.items())
    write_parameters(ParameterSet(actuator, variant, given), path)
    return path


def test_mujoco_recovers_the_servo_that_it_can_hold(tmp_path: Path) -> None:
    """A servo with a largest speed is stiffness, damping and force limit of a joint exactly, but
    for steps of 2 ms and a friction loss that is soft."""
    friction = 0.05  # N m
    path = written(tmp_path, {**MOTION, "coulomb_friction.level": friction})
    found = export(path, "mujoco")
    values, damping = found.values, 2.0 * RATIO * FREQUENCY * MASS
    assert values["kp"] == pytest.approx(FREQUENCY**2 * MASS, rel=0.05)
    assert values["damping"] == pytest.approx(damping, rel=0.05)
    assert values["forcerange"] == pytest.approx(damping * SPEED, rel=0.05)
    assert values["frictionloss"] == pytest.approx(friction, rel=0.1)
    assert values["delay"] * found.step == pytest.approx(0.02, abs=found.step)
    assert (values["kv"], values["timeconst"]) == (0.0, 0.0)
    assert found.errors[0].native_to_diagnosed < 0.004
    assert f'armature="{MASS:.5g}"' in found.lines


def test_jsbsim_recovers_lag_and_rate(tmp_path: Path) -> None:
    fast = {**MOTION, "natural_frequency": 1000.0, "damping_ratio": 1.0, "speed_limit": 1e4}
    ahead = {"command_lag.time_constant": 0.1, "rate_limit.rate": 4.0}
    found = export(written(tmp_path, {**fast, **ahead}), "jsbsim")
    assert found.values["lag"] == pytest.approx(1.0 / 0.1, rel=0.03)
    assert found.values["rate_limit"] == pytest.approx(4.0, rel=0.03)
    assert found.values["hysteresis_width"] == found.values["deadband_width"] == 0.0
    assert {it.degree for it in found.held.values()} == {EXACT}


def test_jsbsim_takes_the_stops_as_they_are(tmp_path: Path) -> None:
    """And fits the rest as without them: the large steps go beyond them."""
    speed = 4.0  # rad/s
    ahead = {"command_lag.time_constant": 0.1, "rate_limit.rate": speed}
    fast = {**MOTION, "natural_frequency": 1000.0, "damping_ratio": 1.0, "speed_limit": 1e4}
    values = {**fast, **ahead, "end_stops.half_range": 0.25}
    found = export(written(tmp_path, values), "jsbsim")
    assert found.values["lag"] == pytest.approx(1.0 / 0.1, rel=0.03)
    assert found.values["rate_limit"] == pytest.approx(speed, rel=0.03)
    assert "<clipto><min>-0.25</min><max>0.25</max></clipto>" in found.lines
    assert found.errors[0].native_to_diagnosed < 0.1 * speed * found.step  # a tenth of a frame


def test_what_is_lost_is_said_and_the_rest_is_in_words(tmp_path: Path) -> None:
    found = export(written(tmp_path, {**MOTION, "backlash.half_width": 0.02}), "isaaclab")
    assert {name: it.degree for name, it in found.held.items()} == {
        "transport_delay": EXACT,
        "backlash": LOST,
    }
    text = str(found)
    assert "lost: backlash; the FMU" in text
    assert "one body" in text


def test_an_effect_whose_field_was_left_out_is_lost(tmp_path: Path) -> None:
    """Play far below what a lag in place of a second order is off."""
    found = export(written(tmp_path, {**MOTION, "backlash.half_width": 1e-5}), "jsbsim")
    assert found.values["hysteresis_width"] == 0.0
    assert found.held["backlash"] == (LOST, "hysteresis_width left out: no better with it")
    assert "lost: backlash" in str(found)


def test_on_a_log_the_errors_are_those_of_the_comparison() -> None:
    """Which simulates the sets of values on the log by itself."""
    found = export(UAV / "GAP.toml", "mujoco", UAV / "bench.toml")
    nominal, diagnosed = compare([UAV / "GAP.toml"], UAV / "bench.toml").errors["bench", "angle"]
    (error,) = found.errors
    assert error.nominal is not None
    assert error.native is not None
    assert (error.nominal, error.diagnosed) == pytest.approx((nominal, diagnosed))
    assert error.diagnosed < error.native < error.nominal  # it has the delay and not the play
    assert found.kept == pytest.approx((nominal - error.native) / (nominal - diagnosed))
    assert f"keeps {100.0 * found.kept:.0f} % of the closed gap" in str(found)


def test_the_command_writes_lines(tmp_path: Path, run: Run) -> None:
    path, out = written(tmp_path, MOTION), tmp_path / "servo.parm"
    code, said, _ = run("export", path, "--to", "ardupilot", "--out", out)
    assert code == 0
    assert "SIM_SERVO_" not in said.partition("Effects")[0]
    assert out.read_text().startswith("# SIM_RATE_HZ 1200\nSIM_SERVO_SPEED,")
    json_file = tmp_path / "servo.json"
    words = ("--time-step", "2.5 ms", "--json", json_file)
    code, said, _ = run("export", path, "--to", "jsbsim", *words)
    assert (code, "frames of 0.0025 s" in said) == (0, True)
    told = json.loads(json_file.read_text())
    check_schema(told, ExportDocument)
    assert told["lines"] in said
    assert told["effects"]["transport_delay"] == {"held": EXACT, "by": "delay, in whole frames"}
    assert (told["command"], told["command_unit"]) == ("goal", "rad")
    assert (told["slope"], told["zero"]) == (1.0, 0.0)
    assert (told["time_step"], told["inertia"]) == (0.0025, MASS)
    assert (told["kept"], told["errors"][0]["nominal"]) == (None, None)


def test_what_cannot_be_exported_is_told_with_the_cure(tmp_path: Path, run: Run) -> None:
    path = written(tmp_path, MOTION)
    bench, motor = UAV / "bench.toml", tmp_path / "motor"
    motor.mkdir()
    for words, said in (
        ([path, "--to", "mujoko"], "did you mean 'mujoco'?"),
        ([path, "--to", "mujoco", "--time-step", "1 s"], "give one from"),
        ([path, "--to", "mujoco", "--log", bench], "is of 'sg90', variant 'measured'"),
        ([path, "--to", "mujoco", "--out", path], "is read, not written"),
        ([path, "--to", "mujoco", "--json", path], "let the name end in .json"),
        ([tmp_path / "none.toml", "--to", "mujoco"], "none.toml"),
        ([written(motor, {}, "torque_motor"), "--to", "mujoco"], "build its FMU"),
    ):
        code, out, err = run("export", *words)
        assert (code, out) == (2, "")
        assert said in err
        assert len(err.splitlines()) == 1


def test_every_effect_that_is_named_is_one() -> None:
    placed = {f"{place}_{effect}" for effect in effects() for place in ("command",)}
    for name, it in simulators().items():
        assert it.holds.keys() <= effects().keys() | placed, name


def row(effect: str) -> str:
    """A row of the table of the documentation: how each simulator holds an effect."""

    def told(it: Simulator) -> str:
        held = it.held(effect, effect)
        at = it.holds.get(f"command_{effect}", NO_FIELD)
        more = f"; of the command {at.degree}: {at.how}" if at != NO_FIELD else ""
        return ("lost" if held == NO_FIELD else f"{held.degree}: {held.how}") + more

    return f"| `{effect}` | {' | '.join(map(told, simulators().values()))} |"


def test_the_table_of_the_documentation_is_that_of_the_declarations() -> None:
    titles = " | ".join(it.title for it in simulators().values())
    some = [
        it for it in effects() if any(s.held(it, it) != NO_FIELD for s in simulators().values())
    ]
    table = "\n".join([f"| effect | {titles} |", "|---" * 5 + "|", *map(row, some)])
    assert table in PAGE, f"write into docs/simulators.md:\n{table}"
    others = ", ".join(f"`{it}`" for it in effects() if it not in some)
    assert f"All lose {others}." in " ".join(PAGE.split()), f"write All lose {others}."


def test_the_examples_of_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    for path in UAV.glob("*.toml"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    (tmp_path / "bench.csv").write_bytes((UAV / "bench.csv").read_bytes())
    (tmp_path / "arm.xml").write_text(PAGE.split("```xml\n")[1].split("```")[0])
    monkeypatch.chdir(tmp_path)
    assert len(follow(PAGE, run)) == 3
    (code,) = code_blocks(PAGE, "python")
    exec(code)


def described(folder: Path, constants: tuple[str, ...] = ("",), output: str = "rate") -> Path:
    """Logs of sines with a rate or an angle."""
    unit = {"rate": "rad/s", "angle": "rad"}[output]
    times = np.arange(0.0, 1.0, 0.01)
    rows = "\n".join(f"{t},{math.sin(t)},{math.cos(t)}" for t in times)
    (folder / "log.csv").write_text(f"time,goal,{output}\n{rows}\n")
    logs = [
        f'[[logs]]\nname = "log {k}"\nfile = "log.csv"\ntime = {{column = "time", unit = "s"}}\n'
        f'inputs.goal = {{column = "goal", unit = "rad"}}\n{stated}\n'
        f'outputs.{output} = {{column = "{output}", unit = "{unit}"}}'
        for k, stated in enumerate(constants)
    ]
    head = 'actuator = "second_order_servo"\nvariant = "bus"'
    (folder / "log.toml").write_text("\n".join([head, *logs]))
    return folder / "log.toml"


def test_a_log_without_an_angle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no angle to compare with"):
        export(written(tmp_path, MOTION), "mujoco", described(tmp_path))


def test_logs_of_two_gains_are_no_one_joint(tmp_path: Path) -> None:
    of_two = ("constants.gain = 1.0", "constants.gain = 0.5")
    with pytest.raises(UserError, match="several 'gain'"):
        export(written(tmp_path, MOTION), "mujoco", described(tmp_path, of_two, "angle"))
