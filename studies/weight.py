"""What the house weighs: lines, numbers, circles, and how far an idea travels.

    python -m studies weight             # of this checkout
    python -m studies weight FOLDER      # of another one

* Lines and modules of ``servo_models`` without ``withheld``, and of ``fmu_src``.
* Numbers: constants (names in capitals that a module gives a number, or a tuple of numbers);
  defaults of keywords that no call in the package sets; bare numbers other than 0, 1 and 2 in
  functions of ``data``, ``identification`` and ``diagnosis``.
* Circles of imports, those inside of functions, for types, and by a text included.
* Trips: a parameter is followed through the calls that it is an argument of, in the order of the
  code, every function once.  Rooms are the modules entered; a return enters one again.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

TRIPS = (
    ("core.flatten", "flatten", "plant"),
    ("data.signals", "read_log", "section"),
    ("diagnosis.search.selection", "select_effects", "fitter"),
    ("diagnosis.diagnose", "diagnose", "description"),
    ("diagnosis.sections", "report", "diagnosis"),
)
"""Module, function and parameter: a model, a log, a search, a diagnosis and its report."""
SEARCHED = (["data"], ["identification"], ["diagnosis"])
FREE = {0, 1, 2}  # bare numbers that are arithmetic
Modules = dict[str, ast.Module]


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


def files(folder: Path) -> list[Path]:
    """The files that are weighed."""
    own = [it for it in folder.glob("servo_models/**/*.py") if "withheld" not in it.parts]
    return sorted([*own, *folder.glob("fmu_src/**/*.py")])


def modules(folder: Path) -> Modules:
    """The modules that are weighed, by the names under which they are imported."""
    return {
        ".".join(path.relative_to(folder).with_suffix("").parts).removesuffix(".__init__"): (
            ast.parse(path.read_text("utf-8"))
        )
        for path in files(folder)
    }


def unset_defaults(house: Modules) -> int:
    """Numbers that are the default of a keyword which no call in the package sets."""
    nodes = [node for tree in house.values() for node in ast.walk(tree)]
    given = {word.arg for node in nodes if isinstance(node, ast.Call) for word in node.keywords}
    found = 0
    for node in nodes:
        if isinstance(node, ast.FunctionDef):
            plain = [*node.args.posonlyargs, *node.args.args][::-1]
            pairs: list[tuple[ast.arg, ast.expr | None]] = [*zip(plain, node.args.defaults[::-1])]
            pairs += zip(node.args.kwonlyargs, node.args.kw_defaults)
            found += sum(numeric(value) and name.arg not in given for name, value in pairs)
    return found


def bare_numbers(house: Modules) -> int:
    """Numbers other than 0, 1 and 2 in functions of the folders that judge logs."""
    trees = [tree for name, tree in house.items() if name.split(".")[1:2] in SEARCHED]
    functions = [it for tree in trees for it in ast.walk(tree) if isinstance(it, ast.FunctionDef)]
    inside = {id(node): node for it in functions for part in it.body for node in ast.walk(part)}
    return sum(
        isinstance(node, ast.Constant)
        and isinstance(node.value, (int, float))
        and node.value not in FREE  # nor True and False, which equal 1 and 0
        for node in inside.values()
    )


def imports(tree: ast.Module, house: Modules) -> dict[str, tuple[str, str]]:
    """Module and name of each name that a module imports from the house."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            for each in node.names:
                whole = f"{node.module}.{each.name}"
                target = (whole, "") if whole in house else (node.module, each.name)
                if target[0] in house:
                    found[each.asname or each.name] = target
        elif isinstance(node, ast.Constant) and node.value in house and node.value.count("."):
            found[f"'{node.value}'"] = (node.value, "")
    return found


def circle(house: Modules) -> list[str]:
    """A circle of imports, empty where there is none; the face itself is on nobody's way."""
    graph = {
        name: {module for module, _ in imports(tree, house).values()} - {name, "servo_models"}
        for name, tree in house.items()
        if name != "servo_models"
    }
    try:
        [*TopologicalSorter(graph).static_order()]
    except CycleError as error:
        return list(error.args[1])
    return []


