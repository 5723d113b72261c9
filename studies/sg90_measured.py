"""What a real SG90's steps say, what else they might say, and what they cannot say.

The description in ``examples/real_logs`` is fitted to every second amplitude and scored on the
others, then again with further effects, and with the servo's 20 ms frame.

    SERVO_MODELS_DATA=LOGS python -m studies sg90_measured

LOGS is the folder of the measured logs, which are no part of the repository; default: the one
of the examples.  It prints the tables of ``docs/studies/sg90_measured.md`` and draws its first
figure (about three minutes).
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.description import Description, read_description
from servo_models.data.log import Log
from servo_models.identification.fit import fit
from servo_models.identification.problem import Problem
from servo_models.identification.result import FIT, HELD_OUT, Identification
from servo_models.report.style import colour, drawing

if TYPE_CHECKING:
    from matplotlib.figure import Figure


ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples" / "real_logs"
FIGURES = ROOT / "docs" / "studies"
RATE, ANGLE, PULSE = "rate_reading", "angle_reading", "pulse_width"
FURTHER = {
    "dead zone of the drive": ["drive_dead_zone.half_width"],
    "Coulomb friction": ["coulomb_friction.level"],
    "asymmetry of the directions": ["direction_asymmetry.ratio"],
    "constant load": ["constant_load.torque"],
    "gravity on the horn": ["gravity_load.torque", "gravity_load.phase"],
    "lag of the gyro": ["gyro_lag.time_constant"],
}
"""Effects that are tried beside drive saturation and delay."""
TRIED = 2000  # permutations that judge whether arrivals keep a clock
WIDE, NARROW = np.arange(49.75, 50.25, 2e-4), np.arange(49.95, 50.05, 2e-4)
"""Frequencies of frames around 20 ms [Hz].  A command comes every 2.004 s, and an amplitude is
fitted every 8 s, so that the clock shows up again 0.5 and 0.125 Hz farther."""
JUDGED = 0.8  # time [s] after a command in which errors count
DRAWN = (15, 55, 125)  # held-out amplitudes [deg] that are drawn


def described(name: str) -> Description:
    """A description of the examples, its logs in the folder that was told."""
    folder = Path(os.environ.get("SERVO_MODELS_DATA", EXAMPLES / "logs")).resolve().as_posix()
    text = (EXAMPLES / name).read_text(encoding="utf-8").replace('"logs/', f'"{folder}/')
    with tempfile.TemporaryDirectory() as made:
        path = Path(made) / name
        path.write_text(text, encoding="utf-8")
        return read_description(path)


def counts(found: Identification, part: str, stage: str = "after") -> float:
    """RMS error in the numbers of the log."""
    return found.rms(RATE, part, stage) / abs(found.logs[0].channels[RATE].scale)


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table in Markdown."""
    print(f"\n| {' | '.join(columns)} |\n{'|---' * len(columns)}|")
    for row in rows:
        print(f"| {' | '.join(row)} |")


def commands(log: Log) -> NDArray[np.int64]:
    """Samples at which the pulse changes."""
    return np.flatnonzero(np.diff(log.inputs[PULSE])) + 1


def degrees(log: Log) -> Array:
    """Size of every commanded step [deg], signed."""
    change = np.diff(log.inputs[PULSE])[commands(log) - 1]
    sizes: Array = np.round(change / (2400e-6 - 544e-6) * 180.0)
    return sizes


def excursions(log: Log) -> Iterator[tuple[int, NDArray[np.bool_]]]:
    """Commanded amplitude [deg] and the judged samples of the steps there and back."""
    first, sizes = commands(log), degrees(log)
    for amplitude in np.unique(np.abs(sizes)):
        mask = np.zeros(len(log.times), dtype=bool)
        for k in first[np.abs(sizes) == amplitude]:
            mask |= (log.times >= log.times[k]) & (log.times < log.times[k] + JUDGED)
        yield int(amplitude), mask


def errors(found: Identification, log: Log) -> Array:
    """Simulated minus measured in counts, at the samples of ``log``."""
    own = np.isin(found.logs[0].times, log.times)
    simulated: Array = found.after[0][RATE][own]
    return (simulated - log.outputs[RATE]) / abs(log.channels[RATE].scale)


def by_amplitude(found: Identification, log: Log) -> dict[int, float]:
    """RMS error in counts by held-out amplitude [deg]."""
    error = errors(found, log)
    return {
        amplitude: float(np.sqrt(np.mean(error[mask] ** 2)))
        for amplitude, mask in excursions(log)
        if np.all(log.held_out[mask])
    }


def estimates(found: Identification, names: Sequence[str]) -> str:
    every = {f.name: (v, e) for f, v, e in zip(found.free, found.values, found.standard_errors)}
    return ", ".join(f"{n} = {every[n][0]:.3g} ± {every[n][1]:.1g}" for n in names) or "-"


