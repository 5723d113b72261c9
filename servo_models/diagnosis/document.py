"""A diagnosis for other programs: as JSON by ``schema.json``, as GitHub's workflow commands, and
as a parameter file, which closes the loop from log to FMU.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from itertools import permutations
from typing import Any

from servo_models.data.audit import Audit, Reading
from servo_models.data.log import hashes
from servo_models.data.parameters import Estimate, FitFigure, ParameterSet, known_error, with_given
from servo_models.diagnosis import summary
from servo_models.diagnosis.confirm import Confirmation
from servo_models.diagnosis.design import Experiment
from servo_models.diagnosis.gap import GapSummary
from servo_models.diagnosis.ranking import RankedEffect, Value
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.search.masking import MaskedEffect
from servo_models.diagnosis.signatures import Codes, Signature, sentence
from servo_models.diagnosis.stretches import Part
from servo_models.diagnosis.verdict import weights_by_effects
from servo_models.errors import UserError
from servo_models.identification.result import FIT, HELD_OUT, Accuracy, overall
from servo_models.report.interchange import command, conditions

VERSION = 3  # of the schema: it counts up when a reader of the one before would go wrong
FLOORS = "noise floor"


def document(diagnosis: Diagnosis) -> dict[str, Any]:
    """Return a diagnosis as what JSON is made of: figures in SI or noise floors, no date."""
    confirmation = diagnosis.confirmation
    return {
        "schema_version": VERSION,
        "actuator": diagnosis.model.actuator.name,
        "variant": diagnosis.model.variant,
        "verdict": diagnosis.verdict.kind,
        "sentence": summary.sentence(diagnosis),
        "not_asserted": summary.not_asserted(diagnosis),
        "tolerance": diagnosis.tolerance,
        "settings": asdict(diagnosis.settings),
        "gap": {**_gap_summary(diagnosis.gap, FLOORS), "outputs": _outputs(diagnosis)},
        "confirmation": _confirmation(diagnosis, confirmation) if confirmation else None,
        "effects": [_effect(diagnosis, effect) for effect in diagnosis.ranking],
        "confidence_set": _confidence_set(diagnosis),
        "ruled_out": [
            {"name": n, "reason": why} for n, why in summary.ruled_out(diagnosis).items()
        ],
        "masked": [_masked_effect(diagnosis, one) for one in diagnosis.masked],
        "parameters": [_parameter(diagnosis, value) for value in diagnosis.found],
        "residual_map": _residual_map(diagnosis),
        "between_rows": diagnosis.between_rows,
        "parts": [_part(one) for one in diagnosis.parts],
        "held_out": [asdict(one) for one in diagnosis.held_out],
        "localisation": [asdict(breakdown) for breakdown in diagnosis.localisation],
        "next_experiments": [_experiment(one) for one in diagnosis.next_experiments],
        "repeats_wanted": diagnosis.repeats_wanted or None,
        "unfinished": list(diagnosis.unfinished),
        "warnings": list(summary.warnings(diagnosis)),
        "seed": diagnosis.seed,
        "versions": conditions(),
        "logs": [_log(diagnosis, audit) for audit in diagnosis.audits],
    }


def github(diagnosis: Diagnosis) -> Iterator[str]:
    """Return workflow commands: the verdict, an error where there is a gap, and all warnings."""
    title, said = f"servo-models: {diagnosis.model.actuator.name}", summary.sentence(diagnosis)
    yield command("notice" if diagnosis.within_tolerance else "error", title, said)
    for text in summary.warnings(diagnosis):
        yield command("warning", title, text)


def _gap_summary(gap: GapSummary, unit: str) -> dict[str, Any]:
    closed = gap.closed or (None, None, None)
    return {
        **gap.rms,
        "floor": gap.floor,
        "unit": unit,
        "held_out": True,
        "intervals": {stage: list(interval) for stage, interval in gap.intervals.items()},
        "closed": closed[0],
        "closed_interval": list(closed[1:]),
    }


def _outputs(diagnosis: Diagnosis) -> dict[str, Any]:
    return {
        gap.output: {
            **_gap_summary(gap, diagnosis.model.plant.wire[gap.output].unit),
            "floor_origin": gap.origin,
            "nrmse": gap.nrmse,
            "delay": gap.delay,
            "worst": {"log": gap.worst[0], "time": gap.worst[1]},
        }
        for gap in diagnosis.gaps
    }


def _confirmation(diagnosis: Diagnosis, confirmation: Confirmation) -> dict[str, Any]:
    wires = diagnosis.model.plant.wire
    return {
        "difference": confirmation.difference,
        "outputs": {
            output: {
                "unit": wires[output].unit,
                "fit": _whole(confirmation.rows, output, FIT),
                "held_out": _whole(confirmation.rows, output, HELD_OUT),
            }
            for output in dict.fromkeys(row.output for row in confirmation.rows)
        },
    }


def _whole(rows: Sequence[Accuracy], output: str, part: str) -> dict[str, float]:
    return {stage: overall(rows, output, part, stage) for stage in ("before", "after")}


def _effect(diagnosis: Diagnosis, effect: RankedEffect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "block": effect.wire,
        "model_weight": effect.model_weight,
        "probability": effect.probability,
        "in_set": effect.in_set,
        "taken": effect.taken,
        "parameters": [_value(diagnosis, value) for value in effect.parameters],
        "gap_after": effect.gap_after,
        "closed": effect.closed,
        "converged": effect.converged,
        "detectability": effect.detectability,
        "beside": list(effect.beside),
        "detected": None if effect.detected is None else _detected(effect.detected),
    }


def _residual_map(diagnosis: Diagnosis) -> dict[str, Any] | None:
    found, wires = diagnosis.residual_map, diagnosis.model.plant.wire
    if found is None:
        return None
    return {
        "block": found.wire,
        "unit": wires[found.wire].unit,
        "text": found.sentence,
        "before": found.before,
        "after": found.after,
        "beside": list(found.fitted.effects),
        "curves": [
            {
                "of": curve.regressor,
                "wire": curve.wire,
                "unit": wires[curve.wire].unit,
                "knots": curve.knots.tolist(),
                "values": curve.values.tolist(),
                "standard_errors": curve.errors.tolist(),
                "samples": curve.samples.tolist(),
            }
            for curve in found.curves
        ],
        "parameters": found.values,
    }


def _confidence_set(diagnosis: Diagnosis) -> dict[str, Any]:
    """The fitted models that cannot be told apart, and the choices that they leave."""
    weights = weights_by_effects(diagnosis.selection, diagnosis.verdict)
    return {
        "models": [
            {"effects": list(one.effects), "model_weight": weights[one.effects]}
            for one in diagnosis.verdict.rivals
        ],
        "alternatives": [
            [
                {"family": slot.family, "count": slot.count, "effects": list(slot.effects)}
                for slot in slots
            ]
            for slots in diagnosis.alternatives
        ],
    }


def _masked_effect(diagnosis: Diagnosis, one: MaskedEffect) -> dict[str, Any]:
    wire = diagnosis.model.plant.main_wire(one.name)
    return {"name": one.name, "block": wire, "up_to": one.moved}


def _part(one: Part) -> dict[str, Any]:
    return {
        "log": one.log,
        "half": one.half or None,
        "parameter": one.value.name,
        "value": one.value.value,
        "standard_error": one.value.standard_error,
        "left": one.left,
    }


def _detected(seen: Signature) -> dict[str, Any]:
    return {
        "by": "codes" if isinstance(seen, Codes) else "clock",
        "bunched": seen.bunched,
        "by_chance": seen.chance,
        "text": sentence(seen),
    }


def _parameter(diagnosis: Diagnosis, value: Value) -> dict[str, Any]:
    moved, doubt = summary.moves(diagnosis), summary.doubts(diagnosis)
    retuned = {one.name: one.value for one in diagnosis.moved}
    return {
        **_value(diagnosis, value),
        "retuned": retuned.get(value.name),
        "prior_deviations": moved.get(value.name),
        "doubt": doubt.get(value.name, ""),
    }


def _value(diagnosis: Diagnosis, value: Value) -> dict[str, Any]:
    unit = diagnosis.model.plant.parameters[value.name].param.unit
    figures = asdict(value)
    return {"name": figures.pop("name"), "prior": figures.pop("nominal"), **figures, "unit": unit}


def _log(diagnosis: Diagnosis, audit: Audit) -> dict[str, Any]:
    log, clock = audit.log, audit.sampling
    return {
        "name": log.name,
        "file": log.path.name,
        "sha256": log.sha256,
        "samples": clock.samples,
        "duration": clock.duration,
        "step": clock.step,
        "jitter": clock.jitter,
        "gaps": len(clock.gaps),
        "at_rest": audit.at_rest,
        "notes": list(log.notes),
        "readings": {one.name: _reading(diagnosis, one) for one in audit.readings},
    }


def _reading(diagnosis: Diagnosis, reading: Reading) -> dict[str, Any]:
    floor = reading.floor
    return {
        "unit": diagnosis.model.plant.wire[reading.name].unit,
        "low": reading.low,
        "high": reading.high,
        "step": reading.step,
        "clipped": reading.clipped,
        "stale": reading.stale,
        "floor": {"quantum": floor.quantum, "repeats": floor.repeats, "residual": floor.residual},
    }


def _experiment(next_: Experiment) -> dict[str, Any]:
    return {
        "explanations": [
            {"effects": list(effects), "weight": float(weight)}
            for effects, weight in zip(next_.explanations, next_.weights)
        ],
        "pairs": [
            {
                "right": list(next_.explanations[i]),
                "model": list(next_.explanations[k]),
                "leaves": float(next_.separations[i, k]),
                "ruled_out": bool(next_.told[i, k]),
            }
            for i, k in permutations(range(len(next_.explanations)), 2)
        ],
        "text": next_.text,
        "input": next_.wire.name,
        "unit": next_.wire.unit,
        "constants": dict(next_.constants),
        "duration": float(next_.times[-1]),
        "file": next_.file or None,
    }


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
        method=f"diagnosis, {diagnosis.verdict.kind}: {_causes(diagnosis)}",
        logs={name: f"sha256:{digest}" for name, digest in hashes(diagnosis.logs).items()},
        date=date,
        figures={
            f"{gap.output}_rms_unseen_blocks": FitFigure(gap.rms["after"], wires[gap.output].unit)
            for gap in diagnosis.gaps
        },
        warnings=summary.warnings(diagnosis),
    )


def _with_map(diagnosis: Diagnosis, date: datetime.date | None) -> ParameterSet:
    found = diagnosis.residual_map
    if found is None:
        raise UserError(
            "no residual map: it is learnt where something is left outside the catalogue, and only"
            " if it holds on stretches that no fit has seen"
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
        figures={"noise_floors_unseen_blocks": FitFigure(found.after, "1")},
    )


def _causes(diagnosis: Diagnosis) -> str:
    taken = diagnosis.selection.taken.effects
    return f"parameters and {summary.placed(diagnosis, taken)}" if taken else "parameters alone"
