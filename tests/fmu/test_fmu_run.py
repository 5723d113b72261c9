"""An FMU against the in-process simulation, against itself and under a second master."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest

from servo_models.build import build
from servo_models.catalogue import actuators, model
from servo_models.core.simulate import Model
from tests.conftest import MODELS
from tests.support.fmu_host import Array, Host
from tests.support.kinds import fmi2_only
from tests.support.masters import stepped

Files = Callable[[str], Path]

LENGTH = {"sg90": 0.6, "torque_motor": 0.12}  # s: some frames of the servo, fast steps of the motor


def irregular(stop: float) -> Array:
    """Communication points."""
    sizes = np.random.default_rng(3).uniform(0.2e-3, 1.2e-3, 4000)
    points = np.concatenate([[0.0], np.cumsum(sizes)])
    return np.append(points[points < stop - 1e-4], stop)


def commands(chosen: Model, times: Array) -> Array:
    """Inputs that jump every now and then, within a tenth of their full scale around rest."""
    rng = np.random.default_rng(11)
    columns = []
    for wire in chosen.plant.inputs:
        levels = float(wire.rest) + 0.4 * wire.scale * rng.uniform(-1.0, 1.0, 12)
        held = np.clip(levels, wire.low, wire.high)
        columns.append(held[12 * np.arange(len(times)) // len(times)])
    return np.column_stack(columns)


def halves(name: str) -> tuple[Model, Array, Array, int]:
    chosen, times = model(*MODELS[name]), irregular(LENGTH[name])
    return chosen, times, commands(chosen, times), len(times) // 2


def test_a_saved_state_does_not_move_with_the_instance(fmu_folder: Files) -> None:
    _, times, inputs, half = halves("sg90")
    with Host(fmu_folder("sg90")) as host:
        host.simulate(times[: half + 1], inputs[: half + 1])
        state = host.fmu.getFMUstate()
        before = host.fmu.serializeFMUstate(state)
        at_save = host.get()
        host.fmu.setFMUstate(state)
        assert host.get() == at_save
        assert host.fmu.serializeFMUstate(state) == before
        host.fmu.freeFMUstate(state)


def test_two_instances_and_two_fmus_do_not_disturb_each_other(fmu_folder: Files) -> None:
    """Four instances of two FMUs, stepped in turn in one process."""
    names = ("sg90", "torque_motor", "sg90", "torque_motor")
    times = 0.7e-3 * np.arange(172.0)
    chosen = [model(*MODELS[name]) for name in names]
    inputs = [commands(m, times) * (1.0 if k < 2 else 1.01) for k, m in enumerate(chosen)]
    hosts = [Host(fmu_folder(name)) for name in names]
    found: list[list[list[float]]] = []
    for host, values in zip(hosts, inputs):
        host.start(dict(zip(host.inputs, values[0])))
        found.append([host.get()])
    for k in range(len(times) - 1):
        for host, values, rows in zip(hosts, inputs, found):
            host.set(dict(zip(host.inputs, values[k])))
            host.fmu.doStep(times[k], times[k + 1] - times[k])
            rows.append(host.get())
    for host in hosts:
        host.fmu.freeInstance()
    for rows, m, values in zip(found, chosen, inputs):
        assert np.array_equal(np.array(rows), m.run(times, values))


def test_two_variants_of_one_actuator_in_one_process(tmp_path: Path) -> None:
    """Same model identifier, same file name: the second must not run the first one's code."""
    times = np.arange(0.0, 0.1, 1e-3)
    for variant in ("identified", "measured"):
        chosen = model("torque_motor", variant)
        inputs = commands(chosen, times)
        path = build(chosen, tmp_path / variant / "torque_motor.fmu")
        folder = Path(fmpy.extract(str(path), str(tmp_path / variant / "extracted")))
        with Host(folder) as host:
            assert np.array_equal(host.simulate(times, inputs), chosen.run(times, inputs))


def test_reset_gives_a_fresh_instance(fmu_folder: Files) -> None:
    chosen, times, inputs, _ = halves("torque_motor")
    with Host(fmu_folder("torque_motor")) as host:
        host.simulate(times, inputs, {"gain_error.error": 0.3, "transport_delay.time": 0.004})
        host.fmu.reset()
        again = host.simulate(times, inputs)
    assert np.array_equal(again, chosen.run(times, inputs))


