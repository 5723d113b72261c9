"""Whom a cause belongs to: the model, a batch of units, a unit, or one joint of it.

A cause is an effect that a diagnosis took, or a parameter beyond what was believed of it.  What is
on most units of a joint, the model lacks; on most of a batch and few others, the batch has it; on
most joints of a unit, the unit.  Jobs that belong together are explained alike: where the logs of
one leave a choice, it is made as in the others.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import chain

import numpy as np

from servo_models.diagnosis.verdict import covering
from servo_models.survey.job import Estimate, Outcome
from servo_models.survey.variation import Pooled, pooled, told

MODEL, BATCH, UNIT, SINGLE = "model", "batch", "unit", "single"
MOST_SHARE = 0.5  # of units or joints, above which a cause is on most of them
FEW_SHARE = 0.1  # of units outside a batch, up to which a cause is on few of them
LEAST = 2  # units, or joints of one, below which nothing is shared
MOVED_ERRORS = 3.0  # standard errors from the nominal value, above which a parameter has moved,
MOVED_PRIORS = 2.0  # if it did by so many standard deviations of what was believed as well
ALIKE_SHARE = 0.5  # variation of sizes over their mean, up to which they are alike
LIKELY_SHARE = 0.2  # weight of a cause over that of the first explanation, from which it may be
OUTSIDE_WEIGHT = 0.01  # of an explanation that is in the set of other jobs and not in that of one
SET_PROBABILITY = 0.95

Place = tuple[str, str]
"""Unit and joint."""
Effects = frozenset[str]


@dataclass(frozen=True)
class Belonging:
    """A cause, and whose it is.

    Attributes:
        name: effect or parameter.
        owner: ``model``, ``batch``, ``unit`` or ``single``.
        whose: the batch as ``firmware = 2.1``, or the unit; "" for the model.
        joints: on which, in order; none for all.
        places: where it was found.
        asked: units of these joints, of a batch those of it, of a unit its joints.
        size: of the first parameter [``measure``], None where no log tells it.
        smallest, largest: of those sizes.
        measure: unit of measure (SI).
        single_set: explanations of one job in its set of 95 %, mean of all.
        fleet_set: the set of all jobs together, as one cause, most likely first.
    """

    name: str
    owner: str
    whose: str
    joints: tuple[str, ...]
    places: tuple[Place, ...]
    asked: int
    size: Pooled | None
    smallest: float
    largest: float
    measure: str
    single_set: float
    fleet_set: tuple[tuple[str, ...], ...]

    @property
    def alike(self) -> bool:
        """Whether the sizes are."""
        size = self.size
        return size is not None and size.between <= ALIKE_SHARE * abs(size.mean)

    @property
    def units(self) -> list[str]:
        """Units that have it."""
        return sorted({unit for unit, _ in self.places})


@dataclass
class _Case:
    """What is not yet shared of a job: weights of its explanations, and sizes by cause."""

    place: Place
    taken: Effects
    open: dict[Effects, float]
    sizes: Mapping[str, Estimate | None]

    def weights(self) -> dict[str, float]:
        """Of each cause that may be, of all explanations that have it."""
        found: dict[str, float] = defaultdict(float)
        for effects, weight in self.open.items():
            for name in effects:
                found[name] += weight
        least = LIKELY_SHARE * max(self.open.values())
        return {name: weight for name, weight in found.items() if weight >= least}

    def instead_of(self, name: str) -> dict[Effects, float]:
        """Weights of what may take the place of a cause, itself included."""
        others = max((e for e in self.open if name in e), key=self.open.__getitem__) - {name}
        found: dict[Effects, float] = defaultdict(float)
        for effects, weight in self.open.items():
            found[effects - others] += weight
        return found

    def explain(self, name: str) -> None:
        """Go on with the explanations that have a cause, without it."""
        left = {effects - {name}: w for effects, w in self.open.items() if name in effects}
        self.open = {effects: weight / sum(left.values()) for effects, weight in left.items()}
        self.taken -= {name}


@dataclass(frozen=True)
class _Scope:
    """Where a cause may belong."""

    name: str
    owner: str
    whose: str
    joints: frozenset[str]
    units: frozenset[str]
    asked: int
    every_joint: bool = True


@dataclass
class _Fleet:
    """Units and joints that were diagnosed, and batches: units of a condition's value."""

    units: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    joints: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    batches: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))


def belongings(outcomes: Iterable[Outcome]) -> tuple[Belonging, ...]:
    """Return every cause of a survey with whom it belongs to, the widest first."""
    fleet = _Fleet()
    cases: list[_Case] = []
    for outcome in outcomes:
        if not outcome.failure:
            fleet.units[outcome.joint].add(outcome.unit)
            fleet.joints[outcome.unit].add(outcome.joint)
            for key, value in outcome.conditions.items():
                fleet.batches[f"{key} = {value}"].add(outcome.unit)
            cases += _cases(outcome)
    found = [*_taken_off(cases, lambda: _shared(cases, fleet))]
    by_unit: dict[str, list[_Case]] = defaultdict(list)
    for case in cases:
        by_unit[case.place[0]].append(case)
    for mine in by_unit.values():
        found += _taken_off(mine, partial(_of_unit, mine, fleet))
    for case in cases:
        unit, joint = case.place
        taken = case.taken if case.taken in case.open else max(case.open, key=case.open.__getitem__)
        for name in sorted(taken):
            scope = _Scope(name, SINGLE, unit, frozenset({joint}), frozenset({unit}), 1, False)
            found.append(_belonging(scope, [case]))
            case.explain(name)
    return tuple(found)


