"""Motions faster than the internal step: it follows them, or the run is refused in words."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.analysis.simulate import Result, simulate
from servo_models.catalogue import model
from servo_models.core.block import Block, Param, block
from servo_models.core.plant import Actuator, Plant, State, Variant, Wire
from servo_models.core.simulate import MOST_TRIED, Model
from servo_models.core.types import Array
from servo_models.errors import UserError
from tests.conftest import Run
from tests.fuzz.parameters import Found, judged
from tests.support.bench import step_constant
from tests.support.fmu_host import Host

COARSE = 5e-3  # internal step [s] of the plants below
WITHIN = 1e-3  # error that a run may make in silence, in full scales


def own(*chain: Block, states: tuple[State, ...], outputs: tuple[str, ...]) -> Actuator:
    """An actuator as a user declares one, whoever knows how fast it is."""
    plant = Plant(
        inputs=(Wire("u", "1", "input", low=-10.0, high=10.0),),
        wires=(Wire("spike", "1", "output"), Wire("side", "1", "output")),
        chain=chain,
        states=states,
        outputs=outputs,
        constants=step_constant(COARSE),
    )
    variants = (Variant("only", "as declared", {}, "a test"),)
    return Actuator("own", "own", "own", "a test", plant, variants, 1.0, 0.01, ("u", 1.0))


@block("rate")
def slow_or_quick(
    level: float, u: float, tau: Annotated[float, Param("s", "time constant", default=2e-3)]
) -> float:
    """tau x' = u - x."""
    return (u - level) / tau


@block("climb", "pull")
def spring(
    place: float,
    speed: float,
    u: float,
    rate: Annotated[float, Param("rad/s", "undamped", default=100.0, high=1e9)],
    damping: Annotated[float, Param("1", "damping ratio", default=0.1, high=10.0)],
) -> tuple[float, float]:
    """x'' = w^2 (u - x) - 2 d w x', with the speed in units of w."""
    return rate * speed, rate * (u - place) - 2.0 * damping * rate * speed


LEVEL = State(Wire("level", "1", "state"), "rate")
LAG = own(slow_or_quick, states=(LEVEL,), outputs=("level",))
SPRING = own(
    spring,
    states=(State(Wire("place", "1", "state"), "climb"), State(Wire("speed", "1", "s"), "pull")),
    outputs=("place", "speed"),
)
TIMES = 0.01 * np.arange(21)
JUMPS = np.repeat([1.0, -0.5, 0.3], 7)


def attempted(chosen: Model, u: float | Array) -> tuple[Result | None, str]:
    """A run over ``TIMES``, or none and why."""
    try:
        return simulate(chosen, TIMES, {"u": u}), ""
    except UserError as error:
        return None, str(error)


def exact_lag(tau: float) -> Array:
    level, found = 0.0, []
    for u in JUMPS:
        found.append(level)
        level = u + (level - u) * math.exp(-0.01 / tau)
    return np.array(found)


def test_a_time_constant_shorter_than_the_internal_step() -> None:
    """2 ms beside an internal step of 5 ms."""
    found = simulate(model(LAG), TIMES, {"u": JUMPS})
    assert np.abs(found["level"] - exact_lag(2e-3)).max() < WITHIN
    assert found.warnings == ()


@settings(max_examples=150, deadline=None, derandomize=True)
@given(exponent=st.floats(-9.0, 0.0))
def test_any_time_constant_is_right_or_refused(exponent: float) -> None:
    tau = 10.0**exponent
    found, words = attempted(model(LAG, parameters={"tau": tau}), JUMPS)
    if found is None:
        assert tau < COARSE / 64.0
        assert "too fast for its internal step" in words
        assert f"with 'tau' = 0.002 s instead of {tau:g}" in words
    else:
        assert found.warnings or np.abs(found["level"] - exact_lag(tau)).max() < WITHIN


