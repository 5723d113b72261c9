"""What speaks for an effect apart from any error: codes of a quantiser, ticks of a hold.

Both fold something at the size that a fit has found, and ask how bunched it is: readings at the
step, and the times at which commands are answered at the period.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from servo_models.analysis.experiment import display
from servo_models.core.plant import Placement, Wire
from servo_models.core.types import Array
from servo_models.diagnosis.clock import Answers, answers
from servo_models.diagnosis.codes import (
    FEWEST_CODES,
    MOST_CODES,
    NOISE_MEMORY_SAMPLES,
    as_bunched,
)
from servo_models.diagnosis.fitting.fitted_model import FittedModel

DOUBTFUL_PROBABILITY = 0.05
"""Probability of as much by chance, above which a detector confirms nothing."""
LEAST_TOLD_PROBABILITY = 1e-3
"""Probability below which the number itself says no more."""
ROUNDING_IN_STEPS = 1e-6
"""Part of a step that is none, where a reading moves by exactly one."""


@dataclass(frozen=True)
class Codes:
    """Readings of a quantised signal, folded at its step.

    Attributes:
        effect: the quantiser, and the wire ``reading`` that it quantises.
        step: [SI].
        phases: of the readings on the step [steps], -0.5 to 0.5 about the codes, shape (n,).
        stays: of each reading, shape (n,): from 0, the next one where it has moved by a step.
    """

    effect: str
    reading: Wire
    step: float
    phases: Array
    stays: NDArray[np.int64]

    @property
    def bunched(self) -> float:
        """Length of the mean of the phases: 1 on codes, 0 anywhere.

        Stays count alike, however long they are: where a reading rests a few times, any step has
        most of its samples near codes.
        """
        return float(np.abs(_mean_of_stays(np.exp(2j * np.pi * self.phases), self.stays)))

    @property
    def chance(self) -> float:
        """Probability that readings that know no codes are as bunched at any step at all: the step
        was not known beforehand (Bonferroni's bound)."""
        independent = min(int(self.stays[-1]) + 1, len(self.phases) / NOISE_MEMORY_SAMPLES)
        return min(1.0, (MOST_CODES - FEWEST_CODES) * as_bunched(self.bunched, independent))


Detection = Codes | Answers


def detection(found: FittedModel, name: str) -> Detection | None:
    """Return what an effect's own detector says of it, None where it has none or can say nothing.

    Args:
        found: a fit with the effect on.
        name: of the effect.
    """
    place = found.problem.model.plant.main(name)
    if place.effect.hints.signature == "clock":
        return answers(found, name)
    if place.effect.hints.signature == "codes":
        return _codes(found, place)
    return None


def sentence(seen: Detection) -> str:
    """Return what a detector says, in words."""
    if isinstance(seen, Codes):
        scale, unit = display(seen.reading)
        said = f"{seen.reading.name} bunches at codes {scale * seen.step:.3g} {unit}".rstrip()
        said = f"{said} apart"
    else:
        low, high = 1e3 * float(seen.late.min()), 1e3 * float(seen.late.max())
        said = (
            f"{len(seen.late)} steps of the command are answered {low:.3g} to {high:.3g} ms late,"
            f" bunched at ticks every {1e3 * seen.period:.3g} ms"
        )
    chance = "below 0.001" if seen.chance < LEAST_TOLD_PROBABILITY else f"{seen.chance:.1g}"
    doubtful = ", which confirms nothing" if seen.chance > DOUBTFUL_PROBABILITY else ""
    return f"{said}: {seen.bunched:.2f} of 1, by chance {chance}{doubtful}"


def _codes(found: FittedModel, place: Placement) -> Codes | None:
    wire = place.on[0]
    records = [log.outputs[wire] for log in found.problem.logs if wire in log.outputs]
    if not records:
        return None
    step = found.values[place.switch]
    turns = np.concatenate(records) / step
    stays = _stays(turns)
    middle = float(np.angle(_mean_of_stays(np.exp(2j * np.pi * turns), stays))) / (2.0 * np.pi)
    phases = turns - middle - np.round(turns - middle)
    return Codes(place.name, found.problem.model.plant.wire[wire], step, phases, stays)


def _stays(turns: Array) -> NDArray[np.int64]:
    """Number of the stay of each reading [steps]: it ends where one is a step from its first."""
    found, first, number = np.empty(len(turns), dtype=np.int64), turns[0], 0
    for i, value in enumerate(turns):
        if abs(value - first) >= 1.0 - ROUNDING_IN_STEPS:
            first, number = value, number + 1
        found[i] = number
    return found


def _mean_of_stays(phasors: NDArray[np.complex128], stays: NDArray[np.int64]) -> complex:
    """Mean over stays of the mean in each."""
    counts = np.bincount(stays)
    sums = np.bincount(stays, phasors.real) + 1j * np.bincount(stays, phasors.imag)
    return complex(np.mean(sums / counts))
