"""The declaration of an actuator: wires, the chain of blocks between them, named variants."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from servo_models.core.block import RESERVED, SIGNAL, TIME, Bench, Block, Param, check_name
from servo_models.core.bounds import inside, outside
from servo_models.core.flat import owned
from servo_models.core.types import check_fields, check_kind, shown
from servo_models.errors import UserError, did_you_mean
from servo_models.units import factor

TIME_AXIS = "time"  # what tables and FMI masters call their first column
STEP_IN_SCALES = 0.5  # step of a command for which no other was given, over its full scale
_DEVICE = re.compile(r"con|prn|aux|nul|com\d|lpt\d")  # names that Windows keeps for devices


_SCALE = re.compile(rf"(?:{SIGNAL}|\{{(\w+)\}})(\d?)")
"""A full scale in a unit: of the main wire, or of an argument, with its exponent."""


@dataclass(frozen=True)
class Wire:
    """A named scalar between blocks.

    Attributes:
        unit: SI unit.
        about: what flows in it.
        scale: full scale in ``unit``; bounds and nominals derive from it.
        rest: value in equilibrium before the run.
        low, high: bounds, for an input.
        display: unit a person wants to read it in.
        flag: it is 0 or 1, a Boolean to the outside.
        inner: an input that a simulation which is not ours sets, and no person.
        words: words each of which in the heading of a column says that it is this signal.
        bench: how a person sets it (an input) or measures it (an output) on the bench.

    Raises:
        ValueError: a name that no wire can have.
    """

    name: str
    unit: str
    about: str
    scale: float = 1.0
    rest: float | str = 0.0
    low: float | None = None
    high: float | None = None
    display: str | None = None
    flag: bool = False
    inner: bool = False
    words: tuple[str, ...] = ()
    bench: tuple[Bench, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self, f"wire '{self.name}'")
        check_name(self.name, f"wire '{self.name}'")


@dataclass(frozen=True)
class State:
    """A continuous state, integrated from the wire ``rate``.

    ``start`` is a number or a wire that depends on parameters only.  A state that is ``carried``
    depends on what went before: where a log begins in motion its first value is fitted with that
    motion.
    """

    wire: Wire
    rate: str
    start: float | str = 0.0
    owner: str = ""
    carried: bool = False

    def __post_init__(self) -> None:
        check_fields(self, "a state")

    @property
    def name(self) -> str:
        return self.wire.name


@dataclass(frozen=True)
class Placement:
    """An effect at its place: ``name = effect`` on wire ``on``.

    An effect and its parts are placed under one name and share that name's parameters.  ``reads``
    maps further arguments of the effect to wires where the names differ; ``params`` overrides the
    bounds and default of single parameters; ``bench`` is what a person does so that at this place
    it is surely not there.

    Raises:
        ValueError: a name that no effect can have, or ``reads`` or ``params`` of what the effect
            has not.
    """

    name: str
    effect: Block
    on: tuple[str, ...]
    reads: Mapping[str, str] = field(default_factory=dict)
    params: Mapping[str, Param] = field(default_factory=dict)
    bench: tuple[Bench, ...] = ()

    def __post_init__(self) -> None:
        where = f"effect '{self.name}'"
        check_fields(self, where)
        check_name(self.name, where)
        check_known("argument", self.reads, self.effect.wires, where, ValueError)
        check_known("parameter", self.params, self.effect.params, where, ValueError)

    @property
    def switch(self) -> str:
        """Name of its first switch among the parameters of the plant."""
        return f"{self.name}.{self.effect.switches[0]}"

    def wire_of(self, argument: str) -> str:
        if argument in self.effect.acts_on:
            return self.on[self.effect.acts_on.index(argument)]
        return self.reads.get(argument, argument)


def place(
    name: str,
    effect: Block,
    /,  # an effect may have arguments of these names
    *on: str,
    params: Mapping[str, Param | Mapping[str, Any]] | None = None,
    **reads: str,
) -> Placement:
    """Say on which wires an effect acts, and where it stands in a chain.

    Blocks before it in the chain read its wires as they were, those after it as it leaves them.

    Args:
        name: name of the effect at this place; its parameters are ``name.key``.  Effects placed
            under one name share the parameters of one key.
        effect: an effect of ``servo_models.effects``, or made by ``block.effect``.
        on: the wires that it rewrites, as many and in the order of its ``acts_on``.  The plant
            declares them: a unit ``"signal"`` becomes theirs.
        params: what replaces the effect's own, by key: a whole ``Param``, or the fields that
            differ; with the unit ``"signal"`` its bounds and typical value are fractions of the
            wire's full scale, else SI.
        reads: wires for its other arguments; one that is not named reads the wire, or the
            parameter of the plant, that is called like it.

    Raises:
        ValueError: another number of wires; see also ``Placement``.

    Example:
        >>> import servo_models as sm
        >>> from servo_models.effects.dead_zone import dead_zone
        >>> sm.place("drive_dead_zone", dead_zone, "voltage").on
        ('voltage',)
    """
    check_kind("name of place(name, ...)", name, str)
    if not (isinstance(effect, Block) and effect.acts_on):
        raise ValueError(
            f"'{name}': {shown(effect)} is no effect: import one, such as dead_zone of"
            " servo_models.effects.dead_zone; a block stands in a chain by itself"
        )
    check_kind(
        f"'params' of place('{name}', ...)", params or {}, Mapping[str, Param | Mapping[str, Any]]
    )
    if len(on) != len(effect.acts_on):
        raise ValueError(f"'{name}': {effect.name} acts on {effect.acts_on}, given {on}")
    absent = Param("1", "of a key that Placement refuses")
    whole = {
        key: param if isinstance(param, Param) else replace(effect.params.get(key, absent), **param)
        for key, param in (params or {}).items()
    }
    return Placement(name, effect, on, reads, whole)


@dataclass(frozen=True)
class Parameter:
    """A parameter of the whole actuator, in SI: ``param`` with the wire's unit filled in."""

    name: str
    param: Param
    owner: str

    @property
    def text(self) -> str:
        """Its name in the flat text."""
        return owned(self.owner, self.key) if self.owner else self.key

    @property
    def key(self) -> str:
        """Its name in the signature of its block."""
        return self.name.rpartition(".")[2]


