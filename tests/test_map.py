"""The page "Where things are" says what is so, and imports between folders and files go one way."""

import ast
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "map.rst"
sys.path.insert(0, str(ROOT / "docs"))

from make_map import (  # noqa: E402
    PICTURE,
    arrows_between,
    circles,
    file_arrows,
    floors,
    folder,
    layer,
    layers,
    modules,
    picture,
    reduced,
)

FRAMEWORKS = {
    "openmdao",
    "mphys",
    "openaerostruct",
    "nlopt",
    "click",
    "rich",
    "matplotlib",
    "pyvista",
    "plotly",
    "jinja2",
}
"""What kernels know nothing of."""

ABOVE = {"core/om", "flow/om", "studio", "testing", "__main__"}
"""Folders and layers that may know them."""

LAYERS = ["base", "grids", "core", "flow", "testing", "studio"]
"""From below: each imports from those before it alone."""


def rows() -> list[tuple[str, list[int], list[str], list[str]]]:
    """Rows of the tables of the page: subject, equations, files, and names that are to be found in the first file."""
    found = []
    for entry in re.split(r"^   \* - ", PAGE.read_text(), flags=re.M)[1:]:
        row = entry.split("\n\n")[0]
        cells = [re.sub(r"\s+", " ", cell).strip() for cell in re.split(r"^     - ", row, flags=re.M)]
        if len(cells) == 3 and "``bspline_mdao/" in cells[1]:
            equations = [int(n) for n in re.findall(r"Eq\. \((\d)\)", cells[0])]
            files = re.findall(r"``(bspline_mdao/[\w/]+\.pyi?)``", cells[1])
            names = re.findall(r"``([A-Za-z_]\w*(?:\.\w+)*)``", cells[2])
            found.append((cells[0], equations, files, names))
    return found


ROWS = rows()


def defined(path: Path) -> set[str]:
    """Names that a file defines at its top level, and members of its classes as ``Class.member``."""
    names = set()
    for node in ast.parse(path.read_text()).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", node)]
        for target in targets:
            name = getattr(target, "name", getattr(target, "id", None))
            names |= {name} if name else set()
        if isinstance(node, ast.ClassDef):
            names |= {f"{node.name}.{item.name}" for item in node.body if isinstance(item, ast.FunctionDef)}
    return names


@pytest.mark.parametrize(("subject", "equations", "files", "names"), ROWS, ids=[row[0][:40] for row in ROWS])
def test_the_files_and_names_of_the_map_exist(subject, equations, files, names):
    assert files, f"{subject}: no file"
    assert names, f"{subject}: no name to look for"
    for file in files:
        assert (ROOT / file).is_file(), f"{subject}: {file}"
    everything = set().union(*(defined(ROOT / file) for file in files))
    assert set(names) <= everything, f"{subject}: {sorted(set(names) - everything)} in none of {files}"


def test_every_other_file_that_the_page_names_exists():
    named = set(re.findall(r"``([\w./<>]+\.(?:py|pyi|rst|toml)|(?:tests|docs)/\w+)``", PAGE.read_text()))
    named = {name for name in named if "<" not in name}
    assert len(named) > 40
    assert [name for name in named if not (ROOT / name).exists() and not (ROOT / "bspline_mdao" / name).exists()] == []


def named_places(path: Path) -> list[tuple[str, Path]]:
    """Modules and members that docstrings and comments name by dots, and the file or folder that each begins with."""
    found = []
    for name in re.findall(r"(?<!`)`(\.[a-z][\w.]*|bspline_mdao(?:\.[a-z]\w*)+)`(?!`)", path.read_text()):
        start = path.parent if name.startswith(".") else ROOT
        found.append((name, start.joinpath(*name.strip(".").split("."))))
    return found


def defines(path: Path, name: str) -> bool:
    """Whether there is such a file, and the name in it."""
    return path.is_file() and re.search(rf"\b{name}\b", path.read_text()) is not None


def test_modules_that_docstrings_name_exist():
    places = [(path, *place) for path in (ROOT / "bspline_mdao").rglob("*.py") for place in named_places(path)]
    assert len(places) > 100
    public = set((ROOT / "bspline_mdao" / "__init__.pyi").read_text().split())
    missing = [
        f"{path.relative_to(ROOT)}: {name}"
        for path, name, place in places
        if not (place.is_dir() or place.with_suffix(".py").is_file())
        and not any(defines(place.parent.with_suffix(end), place.name) for end in (".py", ".pyi"))
        and not (place.parent == ROOT / "bspline_mdao" and place.name in public)
    ]
    assert missing == []


def test_every_numbered_equation_of_the_paper_is_on_the_map():
    assert {n for _, equations, _, _ in ROWS for n in equations} == set(range(1, 10))


@pytest.mark.parametrize(("subject", "equations", "files", "names"), [row for row in ROWS if row[1]], ids=str)
def test_an_equation_is_cited_in_the_file_where_it_is(subject, equations, files, names):
    text = (ROOT / files[0]).read_text()
    lists = re.findall(r"Eqs?\. (\(\d\)(?:(?:,| and|, and| to) \(\d\))*)", text)
    cited = {int(n) for part in lists for n in re.findall(r"\d", part)}
    assert set(equations) <= cited, files[0]


@pytest.mark.slow
def test_layers_import_from_those_below_them_alone():
    arrows = arrows_between(layer)
    assert layers() == LAYERS
    for n, name in enumerate(LAYERS):
        assert arrows[name] <= {*LAYERS[:n], "errors", "names"}, name
    assert arrows["errors"] | arrows["names"] == set()
    assert arrows["__main__"] == {"studio"}
    assert arrows["testing"] <= {"base", "grids", "core", "errors", "names"}
    assert not any("testing" in targets for targets in arrows.values())


@pytest.mark.slow
def test_imports_between_folders_make_no_circle():
    arrows = arrows_between(folder)
    assert len(arrows) > 25
    assert circles(arrows) == []


@pytest.mark.slow
def test_imports_between_files_make_no_circle():
    assert circles(file_arrows()) == []


def test_circles_are_found():
    arrows = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set()}
    assert circles(arrows) == ["b", "c"]
    assert circles({"a": {"b"}, "b": set()}) == []
    assert floors({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == [["c"], ["b"], ["a"]]
    assert reduced({"a": {"b", "c"}, "b": {"c"}, "c": set()}) == {"a": {"b"}, "b": {"c"}, "c": set()}


@pytest.mark.slow
def test_kernels_import_no_framework():
    def is_above(name: str) -> bool:
        return bool({layer(name), folder(name)} & ABOVE)

    kernels, paths = {name: targets for name, targets in file_arrows().items() if not is_above(name)}, modules()
    assert len(kernels) > 250
    for name, targets in kernels.items():
        assert not any(map(is_above, targets)), f"{name} imports {sorted(filter(is_above, targets))}"
        for node in ast.walk(ast.parse(paths[name].read_text())):
            outside = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            outside += [node.module] if isinstance(node, ast.ImportFrom) and not node.level else []
            found = {module.split(".")[0] for module in outside} & FRAMEWORKS
            assert not found, f"{name} imports {sorted(found)}"


@pytest.mark.slow
def test_the_picture_of_the_folders_is_that_of_the_tree():
    assert PICTURE.read_text() == picture(), "run python docs/make_map.py"


def test_the_map_can_be_found():
    for page in ("README.md", "CONTRIBUTING.md", "docs/index.rst"):
        assert "map" in (ROOT / page).read_text(), page
