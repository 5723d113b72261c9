"""Whether the errors that a fitted model leaves are locked to the command.

Slow noise looks like something that is missing, until one asks whether it comes again with the
motion.  So the errors are whitened and regressed on functions of command, position, rate, its
sign, and time since the last reversal, less what the fitted parameters can do of these.  By chance
they explain as much as they do of the same errors shifted round their log against the command, the
colour of which is the same.  Logs of one command are not swapped: errors that are locked to it
would stay so.

Random signs of short blocks would see more, and too much: on the functions of real logs they call
noise with a memory locked far more often than they say, since no whitening is exact.

Sources: Ramsey, J. Royal Statistical Society B 31 (1969) 350 (regression specification test);
Billings, Voon, Int. J. Control 44 (1986) 235 (residuals against nonlinear functions of inputs
and outputs); Haugh, J. American Statistical Association 71 (1976) 378 (whitening first); Hoerl,
Kennard, Technometrics 12 (1970) 55 (ridge); Harris, arXiv:2012.06862 (2020) (null by shifts).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from servo_models.analysis.statistics import rms
from servo_models.core.types import Array
from servo_models.diagnosis.settings import DEFAULT, Settings
from servo_models.identification.problem import Problem

SHIFTS = 499  # shifts of the errors that the regression is compared with
LEAST_SHIFT = 0.05  # least shift of errors over the length of a log, either way round
LEAST_SAMPLES = 128  # samples of an output in all logs, below which the colour is hardly known
ORDER = 2  # order of the autoregression that whitens errors: a memory of noise, and a reading step
RIDGE = 1.0  # ridge on functions of length 1: directions that hardly any of them has do not count
STILL = 0.01  # rate over the largest of its log up to which nothing moves
FADING_IN_TIME_SCALES = (1.0, 4.0)  # time constants of errors after a reversal or a new command
LONGEST_TIME_SCALE = 0.05  # share of a log up to which a time scale is seen often enough
DEPENDENT = 1e-6  # independent part of a function, relative, below which slopes can do all of it
FORCES = (
    "position^2",
    "position^3",
    "|position|",
    "|rate|",
    "rate^2",
    "rate |rate|",
    "rate^3",
    "sign of rate",
    "direction",
    "position rate",
    "position |rate|",
    "position^2 rate",
    "position sign of rate",
    "position direction",
    "command^2",
)
"""Functions that a force may be: the position follows them with the plant's lag, twice."""


@dataclass(frozen=True)
class LockedTest:
    """How far errors follow the command.

    Attributes:
        p_value: probability that noise of this colour is explained as well; of few samples it comes
            out too small, noise passes 0.02 in about 1 of 20, so it never decides alone.
        explained: RMS [noise floors] that is explained, less what is by chance.
        share_explained: share of the power of the whitened errors, less what is by chance.
        strongest: function that explains most of them alone; "" where nothing was tested.
        settings: those of the diagnosis.
    """

    p_value: float
    explained: float
    share_explained: float
    strongest: str
    settings: Settings = DEFAULT

    @property
    def follows(self) -> bool:
        """Whether errors follow the command more than noise does by chance."""
        return self.p_value <= self.settings.locked_probability

    def matters(self, noise: float, gap: float, limit_cycle: float = 0.0) -> bool:
        """Return whether this is something that the model lacks, and not a law that is a little
        other than the actuator's.

        Args:
            noise: RMS in the errors [noise floors].
            gap: RMS error [noise floors] after re-tuning alone.
            limit_cycle: RMS [noise floors] by which the model differs from itself.
        """
        explained = math.sqrt(max(self.explained**2 - limit_cycle**2, 0.0))
        return (
            self.follows
            and explained > self.settings.locked_over_noise * noise
            and explained > self.settings.missed_gap_share * gap
        )


NOTHING_TESTED = LockedTest(1.0, 0.0, 0.0, "")


@dataclass(frozen=True, eq=False)
class Record:
    """One output of one log.

    Attributes:
        log: its number; outputs of one log are shifted together.
        output: name of the output; all its records share the coefficients of a regression.
        errors: in noise floors, shape (n,).
        functions: functions of what the actuator does, by name, each of shape (n,).
        slopes: of the errors over the fitted parameters, shape (n, p).
    """

    log: int
    output: str
    errors: Array
    functions: Mapping[str, Array]
    slopes: Array


