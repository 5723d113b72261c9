"""An author's names and those of the printed text live in separate name spaces.

A servo of second order is written with one of its names changed, run by both printed texts, and
compared with the exact step response.
"""

from __future__ import annotations

import ast
import functools
import itertools
import keyword
import linecache
import math
import re
import types
from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from servo_models.core.block import Block, Param, block, effect
from servo_models.core.compiled import Run, plain_make, run_by_numba, run_in_c
from servo_models.core.flat import Flat, neutral_effects
from servo_models.core.flatten import flatten
from servo_models.core.inline import inline
from servo_models.core.plant import Plant, Wire, place
from servo_models.core.stepper import run_text, step_text
from servo_models.diagnosis.localisation.open_loop import measured_name, opened
from servo_models.effects.lag import lag
from tests.support.compilers import in_c_only

GAIN = 1745.3  # angle for a pulse width above 1.5 ms [rad/s]
OWN_RATE = 15.0  # undamped natural frequency [rad/s]
DAMPING = 0.7
PULSE = 2.0e-3  # [s], from the start on
TIMES = np.linspace(0.0, 0.4, 41)
LOST = 0.25  # part of the aim that the effect takes off
SUB_STEP = 1e-3  # [s]; RK4 makes an error of 1e-9 rad with it

TIME = ("now", "due", "elapsed", "time")
"""Names of the stepper's own that a block may read, and what tables call their first column."""

KINDS = {
    "INPUT": "pulse",
    "WIRE": "aim",
    "PARAMETER": "gain",
    "STATE": "angle",
    "SLOPE": "acceleration",
    "BLOCK": "controller",
    "LOCAL": "error",
    "MEMORY": "largest",
    "EFFECT": "loss",
    "OWN": "share",
}
"""What an author names in the source below, and how it is called where nothing is changed."""

SOURCE = f'''
from typing import Annotated
from servo_models.core.plant import Plant, State, Wire, place
from servo_models.core.block import Memory, Param, block, effect
from servo_models.effects.lag import lag
from servo_models.effects.rate_limit import rate_limit

@block("WIRE")
def decoder(INPUT: float, PARAMETER: Annotated[float, Param("rad/s", "gain", {GAIN})]) -> float:
    """Angle aimed at."""
    LOCAL = INPUT - 1.5e-3
    return PARAMETER * LOCAL

@effect("signal", source="a test")
def gone(signal: float, OWN: Annotated[float, Param("1", "share lost", switch=True)]) -> float:
    """Part of a signal is lost."""
    LOCAL = OWN * signal
    return signal - LOCAL

@block("SLOPE")
def BLOCK(
    WIRE: float,
    STATE: float,
    start_STATE: float,
    speed: float,
    now: float,
    bandwidth: Annotated[float, Param("rad/s", "undamped natural frequency", {OWN_RATE})],
    MEMORY: Annotated[float, Memory()],
) -> tuple[float, float]:
    """A servo of second order that remembers its largest angle."""
    LOCAL = WIRE - STATE
    last = MEMORY if MEMORY > start_STATE else start_STATE
    return bandwidth * (bandwidth * LOCAL - {2.0 * DAMPING} * speed), last

PLANT = Plant(
    inputs=(Wire("INPUT", "s", "pulse width", rest=1.5e-3),),
    wires=(Wire("WIRE", "rad", "angle aimed at"), Wire("SLOPE", "rad/s2", "acceleration")),
    chain=(
        decoder,
        place("EFFECT", gone, "WIRE"),
        place("slew", rate_limit, "WIRE"),
        place("late", lag, "WIRE"),
        BLOCK,
    ),
    states=(
        State(Wire("STATE", "rad", "angle"), "speed"),
        State(Wire("speed", "rad/s", "speed"), "SLOPE"),
    ),
    outputs=("STATE", "WIRE"),
    constants=dict(internal_step=Param("s", "internal step", {SUB_STEP}, 1e-6, 1.0)),
)
'''
numbered = itertools.count()


