"""What is left outside the catalogue, learnt as a shape.

The term is a sum of curves (``effects.residual_map``) on one wire: the load torque, the drive or
the reading in the loop.  Each curve is of one thing that the actuator does.  What a knot of any
curve would do to the errors is simulated once.  On these slopes every curve is judged by blocks of
time that are held out, so one that is not needed does not come in.  The chosen curves are then
fitted to the whole response, together with all parameters of the diagnosed model.

A map is no evidence for a named effect: it takes any form, so it fits where the effect would.
What the fitted parameters can do as well, such as a straight line of the rate, goes to them.
Sources: Hastie, Tibshirani, Generalized Additive Models, 1990 (additive curves, forward choice);
Eilers, Marx, Statistical Science 11 (1996) 89 (penalty on differences of neighbouring values).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from servo_models.core.plant import Plant
from servo_models.core.types import Array
from servo_models.diagnosis.search.crossval import Judged, blocks, consistency, cross_validate
from servo_models.diagnosis.search.fitting import FittedModel, discontinuous_of
from servo_models.effects.residual_map import CURVES, KNOTS
from servo_models.identification.linear_inference import linearised
from servo_models.identification.optimise import descend
from servo_models.identification.problem import DIFFERENCE, Free, Problem

SIZES = ("torque", "drive", "reading")  # keys of the sizes that say on which wire the map acts
PROBE_IN_FULL_SCALES = 1e-3  # first size of which the response is simulated
PROBE_IN_FLOORS = 1.0  # RMS change of the response by the size over which slopes are taken
LARGEST_PROBE_IN_FULL_SCALES = 0.1  # largest size of which it is simulated
PENALTIES = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""Weights of squared second differences over the mean square of a knot's effect."""
DEPENDENT = 1e-12  # ridge over the square of each slope: slopes that are alike share a step
LEVEL_PENALTY = 1e-3  # weight of first differences over that of second ones: level without data
SMALL_PENALTY = 1e-4  # weight of values over the same: what parameters can do goes to them
LEAST_RANGE = 1e-6  # range of a regressor in full scales below which it does not move
LEAST_GAIN = 0.05  # share of the unseen squared errors that one more curve has to take away
SURE = 0.02  # largest probability of so many blocks in favour by chance
BOTH_SIDES = 0.2  # least reach to either side of 0 over the larger one, for a power to be tried
POWERS = {
    1.0: "grows in proportion to",
    2.0: "grows with the square of",
    3.0: "grows with the cube of",
}
PROPORTION, *BENT = POWERS
WORDS = {
    "rate": "the rate",
    "position": "the position",
    "command": "the command",
    "load": "the load",
    "reversal": "the time since reversal",
}
SIMPLE = 0.97  # share of the variance of a curve from which a simple function is named
LEAST_BEND = 0.005  # share of the variance left by a proportion from which a curve is seen to bend
NOTHING = 0.1  # slope over that of the other side up to which it is none
EQUAL = 0.2  # relative difference of two slopes up to which they are the same
FIT_TOLERANCE = 1e-4  # relative decrease of the cost that ends a fit
FIT_STEPS = 5  # least-squares steps of a fit
KNOT_WIDTH_IN_PROBES = 0.5  # width over which slopes of a fit are taken
FIRST_STEPS = (0.0, 0.25, 0.5, 1.0)  # parts of the linear step, the best of which begins a fit


@dataclass(frozen=True, eq=False)
class Curve:
    """A curve of the map.

    Attributes:
        regressor: what it is of: a key of ``effects.residual_map.CURVES``.
        wire: wire of the regressor.
        knots: its values at the knots [SI], shape (n,).
        values: values of the curve [SI of the wire that the map acts on], shape (n,).
        errors: their standard errors, shape (n,).
        samples: samples nearest to each knot, shape (n,); 0 where no log tells anything.
    """

    regressor: str
    wire: str
    knots: Array
    values: Array
    errors: Array
    samples: NDArray[np.int64]

    def at(self, points: Array) -> Array:
        """Return the curve at some points [SI], held at its ends."""
        return np.interp(points, self.knots, self.values)


