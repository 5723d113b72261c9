"""Planted faults: whether the tests of a folder see a fault in it.

    python -m studies planted_faults --faults 60 --seed 1 --out FOLDER      # resumable
    python -m studies planted_faults --faults 60 --seed 1 --out FOLDER --only data
    python -m studies planted_faults --constants 60 --out FOLDER            # resumable

A fault is one operator or number of a function turned into another, drawn over all folders by their
lines: ``<`` to ``>=``, ``+`` to ``-``, ``*`` to ``/``, ``and`` to ``or``, a number to another one.
In a copy of the repository the tests of the folder with that name are run until one fails.  What no
test sees is either the same program, or a test that is missing: the table has its line to read.
A constant is a number in capitals at module level, tripled and, where no test sees that, divided
by three.  ``studies/planted_constants.json`` keeps the sample, so that a later checkout is judged
by it; without the file, another one is drawn.  What stands there no more counts as gone.
Exit code 0: all are seen, 1: not all.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeGuard

from studies.weight import numbers

ROOT = Path(__file__).parents[1]
OTHER: dict[type[ast.AST], Any] = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
TESTS = {
    "actuators": ("actuators", "effects"),
    "build.py": ("fmu",),
    "cli": ("cli", "analysis", "data", "diagnosis", "identification", "simulators", "validation"),
    "fmu_src": ("fmu",),
    "units.py": ("test_units.py",),
}
"""Tests of a folder or file that are not those of its name."""
LONGEST = 900  # s, of a run of tests
SAMPLE = Path(__file__).with_name("planted_constants.json")


@dataclass(frozen=True)
class Fault:
    """Text that stands in a file from ``begin`` to ``end``, and what is planted for it."""

    path: str
    line: int
    begin: int
    end: int
    was: str
    planted: str

    @property
    def folder(self) -> str:
        return self.path.removeprefix("servo_models/").partition("/")[0]

    @property
    def tests(self) -> list[str]:
        """The tests that should see it."""
        return [f"tests/{name}" for name in TESTS.get(self.folder, (self.folder,))]


def faults(path: Path) -> Iterator[Fault]:
    """Every fault that can be planted in the functions of a file."""
    text = path.read_text("utf-8")
    starts = [0]
    for line in text.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    functions = (it for it in ast.walk(ast.parse(text)) if isinstance(it, ast.FunctionDef))
    seen: set[int] = set()
    for node in (
        inner for function in functions for part in function.body for inner in ast.walk(part)
    ):
        planted = _planted(node)
        if planted is None or not isinstance(node, ast.expr) or id(node) in seen:
            continue
        seen.add(id(node))
        begin, end = (
            starts[line - 1] + column
            for line, column in (
                (node.lineno, node.col_offset),
                (node.end_lineno or 0, node.end_col_offset or 0),
            )
        )
        was = text.encode()[begin:end].decode()
        name = path.relative_to(ROOT).as_posix()
        yield Fault(name, node.lineno, begin, end, was, f"({planted})")


def _planted(node: ast.AST) -> str | None:
    """The text of another expression in the place of one, None where there is none."""
    if isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in OTHER:
        other: ast.expr = ast.Compare(node.left, [OTHER[type(node.ops[0])]()], node.comparators)
    elif isinstance(node, ast.BinOp) and type(node.op) in OTHER:
        other = ast.BinOp(node.left, OTHER[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        other = ast.BoolOp(OTHER[type(node.op)](), node.values)
    elif isinstance(node, ast.Constant) and _is_number(node.value):
        other = ast.Constant(3.0 * node.value if isinstance(node.value, float) else node.value + 2)
    else:
        return None
    return ast.unparse(ast.fix_missing_locations(other))


def _is_number(value: object) -> TypeGuard[int | float]:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and value != 0


def drawn(count: int, seed: int) -> list[Fault]:
    """So many faults, one a file, the likelier the longer the file is."""
    chance = random.Random(seed)
    every = {*ROOT.glob("servo_models/**/*.py"), ROOT / "fmu_src/slave.py"}
    files = sorted(path for path in every if path.name != "pictures.py")  # judged by eye
    lengths = {path: len(path.read_text("utf-8").splitlines()) for path in files}
    found: list[Fault] = []
    while len(found) < count:
        path = chance.choices(list(lengths), list(lengths.values()))[0]
        able = list(faults(path))
        tested = all((ROOT / name).exists() for it in able[:1] for name in it.tests)
        if able and tested:
            found.append(chance.choice(able))
            del lengths[path]
    return found


def constants(path: Path) -> dict[str, Fault]:
    """Every constant of a module, by its name, tripled."""
    text = path.read_text("utf-8").encode()
    starts = [0]
    for line in text.splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = {}
    for name, node in numbers(ast.parse(text)):
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
        was = text[begin:end].decode()
        where = path.relative_to(ROOT).as_posix()
        found[name] = Fault(where, node.lineno, begin, end, was, f"(3 * {was})")
    return found


def sample_of_constants(count: int, seed: int, path: Path) -> list[Fault]:
    """Today's constants of the sample in a file, which is drawn where there is none."""
    today = {
        (name, fault.path): fault
        for file in sorted(ROOT.glob("servo_models/**/*.py"))
        if file.name != "pictures.py" and "withheld" not in file.parts
        for name, fault in constants(file).items()
        if fault.was[0] not in "(0" or "." in fault.was  # neither a tuple nor zero can be tripled
    }
    if not path.exists():
        sample = random.Random(seed).sample(sorted(today), count)
        path.write_text(json.dumps(sample, indent=0) + "\n", encoding="utf-8")
    kept = []
    for name, where in json.loads(path.read_text("utf-8")):
        moved = [fault for (other, _), fault in today.items() if other == name]
        found = today.get((name, where)) or (moved[0] if len(moved) == 1 else None)
        print(f"{where}: {name} {'' if found else 'is gone'}", file=sys.stderr)
        kept += [found] if found else []
    return kept


