"""Types of arrays; and whether the fields of a declaration hold what they are annotated with."""

from __future__ import annotations

import functools
import numbers
import typing
from collections.abc import Mapping
from types import NoneType, UnionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Complex = NDArray[np.complex128]

WORDS = {float: "a number", str: "a text", tuple: "a tuple", Mapping: "a dict", NoneType: "None"}
MADE = {"Block": "a function with @block above it", "Placement": "place(name, effect, signal)"}
"""What to write for a kind of value, by itself or by its name."""
_kinds = functools.lru_cache(typing.get_type_hints)


def check_fields(declared: Any, where: str) -> None:
    """Raise ValueError for the first field of a dataclass that is not as annotated."""
    of: Any = type(declared)
    for name, kind in _kinds(of).items():
        check_kind(f"'{name}' of {where}", getattr(declared, name), kind)


def check_kind(where: str, value: Any, kind: Any) -> None:
    """Raise ValueError unless a value, and each entry of it, is of an annotated kind."""
    kinds = typing.get_args(kind) if isinstance(kind, UnionType) else (kind,)
    of = {typing.get_origin(one) or one: typing.get_args(one) for one in kinds}
    classes: dict[Any, Any] = {float: numbers.Real, tuple: (tuple, list), Any: object}
    fitting = next((one for one in of if isinstance(value, classes.get(one, one))), None)
    if fitting is None:
        wanted = [WORDS.get(one) or MADE.get(one.__name__, one.__name__) for one in of]
        star = ", or put * before it" if isinstance(value, tuple) and "entry" in where else ""
        raise ValueError(f"{where} is {shown(value)}: give {' or '.join(wanted)}{star}")
    if fitting is Mapping:
        for key, item in value.items():
            check_kind(f"'{key}' in {where}", item, of[Mapping][1])
    elif fitting is tuple:
        after = ""
        inner = of[tuple][:1] * len(value) if of[tuple][-1] is ... else of[tuple]
        for number, (item, one) in enumerate(zip(value, inner), start=1):
            check_kind(f"entry {number}{after} of {where}", item, one)
            after = f", after '{item.name}'," if hasattr(item, "name") else ""


def shown(value: Any) -> str:
    """Return a value that is plain, of any other what it is."""
    plain = value is None or isinstance(value, str | int | float)
    return f"{value!r:.60}" if plain else f"a {type(value).__name__}"
