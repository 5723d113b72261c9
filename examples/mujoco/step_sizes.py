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
ACCURATE, STABLE = 0.01, 1.0  # largest error, as a part of the largest angle


def error(name: str, folder: str, step: float, integrator: str) -> float:
    """Largest difference of the angles, as a part of the largest angle."""
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
            return np.inf
    servo.close()
    own = sm.simulate(sm.model(name), times, {command: value}).outputs
    exact = own["position" if "position" in own else "angle"]
    return np.max(np.abs(angles - exact)) / np.max(np.abs(exact))


def longest(name: str, folder: str, integrator: str) -> tuple[float, float]:
    """Longest steps [s] with which, and with a shorter one, the run is accurate, and stable."""
    step, found, passed = RUNS[name][3] / 40.0, {}, {ACCURATE: 0, STABLE: 0}
    while ACCURATE not in found:
        off = error(name, folder, step, integrator)
        for limit in passed.keys() - found.keys():
            passed[limit] = passed[limit] + 1 if off <= limit else 0
            if passed[limit] == 2:
                found[limit] = step * SMALLER
        step /= SMALLER
    return found[ACCURATE], found[STABLE]


def main() -> None:
    print(f"{'actuator':14}{'integrator':12}{'1 %':>10}{'stable':>10}{'error at 1 ms':>18}")
    for name in RUNS:
        folder = fmpy.extract(str(Path(sys.argv[1]) / f"{name}_torque.native.fmu"))
        for integrator in ("RK4", "Euler"):
            accurate, stable = longest(name, folder, integrator)
            at_1_ms = 100.0 * error(name, folder, 1e-3, integrator)
            steps = f"{1e3 * accurate:7.2g} ms{1e3 * stable:7.2g} ms"
            print(f"{name:14}{integrator:12}{steps}{at_1_ms:16.2g} %", flush=True)


if __name__ == "__main__":
    main()
