"""Figures of merit as a data sheet, and as a file for other tools."""

from __future__ import annotations

import io
import itertools
import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.analysis.experiment import display, measures
from servo_models.analysis.explain import display_unit, in_display_unit
from servo_models.analysis.figures import Figures, FrequencyFigures
from servo_models.analysis.linear_model import LinearModel
from servo_models.core.plant import Wire
from servo_models.errors import UserError
from servo_models.files import write_whole
from servo_models.report.sheets import Sheet, Table

SUFFIXES = (".json", ".mat", ".npz")
DEFINITIONS = (
    "Bandwidth: where the gain first is 3 dB below the static one. Equivalent delay: of the pure"
    " delay with the same phase lag at a quarter of the bandwidth. Slew rate: mean from 10 % to"
    " 90 % of the standard step. Under large commands gain and phase are those of the"
    " fundamental (describing function)."
)
SWING = math.radians(60.0)


def figures_sheet(found: Figures) -> Sheet:
    """Return figures of merit in the units that a person reads."""
    model = found.model
    texts = [f"Warning: {model.warning}."] if model.warning else []
    texts += [f"Parameters changed by: {model.provenance}."] if model.provenance else []
    texts += [_at(found), DEFINITIONS]
    texts += [f"{why[0].upper()}{why[1:]}." for why in found.missing]
    wire = model.plant.wire[found.output]
    return Sheet(
        f"{model.actuator.name}, variant {model.variant}: {found.input} to {found.output}",
        tuple(texts),
        (
            Table(
                "Figures of merit",
                ("figure", "small signals", _size(found), "unit"),
                tuple(_rows(found)),
            ),
            measures(wire, found.step, f"Step of {_size(found)}"),
            *(_state_space(found.linear) if found.linear else ()),
            *(_apart(found, found.linear) if found.linear else ()),
        ),
    )


def check_suffix(path: Path) -> None:
    """Raise UserError unless ``path`` names a kind of file that ``write_figures`` writes."""
    if path.suffix.lower() not in SUFFIXES:
        raise UserError(f"'{path}': figures go to a file that ends in {', '.join(SUFFIXES)}")


def write_figures(found: Figures, path: Path) -> None:
    """Write figures and A, B, C, D in SI: ``.json``, ``.mat`` for MATLAB, ``.npz`` for numpy.

    Raises:
        UserError: another kind of file, or a folder that cannot be written.
    """
    check_suffix(path)
    tree = as_tree(found)
    kind = path.suffix.lower()
    if kind == ".json":
        write_whole(path, (json.dumps(tree, indent=2, allow_nan=False) + "\n").encode())
        return
    content = io.BytesIO()
    if kind == ".mat":
        from scipy.io import savemat

        savemat(content, _for_matlab(tree), long_field_names=True)
    else:
        arrays = _matrices(found.linear) if found.linear else {}
        np.savez(content, figures=json.dumps(tree, allow_nan=False), **arrays)
    write_whole(path, content.getvalue())


def as_tree(found: Figures) -> dict[str, Any]:
    """Return everything as nested dictionaries of numbers and texts, in SI."""
    model, wires = found.model, found.model.plant.wire
    linear = found.linear
    return {
        "actuator": model.actuator.name,
        "variant": model.variant,
        "provenance": model.provenance,
        "input": {"name": found.input, "unit": wires[found.input].unit},
        "output": {"name": found.output, "unit": wires[found.output].unit},
        "at": dict(found.at),
        "amplitude": found.amplitude,
        "slew_rate": found.slew_rate,
        "small_signals": asdict(found.small) if found.small else None,
        "at_amplitude": asdict(found.large) if found.large else None,
        "missing": list(found.missing),
        "step": asdict(found.step),
        "state_space": linear
        and {
            **{name: matrix.tolist() for name, matrix in _matrices(linear).items()},
            "states": list(linear.states),
            "inputs": list(linear.inputs),
            "outputs": list(linear.outputs),
            "delays": dict(linear.delays),
            "period": linear.period,
            "left_out": dict(linear.left_out),
            "point": dict(linear.point),
        },
        "parameters": dict(model.values),
    }


def _matrices(linear: LinearModel) -> dict[str, Any]:
    return dict(zip("ABCD", linear.matrices()))


