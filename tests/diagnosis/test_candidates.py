"""Which effects are tried at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servo_models.catalogue import actuators, model
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.search.candidates import candidates
from tests.support.logs import log_of

LIMITS = [
    ("dc_motor", "end_stops", "half_range", "angle"),
    ("linear_drive", "end_stops", "half_range", "position"),
    ("smart_servo", "current_limit", "limit", "current"),
    ("smart_servo", "drive_saturation", "limit", "duty"),
    ("sg90", "drive_saturation", "limit", "motor_voltage"),
]
TIMES: Array = 5e-3 * np.arange(1080.0)


@pytest.mark.parametrize("actuator", actuators())
def test_the_scale_of_a_load_is_sought_where_it_changes(actuator: str) -> None:
    """What is constant in all logs may be in any scale, or be no load at all."""
    chosen = model(actuator)
    load = "load_force" if actuator == "linear_drive" else "load_torque"
    wire = chosen.plant.wire[load]
    output = chosen.plant.outputs[0]
    bare = log_of(TIMES, {}, {output: np.zeros(len(TIMES))})
    steady, other = (
        replace(bare, inputs={load: np.full(len(TIMES), share * wire.scale)})
        for share in (0.1, 0.2)
    )
    stated = replace(bare, constants={load: 0.1 * wire.scale})
    moved = replace(bare, inputs={load: np.linspace(0.0, wire.scale, len(TIMES))})

    def sought(*logs: Log) -> bool:
        return "load_gain" in {it.name for it in candidates(chosen, logs)}

    assert not any(map(sought, (bare, steady, stated)))
    assert not sought(steady, stated)
    assert sought(moved)
    assert sought(steady, other)
    assert sought(steady, bare)


@pytest.mark.parametrize(("actuator", "name", "key", "output"), LIMITS)
def test_a_limit_that_a_reading_exceeds_is_refused(
    actuator: str, name: str, key: str, output: str
) -> None:
    """Wherever the zero of the reading is, and in a log that no fit sees; a single wild reading
    refuses none, and one beyond every limit refuses the effect."""
    chosen = model(actuator, parameters={f"{name}.{key}": 0.0})
    free = chosen.plant.parameters[f"{name}.{key}"].param
    reach = min(2.0 * free.typical, 0.8 * free.high)
    wave = np.sin(np.arange(len(TIMES)) / 50.0)
    little, much = (log_of(TIMES, {}, {output: size * wave}) for size in (0.01 * reach, reach))
    unseen = replace(much, held_out=np.full(len(TIMES), True))
    shifted = replace(much, outputs={output: reach * wave + reach})
    wild = replace(
        little, outputs={output: np.where(TIMES[99] == TIMES, reach, 0.01 * reach * wave)}
    )
    beyond = replace(much, outputs={output: 3.0 * free.high * wave})

    def least(*logs: Log) -> tuple[float, float]:
        (one,) = (it for it in candidates(chosen, logs) if it.name == name)
        (limit,) = (it for it in one.free if it.name == f"{name}.{key}")
        return limit.low, min(trial[limit.name] for trial in one.trial_values)

    for logs in ((little, unseen), (little, shifted), (much,)):
        for size in least(*logs):
            assert 0.85 * reach < size < reach
    low, tried = least(little, wild)
    assert low < 0.02 * reach
    assert tried < 0.2 * reach
    assert name not in {it.name for it in candidates(chosen, (beyond,))}
