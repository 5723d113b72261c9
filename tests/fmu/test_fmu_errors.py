"""Bad calls: each is refused with an FMI error and a sentence that says what is wrong."""

from __future__ import annotations

import ast
import hashlib
import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from servo_models.build import FMI3, NATIVE, PYTHON
from servo_models.catalogue import model
from servo_models.errors import UserError
from servo_models.validation.fmu_subject import Subject
from tests.support.fmu_host import Host, place_in_x
from tests.support.kinds import FAILED, python_only

Files = Callable[[str], Path]
Call = Callable[[Host], object]
ERROR = 3


def refused(host: Host, call: Callable[[], object], *parts: str) -> None:
    """The call fails, the logger says why, and the run cannot go on with wrong numbers."""
    assert host.messages == []
    with pytest.raises(FMICallException) as caught:
        call()
    assert caught.value.status >= ERROR
    status, text = host.messages[0]
    assert status == caught.value.status
    for part in parts:
        assert part in text
    with pytest.raises(FMICallException):
        host.fmu.doStep(1e-3, 1e-3)
    assert f"{host.prefix}DoStep after a failure" in host.messages[-1][1]


def setting(name: str, value: float) -> Call:
    return lambda host: host.set({name: value})


def stepping(time: float, size: float) -> Call:
    return lambda host: host.fmu.doStep(time, size)


NO_STEP, NO_SIZE = "last one ended at t = 0.001 s", "must be positive and finite"
BAD_CALLS: dict[str, tuple[Call, tuple[str, ...]]] = {
    **{
        f"{name} = {value}": (setting(name, value), (f"'{name}'", "not finite", "give a number in"))
        for name in ("voltage", "gain_error.error")
        for value in (math.nan, math.inf, -math.inf)
    },
    **{
        f"{name} outside": (
            setting(name, value),
            (f"'{name}' = ", "is outside [", "choose a value"),
        )
        for name, value in (("voltage", 1e5), ("transport_delay.time", -1e-3))
    },
    "a fixed parameter after initialisation": (
        setting("internal_step", 5e-5),
        ("'internal_step' is a fixed parameter", "set it before initialisation ends"),
    ),
    "an output": (setting("angle", 0.0), ("'angle' is an output",)),
    "an unknown reference": (
        lambda host: host.fmu.getReal([10_000]),
        ("10000", "this FMU has 0 to"),
    ),
    "an unknown reference to set": (
        lambda host: host.fmu.setReal([10_000], [0.0]),
        ("10000", "this FMU has 0 to"),
    ),
    "an Integer": (lambda host: host.fmu.getInteger([0]), ("this FMU has no Int",)),
    "a String": (lambda host: host.fmu.getString([0]), ("no String",)),
    **{f"a step of {h}": (stepping(1e-3, h), (NO_SIZE,)) for h in (0.0, -1e-3, math.nan, math.inf)},
    **{f"a step from {t}": (stepping(t, 1e-3), (NO_STEP,)) for t in (0.0, 2e-3, math.nan)},
    "a step that would not end": (
        stepping(1e-3, 1e9),
        ("1000000 internal steps", "that is 100 s"),
    ),
}


@pytest.mark.parametrize("name", BAD_CALLS)
def test_a_bad_call_is_refused(host: Host, name: str) -> None:
    call, parts = BAD_CALLS[name]
    refused(host, lambda: call(host), *parts)


def test_a_step_beyond_the_stop_time(fmu_folder: Files) -> None:
    with Host(fmu_folder("torque_motor")) as host:
        host.start(stop=2e-3)
        host.fmu.doStep(0.0, 1e-3)
        host.fmu.doStep(1e-3, 1e-3)
        refused(host, lambda: host.fmu.doStep(2e-3, 1e-3), "beyond the stop time")


def test_a_step_before_initialisation(fmu_folder: Files) -> None:
    with Host(fmu_folder("torque_motor")) as host:
        refused(host, lambda: host.fmu.doStep(0.0, 1e-3), "DoStep before initialisation")


def test_a_step_after_termination(host: Host) -> None:
    host.fmu.terminate()
    refused(host, lambda: host.fmu.doStep(1e-3, 1e-3), "DoStep after termination")


