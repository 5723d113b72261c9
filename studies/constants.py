"""How many numbers of the code decide what is said.

    python -m studies constants             # of this checkout
    python -m studies constants FOLDER      # of another one

Counted are, in each part of the package:

* settings: fields of the dataclass ``Settings``, which a caller may pass in;
* constants: names in capitals that a module gives a number, or a tuple of numbers;
* that decide: of these constants, and of numbers that stand in the code without a name, those that
  take part in a comparison.  0, 1, -1, 2 and 0.5 without a name count as arithmetic.

Lines are those of the files, comments and empty ones included.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

PARTS = ("diagnosis/search", "diagnosis", "identification", "")
"""Of the package, each without those before it."""
ARITHMETIC = {-1.0, 0.0, 0.5, 1.0, 2.0}


class Count(NamedTuple):
    lines: int = 0
    settings: int = 0
    constants: int = 0
    deciding: int = 0

    def plus(self, other: Count) -> Count:
        return Count(*map(sum, zip(self, other)))


def numeric(node: ast.expr | None) -> bool:
    """Whether an expression is made of numbers alone."""
    if isinstance(node, ast.Constant):
        return type(node.value) in (int, float)
    if isinstance(node, ast.UnaryOp):
        return numeric(node.operand)
    if isinstance(node, ast.BinOp):
        return numeric(node.left) and numeric(node.right)
    return isinstance(node, ast.Tuple) and bool(node.elts) and all(map(numeric, node.elts))


def numbers(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """Names in capitals to which a module gives numbers, and these."""
    for node in tree.body:
        if isinstance(node, ast.Assign):
            pairs = [(target, node.value) for target in node.targets]
        elif isinstance(node, ast.AnnAssign) and node.value:
            pairs = [(node.target, node.value)]
        else:
            continue
        for target, value in pairs:
            each = [(target, value)]
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                each = [*zip(target.elts, value.elts)]
            for name, number in each:
                if isinstance(name, ast.Name) and name.id.isupper() and numeric(number):
                    yield name.id, number


def constants(tree: ast.Module) -> Iterator[str]:
    """Names in capitals to which a module gives numbers."""
    return (name for name, _ in numbers(tree))


def settings(tree: ast.Module) -> int:
    """Fields of the dataclass ``Settings``, 0 where a module has none."""
    found = [it for it in tree.body if isinstance(it, ast.ClassDef) and it.name == "Settings"]
    return sum(isinstance(it, ast.AnnAssign) for one in found for it in one.body)


def count(path: Path, known: set[str]) -> Count:
    """What a file holds; ``known`` are the constants of all files."""
    text = path.read_text("utf-8")
    tree = ast.parse(text)
    named, plain = set[str](), 0
    for node in ast.walk(tree):
        for part in ast.walk(node) if isinstance(node, ast.Compare) else ():
            if isinstance(part, ast.Name) and part.id in known:
                named.add(part.id)
            elif isinstance(part, ast.Constant) and type(part.value) in (int, float):
                plain += part.value not in ARITHMETIC
    return Count(text.count("\n"), settings(tree), len({*constants(tree)}), len(named) + plain)


def counted(package: Path) -> dict[str, Count]:
    """The count of each part."""
    files = sorted(package.rglob("*.py"))
    known = {name for path in files for name in constants(ast.parse(path.read_text("utf-8")))}
    found = dict.fromkeys(PARTS, Count())
    for path in files:
        inside = path.relative_to(package).as_posix()
        part = next(it for it in PARTS if inside.startswith(it))
        found[part] = found[part].plus(count(path, known))
    return found


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent
    print("| part | lines | settings | constants | that decide |\n|---|---|---|---|---|")
    found = counted(folder / "servo_models")
    for part, each in found.items():
        print(f"| {part or 'the rest'} |", " | ".join(map(str, each)), "|")
    total = Count()
    for each in found.values():
        total = total.plus(each)
    print("| all |", " | ".join(map(str, total)), "|")


if __name__ == "__main__":
    main()
