"""Explain an actuator or an effect: what it does, its equations, parameters and sources."""

from __future__ import annotations

import ast
import inspect
import itertools
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from servo_models.catalogue import actuator as find_actuator
from servo_models.catalogue import actuators, all_actuators
from servo_models.core.block import RESERVED, Block
from servo_models.core.bounds import displayed
from servo_models.core.own_actuator import is_file
from servo_models.core.plant import Actuator, Parameter, Placement, Plant, unknown
from servo_models.effects import effects
from servo_models.errors import UserError
from servo_models.report.numbers import Quantity
from servo_models.report.result import Report, data_sheet
from servo_models.report.sections import Table
from servo_models.units import factor

FEW = 1  # most actuators that a list of effects names instead of counts


def explain(name: str, variant: str | None = None) -> Report:
    """Return the data sheet of an actuator, an effect, or an effect at its place.

    Args:
        name: of it, or the path of a file of your own that defines an actuator.
        variant: of the actuator, whose values and equations are shown; default the first.

    Raises:
        UserError: nobody knows that name, or a variant of an effect; see also
            ``catalogue.actuator``.

    Example:
        >>> import servo_models as sm
        >>> print(sm.explain("dead_zone"))  # doctest: +ELLIPSIS
        dead_zone...
    """
    if is_actuator(name):
        return actuator_sheet(find_actuator(name), variant)
    effect = effect_name(name)
    if variant:
        raise UserError(f"'{name}' is an effect and has no variants: leave out '{variant}'")
    return _effect_sheet(effect)


def is_actuator(name: str) -> bool:
    """Whether a name is that of an actuator, or of a file of your own that defines one."""
    return name in all_actuators() or is_file(name)


def overview() -> Report:
    """Return the actuators with their variants, and the effects, as tables.

    Example:
        >>> import servo_models as sm
        >>> print(sm.overview())  # doctest: +ELLIPSIS
        Actuators and effects...
    """
    variants = tuple(
        (actuator.name, variant.name, variant.about)
        for actuator in actuators().values()
        for variant in actuator.variants
    )
    rows = tuple((name, _where(name), _about(name)) for name in effects())
    return data_sheet(
        "Actuators and effects",
        (),
        (
            Table("Actuators", ("actuator", "variant", ""), variants),
            Table("Effects", ("effect", "on", ""), rows),
            Table(
                "Warnings",
                ("",),
                tuple((it,) for actuator in actuators().values() for it in warnings(actuator)),
            ),
        ),
    )


def _where(effect: str) -> str:
    """Actuators that have an effect: by name where there are few; ``explain`` lists all."""
    names = list(dict.fromkeys(place.actuator.name for place in places(effect)))
    return f"{len(names)} actuators" if len(names) > FEW else ", ".join(names)


def warnings(actuator: Actuator) -> tuple[str, ...]:
    """Return one sentence for each warning, with the variants that carry it."""
    names: dict[str, list[str]] = {}
    for variant in actuator.variants:
        if variant.warning:
            names.setdefault(variant.warning, []).append(variant.name)
    return tuple(
        f"Warning: {text} ({actuator.name}: {', '.join(which)})." for text, which in names.items()
    )


@dataclass(frozen=True)
class Place:
    """An effect at one place of one actuator."""

    actuator: Actuator
    name: str
    placements: tuple[Placement, ...]

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        every = self.actuator.plant.parameters.values()
        return tuple(parameter for parameter in every if parameter.owner == self.name)


def places(effect: str) -> tuple[Place, ...]:
    """Return where an effect acts, over all actuators."""
    return tuple(
        Place(actuator, name, placements)
        for actuator in actuators().values()
        for name, placements in actuator.plant.placements.items()
        if placements[0].effect in effects()[effect]
    )


def effect_name(name: str) -> str:
    """Return the effect that ``name`` is, or that is placed under ``name``.

    Raises:
        UserError: neither.
    """
    if name in effects():
        return name
    placed = {place.name: effect for effect in effects() for place in places(effect)}
    if name not in placed:
        raise UserError(unknown("actuator or effect", name, {**actuators(), **effects(), **placed}))
    return placed[name]


