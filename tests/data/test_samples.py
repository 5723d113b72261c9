"""Parameter sets that are drawn: spread, correlations and bounds of what they are drawn from."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models import (
    ParameterSet,
    UserError,
    read_parameters,
    sample,
    simulate,
    write_parameters,
)
from servo_models.data.parameters import Estimate
from tests.conftest import Run

NAMES = ("motor_gain", "motor_time_constant")
VALUES, ERRORS, CORRELATION = np.array([45.0, 0.04]), np.array([2.0, 0.003]), -0.8
COUNT = 20000
CHANCE = 5.0 / np.sqrt(COUNT)  # five standard deviations of a mean of unit draws


def known(errors: np.ndarray = ERRORS, correlation: float = CORRELATION) -> ParameterSet:
    estimates = tuple(Estimate(*it, "estimated") for it in zip(NAMES, VALUES, errors.tolist()))
    held = Estimate("potentiometer_gain", 1.5, float("inf"), "estimated")
    return ParameterSet("sg90", "measured", (*estimates, held), ((*NAMES, correlation),))


def test_draws_have_the_mean_the_spread_and_the_correlation_of_the_estimates() -> None:
    found = sample(known(), COUNT, seed=1)
    assert found.names == NAMES
    assert found.held == ("potentiometer_gain",)
    unit = (found.values - VALUES) / ERRORS
    np.testing.assert_allclose(unit.mean(axis=0), 0.0, atol=CHANCE)
    np.testing.assert_allclose(unit.std(axis=0), 1.0, atol=CHANCE)
    assert np.corrcoef(unit.T)[0, 1] == pytest.approx(CORRELATION, abs=CHANCE)
    assert found.starts()[0]["potentiometer_gain"] == 1.5


@given(st.floats(0.001, 0.2), st.floats(-1.0, 1.0), st.integers(0, 100))
def test_every_draw_lies_within_the_bounds_of_the_actuator(
    error: float, correlation: float, seed: int
) -> None:
    chosen = known(np.array([2.0, error]), correlation)
    param = chosen.model().plant.parameters["motor_time_constant"].param
    drawn = sample(chosen, 50, seed).values[:, 1]
    assert np.all((drawn >= param.low) & (drawn <= param.high))


def test_a_parameter_file_keeps_correlations(tmp_path: Path) -> None:
    write_parameters(known(), tmp_path / "sg90.toml")
    assert read_parameters(tmp_path / "sg90.toml").correlations == ((*NAMES, CORRELATION),)


def test_files_hold_the_same_sets(tmp_path: Path) -> None:
    found = sample(known(), 3, seed=2)
    for suffix in (".csv", ".json", ".ssv"):
        found.write(tmp_path / f"sets{suffix}")
    rows = list(csv.DictReader((tmp_path / "sets.csv").open()))
    starts = json.loads((tmp_path / "sets.json").read_text())
    for k, start in enumerate(starts):
        root = ElementTree.parse(tmp_path / f"sets_{k + 1}.ssv").getroot()
        ssv = {it.get("name"): float(it[0].get("value", "")) for it in root[0]}
        assert {name: float(cell) for name, cell in rows[k].items()} == start == ssv
        assert [start[name] for name in NAMES] == found.values[k].tolist()


def test_the_command_prints_ranges(tmp_path: Path, run: Run) -> None:
    """2.5 and 97.5 % of a normal distribution are 1.96 standard errors away: 41.1 and 48.9."""
    write_parameters(known(), tmp_path / "sg90.toml")
    code, out, _ = run("sample", tmp_path / "sg90.toml", "--count", COUNT)
    assert code == 0
    (row,) = (line.split() for line in out.splitlines() if line.startswith("motor_gain"))
    numbers = [float(it) for it in row if it.replace(".", "").isdigit()]
    np.testing.assert_allclose(numbers, [45.0, 41.08, 45.0, 48.92], atol=5.0 * CHANCE)
    assert "Held, since the logs say nothing of them: potentiometer_gain" in out


@pytest.mark.parametrize(
    ("chosen", "said"),
    [
        (ParameterSet("sg90", "measured", (Estimate("motor_gain", 45.0),)), "no standard errors"),
        (known(np.array([2.0, 1e9])), "wider than"),
    ],
)
def test_what_cannot_be_drawn_from_is_refused(chosen: ParameterSet, said: str) -> None:
    with pytest.raises(UserError, match=said):
        sample(chosen, 10)


def test_a_set_that_is_drawn_runs() -> None:
    chosen = known()
    (start,) = sample(chosen, 1).starts()
    model = chosen.model({name: start[name] for name in NAMES})
    assert np.isfinite(simulate(model, [0.0, 0.1], {"pulse_width": 1.6e-3})["angle"]).all()
