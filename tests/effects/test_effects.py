"""Laws of the catalogue: one test per law, over every placement in every actuator.

The truth of each single effect is in tests/effects.
"""

from __future__ import annotations

import functools
import inspect
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from servo_models.catalogue import actuators, model
from servo_models.core.block import Block
from servo_models.core.compiled import plain_make
from servo_models.core.flat import Flat, neutral_effects
from servo_models.core.flatten import flatten
from servo_models.core.plant import Placement, Plant
from servo_models.core.simulate import Model, flat_of
from servo_models.core.stepper import step_text
from servo_models.core.types import Array
from servo_models.effects import effects
from servo_models.units import exponents

PLANTS = {
    f"{actuator.name}-{variant.name}": (actuator.name, variant.name)
    for actuator in actuators().values()
    for variant in actuator.variants
    if variant is actuator.variants[0]
    or not actuator.plant_of(variant.name).has_equations_of(actuator.plant_of())
}
FIRST = {a.name: f"{a.name}-{a.variants[0].name}" for a in actuators().values()}
TWINS = ("dc_motor_current", "dc_motor_speed")
"""Actuators of the blocks of another one, behind another drive."""
MARKS = {
    plant: (pytest.mark.long,)
    if actuator in TWINS
    else ()
    if plant in FIRST.values()
    else (pytest.mark.thorough,)
    for plant, (actuator, _) in PLANTS.items()
}
"""Other equations of an actuator go through the same laws, and take as long."""
PLACEMENTS = [
    pytest.param(plant, name, id=f"{plant}-{name}", marks=MARKS[plant])
    for plant, (actuator, variant) in PLANTS.items()
    for name in actuators()[actuator].plant_of(variant).placements
]
EFFECTS = [
    pytest.param(block, id=f"{file}-{block.name}")
    for file, blocks in effects().items()
    for block in blocks
]
SLOWEST = {plant: 1.0 if plant.startswith("sg90") else 0.05 for plant in PLANTS}
"""Time [s] in which something happens."""
every_plant = pytest.mark.parametrize(
    "plant", [pytest.param(plant, marks=MARKS[plant]) for plant in PLANTS]
)
every_placement = pytest.mark.parametrize(("plant", "name"), PLACEMENTS)
every_effect = pytest.mark.parametrize("effect", EFFECTS)


@functools.cache
def chosen(plant: str) -> Model:
    return model(*PLANTS[plant])


def switches(plant: str, name: str) -> list[str]:
    """Full names of the switches of the effect placed as ``name``."""
    keys = {k for p in chosen(plant).plant.placements[name] for k in p.effect.switches}
    return [f"{name}.{key}" for key in sorted(keys)]


def values(plant: str, **changed: float) -> list[float]:
    """The variant's parameter vector with some ``changed``."""
    assert changed.keys() <= chosen(plant).values.keys()
    return list({**chosen(plant).values, **changed}.values())


def bare(plant: str) -> dict[str, float]:
    """All switches off."""
    names = chosen(plant).plant.placements
    return {switch: 0.0 for name in names for switch in switches(plant, name)}


def at(plant: str, name: str, level: str) -> dict[str, float]:
    """The switches of one effect at ``typical``, ``low`` or ``high``."""
    parameters = chosen(plant).plant.parameters
    return {s: getattr(parameters[s].param, level) for s in switches(plant, name)}


def all_typical(plant: str) -> dict[str, float]:
    names = chosen(plant).plant.placements
    return {k: v for name in names for k, v in at(plant, name, "typical").items()}


@functools.cache
def experiment(plant: str) -> tuple[Array, Array]:
    """Random held inputs over their scale on an irregular grid with equal neighbours.

    Every third command is back at the first one, give or take 0.4 %.
    """
    random = np.random.default_rng(7)
    sizes = random.exponential(SLOWEST[plant] / 100.0, 60)
    sizes[::7] = 0.0
    times = np.concatenate([[0.0], np.cumsum(sizes)])
    columns = []
    for wire in chosen(plant).plant.inputs:
        drawn = random.uniform(-1.0, 1.0, len(times))
        drawn[::3] = drawn[0] + 0.004 * drawn[::3]
        columns.append(np.clip(float(wire.rest) + wire.scale * drawn, wire.low, wire.high))
    return times, np.column_stack(columns)


