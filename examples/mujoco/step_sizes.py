"""The longest engine step of every torque-causal form: with 1 % of error, and stable at all.

python step_sizes.py FOLDER_OF_FMUS

The joint has the geared rotor and nothing else, the worst case: a link adds inertia, which slows
all motion down.  A step of the command is simulated and compared with the angle-causal form.
"""

from __future__ import annotations

import sys
from pathlib import Path

import fmpy
import mujoco
import numpy as np
from servo_joint import ServoJoint

import servo_models as sm

SCENE = """
<mujoco>
  <option timestep="{step}" integrator="{integrator}" gravity="0 0 0"/>
  <worldbody><body>
    <joint name="servo" type="{kind}" axis="0 1 0"/>
    <inertial pos="1e-3 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/>
  </body></worldbody>
</mujoco>
"""
RUNS = {
    "sg90": ("hinge", "pulse_width", 1.52e-3, 2.0),  # the command [SI] and the duration [s]
    "torque_motor": ("hinge", "voltage", 20.0, 0.15),
    "linear_drive": ("slide", "reference", 1e-3, 0.8),
    "smart_servo": ("hinge", "goal", 0.5, 2.0),
}
SMALLER = 1.15
ACCURATE, STABLE = 0.01, 0.05
"""Largest error, and largest in the last quarter, where all has settled; of the largest angle."""


def errors(name: str, folder: str, step: float, integrator: str) -> tuple[float, float]:
    """Return the largest difference of the angles, and that in the last quarter."""
    kind, command, value, duration = RUNS[name]
    scene = SCENE.format(step=step, integrator=integrator, kind=kind)
    model = mujoco.MjModel.from_xml_string(scene)
    data = mujoco.MjData(model)
    servo = ServoJoint(model, data, "servo", folder)
    times = step * np.arange(round(duration / step) + 1)
    angles = np.zeros(len(times))
    for k in range(1, len(times)):
        servo.drive(**{command: value})
        mujoco.mj_step(model, data)
        angles[k] = data.qpos[0]
        if not abs(angles[k]) < 10.0:  # a stable one stays below 1
            return np.inf, np.inf
    servo.close()
    outputs = sm.simulate(sm.model(name), times, {command: value}).outputs
    exact = outputs["position" if "position" in outputs else "angle"]
    off = np.abs(angles - exact) / np.max(np.abs(exact))
    return np.max(off), np.max(off[3 * len(off) // 4 :])


def longest(name: str, folder: str, integrator: str) -> tuple[float, float]:
    """Return the longest steps [s], accurate and stable, of which the next shorter one is too."""
    step, accurate, stable = RUNS[name][3] / 20.0, [], []
    while len(accurate) < 2:
        largest, at_end = errors(name, folder, step, integrator)
        accurate = [*accurate, step] if largest <= ACCURATE else []
        if len(stable) < 2:
            stable = [*stable, step] if at_end <= STABLE else []
        step /= SMALLER
    return accurate[0], stable[0]


def main() -> None:
    print(f"{'actuator':14}{'integrator':12}{'1 %':>10}{'stable':>10}{'error at 1 ms':>18}")
    for name in RUNS:
        folder = fmpy.extract(str(Path(sys.argv[1]) / f"{name}_torque.native.fmu"))
        for integrator in ("RK4", "Euler"):
            accurate, stable = longest(name, folder, integrator)
            largest, at_end = errors(name, folder, 1e-3, integrator)
            steps = f"{1e3 * accurate:7.2g} ms{1e3 * stable:7.2g} ms"
            error = f"{100.0 * largest:.2g} %" if at_end <= STABLE else "unstable"
            print(f"{name:14}{integrator:12}{steps}{error:>18}", flush=True)


if __name__ == "__main__":
    main()
