"""Print the lines of a step; the contract that they keep is in ``stepper.py``.

Standard library only: it is part of every FMU.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Iterator

from servo_models.core.flat import Chunk, Flat, kept

STAGES = 5  # points of a sub-step at which stage lines run
CREDIT = 8.0  # sub-steps that may be thrown away one after the other; 7 halvings locate a jump

ACCURATE = 1e-5
"""Error allowed in an internal step, over full scale or, where that is larger, over the state; a
sub-step may make its share by time."""
GROSS = 0.1
"""Change by the last stages over full scale at which even the shortest sub-step is useless: an
instability grows this far, a jump of the right-hand side does not."""
RUNAWAY = 1e3  # size of a state over full scale beyond which no shorter sub-step would hold it
SHORTEST_S = 5e-7  # shortest sub-step [s], unless the internal step that is given is shorter
FURTHEST = 2.0**45  # largest time in internal steps: beyond it times are coarser than a sub-step
DOUBLED = 1024.0  # growth of ``_error`` when a sub-step doubles, 2^8, and a factor of 2 to spare

INPUT_AGE = "_input_age"
_NAME = re.compile(r"[A-Za-z_]\w*")
_LIMITS = [
    "_tolerance = 1e-6 * internal_step",
    "_finest = internal_step / 128.0",
    f"_bar = {(7.5 * ACCURATE) ** 2!r} / (internal_step * internal_step)",
    f"_shortest = _finest if _finest > {SHORTEST_S} else {SHORTEST_S}",
    f"_endless = internal_step < _given and internal_step < {SHORTEST_S}",
]


def indent(lines: Iterable[str]) -> list[str]:
    return ["    " + line for line in lines]


class Printer:
    """Prints the sections of one text.

    With ``guarded`` every effect stands behind an if, with what only it needs, and its memory
    stays in ``_x``, what that will be in ``_ahead``: variables of effects that are off would be
    carried from point to point all the same.
    """

    def __init__(self, flat: Flat, dropped: set[str], guarded: bool) -> None:
        self.flat = flat
        self.dropped = dropped
        self.guarded = guarded
        self.states = [s for s in flat.states if s[1] not in dropped]
        self.weights = {s[0]: scale**-2 for s, scale in zip(flat.states, flat.scales)}
        self.rates = {name: rate for name, _, rate in self.states}
        self.clocks = [c for c in flat.clocks if c[1] not in dropped]
        self.modes = [m for m in flat.modes if m[1] not in dropped]
        # memories that stay in ``x``, where a variable would be carried through every point
        self.in_place = {name for name, owner in flat.memory if guarded and owner}
        self.groups: dict[tuple[str, ...], str] = {}
        ages = any(INPUT_AGE in chunk.reads for chunk in flat.stage)
        self.age = [f"{INPUT_AGE} = _now + _elapsed - _t"] if ages else []

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
            inner = itertools.chain.from_iterable(it.lines for it in group)
            lines += [f"if {self.any_of(owners)}:", *indent(inner)]
        if len(every) == 1:
            yield from lines
        else:
            yield f"if {self.any_of(dict.fromkeys(itertools.chain(*every)))}:"
            yield from indent(lines)

    def any_of(self, owners: Iterable[str]) -> str:
        """The variable that says whether any of these effects is on."""
        names = tuple(owners)
        if len(names) == 1:
            return kept("on", names[0])
        return self.groups.setdefault(names, f"_any_of_{len(self.groups)}")

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
        return [kept("next", n) for n, owner in self.flat.memory if owner not in self.dropped]

    def wires(self, goals: Iterable[str]) -> list[str]:
        """Lines of the stage chunks that ``goals`` depend on."""
        return list(self.lines(c for c, kept in zip(self.flat.stage, self.kept(goals)) if kept))

    def unpack(self) -> list[str]:
        """Parameters, which effects are on, and what depends on parameters only.

        Of ``guarded`` text this comes last: the rest says which effects stand together.
        """
        flat = self.flat
        lines = [f"{name} = _p[{i}]" for i, name in enumerate(flat.params)]
        lines += ["_given = internal_step"]
        setup = list(self.lines(flat.setup))
        if self.guarded:
            lines += [
                f"{kept('on', owner)} = " + " or ".join(f"{name} != 0.0" for name in names)
                for owner, names in flat.switches.items()
            ]
            for owners, name in self.groups.items():
                lines.append(f"{name} = " + " or ".join(kept("on", owner) for owner in owners))
        return [*lines, *setup, *_LIMITS]

    def slots(self) -> Iterator[tuple[int, str]]:
        """Places in ``_x`` of what lives in variables between the points."""
        for i, (name, owner, *_) in enumerate([*self.flat.states, *self.flat.memory]):
            if owner not in self.dropped and name not in self.in_place:
                yield i, name

    def placed(self, lines: Iterable[str]) -> list[str]:
        """Lines with the memories of effects written as places of ``_x`` and ``_ahead``."""
        places: dict[str, str] = {}
        for i, (name, _) in enumerate(self.flat.memory):
            if name in self.in_place:
                places[name] = f"_x[{len(self.flat.states) + i}]"
                places[kept("next", name)] = f"_ahead[{i}]"
        return [_NAME.sub(lambda found: places.get(found[0], found[0]), line) for line in lines]

    def load(self) -> list[str]:
        lines = [f"{name} = _x[{i}]" for i, name in self.slots()]
        if self.guarded:  # numba wants every variable defined on every path
            names = [name for name, _, _ in self.states]
            kinds = ("slope", "sum", "start", "back", "back_slope", "middle")
            lines += [f"{kept(kind, n)} = 0.0" for n in names for kind in kinds]
            lines += [f"{name} = 0.0" for name in self.flat.carried]
            lines += ["_half = _sixth = _elapsed = _dt = _cut = _target = 0.0"]
            lines += ["_turned = _bent = 0.0", *(f"{INPUT_AGE} = 0.0" for _ in self.age)]
        return lines

    def store(self) -> list[str]:
        return [f"_x[{i}] = {name}" for i, name in self.slots()]

    def start_values(self) -> list[str]:
        """A dropped effect's memory waits at 0 and is never looked at; so does, in guarded text,
        that of an effect that is off."""
        values = [text if owner not in self.dropped else "0.0" for text, owner in self.flat.start]
        if not self.guarded:
            return values
        owners = [owner for _, owner in self.flat.start]
        return [
            f"{text} if {kept('on', owner)} else 0.0" if owner else text
            for text, owner in zip(values, owners)
        ]

    def queue_length(self) -> int:
        return self.flat.size - len(self.flat.start)

    def communication_step(self, unrolled: bool, row: str) -> list[str]:
        return [
            "if _endless:",
            *indent(["_x[0] = internal_step", f"return {self.flat.too_fast}, {row}"]),
            "_end = _t + _size",
            "_steps = _math.ceil(_size / internal_step - 1e-6)",
            "if _steps < 1:",
            "    _steps = 1",
            "_now = _t",
            "_i = 0",
            "_first = 0",
            *(["_fine = _size"] if self.states else []),
            *(["_reach = _size", "_until = _t"] if self.modes else []),
            "while True:",
            *indent([*self.limited(row), *self.sub_step(unrolled, row)]),
        ]

    def limited(self, row: str) -> list[str]:
        """End a run, which has a ``row``, after so many sub-steps; those thrown away count too."""
        if row == "None":
            return []
        return ["_spent += 1.0", "if _spent > _most:", f"    return {self.flat.too_long}, {row}"]

    def sub_step(self, unrolled: bool, row: str) -> list[str]:
        held = [f"{name} = {kept('in', name)}" for name in self.flat.inputs]
        held += [*self.lines(self.flat.held), *self.lines(self.flat.held_commits)]
        lines = ["_due = _now + _tolerance", "if _first == 0:", *indent(held)]
        if unrolled:
            lines += indent(self.stage(0))
            outputs = self.wires(self.flat.outputs)
            lines += ["if _size <= 0.0:", *indent([*outputs, "break"]), *self.cut()]
            for k in range(1, STAGES):
                lines += self.stage(k)
        else:
            lines += ["_last = 1 if _size <= 0.0 else 5"]
            lines += ["for _k in _range(_first, _last):", *indent(self.stage(None))]
            lines += ["if _size <= 0.0:", "    break"]
        lines += [*self.shorten(row), *self.retry(), *self.lines(self.flat.stage_commits)]
        lines += ["_now = _cut", "if _cut == _target:", "    _i += 1"]
        lines += ["    if _i >= _steps:", "        break"]
        lines += ["_first = 0 if _crossed > 0.0 else 1" if self.modes else "_first = 1"]
        for name, owner in self.clocks:
            test = f"{name} <= _now + _tolerance"
            lines += [self.only_if(owner, test), "    _first = 0"]
        return lines

    def retry(self) -> list[str]:
        """Bisect a sub-step that ran across a jump: it lies before ``_until``, the next
        sub-step is ``_reach`` long."""
        if not self.modes:
            return []
        lines = ["_crossed = 0.0"]
        for name, owner in self.modes:
            lines += [self.only_if(owner, f"{kept('next', name)} != {name}"), "    _crossed = 1.0"]
        back = ["_until = _cut", "_reach = 0.5 * _dt", "_credit -= 1.0", *self.again()]
        lines += ["if _crossed > 0.0 and _credit >= 1.0 and _dt > _finest:", *indent(back)]
        lines += ["_reach = _size", "if _crossed <= 0.0 and _cut < _until:"]
        halved = ["_reach = 0.5 * (_until - _cut)", "if _reach < _finest:", "    _reach = _finest"]
        lines += indent(halved)
        return [*lines, f"if _credit < {CREDIT}:", "    _credit += 0.25"]

    def again(self) -> list[str]:
        """Throw the sub-step away."""
        back = self.each_state(
            lambda n: [
                f"{n} = {kept('start', n)} = {kept('back', n)}",
                f"{kept('slope', n)} = {kept('back_slope', n)}",
            ]
        )
        return [*back, "_first = 1", "continue"]

    def shorten(self, row: str) -> list[str]:
        """Halve a sub-step that is too long for the fastest motion in it: rule 4 of the contract.

        ``_turned`` and ``_bent`` are squares, so squares of errors are compared.
        """
        if not self.states:
            return []
        share = "_math.sqrt(_math.sqrt(_math.sqrt(_allowed / _error)))"
        leave = [f"_share = {share} if _error > 0.0 else 0.0", "_x[0] = internal_step * _share"]
        leave += [f"if _dt * _share < {SHORTEST_S}:", "    _x[0] = _dt * _share"]
        leave += [f"return {self.flat.too_fast}, {row}"]
        useless = f"not _dt * _dt * _bent <= {GROSS**2!r} * _large and _large < {RUNAWAY**2!r}"
        large = self.each_state(lambda n: [self.add_square("_large", n, kept("back", n))])
        judge = ["_large = 1.0", *large, "_allowed = _allowed * _large"]
        judge += ["if not _error <= _allowed:"]
        judge += indent(["if _dt > _shortest:", *indent(["_fine = 0.5 * _dt", *self.again()])])
        judge += indent([f"if {useless}:", *indent(leave)])
        judge += [f"elif _fine < 2.0 * _dt and {DOUBLED!r} * _error <= _allowed:"]
        judge += ["    _fine = 2.0 * _dt"]
        return [
            "_error = _bent * _bent * _bent",
            "_allowed = _bar * _turned * _turned",
            "if _fine < _size or not _error <= _allowed:",
            *indent(judge),
        ]

    def only_if(self, owner: str, test: str) -> str:
        guard = f"{kept('on', owner)} and " if owner and self.guarded else ""
        return f"if {guard}{test}:"

    def cut(self) -> list[str]:
        """End of this sub-step: the equal grid, or the first clock before it."""
        lines = ["_target = _end if _i + 1 >= _steps else _t + _size * (_i + 1) / _steps"]
        lines += ["_cut = _target"]
        if self.clocks:
            lines += ["_latest = _target - _tolerance"]
        if self.modes:
            lines += ["if _now + _reach < _cut:", "    _cut = _now + _reach"]
        if self.states:
            lines += ["if _now + _fine < _cut - _tolerance:", "    _cut = _now + _fine"]
        for name, owner in self.clocks:
            test = f"_now < {name} < _latest and {name} < _cut"
            lines += [self.only_if(owner, test), f"    _cut = {name}"]
        return [*lines, "_dt = _cut - _now"]

    def stage(self, k: int | None) -> list[str]:
        """Lines of evaluation ``k`` of a sub-step, or of all of them with ``_k`` a variable."""
        slope = self.each_state(lambda n: [f"{kept('slope', n)} = {self.rates[n]}"])
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
            test = f"if _k == {j}:" if j == 0 else f"elif _k == {j}:" if j < 4 else "else:"
            cut = self.cut() if j == 1 else []  # a clock may just have been set, at 0
            text += [test, *indent([*cut, *self.move(j)] or ["pass"])]  # without states
        chunks = zip(self.flat.stage, self.kept(self.slopes), self.kept(at_ends))
        for needed, group in itertools.groupby(chunks, key=lambda entry: entry[1]):
            lines = list(self.lines(chunk for chunk, _, kept in group if kept))
            text += lines if needed else self.at_ends(lines)
        at_start = ["if _k == 0:", *indent(commits)] if commits else []
        return [*text, *slope, *at_start]

    def at_ends(self, lines: list[str]) -> list[str]:
        return ["if _k == 0 or _k == 4:", *indent(lines)] if lines else []

    def each_state(self, lines_of: Callable[[str], list[str]]) -> list[str]:
        """Lines for every state; in guarded text those for the states of an effect stand behind
        its if, since at rest they would be integrated all the same."""
        lines: list[str] = []
        for owner, states in itertools.groupby(self.states, key=lambda state: state[1]):
            inner = [line for name, _, _ in states for line in lines_of(name)]
            behind = owner and self.guarded
            lines += [f"if {kept('on', owner)}:", *indent(inner)] if behind else inner
        return lines

    def move(self, k: int) -> list[str]:
        """Bring the states to evaluation point ``k``."""
        started = self.each_state(lambda n: [f"{kept('start', n)} = {n}"])
        if k == 0:
            return ["_elapsed = 0.0", *self.age, *started]
        moved = self.each_state(lambda n: self.moved(k, n))
        if k == 1:
            return ["_half = 0.5 * _dt", "_elapsed = _half", *self.age, *moved]
        if k == 2:
            return ["_turned = 0.0", *moved]
        if k == 3:
            return ["_bent = 0.0", "_elapsed = _dt", *self.age, *moved]
        return ["_sixth = _dt / 6.0", *moved, *self.flat.projection, *started]

    def moved(self, k: int, n: str) -> list[str]:
        """Bring state ``n`` to point ``k`` of 1 to 4."""
        start, slope, total = kept("start", n), kept("slope", n), kept("sum", n)
        before, middle = kept("back_slope", n), kept("middle", n)
        half = f"{n} = {start} + _half * {slope}"
        if k == 1:
            return [f"{before} = {slope}", f"{total} = {slope}", half]
        if k == 2:
            turned = self.add_square("_turned", n, f"({slope} - {before})")
            return [turned, f"{middle} = {slope}", f"{total} += 2.0 * {slope}", half]
        if k == 3:
            bent = self.add_square("_bent", n, f"({slope} - {middle})")
            return [bent, f"{total} += 2.0 * {slope}", f"{n} = {start} + _dt * {slope}"]
        back = f"{kept('back', n)} = {start}"
        return [back, f"{n} = {start} + _sixth * ({total} + {slope})"]

    def add_square(self, total: str, name: str, term: str) -> str:
        """Add what is kept about a state, in full scales and squared."""
        return f"{total} = {total} + {term} * {term} * {self.weights[name]!r}"

    def checks(self, row: str) -> list[str]:
        """Leave with a code when a fault was raised or a state or an output is not finite."""
        lines: list[str] = []
        for k, (name, owner, _) in enumerate(self.flat.faults):
            if owner not in self.dropped:
                lines += [self.only_if(owner, f"{name} != 0.0"), f"    return {-1 - k}, {row}"]
        for i, (name, owner, _) in enumerate(self.flat.states):
            if owner not in self.dropped:
                lines += [f"if not {name} - {name} == 0.0:", f"    return {1 + i}, {row}"]
        for i, name in enumerate(self.flat.outputs, 1 + len(self.flat.states)):
            lines += [f"if not {name} - {name} == 0.0:", f"    return {i}, {row}"]
        return lines
