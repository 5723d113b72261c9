"""Check a description's logs before anything is fitted: what they are worth, and determine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from servo_models.core.plant import Plant
from servo_models.data.audit import Audit, audits, noise_floors
from servo_models.data.description import Description, read_description
from servo_models.data.log import Log
from servo_models.data.outliers import without_outliers
from servo_models.errors import UserError
from servo_models.identification.doubts import together
from servo_models.identification.identifiability import (
    SHOWN,
    Detectability,
    Identifiability,
    identifiability,
)
from servo_models.identification.plausibility import (
    implausible,
    implausible_clocks,
    likely,
    questions,
)
from servo_models.identification.problem import free_names
from servo_models.identification.resolution import Blur, blurs
from servo_models.identification.simulation import prepared
from servo_models.identification.starts import false_statements, with_starts
from servo_models.report.result import Result

WELL = 0.1  # expected standard error over a prior, or value, up to which logs determine it well
ROUGHLY = 0.8  # expected standard error up to which they determine it at all
NOTHING = 1e-6  # movement [noise floors] that is rounding of the simulation


@dataclass(frozen=True, eq=False, repr=False)
class Check(Result):
    """Audits of the logs of a description, noise floors [SI] and what the logs can determine.

    ``asked`` are the parameters that the description frees or gives an uncertainty;
    ``implausible`` says what makes no sense beside the actuator, one sentence each; where that is
    the time, nothing was simulated and ``identifiability`` is empty.  ``blurs`` are what the
    resolution of the inputs' columns may hide.  ``commanded`` is false where no log says what its
    inputs were, or how it was let go.
    """

    description: Description
    audits: tuple[Audit, ...]
    floors: dict[str, float]
    identifiability: Identifiability
    asked: tuple[str, ...]
    implausible: tuple[str, ...] = ()
    blurs: tuple[Blur, ...] = ()
    commanded: bool = True

    @property
    def plant(self) -> Plant:
        return self.description.model.plant

    @property
    def warnings(self) -> tuple[str, ...]:
        """What is serious, one sentence each."""
        said = list(self.implausible)
        said += [f"log '{a.log.name}': {text}" for a in self.audits for text in a.warnings]
        if not self.commanded and not said:
            said.append(
                "no column is an input, so nothing says what was commanded: name that of the"
                " command, or say how the log begins by 'start' if there was none"
            )
        free = free_names(self.plant, self.description.free)
        every = (*self.identifiability.parameters, *self.identifiability.effects)
        if every and all(reach.moves < NOTHING for reach in every):
            said.append(
                "the model does not move on these logs: check scale and offset of the inputs, and"
                " its parameters"
            )
            return tuple(said)
        for reach in self.identifiability.parameters:
            if reach.name in free and reach.together > ROUGHLY:
                words = verdict(reach, reach.name in self.description.uncertainty)
                said.append(f"'{reach.name}' is to be estimated, but: {words}")
        without_prior = [name for name in free if name not in self.description.uncertainty]
        for group in self.identifiability.together:
            if sum(name in without_prior for name in group) > 1:
                said.append(together(group, without_prior))
        return tuple(said)


def check(described: Description | str | Path, jobs: int | None = None) -> Check:
    """Audit the logs of a description, or of its TOML file, and find out what they can determine.

    Args:
        described: logs, model and uncertainties; or the path of its TOML file.
        jobs: simulations at once, by default the processors there are.

    Returns:
        audits, noise floors [SI] by output, and of every free parameter the standard error to
        expect; ``warnings`` says in sentences what is serious.

    Raises:
        UserError: see ``read_description``; there are no logs, every sample is held out, or the
            nominal model cannot be simulated on these logs.

    Example:
        >>> import servo_models as sm
        >>> found = sm.check("gimbal.toml")
        >>> round(found.floors["reading"], 4)  # rad
        0.0009
    """
    description = described if isinstance(described, Description) else read_description(described)
    if not description.logs:
        raise UserError(f"'{description.path}' describes no log: add [[logs]]")
    plant = description.model.plant
    commanded = any(log.inputs or not log.assumed for log in description.logs)
    clocks = implausible_clocks(description)
    false: dict[str, tuple[str, Log]] = {}
    if not clocks:
        try:
            false = false_statements(description.model, description.logs)
            seen = [without_outliers(log, plant) for log in description.logs]
            logs = with_starts(description.model, seen)
        except UserError as error:
            raise UserError("; ".join([str(error), *implausible(description)])) from error
        description = replace(description, logs=logs)
    audited = audits(description.logs, plant)
    floors = noise_floors(audited)
    free = free_names(plant, description.free)
    asked = tuple(dict.fromkeys([*free, *description.uncertainty]))
    if clocks:  # a simulation would be as long as the times are wrong
        return Check(
            description, audited, floors, Identifiability((), (), (), (), ()), asked, clocks
        )
    odd = (*(text for text, _ in false.values()), *implausible(description, columns=False))
    # a false start looks like a unit
    begun = tuple(false[log.name][1] if log.name in false else log for log in description.logs)
    as_shown = replace(description, logs=begun)
    audited = likely(as_shown, questions(as_shown))
    try:
        determined = identifiability(
            description.model, description.logs, floors, free, description.uncertainty, jobs
        )
    except UserError as error:
        raise UserError("; ".join([str(error), *odd])) from error
    runs = [prepared(description.model, log) for log in description.logs]
    beyond = [text for run in runs for text in run.notices({})]
    hidden = blurs(description.model, description.logs, floors, {})
    told = (*odd, *beyond)
    return Check(description, audited, floors, determined, asked, told, hidden, commanded)


def verdict(reach: Detectability, has_prior: bool) -> str:
    """Return in a few words how well the logs determine a parameter."""
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
