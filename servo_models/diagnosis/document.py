"""A diagnosis for other programs: as JSON by ``schema.py``, as GitHub's workflow commands, and
as a parameter file, which closes the loop from log to FMU.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations
from typing import TypeVar

from servo_models.data.audit import Audit
from servo_models.data.log import hashes
from servo_models.data.parameters import (
    Estimate,
    FitFigure,
    ParameterSet,
    known_error,
    pairs,
    with_given,
)
from servo_models.diagnosis import schema, summary
from servo_models.diagnosis.design import Experiment
from servo_models.diagnosis.gap import GapSummary
from servo_models.diagnosis.ranking import RankedEffect, Value
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.stretches import Part, held_out_outputs
from servo_models.diagnosis.verdict import weights_by_effects
from servo_models.errors import UserError
from servo_models.identification.result import FIT, HELD_OUT, Accuracy, overall
from servo_models.report.interchange import command, conditions

Reduction = TypeVar("Reduction", bound=schema.Reduction)

FLOORS = "noise floor"


def document(diagnosis: Diagnosis) -> schema.DiagnosisDocument:
    """Return a diagnosis as what JSON is made of: figures in SI or noise floors, no date."""
    plant = diagnosis.model.plant
    return schema.DiagnosisDocument.made_from(
        diagnosis,
        schema_version=schema.VERSION,
        description=schema.SourceFile(diagnosis.file, diagnosis.sha256)
        if diagnosis.sha256
        else None,
        actuator=diagnosis.model.actuator.name,
        variant=diagnosis.model.variant,
        verdict=diagnosis.verdict.kind,
        sentence=summary.sentence(diagnosis),
        not_asserted=summary.not_asserted(diagnosis),
        settings=vars(diagnosis.settings),
        gap=_reduction(schema.WholeGap, diagnosis.gap, FLOORS, outputs=_outputs(diagnosis)),
        confirmation=_confirmation(diagnosis),
        effects=[_effect(diagnosis, effect) for effect in diagnosis.ranking],
        confidence_set=_confidence_set(diagnosis),
        ruled_out=[schema.RuledOut(*each) for each in summary.ruled_out(diagnosis).items()],
        masked=[
            schema.Masked(effect.name, plant.main_wire(effect.name), effect.moved)
            for effect in diagnosis.masked
        ],
        parameters=[_parameter(diagnosis, value) for value in diagnosis.found],
        residual_map=_residual_map(diagnosis),
        held_out_outputs=held_out_outputs(diagnosis.held_out),
        parts=[_part(part) for part in diagnosis.parts],
        next_experiments=[_experiment(planned) for planned in diagnosis.next_experiments],
        repeats_wanted=diagnosis.repeats_wanted or None,
        warnings=summary.warnings(diagnosis),
        versions=conditions(),
        logs=[_log(diagnosis, audit) for audit in diagnosis.audits],
    )


def github(diagnosis: Diagnosis) -> Iterator[str]:
    """Return workflow commands: the verdict, an error where there is a gap, and all warnings."""
    title, said = f"servo-models: {diagnosis.model.actuator.name}", summary.sentence(diagnosis)
    yield command("notice" if diagnosis.within_tolerance else "error", title, said)
    for text in summary.warnings(diagnosis):
        yield command("warning", title, text)


def _reduction(kind: type[Reduction], gap: GapSummary, unit: str, **others: object) -> Reduction:
    share, *interval = gap.closed or (None, None, None)
    return kind.made_from(
        gap,
        **gap.rms,
        unit=unit,
        held_out=True,
        intervals=schema.Intervals(**gap.intervals),
        closed=share,
        closed_interval=interval,
        **others,
    )


def _outputs(diagnosis: Diagnosis) -> dict[str, schema.OutputGap]:
    wires = diagnosis.model.plant.wire
    return {
        gap.output: _reduction(
            schema.OutputGap,
            gap,
            wires[gap.output].unit,
            floor_origin=gap.origin,
            worst=schema.Worst(*gap.worst),
        )
        for gap in diagnosis.gaps
    }


def _confirmation(diagnosis: Diagnosis) -> schema.Confirmed | None:
    confirmation, wires = diagnosis.confirmation, diagnosis.model.plant.wire
    if confirmation is None:
        return None
    rows = confirmation.rows
    outputs = {
        output: schema.ConfirmedOutput(
            wires[output].unit, _whole(rows, output, FIT), _whole(rows, output, HELD_OUT)
        )
        for output in dict.fromkeys(row.output for row in rows)
    }
    return schema.Confirmed(confirmation.difference, outputs)


def _whole(rows: Sequence[Accuracy], output: str, part: str) -> schema.Stages:
    return schema.Stages(*(overall(rows, output, part, stage) for stage in ("before", "after")))


def _effect(diagnosis: Diagnosis, effect: RankedEffect) -> schema.Effect:
    return schema.Effect.made_from(
        effect,
        block=effect.wire,
        parameters=[_value(diagnosis, value) for value in effect.parameters],
    )


def _residual_map(diagnosis: Diagnosis) -> schema.LearntMap | None:
    learnt, wires = diagnosis.residual_map, diagnosis.model.plant.wire
    if learnt is None:
        return None
    curves = [
        schema.MapCurve.made_from(
            curve, of=curve.regressor, unit=wires[curve.wire].unit, standard_errors=curve.errors
        )
        for curve in learnt.curves
    ]
    return schema.LearntMap.made_from(
        learnt,
        block=learnt.wire,
        unit=wires[learnt.wire].unit,
        text=learnt.sentence,
        beside=learnt.fitted.effects,
        curves=curves,
        parameters=learnt.values,
    )


def _confidence_set(diagnosis: Diagnosis) -> schema.ConfidenceSet:
    """The fitted models that cannot be told apart, and the choices that they leave."""
    weights = weights_by_effects(diagnosis.selection, diagnosis.verdict)
    rivals = [model.effects for model in diagnosis.verdict.rivals]
    return schema.ConfidenceSet(
        [schema.FittedEffects(effects, weights[effects]) for effects in rivals],
        [[schema.Choice.made_from(slot) for slot in slots] for slots in diagnosis.alternatives],
    )


def _part(part: Part) -> schema.ExplainedPart:
    value = part.value
    return schema.ExplainedPart(
        part.log,
        part.half or None,
        value.name,
        value.value,
        value.standard_error,
        part.left,
        part.sure,
    )


def _parameter(diagnosis: Diagnosis, value: Value) -> schema.Parameter:
    retuned = {moved.name: moved.value for moved in diagnosis.moved}
    return schema.Parameter.made_from(
        _value(diagnosis, value),
        retuned=retuned.get(value.name),
        prior_deviations=summary.moves(diagnosis).get(value.name),
    )


def _value(diagnosis: Diagnosis, value: Value) -> schema.Value:
    unit = diagnosis.model.plant.parameters[value.name].param.unit
    return schema.Value.made_from(value, prior=value.nominal, unit=unit)


def _log(diagnosis: Diagnosis, audit: Audit) -> schema.AuditedLog:
    log, clock, wires = audit.log, audit.sampling, diagnosis.model.plant.wire
    readings = {
        each.name: schema.ReadOutput.made_from(each, unit=wires[each.name].unit)
        for each in audit.readings
    }
    return schema.AuditedLog.made_from(
        clock,
        name=log.name,
        file=log.path.name,
        sha256=log.sha256,
        gaps=len(clock.gaps),
        at_rest=audit.at_rest,
        notes=log.notes,
        readings=readings,
    )


def _experiment(planned: Experiment) -> schema.NextExperiment:
    names = planned.explanations
    return schema.NextExperiment.made_from(
        planned,
        explanations=[schema.Explanation(*each) for each in zip(names, planned.weights)],
        pairs=[
            schema.Pair(names[i], names[k], planned.separations[i, k], planned.told[i, k])
            for i, k in permutations(range(len(names)), 2)
        ],
        input=planned.wire.name,
        unit=planned.wire.unit,
        constants=planned.plans[0].constants,
        changed=[plan.constants for plan in planned.plans[1:]],
        outputs=tuple(planned.floors),
        duration=planned.times[-1],
        file=planned.file or None,
    )


def parameter_set(
    diagnosis: Diagnosis, date: datetime.date | None = None, with_map: bool = False
) -> ParameterSet:
    """Return ``diagnosis.fitted`` with standard errors, and what it is known from; or likewise
    ``diagnosis.with_map``.

    Raises:
        UserError: there is no map.
    """
    return _with_map(diagnosis, date) if with_map else _fitted(diagnosis, date)


def _fitted(diagnosis: Diagnosis, date: datetime.date | None) -> ParameterSet:
    model = diagnosis.fitted
    tuned = () if diagnosis.within_tolerance else diagnosis.found  # without a gap nothing is
    estimated = {
        one.name: Estimate(one.name, one.value, known_error(one.standard_error), "diagnosed")
        for one in tuned
    }
    wires = model.plant.wire
    return ParameterSet(
        actuator=model.actuator.key,
        variant=model.variant,
        estimates=with_given(model.actuator.values(model.variant), model.values, estimated),
        correlations=_correlations(diagnosis) if tuned else (),
        method=f"diagnosis, {diagnosis.verdict.kind}: {_causes(diagnosis)}",
        logs={name: f"sha256:{digest}" for name, digest in hashes(diagnosis.logs).items()},
        date=date,
        figures={
            f"{name}_rms_held_out": FitFigure(it.after, it.unit)
            for name, it in held_out_outputs(diagnosis.held_out).items()
            if math.isfinite(it.after)
        }
        | {
            f"{gap.output}_rms_blocks": FitFigure(gap.rms["after"], wires[gap.output].unit)
            for gap in diagnosis.gaps
        },
        warnings=summary.warnings(diagnosis),
    )


def _correlations(diagnosis: Diagnosis) -> tuple[tuple[str, str, float], ...]:
    taken = diagnosis.selection.taken
    names = [free.name for free in taken.problem.free]
    return pairs(names, taken.spread.correlations) if names else ()


def _with_map(diagnosis: Diagnosis, date: datetime.date | None) -> ParameterSet:
    found = diagnosis.residual_map
    if found is None:
        raise UserError(
            "no residual map: it is learnt where something is left outside the catalogue, and only"
            " if it holds on blocks that its fit left out"
        )
    own, model = _fitted(diagnosis, date), diagnosis.with_map
    estimated = {
        name: Estimate(name, value, None, "diagnosed with a residual map")
        for name, value in found.values.items()
    }
    return replace(
        own,
        estimates=with_given(model.actuator.values(model.variant), model.values, estimated),
        method=f"{own.method}; {found.sentence}",
        figures={"noise_floors_blocks": FitFigure(found.after, "1")},
    )


def _causes(diagnosis: Diagnosis) -> str:
    taken = diagnosis.selection.taken.effects
    return f"parameters and {summary.placed(diagnosis, taken)}" if taken else "parameters alone"
