"""A log as a simulation takes it: from its own inputs, after its settling time.

Its internal step is, in a search, as long as the noise of the readings allows.  A search simulates
the same logs thousands of times, and a plant that is fine enough for any use is finer than noise
can show: a time constant of 0.8 s read every 20 ms does not need steps of 2 ms.  So an interval of
the log, its half, its quarter and so on are tried, and the first is taken that gives the outputs of
the model's own step as far as the log can tell.  Each effect is tried on at its typical size, since
a lag or a limit cycle may need what the plant does not, and a run takes the least of what its
effects need.

A step hangs on the names of parameters, not on their values: along a search it stays, or slopes
would be differences between two steps.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from threading import Lock
from weakref import ref

import numpy as np
from cachetools import LRUCache, cached
from numpy.typing import NDArray

from servo_models.analysis.statistics import rms
from servo_models.core.bounds import inside
from servo_models.core.flat import noticed
from servo_models.core.plant import Plant
from servo_models.core.simulate import Model, check_grid, with_output
from servo_models.core.stop import Stop
from servo_models.core.types import Array
from servo_models.data.log import Log, Start
from servo_models.errors import UserError

FIRST_SAMPLES = 3  # samples at the beginning of a log
OFF_AT_FIRST = 0.02  # start error over the range that may reject the assumed start
OFF_LATER = 5.0  # start error over that of the second half that rejects it
MAYBE_AT_FIRST = 0.01  # start error over the range from which other starts are tried
MAYBE_LATER = 2.0  # start error over that of the second half: a settled log has its starts tried
START_STEPS = 6  # Gauss-Newton steps of the fit of a start
START_PARTS = (1.0, 0.25, 0.05)  # parts of such a step, the largest that leaves less is taken
START_DIFFERENCE = 1e-4  # step of its difference quotients, in full scales
START_PRIOR = 1e-3  # weight of a full scale beside an error of the whole range of an output
STEP = "internal_step"
MOST_SUBSTEPS_OVER_USUAL = 8.0  # sub-steps over the usual ones: a stiffer trial is as no effect
REMEMBERED = 12_000_000  # bytes of the latest simulations: a search comes back to a tenth of them
SHARE = 0.05  # error [noise floors, RMS] that a longer step may make
VISIBLE = 1.0  # sum of the squares of these errors in a log from which noise does not hide them
MOST_ROWS = 0.9  # quantile of the intervals between rows that counts as one: clocks jitter


@dataclass(frozen=True, eq=False)
class Run:
    """A log as the simulation takes it: the settling time in front, inputs as a matrix.

    With ``steps`` these choose the internal step, not the model.
    """

    log: Log
    model: Model
    times: Array
    inputs: Array
    columns: tuple[int, ...]
    steps: InternalSteps | None = None
    _chosen: dict[tuple[str, ...], float] = field(default_factory=dict, init=False, repr=False)
    _usual: dict[float, float] = field(default_factory=dict, init=False, repr=False)

    def outputs(self, values: Mapping[str, float]) -> Array:
        """Measured outputs simulated with these parameters, shape (n, outputs of the log)."""
        return np.asarray(self.simulate(values)[:, self.columns])

    def outputs_or_nan(self, values: Mapping[str, float]) -> Array:
        """The same, NaN where the model cannot be simulated: parameters that some logs ask for may
        run away in one that no fit has seen."""
        try:
            return self.outputs(values)
        except UserError:
            return np.full((len(self.log.times), len(self.columns)), np.nan)

    def with_constants(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return all parameters [SI] with these values: what the log states stays as it states it,
        also where other logs leave it open."""
        stated = self.log.constants
        left_open = {name: value for name, value in values.items() if name not in stated}
        return {**self.model.values, **left_open}

    def simulate(self, values: Mapping[str, float]) -> Array:
        """All outputs of the plant with these parameters, shape (n, outputs of the plant).

        What the log states as a constant stays, see ``with_constants``.

        Raises:
            StoppedError: the search has to end.
        """
        if self.steps:
            self.steps.stop.check()
        return _simulated(self, self._vector(values))[-len(self.log.times) :]

    def signal(self, wire: str, values: Mapping[str, float]) -> Array:
        """A signal of the model [SI] at the samples of the log, shape (n,); any wire will do."""
        inputs = [it.name for it in self.model.plant.inputs]
        if wire in inputs:
            return np.asarray(self.inputs[-len(self.log.times) :, inputs.index(wire)])
        again = prepared(with_output(self.model, wire), self.log, self.steps)
        return np.asarray(again.simulate(values)[:, again.model.plant.outputs.index(wire)])

    def notices(self, values: Mapping[str, float]) -> list[str]:
        """What the model has to warn of in this run, such as a curve held beyond its range.

        Nothing where it cannot be simulated, see ``outputs_or_nan``.
        """
        flat, vector = self.model.flat, self._vector(values)
        if not flat.notices:
            return []
        state = self.model.at_rest(vector)
        try:
            if self.beginning:
                _, state = self.beginning.run_fitted(vector, len(self.log.times))
            else:
                self.model.ran(vector, state, self.times, self.inputs)
        except UserError:
            return []
        return [f"log '{self.log.name}': {text}" for text in noticed(flat, state.tolist()).values()]

    def most_substeps(self, vector: Array) -> float:
        """Sub-steps that a run with a parameter vector may take: no end without ``steps``."""
        if self.steps is None:
            return math.inf
        step = float(vector[self._places[STEP]])
        if step not in self._usual:
            nominal = self._base.copy()
            nominal[self._places[STEP]] = step
            try:
                usual = self.model.substeps(nominal, self.times, self.inputs)
            except UserError:
                return math.inf
            self._usual[step] = MOST_SUBSTEPS_OVER_USUAL * usual
        return self._usual[step]

    def _vector(self, values: Mapping[str, float]) -> Array:
        """The parameter vector [SI] of a simulation with these values."""
        vector, stated = self._base.copy(), self.log.constants
        if self.steps and STEP not in stated:
            vector[self._places[STEP]] = self._step(self.steps, tuple(values))
        for name, value in values.items():
            if name not in stated:
                vector[self._places[name]] = value
        return vector

    def _step(self, steps: InternalSteps, names: tuple[str, ...]) -> float:
        """The internal step while these parameters change."""
        if names not in self._chosen:
            self._chosen[names] = steps.longest(self, names)
        return self._chosen[names]

    def errors(self, values: Mapping[str, float]) -> Array:
        """Simulated less measured [SI] at samples that a fit sees, shape (outputs of the log, n).

        Raises:
            UserError: a run that leaves the finite numbers.
        """
        errors = np.asarray(self.simulate(values).take(self._seen))
        errors -= self.measured
        return errors

    @cached_property
    def measured(self) -> Array:
        """Measured outputs [SI] at samples that a fit sees, shape (outputs of the log, n)."""
        return np.array([values[self._rows] for values in self.log.outputs.values()])

    @cached_property
    def beginning(self) -> Beginning | None:
        """How the run begins where neither rest nor its first row says so."""
        start = self.log.start
        if self.model.actuator.inner:
            return None  # nobody can put such a simulation to a motion
        if start and (start.shaft or (start.fitted and start.before)):
            return Beginning(self, start)
        return None

    def replayed(self, values: Mapping[str, float]) -> Array | None:
        """Inputs with which a host gets the same run; None where the shaft is put to a motion,
        which no host can ask for."""
        if not self.beginning:
            return self.inputs
        if self.beginning.start.shaft:
            return None
        begun = self.beginning.values(self._vector(values))
        again = self.inputs.copy()
        for column, wire in enumerate(self.model.plant.inputs):
            again[0, column] = begun.get(wire.name, again[0, column])
        return again

    def begun(self, values: Mapping[str, float]) -> tuple[Array, tuple[tuple[int, float], ...]]:
        """Inputs [SI] that are held before the log, and places of the state with their values.

        Of a run that has a ``beginning``.  Where the model cannot be simulated no start is fitted,
        and those that are stated are taken.
        """
        assert self.beginning is not None
        try:
            start = self.beginning.values(self._vector(values))
        except UserError:
            start = {**self.beginning.start.shaft, **self.beginning.start.before}
        state = np.full(self.model.flat.size, np.nan)
        if self.model.shaft:
            self.model.shaft.place(state, start)
        places = np.flatnonzero(~np.isnan(state))
        return self.beginning.held(start), tuple((int(k), float(state[k])) for k in places)

    @cached_property
    def after(self) -> Array:
        """When outputs of the plant were read, see ``Log.after_command``."""
        return self.log.after_command(self.model.plant.outputs)

    @cached_property
    def _base(self) -> Array:
        return self.model.vector

    @cached_property
    def _places(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.model.values)}

    @cached_property
    def _rows(self) -> NDArray[np.int64]:
        return np.flatnonzero(self.log.fitted)

    @cached_property
    def _seen(self) -> NDArray[np.int64]:
        """Places of these samples in what a simulation returns, row by row."""
        width = len(self.model.plant.outputs)
        return np.asarray(self._rows * width + np.array(self.columns)[:, None])