def _cases(outcome: Outcome) -> Iterator[_Case]:
    place = (outcome.unit, outcome.joint)
    taken = frozenset(cause.effect for cause in outcome.causes if cause.taken)
    if taken:
        weights = {frozenset(one.effects): one.weight for one in outcome.explanations}
        sizes = {one.effect: next(iter(one.sizes), None) for one in outcome.causes}
        yield _Case(place, taken, weights or {taken: 1.0}, sizes)
    for estimate in outcome.parameters:
        if _moved(estimate):
            name = frozenset({estimate.name})
            yield _Case(place, name, {name: 1.0}, {estimate.name: estimate})


def _moved(estimate: Estimate) -> bool:
    distance = abs(estimate.value - estimate.nominal)
    error, prior = estimate.standard_error, estimate.prior
    if error is None or prior is None:
        return False
    return distance > MOVED_ERRORS * error and distance > MOVED_PRIORS * prior


def _taken_off(
    cases: Sequence[_Case], options: Callable[[], Iterable[tuple[_Scope, float]]]
) -> Iterator[Belonging]:
    """The scope of the most weight, and again without what it explains, until none is left."""
    while found := [*options()]:
        scope, _ = max(found, key=lambda it: (it[1], it[0].name, it[0].whose))
        explained = [case for case in cases if _inside(case, scope)]
        yield _belonging(scope, explained)
        for case in explained:
            case.explain(scope.name)


def _inside(case: _Case, scope: _Scope) -> bool:
    unit, joint = case.place
    return unit in scope.units and joint in scope.joints and scope.name in case.weights()


def _by_cause(cases: Sequence[_Case]) -> dict[str, dict[Place, float]]:
    """Weight of each cause where it may be."""
    found: dict[str, dict[Place, float]] = defaultdict(dict)
    for case in cases:
        for name, weight in case.weights().items():
            found[name][case.place] = max(weight, found[name].get(case.place, 0.0))
    return found


def _shared(cases: Sequence[_Case], fleet: _Fleet) -> Iterator[tuple[_Scope, float]]:
    """Causes of the model or of a batch, each with the weight that it has there."""
    for name, weights in _by_cause(cases).items():
        units_of: dict[str, set[str]] = defaultdict(set)
        for unit, joint in weights:
            units_of[joint].add(unit)
        joints_of: dict[str, set[str]] = defaultdict(set)
        for joint, there in units_of.items():
            asked = fleet.units[joint]
            batch = _batch(there, asked, fleet.batches)
            if batch or _most(there, asked):
                joints_of[batch].add(joint)
        for batch, found in joints_of.items():
            joints = {*fleet.units} if _most(found, fleet.units) else found
            every = set[str]().union(*(fleet.units[joint] for joint in joints))
            units = fleet.batches.get(batch, every) & every
            scope = _Scope(
                name,
                BATCH if batch else MODEL,
                batch,
                frozenset(joints),
                frozenset(units),
                len(units),
                len(joints) == len(fleet.units),
            )
            yield (
                scope,
                sum(w for (unit, joint), w in weights.items() if unit in units and joint in joints),
            )


def _most(there: Collection[object], asked: Collection[object]) -> bool:
    return len(there) >= LEAST and len(there) > MOST_SHARE * len(asked)


def _batch(there: set[str], asked: set[str], batches: Mapping[str, set[str]]) -> str:
    """The batch of which most units have it, and few others, the largest; "" for none."""
    found = {
        name: len(there & batch)
        for name, batch in batches.items()
        if _most(there & batch, batch & asked)
        and len(asked - batch) >= LEAST
        and len(there - batch) <= FEW_SHARE * len(asked - batch)
    }
    return max(found, key=found.__getitem__, default="")


def _of_unit(cases: Sequence[_Case], fleet: _Fleet) -> Iterator[tuple[_Scope, float]]:
    """Causes of the unit whose cases these are."""
    for name, weights in _by_cause(cases).items():
        (unit,) = {unit for unit, _ in weights}
        joints = fleet.joints[unit]
        if _most(weights, joints):
            scope = _Scope(name, UNIT, unit, frozenset(joints), frozenset({unit}), len(joints))
            yield scope, sum(weights.values())


def _belonging(scope: _Scope, cases: Sequence[_Case]) -> Belonging:
    name = scope.name
    estimates = [one for case in cases if (one := case.sizes.get(name))]
    sizes = [size for one in estimates if (size := told(one))]
    values, errors = np.array(sizes).reshape(-1, 2).T
    tables = [case.instead_of(name) for case in cases]
    everything = sorted({*chain(*tables)}, key=sorted)
    weights = np.array([[t.get(e, OUTSIDE_WEIGHT) for e in everything] for t in tables])
    together = np.log(weights).sum(axis=0)
    together = np.exp(together - together.max())
    return Belonging(
        name,
        scope.owner,
        scope.whose,
        () if scope.every_joint else tuple(sorted(scope.joints)),
        tuple(sorted({case.place for case in cases})),
        scope.asked,
        pooled(values, errors) if len(values) else None,
        float(values.min(initial=np.inf)),
        float(values.max(initial=-np.inf)),
        estimates[0].unit if estimates else "",
        float(np.mean([len(covering(row / row.sum(), SET_PROBABILITY)) for row in weights])),
        tuple(
            tuple(sorted(everything[k]))
            for k in covering(together / together.sum(), SET_PROBABILITY)
        ),
    )
