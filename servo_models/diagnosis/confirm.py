"""The diagnosed model run as an FMU, on the inputs of every log, beside what was measured."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np

from servo_models.build import build
from servo_models.core.simulate import Model
from servo_models.data.log import Log
from servo_models.diagnosis.search.selection import Selection
from servo_models.errors import UserError
from servo_models.files import scratch
from servo_models.fmu.fmu import Limits
from servo_models.identification.result import Accuracy, accuracy
from servo_models.identification.simulation import prepared
from servo_models.validation.fmu_subject import Subject
from servo_models.validation.implementation import LIMIT, difference

OWN = Limits(seconds=1e6, megabytes=1e5)  # no limit in effect: our own FMU, maybe a long log


@dataclass(frozen=True)
class Confirmation:
    """What the FMU itself leaves of a gap.

    Attributes:
        rows: RMS errors [SI] of every output in both parts of every log; ``before`` is the
            nominal model in this process, ``after`` the FMU.
        difference: largest one between FMU and simulation over full scale [1]; 0 is equal
            to the last bit.
        moving: logs that begin in motion, to which a host cannot put an FMU: their rows are those
            of the simulation.
    """

    rows: tuple[Accuracy, ...]
    difference: float
    moving: tuple[str, ...] = ()

    @property
    def not_run(self) -> str:
        """The logs over which the FMU was not run, quoted."""
        return ", ".join(f"'{name}'" for name in self.moving)

    @property
    def doubt(self) -> str:
        """What is amiss with the FMU, "" for nothing."""
        if self.difference <= LIMIT and self.moving:
            return (
                "begins at rest, and no host can put it to the motion in which logs begin:"
                f" {self.not_run}; their figures are those of the simulation"
            )
        if self.difference <= LIMIT:
            return ""
        return (
            f"differs from the simulation by {self.difference:.2g} of full scale, so figures of"
            " fits are not its own: take those of the FMU, and report a fault of servo-models"
        )


def confirm(fitted: Model, selection: Selection, logs: Sequence[Log]) -> Confirmation:
    """Build the FMU of a diagnosed model and run it where the logs were made.

    Samples that a log holds out are judged too: no fit of the diagnosis has seen them.

    Where a diagnosed model cannot be simulated on a log that no fit has seen, its rows are NaN.

    Raises:
        UserError: an FMU that stops where the simulation goes on.
    """
    if fitted.actuator.inner:
        raise UserError(f"'{fitted.actuator.name}' is a simulation that is not ours")
    taken, nominal = selection.taken, selection.retuned.problem
    responses, off, moving = [], 0.0, []
    with scratch() as folder:
        path = build(fitted, folder / "diagnosed.fmu")
        with closing(Subject(path, fitted.actuator, OWN)) as fmu:
            for run in taken.problem.runs:
                out = run.outputs_or_nan(taken.values)
                inputs = run.replayed(taken.values)
                if inputs is None:
                    moving.append(run.log.name)
                elif np.isfinite(out).all():
                    # no host reads what a command does before it steps
                    there = prepared(run.model, replace(run.log, channels={}), run.steps)
                    chosen = replace(run.model, values=run.with_constants(taken.values))
                    whole = fmu.run(chosen, run.times, inputs)
                    found = whole[-len(run.log.times) :, run.columns]
                    off = max(off, difference(there.outputs(taken.values), found))
                    out = np.where(np.isnan(run.after[[*run.columns]]), found, out)
                responses.append(dict(zip(run.log.outputs, np.ascontiguousarray(out.T))))
    rows = accuracy(logs, nominal.responses(nominal.nominal), responses)
    return Confirmation(tuple(rows), off, tuple(moving))
