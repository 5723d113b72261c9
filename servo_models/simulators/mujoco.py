"""MuJoCo: a hinge joint with armature, damping and frictionloss, driven by a position actuator.

The law is that of the integrator ``implicitfast``, one degree of freedom:

    force = clip(kp (u - q) - kv v, forcerange);  u: the goal, behind delay and timeconst
    friction = clip(-d (inertia a0 + inertia b v), frictionloss), a0 without it
    v += h inertia a / (inertia + h (damping + kv));  q += h v

kv leaves the denominator while the force is clipped.  Source: MuJoCo documentation, Computation
(Actuation model, Constraint model: solref 0.02 1 and solimp 0.9 0.95 of a friction loss, Numerical
integration), XML reference (actuator/position, actuator/general delay, nsample), Modeling (Delays).
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.simulators.reading import TRANSPORT_DELAY, chosen, numbers, parsed, servo
from servo_models.simulators.simulator import (
    APPROXIMATE,
    DELAY,
    EXACT,
    LOST,
    OF_JOINTS,
    Field,
    Held,
    Motion,
    Nominal,
    Reader,
    Simulator,
)

IMPEDANCE = 0.9  # d of a friction loss: the first number of solimpfriction
WIDEST_IMPEDANCE = 0.95  # d_width: the second number of solimpfriction
TIME_CONSTANT_S = 0.02  # the first number of solreffriction
FRICTION_DAMPING = 2.0 / WIDEST_IMPEDANCE  # damping b of a friction loss times timeconst
SHORTEST_STEPS = 2.0  # shortest time constant of a constraint in time steps

FIELDS = (
    Field("kp", "N.m/rad", "position gain", 1e-6, 1e6, optional=False),
    Field("kv", "N.m.s/rad", "damping by the actuator, within forcerange", 1e-9, 1e4),
    Field("damping", "N.m.s/rad", "damping of the joint", 1e-9, 1e4),
    Field("forcerange", "N.m", "largest torque", 1e-6, 1e5),
    Field("frictionloss", "N.m", "dry friction", 1e-7, 1e4),
    Field("timeconst", "s", "lag of the command", 1e-4, 10.0),
    Field(DELAY, "steps", "delay of the command", 0.0, 2000.0),
)


def law(
    kp: float,
    kv: float,
    damping: float,
    forcerange: float,
    frictionloss: float,
    timeconst: float,
    delay: float,
    step: float,
    goal: Array,
    load: Array,
    inertia: float,
    start: float,
) -> Array:
    """The angle of the joint, see ``simulator.Law``."""
    angles = np.empty(len(goal))
    angle, rate, filtered = start, 0.0, start
    reached = 1.0 - math.exp(-step / timeconst) if timeconst > 0.0 else 1.0
    pull = FRICTION_DAMPING / max(TIME_CONSTANT_S, SHORTEST_STEPS * step)
    for k in range(len(goal)):
        angles[k] = angle
        wanted = filtered if timeconst > 0.0 else goal[k]
        filtered += (goal[k] - filtered) * reached
        force = kp * (wanted - angle) - kv * rate
        implicit = damping + kv
        if 0.0 < forcerange < abs(force):
            force = math.copysign(forcerange, force)
            implicit = damping
        torque = force - damping * rate - load[k]
        friction = -IMPEDANCE * (torque + inertia * pull * rate)
        torque += min(max(friction, -frictionloss), frictionloss)
        rate += step * torque / (inertia + step * implicit)
        angle += step * rate
    return angles


def starts(motion: Motion) -> list[dict[str, float]]:
    """Starts with damping by the joint, where forcerange limits the speed, and by the actuator."""
    stiffness = motion.inertia * motion.frequency**2
    damping = 2.0 * motion.ratio * motion.frequency * motion.inertia
    effort = damping * motion.speed
    common = {"frictionloss": 0.01 * effort, "timeconst": 0.1 / motion.frequency}
    every = {"kp": stiffness, "forcerange": effort, DELAY: motion.delay, **common}
    return [
        {**every, "damping": damping, "kv": 0.0},
        {**every, "damping": 0.1 * damping, "kv": damping},
    ]


HOLDS: Mapping[str, Held] = {
    **OF_JOINTS,
    "transport_delay": Held(EXACT, "delay, in whole time steps"),
    "command_lag": Held(EXACT, "timeconst"),
    "lag": Held(APPROXIMATE, "timeconst, which lags the command alone"),
    "viscous_friction": Held(EXACT, "damping"),
    "coulomb_friction": Held(APPROXIMATE, "frictionloss, which creeps where ours stands still"),
    "stribeck_friction": Held(APPROXIMATE, "frictionloss, one for rest and motion"),
    "supply_limit": Held(APPROXIMATE, "forcerange, at one supply"),
    "saturation": Held(APPROXIMATE, "forcerange, which limits the torque alone"),
    "torque_saturation": Held(EXACT, "forcerange"),
    "rate_limit": Held(APPROXIMATE, "forcerange over damping, a speed of the joint"),
    "motion_profile": Held(APPROXIMATE, "forcerange over damping, without the ramps"),
    "sample_hold": Held(LOST, "unless your loop holds ctrl as long"),
}


def lines(values: Mapping[str, float], step: float, inertia: float) -> str:
    """The option, the joint and the actuator."""
    joint = f'armature="{inertia:.5g}"'
    actuator = f'kp="{values["kp"]:.5g}"'
    for name in ("damping", "frictionloss"):
        joint += f' {name}="{values[name]:.5g}"' if values[name] else ""
    for name in ("kv", "timeconst"):
        actuator += f' {name}="{values[name]:.5g}"' if values[name] else ""
    if values["forcerange"]:
        actuator += ' forcerange="-{0:.5g} {0:.5g}"'.format(values["forcerange"])
    if values[DELAY]:
        actuator += f' delay="{values[DELAY] * step:.6g}" nsample="{values[DELAY]:.0f}"'
    return (
        f'<option integrator="implicitfast" timestep="{step:.6g}"/>\n'
        "<!-- armature holds the inertia of all that turns: take off what your bodies have -->\n"
        f'<joint name="servo" type="hinge" {joint}/>\n'
        f'<position name="servo" joint="servo" {actuator}/>\n'
    )


DRIVES = ("position", "pid")
ALIKE = ("general", "motor", *DRIVES)  # elements that share their defaults


def read(content: bytes, joint: str, inertia: float) -> Nominal:
    """A joint of an MJCF with its position or pid actuator; classes of defaults are followed.

    Raises:
        UserError: no such joint, no such actuator on it, an integral gain, another unit.
    """
    root = parsed(content)
    classes = _classes(root)
    joints = {
        node.get("name", ""): (node, inherited)
        for node, inherited in _joints(root, "main")
        if node.get("name") and node.get("type", "hinge") == "hinge"
    }
    actuators = {
        node.get("joint", ""): node
        for node in root.iterfind("actuator/*")
        if node.get("joint") in joints and (node.tag in DRIVES or node.get("joint") == joint)
    }
    cure = "give an MJCF with a position or pid actuator on it, included files put in"
    if joint in joints and joint not in actuators:
        raise UserError(f"joint '{joint}' has no actuator: {cure}")
    name = chosen("hinge joint with a servo", joint, [*actuators], cure)
    element, (hinge, inherited) = actuators[name], joints[name]
    if element.tag not in DRIVES:
        raise UserError(f"joint '{name}' is driven by <{element.tag:.20}>: {cure}")
    at_joint = {**classes.get(hinge.get("class", inherited), {}).get("joint", {}), **hinge.attrib}
    defaults = classes.get(element.get("class", "main"), {})
    drive = {key: it for tag in ALIKE for key, it in defaults.get(tag, {}).items()} | element.attrib

    def value(attributes: Mapping[str, str], key: str, default: float = 0.0) -> float:
        if key not in attributes:
            return default
        first = " ".join(attributes[key].split()[:1])
        return numbers(first, 1, f"{key} of joint '{name}'")[0]

    if value(drive, "ki"):
        raise UserError(f"joint '{name}' has an integral gain: our servo has none, leave out ki")
    gear = value(drive, "gear", 1.0)
    carried = inertia + value(at_joint, "armature") + gear**2 * value(drive, "armature")
    stiffness = gear**2 * value(drive, "kp", 1.0)
    clipped = gear**2 * value(drive, "kv")
    if "dampratio" in drive:
        clipped = 2.0 * value(drive, "dampratio") * math.sqrt(stiffness * carried)
    damping = value(at_joint, "damping")
    low, high = numbers(drive.get("forcerange", "0 0"), 2, f"forcerange of joint '{name}'")
    origin = f"joint '{name}'"
    effort = abs(gear) * min(abs(low), abs(high))
    values = servo(stiffness, clipped, damping, effort, carried, origin)
    values[TRANSPORT_DELAY] = (value(drive, "delay"), f"delay of {origin}")
    values["command_lag.time_constant"] = (value(drive, "timeconst"), f"timeconst of {origin}")
    values["coulomb_friction.level"] = (
        value(at_joint, "frictionloss"),
        f"frictionloss of {origin}",
    )
    if gear != 1.0:
        values["gain"] = (1.0 / gear, f"1 / gear of {origin}")
    if "range" in at_joint and at_joint.get("limited", "auto") != "false":
        ends = numbers(at_joint["range"], 2, f"range of {origin}")
        compiler = root.find("compiler")
        unit = "degree" if compiler is None else compiler.get("angle", "degree")
        if unit not in ("degree", "radian"):
            raise UserError(f"compiler angle is '{unit:.20}': write degree or radian")
        scale = math.radians(1.0) if unit == "degree" else 1.0
        half = scale * min(abs(end) for end in ends)
        values["end_stops.half_range"] = (half, f"nearer end of range of {origin}, in {unit}s")
    spring = value(at_joint, "stiffness") != 0.0
    return Nominal(values, warnings=(f"{origin} has a spring, ours has none",) if spring else ())


def _joints(element: ET.Element, inherited: str) -> Iterator[tuple[ET.Element, str]]:
    """Every joint below an element, with the class that its bodies hand down."""
    waiting = [(element, inherited)]
    while waiting:
        here, handed = waiting.pop()
        handed = here.get("childclass", handed)
        for child in here:
            if child.tag == "joint" and here.tag == "body":
                yield child, handed
            elif child.tag in ("worldbody", "body", "frame"):
                waiting.append((child, handed))


def _classes(root: ET.Element) -> dict[str, dict[str, dict[str, str]]]:
    """Attributes by class and element, with those inherited from the classes around it."""
    classes: dict[str, dict[str, dict[str, str]]] = {}
    outermost: dict[str, dict[str, str]] = {}
    waiting = [(it, "main", outermost) for it in root.iterfind("default")]
    while waiting:
        element, name, outer = waiting.pop()
        attributes = {tag: dict(values) for tag, values in outer.items()}
        for child in element:
            if child.tag != "default":
                attributes.setdefault(child.tag, {}).update(child.attrib)
        classes[element.get("class", name)] = attributes
        waiting += [(child, "", attributes) for child in element.iterfind("default")]
    return classes


SIMULATOR = Simulator("MuJoCo", 0.002, FIELDS, law, starts, HOLDS, lines)
READER = Reader("MuJoCo", (".xml", ".mjcf"), b"<mujoco", read)
