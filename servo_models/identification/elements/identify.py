"""Identify a servo element by element, put its loop together and choose its feedback.

A description has a table of each element, see ``examples/servo_bench/description.toml``; for those
that it leaves out, the actuator's variant has the values, with ``[parameters]`` on top.  The gain
with load takes the place of that without.  Rows of the motor stand in the order they were taken in,
unless a column ``branch`` says, above 0, where the voltage goes away from 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
from msgspec import Meta

from servo_models.actuators.sg90.elements import LOOP, MADE_OF, TABLES, Bench
from servo_models.core.plant import check_bounds
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.description import Description, read_description
from servo_models.data.readers import read_columns
from servo_models.data.schema import Section, Table
from servo_models.data.signals import check_size, in_si, map_signal
from servo_models.errors import UserError, told_at
from servo_models.identification.elements.estimate import (
    Figure,
    Interval,
    amplifier,
    potentiometer,
)
from servo_models.identification.elements.loop import Synthesis, read_wish, synthesise
from servo_models.identification.elements.motor import GAIN, STEP_GAIN, motor, motor_step
from servo_models.identification.result import Doubt
from servo_models.report.result import Result

GEARS = "gears"
ESTIMATORS: dict[str, Callable[..., tuple[list[Figure], list[str]]]] = {
    "potentiometer": potentiometer,
    "amplifier": amplifier,
    "amplifier_loaded": partial(amplifier, loaded=True),
    "motor": motor,
    "motor_step": motor_step,
}
Teeth = Annotated[int, Meta(gt=0)]


class ElementTable(Table):
    """The table of an element; it has a key for each column besides.

    Written as::

        file = "table.csv"
        table = "sheet"
        header = true
    """

    file: str
    table: str = ""
    header: bool | None = None


class GearTable(Table):
    """``[elements.gears]``, driving and driven gear of each stage.

    Written as::

        teeth = [[8, 48], [8, 32]]
    """

    teeth: Annotated[list[tuple[Teeth, Teeth]], Meta(min_length=1)]


@dataclass(eq=False, repr=False)
class ElementsResult(Result):
    """Elements of a servo, identified one by one.

    Attributes:
        model: the actuator with its nominal values, which stand in where no table tells.
        synthesis: the loop and its feedback coefficient.
        figures: every figure of every element.
        estimates: of what they imply [SI], by name of the actuator's parameter.
        notes: sentences on what was taken from where.
        warnings: sentences that whoever uses the values should know.
        files: SHA-256 of the bytes by name of the file.
    """

    model: Model
    synthesis: Synthesis = field(init=False)
    figures: list[Figure] = field(default_factory=list)
    estimates: dict[str, Interval] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)

    @property
    def parameters(self) -> dict[str, tuple[float, float]]:
        """Value and standard error [SI] by name of the actuator's parameter."""
        return {name: (e.value, e.standard_error) for name, e in self.estimates.items()}

    def figure(self, element: str, name: str) -> Interval:
        return next(f.estimate for f in self.figures if (f.element, f.name) == (element, name))


def identify_elements(description: Description | str | Path) -> ElementsResult:
    """Identify the elements that a description has tables of.

    Raises:
        UserError: see ``read_description`` and the estimators of the elements; a table that
            cannot be read; an actuator that is not made of these elements; an estimate out of
            the bounds of its parameter.  It names the file, and the key or columns.
    """
    if not isinstance(description, Description):
        description = read_description(description)
    document, model = description.document, description.model
    entries = document.section("elements")
    entries.check_keys((*TABLES, GEARS, "synthesis"))
    strange = [name for name in MADE_OF if name not in model.values]
    if strange:
        document.fail(
            "actuator",
            f"'{description.actuator.name}' has no '{strange[0]}'; name a servo made of these"
            " elements, such as sg90",
        )
    wish, result = read_wish(entries.section("synthesis")), ElementsResult(model)
    for element in (*TABLES, GEARS):
        if element in entries:
            _identify(result, element, entries.section(element))
    if not result.figures:
        document.fail("elements", "no element; add [elements.motor] or another one")
    parts = {name: e for name, e in result.estimates.items() if name in (*LOOP, "motor_gain")}
    for figure in result.figures:
        if figure.name == STEP_GAIN:
            parts["motor_gain"] = figure.estimate
            result.notes.append("The loop takes the gain of the motor from its step")
    given = [name for name in (*LOOP, "motor_gain") if name not in parts]
    if given:
        result.notes.append(f"Given, not measured: {', '.join(given)}")
    unit = model.values["angle_unit"]
    if unit != 1.0:
        result.notes.append(
            f"A rad of the shaft counts as {unit:.4g} rad of the angle (angle_unit), as in the"
            " SG90 paper; read strictly it is 1 and K_f smaller by that factor"
        )
    parts |= {name: Interval.of(model.values[name]) for name in given}
    result.synthesis = synthesise(parts, unit, wish)
    chosen, name = result.synthesis.choices[0], "feedback_coefficient"
    k_f, param = chosen.setting.k_f, model.plant.parameters[name].param
    error = chosen.relative_error * k_f
    if param.low <= k_f <= param.high:
        result.estimates[name] = Interval(k_f, error, k_f - error, k_f + error)
    else:
        bounds = f"'{name}' goes from {param.low:g} to {param.high:g}"
        result.warnings.append(f"K_f = {k_f:g} is not kept: {bounds}")
    return result