def first_fit(told: Description) -> Identification:
    """Fit and tables of the model of the variant."""
    found = fit(told.model, told.logs, told.free)
    rows = [
        (
            free.name,
            f"{value:.4g}",
            f"{error:.2g}",
            told.model.plant.parameters[free.name].param.unit,
        )
        for free, value, error in zip(found.free, found.values, found.standard_errors)
    ]
    table(("parameter", "estimate", "standard error", "SI unit"), rows)
    one = abs(told.logs[0].channels[RATE].scale)
    gyro = 1.0 + dict(zip((f.name for f in found.free), found.values))["gyro_gain.error"]
    print(f"\nA count is {np.degrees(one / gyro):.3g} deg/s.")
    each = by_amplitude(found, told.logs[0])
    scores = (f"{value:.2f}" for value in (*each.values(), counts(found, HELD_OUT)))
    table(("held-out amplitude [deg]", *map(str, each), "all"), [("RMS [counts]", *scores)])
    return found


def compared(name: str, found: Identification, best: Identification, extra: str) -> list[str]:
    """A row of what else was tried."""
    old, new = (by_amplitude(each, best.logs[0]) for each in (best, found))
    better = sum(new[key] < old[key] for key in old)
    scores = [f"{counts(found, part):.3f}" for part in (FIT, HELD_OUT)]
    return [name, extra, *scores, f"{better} of {len(old)}"]


def with_effect(
    chosen: Model, logs: Sequence[Log], free: Sequence[str], more: Sequence[str]
) -> Identification:
    """Fit from several starts: dead zone and friction have minima that are no best ones."""
    return fit(chosen, logs, [*free, *more], starts=5, seed=1)


def tried(told: Description, base: Identification) -> list[list[str]]:
    """Without saturation or delay, then with one effect more."""
    rows = [["saturation and delay", "-", *(f"{counts(base, p):.3f}" for p in (FIT, HELD_OUT)), ""]]
    less = {"no drive saturation": "supply_limit.share", "no delay": "transport_delay.time"}
    for name, parameter in less.items():
        chosen = replace(told.model, values={**told.model.values, parameter: 0.0})
        free = [other for other in told.free if other != parameter]
        rows.append(compared(name, fit(chosen, told.logs, free), base, "-"))
    for name, more in FURTHER.items():
        found = with_effect(told.model, told.logs, told.free, more)
        rows.append(compared(name, found, base, estimates(found, more)))
    return rows


def arrivals(found: Identification, chosen: NDArray[np.int64]) -> Array:
    """By how much [s] the horn is late against the fitted model, step by step."""
    log = found.logs[0]
    simulated, measured = found.after[0][RATE], log.outputs[RATE]
    late = np.arange(-0.025, 0.025, 5e-4)
    best = []
    for k in chosen:
        part = slice(k - 5, k + 75)
        times = log.times[part]
        shifted = np.interp(times[None, :] - late[:, None], log.times, simulated)
        best.append(late[np.argmin(np.sum((shifted - measured[part]) ** 2, axis=1))])
    return np.array(best)


def clustering(times: Array, up: NDArray[np.bool_], frequencies: Array) -> Array:
    """Rayleigh's mean resultant length by frequency, each direction with a phase of its own."""
    turns = np.exp(2j * np.pi * times[:, None] * frequencies)
    return np.asarray(np.abs(turns[up].sum(0)) + np.abs(turns[~up].sum(0))) / len(times)


def clock(base: Identification) -> float:
    """Period [s] of the frame that the arrivals of the fitted steps keep; print the evidence."""
    log = base.logs[0]
    every, rising = commands(log), degrees(log) > 0.0
    at, late = log.times[every], arrivals(base, every)
    seen = ~log.held_out[every]
    random = np.random.default_rng(1)

    def period(chosen: NDArray[np.bool_], frequencies: Array, what: str) -> float:
        times, waits, up = at[chosen], late[chosen], rising[chosen]
        found = clustering(times + waits, up, frequencies)
        shuffled = [
            clustering(times + random.permutation(waits), up, frequencies).max()
            for _ in range(TRIED)
        ]
        best = 1.0 / frequencies[np.argmax(found)]
        print(
            f"\nArrivals of {what} cluster at a period of {1e3 * best:.4f} ms, resultant"
            f" {found.max():.2f}; of {TRIED} shuffled sets {np.sum(shuffled >= found.max())} reach"
            f" that, the largest {np.max(shuffled):.2f}."
        )
        return float(best)

    period(np.full(len(every), True), WIDE, "all steps, searched from 19.9 to 20.1 ms,")
    period(seen, WIDE, "the fitted steps, searched as widely,")
    return period(seen, NARROW, "the fitted steps, searched from 19.98 to 20.02 ms,")


