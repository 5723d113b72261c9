"""A share of the random FMI calls of ``tests/fuzz/fmi.py``, on every actuator.

``test_fuzz_native.py`` is that of the native FMUs for FMI 2.0, in C."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from servo_models.build import FMI3, PYTHON
from servo_models.catalogue import actuators, model
from tests.fuzz.fmi import run

SEQUENCES = 60


@pytest.mark.thorough
@pytest.mark.parametrize("kind", [PYTHON, FMI3], indirect=True, scope="session")
@pytest.mark.parametrize("damaged", [False, True], ids=["sequences", "damaged states"])
@pytest.mark.parametrize("actuator", actuators())
def test_calls_succeed_with_the_right_numbers_or_are_refused(
    actuator: str, damaged: bool, kind: str, fmu_folder: Callable[[str], Path]
) -> None:
    folder = fmu_folder(actuator)
    counts, wrong = run(model(actuator), folder, range(SEQUENCES), damaged, kind)
    assert not wrong
    assert counts["played"] == SEQUENCES
