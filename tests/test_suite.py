"""The suite and the package check themselves: nothing is left untested, imported too early or compiled twice."""

import importlib
import inspect
import os
import pkgutil
import re
import subprocess
import sys
from pathlib import Path

import pytest

import bspline_mdao

ROOT = Path(__file__).parents[1]
FRAMEWORKS = ("components", "cli", "drivers", "flow", "mphys")
MODULES = [module.name for module in pkgutil.walk_packages(bspline_mdao.__path__, "bspline_mdao.")]
FLOWS = ("aerostructure", "euler_f", "euler_state", "lattice_", "vortex_lattice", "wake_forces")
"""How the names of components in the folder of flows begin; its other modules are kernels."""


def is_kernel(name: str) -> bool:
    """Whether a module is to know nothing of the frameworks."""
    _, folder, *rest = name.split(".")
    return folder not in FRAMEWORKS or (folder == "flow" and bool(rest) and not rest[0].startswith(FLOWS))


KERNELS = [name for name in MODULES if is_kernel(name)]


def python(code: str) -> str:
    """Run code in a fresh process and return what it prints."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


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


def test_kernels_name_the_framework_nowhere():
    for name in KERNELS:
        path = ROOT.joinpath(*name.split("."))
        source = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text()
        folders = "components|cli|drivers|flow|mphys"
        assert not re.search(rf"^\s*(import|from) (openmdao|\.+({folders})\b)", source, re.M), name


def test_importing_the_package_loads_nothing_heavy():
    heavy = ("numpy", "scipy", "numba", "openmdao", "h5py", "matplotlib", "click", "rich")
    code = f"import sys, bspline_mdao; print(sorted(set(sys.modules) & set({heavy!r})))"
    assert python(code) == "[]"


def test_help_of_the_command_line_loads_nothing_heavy():
    heavy = ("numpy", "scipy", "numba", "openmdao", "h5py", "matplotlib")
    code = (
        "import sys; from bspline_mdao.cli.main import run; assert run(['fit', '--help']) == 0; "
        f"print(sorted(set(sys.modules) & set({heavy!r})))"
    )
    assert python(code).splitlines()[-1] == "[]"


def test_every_public_name_can_be_imported():
    for name in bspline_mdao.__all__:
        assert getattr(bspline_mdao, name).__name__ == name
    assert set(bspline_mdao.__all__) <= set(dir(bspline_mdao))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        bspline_mdao.nothing  # noqa: B018


def test_every_run_script_is_run_by_a_test():
    tests = "\n".join(path.read_text() for path in ROOT.glob("tests/test_*.py") if path.name != Path(__file__).name)
    scripts = [path.stem for path in ROOT.glob("run_scripts/*.py") if path.stem != "common"]
    assert len(scripts) >= 4
    assert [name for name in scripts if name not in tests] == []


def kinds(folder: str, *members: str) -> set[type]:
    """Classes of a folder that users make objects of, told by the members that they have."""
    modules = [importlib.import_module(name) for name in MODULES if name.startswith(f"bspline_mdao.{folder}.")]
    found = {value for module in modules for value in vars(module).values() if isinstance(value, type)}
    return {
        kind
        for kind in found
        if all(member in dir(kind) or member in getattr(kind, "__dataclass_fields__", ()) for member in members)
        and not (inspect.isabstract(kind) or getattr(kind, "_is_protocol", False) or kind.__name__.startswith("_"))
    }


def test_every_variable_constraint_and_measure_is_in_a_table_of_derivative_tests():
    from geometry_cases import MEASURES
    from parametrization_cases import CONSTRAINTS, VARIABLES

    assert kinds("parametrization", "bind") == set(VARIABLES)
    assert kinds("parametrization", "equations") == set(CONSTRAINTS)
    assert kinds("geometry", "surface", "evaluate", "partials") == set(MEASURES)


def test_doctests_are_collected():
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "--collect-only", "-q", "--doctest-modules", "bspline_mdao"],
        capture_output=True,
        text=True,
        timeout=300,
        cwd=ROOT,
    )
    assert done.stdout.count("::bspline_mdao.") > 5, done.stdout


def test_the_suite_leaves_nothing_in_the_temporary_folder(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests/test_suite.py", "-k", "openmdao_lists"],
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
    python(code)
    n_kernels, hits, misses = python(code).split(maxsplit=2)
    assert int(n_kernels) > 10
    assert int(hits) > 5
    assert misses == "{}"


def test_the_example_of_the_readme_runs():
    (example,) = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)
    assert len(example.strip().splitlines()) <= 18
    contents = {}
    exec(example, contents)
    assert contents["problem"].get_val("grid").shape == (3 * contents["model"].n_nodes,)


def test_the_commands_of_the_readme_exist():
    from bspline_mdao.cli.commands import bspline_mdao as program

    used = set(re.findall(r"`?bspline-mdao (\w+)", (ROOT / "README.md").read_text()))
    assert used == set(program.commands)


def ours(group: str) -> set[str]:
    """What the package offers to OpenMDAO under the name of a group of entry points."""
    from importlib.metadata import entry_points

    return {entry.value for entry in entry_points(group=group) if entry.value.startswith("bspline_mdao")}


def test_openmdao_lists_the_components():
    assert ours("openmdao_component") == {
        "bspline_mdao.components.control_mesh_move:ControlMeshMove",
        "bspline_mdao.components.fit:Fit",
        "bspline_mdao.components.grid_evaluate:GridEvaluate",
        "bspline_mdao.components.live_grid_evaluate:LiveGridEvaluate",
        "bspline_mdao.components.monotonic:Monotonic",
        "bspline_mdao.components.quality:Quality",
        "bspline_mdao.components.surface_control:SurfaceControl",
        "bspline_mdao.components.surface_evaluate:SurfaceEvaluate",
        "bspline_mdao.components.surface_measure:SurfaceMeasure",
    }
    assert ours("openmdao_group") == {
        "bspline_mdao.components.grid_movement:GridMovement",
        "bspline_mdao.flow.euler_flow:EulerFlow",
        "bspline_mdao.flow.lattice_flow:LatticeFlow",
        "bspline_mdao.flow.vortex_lattice:VortexLattice",
    }
    assert ours("openmdao_driver") == {"bspline_mdao.drivers.nlopt_driver:NLoptDriver"}
