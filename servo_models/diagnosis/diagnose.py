"""Diagnose the gap between a model and logs: what ``servo-models diagnose`` does."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from servo_models.core.plant import check_known
from servo_models.core.stop import Stop, Tell
from servo_models.core.workers import Workers
from servo_models.data.audit import LEAST_GAP, Audit, audits, noise_floors, noise_origins
from servo_models.data.description import Description, read_description
from servo_models.diagnosis import confirm
from servo_models.diagnosis.gap import gaps, whole_gap
from servo_models.diagnosis.preconditions import check_duration, without_flags
from servo_models.diagnosis.ranking import estimates, probabilities, ranked_effects
from servo_models.diagnosis.residual_map import learn
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.search.fitting import FittedModel, Fitter
from servo_models.diagnosis.search.selection import select_effects
from servo_models.diagnosis.settings import DEFAULT, Settings
from servo_models.diagnosis.stretches import Part, contradicted, held_out_scores, unlike_parts
from servo_models.diagnosis.verdict import OUTSIDE, decide
from servo_models.errors import UserError
from servo_models.identification.fit import checked_logs
from servo_models.identification.plausibility import (
    FAR_BETTER,
    error,
    implausible_clocks,
    likely,
    mended,
    questions,
    tried,
)
from servo_models.identification.problem import prior_parameters
from servo_models.identification.simulation import InternalSteps

__all__ = ["Diagnosis", "diagnose"]

BETWEEN_ROWS, PARTS = "commands between rows", "each part by itself"
SHAPE = "the shape of what is left"


def diagnose(
    description: Description | str | Path,
    tolerance: float = LEAST_GAP,
    seed: int = 0,
    jobs: int | None = None,
    left_out: Iterable[str] = (),
    tell: Tell | None = None,
    fmu: bool = False,
    time_limit: float | None = None,
    quick: bool = False,
    settings: Settings = DEFAULT,
) -> Diagnosis:
    """Find out where a gap lies, what causes it and how far it closes.

    Args:
        description: model, uncertainties of its parameters and logs; or its TOML file.
        tolerance: gap in noise floors that counts as none.
        seed: of intervals and random commands.
        jobs: simulations at once, by default the processors there are.
        left_out: effects that are not considered.
        tell: is told what goes on.
        fmu: run the diagnosed model as an FMU as well; where that cannot be, the result says why.
        time_limit: time [s] after which the search ends; the best so far is fitted to the end and
            told, with what was not tried (``unfinished``).  So it is after Ctrl-C; a second one
            raises ``KeyboardInterrupt``.
        quick: end the search in the same way once the effects were fitted alone.
        settings: what decides verdicts, and how much is tried.

    Raises:
        UserError: an effect to be left out that the actuator has not, a tolerance or a time limit
            below 0 or not finite; see ``read_description``,
            ``identification.fit.checked_logs`` and ``diagnosis.preconditions``.

    Example:
        >>> import servo_models as sm
        >>> found = sm.diagnose("gimbal.toml")
        >>> [effect.name for effect in found.ranking if effect.taken]
        ['drive_dead_zone']
        >>> found.write_report("gimbal.html")
        >>> found.tables()["Effects, most likely first"]["effect"][0]
        'drive_dead_zone'
        >>> sm.write_parameters(found.parameter_set(), "GAP.toml")
    """
    if time_limit is not None and not 0.0 < time_limit < math.inf:
        raise UserError(f"time limit {time_limit}: give a number of seconds above 0")
    stop = Stop(math.inf if time_limit is None else time_limit, quick)
    told = description if isinstance(description, Description) else read_description(description)
    left_out = [left_out] if isinstance(left_out, str) else list(left_out)
    check_known("effect", left_out, told.model.plant.placements, "left_out")
    if not 0.0 <= tolerance < math.inf:
        raise UserError(f"tolerance {tolerance}: give a number of noise floors, 0 or more")
    logs, flags = without_flags(told.logs, told.model.plant)
    logs = checked_logs(told.model, logs, len(prior_parameters(told)), told.path)
    told = replace(told, logs=logs)
    check_duration(told.model, told.logs)
    if len(clocks := implausible_clocks(told)) == len(told.logs):  # a search would take hours
        raise UserError("; ".join(clocks))
    with stop:
        with Workers(jobs) as workers:
            diagnosis = _diagnose(told, tolerance, seed, workers, left_out, tell, stop, settings)
        diagnosis = replace(diagnosis, flags=flags)
        if fmu and (diagnosis.within_tolerance or not stop.passed):
            diagnosis = _confirmed(diagnosis, tell)
        elif fmu:
            diagnosis = replace(diagnosis, unfinished=(*diagnosis.unfinished, "the run of its FMU"))
    if diagnosis.within_tolerance or not stop.passed:
        return diagnosis
    return diagnosis.without_next(stop.why)


def _fitter(
    told: Description, floors: dict[str, float], workers: Workers, stop: Stop, settings: Settings
) -> Fitter:
    return Fitter(
        told.model,
        told.logs,
        prior_parameters(told),
        floors,
        workers,
        steps=InternalSteps(told.model, floors, stop),
        settings=settings,
        wide=prior_parameters(told, settings.wider_prior),
    )


def _mistake(
    told: Description, asked: Sequence[Audit], fitter: Fitter, best: FittedModel, stop: Stop
) -> str:
    """Which log is surely not what was measured: read otherwise, it is explained far better than by
    the best effects as it stands; or it shows what no actuator makes, and nothing mends that."""
    most = FAR_BETTER * _error(best)
    errors = tried(told, asked, fitter.workers)
    likeliest = min(errors, key=errors.__getitem__, default=None)
    sure = [it for audit in asked for it in audit.mistakes if not it.mended]
    said = likeliest if likeliest and errors[likeliest] <= most else next(iter(sure), None)
    if likeliest and not said:  # with its best effects as well
        right = replace(told, logs=tuple(mended(told.logs, asked, likeliest)))
        floors = noise_floors(audits(right.logs, told.model.plant))
        again = _fitter(right, floors, fitter.workers, stop, fitter.settings)
        said = likeliest if _error(select_effects(again).taken) <= most else None
    return next((f"log '{it.log.name}': {said}" for it in asked if said in it.mistakes), "")


def _error(model: FittedModel) -> float:
    return error(model.problem, model.evidence.vector)


def _confirmed(diagnosis: Diagnosis, tell: Tell | None) -> Diagnosis:
    """The diagnosis with its model run as an FMU; what took minutes is kept where that fails."""
    if tell:
        tell("running the FMU with the diagnosed parameters")
    try:
        confirmation = confirm.confirm(diagnosis.fitted, diagnosis.selection, diagnosis.logs)
    except UserError as error:
        why = f"cannot be run here: all figures are those of the simulation without one ({error})"
        return replace(diagnosis, unconfirmed=why)
    return replace(diagnosis, confirmation=confirmation, unconfirmed=confirmation.doubt)


def _diagnose(
    told: Description,
    tolerance: float,
    seed: int,
    workers: Workers,
    left_out: Iterable[str],
    tell: Tell | None,
    stop: Stop,
    settings: Settings,
) -> Diagnosis:
    audited = likely(told, questions(told), workers)
    floors, origins = noise_floors(audited), noise_origins(audited)
    fitter = _fitter(told, floors, workers, stop, settings)
    selection = select_effects(fitter, left_out, tell, tolerance)
    verdict = decide(selection, tolerance)
    parts: tuple[Part, ...] = ()
    lacking = [BETWEEN_ROWS] if verdict.lacks or selection.taken.effects else []
    lacking += [PARTS] if verdict.kind == OUTSIDE else []
    if lacking:
        with stop.search():
            stop.check()
            if verdict.kind == OUTSIDE:
                explain = partial(select_effects, left_out=left_out, tell=tell, tolerance=tolerance)
                parts = unlike_parts(fitter, selection, lambda part: explain(part).taken)
                lacking.remove(PARTS)
            models = (selection.retuned, selection.taken)[: 1 + verdict.lacks]
            told_apart = any(part.sure for part in parts)
            unsure = None if told_apart else fitter.unsure_between_rows(models, selection.taken)
            # beside what commands may have done, two noise floors are much
            enough = min(tolerance, settings.enough_floors)
            again = select_effects(unsure, left_out, tell, enough) if unsure else selection
            likelier = unsure and again.taken.deviance < selection.taken.deviance
            if unsure and likelier and (said := decide(again, enough)).kind != OUTSIDE:
                fitter, selection, verdict, parts = unsure, again, said, ()
            lacking.remove(BETWEEN_ROWS)
    # what does not follow the command is no curve of what the actuator does
    shaped = verdict.kind == OUTSIDE and verdict.locked.follows and not parts
    learns = shaped and not stop.passed
    is_left = selection.taken.evidence.rms > tolerance and not stop.passed
    mistake = _mistake(told, audited, fitter, selection.taken, stop) if is_left else ""
    usual = not mistake and not fitter.between_rows
    held_out = held_out_scores(selection)
    against = contradicted(selection, held_out, settings.least_gain)
    # learnt from whole searches in logs as they should be
    calibrated = usual and not selection.unfinished
    known = probabilities(selection, verdict, against) if calibrated else {}
    lacking += [SHAPE] if shaped and not learns else []
    if tell and learns:
        tell("learning the shape of what is left")
    return Diagnosis(
        name=told.path.stem,
        file=told.path.name if told.path.suffix == ".toml" else "",
        sha256=told.document.sha256,
        model=told.model,
        logs=told.logs,
        audits=audited,
        floors=floors,
        selection=selection,
        verdict=verdict,
        gap=whole_gap(selection, seed),
        gaps=gaps(selection, floors, origins, seed),
        ranking=ranked_effects(selection, verdict, known),
        moved=estimates(selection.retuned),
        held_out=held_out,
        residual_map=learn(selection.taken, selection.retuned) if learns else None,
        tolerance=tolerance,
        seed=seed,
        parts=parts,
        between_rows=fitter.between_rows,
        blurs=fitter.blurs(selection.taken) if verdict.lacks and not stop.passed else (),
        mistake=mistake,
        unfinished=(*selection.unfinished, *lacking),
    )
