"""Pictures of a diagnosis: each draws on axes that somebody else has made."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from servo_models.analysis.experiment import display
from servo_models.diagnosis.design import Experiment, played
from servo_models.diagnosis.localisation import Breakdown
from servo_models.diagnosis.ranking import Value
from servo_models.diagnosis.residual_map import Curve
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.sections import tables
from servo_models.identification.problem import PRIOR_BOUND_SIGMAS
from servo_models.identification.readings import (
    Reading,
    axis_label,
    draw_whiteness,
    most_missed,
    stretch,
    whiteness_text,
    worst_sample,
)
from servo_models.report import curves
from servo_models.report.estimates import correlation_map, cost_profiles
from servo_models.report.sections import Picture
from servo_models.report.style import SERIES, colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ROW, MARGIN = 0.44, 0.85  # height of a row of a chart, and of everything else [inch]
CURVE = 2.4  # height of a curve of the residual map [inch]
SIGMAS_95 = 1.96
PANEL = 1.45  # height of a panel [inch]
EXPLANATIONS = (curves.JUDGED, curves.NOMINAL, curves.BETWEEN)
"""How the likeliest explanations are drawn in what an experiment is expected to show."""
NUMBERS = 5  # numbers on the axis of a short stretch, which are long ones
BEYOND = 3.0  # errors above this many times that of the nominal model are drawn at the edge
NEAR = 2.7  # prior standard deviations that are drawn at least
DOTTED = (0, (1, 1.5))


def responses(diagnosis: Diagnosis) -> tuple[Picture, ...]:
    """Return two pictures a response, that which is missed most first: measured and simulated with
    their errors, as a whole and where the nominal model is worst."""
    readings = most_missed(diagnosis.readings, diagnosis.floors)
    return tuple(picture for one in readings for picture in _response(one))


def residuals(diagnosis: Diagnosis) -> tuple[Picture, ...]:
    """Return whether what is left of each output is white and independent of the inputs."""
    missed = most_missed(diagnosis.readings, diagnosis.floors)
    worst = list({one.wire.name: one for one in reversed(missed)}.values())[::-1]
    draw = partial(draw_whiteness, every=worst)
    text, height = whiteness_text(worst), 3.2 + ROW * len(worst)
    return (Picture("Correlation of the errors", draw, text, rows=2, height=height),)


def _response(one: Reading) -> Iterator[Picture]:
    log, title = one.log, one.title
    errors = next(iter(one.simulated.values())) - one.measured
    worst = worst_sample(errors, log.fitted if log.fitted.any() else log.checked)
    window = stretch(errors, worst)
    held = " Shaded: held out by the description." if log.held_out.any() else ""
    at = f"{one.size(abs(float(errors[worst])))} at {log.stamps[worst]:.5g} s"
    whole = f"Above: measured and simulated; below: simulated minus measured.{held}"
    draw = partial(_draw_response, one, window, worst)
    yield Picture(title, partial(draw, slice(None)), whole, rows=2, height=3.6, shared=True)
    near = f"The framed stretch, where the model is worst before: {at}."
    yield Picture(f"{title}, near", partial(draw, window), near, rows=2, height=3.6, shared=True)


def _draw_response(
    one: Reading, window: slice, worst: int, part: slice, axes: Sequence[Axes]
) -> None:
    """Draw a part of a response, and below it the errors, if there are axes for them."""
    times, log = one.log.stamps, one.log
    simulated = {name: values[part] for name, values in one.simulated.items()}
    draws = {one.wire.name: curves.draw_responses, "error": curves.draw_errors}
    for panel, (name, draw) in zip(axes, draws.items()):
        draw(panel, times[part], one.measured[part], simulated, log.held_out[part])
        panel.set_ylabel(axis_label(name, one.unit), parse_math=False)
        if part is window:
            panel.axvline(times[worst], color=colour("muted"), lw=0.8, ls=curves.DASHED)
            panel.locator_params(axis="x", nbins=NUMBERS)
        elif len(axes) > 1:
            curves.draw_frame(panel, times[window])
    curves.draw_legend(axes[0], 1 + len(simulated))
    axes[-1].set_xlabel("time [s]")


def curve(diagnosis: Diagnosis, one: Curve) -> Picture:
    """Return a curve of the residual map with its band."""
    return Picture(
        f"Residual map of '{one.wire}'",
        partial(_draw_curve, diagnosis, one),
        "Line: what was learnt; band: its 95 % interval; dots: knots with data. Dotted: no sample"
        " is near, so nothing is known there.",
        height=CURVE,
    )


def _draw_curve(diagnosis: Diagnosis, one: Curve, axes: Sequence[Axes]) -> None:
    assert diagnosis.residual_map is not None
    (panel,) = axes
    (of, of_unit), (unit, to_unit) = tables.curve_units(diagnosis, one)
    x, y, band = of * one.knots, unit * one.values, unit * SIGMAS_95 * one.errors
    seen = one.samples > 0
    panel.axhline(0.0, color=colour("muted"), lw=0.6)
    panel.plot(x, y, color=colour("muted"), lw=1.0, ls=DOTTED)
    known, low, high = (np.where(seen, it, np.nan) for it in (y, y - band, y + band))
    panel.fill_between(x, low, high, color=colour("blue"), alpha=0.2, lw=0)
    panel.plot(x, known, color=colour("blue"), lw=1.6, marker=".")
    panel.set_xlabel(axis_label(one.wire, of_unit), parse_math=False)
    panel.set_ylabel(axis_label(diagnosis.residual_map.wire, to_unit), parse_math=False)


def place(one: Breakdown) -> Picture:
    """Return two bars for each part of a dimension, its name and shares above them."""
    return Picture(
        f"By {one.dimension}",
        partial(_draw_place, one),
        f"{one.sentence} Upper bars: before; lower bars: after; upright marks: the noise floor.",
        height=MARGIN + ROW * len(one.bins),
    )


def _draw_place(breakdown: Breakdown, axes: Sequence[Axes]) -> None:
    (panel,) = axes
    for row, one in enumerate(breakdown.bins):
        panel.barh(row + 0.02, one.rms_before, 0.2, color=colour("orange"), alpha=0.75, lw=0)
        panel.barh(row + 0.24, one.rms_after, 0.2, color=colour("blue"), alpha=0.85, lw=0)
        panel.vlines(1.0, row - 0.12, row + 0.38, color=colour("ink"), lw=0.9)
        curves.draw_label(panel, row - 0.14, f"{one.label}, gets worse" if one.worse else one.label)
        shares = f"{100.0 * one.share_before:.0f} % → {100.0 * one.share_after:.0f} %"
        curves.draw_label(panel, row - 0.14, shares, right=True)
    panel.set(ylim=(len(breakdown.bins) - 0.4, -0.65), xlabel="RMS error [noise floors]")
    _without_scale(panel)


def fits(diagnosis: Diagnosis, fitted_models: Sequence[FittedModel], title: str) -> Picture:
    """Return what each fit leaves, with intervals of the comparison with the best."""
    return Picture(
        title,
        partial(_draw_fits, diagnosis, fitted_models),
        "Upright marks: the noise floor; dotted: the best. Lines: 95 % intervals of the comparison"
        " with the best: one that reaches the best does as well. Filled: in the set."
        " At the right: model weight.",
        height=MARGIN + ROW * (len(fitted_models) + 1),
    )


def _draw_fits(
    diagnosis: Diagnosis, fitted_models: Sequence[FittedModel], axes: Sequence[Axes]
) -> None:
    (panel,) = axes
    count, best = len(fitted_models), fitted_models[0].evidence.rms
    edge = BEYOND * diagnosis.selection.before.rms
    weights = tables.shown_weights(diagnosis, fitted_models)
    limits = tables.intervals(fitted_models)
    for row, (one, interval, weight) in enumerate(zip(fitted_models, limits, weights)):
        member, error = one in diagnosis.verdict.rivals, one.evidence.rms
        tint = colour("blue" if member else "muted")
        if error > edge:
            panel.plot(edge, row, ">", color=tint, mfc="none")
        else:
            panel.plot(np.minimum(interval, edge), [row, row], color=tint, lw=1.6)
            panel.plot(error, row, "o", color=tint, mfc=tint if member else colour("paper"))
        curves.draw_label(
            panel, row - 0.2, tables.together(one.effects), tint="ink" if member else "muted"
        )
        curves.draw_label(panel, row - 0.2, weight, right=True)
    alone = diagnosis.selection.retuned.evidence.rms
    panel.plot(min(alone, edge), count, "D", color=colour("green"), ms=4.5)
    curves.draw_label(panel, count - 0.2, "nominal parameters alone", tint="muted")
    for row in range(count + 1):
        panel.vlines(1.0, row - 0.18, row + 0.22, color=colour("ink"), lw=0.9)
        panel.vlines(best, row - 0.18, row + 0.22, color=colour("blue"), lw=0.8, ls=DOTTED)
    panel.set(xscale="log", xlim=(0.75 * min(1.0, best), 1.25 * edge), ylim=(count + 0.5, -0.75))
    panel.xaxis.set_major_formatter("{x:g}")
    panel.set_xlabel("error on blocks left out [noise floors]")
    _without_scale(panel)


def moved(diagnosis: Diagnosis) -> tuple[Picture, ...]:
    """Return how far each parameter moved, in standard deviations of what was known before."""
    free = diagnosis.selection.retuned.problem.free
    priors = {one.name: one.believed for one in free if one.believed}
    if diagnosis.within_tolerance or not priors:
        return ()
    picture = Picture(
        "How far nominal parameters moved",
        partial(_draw_moved, diagnosis, priors),
        "Shaded: one and two standard deviations of what was known before. Far outside: either that"
        " was too sure, or the parameter stands in for an effect that the model lacks. Lines:"
        " standard errors.",
        height=MARGIN + ROW * len(priors),
    )
    return (picture,)


def _draw_moved(diagnosis: Diagnosis, priors: Mapping[str, float], axes: Sequence[Axes]) -> None:
    (panel,) = axes
    names = diagnosis.stages
    found = diagnosis.found if diagnosis.selection.taken.effects else ()
    final = {value.name: value for value in found}
    for width, opacity in ((2.0, 0.35), (1.0, 0.55)):
        panel.axvspan(-width, width, color=colour("grid"), alpha=opacity, lw=0, zorder=0)
    farthest = NEAR
    for values, shift, style in (
        ({one.name: one for one in diagnosis.moved}, -0.09, (names["retuned"], "green", "D")),
        (final, 0.13, (names.get("after", ""), "blue", "o")),
    ):
        shown = [values[name] for name in priors if values]
        farthest = max(farthest, _draw_moves(panel, shown, priors, shift, style))
    for row, name in enumerate(priors):
        curves.draw_label(panel, row - 0.25, name)
    panel.set(xlim=(-1.1 * farthest, 1.1 * farthest), ylim=(len(priors) - 0.4, -0.75))
    panel.set_xlabel("prior standard deviations from nominal")
    panel.legend(loc="lower left", bbox_to_anchor=(-0.02, 0.98), ncols=2, frameon=False)
    _without_scale(panel)


def _draw_moves(
    axes: Axes,
    values: Sequence[Value],
    priors: Mapping[str, float],
    shift: float,
    style: tuple[str, str, str],
) -> float:
    """Draw a point for each value and return the largest distance [prior deviations]."""
    if not values:
        return 0.0
    label, tint, marker = style
    distances = [(one.value - one.nominal) / priors[one.name] for one in values]
    known = [one.standard_error / priors[one.name] for one in values]
    errors = np.clip(np.nan_to_num(known), 0.0, PRIOR_BOUND_SIGMAS)  # all of it
    rows = np.arange(len(values)) + shift
    axes.errorbar(
        distances, rows, xerr=errors, fmt=marker, color=colour(tint), ms=4.5, lw=1.4, label=label
    )
    return float(np.abs(distances).max())


def estimates(diagnosis: Diagnosis) -> Iterator[Picture]:
    """Give how estimates hang together, and the squared errors along each."""
    taken = diagnosis.selection.taken
    if taken.problem.free:
        names = [free.name for free in taken.problem.free]
        yield from correlation_map(names, taken.spread.correlations)
        yield from cost_profiles(taken.spread.profiles)


def experiment(diagnosis: Diagnosis, one: Experiment) -> Picture:
    """Return a command, each output as the likeliest explanations predict it, and by how much the
    others differ from the likeliest."""
    rows = 2 + len(one.floors)
    return Picture(
        " or ".join(tables.together(effects) for effects in one.explanations),
        partial(_draw_experiment, diagnosis, one),
        "From above: the command to play, what the likeliest explanations predict, and by how much"
        " they differ from the first before any is re-fitted. Shaded: the noise floor.",
        rows=rows,
        height=0.7 + PANEL * rows,
        shared=True,
    )


def _draw_experiment(diagnosis: Diagnosis, one: Experiment, axes: Sequence[Axes]) -> None:
    rivals = {it.effects: it for it in diagnosis.undecided}
    likeliest = [rivals[effects] for effects in one.explanations[: len(EXPLANATIONS)]]
    names = [tables.together(it.effects) for it in likeliest]
    *_, plan = one.plans
    told = [played(it, [plan], one.floors).responses(it.evidence.vector)[0] for it in likeliest]
    command, *predicted, difference = axes
    scale, unit = display(one.wire)
    thin = curves.envelope(one.times, scale * one.command, curves.BUCKETS)
    command.plot(*thin, color=colour("ink"), lw=0.9)
    command.set_ylabel(axis_label(one.wire.name, unit), parse_math=False)
    for output, panel in zip(one.floors, predicted):
        scale, unit = display(diagnosis.model.plant.wire[output])
        for name, values, style in zip(names, told, EXPLANATIONS):
            curves.draw_curve(panel, one.times, scale * values[output], name, style)
        panel.set_ylabel(axis_label(output, unit), parse_math=False)
    differences = [
        (f"{output}, {name}", (values[output] - told[0][output]) / floor)
        for output, floor in one.floors.items()
        for name, values in zip(names[1:], told[1:])
    ]
    for (label, apart), series in zip(differences, SERIES * len(differences)):
        curves.draw_curve(difference, one.times, apart, label, (series, "-", 1.0, 1.0))
    curves.draw_legend(predicted[0], len(likeliest))
    if len(differences) > 1:
        curves.draw_legend(difference, len(differences))
    difference.axhspan(-1.0, 1.0, color=colour("grid"), alpha=0.8, lw=0, zorder=0)
    difference.set(xlabel="time [s]", xlim=(one.times[0], one.times[-1]))
    difference.set_ylabel("difference\n[noise floors]")


def _without_scale(axes: Axes) -> None:
    """Rows have their names above them, and no scale at their side."""
    axes.set_axisbelow(True)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
