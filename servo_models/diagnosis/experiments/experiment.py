"""The next experiment: for fitted models that these logs cannot tell apart, a command that can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from servo_models.analysis.experiment import display, in_time
from servo_models.analysis.explain import display_unit, in_display_unit
from servo_models.analysis.isolability import cause, experiment
from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.data.tables import write_signals
from servo_models.diagnosis.experiments.experiment_search import Stage
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.verdict import FEW

TELLING = 1.0
"""Difference in noise floors, which no parameters imitate, from which a log tells two apart."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """A command to play next, and what it is expected to show.

    Attributes:
        one, other: effects of the two fitted models that it is to tell apart.
        text: instruction in words.
        wire: the input that is played.
        plan: the log to be, in which nothing is measured yet.
        separation: RMS difference of the two fitted models that neither can imitate by its
            parameters, in noise floors.
        so_far: RMS difference of the two fits in the logs that there are, in noise floors.
        file: name of the table with the command, "" while there is none.
    """

    one: tuple[str, ...]
    other: tuple[str, ...]
    text: str
    wire: Wire
    plan: Log
    separation: float
    so_far: float
    file: str = ""

    @property
    def times(self) -> Array:
        """[s], shape (n,)."""
        return self.plan.times

    @property
    def command(self) -> Array:
        """What is played [SI], shape (n,)."""
        return self.plan.inputs[self.wire.name]

    @property
    def constants(self) -> Mapping[str, float]:
        """Inputs and parameters [SI] that hold meanwhile, by name."""
        return self.plan.constants

    @property
    def instruction(self) -> str:
        """What to do, the table to play included."""
        return f"{self.text} Its table is {self.file}." if self.file else self.text

    @property
    def telling(self) -> bool:
        """Whether it is expected to tell the two apart."""
        return self.separation >= TELLING

    def write(self, folder: Path) -> None:
        """Write times and command as ``file`` in a folder, a table ready to play.

        Raises:
            UserError: see ``tables.write_signals``.
        """
        wires = {self.wire.name: self.wire}
        write_signals(folder / self.file, self.times, {self.wire.name: self.command}, wires)


def is_filled(path: Path) -> bool:
    """Return whether a table holds more than ``Experiment.write`` writes: times and a command."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.readline().count(b",") != 1


def next_experiments(rivals: Sequence[FittedModel], seed: int = 0) -> tuple[Experiment, ...]:
    """Return for each pair of fitted models left the command that separates them.

    Of more than ``verdict.FEW`` only the first is told from each other one, since what it survives
    leaves few pairs.  Parameters alone, where they are the first, are told from what they imitate
    before that is told from another; commands that show nothing of it are none to play.

    Args:
        rivals: fitted models that a diagnosis leaves, the likeliest first.
        seed: of random commands.
    """
    count = len(rivals)
    if count < 2:
        return ()
    stage = Stage(rivals, seed)
    every = combinations(range(count), 2)
    effects = bool(rivals[0].effects)
    pairs = [pair for pair in every if pair[0] == 0 or (count <= FEW and effects)]
    found = (_experiment(stage, i, k) for i, k in pairs)
    return tuple(one for one in found if effects or one.telling)


def _experiment(stage: Stage, i: int, k: int) -> Experiment:
    separation, command = stage.best(i, k)
    one, other = stage.rivals[i], stage.rivals[k]
    change = one.evidence.errors - other.evidence.errors
    so_far = float(np.sqrt(np.mean(change**2)))
    duration = float(stage.times[-1])
    outputs = " and ".join(stage.problem.sigma)
    played = command.text(stage.wire, duration)
    plant = stage.problem.model.plant
    telling = f"To tell {_names(one)} from {_names(other)}"
    if separation < TELLING:
        telling = (
            f"No command that was tried inside the limits tells {_names(one)} from"
            f" {_names(other)}. At best"
        )
    sentences = [
        f"{telling}, play on {stage.wire.name}: {played};"
        f" {in_time(duration)} long, log {outputs} every {in_time(stage.step)}.",
        f"Re-fitted to imitate one another, the two models then still differ by {_few(separation)}"
        f" noise floors; as they are fitted now, they differ by {_few(so_far)} in these logs.",
    ]
    plan = stage.plan(command)
    if plan.settle:
        sentences.append(f"Hold its first value for {in_time(plan.settle)} before the log begins.")
    if plan.constants:
        sentences.append(f"Meanwhile {_held(plant, plan.constants)}, as in log '{plan.name}'.")
    known = _on_record(plant, one.effects, other.effects)
    if known:
        sentences.append(f"What else separates them: {known}.")
    return Experiment(
        one.effects,
        other.effects,
        " ".join(sentences),
        stage.wire,
        plan,
        separation,
        so_far,
    )


def _few(size: float) -> str:
    """Two figures, but never a power of ten for what a person can read without."""
    return f"{size:.2g}" if size < 99.5 else f"{size:.0f}"


def _names(fitted_model: FittedModel) -> str:
    return " with ".join(fitted_model.effects) or "parameters alone"


def _held(plant: Plant, constants: Mapping[str, float]) -> str:
    """Constants of a log as a person reads them."""
    parts = []
    for name, value in constants.items():
        if name in plant.parameters:
            parameter = plant.parameters[name]
            text, unit = in_display_unit(value, parameter), display_unit(parameter)
        else:
            scale, unit = display(plant.wire[name])
            text = f"{scale * value:.6g}"
        parts.append(f"{name} = {text} {unit}".rstrip())
    return ", ".join(parts)


def _on_record(plant: Plant, one: Sequence[str], other: Sequence[str]) -> str:
    """What is known to separate the effects in which two fitted models differ."""
    texts = [
        experiment(cause(a, plant), cause(b, plant), plant)
        for a in one
        for b in other
        if a not in other and b not in one
    ]
    return "; ".join(dict.fromkeys(filter(None, texts)))
