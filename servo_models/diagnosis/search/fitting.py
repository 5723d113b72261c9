"""A fit with some effects switched on, and the fitter that makes such fits.

Nominal parameters stay free inside their priors in every fit, since a wrong value that is held
fixed looks like an effect.  Parameters that no slope leads to, such as a quantum or a delay before
a hold, are moved by trial beside the least squares.  Where the model itself has a quantiser or a
hold, its smooth twin gives one more start: the rough response has dents in which a fit ends.

A fit is judged by blocks of time, and by conditions, that are held out: what merely imitates the
cause fits each condition with a size in between.
Source: Roberts et al., Ecography 40 (2017) 913 (blocks as the structure of the data has them).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from servo_models.core.block import DeadTime, Hints
from servo_models.core.plant import Parameter
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.core.workers import ALONE, Workers
from servo_models.data.clock import ROUNDING
from servo_models.data.log import Log
from servo_models.diagnosis.search.crossval import CrossValidation, blocks, cross_validate
from servo_models.diagnosis.search.residuals import Residuals, residuals_of
from servo_models.diagnosis.settings import DEFAULT, Settings
from servo_models.identification.linear_inference import (
    Linearisation,
    Spread,
    factors,
    linearised,
    spread,
)
from servo_models.identification.optimise import along_valley, as_believed, descend, steps
from servo_models.identification.problem import (
    DIFFERENCE,
    Free,
    Problem,
    discontinuous,
    log_determinant,
)
from servo_models.identification.resolution import (
    BLAMED,
    ROW,
    Blur,
    blurs,
    could_carry,
    with_unsure_inputs,
)
from servo_models.identification.simulation import InternalSteps

WIDER = "wider priors"  # a cause beside the effects: a prior that was too narrow
FINAL_TOLERANCE = 1e-7  # cost tolerance of a fit that is reported
FINAL_STEPS = 60  # least-squares steps of such a fit
HOPELESS_RATIO = 1.5  # cost over what a fit has to reach from which it gets no other start
COARSE_WIDTH_IN_SCALES = 0.02  # width of slopes where an effect makes the response jump
COARSE_RELATIVE_WIDTH = 0.01  # width of the slope along a discontinuous parameter
WIDE_RELATIVE_CHANGES = (0.02, 0.01)  # changes of a discontinuous parameter before a search
NARROW_RELATIVE_CHANGES = (0.005, 0.0025, 0.0012, 0.0006, 0.0003)  # changes after it
JUMP_OVER_RANGE = 0.2  # jump between samples of a reading above which delays are tried one by one
DELAY_MOVES_IN_SAMPLES = (0.5, 1.0, 1.5, 2.5, 4.0)  # moves of the delay before such a reading
DELAY_MOVES_IN_PERIODS = (1 / 64, 1 / 32, 1 / 16, 1 / 8, 1 / 4, 1.0, 2.0)
"""Moves of a delay before a hold: one tick off passes for friction or inertia."""
MOVED_COST_OVER_COST = 0.98  # cost after a move over before, below which it is taken
MOST_MOVES = 8  # moves of delays in one fit
FAR_IN_DEVIATIONS = 1.0  # believed deviations from which a fitted parameter is put back once
FAR_LESS = 0.5  # structured part over that before, below which commands between rows are tried
INWARD = {"low": 1.0, "high": -1.0}  # sign of the way off a bound


def discontinuous_of(problem: Problem) -> list[int]:
    """Which free parameters are discontinuous: the response jumps with them."""
    return [
        i
        for i, free, parameter, hints in _of_effects(problem)
        if hints.grid and parameter.param.switch and free.prior is None
    ]


def begins_with_jump(problem: Problem) -> bool:
    """Whether effects begin with a part of a jump: small changes then move where it comes by a
    sample, or not at all."""
    return any(
        free.start > 0.0 and parameter.key == hints.jump
        for _, free, parameter, hints in _of_effects(problem)
    )


def _of_effects(problem: Problem) -> Iterator[tuple[int, Free, Parameter, Hints]]:
    """Free parameters of effects: which, as what they were declared, and what is known of them."""
    plant = problem.model.plant
    for i, free in enumerate(problem.free):
        parameter = plant.parameters[free.name]
        if parameter.owner:
            yield i, free, parameter, plant.main(parameter.owner).effect.hints


def others_first(
    problem: Problem,
    vector: Array,
    stepwise: Sequence[int],
    widths: Array | None,
    tolerance: float,
    limit: int,
) -> Array:
    """Least squares by the other parameters alone, see ``descend``."""
    others = [i for i in range(len(vector)) if i not in stepwise]
    values = problem.values(vector)
    sizes = {name: values[name] for name in (problem.free[i].name for i in stepwise)}
    model = replace(problem.model, values={**problem.model.values, **sizes})
    free = [problem.free[i] for i in others]
    rest = replace(problem, model=model, free=free, start=vector[others])
    fitted = vector.copy()
    other_widths = None if widths is None else widths[others]
    fitted[others], _, _ = descend(rest, vector[others], tolerance, limit, other_widths)
    return fitted


def past_an_edge(
    problem: Problem, vector: Array, widths: Array | None, tolerance: float, limit: int
) -> Array | None:
    """Return a vector with other parameters fitted while delays stay, where they are or on the next
    stair, if that is surely better.

    Where a reading jumps, a search ends on the edge of a stair: each step that moves the delay as
    well falls off it, and the others would go on.
    """
    delays, samples = delays_of(problem), _jumping(problem)
    if not delays or not samples or len(delays) == len(vector):
        return None
    tried = []
    for move in (0.0, *(half * sample for sample in samples for half in (-0.5, 0.5))):
        begin = vector.copy()
        begin[delays] += move / problem.scales[delays]
        begin = np.clip(begin, *problem.bounds)
        tried.append(others_first(problem, begin, delays, widths, tolerance, limit))
    return _surely_better(problem, vector, tried)


def _surely_better(problem: Problem, vector: Array, trials: Sequence[Array]) -> Array | None:
    """The best of some trials, None where none is surely better than a vector."""
    before, *after = problem.costs([vector, *trials])
    return trials[int(np.argmin(after))] if min(after) < MOVED_COST_OVER_COST * before else None


def sharpened(
    problem: Problem,
    vector: Array,
    stepwise: Sequence[int],
    widths: Array | None,
    spans: Iterable[float],
) -> Array:
    """Try nearby sizes, ever nearer; other parameters follow each by their slopes."""
    others = [i for i in range(len(vector)) if i not in stepwise]
    low, high = problem.bounds
    slopes = problem.jacobian(vector, widths)[:, others]
    inverse = np.linalg.pinv(slopes, rcond=1e-6)
    best, least = vector, problem.costs([vector])[0]
    for span in spans:
        trials = []
        for i in stepwise:
            for factor in (1.0 - span, 1.0 + span):
                trial = best.copy()
                trial[i] *= factor
                followed = trial.copy()
                followed[others] -= inverse @ problem.residuals(trial)
                trials += [trial, np.clip(followed, low, high)]
        costs = problem.costs(trials)
        if min(costs) < least:
            best, least = trials[int(np.argmin(costs))], min(costs)
    return best


def shifted(problem: Problem, vector: Array) -> Array | None:
    """Return a vector with a delay moved by a few samples, or by parts of the period of a hold, if
    that is surely better.

    Where a reading jumps with the command, the cost falls by a stair a sample: it is flat
    between two of them, and no slope leads on.  Before a hold, every edge of the command waits for
    the next tick, and the response jumps with the delay too.
    """
    moves = [it * sample for sample in _jumping(problem) for it in DELAY_MOVES_IN_SAMPLES]
    moves += [it * period for period in _periods(problem, vector) for it in DELAY_MOVES_IN_PERIODS]
    trials = []
    for i in delays_of(problem):
        for move in (sign * it for it in moves if it for sign in (-1.0, 1.0)):
            trial = vector.copy()
            trial[i] += move / problem.free[i].scale
            trials.append(np.clip(trial, *problem.bounds))
    return _surely_better(problem, vector, trials) if trials else None


def delays_of(problem: Problem) -> list[int]:
    """Which free parameters are times of a transport delay."""
    return [
        i
        for i, _, parameter, hints in _of_effects(problem)
        if isinstance(hints.small_signal, DeadTime) and parameter.key == hints.small_signal.time
    ]


def _periods(problem: Problem, vector: Array) -> list[float]:
    """Periods [s] of the holds that are on."""
    plant = problem.model.plant
    values = {**problem.model.values, **problem.values(vector)}
    places = [plant.main(name) for name in plant.placements]
    periods = [values[it.switch] for it in places if it.effect.hints.signature == "clock"]
    return [period for period in periods if period > 0.0]


def _jumping(problem: Problem) -> list[float]:
    """Sampling intervals [s] of readings that jump, those once that only rounding tells apart."""
    intervals: list[float] = []
    for log in problem.logs:
        for values in log.outputs.values():
            change = np.max(np.abs(np.diff(values)), initial=0.0)
            known = any(abs(log.interval - it) <= ROUNDING * it for it in intervals)
            if change > JUMP_OVER_RANGE * np.ptp(values) > 0.0 and not known:
                intervals.append(log.interval)
    return intervals


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A fit with some effects switched on.

    Attributes:
        effects: their names, none for nominal parameters alone.
        problem: problem with all free parameters.
        linearised: errors and slopes at the fit.
        evidence: cross-validation of the fit.
        converged: whether the search met its tolerance.
        chance: logarithm of how many trials its effects are the best of, and of how strange
            their sizes and the nominal parameters are.
        widths: widths over which its slopes are taken, see ``optimise.steps``.
        searched: ``problem`` with the internal steps of the search, where it was told anew.
        settings: those of the diagnosis.
    """

    effects: tuple[str, ...]
    problem: Problem
    linearised: Linearisation
    evidence: CrossValidation
    converged: bool
    chance: float
    widths: Array | None = None
    searched: Problem | None = None
    settings: Settings = DEFAULT

    @property
    def values(self) -> dict[str, float]:
        """Free parameters [SI] by name."""
        return self.problem.values(self.evidence.vector)

    @property
    def nominal(self) -> tuple[Free, ...]:
        """Nominal parameters, with the priors that it has of them."""
        return tuple(free for free in self.problem.free if free.prior is not None)

    @property
    def own(self) -> list[Free]:
        """Free parameters of its effects."""
        return [free for free in self.problem.free if free.prior is None]

    @cached_property
    def held_by_bound(self) -> bool:
        """Whether a bound holds a parameter of an effect from a better fit: what it imitates may
        be another effect.  One that merely lies there, since the logs do not show it, is none."""
        sides, slopes = self.problem.sides(self.evidence.vector), self.linearised.slopes
        beyond = self.settings.bound_advantage * self.evidence.dispersion
        for i, free in enumerate(self.problem.free):
            if sides[i] and free.prior is None:
                slope = factors(np.delete(slopes, i, axis=1)).without(slopes[:, i])
                outward = INWARD[sides[i]] * float(slope @ self.linearised.errors)
                if outward > 0.0 and outward**2 > beyond * float(slope @ slope):
                    return True
        return False

    @cached_property
    def spread(self) -> Spread:
        """The uncertainty of its free parameters; slopes with longer steps tell as much."""
        return spread(self.searched or self.problem, self.evidence.vector)

    @property
    def together(self) -> tuple[tuple[str, ...], ...]:
        """Names of free parameters that the logs show only together."""
        names = [free.name for free in self.problem.free]
        groups = self.spread.groups if names else ()
        return tuple(tuple(names[i] for i in group) for group in groups)

    @cached_property
    def left(self) -> Residuals:
        """What the errors that it leaves consist of."""
        return residuals_of(self.problem, self.evidence)

    @property
    def settled(self) -> bool:
        """Whether what is left is noise."""
        return self.left.structured < self.settings.settled_over_noise * self.left.noise

    @property
    def widened(self) -> bool:
        """Whether priors of nominal parameters are wider than what is believed."""
        return any(free.widened > 1.0 for free in self.problem.free)

    @property
    def causes(self) -> tuple[str, ...]:
        """Its effects, and ``WIDER`` where it believes less."""
        return (WIDER, *self.effects) if self.widened else self.effects

    def without(self, name: str) -> tuple[tuple[str, ...], list[Free]]:
        """Return its effects without one, and their free parameters."""
        kept = [free for free in self.own if free.name.rpartition(".")[0] != name]
        return tuple(it for it in self.effects if it != name), kept

    @property
    def cost(self) -> float:
        """Sum of squared errors, priors included, that the fit leaves."""
        return float(self.linearised.errors @ self.linearised.errors)

    @property
    def deviance(self) -> float:
        """Twice minus the logarithm of its likelihood, but for a constant; what it costs to be
        unsure of inputs is in it."""
        return self.cost + log_determinant(self.problem.logs, self.problem.sigma)

    @cached_property
    def loss(self) -> float:
        """Sum of squared unseen errors, larger for an effect on its bound or of a richer shape.

        The best of many trials explains a little by chance: twice their logarithm, as the
        largest of so many squares of normal numbers is.  Look-alikes are told apart by how
        usual their sizes are.
        """
        factor = self.settings.loss_factor_on_bound if self.held_by_bound else 1.0
        squared = float(self.evidence.losses.sum()) * factor
        return squared + (2.0 * self.chance + shape_cost(self)) * self.evidence.dispersion


