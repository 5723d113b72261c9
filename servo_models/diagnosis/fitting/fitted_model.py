"""A fit with some effects switched on, and the fitter that makes such fits.

Nominal parameters stay free inside their priors in every fit, since a wrong value that is held
fixed looks like an effect.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.core.workers import ALONE, Workers
from servo_models.data.log import Log
from servo_models.diagnosis.fitting.crossval import CrossValidation, blocks, cross_validate
from servo_models.diagnosis.fitting.descent import descend
from servo_models.diagnosis.fitting.discontinuous import (
    MOST_MOVES,
    NARROW_RELATIVE_CHANGES,
    WIDE_RELATIVE_CHANGES,
    begins_with_jump,
    discontinuous_of,
    others_first,
    past_an_edge,
    sharpened,
    shifted,
    turned,
)
from servo_models.diagnosis.fitting.linearisation import Linearisation, linearised
from servo_models.diagnosis.fitting.residuals import Residuals, residuals_of
from servo_models.identification.optimise import steps
from servo_models.identification.problem import DIFFERENCE, Free, Problem
from servo_models.identification.uncertainty import Spread, spread

ENOUGH, STEPS = 1e-4, 25
"""Relative tolerance and steps of a fit: differences between effects are larger."""
EXACT, PATIENT = 1e-7, 60
"""Those of the fit that is reported."""
DISGUISE = 1.25
"""Factor on the squared errors that an effect on its bound leaves."""
PRESSED = 9.0
"""Twice the log likelihood ratio that a step over a bound promises, from which it holds a fit."""
COARSE, GRAIN = 0.02, 0.01
"""Widths of slopes where an effect makes a staircase of the response, or a jump in it: of the
parameters in scales, and of a stepwise size relative to it."""


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A fit with some effects switched on.

    Attributes:
        effects: their names, none for nominal parameters alone.
        problem: with all free parameters.
        view: errors and slopes at the fit.
        evidence: how it predicts.
        converged: whether the search met its tolerance.
        chance: logarithm of how many trials its effects are the best of, and of how strange
            their sizes and the nominal parameters are.
        widths: over which slopes of it mean something, see ``slopes.steps``.
    """

    effects: tuple[str, ...]
    problem: Problem
    linearised: Linearisation
    evidence: CrossValidation
    converged: bool
    chance: float
    widths: Array | None = None

    @property
    def values(self) -> dict[str, float]:
        """Free parameters [SI] by name."""
        return self.problem.values(self.evidence.vector)

    @cached_property
    def disguised(self) -> bool:
        """Whether a bound holds a parameter of an effect from a better fit: what it imitates may
        be another effect.  One that merely lies there, since the logs do not show it, is none."""
        sides, slopes = self.problem.sides(self.evidence.vector), self.linearised.slopes
        for i, free in enumerate(self.problem.free):
            if sides[i] and free.prior is None:
                others = np.delete(slopes, i, axis=1)
                own = slopes[:, i] - others @ np.linalg.lstsq(others, slopes[:, i], rcond=1e-9)[0]
                outward = float(own @ self.linearised.errors) * (1.0 if sides[i] == "low" else -1.0)
                least = PRESSED * self.evidence.dispersion * float(own @ own)
                if outward > 0.0 and outward**2 > least:
                    return True
        return False

    @cached_property
    def spread(self) -> Spread:
        """The uncertainty of its free parameters."""
        return spread(self.problem, self.evidence.vector)

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
    def cost(self) -> float:
        """Sum of squared errors, priors included, that the fit leaves."""
        return float(self.linearised.errors @ self.linearised.errors)

    @cached_property
    def loss(self) -> float:
        """Sum of squared unseen errors, larger for a disguise, which yields to a plain effect.

        The best of many trials explains a little by chance: twice their logarithm, as the
        largest of so many squares of normal numbers is.  Look-alikes are told apart by how
        usual their sizes are.
        """
        seen = float(self.evidence.losses.sum()) * (DISGUISE if self.disguised else 1.0)
        return seen + 2.0 * self.chance * self.evidence.dispersion


