"""Makes mutants of a module's functions: one comparison, operator, constant or condition changed at a time.

No library does this in-process: mutmut and cosmic-ray start a test run per mutant, minutes for what takes
seconds here.
"""

from __future__ import annotations

import ast
import copy
import inspect
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import Any

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
OPERATORS: dict[type[ast.operator], tuple[type[ast.operator], ...]] = {
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
}
CALLS = {"min": "max", "max": "min", "any": "all", "all": "any", "abs": "float"}


@dataclass(frozen=True)
class Mutant:
    """A module's source tree with one change."""

    where: str
    """function: before → after."""
    tree: ast.Module


def mutants(
    module: ModuleType, functions: frozenset[str], constants: frozenset[str]
) -> Iterator[Mutant]:
    """Every mutant of the named functions and module constants."""
    tree = ast.parse(inspect.getsource(module))
    for scope in ast.walk(tree):
        if isinstance(scope, ast.FunctionDef) and scope.name in functions:
            yield from _of(tree, scope, scope.name, skip_calls_of=("Broken",))
        elif isinstance(scope, ast.AnnAssign) and ast.unparse(scope.target) in constants:
            yield from _of(tree, scope, ast.unparse(scope.target), skip_calls_of=())


def load(tree: ast.Module, original: ModuleType) -> dict[str, Any]:
    """The names of the mutated module, executed in place of `original`."""
    space: dict[str, Any] = {"__name__": original.__name__, "__file__": original.__file__}
    exec(compile(tree, f"<mutant of {original.__name__}>", "exec"), space)
    return space


def _of(
    tree: ast.Module, scope: ast.AST, name: str, skip_calls_of: tuple[str, ...]
) -> Iterator[Mutant]:
    for path in list(_paths(scope, skip_calls_of)):
        node = _at(scope, path)
        for changed in _changes(node):
            if ast.dump(changed) == ast.dump(node):
                continue
            mutated = copy.deepcopy(tree)
            target = next(
                n
                for n in ast.walk(mutated)
                if type(n) is type(scope) and n.lineno == scope.lineno  # type: ignore[attr-defined]
            )
            _put(target, path, changed)
            before, after = ast.unparse(node), ast.unparse(changed)
            yield Mutant(f"{name}: {before} → {after}", ast.fix_missing_locations(mutated))


Path = tuple[tuple[str, int | None], ...]


def _paths(node: ast.AST, skip: tuple[str, ...], here: Path = ()) -> Iterator[Path]:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in skip:
        return  # the text of a refusal is no rule
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "args") and isinstance(
            node, ast.FunctionDef | ast.AnnAssign
        ):
            continue
        children = enumerate(value) if isinstance(value, list) else [(None, value)]
        for index, child in children:
            if isinstance(child, ast.AST):
                path = (*here, (field, index))
                yield path
                yield from _paths(child, skip, path)


def _at(node: ast.AST, path: Path) -> Any:
    for field, index in path:
        value = getattr(node, field)
        node = value if index is None else value[index]
    return node


def _put(node: ast.AST, path: Path, new: ast.AST) -> None:
    parent = _at(node, path[:-1])
    field, index = path[-1]
    if index is None:
        setattr(parent, field, new)
    else:
        getattr(parent, field)[index] = new


def _changes(node: ast.AST) -> Iterator[ast.AST]:
    match node:
        case ast.Compare():
            for i, op in enumerate(node.ops):
                for other in COMPARISONS[type(op)]:
                    changed = copy.deepcopy(node)
                    changed.ops[i] = other()
                    yield changed
        case ast.BinOp() if type(node.op) in OPERATORS:
            for other_op in OPERATORS[type(node.op)]:
                changed_bin = copy.deepcopy(node)
                changed_bin.op = other_op()
                yield changed_bin
        case ast.BoolOp():
            changed_bool = copy.deepcopy(node)
            changed_bool.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
            yield changed_bool
        case ast.UnaryOp(op=ast.Not()):
            yield node.operand
        case ast.Call(func=ast.Name(id=name)) if name in CALLS:
            changed_call = copy.deepcopy(node)
            changed_call.func = ast.Name(CALLS[name], ast.Load())
            yield changed_call
        case ast.Constant(value=bool()):
            yield ast.Constant(not node.value)
        case ast.Constant(value=int()):
            yield ast.Constant(node.value + 1)
            yield ast.Constant(node.value - 1)
        case ast.Constant(value=float()):
            yield ast.Constant(node.value * 1.01 + 0.001)
            yield ast.Constant(node.value * 0.99 - 0.001)
        case ast.If() | ast.IfExp():
            for truth in (True, False):
                changed_if = copy.deepcopy(node)
                changed_if.test = ast.Constant(truth)
                yield changed_if
        case ast.Assign(targets=[ast.Subscript() | ast.Attribute()]) | ast.Expr(value=ast.Call()):
            yield ast.Pass()
        case _:
            pass
