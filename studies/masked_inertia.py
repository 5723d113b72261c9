"""Is an added inertia listed, where the servo's own inertia masks it?

    python -m studies masked_inertia --seed 20263450

Two smart servos carry half or one and a half of their inertia more; their owner knows inertia and
resistance to 30 %, all else exactly.  Three random goals are held for 0.5 s each, and the log holds
the codes of the encoder without noise, so that the response is rough: it jumps as a code comes
sooner or later.
"""

from __future__ import annotations

import argparse
import math
import warnings
from dataclasses import replace
from itertools import product

import numpy as np

from servo_models.actuators.smart_servo.plant import COUNT
from servo_models.analysis.simulate import simulate
from servo_models.catalogue import model
from servo_models.data.arrays import describe
from servo_models.data.audit import LEAST_GAP
from servo_models.data.description import Description
from servo_models.diagnosis.search.candidates import candidates
from servo_models.diagnosis.search.fitting import Fitter
from servo_models.diagnosis.search.masking import masked_effects
from servo_models.diagnosis.search.screening import screening_results
from servo_models.identification.problem import prior_parameters

ADDED = "load_inertia"
SHARES = (0.5, 1.5)  # added inertia over the servo's own
RIGS = 6  # logs of each servo and share


def rig(variant: str, share: float, seed: int) -> Description:
    """Return the log of a servo that carries so much of its inertia more."""
    servo, times = model("smart_servo", variant), 5e-3 * np.arange(400.0)
    goals = np.random.default_rng(seed).uniform(-0.8, 0.8, 3)
    log = {"time": times, "goal": np.repeat([0.0, *goals], 100)}
    added = {f"{ADDED}.inertia": share * servo.values["inertia"]}
    loaded = model("smart_servo", variant, added)
    log["angle_reading"] = simulate(loaded, times, {"goal": log["goal"]})["angle_reading"]
    believed = {name: 0.3 * servo.values[name] for name in ("inertia", "resistance")}
    told = describe(servo, {"rig": log}, {name: name for name in log})
    return replace(told, uncertainty=believed)


def listed(told: Description) -> bool:
    """Return whether the added inertia is listed among what parameters mask."""
    floors = {"angle_reading": COUNT / math.sqrt(12.0)}
    fitter = Fitter(told.model, told.logs, prior_parameters(told), floors).surveyed()
    retuned = fitter.finish(fitter.fit((), ()))
    inertia = [it for it in candidates(told.model, told.logs) if it.name == ADDED]
    screened = screening_results([retuned.linearised], inertia)
    return bool(masked_effects(fitter, retuned, screened, LEAST_GAP))


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--seed", type=int, required=True, help="of the first goals")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    rigs = list(product(("xl330", "sts3215"), SHARES, range(given.seed, given.seed + RIGS)))
    found = sum(listed(rig(*it)) for it in rigs)
    print(f"listed in {found} of {len(rigs)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
