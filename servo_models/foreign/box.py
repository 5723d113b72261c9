"""The narrow interface to a simulation that is not ours, and the plant that stands around it.

A *box* is simulated with parameters, times and inputs, and gives outputs.  Around it stands a plant
of effects: on the command, before the box, and on the readings, behind it.  One run of the whole is
a run of the plant for what the box is sent, the box, and a run of the plant for what is read.

Boxes are slow and runs repeat: what is behind a box changes nothing in it, so the latest answers of
a box are kept by what it was sent.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from cachetools import LRUCache
from numpy.typing import NDArray

from servo_models.core.plant import Actuator
from servo_models.core.types import Array

KEPT = 256  # latest answers of a box that are kept
HELD_BEFORE = 1.0  # s for which the first row was sent before a run begins
LEAST_JUMP_IN_SIZES = 1e-3  # of what is sent, within a step, over the size of the input
LEAST_PART_OF_STEP = 1e-3  # before and after a jump
ROUNDING_IN_SIZES = 1e-9  # of a mean, over the size of the input
Run = Callable[[Array, Array, Array], Array]  # a run of the plant: state, times, inputs -> outputs


@dataclass(frozen=True)
class Signal:
    """An input, an output or a parameter of a box.

    Attributes:
        name: of a wire or a parameter, see ``block.check_name``.
        unit: SI unit.
        size: full scale of a signal, start value of a parameter [SI].
        low, high: bounds of a parameter [SI].
        about: what it is.
        rest: value [SI] of an input that nobody sends.
    """

    name: str
    unit: str
    size: float
    low: float = -np.inf
    high: float = np.inf
    about: str = ""
    rest: float = 0.0


def name_of(text: str, otherwise: str = "") -> str:
    """Return a name that a wire or an actuator may have."""
    return re.sub(r"\W+|__+", "_", text).strip("_") or otherwise


class Box(Protocol):
    """A simulation that is not ours.

    Attributes:
        name, title: of it.
        inputs: those that are torques or forces are loads, the others commands.
        outputs: the reading that is judged first.
        parameters: that may be chosen.
        step: longest time [s] between two points at which it is sent inputs.
        any_step: shorter ones may have any length.
        stop_time: duration [s] of an experiment that shows what it does.
    """

    name: str
    title: str
    inputs: tuple[Signal, ...]
    outputs: tuple[Signal, ...]
    parameters: tuple[Signal, ...]
    step: float
    any_step: bool
    stop_time: float

    def run(self, parameters: Mapping[str, float], times: Array, inputs: Array) -> Array:
        """Return outputs at ``times``, shape (n, outputs), from rest.

        Args:
            parameters: by name [SI].
            times: increasing [s], shape (n,).
            inputs: shape (n, inputs) [SI], each row held until the next time.

        Raises:
            UserError: it stops, or takes too long.
        """
        ...


@dataclass(eq=False)
class Around:
    """Runs of a box with the plant around it; what ``Actuator.inner`` calls."""

    box: Box
    only: Callable[[frozenset[str]], Actuator]
    _answers: LRUCache[bytes, Array] = field(
        default_factory=lambda: LRUCache(KEPT), init=False, repr=False
    )
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False, repr=False)

    def ran(
        self,
        run: Run,
        values: Mapping[str, float],
        state: Array,
        times: Array,
        inputs: Array,
    ) -> Array:
        """Return what is read, shape (n, outputs of the plant), for ``inputs`` of the plant.

        ``run`` is that of the plant alone with parameters ``values``, and advances ``state``.
        """
        sent, read = len(self.box.inputs), len(self.box.outputs)
        grid, rows = finer(times, self.box.step)
        given = np.asarray(inputs, dtype=float)[held(times, grid)].copy()
        given[:, sent:] = 0.0  # what is read says nothing yet
        at, command, places = self._sent(run, state.copy(), grid, given)
        answer = self._answer(values, at, command)[places]
        steps, spans = np.diff(answer, axis=0), np.diff(grid)[:, None]
        # a lag sees the mean of an interval, and at its end a reading is what it is there
        behind = np.repeat(given, 2, axis=0)
        behind[2::2, :sent] = given[:-1, :sent]
        behind[::2, sent : sent + read] = answer
        behind[1:-1:2, sent : sent + read] = answer[:-1] + 0.5 * steps
        rates = np.divide(steps, spans, out=np.zeros_like(steps), where=spans > 0.0)
        behind[1:-1, sent + read :] = np.repeat(rates, 2, axis=0)
        return np.asarray(run(state, np.repeat(grid, 2), behind)[1::2][rows])

    def _sent(
        self, run: Run, state: Array, times: Array, inputs: Array
    ) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return when the box is sent something, what it is until the next time, and where
        ``times`` stand among these.

        It is the mean of what the plant sends from one time to the next, in two parts where that
        jumps in between, if the box takes any step: mean and ends tell when.
        """
        sent, read = len(self.box.inputs), len(self.box.outputs)
        # nobody knows what was sent before; a start value of an FMU may be its example
        run(state, times[0] + np.array([-HELD_BEFORE, 0.0]), inputs[[0, 0]])
        out = run(state, times, inputs)
        value, total = out[:, read : read + sent], out[:, read + sent :]
        before, after, spans = value[:-1], value[1:], np.diff(times)[:, None]
        means = np.divide(np.diff(total, axis=0), spans, out=after.copy(), where=spans > 0.0)
        change = after - before
        sizes = np.array([signal.size for signal in self.box.inputs])
        # what is held stays what it is, so that an input on its bound does not leave it
        means = np.where(np.abs(means - after) <= ROUNDING_IN_SIZES * sizes, after, means)
        jumps = (np.abs(change) > LEAST_JUMP_IN_SIZES * sizes) & (spans > 0.0) & self.box.any_step
        part = np.divide(after - means, change, out=np.zeros_like(change), where=jumps)
        jumps &= (part > LEAST_PART_OF_STEP) & (part < 1.0 - LEAST_PART_OF_STEP)
        if not jumps.any():
            return times, np.vstack([means, value[-1:]]), np.arange(len(times))
        edge = times[:-1, None] + part * spans
        interval, column = np.nonzero(jumps)
        order = np.lexsort((edge[interval, column], interval))
        interval, edges = interval[order], edge[interval, column][order]
        at = np.insert(times, interval + 1, edges)
        of = np.insert(np.arange(len(spans)), interval + 1, interval)
        late = at[:-1, None] >= edge[of]
        command = np.where(jumps[of], np.where(late, after[of], before[of]), means[of])
        places = np.arange(len(times)) + np.searchsorted(interval, np.arange(len(times)))
        return at, np.vstack([command, value[-1:]]), places

    def _answer(self, values: Mapping[str, float], times: Array, command: Array) -> Array:
        parameters = {parameter.name: values[parameter.name] for parameter in self.box.parameters}
        numbers = np.array(list(parameters.values()))
        key = numbers.tobytes() + times.tobytes() + command.tobytes()
        with self._lock:
            known = self._answers.get(key)
        if known is None:  # others may ask meanwhile
            known = self.box.run(parameters, times, command)
            with self._lock:
                self._answers[key] = known
        return known


def finer(times: Array, step: float) -> tuple[Array, Array]:
    """Return times with equal parts of at most ``step`` [s] between them, and where the given ones
    stand.  Equal neighbours stay."""
    parts = np.maximum(np.ceil(np.diff(times) / step - 1e-9), 1.0).astype(int)
    rows = np.concatenate([[0], np.cumsum(parts)])
    return np.interp(np.arange(rows[-1] + 1.0), rows, times), rows


def held(times: Array, grid: Array) -> Array:
    """Return, for each time of a grid, the last row of ``times`` that is not later."""
    return np.maximum(np.searchsorted(times, grid, side="right") - 1, 0)
