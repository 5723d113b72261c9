"""Figures of merit of a model: what the builder of a vehicle asks of an actuator.

All figures are from the main input to the first output, once of the linear state space and
once of the whole model under commands of a given size, since saturation, dead zone, friction
and backlash make an actuator another one for every size of command.
"""

from __future__ import annotations

import cmath
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.analysis.compare import StepMetrics, rise_time, step_metrics
from servo_models.analysis.experiment import step as standard_step
from servo_models.analysis.linear_model import LinearModel
from servo_models.analysis.linearise import linearise
from servo_models.analysis.sine_test import STEP_POINTS, SineTest
from servo_models.core.plant import check_known
from servo_models.core.simulate import Model
from servo_models.errors import UserError, told_at
from servo_models.files import write_whole
from servo_models.report.result import Result
from servo_models.units import parse

SUFFIXES = (".json", ".mat", ".npz")

HALF_POWER = math.sqrt(0.5)
RATIO = 10.0 ** (1.0 / 12.0)  # frequency of a sweep over the one before
DECADES = 5  # decades of frequency after which a sweep is given up

Response = Callable[[float], complex]  # output over input [SI] at a frequency [Hz]


@dataclass(frozen=True)
class Point:
    """Frequency [Hz], gain over the static gain [1], and phase lag [rad], not wrapped."""

    frequency: float
    gain: float
    lag: float


@dataclass(frozen=True)
class FrequencyFigures:
    """Figures of a frequency response; None where the response never gets there.

    Attributes:
        static_gain: output over input at rest, in SI.
        bandwidth: frequency [Hz] at which the gain first is 3 dB below the static gain.
        phase_90: frequency [Hz] at which the phase lag first is 90 deg.
        delay: time [s] of the pure delay with the same lag at a quarter of the bandwidth.
        points: at the frequencies asked for.
    """

    static_gain: float
    bandwidth: float | None
    phase_90: float | None
    delay: float | None
    points: tuple[Point, ...]


@dataclass(frozen=True, eq=False, repr=False)
class Figures(Result):
    """Figures of merit of ``model``.

    Attributes:
        input, output: names.
        at: SI values of inputs at the working point, where they are not at rest.
        amplitude: of the input [SI], for ``large`` and ``step``.
        linear: state space, None where there is none.
        small: of the state space.
        large: of the whole model at ``amplitude``.
        missing: why there is no ``linear`` or ``small``, or no ``large``.
        step: response to a step of ``amplitude``, from the working point.
        slew_rate: mean rate of the output [SI/s] from 10 % to 90 % of the standard step.
    """

    model: Model
    input: str
    output: str
    at: Mapping[str, float]
    amplitude: float
    linear: LinearModel | None
    small: FrequencyFigures | None
    large: FrequencyFigures | None
    missing: tuple[str, ...]
    step: StepMetrics
    slew_rate: float | None

    def write(self, path: str | Path) -> None:
        """Write figures and A, B, C, D in SI: ``.json``, ``.mat`` for MATLAB, ``.npz`` for numpy.

        Raises:
            UserError: another kind of file, or a folder that cannot be written.
        """
        path = Path(path)
        check_suffix(path)
        content = io.BytesIO()
        match path.suffix.lower():
            case ".json":
                text = json.dumps(self.document(), indent=2, allow_nan=False)
                content.write(f"{text}\n".encode())
            case ".mat":
                from scipy.io import savemat

                savemat(content, _for_matlab(self.document()), long_field_names=True)
            case _:
                text = json.dumps(self.document(), allow_nan=False)
                matrices = self.linear.matrices() if self.linear else ()
                arrays: dict[str, Any] = dict(zip("ABCD", matrices))
                np.savez(content, figures=text, **arrays)
        write_whole(path, content.getvalue())


def check_suffix(path: Path) -> None:
    """Raise UserError unless ``path`` names a kind of file that ``Figures.write`` writes."""
    if path.suffix.lower() not in SUFFIXES:
        raise UserError(f"'{path}': figures go to a file that ends in {', '.join(SUFFIXES)}")


def _for_matlab(tree: dict[str, Any]) -> dict[str, Any]:
    """What MATLAB can load: None is [], names have no dots, lists of texts are cells."""

    def converted(value: Any) -> Any:
        if isinstance(value, dict):
            return {key.replace(".", "_"): converted(inner) for key, inner in value.items()}
        if isinstance(value, (list, tuple)):
            simple = not value or isinstance(value[0], (float, list))
            return np.array(value) if simple else _cells([converted(inner) for inner in value])
        return np.empty((0, 0)) if value is None else value

    space = tree["state_space"] or {}
    made: dict[str, Any] = converted(tree)
    return made | {name: np.array(space[name]) for name in "ABCD" if space}


def _cells(values: list[Any]) -> Any:
    cells = np.empty(len(values), dtype=object)
    cells[:] = values
    return cells