@cached(
    LRUCache(REMEMBERED, getsizeof=lambda found: found.nbytes),
    # a dead log equals itself only, so that no other one is given what was its own
    key=lambda run, vector: (ref(run.log), ref(run.model.plant), vector.tobytes()),
    lock=Lock(),
)
def _simulated(run: Run, vector: Array) -> Array:
    """All outputs with a parameter vector [SI], to be read only: others will be given the same."""
    outputs = (
        run.beginning.simulate(vector)
        if run.beginning
        else at_readings(
            partial(run.model.from_rest, vector, most=run.most_substeps(vector)),
            *(run.times, run.inputs, run.after),
        )
    )
    outputs.flags.writeable = False
    return outputs


def at_readings(
    run: Callable[[Array, Array], Array], times: Array, inputs: Array, after: Array
) -> Array:
    """Return what a run reads in its rows, shape (n, outputs): before the command of a row acts, or
    so long ``after`` it [s], shape (outputs,); with 0, a step of no length, in the same state."""
    later, place = np.unique(after[~np.isnan(after)], return_inverse=True)
    if not len(later):
        return run(times, inputs)
    grid = np.concatenate([times, *(times + it for it in later)])
    order = np.argsort(grid, kind="stable")  # a row comes before what is read with its command
    out = np.empty((len(grid), len(after)))
    out[order] = run(grid[order], inputs[np.searchsorted(times, grid[order], side="right") - 1])
    part = np.zeros(len(after), dtype=int)
    part[~np.isnan(after)] = 1 + place
    return out.reshape(-1, *(len(times), len(after)))[part, :, np.arange(len(after))].T


