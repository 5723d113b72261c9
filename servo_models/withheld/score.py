"""The figures of a withheld check: every one is a function whose docstring defines it.

Cases are those of one tier.  *Separated* and *absorbed* are defined in ``oracle``; a failed
diagnosis counts as wrong wherever its case is counted (it closes nothing that could be compared).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from msgspec import Meta

from servo_models.diagnosis.settings import DEFAULT
from servo_models.diagnosis.verdict import NO_GAP, NOT_IDENTIFIABLE, OUTSIDE, PARAMETERS
from servo_models.report.document import Document, Figure
from servo_models.withheld.oracle import FAILED, Diagnosed, Known

NOTHING = "nothing"
BINS = (0.0, 0.05, 0.5, 0.7, 0.9, 0.99, 1.0)
"""Edges between which probabilities are compared with what happened."""
ERROR_BINS = 10  # of equal width, over which the calibration error is taken
SURE, ALMOST_CERTAIN = 0.9, 0.99
"""Probabilities between which an effect is told as sure."""
LEAST_CHANCE = 0.001  # of being wrong, which the log loss grants every probability
CONFIDENCE = 0.95
DRAWS, SEED = 2000, 0
"""Of the bootstrap of a mean."""


class Statistic(Document, frozen=True):
    """A share with its Wilson interval, or a mean with its bootstrap interval, at 95 %, and the
    number of cases behind it; None for no cases."""

    value: Figure
    low: Figure
    high: Figure
    n: Annotated[int, Meta(ge=0)]


NONE = Statistic(None, None, None, 0)


def share(flags: Iterable[bool]) -> Statistic:
    """Return the share that is true, with its Wilson interval.

    Source: E. B. Wilson, J. American Statistical Association 22 (1927) 209.
    """
    from scipy.stats import binomtest

    found = list(flags)
    if not found:
        return NONE
    test = binomtest(sum(found), len(found))
    interval = test.proportion_ci(CONFIDENCE, method="wilson")
    return Statistic(float(test.statistic), float(interval.low), float(interval.high), len(found))


def mean(values: Iterable[float]) -> Statistic:
    """Return the mean, with its bootstrap interval (percentiles).

    Source: Efron, Tibshirani, An Introduction to the Bootstrap (1993), ch. 13.
    """
    found = np.array(list(values), dtype=float)
    if not len(found):
        return NONE
    drawn = np.random.default_rng(SEED).choice(found, (DRAWS, len(found))).mean(axis=1)
    low, high = np.quantile(drawn, [0.5 - CONFIDENCE / 2.0, 0.5 + CONFIDENCE / 2.0])
    return Statistic(float(found.mean()), float(low), float(high), len(found))


@dataclass(frozen=True)
class Case:
    """A case with its answer: what was said, and what could have been said.

    Attributes:
        tier, actuator, kind: of the answer; kinds are nothing, one, two and foreign.
        truth: effects to be named.
        hidden: effects that may be named beside them.
        said: by the diagnosis.
        known: by the oracle; None where nothing is wrong with the rig.
    """

    tier: str
    actuator: str
    kind: str
    truth: frozenset[str]
    hidden: frozenset[str]
    said: Diagnosed
    known: Known | None

    @property
    def separated(self) -> bool:
        return self.known is not None and self.known.separated

    @property
    def first(self) -> str:
        """The most probable effect, "" where none is named."""
        return next(iter(self.said.chances), "") if self.said.named else ""

    @property
    def right(self) -> bool:
        """All effects of the truth are named, and none that is not there."""
        named = frozenset(self.said.named)
        return self.truth <= named <= self.truth | self.hidden

    @property
    def covered(self) -> bool:
        """The set holds the truth; where parameters imitate it, a set that holds the hidden
        effect, or none, is right as well."""
        members = frozenset(self.said.members)
        imitated = self.known is not None and self.known.absorbed
        if imitated and (not members or members & self.hidden):
            return self.held or self.said.verdict not in (OUTSIDE, FAILED)
        return self.held

    @property
    def held(self) -> bool:
        """The set holds the truth."""
        return self.truth <= frozenset(self.said.members)


Cases = Sequence[Case]


def join(
    answers: Iterable[dict[str, Any]], said: dict[str, Diagnosed], known: dict[str, Known]
) -> Cases:
    """Return the cases in the order of their answers."""
    return [
        Case(
            tier=answer["tier"],
            actuator=answer["actuator"],
            kind=answer["kind"],
            truth=frozenset(it["name"] for it in answer["effects"]),
            hidden=frozenset(it["name"] for it in answer["hidden"]),
            said=said[answer["case"]],
            known=known.get(answer["case"]),
        )
        for answer in answers
    ]


def separated(cases: Cases) -> Statistic:
    """Something wrong: the noise-free log separates the truth from its best rival."""
    return share(case.separated for case in cases if case.kind != NOTHING)


def first_place(cases: Cases) -> Statistic:
    """One effect, separated: the most probable effect is it.  Whatever the verdict says
    beside it."""
    alone = (case for case in cases if case.kind == "one" and case.separated)
    return share(case.first in case.truth for case in alone)


def only_true_ones(cases: Cases) -> Statistic:
    """One effect, separated: the explanation at first place names it, and no effect that is
    not there."""
    return share(case.right for case in cases if case.kind == "one" and case.separated)


def set_holds(cases: Cases) -> Statistic:
    """One effect, separated or not: the set that cannot be told apart holds it."""
    return share(case.held for case in cases if case.kind == "one")


def set_coverage(cases: Cases) -> Statistic:
    """The same, and right as well where the effect is absorbed by nominal parameters and the set
    holds the hidden effect, or there is none."""
    return share(case.covered for case in cases if case.kind == "one")


def mean_set_size(cases: Cases) -> Statistic:
    """One effect: number of effects in the set, the hidden one not counted, since it is there;
    mean over the cases in which the set has another one."""
    sizes = [len(frozenset(it.said.members) - it.hidden) for it in cases if it.kind == "one"]
    return mean(size for size in sizes if size)


def both_named(cases: Cases) -> Statistic:
    """Two effects, separated: the explanation at first place names both and no other."""
    return share(case.right for case in cases if case.kind == "two" and case.separated)


def false_causes(cases: Cases) -> Statistic:
    """Nothing wrong: the verdict is another one than ``no-gap`` or ``parameters``."""
    found = [case.said.verdict for case in cases if case.kind == NOTHING]
    return share(verdict not in (NO_GAP, PARAMETERS) for verdict in found)


def good(case: Case) -> bool:
    """Return whether the answer to a case is the truth."""
    if case.kind == NOTHING:
        return not false_causes([case]).value
    outside = case.said.verdict == OUTSIDE
    return outside if case.kind == "foreign" else case.right and not outside


def foreign_recall(cases: Cases) -> Statistic:
    """A cause outside the catalogue, separated: the verdict is ``outside-catalogue``."""
    return share(
        case.said.verdict == OUTSIDE for case in cases if case.kind == "foreign" and case.separated
    )


def left_out_recall(cases: Cases) -> Statistic:
    """One effect, separated, and left out of the catalogue: ``outside-catalogue``."""
    return share(
        case.known.without == OUTSIDE for case in cases if case.known and case.known.without
    )


def wrong_abstention(cases: Cases) -> Statistic:
    """One or two effects, separated or not: the verdict is ``outside-catalogue``."""
    return share(
        case.said.verdict in (OUTSIDE, FAILED) for case in cases if case.kind in ("one", "two")
    )


def not_identifiable(cases: Cases) -> Statistic:
    """One effect, separated or not: the verdict is ``not-identifiable``."""
    return share(
        case.said.verdict in (NOT_IDENTIFIABLE, FAILED) for case in cases if case.kind == "one"
    )


def owns_up(cases: Cases) -> Statistic:
    """One effect that is not in a set of at most 3: ``not-identifiable``."""
    lost = (
        case
        for case in cases
        if case.kind == "one" and not (case.held and len(case.said.members) <= DEFAULT.few_models)
    )
    return share(case.said.verdict == NOT_IDENTIFIABLE for case in lost)


def imitated_told(cases: Cases) -> Statistic:
    """One effect, absorbed, and the verdict is ``parameters``: it is among those that they are
    said to imitate."""
    return share(
        bool(case.truth & set(case.said.imitated))
        for case in cases
        if case.kind == "one"
        and case.known
        and case.known.absorbed
        and case.said.verdict == PARAMETERS
        and case.said.imitated is not None
    )


def imitated_listed(cases: Cases) -> Statistic:
    """The verdict is ``parameters``: how many effects they are said to imitate, mean.  It tells
    what the log cannot show, whether something is wrong or not."""
    said = (case.said for case in cases if case.said.verdict == PARAMETERS)
    return mean(len(it.imitated) for it in said if it.imitated is not None)


def closed_vs_oracle(cases: Cases) -> Statistic:
    """One or two effects: gap closed over that of the product's own fit when told the names,
    (before - after) / (before - after when told), held out, at most 1 and at least 0 each, and 1
    where it named no others; cases in which being told the names closes something."""
    ratios = []
    for case in cases:
        if case.known and case.known.after is not None and case.said.before > case.known.after:
            closed = case.said.before - case.said.after
            ratios.append(min(max(closed / (case.said.before - case.known.after), 0.0), 1.0))
    return mean(ratios)


def quantisation_found(cases: Cases) -> Statistic:
    """One effect, separated, that is a quantisation: as ``first_place``."""
    alone = (case for case in cases if case.kind == "one" and case.separated)
    return share(case.first in case.truth for case in alone if "quantisation" in min(case.truth))


def seconds_per_case(cases: Cases) -> Statistic:
    """Time of a diagnosis by one process, files read included."""
    return mean(case.said.seconds for case in cases)


def _told(case: Case) -> list[tuple[float, bool]]:
    """The probability of each effect of a case, and whether it is there; none where no effect of
    the catalogue is."""
    if case.kind not in ("one", "two"):
        return []
    there = case.truth | case.hidden
    return [(chance, name in there) for name, chance in case.said.probabilities.items()]


def calibration_error(cases: Cases) -> Statistic:
    """One or two effects: mean distance between the probability told of an effect and how often
    it is there, over ten equal bins of the probability, each counted by its effects (expected
    calibration error).  Chance alone makes it more than 0, the more so the fewer the cases.

    Source: Guo et al., Proc. ICML 34 (2017) 1321, eq. 3.
    """
    told = [own for case in cases if (own := _told(case))]
    if not told:
        return NONE
    surplus, counts = np.zeros((len(told), ERROR_BINS)), np.zeros(len(told))
    for k, own in enumerate(told):
        counts[k] = len(own)
        for chance, there in own:
            surplus[k, min(int(chance * ERROR_BINS), ERROR_BINS - 1)] += chance - there
    random = np.random.default_rng(SEED)
    drawn = random.multinomial(len(told), np.full(len(told), 1.0 / len(told)), DRAWS)
    errors = np.abs(drawn @ surplus).sum(axis=1) / (drawn @ counts)
    error = float(np.abs(surplus.sum(axis=0)).sum() / counts.sum())
    low, high = np.quantile(errors, [0.5 - CONFIDENCE / 2.0, 0.5 + CONFIDENCE / 2.0])
    return Statistic(error, min(float(low), error), max(float(high), error), len(told))


def sure_ones_right(cases: Cases) -> Statistic:
    """One or two effects: those told with a probability of 0.9 to 0.99 are there."""
    told = [one for case in cases for one in _told(case)]
    return share(there for chance, there in told if SURE <= chance <= ALMOST_CERTAIN)


def log_loss(cases: Cases) -> Statistic:
    """One or two effects: mean over effects of minus the logarithm of the probability told of
    what is so, at least 0.001."""
    told = [one for case in cases for one in _told(case)]
    return mean(-math.log(max(p if there else 1.0 - p, LEAST_CHANCE)) for p, there in told)


def told_surely(cases: Cases) -> Statistic:
    """One or two effects, hidden ones counted: effects that are there and told with a probability
    of 0.9 or more, of all that are there."""
    asked = [case for case in cases if case.kind in ("one", "two")]
    return share(
        case.said.probabilities.get(name, 0.0) >= SURE
        for case in asked
        for name in case.truth | case.hidden
    )


FIGURES: tuple[Callable[[Cases], Statistic], ...] = (
    separated,
    first_place,
    only_true_ones,
    set_holds,
    set_coverage,
    mean_set_size,
    both_named,
    false_causes,
    foreign_recall,
    left_out_recall,
    wrong_abstention,
    not_identifiable,
    owns_up,
    imitated_told,
    imitated_listed,
    closed_vs_oracle,
    quantisation_found,
    calibration_error,
    sure_ones_right,
    log_loss,
    told_surely,
    seconds_per_case,
)


class Bin(Document, frozen=True):
    """How often effects that are given a probability from ``low`` to ``high``, its mean beside, are
    there: all that were fitted, in cases with one or two effects."""

    low: float
    high: float
    probability: float
    right: Statistic


def calibration(cases: Cases) -> list[Bin]:
    """Return how often an effect is there, against the probability that it is given.

    All effects that were given one, in cases with an effect of the catalogue: those of the
    explanations by as many effects as were taken.  Those of one case hang together, so intervals
    are a little too narrow.  Bins hold their lower end.
    """
    found = [one for case in cases for one in _told(case)]
    bins = []
    for low, high in pairwise(BINS):
        inside = [it for it in found if low <= it[0] < high or it[0] == high == BINS[-1]]
        if inside:
            middle = sum(chance for chance, _ in inside) / len(inside)
            bins.append(Bin(low, high, middle, share(right for _, right in inside)))
    return bins


def confusion(cases: Cases) -> dict[str, dict[str, int]]:
    """Return how often a truth was met with an answer, ``{truth: {answer: cases}}``.

    Effects are joined by " + ".  The answer is the verdict where that is ``outside-catalogue``
    or where no effect is named.
    """
    found: dict[str, Counter[str]] = {}
    for case in cases:
        truth = " + ".join(sorted(case.truth)) or NOTHING
        found.setdefault(truth, Counter())[_answer(case.said)] += 1
    return {truth: dict(answers.most_common()) for truth, answers in sorted(found.items())}


def _answer(said: Diagnosed) -> str:
    return (
        said.verdict if said.verdict == OUTSIDE else " + ".join(sorted(said.named)) or said.verdict
    )
