"""Units at the border, against values that stand in any table."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pint
import pytest

import servo_models
from servo_models.analysis.experiment import in_time
from servo_models.catalogue import actuators
from servo_models.errors import UserError
from servo_models.units import exponents, factor, parse


@pytest.mark.parametrize(
    ("unit", "to", "expected"),
    [
        ("deg", "rad", math.pi / 180.0),
        ("deg/s", "rad/s", math.pi / 180.0),
        ("rpm", "rad/s", math.pi / 30.0),
        ("rev/min", "rad/s", math.pi / 30.0),
        ("r/min", "deg/s", 6.0),
        ("rev/min2", "rad/s2", math.pi / 1800.0),
        ("V/rev", "V/rad", 0.5 / math.pi),
        ("us", "s", 1e-6),
        ("ms", "s", 1e-3),
        ("mA", "A", 1e-3),
        ("V/deg", "V/rad", 180.0 / math.pi),
        ("g.cm2", "kg.m2", 1e-7),
        ("N.m", "kg.m2/s2", 1.0),
        ("mNm/rad", "N.m/rad", 1e-3),
        ("V.s", "Ohm.A.s", 1.0),
        ("H", "V.s/A", 1.0),
        ("%", "1", 0.01),
    ],
)
def test_factor(unit: str, to: str, expected: float) -> None:
    assert factor(unit, to) == pytest.approx(expected, rel=1e-12)
    assert factor(to, unit) == pytest.approx(1.0 / expected, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "scale", "powers"),
    [
        ("N.m", 1.0, {"kg": 1, "m": 2, "s": -2}),
        ("V.s/rad", 1.0, {"kg": 1, "m": 2, "s": -2, "A": -1, "rad": -1}),
        ("1/rad2", 1.0, {"rad": -2}),
        ("rad/(N.m)", 1.0, {"rad": 1, "kg": -1, "m": -2, "s": 2}),
        ("1", 1.0, {}),
    ],
)
def test_exponents_of_fmi_base_units(unit: str, scale: float, powers: dict[str, int]) -> None:
    found, base = exponents(unit)
    assert found == pytest.approx(scale)
    assert base == powers


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("3 deg", "rad", math.radians(3.0)),
        ("3deg", "rad", math.radians(3.0)),
        (" 1.5e3 us ", "s", 1.5e-3),
        ("-0.05", "rad", -0.05),
        (2, "V", 2.0),
        (0.25, "1", 0.25),
    ],
)
def test_parse(text: str | float, unit: str, expected: float) -> None:
    assert parse(text, unit) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "unit", "words"),
    [
        ("three", "rad", "not a number with a unit"),
        ("", "rad", "not a number with a unit"),
        ("1.2.3 deg", "rad", "'1.2.3' is not a number"),
        ("3 V", "rad", "give a unit like rad"),
        ("3 deg", "1", "does not convert"),
        ("3 parsec_", "rad", "unknown unit"),
        ("1e999 s", "s", "not a finite number"),
        ("1 mol", "rad", "none of mechanics and electricity"),
        pytest.param(10**5000, "rad", "too large", id="of more digits than Python prints"),
        (math.nan, "s", "not a finite number"),
        (math.inf, "s", "not a finite number"),
    ],
)
def test_wrong_input_is_one_sentence(text: str | float, unit: str, words: str) -> None:
    with pytest.raises(UserError, match=words) as caught:
        parse(text, unit)
    assert "\n" not in str(caught.value)
    assert re.search("; (write one|correct it|name one|give a unit)", str(caught.value))


def test_every_display_unit_converts_to_its_unit() -> None:
    for actuator in actuators().values():
        for variant in actuator.variants:
            plant = actuator.plant_of(variant.name)
            shown = [(p.param.display, p.param.unit) for p in plant.parameters.values()]
            shown += [(wire.display, wire.unit) for wire in plant.wire.values()]
            for display, unit in shown:
                exponents(unit)
                if display:
                    assert factor(display, unit) > 0.0


def test_units_outlive_the_installation_that_has_filled_the_cache(tmp_path: Path) -> None:
    """A clone that has been moved or deleted had its interpreter in it."""
    other = tmp_path / "other"
    shutil.copytree(Path(pint.__file__).parent, other / "pint")
    code = "from servo_models.units import factor; print(factor('ms', 's'))"
    env = os.environ | {"SERVO_MODELS_CACHE": str(tmp_path / "cache")}
    root = str(Path(servo_models.__file__).parents[1])
    for path in (f"{other}{os.pathsep}{root}", root):
        run = [sys.executable, "-c", code]
        told = subprocess.check_output(run, env=env | {"PYTHONPATH": path}, text=True)
        assert told.strip() == "0.001"
        shutil.rmtree(other, ignore_errors=True)


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.9994, "999 ms"), (0.9996, "1 s"), (1.0, "1 s"), (0.0123, "12.3 ms")]
)
def test_times_are_told_without_powers_of_ten(seconds: float, text: str) -> None:
    assert in_time(seconds) == text


@pytest.mark.parametrize("value", [None, True, np.zeros(2), {}])
def test_what_is_no_quantity_is_refused(value: Any) -> None:
    with pytest.raises(UserError, match="is no quantity"):
        parse(value, "V")


def test_a_number_of_numpy_is_a_number() -> None:
    assert parse(np.int64(3), "V") == 3.0  # type: ignore[arg-type]
    assert parse(np.float32(0.5), "V") == 0.5
