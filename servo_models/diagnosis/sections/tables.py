"""Tables of a diagnosis."""

from __future__ import annotations

import inspect
import math
from collections.abc import Sequence

import numpy as np

from servo_models.analysis.experiment import display
from servo_models.analysis.explain import display_scale, display_unit, shown_value
from servo_models.diagnosis import summary
from servo_models.diagnosis.gap import DRAWS, Gap
from servo_models.diagnosis.localisation import Bin, Breakdown
from servo_models.diagnosis.ranking import RankedEffect, Value
from servo_models.diagnosis.residual_map import Curve
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.verdict import OUTSIDE, weights_by_effects
from servo_models.identification.doubts import BOUNDS, bounded
from servo_models.identification.readings import error_table
from servo_models.report.numbers import Quantity, listed, number, percent, prefix
from servo_models.report.sections import Cell, Table

FLOORS = "noise floors"


def error(diagnosis: Diagnosis, gap: Gap, value: float, digits: int = 3) -> Quantity:
    """Return an error [SI] of an output."""
    scale, unit = summary.unit_of(diagnosis, gap.output)
    return Quantity(scale * value, unit, digits=digits)


def size(diagnosis: Diagnosis, value: Value) -> Quantity:
    """Return a parameter with its standard error, as a person reads it."""
    parameter = diagnosis.model.plant.parameters[value.name]
    scale, unit = display_scale(parameter), display_unit(parameter) or "1"
    return Quantity(scale * value.value, unit, scale * value.standard_error)


def told(diagnosis: Diagnosis, value: Value) -> str:
    """Return ``size``, and on which bound it is."""
    return bounded(str(size(diagnosis, value)), value.doubt)


def likelihood(effect: RankedEffect) -> str:
    """Return how likely an effect is: its probability, or where there is none its model weight."""
    if effect.probability is None:
        return "" if effect.model_weight is None else _weight(effect.model_weight)
    return percent(effect.probability)


def _weight(weight: float) -> str:
    return f"{weight:.2f}"


def gap(diagnosis: Diagnosis) -> Table:
    """Errors of every output, stage by stage."""
    return Table(
        f"Gap, RMS on {summary.BLOCKS}",
        ("output", *diagnosis.stages.values(), "noise floor", "closed"),
        tuple(_gap(diagnosis, one) for one in diagnosis.gaps),
    )


def _gap(diagnosis: Diagnosis, gap: Gap) -> tuple[Cell, ...]:
    scale, unit = summary.unit_of(diagnosis, gap.output)
    figures = []
    for stage in diagnosis.stages:
        low, high = (scale * end for end in gap.intervals[stage])
        figures.append(Quantity(scale * gap.rms[stage], unit, interval=(low, high), digits=3))
    return gap.output, *figures, Quantity(scale * gap.floor, unit, digits=2), summary.closed(gap)


def unmodelled(diagnosis: Diagnosis) -> Table:
    """What the nominal model lacks."""
    rows = tuple(
        (
            gap.output,
            Quantity(100.0 * gap.nrmse, "%", digits=3),
            f"{number(gap.worst[1], 5)} s in {gap.worst[0]}",
            Quantity(1e3 * gap.delay, "ms", digits=3),
            gap.origin,
        )
        for gap in diagnosis.gaps
    )
    columns = ("output", "of its range", "worst moment", "lag to measured", "noise floor from")
    return Table("The nominal model", columns, rows)


def fmu(diagnosis: Diagnosis) -> Table:
    """Errors of the FMU itself, in every part of every log."""
    told = diagnosis.confirmation
    off = told.difference if told else 0.0
    same = f"off by {number(off, 2)} of full scale" if off else "the same bits as the simulation"
    but = f" but {told.not_run}" if told and told.moving else ""
    title = f"The diagnosed model as an FMU, run over each log{but}: {same}"
    return error_table(title, told.rows if told else (), diagnosis.model.plant)


def held_out(diagnosis: Diagnosis) -> Table:
    """Errors of logs with samples that the description holds out."""
    rows = tuple(
        (
            *(one.log, output),
            *(_left(diagnosis, output, getattr(errors, stage)) for stage in diagnosis.stages),
            "gets worse" if one.worse else "",
        )
        for one in diagnosis.held_out
        for output, errors in one.outputs.items()
    )
    columns = ("log", "output", *diagnosis.stages.values(), "")
    return Table("Held out by the description, RMS", columns, rows)


def _left(diagnosis: Diagnosis, output: str, rms: float) -> Cell:
    scale, unit = summary.unit_of(diagnosis, output)
    return "cannot be simulated" if math.isnan(rms) else Quantity(scale * rms, unit, digits=3)


