"""One case: drawn from its seed and number alone, so it is the same in every run.

Tiers.  *easy*: a cause alone makes a gap of 5 to 20 times the noise floor; at least 20 rows per
fastest time constant; white noise; steps of several sizes, slow triangles and a chirp.  *hard*:
the main cause as before, a hidden second one with 30 % of its gap (where two are to be named
the second is no secret, and there is no third), coloured noise 3 times as large, a reading
quantum, a quarter of the rows.  *poor*: one large step there and back, all else easy.  *rough*:
easy, with one or two faults of the recording, see ``faults``.

The gap of a cause is the RMS difference that it makes alone, on the true rig, in the judged
reading; the noise floor follows from it.  Where nothing is wrong the floor follows from a cause
that is not there, so that the noise tells nothing.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from servo_models.withheld.generator.causes import CATALOGUE, FOREIGN, Cause, Drawn, draw
from servo_models.withheld.generator.faults import (
    ARRIVAL,
    COARSE,
    COMMAND_STEP,
    FAR,
    GLITCHES,
    PRIOR,
    READING_STEP,
    arrivals,
    draw_faults,
    logged,
    with_glitches,
)
from servo_models.withheld.generator.rigs import LOAD, RIGS, Rig
from servo_models.withheld.generator.simulation import Experiment, Plan
from servo_models.withheld.rig.laws import Array, chirp_turns, triangle

EASY, HARD, POOR, ROUGH = TIERS = ("easy", "hard", "poor", "rough")
CLEAN = (EASY, HARD, POOR)
"""Tiers without faults of the recording: those that are drawn where none is named."""
THIN = {EASY: 1, HARD: 4, POOR: 1, ROUGH: 1}  # samples of which a tier logs one
KINDS = {"nothing": 0.16, "one": 0.25, "two": 0.42, "foreign": 0.17}
"""How often each is drawn: about as many cases of each kind are told apart by their logs, of two
effects at once fewer than half."""
RATIO = (5.0, 20.0)  # gap over noise floor
VISIBLE = (0.006, 0.06)  # gap over the range of the reading
HIDDEN, CLOSE = 0.3, 0.05
"""Gap of the hidden cause over that of the main one, and the tolerance of it."""
COLOURED = 3.0
COLOUR = (0.5, 0.9)  # correlation of neighbouring rows in coloured noise
TRIES, SHAPES = 9, 4
DEAF = -5.0  # a gap so far below the wanted one, in natural logarithms, says nothing of the size
KEPT = 0.8  # two causes that leave less than this share of the larger gap undo one another
VARIED = 0.5
"""Part of the loads that change during a log, so that it has a column of them; where nothing holds
the rig, all do."""
LOAD_STEPS = 6
HELD = 0.5  # largest load, over what the true rig can hold
LEAST_VALUE = 0.1
"""True values below this share of the nominal one are drawn again: they would be unphysical."""


@dataclass(frozen=True)
class Acting:
    """A cause of known size.

    ``share`` is its place in the range of its size, ``gap`` what it does alone [SI].
    """

    drawn: Drawn
    share: float
    gap: float

    @property
    def name(self) -> str:
        return self.drawn.cause.name

    def settings(self, experiment: Experiment) -> dict[str, float]:
        """What the simulation takes."""
        return self.drawn.settings(self.share, experiment.rig, experiment.units)

    def parameters(self, rig: Rig) -> dict[str, float]:
        """The same as parameters of the product [SI]."""
        values = self.drawn.values(self.share, rig.step)
        if self.name == "gear_compliance":
            own = values.pop("frequency")
            values["compliance"] = 1.0 / (values["inertia"] * own * own)
        return {f"{self.name}.{key}": value for key, value in values.items()}


@dataclass(frozen=True)
class Case:
    """All that is true of a case, and its logs with and without noise [SI].

    ``stamps`` are those of the logged rows, in periods of their plan; ``command_step`` is that in
    which commands are logged [SI], 0 for none.  ``constants`` were set for its logs [SI], by the
    product's names; ``further`` are logs of the same rig under other conditions.
    """

    tier: str
    kind: str
    experiment: Experiment
    acting: tuple[Acting, ...]
    hidden: tuple[Acting, ...]
    floor: float
    noise: float
    quantum: float
    noise_free: tuple[Array, ...]
    logs: tuple[Array, ...] = field(repr=False)
    stamps: tuple[Array, ...] = field(repr=False)
    faults: tuple[str, ...] = ()
    command_step: float = 0.0
    constants: Mapping[str, float] = field(default_factory=dict)
    further: tuple[Case, ...] = ()


def kind_of(seed: int, number: int) -> str:
    """Return the kind of case ``number`` of ``seed``, one of ``KINDS``."""
    return _begun(seed, number)[2]


def is_asked(seed: int, number: int, kinds: Container[str], causes: Container[str]) -> bool:
    """Return whether case ``number`` of ``seed`` is of these kinds, on a rig that has one of the
    ``causes``, if any are named."""
    _, rig, kind = _begun(seed, number)
    return kind in kinds and bool(_named(CATALOGUE[rig.actuator], causes))


def _named(known: tuple[Cause, ...], causes: Container[str]) -> tuple[Cause, ...]:
    """Causes of some names, all where none are named."""
    return tuple(it for it in known if it.name in causes) if causes else known


def _begun(seed: int, number: int) -> tuple[np.random.Generator, Rig, str]:
    """The generator of random numbers of a case, and what it draws first."""
    rng = np.random.default_rng([seed, number])
    rig = RIGS[int(rng.integers(len(RIGS)))]
    return rng, rig, str(rng.choice(list(KINDS), p=list(KINDS.values())))


def draw_case(seed: int, number: int, tier: str, causes: Container[str] = ()) -> Case:
    """Draw case ``number`` of ``seed``; the first of its causes is one of ``causes``, if named."""
    rng, rig, kind = _begun(seed, number)
    faults = draw_faults(rng) if tier == ROUGH else ()
    experiment = draw_experiment(rig, tier, rng, faults)
    known, foreign = CATALOGUE[rig.actuator], FOREIGN[rig.actuator]
    main = _find(experiment, foreign if kind == "foreign" else _named(known, causes), rng)
    acting, hidden = [main], []
    if kind == "two":
        acting.append(_second(experiment, known, main, math.exp(rng.uniform(-0.6, 0.6)), rng))
    elif tier == HARD and kind != "nothing":
        hidden.append(_second(experiment, known, main, HIDDEN, rng))
    gaps = [cause.gap for cause in acting]
    low, high = max(gaps) / RATIO[1], min(gaps) / RATIO[0]
    floor = low * (high / low) ** rng.random()
    if kind == "nothing":
        acting = []
    noise_free = experiment.logs(_settings(experiment, *acting, *hidden))
    hard = tier == HARD
    quantum = floor * rng.uniform(1.0, 4.0) if hard else 0.0
    command_step = 0.0
    if COARSE in faults:
        quantum = floor * rng.uniform(*READING_STEP)
        command_step = float(np.ptp(experiment.plans[0].command)) * rng.uniform(*COMMAND_STEP)
    noise = COLOURED * floor if hard else floor
    noises = noise * experiment.ranges / experiment.ranges[0]
    logs = tuple(_measured(log, noises, hard, quantum, rng) for log in noise_free)
    if GLITCHES in faults:
        logs = tuple(with_glitches(log, float(experiment.ranges[0]), rng) for log in logs)
    return Case(
        tier,
        kind,
        experiment,
        tuple(acting),
        tuple(hidden),
        floor,
        noise,
        quantum,
        noise_free,
        logs,
        tuple(_stamps(plan, faults, rng) for plan in experiment.plans),
        faults,
        command_step,
    )


def with_log(
    case: Case,
    command: Array,
    rng: np.random.Generator,
    constants: Mapping[str, float] = MappingProxyType({}),
    signals: Sequence[str] = (),
) -> Case:
    """The same rig, its sensors and their noise with one more log, sampled as the first one.

    Args:
        case: a case.
        command: SI, one value per row, shape (n,); it is played as its log can print it.
        rng: of the noise.
        constants: what is set for it [SI], by the product's names: a load, a supply, or 0 for the
            size of an effect that is taken away.
        signals: what is logged beside the readings of the case, with noise as large for its range.

    A load that is not set is that of the last log, again from the beginning where that is over.
    Its recording has no faults.
    """
    before, rig = case.experiment, case.experiment.rig
    plan = _plan(rig, before.plans[0].stride, command - rig.rest)
    if before.varied and LOAD.name not in constants:
        plan = replace(plan, load=np.resize(before.plans[-1].shares, len(command)))
    places = {signal.name: place for signal, place in (*rig.readings, *rig.further)}
    readings = (*before.readings, *(places[name] for name in signals))
    alone = replace(
        before,
        plans=(plan,),
        seed=before.seed + len(before.plans) + len(case.further),
        load=constants.get(LOAD.name, before.load),
        true={**before.true, **constants},
        readings=readings,
    )
    absent = {name.partition(".")[0] for name in constants}
    causes = (it for it in (*case.acting, *case.hidden) if it.name not in absent)
    (noise_free,) = alone.logs(_settings(alone, *causes))
    ranges = replace(before, readings=readings).ranges
    noises = case.noise * ranges / ranges[0]
    log = _measured(noise_free, noises, case.tier == HARD, case.quantum, rng)
    one = replace(
        case,
        experiment=alone,
        noise_free=(noise_free,),
        logs=(log,),
        stamps=(_stamps(plan, (), rng),),
        constants=constants,
        further=(),
    )
    return replace(case, further=(*case.further, one))


def another_command(case: Case, rows: int, rng: np.random.Generator) -> Array:
    """A command [SI] of the kind that the logs of a case have, drawn anew, shape (rows,)."""
    thin = THIN[case.tier]
    rig = replace(case.experiment.rig, sampling=(case.experiment.plans[0].stride // thin,))
    command = np.empty(0)
    while len(command) < rows:
        plans = _plans(rig, case.tier, rng)
        command = np.concatenate([command, *(plan.command for plan in plans)])
    return command[:rows]


def draw_experiment(
    rig: Rig, tier: str, rng: np.random.Generator, faults: tuple[str, ...] = ()
) -> Experiment:
    """Draw the true constants of a rig, its load, what it plays and what is logged."""
    true = {}
    far = str(rng.choice(list(rig.nominal))) if PRIOR in faults else ""
    for name, nominal in rig.nominal.items():
        value = 0.0
        while value < LEAST_VALUE:
            off = rng.standard_normal() if name != far else _far(rng)
            value = 1.0 + rig.spread[name] * off
        true[name] = value * nominal
        if name == "transport_delay.time":
            true[name] = round(true[name] / rig.step) * rig.step
    loaded = rng.random() < 0.5
    load = 0.0
    if loaded:
        load = min(rng.uniform(*rig.load), HELD * rig.strength(true)) * rng.choice([-1.0, 1.0])
    further = [place for _, place in rig.readings[1:]]
    judged = rig.readings[0][1]
    readings = (judged, int(rng.choice(further))) if rng.random() < 0.5 else (judged,)
    seed = int(rng.integers(2**31))
    plans = _plans(rig, tier, rng)
    if loaded and (rng.random() < VARIED or rig.integrators):
        plans = tuple(replace(it, load=load_profile(rig, len(it.command), rng)) for it in plans)
    if faults:
        plans = tuple(logged(plan, faults, rng) for plan in plans)
    return Experiment(rig, true, round(float(load), 6), plans, readings, seed)


def _stamps(plan: Plan, faults: tuple[str, ...], rng: np.random.Generator) -> Array:
    """Time stamps of the logged rows, in periods of the plan."""
    return arrivals(plan.logged, rng) if ARRIVAL in faults else plan.logged.astype(float)


def _far(rng: np.random.Generator) -> float:
    """A distance from a nominal value, in standard deviations, that its uncertainty belies."""
    return float(rng.uniform(*FAR) * rng.choice([-1.0, 1.0]))


def _plans(rig: Rig, tier: str, rng: np.random.Generator) -> tuple[Plan, ...]:
    """What is played on a rig of a tier."""
    return large_step(rig, rng) if tier == POOR else rich(rig, rng, THIN[tier])


def load_profile(rig: Rig, rows: int, rng: np.random.Generator) -> Array:
    """Steps of a load, over its size."""
    levels = rng.uniform(-1.0, 1.0, LOAD_STEPS)
    return _stepped(rig, levels, LOAD_STEPS * np.arange(rows) // rows)


def _settings(experiment: Experiment, *acting: Acting) -> dict[str, float]:
    return {key: v for cause in acting for key, v in cause.settings(experiment).items()}


def _find(experiment: Experiment, causes: tuple[Cause, ...], rng: np.random.Generator) -> Acting:
    """A cause that shows; its shape is drawn again before its name is."""
    low, high = (share * float(experiment.ranges[0]) for share in VISIBLE)
    while True:
        name = _name(experiment, causes, rng)
        for _ in range(SHAPES):
            wanted = low * (high / low) ** rng.random()
            found = sized(experiment, _shaped(causes, name, rng), wanted, 0.2)
            if low <= found.gap <= high:
                return found


def _second(
    experiment: Experiment,
    causes: tuple[Cause, ...],
    main: Acting,
    share: float,
    rng: np.random.Generator,
) -> Acting:
    """A cause of another name with a share of the main one's gap, which it does not undo."""
    while True:
        name = _name(experiment, causes, rng, without=main.name)
        for _ in range(SHAPES):
            found = sized(experiment, _shaped(causes, name, rng), share * main.gap, CLOSE)
            both = experiment.gap(experiment.logs(_settings(experiment, main, found)))
            met = abs(found.gap / (share * main.gap) - 1.0) < CLOSE
            if met and both > KEPT * max(main.gap, found.gap):
                return found


