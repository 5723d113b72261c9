"""Is a fault named where the model is a simulation that is not ours?

    python -m studies foreign_rigs OUT --seed N          # from a checkout: its FMUs are the tests'

Four simulations: an FMU of FMI 2.0 that takes any step, one of FMI 3.0 that takes steps of 5 ms
only, both compiled here and without states to restore, a Python function, and a joint of MuJoCo.
Of each there are rigs with one effect at the border, and clean ones.  A rig is integrated here
anew, in steps of 0.2 ms, with constants that scatter as the description says; its effects,
commands and encoder are those of the other studies' rigs, and nothing is shared with the package.

An effect counts as right by what it is: gain, offset, lag or quantisation before a simulation that
is linear are the same as behind it.  OUT that is there goes on.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from servo_models import diagnose
from servo_models.diagnosis.ranking import RankedEffect
from servo_models.diagnosis.verdict import NO_GAP, OUTSIDE, PARAMETERS
from servo_models.withheld.generator.simulation import read, settled, travelled
from servo_models.withheld.rig.laws import CODE, Array, code_of
from servo_models.withheld.rig.recording import TIME, column, csv, description
from servo_models.withheld.score import share
from studies import black_box
from studies.second_plant.rigs import FARTHEST, LOGS, goals
from tests.support.foreign_fmus import Foreign, Var

PLANTED, CLEAN = 10, 3  # rigs of a kind with an effect, and without
STEP = 2e-4  # s, of the rigs
REST = (1.0, 1.2)  # s for which a rig rests before a log
HASTE = 2.0  # of commands over those of the second plant, which is slower
RATIO = (5.0, 200.0)  # of the gap that an effect makes over the noise floor
NOISE = (0.2, 0.8)  # standard deviation before the encoder counts, in codes

Values = Mapping[str, float]
Rates = Callable[[Sequence[float], float], tuple[float, ...]]
"""Of the states, the angle first, from these and the goal."""

CAUSES: dict[str, dict[str, tuple[float, float]]] = {
    "transport_delay": {"command.delay": (5e-3, 0.04)},
    "command_lag": {"command.filter_time": (5e-3, 0.03)},
    "sample_hold": {"command.hold": (0.02, 0.06)},
    "dead_band": {"command.dead_band": (0.01, 0.05)},
    "command_quantisation": {"command.step": (0.03, 0.1)},
    "command_offset": {"command.offset": (5e-3, 0.02)},
    "command_gain": {"command.gain": (0.02, 0.06)},
    "command_saturation": {"command.ceiling": (0.35, 0.8)},
    "rate_limit": {"command.slew": (8.0, 20.0)},
    "motion_profile": {"command.cruise": (10.0, 20.0), "command.speeding_time": (0.03, 0.1)},
    "backlash": {"reading.play": (5e-3, 0.03)},
    "sensor_lag": {"reading.lag": (5e-3, 0.03)},
    "sensor_gain": {"reading.gain": (0.02, 0.06)},
    "sensor_offset": {"reading.offset": (5e-3, 0.02)},
    "sensor_quantisation": {"reading.step": (0.02, 0.06)},
}
"""Sizes of what may be planted [SI], by the settings of the withheld generator; drawn until what
an effect makes is in ``RATIO``."""
SIGNED = ("gain", "offset")
CLEARED = (NO_GAP, PARAMETERS)


def geared_motor(p: Values) -> Rates:
    """Rates of angle, speed and current; drag and inductance are known."""

    def rates(x: Sequence[float], goal: float) -> tuple[float, ...]:
        angle, speed, current = x
        torque = p["torque_constant"] * current - 0.04 * speed
        voltage = p["gain"] * (goal - angle) - p["torque_constant"] * speed
        return speed, torque / p["inertia"], (voltage - p["resistance"] * current) / 4e-3

    return rates


def limited_servo(p: Values) -> Rates:
    """Rates of angle and speed, which is back at its limit after a step beyond."""
    stiffness, drag = p["frequency"] ** 2, 2.0 * p["damping"] * p["frequency"]

    def rates(x: Sequence[float], goal: float) -> tuple[float, ...]:
        angle, speed = x
        push = stiffness * (goal - angle) - drag * speed
        bounded = min(max(speed, -p["largest_speed"]), p["largest_speed"])
        stopped = abs(speed) >= p["largest_speed"] and push * speed > 0.0
        return bounded, (bounded - speed) / STEP if stopped else push

    return rates


def cascade(p: Values) -> Rates:
    """Rates of angle, speed and the integral part of the loop of speed."""

    def rates(x: Sequence[float], goal: float) -> tuple[float, ...]:
        angle, speed, part = x
        wanted = p["position_gain"] * (goal - angle)
        off = min(max(wanted, -p["largest_speed"]), p["largest_speed"]) - speed
        return speed, p["speed_gain"] * off + part, p["speed_gain"] / 0.2 * off

    return rates


def hanging_arm(p: Values) -> Rates:
    """Rates of angle and speed of a ball of 0.3 kg and 2 cm at 0.15 m, which gravity pulls."""
    inertia = p["armature"] + 0.3 * (0.15**2 + 0.4 * 0.02**2)

    def rates(x: Sequence[float], goal: float) -> tuple[float, ...]:
        angle, speed = x
        torque = p["kp"] * (goal - angle) - (p["kv"] + p["damping"]) * speed
        return speed, (torque - 0.3 * 9.81 * 0.15 * math.sin(angle)) / inertia

    return rates


FUNCTION = """
import numpy as np