@dataclass(frozen=True, eq=False)
class ResidualMap:
    """What was learnt.

    Attributes:
        name: name of the effect that it is.
        size: key of the size that says where it acts, one of ``SIZES``.
        wire: wire on which it acts.
        curves: in the order in which they were taken in.
        fitted: the model with the map and the effects beside it, all fitted together.
        before, after: RMS [noise floors] of errors on unseen blocks as diagnosed and with it.
    """

    name: str
    size: str
    wire: str
    curves: tuple[Curve, ...]
    fitted: FittedModel
    before: float
    after: float

    @property
    def sentence(self) -> str:
        """What it looks like, as a clause: "a torque on 'load' that grows with ..."."""
        kind = {"torque": "a torque on", "drive": "a drive on", "reading": "a reading on"}
        forms = [form(curve) for curve in self.curves]
        return f"{kind[self.size]} '{self.wire}' that {', and '.join(forms)}"

    @cached_property
    def values(self) -> dict[str, float]:
        """Parameters [SI] of the diagnosed model and of the map, by name."""
        largest = max(float(np.abs(curve.values).max()) for curve in self.curves)
        plant = self.fitted.problem.model.plant
        curves = {it.regressor: (it.knots, it.values) for it in self.curves}
        fitted = {n: v for n, v in self.fitted.values.items() if not n.startswith(f"{self.name}.")}
        return fitted | _settings(plant, self.name, self.size, largest, curves)


def form(curve: Curve) -> str:
    """Return in a clause which simple function a curve is, beside a constant.

    Powers with a size of their own on each side are tried first, then a kink.  A higher power has a
    straight line beside it, which parameters may hold.
    """
    seen = curve.samples > 0
    x, y = curve.knots[seen], curve.values[seen]
    weights = np.sqrt(curve.samples[seen])
    scale, of = float(np.abs(x).max()), WORDS[curve.regressor]
    if x.min() < -BOTH_SIDES * scale and x.max() > BOTH_SIDES * scale:
        powers = {power: _power(power, x / scale, y, weights) for power in POWERS}
        best = min(BENT, key=lambda it: powers[it].left)
        freedom = len(x) - 4  # less two sides, a line and a constant
        sure = _surely_less(powers[best].left, powers[PROPORTION].left, freedom)
        for power in (best, PROPORTION) if sure else (PROPORTION, best):
            fit = powers[power]
            if fit.left <= 1.0 - SIMPLE:
                return f"{POWERS[power]} {of}{_one_way(fit.up, fit.down, of)}"
    for bend in x[1:-1]:
        basis = [np.ones(len(x)), x / scale, np.maximum(x - bend, 0.0) / scale]
        (_, before, more), share = _explained(basis, y, weights)
        if share >= SIMPLE:
            if abs(more) < EQUAL * abs(before):
                return f"changes in proportion to {of}"
            return f"has a kink in {of}"
    return f"depends on {of} in no simple way"


class _Power(NamedTuple):
    """Slopes of a power on either side, and the share of the variance that it leaves."""

    up: float
    down: float
    left: float


def _power(power: float, x: Array, y: Array, weights: Array) -> _Power:
    """A power of both sides, beside a constant and, of a higher one, a line."""
    sides = [np.maximum(x, 0.0) ** power, np.maximum(-x, 0.0) ** power]
    line = [] if power == PROPORTION else [x]
    (up, down, *_), share = _explained([*sides, np.ones(len(x)), *line], y, weights)
    return _Power(float(up), -float(down), 1.0 - share)


def _surely_less(left: float, other: float, freedom: int) -> bool:
    """Whether a form leaves less than one of a term less, by an F test, and visibly so."""
    from scipy.special import fdtri

    if freedom < 1 or other < LEAST_BEND:
        return False
    return (other - left) * freedom > left * float(fdtri(1.0, freedom, 1.0 - SURE))