def _name(
    experiment: Experiment, causes: tuple[Cause, ...], rng: np.random.Generator, without: str = ""
) -> str:
    """Any name is as likely as any other, but for friction of a load where there is none, and for
    the scale of a load that does not change."""
    names = {cause.name for cause in causes} - {without}
    if experiment.load == 0.0:
        names -= {"load_friction"}
    if not experiment.varied:
        names -= {"load_gain"}
    return str(rng.choice(sorted(names)))


def _shaped(causes: tuple[Cause, ...], name: str, rng: np.random.Generator) -> Drawn:
    forms = [cause for cause in causes if cause.name == name]
    return draw(forms[int(rng.integers(len(forms)))], rng)


def sized(experiment: Experiment, drawn: Drawn, wanted: float, tolerance: float) -> Acting:
    """The size at which a cause alone makes the wanted gap, as near as it gets.

    The gap over the share of the range is nearly straight in logarithms; the interval that is
    known to hold the size is cut there, and never by less than a twentieth.
    """
    best = Acting(drawn, 0.0, 0.0)
    low, high = (0.0, math.nan), (1.0, math.nan)
    share = 0.5
    for _ in range(TRIES):
        settings = drawn.settings(share, experiment.rig, experiment.units)
        gap = experiment.gap(experiment.logs(settings))
        miss = math.log(max(gap, 1e-30) / wanted) if math.isfinite(gap) else math.inf
        if best.gap == 0.0 or abs(miss) < abs(math.log(best.gap / wanted)):
            best = Acting(drawn, share, gap if miss < math.inf else 0.0)
        if abs(miss) < tolerance / 2.0 or (miss < 0.0 and share == 1.0):
            break
        low, high = ((share, miss), high) if miss < 0.0 else (low, (share, miss))
        share = _between(low, high, drawn.cause.size.decades)
        if high[0] - low[0] < 1e-3:
            break
    return best


