"""What a diagnosis says of a case, and what could have been said of it.

A diagnosis sees the description and its logs.  The oracle knows the answer and the logs without
noise, and begins its fits at the truth.

Where the logs hardly tell the truth from something else, to miss it is no fault of a
diagnosis.  So the truth and its rivals are fitted to the noise-free logs, the hidden effect
of a case, if there is one, switched on as it is.  A rival is *seen* if an ideal observer who
knows both fitted responses would confuse them in the noise of the case in fewer than 1 of 160
cases: their squared errors differ by at least 5^2 = 25 times the noise power of one
independent sample.  The truth is

* *separated* from a rival that is seen, if it leaves less than half of the rival's RMS error
  as well: laws of the generator are other ones than the product's, so the truth leaves an
  error too;
* *absorbed* if nominal parameters alone are a rival that is not seen.

Source: Kay, Fundamentals of Statistical Signal Processing II (1998), sec. 4.3: two known
signals at a distance of d standard deviations are confused with probability Q(d/2).
Both numbers were set before any diagnosis was scored.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import permutations
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from msgspec import field
from msgspec.structs import asdict

from servo_models.core.workers import Workers
from servo_models.data.description import Description, read_description
from servo_models.data.log import Log
from servo_models.data.readers import read_columns
from servo_models.diagnosis.diagnose import Diagnosis, diagnose
from servo_models.diagnosis.schema import KINDS
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.crossval import dispersion
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.joint_fits import fit_with
from servo_models.diagnosis.search.screening import Screened, likeliest, screen
from servo_models.diagnosis.verdict import NO_GAP
from servo_models.errors import UserError
from servo_models.identification.problem import Problem, prior_parameters
from servo_models.report.document import Document, Figure, Magnitude, choice

FAILED = "failed"
HALF = 0.5
DISTANCE = 5.0
RIVALS = 4  # nearest rivals that are fitted, of those that the diagnosis has tried


class Diagnosed(Document, frozen=True):
    """What a diagnosis said of a case.

    Attributes:
        case: its name.
        verdict: one of the six, or ``"failed"``, with ``why``.
        seconds: that it took, files read included.
        named: effects of the fitted model at first place, none where there is no gap.
        members: effects of the set that cannot be told apart.
        chances: model weight of each effect, by name: the shares of the fitted models that have it.
        probabilities: that are told of them, by name; none outside the catalogue.
        tried: effects of every fitted model that was fitted, best first.
        left: held-out error [noise floors] that each of them leaves.
        values: free parameters [SI] of each of them, by name.
        floors: noise floor [SI] by output.
        imitated: effects that re-tuned parameters are said to imitate, None where that was not
            looked at.
        before, after: held-out error [noise floors] of the nominal model and of the one named.
    """

    case: str
    verdict: Annotated[str, choice(*KINDS, FAILED)]
    seconds: Magnitude
    why: str = ""
    named: list[str] = field(default_factory=list)
    members: list[str] = field(default_factory=list)
    chances: dict[str, float] = field(default_factory=dict)
    probabilities: dict[str, float] = field(default_factory=dict)
    tried: list[list[str]] = field(default_factory=list)
    left: list[Figure] = field(default_factory=list)
    values: list[dict[str, float]] = field(default_factory=list)
    floors: dict[str, float] = field(default_factory=dict)
    before: float = 0.0
    after: float = 0.0
    imitated: list[str] | None = None


class Known(Document, frozen=True):
    """What could have been said of a case.

    Attributes:
        case: its name.
        truth: error [noise floors] that the truth leaves in the noise-free logs, 0 for a cause
            outside the catalogue; None where nothing could be fitted since the diagnosis failed.
        parameters: that of nominal parameters alone.
        rival: that of the best rival, and ``rival_effects`` its effects, none for nominal
            parameters alone.
        separated: from its best rival.
        absorbed: not separated from nominal parameters alone: they imitate the truth.
        after: held-out error [noise floors] of the product's own fit to the noisy logs when told
            the names; None for a cause outside the catalogue.
        without: verdict with the truth left out of the catalogue; "" where that is not asked.
    """

    case: str
    truth: float | None
    parameters: float
    rival: float
    rival_effects: list[str]
    separated: bool
    absorbed: bool
    after: float | None
    without: str


@dataclass(frozen=True)
class Question:
    """A case to be judged: the folder of all cases, its answer, and what was said of it.

    ``left_out`` asks for another diagnosis, with the truth left out of the catalogue.
    """

    folder: Path
    answer: dict[str, Any]
    said: Diagnosed
    left_out: bool = True


def diagnose_case(folder: Path) -> dict[str, Any]:
    """Diagnose the case in a folder; returns a ``Diagnosed`` as a dictionary.

    Whatever goes wrong is an answer too, and a wrong one: the other cases go on.
    """
    begin = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = diagnose(folder / "description.toml", jobs=1)
    except Exception as error:  # a crash is a figure of the diagnosis, not of this run
        why = f"{type(error).__name__}: {error}" if not isinstance(error, UserError) else str(error)
        return asdict(Diagnosed(folder.name, FAILED, time.perf_counter() - begin, why))
    return asdict(said_of(folder.name, found, time.perf_counter() - begin))


def said_of(case: str, found: Diagnosis, seconds: float) -> Diagnosed:
    """Return what a diagnosis says of a case."""
    selection, verdict = found.selection, found.verdict
    tried = sorted(selection.tried, key=lambda one: one.evidence.rms)
    return Diagnosed(
        case=case,
        verdict=verdict.kind,
        seconds=seconds,
        named=[] if verdict.kind == NO_GAP else list(selection.taken.effects),
        members=list(verdict.members),
        chances=verdict.weights,
        probabilities=found.probabilities,
        tried=[list(one.effects) for one in tried],
        left=[one.evidence.rms for one in tried],
        values=[one.values for one in tried],
        floors=found.floors,
        before=selection.before.rms,
        after=selection.taken.evidence.rms,
        imitated=[one.name for one in found.masked],
    )


def seen(truth: float, rival: float, samples: int, noise: float) -> bool:
    """Return whether an ideal observer sees a rival of the truth, see the top of this file.

    Args:
        truth, rival: RMS errors in the noise-free logs [noise floors].
        samples: of the logs, all outputs counted.
        noise: mean square of the noise times the samples of which one is independent.
    """
    distance = samples * (rival * rival - truth * truth) / noise
    return distance >= DISTANCE * DISTANCE


def ask_oracle(question: Question) -> dict[str, Any]:
    """Return the ``Known`` of a case as a dictionary."""
    said, answer = question.said, question.answer
    if not said.floors:
        return asdict(Known(said.case, None, 0.0, 0.0, [], True, False, None, ""))
    with warnings.catch_warnings(), Workers(1):
        warnings.simplefilter("ignore")
        return asdict(_known(question, [it["name"] for it in answer["effects"]]))


def _known(question: Question, names: Sequence[str]) -> Known:
    said, foreign = question.said, question.answer["kind"] == "foreign"
    noisy, clean = _logs(question)
    fitter, measured = fitter_of(clean, said), fitter_of(noisy, said)
    true = {**question.answer["parameters"], **_parameters(question.answer["effects"])}
    truth = 0.0 if foreign else _error(fit_from(fitter, names, true))
    hidden = [it["name"] for it in question.answer["hidden"]]
    found = dict(zip(map(tuple, said.tried), said.values))
    nearest = rivals(said, () if foreign else names, hidden)
    others = [fit_from(fitter, it, found[tuple(it)]) for it in nearest]
    # one search may stop short where what parameters alone can do is asked
    begins = [true, *(it.values for it in sorted(others, key=_error)[:2])]
    retuned = min([fitter.fit((), ()), *(fit_from(fitter, (), it) for it in begins)], key=_error)
    best = min([retuned, *others], key=_error)
    samples, vector = retuned.problem.samples, retuned.evidence.vector
    apart = Problem(fitter.model, noisy.logs, fitter.nominal, dict(fitter.floors)).residuals(vector)
    noise = dispersion((apart - retuned.problem.residuals(vector))[:samples])
    separated = seen(truth, _error(best), samples, noise) and truth < HALF * _error(best)
    after, without = None, ""
    if not foreign:
        named = set(said.named) == set(names)  # to be told what one knows changes nothing
        fit = None if named else told(measured, names, measured.fit((), ()))
        after = fit.evidence.rms if fit else said.after
    if question.left_out and len(names) == 1 and separated and not foreign:
        without = diagnose(noisy, jobs=1, left_out=names).verdict.kind
    return Known(
        case=said.case,
        truth=truth,
        parameters=_error(retuned),
        rival=_error(best),
        rival_effects=list(best.effects),
        separated=separated,
        absorbed=not seen(truth, _error(retuned), samples, noise),
        after=after,
        without=without,
    )


def rivals(said: Diagnosed, names: Iterable[str], hidden: Iterable[str]) -> list[list[str]]:
    """Return the nearest fitted models tried that are not the truth, with no more effects.

    A cause outside the catalogue has no names, and every fitted model is a rival.
    """
    truth, on = set(names), set(hidden)
    most = len(truth) or 2
    others = [it for it in said.tried if len(it) <= most and not on & set(it)]
    return [it for it in others if not truth or set(it) != truth][:RIVALS]


def fit_from(fitter: Fitter, names: Sequence[str], values: Mapping[str, float]) -> FittedModel:
    """Return the fit of some effects that begins at these values [SI]."""
    nominal = tuple(replace(free, start=values[free.name]) for free in fitter.nominal)
    every = candidates(fitter.model, fitter.logs)
    extra = [free for one in every if one.name in names for free in one.at(dict(values))]
    return replace(fitter, nominal=nominal).fit(tuple(names), extra)


def _parameters(effects: Iterable[dict[str, Any]]) -> dict[str, float]:
    return {name: value for it in effects for name, value in it["parameters"].items()}


def told(fitter: Fitter, names: Sequence[str], retuned: FittedModel) -> FittedModel:
    """Return the product's own fit when told the names of one or two effects.

    Two effects are fitted one beside the other, in either order; where an effect moves nothing, it
    is the fit without.
    """
    found = [retuned]
    for order in permutations(names):
        fitted_model = retuned
        for name in order:
            results = _screened([name], fitted_model)
            if results:
                fitted_model = fit_with(fitter, fitted_model, likeliest(results))
                found.append(fitted_model)
    return min(found, key=_error)


def _screened(names: Iterable[str], first: FittedModel) -> list[Screened]:
    """Sizes of some effects, those that explain most first."""
    model, wanted = first.problem.model, set(names)
    every = candidates(model, first.problem.logs)
    return screen((first.linearised,), [one for one in every if one.name in wanted])


def _error(fitted_model: FittedModel) -> float:
    """RMS error [noise floors] of a fit to everything: nothing can be learnt by heart here."""
    return float(np.sqrt(np.mean(fitted_model.evidence.errors**2)))


def fitter_of(told: Description, said: Diagnosed) -> Fitter:
    """Return the fitter of a diagnosis, with the noise floors that it took."""
    return Fitter(told.model, told.logs, prior_parameters(told), dict(said.floors)).surveyed()


def _logs(question: Question) -> tuple[Description, Description]:
    """The description of a case, and the same with noise-free logs and the hidden effect."""
    noisy = read_description(question.folder / "cases" / question.said.case / "description.toml")
    files = {Path(name).name: question.folder / name for name in question.answer["noise_free"]}
    logs = tuple(_without_noise(log, files[log.path.name]) for log in noisy.logs)
    on = {**noisy.model.values, **_parameters(question.answer["hidden"])}
    return noisy, replace(noisy, logs=logs, model=replace(noisy.model, values=on))


def _without_noise(log: Log, path: Path) -> Log:
    """A log with the outputs of another file with the same rows and columns.

    Without noise a quantised reading may stand still, which no description of logs allows.
    """
    columns, outputs = read_columns(path), {}
    for name in log.outputs:
        channel = log.channels[name]
        outputs[name] = channel.scale * columns.numbers(channel.column) + channel.offset
    return replace(log, outputs=outputs)
