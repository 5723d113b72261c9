"""Estimate transfer functions of many structures and choose the simplest that describes the data.

The rule of choice (parsimony): what has unstable or undamped poles, or a zero that the data
do not tell from a pole, is out.  Among the rest the best one is sought, and then the smallest
that is not significantly worse than it: by the held-out samples if there are any, else by
the Bayesian information criterion.
Source: Ljung, System Identification, 2nd ed., secs. 16.4 to 16.6; Kass and Raftery, Bayes
Factors, J. Am. Stat. Assoc. 90 (1995), for what counts as significant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from servo_models.actuator import Wire, unknown
from servo_models.errors import UserError
from servo_models.grey_box import KNOWN, PhysicalConstants, torque_motor_constants
from servo_models.recording import Log
from servo_models.simulate import Model
from servo_models.transfer.evidence import Evidence, Record, Sweep
from servo_models.transfer.fit import Fit, fit
from servo_models.transfer.functions import STRUCTURES, Structure, TransferFunction
from servo_models.transfer.residuals import inflation
from servo_models.transfer.scores import Score, score
from servo_models.transfer.soundness import pole_trouble, slow_pole, surplus_zero
from servo_models.transfer.starts import band, starts

WORSE = 10.0
"""Difference of the BIC that counts as very strong evidence (Kass and Raftery)."""
SIGNIFICANT = 2.0
"""Held-out losses differ if their mean difference is so many standard errors."""
COLOURED = 0.01
"""Probability below which residuals do not pass for noise."""


Scored = tuple[str, TransferFunction, Fit | None, Score]


@dataclass(frozen=True, eq=False)
class Candidate:
    """A transfer function in the comparison.

    Attributes:
        name: its structure, or the name under which it was given.
        function: the estimate, or what was given.
        fit: its uncertainty; None for a given one.
        score: how its errors look.
        aic, bic: information criteria, less is better.
        reason: why it is rejected; "" for the chosen one.
    """

    name: str
    function: TransferFunction
    fit: Fit | None
    score: Score
    aic: float
    bic: float
    reason: str = ""


@dataclass(frozen=True, eq=False)
class TransferResult:
    """All candidates with verdicts, and the one chosen.

    Attributes:
        source, output: wires that the functions connect.
        evidence: records and frequency responses.
        candidates: in order of size, given ones first.
        chosen: the one without a reason against it.
        constants: physical constants, where the actuator has a grey box.
        warnings: sentences.
    """

    source: Wire
    output: Wire
    evidence: tuple[Evidence, ...]
    candidates: tuple[Candidate, ...]
    chosen: Candidate
    constants: PhysicalConstants | None = None
    warnings: tuple[str, ...] = field(default=())


def identify_transfer(
    logs: Sequence[Log] = (),
    sweeps: Sequence[Sweep] = (),
    *,
    model: Model,
    source: str | None = None,
    output: str | None = None,
    structures: Iterable[Structure] = STRUCTURES,
    given: Mapping[str, TransferFunction] | None = None,
    known_errors: Mapping[str, float] | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> TransferResult:
    """Identify the transfer function between two signals of an actuator.

    Args:
        logs: time records; ``held_out`` samples score, all others fit.
        sweeps: frequency responses; fitted together with the logs, each weighted by its
            own noise.
        model: says what the signals are, and the known constants of a grey box.
        source, output: names of input and output; default the actuator's main input and
            first output.
        structures: to be fitted.
        given: transfer functions to be judged beside the fitted ones, SI.
        known_errors: standard errors of the grey box's known constants, SI by parameter.
        progress: is told the name of each structure before its fit.

    Raises:
        UserError: an unknown signal, no data of it, or no structure that is fit for use.
    """
    ends = _wires(model, source, output)
    evidence = _evidence(logs, sweeps, ends)
    longest = max((float(e.times[-1]) for e in evidence if isinstance(e, Record)), default=None)
    fits = _fits(structures, [e for e in evidence if not np.all(e.rows_held_out)], progress)
    scored: list[Scored] = [(n, f, None, score(f, evidence)) for n, f in (given or {}).items()]
    scored += [(str(f.structure), f.function, f, score(f.function, evidence)) for f in fits]
    judged = _choose(_with_criteria(scored, evidence), longest)
    chosen = next(c for c in judged if not c.reason)
    constants, vague = _grey_box(model, ends, judged, chosen, known_errors)
    warnings = (*_warnings(chosen, longest), *vague, *(constants.warnings if constants else ()))
    return TransferResult(*ends, tuple(evidence), tuple(judged), chosen, constants, warnings)


def _wires(model: Model, source: str | None, output: str | None) -> tuple[Wire, Wire]:
    plant, place = model.plant, f"actuator '{model.actuator.name}'"
    inputs = {wire.name: wire for wire in plant.inputs}
    outputs = {name: plant.wire[name] for name in plant.outputs}
    first, last = source or model.actuator.step[0], output or plant.outputs[0]
    if first not in inputs:
        raise UserError(unknown("input", first, inputs, place))
    if last not in outputs:
        raise UserError(unknown("output", last, outputs, place))
    return inputs[first], outputs[last]


def _evidence(
    logs: Sequence[Log], sweeps: Sequence[Sweep], ends: tuple[Wire, Wire]
) -> list[Evidence]:
    source, output = ends
    rest = source.rest if isinstance(source.rest, float) else 0.0
    found: list[Evidence] = [Record.of(log, source.name, output.name, rest) for log in logs]
    found += [s for s in sweeps if (s.source, s.output) == (source.name, output.name)]
    if not found or all(np.all(one.rows_held_out) for one in found):
        raise UserError(
            f"nothing to fit from '{source.name}' to '{output.name}': give a log or a sweep of"
            " them that is not held out"
        )
    return found


def _fits(
    structures: Iterable[Structure], evidence: Sequence[Evidence], progress: Callable[[str], None]
) -> list[Fit]:
    """Fit every structure, the small ones first since they are starts of the larger ones."""
    noise = [one.noise_guess for one in evidence]
    rows = min(int(np.sum(~one.rows_held_out)) for one in evidence)
    slowest = 1.0 / band(evidence)[0]
    done: dict[Structure, Fit] = {}
    for structure in sorted(structures, key=lambda s: (s.poles, s.delay, s.zeros)):
        if structure.size >= rows:
            continue
        progress(str(structure))
        smaller = [done[s].function for s in _parents(structure) if s in done]
        first = starts(structure, evidence, noise, smaller)
        found = fit(structure, evidence, noise, first, slowest)
        if found:
            done[structure] = found
    return list(done.values())


def _parents(structure: Structure) -> tuple[Structure, ...]:
    n, m = structure.poles, structure.zeros
    parents = [replace(structure, poles=n - 1), replace(structure, zeros=m - 1)]
    if structure.delay:
        parents.append(replace(structure, delay=False))
    return tuple(p for p in parents if p.zeros >= 0)


def _with_criteria(scored: Sequence[Scored], evidence: Sequence[Evidence]) -> list[Candidate]:
    """Add AIC and BIC; correlated errors count as fewer independent ones.

    How correlated the noise is, is read off the candidate with the least errors.
    """
    names = [one.name for one in evidence if not np.all(one.rows_held_out)]
    if not scored:
        raise UserError("too few samples for any structure: record at least 16")

    def unlikelihood(errors: Mapping[str, float], counts: Mapping[str, float]) -> float:
        return sum(2.0 * counts[n] * float(np.log(max(errors[n], 1e-300))) for n in names)

    lengths = {n: float(len(scored[0][3].errors[n])) for n in names}
    least = min(scored, key=lambda item: unlikelihood(item[3].rms, lengths))[3]
    counts = {n: lengths[n] / inflation(least.errors[n]) for n in names}
    total = sum(counts.values())
    found = []
    for name, function, fitted, marks in scored:
        base = unlikelihood(marks.rms, counts)
        size = function.structure.size
        aic, bic = base + 2.0 * size, base + size * float(np.log(total))
        found.append(Candidate(name, function, fitted, marks, aic, bic))
    return found


def _choose(candidates: Sequence[Candidate], longest: float | None) -> list[Candidate]:
    """Return the candidates with the reasons against all but one."""
    unsound = {c.name: _unsound(c, longest) for c in candidates}
    sound = [c for c in candidates if not unsound[c.name]]
    if not sound:
        worst = next(iter(unsound.values()))
        raise UserError(
            f"no structure describes an actuator ({worst}): check input, output and units of the"
            " record, or record longer"
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
        if c is chosen or unsound[c.name]:
            return unsound[c.name]
        larger = c.function.structure.size > chosen.function.structure.size
        if c in good or (larger and not held_out):
            return _needless(c, chosen)
        if held_out:
            return f"misses {_missed(c)} of the held-out samples, '{chosen.name}' {_missed(chosen)}"
        return f"worse than '{chosen.name}': BIC higher by {c.bic - chosen.bic:.4g}"

    return [replace(c, reason=reason(c)) for c in candidates]


def _needless(c: Candidate, chosen: Candidate) -> str:
    more = c.function.structure.size - chosen.function.structure.size
    if not more:
        return f"no better than '{chosen.name}', which has as many coefficients"
    count = "one coefficient" if more == 1 else f"{more} coefficients"
    return f"no better than '{chosen.name}', with {count} more"


def _unsound(c: Candidate, longest: float | None) -> str:
    trouble = pole_trouble(c.function, longest)
    return trouble or (surplus_zero(c.fit) if c.fit else "")


def _missed(c: Candidate) -> str:
    if c.score.held_out is not None:
        return f"{100.0 * (1.0 - c.score.held_out):.3g} %"
    errors = np.concatenate(list(c.score.held_out_errors.values()))
    return f"{100.0 * float(np.sqrt(np.mean(errors**2))):.3g} %"


def _warnings(chosen: Candidate, longest: float | None) -> tuple[str, ...]:
    found = [slow_pole(chosen.function, longest)]
    white, independent = chosen.score.white, chosen.score.independent
    if independent is not None and independent < COLOURED:
        found.append(
            f"the residuals of '{chosen.name}' still depend on the input: something is missing,"
            " such as an effect that is not linear"
        )
    elif white is not None and white < COLOURED:
        found.append(
            f"the residuals of '{chosen.name}' are not white; the standard errors account for it"
        )
    return tuple(text for text in found if text)


def _grey_box(
    model: Model,
    ends: tuple[Wire, Wire],
    candidates: Sequence[Candidate],
    chosen: Candidate,
    known_errors: Mapping[str, float] | None,
) -> tuple[PhysicalConstants | None, tuple[str, ...]]:
    """Constants from the third-order candidate, chosen or not; and what to say of it."""
    if (model.actuator.name, *(wire.name for wire in ends)) != ("torque_motor", "voltage", "angle"):
        return None, ()
    shaped = [c for c in candidates if c.fit and _third_order(c.function.structure)]
    if not shaped:
        return None, ("no third-order candidate: no physical constants",)
    taken = chosen if chosen in shaped else min(shaped, key=lambda c: c.bic)
    assert taken.fit
    known = {name: model.values[name] for name in KNOWN}
    found = torque_motor_constants(
        taken.fit.coefficients, taken.fit.covariance, known, known_errors
    )
    if taken is chosen:
        return found, ()
    return found, (
        f"the physical constants are those of '{taken.name}', which the data do not prefer:"
        f" {taken.reason}",
    )


def _third_order(structure: Structure) -> bool:
    return (structure.poles, structure.zeros) == (3, 0)