@dataclass(frozen=True, eq=False)
class Fitter:
    """What every fit of a diagnosis shares.

    Attributes:
        model, logs: of the diagnosis.
        nominal: parameters with a prior, free in every fit.
        floors: noise floor [SI] of each output, its weight.
        workers: on which simulations go on together.
        rough: over which slopes of the nominal parameters mean something, in scales, by name;
            none where small differences will do.
        trials: natural logarithm of the sizes and shapes that each effect may have.
    """

    model: Model
    logs: Sequence[Log]
    nominal: tuple[Free, ...]
    floors: dict[str, float]
    workers: Workers = ALONE
    rough: dict[str, float] = field(default_factory=dict)
    trials: dict[str, float] = field(default_factory=dict)

    def problem(self, extra: Iterable[Free] = ()) -> Problem:
        """Return the question with further free parameters."""
        free = [*self.nominal, *extra]
        return Problem(self.model, self.logs, free, sigma=dict(self.floors), workers=self.workers)

    def surveyed(self) -> Fitter:
        """Return a fitter that knows where the response of the nominal model is rough."""
        problem = self.problem()
        found = steps(problem, problem.start) if problem.free else None
        names = [free.name for free in self.nominal]
        return self if found is None else replace(self, rough=dict(zip(names, found.tolist())))

    def widths(self, problem: Problem) -> Array | None:
        """Return over which slopes of a problem are taken, shape (p,); None for small ones."""
        stepwise = discontinuous_of(problem)
        coarse = bool(stepwise) or begins_with_jump(problem)
        if not self.rough and not coarse:
            return None
        other = COARSE if coarse else max(self.rough.values())
        widths = [max(other, self.rough.get(free.name, DIFFERENCE)) for free in problem.free]
        for i in stepwise:
            widths[i] = GRAIN * problem.free[i].start / problem.free[i].scale
        return np.array(widths)

    def fit(
        self,
        effects: tuple[str, ...],
        extra: Sequence[Free],
        start: Mapping[str, float] | None = None,
        known: Array | None = None,
        limit: int = STEPS,
    ) -> FittedModel:
        """Fit from a start [SI by name]; what it does not name begins with its own.

        ``known`` are slopes near there, shape (m, k), of the first k parameters; ``limit`` is that
        of steps.
        """
        problem = self.problem(extra)
        if not problem.free:
            return self._judged(effects, problem, problem.start, converged=True)
        begin = [(start or {}).get(free.name, free.start) for free in problem.free]
        vector = np.array(begin) / problem.scales
        return self._judged(effects, problem, *self._descend(problem, vector, ENOUGH, limit, known))

    def unfit(
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
        seen = Linearisation(problem, problem.nominal, errors, np.empty((len(errors), 0)))
        own = errors[: problem.samples]
        evidence = CrossValidation(problem.nominal, own, own, blocks(problem))
        return FittedModel((), problem, seen, evidence, converged=True, chance=0.0)

    def again(
        self, found: FittedModel, tolerance: float = ENOUGH, limit: int = STEPS
    ) -> FittedModel:
        """Fit once more from where a fit has ended."""
        problem = found.problem
        ended = self._descend(problem, found.evidence.vector, tolerance, limit)
        return self._judged(found.effects, problem, *ended)

    def finish(self, found: FittedModel) -> FittedModel:
        """Fit to the end: what the logs leave open goes back to its prior."""
        return self.again(found, EXACT, PATIENT) if found.problem.free else found

    def _judged(
        self,
        effects: tuple[str, ...],
        problem: Problem,
        vector: Array,
        converged: bool,
        slopes: Array | None = None,
    ) -> FittedModel:
        widths = self.widths(problem)
        seen = linearised(problem, vector, widths, slopes)
        held = [*discontinuous_of(problem), *_pressed(seen)]
        evidence = cross_validate(problem, seen, blocks(problem), held)
        chance = sum(self.trials.get(name, 0.0) for name in effects)
        chance += _strangeness(problem, vector)
        return FittedModel(effects, problem, seen, evidence, converged, chance, widths)

    def _descend(
        self,
        problem: Problem,
        start: Array,
        tolerance: float,
        limit: int,
        known: Array | None = None,
    ) -> tuple[Array, bool, Array | None]:
        """Least squares; sizes on which the response is a staircase are tried out beside it.

        They stay until the other parameters are where such a size needs them: before, a wrong
        one may leave less.
        """
        widths, stepwise = self.widths(problem), discontinuous_of(problem)
        vector = np.clip(start, *problem.bounds)
        if stepwise:
            assert widths is not None  # a staircase has no small slopes
            vector = others_first(problem, vector, stepwise, widths, tolerance, limit)
            vector, known = (
                sharpened(problem, vector, stepwise, widths, WIDE_RELATIVE_CHANGES),
                None,
            )
        vector, met, slopes = descend(problem, vector, tolerance, limit, widths, known)
        for _ in range(MOST_MOVES):
            moved = shifted(problem, vector)
            if moved is None:
                moved = past_an_edge(problem, vector, widths, tolerance, limit)
            if moved is None:
                break
            vector, met, slopes = descend(problem, moved, tolerance, limit, widths)
        onward = turned(problem, vector)
        if onward is not None:
            vector, met, slopes = descend(problem, onward, tolerance, limit, widths)
        if stepwise:
            return sharpened(problem, vector, stepwise, widths, NARROW_RELATIVE_CHANGES), met, None
        return vector, met, slopes


def _pressed(seen: Linearisation) -> list[int]:
    """Which parameters a bound holds from a better fit: without a block it would hold them too."""
    sides, gradient = seen.problem.sides(seen.vector), seen.slopes.T @ seen.errors
    inward = {"low": 1.0, "high": -1.0}
    return [i for i, side in enumerate(sides) if side and inward[side] * gradient[i] > 0.0]


def _strangeness(problem: Problem, vector: Array) -> float:
    """How far nominal parameters are from their nominal values, and sizes of effects from typical
    ones: minus the logarithm of a probability.

    Of a size a factor of ten is one standard deviation, so this only decides between look-alikes.
    An effect that imitates the cause often strains the parameters, which the cause itself does not.
    """
    found, plant = 0.0, problem.model.plant
    for free, value in zip(problem.free, vector * problem.scales):
        if free.prior is not None:
            found += 0.5 * ((value - free.nominal) / free.prior) ** 2
    for name, value in problem.values(vector).items():
        param = plant.parameters[name].param
        own = plant.parameters[name].owner and param.switch and param.typical > 0.0
        if own and problem.model.values[name] == 0.0 and value != 0.0:
            found += 0.5 * (np.log(abs(value) / param.typical) / np.log(10.0)) ** 2
    return float(found)
