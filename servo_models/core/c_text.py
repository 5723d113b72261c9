"""Print a flattened plant as C99: the texts of ``stepper.py``, statement by statement.

The step of an FMU stands there twice: guarded, for any effects, and without those that are off in
the FMU as built, for the runs that leave it so.  A run of this process, ``c_run_text``, computes as
numba does, so nothing in it fails and whole numbers have 64 bits; the rest is the same.  The text
is Python in the small subset of ``inline.py``, so each statement has one C form:

=====================================  ===================================================
``a / b``, ``_math.sqrt(a)``, ``% b``  a function of ``arithmetic.h``, which fails where Python
                                       raises and rounds as Python does
a name ``angle``                       ``v_angle``: an author may call a wire ``double``
``make(p)``                            ``prepare``: fills a ``Setup`` with what ``start`` and
                                       ``step`` read
``return code, outputs``               ``return`` of the code, ``ARITHMETIC`` where it failed
=====================================  ===================================================

A variable is a ``Whole`` where all its values are whole (flags, counters), else a ``double``.  A
loop ends where arithmetic has failed, since Python would have left it.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from itertools import accumulate

from servo_models.core.flat import Flat, kept
from servo_models.core.printer import indent
from servo_models.core.stepper import step_text

OPERATORS: dict[type, str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.USub: "-",
    ast.UAdd: "+",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.And: "&&",
    ast.Or: "||",
}
_CHECKED = (
    *("acos", "asin", "ceil", "cos", "cosh", "exp", "expm1", "floor", "log", "log10", "log1p"),
    *("sin", "sinh", "sqrt", "tan", "trunc"),
)
"""Functions that raise in Python for some finite or infinite argument."""
_PLAIN = ("atan", "atan2", "copysign", "fabs", "tanh")
_CONSTANTS = {"pi": "3.141592653589793", "e": "2.718281828459045", "inf": ""}
_LARGEST_INT = 2**31 - 1  # largest whole number of C


def c_text(flat: Flat, off: Collection[str] = ()) -> str:
    """Return ``Setup``, ``prepare``, ``at_rest`` and ``step`` in C; they need ``arithmetic.h``.

    They stand for ``make``, ``start`` and ``step`` of ``step_text`` and give the same bits where
    the compiler does not contract a product and a sum (``-ffp-contract=off``).

    Args:
        off: the effects that are off in the FMU as built.  While these are off and no others, a
            text without them runs, which takes 10 to 40 % less time than asking for each.

    Raises:
        ValueError: a block uses a function of ``math`` that has no form here.
    """
    make, comments = parsed(step_text(flat, guarded=True))
    start, step = _functions(make)
    built, comments_built = parsed(step_text(flat, off))
    setup = make.body[: make.body.index(start)]
    wanted = (read_in(start) | read_in(step)) - stored(step.body).keys()
    fields = [name for name in stored(setup) if name in wanted]
    kinds = Kinds(setup)
    write = _Function(kinds, {name: f"s->v_{name}" for name in fields}, comments)
    on = {owner: write.of(ast.Name(kept("on", owner))) for owner in flat.switches}
    as_built = " && ".join(f"!{flag}" if owner in off else flag for owner, flag in on.items())
    lines = [
        "typedef struct {",
        *indent(f"{kinds.of(name)} v_{name};" for name in fields),
        "    int as_built; /* the effects that are on */",
        "} Setup;",
        "",
        "static int prepare(Setup *s, const double *v__p)",
        "{",
        "    int failed = 0;",
        *indent(write.declared(setup, fields)),
        *indent(write.block(setup)),
        f"    s->as_built = {as_built or '1'};",
        "    return failed ? ARITHMETIC : 0;",
        "}",
        "",
        "static void at_rest(const Setup *s, double *v__x)",
        "{",
        *indent(_at_rest(start, write)),
        "}",
        "",
        *_step("any_step", step, fields, kinds, comments),
        "",
        *_step("step_as_built", _functions(built)[1], fields, kinds, comments_built),
        "",
        *_head("step"),
        "{",
        "    return (s->as_built ? step_as_built : any_step)(s, v__x, v__u, v__t, v__size, v__y);",
        "}",
    ]
    return "\n".join([*lines, ""])


_RUN = """
#include <math.h>

typedef long long Whole;

static inline double divided(double a, double b, const int *failed)
{
    (void)failed;
    return a / b;
}

