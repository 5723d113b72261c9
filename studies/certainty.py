"""Is what the commands are sure of true, with steps, holds and friction in the loop?

Logs are simulated by the model itself, with white noise of a known size: free parameters, their
truth, the command and what is rough come from the seed.  Half of the cases free a group of
parameters that is exactly degenerate, known from the equations of the plant: ``GROUPS`` says for
each how its members scale, and every case confirms that so scaled they change no output.  The
others free parameters that the log determines.

The table gives, for each actuator and command: how often value +- 1.96 standard errors holds the
truth, how wide that is over the scatter of the estimates, how many groups are told, how many other
parameters are called degenerate, and how many printed values have digits beyond their error.

Run: ``python -m studies certainty [--logs 200] [--diagnoses 40] [--seed 50000]``.  Seeds
below 50000 were used to develop.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from servo_models import check, describe, diagnose, identify, model, simulate
from servo_models.analysis.explain import display_scale
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.description import Description
from servo_models.identification.doubts import PRIOR_ONLY
from servo_models.report.numbers import Quantity, with_error

SAMPLES = 500
NORMAL_95 = 1.96  # half width of the 95 % interval of a normal number, in standard deviations
PRIOR_SHARE = 0.2
"""Prior standard deviation of every free parameter over its nominal value, for diagnose."""
FARTHEST = 2.0  # prior deviations that a truth lies from nominal at most


@dataclass(frozen=True)
class Rig:
    """What is drawn for an actuator.

    Attributes:
        variant: with its nominal values.
        command, amplitude, output: input, its size [SI], and what is logged.
        step: between samples [s].
        rest: value of the command around which it moves [SI].
        base: parameters that every case has.
        free: parameters that a log determines, together.
        rough: what makes slopes rough, each with the values to draw from [SI].
        friction: the dry friction, with the values to draw from.
        groups: exponents by which members scale together and change nothing, each with other
            parameters that logs determine beside them; ``FRICTION`` is a member only where
            friction is on.
    """

    variant: str
    command: str
    amplitude: float
    outputs: tuple[str, ...]
    step: float
    free: tuple[str, ...]
    rough: dict[str, tuple[float, ...]]
    friction: tuple[float, ...]
    groups: tuple[tuple[dict[str, float], tuple[str, ...]], ...]
    rest: float = 0.0
    shapes: tuple[str, ...] = ("steps", "chirp", "ramps", "sines")
    base: dict[str, float] = field(default_factory=dict)


SMOOTH = ("chirp", "ramps", "sines")  # commands of a stiff loop, which a step throws to its limits
FRICTION = "coulomb_friction.level"
RIGS = {
    "sg90": Rig(
        variant="measured",
        command="pulse_width",
        amplitude=4e-4,
        outputs=("angle",),
        step=4e-3,
        rest=1.5e-3,
        base={"supply_limit.share": 0.0},
        free=("motor_time_constant", "motor_gain", "potentiometer_gain"),
        rough={
            "sensor_quantisation.step": (5.0 / 1024.0, 5.0 / 256.0),
            "sample_hold.period": (0.01, 0.02),
        },
        friction=(0.005, 0.02),
        groups=(
            (
                {"feedback_coefficient": 1.0, "potentiometer_gain": -1.0},
                ("motor_time_constant", "motor_gain"),
            ),
            ({"reference_voltage": 1.0, "frame_time": 1.0}, ("motor_time_constant", "motor_gain")),
            (
                {"motor_gain": 1.0, "amplifier_gain": -1.0},
                ("motor_time_constant", "potentiometer_gain"),
            ),
        ),
    ),
    "torque_motor": Rig(
        variant="measured",
        command="voltage",
        amplitude=15.0,
        outputs=("angle",),
        step=1e-3,
        base={"end_stops.half_range": 0.0},
        free=("torque_constant", "inductance", "friction_coefficient"),
        rough={
            "command_quantisation.step": (0.1, 0.5),
            "sample_hold.period": (1e-3, 2e-3),
            "sensor_quantisation.step": (1e-4, 5e-4),
        },
        friction=(0.001, 0.003),
        groups=(
            (
                {"resistance": 1.0, "inductance": 1.0, "torque_constant": 1.0},
                ("friction_coefficient",),
            ),
            (
                {
                    "torque_constant": 1.0,
                    "stiffness": 1.0,
                    "rotor_inertia": 1.0,
                    "friction_coefficient": 1.0,
                    FRICTION: 1.0,
                },
                ("inductance",),
            ),
        ),
    ),
    "linear_drive": Rig(
        variant="simple",
        command="reference",
        amplitude=0.0005,
        shapes=SMOOTH,
        outputs=("position", "drive"),
        step=4e-3,
        free=("mass", "viscous_coefficient"),
        rough={"sensor_quantisation.step": (2e-6, 1e-5), "sample_time": (1e-3, 2e-3)},
        friction=(10.0, 25.0),
        groups=(
            (
                {"mass": 1.0, "viscous_coefficient": 1.0, "force_gain": 1.0, FRICTION: 1.0},
                (),
            ),
        ),
    ),
    "smart_servo": Rig(
        variant="sts3215",
        command="goal",
        amplitude=0.6,
        outputs=("angle_reading",),
        step=5e-3,
        base={"sensor_quantisation.step": 0.0, "sample_hold.period": 0.0},
        free=("torque_constant", "loop_factor"),
        rough={
            "sensor_quantisation.step": (2.0 * np.pi / 4096.0, 2.0 * np.pi / 1024.0),
            "sample_hold.period": (1e-3, 5e-3),
        },
        friction=(0.03, 0.1),
        groups=(
            ({"inertia": 1.0, "resistance": -1.0, FRICTION: 1.0}, ("torque_constant",)),
            ({"gain": 1.0, "loop_factor": -1.0}, ("torque_constant",)),
        ),
    ),
}
EXACT = 0.02
"""Change of an output over its scatter, by rounding that steps and friction amplify, up to which a
group is exactly degenerate."""
BLIND = 1e3  # standard error over the value from which nothing is known of a parameter
NOISE = (1e-3, 1e-2)  # least and largest standard deviation of the noise over that of the output


@dataclass(frozen=True)
class Case:
    """One log with what is known of it.

    Attributes:
        truth: the model that made it.
        nominal: the model that is told.
        free: what is estimated.
        group: members of the exactly degenerate group among them, none in half of the cases.
        rough: whether steps, holds or friction are on.
    """

    rig: Rig
    truth: Model
    nominal: Model
    free: tuple[str, ...]
    group: tuple[str, ...]
    rough: bool
    times: Array
    command: Array
    reading: Array

    @property
    def identifiable(self) -> tuple[str, ...]:
        return tuple(name for name in self.free if name not in self.group)


def drawn(actuator: str, seed: int) -> Case:
    """Return the case of a seed."""
    rig, random = RIGS[actuator], np.random.default_rng((seed, *actuator.encode()))
    values = dict(rig.base)
    rough = bool(random.random() < 0.67)
    if rough:
        for name, sizes in rig.rough.items():
            if random.random() < 0.7:
                values[name] = float(random.choice(sizes))
        if random.random() < 0.5:
            values[FRICTION] = float(random.choice(rig.friction))
    rough = len(values) > len(rig.base)
    nominal = model(actuator, rig.variant, values)
    exponents, beside = _group(rig, values, random) if random.random() < 0.5 else ({}, rig.free)
    free = [name for name in beside if random.random() < 0.7] or list(beside[:1])
    if FRICTION in values and not exponents and random.random() < 0.5:
        free.append(FRICTION)
    free = list(dict.fromkeys([*exponents, *free]))
    away = {n: np.clip(random.standard_normal(), -FARTHEST, FARTHEST) for n in free}
    truth = model(
        actuator,
        rig.variant,
        {**values, **{n: nominal.values[n] * (1.0 + PRIOR_SHARE * z) for n, z in away.items()}},
    )
    times: Array = rig.step * np.arange(float(SAMPLES))
    command: Array = rig.rest + rig.amplitude * _shape(str(random.choice(rig.shapes)), random)
    exact = _simulated(truth, rig, times, command)
    if exponents:
        scaled = {n: truth.values[n] * 1.07**e for n, e in exponents.items()}
        other = model(actuator, rig.variant, {**truth.values, **scaled})
        moved = _simulated(other, rig, times, command) - exact
        still = np.mean(moved**2, axis=0) < EXACT**2 * np.var(exact, axis=0)
        assert still.all(), f"{actuator}, seed {seed}: {exponents} change the output"
    size = np.std(exact, axis=0) * np.exp(random.uniform(*np.log(NOISE)))
    reading: Array = exact + size * random.standard_normal(exact.shape)
    return Case(rig, truth, nominal, tuple(free), tuple(exponents), rough, times, command, reading)


def _simulated(chosen: Model, rig: Rig, times: Array, command: Array) -> Array:
    """What is logged, without noise, shape (n, outputs)."""
    found = simulate(chosen, times, {rig.command: command})
    return np.column_stack([found[name] for name in rig.outputs])


def _group(
    rig: Rig, values: dict[str, float], random: np.random.Generator
) -> tuple[dict[str, float], tuple[str, ...]]:
    """A degenerate group and what is free beside it; friction belongs to it where it is on.

    A group that no friction is part of may lie beside one, which stays as it is.
    """
    chosen, beside = rig.groups[int(random.integers(len(rig.groups)))]
    return {name: e for name, e in chosen.items() if name != FRICTION or FRICTION in values}, beside


def _shape(kind: str, random: np.random.Generator) -> Array:
    """A command of 500 samples between -1 and 1: steps, a chirp, ramps or a sum of sines."""
    t = np.arange(SAMPLES) / SAMPLES
    if kind == "steps":
        levels = random.uniform(-1.0, 1.0, 10)
        levels[0] = 0.0
        return np.repeat(levels, SAMPLES // 10)
    if kind == "chirp":
        return np.asarray(random.uniform(0.5, 1.0) * np.sin(2.0 * np.pi * (2.0 * t + 8.0 * t**2)))
    if kind == "ramps":
        knots = np.concatenate([[0.0], random.uniform(-1.0, 1.0, 8)])
        return np.asarray(np.interp(t, np.linspace(0.0, 1.0, 9), knots))
    found = np.zeros(SAMPLES)
    for _ in range(6):
        found += np.sin(2.0 * np.pi * random.uniform(1.0, 15.0) * t) / 3.0
    return np.clip(found, -1.0, 1.0)


def described(case: Case, priors: bool = False) -> Description:
    """Describe the log, as for an identification; ``priors`` as for a diagnosis."""
    outputs = dict(zip(case.rig.outputs, case.reading.T))
    log = {"time": case.times, case.rig.command: case.command, **outputs}
    shares = {name: PRIOR_SHARE * case.nominal.values[name] for name in case.free if priors}
    columns = {name: name for name in log}
    told = describe(case.nominal, {"log": log}, columns, free=case.free)
    return replace(told, uncertainty=shares)


@dataclass(frozen=True)
class Said:
    """What a command says of one log: estimates and standard errors [SI] by name, groups of names,
    and every value with its standard error as they are printed."""

    values: dict[str, float]
    errors: dict[str, float]
    groups: Sequence[Sequence[str]]
    printed: Sequence[tuple[str, str]] = ()
    with_priors: bool = False


@dataclass
class Score:
    """What one command has said of many cases.

    Attributes:
        z: errors of identifiable parameters over their standard errors.
        unknown: identifiable parameters without a finite standard error.
        told: of exactly degenerate groups, whether each was named as one.
        accused: of identifiable parameters, whether each was named in a group.
        digits: of printed values, whether they end with the standard error's second digit.
        seconds: of all cases.
    """

    z: list[float] = field(default_factory=list)
    unknown: int = 0
    told: list[bool] = field(default_factory=list)
    accused: list[bool] = field(default_factory=list)
    digits: list[bool] = field(default_factory=list)
    seconds: float = 0.0

    def add(self, case: Case, said: Said, seconds: float) -> None:
        """Count a case."""
        if case.group:
            self.told.append(_told(case, said))
        for name in case.identifiable:
            self.accused.append(any(name in group for group in said.groups))
            error = said.errors[name]
            if np.isfinite(error) and error > 0.0:
                self.z.append((said.values[name] - case.truth.values[name]) / error)
            else:
                self.unknown += 1
        self.digits += [honest(*pair) for pair in said.printed]
        self.seconds += seconds

    def row(self) -> str:
        """Return the figures in a row: those of intervals, then of groups, then of digits."""
        z = np.abs(np.array(self.z or [np.nan]))
        wide = NORMAL_95 / float(np.quantile(z, 0.95))
        return (
            f"{100 * np.mean(z < NORMAL_95):.1f} % of {len(self.z)} | {wide:.2f} |"
            f" {self.unknown} | {sum(self.told)} of {len(self.told)} |"
            f" {sum(self.accused)} of {len(self.accused)} |"
            f" {len(self.digits) - sum(self.digits)} of {len(self.digits)} | {self.seconds:.0f} s"
        )


def _told(case: Case, said: Said) -> bool:
    """Whether an exactly degenerate group is told as one, apart from members of which a log shows
    nothing whatever the others are: these are told alone, with an error beyond ``BLIND``, or with
    that of their prior."""
    grouped = {name for group in said.groups for name in group}

    def is_seen(name: str) -> bool:
        if said.with_priors:
            return said.errors[name] < PRIOR_ONLY * PRIOR_SHARE * case.nominal.values[name]
        return said.errors[name] < BLIND * abs(case.truth.values[name])

    rest = {name for name in case.group if name in grouped or is_seen(name)}
    return len(rest) > 1 and any(rest <= set(group) for group in said.groups)


HEAD = (
    "actuator, command | 95 % intervals hold | width over scatter | no error given"
    " | groups told | identifiable accused | too many digits | time"
)


def honest(value: str, error: str) -> bool:
    """Whether a printed value ends where its printed standard error has its second digit, or has
    the two digits that every value has."""
    if not error or float(error) == 0.0:
        return True
    digits = len(re.sub(r"e.*|[-.]", "", value).lstrip("0"))
    second = int(np.floor(np.log10(float(error)))) - 1
    return digits <= 2 or _last_place(value) >= second


def _last_place(text: str) -> int:
    """Power of ten of the last digit of a number, zeros at the end of an integer apart."""
    number, _, power = text.lower().partition("e")
    whole, _, part = number.partition(".")
    place = -len(part) if part else len(whole) - len(whole.rstrip("0"))
    return place + int(power or 0)


def by_identify(told: Description) -> Said:
    outcome = identify(told, jobs=1)
    found = outcome.result
    names = [free.name for free in found.free]
    printed = outcome.report().titled_tables["Estimated parameters"].column(3)
    return Said(
        dict(zip(names, found.values.tolist())),
        dict(zip(names, found.standard_errors.tolist())),
        found.groups,
        [with_error(it.value, it.error) for it in printed if isinstance(it, Quantity)],
    )


def by_check(case: Case, told: Description, values: dict[str, float]) -> Said:
    """What a check of the true model says of errors to expect, beside estimates of ``identify``."""
    found = check(replace(told, model=case.truth), jobs=1).identifiability
    errors = {reach.name: reach.together * reach.scale for reach in found.parameters}
    return Said(values, errors, found.together)


def by_diagnose(told: Description) -> Said:
    """What a diagnosis says: parameters have priors there, from which the truth was drawn."""
    found = diagnose(told, jobs=1)
    known = found.model.plant.parameters
    every = (*found.found, *(value for effect in found.ranking for value in effect.parameters))
    scales = {one.name: display_scale(known[one.name]) for one in every}
    return Said(
        {one.name: one.value for one in found.found},
        {one.name: one.standard_error for one in found.found},
        found.selection.taken.together,
        [with_error(scales[v.name] * v.value, scales[v.name] * v.standard_error) for v in every],
        with_priors=True,
    )


def judged(case: Case, diagnosed: bool) -> Iterator[tuple[str, Said, float]]:
    """What each command says of a case, and the seconds that it takes."""
    told = described(case)
    begin = perf_counter()
    identified = by_identify(told)
    yield "identify", identified, perf_counter() - begin
    begin = perf_counter()
    yield "check", by_check(case, told, identified.values), perf_counter() - begin
    if diagnosed:
        told = described(case, priors=True)
        begin = perf_counter()
        yield "diagnose", by_diagnose(told), perf_counter() - begin


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--logs", type=int, default=200, help="an actuator, check and identify")
    options.add_argument("--diagnoses", type=int, default=40, help="an actuator")
    options.add_argument("--seed", type=int, default=50000)
    options.add_argument("--actuator", choices=list(RIGS), action="append")
    given = options.parse_args()
    print(HEAD, flush=True)
    for actuator in given.actuator or RIGS:
        scores: dict[str, Score] = {}
        for k in range(max(given.logs, given.diagnoses)):
            case = drawn(actuator, given.seed + k)
            for command, said, seconds in judged(case, k < given.diagnoses):
                for name in (command, f"{command}, rough") if case.rough else (command,):
                    scores.setdefault(name, Score()).add(case, said, seconds)
        for name, score in sorted(scores.items()):
            print(f"{actuator}, {name} | {score.row()}", flush=True)


RESULTS = """
Of --seed 60000: 200 logs an actuator for check and identify, 40 for diagnose; seeds below 50000
were used to develop.

