"""Section: estimates with their uncertainty, and how they hang together."""

from __future__ import annotations

import itertools
import math

import numpy as np

from servo_models.analysis.explain import display_scale, display_unit
from servo_models.identification.problem import Free
from servo_models.identification.result import Identification
from servo_models.identification.uncertainty import doubt
from servo_models.report.parts import MINUS, NONE, Line, Section, Table, number, printed
from servo_models.report.sheets import with_error
from servo_models.report.style import Picture, colour, drawing, picture

TITLE = "Parameters"
COLUMNS = ("parameter", "estimate", "± standard error", "unit", "nominal", "prior ±", "meaning")
NUMBERS = ("estimate", "± standard error", "nominal", "prior ±")
MANY = 12
"""Largest number of parameters whose correlations are drawn."""


def section(found: Identification) -> Section:
    """Return the table of estimates and the map of their correlations."""
    rows = zip(found.free, found.values.tolist(), found.standard_errors.tolist())
    lines = tuple(_line(found, free, value, error) for free, value, error in rows)
    return Section(
        "parameters",
        TITLE,
        "Standard errors count correlated residuals; they do not count what the model lacks."
        " A prior is the standard deviation of the nominal value."
        f" Condition of the fit: {number(found.condition, 2)}.",
        (Table("Estimated parameters", COLUMNS, lines, NUMBERS),),
        (_correlations(found),) if 1 < len(found.free) <= MANY else (),
    )


def _line(found: Identification, free: Free, value: float, error: float) -> Line:
    parameter = found.fitted.plant.parameters[free.name]
    scale = display_scale(parameter)
    reason = doubt(free, value, error)
    cells = (
        free.name,
        *(printed(text) or NONE for text in with_error(scale * value, scale * error)),
        display_unit(parameter),
        number(scale * free.nominal, 5),
        number(None if free.prior is None else scale * free.prior, 3),
        parameter.param.about,
    )
    return Line(cells, reason or "determined", None if reason else True)


def _correlations(found: Identification) -> Picture:
    """A square for each pair: its colour and number are the sign, its opacity the strength."""
    from matplotlib.patches import Rectangle

    p = len(found.free)
    with drawing("correlations", height=0.8 + 0.26 * p) as (figure, (axes,)):
        for j, i in itertools.combinations_with_replacement(range(p), 2):
            value = float(found.correlations[i, j])
            own = i == j
            blank = own or math.isnan(value)
            tint = colour("muted" if blank else "orange" if value > 0.0 else "blue")
            strength = 0.25 if own else 0.08 if blank else 0.6 * abs(value)
            axes.add_patch(Rectangle((j, i), 1, 1, color=tint, alpha=strength, lw=0))
            if not blank:
                axes.text(j + 0.5, i + 0.5, _short(value), ha="center", va="center", size=7.5)
        axes.set(xlim=(0, p), ylim=(p, 0))
        axes.set_xticks(np.arange(p) + 0.5, [str(j + 1) for j in range(p)])
        names = [f"{free.name}  {i + 1}" for i, free in enumerate(found.free)]
        axes.set_yticks(np.arange(p) + 0.5, names)
        axes.grid(visible=False)
        axes.tick_params(length=0)
        return picture(
            figure,
            "correlations",
            "Correlation of the estimates",
            "Near 1 or -1: the logs fix a combination of the two, not each of them."
            " Without a number: on a bound or not excited.",
        )


def _short(value: float) -> str:
    """Two decimals, as short as a small square wants them."""
    text = f"{abs(value):.2f}".removeprefix("0")
    return text if value >= 0.0 or text == ".00" else MINUS + text
