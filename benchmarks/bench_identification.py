"""Speed of a fit, beside the usual script: solve_ivp inside least_squares.

    python benchmarks/bench_identification.py [--lsoda]
    python benchmarks/bench_identification.py examples/real_logs/emps.toml    # its logs beside it

Both fit the same parameters to the same simulated, noisy log with the same optimiser and
tolerances, from the same start, in this run.  The script integrates from edge to edge of the
held input, as it must to be right, by the solver's default method or by LSODA, which is
faster where little happens; its estimates have to agree.  The fit of a log as long
as the EMPS benchmark runs in a process of its own, whose time and memory are told; so does the
command on a description.
"""

from __future__ import annotations

import itertools
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Channel, Log
from servo_models.identification.fit import fit

Inputs = dict[str, Array]

SOLVER = {"method": "LSODA" if "--lsoda" in sys.argv else "RK45", "rtol": 1e-7, "atol": 1e-10}
OPTIMISER = {"ftol": 1e-8, "xtol": 1e-8, "gtol": 1e-8, "diff_step": 1e-4}


@dataclass(frozen=True)
class Rig:
    """A log, the free parameters, and how a script simulates it from their values."""

    name: str
    model: Model
    log: Log
    free: tuple[str, ...]
    script: Callable[[Array], Array]


def made(
    name: str,
    chosen: Model,
    free: tuple[str, ...],
    times: Array,
    inputs: Inputs,
    script: Callable[[Array], Array],
    output: str,
    truth: Array,
    sigma: float,
) -> Rig:
    """A rig whose noisy log the script makes."""
    noise = sigma * np.random.default_rng(1).standard_normal(len(times))
    outputs = {output: script(truth) + noise}
    channels = {output: Channel(output, output, "")}
    rows = np.arange(len(times))
    log = Log(name, Path(name), "", times, inputs, outputs, channels, rows, rows < 0)
    return Rig(name, chosen, log, free, script)


def follow(rates: Callable[..., list[float]], x: Array, times: Array, held: Array) -> Array:
    """States at each time; the input is held from its row on."""
    edges = [0, *(np.flatnonzero(np.diff(held)) + 1), len(times) - 1]
    out = np.empty((len(times), len(x)))
    for begin, end in itertools.pairwise(edges):
        span = (times[begin], times[end])
        grid = times[begin : end + 1]
        run = solve_ivp(rates, span, x, t_eval=grid, args=(held[begin],), **SOLVER)
        out[begin : end + 1], x = run.y.T, run.y[:, -1]
    return out


def torque_motor() -> Rig:
    """1500 samples of a torque motor without stops: linear, three states."""
    times = 5e-4 * np.arange(1500)
    signs = np.random.default_rng(1).choice([-20.0, 20.0], 75)
    voltage = np.repeat(signs, 20)

    def script(values: Array) -> Array:
        k_t, inductance, friction = values

        def rates(_: float, x: Array, u: float) -> list[float]:
            return [
                (u - 3630.0 * x[0] - 0.08 * x[2]) / inductance,
                x[2],
                (k_t * x[0] - friction * x[2] - 1.1 * x[1]) / 7.246e-7,
            ]

        return follow(rates, np.zeros(3), times, voltage)[:, 1]

    chosen = model("torque_motor", "measured", {"end_stops.half_range": 0.0})
    free = ("torque_constant", "inductance", "friction_coefficient")
    truth = np.array([5.4, 31.0, 2.5e-4])
    return made(
        "torque motor", chosen, free, times, {"voltage": voltage}, script, "angle", truth, 2e-4
    )


def servo() -> Rig:
    """20 s of SG90 steps of several sizes at 75 Hz: the drive saturates."""
    times = np.arange(1500) / 75.0
    steps = np.repeat(np.tile([0.0, 1.0], 10) * np.repeat(np.arange(1.0, 11.0), 2), 75)
    pulse = 1.5e-3 + 80e-6 * steps
    start = model("sg90", "measured", {"transport_delay.time": 0.0})
    back = start.values["feedback_coefficient"] * start.values["potentiometer_gain"]

    def script(values: Array) -> Array:
        time_constant, motor, amplifier = values

        def rates(_: float, x: Array, u: float) -> list[float]:
            wanted = amplifier * (250.0 * (u - 1.5e-3) - back * x[0])
            volts = min(max(wanted, -5.0), 5.0)
            return [x[1] / 24.0, (motor * volts - x[1]) / time_constant]

        return follow(rates, np.zeros(2), times, pulse)[:, 0]

    free = ("motor_time_constant", "motor_gain", "amplifier_gain")
    truth = np.array([0.03, 48.0, 60.0])
    return made(
        "SG90, saturating", start, free, times, {"pulse_width": pulse}, script, "angle", truth, 5e-3
    )


