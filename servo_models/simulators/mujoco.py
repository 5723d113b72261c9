"""MuJoCo: a hinge joint with armature, damping and frictionloss, driven by a position actuator.

The law is that of the integrator ``implicitfast``, one degree of freedom:

    force = clip(kp (u - q) - kv v, forcerange);  u: the goal, behind delay and timeconst
    friction = clip(-d (inertia a0 + inertia b v), frictionloss), a0 without it
    v += h inertia a / (inertia + h (damping + kv));  q += h v

kv leaves the denominator while the force is clipped.  Source: MuJoCo documentation, Computation
(Actuation model, Constraint model: solref 0.02 1 and solimp 0.9 0.95 of a friction loss, Numerical
integration), XML reference (actuator/position, actuator/general delay, nsample), Modeling (Delays);
MuJoCo DC Motor Model, 2026, but for its controller, which gives a torque in MuJoCo 4.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.simulators.reading import (
    TRANSPORT_DELAY,
    Values,
    chosen,
    numbers,
    parsed,
    servo,
)
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
    fields: Fields, step: float, goal: Array, load: Array, inertia: float, start: float
) -> Array:
    """The angle of the joint, see ``simulator.Law``."""
    kp, kv, damping, forcerange, frictionloss, timeconst, _ = fields
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
    "presliding_friction": Held(APPROXIMATE, "frictionloss, which creeps and has no spring"),
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

    def told(*names: str) -> str:
        return "".join(f' {name}="{values[name]:.5g}"' for name in names if values[name])

    joint = f'armature="{inertia:.5g}"' + told("damping", "frictionloss")
    actuator = f'kp="{values["kp"]:.5g}"' + told("kv", "timeconst")
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


SMALLEST_GEAR = 1e-6
SERVOS = ("position", "pid")
DRIVES = (*SERVOS, "motor", "dcmotor")
ALIKE = ("general", *DRIVES)  # elements that share their defaults


@dataclass(frozen=True)
class Driven:
    """A joint and the actuator on it, with the attributes of their classes.

    Attributes:
        name: of the joint.
        joint, drive: attributes.
        outside: inertia [kg m^2] that the joint carries beside what the file says.
    """

    name: str
    joint: Mapping[str, str]
    drive: Mapping[str, str]
    outside: float

    def number(
        self, attributes: Mapping[str, str], key: str, place: int = 0, default: float = 0.0
    ) -> float:
        """Return a number of an attribute, or the default where it has none there."""
        words = attributes.get(key, "").split()[place : place + 1]
        return numbers(words[0], 1, f"{key} of {self.origin}")[0] if words else default

    def of_drive(self, key: str, place: int = 0, default: float = 0.0) -> float:
        """Return a number of the actuator."""
        return self.number(self.drive, key, place, default)

    @property
    def origin(self) -> str:
        """What a value comes from, in words."""
        return f"joint '{self.name}'"

    @property
    def gear(self) -> float:
        """Travel of the actuator over that of the joint."""
        ratio = self.of_drive("gear", default=1.0)
        if abs(ratio) < SMALLEST_GEAR:
            raise UserError(f"gear of {self.origin} is {ratio:g}, nothing drives it: give another")
        return ratio

    def at_joint(self, key: str) -> float:
        """Return the armature [kg m^2], or damping [N m s/rad], of joint and actuator together."""
        outside = self.outside if key == "armature" else 0.0
        return outside + self.number(self.joint, key) + self.gear**2 * self.of_drive(key)


def read(content: bytes, joint: str, inertia: float) -> Nominal:
    """A joint of an MJCF with its actuator; classes of defaults are followed.

    ``position`` and ``pid`` are a servo, ``motor`` is a motor on a current of which 1 A is the
    torque of a control of 1, ``dcmotor`` a motor on a voltage or, with its controller, a servo.
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
    cure = f"give an MJCF with a {' or '.join(DRIVES)} actuator on it, included files put in"
    if joint in joints and joint not in actuators:
        raise UserError(f"joint '{joint}' has no actuator: {cure}")
    name = chosen("hinge joint with an actuator", joint, [*actuators], cure)
    element, (hinge, inherited) = actuators[name], joints[name]
    if element.tag not in DRIVES:
        raise UserError(f"joint '{name}' is driven by <{element.tag:.20}>: {cure}")
    at_joint = {**classes.get(hinge.get("class", inherited), {}).get("joint", {}), **hinge.attrib}
    defaults = classes.get(element.get("class", "main"), {})
    drive = {key: it for tag in ALIKE for key, it in defaults.get(tag, {}).items()} | element.attrib
    driven = Driven(name, at_joint, drive, inertia)
    reading = READINGS[element.tag](driven)
    values, warnings, origin = {**reading.values}, [*reading.warnings], driven.origin
    values[TRANSPORT_DELAY] = (driven.of_drive("delay"), f"delay of {origin}")
    loss = driven.number(at_joint, "frictionloss")
    values["coulomb_friction.level"] = (loss, f"frictionloss of {origin}")
    if "range" in at_joint and at_joint.get("limited", "auto") != "false":
        ends = numbers(at_joint["range"], 2, f"range of {origin}")
        compiler = root.find("compiler")
        unit = "degree" if compiler is None else compiler.get("angle", "degree")
        if unit not in ("degree", "radian"):
            raise UserError(f"compiler angle is '{unit:.20}': write degree or radian")
        scale = math.radians(1.0) if unit == "degree" else 1.0
        half = scale * min(abs(end) for end in ends)
        values["end_stops.half_range"] = (half, f"nearer end of range of {origin}, in {unit}s")
    if driven.number(at_joint, "stiffness"):
        warnings.append(f"{origin} has a spring, ours has none")
    return replace(reading, values=values, warnings=tuple(warnings))


