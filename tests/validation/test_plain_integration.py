"""The plain integration: exact where a solution is known, and a judge of what is printed."""

from __future__ import annotations

import functools
import math
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest

from servo_models.build import build
from servo_models.catalogue import model
from servo_models.core.block import Memory, Param, block
from servo_models.core.plant import Actuator, Placement, Plant, State, Variant, Wire, place
from servo_models.core.printer import Printer
from servo_models.core.simulate import Model
from servo_models.core.stepper import run_text
from servo_models.core.types import Array
from servo_models.effects.lag import lag
from servo_models.effects.quantisation import quantisation
from servo_models.effects.rate_limit import rate_limit
from servo_models.effects.sample_hold import sample_hold
from servo_models.effects.transport_delay import transport_delay
from servo_models.validation.fmu_subject import Subject
from servo_models.validation.plain_integration import integrate
from servo_models.validation.responses import effects_off, named_cases, plain_row, switched_on
from servo_models.validation.rows import Row
from servo_models.validation.runner import every_model
from tests.conftest import Run
from tests.support.sources import ROOT, imported

GAIN, FREQUENCY, DAMPING = 1745.3, 15.0, 0.7
TARGET = '''
"""A second-order servo whose author calls the angle asked for "target"."""
from typing import Annotated
from servo_models.core.plant import Actuator, Plant, State, Variant, Wire
from servo_models.core.block import Memory, Param, block

@block("target")
def command(
    pulse: float,
    gain: Annotated[float, Param("rad/s", "angle per pulse", default=1745.3, high=1e4)],
) -> float:
    """Angle asked for."""
    return gain * (pulse - 1.5e-3)

@block("acceleration", "turning")
def loop(
    target: float,
    angle: float,
    speed: float,
    frequency: Annotated[float, Param("rad/s", "frequency", default=15.0, low=1.0, high=100.0)],
    damping: Annotated[float, Param("1", "damping", default=0.7, high=2.0)],
) -> tuple[float, float]:
    """A mass on a spring to the angle asked for."""
    return frequency * frequency * (target - angle) - 2.0 * damping * frequency * speed, speed

ACTUATOR = Actuator(
    name="second_order", title="A servo", about="", source="",
    plant=Plant(
        inputs=(Wire("pulse", "s", "pulse", scale=5e-4, rest=1.5e-3, low=1e-3, high=2e-3),),
        wires=(Wire("target", "rad", "angle asked for"),),
        constants={"internal_step": Param("s", "step", default=1e-3, low=1e-6, high=1e-2)},
        chain=(command, loop),
        states=(
            State(Wire("angle", "rad", "angle"), "turning"),
            State(Wire("speed", "rad/s", "speed", scale=10.0), "acceleration"),
        ),
        outputs=("angle", "target"),
    ),
    variants=(Variant("plain", "", {}, ""),),
    stop_time=2.0, step_size=0.01, step=("pulse", 5e-4),
)
'''


@block("error")
def comparator(goal: float, angle: float) -> float:
    """What is asked for over what is there."""
    return goal - angle


@block("speed")
def follow(
    error: float,
    time_constant: Annotated[float, Param("s", "lag", default=0.02, low=1e-3, high=1.0)],
) -> float:
    """First order."""
    return error / time_constant


@block("reading")
def sensor(angle: float) -> float:
    """What is read."""
    return angle


def joint(*before: Placement, behind: tuple[Placement, ...] = (), **values: float) -> Model:
    """A lag of 20 ms from the goal to the angle, with effects."""
    plant = Plant(
        inputs=(Wire("goal", "rad", "goal", low=-4.0, high=4.0),),
        wires=(
            Wire("error", "rad", "error"),
            Wire("speed", "rad/s", "speed", scale=50.0),
            Wire("reading", "rad", "angle as read"),
        ),
        constants={"internal_step": Param("s", "step", default=1e-3, low=1e-6, high=1e-2)},
        chain=(
            *(it for it in before if it.on == ("goal",)),
            comparator,
            *(it for it in before if it.on == ("error",)),
            follow,
            sensor,
            *behind,
        ),
        states=(State(Wire("angle", "rad", "angle"), "speed"),),
        outputs=("angle", "reading"),
    )
    named = {name.replace("__", "."): value for name, value in values.items()}
    made = Actuator(
        "joint", "", "", "", plant, (Variant("plain", "", {}, ""),), 1.0, 0.01, ("goal", 1.0)
    )
    return model(made, None, named)


