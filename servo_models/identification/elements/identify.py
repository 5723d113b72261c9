"""Identify a servo element by element, put its loop together and choose its feedback."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from servo_models.core.plant import check_bounds
from servo_models.core.simulate import Model
from servo_models.data.description import Description, read_description
from servo_models.data.schema import Section
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import Estimate, exactly
from servo_models.identification.elements.lines import line_with_flats, straight_line
from servo_models.identification.elements.loop import Choice, Synthesis, synthesise
from servo_models.identification.elements.motor import (
    NAMES,
    MotorCurve,
    SideCurve,
    first_order,
    motor_curve,
)
from servo_models.identification.elements.tables import (
    AMPLIFIER,
    BRANCH,
    MOTOR,
    MOTOR_ROWS,
    POTENTIOMETER,
    STEP,
    VOLTAGE,
    Table,
    gear_ratio,
    read_table,
    read_wish,
)
from servo_models.identification.result import Doubt
from servo_models.report.result import Result

LOOP = ("amplifier_gain", "potentiometer_gain", "motor_time_constant", "gear_ratio")
MADE_OF = (*LOOP, "motor_gain", "feedback_coefficient", "angle_unit")
GAIN = "rad/s/V"
BENT = "straight pieces say too little, what they leave over is no chance"


@dataclass(frozen=True)
class ElementFigure:
    """A figure of one element.

    Attributes:
        element: which, such as ``"motor"``.
        name: in words.
        estimate: in ``unit``.
        unit: SI.
        file: name of the file that it is from.
        display: unit that a person reads it in, "" for ``unit``.
    """

    element: str
    name: str
    estimate: Estimate
    unit: str
    file: str
    display: str = ""

    @property
    def value(self) -> float:
        return self.estimate.value

    @property
    def standard_error(self) -> float:
        return self.estimate.standard_error


@dataclass(frozen=True, eq=False, repr=False)
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
    synthesis: Synthesis
    figures: tuple[ElementFigure, ...]
    estimates: Mapping[str, Estimate]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    files: Mapping[str, str]

    @property
    def parameters(self) -> dict[str, tuple[float, float]]:
        """Value and standard error [SI] by name of the actuator's parameter."""
        return {
            name: (estimate.value, estimate.standard_error)
            for name, estimate in self.estimates.items()
        }

    def figure(self, element: str, name: str) -> ElementFigure:
        """Return a figure by element and name."""
        return next(f for f in self.figures if (f.element, f.name) == (element, name))


def identify_elements(description: Description | str | Path) -> ElementsResult:
    """Identify the elements that a description has tables of; see ``elements.tables``.

    Raises:
        UserError: see ``read_description``, ``tables.read_table`` and the estimates of the
            elements; an actuator that is not made of these elements; an estimate out of the
            bounds of its parameter.  It names the file, and the key or columns.
    """
    if not isinstance(description, Description):
        description = read_description(description)
    entries = description.document.section("elements")
    entries.check_keys((*ELEMENTS, "synthesis"))
    strange = [name for name in MADE_OF if name not in description.model.values]
    if strange:
        description.document.fail(
            "actuator",
            f"'{description.actuator.name}' has no '{strange[0]}'; name a servo made of these"
            " elements, such as sg90",
        )
    wish, bench = read_wish(entries.section("synthesis")), _Bench(description.model)
    for name, identify in ELEMENTS.items():
        if name in entries:
            with bench.about(name):
                identify(bench, entries.section(name))
    if not bench.figures:
        description.document.fail("elements", "no element; add [elements.motor] or another one")
    motor = bench.dynamic_gain or bench.value("motor_gain")
    parts = {"motor_gain": motor, **{name: bench.value(name) for name in LOOP}}
    synthesis = synthesise(parts, description.model.values["angle_unit"], wish)
    bench.keep(synthesis.choices[0])
    return ElementsResult(
        model=description.model,
        synthesis=synthesis,
        figures=tuple(bench.figures),
        estimates=bench.estimates,
        notes=tuple(bench.notes),
        warnings=tuple(bench.warnings),
        files=bench.files,
    )


