"""A survey: what was found of many jobs, as tables, and what they say together."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from servo_models.core.types import Array
from servo_models.data.parameters import Estimate as Given
from servo_models.data.parameters import ParameterSet
from servo_models.data.readers.columns import extra
from servo_models.diagnosis.verdict import NO_GAP
from servo_models.errors import UserError
from servo_models.report.numbers import ARROW, number, plural
from servo_models.report.result import Result
from servo_models.survey.belonging import MODEL, Belonging, Place, belongings
from servo_models.survey.job import Cause, Estimate, Outcome
from servo_models.survey.variation import Pooled, Split, outlying, split, told

if TYPE_CHECKING:
    import polars as pl

MOST_SPLITS = 24  # variances that are split for a page: each is a mixed model
FAILED = "failed"
NEW, GONE, WORSE, BETTER, OTHER = "new", "gone", "worse", "better", "other"
COLUMNS: dict[str, type] = {
    "unit": str,
    "joint": str,
    "verdict": str,
    "causes": str,
    "size": float,
    "standard_error": float,
    "measure": str,
    "probability": float,
    "gap_before": float,
    "gap_after": float,
    "held_out": float,
    "warnings": str,
    "seconds": float,
    "failure": str,
    "key": str,
}
ESTIMATES = {
    **{"unit": str, "joint": str, "episode": str, "held_out": bool, "name": str, "measure": str},
    **dict.fromkeys(("nominal", "prior", "value", "standard_error"), float),
}
SPREAD = {
    **{"joint": str, "name": str, "measure": str, "units": int, "episodes": int},
    **dict.fromkeys(("nominal", "mean", "error", "between"), float),
    **dict.fromkeys(("unit_share", "episode_share", "rest_share"), float),
}


class Value(NamedTuple):
    """An estimate of a job, ``episode`` None for that from all logs together."""

    unit: str
    joint: str
    episode: str | None
    held_out: bool
    estimate: Estimate


@dataclass(frozen=True, eq=False)
class Variation:
    """A parameter of a joint over the units.

    Attributes:
        joint, name, measure: of which joint, parameter and unit of measure (SI).
        nominal: value of the model [SI].
        prior: standard deviation that was believed of it, None for none.
        values: of the units, as far as their logs tell one.
        common: mean of those that do not stand out.
        outliers: values that do.
        episodes: the same of single logs.
    """

    joint: str
    name: str
    measure: str
    nominal: float
    prior: float | None
    values: tuple[Value, ...]
    common: Pooled
    outliers: tuple[Value, ...]
    episodes: tuple[Value, ...]

    @property
    def size(self) -> float:
        """How far values may vary [1]: between units, over what was believed or over the mean."""
        return self.common.between / (self.prior or abs(self.common.mean) or 1.0)

    @cached_property
    def split(self) -> Split | None:
        """Variance of the episodes by unit, episode and rest; see ``variation.split``."""
        values, errors = _arrays(self.episodes)
        return split([value.unit for value in self.episodes], values, errors)


@dataclass(frozen=True)
class Difference:
    """How a joint of a unit is other than in an earlier survey, and why that is said."""

    unit: str
    joint: str
    kind: str
    why: str


@dataclass(frozen=True, eq=False, repr=False)
class Survey(Result):
    """What was found of many joints, episodes and units.

    Attributes:
        name: what was surveyed.
        outcomes: one a job.
        notes: what was left out when it was planned.
        earlier: outcomes of an earlier survey, to compare with.
        folder: holds the diagnosis of a job as ``jobs/KEY.json``, its page as
            ``reports/KEY.html``; None for nowhere.
    """

    name: str
    outcomes: tuple[Outcome, ...]
    notes: tuple[str, ...] = ()
    earlier: tuple[Outcome, ...] = ()
    folder: Path | None = None

    @cached_property
    def worst(self) -> tuple[Outcome, ...]:
        """Outcomes, the largest gap first; those that failed come before those without a gap."""
        return tuple(sorted(self.outcomes, key=badness, reverse=True))

    @cached_property
    def by_place(self) -> dict[Place, Outcome]:
        """The worst outcome of each unit and joint."""
        return _by_place(self.outcomes)

    @cached_property
    def belongings(self) -> tuple[Belonging, ...]:
        """Causes with whom they belong to: the model, a batch, a unit, one joint."""
        return belongings(self.outcomes)

    @cached_property
    def variations(self) -> tuple[Variation, ...]:
        """Parameters of each joint over the units, those that vary most first."""
        found: dict[Place, list[Value]] = defaultdict(list)
        for value in values_of(self.outcomes):
            found[value.joint, value.estimate.name].append(value)
        every = (variation(joint, values) for (joint, _), values in found.items())
        return tuple(sorted(filter(None, every), key=lambda it: it.size, reverse=True))

    @cached_property
    def splits(self) -> dict[Place, Split]:
        """Where the variance of those that vary most is from, by joint and parameter."""
        if self.no_splits:
            return {}
        chosen = self.variations[:MOST_SPLITS]
        return {(it.joint, it.name): it.split for it in chosen if it.split}

    @cached_property
    def no_splits(self) -> str:
        """Why variances are not split: what to install, "" where they are."""
        try:
            extra("survey", "statsmodels")
        except UserError as error:
            return str(error)
        return ""

    @cached_property
    def differences(self) -> tuple[Difference, ...]:
        """What is other than in the earlier survey, none without one.

        The first of these that holds decides. Worse: it failed and did not; a gap, where there was
        none; a cause more; the interval of 95 % of the gap is above that of the earlier one. Better
        is the reverse. Other: other causes.
        """
        before = _by_place(self.earlier)
        return tuple(_differences(before, self.by_place)) if self.earlier else ()

    def table(self) -> pl.DataFrame:
        """Return a row a job; gaps are in noise floors, the size [SI] is that of the first cause.

        Example:
            ``survey.table().filter(pl.col("verdict") == "failed")``
        """
        import polars as pl

        keys = dict.fromkeys(key for outcome in self.outcomes for key in outcome.conditions)
        names = {key: f"condition {key}" if key in COLUMNS else key for key in keys}
        every = [*COLUMNS]
        schema = {name: COLUMNS[name] for name in every[:2]}
        schema |= dict.fromkeys(names.values(), str)
        schema |= {name: COLUMNS[name] for name in every[2:]}
        rows = (
            _row(outcome) | {names[key]: value for key, value in outcome.conditions.items()}
            for outcome in self.outcomes
        )
        return pl.DataFrame([*rows], schema)

    def estimates(self) -> pl.DataFrame:
        """Return a row a value [SI]: of each job from all its logs, and from each ``episode``.

        Values are of nominal parameters and of effects that were taken.

        Example:
            ``survey.estimates().filter(pl.col("name") == "inertia")``
        """
        import polars as pl

        rows = [
            (*place, it.name, it.unit, it.nominal, it.prior, it.value, it.standard_error)
            for *place, it in values_of(self.outcomes)
        ]
        return pl.DataFrame(rows, ESTIMATES, orient="row")

    def spread(self) -> pl.DataFrame:
        """Return how each parameter varies over units and episodes [SI], a row a joint of each.

        The shares of variance are those of ``variation.split``, null where no unit has two
        episodes.

        Raises:
            UserError: statsmodels is not installed.
        """
        import polars as pl

        rows = [
            (
                *(it.joint, it.name, it.measure, it.common.count, len(it.episodes), it.nominal),
                *(it.common.mean, it.common.error, it.common.between),
                *(it.split.shares if it.split else (None, None, None)),
            )
            for it in self.variations
        ]
        return pl.DataFrame(rows, SPREAD, orient="row")

    def common(self, joint: str | None = None) -> ParameterSet:
        """Return nominal parameters that fit all units, with the effects that belong to the model.

        The standard error is that of one more unit: the variation between them, and the error of
        their mean.  Units that stand out are left out.

        Args:
            joint: of which; None for all, which are of one actuator.

        Raises:
            UserError: no such joint, joints of several actuators, or no value to take the mean of.

        Example:
            ``sm.write_parameters(survey.common("elbow"), "elbow.toml")``
        """
        chosen = [it for it in self.outcomes if not it.failure and joint in (None, it.joint)]
        of = sorted({(it.actuator, it.variant) for it in chosen})
        if len(of) != 1:
            joints = ", ".join(sorted({it.joint for it in self.outcomes if not it.failure}))
            raise UserError(f"no one actuator for joint {joint or 'of all'}: name one of {joints}")
        shared = {
            it.name
            for it in self.belongings
            if it.owner == MODEL and (not it.joints or joint in it.joints)
        }
        found: dict[str, list[Value]] = defaultdict(list)
        for value in values_of(chosen):
            effect, dot, _ = value.estimate.name.partition(".")
            if not dot or effect in shared:
                found[value.estimate.name].append(value)
        means = {
            name: (it.common, [value.estimate.value for value in it.values])
            for name, values in found.items()
            if (it := variation(joint or "", values))
        }
        if not means:
            raise UserError("no logs tell a parameter: there is no mean to take")
        ((actuator, variant),) = of
        units = {it.unit for it in chosen}
        return ParameterSet(
            actuator,
            variant,
            tuple(
                # what is taken off for the prior may lead out of bounds, which estimates keep
                Given(
                    name,
                    float(np.clip(mean.mean, min(raw), max(raw))),
                    mean.spread,
                    f"mean of {mean.count}",
                )
                for name, (mean, raw) in means.items()
            ),
            method=f"survey {self.name}, mean of {plural(len(units), 'unit')}",
        )


def verdict(outcome: Outcome) -> str:
    """Return the verdict, ``failed`` where there is none."""
    return outcome.verdict or FAILED


def causes(outcome: Outcome) -> list[Cause]:
    """Return the effects that were taken, most likely first."""
    return [cause for cause in outcome.causes if cause.taken]


def badness(outcome: Outcome) -> tuple[int, float]:
    """Return what sorts outcomes: no gap, then what failed, then gaps by size."""
    rank = 1 if outcome.failure else 2 * (outcome.verdict != NO_GAP)
    return rank, outcome.gap_before or 0.0


def _by_place(outcomes: Iterable[Outcome]) -> dict[Place, Outcome]:
    found = sorted(outcomes, key=badness)
    return {(outcome.unit, outcome.joint): outcome for outcome in found}


def _row(outcome: Outcome) -> dict[str, object]:
    taken = causes(outcome)
    size = next((size for cause in taken for size in cause.sizes[:1]), None)
    return {
        "unit": outcome.unit,
        "joint": outcome.joint,
        "verdict": verdict(outcome),
        "causes": ", ".join(cause.effect for cause in taken),
        "size": size and size.value,
        "standard_error": size and size.standard_error,
        "measure": size and size.unit,
        "probability": taken[0].probability if taken else None,
        "gap_before": outcome.gap_before,
        "gap_after": outcome.gap_after,
        "held_out": outcome.held_out,
        "warnings": " | ".join(outcome.warnings),
        "seconds": outcome.seconds,
        "failure": outcome.failure,
        "key": outcome.key,
    }


def values_of(outcomes: Iterable[Outcome]) -> Iterator[Value]:
    """Yield nominal parameters and sizes of the effects that were taken, then each episode's."""
    for it in outcomes:
        for estimate in (*it.parameters, *(size for cause in causes(it) for size in cause.sizes)):
            yield Value(it.unit, it.joint, None, False, estimate)
        for episode in it.episodes:
            for estimate in episode.estimates:
                yield Value(it.unit, it.joint, episode.log, episode.held_out, estimate)


