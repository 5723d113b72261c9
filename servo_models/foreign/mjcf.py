"""A joint of an MJCF file as a box, run by MuJoCo: ``actuator = "robot.xml#shoulder"``.

The command is the control of the actuator that drives the joint; read are its angle, or position,
and rate.  Parameters are those of the joint and of the actuator: damping, armature, frictionloss,
of a position or pid servo kp and kv, of a motor its gear, of a dcmotor resistance and motorconst,
and of its controller kp and kd.  Everything else of the file moves along.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.core.types import Array
from servo_models.errors import UserError, did_you_mean, extra
from servo_models.fmu.child import SECONDS, Child, Pool
from servo_models.foreign.box import Signal, name_of

STOP = 2.0  # s, of an experiment that shows what it does
HINGE = 3  # mjtJoint.mjJNT_HINGE
JOINT = {"damping": "dof_damping", "armature": "dof_armature", "frictionloss": "dof_frictionloss"}
"""Fields of a joint, and where MuJoCo keeps them."""
Parameters = Mapping[str, tuple[tuple[str, int, float], ...]]
SERVO: Parameters = {
    "kp": (("gainprm", 0, 1.0), ("biasprm", 1, -1.0)),
    "kv": (("biasprm", 2, -1.0),),
}
PID: Parameters = {"kp": (("biasprm", 1, -1.0),), "kv": (("biasprm", 2, -1.0),)}
MOTOR: Parameters = {"gear": (("gear", 0, 1.0),)}
DC_MOTOR: Parameters = {"resistance": (("gainprm", 0, 1.0),), "motorconst": (("gainprm", 1, 1.0),)}
CONTROLLED: Parameters = {"kp": (("gainprm", 4, 1.0),), "kd": (("gainprm", 6, 1.0),), **DC_MOTOR}
"""Parameters of an actuator: the arrays of MuJoCo that hold one, the place in it and the sign."""
LEAST = 1e-3  # least resistance or motorconst over its own
FIXED_GAIN = 0  # mjtGain.mjGAIN_FIXED
DC_GAIN = 3  # mjtGain.mjGAIN_DCMOTOR
POSITION_INPUT = 1  # mjtCtrlInput.mjINPUT_POS
VOLTAGE_INPUT = 8  # mjtCtrlInput.mjINPUT_VOLTAGE


class MjcfBox:
    """See ``box.Box``."""

    any_step = False  # steps are those of the file

    def __init__(self, path: Path, joint: str) -> None:
        self.path, self.title = path, f"{path.name}, joint {joint}"
        self.name = name_of(joint, "joint")
        model = _loaded(path)
        place, drive = _found(model, path, joint)
        hinge = model.jnt_type[place] == HINGE
        unit, force, mass = ("rad", "N.m", "kg.m2") if hinge else ("m", "N", "kg")
        units = {
            "armature": mass,
            **dict.fromkeys(("frictionloss", "gear"), force),
            **dict.fromkeys(("damping", "kv", "kd"), f"{force}.s/{unit}"),
            "kp": f"{force}/{unit}",
            "resistance": "Ohm",
            "motorconst": f"{force}/A",
        }
        low, high = model.jnt_range[place] if model.jnt_limited[place] else (-np.pi, np.pi)
        size = float(max(abs(low), abs(high)))
        kind, command = _kind(model, drive)
        limited, limits = model.actuator_ctrllimited[drive], model.actuator_ctrlrange[drive]
        most = float(np.abs(limits).max()) if limited else size
        self.inputs: tuple[Signal, ...] = (
            Signal("command", command or unit, most, about="control"),
        )
        self.outputs: tuple[Signal, ...] = (
            Signal("angle" if hinge else "position", unit, size, about=f"of joint {joint}"),
        )
        dof = model.jnt_dofadr[place]
        values = {key: float(getattr(model, field)[dof]) for key, field in JOINT.items()}
        known = [Signal(key, units[key], value, 0.0) for key, value in values.items()]
        for key, ((array, column, sign), *_) in kind.items():
            value = sign * getattr(model, f"actuator_{array}")[drive][column]
            low = LEAST * value if key in DC_MOTOR else -np.inf if key == "gear" else 0.0
            known.append(Signal(key, units[key], float(value), low))
        self.parameters = tuple(known)
        self.step, self.stop_time = float(model.opt.timestep), STOP
        what = f"'{path.name}#{joint}'"
        self._calls = Pool(partial(Child, _simulation, (path, joint), SECONDS, what))

    def run(self, parameters: Mapping[str, float], times: Array, inputs: Array) -> Array:
        """See ``box.Box.run``."""
        with self._calls.one() as call:
            found = np.asarray(call(dict(parameters), times, inputs[:, 0]))
        if not np.isfinite(found).all():
            raise UserError(f"{self.title}: the simulation gives no number")
        return found[:, None]


def _loaded(path: Path) -> Any:
    mujoco = extra("benchmark", "mujoco")
    try:
        return mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, OSError) as error:
        reason = str(error).strip().splitlines()[0]
        raise UserError(f"'{path}' is no MJCF that MuJoCo reads: {reason}") from error


def _found(model: Any, path: Path, joint: str) -> tuple[int, int]:
    """Numbers of a joint and of the actuator that drives it."""
    names = [model.joint(k).name for k in range(model.njnt)]
    if joint not in names:
        raise UserError(f"'{path}' has no joint '{joint}'; {did_you_mean(joint, names)}")
    place = names.index(joint)
    drives = [k for k in range(model.nu) if model.actuator_trnid[k][0] == place]
    if not drives:
        raise UserError(f"'{path}': no actuator drives joint '{joint}'; give it one")
    return place, drives[0]


def _kind(model: Any, drive: int) -> tuple[Parameters, str]:
    """Parameters of an actuator, and the unit of its command; "" for that of the joint."""
    gain, bias = model.actuator_gaintype[drive], model.actuator_biasprm[drive]
    if gain == DC_GAIN and hasattr(model, "actuator_ctrlspec"):  # from MuJoCo 4 on
        command = model.actuator_ctrlspec[drive]
        if command == POSITION_INPUT:
            return CONTROLLED, ""
        return DC_MOTOR, "V" if command == VOLTAGE_INPUT else "1"
    if bias[1] < 0.0:
        return (SERVO if gain == FIXED_GAIN else PID), ""
    return (MOTOR if gain == FIXED_GAIN and not bias.any() else {}), "1"


def _simulation(path: Path, joint: str) -> Callable[..., Array]:
    """The function that a child process calls."""
    mujoco, model = extra("benchmark", "mujoco"), _loaded(path)
    place, drive = _found(model, path, joint)
    dof, angle = model.jnt_dofadr[place], model.jnt_qposadr[place]
    kind, _ = _kind(model, drive)
    control = model.actuator_ctrladr[drive] if hasattr(model, "actuator_ctrladr") else drive

    def simulate(parameters: Mapping[str, float], times: Array, command: Array) -> Array:
        for key, field in JOINT.items():
            getattr(model, field)[dof] = parameters[key]
        for key, places in kind.items():
            for array, column, sign in places:
                getattr(model, f"actuator_{array}")[drive][column] = sign * parameters[key]
        data = mujoco.MjData(model)
        out = np.empty(len(times))
        out[0] = data.qpos[angle]
        clock, step = float(times[0]), model.opt.timestep
        for k in range(1, len(times)):
            data.ctrl[control] = command[k - 1]
            while clock < times[k] - 0.5 * step:
                mujoco.mj_step(model, data)
                clock += step
            out[k] = data.qpos[angle]
        return out

    return simulate
