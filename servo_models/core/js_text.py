"""Print a run of a plant as JavaScript: the text of ``stepper.run_text``, statement by statement.

A page then has the same model as a simulation, without a server, a compiler or a network.  It is
the walk of ``c_text`` with other words: tables are flat arrays, and whole numbers are numbers,
which are exact up to 2^53.  Sums, products, quotients and roots have the same bits as in C; of
``sin`` or ``exp`` each engine has its own last bit.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Iterable, Iterator, Sequence

from servo_models.core.c_text import OPERATORS, WHOLE_CALLS, AsNumba, Kinds, columns, parsed, stored
from servo_models.core.flat import Flat
from servo_models.core.printer import indent
from servo_models.core.stepper import run_text, start_text

_HELPERS = """
"use strict";

/* As numba's, which is 0 for a divisor of 0. */
function wholeRemainder(a, b) {
    return b > 0 || b < -1 ? remainderOf(a, b) : 0;
}

function remainderOf(a, b) {
    const rest = a % b;
    return rest !== 0 && rest < 0 !== b < 0 ? rest + b : rest;
}

function copysign(size, sign) {
    return Math.abs(size) * (sign < 0 || Object.is(sign, -0) ? -1 : 1);
}
"""
_OWN = ("copysign",)
ROWS_AT_ONCE = 16  # rows of a call of ``advance``


def js_model(flat: Flat) -> str:
    """Return a JavaScript expression: an object with ``start`` and ``run`` of a flattened plant.

    ``start(p)`` is the state at rest with the parameters ``p``; ``run`` is that of ``js_run_text``.

    Raises:
        ValueError: see ``js_run_text``.

    Example:
        >>> from servo_models.catalogue import model
        >>> js_model(model("dc_motor").flat).splitlines()[0]
        '(() => {'
    """
    text = js_run_text(run_text(flat)) + _js_start_text(start_text(flat), flat.size)
    return "\n".join(["(() => {", *indent(text.split("\n")), "    return { start, run };", "})()"])


def _js_start_text(text: str, size: int) -> str:
    """``make`` of a text printed by ``stepper.start_text``: the state with room for its queues."""
    make, _ = parsed(text)
    *body, last = make.body
    values = next(node for node in ast.walk(last) if isinstance(node, ast.List)).elts
    write = _JavaScript(Kinds(make.body, calls=WHOLE_CALLS), {}, {})
    lines = [
        "function start(v__p) {",
        f"    const v__x = new Float64Array({size});",
        *indent(write.declared(body, ())),
        *indent(write.block(body)),
        *indent(f"v__x[{i}] = {write.plain(it)};" for i, it in enumerate(values)),
        "    return v__x;",
        "}",
    ]
    return "\n".join([*lines, ""])


@functools.cache  # of an actuator all effects have the same text
def js_run_text(text: str) -> str:
    """Return ``run`` of a text printed by ``stepper.run_text`` in JavaScript.

    ``run(p, x, rows, times, inputs, out, most, at)`` returns the code, and writes the row or the
    number of sub-steps into ``at[0]``.  All but ``rows`` and ``most`` are a ``Float64Array``;
    ``inputs`` and ``out`` have a row after the other.

    The rows are run a few at a time, by ``advance``, which keeps its variables in between: an
    engine compiles a function that is called often to its fastest code, and one that stays in a
    loop for long to code that takes 4 to 20 times as long (V8, ``benchmarks/bench_javascript.py``).

    Raises:
        ValueError: a block uses a function of ``math`` that has no form here.

    Example:
        >>> from servo_models.catalogue import model
        >>> from servo_models.core.stepper import run_text
        >>> text = js_run_text(run_text(model("dc_motor").flat))
        >>> "function run(v__p, v__x, v__rows," in text
        True
    """
    run, _ = parsed(text)
    write = _JavaScript(Kinds(run.body, calls=WHOLE_CALLS), {}, {})
    write.columns = {name: columns(run, name) for name in ("_inputs", "_out")}
    memory, *body = run.body
    ahead = next(node for node in ast.walk(memory) if isinstance(node, ast.Call)).args[0]
    place = next(k for k, it in enumerate(body) if isinstance(it, ast.For))
    setup, rows, last = body[:place], body[place], body[place + 1 :]
    assert isinstance(rows, ast.For)
    names = [f"v_{name}" for name in stored(body)]
    shared = "v__p, v__x, v__rows, v__times, v__inputs, v__out, v__most, v__at"
    lines = [
        _HELPERS,
        f"function advance(v__ahead, kept, from, to, {shared}) {{",
        *indent(write.declared(body, ())),
        "    if (from === 0) {",
        *indent(indent(write.block(setup))),
        "    } else {",
        *(f"        {name} = kept[{k}];" for k, name in enumerate(names)),
        "    }",
        "    for (v__row = from; v__row < to; v__row++) {",
        *indent(indent(write.block(rows.body))),
        "    }",
        "    if (to < v__rows) {",
        *(f"        kept[{k}] = {name};" for k, name in enumerate(names)),
        "        return 0;",
        "    }",
        *indent(write.block(last)),
        "}",
        "",
        f"function run({shared}) {{",
        f"    const ahead = new Float64Array({write.plain(ahead)});",
        f"    const kept = new Float64Array({len(names)});",
        f"    for (let from = 0; from < v__rows; from += {ROWS_AT_ONCE}) {{",
        f"        const to = Math.min(from + {ROWS_AT_ONCE}, v__rows);",
        f"        const code = advance(ahead, kept, from, to, {shared});",
        "        if (code !== 0) return code;",
        "    }",
        "    return 0;",
        "}",
    ]
    return "\n".join([*lines, ""])


class _JavaScript(AsNumba):
    """Writes what numba computes in JavaScript."""

    constant = "const"
    infinity = "Infinity"
    columns: dict[str, int]

    def declared(self, body: Sequence[ast.stmt], fields: Iterable[str]) -> Iterator[str]:
        for name in stored(body):
            yield f"let v_{name} = 0;"

    def statement(self, node: ast.stmt) -> list[str]:
        if isinstance(node, ast.While):
            head = f"while ({self.plain(node.test)}) {{"
            return [head, *indent(self.block(node.body)), "}", *self.block(node.orelse)]
        return super().statement(node)

    def returned(self, code: str, second: ast.expr) -> list[str]:
        return [f"v__at[0] = {self.plain(second)};", f"return {code};"]

    def branch(self, node: ast.If) -> list[str]:
        return super(AsNumba, self).branch(node)  # without a hint for a C compiler

    def of(self, node: ast.expr) -> str:
        match node:
            case ast.Subscript(ast.Name(table), ast.Tuple([row, column])):
                place = f"{self.columns[table]} * {self.of(row)} + {self.of(column)}"
                return f"v_{table}[{place}]"
        return super().of(node)

    def index(self, node: ast.expr) -> str:
        return self.plain(node) if self.kinds.is_whole(node) else f"Math.trunc({self.plain(node)})"

    def operation(self, op: ast.operator, left: ast.expr, right: ast.expr) -> str:
        a, b = self.of(left), self.of(right)
        if isinstance(op, ast.Mod):
            whole = self.kinds.is_whole(left) and self.kinds.is_whole(right)
            return f"{'wholeRemainder' if whole else 'remainderOf'}({a}, {b})"
        return f"({a} {'/' if isinstance(op, ast.Div) else OPERATORS[type(op)]} {b})"

    def call(self, function: str, arguments: Sequence[ast.expr]) -> str:
        written = super().call(function, arguments)  # which refuses what has no form
        given = ", ".join(self.plain(argument) for argument in arguments)
        name = function.removeprefix("_math.")
        if function == "_len":
            return written
        if function == "_float":
            return self.of(arguments[0])
        if function == "_int":
            return f"Math.trunc({given})"
        if name in ("_abs", "fabs"):
            return f"Math.abs({given})"
        return f"{name}({given})" if name in _OWN else f"Math.{name}({given})"
