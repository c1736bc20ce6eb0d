"""Small mistakes to put into a module: `mutants(source)` lists them, `mutated(source, number, file)` makes one.

What people read stays as it is: docstrings, annotations, messages of errors, texts with a blank in them.
"""

from __future__ import annotations

import ast
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import CodeType
from typing import Any

OTHERS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or, ast.Or: ast.And,
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Add, ast.Pow: ast.Mult, ast.MatMult: ast.Mult, ast.LShift: ast.RShift, ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd, ast.BitXor: ast.BitAnd, ast.USub: ast.UAdd, ast.Invert: ast.UAdd,
}  # fmt: skip
"""Which operator takes the place of which."""

COMMUTING = ("min", "max", "hypot", "samestat")
"""Calls whose arguments may stand in any order."""

OPPOSITES = (ast.Eq, ast.NotEq, ast.Is, ast.IsNot, ast.In, ast.NotIn)
"""A comparison by one of these that takes the other says the opposite: the whole is not negated as well."""

LARGE = 100
"""Numbers from which on one more is often no mistake: they are doubled."""

NAMES_TYPES = ("TypeVar", "ParamSpec", "cast", "NewType", "Literal")
"""Calls and subscripts with texts that only type checkers read."""


@dataclass(frozen=True, slots=True)
class Mutant:
    """One mistake.

    Attributes:
        number: its place in the list of its module.
        line, column: of the source, where it is made.
        runs_at_import: whether the line runs when the module is imported, not when a function of it is called.
        what: the mistake, in words.
    """

    number: int
    line: int
    column: int
    runs_at_import: bool
    what: str


@dataclass(frozen=True, slots=True)
class _Change:
    node: ast.stmt | ast.expr
    in_function: bool
    what: str
    make: Callable[[], None]


def mutants(source: str) -> list[Mutant]:
    """All mistakes that can be made in a module."""
    changes = _changes(ast.parse(source))
    return [
        Mutant(number, c.node.lineno, c.node.col_offset, not c.in_function, c.what) for number, c in enumerate(changes)
    ]


def mutated(source: str, number: int, file: str) -> CodeType:
    """The module with one mistake in it."""
    tree = ast.parse(source)
    list(_changes(tree))[number].make()
    return compile(ast.fix_missing_locations(tree), file, "exec")


def _changes(tree: ast.Module) -> Iterator[_Change]:
    yield from _of_body(tree.body, False)


def _of_body(body: list[ast.stmt], inside: bool) -> Iterator[_Change]:
    for place, statement in enumerate(body):
        if _only_for_types(statement):
            continue
        if _may_be_left_out(statement):
            yield _Change(statement, inside, f"left out: {_shown(statement)}", _replacing(body, place))
        yield from _of_statement(statement, inside)


def _of_statement(statement: ast.stmt, inside: bool) -> Iterator[_Change]:
    """Mistakes in a statement's own expressions, then in the statements in it."""
    if isinstance(statement, ast.Raise):
        return
    in_function = inside or isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef)
    if isinstance(statement, ast.If | ast.While):
        yield from _negation(statement, statement.test, inside)
    if isinstance(statement, ast.Return) and statement.value is not None and not _is(statement.value, None, False):
        yield _setting(statement, "value", ast.Constant(None), inside, f"{_shown(statement)} becomes return None")
    for name, value in ast.iter_fields(statement):
        if name in ("annotation", "returns", "decorator_list", "type_params"):
            continue
        own = in_function if name == "body" else inside
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.stmt):
                yield from _of_body(value, own)
                break
            if isinstance(child, ast.ExceptHandler | ast.match_case):
                yield from _of_body(child.body, own)
            elif isinstance(child, ast.withitem):
                yield from _of_expression(child.context_expr, own)
            elif isinstance(child, ast.arguments):
                for default in (*child.defaults, *child.kw_defaults):
                    if default is not None:
                        yield from _of_expression(default, own)
            elif isinstance(child, ast.expr):
                yield from _of_expression(child, own)


def _of_expression(node: ast.expr, inside: bool) -> Iterator[_Change]:
    if isinstance(node, ast.JoinedStr) or _named(node) in NAMES_TYPES:
        return
    yield from _at(node, inside)
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            yield from _of_expression(child, inside)
        elif isinstance(child, ast.keyword):
            yield from _of_expression(child.value, inside)
        elif isinstance(child, ast.comprehension):
            yield from _of_expression(child.iter, inside)
            for condition in child.ifs:
                yield from _of_expression(condition, inside)


