"""Guess which column is the time, which the command and which a reading."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from servo_models.core.plant import Actuator, Wire
from servo_models.data.audit.sensor import difference_noise
from servo_models.data.scaffold.columns import Column
from servo_models.errors import UserError
from servo_models.units import exponents, factor

TIME = {"t", "time", "times", "timestamp", "stamp", "zeit", "temps", "clock"}
COMMAND = {"cmd", "command", "commanded", "ref", "reference", "goal", "target", "setpoint"}
COMMAND |= {"desired", "sp", "demand", "soll", "u", "input"}
MEASURED = {"meas", "measured", "actual", "act", "present", "ist", "feedback", "y", "output"}
QUANTITIES = {
    "angle theta phi position pos horn tilt": "rad",
    "rate speed velocity vel omega gyro gyr": "rad/s",
    "voltage volt volts drive": "V",
    "current amp amps": "A",
    "torque tau": "N.m",
    "force": "N",
    "pulse pwm servo": "s",
    "position pos displacement stroke": "m",
}
"""Words that tell a quantity, and its SI unit."""
CHOICES = {
    "rad": ("rad", "deg", "mrad"),
    "rad/s": ("rad/s", "deg/s", "rpm"),
    "s": ("s", "ms", "us"),
    "m": ("m", "mm", "um"),
    "m/s": ("m/s", "mm/s"),
    "V": ("V", "mV"),
    "A": ("A", "mA"),
    "N.m": ("N.m", "mN.m"),
    "N": ("N", "mN"),
    "1": ("1", "%"),
}
"""Units in which a quantity may have been written where its column does not tell."""
SIDE = 4.0
"""Score from which a column is taken for another input than the command."""
NEIGHBOURHOOD = 1.2
"""Full scales by which an input may be away from its rest."""
LEAST = 2.0
"""Score from which a column is taken for the command or a reading."""
LONGEST_STEP = 0.5
"""A log is not sampled more slowly than this [s]; decides the unit of times without one."""


@dataclass(frozen=True)
class Match:
    """A column for a signal.

    Attributes:
        wire: the signal.
        unit: of the column.
        told: the column's name tells its unit, and it is one of the signal.
        converts: whether the unit is one of the signal's at all.
        score: how well both fit, above 0.
    """

    wire: Wire
    column: Column
    unit: str
    told: bool
    converts: bool
    score: float


def time_of(columns: Sequence[Column]) -> tuple[Column, str] | None:
    """Return the column that is the time, and its unit; None if there is none."""
    rising = [column for column in columns if column.rising and column.moves]
    if not rising:
        return None
    best = max(rising, key=lambda column: 2 * bool(TIME & set(column.words)) + _is_time(column))
    return best, best.unit if best.unit and _is_time(best) else _time_unit(best)


def _is_time(column: Column) -> bool:
    return column.unit is not None and exponents(column.unit)[1] == {"s": 1}


def _time_unit(column: Column) -> str:
    step = float(np.median(np.diff(column.values)))
    return next((u for u in ("s", "ms", "us") if step * factor(u, "s") <= LONGEST_STEP), "ns")


def matches(columns: Sequence[Column], actuator: Actuator) -> list[Match]:
    """Return a column for each signal that one fits, best first; a column serves one signal.

    Where the names tell no reading, columns are told by their numbers: the command is the one
    that stands still most often, or else the one with the least noise.
    """
    by_name = _chosen(columns, actuator, None, blind=False)
    if any(match.wire.name in actuator.plant.outputs for match in by_name):
        return by_name
    nameless = [column for column in columns if not tells(column)]
    named = any(COMMAND & set(column.words) for column in columns)
    command = None if named else max(nameless, key=_calm, default=None)
    return _chosen(columns, actuator, command, blind=True)


def why_not(column: Column, chosen: Sequence[Match], actuator: Actuator) -> str:
    """Say why a column is taken for no signal."""
    if not column.moves:
        return "constant"
    if not tells(column):
        return "the name does not tell what it is"
    plant, main = actuator.plant, actuator.step[0]
    best = max(
        (
            _match(plant.wire[name], column, name in plant.outputs, name == main, command=False)
            for name in (*(wire.name for wire in plant.inputs), *plant.outputs)
        ),
        key=lambda match: match.score,
    )
    for match in chosen:
        if match.wire is best.wire and best.score >= LEAST:
            return f'{match.wire.name} is taken from "{match.column.key}"'
    return f"it fits no signal of {actuator.name}"


def _chosen(
    columns: Sequence[Column], actuator: Actuator, command: Column | None, blind: bool
) -> list[Match]:
    plant, main = actuator.plant, actuator.step[0]
    offered = [
        _match(plant.wire[name], column, name in plant.outputs, name == main, column is command)
        for column in columns
        if blind or tells(column)
        for name in (*(wire.name for wire in plant.inputs), *plant.outputs)
    ]
    chosen: list[Match] = []
    for match in sorted(offered, key=lambda match: -match.score):
        side = match.wire in plant.inputs and match.wire.name != main
        unlike = command is not None and _is_unlike_rate(match, command)
        taken = any(match.wire is other.wire or match.column is other.column for other in chosen)
        if match.score >= (SIDE if side else LEAST) and not unlike and not taken:
            chosen.append(match)
    return chosen


def _match(wire: Wire, column: Column, output: bool, main: bool, command: bool) -> Match:
    """How well a column fits a wire; ``command`` if its numbers are those of a command."""
    words, own = set(column.words), set(wire.name.split("_"))
    told = column.unit is not None and _dimension(column.unit) == _dimension(wire.unit)
    unit = column.unit or _likely_unit(wire, column)
    converts = told or (column.unit is None and _near_rest(wire, column, unit))
    is_command, is_measured = command or bool(words & COMMAND), bool(words & MEASURED)
    score = 4.0 * (words == own) + 1.5 * len(words & own)
    score += 2.0 * told + LEAST * _is_of_quantity(words, wire)
    if output:
        score += 1.0 * is_measured - 4.0 * is_command + LEAST * (not tells(column))
    else:
        score += 3.0 * (main and is_command) - 1.5 * is_measured
    if not converts:
        score = LEAST if main and is_command else 0.0
        unit = column.unit or "deg"
    return Match(wire, column, unit, told, converts, 0.0 if wire.flag else score)


def tells(column: Column) -> bool:
    """Return whether the name of a column says anything about what is in it."""
    known = {word for text in QUANTITIES for word in text.split()} | COMMAND | MEASURED
    return column.unit is not None or bool(known & set(column.words))


def _dimension(unit: str) -> dict[str, int]:
    return exponents(unit)[1]


def _is_of_quantity(words: Iterable[str], wire: Wire) -> bool:
    found = [unit for text, unit in QUANTITIES.items() if set(text.split()) & set(words)]
    return any(_dimension(unit) == _dimension(wire.unit) for unit in found)


def _likely_unit(wire: Wire, column: Column) -> str:
    """The unit in which the column's range comes nearest to the full scale of the signal."""
    reach = float(np.abs(column.values).max()) or 1.0

    def distance(unit: str) -> float:
        return abs(math.log(reach * factor(unit, wire.unit) / wire.scale))

    return min(CHOICES.get(wire.unit, (wire.unit,)), key=distance)


