"""The question of a fit: which parameters are free, what their priors are, which logs count.

Every log is simulated from its own inputs, controller included, and the difference to each
measured output is weighted by one standard deviation per output.
Source: Ljung, System Identification, 2nd ed., sec. 3.3 (output error) and 7.4 (priors).
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from threading import Lock
from weakref import ref

import numpy as np
from cachetools import LRUCache, cached

from servo_models.core.plant import Parameter, Plant, unknown
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.core.workers import ALONE, Workers
from servo_models.data.description import Description
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.simulation import InternalSteps, Run, prepared

DIFFERENCE = 1e-4  # step of a difference quotient in scales: between curvature and rounding
EDGE = 1e-6  # distance from a bound, in scales and relative to the value, that counts as on it
REFUSED = 1e3  # weighted residual of a run that fails, over the range if that is more than 1
LARGEST = 1e100  # weighted residual from which squares leave the finite numbers


FAR_DEVIATIONS = 3.0  # prior deviations of a fitted parameter from which its prior was too narrow
WIDER_PRIOR = 10.0  # factor on such a prior
LEAST_SINGULAR = 0.3  # weighted errors by a standard deviation of a direction, least: less is noise
PRIOR_BOUND_SIGMAS = 4.0  # prior deviations that a nominal parameter may move


@dataclass(frozen=True)
class Free:
    """A parameter to be estimated, all figures in SI.

    Attributes:
        name: of the parameter.
        low, high: bounds.
        start: nominal value; a switch that is off starts at its typical size instead, since
            many effects have no slope at 0.
        scale: size of a change that matters; the search sees value / scale.
        nominal: value of the model before the fit.
        prior: standard deviation of ``nominal``, or None.
        switch: at 0 it takes its effect away.
        widened: times that ``prior`` is wider than what is believed.
    """

    name: str
    low: float
    high: float
    start: float
    scale: float
    nominal: float
    prior: float | None = None
    switch: bool = False
    widened: float = 1.0

    @property
    def believed(self) -> float | None:
        """Standard deviation of ``nominal`` before it was widened, None for none."""
        return self.prior / self.widened if self.prior else None

    def moved(self, value: float) -> float:
        """How far a value [SI] is from the nominal one, in believed deviations; 0 without one."""
        return (value - self.nominal) / self.believed if self.believed else 0.0


def free_parameter(
    parameter: Parameter,
    nominal: float,
    prior: float | None,
    bounds: tuple[float, float] | None = None,
) -> Free:
    """Return a free parameter with a scale and a start that suit it; values in SI.

    Its bounds are the actuator's unless others are given.
    """
    param = parameter.param
    low, high = bounds or (param.low, param.high)
    off = nominal == 0.0 and param.switch
    size = abs(nominal) or abs(param.typical) or 0.1 * (param.high - param.low)
    return Free(
        name=parameter.name,
        low=low,
        high=high,
        start=min(max(param.typical if off else nominal, low), high),
        scale=prior or size,
        nominal=nominal,
        prior=prior,
        switch=param.switch,
    )


def prior_parameters(told: Description, widened: float = 1.0) -> tuple[Free, ...]:
    """Return what is free in every fit of a diagnosis: parameters with an uncertainty, near their
    values; ``widened`` is a factor on these uncertainties.

    Without the limit a large gap takes them anywhere, and an effect that is missing is imitated by
    constants that nobody would believe.
    """
    parameters, priors = told.model.plant.parameters, []
    uncertain = told.uncertainty.keys()
    for name, prior in told.uncertainty.items():
        if _idle(told.model, name, uncertain):
            continue
        nominal, bounds = told.model.values[name], told.bounds.get(name)
        free = free_parameter(parameters[name], nominal, prior, bounds)
        wide = widened * prior
        low, high = nominal - PRIOR_BOUND_SIGMAS * wide, nominal + PRIOR_BOUND_SIGMAS * wide
        low, high = max(free.low, low), min(free.high, high)
        priors.append(replace(free, low=low, high=high, prior=wide, widened=widened))
    return tuple(priors)


def _idle(model: Model, name: str, uncertain: Container[str]) -> bool:
    """Whether a parameter is that of an effect that is off and surely so."""
    known = model.plant.parameters
    owner = known[name].owner
    switches = [it.name for it in known.values() if owner and it.owner == owner and it.param.switch]
    return bool(switches) and not any(model.values[it] or it in uncertain for it in switches)


def discontinuous(model: Model) -> dict[str, float]:
    """Return the switches of quantisers and holds that a model has on, at 0."""
    plant = model.plant
    return {
        name: 0.0
        for name, parameter in plant.parameters.items()
        if parameter.owner
        and parameter.param.switch
        and plant.main(parameter.owner).effect.hints.grid
        and model.values[name] != 0.0
    }


def free_names(plant: Plant, words: Iterable[str]) -> tuple[str, ...]:
    """Return parameters for words that are each a parameter or an effect, which means all of it.

    Raises:
        UserError: a word that is neither.
    """
    names: dict[str, None] = {}
    for word in [words] if isinstance(words, str) else words:
        matches = [n for n, p in plant.parameters.items() if word in (n, p.owner)]
        if not matches:
            known = {**plant.parameters, **plant.placements}
            raise UserError(unknown("parameter", word, known))
        names.update(dict.fromkeys(matches))
    return tuple(names)


def travel(plant: Plant, logs: Iterable[Log]) -> float:
    """Return the largest range of an angle [rad] or a position [m] in some logs, 1 without any."""
    ranges = [
        float(np.ptp(values))
        for log in logs
        for name, values in log.outputs.items()
        if plant.wire[name].unit in ("rad", "m")
    ]
    return max(ranges, default=1.0) or 1.0


@dataclass(eq=False)
class Memory:
    """What a search has seen of a problem, so that nothing is lost.

    Attributes:
        evaluations: simulations of all logs.
        best: the best vector and its cost.
        latest: the last vector and its residuals, which the slopes there begin with.
    """

    evaluations: int
    best: tuple[float, Array]
    latest: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class Problem:
    """Free parameters of one model and the logs that judge them; it does not change.

    Attributes:
        model: the nominal model; logs override single parameters of it.
        logs: measured runs.
        free: what is estimated; vectors below hold their values over their scales.
        sigma: standard deviation [SI] that weights each output, by default that of its readings.
        workers: on which runs go on together.
        start: vector from which a search begins, shape (p,), by default that of ``free``.
        steps: choose the internal step of every run; None for the model's own.
    """

    model: Model
    logs: Sequence[Log]
    free: Sequence[Free]
    sigma: Mapping[str, float] = field(default_factory=dict)
    workers: Workers = ALONE
    start: Array = None  # type: ignore[assignment]  # set from ``free`` below
    steps: InternalSteps | None = None
    runs: list[Run] = field(init=False, repr=False)
    memory: Memory = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "runs", [prepared(self.model, log, self.steps) for log in self.logs]
        )
        measured = dict.fromkeys(name for log in self.logs for name in log.outputs)
        scatters = {name: self.scatter(name) for name in measured if name not in self.sigma}
        object.__setattr__(self, "sigma", {**self.sigma, **scatters})
        if self.start is None:
            begin = np.array([free.start for free in self.free]) / self.scales
            object.__setattr__(self, "start", begin)
        no_vector = np.full(len(self.start) + 1, np.nan)  # equal to none
        memory = Memory(0, (np.inf, self.start), (no_vector, np.empty(0)))
        object.__setattr__(self, "memory", memory)

    def scatter(self, output: str) -> float:
        """Standard deviation [SI] of all readings of an output that a fit may see."""
        logs = [log for log in self.logs if output in log.outputs]
        values = np.concatenate([log.outputs[output][log.fitted] for log in logs])
        return float(np.std(values)) or 1.0 if len(values) else 1.0

    @cached_property
    def large_changes(self) -> Array:
        """Changes [scales] that count as large, shape (p,): infinity for one like its own value.

        Of a ripple's count it is the one by which the ripple's phase moves by 1 rad.
        """
        plant, changes = self.model.plant, np.full(len(self.free), np.inf)
        for i, free in enumerate(self.free):
            parameter = plant.parameters[free.name]
            if parameter.owner:
                hints = plant.main(parameter.owner).effect.hints
                if parameter.key in hints.counts:
                    changes[i] = 1.0 / (travel(plant, self.logs) * free.scale)
        return changes

    @cached_property
    def assumed(self) -> dict[str, float]:
        """Values [SI] twice as large as what effects with a free parameter assume, by name."""
        plant, names = self.model.plant, {free.name for free in self.free}
        owners = dict.fromkeys(owner for name in names if (owner := plant.parameters[name].owner))
        every = (
            plant.parameters[f"{o}.{key}"]
            for o in owners
            for key in plant.main(o).effect.hints.assumed
        )
        doubled = {it.name: min(2.0 * self.model.values[it.name], it.param.high) for it in every}
        return {name: value for name, value in doubled.items() if value and name not in names}

    @cached_property
    def smooth(self) -> Problem:
        """The same where the model has no quantisers and holds."""
        off = {**self.model.values, **discontinuous(self.model)}
        return replace(self, model=replace(self.model, values=off))

    def weighted_by(self, sigma: Mapping[str, float], start: Array) -> Problem:
        """Return the same problem with other weights [SI]; costs so far do not count there."""
        again = replace(self, sigma=sigma, start=start)
        again.memory.evaluations = self.memory.evaluations
        return again

    @property
    def scales(self) -> Array:
        """SI value of one unit of a vector, shape (p,)."""
        return np.array([free.scale for free in self.free])

    @property
    def nominal(self) -> Array:
        """Vector of the model before the fit, shape (p,)."""
        return np.array([free.nominal for free in self.free]) / self.scales

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of a vector, each of shape (p,)."""
        low = np.array([free.low for free in self.free])
        high = np.array([free.high for free in self.free])
        return low / self.scales, high / self.scales

    def sides(self, vector: Array) -> tuple[str, ...]:
        """Return for each value of a vector the bound it is on: ``"low"``, ``"high"`` or ``""``."""
        low, high = self.bounds
        edge = EDGE * np.maximum(1.0, np.abs(vector))
        return tuple(
            "low" if near_low else "high" if near_high else ""
            for near_low, near_high in zip(vector - low <= edge, high - vector <= edge)
        )

    def values(self, vector: Array) -> dict[str, float]:
        """Return a vector as SI values by name, inside their bounds to the last bit."""
        return {
            free.name: min(max(value * free.scale, free.low), free.high)
            for free, value in zip(self.free, vector.tolist())
        }

    def responses(self, vector: Array) -> list[dict[str, Array]]:
        """Return the simulated outputs of each log in SI, by name.

        Raises:
            UserError: a run that leaves the finite numbers.
        """
        values = self.values(vector)
        return [dict(zip(run.log.outputs, run.outputs(values).T)) for run in self.runs]

    def residuals(self, vector: Array) -> Array:
        """Return weighted errors of all samples that a fit may see, then of the priors."""
        residuals = self._residuals(vector)
        self._note(vector, residuals)
        self.memory.evaluations += 1
        self.memory.latest = (vector.copy(), residuals)
        return residuals

    def latest(self, vector: Array) -> Array:
        """Return ``residuals`` of the vector they were asked for last, or else find them."""
        known, residuals = self.memory.latest
        return residuals if np.array_equal(known, vector) else self.residuals(vector)

    def costs(self, vectors: Sequence[Array]) -> list[float]:
        """Return half the sum of the squared ``residuals`` of each vector, found together."""
        every = self._all(vectors)
        return [self._note(vector, residuals) for vector, residuals in zip(vectors, every)]

    def _note(self, vector: Array, residuals: Array) -> float:
        """Remember a vector if it is the best so far, and return its cost."""
        cost = 0.5 * float(residuals @ residuals)
        if cost < self.memory.best[0]:
            self.memory.best = (cost, vector.copy())
        return cost

    def _all(self, vectors: Sequence[Array]) -> list[Array]:
        self.memory.evaluations += len(vectors)
        return list(self.workers.map(self._residuals, vectors))

    def errors_with(self, values: Mapping[str, float], strict: bool = False) -> Array:
        """Return ``residuals`` with these values [SI], of other parameters as well.

        Raises:
            UserError: if ``strict``, for a run that leaves the finite numbers.
        """
        data = [self._errors(run, values, strict) for run in self.runs if run.measured.size]
        priors = [
            (values[free.name] - free.nominal) / free.prior
            for free in self.free
            if free.prior is not None
        ]
        return np.concatenate([*data, priors])

    def _errors(self, run: Run, values: Mapping[str, float], strict: bool) -> Array:
        """Weighted errors of one log, output by output."""
        sigma = self._weights(run)
        try:
            errors = run.errors(values)
        except UserError:
            if strict:
                raise
            return self._refused(run)
        errors /= sigma
        if run.log.unsure:
            along, share = nuisances(run.log, tuple(sigma.ravel().tolist()))
            errors = (errors.ravel() - along @ (share * (errors.ravel() @ along))).reshape(-1)
        if float(np.vdot(errors, errors)) < LARGEST:
            return errors.ravel()
        return np.where(np.abs(errors.ravel()) < LARGEST, errors.ravel(), self._refused(run))

    def _weights(self, run: Run) -> Array:
        """Standard deviations of the outputs of a log, shape (outputs, 1)."""
        return np.array([[self.sigma[name]] for name in run.log.outputs])

    def _refused(self, run: Run) -> Array:
        """Weighted errors of a run that leaves the finite numbers, more than no motion leaves."""
        reach = np.ptp(run.measured, axis=1, keepdims=True) / self._weights(run)
        return np.repeat(REFUSED * np.maximum(reach, 1.0), run.measured.shape[1])

    def _residuals(self, vector: Array) -> Array:
        return self.errors_with(self.values(vector))

    @cached_property
    def records(self) -> dict[tuple[int, str], slice]:
        """Rows of weighted errors of each output of each log, by its number and its name."""
        counts = {
            (k, name): int(log.fitted.sum())
            for k, log in enumerate(self.logs)
            for name in log.outputs
        }
        ends = np.cumsum([*counts.values()]).tolist()
        return {key: slice(end - counts[key], end) for key, end in zip(counts, ends)}

    @cached_property
    def samples(self) -> int:
        """Number of weighted errors that a fit may see."""
        return sum(int(log.fitted.sum()) * len(log.outputs) for log in self.logs)

    def jacobian(
        self, vector: Array, widths: Array | None = None, which: Sequence[int] | None = None
    ) -> Array:
        """Return the slope of ``residuals`` per scale, shape (m, p), by differences.

        They are one-sided and small, or, with ``widths`` in scales of shape (p,), central
        and that wide, as far as the bounds allow; of all parameters or of those named by
        position.  That of a parameter whose bounds leave it no room is 0.
        """
        low, high = self.bounds
        if widths is None:
            ends = vector + np.where(vector + DIFFERENCE <= high, DIFFERENCE, -DIFFERENCE)
            starts = vector
        else:
            ends, starts = np.minimum(vector + widths, high), np.maximum(vector - widths, low)
        chosen = range(len(vector)) if which is None else which
        units = np.eye(len(vector))[list(chosen)]
        points = [vector + (ends - vector) * e for e in units]
        if widths is not None:
            points += [vector + (starts - vector) * e for e in units]
            errors = self._all(points)
            pairs = zip(errors[: len(units)], errors[len(units) :])
        else:
            known, base = self.memory.latest
            if not np.array_equal(known, vector):
                base = self._all([vector])[0]
            pairs = zip(self._all(points), [base] * len(units))
        apart = np.where(ends == starts, 1.0, ends - starts)
        slopes = [(u - d) / apart[i] for i, (u, d) in zip(chosen, pairs)]
        return np.column_stack(slopes) if slopes else np.empty((self.samples, 0))

    @property
    def moving_input(self) -> tuple[int, float, float]:
        """Which input is the command, and its least and largest value [SI].

        It is that of the variant.  Where that never moves, it is the one that moves most for
        its scale; one that says yes or no is none.
        """
        inputs = np.vstack([run.inputs for run in self.runs])
        low, high = inputs.min(axis=0), inputs.max(axis=0)
        wires, main = self.model.plant.inputs, self.model.step[0]
        reach = [
            0.0 if wire.flag else np.inf if wire.name == main and span else span / wire.scale
            for wire, span in zip(wires, high - low)
        ]
        column = int(np.argmax(reach))
        return column, float(low[column]), float(high[column])

    def held_out_squares(self, values: Mapping[str, float]) -> list[Array]:
        """Return squared errors [noise floors^2] with these values [SI] at samples held out, by
        log, shape (outputs, n)."""
        squares = []
        for run in self.runs:
            log, columns = run.log, run.outputs_or_nan(values).T
            errors = [
                (column - measured)[log.checked] / self.sigma[name]
                for column, (name, measured) in zip(columns, log.outputs.items())
            ]
            squares.append(np.square(errors))
        return squares


