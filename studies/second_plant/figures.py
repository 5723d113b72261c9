"""The figures of the study, each a function whose docstring defines it, and their bars.

A failed diagnosis counts as wrong wherever its case is counted.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from servo_models.diagnosis.verdict import NO_GAP, OUTSIDE, PARAMETERS
from servo_models.report.result import Report
from servo_models.report.sections import Section, Table
from servo_models.withheld.oracle import FAILED, Diagnosed
from servo_models.withheld.score import NOTHING, Statistic, mean, share
from servo_models.withheld.sections import AT_LEAST, AT_MOST, COLUMNS, Bar, figure_rows, quantity
from studies.second_plant.judge import Observed, sets_of

PLAY = frozenset({"backlash", "coasting_backlash"})
UNCLAIMED = (OUTSIDE, FAILED)  # verdicts beside which effects that are named are no claim


@dataclass(frozen=True)
class Case:
    """A rig: what is true, what was said, and what could have been said."""

    answer: Mapping[str, Any]
    said: Diagnosed
    observed: Observed

    @property
    def kind(self) -> str:
        return str(self.answer["kind"])

    @property
    def causes(self) -> tuple[str, ...]:
        return tuple(self.answer["causes"])

    @property
    def play_share(self) -> float | None:
        """Inertia behind the play over all of it; None where there is no play."""
        if "play" not in self.causes:
            return None
        drive = self.answer["drive"]
        behind = float(drive["output_inertia"])
        return behind / (behind + float(drive["motor_inertia"]))

    @property
    def play_first(self) -> bool:
        """The explanation at first place has play in it."""
        return bool(PLAY & {*self.said.named}) and self.said.verdict != FAILED

    @property
    def right(self) -> bool:
        """The explanation names every cause, and no effect that is not there."""
        told = self.said.verdict != FAILED
        return told and frozenset(self.said.named) in sets_of(self.causes)

    @property
    def first_right(self) -> bool:
        """The most probable effect is there; or none is named, where parameters are the truth."""
        if not self.said.named:
            return self.right and self.said.verdict in (NO_GAP, PARAMETERS)
        return next(iter(self.said.chances), "") in self.there

    @property
    def there(self) -> frozenset[str]:
        """Every effect that may be named."""
        return frozenset().union(*sets_of(self.causes))

    @property
    def invented(self) -> frozenset[str]:
        """Effects that are named and are not there."""
        return frozenset(self.said.named) - self.there

    @property
    def claimed(self) -> bool:
        """An effect is told that is not there."""
        return bool(self.invented) and self.said.verdict not in UNCLAIMED

    @property
    def wrong(self) -> bool:
        """Another answer was due."""
        if self.kind == NOTHING:
            return self.said.verdict not in (NO_GAP, PARAMETERS)
        return self.claimed or (self.observed.separated and not self.right)


Cases = Sequence[Case]


def _one(cases: Cases) -> list[Case]:
    return [case for case in cases if case.kind == "one"]


def _separated(cases: Iterable[Case]) -> list[Case]:
    return [case for case in cases if case.observed.separated]


def separated(cases: Cases) -> Statistic:
    """Something wrong: an observer who knows the truth separates it from its best rival."""
    return share(case.observed.separated for case in cases if case.kind != NOTHING)


def first_place(cases: Cases) -> Statistic:
    """One cause, separated: the most probable effect is it; for inertia, parameters alone are
    right as well.  Whatever the verdict says beside it."""
    return share(case.first_right for case in _separated(_one(cases)))


def false_second(cases: Cases) -> Statistic:
    """One cause, separated or not: the explanation that is told names an effect that is not
    there.  Beside ``outside-catalogue`` none is told."""
    return share(case.claimed for case in _one(cases))


def false_beside_true(cases: Cases) -> Statistic:
    """The same where an effect that is there is named beside it: a false second in the narrow
    sense."""
    return share(case.claimed and bool(case.there & {*case.said.named}) for case in _one(cases))


def both_named(cases: Cases) -> Statistic:
    """Two causes, separated: the explanation at first place names both and no other effect."""
    return share(case.right for case in _separated(cases) if case.kind == "two")


def false_of_two(cases: Cases) -> Statistic:
    """Two causes, separated or not: the explanation that is told names an effect that is not
    there."""
    return share(case.claimed for case in cases if case.kind == "two")


def play_named(cases: Cases) -> Statistic:
    """Play, alone or with another cause, separated or not: the explanation that is told names it.
    Beside ``outside-catalogue`` none is told."""
    return _play_named(case for case in cases if case.play_share is not None)


def play_first(cases: Cases) -> Statistic:
    """The same, and beside ``outside-catalogue`` the explanation at first place counts as well."""
    return share(case.play_first for case in cases if case.play_share is not None)


def _play_named(cases: Iterable[Case]) -> Statistic:
    return share(case.play_first and case.said.verdict not in UNCLAIMED for case in cases)


def play_by_share(cases: Cases) -> dict[float, Statistic]:
    """``play_named`` by the share of the inertia that is behind the play, in hundredths."""
    by_share: dict[float, list[Case]] = {}
    for case in cases:
        if case.play_share is not None:
            by_share.setdefault(round(case.play_share, 2), []).append(case)
    return {behind: _play_named(by_share[behind]) for behind in sorted(by_share)}


def suspected(cases: Cases) -> Statistic:
    """Nothing wrong: the verdict is another one than ``no-gap`` or ``parameters``."""
    return share(case.wrong for case in cases if case.kind == NOTHING)


def abstained(cases: Cases) -> Statistic:
    """One or two causes, separated or not: the verdict is ``outside-catalogue``."""
    return share(case.said.verdict in UNCLAIMED for case in cases if case.kind != NOTHING)


def seconds_per_case(cases: Cases) -> Statistic:
    """Time of a diagnosis by one process, files read included."""
    return mean(case.said.seconds for case in cases)


FIGURES: tuple[Callable[[Cases], Statistic], ...] = (
    separated,
    first_place,
    false_second,
    false_beside_true,
    both_named,
    false_of_two,
    play_named,
    play_first,
    suspected,
    abstained,
    seconds_per_case,
)
BARS: dict[str, Bar] = {
    "first_place": (AT_LEAST, 0.9),
    "false_second": (AT_MOST, 0.05),
    "both_named": (AT_LEAST, 0.8),
    "play_named": (AT_LEAST, 0.7),
    "suspected": (AT_MOST, 0.03),
}


def report(title: str, cases: Cases) -> Report:
    """Return the figures, what each cause was taken for, and every rig that went wrong."""
    figures = tuple(figure_rows(FIGURES, BARS, cases, wanted=1))
    return Report(
        title,
        f"{len(cases)} rigs",
        sections=(
            Section("Figures", tables=(Table("", COLUMNS, figures),)),
            Section("Play", tables=(_play(cases),)),
            Section("What causes were taken for", tables=(_taken_for(cases),)),
            Section("Rigs that went wrong", tables=(_wrong(cases),)),
        ),
    )


def _play(cases: Cases) -> Table:
    """By the inertia behind it."""
    rows = tuple(
        (f"{behind:.2f}", figure.n, quantity(figure))
        for behind, figure in play_by_share(cases).items()
    )
    return Table("", ("inertia behind the play", "rigs", "play named (95 %)"), rows)


def _taken_for(cases: Cases) -> Table:
    """By kind of rig, separated ones apart: answers, the most frequent first."""
    found: dict[tuple[str, str, str], Counter[str]] = {}
    for case in cases:
        told = " + ".join(case.causes) or NOTHING
        seen = "yes" if case.observed.separated else "no"
        key = (told, str(case.answer["engine"]), seen)
        found.setdefault(key, Counter())[_answer(case.said)] += 1
    rows = tuple(
        (*key, sum(answers.values()), "; ".join(f"{it} {n}" for it, n in answers.most_common()))
        for key, answers in sorted(found.items())
    )
    return Table("", ("cause", "engine", "separated", "rigs", "taken for"), rows)


def _answer(said: Diagnosed) -> str:
    names = " + ".join(sorted(said.named))
    if said.verdict == OUTSIDE:
        return f"outside ({names})" if names else "outside"
    return names or said.verdict


def _wrong(cases: Cases) -> Table:
    """Errors are held out, in noise floors: of what was told, of the truth fitted by the product
    from the true values, and of its best rival.  Left out is what nobody could have told: a
    cause that is not separated, beside which no effect is claimed that is not there."""
    rows = tuple(
        (
            case.said.case,
            " + ".join(case.causes) or NOTHING,
            _answer(case.said),
            case.said.after,
            case.observed.truth,
            f"{' + '.join(case.observed.rival_effects) or PARAMETERS} {case.observed.rival:.3g}",
            "yes" if case.observed.separated else "no",
            ", ".join((*case.observed.beyond, *case.observed.told_bounds)),
        )
        for case in cases
        if case.wrong
    )
    columns = ("rig", "cause", "told", "told", "truth", "best rival", "separated", "bounds")
    return Table("", columns, rows)