def step_answer(chosen: Model, times: Array, finer: int = 10) -> Array:
    """Angle at the communication points after a step of the goal to 1 at time 0."""
    course = integrate(chosen.plant, chosen.values, times, np.ones((len(times), 1)), finer)
    return course.outputs[course.rows, 0]


def delayed_lag(times: Array, delay: float = 0.0) -> Array:
    return np.where(times > delay, 1.0 - np.exp(-(times - delay) / 0.02), 0.0)


TIMES = np.cumsum([0.0, *(1e-3 * np.resize([1.0, 2.5, 0.4, 7.3, 3.7], 20))])


KNOWN = {f"servo_models.{name}" for name in ("core.plant", "core.block", "core.types", "errors")}


def test_it_knows_nothing_of_what_is_printed() -> None:
    path = ROOT / "servo_models" / "validation" / "plain_integration.py"
    own = {name.rpartition(".")[0] for name in imported(path) if name.startswith("servo_models.")}
    assert own <= KNOWN


def test_a_second_order_servo_is_exact(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(TARGET)
    plant = model(str(tmp_path / "mine.py")).plant
    values = {"internal_step": 1e-3, "gain": GAIN, "frequency": FREQUENCY, "damping": DAMPING}
    course = integrate(plant, values, np.array([0.0, 0.4]), np.full((2, 1), 2e-3), 10)
    root = math.sqrt(1.0 - DAMPING**2)
    phase = FREQUENCY * root * 0.4
    swing = math.exp(-DAMPING * FREQUENCY * 0.4) * (
        math.cos(phase) + DAMPING / root * math.sin(phase)
    )
    exact = math.degrees(GAIN * 0.5e-3 * (1.0 - swing))
    assert exact == pytest.approx(50.979, abs=5e-4)
    assert math.degrees(course.outputs[-1, 0]) == pytest.approx(exact, abs=1e-7)


def test_a_lag_is_exact() -> None:
    assert step_answer(joint(), TIMES) == pytest.approx(delayed_lag(TIMES), abs=1e-9)


def test_a_delay_and_a_hold_are_exact() -> None:
    """Clocks need the plain loop; between them it is exact to its order."""
    late = joint(place("delay", transport_delay, "goal"), delay__time=0.01234)
    assert step_answer(late, TIMES) == pytest.approx(delayed_lag(TIMES, 0.01234), abs=2e-8)
    held = joint(place("hold", sample_hold, "error"), hold__period=0.01)
    times = 0.01 * np.arange(8.0)
    kept = 1.0 - 0.01 / 0.02  # of the error, in a frame whose speed does not change
    assert step_answer(held, times) == pytest.approx(1.0 - kept ** np.arange(8.0), abs=1e-12)


def test_a_lag_before_a_lag_is_exact() -> None:
    both = joint(place("slow", lag, "goal"), slow__time_constant=0.005)
    exact = 1.0 - (0.02 * np.exp(-TIMES / 0.02) - 0.005 * np.exp(-TIMES / 0.005)) / 0.015
    assert step_answer(both, TIMES) == pytest.approx(exact, abs=2e-5)


def row_of(chosen: Model, tmp_path: Path, name: str = "it") -> Row:
    subject = Subject(build(chosen, tmp_path / "joint.fmu"), chosen.actuator)
    row = plain_row(subject, chosen, name)
    subject.close()
    return row


EFFECTS = (
    place("limit", rate_limit, "error"),
    place("slow", lag, "error"),
    place("hold", sample_hold, "error"),
    place("delay", transport_delay, "goal"),
)
STEPS = (place("steps", quantisation, "reading"),)


def on(name: str) -> Model:
    chosen = joint(*EFFECTS, behind=STEPS)
    off = effects_off(chosen)
    return switched_on(chosen, off[name]) if name else chosen


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["", "limit", "slow", "hold", "delay", "steps"])
def test_what_is_printed_agrees(name: str, tmp_path: Path) -> None:
    row = row_of(on(name), tmp_path)
    assert row.passed, row


