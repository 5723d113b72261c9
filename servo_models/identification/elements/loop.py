"""The closed loop of a servo put together from its elements, and the choice of K_f.

Amplifier, motor of first order, gearbox and potentiometer make a loop of second order,

    Phi(s) = K / (s^2 + s / T + c K_f),    c = K_AP K_EN k_FS e / (T K_R),

with the angle unit e of the output (``sg90.physics.shaft_rate``).  All measures of it
have a closed form but two times, which are roots of the closed step response.
Sources: SG90 paper sec. 6, eq. 7; Ogata, Modern Control Engineering, 5th ed., secs. 5-3
(step response), 7-7 (phase margin) and 7-8 (bandwidth).
"""

from __future__ import annotations

import cmath
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

from servo_models.data.schema import Section, Share, Table
from servo_models.identification.elements.estimate import Interval

REACHED = 1.0 - math.exp(-2.0)  # share at the time constant: the paper's 4.6 s and 2.6 s
GAINS = ("amplifier_gain", "motor_gain", "potentiometer_gain")
Coefficient = Annotated[float, Meta(gt=0.0, le=sys.float_info.max)]


class Wish(Table):
    """What the closed loop shall be, ``[elements.synthesis]``.

    Written as::

        band = "5 %"                    # share of the step within which it counts as settled
        overshoot = "5 %"               # share of the step at most
        k_f = [0.05, 0.1, 0.18]         # further feedback coefficients to evaluate
    """

    band: Share = Share(0.05)
    overshoot: Share = Share(0.05)
    k_f: list[Coefficient] | Coefficient = []


def read_wish(entry: Section) -> Wish:
    """Read ``[elements.synthesis]``.

    Raises:
        UserError: shares that are not above 0 and below 1, or K_f that are not above 0.
    """
    wish = entry.read(Wish)
    for key, share in (("band", wish.band), ("overshoot", wish.overshoot)):
        if not 0.0 < share < 1.0:
            entry.fail(key, f'{share:g} is not between 0 and 1; give a share of the step, "5 %"')
    return wish


@dataclass(frozen=True)
class Response:
    """Measures of the closed loop, SI: time to ``REACHED`` of the step, overshoot as a share of
    it, bandwidth to -3 dB, phase margin of the open loop c K_f / (s (s + 1/T)), and the time after
    which the response stays inside a band, by band."""

    k_f: float
    time_constant: float
    overshoot: float
    bandwidth: float
    phase_margin: float
    settling: dict[float, float]


