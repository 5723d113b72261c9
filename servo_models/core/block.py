"""What a block is: one plain Python function of floats whose signature is its data sheet.

Rules of a block, which an error tells where one is broken: it has a docstring; its arguments and
local variables have names of letters, digits and single underscores between them; its body is of
assignments, ``if`` and ``while`` (no ``return`` inside it), arithmetic, comparisons, ``abs``,
``int``, ``float``, ``math`` and numbers that are constants of the file; it has no ``**``, no ``%``
of a float, no ``for``, no call of another function, and every variable has a value where it is
read.

A block reads wires (plain arguments), parameters (``Param``) and memory (``Memory``,
``Clock``, ``Mode``, ``Queue``, ``Fault``, ``Notice``) and returns the new value of its wires
followed by the new value of each memory, in the order of the signature.  It is pure: the stepper
decides when a memory is committed.  Reserved arguments:

==================  ==================================================================
``now``             time at the start of the sub-step [s]
``due``             ``now`` plus the event tolerance: what is due until then happens now
``elapsed``         time since the last commit [s]; 0 at a start, the stage's offset after
``input_age``       time since the inputs were set, at the communication point [s]
``start_<state>``   value of a continuous state at the start of the sub-step
``dt``               length of the sub-step [s], for the projection only
==================  ==================================================================

An *effect* is a block with one law: with every switch parameter at 0 it is exactly the
identity, so that all effects are always compiled in and a candidate explanation of a
gap is a parameter vector.  How it is searched for, and what it is confused with, are its ``Hints``:
no other module knows an effect by name.
"""

from __future__ import annotations

import inspect
import keyword
import re
import typing
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from string import Formatter
from typing import Any, Literal

from servo_models.core.types import check_fields

TYPICAL = 0.1  # typical value of a switch over its upper bound, where it has none of its own
SIGNAL = "signal"  # unit of a parameter that takes the unit and the scale of the wire it acts on
TIME = "time"  # ``{time}`` in a unit is the plant's full scale of time

RESERVED = ("now", "due", "elapsed", "input_age")
START = "start_"  # ``start_<state>`` is a reserved argument too

LIMITS_OVER_TYPICAL = (
    0.06, 0.1, 0.16, 0.24, 0.35, 0.5, 0.65, 0.8, 0.95, 1.15, 1.45, 2.0, 2.5, 3.0, 3.4, 4.0,
)  # fmt: skip
"""Trial values of a limit, which acts below the largest value that occurs, or not at all."""

_SCALE = rf"(?:{SIGNAL}|\{{\w+\}}\d?)"
_OF_SCALES = re.compile(rf"{_SCALE}(?:[./](?:{_SCALE}|\w+))?|1/{_SCALE}")
_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*")


@dataclass(frozen=True)
class Param:
    """A parameter in a block's signature.

    With unit ``"signal"`` the parameter has the unit of the wire acted on, and ``low``,
    ``high`` and ``typical`` are fractions of that wire's full scale; ``"signal/s"`` is
    such a rate and ``"1/signal"`` its inverse, a fraction of the inverse of full scale.  Other
    full scales stand in braces: those of wires by the argument's name, as in
    ``"{shaft_angle}/{load}"`` or ``"1/{spring_angle}2"``, and ``{time}`` of the plant.

    Attributes:
        unit: SI unit, e.g. ``"N.m/rad"``; ``"1"`` for a pure number.
        about: what it is, for the FMU's description and ``explain``.
        default: value where no variant says otherwise; a switch defaults to 0.
        low, high: inclusive bounds.
        switch: the effect is the identity while all its switches are 0.
        typical: a moderate value that makes a switch's effect visible; a tenth of ``high`` where
            nobody gives it.
        display: unit a person wants to read it in, e.g. ``"deg"``.
        fixed: cannot be changed once a run has begun.

    Raises:
        ValueError: a unit with ``signal`` or braces whose scale is not clear.
    """

    unit: str
    about: str
    default: float = 0.0
    low: float = 0.0
    high: float = 1.0
    switch: bool = False
    typical: float = 0.0
    display: str | None = None
    fixed: bool = False

    def __post_init__(self) -> None:
        check_fields(self, "a parameter")
        if self.is_scaled and not _OF_SCALES.fullmatch(self.unit):
            raise ValueError(
                f"parameter with unit '{self.unit}' ({self.about}): write 'signal', 'signal/s' or"
                " '1/signal', or other full scales in braces, such as '{shaft_angle}/{load}'"
            )

    @property
    def is_scaled(self) -> bool:
        """Whether its bounds are fractions of full scales."""
        return SIGNAL in self.unit or "{" in self.unit


