"""Section: where the gap lies, by what the actuator did."""

from __future__ import annotations

import math
from collections.abc import Sequence

from servo_models.diagnosis.where import Bin, Breakdown
from servo_models.report.parts import NONE, Line, Section, Table, number
from servo_models.report.style import Picture, colour, drawing, picture

TITLE = "Where it lies"
COLUMNS = (
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
NUMBERS = COLUMNS[1:-1]
ROW, MARGIN = 0.45, 0.85
"""Height of a part and of everything else [inch]."""


def section(found: Sequence[Breakdown]) -> Section | None:
    """Return a table for each dimension, and a picture where it divides the logs.

    Pictures of much the same height stand side by side.
    """
    if not found:
        return None
    drawn = sorted((one for one in found if len(one.bins) > 1), key=lambda one: len(one.bins))
    return Section(
        "where",
        TITLE,
        "RMS errors in noise floors, before and after; the share of the squared error is written"
        " above each pair of bars. Errors after are those on stretches of time that were kept from"
        " the fit; only in the table by block of the model the fit used all samples. Errors over"
        " the local amplitude of the response show what small motions lack; closed is the share of"
        " what lies above the noise floor, which is not known of a band of frequency.",
        tuple(_table(one) for one in found),
        tuple(_picture(one, f"where-{i}") for i, one in enumerate(drawn)),
    )


def _table(found: Breakdown) -> Table:
    lines = tuple(_line(one) for one in found.bins)
    return Table(f"By {found.dimension}", COLUMNS, lines, NUMBERS, folded=True)


def _line(one: Bin) -> Line:
    return Line(
        (
            one.label,
            _percent(one.share_before),
            _percent(one.share_after),
            number(one.rms_before, 3),
            number(one.rms_after, 3),
            _percent(one.relative_before),
            _percent(one.relative_after),
            _percent(math.nan if one.closed is None else one.closed),
            f"{one.count}" if one.count else NONE,
            "gets worse" if one.worse else "",
        )
    )


def _percent(share: float) -> str:
    if not math.isfinite(share):
        return NONE
    percent = 100.0 * share
    return f"{number(percent, 2 if abs(percent) < 99.5 else 3)} %"


def _picture(found: Breakdown, name: str) -> Picture:
    """Two bars for each part, its name and shares above them."""
    count = len(found.bins)
    with drawing(name, height=MARGIN + ROW * count) as (figure, (axes,)):
        for row, one in enumerate(found.bins):
            axes.barh(row + 0.02, one.rms_before, 0.2, color=colour("orange"), alpha=0.75, lw=0)
            axes.barh(row + 0.24, one.rms_after, 0.2, color=colour("blue"), alpha=0.85, lw=0)
            shares = f"{_whole(one.share_before)} → {_whole(one.share_after)}"
            for at, text, align in ((0.0, one.label, "left"), (1.0, shares, "right")):
                axes.text(
                    at,
                    row - 0.14,
                    f"{text}, gets worse" if one.worse and align == "left" else text,
                    transform=axes.get_yaxis_transform(),
                    ha=align,
                    va="bottom",
                    fontsize=8.5,
                    color=colour("ink"),
                    parse_math=False,
                ).set_in_layout(False)
            axes.vlines(1.0, row - 0.12, row + 0.38, color=colour("ink"), lw=0.9)
        axes.set_axisbelow(True)
        axes.set(ylim=(count - 0.4, -0.65), yticks=[], xlabel="RMS error [noise floors]")
        axes.spines["left"].set_visible(False)
        return picture(
            figure,
            name,
            f"By {found.dimension}",
            f"{found.sentence} Upper bars: before; lower bars: after; upright marks: the noise"
            " floor.",
        )


def _whole(share: float) -> str:
    return f"{100.0 * share:.0f} %"