def command_locked(
    problem: Problem, values: Mapping[str, float], errors: Array, slopes: Array
) -> LockedTest:
    """Test the errors of a fitted model.

    Args:
        problem, values: of the fit; its free parameters [SI] by name.
        errors: weighted errors of the fit [noise floors], shape (m,).
        slopes: of the errors over the parameters, shape (m, p).
    """
    column, _, _ = problem.moving_input
    records = []
    for number, run in enumerate(problem.runs):
        log, seen = run.log, run.log.fitted
        if not seen.any():
            continue
        position = run.simulate(values)[:, 0]
        command = run.inputs[-len(log.times) :, column]
        functions = functions_of(log.times, command, position)
        at_fitted = {name: function[seen] for name, function in functions.items()}
        for name in log.outputs:
            rows = problem.records[number, name]
            records.append(Record(number, name, errors[rows], at_fitted, slopes[rows]))
    return locked_test(records)


def functions_of(times: Array, command: Array, position: Array) -> dict[str, Array]:
    """Return functions of one log, each of shape (n,), by what they are of."""
    rate = np.gradient(position, times)
    rate[np.abs(rate) <= STILL * np.abs(rate).max()] = 0.0
    acceleration = np.gradient(rate, times)
    scale = rms(rate) / (rms(acceleration) or math.inf) / float(np.median(np.diff(times)))
    scale = min(max(scale, 1.0), LONGEST_TIME_SCALE * len(times))
    q, u = _centred(position), _centred(command)
    v, a = rate / (rms(rate) or 1.0), acceleration / (rms(acceleration) or 1.0)
    sign = np.sign(v)
    towards, since = _since_reversal(sign)
    step = np.diff(u, prepend=u[0])
    functions = {
        "position": q,
        "position^2": q * q,
        "position^3": q**3,
        "|position|": np.abs(q),
        "command": u,
        "command^2": u * u,
        "rate": v,
        "|rate|": np.abs(v),
        "rate^2": v * v,
        "rate |rate|": v * np.abs(v),
        "rate^3": v**3,
        "sign of rate": sign,
        "direction": towards,
        "acceleration": a,
        "acceleration |acceleration|": a * np.abs(a),
        "position rate": q * v,
        "position |rate|": q * np.abs(v),
        "position^2 rate": q * q * v,
        "position sign of rate": q * sign,
        "position direction": q * towards,
        "command sign of rate": np.sign(u) * sign,
    }
    for scales in FADING_IN_TIME_SCALES:
        fading = np.exp(-since / (scales * scale))
        functions[f"direction, {scales:g} after reversal"] = towards * fading
        functions[f"rate, {scales:g} after reversal"] = v * fading
        functions[f"step, {scales:g} after it"] = lagged(step, scales * scale)
        functions[f"|step|, {scales:g} after it"] = lagged(np.abs(step), scales * scale)
    for name in FORCES:
        functions[f"{name}, lagged"] = lagged(lagged(functions[name], scale), scale)
    return functions


def locked_test(records: Sequence[Record]) -> LockedTest:
    """Test errors against functions, all outputs together."""
    by_output: dict[str, list[Record]] = {}
    for record in records:
        by_output.setdefault(record.output, []).append(record)
    every = [them for them in by_output.values() if _samples(them) >= LEAST_SAMPLES]
    if not every:
        return NOTHING_TESTED
    regressions = [_Regression(them) for them in every]
    logs = {log: i for i, log in enumerate(sorted({record.log for record in records}))}
    turns = np.random.default_rng(0).uniform(LEAST_SHIFT, 1.0 - LEAST_SHIFT, (SHIFTS, len(logs)))
    shifts = np.vstack([np.zeros(len(logs)), turns])  # the errors as they are come first
    explained = [
        [regression.explained({log: turn[i] for log, i in logs.items()}) for turn in shifts]
        for regression in regressions
    ]
    white, coloured = np.sum(explained, axis=0).T
    samples = sum(map(_samples, every))
    return LockedTest(
        p_value=float(np.mean(white >= white[0])),
        explained=math.sqrt(max(float(coloured[0] - coloured[1:].mean()), 0.0) / samples),
        share_explained=max(float(white[0] - white[1:].mean()), 0.0) / samples,
        strongest=max((it.strongest() for it in regressions), key=lambda named: named[1])[0],
    )


