"""Build the FMUs of the UAV, fly it with three kinds of actuators, and report what they cost.

    python run.py

writes FMUs, packages (``.ssp``, and folders with ``OspSystemStructure.xml``) and ``report.html``
into ``fmus/`` beside this file, or into the folder that is named.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from flight import (
    COMMANDS,
    MOVES,
    STEPS,
    Case,
    cases,
    fly,
    measured_loops,
    measured_margin,
    pilot_inputs,
    ten_servos,
)
from margins import Loops, own
from masters import CLOCKS, Master, Signals, apart, nanoseconds
from results import Agreement, Flown, report
from systems import SPLIT, SURFACES, System, write_osp, write_ssp

import servo_models as sm
from servo_models.build import NATIVE
from servo_models.files import write_whole
from servo_models.report.html import page

MODELS = ("autopilot", "airframe", "ideal_servo")
STOP, SHORT = 20.0, 3.0
"""Ends of a run [s]: until a limit cycle is steady; enough to compare masters."""
PACKAGES = {"libcosim": "libcosimpy", "ecos": "ecospy"}
"""Of the other masters, which may be missing."""


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "fmus"
    build(folder)
    flown = [examine(case, folder) for case in cases()]
    systems = [case.system(folder, STEPS) for case in cases()]
    ten = ten_servos(folder)
    agreements = [a for system in (*systems, ten) for a in compare(system, folder)]
    found = report(flown, agreements, alone(ten))
    print(found)
    write_whole(folder / "report.html", page(found).encode())
    print(f"report: {folder / 'report.html'}")
    sys.exit(0 if found.passed else 1)


def build(folder: Path) -> None:
    """Build the native FMUs."""
    for model in (*map(own, MODELS), sm.model("sg90")):
        sm.build(model, folder / f"{model.actuator.name}.native.fmu", NATIVE)


def examine(case: Case, folder: Path) -> Flown:
    """Fly a case, and compute what linear theory says of it."""
    loops = Loops(case.servo, case.system(folder, {}).step)
    # with play, how a loop answers depends on how far it is moved
    measured = {} if case.play else measured_loops(case, folder, loops.frame)
    return Flown(
        case,
        loops,
        {axis: loops.margin(command) for axis, command in COMMANDS.items()},
        measured,
        {axis: measured_margin(*loop) for axis, loop in measured.items()},
        {axis: fly(case, folder, axis, STOP) for axis in STEPS},
        {
            axis: loops.limit_cycle(command, case.play) if case.play else None
            for axis, command in COMMANDS.items()
        },
    )


def compare(system: System, folder: Path, stop: float = SHORT) -> Iterator[Agreement]:
    """Write the packages of a system, and yield how far each installed master is from our loop."""
    archive = write_ssp(system, folder / f"{system.name}.ssp")
    structure = write_osp(system, folder / system.name).parent
    wanted = [*(("airframe", axis) for axis in STEPS), *((s, "angle") for s in MOVES.values())]
    with Master(system) as master:
        ours = master.simulate(stop, wanted)
        for name, package in (("libcosim", archive), ("libcosim", structure), ("ecos", archive)):
            if find_spec(PACKAGES[name]):
                theirs = apart(name, package, stop, wanted)
                same = master.simulate(stop, wanted, clock=CLOCKS[name])
                yield Agreement(package.name, name, largest(ours, theirs), largest(same, theirs))


def alone(system: System, stop: float = SHORT) -> dict[str, float]:
    """Return how far each servo of a system is from the simulation of it alone [rad]."""
    servos = (*SURFACES, *SPLIT)
    pulses = {servo: ("autopilot", f"{SPLIT.get(servo, servo)}_pulse") for servo in servos}
    wanted = [*dict.fromkeys(pulses.values()), *((servo, "angle") for servo in servos)]
    with Master(system) as master:
        found = master.simulate(stop, wanted, clock=nanoseconds)
    first = sm.simulate(own("autopilot"), [0.0], pilot_inputs(STEPS))
    steps = round(stop / system.step)
    times = np.array([time for time, _ in nanoseconds(system.step, steps + 1)])
    off = {}
    for servo, (_, name) in pulses.items():
        given = np.append(first[name], found["autopilot", name])  # an input is held from its row on
        simulated = sm.simulate(
            sm.model("sg90", None, system.starts_of(servo)), times, {"pulse_width": given}
        )
        off[servo] = float(np.max(np.abs(simulated["angle"][1:] - found[servo, "angle"])))
    return off


def largest(one: Signals, other: Signals) -> float:
    """Return the largest difference of two runs."""
    return max(float(np.max(np.abs(one[signal] - other[signal]))) for signal in one)


if __name__ == "__main__":
    try:
        main()
    except (sm.UserError, RuntimeError) as error:  # no compiler, a master that does not load
        sys.exit(f"{error}")
