"""A diagnosis as people read it: the answer first, then what it rests on."""

from __future__ import annotations

from collections.abc import Iterator

from servo_models.analysis.explain import display_scale
from servo_models.data.lag import lag_sentences
from servo_models.data.parameters import installed_version, parameter_set_of
from servo_models.diagnosis import document, summary
from servo_models.diagnosis.ranking import RankedEffect, Value
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.sections import pictures, tables
from servo_models.diagnosis.verdict import NOT_IDENTIFIABLE, OUTSIDE, PARAMETERS
from servo_models.identification.doubts import is_stated
from servo_models.identification.live import MOVE, live_logs
from servo_models.identification.readings import log_facts, log_notes, words
from servo_models.report.interchange import conditions
from servo_models.report.live import Live
from servo_models.report.numbers import ARROW, listed, number, percent, plural
from servo_models.report.result import Report, document_of, report_of
from servo_models.report.sections import Card, Section

ANSWER, WARNINGS, ERRORS, WHERE = "Measured and simulated", "Warnings", "Errors", "Where it lies"
EFFECTS, PARAMETER, NEXT = "Effects", "Parameters", "Next experiment"
SHAPE = "What is left, as a shape"
SIZE_UNKNOWN = "size unknown"


def report(diagnosis: Diagnosis, date: str = "") -> Report:
    """Return the report of a diagnosis."""
    model = diagnosis.model
    warnings = (f"{text[:1].upper()}{text[1:]}." for text in summary.warnings(diagnosis))
    return Report(
        title=f"{diagnosis.name}: {model.actuator.name}, variant {model.variant}",
        sentence=summary.headline(diagnosis) + summary.rivals(diagnosis),
        passed=judgement(diagnosis),
        cards=tuple(_cards(diagnosis)),
        sections=(
            _answer(diagnosis),
            Section(WARNINGS, items=tuple(warnings), folded=True),
            _errors(diagnosis),
            _residuals(diagnosis),
            _where(diagnosis),
            _shape(diagnosis),
            _effects(diagnosis),
            _ruled_out(diagnosis),
            _masked(diagnosis),
            _parameters(diagnosis),
            _next(diagnosis),
            _provenance(diagnosis),
        ),
        date=date,
    )


def judgement(diagnosis: Diagnosis) -> bool | None:
    """Return True if there is no gap, None if it is explained, False if it is not."""
    if diagnosis.within_tolerance:
        return True
    return False if diagnosis.verdict.kind in (OUTSIDE, NOT_IDENTIFIABLE) else None


def _cards(diagnosis: Diagnosis) -> Iterator[Card]:
    if not diagnosis.within_tolerance:
        yield from _causes(diagnosis)
    if held_out := summary.held_out(diagnosis):
        yield Card("held out", held_out, None, ANSWER)
    if not diagnosis.within_tolerance:
        yield Card("before", "\n".join(_before(diagnosis)), None, ANSWER)
    yield Card("left", "\n".join(_left(diagnosis)), None, ERRORS)
    if shape := diagnosis.residual_map:
        with_it, without = number(shape.after, 3), number(shape.before, 3)
        text = f"{shape.sentence}\n{with_it} noise floors with it, {without} without"
        yield Card("its shape", text, None, SHAPE)
    asked = diagnosis.next_experiments or diagnosis.repeats_wanted
    yield Card("do next", _to_do(diagnosis), None, NEXT if asked else "")
    count = len(summary.warnings(diagnosis))
    if count:
        yield Card("mind", f"{plural(count, 'warning')}, before using the values", False, WARNINGS)


def _causes(diagnosis: Diagnosis) -> Iterator[Card]:
    """Effects with their sizes, or what re-tuning moved most."""
    if diagnosis.verdict.kind == PARAMETERS:
        moves = summary.retuned(diagnosis)
        most = sorted(moves, key=lambda name: -abs(moves[name]))[: diagnosis.settings.few_models]
        lines = [_moved(diagnosis, value) for value in diagnosis.found if value.name in most]
        if lines:
            yield Card("re-tuned most", "\n".join(lines), None, PARAMETER)
        return
    named = [effect for effect in diagnosis.ranking if effect.taken or effect.in_set]
    if not named:
        return
    lines = [_cause(diagnosis, effect) for effect in named[: diagnosis.settings.few_models + 1]]
    more = [f"and {len(named) - len(lines)} more"] if len(named) > len(lines) else []
    title = {OUTSIDE: "nearest", NOT_IDENTIFIABLE: "one of"}.get(
        diagnosis.verdict.kind, "possible" if diagnosis.contradicted else "cause"
    )
    yield Card(title, "\n".join([*lines, *more]), None, EFFECTS)