@dataclass(eq=False)
class _Bench:
    """What is known so far, while the elements are identified; see ``ElementsResult``.

    Attributes:
        dynamic_gain: of the motor from the record of a step [rad/s/V], None without.
        element, file: that figures are from.
        place: of its table, for messages.
    """

    model: Model
    figures: list[ElementFigure] = field(default_factory=list)
    estimates: dict[str, Estimate] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)
    dynamic_gain: Estimate | None = None
    element: str = ""
    file: str = ""
    place: str = ""

    @contextmanager
    def about(self, element: str) -> Iterator[None]:
        """Say in errors which table they are about, once it has been read."""
        self.element, self.file, self.place = element, "", ""
        try:
            yield
        except UserError as error:
            raise UserError(f"{self.place}: {error}" if self.place else str(error)) from error

    def opened(self, table: Table) -> Table:
        """What follows is from this table."""
        self.file, self.place = table.path.name, table.place
        self.files[self.file] = table.sha256
        return table

    def add(self, name: str, estimate: Estimate | None, unit: str, display: str = "") -> None:
        """Keep a figure; None is none."""
        if estimate:
            self.figures.append(
                ElementFigure(self.element, name, estimate, unit, self.file, display)
            )

    def set(self, name: str, estimate: Estimate | None) -> None:
        """Keep a parameter [SI]; None is none.

        Raises:
            UserError: it is out of its bounds.
        """
        if estimate is None:
            return
        try:
            check_bounds(self.model.plant.parameters[name], estimate.value)
        except UserError as error:
            raise UserError(f"{error}, or correct unit, scale and sign") from error
        self.estimates[name] = estimate

    def set_size(self, name: str, estimate: Estimate | None) -> None:
        """Keep a parameter that cannot be below 0: an estimate below is taken as 0."""
        if estimate and estimate.value < 0.0:
            text = f"'{name}' was found at {estimate.value:.3g} and is taken as 0"
            self.warnings.append(Doubt(text))
            estimate = replace(estimate, value=0.0)
        self.set(name, estimate)

    def doubt(self, text: str) -> None:
        """Warn about the table."""
        self.warnings.append(f"{self.place}: {text}")

    def value(self, name: str) -> Estimate:
        """A parameter, of the model where no table tells it."""
        return self.estimates.get(name) or exactly(self.model.values[name])

    def keep(self, chosen: Choice) -> None:
        """Keep the feedback coefficient, and say what went into it."""
        given = [name for name in LOOP if name not in self.estimates]
        if self.dynamic_gain:
            self.notes.append("The loop takes the gain of the motor from its step")
        elif "motor_gain" not in self.estimates:
            given.append("motor_gain")
        if given:
            self.notes.append(f"Given, not measured: {', '.join(given)}")
        unit = self.model.values["angle_unit"]
        if unit != 1.0:
            self.notes.append(
                f"A rad of the shaft counts as {unit:.4g} rad of the angle (angle_unit), as in the"
                " SG90 paper; read strictly it is 1 and K_f smaller by that factor"
            )
        k_f, param = chosen.setting.k_f, self.model.plant.parameters["feedback_coefficient"].param
        if param.low <= k_f <= param.high:
            error = chosen.relative_error * k_f
            self.estimates["feedback_coefficient"] = Estimate(k_f, error, k_f - error, k_f + error)
        else:
            self.warnings.append(
                f"K_f = {k_f:g} is not kept: 'feedback_coefficient' goes from {param.low:g} to"
                f" {param.high:g}"
            )


def _potentiometer(bench: _Bench, section: Section) -> None:
    """k_FS, and where the voltage is 0."""
    table = bench.opened(read_table(section, POTENTIOMETER))
    line = straight_line(table["angle"], table["voltage"])
    bench.add("gain k_FS", line.gain, "V/rad", "V/deg")
    bench.add("angle of 0 V", line.zero, "rad", "deg")
    bench.set("potentiometer_gain", line.gain)
    if line.bent:
        bench.doubt(f"{BENT}; see effect sensor_nonlinearity")


def _amplifier(bench: _Bench, section: Section) -> None:
    """K_AP; the one with load is that of the servo."""
    table = bench.opened(read_table(section, AMPLIFIER))
    line = line_with_flats(table["input"], table["output"])
    loaded = " with load" * (bench.element == "amplifier_loaded")
    start, end = line.dead or (None, None)
    bench.add(f"gain K_AP{loaded}", line.gain, "1")
    bench.add("input of 0 V", line.zero, "V")
    bench.add("no change below", line.lower, "V")
    bench.add("dead band from", start, "V")
    bench.add("dead band to", end, "V")
    bench.add("no change above", line.upper, "V")
    bench.set("amplifier_gain", line.gain)
    if line.bent:
        bench.doubt(BENT)


