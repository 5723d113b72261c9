"""What users have written with 0.2.0 goes on working: a description with all its keys, a parameter
file, and the names that their hosts know an FMU by."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from servo_models.catalogue import all_actuators, model
from servo_models.data.description import read_description
from servo_models.data.parameters import read_parameters

STORED = Path(__file__).parents[1] / "stored"


def test_a_description_is_read_as_it_was() -> None:
    told = read_description(STORED / "description.toml")
    whole, levels, rest, fitted = told.logs
    assert told.free == ("motor_time_constant", "transport_delay.time")
    assert told.bounds == {"transport_delay.time": (0.0, 0.06)}
    assert told.uncertainty["transport_delay.time"] == 0.005
    assert told.uncertainty["motor_time_constant"] == pytest.approx(0.25 * 0.0399585, rel=1e-5)
    assert (whole.settle, dict(whole.constants)) == (0.5, {"load_torque": 0.005})
    assert whole.held_out.sum() == 31  # rows every 10 ms from 1.2 to 1.5 s
    assert whole.inputs["pulse_width"][0] == pytest.approx(1e-6 * (0.1 * 10_000 + 500))
    assert [len(log.times) for log in told.logs] == [180, 200, 91, 90]
    assert levels.held_out.sum() == 80
    assert (rest.settle, rest.start) == (0.0, None)
    assert fitted.start is not None
    assert fitted.start.fitted


def test_a_parameter_file_is_read_as_it_was() -> None:
    found = read_parameters(STORED / "parameters.toml")
    values = {it.name: (it.value, it.standard_error) for it in found.estimates}
    assert (found.actuator, found.variant) == ("sg90", "measured")
    assert values["motor_time_constant"] == (0.03995851592076912, 0.00013872403398892562)
    per_radian, _ = values["potentiometer_gain"]
    assert per_radian == pytest.approx(0.026541502739620585 * 180.0 / math.pi, rel=1e-12)
    assert found.model().values["motor_gain"] == 46.11227962531959


def test_hosts_find_every_fmu_and_its_variables() -> None:
    """Names with their causality; what is new stands beside them."""
    stored = json.loads((STORED / "fmu_variables.json").read_text("utf-8"))
    assert {f"{name}.fmu" for name in all_actuators()} >= stored.keys()
    for file, variables in stored.items():
        plant = model(Path(file).stem).plant
        now = {f"input {wire.name}" for wire in plant.inputs}
        now |= {f"output {name}" for name in plant.outputs}
        now |= {f"parameter {name}" for name in plant.parameters}
        assert now >= set(variables), file
