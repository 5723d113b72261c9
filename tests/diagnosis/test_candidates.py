"""Which effects are tried at all."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from servo_models.core.catalogue import actuators
from servo_models.core.simulate import model
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.search.candidates import candidates
from tests.support.logs import log_of

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