def shape_cost(model: FittedModel) -> float:
    """Return twice the log likelihood that parameters of effects beside their sizes have to earn:
    of laws that do as well the simplest is taken.

    One inside its bounds has to earn what fitting noise with it would (Schwarz, Annals of
    Statistics 6 (1978) 461).  A term that is 0 is not there.  On another bound a law is on its way
    to a simpler one.
    """
    problem, evidence = model.problem, model.evidence
    sides, cost = problem.sides(evidence.vector), 0.0
    for i, free, parameter, hints in _of_effects(problem):
        absent = sides[i] == "low" and free.low == 0.0
        if free.prior is None and not free.switch and not absent:
            edge = sides[i] and parameter.key != hints.jump
            cost += model.settings.entry_advantage if edge else np.log(evidence.independent)
    return float(cost)


@dataclass(frozen=True, eq=False)
class Fitter:
    """What every fit of a diagnosis shares.

    Attributes:
        model, logs: of the diagnosis.
        nominal: parameters with a prior, free in every fit.
        wide: these parameters with wider priors.
        floors: noise floor [SI] of each output, its weight.
        workers: processes that simulate.
        rough: widths of slopes of the nominal parameters in scales, by name;
            none where small differences will do.
        smooth: switches of quantisers and holds that the model has on, turned off: where these make
            the response rough, a fit of this smooth twin is one more start.
        smooth_rough: ``rough`` of the twin.
        trials: natural logarithm of the sizes and shapes that each effect may have.
        steps: choose the internal step of every run; None for the model's own.
        settings: those of the diagnosis.
        between_rows: commands may have come any time before the rows that have them.
    """

    model: Model
    logs: Sequence[Log]
    nominal: tuple[Free, ...]
    floors: dict[str, float]
    workers: Workers = ALONE
    rough: dict[str, float] = field(default_factory=dict)
    smooth: dict[str, float] = field(default_factory=dict)
    smooth_rough: dict[str, float] = field(default_factory=dict)
    trials: dict[str, float] = field(default_factory=dict)
    steps: InternalSteps | None = None
    settings: Settings = DEFAULT
    wide: tuple[Free, ...] = ()
    between_rows: bool = False

    def problem(self, extra: Iterable[Free] = ()) -> Problem:
        """Return the question with further free parameters."""
        free = [*self.nominal, *extra]
        return Problem(self.model, self.logs, free, self.floors, self.workers, steps=self.steps)

    def widened(self, model: FittedModel) -> Fitter | None:
        """Return a fitter with wider priors of the parameters that a fit drives far from what is
        believed, or onto a bound; None where there are none."""
        sides, values = model.problem.sides(model.evidence.vector), model.values
        far = {
            free.name
            for free, side in zip(model.problem.free, sides)
            if side or abs(free.moved(values[free.name])) > self.settings.far_deviations
        }
        nominal = tuple(
            wide if now.name in far and (wide.low, wide.high) != (now.low, now.high) else now
            for now, wide in zip(self.nominal, self.wide)
        )
        return None if nominal in ((), self.nominal) else replace(self, nominal=nominal)

    def with_unsure_inputs(self, model: FittedModel) -> Fitter:
        """Return a fitter whose logs know what a fitted model makes of what nobody knows of their
        inputs."""
        told = (self.model, self.logs, model.values, self.floors)
        return replace(self, logs=with_unsure_inputs(*told, self.between_rows))

    def blurs(self, model: FittedModel) -> tuple[Blur, ...]:
        """Return what nobody knows of columns does to the outputs of a fitted model."""
        return blurs(self.model, self.logs, self.floors, model.values, self.workers)

    def unsure_between_rows(
        self, models: Iterable[FittedModel], best: FittedModel
    ) -> Fitter | None:
        """Return a fitter by which commands may have come any time before the rows that have them,
        if that could carry much of what one of some fitted models leaves, which then leaves far
        less than the ``best`` one and is surely likelier; None else."""
        likeliest = best.deviance - self.settings.entry_advantage
        least = FAR_LESS * best.left.structured
        for model in dict.fromkeys(models):
            if could_carry(self.blurs(model), self.logs)[ROW] < BLAMED * model.left.structured:
                continue
            unsure = replace(self, between_rows=True).with_unsure_inputs(model).surveyed()
            again = unsure.fit_from(model)
            if again.left.structured < least and again.deviance < likeliest:
                return unsure
        return None

    def surveyed(self) -> Fitter:
        """Return a fitter that knows where the response of the nominal model is rough."""
        rough, smooth = self._rough(), discontinuous(self.model)
        if not rough or not smooth:
            return replace(self, rough=rough)
        twin = replace(self, smooth=smooth)._twin()
        return replace(self, rough=rough, smooth=smooth, smooth_rough=twin._rough())

    def _rough(self) -> dict[str, float]:
        problem = self.problem()
        widths = steps(problem, problem.start) if problem.free else None
        return {} if widths is None else dict(zip(problem.values(widths), widths.tolist()))

    def _twin(self) -> Fitter:
        """The same about a model without quantisers and holds."""
        model = replace(self.model, values={**self.model.values, **self.smooth})
        return replace(self, model=model, rough=self.smooth_rough, smooth={})

    def widths(self, problem: Problem) -> Array | None:
        """Return over which slopes of a problem are taken, shape (p,); None for small ones."""
        stepwise = discontinuous_of(problem)
        coarse = bool(stepwise) or begins_with_jump(problem)
        if not self.rough and not coarse:
            return None
        other = COARSE_WIDTH_IN_SCALES if coarse else max(self.rough.values())
        widths = [max(other, self.rough.get(free.name, DIFFERENCE)) for free in problem.free]
        for i in stepwise:
            widths[i] = COARSE_RELATIVE_WIDTH * problem.free[i].start / problem.free[i].scale
        return np.array(widths)

    def fit(
        self,
        effects: tuple[str, ...],
        extra: Sequence[Free],
        start: Mapping[str, float] | None = None,
        known: Array | None = None,
        limit: int | None = None,
        enough: float = np.inf,
    ) -> FittedModel:
        """Fit from a start [SI by name]; what it does not name begins with its own.

        ``known`` are slopes near there, shape (m, k), of the first k parameters; ``limit`` is that
        of steps, by default ``fit_steps``; a fit that cannot leave ``enough`` squared errors ends
        early.
        """
        problem = self.problem(extra)
        if not problem.free:
            return self._judged(effects, problem, problem.start, converged=True)
        begin = [(start or {}).get(free.name, free.start) for free in problem.free]
        vector = np.array(begin) / problem.scales
        tolerance, limit = self.settings.fit_tolerance, limit or self.settings.fit_steps
        ended = self._descend(problem, vector, tolerance, limit, known, enough)
        fitted = self._judged(effects, problem, *ended)
        if not self.smooth or fitted.settled or fitted.cost > HOPELESS_RATIO * enough:
            return fitted
        twin = self._twin()
        same = twin.problem(problem.free[len(self.nominal) :])
        end, _, _ = twin._descend(same, vector, tolerance, self.settings.fit_steps)
        other = self._descend(problem, end, tolerance, limit, enough=enough)
        return min(fitted, self._judged(effects, problem, *other), key=lambda it: it.cost)

    def at_values(
        self, effects: tuple[str, ...], extra: Sequence[Free], values: Mapping[str, float]
    ) -> FittedModel:
        """Return a fitted model with these values [SI], as it is."""
        problem = self.problem(extra)
        vector = np.array([values[free.name] for free in problem.free]) / problem.scales
        return self._judged(effects, problem, vector, converged=False)

    def unfitted(self) -> FittedModel:
        """Return the nominal model as it is: no fit, so that everything is unseen."""
        problem = self.problem()
        errors = problem.residuals(problem.nominal)
        linear = Linearisation(problem, problem.nominal, errors, np.empty((len(errors), 0)))
        data = errors[: problem.samples]
        evidence = CrossValidation(problem.nominal, data, data, blocks(problem))
        return FittedModel(
            (), problem, linear, evidence, converged=True, chance=0.0, settings=self.settings
        )

    def fit_from(self, model: FittedModel) -> FittedModel:
        """Fit a model that another fitter made to the end, from its values."""
        return self.finish(self.fit(model.effects, model.own, model.values))

    def put_back(self, model: FittedModel) -> FittedModel:
        """Put each nominal parameter that a fit has driven far back once; the others follow.

        A limit of acceleration may have taken the place of one of speed: no slope leads back.
        """
        best = model
        for free in model.nominal:
            if abs(free.moved(best.values[free.name])) > FAR_IN_DEVIATIONS:
                back = {**best.values, free.name: free.nominal}
                again = self.fit(model.effects, model.own, back)
                if again.cost < MOVED_COST_OVER_COST * best.cost:
                    best = self.finish(again)
        return best

    def refit(self, model: FittedModel) -> FittedModel:
        """Fit once more from where a fit has ended."""
        limits = self.settings.fit_tolerance, self.settings.fit_steps
        ended = self._descend(model.problem, model.evidence.vector, *limits)
        return self._judged(model.effects, model.problem, *ended)

    def finish(self, model: FittedModel, told: bool = False) -> FittedModel:
        """Fit to the end: what the logs leave open goes back to its prior, and where values are
        ``told``, what they know only as a product as well."""
        problem, begin = model.problem, model.evidence.vector
        if not problem.free:
            return model
        vector, met, _ = self._descend(problem, begin, FINAL_TOLERANCE, FINAL_STEPS)
        vector, ended, slopes = along_valley(problem, vector, self.widths(problem))
        settled = as_believed(problem, vector) if told else vector
        there = slopes if settled is vector else None
        return self._judged(model.effects, problem, settled, met or ended, there)

    def refit_at_model_step(self, model: FittedModel, fit: bool = True) -> FittedModel:
        """Fit to the end with the model's own internal step, so that no value or error that is told
        hangs on another one; without ``fit`` the values stay."""
        at_model_step = replace(model, problem=replace(model.problem, steps=None))
        plain, vector = replace(self, steps=None), model.evidence.vector
        if fit:
            ended = plain.finish(at_model_step, told=True)
        else:
            ended = plain._judged(model.effects, at_model_step.problem, vector, model.converged)
        return replace(ended, searched=model.problem)

    def _judged(
        self,
        effects: tuple[str, ...],
        problem: Problem,
        vector: Array,
        converged: bool,
        slopes: Array | None = None,
    ) -> FittedModel:
        widths = self.widths(problem)
        linear = linearised(problem, vector, widths, slopes)
        held = [*discontinuous_of(problem), *_pressed(linear)]
        evidence = cross_validate(problem, linear, blocks(problem), held)
        chance = sum(self.trials.get(name, 0.0) for name in effects)
        chance += _strangeness(problem, vector)
        # of two that do as well, the one that believes what is believed is taken
        widened = any(free.widened > 1.0 for free in problem.free)
        chance += 0.5 * self.settings.entry_advantage if widened else 0.0
        return FittedModel(
            effects, problem, linear, evidence, converged, chance, widths, settings=self.settings
        )

    def _descend(
        self,
        problem: Problem,
        start: Array,
        tolerance: float,
        limit: int,
        known: Array | None = None,
        enough: float = np.inf,
    ) -> tuple[Array, bool, Array | None]:
        """Least squares; discontinuous parameters are tried out beside it.

        They stay until the other parameters are where such a size needs them: before, a wrong
        one may leave less.
        """
        widths, stepwise = self.widths(problem), discontinuous_of(problem)
        vector = np.clip(start, *problem.bounds)
        if stepwise:
            assert widths is not None  # a discontinuous parameter has no small slopes
            vector = others_first(problem, vector, stepwise, widths, tolerance, limit)
            vector = sharpened(problem, vector, stepwise, widths, WIDE_RELATIVE_CHANGES)
            known = None
        vector, met, slopes = descend(problem, vector, tolerance, limit, widths, known, enough)
        for _ in range(MOST_MOVES):
            moved = shifted(problem, vector)
            if moved is None:
                moved = past_an_edge(problem, vector, widths, tolerance, limit)
            if moved is None:
                break
            vector, met, slopes = descend(problem, moved, tolerance, limit, widths, enough=enough)
        if stepwise:
            return sharpened(problem, vector, stepwise, widths, NARROW_RELATIVE_CHANGES), met, None
        return vector, met, slopes


