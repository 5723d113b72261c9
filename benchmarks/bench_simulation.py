"""Speed of the compiled simulation, beside MuJoCo's in the same run.

    pip install -e '.[benchmark]' && python benchmarks/bench_simulation.py

Every figure is the best of several runs of whole simulations, effects compiled in.  The
command is a square wave, so that dead zone, limits and stops are crossed again and again.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable

import numpy as np

from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array

RUNS = 9
MUJOCO_SERVO = """
<mujoco><option timestep="0.001" integrator="implicitfast"/>
  <worldbody><body><joint name="output" type="hinge" axis="0 0 1" damping="0.01"
      frictionloss="0.002" range="-90 90" limited="true"/>
    <geom type="box" size=".02 .005 .002" mass="0.005"/></body></worldbody>
  <actuator><position joint="output" kp="0.5" ctrlrange="-1.5 1.5" forcerange="-.18 .18"/>
  </actuator></mujoco>
"""


def best(run: Callable[[], object]) -> float:
    """Shortest duration of ``run`` [s]; the first call, which compiles, does not count."""
    run()
    durations = []
    for _ in range(RUNS):
        begin = time.perf_counter()
        run()
        durations.append(time.perf_counter() - begin)
    return min(durations)


def square_wave(chosen: Model, times: Array) -> Array:
    """Inputs at rest, the main one switching between rest and its standard step 5 times."""
    name, size = chosen.actuator.step
    columns = []
    for wire in chosen.plant.inputs:
        column = np.full(len(times), float(wire.rest))
        if wire.name == name:
            column[np.sin(10.0 * np.pi * times / times[-1]) > 0.0] = size
        columns.append(column)
    return np.column_stack(columns)


def simulation(chosen: Model, duration: float, step: float) -> float:
    times = np.linspace(0.0, duration, round(duration / step) + 1)
    inputs = square_wave(chosen, times)
    start = chosen.start()
    return best(lambda: chosen.run(times, inputs, start.copy()))


def all_effects(name: str, variant: str) -> Model:
    """A variant with every effect active at its typical value."""
    neutral = model(name, variant)
    switches = {
        key: parameter.param.typical
        for key, parameter in neutral.plant.parameters.items()
        if parameter.param.switch and neutral.values[key] == 0.0
    }
    return model(name, variant, switches)


def mujoco_servo(steps: int) -> float | None:
    """A comparable servo in MuJoCo through its compiled roll-out; None if not installed."""
    try:
        import mujoco
        from mujoco import rollout
    except ImportError:
        return None
    servo = mujoco.MjModel.from_xml_string(MUJOCO_SERVO)
    data = mujoco.MjData(servo)
    state = np.zeros(mujoco.mj_stateSize(servo, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    control = np.sign(np.sin(np.linspace(0.0, 10.0 * np.pi, steps)))[None, :, None]
    return best(lambda: rollout.rollout(servo, data, state[None, :], control))


def main() -> None:
    cases = [
        ("sg90", "printed", 60.0, 0.02),
        ("sg90", "printed", 60.0, 0.001),
        ("sg90", "measured", 60.0, 0.001),
        ("torque_motor", "identified", 4.0, 0.001),
    ]
    mujoco_time = mujoco_servo(60_000)
    print(f"{'actuator':24} {'grid':>6} {'neutral':>9} {'all active':>11} {'ratio':>6}")
    for name, variant, duration, step in cases:
        neutral = simulation(model(name, variant), duration, step)
        active = simulation(all_effects(name, variant), duration, step)
        print(
            f"{f'{name} {variant}':24} {step * 1e3:4.0f}ms {neutral * 1e3:6.2f} ms"
            f" {active * 1e3:8.2f} ms {active / neutral:6.1f}"
        )
        if mujoco_time and name == "sg90":
            print(f"{'':24} MuJoCo takes {mujoco_time / neutral:.0f} times as long for 60 s")
    if mujoco_time:
        print(f"MuJoCo servo, 60 000 steps of 1 ms: {mujoco_time * 1e3:.0f} ms")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"peak memory {peak:.0f} MiB")


if __name__ == "__main__":
    main()

# Result: two cores, CPython 3.11, numba 0.68, MuJoCo 4.0.  60 s of the SG90, 4 s of the torque
# motor; the grid is that of the communication points.
#
# actuator                   grid   neutral  all active  ratio
# sg90 printed               20ms   1.20 ms    10.90 ms    9.1
#                          MuJoCo takes 93 times as long for 60 s
# sg90 printed                1ms   3.65 ms    23.08 ms    6.3
#                          MuJoCo takes 31 times as long for 60 s
# sg90 measured               1ms   3.76 ms    20.91 ms    5.6
#                          MuJoCo takes 30 times as long for 60 s
# torque_motor identified     1ms   1.65 ms    15.07 ms    9.2
# MuJoCo servo, 60 000 steps of 1 ms: 111 ms
# peak memory 185 MiB