INPUTS = {"goal": "90 deg"}
OUTPUTS = {"angle": "90 deg"}
PARAMETERS = {"position_gain": 12.0, "speed_gain": 50.0, "largest_speed": "4 rad/s"}
STEP = 0.001

def simulate(parameters, times, inputs):
    fast, gain = parameters["position_gain"], parameters["speed_gain"]
    most = parameters["largest_speed"]
    angle = speed = part = 0.0
    out = [angle]
    for goal, h in zip(inputs["goal"], np.diff(times)):
        off = min(max(fast * (goal - angle), -most), most) - speed
        part += h * gain / 0.2 * off
        before, speed = speed, speed + h * (gain * off + part)
        angle += h * 0.5 * (before + speed)
        out.append(angle)
    return {"angle": np.array(out)}
"""
MJCF = """
<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="RK4"/>
  <worldbody><body>
    <joint name="elbow" axis="0 1 0" damping="0.3" armature="0.02" range="-2 2"/>
    <geom type="sphere" size="0.02" mass="0.3" pos="0 0 -0.15"/>
  </body></worldbody>
  <actuator><position name="drive" joint="elbow" kp="20" kv="0.5"/></actuator>
</mujoco>
"""


@dataclass(frozen=True)
class Kind:
    """A kind of simulation.

    Attributes:
        actuator: as a description calls it.
        signals: names of the command and of the angle.
        rates: its law, of a rig with other parameters.
        states: how many.
        nominal: parameters of the simulation [SI].
        uncertainty: their standard deviations, as shares; a rig has 0 of what is not in it.
        periods: of the logs [ms].
        text: of the file; an FMU is compiled.
        fmu: version of FMI, and its step [s].
    """

    actuator: str
    signals: tuple[str, str]
    rates: Callable[[Values], Rates]
    states: int
    nominal: Values
    uncertainty: Values
    periods: tuple[int, ...]
    text: str = ""
    fmu: tuple[str, float] = ("", 0.0)

    def write(self, folder: Path) -> None:
        """Write the simulation."""
        if self.text:
            (folder / self.actuator.partition(":")[0].partition("#")[0]).write_text(self.text)
            return
        version, step = self.fmu
        real = "Float64" if version == "3.0" else "Real"
        command, angle = self.signals
        variables = (
            Var(command, "input", real, unit="rad"),
            Var(angle, "output", real, unit="rad"),
            *(
                Var(name, "parameter", real, place, start=str(value))
                for place, (name, value) in enumerate(self.nominal.items())
            ),
        )
        name = self.actuator.removesuffix(".fmu")
        any_step = version == "2.0"
        Foreign(name, version, variables, 1.0, step, self.curves, any_step=any_step).write(folder)

    def curves(self, times: Array, inputs: Mapping[str, Array]) -> dict[str, Array]:
        """Return the angle by the law of a rig, at steps of ``STEP``."""
        command, angle = self.signals
        fine = round((times[1] - times[0]) / STEP)
        moved = integrated(self.rates(self.nominal), self.states, np.repeat(inputs[command], fine))
        return {angle: moved[::fine]}


KINDS = {
    "fmi2": Kind(
        "servo.fmu",
        ("goal", "angle"),
        geared_motor,
        3,
        {"gain": 20.0, "resistance": 2.0, "torque_constant": 0.4, "inertia": 4e-3},
        {"resistance": 0.04, "torque_constant": 0.04, "inertia": 0.05},
        (6, 8, 10),
        fmu=("2.0", 2e-3),
    ),
    "fmi3": Kind(
        "limited.fmu",
        ("goal", "angle"),
        limited_servo,
        2,
        {"frequency": 30.0, "damping": 0.8, "largest_speed": 4.0},
        {"frequency": 0.04, "damping": 0.06, "largest_speed": 0.05},
        (5, 10),
        fmu=("3.0", 5e-3),
    ),
    "function": Kind(
        "cascade.py:simulate",
        ("goal", "angle"),
        cascade,
        3,
        {"position_gain": 12.0, "speed_gain": 50.0, "largest_speed": 4.0},
        {"position_gain": 0.04, "speed_gain": 0.06, "largest_speed": 0.05},
        (6, 8, 10),
        FUNCTION,
    ),
    "mjcf": Kind(
        "arm.xml#elbow",
        ("command", "angle"),
        hanging_arm,
        2,
        {"kp": 20.0, "kv": 0.5, "damping": 0.3, "armature": 0.02},
        {"kp": 0.05, "damping": 0.2, "armature": 0.05},
        (6, 8, 10),
        MJCF,
    ),
}


def integrated(rates: Rates, states: int, command: Array) -> Array:
    """Return the angle at each row of a command that is held for ``STEP``, by Heun's method."""
    x, angles = (0.0,) * states, []
    for goal in command.tolist():
        angles.append(x[0])
        first = rates(x, goal)
        second = rates([a + STEP * da for a, da in zip(x, first)], goal)
        x = tuple(a + 0.5 * STEP * (da + db) for a, da, db in zip(x, first, second))
    return np.array(angles)


