"""What to measure next: the action that best tells apart what the logs leave open.

An action is a command, a condition that holds meanwhile, and signals that are logged beside those
of the logs so far.  Which conditions a person can set, and which signals measure, the plant
declares (``core.block.Bench``).

Each explanation left predicts the response to an action, with the noise that the logs have.
What parameters can imitate does not count: each explanation in turn is the rig, as it is fitted,
and each other model is re-fitted to what it predicts, as far as the logs so far and the priors let
it.  The search does so linearly, which promises too much; for the actions asked for it is done in
earnest.  An action is worth the probability that it is expected to leave to the right explanation.

Sources: Box, Hill, Technometrics 9 (1967) 57 (experiments that discriminate between models, by the
posterior that they are expected to leave); Atkinson, Fedorov, Biometrika 62 (1975) 57
(T-optimality: the rival re-fitted); de Kleer, Williams, Artificial Intelligence 32 (1987) 97 (the
next measurement by what it costs).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, lru_cache, partial
from itertools import permutations
from pathlib import Path

import numpy as np

from servo_models.analysis.experiment import in_time
from servo_models.analysis.statistics import rms
from servo_models.core.block import Bench
from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array, Mask
from servo_models.data.log import Log
from servo_models.data.sensor import REPEATS, difference_noise, spread_of_repeats
from servo_models.data.tables import write_signals
from servo_models.diagnosis.design.commands import FAMILIES, Command
from servo_models.diagnosis.design.play_script import constants_of, script, script_of
from servo_models.diagnosis.search.crossval import dispersion
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.search.residuals import Residuals, sure
from servo_models.diagnosis.settings import DEFAULT, Settings
from servo_models.errors import UserError
from servo_models.files import write_with
from servo_models.identification.problem import Problem
from servo_models.report.numbers import listed

TELLING = 0.3  # RMS [noise floors] of a difference that tells: less may be a model's inaccuracy
TELLING_ODDS = 100.0  # odds of the right one of two explanations that a log is expected to give
MOST = 6  # explanations, the likeliest, that an action is designed for
MOST_ACTIONS = 3  # actions asked for, each without what those before it need
DECIDED_SHARE = 0.68  # of withheld rigs, on what was asked for: docs/studies/second_log.md
AS_GOOD = 0.05  # expected probability that a cheaper action may lack
SIZES = (1.0, 0.3, 0.1, 0.03)  # sizes over the largest at which the search begins
PACES = (0.06, 0.2, 0.6, 0.02)
"""Paces over the response time at which the search begins: the first where all are as good."""
LENGTH = 1.0  # of an experiment over the response time, or over the longest log
FARTHEST = 10.0  # outputs over the largest that was logged from which a model runs away


# The result


@dataclass(frozen=True, eq=False)
class Experiment:
    """What to do next, and what it is expected to show.

    Attributes:
        explanations: effects of each fitted model that it is designed for, the likeliest first.
        weights: their probabilities among themselves, shape (n,).
        separations: size [noise floors] of what model k, re-fitted, is expected to leave of the log
            if explanation i is the right one, shape (n, n): RMS over time, all outputs squared and
            added.
        told: whether that rules out k, shape (n, n).
        imitated: pairs (i, k) of which explanation k can imitate i whatever is done.
        decides: probability that it is expected to leave to the right explanation.
        seconds: time that it takes, about.
        steps: what to do, then what to expect, a sentence each.
        wire: the input that is played.
        plans: the logs to be, of the same command, in which nothing is measured yet: as the first
            log was, then under each condition.
        floors: noise floor [SI] of each of its outputs.
        file: name of the table with the command, "" while there is none.
    """

    explanations: tuple[tuple[str, ...], ...]
    weights: Array
    separations: Array
    told: Mask
    imitated: tuple[tuple[int, int], ...]
    decides: float
    seconds: float
    steps: tuple[str, ...]
    wire: Wire
    plans: tuple[Log, ...]
    floors: Mapping[str, float]
    file: str = ""

    @property
    def text(self) -> str:
        """All steps at once."""
        return " ".join(self.steps)

    @property
    def times(self) -> Array:
        """[s], shape (n,)."""
        return self.plans[0].times

    @property
    def command(self) -> Array:
        """What is played [SI], shape (n,)."""
        return self.plans[0].inputs[self.wire.name]

    @property
    def instructions(self) -> tuple[str, ...]:
        """The steps, the files in the first."""
        play, *others = self.steps
        if not self.file:
            return self.steps
        return (f"{play} The command is {self.file}; {script_of(self.file)} plays it.", *others)

    @property
    def telling(self) -> bool:
        """Whether it is expected to rule out any of them if another is right."""
        return bool(self.told.any())

    def rules_out(self, model: tuple[str, ...], right: tuple[str, ...]) -> bool:
        """Whether it is expected to rule out an explanation if another is right, by their
        effects."""
        both = model in self.explanations and right in self.explanations
        place = self.explanations.index
        return both and bool(self.told[place(right), place(model)])

    def write(self, folder: Path, outputs: Sequence[Wire]) -> None:
        """Write times and command as ``file`` in a folder, and beside it the script that plays it
        and logs ``outputs``.

        Raises:
            UserError: see ``tables.write_signals``.
        """
        wires = {self.wire.name: self.wire}
        write_signals(folder / self.file, self.times, {self.wire.name: self.command}, wires)
        text = script(self.file, self.wire, outputs, self.plans)
        write_with(folder / script_of(self.file), lambda part: part.write_text(text, "utf-8"))


def is_filled(path: Path) -> bool:
    """Return whether a table holds more than ``Experiment.write`` writes: times and a command."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.readline().count(b",") != 1


