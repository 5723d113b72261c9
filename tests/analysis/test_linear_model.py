"""Poles and zeros of small signals against published ones, and their picture."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from servo_models.analysis import pictures
from servo_models.analysis.linearise import linearise
from servo_models.catalogue import model


def test_poles_are_those_of_the_published_functions() -> None:
    """Of a servo of second order by its frequency and damping; of the torque motor as eq. 12."""
    servo = model("second_order_servo")
    w, d = servo.values["natural_frequency"], servo.values["damping_ratio"]
    poles, zeros = linearise(servo).poles_and_zeros("pulse_width", "angle")
    expected = [-w * d - 1j * w * math.sqrt(1.0 - d * d), -w * d + 1j * w * math.sqrt(1.0 - d * d)]
    assert sorted(poles, key=lambda it: it.imag) == pytest.approx(expected, rel=1e-9)
    assert len(zeros) == 0
    poles, zeros = linearise(model("torque_motor", "identified")).poles_and_zeros(
        "voltage", "angle"
    )
    published = np.roots([1.0, 492.0, 1_582_240.0, 184_512_000.0])
    assert sorted(poles, key=abs) == pytest.approx(sorted(published, key=abs), rel=1e-6)
    assert len(zeros) == 0


def test_small_signals_of_several_sets_are_one_picture(tmp_path: Path) -> None:
    sets = {"as it is": model("sg90"), "slow": model("sg90", None, {"motor_time_constant": 0.06})}
    figure = pictures.small_signals(sets)
    assert [len(axes.lines) for axes in figure.axes] == [2, 2, 2, 5]  # poles and zeros, the axis
    pictures.save(figure, tmp_path / "sets.svg")
    assert (tmp_path / "sets.svg").stat().st_size > 10_000
