"""Does a size lie in its 95 % interval where the plant is not ours?

    python -m studies sizes --seed N --cases 30 --mix limits

Rigs of the second plant, both engines in turn.  The fitter of a diagnosis is told the names of what
is wrong, and begins with typical sizes.  What a rig has is compared with the estimate; play of the
rigs is the whole travel, ours half of it.  Counted are parameters of effects (sizes), and nominal
parameters, which have priors; not a friction that creeps, as MuJoCo's, which is no law of ours.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from servo_models.core.workers import Workers
from servo_models.data.audit import audits, noise_floors
from servo_models.data.description import read_description
from servo_models.diagnosis.search.fitting import Fitter
from servo_models.identification.fit import checked_logs
from servo_models.identification.problem import prior_parameters
from servo_models.withheld.oracle import told
from servo_models.withheld.score import share
from studies.second_plant.rigs import MIXES, NAMES, Rig, draw, recording

NORMAL_95 = 1.96
NAMED = {**{cause: sets[0] for cause, sets in NAMES.items()}, "play": ["coasting_backlash"]}
NAMED["friction_soft"] = ["presliding_friction"]
Row = tuple[str, float, float, float]  # name, estimate, standard error, true value [SI]


def judged(rig: Rig) -> Iterator[tuple[bool, Row]]:
    """Whether each is a size of an effect, and what is said of it, of a rig."""
    names = [name for cause in rig.causes for name in NAMED[cause]]
    true = {**rig.true, **rig.effects}
    if "stribeck_friction.excess" in true:
        names.append("stribeck_friction")
    if "friction_soft" in rig.causes:
        level = true.pop("coulomb_friction.level")
        if rig.engine == "two_mass":
            true["presliding_friction.level"] = level
            true["presliding_friction.speed"] = rig.drive.smooth_speed / 10.0
    with tempfile.TemporaryDirectory() as folder:
        for name, text in recording(rig).items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        described = read_description(Path(folder) / "description.toml")
    logs = checked_logs(described.model, described.logs)
    floors = noise_floors(audits(logs, described.model.plant))
    fitter = Fitter(described.model, logs, prior_parameters(described), floors).surveyed()
    found = fitter.finish(told(fitter, names, fitter.fit((), ())))
    for free, error in zip(found.problem.free, found.spread.standard_errors.tolist()):
        if free.name in true:
            row = (free.name, found.values[free.name], error, true[free.name])
            yield free.prior is None, row


def main() -> None:
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--cases", type=int, default=30)
    options.add_argument("--mix", default="limits", choices=MIXES)
    given = options.parse_args()
    rows: dict[bool, list[Row]] = {True: [], False: []}
    with warnings.catch_warnings(), Workers(1):
        warnings.simplefilter("ignore")
        for number in range(given.cases):
            for is_size, row in judged(draw(given.seed, number, mix=given.mix)):
                name, value, error, true = row
                known = 0.0 < error < np.inf
                if known and abs(value - true) > NORMAL_95 * error:
                    off = (value - true) / error
                    print(f"{number:04d} {name} {value:.4g}, true {true:.4g}: {off:+.1f} errors")
                rows[is_size] += [row] if known else []
    for is_size, every in rows.items():
        held = share(abs(value - true) <= NORMAL_95 * error for _, value, error, true in every)
        wide = np.median([error / abs(value) for _, value, error, _ in every]) if every else 0.0
        print(f"{'sizes' if is_size else 'nominal'}: {held}, median error {100.0 * wide:.1f} %")


if __name__ == "__main__":
    main()