def swing(plant: str) -> tuple[Array, Array]:
    """A slower one: the main input at one end of its scale, then at the other, small loads."""
    times, inputs = experiment(plant)
    main, *others = chosen(plant).plant.inputs
    swung = inputs.copy()
    swung[:30, 0], swung[30:, 0] = float(main.rest) + main.scale, float(main.rest) - main.scale
    swung[::3, 0] += 0.004 * main.scale
    if others:
        rest = float(others[0].rest)
        swung[:, 1] = rest + 0.1 * (swung[:, 1] - rest)
    return 20.0 * times, swung


def plain(
    flat: Flat, dropped: set[str], vector: list[float], times: Array, inputs: Array
) -> tuple[Array, list[float]]:
    """Outputs and final state by the plain Python text without the ``dropped`` effects."""
    start, step = plain_make(step_text(flat, dropped))(vector)
    x, out, rows = start(), [], inputs.tolist()
    for row, time in enumerate(times.tolist()):
        before = max(row - 1, 0)
        code, outputs = step(x, rows[before], float(times[before]), time - float(times[before]))
        assert code == 0
        out.append(outputs)
    return np.array(out), x


def response(
    plant: str, vector: list[float], times_inputs: tuple[Array, Array] | None = None
) -> Array:
    """Outputs by plain Python, neutral effects dropped."""
    flat = chosen(plant).flat
    times, inputs = times_inputs or experiment(plant)
    return plain(flat, neutral_effects(flat, vector), vector, times, inputs)[0]


def through(plant: str, vector: list[float]) -> Array:
    """Outputs of the compiled run, every effect compiled in."""
    base = chosen(plant)
    return replace(base, values=dict(zip(base.values, vector))).run(*experiment(plant))


def without(plant: Plant, names: set[str]) -> Plant:
    """The plant as if the placements ``names`` had never been declared."""
    chain = tuple(b for b in plant.chain if not (isinstance(b, Placement) and b.name in names))
    return replace(
        plant, chain=chain, states=tuple(s for s in plant.states if s.owner not in names)
    )


def same(one: Array, other: Array) -> bool:
    return bool(np.array_equal(one, other, equal_nan=False))


# Law 1: a neutral effect is the identity.


@every_plant
def test_all_neutral_is_the_bare_plant_bit_for_bit(plant: str) -> None:
    full = chosen(plant)
    off = bare(plant)
    stripped = without(full.plant, set(full.plant.placements))
    short = [full.values[name] for name in stripped.parameters]
    expected, _ = plain(flatten(stripped, "bare"), set(), short, *experiment(plant))
    executed, _ = plain(full.flat, set(), values(plant, **off), *experiment(plant))
    assert same(executed, expected), "effects executed at their neutral value"
    assert same(response(plant, values(plant, **off)), expected), "neutral effects dropped"
    assert same(through(plant, values(plant, **off)), expected), "compiled, behind their if"


@every_placement
def test_neutral_among_active_effects_is_as_if_never_declared(plant: str, name: str) -> None:
    full = chosen(plant)
    active = all_typical(plant) | {switch: 0.0 for switch in switches(plant, name)}
    given_ = dict(zip(full.values, values(plant, **active)))
    removed = without(full.plant, {name})
    short = [given_[key] for key in removed.parameters]
    expected, _ = plain(flatten(removed, "removed"), set(), short, *experiment(plant))
    executed, _ = plain(full.flat, set(), list(given_.values()), *experiment(plant))
    assert same(executed, expected)


finite = st.floats(-1e6, 1e6)
positive = st.floats(1e-6, 1e3)
POSITIVE = ("elapsed", "full_speed", "shaft_inertia", "angle_unit", "internal_step")


@every_effect
@settings(max_examples=40, deadline=None, derandomize=True)
@given(data=st.data())
def test_block_at_neutral_returns_its_wires(effect: Block, data: st.DataObject) -> None:
    arguments: dict[str, object] = {}
    for name in effect.wires:
        arguments[name] = data.draw(positive if name in POSITIVE else finite, name)
    for name, param in effect.params.items():
        shape = st.floats(param.low, param.high)
        arguments[name] = 0.0 if param.switch else data.draw(shape, name)
    for name in effect.memory:
        arguments[name] = data.draw(st.floats(0.0, 100.0), name)
    for name, queue in effect.queues.items():
        arguments[name] = [0.0] * queue.size
    result = effect(**arguments)
    wires = result if isinstance(result, tuple) else (result,)
    assert list(wires[: len(effect.acts_on)]) == [arguments[name] for name in effect.acts_on]


