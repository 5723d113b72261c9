"""Simulations that are not ours as models: a Python function, an FMU, a joint of MuJoCo."""

from __future__ import annotations

import functools
import re
import signal
import sys
import threading
from pathlib import Path

import fmpy
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models import check, diagnose, model, read_description, simulate
from servo_models.analysis.simulate import Result
from servo_models.build import build
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.core.workers import Workers
from servo_models.data.scaffold import draft
from servo_models.errors import UserError
from servo_models.foreign import function
from servo_models.foreign.box import finer, held
from tests.conftest import Run

FIRST_ORDER = """
import fmpy
import numpy as np

INPUTS = {"goal": "90 deg"}
OUTPUTS = {"angle": "90 deg"}
PARAMETERS = {"time_constant": "50 ms"}
STEP = 0.002

def simulate(parameters, times, inputs):
    print("what it prints goes elsewhere")
    angle = np.zeros(len(times))
    decay = np.exp(-np.diff(times) / parameters["time_constant"])
    for k, left in enumerate(decay):
        angle[k + 1] = inputs["goal"][k] + left * (angle[k] - inputs["goal"][k])
    return {"angle": angle}
"""
TAU = 0.05
MJCF = """
<mujoco><compiler angle="radian"/>
  <option timestep="0.0005" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="elbow" axis="0 0 1" damping="0.3" armature="0.01" range="-2 2"/>
      <geom type="sphere" size="0.01" mass="1e-6"/>
    </body>
    <body><joint name="free_one"/><geom type="sphere" size="0.01" mass="0.1"/></body>
  </worldbody>
  <actuator><position name="drive" joint="elbow" kp="20" kv="0.2" ctrlrange="-2 2"/></actuator>
</mujoco>
"""
TIMES = np.arange(0.0, 1.0, 0.005)


def first_order(folder: Path, text: str = FIRST_ORDER) -> str:
    (folder / "sim.py").write_text(text)
    return f"{folder / 'sim.py'}:simulate"


def step_of_first_order(times: Array, at: float, size: float) -> Array:
    """Exact."""
    return np.where(times > at, size * (1.0 - np.exp(-np.maximum(times - at, 0.0) / TAU)), 0.0)


def test_a_function_alone_gives_what_it_gives(tmp_path: Path) -> None:
    goal = np.where(TIMES >= 0.1, 0.5, 0.0)
    found = simulate(model(first_order(tmp_path)), TIMES, {"goal": goal})
    np.testing.assert_allclose(found["angle"], step_of_first_order(TIMES, 0.1, 0.5), atol=1e-12)
    assert not found.warnings


@pytest.mark.parametrize(
    ("effect", "size", "expected"),
    [
        ("transport_delay.time", 0.02, step_of_first_order(TIMES, 0.12, 0.5)),
        ("transport_delay.time", 0.0213, step_of_first_order(TIMES, 0.1213, 0.5)),
        ("command_gain.error", 0.1, step_of_first_order(TIMES, 0.1, 0.55)),
        ("command_offset.value", 0.0, step_of_first_order(TIMES, 0.1, 0.5)),
        ("sensor_offset.value", 0.01, 0.01 + step_of_first_order(TIMES, 0.1, 0.5)),
        ("command_saturation.limit", 0.3, step_of_first_order(TIMES, 0.1, 0.3)),
        (
            "backlash.half_width",
            0.05,
            np.maximum(step_of_first_order(TIMES, 0.1, 0.5) - 0.05, 0.0),
        ),
    ],
)
def test_effects_around_a_function_act_by_their_law(
    tmp_path: Path, effect: str, size: float, expected: Array
) -> None:
    chosen = model(first_order(tmp_path), None, {effect: size})
    found = simulate(chosen, TIMES, {"goal": np.where(TIMES >= 0.1, 0.5, 0.0)})
    np.testing.assert_allclose(found["angle"], expected, atol=1e-9)


