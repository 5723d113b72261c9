"""Units at the border: SI inside, ``"3 deg"`` or ``"25 us"`` outside.

Unit names are written as in FMI, with ``.`` for a product: ``N.m.s/rad``, ``kg.m2``.
"""

from __future__ import annotations

import functools
import hashlib
import math
import re
import sys
from collections.abc import Callable
from numbers import Real
from typing import TYPE_CHECKING, Any

from servo_models.errors import UserError
from servo_models.files import cached

if TYPE_CHECKING:
    import pint

BASE = {
    "kilogram": "kg",
    "meter": "m",
    "second": "s",
    "ampere": "A",
    "kelvin": "K",
    "radian": "rad",
}
"""Base units of pint and their attribute names in FMI."""


@functools.cache
def registry() -> pint.UnitRegistry[Any]:
    """The unit registry; loaded late and from the cache, since it takes a third of a second.

    What pint remembers names files of its own, so that each installation has a cache.
    """
    import pint

    origin = repr((pint.__file__, pint.__version__, sys.version))
    folder = cached(
        f"units-{hashlib.sha256(origin.encode()).hexdigest()[:32]}",
        lambda part: pint.UnitRegistry(cache_folder=part),
    )
    return pint.UnitRegistry(cache_folder=folder)


LONGEST_TEXT = 200  # letters of a number with its unit
_CHARACTERS = re.compile(r"[\w%./^*() \u00b0-]{1,60}")
"""What a unit is written with; the last but one is the degree sign."""
_TOWER = re.compile(r"\d\d|[\d)]\s*(?:\^|\*\*)")
"""An exponent above 9, or a power of a power: pint would compute it, for ever."""


def _pint_name(unit: str) -> str:
    """``N.m.s/rad2`` in pint's spelling."""
    if unit == "1":
        return "dimensionless"
    if not _CHARACTERS.fullmatch(unit) or _TOWER.search(unit):
        raise UserError(
            f"'{unit[:60]}' is no unit: write names, with one digit for an exponent and . * /"
            " between them, such as deg/s or N.m.s/rad2"
        )
    turns = re.sub(r"\brev\b|\br(?=/)", "turn", unit)  # as in rev/min and r/min
    return (
        re.sub(r"([A-Za-z%])(\d)", r"\1**\2", turns)
        .replace(".", "*")
        .replace("Ohm", "ohm")
        .replace("Nm", "N*m")  # in pint a number of yarns
        .replace("%", "percent")
    )


@functools.cache
def exponents(unit: str) -> tuple[float, dict[str, int]]:
    """Return a unit as a factor and exponents of FMI's base units (kg, m, s, A, K, rad).

    Raises:
        UserError: an unknown unit.
    """
    known, name = registry(), _pint_name(unit)
    try:
        base = (1.0 * known.parse_expression(name)).to_base_units()
    except Exception as error:  # pint raises many kinds, some from its parser
        raise UserError(f"unknown unit '{unit}'; write one such as deg/s or N.m.s/rad2") from error
    powers = {str(name): power for name, power in base.unit_items()}
    if not powers.keys() <= BASE.keys():
        raise UserError(f"unit '{unit}' is none of mechanics and electricity; name one")
    return float(base.magnitude), {BASE[name]: int(power) for name, power in powers.items()}


def base_unit(unit: str) -> str:
    """Return the SI unit of the same quantity: ``deg/s`` is counted in ``rad/s``.

    Raises:
        UserError: an unknown unit.

    Example:
        >>> base_unit("mm"), base_unit("N.m")
        ('m', 'N.m')
    """
    size, powers = exponents(unit)
    if size == 1.0:
        return unit
    above = ".".join(
        f"{name}{power if power > 1 else ''}" for name, power in powers.items() if power > 0
    )
    below = "".join(
        f"/{name}{-power if power < -1 else ''}" for name, power in powers.items() if power < 0
    )
    return f"{above or 1}{below}"


@functools.cache
def factor(unit: str, to: str) -> float:
    """Return the factor by which a value in ``unit`` is multiplied to be in ``to``.

    Raises:
        UserError: an unknown unit, or one of another quantity (an angle is a quantity of
            its own here, so deg does not pass for a pure number).
    """
    have, base = exponents(unit)
    want, other = exponents(to)
    if base != other:
        raise UserError(f"unit '{unit}' does not convert to '{to}'; give a unit like {to}")
    return have / want


def parse(text: str | float, unit: str) -> float:
    """Return ``text``, a number in ``unit`` or a string such as ``"3 deg"``, in ``unit``.

    Raises:
        UserError: no number, not finite, or a unit that does not convert.
    """
    if isinstance(text, bool) or not isinstance(text, str | Real):
        raise UserError(f'{text!r:.60} is no quantity: give a number or a text such as "3 deg"')
    if isinstance(text, Real):  # a number of numpy is one too
        try:
            value, given = float(text), ""
        except OverflowError:  # an integer of hundreds of digits
            raise UserError("the number is too large; correct it") from None
    else:
        match = len(text) <= LONGEST_TEXT and re.fullmatch(
            r"\s*([-+]?[\d.]+(?:[eE][-+]?\d+)?)\s*(.*?)\s*", text
        )
        if not match:
            shown = text[:LONGEST_TEXT]
            raise UserError(
                f"'{shown}' is not a number with a unit; write one such as \"3 deg\" or 0.05"
            )
        try:
            value, given = float(match[1]), match[2]
        except ValueError:
            raise UserError(f"'{match[1]}' is not a number; correct it") from None
    if not math.isfinite(value):
        raise UserError(f"'{text}' is not a finite number; correct it")
    return value * factor(given, unit) if given else value


WRITTEN_IN = {
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
"""Units in which people write a quantity, by its SI unit."""


def other_units(unit: str, told: str) -> list[tuple[str, float]]:
    """Return other units than ``told`` in which signals of the SI unit ``unit`` are written.

    Each comes with the factor by which it changes what was read in ``told``.
    """
    try:
        factors = [(other, factor(other, told)) for other in WRITTEN_IN.get(unit, ())]
    except UserError:
        return []
    return [(other, ratio) for other, ratio in factors if not math.isclose(ratio, 1.0)]


def fitting_unit(unit: str, told: str, fits: Callable[[float], bool]) -> str | None:
    """Return the first of ``other_units`` whose factor ``fits``, None where none does."""
    return next((other for other, ratio in other_units(unit, told) if fits(ratio)), None)
