"""OpenFOAM on grids of the project: lift has the right sign and size, and what is missing is said."""

import re
import shutil
from dataclasses import replace

import numpy as np
import pytest

from bspline_mdao import InputError, find_topology, read_grid
from bspline_mdao.base.checks import as_axes
from bspline_mdao.errors import SolverError
from bspline_mdao.flow import openfoam_forces
from bspline_mdao.flow.loads.stream import stream_axes
from bspline_mdao.flow.openfoam.program import run_program
from bspline_mdao.flow.openfoam.solver_log import read_residuals
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.cell_faces import CellFaces
from bspline_mdao.grids.cells.quads import area_vectors
from bspline_mdao.grids.io.patch_guess import guess_patches

needs_openfoam = pytest.mark.skipif(shutil.which("rhoSimpleFoam") is None, reason="OpenFOAM is not installed")

LOG = """
Time = 1
GAMG:  Solving for p, Initial residual = 1, Final residual = 0.01, No Iterations 2
GAMG:  Solving for p, Initial residual = 0.5, Final residual = 0.01, No Iterations 2
smoothSolver:  Solving for Ux, Initial residual = 0.9, Final residual = 0.01, No Iterations 2
Time = 2
GAMG:  Solving for p, Initial residual = 2e-3, Final residual = 1e-5, No Iterations 2
smoothSolver:  Solving for Ux, Initial residual = 1e-4, Final residual = 1e-6, No Iterations 2
SIMPLE solution converged in 2 iterations
"""


def wing():
    """Topology, nodes and wall faces of a coarse grid about the M6."""
    grid = onera_m6_grid((9, 9, 7))
    topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
    cells = CellFaces.of(topology, nodes)
    return topology, nodes, area_vectors(nodes[cells.corners_of("wall")])


@pytest.mark.slow
def test_without_openfoam_it_says_so_and_gives_nothing(monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    topology, nodes, _ = wing()
    assert openfoam_forces(topology, nodes, 0.3, 3.0, 1.16) is None
    assert capsys.readouterr().out == "OpenFOAM is not installed; skipped\n"


def test_residuals_are_those_of_the_first_solution_in_an_iteration():
    residuals = read_residuals(LOG)
    np.testing.assert_array_equal(residuals["p"], [1.0, 2e-3])
    np.testing.assert_array_equal(residuals["Ux"], [0.9, 1e-4])


@needs_openfoam
def test_lift_turns_with_the_stream_and_is_that_of_the_pressures():
    topology, nodes, areas = wing()
    up, down = (openfoam_forces(topology, nodes, 0.3, alpha, 1.16) for alpha in (3.0, -3.0))
    assert up.is_converged
    assert down.is_converged
    assert up.n_iterations == len(up.residuals["h"]) > 50
    assert 0.1 < up.CL < 0.25
    np.testing.assert_allclose([down.CL, down.CD], [-up.CL, up.CD], rtol=1e-4)
    drag, lift = stream_axes(np.radians(3.0), as_axes("xzy", "test"))
    np.testing.assert_allclose(up.Cp @ areas @ np.stack([lift, drag], axis=1) / 1.16, [up.CL, up.CD], rtol=1e-12)


@needs_openfoam
def test_what_openfoam_stops_with_is_said_in_the_first_line(tmp_path):
    with pytest.raises(SolverError) as error:
        run_program("rhoSimpleFoam", tmp_path)
    first, *others = str(error.value).splitlines()
    assert re.match(r"rhoSimpleFoam in .*: cannot find file .*controlDict.*; check the case", first)
    assert others[0] == f"The end of {tmp_path / 'log.rhoSimpleFoam'}:"
    assert others[-1].strip() == "FOAM exiting"


@needs_openfoam
def test_a_grid_without_walls_is_refused():
    grid = replace(onera_m6_grid((5, 5, 5)), patches=())
    with pytest.raises(InputError, match="no patch is of kind wall"):
        openfoam_forces(find_topology(grid), grid.to_vector().reshape(-1, 3), 0.3, 3.0, 1.16)


@needs_openfoam
def test_lift_and_drag_of_the_rectangular_wing_are_those_of_the_reference(real_grids):
    grid = read_grid(real_grids / "hh_naca0012_12blocks.xyz")
    grid = replace(grid, patches=guess_patches(grid, [face.window for face in find_topology(grid).boundary]))
    found = openfoam_forces(find_topology(grid), grid.to_vector().reshape(-1, 3), 0.3, 4.0, 3.0)
    assert found.is_converged
    np.testing.assert_allclose(found.CL, 0.3050, rtol=0.03)
    np.testing.assert_allclose(found.CD, 0.0114, rtol=0.01)
