"""Is an effect named beside a parameter that is far from what is believed?

    python -m studies far_parameters [--out FILE.json]

A bus servo that should answer within 5 ms is late by 30 ms, or by 45 ms and faster by a quarter.
Beside that it has one effect of the catalogue, each in turn, at the middle one of its trial values,
or none.  One line a rig says what is diagnosed: ``named`` is that effect alone, ``in the set`` one
that these logs do not tell from it, ``unseen`` parameters alone, ``wrong`` all else.
"""

from __future__ import annotations

import argparse
import json
import warnings
from pathlib import Path

import numpy as np

from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.core.types import Array
from servo_models.data.arrays import describe
from servo_models.diagnosis.diagnose import diagnose
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.verdict import PARAMETERS

BELIEVED = {
    "natural_frequency": 15.0,
    "damping_ratio": 0.24,
    "transport_delay.time": 2.5e-3,
    "speed_limit": 2.3,
}
"""Standard deviations [SI]."""
FAR = {
    "30 ms": {"transport_delay.time": 0.030},
    "45 ms": {"transport_delay.time": 0.045, "natural_frequency": 20.0},
}
TIMES: Array = 0.01 * np.arange(1200.0)
NOISE = 2e-3  # rad


def goals() -> Array:
    """Steps, then a sweep [rad]."""
    levels = np.random.default_rng(1).uniform(-0.8, 0.8, 12)
    levels[0] = 0.0
    sweep = 0.4 * np.sin(2.0 * np.pi * (0.3 * TIMES + 0.12 * TIMES**2))
    return np.where(TIMES < 6.0, np.repeat(levels, 100), sweep)


def said(true: dict[str, float], name: str) -> dict[str, object]:
    """What is diagnosed of a servo with these values [SI], whose effect is ``name``."""
    noise = NOISE * np.random.default_rng(0).standard_normal(len(TIMES))
    angle = simulate(model("second_order_servo", "bus", true), TIMES, {"goal": goals()})["angle"]
    log = {"time": TIMES, "goal": goals(), "angle": angle + noise}
    columns = {"time": "time", "goal": "goal", "angle": "angle"}
    servo = model("second_order_servo", "bus")
    found = diagnose(describe(servo, {"rig": log}, columns, uncertainty=BELIEVED), jobs=1)
    taken = found.selection.taken
    members = {*found.verdict.members, *taken.effects}
    if taken.effects == (name,) or (not name and not taken.effects):
        kind = "named"
    elif found.verdict.kind == PARAMETERS:
        kind = "unseen"
    else:
        kind = "in the set" if len(taken.effects) == 1 and name in members else "wrong"
    delay = taken.values["transport_delay.time"]
    return {"said": kind, "effects": list(taken.effects), "delay_ms": round(1e3 * delay, 2)}


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="every answer, as JSON")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    rows, chosen = list[dict[str, object]](), model("second_order_servo", "bus")
    sizes: dict[str, dict[str, float]] = {"": {}}
    for one in candidates(chosen, ()):
        ordered = sorted(one.trial_values, key=lambda size: max(size.values()))
        sizes[one.name] = dict(ordered[len(ordered) // 2])
    for name, size in sizes.items():
        for far, values in FAR.items():
            answer = said({**values, **size}, name)
            rows.append({"effect": name, "late": far, **answer})
            print(f"{name or 'nothing':22} {far}  {answer}", flush=True)
    for kind in ("named", "in the set", "unseen", "wrong"):
        print(f"{kind:12} {sum(row['said'] == kind for row in rows)} of {len(rows)}")
    if given.out:
        given.out.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
