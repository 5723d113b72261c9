"""The report of the example: what the gap of an actuator costs, the answer first."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from flight import COMMANDS, STEPS, Case, Step
from margins import Array, Complex, LimitCycle, Loops, Margin

from servo_models.report.numbers import Quantity
from servo_models.report.result import Report
from servo_models.report.sections import Card, Cell, Mark, Picture, Section, Table
from servo_models.report.style import SERIES, colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

AGREED = math.radians(1.0)
"""Within which a margin measured in the co-simulation meets that of python-control [rad]."""
TICKS = (2, 5, 10, 20, 40)
"""Frequencies [rad/s] under a Bode plot."""
SAME = 1e-6
"""Within which masters agree [rad]: their clocks differ in the last digit."""


@dataclass(frozen=True)
class Flown:
    """A case with all that is known of it, by axis.

    Attributes:
        case, loops: what was flown, and its linear loops.
        margins: by python-control.
        measured: frequencies [rad/s] and open loop, empty where play makes it depend on amplitude.
        seen: margins of ``measured``.
        steps: responses.
        predicted: limit cycles by the describing function.
    """

    case: Case
    loops: Loops
    margins: Mapping[str, Margin]
    measured: Mapping[str, tuple[Array, Complex]]
    seen: Mapping[str, Margin]
    steps: Mapping[str, Step]
    predicted: Mapping[str, LimitCycle | None]

    def cycle(self, axis: str) -> LimitCycle | None:
        """Return the limit cycle that was flown."""
        return self.steps[axis].limit_cycle()


@dataclass(frozen=True)
class Agreement:
    """How far a master is from our loop [rad]: as it is, and on the master's clock."""

    package: str
    master: str
    difference: float
    on_its_clock: float


def report(
    flown: Sequence[Flown], agreements: Sequence[Agreement], ten: Mapping[str, float]
) -> Report:
    """Return the report.

    Args:
        flown: an ideal actuator, the one assumed and the one diagnosed.
        agreements: of the masters.
        ten: largest difference [rad] of each of ten servos from the simulation of it alone.
    """
    off = max(
        abs(one.seen[axis].phase - one.margins[axis].phase) for one in flown for axis in one.seen
    )
    apart = max((a.difference for a in agreements), default=math.nan)
    passed = off < AGREED and not apart >= SAME and not any(ten.values())
    return Report(
        "A small UAV: what its servos cost",
        _sentence(flown),
        passed,
        cards=tuple(_cards(flown, off, apart)),
        sections=(
            _margins(flown),
            _steps(flown),
            _cycles(flown),
            _masters(agreements, ten),
            _about(flown),
        ),
    )


def _sentence(flown: Sequence[Flown]) -> str:
    ideal, assumed, diagnosed = flown
    lost = {axis: ideal.margins[axis].phase - assumed.margins[axis].phase for axis in STEPS}
    cycle = diagnosed.cycle("roll")
    swing = (
        f"it rolls by +-{math.degrees(cycle.attitude):.2g} deg for ever"
        if cycle
        else "it comes to rest"
    )
    return (
        f"The servo takes {math.degrees(lost['roll']):.0f} deg of phase margin in roll and"
        f" {math.degrees(lost['pitch']):.0f} in pitch; with the play that was diagnosed, {swing}"
    )


def _cards(flown: Sequence[Flown], off: float, apart: float) -> Iterator[Card]:
    for axis in STEPS:
        words = [
            f"{one.case.name}: {math.degrees(one.margins[axis].phase):.1f} deg" for one in flown[:2]
        ]
        yield Card(f"phase margin, {axis}", "\n".join(words), section="Phase margins")
    words = []
    for one in flown:
        roll, pitch = (f"{100 * one.steps[axis].overshoot:.0f} %" for axis in STEPS)
        words.append(f"{one.case.name}: {roll} and {pitch}")
    yield Card("overshoot, roll and pitch", "\n".join(words), section="Steps")
    swings = [f"{axis}: {_swing(flown[-1].cycle(axis))}" for axis in STEPS]
    yield Card("limit cycle, diagnosed", "\n".join(swings), section="Limit cycles")
    yield Card(
        "margins in flight",
        f"within {math.degrees(off):.2f} deg of python-control",
        off < AGREED,
        "Phase margins",
    )
    if math.isfinite(apart):
        yield Card("masters", f"within {math.degrees(apart):.1e} deg", apart < SAME, "Masters")
    else:
        yield Card("masters", "none is installed: pip install libcosimpy", None, "Masters")


