"""An SG90 swings a link in MuJoCo, against the angle-causal model with the same load.

python swing.py fmus/sg90_torque.native.fmu
"""

from __future__ import annotations

import math
import sys

import fmpy
import mujoco
import numpy as np
from servo_joint import ServoJoint

import servo_models as sm

MASS, ARM, GRAVITY = 0.05, 0.1, 9.81  # kg, m, m/s2
SCENE = """
<mujoco>
  <option timestep="{step}" integrator="{integrator}" gravity="0 0 {gravity}"/>
  <worldbody><body>
    <joint name="servo" type="hinge" axis="0 1 0"/>
    <inertial pos="0 0 {below}" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/>
  </body></worldbody>
</mujoco>
"""
DURATION, BACK, REST, PULSE = 1.4, 0.7, 1.5e-3, 1.9e-3  # s
COMMANDED = (PULSE - REST) / (2400e-6 - 544e-6) * math.pi  # rad
FRICTION = {"coulomb_friction.level": 0.03, "stribeck_friction.excess": 0.02}
CASES = {
    "free": (0.0, {}),
    "gravity": (GRAVITY, {}),
    "friction": (0.0, FRICTION),
    "gravity and friction": (GRAVITY, FRICTION),
    "end stop at 23 deg": (GRAVITY, {"end_stops.half_range": 0.4}),
}
STEPS = (2.5e-4, 5e-4, 1e-3, 2e-3, 5e-3)  # s


def pulses(times: np.ndarray) -> np.ndarray:
    """Up at once, back later; half a nanosecond decides at the edge."""
    return np.where(times < BACK - 5e-10, PULSE, REST)


def engine(folder: str, case: str, step: float, integrator: str) -> tuple[np.ndarray, np.ndarray]:
    """Times and angles [rad] of the torque-causal form in MuJoCo."""
    gravity, parameters = CASES[case]
    scene = {"step": step, "integrator": integrator, "gravity": -gravity}
    model = mujoco.MjModel.from_xml_string(SCENE.format(**scene, below=-ARM, mass=MASS))
    data = mujoco.MjData(model)
    servo = ServoJoint(model, data, "servo", folder, parameters)
    times = step * np.arange(round(DURATION / step) + 1)
    angles = [0.0]
    for pulse in pulses(times)[:-1]:
        servo.drive(pulse_width=pulse)
        mujoco.mj_step(model, data)
        angles.append(data.qpos[0])
    servo.close()
    return times, np.array(angles)


def angle_causal(case: str, times: np.ndarray) -> np.ndarray:
    """Angles [rad] of the form that integrates the shaft itself."""
    gravity, parameters = CASES[case]
    load = {"load_inertia.inertia": MASS * ARM**2, "gravity_load.torque": MASS * gravity * ARM}
    chosen = sm.model("sg90", None, {**load, **parameters})
    return sm.simulate(chosen, times, {"pulse_width": pulses(times)})["angle"]


def error(folder: str, case: str, step: float, integrator: str) -> float:
    """Largest difference of the angles, as a part of the commanded step."""
    times, angles = engine(folder, case, step, integrator)
    return np.max(np.abs(angles - angle_causal(case, times))) / COMMANDED


def draw(folder: str, path: str) -> None:
    """Both angles at 1 kHz, and the error over the engine's step."""
    import matplotlib.pyplot as plt

    plt.rcParams.update({"svg.hashsalt": "swing", "svg.fonttype": "none", "font.size": 9})
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.0, 3.0), layout="constrained")
    for case in ("free", "gravity and friction"):
        times, angles = engine(folder, case, 1e-3, "RK4")
        own = angle_causal(case, times)
        (line,) = left.plot(times[::5], np.degrees(own[::5]), lw=3, alpha=0.4)
        left.plot(times[::5], np.degrees(angles[::5]), "--", c=line.get_color(), lw=1, label=case)
    left.set(xlabel="time [s]", ylabel="angle [deg]", ylim=(-40, 52))
    left.legend(title="band: angle-causal, dashes: MuJoCo", loc="lower left", frameon=False)
    for case, colour in (("gravity", "C0"), ("gravity and friction", "C1")):
        for integrator, style in (("RK4", "o-"), ("Euler", "s--")):
            errors = [100.0 * error(folder, case, step, integrator) for step in STEPS]
            label = f"{case}, {integrator}"
            right.loglog([1e3 * step for step in STEPS], errors, style, c=colour, label=label)
    right.axhline(1.0, color="grey", lw=0.5)
    right.set(xlabel="engine's step [ms]", ylabel="largest error [% of step]", ylim=(1e-6, 5))
    right.set_xticks([1e3 * step for step in STEPS], [f"{1e3 * step:g}" for step in STEPS])
    right.minorticks_off()
    right.legend(loc="lower right", frameon=False)
    figure.savefig(path, metadata={"Date": None})


def main() -> None:
    folder = fmpy.extract(sys.argv[1])
    print(f"{'case':22}" + "".join(f"{i} {1e3 * s:g} ms".rjust(14) for i, s in COLUMNS))
    for case in CASES:
        errors = (100.0 * error(folder, case, step, integrator) for integrator, step in COLUMNS)
        print(f"{case:22}" + "".join(f"{value:12.3f} %" for value in errors))
    draw(folder, "swing.svg")


COLUMNS = (("RK4", 1e-3), ("RK4", 2.5e-4), ("Euler", 1e-3), ("Euler", 2.5e-4))

if __name__ == "__main__":
    main()
