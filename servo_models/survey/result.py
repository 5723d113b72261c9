"""A survey: what was found of many jobs, as tables, and what they say together."""

from __future__ import annotations

import json
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import numpy as np
from msgspec.structs import astuple, replace

from servo_models.core.types import Array
from servo_models.data.parameters import Estimate as Given
from servo_models.data.parameters import ParameterSet
from servo_models.diagnosis.verdict import NO_GAP
from servo_models.errors import UserError
from servo_models.files import read_regular
from servo_models.report.document import Document, Figure, about, choice
from servo_models.report.numbers import ARROW, number, plural
from servo_models.report.result import Result
from servo_models.survey.belonging import BATCH, MODEL, Belonging, Place, belongings
from servo_models.survey.job import Estimate, Outcome
from servo_models.survey.variation import Pooled, Split, outlying, split, told

if TYPE_CHECKING:
    import polars as pl

MOST_SPLITS = 24  # parameters of which a page has a mixed model
CHANGES = WORSE, BETTER, NEW, GONE, OTHER = ("worse", "better", "new", "gone", "other")
FLOATS = ("size", "standard_error", "probability", "gap_before", "gap_after", "held_out")


class Value(NamedTuple):
    """An estimate of a job, ``episode`` None for that from all logs together."""

    unit: str
    joint: str
    episode: str | None
    held_out: bool
    estimate: Estimate


class Variation(Document, frozen=True):
    """A parameter of a joint over the units [SI], as far as their logs tell a value."""

    joint: str
    name: str
    measure: Annotated[str, about("Unit of measure.")]
    nominal: float
    prior: Figure
    common: Annotated[Pooled, about("Of the units that do not stand out.")]
    outliers: Annotated[dict[str, float], about("Values that stand out, by unit.")]

    @property
    def size(self) -> float:
        """How far it varies between units, over what was believed, else over the mean [1]."""
        return self.common.between / (self.prior or abs(self.common.mean) or 1.0)


class Difference(Document, frozen=True):
    """How a joint of a unit is other than in an earlier survey, and why that is said."""

    unit: str
    joint: str
    kind: Annotated[str, choice(*CHANGES)]
    why: str


