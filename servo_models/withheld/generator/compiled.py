"""Compile with numba, typed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile, and keep what was compiled beside the file.

    What is kept does not notice an edit in another file: one that compiled functions of two
    files share is none of theirs.
    """
    return cast(F, njit(cache=True, error_model="numpy")(function))
