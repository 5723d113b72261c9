"""What a comparison with a reference says to people: sentences, and curves in their tubes."""

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

MOST_PICTURES = 12
MOST_POINTS = 2000  # points of a curve in a picture, at most about


def faults(validation: Validation) -> Section:
    """Return what is wrong, a sentence each."""
    told = [row.note for row in validation.failures if row.claim in (REFERENCE, FILES) and row.note]
    return Section("What is wrong", items=tuple(dict.fromkeys(told)))


def notes(validation: Validation) -> Section:
    """Return what is not judged and worth knowing, a line each."""
    told = [
        f"{row.subject}, {row.case}, {row.quantity}: {row.note}"
        for row in validation.rows
        if row.claim in (REFERENCE, FILES) and row.passed is None and row.note
    ]
    return Section("Worth knowing", items=tuple(told))


def curves(compared: Sequence[Compared]) -> Section:
    """Return outputs beside their references; those that failed first."""
    shown = sorted((one for one in compared if len(one.times)), key=lambda one: one.passed)
    pictures = tuple(
        Picture(
            f"Output {one.name}",
            partial(_draw, one),
            one.fault or "The output stays in the tube.",
            rows=2,
            height=4.2,
            shared=True,
        )
        for one in shown[:MOST_PICTURES]
    )
    return Section(
        "Outputs and references",
        "Above: the output on its reference. Below: the difference, and in grey what the"
        " tolerances in value and time allow.",
        pictures=pictures,
    )


def _draw(one: Compared, panels: Sequence[Axes]) -> None:
    above, below = panels
    every = max(len(one.times) // MOST_POINTS, 1)
    times = one.times[::every]
    right, got = one.reference.at(times), one.response.at(times)
    low, high = one.low[::every], one.high[::every]
    style: Literal["steps-post", "default"] = "steps-post" if one.reference.held else "default"
    above.plot(times, right, color=colour("blue"), label="reference", drawstyle=style)
    above.plot(times, got, color=colour("orange"), ls=(0, (4, 2)), label="FMU", drawstyle=style)
    above.legend(loc="best", frameon=False)
    above.set_ylabel(_labelled(one.name, one.unit))
    below.fill_between(
        times,
        low - right,
        high - right,
        step="post" if one.reference.held else None,
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
