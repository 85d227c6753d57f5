"""Points inside a body on several ranks: places and totals are those of one; points in the volumes are refused."""

import numpy as np
import openmdao.api as om
from mpi4py import MPI

from bspline_mdao import InputError, PointSet, SurfaceControl, SurfaceEvaluate, fit_grid
from bspline_mdao.base.numerics.processes import world
from bspline_mdao.design import Parametrization, ReferenceAxis, Twist
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import moving_mesh

comm, model = world(), fit_grid(onera_m6_grid((9, 8, 7)))
SPAR = np.linspace([0.3, 0.0, 0.0], [0.9, 0.0, 1.3], 9)


def problem_of(points, comm, mode="rev"):
    problem, mesh = om.Problem(reports=False, comm=comm), moving_mesh(model)
    variables = [Twist("twist", ReferenceAxis.of(mesh), stations=3)]
    parts = {
        "control": SurfaceControl(parametrization=Parametrization(mesh, variables)),
        "evaluate": SurfaceEvaluate(model=model, mesh=mesh, surface=SurfaceGrid.of(model)),
        "spar": PointSet(model=model, points=points, name="spar"),
    }
    for name, part in parts.items():
        problem.model.add_subsystem(name, part, promotes=["*"])
    problem.setup(mode=mode)
    return problem


def flown(comm, mode):
    problem = problem_of(SPAR, comm, mode)
    problem.set_val("twist", [0.0, 2.0, 5.0])
    problem.run_model()
    return problem.get_val("spar"), problem.compute_totals(["spar"], ["twist"])["spar", "twist"]


alone = flown(MPI.COMM_SELF, "rev")
for mode in ("fwd", "rev"):
    for found, expected in zip(flown(comm, mode), alone):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)
assert np.abs(alone[0].reshape(-1, 3) - SPAR).max() > 1e-3

probes = model.evaluator().forward(model.control_points)[[300, 400]]
try:
    problem_of(np.concatenate([SPAR, probes]), comm)
except InputError as error:
    words = comm.allgather(str(error))
    assert "points are in the volumes, the first is point 10" in words[0], words
    assert len(set(words)) == 1, words
else:
    raise AssertionError("points in the volumes were taken on several ranks")