def figures(
    model: Model,
    at: Mapping[str, float | str] | None = None,
    amplitude: float | str | None = None,
    frequencies: Sequence[float | str] = (),
) -> Figures:
    """Measure a model.

    Args:
        model: from ``servo_models.model`` or a parameter set.
        at: inputs of the working point by name, SI or strings such as ``"1.6 ms"``; an input
            not named is at rest.
        amplitude: of the command, SI of the input or a string; a string in the output's unit
            is converted by the static gain.  Default: a tenth of the standard step.
        frequencies: at which gain and phase lag are wanted, in Hz or with a unit.

    Raises:
        UserError: an unknown input, a unit that does not convert, an amplitude or a
            frequency that is not above 0 or leaves the input's bounds.

    Example:
        >>> import servo_models as sm
        >>> merits = sm.figures(sm.model("gimbal.py"), amplitude="5 deg")
        >>> round(merits.small.bandwidth, 2), round(merits.small.delay, 4)  # Hz, s
        (3.55, 0.0648)
    """
    (main, size), output = model.step, model.plant.outputs[0]
    wires, given = {wire.name: wire for wire in model.plant.inputs}, at or {}
    check_known("input", given, wires, f"actuator '{model.actuator.name}'")
    point = {n: _parsed(f"input '{n}'", value, wires[n].unit) for n, value in given.items()}
    wanted = sorted(_above_0("frequency", value, "Hz") for value in frequencies)
    reference = standard_step(model, dt=model.stop_time / STEP_POINTS)
    change = size - float(model.plant.wire[main].rest)
    moved = float(reference[output][-1] - reference[output][0])
    span = 0.1 * abs(change)
    if amplitude is not None:
        span = _amplitude(model, amplitude, moved / change)
    test = SineTest(model, main, output, span, point)
    measured = step_metrics(*test.step(model.stop_time))
    lowest = 0.02 / (measured.delay or model.stop_time)
    missing = []
    linear = small = large = None
    try:
        linear = linearise(model, point)
        if linear.is_stable():
            small = _small(linear, main, output, lowest, wanted)
        else:
            missing.append("no small signals: the linear model is unstable")
    except UserError as error:
        missing.append(f"no small signals: {error}")
    try:
        large = frequency_figures(test.response, test.static_gain(), lowest, wanted)
    except UserError as error:
        missing.append(f"no frequency response at this amplitude: {error}")
    rise = rise_time(reference.times, reference[output])
    return Figures(
        model=model,
        input=main,
        output=output,
        at=point,
        amplitude=span,
        linear=linear,
        small=small,
        large=large,
        missing=tuple(missing),
        step=measured,
        slew_rate=0.8 * abs(moved) / rise if rise else None,
    )


def frequency_figures(
    response: Response, static_gain: float, lowest: float, wanted: Sequence[float] = ()
) -> FrequencyFigures:
    """Return the figures of a frequency response.

    Args:
        response: output over input [SI] at a frequency [Hz].
        static_gain: output over input at rest [SI]; 0 if nothing moves there.
        lowest: frequency [Hz] well below all that happens.
        wanted: frequencies [Hz] of ``points``, rising.
    """
    if static_gain == 0.0:
        return FrequencyFigures(0.0, None, None, None, ())
    curve = _Curve(lambda frequency: response(frequency) / static_gain, lowest)
    bandwidth = curve.first(lambda point: point.gain - HALF_POWER)
    phase_90 = curve.first(lambda point: 0.5 * math.pi - point.lag)
    delay = None
    if bandwidth:
        quarter = curve.at(0.25 * bandwidth)
        delay = quarter.lag / (2.0 * math.pi * quarter.frequency)
    points = tuple(curve.at(frequency) for frequency in wanted)
    return FrequencyFigures(static_gain, bandwidth, phase_90, delay, points)


class _Curve:
    """A frequency response walked from low frequencies up, so that its phase unwraps."""

    def __init__(self, ratio: Response, lowest: float) -> None:
        self._ratio = ratio
        self._walked = [self._point(lowest, 0.0)]

    def at(self, frequency: float) -> Point:
        """Return the response at a frequency [Hz]."""
        while self._walked[-1].frequency < frequency:
            self._walk()
        before = [point for point in self._walked if point.frequency <= frequency]
        return self._point(frequency, before[-1].lag if before else 0.0)

    def first(self, excess: Callable[[Point], float]) -> float | None:
        """Return the first frequency [Hz] at which ``excess`` falls to 0."""
        from scipy.optimize import brentq

        for k in range(12 * DECADES):
            if k + 1 == len(self._walked):
                self._walk()
            low, high = self._walked[k : k + 2]
            if excess(low) > 0.0 >= excess(high):
                frequency = brentq(
                    lambda f, near=low.lag: excess(self._point(f, near)),
                    low.frequency,
                    high.frequency,
                    rtol=1e-5,
                )
                return float(frequency)
        return None

    def _walk(self) -> None:
        last = self._walked[-1]
        self._walked.append(self._point(RATIO * last.frequency, last.lag))

    def _point(self, frequency: float, near: float) -> Point:
        """The response, with the lag of all possible ones that is nearest to ``near``."""
        ratio = self._ratio(frequency)
        turned = cmath.phase(ratio * cmath.exp(1j * near))
        return Point(frequency, abs(ratio), near - turned)


def _small(
    linear: LinearModel, main: str, output: str, lowest: float, wanted: Sequence[float]
) -> FrequencyFigures:
    def response(frequency: float) -> complex:
        return complex(linear.response(frequency, main, output)[0])

    static = response(1e-3 * lowest)
    return frequency_figures(response, math.copysign(abs(static), static.real), lowest, wanted)


def _amplitude(model: Model, value: float | str, gain: float) -> float:
    """Amplitude of the main input [SI], also where it is told as one of the output."""
    main = model.plant.wire[model.step[0]]
    output = model.plant.wire[model.plant.outputs[0]]
    try:
        return _above_0("amplitude", value, main.unit)
    except UserError:
        if not isinstance(value, str) or gain == 0.0:
            raise
        with suppress(UserError):
            return _above_0("amplitude", value, output.unit) / abs(gain)
        raise


def _above_0(name: str, value: float | str, unit: str) -> float:
    number = _parsed(name, value, unit)
    if number <= 0.0:
        raise UserError(f"{name} '{value}': give one above 0")
    return number


def _parsed(name: str, value: float | str, unit: str) -> float:
    with told_at(name):
        return parse(value, unit)