def ramp_of_first_order(times: Array, at: float, rate: float) -> Array:
    """Exact."""
    since = np.maximum(times - at, 0.0)
    return rate * (since - TAU * (1.0 - np.exp(-since / TAU)))


SINCE = np.maximum(TIMES - 0.1, 0.0)
TWO_LAGS = 1.0 - (TAU * np.exp(-SINCE / TAU) - 0.03 * np.exp(-SINCE / 0.03)) / (TAU - 0.03)


@pytest.mark.parametrize(
    ("effect", "size", "expected", "most"),
    [
        ("command_lag.time_constant", 0.03, 0.5 * TWO_LAGS, 3e-4),
        ("sensor_lag.time_constant", 0.03, 0.5 * TWO_LAGS, 3e-4),
        (
            "rate_limit.rate",
            2.0,
            ramp_of_first_order(TIMES, 0.1, 2.0) - ramp_of_first_order(TIMES, 0.35, 2.0),
            3e-4,
        ),
    ],
)
def test_effects_that_move_within_a_step_are_neither_early_nor_late(
    tmp_path: Path, effect: str, size: float, expected: Array, most: float
) -> None:
    """Half a step, 1 ms, would be 2 to 10 mrad."""
    chosen = model(first_order(tmp_path), None, {effect: size})
    found = simulate(chosen, TIMES, {"goal": np.where(TIMES >= 0.1, 0.5, 0.0)})
    np.testing.assert_allclose(found["angle"], expected, atol=most)


def test_rows_far_apart_cost_a_box_no_effort_that_counts(tmp_path: Path) -> None:
    """A search ends runs of many sub-steps, told from the rows; a box takes its own."""
    chosen = model(first_order(tmp_path), None, {"internal_step": 0.05})
    times = np.arange(0.0, 1.0, 0.05)
    inputs, vector = np.full((len(times), 3), 0.5), np.array(list(chosen.values.values()))
    most = 8.0 * chosen.substeps(vector, times, inputs)
    found = chosen.from_rest(vector, times, inputs, most)[:, 0]
    np.testing.assert_allclose(found, step_of_first_order(times, 0.0, 0.5), atol=1e-12)


def test_delays_are_sought_on_the_time_scale_of_the_box(tmp_path: Path) -> None:
    """A lag is within a fiftieth of its end after ln 50 time constants."""
    fast = FIRST_ORDER.replace("50 ms", "1 ms").replace("STEP = 0.002", "STOP_TIME = 0.02")
    for name, text, tau in (("slow", FIRST_ORDER, 50e-3), ("fast", fast, 1e-3)):
        (tmp_path / name).mkdir()
        plant = model(first_order(tmp_path / name, text)).plant
        assert plant.time_scale / 3.0 == pytest.approx(np.log(50.0) * tau, rel=0.02)


WHAT_IS_SENT = """
INPUTS = {"goal": "90 deg"}
OUTPUTS = {"angle": "90 deg"}
PARAMETERS = {"time_constant": "50 ms"}

def simulate(parameters, times, inputs):
    return {"angle": inputs["goal"]}
"""


def test_a_box_is_sent_what_is_held_to_the_last_digit(tmp_path: Path) -> None:
    """Means that rounding moves may leave the bounds of an input."""
    boxed = model(first_order(tmp_path, WHAT_IS_SENT))
    times = np.arange(0.0, 20.0, 0.003)
    found = simulate(boxed, times, {"goal": np.full(len(times), 0.7)})
    assert set(found["sent_goal"]) == {0.7}
    assert set(found["angle"]) == {0.7}


@given(st.lists(st.floats(0.0, 0.02), min_size=1, max_size=30), st.floats(1e-4, 5e-3))
def test_a_finer_grid_holds_every_time_and_no_longer_step(steps: list[float], step: float) -> None:
    times = np.concatenate([[0.0], np.cumsum(steps)])
    grid, rows = finer(times, step)
    np.testing.assert_array_equal(grid[rows], times)
    assert np.diff(grid).max() <= step * (1.0 + 1e-6)
    row = held(times, grid)
    assert np.all(times[row] <= grid)
    assert np.all(np.append(times, np.inf)[row + 1] > grid)


