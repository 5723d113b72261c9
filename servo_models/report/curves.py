"""Curves that every domain draws: measured and simulated responses, from plain arrays."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from servo_models.report.style import colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

BUCKETS = 400  # stretches of a long curve whose extremes are drawn, about one a pixel
WIDE_LABELS = 48  # characters of curve names that fit on a line above a panel
SAMPLE = 3  # characters that the piece of line before a name takes
ROOM = 0.15  # space above and below the measured and the judged curve, over their range
SMALL = 1e-3  # number below which an axis has a power of ten
DASHED = (0, (4, 3))

Style = tuple[str, Any, float, float]
MEASURED: Style = ("muted", "-", 3.0, 0.55)
NOMINAL: Style = ("orange", "--", 1.1, 1.0)
BETWEEN: Style = ("green", (0, (1, 1.2)), 1.3, 1.0)
JUDGED: Style = ("blue", "-", 1.1, 1.0)  # colour, dash, width and opacity of a curve


def draw_curve(axes: Axes, x: Array, y: Array, name: str, style: Style) -> None:
    """Draw a curve, thinned out to the resolution of a screen."""
    series, dash, width, opacity = style
    curve = envelope(x, y, BUCKETS)
    axes.plot(*curve, color=colour(series), ls=dash, lw=width, alpha=opacity, label=name)


def draw_responses(
    axes: Axes, times: Array, measured: Array, simulated: Mapping[str, Array], held_out: Mask
) -> None:
    """Draw the measurement as a broad grey line, the models on top, and held-out stretches shaded.

    Args:
        axes: to draw on.
        times: [s], shape (n,).
        measured: shape (n,), in the unit that is shown.
        simulated: the same by the name of the model, the nominal first, the judged one last.
        held_out: samples that no fit has seen, shape (n,).
    """
    draw_curve(axes, times, measured, "measured", MEASURED)
    draw_models(axes, times, simulated, held_out)
    shown = np.concatenate([measured, list(simulated.values())[-1]])
    low, high = float(shown.min()), float(shown.max())
    room = ROOM * (high - low) or 1.0
    axes.set_ylim(low - room, high + room)  # the nominal model may leave it


def draw_errors(
    axes: Axes, times: Array, measured: Array, simulated: Mapping[str, Array], held_out: Mask
) -> None:
    """Draw simulated minus measured; see ``draw_responses``."""
    errors = {name: values - measured for name, values in simulated.items()}
    axes.axhline(0.0, color=colour("muted"), lw=0.7)
    draw_models(axes, times, errors, held_out)
    if 0.0 < max(float(np.abs(values).max()) for values in errors.values()) < SMALL:
        axes.ticklabel_format(axis="y", style="sci", scilimits=(0, 0), useMathText=True)


def draw_models(axes: Axes, times: Array, curves: Mapping[str, Array], held_out: Mask) -> None:
    """Draw a curve for each model, nominal dashed and first, the judged one solid and last."""
    shade(axes, times, held_out)
    styles = [NOMINAL, *[BETWEEN] * (len(curves) - 2), JUDGED][: len(curves)]
    for (name, values), style in zip(curves.items(), styles):
        draw_curve(axes, times, values, name, style)
    axes.set_xlim(times[0], times[-1])


def draw_frame(axes: Axes, times: Array) -> None:
    """Frame the stretch that another panel shows."""
    axes.axvspan(times[0], times[-1], facecolor="none", edgecolor=colour("ink"), lw=0.8)


def draw_legend(axes: Axes, count: int) -> None:
    """Name ``count`` curves above a panel, in one line as wide as they need, or one below another
    where that is wider than a panel."""
    _, labels = axes.get_legend_handles_labels()
    if sum(map(len, labels)) + SAMPLE * len(labels) > WIDE_LABELS:
        count = 1
    lines = -(-len(labels) // count)
    axes.set_title(" ", fontsize=8.5, pad=6.0 + 13.0 * (lines - 1))
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(-0.06, 0.98),
        ncols=count,
        frameon=False,
        handlelength=1.4,
        handletextpad=0.4,
        columnspacing=0.8,
        fontsize=8.5,
    ).set_in_layout(False)


def draw_label(axes: Axes, row: float, text: str, right: bool = False, tint: str = "ink") -> None:
    """Write a label above a row of a chart, at its left or right end: no column, for phones."""
    axes.text(
        float(right),
        row,
        text,
        transform=axes.get_yaxis_transform(),
        ha="right" if right else "left",
        va="bottom",
        fontsize=8.5,
        color=colour(tint),
        parse_math=False,
    ).set_in_layout(False)


def shade(axes: Axes, times: Array, mask: Mask) -> None:
    """Shade the stretches in which ``mask`` holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    for first, end in edges.reshape(-1, 2):
        axes.axvspan(times[first], times[end - 1], color=colour("grid"), alpha=0.6, lw=0, zorder=0)


def envelope(x: Array, y: Array, buckets: int) -> tuple[Array, Array]:
    """Return the ends, and the extremes of each of ``buckets`` stretches, of a long curve."""
    n = len(y)
    if n <= 2 * buckets:
        return x, y
    starts = np.linspace(0, n, buckets, endpoint=False).astype(int)
    ends = np.append(starts[1:], n)
    kept = {0, n - 1}
    for start, end in zip(starts, ends):
        piece = y[start:end]
        kept |= {start + int(piece.argmin()), start + int(piece.argmax())}
    chosen = sorted(kept)
    return x[chosen], y[chosen]