def prepared(model: Model, log: Log, steps: InternalSteps | None = None) -> Run:
    """Return a log as a simulation takes it; what its constants name is set for it alone.

    Raises:
        UserError: inputs outside their bounds or not finite.
    """
    plant = model.plant
    inputs = {wire.name: np.full(len(log.times), float(wire.rest)) for wire in plant.inputs}
    parameters: dict[str, float] = {}
    for name, value in log.constants.items():
        if name in inputs:
            inputs[name] = np.full(len(log.times), value)
        else:
            parameters[name] = value
    inputs |= log.inputs
    matrix = np.column_stack([inputs[wire.name] for wire in plant.inputs])
    times = log.times
    if log.settle > 0.0:
        times = np.concatenate([[0.0], times + log.settle])
        matrix = np.vstack([_held_before(log, plant, matrix[0]), matrix])
    chosen = replace(model, values={**model.values, **parameters})
    check_grid(times, matrix, plant.inputs, chosen.values[STEP])
    columns = tuple(plant.outputs.index(name) for name in log.outputs)
    return Run(log, chosen, times, np.ascontiguousarray(matrix), columns, steps)


def _held_before(log: Log, plant: Plant, first: Array) -> Array:
    """The inputs that were held before a log begins: its first row, where nothing else is known."""
    before = log.start.before if log.start else {}
    return np.array([before.get(it.name, now) for it, now in zip(plant.inputs, first)])


