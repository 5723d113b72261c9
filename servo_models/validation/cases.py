"""The runs that are compared with references, and the modules in the folder of an actuator.

``validation/<actuator>/`` holds, each where there is any:

    reference.py   its physics a second time, independent of the model
    cases.py       ``cases()``: what goes in, and what must come out
    paper.py       ``rows()``: the figures that its paper prints
    pictures.py    ``SECTIONS`` of the report, and of which ``ACTUATORS``, if not of that name
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import ModuleType

import numpy as np

from servo_models import validation
from servo_models.core.types import Array

Reference = Callable[[Array, Mapping[str, Array]], dict[str, Array]]

LINEAR_MAIN = 1e-6  # largest error of the main output of a linear set over full scale
LINEAR = 1e-5  # largest error of the other outputs of a linear set over full scale
NONLINEAR = 1e-4  # largest error of an output of a nonlinear set over full scale

EXACT = "matrix exponential"
TRANSFER = "python-control transfer function, matrix exponential"
EVENTS = "solve_ivp DOP853 at 1e-11 with located events"


@dataclass(frozen=True)
class Case:
    """One run and its reference.

    Attributes:
        actuator, variant, parameters: the model; parameters override the variant, SI.
        name: for people.
        times: communication points [s], shape (n,).
        inputs: SI columns or numbers by name; those not named stay at rest.
        reference: see ``servo_models.validation.solvers``.
        method: method that solves the reference.
        linear: which bars apply.
        is_step: the main output answers one step at the first time, so its measures are judged.
        cost: outputs whose error is shown over the internal step; one case of an actuator.
        main: main output of the actuator.
    """

    actuator: str
    variant: str
    name: str
    times: Array = field(repr=False)
    inputs: Mapping[str, Array | float] = field(repr=False)
    reference: Reference = field(repr=False)
    method: str
    linear: bool
    is_step: bool = False
    parameters: Mapping[str, float] = field(default_factory=dict)
    cost: tuple[str, ...] = ()
    main: str = "angle"

    def bar(self, output: str) -> float:
        """Return the largest error over full scale that passes."""
        if not self.linear:
            return NONLINEAR
        return LINEAR_MAIN if output == self.main else LINEAR


def offered(part: str) -> dict[str, ModuleType]:
    """Return the module ``part`` of every folder that has one, by folder."""
    modules = {}
    for folder in (one.name for one in pkgutil.iter_modules(validation.__path__) if one.ispkg):
        package = importlib.import_module(f"{validation.__name__}.{folder}")
        if part in {one.name for one in pkgutil.iter_modules(package.__path__)}:
            modules[folder] = importlib.import_module(f"{package.__name__}.{part}")
    return modules


def all_cases() -> list[Case]:
    """Return every case, by actuator."""
    return [case for module in offered("cases").values() for case in module.cases()]


def grid(stop: float, step: float) -> Array:
    """Return communication points from 0 to ``stop`` [s], a multiple of ``step`` [s]."""
    return step * np.arange(round(stop / step) + 1, dtype=float)


def schedule(times: Array, *values: tuple[float, float]) -> Array:
    """Return a held column from (time [s], value that begins there) in order of time."""
    begins = np.array([begin for begin, _ in values])
    index = np.searchsorted(begins, times + 1e-9, side="right") - 1
    return np.array([value for _, value in values])[index]