/* As numba's, which is 0 for a divisor of 0; a % -1 is 0, but overflows for the least number. */
static inline Whole whole_remainder(Whole a, Whole b)
{
    const Whole rest = b > 0 || b < -1 ? a % b : 0;
    return rest != 0 && (rest < 0) != (b < 0) ? rest + b : rest;
}

static inline double remainder_of(double a, double b, const int *failed)
{
    const double rest = fmod(a, b);
    (void)failed;
    return rest != 0.0 && (rest < 0.0) != (b < 0.0) ? rest + b : rest;
}

#define SAME(name) \\
    static inline double checked_##name(double x, const int *failed) \\
    { \\
        (void)failed; \\
        return name(x); \\
    }
#define TO_WHOLE(name) \\
    static inline Whole checked_##name(double x, const int *failed) \\
    { \\
        (void)failed; \\
        return (Whole)name(x); \\
    }
"""
"""The functions of ``arithmetic.h`` under the same names, without what fails."""
_WHOLE = ("ceil", "floor", "trunc")
WHOLE_CALLS = ("_int", "_len", *(f"_math.{name}" for name in _WHOLE))


def c_run_text(text: str) -> str:
    """Return ``run`` of a text printed by ``stepper.run_text`` in C, which computes as numba does.

    Raises:
        ValueError: a block uses a function of ``math`` that has no form here.
    """
    run, _ = parsed(text)
    lines = [
        _RUN,
        *(f"TO_WHOLE({name})" if name in _WHOLE else f"SAME({name})" for name in _CHECKED),
        "",
        '__attribute__((visibility("default"))) int run(',
        "    const double *restrict v__p, double *restrict v__x, Whole v__rows,",
        "    const double *restrict v__times,",
        f"    const double (*restrict v__inputs)[{columns(run, '_inputs')}],",
        f"    double (*restrict v__out)[{columns(run, '_out')}], double v__most,",
        "    Whole *restrict v__at)",
        *_whole(AsNumba(Kinds(run.body, calls=WHOLE_CALLS), {}, {}), run.body),
    ]
    return "\n".join([*lines, ""])


def columns(run: ast.FunctionDef, table: str) -> int:
    """How many columns a table has; C has none without any."""
    cells = re.findall(rf"\b{table}\[\w+, (\d+)\]", ast.unparse(run))
    return 1 + max(map(int, cells), default=0)


def parsed(text: str) -> tuple[ast.FunctionDef, dict[int, str]]:
    """``make`` of a text, and its comments by line."""
    comments = {n: line.strip() for n, line in enumerate(text.split("\n"), 1) if "#" in line}
    make = next(node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef))
    return make, comments


def _functions(make: ast.FunctionDef) -> tuple[ast.FunctionDef, ast.FunctionDef]:
    """``start`` and ``step``."""
    start, step = (node for node in make.body if isinstance(node, ast.FunctionDef))
    return start, step


def _at_rest(function: ast.FunctionDef, write: _Function) -> Iterator[str]:
    values = next(node for node in ast.walk(function) if isinstance(node, ast.List)).elts
    for i, value in enumerate(values):
        yield f"v__x[{i}] = {write.plain(value)};"
    yield f"memset(v__x + {len(values)}, 0, (SIZE - {len(values)}) * sizeof *v__x);"
    yield "(void)s;"  # which a model with constants alone does not look at


def _head(called: str) -> list[str]:
    return [
        f"static int {called}(",
        "    const Setup *restrict s, double *restrict v__x, const double *restrict v__u,",
        "    double v__t, double v__size, double *restrict v__y)",
    ]


def _step(
    called: str,
    function: ast.FunctionDef,
    fields: Sequence[str],
    setup: Kinds,
    comments: dict[int, str],
) -> Iterator[str]:
    body = function.body
    yield from _head(called)
    write = _Function(Kinds(body, setup), {name: f"s->v_{name}" for name in fields}, comments)
    yield from _whole(write, body)


def _whole(write: _Function, body: Sequence[ast.stmt]) -> Iterator[str]:
    """A function's body with its variables."""
    yield "{"
    yield "    int failed = 0;"
    match body[0]:
        case ast.Assign(
            [ast.Name("_ahead")],
            ast.BinOp(_, _, ast.Constant(int(places))) | ast.Call(_, [ast.Constant(int(places))]),
        ):
            body = body[1:]
            if places:  # C has no empty array
                yield f"    double v__ahead[{places}] = {{0.0}};"
    yield from indent(write.declared(body, ()))
    yield from indent(write.block(body))
    yield "}"