@dataclass(frozen=True, eq=False)
class Beginning:
    """A run whose shaft is put where a log begins, or whose start is fitted in every simulation.

    A fit is a few Gauss-Newton steps on the first part of the log, from the start that the log has,
    beside which a weak prior keeps what the log does not tell.  As the parameters of a model move,
    the start follows them, so that no search has to know of it.
    Source: Golub, Pereyra, SIAM J. Numerical Analysis 10 (1973) 413 (variable projection).
    """

    run: Run
    start: Start

    def simulate(self, vector: Array) -> Array:
        """All outputs with a parameter vector [SI], shape (n, outputs)."""
        return self.run_fitted(vector, len(self.run.log.times))[0]

    def run_fitted(self, vector: Array, rows: int) -> tuple[Array, Array]:
        """All outputs of the first rows, and the last state; a start may have to be fitted."""
        return self._run_from(vector, self.values(vector), rows)

    def values(self, vector: Array) -> dict[str, float]:
        """What the start names [SI], fitted if it is to be."""
        begin = {**self.start.shaft, **self.start.before}
        if not self.start.fitted:
            return begin
        x = first = np.array(list(begin.values()))
        errors = self._errors(vector, x, first)
        for _ in range(START_STEPS):
            slopes = [
                (self._errors(vector, x + step, first) - errors) / step.max()
                for step in np.diag(START_DIFFERENCE * self._scales)
            ]
            move = np.linalg.lstsq(np.column_stack(slopes), -errors, rcond=None)[0]
            for nearer in (x + part * move for part in START_PARTS):
                moved = self._errors(vector, nearer, first)
                if moved @ moved < errors @ errors:
                    break
            else:
                break
            x, errors = nearer, moved
        return dict(zip(begin, x.tolist()))

    def held(self, values: Mapping[str, float]) -> Array:
        """Inputs [SI] that are held before the log where it begins with these values."""
        first = zip(self.run.model.plant.inputs, self.run.inputs[0])
        return np.array([inside(values.get(it.name, now), it) for it, now in first])

    def _errors(self, vector: Array, x: Array, first: Array) -> Array:
        """Errors of the first part over the range of each output, and of the prior."""
        log, rows = self.run.log, self._rows
        values = dict(zip([*self.start.shaft, *self.start.before], x.tolist()))
        outputs = self._run_from(vector, values, rows[-1] + 1)[0][rows][:, self.run.columns]
        measured = np.column_stack([log.outputs[name][rows] for name in log.outputs])
        errors = (outputs - measured) / [np.ptp(it) or 1.0 for it in log.outputs.values()]
        return np.concatenate([errors.ravel(), START_PRIOR * (x - first) / self._scales])

    def _run_from(
        self, vector: Array, values: Mapping[str, float], rows: int
    ) -> tuple[Array, Array]:
        run, settle = self.run, self.run.log.settle
        state = run.model.at_rest(vector)
        if settle > 0.0:
            held = self.held(values)
            run.model.ran(vector, state, run.times[:2], np.array([held, held]))
        if run.model.shaft:
            run.model.shaft.place(state, values)
        part, most = slice(len(run.times) - len(run.log.times), None), run.most_substeps(vector)
        rest = partial(run.model.ran, vector, state, most=most)
        given = run.times[part][:rows], run.inputs[part][:rows]
        return at_readings(rest, *given, run.after), state

    @cached_property
    def _rows(self) -> NDArray[np.int64]:
        """Those of the first part that a fit may see; all of it where it sees none."""
        log = self.run.log
        early = log.times <= self.run.model.stop_time
        return np.flatnonzero(early & log.fitted if (early & log.fitted).any() else early)

    @cached_property
    def _scales(self) -> Array:
        wires = self.run.model.plant.wire
        return np.array([wires[it].scale for it in (*self.start.shaft, *self.start.before)])