@dataclass(frozen=True)
class Memory:
    """A float remembered from commit to commit; ``"rest"`` starts at the wire's rest value."""

    start: float | str = 0.0


@dataclass(frozen=True)
class Clock(Memory):
    """A memory that holds the time of the block's next event; a sub-step ends there.

    It starts in the past, wherever a run may start: the first event is due at once.
    """

    start: float | str = -1e300


@dataclass(frozen=True)
class Mode(Memory):
    """A memory that selects a branch of a right-hand side that jumps.

    The block keeps to its mode while ``elapsed`` > 0, so the Runge-Kutta stages see no
    jump, and returns the mode that it would choose now; the stepper halves a sub-step in
    which the two differ until the jump is located.
    """


@dataclass(frozen=True)
class Fault(Memory):
    """A memory that stops the run with ``message`` as soon as it is not 0."""

    message: str = ""


@dataclass(frozen=True)
class Notice(Memory):
    """A memory that lets a run go on, which then warns with ``message`` once it is not 0.

    Arguments of the block in braces, such as ``{regressor}``, become the names of their wires.
    """

    message: str = ""


@dataclass(frozen=True)
class Queue:
    """A fixed number of floats that the block indexes; written in place at events only."""

    size: int


@dataclass(frozen=True)
class Grid:
    """Values at which an effect with a discontinuous parameter is searched for.

    The response jumps as that parameter changes, so no slope leads to the best value.  The grid is
    the finer the more often the value fits into what it divides.

    Attributes:
        low, high: ends of the grid, over the typical value.
        least_spacing: relative distance of two values, at least.
        divides: the ``"range"`` of the signal acted on, or the ``"duration"`` of a log, of which
            the parameter is a period.
    """

    low: float
    high: float
    least_spacing: float
    divides: Literal["range", "duration"] = "range"


@dataclass(frozen=True)
class LinearMemory:
    """An effect with a memory that stays in the small-signal model, since it is linear.

    Attributes:
        time: its parameter [s].
        input, output: memories that hold what went in and what came out last.
    """

    time: str
    input: str
    output: str


class FirstOrderLag(LinearMemory):
    """``time`` y' + y = u."""


class DeadTime(LinearMemory):
    """y(t) = u(t - ``time``)."""


@dataclass(frozen=True)
class Ambiguity:
    """Effects that look alike in a log, and the experiment that separates them.

    Attributes:
        experiment: in words, what to do and to log.
        group: names of effects, the one that declares it among them; each looks like any other.
        against: names of effects that each of ``group`` looks like instead, where given.
    """

    experiment: str
    group: tuple[str, ...]
    against: tuple[str, ...] = ()

    def separates(self, effect: str, other: str) -> bool:
        """Return whether the experiment tells two effects apart."""
        others = self.against or self.group
        return effect != other and (
            (effect in self.group and other in others) or (other in self.group and effect in others)
        )


@dataclass(frozen=True)
class Harmonic:
    """A further sine of a ripple, by its parameters; without a share there is none.

    Attributes:
        share: parameter for its amplitude over that of the first sine.
        count: parameter that says how many periods it has in a turn.
        phase: parameter that shifts it.
    """

    share: str
    count: str
    phase: str