def _between(low: tuple[float, float], high: tuple[float, float], slope: float) -> float:
    """The next share to try: (share, log of gap over wanted gap) on both sides, NaN unknown."""
    (left, below), (right, above) = low, high
    margin = 0.05 * (right - left)
    if math.isnan(above):  # the gap grows about as the size does
        guess = left - below / slope + margin
        return 1.0 if guess > 1.0 - margin else guess
    if math.isnan(below):
        return max(right - above / slope - margin, left + margin)
    if below < DEAF:
        return 0.5 * (left + right)
    guess = left - below * (right - left) / (above - below)
    return min(max(guess, left + margin), right - margin)


def _measured(
    log: Array, noises: Array, coloured: bool, quantum: float, rng: np.random.Generator
) -> Array:
    """A log with noise of these sizes on its readings, and the quantum of the judged one."""
    raw = rng.standard_normal(log.shape)
    if coloured:
        keep = rng.uniform(*COLOUR)
        fresh = math.sqrt(1.0 - keep * keep)
        for row in range(1, len(raw)):
            raw[row] = keep * raw[row - 1] + fresh * raw[row]
    measured = log + raw * noises
    if quantum > 0.0:
        measured[:, 0] = quantum * np.round(measured[:, 0] / quantum)
    return np.asarray(measured)