def false_starts(runs: Iterable[Run], values: Mapping[str, float]) -> Iterator[str]:
    """Yield in words which logs begin in another state than the model, each with its cure.

    A wrong position shows at once and is forgotten; what else a model lacks shows when it moves.
    ``values`` are parameters [SI] of the model.
    """
    for run in runs:
        for name, first, later in _at_first(run, values):
            if first > max(OFF_AT_FIRST, OFF_LATER * later):
                yield (
                    f"log '{run.log.name}' begins in another state than the model,"
                    f" {_state(run.log)}: '{name}' is off by {first:.2g} of its range at first, by"
                    f" {later:.1g} in its second half; say how it begins ('start'), or begin the"
                    " log at rest ('window')"
                )


def begins_elsewhere(run: Run, values: Mapping[str, float]) -> bool:
    """Return whether a log seems to begin in another state than the model."""
    # a gain that is off shows where a log is settled, and does later; it does not at rest
    factor = MAYBE_LATER if run.log.settle > 0.0 else 0.0
    return any(
        first > max(MAYBE_AT_FIRST, factor * later) for _, first, later in _at_first(run, values)
    )


def _at_first(run: Run, values: Mapping[str, float]) -> Iterator[tuple[str, float, float]]:
    """Outputs with their errors [RMS, of their range] at first and in the second half."""
    log, wires = run.log, run.model.plant.wire
    unit = wires[run.model.plant.outputs[0]].unit
    for name, simulated in zip(log.outputs, run.outputs_or_nan(values).T):
        if wires[name].unit != unit:
            continue  # a drive or a current may jump at the first command
        reach = float(np.ptp(log.outputs[name]))
        errors = (simulated - log.outputs[name]) / (reach or 1.0)
        yield name, rms(errors[:FIRST_SAMPLES]), rms(errors[len(errors) // 2 :])


def _state(log: Log) -> str:
    """The state in which the model begins a log, in words."""
    if log.start:
        return "whose start is fitted" if log.start.fitted else "whose start is given"
    if log.settle:
        return f"for which its first row is held for {log.settle:.3g} s before"
    return "which begins at rest"


# The internal step of a search


@dataclass(eq=False)
class InternalSteps:
    """The longest internal step [s] that the noise allows, by log and effects.

    Attributes:
        model: about which it is measured; it says which effects are on anyway.
        noise: standard deviation [SI] of each output.
        stop: ends the search.
    """

    model: Model
    noise: Mapping[str, float]
    stop: Stop = field(default_factory=Stop)
    _found: dict[tuple[Log, str], float] = field(default_factory=dict, init=False, repr=False)

    def longest(self, run: Run, names: Iterable[str]) -> float:
        """Return the step for a run in which these parameters may be anything."""
        plant = self.model.plant
        others = (name for name, value in run.model.values.items() if value != self._own(name))
        owners = {plant.parameters[name].owner for name in (*names, *others)}
        return min(self._of(run.log, owner) for owner in {"", *owners})

    def _own(self, name: str) -> float:
        return self.model.values[name]

    def _of(self, log: Log, effect: str) -> float:
        key = (log, effect)
        if key not in self._found:
            self._found[key] = self._measured(prepared(self.model, log), self._typical(effect))
        return self._found[key]

    def _typical(self, effect: str) -> dict[str, float]:
        """Switches of an effect that are off, at their typical size."""
        return {
            name: parameter.param.typical
            for name, parameter in self.model.plant.parameters.items()
            if parameter.owner == effect and parameter.param.switch and self._own(name) == 0.0
        }

    def _measured(self, run: Run, values: Mapping[str, float]) -> float:
        usual = run.model.values[STEP]
        noise = np.array([self.noise[name] for name in run.log.outputs])
        try:
            fine = run.outputs(values)
        except UserError:
            return usual
        intervals = np.diff(run.log.times)
        step = float(np.quantile(intervals, MOST_ROWS)) if len(intervals) else 0.0
        while step > usual:  # the interval of the log, its half and so on
            errors = (run.outputs_or_nan({**values, STEP: step}) - fine) / noise
            if np.sum(errors**2) <= min(VISIBLE, SHARE**2 * errors.size):  # never of NaN
                return step
            step *= 0.5
        return usual