def seen_by(fault: Fault, copy: Path) -> str:
    """The first test that fails with a fault in a copy of the repository, "" for none."""
    path = copy / fault.path
    sound = path.read_bytes()
    path.write_bytes(sound[: fault.begin] + fault.planted.encode() + sound[fault.end :])
    words = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-n", "1"]
    try:
        done = subprocess.run(
            [*words, *fault.tests],
            check=False,
            cwd=copy,
            env={**os.environ, "PYTHONPATH": str(copy)},  # for processes that tests start elsewhere
            capture_output=True,
            text=True,
            timeout=LONGEST,
        )
        said = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
        return (said or ["it does not run"])[0][:160] if done.returncode else ""
    except subprocess.TimeoutExpired:
        return "it does not end"
    finally:
        path.write_bytes(sound)


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--faults", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="folder of the copy and of results")
    parser.add_argument("--only", default="", help="a folder")
    parser.add_argument("--constants", type=int, default=0, metavar="N", help="of N constants")
    given = parser.parse_args()
    copy, results = given.out / "copy", given.out / "results.jsonl"
    given.out.mkdir(parents=True, exist_ok=True)
    planted = (
        sample_of_constants(given.constants, given.seed, SAMPLE)
        if given.constants
        else drawn(given.faults, given.seed)
    )
    if not copy.exists():
        shutil.copytree(
            ROOT, copy, ignore=shutil.ignore_patterns(".git", "__pycache__", "*.egg-info")
        )
    lines = results.read_text("utf-8").splitlines() if results.exists() else []
    known = {(row["path"], row["line"]): row for row in map(json.loads, lines)}
    for fault in planted:
        if (fault.path, fault.line) in known or given.only not in ("", fault.folder):
            continue
        row = {"path": fault.path, "line": fault.line, "was": fault.was, "planted": fault.planted}
        row["seen"] = seen_by(fault, copy)
        if given.constants and not row["seen"]:
            row["seen"] = seen_by(replace(fault, planted=f"({fault.was} / 3)"), copy)
        known[fault.path, fault.line] = row
        with results.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        print(f"{fault.path}:{fault.line}", row["seen"] or "NOT SEEN", file=sys.stderr, flush=True)
    missed = [row for row in known.values() if not row["seen"]]
    print(f"{len(known) - len(missed)} of {len(known)} are seen")
    for row in missed:
        print(f"{row['path']}:{row['line']}: {row['was']}  ->  {row['planted']}")
    return 1 if missed else 0


if __name__ == "__main__":
    raise SystemExit(main())
