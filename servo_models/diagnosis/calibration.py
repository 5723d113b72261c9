"""Probabilities that mean what they say: of effects with such a weight, how many were there.

Model weights come out too sure, since the law that acts is hardly ever among the models.  So a
monotone map for each kind of verdict, learnt on withheld rigs whose causes are known, turns the
weight of an effect into its probability.  There is one map for easy and for hard logs, each tier
counted alike, since nobody knows the tier of a real log.

A map is monotone, so it keeps the order of the effects.  A probability is that of one effect being
among the causes.  Several may be, so those of a diagnosis need not add up to 1, and are not scaled
to.  A verdict without a map, "outside the catalogue", has weights that rank and no probabilities.

An effect whose size the logs do not determine was there less often than others of its weight.  So
another map turns its probability into that of such an effect (``doubtful``).

``calibration.json`` holds the maps and where they are from; ``studies/calibrate.py`` writes it.
Source: Zadrozny, Elkan, Proc. 8th ACM SIGKDD (2002) 694 (isotonic regression of scores).
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.core.types import Array

DATA = Path(__file__).with_name("calibration.json")
LEAST_PROBABILITY = 0.001  # least that is told: rigs behind a map are too few for a rarer one
MOST_PROBABILITY = 0.97  # the same for what is surer: a real log differs from every withheld rig

Map = tuple[Array, Array]  # growing weights, and the probability at each


def calibrated(weights: Mapping[str, float], verdict: str) -> dict[str, float]:
    """Return the probability of each effect by name, none for a verdict without a map.

    ``weights`` are the effects' shares of the model weights, 0 to 1.
    """
    if verdict not in maps():
        return {}
    told = probability(np.array(list(weights.values())), maps()[verdict])
    return dict(zip(weights, told.tolist()))


def probability(weights: Array, by: Map) -> Array:
    """Return what a map makes of weights; it goes on level beyond its ends."""
    return np.clip(np.interp(weights, *by), LEAST_PROBABILITY, MOST_PROBABILITY)


def doubtful(told: float) -> float:
    """Return the probability of an effect that is not asserted, from the one by its weight."""
    return float(probability(np.array(told), doubt()))


@cache
def doubt() -> Map:
    """The map from a probability by weight to that of an effect that is not asserted."""
    known: dict[str, Any] = json.loads(DATA.read_text(encoding="utf-8"))["doubted"]
    return np.array(known["weight"]), np.array(known["probability"])


@cache
def maps() -> dict[str, Map]:
    """The map of each kind of verdict, as shipped."""
    known: dict[str, Any] = json.loads(DATA.read_text(encoding="utf-8"))["maps"]
    return {
        verdict: (np.array(one["weight"]), np.array(one["probability"]))
        for verdict, one in known.items()
    }