def _servo(it: Driven) -> Nominal:
    """A position or pid actuator."""
    if it.of_drive("ki"):
        raise UserError(f"{it.origin} has an integral gain: our servo has none, leave out ki")
    gain, damping = it.of_drive("kp", default=1.0), it.of_drive("kv")
    if "dampratio" in it.drive:
        carried = it.at_joint("armature") / it.gear**2
        damping = 2.0 * it.of_drive("dampratio") * math.sqrt(max(gain * carried, 0.0))
    low, high = numbers(it.drive.get("forcerange", "0 0"), 2, f"forcerange of {it.origin}")
    effort = min(abs(low), abs(high))
    values = _follower(it, gain, damping, effort, it.of_drive("slewmax"))
    values["command_lag.time_constant"] = (it.of_drive("timeconst"), f"timeconst of {it.origin}")
    return Nominal(values)


def _follower(it: Driven, gain: float, damping: float, effort: float, slew: float) -> Values:
    """Our servo for gains, largest force and rate of the goal of an actuator, before its gear."""
    stiffness, clipped = it.gear**2 * gain, it.gear**2 * damping
    free, carried = it.at_joint("damping"), it.at_joint("armature")
    values = servo(stiffness, clipped, free, abs(it.gear) * effort, carried, it.origin)
    if it.gear != 1.0:
        values["gain"] = (1.0 / it.gear, f"1 / gear of {it.origin}")
    values["rate_limit.rate"] = (slew / abs(it.gear), f"slewmax of {it.origin}")
    return values


def _motor(it: Driven) -> Nominal:
    """A motor: its control is a torque over the gear."""
    values = _rotor(it, 1.0, abs(it.gear), "gear")
    told = [f"1 A is what a control of 1 does to {it.origin}: name its column with unit A"]
    for key in ("ctrlrange", "forcerange"):
        if key in it.drive:
            told.append(f"{key} of {it.origin} is left out: clip the column by it")
    return Nominal(values, "A", tuple(told))


