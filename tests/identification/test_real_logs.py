"""Identification of real actuators from their logs, judged on samples that no fit has seen.

The descriptions are those of ``examples/real_logs``; figures to be reached are the authors'
parameters (EMPS) and what simpler fits had reached before.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.description import Description, read_description
from servo_models.data.log import Log
from servo_models.identification.fit import fit
from servo_models.identification.problem import Problem
from servo_models.identification.result import HELD_OUT, Identification
from tests.support.logs import changed

Describe = Callable[[str], Description]

pytestmark = pytest.mark.thorough
EXAMPLES = Path(__file__).parents[2] / "examples" / "real_logs"
COUNT = np.radians(7.75)
"""Rate [rad/s] that the description of the SG90 takes for a count of its gyro."""


@pytest.fixture(scope="session")
def describe(logs_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Describe:
    """Return an example's description, its logs taken from the folder of measured logs."""
    folder = tmp_path_factory.mktemp("descriptions")

    def described(name: str) -> Description:
        text = (EXAMPLES / name).read_text(encoding="utf-8")
        (folder / name).write_text(text.replace('"logs/', f'"{logs_folder.as_posix()}/'))
        return read_description(folder / name)

    return described


def estimate(told: Description) -> Identification:
    return fit(told.model, told.logs, told.free, told.uncertainty)


def values(found: Identification) -> dict[str, float]:
    return {free.name: float(value) for free, value in zip(found.free, found.values)}


def rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))


# EMPS: linear drive in its position loop

AUTHORS = {
    "mass": (95.1, 0.05),
    "coulomb_friction.level": (20.4, 0.05),
    "force_offset": (-3.16, 0.05),
    "viscous_coefficient": (203.5, 0.10),
}
"""Reference parameters of the benchmark's authors, and how near a fit has to come."""


@pytest.fixture(scope="module")
def emps(describe: Describe) -> Identification:
    return estimate(describe("emps.toml"))


def test_emps_is_met_on_the_run_with_pulses(emps: Identification) -> None:
    assert emps.converged
    assert all("the model lacks something" in text for text in emps.warnings)
    assert emps.rms("position", HELD_OUT) <= 3.9e-6
    assert emps.rms("drive", HELD_OUT) <= 0.15


@pytest.mark.parametrize("name", AUTHORS)
def test_emps_has_the_parameters_of_its_authors(emps: Identification, name: str) -> None:
    value, share = AUTHORS[name]
    assert values(emps)[name] == pytest.approx(value, rel=share)


def test_coulomb_friction_is_what_emps_needs(describe: Describe, emps: Identification) -> None:
    """Without it the held-out error doubles at least: the score can tell models apart."""
    told = describe("emps.toml")
    names = [name for name in told.free if name != "coulomb_friction.level"]
    bare = fit(told.model, told.logs, names, told.uncertainty)
    assert bare.rms("position", HELD_OUT) > 2.0 * emps.rms("position", HELD_OUT)


def test_emps_shows_no_delay(describe: Describe) -> None:
    """A delay of one sample, which the loop could have, would be 1 ms."""
    told = describe("emps.toml")
    found = fit(told.model, told.logs, [*told.free, "transport_delay.time"], told.uncertainty)
    assert values(found)["transport_delay.time"] < 0.1e-3


def test_logs_may_come_in_any_order(describe: Describe, emps: Identification) -> None:
    told = describe("emps.toml")
    found = fit(told.model, told.logs[::-1], told.free, told.uncertainty)
    np.testing.assert_array_equal(found.values, emps.values)


# SG90: steps seen by a gyro, and a square wave seen by a camera


@pytest.fixture(scope="module")
def sg90(describe: Describe) -> Identification:
    return estimate(describe("sg90_steps.toml"))


def test_sg90_is_met_at_amplitudes_held_out(sg90: Identification) -> None:
    assert sg90.converged
    assert sg90.rms("rate_reading", HELD_OUT) <= 4.50 * COUNT


def test_the_variant_measured_is_what_the_steps_give(sg90: Identification) -> None:
    variant = model("sg90", "measured").values
    for free, value, error in zip(sg90.free, sg90.values, sg90.standard_errors):
        if not free.name.startswith("gyro"):
            assert abs(value - variant[free.name]) < 2.0 * error, free.name