def _for_matlab(tree: dict[str, Any]) -> dict[str, Any]:
    """What MATLAB can load: None is [], names have no dots, lists of texts are cells."""

    def converted(value: Any) -> Any:
        if isinstance(value, dict):
            return {key.replace(".", "_"): converted(inner) for key, inner in value.items()}
        if isinstance(value, (list, tuple)):
            simple = not value or isinstance(value[0], (float, list))
            return np.array(value) if simple else _cells([converted(inner) for inner in value])
        return np.empty((0, 0)) if value is None else value

    space = tree["state_space"] or {}
    made: dict[str, Any] = converted(tree)
    return made | {name: np.array(space[name]) for name in "ABCD" if space}


def _cells(values: list[Any]) -> Any:
    cells = np.empty(len(values), dtype=object)
    cells[:] = values
    return cells


def _at(found: Figures) -> str:
    wires = found.model.plant.wire
    where = ", ".join(f"{name} = {_shown(value, wires[name])}" for name, value in found.at.items())
    return f"Working point: {where or 'inputs at rest'}."


def _size(found: Figures) -> str:
    return f"+-{_shown(found.amplitude, found.model.plant.wire[found.input])}"


def _shown(value: float, wire: Wire) -> str:
    scale, unit = display(wire)
    return f"{scale * value:.5g} {unit}".rstrip()


def _rows(found: Figures) -> Iterator[tuple[str, str, str, str]]:
    wires = found.model.plant.wire
    (into, per), (out, unit) = display(wires[found.input]), display(wires[found.output])
    gain = (out / into, f"{unit}/{per}" if per else unit)
    small = _of_response(found.small, *gain) if found.small else []
    large = _of_response(found.large, *gain) if found.large else []
    none = ("", "", "")
    for one, other in itertools.zip_longest(small, large, fillvalue=none):
        name, _, unit_ = one if other is none else other
        yield name, one[1], other[1], unit_
    yield "slew rate", "", _cell(found.slew_rate, out), f"{unit}/s"
    if wires[found.output].unit == "rad":
        swing = found.slew_rate and SWING / found.slew_rate
        yield "slew time", "", _cell(swing, 1.0), "s/60 deg"


def _of_response(figures: FrequencyFigures, scale: float, unit: str) -> list[tuple[str, str, str]]:
    """Name, value and unit of every figure."""
    rows = [
        ("static gain", _cell(figures.static_gain, scale), unit),
        ("bandwidth (-3 dB)", _cell(figures.bandwidth, 1.0), "Hz"),
        ("phase lag of 90 deg", _cell(figures.phase_90, 1.0), "Hz"),
        ("equivalent delay", _cell(figures.delay, 1e3), "ms"),
    ]
    for point in figures.points:
        at = f"at {point.frequency:g} Hz"
        rows.append((f"gain {at}, over the static one", _cell(_decibel(point.gain), 1.0), "dB"))
        rows.append((f"phase lag {at}", _cell(point.lag, math.degrees(1.0)), "deg"))
    return rows


def _decibel(gain: float) -> float:
    return 20.0 * math.log10(gain) if gain > 0.0 else -math.inf


def _cell(value: float | None, scale: float) -> str:
    return "not reached" if value is None else f"{scale * value:.5g}"


def _state_space(linear: LinearModel) -> Iterator[Table]:
    a, b, c, d = linear.matrices()
    columns = ("", *linear.states, *linear.inputs)
    what = f"states {1e3 * linear.period:g} ms later" if linear.period else "derivatives of states"
    for heading, names, rows in (
        (f"A and B: {what}, in SI", linear.states, np.hstack([a, b])),
        ("C and D: outputs, in SI", linear.outputs, np.hstack([c, d])),
    ):
        cells = tuple((name, *(f"{value:.6g}" for value in row)) for name, row in zip(names, rows))
        yield Table(heading, columns, cells)


def _apart(found: Figures, linear: LinearModel) -> Iterator[Table]:
    """What A, B, C, D do not hold."""
    reasons = {name: "counted exactly in the small signals" for name in linear.delays}
    reasons |= linear.left_out
    if reasons:
        rows = tuple((name, _settings(found, name), why) for name, why in reasons.items())
        yield Table("Not in A, B, C, D", ("effect", "", ""), rows)


def _settings(found: Figures, effect: str) -> str:
    parameters = found.model.plant.parameters.values()
    return ", ".join(
        f"{p.name} = {in_display_unit(found.model.values[p.name], p)} {display_unit(p)}".rstrip()
        for p in parameters
        if p.owner == effect
    )
