"""Expressions of responses: names, those of conditions with a dot, numbers and arithmetic."""

from __future__ import annotations

import ast
from collections.abc import Callable

__all__ = ["is_arithmetic", "is_name", "names_in", "renamed"]


def is_name(text: str) -> bool:
    """Whether a text is one name, such as ``CL`` or ``cruise.CL``."""
    first, _, rest = text.partition(".")
    return first.isidentifier() and (rest.isidentifier() if "." in text else True)


def names_in(of: str) -> list[str]:
    """Names in an expression, each once; the text itself where it is none.

    Examples
    --------
    >>> names_in("cruise.CD + 2 * volume")
    ['cruise.CD', 'volume']
    """
    tree = _parsed(of)
    if tree is None:
        return [of]
    inner = {node.value for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Name | ast.Attribute) and node not in inner]
    nodes.sort(key=lambda node: (node.lineno, node.col_offset))
    return list(dict.fromkeys(map(ast.unparse, nodes)))


def is_arithmetic(of: str) -> bool:
    """Whether a text is an expression of names, numbers and the four operations and powers."""
    tree = _parsed(of)
    allowed = (
        *(ast.Expression, ast.BinOp, ast.UnaryOp, ast.Attribute, ast.Name, ast.Constant),
        *(ast.operator, ast.unaryop, ast.Load),
    )
    operators = (ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Pow, ast.USub, ast.UAdd)
    return tree is not None and all(
        isinstance(node, allowed)
        and (not isinstance(node, ast.operator | ast.unaryop) or isinstance(node, operators))
        and (not isinstance(node, ast.Attribute) or isinstance(node.value, ast.Name))
        and (not isinstance(node, ast.Constant) or type(node.value) in (int, float))
        for node in ast.walk(tree)
    )


def renamed(of: str, name_of: Callable[[str], str]) -> str:
    """Write an expression with other names.

    Examples
    --------
    >>> renamed("cruise.CD + 2 * volume", lambda name: name.replace(".", "_"))
    'cruise_CD + 2 * volume'
    """
    return ast.unparse(_Renaming(name_of).visit(ast.parse(of, mode="eval")))


class _Renaming(ast.NodeTransformer):
    """Puts other names into an expression."""

    def __init__(self, name_of: Callable[[str], str]):
        self.name_of = name_of

    def visit_Name(self, node: ast.Name) -> ast.Name:
        return ast.Name(self.name_of(node.id))

    def visit_Attribute(self, node: ast.Attribute) -> ast.Name:
        return ast.Name(self.name_of(ast.unparse(node)))


def _parsed(of: str) -> ast.Expression | None:
    """Tree of an expression; None where the text is none."""
    try:
        return ast.parse(of, mode="eval")
    except (SyntaxError, ValueError):
        return None
