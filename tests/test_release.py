"""What a release consists of agrees: versions, the changelog, the recipe and the metadata."""

import ast
import re
from pathlib import Path

import tomlkit
import yaml

from bspline_mdao import __version__

ROOT = Path(__file__).parents[1]
PROJECT = tomlkit.parse((ROOT / "pyproject.toml").read_text())["project"]
RECIPE = yaml.safe_load((ROOT / "recipe" / "recipe.yaml").read_text())


def test_the_version_is_the_same_everywhere():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == __version__
    page = (ROOT / "docs" / "citing.rst").read_text()
    assert re.search(rf"version = \{{{__version__}\}},\n\s+year    = \{{{citation['date-released'].year}\}}", page)
    assert RECIPE["context"]["version"] == __version__
    sections = re.findall(r"^## \[(.+?)\]", (ROOT / "docs" / "changelog.md").read_text(), re.M)
    assert sections[:2] == ["Unreleased", __version__]


def test_the_recipe_needs_what_the_package_needs():
    python, *packages = RECIPE["requirements"]["run"]
    assert [package.replace(" ", "") for package in packages] == list(PROJECT["dependencies"])
    assert python == "python >=${{ python_min }}"
    assert PROJECT["requires-python"] == f">={RECIPE['context']['python_min']}"
    (script,) = PROJECT["scripts"].items()
    assert RECIPE["build"]["python"]["entry_points"] == [" = ".join(script)]
    assert RECIPE["about"]["summary"] == PROJECT["description"]


def test_the_hosted_workflow_takes_every_python_that_is_promised():
    workflow = yaml.safe_load((ROOT / ".github" / "workflows" / "ci.yml").read_text())
    matrix = workflow["jobs"]["tests"]["strategy"]["matrix"]
    promised = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", c)]
    assert matrix["python"] == promised
    assert {os.partition("-")[0] for os in matrix["os"]} == {"ubuntu", "macos", "windows"}


def test_every_module_is_written_in_the_oldest_python_that_is_promised():
    oldest = tuple(int(part) for part in PROJECT["requires-python"].removeprefix(">=").split("."))
    for path in (ROOT / "bspline_mdao").rglob("*.py"):
        ast.parse(path.read_text(encoding="utf-8"), filename=str(path), feature_version=oldest)


def test_the_paper_cites_what_its_bibliography_has():
    paper, bibliography = ((ROOT / "paper" / name).read_text(encoding="utf-8") for name in ("paper.md", "paper.bib"))
    assert set(re.findall(r"@(\w+\d{4})", paper)) == set(re.findall(r"^@\w+\{(\w+),", bibliography, re.M))


def test_scripts_that_the_paper_names_exist():
    named = re.findall(r"`((?:benchmarks|run_scripts)/[\w/]+\.py)`", (ROOT / "paper" / "paper.md").read_text())
    assert len(named) >= 2
    assert [name for name in named if not (ROOT / name).exists()] == []
