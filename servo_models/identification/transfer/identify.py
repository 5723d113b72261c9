"""Transfer functions of many structures from records and sweeps, and the one that will do.

What has unstable or undamped poles is out.  Among the rest the best one is sought, and then the
smallest that is not significantly worse than it: by the held-out samples if there are any, else by
the Bayesian information criterion.  So a zero that only cancels a pole is not chosen.
Sources: Ljung, System Identification, 2nd ed., secs. 16.4 to 16.6; Kass and Raftery, Bayes
Factors, J. Am. Stat. Assoc. 90 (1995), for what counts as significant.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.analysis.statistics import inflation, rms, whiteness
from servo_models.core.plant import GreyBox, Wire, check_known
from servo_models.core.simulate import Model
from servo_models.core.stop import Tell, silent
from servo_models.core.types import Array
from servo_models.data.log import Log
from servo_models.errors import UserError
from servo_models.identification.grey_box import Constant, PhysicalConstants, physical_constants
from servo_models.identification.result import Doubt
from servo_models.identification.transfer.fit import Fit, fit
from servo_models.identification.transfer.functions import STRUCTURES, Structure, TransferFunction
from servo_models.identification.transfer.measurements import (
    Measurement,
    Measurements,
    Record,
    Sweep,
)
from servo_models.report.numbers import plural
from servo_models.report.result import Result

WORSE = 10.0  # difference of the BIC that is very strong evidence (Kass and Raftery)
COLOURED = 0.01  # probability below which residuals do not pass for noise


@dataclass(frozen=True, eq=False)
class Candidate:
    """A transfer function in the comparison.

    Attributes:
        name: its structure.
        covariance: of its coefficients, SI.
        errors, held_out_errors: by name of the measurements; SI for records; for frequency
            responses logarithm of gain, then phase [rad].
        fit, held_out: share of the records' movement that is described, 1 for all of it,
            on fitted and on held-out samples; None without any.
        white: least probability, over the records, of such autocorrelations in white noise; None
            without records.
        bic: information criterion, less is better.
        fault: what disqualifies it however well it fits, "" for nothing.
        reason: why it is rejected; "" for the chosen one.
    """

    name: str
    function: TransferFunction
    covariance: Array
    errors: Mapping[str, Array]
    held_out_errors: Mapping[str, Array]
    fit: float | None
    held_out: float | None
    white: float | None
    bic: float = np.inf
    fault: str = ""
    reason: str = ""

    @classmethod
    def of(
        cls,
        name: str,
        function: TransferFunction,
        covariance: Array,
        measurements: Measurements,
    ) -> Candidate:
        """Compare a function with all measurements."""
        with np.errstate(all="ignore"):
            every = [(data, data.errors(function)[0]) for data in measurements]
        records = [(data, errors) for data, errors in every if isinstance(data, Record)]
        return cls(
            name,
            function,
            covariance,
            errors={data.name: errors[data.fitted] for data, errors in every},
            held_out_errors={data.name: errors[~data.fitted] for data, errors in every},
            fit=_described([(r.measured[r.fitted], e[r.fitted]) for r, e in records]),
            held_out=_described([(r.measured[r.held_out], e[r.held_out]) for r, e in records]),
            white=min((whiteness(e, r.fitted) for r, e in records if r.fitted.any()), default=None),
        )

    @property
    def standard_errors(self) -> Array:
        """Of ``function.coefficients``."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def size(self) -> int:
        return self.function.structure.size

    @property
    def rms(self) -> dict[str, float]:
        """Root mean square of the fitted errors by measurements."""
        return {name: rms(e) for name, e in self.errors.items() if len(e)}


def _described(pairs: Sequence[tuple[Array, Array]]) -> float | None:
    """1 - norm of the errors over norm of the movement, over all (measured, errors)."""
    missed = sum(float(np.sum(errors**2)) for _, errors in pairs)
    moved = sum(float(np.sum((y - np.mean(y)) ** 2)) for y, _ in pairs if len(y))
    return 1.0 - float(np.sqrt(missed / moved)) if moved > 0.0 else None


@dataclass(frozen=True, eq=False, repr=False)
class TransferResult(Result):
    """All candidates in order of size, and the one chosen, from ``source`` to ``output``; physical
    constants where the actuator has a grey box; warnings as sentences."""

    source: Wire
    output: Wire
    measurements: tuple[Measurement, ...]
    candidates: tuple[Candidate, ...]
    chosen: Candidate
    constants: PhysicalConstants | None = None
    warnings: tuple[str, ...] = ()


