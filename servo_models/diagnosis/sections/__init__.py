"""A diagnosis as people read it: the answer first, then what it rests on."""

from __future__ import annotations

from collections.abc import Iterator

from servo_models.analysis.explain import display_scale
from servo_models.data.parameters import installed_version
from servo_models.diagnosis import summary
from servo_models.diagnosis.claims import Claim, Value
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.sections import pictures, tables
from servo_models.diagnosis.verdict import FEW, NOT_IDENTIFIABLE, OUTSIDE, PARAMETERS
from servo_models.identification.readings import log_facts
from servo_models.report.conditions import conditions
from servo_models.report.numbers import ARROW, number, percent
from servo_models.report.sections import Card, Report, Section

ANSWER, WARNINGS, ERRORS, WHERE = "Measured and simulated", "Warnings", "Errors", "Where it lies"
EFFECTS, PARAMETER, NEXT = "Effects", "Parameters", "Next experiment"


def report(found: Diagnosis, date: str = "") -> Report:
    """Return the report of a diagnosis."""
    model = found.model
    return Report(
        title=f"{found.name}: {model.actuator.name}, variant {model.variant}",
        sentence=summary.headline(found) + summary.rivals(found),
        passed=judgement(found),
        cards=tuple(_cards(found)),
        sections=(
            _answer(found),
            Section(WARNINGS, items=tuple(_sentences(summary.warnings(found))), folded=True),
            _errors(found),
            _where(found),
            _effects(found),
            _detectors(found),
            _ruled_out(found),
            _imitated(found),
            _parameters(found),
            _next(found),
            _provenance(found),
        ),
        date=date,
    )


def judgement(found: Diagnosis) -> bool | None:
    """Return True if there is no gap, None if it is explained, False if it is not."""
    if found.within_tolerance:
        return True
    return False if found.verdict.kind in (OUTSIDE, NOT_IDENTIFIABLE) else None


def _cards(found: Diagnosis) -> Iterator[Card]:
    yield from _causes(found)
    floors, rms = "noise floors", found.gap.rms
    before = [
        f"{gap.output} {tables.error(found, gap, gap.rms['before'])} RMS" for gap in found.gaps
    ]
    yield Card("before", "\n".join([*before, f"{number(rms['before'], 3)} {floors}"]), None, ANSWER)
    yield Card("left", "\n".join(_left(found)), None, ERRORS)
    yield Card("do next", _to_do(found), None, NEXT if found.next_experiments else "")
    count = len(summary.warnings(found))
    if count:
        many = f"{count} warnings" if count > 1 else "1 warning"
        yield Card("mind", f"{many}, before using the values", False, WARNINGS)


def _causes(found: Diagnosis) -> Iterator[Card]:
    """Effects with their sizes, or what re-tuning moved most."""
    if found.verdict.kind == PARAMETERS:
        moves = summary.moves(found)
        most = sorted(moves, key=lambda name: -abs(moves[name]))[:FEW]
        lines = [_moved(found, value) for value in found.found if value.name in most]
        if lines:
            yield Card("re-tuned most", "\n".join(lines), None, PARAMETER)
        return
    named = [claim for claim in found.claims if claim.taken or claim.in_set]
    if found.within_tolerance or not named:
        return
    lines = [_cause(found, claim) for claim in named[: FEW + 1]]
    more = [f"and {len(named) - len(lines)} more"] if len(named) > len(lines) else []
    title = {OUTSIDE: "nearest", NOT_IDENTIFIABLE: "one of"}.get(found.verdict.kind, "cause")
    yield Card(title, "\n".join([*lines, *more]), None, EFFECTS)


def _cause(found: Diagnosis, claim: Claim) -> str:
    rival = not claim.taken and any(one.taken for one in found.claims)
    sizes = ", ".join(
        f"{value.name.rpartition('.')[2]} {tables.size(found, value)}" for value in claim.parameters
    )
    chance = f", {tables.probability(claim)}" if found.verdict.chances else ""
    return f"{'or ' * rival}{claim.name} on '{claim.wire}'{chance}: {sizes}"


def _moved(found: Diagnosis, value: Value) -> str:
    parameter = found.model.plant.parameters[value.name]
    nominal = number(display_scale(parameter) * value.nominal)
    return f"{value.name} {nominal} {ARROW} {tables.size(found, value)}"


def _left(found: Diagnosis) -> Iterator[str]:
    for gap in found.gaps:
        floor = tables.error(found, gap, gap.floor, 2)
        yield f"{gap.output} {tables.error(found, gap, gap.rms['after'])} RMS, noise {floor}"
    left = f"{number(found.gap.rms['after'], 3)} noise floors"
    if found.gap.closed:
        left += f"; {percent(found.gap.closed[0])} of the gap is closed"
    yield left
    if found.moved and found.causes.taken.effects:
        yield f"{number(found.gap.rms['retuned'], 3)} noise floors with parameters alone"
    for clause in (summary.rest(found), summary.elsewhere(found)):
        if clause:
            yield clause.removeprefix("; ")


