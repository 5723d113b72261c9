"""Bench tables and records with faults: each is told in one line, with its cure."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from servo_models.core.types import Array
from servo_models.errors import UserError
from servo_models.identification.elements.identify import identify_elements
from servo_models.identification.elements.motor import motor_step
from tests.support.servo_bench import DESCRIPTION, Bench, taken_apart, write


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    return taken_apart(tmp_path)


def only_positive(path: Path) -> None:
    voltages, speeds, _ = Bench().table(0.05, 0.02, 2.5)
    write(path, U_mV=1e3 * voltages[voltages > 0], n=speeds[voltages > 0])


def on_off(path: Path) -> None:
    voltages, _, _ = Bench().table(0.05, 0.02, 2.5)
    write(path, U_mV=1e3 * voltages, n=np.where(abs(voltages) > 1.0, np.sign(voltages), 0.0))


def few(path: Path) -> None:
    write(path, U_mV=np.array([-1.0, 1.0]), n=np.array([-1.0, 1.0]))


def constant(path: Path) -> None:
    write(path, U_mV=np.linspace(-1.0, 1.0, 20), n=np.zeros(20))


def backward(path: Path) -> None:
    voltages, speeds, _ = Bench().table(0.05, 0.02, 2.5)
    write(path, U_mV=1e3 * voltages, n=-speeds)


def too_large(path: Path) -> None:
    path.write_text("U_mV,n\n" + "1,2\n" * 9 + "3,-1e308\n")


def text(path: Path) -> None:
    path.write_text("U_mV,n\n" + "1,2\n" * 9 + "3,stuck\n")


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (only_positive, ("voltage and speed", "no negative voltage", "both directions")),
        (on_off, ("no linear region at positive voltages", "add 3 rows")),
        (few, ("column 'U_mV' has 2 rows", "at least 8")),
        (constant, ("column 'n' is constant", "measure over a range")),
        (backward, ("never turns", "sign of the speed")),
        (too_large, ("row 11", "column 'n'", "more than any signal has", "correct the number")),
        (text, ("row 11", "column 'n'", "'stuck' is not a number")),
    ],
)
def test_a_bad_table_is_one_line_with_its_cure(
    bench: Path, spoil: Callable[[Path], None], words: tuple[str, ...]
) -> None:
    spoil(bench.parent / "motor.csv")
    with pytest.raises(UserError) as caught:
        identify_elements(bench)
    message = str(caught.value)
    assert "motor.csv" in message
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[elements.gears]", "[elements.gear]", "did you mean 'gears'?"),
        ("teeth = [[8, 48], [8, 32]]", "teeth = [8, 48]", "elements.gears.teeth"),
        ('unit = "rpm"', 'unit = "V"', "elements.motor.speed.unit"),
        ('column = "U_mV"', 'column = "U"', "has no column 'U'"),
        ("k_f = [0.05, 0.1]", 'band = "200 %"', "elements.synthesis.band"),
        ('column = "U", unit = "V"', 'column = "U", unit = "V", sign = -1', "potentiometer_gain"),
        ('actuator = "sg90"\nvariant = "printed"', 'actuator = "torque_motor"', "such as sg90"),
        ('file = "motor.csv"', "", "elements.motor.file: missing"),
    ],
)
def test_a_bad_description_is_one_line_with_its_cure(
    bench: Path, old: str, new: str, words: str
) -> None:
    assert old in DESCRIPTION
    bench.write_text(DESCRIPTION.replace(old, new))
    with pytest.raises(UserError, match=r"^[^\n]+$") as caught:
        identify_elements(bench)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("speeds", "voltages", "words"),
    [
        (np.linspace(0.0, 1.0, 50), None, "does not settle"),
        (np.ones(4) - np.exp(-np.arange(4.0)), None, "rows after the step"),
        (np.ones(50), np.tile([0.0, 1.0], 25), "more than once"),
    ],
)
def test_a_record_that_is_no_step_is_told(
    speeds: Array, voltages: Array | None, words: str
) -> None:
    with pytest.raises(UserError, match=words):
        motor_step(np.arange(len(speeds)) * 0.1, speeds, voltages)
