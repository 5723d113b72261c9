"""The runs of a ``[[logs]]``: one, or those that ``repeat`` and a pattern in ``file`` list."""

from __future__ import annotations

import glob
import itertools
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from servo_models.data.log import Log
from servo_models.data.schema import Section
from servo_models.files import matching

REPEAT = 'repeat = [{ file = "a.csv" }, { file = "b.csv", held_out = true }]'


def runs(entry: Section, tables: Container[str] = ()) -> Iterator[Section]:
    """Return what is said of each run of an entry, as if it had an entry of its own.

    A table of ``repeat`` replaces keys of the entry.  Of several files the runs are called like
    the files, behind the name of the entry; of one file, by their number behind it.  A name that
    several runs of ``repeat`` would have gets a number behind it, unless it is given there.

    Args:
        entry: a ``[[logs]]``.
        tables: in memory; who is called like one is no pattern.

    Raises:
        UserError: ``repeat`` is no list of tables or is empty, or no file matches a pattern.
    """
    found: list[Section] = []
    for run in _repeated(entry):
        file = run.content.get("file")
        pattern = _is_pattern(file) and file not in tables
        found += _files(run, file) if pattern else [run]
    if "repeat" not in entry:
        return iter(found)
    return _numbered(found, [run.content.get("name") for run in entry.sections("repeat")])


def _numbered(found: Sequence[Section], given: Sequence[Any]) -> Iterator[Section]:
    """The runs, with a number behind a name that several of them have, and that is not taken.

    A name that is ``given`` stays.
    """
    names = [str(run.content["name"]) for run in found]
    for run, name in zip(found, names):
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


def _name(shared: Mapping[str, Any], own: Mapping[str, Any], number: int) -> Any:
    """The name of a run that says none: from its own file, else by its number."""
    name = shared.get("name") or ""
    if "file" in own:
        return _behind(name, "" if _is_pattern(own["file"]) else _stem(own["file"]))
    file = shared.get("file", "")
    return _behind(name or ("" if _is_pattern(file) else _stem(file)), str(number))


def _behind(name: Any, own: str) -> Any:
    """Both parts of a name; what is no text is refused where the log is read."""
    return f"{name} {own}".strip() if isinstance(name, str) else name


def _stem(file: Any) -> str:
    return Path(file).stem if isinstance(file, str) else ""


def _is_pattern(file: Any) -> bool:
    return isinstance(file, str) and glob.has_magic(file)


def _files(run: Section, pattern: str) -> Iterator[Section]:
    """The same for each file that a pattern finds."""
    folder = run.file.parent
    found = matching(folder, pattern)
    if not found:
        run.fail("file", f"no file matches '{pattern}'; write it as seen from the description")
    files = found if Path(pattern).is_absolute() else [path.relative_to(folder) for path in found]
    first = run.content.get("name", "")
    for file, own in zip(files, _names(files)):
        content = {**run.content, "file": str(file), "name": _behind(first, own)}
        yield replace(run, content=content)


def _names(files: Sequence[Path]) -> list[str]:
    """The names of files without suffix, with their folders where some are alike."""
    short = [file.with_suffix("").as_posix() for file in files]
    for names in ([file.stem for file in files], short):
        if len(set(names)) == len(names):
            return names
    return [file.as_posix() for file in files]
