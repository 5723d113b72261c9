"""Levels, names and layout of a flattened plant."""

from __future__ import annotations

import ast
from typing import Annotated, Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from servo_models.catalogue import actuators
from servo_models.core.block import Block, Param, block, effect
from servo_models.core.compiled import plain_make
from servo_models.core.flat import Chunk, neutral_effects
from servo_models.core.flatten import flatten
from servo_models.core.plant import Plant, State, Wire, place
from servo_models.core.printer import Printer
from servo_models.core.stepper import run_text, step_text
from servo_models.effects.cogging import cogging
from servo_models.effects.constant_load import constant_load
from servo_models.effects.dead_zone import dead_zone
from servo_models.effects.gain_error import gain_error
from servo_models.effects.offset import offset
from tests.support.bench import held_bench, respond, step_constant


@block("doubled")
def from_parameter(internal_step: float) -> float:
    """Depends on a parameter only."""
    return 2.0 * internal_step


@block("commanded")
def from_input(u: float, doubled: float) -> float:
    """Depends on an input."""
    return u + doubled


@block("slope")
def from_state(height: float, commanded: float) -> float:
    """Depends on a state."""
    return commanded - height


def plant(*chain: Block, start: float | str = 0.0, outputs: tuple[str, ...] = ("height",)) -> Plant:
    return Plant(
        inputs=(Wire("u", "1", "input"),),
        wires=(Wire("doubled", "1", "wire"), Wire("commanded", "1", "wire")),
        chain=chain,
        states=(State(Wire("height", "1", "state"), "slope", start=start),),
        outputs=outputs,
        constants=step_constant(0.5),
    )


CHAIN = (from_parameter, from_input, from_state)


def written(section: list[Chunk]) -> set[str]:
    return {name for chunk in section for name in chunk.writes}


def test_a_block_runs_as_seldom_as_its_arguments_allow() -> None:
    flat = flatten(plant(*CHAIN), "levels")
    assert written(flat.setup) == {"doubled"}
    assert written(flat.held) == {"commanded"}
    assert written(flat.stage) == {"slope"}


def test_an_effect_that_needs_a_state_lifts_its_wire_without_piling_up() -> None:
    """The wire keeps its lower version, from which every evaluation starts anew."""

    @block("height_seen")
    def seen(height: float, doubled: float) -> float:
        """The lifted wire as an output."""
        return doubled

    lift = place("lift", cogging, "doubled", shaft_angle="height")
    lifting = Plant(
        inputs=(Wire("u", "1", "input"),),
        wires=(Wire("doubled", "1", "wire"),),
        chain=(from_parameter, lift, rising, seen),
        states=(State(Wire("height", "1", "state"), "slope", start=1.0),),
        outputs=("height_seen", "height"),
        constants=step_constant(0.5),
    )
    out = respond(lifting, {"lift.torque": 1.0, "lift.count": 1.0, "lift.phase": 0.0}, range(5))
    np.testing.assert_allclose(out["height_seen"], 1.0 + np.sin(out["height"]), rtol=1e-14)


@block("slope")
def rising(height: float) -> float:
    """x' = 1."""
    return 1.0 + 0.0 * height


