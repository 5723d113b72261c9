"""A diagnosis in sentences: the verdict, why an effect is ruled out, what to be careful with."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from servo_models.analysis.experiment import display, in_time
from servo_models.data.audit import EXACT
from servo_models.data.sensor import REPEATS
from servo_models.diagnosis.gap import GapSummary, not_followed
from servo_models.diagnosis.ranking import undetermined
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.search.fitting import FittedModel
from servo_models.diagnosis.search.masking import MaskedEffect
from servo_models.diagnosis.search.residuals import LEAST_SAMPLES
from servo_models.diagnosis.search.screening import Detectability
from servo_models.diagnosis.search.selection import RETUNING
from servo_models.diagnosis.stretches import HeldOut, Part, held_out_outputs
from servo_models.diagnosis.verdict import (
    EFFECT,
    EFFECTS,
    NO_GAP,
    NOT_IDENTIFIABLE,
    OUTSIDE,
    PARAMETERS,
)
from servo_models.identification.doubts import (
    BOUNDS,
    bounded,
    is_stated,
    surprise,
    together,
    with_display,
)
from servo_models.identification.resolution import ROW, STAMP, STEP
from servo_models.identification.simulation import false_starts
from servo_models.report.numbers import listed, number, plural, prefix, with_unit

SEEN = 1.0  # movement [noise floors] from which logs can show an effect
BLOCKS = "blocks that a fit left out"
CURES = {
    ROW: "log each with the time at which it is sent",
    STEP: "log it as finely as it is sent",
    STAMP: "stamp each reading when it is taken",
}
ELSEWHERE = 2.0  # error of a log held out over that of the others: something else acts there
UNLIKE = 3.0  # spread of repeats over scatter of samples that is hardly noise of a reading
MOTION = 0.5  # share of a noise floor, found without noise, from which it is doubtful
MOST_SURPRISES = 2  # parameters that a sentence names
MOST_ALTERNATIVES = 3  # alternatives of a confidence set that a sentence names


def sentence(diagnosis: Diagnosis) -> str:
    """Return the verdict in one sentence, with what only another experiment would show, and what
    columns may be blamed for in others."""
    kind, said = diagnosis.verdict.kind, headline(diagnosis)
    blamed = "".join(f" {text[0].upper()}{text[1:]}." for text in carried(diagnosis))
    before, retuned = diagnosis.gap.rms["before"], diagnosis.gap.rms["retuned"]
    first = f"held out, {unseen}; " if (unseen := held_out(diagnosis)) else ""
    if kind == NO_GAP:
        allowed = f"{diagnosis.tolerance:g} are allowed"
        return (
            f"{said}: {first}the model leaves {before:.3g} noise floors,"
            f" {allowed}{elsewhere(diagnosis)}."
        )
    if kind in (NOT_IDENTIFIABLE, OUTSIDE):
        return (
            f"{said}; {first}{change(diagnosis)}{elsewhere(diagnosis)}{shape(diagnosis)}.{blamed}"
        )
    alone = (
        f", parameters alone leave {retuned:.3g}" if diagnosis.moved and kind != PARAMETERS else ""
    )
    ends = (
        f"{alone}{rivals(diagnosis)}{rest(diagnosis)}{not_shown(diagnosis)}{elsewhere(diagnosis)}"
    )
    return f"{said}: {first}{change(diagnosis)}{ends}.{blamed}"


def rest(diagnosis: Diagnosis) -> str:
    """Return a clause on errors that are left and are no noise, "" where something is missing
    anyway."""
    left = diagnosis.verdict.rest
    if not left or diagnosis.verdict.kind in (NOT_IDENTIFIABLE, OUTSIDE):
        return ""
    return f"; {left:.3g} noise floors of what is left are no noise"


def shape(diagnosis: Diagnosis) -> str:
    """Return a clause on the residual map, "" without one."""
    found = diagnosis.residual_map
    return f"; {found.sentence} leaves {found.after:.3g} noise floors" if found else ""


def not_shown(diagnosis: Diagnosis) -> str:
    """Return a clause on effects that another experiment shows and these logs do not, beside
    parameters that explain the gap; "" for none."""
    shown = ((one, it) for one in diagnosis.next_experiments[:1] for it in one.explanations)
    names = [name for one, effects in shown if one.rules_out((), effects) for name in effects]
    if not names:
        return ""
    verb = "do" if len(names) > 1 else "does"
    return f"; {listed(names)} would not show in these logs, and {verb} in the next experiment"


def shown_by(one: MaskedEffect, diagnosis: Diagnosis) -> str:
    """Return whether the next experiment would show an effect that parameters imitate."""
    shown = any(it.rules_out((), one.fitted_model.effects) for it in diagnosis.next_experiments)
    return "yes" if shown else "no"


def elsewhere(diagnosis: Diagnosis) -> str:
    """Return a clause on the log that is held out and missed most, "" for none."""
    most = max(missed(diagnosis), key=lambda one: one.after, default=None)
    return (
        f"; of log '{most.log}', held out, it leaves {most.after:.3g} noise floors" if most else ""
    )


def missed(diagnosis: Diagnosis) -> list[HeldOut]:
    """Return logs with samples held out of which much more is left than of those judged."""
    least = max(diagnosis.tolerance, ELSEWHERE * diagnosis.gap.rms["after"])
    return [one for one in diagnosis.held_out if one.after > least]


def headline(diagnosis: Diagnosis) -> str:
    """Return the verdict in a clause, without figures and rivals; first what is wrong with a log,
    and that it was stopped."""
    so_far = f"Stopped {diagnosis.stopped}, best so far: " if diagnosis.stopped else ""
    if diagnosis.between_rows:
        so_far += "If commands were sent between the rows that have them: "
    return f"{mistaken(diagnosis)}{so_far}{_headline(diagnosis)}"


def mistaken(diagnosis: Diagnosis) -> str:
    """Return a clause on what is surely wrong with a log, "" for nothing."""
    wrong = diagnosis.mistake.partition(";")[0]  # the cure is among the warnings
    return f"Correct {wrong}. As it stands: " if wrong else ""


def untried(diagnosis: Diagnosis) -> str:
    """Return what a diagnosis that was stopped has not tried."""
    return f"Not tried, or not to the end: {', '.join(diagnosis.unfinished)}"


def _headline(diagnosis: Diagnosis) -> str:
    taken, kind = diagnosis.selection.taken.effects, diagnosis.verdict.kind
    whole = "most of the gap" if diagnosis.verdict.rest else "the gap"
    if kind == NO_GAP:
        return "No gap"
    if diagnosis.explained:
        others = surprises(diagnosis)
        said = f"{listed(others)}, and re-tuned parameters" if others else "Re-tuned parameters"
        return f"{said} explain {whole}, no effect is needed"
    if kind == PARAMETERS:
        return f"{whole.capitalize()} cannot be told from noise, no effect is needed"
    if kind == NOT_IDENTIFIABLE:
        return _undecided(diagnosis)
    if kind == OUTSIDE:
        unfinished = diagnosis.selection.unfinished
        tuned = diagnosis.moved and RETUNING not in unfinished
        alone = "with parameters re-tuned" if tuned else "with the nominal model"
        best = f"with the nearest, {placed(diagnosis, taken)}" if taken else alone
        if unfinished:
            return f"{best}, something is left"
        if any(part.sure for part in diagnosis.parts):
            return _apart(diagnosis)
        apart = f"; perhaps it is {text}" if (text := _differs(diagnosis)) else ""
        return f"Outside the catalogue: {best}, something is left{none_explains(diagnosis)}{apart}"
    beside = "".join(f", and {text}" for text in surprises(diagnosis))
    comes, explains = ("comes", "explains") if kind == EFFECT else ("come", "explain")
    if why := not_asserted(diagnosis):
        possible = "is possible" if kind == EFFECT else "are possible"
        said = possible if diagnosis.contradicted else f"{comes} nearest"
        return f"{placed(diagnosis, taken)} {said}, but {why}{beside}"
    return f"{placed(diagnosis, taken)} {explains} {whole}{beside}"


def _apart(diagnosis: Diagnosis) -> str:
    """What differs between parts that are explained each by itself."""
    text = _differs(diagnosis)
    return f"{text[0].upper()}{text[1:]}"


def _differs(diagnosis: Diagnosis) -> str:
    """Return what differs most between parts, "" without any."""
    if not diagnosis.parts:
        return ""
    parts = sorted(diagnosis.parts, key=lambda one: one.value.value)
    parameter = diagnosis.model.plant.parameters[parts[0].value.name]
    low, high = (
        f"{with_display(parameter, one.value.value)} in {half(one)}log '{one.log}'"
        for one in (parts[0], parts[-1])
    )
    changed = parts[0].half and parts[0].log == parts[-1].log
    what = "changed midway" if changed else "not one actuator"
    return f"{what}: '{parameter.name}' is {low} and {high}"


def half(part: Part) -> str:
    return f"the {part.half} half of " if part.half else ""


def not_asserted(diagnosis: Diagnosis) -> str:
    """Return why effects that were taken are not said to explain the gap, "" where they are."""
    taken = diagnosis.selection.taken
    if diagnosis.verdict.kind not in (EFFECT, EFFECTS):
        return ""
    if unknown := undetermined(taken):
        why, plant = doubts(diagnosis), diagnosis.model.plant
        sizes = (bounded(name, why.get(plant.main(name).switch, "")) for name in unknown)
        return f"these logs do not determine the size of {listed(sizes)}"
    worse = [one.log for one in diagnosis.held_out if one.worse]
    if diagnosis.contradicted and not worse:
        least = f"{100.0 * diagnosis.settings.least_gain:.3g} %"
        some = len(diagnosis.contradicted) < len(taken.effects)
        than = f"the model without {listed(diagnosis.contradicted)}" if some else "parameters alone"
        return f"against {than} the error held out falls by less than {least}"
    if worse:
        return f"log '{worse[0]}', held out, gets worse"
    if mistaken(diagnosis):
        return "the log is not what was measured"
    return "" if taken.converged else "the fit did not converge"


def surprises(diagnosis: Diagnosis) -> list[str]:
    """Return "'a' is 30 ms, not 5 ms" of parameters that are far from what is believed, the
    farthest first, and how many more there are."""
    known, values = diagnosis.model.plant.parameters, {it.name: it for it in diagnosis.found}
    by = far(diagnosis)
    names = sorted(by, key=lambda name: -abs(by[name]))
    said = [
        surprise(known[name], values[name].nominal, values[name].value, values[name].doubt)
        for name in names[:MOST_SURPRISES]
    ]
    more = len(names) - MOST_SURPRISES
    return [*said, f"{more} more are far from what is believed"] if more > 0 else said


def none_explains(diagnosis: Diagnosis) -> str:
    """Return a clause on a ranking of effects outside the catalogue, "" where there is none."""
    ranks = diagnosis.verdict.kind == OUTSIDE and diagnosis.verdict.weights
    return "; the ranking is of effects none of which explains all" if ranks else ""


def _undecided(diagnosis: Diagnosis) -> str:
    """What is not told apart; effects that every fitted model left names are no part of it."""
    left, members = diagnosis.verdict.rivals, diagnosis.verdict.members
    doubt = ", if any" * (diagnosis.contradicted == diagnosis.selection.taken.effects)
    if sum(slot.open for slots in diagnosis.alternatives for slot in slots) > 1:
        return f"These logs cannot tell which effects they are{doubt}: {choices(diagnosis)}"
    surely = [name for name in members if left and all(name in one.effects for one in left)]
    others = ", ".join(name for name in members if name not in surely)
    said = f"These logs cannot tell which effect it is{doubt}"
    if not others or doubt:
        others = ", ".join(members)
    elif surely:
        said = f"It is {placed(diagnosis, surely)}, and these logs cannot tell which other effect"
    return f"{said}: {others} leave much the same"


def rivals(diagnosis: Diagnosis) -> str:
    """Return a clause on effects that do as well as the ones taken, "" for none."""
    if diagnosis.verdict.kind not in (EFFECT, EFFECTS):
        return ""
    taken = diagnosis.selection.taken.effects
    others = [name for name in diagnosis.verdict.members if name not in taken]
    if diagnosis.verdict.kind == EFFECTS and others:
        return f"; cannot be told apart: {choices(diagnosis)}"
    return f"; cannot be told apart from {', '.join(others)}" if others else ""


def choices(diagnosis: Diagnosis) -> str:
    """Return what the confidence set leaves open: "a load (a or b) and a friction (c or d)"."""
    every = diagnosis.alternatives
    said = [" and ".join(map(str, slots)) for slots in every[:MOST_ALTERNATIVES]]
    many = len(every) - len(said)
    more = [plural(many, "other combination")] if many else []
    return ", or ".join([*said, *more])


def placed(diagnosis: Diagnosis, effects: Iterable[str]) -> str:
    """Return effects with the wires on which they act."""
    plant = diagnosis.model.plant
    return listed(f"{name} on '{plant.main_wire(name)}'" for name in effects)


def change(diagnosis: Diagnosis) -> str:
    """Return how far the gap closes, in noise floors and in the unit of each output."""
    rms, stages = diagnosis.gap.rms, ("before", "after")
    outputs = [
        steps(diagnosis, it.output, map(it.rms.__getitem__, stages)) for it in diagnosis.gaps
    ]
    floors = f"{rms['before']:.3g} -> {rms['after']:.3g} noise floors on {BLOCKS}"
    share = closed(diagnosis.gap)
    closes = f", which closes {share} of what can be closed" if share else ""
    return f"{floors} ({', '.join(outputs)}){closes}"


def held_out(diagnosis: Diagnosis) -> str:
    """Return the error of every output where the description holds samples out, stage by stage; ""
    where it holds out none."""
    stages = diagnosis.stages
    outputs = [
        steps(diagnosis, name, (getattr(errors, stage) for stage in stages))
        for name, errors in held_out_outputs(diagnosis.held_out).items()
    ]
    legend = f" ({', '.join(stages.values())})" if outputs and len(stages) > 1 else ""
    return f"{', '.join(outputs)}{legend}"


def steps(diagnosis: Diagnosis, output: str, errors: Iterable[float]) -> str:
    """Return errors [SI] of an output in its unit, stage by stage."""
    scale, unit = unit_of(diagnosis, output)
    return f"{output} {' -> '.join(number(scale * it, 3) for it in errors)} {unit}".rstrip()


def unit_of(diagnosis: Diagnosis, output: str) -> tuple[float, str]:
    """Return the factor from SI to the unit in which errors of an output read best, and it."""
    scale, unit = display(diagnosis.model.plant.wire[output])
    before = {name: it.before for name, it in held_out_outputs(diagnosis.held_out).items()}
    before |= {gap.output: gap.rms["before"] for gap in diagnosis.gaps}
    factor, unit = prefix(scale * before[output], unit)
    return scale * factor, unit


def closed(gap: GapSummary) -> str:
    """Return the share of the reducible gap that is closed with its interval; "" for none."""
    if gap.closed is None:
        return ""
    share, low, high = (f"{100.0 * value:.3g}" for value in gap.closed)
    return f"{share} % ({low}..{high})"


def ruled_out(diagnosis: Diagnosis) -> dict[str, str]:
    """Return why each effect is not named, by its name, the nearest first.

    What parameters imitate is not ruled out.
    """
    reach = diagnosis.selection.detectability
    named = {*diagnosis.verdict.members, *diagnosis.selection.taken.effects}
    named |= {one.name for one in diagnosis.masked}
    fitted = diagnosis.selection.fitted
    rest = [name for name in reach if name not in named and name not in fitted]
    said = {name: _loses(diagnosis, name, one) for name, one in fitted.items() if name not in named}
    why = "explains too little beside those that were fitted"
    if diagnosis.selection.unfinished:
        why = "was not fitted before the search was stopped"
    said |= dict.fromkeys(sorted(rest, key=lambda name: -reach[name].shown), why)
    unseen = {name: _unseen(reach[name]) for name in said if reach[name].shown < SEEN}
    return {**{name: why for name, why in said.items() if name not in unseen}, **unseen}


def _unseen(reach: Detectability) -> str:
    if reach.moved == 0.0:
        return "these logs cannot show it: no size that they suggest moves what is measured"
    if reach.moved < SEEN:
        most = f"{reach.moved:.1g}"
        return f"these logs cannot show it: it moves the outputs by {most} noise floors at most"
    return (
        "these logs can hardly tell it from parameters: what these cannot imitate of it is"
        f" {reach.shown:.1g} noise floors at most"
    )


def _loses(diagnosis: Diagnosis, name: str, fitted: FittedModel) -> str:
    others = [it for it in fitted.effects if it != name]
    beside = f" beside {listed(others)}" if others else ""
    left = f"leaves {fitted.evidence.rms:.3g} noise floors on blocks{beside}"
    return ", ".join([left, *marks(diagnosis, fitted)])


def marks(diagnosis: Diagnosis, fitted: FittedModel) -> list[str]:
    """Return what speaks against a fitted model beside the error that it leaves."""
    worse = fitted.evidence.rms >= diagnosis.gap.rms["retuned"]
    said = {
        "worse than parameters alone": worse,
        "on a bound": fitted.held_by_bound,
        "its fit did not converge": not fitted.converged,
    }
    return [text for text, holds in said.items() if holds]


def moves(diagnosis: Diagnosis) -> dict[str, float]:
    """Return how far nominal parameters moved, in prior standard deviations, by name."""
    free = {one.name: one for one in diagnosis.selection.taken.problem.free}
    uncertain = [it for it in diagnosis.found if free[it.name].prior is not None]
    return {it.name: free[it.name].moved(it.value) for it in uncertain}


def far(diagnosis: Diagnosis) -> dict[str, float]:
    """Return those of ``moves`` that are further than ``far_deviations``, and known to be."""
    least, known = diagnosis.settings.far_deviations, retuned(diagnosis)
    return {name: by for name, by in known.items() if abs(by) > least}


def retuned(diagnosis: Diagnosis) -> dict[str, float]:
    """Return those of ``moves`` that a sentence states."""
    stated = {
        it.name for it in diagnosis.found if is_stated(it.value - it.nominal, it.standard_error)
    }
    return {name: by for name, by in moves(diagnosis).items() if name in stated}


def doubts(diagnosis: Diagnosis) -> dict[str, str]:
    """Return in a few words why a parameter's value is doubtful, by name, if it is."""
    return {it.name: it.doubt for it in diagnosis.found if it.doubt}