def in_display_unit(value: float, parameter: Parameter) -> str:
    """Return a value [SI] of a parameter as a person reads it, without its unit."""
    return f"{display_scale(parameter) * value:.6g}"


def display_scale(parameter: Parameter) -> float:
    """Return the number that a person reads for 1 in SI."""
    param = parameter.param
    return factor(param.unit, param.display) if param.display else 1.0


def shown_value(
    parameter: Parameter, value: float, error: float | None = None, digits: int = 4
) -> Quantity:
    """Return a value [SI] of a parameter, with its standard error, as a person reads it."""
    scale = display_scale(parameter)
    scaled = None if error is None else scale * error
    return Quantity(scale * value, display_unit(parameter), scaled, digits=digits)


def display_unit(parameter: Parameter) -> str:
    """Return the unit in which a person reads a parameter, "" for a pure number."""
    unit = parameter.param.display or parameter.param.unit
    return "" if unit == "1" else unit


def _effect_sheet(name: str) -> Report:
    used_at = places(name)
    where = tuple(
        (place.actuator.name, place.name, ", ".join(link.on))
        for place in used_at
        for link in place.placements
    )
    parameters = tuple(
        (place.actuator.name, *row)
        for place in used_at
        for row in _parameter_rows(place.parameters, place.actuator.values())
    )
    return data_sheet(
        name,
        (_about(name), *(_block_text(block) for block in effects()[name])),
        (
            Table("Acts on", ("actuator", "as", "wire"), where),
            Table(
                "Parameters of each actuator's first variant (of others: explain ACTUATOR --variant"
                " NAME); while those marked * are 0 it does nothing",
                ("actuator", *_PARAMETER_COLUMNS),
                parameters,
            ),
        ),
    )


def actuator_sheet(
    actuator: Actuator, variant: str | None = None, values: Mapping[str, float] | None = None
) -> Report:
    """Return the data sheet of an actuator: equations of a variant, by default the first, with
    ``values`` [SI] of all parameters, by default its own."""
    plant = actuator.plant_of(variant)
    of_actuator = [parameter for parameter in plant.parameters.values() if not parameter.owner]
    placed = [parameter for parameter in plant.parameters.values() if parameter.owner]
    variants = tuple((v.name, v.about, v.source) for v in actuator.variants)
    checked = tuple(
        (v.name, ", ".join(map(str, actuator.checked(v.name))) or "never")
        for v in actuator.variants
    )
    signals = tuple(
        (wire.name, role, wire.display or wire.unit, wire.about)
        for role, names in (("input", [w.name for w in plant.inputs]), ("output", plant.outputs))
        for wire in (plant.wire[name] for name in names)
    )
    whose = "start values" if values else f"values of variant '{actuator.variant(variant).name}'"
    shown = values or actuator.values(variant)
    return data_sheet(
        f"{actuator.name}: {actuator.title}",
        (actuator.about, f"Source: {actuator.source}.", *warnings(actuator)),
        (
            Table("Variants, the first is the default", ("variant", "", "source"), variants),
            Table("Checked against measurements or a data sheet at", ("variant", ""), checked),
            Table("Signals", ("signal", "", "unit", ""), signals),
            Table(
                "Chain, in the order of evaluation; ~ are effects on that wire",
                ("wire", "=", "source"),
                tuple(_chain_rows(plant)),
            ),
            Table(
                f"Parameters, {whose}",
                _PARAMETER_COLUMNS,
                tuple(_parameter_rows(of_actuator, shown)),
            ),
            *_uncertainties(actuator),
            Table(
                f"Parameters of effects, {whose}; while those marked * are 0 it does nothing",
                _PARAMETER_COLUMNS,
                # the page of an FMU has every start value
                tuple(_parameter_rows(placed, shown) if values else _effect_rows(plant, shown)),
            ),
        ),
    )


