"""LeRobot data sets, v2 and v3: a folder with ``meta/info.json``; an episode is a table of a file.

Source: documentation of LeRobot, LeRobotDataset v3.0 (https://huggingface.co/docs/lerobot).
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from servo_models.data.readers.columns import NUMBER, no_stack, unicode_of
from servo_models.errors import UserError
from servo_models.files import check_size, matching, read_regular

INFO = Path("meta", "info.json")
DATA = "data/chunk-*/*.parquet"
INDICES = frozenset({"episode_index", "frame_index", "index", "task_index"})
"""Columns that count episodes, frames, rows and tasks."""
OF_FRAMES = frozenset({"timestamp", "frame_index", "episode_index"})
"""Columns by which a Parquet file is one of a data set."""
LARGEST_INFO = 4 << 20  # bytes of meta/info.json, at most
MOST_EPISODES = 100_000  # episodes that are counted, at most
DEEPEST = 5  # folders between a file of a data set and its root, at most


@dataclass(frozen=True)
class Info:
    """What ``meta/info.json`` says.

    Attributes:
        fps: frames in a second, 0 where it is not said.
        episodes: number of episodes that there should be.
        names: names of the items of each list, by its column.
    """

    fps: float = 0.0
    episodes: int = 0
    names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def is_data_set(path: Path) -> bool:
    """Whether a folder is a data set, or what is left of one without its ``meta/info.json``."""
    return os.path.isfile(path / INFO) or (os.path.isdir(path) and bool(matching(path, DATA)))


def root_of(path: Path) -> Path | None:
    """Return the data set that a file is in, None for a file of none."""
    parents = path.absolute().parents[:DEEPEST]
    return next((folder for folder in parents if os.path.isfile(folder / INFO)), None)


def read_info(root: Path | None) -> Info:
    """Return what the ``meta/info.json`` of a data set says, nothing where there is none."""
    if root is None or not os.path.isfile(root / INFO):
        return Info()
    path = root / INFO
    try:
        content = json.loads(read_regular(path, LARGEST_INFO))
        features = dict(content.get("features") or {})
        names = {unicode_of(key): _names(feature) for key, feature in features.items()}
        fps, count = float(content.get("fps") or 0.0), int(content.get("total_episodes") or 0)
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise UserError(
            f"'{path}' is no description of a data set: copy it again, or name a file in 'data'"
        ) from error
    return Info(fps, min(count, MOST_EPISODES), names)


def _names(feature: Any) -> tuple[str, ...]:
    """Names of the items of a feature: a list of them, a list by a kind, or places by name."""
    given = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(given, dict):
        lists = [value for value in given.values() if isinstance(value, list)]
        given = lists[0] if lists else list(given)
    names = [unicode_of(str(name)) for name in given] if isinstance(given, list) else []
    return tuple(names) if len(set(names)) == len(names) else ()


def episodes(path: Path) -> dict[int, tuple[Path, int]]:
    """Return file and frames of each episode of a data set, or of a Parquet file of one.

    It is empty for what is no such file.
    """
    whole = is_data_set(path)
    if whole:
        files = matching(path, DATA)
        if not files:
            raise UserError(
                f"'{path}' has no frames: there is no file '{DATA}' in it; copy the data set whole"
            )
    else:
        files = [path] if path.suffix.lower() == ".parquet" and os.path.isfile(path) else []
    numbered: dict[int, tuple[Path, int]] = {}
    for file in files:
        for number, frames in _frames(file, whole).items():
            if number in numbered:
                raise UserError(
                    f"'{file}' has episode {number}, and so has '{numbered[number][0]}': remove one"
                )
            numbered[number] = (file, frames)
    return dict(sorted(numbered.items()))


def _frames(file: Path, sure: bool) -> dict[int, int]:
    """Frames of each episode in a file, none in another; ``sure`` that it is one of a data set."""
    import polars as pl

    try:
        with no_stack():
            lazy = pl.scan_parquet(file, glob=False)
            if not OF_FRAMES.issubset(lazy.collect_schema()):
                return {}
            check_size(file, float(lazy.select(pl.len()).collect().item()) * NUMBER)
            counts = lazy.group_by(pl.col("episode_index").cast(pl.Int64)).len().collect()
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
        if sure:
            raise UserError(f"'{file}' is damaged or no Parquet file: write it again") from error
        return {}  # the reader of the file says what is wrong
    return {number: frames for number, frames in counts.iter_rows() if number is not None}
