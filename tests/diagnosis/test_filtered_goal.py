"""A host that filters the goal before it is sent is told as that, and as no soft gear."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from servo_models.core.simulate import model, simulate
from servo_models.core.types import Array
from servo_models.data.description import Description
from servo_models.data.schema import Section
from servo_models.diagnosis.diagnose import diagnose
from servo_models.identification.simulation import prepared
from tests.support.logs import changed, log_of

NOISE = 2e-3  # rad
FINE = 1e-3  # s
ROWS = slice(None, None, 10)
BELIEVED = {
    "second_order_servo": {
        "natural_frequency": 15.0,
        "damping_ratio": 0.24,
        "transport_delay.time": 2.5e-3,
        "speed_limit": 2.3,
    },
    "smart_servo": {"resistance": 0.5, "torque_constant": 0.13},
}
"""Standard deviations [SI]."""
VARIANT = {"second_order_servo": "bus", "smart_servo": "sts3215"}


def goals(times: Array) -> Array:
    """Steps, then a sweep [rad]."""
    levels = np.random.default_rng(1).uniform(-0.8, 0.8, 12)
    levels[0] = 0.0
    held = levels[np.minimum(times.astype(int), 11)]
    return np.where(times < 6.0, held, 0.4 * np.sin(2.0 * math.pi * (0.3 + 0.12 * times) * times))


def told(name: str, time_constant: float, true: dict[str, float]) -> Description:
    """The nominal servo, with a log of one whose goals pass an exact filter of scipy."""
    nominal, path = model(name, VARIANT[name]), Path("rig.toml")
    fine: Array = FINE * np.arange(12_000)
    rows = np.floor(fine / 0.01 + 1e-9) * 0.01
    kept = math.exp(-FINE / time_constant)
    filtered = lfilter([1.0 - kept], [1.0, -kept], goals(rows))
    moved = simulate(changed(nominal, true), fine, {"goal": filtered})["angle_reading"][ROWS]
    reading = moved + NOISE * np.random.default_rng(0).standard_normal(len(moved))
    log = log_of(fine[ROWS], {"goal": goals(fine[ROWS])}, {"angle_reading": reading})
    return Description(path, Section(path, "", {}), nominal, {}, BELIEVED[name], (log,))


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "time_constant", "beside"),
    [
        ("second_order_servo", 0.015, {}),
        ("second_order_servo", 0.045, {}),
        ("second_order_servo", 0.1, {}),
        ("second_order_servo", 0.045, {"backlash.half_width": 0.02}),
        ("smart_servo", 0.045, {}),
    ],
)
def test_a_filtered_goal_is_named(
    name: str, time_constant: float, beside: dict[str, float]
) -> None:
    found = diagnose(told(name, time_constant, beside), jobs=1)
    effects = {"command_lag", *(it.partition(".")[0] for it in beside)}
    assert set(found.selection.taken.effects) == effects
    value = next(it.value for it in found.found if it.name == "command_lag.time_constant")
    # half a millisecond of it is the step of the filter
    assert value == pytest.approx(time_constant, rel=0.05)


@pytest.mark.parametrize("name", ["sg90", "smart_servo", "second_order_servo"])
def test_a_filter_beside_a_delay_takes_no_further_steps(name: str) -> None:
    """A delay cuts steps where its signal changes: one that never rests would cut every step."""
    chosen = model(name)
    inputs = {"sg90": "pulse_width"}.get(name, "goal")
    rest = next(float(it.rest) for it in chosen.plant.inputs if it.name == inputs)
    times = 0.01 * np.arange(100)
    command = rest + (times > 0.1) * (5e-4 if name == "sg90" else 0.5)
    run = prepared(chosen, log_of(times, {inputs: command}, {}))
    steps = [
        chosen.substeps(
            run._vector({"transport_delay.time": 0.00498, "command_lag.time_constant": lag}),
            run.times,
            run.inputs,
        )
        for lag in (0.0, 0.045)
    ]
    assert steps[1] <= 1.1 * steps[0]
