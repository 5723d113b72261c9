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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from servo_models.identification.elements.estimate import Estimate
from servo_models.identification.elements.tables import Wish

USUAL_BANDS = (0.05, 0.02)
ROWS = (0.25, 0.5, 0.75, 1.5, 2.0)  # rows of the table of K_f, over the K_f to set
REACHED = 1.0 - math.exp(-2.0)
"""Share of the step at the time constant: with it the paper's 4.6 s and 2.6 s come out."""
TOUCHES = 1e-9
"""An extreme of the response that lies on the edge of the band is inside, but for rounding."""


@dataclass(frozen=True)
class Response:
    """Measures of the closed loop.

    Attributes:
        k_f: feedback coefficient [1].
        time_constant: time to ``REACHED`` of the step [s].
        overshoot: share of the step [1].
        bandwidth: where the gain is 3 dB below the static one [rad/s].
        phase_margin: of the open loop [rad].
        settling: time after which the response stays inside the band [s], by band [1].
    """

    k_f: float
    time_constant: float
    overshoot: float
    bandwidth: float
    phase_margin: float
    settling: dict[float, float]


@dataclass(frozen=True)
class Choice:
    """The feedback coefficient of the shortest settling.

    Attributes:
        band: share of the step within which it counts as settled [1].
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
class Loop:
    """The loop without its feedback coefficient.

    Attributes:
        gain: c [1/s^2].
        rate: 1/T [1/s].
    """

    gain: float
    rate: float

    def natural(self, k_f: float) -> float:
        """Natural frequency [rad/s]."""
        return math.sqrt(self.gain * k_f)

    def damping(self, k_f: float) -> float:
        """Damping ratio [1]."""
        return self.rate / (2.0 * self.natural(k_f))

    def k_f(self, overshoot: float) -> float:
        """Return the feedback coefficient with that overshoot, above 0 and below 1 [1]."""
        swing = math.log(overshoot)
        damping = -swing / math.hypot(math.pi, swing)
        return (self.rate / (2.0 * damping)) ** 2 / self.gain

    def overshoot(self, k_f: float) -> float:
        """Share of the step by which the response overshoots [1]."""
        damping = self.damping(k_f)
        if damping >= 1.0:
            return 0.0
        return math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))

    def bandwidth(self, k_f: float) -> float:
        """Frequency of -3 dB [rad/s]."""
        square = 1.0 - 2.0 * self.damping(k_f) ** 2
        return self.natural(k_f) * math.sqrt(square + math.sqrt(square**2 + 1.0))

    def phase_margin(self, k_f: float) -> float:
        """Phase margin of c K_f / (s (s + 1/T)) [rad]."""
        squared = self.rate**2
        crossing = 0.5 * (math.sqrt(squared**2 + 4.0 * (self.gain * k_f) ** 2) - squared)
        return math.pi / 2.0 - math.atan(math.sqrt(crossing) / self.rate)

    def step(self, k_f: float, time: float) -> float:
        """Step response over its final value [1] at a time [s]."""
        natural, decay = self.natural(k_f), 0.5 * self.rate
        turn = cmath.sqrt(decay**2 - natural**2)
        slow, fast = cmath.exp((turn - decay) * time), cmath.exp(-(turn + decay) * time)
        both = 0.5 * (slow + fast)
        lead = (slow - fast) / (2.0 * turn) if abs(turn * time) > 1e-6 else time * both
        return 1.0 - (both + decay * lead).real

    def settling(self, k_f: float, band: float) -> float:
        """Time [s] after which the response stays within ``band`` of the step.

        The extremes 0, 1, 2 ... of the response, the start among them, are off by powers of
        the overshoot: the band is entered for good after the last one outside.
        """
        overshoot, last = self.overshoot(k_f), 0
        if overshoot > 0.0:
            last = math.ceil(math.log(band) / math.log(overshoot) - TOUCHES) - 1
        return self._crossing(k_f, 1.0 + (band if last % 2 else -band), last)

    def response(self, k_f: float, bands: Sequence[float]) -> Response:
        """Return all measures at a feedback coefficient."""
        return Response(
            k_f=k_f,
            time_constant=self._crossing(k_f, REACHED, 0),
            overshoot=self.overshoot(k_f),
            bandwidth=self.bandwidth(k_f),
            phase_margin=self.phase_margin(k_f),
            settling={band: self.settling(k_f, band) for band in bands},
        )

    def best(self, band: float, limit: float) -> float:
        """Return K_f of the shortest settling with an overshoot of at most ``limit`` [1].

        With K_f the settling time falls, until an extreme of the response touches the band,
        and leaps up there: the best is one of these places, or the limit.
        """
        touching = [limit]
        power = 1
        while band ** (1.0 / power) < limit:
            touching.append(band ** (1.0 / power))
            power += 1
        return min(map(self.k_f, touching), key=lambda k_f: self.settling(k_f, band))

    def _crossing(self, k_f: float, level: float, extreme: int) -> float:
        """Time [s] at which the response crosses ``level`` after its extreme of that number."""
        from scipy.optimize import brentq

        damping = self.damping(k_f)
        if damping < 1.0:
            half_turn = math.pi / (self.natural(k_f) * math.sqrt(1.0 - damping**2))
            begin, end = extreme * half_turn, (extreme + 1) * half_turn
        else:
            begin, end = 0.0, 1.0 / self.natural(k_f)
            while self.step(k_f, end) < level:
                end *= 2.0
        return float(brentq(lambda time: self.step(k_f, time) - level, begin, end, xtol=1e-12))


@dataclass(frozen=True)
class Synthesis:
    """The closed loop of the elements.

    Attributes:
        loop: all but its feedback coefficient.
        wish: what it shall be.
        choices: of K_f, for the band of the wish first, then for the other usual one.
        rows: of the table of K_f, ascending.
    """

    loop: Loop
    wish: Wish
    choices: tuple[Choice, ...]
    rows: tuple[Response, ...]


def synthesise(parts: Mapping[str, Estimate], angle_unit: float, wish: Wish) -> Synthesis:
    """Put the loop together and choose its feedback coefficient for each band.

    Args:
        parts: the gains of motor, amplifier and potentiometer, time constant and gear ratio,
            SI by name of the parameter.
        angle_unit: rad of the output per rad of the shaft.
        wish: what it shall be.
    """
    values = {name: part.value for name, part in parts.items()}
    forward = values["amplifier_gain"] * values["motor_gain"] * values["potentiometer_gain"]
    constant = values["motor_time_constant"]
    loop = Loop(forward * angle_unit / (constant * values["gear_ratio"]), 1.0 / constant)
    # K_f of a given damping goes with 1 / (c T^2), so each element counts once.
    error = math.hypot(*(part.standard_error / part.value for part in parts.values()))
    bands = tuple(dict.fromkeys((wish.band, *USUAL_BANDS)))
    choices = []
    for band in bands:
        best = loop.best(band, wish.overshoot)
        setting = loop.response(_rounded_down(best), bands)
        choices.append(Choice(band, loop.response(best, bands), setting, error))
    wanted = {round(choices[0].setting.k_f * share, 12) for share in ROWS} | set(wish.k_f)
    wanted |= {k_f for c in choices for k_f in (c.setting.k_f, c.optimum.k_f)}
    rows = tuple(loop.response(k_f, bands) for k_f in sorted(wanted))
    return Synthesis(loop, wish, tuple(choices), rows)


def _rounded_down(value: float) -> float:
    """``value`` > 0 with two digits."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return round(math.floor(value / unit * (1.0 + 1e-12)) * unit, 12)
