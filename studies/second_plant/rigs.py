"""Rigs: what is on the bench, what is wrong with it, what its owner writes down, and its logs.

The owner describes a ``smart_servo`` (gain, supply, data sheet, inertia, friction if some is known)
with honest uncertainties.  What is true lies inside them, but for what is wrong.

What counts as right, decided before anything was diagnosed, but for ``presliding_friction``, which
was not there:

=================  ==========================================================================
wrong              any of these sets of effects names it
=================  ==========================================================================
torque_limit       current_limit
duty_limit         drive_saturation
profile_speed      motion_profile
profile_trapezoid  motion_profile
delay              transport_delay
play               backlash; coasting_backlash
gravity            gravity_load
viscous            viscous_friction
inertia            load_inertia; or none, by the verdict ``parameters``
friction_soft      coulomb_friction; viscous_friction; both; presliding_friction
friction_stiff     coulomb_friction; stribeck_friction; both
=================  ==========================================================================

Soft friction is proportional to tanh(v / 0.3 to 1 rad/s) in the two-mass engine, and MuJoCo's
own default in the other, which creeps.  Stiff friction is that of Coulomb, in half of the two-mass
rigs with Stribeck's excess.  Of two, one of each has to be named, and nothing else.

A limit is 0.25 to 0.6 of the torque, duty or speed that the motor can do, and one that moves the
codes of the logs: where it does not, the whole rig is drawn again.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from servo_models.core.stop import Tell, silent
from servo_models.files import being_written
from servo_models.withheld.rig.laws import CODE, Array, chirp_turns, triangle
from servo_models.withheld.rig.recording import TIME, column, csv, description
from studies.second_plant.firmware import Firmware, Plant, run
from studies.second_plant.mujoco_plant import MujocoPlant
from studies.second_plant.two_mass import Drive, TwoMass

ENGINES = ("two_mass", "mujoco")
FRICTIONS = [["coulomb_friction"], ["stribeck_friction"], ["coulomb_friction", "stribeck_friction"]]
NAMES: dict[str, list[list[str]]] = {
    "delay": [["transport_delay"]],
    "play": [["backlash"], ["coasting_backlash"]],
    "gravity": [["gravity_load"]],
    "viscous": [["viscous_friction"]],
    "inertia": [["load_inertia"], []],
    "friction_soft": [
        ["coulomb_friction"],
        ["viscous_friction"],
        ["coulomb_friction", "viscous_friction"],
        ["presliding_friction"],
    ],
    "friction_stiff": FRICTIONS,
    "torque_limit": [["current_limit"]],
    "duty_limit": [["drive_saturation"]],
    "profile_speed": [["motion_profile"]],
    "profile_trapezoid": [["motion_profile"]],
}
"""By cause, the sets of effects that name it."""
LIMITS = ("torque_limit", "duty_limit", "profile_speed", "profile_trapezoid")
MECHANICS = tuple(name for name in NAMES if name not in LIMITS)
APART = [
    {"friction_soft", "friction_stiff"},
    {"friction_soft", "viscous"},
    {"profile_speed", "profile_trapezoid"},
]
"""Causes that are not drawn together, since they are two words for one."""


def _pairs(causes: Iterable[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    return tuple(pair for pair in causes if set(pair) not in APART)


@dataclass(frozen=True)
class Mix:
    """What rigs are drawn from: the shares of the kinds, and one or two causes, each alike often.

    A cause or a pair that stands there several times is drawn as many times as often.
    """

    kinds: Mapping[str, float]
    one: tuple[str, ...]
    two: tuple[tuple[str, str], ...]


BESIDE_PLAY = (*LIMITS, *(name for name in MECHANICS if name not in ("play", "inertia")))
"""An inertia would change the share of it that is behind the play."""
MIXES = {
    "mechanics": Mix(
        {"nothing": 0.16, "one": 0.49, "two": 0.35}, MECHANICS, _pairs(combinations(MECHANICS, 2))
    ),
    "friction": Mix({"one": 1.0}, ("friction_soft", "friction_stiff"), ()),
    "limits": Mix(
        {"nothing": 0.1, "one": 0.5, "two": 0.4},
        (*LIMITS, *3 * ("play",)),
        (
            *3 * tuple(("play", name) for name in BESIDE_PLAY),
            *_pairs(combinations(LIMITS, 2)),
            *product(LIMITS, (name for name in MECHANICS if name != "play")),
        ),
    ),
}
"""Mechanics alone; friction; limits of motor and firmware, and play in about half of the rigs."""

UNCERTAINTY = {
    "torque_constant": 0.1,
    "resistance": 0.1,
    "inertia": 0.15,
    "loop_factor": 0.05,
    "coulomb_friction.level": 0.3,
}
"""Standard deviations that the owner states, as shares."""
FARTHEST = 2.0  # standard deviations by which a true value is off, at the most
BEHIND = (0.02, 0.3)
"""Inertia behind the gear over all of it: from a bare servo to one that carries an arm."""
SHARES = (0.02, 0.1, 0.3, 0.5)  # the same behind the play of the mix of limits, each alike often
BINDS = 4.0  # RMS of the codes by which a limit has to move the logs at least
REST = 1.0  # time [s] for which the first goal is held before a log begins


@dataclass(frozen=True)
class Motor:
    """Data sheet of a geared motor: supply [V], torque [N m], speed [rad/s], inertias [kg m2]."""

    supply: float
    stall_torque: float
    top_speed: float
    inertia: float
    arm: tuple[float, float]


MOTORS = (
    Motor(5.0, 0.52, 10.8, 2.4e-3, (0.5e-3, 2.5e-3)),
    Motor(12.0, 1.4, 6.4, 9e-3, (2e-3, 9e-3)),
    Motor(7.4, 1.9, 5.4, 2.6e-2, (4e-3, 2e-2)),
)


@dataclass(frozen=True)
class Rig:
    """A rig, what is true of it, and its logs.

    Attributes:
        name, kind, engine, causes: "nothing", "one" or "two" of ``NAMES``.
        drive, firmware: what is true.
        stiff: whether MuJoCo's friction is made not to creep.
        nominal: parameters of a ``smart_servo`` that the owner writes down [SI].
        true: the same parameters as they are.
        effects: what is wrong, by the parameters of effects that come closest to it [SI].
        ticks: of the firmware between rows of the log.
        goals: commanded angles [rad], one array a log.
        seed: of the encoder's noise.
    """

    name: str
    kind: str
    engine: str
    causes: tuple[str, ...]
    drive: Drive
    firmware: Firmware
    stiff: bool
    nominal: Mapping[str, float]
    true: Mapping[str, float]
    effects: Mapping[str, float]
    ticks: int
    goals: tuple[Array, ...] = field(repr=False)
    seed: int

    def plant(self) -> Plant:
        """The plant at rest."""
        if self.engine == "two_mass":
            return TwoMass(self.drive)
        return MujocoPlant(self.drive, self.stiff)

    def codes(self) -> list[NDArray[np.int64]]:
        """The encoder's codes, one array a log."""
        rng = np.random.default_rng(self.seed)
        rest = round(REST / self.firmware.tick)
        return [run(self.firmware, self.plant(), it, self.ticks, rest, rng) for it in self.goals]

    def answer(self) -> dict[str, Any]:
        """What is true, as JSON has it."""
        return {
            "case": self.name,
            "kind": self.kind,
            "engine": self.engine,
            "causes": list(self.causes),
            "parameters": dict(self.true),
            "effects": dict(self.effects),
            "drive": asdict(self.drive),
            "firmware": asdict(self.firmware),
            "stiff": self.stiff,
        }


