"""A mesh that rides along on several ranks: its nodes and totals are those of one."""

import numpy as np
import openmdao.api as om
from mpi4py import MPI

from bspline_mdao import ControlMeshMove, Ride, SurfaceControl, fit_grid
from bspline_mdao.base.numerics.processes import world
from bspline_mdao.design import Parametrization, ReferenceAxis, Twist
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.meshes import MixedMesh
from bspline_mdao.movers import LinearElasticity, moving_mesh

comm, model = world(), fit_grid(onera_m6_grid((9, 8, 7)))
block = model.regenerate().blocks[3].nodes
hexahedra = np.arange(block[..., 0].size).reshape(block.shape[:3])
tetra = np.stack(
    [hexahedra[:-1, :-1, :-1], hexahedra[1:, :-1, :-1], hexahedra[:-1, 1:, :-1], hexahedra[:-1, :-1, 1:]], axis=-1
)
MESH = MixedMesh(block.reshape(-1, 3), {"tetra": tetra.reshape(-1, 4)})


def problem_of(comm, mode):
    problem, mesh = om.Problem(reports=False, comm=comm), moving_mesh(model)
    variables = [Twist("twist", ReferenceAxis.of(mesh), stations=3)]
    parts = {
        "control": SurfaceControl(parametrization=Parametrization(mesh, variables)),
        "move": ControlMeshMove(mover=LinearElasticity(mesh, n_increments=1)),
        "ride": Ride(model=model, mesh=MESH),
    }
    for name, part in parts.items():
        problem.model.add_subsystem(name, part, promotes=["*"])
    problem.model.add_subsystem(
        "sum",
        om.ExecComp("total = sum(mesh**2)", mesh={"shape": 3 * MESH.n_points, "units": "m"}, total={"units": "m**2"}),
        promotes=["*"],
    )
    problem.setup(mode=mode)
    problem.set_val("twist", [0.0, 2.0, 5.0])
    problem.run_model()
    return problem.get_val("mesh"), problem.compute_totals(["total"], ["twist"])["total", "twist"]


alone = problem_of(MPI.COMM_SELF, "rev")
for mode in ("fwd", "rev"):
    for found, expected in zip(problem_of(comm, mode), alone):
        np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-14)
assert np.abs(alone[0].reshape(-1, 3) - MESH.points).max() > 1e-3