def warnings(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what to be careful with: first what was not tried, then logs, noise, the model, and
    its parameters."""
    return (
        *_about_time(diagnosis),
        *_about_logs(diagnosis),
        *_about_repeats(diagnosis),
        *_about_motion(diagnosis),
        *_about_columns(diagnosis),
        *_about_fits(diagnosis),
        *_about_held_out(diagnosis),
        *_about_parameters(diagnosis),
    )


def _about_time(diagnosis: Diagnosis) -> Iterator[str]:
    if diagnosis.stopped:
        yield f"stopped {diagnosis.stopped}: this is the best so far. {untried(diagnosis)}"


def _about_logs(diagnosis: Diagnosis) -> Iterator[str]:
    for one in diagnosis.audits:
        yield from (f"log '{one.log.name}': {text}" for text in one.warnings)
    taken = diagnosis.selection.taken
    yield from false_starts(taken.problem.runs, taken.values)
    for run in taken.problem.runs:
        yield from run.notices(taken.values)
    yield from (
        f"'{name}' is a flag, 0 or 1, and is left out of errors" for name in diagnosis.flags
    )
    short = [log.name for log in diagnosis.logs if 0 < log.fitted.sum() < LEAST_SAMPLES]
    if short and diagnosis.verdict.kind != NO_GAP:
        each = f"'{short[0]}'" if len(short) == 1 else f"each of {len(short)} logs"
        yield (
            f"fewer than {LEAST_SAMPLES} samples of {each} are fitted, too few to tell noise from"
            " what is missing: what is left there counts as noise; log longer, or faster"
        )


def _about_repeats(diagnosis: Diagnosis) -> Iterator[str]:
    """Noise floors from repeats that differ by more than samples scatter."""
    floors = [(one.name, one.floor) for audit in diagnosis.audits for one in audit.readings]
    for gap in diagnosis.gaps:
        scatter = max(max(it.quantum, it.residual) for name, it in floors if name == gap.output)
        if gap.origin == REPEATS and gap.floor > UNLIKE * scatter:
            seen = scatter > EXACT * gap.full_scale  # readings of a simulation scatter by nothing
            times = f"{gap.floor / scatter:.2g} times what" if seen else "far more than"
            yield (
                f"'{gap.output}' differs between repeats of a command by {times} it scatters by"
                " from sample to sample: something that acts otherwise each time, such as a clock"
                f" or heat, counts as noise{_sought(diagnosis)}"
            )


def _about_motion(diagnosis: Diagnosis) -> Iterator[str]:
    """Noise floors that a simulation without noise has as well."""
    for gap in diagnosis.gaps:
        if gap.motion > MOTION * gap.floor:
            yield (
                f"the noise floor of '{gap.output}' contains motion that is fast for these samples:"
                f" the simulation, which has no noise, gives {gap.motion / gap.floor:.2g} of it;"
                f" log faster or repeat a command{_sought(diagnosis)}"
            )


def _sought(diagnosis: Diagnosis) -> str:
    """What to do about a floor that is too high: nothing where a gap shows above it."""
    return "; give a smaller --tolerance to look for it" if diagnosis.verdict.kind == NO_GAP else ""


def _about_columns(diagnosis: Diagnosis) -> Iterator[str]:
    """What columns do not tell, and may be what is left."""
    if diagnosis.between_rows:
        yield (
            "these logs are explained only if commands were sent some time before the rows that"
            " have them: log each with the time at which it is sent, and diagnose again"
        )
    for text, cure in zip(carried(diagnosis), map(CURES.get, diagnosis.carried)):
        yield f"{text}: {cure}"


def carried(diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return what columns may carry of what is left, a sentence for each reason."""
    left = diagnosis.gap.rms["after"]
    return tuple(
        f"of {left:.3g} noise floors left, up to {far:.2g} may come from {_blamed(diagnosis, why)}"
        for why, far in diagnosis.carried.items()
    )


def _blamed(diagnosis: Diagnosis, why: str) -> str:
    most = max((it for it in diagnosis.blurs if it.why == why), key=lambda it: it.largest)
    if why == ROW:
        return "commands that changed between rows"
    if why == STAMP:
        return f"rows that are stamped late, in log '{most.log}' by up to {in_time(most.size)}"
    scale, unit = display(diagnosis.model.plant.wire[most.column])
    return f"the steps of {with_unit(number(scale * most.size, 3), unit)} of '{most.column}'"


def _about_fits(diagnosis: Diagnosis) -> Iterator[str]:
    taken = diagnosis.selection.taken
    for name in not_followed(taken):
        yield (
            f"the model explains hardly anything of '{name}': check scale and sign of its"
            f" column, and that the log is of '{diagnosis.model.actuator.name}'"
        )
    if diagnosis.parts:
        each = "half" if diagnosis.parts[0].half else "log"
        left = ", ".join(f"{one.left:.3g} in {half(one)}log '{one.log}'" for one in diagnosis.parts)
        alone = f"of each {each} alone, parameters of its own leave {left} noise floors"
        yield (
            f"{alone}, and all together {diagnosis.gap.rms['after']:.3g}: another actuator, or one"
            " that was changed, unless an effect acts differently in each"
        )
    if diagnosis.unconfirmed:
        yield f"the FMU of the diagnosed model {diagnosis.unconfirmed}"
    if taken.effects and not taken.converged:
        yield f"the fit with {listed(taken.effects)} did not converge"
    if diagnosis.verdict.limit_cycle:
        yield (
            "the simulated response has a limit cycle that does not repeat: parameters changed"
            f" within their standard errors move it by {diagnosis.verdict.limit_cycle:.3g} noise"
            " floors, so a remaining error of that size does not count as a missing effect"
        )


def _about_held_out(diagnosis: Diagnosis) -> Iterator[str]:
    effects = diagnosis.selection.taken.effects
    for one in diagnosis.held_out:
        if np.isnan(one.retuned):
            helped = ", so it is not known there whether the effects help" if effects else ""
            yield (
                f"held out of log '{one.log}', the motion cannot be simulated with parameters"
                f" alone{helped}"
            )
        elif np.isnan(one.after):
            yield (
                f"held out of log '{one.log}', the motion cannot be simulated with"
                f" {listed(effects)}; there, something else is missing"
            )
        elif one.worse:
            yield (
                f"held out of log '{one.log}', the motion gets worse: parameters alone leave"
                f" {one.retuned:.3g} noise floors, with {listed(effects)} it is"
                f" {one.after:.3g}; there, something else is missing"
            )
        elif one in missed(diagnosis):
            yield (
                f"held out of log '{one.log}', {one.after:.3g} noise floors are left, of what is"
                f" judged {diagnosis.gap.rms['after']:.3g}: something else acts there;"
                " judge that log as well"
            )


def _about_parameters(diagnosis: Diagnosis) -> Iterator[str]:
    every = diagnosis.model.plant.parameters.values()
    if not diagnosis.moved and any(not (it.owner or it.param.fixed) for it in every):
        yield (
            "no nominal parameter has an uncertainty: all are held fixed, and a wrong value looks"
            " like an effect; add [uncertainty] to the description"
        )
    if surprising := far(diagnosis):
        each = ", ".join(f"'{name}' by {by:+.2g}" for name, by in surprising.items())
        yield (
            f"moved further than their uncertainties allow, in prior deviations: {each}; either"
            " these were too small, or the parameters stand in for an effect that is missing"
        )
    taken = diagnosis.selection.taken
    own = [free.name for free in taken.own]
    yield from (together(group, own) for group in taken.together)
    for name, doubtful in doubts(diagnosis).items():
        if doubtful in BOUNDS or name.rpartition(".")[0] in taken.effects:
            yield f"'{name}' is {doubtful}"
