"""What looks like another effect is told apart by an experiment that is said."""

from __future__ import annotations

import pytest

from servo_models.analysis.isolability import experiment
from servo_models.catalogue import model


@pytest.mark.parametrize(
    ("actuator", "effect", "others", "said"),
    [
        ("sg90", "gain_error", ("constant_load", "gravity_load"), "twice that load"),
        (
            "torque_motor",
            "stiction",
            ("backlash", "dead_band", "hysteresis", "coulomb_friction", "stribeck_friction"),
            "slow triangle",
        ),
    ],
)
def test_an_experiment_is_told(
    actuator: str, effect: str, others: tuple[str, ...], said: str
) -> None:
    plant = model(actuator).plant
    assert all(said in experiment(effect, other, plant) for other in others)
