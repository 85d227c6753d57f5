"""A flow of ours on several ranks, in a scenario that MPhys connects by itself, has the totals of one process."""

import numpy as np
import openmdao.api as om
from mphys import MultipointParallel
from mphys_cases import DESIGN, ScenarioAerodynamic, Wing
from mpi4py import MPI

from bspline_mdao.base.numerics.processes import summed
from bspline_mdao.core.om.mphys.geometry import GeometryBuilder
from bspline_mdao.flow.om.mphys.builders import FlowBuilder
from bspline_mdao.grids.topology.partition import Partition
from bspline_mdao.grids.topology.sharing import node_sharing

comm, wing = MPI.COMM_WORLD, Wing()


class Waves(om.ExplicitComponent):
    """A number of all nodes of a distributed grid, each row once, and of the angle of attack."""

    def setup(self):
        size, topology = self.comm.size, wing.model.topology
        rows = Partition.of(topology, size).subdomain(self.comm.rank).rows
        copies = summed(self.comm, np.bincount(rows, minlength=topology.n_nodes))[rows]
        sources = node_sharing(topology).source_rows()[rows]
        self.weights = (np.cos(3.0 * sources[:, None] + [0.0, 1.0, 2.0]) / copies[:, None]).ravel()
        self.add_input("grid", shape=3 * len(rows), units="m", distributed=size > 1)
        self.add_input("alpha", 0.0, units="deg")
        self.add_input("Mach_number", 0.3)
        self.add_output("CL")

    def compute(self, inputs, outputs):
        outputs["CL"] = summed(self.comm, np.array([self.weights @ np.sin(inputs["grid"] + inputs["alpha"])]))

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        slope = self.weights * np.cos(inputs["grid"] + inputs["alpha"])
        if mode == "fwd":
            change = slope @ d_inputs["grid"] if "grid" in d_inputs else 0.0
            change += slope.sum() * d_inputs["alpha"][0] if "alpha" in d_inputs else 0.0
            d_outputs["CL"] += summed(self.comm, np.array([change]))
            return
        if "grid" in d_inputs:
            d_inputs["grid"] += slope * d_outputs["CL"]
        if "alpha" in d_inputs:
            d_inputs["alpha"] += summed(self.comm, np.array([slope.sum()])) * d_outputs["CL"]


class Scenarios(MultipointParallel):
    def setup(self):
        builder = FlowBuilder(wing.model, flow, surface=wing.surface, results={"CL": None}, mover=wing.mover)
        geometry = GeometryBuilder(model=wing.model, parametrization=wing.parametrization, surface=wing.surface)
        scenario = ScenarioAerodynamic(aero_builder=builder, geometry_builder=geometry, in_MultipointParallel=True)
        self.mphys_add_scenario("cruise", scenario)


def flow():
    group = om.Group()
    group.add_subsystem("waves", Waves(), promotes=["*"])
    return group


def totals(comm, mode):
    """Total derivatives of a scenario that is run by the processes of a communicator."""
    problem = om.Problem(comm=comm, reports=False)
    problem.model.add_subsystem("points", Scenarios(), promotes=["*"])
    problem.setup(mode=mode)
    for name, value in DESIGN.items():
        problem.set_val(f"cruise.geometry.{name}", value)
    problem.run_model()
    scenario = problem.model.points.cruise
    angle = next(name for name in ("cruise.aoa", "cruise.angle_of_attack") if name in inputs_of(scenario))
    return problem.compute_totals(
        ["cruise.CL"], [*(f"cruise.geometry.{name}" for name in DESIGN), angle], return_format="array"
    )


def inputs_of(scenario):
    return {f"cruise.{meta['prom_name']}" for meta in scenario.get_io_metadata("input").values()}


expected = totals(MPI.COMM_SELF, "rev")
for mode in ("rev", "fwd"):
    np.testing.assert_allclose(totals(comm, mode), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())
print("done")