def _arrays(values: Iterable[Value]) -> tuple[Array, Array]:
    known, errors = np.array([told(value.estimate) for value in values]).reshape(-1, 2).T
    return known, errors


def variation(joint: str, values: Iterable[Value]) -> Variation | None:
    """Return how the values of one parameter vary, None where no logs tell one."""
    clear = [value for value in values if told(value.estimate)]
    whole = tuple(value for value in clear if value.episode is None)
    if not whole:
        return None
    common, far = outlying(*_arrays(whole))
    first = whole[0].estimate
    return Variation(
        joint,
        first.name,
        first.unit,
        first.nominal,
        first.prior,
        whole,
        common,
        tuple(whole[k] for k in far),
        tuple(value for value in clear if value.episode is not None),
    )


def _differences(
    before: Mapping[Place, Outcome], now: Mapping[Place, Outcome]
) -> Iterator[Difference]:
    for place in sorted({*before, *now}):
        if place not in before:
            yield Difference(*place, NEW, verdict(now[place]))
        elif place not in now:
            yield Difference(*place, GONE, f"was {verdict(before[place])}")
        elif said := _change(before[place], now[place]):
            yield Difference(*place, *said)


def _change(before: Outcome, now: Outcome) -> tuple[str, str] | None:
    """Whether a job is worse or better, and why."""
    was, got = ({cause.effect for cause in causes(it)} for it in (before, now))
    earlier, gap = (it.gap_before_interval or (np.nan, np.nan) for it in (before, now))
    gaps = f"gap {number(before.gap_before, 3)} {ARROW} {number(now.gap_before, 3)}"
    rules = (
        (now.failure, before.failure, f"{verdict(before)} {ARROW} {verdict(now)}"),
        (
            now.verdict != NO_GAP,
            before.verdict != NO_GAP,
            f"{verdict(before)} {ARROW} {verdict(now)}",
        ),
        (got > was, was > got, f"causes {_told(was)} {ARROW} {_told(got)}"),
        (gap[0] > earlier[1], gap[1] < earlier[0], gaps),
    )
    for worse, better, why in rules:
        if bool(worse) != bool(better):
            return WORSE if worse else BETTER, why
    return (OTHER, rules[2][2]) if got != was else None


def _told(names: set[str]) -> str:
    return ", ".join(sorted(names)) or "none"
