"""A dead zone that regains a part of its half width at once: small changes do not lead to it."""

from __future__ import annotations

import numpy as np
import pytest

from servo_models.core.simulate import model
from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import Candidate, candidates
from servo_models.diagnosis.search.fitting import Fitter
from servo_models.diagnosis.search.joint_fits import fit_with
from servo_models.diagnosis.search.screening import screen, starts_of
from servo_models.identification.problem import free_parameter
from tests.support.logs import changed, measured

NOISE = float(np.radians(0.05))
PRIORS = {"motor_time_constant": 0.1, "motor_gain": 0.15, "amplifier_gain": 0.05}
"""Standard deviations over the nominal values."""


def rig(half_width: float, kept: float) -> tuple[Fitter, Candidate]:
    """The linear servo with a dead zone, under steps of several sizes and a slow triangle."""
    nominal = model("sg90", "linear")
    times: Array = 0.02 * np.arange(3000.0)
    steps = np.repeat([0.0, 60.0, -60.0, 20.0, -20.0, 5.0], 300)
    triangle = 15.0 * (4.0 * np.abs(np.mod(times[:1200] / 12.0 + 0.25, 1.0) - 0.5) - 1.0)
    pulse = 1.5e-3 + 1e-5 * np.concatenate([steps, triangle])
    zone = {"drive_dead_zone.half_width": half_width, "drive_dead_zone.kept": kept}
    true = changed(nominal, {"motor_gain": 425.0, **zone})
    log = measured(true, times, {"pulse_width": pulse}, {"angle": NOISE}, seed=1)
    known = nominal.plant.parameters
    free = tuple(
        free_parameter(known[name], nominal.values[name], share * nominal.values[name])
        for name, share in PRIORS.items()
    )
    (one,) = [it for it in candidates(nominal, [log]) if it.name == "drive_dead_zone"]
    return Fitter(nominal, [log], free, {"angle": NOISE}).surveyed(), one


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("half_width", "kept"), [(0.55, 0.6), (0.55, 0.3), (0.3, 0.5), (0.8, 0.8), (0.4, 0.7)]
)
def test_a_fit_finds_the_part_that_is_kept(half_width: float, kept: float) -> None:
    """All that a fit is told of it is what is seen of dead zones that keep nothing."""
    fitter, one = rig(half_width, kept)
    first = fitter.fit((), ())
    ((_, own),) = starts_of(screen((first.linearised,), [one]))
    found = fit_with(fitter, first, own)
    assert found.values["drive_dead_zone.kept"] == pytest.approx(kept, abs=0.03)
    assert found.evidence.rms < 1.3
    assert first.evidence.rms > 50.0