def _dcmotor(it: Driven) -> Nominal:
    """A DC motor on a voltage, or within its position controller."""
    volts, stall, speed = (it.of_drive("nominal", k) for k in range(3))
    given = [it.of_drive("motorconst", k) for k in range(2)]
    positive = [constant for constant in given if constant > 0.0]
    constant = math.sqrt(positive[0] * positive[-1]) if positive else volts / (speed or math.inf)
    resistance = it.of_drive("resistance") or constant * volts / (stall or math.inf)
    told, mode = f"dcmotor of {it.origin}", it.drive.get("input", "voltage")
    if constant <= 0.0 or resistance <= 0.0:
        raise UserError(
            f"{told} has no motorconst and resistance: give them, or the nominal voltage, stall"
            " torque and no-load speed"
        )
    if mode == "pos":
        return _controlled(it, constant, resistance)
    if mode != "voltage":
        raise UserError(f"{told} has input '{mode:.20}': give one with voltage or pos")
    values = _rotor(it, abs(it.gear), constant, "motorconst, or nominal,")
    values["resistance"] = (resistance, f"resistance, or nominal, of {told}")
    lag = it.of_drive("inductance", 1) or it.of_drive("inductance") / resistance
    values["winding_lag.time_constant"] = (lag, f"inductance of {told}")
    if "ctrlrange" in it.drive:
        limit = min(abs(end) for end in numbers(it.drive["ctrlrange"], 2, f"ctrlrange of {told}"))
        values["drive_saturation.limit"] = (limit, f"ctrlrange of {told}")
    return Nominal(values, "V", _left_out(it, "cogging", "lugre", "saturation", "thermal"))


def _rotor(it: Driven, ratio: float, constant: float, origin: str) -> Values:
    """A motor behind a gear, with all that turns on its rotor."""
    carried, damping = (it.at_joint(key) / ratio**2 for key in ("armature", "damping"))
    if carried <= 0.0:
        raise UserError(f"{it.origin} has no armature: give what it carries by --inertia")
    over = "" if ratio == 1.0 else ", over gear^2"
    values: Values = {
        "rotor_inertia": (carried, f"armature of {it.origin}, and --inertia{over}"),
        "gear_ratio": (ratio, f"gear of {it.origin}" if over else "none"),
        "torque_constant": (constant, f"{origin} of {it.origin}"),
        "viscous_coefficient": (damping, f"damping of {it.origin}{over}"),
    }
    if it.gear < 0.0:
        values["command_gain.error"] = (-2.0, f"gear of {it.origin} is negative")
    return values


def _controlled(it: Driven, constant: float, resistance: float) -> Nominal:
    """A DC motor whose controller makes kp e - kd v of the torque that its voltage allows."""
    gain, integral, damping, slew, _, volts = (it.of_drive("controller", k) for k in range(6))
    told = f"controller of {it.origin}"
    if integral:
        raise UserError(f"{told} has an integral gain: our servo has none, leave out ki")
    limit = it.of_drive("saturation") or constant * it.of_drive("saturation", 1)
    stall = constant * volts / resistance
    effort = min(limit, stall) if limit and stall else limit or stall
    values = _follower(it, gain, damping, effort, slew)
    warnings = _left_out(it, "cogging", "inductance", "lugre", "thermal")
    if volts:
        fastest = min(values["speed_limit"][0], volts / (constant * abs(it.gear)))
        values["speed_limit"] = (fastest, f"v_max of {told} / motorconst, or force / damping")
        warnings += (f"v_max of {told} lowers the torque with speed, in ours at full speed alone",)
    return Nominal(values, warnings=warnings)


def _left_out(it: Driven, *keys: str) -> tuple[str, ...]:
    """A warning that names the attributes of an actuator that are not read."""
    given = ", ".join(key for key in keys if key in it.drive)
    return (f"{given} of {it.origin} left out: ours has none there",) if given else ()


READINGS = {**dict.fromkeys(SERVOS, _servo), "motor": _motor, "dcmotor": _dcmotor}


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