def draw(seed: int, number: int, engines: Sequence[str] = ENGINES, mix: str = "mechanics") -> Rig:
    """Draw rig ``number`` of ``seed``; engines take turns."""
    rng, drawn = np.random.default_rng([seed, number]), MIXES[mix]
    kind = str(rng.choice(list(drawn.kinds), p=list(drawn.kinds.values())))
    causes: tuple[str, ...] = ()
    if kind == "one":
        causes = (str(rng.choice(drawn.one)),)
    elif kind == "two":
        causes = drawn.two[int(rng.integers(len(drawn.two)))]
    given: dict[str, float] = {}
    if "play" in causes and mix == "limits":
        given["behind"] = float(rng.choice(SHARES))
    engine = engines[number % len(engines)]
    rig = build(f"{number:04d}", engine, causes, given, rng)
    while not all(binds(rig, cause) for cause in causes if cause in LIMITS):
        rig = build(f"{number:04d}", engine, causes, given, rng)
    return rig


def binds(rig: Rig, limit: str) -> bool:
    """Return whether a limit moves the codes of the logs."""
    free = replace(
        rig,
        drive=replace(rig.drive, **NO_LIMIT[limit][0]),
        firmware=replace(rig.firmware, **NO_LIMIT[limit][1]),
    )
    moved = np.concatenate(rig.codes()) - np.concatenate(free.codes())
    return bool(np.sqrt(np.mean(moved**2.0)) >= BINDS)


