"""Identify a servo element by element, put its loop together and choose its feedback."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from servo_models.actuators.sg90.elements import LOOP, MADE_OF, TABLES
from servo_models.core.plant import check_bounds
from servo_models.core.simulate import Model
from servo_models.data.description import Description, read_description
from servo_models.data.schema import Section
from servo_models.errors import UserError
from servo_models.identification.elements.estimate import Estimate, Figure
from servo_models.identification.elements.lines import amplifier, potentiometer
from servo_models.identification.elements.loop import Choice, Synthesis, synthesise
from servo_models.identification.elements.motor import GAIN, motor, motor_step
from servo_models.identification.elements.tables import GearTable, read_table, read_wish
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
    figures: tuple[Figure, ...]
    estimates: Mapping[str, Estimate]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    files: Mapping[str, str]

    @property
    def parameters(self) -> dict[str, tuple[float, float]]:
        """Value and standard error [SI] by name of the actuator's parameter."""
        return {name: (e.value, e.standard_error) for name, e in self.estimates.items()}

    def figure(self, element: str, name: str) -> Estimate:
        """Return a figure by element and name."""
        return next(f.estimate for f in self.figures if (f.element, f.name) == (element, name))


def identify_elements(description: Description | str | Path) -> ElementsResult:
    """Identify the elements that a description has tables of; see ``elements.tables``.

    Raises:
        UserError: see ``read_description``, ``tables.read_table`` and the estimates of the
            elements; an actuator that is not made of these elements; an estimate out of the
            bounds of its parameter.  It names the file, and the key or columns.
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
    wish, bench = read_wish(entries.section("synthesis")), _Bench(model)
    for element in (*TABLES, GEARS):
        if element in entries:
            bench.identify(element, entries.section(element))
    if not bench.figures:
        document.fail("elements", "no element; add [elements.motor] or another one")
    parts = {name: Estimate.of(model.values[name]) for name in ("motor_gain", *LOOP)}
    parts = {name: bench.estimates.get(name, given) for name, given in parts.items()}
    dynamic = [f.estimate for f in bench.figures if f.name == "gain of the step"]
    if dynamic:
        parts["motor_gain"] = dynamic[0]
    synthesis = synthesise(parts, model.values["angle_unit"], wish)
    bench.keep(synthesis.choices[0], dynamic)
    return ElementsResult(
        model=model,
        synthesis=synthesis,
        figures=tuple(bench.figures),
        estimates=bench.estimates,
        notes=tuple(bench.notes),
        warnings=tuple(bench.warnings),
        files=bench.files,
    )


@dataclass(eq=False)
class _Bench:
    """What is known so far, while the elements are identified; see ``ElementsResult``."""

    model: Model
    figures: list[Figure] = field(default_factory=list)
    estimates: dict[str, Estimate] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    files: dict[str, str] = field(default_factory=dict)

    def identify(self, element: str, section: Section) -> None:
        """Add figures and parameters of an element; errors say which table they are about."""
        doubts: list[str] = []
        if element == GEARS:
            teeth = section.read(GearTable).teeth
            file, place = "", f"'{section.file}', {section.name}.teeth"
            ratio = Estimate.of(math.prod(driven / driving for driving, driven in teeth))
            figures = [Figure("ratio K_R", ratio, "1", parameter="gear_ratio")]
        else:
            table = read_table(section, TABLES[element])
            file, place = table.path.name, table.place
            self.files[file] = table.sha256
            try:
                figures, doubts = ESTIMATORS[element](*table.columns)
            except UserError as error:
                raise UserError(f"{place}: {error}") from error
        for figure in figures:
            self.figures.append(replace(figure, element=element, file=file))
            if figure.parameter:
                self._set(figure.parameter, figure.estimate.scaled(figure.factor), place)
        self.warnings += [f"{place}: {doubt}" for doubt in doubts]
        static = self.estimates.get("motor_gain")
        for figure in figures:
            if figure.name == "gain of the step" and static and figure.estimate.contradicts(static):
                self.warnings.append(
                    f"the gain of the step, {figure.estimate.value:.5g}, and that of the static"
                    f" line, {static.value:.5g} {GAIN}, disagree"
                )

    def _set(self, name: str, estimate: Estimate, place: str) -> None:
        """Keep a parameter [SI]; one that cannot be below 0 is 0 then."""
        known = self.model.plant.parameters[name]
        if estimate.value < known.param.low == 0.0:
            text = f"'{name}' was found at {estimate.value:.3g} and is taken as 0"
            self.warnings.append(Doubt(text))
            estimate = replace(estimate, value=0.0)
        try:
            check_bounds(known, estimate.value)
        except UserError as error:
            raise UserError(f"{place}: {error}, or correct unit, scale and sign") from error
        self.estimates[name] = estimate

    def keep(self, chosen: Choice, dynamic: list[Estimate]) -> None:
        """Keep the feedback coefficient, and say what went into it."""
        given = [name for name in LOOP if name not in self.estimates]
        if dynamic:
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
