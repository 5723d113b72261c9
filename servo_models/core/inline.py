"""Write a block's body into a flat text: arguments become wires, returns become assignments.

The subset a block may use is small on purpose, so that one text runs in CPython and in
numba and can be printed as C: assignments, ``if``, ``while`` without ``return``,
arithmetic, comparisons, ``abs``, ``int``, ``float`` and ``math``, which stand there as
``_abs`` and so on, since a wire may be called ``abs``.

A function is read once, however often a plant has it: ``return gain * signal`` becomes the
template ``{0} = {gain} * {signal}``, and each of its places fills in its names.
"""

from __future__ import annotations

import ast
import functools
import inspect
import math
import textwrap
from collections.abc import Mapping, Sequence

from servo_models.core.block import Block, Function
from servo_models.core.flat import local

KEPT = 512  # templates that a process keeps, the latest ones
_BUILTINS = {"abs": abs, "int": int, "float": float, "math": math}
_STATEMENTS = (ast.Assign, ast.AugAssign, ast.If, ast.While, ast.Return, ast.Pass)
_EXPRESSIONS = (
    *(ast.BinOp, ast.UnaryOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Call, ast.Tuple),
    *(ast.Name, ast.Constant, ast.Attribute, ast.Subscript),
)


def inline(block: Block, names: Mapping[str, str], targets: Sequence[str], owner: str) -> list[str]:
    """Return the lines of ``block`` with its arguments renamed.

    Args:
        block: what to write.
        names: text name of every argument.  A queue ``q`` maps to the index of its first
            element in the state vector, written ``_x[index + i]``.
        targets: text names that receive the returned values, in order.
        owner: block or effect that the local variables belong to.

    Raises:
        ValueError: the block uses something outside the subset; names block and line.
    """
    returned = (*(block.acts_on or block.gives), *block.memory)
    stored, template = _template(block.function, block.name, returned)
    known = {**names, **{name: local(owner, name) for name in stored}}
    lines = [f"{known[name]} = {names[name]}" for name in stored if name in names]
    return lines + [_or_pass(line.format(*targets, **known)) for line in template]


def _or_pass(line: str) -> str:
    """A line, or ``pass`` in its place if it gives a name its own value."""
    statement = line.lstrip()
    left, _, right = statement.partition(" = ")
    return line.replace(statement, "pass") if left == right else line


@functools.lru_cache(maxsize=KEPT)
def _template(
    function: Function, block: str, returned: tuple[str, ...]
) -> tuple[tuple[str, ...], list[str]]:
    """Return the variables that a block stores, and its lines with names and targets in braces;
    ``block`` and ``returned`` are for errors."""
    definition = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
    assert isinstance(definition, ast.FunctionDef)
    body = definition.body[1:]  # the docstring comes first, block.py insists on it
    nodes = [node for statement in body for node in ast.walk(statement)]
    _check_subset(block, nodes)
    names = [node for node in nodes if isinstance(node, ast.Name)]
    stored = dict.fromkeys(node.id for node in names if isinstance(node.ctx, ast.Store))
    arguments = inspect.signature(function).parameters.keys()
    _set_after(block, body, set(stored) - arguments)
    rename = _Rename(block, function, {*stored, *arguments})
    renamed = [rename.visit(statement) for statement in body]
    lines = [ast.unparse(statement) for statement in _tail_form(renamed, returned, block)]
    return tuple(stored), "\n".join(lines).splitlines()


def _check_subset(block: str, nodes: Sequence[ast.AST]) -> None:
    for node in nodes:
        known = _STATEMENTS if isinstance(node, ast.stmt) else _EXPRESSIONS
        if isinstance(node, (ast.stmt, ast.expr)) and not isinstance(node, known):
            kind = type(node).__name__
            raise ValueError(
                f"block '{block}' uses {kind} (line {node.lineno} of its source), which a"
                " block may not: see the docstring of inline.py"
            )
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mod):
            left = node.left
            if not (isinstance(left, ast.Call) and ast.unparse(left.func) == "int"):
                raise ValueError(f"block '{block}' takes % of a float: take it of an int()")