def reading(law: Rates, states: int, goal: Array, period: int, rest: int, effect: Values) -> Array:
    """Return what is read at the rows of a log [rad], before noise.

    Args:
        law, states: of the rig.
        goal: one value a row [rad].
        period: of the rows [steps].
        rest: steps before the log.
        effect: settings of the withheld generator.
    """
    every = settled(effect)
    command = np.concatenate([np.zeros(rest), np.repeat(goal, period)])
    sent = travelled(command, np.zeros(len(command)), every, STEP)
    return np.asarray(read(integrated(law, states, sent), every, STEP)[rest::period])


def write(folder: Path, kind: Kind, cause: str, rng: np.random.Generator) -> dict[str, Any]:
    """Write a rig with a cause, "" for none, into a new folder; return what is true of it."""
    folder.mkdir(parents=True, exist_ok=True)
    kind.write(folder)
    off = {key: np.clip(rng.standard_normal(), -FARTHEST, FARTHEST) for key in kind.nominal}
    true = {
        key: value * (1.0 + kind.uncertainty.get(key, 0.0) * float(off[key]))
        for key, value in kind.nominal.items()
    }
    law, row = kind.rates(true), int(rng.choice(kind.periods))
    period, rest = round(1e-3 * row / STEP), round(float(rng.uniform(*REST)) / STEP)
    noise = float(rng.uniform(*NOISE))
    commands = goals(HASTE * 1e-3 * row, rng)

    def played(effect: Values) -> list[Array]:
        return [reading(law, kind.states, goal, period, rest, effect) for goal in commands]

    effect: dict[str, float] = {}
    clean = logs = played(effect)
    gap = 0.0
    floor = CODE * math.hypot(noise, 1.0 / math.sqrt(12.0))
    while cause and not RATIO[0] <= gap / floor <= RATIO[1]:
        effect = {key: float(rng.uniform(*sizes)) for key, sizes in CAUSES[cause].items()}
        if cause.endswith(SIGNED) and rng.random() < 0.5:
            effect = {key: -value for key, value in effect.items()}
        logs = played(effect)
        gap = float(np.sqrt(np.mean(np.concatenate([a - b for a, b in zip(logs, clean)]) ** 2)))
    for name, goal, angles in zip(LOGS, commands, logs):
        codes = [code_of(angle, CODE, noise * float(rng.standard_normal())) for angle in angles]
        columns = {
            "time_ms": row * np.arange(float(len(goal))),
            "goal_rad": goal,
            "code": np.array(codes, dtype=float),
        }
        (folder / name).write_text(csv(columns, ["%g", "%.9f", "%d"]), encoding="utf-8")
    command, angle = kind.signals
    lines = [
        TIME,
        column(f"inputs.{command}", "goal_rad", "rad"),
        column(f"outputs.{angle}", "code", "rad", CODE),
    ]
    told = description(
        kind.actuator, "given", kind.uncertainty, ([f'file = "{name}"', *lines] for name in LOGS)
    )
    (folder / "description.toml").write_text(told, encoding="utf-8")
    return {"truth": cause, "effect": effect, "parameters": true, "gap_floors": gap / floor}


