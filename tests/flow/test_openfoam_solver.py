"""OpenFOAM itself behind the component, on coarse grids: forces, starts, differences, and meshes of every kind."""

import shutil
from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import find_topology, fit_grid
from bspline_mdao.files import write_polymesh
from bspline_mdao.flow import InviscidCase, OpenFoamFlow, RansCase
from bspline_mdao.flow.openfoam.printed_forces import printed_coefficients
from bspline_mdao.flow.openfoam.program import run_program
from bspline_mdao.generators import FarField, infinite_wing_grid, naca_section, onera_m6_grid
from bspline_mdao.grids.cells.grid_mesh import grid_mesh
from bspline_mdao.grids.io.mesh_polymesh import polymesh_of
from bspline_mdao.meshes import fit_mesh

pytestmark = [
    pytest.mark.solver,
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("simpleFoam") is None, reason="simpleFoam is not on the PATH: install OpenFOAM"),
]

CASES = {
    "simpleFoam": RansCase(1e6, walls="functions", tolerance=1e-5, planes="empty"),
    "rhoSimpleFoam": RansCase(1e6, compressible=True, walls="functions", tolerance=1e-5, planes="empty"),
    "no friction": InviscidCase(tolerance=1e-5, planes="empty"),
}


@pytest.fixture(scope="module")
def section():
    """The grid about a section."""
    return infinite_wing_grid(naca_section(0.12), (17, 9), far_field=FarField(5.0))


@pytest.fixture(scope="module")
def model(section):
    """The fitted grid."""
    return fit_grid(section)


def problem_of(model, folder, case, alpha=3.0, **options):
    """A problem with the flow."""
    options = {"reference_area": 1.0, "iprint": 0, "moment_reference": (0.25, 0.0, 0.0), **options}
    problem = om.Problem(reports=None)
    flow = OpenFoamFlow(model=model, folder=folder, case=case, **options)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup()
    problem.set_val("alpha", alpha)
    return problem


def values(problem, *names):
    """Numbers of a problem."""
    return np.array([problem.get_val(name).item() for name in names])


@pytest.mark.parametrize("name", CASES)
def test_forces_are_those_that_openfoam_finds_to_its_printed_digits(name, model, tmp_path):
    problem = problem_of(model, tmp_path, CASES[name])
    problem.run_model()
    theirs = printed_coefficients(tmp_path)
    np.testing.assert_allclose(values(problem, "CL", "CD"), [theirs["CL"], theirs["CD"]], rtol=1e-9)
    np.testing.assert_allclose(-problem.get_val("CM")[2], theirs["CM_pitch"], rtol=1e-8)
    assert 0.25 < problem.get_val("CL").item() < 0.4
    friction = np.abs(problem.get_val("Cf")).max()
    assert (friction == 0.0) == (name == "no friction")
    assert (problem.get_val("y_plus")[1] > 30.0) == (name != "no friction")


def test_the_next_design_takes_fewer_iterations_and_is_where_a_cold_start_ends(model, tmp_path):
    case = InviscidCase(tolerance=1e-7, planes="empty")
    problem = problem_of(model, tmp_path / "warm", case)
    problem.run_model()
    problem.set_val("alpha", 3.05)
    problem.run_model()
    cold = problem_of(model, tmp_path / "cold", case, alpha=3.05)
    cold.run_model()
    assert problem.get_val("n_iterations").item() < 0.9 * cold.get_val("n_iterations").item()
    np.testing.assert_allclose(values(problem, "CL", "CD"), values(cold, "CL", "CD"), rtol=1e-5)


def test_two_processes_find_what_one_finds(model, tmp_path, monkeypatch):
    for name in ("OMPI_ALLOW_RUN_AS_ROOT", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"):
        monkeypatch.setenv(name, "1")
    monkeypatch.setenv("OMPI_MCA_rmaps_base_oversubscribe", "1")
    case = InviscidCase(tolerance=1e-7, planes="empty")
    found = []
    for n_processes in (1, 2):
        problem = problem_of(model, tmp_path / f"on_{n_processes}", case, n_processes=n_processes)
        problem.run_model()
        found.append([*values(problem, "CL", "CD"), *problem.get_val("CM"), *problem.get_val("Cp")])
    np.testing.assert_allclose(found[1], found[0], rtol=1e-6, atol=1e-7)


def test_differences_are_those_of_far_steps_on_both_sides(model, tmp_path):
    case = InviscidCase(tolerance=1e-7, planes="empty")
    problem = problem_of(model, tmp_path, case)
    problem.model.approx_totals(method="fd", step=1e-2, form="forward")
    problem.setup()
    problem.set_val("alpha", 3.0)
    problem.run_model()
    slopes = problem.compute_totals(["CL", "CD"], ["alpha"])
    ends = []
    for alpha in (2.9, 3.1):
        problem.set_val("alpha", alpha)
        problem.run_model()
        ends.append(values(problem, "CL", "CD"))
    found = np.array([slopes[name, "alpha"].item() for name in ("CL", "CD")])
    np.testing.assert_allclose(found, (ends[1] - ends[0]) / 0.2, rtol=5e-3)


def test_a_mirrored_stream_mirrors_lift_whatever_the_axes_are_called(section, tmp_path):
    case, turned = InviscidCase(tolerance=1e-5, planes="empty"), section.to_vector().reshape(-1, 3)[:, [2, 0, 1]]
    found = []
    other = section.with_vector(turned.ravel())
    for grid, axes, alpha in ((section, "xzy", 3.0), (section, "xzy", -3.0), (other, "yxz", 3.0)):
        problem = problem_of(fit_grid(grid), tmp_path / f"{axes}{alpha}", case, alpha, axes=axes)
        problem.run_model()
        found.append(values(problem, "CL", "CD"))
    np.testing.assert_allclose(found[1], found[0] * [-1.0, 1.0], rtol=1e-3)
    np.testing.assert_allclose(found[2], found[0], rtol=1e-6)


def test_a_folder_of_openfoam_and_a_mesh_of_cells_give_the_forces_of_the_blocks(tmp_path):
    grid, case = onera_m6_grid((9, 9, 7)), InviscidCase(tolerance=1e-5)
    place = tmp_path / "mesh" / "constant" / "polyMesh"
    write_polymesh(place, grid)
    read = fit_mesh(place)
    found = []
    for name, model in (("blocks", fit_grid(grid)), ("folder", read), ("cells", replace(read, mesh_file=""))):
        problem = problem_of(model, tmp_path / name, case, reference_area=1.16)
        problem.run_model()
        found.append(values(problem, "CL", "CD"))
    np.testing.assert_allclose(found[1:], [found[0]] * 2, rtol=1e-3)


def test_openfoam_finds_no_fault_in_a_mesh_of_cells(section, tmp_path):
    mesh = grid_mesh(section, find_topology(section), {})
    case = InviscidCase()
    polymesh_of(mesh, {}).write_case(tmp_path, *case.files(case.stream(np.array([1.0, 0.0, 0.0]), 0.3)))
    assert "Mesh OK" in run_program("checkMesh", tmp_path)
