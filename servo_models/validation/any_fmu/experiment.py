"""An experiment with any FMU: its inputs, its reference, and the files that hold them.

CSV files, the folder of a Cross-Check, or the FMU's own reference by FMI-LS-REF.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from servo_models.core.types import Array
from servo_models.data.readers import read_columns
from servo_models.errors import UserError, did_you_mean
from servo_models.files import write_whole
from servo_models.fmu.archive import check_xml
from servo_models.fmu.fmu import Fmu, Variable
from servo_models.units import factor
from servo_models.validation.any_fmu.comparison import Trace
from servo_models.validation.any_fmu.tolerance import Tolerance, read_tolerance

OWN = Path("extra") / "org.fmi-standard.fmi-ls-ref"
"""Folder of an FMU's own reference (FMI-LS-REF 1.0.0-alpha.1, section 2.4)."""
MANIFEST = "fmi-ls-manifest.xml"
LARGEST_TEXT = 1 << 16  # bytes that are read of a file of options
MOST_POINTS = 2_000_000  # communication points of a run at most
EVEN = 0.01  # largest spread of the steps of an even grid, over the longest step
WHOLE = 1e-6  # rounding of times, over the longest step or the run


@dataclass(frozen=True)
class Against:
    """The reference of an FMU as the user names it.

    Attributes:
        inputs, reference, tolerance: files; no reference is the FMU's own.
        cross_check: folder with ``<model>_ref.csv`` and the others, in place of the files.
        step: communication step [s].
        write_cross_check: folder to write the experiment and the outputs to.
    """

    inputs: str | Path | None = None
    reference: str | Path | None = None
    tolerance: str | Path | None = None
    cross_check: str | Path | None = None
    step: float | None = None
    write_cross_check: str | Path | None = None


@dataclass(frozen=True, eq=False)
class Experiment:
    """One run of an FMU and its reference.

    Attributes:
        name: of the experiment, or of the file with the reference.
        reference: curves by name of a variable.
        inputs: curves by name of an input.
        start, stop: of the run [s]; None as the reference has it.
        step: communication step [s]; None for the points of reference and inputs.
        solver: relative tolerance for the solver in the FMU, 0 for its own.
        values: start values by name.
        tolerance: largest differences of the outputs.
    """

    name: str
    reference: Mapping[str, Trace]
    inputs: Mapping[str, Trace] = field(default_factory=dict)
    start: float | None = None
    stop: float | None = None
    step: float | None = None
    solver: float = 0.0
    values: Mapping[str, Any] = field(default_factory=dict)
    tolerance: Tolerance = field(default_factory=Tolerance)

    @property
    def label(self) -> str:
        """The name without folders."""
        return self.name.rpartition("/")[2].rpartition("\\")[2].strip("'")

    def times(self, any_step: bool) -> Array:
        """Return the communication points, from start to stop.

        Raises:
            UserError: a reference or inputs that do not reach from start to stop, or points that
                an FMU of fixed steps cannot take.
        """
        points = np.unique(np.concatenate([one.times for one in self.reference.values()]))
        start = points[0] if self.start is None else self.start
        stop = points[-1] if self.stop is None else self.stop
        slack = WHOLE * (stop - start)
        if not start < stop:
            raise UserError(f"{self.name}: the run ends at {stop:g} s, not after its start")
        if points[0] > start + slack or points[-1] < stop - slack:
            raise UserError(
                f"{self.name}: the reference has {points[0]:g} s to {points[-1]:g} s, the run"
                f" {start:g} s to {stop:g} s: give a reference of the whole run"
            )
        for name, trace in self.inputs.items():
            if trace.times[0] > start + slack:
                raise UserError(
                    f"{self.name}: input '{name}' begins at {trace.times[0]:g} s, the run at"
                    f" {start:g} s: give its value from there on"
                )
        if self.step is not None:
            return _even(start, stop, self.step, any_step)
        changes = [one.times for one in self.inputs.values()]
        every = np.unique(np.concatenate([points, *changes]))
        every = every[(every > start + slack) & (every < stop - slack)]
        every = np.concatenate([[start], every, [stop]])
        every = every[np.concatenate([[True], np.diff(every) > slack])]
        steps = np.diff(every)
        if WHOLE * steps.max() < np.ptp(steps) < EVEN * steps.max():  # rounded when written
            return np.linspace(start, stop, len(every))
        if not any_step and np.ptp(steps) > WHOLE * steps.max():
            raise UserError(
                f"{self.name}: the FMU takes steps of one size, and the points of reference and"
                " inputs are not even: give one with --step"
            )
        return np.asarray(every)


