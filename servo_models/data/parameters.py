"""Parameter files: values of an actuator with unit, uncertainty and where they come from."""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import singledispatch
from importlib import metadata
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from msgspec import Meta

from servo_models.catalogue import actuator as find_actuator
from servo_models.catalogue import model
from servo_models.core.own_actuator import key_from
from servo_models.core.plant import Actuator, Parameter, check_bounds
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.schema import (
    Number,
    Section,
    Table,
    named,
    nested,
    read_toml,
)
from servo_models.errors import UserError
from servo_models.files import write_whole
from servo_models.report.document import Document, Figure, about
from servo_models.report.interchange import plain
from servo_models.report.result import registered
from servo_models.units import factor

CORRELATION_DIGITS = 6  # decimals of a correlation in a file


class FigureTable(Table):
    """A ``[figures.NAME]``.

    Written as::

        value = 0.011
        unit = "deg"
    """

    value: Number
    unit: str = "1"


class EstimateTable(Table):
    """A ``[parameters.NAME]``; a standard error is infinite where the logs say nothing.

    Written as::

        value = 5.2277
        unit = "N.m/A"
        standard_error = 0.012
        origin = "estimated"
    """

    value: Number
    unit: str | None = None
    standard_error: Annotated[float, Meta(ge=0.0)] | None = None
    origin: str = "given"


class ParameterFile(Table):
    """A parameter file.

    Names of parameters may be written quoted or as nested tables, which is what TOML makes of
    ``[parameters.transport_delay.time]``::

        actuator = "torque_motor"               # or "mine.py", seen from this file
        variant = "measured"                    # values of all that is not listed
        method = "simulation error, least squares"
        date = 2026-01-31
        servo_models = "0.1.0"
        warnings = ["back_emf_constant: the logs do not determine it"]
        correlations = [["torque_constant", "inductance", 0.31]]

        [logs]
        "step.csv" = "sha256:..."

        [parameters.torque_constant]
        value = 5.2277
        unit = "N.m/A"
        standard_error = 0.012
        origin = "estimated"

        [figures.held_out_rms]                  # what the fit reached
        value = 0.011
        unit = "deg"
    """

    actuator: str
    variant: str | None = None
    method: str = ""
    date: datetime.date | None = None
    servo_models: str = ""
    warnings: list[str] = []
    logs: dict[str, Any] = {}
    parameters: dict[str, Any] = {}
    correlations: list[tuple[str, str, Annotated[float, Meta(ge=-1.0, le=1.0)]]] = []
    figures: dict[str, Any] = {}


@dataclass(frozen=True)
class Estimate:
    """A parameter's value.

    Attributes:
        name: name of the parameter, dotted for that of an effect.
        value: SI.
        standard_error: SI; infinite where the data say nothing, None where nobody asked.
        origin: ``"estimated"``, ``"given"``, or in a few words where it is from.
    """

    name: str
    value: float
    standard_error: float | None = None
    origin: str = "given"


class FitFigure(NamedTuple):
    """A figure that a fit reached, in ``unit``."""

    value: float
    unit: str = "1"


class EstimateDocument(Document, frozen=True):
    value: float
    unit: str
    standard_error: Annotated[Figure, about("null where the data say nothing, or nobody asked.")]
    origin: str


class FigureDocument(Document, frozen=True):
    value: Figure
    unit: str


class ParametersDocument(Document, frozen=True):
    """Parameters of an actuator [SI], as identified or given, by name."""

    actuator: str
    variant: str
    method: str
    date: str | None
    servo_models: Annotated[str, about("Version that found them.")]
    logs: Annotated[dict[str, str], about("Hash of each file that they were found from.")]
    parameters: dict[str, EstimateDocument]
    figures: Annotated[dict[str, FigureDocument], about("What the fit reached.")]


def installed_version() -> str:
    return metadata.version("servo-models")


