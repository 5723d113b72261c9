"""A servo on a joint of a MuJoCo model: a torque-causal FMU, stepped with the engine."""

from __future__ import annotations

import fmpy
import mujoco
from fmpy.fmi2 import FMU2Slave


class ServoJoint:
    """Drives a joint with an FMU; call ``drive`` before each ``mj_step``.

    The geared rotor, dry friction and end stops go to the engine, whose solver holds what rests.
    The torque is the mean over the engine's step, which makes the coupling of second order.

    Args:
        joint: name of a hinge or a slide.
        folder: of the unzipped FMU, such as ``fmpy.extract("fmus/sg90_torque.native.fmu")``.
        start: start values of its inputs and parameters, SI.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        joint: str,
        folder: str,
        start: dict[str, float] | None = None,
    ) -> None:
        self.model, self.data = model, data
        self.position, self.dof = model.joint(joint).qposadr[0], model.joint(joint).dofadr[0]
        description = fmpy.read_model_description(folder)
        self.reference = {v.name: v.valueReference for v in description.modelVariables}
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=joint,
        )
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=data.time)
        self.fmu.enterInitializationMode()
        self._set(start or {})
        self.fmu.exitInitializationMode()
        self.impulse = 0.0
        self._prepare(model.joint(joint).id)

    def _prepare(self, joint: int) -> None:
        model, dof = self.model, self.dof
        model.dof_armature[dof], travel = self._get("shaft_inertia", "travel")
        if travel > 0.0:
            model.jnt_limited[joint] = 1
            model.jnt_range[joint] = -travel, travel
        quick, hard = 2.0 * model.opt.timestep, (0.9999, 0.9999, 0.001, 0.5, 2.0)
        model.dof_solimp[dof] = model.jnt_solimp[joint] = hard
        model.dof_solref[dof] = quick, 1.0  # with the defaults a joint that sticks creeps
        model.jnt_solref[joint] = quick, 2.0  # with a damping ratio of 1 a stop throws it back
        mujoco.mj_setConst(model, self.data)

    def drive(self, **inputs: float) -> None:
        """Step the FMU over the engine's next step, inputs [SI] held, and apply its torque."""
        data, dof, size = self.data, self.dof, self.model.opt.timestep
        motion = {
            "joint_position": data.qpos[self.position],
            "joint_velocity": data.qvel[dof],
            "joint_acceleration": data.qacc[dof],
        }
        self._set({**motion, **inputs})
        self.fmu.doStep(data.time, size)
        impulse, self.model.dof_frictionloss[dof] = self._get("impulse", "friction")
        data.qfrc_applied[dof] = (impulse - self.impulse) / size
        self.impulse = impulse

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()

    def _set(self, values: dict[str, float]) -> None:
        self.fmu.setReal([self.reference[name] for name in values], list(values.values()))

    def _get(self, *names: str) -> list[float]:
        return self.fmu.getReal([self.reference[name] for name in names])
