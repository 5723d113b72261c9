"""An example to begin with: a log whose truth is known, and its description."""

from __future__ import annotations

import math
import os.path
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from servo_models.analysis.simulate import simulate
from servo_models.data.parameters import read_parameters
from servo_models.data.tables import write_signals
from servo_models.errors import UserError
from servo_models.files import write_whole

RIG, DESCRIPTION = "example_rig.toml", "example.toml"  # beside this file
NOISE = math.radians(0.05)
STEP = 0.01  # s
GOAL = {0.0: 0, 0.5: 0, 0.51: 30, 1.5: 30, 1.51: -20, 2.5: -20, 4.0: 15, 4.5: 15, 6.0: -5}
"""Corners [deg] by their times [s]."""


def write_example(path: Path) -> Path:
    """Write a description to ``path`` and its log, a CSV of the same name; return the log.

    A folder that is missing is made.

    Raises:
        UserError: no .toml, a file that is there, or a folder that cannot be written.
    """
    log = path.with_suffix(".csv")
    if path.suffix != ".toml":
        raise UserError(f"'{path}' is no description: let the name end in .toml")
    for file in (path, log):
        if os.path.lexists(file):
            raise UserError(f"'{file}' is there, and is not overwritten: choose another name")
    shipped = files(__package__)
    with as_file(shipped / RIG) as file:
        rig = read_parameters(file).model()
    times = np.arange(0.0, 6.0, STEP)
    goal = np.radians(np.interp(times, list(GOAL), list(GOAL.values())))
    reading = simulate(rig, times, {"goal": goal})["angle_reading"]
    reading = reading + np.random.default_rng(1).normal(0.0, NOISE, len(times))
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = {"goal": goal, "angle_reading": reading}
    write_signals(log, times, columns, {name: rig.plant.wire[name] for name in columns})
    write_whole(path, (shipped / DESCRIPTION).read_text("utf-8").replace("LOG", log.name).encode())
    return log
