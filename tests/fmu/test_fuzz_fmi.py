"""A share of the random FMI calls of ``tests/fuzz/fmi.py``, on every actuator."""

from __future__ import annotations

import pytest

from servo_models.core.catalogue import actuators
from tests.fuzz.fmi import run

SEQUENCES = 60


@pytest.mark.parametrize("damaged", [False, True], ids=["sequences", "damaged states"])
@pytest.mark.parametrize("actuator", actuators())
def test_calls_succeed_with_the_right_numbers_or_are_refused(actuator: str, damaged: bool) -> None:
    counts, wrong = run(actuator, range(SEQUENCES), damaged)
    assert not wrong
    assert counts["played"] == SEQUENCES
