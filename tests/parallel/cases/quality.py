"""Quality on several ranks: outputs, derivatives, the report and inverted cells are those of one process."""

import numpy as np
import openmdao.api as om
from component_cases import movable_model
from mpi4py import MPI

from bspline_mdao.base.numerics.processes import summed, world
from bspline_mdao.core.om.quality import Quality
from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.aggregates import AGGREGATES
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.partition import Partition, Subdomain

SETTINGS = {"aggregates": tuple(AGGREGATES), "rho": 20.0, "p": 8, "rho_height": 20.0}
comm, model = world(), movable_model()
whole = Subdomain.of_grid(model.topology)
directions = 0.02 * np.random.default_rng(4).standard_normal((4, model.n_nodes, 3))


class Shift(om.ExplicitComponent):
    """Move the nodes of a subdomain along some directions, as far as serial numbers say."""

    def initialize(self):
        self.options.declare("rows")

    def setup(self):
        rows = self.options["rows"]
        self.baseline = model.regenerate().to_vector().reshape(-1, 3)[rows].ravel()
        self.directions = directions[:, rows].reshape(len(directions), -1)
        self.add_input("amounts", val=np.array([0.3, -0.2, 0.1, 0.05]))
        self.add_output("grid", val=self.baseline, distributed=self.comm.size > 1, units="m")

    def compute(self, inputs, outputs):
        outputs["grid"] = self.baseline + inputs["amounts"] @ self.directions

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        if mode == "fwd":
            d_outputs["grid"] += d_inputs["amounts"] @ self.directions
        else:
            d_inputs["amounts"] += summed(self.comm, self.directions @ d_outputs["grid"])


def problem_of(comm, subdomain, mode, **options):
    """The shift and the component behind it, after a run."""
    problem = om.Problem(reports=False, comm=comm)
    problem.model.add_subsystem("shift", Shift(rows=subdomain.rows), promotes=["*"])
    problem.model.add_subsystem("quality", Quality(model=model, **{**SETTINGS, **options}), promotes=["*"])
    problem.setup(mode=mode)
    problem.run_model()
    return problem


def deals():
    """Ways to deal the blocks out: by load; cut through walls, others with nothing; all on the last rank."""
    first, second = (Window.whole(number, shape) for number, shape in enumerate(model.topology.shapes))
    left, right = (
        Window(0, (at, 0, 0), tuple(np.add((to, 0, 0), (0, *first.hi[1:])).tolist())) for at, to in ((0, 3), (3, 6))
    )
    nothing = ((),) * (comm.size - 2)
    yield None
    yield Partition(model.topology.shapes, ((right, second), *nothing, (left,)))
    yield Partition(model.topology.shapes, ((), *nothing, (first, second)))


one = {mode: problem_of(MPI.COMM_SELF, whole, mode, cells=True) for mode in ("fwd", "rev")}
expected = one["rev"].compute_totals(list(AGGREGATES), ["amounts"])
report = one["rev"].model.quality.report()
for partition in deals():
    subdomain = (partition or Partition.of(model.topology, comm.size)).subdomain(comm.rank)
    for mode in ("fwd", "rev"):
        problem = problem_of(comm, subdomain, mode, cells=True, partition=partition)
        for name in AGGREGATES:
            np.testing.assert_allclose(problem.get_val(name), one[mode].get_val(name), rtol=1e-13)
        quality = problem.get_val("cell_quality", get_remote=False)
        np.testing.assert_allclose(quality, one[mode].get_val("cell_quality")[subdomain.cells], rtol=1e-13)
        totals = problem.compute_totals(list(AGGREGATES), ["amounts"])
        for key, total in totals.items():
            np.testing.assert_allclose(total, expected[key], rtol=0.0, atol=1e-13 * np.abs(expected[key]).max())
        assert repr(problem.model.quality.report()) == repr(report)


def check_products(problem, subdomain):
    """Compare forward products with differences and reverse ones, in directions and with seeds of each rank."""
    component, rng = problem.model.quality, np.random.default_rng(comm.rank)
    at, direction = (
        {"grid": problem.get_val("grid", get_remote=False).ravel().copy()},
        rng.standard_normal(3 * subdomain.n_nodes),
    )
    n_cells = subdomain.cells.size

    def outputs(step=0.0):
        found = {name: np.zeros(1) for name in AGGREGATES} | {"cell_quality": np.zeros(n_cells)}
        component.compute({"grid": at["grid"] + step * direction}, found)
        return np.concatenate([np.ravel(value) for value in found.values()])

    forward = {name: np.zeros(1) for name in AGGREGATES} | {"cell_quality": np.zeros(n_cells)}
    component.compute_jacvec_product(at, {"grid": direction}, forward, "fwd")
    exact = np.concatenate(list(forward.values()))
    difference = (outputs(1e-6) - outputs(-1e-6)) / 2e-6
    np.testing.assert_allclose(difference, exact, rtol=0.0, atol=1e-5 * np.abs(exact).max())
    seeds = {name: np.random.default_rng(9).standard_normal(1) for name in AGGREGATES}
    seeds["cell_quality"], bar = rng.standard_normal(n_cells), {"grid": np.zeros(3 * subdomain.n_nodes)}
    component.compute_jacvec_product(at, bar, seeds, "rev")
    serial = sum(float(seeds[name] @ forward[name]) for name in AGGREGATES)
    parts = np.array([seeds["cell_quality"] @ forward["cell_quality"], bar["grid"] @ direction])
    of_cells, reverse = summed(comm, parts)
    assert abs(serial + of_cells - reverse) < 1e-12 * max(abs(serial), abs(of_cells), abs(reverse))


check_products(problem, subdomain)
subdomain = Partition.of(model.topology, comm.size).subdomain(comm.rank)
check_products(problem_of(comm, subdomain, "rev", cells=True), subdomain)


def words(task, kind):
    """What all ranks raise."""
    try:
        task()
    except kind as error:
        return str(error)
    raise AssertionError("nothing was raised")


def folded(**options):
    """Fold a cell of the second block, which one rank alone has."""
    problem = problem_of(comm, Partition.of(model.topology, comm.size).subdomain(comm.rank), "rev", **options)
    problem.model.quality.options["require_valid"] = True
    row = 7 * 8 * 6 + (4 * 8 + 3) * 6 + 2
    problem.model.shift.baseline += 0.0
    own = np.flatnonzero(problem.model.shift.options["rows"] == row)
    problem.model.shift.baseline.reshape(-1, 3)[own, 0] += 1.0
    return problem


problem = folded()
message = words(problem.run_model, om.AnalysisError)
assert set(comm.allgather(message)) == {message}
assert "of block 2 is inverted" in message, message
own = Subdomain.of_rows(Partition.of(model.topology, comm.size).subdomain(comm.rank).rows, model.n_nodes)
assert "a subdomain of rows has no cells" in words(lambda: problem_of(comm, own, "rev", partition=own), InputError)
wrong = Partition.of(model.topology, comm.size + 1)
assert f"processes, and there are {comm.size}" in words(
    lambda: problem_of(comm, wrong.subdomain(comm.rank), "rev", partition=wrong), InputError
)
print("done", comm.rank)