class Kinds:
    """Which variables are ``Whole``: those whose every value is, as that of ``calls`` is."""

    def __init__(
        self, body: Sequence[ast.stmt], outer: Kinds | None = None, calls: Collection[str] = ()
    ) -> None:
        values: dict[str, list[ast.expr]] = {}
        self.outer, self.calls = outer, calls
        self.operators = (ast.Add, ast.Sub, ast.Mult, *([ast.Mod] if calls else []))
        for node in (node for statement in body for node in ast.walk(statement)):
            if isinstance(node, ast.Assign):
                for target, value in _pairs(node):
                    values.setdefault(ast.unparse(target), []).append(value)
            elif isinstance(node, ast.AugAssign):
                result = ast.BinOp(_loaded(node.target), node.op, node.value)
                values.setdefault(ast.unparse(node.target), []).append(result)
            elif isinstance(node, ast.For):
                values.setdefault(ast.unparse(node.target), []).append(ast.Constant(0))
        self.whole = {name for name in values if name.isidentifier()}
        before = -1
        while before != len(self.whole):  # a variable is a double if one of its values is
            before = len(self.whole)
            self.whole -= {n for n, v in values.items() if not all(map(self.is_whole, v))}

    def of(self, name: str) -> str:
        return "Whole" if name in self.whole else "double"

    def is_whole(self, value: ast.expr) -> bool:
        if isinstance(value, ast.Constant):
            return isinstance(value.value, int) and abs(value.value) <= _LARGEST_INT
        if isinstance(value, ast.Name):
            inner = value.id in self.whole
            return inner or (self.outer is not None and self.outer.is_whole(value))
        if isinstance(value, ast.IfExp):
            return self.is_whole(value.body) and self.is_whole(value.orelse)
        if isinstance(value, ast.Call):
            return ast.unparse(value.func) in self.calls
        if isinstance(value, ast.BinOp) and isinstance(value.op, self.operators):
            return self.is_whole(value.left) and self.is_whole(value.right)
        if isinstance(value, ast.UnaryOp):
            return isinstance(value.op, ast.Not) or self.is_whole(value.operand)
        return isinstance(value, (ast.Compare, ast.BoolOp))