NO_LIMIT: dict[str, tuple[dict[str, float], dict[str, Any]]] = {
    "torque_limit": ({"torque_limit": 0.0}, {}),
    "duty_limit": ({}, {"duty_limit": 1.0}),
    "profile_speed": ({}, {"speed": 0.0}),
    "profile_trapezoid": ({}, {"speed": 0.0}),
}
"""Of a drive and of a firmware, what switches a limit off."""


def six() -> list[Rig]:
    """Return the fixed small set: play of 0.4 to 1.2 deg with a delay of 8 to 25 ms each."""
    plays, delays = (0.4, 0.56, 0.72, 0.88, 1.04, 1.2), (15, 25, 8, 22, 11, 18)
    return [
        build(
            f"six_{i + 1}",
            "two_mass",
            ("delay", "play"),
            {"play": math.radians(play), "delay": 1e-3 * delay, "noise": 0.0},
            np.random.default_rng([6, i]),
        )
        for i, (play, delay) in enumerate(zip(plays, delays))
    ]


def build(
    name: str,
    engine: str,
    causes: tuple[str, ...],
    given: Mapping[str, float],
    rng: np.random.Generator,
) -> Rig:
    """Draw a rig with these causes; ``given`` holds sizes that are not drawn [SI]."""
    motor = MOTORS[int(rng.integers(len(MOTORS)))]
    tick, rows = float(rng.choice([1e-3, 2e-3])), int(rng.choice([4, 6, 8]))
    constant = motor.supply / motor.top_speed
    resistance = constant * motor.supply / motor.stall_torque
    inertia = motor.inertia + float(rng.uniform(*motor.arm))
    drag = constant**2 / resistance
    # a damping ratio of the loop by the back-EMF alone, as one tunes it by hand
    natural = drag / (2.0 * float(rng.uniform(0.35, 0.8)) * inertia)
    stiffness = natural**2 * inertia * resistance / (constant * motor.supply)
    true = {
        "torque_constant": constant,
        "resistance": resistance,
        "inertia": inertia,
        "loop_factor": stiffness / 100.0,
    }
    frictional = any("friction" in cause for cause in causes)
    if not frictional and ("play" in causes or rng.random() < 0.7):
        true["coulomb_friction.level"] = float(rng.uniform(0.01, 0.04)) * motor.stall_torque
    off = {key: float(np.clip(rng.standard_normal(), -FARTHEST, FARTHEST)) for key in true}
    nominal = {key: value / (1.0 + UNCERTAINTY[key] * off[key]) for key, value in true.items()}
    behind = given.get("behind", math.exp(float(rng.uniform(*np.log(BEHIND)))))
    friction, slack = true.get("coulomb_friction.level", 0.0), float(rng.uniform(0.2, 0.5))
    drive = Drive(
        constant,
        resistance,
        motor_inertia=(1.0 - behind) * inertia,
        output_inertia=behind * inertia,
        motor_friction=(1.0 - slack) * friction,
        output_friction=slack * friction,
        contact=float(rng.uniform(100.0, 250.0)),
        contact_damping=float(rng.uniform(0.15, 0.5)),
    )
    noise = given.get("noise", float(rng.uniform(0.2, 0.8)) if rng.random() < 0.35 else 0.0)
    rig = Rig(
        name=name,
        kind=("nothing", "one", "two")[len(causes)],
        engine=engine,
        causes=causes,
        drive=drive,
        firmware=Firmware(stiffness, motor.supply, tick, noise=noise),
        stiff=True,
        nominal=nominal,
        true=true,
        effects={},
        ticks=round(rows * 1e-3 / tick),
        goals=goals(1e-3 * rows, rng),
        seed=int(rng.integers(2**31)),
    )
    return with_causes(rig, motor, given, rng)


