"""Faults of a recording: what a case of the tier *rough* has beside white noise.

*uneven*: a command is sent, and a row logged, every one to three periods.  *dropped*: rows that
were played are missing, several in a row.  *coarse*: the judged reading and the command are logged
in steps.  *arrival*: rows are stamped when they arrive, in order, each after another delay.
*glitches*: single readings are far off.  *prior*: one true constant is two to four standard
deviations from its nominal value.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from servo_models.withheld.generator.simulation import Plan
from servo_models.withheld.rig.laws import Array

UNEVEN, DROPPED, COARSE, ARRIVAL, GLITCHES, PRIOR = FAULTS = (
    "uneven",
    "dropped",
    "coarse",
    "arrival",
    "glitches",
    "prior",
)
MOST = 2  # faults of a case
PERIODS = (1, 2, 3)  # from one uneven row to the next
LOST = (0.02, 0.08)  # share of the rows that are dropped
LONGEST_LOSS = 8  # rows
READING_STEP = (3.0, 8.0)  # step of a coarse reading, over its noise
COMMAND_STEP = (0.001, 0.004)  # step of a coarse command, over its range
DELAY = (0.1, 0.5)  # mean delay of an arrival, in periods
HANDLING = 0.02  # least time between two arrivals, in periods
WILD = (0.001, 0.005)  # share of the readings that are glitches; each log has one
GLITCH = (0.3, 1.0)  # size of a glitch, over the range of the reading
FAR = (2.0, 4.0)  # distance of a true constant from its nominal value, in standard deviations


def draw_faults(rng: np.random.Generator) -> tuple[str, ...]:
    """Draw the faults of a case, one or two, in the order of ``FAULTS``."""
    drawn = rng.choice(FAULTS, int(rng.integers(1, MOST + 1)), replace=False)
    return tuple(fault for fault in FAULTS if fault in drawn)


def logged(plan: Plan, faults: tuple[str, ...], rng: np.random.Generator) -> Plan:
    """Return a plan of which these faults let some rows be logged."""
    count = len(plan.command)
    rows = plan.logged
    if UNEVEN in faults:
        steps = rng.choice(PERIODS, count)
        rows = np.concatenate([[0], np.cumsum(steps)])
        rows = rows[rows < count]
        played = rows[np.searchsorted(rows, np.arange(count), side="right") - 1]
        load = None if plan.load is None else plan.load[played]
        plan = replace(plan, command=plan.command[played], load=load)
    if DROPPED in faults:
        kept = np.ones(len(rows), dtype=bool)
        least = (1.0 - rng.uniform(*LOST)) * len(rows)
        while kept.sum() > least:
            first = int(rng.integers(1, len(rows)))
            kept[first : first + int(rng.integers(1, LONGEST_LOSS + 1))] = False
        rows = rows[kept]
    return replace(plan, rows=rows)


def arrivals(rows: NDArray[np.int64], rng: np.random.Generator) -> Array:
    """Return when rows arrive, in periods, strictly rising."""
    late = rows + rng.exponential(rng.uniform(*DELAY), len(rows))
    handled = HANDLING * np.arange(len(rows))
    return np.asarray(np.maximum.accumulate(late - handled) + handled)


def with_glitches(log: Array, size: float, rng: np.random.Generator) -> Array:
    """Return a log of which a few judged readings are off by a share of ``size``, either way."""
    count = max(1, round(rng.uniform(*WILD) * len(log)))
    where = rng.choice(len(log), count, replace=False)
    wild = log.copy()
    wild[where, 0] += rng.choice([-1.0, 1.0], count) * rng.uniform(*GLITCH, count) * size
    return wild
