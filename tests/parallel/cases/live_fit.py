"""Fit, frozen and live, and the grid of a baseline that changes, on several ranks: as on one process."""

import warnings

import numpy as np
import openmdao.api as om
from component_cases import movable_model
from mpi4py import MPI

from bspline_mdao import Fit, FitWarning, LiveGridEvaluate, fit_grid
from bspline_mdao.base.numerics.processes import summed
from bspline_mdao.core.fit.fit_nodes import whole_blocks
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.partition import Partition, Subdomain

comm = MPI.COMM_WORLD
base = movable_model()
directions = 0.01 * np.random.default_rng(4).standard_normal((4, base.n_nodes, 3))


class Shift(om.ExplicitComponent):
    """Move the nodes of a subdomain along some directions, as far as serial numbers say."""

    def initialize(self):
        self.options.declare("rows")
        self.options.declare("model")

    def setup(self):
        rows = self.options["rows"]
        self.baseline = self.options["model"].regenerate().to_vector().reshape(-1, 3)[rows].ravel()
        self.directions = directions[:, rows].reshape(len(directions), -1)
        self.add_input("amounts", val=np.array([0.3, -0.2, 0.1, 0.05]))
        self.add_output("grid_initial", val=self.baseline, distributed=self.comm.size > 1, units="m")

    def compute(self, inputs, outputs):
        outputs["grid_initial"] = self.baseline + inputs["amounts"] @ self.directions

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        if mode == "fwd":
            d_outputs["grid_initial"] += d_inputs["amounts"] @ self.directions
        else:
            d_inputs["amounts"] += summed(self.comm, self.directions @ d_outputs["grid_initial"])


class Weigh(om.ExplicitComponent):
    """Weighted sums of the nodes of a subdomain."""

    def initialize(self):
        self.options.declare("rows")

    def setup(self):
        rows = self.options["rows"]
        weights = np.random.default_rng(6).standard_normal((2, base.n_nodes, 3))
        self.weights = weights[:, rows].reshape(2, -1)
        self.add_input("grid", shape=3 * len(rows), distributed=self.comm.size > 1, units="m")
        self.add_output("sums", shape=2)

    def compute(self, inputs, outputs):
        outputs["sums"] = summed(self.comm, self.weights @ inputs["grid"])

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        if mode == "fwd":
            d_outputs["sums"] += summed(self.comm, self.weights @ d_inputs["grid"])
        else:
            d_inputs["grid"] += d_outputs["sums"] @ self.weights


class WeighControl(om.ExplicitComponent):
    """Weighted sums of the control points."""

    def initialize(self):
        self.options.declare("size")

    def setup(self):
        self.weights = np.random.default_rng(7).standard_normal((2, self.options["size"]))
        self.add_input("control_points_initial", shape=self.weights.shape[1], units="m")
        self.add_output("fitted_sums", shape=2)
        self.declare_partials("*", "*", val=self.weights)

    def compute(self, inputs, outputs):
        outputs["fitted_sums"] = self.weights @ inputs["control_points_initial"]


def problem_of(comm, model, live, rows, mode, partition=None):
    problem = om.Problem(reports=False, comm=comm)
    problem.model.add_subsystem("shift", Shift(rows=rows, model=model), promotes=["*"])
    problem.model.add_subsystem("fit", Fit(model=model, live=live, partition=partition), promotes=["*"])
    problem.model.add_subsystem("weigh_control", WeighControl(size=model.control_points.size), promotes=["*"])
    if live:
        move = om.ExecComp(
            "moved = 1.01 * fitted + 0.02",
            fitted={"shape": model.control_points.size, "units": "m"},
            moved={"shape": model.control_points.size, "units": "m"},
            has_diag_partials=True,
        )
        problem.model.add_subsystem("move", move)
        problem.model.connect("control_points_initial", "move.fitted")
        problem.model.connect("move.moved", "control_points")
        problem.model.add_subsystem("grid", LiveGridEvaluate(model=model, partition=partition), promotes=["*"])
        problem.model.add_subsystem("weigh", Weigh(rows=rows), promotes=["*"])
    problem.setup(mode=mode)
    problem.run_model()
    return problem


def check(model, live):
    partition = whole_blocks(model.topology, comm.size)
    uneven = Partition(partition.shapes, ((),) * (comm.size - 1) + (tuple(w for p in partition.pieces for w in p),))
    of = ["sums", "fitted_sums"] if live else ["fitted_sums"]
    for mode in ("fwd", "rev"):
        one = problem_of(MPI.COMM_SELF, model, live, Subdomain.of_grid(model.topology).rows, mode)
        expected = one.compute_totals(of, ["amounts"])
        for deal in (None, uneven):
            rows = (deal or partition).subdomain(comm.rank).rows
            problem = problem_of(comm, model, live, rows, mode, deal)
            np.testing.assert_allclose(
                problem["control_points_initial"], one["control_points_initial"], rtol=0, atol=1e-13
            )
            totals = problem.compute_totals(of, ["amounts"])
            for key, total in totals.items():
                scale = np.abs(expected[key]).max()
                np.testing.assert_allclose(total, expected[key], rtol=0, atol=1e-12 * scale, err_msg=str(key))
            if live:
                grid = problem.get_val("grid", get_remote=False).reshape(-1, 3)
                np.testing.assert_allclose(grid, one["grid"].reshape(-1, 3)[rows], rtol=0, atol=1e-13)


def check_refusals():
    shape = base.topology.shapes[0]
    low, high = (Window(0, (lo, 0, 0), (hi, *(n - 1 for n in shape[1:]))) for lo, hi in ((0, 3), (3, shape[0] - 1)))
    others = tuple(Window.whole(b, shape) for b, shape in enumerate(base.topology.shapes) if b)
    cut = Partition(base.topology.shapes, ((low, *others), (high,), *((),) * (comm.size - 2)))
    for component in (Fit, LiveGridEvaluate):
        problem = om.Problem(reports=False, comm=comm)
        problem.model.add_subsystem("it", component(model=base, partition=cut))
        try:
            problem.setup()
            problem.final_setup()
        except Exception as error:
            said = comm.allgather(str(error))
        assert "block 1 is cut" in said[0]
        assert len(set(said)) == 1, said


if __name__ == "__main__":
    check(base, live=False)
    check(base, live=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        mixed = fit_grid(base.regenerate(), topology=base.topology, method="quasi_interpolant", wall_layer=False)
    check(mixed, live=False)
    check_refusals()
    print("done")
