"""Check a description's logs before anything is fitted, and say in words what they are worth."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from servo_models.analysis.explain import display_unit, in_display_unit
from servo_models.core.plant import Parameter, Plant, Wire
from servo_models.data.audit import Audit, Floor, Sampling, audits, noise_floors
from servo_models.data.description import Description, read_description
from servo_models.errors import UserError
from servo_models.identification.identifiability import SHOWN, Excitation, Group, Reach, excitation
from servo_models.identification.plausibility import implausible, implausible_clocks
from servo_models.identification.problem import free_names
from servo_models.identification.uncertainty import together
from servo_models.report.sheets import Sheet, Table
from servo_models.units import factor

WELL, ROUGHLY = 0.1, 0.8
"""Expected standard error over the size of a parameter, its prior or value, up to which logs
determine it well, or at all."""
EFFECTS = "Effects, each at its typical size, beside a model that is right"
OWN_CLOCK = 1.5
"""Steps from which on a command is held for longer than a sample."""
EVEN = 1e-4
"""Share of a step up to which its jitter is rounding."""
NOTHING = 1e-6
"""Movement in noise floors that is rounding of the simulation."""


@dataclass(frozen=True, eq=False)
class Check:
    """Audits of the logs of a description, noise floors [SI] and what the logs can determine.

    ``asked`` are the parameters that the description frees or gives an uncertainty;
    ``implausible`` says what makes no sense beside the actuator, one sentence each; where that is
    the time, nothing was simulated and ``excitation`` is empty.
    """

    description: Description
    audits: tuple[Audit, ...]
    floors: dict[str, float]
    excitation: Excitation
    asked: tuple[str, ...]
    implausible: tuple[str, ...] = ()

    @property
    def plant(self) -> Plant:
        return self.description.model.plant

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is serious, one sentence each."""
        said = list(self.implausible)
        said += [f"log '{a.log.name}': {text}" for a in self.audits for text in a.warnings]
        free = free_names(self.plant, self.description.free)
        every = (*self.excitation.parameters, *self.excitation.effects)
        if every and all(reach.moves < NOTHING for reach in every):
            said.append(
                "the model does not move on these logs: check scale and offset of the inputs, and"
                " its parameters"
            )
            return tuple(said)
        for reach in self.excitation.parameters:
            if reach.name in free and reach.together > ROUGHLY:
                verdict = _verdict(reach, reach.name in self.description.uncertainty)
                said.append(f"'{reach.name}' is to be estimated, but: {verdict}")
        own = [name for name in free if name not in self.description.uncertainty]
        for group in self.excitation.together:
            if sum(name in own for name in group) > 1:
                said.append(together(group, own))
        return tuple(said)


def check(described: Description | str | Path, jobs: int | None = None) -> Check:
    """Audit the logs of a description, or of its TOML file, and find out what they can determine.

    Raises:
        UserError: see ``read_description``; there are no logs, every sample is held out, or the
            nominal model cannot be simulated on these logs.
    """
    description = described if isinstance(described, Description) else read_description(described)
    if not description.logs:
        raise UserError(f"'{description.path}' describes no log: add [[logs]]")
    plant = description.model.plant
    audited = audits(description.logs, plant)
    floors = noise_floors(audited)
    free = free_names(plant, description.free)
    asked = tuple(dict.fromkeys([*free, *description.uncertainty]))
    clocks = implausible_clocks(description)
    if clocks:  # a simulation would be as long as the times are wrong
        return Check(description, audited, floors, Excitation((), (), (), (), ()), asked, clocks)
    odd = implausible(description)
    try:
        found = excitation(
            description.model, description.logs, floors, free, description.uncertainty, jobs
        )
    except UserError as error:
        raise UserError("; ".join([str(error), *odd])) from error
    return Check(description, audited, floors, found, asked, odd)


def check_sheet(found: Check) -> Sheet:
    """Return a check as a sheet, in the units that a person reads."""
    effects = [Table(EFFECTS, ("", ""), tuple(_effects(found)))] if found.excitation.effects else []
    logs = [table for each in found.audits for table in _log_tables(each, found.plant)]
    told = found.description
    return Sheet(
        f"{told.path}: {told.actuator.name}, variant {told.variant}",
        tuple(f"Warning: {text}." for text in found.warnings),
        (*logs, *_parameter_tables(found), *effects),
    )


def _log_tables(found: Audit, plant: Plant) -> Iterator[Table]:
    clock = found.sampling
    heading = f"Log '{found.log.name}': {_clock(clock)}; at rest in {found.at_rest:.0%} of them"
    inputs = tuple(
        (
            command.name,
            _in(command.low, plant.wire[command.name]),
            _in(command.high, plant.wire[command.name]),
            _unit(plant.wire[command.name]),
            str(command.levels),
            str(command.reversals),
            _held(command.clock, clock.step),
            "none" if command.band is None else "{:.2g} to {:.3g} Hz".format(*command.band),
        )
        for command in found.commands
    )
    columns = ("input", "from", "to", "unit", "levels", "reversals", "clock", "band it excites")
    yield Table(heading, columns, inputs)
    outputs = tuple(
        (
            reading.name,
            _in(reading.low, plant.wire[reading.name]),
            _in(reading.high, plant.wire[reading.name]),
            _unit(plant.wire[reading.name]),
            _in(reading.step, plant.wire[reading.name]) if reading.step else "none",
            *_floor(reading.floor, plant.wire[reading.name]),
        )
        for reading in found.readings
    )
    heads = ("output", "from", "to", "unit", "step", "noise floor", "origin of the floor")
    yield Table("Readings, with the noise floor as three methods see it", heads, outputs)