def _one_way(up: float, down: float, of: str) -> str:
    """How far two slopes differ, one for positive values and one for negative ones."""
    strong, weak = max((up, down), key=abs), min((up, down), key=abs)
    side = "positive" if abs(up) > abs(down) else "negative"
    if abs(weak) < NOTHING * abs(strong):
        return f", where that is {side} only"
    if up * down < 0.0:
        return ", the same way whichever its sign"
    if abs(strong) < (1.0 + EQUAL) * abs(weak):
        return ""
    return f", {strong / weak:.2g} times as much where that is {side}"


def _explained(basis: Sequence[Array], y: Array, weights: Array) -> tuple[Array, float]:
    """Coefficients of a weighted fit, and the share of the variance that it explains."""
    columns = np.column_stack(basis)
    coefficients = np.linalg.lstsq(columns * weights[:, None], y * weights, rcond=None)[0]
    left = (y - columns @ coefficients) * weights
    whole = (y - np.average(y, weights=weights**2)) * weights
    return np.asarray(coefficients), 1.0 - float(left @ left) / max(float(whole @ whole), 1e-300)


def learn(taken: FittedModel, retuned: FittedModel | None = None) -> ResidualMap | None:
    """Return what a fitted model leaves, as a residual map.

    It is learnt beside the effects that were taken, or else beside parameters alone: effects none
    of which explains all may stand for a part of what is missing.

    Returns:
        None where no map holds on unseen blocks, one is on, or the plant has no place for it.
    """
    plant = taken.problem.model.plant
    name = next((it for it in plant.placements if plant.main(it).effect.hints.learnt), None)
    if name is None or not (sizes := _sizes(plant, name)):
        return None
    if any(taken.problem.model.values[f"{name}.{it}"] for it in sizes):
        return None
    beside = [taken] if retuned is None or retuned is taken else [taken, retuned]
    maps = (_learnt(base, name, taken) for base in beside)
    return next((learnt for learnt in maps if learnt is not None), None)


def _learnt(base: FittedModel, name: str, taken: FittedModel) -> ResidualMap | None:
    """The best map beside one fitted model, None unless it leaves less than was left."""
    ranges = dict(_ranges(base, name))
    if not ranges:
        return None
    sizes = _sizes(base.problem.model.plant, name)
    best, *others = (_OnWire(base, name, size, ranges).chosen() for size in sizes)
    for other in others:  # a motor makes a torque of its drive: of two alike, it is the torque
        if _better(other, best, LEAST_GAIN):
            best = other
    # what slopes do not promise is not worth a fit
    if not best.curves or not _better(best, taken.evidence, taken.settings.map_closed_share):
        return None
    fitted = best.wire.fitted(best)
    if not _better(fitted.evidence, taken.evidence, taken.settings.map_closed_share):
        return None
    if _held_out(fitted) > _held_out(taken):  # such as motion of another kind
        return None
    return best.wire.told(best.curves, fitted, taken.evidence.rms)


def _held_out(model: FittedModel) -> float:
    """Mean squared error of all readings that the description holds out, 0 where there is none."""
    squares = [it.ravel() for it in model.problem.held_out_squares(model.values)]
    return float(np.mean(every)) if len(every := np.concatenate(squares)) else 0.0


def _better(new: Judged, other: Judged, least: float) -> bool:
    """Whether unseen errors are smaller by a share of their squares at least, and surely."""
    gain = 1.0 - float(new.losses.sum() / other.losses.sum())
    return gain >= least and consistency(new, other) <= SURE


@dataclass(frozen=True, eq=False)
class _Range:
    """Where the logs go in what a curve is of: its wire, its knots [SI] and samples near each."""

    wire: str
    knots: Array
    samples: NDArray[np.int64]


def _ranges(taken: FittedModel, name: str) -> Iterator[tuple[str, _Range]]:
    """Range of every curve of which the logs tell anything, by its key."""
    plant = taken.problem.model.plant
    for link in plant.placements[name]:
        key = next((it for it, block in CURVES.items() if block == link.effect), None)
        if key is None:
            continue
        wire = link.wire_of("regressor")
        # the map is on without a size, so that what it reads is worked out
        on = {**taken.values, f"{name}.{key}": 1.0}
        parts = [run.signal(wire, on)[run.log.fitted] for run in taken.problem.runs]
        values = np.concatenate(parts)
        if np.ptp(values) > LEAST_RANGE * plant.wire[wire].scale:
            knots = np.linspace(values.min(), values.max(), KNOTS)
            nearest = np.abs(values[:, None] - knots).argmin(axis=1)
            yield key, _Range(wire, knots, np.bincount(nearest, minlength=KNOTS))


