"""Write a block's body into a flat text: arguments become wires, returns become assignments.

The subset a block may use is small on purpose, so that one text runs in CPython and in
numba and can be printed as C: assignments, ``if``, ``while`` without ``return``,
arithmetic, comparisons, ``abs``, ``int``, ``float`` and ``math``, which stand there as
``_abs`` and so on, since a wire may be called ``abs``.
"""

from __future__ import annotations

import ast
import copy
import inspect
import math
import textwrap
from collections.abc import Mapping, Sequence

from servo_models.core.block import Block
from servo_models.core.flat import local

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
        owner: whose the local variables are.

    Raises:
        ValueError: the block uses something outside the subset; names block and line.
    """
    tree = ast.parse(textwrap.dedent(inspect.getsource(block.function)))
    function = tree.body[0]
    assert isinstance(function, ast.FunctionDef)
    body = function.body[1:]  # the docstring comes first, block.py insists on it
    _check_subset(block, body)
    rename = _Rename(block, names, owner, body)
    _set_after(block, body, set(rename.stored) - set(names))
    lines = [f"{rename.names[name]} = {names[name]}" for name in rename.stored if name in names]
    for statement in _tail_form(body, targets, block):
        lines += ast.unparse(ast.fix_missing_locations(rename.visit(statement))).splitlines()
    return lines


def _check_subset(block: Block, body: Sequence[ast.stmt]) -> None:
    for node in (node for statement in body for node in ast.walk(statement)):
        known = _STATEMENTS if isinstance(node, ast.stmt) else _EXPRESSIONS
        if isinstance(node, (ast.stmt, ast.expr)) and not isinstance(node, known):
            kind = type(node).__name__
            raise ValueError(
                f"block '{block.name}' uses {kind} (line {node.lineno} of its source), which a"
                " block may not: see the docstring of inline.py"
            )
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mod):
            left = node.left
            if not (isinstance(left, ast.Call) and ast.unparse(left.func) == "int"):
                raise ValueError(f"block '{block.name}' takes % of a float: take it of an int()")


def _set_after(block: Block, body: Sequence[ast.stmt], unset: set[str]) -> set[str]:
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


def _check_set(block: Block, tree: ast.AST, unset: set[str]) -> None:
    stored_only = not isinstance(tree, ast.AugAssign)
    for node in ast.walk(tree):
        if not isinstance(node, ast.Name) or node.id not in unset:
            continue
        if not (stored_only and isinstance(node.ctx, ast.Store)):
            raise ValueError(
                f"block '{block.name}' reads '{node.id}' (line {node.lineno} of its source), which"
                " may have no value there: give it one before"
            )


def _tail_form(body: Sequence[ast.stmt], targets: Sequence[str], block: Block) -> list[ast.stmt]:
    """Turn returns in tail position into assignments and the rest after them into else."""
    done: list[ast.stmt] = []
    for i, statement in enumerate(body):
        if isinstance(statement, ast.Return):
            return [*done, _assign(statement, targets, block)]
        if isinstance(statement, ast.If) and _returns(statement):
            rest = list(body[i + 1 :])
            copied = copy.deepcopy(rest)  # both branches are renamed, each once
            then = statement.body if _ends(statement.body) else [*statement.body, *copied]
            other = statement.orelse if _ends(statement.orelse) else [*statement.orelse, *rest]
            branch = ast.If(
                test=statement.test,
                body=_tail_form(then, targets, block),
                orelse=_tail_form(other, targets, block),
            )
            return [*done, branch]
        if _returns(statement):
            raise ValueError(f"block '{block.name}' returns from inside a loop: return at its end")
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


class _Result(ast.Name):
    """A target name that is already a text name."""


def _assign(statement: ast.Return, targets: Sequence[str], block: Block) -> ast.stmt:
    value = statement.value
    given = len(value.elts) if isinstance(value, ast.Tuple) else 1
    if value is None or given != len(targets):
        raise ValueError(
            f"block '{block.name}' returns {given} values where its signature asks for"
            f" {len(targets)} ({', '.join(targets)})"
        )
    stores: list[ast.expr] = [_Result(id=name, ctx=ast.Store()) for name in targets]
    target = stores[0] if given == 1 else ast.Tuple(elts=stores, ctx=ast.Store())
    return ast.Assign(targets=[target], value=value)


class _Rename(ast.NodeTransformer):
    def __init__(
        self, block: Block, names: Mapping[str, str], owner: str, body: Sequence[ast.stmt]
    ) -> None:
        self.block = block
        outer = inspect.getclosurevars(block.function)
        self.seen = {**block.function.__globals__, **outer.nonlocals}
        self.stored = dict.fromkeys(
            node.id
            for statement in body
            for node in ast.walk(statement)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        )
        self.names = {**names, **{name: local(owner, name) for name in self.stored}}

    def visit_Assign(self, node: ast.Assign) -> ast.stmt:
        self.generic_visit(node)
        target, value = node.targets[0], node.value
        if isinstance(target, ast.Name) and isinstance(value, ast.Name) and target.id == value.id:
            return ast.Pass()
        return node

    def visit__Result(self, node: _Result) -> ast.expr:
        return ast.Name(id=node.id, ctx=ast.Store())

    def visit_Name(self, node: ast.Name) -> ast.expr:
        if node.id in self.names:
            return ast.Name(id=self.names[node.id], ctx=node.ctx)
        builtin = _BUILTINS.get(node.id)
        constant = self.seen.get(node.id, builtin)
        if builtin is not None and constant is builtin:
            return ast.Name(id=f"_{node.id}", ctx=node.ctx)
        if isinstance(constant, (int, float)) and math.isfinite(constant):
            return ast.Constant(value=constant)
        raise ValueError(
            f"block '{self.block.name}' uses '{node.id}' (line {node.lineno} of its source);"
            " a block may use its arguments, constants and Python's own abs, int, float and math"
        )

    def visit_Subscript(self, node: ast.Subscript) -> ast.expr:
        queue = self.visit(node.value)
        index = self.visit(node.slice)
        first = ast.Constant(value=int(queue.id))
        return ast.Subscript(
            value=ast.Name(id="_x", ctx=ast.Load()),
            slice=ast.BinOp(left=first, op=ast.Add(), right=index),
            ctx=node.ctx,
        )

    def visit_BinOp(self, node: ast.BinOp) -> ast.expr:
        if isinstance(node.op, ast.Pow):
            raise ValueError(
                f"block '{self.block.name}' uses **, whose last bit differs between numba and"
                " CPython: write the product"
            )
        self.generic_visit(node)
        return node
