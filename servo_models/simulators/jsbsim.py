"""JSBSim: an ``<actuator>`` of a flight control channel, which moves whatever the load is.

Once a frame, in this order: lag (bilinear), rate_limit, deadband_width, hysteresis_width, bias,
delay, clipto.  Source: JSBSim Reference Manual, flight control components; FGActuator.h and .cpp,
FGFCSComponent.cpp.  A delay of n frames acts n - 1 frames late, as JSBSim 1.3 runs; all but clipto
commute with it.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.simulators.reading import TRANSPORT_DELAY, chosen, follower, numbers, parsed
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

FIELDS = (
    Field("lag", "rad/s", "pole of the lag", 0.05, 1e4),
    Field("rate_limit", "rad/s", "largest speed", 1e-3, 1e4),
    Field("deadband_width", "rad", "width of the dead zone about 0", 1e-6, 1.0),
    Field("hysteresis_width", "rad", "width of the play", 1e-6, 1.0),
    Field("bias", "rad", "offset", -1.0, 1.0),
    Field("clipto", "rad", "largest angle to either side", 1e-3, 100.0),
    Field(DELAY, "steps", "delay", 0.0, 500.0),
)


def law(
    fields: Fields, step: float, goal: Array, load: Array, inertia: float, start: float
) -> Array:
    """The output, see ``simulator.Law``; load and inertia do nothing."""
    lag, rate_limit, deadband, hysteresis, bias, clipto, _ = fields
    angles = np.empty(len(goal))
    lagged = limited = played = start - bias
    last_goal = goal[0]
    share = step * lag / (2.0 + step * lag)
    for k in range(len(goal)):
        lagged += share * (goal[k] + last_goal - 2.0 * lagged)
        if lag == 0.0:
            lagged = goal[k]
        last_goal = goal[k]
        reach = rate_limit * step
        if 0.0 < reach < abs(lagged - limited):
            limited += math.copysign(reach, lagged - limited)
        else:
            limited = lagged
        output = limited
        if deadband > 0.0:
            output = math.copysign(max(abs(limited) - 0.5 * deadband, 0.0), limited)
        if output > played:
            played = max(played, output - 0.5 * hysteresis)
        elif output < played:
            played = min(played, output + 0.5 * hysteresis)
        angles[k] = played + bias
        if clipto > 0.0:
            angles[k] = min(max(angles[k], -clipto), clipto)
    return angles


def starts(motion: Motion) -> list[dict[str, float]]:
    """One start with all of it."""
    return [
        {
            "lag": 0.5 * motion.frequency / motion.ratio,
            "rate_limit": motion.speed,
            "deadband_width": 1e-3,
            "hysteresis_width": 1e-3,
            "bias": 1e-3,
            DELAY: motion.delay,
        }
    ]


HOLDS: Mapping[str, Held] = {
    "transport_delay": Held(EXACT, "delay, in whole frames"),
    "command_lag": Held(EXACT, "lag"),
    "lag": Held(APPROXIMATE, "lag, of the command alone"),
    "rate_limit": Held(EXACT, "rate_limit"),
    "motion_profile": Held(APPROXIMATE, "rate_limit, without the ramps"),
    "supply_limit": Held(APPROXIMATE, "rate_limit, at one supply"),
    "saturation": Held(APPROXIMATE, "rate_limit, a speed that no load changes"),
    "backlash": Held(APPROXIMATE, "hysteresis_width, which no loop corrects"),
    "coasting_backlash": Held(APPROXIMATE, "hysteresis_width, whose output does not coast"),
    "hysteresis": Held(APPROXIMATE, "hysteresis_width, play in place of a loop"),
    "coulomb_friction": Held(APPROXIMATE, "hysteresis_width, play in place of friction"),
    "presliding_friction": Held(APPROXIMATE, "hysteresis_width, play in place of a loop"),
    "stiction": Held(APPROXIMATE, "hysteresis_width, play without the slip"),
    "dead_zone": Held(APPROXIMATE, "hysteresis_width, play in place of a zone"),
    "dead_band": Held(APPROXIMATE, "hysteresis_width, play in place of a band"),
    "offset": Held(EXACT, "bias"),
    "null_shift": Held(APPROXIMATE, "bias"),
    "end_stops": Held(APPROXIMATE, "clipto, which the motion goes on behind"),
    "load_inertia": Held(APPROXIMATE, "lag, of one load"),
}


def lines(values: Mapping[str, float], step: float, inertia: float) -> str:
    """The actuator; half a frame keeps the delay off the edge where JSBSim cuts it."""
    names = [it.name for it in FIELDS if it.name not in ("clipto", DELAY)]
    told = {name: f"{values[name]:.5g}" for name in names if values[name]}
    if values[DELAY]:
        told[DELAY] = f"{(values[DELAY] + 1.5) * step:.6g}"
    if values["clipto"]:
        told["clipto"] = "<min>-{0:.5g}</min><max>{0:.5g}</max>".format(values["clipto"])
    inner = "".join(f"  <{name}>{value}</{name}>\n" for name, value in told.items())
    return (
        f"<!-- radians, frames of {step:.6g} s -->\n"
        '<actuator name="fcs/servo">\n  <input>fcs/servo-goal</input>\n' + inner + "</actuator>\n"
    )


def read(content: bytes, joint: str, inertia: float) -> Nominal:
    """An ``<actuator>`` by its name, in radians, or in degrees if a name in it ends in deg."""
    known = {it.get("name", ""): it for it in parsed(content).iter("actuator")}
    name = chosen("actuator", joint, [*known], "give a file with an <actuator>")
    element, origin = known[name], f"actuator '{name}'"

    def value(key: str) -> float:
        told = [it.text or "" for it in element.iterfind(key)]
        return min((numbers(text, 1, f"{key} of {origin}")[0] for text in told), default=0.0)

    scale = math.radians(1.0) if _ends(element, name, "deg", "degrees") else 1.0
    warnings = []
    if _ends(element, name, "norm"):
        warnings.append(f"{origin} is normalised: log command and angle so that 1 rad is 1 of it")
    delay = element.find(DELAY)
    frames = delay is not None and delay.get("type") == "frames"
    values = follower(f"{origin}, which no load moves")
    late = max(value(DELAY) * (SIMULATOR.step if frames else 1.0) - SIMULATOR.step, 0.0)
    values[TRANSPORT_DELAY] = (late, f"delay of {origin}, less a frame of {SIMULATOR.step:.3g} s")
    for parameter, key, factor in (
        ("rate_limit.rate", "rate_limit", scale),
        ("stiction.band", "hysteresis_width", scale),  # play; that of ours is inside a loop
        ("stiction.jump", "hysteresis_width", 0.0),
        ("command_offset.value", "bias", scale),
    ):
        values[parameter] = (factor * value(key), f"{key} of {origin}")
    lag = value("lag")
    values["command_lag.time_constant"] = (1.0 / lag if lag else 0.0, f"1 / lag of {origin}")
    if value("deadband_width"):
        raise UserError(f"{origin} has a deadband_width, a dead zone about 0: leave it out")
    if element.find("clipto") is not None:
        low, high = value("clipto/min"), value("clipto/max")
        half = scale * max(min(-low, high), 0.0)
        values["end_stops.half_range"] = (half, f"nearer end of clipto of {origin}")
        if low != -high:
            ends = f"is {low:g} to {high:g}, in ours the same to either side"
            warnings.append(f"clipto of {origin} {ends}")
    return Nominal(values, warnings=tuple(warnings))


def _ends(element: ET.Element, name: str, *ends: str) -> bool:
    """Whether a name of the actuator or its signals has one of these ends."""
    names = [name, *(it.text or "" for key in ("input", "output") for it in element.iterfind(key))]
    return any(text.strip().endswith(ends) for text in names)


SIMULATOR = Simulator(
    "JSBSim",
    1.0 / 120.0,
    FIELDS,
    law,
    starts,
    HOLDS,
    lines,
    loaded=False,
    taken={"clipto": "end_stops.half_range"},
)
READER = Reader("JSBSim", (".xml",), b"<actuator ", read)