def _identify(result: ElementsResult, element: str, section: Section) -> None:
    """Add figures and parameters of an element; errors say which table they are about."""
    file, doubts = "", list[str]()
    if element == GEARS:
        place, teeth = f"'{section.file}', {section.name}.teeth", section.read(GearTable).teeth
        ratio = Interval.of(math.prod(driven / driving for driving, driven in teeth))
        figures = [Figure("ratio K_R", ratio, "1", parameter="gear_ratio")]
    else:
        path, digest, columns = read_table(section, TABLES[element])
        file, place = path.name, f"'{path}', columns {' and '.join(columns)}"
        result.files[file] = digest
        with told_at(place):
            figures, doubts = ESTIMATORS[element](*columns.values())
    static = result.estimates.get("motor_gain")
    result.warnings += [f"{place}: {doubt}" for doubt in doubts]
    for figure in figures:
        result.figures.append(replace(figure, element=element, file=file))
        if figure.parameter:
            _keep(result, figure.parameter, figure.estimate.scaled(figure.factor), place)
        if figure.name == STEP_GAIN and static and figure.estimate.contradicts(static):
            result.warnings.append(
                f"the gain of the step, {figure.estimate.value:.5g}, and that of the static line,"
                f" {static.value:.5g} {GAIN}, disagree"
            )


def _keep(result: ElementsResult, name: str, estimate: Interval, place: str) -> None:
    """Keep a parameter [SI]; one that cannot be below 0 is 0 then."""
    known = result.model.plant.parameters[name]
    if estimate.value < known.param.low == 0.0:
        text = f"'{name}' was found at {estimate.value:.3g} and is taken as 0"
        result.warnings.append(Doubt(text))
        estimate = replace(estimate, value=0.0)
    try:
        check_bounds(known, estimate.value)
    except UserError as error:
        raise UserError(f"{place}: {error}, or correct unit, scale and sign") from error
    result.estimates[name] = estimate


def read_table(entry: Section, bench: Bench) -> tuple[Path, str, dict[str, Array]]:
    """Return the file of an element's table, SHA-256 of its bytes, and columns [SI] by name.

    Raises:
        UserError: an unknown key, no file or column, cells that are no numbers, a unit that
            does not convert, too few rows, a column that is constant.
    """
    wires = {wire.name: wire for wire in (*bench.columns, *bench.optional)}
    entry.check_keys((*ElementTable.__struct_fields__, *wires))
    own = {key: value for key, value in entry.content.items() if key not in wires}
    table = replace(entry, content=own).read(ElementTable)
    path = entry.file.parent / table.file
    cells = read_columns(path, table.table or None, table.header)
    columns: dict[str, Array] = {}
    for name, wire in wires.items():
        if name not in entry:
            if wire in bench.columns:
                example = f'{name} = {{ column = "...", unit = "{wire.unit}" }}'
                entry.fail(name, f"missing; write for example {example}")
            continue
        mapped = map_signal(entry, name, wire, None)
        if mapped.table or mapped.channel.shift:
            entry.fail(name, "table and shift of a column belong to logs; leave them out")
        values, where = in_si(mapped, cells.numbers(mapped.column)), cells.where(mapped.column)
        check_size(mapped, cells, np.arange(len(values)), values, wire)
        if len(values) < bench.rows:
            raise UserError(f"{where} has {len(values)} rows: give at least {bench.rows}")
        if any(len(values) != len(other) for other in columns.values()):
            raise UserError(
                f"{where} is not as long as the first column: name columns of one table"
            )
        if wire in bench.columns and np.all(values == values[0]):
            raise UserError(f"{where} is constant; name another column, or measure over a range")
        if name == "time":
            cells.check_order(mapped.column, values)
        columns[name] = values
    return path, cells.sha256, columns
