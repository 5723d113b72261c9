"""The verdict: what causes the gap, how far it closes, and what is doubtful."""

from __future__ import annotations

from collections.abc import Sequence

from servo_models.diagnosis.experiments.experiment import Experiment
from servo_models.diagnosis.gap import Gap
from servo_models.diagnosis.page.gap import unit_for
from servo_models.diagnosis.page.stages import NOMINAL, stages
from servo_models.diagnosis.result import Diagnosis
from servo_models.diagnosis.telling import words as said
from servo_models.diagnosis.telling.cautions import cautions
from servo_models.diagnosis.verdict import NOT_IDENTIFIABLE, OUTSIDE
from servo_models.identification.page.readings import with_unit, words
from servo_models.report.parts import Count, Section, number

UNEXPLAINED = (OUTSIDE, NOT_IDENTIFIABLE)


def sentence(found: Diagnosis, experiments: Sequence[Experiment] = ()) -> str:
    """Return the verdict in one sentence, figures of the gap aside."""
    claim = capital(words(said.headline(found) + said.rivals(found)))
    return f"{claim}{said.rest(found)}{words(said.not_shown(experiments))}{said.elsewhere(found)}."


def judgement(found: Diagnosis) -> bool | None:
    """Return True if there is no gap, None if it is explained, False if it is not."""
    if found.within_tolerance:
        return True
    return False if found.verdict.kind in UNEXPLAINED else None


def counts(found: Diagnosis) -> tuple[Count, ...]:
    """Return a card for the whole gap, one for each output and one for the effects."""
    cards = [Count("gap", "gap [noise floors]", _whole(found), judgement(found))]
    cards += [Count("gap", words(gap.output), _text(found, gap), None) for gap in found.gaps]
    named = [claim for claim in found.claims if claim.in_set]
    if named:
        text = ", ".join(f"{words(claim.name)} {percent(claim.probability)}" for claim in named)
        cards.append(Count("evidence", "probability", text, None))
    return tuple(cards)


def remarks(found: Diagnosis) -> tuple[str, ...]:
    """Return what else a reader should know first."""
    count = len(cautions(found))
    if not count:
        return ()
    return (f"{count} warning{'s' * (count != 1)}: read below before using the values.",)


def warnings(found: Diagnosis) -> Section | None:
    """Return what to be careful with, None for nothing."""
    items = tuple(f"{capital(text)}." for text in cautions(found))
    return Section("warnings", "Warnings", items=items) if items else None


def percent(chance: float) -> str:
    """Return a probability as a person says it."""
    if chance > 0.995:
        return "> 99 %"
    return f"{100.0 * chance:.0f} %" if chance > 0.005 else "< 1 %"


def capital(text: str) -> str:
    """Return a text with its first letter large, names in it as they are."""
    return text[:1].upper() + text[1:]


def _whole(found: Diagnosis) -> str:
    rms = found.gap.rms
    steps = [
        number(rms[stage], 3) + (f" {name}" if name != NOMINAL else "")
        for stage, name in stages(found).items()
    ]
    share = said.closed(found.gap)
    return " → ".join(steps) + (f"; {share} of what can be closed" if share else "")


def _text(found: Diagnosis, gap: Gap) -> str:
    unit, scale = unit_for(found, gap)
    before, after = (number(gap.rms[stage] / scale, 3) for stage in ("before", "after"))
    floor = with_unit(number(gap.floor / scale, 3), unit)
    return f"{with_unit(f'{before} → {after}', unit)} RMS, noise floor {floor}"