def curve(diagnosis: Diagnosis, one: Curve) -> Table:
    """A curve of the residual map at its knots."""
    (of, of_unit), (unit, to_unit) = curve_units(diagnosis, one)
    rows = tuple(
        (
            Quantity(of * knot, of_unit, digits=3),
            Quantity(unit * value, to_unit, unit * error) if samples else "no data",
            int(samples),
        )
        for knot, value, error, samples in zip(one.knots, one.values, one.errors, one.samples)
    )
    return Table(f"Residual map of '{one.wire}'", (one.wire, "value", "samples nearest"), rows)


def curve_units(diagnosis: Diagnosis, one: Curve) -> tuple[tuple[float, str], tuple[float, str]]:
    """Return factor from SI and unit for people: of what a curve is of, and of its values."""
    assert diagnosis.residual_map is not None
    wires = diagnosis.model.plant.wire
    scale, unit = display(wires[diagnosis.residual_map.wire])
    own, unit = prefix(scale * float(np.abs(one.values).max()), unit)
    return display(wires[one.wire]), (scale * own, unit)


def places(diagnosis: Diagnosis) -> Table:
    """Where the squared error lies, in words."""
    rows = tuple((one.dimension, one.sentence) for one in diagnosis.localisation)
    return Table("Where the squared error lies", ("along", ""), rows)


def place(one: Breakdown) -> Table:
    """Every part of a dimension."""
    columns = (
        "part",
        "share before",
        "share after",
        "error before",
        "error after",
        "over local amplitude before",
        "over local amplitude after",
        "closed",
        "samples",
        "",
    )
    return Table(f"By {one.dimension}", columns, tuple(map(_bin, one.bins)), folded=True)


def _bin(one: Bin) -> tuple[Cell, ...]:
    return (
        one.label,
        _percent(one.share_before),
        _percent(one.share_after),
        Quantity(one.rms_before, digits=3),
        Quantity(one.rms_after, digits=3),
        _percent(one.relative_before),
        _percent(one.relative_after),
        _percent(one.closed),
        one.count or None,
        "gets worse" if one.worse else "",
    )


def _percent(share: float | None) -> Quantity:
    return Quantity(math.nan if share is None else 100.0 * share, "%", digits=2)


def effects(diagnosis: Diagnosis) -> Table:
    """Every effect that was fitted, most likely first."""
    outside = diagnosis.verdict.kind == OUTSIDE
    likely = "model weight" if outside or diagnosis.selection.unfinished else "probability"
    columns = ("effect", "on", likely, "size", f"left [{FLOORS}]", "closes", "")
    rows = tuple(_effect(diagnosis, effect) for effect in diagnosis.ranking)
    title = "Effects, nearest first: none explains all" if outside else "Effects, most likely first"
    return Table(title, columns, rows)


def _effect(diagnosis: Diagnosis, effect: RankedEffect) -> tuple[Cell, ...]:
    fitted = diagnosis.selection.fitted
    marks = ["taken"] if effect.taken else ["cannot be told apart"] if effect.in_set else []
    if effect.name in fitted and not effect.taken:
        marks += [f"beside {listed(effect.beside)}"] if effect.beside else []
        marks += summary.marks(diagnosis, fitted[effect.name])
    return (
        effect.name,
        effect.wire,
        likelihood(effect),
        ", ".join(f"{v.name.rpartition('.')[2]} {told(diagnosis, v)}" for v in effect.parameters),
        Quantity(effect.gap_after, digits=3),
        percent(effect.closed),
        ", ".join(marks),
    )


def fits(diagnosis: Diagnosis, fitted_models: Sequence[FittedModel], title: str) -> Table:
    """Every fit of so many effects, the best first."""
    weights = shown_weights(diagnosis, fitted_models)
    rows = tuple(
        (
            together(one.effects),
            Quantity(one.evidence.rms, interval=interval),
            weight,
            "in the set" if one in diagnosis.verdict.rivals else "",
            "converged" if one.converged else "did not converge",
        )
        for one, interval, weight in zip(fitted_models, intervals(fitted_models), weights)
    )
    columns = ("effects", f"left [{FLOORS}], 95 %", "model weight", "set", "search")
    return Table(title, columns, rows, folded=True)


def shown_weights(diagnosis: Diagnosis, fitted_models: Sequence[FittedModel]) -> list[str]:
    """Return model weights of fitted models of as many effects as were taken, "" for others."""
    weights = weights_by_effects(diagnosis.selection, diagnosis.verdict)
    return [_weight(weights[it.effects]) if it.effects in weights else "" for it in fitted_models]