@dataclass(frozen=True)
class ParameterSet:
    """Parameters of an actuator, as identified or given.

    Attributes:
        actuator: name, or path of the file of one of your own, see ``catalogue.actuator``.
        variant: variant whose values hold for all that is not listed.
        estimates: one for each parameter listed.
        correlations: pairs of parameters with their correlation.
        method: how the values were found, in words.
        logs: names of the files they were found from, with the hash of their bytes,
            ``"sha256:..."``.
        date: date of the identification, None if not told.
        version: version of servo-models that found them.
        figures: what the fit reached, by name.
        warnings: sentences that whoever uses the values should know.
        file: name of the file it was read from, "" if none.
    """

    actuator: str
    variant: str
    estimates: tuple[Estimate, ...]
    correlations: tuple[tuple[str, str, float], ...] = ()
    method: str = ""
    logs: Mapping[str, str] = field(default_factory=dict)
    date: datetime.date | None = None
    version: str = field(default_factory=installed_version)
    figures: Mapping[str, FitFigure] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    file: str = field(default="", compare=False)

    def settings(self) -> dict[str, float]:
        """Return the values [SI] by name of the parameter."""
        return {estimate.name: estimate.value for estimate in self.estimates}

    def model(self, overrides: Mapping[str, float | str] | None = None) -> Model:
        """Return the model with these values, and with ``overrides`` as in ``simulate.model``.

        Raises:
            UserError: see ``simulate.model``.
        """
        changes = dict(overrides or {})
        chosen = model(self.actuator, self.variant, {**self.settings(), **changes})
        return replace(chosen, provenance=self.provenance(changes))

    def document(self) -> dict[str, Any]:
        """Return the set as what JSON is made of, figures in SI."""
        known = find_actuator(self.actuator).plant_of(self.variant).parameters
        document = ParametersDocument.made_from(
            self,
            date=self.date and self.date.isoformat(),
            servo_models=self.version,
            parameters={
                estimate.name: EstimateDocument.made_from(
                    estimate, unit=known[estimate.name].param.unit
                )
                for estimate in self.estimates
            },
            figures={name: FigureDocument(*figure) for name, figure in self.figures.items()},
        )
        made: dict[str, Any] = plain(document)
        return made

    def provenance(self, overrides: Mapping[str, object]) -> str:
        """Return in words where the values come from."""
        parts = [self.file, self.method, self.date.isoformat() if self.date else ""]
        parts += [f"then set: {', '.join(sorted(overrides))}"] if overrides else []
        return "; ".join(part for part in parts if part)


def with_given(
    nominal: Mapping[str, float], values: Mapping[str, float], estimated: Mapping[str, Estimate]
) -> tuple[Estimate, ...]:
    """Return estimates in the order of ``values``, and the given values that the variant has not.

    ``nominal`` are the variant's values [SI] by name, ``values`` those of the fitted model.
    """
    return tuple(
        estimated.get(name, Estimate(name, value))
        for name, value in values.items()
        if name in estimated or value != nominal[name]
    )


def pairs(names: Sequence[str], correlations: Array) -> tuple[tuple[str, str, float], ...]:
    """Return the correlation of each two parameters that have one, of a matrix (p, p)."""
    rounded = correlations.round(CORRELATION_DIGITS).tolist()
    return tuple(
        (first, second, rounded[i][j])
        for (i, first), (j, second) in combinations(enumerate(names), 2)
        if math.isfinite(rounded[i][j]) and rounded[i][j]
    )


def known_error(error: float) -> float | None:
    """Return a standard error that a file can hold: on a bound, NaN, there is none."""
    return None if math.isnan(error) else error


def write_parameters(chosen: ParameterSet, path: str | Path) -> None:
    """Write a parameter file; ``read_parameters`` gives the same values, to the last bit.

    A number stands in the unit that a person reads the parameter in, or in SI where the
    conversion would round it.

    Raises:
        UserError: a file not named ``.toml``, a folder that cannot be written, or values
            that the actuator does not take; see ``simulate.model``.

    Example:
        >>> import servo_models as sm
        >>> found = sm.identify("gimbal.toml").parameters
        >>> sm.write_parameters(found, "gimbal_identified.toml")
        >>> sm.read_parameters("gimbal_identified.toml").estimates == found.estimates
        True
    """
    import tomli_w

    path = Path(path)
    if path.suffix.lower() != ".toml":
        raise UserError(f"'{path}' is no name for a parameter file: let it end in .toml")
    told = chosen.model()
    known = told.plant.parameters
    document = {
        "actuator": key_from(told.actuator, path.parent),
        "variant": chosen.variant,
        "method": chosen.method,
        "date": chosen.date,
        "servo_models": chosen.version,
        "warnings": list(chosen.warnings),
        "correlations": [list(it) for it in chosen.correlations],
        "logs": dict(chosen.logs),
        "parameters": nested({e.name: _entry(e, known[e.name]) for e in chosen.estimates}),
        "figures": {name: figure._asdict() for name, figure in chosen.figures.items()},
    }
    said = {key: value for key, value in document.items() if value not in (None, "", [], {})}
    write_whole(path, tomli_w.dumps(said).encode())