actuator, command | 95 % intervals hold | width over scatter | no error given | groups told |
identifiable accused
| too many digits | time
sg90, check | 96.1 % of 383 | 1.03 | 0 | 95 of 95 | 0 of 383 | 0 of 0 | 14 s
sg90, check, rough | 95.8 % of 259 | 1.02 | 0 | 71 of 71 | 0 of 259 | 0 of 0 | 10 s
sg90, diagnose | 97.3 % of 73 | 1.15 | 0 | 26 of 26 | 0 of 73 | 0 of 458 | 33 s
sg90, diagnose, rough | 96.3 % of 54 | 1.14 | 0 | 19 of 19 | 0 of 54 | 0 of 327 | 25 s
sg90, identify | 95.6 % of 383 | 1.02 | 0 | 95 of 95 | 0 of 383 | 0 of 573 | 21 s
sg90, identify, rough | 95.4 % of 259 | 1.01 | 0 | 71 of 71 | 0 of 259 | 0 of 401 | 19 s
torque_motor, check | 96.8 % of 341 | 1.22 | 2 | 96 of 97 | 2 of 343 | 0 of 0 | 47 s
torque_motor, check, rough | 97.4 % of 228 | 1.42 | 2 | 61 of 62 | 2 of 230 | 0 of 0 | 37 s
torque_motor, diagnose | 100.0 % of 72 | 1.22 | 0 | 19 of 20 | 0 of 72 | 0 of 530 | 112 s
torque_motor, diagnose, rough | 100.0 % of 55 | 1.22 | 0 | 11 of 12 | 0 of 55 | 0 of 394 | 90 s
torque_motor, identify | 96.5 % of 340 | 1.16 | 3 | 97 of 97 | 1 of 343 | 0 of 699 | 103 s
torque_motor, identify, rough | 98.2 % of 227 | 1.30 | 3 | 62 of 62 | 1 of 230 | 0 of 463 | 97 s
linear_drive, check | 96.3 % of 163 | 1.11 | 0 | 99 of 99 | 0 of 163 | 0 of 0 | 53 s
linear_drive, check, rough | 94.5 % of 109 | 0.80 | 0 | 64 of 64 | 0 of 109 | 0 of 0 | 40 s
linear_drive, diagnose | 94.7 % of 38 | 1.22 | 0 | 16 of 16 | 1 of 38 | 0 of 407 | 80 s
linear_drive, diagnose, rough | 92.6 % of 27 | 1.01 | 0 | 13 of 13 | 1 of 27 | 0 of 322 | 74 s
linear_drive, identify | 93.0 % of 157 | 0.92 | 6 | 99 of 99 | 0 of 163 | 0 of 490 | 124 s
linear_drive, identify, rough | 92.2 % of 103 | 0.90 | 6 | 64 of 64 | 0 of 109 | 0 of 331 | 118 s
smart_servo, check | 98.1 % of 267 | 1.26 | 0 | 99 of 99 | 0 of 267 | 0 of 0 | 23 s
smart_servo, check, rough | 99.0 % of 97 | 1.33 | 0 | 28 of 28 | 0 of 97 | 0 of 0 | 9 s
smart_servo, diagnose | 94.4 % of 54 | 1.02 | 0 | 17 of 17 | 0 of 54 | 0 of 408 | 25 s
smart_servo, diagnose, rough | 95.5 % of 22 | 1.06 | 0 | 7 of 7 | 0 of 22 | 0 of 159 | 9 s
smart_servo, identify | 97.8 % of 267 | 1.19 | 0 | 99 of 99 | 0 of 267 | 0 of 478 | 42 s
smart_servo, identify, rough | 99.0 % of 97 | 1.26 | 0 | 28 of 28 | 0 of 97 | 0 of 166 | 20 s
"""


if __name__ == "__main__":
    main()