def declared(**names: str) -> Plant:
    """The servo as an author would write it who gives these names instead of those of ``KINDS``."""
    chosen = {**KINDS, **names}
    source = re.sub("|".join(chosen), lambda found: chosen[found[0]], SOURCE)
    file = f"<servo {next(numbered)}>"
    linecache.cache[file] = (len(source), None, source.splitlines(keepends=True), file)
    scope: dict[str, Any] = {"__name__": "own"}
    exec(compile(source, file, "exec"), scope)
    made: Plant = scope["PLANT"]
    return made


def exact(times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Step response of the servo [rad]."""
    damped = OWN_RATE * math.sqrt(1.0 - DAMPING**2)
    decay = np.exp(-DAMPING * OWN_RATE * times)
    swing = np.cos(damped * times) + DAMPING * OWN_RATE / damped * np.sin(damped * times)
    return np.asarray((1.0 - LOST) * GAIN * (PULSE - 1.5e-3) * (1.0 - decay * swing))


def values(plant: Plant, **chosen: float) -> list[float]:
    """Parameter vector with the first effect on."""
    first = next(iter(plant.placements))
    lost = next(name for name in plant.parameters if name.startswith(f"{first}."))
    given = {lost: LOST, **{name.replace("__", "."): value for name, value in chosen.items()}}
    return [given.get(name, p.param.default) for name, p in plant.parameters.items()]


def by_plain_python(flat: Flat, vector: list[float]) -> NDArray[np.float64]:
    """Angle by the text that travels in an FMU."""
    start, step = plain_make(step_text(flat, neutral_effects(flat, vector)))(vector)
    state, angles = start(), [0.0]
    for before, size in zip(TIMES, np.diff(TIMES)):
        code, outputs = step(state, [PULSE], float(before), float(size))
        assert code == 0
        angles.append(outputs[0])
    return np.array(angles)


def by_run(
    flat: Flat, vector: list[float], compiled: Callable[[str], Run] | None = None
) -> NDArray[np.float64]:
    """Angle by the text for simulations, compiled or as it stands."""
    text = run_text(flat)
    scope: dict[str, Any] = {}
    exec(compile(text, "<flat text>", "exec"), scope)
    run = compiled(text) if compiled else scope["run"]
    start, _ = plain_make(step_text(flat, set()))(vector)
    out, pulses = np.empty((len(TIMES), 2)), np.full((len(TIMES), 1), PULSE)
    code, _ = run(np.array(vector), np.array(start()), TIMES, pulses, out, np.inf)
    assert code == 0
    return out[:, 0]


@functools.cache
def names_of_the_text() -> list[str]:
    """Names in the printed texts, plain names read out of them, and what simple rules would
    make of an author's name; none that the source above has for something else."""
    flat = flatten(declared(), "servo")
    found = {"abs", "min", "max", "round", "pow", "sum", "start_pulse", "print"}
    for text in (run_text(flat), step_text(flat, set())):
        nodes = list(ast.walk(ast.parse(text)))
        found |= {node.id for node in nodes if isinstance(node, ast.Name)}
        found |= {node.arg for node in nodes if isinstance(node, ast.arg)}
        found |= {node.name for node in nodes if isinstance(node, ast.FunctionDef)}
    plain = {re.sub("_+", "_", name).strip("_") for name in found}
    parts = {part for name in found for part in re.split("__+", name) if part}
    made = {f"{a}_{b}" for a in ("d", "sum", "back", "on", "in") for b in KINDS.values()}
    made |= {f"{a}_{b}" for a in KINDS.values() for b in ("held", "setup", "next", "in", "now")}
    source = set(re.findall(r"\w+", SOURCE)) | set(KINDS.values()) | {"start_angle", "start_speed"}
    return sorted((found | plain | parts | made) - source)


@pytest.mark.thorough
@given(st.sampled_from(list(KINDS)), st.deferred(lambda: st.sampled_from(names_of_the_text())))
@example("WIRE", "target")
@example("WIRE", "half")
@example("WIRE", "dt")
@example("WIRE", "cut")
@example("INPUT", "times")
@example("PARAMETER", "size")
@example("PARAMETER", "t")
@example("STATE", "x")
@example("MEMORY", "next")
@example("LOCAL", "_x")
def test_a_name_changes_no_number(kind: str, name: str) -> None:
    """It is refused, by name, where it is no plain one or time itself; anything else is exact."""
    plain = re.fullmatch(r"[A-Za-z][A-Za-z0-9]*(_[A-Za-z0-9]+)*", name) is not None
    of_plant = kind in ("INPUT", "WIRE", "PARAMETER", "STATE", "SLOPE")
    if kind == "LOCAL" or (plain and not (of_plant and name in TIME)):
        plant = declared(**{kind: name})
        flat, vector = flatten(plant, "servo"), values(plant)
        for angle in (by_plain_python(flat, vector), by_run(flat, vector)):
            np.testing.assert_allclose(angle, exact(TIMES), rtol=0.0, atol=1e-8)
    else:
        with pytest.raises(ValueError, match=name):
            flatten(declared(**{kind: name}), "servo")


UNLUCKY = (
    {"WIRE": "target", "PARAMETER": "size", "STATE": "x", "BLOCK": "run", "LOCAL": "dt"},
    {"WIRE": "half", "PARAMETER": "t", "STATE": "math", "BLOCK": "make", "EFFECT": "end"},
    {"INPUT": "range", "WIRE": "abs", "PARAMETER": "int", "STATE": "float", "SLOPE": "len"},
)


@pytest.mark.thorough
@pytest.mark.parametrize("by", [pytest.param(run_in_c, marks=in_c_only), run_by_numba])
@pytest.mark.parametrize("names", UNLUCKY, ids=lambda names: "_".join(names.values()))
def test_unlucky_names_compiled_with_a_lag_and_a_rate_limit_on_the_wire(
    names: dict[str, str], by: Callable[[str], Run]
) -> None:
    """Both remember what they did in the sub-step before, so they may be late by one."""
    plant = declared(**names)
    flat, vector = flatten(plant, "servo"), values(plant, late__time_constant=1e-9, slew__rate=1e6)
    compiled, plain = by_run(flat, vector, by), by_plain_python(flat, vector)
    np.testing.assert_array_equal(compiled, plain)
    late = exact(TIMES) - exact(np.maximum(TIMES - 2.0 * SUB_STEP, 0.0))
    assert np.all(np.abs(compiled - exact(TIMES)) <= np.abs(late).max())


@pytest.mark.parametrize("name", [*keyword.kwlist, "two__parts", "_x", "x_", "2x", "ä", "a b", ""])
def test_a_name_that_no_text_can_hold_is_refused_by_name(name: str) -> None:
    for make in (
        lambda: Wire(name, "1", "a wire"),
        lambda: place(name, lag, "aim"),
        lambda: Plant((), (), (), (), (), constants={name: Param("1", "a constant")}),
    ):
        with pytest.raises(ValueError, match=f"'{re.escape(name)}'.*name"):
            make()


TWICE = 2.0
factor = 3.0


def doubled() -> Block:
    factor = TWICE

    @block("aim")
    def decoder(pulse: float) -> float:
        """Angle aimed at."""
        return factor * pulse

    return decoder


def printed(decoder: Block, pulse: float) -> float:
    """What the text makes of a block for one value."""
    lines = inline(decoder, {"pulse": "pulse"}, ["aim"], "decoder")
    scope: dict[str, Any] = {"pulse": pulse}
    exec("\n".join(lines), scope)
    return float(scope["aim"])


def test_a_constant_of_the_function_around_a_block_hides_that_of_the_file() -> None:
    decoder = doubled()
    assert printed(decoder, 5.0) == decoder(5.0) == 10.0


@pytest.mark.parametrize("name", ["abs", "int", "float", "math"])
def test_a_name_that_the_file_gives_another_meaning_is_not_that_of_python(name: str) -> None:
    @block("aim")
    def decoder(pulse: float) -> float:
        """Angle aimed at."""
        return float(abs(pulse)) + float(int(pulse)) + math.sqrt(pulse)

    hidden = types.FunctionType(decoder.function.__code__, {**globals(), name: lambda value: value})
    with pytest.raises(ValueError, match=f"block 'decoder' uses '{name}'"):
        printed(replace(decoder, function=hidden), 4.0)


@pytest.mark.parametrize("name", TIME)
def test_time_is_no_wire(name: str) -> None:
    with pytest.raises(ValueError, match=f"'{name}' is time itself"):
        Plant((), (Wire(name, "1", "a wire"),), (), (), ())


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("INPUT", "internal_step"),
        ("SLOPE", "speed"),
        ("PARAMETER", "speed"),
        ("SLOPE", "start_angle"),
    ],
)
def test_a_name_of_two_things_is_refused(kind: str, name: str) -> None:
    with pytest.raises(ValueError, match=rf"\['{name}'\] mean two things"):
        flatten(declared(**{kind: name}), "servo")