def _cause(diagnosis: Diagnosis, effect: RankedEffect) -> str:
    rival = not effect.taken and any(one.taken for one in diagnosis.ranking)
    chance = f", {tables.likelihood(effect)}" if effect.probability is not None else ""
    named = f"{'or ' * rival}{effect.name} on '{effect.wire}'"
    return f"{named}{chance}: {_told(diagnosis, effect)}"


def _told(diagnosis: Diagnosis, effect: RankedEffect) -> str:
    """What an effect does with its sizes, where these are known."""
    sizes = {
        value.name.rpartition(".")[2]: tables.told(diagnosis, value)
        for value in effect.parameters
        if is_stated(value.value, value.standard_error)
    }
    hints = diagnosis.model.plant.main(effect.name).effect.hints
    if not hints.named <= sizes.keys():
        return SIZE_UNKNOWN
    listed_sizes = ", ".join(f"{key} {size}" for key, size in sizes.items())
    told = hints.says.format(wire=words(effect.wire), **sizes)
    return told or listed_sizes or SIZE_UNKNOWN


def _moved(diagnosis: Diagnosis, value: Value) -> str:
    parameter = diagnosis.model.plant.parameters[value.name]
    nominal = number(display_scale(parameter) * value.nominal)
    return f"{value.name} {nominal} {ARROW} {tables.told(diagnosis, value)}"


def _before(diagnosis: Diagnosis) -> Iterator[str]:
    for gap in diagnosis.gaps:
        yield f"{gap.output} {tables.error(diagnosis, gap, gap.rms['before'])} RMS"
    yield f"{number(diagnosis.gap.rms['before'], 3)} noise floors"


def _left(diagnosis: Diagnosis) -> Iterator[str]:
    for gap in diagnosis.gaps:
        floor = tables.error(diagnosis, gap, gap.floor, 2)
        yield f"{gap.output} {tables.error(diagnosis, gap, gap.rms['after'])} RMS, noise {floor}"
    left = f"{number(diagnosis.gap.rms['after'], 3)} noise floors"
    if diagnosis.gap.closed and not diagnosis.within_tolerance:
        left += f" on {summary.BLOCKS}; {percent(diagnosis.gap.closed[0])} of the gap is closed"
    yield left
    if diagnosis.moved and diagnosis.selection.taken.effects:
        yield f"{number(diagnosis.gap.rms['retuned'], 3)} noise floors with parameters alone"
    clauses = (summary.rest(diagnosis), summary.elsewhere(diagnosis), *summary.carried(diagnosis))
    for clause in clauses:
        if clause:
            yield clause.removeprefix("; ")


def _to_do(diagnosis: Diagnosis) -> str:
    planned = [one for one in diagnosis.next_experiments if one.telling]
    if diagnosis.within_tolerance:
        return "Nothing: the model is as good as these logs can show."
    if diagnosis.selection.unfinished:
        return f"Diagnose with more time. {summary.untried(diagnosis)}."
    if planned:
        file = f" ({planned[0].file})" if planned[0].file else ""
        return f"{planned[0].steps[0].removesuffix('.')}{file}{summary.not_shown(diagnosis)}."
    if diagnosis.repeats_wanted:
        return diagnosis.repeats_wanted
    if diagnosis.parts:
        return "Give each actuator, or each time between changes, a description of its own."
    if diagnosis.residual_map and diagnosis.helps:
        return f"{_use(diagnosis, '--map')}; its residual map stands for what has no name yet."
    if diagnosis.verdict.kind == OUTSIDE:
        return "Look where the rest lies, below; no effect of the catalogue was found for it."
    if diagnosis.between_rows:
        return "Log each command with the time at which it is sent, and diagnose again."
    if diagnosis.verdict.kind == NOT_IDENTIFIABLE or summary.not_asserted(diagnosis):
        return "Record a log with other commands: more amplitudes, speeds and reversals."
    if not diagnosis.helps:
        return "Fit what is held out as well and hold out other logs: the model hardly helps there."
    return f"{_use(diagnosis, '--out')}."