def _entry(estimate: Estimate, parameter: Parameter) -> dict[str, object]:
    """What stands in the file for an estimate."""
    unit = parameter.param.unit
    numbers = {"value": estimate.value}
    if estimate.standard_error is not None:
        numbers["standard_error"] = estimate.standard_error
    display = parameter.param.display
    if display:
        shown = {key: _in(display, number, unit) for key, number in numbers.items()}
        if all(shown[key] * factor(display, unit) == numbers[key] for key in numbers):
            numbers, unit = shown, display
    return {"value": numbers.pop("value"), "unit": unit, **numbers, "origin": estimate.origin}


def _in(display: str, number: float, unit: str) -> float:
    """``number`` [unit] in the unit ``display``: of the numbers that mean it, the shortest."""
    exact = number * factor(unit, display)
    for digits in (15, 16):
        short = float(f"{exact:.{digits}g}")
        if short * factor(display, unit) == number:
            return short
    return exact


def read_parameters(path: str | Path, trust: bool = False) -> ParameterSet:
    """Read a parameter file, whoever wrote it; only ``actuator`` has to be there.

    Where that is a Python file, it is run: ``trust`` allows this wherever it lies.

    Raises:
        UserError: no such file, no TOML, an unknown key, actuator, variant or parameter, a
            unit that does not convert, a value that is no number or out of its bounds.  It
            names the file and the key.

    Example:
        >>> from pathlib import Path
        >>> import servo_models as sm
        >>> text = 'actuator = "sg90"\\nparameters.motor_gain = {value = 46, unit = "rad/(V.s)"}'
        >>> _ = Path("sg90.toml").write_text(text)
        >>> sm.read_parameters("sg90.toml").model().values["motor_gain"]
        46.0
    """
    document = read_toml(Path(path))
    table, logs = document.read(ParameterFile), document.section("logs")
    actuator, variant = _whose(document, table, trust)
    figures = document.section("figures")
    reached = {name: figures.section(name).read(FigureTable) for name in figures}
    return ParameterSet(
        actuator=actuator.key,
        variant=variant,
        estimates=tuple(_estimates(document.section("parameters"), actuator, variant)),
        correlations=tuple(table.correlations),
        method=table.method,
        logs={name: logs.at(name).read(str, f'"{name}" = "sha256:..."') for name in logs},
        date=table.date,
        version=table.servo_models,
        figures={name: FitFigure(it.value, it.unit) for name, it in reached.items()},
        warnings=tuple(table.warnings),
        file=document.file.name,
    )


def _whose(document: Section, table: ParameterFile, trust: bool) -> tuple[Actuator, str]:
    """Actuator and variant that a file is for."""
    key = "actuator"
    try:
        actuator = find_actuator(table.actuator, document.file, trust)
        key = "variant"
        default = actuator.default_variant
        return actuator, actuator.variant(default if table.variant is None else table.variant).name
    except UserError as error:
        document.fail(key, error)


def _estimates(parameters: Section, actuator: Actuator, variant: str) -> Iterator[Estimate]:
    known = actuator.plant_of(variant).parameters
    entries = named(
        parameters, "parameter", known, _holds_tables_only, f"actuator '{actuator.name}'"
    )
    for name in entries:
        yield _estimate(entries.section(name), known[name])


def _holds_tables_only(table: Mapping[str, object]) -> bool:
    """Whether a table is on the way to a parameter, as ``transport_delay`` to its ``time``."""
    return bool(table) and all(isinstance(value, Mapping) for value in table.values())


def _estimate(section: Section, parameter: Parameter) -> Estimate:
    entry, si_unit = section.read(EstimateTable), parameter.param.unit
    if entry.unit is None:
        section.fail("unit", f'missing; add unit = "{si_unit}", or the one you mean')
    try:
        scale = factor(entry.unit, si_unit)
    except UserError as error:
        section.fail("unit", error)
    value = scale * entry.value
    try:
        check_bounds(parameter, value)
    except UserError as error:
        section.fail("value", error)
    spread = None if entry.standard_error is None else scale * entry.standard_error
    return Estimate(parameter.name, value, spread, entry.origin)


@singledispatch
def parameter_set_of(
    result: Any, date: datetime.date | None = None, with_map: bool = False
) -> ParameterSet:
    """Return the parameters that a result gives; the ``sections.py`` in its folder says which."""
    made: ParameterSet = registered(parameter_set_of.dispatch, result)(result, date, with_map)
    return made


class Parametrised:
    """A result whose parameters can be written by ``write_parameters``."""

    def parameter_set(self, date: datetime.date | None = None) -> ParameterSet:
        """Return the model that was found with standard errors, and what it is known from."""
        return parameter_set_of(self, date)

    def map_parameter_set(self, date: datetime.date | None = None) -> ParameterSet:
        """Return that parameter set with the residual map.

        Raises:
            UserError: there is no map.
        """
        return parameter_set_of(self, date, with_map=True)
