"""Python as syntax trees: fixed templates, with values in place of their names.

Settings of a study enter a script only as values, through `literal`, and never as text that is parsed.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Mapping
from typing import Any

__all__ = ["call", "expression", "literal", "statement"]


def literal(value: Any) -> ast.expr:
    r"""Tree of a value: a text, a number, a flag, None, or lists, tuples and tables of them; trees stay as they are.

    Raises `TypeError` for anything else, and `ValueError` for numbers that are not finite.

    Examples
    --------
    >>> ast.unparse(literal({"a": [1, -2.5, "b'"]}))
    '{\'a\': [1, -2.5, "b\'"]}'
    """
    if isinstance(value, ast.expr):
        return value
    if isinstance(value, list):
        return ast.List([literal(item) for item in value], ast.Load())
    if isinstance(value, tuple):
        return ast.Tuple([literal(item) for item in value], ast.Load())
    if isinstance(value, Mapping):
        return ast.Dict([literal(key) for key in value], [literal(item) for item in value.values()])
    if type(value) is float and not math.isfinite(value):
        raise ValueError(f"{value} cannot be written as Python")
    if type(value) in (int, float) and (value < 0 or str(value) == "-0.0"):
        return ast.UnaryOp(ast.USub(), ast.Constant(-value))
    if value is None or type(value) in (str, int, float, bool):
        return ast.Constant(value)
    raise TypeError(f"{type(value).__name__} cannot be written as Python")


def call(function: str, *arguments: Any, **settings: Any) -> ast.Call:
    """Tree of a call of a fixed function, with trees and values as arguments."""
    made = expression(f"{function}()")
    if not isinstance(made, ast.Call):
        raise ValueError(f"{function} is no function")
    wrong = [name for name in settings if not name.isidentifier()]
    if wrong:
        raise ValueError(f"{wrong[0]!r} is no name of an argument")
    made.args = [literal(value) for value in arguments]
    made.keywords = [ast.keyword(name, literal(value)) for name, value in settings.items()]
    return made


def statement(template: str, **values: Any) -> ast.stmt:
    r"""Tree of the one statement of a template, with trees and values in place of names.

    Examples
    --------
    >>> ast.unparse(statement("model = load(HERE / file)", file="a'b.h5"))
    'model = load(HERE / "a\'b.h5")'
    """
    (found,) = _Filled(values).visit(ast.parse(template)).body
    return found


def expression(template: str, **values: Any) -> ast.expr:
    """Tree of an expression, see `statement`."""
    return _Filled(values).visit(ast.parse(template, mode="eval")).body


class _Filled(ast.NodeTransformer):
    """Puts values in place of names."""

    def __init__(self, values: Mapping[str, Any]):
        self.values = values

    def visit_Name(self, node: ast.Name) -> ast.expr:
        return literal(self.values[node.id]) if node.id in self.values else node
