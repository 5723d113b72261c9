"""The papers' own gap: one paper's equations as the plant, its other figures as the simulation.

Logs are those of ``examples/papers_gap``, made by reference models that share nothing with the
ones that are diagnosed.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.data.description import read_description
from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.search.selection import candidates

EXAMPLE = Path(__file__).parents[2] / "examples" / "papers_gap"
NOISE_SERVO = np.radians(0.05)
ALIKE = (
    "drive_dead_zone",
    "dead_band",
    "coulomb_friction",
    "stribeck_friction",
    "hysteresis",
    "backlash",
    "rate_limit",
    "transport_delay",
)
"""Effects that hold a servo still, or back."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example with its logs."""
    made = tmp_path_factory.mktemp("papers") / "gap"
    shutil.copytree(EXAMPLE, made)
    subprocess.run([sys.executable, made / "make_logs.py"], check=True)
    return made


@pytest.fixture(scope="module")
def torque_motor(folder: Path) -> Diagnosis:
    return diagnose(folder / "torque_motor.toml")


@pytest.mark.thorough
def test_table_1_lacks_the_delay_of_eq_12_and_nothing_else(torque_motor: Diagnosis) -> None:
    assert torque_motor.verdict.kind == "effect"
    assert torque_motor.selection.taken.effects == ("transport_delay",)
    assert torque_motor.verdict.members == ("transport_delay",)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "printed", "within"),
    [
        ("transport_delay.time", 1.1e-3, 0.1e-3),
        ("torque_constant", 5.23, 0.02 * 5.23),
        ("inductance", 29.9, 0.02 * 29.9),
    ],
)
def test_the_diagnosis_finds_what_table_2_prints(
    torque_motor: Diagnosis, name: str, printed: float, within: float
) -> None:
    """K_t 19 % and L 12 % below Table 1; the priors of R, J and K_s leave 1 % open."""
    found = {one.name: one.value for one in torque_motor.found}
    assert found[name] == pytest.approx(printed, abs=within)


@pytest.mark.thorough
def test_parameters_alone_do_not_explain_the_torque_motor(torque_motor: Diagnosis) -> None:
    rms = torque_motor.gap.rms
    assert rms["before"] > rms["retuned"] > 10.0
    assert rms["after"] < 1.5


@pytest.mark.long
def test_eq_7_lacks_a_dead_zone_before_all(folder: Path) -> None:
    """The printed servo moves from 0.5 V and from -0.6 V on, and then with a jump (sec. 4.3).

    Against all that resembles it; ``studies/real_logs.py`` has the whole catalogue.
    """
    known = [one.name for one in candidates(model("sg90", "linear"), ())]
    assert set(ALIKE) < set(known)
    found = diagnose(folder / "sg90.toml", left_out=set(known) - set(ALIKE))
    assert found.selection.taken.effects[0] == "drive_dead_zone"
    values = {one.name: one.value for one in found.found}
    # the gain in front of the zone is free as well: the error at which the servo moves counts
    reach = values["drive_dead_zone.half_width"] / values["amplifier_gain"]
    assert 0.5 / 7.47 < reach < 0.6 / 7.47


def change(folder: Path, without: dict[str, float]) -> float:
    """RMS change of the printed servo's angle in its log, in noise levels."""
    (log,) = read_description(folder / "sg90.toml").logs

    def angle(values: dict[str, float]) -> NDArray[np.float64]:
        return simulate(model("sg90", "printed", values), log.times, log.inputs)["angle"]

    return float(np.sqrt(np.mean((angle(without) - angle({})) ** 2)) / NOISE_SERVO)


@pytest.mark.parametrize(
    ("part", "shown"),
    [
        (("edge_positive", "edge_negative", "zero_positive", "zero_negative"), True),
        (("top_positive", "top_negative"), True),
        (("command_quantisation.step",), True),
        (("sample_hold.period",), False),
    ],
)
def test_what_the_servos_log_can_show(folder: Path, part: tuple[str, ...], shown: bool) -> None:
    """Its rows fall on the servo's frames, so it cannot show these."""
    moved = change(folder, dict.fromkeys(part, 0.0))
    assert (moved > 5.0) if shown else (moved < 1.0)
