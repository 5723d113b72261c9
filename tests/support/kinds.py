"""Marks of tests that are of one kind of FMU only."""

from __future__ import annotations

import pytest

from servo_models.build import NATIVE, PYTHON

FAILED = {PYTHON: 4, NATIVE: 3}
"""Status of a failure: fmi2Fatal is the one that pythonfmu knows; native code says fmi2Error."""

python_only = pytest.mark.parametrize("kind", [PYTHON], indirect=True, scope="session")
native_only = pytest.mark.parametrize("kind", [NATIVE], indirect=True, scope="session")
