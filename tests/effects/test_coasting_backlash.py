"""Play before a mass that coasts: against another integrator of the two masses, and by laws."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array

TIMES = np.arange(0.0, 0.6, 1e-3)
STEPS = 0.3 * np.sign(np.sin(2.0 * math.pi * 3.0 * TIMES + 1e-9))
CLOCKS = {"sample_hold.period": 0.0, "sensor_quantisation.step": 0.0, "internal_step": 2.5e-4}


def servo(half_width: float, share: float, **more: float) -> Model:
    given = {"coasting_backlash.half_width": half_width, "coasting_backlash.share": share}
    given["coasting_backlash.friction_share"] = 0.0
    named = {f"coasting_backlash.{name}": value for name, value in more.items()}
    return model("smart_servo", "xl330", {**CLOCKS, **given, **named})


def two_masses(chosen: Model, goal: Array, load: float) -> Array:
    """Angle and rate of the output, by LSODA from one row to the next, shape (n, 2)."""
    v, own = chosen.values, "coasting_backlash."
    half, share = v[own + "half_width"], v[own + "share"]
    behind, before = share * v["inertia"], (1.0 - share) * v["inertia"]
    natural = 2.0 * math.pi * v[own + "contact"]
    volts, k = 5.0, v["torque_constant"]

    def slopes(_: float, x: Array, wanted: float) -> list[float]:
        over = math.copysign(max(abs(x[0] - x[2]) - half, 0.0), x[0] - x[2])
        push = behind * (natural**2 * over + 2.0 * v[own + "damping"] * natural * (x[1] - x[3]))
        push = max(push, 0.0) if over > 0.0 else min(push, 0.0) if over < 0.0 else 0.0
        duty = min(max(v["gain"] * v["loop_factor"] * (wanted - x[2]), -1.0), 1.0)
        motor = k * (duty * volts - k * x[1]) / v["resistance"]
        return [x[1], (motor - push) / before, x[3], (push - load) / behind]

    x, out = np.zeros(4), np.empty((len(goal), 2))
    for i, wanted in enumerate(goal):
        out[i] = x[2:]
        span = (0.0, TIMES[1])
        x = solve_ivp(
            slopes, span, x, "LSODA", args=(wanted,), rtol=1e-9, atol=1e-11, max_step=1e-4
        ).y[:, -1]
    return out


@pytest.mark.parametrize("share", [0.05, 0.3, 0.7])
@pytest.mark.parametrize("load", [0.0, 0.1])
def test_it_is_two_masses_whose_contact_pushes(share: float, load: float) -> None:
    chosen = servo(0.01, share)
    out = simulate(chosen, TIMES, {"goal": STEPS, "load_torque": load})
    exact = two_masses(chosen, STEPS, load)
    bare = simulate(model("smart_servo", "xl330", CLOCKS), TIMES, {"goal": STEPS})
    apart = np.abs(bare["angle"] - exact[:, 0]).max()
    assert np.abs(out["angle"] - exact[:, 0]).max() < 0.02 * apart
    assert np.abs(out["rate"] - exact[:, 1]).max() < 0.01 * np.ptp(exact[:, 1])


def test_the_output_keeps_its_rate_where_nothing_pushes() -> None:
    """To the last bit: the play is crossed without load, friction or spring."""
    rate = simulate(servo(0.05, 0.3), TIMES, {"goal": STEPS})["rate"]
    still = np.diff(rate) == 0.0
    moving = np.abs(rate[1:]) > 0.1
    assert (still & moving).sum() > 20


def test_a_load_in_the_play_only_moves_the_output() -> None:
    """Free fall: rate -load / inertia behind the play, until it meets the gear."""
    chosen = servo(0.2, 0.5)
    behind = 0.5 * chosen.values["inertia"]
    times = np.linspace(0.0, 0.05, 51)
    out = simulate(chosen, times, {"load_torque": 0.05, "enabled": 0.0})
    free = 0.5 * 0.05 / behind * times**2 < 0.2
    np.testing.assert_allclose(out["rate"][free], -0.05 / behind * times[free], rtol=1e-9)


def test_a_play_of_almost_nothing_is_a_stiff_gear() -> None:
    goal = {"goal": 0.1 * np.sin(2.0 * math.pi * 2.0 * TIMES)}
    bare = simulate(model("smart_servo", "xl330", CLOCKS), TIMES, goal)
    stiff = simulate(servo(1e-9, 0.3, contact=1000.0), TIMES, goal)
    assert np.abs(stiff["angle"] - bare["angle"]).max() < 1e-3 * np.ptp(bare["angle"])


@pytest.mark.parametrize("load", [0.02, 0.08])
def test_the_friction_of_the_output_stops_it_and_holds_it(load: float) -> None:
    """A block on a rough plane: it slides (load - friction) / inertia, or stays to the last bit."""
    level, part = 0.1, 0.5
    chosen = servo(0.2, 0.5, friction_share=part)
    chosen = replace(chosen, values={**chosen.values, "coulomb_friction.level": level})
    behind = 0.5 * chosen.values["inertia"]
    times = np.linspace(0.0, 0.05, 51)
    out = simulate(chosen, times, {"load_torque": load, "enabled": 0.0})
    slides = max(load - part * level, 0.0) / behind
    free = 0.5 * slides * times**2 < 0.2
    np.testing.assert_allclose(out["rate"][free], -slides * times[free], rtol=1e-9)


def test_friction_takes_the_energy_of_a_coasting_output() -> None:
    """Released in the play with a rate, it stops after rate^2 inertia / (2 friction)."""
    level, rate = 0.1, 1.0
    chosen = servo(0.2, 0.5, friction_share=1.0)
    chosen = replace(chosen, values={**chosen.values, "coulomb_friction.level": level})
    behind = 0.5 * chosen.values["inertia"]
    times = np.linspace(0.0, 0.2, 201)
    state = chosen.at_rest(chosen.vector)
    names = [state.name for state in chosen.plant.states]
    state[names.index("coasting_speed")] = rate
    inputs = np.column_stack([np.full(201, float(wire.rest)) for wire in chosen.plant.inputs])
    inputs[:, [wire.name for wire in chosen.plant.inputs].index("enabled")] = 0.0
    out = chosen.ran(chosen.vector, state, times, inputs)
    way = out[-1, chosen.plant.outputs.index("angle")]
    assert way == pytest.approx(0.5 * rate**2 * behind / level, rel=0.03)
    assert abs(out[-1, chosen.plant.outputs.index("rate")]) < 1e-12