@dataclass(frozen=True)
class Bench:
    """What a person can do on the bench, beside another command, to tell causes apart.

    What has the same ``how`` is done at once.

    Attributes:
        how: an instruction, such as "hang a known weight on the shaft".
        seconds: time that it takes, about.
        value: over the full scale of a wire: of an input what it is set to, of an output the noise
            floor that its readings may have.  An effect is gone.
    """

    how: str
    seconds: float
    value: float = 0.0


UNLOADED = Bench("take off what the shaft carries beyond the inertia that the model counts", 120.0)
UPRIGHT = Bench("turn the axis of the shaft upright, so that no weight turns it", 180.0)

Signature = Literal["", "codes", "clock"]
OTHER_UNITS = ""  # every unit that no other effect names, in ``Hints.parameter_units``


@dataclass(frozen=True)
class Hints:
    """What is known of an effect beside its equation; most effects need none.

    Attributes:
        trial_values: trial values of each switch over its typical value; by default a few about it.
        grid: trial values of an effect whose switch is a discontinuous parameter.
        inverse: the effect is the stronger the smaller its switch.
        jump: parameter that says which part of a jump the effect has: 0 none, 1 all.
        phase: parameter that shifts a sine whose amplitude is the switch.
        count: parameter that says how many periods this sine has in a turn.
        angle: argument of that sine.
        harmonics: its further sines, sought one by one once the first is found.
        inertia: parameter that is in resonance with the switch, a compliance.
        assumed: constants that are never searched for: each may be a few times larger or smaller.
        counted_in: parameters that say in what it is counted.
        signature: its evidence apart from any error, by its switch: a quantised reading bunches at
            ``"codes"`` a step apart, a sampled command is answered on the ticks of a ``"clock"``.
        small_signal: what an effect with a memory becomes in the small-signal model; an effect
            without one stays there where it has a derivative.
        ambiguity: what it is confused with, unless the file of another effect says it.
        parameter_units: units of plant parameters whose error looks like it.
        of_changes: it shows only where an input changes: with one value in all logs it is as good
            as an offset, and is not searched for.
        family: word that it shares with effects that can replace each other, such as "friction".
        learnt: it has whatever form a log shows, so it is never searched for as a cause.
        says: what it does with its size, in a clause: its parameters in braces, and ``{wire}``.
        limited: signals whose readings never exceed its switch in magnitude, "" for its wire.
        bench: what a person does so that it is surely not there, wherever it is placed.
    """

    trial_values: tuple[float, ...] = ()
    grid: Grid | None = None
    inverse: bool = False
    jump: str = ""
    phase: str = ""
    count: str = ""
    angle: str = ""
    harmonics: tuple[Harmonic, ...] = ()
    inertia: str = ""
    assumed: tuple[str, ...] = ()
    counted_in: tuple[str, ...] = ()
    signature: Signature = ""
    small_signal: LinearMemory | None = None
    ambiguity: Ambiguity | None = None
    parameter_units: tuple[str, ...] = ()
    of_changes: bool = False
    family: str = ""
    learnt: bool = False
    says: str = ""
    limited: tuple[str, ...] = ()
    bench: tuple[Bench, ...] = ()

    @property
    def counts(self) -> tuple[str, ...]:
        """Parameters that say how many periods a sine has in a turn."""
        return tuple(it for it in (self.count, *(one.count for one in self.harmonics)) if it)

    @property
    def named(self) -> set[str]:
        """Parameters whose sizes ``says`` tells."""
        return {name for _, name, *_ in Formatter().parse(self.says) if name} - {"wire"}

    @property
    def not_at_first(self) -> set[str]:
        """Parameters that are no part of the search for the effect."""
        further = (name for it in self.harmonics for name in (it.share, it.count, it.phase))
        return {*self.assumed, *self.counted_in, *further}


Meta = Param | Memory | Queue
Function = Callable[..., Any]