Fault = Callable[[str], str]
FAULTS: dict[str, tuple[str, Fault]] = {
    "a wrong Runge-Kutta weight": ("", lambda text: re.sub(r"dt / 6\.0", "dt / 6.02", text)),
    "a wrong half step": ("", lambda text: re.sub(r"0\.5 \* (_?dt)\b", r"0.6 * \1", text)),
    "no last stage": ("", lambda text: re.sub(r"last = 1 if (.*) else 5", r"last = 4", text)),
    "steps that are cut too late": (
        "delay",
        lambda text: re.sub(r"(_?latest) = (_?target) - _?tolerance", r"\1 = -1.0", text),
    ),
    "inputs one row late": (
        "",
        lambda text: re.sub(r"(_?row) - 1 if _?row > 0", r"\1 - 2 if \1 > 1", text),
    ),
    "a law with another sign": ("", lambda text: re.sub(r"goal(\w*) - ", r"goal\1 + ", text)),
}


@pytest.mark.thorough
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_what_is_printed_is_found(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    effect, change = FAULTS[fault]
    assert change(run_text(on(effect).flat)) != run_text(on(effect).flat)
    monkeypatch.setattr(
        sys.modules[Model.__module__], "run_text", lambda flat: change(run_text(flat))
    )
    row = row_of(on(effect), tmp_path)
    assert row.passed is False, row


@pytest.mark.thorough
@pytest.mark.parametrize("effect", ["limit", "slow"])
def test_a_memory_that_is_kept_at_every_stage_is_found(
    effect: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = Printer.stage

    def wrong(self: Printer, k: int | None) -> list[str]:
        return [*right(self, k), *self.lines(self.flat.stage_commits)]

    monkeypatch.setattr(Printer, "stage", wrong)
    row = row_of(on(effect), tmp_path)
    assert row.passed is False, row


def test_a_wrong_effect_of_the_fmu_is_found(tmp_path: Path) -> None:
    """The simulation is right, and the FMU is too until the effect is switched on."""
    chosen = on("limit")
    flat = chosen.flat
    changed = [
        chunk._replace(lines=[re.sub(r"(\w*reach\w* = )", r"\g<1>0.9 * ", x) for x in chunk.lines])
        if chunk.owner == "limit"
        else chunk
        for chunk in flat.stage
    ]
    assert changed != flat.stage
    path = build(replace(on(""), flat=replace(flat, stage=changed)), tmp_path / "joint.fmu")
    subject = Subject(path, chosen.actuator)
    rows = [plain_row(subject, one, name) for name, one in named_cases(subject.model, True).items()]
    subject.close()
    failed = {row.case.split(": ")[1] for row in rows if not row.passed}
    assert failed == {"limit on", "all effects on"}


@pytest.mark.thorough
def test_an_author_may_call_a_wire_target(tmp_path: Path, run: Run) -> None:
    """``validate --actuator`` says that the printed text is right, or that it is not."""
    mine = tmp_path / "mine.py"
    mine.write_text(TARGET)
    params = tmp_path / "P.toml"
    params.write_text('actuator = "mine.py"\n')
    code, out, err = run("validate", "--params", params)
    assert (code, err) == (0, "")
    assert "blocks as plain functions: as it is" in out


def test_whatever_a_block_raises_is_a_failed_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: object) -> None:
        raise TypeError("float expected")

    monkeypatch.setattr("servo_models.validation.responses.integrate", fails)
    row = row_of(on(""), tmp_path)
    assert row.passed is False
    assert row.note == "a block fails: TypeError: float expected"


def test_an_own_actuator_that_does_not_fit_together_is_refused(tmp_path: Path, run: Run) -> None:
    mine = tmp_path / "mine.py"
    mine.write_text(TARGET)
    assert run("build", mine, "--out", tmp_path)[0] == 0
    mine.write_text(TARGET.replace("chain=(command, loop)", "chain=(loop, command)"))
    code, _, err = run("validate", tmp_path / "second_order.fmu", "--actuator", mine)
    assert code == 2
    assert "mine.py': unknown wire 'target' in block 'loop'" in err
    assert len(err.splitlines()) == 1


@block("swing", "torque")
def two_wells(
    angle: float, speed: float, goal: float, coin: Annotated[float, Memory()]
) -> tuple[float, float, float]:
    """A ball between two wells, driven and hardly damped: which one it ends in is chaos."""
    return speed, 4e4 * angle * (1.0 - angle * angle) - 2.0 * speed + 2e4 * goal, coin


def test_chaos_is_compared_for_as_long_as_two_steps_agree(tmp_path: Path) -> None:
    """Here the plain integration itself, at two steps, goes two ways after a while."""
    plant = Plant(
        inputs=(Wire("goal", "1", "push", scale=2.0, low=-4.0, high=4.0),),
        wires=(Wire("swing", "1/s", ""), Wire("torque", "1/s2", "", scale=1e4)),
        constants={"internal_step": Param("s", "step", default=2e-3, low=1e-6, high=1e-2)},
        chain=(two_wells,),
        states=(
            State(Wire("angle", "1", "place"), "swing"),
            State(Wire("speed", "1/s", "speed", scale=200.0), "torque"),
        ),
        outputs=("angle",),
    )
    made = Actuator(
        "joint", "", "", "", plant, (Variant("plain", "", {}, ""),), 1.0, 0.01, ("goal", 1.0)
    )
    row = row_of(model(made), tmp_path)
    assert row.passed is not False, row
    assert "beyond it depends on the step by itself" in row.note


def every_effect() -> list[tuple[str, str]]:
    """Each effect of the catalogue once, with an actuator that has it."""
    found: dict[str, tuple[str, str]] = {}
    for chosen in every_model():
        for name, placements in chosen.plant.placements.items():
            if name in effects_off(chosen):
                second = chosen.variant == "oscillatory_motor"
                fmu = "oscillatory" if second else chosen.actuator.name
                found.setdefault(placements[0].effect.name, (fmu, name))
    return sorted(found.values())


@pytest.fixture(scope="module")
def subjects(fmu_file: Callable[[str], Path]) -> Iterator[Callable[[str], Subject]]:
    """Return the FMU of a name, opened once."""
    with ExitStack() as stack:

        @functools.cache
        def found(name: str) -> Subject:
            subject = Subject(fmu_file(name))
            stack.callback(subject.close)
            return subject

        yield found


@pytest.mark.thorough
@pytest.mark.parametrize(("name", "owner"), every_effect())
def test_every_effect_of_the_catalogue_agrees(
    name: str, owner: str, subjects: Callable[[str], Subject]
) -> None:
    subject = subjects(name)
    chosen = switched_on(subject.model, effects_off(subject.model)[owner])
    row = plain_row(subject, chosen, owner)
    assert row.passed, row


def test_a_block_at_several_places_has_memories_of_its_own_at_each() -> None:
    """As the curves of a residual map have."""
    values = {"residual_map.torque": 1e-4, "residual_map.rate": 1.0, "residual_map.command": 1.0}
    chosen = model("torque_motor", "measured", values)
    times = np.linspace(0.0, 0.02, 41)
    inputs = np.column_stack([np.where(times > 0.005, 10.0, 0.0), np.zeros(41)])
    plain = integrate(chosen.plant, chosen.values, times, inputs, finer=10)
    angle = chosen.run(times, inputs)[:, 0]
    np.testing.assert_allclose(plain.outputs[plain.rows, 0], angle, atol=1e-4 * np.ptp(angle))
