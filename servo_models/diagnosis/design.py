"""The discriminating experiment: the command that best tells apart what the logs leave open.

Each explanation left predicts the response to a command, with the noise that the logs have.
The command sought is the one for which these predictive distributions have the largest quadratic
Jensen-Renyi divergence: it counts all explanations, by their weights, and is bounded, so that
two which are far apart already do not outweigh two which are not.

What parameters can imitate does not count: each explanation in turn is the rig, as it is fitted,
and each other model is re-fitted to what it predicts, as far as the logs so far and the priors let
it.  The search does so linearly, which promises too much; of the best few commands it is done in
earnest.

Sources: Olofsson, Hebing, Niedenfuehr, Deisenroth, Misener, Computers & Chemical Engineering 125
(2019) 54 (this divergence to design experiments that discriminate between models); Wang,
Syeda-Mahmood, Vemuri, Beymer, Rangarajan, MICCAI (2009) 648 (its closed form for Gaussians);
Atkinson, Fedorov, Biometrika 62 (1975) 57 (T-optimality: the rival re-fitted); Ljung, System
Identification, 2nd ed., sec. 13.3 (sweeps and random binary signals).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import combinations
from pathlib import Path

import numpy as np

from servo_models.analysis.experiment import display, in_time
from servo_models.analysis.explain import display_unit, in_display_unit
from servo_models.analysis.isolability import cause, experiment
from servo_models.analysis.statistics import rms
from servo_models.core.plant import Plant, Wire
from servo_models.core.types import Array, Mask
from servo_models.data.log import Log
from servo_models.data.sensor import REPEATS, difference_noise, spread_of_repeats
from servo_models.data.tables import write_signals
from servo_models.diagnosis.search.crossval import dispersion
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.search.residuals import Residuals, sure
from servo_models.diagnosis.settings import DEFAULT, Settings
from servo_models.errors import UserError
from servo_models.identification.problem import Problem
from servo_models.report.numbers import listed

TELLING = 0.3  # RMS [noise floors] of a difference that tells: less may be a model's inaccuracy
TELLING_ODDS = 100.0  # odds of the right one of two explanations that a log is expected to give
MOST = 6  # explanations, the likeliest, that a command is designed for
SIZES = (1.0, 0.3, 0.1, 0.03)  # sizes over the largest at which the search begins
PACES = (0.02, 0.06, 0.2, 0.6)  # paces over the response time at which the search begins
SMALLEST = 0.02  # least step of a ladder over its largest


# The result


@dataclass(frozen=True, eq=False)
class Experiment:
    """A command to play next, and what it is expected to show.

    Attributes:
        explanations: effects of each fitted model that it is designed for, the likeliest first.
        weights: their probabilities among themselves, shape (n,).
        separations: RMS [noise floors] that model k, re-fitted, is expected to leave of the log if
            explanation i is the right one, shape (n, n).
        told: whether that rules out k, shape (n, n).
        steps: what to do, then what to expect, a sentence each.
        wire: the input that is played.
        plan: the log to be, in which nothing is measured yet.
        file: name of the table with the command, "" while there is none.
    """

    explanations: tuple[tuple[str, ...], ...]
    weights: Array
    separations: Array
    told: Mask
    steps: tuple[str, ...]
    wire: Wire
    plan: Log
    file: str = ""

    @property
    def text(self) -> str:
        """All steps at once."""
        return " ".join(self.steps)

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
    def instructions(self) -> tuple[str, ...]:
        """The steps, the table to play in the first."""
        play, *others = self.steps
        return (f"{play} Its table is {self.file}." if self.file else play, *others)

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


def next_experiments(
    rivals: Sequence[FittedModel], weights: Sequence[float], seed: int = 0
) -> tuple[Experiment, ...]:
    """Return the command that best tells the fitted models left apart, none for fewer than two;
    the likeliest first, ``weights`` their probabilities."""
    if len(rivals) < 2:
        return ()
    designer = ExperimentDesigner(rivals[:MOST], weights[:MOST], seed)
    separations, command = designer.best()
    designed = Experiment(
        tuple(rival.effects for rival in designer.rivals),
        designer.weights,
        separations,
        designer.told(separations),
        (),
        designer.wire,
        designer.plan(command),
    )
    return (replace(designed, steps=tuple(_steps(designer, command, designed))),)


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


# Commands


@dataclass(frozen=True)
class Command:
    """A command within its limits.

    Attributes:
        family: name in ``FAMILIES``.
        middle, size: [SI of the input]; it stays within middle +- size.
        pace: [s], what it means is up to the family.
        seed: seed of what is random in it.
    """

    family: str
    middle: float
    size: float
    pace: float
    seed: int

    def values(self, times: Array) -> Array:
        """The command [SI] at ``times`` [s] from 0, shape (n,)."""
        random = np.random.default_rng(self.seed)
        return self.middle + self.size * FAMILIES[self.family].shape(times, self.pace, random)

    def text(self, wire: Wire, duration: float) -> str:
        """Say what is played on a wire for ``duration`` [s]."""
        scale, unit = display(wire)

        def level(value: float) -> str:
            return f"{scale * value:.4g} {unit}".rstrip()

        return FAMILIES[self.family].about.format(
            middle=level(self.middle),
            low=level(self.middle - self.size),
            high=level(self.middle + self.size),
            size=level(self.size),
            least=level(SMALLEST * self.size),
            pace=in_time(self.pace),
            slow=in_time(4.0 * self.pace),
            own=f"{0.25 / self.pace:.3g} Hz",
            first=f"{1.0 / duration:.3g} Hz",
            last=f"{1.0 / self.pace:.3g} Hz",
        )

    def nearby(self, ratio: float) -> Iterator[Command]:
        """Commands of the same family that are larger, smaller, faster or slower by ``ratio``."""
        for factor in (ratio, 1.0 / ratio):
            yield replace(self, size=self.size * factor)
            yield replace(self, pace=self.pace * factor)


def _ladder(times: Array, pace: float, random: np.random.Generator) -> Array:
    """Steps to both sides and back to the middle, growing until the end."""
    count = np.floor(times / pace)
    last = max(float(count[-1]), 1.0)
    side = np.array([0.0, 1.0, 0.0, -1.0])[count.astype(int) % 4]
    return np.asarray(side * SMALLEST ** (1.0 - count / last))


def _triangle(times: Array, pace: float, random: np.random.Generator) -> Array:
    """A triangle, ``pace`` from zero to its top."""
    return np.asarray(2.0 / np.pi * np.arcsin(np.sin(0.5 * np.pi * times / pace)))


def _chirp(times: Array, pace: float, random: np.random.Generator) -> Array:
    """A sine from one period over the whole length to a last period of ``pace``."""
    length = times[-1]
    growth = np.log(max(length / pace, 1.01))
    return np.asarray(np.sin(2.0 * np.pi * np.expm1(growth * times / length) / growth))


def _random(times: Array, pace: float, random: np.random.Generator) -> Array:
    """Either limit at random, kept for ``pace``."""
    count = np.floor(times / pace).astype(int)
    return np.asarray(random.choice([-1.0, 1.0], count[-1] + 1)[count])


def _bursts(times: Array, pace: float, random: np.random.Generator) -> Array:
    """Steps back to back for the first half, then the same steps four times as far apart."""
    half = 0.5 * times[-1]
    phase = np.where(times < half, times / pace, (times - half) / (4.0 * pace))
    return np.where(np.floor(phase).astype(int) % 2 == 0, 1.0, -1.0)


@dataclass(frozen=True)
class Family:
    """A shape over time, from times [s], pace [s] and a random generator; and it in words."""

    shape: Callable[[Array, float, np.random.Generator], Array]
    about: str


FAMILIES = {
    "ladder": Family(
        _ladder,
        "steps from {middle} to both sides and back, growing from {least} to {size}, {pace} each",
    ),
    "triangle": Family(_triangle, "a triangle of {size} amplitude about {middle} at {own}"),
    "chirp": Family(
        _chirp, "a sine of {size} amplitude about {middle} that sweeps from {first} to {last}"
    ),
    "random": Family(_random, "jumps between {low} and {high} at random, every {pace} at most"),
    "bursts": Family(
        _bursts,
        "steps between {low} and {high} every {pace}, and in the second half every {slow}",
    ),
}


# The criterion


def confusion(weights: Array, squares: Array, power: float) -> float:
    """Return the logarithm of what different Gaussians of one covariance have in common.

    It falls as the quadratic Jensen-Renyi divergence ``-log(sum(w_i w_k c_ik))`` grows, with
    ``c_ik = exp(-squares_ik / (4 power))``, also where that is at its bound to all digits.

    Args:
        weights: weights of the Gaussians, shape (n,), their sum 1.
        squares: squared distance of any two means, shape (n, n); where those of a pair are not the
            same, what they have in common is the mean of both.
        power: variance in every direction.
    """
    common = np.log(np.outer(weights, weights)) - squares / (4.0 * power)
    return float(np.logaddexp.reduce(common[~np.eye(len(weights), dtype=bool)]))


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
        # where the slowest pace is too fast, all are made slower
        playable = (1.0 + 1e-9) * self.fastest / PACES[-1]
        # whoever made short logs knows how fast the actuator is
        self.unit = max(min(self.problem.model.stop_time, longest), playable)
        count = round(5.0 * self.unit / self.step)
        self.times = self.step * np.arange(count + 1.0)
        self.samples = len(self.times) * len(self.problem.sigma)
        outputs = [(name, log.outputs[name]) for log in self.problem.logs for name in log.outputs]
        largest = max(float(np.abs(it / self.problem.sigma[name]).max()) for name, it in outputs)
        self.farthest = 1000.0 * largest  # a command from which a model runs away is no experiment
        self.response = cache(self._response)
        self.slopes = cache(self._slopes)

    def best(self) -> tuple[Array, Command]:
        """Return the best command, and the separations [noise floors] of the rivals, (n, n)."""
        first = self._allowed(self.grid())
        raw = self._all(self.differences, first)
        families = [[c for c in first if c.family == family] for family in FAMILIES]
        # the two of each family that look best before anything is re-fitted
        shortlist = [c for commands in families for c in self._ranked(commands, raw)[:2]]
        separations = self._all(self.separations, shortlist)
        for ratio in (1.8, 1.35):  # steps of size and pace around the best one
            (most, *_) = self._ranked(separations, separations)
            further = [c for c in self._allowed(most.nearby(ratio)) if c not in separations]
            separations |= self._all(self.separations, further)
        likely = self._ranked(separations, separations)[:3]  # each is re-fitted in earnest
        tried = {command: self.masked(command, separations[command]) for command in likely}
        (most, *_) = self._ranked(tried, tried)
        return tried[most], most

    def told(self, separations: Array) -> Mask:
        """Which rivals a log with these separations [noise floors] is expected to tell apart."""
        expected = self.samples * separations**2 / (2.0 * self.power)
        return (separations >= TELLING) & (expected >= math.log(TELLING_ODDS))

    def grid(self) -> list[Command]:
        """Commands of all families to begin a search with."""
        middle, size = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        return [
            Command(family, middle, share * size, pace * self.unit, self.seed)
            for family in FAMILIES
            for share in SIZES
            for pace in PACES
        ]

    def differences(self, command: Command) -> Array:
        """RMS differences [noise floors] of the rivals as they are, shape (n, n).

        They are 0 where any of them cannot run or runs away, and where motion looks like noise.
        """
        responses = [self.response(i, command) for i in range(len(self.rivals))]
        sound = all(np.abs(response).max() <= self.farthest for response in responses)
        # motion that the audit takes for noise of more than half a floor hides what differs
        if not sound or self._noise(responses[0], command) > 0.5:
            return np.zeros((len(responses), len(responses)))
        every = np.array(responses)
        return np.asarray(np.sqrt(np.mean((every[:, None] - every) ** 2, axis=2)))

    def _noise(self, response: Array, command: Command) -> float:
        """Largest apparent noise [noise floors] of a clean response."""
        values = command.values(self.times)[:, None]
        parts = np.split(response, len(self.problem.sigma))
        return max(
            max(difference_noise(part), spread_of_repeats(part, values) or 0.0) for part in parts
        )

    def separations(self, command: Command) -> Array:
        """RMS [noise floors] that rival k leaves of the response of rival i, re-fitted linearly,
        shape (n, n)."""
        apart = self.differences(command)
        for i, k in zip(*np.nonzero(apart)):
            change = self.response(i, command) - self.response(k, command)
            left = _unexplained(change, self.slopes(k, command), self.known[k])
            apart[i, k] = math.sqrt(left / len(change))
        return apart

    def masked(self, command: Command, separations: Array) -> Array:
        """The same, re-fitted in earnest where ``separations`` are large enough to matter."""
        left = separations.copy()
        for i, k in zip(*np.nonzero(separations >= TELLING)):
            left[i, k] = min(left[i, k], self._left(command, i, k))
        return left

    def _left(self, command: Command, rig: int, model: int) -> float:
        """What a model leaves of the response of another one as the rig."""
        plan, names = self.plan(command), list(self.problem.sigma)
        parts = np.split(self.response(rig, command), len(names))
        outputs = {name: self.problem.sigma[name] * part for name, part in zip(names, parts)}
        problem = played(self.rivals[model], replace(plan, outputs=outputs))
        return _residual_after_refit(self.rivals[model], problem, self.known[model])

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

    def _ranked(self, commands: Iterable[Command], apart: Mapping[Command, Array]) -> list[Command]:
        """Commands, that with the largest divergence of its separations first."""

        def common(command: Command) -> float:
            return confusion(self.weights, self.samples * apart[command] ** 2, self.power)

        return sorted(commands, key=common)

    def _all(
        self, measure: Callable[[Command], Array], commands: Sequence[Command]
    ) -> dict[Command, Array]:
        return dict(zip(commands, self.problem.workers.map(measure, commands)))

    def _allowed(self, commands: Iterable[Command]) -> list[Command]:
        """Commands inside the limits that the sampling can follow."""
        largest = 0.5 * (1.0 + 1e-9) * (self.high - self.low)
        slowest = 0.5 * self.times[-1]
        return [c for c in commands if c.size <= largest and self.fastest <= c.pace <= slowest]

    def _response(self, i: int, command: Command) -> Array:
        """Outputs of a rival in noise floors, one after the other, shape (m,); NaN where it cannot
        run."""
        problem = played(self.rivals[i], self.plan(command))
        try:
            (outputs,) = problem.responses(self.rivals[i].evidence.vector)
        except UserError:
            return np.array([np.nan])
        return np.concatenate([values / problem.sigma[name] for name, values in outputs.items()])

    def _slopes(self, i: int, command: Command) -> Array:
        """Slopes of the response per scale of each free parameter, shape (m, p)."""
        problem = played(self.rivals[i], self.plan(command))
        slopes = problem.jacobian(self.rivals[i].evidence.vector, self.rivals[i].widths)
        return slopes[: problem.samples]

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
            unsure=None,
            begin=0.0,
            settle=0.0 if rests else max(first.settle, self.problem.model.stop_time),
            start=None,
            notes=(),
        )


def played(rival: FittedModel, plan: Log) -> Problem:
    """Return the problem of a rival with the log of an experiment."""
    problem = rival.problem
    return Problem(problem.model, [plan], problem.free, sigma=problem.sigma)


def _limits(problem: Problem) -> tuple[Wire, float, float]:
    column, low, high = problem.moving_input
    model = problem.model
    wire = model.plant.inputs[column]
    name, size = model.actuator.step
    if name == wire.name:
        rest = float(wire.rest)
        reach = abs(size - rest)
        low, high = min(low, rest - reach), max(high, rest + reach)
    least = -math.inf if wire.low is None else wire.low
    most = math.inf if wire.high is None else wire.high
    return wire, max(low, least), min(high, most)


def _unexplained(change: Array, slopes: Array, known: Array) -> float:
    """Square of a change that parameters leave, what they stray from earlier logs included."""
    towards = slopes.T @ change
    step = np.linalg.lstsq(slopes.T @ slopes + known, towards, rcond=None)[0]
    return max(float(change @ change - towards @ step), 0.0)


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


def _steps(designer: ExperimentDesigner, command: Command, designed: Experiment) -> Iterator[str]:
    plant, plan = designer.problem.model.plant, designed.plan
    duration = float(designer.times[-1])
    hertz = 1.0 / designer.step
    rate = f"{hertz:.4g} Hz" if hertz < 9999.5 else f"{1e-3 * hertz:.4g} kHz"
    played_ = (
        f"ommand {command.text(designer.wire, duration)} on {designer.wire.name} for"
        f" {in_time(duration)}, log {' and '.join(designer.problem.sigma)} at {rate}."
    )
    if designed.telling:
        yield f"C{played_}"
    else:
        yield (
            "No command that was tried inside the limits tells"
            f" {_listed(designed.explanations, 'or')} apart. At best, c{played_}"
        )
    if plan.settle:
        yield f"Hold its first value for {in_time(plan.settle)} before the log begins."
    if plan.constants:
        yield f"Meanwhile {_held(plant, plan.constants)}, as in log '{plan.name}'."
    yield from _predicted(designer, command)
    if designed.telling:
        yield from _expected(designed)
    else:
        most = _few(float(designed.separations.max()))
        yield f"Re-fitted to what another predicts, none would leave more than {most} noise floors."
    known = _on_record(plant, designed)
    if known:
        yield f"What else separates them: {known}."


def _predicted(designer: ExperimentDesigner, command: Command) -> Iterator[str]:
    """What each explanation predicts of the first output."""
    (output, floor), *_ = designer.problem.sigma.items()
    scale, unit = display(designer.problem.model.plant.wire[output])
    ranges: dict[str, list[tuple[str, ...]]] = {}
    for i, rival in enumerate(designer.rivals):
        response = designer.response(i, command)
        if np.isfinite(response).all():
            values = scale * floor * response[: len(designer.times)]
            text = f"from {values.min():.4g} to {values.max():.4g} {unit}".rstrip()
            ranges.setdefault(text, []).append(rival.effects)
    parts = [f"{text} with {_listed(who, 'or')}" for text, who in ranges.items()]
    yield f"Predicted {output}: {', '.join(parts)}."


def _expected(designed: Experiment) -> Iterator[str]:
    """What is expected to be left if either explanation is the right one."""
    every = range(len(designed.explanations))
    for i in every:
        gone = [k for k in every if designed.told[i, k]]
        stay = [designed.explanations[k] for k in every if k != i and k not in gone]
        clauses = []
        if gone:
            least = _few(min(designed.separations[i, k] for k in gone))
            clauses.append(
                f"re-fitted, {_listed([designed.explanations[k] for k in gone])} leave"
                f"{'s' * (len(gone) == 1)} {least} noise floors{' or more' * (len(gone) > 1)}"
            )
        if stay:
            clauses.append(f"{_listed(stay)} can still imitate it")
        yield f"If the cause is {_names(designed.explanations[i])}: {'; '.join(clauses)}."


def _few(size: float) -> str:
    """Two figures, but never a power of ten for what a person can read without."""
    return f"{size:.2g}" if size < 99.5 else f"{size:.0f}"


def _names(effects: Sequence[str]) -> str:
    return " with ".join(effects) or "parameters alone"


def _listed(explanations: Sequence[Sequence[str]], word: str = "and") -> str:
    return listed(map(_names, explanations), word)


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


def _on_record(plant: Plant, designed: Experiment) -> str:
    """What is known to separate effects of explanations that stay together."""
    texts = [
        experiment(cause(a, plant), cause(b, plant), plant)
        for i, k in combinations(range(len(designed.explanations)), 2)
        if not (designed.told[i, k] and designed.told[k, i])
        for a in designed.explanations[i]
        for b in designed.explanations[k]
        if a not in designed.explanations[k] and b not in designed.explanations[i]
    ]
    return "; ".join(dict.fromkeys(filter(None, texts)))
