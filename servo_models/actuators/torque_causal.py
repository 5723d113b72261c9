"""The torque-causal form of an actuator, for physics engines: angle and rate in, torque out.

MuJoCo, Gazebo and Bullet own the joint: its inertia, its constraints, its loads.  Derived from the
same declaration, so no equation stands twice:

==========================  ==================================================================
angle and speed of the      states become inputs; they are the joint's position and velocity
shaft
law of motion, contact      dropped: the engine integrates, and its solver holds a joint that
                            sticks or rests on a stop, exactly as no torque can
``torque``                  output: electrical torque less drag, springs and cogging, for the joint
``friction``                output: dry friction level, for the engine's friction loss
``shaft_inertia``           output: geared rotor, for the joint's armature
``travel``                  output: half of the joint's range, 0 for none
load, load inertia,         dropped: the engine's bodies and forces are the load
gravity, load friction
gear compliance             dropped: its second mass is a second joint of the engine
backlash                    stays: it is in the reading of the loop, and carries no inertia
==========================  ==================================================================
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from servo_models.actuators.shaft import driven_shaft, shaft_acceleration, unloaded
from servo_models.core.block import Block
from servo_models.core.plant import Actuator, Placement, Plant, State, Variant, Wire
from servo_models.effects.constant_load import constant_load
from servo_models.effects.gear_compliance import compliant_load, compliant_output, resonance_step
from servo_models.effects.gravity_load import gravity_load
from servo_models.effects.load_friction import load_friction
from servo_models.effects.load_inertia import load_inertia
from servo_models.errors import UserError

OF_THE_ENGINE = (
    load_inertia,
    constant_load,
    gravity_load,
    load_friction,  # grows with a load that only the engine knows
    compliant_load,
    compliant_output,
    resonance_step,
)
OUTPUTS = ("torque", "impulse", "friction", "shaft_inertia", "travel")
UNIT_OF_ANGLE = "angle_unit"


def torque_causal(actuator: Actuator) -> Actuator:
    """Return the torque-causal form of an actuator, called ``<name>_torque``.

    It has the variants that make sense of it: with a shaft whose speed is the rate of its output,
    and with nothing that belongs to the engine.

    Raises:
        UserError: there is no such variant.

    Example:
        >>> import servo_models as sm
        >>> servo = sm.torque_causal(sm.actuator("sg90"))
        >>> sm.simulate(sm.model(servo), [0.0, 0.1], {"shaft_angle": 0.1})["torque"].shape
        (2,)
    """
    variants = tuple(_variants(actuator))
    if not variants:
        raise UserError(
            f"actuator '{actuator.name}' has no torque-causal form: its chain needs the blocks of"
            " servo_models/actuators/shaft.py, and a variant without loads"
        )
    return replace(
        actuator,
        name=f"{actuator.name}_torque",
        title=f"{actuator.title}, torque-causal" if actuator.title else "",
        about=f"For physics engines: angle and rate in, torque out. {actuator.about}".strip(),
        plant=_plant(actuator.plant),
        variants=variants,
        grey_box=None,
        file=None,
    )


def _plant(plant: Plant) -> Plant:
    kept = [_for_engine(link) for link in plant.chain if not _is_of_the_engine(link)]
    read = {wire for link in kept for wire in _reads(link)}
    joint = _joint(plant)
    torque = replace(plant.wire["friction"], name="torque", about="for the joint, friction apart")
    momentum = plant.wire["shaft_inertia"].scale * plant.wire["shaft_speed"].scale
    impulse = Wire("impulse", f"{torque.unit}.s", "integral of the torque", momentum)
    return replace(
        plant,
        inputs=(*(wire for wire in plant.inputs if wire.name in read), *joint),
        wires=(*plant.wires, torque),
        chain=(driven_shaft, *kept),
        states=(
            *(
                state
                for state in plant.states
                if state.name not in driven_shaft.gives and state.owner != compliant_output.name
            ),
            State(impulse, rate="torque"),
        ),
        projection=None,
        outputs=(*OUTPUTS, *plant.outputs),
        terminals={**plant.terminals, "shaft": (*(wire.name for wire in joint), "torque")},
    )


def _joint(plant: Plant) -> tuple[Wire, Wire, Wire]:
    """The inputs by which an engine tells the motion of the joint."""
    shaft = {state.name: state for state in plant.states}
    angle, speed = (shaft[name] for name in driven_shaft.gives)
    position = replace(angle.wire, name="joint_position", rest=angle.start)
    velocity = replace(speed.wire, name="joint_velocity", rest=speed.start)
    full = plant.wire["friction"].scale / plant.wire["shaft_inertia"].scale
    about = "of the engine's last step; 0: not told"
    return position, velocity, Wire("joint_acceleration", f"{velocity.unit}2", about, full)


def _is_of_the_engine(link: Block | Placement) -> bool:
    return link == shaft_acceleration or (
        isinstance(link, Placement) and link.effect in OF_THE_ENGINE
    )


def _for_engine(link: Block | Placement) -> Block | Placement:
    """A block as it is, but no load from outside, and a shaft that turns as its output does."""
    if isinstance(link, Placement):
        return link
    if link.gives == unloaded.gives:
        return unloaded
    if UNIT_OF_ANGLE in link.params:
        only_one = replace(link.params[UNIT_OF_ANGLE], default=1.0, low=1.0, high=1.0)
        return replace(link, params={**link.params, UNIT_OF_ANGLE: only_one})
    return link


def _reads(link: Block | Placement) -> Iterator[str]:
    if isinstance(link, Placement):
        return (link.wire_of(argument) for argument in link.effect.wires)
    return iter(link.wires)


def _variants(actuator: Actuator) -> Iterator[Variant]:
    for variant in actuator.variants:
        plant = actuator.plant_of(variant.name)
        if shaft_acceleration not in plant.chain:
            continue
        known = _plant(plant).parameters
        values = actuator.values(variant.name)
        lost = [p for name, p in plant.parameters.items() if name not in known]
        on = any(p.param.switch and values[p.name] != 0.0 for p in lost)
        if not on and values.get(UNIT_OF_ANGLE, 1.0) == 1.0:
            yield replace(
                variant,
                values={name: it for name, it in variant.values.items() if name in known},
                uncertainty={n: it for n, it in variant.uncertainty.items() if n in known},
                plant=variant.plant and _plant(variant.plant),
            )