@settings(max_examples=150, deadline=None, derandomize=True)
@given(exponent=st.floats(-1.0, 9.0), damping=st.floats(0.0, 0.9))
def test_any_resonance_is_right_or_refused_or_told(exponent: float, damping: float) -> None:
    rate, u = 10.0**exponent, 0.5
    chosen = model(SPRING, parameters={"rate": rate, "damping": damping})
    found, words = attempted(chosen, u)
    if found is None:
        assert rate > 1.0 / COARSE
        assert "too fast for its internal step" in words
        return
    turning = rate * math.sqrt(1.0 - damping**2)
    swing = np.cos(turning * TIMES) + damping * rate / turning * np.sin(turning * TIMES)
    exact = u * (1.0 - np.exp(-damping * rate * TIMES) * swing)
    error = np.abs(found["place"] - exact).max()
    assert found.warnings or error < WITHIN


@pytest.mark.thorough
@pytest.mark.parametrize("tau", [1e-5, 3e-6, 1e-7, 1e-9])
def test_the_internal_step_that_is_asked_for_will_do(tau: float) -> None:
    chosen = model(LAG, parameters={"tau": tau})
    with pytest.raises(UserError) as caught:
        simulate(chosen, TIMES[:9], {"u": JUMPS[:9]})
    needed = float(str(caught.value).split("internal_step = ")[1].split(" s")[0])
    times = TIMES[:9] if needed > 1e-7 else np.arange(9) * 1e-5
    again = model(LAG, parameters={"tau": tau, "internal_step": needed})
    level = simulate(again, times, {"u": JUMPS[:9]})["level"]
    exact = -0.5 + 1.5 * math.exp(-(times[8] - times[7]) / tau)
    assert level[-1] == pytest.approx(exact, abs=WITHIN)


@pytest.mark.parametrize(
    ("mass", "viscous"), [(0.1, 850.0), (0.1, 5e3), (0.3, 1e4), (1.0, 100.0), (1e4, 1e4)]
)
def test_a_light_carriage_in_thick_oil(mass: float, viscous: float) -> None:
    """Without its controller: the speed is one exponential.  0.1 kg and 850 N s/m once gave
    1e173, then NaN."""
    values = {"mass": mass, "viscous_coefficient": viscous, "position_gain": 0.0, "speed_gain": 0.0}
    found = simulate(model("linear_drive", "simple", values), TIMES, {"disturbance": 5.0})
    exact = 5.0 * 35.15 / viscous * -np.expm1(-viscous / mass * TIMES)
    assert np.abs(found["speed"] - exact).max() < 0.1 * WITHIN


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("name", "variant"),
    [
        ("linear_drive", "identified"),
        ("torque_motor", "identified"),
        ("torque_motor", "measured"),
        ("sg90", "measured"),
        ("sg90", "printed"),
        ("sg90", "oscillatory_motor"),
        ("smart_servo", "xl330"),
    ],
)
def test_random_parameters(name: str, variant: str) -> None:
    chosen, found, rng = model(name, variant), Found(), np.random.default_rng(11)
    simulate(chosen, [0.0])  # compiles
    for _ in range(12):
        judged(chosen, rng, found)
    assert found.wrong == []
    assert found.counts["quiet"] >= 3


@block("spike", "side")
def spiking(u: float, level: float) -> tuple[float, float]:
    """An output that leaves the finite numbers while the state stays where it is."""
    return 1e300 * u * 1e300 * u, level


def test_an_output_that_is_not_finite_is_named() -> None:
    plant = own(slow_or_quick, spiking, states=(LEVEL,), outputs=("side", "spike"))
    with pytest.raises(UserError, match=r"output 'spike' is not finite.* at t = 0.08 s"):
        simulate(model(plant), TIMES, {"u": np.where(TIMES > 0.065, 1.0, 0.0)})
    _, step = model(plant).stepper()
    assert step([0.0], [1.0], 0.0, 0.0)[0] == 1 + 1 + 1  # past one state, the second output


