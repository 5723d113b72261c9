"""Small plants that put one effect on a bench: a signal, and a mass under a torque."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from servo_models.actuators.shaft import (
    external_load,
    free_shaft,
    no_second_mass,
    shaft_acceleration,
    shaft_contact,
    shaft_output,
)
from servo_models.core.block import Block, Param, block
from servo_models.core.compiled import plain_make
from servo_models.core.flat import neutral_effects
from servo_models.core.flatten import flatten
from servo_models.core.plant import Placement, Plant, State, Wire, place
from servo_models.core.stepper import step_text
from servo_models.core.types import Array


def step_constant(default: float) -> dict[str, Param]:
    """The constant every plant has."""
    return {"internal_step": Param("s", "longest internal step", default=default, high=1.0)}


def respond(
    plant: Plant, values: Mapping[str, float], times: ArrayLike, inputs: ArrayLike = 0.0
) -> dict[str, Array]:
    """Outputs at ``times`` in plain Python; ``inputs`` has the shape (n, inputs), or one for all.

    Raises:
        RuntimeError: the stepper returned a code.
    """
    flat = flatten(plant, "bench")
    unknown = set(values) - set(plant.parameters)
    assert not unknown, f"no such parameter: {unknown}"
    vector = [values.get(name, p.param.default) for name, p in plant.parameters.items()]
    start, step = plain_make(step_text(flat, neutral_effects(flat, vector)))(vector)
    grid = np.asarray(times, dtype=float)
    given = np.atleast_1d(np.asarray(inputs, dtype=float))
    given = given[:, None] if given.shape == grid.shape else given
    rows = np.broadcast_to(given, (len(grid), len(plant.inputs))).tolist()
    x, out = start(), []
    for row, time in enumerate(grid.tolist()):
        before = max(row - 1, 0)
        began = float(grid[before])
        code, values_now = step(x, rows[before], began, time - began)
        if code:
            raise RuntimeError(code)
        out.append(values_now)
    return dict(zip(plant.outputs, np.array(out).T))


@block("signal")
def held_signal(u: float) -> float:
    """The input as it is."""
    return u


@block("signal")
def sine_signal(sine: float) -> float:
    """The state of an oscillator, so that the signal moves between communication points."""
    return sine


@block("sine_rate", "cosine_rate")
def oscillator(
    sine: float, cosine: float, frequency: Annotated[float, Param("rad/s", "", default=1.0)]
) -> tuple[float, float]:
    """sin(frequency t) and cos(frequency t)."""
    return frequency * cosine, -frequency * sine


_SIGNAL = Wire("signal", "1", "signal under test")


def held_bench(effect: Block, *more: Placement, internal_step: float = 1e-3) -> Plant:
    """Input ``u``, held from point to point, through the effect; output ``signal``."""
    return Plant(
        inputs=(Wire("u", "1", "input"),),
        wires=(_SIGNAL,),
        chain=(held_signal, place("effect", effect, "signal"), *more),
        states=(),
        outputs=("signal",),
        constants=step_constant(internal_step),
    )


def sine_bench(effect: Block, internal_step: float = 1e-3) -> Plant:
    """sin(frequency t) through the effect; outputs ``signal`` and the clean ``sine``."""
    return Plant(
        inputs=(Wire("u", "1", "not used"),),
        wires=(_SIGNAL,),
        chain=(sine_signal, oscillator, place("effect", effect, "signal")),
        states=(
            State(Wire("sine", "1", "sine"), "sine_rate"),
            State(Wire("cosine", "1", "cosine"), "cosine_rate", start=1.0),
        ),
        outputs=("signal", "sine"),
        constants=step_constant(internal_step),
    )


@block("shaft_inertia", "full_speed", "angle_unit")
def mass(
    inertia: Annotated[float, Param("kg.m2", "inertia", default=1.0, high=10.0)],
) -> tuple[float, float, float]:
    """The inertia; friction parameters call 10 rad/s full speed; the angle is in radians."""
    return inertia, 10.0, 1.0


@block("torque")
def net_torque(
    motor_torque: float,
    load: float,
    shaft_angle: float,
    spring: Annotated[float, Param("N.m/rad", "spring to angle 0", high=1e3)],
) -> float:
    """Torque that accelerates the mass."""
    return motor_torque - load - spring * shaft_angle


@block("shaft_rate")
def shaft_motion(shaft_speed: float) -> float:
    """Rate of the shaft."""
    return shaft_speed


def shaft_bench(
    *effects: Placement,
    step: float = 1e-3,
    angle: float = 0.0,
    speed: float = 0.0,
    load_speed: float = 0.0,
) -> Plant:
    """A mass on a spring under ``motor_torque`` and ``load_torque``.

    An effect goes where its first wire is known: inertia, step and travel first, then the
    output, then the load, then friction.
    """

    def on(*wires: str) -> tuple[Placement, ...]:
        return tuple(effect for effect in effects if effect.on[0] in wires)

    return Plant(
        inputs=(Wire("motor_torque", "N.m", "torque"), Wire("load_torque", "N.m", "load")),
        wires=(
            Wire("angle", "rad", "output"),
            Wire("rate", "rad/s", "rate of the output"),
            Wire("friction", "N.m", "dry friction"),
            Wire("load", "N.m", "load"),
            Wire("shaft_inertia", "kg.m2", "inertia"),
            Wire("travel", "rad", "half range"),
        ),
        chain=(
            mass,
            free_shaft,
            no_second_mass,
            *on("shaft_inertia", "internal_step", "travel"),
            shaft_motion,
            shaft_output,
            *on("angle"),
            external_load,
            *on("load"),
            *on("friction"),
            net_torque,
            shaft_acceleration,
        ),
        states=(
            State(Wire("shaft_angle", "rad", "angle"), "shaft_rate", start=angle),
            State(Wire("shaft_speed", "rad/s", "speed"), "acceleration", start=speed),
            State(Wire("load_angle", "rad", "far angle"), "load_rate", owner="gear_compliance"),
            State(
                Wire("load_speed", "rad/s", "far speed"),
                "load_acceleration",
                start=load_speed,
                owner="gear_compliance",
            ),
        ),
        projection=shaft_contact,
        outputs=("shaft_angle", "shaft_speed", "angle", "rate"),
        constants=step_constant(step),
    )
