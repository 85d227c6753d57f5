"""The grid on several ranks: its bits, its products and its totals are those of one process."""

import sys
import warnings
from dataclasses import replace

import numpy as np
import openmdao.api as om
from mpi4py import MPI
from openmdao.utils.assert_utils import assert_check_partials

from bspline_mdao import GridEvaluate, fit_grid
from bspline_mdao.core.generators.wing_spacing import Spacing
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.parallel import Partition, Subdomain

warnings.simplefilter("ignore", om.DerivativesWarning)
comm = MPI.COMM_WORLD


def model_of(kind):
    """A wing with viscous walls, symmetry plane and residual; one block of it, which has to be cut; a linear one."""
    grid = onera_m6_grid((11, 10, 9), Spacing(off_wall=1e-5))
    if kind == "block":
        nodes = grid.blocks[4].nodes
        patches = tuple(
            replace(patch, windows=tuple(replace(w, block=0) for w in patch.windows if w.block == 4))
            for patch in grid.patches
        )
        grid = Grid((Block(nodes, "block 1"),), tuple(patch for patch in patches if patch.windows))
    return fit_grid(grid, n_control=(6, 6, 5), order=(4, 3, 4), wall_layer=kind != "linear")


def problem_of(component, comm, indices, of_local):
    """A problem with the component, and an objective that sums a random function of the nodes."""
    problem = om.Problem(comm=comm)
    problem.model.add_subsystem("evaluate", component, promotes=["*"])
    problem.model.add_subsystem("sum", of_local, promotes=["*"])
    problem.model.add_design_var("control_points", indices=indices)
    if component.options["surface"] is not None:
        problem.model.add_design_var("surface", indices=np.arange(0, 90, 17))
    problem.model.add_objective("total")
    return problem


class Sum(om.ExplicitComponent):
    """Sum of squares with weights over nodes, each node of the grid once; distributed to serial."""

    def initialize(self):
        self.options.declare("weights")

    def setup(self):
        self.add_input("grid", shape=len(self.options["weights"]), distributed=self.comm.size > 1, units="m")
        self.add_output("total")

    def compute(self, inputs, outputs):
        part = np.sum(self.options["weights"] * inputs["grid"] ** 2)
        outputs["total"] = self.comm.allreduce(part) if self.comm.size > 1 else part

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        row = 2.0 * self.options["weights"] * inputs["grid"]
        if mode == "fwd":
            part = row @ d_inputs["grid"]
            d_outputs["total"] += self.comm.allreduce(part) if self.comm.size > 1 else part
        else:
            d_inputs["grid"] += row * d_outputs["total"]


def check(model, given):
    """Compare the component on all ranks with one on each rank alone; ``given`` is what it gets besides the model."""
    n, rng = model.n_nodes, np.random.default_rng(0)
    weights = rng.standard_normal((n, 3))
    moved = model.control_points + 1e-4 * rng.standard_normal(model.control_points.shape)
    indices = rng.permutation(moved.size)[:6]
    subdomain, options = Partition.of(model.topology, comm.size).subdomain(comm.rank), {"model": model}
    if given == "rows":  # those of a solver that deals nodes out one by one; the last rank holds none
        last = max(comm.size - 1, 1)
        rows = np.random.default_rng(1).permutation(n)[comm.rank :: last] if comm.rank < last else []
        subdomain = options["partition"] = Subdomain.of_rows(rows, n)
    elif given == "subdomain":
        options = {"model": model.local_model(subdomain)}
    elif given == "surface":
        options["surface"] = SurfaceGrid.of(model)
    counts = comm.allreduce(np.bincount(subdomain.rows, minlength=n))
    own = (weights / np.maximum(counts, 1)[:, None])[subdomain.rows]
    whole = {"model": model, "surface": options.get("surface")}
    problems = {
        "whole": problem_of(GridEvaluate(**whole), MPI.COMM_SELF, indices, Sum(weights=weights.ravel())),
        "parts": problem_of(GridEvaluate(**options), comm, indices, Sum(weights=own.ravel())),
    }
    totals = {}
    for name, problem in problems.items():
        for mode in ("fwd", "rev"):
            problem.setup(mode=mode)
            problem.set_val("control_points", moved.ravel())
            if given == "surface":
                problem.set_val("surface", 1.001 * options["surface"].points.ravel())
            problem.run_model()
            totals[name, mode] = np.ravel(problem.compute_totals(return_format="array"))
    expected = problems["whole"].get_val("grid").reshape(-1, 3)
    found = problems["parts"].get_val("grid", get_remote=False).reshape(-1, 3)
    assert found.shape == (subdomain.n_nodes, 3)
    assert found.tobytes() == expected[subdomain.rows].tobytes()
    for mode in ("fwd", "rev"):
        off = np.abs(totals["parts", mode] - totals["whole", mode]).max() / np.abs(totals["whole", mode]).max()
        assert off < 1e-13, (mode, off)
    assert len(set(comm.allgather(totals["parts", "rev"].tobytes()))) == 1
    alone = om.Problem(comm=comm)
    alone.model.add_subsystem("evaluate", GridEvaluate(**options), promotes=["*"])
    alone.setup()
    alone.run_model()
    np.random.seed(1)  # noqa: NPY002 - where OpenMDAO draws the directions of checks
    data = alone.check_partials(out_stream=None)
    assert data["evaluate"]
    assert_check_partials(data, atol=1e-4, rtol=1e-4)


kind, *ways = sys.argv[1:]
model = model_of(kind)
for given in ways:
    check(model, given)
print("done", comm.rank)