def next_experiments(
    rivals: Sequence[FittedModel], weights: Sequence[float], seed: int = 0
) -> tuple[Experiment, ...]:
    """Return the actions that best tell the fitted models left apart, none for fewer than two.

    The first is the cheapest of those that decide as well as any; each other one does without a
    condition or a signal of those before it.  Where nothing tells any of them apart there is one,
    which says so.

    Args:
        rivals: fitted models, the likeliest first.
        weights: their probabilities.
        seed: of what is random in a command.
    """
    if len(rivals) < 2:
        return ()
    designer = ExperimentDesigner(rivals[:MOST], weights[:MOST], seed)
    return tuple(designer.experiment(action) for action in designer.best())


def repeats_wanted(
    left: Residuals, origins: Iterable[str], logs: Sequence[Log], settings: Settings = DEFAULT
) -> str:
    """Return the instruction to repeat a command where only that tells noise from structure, "" for
    none.

    That is where no noise floor comes from repeats, and the part of the errors that is no noise
    is large enough to matter while its lower bound is not.
    """
    large = left.structured > settings.structured_over_noise * left.noise
    if not large or sure(left, settings) or REPEATS in origins:
        return ""
    shortest = min(logs, key=lambda log: log.duration)
    return (
        f"{left.structured:.2g} noise floors of what is left may be noise or not. Play the command"
        f" of log '{shortest.name}' 4 times in one log, each time from rest: what"
        " differs between them is noise."
    )


# What can be done


@dataclass(frozen=True)
class Preparation:
    """What a person does before a log, and what it takes.

    Attributes:
        how: the instruction, "" for nothing.
        seconds: time that it takes.
        values: constants [SI] that hold then, by name; or noise floors [SI] of the outputs that can
            be logged then, if it ``measures``.
    """

    how: str = ""
    seconds: float = 0.0
    values: tuple[tuple[str, float], ...] = ()
    measures: bool = False


@dataclass(frozen=True)
class Play:
    """A command under a condition: one log."""

    command: Command
    condition: Preparation


@dataclass(frozen=True, eq=False)
class Action:
    """What is done, what it leaves and what that is worth, see ``Experiment``.

    Attributes:
        command: what is played, as the first log was and then under each of the conditions.
        needs: conditions and further signals.
    """

    command: Command
    needs: tuple[Preparation, ...]
    separations: Array
    decides: float
    seconds: float


def conditions(plant: Plant, command: str) -> list[Preparation]:
    """Return what a person can set beside the input ``command``."""
    inputs = [
        (bench, wire.name, bench.value * wire.scale)
        for wire in plant.inputs
        if wire.name != command
        for bench in wire.bench
    ]
    effects = [
        (bench, f"{name}.{switch}", 0.0)
        for name in plant.placements
        for main in [plant.main(name)]
        for bench in (*main.bench, *main.effect.hints.bench)
        for switch in main.effect.switches
    ]
    return _together([*inputs, *effects])


