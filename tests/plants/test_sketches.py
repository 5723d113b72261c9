"""The stepper carries a discrete loop round a plant with dry friction.

Both sketches run against a second simulation that shares nothing with them: each tick in
plain Python, each interval between ticks by ``solve_ivp`` from reversal to reversal.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from plants import emps, firmware_servo
from plants.bench import respond
from plants.sliding import slide
from servo_models.simulate import Array

TICK = 1e-3


def emps_by_hand(reference: Array, level: float, quantum: float) -> tuple[Array, Array]:
    """Position and applied drive, each just after a tick; ``reference`` at the ticks."""
    mass, viscous, offset, force_gain = 95.1, 203.5, -3.16, 35.15
    position = speed = drive = waiting = 0.0
    readings = [0.0, 0.0]
    out = []
    for goal in reference:
        reading = quantum * math.floor(position / quantum + 0.5) if quantum else position
        estimate = (reading - readings[-2]) / (2.0 * TICK)
        drive = waiting
        waiting = float(np.clip(243.45 * (160.18 * (goal - reading) - estimate), -10.0, 10.0))
        readings.append(reading)
        out.append((position, drive))
        force = force_gain * drive - offset
        position, speed = slide(
            lambda _, v, force=force: force - viscous * v,
            lambda *_: level,
            mass,
            position,
            speed,
            TICK,
        )
    return tuple(np.array(out).T)


@pytest.mark.parametrize(("level", "quantum"), [(0.0, 0.0), (20.4, 0.0), (20.4, 1e-6)])
@pytest.mark.parametrize("ticks_per_step", [1, 4])
def test_emps_loop(level: float, quantum: float, ticks_per_step: int) -> None:
    ticks = 600
    held = np.arange(ticks) // ticks_per_step * ticks_per_step
    reference = 0.01 * (1.0 - np.cos(20.0 * TICK * held)) + np.where(held > 400, 2e-3, 0.0)
    position, drive = emps_by_hand(reference, level, quantum)
    rows = slice(None, None, ticks_per_step)
    values = {"coulomb.level": level, "encoder_quantum.step": quantum}
    out = respond(emps.PLANT, values, TICK * np.arange(ticks)[rows], reference[rows])
    assert np.abs(drive).max() > 3.0
    accuracy = max(1e-10, 2.0 * quantum)
    np.testing.assert_allclose(out["shaft_angle"], position[rows], atol=accuracy)
    # a row ends just before its tick, which belongs to the step that starts there
    before = drive[ticks_per_step - 1 :: ticks_per_step][:-1]
    np.testing.assert_allclose(out["drive"][1:], before, atol=1e5 * accuracy)


def servo_by_hand(goal: Array, enabled: Array) -> Array:
    """Angle of the arm at the ticks."""
    count, supply, k_t, resistance, inertia = 2.0 * math.pi / 4096.0, 7.4, 0.6, 4.0, 6e-3
    angle = speed = 0.0
    out = []
    for wanted, on in zip(goal, enabled):
        reading = count * math.floor(angle / count + 0.5)
        duty = float(np.clip(400.0 * 0.0028773 * (wanted - reading), -1.0, 1.0))
        out.append(angle)

        def net(x: float, v: float, duty: float = duty, on: float = on) -> float:
            motor = k_t * (duty * supply - k_t * v) / resistance if on else 0.0
            return motor - 0.48 * math.sin(x)

        def friction(x: float, v: float) -> float:
            stribeck = 0.02 * math.exp(-((v / 0.2) ** 2))
            return 0.02 + stribeck + 0.15 * abs(0.48 * math.sin(x))

        angle, speed = slide(net, friction, inertia, angle, speed, TICK)
    return np.array(out)


def test_firmware_servo_lifts_a_pendulum_and_drops_it() -> None:
    ticks = np.arange(1600)
    goal = np.where(ticks < 700, 0.8, -0.5)
    enabled = np.where(ticks < 1000, 1.0, 0.0)
    expected = servo_by_hand(goal, enabled)
    inputs = np.column_stack([goal, enabled, np.full(1600, 7.4), np.zeros(1600)])
    out = respond(firmware_servo.PLANT, firmware_servo.TYPICAL, TICK * ticks, inputs)
    assert out["duty"].max() > 0.9
    resting = out["shaft_speed"][680:700]
    assert np.all(resting == 0.0), "friction holds the arm before the goal is reached"
    assert abs(out["shaft_angle"][699] - 0.8) > 0.01
    np.testing.assert_allclose(out["shaft_angle"], expected, atol=3e-7)
