"""What a block may be, and that its inlined text is the function."""

from __future__ import annotations

import ast
import functools
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from servo_models.catalogue import actuators
from servo_models.core.block import (
    Ambiguity,
    Block,
    Clock,
    DeadTime,
    Fault,
    FirstOrderLag,
    Hints,
    Memory,
    Mode,
    Param,
    Queue,
    block,
    effect,
)
from servo_models.core.inline import inline
from servo_models.core.plant import Plant, Wire, place
from servo_models.core.stepper import HEAD
from servo_models.effects import effects

OUTSIDE = [1.0, 2.0]


@pytest.mark.parametrize("unit", ["/signal", "s/signal", "signal2", "1/signal2", "V.signal"])
def test_a_unit_whose_scale_is_unclear_is_refused(unit: str) -> None:
    """Bounds are fractions of the full scale or of its inverse, of nothing else."""
    with pytest.raises(ValueError, match="write 'signal', 'signal/s' or '1/signal'"):
        Param(unit, "size")


def test_units_of_a_signal_become_those_of_the_wire() -> None:
    @effect("signal", source="here")
    def bent(
        signal: float,
        rate: Annotated[float, Param("signal/s", "rate", high=3.0, switch=True)],
        inverse: Annotated[float, Param("1/signal", "inverse", high=3.0)],
    ) -> float:
        """Nothing."""
        return signal * inverse + rate

    wire = Wire("torque", "N.m", "torque", scale=2.0)
    plant = Plant((wire,), (), (place("bent", bent, "torque"),), (), ("torque",))
    found = {name: parameter.param for name, parameter in plant.parameters.items()}
    assert (found["bent.rate"].unit, found["bent.rate"].high) == ("N.m/s", 6.0)
    assert (found["bent.inverse"].unit, found["bent.inverse"].high) == ("1/(N.m)", 1.5)


def test_the_signature_is_the_data_sheet() -> None:
    @effect("signal", source="here")
    def all_kinds(
        signal: float,
        due: float,
        size: Annotated[float, Param("signal", "size", high=2.0, switch=True, typical=1.0)],
        shape: Annotated[float, Param("1", "shape")],
        kept: Annotated[float, Memory(0.5)],
        tick: Annotated[float, Clock()],
        side: Annotated[float, Mode()],
        broken: Annotated[float, Fault(message="broken")],
        line: Annotated[list[float], Queue(4)],
    ) -> tuple[float, float, float, float, float]:
        """Does nothing."""
        return signal, kept, tick, side, broken

    assert all_kinds.wires == ("signal", "due")
    assert list(all_kinds.params) == ["size", "shape"]
    assert list(all_kinds.memory) == ["kept", "tick", "side", "broken"]
    assert list(all_kinds.queues) == ["line"]
    assert all_kinds.switches == ("size",)
    assert all_kinds.about == "Does nothing."
    assert all_kinds(1.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0, 0.0, []) == (1.0, 0.5, 0.0, 0.0, 0.0)


def test_a_block_without_docstring_is_refused() -> None:
    with pytest.raises(ValueError, match="no docstring"):

        @block()
        def silent(u: float) -> float:
            return u


def test_an_effect_without_switch_is_refused() -> None:
    with pytest.raises(ValueError, match="never neutral"):

        @effect("signal", source="here")
        def always_on(signal: float, size: Annotated[float, Param("1", "size")]) -> float:
            """Cannot be switched off."""
            return signal + size


@pytest.mark.parametrize(
    ("hints", "said"),
    [
        (Hints(phase="angle"), "has no parameter 'angle' to hint at"),
        (Hints(assumed=("size", "bits")), "has no parameter 'bits'"),
        (Hints(small_signal=DeadTime("time", "size", "size")), "has no parameter 'time'"),
        (Hints(small_signal=FirstOrderLag("size", "last", "last")), "has no memory 'last'"),
        (Hints(signature="tones"), "no signature 'tones' is known"),  # type: ignore[arg-type]
        (Hints(ambiguity=Ambiguity("look", ("lag", "offset"))), "is not in the group"),
    ],
)
def test_a_hint_at_what_an_effect_has_not_is_refused(hints: Hints, said: str) -> None:
    def widened(signal: float, size: Annotated[float, Param("1", "size", switch=True)]) -> float:
        """Wider by a size."""
        return signal + size

    with pytest.raises(ValueError, match=f"effect 'widened'.*{said}"):
        effect("signal", source="here", hints=hints)(widened)