def with_causes(
    rig: Rig, motor: Motor, given: Mapping[str, float], rng: np.random.Generator
) -> Rig:
    """Return a rig in which its causes act; ``given`` holds sizes that are not drawn [SI]."""
    for cause in rig.causes:
        rig = WRONG[cause](rig, motor, given, rng)
    # an inertia or a friction beside the play has its part in these
    return _with(rig, _behind(rig.drive)) if "play" in rig.causes else rig


Wrong = Callable[[Rig, Motor, Mapping[str, float], np.random.Generator], Rig]


def _delay(rig: Rig, _: Motor, given: Mapping[str, float], rng: np.random.Generator) -> Rig:
    """Whole ticks of 8 to 25 ms."""
    tick = rig.firmware.tick
    ticks = round(given.get("delay", float(rng.uniform(8e-3, 25e-3))) / tick)
    late = {"transport_delay.time": ticks * tick}
    return _with(replace(rig, firmware=replace(rig.firmware, delay=ticks)), late)


def _play(rig: Rig, _: Motor, given: Mapping[str, float], rng: np.random.Generator) -> Rig:
    play = given.get("play", math.radians(float(rng.uniform(0.4, 1.2))))
    near = {"backlash.half_width": 0.5 * play, "coasting_backlash.half_width": 0.5 * play}
    return _with(rig, near, play=play)


def _behind(drive: Drive) -> dict[str, float]:
    """Parts of inertia and dry friction that are behind the play."""
    inertia = drive.motor_inertia + drive.output_inertia
    friction = drive.motor_friction + drive.output_friction
    return {
        "coasting_backlash.share": drive.output_inertia / inertia,
        "coasting_backlash.friction_share": drive.output_friction / friction,
    }


def _gravity(rig: Rig, motor: Motor, _: Mapping[str, float], rng: np.random.Generator) -> Rig:
    """An arm; it hangs at any angle of the encoder."""
    torque = float(rng.uniform(0.04, 0.2)) * motor.stall_torque
    phase = float(rng.uniform(-math.pi, math.pi))
    near = {"gravity_load.torque": torque, "gravity_load.phase": phase}
    return _with(rig, near, gravity=torque, phase=phase)


def _viscous(rig: Rig, _: Motor, __: Mapping[str, float], rng: np.random.Generator) -> Rig:
    """Drag beside that of the back-EMF, most of it at the motor."""
    drive = rig.drive
    drag = float(rng.uniform(0.3, 1.2)) * drive.torque_constant**2 / drive.resistance
    near = {"viscous_friction.torque": FULL_SPEED * drag}
    return _with(rig, near, motor_drag=0.8 * drag, output_drag=0.2 * drag)


