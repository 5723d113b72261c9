"""Rigs: what is on the bench, what is wrong with it, what its owner writes down, and its logs.

The owner describes a ``smart_servo`` (gain, supply, data sheet, inertia, friction if some is known)
with honest uncertainties.  What is true lies inside them, but for what is wrong.

What counts as right, decided before anything was diagnosed:

=================  ==========================================================================
wrong              any of these sets of effects names it
=================  ==========================================================================
delay              transport_delay
play               backlash; coasting_backlash
gravity            gravity_load
viscous            viscous_friction
inertia            load_inertia; or none, by the verdict ``parameters``
friction_soft      coulomb_friction; viscous_friction; both
friction_stiff     coulomb_friction; stribeck_friction; both
=================  ==========================================================================

Soft friction is proportional to tanh(v / 0.3 to 1 rad/s) in the two-mass engine, and MuJoCo's
own default in the other, which creeps.  Stiff friction is that of Coulomb, in half of the two-mass
rigs with Stribeck's excess.  Of two, one of each has to be named, and nothing else.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.second_plant.firmware import CODE, Array, Firmware, Plant, run
from benchmarks.second_plant.mujoco_plant import MujocoPlant
from benchmarks.second_plant.two_mass import Drive, TwoMass

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
    ],
    "friction_stiff": FRICTIONS,
}
"""By cause, the sets of effects that name it."""
APART = [{"friction_soft", "friction_stiff"}, {"friction_soft", "viscous"}]
"""Causes that are not drawn together, since they are two words for one."""
PAIRS = [pair for pair in combinations(NAMES, 2) if set(pair) not in APART]
KINDS = {"nothing": 0.16, "one": 0.49, "two": 0.35}

UNCERTAINTY = {
    "torque_constant": 0.1,
    "resistance": 0.1,
    "inertia": 0.15,
    "loop_factor": 0.05,
    "coulomb_friction.level": 0.3,
}
"""Standard deviations that the owner states, as shares."""
FARTHEST = 2.0
"""Standard deviations by which a true value is off, at the most."""
BEHIND = (0.02, 0.3)
"""Inertia behind the gear over all of it: from a bare servo to one that carries an arm."""
REST = 1.0
"""Time [s] for which the first goal is held before a log begins."""


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
        return (
            TwoMass(self.drive)
            if self.engine == "two_mass"
            else MujocoPlant(self.drive, self.stiff)
        )

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


def draw(seed: int, number: int, engines: Sequence[str] = ENGINES) -> Rig:
    """Draw rig ``number`` of ``seed``; engines take turns."""
    rng = np.random.default_rng([seed, number])
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    causes: tuple[str, ...] = ()
    if kind == "one":
        causes = (str(rng.choice(list(NAMES))),)
    elif kind == "two":
        causes = PAIRS[int(rng.integers(len(PAIRS)))]
    engine = engines[number % len(engines)]
    return build(f"{number:04d}", engine, causes, {}, rng)


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
    behind = math.exp(float(rng.uniform(*np.log(BEHIND))))
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
        goals=_goals(1e-3 * rows, rng),
        seed=int(rng.integers(2**31)),
    )
    for cause in causes:
        rig = WRONG[cause](rig, motor, given, rng)
    return rig


Wrong = Callable[[Rig, Motor, Mapping[str, float], np.random.Generator], Rig]


def _delay(rig: Rig, _: Motor, given: Mapping[str, float], rng: np.random.Generator) -> Rig:
    """Whole ticks of 8 to 25 ms."""
    tick = rig.firmware.tick
    ticks = round(given.get("delay", float(rng.uniform(8e-3, 25e-3))) / tick)
    late = {"transport_delay.time": ticks * tick}
    return _with(replace(rig, firmware=replace(rig.firmware, delay=ticks)), late)


def _play(rig: Rig, _: Motor, given: Mapping[str, float], rng: np.random.Generator) -> Rig:
    play = given.get("play", math.radians(float(rng.uniform(0.4, 1.2))))
    near = {
        "backlash.half_width": 0.5 * play,
        "coasting_backlash.half_width": 0.5 * play,
        "coasting_backlash.share": rig.drive.output_inertia / rig.true["inertia"],
        "coasting_backlash.friction_share": _share(rig.drive),
    }
    return _with(rig, near, play=play)


def _share(drive: Drive) -> float:
    """Part of the dry friction that acts at the output."""
    whole = drive.motor_friction + drive.output_friction
    return drive.output_friction / whole if whole else 0.0


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


def _with(rig: Rig, near: Mapping[str, float], **drive: float) -> Rig:
    """A rig with something else, and the parameters of effects that come near to it."""
    return replace(rig, effects={**rig.effects, **near}, drive=replace(rig.drive, **drive))


FULL_SPEED = 10.0
"""Speed [rad/s] that friction of a ``smart_servo`` calls full."""
WRONG: dict[str, Wrong] = {
    "delay": _delay,
    "play": _play,
    "gravity": _gravity,
    "viscous": _viscous,
    "inertia": _inertia,
    "friction_soft": _soft,
    "friction_stiff": _stiff,
}


TRIANGLE, CHIRP, LOWEST = 3.0, 4.0, 0.3
"""Length [s] of a triangle and of a chirp, and the frequency [Hz] with which that begins."""


def _goals(step: float, rng: np.random.Generator) -> tuple[Array, ...]:
    """Steps in one log; a slow triangle and a chirp in another."""
    size = math.radians(float(rng.uniform(25.0, 50.0)))
    levels = size * rng.permutation([-1.0, -0.5, 0.1, 0.25, 0.6, 1.0])
    held = [round(float(rng.uniform(0.6, 0.9)) / step) for _ in levels]
    still = np.zeros(round(0.3 / step))
    steps = [still, *(np.full(count, level) for count, level in zip(held, levels))]
    rows = round(TRIANGLE / step)
    wave = np.abs(np.mod(np.arange(rows) / rows + 0.25, 1.0) - 0.5)
    triangle = math.radians(float(rng.uniform(4.0, 12.0))) * (1.0 - 4.0 * wave)
    rows, high = round(CHIRP / step), float(rng.uniform(2.5, 5.0))
    ratio = high / LOWEST
    turns = LOWEST * CHIRP * (ratio ** (np.arange(rows) / rows) - 1.0) / math.log(ratio)
    chirp = math.radians(float(rng.uniform(8.0, 20.0))) * np.sin(2.0 * math.pi * turns)
    whole = (np.concatenate(steps), np.concatenate([still, triangle, chirp]))
    return tuple(np.radians(np.round(np.degrees(it), 3)) for it in whole)


def write(folder: Path, rigs: Sequence[Rig], tell: Callable[[int, int], None]) -> None:
    """Write rigs and their answers into a new folder, whole or not at all.

    ::

        cases/0007/description.toml, steps.csv, moves.csv
        answers.json
    """
    part = folder.with_name(f".part-{folder.name}")
    shutil.rmtree(part, ignore_errors=True)
    for done, rig in enumerate(rigs):
        own = part / "cases" / rig.name
        own.mkdir(parents=True)
        (own / "description.toml").write_text(_description(rig), encoding="utf-8")
        for name, goals, codes in zip(LOGS, rig.goals, rig.codes()):
            (own / name).write_text(_csv(rig, goals, codes), encoding="utf-8")
        tell(done + 1, len(rigs))
    answers = json.dumps([rig.answer() for rig in rigs], indent=1)
    (part / "answers.json").write_text(answers, encoding="utf-8")
    part.rename(folder)


LOGS = ("steps.csv", "moves.csv")


def _description(rig: Rig) -> str:
    nominal = {"gain": 100.0, "sample_hold.period": rig.firmware.tick, **rig.nominal}
    lines = [
        'actuator = "smart_servo"',
        'variant = "xl330"',
        "",
        "[parameters]",
        *(f'"{name}" = {value:.6g}' for name, value in nominal.items()),
        "",
        "[uncertainty]",
        *(f'"{name}" = "{100.0 * UNCERTAINTY[name]:g} %"' for name in rig.nominal),
    ]
    for name in LOGS:
        lines += [
            "",
            "[[logs]]",
            f'file = "{name}"',
            'time = { column = "time_ms", unit = "ms" }',
            'inputs.goal = { column = "goal_deg", unit = "deg" }',
            f'outputs.angle_reading = {{ column = "code", unit = "rad", scale = {CODE!r} }}',
            f"constants = {{ supply = {rig.firmware.supply!r} }}",
            f'settle = "{REST:g} s"',
        ]
    return "\n".join([*lines, ""])


def _csv(rig: Rig, goals: Array, codes: NDArray[np.int64]) -> str:
    row = 1e3 * rig.ticks * rig.firmware.tick
    lines = [
        f"{i * row:.6g},{math.degrees(goal):.3f},{code}"
        for i, (goal, code) in enumerate(zip(goals, codes.tolist()))
    ]
    return "\n".join(["time_ms,goal_deg,code", *lines, ""])
