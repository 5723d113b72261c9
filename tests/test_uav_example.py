"""The UAV of ``examples/uav``: its airframe, its margins, its packages in other masters."""

from __future__ import annotations

import cmath
import importlib
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fmpy.ssp.ssd import read_ssd

import servo_models as sm
from servo_models.core.compilers import compiler
from servo_models.core.types import Array
from tests.conftest import Run
from tests.support.document import ROOT, alike, code_blocks, follow

EXAMPLE = ROOT / "examples" / "uav"
MODULES = ("flight", "margins", "masters", "results", "run", "systems")
DEGREE = math.radians(1.0)
STEP = 1e-3

pytestmark = pytest.mark.skipif(compiler() is None, reason="needs a C compiler")


@pytest.fixture(scope="module")
def uav() -> Iterator[SimpleNamespace]:
    """The scripts of the example, which find each other as they do for their reader."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(EXAMPLE))
        yield SimpleNamespace(**{name: importlib.import_module(name) for name in MODULES})
        for name in MODULES:
            del sys.modules[name]


@pytest.fixture(scope="module")
def fmus(uav: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("UAV FMUs")
    uav.run.build(folder)
    return folder


def test_the_airframe_has_the_coefficients_of_its_authors() -> None:
    """Those that mavsim_public of Beard and McLain prints for 25 m/s (chap5_check.py).

    Theirs are of speeds across and down where ours are of angles: a factor of the airspeed.  They
    are in body axes, 2.9 degrees from ours, so a cosine remains.
    """
    linear = sm.linearise(sm.model(str(EXAMPLE / "airframe.py")))
    of_states, of_inputs = linear.matrices()[:2]
    printed = {
        ("pitch_rate", "pitch_rate"): -5.29473836,
        ("pitch_rate", "attack"): -99.94742,
        ("pitch_rate", "elevator"): -36.11239041,
        ("roll_rate", "slip"): -3.86671935 * 25.0,
        ("roll_rate", "roll_rate"): -22.6288510,
        ("roll_rate", "yaw_rate"): 10.9050409,
        ("roll_rate", "left_aileron"): 130.88368125 / 2.0,
        ("roll_rate", "right_aileron"): -130.88368125 / 2.0,
        ("roll_rate", "rudder"): -1.79637441,
        ("yaw_rate", "slip"): 0.783077145 * 25.0,
        ("yaw_rate", "roll_rate"): -0.115091678,
        ("yaw_rate", "yaw_rate"): -1.22765475,
        ("yaw_rate", "left_aileron"): 5.01173513 / 2.0,
        ("yaw_rate", "rudder"): -24.88134191,
        ("slip", "slip"): -0.776772629,
        ("slip", "left_aileron"): 1.48617191 / 25.0 / 2.0,
        ("slip", "rudder"): 3.76496884 / 25.0,
        ("attack", "elevator"): -2.58618345 / 25.0,
        ("attack", "pitch_rate"): 24.37105023 / 25.0,
    }
    for (rate, cause), value in printed.items():
        row, is_state = linear.states.index(rate), cause in linear.states
        found = (
            of_states[row, linear.states.index(cause)]
            if is_state
            else of_inputs[row, linear.inputs.index(cause)]
        )
        assert found == pytest.approx(value, rel=5e-3), (rate, cause)


def test_the_margin_of_pitch_by_the_textbook(uav: SimpleNamespace) -> None:
    """Hold, delay, servo and airframe multiplied in the frequency domain, without python-control.

    The crossover is far below half a turn a frame, so the first alias may be left out.
    """
    loops = uav.margins.Loops(sm.model("sg90"), STEP)
    known = loops.margin("elevator")
    pilot = uav.margins.own("autopilot").values
    frame, s = pilot["frame"], 1j * known.crossover
    hertz = known.crossover / (2.0 * math.pi)
    airframe = sm.linearise(uav.margins.own("airframe"))
    pitch, rate = (
        airframe.response(hertz, "elevator", name)[0] for name in ("pitch", "pitch_rate")
    )
    hold = (1.0 - cmath.exp(-s * frame)) / (s * frame)
    late = cmath.exp(-1.5 * STEP * s)  # a step in the autopilot, half a step in the airframe
    servo = sm.linearise(sm.model("sg90")).response(hertz, "pulse_width", "angle")[0]
    surface = hold * late * servo * pilot["pulse_per_angle"]
    summed = frame / (cmath.exp(s * frame) - 1.0)
    law = (pilot["pitch_gain"] + pilot["pitch_integral"] * summed) * pitch
    loop = -surface * (law + pilot["pitch_damping"] * rate)
    assert abs(loop) == pytest.approx(1.0, rel=0.01)
    assert math.pi + cmath.phase(loop) == pytest.approx(known.phase, abs=DEGREE)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.8])
def test_the_describing_function_is_the_fundamental_of_a_play(
    uav: SimpleNamespace, share: float
) -> None:
    turn = np.arange(4000) / 2000.0
    motor = np.sin(2.0 * math.pi * turn)
    horn = np.zeros_like(motor)
    for k in range(1, len(motor)):
        horn[k] = min(max(horn[k - 1], motor[k] - share), motor[k] + share)
    wave = np.exp(-2j * math.pi * turn[2000:])  # the second turn is steady
    fundamental = 2j * np.mean(wave * horn[2000:])
    assert uav.margins._play(share) == pytest.approx(fundamental, abs=2e-3)


def test_a_package_is_read_as_it_was_written(
    uav: SimpleNamespace, fmus: Path, tmp_path: Path
) -> None:
    """Also by fmpy, which checks it against the schema of SSP."""
    system = uav.flight.ten_servos(fmus)
    path = uav.systems.write_ssp(system, tmp_path / "ten.ssp")
    assert uav.systems.write_ssp(system, tmp_path / "again.ssp").read_bytes() == path.read_bytes()
    again = uav.systems.read_ssp(path, tmp_path / "unpacked")
    assert (again.connections, again.starts, again.step) == (
        system.connections,
        dict(system.starts),
        system.step,
    )
    described = read_ssd(str(path)).system
    assert {one.name: Path(one.source).name for one in described.elements} == {
        name: fmu.name for name, fmu in system.components.items()
    }
    assert len(described.connections) == len(system.connections)


def test_the_system_of_the_page(
    uav: SimpleNamespace, fmus: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(fmus.parent)
    page = (ROOT / "docs" / "systems.md").read_text(encoding="utf-8")
    (listing,) = code_blocks(page.replace('"fmus/', f'"{fmus.name}/'), "python")
    names = {"System": uav.systems.System, "Path": Path}
    exec(listing, names)
    with uav.masters.Master(names["system"]) as master:
        (angle,) = master.simulate(0.5, [("servo", "angle")]).values()
    pilot = uav.margins.own("autopilot").values  # half a second of integral, proportional part
    asked = -0.1 * (pilot["pitch_gain"] + 0.5 * pilot["pitch_integral"])
    assert angle[-1] == pytest.approx(asked, abs=0.03)


@pytest.mark.thorough
@pytest.mark.parametrize("which", ["diagnosed", "ten_servos"])
def test_other_masters_give_the_same_numbers(uav: SimpleNamespace, fmus: Path, which: str) -> None:
    """The same bits, once our loop has their clock."""
    pytest.importorskip("libcosimpy")
    system = (
        uav.flight.ten_servos(fmus)
        if which == "ten_servos"
        else uav.flight.cases()[2].system(fmus, uav.flight.STEPS)
    )
    found = list(uav.run.compare(system, fmus, 0.5))
    assert {one.master for one in found} >= {"libcosim"}  # and ecos where it is installed
    for one in found:
        assert one.difference < 1e-7
        assert one.on_its_clock == 0.0


def test_each_of_ten_instances_is_the_simulation_of_it_alone(
    uav: SimpleNamespace, fmus: Path
) -> None:
    off = uav.run.alone(uav.flight.ten_servos(fmus), 0.5)
    assert len(off) == 10
    assert set(off.values()) == {0.0}


@pytest.mark.thorough
def test_a_play_makes_the_loop_swing_as_the_describing_function_says(
    uav: SimpleNamespace, fmus: Path
) -> None:
    diagnosed = uav.flight.cases()[2]
    step = uav.flight.fly(diagnosed, fmus, "pitch", 12.0)
    cycle = step.limit_cycle()
    predicted = uav.margins.Loops(diagnosed.servo, STEP).limit_cycle("elevator", diagnosed.play)
    assert cycle.frequency == pytest.approx(predicted.frequency, rel=0.03)
    assert cycle.surface == pytest.approx(predicted.surface, rel=0.1)


def test_an_oscillation_is_measured(uav: SimpleNamespace) -> None:
    times: Array = STEP * np.arange(1.0, 10001.0)
    swing = 0.02 * np.sin(12.0 * times)
    cycle = uav.flight.Step(times, 0.3 + swing, 0.1 + 3.0 * swing, 0.3).limit_cycle()
    assert cycle.attitude == pytest.approx(0.02, rel=0.01)
    assert cycle.surface == pytest.approx(0.06, rel=0.01)
    assert cycle.frequency == pytest.approx(12.0, rel=0.001)
    settling = 0.3 + 0.05 * np.exp(-times)
    assert uav.flight.Step(times, settling, settling, 0.3).limit_cycle() is None


@pytest.mark.thorough
@pytest.mark.parametrize("case", [0, 1])
def test_margins_in_flight_are_those_of_python_control(
    uav: SimpleNamespace, fmus: Path, case: int
) -> None:
    flown = uav.run.cases()[case]
    loops = uav.margins.Loops(flown.servo, STEP)
    measured = uav.flight.measured_loops(flown, fmus, loops.frame)
    for axis, command in uav.flight.COMMANDS.items():
        seen = uav.flight.measured_margin(*measured[axis])
        assert seen.phase == pytest.approx(loops.margin(command).phase, abs=0.3 * DEGREE)


@pytest.mark.long
def test_the_page_shows_what_the_command_prints(tmp_path: Path) -> None:
    page = (EXAMPLE / "README.md").read_text(encoding="utf-8")
    (shown,) = (text for text in code_blocks(page, "") if "Phase margins" in text)
    command = [sys.executable, str(EXAMPLE / "run.py"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    printed = done.stdout.splitlines()
    for line in filter(None, shown.splitlines()):
        assert line == "..." or any(alike(line, other) for other in printed), line
    for name in ("measured.ssp", "measured/OspSystemStructure.xml", "ten_servos.ssp"):
        assert (tmp_path / name).exists()
    assert (tmp_path / "report.html").read_text(encoding="utf-8").count("<svg") == 5


@pytest.mark.thorough
def test_the_play_is_what_a_diagnosis_of_the_log_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run: Run
) -> None:
    monkeypatch.chdir(tmp_path)
    subprocess.run([sys.executable, str(EXAMPLE / "make_log.py")], check=True)
    made, kept = (
        np.genfromtxt(folder / "bench.csv", delimiter=",", skip_header=1)
        for folder in (tmp_path, EXAMPLE)
    )
    np.testing.assert_allclose(made, kept, atol=2e-3)
    (tmp_path / "bench.toml").write_bytes((EXAMPLE / "bench.toml").read_bytes())
    follow((EXAMPLE / "README.md").read_text(encoding="utf-8"), run, doubted="diagnose")
    found, written = (
        sm.read_parameters(folder / "GAP.toml").settings() for folder in (tmp_path, EXAMPLE)
    )
    assert math.degrees(found["backlash.half_width"]) == pytest.approx(0.6, abs=0.01)
    assert written == pytest.approx(found, rel=1e-3)
