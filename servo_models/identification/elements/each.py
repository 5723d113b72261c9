"""Each element of a servo: from its table to figures and parameters of the actuator."""

from __future__ import annotations

from servo_models.data.schema import Section
from servo_models.identification.elements.estimate import Estimate, combined, exactly
from servo_models.identification.elements.found import Found, at
from servo_models.identification.elements.lines import Line, line_with_flats, straight_line
from servo_models.identification.elements.motor import MotorCurve, SideCurve, motor_curve
from servo_models.identification.elements.step import first_order
from servo_models.identification.elements.tables import (
    AMPLIFIER,
    BRANCH,
    MOTOR,
    MOTOR_ROWS,
    POTENTIOMETER,
    STEP,
    VOLTAGE,
    gear_ratio,
    read_table,
)

UNEQUAL = 3.0
"""Standard errors from which two estimates of one thing contradict each other."""
BENT = "straight pieces say too little, what they leave over is no chance"
GAIN = "rad/s/V"


def potentiometer(found: Found, section: Section) -> None:
    """k_FS, and where the voltage is 0."""
    table = read_table(section, POTENTIOMETER)
    source = found.read("potentiometer", table)
    line = straight_line(table["angle"], table["voltage"])
    found.add(source, "gain k_FS", line.gain, "V/rad", "V/deg")
    found.add(source, "angle of 0 V", line.zero, "rad", "deg")
    found.set("potentiometer_gain", line.gain, table.place)
    if line.bent:
        found.warnings.append(f"{table.place}: {BENT}; see effect sensor_nonlinearity")


def amplifier(found: Found, section: Section) -> None:
    """K_AP without load."""
    _amplifier(found, section, "amplifier", "K_AP")


def amplifier_loaded(found: Found, section: Section) -> None:
    """K_AP with load, which is the one that the servo has."""
    _amplifier(found, section, "amplifier_loaded", "K_AP with load")


def _amplifier(found: Found, section: Section, element: str, symbol: str) -> None:
    table = read_table(section, AMPLIFIER)
    source = found.read(element, table)
    with at(table):
        line = line_with_flats(table["input"], table["output"])
    found.add(source, f"gain {symbol}", line.gain, "1")
    found.add(source, "input of 0 V", line.zero, "V")
    for name, edge in _flats(line).items():
        found.add(source, name, edge, "V")
    found.set("amplifier_gain", line.gain, table.place)
    if line.bent:
        found.warnings.append(f"{table.place}: {BENT}")


def _flats(line: Line) -> dict[str, Estimate | None]:
    start, end = line.dead or (None, None)
    return {
        "no change below": line.lower,
        "dead band from": start,
        "dead band to": end,
        "no change above": line.upper,
    }


def motor(found: Found, section: Section) -> None:
    """Static characteristic, both ways."""
    table = read_table(section, MOTOR, (BRANCH,), MOTOR_ROWS)
    source, branch = found.read("motor", table), table.get("branch")
    with at(table):
        curve = motor_curve(
            table["voltage"], table["speed"], None if branch is None else branch > 0.0
        )
    found.add(source, "gain K_EN", curve.gain, GAIN)
    found.set("motor_gain", curve.gain, table.place)
    for name, side, sign in (
        ("positive", curve.positive, 1.0),
        ("negative", curve.negative, -1.0),
    ):
        _motor_side(found, source, name, side, sign)
        found.set_size(f"edge_{name}", side.edge, table.place)
        found.set_size(f"zero_{name}", side.zero, table.place)
        found.set(f"top_{name}", side.top, table.place)
        if not side.top:
            found.warnings.append(
                f"{table.place}: no {name} voltage reaches a top speed; 'top_{name}' is not"
                " identified, add rows of higher voltage"
            )
    found.add(source, "hysteresis width at the edges", curve.width, "V")
    found.add(source, "shift of the line, rising to falling", curve.shift, "V")
    half = curve.width and curve.width.scaled(0.5)
    found.set_size("hysteresis.half_width", half, table.place)
    found.warnings += [f"{table.place}: {doubt}" for doubt in _doubts(curve)]


def _motor_side(
    found: Found, source: tuple[str, str], name: str, side: SideCurve, sign: float
) -> None:
    """Figures of one direction, with the signs of the table."""
    voltages = {
        "insensitivity edge": side.edge,
        "edge, rising": side.starts,
        "edge, falling": side.stops,
        "zero of the line": side.zero,
        "saturation edge": side.saturation,
    }
    found.add(source, f"gain, {name}", side.gain, GAIN)
    for what, estimate in voltages.items():
        found.add(source, f"{what}, {name}", estimate and estimate.scaled(sign), "V")
    found.add(source, f"top speed, {name}", side.top and side.top.scaled(sign), "rad/s")


def _doubts(curve: MotorCurve) -> list[str]:
    doubts = []
    if curve.unequal:
        doubts.append(
            f"the gains of both sides differ, {curve.positive.gain.value:.5g} and"
            f" {curve.negative.gain.value:.5g} {GAIN}; 'motor_gain' is their common one, see"
            " effect direction_asymmetry"
        )
    if curve.bent:
        doubts.append(BENT)
    if not curve.width:
        doubts.append("one branch only; hysteresis shows with rising and falling voltage")
    elif curve.shift and _contradict(curve.width, curve.shift):
        doubts.append(
            f"between the branches the edges move by {curve.width.value:.3g} V and the line by"
            f" {curve.shift.value:.3g} V; effect hysteresis moves both alike"
        )
    return doubts


def motor_step(found: Found, section: Section) -> None:
    """Time constant, and with the voltage also the gain, of a step of speed."""
    table = read_table(section, STEP, (VOLTAGE,))
    source = found.read("motor_step", table)
    with at(table):
        order = first_order(table["time"], table["speed"], table.get("voltage"))
    found.add(source, "time constant T", order.time_constant, "s")
    found.add(source, "gain of the step", order.gain, GAIN)
    found.set("motor_time_constant", order.time_constant, table.place)
    found.dynamic_gain = order.gain
    if order.correlated:
        found.warnings.append(
            f"{table.place}: the speed is not quite that of a first order, so that the standard"
            " errors are too small"
        )
    static = found.parameters.get("motor_gain")
    if order.gain and static and _contradict(order.gain, static):
        found.warnings.append(
            f"the gain of the step, {order.gain.value:.5g}, and that of the static line,"
            f" {static.value:.5g} {GAIN}, disagree"
        )


def gears(found: Found, section: Section) -> None:
    """K_R, a count without error."""
    ratio = exactly(gear_ratio(section))
    found.add(("gears", ""), "ratio K_R", ratio, "1")
    found.set("gear_ratio", ratio, f"'{section.file}', {section.name}.teeth")


def _contradict(one: Estimate, other: Estimate) -> bool:
    gap = combined((1.0, one), (-1.0, other))
    return abs(gap.value) > UNEQUAL * gap.standard_error


ELEMENTS = {
    "potentiometer": potentiometer,
    "amplifier": amplifier,
    "amplifier_loaded": amplifier_loaded,
    "motor": motor,
    "motor_step": motor_step,
    "gears": gears,
}
"""In this order, so that a gain with load takes the place of one without."""
