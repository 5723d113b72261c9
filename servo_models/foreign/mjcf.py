"""A joint of an MJCF file as a box, run by MuJoCo: ``actuator = "robot.xml#shoulder"``.

The command is the control of the actuator that drives the joint; read are its angle, or position,
and rate.  Parameters are those of the joint and of the actuator: damping, armature, frictionloss,
and of a position servo kp and kv.  Everything else of the file moves along.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.core.types import Array
from servo_models.data.readers.columns import extra
from servo_models.errors import UserError, did_you_mean
from servo_models.foreign.box import Signal
from servo_models.foreign.child import Child

SECONDS = 60.0  # that one run may take
STOP = 2.0  # s, of an experiment that shows what it does
HINGE = 3  # mjtJoint.mjJNT_HINGE
JOINT = {"damping": "dof_damping", "armature": "dof_armature", "frictionloss": "dof_frictionloss"}
"""Fields of a joint, and where MuJoCo keeps them."""
UNITS = {"damping": "N.m.s/rad", "armature": "kg.m2", "frictionloss": "N.m"}
SLIDE_UNITS = {"damping": "N.s/m", "armature": "kg", "frictionloss": "N"}


class MjcfBox:
    """See ``box.Box``."""

    def __init__(self, path: Path, joint: str) -> None:
        self.path, self.title = path, f"{path.name}, joint {joint}"
        self.name = re.sub(r"\W+|__+", "_", joint).strip("_") or "joint"
        model = _loaded(path)
        place, drive = _found(model, path, joint)
        hinge = model.jnt_type[place] == HINGE
        unit, units = ("rad", UNITS) if hinge else ("m", SLIDE_UNITS)
        low, high = model.jnt_range[place] if model.jnt_limited[place] else (-np.pi, np.pi)
        size = float(max(abs(low), abs(high)))
        is_servo = model.actuator_biasprm[drive][1] < 0.0
        command = Signal("command", unit if is_servo else "1", size, about="control")
        self.inputs: tuple[Signal, ...] = (command,)
        self.outputs: tuple[Signal, ...] = (
            Signal("angle" if hinge else "position", unit, size, about=f"of joint {joint}"),
        )
        dof = model.jnt_dofadr[place]
        values = {key: float(getattr(model, field)[dof]) for key, field in JOINT.items()}
        known = [Signal(key, units[key], value, 0.0) for key, value in values.items()]
        if is_servo:
            gain, rate = model.actuator_gainprm[drive][0], -model.actuator_biasprm[drive][2]
            torque = "N.m" if hinge else "N"
            known += [
                Signal("kp", f"{torque}/{unit}", float(gain), 0.0),
                Signal("kv", f"{torque}.s/{unit}", float(rate), 0.0),
            ]
        self.parameters = tuple(known)
        self.step, self.stop_time = float(model.opt.timestep), STOP
        self._call = Child(_simulation, (path, joint), SECONDS, f"'{path.name}#{joint}'")

    def run(self, parameters: Mapping[str, float], times: Array, inputs: Array) -> Array:
        """See ``box.Box.run``."""
        found = np.asarray(self._call(dict(parameters), times, inputs[:, 0]))
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


def _simulation(path: Path, joint: str) -> Callable[..., Array]:
    """The function that a child process calls."""
    mujoco, model = extra("benchmark", "mujoco"), _loaded(path)
    place, drive = _found(model, path, joint)
    dof, angle = model.jnt_dofadr[place], model.jnt_qposadr[place]

    def simulate(parameters: Mapping[str, float], times: Array, command: Array) -> Array:
        for key, field in JOINT.items():
            getattr(model, field)[dof] = parameters[key]
        if "kp" in parameters:
            model.actuator_gainprm[drive][0] = parameters["kp"]
            model.actuator_biasprm[drive][1] = -parameters["kp"]
            model.actuator_biasprm[drive][2] = -parameters["kv"]
        data = mujoco.MjData(model)
        out = np.empty(len(times))
        out[0] = data.qpos[angle]
        clock, step = float(times[0]), model.opt.timestep
        for k in range(1, len(times)):
            data.ctrl[drive] = command[k - 1]
            while clock < times[k] - 0.5 * step:
                mujoco.mj_step(model, data)
                clock += step
            out[k] = data.qpos[angle]
        return out

    return simulate
