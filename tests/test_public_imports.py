"""What users copy from pages and notebooks imports public names alone."""

import ast
import json
import re
import textwrap
from pathlib import Path

import pytest
from public_imports import hidden_names

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def code_of(page: Path) -> list[str]:
    """Python of a page, block by block."""
    text = page.read_text()
    if page.suffix == ".py":
        return [text]
    if page.suffix == ".ipynb":
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "code"]
        return ["".join(line for line in cell["source"] if not line.startswith("%")) for cell in cells]
    blocks = re.findall(r"^\.\. code-block:: python\n(?:   :.*\n)*\n((?:   .*\n|\n)+)", text, re.M)
    return [textwrap.dedent(block) for block in blocks]


PAGES = [page for page in sorted(DOCS.rglob("*.rst")) if code_of(page)]
PAGES += [*sorted((DOCS / "tutorial").glob("*.py")), *sorted((DOCS / "notebooks").glob("*.ipynb"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_imports_public_names_alone(page):
    code = "\n".join(code_of(page))
    assert ast.parse(code).body
    assert hidden_names(code) == []


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("import bspline_mdao as bm\nbm.fit_grid(bm.design.Twist, bm.grids.Block)", []),
        ("from bspline_mdao.names import GRID\nfrom bspline_mdao import design, fit_grid", []),
        (
            "import bspline_mdao as bm\nbm.Twist, bm.design.fit_grid",
            ["bspline_mdao.Twist", "bspline_mdao.design.fit_grid"],
        ),
        ("from bspline_mdao.core.fit.fitting import fit_grid", ["bspline_mdao.core.fit.fitting.fit_grid"]),
        ("import bspline_mdao.core.fit", ["bspline_mdao.core.fit"]),
        ("from bspline_mdao.grids import cells", ["bspline_mdao.grids.cells"]),
        ("from bspline_mdao import core", ["bspline_mdao.core"]),
    ],
)
def test_names_that_are_not_public_are_found(code, found):
    assert hidden_names(code) == found