@pytest.mark.parametrize("late", [0.0, 2.0])
def test_far_from_0_no_step_is_repeated_or_left_out(fmu_folder: Files, late: float) -> None:
    """At a time as of a clock, seconds since 1970, where a step is less than 1e-9 of the time."""
    begin, step = 1.6e9, 1.0 / 512.0
    with Host(fmu_folder("torque_motor")) as host:
        host.fmu.setupExperiment(startTime=begin)
        host.fmu.enterInitializationMode()
        host.fmu.exitInitializationMode()
        host.fmu.doStep(begin, step)
        refused(host, lambda: host.fmu.doStep(begin + late * step, step), "steps must follow")


@pytest.mark.parametrize("begin", [1e12, -1e12, 1e17])
def test_a_step_shorter_than_numbers_can_tell(fmu_folder: Files, begin: float) -> None:
    """It would not end, or nothing would move."""
    with Host(fmu_folder("torque_motor")) as host:
        host.fmu.setupExperiment(startTime=begin)
        host.fmu.enterInitializationMode()
        host.fmu.exitInitializationMode()
        refused(host, lambda: host.fmu.doStep(begin, 0.02), "too coarse", "nearer to 0")


def begin(host: Host, start: float, stop: float | None) -> None:
    host.fmu.setupExperiment(startTime=start, stopTime=stop)
    host.fmu.enterInitializationMode()


def test_a_start_time_that_is_not_finite(fmu_folder: Files) -> None:
    with Host(fmu_folder("torque_motor")) as host:
        refused(host, lambda: begin(host, math.nan, None), "start time nan")


@pytest.mark.parametrize("stop", [0.5, math.nan])
def test_a_stop_time_before_the_start(fmu_folder: Files, stop: float) -> None:
    with Host(fmu_folder("torque_motor")) as host:
        refused(host, lambda: begin(host, 1.0, stop), "is not after the start")


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
        assert host.messages[0][0] >= ERROR


def restore(host: Host, content: bytes) -> None:
    """A Python FMU refuses damaged bytes as a state, a native one at once."""
    host.fmu.setFMUstate(host.fmu.deSerializeFMUstate(content))


def test_a_state_of_another_fmu(host: Host, fmu_folder: Files) -> None:
    with Host(fmu_folder("sg90")) as other:
        other.start()
        content = other.fmu.serializeFMUstate(other.fmu.getFMUstate())
    refused(host, lambda: restore(host, content), "saved by another FMU")


@pytest.mark.parametrize("content", [b"", b"\xff\x00 garbage", b"[1, 2]"])
def test_a_damaged_state(host: Host, content: bytes) -> None:
    refused(host, lambda: restore(host, content), "damaged")


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