# Inputs that are not known for sure, as part of the covariance of all weighted errors.
# Source: Rasmussen, Williams, Gaussian Processes for Machine Learning (2006), sec. 2.7 (linear
# nuisance terms).


def log_determinant(logs: Iterable[Log], sigma: Mapping[str, float]) -> float:
    """Return the logarithm of the determinant of the covariance of all weighted errors: what it
    costs to be unsure."""
    pairs = ((log, tuple(sigma[name] for name in log.outputs)) for log in logs if log.unsure)
    return float(sum(-2.0 * np.sum(np.log1p(-nuisances(*pair)[1])) for pair in pairs))


@cached(LRUCache(64), key=lambda log, sigma: (ref(log), sigma), lock=Lock())
def nuisances(log: Log, sigma: tuple[float, ...]) -> tuple[Array, Array]:
    """Return directions of weighted errors in which unsure inputs may have moved them, shape (m,
    k), and by which share the covariance takes each away, shape (k,).  ``sigma`` weights the
    outputs [SI]."""
    assert log.unsure
    spread = [log.unsure[name][log.fitted] / size for name, size in zip(log.outputs, sigma)]
    left, singular, _ = np.linalg.svd(np.concatenate(spread), full_matrices=False)
    seen = singular > LEAST_SINGULAR
    return left[:, seen], 1.0 - 1.0 / np.sqrt(1.0 + singular[seen] ** 2)
