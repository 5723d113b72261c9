"""Search for the command on which two fitted models differ most.

What free parameters can imitate of a difference does not count: each model may be re-fitted
to the other, as far as the logs so far and the priors let it.  The search does so linearly, which
promises too much; of the best few commands it is done in earnest.
Sources: Hunter, Reiner, Technometrics 7 (1965) (designs to discriminate between two models);
Atkinson, Fedorov, Biometrika 62 (1975) (T-optimality: the rival re-fitted).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from servo_models.core.plant import Wire
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.diagnosis.experiments.commands import FAMILIES, PACES, Command, grid
from servo_models.diagnosis.experiments.refit import residual_after_refit
from servo_models.diagnosis.localisation.samples import moving_input
from servo_models.diagnosis.search.crossval import dispersion
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.errors import UserError
from servo_models.identification.problem import Problem

LENGTH = 5.0
"""Length of an experiment over the actuator's default one, or over the longest log if that is
shorter: whoever made it knows how fast the actuator is."""
SHORTLIST = 2
"""Commands of each family that look best before anything is re-fitted."""
RATIOS = (1.8, 1.35)
"""Steps of size and pace around the best one."""
EARNEST = 4
"""Commands on which the models are re-fitted in earnest."""
FARTHEST = 1000.0
"""Outputs over the largest ones of the logs from which a fitted model runs away: its command is no
experiment."""
FINEST = 5.0
"""Sampling steps that a pace takes at least."""


class Stage:
    """Where experiments are played: on fitted models, sampled as the logs are.

    Attributes:
        rivals: fitted models that are left.
        wire: the input that is played.
        low, high: its limits [SI], those of the logs or of the actuator's standard step.
        unit: of its paces and its length [s], as fast as the sampling can follow.
        times: of an experiment [s], shape (n,).
        farthest: outputs [noise floors] from which a model runs away.
    """

    def __init__(self, rivals: Sequence[FittedModel], seed: int) -> None:
        self.rivals = rivals
        self.problem = rivals[0].problem
        self.seed = seed
        self.wire, self.low, self.high = _limits(self.problem)
        step = min(float(np.median(np.diff(log.times))) for log in self.problem.logs)
        self.step = float(f"{step:.9g}")  # a table is read by people
        longest = max(log.duration for log in self.problem.logs)
        # where the sampling could not follow the slowest pace, all are made slower
        playable = (1.0 + 1e-9) * FINEST * self.step / PACES[-1]
        self.unit = max(min(self.problem.model.stop_time, longest), playable)
        count = round(LENGTH * self.unit / self.step)
        self.times = self.step * np.arange(count + 1.0)
        measured = [
            v / self.problem.sigma[n] for log in self.problem.logs for n, v in log.outputs.items()
        ]
        self.farthest = FARTHEST * max(float(np.abs(values).max()) for values in measured)
        self._responses: dict[tuple[int, Command], Array] = {}
        self._slopes: dict[tuple[int, Command], Array] = {}

    def best(self, one: int, other: int) -> tuple[float, Command]:
        """Return the separation [noise floors] of the best command for two rivals, and it."""
        middle, size = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        first = self._allowed(grid(middle, size, self.unit, self.seed))
        raw = self._all(self.difference, first, one, other)
        listed = [
            command
            for family in FAMILIES
            for command in sorted((c for c in first if c.family == family), key=lambda c: -raw[c])[
                :SHORTLIST
            ]
        ]
        found = self._all(self.separation, listed, one, other)
        for ratio in RATIOS:
            most = max(found, key=lambda command: found[command])
            found |= self._all(self.separation, self._allowed(most.nearby(ratio)), one, other)
        likely = sorted(found, key=lambda command: -found[command])[:EARNEST]
        tried = self._all(self.masked, likely, one, other)
        most = max(tried, key=lambda command: min(tried[command], found[command]))
        return min(tried[most], found[most]), most

    def difference(self, command: Command, one: int, other: int) -> float:
        """RMS difference [noise floors] of two rivals as they are, 0 where one cannot run or runs
        away."""
        try:
            responses = self._response(one, command), self._response(other, command)
        except UserError:
            return 0.0
        if max(float(np.abs(response).max()) for response in responses) > self.farthest:
            return 0.0
        change = responses[0] - responses[1]
        return float(np.sqrt(np.mean(change**2)))

    def separation(self, command: Command, one: int, other: int) -> float:
        """RMS difference [noise floors] of two rivals that neither can imitate."""
        if self.difference(command, one, other) == 0.0:
            return 0.0
        change = self._response(one, command) - self._response(other, command)
        left = min(
            _unexplained(change, self._slope(i, command), self.known[i]) for i in (one, other)
        )
        return float(np.sqrt(left / len(change)))

    def masked(self, command: Command, one: int, other: int) -> float:
        """RMS difference [noise floors] of two rivals that is left when either is re-fitted to the
        other, whichever imitates better."""
        if self.difference(command, one, other) == 0.0:
            return 0.0
        return min(self._left(command, *pair) for pair in ((one, other), (other, one)))

    def _left(self, command: Command, rig: int, model: int) -> float:
        """What a model leaves of the response of another one as the rig."""
        plan, names = self.plan(command), list(self.problem.sigma)
        parts = np.split(self._response(rig, command), len(names))
        outputs = {name: self.problem.sigma[name] * part for name, part in zip(names, parts)}
        problem = played(self.rivals[model], replace(plan, outputs=outputs))
        return residual_after_refit(self.rivals[model], problem, self.known[model])

    @cached_property
    def known(self) -> list[Array]:
        """What logs so far say of each rival's free parameters, each (p, p) per scale."""
        found = []
        for rival in self.rivals:
            slopes = rival.problem.jacobian(rival.evidence.vector, rival.widths)
            data, priors = np.split(slopes, [rival.problem.samples])
            coloured = max(dispersion(rival.evidence.errors), 1.0)
            found.append(data.T @ data / coloured + priors.T @ priors)
        return found

    def _all(
        self,
        measure: Callable[[Command, int, int], float],
        commands: Sequence[Command],
        one: int,
        other: int,
    ) -> dict[Command, float]:
        found = self.problem.workers.map(lambda c: measure(c, one, other), commands)
        return dict(zip(commands, found))

    def _allowed(self, commands: Iterable[Command]) -> list[Command]:
        """Commands inside the limits that the sampling can follow."""
        largest = 0.5 * (1.0 + 1e-9) * (self.high - self.low)
        slowest = 0.5 * self.times[-1]
        return [
            c for c in commands if c.size <= largest and FINEST * self.step <= c.pace <= slowest
        ]

    def _response(self, i: int, command: Command) -> Array:
        """Outputs of a rival in noise floors, one after the other, shape (m,)."""
        if (i, command) not in self._responses:
            problem = self._played(i, command)
            (found,) = problem.responses(self.rivals[i].evidence.vector)
            weighted = [values / problem.sigma[name] for name, values in found.items()]
            self._responses[i, command] = np.concatenate(weighted)
        return self._responses[i, command]

    def _slope(self, i: int, command: Command) -> Array:
        """Slopes of ``_response`` per scale of each free parameter, shape (m, p)."""
        if (i, command) not in self._slopes:
            problem = self._played(i, command)
            slopes = problem.jacobian(self.rivals[i].evidence.vector, self.rivals[i].widths)
            self._slopes[i, command] = slopes[: problem.samples]
        return self._slopes[i, command]

    def plan(self, command: Command) -> Log:
        """Return the log of a command before it is played: nothing is measured yet.

        It is taken under the conditions of the first log, other inputs where they were most of the
        time.  It begins at rest, as its first row says to whoever reads it, or, where the limits do
        not allow that, with its first row held.
        """
        first, n = self.problem.logs[0], len(self.times)
        rest = float(self.wire.rest)
        rests = self.low <= rest <= self.high
        held = {**first.constants, **{k: float(np.median(v)) for k, v in first.inputs.items()}}
        held.pop(self.wire.name, None)
        values = command.values(self.times)
        if rests:
            values[0] = rest
        return replace(
            first,
            times=self.times,
            inputs={self.wire.name: values},
            constants=held,
            outputs={name: np.zeros(n) for name in self.problem.sigma},
            rows=np.arange(n),
            held_out=np.zeros(n, dtype=bool),
            skipped=None,
            begin=0.0,
            settle=0.0 if rests else max(first.settle, self.problem.model.stop_time),
        )

    def _played(self, i: int, command: Command) -> Problem:
        """The problem of a rival with the log of a command."""
        return played(self.rivals[i], self.plan(command))


def played(rival: FittedModel, plan: Log) -> Problem:
    """Return the problem of a rival with the log of an experiment."""
    problem = rival.problem
    return Problem(problem.model, [plan], problem.free, sigma=problem.sigma)


def _limits(problem: Problem) -> tuple[Wire, float, float]:
    column, low, high = moving_input(problem)
    model = problem.model
    wire = model.plant.inputs[column]
    name, size = model.actuator.step
    if name == wire.name:
        rest = float(wire.rest)
        reach = abs(size - rest)
        low, high = min(low, rest - reach), max(high, rest + reach)
    return (
        wire,
        low if wire.low is None else max(low, wire.low),
        high if wire.high is None else min(high, wire.high),
    )


def _unexplained(change: Array, slopes: Array, known: Array) -> float:
    """Square of a change that parameters leave, what they stray from earlier logs included."""
    towards = slopes.T @ change
    step = np.linalg.lstsq(slopes.T @ slopes + known, towards, rcond=None)[0]
    return max(float(change @ change - towards @ step), 0.0)