def measures(plant: Plant, logged: Container[str]) -> list[Preparation]:
    """Return what a person can measure beside the outputs that are ``logged``."""
    every = [
        (bench, name, bench.value * plant.wire[name].scale)
        for name in plant.outputs
        if name not in logged
        for bench in plant.wire[name].bench
    ]
    return [replace(one, measures=True) for one in _together(every)]


def _together(every: Iterable[tuple[Bench, str, float]]) -> list[Preparation]:
    """Names and values by what is done for them."""
    found: dict[str, Preparation] = {}
    for bench, name, value in every:
        one = found.get(bench.how, Preparation(bench.how, bench.seconds))
        found[bench.how] = replace(one, values=(*one.values, (name, value)))
    return list(found.values())


# The search


class ExperimentDesigner:
    """Where experiments are played: on fitted models, sampled as the logs are.

    Attributes:
        rivals: fitted models that are left, and their ``weights``, shape (n,).
        power: noise [noise floors squared] as the weights count it, so many samples as one
            independent one is worth.
        wire: the input that is played.
        low, high: its limits [SI], those of the logs or of the actuator's standard step.
        fastest: pace that the sampling can follow [s].
        unit: time scale of its paces and its length [s].
        times: sample times of an experiment [s], shape (n,).
        farthest: outputs [noise floors] from which a model runs away.
        measures: what can be logged beside the outputs of the logs.
        sigma: noise floor [SI] of all that is or can be logged.
        conditions: what can be set, that of the first log first.
    """

    def __init__(self, rivals: Sequence[FittedModel], weights: Sequence[float], seed: int) -> None:
        self.rivals = rivals
        self.weights = np.maximum(weights, 1e-6) / np.maximum(weights, 1e-6).sum()
        self.problem = rivals[0].problem
        self.power = rivals[0].settings.temper * max(rivals[0].evidence.dispersion, 1.0)
        self.seed = seed
        self.wire, self.low, self.high = _limits(self.problem)
        step = min(log.interval for log in self.problem.logs)
        self.step = float(f"{step:.9g}")  # a table is read by people
        longest = max(log.duration for log in self.problem.logs)
        self.fastest = 5.0 * self.step  # pace that the sampling can follow
        # where the second pace is too fast, all are made slower
        playable = (1.0 + 1e-9) * self.fastest / PACES[1]
        # whoever made short logs knows how fast the actuator is
        self.unit = max(min(self.problem.model.stop_time, longest), playable)
        count = round(LENGTH * self.unit / self.step)
        self.times = self.step * np.arange(count + 1.0)
        outputs = [(name, log.outputs[name]) for log in self.problem.logs for name in log.outputs]
        largest = max(float(np.abs(it / self.problem.sigma[name]).max()) for name, it in outputs)
        self.farthest = FARTHEST * largest  # a command from which a model runs away is none
        plant = self.problem.model.plant
        self.measures = measures(plant, self.problem.sigma)
        # a signal is expected to be as noisy for its scale as those logged, or worse
        noisy = min(size / plant.wire[name].scale for name, size in self.problem.sigma.items())
        further = {
            name: max(size, noisy * plant.wire[name].scale)
            for it in self.measures
            for name, size in it.values
        }
        self.sigma = {**self.problem.sigma, **further}
        every = conditions(plant, self.wire.name)
        self.conditions = [Preparation(), *(one for one in every if self._differs(one))]
        # what is large is kept while a command is looked at, not for good
        self.response = lru_cache(128)(self._response)
        self.slopes = lru_cache(32)(self._slopes)
        self.change = cache(self._change)

    def _differs(self, condition: Preparation) -> bool:
        """Whether a condition is another one than that of the first log, for any of the rivals."""
        rests = {wire.name: wire.rest for wire in self.problem.model.plant.inputs}
        every = [
            {**rests, **rival.problem.model.values, **rival.values, **self.held}
            for rival in self.rivals
        ]
        return any(one[name] != value for one in every for name, value in condition.values)

    def best(self) -> list[Action]:
        """Return the actions to ask for, at least one."""
        items, asked = [*self.conditions[1:], *self.measures], list[Action]()
        while len(asked) < MOST_ACTIONS:
            action = self._grown(items)
            if not asked:
                action = self.in_earnest(action)
            elif not self.told(action.separations).any():
                break
            asked.append(action)
            if not action.needs:
                break
            items = [one for one in items if one not in action.needs]
        return asked

    def _grown(self, items: Sequence[Preparation]) -> Action:
        """An action with one item more as long as any decides more: the cheapest of those that
        decide as much."""
        action = self.action(())
        while True:
            left = [one for one in items if one not in action.needs]
            more = [self.action((*action.needs, one)) for one in left]
            enough = max((one.decides for one in more), default=0.0) - AS_GOOD
            if enough <= action.decides:
                return action
            action = min((it for it in more if it.decides >= enough), key=lambda it: it.seconds)

    def action(self, needs: tuple[Preparation, ...]) -> Action:
        """Return an action that needs this, with the best command for it."""
        apart = self._all(partial(self.separations, needs=needs), self.commands)
        (most, *_) = self._ranked(apart)
        return self._action(most, needs, apart[most])

    @cached_property
    def commands(self) -> list[Command]:
        """Commands that are tried: those that look best before anything is re-fitted, by what can
        be measured and by what is logged, and the best ladder, which shows all sizes."""
        chosen = []
        for outputs in (tuple(self.sigma), tuple(self.problem.sigma)):
            raw = self._all(partial(self.differences, outputs=outputs), self._allowed(self.grid()))
            chosen.append(self._ranked(raw)[0])
        ladders = {one: it for one, it in raw.items() if one.family == "ladder"}
        return list(dict.fromkeys([*chosen, *self._ranked(ladders)[:1]]))

    def in_earnest(self, action: Action) -> Action:
        """Return an action with its command refined, and what it leaves re-fitted in earnest."""
        near = [action.command, *self._allowed(action.command.nearby(1.5))]
        apart = self._all(partial(self.separations, needs=action.needs), near)
        (most, *_) = self._ranked(apart)
        return self._action(most, action.needs, self.masked(most, action.needs, apart[most]))

    def _action(
        self, command: Command, needs: tuple[Preparation, ...], separations: Array
    ) -> Action:
        logs = [self.plan(play) for play in self.plays(command, needs)]
        seconds = sum(it.seconds for it in needs) + sum(it.settle + it.duration for it in logs)
        return Action(command, needs, separations, self.decides(separations), seconds)

    def plays(self, command: Command, needs: Sequence[Preparation]) -> list[Play]:
        """Return the logs of a command: as the first log was, then under each condition."""
        conditions = [self.conditions[0], *(one for one in needs if not one.measures)]
        return [Play(command, condition) for condition in conditions]

    def outputs(self, needs: Iterable[Preparation]) -> tuple[str, ...]:
        """Return the names of what is logged."""
        further = (name for one in needs if one.measures for name, _ in one.values)
        return (*self.problem.sigma, *further)

    def likelihoods(self, separations: Array) -> Array:
        """Return the log likelihood that a log with these separations [noise floors] is expected to
        take from rival k if rival i is right, shape (n, n)."""
        return np.asarray(len(self.times) * separations**2 / (2.0 * self.power))

    def lost(self, separations: Array) -> Array:
        """Return the same, 0 where a model may be as inaccurate."""
        return np.where(separations >= TELLING, self.likelihoods(separations), 0.0)

    def told(self, separations: Array) -> Mask:
        """Which rivals a log with these separations [noise floors] is expected to tell apart."""
        return np.asarray(self.lost(separations) >= math.log(TELLING_ODDS))

    def decides(self, separations: Array) -> float:
        """Return the probability that is expected to be left to the right rival."""
        left = np.exp(-self.lost(separations)) @ self.weights
        return min(1.0, float(self.weights @ (self.weights / left)))  # 1 but for rounding

    @cached_property
    def imitated(self) -> tuple[tuple[int, int], ...]:
        """The pairs (i, k) in which rival k can imitate i whatever is done."""

        def everything(command: Command) -> Array:
            conditions = (it for it in self.conditions[1:] if self.sound(Play(command, it)))
            return self.separations(command, (*conditions, *self.measures))

        every = self._all(everything, self.commands)
        never = ~np.any([self.told(one) for one in every.values()], axis=0)
        return tuple((i, k) for i, k in permutations(range(len(never)), 2) if never[i, k])

    def grid(self) -> list[Command]:
        """Commands of all families to begin a search with."""
        middle, size = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return [
            Command(family, middle, share * size, pace * self.unit, self.seed)
            for family in FAMILIES
            for share in SIZES
            for pace in PACES
        ]

    def differences(self, command: Command, outputs: Sequence[str]) -> Array:
        """Differences [noise floors] of the rivals as they are, under the condition of the first
        log, see ``Experiment.separations``; 0 where it is not ``sound``."""
        play, n = Play(command, self.conditions[0]), len(self.rivals)
        if not self.sound(play):
            return np.zeros((n, n))
        every = np.array([self.response(i, play) for i in range(n)])[:, self._rows(outputs)]
        squares = np.mean((every[:, None] - every) ** 2, axis=-1)
        return np.asarray(np.sqrt(squares.sum(axis=-1)))

    def _rows(self, outputs: Iterable[str]) -> list[int]:
        return [tuple(self.sigma).index(name) for name in outputs]

    def sound(self, play: Play) -> bool:
        """Return whether all rivals can run and none runs away, and motion does not look like
        noise."""
        every = [self.response(i, play) for i in range(len(self.rivals))]
        logged = np.array(every)[:, : len(self.problem.sigma)]
        if not np.abs(logged).max() <= self.farthest:
            return False
        values = play.command.values(self.times)[:, None]
        noise = (
            max(difference_noise(it), spread_of_repeats(it, values) or 0.0) for it in logged[0]
        )
        # motion that the audit takes for noise of more than half a floor hides what differs
        return max(noise) <= 0.5

    def separations(self, command: Command, needs: Sequence[Preparation]) -> Array:
        """What rival k leaves of rival i, re-fitted linearly [noise floors], see
        ``Experiment.separations``; 0 where a log is not ``sound``."""
        rows, n = self._rows(self.outputs(needs)), len(self.rivals)
        left = np.zeros((n, n))
        plays = self.plays(command, needs)
        if not all(map(self.sound, plays)):
            return left
        for i, k in permutations(range(n), 2):
            every = [[one[rows] for one in self.change(i, k, play)] for play in plays]
            change, towards, slopes = (sum(it.sum(axis=0) for it in one) for one in zip(*every))
            step = np.linalg.lstsq(slopes + self.known[k], towards, rcond=None)[0]
            left[i, k] = max(float(change - towards @ step), 0.0)
        return np.asarray(np.sqrt(left / len(self.times)))

    def _change(self, i: int, k: int, play: Play) -> tuple[Array, Array, Array]:
        """Difference of rig i from model k in one log, of each output: its square, its products
        with the slopes of the model, and their products with each other."""
        change, slopes = self.response(i, play) - self.response(k, play), self.slopes(k, play)
        towards = np.einsum("otp,ot->op", slopes, change)
        return np.sum(change**2, axis=1), towards, np.einsum("otp,otq->opq", slopes, slopes)

    def masked(self, command: Command, needs: Sequence[Preparation], separations: Array) -> Array:
        """The same, re-fitted in earnest where ``separations`` are large enough to matter."""
        left = separations.copy()
        for i, k in zip(*np.nonzero(separations >= TELLING)):
            left[i, k] = min(left[i, k], self._left(command, needs, i, k))
        return left

    def _left(self, command: Command, needs: Sequence[Preparation], rig: int, model: int) -> float:
        """What a model leaves of the response of another one as the rig."""
        plans = []
        for play in self.plays(command, needs):
            response = dict(zip(self.sigma, self.response(rig, play)))
            readings = {name: self.sigma[name] * response[name] for name in self.outputs(needs)}
            plans.append(replace(self.plan(play), outputs=readings))
        problem = played(self.rivals[model], plans, self.sigma)
        left = _residual_after_refit(self.rivals[model], problem, self.known[model])
        return left * math.sqrt(problem.samples / len(self.times))

    @cached_property
    def known(self) -> list[Array]:
        """What logs so far say of each rival's free parameters, each (p, p) per scale."""
        precisions = []
        for rival in self.rivals:
            slopes = rival.problem.jacobian(rival.evidence.vector, rival.widths)
            data, priors = np.split(slopes, [rival.problem.samples])
            coloured = max(dispersion(rival.evidence.errors), 1.0)
            precisions.append(data.T @ data / coloured + priors.T @ priors)
        return precisions

    def _ranked(self, apart: Mapping[Command, Array]) -> list[Command]:
        """Commands, that with the least left to wrong rivals by its separations first."""
        odds = np.log(np.outer(self.weights, self.weights))
        others = ~np.eye(len(odds), dtype=bool)

        def left(command: Command) -> float:
            """Logarithm of the weight that rivals are expected to have in one another's place: it
            also ranks what decides to all digits."""
            weights = (odds - self.likelihoods(apart[command]))[others]
            return round(float(np.logaddexp.reduce(weights)), 6)  # less is rounding

        return sorted(apart, key=left)

    def _all(
        self, measure: Callable[[Command], Array], commands: Sequence[Command]
    ) -> dict[Command, Array]:
        return dict(zip(commands, self.problem.workers.map(measure, commands)))

    def _allowed(self, commands: Iterable[Command]) -> list[Command]:
        """Commands inside the limits that the sampling can follow."""
        largest = 0.5 * (1.0 + 1e-9) * (self.high - self.low)
        slowest = 0.5 * self.times[-1]
        return [c for c in commands if c.size <= largest and self.fastest <= c.pace <= slowest]

    def _response(self, i: int, play: Play) -> Array:
        """Outputs of a rival in noise floors, shape (outputs, n); NaN where it cannot run."""
        problem = played(self.rivals[i], [self.plan(play)], self.sigma)
        try:
            (outputs,) = problem.responses(self.rivals[i].evidence.vector)
        except UserError:
            return np.full((len(self.sigma), len(self.times)), np.nan)
        return np.array([outputs[name] / size for name, size in self.sigma.items()])

    def _slopes(self, i: int, play: Play) -> Array:
        """Slopes of the response per scale of each free parameter, shape (outputs, n, p)."""
        problem = played(self.rivals[i], [self.plan(play)], self.sigma)
        slopes = problem.jacobian(self.rivals[i].evidence.vector, self.rivals[i].widths)
        return slopes[: problem.samples].reshape(len(self.sigma), len(self.times), -1)

    @cached_property
    def held(self) -> dict[str, float]:
        """What held in the first log [SI], other inputs where they were most of the time."""
        first = self.problem.logs[0]
        held = {**first.constants, **{k: float(np.median(v)) for k, v in first.inputs.items()}}
        held.pop(self.wire.name, None)
        return held

    def plan(self, play: Play) -> Log:
        """Return the log of a play before it is played: nothing is measured yet.

        What it does not set is as in the first log.  It begins at rest, as its first row says to
        whoever reads it, or, where the limits or the condition do not allow that, with its first
        row held.
        """
        first, n = self.problem.logs[0], len(self.times)
        rest = float(self.wire.rest)
        held = {**self.held, **dict(play.condition.values)}
        values = play.command.values(self.times)
        at_rest = self.low <= rest <= self.high
        if at_rest:
            values[0] = rest
        inputs = self.problem.model.plant.inputs
        away = (held.get(wire.name, wire.rest) != wire.rest for wire in inputs)
        settle = first.settle
        if not at_rest or any(away):
            settle = max(first.settle, min(self.problem.model.stop_time, float(self.times[-1])))
        return replace(
            first,
            times=self.times,
            inputs={self.wire.name: values},
            constants=held,
            outputs={name: np.zeros(n) for name in self.sigma},
            rows=np.arange(n),
            held_out=np.zeros(n, dtype=bool),
            skipped=None,
            unsure=None,
            begin=0.0,
            settle=settle,
            start=None,
            notes=(),
        )

    def experiment(self, action: Action) -> Experiment:
        """Return an action as it is told."""
        names = self.outputs(action.needs)
        plans = []
        for play in self.plays(action.command, action.needs):
            plan = self.plan(play)
            plans.append(replace(plan, outputs={name: plan.outputs[name] for name in names}))
        designed = Experiment(
            tuple(rival.effects for rival in self.rivals),
            self.weights,
            action.separations,
            self.told(action.separations),
            self.imitated,
            action.decides,
            action.seconds,
            (),
            self.wire,
            tuple(plans),
            {name: self.sigma[name] for name in names},
        )
        return replace(designed, steps=tuple(_steps(self, action, designed)))