def _uncertainties(actuator: Actuator) -> Iterator[Table]:
    for variant in actuator.variants:
        rows = tuple((name, f"{share:.0%}") for name, share in variant.uncertainty.items())
        if rows:
            heading = f"Relative standard deviations of variant '{variant.name}'"
            yield Table(heading, ("parameter", ""), rows)


_PARAMETER_COLUMNS = ("parameter", "value", "from", "to", "unit", "")


def _parameter_rows(
    parameters: Iterable[Parameter], values: Mapping[str, float]
) -> Iterator[tuple[str, ...]]:
    for parameter in parameters:
        param = parameter.param
        yield (
            parameter.name + ("*" if param.switch else ""),
            in_display_unit(values[parameter.name], parameter),
            *(f"{bound:.6g}" for bound in displayed(param)),
            display_unit(parameter),
            param.about,
        )


def _effect_rows(plant: Plant, values: Mapping[str, float]) -> Iterator[tuple[str, ...]]:
    """Parameters of effects; a learnt shape that is off is a row, as its knots say nothing."""
    for name in plant.placements:
        parameters = [it for it in plant.parameters.values() if it.owner == name]
        on = any(values[it.name] != 0.0 for it in parameters if it.param.switch)
        if on or not plant.main(name).effect.hints.learnt:
            yield from _parameter_rows(parameters, values)
        else:
            about = f"learnt shape, {len(parameters)} parameters: see 'explain {name}'"
            yield f"{name}*", "0", "", "", "", about


def _chain_rows(plant: Plant) -> Iterator[tuple[str, str, str]]:
    def place_of(link: Block | Placement) -> str:
        return ", ".join(link.on) if isinstance(link, Placement) else ""

    for place, links in itertools.groupby(plant.chain, place_of):
        if place:
            yield f"~ {place}", ", ".join(link.name for link in links), ""
            continue
        for link in links:
            assert isinstance(link, Block)
            yield ", ".join(link.gives), _equation(link, plant), link.source
    for state in plant.states:
        yield state.name, f"integral of {state.rate}", ""
    if plant.projection:
        contact = plant.projection
        yield ", ".join(contact.gives), _equation(contact, plant), contact.source


def _equation(block: Block, plant: Plant) -> str:
    """The formula of a block if it is one; else its docstring and what it reads."""
    body = _body(block)
    if len(body) == 1 and isinstance(body[0], ast.Return) and body[0].value:
        value = body[0].value
        parts = value.elts if isinstance(value, ast.Tuple) else [value]
        return ", ".join(ast.unparse(part) for part in parts)
    reads = [name for name in block.wires if name not in plant.parameters and name not in RESERVED]
    summary = " ".join(block.about.split("\n\n")[0].split()).rstrip(".").replace("``", "'")
    return f"{summary}; from {', '.join(reads)}" if reads else summary


def _about(effect: str) -> str:
    """First line of the file of an effect."""
    module = inspect.getmodule(effects()[effect][0].function)
    return (inspect.getdoc(module) or "").splitlines()[0]


def _block_text(block: Block) -> str:
    """A block of an effect in full: what it does, the code that runs, its source."""
    kinds = {"wires": block.wires, "parameters": block.params, "memory": block.memory}
    reads = "; ".join(f"{kind} {', '.join(names)}" for kind, names in kinds.items() if names)
    code = "\n".join(ast.unparse(statement) for statement in _body(block))
    about = block.about.replace("``", "'")
    return (
        f"{about}\n\n    {block.name}: {reads}\n{textwrap.indent(code, '        ')}\n\n"
        f"Source: {block.source}."
    )


def _body(block: Block) -> list[ast.stmt]:
    """Statements of a block after its docstring."""
    function = ast.parse(textwrap.dedent(inspect.getsource(block.function))).body[0]
    assert isinstance(function, ast.FunctionDef)
    return function.body[1:]