def _inertia(rig: Rig, _: Motor, __: Mapping[str, float], rng: np.random.Generator) -> Rig:
    """Something heavy on the output that the owner has forgotten."""
    added = float(rng.uniform(0.5, 1.5)) * rig.true["inertia"]
    output = rig.drive.output_inertia
    # the gear is as stiff as it was
    slower = rig.drive.contact * math.sqrt(output / (output + added))
    near = {"load_inertia.inertia": added}
    return _with(rig, near, output_inertia=output + added, contact=slower)


def _soft(rig: Rig, motor: Motor, _: Mapping[str, float], rng: np.random.Generator) -> Rig:
    level = float(rng.uniform(0.04, 0.15)) * motor.stall_torque
    rig = _rubbing(replace(rig, stiff=False), level)
    return _with(rig, {}, smooth_speed=float(rng.uniform(0.3, 1.0)))


def _stiff(rig: Rig, motor: Motor, _: Mapping[str, float], rng: np.random.Generator) -> Rig:
    level = float(rng.uniform(0.03, 0.12)) * motor.stall_torque
    rig = _rubbing(rig, level)
    if rig.engine != "two_mass" or rng.random() < 0.5:
        return rig
    more, speed = float(rng.uniform(1.2, 1.8)), float(rng.uniform(0.1, 0.5))
    near = {
        "stribeck_friction.excess": (more - 1.0) * level,
        "stribeck_friction.speed": speed / FULL_SPEED,
    }
    return _with(rig, near, breakaway=more, stribeck_speed=speed)


def _rubbing(rig: Rig, level: float) -> Rig:
    """Dry friction, two thirds of it at the motor."""
    near = {"coulomb_friction.level": level}
    return _with(rig, near, motor_friction=2.0 / 3.0 * level, output_friction=level / 3.0)


def _torque(rig: Rig, motor: Motor, _: Mapping[str, float], rng: np.random.Generator) -> Rig:
    limit = float(rng.uniform(*LIMITED)) * motor.stall_torque
    near = {"current_limit.limit": limit / rig.drive.torque_constant}
    return _with(rig, near, torque_limit=limit)


def _duty(rig: Rig, _: Motor, __: Mapping[str, float], rng: np.random.Generator) -> Rig:
    limit = float(rng.uniform(*LIMITED))
    firmware = replace(rig.firmware, duty_limit=limit)
    return _with(replace(rig, firmware=firmware), {"drive_saturation.limit": limit})


def _speed(rig: Rig, motor: Motor, _: Mapping[str, float], rng: np.random.Generator) -> Rig:
    return _profile(rig, float(rng.uniform(*LIMITED)) * motor.top_speed, 0.0)


def _trapezoid(rig: Rig, motor: Motor, _: Mapping[str, float], rng: np.random.Generator) -> Rig:
    """Up to its speed in 50 to 300 ms."""
    speed = float(rng.uniform(*LIMITED)) * motor.top_speed
    return _profile(rig, speed, float(rng.uniform(0.05, 0.3)))


def _profile(rig: Rig, speed: float, acceleration_time: float) -> Rig:
    firmware = replace(rig.firmware, speed=speed, acceleration_time=acceleration_time)
    near = {
        "motion_profile.velocity": speed,
        "motion_profile.acceleration_time": acceleration_time,
    }
    return _with(replace(rig, firmware=firmware), near)


def _with(rig: Rig, near: Mapping[str, float], **drive: float) -> Rig:
    """A rig with something else, and the parameters of effects that come near to it."""
    return replace(rig, effects={**rig.effects, **near}, drive=replace(rig.drive, **drive))


