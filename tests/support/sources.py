"""Source files of the repository and what they import."""

from __future__ import annotations

import ast
import functools
import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
assert (ROOT / "pyproject.toml").is_file(), "no sources to look at"


@functools.cache
def imported(path: Path) -> frozenset[str]:
    """Full names of everything that a file imports, wherever in it."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        found |= by_string(node)
    return frozenset(found)


WHOLE = re.compile(r"servo_models(\.\w+)*\.?")
CODE = re.compile(r"(?:from|import) (servo_models\.[.\w]+)(?: import .*|;.*)?")


def by_string(node: ast.AST) -> set[str]:
    """The modules of the package that a text names, whole or as Python that imports them.

    One that ends with a dot is the beginning of a name that is computed.
    """
    if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
        return set()
    code = {it[1] for line in node.value.splitlines() if (it := CODE.fullmatch(line.strip()))}
    whole = WHOLE.fullmatch(node.value)
    return code | ({node.value} if whole and "." in node.value else set())