def internal_step(default: float, low: float = 1e-5, high: float = 5e-3) -> dict[str, Param]:
    """Return the constant that every plant has: the longest step of its integration [s]."""
    about = "longest internal step"
    return {"internal_step": Param("s", about, default, low, high, display="us", fixed=True)}


@dataclass(frozen=True, eq=False)
class Plant:
    """A chain of blocks between wires; one plant equals itself only.

    A block finds its arguments by name: inputs, states, parameters of the plant, and what blocks
    before it in the chain give.  A name means one thing: a wire is given by one block, and no
    wire, parameter or output has the name of another.  There may be any number of inputs; effects
    are also shown under a constant load where one of them is called ``load_...``.

    Attributes:
        inputs: wires set from outside, held during a communication step.
        wires: the other wires with a unit: outputs and those that effects act on.  A wire that
            only blocks read needs no declaration, a state has its own.
        chain: plant blocks and placements in the order of evaluation.
        states: continuous states.
        projection: block applied to new states after each smooth sub-step, or None.
        outputs: names of the wires offered outside, each declared, none of them an input; the
            first is the one that pictures and figures are about.
        constants: parameters of the plant that no block's signature declares; one of them is
            ``internal_step``, see there.
        time_scale: full scale of time [s], about as long as a step takes to settle: bounds and
            trial values of delays, lags, frames and rate limits are fractions of it.
        terminals: inputs and outputs by what hosts of FMI 3.0 connect them to as one, such as
            ``shaft`` and ``supply``; the main input alone is ``command``, unless that is given.

    Raises:
        ValueError: a wire or a parameter has a name that none can have, or a terminal a member
            that is no input and no output.
    """

    inputs: tuple[Wire, ...]
    wires: tuple[Wire, ...]
    chain: tuple[Block | Placement, ...]
    states: tuple[State, ...]
    outputs: tuple[str, ...]
    projection: Block | None = None
    constants: Mapping[str, Param] = field(default_factory=dict)
    terminals: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    time_scale: float = 1.0

    def __post_init__(self) -> None:
        check_fields(self, "the plant")
        for link in self.chain:
            if isinstance(link, Block) and link.acts_on:
                name = link.name
                raise ValueError(f"effect {name} is in no place: place('{name}', {name}, signal)")
        if not 0.0 < self.time_scale < math.inf:
            raise ValueError(f"time_scale = {self.time_scale}: give seconds, more than 0")
        for name in self.constants:
            check_name(name, f"parameter '{name}'")
        for wire in (*self.inputs, *self.wires, *(state.wire for state in self.states)):
            if wire.name in (*RESERVED, TIME_AXIS):
                raise ValueError(f"'{wire.name}' is time itself: give the wire another name")
        outside = dict.fromkeys([*(wire.name for wire in self.inputs), *self.outputs])
        for terminal, members in self.terminals.items():
            where = f"terminal '{terminal}'"
            check_name(terminal, where)
            check_known("input or output", members, outside, where, ValueError)

    @cached_property
    def wire(self) -> dict[str, Wire]:
        """Declared wires by name."""
        every = (*self.inputs, *self.wires, *(state.wire for state in self.states))
        return {wire.name: wire for wire in every}

    @property
    def settable(self) -> tuple[Wire, ...]:
        """Inputs that a log or a person gives."""
        return tuple(wire for wire in self.inputs if not wire.inner)

    @cached_property
    def placements(self) -> dict[str, tuple[Placement, ...]]:
        """Placements by effect name as placed; two functions of one effect stay together."""
        placed: dict[str, tuple[Placement, ...]] = {}
        for link in self.chain:
            if isinstance(link, Placement):
                placed[link.name] = (*placed.get(link.name, ()), link)
        return placed

    def main(self, name: str) -> Placement:
        """Return where an effect itself is placed, and none of its parts."""
        links = self.placements[name]
        parts = [part for link in links for part in link.effect.parts]
        return next((link for link in links if link.effect not in parts), links[0])

    def main_wire(self, name: str) -> str:
        """Return the wire on which an effect acts, the first one where it acts on several."""
        return self.main(name).on[0]

    @cached_property
    def parameters(self) -> dict[str, Parameter]:
        """All parameters by name, plant first, in chain order.

        Raises:
            ValueError: two blocks declare a parameter differently.
        """
        declared = {
            name: Parameter(name, param, owner="") for name, param in self.constants.items()
        }
        blocks: list[Block | Placement] = [*self.chain]
        if self.projection:
            blocks.append(self.projection)
        for link in blocks:
            if isinstance(link, Placement):
                for key, param in link.effect.params.items():
                    name = f"{link.name}.{key}"
                    known = self._in_si(name, link.params.get(key, param), link)
                    declared.setdefault(name, Parameter(name, known, owner=link.name))
            else:
                for key, param in link.params.items():
                    if declared.setdefault(key, Parameter(key, param, owner="")).param != param:
                        raise ValueError(
                            f"parameter '{key}' of block '{link.name}' is declared otherwise"
                            " elsewhere: give it another name, or take that of the other block"
                            " as a plain argument"
                        )
        return dict(sorted(declared.items(), key=lambda item: item[1].owner != ""))

    def rated(
        self, rests: Mapping[str, float] | None = None, scales: Mapping[str, float] | None = None
    ) -> Plant:
        """Return the same equations with other rests and full scales [SI] of single wires.

        A variant has them where its supply or its size is not that of the others.

        Example:
            ``PLANT.rated(rests={"supply": 7.4}, scales={"supply": 7.4})``
        """
        rest, scale = rests or {}, scales or {}
        check_known("wire", (*rest, *scale), self.wire, error=ValueError)

        def of(wire: Wire) -> Wire:
            return replace(
                wire,
                rest=rest.get(wire.name, wire.rest),
                scale=scale.get(wire.name, wire.scale),
            )

        return replace(
            self,
            inputs=tuple(of(wire) for wire in self.inputs),
            wires=tuple(of(wire) for wire in self.wires),
            states=tuple(replace(state, wire=of(state.wire)) for state in self.states),
        )

    def has_equations_of(self, other: Plant) -> bool:
        """Return whether both differ at most in rests and full scales of their wires."""

        def equations(plant: Plant) -> tuple[object, ...]:
            states = [(state.name, state.rate, state.start) for state in plant.states]
            return plant.chain, states, plant.projection, plant.outputs

        return equations(self) == equations(other)

    def _in_si(self, name: str, param: Param, link: Placement) -> Param:
        """Return a parameter whose bounds are fractions of full scales with its bounds in SI."""
        if not param.is_scaled:
            return param
        scale, unit, display = 1.0, param.unit, param.unit
        for match in _SCALE.finditer(param.unit):
            wire, power = self._counted_in(name, match[1], link), int(match[2] or 1)
            full, is_below = wire.scale**power, "/" in param.unit[: match.start()]
            scale = scale / full if is_below else scale * full
            is_compound = "." in wire.unit or "/" in wire.unit
            of_wire = ".".join([wire.unit] * power) if is_compound else f"{wire.unit}{match[2]}"
            of_wire = f"({of_wire})" if is_compound and is_below else of_wire
            unit = unit.replace(match[0], of_wire)
            display = display.replace(match[0], wire.display or of_wire)
        follows = param.unit.startswith(SIGNAL) and self.wire[link.on[0]].display
        return replace(
            param,
            unit=unit,
            low=param.low * scale,
            high=param.high * scale,
            default=param.default * scale,
            typical=param.typical * scale,
            display=param.display or (display if follows else None),
        )

    def _counted_in(self, name: str, argument: str | None, link: Placement) -> Wire:
        """Return the wire whose full scale is meant: an argument's, None for the main wire."""
        if argument == TIME:
            return Wire(TIME, "s", "full scale of time", self.time_scale)
        placed = (link, *self.placements[link.name])
        reading = (one for one in placed if argument in one.effect.wires)
        on = next((one.wire_of(str(argument)) for one in reading), argument) or link.on[0]
        if argument and on not in self.wire:
            raise ValueError(
                f"bounds of '{name}' are fractions of the full scale of '{on}', which is no Wire:"
                " declare it, or give other bounds by params"
            )
        check_known("wire", [on], self.wire, error=ValueError)
        return self.wire[on]


