"""Flatten a plant: from the chain of blocks to the lines that the stepper prints.

Every wire has a level, found from what it depends on: 0 *setup* (parameters only), 1
*held* (inputs and clocks: constant during a sub-step), 2 *stage* (continuous states).  A
block lands in the section of its highest argument, so whatever a run computes once is
computed once, without anybody saying so.  When an effect lifts a wire to a higher level,
the lower version keeps a name of its own (``_setup__friction``), because stage lines run
several times a step and must not pile up.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from servo_models.core.block import RESERVED, START, Block, Clock, Fault, Mode, Notice
from servo_models.core.flat import Chunk, Flat, kept, owned
from servo_models.core.inline import inline
from servo_models.core.plant import Placement, Plant, unknown
from servo_models.core.printer import CREDIT

_LEVELS = ("setup", "held", "stage")


def flatten(plant: Plant, name: str) -> Flat:
    """Return the lines and the layout of ``plant``.

    Raises:
        ValueError: a block reads a wire that nothing defines before it, an output or the rate
            of a state is no wire, or two things would have the same name.
    """
    links = [Link.of(link) for link in plant.chain]
    top = _levels(plant, links)
    _check_declared(plant, top)
    flat = _Flattener(plant, links, top).flat(name)
    _check_names(plant, links, flat)
    return flat


def _check_declared(plant: Plant, levels: Mapping[str, int]) -> None:
    """Refuse outputs and rates that are no wires, and wires and variables declared twice."""
    for name in (*plant.outputs, *(state.rate for state in plant.states)):
        if name not in levels:
            raise ValueError(f"output or rate of a state: {unknown('wire', name, levels)}")
    wires = [*plant.inputs, *plant.wires, *(state.wire for state in plant.states)]
    _once([wire.name for wire in wires])
    _once([wire.name for wire in plant.inputs] + [*plant.outputs])


def _once(names: Sequence[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"the names {twice} mean two things")


def _check_names(plant: Plant, links: Iterable[Link], flat: Flat) -> None:
    """Refuse a name of two things: each wire, parameter, state and memory is defined once."""
    seen = [*flat.params, *(name for name, *_ in [*flat.states, *flat.memory])]
    seen += [wire.name for wire in plant.inputs]
    seen += {wire for link in links if not link.owner for wire in link.writes}
    seen += [START + state.name for state in plant.states] + list(RESERVED)
    if plant.projection and "dt" in plant.projection.wires:
        seen.append("dt")
    _once(seen)
    if "internal_step" not in flat.params:
        raise ValueError(f"plant '{flat.name}' has no 'internal_step' among its constants")


@dataclass(frozen=True)
class Link:
    """One block of the chain with its arguments resolved to wires of the plant."""

    block: Block
    owner: str
    reads: dict[str, str]
    """Wire argument to wire."""
    writes: tuple[str, ...]

    @staticmethod
    def of(link: Block | Placement) -> Link:
        if isinstance(link, Placement):
            reads = {arg: link.wire_of(arg) for arg in link.effect.wires}
            return Link(link.effect, link.name, reads, link.on)
        return Link(link, "", {arg: arg for arg in link.wires}, link.gives)

    @property
    def prefix(self) -> str:
        """Name of the owner of its memories and local variables."""
        return self.owner or self.block.name

    def param(self, name: str) -> str:
        """Text name of one of its parameters."""
        return owned(self.owner, name) if self.owner else name

    def memory(self, name: str) -> str:
        """Text name of one of its memories."""
        return owned(self.prefix, name)

    @property
    def lowest_level(self) -> int:
        return 1 if self.block.memory or self.block.queues else 0


def _known(plant: Plant) -> dict[str, int]:
    """Level of every wire that exists before the chain begins."""
    levels = {"now": 1, "due": 1, "elapsed": 2, "input_age": 2}
    levels |= {name: 0 for name, p in plant.parameters.items() if not p.owner}
    levels |= {wire.name: 1 for wire in plant.inputs}
    for state in plant.states:
        levels |= {state.name: 2, START + state.name: 2}
    return levels


def _level(link: Link, levels: dict[str, int]) -> int:
    for argument, wire in link.reads.items():
        if wire not in levels:
            place = f"block '{link.owner or link.block.name}' (argument '{argument}')"
            raise ValueError(unknown("wire", wire, levels, place))
    return max([link.lowest_level, *(levels[wire] for wire in link.reads.values())])


def _levels(plant: Plant, links: Iterable[Link]) -> dict[str, int]:
    """Highest level that each wire reaches."""
    levels = _known(plant)
    for link in links:
        level = _level(link, levels)
        for wire in link.writes:
            levels[wire] = max(level, levels.get(wire, 0))
    return levels


@dataclass
class _Flattener:
    plant: Plant
    links: list[Link]
    top: dict[str, int]
    sections: tuple[list[Chunk], list[Chunk], list[Chunk]] = field(
        default_factory=lambda: ([], [], [])
    )
    commits: tuple[list[Chunk], list[Chunk], list[Chunk]] = field(
        default_factory=lambda: ([], [], [])
    )
    memory: list[tuple[str, str]] = field(default_factory=list)
    start: list[tuple[str, str]] = field(default_factory=list)
    clocks: list[tuple[str, str]] = field(default_factory=list)
    modes: list[tuple[str, str]] = field(default_factory=list)
    faults: list[tuple[str, str, str]] = field(default_factory=list)
    notices: list[tuple[int, str]] = field(default_factory=list)
    queue_at: dict[str, int] = field(default_factory=dict)

    def flat(self, name: str) -> Flat:
        plant = self.plant
        self.starts = {START + state.name for state in plant.states}
        self.now = _known(plant)
        self.start = [(self.start_text(s.start), s.owner) for s in plant.states]
        self.size = self.place_queues()
        if any(isinstance(m, Mode) for link in self.links for m in link.block.memory.values()):
            self.memory.append(("_credit", ""))  # the stepper's own: see its contract, rule 3
            self.start.append((repr(CREDIT), ""))
        for link in self.links:
            self.add(link)
        params = plant.parameters
        switches: dict[str, list[str]] = {}
        for parameter in params.values():
            if parameter.param.switch:
                switches.setdefault(parameter.owner, []).append(parameter.text)
        return Flat(
            name=name,
            params=[p.text for p in params.values()],
            inputs=[self.text(wire.name, 1) for wire in plant.inputs],
            outputs=[self.text(wire, self.now[wire]) for wire in plant.outputs],
            states=[(s.name, s.owner, self.text(s.rate, self.now[s.rate])) for s in plant.states],
            scales=[s.wire.scale for s in plant.states],
            memory=self.memory,
            start=self.start,
            size=self.size,
            switches=switches,
            setup=self.sections[0],
            held=self.sections[1],
            stage=self.serving(self.sections[2]),
            held_commits=self.commits[1],
            stage_commits=self.commits[2],
            clocks=self.clocks,
            modes=self.modes,
            faults=self.faults,
            notices=self.notices,
            projection=self.project(),
            carried=self.carried(),
        )

    def text(self, wire: str, level: int) -> str:
        """Text name of a wire or reserved argument at a level."""
        if wire in RESERVED:
            return f"_{wire}"
        if wire in self.starts:
            return kept("start", wire.removeprefix(START))
        return wire if level == self.top[wire] else kept(_LEVELS[level], wire)

    def start_text(self, start: float | str) -> str:
        """A start value: a number, or a wire of level 0 under its final name."""
        if isinstance(start, str):
            if self.top.get(start) != 0:
                raise ValueError(f"start value '{start}' must depend on parameters only")
            return start
        return repr(float(start))

    def place_queues(self) -> int:
        memories = [m for link in self.links for m in link.block.memory.values()]
        stepper_own = any(isinstance(memory, Mode) for memory in memories)
        at = len(self.plant.states) + stepper_own + len(memories)
        for link in self.links:
            for name, queue in link.block.queues.items():
                self.queue_at[link.memory(name)] = at
                at += queue.size
        return at

    def add(self, link: Link) -> None:
        level = _level(link, self.now)
        section = self.sections[level]
        for wire in link.writes:
            if wire in self.now and self.now[wire] < level:
                lifted, below = self.text(wire, level), self.text(wire, self.now[wire])
                section.append(Chunk("", [f"{lifted} = {below}"], [below], [lifted]))
        names = {arg: self.text(wire, self.now[wire]) for arg, wire in link.reads.items()}
        for wire, arg in zip(link.writes, link.block.acts_on):
            names[arg] = self.text(wire, max(level, self.now[wire]))
        names |= {link.block.keys.get(p, p): link.param(p) for p in link.block.params}
        names |= {link.block.keys.get(m, m): link.memory(m) for m in link.block.memory}
        names |= {q: str(self.queue_at[link.memory(q)]) for q in link.block.queues}
        for wire in link.writes:
            self.now[wire] = max(level, self.now.get(wire, 0))
        targets = [self.text(wire, self.now[wire]) for wire in link.writes]
        targets += [kept("next", link.memory(m)) for m in link.block.memory]
        title = f"# {link.prefix}" + (f": {link.block.name}" if link.owner else "")
        lines = [title, *inline(link.block, names, targets, link.prefix)]
        reads = [names[arg] for arg in link.reads]
        section.append(Chunk(link.owner, lines, reads, targets))
        self.remember(link, level)

    def remember(self, link: Link, level: int) -> None:
        for name, memory in link.block.memory.items():
            text = link.memory(name)
            self.memory.append((text, link.owner))
            start = memory.start
            if start == "rest":
                start = self.plant.wire[link.writes[0]].rest
            self.start.append((self.start_text(start), link.owner))
            commit = [f"{text} = {kept('next', text)}"]
            self.commits[level].append(Chunk(link.owner, commit, [], []))
            if isinstance(memory, Clock):
                self.clocks.append((text, link.owner))
            elif isinstance(memory, Mode):
                self.modes.append((text, link.owner))
            elif isinstance(memory, Fault):
                self.faults.append((text, link.owner, memory.message))
            elif isinstance(memory, Notice):
                place = len(self.plant.states) + len(self.memory) - 1
                message = memory.message.format(**link.reads)
                self.notices.append((place, f"{link.owner}: {message}"))

    def serving(self, stage: list[Chunk]) -> list[Chunk]:
        """The stage chunks with what they serve: a wire that only effects read, such as the
        current that makes a supply sag, need not be worked out without them.

        An effect that is off passes on what it would have changed, so its writing a wire does
        not end the need for what stood there before.
        """
        needed = {self.text(state.rate, self.now[state.rate]) for state in self.plant.states}
        needed |= {self.text(wire, self.now[wire]) for wire in self.plant.outputs}
        needed |= {kept("next", name) for name, _ in self.memory} | set(self.carried())
        read_by: dict[str, set[str]] = {}
        served: list[Chunk] = []
        for chunk in reversed(stage):
            readers, serves = {chunk.owner}, set[str]()
            if not chunk.owner:
                readers = set().union(*(read_by.pop(wire, ()) for wire in chunk.writes))
                if needed.isdisjoint(chunk.writes):
                    serves = readers
                else:
                    needed.difference_update(chunk.writes)
                    needed.update(chunk.reads)
            for wire in chunk.reads:
                read_by.setdefault(wire, set()).update(readers)
            served.append(chunk._replace(serves=tuple(sorted(serves))))
        return served[::-1]

    def carried(self) -> list[str]:
        states = {s.name for s in self.plant.states} | self.starts
        reads = self.plant.projection.wires if self.plant.projection else ()
        return [w for w in reads if w not in states and self.now.get(w) == 2]

    def project(self) -> list[str]:
        block = self.plant.projection
        if block is None:
            return []
        levels = self.now | {"dt": 2}
        missing = [w for w in block.wires if w not in levels]
        if missing:
            raise ValueError(unknown("wire", missing[0], levels, f"block '{block.name}'"))
        names = {w: "_dt" if w == "dt" else self.text(w, levels[w]) for w in block.wires}
        names |= {p: p for p in block.params}
        lines = inline(block, names, list(block.gives), block.name)
        return [f"# {block.name}", *lines]
