"""Own plants are diagnosed as those of the catalogue are: the effect that a log has is named."""

from __future__ import annotations

import numpy as np
import pytest

from servo_models.core.simulate import model, simulate
from servo_models.data.arrays import describe
from servo_models.data.description import read_description
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.verdict import EFFECT
from tests.support.document import ROOT

PLANTS = ROOT / "examples" / "own_plants"
NOISE = 1e-3  # of the range of the output

CASES = [
    ("servo", {"coulomb_friction.level": 0.08, "gain": 6.4}),
    ("servo", {"transport_delay.time": 0.02, "inertia": 2.3e-3}),
    ("damper", {"direction_asymmetry.ratio": 0.15, "inertia": 0.055}),
    ("damper", {"motor_saturation.limit": 1.1, "damping": 0.43}),
    ("valve", {"transport_delay.time": 0.08, "spring_rate": 0.97e5}),
    ("valve", {"stiffness_hardening.coefficient": 4000.0, "drag": 450.0}),
    ("valve", {"dead_band.half_width": 6e3, "fill_time": 0.045}),
]


@pytest.mark.thorough
@pytest.mark.parametrize(("plant", "truth"), CASES, ids=str)
def test_the_effect_is_named(plant: str, truth: dict[str, float]) -> None:
    """The inputs of the example's log, on a rig with one effect and one parameter that is off."""
    path = PLANTS / f"{plant}.py"
    (log,) = read_description(PLANTS / f"{plant}.toml").logs
    rig = model(str(path), None, truth)
    (output,) = log.outputs
    exact = simulate(rig, log.times, log.inputs)[output]
    noise = NOISE * np.ptp(exact) * np.random.default_rng(7).standard_normal(len(exact))
    columns = {"time": log.times, **log.inputs, output: exact + noise}
    found = diagnose(describe(model(str(path)), {"rig": columns}, {name: name for name in columns}))
    (effect,) = (name.partition(".")[0] for name in truth if "." in name)
    assert found.verdict.kind == EFFECT
    assert found.selection.taken.effects == (effect,)
