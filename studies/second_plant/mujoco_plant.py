"""The same kind of plant in MuJoCo: a motor joint, and behind it, with play, a joint of its own.

Play is a joint with limits between motor and output.  Friction of the output against the bench,
which is not friction in the play, is that of a tendon that measures the whole angle.  Friction is
a soft constraint in MuJoCo: at rest it creeps, how much is a choice of ``stiff``.  Stribeck's
excess and a regularised law are none of its own: ``rigs`` never asks for them here.
"""

from __future__ import annotations

from typing import Any

from servo_models.errors import UserError
from studies.second_plant.two_mass import Drive

STEP = 1e-4  # longest step [s]
LONGEST_ARM, EARTH = 0.1, 9.81
"""Distance [m] of the centre of mass, at most, and gravity [m/s2]."""
TINY = 1e-7  # inertia [kg m2] of the motor's body, which only carries the armature
STIFF = 'solreffriction="0.002 1" solimpfriction="0.99 0.9999 0.001 0.5 2"'
"""Friction that hardly creeps; without it MuJoCo's default, which does."""


def engine() -> Any:
    """Return MuJoCo.

    Raises:
        UserError: it is not installed.
    """
    try:
        import mujoco
    except ImportError as error:
        raise UserError(
            "MuJoCo is not installed: 'pip install \"servo-models[benchmark]\"', or give"
            " '--engines two_mass'"
        ) from error
    return mujoco


def scene(drive: Drive, stiff: bool) -> str:
    """Return the model in MuJoCo's XML."""
    arm = LONGEST_ARM
    if drive.gravity:  # at most half of the inertia is that of the mass on its arm
        arm = min(arm, 0.5 * drive.output_inertia * EARTH / drive.gravity)
    mass = drive.gravity / (EARTH * arm)
    own = drive.output_inertia - mass * arm * arm  # about the centre of mass
    hard = STIFF if stiff else ""
    half = 0.5 * drive.play
    gear = f"""
        <joint name="play" axis="0 1 0" limited="true" range="{-half} {half}"
               solreflimit="0.002 1"/>"""
    about = drive.torque_constant / drive.resistance
    most = drive.torque_limit
    limit = f' forcelimited="true" forcerange="{-most} {most}"' if most else ""
    return f"""
<mujoco>
  <compiler angle="radian"/>
  <option timestep="{STEP}" gravity="0 0 -{EARTH}" integrator="implicitfast" tolerance="1e-10"/>
  <worldbody>
    <body name="motor">
      <joint name="motor" axis="0 1 0" armature="{drive.motor_inertia}"
             damping="{drive.motor_drag}" frictionloss="{drive.motor_friction}" {hard}/>
      <inertial pos="0 0 0" mass="{TINY}" diaginertia="{TINY} {TINY} {TINY}"/>
      <body name="output" euler="0 {drive.phase} 0">{gear if drive.play else ""}
        <inertial pos="0 0 -{arm}" mass="{max(mass, TINY)}" diaginertia="{own} {own} {own}"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="output" damping="{drive.output_drag}"
           frictionloss="{drive.output_friction}" {hard}>
      <joint joint="motor" coef="1"/>{'<joint joint="play" coef="1"/>' if drive.play else ""}
    </fixed>
  </tendon>
  <actuator>
    <general joint="motor" gainprm="{about}" biastype="affine"
             biasprm="0 0 {-about * drive.torque_constant}"{limit}/>
  </actuator>
</mujoco>"""


class MujocoPlant:
    """The plant with its state."""

    def __init__(self, drive: Drive, stiff: bool = True) -> None:
        self._mujoco = engine()
        self.model = self._mujoco.MjModel.from_xml_string(scene(drive, stiff))
        self.data = self._mujoco.MjData(self.model)

    def angle(self) -> float:
        """Angle [rad] of the output."""
        return float(self.data.qpos.sum())

    def advance(self, voltage: float, seconds: float) -> None:
        """Hold a voltage on the motor for some time, in whole steps."""
        self.data.ctrl[0] = voltage
        self._mujoco.mj_step(self.model, self.data, nstep=round(seconds / STEP))
