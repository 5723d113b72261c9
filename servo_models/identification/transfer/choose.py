"""Judge candidate transfer functions and choose one: parsimony.

What has unstable or undamped poles, or a zero that the data do not tell from a pole, is out.
Among the rest the best one is sought, and then the smallest that is not significantly worse
than it: by the held-out samples if there are any, else by the Bayesian information criterion.
Source: Ljung, System Identification, 2nd ed., secs. 16.4 to 16.6; Kass and Raftery, Bayes
Factors, J. Am. Stat. Assoc. 90 (1995), for what counts as significant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from servo_models.analysis.statistics import inflation
from servo_models.errors import UserError
from servo_models.identification.transfer.evidence import Evidence
from servo_models.identification.transfer.fit import Fit
from servo_models.identification.transfer.functions import TransferFunction
from servo_models.identification.transfer.scores import Score
from servo_models.identification.transfer.soundness import pole_trouble, slow_pole, surplus_zero

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
        fault: what disqualifies it however well it fits, "" for nothing.
        reason: why it is rejected; "" for the chosen one.
    """

    name: str
    function: TransferFunction
    fit: Fit | None
    score: Score
    aic: float
    bic: float
    fault: str = ""
    reason: str = ""


def with_criteria(scored: Sequence[Scored], evidence: Sequence[Evidence]) -> list[Candidate]:
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
    found = [slow_pole(chosen.function, longest)]
    likely = min(candidates, key=lambda c: c.bic)
    if likely.fault and chosen.bic - likely.bic > WORSE:
        found.append(f"'{likely.name}' fits better than '{chosen.name}', but: {likely.fault}")
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