@dataclass(frozen=True)
class Variant:
    """A named parameter set, with where it comes from.

    ``uncertainty`` holds relative standard deviations (prior) of its parameters;
    ``stop_time`` and ``step_size`` [s] are its default experiment where the actuator's is
    not for it.  ``command`` is the input that moves it where that is not the actuator's main one:
    its standard step is of that input, and ``check --init`` proposes the variant for a log of it.
    ``checked`` holds from where to where [SI] inputs went while it was checked against measurements
    or a data sheet, the others at rest; it is empty where it never was.
    """

    name: str
    about: str
    values: Mapping[str, float]
    source: str
    plant: Plant | None = None
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    warning: str = ""
    stop_time: float | None = None
    step_size: float | None = None
    command: str = ""
    checked: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self, f"variant '{self.name}'")


@dataclass(frozen=True)
class Checked:
    """From where to where [SI] an input went while a variant was checked, by measurements or a data
    sheet."""

    wire: Wire
    low: float
    high: float
    variant: str

    def __str__(self) -> str:
        wire = self.wire
        scale = factor(wire.unit, wire.display) if wire.display else 1.0
        ends = " to ".join(f"{scale * end:.4g}" for end in dict.fromkeys((self.low, self.high)))
        return f"{wire.name} {ends} {wire.display or wire.unit}"

    @property
    def beyond(self) -> str:
        """What an input outside means."""
        return (
            f"'{self.wire.name}' is not where variant '{self.variant}' was checked against"
            f" measurements or a data sheet ({self})"
        )


