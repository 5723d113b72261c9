"""What figures depend on beside their inputs: versions and machine."""

from __future__ import annotations

import platform
from importlib.metadata import version

PACKAGES = ("servo-models", "pythonfmu", "fmpy", "numba", "numpy", "scipy", "control")


def conditions() -> dict[str, str]:
    """Return the versions that figures depend on, by name."""
    machine = {
        "Python": platform.python_version(),
        "system": platform.system(),
        "machine": platform.machine(),
    }
    return machine | {name: version(name) for name in PACKAGES}