@dataclass(frozen=True, eq=False, repr=False)
class Survey(Result):
    """What was found of many joints, episodes and units.

    Attributes:
        name: what was surveyed.
        outcomes: one a job.
        notes: what was left out when it was planned.
        earlier: outcomes of an earlier survey, to compare with.
        folder: holds the diagnosis of a job as ``jobs/KEY.json``, its page as ``reports/KEY.html``.
    """

    name: str
    outcomes: tuple[Outcome, ...]
    notes: tuple[str, ...] = ()
    earlier: tuple[Outcome, ...] = ()
    folder: Path = Path()

    @cached_property
    def worst(self) -> list[Outcome]:
        """Outcomes, the largest gap first; those that failed come before those without a gap."""
        return sorted(self.outcomes, key=lambda it: it.badness, reverse=True)

    @cached_property
    def by_place(self) -> dict[Place, Outcome]:
        """The worst outcome of each unit and joint."""
        return _by_place(self.outcomes)

    @cached_property
    def belongings(self) -> list[Belonging]:
        """Causes with whom they belong to: the model, a batch, a unit, one joint."""
        return belongings(self.outcomes)

    @cached_property
    def values(self) -> dict[Place, list[Value]]:
        """Values that logs tell, by joint and name of the parameter."""
        found: dict[Place, list[Value]] = defaultdict(list)
        for value in values_of(self.outcomes):
            if told(value.estimate):
                found[value.joint, value.estimate.name].append(value)
        return found

    @cached_property
    def variations(self) -> list[Variation]:
        """Parameters of each joint over the units, those that vary most first."""
        every = (variation(joint, values) for (joint, _), values in self.values.items())
        return sorted(filter(None, every), key=lambda it: it.size, reverse=True)

    @cached_property
    def splits(self) -> dict[Place, Split | None]:
        """Where the variance of the parameters that vary most is from; see ``split``."""
        most = self.variations[:MOST_SPLITS]
        return {(it.joint, it.name): self.split(it.joint, it.name) for it in most}

    @cached_property
    def differences(self) -> list[Difference]:
        """What is other than in the earlier survey, none without one.

        The first of these that holds decides.  Worse: it failed and did not; a gap, where there was
        none; the interval of 95 % of the gap is above that of the earlier one; a cause more.
        Better is the reverse.  Other: other causes.
        """
        before = _by_place(self.earlier)
        every = (
            _difference(place, before.get(place), self.by_place.get(place))
            for place in sorted({*before, *self.by_place} if before else ())
        )
        return sorted(filter(None, every), key=lambda it: CHANGES.index(it.kind))

    def split(self, joint: str, name: str) -> Split | None:
        """Return where the variance of a parameter's episodes is from; see ``variation.split``."""
        episodes = [value for value in self.values[joint, name] if value.episode is not None]
        units = [value.unit for value in episodes]
        return split(units, *told_arrays(episodes)) if episodes else None

    def table(self) -> pl.DataFrame:
        """Return a row a job; gaps are in noise floors, the size [SI] is that of the first cause.

        Example:
            ``survey.table().filter(verdict="failed")``
        """
        import polars as pl

        floats = dict.fromkeys(FLOATS, pl.Float64)
        return pl.DataFrame(
            [_row(it) for it in self.outcomes], schema_overrides=floats, infer_schema_length=None
        )

    def estimates(self) -> pl.DataFrame:
        """Return a row a value [SI]: of each job from all its logs, and from each ``episode``.

        Values are of nominal parameters and of effects that were taken.

        Example:
            ``survey.estimates().filter(name="inertia")``
        """
        import polars as pl

        texts = dict.fromkeys(("unit", "joint", "episode"), str)
        names = {"name": str, "measure": str}
        floats = dict.fromkeys(("nominal", "prior", "value", "standard_error"), float)
        rows = [(*place, *astuple(estimate)) for *place, estimate in values_of(self.outcomes)]
        return pl.DataFrame(rows, {**texts, "held_out": bool, **names, **floats}, orient="row")

    def diagnosis(self, unit: str, joint: str) -> Any:
        """Return a diagnosis as of ``servo-models diagnose --json``, None where the job failed.

        Raises:
            UserError: no such joint, or its file is gone.
        """
        if (unit, joint) not in self.by_place:
            raise UserError(
                f"no joint '{joint}' of unit '{unit}': see the table for those there are"
            )
        file = self.folder / "jobs" / f"{self.by_place[unit, joint].key}.json"
        return json.loads(read_regular(file))["diagnosis"]

    def common(self, joint: str | None = None) -> ParameterSet:
        """Return nominal parameters that fit all units, with the effects that belong to the model.

        The standard error is that of one more unit: the variation between them, and the error of
        their mean.  Units that stand out are left out, and what belongs to a batch.

        Args:
            joint: of which; None for all, which are of one actuator.

        Raises:
            UserError: no such joint, joints of several actuators, or no value to take the mean of.

        Example:
            ``sm.write_parameters(survey.common("elbow"), "elbow.toml")``
        """
        chosen = [it for it in self.outcomes if not it.failure and joint in (None, it.joint)]
        models = {it.model for it in chosen}
        if len(models) != 1:
            joints = ", ".join(sorted({it.joint for it in self.outcomes if not it.failure}))
            what = "several actuators" if models else f"no diagnosis of '{joint or 'any joint'}'"
            raise UserError(f"{what} to take a mean of: name one of {joints}")
        owned: dict[str, set[tuple[str, Place]]] = defaultdict(set)
        for it in self.belongings:
            if it.owner == BATCH or not it.joints or joint in it.joints:
                owned[it.owner].update((it.name, place) for place in it.places)
        nominal = {one.name for it in chosen for one in it.parameters}  # of effects that are on too
        found: dict[str, list[Value]] = defaultdict(list)
        for (of, name), values in self.values.items():
            for value in values if joint in (None, of) else ():
                place = (value.unit, of)
                shared = (name.partition(".")[0], place) in owned[MODEL]
                if shared or (name in nominal and (name, place) not in owned[BATCH]):
                    found[name].append(value)
        estimates = []
        for values in found.values():
            if mean := variation(joint or "", values):
                raw = [value.estimate.value for value in values]
                # what the prior held back may lie out of bounds, which estimates keep
                kept = float(np.clip(mean.common.mean, min(raw), max(raw)))
                origin = f"mean of {plural(mean.common.count, 'unit' if joint else 'joint')}"
                estimates.append(Given(mean.name, kept, mean.common.spread, origin))
        if not estimates:
            raise UserError("no log tells a parameter: there is no mean to take")
        units = plural(len({it.unit for it in chosen}), "unit")
        method = f"survey {self.name}, mean of {units}"
        return ParameterSet(chosen[0].actuator, chosen[0].variant, tuple(estimates), method=method)