@pytest.mark.parametrize(
    ("one", "other", "separated"),
    [("a", "b", True), ("b", "a", True), ("a", "a", False), ("a", "c", False)],
)
def test_an_ambiguity_is_between_any_two_of_its_group(
    one: str, other: str, separated: bool
) -> None:
    assert Ambiguity("look", ("a", "b")).separates(one, other) is separated


def test_an_ambiguity_against_others_is_not_within_its_group() -> None:
    ambiguity = Ambiguity("look", ("a", "b"), ("c",))
    assert ambiguity.separates("a", "c")
    assert ambiguity.separates("c", "b")
    assert not ambiguity.separates("a", "b")


@block("y")
def power(u: float) -> float:
    """Whose last bit differs between numba and CPython."""
    return u**3


@block("y")
def early(u: float) -> float:
    """Leaves a loop by a return."""
    while u > 1.0:
        if u > 2.0:
            return u
        u = u - 1.0
    return u


@block("y")
def reaching(u: float) -> float:
    """Uses what is no number."""
    return u + OUTSIDE[0]


@block("y", "z")
def forgetful(u: float) -> float:
    """Returns one value for two wires."""
    return u


@block("y")
def one_branch(u: float) -> float:
    """Has a value in one branch only."""
    if u > 1.0:
        half = 0.5 * u
    return half


@block("y")
def perhaps_never(u: float) -> float:
    """Has a value if the loop is entered."""
    while u > 1.0:
        rest = u
        u = u - 1.0
    return rest


@block("y")
def adding(u: float) -> float:
    """Adds to nothing."""
    if u > 1.0:
        total += u  # type: ignore[has-type,used-before-def]  # noqa: F821
    else:
        total = u
    return total


@block("y")
def every_branch(u: float) -> float:
    """Has a value in every branch from which it is read."""
    if u > 1.0:
        half = 0.5 * u
    elif u > 0.0:
        return u
    else:
        half = u
    while half > 1.0:
        more = half - 1.0
        half = more
    return half


@pytest.mark.parametrize("u", [-1.0, 0.5, 1.5, 9.0])
def test_a_variable_with_a_value_in_every_branch_is_fine(u: float) -> None:
    scope = {"u": u, "y": 0.0}
    exec("\n".join(inline(every_branch, {"u": "u"}, ["y"], "owner")), scope)
    assert scope["y"] == every_branch(u)


@block("held")
def peak(signal: float, highest: Annotated[float, Memory()]) -> tuple[float, float]:
    """Largest value so far; it works on its own copy of the memory."""
    highest = highest if highest > signal else signal
    return highest, highest


@block("sign")
def sign(signal: float) -> float:
    """Sign of a signal, with every way to return early."""
    if signal > 0.0:
        if signal > 1.0:
            return 1.0
    elif signal < 0.0:
        return -1.0
    return 0.0


def test_a_memory_that_a_block_reassigns_is_not_changed_before_its_commit() -> None:
    """The stages of a step look at a memory many times, so only the commit may set it."""
    names = {"signal": "angle", "highest": "peak_highest"}
    lines = inline(peak, names, ["held", "peak_highest_next"], "peak")
    text = "\n".join(lines)
    stored = {
        node.id
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
    }
    assert "peak_highest" not in stored
    scope = {"angle": 3.0, "peak_highest": 2.0}
    exec(text, scope)
    assert (scope["held"], scope["peak_highest_next"], scope["peak_highest"]) == (3.0, 3.0, 2.0)


@pytest.mark.parametrize("signal", [2.0, 1.0, 0.5, 0.0, -0.5])
def test_early_returns_become_branches(signal: float) -> None:
    scope = {"u": signal}
    exec("\n".join(inline(sign, {"signal": "u"}, ["y"], "sign")), scope)
    assert scope["y"] == sign(signal)