@pytest.mark.thorough
def test_an_fmu_of_ours_gives_what_its_model_gives(tmp_path: Path) -> None:
    """The frame of this servo and its steps are in the FMU; around it nothing acts."""
    white = model("second_order_servo", "bus")
    file = build(white, tmp_path / "servo.fmu", "native")
    goal = 0.4 * np.sin(9.0 * TIMES)
    rest = {"pulse_width": 1.5e-3}
    black = simulate(model(str(file)), TIMES, {"goal": goal, **rest})
    np.testing.assert_allclose(
        black["angle"], simulate(white, TIMES, {"goal": goal, **rest})["angle"], atol=1e-9
    )


def test_a_joint_of_mujoco_follows_its_equation(tmp_path: Path) -> None:
    """0.01 y'' + (0.3 + 0.2) y' + 20 y = 20 u, solved exactly for a step; MuJoCo's own steps of
    0.5 ms leave an error of first order."""
    pytest.importorskip("mujoco", reason="the extra 'benchmark' is not installed")
    (tmp_path / "arm.xml").write_text(MJCF)
    chosen = model(f"{tmp_path / 'arm.xml'}#elbow")
    assert chosen.values["kp"] == 20.0
    found = simulate(chosen, TIMES, {"command": 0.5})
    omega, damping = np.sqrt(20.0 / 0.01), 0.5 / (2.0 * np.sqrt(20.0 * 0.01))
    turn = omega * np.sqrt(1.0 - damping**2)
    swing = np.cos(turn * TIMES) + damping * omega / turn * np.sin(turn * TIMES)
    exact = 0.5 * (1.0 - np.exp(-damping * omega * TIMES) * swing)
    np.testing.assert_allclose(found["angle"], exact, atol=0.01 * 0.5)


@pytest.mark.parametrize(
    ("actuator", "unit", "changed", "torque", "drag"),
    [
        ('<motor joint="elbow" gear="3"/>', "1", {"gear": 2.0}, 2.0, 0.0),
        (
            '<dcmotor joint="elbow" gear="2" motorconst="0.3" resistance="9"/>',
            "V",
            {"resistance": 2.0, "motorconst": 0.5},
            2.0 * 0.5 / 2.0,
            (2.0 * 0.5) ** 2 / 2.0,
        ),
    ],
    ids=["motor", "dcmotor"],
)
def test_a_motor_of_mujoco_follows_its_equation(
    actuator: str,
    unit: str,
    changed: dict[str, float],
    torque: float,
    drag: float,
    tmp_path: Path,
) -> None:
    """0.01 y'' + (0.3 + drag) y' = torque u, solved exactly for a step."""
    pytest.importorskip("mujoco", minversion="4.0")  # which has dcmotor
    text = re.sub("<position[^>]*>", actuator, MJCF)
    (tmp_path / "arm.xml").write_text(text.replace('range="-2 2"', ""))
    chosen = model(f"{tmp_path / 'arm.xml'}#elbow", None, changed)
    assert chosen.plant.wire["command"].unit == unit
    found = simulate(chosen, TIMES, {"command": 0.1})
    tau = 0.01 / (0.3 + drag)
    exact = 0.1 * torque / (0.3 + drag) * (TIMES - tau * (1.0 - np.exp(-TIMES / tau)))
    np.testing.assert_allclose(found["angle"], exact, atol=0.01 * exact[-1])


