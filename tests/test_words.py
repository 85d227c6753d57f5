"""Names in the code are made of the field's words: those that hid a standard idea do not come back."""

import ast
import gc
import re
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "bspline_mdao"

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
    "ridden": "embedded, moved",
    "share": "subdomain, fraction, weight, contribution",
    "shares": "subdomains, fractions, weights, contributions",
}
"""Words that names had of their own, and what the field says."""

PRIVATE_OF_FLOW = {"kink": "irregular face, sensor", "kinks": "irregular faces", "kinked": "irregular"}
"""Words that are terms of the surface's smoothness, and nothing in the flow."""

OF_TEXTS = re.compile(r"\b(tells?|told|hover(?:s|ing|ed)?)\b", re.IGNORECASE)
"""Words of the documentation and of messages that say, report, describe or stagnate says better."""

OF_GUIDES = re.compile(
    r"\b(flown|fl(?:y|ies)|dear(?:er)?|ours?|led on|go(?:es)? along with|hands? out)\b", re.IGNORECASE
)
"""Words of pages for users that engineers do not say: solvers solve, and the package is no "ours"."""

KNOWN = {"hold_outside"}
"""The option ``--hold-outside`` of ``ride``, as users know it."""


@pytest.fixture(scope="module", autouse=True)
def few_trees():
    """Make a million nodes of syntax without the collector, and leave none for it to go through from here on."""
    gc.disable()
    yield
    nodes_of.cache_clear()
    gc.enable()


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    """All nodes of the syntax of a module."""
    return list(ast.walk(ast.parse(path.read_text())))


def identifiers(path: Path) -> Iterator[str]:
    """Names that a module gives to functions, classes, arguments, variables and attributes."""
    for node in nodes_of(path):
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
    names = {path.stem, *identifiers(path)} - KNOWN
    return [f"{path.name}: {name}" for name in sorted(names) if words(name) & set(private)]


def messages(path: Path) -> Iterator[tuple[int, str]]:
    """Lines and texts of all strings but the documentation of code, which of commands is what their help prints."""
    is_help = path.name in ("commands.py", "program.py")
    documentation = {id(node.value) for node in nodes_of(path) if isinstance(node, ast.Expr) and not is_help}
    for node in nodes_of(path):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documentation:
            yield node.lineno, node.value


def private_texts(path: Path) -> list[str]:
    """Places in a page, or in the messages of a module, where a word is the project's own."""
    if path.suffix == ".py":
        texts = messages(path)
    else:
        texts = enumerate(path.read_text().splitlines(), start=1)
    return [f"{path.name}:{line}: {word}" for line, text in texts for word in OF_TEXTS.findall(text)]


def test_no_message_has_a_private_word():
    assert [found for path in sorted(PACKAGE.rglob("*.py")) for found in private_texts(path)] == []


def test_no_page_has_a_private_word():
    written = (page for page in (ROOT / "docs").rglob("*.rst") if "gallery" not in page.parts)  # made by a build
    pages = [*written, ROOT / "README.md", ROOT / "CONTRIBUTING.md"]
    assert [found for path in sorted(pages) for found in private_texts(path)] == []


def pages_for_users() -> list[Path]:
    """The README, the pages below Start and Using it in the index, and the how-tos."""
    docs = ROOT / "docs"
    index = (docs / "index.rst").read_text()
    start, using = (re.findall(rf":caption: {caption}\n   :hidden:\n\n((?:   \S+\n)+)", index)[0].split()
                    for caption in ("Start", "Using it"))  # fmt: skip
    guide = [docs / f"{name}.rst" for name in (*start, *using) if name not in ("gallery/index", "howto/index")]
    return [ROOT / "README.md", *guide, *sorted((docs / "howto").glob("*.rst"))]


def test_no_page_for_users_has_an_odd_verb():
    pages = pages_for_users()
    assert len(pages) > 35
    lines = [
        (page.name, number, line) for page in pages for number, line in enumerate(page.read_text().splitlines(), 1)
    ]
    assert [found for found in lines if OF_GUIDES.search(found[2])] == []


def test_tutorials_guide_and_how_tos_are_below_thirty_thousand_words():
    assert sum(len(page.read_text().split()) for page in pages_for_users()) < 30_000


def test_private_words_are_found_in_messages_and_pages_alone(tmp_path):
    module, page = tmp_path / "module.py", tmp_path / "page.rst"
    module.write_text('"""What it tells."""\n\nraise ValueError(f"{name}: as told before")\n')
    page.write_text("A page\n======\n\nThe file Tells all.\n")
    assert private_texts(module) == ["module.py:3: told"]
    assert private_texts(module.rename(tmp_path / "commands.py")) == ["commands.py:1: tells", "commands.py:3: told"]
    assert private_texts(page) == ["page.rst:4: Tells"]


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