def _clock(clock: Sampling) -> str:
    every = f"{clock.samples} samples in {clock.duration:.4g} s"
    rate = f"{_short_time(clock.step)} apart ({1.0 / clock.step:.4g} Hz)"
    stamps = f", time stamps to {_short_time(clock.stamp)}" if clock.stamp else ""
    gaps = f"{len(clock.gaps)} gaps" if clock.gaps else "no gaps"
    jitter = f"jitter {_short_time(clock.jitter)}" if clock.jitter > EVEN * clock.step else "even"
    return f"{every}, {rate}, {jitter}{stamps}, {gaps}"


def _short_time(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds > 0.9995 * size:
            return f"{seconds / size:.4g} {unit}"
    return f"{seconds / 1e-6:.2g} us"


def _held(clock: float | None, step: float) -> str:
    """The clock of a command, where it is another than that of the log."""
    return f"{clock:.4g} s" if clock and clock > OWN_CLOCK * step else ""


def _unit(wire: Wire) -> str:
    unit = wire.display or wire.unit
    return "" if unit == "1" else unit


def _in(value: float, wire: Wire) -> str:
    """A value of a wire [SI] as a person reads it, without its unit."""
    return f"{value * factor(wire.unit, wire.display or wire.unit):.4g}"


def _floor(floor: Floor, wire: Wire) -> tuple[str, str]:
    """The floor, and what each method saw; the one that counts stands first."""
    if not floor.value:
        return "0", "neither steps nor noise seen"
    parts = sorted(floor.parts.items(), key=lambda part: -part[1])
    rest = ", ".join(f"{name} {_in(size, wire)}" for name, size in parts[1:] if size)
    return _in(floor.value, wire), floor.origin + (f" ({rest})" if rest else "")


def _parameter_tables(found: Check) -> Iterator[Table]:
    """What the description asks for; all that the logs show where it asks for nothing."""
    parameters = found.plant.parameters
    priors = found.description.uncertainty
    rows = tuple(
        (
            reach.name,
            in_display_unit(reach.sizes[reach.name], parameters[reach.name]),
            _short(reach.alone * reach.scale, parameters[reach.name]),
            _short(reach.together * reach.scale, parameters[reach.name]),
            display_unit(parameters[reach.name]),
            _verdict(reach, reach.name in priors),
        )
        for reach in found.excitation.parameters
        if found.asked or reach.shown
    )
    if not rows:
        return
    heading = "Parameters, with the least standard error to expect: white noise, a right model"
    yield Table(heading, ("parameter", "value", "alone", "together", "unit", ""), rows)


def _short(size: float, parameter: Parameter) -> str:
    return f"{float(in_display_unit(size, parameter)):.2g}"


def _verdict(reach: Reach, has_prior: bool) -> str:
    if reach.moves < NOTHING:
        return "nothing measured depends on it"
    if reach.moves < SHOWN:
        size = "one prior deviation" if has_prior else "all of it"
        return f"hidden: {size} moves '{reach.output}' by {reach.moves:.1g} noise floors"
    if reach.together <= WELL:
        return "determined"
    if reach.together <= ROUGHLY:
        return "roughly determined"
    if has_prior:
        return "known from its prior only"
    if reach.alone <= ROUGHLY:
        return "not determined beside the other free parameters"
    return "not determined"


def _effects(found: Check) -> Iterator[tuple[str, str]]:
    """What the logs show, hide, and confuse, in words."""
    effects = found.excitation.effects
    still = [r.name for r in effects if r.moves < NOTHING]
    hidden = [r for r in effects if r.moves >= NOTHING and not r.shown and not r.absorbed]
    yield "can be shown", _names(r.name for r in effects if r.shown)
    yield "cannot be shown", "; ".join(_hidden(found, r) for r in hidden) or "-"
    yield "imitated by free parameters", _names(r.name for r in effects if r.absorbed)
    yield "change no measured output", _names(still)
    if found.excitation.refused:
        yield "cannot be simulated", _names(found.excitation.refused)
    for names in found.excitation.together:
        yield "show only together", _names(names)
    for group in found.excitation.groups:
        yield "look alike", _alike(group, found.plant)


def _names(names: Iterable[str]) -> str:
    return ", ".join(names) or "-"


def _hidden(found: Check, reach: Reach) -> str:
    parameters = found.plant.parameters
    sizes = " and ".join(
        f"{_short(size, parameters[name])} {display_unit(parameters[name])}".strip()
        for name, size in reach.sizes.items()
    )
    cause = sizes if any(reach.sizes.values()) else "leaving it out"
    return f"{reach.name} ({cause} moves '{reach.output}' by {reach.moves:.1g} noise floors)"


def _alike(group: Group, plant: Plant) -> str:
    cures = list(group.experiments)
    if all(name in plant.parameters for name in group.names):
        cures = ["fix one of them", *(cures if len(group.names) == 2 else [])]
    return f"{_names(group.names)}: {'; or '.join(cures or ['keep one of them'])}"