@dataclass(frozen=True)
class GreyBox:
    """How physical constants follow from a transfer function of an actuator.

    The function is gain / (s^n + ... + s1 s + s0), with a delay or without.

    Attributes:
        source, output: wires that the function connects.
        coefficients: names of coefficients in ``solve``: the gain, then the denominator's from the
            second highest power down.
        known: parameters that the coefficients cannot tell.
        solve: called with the coefficients, then the known ones [SI], in these orders; returns the
            others [SI] by the parameter's name.
        delay: parameter that the function's delay [s] becomes.
    """

    source: str
    output: str
    coefficients: tuple[str, ...]
    known: tuple[str, ...]
    solve: Callable[..., dict[str, float]]
    delay: str

    @property
    def poles(self) -> int:
        """How many poles the function has."""
        return len(self.coefficients) - 1


@runtime_checkable
class Inner(Protocol):
    """A simulation that is not ours, between the command and the readings of a plant."""

    def ran(
        self,
        run: Callable[[Any, Any, Any], Any],
        values: Mapping[str, float],
        state: Any,
        times: Any,
        inputs: Any,
    ) -> Any:
        """Return the outputs, shape (n, outputs), of both together; see ``foreign.box.Around``."""
        ...

    def only(self, names: frozenset[str]) -> Actuator:
        """Return the actuator with these outputs of the simulation, and the first one, alone, and
        without effects on commands that are not among the names."""
        ...


