"""Expressions of responses: names, also with the condition and a dot, numbers and arithmetic.

No other syntax is accepted, so an expression evaluated in a script calls nothing and ends soon.
"""

from __future__ import annotations

import ast
import re
import warnings
from collections.abc import Callable

__all__ = ["fault_of", "is_name", "names_in", "renamed"]

MOST_LETTERS, MOST_OPERATIONS = 2000, 100
"""Largest number of letters and of operations of an expression."""

DEEPEST = 50
"""Largest depth of nested brackets."""

LARGEST = 1e15
"""Largest size of the numbers in an expression, and of constant parts."""

_OPERATORS = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_SIGNS = {ast.USub: lambda a: -a, ast.UAdd: lambda a: a}
_LETTERS = re.compile(r"[A-Za-z0-9_.+*/() -]+")
_NUMBER = re.compile(r"[0-9.]+([eE][+-]?[0-9]+)?")
_ADVICE = "give a name, or names and numbers with + - * / ** ( )"


def is_name(text: str) -> bool:
    """Whether a text is one name, such as ``CL`` or ``cruise.CL``."""
    first, _, rest = text.partition(".")
    return first.isidentifier() and (rest.isidentifier() if "." in text else True)


def fault_of(of: str) -> str:
    """Say why a text is not an expression, or cannot be evaluated; empty if it is valid.

    Examples
    --------
    >>> fault_of("cruise.CD + 2 * volume"), fault_of("CD / (1 - 1)")
    ('', 'divides by (1 - 1), which is 0')
    """
    if len(of) > MOST_LETTERS:
        return f"has {len(of):,} letters; give {MOST_LETTERS:,} at most"
    if _depth(of) > DEEPEST:
        return f"has {_depth(of)} brackets in one another; give {DEEPEST} at most"
    if len(re.findall(r"\*\*|[-+*/]", of)) > MOST_OPERATIONS:
        return f"has more than {MOST_OPERATIONS} operations; write fewer"
    try:
        _parsed(of)
    except ValueError as error:
        return str(error)
    return ""


def names_in(of: str) -> list[str]:
    """Names in an expression, each once; the text itself if it is not an expression.

    Examples
    --------
    >>> names_in("cruise.CD + 2 * volume")
    ['cruise.CD', 'volume']
    """
    try:
        return list(dict.fromkeys(of[node.col_offset : node.end_col_offset] for node in _name_nodes(_parsed(of))))
    except ValueError:
        return [of]


def renamed(of: str, name_of: Callable[[str], str]) -> str:
    """Write an expression with other names; `ValueError` if it is not an expression.

    Examples
    --------
    >>> renamed("cruise.CD + 2 * volume", lambda name: name.replace(".", "_"))
    'cruise_CD + 2 * volume'
    """
    text = of
    for node in reversed(_name_nodes(_parsed(of))):
        name = of[node.col_offset : node.end_col_offset]
        text = text[: node.col_offset] + name_of(name) + text[node.end_col_offset :]
    return text


def _name_nodes(tree: ast.expr) -> list[ast.expr]:
    """Names in a tree, from left to right."""
    inner = {node.value for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    nodes = [node for node in ast.walk(tree) if isinstance(node, ast.Name | ast.Attribute) and node not in inner]
    return sorted(nodes, key=lambda node: node.col_offset)


def _parsed(of: str) -> ast.expr:
    """Tree of an expression."""
    if not _LETTERS.fullmatch(of):
        raise ValueError(_ADVICE)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # from numbers that touch a word, refused below
            tree = ast.parse(of, mode="eval").body
    except (SyntaxError, RecursionError, MemoryError):
        raise ValueError(_ADVICE) from None
    _value(tree, of)
    return tree


def _depth(of: str) -> int:
    """Depth of nested brackets."""
    depth = deepest = 0
    for letter in of:
        depth += {"(": 1, ")": -1}.get(letter, 0)
        deepest = max(deepest, depth)
    return deepest


def _value(node: ast.expr, of: str) -> float | None:
    """Value of a tree of numbers only; None if it contains names."""
    if isinstance(node, ast.Name) or (isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)):
        return None
    if isinstance(node, ast.Constant) and _NUMBER.fullmatch(text := of[node.col_offset : node.end_col_offset]):
        return _checked(node, of, lambda: float(text))
    if isinstance(node, ast.UnaryOp) and type(node.op) in _SIGNS:
        value = _value(node.operand, of)
        return None if value is None else _SIGNS[type(node.op)](value)
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        left, right = _value(node.left, of), _value(node.right, of)
        if isinstance(node.op, ast.Div) and right == 0.0:
            raise ValueError(f"divides by {_part(node.right, of)}, which is 0")
        if left is None or right is None:
            return None
        return _checked(node, of, lambda: _OPERATORS[type(node.op)](left, right))
    raise ValueError(_ADVICE)


def _checked(node: ast.expr, of: str, made: Callable[[], float]) -> float:
    """A value, checked to be a number within the largest size."""
    try:
        value = made()
    except (ArithmeticError, ValueError):
        value = float("nan")
    if isinstance(value, complex) or not abs(value) <= LARGEST:
        raise ValueError(f"has {_part(node, of)} in it, which is no number up to {LARGEST:g}")
    return value


def _part(node: ast.expr, of: str) -> str:
    """The text of a tree, with its brackets."""
    start, end = node.col_offset, node.end_col_offset or node.col_offset
    while start > 0 and end < len(of) and of[start - 1] == "(" and of[end] == ")":
        start, end = start - 1, end + 1
    return of[start:end]
