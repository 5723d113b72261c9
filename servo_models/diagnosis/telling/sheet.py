"""A diagnosis on the terminal: the verdict, the gap, the effects, what was ruled out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isnan

from servo_models.analysis.experiment import display
from servo_models.analysis.explain import display_scale, display_unit, in_display_unit
from servo_models.core.plant import Plant
from servo_models.diagnosis.claims import Value
from servo_models.diagnosis.confirm import Confirmation
from servo_models.diagnosis.detectors import sentence
from servo_models.diagnosis.experiments.experiment import Experiment
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.telling import words
from servo_models.diagnosis.telling.cautions import cautions
from servo_models.diagnosis.where import Breakdown
from servo_models.identification.result import FIT, HELD_OUT, overall
from servo_models.report.sheets import Sheet, Table, with_error

GAP = (
    "output",
    "before",
    "re-tuned",
    "after",
    "95 %",
    "floor",
    "unit",
    "closed",
)
BEFORE = ("output", "of its range", "worst moment", "equivalent delay", "floor is from")
CONFIRMED = ("output", "samples", "before", "after", "unit")
HELD_OUT_LOGS = ("log", "parameters alone", "with effects", "")
EFFECTS = ("effect", "on", "probability", "size", "gap after", "closes", "")
PARAMETERS = ("parameter", "before", "re-tuned", "after", "+-", "unit", "prior deviations", "")
RULED_OUT = ("why", "effects")
IMITATED = ("effect", "on", "up to [noise floors]", "experiment")
DETECTED = ("effect", "its own detector")


def diagnosis_sheet(
    found: Diagnosis,
    confirmation: Confirmation | None,
    breakdowns: Sequence[Breakdown] = (),
    experiments: Sequence[Experiment] = (),
) -> Sheet:
    """Return a diagnosis in the units that a person reads.

    Args:
        found: the diagnosis.
        confirmation: its model run as an FMU, None where that cannot be.
        breakdowns: where the gap lies.
        experiments: that would tell apart what these logs cannot.
    """
    model = found.model
    warnings = tuple(f"Warning: {text}." for text in cautions(found))
    places = tuple((one.dimension, one.sentence) for one in breakdowns)
    next_ = tuple((str(k), one.instruction) for k, one in enumerate(experiments, start=1))
    tables = (
        Table("Gap, RMS on blocks that no fit has seen", GAP, tuple(_gaps(found))),
        Table("The nominal model", BEFORE, tuple(_before(found))),
        *([_confirmed(found, confirmation)] if confirmation else []),
        Table("Held out, RMS in noise floors", HELD_OUT_LOGS, tuple(_held_out(found))),
        Table("Where the squared error lies", ("along", ""), places),
        Table("Effects, most likely first", EFFECTS, tuple(_effects(found))),
        Table("Seen apart from any error", DETECTED, tuple(_detected(found))),
        Table("Ruled out without a fit", RULED_OUT, tuple(_ruled_out(found))),
        Table(
            "Not ruled out: re-tuned parameters imitate them",
            IMITATED,
            tuple(_imitated(found, experiments)),
        ),
        Table("Parameters", PARAMETERS, tuple(_parameters(found))),
        Table(_next(experiments), ("number", ""), next_),
    )
    return Sheet(
        f"{model.actuator.name}, variant {model.variant}: {found.verdict.kind}",
        (words.sentence(found, experiments), *warnings),
        tuple(table for table in tables if table.rows),
    )


def _next(experiments: Sequence[Experiment]) -> str:
    written = all(one.file for one in experiments)
    return f"Next experiment{'' if written else ' (--json or --report writes its table)'}"


def _held_out(found: Diagnosis) -> Iterator[tuple[str, ...]]:
    for one in found.held_out:
        yield one.log, _left(one.retuned), _left(one.after), "gets worse" if one.worse else ""


def _left(rms: float) -> str:
    return "cannot be simulated" if isnan(rms) else f"{rms:.3g}"


def _gaps(found: Diagnosis) -> Iterator[tuple[str, ...]]:
    for gap in found.gaps:
        scale, unit = display(found.model.plant.wire[gap.output])
        figures = [f"{scale * gap.rms[stage]:.4g}" for stage in ("before", "retuned", "after")]
        if found.within_tolerance:  # nothing was re-tuned
            figures[1] = ""
        low, high = gap.intervals["after"]
        yield (
            gap.output,
            *figures,
            f"{scale * low:.3g}..{scale * high:.3g}",
            f"{scale * gap.floor:.3g}",
            unit,
            words.closed(gap),
        )


def _before(found: Diagnosis) -> Iterator[tuple[str, ...]]:
    for gap in found.gaps:
        log, time = gap.worst
        share = "" if isnan(gap.nrmse) else f"{100.0 * gap.nrmse:.3g} %"
        yield gap.output, share, f"{time:.4g} s in {log}", f"{1e3 * gap.delay:.3g} ms", gap.origin


def _confirmed(found: Diagnosis, confirmation: Confirmation) -> Table:
    equal = (
        "equal to the simulation to the last bit"
        if confirmation.difference == 0.0
        else f"{confirmation.difference:.1g} of full scale from the simulation"
    )
    title = f"RMS by one run over each log, after as the FMU ({equal})"
    return Table(title, CONFIRMED, tuple(_confirmation(found, confirmation)))


def _confirmation(found: Diagnosis, confirmation: Confirmation) -> Iterator[tuple[str, ...]]:
    rows = confirmation.rows
    for output, part in dict.fromkeys((row.output, row.part) for row in rows):
        scale, unit = display(found.model.plant.wire[output])
        before, after = (scale * overall(rows, output, part, s) for s in ("before", "after"))
        samples = {FIT: "judged", HELD_OUT: "held out"}[part]
        yield output, samples, f"{before:.4g}", f"{after:.4g}", unit


def _effects(found: Diagnosis) -> Iterator[tuple[str, ...]]:
    fitted, plant = found.causes.fitted, found.model.plant
    for claim in found.claims:
        said = ["taken"] if claim.taken else ["cannot be told apart"] if claim.in_set else []
        if claim.name in fitted and not claim.taken:
            said += [f"beside {words.listed(claim.beside)}"] if claim.beside else []
            said += words.marks(found, fitted[claim.name])
        sizes = ", ".join(_size(plant, value) for value in claim.parameters)
        yield (
            claim.name,
            claim.wire,
            _percent(claim.probability if found.verdict.chances else None),
            sizes,
            f"{claim.gap_after:.3g}",
            _percent(claim.closed),
            ", ".join(said),
        )


def _detected(found: Diagnosis) -> Iterator[tuple[str, str]]:
    for claim in found.claims:
        if claim.detected is not None:
            yield claim.name, sentence(claim.detected)


def _percent(share: float | None) -> str:
    if share is None:
        return ""
    return "<0.1 %" if 0.0 <= share < 0.001 else f"{100.0 * share:.3g} %"


def _size(plant: Plant, value: Value) -> str:
    parameter = plant.parameters[value.name]
    scale = display_scale(parameter)
    size, error = with_error(scale * value.value, scale * value.standard_error)
    unit = display_unit(parameter)
    own = value.name.rpartition(".")[2]
    return f"{own} {size}{f' +- {error}' if error else ''} {unit}".rstrip()


def _ruled_out(found: Diagnosis) -> Iterator[tuple[str, str]]:
    """Effects of one reason in one row; those that were fitted say it in their own."""
    fitted = {claim.name for claim in found.claims}
    rows: dict[str, list[str]] = {}
    for name, reason in words.ruled_out(found).items():
        if name not in fitted:
            rows.setdefault(reason.partition(":")[0], []).append(name)
    for reason, names in rows.items():
        yield reason, ", ".join(names)


def _imitated(
    found: Diagnosis, experiments: Sequence[Experiment]
) -> Iterator[tuple[str, str, str, str]]:
    for one in found.imitated:
        wire = found.model.plant.main_wire(one.name)
        yield one.name, wire, f"{one.moved:.3g}", words.shown_by(one, experiments)


def _parameters(found: Diagnosis) -> Iterator[tuple[str, ...]]:
    moved = () if found.within_tolerance else found.moved
    retuned = {value.name: value.value for value in moved}
    moves, doubts = words.moves(found), words.doubts(found)
    for value in found.found:
        parameter = found.model.plant.parameters[value.name]
        scale = display_scale(parameter)
        between = retuned.get(value.name)
        yield (
            value.name,
            in_display_unit(value.nominal, parameter),
            "" if between is None else f"{scale * between:.4g}",
            *with_error(scale * value.value, scale * value.standard_error),
            display_unit(parameter),
            f"{round(moves[value.name], 1) + 0.0:+g}" if value.name in moves else "",
            doubts.get(value.name, ""),
        )
