"""Pictures of the uncertainty of estimates: correlations, and the cost along each estimate."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from servo_models.report.curves import DASHED, draw_label
from servo_models.report.numbers import printed
from servo_models.report.sections import Picture
from servo_models.report.style import colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Profile = tuple[str, Sequence[tuple[float, float]], float, float]
"""Name of an estimate; distances [standard errors] with the rise of the squared errors there over
all of them; the same rise at a standard error by slopes, the others following and held."""

MANY = 12  # most estimates whose correlations are drawn
REACH = 3.2  # standard errors to each side that are drawn at least
ROW = 0.6  # height of a row of the profiles [inch]
MARGIN = 0.75  # height of everything else [inch]
HIGHEST = 0.5  # height of a row's highest dot over that of the row
CUT = 0.56  # height above which a curve is cut, over that of the row


def correlation_map(names: Sequence[str], correlations: NDArray[np.float64]) -> list[Picture]:
    """Return a square for each pair of estimates: its colour and number are the sign, its opacity
    the strength.  There is none for one estimate, or for more than ``MANY``.

    ``correlations`` have the shape (p, p), NaN where there is none.
    """
    p = len(names)

    def draw(panels: Sequence[Axes]) -> None:
        from matplotlib.patches import Rectangle

        (axes,) = panels
        for j, i in itertools.combinations_with_replacement(range(p), 2):
            value = float(correlations[i, j])
            same = i == j
            blank = same or math.isnan(value)
            tint = colour("muted" if blank else "orange" if value > 0.0 else "blue")
            strength = 0.25 if same else 0.08 if blank else 0.6 * abs(value)
            axes.add_patch(Rectangle((j, i), 1, 1, color=tint, alpha=strength, lw=0))
            if not blank:
                axes.text(j + 0.5, i + 0.5, _short(value), ha="center", va="center", size=7.5)
        axes.set(xlim=(0, p), ylim=(p, 0))
        axes.set_xticks(np.arange(p) + 0.5, [str(j + 1) for j in range(p)])
        rows = [f"{name}  {i + 1}" for i, name in enumerate(names)]
        axes.set_yticks(np.arange(p) + 0.5, rows)
        axes.grid(visible=False)
        axes.tick_params(length=0)

    picture = Picture(
        "Correlation of the estimates",
        draw,
        "Near 1 or -1: the logs fix a combination of the two, not each of them."
        " Without a number: on a bound or not excited.",
        height=0.8 + 0.26 * p,
    )
    return [picture] if 1 < p <= MANY else []


def _short(value: float) -> str:
    """A correlation with two decimals, short enough for a small square."""
    text = f"{abs(value):.2f}".removeprefix("0")
    return text if value >= 0.0 or text == ".00" else printed(f"-{text}")


def cost_profiles(profiles: Sequence[Profile]) -> list[Picture]:
    """Return the squared errors along each estimate, a row for each; no picture without a row."""

    def draw(panels: Sequence[Axes]) -> None:
        (axes,) = panels
        reach = max(REACH, *(1.1 * abs(x) for _, points, *_ in profiles for x, _ in points))
        for row, (name, points, following, held) in enumerate(profiles):
            top = max(abs(rise) for _, rise in points) or 1.0
            for curvature, series, dash in ((held, "muted", DASHED), (following, "blue", "-")):
                steepness = HIGHEST * curvature / top
                end = min(reach, math.sqrt(CUT / steepness))
                across = np.linspace(-end, end, 51)
                axes.plot(
                    across, steepness * across**2 - row, color=colour(series), ls=dash, lw=1.1
                )
            distances, rises = zip(*points)
            heights = HIGHEST * np.array(rises) / top - row
            axes.plot(distances, heights, "o", color=colour("orange"), ms=4.5)
            axes.plot(0.0, -row, "|", color=colour("ink"), ms=7.0)
            draw_label(axes, 0.6 - row, name)
            draw_label(axes, 0.6 - row, f"+{100.0 * top:.2g} %", right=True, tint="muted")
        axes.set(xlim=(-reach, reach), ylim=(0.85 - len(profiles), 1.0))
        axes.set_xlabel("standard errors from the estimate")
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)

    picture = Picture(
        "Cost along each parameter",
        draw,
        "Squared errors with priors, the others following along their slopes; no full profile,"
        " which would fit them again. Dots: simulated. Line: second order, by the slopes; dots off"
        " it show an uneven interval. Dashed: the others held; steeper where they can stand in. At"
        " the right: the rise at the highest dot.",
        height=MARGIN + ROW * len(profiles),
    )
    return [picture] if profiles else []
