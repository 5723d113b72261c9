"""Which effects explain a gap: stepwise selection over fitted models of any size.

One more effect is fitted beside the best two models, others are fitted in the place of each effect
of the best one, and each has to earn its place against the model without it.  An effect earns its
place where it predicts blocks of time that are held out of its fit and, from two effects on,
conditions that were left out as well.
Sources: Hastie, Tibshirani, Friedman, The Elements of Statistical Learning, 2nd ed., sec. 3.3
(forward and backward selection); Miller, Subset Selection in Regression, 2nd ed. (2002), sec. 3.5
(replacing one variable at a time).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import inf, log

import numpy as np

from servo_models.core.stop import AT_FIRST_ANSWER, Stop, Tell, silent
from servo_models.data.audit import LEAST_GAP
from servo_models.diagnosis.search.candidates import Candidate, candidates
from servo_models.diagnosis.search.crossval import CrossValidation, advantage, consistency
from servo_models.diagnosis.search.fitting import (
    WIDER,
    FittedModel,
    Fitter,
    conditions,
    leave_one_condition_out,
)
from servo_models.diagnosis.search.grid_search import shortlist
from servo_models.diagnosis.search.harmonics import with_sines
from servo_models.diagnosis.search.joint_fits import fit_with
from servo_models.diagnosis.search.limit_cycle import lacks
from servo_models.diagnosis.search.masking import MaskedEffect, masked_effects
from servo_models.diagnosis.search.residuals import sure
from servo_models.diagnosis.search.screening import (
    Detectability,
    Promising,
    Screened,
    Screener,
    detectability,
    moving,
    screen,
    starts_of,
    survey,
)

FIRST_ALONE = 4  # effects fitted first, before it is asked whether the others could do as well
SAME_COSINE = 0.99  # cosine between two changes of the response from which they are the same

RETUNING, SINGLY, PAIRS = "re-tuned parameters", "effects alone", "pairs of effects"
DISCONTINUOUS, FURTHER = "discontinuous effects", "a third effect and further ones"
RIVALS, SINES = "effects that may do as well", "further sines of ripples"
MASKED = "effects that parameters mask"
CONDITIONS = "conditions that are left out"
STAGES = (RETUNING, SINGLY, PAIRS, DISCONTINUOUS, FURTHER, RIVALS, SINES, MASKED)
"""Stages of a search, in this order."""
FIRST_ANSWER = "first answer"  # head of what is told once every promising effect was fitted alone


@dataclass(frozen=True, eq=False)
class Selection:
    """What was tried and what was taken.

    Attributes:
        before: the nominal model.
        retuned: nominal parameters alone.
        tried: the best fitted model of each set of effects, best first.
        taken: the fitted model whose effects earn their place.
        detectability: how far each effect can move the outputs, by its name.
        masked: effects that may be there beside nominal parameters alone, if these were taken.
        unfinished: what was not tried, or not to the end, since the search was stopped.
    """

    before: CrossValidation
    retuned: FittedModel
    tried: Sequence[FittedModel]
    taken: FittedModel
    detectability: dict[str, Detectability]
    masked: Sequence[MaskedEffect] = ()
    unfinished: Sequence[str] = ()

    def of_size(self, count: int) -> list[FittedModel]:
        """Return the fitted models by so many causes, best first."""
        return [it for it in self.tried if len(it.causes) == count]

    @property
    def alike(self) -> list[FittedModel]:
        """Fitted models by as many causes as were taken, by one where none was."""
        return self.of_size(max(1, len(self.taken.causes)))

    @property
    def fitted(self) -> dict[str, FittedModel]:
        """By each effect that was fitted: alone, or else the best fitted model that has it."""
        by_effect: dict[str, FittedModel] = {}
        for model in sorted(self.tried, key=lambda it: len(it.effects)):
            for name in model.effects:
                by_effect.setdefault(name, model)
        return by_effect


def select_effects(
    fitter: Fitter,
    left_out: Iterable[str] = (),
    tell: Tell | None = None,
    tolerance: float = LEAST_GAP,
) -> Selection:
    """Explain a gap by nominal parameters, by one effect, or by several.

    Args:
        fitter: model, logs, priors and floors; the ``stop`` of its ``steps`` may end the search.
        left_out: effects that are not considered.
        tell: is told what goes on, and the first answer, see ``FIRST_ANSWER``.
        tolerance: gap [noise floors] up to which there is nothing to explain.
    """
    say = tell or silent
    as_it_is = replace(fitter, steps=None).unfitted()
    before = as_it_is.evidence
    if before.rms <= tolerance:
        return Selection(before, as_it_is, [], as_it_is, {})
    stop = fitter.steps.stop if fitter.steps else Stop()
    # an effect with an uncertain size is one of the nominal ones, and free in every fit
    owners = {fitter.model.plant.parameters[free.name].owner for free in fitter.nominal}
    every = candidates(fitter.model, fitter.logs, owners.union(left_out))
    fitter = replace(fitter, trials={one.name: log(one.trials) for one in every})
    ahead, masked = stages(every), list[MaskedEffect]()
    enough = min(fitter.settings.enough_floors, tolerance)
    retuned = taken = as_it_is
    search: SubsetSelection | None = None

    def answer(best: FittedModel) -> None:
        names = " and ".join(best.causes) or "no effect"
        gap = f"gap {before.rms:.3g} -> {best.evidence.rms:.3g} noise floors"
        say(f"{FIRST_ANSWER} after {stop.elapsed:.2g} s: {names}, {gap}")
        if stop.quick:
            stop.why = stop.why or AT_FIRST_ANSWER

    with stop.search():
        say("re-tuning nominal parameters")
        fitter = fitter.surveyed()
        retuned = taken = fitter.fit((), ())
        retuned = taken = fitter.put_back(fitter.finish(retuned))
        if any(log.unsure for log in fitter.logs):
            fitter = fitter.with_unsure_inputs(retuned)
            retuned = taken = fitter.put_back(fitter.fit_from(retuned))
        ahead.remove(RETUNING)
        say(f"screening {len(every)} effects")
        nominal = {free.name: free.nominal for free in fitter.nominal}
        others = [] if retuned.settled else [fitter.at_values((), (), nominal).linearised]
        results = survey(retuned.linearised, others, every)
        search = SubsetSelection(fitter, retuned, every, results, say, enough, ahead)
        taken = search.run(answer)
        retuned = search.beneath(taken)
        if taken is retuned and not lacks(retuned, retuned):
            masked = search.masked_by(retuned, max(tolerance, fitter.settings.masked_floors))
        ahead.clear()
    if search and ahead:
        taken = search.so_far()
        retuned = search.beneath(taken)
    if search and taken is not retuned:
        search.say(f"fitting {' and '.join(taken.causes)} to the end")
        retuned = fitter.refit_at_model_step(retuned, fit=not stop.passed)
        taken = fitter.refit_at_model_step(taken)
    elif retuned is not as_it_is:
        taken = retuned = fitter.refit_at_model_step(retuned)
    tried = [model for model in search.tried() if model.effects] if search else []
    reach = detectability(search.surveyed, every) if search else {}
    return Selection(before, retuned, tried, taken, reach, masked, ahead)


def stages(every: Sequence[Candidate]) -> list[str]:
    """Return those of ``STAGES`` that these effects have."""
    some = {
        DISCONTINUOUS: any(one.grid for one in every),
        SINES: any(one.hints.harmonics for one in every),
    }
    return [it for it in STAGES if some.get(it, True)]


Task = tuple[tuple[str, ...], Callable[[], FittedModel]]  # causes, and the fit of them


class SubsetSelection:
    """The selection: what was fitted so far, and how it grows.

    Attributes:
        fitter, retuned, every: see ``select_effects``.
        surveyed: results of screening every effect beside nominal parameters alone, best first.
        results: results that move the outputs, and further ones.
        enough: held-out error [noise floors] below which no effect joins a model.
        ahead: stages that are not done yet.
        models: the best fitted model of each set of causes: effects, and wider priors.
    """

    def __init__(
        self,
        fitter: Fitter,
        retuned: FittedModel,
        every: Sequence[Candidate],
        results: Sequence[Screened],
        tell: Tell,
        enough: float | None = None,
        ahead: list[str] | None = None,
    ) -> None:
        self.fitter, self.retuned, self.every, self.tell = fitter, retuned, every, tell
        self.settings, self.surveyed = fitter.settings, results
        self.results = moving(results)
        self.enough = self.settings.enough_floors if enough is None else enough
        self.screener = Screener(every, self.results)
        self.models: dict[frozenset[str], FittedModel] = {frozenset(): retuned}
        self.exchanged: set[FittedModel] = set()
        self.carried: dict[FittedModel, float] = {}
        self.ahead = [] if ahead is None else ahead
        self.stopped = False

    def run(self, answer: Callable[[FittedModel], None] = lambda _: None) -> FittedModel:
        """Return the model whose causes earn their place; ``answer`` is told the best as soon as
        effects were fitted alone."""
        if self.suffices(0):
            answer(self.retuned)
            return self.retuned
        smooth = [one for one in self.every if not one.grid]
        self.grow(1, smooth)
        first = self.accepted()
        answer(first)
        return first if self.retuned.settled else self.further()

    def further(self) -> FittedModel:
        """Grow models by two effects and more; return the one whose effects earn their place."""
        smooth = [one for one in self.every if not one.grid]
        self.begin(PAIRS)
        self.grow(2, smooth)
        if self.settled(2):
            self.add(self.retuned, self.as_good(self.starts(self.every), self.settings.fits_beside))
        else:
            self.grow_loaded()
            self.begin(DISCONTINUOUS)
            self.search_grids()
            self.grow(1, [one for one in self.every if one.grid])
            self.grow(2, self.every)
        self.exchange_best(2)
        if not self.settled(2):
            self.search_grids_beside()
            self.exchange_best(2)
        self.begin(FURTHER)
        taken = self.accepted()
        for size in range(3, self.settings.most_effects + 1):
            if len(taken.causes) < size - 1 or taken.settled:
                break
            self.grow(size, self.every)
            self.exchange_best(size)
            taken = self.accepted()
        self.begin(RIVALS)
        while taken.causes and taken not in self.exchanged:
            self.exchange(taken, rivals=True)
            taken = self.accepted()
        self.begin(SINES)
        return self.with_harmonics(taken)

    def fitter_of(self, model: FittedModel) -> Fitter:
        """The fitter that has the priors of a model."""
        return replace(self.fitter, nominal=model.nominal) if model.widened else self.fitter

    def beneath(self, model: FittedModel) -> FittedModel:
        """Nominal parameters alone, with the priors of a model."""
        known = self.models.get(frozenset({WIDER} if model.widened else ()))
        if known and known.nominal == model.nominal:
            return known
        fitter = self.fitter_of(model)
        return fitter.put_back(fitter.finish(fitter.fit((), (), model.values)))

    def masked_by(self, retuned: FittedModel, least: float) -> list[MaskedEffect]:
        """Effects that move the outputs by ``least`` noise floors and that nominal parameters
        imitate."""
        self.begin(MASKED)
        self.say("looking for effects that re-tuned parameters mask")
        results: Sequence[Screened] = self.surveyed
        if retuned is not self.retuned:
            results = survey(retuned.linearised, [], self.every)
        return masked_effects(self.fitter_of(retuned), retuned, results, least)

    def begin(self, stage: str) -> None:
        """Note that everything before one of ``STAGES`` is done."""
        done = STAGES[: STAGES.index(stage)]
        self.ahead[:] = [it for it in self.ahead if it not in done]

    def so_far(self) -> FittedModel:
        """Return the model whose effects earn their place where the search was stopped."""
        self.stopped = True
        taken = self.accepted()
        if taken.causes and MASKED in self.ahead:
            self.ahead.remove(MASKED)
        untested = len(taken.causes) > 1 and taken not in self.carried
        if untested and len(conditions(self.fitter.logs)) >= self.settings.least_conditions:
            self.ahead.append(CONDITIONS)
        return taken

    def with_harmonics(self, taken: FittedModel) -> FittedModel:
        """Return a model with as many sines of each ripple as earn their place."""
        for candidate in self.every:
            if candidate.name not in taken.effects or not candidate.hints.harmonics:
                continue
            self.say(f"looking for further sines of {candidate.name}")
            for number in range(2, 2 + len(candidate.hints.harmonics)):
                if taken.settled:
                    break
                more = with_sines(self.fitter_of(taken), taken, candidate, number)
                if more and passes_entry_test(more, taken, self.settings.entry_share_of_third):
                    taken = more
                    self.keep(taken)
        return taken

    def say(self, text: str) -> None:
        """Tell what goes on, with the best fitted model so far."""
        for best in self.tried()[:1]:
            names, left = " and ".join(best.causes), best.evidence.rms
            text = f"{text}; best so far {names}, {left:.3g} noise floors"
        self.tell(text)

    # -- growing -----------------------------------------------------------------------------------

    def grow(self, size: int, pool: Sequence[Candidate]) -> None:
        """Fit models by so many causes: wider priors, and effects of a pool."""
        if self.suffices(size - 1):
            return
        if size == 1:
            self.grow_alone(pool)
            self.widen(self.retuned)
        elif self.best(size - 1):
            settings, many = self.settings, size == 2 and not self.settled(1)
            share = settings.promised_cost if size == 2 else 1.0 - settings.entry_share_of_third
            share = 1.0 - settings.entry_share if self.settled(size - 1) else share
            for base in self.bases(size - 1)[: settings.bases if many else 1]:
                self.grow_beside(base, pool, share)
                self.widen(base)
        self.finish_best(size)

    def finish_best(self, size: int) -> None:
        """Fit the best model of a size to the end, unless it leaves noise only."""
        for best in self.best(size)[:1]:
            if not best.settled:
                self.keep(self.fitter.finish(best))

    def grow_alone(self, pool: Sequence[Candidate]) -> None:
        """Fit the most promising effects of a pool, each alone."""
        settings = self.settings
        most = settings.fits_beside if self.retuned.settled else settings.fits_alone
        starts = list(self.starts(pool))[:most]
        self.add(self.retuned, starts[:FIRST_ALONE])
        self.add(self.retuned, self.as_good(starts[FIRST_ALONE:]))

    def grow_beside(self, base: FittedModel, pool: Sequence[Candidate], share: float) -> None:
        """Fit the effects of a pool that promise to leave less than a share of what a smaller model
        leaves."""
        results, most = self.screener.beside(base, pool), self.settings.fits_beside
        self.add(base, promising(results, share * base.cost, most))

    def grow_loaded(self) -> None:
        """Fit frictions beside every load: without the other one, either is nowhere near the best
        where a motor runs away."""
        frictions = [one for one in self.every if one.hints.family == "friction"]
        loads = {one.name for one in self.every if one.hints.family == "load"}
        for base in self.best(1):
            if loads.intersection(base.effects):
                self.grow_beside(base, frictions, self.settings.promised_cost)

    def bases(self, size: int) -> list[FittedModel]:
        """The models of a size that share no cause with a better one, best first."""
        apart: list[FittedModel] = []
        for model in self.best(size):
            if not any(set(model.causes) & set(other.causes) for other in apart):
                apart.append(model)
        return apart

    def search_grids(self) -> None:
        """Screen discontinuous effects at all their values, from where the best fit has put the
        nominal parameters, and from where these alone go."""
        self.say("searching discontinuous effects")
        best = min([self.retuned, *self.best(1)], key=lambda it: it.loss)
        fitter = self.fitter_of(best)
        there = fitter.at_values((), (), best.values)
        near = [it for it in self.results if it.linearised is self.retuned.linearised]
        short = shortlist(fitter, there, self.every, near)
        screened = screen((self.retuned.linearised, there.linearised), short)
        self.results = sorted([*self.results, *screened], key=lambda it: it.left)
        self.screener = Screener(self.every, self.results, self.screener)

    def search_grids_beside(self) -> None:
        """Screen discontinuous effects of the best pairs at all their values beside the best single
        effects: without one of these, the right value looks like any other."""
        named = {name for pair in self.best(2)[: self.settings.bases] for name in pair.effects}
        for base in self.bases(1)[: self.settings.bases]:
            again = [it for it in self.every if it.name in named - {*base.effects}]
            fit = partial(fit_with, self.fitter_of(base), base)
            results = screen((base.linearised,), shortlist(self.fitter_of(base), base, again))
            least = self.settings.promised_cost * base.cost
            likely = promising(results, least, self.settings.fits_beside)
            self.fit([((*base.causes, name), partial(fit, sizes)) for name, sizes in likely])

    # -- exchanging --------------------------------------------------------------------------------

    def exchange_best(self, size: int) -> None:
        """Exchange effects of the best model of a size until none does better."""
        before: FittedModel | None = None
        while self.gains(size) and self.best(size)[0] is not before:
            before = self.best(size)[0]
            self.exchange(before)
            if self.best(size)[0] is not before:
                self.finish_best(size)

    def exchange(self, model: FittedModel, rivals: bool = False) -> None:
        """Fit others in the place of each effect of a model: those that promise to do better; as
        its ``rivals``, and where it leaves noise only, those that may do as well."""
        settings, rivals = self.settings, rivals or model.settled
        share, most = settings.promised_cost, settings.fits_beside
        if rivals:
            self.exchanged.add(model)
            share, most = settings.rival_cost, settings.fits_exchanged
        enough = share * model.cost
        for name in model.effects:
            stays = self.fitter_of(model).at_values(*model.without(name), model.values)
            results = self.screener.again_beside(stays, model, enough)
            others = [result for result in results if result.candidate.name != name]
            self.add(stays, promising(others, enough, most, unlike=not rivals))
            self.widen(stays)

    # -- fitting -----------------------------------------------------------------------------------

    def add(self, base: FittedModel, starts: Iterable[Promising]) -> None:
        """Fit some effects beside those of a model, those only that were not fitted yet."""
        first, fitter = self.settings.bases, self.fitter_of(base)
        new = [it for it in starts if frozenset((*base.causes, it[0])) not in self.models]
        for some in (new[:first], new[first:]):  # the first tell what the others have to reach
            enough = self.to_reach(len(base.causes) + 1)
            fit = partial(fit_with, fitter, base, enough=enough)
            self.fit([((*base.causes, name), partial(fit, likely)) for name, likely in some])

    def widen(self, base: FittedModel) -> None:
        """Fit the effects of a model with wider priors of what it drives far from what is believed:
        a wrong belief is a cause like an effect."""
        causes = (*base.causes, WIDER)
        fitter = None if frozenset(causes) in self.models else self.fitter.widened(base)
        if fitter:
            self.fit([(causes, partial(fitter.fit, base.effects, base.own, base.values))])

    def to_reach(self, size: int) -> float:
        """Squared errors that a further model of a size has to be able to leave, to be one of the
        best: unseen ones are not less."""
        best = self.best(size)[: self.settings.bases]
        return best[-1].loss if len(best) == self.settings.bases else inf

    def fit(self, tasks: Sequence[Task]) -> None:
        """Fit together what can be, and keep the better of two models by the same causes."""
        fits = self.fitter.workers.map(lambda task: task[1](), tasks)
        for (names, _), model in zip(tasks, fits):
            self.say(f"fitting {' and '.join(names)}")
            self.keep(model)

    def keep(self, model: FittedModel) -> None:
        known = self.models.get(frozenset(model.causes))
        if known is None or model.loss < known.loss:
            self.models[frozenset(model.causes)] = model

    # -- comparing ---------------------------------------------------------------------------------

    def accepted(self) -> FittedModel:
        """Return the largest model whose causes earn their place, grown one by one."""
        best = self.retuned
        for size in range(1, self.settings.most_effects + 1):
            better = next((it for it in self.best(size) if self.belongs(it, best)), None)
            if better is None and size > 1:
                break
            best = better or best
        return best

    def belongs(self, model: FittedModel, fewer: FittedModel) -> bool:
        """Whether each cause of a model earns its place, also under conditions left out."""
        if fewer.evidence.rms < self.enough:
            return False
        settings = self.settings
        many = len(model.causes) >= 3
        share = settings.entry_share_of_third if many else settings.entry_share
        least = settings.entry_gap_share * (self.retuned.evidence.rms - 1.0)
        if not fewer.causes and fewer.evidence.rms - model.evidence.rms < least:
            return False
        if not passes_entry_test(model, fewer, share):
            return False
        if len(model.causes) == 1:
            return True
        parts = [frozenset(model.causes) - {name} for name in model.causes]
        return all(
            passes_entry_test(model, self.models[part]) for part in parts if part in self.models
        ) and self.carried_over_by(model, fewer)

    def carried_over_by(self, model: FittedModel, fewer: FittedModel) -> bool:
        """Whether errors under conditions left out do not grow by an effect more; where a stopped
        search has not looked, nothing speaks against it."""
        if self.stopped and not {model, fewer} <= self.carried.keys():
            return True
        return self.carries_over(model) <= self.carries_over(fewer)

    def carries_over(self, model: FittedModel) -> float:
        """Squared errors under conditions that were left out."""
        if model not in self.carried:
            self.carried[model] = leave_one_condition_out(self.fitter_of(model), model)
        return self.carried[model]

    def tried(self) -> list[FittedModel]:
        """Every fitted model with a cause, best first."""
        return sorted((it for it in self.models.values() if it.causes), key=lambda it: it.loss)

    def best(self, size: int) -> list[FittedModel]:
        """Fitted models by so many causes, best first."""
        return [it for it in self.tried() if len(it.causes) == size]

    def gains(self, size: int) -> bool:
        """Whether so many causes leave less than fewer do."""
        left, before = (next((it.loss for it in self.best(n)), inf) for n in (size, size - 1))
        return left < (1.0 - self.settings.entry_share) * before

    def suffices(self, size: int) -> bool:
        """Whether a model by so many causes leaves so little that none joins it."""
        models = self.best(size) if size else [self.retuned]
        return any(it.evidence.rms < self.enough for it in models)

    def settled(self, size: int) -> bool:
        """Whether a model by at most so many causes leaves noise only."""
        return any(it.settled for it in self.tried() if len(it.causes) <= size)

    # -- what is worth a fit -----------------------------------------------------------------------

    def starts(self, pool: Iterable[Candidate]) -> Iterator[Promising]:
        """Effects of a pool that were not fitted alone yet, most promising first."""
        names = {one.name for one in pool if frozenset((one.name,)) not in self.models}
        return starts_of([it for it in self.results if it.candidate.name in names])

    def as_good(self, starts: Iterable[Promising], count: int | None = None) -> list[Promising]:
        """Those that may do as well as a model that leaves noise only; all where there is none."""
        settled, enough = [one.cost for one in self.tried() if one.settled], inf
        if settled:
            share = self.settings.as_good_share
            enough = self.retuned.cost + share * (min(settled) - self.retuned.cost)
        return [(name, likely) for name, likely in starts if likely[0].left < enough][:count]


def promising(
    results: Iterable[Screened], enough: float, count: int, unlike: bool = True
) -> Iterator[Promising]:
    """Yield effects that promise to leave less than enough, and values to begin from.

    Of those that change the response alike only the first, if they are to be ``unlike``.
    """
    chosen: list[Screened] = []
    for name, likely in starts_of([it for it in results if it.left < enough]):
        if len(chosen) == count:
            break
        if not (unlike and any(same(likely[0], it) for it in chosen)):
            chosen.append(likely[0])
            yield name, likely


def same(first: Screened, second: Screened) -> bool:
    """Return whether two effects change the response alike, beside what parameters imitate."""
    a, b = first.difference, second.difference
    return abs(float(a @ b)) > SAME_COSINE * float(np.linalg.norm(a) * np.linalg.norm(b))


def passes_entry_test(model: FittedModel, other: FittedModel, share: float | None = None) -> bool:
    """Return whether a model predicts what is held out of its fit surely better than another.

    ``share`` is that of the squared errors that it has to take away, by default ``entry_share``.
    """
    settings = model.settings
    share = settings.entry_share if share is None else share
    if model.held_by_bound and not other.held_by_bound:
        share = max(share, settings.entry_share_on_bound)
    least = settings.entry_advantage + 2.0 * max(model.chance - other.chance, 0.0)
    by_chance = not sure(other.left, settings)
    saved = 1.0 - model.loss / other.loss if other.loss > 0.0 else 0.0
    return (
        saved > share
        and advantage(model.evidence, other.evidence, by_chance) > least
        and consistency(model.evidence, other.evidence) < settings.entry_probability
    )
