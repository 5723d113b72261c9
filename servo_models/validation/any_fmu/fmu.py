"""Any FMU for co-simulation: its variables, and a run of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError, did_you_mean
from servo_models.validation.fmu_subject import OpenFmu, packed
from servo_models.validation.host_process import LIMITS, Limits

ENUMERATION = {False: "Integer", True: "Int64"}  # type of enumerations in FMI 2.0 and 3.0
REAL = ("Real", "Float64", "Float32")
NOT_RUN = ("Binary", "Clock")


@dataclass(frozen=True)
class Variable:
    """A variable of the model description.

    Attributes:
        name, reference: of it.
        kind: the type by which it is set and got, such as "Real", "Float64" or "Boolean".
        causality: "input", "output", "parameter" and others.
        continuous: it may move between two communication points.
        unit: as the description writes it, "" for none.
        scalar: it is one number, a truth value or a text, no array.
    """

    name: str
    reference: int
    kind: str
    causality: str
    continuous: bool
    unit: str
    scalar: bool

    @property
    def real(self) -> bool:
        return self.kind in REAL

    @property
    def numeric(self) -> bool:
        """Whether its values are numbers, true or false."""
        return self.scalar and self.kind not in ("String", *NOT_RUN)


class AnyFmu(OpenFmu):
    """An FMU of FMI 2.0 or 3.0 for co-simulation, whoever made it."""

    strict = False  # most public FMUs break some rule, and run

    def __init__(self, path: str | Path, limits: Limits = LIMITS) -> None:
        """Unpack and read an FMU.

        Raises:
            UserError: no such file, no FMU, one too large, or one of another version of FMI.
        """
        super().__init__(path, limits)
        self.over = self._library_obstacle()

    def _understand(self) -> None:
        version = self.description.fmiVersion
        if not version.startswith(("2.", "3.")):
            raise UserError(f"it is of FMI {version}; 2.0 and 3.0 are validated")
        self.variables = {
            variable.name: _variable(variable, self.is_fmi3)
            for variable in self.description.modelVariables
        }
        self._inputs = [
            variable
            for variable in self.variables.values()
            if variable.causality == "input" and variable.numeric
        ]
        self._outputs: list[Variable] = []

    def _about(self) -> dict[str, Any]:
        sides = {"inputs": self._inputs, "outputs": self._outputs}
        return {side: [(it.reference, it.kind) for it in some] for side, some in sides.items()}

    @property
    def title(self) -> str:
        """Name of the model, in print."""
        return self.clean(str(self.description.modelName))

    @property
    def any_step(self) -> bool:
        """Whether communication steps of one run may differ."""
        return bool(self.description.coSimulation.canHandleVariableCommunicationStepSize)

    def named(self, name: str, place: str) -> Variable:
        """Return a variable whose values are numbers.

        Raises:
            UserError: there is none, or one of another type.
        """
        if name not in self.variables:
            raise UserError(
                f"{place}: FMU '{self.name}' has no variable '{name}';"
                f" {did_you_mean(name, self.variables)}"
            )
        variable = self.variables[name]
        if not variable.numeric:
            kind = variable.kind if variable.scalar else "array"
            raise UserError(
                f"{place}: '{name}' is of type {kind}, which is not compared: leave its column out"
            )
        return variable

    def run(
        self,
        times: Array,
        inputs: Mapping[str, Array],
        outputs: Sequence[str],
        start: Mapping[str, Any],
        tolerance: float = 0.0,
    ) -> Array:
        """Return outputs at ``times``, shape (n, outputs), of a new instance.

        Args:
            times: communication points [s], shape (n,).
            inputs: values by name, shape (n,), each held until the next point; inputs that are
                not named keep the start value of the description.
            outputs: names of variables to read.
            start: start values by name.
            tolerance: of the solver in the FMU, 0 for its own.

        Raises:
            FmuError: it stops, or its process does.
        """
        before = (self._inputs, self._outputs)
        self._inputs = [self.variables[name] for name in inputs]
        self._outputs = [self.variables[name] for name in outputs]
        interface = self.description.coSimulation
        if before != (self._inputs, self._outputs) or interface.canBeInstantiatedOnlyOncePerProcess:
            self.end_process()
        columns = np.column_stack([inputs[name] for name in inputs] or [np.empty((len(times), 0))])
        known = self.variables
        starts = [(known[name].reference, known[name].kind, it) for name, it in start.items()]
        table = (packed(times), packed(columns))
        return self.rows((len(times), len(outputs)), "run", starts, *table, tolerance)


def _variable(variable: Any, is_fmi3: bool) -> Variable:
    kind = ENUMERATION[is_fmi3] if variable.type == "Enumeration" else variable.type
    unit = variable.unit or (variable.declaredType.unit if variable.declaredType else None)
    return Variable(
        variable.name,
        variable.valueReference,
        kind,
        variable.causality or "local",
        kind in REAL and variable.variability in (None, "continuous"),
        unit or "",
        not variable.dimensions,
    )