def test_a_tunable_parameter_changes_the_run_from_then_on(fmu_folder: Files) -> None:
    """Against two in-process runs, the second from the state that the first one left."""
    chosen, times, inputs, half = halves("torque_motor")
    change = {"voltage_offset.value": 4.0, "viscous_friction.torque": 0.01}
    changed = model("torque_motor", None, change)
    with Host(fmu_folder("torque_motor")) as host:
        first = host.simulate(times[: half + 1], inputs[: half + 1])
        host.set(change)
        second = host.run(times[half:], inputs[half:])
    state = chosen.start()
    expected = chosen.run(times[: half + 1], inputs[: half + 1], state)
    rest = changed.run(times[half:], inputs[half:], state)
    assert np.array_equal(first, expected)
    assert np.array_equal(second[1:], rest[1:])
    assert not np.array_equal(rest[1:], chosen.run(times, inputs)[half + 1 :])


def test_an_effect_that_wakes_up_in_mid_run_begins_at_rest(fmu_folder: Files) -> None:
    """A filter that wakes up at 0 V instead of the sensor's 3.75 V would kick the servo."""
    times = np.arange(0.0, 0.3, 1e-3)
    chosen = model("sg90", "linear")
    held = np.tile([float(w.rest) for w in chosen.plant.inputs], (len(times), 1))
    half = len(times) // 2
    with Host(fmu_folder("sg90_linear")) as host:
        host.simulate(times[: half + 1], held[: half + 1])
        host.set({"sensor_lag.time_constant": 0.01})
        found = host.run(times[half:], held[half:])
    angle = found[:, host.outputs.index("angle")]
    assert len(angle) == len(times) - half
    assert np.max(np.abs(angle)) < 1e-12


def test_a_restored_state_is_that_which_was_saved(fmu_folder: Files) -> None:
    """An effect whose parameter is 0 at that moment, and back before the next step, sleeps in
    neither run."""
    runs = []
    for restored in (False, True):
        with Host(fmu_folder("sg90_linear")) as host:
            host.start({"pulse_width": 1.6e-3, "sensor_lag.time_constant": 0.01})
            host.fmu.doStep(0.0, 0.02)
            host.set({"sensor_lag.time_constant": 0.0})
            if restored:
                host.fmu.setFMUstate(host.fmu.getFMUstate())
            host.set({"sensor_lag.time_constant": 0.01})
            host.fmu.doStep(0.02, 0.002)
            runs.append(host.get())
    assert runs[0] == runs[1]


def test_initial_outputs_follow_inputs_and_parameters(fmu_folder: Files) -> None:
    """Before the first step, against the definition: u = K_AP (U_in - K_f k_FS theta)."""
    with Host(fmu_folder("sg90_linear")) as host:
        host.fmu.setupExperiment()
        host.fmu.enterInitializationMode()
        host.set({"pulse_width": 1.6e-3})
        column = host.outputs.index("motor_voltage")
        one = host.get()[column]
        host.set({"pulse_width": 1.7e-3, "amplifier_gain": 2.0 * 7.47})
        two = host.get()[column]
    volts_per_second = 5.0 / 20e-3
    assert one == pytest.approx(7.47 * volts_per_second * 0.1e-3, rel=1e-9)
    assert two == pytest.approx(2.0 * 7.47 * volts_per_second * 0.2e-3, rel=1e-9)


@pytest.mark.thorough
@fmi2_only
@pytest.mark.parametrize("name", actuators())
def test_libcosim_gives_the_same_trajectory(name: str, fmu_file: Files) -> None:
    """A second master, written in C++ by other people; its clock counts nanoseconds."""
    reason = "libcosimpy, the second master, is not installed: pip install libcosimpy==0.0.6"
    pytest.importorskip("libcosimpy", reason=reason)
    chosen, times = model(*MODELS[name]), np.arange(101) * 1_000_000 / 1e9
    inputs = commands(chosen, times)
    columns = dict(zip([wire.name for wire in chosen.plant.inputs], inputs[:-1].T))
    found = stepped("libcosim", fmu_file(name), 1e-3, columns, chosen.plant.outputs)
    assert np.ptp(found[:, 0]) > 0.0
    assert np.array_equal(found, chosen.run(times, inputs)[1:])


@pytest.mark.thorough
def test_a_process_that_ran_several_fmus_ends_in_peace(fmu_file: Files) -> None:
    """pythonfmu's library counts down a freed reference at exit, for which glibc aborts."""
    script = (
        "import sys, fmpy\n"
        "for path in 3 * sys.argv[1:]:\n"
        "    assert fmpy.simulate_fmu(path, stop_time=0.1)['time'][-1] == 0.1\n"
    )
    paths = [str(fmu_file(name)) for name in ("sg90", "torque_motor", "measured")]
    for _ in range(3):
        done = subprocess.run(
            [sys.executable, "-c", script, *paths], capture_output=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, b"")