@dataclass(frozen=True)
class Block:
    """A parsed block function.

    Attributes:
        function: the function itself, callable on plain floats.
        name: its name.
        wires: names of its wire arguments, reserved ones included, in order.
        params: its parameters by name.
        memory: its memories by name, in the order in which they are returned.
        queues: its queues by name.
        acts_on: arguments whose wires an effect rewrites, else empty.
        gives: wires that a plant block defines.
        source: paper, equation or book behind it.
        parts: other functions of an effect that acts at several places of a chain.
        hints: what else is known of an effect.
        keys: argument of the function by the name of its parameter or memory, where they differ.
    """

    function: Function
    name: str
    wires: tuple[str, ...]
    params: dict[str, Param]
    memory: dict[str, Memory]
    queues: dict[str, Queue]
    acts_on: tuple[str, ...] = ()
    gives: tuple[str, ...] = ()
    source: str = ""
    about: str = field(default="", compare=False)
    parts: tuple[Block, ...] = ()
    hints: Hints = Hints()
    keys: Mapping[str, str] = field(default_factory=dict)

    def __call__(self, *args: Any, **kwargs: Any) -> Any:
        return self.function(*args, **{self.keys.get(key, key): it for key, it in kwargs.items()})

    def keyed(self, keys: Mapping[str, str]) -> Block:
        """Return the block with other names of parameters and memories, by its arguments.

        So one equation stands at several places of one effect, each time with values of its own.

        Example:
            ``curve.keyed({"low": "rate_low", "high": "rate_high"})``
        """
        params = {keys.get(name, name): param for name, param in self.params.items()}
        memory = {keys.get(name, name): it for name, it in self.memory.items()}
        arguments = {key: name for name, key in keys.items()}
        return replace(self, params=params, memory=memory, keys=arguments)

    @property
    def switches(self) -> tuple[str, ...]:
        """Names of the parameters that switch the effect on."""
        return tuple(name for name, param in self.params.items() if param.switch)


def check_name(name: str, what: str) -> None:
    """Refuse a name that cannot stand in the flat text; ``what`` names the thing in the error.

    Underscores at the ends and two in a row are kept for names made from the author's.

    Raises:
        ValueError: it is a Python keyword or not such a name.
    """
    if keyword.iskeyword(name):
        raise ValueError(f"{what} has the name of a Python keyword: give it another one")
    if not _PLAIN.fullmatch(name):
        raise ValueError(
            f"{what} has an unfit name: begin with a letter, go on with letters (a to z), digits"
            " and single underscores between them"
        )


def _parse(function: Function, name: str = "", **options: Any) -> Block:
    hints = typing.get_type_hints(function, include_extras=True)
    wires: list[str] = []
    metas: dict[str, Meta] = {}
    name = name or function.__name__
    for argument in inspect.signature(function).parameters:
        annotated = getattr(hints.get(argument), "__metadata__", ())
        meta = next((m for m in annotated if isinstance(m, Meta)), None)
        check_name(argument, f"argument '{argument}' of block '{name}'")
        if meta is None:
            wires.append(argument)
        else:
            metas[argument] = meta
    check_name(name, f"block '{name}'")
    for wire in options.get("gives", ()):
        check_name(wire, f"wire '{wire}' of block '{name}'")
    about = inspect.getdoc(function)
    if not about:
        raise ValueError(f"block '{name}' has no docstring: say what it does")
    return Block(
        function=function,
        name=name,
        wires=tuple(wires),
        params={n: m for n, m in metas.items() if isinstance(m, Param)},
        memory={n: m for n, m in metas.items() if isinstance(m, Memory)},
        queues={n: m for n, m in metas.items() if isinstance(m, Queue)},
        about=about,
        **options,
    )