def _even(start: float, stop: float, step: float, any_step: bool) -> Array:
    count = (stop - start) / step
    if not 1.0 - WHOLE <= count <= MOST_POINTS:
        raise UserError(f"a step of {step:g} s does not fit into a run of {stop - start:g} s")
    whole = round(count)
    if abs(count - whole) <= WHOLE * max(count, 1.0):
        return np.asarray(start + (stop - start) * np.arange(whole + 1) / whole)
    if not any_step:
        raise UserError(
            f"a run of {stop - start:g} s is no whole number of steps of {step:g} s, and the FMU"
            " takes steps of one size: give another --step"
        )
    return np.append(start + step * np.arange(int(count) + 1), stop)


def experiments(fmu: Fmu, against: Against) -> list[Experiment]:
    """Return what an FMU is compared with, one or more of its own experiments.

    Raises:
        UserError: no reference, or a file that cannot be used, with the cure.
    """
    inputs = Path(against.inputs) if against.inputs else None
    if against.reference:
        chosen = [_of_files(fmu, Path(against.reference), inputs)]
    elif against.cross_check:
        chosen = [_of_cross_check(fmu, Path(against.cross_check))]
    else:
        chosen = _of_its_own(fmu, inputs)
    if against.write_cross_check and len(chosen) > 1:
        raise UserError(
            f"FMU '{fmu.path}' has {len(chosen)} experiments, and a Cross-Check is one: give one"
            " with --reference to write it"
        )
    compared = {name: fmu.variables[name].unit for e in chosen for name in e.reference}
    if against.tolerance:
        tolerance = read_tolerance(Path(against.tolerance), compared, fmu.variables)
        chosen = [_with(experiment, tolerance, fmu) for experiment in chosen]
    if against.step is not None:
        chosen = [replace(experiment, step=against.step) for experiment in chosen]
    return chosen


def has_its_own(fmu: Fmu) -> bool:
    """Whether an FMU carries a reference."""
    return (fmu.folder / OWN).is_dir()


def _with(experiment: Experiment, tolerance: Tolerance, fmu: Fmu) -> Experiment:
    inputs = {
        name: replace(trace, held=trace.held or tolerance.hold)
        for name, trace in experiment.inputs.items()
    }
    for name, value in tolerance.start.items():
        _check_start(fmu.variables[name], value, "start")
    values = {**experiment.values, **tolerance.start}
    return replace(experiment, tolerance=tolerance, inputs=inputs, values=values)


def _check_start(variable: Variable, value: Any, place: str) -> None:
    if variable.kind == "String" and isinstance(value, str):
        return
    if variable.numeric and isinstance(value, bool | int | float):
        return
    kind = variable.kind if variable.scalar else "array"
    raise UserError(f"{place}.{variable.name}: {value!r} is no value of a variable of type {kind}")


# Tables


def _of_files(fmu: Fmu, reference: Path, inputs: Path | None) -> Experiment:
    fed = _table(fmu, inputs, "inputs") if inputs else {}
    return Experiment(f"'{reference}'", _table(fmu, reference, "reference"), fed)


def _table(fmu: Fmu, path: Path, role: str) -> dict[str, Trace]:
    """Read times and curves; the first column is time."""
    columns = read_columns(path, header=True)
    if len(columns.names) < 2:
        raise UserError(f"'{path}' has no column beside time: add those of the {role}")
    clock = re.fullmatch(r"\s*t(?:ime)?\s*(?:[\[(]\s*(\w+)\s*[\])])?\s*", columns.names[0], re.I)
    if not clock:
        raise UserError(
            f"'{path}': the first column is '{columns.names[0]}'; name it 'time', in seconds"
        )
    times = columns.numbers(1) * (factor(clock[1], "s") if clock[1] else 1.0)
    columns.check_order(1, times)
    columns.check_steps(1, times, np.arange(len(times)))
    if len(times) < 2 or times[0] == times[-1]:
        raise UserError(f"'{path}' has {len(times)} row(s), no run: give rows from start to stop")
    traces: dict[str, Trace] = {}
    for number, header in enumerate(columns.names[1:], start=2):
        name, scale = _heading(fmu, f"'{path}'", header)
        variable = fmu.named(name, f"'{path}'")
        if name in traces:
            raise UserError(f"'{path}' has two columns '{name}': remove one")
        if role == "inputs" and variable.causality != "input":
            continue  # a table of a whole run
        if role == "reference" and variable.causality == "input":
            continue
        traces[name] = Trace(times, scale * columns.numbers(number), not variable.continuous)
    if not traces:
        wanted = "input" if role == "inputs" else "output"
        known = [v.name for v in fmu.variables.values() if v.causality == wanted]
        raise UserError(
            f"'{path}' has no column for an {wanted} of the FMU: {', '.join(known[:8]) or 'none'}"
        )
    return traces


