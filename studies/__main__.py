"""python -m studies NAME ...: run a study; without a name, list them."""

from __future__ import annotations

import ast
import runpy
import sys
from pathlib import Path

HERE = Path(__file__).parent
GENERATOR = "withheld.generator"
"""The one that is in the package, since ``servo-models blind`` needs it."""


def named() -> dict[str, str]:
    """The first line of each study's document, by its name."""
    files = {path.stem: path for path in HERE.glob("[!_]*.py")}
    files |= {
        ".".join(path.parent.relative_to(HERE).parts): path
        for path in HERE.glob("*/**/__main__.py")
    }
    files[GENERATOR] = HERE.parent / "servo_models" / GENERATOR.replace(".", "/") / "__main__.py"
    return {
        name: (ast.get_docstring(ast.parse(files[name].read_text("utf-8"))) or "").splitlines()[0]
        for name in sorted(files)
    }


def main() -> int:
    """Run the command line."""
    every = named()
    if len(sys.argv) < 2 or sys.argv[1] not in every:
        print("\n".join(f"{name:20} {what}" for name, what in every.items()))
        return 0 if len(sys.argv) < 2 else 2
    name = sys.argv.pop(1)
    sys.argv[0] = f"python -m studies {name}"
    package = "servo_models" if name == GENERATOR else "studies"
    runpy.run_module(f"{package}.{name}", run_name="__main__", alter_sys=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
