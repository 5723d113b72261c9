"""An input column in an unknown scale: the factor is found and named, where a log can tell it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servo_models.analysis.isolability import experiment
from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.search.candidates import candidates
from tests.support.logs import log_of

STEP, NOISE = 5e-3, 1e-3
TIMES: Array = STEP * np.arange(1080.0)
LEVELS = np.repeat([0.0, 0.3, -0.3, 0.6, 0.1, 0.15, 0.12, 0.0, -0.2], 120)  # commanded angles [rad]
LOAD = 0.04 * np.repeat([0.0, 1.0, -1.0, 0.5, -0.5, 0.0], 180)
TRUE_OVER_LOGGED = 1.5


def diagnosed(folder: Path, actuator: str, columns: dict[str, Array], angle: Array) -> Diagnosis:
    """Diagnose a log of an angle under inputs in SI, as the columns say."""
    reading = angle + NOISE * np.random.default_rng(1).standard_normal(len(angle))
    rows = np.column_stack([TIMES, *columns.values(), reading])
    names = ",".join(["t", *columns, "angle"])
    np.savetxt(folder / "log.csv", rows, "%.9g", delimiter=",", header=names, comments="")
    lines = [f'actuator = "{actuator}"', "[[logs]]", 'file = "log.csv"', 'time = "t"']
    lines += [f'inputs.{name} = "{name}"' for name in columns]
    path = folder / "rig.toml"
    path.write_text("\n".join([*lines, 'outputs.angle = "angle"', ""]))
    return diagnose(path)


def test_the_scale_of_a_load_cell_is_found(tmp_path: Path) -> None:
    pulse = 1.5e-3 + 590.8e-6 * LEVELS
    inputs = {"pulse_width": pulse, "load_torque": LOAD}
    angle = simulate(model("sg90"), TIMES, inputs)["angle"]
    logged = {**inputs, "load_torque": LOAD / TRUE_OVER_LOGGED}
    found = diagnosed(tmp_path, "sg90", logged, angle)
    assert (found.verdict.kind, found.verdict.members) == ("effect", ("load_gain",))
    factor = 1.0 + found.fitted.values["load_gain.error"]
    assert factor == pytest.approx(TRUE_OVER_LOGGED, rel=0.01)
    assert found.gap.rms["after"] < 1.1


@pytest.mark.thorough
def test_the_scale_of_a_goal_is_found(tmp_path: Path) -> None:
    angle = simulate(model("smart_servo"), TIMES, {"goal": LEVELS})["angle"]
    found = diagnosed(tmp_path, "smart_servo", {"goal": LEVELS / TRUE_OVER_LOGGED}, angle)
    assert (found.verdict.kind, found.verdict.members) == ("effect", ("command_gain",))
    factor = 1.0 + found.fitted.values["command_gain.error"]
    assert factor == pytest.approx(TRUE_OVER_LOGGED, rel=0.01)


LOADS = {
    "dc_motor": "load_torque",
    "dc_motor_current": "load_torque",
    "dc_motor_speed": "load_torque",
    "linear_drive": "load_force",
    "second_order_servo": "load_torque",
    "sg90": "load_torque",
    "smart_servo": "load_torque",
    "torque_motor": "load_torque",
}


@pytest.mark.parametrize("actuator", LOADS)
def test_the_scale_of_a_load_is_sought_where_it_changes(actuator: str) -> None:
    """What is constant in all logs may be in any scale, or be no load at all."""
    chosen, load = model(actuator), LOADS[actuator]
    wire = chosen.plant.wire[load]
    output = chosen.plant.outputs[0]
    bare = log_of(TIMES, {}, {output: np.zeros(len(TIMES))})
    steady, other = (
        replace(bare, inputs={load: np.full(len(TIMES), share * wire.scale)})
        for share in (0.1, 0.2)
    )
    stated = replace(bare, constants={load: 0.1 * wire.scale})
    moved = replace(bare, inputs={load: np.linspace(0.0, wire.scale, len(TIMES))})

    def sought(*logs: Log) -> bool:
        return "load_gain" in {it.name for it in candidates(chosen, logs)}

    assert not any(map(sought, (bare, steady, stated)))
    assert not sought(steady, stated)
    assert sought(moved)
    assert sought(steady, other)
    assert sought(steady, bare)


def test_what_looks_like_a_wrong_scale_has_its_experiment() -> None:
    plant = model("sg90").plant
    for other in ("constant_load", "gravity_load"):
        assert "twice that load" in experiment("gain_error", other, plant)