def written(folder: Path, seed: int) -> list[dict[str, Any]]:
    """Write the rigs of every kind and their answers, where they are not there; return these."""
    answers = folder / "answers.json"
    if not answers.exists():
        rows = []
        for number, (name, kind) in enumerate(KINDS.items()):
            rng = np.random.default_rng([seed, number])
            causes = [*rng.permutation([*CAUSES])[:PLANTED].tolist(), *[""] * CLEAN]
            for count, cause in enumerate(causes):
                case = f"{name}_{count:02d}"
                row = write(folder / "cases" / case, kind, cause, rng)
                rows.append({"case": case, "kind": name, **row})
        answers.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    found: list[dict[str, Any]] = json.loads(answers.read_text("utf-8"))
    return found


def processor_seconds(process: int) -> float:
    """Of a process of Linux, of its children and of those that have ended."""
    own = Path(f"/proc/{process}")
    spent = own.joinpath("stat").read_text("utf-8").rpartition(")")[2].split()[11:15]
    children = own.joinpath(f"task/{process}/children").read_text("utf-8").split()
    alive = sum(processor_seconds(int(child)) for child in children)
    return alive + sum(map(int, spent)) / os.sysconf("SC_CLK_TCK")


def diagnosed(path: Path) -> dict[str, Any]:
    """Return what is said of a description, and what it took."""
    begin, spent = time.perf_counter(), processor_seconds(os.getpid())
    found = diagnose(path, jobs=1)
    return {
        "verdict": found.verdict.kind,
        "named": [called(one) for one in found.ranking if one.taken],
        "ranking": [called(one) for one in found.ranking],
        "set": [called(one) for one in found.ranking if one.in_set],
        "rest": round(found.verdict.rest, 2),
        "processor_seconds": round(processor_seconds(os.getpid()) - spent, 1),
        "seconds": round(time.perf_counter() - begin, 1),
    }


def called(effect: RankedEffect) -> str:
    """Its name; a profile whose acceleration takes no time is a rate limit by another name."""
    times = [it.value for it in effect.parameters if it.name.endswith("acceleration_time")]
    return "rate_limit" if times and times[0] < STEP else effect.name


def what(name: str) -> str:
    """What an effect is, before a simulation or behind it."""
    return "gain" if name.endswith("_gain") else black_box.kind(name)


def figures(rows: Sequence[dict[str, Any]]) -> list[str]:
    """Return the lines of the table: shares with 95 % intervals."""
    planted = [row for row in rows if row["truth"]]
    clean = [row for row in rows if not row["truth"]]

    def first(row: dict[str, Any]) -> bool:
        return bool(row["named"]) and what(row["ranking"][0]) == what(row["truth"])

    def others(row: dict[str, Any]) -> set[str]:
        return {*map(what, row["named"])} - {what(row["truth"])}

    counted = {
        "first in the ranking": (first(row) for row in planted),
        "named, and nothing else": (bool(row["named"]) and not others(row) for row in planted),
        "in the set": (what(row["truth"]) in map(what, row["set"]) for row in planted),
        "something false is named": (bool(others(row)) for row in planted),
        "outside the catalogue": (row["verdict"] == OUTSIDE for row in planted),
        "suspected on a clean rig": (row["verdict"] not in CLEARED for row in clean),
    }
    lines = []
    for about, flags in counted.items():
        one = share(flags)
        if one.n:
            lines.append(f"{about} | {one.value:.2f} ({one.low:.2f} to {one.high:.2f}) | {one.n}")
    spent = [row["processor_seconds"] for row in rows]
    return [
        *lines,
        f"processor seconds, median and most | {np.median(spent):.0f}, {max(spent):.0f}",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path, help="folder of cases, answers and results")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--kinds", default=",".join(KINDS), help="that are diagnosed now")
    given = parser.parse_args()
    results = given.out / "results.jsonl"
    answers = written(given.out, given.seed)
    lines = results.read_text("utf-8").splitlines() if results.exists() else []
    rows = [json.loads(line) for line in lines]
    done = {row["case"] for row in rows}
    for known in answers:
        if known["case"] not in done and known["kind"] in given.kinds.split(","):
            said = diagnosed(given.out / "cases" / known["case"] / "description.toml")
            rows.append({**known, **said})
            with results.open("a", encoding="utf-8") as out:
                out.write(json.dumps(rows[-1]) + "\n")
    print("case | truth | verdict | named | set | rest | processor seconds")
    for row in rows:
        lists = [", ".join(row[key]) for key in ("named", "set")]
        ends = (row["rest"], row["processor_seconds"])
        print(row["case"], row["truth"] or "nothing", row["verdict"], *lists, *ends, sep=" | ")
    for name in (*KINDS, ""):
        if of_kind := [row for row in rows if name in ("", row["kind"])]:
            print(f"\n{name or 'all'}", *figures(of_kind), sep="\n")


if __name__ == "__main__":
    main()