def block(*gives: str, source: str = "") -> Callable[[Function], Block]:
    """Make a plant block; it defines the wires ``gives`` (default: one, named like itself).

    Raises:
        ValueError: a fault of the function, see the rules above; or a unit of ``"signal"``.

    Example:
        >>> from typing import Annotated
        >>> import servo_models as sm
        >>> Gain = Annotated[float, sm.Param("V/rad", "gain of the loop", default=20.0, high=200.0)]
        >>> @sm.block("voltage")
        ... def controller(command: float, angle: float, gain: Gain) -> float:
        ...     '''The drive voltage is proportional to the error of the angle.'''
        ...     return gain * (command - angle)
        >>> controller.wires, controller.gives
        (('command', 'angle'), ('voltage',))
    """

    def decorate(function: Function) -> Block:
        made = _parse(function, gives=gives or (function.__name__,), source=source)
        for name, param in made.params.items():
            if param.is_scaled:
                raise ValueError(
                    f"parameter '{name}' of block '{made.name}' has the unit '{param.unit}': only"
                    " an effect acts on a signal, give a unit of its own"
                )
        return made

    return decorate


def effect(
    *acts_on: str,
    source: str,
    name: str = "",
    parts: tuple[Block, ...] = (),
    hints: Hints | None = None,
) -> Callable[[Function], Block]:
    """Make an effect that rewrites the wires given for the arguments ``acts_on``.

    Args:
        acts_on: arguments whose wires it rewrites, the main one first; default ``"signal"``.
        source: paper, equation or book behind it.
        name: name of the effect; default that of the function.
        parts: other functions of an effect that acts at several places of a chain.
        hints: what else is known of it.

    Raises:
        ValueError: an effect without a switch parameter has no neutral value, or a hint is of what
            it has not.

    Example:
        >>> from typing import Annotated
        >>> import servo_models as sm
        >>> Offset = Annotated[float, sm.Param("signal", "offset", low=-0.1, high=0.1, switch=True)]
        >>> @sm.effect("signal", source="a data sheet")
        ... def offset(signal: float, value: Offset) -> float:
        ...     '''What is read is off by a constant.'''
        ...     return signal + value
        >>> offset.switches
        ('value',)
    """

    def decorate(function: Function) -> Block:
        made = _parse(
            function,
            name,
            acts_on=acts_on or (SIGNAL,),
            source=source,
            parts=parts,
            hints=hints or Hints(),
        )
        if not made.switches:
            raise ValueError(
                f"effect '{made.name}' has no switch parameter, so it is never neutral"
            )
        _check_hints(made, made.hints)
        params = {name: _searchable(param) for name, param in made.params.items()}
        return replace(made, params=params)

    return decorate


def _searchable(param: Param) -> Param:
    """A switch with a typical size: from 0 a diagnosis would find nothing, and say so."""
    return (
        replace(param, typical=TYPICAL * param.high)
        if param.switch and not param.typical
        else param
    )


def _check_hints(made: Block, hints: Hints) -> None:
    """Refuse hints of parameters, memories or groups that are not the effect's own."""
    params = {name for block in (made, *made.parts) for name in block.params}
    asked = {*hints.not_at_first, hints.jump, hints.phase, hints.count, hints.inertia} - {""}
    asked |= hints.named
    if hidden := hints.named & hints.not_at_first:
        raise ValueError(
            f"effect '{made.name}' says the size of '{min(hidden)}', which is"
            " never searched for: say that of another parameter"
        )
    memories = set[str]()
    if hints.small_signal:
        asked.add(hints.small_signal.time)
        memories = {hints.small_signal.input, hints.small_signal.output}
    for kind, absent in (("parameter", asked - params), ("memory", memories - {*made.memory})):
        if absent:
            raise ValueError(f"effect '{made.name}' has no {kind} '{min(absent)}' to hint at")
    if hints.signature not in typing.get_args(Signature):
        raise ValueError(f"effect '{made.name}': no signature '{hints.signature}' is known")
    if hints.ambiguity and made.name not in hints.ambiguity.group:
        raise ValueError(f"effect '{made.name}' is not in the group of its ambiguity")