def _at(node: ast.expr, inside: bool) -> Iterator[_Change]:
    """Mistakes of one expression itself."""
    if isinstance(node, ast.Compare):
        for place, operator in enumerate(node.ops):
            other = OTHERS[type(operator)]()
            yield _Change(
                node.comparators[place],
                inside,
                f"{_shown(node)}: {type(other).__name__}",
                _replacing(node.ops, place, other),
            )
    elif isinstance(node, ast.BinOp | ast.BoolOp) or (isinstance(node, ast.UnaryOp) and type(node.op) in OTHERS):
        other = OTHERS[type(node.op)]()
        yield _setting(node, "op", other, inside, f"{_shown(node)}: {type(other).__name__}")
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield _Change(node, inside, f"{_shown(node)}: without not", lambda: _negate_twice(node))
    elif isinstance(node, ast.IfExp):
        yield from _negation(node, node.test, inside)
    elif isinstance(node, ast.Constant):
        if (other_value := _other_value(node.value)) is not None:
            yield _setting(node, "value", other_value, inside, f"{node.value!r} becomes {other_value!r}")
    elif isinstance(node, ast.Call):
        ordered = [] if _named(node) in COMMUTING else node.args
        plain = [number for number, each in enumerate(ordered) if not isinstance(each, ast.Starred)]
        for one, next_one in itertools.pairwise(plain):
            if ast.dump(node.args[one]) == ast.dump(node.args[next_one]):
                continue  # they are the same
            yield _Change(
                node, inside, f"{_shown(node)}: arguments {one + 1} and {next_one + 1} swapped",
                _swapping(node.args, one, next_one),
            )  # fmt: skip
        for place, keyword in enumerate(node.keywords):
            if keyword.arg is not None:
                yield _Change(node, inside, f"{_shown(node)}: without {keyword.arg}", _dropping(node.keywords, place))


def _other_value(value: object) -> object:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1 if abs(value) < LARGE else 2 * value
    if isinstance(value, float):
        return 1.5 * value if value else 1.0
    if isinstance(value, bytes):
        return value + b"x"
    if isinstance(value, str) and " " not in value:
        return value + "x"
    return None


def _only_for_types(statement: ast.stmt) -> bool:
    """Imports for annotations, lists of public names, docstrings, and bodies that a derived class has to have."""
    if isinstance(statement, ast.Raise):
        return statement.exc is not None and ast.unparse(statement.exc).startswith("NotImplementedError")
    if isinstance(statement, ast.If):
        return ast.unparse(statement.test) == "TYPE_CHECKING"
    if isinstance(statement, ast.Assign):
        return ast.unparse(statement.targets[0]) == "__all__"
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _may_be_left_out(statement: ast.stmt) -> bool:
    """Calls for what they do, what is set on an object or by way of an operator, errors, and jumps."""
    if isinstance(statement, ast.Assign):
        return all(isinstance(target, ast.Attribute | ast.Subscript) for target in statement.targets)
    return isinstance(statement, ast.Expr | ast.AugAssign | ast.Raise | ast.Break | ast.Continue | ast.Delete)


def _named(node: ast.AST) -> str:
    """The name that a call or a subscript calls or looks up."""
    inner = node.func if isinstance(node, ast.Call) else node.value if isinstance(node, ast.Subscript) else None
    return inner.id if isinstance(inner, ast.Name) else inner.attr if isinstance(inner, ast.Attribute) else ""


def _is(node: ast.expr, *values: object) -> bool:
    return isinstance(node, ast.Constant) and any(node.value is value for value in values)


def _shown(node: ast.AST) -> str:
    text = " ".join(ast.unparse(node).split())
    return text if len(text) <= 80 else f"{text[:77]}..."


def _negation(node: ast.If | ast.While | ast.IfExp, test: ast.expr, inside: bool) -> Iterator[_Change]:
    simple = isinstance(test, ast.Compare) and len(test.ops) == 1 and isinstance(test.ops[0], OPPOSITES)
    if not simple and not (isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not)):
        yield _setting(node, "test", ast.UnaryOp(ast.Not(), test), inside, f"not ({_shown(test)})")


def _negate_twice(node: ast.UnaryOp) -> None:
    node.operand = ast.UnaryOp(ast.Not(), node.operand)


def _setting(node: ast.stmt | ast.expr, field: str, value: object, inside: bool, what: str) -> _Change:
    return _Change(node, inside, what, lambda: setattr(node, field, value))


def _replacing(nodes: list[Any], place: int, by: object = None) -> Callable[[], None]:
    """A function that replaces a node by another, or by a statement that does nothing."""

    def make() -> None:
        nodes[place] = ast.Pass() if by is None else by

    return make


def _swapping(nodes: list[ast.expr], one: int, other: int) -> Callable[[], None]:
    def make() -> None:
        nodes[one], nodes[other] = nodes[other], nodes[one]

    return make


def _dropping(nodes: list[ast.keyword], place: int) -> Callable[[], None]:
    def make() -> None:
        del nodes[place]

    return make
