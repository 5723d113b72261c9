"""The runs of a ``[[logs]]``: one, or those that ``repeat``, a pattern or ``episode`` list."""

from __future__ import annotations

import glob
import itertools
import os
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.data.log import Log
from servo_models.data.readers.lerobot import episodes, is_data_set
from servo_models.data.schema import Section
from servo_models.files import matching

NUMBERS: Any = int | list[int]
EPISODE = "episode = [0, 1]"
REPEAT = 'repeat = [{ file = "a.csv" }, { file = "b.csv", held_out = true }]'


def runs(entry: Section, tables: Container[str] = ()) -> Iterator[Section]:
    """Return what is said of each run of an entry, as if it had an entry of its own.

    A table of ``repeat`` replaces keys of the entry.  Of several files the runs are called like
    the files, behind the name of the entry; of one file, by their number behind it.  A name that
    several runs of ``repeat`` would have gets a number behind it, unless it is given there.
    Of a LeRobot data set each ``episode`` is a run, all of them where none is named.

    Args:
        entry: a ``[[logs]]``.
        tables: names of tables in memory, which are no patterns.

    Raises:
        UserError: ``repeat`` is no list of tables or is empty, no file matches a pattern, or there
            is no such episode.
    """
    sections: list[Section] = []
    for run in _repeated(entry):
        file = run.content.get("file")
        in_memory = file in tables if isinstance(file, str) else True
        files = _files(run, file) if _is_pattern(file) and not in_memory else [run]
        for section in files:
            sections += [section] if in_memory else _episodes(section)
    if "repeat" not in entry:
        return iter(sections)
    return _numbered(sections, [run.content.get("name") for run in entry.sections("repeat")])


def _numbered(sections: Sequence[Section], given: Sequence[Any]) -> Iterator[Section]:
    """The runs, with a free number behind a name that several of them have.

    A name that is ``given`` stays.
    """
    names = [str(run.content["name"]) for run in sections]
    for run, name in zip(sections, names):
        if names.count(name) == 1 or run.content["name"] in given:
            yield run
            continue
        number = next(n for n in itertools.count(1) if f"{name} {n}" not in names)
        names.append(f"{name} {number}")
        yield replace(run, content={**run.content, "name": f"{name} {number}"})


def check_apart(run: Section, log: Log, others: Iterable[tuple[Section, Log]]) -> None:
    """Refuse a run that has samples of another run of its file, since they would count twice.

    Windows may have one row in common, where one ends and the other begins.

    Raises:
        UserError: it has more; the message names both runs.
    """
    for other, before in others:
        alike = all(run.content.get(key) == other.content.get(key) for key in ("table", "outputs"))
        shared = np.intersect1d(log.rows, before.rows)
        if alike and len(shared) > 1:
            run.fail(
                "window" if "window" in run else "file",
                f"'{log.path}' is also in {other.name}: rows {shared[0]} to {shared[-1]} would"
                " count twice; leave out one of the two, or give both windows that do not overlap",
            )


def _repeated(entry: Section) -> Iterator[Section]:
    """The entry, or each table of its ``repeat`` with what the entry says for all of them."""
    if "repeat" not in entry:
        yield entry
        return
    entry.at("repeat").read(list[dict[str, Any]], REPEAT)
    if not entry.content["repeat"]:
        entry.fail("repeat", f"empty; write for example {REPEAT}")
    shared = {key: value for key, value in entry.content.items() if key != "repeat"}
    for k, run in enumerate(entry.sections("repeat"), start=1):
        if "repeat" in run:
            run.fail("repeat", "runs inside of a run; list all of them in one")
        name = run.content.get("name", _name(shared, run.content, k))
        yield replace(run, content={**shared, **run.content, "name": name})


def _name(shared: Mapping[str, Any], content: Mapping[str, Any], number: int) -> Any:
    """The name of a run that says none: from its own file, else by its number."""
    name = shared.get("name") or ""
    if "episode" in content:  # which names it
        return name
    if "file" in content:
        return _behind(name, "" if _is_pattern(content["file"]) else _stem(content["file"]))
    file = shared.get("file", "")
    return _behind(name or ("" if _is_pattern(file) else _stem(file)), str(number))


def _behind(name: Any, ending: str) -> Any:
    """Both parts of a name; what is no text is refused where the log is read."""
    return f"{name} {ending}".strip() if isinstance(name, str) else name


def _stem(file: Any) -> str:
    return Path(file).stem if isinstance(file, str) else ""


def _is_pattern(file: Any) -> bool:
    return isinstance(file, str) and glob.has_magic(file)


def _files(run: Section, pattern: str) -> Iterator[Section]:
    """The run for each file that a pattern finds."""
    folder = run.file.parent
    paths = matching(folder, pattern)
    if not paths:
        run.fail("file", f"no file matches '{pattern}'; write it as seen from the description")
    files = paths if Path(pattern).is_absolute() else [path.relative_to(folder) for path in paths]
    first = run.content.get("name", "")
    for file, stem in zip(files, _names(files)):
        content = {**run.content, "file": str(file), "name": _behind(first, stem)}
        yield replace(run, content=content)


def _names(files: Sequence[Path]) -> list[str]:
    """The names of files without suffix, with their folders where some are alike."""
    short = [file.with_suffix("").as_posix() for file in files]
    for names in ([file.stem for file in files], short):
        if len(set(names)) == len(names):
            return names
    return [file.as_posix() for file in files]


def _episodes(run: Section) -> Iterator[Section]:
    """The run for each episode of a data set that is wanted; a run of another file as it is."""
    path = run.file.parent / str(run.content["file"])
    if "table" in run and is_data_set(path):
        run.fail("table", f"'{path}' is a data set; choose by '{EPISODE}'")
    known = {} if "table" in run else episodes(path)
    shared = {key: value for key, value in run.content.items() if key != "episode"}
    wanted = list(known)
    if "episode" in run and os.path.exists(path):
        given = run.at("episode").read(NUMBERS, EPISODE)
        wanted = given if isinstance(given, list) else [given]
        if not known:
            run.fail("episode", f"'{path}' is no LeRobot data set; leave it out")
    if not known:
        yield replace(run, content=shared)
        return
    name = run.content.get("name") or (path.name if path.is_dir() else path.stem)
    for number in wanted:
        if number not in known:
            there = f"{min(known)} to {max(known)}" if len(known) > 1 else f"{min(known)} alone"
            run.fail("episode", f"'{path}' has no frames of episode {number}; it has {there}")
        label = f"episode {number}"
        file = os.path.relpath(known[number][0], run.file.parent)
        yield replace(
            run, content={**shared, "file": file, "table": label, "name": _behind(name, label)}
        )
