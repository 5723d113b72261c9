"""From a log description to a parameter set: what ``servo-models identify`` does with logs."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path

from servo_models.description import Description, read_description
from servo_models.identification.fit import fit
from servo_models.identification.result import FIT, HELD_OUT, Identification
from servo_models.identification.search import LOCAL, Progress
from servo_models.parameter_set import Estimate, Figure, ParameterSet


def identify(
    description: Description | str | Path,
    free: Sequence[str] = (),
    search: str = LOCAL,
    starts: int = 1,
    seed: int = 0,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Estimate parameters of an actuator from the logs of a description.

    Args:
        description: it, or the path of its TOML file.
        free: parameters or effects; by default those of the description's ``free``, else
            those with an uncertainty.
        search, starts, seed, jobs, progress: see ``identification.fit.fit``.

    Raises:
        UserError: see ``read_description`` and ``identification.fit.fit``.
    """
    told = description if isinstance(description, Description) else read_description(description)
    names = tuple(free) or told.free or tuple(told.uncertainty)
    return fit(
        told.model, told.logs, names, told.uncertainty, search, starts, seed, jobs, progress
    )


def parameter_set(found: Identification, date: datetime.date | None = None) -> ParameterSet:
    """Return what was found as a parameter set to be written to a file.

    Parameters that were given and differ from the variant are listed with it.
    """
    model = found.fitted
    variant = model.actuator.values(model.variant)
    errors = dict(zip((free.name for free in found.free), found.standard_errors.tolist()))
    estimates = [
        Estimate(name, value, _known(errors[name]), "estimated")
        if name in errors
        else Estimate(name, value)
        for name, value in model.values.items()
        if name in errors or value != variant[name]
    ]
    return ParameterSet(
        actuator=model.actuator.name,
        variant=model.variant,
        estimates=tuple(estimates),
        method=found.method,
        logs={log.path.name: f"sha256:{log.sha256}" for log in found.logs},
        date=date,
        figures=_figures(found),
        warnings=tuple(found.warnings),
    )


def _known(error: float) -> float | None:
    """A standard error that the file can hold: on a bound there is none."""
    return error if error == error else None  # NaN


def _figures(found: Identification) -> dict[str, Figure]:
    """RMS error of every output, over the samples fitted and over those held out."""
    parts = {(row.output, row.part) for row in found.accuracy}
    wires = found.fitted.plant.wire
    return {
        f"{output}_rms_{part.replace(' ', '_')}": Figure(
            found.rms(output, part), wires[output].unit
        )
        for output in found.sigma
        for part in (FIT, HELD_OUT)
        if (output, part) in parts
    }
