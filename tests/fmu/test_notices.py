"""A run that goes on warns its host once, of what it has noticed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from tests.support.fmu_host import Host

WARNING = 1
MAP = {"residual_map.torque": 1e-4, "residual_map.command": 1.0}
"""Of the command, which is known from -5 to 5 V."""
RANGE = {"residual_map.command_low": -5.0, "residual_map.command_high": 5.0}


def driven(folder: Path, volts: list[float]) -> Host:
    """A host whose motor has made a step with each of some voltages."""
    host = Host(folder)
    host.__enter__()
    host.start({**MAP, **RANGE, "voltage": 0.0})
    for k, value in enumerate(volts):
        host.set({"voltage": value})
        host.fmu.doStep(1e-3 * k, 1e-3)
    return host


def test_beyond_its_range_a_map_is_flagged_once(fmu_folder: Callable[[str], Path]) -> None:
    host = driven(fmu_folder("measured"), [1.0, 5.0])
    assert host.messages == []
    for k, value in enumerate([5.1, 6.0, 0.0, -7.0], 2):
        host.set({"voltage": value})
        host.fmu.doStep(1e-3 * k, 1e-3)
    ((status, text),) = host.messages
    assert status == WARNING
    assert "residual_map: 'voltage' went beyond the range of its curve" in text
    assert "at t = 0.003 s" in text
    host.__exit__(None, None, None)


def test_without_the_map_nothing_is_said(fmu_folder: Callable[[str], Path]) -> None:
    with Host(fmu_folder("measured")) as host:
        host.start({**RANGE, "voltage": 20.0})
        for k in range(5):
            host.fmu.doStep(1e-3 * k, 1e-3)
        assert host.messages == []


def test_a_new_run_is_flagged_anew(fmu_folder: Callable[[str], Path]) -> None:
    host = driven(fmu_folder("measured"), [9.0])
    host.fmu.reset()
    host.start({**MAP, **RANGE, "voltage": 9.0})
    host.fmu.doStep(0.0, 1e-3)
    assert [status for status, _ in host.messages] == [WARNING, WARNING]
    host.__exit__(None, None, None)


def test_an_input_that_nobody_has_checked_is_told_once(fmu_folder: Callable[[str], Path]) -> None:
    """The paper's responses reach 40 V."""
    with Host(fmu_folder("measured")) as host:
        host.start({"voltage": 0.0})
        for k, volts in enumerate([40.0, -40.0, 41.0, 45.0, 0.0, 42.0]):
            host.set({"voltage": volts})
            host.fmu.doStep(1e-3 * k, 1e-3)
        ((status, text),) = host.messages
    assert status == WARNING
    assert "'voltage' is not where variant 'measured' was checked" in text
    assert "voltage -40 to 40 V" in text
    assert "at t = 0.003 s" in text