def played(rival: FittedModel, plans: Sequence[Log], sigma: Mapping[str, float]) -> Problem:
    """Return the problem of a rival with the logs of an experiment."""
    problem = rival.problem
    return Problem(problem.model, plans, problem.free, sigma=sigma)


def _limits(problem: Problem) -> tuple[Wire, float, float]:
    column, low, high = problem.moving_input
    model = problem.model
    wire = model.plant.inputs[column]
    name, size = model.step
    if name == wire.name:
        rest = float(wire.rest)
        reach = abs(size - rest)
        low, high = min(low, rest - reach), max(high, rest + reach)
    least = -math.inf if wire.low is None else wire.low
    most = math.inf if wire.high is None else wire.high
    return wire, max(low, least), min(high, most)


def _residual_after_refit(rival: FittedModel, problem: Problem, known: Array) -> float:
    """Return the RMS error [noise floors] of a rival on a log, re-fitted to that log.

    Args:
        rival: where it begins, and to stay near which logs so far and priors ask.
        problem: its own with the log that is to be imitated.
        known: what logs so far and priors say of its parameters, shape (p, p) per scale.
    """
    from scipy.optimize import least_squares

    start, (low, high) = rival.evidence.vector, problem.bounds
    room = np.flatnonzero(high > low)
    size, axes = np.linalg.eigh(known)
    root = np.sqrt(np.maximum(size, 0.0))[:, None] * axes.T

    def at(values: Array) -> Array:
        vector = start.copy()
        vector[room] = values
        return vector

    def data(values: Array) -> Array:
        return problem.residuals(at(values))[: problem.samples]

    def errors(values: Array) -> Array:
        return np.concatenate([data(values), root @ (at(values) - start)])

    def slopes(values: Array) -> Array:
        jacobian = problem.jacobian(at(values), rival.widths, room.tolist())[: problem.samples]
        return np.vstack([jacobian, root[:, room]])

    fitted = np.clip(start, low, high)[room]
    if len(room):
        limits = (low[room], high[room])
        fitted = least_squares(errors, fitted, slopes, limits, max_nfev=15).x  # near enough to rank
    return rms(data(fitted))