def _pressed(linear: Linearisation) -> list[int]:
    """Which parameters a bound holds from a better fit: without a block it would hold them too."""
    sides, gradient = linear.problem.sides(linear.vector), linear.slopes.T @ linear.errors
    return [i for i, side in enumerate(sides) if side and INWARD[side] * gradient[i] > 0.0]


def _strangeness(problem: Problem, vector: Array) -> float:
    """How far nominal parameters are from their nominal values, and sizes of effects from typical
    ones: minus the logarithm of a probability.

    Of a size a factor of ten is one standard deviation, so this only decides between look-alikes.
    An effect that imitates the cause often strains the parameters, which the cause itself does not.
    """
    total, plant = 0.0, problem.model.plant
    for free, value in zip(problem.free, vector * problem.scales):
        if free.prior is not None:
            total += 0.5 * ((value - free.nominal) / free.prior) ** 2 + np.log(free.widened)
    for name, value in problem.values(vector).items():
        param = plant.parameters[name].param
        is_size = plant.parameters[name].owner and param.switch and param.typical > 0.0
        if is_size and problem.model.values[name] == 0.0 and value != 0.0:
            total += 0.5 * (np.log(abs(value) / param.typical) / np.log(10.0)) ** 2
    return float(total)


def conditions(logs: Sequence[Log]) -> list[list[Log]]:
    """Return the logs with fitted samples by what their constants are."""
    groups: dict[tuple[tuple[str, float], ...], list[Log]] = {}
    for log in logs:
        if log.fitted.any():
            groups.setdefault(tuple(sorted(log.constants.items())), []).append(log)
    return list(groups.values())


def leave_one_condition_out(fitter: Fitter, model: FittedModel) -> float:
    """Return the squared errors of each condition by fits to the others, begun where one ended.

    0 where there are fewer than ``least_conditions``, so that nothing speaks for or against it.
    """
    groups = conditions(fitter.logs)
    if len(groups) < fitter.settings.least_conditions:
        return 0.0
    extra, lost = model.own, 0.0
    for group in groups:
        rest = [log for other in groups if other is not group for log in other]
        fitted = replace(fitter, logs=rest).fit(model.effects, extra, model.values)
        unseen = replace(fitter, logs=group).problem(extra)
        errors = unseen.residuals(fitted.evidence.vector)[: unseen.samples]
        lost += float(errors @ errors)
    return lost
