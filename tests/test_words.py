"""Names in the code are made of the field's words: those that hid a standard idea do not come back."""

import ast
import re
from collections.abc import Collection, Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "bspline_mdao"

PRIVATE = {
    "tell": "report",
    "tells": "reports",
    "told": "sent, message",
    "held": "fixed, stored, numbering",
    "hold": "fix",
    "holds": "incidence",
    "own": "owned, local",
    "owns": "owned",
    "beside": "adjacent, inner",
    "hover": "stagnate",
    "hovers": "stagnates",
    "hovering": "stagnation",
    "led": "broadcast",
    "fives": "vec5",
    "claims": "work queue",
    "looks": "styles",
    "wording": "text",
    "shown": "listed, drawn",
    "guided": "target",
    "guidance": "target",
    "turning": "rotation, pitching",
    "share": "subdomain, fraction, weight, contribution",
    "shares": "subdomains, fractions, weights, contributions",
}
"""Words that names had of their own, and what the field says."""

PRIVATE_OF_FLOW = {"kink": "irregular face, sensor", "kinks": "irregular faces", "kinked": "irregular"}
"""Words that are terms of the surface's smoothness, and nothing in the flow."""

KNOWN = {"hold_outside"}
"""The option ``--hold-outside`` of ``ride``, as users know it."""


def identifiers(tree: ast.Module) -> Iterator[str]:
    """Names that a module gives to functions, classes, arguments, variables and attributes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def words(name: str) -> set[str]:
    """Words of a name in snake case or camel case."""
    return {word.lower() for word in re.split(r"_|(?<=[a-z0-9])(?=[A-Z])", name)}


def private_names(path: Path, private: Collection[str] = PRIVATE) -> list[str]:
    """Names of a module, its own included, that have a private word."""
    names = {path.stem, *identifiers(ast.parse(path.read_text()))} - KNOWN
    return [f"{path.name}: {name}" for name in sorted(names) if words(name) & set(private)]


def test_no_name_has_a_private_word():
    assert [found for path in sorted(PACKAGE.rglob("*.py")) for found in private_names(path)] == []


def test_no_name_of_the_flow_has_a_word_of_the_surface():
    modules = sorted(PACKAGE.glob("flow/**/*.py"))
    assert [found for path in modules for found in private_names(path, PRIVATE_OF_FLOW)] == []


def test_private_words_are_found_in_any_kind_of_name(tmp_path):
    module = tmp_path / "looks.py"
    module.write_text(
        "class HeldNodes:\n    def of(self, own):\n        self.n_own = told = own\n        return Owned\n"
    )
    assert [found.split(": ")[1] for found in private_names(module)] == ["HeldNodes", "looks", "n_own", "own", "told"]
