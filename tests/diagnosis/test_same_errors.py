"""``identify`` and ``diagnose`` tell the same values and standard errors of the same fit.

Both are compared with the inverse of J'J of the parameters, priors included, from small differences
of the simulation and the noise that is put on the log.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.description import Description, read_description
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.search.fitting import others_first
from servo_models.identification.identify import identify
from tests.support.logs import changed

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
RIG = {"rotor_inertia": 1.2e-5, "torque_constant": 0.032, "resistance": 2.2}
NOISE = {"encoder_speed": 0.5, "encoder_angle": 1e-3, "current": 0.02}
LAGGING = ("torque_constant", "rotor_inertia", "winding_lag.time_constant")
TIMES = 2e-3 * np.arange(1000)


def volts() -> Array:
    levels = np.random.default_rng(1).uniform(-12.0, 12.0, 20)
    levels[0] = 0.0
    return np.repeat(levels, 50)


def description(folder: Path, rig: Model, outputs: dict[str, float]) -> Description:
    """A log of a DC motor with white noise [SI] on its readings, and its description."""
    random, answers = np.random.default_rng(0), simulate(rig, TIMES, {"voltage": volts()})
    columns = {"time": TIMES, "voltage": volts()}
    for name, noise in outputs.items():
        columns[name] = answers[name] + noise * random.standard_normal(len(TIMES))
    with (folder / "log.csv").open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows([columns, *zip(*(it.tolist() for it in columns.values()))])
    units = {name: rig.plant.wire[name].unit for name in outputs}
    readings = [f'outputs.{n} = {{ column = "{n}", unit = "{u}" }}' for n, u in units.items()]
    head = ['actuator = "dc_motor"', "[[logs]]", 'file = "log.csv"', 'time = { column = "time" }']
    command = 'inputs.voltage = { column = "voltage", unit = "V" }'
    (folder / "rig.toml").write_text("\n".join([*head, command, *readings]), encoding="utf-8")
    return read_description(folder / "rig.toml")


def smallest_errors(rig: Model, outputs: dict[str, float], priors: dict[str, float]) -> Array:
    """Standard errors [SI] of a linear fit in white noise; a prior of 0 is none."""

    def response(values: dict[str, float]) -> Array:
        answers = simulate(changed(rig, values), TIMES, {"voltage": volts()})
        return np.concatenate([answers[name] / noise for name, noise in outputs.items()])

    sizes = np.array([rig.values[name] for name in priors])
    slopes = [
        (response({name: (1 + 1e-5) * size}) - response({name: (1 - 1e-5) * size})) / 2e-5
        for name, size in zip(priors, sizes)
    ]
    rows = [
        np.diag([size / prior if prior else 0.0 for size, prior in zip(sizes, priors.values())])
    ]
    left = np.linalg.qr(np.vstack([np.transpose(slopes), *rows]))[1]
    return np.asarray(sizes * np.linalg.norm(np.linalg.inv(left), axis=1))


@pytest.mark.parametrize(
    ("outputs", "effect", "apart"),
    [
        pytest.param(("encoder_speed",), {}, 0.1, marks=pytest.mark.long),
        pytest.param(("encoder_speed", "current"), {}, 0.1, marks=pytest.mark.thorough),
        # along a curved valley searches end early
        pytest.param(("encoder_angle",), {}, 0.4, marks=pytest.mark.thorough),
        pytest.param(("encoder_angle", "current"), {}, 0.1, marks=pytest.mark.long),
        pytest.param(
            ("encoder_speed", "current"),
            {"coulomb_friction.level": 3e-3},
            0.1,
            marks=pytest.mark.thorough,
        ),
    ],
)
def test_both_commands_tell_the_same_of_one_log(
    tmp_path: Path, outputs: tuple[str, ...], effect: dict[str, float], apart: float
) -> None:
    """The speed alone shows inertia and resistance together only, and what viscous friction takes
    the torque constant may have; the angle grows to hundreds of radians without noise to match."""
    noise = {name: NOISE[name] for name in outputs}
    rig = model("dc_motor", "direct", {**RIG, **effect})
    told = description(tmp_path, rig, noise)
    priors = {**told.uncertainty, **dict.fromkeys(effect, 0.0)}
    fitted = identify(told, free=tuple(priors)).result
    taken = {value.name: value for value in diagnose(told).found}
    assert set(taken) == set(priors)
    errors = smallest_errors(rig, noise, priors)
    for free, value, own, least in zip(fitted.free, fitted.values, fitted.standard_errors, errors):
        other = taken[free.name]
        assert own == pytest.approx(least, rel=0.2), free.name
        assert other.standard_error == pytest.approx(own, rel=0.08), free.name
        assert abs(other.value - value) < apart * own, free.name
        assert abs(value - rig.values[free.name]) < 4.0 * own, free.name


def test_small_moves_that_meet_no_jump_do_not_hide_what_wide_ones_show() -> None:
    """A dead zone and the share of its jump: only where the jump comes tells them apart, and small
    moves shift it by no sample.  The standard error is held against the profile of the cost."""
    taken = diagnose(EXAMPLES / "own_plants" / "servo.toml").selection.taken
    problem, vector = taken.problem, taken.evidence.vector
    place = list(taken.values).index("drive_dead_zone.half_width")
    error = taken.spread.standard_errors[place] / problem.scales[place]
    wider = vector + error * np.eye(len(vector))[place]
    others = others_first(problem, wider, [place], None, 1e-8, 60)
    before, after = (2.0 * cost for cost in problem.costs([vector, others]))
    assert 0.25 < (after - before) / taken.evidence.dispersion < 4.0


@pytest.mark.parametrize("weight", ["encoder_speed", "current"])
def test_a_weight_is_the_error_that_the_fit_leaves(tmp_path: Path, weight: str) -> None:
    """With a first weight as large as the readings' scatter, priors would outweigh the log."""
    noise = {name: NOISE[name] for name in ("encoder_speed", "current")}
    found = identify(description(tmp_path, model("dc_motor", "direct", RIG), noise)).result
    assert found.sigma[weight] == pytest.approx(NOISE[weight], rel=0.1)


@pytest.mark.parametrize("step", [1e-3, 4e-3])
def test_a_standard_error_covers_what_the_internal_step_does(tmp_path: Path, step: float) -> None:
    """A log without noise of a motor that is simulated far more finely than the model."""
    fine = model("dc_motor", "direct", {**RIG, "internal_step": 2e-5})
    told = description(tmp_path, fine, {"encoder_speed": 0.0, "current": 0.0})
    coarse = changed(told.model, {**RIG, "internal_step": step})
    found = identify(replace(told, model=coarse), free=LAGGING).result
    wrong = np.abs(found.values - [fine.values[name] for name in LAGGING])
    assert np.all(wrong < 4.0 * found.standard_errors)
