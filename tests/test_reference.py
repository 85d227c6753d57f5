"""The reference shows exactly what is public, by theme, and its examples run."""

import importlib
import inspect
import re
from dataclasses import fields
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

import bspline_mdao
from bspline_mdao.core.design import planform

DOCS = Path(__file__).parents[1] / "docs"
PAGES = re.findall(r"^   (reference/\w+)$", (DOCS / "api.rst").read_text(), re.M)


def names_of(page):
    """Names in the tables of a page that make pages of their own."""
    tables = re.findall(r"\.\. autosummary::\n   :toctree: names\n   :nosignatures:\n\n((?:   \S+\n?)+)", page)
    return [name for table in tables for name in table.split()]


def thing(name):
    module, _, last = name.rpartition(".")
    return getattr(importlib.import_module(f"bspline_mdao.{module}".rstrip(".")), last)


SHOWN = [name for page in PAGES for name in names_of((DOCS / f"{page}.rst").read_text())]


def test_every_page_of_the_reference_is_listed():
    assert {f"reference/{path.stem}" for path in (DOCS / "reference").glob("*.rst")} == set(PAGES)


def public(space):
    """Public names of the package, or of one of its namespaces, without what is no class or function."""
    module = importlib.import_module(f"bspline_mdao.{space}".rstrip("."))
    return {name: thing for name in module.__all__ if callable(thing := getattr(module, name))}


SPACES = [name for name in bspline_mdao.__all__ if isinstance(getattr(bspline_mdao, name), ModuleType)]


def test_the_reference_shows_every_public_name_once_and_nothing_else():
    assert len(SHOWN) == len(set(SHOWN))
    names = set(public("")) | {f"{space}.{name}" for space in SPACES for name in public(space)}
    assert set(SHOWN) == names, "add new names to the page of docs/reference that they belong to"


@pytest.mark.parametrize("page", PAGES)
def test_every_page_of_the_reference_shows_a_picture(page):
    assert re.search(r"^\.\. (figure|image):: ", (DOCS / f"{page}.rst").read_text(), re.M)


def test_the_reference_says_what_every_namespace_is_for():
    page = (DOCS / "api.rst").read_text()
    assert re.findall(r"^   \* - ``bspline_mdao\.(\w+)``$", page, re.M) == sorted(SPACES)


def test_the_reference_of_pictures_names_what_is_no_class_and_no_function():
    page = (DOCS / "reference" / "plotting.rst").read_text()
    constants = set(bspline_mdao.plotting.__all__) - set(public("plotting"))
    assert constants
    assert all(f"``{name}``" in page for name in constants)


@pytest.mark.parametrize("name", SHOWN)
def test_every_public_name_says_what_it_is(name):
    assert (thing(name).__doc__ or "").strip().splitlines()[0].endswith((".", ":", "`"))


def test_every_public_name_has_an_example_that_runs():
    names = [name for name in SHOWN if not name.startswith(("plotting.", "testing."))]
    docs = {
        name: (thing(name).__doc__ or "") + (getattr(thing(name), "__init__", thing).__doc__ or "") for name in names
    }
    assert {name for name, doc in docs.items() if ">>>" not in doc} == set()


def test_the_variables_that_everyone_uses_are_complete():
    page = (DOCS / "reference" / "planform.rst").read_text()
    for name in planform.__all__:
        kind = getattr(planform, name)
        if not isinstance(kind, type):
            continue
        doc = inspect.getdoc(kind)  # Python 3.13 leaves indents out of docstrings
        assert all(f"\n{field.name} : " in doc for field in fields(kind)), name
        assert ">>>" in doc
        assert f"* - ``{name}``" in page


EXAMPLES = [page for page in PAGES if ".. code-block:: python" in (DOCS / f"{page}.rst").read_text()]


@pytest.mark.slow
@pytest.mark.parametrize("page", EXAMPLES)
def test_the_example_of_a_page_runs(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (code,) = re.findall(r"\.\. code-block:: python\n\n((?:   .*\n|\n)+)", (DOCS / f"{page}.rst").read_text())
    contents = {}
    exec(re.sub(r"^   ", "", code, flags=re.M), contents)
    if page.endswith("planform"):
        assert np.abs(contents["moved"] - contents["wing"].mesh.points[contents["wing"].mesh.surface_ids]).max() > 0.05
    if page.endswith("optimisation"):
        assert max(contents["residual"], contents["violation"]) < 1e-5
    if page.endswith("fit"):
        np.testing.assert_allclose(contents["followed"], contents["probes"], atol=1e-9)


def test_listings_of_modules_lead_to_anchors_that_are_there(monkeypatch):
    monkeypatch.syspath_prepend(DOCS / "_ext")
    mended = importlib.import_module("backlinks").mended
    anchors = {"bm.Quality", "bm.Quality.report", "bm.flow.Wake"}
    back = '<a class="viewcode-back" href="../names/{}">'.format
    for found, lead_to in {
        "bm.Quality.html#bm.core.om.Quality.report": "bm.Quality.html#bm.Quality.report",
        "bm.Quality.html#bm.Quality": "bm.Quality.html#bm.Quality",
        "bm.flow.Wake.html#bm.Wake": "bm.flow.Wake.html#bm.flow.Wake",
        "bm.Other.html#bm.core.Other": "bm.Other.html",
    }.items():
        assert mended(f"<b>{back(found)}[docs]</a>", anchors) == f"<b>{back(lead_to)}[docs]</a>"