# Law 2: plain Python, C and numba agree to the bit.


# Law 3: what a person needs to know is there.


@every_effect
def test_effect_is_documented(effect: Block) -> None:
    assert effect.about.endswith(".")
    assert effect.source
    assert inspect.getdoc(inspect.getmodule(effect.function))
    for param in effect.params.values():
        assert param.about
        assert param.unit


@every_placement
def test_parameters_have_units_bounds_and_a_visible_typical_value(plant: str, name: str) -> None:
    parameters = chosen(plant).plant.parameters
    for key, parameter in parameters.items():
        if parameter.owner != name:
            continue
        param = parameter.param
        exponents(param.unit)
        assert "signal" not in param.unit, f"{key}: the wire's unit was not filled in"
        assert param.low <= param.default <= param.high
        assert param.low < param.high
        if param.switch:
            assert param.default == 0.0
            assert param.typical != 0.0, f"{key} needs a typical value"
            assert param.low <= param.typical <= param.high


def test_every_effect_of_the_catalogue_is_placed_in_an_actuator() -> None:
    placed = {
        p.effect.name
        for plant in PLANTS
        for group in chosen(plant).plant.placements.values()
        for p in group
    }
    assert placed == {block.name for blocks in effects().values() for block in blocks}


@pytest.mark.parametrize("file", effects())
def test_an_effect_is_one_file_with_one_main_function_of_its_name(file: str) -> None:
    """What is known of an effect stands at its main function; the others are its parts."""
    (main,) = [block for block in effects()[file] if block.name == file]
    assert {block.name for block in main.parts} == {b.name for b in effects()[file]} - {file}


@every_placement
def test_an_effect_acts_on_one_declared_main_wire(plant: str, name: str) -> None:
    """The internal step, which a resonance shortens, is none: nobody can say it in a unit."""
    chosen_plant = chosen(plant).plant
    links, main = chosen_plant.placements[name], chosen_plant.main(name)
    assert chosen_plant.main_wire(name) == main.on[0] in chosen_plant.wire
    assert {link.effect.name for link in links if link is not main} <= {
        part.name for part in main.effect.parts
    }


# Law 4: an active effect does something.


NEEDS = {"sg90-measured-supply_sag": {"supply_limit.share": 1.0}}
"""The supply acts through the limit that it sets."""
NEEDS["sg90-oscillatory_motor-supply_sag"] = NEEDS["sg90-measured-supply_sag"]
NEEDS |= {
    f"dc_motor_speed-direct-{name}": {"position_gain": 20.0}
    for name in ("position_command_gain", "position_transport_delay", "motion_profile")
}


@every_placement
def test_typical_value_changes_the_response(plant: str, name: str) -> None:
    off = bare(plant) | NEEDS.get(f"{plant}-{name}", {})
    quiet = response(plant, values(plant, **off), swing(plant))
    active = response(plant, values(plant, **{**off, **at(plant, name, "typical")}), swing(plant))
    assert np.any(np.abs(active - quiet).max(axis=0) > 1e-4 * np.abs(quiet).max(axis=0))


# Law 5: all state is explicit.


@every_plant
def test_a_run_split_in_two_equals_one_run(plant: str) -> None:
    base = chosen(plant)
    vector = values(plant, **all_typical(plant))
    active = replace(base, values=dict(zip(base.values, vector)))
    times, inputs = experiment(plant)
    whole = active.run(times, inputs)
    half = len(times) // 2
    state = active.start()
    first = active.run(times[: half + 1], inputs[: half + 1], state)
    saved = state.copy()
    state[:] = np.nan
    second = active.run(times[half:], inputs[half:], saved)
    assert same(np.concatenate([first, second[1:]]), whole)


@every_plant
def test_state_layout_does_not_depend_on_what_is_neutral(plant: str) -> None:
    flat = flat_of(chosen(plant).plant, "layout")
    lengths = {
        len(plain_make(step_text(flat, dropped))(values(plant))[0]())
        for dropped in (set(), set(flat.switches))
    }
    assert lengths == {flat.size}
