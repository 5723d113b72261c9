"""Effects that a diagnosis takes and does not assert: how often were they there?

    python -m studies withheld.generator runs/31 --cases 300 --seed 31 --tiers rough --kinds one,two
    python -m studies golden --cases runs/31 --out runs/31.jsonl
    python -m studies doubted runs/31                        # as the shipped map tells it
    python -m studies doubted runs/31 runs/32 --write        # learn the map of these cases

An effect is *doubted* where logs do not determine its size, its fit did not converge, or what is
held out gets worse.  The table has the probability by model weight alone, the one that is told, and
the share that was there with its 95 % interval (Wilson).  Give folders of seeds that had no part in
the map, or the figures look too good.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from servo_models.diagnosis.calibration import DATA, calibrated, doubtful
from servo_models.diagnosis.verdict import EFFECT, EFFECTS
from servo_models.files import write_whole
from servo_models.withheld.score import share
from studies.calibrate import DIGITS, learn, text_of
from studies.golden import truths

EDGES = (0.0, 0.5, 0.9, 1.0)  # of the probability by weight alone


class Taken(NamedTuple):
    """An effect that a diagnosis took: its probability by model weight alone, whether the
    diagnosis doubts it, and whether it was there."""

    alone: float
    doubted: bool
    there: bool

    @property
    def told(self) -> float:
        return doubtful(self.alone) if self.doubted else self.alone


def effects_taken(folder: Path) -> list[Taken]:
    """Return the effects taken in cases of a folder, whose answers are in ``FOLDER.jsonl``."""
    known, found = truths(folder), []
    for line in folder.with_suffix(".jsonl").read_text("utf-8").splitlines():
        row = json.loads(line)
        answer, truth = row["answer"], known[row["case"]]
        if answer["verdict"] not in (EFFECT, EFFECTS) or truth["kind"] not in ("one", "two"):
            continue
        there = {cause["name"] for key in ("effects", "hidden") for cause in truth[key]}
        alone = calibrated(answer["weights"], answer["verdict"])
        found += [
            Taken(alone[name], name in answer["doubted"], name in there) for name in answer["named"]
        ]
    return found


def table(taken: Sequence[Taken]) -> Iterable[str]:
    """Lines of the table, those asserted first."""
    yield "effects | probability by weight | mean | told | there | 95 % | n"
    for doubted in (False, True):
        for low, high in pairwise(EDGES):
            few = [e for e in taken if e.doubted == doubted and low <= e.alone < high]
            if few:
                alone, told = (np.mean([getattr(e, key) for e in few]) for key in ("alone", "told"))
                seen = share(e.there for e in few)
                yield (
                    f"{'doubted' if doubted else 'asserted'} | {low:g} to {high:g} | {alone:.2f} |"
                    f" {told:.2f} | {seen.value:.2f} | {seen.low:.2f} to {seen.high:.2f} | {seen.n}"
                )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", nargs="+", type=Path, help="of cases; answers in FOLDER.jsonl")
    parser.add_argument("--write", action="store_true", help=f"write the map into {DATA.name}")
    given = parser.parse_args()
    taken = [effect for folder in given.folders for effect in effects_taken(folder)]
    print("\n".join(table(taken)))
    if given.write:
        doubted = [effect for effect in taken if effect.doubted]
        alone, there = (
            np.array(x, dtype=float) for x in zip(*((e.alone, e.there) for e in doubted))
        )
        # one at each tenth as the weight alone tells it: few effects shall not tell "never"
        alone, there = (np.concatenate([it, np.linspace(0.0, 1.0, 11)]) for it in (alone, there))
        weights, told = learn(alone, there, np.ones(len(alone)))
        known = json.loads(DATA.read_text(encoding="utf-8"))
        sealed = [json.loads((it / "answers.json").read_text("utf-8")) for it in given.folders]
        known["doubted"] = {
            "seeds": [one["seed"] for one in sealed],
            "effects": len(doubted),
            "weight": weights.tolist(),
            "probability": told.round(DIGITS).tolist(),
        }
        write_whole(DATA, text_of(known).encode())


if __name__ == "__main__":
    main()
