"""The smart servo: a pendulum lifted and dropped, and the logs of a real one."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
from plants.sliding import slide

from servo_models.simulate import Array, model, simulate

TICK = 1e-3
GRAVITY = 0.49 * 9.81 * 0.1
PENDULUM = {
    "torque_constant": 0.6,
    "resistance": 4.0,
    "inertia": 6e-3,
    "gain": 400.0,
    "loop_factor": 0.0028773,
    "gravity_load.torque": 0.48,
    "coulomb_friction.level": 0.02,
    "stribeck_friction.excess": 0.02,
    "stribeck_friction.speed": 0.02,
    "load_friction.coefficient": 0.15,
}


def by_hand(goal: Array, enabled: Array) -> Array:
    """Angle of the pendulum at the ticks; between them ``solve_ivp`` from stop to stop."""
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


def test_it_lifts_a_pendulum_and_drops_it() -> None:
    ticks = np.arange(1600)
    goal = np.where(ticks < 700, 0.8, -0.5)
    enabled = np.where(ticks < 1000, 1.0, 0.0)
    chosen = model("smart_servo", "xl330", {**PENDULUM, "internal_step": 5e-4})
    run = simulate(chosen, TICK * ticks, {"goal": goal, "enabled": enabled})
    assert run["duty"].max() > 0.9
    assert np.all(run["rate"][680:700] == 0.0), "friction holds the arm before the goal is reached"
    assert abs(run["angle"][699] - 0.8) > 0.01
    np.testing.assert_allclose(run["angle"], by_hand(goal, enabled), atol=3e-7)


def mean_error(folder: Path, friction: dict[str, float]) -> float:
    """Mean absolute error [rad] of the nominal servo over all logs of the pendulum."""
    errors = []
    for path in sorted(folder.glob("*.json")):
        log = json.loads(path.read_text())
        columns = {
            name: np.array([entry[name] for entry in log["entries"]], dtype=float)
            for name in ("timestamp", "goal_position", "position", "torque_enable")
        }
        values = {"gain": float(log["kp"]), "gravity_load.torque": GRAVITY, **friction}
        inputs = {"goal": columns["goal_position"], "enabled": columns["torque_enable"]}
        run = simulate(model("smart_servo", "xl330", values), columns["timestamp"], inputs)
        errors.append(float(np.mean(np.abs(run["angle"] - columns["position"]))))
    return float(np.mean(errors))


def test_friction_that_grows_with_the_load_brings_the_nominal_servo_near_a_real_one(
    logs_folder: Path,
) -> None:
    """Nothing is fitted: data sheet, and the published coefficient of load friction."""
    rig = logs_folder / "bam_xl330"
    dry = {"load_friction.coefficient": 0.26, "coulomb_friction.level": 0.02}
    assert mean_error(rig, dry) < 0.6 * mean_error(rig, {})
