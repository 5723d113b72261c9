"""A simulator's form of an actuator: native fields, their law, and the effects that it holds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numba

from servo_models.core.types import Array

EXACT, APPROXIMATE, LOST = "exact", "approximate", "lost"  # levels of how a law has an effect
DELAY = "delay"  # field that counts time steps


class Held(NamedTuple):
    """How well a law holds an effect, and by what."""

    degree: str
    how: str


NO_FIELD = Held(LOST, "no field for it")
ONE_BODY = Held(LOST, "joint and output are one body")
BY_BODIES = Held(EXACT, "by your bodies")
OF_JOINTS: Mapping[str, Held] = {
    "backlash": ONE_BODY,
    "coasting_backlash": ONE_BODY,
    "gear_compliance": ONE_BODY,
    "constant_load": BY_BODIES,
    "gravity_load": BY_BODIES,
    "load_inertia": Held(EXACT, "armature, or your bodies"),
    "end_stops": Held(APPROXIMATE, "by the range of your joint"),
    "load_friction": Held(LOST, "friction does not follow the load"),
}
"""Effects that every simulator holds alike that drives a joint by a torque."""


@dataclass(frozen=True)
class Field:
    """A native parameter, fitted between ``low`` and ``high``; 0 is for none where ``optional``."""

    name: str
    unit: str
    about: str
    low: float
    high: float
    optional: bool = True


class Motion(NamedTuple):
    """A guess of how an actuator moves, from which a fit begins.

    Frequency [rad/s] and damping ratio of a second order, largest speed [rad/s], inertia [kg m^2],
    delay [time steps].
    """

    frequency: float
    ratio: float
    speed: float
    inertia: float
    delay: float


Fields = tuple[float, ...]  # the value of every field, in its order
Law = Callable[[Fields, float, Array, Array, float, float], Array]
"""Angle [rad] at each time step, shape (n,), of: fields; time step [s]; goal, already delayed,
[rad] and load torque against positive motion [N m] at each step, shape (n,); inertia [kg m^2];
angle [rad] at which it begins, at rest.  It is plain Python that numba compiles.
"""


@dataclass(frozen=True)
class Nominal:
    """What a simulator's file says of one actuator: values [SI] of our parameters, by name.

    Attributes:
        values: values with their origins in words.
        command: unit of the command, ``"rad"`` or ``"s"`` for pulses: it chooses the variant.
        warnings: in words, differences from our model.
        variant: what it is of; the variant of this name gives what the file does not say.
    """

    values: Mapping[str, tuple[float, str]]
    command: str = "rad"
    warnings: tuple[str, ...] = ()
    variant: str = ""


@dataclass(frozen=True)
class Reader:
    """Reads the files of a simulator, or of an identification.

    Attributes:
        title: its own name.
        suffixes: ends of names of its files.
        mark: text by which they differ from other files with these suffixes.
        read: bytes of such a file, which joint ("" for the only one) and the inertia [kg m^2] that
            the joint carries beside what the file says; what lacks in it is a UserError.
    """

    title: str
    suffixes: tuple[str, ...]
    mark: bytes
    read: Callable[[bytes, str, float], Nominal]


@dataclass(frozen=True)
class Simulator:
    """A simulator.

    Attributes:
        title: its own name.
        step: its default time step [s].
        fields: the native parameters that are fitted.
        law: its documented law, written down independently of its code.
        starts: fields from which a fit begins, for a guess of the motion.
        holds: by effect, or by the name of an effect's place, which takes precedence.
        lines: fields, time step [s] and inertia [kg m^2] as text to paste.
        loaded: whether the law takes the load; else the angle is the same under any.
        taken: fields that are not fitted, as they are parameters of ours, by field.
    """

    title: str
    step: float
    fields: Sequence[Field]
    law: Law
    starts: Callable[[Motion], list[dict[str, float]]]
    holds: Mapping[str, Held]
    lines: Callable[[Mapping[str, float], float, float], str]
    loaded: bool = True
    taken: Mapping[str, str] = field(default_factory=dict)

    @cached_property
    def _compiled(self) -> Law:
        compile_it: Callable[[Law], Law] = numba.njit
        return compile_it(self.law)

    def angles(
        self, values: Mapping[str, float], step: float, goal: Array, load: Array, *rest: float
    ) -> Array:
        """Return the angles [rad] of the law, whose arguments they are, for fields by name."""
        fields = tuple(float(values[it.name]) for it in self.fields)
        return self._compiled(fields, step, goal, load, *rest)

    def held(self, place: str, effect: str, values: Mapping[str, float] | None = None) -> Held:
        """Return how well the law holds an effect at a place.

        It names its fields: with these ``values`` they may have been left out, as of little use.
        """
        held = self.holds.get(place, self.holds.get(effect, NO_FIELD))
        named = [it.name for it in self.fields if it.name in held.how.lower()]
        if values and named and not any(values[name] for name in named):
            return Held(LOST, f"{' and '.join(named)} left out: no better with it")
        return held