def _heading(fmu: Fmu, place: str, header: str) -> tuple[str, float]:
    """Name of a column, and the factor that brings its values to the unit of the FMU."""
    header = header.strip()
    match = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\[\]]+?)\s*[\])]", header)
    if header in fmu.variables or not match or match[1] not in fmu.variables:
        return header, 1.0
    name, unit = match.groups()
    declared = fmu.variables[name].unit
    if unit == (declared or "1"):
        return name, 1.0
    if not declared:
        raise UserError(
            f"{place}, column '{header}': the FMU gives '{name}' no unit: write the name alone,"
            " with values as the FMU has them"
        )
    try:
        return name, factor(unit, declared)
    except UserError as error:
        raise UserError(f"{place}, column '{header}': {error}") from error


# Cross-Check


def _of_cross_check(fmu: Fmu, folder: Path) -> Experiment:
    """Read ``<model>_ref.csv``, ``<model>_ref.opt`` and ``<model>_in.csv`` of a folder."""
    model = fmu.path.stem
    if not folder.is_dir():
        raise UserError(f"no folder '{folder}': name the one with {model}_ref.csv")
    reference, inputs = folder / f"{model}_ref.csv", folder / f"{model}_in.csv"
    if not reference.is_file():
        others = [path.name for path in sorted(folder.glob("*_ref.csv"))]
        raise UserError(
            f"'{folder}' has no {reference.name}; {did_you_mean(reference.name, others)}"
        )
    experiment = _of_files(fmu, reference, inputs if inputs.is_file() else None)
    options = folder / f"{model}_ref.opt"
    if not options.is_file():
        return experiment
    given = _options(options)
    return replace(
        experiment,
        start=given.get("StartTime"),
        stop=given.get("StopTime"),
        step=given.get("StepSize") or None,  # 0 is a step of the tool's choice
        solver=given.get("RelTol", 0.0),
    )


OPTIONS = ("StartTime", "StopTime", "StepSize", "RelTol")


def _options(path: Path) -> dict[str, float]:
    """Read lines of a name, a comma and a number."""
    options = {}
    text = path.read_bytes()[:LARGEST_TEXT].decode("utf-8-sig", "replace")
    for row, line in enumerate(text.splitlines(), start=1):
        name, _, value = line.strip().rstrip(",").replace("=", ",").partition(",")
        if name.strip() not in OPTIONS:
            continue  # tools write options of their own
        try:
            options[name.strip()] = float(value)
        except ValueError:
            raise UserError(
                f"'{path}', row {row}: '{value.strip()}' is no number; write {name.strip()},0.01"
            ) from None
        if not np.isfinite(options[name.strip()]):
            raise UserError(f"'{path}', row {row}: {value.strip()} is not finite; correct it")
    return options


def write_cross_check(
    fmu: Fmu, experiment: Experiment, times: Array, outputs: Mapping[str, Array], folder: Path
) -> None:
    """Write an experiment as a Cross-Check has it, and the outputs as ``<model>_out.csv``."""
    model = fmu.path.stem
    _write_table(folder / f"{model}_ref.csv", experiment.reference)
    if experiment.inputs:
        _write_table(folder / f"{model}_in.csv", experiment.inputs)
    step = float(f"{np.median(np.diff(times)):.12g}")
    given = (float(times[0]), float(times[-1]), step, experiment.solver or 1e-4)
    lines = [f"{name},{value!r}" for name, value in zip(OPTIONS, given)]
    write_whole(folder / f"{model}_ref.opt", ("\n".join(lines) + "\n").encode())
    curves = {name: Trace(times, values) for name, values in outputs.items()}
    _write_table(folder / f"{model}_out.csv", curves)


