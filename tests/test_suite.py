"""The suite and the package check themselves: nothing is left untested, imported too early or compiled twice."""

import ast
import importlib
import inspect
import os
import pkgutil
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path
from types import ModuleType

import pytest

import bspline_mdao

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "bspline_mdao"
FRAMEWORKS = ("core.om", "flow.om", "studio", "testing", "__main__")
MODULES = [module.name for module in pkgutil.walk_packages(bspline_mdao.__path__, "bspline_mdao.")]


def is_kernel(name: str) -> bool:
    """Whether a module is to know nothing of the frameworks."""
    return not f"{name}.".startswith(tuple(f"bspline_mdao.{place}." for place in FRAMEWORKS))


KERNELS = [name for name in MODULES if is_kernel(name)]


def python(code: str) -> str:
    """Run code in a fresh process and return what it prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.slow
def test_kernels_never_import_the_framework():
    assert len(KERNELS) > 20
    loads = "; ".join(f"import {name}; check({name!r})" for name in KERNELS)
    code = (
        "import sys\n"
        "def check(name):\n"
        "    found = {'openmdao', 'mphys', 'click', 'rich', 'matplotlib'} & set(sys.modules)\n"
        "    assert not found, f'{name} imports {found}'\n" + loads
    )
    python(code)


def test_importing_the_package_and_its_namespaces_loads_nothing_heavy():
    heavy = ("numpy", "scipy", "numba", "openmdao", "h5py", "matplotlib", "click", "rich")
    spaces = ", ".join(f"bspline_mdao.{name}" for name in SPACES)
    code = f"import sys, {spaces}; print(sorted(set(sys.modules) & set({heavy!r})))"
    assert python(code) == "[]"


def test_help_of_the_command_line_loads_nothing_heavy():
    heavy = ("numpy", "scipy", "numba", "openmdao", "h5py", "matplotlib")
    code = (
        "import sys; from bspline_mdao.studio.cli.main import run; assert run(['fit', '--help']) == 0; "
        f"print(sorted(set(sys.modules) & set({heavy!r})))"
    )
    assert python(code).splitlines()[-1] == "[]"


SPACES = [name for name in bspline_mdao.__all__ if isinstance(getattr(bspline_mdao, name), ModuleType)]
"""Namespaces of public names."""


@pytest.mark.parametrize("space", ["", *SPACES])
def test_every_public_name_can_be_imported(space):
    module = getattr(bspline_mdao, space) if space else bspline_mdao
    assert importlib.import_module(f"bspline_mdao.{space}".rstrip(".")) is module
    assert set(module.__all__) <= set(dir(module))
    for name in module.__all__:
        thing = getattr(module, name)
        assert name in SPACES or not callable(thing) or thing.__name__ == name
    with pytest.raises(AttributeError, match="nothing"):
        module.nothing  # noqa: B018


FRAMEWORKS = {"jax", "torch"}
"""Namespaces of one function for each framework: they have the names of each other."""


def test_every_public_name_has_one_home():
    spaces = [name for name in SPACES if name not in FRAMEWORKS]
    found = [(name, id(thing)) for space in [bspline_mdao, *(getattr(bspline_mdao, name) for name in spaces)]
             for name in space.__all__ if callable(thing := getattr(space, name))]  # fmt: skip
    names, things = zip(*found)
    assert len(names) > 200
    assert len(names) == len(set(names)) == len(set(things))  # and so links find them by their names alone


def test_what_a_user_meets_first_is_a_short_list():
    assert len(bspline_mdao.__all__) <= 60  # the rest is in namespaces


def called(node: ast.AST, *names: str) -> bool:
    """Whether a node is a call of a function or method of one of some names."""
    if not isinstance(node, ast.Call):
        return False
    return (node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")) in names


def loaded(node: ast.AST, values: dict[str, set[str]]) -> set[str]:
    """Run scripts that an expression stands for: ``script("name")``, or a variable that holds one."""
    if called(node, "script", "import_module") and node.args:
        argument = node.args[0]
        return values.get(argument.id, set()) if isinstance(argument, ast.Name) else {getattr(argument, "value", "")}
    return values.get(node.id, set()) if isinstance(node, ast.Name) else set()


def run_scripts_of(test: ast.FunctionDef) -> tuple[set[str], set[str]]:
    """Run scripts that a test loads, and those whose ``main`` it calls."""
    values = {}
    for decorator in test.decorator_list:
        if called(decorator, "parametrize"):
            words = {n.value for n in ast.walk(decorator.args[1]) if isinstance(n, ast.Constant)}
            values |= {name.strip(): words for name in str(getattr(decorator.args[0], "value", "")).split(",")}
    for node in ast.walk(test):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                pairs = zip(target.elts, getattr(node.value, "elts", ())) if isinstance(target, ast.Tuple) else ()
                for name, value in [*pairs, (target, node.value)]:
                    if isinstance(name, ast.Name):
                        values[name.id] = loaded(value, values)
    calls = [node for node in ast.walk(test) if isinstance(node, ast.Call)]
    run = [loaded(node.func.value, values) for node in calls if called(node, "main") and hasattr(node.func, "value")]
    return set().union(*(loaded(node, values) for node in calls)), set().union(*run)


def imports(path: Path) -> set[str]:
    """Modules that a file imports by name."""
    nodes = list(ast.walk(ast.parse(path.read_text())))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return plain | {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module}


def not_run(tests: list[str], scripts: dict[str, Path]) -> list[str]:
    """Run scripts that no test runs: those with a ``main`` that is not called, others that nothing loads or imports."""
    loading = [source for source in tests if re.search(r"\b(script|import_module)\(", source)]
    functions = [n for source in loading for n in ast.walk(ast.parse(source)) if isinstance(n, ast.FunctionDef)]
    by_test, run = (set().union(*found) for found in zip(*map(run_scripts_of, functions)))
    used = by_test.union(*map(imports, scripts.values()))
    has_main = {name for name, path in scripts.items() if re.search(r"^def main\(", path.read_text(), re.M)}
    return sorted((has_main - run) | (set(scripts) - has_main - used))


@pytest.mark.slow
def test_every_run_script_is_run_by_a_test():
    tests = [path.read_text() for path in ROOT.glob("tests/**/test_*.py")]
    scripts = {path.stem: path for path in ROOT.glob("run_scripts/*.py")}
    assert len(scripts) >= 25
    assert not_run(tests, scripts) == []


def test_a_run_script_that_is_merely_mentioned_counts_as_not_run(tmp_path):
    """Be its name an ordinary word, in a comment, a string or another call."""
    names = ("history", "totals", "scenes", "drawn", "common")
    scripts = {name: tmp_path / f"{name}.py" for name in names}
    for name, path in scripts.items():
        path.write_text("def main(quick=False):\n    return 1\n" if name != "common" else "SIZE = 1\n")
    mentions = "def test_history(script):\n    totals = 'scenes'  # drawn\n    assert script(totals) or common(1)\n"
    assert not_run([mentions], scripts) == sorted(names)
    loads = "def test_it(script):\n    x, y = script('history'), script('scenes')\n    x.main()\n    script('drawn')\n"
    assert not_run([mentions, loads], scripts) == ["common", "drawn", "scenes", "totals"]
    listed = "@pytest.mark.parametrize('name, n', [('totals', 1), ('drawn', 2)])\n"
    listed += "def test_all(script, name, n):\n    script(name).main(n)\n"
    scripts["scenes"].write_text("from common import SIZE\n")
    assert not_run([mentions, loads, listed], scripts) == []


def kinds(folder: str, *members: str) -> set[type]:
    """Classes of a folder that users make objects of, told by the members that they have."""
    modules = [importlib.import_module(name) for name in MODULES if name.startswith(f"bspline_mdao.{folder}.")]
    assert modules, folder
    found = {value for module in modules for value in vars(module).values() if isinstance(value, type)}
    return {
        kind
        for kind in found
        if all(member in dir(kind) or member in getattr(kind, "__dataclass_fields__", ()) for member in members)
        and not (inspect.isabstract(kind) or getattr(kind, "_is_protocol", False) or kind.__name__.startswith("_"))
    }


def test_every_variable_constraint_and_measure_is_in_a_table_of_derivative_tests():
    import geometry_cases
    import parametrization_cases
    from geometry_cases import MEASURES
    from parametrization_cases import CONSTRAINTS, VARIABLES

    from bspline_mdao.core.design.interior_points import InteriorPoints
    from bspline_mdao.core.design.junction import Junction
    from bspline_mdao.core.design.rotation import HingePoints

    # These bind to a model, to parts of a surface, or move none of it by themselves: test_interior_points.py,
    # test_junction.py and test_hinges.py in tests/core/design.
    inside = {InteriorPoints, Junction, HingePoints}
    assert kinds("core.design", "bind") == set(VARIABLES) | set(parametrization_cases.OF_SECTIONS) | inside
    assert kinds("core.design", "equations") == set(CONSTRAINTS)
    assert kinds("core.measures", "surface", "evaluate", "partials") == set(MEASURES) | set(geometry_cases.OF_SECTIONS)


@pytest.mark.slow
def test_doctests_are_collected():
    folder = "bspline_mdao/grids/cells"  # the whole package takes longer to import than all else here
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "--collect-only", "-q", "--doctest-modules", folder],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=ROOT,
    )
    assert done.stdout.count("::bspline_mdao.") > 5, done.stdout


@pytest.mark.slow
def test_the_suite_leaves_nothing_in_the_temporary_folder(tmp_path):
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "tests/test_suite.py",
            "-k",
            "readme_is_one_screen",
        ],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=ROOT,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    )
    assert "1 passed" in done.stdout, done.stdout
    assert list(tmp_path.iterdir()) == []


def test_doctests_are_part_of_the_ordinary_run(pytestconfig):
    assert pytestconfig.getoption("--doctest-modules")
    assert "bspline_mdao" in pytestconfig.getini("testpaths")


@pytest.mark.slow
def test_a_second_process_compiles_no_kernel_again():
    code = """
