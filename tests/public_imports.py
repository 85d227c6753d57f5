"""Which names of the package a script imports or uses that are not public."""

import ast
from types import ModuleType

import bspline_mdao

SPACES = {name for name in bspline_mdao.__all__ if isinstance(getattr(bspline_mdao, name), ModuleType)}


def public(space: str) -> set[str]:
    """Names of a namespace; those at the top for the empty one, and all that its module lists for others."""
    if space == "names":
        return {name for name in vars(__import__("bspline_mdao.names").names) if name.isupper()}
    return set(getattr(bspline_mdao, space).__all__ if space else bspline_mdao.__all__)


def hidden_names(source: str) -> list[str]:
    """Dotted names of the package in a script that are no public ones, be they imported or looked up."""
    nodes = list(ast.walk(ast.parse(source)))
    used = [
        f"{node.module}.{alias.name}"
        for node in nodes
        if isinstance(node, ast.ImportFrom) and node.module and node.module.partition(".")[0] == "bspline_mdao"
        for alias in node.names
    ]
    plain = [alias for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    plain = [alias for alias in plain if alias.name.partition(".")[0] == "bspline_mdao"]
    used += [alias.name for alias in plain if alias.name != "bspline_mdao"]
    short = {alias.asname or alias.name for alias in plain if alias.name == "bspline_mdao"}
    for node in nodes:
        inner = getattr(node, "value", None)
        if not isinstance(node, ast.Attribute):
            continue
        if isinstance(inner, ast.Name) and inner.id in short:
            used.append(f"bspline_mdao.{node.attr}")
        elif isinstance(inner, ast.Attribute) and isinstance(inner.value, ast.Name) and inner.value.id in short:
            used += [f"bspline_mdao.{inner.attr}.{node.attr}"] if inner.attr in SPACES else []
    return sorted({name for name in used if not is_public(name.split(".")[1:])})


def is_public(parts: list[str]) -> bool:
    """Whether a name behind that of the package is public."""
    *space, name = parts
    if space:
        return len(space) == 1 and (space[0] in SPACES or space[0] == "names") and name in public(space[0])
    return name in SPACES or name == "names" or name in public("")