Definition = ast.FunctionDef | ast.ClassDef


class Trip:
    """The modules that a parameter enters, in order; each call and each way back is a step."""

    def __init__(self, house: Modules, module: str, function: str, parameter: str) -> None:
        self.house, self.way, self.seen = house, [module], {(module, function)}
        self.known = {name: imports(tree, house) for name, tree in house.items()}
        self.methods: dict[str, list[tuple[str, ast.FunctionDef]]] = {}
        for name, tree in house.items():
            for part in (it for it in tree.body if isinstance(it, ast.ClassDef)):
                for it in (it for it in part.body if isinstance(it, ast.FunctionDef)):
                    self.methods.setdefault(it.name, []).append((name, it))
        start = self.defined(module, function)
        if isinstance(start, ast.FunctionDef):
            self.follow(module, start, parameter)

    def defined(self, place: str, name: str) -> Definition | None:
        kinds = (ast.FunctionDef, ast.ClassDef)
        tree = self.house.get(place, ast.Module([], []))
        return next((it for it in tree.body if isinstance(it, kinds) and it.name == name), None)

    def called(self, place: str, call: ast.Call) -> tuple[str, Definition | None]:
        """Where a function that is called stands; a method is found where one class has it."""
        known, function = self.known[place], call.func
        if isinstance(function, ast.Name):
            target = known.get(function.id, (place, function.id))
            return target[0], self.defined(*target)
        if isinstance(function, ast.Attribute) and isinstance(function.value, ast.Name):
            module, inner = known.get(function.value.id, ("", ""))
            if module and not inner:
                return module, self.defined(module, function.attr)
        if isinstance(function, ast.Attribute):
            homes = self.methods.get(function.attr, [])
            return homes[0] if len(homes) == 1 else ("", None)
        return "", None

    def follow(self, place: str, function: ast.FunctionDef, parameter: str) -> None:
        """Follow a parameter through the calls of a function."""
        mine = {parameter}
        for node in sorted(ast.walk(function), key=lambda it: getattr(it, "lineno", 0)):
            if isinstance(node, ast.Call) and self.mentions(node, mine):
                self.call(place, node, mine)

    def mentions(self, node: ast.AST, mine: set[str]) -> bool:
        return any(isinstance(it, ast.Name) and it.id in mine for it in ast.walk(node))

    def call(self, place: str, call: ast.Call, mine: set[str]) -> None:
        there, found = self.called(place, call)
        if found is None or (there, found.name) in self.seen:
            return
        self.seen.add((there, found.name))
        self.way.append(there)
        if isinstance(found, ast.FunctionDef):
            names = [it.arg for it in [*found.args.args, *found.args.kwonlyargs]]
            method = names[:1] == ["self"]
            given = dict(zip(names[method:], call.args))
            given |= {it.arg: it.value for it in call.keywords if it.arg in names}
            passed = [name for name, value in given.items() if self.mentions(value, mine)]
            for name in passed[:1] or names[:method]:
                self.follow(there, found, name)
        self.way.append(place)


def stays(way: list[str]) -> list[str]:
    """A way without the steps that stay where they are."""
    return [here for here, before in zip(way, ["", *way]) if here != before]


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent
    house = modules(folder)
    lines = sum(path.read_text("utf-8").count("\n") for path in files(folder))
    print(f"lines {lines}, modules {len(house)}")
    print(f"constants {sum(len([*constants(tree)]) for tree in house.values())},", end=" ")
    print(f"defaults that no call sets {unset_defaults(house)}, bare numbers {bare_numbers(house)}")
    print(f"circle: {' -> '.join(circle(house)) or 'none'}")
    for place, function, parameter in TRIPS:
        way = stays(Trip(house, f"servo_models.{place}", function, parameter).way)
        print(f"{function}: {len({*way})} rooms, {len(way) - len({*way})} returns")


if __name__ == "__main__":
    main()