def intervals(fitted_models: Sequence[FittedModel]) -> list[tuple[float, float]]:
    """Return 95 % intervals of the errors left [noise floors], as compared with the best.

    Blocks are drawn again, the same for all, and the ratio to the best fitted model is what
    varies: one whose interval reaches the best's error does as well.
    """
    if not fitted_models:
        return []
    losses = np.array([one.evidence.losses for one in fitted_models])
    best = int(np.argmin(losses.sum(axis=1)))
    blocks = losses.shape[1]
    draws = np.random.default_rng(0).integers(0, blocks, (DRAWS, blocks))
    drawn = losses[:, draws].sum(axis=2)
    ratios = np.sqrt(drawn / drawn[best])
    scale = fitted_models[best].evidence.rms
    limits = scale * np.quantile(ratios, (0.025, 0.975), axis=1)
    return [(float(low), float(high)) for low, high in limits.T]


def together(effects: Sequence[str]) -> str:
    """Return effects that act at once, in words."""
    return listed(effects) if effects else "parameters alone"


def reasons(diagnosis: Diagnosis) -> Table:
    """Why effects were not fitted, those of one reason in one row."""
    fitted = {effect.name for effect in diagnosis.ranking}
    rows: dict[str, list[str]] = {}
    for name, reason in summary.ruled_out(diagnosis).items():
        if name not in fitted:
            rows.setdefault(reason.partition(":")[0], []).append(name)
    cells = tuple((reason, ", ".join(names)) for reason, names in rows.items())
    return Table("Ruled out without a fit", ("why", "effects"), cells)


def ruled_out(diagnosis: Diagnosis) -> Table:
    """Why each effect is not named."""
    plant = diagnosis.model.plant
    rows = tuple(
        (
            name,
            plant.main_wire(name),
            reason,
            Quantity(diagnosis.selection.detectability[name].shown, digits=2),
            _about(diagnosis, name),
        )
        for name, reason in summary.ruled_out(diagnosis).items()
    )
    columns = ("effect", "on", "why", f"moves outputs by [{FLOORS}]", "what it is")
    return Table(f"Every effect that is not named ({len(rows)})", columns, rows, folded=True)


def _about(diagnosis: Diagnosis, name: str) -> str:
    module = inspect.getmodule(diagnosis.model.plant.placements[name][0].effect.function)
    return (inspect.getdoc(module) or "").partition("\n")[0]


def masked(diagnosis: Diagnosis) -> Table:
    """What parameters that explain the gap may hide."""
    plant = diagnosis.model.plant
    rows = tuple(
        (
            one.name,
            plant.main_wire(one.name),
            Quantity(one.moved, digits=3),
            summary.shown_by(one, diagnosis),
        )
        for one in diagnosis.masked
    )
    columns = ("effect", "on", f"up to [{FLOORS}]", "shown by the next experiment")
    return Table("Not ruled out: re-tuned parameters imitate them", columns, rows)


def parameters(diagnosis: Diagnosis) -> tuple[Table, Table]:
    """Nominal parameters before, alone and beside the effects, and the effects' own."""
    priors = {one.name: one.believed for one in diagnosis.selection.retuned.problem.free}
    moved = {} if diagnosis.within_tolerance else {one.name: one for one in diagnosis.moved}
    moves = summary.moves(diagnosis)
    known = diagnosis.model.plant.parameters
    rows, about = [], []
    for value in diagnosis.found:
        parameter = known[value.name]
        alone, prior = moved.get(value.name), priors.get(value.name)
        rows.append(
            (
                value.name,
                shown_value(parameter, value.nominal, digits=5),
                size(diagnosis, alone) if alone else "",
                size(diagnosis, value),
                Quantity(round(moves[value.name], 1) + 0.0) if value.name in moves else None,
                _doubt(value, alone),
            )
        )
        before = shown_value(parameter, prior, digits=2) if prior else ""
        about.append((value.name, before, parameter.param.about))
    columns = ("parameter", "before", "re-tuned alone", "after", "moved [prior deviations]", "")
    meanings = ("parameter", "prior deviation", "what it is")
    return (
        Table("Parameters, with standard errors", columns, tuple(rows)),
        Table("What these parameters are", meanings, tuple(about), folded=True),
    )


def _doubt(value: Value, alone: Value | None) -> str:
    """Why a value is doubtful, and that re-tuned alone it was on a bound."""
    was = f"alone {alone.doubt}" if alone and alone.doubt in BOUNDS else ""
    return ", ".join(filter(None, (value.doubt, was)))
