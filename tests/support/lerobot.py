"""LeRobot data sets as the documentation of v2.1 and v3.0 lays them out, without videos."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from servo_models.core.types import Array

FPS = 30
JOINTS = ("shoulder.pos", "elbow.pos")
LATE = 4  # frames by which readings follow their commands
SIZES = (70.0, 95.0)


def motion(frames: int, seed: int) -> tuple[Array, Array]:
    """Commands of the joints and readings ``LATE`` frames behind, each of shape (frames, 2)."""
    time = np.arange(-LATE, frames) / FPS
    waves = [np.sin((2.0 + k + 0.3 * seed) * time + k + seed) for k in range(len(JOINTS))]
    command = np.round(np.transpose(waves) * SIZES, 2)
    return command[LATE:].copy(), command[: len(command) - LATE].copy()


def episodes(*frames: int) -> list[tuple[Array, Array]]:
    return [motion(count, seed) for seed, count in enumerate(frames)]


def data_set(
    folder: Path,
    recorded: Sequence[tuple[Array, Array]],
    version: str = "v3.0",
    names: Mapping[str, Any] | None = None,
) -> Path:
    """Write episodes of actions and states, and return the folder.

    v2.1 has a file for each episode, v3.0 one for all.
    """
    frames = [_frames(number, *both) for number, both in enumerate(recorded)]
    chunk = folder / "data" / "chunk-000"
    chunk.mkdir(parents=True)
    (folder / "meta").mkdir()
    if version == "v2.1":
        for number, frame in enumerate(frames):
            frame.write_parquet(chunk / f"episode_{number:06d}.parquet")
    else:
        pl.concat(frames).write_parquet(chunk / "file-000.parquet")
        listed = {"episode_index": range(len(frames)), "length": [len(frame) for frame in frames]}
        meta = folder / "meta" / "episodes" / "chunk-000"
        meta.mkdir(parents=True)
        pl.DataFrame(listed).write_parquet(meta / "file-000.parquet")
    names = names or {"action": list(JOINTS), "observation.state": list(JOINTS)}
    info = {
        "codebase_version": version,
        "total_episodes": len(frames),
        "fps": FPS,
        "features": {name: {"dtype": "float32", "names": own} for name, own in names.items()},
    }
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    return folder


def _frames(number: int, action: Array, state: Array) -> pl.DataFrame:
    count = np.arange(len(action))
    lists = {
        name: pl.Series(values.tolist(), dtype=pl.Array(pl.Float32, values.shape[1]))
        for name, values in (("action", action), ("observation.state", state))
    }
    return pl.DataFrame(
        {
            **lists,
            "timestamp": (count / FPS).astype(np.float32),
            "frame_index": count,
            "episode_index": np.full(len(count), number),
            "index": 1000 * number + count,
            "task_index": np.zeros(len(count), dtype=int),
        }
    )