def _write_table(path: Path, traces: Mapping[str, Trace]) -> None:
    times = next(iter(traces.values())).times
    header = ",".join(f'"{name}"' for name in ("time", *traces))
    columns = [times, *(trace.values for trace in traces.values())]
    rows = (",".join(repr(float(value)) for value in row) for row in zip(*columns))
    write_whole(path, ("\n".join([header, *rows]) + "\n").encode())


# FMI-LS-REF


def _of_its_own(fmu: Fmu, inputs: Path | None) -> list[Experiment]:
    manifest = fmu.folder / OWN / MANIFEST
    if not manifest.is_file():
        raise UserError(
            f"FMU '{fmu.path}' has no reference of its own: give one with --reference ref.csv, or"
            " look at its files alone with --static-only"
        )
    try:
        listed = list(_read_manifest(fmu, manifest, inputs))
    except (ValueError, IndexError, ElementTree.ParseError) as error:
        raise UserError(
            f"FMU '{fmu.path}': {OWN.as_posix()} cannot be read ({fmu.clean(str(error))}): give a"
            " reference with --reference ref.csv"
        ) from error
    if not listed:
        raise UserError(f"FMU '{fmu.path}': {OWN.as_posix()} names no experiment with references")
    return listed


def _read_manifest(fmu: Fmu, manifest: Path, inputs: Path | None) -> Iterator[Experiment]:
    """Experiments with references, in the manifest and in the files that it names."""
    root = _xml(manifest)
    named = [(manifest, element) for element in root.iter("Experiment")]
    for related in root.iter("Related"):
        if related.get("role", "").startswith("experiment"):
            path = _inside(fmu, manifest, related.get("source", ""))
            named += [(path, element) for element in _xml(path).iter("Experiment")]
    for path, element in named:
        experiment = _of_element(fmu, path, element, inputs)
        if experiment:
            yield experiment


def _xml(path: Path) -> ElementTree.Element:
    try:
        check_xml(path)
    except UserError as error:  # it names the file in the FMU, and who calls, FMU and cure
        raise ValueError(str(error)) from error
    return ElementTree.parse(path).getroot()


def _inside(fmu: Fmu, beside: Path, source: str) -> Path:
    """The file that a relative URI names."""
    path = (beside.parent / source).resolve()
    if not path.is_relative_to(fmu.folder.resolve()) or not path.is_file():
        raise UserError(f"FMU '{fmu.path}': it names a file '{source[:100]}' that it has not")
    return path


def _of_element(
    fmu: Fmu, file: Path, element: ElementTree.Element, inputs: Path | None
) -> Experiment | None:
    references, stimuli = element.find("References"), element.find("Stimuli")
    if references is None:
        return None
    for table in (references, stimuli):
        if table is not None and table.get("type", "text/csv") != "text/csv":
            raise UserError(
                f"FMU '{fmu.path}': its reference is {table.get('type')}; CSV is read, so give one"
                " with --reference ref.csv"
            )
    reference = _inside(fmu, file, references.get("source", ""))
    if inputs is None and stimuli is not None:
        inputs = _inside(fmu, file, stimuli.get("source", ""))
    parameters, values = element.find("Parameters"), {}
    if parameters is not None:
        values = _parameters(fmu, _inside(fmu, file, parameters.get("source", "")))

    def number(key: str) -> float | None:
        text = element.get(key)
        return float(text) if text else None

    return replace(
        _of_files(fmu, reference, inputs),
        name=f"experiment '{fmu.clean(element.get('name', ''))}' of the FMU",
        start=number("startTime"),
        stop=number("stopTime"),
        step=number("stepSize"),
        solver=number("tolerance") or 0.0,
        values=values,
    )


def _parameters(fmu: Fmu, path: Path) -> dict[str, Any]:
    """Read the values of an SSV file, in the units of the FMU."""
    values: dict[str, Any] = {}
    for element in _xml(path).iter():
        if element.tag.rpartition("}")[2] != "Parameter":
            continue
        name = element.get("name", "")
        if name not in fmu.variables:
            raise UserError(f"'{path.name}': FMU '{fmu.name}' has no variable '{name}'")
        variable, value = fmu.variables[name], element[0]
        text, kind = value.get("value", ""), value.tag.rpartition("}")[2]
        if kind == "String":
            values[name] = text
        elif kind == "Boolean":
            values[name] = text in ("true", "1")
        else:
            unit = value.get("unit", "")
            scale = factor(unit, variable.unit) if unit not in ("", variable.unit) else 1.0
            values[name] = float(text) * scale
        _check_start(variable, values[name], path.name)
    return values
