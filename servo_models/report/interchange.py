"""Results for other programs: JSON, GitHub's workflow commands, and what figures depend on."""

from __future__ import annotations

import json
import platform
from importlib.metadata import version

PACKAGES = ("servo-models", "pythonfmu", "fmpy", "numba", "numpy", "scipy", "control")


def finite_json(document: object) -> str:
    """Return a document as JSON; a figure that is not finite becomes null.

    Of ``##`` one sign is escaped, as CI runners obey ``##[error]`` anywhere in a line.
    """
    return json.dumps(_finite(document), indent=2).replace("##", r"#\u0023")


def command(kind: str, title: str, message: str) -> str:
    """Return a workflow command: ``kind`` is ``"error"``, ``"warning"`` or ``"notice"``.

    Source: GitHub Docs, Workflow commands for GitHub Actions.
    """
    escaped = _escaped(title).replace(":", "%3A").replace(",", "%2C")
    return f"::{kind} title={escaped}::{_escaped(message)}"


def _escaped(words: str) -> str:
    return words.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _finite(value: object) -> object:
    """JSON has no infinity."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
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
