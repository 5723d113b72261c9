"""What readers of simulators' files share: XML, numbers, names, and our general servo."""

from __future__ import annotations

import contextlib
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import NoReturn

from servo_models.errors import UserError, did_you_mean

TRANSPORT_DELAY = "transport_delay.time"
LEAST_RATIO = 0.05  # least damping ratio of our servo
FASTEST = 1e4  # rad/s, largest speed limit of our servo
NO_LIMIT = 1e7  # rad/s2, largest acceleration limit of our servo
LARGEST_ERROR_RAD = math.pi  # error whose speed is the limit of a servo that has none
FAST = 1000.0  # rad/s, natural frequency of a servo that follows at once
LARGEST = 1e30  # largest number read from a file; a larger one, infinity or NaN is refused

Values = dict[str, tuple[float, str]]  # values [SI], each with where it comes from


class _Plain(ET.TreeBuilder):
    """A document without entities, which cannot grow."""

    def doctype(self, *_: object) -> NoReturn:
        raise UserError("it declares a document type or entities: leave them out")


def parsed(content: bytes) -> ET.Element:
    """Return the root of a foreign XML document."""
    try:
        return ET.fromstring(content, ET.XMLParser(target=_Plain()))
    except (ET.ParseError, ValueError, LookupError) as error:
        raise UserError(f"no XML: {error}") from error


def servo(
    stiffness: float, clipped: float, free: float, effort: float, inertia: float, origin: str
) -> Values:
    """Return our general servo for a = (clip(stiffness e - clipped v, effort) - free v) / inertia.

    In SI at the joint; an effort of 0 is no limit.  The two are equal: with free damping alone the
    largest speed is effort / free, else its largest acceleration is effort / inertia, and free
    damping beside the clipped one is viscous friction.
    """
    if stiffness <= 0.0:
        raise UserError(f"{origin} has no stiffness: give it one, this is no position servo")
    if inertia <= 0.0:
        raise UserError(f"{origin} has no armature: give what the joint carries by --inertia")
    frequency = math.sqrt(stiffness / inertia)
    least = 2.0 * LEAST_RATIO * frequency * inertia
    apart = clipped >= least
    damping = clipped if apart else max(clipped + free, least)
    ratio = damping / (2.0 * frequency * inertia)
    values = follower(f"root of stiffness / inertia of {origin}", frequency, ratio)
    told = f"damping of {origin}" if damping > least else f"{origin} has less: the least of ours"
    values["damping_ratio"] = (ratio, told)
    values["inertia"] = (inertia, f"armature of {origin}, and --inertia")
    if effort > 0.0 and free > 0.0 and not apart:
        speed = min(effort / damping, FASTEST)
        values["speed_limit"] = (speed, f"force limit of {origin} / damping")
    elif effort > 0.0:
        acceleration = min(effort / inertia, NO_LIMIT)
        values["acceleration_limit"] = (acceleration, f"force limit of {origin} / inertia")
    if apart:
        drag = free * values["speed_limit"][0]
        values["viscous_friction.torque"] = (drag, f"damping of {origin} x speed_limit")
    return values


def follower(origin: str, frequency: float = FAST, ratio: float = 1.0) -> Values:
    """Return our second-order servo without limits and without delay.

    ``frequency`` [rad/s]; by default so fast that it adds no more than 2 ms.
    """
    speed = 0.5 * frequency / ratio * LARGEST_ERROR_RAD
    return {
        "natural_frequency": (frequency, origin),
        "damping_ratio": (ratio, origin),
        "speed_limit": (min(speed, FASTEST), "none: that of half a turn"),
        "acceleration_limit": (NO_LIMIT, "none"),
        TRANSPORT_DELAY: (0.0, "none"),
    }


def chosen(kind: str, asked: str, known: Sequence[str], cure: str) -> str:
    """Return the name that is asked for; for "" the only known one."""
    if not known:
        raise UserError(f"no {kind} in it: {cure}")
    if asked in known or (len(known) == 1 and not asked):
        return asked or known[0]
    what = (
        f"no {kind} '{asked}' in it"
        if asked
        else f"it has more than one {kind}: name it, FILE#NAME"
    )
    raise UserError(f"{what}; {did_you_mean(asked, known)}")


def numbers(text: str, count: int, what: str) -> list[float]:
    """Return ``count`` finite numbers of an attribute."""
    with contextlib.suppress(ValueError):
        values = [float(word) for word in text.split()]
        if len(values) == count and all(abs(number) < LARGEST for number in values):
            return values
    amount = "a number" if count == 1 else f"{count} numbers"
    raise UserError(f"{what} is '{text:.40}': give {amount}")
