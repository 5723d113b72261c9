"""Reports of a fit by simulation and of a check: the answer, one picture, what both rest on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING

import numpy as np

from servo_models.analysis.experiment import display, shown
from servo_models.analysis.explain import shown_value
from servo_models.analysis.figures import figures
from servo_models.analysis.linear_model import LinearModel
from servo_models.analysis.linearise import linearise
from servo_models.analysis.sine_test import hold
from servo_models.core.plant import Plant, Wire
from servo_models.core.simulate import Model
from servo_models.core.types import Array, Complex
from servo_models.data.audit import Audit, Command, audits, noise_floors
from servo_models.data.audit import Reading as Measured
from servo_models.data.clock import Sampling
from servo_models.data.lag import lag_sentences
from servo_models.data.log import Log
from servo_models.data.sensor import Floor
from servo_models.errors import UserError
from servo_models.identification import document
from servo_models.identification.check import NOTHING, ROUGHLY, WELL, Check, verdict
from servo_models.identification.doubts import correlated, doubt, is_far, judged, surprise
from servo_models.identification.identifiability import SHOWN, Detectability, Group
from servo_models.identification.identify import Outcome
from servo_models.identification.live import MOVE, live_logs
from servo_models.identification.measured_response import Empirical, Record, empirical
from servo_models.identification.problem import Free
from servo_models.identification.readings import (
    Reading,
    axis_label,
    draw_whiteness,
    error_table,
    log_facts,
    log_notes,
    most_missed,
    not_drawn,
    reading,
    whiteness_text,
    words,
)
from servo_models.identification.resolution import supposed
from servo_models.identification.result import HELD_OUT, Identification
from servo_models.report.curves import BUCKETS, DASHED, envelope, shade
from servo_models.report.estimates import correlation_map, cost_profiles
from servo_models.report.interchange import conditions
from servo_models.report.live import Live
from servo_models.report.numbers import ARROW, Quantity, number, plural, with_unit
from servo_models.report.result import Report, document_of, page_of, report_of
from servo_models.report.sections import Card, Cell, Mark, Picture, Section, Table
from servo_models.report.style import colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes

IN_CARD = 8  # parameters that the answer names; all are in the table
LEAST_BLUR = 0.1  # movement [noise floors] by the resolution of a column, from which it is listed
OWN_CLOCK = 1.5  # steps from which a command is held for longer than a sample
EVEN = 1e-4  # share of a step up to which its jitter is rounding
PARAMETERS, ERRORS = "Parameters", "Errors"
NOTES = "Notes on the logs"


@report_of.register(Identification)
def _identification(fit: Identification, date: str = "") -> Report:
    return replace(_undated(fit), date=date)


@lru_cache(1)  # it costs a frequency response
def _undated(fit: Identification) -> Report:
    floors = noise_floors(audits(fit.logs, fit.fitted.plant))
    return judged(identification_report(fit, floors), fit.warnings)


@page_of.register(Identification)
def _identification_page(fit: Identification, date: str = "") -> Report:
    return with_figures(report_of(fit, date), fit.fitted)


def identification_report(fit: Identification, floors: Mapping[str, float] | None = None) -> Report:
    """Return a fit as people read it; ``floors`` are the noise floors of outputs [SI]."""
    model = fit.fitted
    drawn = most_missed(_readings(fit), fit.sigma)
    pictures = tuple(reading.picture() for reading in drawn)
    grown = not all(_better(fit, output) for output in fit.sigma)
    return Report(
        f"Identification of {model.actuator.name}, variant {model.variant}",
        _sentence(fit),
        False if grown else None if fit.warnings else True,
        (
            _parameter_card(fit),
            *(_error_card(fit, output, (floors or {}).get(output)) for output in fit.sigma),
            Card("next", "\n".join(_next(fit, floors or {}))),
        ),
        tuple(f"Warning: {text}." for text in fit.warnings),
        (
            Section(
                "Measured and fitted",
                not_drawn(fit.logs),
                items=log_notes(fit.logs),
                pictures=pictures[:1],
                live=_panel(fit, floors or {}),
            ),
            _parameters(fit),
            _errors(fit),
            Section("Other responses", pictures=pictures[1:], folded=True),
            _residuals(drawn),
            _frequency_response(fit),
            _provenance(fit),
        ),
    )


def _panel(fit: Identification, floors: Mapping[str, float]) -> Live | None:
    """The logs beside the model before and after, to be moved by hand."""
    models = live_logs(
        fit.nominal,
        fit.logs,
        {"fitted": fit.fitted.values},
        {free.name: float(it) for free, it in zip(fit.free, fit.standard_errors)},
        {free.name for free in fit.free},
        floors,
    )
    return Live("Measured and fitted", MOVE, models, "what if: not the fit") if models else None


def with_figures(report: Report, fitted: Model) -> Report:
    """Return the report with figures of merit of the fitted model, or why it has none."""
    title = "Figures of merit"
    try:
        told = figures(replace(fitted, provenance="this identification")).report()
        section = Section(title, items=told.remarks, tables=told.tables, folded=True)
    except UserError as error:
        section = Section(title, items=(f"None of the fitted model: {error}.",), folded=True)
    *first, provenance = report.sections
    return replace(report, sections=(*first, section, provenance))


# the answer


def _sentence(fit: Identification) -> str:
    """What was fitted, and the error of the output that comes first."""
    count = len(fit.free)
    output = next(iter(fit.sigma))
    held_out = fit.judged_part(output) == HELD_OUT
    error = "held-out error" if held_out else "error (nothing held out)"
    return (
        f"{''.join(f'{text}; ' for text in _surprises(fit))}"
        f"{plural(count, 'parameter')} fitted: {error} of {words(output)}"
        f" {_change(fit, output)} RMS"
    )


def _surprises(fit: Identification) -> list[str]:
    """Which values are far from what was believed."""
    known = fit.fitted.plant.parameters
    return [
        surprise(known[free.name], free.nominal, value, doubt(free, value, error))
        for free, value, error in zip(fit.free, fit.values.tolist(), fit.standard_errors.tolist())
        if is_far(free, value, error)
    ]


def _better(fit: Identification, output: str) -> bool:
    part = fit.judged_part(output)
    return fit.rms(output, part) <= fit.rms(output, part, "before")


def _change(fit: Identification, output: str) -> str:
    """RMS error before and after in the unit that a person reads."""
    scale, unit = display(fit.fitted.plant.wire[output])
    part = fit.judged_part(output)
    before, after = (number(scale * fit.rms(output, part, at)) for at in ("before", "after"))
    return with_unit(f"{before} {ARROW} {after}", unit)


def _parameter_card(fit: Identification) -> Card:
    estimates = list(_estimates(fit))
    doubtful = sum(bool(reason) for _, _, reason in estimates)
    alike = correlated(fit.free, fit.correlations)
    shared = {fit.free[i].name for pair in alike for i in pair}.union(*fit.groups)
    lines = [f"{doubtful} of {len(estimates)} doubtful" if doubtful else "all determined"]
    if shared and not doubtful:
        lines = [f"{len(shared)} of {len(estimates)} determined only together"]
    lines += [
        f"{free.name}: {estimate}{f' ({reason})' if reason else ''}"
        for free, estimate, reason in estimates[:IN_CARD]
    ]
    if len(estimates) > IN_CARD:
        lines.append(f"and {len(estimates) - IN_CARD} more")
    is_well = fit.believable and not (doubtful or shared)
    return Card("parameters", "\n".join(lines), True if is_well else None, PARAMETERS)


def _estimates(fit: Identification) -> Iterator[tuple[Free, Quantity, str]]:
    """Every parameter as a person reads it, and why it is doubtful, "" if it is not."""
    for free, value, error in zip(fit.free, fit.values.tolist(), fit.standard_errors.tolist()):
        parameter = fit.fitted.plant.parameters[free.name]
        yield free, shown_value(parameter, value, error), doubt(free, value, error)


def _error_card(fit: Identification, output: str, floor: float | None) -> Card:
    part = fit.judged_part(output)
    scale, unit = display(fit.fitted.plant.wire[output])
    text = f"{_change(fit, output)} RMS"
    measured = [
        log.outputs[output][log.held_out if part == HELD_OUT else ~log.held_out]
        for log in fit.logs
        if output in log.outputs
    ]
    if spread := float(np.ptp(np.concatenate(measured))):
        text += f"\n{number(100.0 * fit.rms(output, part) / spread, 2)} % of its range"
    if floor is not None:
        text += f"\nnoise floor {Quantity(scale * floor, unit)}"
    return Card(f"{words(output)}, {part}", text, _better(fit, output), ERRORS)


def _next(fit: Identification, floors: Mapping[str, float]) -> list[str]:
    """What to do next, the most urgent first."""
    lines = []
    if fit.warnings:
        lines.append("Read the warnings below before using the values.")
    seen = [words(output) for output in fit.sigma if fit.judged_part(output) != HELD_OUT]
    if seen:
        lines.append(
            "Hold out a log, or a part of one: no samples of"
            f" {', '.join(seen)} were, so the error on new data is unknown."
        )
    at_floor = ": the error is about the noise floor" if floors else ""
    return lines or [f"Use the values{at_floor}."]


# what it rests on


def _readings(fit: Identification) -> list[Reading]:
    """Every output of every log, in their order."""
    wire = fit.fitted.plant.wire
    return [
        reading(log, wire[output], {"nominal": old[output], "fitted": new[output]})
        for log, old, new in zip(fit.logs, fit.before, fit.after)
        for output in log.outputs
    ]


def _errors(fit: Identification) -> Section:
    return Section(
        ERRORS,
        "Before: nominal parameters. After: fitted ones. Fit: share of the measured movement that"
        " the fitted model explains.",
        tables=(error_table("RMS errors", fit.accuracy, fit.fitted.plant),),
        folded=True,
    )


def _parameters(fit: Identification) -> Section:
    return Section(
        PARAMETERS,
        "Standard errors count correlated residuals; they do not count what the model lacks."
        " A prior is the standard deviation of the nominal value."
        f" Condition of the fit: {number(fit.condition, 2)}.",
        tables=(
            Table(
                "Estimated parameters",
                ("parameter", "before", "prior \N{PLUS-MINUS SIGN}", "estimate", "", "meaning"),
                tuple(_parameter_row(fit, *row) for row in _estimates(fit)),
            ),
        ),
        pictures=(
            *correlation_map([free.name for free in fit.free], fit.correlations),
            *cost_profiles(fit.profiles),
        ),
        folded=True,
    )


def _parameter_row(
    fit: Identification, free: Free, estimate: Quantity, reason: str
) -> tuple[Cell, ...]:
    parameter = fit.fitted.plant.parameters[free.name]
    return (
        free.name,
        shown_value(parameter, free.nominal, digits=6),
        None if free.believed is None else shown_value(parameter, free.believed, digits=3),
        estimate,
        Mark(reason or "determined", None if reason else True),
        parameter.param.about,
    )


def _residuals(drawn: Sequence[Reading]) -> Section:
    return Section(
        "Residuals",
        "Simulated minus measured, after the fit. Errors that hang together over time are no"
        " noise: the model lacks something there.",
        pictures=tuple(map(_residual, drawn)),
        folded=True,
    )


def _residual(reading: Reading) -> Picture:
    """Errors over time, over lag, beside the inputs before them, and by size."""
    log, error, label = reading.log, reading.error, axis_label("error", reading.unit)
    mean, deviation = float(np.mean(error)), float(np.std(error))

    def draw(panels: Sequence[Axes]) -> None:
        time, lag, before, size = panels
        shade(time, log.stamps, log.held_out)
        time.plot(*envelope(log.stamps, error, BUCKETS), color=colour("blue"), lw=0.8)
        time.set(xlabel="time [s]", xlim=(log.stamps[0], log.stamps[-1]))
        time.set_ylabel(label, parse_math=False)
        draw_whiteness((lag, before), [reading])
        size.hist(error, 41, density=True, color=colour("blue"), alpha=0.45, lw=0)
        if deviation > 0.0:
            across = np.linspace(error.min(), error.max(), 101)
            height = np.exp(-0.5 * ((across - mean) / deviation) ** 2)
            height /= deviation * np.sqrt(2.0 * np.pi)
            size.plot(across, height, color=colour("ink"), lw=1.0, ls=DASHED)
        size.set_xlabel(label.replace("\n", " "), parse_math=False)
        size.set(ylabel="frequency", yticks=[])
        size.locator_params(axis="x", nbins=5)

    return Picture(
        reading.title,
        draw,
        f"{whiteness_text([reading])} Mean {reading.size(mean)}, standard deviation"
        f" {reading.size(deviation)}; dashed below: the normal distribution with these.",
        rows=4,
        height=7.0,
    )


def _provenance(fit: Identification) -> Section:
    """Model, method, logs with their hashes, and versions."""
    ending = "converged" if fit.converged else "did not converge"
    if fit.interrupted:
        ending = "stopped by the user"
    costs = ", ".join(number(cost, 5) for cost in fit.costs)
    facts = (
        ("method", fit.method),
        (
            "search",
            f"{ending}; {fit.evaluations} simulations of all logs; cost of each start: {costs}",
        ),
        *log_facts(fit.logs),
        *conditions().items(),
    )
    return Section("Provenance", facts=facts, folded=True)


# frequency response


@dataclass(frozen=True, eq=False)
class Pair:
    """An input and an output that logs relate."""

    input: Wire
    output: Wire
    records: tuple[Record, ...]

    @property
    def title(self) -> str:
        return f"{words(self.output.name)} over {words(self.input.name)}"

    @property
    def step(self) -> float:
        """Sampling step [s] of the slowest record."""
        return max(float(np.median(np.diff(record.times))) for record in self.records)

    @property
    def gain_label(self) -> str:
        given, wanted = (wire.display or wire.unit for wire in (self.input, self.output))
        return "gain [dB]" if given == wanted else f"gain [dB re {wanted}/{given}]"

    def decibel(self, response: Complex) -> Array:
        """The gain in the units that a person reads."""
        scale = display(self.output)[0] / display(self.input)[0]
        return np.asarray(20.0 * np.log10(scale * np.abs(response)))


def _frequency_response(fit: Identification) -> Section:
    """A Bode plot for each input and output that logs relate, and what it lacks."""
    pairs = _pairs(fit)
    linear, missing = _small_signals(fit) if pairs else (None, [])
    pictures = []
    for pair in pairs:
        measured = empirical(pair.records, pair.step)
        line = _line(pair, measured, linear) if linear else None
        if measured is None:
            missing.append(
                f"No measured response of {pair.title}: it takes longer logs, or a command that"
                " moves more often, such as a sweep. No fit needs it."
            )
        if linear and line is None:
            missing.append(f"Nothing small passes from {pair.input.name} to {pair.output.name}.")
        if measured or line:
            pictures.append(bode(pair, measured, line))
    return Section(
        "Frequency response", items=tuple(missing), pictures=tuple(pictures), folded=True
    )


def _pairs(fit: Identification) -> list[Pair]:
    wires = fit.fitted.plant.wire
    related: dict[tuple[str, str], list[Record]] = {}
    for log, after in zip(fit.logs, fit.after):
        for name, values in log.inputs.items():
            for output, measured in log.outputs.items():
                if np.ptp(values) > 0.0 and not wires[output].flag:
                    record = Record(log.times, values, measured, after[output])
                    related.setdefault((name, output), []).append(record)
    return [Pair(wires[i], wires[o], tuple(records)) for (i, o), records in related.items()]


def _small_signals(fit: Identification) -> tuple[LinearModel | None, list[str]]:
    """The linear model where the first log begins, and what is missing from it."""
    log = fit.logs[0]
    model = fit.fitted
    settings = {**log.constants, **{name: float(u[0]) for name, u in log.inputs.items()}}
    inputs = {wire.name for wire in model.plant.inputs}
    fixed = {name: value for name, value in settings.items() if name not in inputs}
    at = {name: value for name, value in settings.items() if name in inputs}
    try:
        linear = linearise(replace(model, values={**model.values, **fixed}), at)
    except UserError as error:
        return None, [f"No response for small signals: {error}."]
    reasons = linear.left_out.items()
    return linear, [f"Small signals do not show '{name}': {reason}." for name, reason in reasons]


def _line(
    pair: Pair, measured: Empirical | None, linear: LinearModel
) -> tuple[Array, Complex] | None:
    """Frequencies [Hz] and response for small signals, None where they do not pass."""
    nyquist = 0.5 / pair.step
    low, high = 1.0 / max(record.times[-1] for record in pair.records), nyquist
    if measured:
        low, high = 0.5 * measured.hertz[0], min(2.0 * measured.hertz[-1], nyquist)
    hertz = np.geomspace(low, high, 300)
    response = linear.response(hertz, pair.input.name, pair.output.name)
    if not np.all(response):
        return None
    return hertz, response if linear.period else response * hold(2.0 * np.pi * hertz, pair.step)


def bode(pair: Pair, measured: Empirical | None, line: tuple[Array, Complex] | None) -> Picture:
    """The line of small signals, and points where the logs show a response."""

    def draw(panels: Sequence[Axes]) -> None:
        gain, phase = panels
        turns = None
        if line:
            hertz, response = line
            turns = hertz, np.degrees(np.unwrap(np.angle(response)))
            gain.plot(hertz, pair.decibel(response), color=colour("blue"), lw=1.3)
            phase.plot(*turns, color=colour("blue"), lw=1.3)
        if measured:
            simulated, logs = _phases(measured, turns)
            for axes, log_values, model_values in (
                (gain, pair.decibel(measured.measured), pair.decibel(measured.simulated)),
                (phase, logs, simulated),
            ):
                ink, dots = colour("ink"), colour("orange")
                axes.plot(measured.hertz, log_values, "o", color=ink, mfc="none", ms=6, mew=1.0)
                axes.plot(measured.hertz, model_values, "o", color=dots, ms=3.5, mew=0.0)
        gain.set(xscale="log", ylabel=pair.gain_label)
        phase.set(xlabel="frequency [Hz]", ylabel="phase [deg]")
        phase.locator_params(axis="y", nbins=6, steps=[1, 1.5, 3, 4.5, 9, 10])

    texts = []
    if line:
        texts.append("Line: the fitted model for small signals, its input held between samples.")
    if measured:
        texts.append(
            "Circles: the logs, where at least 80 % of the output's power goes with the input."
            " Dots: the same estimate on the fitted model's responses to the same inputs."
        )
    return Picture(pair.title, draw, " ".join(texts), rows=2, height=4.2, shared=True)


def _phases(measured: Empirical, turns: tuple[Array, Array] | None) -> tuple[Array, Array]:
    """Phases [deg] of model and logs by the turns of the line, if there is one."""
    if turns:
        simulated = beside(np.interp(measured.hertz, *turns), measured.simulated)
    else:
        simulated = np.degrees(np.unwrap(np.angle(measured.simulated)))
    return simulated, beside(simulated, measured.measured)


def beside(reference: Array, response: Complex) -> Array:
    """Return the phase [deg] of a response in the turn that is nearest to ``reference``."""
    degrees = np.degrees(np.angle(response))
    return np.asarray(reference + (degrees - reference + 180.0) % 360.0 - 180.0)


# the check of logs


@report_of.register(Check)
def _check(check: Check, date: str = "") -> Report:
    """Return what logs are worth and what they determine."""
    told, warnings = check.description, check.warnings
    first, *others = map(partial(_log_section, check.plant), check.audits)
    title = "Effects, each at its typical size, beside a model that is right"
    effects = Table(title, ("", ""), tuple(_effects(check)))
    doubtful = f"{plural(len(warnings), 'warning')}: read before fitting"
    return Report(
        f"{told.path}: {told.actuator.name}, variant {told.variant}",
        doubtful if warnings else "The logs are usable",
        None if warnings else True,
        _check_cards(check),
        tuple(f"Warning: {text}." for text in warnings),
        (
            Section(NOTES, items=log_notes(told.logs)),
            first,
            *(replace(section, folded=True) for section in others),
            Section("What the columns may hide", tables=(_blur_table(check),), folded=True),
            Section("Parameters", tables=(_reach_table(check),), folded=True),
            Section("Effects", tables=(effects,), folded=True),
        ),
        date,
    )


def _check_cards(check: Check) -> tuple[Card, ...]:
    cards = []
    if check.asked:
        determined = [r.name for r in check.identifiability.parameters if r.together <= WELL]
        doubtful = [r.name for r in check.identifiability.parameters if r.together > WELL]
        cards.append(Card("determined", _names(determined), True, "Parameters"))
        if doubtful:
            cards.append(Card("roughly, or not at all", _names(doubtful), None, "Parameters"))
    if effects := check.identifiability.effects:
        shown = sum(reach.shown for reach in effects)
        cards.append(Card("effects", f"{shown} of {len(effects)} can be shown", None, "Effects"))
    if said := lag_sentences(check.description.logs, check.plant):
        cards.append(Card("lag", "\n".join(said)))
    step = "Run 'identify', or 'diagnose' for effects that the model may lack."
    if check.warnings:
        step = "Read the warnings below: each says what to do."
    return (*cards, Card("next", step))


def _log_section(plant: Plant, audit: Audit) -> Section:
    log, clock = audit.log, audit.sampling
    title = f"Log '{log.name}'"
    inputs = tuple(_command_row(each, plant.wire[each.name], clock) for each in audit.commands)
    outputs = tuple(_output_row(each, plant.wire[each.name]) for each in audit.readings)
    return Section(
        title,
        tables=(
            Table(
                f"{title}: {_clock(clock)}; at rest in {audit.at_rest:.0%} of them",
                ("input", "from", "to", "levels", "reversals", "clock", "band it excites"),
                inputs,
            ),
            Table(
                "Readings, with the noise floor as three methods see it",
                ("output", "from", "to", "step", "noise floor", "origin of the floor"),
                outputs,
            ),
        ),
        pictures=(_log_picture(log, plant),),
    )


def _command_row(command: Command, wire: Wire, clock: Sampling) -> tuple[Cell, ...]:
    held = command.clock if command.clock and command.clock > OWN_CLOCK * clock.step else None
    return (
        command.name,
        shown(wire, command.low),
        shown(wire, command.high),
        command.levels,
        command.reversals,
        held and Quantity(held, "s"),
        "none" if command.band is None else "{:.2g} to {:.3g} Hz".format(*command.band),
    )


def _output_row(measured: Measured, wire: Wire) -> tuple[Cell, ...]:
    step = shown(wire, measured.step) if measured.step else "none"
    low, high = shown(wire, measured.low), shown(wire, measured.high)
    return (measured.name, low, high, step, *_floor(measured.floor, wire))


def _floor(floor: Floor, wire: Wire) -> tuple[Quantity, str]:
    """The floor, and what each method saw; the one that counts stands first."""
    if not floor.value:
        return shown(wire, 0.0), "neither steps nor noise seen"
    parts = sorted(floor.parts.items(), key=lambda part: -part[1])
    rest = ", ".join(f"{name} {shown(wire, size).bare}" for name, size in parts[1:] if size)
    return shown(wire, floor.value), floor.origin + (f" ({rest})" if rest else "")


def _clock(clock: Sampling) -> str:
    every = f"{clock.samples} samples in {clock.duration:.4g} s"
    rate = f"{_short_time(clock.step)} apart ({1.0 / clock.step:.4g} Hz)"
    stamps = f", time stamps to {_short_time(clock.stamp)}" if clock.stamp else ""
    gaps = f"{len(clock.gaps)} gaps" if clock.gaps else "no gaps"
    jitter = f"jitter {_short_time(clock.jitter)}" if clock.jitter > EVEN * clock.step else "even"
    return f"{every}, {rate}, {jitter}{stamps}, {gaps}"


def _short_time(seconds: float) -> str:
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds > 0.9995 * size:
            return f"{seconds / size:.4g} {unit}"
    return f"{seconds / 1e-6:.2g} us"


def _log_picture(log: Log, plant: Plant) -> Picture:
    """Outputs, then the inputs that move, over time."""
    moving = {name: u for name, u in log.inputs.items() if np.ptp(u) > 0.0}
    shown = [*log.outputs.items(), *moving.items()]

    def draw(panels: Sequence[Axes]) -> None:
        for axes, (name, values) in zip(panels, shown):
            scale, unit = display(plant.wire[name])
            shade(axes, log.stamps, log.held_out)
            tint = colour("blue" if name in log.outputs else "muted")
            axes.plot(*envelope(log.stamps, scale * values, BUCKETS), color=tint, lw=1.1)
            axes.set_ylabel(axis_label(words(name), unit), parse_math=False)
        panels[-1].set_xlabel("time [s]")

    text = "Shaded: held out." * bool(log.held_out.any())
    return Picture(log.name, draw, text, len(shown), 0.8 + 1.2 * len(shown), shared=True)


def _reach_table(check: Check) -> Table:
    """What the description asks for; all that the logs show where it asks for nothing."""
    priors = check.description.uncertainty
    rows = tuple(
        (
            reach.name,
            _size_of(check, reach.name, reach.sizes[reach.name], 6),
            _size_of(check, reach.name, reach.alone * reach.scale),
            _size_of(check, reach.name, reach.together * reach.scale),
            _reach_mark(reach, reach.name in priors),
        )
        for reach in check.identifiability.parameters
        if check.asked or reach.shown
    )
    title = "Parameters, with the least standard error to expect: white noise, a right model"
    return Table(title, ("parameter", "value", "alone", "together", ""), rows)


def _reach_mark(reach: Detectability, has_prior: bool) -> Mark:
    passed = True if reach.together <= WELL else None if reach.together <= ROUGHLY else False
    return Mark(verdict(reach, has_prior), passed if reach.moves >= SHOWN else False)


def _size_of(check: Check, name: str, size: float, digits: int = 2) -> Quantity:
    """A size of a parameter [SI] as a person reads it."""
    parameter = check.plant.parameters[name]
    return shown_value(parameter, size, digits=digits)


def _effects(check: Check) -> Iterator[tuple[str, str]]:
    """What the logs show, hide, and confuse, in words."""
    effects = check.identifiability.effects
    if not effects:
        return
    still = [r.name for r in effects if r.moves < NOTHING]
    hidden = [r for r in effects if r.moves >= NOTHING and not r.shown and not r.absorbed]
    yield "can be shown", _names(r.name for r in effects if r.shown)
    yield "cannot be shown", "; ".join(_hidden(check, r) for r in hidden) or "-"
    yield "masked by free parameters", _names(r.name for r in effects if r.absorbed)
    yield "change no measured output", _names(still)
    if check.identifiability.refused:
        yield "cannot be simulated", _names(check.identifiability.refused)
    for names in check.identifiability.together:
        yield "show only together", _names(names)
    for group in check.identifiability.groups:
        yield "look alike", _alike(group, check.plant)


def _blur_table(check: Check) -> Table:
    """What an input's column leaves open, and how far that alone moves an output."""
    return Table(
        "What the columns of inputs leave open: below these movements nothing can be told",
        ("log", "input", "if it was", "that alone moves", "by [noise floors]"),
        tuple(
            (
                blur.log,
                blur.column,
                supposed(blur, check.plant),
                max(blur.moves, key=lambda name: blur.moves[name]),
                number(blur.largest, 2),
            )
            for blur in check.blurs
            if blur.largest >= LEAST_BLUR
        ),
    )


def _names(names: Iterable[str]) -> str:
    return ", ".join(names) or "-"


def _hidden(check: Check, reach: Detectability) -> str:
    sizes = " and ".join(str(_size_of(check, *size)) for size in reach.sizes.items())
    cause = sizes if any(reach.sizes.values()) else "leaving it out"
    return f"{reach.name} ({cause} moves '{reach.output}' by {reach.moves:.1g} noise floors)"


def _alike(group: Group, plant: Plant) -> str:
    cures = list(group.experiments)
    if all(name in plant.parameters for name in group.names):
        cures = ["fix one that you know", *(cures if len(group.names) == 2 else [])]
    return f"{_names(group.names)}: {'; or '.join(cures or ['keep one of them'])}"


report_of.register(Outcome, lambda outcome, date="": report_of(outcome.result, date))
page_of.register(Outcome, lambda outcome, date="": page_of(outcome.result, date))
document_of.register(Identification, document.identification_document)
document_of.register(Outcome, document.outcome_document)
document_of.register(Check, document.check_document)
