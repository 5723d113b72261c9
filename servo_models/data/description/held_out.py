"""Which samples no fit may see, and which count at all."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from servo_models.core.plant import unknown
from servo_models.core.types import Array, Mask
from servo_models.data.description.clock import span
from servo_models.data.description.values import quantity
from servo_models.data.toml_file import Section

LEVELS = {"odd": 0, "even": 1}


def held_out(entry: Section, since: Array, inputs: Mapping[str, Array]) -> Mask:
    """Return the samples that a log holds out, shape (n,).

    Args:
        entry: the description of the log.
        since: times since the file's first row [s], shape (n,).
        inputs: SI by name, each (n,).

    Raises:
        UserError: neither true nor false, a span of time, nor levels of an input; or a span in
            which there is no row.
    """
    given = entry.content.get("held_out", False)
    if isinstance(given, bool):
        return np.full(len(since), given)
    section = entry.section("held_out")
    if "levels" in section or "input" in section:
        section.check_keys(("input", "levels"))
        return _levels(section, inputs)
    section.check_keys(("from", "to"))
    marked = span(section, since)
    if not marked.any():
        entry.fail("held_out", f"no row inside; the log lasts from {since[0]:g} to {since[-1]:g} s")
    return marked


def skipped(entry: Section, times: Array, inputs: Mapping[str, Array]) -> Mask | None:
    """Return the samples that do not count, shape (n,), None where all do.

    ``judged = { input = "pulse_width", after_change = "0.8 s" }`` counts those within that
    time after a change of the input.

    Raises:
        UserError: another key, an unknown input, or one that never changes.
    """
    if "judged" not in entry:
        return None
    section = entry.section("judged")
    section.check_keys(("input", "after_change"))
    name = section.text("input")
    if name not in inputs:
        section.fail("input", unknown("input with a column", name, inputs))
    if "after_change" not in section:
        section.fail("after_change", 'missing; write after_change = "0.8 s"')
    span_after = quantity(section, "after_change", "s")
    changes = np.flatnonzero(np.diff(inputs[name]) != 0.0) + 1
    if not len(changes):
        section.fail("input", f"'{name}' never changes; leave out judged")
    latest = np.searchsorted(times[changes], times, side="right") - 1
    since = times - times[changes][np.maximum(latest, 0)]
    counted: Mask = (latest >= 0) & (since < span_after)
    return ~counted


def _levels(section: Section, inputs: Mapping[str, Array]) -> Mask:
    """Every second level, from where it is commanded to where the next excursion starts.

    The level of the first row is where excursions come from and belongs to none.
    """
    name, which = section.text("input"), section.text("levels")
    if name not in inputs:
        section.fail("input", unknown("input with a column", name, inputs))
    if which not in LEVELS:
        section.fail("levels", f'\'{which}\' is unknown; write "even" or "odd"')
    values = inputs[name]
    levels = np.unique(values[values != values[0]])
    if len(levels) < 2:
        section.fail("input", f"'{name}' has {len(levels)} levels to choose from; use from and to")
    starts = (np.diff(values, prepend=values[0]) != 0.0) & (values != values[0])
    latest = np.maximum.accumulate(np.where(starts, np.arange(len(values)), -1))
    chosen = np.isin(values, levels[LEVELS[which] :: 2])
    marked: Mask = (latest >= 0) & chosen[latest]
    return marked
