"""What the audit says of synthetic sensors whose step and noise are known.

    python -m studies readings [--sensors 500] [--seed 1000]

A sensor is drawn by its seed: motion (steps, sines, rests, drift), length, one to four logs, and
a kind: ``before`` rounds motion and noise to its step, ``after`` adds noise to the codes, ``none``
has no step.  Noise is 0 to 5 steps.  What is true: its step, and what its readings are off the
motion by, root mean square over all its logs.  Floors count where they are within 15 % of it.
Limits were chosen on seeds 0 to 199.  Seeds 1000 to 1499 gave:

    false steps              0 of 500 (0.0%)
    step right, noise < 0.5  204 of 206 (99.0%)
    floor, before white      241 of 260 (92.7%); 5, 50, 95 %: 0.92, 1.00, 1.16
    floor, before coloured   18 of 48 (37.5%); 5, 50, 95 %: 0.61, 0.80, 1.10
    floor, after  white      44 of 85 (51.8%); 5, 50, 95 %: 0.07, 0.91, 1.12
    floor, after  coloured   4 of 20 (20.0%); 5, 50, 95 %: 0.40, 0.63, 1.11
    floor, none   white      53 of 55 (96.4%); 5, 50, 95 %: 0.93, 1.00, 1.10
    floor, none   coloured   0 of 5 (0.0%); 5, 50, 95 %: 0.59, 0.65, 0.67

Differences cannot show noise that is coloured, nor noise well below the codes that it was added to.
"""

from __future__ import annotations

import argparse
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from servo_models.core.types import Array
from servo_models.data.sensor import noise_floor, reading_steps

KINDS = ("before", "before", "before", "after", "none")
MEMORY = 0.5  # correlation of coloured noise from sample to sample


class Row(NamedTuple):
    kind: str
    coloured: bool
    noise: float
    false: bool
    right: bool
    floor: float


def motion(rng: np.random.Generator, kind: str, n: int) -> Array:
    """A motion of range about 1, smooth over 15 samples or more."""
    t = np.arange(n)
    if kind == "sines":
        periods = rng.uniform(60.0, 600.0, 3)
        waves = np.sin(2.0 * np.pi * (np.outer(1.0 / periods, t) + rng.random((3, 1))))
        return np.asarray(np.mean(waves, axis=0))
    if kind == "drift":
        return np.asarray(rng.uniform(0.2, 1.0) * t / n)
    hold = int(rng.integers(40, 200))
    goals = np.repeat(rng.uniform(-0.5, 0.5, n // hold + 1), hold)[:n]
    if kind == "rests":
        goals = goals * (np.repeat(np.arange(n // hold + 1) % 3, hold)[:n] == 1)
    pole = np.exp(-1.0 / rng.uniform(4.0, 15.0))
    gain = [(1.0 - pole) ** 2]
    return np.asarray(lfilter(gain, np.polymul([1.0, -pole], [1.0, -pole]), goals))


def judged(seed: int) -> Row:
    """One sensor, and what is said of it."""
    rng = np.random.default_rng(seed)
    kind, coloured = str(rng.choice(KINDS)), bool(rng.random() < 0.15)
    noise = float(rng.choice([0.0, rng.uniform(0.0, 0.5), rng.uniform(0.5, 5.0)]))
    if kind == "after":
        noise = max(noise, 0.02)
    step = 10.0 ** rng.uniform(-4.0, 1.0)
    size = step * 10.0 ** rng.uniform(1.0, 3.5)
    shape = str(rng.choice(["steps", "sines", "rests", "drift"]))
    records, errors = [], []
    for _ in range(int(rng.integers(1, 5))):
        n = int(10.0 ** rng.uniform(2.0, 3.8))
        smooth = size * motion(rng, shape, n) + step * rng.uniform(-100.0, 100.0)
        white = rng.standard_normal(n + 200)
        memory = MEMORY if coloured else 0.0
        rough = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white)[200:]
        error = noise * step * rough
        if kind == "before":
            read = step * np.round((smooth + error) / step)
        else:
            read = (step * np.round(smooth / step) if kind == "after" else smooth) + error
        records.append(read)
        errors.append(read - smooth)
    off = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
    found = reading_steps(records)
    sizes = np.array([one.size for one in found])
    own = np.abs(sizes / step - 1.0) < 0.01
    floors = [
        noise_floor(read, one.size, np.zeros((len(read), 1))).value
        for one, read in zip(found, records)
    ]
    lengths = [len(read) for read in records]
    pooled = float(np.sqrt(np.average(np.square(floors), weights=lengths)))
    false = bool(np.any((sizes > 0.0) & (~own if kind != "none" else True)))
    return Row(kind, coloured, noise, false, bool(own.all()), pooled / off if off else np.nan)


def table(rows: list[Row]) -> str:
    """The shares, each with its denominator."""

    def share(hits: list[bool]) -> str:
        return f"{sum(hits)} of {len(hits)} ({np.mean(hits):.1%})" if hits else "none"

    clear = [one for one in rows if one.kind == "before" and one.noise < 0.5]
    lines = [
        f"false steps              {share([one.false for one in rows])}",
        f"step right, noise < 0.5  {share([one.right for one in clear])}",
    ]
    for kind in ("before", "after", "none"):
        for coloured in (False, True):
            own = [it for it in rows if it.kind == kind and it.coloured is coloured]
            own = [it for it in own if it.noise > 0.0 or kind == "before"]
            near = [abs(it.floor - 1.0) <= 0.15 for it in own]
            ratios = np.percentile([it.floor for it in own], [5, 50, 95]) if own else ()
            told = ", ".join(f"{it:.2f}" for it in ratios)
            colour = "coloured" if coloured else "white"
            lines.append(f"floor, {kind:6} {colour:8}   {share(near)}; 5, 50, 95 %: {told}")
    return "\n".join(lines)


def main() -> None:
    """Draw, judge, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sensors", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1000)
    asked = parser.parse_args()
    print(table([judged(asked.seed + i) for i in range(asked.sensors)]))


if __name__ == "__main__":
    main()