LENGTH = (10.0, 20.0)  # of a log, in slowest time constants
SAMPLES = 20.0  # rows per fastest time constant, at the least, before a tier thins them out
LEVELS = (0.06, 0.14, 0.3, 0.55, 0.8, 1.0)  # sizes of steps, as shares of the largest
LEAD = 0.4  # rest before the first command, in slowest time constants


def large_step(rig: Rig, rng: np.random.Generator) -> tuple[Plan, ...]:
    """One large step, there and back."""
    stride = int(rng.choice(rig.sampling))
    count = _rows(rig, rng, stride, LENGTH)
    there = round(count * rng.uniform(0.08, 0.12))
    back = round(count * rng.uniform(0.45, 0.6))
    excursion = np.zeros(count)
    level = rng.choice([-1.0, 1.0]) * rng.uniform(*rig.amplitude)
    excursion[there:back] = _held(rig, level, back - there)
    return (_plan(rig, stride, excursion),)


def rich(rig: Rig, rng: np.random.Generator, thin: int) -> tuple[Plan, ...]:
    """Steps, triangles and a chirp in one log, or in two; ``thin`` times fewer rows."""
    amplitude = rng.uniform(*rig.amplitude)
    stride = thin * int(rng.choice(rig.sampling))

    def sweeps(slow: int, fast: int) -> list[Array]:
        return [_triangle(rig, rng, slow, stride), _chirp(rig, rng, fast, stride)]

    if rng.random() < 0.7:
        first, second = (_rows(rig, rng, stride, LENGTH) for _ in range(2))
        half = second // 2
        parts = [[_steps(rig, rng, first, stride)], sweeps(half, second - half)]
    else:
        rows = _rows(rig, rng, stride, (15.0, LENGTH[1]))
        third = rows // 3
        parts = [[_steps(rig, rng, third, stride), *sweeps(third, rows - 2 * third)]]
    return tuple(_plan(rig, stride, amplitude * np.concatenate(part)) for part in parts)


