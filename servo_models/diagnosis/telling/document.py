"""A diagnosis as JSON, by the schema in ``schema.json``, and as GitHub's workflow commands.

All figures are SI with their unit beside them, or noise floors.  The same diagnosis gives the
same bytes: there is no date inside.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from servo_models.data.audit import Audit, Reading
from servo_models.diagnosis.claims import Claim, Value
from servo_models.diagnosis.confirm import Confirmation
from servo_models.diagnosis.detectors import Codes, Detection, sentence
from servo_models.diagnosis.experiments.experiment import Experiment
from servo_models.diagnosis.gap import Reduction
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.search.imitated import Imitated
from servo_models.diagnosis.telling import words
from servo_models.diagnosis.telling.cautions import cautions
from servo_models.diagnosis.where import Breakdown
from servo_models.identification.result import FIT, HELD_OUT, Accuracy, overall
from servo_models.report.interchange import command

VERSION = 1
"""Of the schema: it counts up when a reader of the one before would go wrong."""
FLOORS = "noise floor"


def document(
    found: Diagnosis,
    confirmation: Confirmation | None,
    breakdowns: Sequence[Breakdown],
    experiments: Sequence[Experiment],
    seed: int,
    versions: Mapping[str, str],
) -> dict[str, Any]:
    """Return a diagnosis as what JSON is made of.

    Args:
        found: the diagnosis.
        confirmation: its model run as an FMU, None where that cannot be.
        breakdowns: where the gap lies.
        experiments: that would tell apart what these logs cannot.
        seed: of the diagnosis.
        versions: that figures depend on, by name.
    """
    return {
        "schema_version": VERSION,
        "actuator": found.model.actuator.name,
        "variant": found.model.variant,
        "verdict": found.verdict.kind,
        "sentence": words.sentence(found, experiments),
        "tolerance": found.tolerance,
        "gap": {**_reduction(found.gap, FLOORS), "outputs": _outputs(found)},
        "confirmation": _confirmation(found, confirmation) if confirmation else None,
        "effects": [_effect(found, claim) for claim in found.claims],
        "ruled_out": [{"name": n, "reason": why} for n, why in words.ruled_out(found).items()],
        "imitated": [_imitated(found, one) for one in found.imitated],
        "parameters": [_parameter(found, value) for value in found.found],
        "held_out": [asdict(one) for one in found.held_out],
        "where": [asdict(breakdown) for breakdown in breakdowns],
        "next_experiments": [_experiment(one) for one in experiments],
        "warnings": list(cautions(found)),
        "seed": seed,
        "versions": dict(versions),
        "logs": [_log(found, audit) for audit in found.audits],
    }


def github(found: Diagnosis, experiments: Sequence[Experiment] = ()) -> Iterator[str]:
    """Return workflow commands: the verdict, an error where there is a gap, and all warnings."""
    title, said = f"servo-models: {found.model.actuator.name}", words.sentence(found, experiments)
    yield command("notice" if found.within_tolerance else "error", title, said)
    for text in cautions(found):
        yield command("warning", title, text)


def _reduction(gap: Reduction, unit: str) -> dict[str, Any]:
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


def _outputs(found: Diagnosis) -> dict[str, Any]:
    return {
        gap.output: {
            **_reduction(gap, found.model.plant.wire[gap.output].unit),
            "floor_origin": gap.origin,
            "nrmse": gap.nrmse,
            "delay": gap.delay,
            "worst": {"log": gap.worst[0], "time": gap.worst[1]},
        }
        for gap in found.gaps
    }


def _confirmation(found: Diagnosis, confirmation: Confirmation) -> dict[str, Any]:
    wires = found.model.plant.wire
    return {
        "difference": confirmation.difference,
        "outputs": {
            output: {
                "unit": wires[output].unit,
                "judged": _whole(confirmation.rows, output, FIT),
                "held_out": _whole(confirmation.rows, output, HELD_OUT),
            }
            for output in dict.fromkeys(row.output for row in confirmation.rows)
        },
    }


def _whole(rows: Sequence[Accuracy], output: str, part: str) -> dict[str, float]:
    return {stage: overall(rows, output, part, stage) for stage in ("before", "after")}


def _effect(found: Diagnosis, claim: Claim) -> dict[str, Any]:
    return {
        "name": claim.name,
        "block": claim.wire,
        "probability": claim.probability,
        "in_set": claim.in_set,
        "taken": claim.taken,
        "parameters": [_value(found, value) for value in claim.parameters],
        "gap_after": claim.gap_after,
        "closed": claim.closed,
        "converged": claim.converged,
        "reach": claim.reach,
        "beside": list(claim.beside),
        "detected": None if claim.detected is None else _detected(claim.detected),
    }


def _imitated(found: Diagnosis, one: Imitated) -> dict[str, Any]:
    wire = found.model.plant.main_wire(one.name)
    return {"name": one.name, "block": wire, "up_to": one.moved}


def _detected(seen: Detection) -> dict[str, Any]:
    return {
        "by": "codes" if isinstance(seen, Codes) else "clock",
        "bunched": seen.bunched,
        "by_chance": seen.chance,
        "text": sentence(seen),
    }


def _parameter(found: Diagnosis, value: Value) -> dict[str, Any]:
    moved, doubt = words.moves(found), words.doubts(found)
    retuned = {one.name: one.value for one in found.moved}
    return {
        **_value(found, value),
        "retuned": retuned.get(value.name),
        "prior_deviations": moved.get(value.name),
        "doubt": doubt.get(value.name, ""),
    }


def _value(found: Diagnosis, value: Value) -> dict[str, Any]:
    unit = found.model.plant.parameters[value.name].param.unit
    return {**asdict(value), "unit": unit}


def _log(found: Diagnosis, audit: Audit) -> dict[str, Any]:
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
        "readings": {one.name: _reading(found, one) for one in audit.readings},
    }


def _reading(found: Diagnosis, reading: Reading) -> dict[str, Any]:
    floor = reading.floor
    return {
        "unit": found.model.plant.wire[reading.name].unit,
        "low": reading.low,
        "high": reading.high,
        "step": reading.step,
        "clipped": reading.clipped,
        "stale": reading.stale,
        "floor": {"quantum": floor.quantum, "repeats": floor.repeats, "residual": floor.residual},
    }


def _experiment(next_: Experiment) -> dict[str, Any]:
    return {
        "one": list(next_.one),
        "other": list(next_.other),
        "text": next_.text,
        "input": next_.wire.name,
        "unit": next_.wire.unit,
        "constants": dict(next_.constants),
        "duration": float(next_.times[-1]),
        "separation": next_.separation,
        "so_far": next_.so_far,
        "file": next_.file or None,
    }
