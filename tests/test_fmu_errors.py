"""Bad calls: each is refused with an FMI error and a sentence that says what is wrong."""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmu_host import Host

from servo_models.errors import UserError
from servo_models.validation.subject import Subject

Files = Callable[[str], Path]
FATAL = 4
ERROR = 3


@pytest.fixture
def host(fmu_folder: Files) -> Iterator[Host]:
    """A torque motor that has made one step of 1 ms."""
    with Host(fmu_folder("torque_motor")) as made:
        made.start({"voltage": 10.0})
        made.fmu.doStep(0.0, 1e-3)
        yield made


def refused(host: Host, call: Callable[[], object], *parts: str) -> None:
    """The call fails, the logger says why, and the run cannot go on with wrong numbers."""
    assert host.messages == []
    with pytest.raises(FMICallException) as caught:
        call()
    assert caught.value.status >= ERROR
    status, text = host.messages[0]
    assert status == FATAL
    for part in parts:
        assert part in text
    with pytest.raises(FMICallException):
        host.fmu.doStep(1e-3, 1e-3)
    assert "cannot step" in host.messages[-1][1]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["voltage", "gain_error.error"])
def test_a_value_that_is_not_finite(host: Host, name: str, value: float) -> None:
    refused(host, lambda: host.set({name: value}), f"'{name}'", "not finite", "give a number in")


@pytest.mark.parametrize(("name", "value"), [("voltage", 1e5), ("transport_delay.time", -1e-3)])
def test_a_value_outside_its_bounds(host: Host, name: str, value: float) -> None:
    refused(host, lambda: host.set({name: value}), f"'{name}' = ", "is outside [", "choose a value")


def test_a_fixed_parameter_after_initialisation(host: Host) -> None:
    refused(
        host,
        lambda: host.set({"internal_step": 5e-5}),
        "'internal_step' is a fixed parameter",
        "set it before initialisation ends",
    )


def test_an_output_cannot_be_set(host: Host) -> None:
    refused(host, lambda: host.set({"angle": 0.0}), "'angle' is an output")


def test_an_unknown_value_reference(host: Host) -> None:
    refused(host, lambda: host.fmu.getReal([10_000]), "10000", "this FMU has 0 to")


def test_an_unknown_value_reference_to_set(host: Host) -> None:
    refused(host, lambda: host.fmu.setReal([10_000], [0.0]), "10000", "this FMU has 0 to")


@pytest.mark.parametrize("kind", ["Integer", "String"])
def test_a_type_that_no_variable_has(host: Host, kind: str) -> None:
    refused(host, lambda: getattr(host.fmu, f"get{kind}")([0]), f"no {kind}")


@pytest.mark.parametrize("size", [0.0, -1e-3, math.nan, math.inf])
def test_a_step_that_is_not_positive_and_finite(host: Host, size: float) -> None:
    refused(host, lambda: host.fmu.doStep(1e-3, size), "must be positive and finite")


@pytest.mark.parametrize("time", [0.0, 2e-3, math.nan])
def test_a_step_that_does_not_follow(host: Host, time: float) -> None:
    refused(host, lambda: host.fmu.doStep(time, 1e-3), "last one ended at t = 0.001 s")


def test_a_step_beyond_the_stop_time(fmu_folder: Files) -> None:
    with Host(fmu_folder("torque_motor")) as host:
        host.start(stop=2e-3)
        host.fmu.doStep(0.0, 1e-3)
        host.fmu.doStep(1e-3, 1e-3)
        refused(host, lambda: host.fmu.doStep(2e-3, 1e-3), "beyond the stop time")


def test_a_step_before_initialisation(fmu_folder: Files) -> None:
    with Host(fmu_folder("torque_motor")) as host:
        refused(host, lambda: host.fmu.doStep(0.0, 1e-3), "it is not initialised")


def test_a_step_after_termination(host: Host) -> None:
    host.fmu.terminate()
    refused(host, lambda: host.fmu.doStep(1e-3, 1e-3), "it was terminated")


def test_a_start_time_that_is_not_finite(fmu_folder: Files) -> None:
    with Host(fmu_folder("torque_motor")) as host:
        refused(host, lambda: host.fmu.setupExperiment(startTime=math.nan), "start time nan")


