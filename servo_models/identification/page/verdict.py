"""The verdict: what was fitted, how far it is from the data, and what is doubtful."""

from __future__ import annotations

from collections.abc import Mapping

from servo_models.identification.page.readings import (
    in_unit,
    judged_part,
    spread_of,
    unit_among,
    with_unit,
    words,
)
from servo_models.identification.result import HELD_OUT, Identification
from servo_models.report.parts import Count, Section, number

ENDINGS = {HELD_OUT: "held-out error", "fit": "error (nothing held out)"}


def sentence(found: Identification) -> str:
    """Return the verdict in one sentence, told by the output that comes first."""
    count = len(found.free)
    fitted = f"{count} parameter{'s' * (count != 1)} of {found.fitted.actuator.name} fitted"
    output = next(iter(found.sigma))
    part = judged_part(found, output)
    return f"{fitted}: {ENDINGS[part]} of {words(output)} {_change(found, output, part)}."


def judgement(found: Identification) -> bool | None:
    """Return False if the judged error of any output grew, True if none did without a warning."""
    if any(not _better(found, output) for output in found.sigma):
        return False
    return None if found.warnings else True


def remarks(found: Identification) -> tuple[str, ...]:
    """Return what else a reader should know first."""
    said = []
    if found.warnings:
        count = len(found.warnings)
        said.append(f"{count} warning{'s' * (count != 1)}: read below before using the values.")
    fitted = [output for output in found.sigma if judged_part(found, output) != HELD_OUT]
    if fitted:
        names = ", ".join(map(words, fitted))
        said.append(
            f"No samples of {names} were held out: its error on new data is unknown. Hold out a"
            " log, or a part of one."
        )
    return tuple(said)


def counts(found: Identification, floors: Mapping[str, float]) -> tuple[Count, ...]:
    """Return a card for each output: error before and after, share of its range, floor."""
    return tuple(_count(found, output, floors.get(output)) for output in found.sigma)


def warnings(found: Identification) -> Section | None:
    """Return the warnings with their cures, None if there are none."""
    if not found.warnings:
        return None
    items = tuple(f"{text[:1].upper()}{text[1:]}." for text in found.warnings)
    return Section("warnings", "Warnings", items=items)


def _count(found: Identification, output: str, floor: float | None) -> Count:
    part = judged_part(found, output)
    spread = spread_of(found, output, part)
    after = found.rms(output, part)
    text = f"{_change(found, output, part)} RMS"
    if spread > 0.0:
        text += f", {number(100.0 * after / spread, 2)} % of its range"
    if floor is not None:
        unit, scale = unit_among(found.logs, output)
        text += f"; noise floor {in_unit(floor / scale, unit)}"
    return Count("responses", f"{words(output)}, {part}", text, _better(found, output))


def _change(found: Identification, output: str, part: str) -> str:
    unit, scale = unit_among(found.logs, output)
    before, after = (found.rms(output, part, stage) / scale for stage in ("before", "after"))
    return with_unit(f"{number(before)} → {number(after)}", unit)


def _better(found: Identification, output: str) -> bool:
    part = judged_part(found, output)
    return found.rms(output, part) <= found.rms(output, part, "before")
