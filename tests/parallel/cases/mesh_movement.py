"""A mesh without structure on several ranks: nodes, quality and totals are those of one process."""

import numpy as np
import openmdao.api as om
from mesh_cases import body_model
from mpi4py import MPI
from overset_cases import blocks_model, overset_grid

from bspline_mdao import DesignSurface, GridMovement
from bspline_mdao.base.numerics.processes import summed
from bspline_mdao.design import FreeForm, Lattice
from bspline_mdao.generators import ball_grid

comm = MPI.COMM_WORLD
MODELS = {
    "tetrahedra": body_model,
    "component grids": lambda: blocks_model(overset_grid(4, 9)),
    "blocks": lambda: blocks_model(ball_grid((5, 6, 5, 4), far=3.0, octant=True)),
}


class Sum(om.ExplicitComponent):
    """Sum of squares of the nodes with weights; distributed to serial."""

    def initialize(self):
        self.options.declare("model")

    def setup(self):
        model = self.options["model"]
        weights = np.random.default_rng(0).standard_normal((model.n_nodes, 3))
        subdomain = model.partition(self.comm.size).subdomain(self.comm.rank)
        self.own = weights[subdomain.rows].ravel()
        self.add_input("grid", shape=len(self.own), distributed=self.comm.size > 1, units="m")
        self.add_output("total")

    def compute(self, inputs, outputs):
        outputs["total"] = summed(self.comm, np.array([self.own @ inputs["grid"] ** 2]))

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        row = 2.0 * self.own * inputs["grid"]
        if mode == "fwd":
            d_outputs["total"] += summed(self.comm, np.array([row @ d_inputs["grid"]]))
        else:
            d_inputs["grid"] += row * d_outputs["total"]


def run(model, comm, mode):
    """Nodes of a process, bounds of the quality, and totals of all."""
    design = DesignSurface.of(model)
    shape = design.parametrization([FreeForm("shape", Lattice.box(design.mesh, n=(3, 2, 2)), direction="xz")])
    names = ["volume_ks", "height_low_ks"]
    problem = om.Problem(reports=None, comm=comm)
    movement = GridMovement(model=model, parametrization=shape, quality=names)
    problem.model.add_subsystem("movement", movement, promotes=["*"])
    problem.model.add_subsystem("sum", Sum(model=model), promotes=["*"])
    problem.setup(mode=mode)
    problem["shape"] = np.random.default_rng(1).uniform(-0.05, 0.05, problem["shape"].shape)
    problem.run_model()
    totals = problem.compute_totals(["total", *names], ["shape"], return_format="array")
    bounds = np.ravel([problem.get_val(name) for name in ("total", *names)])
    return problem.get_val("grid", get_remote=False).reshape(-1, 3), bounds, totals


for name, made in MODELS.items():
    model = made()
    for mode in ("fwd", "rev"):
        (nodes, bounds, totals), (own, found, parts) = run(model, MPI.COMM_SELF, mode), run(model, comm, mode)
        np.testing.assert_allclose(own, nodes[model.partition(comm.size).subdomain(comm.rank).rows], rtol=0, atol=1e-12)
        np.testing.assert_allclose(found, bounds, rtol=1e-12, err_msg=name)
        np.testing.assert_allclose(parts, totals, rtol=0, atol=1e-12 * np.abs(totals).max(), err_msg=name)
    subdomain, rules = model.partition(comm.size).subdomain(comm.rank), {"rho": 100.0, "rho_height": 1000.0}
    whole, part = model.judge(None, comm, **rules), model.judge(subdomain, comm, **rules)
    assert part.part.cells.n <= whole.n_cells // comm.size + 1
    moved = model.mesh.points + 0.1 * np.random.default_rng(3).standard_normal((model.n_nodes, 3))
    assert part.report(moved[subdomain.rows]) == whole.report(moved)
    assert part.newly_inverted(moved[subdomain.rows]) == whole.newly_inverted(moved) != ""
print("done", comm.rank)