@pytest.mark.parametrize("stop", [0.5, math.nan])
def test_a_stop_time_before_the_start(fmu_folder: Files, stop: float) -> None:
    with Host(fmu_folder("torque_motor")) as host:
        refused(
            host,
            lambda: host.fmu.setupExperiment(startTime=1.0, stopTime=stop),
            "is not after the start",
        )


def test_a_fault_of_an_effect(fmu_folder: Files) -> None:
    """More edges within the delay than its line holds."""
    with Host(fmu_folder("torque_motor")) as host:
        host.start({"transport_delay.time": 0.02})

        def many_edges() -> None:
            for k in range(1000):
                host.set({"voltage": float(k % 7)})
                host.fmu.doStep(k * 1e-5, 1e-5)

        with pytest.raises(FMICallException):
            many_edges()
        assert "the delay line is full" in host.messages[0][1]
        assert host.messages[0][0] == FATAL


def test_a_state_of_another_fmu(host: Host, fmu_folder: Files) -> None:
    with Host(fmu_folder("sg90")) as other:
        other.start()
        content = other.fmu.serializeFMUstate(other.fmu.getFMUstate())
    state = host.fmu.deSerializeFMUstate(content)
    refused(host, lambda: host.fmu.setFMUstate(state), "saved by another FMU")


@pytest.mark.parametrize("content", [b"", b"\xff\x00 garbage", b"[1, 2]"])
def test_a_damaged_state(host: Host, content: bytes) -> None:
    state = host.fmu.deSerializeFMUstate(content)
    refused(host, lambda: host.fmu.setFMUstate(state), "damaged")


def test_reset_after_an_error_and_many_errors_leave_the_host_alive(host: Host) -> None:
    """pythonfmu's binary loses references on an exception; unprotected, this crashes."""
    for _ in range(20):
        with pytest.raises(FMICallException):
            host.set({"voltage": math.nan})
    host.fmu.reset()
    host.start({"voltage": 10.0})
    host.fmu.doStep(0.0, 1e-3)
    assert math.isfinite(host.get()[0])


def test_a_failed_instance_can_go_back_to_a_saved_state(host: Host) -> None:
    saved = host.fmu.getFMUstate()
    before = host.get()
    with pytest.raises(FMICallException):
        host.set({"voltage": math.nan})
    host.fmu.setFMUstate(saved)
    assert host.get() == before
    host.fmu.doStep(1e-3, 1e-3)
    host.fmu.freeFMUstate(saved)


def test_each_of_two_instances_hears_its_own_error(fmu_file: Files) -> None:
    subject = Subject(fmu_file("torque_motor"))
    values, rest = subject.model.values, np.zeros(2)
    with subject.instance(values, 0.0, rest) as one, subject.instance(values, 0.0, rest) as other:
        with pytest.raises(UserError, match="'voltage' = nan is not finite"):
            one.step(0.0, 1e-3, np.array([math.nan, 0.0]))
        with pytest.raises(UserError, match="'load_torque' = inf is not finite"):
            other.step(0.0, 1e-3, np.array([0.0, math.inf]))
    subject.close()


def test_an_fmu_that_a_command_has_run_leaves_other_hosts_their_logger(fmu_file: Files) -> None:
    """fmpy's native logger is one for the process: taken over, it calls what is freed."""
    script = (
        "import fmpy, gc, sys\n"
        "from servo_models.validation.subject import Subject\n"
        "subject = Subject(sys.argv[1])\n"
        "subject.run(subject.model, [0.0, 1e-3], [[0.0, 0.0], [0.0, 0.0]])\n"
        "subject.close()\n"
        "gc.collect()\n"
        "try:\n"
        "    values = {'voltage': 1e5}\n"
        "    fmpy.simulate_fmu(sys.argv[1], start_values=values, debug_logging=True)\n"
        "except fmpy.fmi1.FMICallException as error:\n"
        "    print(error.status)\n"
    )
    command = [sys.executable, "-c", script, str(fmu_file("torque_motor"))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert "[FATAL]" in done.stdout
    assert "'voltage' = 100000 is outside [" in done.stdout
    assert done.stdout.splitlines()[-1] == str(FATAL)
