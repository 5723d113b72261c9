"""Isaac Lab: a joint driven by DelayedPDActuatorCfg, the PD law computed once a physics step.

    effort = clip(stiffness (goal, max_delay steps ago, - q) - damping v, effort_limit)
    v = v + h (effort - load) / inertia, towards 0 by at most h friction / inertia,
    within velocity_limit_sim;  q += h v

Source: Isaac Lab, isaaclab.actuators actuator_pd.py (DelayedPDActuator, IdealPDActuator),
actuator_base_cfg.py, utils/buffers/delay_buffer.py; PhysX 5, Articulation Joint Friction, 2025.
``effort_limit`` is called ``actuator_effort_limit``, and ``velocity_limit_sim``
``joint_velocity_limit``, from Isaac Lab 3 on, which takes the old names until 4.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator, Mapping
from fnmatch import fnmatchcase

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.simulators.reading import FASTEST, LARGEST, TRANSPORT_DELAY, chosen, servo
from servo_models.simulators.simulator import (
    APPROXIMATE,
    DELAY,
    EXACT,
    LOST,
    OF_JOINTS,
    Field,
    Fields,
    Held,
    Motion,
    Nominal,
    Reader,
    Simulator,
)

FIELDS = (
    Field("stiffness", "N.m/rad", "position gain", 1e-6, 1e6, optional=False),
    Field("damping", "N.m.s/rad", "velocity gain, within effort_limit", 1e-9, 1e4),
    Field("effort_limit", "N.m", "largest torque", 1e-6, 1e5),
    Field("velocity_limit_sim", "rad/s", "largest speed of the joint", 1e-3, 1e4),
    Field("friction", "N.m", "dry friction", 1e-7, 1e4),
    Field(DELAY, "steps", "delay of the command", 0.0, 1000.0),
)


def law(
    fields: Fields, step: float, goal: Array, load: Array, inertia: float, start: float
) -> Array:
    """The angle of the joint, see ``simulator.Law``."""
    stiffness, damping, effort_limit, velocity_limit, friction, _ = fields
    angles = np.empty(len(goal))
    angle, rate = start, 0.0
    for k in range(len(goal)):
        angles[k] = angle
        effort = stiffness * (goal[k] - angle) - damping * rate
        if 0.0 < effort_limit < abs(effort):
            effort = math.copysign(effort_limit, effort)
        rate += step * (effort - load[k]) / inertia
        rate = math.copysign(max(abs(rate) - step * friction / inertia, 0.0), rate)
        if 0.0 < velocity_limit < abs(rate):
            rate = math.copysign(velocity_limit, rate)
        angle += step * rate
    return angles


def starts(motion: Motion) -> list[dict[str, float]]:
    """One start: the speed is limited by the solver, the effort by twice what reaches it."""
    damping = 2.0 * motion.ratio * motion.frequency * motion.inertia
    effort = 2.0 * damping * motion.speed
    return [
        {
            "stiffness": motion.inertia * motion.frequency**2,
            "damping": damping,
            "effort_limit": effort,
            "velocity_limit_sim": motion.speed,
            "friction": 0.01 * effort,
            DELAY: motion.delay,
        }
    ]


HOLDS: Mapping[str, Held] = {
    **OF_JOINTS,
    "transport_delay": Held(EXACT, "min_delay and max_delay, in whole physics steps"),
    "coulomb_friction": Held(EXACT, "friction"),
    "viscous_friction": Held(APPROXIMATE, "damping, which effort_limit clips with the rest"),
    "presliding_friction": Held(APPROXIMATE, "friction, which holds still"),
    "stribeck_friction": Held(APPROXIMATE, "friction, one for rest and motion"),
    "supply_limit": Held(APPROXIMATE, "effort_limit, which does not fall with speed"),
    "saturation": Held(APPROXIMATE, "effort_limit, which does not fall with speed"),
    "torque_saturation": Held(EXACT, "effort_limit"),
    "rate_limit": Held(APPROXIMATE, "velocity_limit_sim, which limits the joint, not its command"),
    "motion_profile": Held(APPROXIMATE, "velocity_limit_sim, without the ramps"),
    "sample_hold": Held(LOST, "unless decimation holds the action as long"),
}


NO_LIMIT = 1e9  # limit [N m or rad/s] that is none
LIMITS = ("effort_limit", "velocity_limit_sim")
"""Fields that the USD file gives unless the configuration says that there is no limit."""


def lines(values: Mapping[str, float], step: float, inertia: float) -> str:
    """The configuration of a group of one joint."""
    told = {it.name: values[it.name] for it in FIELDS if it.name != DELAY}
    told |= {name: values[name] or NO_LIMIT for name in LIMITS}
    told |= {"armature": inertia, "min_delay": values[DELAY], "max_delay": values[DELAY]}
    inner = "".join(f"    {name}={value:.5g},\n" for name, value in told.items())
    return (
        f"# physics steps of {step:.6g} s; armature holds the inertia of all that turns: take off"
        " what your bodies have\n"
        f'"servo": DelayedPDActuatorCfg(\n    joint_names_expr=["servo"],\n{inner}),\n'
    )


DC_MOTOR = "DCMotorCfg"  # whose torque falls with speed
KINDS = ("ImplicitActuatorCfg", "IdealPDActuatorCfg", "DelayedPDActuatorCfg", DC_MOTOR)
CURE = f"give a configuration in Python with {', '.join(KINDS)}"
EFFORT = ("effort_limit", "actuator_effort_limit", "effort_limit_sim", "joint_effort_limit")
SPEED = ("velocity_limit_sim", "joint_velocity_limit")
JOINTS = "joint_names_expr"


def read(content: bytes, joint: str, inertia: float) -> Nominal:
    """A group of a configuration, by its name or by that of a joint; the file is not run."""
    try:
        tree = ast.parse(content)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        raise UserError(f"no Python: {error}") from error
    constants = {name: value for node in tree.body for name, value in _named(node)}
    calls = {
        name: call
        for node in ast.walk(tree)
        for name, call in _named(node)
        if isinstance(call, ast.Call) and JOINTS in (it.arg for it in call.keywords)
    }
    groups = {
        name: {it.arg: it.value for it in call.keywords if it.arg} for name, call in calls.items()
    }
    reached = [
        name
        for name, given in groups.items()
        if joint
        and any(_meant(it, joint) for it in ast.walk(given.get(JOINTS, ast.Constant(None))))
    ]
    name = reached[0] if reached else chosen("group of actuators", joint, [*groups], CURE)
    given, function = groups[name], calls[name].func
    kind = getattr(function, "attr", getattr(function, "id", "call"))
    if kind not in KINDS:
        raise UserError(f"'{name}' is a {kind}, which is not read: {CURE}")

    def value(*keys: str) -> float:
        for key in keys:
            node = _resolved(given.get(key), constants)
            if isinstance(node, ast.Dict):
                pairs = zip(node.keys, node.values)
                meant = [it for text, it in pairs if len(node.keys) == 1 or _meant(text, joint)]
                node = _resolved(meant[0], constants) if meant else node
            number = getattr(node, "value", None)
            if isinstance(number, int | float) and abs(number) < LARGEST:
                return float(number)
            if node is not None and not (isinstance(node, ast.Constant) and number is None):
                raise UserError(
                    f"{key} of '{name}' is no number: write the number, and name the joint"
                )
        return 0.0

    origin = f"'{name}'"
    carried = inertia + value("armature")
    damping = value("damping")
    values = servo(value("stiffness"), damping, 0.0, value(*EFFORT), carried, origin)
    limits = ("velocity_limit", *SPEED) if kind == DC_MOTOR else SPEED
    if value(*limits):
        values["speed_limit"] = (min(value(*limits), FASTEST), f"{limits[0]} of {origin}")
    values["coulomb_friction.level"] = (value("friction"), f"friction of {origin}")
    steps = 0.5 * (value("min_delay") + value("max_delay"))
    told = f"mean delay of {origin}, {steps:g} steps of {SIMULATOR.step:g} s: scale it to yours"
    values[TRANSPORT_DELAY] = (steps * SIMULATOR.step, told)
    falls = f"torque of {origin} falls to 0 at velocity_limit; ours has all of it up to there"
    return Nominal(values, warnings=(falls,) if kind == DC_MOTOR else ())


def _resolved(node: ast.expr | None, constants: Mapping[str, ast.expr]) -> ast.expr | None:
    """The expression that a name of the file stands for."""
    return constants.get(node.id, node) if isinstance(node, ast.Name) else node


def _named(node: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Names and values of a dictionary or an assignment."""
    if isinstance(node, ast.Dict):
        for key, value in zip(node.keys, node.values):
            if isinstance(key, ast.Constant) and isinstance(key.value, str):
                yield key.value, value
    elif isinstance(node, ast.Assign):
        yield from ((it.id, node.value) for it in node.targets if isinstance(it, ast.Name))


def _meant(text: ast.AST | None, joint: str) -> bool:
    """Whether an expression names a joint.

    Only ``.*`` is understood: a foreign regular expression could run for ever.
    """
    pattern = getattr(text, "value", None)
    return isinstance(pattern, str) and fnmatchcase(joint, pattern.replace(".*", "*"))


SIMULATOR = Simulator("Isaac Lab", 0.005, FIELDS, law, starts, HOLDS, lines)
READER = Reader("Isaac Lab", (".py",), b"ActuatorCfg", read)
