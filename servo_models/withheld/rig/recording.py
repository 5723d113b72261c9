"""A recording as its owner writes it down: a description in TOML and logs in CSV."""

from __future__ import annotations

import io
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from servo_models.withheld.rig.laws import Array

TIME = 'time = { column = "time_ms", unit = "ms" }'


def column(signal: str, name: str, unit: str, scale: float | None = None) -> str:
    """Return the line for a column: ``signal`` is called ``inputs.goal`` and the like."""
    factor = "" if scale is None else f", scale = {scale!r}"
    return f'{signal} = {{ column = "{name}", unit = "{unit}"{factor} }}'


def description(
    actuator: str,
    variant: str,
    uncertainty: Mapping[str, float],
    logs: Iterable[Iterable[str]],
    parameters: Mapping[str, float] | None = None,
) -> str:
    """Return a description; ``uncertainty`` is in shares, ``logs`` holds the lines of each.

    Keys are written as they are: one with a dot is a key of a table, or has quotes.
    """
    lines = [f'actuator = "{actuator}"', f'variant = "{variant}"']
    if parameters:
        lines += ["", "[parameters]", *(f"{name} = {it:.6g}" for name, it in parameters.items())]
    lines += ["", "[uncertainty]"]
    lines += [f'{name} = "{100.0 * share:g} %"' for name, share in uncertainty.items()]
    for log in logs:
        lines += ["", "[[logs]]", *log]
    return "\n".join([*lines, ""])


def csv(columns: Mapping[str, Array], formats: str | Sequence[str]) -> str:
    """Return a log: columns by name, each of shape (n,), and the formats of their numbers."""
    text, names = io.StringIO(), ",".join(columns)
    rows = np.column_stack(list(columns.values()))
    np.savetxt(text, rows, formats, delimiter=",", header=names, comments="")
    return text.getvalue()