class _Function:
    """Writes the statements of one function; ``names`` are the C names of those that are kept."""

    constant = "const double"
    infinity = "HUGE_VAL"

    def __init__(self, kinds: Kinds, names: dict[str, str], comments: dict[int, str]) -> None:
        self.kinds, self.names, self.comments = kinds, names, comments

    def declared(self, body: Sequence[ast.stmt], fields: Iterable[str]) -> Iterator[str]:
        """Local variables; a compiler cannot see that none is read before it is set."""
        read = set().union(*map(read_in, body))
        for name in stored(body):
            if name not in fields:
                yield f"{self.kinds.of(name)} v_{name} = 0;"
                if name not in read:
                    yield f"(void)v_{name};"

    def block(self, body: Sequence[ast.stmt]) -> list[str]:
        lines: list[str] = []
        for statement in body:
            comment = self.comments.get(statement.lineno - 1)
            lines += [f"/* {comment.lstrip('# ')} */"] if comment else []
            lines += self.statement(statement)
        return lines

    def statement(self, node: ast.stmt) -> list[str]:
        match node:
            case ast.Assign():
                return self.assign(node)
            case ast.AugAssign(target, op, value):
                left = self.plain(target)
                return [f"{left} = {self.plain(ast.BinOp(_loaded(target), op, value))};"]
            case ast.If():
                return self.branch(node)
            case ast.While(test, body, after):
                head = f"while (!failed && {self.of(test)}) {{"
                return [head, *indent(self.block(body)), "}", *self.block(after)]
            case ast.For(target, ast.Call(args=[low, high]), body):
                k = self.plain(target)
                head = f"for ({k} = {self.plain(low)}; {k} < {self.plain(high)}; {k}++) {{"
                return [head, *indent(self.block(body)), "}"]
            case ast.Return(ast.Tuple([code, second])):
                return self.returned(self.plain(code), second)
            case ast.Break():
                return ["break;"]
            case ast.Continue():
                return ["continue;"]
            case ast.Pass():
                return []
        raise ValueError(f"'{ast.unparse(node)}' has no form in C")

    def returned(self, code: str, second: ast.expr) -> list[str]:
        values = second.elts if isinstance(second, ast.List) else []
        lines = [f"v__y[{i}] = {self.plain(it)};" for i, it in enumerate(values)]
        return [*lines, f"return failed ? ARITHMETIC : {code};"]

    def branch(self, node: ast.If) -> list[str]:
        body, other = self.block(node.body), self.block(node.orelse)
        if not body and other:
            return [f"if (!({self.plain(node.test)})) {{", *indent(other), "}"]
        lines = [f"if ({self.plain(node.test)}) {{", *indent(body)]
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If) and other[0][:2] == "if":
            return [*lines, f"}} else {other[0]}", *other[1:]]
        return [*lines, *(["} else {", *indent(other)] if other else []), "}"]

    def assign(self, node: ast.Assign) -> list[str]:
        """One by one, or all values first where one reads what another has just changed."""
        pairs = [(self.plain(t), self.plain(v), v) for t, v in _pairs(node)]
        pairs = [(target, value, tree) for target, value, tree in pairs if target != value]
        # another index may be the same place
        changed = [target.partition("[")[0] for target, *_ in pairs]
        if all(set(self.parts(tree)).isdisjoint(changed[:k]) for k, (*_, tree) in enumerate(pairs)):
            return [f"{target} = {value};" for target, value, _ in pairs]
        first = [f"{self.constant} v{i} = {value};" for i, (_, value, _) in enumerate(pairs)]
        return ["{", *indent(first), *indent(f"{p[0]} = v{i};" for i, p in enumerate(pairs)), "}"]

    def parts(self, tree: ast.AST) -> Iterator[str]:
        for node in ast.walk(tree):
            if isinstance(node, (ast.Name, ast.Subscript)) and ast.unparse(node) != "_math":
                yield self.plain(node)

    def plain(self, node: ast.expr) -> str:
        """An expression without parentheses around it."""
        text = self.of(node)
        depths = accumulate((letter == "(") - (letter == ")") for letter in text[:-1])
        return text[1:-1] if text[0] == "(" and text[-1] == ")" and all(depths) else text

    def of(self, node: ast.expr) -> str:
        """An expression that can stand inside another."""
        used = node.ops if isinstance(node, ast.Compare) else [getattr(node, "op", ast.Add())]
        if not {type(op) for op in used} <= {*OPERATORS, ast.Div, ast.Mod, ast.Not}:
            raise ValueError(f"'{ast.unparse(node)}' has no form in C")
        match node:
            case ast.Constant(bool() | int() | float() as value):
                whole = isinstance(value, int) and abs(value) <= _LARGEST_INT
                return (
                    str(int(value)) if whole else repr(float(value)).replace("inf", self.infinity)
                )
            case ast.Name(name):
                return self.names.get(name, f"v_{name}")
            case ast.Subscript(table, ast.Tuple([row, column])):
                return f"{self.of(table)}[{self.plain(row)}][{self.plain(column)}]"
            case ast.Subscript(array, index):
                return f"{self.of(array)}[{self.index(index)}]"
            case ast.BinOp(left, op, right):
                return self.operation(op, left, right)
            case ast.UnaryOp(ast.Not(), operand):
                return f"(!{self.of(operand)})"
            case ast.UnaryOp(op, operand):
                return f"({OPERATORS[type(op)]}{self.of(operand)})"
            case ast.BoolOp(op, values):
                return f"({f' {OPERATORS[type(op)]} '.join(map(self.truth, values))})"
            case ast.Compare(left, ops, others):
                ends = zip([left, *others], ops, others)
                tests = [f"({self.of(a)} {OPERATORS[type(op)]} {self.of(b)})" for a, op, b in ends]
                return tests[0] if len(tests) == 1 else f"({' && '.join(tests)})"
            case ast.IfExp(test, body, other):
                return f"({self.of(test)} ? {self.of(body)} : {self.of(other)})"
            case ast.Call(function, arguments):
                return self.call(ast.unparse(function), arguments)
            case ast.Attribute(ast.Name("_math"), name) if name in _CONSTANTS:
                return _CONSTANTS[name] or self.infinity
        raise ValueError(f"'{ast.unparse(node)}' has no form in C")

    def truth(self, node: ast.expr) -> str:
        """An operand of ``and`` or ``or``, which give the operand itself in Python."""
        if not self.kinds.is_whole(node):
            raise ValueError(f"'{ast.unparse(node)}' beside 'and' or 'or': write a comparison")
        return self.of(node)

    def index(self, node: ast.expr) -> str:
        return self.plain(node) if self.kinds.is_whole(node) else f"(int){self.of(node)}"

    def operation(self, op: ast.operator, left: ast.expr, right: ast.expr) -> str:
        a, b = self.plain(left), self.plain(right)
        if isinstance(op, ast.Div):
            match right:
                case ast.Constant(float() as number) if number != 0.0:
                    return f"({self.of(left)} / {number!r})"
            return f"divided({a}, {b}, &failed)"
        if isinstance(op, ast.Mod):
            return f"remainder_of({a}, {b}, &failed)"
        wide = self.kinds.is_whole(left) and self.kinds.is_whole(right)
        named = isinstance(left, (ast.Name, ast.BinOp))  # a constant or a comparison is an int
        cast = "(Whole)" if wide and not named else ""
        return f"({cast}{self.of(left)} {OPERATORS[type(op)]} {self.of(right)})"

    def call(self, function: str, arguments: Sequence[ast.expr]) -> str:
        given = [self.plain(argument) for argument in arguments]
        name = function.removeprefix("_math.")
        if function == "_len":
            return "v__rows"
        if function == "_abs":
            return f"fabs({given[0]})"
        if function == "_float":
            return f"((double){self.of(arguments[0])})"
        if function == "_int":
            return f"checked_trunc({given[0]}, &failed)"
        if name in _CHECKED:
            if len(given) != 1:
                raise ValueError(f"math.{name} has one argument in C, not {len(given)}")
            return f"checked_{name}({given[0]}, &failed)"
        if name in _PLAIN:
            return f"{name}({', '.join(given)})"
        known = ", ".join(sorted({*_CHECKED, *_PLAIN}))
        raise ValueError(f"math.{name} has no form in C: use one of {known}")


