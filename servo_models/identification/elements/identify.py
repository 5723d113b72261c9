"""Identify a servo element by element and put its loop together."""

from __future__ import annotations

import math
from pathlib import Path

from servo_models.data.description import Description, read_description
from servo_models.identification.elements.each import ELEMENTS
from servo_models.identification.elements.estimate import Estimate
from servo_models.identification.elements.found import Found
from servo_models.identification.elements.loop import Choice, Loop, choose
from servo_models.identification.elements.result import ElementsResult, Synthesis
from servo_models.identification.elements.tables import Wish, read_wish

LOOP = ("amplifier_gain", "potentiometer_gain", "motor_time_constant", "gear_ratio")
MADE_OF = (*LOOP, "motor_gain", "feedback_coefficient", "angle_unit")
USUAL_BANDS = (0.05, 0.02)
ROWS = (0.25, 0.5, 0.75, 1.5, 2.0)
"""Rows of the table of K_f, over the K_f to set."""


def identify_elements(description: Description | str | Path) -> ElementsResult:
    """Identify the elements that a description has tables of; see ``elements.tables``.

    Raises:
        UserError: see ``read_description``, ``tables.read_table`` and the estimates of the
            elements; an actuator that is not made of these elements; an estimate out of the
            bounds of its parameter.  It names the file, and the key or columns.
    """
    told = description if isinstance(description, Description) else read_description(description)
    entries = told.document.section("elements")
    entries.check_keys((*ELEMENTS, "synthesis"))
    strange = [name for name in MADE_OF if name not in told.model.values]
    if strange:
        told.document.fail(
            "actuator",
            f"'{told.actuator.name}' has no '{strange[0]}'; name a servo made of these elements,"
            " such as sg90",
        )
    wish, found = read_wish(entries.section("synthesis")), Found(told.model)
    for name in ELEMENTS:
        if name in entries:
            ELEMENTS[name](found, entries.section(name))
    if not found.figures:
        told.document.fail("elements", "no element; add [elements.motor] or another one")
    synthesis = _synthesis(found, wish)
    return ElementsResult(
        model=told.model,
        figures=tuple(found.figures),
        parameters={n: (e.value, e.standard_error) for n, e in found.parameters.items()},
        synthesis=synthesis,
        notes=tuple(found.notes),
        warnings=tuple(found.warnings),
        files=found.files,
    )


def _synthesis(found: Found, wish: Wish) -> Synthesis:
    """Put the loop together and choose its feedback coefficient."""
    motor = found.dynamic_gain or found.value("motor_gain")
    parts = [motor, *(found.value(name) for name in LOOP)]
    amplifier, potentiometer, time_constant, gears = (part.value for part in parts[1:])
    unit = found.model.values["angle_unit"]
    gain = amplifier * motor.value * potentiometer * unit / (time_constant * gears)
    loop = Loop(gain, 1.0 / time_constant)
    # K_f of a given damping goes with 1 / (c T^2), so each element counts once.
    error = math.hypot(*(part.standard_error / part.value for part in parts))
    bands = tuple(dict.fromkeys((wish.band, *USUAL_BANDS)))
    choices = tuple(choose(loop, band, wish.overshoot, bands, error) for band in bands)
    _tell(found, choices[0], unit)
    setting = choices[0].setting.k_f
    wanted = {round(setting * share, 12) for share in ROWS} | {c.setting.k_f for c in choices}
    wanted |= {c.optimum.k_f for c in choices} | set(wish.k_f)
    rows = tuple(loop.response(k_f, bands) for k_f in sorted(wanted))
    return Synthesis(loop, wish, choices, rows)


def _tell(found: Found, chosen: Choice, unit: float) -> None:
    """Keep the feedback coefficient, and say what went into it."""
    given = [name for name in LOOP if name not in found.parameters]
    if found.dynamic_gain:
        found.notes.append("The loop takes the gain of the motor from its step")
    elif "motor_gain" not in found.parameters:
        given.append("motor_gain")
    if given:
        found.notes.append(f"Given, not measured: {', '.join(given)}")
    if unit != 1.0:
        found.notes.append(
            f"A rad of the shaft counts as {unit:.4g} rad of the angle (angle_unit), as in the"
            " SG90 paper; read strictly it is 1 and K_f smaller by that factor"
        )
    k_f = chosen.setting.k_f
    param = found.model.plant.parameters["feedback_coefficient"].param
    if param.low <= k_f <= param.high:
        error = chosen.relative_error * k_f
        found.parameters["feedback_coefficient"] = Estimate(k_f, error, k_f - error, k_f + error)
    else:
        found.warnings.append(
            f"K_f = {k_f:g} is not kept: 'feedback_coefficient' goes from {param.low:g} to"
            f" {param.high:g}"
        )