def _sizes(plant: Plant, name: str) -> list[str]:
    """Those sizes of a map that a plant has: one of its own may lack a drive, say."""
    return [it for it in SIZES if f"{name}.{it}" in plant.parameters]


def _settings(
    plant: Plant,
    name: str,
    size_key: str,
    size: float,
    curves: Mapping[str, tuple[Array, Array]],
) -> dict[str, float]:
    """All parameters [SI] of a map; ``curves`` are knots, and values in the unit of the wire."""
    settings = {f"{name}.{it}": size if it == size_key else 0.0 for it in _sizes(plant, name)}
    for key in CURVES:
        if f"{name}.{key}" in plant.parameters:
            settings[f"{name}.{key}"] = float(key in curves)
    for key, (knots, values) in curves.items():
        settings[f"{name}.{key}_low"] = float(knots[0])
        settings[f"{name}.{key}_high"] = float(knots[-1])
        settings |= dict(zip(_knots(name, key), (values / size).tolist()))
    return settings


def _knots(name: str, key: str) -> list[str]:
    """Parameters of the values at the knots of a curve."""
    return [f"{name}.{key}_knot_{k + 1}" for k in range(KNOTS)]


@dataclass(frozen=True, eq=False)
class _Penalised(Problem):
    """A problem with a penalty among its squared errors.

    Attributes:
        names: parameters with a penalty.
        rows: weights of their values [SI], shape (k, len(names)).
    """

    names: tuple[str, ...] = ()
    rows: Array = field(default_factory=lambda: np.empty((0, 0)))

    def errors_with(self, values: Mapping[str, float], strict: bool = False) -> Array:
        errors = super().errors_with(values, strict)
        return np.concatenate([errors, self.rows @ np.array([values[it] for it in self.names])])


@dataclass(frozen=True, eq=False)
class _Choice:
    """Curves on one wire, their penalty, and how they hold on unseen blocks by slopes alone.

    Attributes:
        losses: squared errors of each block, unseen, shape (blocks,).
        step: linear step of the parameters, and of the knots of these curves in probes.
    """

    wire: _OnWire
    curves: tuple[str, ...]
    penalty: float
    losses: Array
    step: Array


