"""Results for other programs: JSON, GitHub's workflow commands, and conditions of the figures."""

from __future__ import annotations

import json
import platform
from collections.abc import Mapping
from importlib.metadata import version
from typing import Any

PACKAGES = ("servo-models", "pythonfmu", "fmpy", "numba", "numpy", "scipy", "control")


def plain(document: object) -> Any:
    """Return a document as lists and dictionaries; figures that are not finite stay as they are."""
    return json.loads(json.dumps(document, default=_listed))


def _listed(value: Any) -> object:
    """Parts of documents, other tables, arrays and numbers of NumPy, as JSON lists them."""
    if names := getattr(value, "__struct_fields__", ()):
        return {name: getattr(value, name) for name in names}
    return dict(value) if isinstance(value, Mapping) else value.tolist()


def finite_json(document: object) -> str:
    """Return a document as JSON; a figure that is not finite becomes null.

    One sign of ``##`` is escaped, since CI runners obey ``##[error]`` anywhere in a line.
    """
    return json.dumps(finite(plain(document)), indent=2).replace("##", r"#\u0023")


def command(kind: str, title: str, message: str) -> str:
    """Return a workflow command: ``kind`` is ``"error"``, ``"warning"`` or ``"notice"``.

    Source: GitHub Docs, Workflow commands for GitHub Actions.
    """
    escaped = _escaped(title).replace(":", "%3A").replace(",", "%2C")
    return f"::{kind} title={escaped}::{_escaped(message)}"


def _escaped(words: str) -> str:
    return words.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def finite(value: object) -> object:
    """Return lists, dictionaries or a figure with None in place of what is not finite."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [finite(item) for item in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value


def conditions() -> dict[str, str]:
    """Return the versions and the machine that figures depend on beside their inputs, by name."""
    machine = {
        "Python": platform.python_version(),
        "system": platform.system(),
        "machine": platform.machine(),
    }
    return machine | {name: version(name) for name in PACKAGES}
