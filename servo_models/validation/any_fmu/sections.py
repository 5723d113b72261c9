"""A comparison with a reference as people read it: sentences, and curves in their tubes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from servo_models.report.sections import Picture, Section
from servo_models.report.style import colour
from servo_models.validation.any_fmu.comparison import Compared
from servo_models.validation.rows import FILES, REFERENCE, Validation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_PICTURES = 12  # outputs that are drawn at most
MOST_POINTS = 2000  # points of a curve in a picture, at most about


def faults(validation: Validation) -> Section:
    """Return what is wrong, a sentence each."""
    told = [row.note for row in validation.failures if row.claim in (REFERENCE, FILES) and row.note]
    return Section("What is wrong", items=tuple(dict.fromkeys(told)))


def notes(validation: Validation) -> Section:
    """Return what is worth knowing but not judged, a line each."""
    told = [
        f"{row.subject}, {row.case}, {row.quantity}: {row.note}"
        for row in validation.rows
        if row.claim in (REFERENCE, FILES) and row.passed is None and row.note
    ]
    return Section("Worth knowing", items=tuple(told))


def curves(compared: Sequence[Compared]) -> Section:
    """Return outputs beside their references; those that failed first."""
    shown = sorted((it for it in compared if len(it.times)), key=lambda it: it.passed)
    pictures = tuple(
        Picture(
            f"Output {output.name}",
            partial(_draw, output),
            output.fault or "The output stays in the tube.",
            rows=2,
            height=4.2,
            shared=True,
        )
        for output in shown[:MOST_PICTURES]
    )
    return Section(
        "Outputs and references",
        "Above: the output on its reference. Below: the difference, and in grey what the"
        " tolerances in value and time allow.",
        pictures=pictures,
    )


def _draw(output: Compared, panels: Sequence[Axes]) -> None:
    above, below = panels
    every = max(len(output.times) // MOST_POINTS, 1)
    times = output.times[::every]
    right, got = output.reference.at(times), output.response.at(times)
    low, high = output.low[::every], output.high[::every]
    style: Literal["steps-post", "default"] = "steps-post" if output.reference.held else "default"
    above.plot(times, right, color=colour("blue"), label="reference", drawstyle=style)
    above.plot(times, got, color=colour("orange"), ls=(0, (4, 2)), label="FMU", drawstyle=style)
    above.legend(loc="best", frameon=False)
    above.set_ylabel(_labelled(output.name, output.unit))
    below.fill_between(
        times,
        low - right,
        high - right,
        step="post" if output.reference.held else None,
        color=colour("grid"),
        lw=0.0,
    )
    below.plot(times, got - right, color=colour("orange"), drawstyle=style)
    widest = max(float(np.max(np.abs(got - right))), float(np.median(high - low)))
    below.set_ylim(-1.2 * widest, 1.2 * widest)
    below.set_ylabel("difference")
    below.set_xlabel("time [s]")


def _labelled(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} [{unit}]"