@dataclass(frozen=True, eq=False)
class _OnWire:
    """A wire on which a map may act, with what every knot of every curve would do to the errors."""

    taken: FittedModel
    name: str
    size: str
    ranges: dict[str, _Range]

    @property
    def problem(self) -> Problem:
        return self.taken.problem

    @cached_property
    def full_scale(self) -> float:
        """Largest size [SI]."""
        return self.problem.model.plant.parameters[f"{self.name}.{self.size}"].param.high

    def settings(self, size: float, curves: Mapping[str, Array]) -> dict[str, float]:
        """All parameters [SI] of a map with curves in the unit of the wire."""
        both = {key: (self.ranges[key].knots, values) for key, values in curves.items()}
        return _settings(self.problem.model.plant, self.name, self.size, size, both)

    def change(self, size: float, key: str, knots: Array) -> Array:
        """Change of the errors [noise floors] by a curve of this size, shape (m,)."""
        values = {**self.taken.values, **self.settings(size, {key: size * knots})}
        changed = self.problem.errors_with(values) - self.taken.linearised.errors
        return np.asarray(changed[: self.problem.samples])

    @cached_property
    def probe(self) -> float:
        """Size [SI] that changes the response by about a noise floor."""
        first = PROBE_IN_FULL_SCALES * self.full_scale
        moved = np.sqrt(np.mean(self.change(first, next(iter(self.ranges)), np.ones(KNOTS)) ** 2))
        most = LARGEST_PROBE_IN_FULL_SCALES * self.full_scale
        return min(first * PROBE_IN_FLOORS / max(float(moved), 1e-12), most)

    @cached_property
    def slopes(self) -> dict[str, Array]:
        """What a probe at each knot does to the errors, shape (m, KNOTS), by key."""
        tasks = [(key, unit) for key in self.ranges for unit in np.eye(KNOTS)]
        changes = iter(self.problem.workers.map(lambda it: self.change(self.probe, *it), tasks))
        return {key: np.column_stack([next(changes) for _ in range(KNOTS)]) for key in self.ranges}

    @cached_property
    def blocks(self) -> tuple[Array, Array, Array]:
        """Products of all slopes and the errors in each block: of slopes, shape (blocks, q, q), of
        slopes and errors, (blocks, q), and the squared errors, (blocks,)."""
        n, parts = self.problem.samples, blocks(self.problem)
        old = self.taken.linearised.slopes[:n].copy()
        old[:, discontinuous_of(self.problem)] = 0.0
        slopes, errors = np.hstack([old, *self.slopes.values()]), self.taken.linearised.errors[:n]
        rows = [np.flatnonzero(parts == k) for k in range(int(parts.max()) + 1)]
        gram = np.array([slopes[part].T @ slopes[part] for part in rows])
        towards = np.array([slopes[part].T @ errors[part] for part in rows])
        return gram, towards, np.bincount(parts, errors**2).astype(float)

    def columns(self, keys: Sequence[str]) -> list[int]:
        """Places of the parameters and of the knots of some curves among all slopes."""
        p = self.taken.linearised.slopes.shape[1]
        begins = {key: p + i * KNOTS for i, key in enumerate(self.ranges)}
        return [*range(p), *(begins[key] + k for key in keys for k in range(KNOTS))]

    def penalty_rows(self, keys: Sequence[str], penalty: float) -> Array:
        """Rows the squares of which are the penalty on knots in probes, shape (k, KNOTS * n)."""
        bends, level, small = (np.diff(np.eye(KNOTS), order, axis=0) for order in (2, 1, 0))
        level, small = np.sqrt(LEVEL_PENALTY) * level, np.sqrt(SMALL_PENALTY) * small
        shape = np.vstack([bends, level, small])
        usual = [np.sqrt(penalty * np.sum(self.slopes[key] ** 2) / KNOTS) for key in keys]
        return np.kron(np.diag(usual), shape)

    def judged(self, keys: Sequence[str], penalty: float) -> _Choice:
        """How the model with curves predicts unseen blocks, by one step along slopes."""
        old, n, where = self.taken.linearised, self.problem.samples, self.columns(keys)
        gram, towards, squares = self.blocks
        gram, towards = gram[:, where][:, :, where], towards[:, where]
        p = old.slopes.shape[1]
        known, priors = np.zeros((len(where), len(where))), np.zeros(len(where))
        known[:p, :p] = old.slopes[n:].T @ old.slopes[n:]
        priors[:p] = old.slopes[n:].T @ old.errors[n:]
        rows = self.penalty_rows(keys, penalty)
        known[p:, p:] = rows.T @ rows
        whole = known + gram.sum(axis=0)
        whole += DEPENDENT * np.diag(np.diag(whole) + 1e-30)
        step = -np.linalg.solve(whole, priors + towards.sum(axis=0))
        # each block without itself, from where the step to the least of all has led
        there = towards + gram @ step
        left = squares + (towards + there) @ step
        apart = np.linalg.solve(whole - gram, there[..., None])[..., 0]
        along, size = np.sum(apart * there, axis=1), np.einsum("ki,kij,kj->k", apart, gram, apart)
        part = np.minimum(1.0, np.sqrt(np.maximum(left, 0.0) / np.maximum(size, 1e-300)))
        losses = left + part * (2.0 * along + part * size)
        return _Choice(self, tuple(keys), penalty, losses, step)

    def chosen(self) -> _Choice:
        """The curves that hold best on unseen blocks, taken in one by one."""
        best = self.judged((), 0.0)
        while others := [key for key in self.ranges if key not in best.curves]:
            trials = [self.judged((*best.curves, key), it) for key in others for it in PENALTIES]
            more = min(trials, key=lambda it: float(it.losses.sum()))
            if not _better(more, best, LEAST_GAIN):
                break
            best = more
        return best

    def fitted(self, choice: _Choice) -> FittedModel:
        """The diagnosed model and curves, fitted together to the whole response."""
        keys, penalty, old = choice.curves, choice.penalty, self.taken.linearised
        problem, p, n = self.penalised(keys, penalty), len(old.vector), self.problem.samples
        start = np.concatenate([old.vector, np.zeros(len(choice.step) - p)])
        trials = [np.clip(start + part * choice.step, *problem.bounds) for part in FIRST_STEPS]
        begin = trials[int(np.argmin(problem.costs(trials)))]
        known = np.zeros((len(old.errors) + len(problem.rows), len(start)))
        known[: len(old.errors), :p] = old.slopes
        known[:n, p:] = np.hstack([self.slopes[key] for key in keys])
        known[len(old.errors) :, p:] = self.penalty_rows(keys, penalty)
        usual = np.full(p, DIFFERENCE) if self.taken.widths is None else self.taken.widths
        widths = np.concatenate([usual, np.full(len(begin) - p, KNOT_WIDTH_IN_PROBES)])
        vector, met, slopes = descend(problem, begin, FIT_TOLERANCE, FIT_STEPS, widths, known)
        linear = linearised(problem, vector, widths, slopes)
        evidence = cross_validate(problem, linear, blocks(problem), discontinuous_of(problem))
        effects, settings = self.taken.effects, self.taken.settings
        return FittedModel(effects, problem, linear, evidence, met, 0.0, widths, settings=settings)

    def penalised(self, keys: Sequence[str], penalty: float) -> _Penalised:
        """The problem of that fit; its knots may go up to full scale."""
        old, size = self.problem, self.full_scale
        unit = self.probe / size
        names = [knot for key in keys for knot in _knots(self.name, key)]
        settings = self.settings(size, {key: np.zeros(KNOTS) for key in keys})
        free = [*old.free, *(Free(it, -1.0, 1.0, 0.0, unit, 0.0) for it in names)]
        return _Penalised(
            replace(old.model, values={**old.model.values, **settings}),
            old.logs,
            free,
            old.sigma,
            old.workers,
            np.concatenate([self.taken.linearised.vector, np.zeros(len(names))]),
            old.steps,
            names=tuple(names),
            rows=self.penalty_rows(keys, penalty) / unit,
        )

    def told(self, keys: Sequence[str], fitted: FittedModel, before: float) -> ResidualMap:
        """The map in SI, beside what was left ``before`` it [RMS, noise floors].

        Every curve but the first one is 0 on average, as only sums are known.
        """
        problem = fitted.problem
        size = problem.model.values[f"{self.name}.{self.size}"]
        slopes = fitted.linearised.slopes / problem.scales
        spread = fitted.evidence.dispersion * np.linalg.pinv(slopes.T @ slopes, hermitian=True)
        errors = dict(zip(fitted.values, np.sqrt(np.diag(spread))))
        curves, shift = [], 0.0
        for key in keys:
            range_, names = self.ranges[key], _knots(self.name, key)
            values = size * np.array([fitted.values[it] for it in names])
            deviations = size * np.array([errors[it] for it in names])
            curves.append(Curve(key, range_.wire, range_.knots, values, deviations, range_.samples))
        for i, curve in enumerate(curves[1:], 1):
            mean = float(np.average(curve.values, weights=curve.samples))
            curves[i], shift = replace(curve, values=curve.values - mean), shift + mean
        curves[0] = replace(curves[0], values=curves[0].values + shift)
        links = self.problem.model.plant.placements[self.name]
        wire = next(link.on[0] for link in links if self.size in link.effect.params)
        after = fitted.evidence.rms
        return ResidualMap(self.name, self.size, wire, tuple(curves), fitted, before, after)
