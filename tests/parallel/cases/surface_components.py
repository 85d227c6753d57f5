"""Components of the surface on several ranks: each has all of it, with the bits of one process."""

import numpy as np
import openmdao.api as om
from mpi4py import MPI
from openmdao.utils.assert_utils import assert_check_partials
from parallel_checks import assert_same_everywhere

from bspline_mdao import SurfaceControlFit, SurfaceEvaluate, SurfaceMeasure, fit_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.measures import SurfaceArea, SurfaceGrid
from bspline_mdao.movers import moving_mesh

comm = MPI.COMM_WORLD
model = fit_grid(onera_m6_grid((9, 9, 9)), n_control=5)
mesh, surface = moving_mesh(model), SurfaceGrid.of(model)
rng = np.random.default_rng(0)
step = 1e-4 * rng.standard_normal(mesh.points[mesh.surface_ids].shape) * [1.0, 1.0, 0.0]


def run(comm):
    """Values and totals of a problem on some processes."""
    problem = om.Problem(comm=comm)
    problem.model.add_subsystem("evaluate", SurfaceEvaluate(model=model, mesh=mesh, surface=surface), promotes=["*"])
    fit = SurfaceControlFit(model=model, mesh=mesh, surface=surface)
    problem.model.add_subsystem("fit", fit, promotes_inputs=["*"])
    problem.model.add_subsystem("area", SurfaceMeasure(measure=SurfaceArea.of(surface)), promotes=["*"])
    problem.model.add_design_var("surface_control_points")
    name = SurfaceArea.of(surface).name
    problem.model.add_objective(name)
    problem.setup(mode="rev")
    problem.set_val("surface_control_points", (mesh.points[mesh.surface_ids] + step).ravel())
    problem.run_model()
    values = [problem.get_val(path) for path in ("surface", "fit.surface_control_points", name)]
    return problem, [*values, problem.compute_totals(return_format="array")]


_, expected = run(MPI.COMM_SELF)
problem, found = run(comm)
assert_same_everywhere(comm, *found)
for one, many in zip(expected, found):
    assert one.tobytes() == many.tobytes()
np.random.seed(1)  # noqa: NPY002 - where OpenMDAO draws the directions of checks
data = problem.check_partials(out_stream=None)
assert len(data) == 3
assert_check_partials(data)
print("done", comm.rank)
