"""Print the lines of a step; the contract that they keep is in ``stepper.py``.

Standard library only: it is part of every FMU.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Iterator

from servo_models.flat import Chunk, Flat

STAGES = 5
CREDIT = 8.0
"""Sub-steps that may be thrown away one after the other; 7 halvings locate a jump."""

_NAME = re.compile(r"[A-Za-z_]\w*")
_LIMITS = ["tolerance = 1e-6 * internal_step", "finest = internal_step / 128.0"]


def indent(lines: Iterable[str]) -> list[str]:
    return ["    " + line for line in lines]


class Printer:
    """Prints the sections of one text.

    With ``guarded`` every effect stands behind an if, with what only it needs, and its memory
    stays in ``x``, what that will be in ``ahead``: variables of effects that are off would be
    carried from point to point all the same.
    """

    def __init__(self, flat: Flat, dropped: set[str], guarded: bool) -> None:
        self.flat = flat
        self.dropped = dropped
        self.guarded = guarded
        self.states = [s for s in flat.states if s[1] not in dropped]
        self.clocks = [c for c in flat.clocks if c[1] not in dropped]
        self.modes = [m for m in flat.modes if m[1] not in dropped]
        # memories that stay in ``x``, where a variable would be carried through every point
        self.in_place = {name for name, owner in flat.memory if guarded and owner}
        self.groups: dict[tuple[str, ...], str] = {}

    def lines(self, section: Iterable[Chunk]) -> Iterator[str]:
        kept = [chunk for chunk in section if chunk.owner not in self.dropped]
        for optional, chunks in itertools.groupby(kept, key=lambda it: bool(it.needed_by)):
            if optional and self.guarded:
                yield from self.behind_ifs(chunks)
            else:
                yield from itertools.chain.from_iterable(it.lines for it in chunks)

    def behind_ifs(self, chunks: Iterable[Chunk]) -> Iterator[str]:
        """Neighbours behind the if of the effects that need each, and behind one more that
        passes all of them by: most are off in most runs, and every if costs time."""
        lines: list[str] = []
        every: dict[tuple[str, ...], None] = {}
        for owners, group in itertools.groupby(chunks, key=lambda it: it.needed_by):
            every[owners] = None
            own = itertools.chain.from_iterable(it.lines for it in group)
            lines += [f"if {self.any_of(owners)}:", *indent(own)]
        if len(every) == 1:
            yield from lines
        else:
            yield f"if {self.any_of(dict.fromkeys(itertools.chain(*every)))}:"
            yield from indent(lines)

    def any_of(self, owners: Iterable[str]) -> str:
        """The variable that says whether any of these effects is on."""
        names = tuple(owners)
        if len(names) == 1:
            return f"on_{names[0]}"
        return self.groups.setdefault(names, f"any_of_{len(self.groups)}")

    def kept(self, goals: Iterable[str]) -> list[bool]:
        """Which stage chunks the wires and memories ``goals`` depend on."""
        needed = set(goals)
        kept: list[bool] = []
        for chunk in reversed(self.flat.stage):
            keep = chunk.owner not in self.dropped and not needed.isdisjoint(chunk.writes)
            if keep:
                needed = needed.difference(chunk.writes).union(chunk.reads)
            kept.append(keep)
        return kept[::-1]

    @property
    def slopes(self) -> list[str]:
        """What every stage is for: derivatives, and what the projection reads."""
        return [*(rate for _, _, rate in self.states), *self.flat.carried]

    @property
    def memories(self) -> list[str]:
        return [f"{name}_next" for name, owner in self.flat.memory if owner not in self.dropped]

    def wires(self, goals: Iterable[str]) -> list[str]:
        """Lines of the stage chunks that ``goals`` depend on."""
        return list(self.lines(c for c, kept in zip(self.flat.stage, self.kept(goals)) if kept))

    def unpack(self) -> list[str]:
        """Parameters, which effects are on, and what depends on parameters only.

        Of ``guarded`` text this comes last: the rest says which effects stand together.
        """
        flat = self.flat
        lines = [f"{name} = p[{i}]" for i, name in enumerate(flat.params)]
        setup = list(self.lines(flat.setup))
        if self.guarded:
            lines += [
                f"on_{owner} = " + " or ".join(f"{name} != 0.0" for name in names)
                for owner, names in flat.switches.items()
            ]
            for owners, name in self.groups.items():
                lines.append(f"{name} = " + " or ".join(f"on_{owner}" for owner in owners))
        return [*lines, *setup, *_LIMITS]

    def slots(self) -> Iterator[tuple[int, str]]:
        """Places in ``x`` of what lives in variables between the points."""
        for i, (name, owner, *_) in enumerate([*self.flat.states, *self.flat.memory]):
            if owner not in self.dropped and name not in self.in_place:
                yield i, name

    def placed(self, lines: Iterable[str]) -> list[str]:
        """Lines with the memories of effects written as places of ``x`` and ``ahead``."""
        places: dict[str, str] = {}
        for i, (name, _) in enumerate(self.flat.memory):
            if name in self.in_place:
                places[name] = f"x[{len(self.flat.states) + i}]"
                places[f"{name}_next"] = f"ahead[{i}]"
        return [_NAME.sub(lambda found: places.get(found[0], found[0]), line) for line in lines]

    def load(self) -> list[str]:
        lines = [f"{name} = x[{i}]" for i, name in self.slots()]
        if self.guarded:  # numba wants every variable defined on every path
            names = [name for name, _, _ in self.states]
            lines += [f"d_{n} = sum_{n} = start_{n} = 0.0" for n in names]
            if self.modes:
                lines += [f"back_{n} = back_d_{n} = 0.0" for n in names]
            lines += [f"{name} = 0.0" for name in self.flat.carried]
            lines += ["half = sixth = elapsed = dt = cut = target = 0.0"]
        return lines

    def store(self) -> list[str]:
        return [f"x[{i}] = {name}" for i, name in self.slots()]

    def start_values(self) -> list[str]:
        """A dropped effect's memory waits at 0 and is never looked at."""
        return [text if owner not in self.dropped else "0.0" for text, owner in self.flat.start]

    def queue_length(self) -> int:
        return self.flat.size - len(self.flat.start)

    def communication_step(self, unrolled: bool) -> list[str]:
        return [
            "end = t + size",
            "steps = math.ceil(size / internal_step - 1e-6)",
            "if steps < 1:",
            "    steps = 1",
            "now = t",
            "i = 0",
            "first = 0",
            *(["reach = size", "until = t"] if self.modes else []),
            "while True:",
            *indent(self.sub_step(unrolled)),
        ]

    def sub_step(self, unrolled: bool) -> list[str]:
        held = [f"{name} = {name}_in" for name in self.flat.inputs]
        held += [*self.lines(self.flat.held), *self.lines(self.flat.held_commits)]
        lines = ["due = now + tolerance", "if first == 0:", *indent(held)]
        if unrolled:
            lines += indent(self.stage(0))
            outputs = self.wires(self.flat.outputs)
            lines += ["if size <= 0.0:", *indent([*outputs, "break"]), *self.cut()]
            for k in range(1, STAGES):
                lines += self.stage(k)
        else:
            lines += ["last = 1 if size <= 0.0 else 5"]
            lines += ["for k in range(first, last):", *indent(self.stage(None))]
            lines += ["if size <= 0.0:", "    break"]
        lines += [*self.retry(), *self.lines(self.flat.stage_commits)]
        lines += ["now = cut", "if cut == target:", "    i += 1"]
        lines += ["    if i >= steps:", "        break"]
        lines += ["first = 0 if crossed > 0.0 else 1" if self.modes else "first = 1"]
        for name, owner in self.clocks:
            test = f"{name} <= now + tolerance"
            lines += [self.only_if(owner, test), "    first = 0"]
        return lines

    def retry(self) -> list[str]:
        """Bisect a sub-step that ran across a jump: it lies before ``until``, the next
        sub-step is ``reach`` long."""
        if not self.modes:
            return []
        lines = ["crossed = 0.0"]
        for name, owner in self.modes:
            lines += [self.only_if(owner, f"{name}_next != {name}"), "    crossed = 1.0"]
        names = [name for name, _, _ in self.states]
        back = [f"{n} = start_{n} = back_{n}" for n in names]
        back += [f"d_{n} = back_d_{n}" for n in names]
        back += ["until = cut", "reach = 0.5 * dt", "first = 1", "credit -= 1.0", "continue"]
        lines += ["if crossed > 0.0 and credit >= 1.0 and dt > finest:", *indent(back)]
        lines += ["reach = size", "if crossed <= 0.0 and cut < until:"]
        lines += indent(["reach = 0.5 * (until - cut)", "if reach < finest:", "    reach = finest"])
        return [*lines, f"if credit < {CREDIT}:", "    credit += 0.25"]

    def only_if(self, owner: str, test: str) -> str:
        return f"if on_{owner} and {test}:" if owner and self.guarded else f"if {test}:"

    def cut(self) -> list[str]:
        """End of this sub-step: the equal grid, or the first clock before it."""
        lines = ["target = end if i + 1 >= steps else t + size * (i + 1) / steps", "cut = target"]
        if self.clocks:
            lines += ["latest = target - tolerance"]
        if self.modes:
            lines += ["if now + reach < cut:", "    cut = now + reach"]
        for name, owner in self.clocks:
            test = f"now < {name} < latest and {name} < cut"
            lines += [self.only_if(owner, test), f"    cut = {name}"]
        return [*lines, "dt = cut - now"]

    def stage(self, k: int | None) -> list[str]:
        """Lines of evaluation ``k`` of a sub-step, or of all of them with ``k`` a variable."""
        slope = [f"d_{name} = {rate}" for name, _, rate in self.states]
        commits = list(self.lines(self.flat.stage_commits))
        at_ends = [*self.slopes, *self.memories, *self.flat.outputs]
        if k == 0:
            wires = self.wires([*self.slopes, *self.memories])
            return [*self.move(k), *wires, *slope, *commits]
        if k is not None:
            goals = at_ends if k == STAGES - 1 else self.slopes
            return [*self.move(k), *self.wires(goals), *slope]
        text: list[str] = []
        for j in range(STAGES):
            test = f"if k == {j}:" if j == 0 else f"elif k == {j}:" if j < 4 else "else:"
            cut = self.cut() if j == 1 else []  # a clock may just have been set, at k = 0
            text += [test, *indent([*cut, *self.move(j)])]
        chunks = zip(self.flat.stage, self.kept(self.slopes), self.kept(at_ends))
        for needed, group in itertools.groupby(chunks, key=lambda entry: entry[1]):
            lines = list(self.lines(chunk for chunk, _, kept in group if kept))
            text += lines if needed else self.at_ends(lines)
        at_start = ["if k == 0:", *indent(commits)] if commits else []
        return [*text, *slope, *at_start]

    def at_ends(self, lines: list[str]) -> list[str]:
        return ["if k == 0 or k == 4:", *indent(lines)] if lines else []

    def move(self, k: int) -> list[str]:
        """Bring the states to evaluation point ``k``."""
        names = [name for name, _, _ in self.states]
        if k == 0:
            return ["elapsed = 0.0", *(f"start_{n} = {n}" for n in names)]
        if k == 1:
            lines = ["half = 0.5 * dt", "elapsed = half"]
            if self.modes:
                lines += [f"back_d_{n} = d_{n}" for n in names]
            return lines + [
                line
                for n in names
                for line in (f"sum_{n} = d_{n}", f"{n} = start_{n} + half * d_{n}")
            ]
        if k in (2, 3):
            lines = [] if k == 2 else ["elapsed = dt"]
            by = "half" if k == 2 else "dt"
            return lines + [
                line
                for n in names
                for line in (f"sum_{n} += 2.0 * d_{n}", f"{n} = start_{n} + {by} * d_{n}")
            ]
        lines = ["sixth = dt / 6.0"]
        if self.modes:
            lines += [f"back_{n} = start_{n}" for n in names]
        lines += [f"{n} = start_{n} + sixth * (sum_{n} + d_{n})" for n in names]
        return [*lines, *self.flat.projection, *(f"start_{n} = {n}" for n in names)]

    def checks(self, row: str) -> list[str]:
        """Leave with a code when a fault was raised or a state is not finite."""
        lines: list[str] = []
        for k, (name, owner, _) in enumerate(self.flat.faults):
            if owner not in self.dropped:
                lines += [self.only_if(owner, f"{name} != 0.0"), f"    return {-1 - k}, {row}"]
        for i, (name, owner, _) in enumerate(self.flat.states):
            if owner not in self.dropped:
                lines += [f"if not {name} - {name} == 0.0:", f"    return {1 + i}, {row}"]
        return lines