import sys
from numba.core.dispatcher import Dispatcher
sys.path.insert(0, "tests")
from component_cases import small_model
import numpy as np
model = small_model(corrections=1)
evaluator = model.evaluator()
evaluator.adjoint(evaluator.forward(model.control_points))
dispatchers = {id(d): d for m in list(sys.modules.values()) if getattr(m, "__name__", "").startswith("bspline_mdao")
               for d in vars(m).values() if isinstance(d, Dispatcher)}
misses = {d.__qualname__: dict(d.stats.cache_misses) for d in dispatchers.values() if d.stats.cache_misses}
print(len(dispatchers), sum(len(d.stats.cache_hits) for d in dispatchers.values()), misses)
"""
    n_kernels, hits, misses = python(code).split(maxsplit=2)
    if misses != "{}":  # nobody has compiled them before
        n_kernels, hits, misses = python(code).split(maxsplit=2)
    assert int(n_kernels) > 10
    assert int(hits) > 5
    assert misses == "{}"


def test_kernels_are_restored_for_the_sources_that_they_were_compiled_from_alone(tmp_path):
    sources = {
        "__init__.py": "",
        "kernel.py": "from numba import njit\nfrom .constants import TWO",
        "constants.py": "TWO = 2",
        "other.py": "from numba import njit",
        "rest.py": "",
    }
    program, package, kept = tmp_path / ".ci" / "kernels", tmp_path / "bspline_mdao", tmp_path / "kept"
    compiled = {f"{name}.product-7.py312{end}" for name in ("kernel", "other") for end in (".nbi", ".1.nbc")}
    for path in (program, *(package / "__pycache__" / name for name in compiled)):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("compiled")
    shutil.copy(ROOT / ".ci" / "kernels", program)
    (tmp_path / "docs").mkdir()
    shutil.copy(ROOT / "docs" / "make_map.py", tmp_path / "docs")
    for name, text in sources.items():
        (package / name).write_text(text)

    def save():
        subprocess.run([sys.executable, program, "save", kept], check=True)

    def restored():
        shutil.rmtree(package / "__pycache__", ignore_errors=True)
        subprocess.run([sys.executable, program, "restore", kept], check=True)
        return {path.name for path in (package / "__pycache__").glob("*")}

    save()
    (package / "rest.py").write_text("changed")
    assert restored() == compiled
    (package / "constants.py").write_text("TWO = 3")  # numba itself would not know
    assert restored() == {name for name in compiled if name.startswith("other")}
    for number in range(4):  # the latest three are kept
        (package / "constants.py").write_text(f"TWO = {number}")
        (package / "__pycache__" / "kernel.product-7.py312.nbi").write_text("compiled")
        save()
    assert len(list((kept / "kernel.py").iterdir())) == 3
    assert len(list((kept / "other.py").iterdir())) == 1
    assert len(restored()) == 3


@pytest.mark.slow
def test_the_example_in_27_lines_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = (ROOT / "docs" / "in_python.rst").read_text()
    blocks = r"^\.\. code-block:: {}\n\n((?:   .*\n|\n)+)"
    example, table = (textwrap.dedent(*re.findall(blocks.format(kind), page, re.M)) for kind in ("python", "text"))
    assert len(example.strip().splitlines()) <= 27
    contents = {}
    exec(example, contents)
    assert contents["problem"].get_val("grid").shape == (3 * contents["model"].n_nodes,)
    printed = capsys.readouterr().out.strip().splitlines()[-4:]
    numbers = [[float(n) for n in re.findall(r"-?\d+\.\d*", line)] for line in (*printed, *table.strip().splitlines())]
    for new, shown in zip(numbers[:4], numbers[4:], strict=True):
        assert new == pytest.approx(shown, rel=0.02, abs=1e-4)
    assert {"optimum.xyz", "optimum.png"} <= {path.name for path in tmp_path.iterdir()}


def test_the_list_of_commands_is_complete_and_those_of_the_readme_are_in_it():
    from bspline_mdao.studio.cli.commands import bspline_mdao as program

    page, readme = ((ROOT / name).read_text() for name in ("docs/command_line.rst", "README.md"))
    (listed,) = re.findall(r"code-block:: text\n\n((?:   bspline-mdao .*\n)+)", page)
    assert {line.split()[1] for line in listed.splitlines()} == set(program.commands)
    assert set(re.findall(r"bspline-mdao ([\w-]+)", readme)) <= set(program.commands)


def test_the_readme_is_one_screen_and_its_links_lead_somewhere():
    readme = (ROOT / "README.md").read_text()
    assert len(readme.split()) <= 400
    for target in re.findall(r"\]\((?!http)([^)]+)\)", readme):
        assert (ROOT / target).exists(), target


def test_the_airfoil_of_the_readme_is_that_of_its_page():
    readme, page = ((ROOT / name).read_text() for name in ("README.md", "docs/howto/airfoil.rst"))
    commands = re.findall(r"^(bspline-mdao .*foil\.h5.*|bspline-mdao optimize .*?) *(?:#.*)?$", readme, re.M)
    assert len(commands) == 3
    for command in commands:
        assert command.split("#")[0].strip() in page


def test_examples_of_docstrings_leave_no_file_where_they_run():
    written = re.compile(r"^ *(?:>>>|\.\.\.) .*\b(?:open|save\w*|write\w*)\(\"[\w.]+\"(?!.*\+SKIP).*$", re.M)
    modules = sorted((ROOT / "bspline_mdao").rglob("*.py"))
    assert [(module.name, line) for module in modules for line in written.findall(module.read_text())] == []


def test_no_two_files_of_tests_have_one_name():
    names = [path.name for path in Path(__file__).parent.rglob("test_*.py")]
    assert [name for name in set(names) if names.count(name) > 1] == []  # pytest would not collect the second


def is_compiled(function: ast.FunctionDef) -> bool:
    """Whether a function is a kernel, or one of those that tell numba what to compile."""
    words = {name for decorator in function.decorator_list for name in re.findall(r"\w+", ast.unparse(decorator))}
    return not words.isdisjoint({"njit", "intrinsic", "overload", "vectorize", "guvectorize"})


def unannotated(tree: ast.AST) -> list[str]:
    """Functions of a module, other than kernels, that leave out an annotation of an argument or of the result."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and not is_compiled(node):
            names = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
            given = [name for name in names if name and name.arg not in ("self", "cls")]
            is_known = node.returns is not None or (node.name == "__init__" and given)
            if not is_known or any(name.annotation is None for name in given):
                found.append(node.name)
    return found


