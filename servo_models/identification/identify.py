"""Identify an actuator from measured files: what ``servo-models identify`` does.

A description decides the way.  *Simulation*: logs, any parameters.  *Transfer function*:
logs and frequency responses, a linear model and, where the actuator has a grey box, its
physical constants.  *Elements*: tables of single elements, which are put together.
"""

from __future__ import annotations

import datetime
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from servo_models.analysis.figures import Figures, figures
from servo_models.core.stop import Tell, silent
from servo_models.data.description import (
    ELEMENTS,
    SIMULATION,
    TRANSFER_FUNCTION,
    Description,
    read_description,
)
from servo_models.data.log import hashes
from servo_models.data.parameters import (
    Estimate,
    FitFigure,
    ParameterSet,
    known_error,
    pairs,
    with_given,
    write_parameters,
)
from servo_models.errors import UserError
from servo_models.identification.elements.identify import identify_elements
from servo_models.identification.fit import fit, fixed_by
from servo_models.identification.optimise import LOCAL
from servo_models.identification.result import FIT, HELD_OUT, Identification, doubts
from servo_models.identification.transfer.identify import identify_transfer
from servo_models.identification.transfer.sweeps import read_sweeps
from servo_models.report.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class Outcome(Result):
    """What an identification found, ready to be shown and written.

    Attributes:
        result: by the method.
        parameters: with standard errors, the date of today and hashes of the files; None where
            nothing became a parameter.
        converged: False for a search that was stopped, or has not found a best value.
    """

    result: Any
    parameters: ParameterSet | None
    converged: bool = True

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why its values are doubtful, a sentence each; none where they are not."""
        return doubts(self.result.warnings)

    @property
    def believable(self) -> bool:
        return not self.doubts

    def write_parameters(self, path: str | Path) -> None:
        """Write the parameters as a TOML file, which every command reads with ``--params``.

        Raises:
            UserError: nothing became a parameter, another suffix than ``.toml``, or a folder that
                cannot be written.
        """
        if self.parameters is None:
            raise UserError(
                f"'{path}' is not written: no parameter of this actuator was found this way,"
                " see the report"
            )
        write_parameters(self.parameters, Path(path))

    def figures(self) -> Figures:
        """Measure the identified model.

        Raises:
            UserError: nothing became a parameter, or see ``analysis.figures.figures``.
        """
        if self.parameters is None:
            raise UserError("no parameter of this actuator was found this way, so no model")
        return figures(self.parameters.model())


def identify(
    description: Description | str | Path,
    free: Sequence[str] = (),
    search: str = LOCAL,
    starts: int = 1,
    seed: int = 0,
    jobs: int | None = None,
    progress: Tell = silent,
) -> Outcome:
    """Estimate parameters of an actuator from the measured files of a description.

    Args:
        description: it, or the path of its TOML file.
        free: parameters or effects to fit by simulation; by default those of the
            description's ``free``, else those with an uncertainty.
        search, starts, seed, jobs: of a fit by simulation, see ``identification.fit.fit``.
        progress: is told what goes on.

    Raises:
        UserError: see ``read_description``, ``identification.fit.fit``,
            ``transfer.identify.identify_transfer`` and ``elements.identify_elements``.

    Example:
        >>> import servo_models as sm
        >>> found = sm.identify("gimbal.toml")
        >>> [estimate.name for estimate in found.parameters.estimates if estimate.standard_error]
        ['speed_constant', 'time_constant']
    """
    told = description if isinstance(description, Description) else read_description(description)
    method = method_of(told)
    if method != SIMULATION and free:
        raise UserError(f"'{told.path}': --free belongs to a fit by simulation, this is {method}")
    if method != SIMULATION and told.bounds:
        raise UserError(f"'{told.path}': bounds belong to a fit by simulation, this is {method}")
    if method == TRANSFER_FUNCTION:
        return _by_transfer_function(told, progress)
    if method == ELEMENTS:
        return _by_elements(told)
    names = tuple(free) or told.free
    if not names:
        known = fixed_by(told.logs, told.uncertainty)
        names = tuple(name for name in told.uncertainty if name not in known)
        if known and not names:
            raise UserError(
                f"'{told.path}': every log states every uncertain parameter, so nothing is left to"
                " estimate: name one under free, or leave out a constant"
            )
    result = fit(
        told.model,
        told.logs,
        names,
        told.uncertainty,
        search,
        starts,
        seed,
        jobs,
        progress,
        told.bounds,
        told.path,
    )
    return Outcome(result, _of_simulation(result), result.converged)


def method_of(told: Description) -> str:
    """Return the way that a description asks for, by name or by what it holds."""
    if told.method:
        return told.method
    if ELEMENTS in told.document:
        return ELEMENTS
    return TRANSFER_FUNCTION if "sweeps" in told.document else SIMULATION


def _by_transfer_function(told: Description, progress: Tell) -> Outcome:
    transfer = identify_transfer(
        told.logs,
        read_sweeps(told.document, told.path.parent, told.model.plant),
        model=told.model,
        known_errors=told.uncertainty,
        progress=progress,
    )
    files = hashes(told.logs) | _sweep_hashes(told)
    method = f"transfer function, {transfer.chosen.name}; grey box"
    constants = transfer.constants.estimates if transfer.constants else None
    parameters = constants and _of_tables(told, constants, method, files, transfer.warnings)
    return Outcome(transfer, parameters or None)


def _by_elements(told: Description) -> Outcome:
    elements = identify_elements(told)
    parameters = _of_tables(
        told, elements.parameters, "element by element", elements.files, elements.warnings
    )
    return Outcome(elements, parameters)


def _of_simulation(result: Identification) -> ParameterSet:
    """The estimates; parameters that were given and differ from the variant go with them."""
    model = result.fitted
    errors = dict(zip((free.name for free in result.free), result.standard_errors.tolist()))
    estimated = {
        name: Estimate(name, model.values[name], known_error(error), "estimated")
        for name, error in errors.items()
    }
    return ParameterSet(
        actuator=model.actuator.key,
        variant=model.variant,
        estimates=with_given(model.actuator.values(model.variant), model.values, estimated),
        correlations=pairs(list(errors), result.correlations),
        method=result.method,
        logs={name: f"sha256:{digest}" for name, digest in hashes(result.logs).items()},
        date=_today(),
        figures=_figures(result),
        warnings=tuple(result.warnings),
    )


def _of_tables(
    told: Description,
    values: Mapping[str, tuple[float, float | None]],
    method: str,
    files: Mapping[str, str],
    warnings: Sequence[str],
) -> ParameterSet:
    """Values and standard errors [SI] by name, with what the description gives beside them."""
    estimated = {name: Estimate(name, *pair, "estimated") for name, pair in values.items()}
    nominal = told.actuator.values(told.variant)
    return ParameterSet(
        actuator=told.actuator.key,
        variant=told.variant,
        estimates=with_given(nominal, told.model.values, estimated),
        method=method,
        logs={name: f"sha256:{digest}" for name, digest in files.items()},
        date=_today(),
        warnings=tuple(warnings),
    )


def _sweep_hashes(told: Description) -> dict[str, str]:
    """SHA-256 of the tables of sweeps, by name of the file."""
    entries = told.document.content.get("sweeps", [])
    paths = [told.path.parent / entry["file"] for entry in entries]
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths}


def _figures(result: Identification) -> dict[str, FitFigure]:
    """RMS error of every output, over the samples fitted and over those held out."""
    parts = {(row.output, row.part) for row in result.accuracy}
    wires = result.fitted.plant.wire
    return {
        f"{output}_rms_{part.replace(' ', '_')}": FitFigure(
            result.rms(output, part), wires[output].unit
        )
        for output in result.sigma
        for part in (FIT, HELD_OUT)
        if (output, part) in parts
    }


def _today() -> datetime.date:
    return datetime.date.today()
