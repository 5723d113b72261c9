"""From a description to parameters to an FMU, on the command line and in Python.

The rig is that of ``test_identification``: the valve paper's equations by the matrix
exponential, which shares nothing with the product's integrator.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

from servo_models.analysis.simulate import simulate
from servo_models.data.parameters import ParameterSet, read_parameters
from servo_models.identification import fit as fit_module
from servo_models.identification.identify import identify
from servo_models.identification.linear_inference import Spread, spread
from tests.conftest import Run
from tests.support.bench_log import HEAD, LOG, NOISE, changed, laid_out, rows_of, write_log
from tests.support.exact_motor import TRUE
from tests.support.html_page import Page
from tests.support.own_actuators import WITH_A_FLAG, write

ESTIMATED = {name: TRUE[name] for name in ("torque_constant", "inductance", "friction_coefficient")}


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    return laid_out(tmp_path)


def settings_of(found: ParameterSet | None) -> dict[str, float]:
    assert found
    return found.settings()


# From files to an FMU


@pytest.mark.thorough
def test_from_two_files_to_an_fmu(bench: Path, run: Run) -> None:
    out, report = bench / "made" / "PARAMS.toml", bench / "report.html"
    code, said, complaint = run("identify", bench / "mine.toml", "--out", out, "--report", report)
    assert (code, complaint) == (0, "")
    assert f"parameters: {out}" in said
    assert "Warning" not in said
    found = read_parameters(out)
    for estimate in found.estimates:
        if estimate.origin == "estimated":
            assert estimate.standard_error
            assert abs(estimate.value - TRUE[estimate.name]) < 4.0 * estimate.standard_error
            assert estimate.standard_error < 0.02 * estimate.value
    assert {e.name for e in found.estimates} == {*ESTIMATED, "end_stops.half_range"}
    assert found.figures["angle_rms_held_out"].value == pytest.approx(NOISE, rel=0.1)
    Page(report.read_text(encoding="utf-8")).assert_stands_alone()

    assert run("build", "--params", out, "--out", bench)[0] == 0
    result = fmpy.simulate_fmu(
        str(bench / "torque_motor_measured.fmu"),
        stop_time=0.1,
        output_interval=1e-3,
        start_values={"voltage": 12.0},
        output=["angle"],
    )
    same = simulate(found.model(), result["time"], {"voltage": 12.0})["angle"]
    assert np.ptp(same) > 0.01
    np.testing.assert_allclose(result["angle"], same, rtol=1e-12, atol=1e-15)


def test_python_and_command_line_say_the_same(bench: Path, run: Run) -> None:
    out = bench / "PARAMS.toml"
    run("identify", bench / "mine.toml", "--out", out)
    found = identify(bench / "mine.toml")
    assert settings_of(found.parameters) == read_parameters(out).settings()
    assert found.converged


def test_what_was_identified_is_where_the_next_description_begins(bench: Path, run: Run) -> None:
    run("identify", bench / "mine.toml", "--out", bench / "PARAMS.toml")
    (bench / "next.toml").write_text('params = "PARAMS.toml"\nfree = ["stiffness"]\n' + LOG)
    found = identify(bench / "next.toml")
    after = settings_of(found.parameters)
    before = read_parameters(bench / "PARAMS.toml").settings()
    assert {name: after[name] for name in before} == before
    assert after["stiffness"] == pytest.approx(TRUE["stiffness"], rel=0.01)


@pytest.mark.thorough
def test_an_actuator_of_ones_own(tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """The parameter file names it as seen from its own folder, wherever one stands."""
    lag = 0.35
    times = 0.01 * np.arange(300)
    angle = 1.0 - np.exp(-times / lag)
    goal = np.ones(300)
    (tmp_path / "logs").mkdir()
    write(tmp_path, name="mine.py", changes=WITH_A_FLAG)
    (tmp_path / "logs" / "joint.toml").write_text("""
        actuator = "../mine.py"
        free = ["time_constant"]
        [[logs]]
        file = "joint.csv"
        time = "t"
        settle = 0
        inputs.goal = "goal"
        outputs.angle = "angle"
        """)
    table = np.column_stack([times, goal, angle])
    np.savetxt(
        tmp_path / "logs" / "joint.csv", table, delimiter=",", header="t,goal,angle", comments=""
    )
    out = tmp_path / "found" / "deep" / "PARAMS.toml"
    assert run("identify", tmp_path / "logs" / "joint.toml", "--trust", "--out", out)[0] == 0
    assert 'actuator = "../../mine.py"' in out.read_text()
    monkeypatch.chdir(out.parent)
    assert settings_of(read_parameters("PARAMS.toml", trust=True)) == pytest.approx(
        {"time_constant": lag}, rel=1e-6
    )
    assert run("explain", "--params", "PARAMS.toml", "--trust")[0] == 0
    assert run("build", "--params", "PARAMS.toml", "--trust")[0] == 0
    result = fmpy.simulate_fmu(
        str(Path("fmus") / "joint.fmu"),
        stop_time=1.0,
        output_interval=0.1,
        start_values={"goal": 1.0},
        output=["angle"],
    )
    np.testing.assert_allclose(result["angle"], 1.0 - np.exp(-result["time"] / lag), atol=1e-6)
    code, _, err = run(
        "diagnose", tmp_path / "logs" / "joint.toml", "--trust", "--json", "gap.json"
    )
    assert code == 1
    assert [line.partition(" after")[0] for line in err.splitlines()] == ["first answer"]
    assert json.loads(Path("gap.json").read_text())["confirmation"]["difference"] == 0.0


# The same again


@pytest.mark.thorough
@pytest.mark.parametrize(
    "options", [{"search": "global", "seed": 4}, {"starts": 4, "seed": 4}], ids=["global", "starts"]
)
def test_the_same_seed_gives_the_same_numbers_on_any_number_of_processors(
    tmp_path: Path, options: dict[str, str | int]
) -> None:
    write_log(tmp_path, rows_of(300))
    (tmp_path / "mine.toml").write_text(HEAD + LOG.partition("held_out")[0])
    free = ["torque_constant", "drive_dead_zone.half_width"]
    found = [
        identify(tmp_path / "mine.toml", free, jobs=jobs, **options)  # type: ignore[arg-type]
        for jobs in (1, 2, 2)
    ]
    for other in found[1:]:
        assert settings_of(other.parameters) == settings_of(found[0].parameters)
        assert np.array_equal(
            other.result.standard_errors, found[0].result.standard_errors, equal_nan=True
        )


# What is free


def test_a_fit_keeps_to_its_bounds(bench: Path, run: Run) -> None:
    """The true constant is 5.4: between 5 and 6 it is found, above 5.6 it ends on the bound."""
    for low, expected in ((5.0, TRUE["torque_constant"]), (5.6, 5.6)):
        changed("[[logs]]", f"[bounds]\ntorque_constant = [{low}, 6.5]\n[[logs]]")(bench)
        code, out, _ = run("identify", bench / "mine.toml", "--out", bench / "P.toml")
        assert code == (0 if expected == TRUE["torque_constant"] else 1)  # it says so on a bound
        found = settings_of(read_parameters(bench / "P.toml"))
        assert found["torque_constant"] == pytest.approx(expected, rel=1e-2)
        assert ("on its low bound" in out) == (low > 5.4)


@pytest.mark.thorough
@pytest.mark.parametrize("count", [1, 2])
def test_what_some_logs_state_is_free_in_the_others(bench: Path, run: Run, count: int) -> None:
    """It is uncertain by the variant; where every log states it nothing is left to estimate."""
    known = f"constants = {{ friction_coefficient = {TRUE['friction_coefficient']} }}\n"
    logs = [LOG + f'name = "{k}"\n' + (known if k < count else "") for k in range(2)]
    head = "\n".join(line for line in HEAD.splitlines() if not line.startswith("free"))
    (bench / "mine.toml").write_text(head + "".join(logs))
    code, out, err = run("identify", bench / "mine.toml", "--out", bench / "P.toml")
    assert (code, err) == (0, ""), out
    found = settings_of(read_parameters(bench / "P.toml"))
    assert ("friction_coefficient" in found) == (count == 1)
    code, out, err = run("identify", bench / "mine.toml", "--free", "friction_coefficient")
    assert code == count  # 1: the others stay nominal, which leaves a gap
    assert ("every log states 'friction_coefficient'" in err) == (count == 2)


# Interrupted


def test_ctrl_c_while_standard_errors_are_worked_out_loses_nothing(
    bench: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def once(*args: Any) -> Spread:
        calls.append(args)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return spread(*args)

    monkeypatch.setattr(fit_module, "spread", once)
    assert run("identify", bench / "mine.toml", "--out", bench / "P.toml")[0] == 0
    assert len(calls) == 2
    assert settings_of(read_parameters(bench / "P.toml"))["torque_constant"] == pytest.approx(
        5.4, rel=0.01
    )


def test_ctrl_c_is_told(run: Run, monkeypatch: pytest.MonkeyPatch, bench: Path) -> None:
    def stopped(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["servo_models.identification.identify"], "identify", stopped)
    assert run("identify", bench / "mine.toml") == (2, "", "servo-models: interrupted\n")


@pytest.mark.thorough
@pytest.mark.skipif(sys.platform == "win32", reason="signals and terminals of POSIX")
@pytest.mark.parametrize("signals", [1, 3])
def test_ctrl_c_keeps_the_best_values(bench: Path, signals: int) -> None:
    """A fit of a thousand starts is interrupted when the first ones have ended.

    Progress is shown on a terminal only, so stderr is one.  More of Ctrl-C and it may stop
    without a result, or before it has told one, but never leaves half of one.
    """
    import pty

    out = bench / "PARAMS.toml"
    code = "import signal, sys, servo_models.cli; "
    code += "signal.signal(signal.SIGINT, signal.default_int_handler); "
    code += "sys.exit(servo_models.cli.main())"
    master, terminal = pty.openpty()
    words = ["identify", "mine.toml", "--starts", "1000", "--out", "PARAMS.toml"]
    with subprocess.Popen(
        [sys.executable, "-c", code, *words],
        cwd=bench,
        stdout=subprocess.PIPE,
        stderr=terminal,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "200"},
    ) as process:
        os.close(terminal)
        shown = b""
        while not re.search(rb"start ([3-9]|\d\d+) of", shown):
            shown += os.read(master, 1024)
        for _ in range(signals):
            process.send_signal(signal.SIGINT)
            time.sleep(0.02)  # else the system makes one signal of them
        stdout, _ = process.communicate()
    with contextlib.suppress(OSError):  # at the end of what a terminal shows that is closed
        while last := os.read(master, 1024):
            shown += last
    os.close(master)
    left = {path.name for path in bench.iterdir()}
    if signals > 1 and "PARAMS.toml" not in left:
        assert process.returncode in (2, 130, -signal.SIGINT)  # 130 as a shell counts it
        assert left == {"log.csv", "mine.toml"}
        return
    assert process.returncode == 1 or signals > 1, shown[-2000:].decode()
    assert left == {"log.csv", "mine.toml", "PARAMS.toml"}
    if process.returncode == 1:  # told: a Ctrl-C after the file was written ends it otherwise
        assert b"stopped before it converged" in stdout
    else:
        assert process.returncode in (2, 120, 130, -signal.SIGINT)  # 120: while Python ends
    found = read_parameters(out)
    assert found.warnings[-1].startswith("stopped before it converged")
    assert settings_of(found)["torque_constant"] == pytest.approx(5.4, rel=0.01)