def test_the_variant_measured_as_it_is_meets_the_amplitudes_held_out(
    describe: Describe, sg90: Identification
) -> None:
    """The gyro is no part of the servo: its scale comes from the fit."""
    told = describe("sg90_steps.toml")
    scale = {"gyro_gain.error": values(sg90)["gyro_gain.error"]}
    (log,) = told.logs
    found = responses(model("sg90", None, scale), log)["rate_reading"]
    error = (found - log.outputs["rate_reading"])[log.checked]
    assert rms(error) <= 4.50 * COUNT


def test_drive_saturation_is_what_the_steps_need(describe: Describe, sg90: Identification) -> None:
    told = describe("sg90_steps.toml")
    linear = changed(told.model, {"supply_limit.share": 0.0})
    found = fit(linear, told.logs, told.free)
    assert found.rms("rate_reading", HELD_OUT) > 1.5 * sg90.rms("rate_reading", HELD_OUT)


def responses(chosen: Model, log: Log) -> dict[str, Array]:
    """Responses of a model, as it is, to the inputs of a log."""
    return Problem(chosen, [log], []).responses(np.empty(0))[0]


def slew_rates(times: Array, angle: Array, commands: Array) -> Array:
    """Mean rate [rad/s] from 10 % to 90 % of every swing between two levels; straight lines.

    A swing is looked for from 0.3 s before the time of its command.
    """
    found = []
    for command in commands:
        part = (times > command - 0.3) & (times < command + 0.65)
        t, y = times[part], angle[part]
        share = (y - y[0]) / (y[-1] - y[0])
        ends = []
        for level in (0.1, 0.9):
            k = int(np.argmax(share >= level))
            ends.append(np.interp(level, share[k - 1 : k + 1], t[k - 1 : k + 1]))
        found.append(0.8 * abs(y[-1] - y[0]) / (ends[1] - ends[0]))
    return np.array(found)


@pytest.fixture(scope="module")
def video(logs_folder: Path) -> tuple[Array, Array, Array, Array]:
    """Times [s], command and angle [rad] as in the file, and times of the commands."""
    file = logs_folder / "sg90_video" / "sg90_square180.csv"
    times, command, angle = np.loadtxt(file, delimiter=",", skiprows=1).T
    changes = times[np.flatnonzero(np.diff(command)) + 1]
    return times, command, angle, changes[:-1]


def of_variant(times: Array, command: Array) -> tuple[Array, Array]:
    """Response [rad] of the variant to commanded angles, on a fine grid."""
    fine = np.arange(-1.0, times[-1], 1e-3)
    row = np.maximum(np.searchsorted(times, fine + 1e-9, side="right") - 1, 0)
    pulse = 544e-6 + (2400e-6 - 544e-6) * command[row] / np.pi
    moved = simulate(model("sg90", "measured"), fine + 1.0, {"pulse_width": pulse})["angle"]
    return fine, moved + np.pi * (1500.0 - 544.0) / (2400.0 - 544.0)


def test_the_videos_command_is_late(video: tuple[Array, Array, Array, Array]) -> None:
    """The horn has moved in the row of the command, so the two clocks are not in step.

    That is why the video is compared after a shift of the clock, and judges no delay.
    """
    times, _, angle, commands = video
    for command in commands:
        row = int(np.searchsorted(times, command))
        assert abs(angle[row] - angle[row - 4]) > np.radians(5.0)


def test_the_variant_measured_turns_as_fast_as_the_sg90_of_the_video(
    video: tuple[Array, Array, Array, Array],
) -> None:
    """Another unit with another load; both have no speed in common but that of an SG90."""
    times, command, angle, commands = video
    filmed = slew_rates(times, angle, commands)
    fine, moved = of_variant(times, command)
    simulated = slew_rates(fine, moved, commands)
    assert np.std(filmed) < 0.05 * np.mean(filmed)
    assert np.mean(simulated) == pytest.approx(np.mean(filmed), rel=0.10)


def test_the_video_is_met_once_the_clocks_are_in_step(
    video: tuple[Array, Array, Array, Array],
) -> None:
    times, command, angle, _ = video
    fine, moved = of_variant(times, command)

    def error(late: float) -> float:
        return rms(np.interp(times + late, fine, moved) - angle)

    best = minimize_scalar(error, bounds=(0.0, 0.2), method="bounded")
    assert 0.02 < best.x < 0.15
    assert best.fun < np.radians(6.0)
