"""The torque-causal form of an actuator, for physics engines: angle and rate in, torque out.

MuJoCo, Gazebo and Bullet simulate the joint: its inertia, constraints and loads.  Who has what:

=============================  ===============================================================
angle and speed of the shaft   inputs, from the joint's position, velocity and acceleration
law of motion, contact         dropped: the engine integrates, and its solver holds a joint that
                               sticks or rests on a stop, as no torque can
``torque``, ``impulse``        outputs: of motor, springs, drag and cogging; its integral
``friction``                   output: dry friction level, for the joint's friction loss
``shaft_inertia``              output: geared rotor, for the joint's armature
``travel``                     output: half of the joint's range, 0 for none
load inertia, constant load,   dropped: the engine's bodies and forces are the load; friction
gravity, load friction,        that grows with it is the engine's too
scale of the load's input,
residual map of the load
gear compliance                dropped: its second mass is a second joint of the engine
backlash                       stays: it is in the reading of the loop and carries no inertia
=============================  ===============================================================

Everything is derived from the plant, so no equation stands twice.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Set
from dataclasses import replace

from servo_models.actuators.shaft import driven_shaft, shaft_acceleration, unloaded
from servo_models.core.block import Block
from servo_models.core.plant import Actuator, Placement, Plant, State, Variant, Wire
from servo_models.effects.constant_load import constant_load
from servo_models.effects.gear_compliance import compliant_load, compliant_output, resonance_step
from servo_models.effects.gravity_load import gravity_load
from servo_models.effects.load_friction import load_friction
from servo_models.effects.load_inertia import load_inertia
from servo_models.effects.residual_map import CURVES
from servo_models.errors import UserError

OF_THE_ENGINE = (
    load_inertia,
    constant_load,
    gravity_load,
    load_friction,
    compliant_load,
    compliant_output,
    resonance_step,
    CURVES["load"],
)
FOR_THE_JOINT = {"friction": "friction loss", "shaft_inertia": "armature", "travel": "half range"}
UNIT_OF_ANGLE = "angle_unit"  # angle of the output over that of the shaft: 1 for an engine's joint


def torque_causal(actuator: Actuator) -> Actuator:
    """Return the torque-causal form of an actuator, called ``<name>_torque``.

    Those of the catalogue can be had by that name.  It has the variants in which nothing is on that
    belongs to the engine, and in which the shaft turns as the output does.

    Args:
        actuator: with the blocks of ``servo_models/actuators/shaft.py`` in its chain.

    Raises:
        UserError: it has no such variant.

    Example:
        >>> import servo_models as sm
        >>> servo = sm.torque_causal(sm.actuator("sg90"))
        >>> stalled = sm.simulate(sm.model(servo), [0.0, 0.1], {"pulse_width": 2e-3})
        >>> print(f"{stalled['torque'][-1]:.3f} N m at 5 V, the joint held")
        0.184 N m at 5 V, the joint held
    """
    variants = tuple(_variants(actuator))
    if not variants:
        raise UserError(
            f"actuator '{actuator.name}' has no torque-causal form: it needs the blocks of"
            " servo_models/actuators/shaft.py in its chain, and a variant without load"
        )
    return replace(
        actuator,
        name=f"{actuator.name}_torque",
        title=f"{actuator.title or actuator.name}, torque-causal",
        about=f"For physics engines: angle and rate in, torque out. {actuator.about}",
        plant=variants[0].plant or actuator.plant,
        variants=variants,
        grey_box=None,
        file=None,
    )


def _variants(actuator: Actuator) -> Iterator[Variant]:
    for variant in actuator.variants:
        plant = actuator.plant_of(variant.name)
        if shaft_acceleration not in plant.chain:
            continue
        form = _plant(plant)
        known = form.parameters
        values = actuator.values(variant.name)
        dropped = [p for name, p in plant.parameters.items() if name not in known]
        loaded = any(p.param.switch and values[p.name] != 0.0 for p in dropped)
        if not loaded and values.get(UNIT_OF_ANGLE, 1.0) == 1.0:
            yield replace(
                variant,
                values={name: value for name, value in variant.values.items() if name in known},
                uncertainty={n: value for n, value in variant.uncertainty.items() if n in known},
                plant=form,
                checked={},
            )


@functools.lru_cache(maxsize=64)  # variants of one plant share its form
def _plant(plant: Plant) -> Plant:
    loads = {wire for link in plant.chain if _is_external_load(link) for wire in _reads(link)}
    kept = [_for_engine(link) for link in plant.chain if not _is_of_the_engine(link, loads)]
    read = {wire for link in kept for wire in _reads(link)}
    joint = _joint(plant)
    shaft = [state.wire for state in plant.states if state.name in driven_shaft.gives]
    torque = replace(plant.wire["friction"], name="torque", about="for the joint, friction apart")
    momentum = plant.wire["shaft_inertia"].scale * plant.wire["shaft_speed"].scale
    impulse = Wire("impulse", f"{torque.unit}.s", "integral of the torque", momentum)
    states = [
        state
        for state in plant.states
        if state.name not in driven_shaft.gives and state.owner != compliant_output.name
    ]
    return replace(
        plant,
        inputs=(*(wire for wire in plant.inputs if wire.name in read), *joint),
        wires=(*(_named_for_the_joint(wire) for wire in plant.wires), *shaft, torque),
        chain=(driven_shaft, *kept),
        states=(*states, State(impulse, rate="torque")),
        projection=None,
        outputs=("torque", "impulse", *FOR_THE_JOINT, *plant.outputs),
        terminals={**plant.terminals, "shaft": (*(wire.name for wire in joint), "torque")},
    )


def _is_external_load(link: Block | Placement) -> bool:
    return isinstance(link, Block) and link.gives == unloaded.gives


def _is_of_the_engine(link: Block | Placement, loads: Set[str]) -> bool:
    """Whether a link is the engine's: its effects, the law of motion, effects on ``loads``."""
    if isinstance(link, Placement):
        return link.effect in OF_THE_ENGINE or not loads.isdisjoint(link.on)
    return link == shaft_acceleration


