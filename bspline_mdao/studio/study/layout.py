"""Text of syntax trees of Python: lines of a readable length, strings in double quotes."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from copy import deepcopy

__all__ = ["python_text"]

WIDTH = 120
"""Longest line, if there are brackets at which to break it."""

_INDENT = "    "


def python_text(
    # statements; strings are lines to write verbatim: comments, and blank lines as an empty string
    parts: Iterable[ast.stmt | str],
) -> str:  # python
    """Write statements one below the other."""
    parts = list(parts)
    text = "\n".join(line for part in parts for line in ([part] if isinstance(part, str) else _lines(part, ""))) + "\n"
    wanted = [item for part in parts for item in (ast.parse(part).body if isinstance(part, str) else [part])]
    if ast.dump(ast.parse(text)) != ast.dump(ast.Module(wanted, [])):
        raise ValueError("a script does not say what it is to say")
    return text


def _lines(node: ast.stmt, indent: str) -> Iterator[str]:
    """Lines of a statement."""
    if isinstance(node, ast.For | ast.If | ast.With):
        head = deepcopy(node)
        head.body = [ast.Pass()]
        yield indent + _flat(head).partition("\n")[0]
        for inner in node.body:
            yield from _lines(inner, indent + _INDENT)
    elif isinstance(node, ast.Assign):
        targets = "".join(f"{_flat(target)} = " for target in node.targets)
        yield from _folded(node.value, indent, targets, is_table=_is_table(node.value))
    elif isinstance(node, ast.Expr):
        yield from _folded(node.value, indent)
    else:
        yield indent + _flat(node)


def _is_table(node: ast.expr) -> bool:
    """Whether it is a list of calls, or a dictionary of several values by name: its entries are lines."""
    if isinstance(node, ast.Dict):
        return any(isinstance(value, ast.Dict | ast.Tuple) for value in node.values)
    return isinstance(node, ast.List) and any(isinstance(entry, ast.Call) for entry in node.elts)


def _folded(node: ast.expr, indent: str, before: str = "", after: str = "", is_table: bool = False) -> Iterator[str]:
    """Lines of an expression: one, or, if that is too long or a table, the contents of its brackets, a line each."""
    line = f"{indent}{before}{_flat(node)}{after}"
    items = _items(node)
    if not items or (len(line) <= WIDTH and not is_table):
        yield line
        return
    opening, closing = _brackets(node)
    yield f"{indent}{before}{opening}"
    for name, item in items:
        yield from _folded(item, indent + _INDENT, name, ",")
    yield f"{indent}{closing}{after}"


def _items(node: ast.expr) -> list[tuple[str, ast.expr]]:
    """The contents of an expression's brackets, and the prefix of each item."""
    if isinstance(node, ast.Call):
        return [*(("", item) for item in node.args), *((f"{item.arg}=", item.value) for item in node.keywords)]
    if isinstance(node, ast.Dict):
        return [(f"{_flat(key)}: " if key else "**", value) for key, value in zip(node.keys, node.values)]
    return [("", item) for item in node.elts] if isinstance(node, ast.List | ast.Tuple) else []


def _brackets(node: ast.expr) -> tuple[str, str]:
    if isinstance(node, ast.Call):
        return f"{_flat(node.func)}(", ")"
    return ("{", "}") if isinstance(node, ast.Dict) else ("[", "]") if isinstance(node, ast.List) else ("(", ")")


def _flat(node: ast.AST) -> str:
    """A tree in one line."""
    return ast.unparse(_Quoted().visit(deepcopy(node)))


class _Quoted(ast.NodeTransformer):
    """Puts strings into double quotes, as names that are written verbatim."""

    def visit_Constant(self, node: ast.Constant) -> ast.expr:
        return ast.Name(f'"{"".join(map(_escaped, node.value))}"') if isinstance(node.value, str) else node

    def visit_JoinedStr(self, node: ast.JoinedStr) -> ast.expr:
        return ast.Name(f'f"{ast.unparse(node)[2:-1]}"')


def _escaped(letter: str) -> str:
    """A letter of a string as Python writes it."""
    if letter in '"\\':
        return f"\\{letter}"
    return letter if letter.isprintable() else letter.encode("unicode_escape").decode("ascii")