def _margins(flown: Sequence[Flown]) -> Section:
    rows: list[tuple[Cell, ...]] = []
    for axis in STEPS:
        for one in flown:
            known, seen = one.margins[axis], one.seen.get(axis)
            flown_cells: tuple[Cell, Cell] = (None, None)
            if seen:
                off = math.degrees(seen.phase - known.phase)
                flown_cells = (
                    Quantity(math.degrees(seen.phase), "deg"),
                    Quantity(off, "deg", digits=2),
                )
            rows.append(
                (
                    axis,
                    one.case.name,
                    Quantity(math.degrees(known.phase), "deg"),
                    Quantity(known.crossover, "rad/s"),
                    *flown_cells,
                )
            )
    columns = ("loop", "actuator", "control", "at", "in flight", "difference")
    return Section(
        "Phase margins",
        "By python-control, of the linear servo and airframe as the autopilot samples them, every"
        " delay counted; and in flight, from sines of 0.1 deg added to the commands of the"
        " co-simulation. With play a loop has no margin of small signals: control's figure there is"
        " that of the loop without it.",
        tables=(Table("", columns, tuple(rows)),),
        pictures=tuple(
            Picture(
                f"Open loop, {axis}",
                partial(_draw_loop, flown, axis),
                "Lines: python-control. Circles: in flight.",
                rows=2,
                height=4.2,
                shared=True,
            )
            for axis in STEPS
        ),
    )


def _draw_loop(flown: Sequence[Flown], axis: str, panels: Sequence[Axes]) -> None:
    gains, phases = panels
    for one, series in zip(flown, SERIES):
        if axis not in one.measured:
            continue
        frequencies, loop = one.measured[axis]
        fine = np.geomspace(frequencies[0], frequencies[-1], 400)
        line = one.loops.response(COMMANDS[axis], fine)
        gains.plot(fine, _decibel(line), color=colour(series), label=one.case.name)
        gains.plot(frequencies, _decibel(loop), "o", color=colour(series), mfc="none", ms=3)
        phases.plot(fine, _phase(line), color=colour(series))
        phases.plot(frequencies, _phase(loop), "o", color=colour(series), mfc="none", ms=3)
    gains.axhline(0.0, color=colour("muted"), lw=0.7)
    phases.axhline(-180.0, color=colour("muted"), lw=0.7)
    gains.set(xscale="log", ylabel="gain [dB]")
    phases.set_xticks(TICKS, [f"{tick}" for tick in TICKS])
    phases.minorticks_off()
    gains.legend()
    phases.set(xlabel="frequency [rad/s]", ylabel="phase [deg]")


def _steps(flown: Sequence[Flown]) -> Section:
    rows: list[tuple[Cell, ...]] = [
        (axis, one.case.name, Quantity(100.0 * one.steps[axis].overshoot, "%", digits=3))
        for axis in STEPS
        for one in flown
    ]
    return Section(
        "Steps",
        "A command of 20 deg in roll and one of 5 deg in pitch, each alone. The integral of the"
        " autopilot makes a part of the overshoot, also without any servo.",
        tables=(Table("", ("axis", "actuator", "overshoot"), tuple(rows)),),
        pictures=tuple(
            Picture(f"Step in {axis}", partial(_draw_step, flown, axis), rows=2, height=4.2,
                    shared=True)
            for axis in STEPS
        ),
    )  # fmt: skip


def _draw_step(flown: Sequence[Flown], axis: str, panels: Sequence[Axes]) -> None:
    for one, series in zip(flown, SERIES):
        step = one.steps[axis]
        early = step.times < 3.0
        for panel, values in zip(panels, (step.attitude, step.surface)):
            panel.plot(step.times[early], np.degrees(values[early]), color=colour(series),
                       label=one.case.name)  # fmt: skip
    panels[0].axhline(math.degrees(STEPS[axis]), color=colour("muted"), lw=0.7)
    panels[0].set_ylabel(f"{axis} [deg]")
    panels[0].legend()
    panels[1].set(xlabel="time [s]", ylabel="surface [deg]")