def _for_engine(link: Block | Placement) -> Block | Placement:
    """Return a block as it is, but without a load from outside and with 1 as the unit of angle."""
    if isinstance(link, Placement):
        return link
    if _is_external_load(link):
        return unloaded
    if UNIT_OF_ANGLE in link.params:
        only_one = replace(link.params[UNIT_OF_ANGLE], default=1.0, low=1.0, high=1.0)
        return replace(link, params={**link.params, UNIT_OF_ANGLE: only_one})
    return link


def _reads(link: Block | Placement) -> Iterator[str]:
    if isinstance(link, Placement):
        return (link.wire_of(argument) for argument in link.effect.wires)
    return iter(link.wires)


def _joint(plant: Plant) -> tuple[Wire, Wire, Wire]:
    """Return the inputs by which an engine tells the motion of the joint."""
    shaft = {state.name: state for state in plant.states}
    angle, speed = (shaft[name] for name in driven_shaft.gives)
    full = plant.wire["friction"].scale / plant.wire["shaft_inertia"].scale
    return (
        _moves(angle, "position"),
        _moves(speed, "velocity"),
        Wire("joint_acceleration", f"{speed.wire.unit}2", "last known, 0 for none", full),
    )


def _moves(state: State, what: str) -> Wire:
    return replace(state.wire, name=f"joint_{what}", about=f"{what} of the joint", rest=state.start)


def _named_for_the_joint(wire: Wire) -> Wire:
    if wire.name not in FOR_THE_JOINT:
        return wire
    return replace(wire, about=f"{wire.about}: the joint's {FOR_THE_JOINT[wire.name]}")
