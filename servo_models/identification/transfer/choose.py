"""Judge candidate transfer functions and choose one: parsimony.

What has unstable or undamped poles, or a zero that the data do not tell from a pole, is out.
Among the rest the best one is sought, and then the smallest that is not significantly worse
than it: by the held-out samples if there are any, else by the Bayesian information criterion.
Sources: Ljung, System Identification, 2nd ed., secs. 16.4 to 16.6; Kass and Raftery, Bayes
Factors, J. Am. Stat. Assoc. 90 (1995), for what counts as significant; Soederstroem, Test of
pole-zero cancellation, Automatica 11 (1975).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.analysis.statistics import dependence, inflation, whiteness
from servo_models.core.types import Array, Complex
from servo_models.errors import UserError
from servo_models.identification.transfer.fit import Fit
from servo_models.identification.transfer.functions import TransferFunction
from servo_models.identification.transfer.measurements import Measurements, Point, Record

WORSE = 10.0  # difference of the BIC that counts as very strong evidence (Kass and Raftery)
SIGNIFICANT = 2.0  # held-out losses differ if their mean difference is so many standard errors
COLOURED = 0.01  # probability below which residuals do not pass for noise
BLOCKS = 20  # held-out samples are compared in so many blocks, since neighbours are not independent
UNDAMPED = 0.01  # damping ratio below which a pole pair counts as undamped
SETTLED = 4.0  # time constants of an oscillation until it is within 2 %
CERTAIN = 0.95
CLOSE = 0.01  # a zero and a pole that are closer, relative to their size, leave nothing to be seen
VAGUE = 0.5
"""A zero whose standard error is a larger part of its size, or of the slowest pole's where that
is larger (a differentiator's zero at 0), is not determined."""


@dataclass(frozen=True, eq=False)
class Score:
    """What the errors of a transfer function look like.

    Attributes:
        errors, held_out_errors: by name of the measurements; SI for records; for frequency
            responses logarithm of gain, then phase [rad], over the points' spread.
        fit, held_out: share of the records' movement that is described, 1 for all of it,
            on fitted and on held-out samples; None without any.
        white: least probability, over the records, of such autocorrelations in white noise.
        independent: least probability of such correlations with past inputs if there is none;
            both None without records.
    """

    errors: Mapping[str, Array]
    held_out_errors: Mapping[str, Array]
    fit: float | None
    held_out: float | None
    white: float | None
    independent: float | None

    @property
    def rms(self) -> dict[str, float]:
        """Root mean square of the fitted errors by measurements."""
        return {name: float(np.sqrt(np.mean(e**2))) for name, e in self.errors.items() if len(e)}

    def losses(self, noise: Mapping[str, float]) -> Array:
        """Mean square of the held-out errors, over their noise, block by block."""
        parts = [(e / noise[name]) ** 2 for name, e in self.held_out_errors.items()]
        joined = np.concatenate([p for p in parts if len(p)] or [np.zeros(0)])
        blocks = np.array_split(joined, min(BLOCKS, len(joined)) or 1)
        return np.array([float(np.mean(b)) for b in blocks if len(b)])


def score(function: TransferFunction, measurements: Measurements) -> Score:
    """Compare a transfer function with all measurements."""
    fitted: dict[str, Array] = {}
    hidden: dict[str, Array] = {}
    chances: list[tuple[float, float]] = []
    point = Point.of(function)
    for data in measurements:
        with np.errstate(all="ignore"):
            error, _ = data.errors(point, False)
        used = data.fitted
        fitted[data.name], hidden[data.name] = error[used], error[~used]
        if isinstance(data, Record) and used.any():
            chances.append((whiteness(error, used), dependence(error, data.given, used)))
    white = min((chance for chance, _ in chances), default=None)
    independent = min((chance for _, chance in chances), default=None)
    return Score(
        fitted,
        hidden,
        _described(measurements, fitted, held_out=False),
        _described(measurements, hidden, held_out=True),
        white,
        independent,
    )


def _described(
    measurements: Measurements, errors: Mapping[str, Array], held_out: bool
) -> float | None:
    """1 - norm of the errors over norm of the movement, over all records."""
    missed = moved = 0.0
    for data in measurements:
        if isinstance(data, Record):
            y = data.measured[data.held_out == held_out]
            if len(y):
                missed += float(np.sum(errors[data.name] ** 2))
                moved += float(np.sum((y - np.mean(y)) ** 2))
    return 1.0 - float(np.sqrt(missed / moved)) if moved > 0.0 else None


@dataclass(frozen=True, eq=False)
class Candidate:
    """A transfer function in the comparison.

    Attributes:
        name: its structure, or the name under which it was given.
        function: the estimate, or what was given.
        fit: its uncertainty; None for a given one.
        score: how its errors look.
        aic, bic: information criteria, less is better.
        fault: what disqualifies it however well it fits, "" for nothing.
        reason: why it is rejected; "" for the chosen one.
    """

    name: str
    function: TransferFunction
    fit: Fit | None
    score: Score
    aic: float = np.inf
    bic: float = np.inf
    fault: str = ""
    reason: str = ""


def with_criteria(candidates: Sequence[Candidate], measurements: Measurements) -> list[Candidate]:
    """Add AIC and BIC; correlated errors count as fewer independent ones.

    How correlated the noise is, is read off the candidate with the least errors.
    """
    names = [data.name for data in measurements if data.fitted.any()]
    if not candidates:
        raise UserError("too few samples for any structure: record at least 16")

    def unlikelihood(errors: Mapping[str, float], counts: Mapping[str, float]) -> float:
        return sum(2.0 * counts[n] * float(np.log(max(errors[n], 1e-300))) for n in names)

    lengths = {n: float(len(candidates[0].score.errors[n])) for n in names}
    least = min((c.score for c in candidates), key=lambda s: unlikelihood(s.rms, lengths))
    counts = {n: lengths[n] / inflation(least.errors[n]) for n in names}
    total = sum(counts.values())
    judged = []
    for c in candidates:
        base, size = unlikelihood(c.score.rms, counts), c.function.structure.size
        aic, bic = base + 2.0 * size, base + size * float(np.log(total))
        judged.append(replace(c, aic=aic, bic=bic))
    return judged


def choose(candidates: Sequence[Candidate], longest: float | None) -> list[Candidate]:
    """Return the candidates with the reasons against all but one."""
    checked = [replace(c, fault=_fault(c, longest)) for c in candidates]
    sound = [c for c in checked if not c.fault]
    if not sound:
        raise UserError(
            f"no structure describes an actuator ({checked[0].fault}): check input, output and"
            " units of the record, or record longer"
        )
    likely = min(sound, key=lambda c: c.bic)
    noise = likely.score.rms
    for name, errors in likely.score.held_out_errors.items():
        if name not in noise:
            noise[name] = float(np.sqrt(np.mean(errors**2)))
    held_out = any(len(e) for e in likely.score.held_out_errors.values())
    losses = {c.name: c.score.losses(noise) for c in sound} if held_out else {}
    best = min(sound, key=lambda c: float(np.mean(losses[c.name]))) if held_out else likely

    def worse(c: Candidate) -> bool:
        if not held_out:
            return c.bic - best.bic > WORSE
        loss = losses[c.name] - losses[best.name]
        spread = float(np.std(loss, ddof=1)) / np.sqrt(len(loss)) if len(loss) > 1 else 0.0
        return c is not best and float(np.mean(loss)) > SIGNIFICANT * spread

    good = [c for c in sound if not worse(c)]
    chosen = min(good, key=lambda c: (c.function.structure.size, c.bic))

    def reason(c: Candidate) -> str:
        if c is chosen or c.fault:
            return c.fault
        larger = c.function.structure.size > chosen.function.structure.size
        if c in good or (larger and not held_out):
            return _needless(c, chosen)
        if held_out:
            return f"misses {_missed(c)} of the held-out samples, '{chosen.name}' {_missed(chosen)}"
        return f"worse than '{chosen.name}': BIC higher by {c.bic - chosen.bic:.4g}"

    return [replace(c, reason=reason(c)) for c in checked]


def _needless(c: Candidate, chosen: Candidate) -> str:
    more = c.function.structure.size - chosen.function.structure.size
    if not more:
        return f"no better than '{chosen.name}', which has as many coefficients"
    count = "one coefficient" if more == 1 else f"{more} coefficients"
    return f"no better than '{chosen.name}', with {count} more"


def _fault(c: Candidate, longest: float | None) -> str:
    trouble = pole_trouble(c.function, longest)
    return trouble or (surplus_zero(c.fit) if c.fit else "")


def _missed(c: Candidate) -> str:
    if c.score.held_out is not None:
        return f"{100.0 * (1.0 - c.score.held_out):.3g} %"
    errors = np.concatenate(list(c.score.held_out_errors.values()))
    return f"{100.0 * float(np.sqrt(np.mean(errors**2))):.3g} %"


def warnings(
    chosen: Candidate, candidates: Sequence[Candidate], longest: float | None
) -> tuple[str, ...]:
    texts = [slow_pole(chosen.function, longest)]
    likely = min(candidates, key=lambda c: c.bic)
    if likely.fault and chosen.bic - likely.bic > WORSE:
        texts.append(f"'{likely.name}' fits better than '{chosen.name}', but: {likely.fault}")
    white, independent = chosen.score.white, chosen.score.independent
    if independent is not None and independent < COLOURED:
        texts.append(
            f"the residuals of '{chosen.name}' still depend on the input: something is missing,"
            " such as an effect that is not linear"
        )
    elif white is not None and white < COLOURED:
        texts.append(
            f"the residuals of '{chosen.name}' are not white; the standard errors account for it"
        )
    return tuple(text for text in texts if text)


def pole_trouble(function: TransferFunction, longest: float | None) -> str:
    """Return why poles are not those of an actuator that the record shows, or "".

    Args:
        function: to be judged.
        longest: duration of the longest record [s], None without records.
    """
    for pole in sorted(function.poles, key=lambda p: -p.real):
        size, oscillates = abs(pole), pole.imag != 0.0
        where = _shown(pole)
        if oscillates and abs(pole.real) < UNDAMPED * size:
            ratio = -pole.real / size
            return f"undamped: poles at {where} rad/s, damping ratio {ratio:.2g}, never settle"
        if pole.real > 0.0 and not (longest and size * longest < 0.1):
            return f"unstable: a pole at {where} rad/s"
        if oscillates and longest and longest * abs(pole.real) < SETTLED:
            settling = SETTLED / abs(pole.real)
            return (
                f"undamped within the record: poles at {where} rad/s settle in {settling:.3g} s,"
                f" the longest record lasts {longest:.3g} s"
            )
    return ""


def slow_pole(function: TransferFunction, longest: float | None) -> str:
    """Return a warning about a real pole that the record is too short for, or ""."""
    slow = [p for p in function.poles if p.imag == 0.0 and longest and abs(p.real) * longest < 1.0]
    if not slow:
        return ""
    return (
        f"the pole at {_shown(slow[0])} rad/s is slower than the longest record ({longest:.3g} s):"
        " the static gain is not determined; record longer, or take it as an integrator"
    )


def surplus_zero(fit: Fit) -> str:
    """Return which zero is not determined, or cancels a pole, or "".

    Roots move by dp = -p^i da_i / A'(p); the distance of a pole and a zero is tested against
    its covariance.
    Source: Soederstroem, Test of pole-zero cancellation, Automatica 11 (1975).
    """
    from scipy.special import chdtri

    f, m, n = fit.function, fit.structure.zeros + 1, fit.structure.poles
    slowest = float(np.min(np.abs(f.poles)))
    for zero in f.zeros:
        slope = np.zeros(len(fit.covariance), dtype=complex)
        slope[:m] = _root_slopes(np.array(f.numerator), zero)
        error = float(np.sqrt(np.real(slope.conj() @ fit.covariance @ slope)))
        if error > VAGUE * max(abs(zero), slowest):
            return f"the zero at {_shown(zero)} rad/s is not determined: standard error {error:.2g}"
        for pole in f.poles:
            slope[m : m + n] = -_root_slopes(np.array(f.denominator), pole)[1:]
            parts = [slope.real] if zero.imag == pole.imag == 0.0 else [slope.real, slope.imag]
            spread = np.array(parts) @ fit.covariance @ np.array(parts).T
            gap = zero - pole
            distance = np.array([gap.real, gap.imag][: len(parts)])
            statistic = float(distance @ np.linalg.pinv(spread, hermitian=True) @ distance)
            near = abs(gap) < CLOSE * abs(pole)
            if near or statistic < chdtri(len(parts), 1.0 - CERTAIN):
                return (
                    f"pole-zero cancellation: the zero at {_shown(zero)} rad/s and the pole at"
                    f" {_shown(pole)} rad/s are one within"
                    + (f" {100.0 * CLOSE:g} %" if near else " their uncertainty")
                )
    return ""


def _root_slopes(polynomial: Array, root: complex) -> Complex:
    """Derivatives of a root by the coefficients, highest power first."""
    degree = len(polynomial) - 1
    powers = root ** (degree - np.arange(degree + 1))
    return np.asarray(-powers / np.polyval(np.polyder(polynomial), root), dtype=complex)


def _shown(root: complex) -> str:
    if root.imag == 0.0:
        return f"{root.real:.5g}"
    real = f"{root.real:.5g} " if abs(root.real) > 1e-6 * abs(root) else ""
    return f"{real}+-{abs(root.imag):.5g}j"