@pytest.mark.parametrize(
    ("actuator", "rate"),
    [
        ('<pid joint="elbow" kp="5" kv="0.1" input="pos"/>', "kv"),
        (
            '<dcmotor joint="elbow" motorconst="1" resistance="2" input="pos" controller="5"/>',
            "kd",
        ),
    ],
    ids=["pid", "dcmotor"],
)
def test_a_servo_of_another_kind_moves_as_the_position_servo(
    actuator: str, rate: str, tmp_path: Path
) -> None:
    pytest.importorskip("mujoco", minversion="4.0")  # which has pid and dcmotor
    (tmp_path / "arm.xml").write_text(MJCF)
    (tmp_path / "other.xml").write_text(re.sub("<position[^>]*>", actuator, MJCF))
    expected = simulate(model(f"{tmp_path / 'arm.xml'}#elbow"), TIMES, {"command": 0.5})
    other = model(f"{tmp_path / 'other.xml'}#elbow", None, {"kp": 20.0, rate: 0.2})
    found = simulate(other, TIMES, {"command": 0.5})
    np.testing.assert_allclose(found["angle"], expected["angle"], atol=1e-3)


WRONG = {
    "crash": ("import os\n    os._exit(3)", "ends the process with exit code 3"),
    "hang": ("while True: pass", "does not answer within"),
    "raise": ("raise ValueError('no such gear')", "ValueError: no such gear"),
    "shape": ("return {'angle': [1.0, 2.0]}", "of shape (2,)"),
    "no number": ("return {'angle': np.full(len(times), np.nan)}", "no number in row 0"),
    "other name": ("return {'angel': times}", "'angle'"),
    "no dict": ("return times", "no dict of arrays"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_a_function_that_fails_ends_one_run_with_a_sentence(
    tmp_path: Path, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    body, said = WRONG[fault]
    head, tail = FIRST_ORDER.split('    print("what it prints goes elsewhere")\n')
    trap = f"    if inputs['goal'][0] > 0:\n        {body.replace(chr(10), chr(10) + '    ')}\n"
    monkeypatch.setattr(function, "SECONDS", 5.0)
    chosen = model(first_order(tmp_path, head + trap + tail))
    with pytest.raises(UserError, match=r"sim\.py:simulate") as refused:
        simulate(chosen, TIMES, {"goal": 0.5})
    assert said in str(refused.value)
    assert simulate(chosen, TIMES, {"goal": 0.0})["angle"].shape == TIMES.shape


MEETING = """
import time
from pathlib import Path

INPUTS, OUTPUTS, PARAMETERS = {"goal": 1.0}, {"angle": 1.0}, {"number": 1.0}

def simulate(parameters, times, inputs):
    here, number = Path(__file__).parent, parameters["number"]
    (here / f"came_{number:g}").touch()
    end = time.monotonic() + 20.0
    while number > 1.0 and not {"came_2", "came_3"} <= {it.name for it in here.iterdir()}:
        if time.monotonic() > end:
            raise RuntimeError("nobody else comes")
        time.sleep(0.01)
    return {"angle": number * inputs["goal"]}
"""


def test_runs_of_a_function_go_on_together(tmp_path: Path) -> None:
    name = first_order(tmp_path, MEETING)
    models = [model(name, parameters={"number": number}) for number in (2.0, 3.0)]
    with Workers(2) as workers:
        angles = [it["angle"] for it in workers.map(one_step, models)]
    assert [angle[-1] for angle in angles] == [1.0, 1.5]


def one_step(chosen: Model) -> Result:
    return simulate(chosen, TIMES, {"goal": 0.5})


@pytest.mark.skipif(sys.platform == "win32", reason="no signal to a thread")
def test_a_run_that_is_interrupted_gives_nothing_to_the_next(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a job may ignore it
    request.addfinalizer(functools.partial(signal.signal, signal.SIGINT, before))
    slow = FIRST_ORDER.replace("    angle =", "    time.sleep(inputs['goal'][-1])\n    angle =")
    chosen = model(first_order(tmp_path, "import time\n" + slow))
    simulate(chosen, TIMES, {"goal": 0.0})  # compiles
    ctrl_c = (threading.main_thread().ident, signal.SIGINT)
    timer = threading.Timer(0.3, signal.pthread_kill, ctrl_c)
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        simulate(chosen, TIMES, {"goal": 1.0})
    timer.join()
    assert simulate(chosen, TIMES, {"goal": 0.1})["angle"][-1] == pytest.approx(0.1, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "name", "said"),
    [
        ("x = 1", "simulate", "no function 'simulate'"),
        ("def simulate(p, t, u): ...", "simulate", "no INPUTS"),
        (FIRST_ORDER, "simulated", "did you mean 'simulate'"),
        (FIRST_ORDER.replace('"50 ms"', '"50 quux"'), "simulate", "PARAMETERS['time_constant']"),
        (FIRST_ORDER.replace('"angle": "90 deg"', '"a b": 1'), "simulate", "unfit name"),
        ("raise SystemExit", "simulate", "does not run"),
        (FIRST_ORDER.replace("STEP = 0.002", "STEP = 0.0"), "simulate", "more than 0 s"),
        (FIRST_ORDER.replace("STEP = 0.002", "STEP = []"), "simulate", "STEP: []"),
    ],
)
def test_a_file_without_what_is_needed_is_refused(
    tmp_path: Path, text: str, name: str, said: str
) -> None:
    (tmp_path / "sim.py").write_text(text)
    with pytest.raises(UserError) as refused:
        model(f"{tmp_path / 'sim.py'}:{name}")
    assert said in str(refused.value)


def test_a_joint_that_is_not_there_or_not_driven_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("mujoco", reason="the extra 'benchmark' is not installed")
    (tmp_path / "arm.xml").write_text(MJCF)
    for joint, said in (("elbo", "did you mean 'elbow'"), ("free_one", "no actuator drives")):
        with pytest.raises(UserError, match=said):
            model(f"{tmp_path / 'arm.xml'}#{joint}")


def logged(folder: Path, play: float) -> Path:
    """A log of the first-order system, 10 % slower than told, with play and noise."""
    times = np.arange(0.0, 4.0, 0.005)
    chirp = 0.5 * np.sin(2.0 * np.pi * (0.5 * times + 0.4 * times**2))
    goal = np.where(times < 2.0, np.repeat([0.0, 0.4, -0.3, 0.6, 0.2], 160), chirp)
    angle = np.zeros(len(times))
    for k in range(len(times) - 1):
        angle[k + 1] = goal[k] + np.exp(-0.005 / (1.1 * TAU)) * (angle[k] - goal[k])
    read = angle.copy()
    for k in range(1, len(times)):
        read[k] = np.clip(read[k - 1], angle[k] - play, angle[k] + play)
    read += 1e-3 * np.random.default_rng(1).standard_normal(len(times))
    table = np.column_stack([times, goal, read])
    np.savetxt(folder / "log.csv", table, delimiter=",", header="t,goal,angle", comments="")
    (folder / "rig.toml").write_text(
        'actuator = "sim.py:simulate"\n[uncertainty]\ntime_constant = "20 %"\n[[logs]]\n'
        'file = "log.csv"\ntime = { column = "t", unit = "s" }\n'
        'inputs.goal = { column = "goal", unit = "rad" }\n'
        'outputs.angle = { column = "angle", unit = "rad" }\n'
    )
    return folder / "rig.toml"


@pytest.mark.thorough
def test_play_behind_a_function_is_diagnosed(tmp_path: Path) -> None:
    first_order(tmp_path)
    found = diagnose(logged(tmp_path, play=0.02), jobs=1)
    assert found.selection.taken.effects == ("backlash",)
    values = {one.name: one for one in found.found}
    for name, truth in (("backlash.half_width", 0.02), ("time_constant", 1.1 * TAU)):
        assert abs(values[name].value - truth) < 3.0 * values[name].standard_error + 0.02 * truth


KEPT = {
    "parameters": 'parameters = { "current_offset.value" = "1 mA" }',
    "uncertainty": 'uncertainty."current_offset.value" = "1 mA"',
    "bounds": 'bounds = { "current_offset.value" = ["-1 A", "1 A"] }',
    "effect": 'free = ["current_offset"]',
    "nothing": "",
}


@pytest.mark.parametrize("kept", KEPT)
def test_readings_that_nobody_names_are_not_simulated(tmp_path: Path, kept: str) -> None:
    text = FIRST_ORDER.replace('"angle": "90 deg"', '"angle": "90 deg", "current": "2 A"')
    name = first_order(tmp_path, text.replace(": angle}", ': angle, "current": -angle}'))
    path = logged(tmp_path, play=0.0)
    known = path.read_text().replace("[uncertainty]\n", "uncertainty.")
    path.write_text(f"{KEPT[kept]}\n{known}")
    found, whole = read_description(path).model, model(name)
    assert ("current" in found.plant.outputs) == (kept != "nothing")
    assert "current" in whole.plant.outputs
    if kept == "nothing":
        angles = [one_step(it)["angle"].tolist() for it in (found, whole)]
        assert angles[0] == angles[1]


def test_a_command_that_no_log_gives_has_no_effects(tmp_path: Path) -> None:
    """A load that is not logged may be there all the same."""
    every = '{"goal": "90 deg", "pulse_width": "1 ms", "load": "2 N.m"}'
    name = first_order(tmp_path, FIRST_ORDER.replace('{"goal": "90 deg"}', every))
    found, whole = read_description(logged(tmp_path, play=0.0)).model, model(name)
    idle = {it for it in whole.plant.placements if it.startswith("pulse_width_")}
    assert "pulse_width_command_offset" in idle
    assert found.plant.placements.keys() == whole.plant.placements.keys() - idle
    assert "load_offset" in found.plant.placements
    angles = [simulate(it, TIMES, {"goal": 0.5})["angle"].tolist() for it in (found, whole)]
    assert angles[0] == angles[1]


def test_what_is_between_a_box_and_its_effects_is_nothing_to_be_given(tmp_path: Path) -> None:
    first_order(tmp_path)
    path = logged(tmp_path, play=0.0)
    text = path.read_text()
    for name in ("gaol", "simulated_angle"):
        path.write_text(text.replace("inputs.goal = {", f"inputs.{name} = {{"))
        with pytest.raises(UserError, match=r"unknown input '\w+'; (did you mean|known:) '?goal"):
            read_description(path)
    text = draft(tmp_path / "log.csv", f"{tmp_path / 'sim.py'}:simulate").text(tmp_path)
    assert "simulated" not in text


@pytest.mark.thorough
@pytest.mark.parametrize("parameters", ['{"time_constant": "50 ms"}', "{}"])
def test_an_uncertainty_is_asked_for_where_there_is_a_parameter(
    tmp_path: Path, parameters: str
) -> None:
    text = FIRST_ORDER.replace('{"time_constant": "50 ms"}', parameters)
    first_order(tmp_path, text.replace('parameters["time_constant"]', "0.05"))
    path = logged(tmp_path, play=0.0)
    path.write_text(path.read_text().replace('[uncertainty]\ntime_constant = "20 %"\n', ""))
    told = str(diagnose(path, jobs=1, quick=True).report())
    assert ("add [uncertainty]" in told) == (parameters != "{}")


def test_a_simulation_elsewhere_runs_if_it_is_trusted_only(tmp_path: Path) -> None:
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
    first_order(tmp_path / "other")
    path = logged(tmp_path / "one", play=0.0)
    path.write_text(path.read_text().replace("sim.py", "../other/sim.py"))
    with pytest.raises(UserError, match="--trust"):
        read_description(path)
    assert "time_constant" in read_description(path, trust=True).model.values


def test_commands_take_a_simulation_where_they_take_an_actuator(tmp_path: Path, run: Run) -> None:
    first_order(tmp_path)
    path = logged(tmp_path, play=0.0)
    assert "determined" in str(check(path, jobs=1))
    code, out, _ = run("explain", f"{tmp_path / 'sim.py'}:simulate")
    assert code == 0
    assert "backlash" in out
    code, _, err = run("explore", path, "--no-show", "--out", tmp_path / "page.html")
    assert code == 2
    assert "no page can hold it" in err


class Coupled:
    """An FMU stepped by fmpy, by the names of its variables."""

    def __init__(self, file: Path, start: dict[str, float]) -> None:
        told = fmpy.read_model_description(str(file))
        self.references = {it.name: it.valueReference for it in told.modelVariables}
        self.slave = fmpy.instantiate_fmu(fmpy.extract(str(file)), told, "CoSimulation")
        self.slave.setupExperiment(startTime=0.0)
        self.slave.enterInitializationMode()
        self.set(start)
        self.slave.exitInitializationMode()

    def set(self, values: dict[str, float]) -> None:
        self.slave.setReal([self.references[name] for name in values], list(values.values()))

    def get(self, name: str) -> float:
        return float(self.slave.getReal([self.references[name]])[0])


@pytest.mark.thorough
def test_an_fmu_is_corrected_by_the_fmu_around_it(tmp_path: Path) -> None:
    """A servo as FMU, of which the rig has play: diagnosed, and both FMUs stepped by fmpy."""
    rig = {"natural_frequency": 31.0, "damping_ratio": 0.8, "transport_delay.time": 0.0}
    white = model("second_order_servo", "bus", {**rig, "natural_frequency": 30.0})
    build(white, tmp_path / "servo.fmu", "native")
    times = np.arange(0.0, 4.0, 0.005)
    goal = 0.5 * np.sin(2.0 * np.pi * (0.5 * times + 0.3 * times**2))
    goal[:200] = np.repeat([0.0, 0.4, -0.3, 0.2], 50)
    rest = {"pulse_width": 1.5e-3}
    exact = simulate(model("second_order_servo", "bus", rig), times, {"goal": goal, **rest})[
        "angle"
    ]
    read = exact.copy()
    for k in range(1, len(times)):
        read[k] = np.clip(read[k - 1], exact[k] - 0.02, exact[k] + 0.02)
    read += 1e-3 * np.random.default_rng(2).standard_normal(len(times))
    table = np.column_stack([times, goal, read])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,goal,angle", comments="")
    (tmp_path / "rig.toml").write_text(
        'actuator = "servo.fmu"\n[uncertainty]\nnatural_frequency = "10 %"\n[[logs]]\n'
        'file = "log.csv"\ntime = { column = "t", unit = "s" }\n'
        "constants = { pulse_width = 1.5e-3 }\n"
        'inputs.goal = { column = "goal", unit = "rad" }\n'
        'outputs.angle = { column = "angle", unit = "rad" }\n'
    )
    found = diagnose(tmp_path / "rig.toml", jobs=1, quick=True)
    assert found.selection.taken.effects == ("backlash",)
    build(found.fitted, tmp_path / "around.fmu", "native")
    inner = Coupled(
        tmp_path / "servo.fmu",
        {"natural_frequency": found.fitted.values["natural_frequency"], **rest, "goal": goal[0]},
    )
    around = Coupled(tmp_path / "around.fmu", {"goal": goal[0]})
    told, before = np.zeros(len(times)), 0.0
    for k in range(len(times) - 1):
        inner.set({"goal": around.get("sent_goal") if k else goal[0]})
        inner.slave.doStep(times[k], 0.005)
        angle = inner.get("angle")
        rate = (angle - before) / 0.005
        around.set({"goal": goal[k + 1], "simulated_angle": angle, "simulated_angle_rate": rate})
        around.slave.doStep(times[k], 0.005)
        told[k + 1], before = around.get("angle"), angle
    assert np.std(told - read) < 1.2e-3
    assert np.std(exact - read) > 5e-3