def identify_transfer(
    logs: Sequence[Log] = (),
    sweeps: Sequence[Sweep] = (),
    *,
    model: Model,
    source: str | None = None,
    output: str | None = None,
    structures: Iterable[Structure] = STRUCTURES,
    known_errors: Mapping[str, float] | None = None,
    progress: Tell = silent,
) -> TransferResult:
    """Identify the transfer function between two signals of an actuator.

    Logs and sweeps are fitted together, each weighted by its own noise; what is held out scores.

    Args:
        model: says what the signals are, and the known constants of a grey box.
        source, output: default the variant's command and first output.
        known_errors: standard errors of the grey box's known constants, SI by parameter.
        progress: is told the name of each structure before its fit.

    Raises:
        UserError: an unknown signal, no data of it, or no structure that is fit for use.
    """
    plant, place = model.plant, f"actuator '{model.actuator.name}'"
    source, output = source or model.step[0], output or plant.outputs[0]
    inputs = {wire.name: wire for wire in plant.inputs}
    check_known("input", [source], inputs, place)
    check_known("output", [output], plant.outputs, place)
    rest = inputs[source].rest
    equilibrium = rest if isinstance(rest, float) else 0.0
    records = [Record.of(log, source, output, equilibrium) for log in logs]
    others = [sweep for sweep in sweeps if (sweep.source, sweep.output) != (source, output)]
    measurements: tuple[Measurement, ...] = (
        *records,
        *(sweep for sweep in sweeps if sweep not in others),
    )
    used = [data for data in measurements if data.fitted.any()]
    if not used:
        raise UserError(
            f"nothing to fit from '{source}' to '{output}': give a log or a sweep of them that is"
            " not held out"
        )
    fits = _fits(structures, used, progress)
    tried = [Candidate.of(str(s), *fitted, measurements) for s, fitted in fits.items()]
    longest = max((float(record.times[-1]) for record in records), default=None)
    candidates = choose(tried, measurements, longest)
    chosen = next(c for c in candidates if not c.reason)
    told = [
        *(
            f"'{sweep.name}' is from '{sweep.source}' to '{sweep.output}', and is left out of what"
            f" is fitted from '{source}' to '{output}'"
            for sweep in others
        ),
        *warnings(chosen, candidates, longest),
    ]
    constants, box = None, model.actuator.grey_box
    if box and (box.source, box.output) == (source, output):
        constants, doubts = _constants(model, box, candidates, chosen, known_errors)
        told += [*doubts, *(constants.warnings if constants else ())]
    return TransferResult(
        inputs[source],
        plant.wire[output],
        measurements,
        tuple(candidates),
        chosen,
        constants,
        tuple(told),
    )


def _fits(
    structures: Iterable[Structure],
    measurements: Measurements,
    progress: Tell,
) -> dict[Structure, Fit]:
    """Fit every structure, the small ones first."""
    rows = min(int(np.sum(data.fitted)) for data in measurements)
    done: dict[Structure, Fit] = {}
    for structure in sorted(structures, key=lambda s: (s.poles, s.delay, s.zeros)):
        if structure.size < rows:
            progress(str(structure))
            undelayed, _ = done.get(replace(structure, delay=False), (None, None))
            if fitted := fit(structure, measurements, undelayed):
                done[structure] = fitted
    return done


def _constants(
    model: Model,
    box: GreyBox,
    candidates: Sequence[Candidate],
    chosen: Candidate,
    known_errors: Mapping[str, float] | None,
) -> tuple[PhysicalConstants | None, list[str]]:
    """Constants from the candidate that the grey box solves, chosen or not, within the bounds of
    the actuator; and what to say of them."""
    shaped = [
        c for c in candidates if replace(c.function.structure, delay=False) == Structure(box.poles)
    ]
    sound = [c for c in shaped if not c.fault]
    if not sound:
        faults = "; ".join(f"'{c.name}': {c.fault}" for c in shaped) or "none was asked for"
        text = f"no physical constants, since no function of order {box.poles} will do ({faults})"
        return None, [text]
    taken, doubts = chosen if chosen in sound else min(sound, key=lambda c: c.bic), list[str]()
    found = physical_constants(
        box, taken.function.coefficients, model.values, taken.covariance, known_errors
    )
    constants = dict(found.constants)
    if model.values.get(box.delay):  # of the variant, which would stay where the function has none
        constants.setdefault(box.delay, Constant(box.delay, 0.0, None))
    for name, constant in constants.items():
        param = model.plant.parameters[name].param
        value = min(max(constant.value, param.low), param.high)
        if value != constant.value:
            constants[name] = replace(constant, value=value, standard_error=None)
            text = (
                f"'{name}' was found at {constant.value:.3g} {param.unit} and is taken as"
                f" {value:g}, on its bound: the constants no longer make this function; check those"
                " that are known"
            )
            doubts.append(Doubt(text))
    if taken is not chosen:
        doubts.append(
            f"the physical constants are those of '{taken.name}', which the data do not prefer:"
            f" {taken.reason}"
        )
    return replace(found, constants=constants), doubts