def _near_rest(wire: Wire, column: Column, unit: str) -> bool:
    """Whether an input that rests at some value other than 0 is in its neighbourhood."""
    if not isinstance(wire.rest, float) or wire.rest == 0.0:
        return True
    away = column.values * factor(unit, wire.unit) - wire.rest
    return bool(np.abs(away).max() <= NEIGHBOURHOOD * wire.scale)


def other_units(unit: str, told: str) -> list[tuple[str, float]]:
    """Return other units than ``told`` in which signals of the SI unit ``unit`` are written.

    Each comes with the factor by which it changes what was read in ``told``.
    """
    try:
        factors = [(other, factor(other, told)) for other in CHOICES.get(unit, ())]
    except UserError:
        return []
    return [(other, ratio) for other, ratio in factors if not math.isclose(ratio, 1.0)]


def _calm(column: Column) -> tuple[float, float]:
    if not column.moves:
        return -1.0, 0.0
    still = float(np.mean(np.diff(column.values) == 0.0))
    return round(still, 1), -difference_noise(column.values) / float(np.ptp(column.values))


def _is_unlike_rate(match: Match, command: Column) -> bool:
    """Whether a nameless column, set beside the command, is a rate and the signal is none.

    A rate follows the command only once it is added up.
    """
    column = match.column
    if tells(column) or column is command or len(column.values) != len(command.values):
        return False
    if not column.moves:
        return True
    plain = np.corrcoef(column.values, command.values)[0, 1]
    added = np.corrcoef(np.cumsum(column.values - np.median(column.values)), command.values)[0, 1]
    return bool((abs(added) > abs(plain)) != ("/s" in match.wire.unit))
