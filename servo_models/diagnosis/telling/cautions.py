"""What to be careful with in a diagnosis, one sentence each."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from servo_models.data.audit import EXACT
from servo_models.data.audit.signals import REPEATS
from servo_models.diagnosis.fitting.structure import LEAST_SAMPLES
from servo_models.diagnosis.gap import not_followed
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.telling.words import doubts, listed, missed, moves
from servo_models.diagnosis.verdict import NO_GAP
from servo_models.identification.simulation import false_starts
from servo_models.identification.uncertainty import together

UNLIKE = 3.0
"""Spread of repeats over the scatter of samples, from which it is hardly noise of a reading."""
MOTION = 0.5
"""Share of a noise floor that is found in a simulation without noise, from which it is doubtful."""
SURPRISING = 3.0
"""Prior standard deviations from which a nominal parameter has moved further than it should."""


def cautions(found: Diagnosis) -> tuple[str, ...]:
    """Return what to be careful with: logs first, then noise, the model, and its parameters."""
    return (
        *_about_logs(found),
        *_about_repeats(found),
        *_about_motion(found),
        *_about_fits(found),
        *_about_held_out(found),
        *_about_parameters(found),
    )


def _about_logs(found: Diagnosis) -> Iterator[str]:
    for one in found.audits:
        yield from (f"log '{one.log.name}': {text}" for text in one.warnings)
    taken = found.causes.taken
    yield from false_starts(taken.problem.runs, taken.values)
    yield from (f"'{name}' is a flag, 0 or 1, and is left out of errors" for name in found.flags)
    short = [log.name for log in found.logs if 0 < log.fitted.sum() < LEAST_SAMPLES]
    if short and found.verdict.kind != NO_GAP:
        each = f"'{short[0]}'" if len(short) == 1 else f"each of {len(short)} logs"
        yield (
            f"fewer than {LEAST_SAMPLES} samples of {each} are fitted, too few to tell noise from"
            " what is missing: what is left there counts as noise; log longer, or faster"
        )


def _about_repeats(found: Diagnosis) -> Iterator[str]:
    """Noise floors from repeats that differ by more than samples scatter."""
    floors = [(one.name, one.floor) for audit in found.audits for one in audit.readings]
    for gap in found.gaps:
        scatter = max(max(it.quantum, it.residual) for name, it in floors if name == gap.output)
        if gap.origin == REPEATS and gap.floor > UNLIKE * scatter:
            seen = scatter > EXACT * gap.full_scale  # readings of a simulation scatter by nothing
            times = f"{gap.floor / scatter:.2g} times what" if seen else "far more than"
            yield (
                f"'{gap.output}' differs between repeats of a command by {times} it scatters by"
                " from sample to sample: something that acts otherwise each time, such as a clock"
                f" or heat, counts as noise{_sought(found)}"
            )


def _about_motion(found: Diagnosis) -> Iterator[str]:
    """Noise floors that a simulation without noise has as well."""
    for gap in found.gaps:
        if gap.motion > MOTION * gap.floor:
            yield (
                f"the noise floor of '{gap.output}' contains motion that is fast for these samples:"
                f" the simulation, which has no noise, gives {gap.motion / gap.floor:.2g} of it;"
                f" log faster or repeat a command{_sought(found)}"
            )


def _sought(found: Diagnosis) -> str:
    """What to do about a floor that is too high: nothing where a gap shows above it."""
    return "; give a smaller --tolerance to look for it" if found.verdict.kind == NO_GAP else ""


def _about_fits(found: Diagnosis) -> Iterator[str]:
    taken = found.causes.taken
    for name in not_followed(taken):
        yield (
            f"the model explains hardly anything of '{name}': check scale and sign of its"
            f" column, and that the log is of '{found.model.actuator.name}'"
        )
    if found.unconfirmed:
        yield f"the FMU of the diagnosed model {found.unconfirmed}"
    if taken.effects and not taken.converged:
        yield f"the fit with {listed(taken.effects)} did not converge"
    if found.verdict.hunting:
        yield (
            "the simulated response has a limit cycle that does not repeat: parameters changed"
            f" within their standard errors move it by {found.verdict.hunting:.3g} noise floors, so"
            " a remaining error of that size does not count as a missing effect"
        )


def _about_held_out(found: Diagnosis) -> Iterator[str]:
    effects = found.causes.taken.effects
    for one in found.held_out:
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
        elif one in missed(found):
            yield (
                f"held out of log '{one.log}', {one.after:.3g} noise floors are left, of what is"
                f" judged {found.gap.rms['after']:.3g}: something else acts there; judge that log"
                " as well"
            )


def _about_parameters(found: Diagnosis) -> Iterator[str]:
    if not found.moved:
        yield (
            "no nominal parameter has an uncertainty: all are held fixed, and a wrong value looks"
            " like an effect; add [uncertainty] to the description"
        )
    far = {name: by for name, by in moves(found).items() if abs(by) > SURPRISING}
    if far:
        each = ", ".join(f"'{name}' by {by:+.2g}" for name, by in far.items())
        yield (
            f"moved further than their uncertainties allow, in prior deviations: {each}; either"
            " these were too small, or the parameters stand in for an effect that is missing"
        )
    taken = found.causes.taken
    own = [free.name for free in taken.problem.free if free.prior is None]
    yield from (together(group, own) for group in taken.together)
    for name, doubtful in doubts(found).items():
        if name.rpartition(".")[0] in found.causes.taken.effects:
            yield f"'{name}' is {doubtful}"