class _Regression:
    """Of the errors of one output on functions, with the same coefficients in all its logs."""

    def __init__(self, records: Sequence[Record]) -> None:
        self.logs = [record.log for record in records]
        self.names = list(records[0].functions)
        self.cuts = np.cumsum([len(record.errors) for record in records])[:-1]
        errors = np.concatenate([record.errors for record in records])[:, None]
        functions = _scaled(np.vstack([np.column_stack([*r.functions.values()]) for r in records]))
        slopes = np.vstack([record.slopes for record in records])
        known = _span(_scaled(np.column_stack([np.ones(len(errors)), slopes])))
        # that of the errors as they are: what a regression leaves of them looks too white
        self.filter = _autoregression([record.errors for record in records])
        self.errors = self._white(errors)[:, 0]
        self.power = float(np.mean(self.errors**2)) or 1.0
        # what parameters can do has been done by the fit
        whole, done = self._white(functions), self._white(known)
        imitated = np.linalg.lstsq(done, whole, rcond=DEPENDENT)[0]
        left = whole - done @ imitated
        lengths = np.linalg.norm(left, axis=0)
        new = lengths > DEPENDENT * np.linalg.norm(whole, axis=0)
        scale = np.where(new, 1.0 / np.where(new, lengths, 1.0), 0.0)
        self.functions = left * scale
        self.basis, singular, right = np.linalg.svd(self.functions, full_matrices=False)
        self.kept = singular**2 / (singular**2 + RIDGE)
        back = (functions - known @ imitated) * scale @ (right.T * (self.kept / _safe(singular)))
        self.gram = back.T @ back

    def explained(self, shifts: Mapping[int, float]) -> tuple[float, float]:
        """Return squares explained of the whitened errors over their mean, and of the errors
        before whitening.

        ``shifts`` are shares of its length by which each log is shifted, by its number.
        """
        parts = zip(self.logs, np.split(self.errors, self.cuts))
        shifted = [np.roll(part, round(shifts[log] * len(part))) for log, part in parts]
        along = np.concatenate(shifted) @ self.basis
        return float(along**2 @ self.kept) / self.power, float(along @ self.gram @ along)

    def strongest(self) -> tuple[str, float]:
        """Return the function that explains most alone, and how many squares over their mean."""
        alone = (self.functions.T @ self.errors) ** 2 / self.power
        return self.names[int(np.argmax(alone))], float(np.max(alone))

    def _white(self, columns: Array) -> Array:
        """Columns of shape (n, k) through the filter, log by log."""
        return np.vstack([filtered(self.filter, it) for it in np.split(columns, self.cuts)])


def _autoregression(parts: Sequence[Array]) -> Array:
    """Filter, shape (ORDER + 1,), that makes errors white."""
    pasts = [
        np.column_stack([part[ORDER - k : len(part) - k] for k in range(1, ORDER + 1)])
        for part in parts
        if len(part) > ORDER
    ]
    now = np.concatenate([part[ORDER:] for part in parts])
    return np.concatenate([[1.0], -np.linalg.lstsq(np.vstack(pasts), now, rcond=None)[0]])


def filtered(weights: Array, columns: Array) -> Array:
    """Return sum of weights[j] columns[t - j], shape (n, k), with the first row before it as well.

    ``columns`` has the shape (n, k), ``weights`` (order + 1,).
    """
    longer = np.vstack([np.repeat(columns[:1], len(weights) - 1, axis=0), columns])
    return np.asarray(sliding_window_view(longer, len(weights), axis=0) @ weights[::-1])


def _since_reversal(sign: Array) -> tuple[Array, Array]:
    """The direction that motion has or had last, and samples since it turned, inf before."""
    places = np.arange(len(sign))
    towards = sign[np.maximum.accumulate(np.where(sign != 0.0, places, 0))]
    turned = np.concatenate([[False], towards[1:] != towards[:-1]])
    turn = np.maximum.accumulate(np.where(turned, places, -1))
    return towards, np.where(turn >= 0, places - turn, np.inf)


def lagged(signal: Array, samples: float) -> Array:
    """Return a signal of shape (n,) behind a lag of first order, which begins at its first value.

    ``samples`` is the time constant.  The impulse response is convolved by its spectrum.
    """
    n, keep = len(signal), math.exp(-1.0 / samples)
    answer, change = (1.0 - keep) * keep ** np.arange(n), signal - signal[0]
    both = np.fft.rfft(answer, 2 * n) * np.fft.rfft(change, 2 * n)
    return np.asarray(signal[0] + np.fft.irfft(both, 2 * n)[:n])


def _samples(records: Sequence[Record]) -> int:
    return sum(len(record.errors) for record in records)


def _scaled(columns: Array) -> Array:
    """Columns with a mean square of 1, or 0."""
    return np.asarray(columns / _safe(np.sqrt(np.mean(columns**2, axis=0))))


def _span(columns: Array) -> Array:
    """Orthonormal columns of the same span, each with a mean square of 1."""
    left, singular, _ = np.linalg.svd(columns, full_matrices=False)
    return np.asarray(left[:, singular > DEPENDENT * singular[0]] * math.sqrt(len(columns)))


def _safe(divisor: Array) -> Array:
    return np.where(divisor > 0.0, divisor, 1.0)


def _centred(signal: Array) -> Array:
    half = 0.5 * float(np.ptp(signal))
    return np.asarray((signal - signal.min() - half) / (half or 1.0))
