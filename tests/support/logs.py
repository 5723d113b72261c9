"""Logs made of arrays or of a simulated rig, in SI, without a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.analysis.simulate import simulate
from servo_models.core.simulate import Model
from servo_models.core.types import Array
from servo_models.data.log import Channel, Log


def log_of(
    times: Array, inputs: Mapping[str, Array], outputs: Mapping[str, Array], **more: Any
) -> Log:
    """A log with a row for each sample, none held out; ``more`` are fields of ``Log``."""
    rows = np.arange(len(times))
    channels = {name: Channel(name, name, "rad") for name in outputs}
    log = Log("log", Path("log.csv"), "", times, inputs, outputs, channels, rows, rows < 0)
    return replace(log, **more)


def changed(chosen: Model, values: Mapping[str, float]) -> Model:
    """The model with other values, whatever its bounds."""
    return replace(chosen, values={**chosen.values, **values})


def measured(
    rig: Model,
    times: Array,
    inputs: Mapping[str, Array],
    noise: Mapping[str, float],
    seed: int = 0,
    **more: Any,
) -> Log:
    """What a rig answers in the outputs named in ``noise`` [SI, standard deviation, white]."""
    random = np.random.default_rng(seed)
    answers = simulate(rig, times, inputs)
    outputs = {
        name: answers[name] + size * random.standard_normal(len(times))
        for name, size in noise.items()
    }
    return log_of(times, inputs, outputs, **more)