def _set_after(block: str, body: Sequence[ast.stmt], unset: set[str]) -> set[str]:
    """Return which local variables of ``unset`` may still have no value after ``body``.

    Raises:
        ValueError: one of them is read, where Python would stop but the text would find what
            it held at another time.
    """
    for statement in body:
        if isinstance(statement, ast.If | ast.While):
            _check_set(block, statement.test, unset)
            inside = _set_after(block, statement.body, unset)
            other = _set_after(block, statement.orelse, unset)
            unset = inside | other if isinstance(statement, ast.If) else unset
        else:
            _check_set(block, statement, unset)
            unset = unset - {n.id for n in ast.walk(statement) if isinstance(n, ast.Name)}
        if isinstance(statement, ast.Return):
            return set()  # nothing follows
    return unset


def _check_set(block: str, tree: ast.AST, unset: set[str]) -> None:
    stored_only = not isinstance(tree, ast.AugAssign)
    for node in ast.walk(tree):
        if not isinstance(node, ast.Name) or node.id not in unset:
            continue
        if not (stored_only and isinstance(node.ctx, ast.Store)):
            raise ValueError(
                f"block '{block}' reads '{node.id}' (line {node.lineno} of its source), which"
                " may have no value there: give it one before"
            )


def _tail_form(body: Sequence[ast.stmt], returned: Sequence[str], block: str) -> list[ast.stmt]:
    """Turn returns in tail position into assignments and the rest after them into else."""
    done: list[ast.stmt] = []
    for i, statement in enumerate(body):
        if isinstance(statement, ast.Return):
            return [*done, _assign(statement, returned, block)]
        if isinstance(statement, ast.If) and _returns(statement):
            rest = body[i + 1 :]
            then = statement.body if _ends(statement.body) else [*statement.body, *rest]
            other = statement.orelse if _ends(statement.orelse) else [*statement.orelse, *rest]
            branch = ast.If(
                test=statement.test,
                body=_tail_form(then, returned, block),
                orelse=_tail_form(other, returned, block),
            )
            return [*done, branch]
        if _returns(statement):
            raise ValueError(f"block '{block}' returns from inside a loop: return at its end")
        done.append(statement)
    return done


def _returns(statement: ast.stmt) -> bool:
    return any(isinstance(node, ast.Return) for node in ast.walk(statement))


def _ends(body: Sequence[ast.stmt]) -> bool:
    if not body:
        return False
    last = body[-1]
    if isinstance(last, ast.If):
        return _ends(last.body) and _ends(last.orelse)
    return isinstance(last, ast.Return)


def _assign(statement: ast.Return, returned: Sequence[str], block: str) -> ast.stmt:
    value = statement.value
    given = len(value.elts) if isinstance(value, ast.Tuple) else 1
    if value is None or given != len(returned):
        raise ValueError(
            f"block '{block}' returns {given} values where its signature asks for"
            f" {len(returned)} ({', '.join(returned)})"
        )
    stores: list[ast.expr] = [ast.Name(id=f"{{{i}}}", ctx=ast.Store()) for i in range(given)]
    target = stores[0] if given == 1 else ast.Tuple(elts=stores, ctx=ast.Store())
    return ast.copy_location(ast.Assign(targets=[target], value=value), statement)


class _Rename(ast.NodeTransformer):
    """Puts names of variables in braces, and constants of the file in place of theirs."""

    def __init__(self, block: str, function: Function, variables: set[str]) -> None:
        self.block = block
        self.seen = {**function.__globals__, **inspect.getclosurevars(function).nonlocals}
        self.variables = variables

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self.variables:
            return ast.Name(id=f"{{{node.id}}}", ctx=node.ctx)
        builtin = _BUILTINS.get(node.id)
        constant = self.seen.get(node.id, builtin)
        if builtin is not None and constant is builtin:
            return ast.Name(id=f"_{node.id}", ctx=node.ctx)
        if isinstance(constant, (int, float)) and math.isfinite(constant):
            return ast.Constant(value=constant)
        raise ValueError(
            f"block '{self.block}' uses '{node.id}' (line {node.lineno} of its source);"
            " a block may use its arguments, constants and Python's own abs, int, float and math"
        )

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        place = ast.BinOp(left=self.visit(node.value), op=ast.Add(), right=self.visit(node.slice))
        return ast.Subscript(value=ast.Name(id="_x", ctx=ast.Load()), slice=place, ctx=node.ctx)

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        if isinstance(node.op, ast.Pow):
            raise ValueError(
                f"block '{self.block}' uses **, whose last bit differs between numba and"
                " CPython: write the product"
            )
        self.generic_visit(node)
        return node
