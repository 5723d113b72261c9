"""Read TOML files that a person wrote: every fault in one sentence with its line or key."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from servo_models.errors import UserError, did_you_mean
from servo_models.files import read_regular

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


DEEPEST = 20
"""Tables and lists inside each other; the longest dotted names have a few parts."""
LONGEST_PLACE = 100
"""Characters that are told of a dotted name."""
LARGEST = 4 << 20
"""Bytes of a file that a person wrote."""


@dataclass(frozen=True)
class Section:
    """A table of a TOML file; what is asked of it is checked, and faults name file and key.

    Attributes:
        file: the file, for messages.
        name: dotted name of the table, "" for the whole file.
        content: the table.
    """

    file: Path
    name: str
    content: Mapping[str, Any]

    def __contains__(self, key: str) -> bool:
        return key in self.content

    def __iter__(self) -> Iterator[str]:
        return iter(self.content)

    def fail(self, key: str, complaint: object) -> NoReturn:
        """Raise UserError: ``complaint`` about ``key``."""
        raise UserError(f"'{self.file}', {self._dotted(key)}: {complaint}")

    def check_keys(self, known: tuple[str, ...]) -> None:
        """Raise UserError if there is a key that nobody reads."""
        for key in self.content:
            if key not in known:
                self.fail(key, f"unknown key '{key}'; {did_you_mean(key, known)}")

    def text(self, key: str, default: str = "") -> str:
        """Return a text; ``default`` where the key is not there."""
        found = self.content.get(key, default)
        if not isinstance(found, str):
            self.fail(key, 'no text; write it in quotes, "..."')
        return found

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts, empty where the key is not there."""
        found = self.content.get(key, [])
        if not (isinstance(found, list) and all(isinstance(text, str) for text in found)):
            self.fail(key, 'no list of texts; write ["...", "..."]')
        return tuple(found)

    def number(self, key: str, infinite: bool = False) -> float:
        """Return a finite number, or with ``infinite`` also an infinite one."""
        if key not in self:
            self.fail(key, "missing; give a number")
        found = self.content[key]
        if not isinstance(found, (int, float)) or isinstance(found, bool):
            self.fail(key, f"'{found}' is no number; give one without quotes")
        if not (abs(found) <= sys.float_info.max or (infinite and abs(found) == float("inf"))):
            self.fail(key, f"{found} is not finite; give a number")
        return float(found)

    def section(self, key: str) -> Section:
        """Return an inner table, empty where the key is not there."""
        found = self.content.get(key, {})
        if not isinstance(found, Mapping):
            self.fail(key, f"no table; write {key} = {{ ... }}")
        return Section(self.file, self._dotted(key), found)

    def sections(self, key: str) -> list[Section]:
        """Return a list of inner tables, empty where the key is not there."""
        found = self.content.get(key, [])
        if not (isinstance(found, list) and all(isinstance(entry, Mapping) for entry in found)):
            self.fail(key, f"no list of tables; write [[{key}]]")
        name = self._dotted(key)
        return [Section(self.file, f"{name}[{k}]", entry) for k, entry in enumerate(found, 1)]

    def _dotted(self, key: str) -> str:
        return f"{self.name}.{key}" if self.name else key


def named_files(path: Path) -> list[Path]:
    """Return a TOML file and the files that any text in it names; none where it cannot be read.

    Names are relative to its folder.
    """
    try:
        content = tomllib.loads(read_regular(path, LARGEST).decode("utf-8-sig"))
    except (UserError, ValueError, RecursionError):
        return []
    named = [path.parent / text for text in _texts(content)]
    return [path, *(file for file in named if _is_file(file))]


def _texts(content: Any) -> Iterator[str]:
    """All texts of a table, at any depth."""
    if isinstance(content, str):
        yield content
    elif isinstance(content, Mapping | list):
        for part in content.values() if isinstance(content, Mapping) else content:
            yield from _texts(part)


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a text that is no name at all
        return False


def read_toml(path: Path) -> Section:
    """Read a TOML file.

    Raises:
        UserError: the file cannot be read, is no text, or is no TOML, with the line; an integer
            beyond 64 bits or too many tables inside each other, with the key.
    """
    try:
        content = tomllib.loads(read_regular(path, LARGEST).decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        raise UserError(f"'{path}' is no text in UTF-8: save it as such") from error
    except (ValueError, RecursionError) as error:  # also of an integer of thousands of digits
        raise UserError(f"'{path}' is no TOML: {error}; correct it there") from error
    document = Section(path, "", content)
    _check_values(document, content)
    return document


def _check_values(document: Section, content: Any, names: tuple[str, ...] = ()) -> None:
    """Refuse integers that TOML does not hold, and tables deeper than anybody reads."""
    place = ".".join(names)[:LONGEST_PLACE]
    if len(names) > DEEPEST:
        document.fail(place, f"more than {DEEPEST} tables inside each other; leave tables out")
    if isinstance(content, int) and not -(2**63) <= content < 2**63:
        document.fail(place, "an integer beyond 64 bits; write it with a point, such as 1.0e30")
    if isinstance(content, Mapping | list):
        inner = content.items() if isinstance(content, Mapping) else enumerate(content, start=1)
        for key, value in inner:
            _check_values(document, value, (*names, str(key)))


def nested(flat: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by dotted name as the tables that TOML makes of such names."""
    tree: dict[str, Any] = {}
    for name, value in flat.items():
        *parents, last = name.split(".")
        branch = tree
        for parent in parents:
            branch = branch.setdefault(parent, {})
        branch[last] = value
    return tree
