"""When an identification is doubtful: the one rule behind exit code 1 and its reason.

A warning is a sentence.  A ``Doubt`` is one after which the values are not to be used; every way to
identify marks its own so.  Here are those of a fit by simulation: what its errors give, what cannot
be told apart, what no log excites, and what to do about it.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from servo_models.analysis.explain import display_scale, display_unit
from servo_models.core.plant import Parameter
from servo_models.core.types import Array
from servo_models.data.audit import LEAST_GAP, audits, noise_floors
from servo_models.data.sensor import off_neighbours
from servo_models.identification.linear_inference import Spread
from servo_models.identification.problem import FAR_DEVIATIONS, WIDER_PRIOR, Free, Problem
from servo_models.identification.result import Doubt, Identification, doubts
from servo_models.report.numbers import number, with_unit
from servo_models.report.result import Report

HARDLY = 0.7  # error over the standard deviation of a reading, from which a fit does not follow it
WILD_SHARE = 0.02  # share of the readings that are few
WILD_SQUARES = 0.5  # share of the squared errors in these few from which a fit follows them
NAMED = 3  # single readings that a sentence names
ALIKE_CORRELATION = 0.95  # correlation from which two estimates cannot be told apart
ILL_CONDITIONED = 1e3  # largest over smallest singular value of slopes with unit columns
WORST_CONDITION = 1e6  # ratio above which it is rounding
UNDETERMINED = 0.5  # standard error over a parameter's size from which a log does not determine it
PRIOR_ONLY = 0.8  # standard error over the prior from which a log says nothing about a parameter
FAR = 3.0  # way from the prior [standard deviations] from which an estimate has gone too far

STATED_ERRORS = 3.0  # standard errors beyond which a size, or what a value moved by, is stated

ON_LOW, ON_HIGH = BOUNDS = "on its low bound", "on its high bound"
FROM_PRIOR = "from its prior only"
PULLED = "pulled off its prior"
NOT_DETERMINED = "not determined"


def judged(report: Report, warnings: Iterable[str]) -> Report:
    """Return the report, whose first sentence says why its values are doubtful."""
    reasons = doubts(warnings)
    if not reasons:
        return report
    more = f" ({len(reasons) - 1} more below)" if len(reasons) > 1 else ""
    first = reasons[0].partition(";")[0]  # the cure is among the warnings
    sentence = f"Doubtful: {first}{more}. {report.sentence}"
    return replace(report, sentence=sentence, passed=False)


def about_errors(fit: Identification) -> Iterator[Doubt]:
    """Doubts that clipped readings give, and the errors of the fitted model for each output."""
    audited = audits(fit.logs, fit.fitted.plant)
    yield from (Doubt(f"log '{it.log.name}': {text}") for it in audited for text in it.clipped)
    floors = noise_floors(audited)
    for name in fit.sigma:
        left = fit.rms(name, "fit")
        values = [log.outputs[name][log.fitted] for log in fit.logs if name in log.outputs]
        if left > HARDLY * float(np.std(np.concatenate(values))):
            yield Doubt(
                f"the fitted model explains hardly anything of '{name}', so its values say nothing"
                " of this log: check unit, scale and sign of the column, and that the log is of"
                f" '{fit.fitted.actuator.name}'"
            )
        elif left > LEAST_GAP * floors[name] and (rows := _wild(fit, name)):
            yield Doubt(
                f"single readings of '{name}' have most of the squared error, so the fit follows"
                f" them: {rows}; remove these rows, or run 'diagnose' if they are real"
            )
        elif (judged := fit.rms(name, fit.judged_part(name)) / floors[name]) > LEAST_GAP:
            yield Doubt(
                f"the error of '{name}' is {number(judged, 2)} noise floors: the model lacks"
                " something, which the values may make up for and their standard errors do not"
                " include; run 'diagnose', or identify another actuator"
            )


def _wild(fit: Identification, name: str) -> str:
    """The largest of the few single readings with most of the squared error, "" without such."""
    logs, errors, single = [], [], []
    for log, response in zip(fit.logs, fit.after):
        if name in log.outputs:
            error = (log.outputs[name] - response[name])[log.fitted]
            errors.append(error)
            single.append(off_neighbours(error))
            logs += [f"log '{log.name}' row {row}" for row in log.rows[log.fitted]]
    off: Array = np.abs(np.concatenate(single))
    largest = np.argsort(-off)[: max(1, int(WILD_SHARE * len(off)))]
    share = np.sum(off[largest] ** 2) / np.sum(np.concatenate(errors) ** 2)
    return ", ".join(logs[i] for i in largest[:NAMED]) if share > WILD_SQUARES else ""


def is_far(free: Free, value: float, error: float = 0.0) -> bool:
    """Return whether a value [SI] is further from the nominal one than was believed, and known to
    be."""
    return abs(free.moved(value)) > FAR_DEVIATIONS and is_stated(value - free.nominal, error)


def is_stated(distance: float, error: float) -> bool:
    """Return whether a sentence states a size, or a value that moved by so much; on a bound, where
    the standard error is NaN, it does and says so."""
    return not abs(distance) <= STATED_ERRORS * error


def bounded(text: str, doubtful: str) -> str:
    """Return the text of a value with the bound on which it is, if it is ``doubtful`` for that."""
    return f"{text} ({doubtful})" if doubtful in BOUNDS else text


def surprise(parameter: Parameter, nominal: float, value: float, doubtful: str) -> str:
    """Return "'a' is 30 ms, not 5 ms", of values in SI."""
    now, was = (with_display(parameter, it) for it in (value, nominal))
    return f"'{parameter.name}' is {bounded(now, doubtful)}, not {was}"


def with_display(parameter: Parameter, value: float) -> str:
    """Return "30 ms" of a value in SI."""
    return with_unit(number(display_scale(parameter) * value, 3), display_unit(parameter))


def doubt(free: Free, value: float, error: float) -> str:
    """Return in a few words why an estimate is doubtful, "" if it is not; figures in SI."""
    if np.isnan(error):
        return ON_LOW if value - free.low <= free.high - value else ON_HIGH
    if free.prior and error > PRIOR_ONLY * free.prior:
        moved = math.sqrt(max(free.prior**2 - error**2, 0.0))  # how far a fit to noise moves it
        pulled = abs(value - free.nominal) > max(FAR * moved, free.prior)
        return PULLED if pulled else FROM_PRIOR
    # an offset near 0 may be well known: what matters is its usual size, not its value
    size = max(abs(value), free.scale) if free.low < 0.0 < free.high else abs(value)
    return NOT_DETERMINED if error > UNDETERMINED * size else ""


def warnings(problem: Problem, vector: Array, spread: Spread) -> list[str]:
    """Return in words what makes an estimate doubtful, each with its cure.

    One that is known from its prior only still is what was believed before, and an effect that
    ends at 0 is found not to be needed: neither is a ``Doubt``.
    """
    said: list[str] = []
    unseen: list[str] = []
    names = [free.name for free in problem.free]
    for free, value, error, slope, side in zip(
        problem.free,
        vector * problem.scales,
        spread.standard_errors,
        spread.slopes,
        spread.on_bound,
    ):
        reason = doubt(free, value, error)
        if side:
            text = (
                f"'{free.name}' sits on its {side} bound: the data ask for something the model"
                " does not have, or the parameter is not needed"
            )
            said.append(text if free.switch and value == 0.0 else Doubt(text))
        elif slope == 0.0:
            text = (
                f"'{free.name}' is not excited by these logs: where the fit ended, nothing measured"
                " depends on it; begin with another value, or fix it if you know it"
            )
            said.append(text if reason == FROM_PRIOR else Doubt(text))
        elif free.prior and abs(value - free.nominal) > FAR_DEVIATIONS * free.prior:
            said.append(
                Doubt(
                    f"'{free.name}' is {abs(free.moved(value)):.2g} prior deviations away, too far"
                    f" even for a prior {WIDER_PRIOR:g} times as wide: the model lacks something,"
                    " so run 'diagnose', or its nominal value is that of another actuator"
                )
            )
        elif reason == FROM_PRIOR:
            unseen.append(f"'{free.name}'")
        elif reason == PULLED:
            prior = free.prior or 1.0
            said.append(
                Doubt(
                    f"'{free.name}' was pulled {abs(value - free.nominal) / prior:.2g} prior"
                    f" deviations away, though its standard error is {error / prior:.2g} of them:"
                    " do not believe it; the errors are hardly noise, so the model lacks something"
                )
            )
        elif reason == NOT_DETERMINED:
            said.append(
                Doubt(
                    f"the data do not determine '{free.name}': its standard error is"
                    f" {_share(error, value)}; fix it if you know it, give it a prior, or"
                    " excite it more"
                )
            )
    if unseen:
        verb, its = ("is", "its prior") if len(unseen) == 1 else ("are", "their priors")
        said.append(
            f"{', '.join(unseen)} {verb} known from {its} only: these logs say nothing about"
            f" {'it' if len(unseen) == 1 else 'them'}"
        )
    without_prior = [free.name for free in problem.free if free.prior is None]
    said += [together([names[i] for i in group], without_prior) for group in spread.groups]
    said += [
        Doubt(
            f"'{names[j]}' and '{names[i]}' cannot be told apart by these logs"
            f" (correlation {spread.correlations[i, j]:+.3f}): fix one that you know, or log an"
            " experiment that moves only one"
        )
        for i, j in correlated(problem.free, spread.correlations)
        if not any({i, j} <= set(group) for group in spread.groups)
    ]
    if spread.condition > ILL_CONDITIONED:
        told = f"{spread.condition:.0f}"
        if spread.condition >= WORST_CONDITION:
            told = f"more than {WORST_CONDITION:.0e}"
        text = f"the fit is ill-conditioned ({told}): some combination of parameters is free"
        said.append(Doubt(f"{text}; fix one that you know"))
    return said


def _share(error: float, value: float) -> str:
    """A standard error as part of a value, in words."""
    share = error / max(abs(value), 1e-300)
    if share < 10.0:
        return f"{100.0 * share:.0f} % of its value"
    return f"{share:.0f} times its value" if share < 1e6 else "without bounds"


def together(names: Sequence[str], without_prior: Container[str]) -> str:
    """Return in words that logs show parameters only together, and the cure where one is needed.

    Args:
        names: of the parameters.
        without_prior: those that nothing else is known of; up to one, the others say where it is.
    """
    *some, last = [f"'{name}'" for name in names]
    each = f"{', '.join(some)} and {last}"
    if sum(name in without_prior for name in names) < 2:
        return f"these logs show {each} only together: what each is alone, the priors say"
    return (
        f"{each} cannot be told apart by these logs: they can change together and leave every"
        " output as it is; fix one that you know, or log an experiment that moves only one"
    )


def correlated(free: Sequence[Free], correlations: Array) -> list[tuple[int, int]]:
    """Return pairs of estimates that hang together and neither of which a prior tells."""
    return [
        (i, j)
        for i in range(len(free))
        for j in range(i)
        if abs(correlations[i, j]) > ALIKE_CORRELATION  # False for NaN
        and free[i].prior is None
        and free[j].prior is None
    ]
