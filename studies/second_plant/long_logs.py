"""Three long recordings whose diagnosis once had no end within minutes.

    path = sts3215_joint(Path("joint"))  # joint/description.toml and its logs

====================  =================================  ===========================================
function              recording                          wrong
====================  =================================  ===========================================
sts3215_joint         ten motions of 24 s at 50 Hz       torque limit of a third of stall; friction
current_motor         nine spin-ups of 1 s at 440 Hz     cogging; friction; a coupling of 200 Hz
loaded_servo          five logs, 1400 rows in all        loads taken for twice what they are; play;
                                                         friction
====================  =================================  ===========================================

The plant is that of ``two_mass``.  Readings are codes of a 12 bit encoder, with noise before it
counts where it is a magnet's.  A description says what an owner knows; the same seed gives the same
files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from servo_models.withheld.rig.laws import CODE, Array, code_of, triangle
from servo_models.withheld.rig.recording import TIME, column, csv, description
from studies.second_plant.firmware import Firmware, run
from studies.second_plant.rigs import ANGLE, GOAL, REST
from studies.second_plant.two_mass import MOTOR_ANGLE, Drive, TwoMass

TICK = 2e-3  # of a firmware [s]
NOISE = 0.4  # of a magnetic encoder [codes, standard deviation]


def sts3215_joint(folder: Path, seed: int = 1) -> Path:
    """Write a joint of an arm: an STS3215 that its owner takes to be as its data sheet says.

    Steps, a multisine, a chirp and a triangle take turns.

    Args:
        folder: a new one, for the description and its logs.
        seed: of motions and noise.

    Returns:
        The description.
    """
    supply, stall, top_speed, inertia = 7.4, 1.91, 5.45, 0.036  # V, N m, rad/s, kg m2
    constant = supply / top_speed
    drive = Drive(
        constant,
        constant * supply / stall,
        motor_inertia=0.8 * inertia,
        output_inertia=0.2 * inertia,
        motor_friction=0.04 * stall,
        output_friction=0.02 * stall,
        torque_limit=stall / 3.0,
    )
    firmware = Firmware(2.8, supply, TICK, noise=NOISE)
    rows, period = 1200, 0.02  # s
    rng = np.random.default_rng(seed)
    logs = {}
    for number in range(1, 11):
        goals = _motion(number, rows, period, rng)
        codes = _played(firmware, TwoMass(drive), goals, period, rng)
        logs[f"motion_{number}.csv"] = {"goal_deg": np.degrees(goals), "code": codes}
    told = description(
        "smart_servo",
        "sts3215",
        {"inertia": 0.3, "torque_constant": 0.3, "resistance": 0.4, "loop_factor": 0.2},
        [
            [
                'file = "motion_*.csv"',
                *(TIME, GOAL, ANGLE),
                f"constants = {{ supply = {supply} }}",
                f'settle = "{REST:g} s"',
            ]
        ],
    )
    return _write(folder, period, logs, told)


def current_motor(folder: Path, seed: int = 1) -> Path:
    """Write spin-ups of a bare motor on a current; arguments as for ``sts3215_joint``.

    A current is held, then the motor coasts or is braked.
    """
    torque_constant, inertia = 0.033, 1.15e-5  # N m/A, kg m2
    source = 1e7  # Ohm: a voltage behind so much is a current, the back-EMF is nothing beside it
    drive = Drive(
        torque_constant,
        source,
        motor_inertia=0.95 * inertia,
        output_inertia=0.05 * inertia,
        motor_friction=1.2e-3,
        motor_drag=3e-6,
    )
    rng = np.random.default_rng(seed)
    cogging, slots, phase = 8e-4, 12.0, float(rng.uniform(-math.pi, math.pi))  # N m
    rows, rate = 440, 440.0  # Hz
    steps = 48  # of a row: the torque of the magnets changes with the angle
    logs = {}
    for number in range(1, 10):
        size = float(rng.choice([-1.0, 1.0])) * (0.04 + 0.02 * number)
        braked = float(rng.choice([0.0, -0.5]))
        shares = np.repeat([0.0, 1.0, braked], [20, 260, 160])
        currents = np.round(size * shares, 3)
        plant = TwoMass(drive)
        codes = np.empty(rows)
        for row, current in enumerate(currents.tolist()):
            codes[row] = code_of(plant.state[MOTOR_ANGLE], CODE)
            for _ in range(steps):
                torque = cogging * math.sin(slots * plant.state[MOTOR_ANGLE] + phase)
                plant.advance(source * (current - torque / torque_constant), 1.0 / (rate * steps))
        logs[f"spin_up_{number}.csv"] = {"current_A": currents, "code": codes}
    current = column("inputs.current_command", "current_A", "A")
    angle = column("outputs.encoder_angle", "code", "rad", CODE)
    told = description(
        "dc_motor_current",
        "direct",
        {"rotor_inertia": 0.3, "torque_constant": 0.2, "viscous_coefficient": 0.5},
        [['file = "spin_up_*.csv"', TIME, current, angle]],
    )
    return _write(folder, 1.0 / rate, logs, told)


def loaded_servo(folder: Path, seed: int = 1) -> Path:
    """Write a bus servo with discs and hanging arms; arguments as for ``sts3215_joint``.

    The owner computed an arm's load from the angles that were read, and took the length of the arm
    for the distance of its centre of mass.
    """
    supply, stall, top_speed, inertia = 12.0, 1.4, 6.4, 9e-3  # V, N m, rad/s, kg m2
    constant = supply / top_speed
    firmware = Firmware(0.75, supply, TICK, delay=3, noise=NOISE)
    rows, period = 280, 0.01  # s
    rng = np.random.default_rng(seed)
    logs: dict[str, dict[str, Array]] = {}
    runs = []
    loads = ((0.0, 0.0), (4e-3, 0.0), (2e-3, 0.1), (3e-3, -0.15), (6e-3, 0.2))  # kg m2, N m
    for number, (added, gravity) in enumerate(loads, start=1):
        drive = Drive(
            constant,
            constant * supply / stall,
            motor_inertia=0.9 * inertia,
            output_inertia=0.1 * inertia + added,
            motor_friction=0.02 * stall,
            output_friction=0.01 * stall,
            play=math.radians(1.0),
            contact=100.0,
            gravity=gravity,
        )
        goals = _steps(rows, round(0.6 / period), math.radians(60.0), rng)
        codes = _played(firmware, TwoMass(drive), goals, period, rng)
        loads_known = np.round(2.0 * gravity * np.sin(codes * CODE), 4)
        logs[f"load_{number}.csv"] = {
            "goal_deg": np.degrees(goals),
            "load_Nm": loads_known,
            "code": codes,
        }
        known = f'constants = {{ "load_inertia.inertia" = {added} }}'
        runs.append(f'    {{ file = "load_{number}.csv", {known} }},')
    told = description(
        "second_order_servo",
        "bus",
        {
            "natural_frequency": 0.5,
            "damping_ratio": 0.3,
            "speed_limit": 0.2,
            "acceleration_limit": 0.5,
            "inertia": 0.5,
            '"transport_delay.time"': 0.5,
            "gain": 0.02,
        },
        [
            [
                *(TIME, GOAL, column("inputs.load_torque", "load_Nm", "N.m"), ANGLE),
                f'settle = "{REST:g} s"',
                *("repeat = [", *runs, "]"),
            ]
        ],
    )
    return _write(folder, period, logs, told)


def _motion(number: int, rows: int, period: float, rng: np.random.Generator) -> Array:
    """Goals [rad] of one of ten motions."""
    times: Array = period * np.arange(float(rows))
    length, size = rows * period, math.radians(float(rng.uniform(20.0, 50.0)))
    if number % 4 == 0:
        goals = size * triangle(2.0 * times / length)
    elif number % 4 == 1:
        goals = _steps(rows, round(1.2 / period), size, rng)
    elif number % 4 == 2:
        tones = 2.0 * math.pi * np.array([2.0, 5.0, 11.0, 23.0, 41.0]) / length
        phases = rng.uniform(-math.pi, math.pi, len(tones))
        goals = 0.4 * size * np.sin(np.outer(times, tones) + phases).sum(axis=1)
    else:
        lowest, highest = 0.1, 2.5  # Hz
        turns = lowest * times + 0.5 * (highest - lowest) * times**2 / length
        goals = 0.5 * size * np.sin(2.0 * math.pi * turns)
    return np.radians(np.round(np.degrees(goals), 2))


def _steps(rows: int, held: int, size: float, rng: np.random.Generator) -> Array:
    """Goals [rad] that are held for so many rows each, the first one 0."""
    levels = np.append(0.0, rng.uniform(-size, size, rows // held))
    goals: Array = np.radians(np.round(np.degrees(np.repeat(levels, held)[:rows]), 2))
    return goals


def _played(
    firmware: Firmware, plant: TwoMass, goals: Array, period: float, rng: np.random.Generator
) -> Array:
    rest = round(REST / firmware.tick)
    return run(firmware, plant, goals, round(period / firmware.tick), rest, rng).astype(float)


def _write(folder: Path, period: float, logs: Mapping[str, Mapping[str, Array]], told: str) -> Path:
    folder.mkdir()
    for name, columns in logs.items():
        times: Array = 1e3 * period * np.arange(float(len(columns["code"])))
        (folder / name).write_text(csv({"time_ms": times, **columns}, "%.9g"), encoding="utf-8")
    path = folder / "description.toml"
    path.write_text(told, encoding="utf-8")
    return path
