"""Numbers as people read them: digits that mean something, an error, a unit.

Texts are typographic, with a true minus sign and powers of ten; ``plain`` turns them into what
every terminal and filter can read.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

NONE = "\N{EN DASH}"
MINUS = "\N{MINUS SIGN}"
TIMES = "\N{MULTIPLICATION SIGN}"
ERROR = "\N{PLUS-MINUS SIGN}"
ARROW = "\N{RIGHTWARDS ARROW}"
MOST_DIGITS = 10  # digits of a value at most, however small its error
PREFIXES = ((1e-4, "u", 1e6), (0.1, "m", 1e3))
"""Prefixes: (figure below which it is used, letter, factor to the prefixed unit)."""
PREFIXED = ("m", "rad", "V", "A", "N", "s")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_POWER = re.compile(f"{TIMES}10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)")
_PLAIN = str.maketrans({MINUS: "-", ERROR: "+-", ARROW: "->", TIMES: "x", NONE: "-"})


@dataclass(frozen=True)
class Quantity:
    """A number to be printed, in the unit that a person reads.

    Attributes:
        value: NaN where there is none.
        unit: "1" for a pure number, "%" for a share that is given in percent.
        error: standard error; the value then has the digits that the error allows.  NaN or
            infinite where it is not known; None where nobody asks.
        interval: limits of a confidence interval, such as of 95 %.
        digits: significant digits of a value without an error.
    """

    value: float
    unit: str = "1"
    error: float | None = None
    interval: tuple[float, float] | None = None
    digits: int = 4

    def __str__(self) -> str:
        return with_unit(self.bare, self.unit) if math.isfinite(self.value) else self.bare

    @property
    def bare(self) -> str:
        """The number with its error and interval, without the unit."""
        text = number(self.value, self.digits)
        if self.error is not None:
            value, error = map(printed, with_error(self.value, self.error))
            text = f"{value} {ERROR} {error}" if error else value
        if self.interval is None:
            return text
        low, high = (number(limit, self.digits) for limit in self.interval)
        return f"{text} ({low} to {high})"


def number(value: float | None, digits: int = 4) -> str:
    """Return a number in print; a dash for None and NaN."""
    if value is None or math.isnan(value):
        return NONE
    if value == 0.0 or not math.isfinite(value) or 1e-3 <= abs(value) < 1e5:
        text = f"{value:.{digits}g}"
        if "e" not in text:
            return printed(text)
        return printed(f"{float(text):.0f}")  # 1.2e+03 is 1200
    mantissa, power = f"{value:.{max(digits - 2, 1)}e}".split("e")
    return printed(f"{float(mantissa):.{digits}g}e{power}")


def with_unit(text: str, unit: str) -> str:
    """Return a text of numbers with a unit behind it."""
    return text if unit in ("1", "") else f"{text} {unit}"


def prefix(size: float, unit: str) -> tuple[float, str]:
    """Return the unit in which figures of this size [unit] read best, and the factor to it.

    0.0123 V reads best in mV; units that take no prefix, such as deg, stay.
    """
    for below, name, factor in PREFIXES if unit in PREFIXED else ():
        if abs(size) < below:
            return factor, name + unit
    return 1.0, unit


def listed(names: Iterable[str], word: str = "and") -> str:
    """Return names as one reads them: "a", "a and b", "a, b and c"."""
    *most, last = names
    return f"{', '.join(most)} {word} {last}" if most else last


def plural(count: int, name: str) -> str:
    """Return "1 warning" or "3 warnings"."""
    return f"{count} {name}{'s' * (count != 1)}"


def percent(share: float | None) -> str:
    """Return a share [1] in percent."""
    if share is None or math.isnan(share):
        return NONE
    if 0.0 < share < 0.005:
        return "< 1 %"
    return "> 99 %" if 0.995 < share < 1.0 else f"{printed(f'{100.0 * share:.0f}')} %"


def printed(text: str) -> str:
    """Return the text of a number, such as "-1.2e-05", in print."""
    mantissa, _, power = text.replace("-", MINUS).partition("e")
    if not power:
        return mantissa
    return f"{mantissa}{TIMES}10{str(int(power.replace(MINUS, '-'))).translate(_RAISED)}"


def plain(text: str) -> str:
    """Return a text in print in ASCII, as far as its numbers and arrows go."""
    text = _POWER.sub(lambda found: f"e{found[1].translate(_LOWERED)}", text)
    return text.translate(_PLAIN)


def with_error(value: float, error: float | None) -> tuple[str, str]:
    """Return a value and its standard error with significant digits, in one unit, in ASCII.

    The error has two digits and the value goes to the same decimal place, with 2 to
    ``MOST_DIGITS`` digits.  The text of an infinite error is empty, and the value has the two
    digits that give its size; without an error, None or NaN, it has six.
    Source: Review of Particle Physics, Introduction, sec. 5.3 (rounding), with two digits.
    """
    if error is None or math.isnan(error) or not math.isfinite(value):
        return f"{value:.6g}", ""
    if math.isinf(error):
        if value == 0.0 or not 1e-5 <= abs(value) < 1e9:
            return f"{value:.2g}", ""
        return _fixed(value, _magnitude(value) - 1), ""
    if error == 0.0:
        return f"{value:.6g}", "0"
    place = _magnitude(error) - 1
    digits = min(max(_magnitude(value) - place + 1, 2), MOST_DIGITS) if value else 1
    if 1e-5 <= error < 1e6 and (1e-5 <= abs(value) < 1e9 or value == 0.0):
        last = _magnitude(value) + 1 - digits if value else place
        return _fixed(value, last), _fixed(error, place)
    return f"{value:.{digits - 1}e}", f"{error:.1e}"


def _magnitude(value: float) -> int:
    """Power of ten of the first digit, when rounded to two digits."""
    return int(f"{value:.1e}".partition("e")[2])


def _fixed(value: float, place: int) -> str:
    """A number without exponent, rounded to the power of ten ``place``."""
    return f"{round(value, -place) + 0.0:.{max(-place, 0)}f}"
