"""Run scripts can be copied: they import nothing of their folder, state one problem each, and say what they cost."""

import ast
import io
import re
import tokenize
from pathlib import Path

import pytest
from public_imports import hidden_names

SCRIPTS = sorted(Path(__file__).parents[2].glob("run_scripts/*.py"))
ALLOWED = {"bspline_mdao", "openmdao", "mphys", "numpy", "matplotlib", "scipy", "threadpoolctl", "gmsh"} | {
    *("adflow", "baseclasses", "jax", "smt", "torch"),
}
STANDARD = {"__future__", "csv", "functools", "itertools", "os", "pathlib", "re", "tempfile", "time", "typing"} | {
    *("collections.abc", "dataclasses", "importlib.util", "shutil", "warnings"),
}
LONGEST = 125
"""Lines of code that a script may have: those with more than a comment, an import or a part of a docstring."""

TABLES, LONGEST_TABLE = {"robustness_table", "viscous_grids", "viscous_moves"}, 185
"""Those that state no problem but compare ways to move many grids."""

TOTALS_ALONE = {"euler_aerostructural"}
"""Those that differentiate an objective, and run no driver."""

OPTIMISATIONS = [p for p in SCRIPTS if "add_objective(" in p.read_text() and p.stem not in TOTALS_ALONE]

scripts = pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)


def docstring_lines(tree: ast.AST) -> set[int]:
    """Lines of texts that stand for themselves: docstrings, also those of constants."""
    texts = [n for n in ast.walk(tree) if isinstance(n, ast.Expr) and isinstance(n.value, ast.Constant)]
    return {line for text in texts for line in range(text.lineno, text.end_lineno + 1)}


def import_lines(tree: ast.Module) -> set[int]:
    """Lines that only say where names are from."""
    imports = [node for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
    return {line for node in imports for line in range(node.lineno, node.end_lineno + 1)}


def code_lines(source: str) -> int:
    skipped = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    lines = {n for t in tokens if t.type not in skipped for n in range(t.start[0], t.end[0] + 1)}
    tree = ast.parse(source)
    return len(lines - docstring_lines(tree) - import_lines(tree))


@scripts
def test_a_run_script_imports_what_users_have_and_no_other_script(path):
    nodes = list(ast.walk(ast.parse(path.read_text())))
    names = [alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names]
    names += [f"{'.' * node.level}{node.module}" for node in nodes if isinstance(node, ast.ImportFrom)]
    assert {name for name in names if name not in STANDARD and name.split(".")[0] not in ALLOWED} == set()


@scripts
def test_a_run_script_imports_public_names_alone(path):
    assert hidden_names(path.read_text()) == []


@pytest.mark.parametrize("path", OPTIMISATIONS, ids=lambda path: path.stem)
def test_an_optimisation_shows_its_driver_and_where_it_runs(path):
    text = path.read_text()
    assert "problem.driver = " in text
    assert "problem.run_driver()" in text


@scripts
def test_a_run_script_is_short(path):
    assert code_lines(path.read_text()) <= (LONGEST_TABLE if path.stem in TABLES else LONGEST)


@scripts
def test_a_run_script_says_what_it_takes_and_what_its_output_is(path):
    text = " ".join(ast.get_docstring(ast.parse(path.read_text())).split())
    assert re.search(r"[Ii]t takes .*(second|minute|hour)", text)
    assert "The output" in text


@scripts
def test_the_first_line_of_a_run_script_is_a_title_that_fits_a_thumbnail(path):
    title, _, _ = ast.get_docstring(ast.parse(path.read_text())).partition("\n\n")
    assert "\n" not in title
    assert len(title) <= 50


def test_docstrings_comments_imports_and_blank_lines_are_no_code():
    source = "import os\nfrom a import (\n    b,\n)\n"
    source += (
        '"""A\n\nB."""\n\nX = 1\n"""One."""\n\n\ndef f():  # why\n    """F."""\n    # reason\n    return """a\nb"""\n'
    )
    assert code_lines(source) == 4