def _use(diagnosis: Diagnosis, option: str) -> str:
    """How an FMU is made of what was found."""
    if diagnosis.file:
        write = f"servo-models diagnose {diagnosis.file} {option} PARAMS.toml"
    else:
        method = "map_parameter_set" if option == "--map" else "parameter_set"
        write = f"sm.write_parameters(result.{method}(), 'PARAMS.toml')"
    return f"Use the diagnosed model: {write}, then servo-models build --params PARAMS.toml"


def _answer(diagnosis: Diagnosis) -> Section:
    return Section(
        ANSWER,
        items=log_notes(diagnosis.logs),
        tables=(tables.held_out(diagnosis), tables.gap(diagnosis)),
        pictures=pictures.responses(diagnosis)[:2],
        live=_panel(diagnosis),
    )


def _panel(diagnosis: Diagnosis) -> Live | None:
    """The logs beside the model of each stage, to be moved by hand."""
    problem = diagnosis.selection.retuned.problem
    values = {
        "re-tuned": ("retuned", diagnosis.selection.retuned.values),
        "nearest" if diagnosis.verdict.kind == OUTSIDE else "diagnosed": (
            "after",
            diagnosis.fitted.values,
        ),
    }
    sets = {name: found for name, (stage, found) in values.items() if stage in diagnosis.stages}
    named = [effect.name for effect in diagnosis.ranking if effect.taken or effect.in_set]
    models = live_logs(
        diagnosis.model,
        [run.log for run in problem.runs],
        sets,
        {value.name: value.standard_error for value in diagnosis.found},
        {*named, *(free.name for free in problem.free)},
        diagnosis.floors,
    )
    return Live(ANSWER, MOVE, models, "what if: not the diagnosis") if models else None


def _errors(diagnosis: Diagnosis) -> Section:
    return Section(
        ERRORS,
        f"RMS errors. Those of the gap are on {summary.BLOCKS}, with 95 % intervals over them.",
        items=lag_sentences(diagnosis.logs, diagnosis.model.plant),
        tables=(tables.unmodelled(diagnosis), tables.fmu(diagnosis)),
        pictures=pictures.responses(diagnosis)[2:],
        folded=True,
    )


def _residuals(diagnosis: Diagnosis) -> Section:
    return Section(
        "Residuals",
        "Simulated minus measured, of each output in the log where it is missed most. Errors that"
        " hang together over time, or follow a command, are no noise: the model lacks something.",
        pictures=pictures.residuals(diagnosis),
        folded=True,
    )


def _where(diagnosis: Diagnosis) -> Section:
    return Section(
        WHERE,
        "RMS errors in noise floors, and above each pair of bars the share of the squared error,"
        f" before and after. Errors after are on {summary.BLOCKS}, but for those by block of the"
        " model.",
        tables=(tables.places(diagnosis), *(tables.place(one) for one in diagnosis.localisation)),
        pictures=tuple(pictures.place(one) for one in diagnosis.localisation if len(one.bins) > 1),
        folded=True,
    )


def _shape(diagnosis: Diagnosis) -> Section:
    found = diagnosis.residual_map
    if found is None:
        return Section(SHAPE)
    beside = found.fitted.effects
    return Section(
        SHAPE,
        f"{found.sentence[0].upper()}{found.sentence[1:]}. It was learnt from the errors that the"
        f" diagnosed model leaves: {number(found.before, 3)} noise floors on {summary.BLOCKS},"
        f" {number(found.after, 3)} with it. It takes any form, so it speaks for no"
        " effect and against none. What the parameters"
        f"{' and ' + listed(beside) if beside else ''} can do as well, such as a straight"
        " line of the rate, is in them.",
        tables=tuple(tables.curve(diagnosis, curve) for curve in found.curves),
        pictures=tuple(pictures.curve(diagnosis, curve) for curve in found.curves),
    )