@block("rest")
def remainder(signal: float) -> float:
    """A remainder of floats, which numba and CPython round differently."""
    return signal % 2.0


@block("first")
def listed(signal: float) -> float:
    """A list, which C has not."""
    return [signal][0]


@pytest.mark.parametrize(
    ("bad", "sentence"),
    [
        (one_branch, "'one_branch' reads 'half' .line 6"),
        (perhaps_never, "'perhaps_never' reads 'rest'"),
        (adding, "'adding' reads 'total'"),
        (power, r"'power' uses \*\*.*write the product"),
        (remainder, "'remainder' .*% of a float"),
        (listed, "'listed' .*List"),
        (early, "return at its end"),
        (reaching, "uses 'OUTSIDE'"),
        (forgetful, "returns 1 values where its signature asks for 2"),
    ],
)
def test_what_does_not_run_everywhere_is_refused(bad: Block, sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        inline(bad, {name: name for name in bad.wires}, bad.gives, "prefix")


@functools.cache
def inlined(name: str) -> Callable[..., list[float]]:
    """The block as text, with arguments renamed to a0, a1 ... and queues in ``_x``."""
    found = EVERY_BLOCK[name]
    arguments = [*found.wires, *found.params, *found.memory]
    names = {name: f"a{i}" for i, name in enumerate(arguments)}
    at = 0
    for line, queue in found.queues.items():
        names[line] = str(at)
        at += queue.size
    wires = found.acts_on or found.gives
    targets = [f"out{i}" for i in range(len(wires) + len(found.memory))]
    body = inline(found, names, targets, "local")
    text = [*HEAD, f"def run(_x, {', '.join(names[n] for n in arguments)}):"]
    text += ["    " + line for line in body]
    text += [f"    return [{', '.join(targets)}]"]
    scope: dict[str, Any] = {}
    exec("\n".join(text), scope)
    return scope["run"]


def _every_block() -> Iterator[Block]:
    for blocks in effects().values():
        yield from blocks
    for actuator in actuators().values():
        for variant in actuator.variants:
            chain = actuator.plant_of(variant.name).chain
            yield from (link for link in chain if isinstance(link, Block))


EVERY_BLOCK = {f"{b.function.__module__}.{b.name}": b for b in _every_block()}
numbers = st.one_of(st.floats(1e-3, 3.0), st.floats(-3.0, -1e-3), st.just(0.0))


@pytest.mark.parametrize("name", EVERY_BLOCK)
@settings(max_examples=25, deadline=None, derandomize=True)
@given(data=st.data())
def test_inlined_text_is_the_function(name: str, data: st.DataObject) -> None:
    found = EVERY_BLOCK[name]
    drawn = {wire: data.draw(numbers, wire) for wire in found.wires}
    drawn |= {n: data.draw(st.floats(p.low, p.high), n) for n, p in found.params.items()}
    drawn |= {memory: data.draw(st.floats(0.0, 3.0), memory) for memory in found.memory}
    queue = [0.5] * sum(queue.size for queue in found.queues.values())
    x = list(queue)
    try:
        expected = found(**drawn, **dict.fromkeys(found.queues, queue))
    except (ArithmeticError, ValueError):
        assume(False)
    text = inlined(name)(x, *drawn.values())
    assert text == list(expected if isinstance(expected, tuple) else (expected,))
    assert x == queue


Size = Annotated[float, Param("signal", "size", switch=True, typical=0.1)]
Known = Annotated[float, Param("1", "known")]


def lost(signal: float, size: Size, known: Known) -> float:
    """Something is lost."""
    return signal - size * known


@pytest.mark.parametrize(
    ("says", "complaint"), [("off by {sise}", "no parameter 'sise'"), ("{known}", "never searched")]
)
def test_a_clause_names_parameters_that_are_searched_for(says: str, complaint: str) -> None:
    """A diagnosis knows the size of no other, and would have no text for it."""
    with pytest.raises(ValueError, match=complaint):
        effect("signal", source="x", hints=Hints(says=says, assumed=("known",)))(lost)
