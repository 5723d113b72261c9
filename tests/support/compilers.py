"""Whether simulations of this process run in C here."""

from __future__ import annotations

import sys

import pytest

from servo_models.core.compilers import here, host

HOST = host()
in_c_only = pytest.mark.skipif(
    sys.platform == "win32" or HOST is None or here() not in HOST.targets,
    reason="no C compiler for this platform, or Windows",
)
