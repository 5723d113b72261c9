"""ArduPilot SITL: SIM_SERVO_SPEED, SIM_SERVO_DELAY and SIM_SERVO_FILTER, which all servos share.

With a delay or a filter the pulse, whole steps late, moves at most 60 degrees in SPEED, then passes
a Butterworth filter of two poles at FILTER.  With neither, SPEED is the time constant of a
lag.  Source: ArduPilot, libraries/SITL/ServoModel.cpp and .h; libraries/Filter/LowPassFilter2p.cpp
(DigitalBiquadFilter), LowPassFilter.cpp (DigitalLPF).  A delay of n steps acts n - 1 steps late,
since a step writes before it reads.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.simulators.reading import TRANSPORT_DELAY, follower, numbers
from servo_models.simulators.simulator import (
    APPROXIMATE,
    DELAY,
    EXACT,
    Field,
    Fields,
    Held,
    Motion,
    Nominal,
    Reader,
    Simulator,
)

PREFIX = "SIM_SERVO_"
DEFAULT_SPEED_S = 0.14  # time for 60 degrees
ARC = math.radians(60.0)  # rad, the way that SPEED is the time for
BUTTERWORTH = math.sqrt(0.5)  # damping ratio

FIELDS = (
    Field("speed", "s", "time for 60 degrees; the time constant where it is alone", 1e-3, 100.0),
    Field("filter", "Hz", "cut-off of the filter", 0.05, 400.0),
    Field(DELAY, "steps", "delay of the pulse", 0.0, 2400.0),
)


def law(
    fields: Fields, step: float, goal: Array, load: Array, inertia: float, start: float
) -> Array:
    """The deflection, see ``simulator.Law``; load and inertia do nothing."""
    speed, cutoff, delay = fields
    angles = np.empty(len(goal))
    ohm = math.tan(math.pi * step * cutoff)
    scale = 1.0 + 2.0 * math.cos(math.pi / 4.0) * ohm + ohm * ohm
    gain = ohm * ohm / scale
    first = 2.0 * (ohm * ohm - 1.0) / scale
    second = (1.0 - 2.0 * math.cos(math.pi / 4.0) * ohm + ohm * ohm) / scale
    moved = angle = start
    before = before_that = start / (1.0 + first + second) if cutoff > 0.0 else 0.0
    for k in range(len(goal)):
        if cutoff == 0.0 and delay == 0.0:
            angle += (goal[k] - angle) * step / (step + speed)
        else:
            reach = ARC / speed * step if speed > 0.0 else math.inf
            moved = min(max(goal[k], moved - reach), moved + reach)
            angle = moved
            if cutoff > 0.0:
                now = moved - before * first - before_that * second
                angle = gain * (now + 2.0 * before + before_that)
                before, before_that = now, before
        angles[k] = angle
    return angles


def starts(motion: Motion) -> list[dict[str, float]]:
    """The lag alone, and all of it."""
    return [
        {"speed": 2.0 * motion.ratio / motion.frequency, "filter": 0.0, DELAY: 0.0},
        {
            "speed": ARC / motion.speed,
            "filter": motion.frequency / (2.0 * math.pi),
            DELAY: motion.delay,
        },
    ]


HOLDS: Mapping[str, Held] = {
    "transport_delay": Held(EXACT, "SIM_SERVO_DELAY, in whole steps"),
    "command_lag": Held(APPROXIMATE, "SIM_SERVO_FILTER of two poles, or SIM_SERVO_SPEED alone"),
    "lag": Held(APPROXIMATE, "SIM_SERVO_FILTER"),
    "rate_limit": Held(EXACT, "SIM_SERVO_SPEED"),
    "motion_profile": Held(APPROXIMATE, "SIM_SERVO_SPEED, without the ramps"),
    "supply_limit": Held(APPROXIMATE, "SIM_SERVO_SPEED, at one supply"),
    "saturation": Held(APPROXIMATE, "SIM_SERVO_SPEED, which no load changes"),
    "offset": Held(EXACT, "SERVOn_TRIM, which you set"),
    "gain_error": Held(EXACT, "SERVOn_MIN and _MAX, which you set"),
    "end_stops": Held(EXACT, "by the deflection of the airframe"),
    "load_inertia": Held(APPROXIMATE, "SIM_SERVO_FILTER, of one load"),
}


def lines(values: Mapping[str, float], step: float, inertia: float) -> str:
    """Three parameters; half a step keeps the delay off the edge where SITL cuts it."""
    delay = (values[DELAY] + 1.5) * step if values[DELAY] else 0.0
    told = {"SPEED": values["speed"], "DELAY": delay, "FILTER": values["filter"]}
    rows = [f"{PREFIX}{name},{value:.6g}" for name, value in told.items()]
    return "\n".join([f"# SIM_RATE_HZ {1.0 / step:.6g}", *rows, ""])


def read(content: bytes, joint: str, inertia: float) -> Nominal:
    """SPEED, DELAY and FILTER of a parameter file; one that is missing has its default."""
    if joint:
        raise UserError(f"all servos of SITL share {PREFIX}SPEED: leave out '#{joint:.40}'")
    settings = {"SPEED": DEFAULT_SPEED_S, "DELAY": 0.0, "FILTER": 0.0}
    told = set()
    for line in content.decode("utf-8", errors="replace").splitlines():
        name, *rest = line.partition("#")[0].replace(",", " ").replace("=", " ").split()[:2] or [""]
        key = name.upper().removeprefix(PREFIX)
        if name.upper() == f"{PREFIX}{key}" and key in settings:
            settings[key] = numbers(" ".join(rest), 1, name)[0]
            told.add(key)
    if not told:
        raise UserError(f"none of {PREFIX}SPEED, {PREFIX}DELAY, {PREFIX}FILTER in it: give a .parm")
    origin = {key: f"{PREFIX}{key}{'' if key in told else ', its default'}" for key in settings}
    speed, cutoff = settings["SPEED"], settings["FILTER"]
    if cutoff > 0.0:
        values = follower(origin["FILTER"], 2.0 * math.pi * cutoff, BUTTERWORTH)
    else:
        values = follower(f"SITL, which no load moves, without {PREFIX}FILTER")
    late = max(settings["DELAY"] - SIMULATOR.step, 0.0)
    values[TRANSPORT_DELAY] = (late, f"{origin['DELAY']}, less a step of {SIMULATOR.step:.3g} s")
    if cutoff > 0.0 or settings["DELAY"] > 0.0:
        rate = ARC / speed if speed > 0.0 else 0.0
        values["rate_limit.rate"] = (rate, f"60 degrees / {origin['SPEED']}")
    else:
        values["command_lag.time_constant"] = (speed, origin["SPEED"])
    return Nominal(values, command="s")


SIMULATOR = Simulator(
    "ArduPilot SITL", 1.0 / 1200.0, FIELDS, law, starts, HOLDS, lines, loaded=False
)
READER = Reader("ArduPilot SITL", (".parm", ".param", ".params"), PREFIX.encode(), read)
