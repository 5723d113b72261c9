"""Paste flat.py, the stepper, the slave and one model into the self-contained source of an FMU."""

from __future__ import annotations

import hashlib
import inspect
import math
import sys
from types import ModuleType

from fmu_src import slave
from fmu_src.variables import Variable, variables
from servo_models.core import flat, printer, stepper
from servo_models.core.simulate import Model

_FUTURE = "from __future__ import annotations\n"
_OWN = "from servo_models."
_OLDEST = """import sys

if sys.version_info < (3, 10):
    _TOLD = "this FMU needs Python 3.10 or newer, and its host brings " + sys.version.split()[0]
    sys.stderr.write(_TOLD + "\\n")
    raise ImportError(_TOLD)
"""


def slave_source(model: Model) -> tuple[str, str]:
    """Return the name of the slave's module and its text.

    The name holds a hash of the text: all FMUs of a process share one interpreter, where a
    second module of the same name would run the code of the first.
    """
    head = "\n\n".join(
        [
            repr(f"{model.actuator.title}, variant {model.variant}: generated, do not edit."),
            _FUTURE,
            _OLDEST,
            _pasted(flat),
            _pasted(printer),
            _pasted(stepper),
            _pasted(slave),
            "inf = math.inf",
        ]
    )
    fields = _fields(model)
    identity = hashlib.sha256((head + fields).encode()).hexdigest()
    name = f"{model.actuator.name}_{identity[:16]}"
    return name, f"{head}\nServo.content = Content(\n    identity={identity!r},\n{fields})\n"


def _pasted(module: ModuleType) -> str:
    """The text of a module without the imports that have no meaning in the pasted file."""
    text = inspect.getsource(module)
    return "".join(
        line
        for line in text.splitlines(keepends=True)
        if line != _FUTURE and not line.startswith(_OWN)
    )


def _fields(model: Model) -> str:
    """The fields of ``slave.Content``, as text."""
    every = variables(model)
    bounds = [_bounds(v) for v in every]
    low = [bound[0] for bound in bounds]
    plant = model.plant
    fields = {
        "flat": model.flat,
        "inputs": len(plant.inputs),
        "first_parameter": len(plant.inputs) + len(plant.outputs),
        "names": [v.name for v in every],
        "units": [v.unit for v in every],
        "start": [v.start or 0.0 for v in every],
        "low": low,
        "low_later": [math.inf if v.fixed else bound for v, bound in zip(every, low)],
        "high": [bound[1] for bound in bounds],
        "flags": frozenset(vr for vr, v in enumerate(every) if v.flag),
        "checked": [
            (one.low, one.high, one.beyond) for one in model.actuator.checked(model.variant)
        ],
    }
    return "".join(f"    {name}={value!r},\n" for name, value in fields.items())


def _bounds(variable: Variable) -> tuple[float, float]:
    """What may be set; an output has its bounds crossed over, so that nothing fits."""
    if variable.causality == "output":
        return math.inf, -math.inf
    largest = sys.float_info.max
    low, high = variable.low, variable.high
    return -largest if low is None else low, largest if high is None else high