def _motor(bench: _Bench, section: Section) -> None:
    """Static characteristic, both ways."""
    table = bench.opened(read_table(section, MOTOR, (BRANCH,), MOTOR_ROWS))
    branch = table.get("branch")
    curve = motor_curve(table["voltage"], table["speed"], None if branch is None else branch > 0.0)
    bench.add("gain K_EN", curve.gain, GAIN)
    bench.set("motor_gain", curve.gain)
    for name, side, sign in zip(NAMES, (curve.positive, curve.negative), (1.0, -1.0)):
        _side(bench, name, side, sign)
    bench.add("hysteresis width at the edges", curve.width, "V")
    bench.add("shift of the line, rising to falling", curve.shift, "V")
    bench.set_size("hysteresis.half_width", curve.width and curve.width.scaled(0.5))
    for doubt in _doubts(curve):
        bench.doubt(doubt)


def _side(bench: _Bench, name: str, side: SideCurve, sign: float) -> None:
    """One direction: figures with the signs of the table, parameters without."""
    voltages = {
        "insensitivity edge": side.edge,
        "edge, rising": side.starts,
        "edge, falling": side.stops,
        "zero of the line": side.zero,
        "saturation edge": side.saturation,
    }
    bench.add(f"gain, {name}", side.gain, GAIN)
    for what, estimate in voltages.items():
        bench.add(f"{what}, {name}", estimate and estimate.scaled(sign), "V")
    bench.add(f"top speed, {name}", side.top and side.top.scaled(sign), "rad/s")
    bench.set_size(f"edge_{name}", side.edge)
    bench.set_size(f"zero_{name}", side.zero)
    bench.set(f"top_{name}", side.top)
    if not side.top:
        bench.doubt(
            f"no {name} voltage reaches a top speed; 'top_{name}' is not identified, add rows of"
            " higher voltage"
        )


def _doubts(curve: MotorCurve) -> Iterator[str]:
    if curve.unequal:
        yield (
            f"the gains of both sides differ, {curve.positive.gain.value:.5g} and"
            f" {curve.negative.gain.value:.5g} {GAIN}; 'motor_gain' is their common one, see"
            " effect direction_asymmetry"
        )
    if curve.bent:
        yield BENT
    if not curve.width:
        yield "one branch only; hysteresis shows with rising and falling voltage"
    elif curve.shift and curve.width.contradicts(curve.shift):
        yield (
            f"between the branches the edges move by {curve.width.value:.3g} V and the line by"
            f" {curve.shift.value:.3g} V; effect hysteresis moves both alike"
        )


def _motor_step(bench: _Bench, section: Section) -> None:
    """Time constant, and with the voltage also the gain, of a step of speed."""
    table = bench.opened(read_table(section, STEP, (VOLTAGE,)))
    order = first_order(table["time"], table["speed"], table.get("voltage"))
    bench.add("time constant T", order.time_constant, "s")
    bench.add("gain of the step", order.gain, GAIN)
    bench.set("motor_time_constant", order.time_constant)
    bench.dynamic_gain = order.gain
    if order.correlated:
        bench.doubt(
            "the speed is not quite that of a first order, so that the standard errors are too"
            " small"
        )
    static = bench.estimates.get("motor_gain")
    if order.gain and static and order.gain.contradicts(static):
        bench.warnings.append(
            f"the gain of the step, {order.gain.value:.5g}, and that of the static line,"
            f" {static.value:.5g} {GAIN}, disagree"
        )


def _gears(bench: _Bench, section: Section) -> None:
    """K_R, a count without error."""
    ratio = exactly(gear_ratio(section))
    bench.place = f"'{section.file}', {section.name}.teeth"
    bench.add("ratio K_R", ratio, "1")
    bench.set("gear_ratio", ratio)


ELEMENTS: dict[str, Callable[[_Bench, Section], None]] = {
    "potentiometer": _potentiometer,
    "amplifier": _amplifier,
    "amplifier_loaded": _amplifier,
    "motor": _motor,
    "motor_step": _motor_step,
    "gears": _gears,
}
"""In this order, so that a gain with load takes the place of one without."""