UNLIKE = {
    "parameter 'gain' of block 'controller' is declared otherwise": ("bandwidth", "gain"),
    "output or rate of a state: unknown wire 'angel'; did you mean 'angle'": (
        'outputs=("STATE"',
        'outputs=("angel"',
    ),
    "output or rate of a state: unknown wire 'pace'": ('"angle"), "speed"', '"angle"), "pace"'),
    r"\['aim'\] mean two things": ("wires=(", 'wires=(Wire("aim", "1", "twice"), '),
    r"the names \['aim'\] mean": ('"WIRE"),\n    const', '"WIRE", "aim"),\n    const'),
    r"the names \['pulse'\] mean": ('outputs=("STATE"', 'outputs=("pulse"'),
}


@pytest.mark.parametrize("reason", UNLIKE)
def test_declarations_that_contradict_each_other_are_refused(
    reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, new = UNLIKE[reason]
    assert old in SOURCE
    monkeypatch.setitem(globals(), "SOURCE", SOURCE.replace(old, new))
    with pytest.raises(ValueError, match=reason):
        flatten(declared(), "servo")


def test_blocks_may_declare_one_parameter_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    alike = f'bandwidth: Annotated[float, Param("rad/s", "gain", {GAIN})],'
    own = re.sub(r"bandwidth: Annot.*", alike, SOURCE).replace("bandwidth", "gain")
    monkeypatch.setitem(globals(), "SOURCE", own)
    assert flatten(declared(), "servo").params.count("gain") == 1


@effect("signal", source="a test")
def shifted(
    signal: float,
    name: float,
    effect: float,
    share: Annotated[float, Param("1", "share", switch=True)],
) -> float:
    """A signal and two more."""
    return signal + share * (name + 2.0 * effect)


def test_an_effect_may_call_its_arguments_as_place_does() -> None:
    placed = place("shift", shifted, "aim", name="angle", effect="speed")
    assert [placed.wire_of(it) for it in shifted.wires] == ["aim", "angle", "speed"]


def test_what_a_placement_says_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown argument 'nam' in effect 'shift'; did you mean"):
        place("shift", shifted, "aim", nam="angle")
    with pytest.raises(ValueError, match="unknown parameter 'shar' in effect 'shift'"):
        place("shift", shifted, "aim", params={"shar": Param("1", "share")})


def test_a_measured_wire_gets_a_name_that_the_author_has_not_used() -> None:
    plant = declared(INPUT="measured_angle", EFFECT="measured_angle_too")
    assert measured_name(plant, "angle") not in {"measured_angle", "measured_angle_too"}
    flatten(opened(plant, ("angle",)), "servo")
