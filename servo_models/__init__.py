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

import importlib
import sys
from types import ModuleType
from typing import Any

_NAMES = {
    "actuators.torque_causal": "torque_causal",
    "analysis.explain": "explain overview",
    "analysis.figures": "figures",
    "analysis.linearise": "linearise",
    "analysis.simulate": "Result simulate",
    "build": "build",
    "catalogue": "actuator model",
    "core.block": (
        "Ambiguity Bench Clock DeadTime Fault FirstOrderLag Grid Harmonic Hints Memory "
        "Mode Notice Param Queue block effect"
    ),
    "core.plant": "Actuator Plant State Variant Wire place",
    "core.simulate": "Model",
    "data.arrays": "describe",
    "data.description": "Description read_description",
    "data.parameters": "ParameterSet read_parameters write_parameters",
    "data.samples": "sample",
    "data.tables": "read_inputs read_signals write_signals",
    "diagnosis.diagnose": "diagnose",
    "diagnosis.settings": "Settings",
    "effects": "effects_on",
    "errors": "UserError",
    "identification.check": "check",
    "identification.identify": "identify",
    "simulators.export": "export",
    "simulators.nominal": "import_nominal",
    "survey.rehearsal.rehearse": "rehearse",
    "survey.survey": "survey",
    "validation.any_fmu.experiment": "Against",
    "validation.rows": "Validation",
    "validation.runner": "validate",
}
"""Public names by their module; ``__init__.pyi`` says the same for type checkers."""
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = sorted(_HOME)  # noqa: PLE0605


class _Package(ModuleType):
    """This package, whose modules ``build`` and ``survey`` do not hide the functions."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        found: Any = version("servo-models")
    elif name in _HOME:
        found = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    else:
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__, "__version__"})