@pytest.mark.slow
def test_functions_that_are_no_kernels_are_annotated():
    found = {str(path.relative_to(ROOT)): unannotated(ast.parse(path.read_text())) for path in PACKAGE.rglob("*.py")}
    assert {name: functions for name, functions in found.items() if functions} == {}


def test_functions_that_leave_out_an_annotation_are_found():
    source = """
@njit(cache=True)
def kernel(x, y): ...
class Part:
    def __init__(self, a: int): ...
    def whole(self, *, b: int = 1) -> int: ...
    @staticmethod
    def bare(c) -> int: ...
    def rest(self, *d, e: int) -> int:
        def inner(): ...
def nothing() -> None: ...
"""
    assert sorted(unannotated(ast.parse(source))) == ["bare", "inner", "rest"]


def internal_docstring_lines(tree: ast.AST, public: set[str], is_of_public: bool = False) -> int:
    """Lines of docstrings of functions and classes that are neither public names nor public methods of them."""
    n = 0
    for node in ast.iter_child_nodes(tree):
        is_public = is_of_public
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            is_public = node.name in public
            if not (is_public or (is_of_public and not node.name.startswith("_"))) and ast.get_docstring(node):
                n += node.body[0].end_lineno - node.body[0].lineno + 1
            is_public &= isinstance(node, ast.ClassDef)
        n += internal_docstring_lines(node, public, is_public)
    return n


@pytest.mark.slow
def test_docstrings_of_internals_are_short():
    public = {
        name for space in ["", *SPACES] for name in importlib.import_module(f"bspline_mdao.{space}".rstrip(".")).__all__
    }
    assert sum(internal_docstring_lines(ast.parse(path.read_text()), public) for path in PACKAGE.rglob("*.py")) <= 9_000


def test_lines_of_internal_docstrings_are_counted():
    source = '''
class Public:
    """A class.

    With more of it.
    """

    def method(self):
        """A method."""

        def inner():
            """Two
            lines."""

    def _hidden(self):
        """One line."""

class Internal:
    """One line."""

    def method(self):
        """One line."""
'''
    assert internal_docstring_lines(ast.parse(source), {"Public"}) == 5
    assert internal_docstring_lines(ast.parse(source), set()) == 10