@dataclass(frozen=True)
class Actuator:
    """An identified product: a plant and its variants.

    A file of your own defines one as ``ACTUATOR``.  It may import and compute what it likes; a
    block is read from its source, so it is a ``def`` in a file.

    Attributes:
        name: one string everywhere, also in the FMU: letters, digits and single underscores
            between them, beginning with a letter.
        title, about, source: texts for people; may be empty.
        plant: plant of the variants without one of their own.
        variants: at least one; the first one is the default.  Their values are in SI; what
            a variant does not name has the default of its ``Param``.
        stop_time, step_size: default experiment [s].
        step: name of the main input, its value [SI] in the standard step, to which it goes from
            its ``rest``; ``step_of`` is that of a variant.
        grey_box: how its constants follow from a transfer function, where somebody solved that.
        general: it stands for a kind of actuator, not for one that is made: ``check --init``
            proposes it only where no other fits.
        file: file that defines it, None for one of the catalogue.
        inner: simulation that is not ours, around which the plant stands, if there is one.

    Raises:
        ValueError: a name that no FMU can have, no variant, an output without a ``Wire`` of its
            unit, a standard step of what is no input, or an uncertainty or a known constant of the
            grey box of what is no parameter.
    """

    name: str
    title: str
    about: str
    source: str
    plant: Plant
    variants: tuple[Variant, ...]
    stop_time: float
    step_size: float
    step: tuple[str, float]
    picture: str = ""
    grey_box: GreyBox | None = None
    general: bool = False
    file: Path | None = None
    inner: Inner | None = None

    def __post_init__(self) -> None:
        check_fields(self, f"actuator '{self.name}'")
        check_actuator_name(self.name)
        if not self.variants:
            raise ValueError(f"actuator '{self.name}' has no variant: give it one")
        known_to_box = self.grey_box.known if self.grey_box else ()
        for variant in self.variants:
            plant = variant.plant or self.plant
            inputs = {wire.name: wire for wire in plant.inputs}
            for kind, names, known in (
                ("output", plant.outputs, plant.wire),
                ("input of the standard step", self.step[:1], inputs),
                ("command of a variant", filter(None, [variant.command]), inputs),
                ("parameter with an uncertainty", variant.uncertainty, plant.parameters),
                ("input that was checked", variant.checked, inputs),
                ("parameter known to the grey box", known_to_box, plant.parameters),
            ):
                check_known(kind, names, known, error=ValueError)

    @property
    def key(self) -> str:
        """Its name, or the path of its file, by which ``catalogue.actuator`` finds it."""
        return str(self.file) if self.file else self.name

    @property
    def default_variant(self) -> str:
        return self.variants[0].name

    def variant(self, name: str | None = None) -> Variant:
        """Return a variant by name, the default one for None."""
        known = {variant.name: variant for variant in self.variants}
        name = self.default_variant if name is None else name
        check_known("variant", [name], known, f"actuator '{self.name}'")
        return known[name]

    def checked(self, variant: str | None = None) -> tuple[Checked, ...]:
        """Return, of every input, where it was while a variant was checked; none if never."""
        chosen = self.variant(variant)
        return tuple(
            Checked(wire, *chosen.checked.get(wire.name, 2 * (float(wire.rest),)), chosen.name)
            for wire in self.plant_of(variant).inputs
            if chosen.checked
        )

    def plant_of(self, variant: str | None = None) -> Plant:
        """Return the plant that a variant runs on."""
        return self.variant(variant).plant or self.plant

    def step_of(self, variant: str | None = None, command: str = "") -> tuple[str, float]:
        """Return the command of a variant, or another one, and its value [SI] in the standard step.

        A command that is not the main input steps by half of its full scale, within its bounds.
        """
        name = command or self.variant(variant).command or self.step[0]
        if name == self.step[0]:
            return self.step
        wire = self.plant_of(variant).wire[name]
        return name, inside(float(wire.rest) + STEP_IN_SCALES * wire.scale, wire)

    def values(
        self, variant: str | None = None, overrides: Mapping[str, float] | None = None
    ) -> dict[str, float]:
        """Return every parameter in SI: defaults, then the variant, then ``overrides``.

        Raises:
            UserError: unknown parameter, or a value outside its bounds.
        """
        parameters = self.plant_of(variant).parameters
        chosen = {name: p.param.default for name, p in parameters.items()}
        given = {**self.variant(variant).values, **(overrides or {})}
        check_known("parameter", given, parameters, f"actuator '{self.name}'")
        chosen |= {name: float(value) for name, value in given.items()}
        for name, value in chosen.items():
            check_bounds(parameters[name], value)
        return chosen