def choose(
    candidates: Sequence[Candidate], measurements: Measurements, longest: float | None
) -> list[Candidate]:
    """Return the candidates with BIC, faults, and the reasons against all but one; the longest
    record lasts ``longest`` [s], None without records."""
    rated = _rated(candidates, measurements)
    checked = [replace(c, fault=pole_trouble(c.function, longest)) for c in rated]
    sound = [c for c in checked if not c.fault]
    if not sound:
        raise UserError(
            f"no structure describes an actuator ({checked[0].fault}): check input, output and"
            " units of the record, or record longer"
        )
    likely = min(sound, key=lambda c: c.bic)
    good = [c for c in sound if c.bic - likely.bic <= WORSE]
    hidden = any(map(len, likely.held_out_errors.values()))
    if hidden:
        losses = {c.name: _losses(c, likely) for c in sound}
        least = min(losses.values(), key=np.mean)
        more = [losses[c.name] - least for c in sound]
        errors = [np.std(loss) / np.sqrt(max(len(loss) - 1, 1)) for loss in more]
        good = [c for c, loss, e in zip(sound, more, errors) if np.mean(loss) <= 2.0 * e]
    chosen = min(good, key=lambda c: (c.size, c.bic))

    def reason(c: Candidate) -> str:
        if c is chosen or c.fault:
            return c.fault
        more = c.size - chosen.size
        if c in good or (more > 0 and not hidden):
            ending = f"with {plural(more, 'coefficient')} more" if more else "of equal size"
            return f"no better than '{chosen.name}', {ending}"
        if hidden:
            ratio = np.sqrt(np.mean(losses[c.name]) / np.mean(losses[chosen.name]))
            return f"its held-out error is {ratio:.3g} times that of '{chosen.name}'"
        return f"worse than '{chosen.name}': BIC higher by {c.bic - chosen.bic:.4g}"

    return [replace(c, reason=reason(c)) for c in checked]


def _losses(c: Candidate, likely: Candidate) -> Array:
    """Squares of the held-out errors over the noise of the likeliest candidate, as means of blocks:
    neighbours are not independent."""
    hidden = {name: e for name, e in c.held_out_errors.items() if len(e)}
    noise = {name: likely.rms.get(name, rms(likely.held_out_errors[name])) for name in hidden}
    joined = np.concatenate([(e / noise[name]) ** 2 for name, e in hidden.items()])
    return np.array([np.mean(block) for block in np.array_split(joined, min(20, len(joined)))])


def _rated(candidates: Sequence[Candidate], measurements: Measurements) -> list[Candidate]:
    """Add the BIC; correlated errors count as fewer independent ones, as correlated as those of the
    candidate with the least."""
    if not candidates:
        raise UserError("too few samples for any structure: record at least 16")
    names = [data.name for data in measurements if data.fitted.any()]
    logarithms = 2.0 * np.log([[max(c.rms[name], 1e-300) for name in names] for c in candidates])
    lengths = np.array([len(candidates[0].errors[name]) for name in names], dtype=float)
    least = candidates[int(np.argmin(logarithms @ lengths))]
    counts = lengths / np.array([inflation(least.errors[name]) for name in names])
    price = float(np.log(np.sum(counts)))
    return [replace(c, bic=b + price * c.size) for c, b in zip(candidates, logarithms @ counts)]


def warnings(
    chosen: Candidate, candidates: Sequence[Candidate], longest: float | None
) -> Iterator[str]:
    """Return sentences on the chosen one: a pole too slow, a better fit that is unsound, residuals
    that are no noise."""
    slow = [p for p in chosen.function.poles if longest and abs(p.real) * longest < 1.0]
    for pole in [p for p in slow if p.imag == 0.0][:1]:
        yield (
            f"the pole at {_shown(pole)} rad/s is slower than the longest record ({longest:.3g} s):"
            " the static gain is not determined; record longer, or take it as an integrator"
        )
    likely = min(candidates, key=lambda c: c.bic)
    if likely.fault and chosen.bic - likely.bic > WORSE:
        yield f"'{likely.name}' fits better than '{chosen.name}', but: {likely.fault}"
    if chosen.white is not None and chosen.white < COLOURED:
        yield (
            f"the residuals of '{chosen.name}' are not white: the standard errors account for it;"
            " the noise is coloured, or something is missing, such as an effect that is not linear"
        )


def pole_trouble(function: TransferFunction, longest: float | None) -> str:
    """Return why poles are not those of an actuator that the longest record [s] shows, or ""."""
    for pole in sorted(function.poles, key=lambda p: -p.real):
        size, oscillates = abs(pole), pole.imag != 0.0
        place = f"poles at {_shown(pole)} rad/s"
        if oscillates and abs(pole.real) < 0.01 * size:
            return f"undamped: {place}, damping ratio {-pole.real / size:.2g}, never settle"
        if pole.real > 0.0 and not (longest and size * longest < 0.1):
            return f"unstable: a pole at {_shown(pole)} rad/s"
        settling = 4.0 / abs(pole.real) if oscillates else 0.0  # to within 2 %
        if longest and longest < settling:
            return (
                f"undamped within the record: {place} settle in {settling:.3g} s, the longest"
                f" record lasts {longest:.3g} s"
            )
    return ""


def _shown(root: complex) -> str:
    if root.imag == 0.0:
        return f"{root.real:.5g}"
    real = f"{root.real:.5g} " if abs(root.real) > 1e-6 * abs(root) else ""
    return f"{real}+-{abs(root.imag):.5g}j"