# In words


def _steps(designer: ExperimentDesigner, action: Action, designed: Experiment) -> Iterator[str]:
    names, (plan, *changed) = designed.explanations, designed.plans
    if designed.telling:
        before = [f"{it.how[0].upper()}{it.how[1:]}." for it in action.needs if it.measures]
        after = [f"Then {it.how} and play it again." for it in action.needs if not it.measures]
        yield " ".join([*before, _command(designer, action, designed), *after])
        if plan.settle:
            yield f"Hold its first value for {in_time(plan.settle)} before a log begins."
        if plan.constants:
            yield f"Meanwhile, as in log '{plan.name}', {constants_of(plan)}."
        for number, other in enumerate(changed, 2):
            yield f"In the description, log {number} has {constants_of(other)}."
        yield (
            f"By these models the right one of {_listed(names)} is then expected to have"
            f" {designed.decides:.0%}; the likeliest has {designed.weights.max():.0%} now. Of"
            f" withheld rigs {DECIDED_SHARE:.0%} ended with the right one alone. Takes about"
            f" {math.ceil(designed.seconds / 60.0)} min."
        )
    else:
        yield (
            "Nothing that can be played, set or measured is sure to tell"
            f" {_listed(names, 'or')} apart."
        )
    yield from _alike(designed)


def _command(designer: ExperimentDesigner, action: Action, designed: Experiment) -> str:
    hertz, duration = 1.0 / designer.step, float(designed.times[-1])
    rate = f"{hertz:.4g} Hz" if hertz < 9999.5 else f"{1e-3 * hertz:.4g} kHz"
    return (
        f"Command {action.command.text(designed.wire, duration)} on {designed.wire.name}"
        f" for {in_time(duration)}, log {listed(designed.floors)} at {rate}."
    )


def _alike(designed: Experiment) -> Iterator[str]:
    """What cannot be told apart, whatever is done."""
    names, pairs = designed.explanations, {*designed.imitated}
    for i, k in designed.imitated:
        if (k, i) not in pairs:
            begin = f"If it is {_names(names[i])}, nothing rules out {_names(names[k])}"
        elif i < k:
            begin = f"Nothing tells {_listed([names[i], names[k]], 'or')} apart"
        else:
            continue
        yield f"{begin}: that choice makes no difference to these outputs."


def _names(effects: Sequence[str]) -> str:
    return " with ".join(effects) or "parameters alone"


def _listed(explanations: Sequence[Sequence[str]], word: str = "and") -> str:
    return listed(map(_names, explanations), word)