def framed(log: Log, period: float, phase: float) -> Log:
    """The log as a servo sees it that takes a command at its next tick, on rows put in there."""
    every = commands(log)
    ticks = phase + period * np.ceil((log.times[every] - phase) / period)
    times = np.union1d(log.times, ticks)
    rows = np.searchsorted(log.times, times, side="right") - 1
    pulses = np.append(log.inputs[PULSE][0], log.inputs[PULSE][every])
    added = ~np.isin(times, log.times)
    return replace(
        log,
        times=times,
        inputs={PULSE: pulses[np.searchsorted(ticks, times, side="right")]},
        outputs={RATE: np.interp(times, log.times, log.outputs[RATE])},
        rows=log.rows[rows],
        held_out=log.held_out[rows],
        skipped=log.skipped[rows] | added if log.skipped is not None else added,
    )


def in_frame(told: Description, base: Identification) -> list[list[str]]:
    """Rows of the servo's frame, its phase chosen on the fitted amplitudes."""
    log, period = told.logs[0], clock(base)
    logs = [framed(log, period, phase) for phase in np.arange(0.0, period, 1e-3)]
    fits = [fit(told.model, [each], told.free) for each in logs]
    best = int(np.argmin([counts(each, FIT) for each in fits]))
    beside = [f"{counts(fits[(best + k) % len(fits)], HELD_OUT):.2f}" for k in (-1, 1)]
    print(f"\nThe phase is {best} ms; 1 ms beside it {' and '.join(beside)} counts held out.")
    rows = [
        compared("20 ms frame", fits[best], base, estimates(fits[best], ["transport_delay.time"]))
    ]
    for name, more in FURTHER.items():
        found = with_effect(told.model, [logs[best]], told.free, more)
        rows.append(compared(f"frame, {name}", found, base, estimates(found, more)))
    return rows


def invariances(found: Identification) -> None:
    """Changes that leave every reading as it is."""
    values = found.fitted.values
    base = Problem(found.fitted, found.logs, []).responses(np.empty(0))[0][RATE]
    gyro = (1.0 + values["gyro_gain.error"]) / 1.1 - 1.0
    cases: dict[str, dict[str, float]] = {
        "gear ratio and motor gain x 1.1": {"gear_ratio": 1.1, "motor_gain": 1.1},
        "K_f x 2, potentiometer / 2": {"feedback_coefficient": 2.0, "potentiometer_gain": 0.5},
        "decoder and potentiometer x 1.1, amplifier / 1.1": {
            "reference_voltage": 1.1,
            "potentiometer_gain": 1.1,
            "amplifier_gain": 1.0 / 1.1,
        },
        "degrees per pulse and motor gain x 1.1, gyro scale / 1.1": {
            "motor_gain": 1.1,
            "potentiometer_gain": 1.0 / 1.1,
            "gyro_gain.error": gyro / values["gyro_gain.error"],
        },
    }
    rows = []
    scale = abs(found.logs[0].channels[RATE].scale)
    for name, factors in cases.items():
        changed = {key: factor * values[key] for key, factor in factors.items()}
        other = replace(found.fitted, values={**values, **changed})
        moved = Problem(other, found.logs, []).responses(np.empty(0))[0][RATE] - base
        rows.append((name, f"{np.abs(moved).max() / scale:.1g}"))
    table(("what changes", "largest change of a reading [counts]"), rows)


def save(figure: Figure, name: str) -> None:
    """Write a figure of the study, the same bytes from the same numbers."""
    path = FIGURES / f"{name}.svg"
    figure.savefig(path, facecolor=colour("paper"), metadata={"Date": None})


def draw(found: Identification) -> None:
    """Measured and simulated readings of a few held-out steps up."""
    log = found.logs[0]
    scale = abs(log.channels[RATE].scale)
    starts = dict(zip(degrees(log), commands(log)))
    with drawing(rows=len(DRAWN), height=5.0) as (figure, every):
        for axes, amplitude in zip(every, DRAWN):
            part = slice(starts[amplitude] - 4, starts[amplitude] + 60)
            times = log.times[part] - log.times[starts[amplitude]]
            axes.plot(times, log.outputs[RATE][part] / scale, ".", color=colour("ink"))
            axes.plot(times, found.after[0][RATE][part] / scale, color=colour("blue"), lw=1.2)
            axes.set_ylabel("gyro [counts]")
            axes.annotate(
                f"0 to {amplitude} degrees",
                (0.98, 0.85),
                xycoords="axes fraction",
                ha="right",
                color=colour("ink"),
                fontsize=8.5,
            )
        every[-1].set(xlabel="time since the command [s]", xlim=(-0.05, 0.65))
        save(figure, "sg90_measured_steps")


def main() -> None:
    told = described("sg90_steps.toml")
    found = first_fit(told)
    draw(found)
    invariances(found)
    columns = ("model", "what it adds [SI]", "RMS fitted", "RMS held out", "better at")
    table(columns, tried(told, found) + in_frame(told, found))


if __name__ == "__main__":
    main()
