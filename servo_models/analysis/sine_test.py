"""Shake a model about a working point: steps and sines of a given size, all effects included.

The ratio of the fundamentals of output and input under a sine is the describing function.
Source: Slotine, Li, Applied Nonlinear Control, 1991, sec. 5.1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from servo_models.analysis.linearise import inputs_at
from servo_models.analysis.statistics import rms
from servo_models.core.bounds import outside
from servo_models.core.simulate import Model
from servo_models.core.types import Array, Complex
from servo_models.errors import UserError

POINTS = 499
"""Communication points in a period; that the input is held between them is accounted for.

A prime, so that a clock in the model is seldom synchronous with the points; the error that such a
clock makes of the held input is below 1/POINTS.  More would overflow the buffer of a long delay."""
STEP_POINTS = 4000  # communication points of a step response
WAITS = 20  # default experiments to wait for rest at most


class SineTest:
    """A model that has come to rest, with one input that moves and one output that is read.

    Attributes:
        model, input, output: what is tested; the input has a full range of +-``amplitude``
            about ``centre`` [SI].
    """

    def __init__(
        self,
        model: Model,
        input_: str,
        output: str,
        amplitude: float,
        at: Mapping[str, float] | None = None,
    ) -> None:
        """Bring the model to rest at the inputs ``at`` [SI], others at their rest.

        Raises:
            UserError: an unknown input, an amplitude that leaves the input's bounds, or no
                rest there.
        """
        self.model, self.input, self.output, self.amplitude = model, input_, output, amplitude
        self._inputs = inputs_at(model, at)
        names = [wire.name for wire in model.plant.inputs]
        self._column, self._row = names.index(input_), model.plant.outputs.index(output)
        self.centre = self._inputs[self._column]
        wire = model.plant.inputs[self._column]
        for value in (self.centre - amplitude, self.centre + amplitude):
            low = -math.inf if wire.low is None else wire.low
            high = math.inf if wire.high is None else wire.high
            if not low <= value <= high:
                raise UserError(f"amplitude: {outside('input', input_, value, wire)}")
        self._state, self._time = model.start(), 0.0
        self._time = self._settle(self._state, self._time, self.centre)[1]

    def static_gain(self) -> float:
        """Return the change of the output over that of the input, between -+``amplitude``, SI.

        Each end is where the output rests when the input steps there from ``centre``.

        Raises:
            UserError: it does not come to rest.
        """
        low, high = (self._rest_at(self.centre + side * self.amplitude) for side in (-1.0, 1.0))
        return (high - low) / (2.0 * self.amplitude)

    def step(self, duration: float) -> tuple[Array, Array]:
        """Return times [s] from 0 and the output [SI] for a step of ``amplitude``, shape (n,)."""
        times = np.linspace(0.0, duration, STEP_POINTS + 1)
        values = np.full(len(times), self.centre + self.amplitude)
        return times, self._run(self._state.copy(), self._time + times, values)

    def response(self, frequency: float) -> complex:
        """Return output over input [SI] at ``frequency`` [Hz], by their fundamentals."""
        stop = self.model.stop_time
        wait = math.ceil(stop * frequency) + 2
        periods = math.ceil(0.25 * stop * frequency) + 3
        turns = np.arange(POINTS * (wait + periods) + 1) / POINTS
        command = self.centre + self.amplitude * np.sin(2.0 * math.pi * turns)
        angle = self._run(self._state.copy(), self._time + turns / frequency, command)
        last = slice(POINTS * wait, -1)
        swing, _ = fundamental(turns[last], angle[last], 2.0 * math.pi)
        return complex(1j * swing / (self.amplitude * hold(2.0 * math.pi, 1.0 / POINTS)))

    def _run(self, state: Array, times: Array, values: Array) -> Array:
        inputs = np.tile(self._inputs, (len(times), 1))
        inputs[:, self._column] = values
        return self.model.run(times, inputs, state)[:, self._row]

    def _rest_at(self, value: float) -> float:
        return self._settle(self._state.copy(), self._time, value)[0]

    def _settle(self, state: Array, time: float, value: float) -> tuple[float, float]:
        """Hold the input until the output rests or swings about a mean; return value and time."""
        span = self.model.stop_time
        scale = self.model.plant.wire[self.output].scale
        mean, moved = math.inf, math.inf
        for _ in range(WAITS):
            times = np.linspace(time, time + span, STEP_POINTS // 10 + 1)
            out = self._run(state, times, np.full(len(times), value))
            time, before, mean = float(times[-1]), mean, float(np.mean(out))
            moved = abs(mean - before)
            if moved <= 1e-6 * scale:
                break
        if not moved <= 1e-3 * scale:
            raise UserError("after a command the output does not come to rest")
        return mean, time


def fundamental(times: Array, values: Array, frequency: float) -> tuple[complex, float]:
    """Return the complex amplitude of a sine [``frequency`` in rad/s] and the rest's RMS.

    ``values``, shape (n,), are fitted by offset + Re(amplitude exp(j frequency t)).
    Source: IEEE Std 1057-2017, sec. 4.6 (fit of a sine by least squares).
    """
    angle = frequency * times
    basis = np.column_stack([np.cos(angle), -np.sin(angle), np.ones(len(times))])
    parts, *_ = np.linalg.lstsq(basis, values, rcond=None)
    rest = values - basis @ parts
    return complex(parts[0], parts[1]), rms(rest)


def hold(frequencies: ArrayLike, step: float) -> Complex:
    """Return the response of a hold over ``step`` [s] at ``frequencies`` [rad/s].

    Source: Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd ed., sec. 5.3.
    """
    half = 0.5 * np.asarray(frequencies, dtype=float) * step
    return np.asarray(np.sinc(half / math.pi) * np.exp(-1j * half), dtype=complex)
