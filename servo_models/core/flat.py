"""A flattened plant: what ``flatten.py`` makes and the stepper prints.

**Names in the text.**  An author's name neither begins nor ends with an underscore nor holds
two in a row (``block.check_name``), so none of these can be another:

===========================  ==============================================================
``angle``                    a wire, state or parameter of the plant, as its author calls it
``backlash__half_width``     a parameter or memory of an effect, a memory of a block (``owned``)
``backlash___gap``           a local variable of a block (``local``)
``_start__angle``            what the text keeps about any of those (``kept``)
``_half``, ``_abs``          the stepper's own, and what it takes from Python
===========================  ==============================================================

Standard library only: it is part of every FMU.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple


def owned(owner: str, name: str) -> str:
    """Text name of a parameter or memory of an effect or block."""
    return f"{owner}__{name}"


def local(owner: str, name: str) -> str:
    """Text name of a local variable of a block, which may have any name."""
    return f"{owner}___{name}"


def kept(what: str, name: str) -> str:
    """Text name of what is kept about a text name, such as its value at the start."""
    return f"_{what}__{name}"


class Chunk(NamedTuple):
    """The lines of one block.

    ``owner`` is the effect they belong to, "" for the plant; ``reads`` and ``writes`` are
    names in the text, by which the printer finds what a stage needs; ``serves`` are the effects
    that stage lines of the plant are for, none if they are wanted in any case.
    """

    owner: str
    lines: list[str]
    reads: list[str]
    writes: list[str]
    serves: tuple[str, ...] = ()

    @property
    def needed_by(self) -> tuple[str, ...]:
        """Effects of which any needs the lines; none where they are needed in any case."""
        return (self.owner,) if self.owner else self.serves


@dataclass(frozen=True)
class Flat:
    """A flattened plant: lines of text, and where each number lives.

    ``x`` is the full state vector: continuous states, memories, queues, in that order,
    whatever effects are neutral.
    """

    name: str
    params: list[str]
    inputs: list[str]
    outputs: list[str]
    states: list[tuple[str, str, str]]
    """State, owner, wire of its derivative."""
    scales: list[float]
    """Full scale of each state."""
    memory: list[tuple[str, str]]
    """Memory, owner."""
    start: list[tuple[str, str]]
    """Text of the start value of each state and memory, and its owner."""
    size: int
    """Length of ``x``."""
    switches: dict[str, list[str]]
    """Owner to its switch parameters: it is neutral while all are 0."""
    setup: list[Chunk]
    held: list[Chunk]
    stage: list[Chunk]
    held_commits: list[Chunk]
    stage_commits: list[Chunk]
    clocks: list[tuple[str, str]]
    modes: list[tuple[str, str]]
    faults: list[tuple[str, str, str]]
    """Memory, owner, message."""
    notices: list[tuple[int, str]]
    """Place in ``x``, message with its owner."""
    projection: list[str]
    carried: list[str]
    """Stage wires that the projection reads from the stage before it."""

    @property
    def too_fast(self) -> int:
        """Code of a run that would need shorter sub-steps than it may have."""
        return 1 + len(self.states) + len(self.outputs)

    @property
    def too_long(self) -> int:
        """Code of a run that would take more sub-steps than it may."""
        return self.too_fast + 1


def neutral_effects(flat: Flat, values: Sequence[float]) -> set[str]:
    """Return the names of the effects whose switches are all 0 in ``values``."""
    value = dict(zip(flat.params, values))
    return {owner for owner, names in flat.switches.items() if all(value[n] == 0.0 for n in names)}


def noticed(flat: Flat, x: Sequence[float]) -> dict[int, str]:
    """Return in words what a run has to warn of, with the ``x`` that it has reached, by place."""
    return {place: text for place, text in flat.notices if x[place] != 0.0}


def trouble(flat: Flat, code: int, x: Sequence[float] = (0.0,)) -> str:
    """Return in words what a code of ``run`` or ``step`` means, with the ``x`` that it left."""
    if code < 0:
        _, owner, message = flat.faults[-1 - code]
        return f"{owner}: {message}"
    if code == flat.too_fast:
        needed = f"it needs internal_step = {x[0]:.1g} s or less" if x[0] > 0.0 else "none will do"
        return (
            f"the parameters make '{flat.name}' too fast for its internal step: {needed}; give that"
            " if its bounds allow, or slower parameters"
        )
    if code == flat.too_long:
        return f"the parameters make '{flat.name}' so stiff that it takes too many sub-steps"
    names = [f"state '{name}'" for name, _, _ in flat.states]
    names += [f"output '{name}'" for name in flat.outputs]
    return f"{names[code - 1]} is not finite; a parameter or the internal step is too large"
