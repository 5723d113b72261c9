"""Whom a cause belongs to: the model, a batch of units, a unit, or one joint of it.

A cause is an effect that a diagnosis took, or a parameter beyond what was believed of it.  What is
on most units of a joint, the model lacks; on most of a batch and few others, the batch has it; on
most joints of a unit, the unit.  Jobs that belong together are explained alike: where the logs of
one leave a choice, it is made as in the others.  A parameter that all have re-tuned, each within
what was believed, is a cause where a batch has another size of it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from statistics import fmean, median
from typing import Annotated, NamedTuple

import numpy as np
from scipy.stats import ttest_ind_from_stats

from servo_models.diagnosis.verdict import covering
from servo_models.report.document import Document, Figure, about, choice
from servo_models.survey.job import Estimate, Outcome
from servo_models.survey.variation import Pooled, pooled, told

MODEL, BATCH, UNIT, SINGLE = "model", "batch", "unit", "single"
MOST_SHARE = 0.5  # of units or joints, above which a cause is on most of them
FEW_SHARE = 0.1  # of units outside a batch, up to which a cause is on few of them
LEAST = 2  # units, or joints of one, below which nothing is shared
MOVED_ERRORS = 3.0  # standard errors from the nominal value, above which a parameter has moved,
MOVED_PRIORS = 2.0  # if it did by so many standard deviations of what was believed as well
SIZE_CHANCE = 0.01  # probability that units that are alike have a batch of another size
LIKELY_SHARE = 0.2  # weight of a cause over that of the first explanation, from which it may be
OUTSIDE_WEIGHT = 0.01  # of an explanation that is in the set of other jobs and not in that of one
SET_PROBABILITY = 0.95

Place = tuple[str, str]
"""Unit and joint."""
Effects = frozenset[str]


class Belonging(Document, frozen=True):
    """A cause, and whose it is."""

    name: Annotated[str, about("Effect or parameter.")]
    owner: Annotated[str, choice(MODEL, BATCH, UNIT, SINGLE)]
    whose: Annotated[str, about("The batch, as 'firmware = 2.1', or the unit.")]
    joints: Annotated[Sequence[str], about("None are all.")]
    places: Annotated[Sequence[Place], about("Unit and joint where it was found.")]
    asked: Annotated[int, about("Units of the model or the batch; joints of the unit.")]
    size: Annotated[
        Pooled | None, about("Of its first parameter; null: no log tells it, or of several units.")
    ]
    smallest: Figure
    largest: Figure
    measure: Annotated[str, about("Unit of measure of these.")]
    single_set: Annotated[float, about("Explanations in the 95 % set of a job, mean.")]
    fleet_set: Annotated[Sequence[Sequence[str]], about("Those of all jobs as one cause.")]


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


class _Scope(NamedTuple):
    """Where a cause may belong, after the weight that it has there."""

    weight: float
    name: str
    owner: str
    whose: str
    joints: Collection[str]
    units: Collection[str]
    every_joint: bool


class _Fleet(NamedTuple):
    """Units of each joint, joints of each unit, and units of each batch."""

    units: dict[str, set[str]]
    joints: dict[str, set[str]]
    batches: dict[str, set[str]]


def belongings(outcomes: Iterable[Outcome]) -> list[Belonging]:
    """Return every cause of a survey with whom it belongs to, the widest first."""
    fleet = _Fleet(defaultdict(set), defaultdict(set), defaultdict(set))
    by_unit: dict[str, list[_Case]] = defaultdict(list)
    tuned: dict[str, list[_Case]] = defaultdict(list)
    for outcome in (it for it in outcomes if it.conclusive):
        fleet.units[outcome.joint].add(outcome.unit)
        fleet.joints[outcome.unit].add(outcome.joint)
        for key, value in outcome.conditions.items():
            fleet.batches[f"{key} = {value}"].add(outcome.unit)
        by_unit[outcome.unit] += _effects_of(outcome)
        for one in outcome.parameters:
            alone = frozenset({one.name})
            case = _Case((outcome.unit, outcome.joint), alone, {alone: 1.0}, {one.name: one})
            tuned[one.name].append(case)
            by_unit[outcome.unit] += [case] if _has_moved(one) else []
    cases = [*chain(*by_unit.values())]
    found = [*_taken_off(cases, partial(_shared, cases, fleet), fleet.batches)]
    found += _set_apart(tuned, fleet)
    for mine in by_unit.values():
        found += _taken_off(mine, partial(_of_unit, mine, fleet), {})
    for case in cases:
        unit, joint = case.place
        first = case.taken if case.taken in case.open else max(case.open, key=case.open.__getitem__)
        for name in sorted(first):
            found.append(
                _belonging(_Scope(1.0, name, SINGLE, unit, {joint}, {unit}, False), [case])
            )
            case.explain(name)
    return found


def _effects_of(outcome: Outcome) -> Iterator[_Case]:
    taken = frozenset(cause.effect for cause in outcome.causes if cause.taken)
    if taken:
        weights = {frozenset(one.effects): one.weight for one in outcome.explanations}
        sizes = {one.effect: next(iter(one.sizes), None) for one in outcome.causes}
        yield _Case((outcome.unit, outcome.joint), taken, weights or {taken: 1.0}, sizes)


def _has_moved(one: Estimate) -> bool:
    """Whether a parameter is beyond what was believed of it, also on a bound."""
    error, prior = one.standard_error or 0.0, one.prior or np.inf
    return abs(one.value - one.nominal) > max(MOVED_ERRORS * error, MOVED_PRIORS * prior)


def _set_apart(tuned: Mapping[str, Sequence[_Case]], fleet: _Fleet) -> Iterator[Belonging]:
    """Parameters of which a batch has another size, without those that are explained."""
    for name, every in tuned.items():
        cases = [case for case in every if case.weights()]
        batch = _batch_by_size(name, cases, fleet.batches, SIZE_CHANCE / len(tuned))
        if mine := [case for case in cases if case.place[0] in fleet.batches.get(batch, ())]:
            units, joints = ({*names} for names in zip(*(case.place for case in mine)))
            whole = joints == fleet.units.keys()
            yield _belonging(_Scope(1.0, name, BATCH, batch, joints, units, whole), mine)
        for case in mine:
            case.explain(name)


def _taken_off(
    cases: Sequence[_Case],
    options: Callable[[], Iterable[_Scope]],
    batches: Mapping[str, set[str]],
) -> Iterator[Belonging]:
    """The scope of the most weight, and again without what it explains, until none is left."""
    while scopes := [*options()]:
        scope = max(scopes, key=lambda it: it[:4])
        inside = (it for it in cases if it.place[0] in scope.units and it.place[1] in scope.joints)
        # what is shared is likelier in one more job: it needs no more than a place in the set there
        explained = [case for case in inside if any(scope.name in it for it in case.open)]
        apart = _batch_by_size(scope.name, explained, batches) if scope.owner == MODEL else ""
        if apart:
            batch = batches[apart] & {*scope.units}
            of_batch = scope._replace(owner=BATCH, whose=apart, units=batch)
            yield _belonging(of_batch, [it for it in explained if it.place[0] in batch])
            scope = scope._replace(units={*scope.units} - batch)
        yield _belonging(scope, [it for it in explained if it.place[0] in scope.units])
        for case in explained:
            case.explain(scope.name)


def _batch_by_size(
    name: str, cases: Sequence[_Case], batches: Mapping[str, set[str]], chance: float = SIZE_CHANCE
) -> str:
    """The batch most of whose units have another size of a cause than nearly all others, "" for
    none: sizes nearer to its mean than to that of others, and means that differ by Student's t.

    The size of a unit is the mean of its values, each as a share of the median of its joint.
    """
    by_joint: dict[str, list[tuple[str, float]]] = defaultdict(list)
    for case in cases:
        if (estimate := case.sizes.get(name)) and (size := _size(estimate)) is not None:
            unit, joint = case.place
            by_joint[joint].append((unit, size))
    by_unit: dict[str, list[float]] = defaultdict(list)
    for values in by_joint.values():
        middle = median(size for _, size in values)
        for unit, size in values:
            by_unit[unit].append((size - middle) / (abs(middle) or 1.0))
    sizes = {unit: fmean(values) for unit, values in by_unit.items()}
    chances: dict[str, float] = {}
    for batch, units in batches.items():
        inside = [size for unit, size in sizes.items() if unit in units]
        others = [size for unit, size in sizes.items() if unit not in units]
        if not LEAST <= len(inside) <= len(others):  # the size of most units is the model's
            continue
        mean, rest = fmean(inside), fmean(others)
        nearer = {unit for unit, size in sizes.items() if abs(size - mean) < abs(size - rest)}
        if _batch(nearer, {*sizes}, {batch: units}):
            each = ((fmean(it), np.std(it, ddof=1), len(it)) for it in (inside, others))
            chances[batch] = ttest_ind_from_stats(*chain(*each)).pvalue * len(batches)
    batch = min(chances, key=chances.__getitem__, default="")
    return batch if batch and chances[batch] < chance else ""


def _size(one: Estimate) -> float | None:
    """What logs say of a size; a parameter with a prior lacks a standard error on a bound alone."""
    if one.prior and one.standard_error is None:
        return one.value
    known = told(one)
    return known and known[0]


def _by_cause(cases: Sequence[_Case]) -> Iterator[tuple[str, dict[Place, float]]]:
    """Each cause with its weight where it may be."""
    found: dict[str, dict[Place, float]] = defaultdict(dict)
    for case in cases:
        for name, weight in case.weights().items():
            found[name][case.place] = weight
    return iter(found.items())


def _shared(cases: Sequence[_Case], fleet: _Fleet) -> Iterator[_Scope]:
    """Causes of the model or of a batch."""
    for name, weights in _by_cause(cases):
        units_of: dict[str, set[str]] = defaultdict(set)
        for unit, joint in weights:
            units_of[joint].add(unit)
        joints_of: dict[str, set[str]] = defaultdict(set)
        for joint, there in units_of.items():
            batch = _batch(there, fleet.units[joint], fleet.batches)
            if batch or _most(there, fleet.units[joint]):
                joints_of[batch].add(joint)
        for batch, found in joints_of.items():
            joints = {*fleet.units} if _most(found, fleet.units) else found
            every = set[str]().union(*(fleet.units[joint] for joint in joints))
            units = fleet.batches.get(batch, every) & every
            weight = sum(w for (u, j), w in weights.items() if u in units and j in joints)
            whole = len(joints) == len(fleet.units)
            yield _Scope(weight, name, BATCH if batch else MODEL, batch, joints, units, whole)


def _of_unit(cases: Sequence[_Case], fleet: _Fleet) -> Iterator[_Scope]:
    """Causes of the unit whose cases these are."""
    for name, weights in _by_cause(cases):
        unit = cases[0].place[0]
        joints = fleet.joints[unit]
        if _most(weights, joints):
            yield _Scope(sum(weights.values()), name, UNIT, unit, joints, {unit}, True)


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


def _belonging(scope: _Scope, cases: Sequence[_Case]) -> Belonging:
    """What these cases say of the cause, each of which may have it."""
    estimates = [one for case in cases if (one := case.sizes.get(scope.name))]
    measures = {one.unit for one in estimates}
    if len(measures) > 1:  # such as friction of a turning and of a sliding joint
        estimates = []
    known = np.array([size for one in estimates if (size := told(one))]).reshape(-1, 2)
    tables = [case.instead_of(scope.name) for case in cases]
    every = sorted({*chain(*tables)}, key=sorted)
    weights = np.array([[table.get(it, OUTSIDE_WEIGHT) for it in every] for table in tables])
    together = np.log(weights).sum(axis=0)
    together = np.exp(together - together.max())
    held = covering(together / together.sum(), SET_PROBABILITY)
    single = [len(covering(row / row.sum(), SET_PROBABILITY)) for row in weights]
    return Belonging(
        scope.name,
        scope.owner,
        scope.whose,
        () if scope.every_joint else sorted(scope.joints),
        sorted({case.place for case in cases}),
        len(scope.joints if scope.owner == UNIT else scope.units),
        pooled(*known.T) if len(known) else None,
        min(known[:, 0], default=None),
        max(known[:, 0], default=None),
        measures.pop() if estimates else "",
        float(np.mean(single)),
        [sorted(every[k]) for k in held],
    )