LIMITED = (0.25, 0.6)  # a limit over what the motor can do
FULL_SPEED = 10.0  # speed [rad/s] that friction of a ``smart_servo`` calls full
WRONG: dict[str, Wrong] = {
    "delay": _delay,
    "play": _play,
    "gravity": _gravity,
    "viscous": _viscous,
    "inertia": _inertia,
    "friction_soft": _soft,
    "friction_stiff": _stiff,
    "torque_limit": _torque,
    "duty_limit": _duty,
    "profile_speed": _speed,
    "profile_trapezoid": _trapezoid,
}


TRIANGLE, CHIRP, LOWEST = 3.0, 4.0, 0.3
"""Length [s] of a triangle and of a chirp, and the frequency [Hz] with which that begins."""


def goals(step: float, rng: np.random.Generator) -> tuple[Array, ...]:
    """Return steps for one log, a slow triangle and a chirp for another; rows are ``step`` [s]."""
    size = math.radians(float(rng.uniform(25.0, 50.0)))
    levels = size * rng.permutation([-1.0, -0.5, 0.1, 0.25, 0.6, 1.0])
    held = [round(float(rng.uniform(0.6, 0.9)) / step) for _ in levels]
    still = np.zeros(round(0.3 / step))
    steps = [still, *(np.full(count, level) for count, level in zip(held, levels))]
    rows = round(TRIANGLE / step)
    wave = math.radians(float(rng.uniform(4.0, 12.0))) * triangle(np.arange(rows) / rows)
    turns = chirp_turns(LOWEST, float(rng.uniform(2.5, 5.0)), CHIRP, round(CHIRP / step))
    chirp = math.radians(float(rng.uniform(8.0, 20.0))) * np.sin(2.0 * math.pi * turns)
    whole = (np.concatenate(steps), np.concatenate([still, wave, chirp]))
    return tuple(np.radians(np.round(np.degrees(it), 3)) for it in whole)


def write(folder: Path, rigs: Sequence[Rig], tell: Tell = silent) -> None:
    """Write rigs and their answers into a new folder, whole or not at all.

    ::

        cases/0007/description.toml, steps.csv, moves.csv
        answers.json
    """
    with being_written(folder) as part:
        for done, rig in enumerate(rigs):
            own = part / "cases" / rig.name
            own.mkdir(parents=True)
            for name, text in recording(rig).items():
                (own / name).write_text(text, encoding="utf-8")
            tell("generating", done + 1, len(rigs))
        answers = json.dumps([rig.answer() for rig in rigs], indent=1)
        (part / "answers.json").write_text(answers, encoding="utf-8")
        part.rename(folder)


LOGS = ("steps.csv", "moves.csv")
GOAL = column("inputs.goal", "goal_deg", "deg")
ANGLE = column("outputs.angle_reading", "code", "rad", CODE)


def recording(rig: Rig, own: str = "description.toml", before: str = "") -> dict[str, str]:
    """Return the texts of a rig's files by name; those of logs have something ``before`` them."""
    files = {own: _description(rig, before)}
    row = 1e3 * rig.ticks * rig.firmware.tick
    for name, goal, codes in zip(LOGS, rig.goals, rig.codes()):
        times = row * np.arange(len(codes))
        columns = {"time_ms": times, "goal_deg": np.degrees(goal), "code": codes}
        files[before + name] = csv(columns, ["%.6g", "%.3f", "%d"])
    return files


def _description(rig: Rig, before: str) -> str:
    nominal = {"gain": 100.0, "sample_hold.period": rig.firmware.tick, **rig.nominal}
    lines = [
        TIME,
        GOAL,
        ANGLE,
        f"constants = {{ supply = {rig.firmware.supply!r} }}",
        f'settle = "{REST:g} s"',
    ]
    return description(
        "smart_servo",
        "xl330",
        {f'"{name}"': UNCERTAINTY[name] for name in rig.nominal},
        ([f'file = "{before}{name}"', *lines] for name in LOGS),
        {f'"{name}"': value for name, value in nominal.items()},
    )
