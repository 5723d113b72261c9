"""Section: measured, simulated, and how much of the gap is closed."""

from __future__ import annotations

import math

from servo_models.diagnosis.confirm import Confirmation
from servo_models.diagnosis.gap import Gap
from servo_models.diagnosis.page.responses import response
from servo_models.diagnosis.page.stages import readings, stages
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.telling import words as said
from servo_models.identification.page.readings import (
    most_missed,
    not_drawn,
    unit_among,
    words,
)
from servo_models.identification.page.responses import accuracy_table
from servo_models.report.parts import NONE, Line, Section, Table, number
from servo_models.report.style import Picture, colour, drawing, picture

TITLE = "Measured, simulated, closed"
DETAILS = ("output", "of its range", "worst moment", "lag", "noise floor from")
TINTS = {"before": "orange", "retuned": "green", "after": "blue"}
HEIGHT, MARGIN = 0.42, 0.75
"""Height of a bar and of everything else [inch]."""
PREFIXES = ((1e-4, "u", 1e-6), (0.1, "m", 1e-3))
"""Errors below the first figure are told with this prefix, which is worth that much."""
PREFIXED = ("m", "rad", "V", "A", "N", "s")


def section(found: Diagnosis, confirmed: Confirmation | None) -> Section:
    """Return errors of every output at each stage, of the FMU too, and the responses."""
    missed = most_missed(readings(found), found.floors)
    bars = [_picture(found, gap, f"gap-{i}") for i, gap in enumerate(found.gaps)]
    curves = [response(one, f"response-{i}") for i, one in enumerate(missed)]
    left = not_drawn(found.logs) if confirmed else ""
    return Section(
        "gap",
        TITLE,
        "RMS errors on blocks of time that the fit has not seen, with 95 % intervals over the"
        f" blocks. {left}".strip(),
        tuple(
            table
            for table in (
                _errors(found),
                _details(found),
                _fmu(found, confirmed) if confirmed else None,
                _held_out(found),
            )
            if table
        ),
        (*bars, *curves),
    )


def unit_for(found: Diagnosis, gap: Gap) -> tuple[str, float]:
    """Return the unit in which errors of an output read best, and its size in SI.

    It is that of the log, with a prefix where errors are small and the log is in plain SI.
    """
    unit, scale = unit_among(found.logs, gap.output)
    if unit in PREFIXED:
        for below, prefix, size in PREFIXES:
            if gap.rms["before"] / scale < below:
                return prefix + unit, scale * size
    return unit, scale


def _errors(found: Diagnosis) -> Table:
    figures = (*stages(found).values(), "noise floor", "closed")
    lines = tuple(_error(found, gap) for gap in found.gaps)
    columns = ("output", *figures, "unit")
    return Table("RMS error of every output, with 95 % intervals", columns, lines, figures)


def _error(found: Diagnosis, gap: Gap) -> Line:
    unit, scale = unit_for(found, gap)
    figures = [_with_interval(gap, stage, scale) for stage in stages(found)]
    floor = number(gap.floor / scale, 3)
    return Line((words(gap.output), *figures, floor, said.closed(gap) or NONE, unit))


def _details(found: Diagnosis) -> Table:
    lines = tuple(
        Line(
            (
                words(gap.output),
                f"{number(100.0 * gap.nrmse, 3)} %",
                f"{number(gap.worst[1], 5)} s in {gap.worst[0]}",
                f"{number(1e3 * gap.delay, 3)} ms",
                gap.origin,
            )
        )
        for gap in found.gaps
    )
    caption = "The nominal model: error over the measured range, worst moment, lag to measured"
    return Table(caption, DETAILS, lines, ("of its range", "lag"))


def _held_out(found: Diagnosis) -> Table | None:
    """Errors of logs with samples that no fit has seen; None where the description holds none."""
    if not found.held_out:
        return None
    names = stages(found)
    shown = [name for stage, name in names.items() if stage != "before"] or [names["before"]]
    lines = []
    for one in found.held_out:
        figures = {"retuned": one.retuned, "after": one.after}
        left = [figures[stage] for stage in names if stage in figures] or [one.after]
        cells = ("cannot be simulated" if math.isnan(it) else number(it, 3) for it in left)
        lines.append(Line((one.log, *cells, "gets worse" if one.worse else "")))
    caption = "Held out by the description, RMS of all outputs in noise floors"
    return Table(caption, ("log", *shown, ""), tuple(lines), tuple(shown))


def _fmu(found: Diagnosis, confirmed: Confirmation) -> Table:
    """Errors of the FMU itself, in every part of every log."""
    off = confirmed.difference
    same = f"off by {number(off, 2)} of full scale" if off else "the same bits as the simulation"
    caption = f"The FMU with the diagnosed parameters, run in a process of its own: {same}"
    units = {output: unit_among(found.logs, output) for log in found.logs for output in log.outputs}
    units |= {gap.output: unit_for(found, gap) for gap in found.gaps}
    own = {(log.name, output): units[output] for log in found.logs for output in log.outputs}
    return accuracy_table(caption, confirmed.rows, own)


def _with_interval(gap: Gap, stage: str, scale: float) -> str:
    low, high = (number(limit / scale, 3) for limit in gap.intervals[stage])
    return f"{number(gap.rms[stage] / scale, 3)} ({low} to {high})"


def _picture(found: Diagnosis, gap: Gap, name: str) -> Picture:
    """A bar for each stage with its interval, and the floor that none can pass."""
    unit, scale = unit_for(found, gap)
    names = stages(found)
    with drawing(name, height=MARGIN + HEIGHT * len(names)) as (figure, (axes,)):
        for row, stage in enumerate(names):
            rms, tint = gap.rms[stage] / scale, colour(TINTS[stage])
            low, high = (limit / scale for limit in gap.intervals[stage])
            axes.barh(row, rms, 0.62, color=tint, alpha=0.35, lw=0)
            axes.plot([low, high], [row, row], color=tint, lw=1.6)
            axes.plot(rms, row, "o", color=tint)
            axes.annotate(
                number(rms, 3), (high, row), (6, 0), textcoords="offset points", va="center"
            ).set_in_layout(False)
        axes.axvline(gap.floor / scale, color=colour("ink"), lw=0.9, ls=(0, (4, 3)))
        axes.set_yticks(range(len(names)), list(names.values()))
        axes.set(ylim=(len(names) - 0.5, -0.5), xlim=(0.0, 1.18 * axes.get_xlim()[1]))
        axes.set_xlabel(f"held-out RMS error [{unit}]", parse_math=False)
        axes.set_axisbelow(True)
        axes.grid(visible=False, axis="y")
        axes.tick_params(axis="y", length=0)
        share = f"{said.closed(gap)} of what can be closed is closed." if said.closed(gap) else ""
        return picture(
            figure,
            name,
            f"Gap of {words(gap.output)}",
            f"{share} Dashed: the noise floor, from the {gap.origin}.".strip(),
        )