def told_apart(outcomes: Sequence[Outcome]) -> tuple[Outcome, ...]:
    """Return outcomes with the actuator behind the joint, where joints of one name have several:
    their values and causes are not to be compared."""
    models = {(outcome.joint, outcome.model) for outcome in outcomes if not outcome.failure}
    often = Counter(joint for joint, _ in models)
    return tuple(
        replace(it, joint=f"{it.joint} ({it.model})")
        if often[it.joint] > 1 and not it.failure
        else it
        for it in outcomes
    )


def _by_place(outcomes: Iterable[Outcome]) -> dict[Place, Outcome]:
    return {
        (outcome.unit, outcome.joint): outcome
        for outcome in sorted(outcomes, key=lambda it: it.badness)
    }


def _row(outcome: Outcome) -> dict[str, object]:
    taken = outcome.taken
    size = next((size for cause in taken for size in cause.sizes), None)
    row: dict[str, object] = {
        "verdict": outcome.said,
        "causes": ", ".join(cause.effect for cause in taken),
        "size": size and size.value,
        "standard_error": size and size.standard_error,
        "measure": size.unit if size else "",
        "probability": taken[0].probability if taken else None,
        **{key: getattr(outcome, key) for key in ("gap_before", "gap_after", "held_out")},
        "warnings": " | ".join(outcome.warnings),
        **{key: getattr(outcome, key) for key in ("seconds", "failure", "key")},
    }
    place = {"unit": outcome.unit, "joint": outcome.joint}
    known = {
        f"condition {key}" if key in (*row, *place) else key: value
        for key, value in outcome.conditions.items()
    }
    return {**place, **known, **row}


def values_of(outcomes: Iterable[Outcome]) -> Iterator[Value]:
    """Yield nominal parameters and sizes of the effects that were taken, then each episode's."""
    for it in outcomes:
        for estimate in (*it.parameters, *(size for cause in it.taken for size in cause.sizes)):
            yield Value(it.unit, it.joint, None, False, estimate)
        for episode in it.episodes:
            for estimate in episode.estimates:
                yield Value(it.unit, it.joint, episode.log, episode.held_out, estimate)


def told_arrays(values: Iterable[Value]) -> Array:
    """Return values and standard errors [SI] that logs tell, shape (2, n)."""
    return np.array([told(value.estimate) for value in values]).T


def variation(joint: str, values: Iterable[Value]) -> Variation | None:
    """Return how told values of one parameter vary, None where there are episodes' alone."""
    whole = [value for value in values if value.episode is None]
    if not whole:
        return None
    known, errors = told_arrays(whole)
    common, far = outlying(known, errors)
    first, outliers = whole[0].estimate, {whole[k].unit: float(known[k]) for k in far}
    return Variation(joint, first.name, first.unit, first.nominal, first.prior, common, outliers)


def _difference(place: Place, before: Outcome | None, now: Outcome | None) -> Difference | None:
    if before is None or now is None:
        only = now or before
        return Difference(*place, NEW if now else GONE, only.said) if only else None
    was, got = ({cause.effect for cause in it.taken} for it in (before, now))
    earlier, gap = (it.gap_before_interval or (np.nan, np.nan) for it in (before, now))
    verdicts = f"{before.said} {ARROW} {now.said}"
    sets = f" {ARROW} ".join(", ".join(sorted(names)) or "no cause" for names in (was, got))
    gaps = f"gap {number(before.gap_before, 3)} {ARROW} {number(now.gap_before, 3)}"
    for worse, better, why in (
        (now.failure, before.failure, verdicts),
        (now.verdict != NO_GAP, before.verdict != NO_GAP, verdicts),
        (gap[0] > earlier[1], gap[1] < earlier[0], gaps),
        (got > was, was > got, sets),
    ):
        if bool(worse) != bool(better):
            return Difference(*place, WORSE if worse else BETTER, why)
    return Difference(*place, OTHER, sets) if got != was else None
