"""Screen every effect without fitting any: a score test in the large.

Each effect is simulated at a few trial values.  What is left of the gap is regressed on the change
that it makes and on the slopes of the nominal parameters, held by their priors and inside their
bounds, so screening gives the start of a fit as well.  Where a response jumps with a parameter,
other parameters have made up for the cause, and the true value looks like any other until they are
corrected.
Source: Rao, Proc. Cambridge Phil. Soc. 44 (1948) (score test); trial values replace its derivative,
since many effects have none at 0.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from itertools import chain
from math import atan2, hypot, pi

import numpy as np

from servo_models.core.types import Array
from servo_models.diagnosis.search.candidates import Candidate, Values
from servo_models.diagnosis.search.fitting import FittedModel, delays_of
from servo_models.errors import UserError
from servo_models.identification.linear_inference import Linearisation, solve_box_qp, value_at

CORRECTIONS = 2  # corrections of other parameters before a discontinuous one is judged
NEIGHBOUR_RATIO = 1.05  # ratio of two values below which one correction serves both
LARGEST_GROUP = 32  # neighbouring values that are simulated one after another
DELAY_LESS_IN_PERIODS = (0.25, 0.5, 0.75)  # fractions of the hold period taken off the delay
LARGEST_SHARE = 1.6  # most of a simulated change that an effect may make: trial values are a grid
LARGEST_RIPPLE_SHARE = 10.0  # factor for a ripple, which is tried at one amplitude
LEAST_SHARE = 0.5  # least factor for a limit: a small part of what a tight one does is done by none
VALUES_BESIDE = 6  # trial values of an effect in screening beside others and nominal parameters
VALUES_SIMULATED = 5  # values of an effect simulated before its fit
NEAR_RELATIVE_CHANGES = tuple(k * 4e-4 for k in range(-6, 7))  # changes sought about a fitted value


@dataclass(frozen=True, eq=False)
class Screened:
    """An effect at one size.

    Attributes:
        linearised: fit beside which it was screened.
        candidate: the effect.
        settings: its parameters [SI].
        share: factor on the change by which it explains most; 1 where it cannot be shared.
        change: change of the weighted errors by it [noise floors], shape (m + priors,).
        difference: that change without what nominal parameters can imitate.
        left: squared errors that remain.
        waves: changes by the sine and the cosine of a ripple, shape (m + priors, 2).
    """

    linearised: Linearisation
    candidate: Candidate
    settings: dict[str, float]
    share: float
    change: Array
    difference: Array
    left: float
    waves: Array | None = None

    @property
    def columns(self) -> Array:
        """Changes that take part with a share of their own each, shape (m + priors, 1 or 2)."""
        return self.change[:, None] if self.waves is None else self.waves

    @property
    def whole(self) -> Array:
        """The share of the change that explains most, shape (m + priors,)."""
        return self.share * self.change

    def at(self, scale: float) -> dict[str, float]:
        """Return the settings with so many times the effect, its size inside its bounds."""
        scale = 1.0 / scale if self.candidate.hints.inverse else scale
        settings = dict(self.settings)
        for free in self.candidate.free:
            if free.name in self.candidate.switches and free.name in settings:
                settings[free.name] = min(max(scale * settings[free.name], free.low), free.high)
        return settings


def screen(
    fits: Sequence[Linearisation], every: Sequence[Candidate], corrected: bool = True
) -> list[Screened]:
    """Return each effect at each size beside each fit, best first, without those that do nothing.

    Other parameters are ``corrected`` before a discontinuous effect is judged: a wrong value leaves
    as little while they are still where they made up for it.
    """
    return moving(screening_results(fits, every, corrected))


def moving(results: Iterable[Screened]) -> list[Screened]:
    """Return those that move the outputs beyond what parameters can imitate, best first."""
    return sorted((it for it in results if it.difference.any()), key=lambda it: it.left)


def screening_results(
    fits: Sequence[Linearisation], every: Sequence[Candidate], corrected: bool = True
) -> list[Screened]:
    """Return each effect at each size beside each fit, whatever it does."""
    results: list[Screened] = []
    for linear in fits:
        base = linear.problem.values(linear.vector)
        tasks = [(candidate, sizes) for candidate in every for sizes in neighbours(candidate)]
        simulate = partial(corrected_changes if corrected else changes, linear, base)
        simulated = list(chain.from_iterable(linear.problem.workers.map(simulate, tasks)))
        tried = [(candidate, size) for candidate, sizes in tasks for size in sizes]
        left, share = best_scales(linear, [candidate for candidate, _ in tried], simulated)
        results += [
            _screened(linear, candidate, settings, columns, shares, float(rest))
            for (candidate, settings), columns, rest, shares in zip(tried, simulated, left, share)
        ]
    return results


def survey(
    retuned: Linearisation, others: Iterable[Linearisation], every: Sequence[Candidate]
) -> list[Screened]:
    """Return each effect at each size beside re-tuned parameters, and beside others, such as the
    nominal ones, at the sizes that would leave least there if changes were the same."""
    results = screening_results((retuned,), every)
    by_left = sorted(results, key=lambda it: it.left)
    known = [_at_best(one, by_left) for one in preselect(every, by_left)]
    for linear in others:
        likely = [_at_likely_sizes(linear, it) for it in known]
        results += screening_results((linear,), likely)
    return results


def _at_best(candidate: Candidate, results: Iterable[Screened]) -> Candidate:
    """A discontinuous effect with the values that leave least: what it changes at one of them is
    not that of another."""
    if not candidate.discontinuous:
        return candidate
    sizes = [it.settings for it in results if it.candidate.name == candidate.name]
    return replace(candidate, trial_values=tuple(sizes[:VALUES_BESIDE]))


def best_scales(
    linear: Linearisation, every: Sequence[Candidate], changes: Sequence[Array]
) -> tuple[Array, Array]:
    """Return what effects leave that change errors so, shape (k,), and at which share of it.

    Args:
        linear: fit whose parameters follow inside their bounds.
        every: effect of each change.
        changes: of shape (m + priors, 1), or of a sine and a cosine, which have a share each.
            Shares have shape (k, 2), the second unused where there is one.
    """
    p, (down, up) = linear.slopes.shape[1], linear.room
    gram, towards = np.zeros((len(every), p + 2, p + 2)), np.zeros((len(every), p + 2))
    low, high = np.zeros_like(towards), np.zeros_like(towards)
    gram[:, :p, :p], towards[:, :p] = linear.gram, linear.slopes.T @ linear.errors
    low[:, :p], high[:, :p] = down, up
    for k, (candidate, columns) in enumerate(zip(every, changes)):
        effect = slice(p, p + columns.shape[1])
        gram[k, :p, effect] = linear.slopes.T @ columns
        gram[k, effect, :p] = gram[k, :p, effect].T
        gram[k, effect, effect] = columns.T @ columns
        towards[k, effect] = columns.T @ linear.errors
        low[k, effect], high[k, effect] = scales(candidate)
    left, steps = remains(linear, gram, towards, low, high)
    return left, steps[:, p:]


def scales(candidate: Candidate) -> tuple[float, float]:
    """Between which shares of a change the best is sought."""
    if candidate.ripple:
        return -LARGEST_RIPPLE_SHARE, LARGEST_RIPPLE_SHARE
    if candidate.hints.inverse:
        return LEAST_SHARE, LARGEST_SHARE
    return (1.0, 1.0) if candidate.discontinuous else (0.0, LARGEST_SHARE)


def _screened(
    linear: Linearisation,
    candidate: Candidate,
    settings: Values,
    columns: Array,
    share: Array,
    left: float,
) -> Screened:
    if not candidate.ripple:
        change, first = columns[:, 0], float(share[0])
        return Screened(linear, candidate, settings, first, change, linear.without(change), left)
    at_once = {**settings, candidate.ripple[1]: 0.0}
    plain = Screened(linear, candidate, at_once, 1.0, columns[:, 0], columns[:, 0], left, columns)
    return turned(plain, share, left)


def turned(ripple: Screened, share: Array, left: float) -> Screened:
    """Return a ripple with these shares of its sine and its cosine, shape (2,)."""
    assert ripple.candidate.ripple
    assert ripple.waves is not None
    switch, phase = ripple.candidate.ripple
    size = ripple.candidate.trial_values[0][switch] * min(hypot(*share), LARGEST_RIPPLE_SHARE)
    shown = {**ripple.settings, switch: size, phase: atan2(share[1], share[0])}
    change = ripple.waves @ share
    without = ripple.linearised.without(change)
    return replace(ripple, settings=shown, change=change, difference=without, left=left)


def remains(
    linear: Linearisation, gram: Array, towards: Array, low: Array, high: Array
) -> tuple[Array, Array]:
    """Return the squared errors that are left at the best steps inside a box, and these steps."""
    best = solve_box_qp(gram, towards, low, high)
    return float(linear.errors @ linear.errors) + value_at(gram, towards, best), best


def neighbours(candidate: Candidate) -> list[list[Values]]:
    """Sizes of an effect that are simulated one after another: those of a discontinuous
    effect that are near each other, since one tells where the other parameters are at the next."""
    if not candidate.discontinuous:
        return [[size] for size in candidate.trial_values]
    groups: list[list[Values]] = []
    for size in sorted(candidate.trial_values, key=lambda it: max(it.values())):
        last = groups[-1][-1] if groups and len(groups[-1]) < LARGEST_GROUP else None
        if last and max(size.values()) < NEIGHBOUR_RATIO * max(last.values()):
            groups[-1].append(size)
        else:
            groups.append([size])
    return groups


def changes(
    linear: Linearisation, base: Values, task: tuple[Candidate, Sequence[Values]]
) -> list[Array]:
    """Changes of the weighted errors by an effect at sizes, each of shape (m + priors, 1 or 2)."""
    candidate, sizes = task
    if candidate.late and _delay(linear):
        return _held(linear, base, sizes, (0.5,))
    return [_simulated(linear, base, candidate, size) for size in sizes]


def corrected_changes(
    linear: Linearisation, base: Values, task: tuple[Candidate, Sequence[Values]]
) -> list[Array]:
    """The same, other parameters corrected beside a discontinuous effect."""
    candidate, sizes = task
    if not candidate.discontinuous:
        return changes(linear, base, task)
    if candidate.late and _delay(linear):
        return _held(linear, base, sizes, DELAY_LESS_IN_PERIODS)
    whole = _difference(linear, {**base, **sizes[0]})
    if not whole.any():  # mostly since it reaches no measured output
        return [whole[:, None]] * len(sizes)
    for _ in range(CORRECTIONS - 1):
        whole = _corrected(linear, sizes[0], whole)
    columns = []
    for size in sizes:
        whole = _corrected(linear, size, whole)
        if _left(linear, whole) > linear.left:  # slopes may have led astray
            whole = min(whole, _difference(linear, {**base, **size}), key=partial(_left, linear))
        columns.append(whole[:, None])
    return columns


def _simulated(linear: Linearisation, base: Values, candidate: Candidate, size: Values) -> Array:
    """The change by an effect; of a ripple, those by its sine and by its cosine."""
    probes = [size]
    if candidate.ripple:
        probes = [{**size, candidate.ripple[1]: phase} for phase in (0.0, pi / 2.0)]
    return np.column_stack([_difference(linear, {**base, **probe}) for probe in probes])


def _corrected(linear: Linearisation, size: Values, whole: Array) -> Array:
    """A change by an effect once more, from where it would take the other parameters."""
    return _change(linear, linear.start(whole), size)


def _held(
    linear: Linearisation, base: Values, sizes: Sequence[Values], parts: Sequence[float]
) -> list[Array]:
    """Changes by a hold, with the delay less by the part of its period that leaves least.

    A hold is late by half its period on average, and by how much at an edge of the command no
    slope tells: the clock may tick just after it.
    """
    delay = _delay(linear)
    least = next(free.low for free in linear.problem.free if free.name == delay)
    columns = []
    for size in sizes:
        (period,) = size.values()
        sooner = dict.fromkeys(max(base[delay] - part * period, least) for part in parts)
        tried = [_change(linear, {**base, delay: time}, size) for time in sooner]
        best = tried[0] if len(tried) == 1 else min(tried, key=partial(_left, linear))
        columns.append(best[:, None])
    return columns


def _left(linear: Linearisation, change: Array) -> float:
    """Squared errors beside a change, without what parameters imitate."""
    return float(np.sum(linear.without(linear.errors + change) ** 2))


def _delay(linear: Linearisation) -> str:
    """The free delay of a problem, empty where there is none."""
    delays = delays_of(linear.problem)
    return linear.problem.free[delays[0]].name if delays else ""


def _change(linear: Linearisation, values: Values, size: Values) -> Array:
    """A change by an effect with other parameters at ``values``, less what their slopes do."""
    change = _difference(linear, {**values, **size})
    if not change.any():  # also where nothing can be simulated: slopes would make a change of it
        return change
    vector = np.array(list(values.values())) / linear.problem.scales
    change -= linear.slopes @ (vector - linear.vector)
    change[linear.problem.samples :] = 0.0
    return change


def _difference(linear: Linearisation, values: dict[str, float]) -> Array:
    """Change of the weighted errors, none where nothing can be simulated; the priors do not
    change."""
    problem = linear.problem
    try:
        changed = problem.errors_with(values, strict=True)
    except UserError:
        return np.zeros(len(linear.errors))
    changed -= linear.errors
    changed[problem.samples :] = 0.0
    return changed


def residual_beside(results: Sequence[Screened], others: Sequence[Screened]) -> Array:
    """Return the squared errors that each of some results leaves beside the best of the others.

    All are from the same linearisation.  Shape (results,).
    """
    linear = results[0].linearised
    rest = linear.without(np.column_stack([linear.errors + it.change for it in results]))
    columns = np.column_stack([it.difference for it in others])
    low, high = np.array([scales(it.candidate) for it in others]).T[..., None]
    power, along = np.sum(columns**2, axis=0)[:, None], columns.T @ rest
    share: Array = np.clip(-along / power, low, high)
    return np.asarray(
        np.sum(rest**2, axis=0) + np.min(share * (2.0 * along + share * power), axis=0)
    )


@dataclass(frozen=True)
class Detectability:
    """How far an effect moves the outputs at the values screened, RMS in noise floors.

    Attributes:
        moved: largest movement.
        shown: largest movement without what nominal parameters imitate.
    """

    moved: float = 0.0
    shown: float = 0.0


def detectability(
    results: Iterable[Screened], every: Sequence[Candidate]
) -> dict[str, Detectability]:
    """Return the reach of each effect by its name, from all results."""
    largest = {one.name: Detectability() for one in every}
    for result in results:
        moved, shown = result.change[:, None], result.difference[:, None]
        if result.waves is not None:  # the phase counts that does more
            moved = LARGEST_RIPPLE_SHARE * result.waves
            shown = result.linearised.without(moved)
        name, samples = result.candidate.name, max(result.linearised.problem.samples, 1)
        reach = (float(np.sqrt((it**2).sum(axis=0).max() / samples)) for it in (moved, shown))
        largest[name] = Detectability(*map(max, astuple(largest[name]), reach))
    return largest


Promising = tuple[str, list[Screened]]  # an effect, and its results that promise most


def starts_of(results: Iterable[Screened]) -> Iterator[Promising]:
    """The effects of the first results, each with those from which its fit begins."""
    by_name: dict[str, list[Screened]] = {}
    for result in results:
        by_name.setdefault(result.candidate.name, []).append(result)
    yield from ((name, likeliest(sizes)) for name, sizes in by_name.items())


def likeliest(results: Sequence[Screened]) -> list[Screened]:
    """Of the sizes of one effect, best first, those that are worth a simulation.

    A fit finds the size, but hardly another shape: of each shape the best size is one of them.
    """
    best: dict[Hashable, Screened] = {}
    for result in results:
        best.setdefault(result.candidate.shape_at(result.settings), result)
    first = list(best.values())
    return [*first, *(it for it in results if it not in first)][:VALUES_SIMULATED]


def _at_likely_sizes(
    linear: Linearisation, candidate: Candidate, most: float = np.inf
) -> Candidate:
    """An effect at the sizes that would leave least from there, and less than ``most``, if changes
    add up.

    A size that does nothing alone, as a wide limit, says nothing of what it does there.
    """
    if not candidate.alone or (len(candidate.alone) <= VALUES_BESIDE and most == np.inf):
        return candidate
    left, _ = best_scales(linear, [candidate] * len(candidate.alone), candidate.alone)
    left = np.where([change.any() for change in candidate.alone], left, np.inf)
    best = np.argsort(left, kind="stable")[:VALUES_BESIDE]
    sizes = tuple(candidate.trial_values[i] for i in sorted(best) if left[i] <= most)
    return replace(candidate, trial_values=sizes, alone=())


def preselect(every: Iterable[Candidate], results: Sequence[Screened]) -> list[Candidate]:
    """Return effects with what ``results``, best first, have shown of their sizes alone.

    Of the thousands of values of a discontinuous effect those stay that were promising once.
    Others keep all: alone, each takes the size that imitates what is missing as well.
    """
    chosen = []
    for candidate in every:
        tried = [result for result in results if result.candidate.name == candidate.name]
        first = {_place(candidate, it.settings): it for it in reversed(tried)}
        if candidate.grid and tried:
            sizes = {_place(candidate, it.settings): it.settings for it in tried}
            chosen.append(replace(candidate, trial_values=tuple(sizes.values())[:VALUES_BESIDE]))
        elif candidate.discontinuous or not tried:
            chosen.append(candidate)
        else:
            none = np.zeros_like(tried[0].columns)
            known = (first.get(_place(candidate, size)) for size in candidate.trial_values)
            alone = tuple(it.columns if it else none for it in known)
            chosen.append(replace(candidate, alone=alone))
    return chosen


def _place(candidate: Candidate, settings: Values) -> Hashable:
    """Which of its sizes some settings are: of a ripple they come with another size and phase."""
    return tuple(it for it in settings.items() if it[0] not in (candidate.ripple or ()))


class Screener:
    """Screens effects beside fitted models, at the trial values that promised something alone.

    As far as changes add up, those tell what a value would leave beside other effects, and only the
    likeliest are simulated there, each once.  Of smooth effects the results are kept from which a
    fit may begin: every one holds a response.
    """

    def __init__(
        self,
        every: Iterable[Candidate],
        results: Sequence[Screened],
        before: Screener | None = None,
    ) -> None:
        self.candidates = {one.name: one for one in preselect(every, results)}
        self._known: dict[Hashable, list[Screened]] = before._known if before else {}

    def beside(self, first: FittedModel, pool: Iterable[Candidate]) -> list[Screened]:
        """Return the results of effects beside those of a model, best first."""
        keys: dict[Hashable, Candidate] = {}
        for one in (self.candidates[it.name] for it in pool if it.name not in first.effects):
            sizes = tuple(tuple(size.items()) for size in one.trial_values)
            keys[first, one.name, sizes] = one
        new = {key: one for key, one in keys.items() if key not in self._known}
        screened = _screened_beside(first, new.values())
        for key, one in new.items():
            found = [result for result in screened if result.candidate.name == one.name]
            self._known[key] = found if one.discontinuous else likeliest(found)
        known = chain.from_iterable(self._known[key] for key in keys)
        return sorted(known, key=lambda result: result.left)

    def again_beside(self, stays: FittedModel, model: FittedModel, enough: float) -> list[Screened]:
        """Return the same of all effects beside a model of which one effect was taken out.

        Sizes that would leave far more than ``enough`` squared errors if changes add up are not
        simulated: in decibels, more than half of what is between it and nothing explained.
        """
        every = self.candidates.values()
        others = [_nearer(one, model) for one in every if one.name not in stays.effects]
        return _screened_beside(stays, others, (enough * stays.cost) ** 0.5)


def _screened_beside(
    first: FittedModel, others: Iterable[Candidate], most: float = np.inf
) -> list[Screened]:
    linear = first.linearised
    return screen((linear,), [_at_likely_sizes(linear, it, most=most) for it in others])


def _nearer(candidate: Candidate, model: FittedModel) -> Candidate:
    """A discontinuous effect with values very near that of a model which has it: beside another
    effect the narrow minimum may lie next to where it was alone."""
    if not candidate.discontinuous or candidate.name not in model.effects:
        return candidate
    switch = candidate.free[0].name
    near = [{switch: model.values[switch] * (1.0 + it)} for it in NEAR_RELATIVE_CHANGES]
    return replace(candidate, trial_values=(*candidate.trial_values, *near))
