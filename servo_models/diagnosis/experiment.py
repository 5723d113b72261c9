"""The next experiment: for explanations that these logs cannot tell apart, a command that can."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from servo_models.actuator import Plant, Wire
from servo_models.diagnosis.commands import Array, in_time
from servo_models.diagnosis.experiment_search import Stage
from servo_models.diagnosis.explanation import Explanation
from servo_models.diagnosis.verdict import Verdict
from servo_models.lookalikes import cause, experiment
from servo_models.tables import write_signals

TELLING = 1.0
"""Difference in noise floors, which no parameters imitate, from which a log tells two apart."""


@dataclass(frozen=True, eq=False)
class Experiment:
    """A command to play next, and what it is expected to show.

    Attributes:
        one, other: effects of the two explanations that it is to tell apart.
        text: instruction in words.
        wire: the input that is played, and ``constants`` [SI] that hold meanwhile.
        times: [s], shape (n,).
        command: [SI], shape (n,).
        separation: RMS difference of the two fitted models that neither can imitate by its
            parameters, in noise floors.
        so_far: RMS difference of the two fits in the logs that there are, in noise floors.
    """

    one: tuple[str, ...]
    other: tuple[str, ...]
    text: str
    wire: Wire
    constants: Mapping[str, float]
    times: Array
    command: Array
    separation: float
    so_far: float

    @property
    def telling(self) -> bool:
        """Whether it is expected to tell the two apart."""
        return self.separation >= TELLING

    def write(self, path: Path) -> None:
        """Write times and command as a ``.csv`` or ``.parquet`` table ready to play.

        Raises:
            UserError: see ``tables.write_signals``.
        """
        write_signals(path, self.times, {self.wire.name: self.command}, {self.wire.name: self.wire})


def next_experiments(verdict: Verdict, seed: int = 0) -> tuple[Experiment, ...]:
    """Return for the likeliest explanation and each rival left the command that separates them.

    Args:
        verdict: of a diagnosis; without rivals there is nothing to separate.
        seed: of random commands.
    """
    if len(verdict.rivals) < 2:
        return ()
    stage = Stage(verdict.rivals, seed)
    return tuple(_experiment(stage, 0, k) for k in range(1, len(verdict.rivals)))


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
        telling = f"No command inside the limits tells {_names(one)} from {_names(other)}. At best"
    sentences = [
        f"{telling}, play on {stage.wire.name}: {played};"
        f" {in_time(duration)} long, log {outputs} every {in_time(stage.step)}.",
        f"The two fitted models then differ by {separation:.2g} noise floors that parameters"
        f" cannot imitate, by {so_far:.2g} so far.",
    ]
    known = _on_record(plant, one.effects, other.effects)
    if known:
        sentences.append(f"What else separates them: {known}.")
    return Experiment(
        one.effects,
        other.effects,
        " ".join(sentences),
        stage.wire,
        stage.problem.logs[0].constants,
        stage.times,
        command.values(stage.times),
        separation,
        so_far,
    )


def _names(explanation: Explanation) -> str:
    return " with ".join(explanation.effects) or "parameters alone"


def _on_record(plant: Plant, one: Sequence[str], other: Sequence[str]) -> str:
    """What is known to separate the effects in which two explanations differ."""
    texts = [
        experiment(cause(a, plant), cause(b, plant))
        for a in one
        for b in other
        if a not in other and b not in one
    ]
    return "; ".join(dict.fromkeys(filter(None, texts)))
