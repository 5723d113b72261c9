"""Writing a block into a flat text changes nothing but names."""

from __future__ import annotations

import ast
from typing import Annotated

import pytest

from servo_models.core.block import Block, Memory, block
from servo_models.core.inline import inline


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


@block("cube")
def cube(signal: float) -> float:
    """A power, which numba and CPython round differently."""
    return signal**3


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


def test_a_power_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="'cube' uses \\*\\*"):
        inline(cube, {"signal": "u"}, ["y"], "cube")


@block("rest")
def remainder(signal: float) -> float:
    """A remainder of floats, which numba and CPython round differently."""
    return signal % 2.0


@block("first")
def listed(signal: float) -> float:
    """A list, which C has not."""
    return [signal][0]


@pytest.mark.parametrize(("outside", "word"), [(remainder, "% of a float"), (listed, "List")])
def test_what_is_outside_the_subset_is_refused(outside: Block, word: str) -> None:
    with pytest.raises(ValueError, match=f"'{outside.name}' .*{word}"):
        inline(outside, {"signal": "u"}, ["y"], outside.name)
