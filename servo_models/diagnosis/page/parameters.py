"""Section: what the nominal parameters became, and the sizes of the effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from servo_models.analysis.explain import display_scale, display_unit
from servo_models.diagnosis.claims import Claim, Value
from servo_models.diagnosis.fitting.nominal import BELIEVED
from servo_models.diagnosis.page.stages import RETUNED, stages
from servo_models.diagnosis.result import Diagnosis
from servo_models.identification.page.readings import words
from servo_models.report.parts import NONE, Line, Section, Table, number, printed
from servo_models.report.sheets import with_error
from servo_models.report.style import Picture, colour, drawing, picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

TITLE = "Parameters"
EFFECTS = ("effect", "parameter", "value", "± standard error", "unit", "meaning")
NUMBERS = ("value", "± standard error", "nominal", "prior ±")
BY_LOGS = "± by these logs"
"""Standard error where nothing was re-tuned: how well the logs know it."""
ROW, MARGIN = 0.42, 0.9
"""Height of a row and of everything else [inch]."""
NEAR = 2.7
"""Prior standard deviations that are drawn at least."""


def section(found: Diagnosis) -> Section | None:
    """Return the parameters of effects and the nominal ones that were free; None without any."""
    named = [claim for claim in found.claims if claim.in_set or claim.taken]
    tables = [_effects(found, named)] if named else []
    pictures = []
    if found.moved:
        final = _final(found)
        tables.append(_nominal(found, final))
        if not found.within_tolerance:
            pictures.append(_picture(found, final))
    if not tables:
        return None
    return Section(
        "parameters",
        TITLE,
        "Standard errors count correlated residuals; they do not count what the model lacks.",
        tuple(tables),
        tuple(pictures),
    )


def _final(found: Diagnosis) -> dict[str, Value]:
    """Nominal parameters beside the effects that were taken."""
    return {value.name: value for value in found.found} if found.causes.taken.effects else {}


def _effects(found: Diagnosis, claims: Sequence[Claim]) -> Table:
    lines = tuple(_size(found, claim, value) for claim in claims for value in claim.parameters)
    return Table("Parameters of the effects", EFFECTS, lines, NUMBERS)


def _size(found: Diagnosis, claim: Claim, value: Value) -> Line:
    parameter = found.model.plant.parameters[value.name]
    own = words(value.name.rpartition(".")[2])
    figures = _figures(found, value)
    return Line((words(claim.name), own, *figures, display_unit(parameter), parameter.param.about))


def _figures(found: Diagnosis, value: Value) -> tuple[str, str]:
    scale = display_scale(found.model.plant.parameters[value.name])
    estimate, error = with_error(scale * value.value, scale * value.standard_error)
    return printed(estimate), printed(error) or NONE


def _nominal(found: Diagnosis, final: dict[str, Value]) -> Table:
    names = [RETUNED, *([stages(found)["after"]] if final else [])]
    told = [column for name in names for column in (name, f"± {name}")]
    if found.within_tolerance:
        told = [BY_LOGS]
    figures = ("nominal", "prior ±", *told)
    lines = []
    for free, value in zip(found.causes.retuned.problem.free, found.moved):
        parameter = found.model.plant.parameters[free.name]
        scale = display_scale(parameter)
        values = [value, *([final[free.name]] if final else [])]
        cells = (
            number(scale * free.nominal, 5),
            number(free.prior and scale * free.prior, 3),
            *[text for one in values for text in _figures(found, one)][-len(told) :],
        )
        lines.append(Line((free.name, *cells, display_unit(parameter), parameter.param.about)))
    columns = ("parameter", *figures, "unit", "meaning")
    return Table("Nominal parameters", columns, tuple(lines), figures)


def _picture(found: Diagnosis, final: dict[str, Value]) -> Picture:
    """How far each parameter moved, in standard deviations of what was known before."""
    priors = {free.name: free.prior for free in found.causes.retuned.problem.free if free.prior}
    farthest = NEAR
    with drawing("moved", height=MARGIN + ROW * len(priors)) as (figure, (axes,)):
        for width, opacity in ((2.0, 0.35), (1.0, 0.55)):
            axes.axvspan(-width, width, color=colour("grid"), alpha=opacity, lw=0, zorder=0)
        for values, shift, style in (
            ({one.name: one for one in found.moved}, -0.09, (RETUNED, "green", "D")),
            (final, 0.13, (stages(found).get("after", ""), "blue", "o")),
        ):
            moved = [values[name] for name in priors if values]
            farthest = max(farthest, _moved(axes, moved, priors, shift, style))
        across = axes.get_yaxis_transform()
        for row, name in enumerate(priors):
            axes.text(0.0, row - 0.25, name, transform=across, va="bottom", fontsize=8.5)
        axes.set(xlim=(-1.1 * farthest, 1.1 * farthest), ylim=(len(priors) - 0.4, -0.75))
        axes.set(xlabel="prior standard deviations from nominal", yticks=[])
        axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 0.98), ncols=2, frameon=False)
        axes.spines["left"].set_visible(False)
        return picture(
            figure,
            "moved",
            "How far nominal parameters moved",
            "Shaded: one and two standard deviations of what was known before. Far outside:"
            " either that was too sure, or the parameter stands in for an effect that the"
            " model lacks. Lines: standard errors.",
        )


def _moved(
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
    moved = [(one.value - one.nominal) / priors[one.name] for one in values]
    known = [one.standard_error / priors[one.name] for one in values]
    # what the logs do not determine has the whole width
    errors = np.clip(np.nan_to_num(known), 0.0, BELIEVED)
    rows = np.arange(len(values)) + shift
    axes.errorbar(
        moved, rows, xerr=errors, fmt=marker, color=colour(tint), ms=4.5, lw=1.4, label=label
    )
    return float(np.abs(moved).max())
