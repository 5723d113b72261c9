"""Identified actuator models: simulate and fit them, diagnose their gap, build FMUs of them.

What there is: ``overview``, ``explain``.  A model: ``model``, ``simulate``, ``figures``,
``linearise``, ``build``, ``validate``.  Logs: ``describe`` or ``read_description``, then ``check``,
``identify``, ``diagnose``.  From and to simulators: ``import_nominal``, ``export``.  An actuator of
your own: ``Actuator``, ``Plant``, ``Wire``, ``block``, ``effect``, ``place``, ``effects_on``; see
docs/own_actuator.md.

Example:
    >>> import servo_models as sm
    >>> servo = sm.model("sg90", "measured", {"backlash.half_width": "0.5 deg"})
    >>> response = sm.simulate(servo, [0.0, 0.5, 1.0], {"pulse_width": 2.0e-3})
    >>> response["angle"].shape  # rad; SI everywhere inside
    (3,)

A name is imported when it is first used, so that the package alone costs nothing.
"""

from __future__ import annotations

import functools
import importlib
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from servo_models.actuators.torque_causal import torque_causal
    from servo_models.analysis.explain import explain, overview
    from servo_models.analysis.figures import figures
    from servo_models.analysis.linearise import linearise
    from servo_models.analysis.simulate import Result, simulate
    from servo_models.build import build
    from servo_models.catalogue import actuator, model
    from servo_models.core.block import (
        Ambiguity,
        Bench,
        Clock,
        DeadTime,
        Fault,
        FirstOrderLag,
        Grid,
        Harmonic,
        Hints,
        Memory,
        Mode,
        Notice,
        Param,
        Queue,
        block,
        effect,
    )
    from servo_models.core.plant import Actuator, Plant, State, Variant, Wire, place
    from servo_models.core.simulate import Model
    from servo_models.data.arrays import describe
    from servo_models.data.description import Description, read_description
    from servo_models.data.parameters import ParameterSet, read_parameters, write_parameters
    from servo_models.data.samples import sample
    from servo_models.data.tables import read_inputs, read_signals, write_signals
    from servo_models.diagnosis.diagnose import diagnose
    from servo_models.diagnosis.settings import Settings
    from servo_models.effects import effects_on
    from servo_models.errors import UserError
    from servo_models.identification.check import check
    from servo_models.identification.identify import identify
    from servo_models.simulators.export import export
    from servo_models.simulators.nominal import import_nominal
    from servo_models.survey.rehearsal.rehearse import rehearse
    from servo_models.survey.survey import survey
    from servo_models.validation.any_fmu.experiment import Against
    from servo_models.validation.rows import Validation
    from servo_models.validation.runner import validate

    __version__: str

__all__ = [
    "Actuator",
    "Against",
    "Ambiguity",
    "Bench",
    "Clock",
    "DeadTime",
    "Description",
    "Fault",
    "FirstOrderLag",
    "Grid",
    "Harmonic",
    "Hints",
    "Memory",
    "Mode",
    "Model",
    "Notice",
    "Param",
    "ParameterSet",
    "Plant",
    "Queue",
    "Result",
    "Settings",
    "State",
    "UserError",
    "Validation",
    "Variant",
    "Wire",
    "actuator",
    "block",
    "build",
    "check",
    "describe",
    "diagnose",
    "effect",
    "effects_on",
    "explain",
    "export",
    "figures",
    "identify",
    "import_nominal",
    "linearise",
    "model",
    "overview",
    "place",
    "read_description",
    "read_inputs",
    "read_parameters",
    "read_signals",
    "rehearse",
    "sample",
    "simulate",
    "survey",
    "torque_causal",
    "validate",
    "write_parameters",
    "write_signals",
]


@functools.cache
def _homes() -> dict[str, str]:
    """Module of each public name, as the imports above say it."""
    import ast
    from pathlib import Path

    found = ast.walk(ast.parse(Path(__file__).read_bytes()))
    imports = (node for node in found if isinstance(node, ast.ImportFrom) and node.module)
    return {name.name: str(node.module) for node in imports for name in node.names}


class _Package(ModuleType):
    """This package: it imports names late, and its module ``build`` does not hide ``build``."""

    def __getattr__(self, name: str) -> Any:
        if name == "__version__":
            from importlib.metadata import version

            found: Any = version("servo-models")
        elif name in __all__:
            found = getattr(importlib.import_module(_homes()[name]), name)
        else:
            raise AttributeError(f"module '{self.__name__}' has no attribute '{name}'")
        super().__setattr__(name, found)
        return found

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in __all__ and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __dir__(self) -> list[str]:
        return sorted({*super().__dir__(), *__all__, "__version__"})


sys.modules[__name__].__class__ = _Package
