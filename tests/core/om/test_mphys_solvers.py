"""Stand-ins for ADflow and DAFoam fly with our geometry and grid movement, in both generations of MPhys."""

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

mphys = pytest.importorskip("mphys", reason="MPhys is not installed")

from mphys_cases import DESIGN, FLOW, FUNCTION, Wing, flown, totals  # noqa: E402

from bspline_mdao import InputError  # noqa: E402
from bspline_mdao.base.numerics.processes import ONE  # noqa: E402
from bspline_mdao.core.om.mphys import conventions  # noqa: E402
from bspline_mdao.core.om.mphys.distribution import nodes_of_rank  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore::openmdao.api.DistributedComponentWarning")


@pytest.fixture(scope="module")
def wing():
    return Wing()


@pytest.mark.slow
@pytest.mark.parametrize("generation", [1, 2])
@pytest.mark.parametrize("solver", ["ADflow", "DAFoam"])
def test_totals_of_a_solver_are_those_of_differences(wing, solver, generation):
    problem, rng, h = flown(wing, solver, generation), np.random.default_rng(3), 1e-3
    values = {**DESIGN, **FLOW[solver]}
    directions = {name: rng.normal(size=np.size(value)) for name, value in values.items()}

    def value(step):
        for name, at in values.items():
            problem.set_val(name, at + step * directions[name])
        problem.run_model()
        return problem.get_val(FUNCTION[solver]).item()

    exact = (totals(problem) @ np.concatenate(list(directions.values()))).item()
    coarse, fine = ((value(step) - value(-step)) / (2.0 * step) for step in (h, 0.5 * h))
    assert (4.0 * fine - coarse) / 3.0 == pytest.approx(exact, rel=1e-8)


@pytest.mark.slow
def test_both_generations_give_the_same_totals(wing):
    first, second = (totals(flown(wing, "ADflow", generation)) for generation in (1, 2))
    np.testing.assert_array_equal(first, second)


def test_names_of_the_second_generation_are_those_of_mphys():
    if conventions.INSTALLED == 1:
        pytest.skip("MPhys 1.x has no list of names")
    surface, flow = mphys.MPhysVariables.Aerodynamics.Surface, mphys.MPhysVariables.Aerodynamics.FlowConditions
    names = conventions.GENERATIONS[2]
    assert names.mesh == surface.Mesh.COORDINATES
    assert names.geometry_input == surface.Geometry.COORDINATES_INPUT
    assert names.geometry_output == surface.Geometry.COORDINATES_OUTPUT
    assert (names.angle_of_attack, names.mach_number) == (flow.ANGLE_OF_ATTACK, flow.MACH_NUMBER)
    assert conventions.X_AERO == surface.COORDINATES
    assert conventions.X_JIG == surface.COORDINATES_INITIAL


def test_an_mphys_without_a_list_of_names_is_the_first_generation():
    assert conventions.generation_of(SimpleNamespace(Builder=mphys.Builder)) == 1
    assert conventions.generation_of(mphys) == conventions.INSTALLED


def test_another_generation_is_refused():
    with pytest.raises(InputError, match="geometry: there is no generation 3 of MPhys; give 1"):
        conventions.names_of(3, "geometry")


def test_a_process_that_is_alone_holds_all_nodes():
    np.testing.assert_array_equal(nodes_of_rank(None, 4, "numbers", ONE, "x"), np.arange(4))


FIRST = {
    "__init__.py": "from .builder import Builder\nfrom .multipoint import Multipoint, MultipointParallel\n",
    "builder.py": "class Builder:\n    pass\n",
    "multipoint.py": "class Multipoint:\n    pass\n\n\nclass MultipointParallel:\n    pass\n",
}
"""The modules of MPhys 1.3 in which our imports would look."""


@pytest.mark.slow
def test_all_of_ours_is_imported_beside_the_modules_of_mphys_1(tmp_path):
    (tmp_path / "mphys").mkdir()
    for name, text in FIRST.items():
        (tmp_path / "mphys" / name).write_text(text)
    names = sorted(path.stem for path in Path(conventions.__file__).parent.glob("[a-z]*.py"))
    imports = "".join(f"import bspline_mdao.core.om.mphys.{name}\n" for name in names)
    script = f"{imports}\nfrom bspline_mdao.core.om.mphys.conventions import INSTALLED\nprint(INSTALLED)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, timeout=120)
    assert done.stdout == "1\n", done.stderr
