"""Times and units that no run has are refused at once: the row or the right unit is named."""

from __future__ import annotations

import contextlib
import multiprocessing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.errors import UserError
from servo_models.units import exponents, factor, parse
from tests.conftest import Run

HEAD = """actuator = "sg90"
[uncertainty]
motor_time_constant = "10 %"
[[logs]]
file = "log.csv"
time = { column = "t", unit = "UNIT" }
inputs.pulse_width = { column = "command", unit = "us" }
outputs.angle = { column = "angle", unit = "deg" }
"""
STEP = 0.02  # [s] between rows of the sane log
ROWS = 150


def record(folder: Path, times: np.ndarray, unit: str = "s") -> Path:
    """Write a log with these times beside a description of it."""
    command = 1500.0 + 100.0 * (np.arange(ROWS) > 20)
    angle = 9.0 * (np.arange(ROWS) > 30) + 0.1 * np.random.default_rng(1).standard_normal(ROWS)
    rows = "\n".join(f"{t!r},{c},{a}" for t, c, a in zip(times.tolist(), command, angle))
    (folder / "log.csv").write_text(f"t,command,angle\n{rows}\n")
    path = folder / "rig.toml"
    path.write_text(HEAD.replace("UNIT", unit))
    return path


SANE = STEP * np.arange(ROWS)


@pytest.mark.thorough
@pytest.mark.parametrize("command", ["check", "identify", "diagnose"])
@pytest.mark.parametrize(
    ("ratio", "begin", "unit"),
    [(1e3, 0, "ms"), (1e6, 5e12, "us"), (1e9, 1_700_000_000_000_000_000, "ns")],
    ids=["ms", "us", "epoch in ns"],
)
def test_a_time_read_in_the_wrong_unit(
    tmp_path: Path, run: Run, command: str, ratio: float, begin: float, unit: str
) -> None:
    path = record(tmp_path, np.round(ratio * SANE) + begin)
    code, out, err = run(command, path)
    assert (code, out) == (2, "")
    assert f'write unit = "{unit}"' in err
    assert "'t' in s" in err
    assert "log.csv" in err
    right = record(tmp_path, np.round(ratio * SANE) + begin, unit)
    assert run("check", right)[0] in (0, 1)


@pytest.mark.parametrize("command", ["check", "identify", "diagnose"])
@pytest.mark.parametrize("row", [1, 70, ROWS - 1])
@pytest.mark.parametrize("jump", [1e5, 1e12])
def test_a_clock_that_jumps(tmp_path: Path, run: Run, command: str, row: int, jump: float) -> None:
    """Rows are counted as the author of the file would, below one of names."""
    times = SANE.copy()
    times[row:] += jump
    code, out, err = run(command, record(tmp_path, times))
    assert (code, out) == (2, "")
    assert f"row {row + 2}" in err
    assert f"time jumps by {jump:.3g} s" in err


ANOTHER_RUN = (
    "the clock starts again, so from this row on it is another run: put it in a file of its own"
)


@pytest.mark.parametrize(
    ("times", "row", "cure"),
    [
        (np.concatenate([SANE[:70], SANE[:80]]), 70, ANOTHER_RUN),
        (np.concatenate([SANE[:70], SANE[:40] + 0.003, SANE[:40]]), 70, ANOTHER_RUN),
        (np.concatenate([SANE[:70] + 900.0, SANE[:80]]), 70, ANOTHER_RUN),
        (np.concatenate([SANE[70:], SANE[:70]]), 80, "sort the rows by time"),  # parts swapped
        (np.concatenate([SANE[:50], SANE[70:90], SANE[50:70], SANE[90:]]), 70, "sort the rows"),
        (SANE[[*range(60), 61, 60, *range(62, ROWS)]], 61, "sort the rows by time"),
        (np.concatenate([SANE[:-1], [0.0]]), ROWS - 1, "sort the rows by time"),
        (SANE[::-1], 1, "sort the rows by time"),
    ],
)
def test_a_clock_that_runs_backward(
    tmp_path: Path, run: Run, times: np.ndarray, row: int, cure: str
) -> None:
    """Rows that sorting would mix, or part, are of two runs."""
    code, out, err = run("check", record(tmp_path, times))
    assert (code, out) == (2, "")
    said = " ".join(err.split())
    assert f"row {row + 2}, column 't': time runs backward" in said
    assert f"; {cure}" in said


@pytest.mark.parametrize("step", [1e-16, 1e-200, 1e-320])
def test_rows_that_no_clock_tells_apart(tmp_path: Path, run: Run, step: float) -> None:
    code, out, err = run("check", record(tmp_path, step * np.arange(ROWS)))
    assert (code, out) == (2, "")
    assert "log.csv', column 't' in s: rows are" in err
    assert "correct the unit" in err


def test_two_rows_that_no_clock_tells_apart(tmp_path: Path, run: Run) -> None:
    code, out, err = run("check", record(tmp_path, np.insert(SANE[:-1], 1, 5e-324)))
    assert (code, out) == (2, "")
    assert "log.csv', row 3, column 't': time moves from 0.0 s to 5e-324 s, as no clock does" in err


def test_a_pause_is_no_jump(tmp_path: Path, run: Run) -> None:
    times = SANE.copy()
    times[70:] += 5.0
    assert run("check", record(tmp_path, times))[0] in (0, 1)


def test_a_table_of_inputs_that_never_ends(tmp_path: Path, run: Run) -> None:
    (tmp_path / "pulses.csv").write_text("time,pulse_width\n0,0.0015\n1,0.0016\n1e12,0.0016\n")
    code, out, err = run("simulate", "sg90", "--inputs", tmp_path / "pulses.csv")
    assert (code, out) == (2, "")
    assert "pulses.csv', rows counted from 0" in err
    assert "internal steps" in err
    assert "follows row 1" in err


# Units


@pytest.mark.parametrize(
    "unit",
    [
        "9**9**9**9",
        "m9**9",
        "m^9^9",
        "(m^9)^9",
        "m10",
        "m**12",
        "m" * 61,
        "kg;m",
        "__import__('os')",
    ],
)
def test_a_unit_that_would_be_computed_for_ever_is_refused(unit: str) -> None:
    for ask in (
        lambda: exponents(unit),
        lambda: factor(unit, "m"),
        lambda: parse(f"1 {unit}", "m"),
    ):
        with pytest.raises(UserError, match=r"no unit|not a number with a unit"):
            ask()


@pytest.mark.parametrize(
    "unit", ["µs", "deg/s", "N.m.s/rad2", "1/(N.m)", "kg.m2", "m^2", "m**2/s", "%"]
)
def test_units_of_people_are_read(unit: str) -> None:
    assert exponents(unit)[0] > 0.0


def ask(text: str) -> None:
    """In a process of its own: what hangs is ended there."""
    with contextlib.suppress(UserError):
        factor(text, "m")


@settings(max_examples=20)
@given(st.lists(st.text("m9.*/^()- s%d1", min_size=1, max_size=40), min_size=50, max_size=50))
def test_no_unit_hangs(units: list[str]) -> None:
    process = multiprocessing.get_context("fork").Process(target=lambda: [ask(u) for u in units])
    process.start()
    process.join(60)
    ended = process.exitcode
    process.kill()
    assert ended == 0, units


@pytest.mark.parametrize("number", [10**400, "1" * 5000, "1" * 190 + "e999999999"])
def test_endless_numbers_are_refused(number: int | str) -> None:
    with pytest.raises(UserError):
        parse(number, "s")
