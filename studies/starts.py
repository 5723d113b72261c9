"""Is it found how a log begins, and are identified values as good as with the start given?

Logs are simulated by the model itself: actuator, command, noise (0.2 % of the range) and how it
begins come from the seed.  *rest*: at rest.  *settled*: the first row had been held.  *stepped*:
another command had been held, and row 0 steps.  *moving*: cut out of a longer motion.  *released*:
the shaft stands away from rest, no command.  Nothing but the readings says which.  A motor that is
free to turn settles nowhere: *settled* and *stepped*, it spins as the log begins, and *released*
it coasts.

A start that is found is *right* where the true model, so begun, meets the first part of the log to
1.2 times its noise.  It is sought with the true parameters, and with one of them off by 20 %.  From
there that parameter is identified, with the start that is found and with the true one; its errors
are told in percent of its value.

Run: ``python -m studies starts [--logs 200] [--seed 50000]``.  Seeds below 50000 were used
to develop.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from servo_models import model
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Channel, Log, Start
from servo_models.identification.fit import fit
from servo_models.identification.simulation import prepared
from servo_models.identification.starts import with_starts
from servo_models.withheld.score import share

ACTUATORS = {
    ("sg90", "measured"): "amplifier_gain",
    ("smart_servo", "xl330"): "resistance",
    ("smart_servo", "sts3215"): "resistance",
    ("second_order_servo", "pulse"): "natural_frequency",
    ("dc_motor", "geared"): "torque_constant",
    ("dc_motor_current", "direct"): "torque_constant",
    ("dc_motor_speed", "direct"): "torque_constant",
    ("torque_motor", "measured"): "stiffness",
    ("linear_drive", "identified"): "mass",
}
"""With the parameter that is off, and identified."""
WAYS = ("rest", "settled", "stepped", "moving", "released")
NOISE = 2e-3  # of the range of the angle
RIGHT = 1.2  # noise that is left where a start is right
OFF = 1.2  # nominal value over the true one
AT_REST = 1e-3  # of full scale: a first row that counts as at rest


@dataclass(frozen=True)
class Case:
    """A log, its true start, and its noise [SI]."""

    way: str
    true: Model
    log: Log
    begun: Log
    noise: float


def drawn(random: np.random.Generator, true: Model, way: str) -> Case:
    """Return a log that begins in one of the ways."""
    name, size = true.actuator.step
    wire = true.plant.wire[name]
    rest, hold = float(wire.rest), true.stop_time
    step = hold / 200.0 * random.choice([1.0, 2.0])
    count, before = int(random.integers(300, 700)), int(random.integers(50, 200))
    command = rest + (size - rest) * shape(random, count + before)
    whole, start = command[before:], Start()
    if way == "rest":
        whole[: random.choice([1, 20])] = rest
    elif way == "settled":
        whole[: random.integers(2, 30)] = whole[0]
    elif way == "stepped":
        start = Start(before={name: rest + (size - rest) * random.uniform(-1.0, 1.0)})
    elif way == "released":
        whole[:] = rest
    assert true.shaft
    angle, rate = true.shaft.angle, true.shaft.rate
    state, since = true.at_rest(true.vector), 0.0
    if way in ("settled", "stepped", "released"):
        since = 3.0 * hold
        held = np.full(2, start.before.get(name, whole[0]))
        played(true, np.array([0.0, since]), held, state)
    elif way == "moving":
        since = step * before
        played(true, step * np.arange(before + 1), command[: before + 1], state)
    motion, free = motion_of(true, state), turns_on(true)
    if way == "released":
        far = random.uniform(0.1, 0.5) * random.choice([-1.0, 1.0])
        sizes = {name: far * true.plant.wire[name].scale for name in (angle, rate)}
        start = Start({**motion, **sizes} if free else {**motion, **sizes, rate: 0.0})
        true.shaft.place(state, start.shaft)
    elif way == "moving" or (free and way in ("settled", "stepped")):
        start = Start(motion)
    out = played(true, since + step * np.arange(count), whole, state)
    clean = out[:, true.plant.outputs.index(angle)]
    noise = NOISE * float(np.ptp(clean))
    log = Log(
        name=way,
        path=Path("log.csv"),
        sha256="",
        times=step * np.arange(count),
        inputs={name: whole},
        outputs={angle: clean + noise * random.standard_normal(count)},
        channels={it: Channel(it, it, "") for it in (name, angle)},
        rows=np.arange(count),
        held_out=np.zeros(count, dtype=bool),
        settle=min(hold, step * (count - 1))
        if abs(whole[0] - rest) > AT_REST * wire.scale
        else 0.0,
        assumed=True,
    )
    told = start if start.shaft or start.before else None
    begun = replace(log, assumed=False, start=told, settle=0.0 if way == "rest" else hold)
    return Case(way, true, log, begun, noise)


def turns_on(true: Model) -> bool:
    """Whether the shaft goes on turning while a command is held."""
    state, (_, size) = true.at_rest(true.vector), true.actuator.step
    played(true, np.array([0.0, 3.0 * true.stop_time]), np.full(2, size), state)
    assert true.shaft
    rate = motion_of(true, state)[true.shaft.rate]
    return abs(rate) > AT_REST * true.plant.wire[true.shaft.rate].scale


def motion_of(true: Model, state: Array) -> dict[str, float]:
    """Where the shaft of a state is, how fast it turns [SI], and what else it carries on."""
    shaft = true.shaft
    assert shaft
    return {
        shaft.angle: float(state[shaft.angles[0]]),
        shaft.rate: float(state[shaft.speeds[0]]) * shaft.rate_over_speed,
        **{name: float(state[place]) for name, place in shaft.carried.items()},
    }


def shape(random: np.random.Generator, count: int) -> Array:
    """A command between -1 and 1: steps, a sine or a triangle."""
    phase = np.arange(count) / count
    kind, waves = random.integers(3), random.uniform(1.0, 5.0)
    if kind == 0:
        levels = random.uniform(-1.0, 1.0, random.integers(3, 7))
        return np.asarray(levels[(phase * len(levels)).astype(int)])
    swing = np.sin(2.0 * np.pi * waves * phase)
    return random.uniform(0.4, 1.0) * (swing if kind == 1 else 2.0 / np.pi * np.arcsin(swing))


def played(true: Model, times: Array, command: Array, state: Array) -> Array:
    """All outputs of a command, other inputs at rest; ``state`` goes on."""
    name = true.actuator.step[0]
    columns = [
        command if wire.name == name else np.full(len(times), float(wire.rest))
        for wire in true.plant.inputs
    ]
    return true.ran(true.vector, state, times, np.column_stack(columns))


def left(case: Case, log: Log) -> float:
    """Noise [RMS] that the true model leaves in the first part, begun as a log says."""
    (errors,) = (prepared(case.true, log).outputs({})[:, 0] - one for one in log.outputs.values())
    early = log.times <= case.true.stop_time
    return float(np.sqrt(np.mean(errors[early] ** 2))) / case.noise


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--logs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=50000)
    given = parser.parse_args()
    names = dict.fromkeys(name for name, _ in ACTUATORS)
    rows: dict[str, list[tuple[bool, bool, float, float]]] = {
        key: [] for key in ("all", *names, *WAYS)
    }
    for number in range(given.logs):
        random = np.random.default_rng([given.seed, number])
        (name, variant), parameter = list(ACTUATORS.items())[number % len(ACTUATORS)]
        way = WAYS[number // len(ACTUATORS) % len(WAYS)]
        true = model(name, variant)
        case = drawn(random, true, way)
        wrong = replace(true, values={**true.values, parameter: OFF * true.values[parameter]})
        right = [left(case, *with_starts(one, [case.log])) < RIGHT for one in (true, wrong)]
        errors = [
            100.0 * abs(fit(wrong, [log], [parameter]).values[0] / true.values[parameter] - 1.0)
            for log in (case.log, case.begun)
        ]
        for key in ("all", name, way):
            rows[key].append((right[0], right[1], errors[0], errors[1]))
    print(table(rows))


def table(rows: dict[str, list[tuple[bool, bool, float, float]]]) -> str:
    """The figures of all logs, of each actuator and of each way."""
    lines = [
        "logs | right, true parameters | right, one off by 20 %"
        " | error found start [%], median, 90 % | error true start [%], median, 90 %"
    ]
    for key, found in rows.items():
        right, rough, ours, theirs = zip(*found)
        lines.append(
            f"{key} | {_share(right)} | {_share(rough)} | {_spread(ours)} | {_spread(theirs)}"
        )
    return "\n".join(lines)


def _share(flags: Sequence[bool]) -> str:
    found = share(flags)
    return f"{found.value:.3f} ({found.low:.3f} to {found.high:.3f}) of {found.n}"


def _spread(errors: Sequence[float]) -> str:
    return "{:.2g}, {:.2g}".format(*np.percentile(errors, [50.0, 90.0]))


if __name__ == "__main__":
    main()