@dataclass(frozen=True)
class Loop:
    """The loop without its feedback coefficient: ``gain`` c [1/s^2] and ``rate`` 1/T [1/s]."""

    gain: float
    rate: float

    def response(self, k_f: float, bands: Sequence[float]) -> Response:
        """Return all measures at a feedback coefficient."""
        from scipy.optimize import brentq

        square, decay = self.gain * k_f, 0.5 * self.rate
        turn = cmath.sqrt(decay**2 - square)  # from -decay to the poles, imaginary if they swing
        swing = turn.imag
        overshoot = math.exp(-math.pi * decay / swing) if swing else 0.0

        def step(time: float) -> float:
            slow, fast = cmath.exp((turn - decay) * time), cmath.exp(-(turn + decay) * time)
            both = 0.5 * (slow + fast)
            lead = (slow - fast) / (2.0 * turn) if abs(turn * time) > 1e-6 else time * both
            return 1.0 - (both + decay * lead).real

        def crossing(level: float, extreme: int = 0) -> float:
            """Time [s] at which the step crosses ``level`` after its extreme of that number."""
            begin, end = 0.0, 1.0 / self.rate
            if swing:
                begin, end = extreme * math.pi / swing, (extreme + 1) * math.pi / swing
            while not swing and step(end) < level:
                end *= 2.0
            return float(brentq(lambda time: step(time) - level, begin, end, xtol=1e-12))

        def settling(band: float) -> float:
            """The extremes 0, 1, 2 ..., the start among them, are off by powers of the overshoot:
            the band is entered for good after the last one outside."""
            last = 0
            if overshoot > 0.0:  # an extreme on the edge of the band is inside, but for rounding
                last = math.ceil(math.log(band) / math.log(overshoot) - 1e-9) - 1
            return crossing(1.0 + (band if last % 2 else -band), last)

        flat = 1.0 - self.rate**2 / (2.0 * square)
        crossed = 0.5 * (math.hypot(self.rate**2, 2.0 * square) - self.rate**2)
        return Response(
            k_f=k_f,
            time_constant=crossing(REACHED),
            overshoot=overshoot,
            bandwidth=math.sqrt(square * (flat + math.hypot(flat, 1.0))),
            phase_margin=math.pi / 2.0 - math.atan(math.sqrt(crossed) / self.rate),
            settling={band: settling(band) for band in bands},
        )

    def k_f(self, overshoot: float) -> float:
        """Return the feedback coefficient with that overshoot, above 0 and below 1 [1]."""
        swing = math.log(overshoot)
        damping = -swing / math.hypot(math.pi, swing)
        return (self.rate / (2.0 * damping)) ** 2 / self.gain

    def best(self, band: float, limit: float) -> float:
        """Return K_f of the shortest settling with an overshoot of at most ``limit`` [1].

        With K_f the settling time falls, until an extreme of the response touches the band,
        and leaps up there: the best is one of these places, or the limit.
        """
        count = math.ceil(math.log(band) / math.log(limit))
        touching = [limit, *(band ** (1.0 / power) for power in range(1, count))]
        return min(
            map(self.k_f, touching), key=lambda k_f: self.response(k_f, [band]).settling[band]
        )


@dataclass(frozen=True)
class Choice:
    """The feedback coefficient of the shortest settling into ``band``, a share of the step.

    Attributes:
        optimum: the response at the best K_f.
        setting: the response at that K_f rounded to two digits, what one would set: down,
            since more would overshoot more.
        relative_error: standard error of the best K_f over K_f, from those of the elements.
    """

    band: float
    optimum: Response
    setting: Response
    relative_error: float


@dataclass(frozen=True)
class Synthesis:
    """The closed loop of the elements: K_f for the band of the wish first, then for the other usual
    one, and rows of the table of K_f, ascending."""

    loop: Loop
    wish: Wish
    choices: tuple[Choice, ...]
    rows: tuple[Response, ...]


def synthesise(parts: Mapping[str, Interval], angle_unit: float, wish: Wish) -> Synthesis:
    """Put the loop together and choose its feedback coefficient for each band.

    Args:
        parts: of the loop, SI by name of the parameter.
        angle_unit: rad of the output per rad of the shaft.
        wish: what it shall be.
    """
    used = [parts[name] for name in ("motor_time_constant", "gear_ratio", *GAINS)]
    constant, ratio, *gains = (part.value for part in used)
    loop = Loop(math.prod(gains) * angle_unit / (constant * ratio), 1.0 / constant)
    # K_f of a given damping goes with 1 / (c T^2), so each element counts once.
    error = math.hypot(*(part.standard_error / part.value for part in used))
    bands = tuple(dict.fromkeys((wish.band, 0.05, 0.02)))
    best = [loop.best(band, wish.overshoot) for band in bands]
    places = [1 - math.floor(math.log10(k_f)) for k_f in best]
    set_to = [math.floor(k * 10.0**n * (1.0 + 1e-12)) / 10.0**n for k, n in zip(best, places)]
    usual = [round(set_to[0] * share, 12) for share in (0.25, 0.5, 0.75, 1.5, 2.0)]
    asked = wish.k_f if isinstance(wish.k_f, list) else [wish.k_f]
    at = {k_f: loop.response(k_f, bands) for k_f in sorted({*best, *set_to, *usual, *asked})}
    choices = [Choice(band, at[k], at[s], error) for band, k, s in zip(bands, best, set_to)]
    return Synthesis(loop, wish, tuple(choices), tuple(at.values()))
