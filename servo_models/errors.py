"""The one exception a person is meant to read: what is wrong, where, and the cure."""

from __future__ import annotations

import contextlib
import difflib
import importlib
import re
import unicodedata
from collections.abc import Iterable, Iterator
from typing import Any

LONGEST = 1000  # characters of an error: of more the middle is left out
MOST_MEANT = 4  # names that are suggested at once
LEAST_SIMILARITY = 0.6  # of a name that is suggested, 1 for the same; 'voltage' is 0.5 like 'anlge'


class UserError(Exception):
    """Wrong input.  Its text is one line; commands print it and exit with 2.

    It may hold names and cells of anybody's files, so it is cleaned and shortened.
    """

    def __init__(self, text: object = "") -> None:
        super().__init__(printable(str(text), LONGEST))


class CuredError(UserError):
    """Wrong input whose text ends with the cure, so that who catches it has none to add."""


@contextlib.contextmanager
def told_at(where: str, *others: type[Exception]) -> Iterator[None]:
    """Put what is wrong, also as an exception of other kinds, behind where that is."""
    told: tuple[type[Exception], ...] = (UserError, *others)
    try:
        yield
    except told as error:
        raise UserError(f"{where}: {error}") from error


def printable(text: str, longest: int) -> str:
    """Return a text as one line that a terminal only shows.

    Escapes, other control characters and marks of writing direction become question marks; of
    more than ``longest`` characters the middle is left out.
    """
    if len(text) > longest:
        text = f"{text[: longest // 2]} ... {text[-longest // 2 :]}"
    return "".join(
        " " if sign in "\t\n\r" else "?" if unicodedata.category(sign)[0] == "C" else sign
        for sign in text
    )


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the cure for an unknown name: known ones that begin with it or have it as words,
    else the nearest one, else all of them."""
    names = list(known)
    close = [one for one in names if name and one.startswith(name)][:1]
    close = close or [one for one in names if f" {_words(name)} " in f" {_words(one)} "]
    close = close or difflib.get_close_matches(name, names, n=1, cutoff=LEAST_SIMILARITY)
    if close:
        meant = " or ".join(f"'{one}'" for one in close[:MOST_MEANT])
        return f"did you mean {meant}?"
    shown = ", ".join(names[:12]) + (", ..." if len(names) > 12 else "")
    return f"known: {shown or 'none'}"


def _words(name: str) -> str:
    """``drive_dead_zone.half_width`` as words with spaces between them."""
    return " ".join(re.findall(r"[a-z0-9]+", name.lower()))


def extra(name: str, module: str) -> Any:
    """Return the module of a library that only the extra ``name`` brings."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise UserError(
            f"the library '{module.partition('.')[0]}' is not installed: pip install"
            f" 'servo-models[{name}]'"
        ) from error