def _cycles(flown: Sequence[Flown]) -> Section:
    one = flown[-1]
    rows: list[tuple[Cell, ...]] = []
    for axis in STEPS:
        for source, cycle in (("flight", one.cycle(axis)), ("theory", one.predicted[axis])):
            if cycle:
                rows.append(
                    (
                        axis,
                        source,
                        Quantity(cycle.frequency / (2.0 * math.pi), "Hz"),
                        Quantity(math.degrees(cycle.surface), "deg", digits=3),
                        Quantity(math.degrees(cycle.attitude), "deg", digits=3),
                    )
                )
    columns = ("axis", "by", "frequency", "surface, +-", "attitude, +-")
    return Section(
        "Limit cycles",
        f"A play of +-{math.degrees(one.case.play):.2f} deg between motor and horn lets the loops"
        " swing for ever; with the other actuators they come to rest. Theory: the describing"
        " function of play in the linear loops. It counts the play of one axis; in roll that of the"
        " rudder acts too.",
        tables=(Table("Fundamentals", columns, tuple(rows)),),
        pictures=(
            Picture("The last seconds", partial(_draw_cycle, one), "Roll and pitch about their"
                    " means, in the runs of the steps.", rows=2, height=3.6),
        ),
    )  # fmt: skip


def _draw_cycle(one: Flown, panels: Sequence[Axes]) -> None:
    for panel, axis, series in zip(panels, STEPS, SERIES):
        step = one.steps[axis]
        late = step.times > step.times[-1] - 2.0
        for values, name in ((step.attitude, series), (step.surface, "muted")):
            swing = values[late] - np.mean(values[late])
            panel.plot(step.times[late], np.degrees(swing), color=colour(name))
        panel.set_ylabel(f"{axis} [deg]")
    panels[0].set_title("attitude (coloured) and surface (grey)", fontsize=9)
    panels[-1].set_xlabel("time [s]")


def _masters(agreements: Sequence[Agreement], ten: Mapping[str, float]) -> Section:
    rows: list[tuple[Cell, ...]] = [
        (
            a.package,
            a.master,
            Quantity(math.degrees(a.difference), "deg", digits=2),
            Mark("the same bits", True)
            if a.on_its_clock == 0.0
            else Mark(f"{math.degrees(a.on_its_clock):.1e} deg", False),
        )
        for a in agreements
    ]
    worst = max(ten.values())
    return Section(
        "Masters",
        "The packages in other masters, against our own loop over fmpy: roll, pitch and surfaces."
        " They differ since each adds up time in its own way, and a play is sensitive to when it is"
        " crossed. On the clock of the other one, our loop gives the same bits.",
        items=(
            f"Ten instances of one FMU, each with a play of its own: each one is"
            f" {'bit for bit' if worst == 0.0 else f'within {math.degrees(worst):.1e} deg of'} the"
            " simulation of it alone.",
        ),
        tables=(Table("", ("package", "master", "difference", "on its clock"), tuple(rows)),),
    )


def _about(flown: Sequence[Flown]) -> Section:
    return Section(
        "What was flown",
        items=(
            "Airframe: Aerosonde at 25 m/s, rigid body, with the derivatives of Beard and McLain."
            " Constant airspeed, no wind, no loads on the surfaces.",
            "Autopilot: proportional, integral and rate feedback at 50 Hz, sampled and held.",
            "Servos: one each for left and right aileron, elevator and rudder.",
            "Every signal between FMUs is exchanged each millisecond.",
        ),
        facts=tuple((one.case.name, one.case.about) for one in flown),
    )


def _swing(cycle: LimitCycle | None) -> str:
    if not cycle:
        return "none"
    return f"+-{math.degrees(cycle.attitude):.2f} deg, {cycle.frequency / (2.0 * math.pi):.1f} Hz"


def _decibel(response: Complex) -> Array:
    return np.asarray(20.0 * np.log10(np.abs(response)))


def _phase(response: Complex) -> Array:
    return np.degrees(np.unwrap(np.angle(response)))
