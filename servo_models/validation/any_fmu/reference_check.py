"""Any FMU against a reference: the run, the run at half the step, and the rows of the result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.fmu.fmu import Fmu, FmuError, Limits
from servo_models.report.numbers import number, plain, with_unit
from servo_models.validation.any_fmu.comparison import (
    Allowed,
    Compared,
    Trace,
    allowed,
    compare,
)
from servo_models.validation.any_fmu.experiment import (
    Against,
    Experiment,
    experiments,
    write_cross_check,
)
from servo_models.validation.rows import REFERENCE, Row, failure, judged

HALF = "difference at half the communication step"


@dataclass(frozen=True, eq=False)
class ReferenceCheck:
    """The result of a comparison: rows, and the curves of each output."""

    rows: tuple[Row, ...]
    compared: tuple[Compared, ...] = ()


def check_against(path: Path, against: Against, limits: Limits) -> ReferenceCheck:
    """Compare an FMU with its reference.

    Raises:
        UserError: an FMU that cannot be read, no reference, or files that cannot be used.
    """
    with closing(Fmu(path, limits)) as fmu:
        if fmu.over:
            raise UserError(f"FMU '{path}' {fmu.over}: look at its files with --static-only")
        checks = [_Run(fmu, chosen).checked(against) for chosen in experiments(fmu, against)]
    return ReferenceCheck(
        tuple(row for check in checks for row in check.rows),
        tuple(output for check in checks for output in check.compared),
    )


class _Run:
    """One experiment with one FMU."""

    def __init__(self, fmu: Fmu, experiment: Experiment) -> None:
        self.fmu, self.experiment = fmu, experiment
        self.times = experiment.times(fmu.any_step)
        self.step = float(np.median(np.diff(self.times)))
        self.outputs = list(experiment.reference)
        self.inputs = {name: trace.at(self.times) for name, trace in experiment.inputs.items()}

    def checked(self, against: Against) -> ReferenceCheck:
        try:
            values = self._run(self.times, self.inputs)
        except FmuError as error:
            where = self._where("run")
            return ReferenceCheck((failure(REFERENCE, where, str(error), self.fmu.name),))
        if folder := against.write_cross_check:
            outputs = dict(zip(self.outputs, values.T))
            write_cross_check(self.fmu, self.experiment, self.times, outputs, Path(folder))
        limits = {name: self._allowed(name) for name in self.outputs}
        compared = [
            self._compared(name, values[:, k], limits[name]) for k, name in enumerate(self.outputs)
        ]
        compared = _with_swaps(compared, limits, self.step)
        rows = [row for one in compared for row in self._rows(one)]
        rows += self._half(values, limits)
        return ReferenceCheck((*rows, *self._not_compared()), tuple(compared))

    def _run(self, times: Array, inputs: Mapping[str, Array]) -> Array:
        experiment = self.experiment
        return self.fmu.simulate(times, inputs, self.outputs, experiment.values, experiment.solver)

    def _allowed(self, name: str) -> Allowed:
        right = self._reference(name)
        exact = not self.fmu.variables[name].real
        return allowed(right, self.step, exact, **self.experiment.tolerance.of(name))

    def _reference(self, name: str) -> Trace:
        """The reference of the run, no longer than it."""
        whole = self.experiment.reference[name]
        begin, end = self.times[0], self.times[-1]
        inside = (whole.times > begin) & (whole.times < end)
        (first, last), between = whole.at(np.array([begin, end])), whole.values[inside]
        times = np.concatenate([[begin], whole.times[inside], [end]])
        return replace(whole, times=times, values=np.concatenate([[first], between, [last]]))

    def _compared(self, name: str, values: Array, limits: Allowed) -> Compared:
        variable = self.fmu.variables[name]
        response = Trace(self.times, values, not variable.continuous)
        unit = variable.unit or "1"
        return compare(name, unit, self._reference(name), response, limits, self.step)

    def _half(self, values: Array, limits: Mapping[str, Allowed]) -> list[Row]:
        """Run with the same inputs at half the step; the outputs may not change."""
        fixed = float(self.fmu.description.coSimulation.fixedInternalStepSize or 0.0)
        if fixed and abs(0.5 * self.step / fixed - round(0.5 * self.step / fixed)) > 1e-6:
            note = f"not examined: the FMU has an internal step of {number(fixed)} s"
            return [self._unknown(note)]
        middles = 0.5 * (self.times[:-1] + self.times[1:])
        finer = np.sort(np.concatenate([self.times, middles]))
        inputs = {name: np.repeat(column, 2)[:-1] for name, column in self.inputs.items()}
        try:
            again = self._run(finer, inputs)[::2]
        except FmuError as error:
            if self.fmu.over:
                reason = f"at half the step: {error}"
                return [failure(REFERENCE, self._where("run"), reason, self.fmu.name)]
            return [self._unknown(f"not examined: {error}")]
        rows = []
        for k, name in enumerate(self.outputs):
            held = not self.fmu.variables[name].continuous
            first = Trace(self.times, values[:, k], held)
            if not np.all(np.isfinite(first.values)):
                continue  # told already
            second = Trace(self.times, again[:, k], held)
            largest = compare(name, "1", first, second, limits[name], self.step).figures[0]
            row = self._row(name, HALF, largest.value, largest.limit)
            if not row.passed:
                row = replace(row, note=self._depends(row))
            rows.append(row)
        return rows

    def _unknown(self, note: str) -> Row:
        where = self._where("run")
        return judged(REFERENCE, where, HALF, None, note=note, subject=self.fmu.name)

    def _depends(self, row: Row) -> str:
        return plain(
            f"output '{row.case}' depends on the communication step: {number(self.step)} s and"
            f" {number(0.5 * self.step)} s differ by {with_unit(number(row.value), row.unit)}"
        )

    def _rows(self, output: Compared) -> list[Row]:
        """Rows of an output; the first that failed says what is wrong."""
        rows = [self._row(output.name, f.name, f.value, f.limit, f.unit) for f in output.figures]
        failed = next((k for k, row in enumerate(rows) if row.passed is False), None)
        if failed is not None:
            rows[failed] = replace(rows[failed], note=output.fault)
        return rows

    def _row(
        self, name: str, quantity: str, value: float, limit: float | None, unit: str | None = None
    ) -> Row:
        unit = unit or self.fmu.variables[name].unit or "1"
        where = self._where(name)
        return judged(REFERENCE, where, quantity, value, limit, unit, subject=self.fmu.name)

    def _not_compared(self) -> list[Row]:
        """Outputs that the reference does not have."""
        note = "the reference has no column of it: not compared"
        return [
            judged(REFERENCE, self._where(name), "figures", None, note=note, subject=self.fmu.name)
            for name, variable in self.fmu.variables.items()
            if variable.causality == "output" and name not in self.outputs
        ]

    def _where(self, case: str) -> tuple[str, str, str]:
        return self.fmu.title, self.experiment.label, case


def _with_swaps(
    compared: Sequence[Compared], limits: Mapping[str, Allowed], step: float
) -> list[Compared]:
    """Name outputs that follow the references of each other."""

    def fits(output: Compared, other: Compared) -> bool:
        asked = (other.name, other.unit, other.reference, output.response, limits[other.name], step)
        return output.response.held == other.reference.held and compare(*asked).passed

    faults: dict[str, str] = {}
    for output, other in combinations([one for one in compared if not one.passed], 2):
        if fits(output, other) and fits(other, output):
            swapped = f"outputs '{output.name}' and '{other.name}' are swapped"
            faults |= {output.name: swapped, other.name: swapped}
    return [replace(output, fault=faults.get(output.name, output.fault)) for output in compared]