def _rows(rig: Rig, rng: np.random.Generator, stride: int, length: tuple[float, float]) -> int:
    """Rows of a log as many slowest time constants long as ``length`` allows."""
    return int(rng.uniform(*length) * rig.slowest / (stride * rig.step))


def _plan(rig: Rig, stride: int, excursion: Array) -> Plan:
    """A plan whose commands are those that its log can print."""
    numbers = (rig.rest + excursion) / rig.command.unit_size
    return Plan(stride, np.round(numbers, rig.command.digits) * rig.command.unit_size)


def _signs(integrators: int) -> Array:
    """The Thue-Morse sequence: held for equal times each, they undo so many integrators."""
    signs = np.ones(1)
    for _ in range(integrators):
        signs = np.concatenate([signs, -signs])
    return signs


def _held(rig: Rig, level: float, rows: int) -> Array:
    """A level held for some rows; of a rig that nothing holds rest, and both ways in turns."""
    signs = _signs(rig.integrators)
    each = rows // (len(signs) + (rig.integrators > 0))
    held = np.repeat(level * signs, each)
    return np.concatenate([np.zeros(rows - len(held)), held])


def _stepped(rig: Rig, levels: Array, which: NDArray[np.int64]) -> Array:
    """Levels held, each for the rows that say its number, in rising order."""
    rows = np.bincount(which, minlength=len(levels))
    return np.concatenate([_held(rig, level, count) for level, count in zip(levels, rows)])


def _steps(rig: Rig, rng: np.random.Generator, count: int, stride: int) -> Array:
    """Rest, then every size once, in any order and direction."""
    lead = round(LEAD * rig.slowest / (stride * rig.step))
    levels = rng.permutation(LEVELS) * rng.choice([-1.0, 1.0], len(LEVELS))
    edges = np.linspace(lead, count, len(levels) + 1)
    edges[1:-1] += rng.uniform(-0.2, 0.2, len(levels) - 1) * (edges[1] - edges[0])
    which = np.searchsorted(edges, np.arange(count), side="right")
    return _stepped(rig, np.append(0.0, levels), which)


def _triangle(rig: Rig, rng: np.random.Generator, count: int, stride: int) -> Array:
    """Rest, then one slow and small triangle, both ways, or two that undo two integrators."""
    lead = round(LEAD * rig.slowest / (stride * rig.step))
    signs = _signs(max(0, rig.integrators - 1))
    phase = len(signs) * np.maximum(np.arange(count) - lead, 0) / (count - lead)
    wave = triangle(phase) * signs[phase.astype(int)]
    return np.asarray(rng.uniform(0.08, 0.25) * rng.choice([-1.0, 1.0]) * wave)


def _chirp(rig: Rig, rng: np.random.Generator, count: int, stride: int) -> Array:
    """A sine whose frequency grows in equal ratios from one and a half periods of its length; a
    cosine where nothing holds the rig, which would leave with the mean of a sine's integral."""
    seconds = count * stride * rig.step
    low, high = 1.5 / seconds, rng.uniform(*rig.chirp)
    turns = chirp_turns(low, high, seconds, count) + 0.25 * (rig.integrators > 0)
    return np.asarray(rng.uniform(0.2, 0.5) * np.sin(2.0 * np.pi * turns))