@pytest.mark.parametrize(
    ("chain", "sentence"),
    [
        ((from_parameter, from_state), "unknown wire 'commanded' in block 'from_state'"),
        ((from_input, from_state), "did you mean"),
    ],
)
def test_a_wire_that_nothing_defines_is_named(chain: tuple[Block, ...], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        flatten(plant(*chain), "broken")


def test_a_start_value_may_not_depend_on_inputs() -> None:
    with pytest.raises(ValueError, match="parameters only"):
        flatten(plant(*CHAIN, start="commanded"), "broken")
    assert flatten(plant(*CHAIN, start="doubled"), "fine").start[0][0] == "doubled"


def test_effects_on_one_wire_act_in_the_order_of_the_chain() -> None:
    then_offset = held_bench(gain_error, place("after", offset, "signal"))
    then_gain = held_bench(offset, place("after", gain_error, "signal"))
    times, u = [0.0, 1.0], 2.0
    one = respond(then_offset, {"effect.error": 0.5, "after.value": 0.3}, times, u)
    two = respond(then_gain, {"effect.value": 0.3, "after.error": 0.5}, times, u)
    assert one["signal"][-1] == pytest.approx(1.5 * 2.0 + 0.3)
    assert two["signal"][-1] == pytest.approx(1.5 * (2.0 + 0.3))


def test_parameters_take_unit_and_scale_from_the_wire() -> None:
    wire = Wire("drive", "V", "drive", scale=50.0, display="mV")
    made = Plant(
        inputs=(Wire("u", "V", "input"),),
        wires=(wire,),
        chain=(place("zone", dead_zone, "drive"),),
        states=(),
        outputs=(),
    ).parameters["zone.half_width"]
    own = dead_zone.params["half_width"]
    assert (made.param.unit, made.param.display) == ("V", "mV")
    assert made.param.high == 50.0 * own.high
    assert made.param.typical == 50.0 * own.typical


def test_an_effect_on_too_few_wires_is_refused() -> None:
    with pytest.raises(ValueError, match="acts on"):
        place("load", constant_load, "load", "friction")


@pytest.mark.parametrize("actuator", actuators())
def test_only_a_commit_sets_a_memory(actuator: str) -> None:
    """Stage lines run several times a step: what they set, the next evaluation would see."""
    flat = flatten(actuators()[actuator].plant, actuator)
    memories = {name for name, _ in flat.memory}
    lines = [line for chunk in (*flat.held, *flat.stage) for line in chunk.lines]
    stored = {
        node.id
        for node in ast.walk(ast.parse("\n".join(lines)))
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    assert memories
    assert not memories & stored


@pytest.mark.parametrize("actuator", actuators())
def test_what_only_effects_read_is_what_a_text_without_them_leaves_out(actuator: str) -> None:
    flat = flatten(actuators()[actuator].plant, actuator)
    every = set(flat.switches)

    rates = [rate for _, _, rate in flat.states]  # of effects too: guarded text has all states

    def kept(*effects: str) -> list[bool]:
        printer = Printer(flat, dropped=every.difference(effects), guarded=False)
        return printer.kept([*rates, *printer.slopes, *printer.memories, *flat.outputs])

    bare, full = kept(), kept(*every)
    for i, chunk in enumerate(flat.stage):
        if chunk.owner:
            assert not chunk.serves
            continue
        assert bool(chunk.serves) == (full[i] and not bare[i])
        assert all(kept(effect)[i] for effect in chunk.serves)
        assert not chunk.serves or not kept(*every.difference(chunk.serves))[i]


@block("warmth")
def warming(height: float) -> float:
    """Read by another block of the plant only, which effects alone read."""
    return height * height


@block("softness")
def softening(warmth: float) -> float:
    """Read by effects only."""
    return 1.0 + warmth


@block("weight")
def weighing(height: float) -> float:
    """Read by an effect, and in any case."""
    return 2.0 * height


@block("slope")
def pulled(force: float, weight: float) -> float:
    """A weight on what pulls it."""
    return force - weight


@block("force")
def pulling(height: float) -> float:
    """The force that effects act on."""
    return 3.0 - height


@effect("signal", source="a test")
def softened(
    signal: float, by: float, share: Annotated[float, Param("1", "share", high=1.0, switch=True)]
) -> float:
    """A part of another wire is taken off."""
    return signal - share * by


SOFT = Plant(
    inputs=(Wire("u", "1", "input"),),
    wires=(Wire("force", "1", "wire"), Wire("softness", "1", "wire")),
    chain=(
        warming,
        softening,
        weighing,
        pulling,
        place("first", softened, "force", by="softness"),
        place("second", softened, "force", by="softness"),
        place("third", softened, "force", by="weight"),
        pulled,
    ),
    states=(State(Wire("height", "1", "state"), "slope", start=1.0),),
    outputs=("height",),
    constants=step_constant(0.05),
)


def test_a_wire_serves_the_effects_that_need_it_however_far_away() -> None:
    stage = {chunk.writes[0]: chunk for chunk in reversed(flatten(SOFT, "soft").stage)}
    assert stage["warmth"].serves == stage["softness"].serves == ("first", "second")
    assert not stage["weight"].serves
    assert not stage["force"].serves


@given(st.tuples(*[st.sampled_from([0.0, 0.3])] * 3))
def test_what_effects_alone_need_is_there_when_any_is_on(shares: tuple[float, ...]) -> None:
    """The text with all effects behind ifs against the one without those that are off."""
    flat = flatten(SOFT, "soft")
    values = dict(zip(("first__share", "second__share", "third__share"), shares))
    vector = [values.get(name, 0.05) for name in flat.params]
    namespace: dict[str, Any] = {}
    exec(compile(run_text(flat), "<flat text>", "exec"), namespace)
    make = plain_make(step_text(flat, neutral_effects(flat, vector)))
    start, step = make(vector)
    times, x, state = np.linspace(0.0, 1.0, 11), np.array(start()), start()
    out = np.empty((11, 1))
    assert namespace["run"](np.array(vector), x, times, np.zeros((11, 1)), out)[0] == 0
    steps = [step(state, [0.0], t, s) for t, s in zip([0.0, *times], np.diff(times, prepend=0.0))]
    np.testing.assert_array_equal(out[:, 0], [found[1][0] for found in steps])
