"""The flow on several ranks is that on one: states, forces, the drag of the far field, and totals in both modes.

Rank 0 flies alone first. The last argument is the number of ranks that cells are dealt out to, so that some hold
none.
"""

import sys

import numpy as np
import openmdao.api as om
from mpi4py import MPI

from bspline_mdao import EulerFlow, fit_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.partition import Partition

COEFFICIENTS = ("CL", "CD", "CM", "CD_induced")
OUTPUTS = (*COEFFICIENTS, "span_load", "Cp")
WRT = ("along", "alpha", "Mach_number")


class Shift(om.ExplicitComponent):
    """Nodes of this rank, shifted along a direction."""

    def initialize(self):
        self.options.declare("nodes", types=np.ndarray)
        self.options.declare("direction", types=np.ndarray)

    def setup(self):
        self.add_input("along")
        self.add_output("grid", val=self.options["nodes"].ravel(), units="m", distributed=self.comm.size > 1)

    def compute(self, inputs, outputs):
        outputs["grid"] = (self.options["nodes"] + inputs["along"] * self.options["direction"]).ravel()

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        direction = self.options["direction"].ravel()
        if mode == "fwd":
            d_outputs["grid"] += d_inputs["along"] * direction
        else:
            d_inputs["along"] += self.comm.allreduce(direction @ d_outputs["grid"])


def flown(model, comm, n_holders, mode):
    """Problem after a run, with the rows of the nodes of this rank."""
    partition = Partition.of(model.topology, min(n_holders, comm.size))
    pieces = partition.pieces + ((),) * (comm.size - partition.n_ranks)
    partition = Partition(partition.shapes, pieces)
    rows = partition.subdomain(comm.rank).rows
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    direction = 1e-3 * np.random.default_rng(1).standard_normal(nodes.shape)
    problem = om.Problem(reports=False, comm=comm)
    shift = Shift(nodes=nodes[rows], direction=direction[rows])
    problem.model.add_subsystem("shift", shift, promotes=["*"])
    options = {"moment_reference": (0.3, 0.1, -0.2), "tolerance": 1e-12, "partition": partition}
    problem.model.add_subsystem("flow", EulerFlow(model=model, reference_area=1.16, **options), promotes=["*"])
    problem.setup(mode=mode)
    problem.set_val("along", 0.0)
    problem.set_val("alpha", 3.0)
    problem.run_model()
    return problem, partition.subdomain(comm.rank)


def results(model, comm, n_holders):
    """Values, totals in both modes and states by the numbers of cells of a problem."""
    problem, subdomain = flown(model, comm, n_holders, "fwd")
    values = {name: problem.get_val(name).copy() for name in OUTPUTS}
    totals = {"fwd": problem.compute_totals(OUTPUTS, WRT)}
    states = problem.model.flow.state._outputs["states"].reshape(-1, 5).copy()
    problem, _ = flown(model, comm, n_holders, "rev")
    totals["rev"] = problem.compute_totals(COEFFICIENTS, WRT)
    return values, totals, states, subdomain


def difference(ours, theirs):
    """Largest difference relative to the largest number."""
    return np.abs(ours - theirs).max() / np.abs(theirs).max()


def main(n_holders: int):
    """Compare this number of ranks with one."""
    comm, model = MPI.COMM_WORLD, fit_grid(onera_m6_grid((5, 5, 5)))
    alone = results(model, MPI.COMM_SELF, 1) if comm.rank == 0 else None
    values, totals, states, _ = comm.bcast(alone)
    our_values, our_totals, our_states, subdomain = results(model, comm, n_holders)
    assert len(our_states) == len(subdomain.cells)
    if len(subdomain.cells):
        assert difference(our_states, states[subdomain.cells]) < 1e-10
    for name in OUTPUTS:
        assert difference(our_values[name], values[name]) < 1e-10, name
    for mode, these in our_totals.items():
        for pair, block in these.items():
            assert difference(block, totals[mode][pair]) < 1e-9, (mode, pair)
            assert difference(block, totals["fwd"][pair]) < 1e-9, (mode, pair)
    print("as alone")


main(int(sys.argv[1]))
