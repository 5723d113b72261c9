"""Simulators: one file here = one simulator, which has a ``SIMULATOR``, a ``READER`` or both.

No other file names it.
"""

from __future__ import annotations

import functools
import importlib
import pkgutil
from types import ModuleType

from servo_models.core.plant import check_known
from servo_models.simulators.simulator import Reader, Simulator

__all__ = ["readers", "simulator", "simulators"]


def simulators() -> dict[str, Simulator]:
    """Return every simulator by the name of its file."""
    return {name: it.SIMULATOR for name, it in _modules().items() if hasattr(it, "SIMULATOR")}


def readers() -> dict[str, Reader]:
    """Return every reader of nominal values by the name of its file."""
    return {name: it.READER for name, it in _modules().items() if hasattr(it, "READER")}


def simulator(name: str) -> Simulator:
    """Return a simulator by name."""
    check_known("simulator", [name], simulators())
    return simulators()[name]


@functools.cache
def _modules() -> dict[str, ModuleType]:
    names = sorted(module.name for module in pkgutil.iter_modules(__path__))
    return {name: importlib.import_module(f"{__name__}.{name}") for name in names}