def check_actuator_name(name: str) -> None:
    """Raise ValueError unless an actuator, its FMU and its file can have this name."""
    check_name(name, f"actuator '{name}'")
    if _DEVICE.fullmatch(name.lower()):
        raise ValueError(
            f"actuator '{name}' has the name of a device, by which Windows lets no file be"
            " called, so no FMU either: give it another one"
        )


def check_bounds(parameter: Parameter, value: float) -> None:
    """Raise UserError unless ``value`` [SI] is inside the parameter's bounds."""
    param = parameter.param
    if not param.low <= value <= param.high:
        raise UserError(outside("parameter", parameter.name, value, param))


def check_units(plant: Plant) -> None:
    """Raise ValueError unless every unit is one and every display unit converts to its own."""
    signals: list[tuple[str, Wire | Param]] = [
        *((f"wire '{wire.name}'", wire) for wire in plant.wire.values()),
        *((f"parameter '{p.name}'", p.param) for p in plant.parameters.values()),
    ]
    for place_, signal in signals:
        try:
            factor(signal.display or signal.unit, signal.unit)
        except UserError as error:
            raise ValueError(f"{place_}: {error}") from None


def check_known(
    kind: str,
    names: Iterable[str],
    known: Collection[str],
    where: str = "",
    error: type[Exception] = UserError,
) -> None:
    """Raise ``error`` for the first of some names that is none of the ``known``."""
    for name in names:
        if name not in known:
            raise error(unknown(kind, name, known, where))


def unknown(kind: str, name: str, known: Collection[str], where: str = "") -> str:
    """Sentence about a name nobody knows, with the nearest one that exists."""
    place_ = f" in {where}" if where else ""
    return f"unknown {kind} '{name}'{place_}; {did_you_mean(name, known)}"