def _effects(diagnosis: Diagnosis) -> Section:
    selection, covered = diagnosis.selection, diagnosis.settings.covered_probability
    groups = {
        "Effects, fitted one at a time": selection.of_size(1),
        "Pairs of effects": selection.of_size(2),
        "More effects together": selection.of_size(max(3, len(selection.taken.effects))),
    }
    return Section(
        EFFECTS,
        "Every effect was switched on and fitted, with the nominal parameters free inside their"
        " uncertainty; what counts is the error on the blocks that each fit left out. The set is"
        f" meant to hold a cause of the catalogue with {percent(covered)} probability."
        f" {_likely(diagnosis)}{_refined(diagnosis)}",
        tables=(
            tables.effects(diagnosis),
            *(tables.fits(diagnosis, fits, title) for title, fits in groups.items()),
        ),
        pictures=tuple(
            pictures.fits(diagnosis, fits, title) for title, fits in groups.items() if fits
        ),
        folded=True,
    )


def _likely(diagnosis: Diagnosis) -> str:
    """What the figures beside effects are."""
    if diagnosis.verdict.kind == OUTSIDE:
        return "Model weights rank effects none of which explains all: they are no probabilities."
    if diagnosis.selection.unfinished:
        return (
            "Model weights rank effects: of a search that was stopped there are no probabilities."
        )
    return (
        "A probability says of how many withheld rigs an effect with such a model weight was there;"
        " several effects may be, so probabilities need not add up to 100 %."
    )


def _refined(diagnosis: Diagnosis) -> str:
    """What fitting to the end made of the fitted model that is told everywhere else."""
    taken = diagnosis.selection.taken
    left = {one.effects: number(one.evidence.rms, 3) for one in diagnosis.selection.alike}
    now = number(taken.evidence.rms, 3)
    then = left.get(taken.effects, now)
    if now == then:
        return ""
    return (
        f" All fits ended as soon as they could be compared; {tables.together(taken.effects)} was"
        f" then fitted to the end, and leaves {now} instead of {then}."
    )


def _ruled_out(diagnosis: Diagnosis) -> Section:
    return Section(
        "Ruled out",
        "An effect moves the outputs by what the largest size tried does, without what nominal"
        " parameters can imitate. One that moves them by less than the noise floor may be there"
        " all the same.",
        tables=(tables.reasons(diagnosis), tables.ruled_out(diagnosis)),
        folded=True,
    )


def _masked(diagnosis: Diagnosis) -> Section:
    return Section(
        "Not ruled out",
        "Effects that may be there all the same: with one of them in the model, parameters re-tuned"
        " beside it leave no more than without. How far it moves the outputs is told at the largest"
        " size found, and whether the next experiment would show it. One that it does not is small,"
        " like another parameter under every command tried, or less likely than those that it is"
        " designed for.",
        tables=(tables.masked(diagnosis),),
        folded=True,
    )


def _parameters(diagnosis: Diagnosis) -> Section:
    return Section(
        PARAMETER,
        "Standard errors count correlated residuals; they do not count what the model lacks.",
        tables=tables.parameters(diagnosis),
        pictures=(*pictures.moved(diagnosis), *pictures.estimates(diagnosis)),
        folded=True,
    )


def _next(diagnosis: Diagnosis) -> Section:
    planned = diagnosis.next_experiments
    unwritten = any(one.telling and not one.file for one in planned)
    return Section(
        NEXT,
        "The cheapest that decides as well as any: a command inside the actuator's limits, what can"
        " be set meanwhile, and what else can be measured. Diagnose its logs with the old ones.",
        items=(
            *(step for one in planned[:1] for step in one.instructions),
            *(f"Or else: {' '.join(one.instructions)}" for one in planned[1:]),
            *(("--json or --report writes the files to play.",) if unwritten else ()),
            *filter(None, [diagnosis.repeats_wanted]),
        ),
        pictures=tuple(pictures.experiment(diagnosis, one) for one in planned[:1]),
        folded=True,
    )


def _provenance(diagnosis: Diagnosis) -> Section:
    model, changed = diagnosis.model, diagnosis.settings.changed
    settings = ", ".join(f"{name} {number(value)}" for name, value in changed.items())
    facts = [
        ("actuator", f"{model.actuator.name}, variant {model.variant}"),
        ("values from", model.provenance),
        ("no gap", f"below {number(diagnosis.tolerance)} noise floors"),
        ("settings", settings or "the default ones"),
        *log_facts(diagnosis.logs),
        *{"servo-models": installed_version(), **conditions()}.items(),
    ]
    return Section("Provenance", facts=tuple(fact for fact in facts if fact[1]), folded=True)


report_of.register(Diagnosis, report)
document_of.register(Diagnosis, document.document)
parameter_set_of.register(Diagnosis, document.parameter_set)
