"""Identified actuator models: simulate and fit them, diagnose their gap, build FMUs of them.

The names below are imported when first used, so that importing the package costs nothing.
A function that shares its module's name, such as ``simulate``, is the function here; reach
into its module with ``from servo_models.simulate import flat_of``.

Example:
    >>> import servo_models as sm
    >>> servo = sm.model("sg90", "measured", {"backlash.half_width": "0.5 deg"})
    >>> response = sm.simulate(servo, [0.0, 0.5, 1.0], {"pulse_width": 2.0e-3})
    >>> response["angle"].shape  # rad; SI everywhere inside
    (3,)
"""

from __future__ import annotations

import importlib
import importlib.metadata
import sys
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    __version__: str
    from servo_models.build import build
    from servo_models.catalogue import actuator
    from servo_models.check import check
    from servo_models.description import read_description
    from servo_models.diagnose import diagnose
    from servo_models.errors import UserError
    from servo_models.explain import explain, overview
    from servo_models.figures import figures
    from servo_models.identify import identify
    from servo_models.linearise import linearise
    from servo_models.parameter_set import ParameterSet, read_parameters, write_parameters
    from servo_models.simulate import Model, Result, model, simulate
    from servo_models.tables import read_inputs, read_signals, write_signals
    from servo_models.validate import Validation, validate

_HOME = {
    "Model": "simulate",
    "ParameterSet": "parameter_set",
    "Result": "simulate",
    "UserError": "errors",
    "Validation": "validate",
    "actuator": "catalogue",
    "build": "build",
    "check": "check",
    "diagnose": "diagnose",
    "explain": "explain",
    "figures": "figures",
    "identify": "identify",
    "linearise": "linearise",
    "model": "simulate",
    "overview": "explain",
    "read_description": "description",
    "read_inputs": "tables",
    "read_parameters": "parameter_set",
    "read_signals": "tables",
    "simulate": "simulate",
    "validate": "validate",
    "write_parameters": "parameter_set",
    "write_signals": "tables",
}
"""Public name to the module that defines it."""

__all__ = [
    "Model",
    "ParameterSet",
    "Result",
    "UserError",
    "Validation",
    "actuator",
    "build",
    "check",
    "diagnose",
    "explain",
    "figures",
    "identify",
    "linearise",
    "model",
    "overview",
    "read_description",
    "read_inputs",
    "read_parameters",
    "read_signals",
    "simulate",
    "validate",
    "write_parameters",
    "write_signals",
]


class _Package(ModuleType):
    """This package; the import of a submodule does not hide the public name it shares."""

    def __dir__(self) -> list[str]:
        return [*__all__, "__version__", *(name for name in super().__dir__() if name[0] == "_")]

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __getattr__(self, name: str) -> Any:
        if name == "__version__":
            found: Any = importlib.metadata.version("servo-models")
        elif name in _HOME:
            found = getattr(importlib.import_module(f"{self.__name__}.{_HOME[name]}"), name)
        else:
            raise AttributeError(f"module '{self.__name__}' has no attribute '{name}'")
        setattr(self, name, found)
        return found


sys.modules[__name__].__class__ = _Package