@block("rate")
def bang_bang(level: float, u: float) -> float:
    """A jump at 0 that nobody declared as a mode."""
    return u + (100.0 if level < 0.0 else -100.0)


@block("rate")
def ramp(u: float) -> float:
    """x' = u."""
    return u


def test_what_hangs_on_the_internal_step_is_told() -> None:
    switching = own(bang_bang, spiking_side, states=(LEVEL,), outputs=("level", "side"))
    found = simulate(model(switching), TIMES + 1e-3, {"u": 3.0})
    assert any("output 'side' depends on the internal step" in text for text in found.warnings)


@block("side")
def spiking_side(level: float) -> float:
    """Which side of the jump the state is on: chance, once it slides along it."""
    return 1.0 if level < 0.0 else 0.0


def test_an_output_far_beyond_its_full_scale_is_told() -> None:
    plant = own(ramp, states=(LEVEL,), outputs=("level",))
    times = np.linspace(0.0, 20.0, 101)
    assert simulate(model(plant), times, {"u": 4.9}).warnings == ()
    (told,) = simulate(model(plant), times, {"u": 5.1}).warnings
    assert "output 'level' reaches 1e+02 times its full scale at t = 20 s" in told


def test_the_command_line_tells_and_exits_with_1(run: Run) -> None:
    """A carriage that nothing holds, under full drive for a second."""
    free = ("--set", "position_gain=0", "--set", "speed_gain=0", "--set", "viscous_coefficient=0")
    code, out, _ = run("simulate", "linear_drive", *free, "--step", "disturbance=100")
    assert code == 1
    assert "times its full scale" in out
    assert run("simulate", "linear_drive")[0] == 0


Files = Callable[[str], Path]


def test_a_refusal_of_many_changes_tries_none_of_them_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A run may take seconds, and each change would be another one: 74 of them took 12 s."""
    every = model("linear_drive").values
    moved = {n: 0.999 * v for n, v in every.items() if v > 0.0 and n != "internal_step"}
    assert len(moved) > MOST_TRIED
    tried = model("linear_drive", None, {**moved, "mass": 0.1, "viscous_coefficient": 1e4})
    runs = []
    once = Model.ran

    def counted(self: Model, *args: Array) -> Array:
        runs.append(self)
        return once(self, *args)

    monkeypatch.setattr(Model, "ran", counted)
    with pytest.raises(UserError, match="too fast") as refused:
        simulate(tried, 4e-3 * np.arange(100), {"reference": 0.01})
    assert len(runs) == 1
    assert "it runs" not in str(refused.value)


def test_an_fmu_refuses_at_the_first_step_what_is_too_fast(fmu_folder: Files) -> None:
    with Host(fmu_folder("linear_drive")) as host:
        host.start({"reference": 0.01, "mass": 0.1, "viscous_coefficient": 1e4})
        with pytest.raises(FMICallException):
            host.fmu.doStep(0.0, 1e-3)
        assert "too fast for its internal step: it needs internal_step" in host.messages[0][1]


def test_an_fmu_refuses_a_resonance_that_would_never_end(fmu_folder: Files) -> None:
    """20 MHz; a step of 20 ms would take minutes."""
    with Host(fmu_folder("torque_motor")) as host:
        values = {"gear_compliance.compliance": 1e-6, "gear_compliance.inertia": 1e-8}
        with pytest.raises(FMICallException):
            host.start(values)
        assert "too fast for its internal step" in host.messages[0][1]


def test_a_fit_counts_what_is_too_fast_as_impossible() -> None:
    """A vector that cannot be simulated raises in the fits' own entry too."""
    chosen: Model = model("smart_servo", "xl330")
    values = {**chosen.values, "inertia": 1e-5, "torque_constant": 20.0, "resistance": 0.05}
    inputs = np.tile([0.5, 1.0, 7.4, 0.0], (21, 1))
    with pytest.raises(UserError, match="too fast"):
        chosen.from_rest(np.array(list(values.values())), TIMES, inputs)