class AsNumba(_Function):
    """Writes what numba computes: whole numbers are of 64 bits, and nothing fails."""

    def truth(self, node: ast.expr) -> str:
        """Numba gives the operand too; the text's own flags are 0 or 1."""
        match node:
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(ast.Not()):
                return self.of(node)
            case ast.Name(name) if name.startswith("_"):
                return self.of(node)
        raise ValueError(f"'{ast.unparse(node)}' beside 'and' or 'or': write a comparison")

    def returned(self, code: str, second: ast.expr) -> list[str]:
        return [f"*v__at = {self.plain(second)};", f"return {code};"]

    def branch(self, node: ast.If) -> list[str]:
        """Most effects are off in most runs: what they do stands aside, which saves a tenth."""
        first, *rest = super().branch(node)
        if isinstance(node.test, ast.Name) and node.test.id.startswith("_"):
            first = f"if (__builtin_expect({self.of(node.test)}, 0)) {{"
        return [first, *rest]

    def operation(self, op: ast.operator, left: ast.expr, right: ast.expr) -> str:
        if isinstance(op, ast.Mod) and self.kinds.is_whole(left) and self.kinds.is_whole(right):
            return f"whole_remainder({self.plain(left)}, {self.plain(right)})"
        return super().operation(op, left, right)


def _pairs(node: ast.Assign) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Targets and values of an assignment, one by one; ``a = b = c`` sets the last target first."""
    for target in reversed(node.targets):
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            yield from zip(target.elts, node.value.elts)
        else:
            yield target, node.value


def _loaded(target: ast.expr) -> ast.expr:
    return ast.parse(ast.unparse(target), mode="eval").body


def read_in(tree: ast.AST) -> set[str]:
    names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
    changed = [node.target for node in ast.walk(tree) if isinstance(node, ast.AugAssign)]
    return {name.id for name in names if isinstance(name.ctx, ast.Load) or name in changed}


def stored(body: Sequence[ast.stmt]) -> dict[str, None]:
    """Variables that are set, in the order of the text."""
    nodes = (node for statement in body for node in ast.walk(statement))
    names = (n for n in nodes if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store))
    return dict.fromkeys(name.id for name in names)
