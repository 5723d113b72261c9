"""Rehearsals: effects are put in at the sizes asked for, and what is told of them."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from signal import SIGINT, raise_signal

import numpy as np
import pytest

from servo_models import read_description
from servo_models.errors import UserError
from servo_models.fmu.child import Child
from servo_models.survey.rehearsal.rehearse import (
    AMONG,
    CANNOT_SHOW,
    FOUND,
    IMITATED,
    NO_EFFECT,
    Answer,
    Case,
    Rehearsal,
    Rig,
    Sensor,
)
from tests.conftest import Run

PLAN = """
actuator = "torque_motor"
variant = "identified"
parameters.transport_delay.time = 0
[uncertainty]
torque_constant = "5 %"
[[logs]]
file = "plan.csv"
start = "rest"
time = {{ column = "t", unit = "s" }}
inputs.voltage = {{ column = "u", unit = "V" }}
outputs.angle = {{ column = "angle", unit = "deg"{} }}
"""
NOISE = 1e-4  # rad


def plan(folder: Path, amplitude: float = 10.0, scale: str = "") -> Path:
    """A command without anything measured: a square wave."""
    times = np.arange(0.0, 0.6, 0.002)
    volts = amplitude * np.sign(np.sin(2.0 * np.pi * 4.0 * times))
    rows = "".join(f"{t:.4f},{u:.4f}\n" for t, u in zip(times, volts))
    (folder / "plan.csv").write_text(f"t,u\n{rows}")
    (folder / "plan.toml").write_text(PLAN.format(scale))
    return folder / "plan.toml"


def rig(folder: Path, amplitude: float = 10.0) -> Rig:
    return Rig(plan(folder, amplitude), False, {"angle": NOISE}, 0, None)


def test_a_command_without_measurements_is_a_log_of_a_plan_only(tmp_path: Path) -> None:
    path = plan(tmp_path)
    with pytest.raises(UserError, match="no column 'angle'"):
        read_description(path)
    (log,) = read_description(path, planned=True).logs
    assert np.isnan(log.outputs["angle"]).all()
    assert log.notes == ("no column 'angle' yet: 'angle' is not measured",)


def test_an_offset_makes_the_gap_that_it_is(tmp_path: Path) -> None:
    """A constant behind everything changes each reading by itself."""
    for wanted in (3.0, 10.0):
        name, size, gap = rig(tmp_path).sized("sensor_offset", {}, wanted)
        assert name == "sensor_offset.value"
        assert gap == pytest.approx(size / NOISE)
        assert wanted <= gap < 1.05 * wanted


def test_friction_where_nothing_moves_cannot_show(tmp_path: Path) -> None:
    answer = rig(tmp_path, amplitude=0.0)(Case("coulomb_friction", 3.0))
    assert (answer.told, answer.gap) == (CANNOT_SHOW, 0.0)


def test_a_gain_is_imitated_by_an_uncertain_constant_beside_it(tmp_path: Path) -> None:
    """The torque is the product of both, but for a small back-EMF."""
    assert rig(tmp_path)(Case("gain_error", 5.0)).told == IMITATED


def test_a_limit_is_put_in_that_the_motion_without_it_exceeds(tmp_path: Path) -> None:
    """A diagnosis would refuse it: a reading exceeds it, but of a rig that does not have it."""
    path = plan(tmp_path)
    path.write_text(
        path.read_text().replace("[uncert", "parameters.end_stops.half_range = 0\n[uncert")
    )
    planned = Rig(path, False, {"angle": NOISE}, 0, None)
    free = np.ptp(planned.logs({}, np.random.default_rng(0))[0].outputs["angle"])
    _, size, gap = planned.sized("end_stops", {}, 100.0)
    assert size < 0.4 * free
    assert gap >= 100.0


ON = {"transport_delay": "time = 1.1 ms", "end_stops": "half_range = 3 deg"}


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        *((it, f"is on in the model ({it}.{ON[it]}), where it is a parameter") for it in ON),
        ("load_gain", "'load_torque' has one value in all logs"),
        ("residual_map", "it is learnt from what a diagnosis leaves"),
        ("load_inertai", "did you mean 'load_inertia'"),
    ],
)
def test_an_effect_that_cannot_be_put_in_is_refused_with_reason_and_cure(
    tmp_path: Path, run: Run, effect: str, said: str
) -> None:
    path = plan(tmp_path)
    text = path.read_text().replace("parameters.transport_delay.time = 0\n", "")
    path.write_text(text)
    code, _, err = run("rehearse", path, "--noise", "angle=0.01deg", "--effects", effect)
    assert code == 2
    assert said in err
    if effect in ON:
        cure = f"{effect}.{ON[effect].split()[0]} = 0"
        assert f"write '{cure}' under [parameters] of '{path}'" in err
        path.write_text(f"{text}[parameters]\n{cure}\n")
        assert effect in Rig(path, False, {"angle": NOISE}, 0, None).candidates


def test_noise_is_given_or_from_the_resolution(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="nothing tells the noise of 'angle'"):
        Rig(plan(tmp_path), False, {}, 0, None)
    counts = Rig(plan(tmp_path, scale=", scale = 0.1"), False, {}, 0, None)
    step = np.deg2rad(0.1)
    assert counts.sensors == {"angle": Sensor("rad", 0.0, pytest.approx(step))}
    readings = counts.logs({}, np.random.default_rng(0))[0].outputs["angle"]
    assert np.allclose(readings / step, np.round(readings / step), atol=1e-9)
    assert np.ptp(readings) > step


MADE = Rehearsal(
    "made",
    (
        Answer("", 0.0, NO_EFFECT, weights={"parameters": 1.0}),
        Answer("a", 10.0, FOUND, "a.size", "rad", 0.1, 10.1, ["a"], {"a": 1.0}),
        Answer(
            "b", 10.0, AMONG, "b.size", "s", 0.002, 10.2, ["a"], {"a": 0.7, "b": 0.29, "c": 0.01}
        ),
        Answer("c", 10.0, CANNOT_SHOW, "c.size", "1", 2.0, 0.0),
    ),
    {"angle": Sensor("rad", NOISE, 0.0)},
    unfinished=2,
)


def test_what_is_told(tmp_path: Path) -> None:
    report = MADE.report()
    assert report.sentence == ("gap of 10 noise floors: 1 of 3 effects found, 1 as one of several")
    assert "2 logs not tried" in report.remarks[0]
    assert "upper bound" in report.remarks[1]
    assert [(card.title, card.text) for card in report.cards] == [
        (FOUND, "a"),
        (AMONG, "b"),
        (CANNOT_SHOW, "c"),
    ]
    (table,) = report.tables
    assert table.texts[2][1:] == ("2 ms", "10.2", AMONG, "a 70 %, b 29 %")
    axes = MADE.plot()
    names = (
        [it.get_text() for it in ticks]
        for ticks in (axes.get_yticklabels(), axes.get_xticklabels())
    )
    assert [*names] == [[NO_EFFECT, "a", "b"], ["a", "b", "parameters"]]
    assert [it.get_text() for it in axes.texts] == ["100", "100", "70", "29"]


def test_the_command_writes_what_it_found(tmp_path: Path, run: Run) -> None:
    path, out = plan(tmp_path, 0.5), tmp_path / "out.json"
    words = ("--noise", "angle=0.5deg", "--effects", "coulomb_friction", "--jobs", "1")
    code, said, _ = run("rehearse", path, *words, "--gap", "1e9", "--json", out)
    assert code == 0
    assert "cannot show" in said
    told = json.loads(out.read_text())
    assert [it["told"] for it in told["answers"]] == [NO_EFFECT, CANNOT_SHOW]
    assert told["noise_floors"]["angle"] == pytest.approx(np.deg2rad(0.5))


def test_ctrl_c_leaves_the_answer_to_who_started_the_process() -> None:
    child = Child(partial, (raise_signal, SIGINT), 20.0, "the call")
    assert child() is None
