"""A servo on a joint of a MuJoCo model: a torque-causal FMU, stepped with the engine."""

import fmpy
import mujoco
from fmpy.fmi2 import FMU2Slave


class ServoJoint:
    """Drives ``joint`` with the FMU; call ``drive`` before each ``mj_step``.

    The rotor, dry friction and end stops go to the engine, whose solver holds what rests; the link
    and all loads are there anyway.  The torque is the mean over the engine's step.

    Args:
        fmu: of an actuator in its torque-causal form, such as ``sg90_torque.native.fmu``.
        start: start values of the FMU, inputs and parameters, SI.
    """

    def __init__(self, model, data, joint: str, fmu: str, **start: float) -> None:
        self.model, self.data = model, data
        self.at, self.dof = model.joint(joint).qposadr[0], model.joint(joint).dofadr[0]
        description = fmpy.read_model_description(fmu)
        self.reference = {v.name: v.valueReference for v in description.modelVariables}
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=fmpy.extract(fmu),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=joint,
        )
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=data.time)
        self.fmu.enterInitializationMode()
        self._set(joint_position=data.qpos[self.at], joint_velocity=data.qvel[self.dof], **start)
        self.fmu.exitInitializationMode()
        self.impulse = 0.0
        self._prepare_joint(model.joint(joint).id)

    def _prepare_joint(self, joint: int) -> None:
        model = self.model
        inertia, travel = self._get("shaft_inertia", "travel")
        model.dof_armature[self.dof] = inertia
        if travel > 0.0:
            model.jnt_limited[joint] = 1
            model.jnt_range[joint] = -travel, travel
        stiff = 2.0 * model.opt.timestep, 1.0  # by MuJoCo's defaults a joint at rest creeps
        hard = 0.9999, 0.9999, 0.001, 0.5, 2.0
        model.dof_solref[self.dof], model.dof_solimp[self.dof] = stiff, hard
        model.jnt_solref[joint], model.jnt_solimp[joint] = stiff, hard
        mujoco.mj_setConst(model, self.data)

    def drive(self, **inputs: float) -> None:
        """Step the FMU over the engine's next step, with its inputs [SI] held, and apply it."""
        data, dof, size = self.data, self.dof, self.model.opt.timestep
        self._set(
            joint_position=data.qpos[self.at],
            joint_velocity=data.qvel[dof],
            joint_acceleration=data.qacc[dof],
            **inputs,
        )
        self.fmu.doStep(data.time, size)
        before = self.impulse
        self.impulse, self.model.dof_frictionloss[dof] = self._get("impulse", "friction")
        data.qfrc_applied[dof] = (self.impulse - before) / size

    def _set(self, **values: float) -> None:
        self.fmu.setReal([self.reference[name] for name in values], list(values.values()))

    def _get(self, *names: str) -> list[float]:
        return self.fmu.getReal([self.reference[name] for name in names])
