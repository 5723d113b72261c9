"""Does the diagnosis name the limits that smart servos have in firmware, and with which value?

Logs are simulated by the model itself, with encoder counts and the hold of 1 ms: two of them, steps
of several sizes and a sum of sines.  The readings have noise of half a count before they are
rounded.  True constants lie within the stated uncertainties, one standard deviation at the most,
and the nominal model has none of the limits.

*current*: limit in the winding.  *duty*: limit of the PWM.  *velocity*: profile without
acceleration time.  *acceleration*: profile whose velocity is that of the motor without load, and
which no step reaches.  *both*: a trapezoid.  *none*: no limit.

A case is *named* where the effect is in the selection, *alone* where nothing else is; the value
found stands beside the true one.  An angle alone tells no amperes: a current, inertia and
1 / resistance that are all larger move alike.  So the acceleration at the limit stands beside the
true one as well: k limit / inertia of a current, k supply limit / (resistance inertia) of a duty.

Run: ``python -m studies firmware_limits [--seeds 2] [--seed 0] [--limit current ...]``.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import servo_models as sm
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.diagnosis.result import Diagnosis
from servo_models.withheld.rig.laws import CODE

STEP_S = 5e-3
NOISE_COUNTS = 0.5
UNCERTAINTY = {"torque_constant": 0.1, "resistance": 0.1, "inertia": 0.15, "loop_factor": 0.1}
VARIANTS = ("xl330", "sts3215")
TOP_SPEED = {"xl330": 10.8, "sts3215": 5.4}  # no-load speed [rad/s] of the data sheet
STALL_CURRENT = {"xl330": 1.1, "sts3215": 1.4}  # the same, stall current [A]
SIZES = (0.25, 0.5)  # of a limit, over what the motor can do
LIMITS = {
    "current": "current_limit",
    "duty": "drive_saturation",
    "velocity": "motion_profile",
    "acceleration": "motion_profile",
    "both": "motion_profile",
    "none": "",
}
"""Effects by what is wrong."""


@dataclass(frozen=True)
class Case:
    """What is wrong, on which servo, how tight it is, and the seed of everything else."""

    limit: str
    variant: str
    size: float
    seed: int

    @property
    def true(self) -> dict[str, float]:
        """Parameters of the limit [SI]."""
        top = TOP_SPEED[self.variant]
        acceleration = 40.0 * self.size * top  # up to the top speed in 50 or 100 ms
        return {
            "current": {"current_limit.limit": self.size * STALL_CURRENT[self.variant]},
            "duty": {"drive_saturation.limit": self.size},
            "velocity": {"motion_profile.velocity": self.size * top},
            "acceleration": {
                "motion_profile.velocity": top,
                "motion_profile.acceleration_time": top / acceleration,
            },
            "both": {
                "motion_profile.velocity": self.size * top,
                "motion_profile.acceleration_time": 0.1,
            },
            "none": {},
        }[self.limit]


def goals(random: np.random.Generator) -> Mapping[str, Array]:
    """Goals [rad] by log, from rest on."""
    sizes = random.permutation([0.1, 0.25, 0.5, 0.8, 1.2])
    levels = np.concatenate([[0.0], *[[size, 0.0] for size in sizes]])
    times = STEP_S * np.arange(600)
    sines = sum(
        0.5 / k * (np.sin(2.0 * math.pi * 0.4 * k * times + phase) - math.sin(phase))
        for k, phase in enumerate(random.uniform(-math.pi, math.pi, 4), 1)
    )
    return {"steps": np.repeat(levels, 70), "sines": np.asarray(sines)}


def rig(case: Case, random: np.random.Generator) -> Model:
    """The true servo."""
    nominal = sm.model("smart_servo", case.variant)
    off = {
        name: nominal.values[name] * (1.0 + share * random.uniform(-1.0, 1.0))
        for name, share in UNCERTAINTY.items()
    }
    return sm.model("smart_servo", case.variant, {**off, **case.true})


def logs(case: Case) -> dict[str, dict[str, Array]]:
    """What is measured: goal and reading [rad] every 5 ms."""
    random = np.random.default_rng(case.seed)
    true = rig(case, random)
    found: dict[str, dict[str, Array]] = {}
    for name, goal in goals(random).items():
        times: Array = STEP_S * np.arange(float(len(goal)))
        angle = sm.simulate(true, times, {"goal": goal})["angle"] / CODE
        noisy = angle + NOISE_COUNTS * random.standard_normal(len(angle))
        found[name] = {"t": times, "goal": goal, "reading": CODE * np.round(noisy)}
    return found


def acceleration(values: Mapping[str, float], name: str, supply: float) -> float:
    """Acceleration [rad/s2] at standstill by a limit of current or duty."""
    current = values[name] * (1.0 if name.startswith("current") else supply / values["resistance"])
    return values["torque_constant"] * current / values["inertia"]


def diagnosed(case: Case) -> Diagnosis:
    """Diagnose a case with the nominal model."""
    description = sm.describe(
        sm.model("smart_servo", case.variant),
        logs(case),
        {"time": "t", "goal": "goal", "angle_reading": "reading"},
        uncertainty={name: f"{100.0 * share:g} %" for name, share in UNCERTAINTY.items()},
    )
    return sm.diagnose(description)


def told(case: Case) -> tuple[bool, bool, str]:
    """Whether the limit is named, whether alone, and a line of text."""
    found = diagnosed(case)
    effects = found.selection.taken.effects
    named = LIMITS[case.limit] in effects if LIMITS[case.limit] else not effects
    values = [
        f"{name.partition('.')[2]} {found.fitted.values[name]:.4g} ({true:.4g})"
        for name, true in case.true.items()
        if named
    ]
    true = rig(case, np.random.default_rng(case.seed))
    supply = float(true.plant.wire["supply"].rest)
    values += [
        "acceleration {:.4g} ({:.4g}) rad/s2".format(
            *(acceleration(one.values, name, supply) for one in (found.fitted, true))
        )
        for name in case.true
        if named and name.endswith(".limit")
    ]
    line = f"{found.verdict.kind}: {', '.join(effects) or '-'}; {', '.join(values) or '-'}"
    return named, named and len(effects) <= 1, line


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0, help="the first one")
    parser.add_argument("--limit", nargs="*", default=list(LIMITS), choices=list(LIMITS))
    options = parser.parse_args()
    for limit in options.limit:
        cases = [
            Case(limit, variant, size, seed)
            for seed in range(options.seed, options.seed + options.seeds)
            for variant in VARIANTS
            for size in (SIZES if LIMITS[limit] else SIZES[:1])
        ]
        counts = np.zeros(2, dtype=int)
        for case in cases:
            named, alone, line = told(case)
            counts += (named, alone)
            print(f"{limit} {case.variant} {case.size:g} seed {case.seed}: {line}", flush=True)
        print(f"{limit}: named in {counts[0]} of {len(cases)}, alone in {counts[1]}", flush=True)


if __name__ == "__main__":
    main()
