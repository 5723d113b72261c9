"""A simulated response as a result: shown, drawn, tabled, as JSON."""

from __future__ import annotations

import json

import numpy as np
import pytest

from servo_models.analysis.pictures import shown_signals
from servo_models.analysis.simulate import Result, simulate
from servo_models.catalogue import model
from servo_models.report.style import drawing

TIMES = np.linspace(0.0, 0.5, 51)


@pytest.fixture(scope="module")
def response() -> Result:
    return simulate(model("sg90"), TIMES, {"pulse_width": 2e-3})


def test_a_notebook_shows_the_picture_and_the_figures(response: Result) -> None:
    shown = response._repr_html_()
    assert shown.count("<svg") == 1
    for text in ("sg90, variant measured", "angle [deg]", "pulse width [us]", "overshoot"):
        assert text in shown
    assert repr(response) == "<Result of sg90, variant measured: 51 points, 0 to 0.5 s>"


def test_it_is_drawn_in_the_units_that_a_person_reads(response: Result) -> None:
    with drawing() as (_, (axes,)):
        assert response.plot(axes) is axes
    (line,) = axes.lines
    np.testing.assert_allclose(line.get_ydata(), np.degrees(response["angle"]))
    np.testing.assert_allclose(line.get_xdata(), 1e3 * TIMES)  # ms of a run below a second
    names = [wire.name for wire in shown_signals(response)]
    assert len(response.plot().figure.axes) == len(names)
    assert names[:2] == ["pulse_width", "angle"]
    assert "load_torque" not in names  # it rests


def test_its_json_is_the_run_in_si(response: Result) -> None:
    document = json.loads(response.to_json())
    assert document["outputs"]["angle"] == response["angle"].tolist()
    assert document["inputs"]["pulse_width"] == [2e-3] * len(TIMES)


def test_only_a_step_has_measures_of_one(response: Result) -> None:
    assert "Step response of angle" in response.tables()
    ramp = simulate(model("sg90"), TIMES, {"pulse_width": 1.5e-3 + 1e-3 * TIMES})
    assert ramp.tables().keys() == {"Signals"}