def _to_do(found: Diagnosis) -> str:
    planned = [one for one in found.next_experiments if one.telling]
    if found.within_tolerance:
        return "Nothing: the model is as good as these logs can show."
    if planned:
        file = f" ({planned[0].file})" if planned[0].file else ""
        return f"{planned[0].text.partition('. ')[0]}{file}{summary.not_shown(found)}."
    if found.verdict.kind == OUTSIDE:
        return (
            "Look where the rest lies, below; what acts there has no effect in the catalogue yet."
        )
    if found.verdict.kind == NOT_IDENTIFIABLE:
        return "Record a log with other commands: more amplitudes, speeds and reversals."
    return (
        f"Use the diagnosed model: servo-models diagnose {found.name}.toml --out PARAMS.toml, then"
        " servo-models build --params PARAMS.toml."
    )


def _answer(found: Diagnosis) -> Section:
    return Section(ANSWER, tables=(tables.gap(found),), pictures=pictures.responses(found)[:2])


def _errors(found: Diagnosis) -> Section:
    return Section(
        ERRORS,
        "RMS errors. Those of the gap are of stretches of time that the fit has not seen, with"
        " 95 % intervals over the stretches.",
        tables=(tables.nominal(found), tables.fmu(found), tables.held_out(found)),
        pictures=pictures.responses(found)[2:],
        folded=True,
    )


def _where(found: Diagnosis) -> Section:
    return Section(
        WHERE,
        "RMS errors in noise floors, and above each pair of bars the share of the squared error,"
        " before and after. Errors after are of stretches that no fit has seen, but for those by"
        " block of the model.",
        tables=(tables.places(found), *(tables.place(one) for one in found.localisation)),
        pictures=tuple(pictures.place(one) for one in found.localisation if len(one.bins) > 1),
        folded=True,
    )


def _effects(found: Diagnosis) -> Section:
    causes = found.causes
    groups = {
        "Effects, fitted one at a time": causes.singles,
        "Pairs of effects": causes.pairs,
        "More effects together": causes.more,
    }
    return Section(
        EFFECTS,
        "Every effect was switched on and fitted, with the nominal parameters free inside their"
        " uncertainty; what counts is the error on stretches that the fit has not seen. Read"
        " probabilities as a ranking: they come out too sure."
        f"{_refined(found)}",
        tables=(
            tables.effects(found),
            *(tables.fits(found, fits, title) for title, fits in groups.items()),
        ),
        pictures=tuple(pictures.fits(found, fits, title) for title, fits in groups.items() if fits),
        folded=True,
    )


def _refined(found: Diagnosis) -> str:
    """What fitting to the end made of the explanation that is told everywhere else."""
    taken = found.causes.taken
    left = {one.effects: number(one.evidence.rms, 3) for one in found.causes.alike}
    now = number(taken.evidence.rms, 3)
    then = left.get(taken.effects, now)
    if now == then:
        return ""
    return (
        f" All fits ended as soon as they could be compared; {tables.together(taken.effects)} was"
        f" then fitted to the end, and leaves {now} instead of {then}."
    )


def _detectors(found: Diagnosis) -> Section:
    return Section(
        "Codes and ticks",
        "A quantiser leaves codes in its reading, and a hold answers commands on its ticks. Both"
        " show, or do not, whatever error a fit leaves.",
        tables=(tables.detected(found),),
        pictures=pictures.detectors(found),
        folded=True,
    )


def _ruled_out(found: Diagnosis) -> Section:
    return Section(
        "Ruled out",
        "An effect moves the outputs by what the largest size tried does, without what nominal"
        " parameters can imitate. One that moves them by less than the noise floor may be there"
        " all the same.",
        tables=(tables.reasons(found), tables.ruled_out(found)),
        folded=True,
    )


def _imitated(found: Diagnosis) -> Section:
    return Section(
        "Not ruled out",
        "Effects that may be there all the same: with one of them in the model, parameters re-tuned"
        " beside it leave no more than without. How far it moves the outputs is told at the largest"
        " size found, with the experiment that would show it. One without an experiment is small,"
        " or like another parameter under every command tried.",
        tables=(tables.imitated(found),),
        folded=True,
    )


def _parameters(found: Diagnosis) -> Section:
    return Section(
        PARAMETER,
        "Standard errors count correlated residuals; they do not count what the model lacks.",
        tables=tables.parameters(found),
        pictures=pictures.moved(found),
        folded=True,
    )


def _next(found: Diagnosis) -> Section:
    planned = found.next_experiments
    unwritten = not all(one.file for one in planned)
    return Section(
        NEXT,
        "The command inside the actuator's limits on which the fitted models differ most, their"
        " parameters re-fitted to imitate one another. Log it and diagnose it with the old logs.",
        items=(
            *(f"{k}: {one.instruction}" for k, one in enumerate(planned, start=1)),
            *(("--json or --report writes the table to play.",) if unwritten else ()),
        ),
        pictures=tuple(pictures.experiment(found, one) for one in planned),
        folded=True,
    )


def _provenance(found: Diagnosis) -> Section:
    model = found.model
    facts = [
        ("actuator", f"{model.actuator.name}, variant {model.variant}"),
        ("values from", model.provenance),
        ("no gap", f"below {number(found.tolerance)} noise floors"),
        *log_facts(found.logs),
        *{"servo-models": installed_version(), **conditions()}.items(),
    ]
    return Section("Provenance", facts=tuple(fact for fact in facts if fact[1]), folded=True)


def _sentences(texts: tuple[str, ...]) -> Iterator[str]:
    yield from (f"{text[:1].upper()}{text[1:]}." for text in texts)
