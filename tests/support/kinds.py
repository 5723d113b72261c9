"""Marks of tests that are of one kind of FMU only."""

from __future__ import annotations

import pytest

from servo_models.build import FMI3, NATIVE, PYTHON

FAILED = {PYTHON: 4, NATIVE: 3, FMI3: 3}
"""Status of a failure: fmi2Fatal is the one that pythonfmu knows; native code says fmi2Error."""

python_only = pytest.mark.parametrize("kind", [PYTHON], indirect=True, scope="session")
native_only = pytest.mark.parametrize("kind", [NATIVE], indirect=True, scope="session")
fmi2_only = pytest.mark.parametrize("kind", [PYTHON, NATIVE], indirect=True, scope="session")
fmi3_only = pytest.mark.parametrize("kind", [FMI3], indirect=True, scope="session")