@pytest.mark.thorough
def test_an_fmu_that_a_command_has_run_leaves_other_hosts_their_logger(
    fmu_file: Files, kind: str
) -> None:
    """fmpy's native logger is one for the process: taken over, it calls what is freed."""
    script = (
        "import fmpy, gc, sys\n"
        "from servo_models.validation.fmu_subject import Subject\n"
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
    assert done.returncode == 0
    if kind == PYTHON:  # which never learns whether its host shows messages
        assert done.stderr.startswith("torque_motor: 'voltage' = 100000 is outside [")
        assert len(done.stderr.splitlines()) == 1
    assert {PYTHON: "[FATAL]", NATIVE: "[ERROR]", FMI3: "[ERROR]"}[kind] in done.stdout
    assert "'voltage' = 100000 is outside [" in done.stdout
    assert done.stdout.splitlines()[-1] == str(FAILED[kind])


# What a stranger found


@python_only
@pytest.mark.parametrize("reference", [2**31, 2**32 - 1, 2**32 - 3])
def test_a_value_reference_that_arrives_negative(host: Host, reference: int) -> None:
    """pythonfmu hands value references on as signed numbers, which count from the end of a list."""
    refused(host, lambda: host.fmu.getReal([reference]), f"value reference {reference}: ")
    host.fmu.reset()
    host.messages.clear()
    host.start({"voltage": 10.0})
    saved = held(host)
    with pytest.raises(FMICallException):
        host.fmu.setReal([reference], [0.5])
    assert held(host)["values"] == saved["values"]


def held(host: Host) -> dict[str, Any]:
    """What the instance holds, read out of its serialised state."""
    state = host.fmu.getFMUstate()
    content = json.loads(bytes(host.fmu.serializeFMUstate(state)))
    host.fmu.freeFMUstate(state)
    found: dict[str, Any] = json.loads(content["state"])
    return found


@python_only
def test_of_one_call_all_values_count_or_none(host: Host) -> None:
    before = held(host)["values"]
    with pytest.raises(FMICallException):
        host.set({"voltage": 20.0, "load_torque": 0.01, "gain_error.error": math.nan})
    assert held(host)["values"] == before


@pytest.mark.parametrize("name", ["voltage", "stiffness"])
def test_a_refused_value_in_initialisation_is_not_forgotten(fmu_folder: Files, name: str) -> None:
    with Host(fmu_folder("torque_motor")) as host:
        host.fmu.setupExperiment(startTime=0.0)
        host.fmu.enterInitializationMode()
        with pytest.raises(FMICallException):
            host.set({name: math.nan})
        for call in (
            lambda: host.set({name: 1.0}),
            host.get,
            host.fmu.exitInitializationMode,
            lambda: host.fmu.doStep(0.0, 1e-3),
        ):
            with pytest.raises(FMICallException):
                call()
            assert f"after a failure ('{name}' = nan is not finite" in host.messages[-1][1]
        host.fmu.reset()
        host.start({name: 1.0})
        host.fmu.doStep(0.0, 1e-3)


OUT_OF_ORDER: list[tuple[list[str], str, str]] = [
    ([], "exitInitializationMode", "before initialisation"),
    ([], "terminate", "before initialisation"),
    (["setup", "enter"], "setupExperiment", "in initialisation"),
    (["setup", "enter"], "enterInitializationMode", "in initialisation"),
    (["setup", "enter"], "doStep", "in initialisation"),
    (["setup", "enter"], "terminate", "in initialisation"),
    (["setup", "enter", "exit"], "setupExperiment", "between communication steps"),
    (["setup", "enter", "exit"], "enterInitializationMode", "between communication steps"),
    (["setup", "enter", "exit"], "exitInitializationMode", "between communication steps"),
    (["setup", "enter", "exit", "end"], "terminate", "after termination"),
    (["setup", "enter", "exit", "end"], "doStep", "after termination"),
    (["setup", "enter", "exit", "end"], "setReal", "after termination"),
]


@pytest.mark.parametrize(("before", "call", "where"), OUT_OF_ORDER)
def test_a_call_out_of_order_is_named(
    fmu_folder: Files, kind: str, before: list[str], call: str, where: str
) -> None:
    if kind == FMI3 and call == "setupExperiment":
        pytest.skip("FMI 3.0 has no such call")
    with Host(fmu_folder("torque_motor")) as host:
        calls = {
            "setup": lambda: host.fmu.setupExperiment(startTime=0.0),
            "enter": host.fmu.enterInitializationMode,
            "exit": host.fmu.exitInitializationMode,
            "end": host.fmu.terminate,
        }
        for name in before:
            calls[name]()
        arguments = {"doStep": (0.0, 1e-3), "setReal": ([0], [1.0])}.get(call, ())
        with pytest.raises(FMICallException):
            getattr(host.fmu, call)(*arguments)
        assert where in host.messages[-1][1]


def test_internal_steps_are_counted_as_an_effect_shortens_them(fmu_folder: Files) -> None:
    """0.13 rad a step of the resonance of 1e-4 rad/(N.m) and two inertias [kg.m2]."""
    values = {"gear_compliance.compliance": 1e-4, "gear_compliance.inertia": 1e-5}
    own = model("torque_motor").values["rotor_inertia"]
    longest = 1e6 * 0.13 * math.sqrt(1e-4 / (1.0 / 1e-5 + 1.0 / own))
    with Host(fmu_folder("torque_motor")) as host:
        host.start({"voltage": 10.0, **values})
        refused(host, lambda: host.fmu.doStep(0.0, 99.0), f"that is {longest:g} s")


def test_and_as_a_parameter_shortens_them_in_the_run(fmu_folder: Files) -> None:
    own = model("torque_motor").values["rotor_inertia"]
    longest = 1e6 * 0.13 * math.sqrt(1e-2 / (1.0 / 1e-5 + 50.0 / own))
    with Host(fmu_folder("torque_motor")) as host:
        host.start({"gear_compliance.compliance": 1e-2, "gear_compliance.inertia": 1e-5})
        host.set({"rotor_inertia": own / 50.0})
        refused(host, lambda: host.fmu.doStep(0.0, 1.01 * longest), f"that is {longest:g} s")


Damage = Callable[[dict[str, Any]], object]
DAMAGED: dict[str, Damage] = {
    "no values": lambda state: state.pop("values"),
    "no phase": lambda state: state.pop("phase"),
    "values of another type": lambda state: state.update(values="1, 2"),
    "numbers as texts": lambda state: state.update(x=["0.0"] * len(state["x"])),
    "a text for a time": lambda state: state.update(time="0.001"),
    "a number for a phase": lambda state: state.update(phase=2),
    "no such phase": lambda state: state.update(phase="asleep"),
    "short values": lambda state: state["values"].pop(),
    "a short state": lambda state: state["x"].pop(),
    "no state": lambda state: state.update(x=[]),
    "a long state": lambda state: state["x"].append(0.0),
    "NaN": lambda state: state["x"].__setitem__(0, math.nan),
    "infinite": lambda state: state["values"].__setitem__(0, math.inf),
    "out of bounds": lambda state: state["values"].__setitem__(0, 1e6),
    "an unknown effect": lambda state: state.update(dropped=["nothing"]),
    "effects of another type": lambda state: state.update(dropped=[[1]]),
}


def sealed(state: dict[str, Any]) -> bytes:
    """A saved state with a digest that fits."""
    text = json.dumps(state)
    digest = hashlib.sha256(text.encode()).hexdigest()
    return json.dumps({"state": text, "digest": digest}).encode()


@python_only
@pytest.mark.parametrize("name", DAMAGED)
def test_a_state_that_is_no_state_is_refused_whatever_its_digest(host: Host, name: str) -> None:
    state = held(host)
    DAMAGED[name](state)
    refused(host, lambda: restore(host, sealed(state)), "the state to restore is damaged")


@python_only
@pytest.mark.parametrize("read", [-600.0, -1e18])
def test_a_delay_line_that_no_run_has_ends_the_run(host: Host, read: float) -> None:
    """Its loop over the edges that wait came to no end where 1 more is no other number."""
    state = held(host)
    state["x"][place_in_x("transport_delay__read")] = read
    restore(host, sealed(state))
    refused(host, lambda: host.fmu.doStep(1e-3, 1e-3), "the delay line is full")


def test_a_changed_byte_of_a_state_is_seen(host: Host) -> None:
    state = host.fmu.getFMUstate()
    whole = bytes(host.fmu.serializeFMUstate(state))
    draw = np.random.default_rng(1)
    for at in draw.integers(len(whole), size=50):
        content = bytearray(whole)
        content[at] = ord("7") if content[at] != ord("7") else ord("8")
        with pytest.raises(FMICallException):
            restore(host, bytes(content))
        host.fmu.setFMUstate(state)
    host.fmu.doStep(1e-3, 1e-3)


def test_a_host_that_shows_no_messages_tells_the_reason_once(fmu_file: Files, kind: str) -> None:
    script = (
        "import fmpy, sys\n"
        "try:\n"
        "    fmpy.simulate_fmu(sys.argv[1], start_values={'stiffness': float('nan')})\n"
        "except fmpy.fmi1.FMICallException as error:\n"
        "    print(error.status)\n"
    )
    command = [sys.executable, "-c", script, str(fmu_file("torque_motor"))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, f"{FAILED[kind]}\n")
    assert done.stderr.count("'stiffness' = nan is not finite") == 1


def test_a_host_without_python3_on_the_path_runs(fmu_file: Files) -> None:
    """The host is Python itself here, so its own interpreter does."""
    script = (
        "import fmpy, sys\n"
        "result = fmpy.simulate_fmu(sys.argv[1], stop_time=0.01)\n"
        "print(result['time'][-1])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(fmu_file("torque_motor"))],
        capture_output=True,
        text=True,
        check=False,
        env={"PATH": "", "HOME": os.environ.get("HOME", "")},
    )
    assert (done.returncode, done.stdout) == (0, "0.01\n"), done.stderr


@python_only
def test_an_older_python_is_told_which_one_is_needed(fmu_folder: Files, tmp_path: Path) -> None:
    folder = tmp_path / "fmu"
    shutil.copytree(fmu_folder("torque_motor"), folder)
    (text,) = (folder / "resources").glob("torque_motor_*.py")
    source = text.read_text()
    ast.parse(source, feature_version=(3, 7))  # so that an older one comes to the sentence
    assert source.count("sys.version_info < (3, 10)") == 1
    text.write_text(source.replace("sys.version_info < (3, 10)", "sys.version_info < (9, 10)"))
    script = (
        "import fmpy, sys\n"
        "try:\n"
        "    fmpy.simulate_fmu(sys.argv[1])\n"
        "except Exception as error:\n"
        "    print('refused')\n"
    )
    command = [sys.executable, "-c", script, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "refused\n"), done.stderr
    assert "this FMU needs Python 3.10 or newer" in done.stderr