def drive() -> Rig:
    """2 s of the linear drive: a controller at 1 kHz in the loop, no dry friction."""
    times = 1e-3 * np.arange(2000)
    path = 0.03 * (1.0 - np.cos(np.pi * times))

    def script(values: Array) -> Array:
        mass, viscous, offset = values

        def rates(_: float, x: Array, u: float) -> list[float]:
            return [x[1], (35.15 * u - viscous * x[1] - offset) / mass]

        x, out = np.zeros(2), np.empty(len(times))
        last = last_but_one = 0.0
        for k in range(len(times)):
            out[k] = x[0]
            speed = 0.5 * (x[0] - last_but_one) / 1e-3
            u = min(max(243.45 * (160.18 * (path[k] - x[0]) - speed), -10.0), 10.0)
            last, last_but_one = x[0], last
            x = solve_ivp(rates, (0.0, 1e-3), x, args=(u,), **SOLVER).y[:, -1]
        return out

    start = model("linear_drive", "simple")
    free = ("mass", "viscous_coefficient", "force_offset")
    truth = np.array([95.0, 210.0, -3.0])
    return made(
        "linear drive, discrete loop",
        start,
        free,
        times,
        {"reference": path},
        script,
        "position",
        truth,
        1e-6,
    )


def compare(rig: Rig) -> None:
    """Print the durations of both fits, and how far their estimates are apart."""
    start = np.array([rig.model.values[name] for name in rig.free])
    size = np.where(start == 0.0, 1.0, np.abs(start))

    def ours() -> Array:
        log = replace(rig.log)  # a log that is fitted again is not simulated again
        return fit(rig.model, [log], rig.free).values

    def script() -> Array:
        (measured,) = rig.log.outputs.values()
        spread = np.std(measured)

        def errors(share: Array) -> Array:
            return (rig.script(share * size) - measured) / spread

        return np.asarray(least_squares(errors, start / size, **OPTIMISER).x * size)

    ours()  # compiles
    fast, slow = (min((timed(it) for _ in range(3)), key=lambda it: it[0]) for it in (ours, script))
    apart = np.max(np.abs(fast[1] - slow[1]) / np.abs(slow[1]))
    print(
        f"{rig.name:28} {fast[0] * 1e3:8.0f} ms {slow[0] * 1e3:8.0f} ms"
        f" {slow[0] / fast[0]:6.0f}   {apart:.0e}"
    )


def timed(work: Callable[[], Array]) -> tuple[float, Array]:
    begin = time.perf_counter()
    found = work()
    return time.perf_counter() - begin, found


def long_log() -> None:
    """Fit 25 000 samples of the linear drive in its loop; print time and memory."""
    times = 1e-3 * np.arange(24841)
    path = 0.06 * (1.0 - np.cos(0.5 * np.pi * times)) * (1.0 + 0.2 * np.sin(0.31 * times))
    rig = model("linear_drive", "identified")
    out = rig.run(times, np.column_stack([path, 0.0 * path, 0.0 * path]))
    noise = np.random.default_rng(2).standard_normal((2, len(times)))
    outputs = {"position": out[:, 0] + 1e-6 * noise[0], "drive": out[:, 2] + 0.05 * noise[1]}
    channels = {name: Channel(name, name, "") for name in outputs}
    rows = np.arange(len(times))
    log = Log(
        "long", Path("long"), "", times, {"reference": path}, outputs, channels, rows, rows < 0
    )
    free = ["mass", "viscous_coefficient", "force_offset", "coulomb_friction.level"]
    begin = time.perf_counter()
    found = fit(model("linear_drive", "simple"), [log], free)
    spent = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    truth = np.array([rig.values[name] for name in free])
    off = np.max(np.abs(found.values - truth) / found.standard_errors)
    print(f"fit of 4 parameters to 2 x {len(times)} samples in a discrete loop")
    print(f"{spent:.2f} s, {found.evaluations} simulations, peak memory {peak:.0f} MiB")
    print(f"largest error in standard errors {off:.1f}")


def command(description: Path) -> None:
    """Print time and memory of ``servo-models identify`` on a description, as a user runs it."""
    words = [sys.executable, "-m", "servo_models", "identify", str(description)]
    begin = time.perf_counter()
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
    spent = time.perf_counter() - begin
    peak = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    print(f"servo-models identify {description.name}: {spent:.1f} s, peak memory {peak:.0f} MiB")


if __name__ == "__main__":
    if "--long" in sys.argv:
        long_log()
    elif sys.argv[-1].endswith(".toml"):
        command(Path(sys.argv[1]))
    else:
        print(f"{'fit of three parameters':28} {'ours':>11} {'script':>11} {'ratio':>6}   apart")
        for made_rig in (torque_motor, servo, drive):
            compare(made_rig())
        subprocess.run([sys.executable, __file__, "--long"], check=True)

# Result: two cores, CPython 3.11, numba 0.68; the script with the default method, then with LSODA.
#
# fit of three parameters             ours      script  ratio   apart
# torque motor                       20 ms     3532 ms    173   1e-06
# SG90, saturating                   21 ms     3562 ms    170   7e-05
# linear drive, discrete loop        13 ms     1208 ms     90   6e-04
# fit of 4 parameters to 2 x 24841 samples in a discrete loop
# 0.64 s, 77 simulations, peak memory 239 MiB
# largest error in standard errors 1.3
#
# fit of three parameters             ours      script  ratio   apart
# torque motor                       18 ms     1953 ms    111   6e-06
# SG90, saturating                   26 ms     1196 ms     46   1e-05
# linear drive, discrete loop        10 ms      961 ms     97   7e-04
#
# servo-models identify emps.toml: 2.1 s, peak memory 291 MiB
