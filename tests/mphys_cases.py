"""Stand-ins for ADflow and DAFoam in MPhys: their names, shapes, tags and distributed variables, and a made-up flow.

What they take over, of `adflow/mphys/mphys_adflow.py` 2.12 and `dafoam/mphys/mphys_dafoam.py` 4: the builders' methods,
the subsystems that scenarios get from them, the variables of these with their tags, which of them are distributed, and
that DAFoam has no forward derivatives. The flow is a sum of a function of all coordinates, each with a weight by its
place, so that every node out of order is noticed; a node that several processes hold counts once.
"""

import numpy as np
import openmdao.api as om
from mphys import Builder, Multipoint

from bspline_mdao import Parametrization, ReferenceAxis, Span, SurfaceGrid, Twist, fit_grid, moving_mesh, onera_m6_grid
from bspline_mdao.movement.inverse_distance import InverseDistance
from bspline_mdao.numerics.processes import summed
from bspline_mdao.om.mphys.conventions import GENERATIONS, INSTALLED
from bspline_mdao.om.mphys.geometry import SurfaceGeometry
from bspline_mdao.om.mphys.warper import VolumeWarper
from bspline_mdao.topology.partition import Partition
from bspline_mdao.topology.sharing import node_sharing, numbers_of_points, rows_of_points
from bspline_mdao.topology.stored_grid import StoredGrid

try:
    from mphys.scenarios import ScenarioAerodynamic
except ImportError:  # MPhys 1.x
    from mphys.scenario_aerodynamic import ScenarioAerodynamic

DESIGN = {"twist": [1.0, -2.0, 3.0], "span": [1.1]}
FLOW = {"aoa": 3.0, "patchV": [10.0, 2.0]}


class Wing:
    """A small wing, its variables and its mover."""

    def __init__(self, shape=(7, 6, 5)):
        self.model = fit_grid(onera_m6_grid(shape))
        mesh = moving_mesh(self.model)
        axis = ReferenceAxis.of(mesh)
        self.surface, self.mover = SurfaceGrid.of(self.model), InverseDistance(mesh)
        self.parametrization = Parametrization(mesh, [Twist("twist", axis, stations=3), Span("span", axis)])
        self.grid = self.model.regenerate()
        self.points = self.grid.to_vector().reshape(-1, 3)


class Solver:
    """What a process of a solver knows: its nodes. None of them are ours: single precision, an order of its own."""

    def __init__(self, wing, comm, volume, walls):
        self.comm, self.volume, self.walls = comm, np.float64(np.float32(volume)), np.float64(np.float32(walls))
        self.rows = rows_of_points(StoredGrid.of(wing.grid), wing.model.topology, self.volume, comm=comm)
        copies = summed(comm, np.bincount(self.rows, minlength=len(wing.points)))[self.rows, None]
        waves = wing.points[self.rows] @ [[11.0, 3.0, 5.0], [7.0, 9.0, 2.0], [4.0, 8.0, 13.0]]
        self.weights = (np.sin(waves) / copies).ravel()


def adflow_nodes(wing, rank, size):
    """Nodes of ADflow's process: pieces of blocks, i fastest, those on interfaces in every piece; walls likewise."""
    share = Partition.of(wing.model.topology, size).share(rank)
    pieces = np.split(np.arange(share.n_nodes), share.starts[1:-1])
    order = [piece.reshape(shape).T.ravel() for piece, shape in zip(pieces, share.shapes)]
    volume = wing.points[share.rows[np.concatenate(order)]] if order else np.zeros((0, 3))
    sources = node_sharing(wing.model.topology).source_rows()
    is_wall = np.isin(sources[share.rows], sources[wing.surface.rows])
    return volume, wing.points[share.rows[is_wall]]


def dafoam_nodes(wing, rank, size):
    """Nodes of DAFoam's process: a slab of them, each once, in no order; those between slabs in both.

    The last of several processes holds no wall, and some nodes of the wall are there twice.
    """
    unique = np.unique(node_sharing(wing.model.topology).source_rows())
    x = wing.points[unique, 0]
    low, high = np.quantile(x, [rank / size, (rank + 1) / size])
    volume = np.random.default_rng(rank).permutation(unique[(x >= low - 0.05) & (x <= high + 0.05)])
    holders = max(size - 1, 1)
    walls = [wing.surface.points[rank::holders], wing.surface.points[5:9]]
    return wing.points[volume], np.concatenate(walls) if rank < holders else np.zeros((0, 3))


class MeshOf(om.ExplicitComponent):
    """ADflowMesh, DAFoamMesh: the surface nodes of the process."""

    def initialize(self):
        self.options.declare("solver", recordable=False)
        self.options.declare("name")

    def setup(self):
        nodes = self.options["solver"].walls.ravel()
        self.add_output(self.options["name"], val=nodes, distributed=True, tags=["mphys_coordinates"])

    def mphys_get_surface_mesh(self):
        return self.options["solver"].walls.ravel()


class States(om.ExplicitComponent):
    """The solver: states of volume nodes. DAFoam gives its input a shape, ADflow takes that of what is connected."""

    def initialize(self):
        self.options.declare("builder", recordable=False)

    def setup(self):
        builder = self.options["builder"]
        self.weights, size = builder.solver.weights, builder.solver.volume.size
        self.names = builder.volume_name, builder.states_name, builder.flow_name
        volume, states, flow = self.names
        shape, tag = ({"shape_by_conn": True}, "input") if flow == "aoa" else ({"shape": size}, "coupling")
        self.add_input(volume, **shape, distributed=True, tags=["mphys_coupling"])
        self.add_input(flow, val=FLOW[flow], tags=[f"mphys_{tag}"])
        self.add_output(states, shape=size, distributed=True, tags=["mphys_coupling"])

    def compute(self, inputs, outputs):
        volume, states, flow = self.names
        outputs[states] = self.weights * np.sin(inputs[volume] + 0.1 * inputs[flow].sum())

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        volume, states, flow = self.names
        slope = self.weights * np.cos(inputs[volume] + 0.1 * inputs[flow].sum())
        if mode == "fwd" and mode in self.options["builder"].modes:
            if volume in d_inputs:
                d_outputs[states] += slope * d_inputs[volume]
            if flow in d_inputs:
                d_outputs[states] += 0.1 * slope * d_inputs[flow].sum()
        elif mode == "rev":
            if volume in d_inputs:
                d_inputs[volume] += slope * d_outputs[states]
            if flow in d_inputs:
                d_inputs[flow] += summed(self.comm, np.array([0.1 * slope @ d_outputs[states]]))


class Functions(om.ExplicitComponent):
    """ADflowFunctions, DAFoamFunctions: a number of the whole flow, from states and nodes of all processes."""

    def initialize(self):
        self.options.declare("builder", recordable=False)

    def setup(self):
        builder = self.options["builder"]
        self.weights, self.names = builder.solver.weights, (builder.states_name, builder.volume_name)
        self.of = builder.of.split(".")[-1]
        for name in self.names:
            self.add_input(name, distributed=True, shape_by_conn=True, tags=["mphys_coupling"])
        self.add_output(self.of, shape=1, tags=["mphys_result"] if self.of == "cl" else [])

    def slopes(self, inputs):
        states, volume = self.names
        return {states: np.ones(len(inputs[states])), volume: 2.0 * self.weights * inputs[volume]}

    def compute(self, inputs, outputs):
        states, volume = self.names
        local = inputs[states].sum() + self.weights @ inputs[volume] ** 2
        outputs[self.of] = summed(self.comm, np.array([local]))

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        slopes = {name: slope for name, slope in self.slopes(inputs).items() if name in d_inputs}
        if mode == "fwd":
            local = sum(slope @ d_inputs[name] for name, slope in slopes.items())
            d_outputs[self.of] += summed(self.comm, np.array([local]))
        else:
            for name, slope in slopes.items():
                d_inputs[name] += slope * d_outputs[self.of]


class ADflow(Builder):
    """ADflowBuilder with our grid movement: all that there is to write is the method of the warper."""

    mesh_names = {1: "x_aero0", 2: "x_aero0_mesh"}
    of, flow_name, volume_name, states_name = "cruise.cl", "aoa", "adflow_vol_coords", "adflow_states"
    modes = ("rev", "fwd")

    def __init__(self, wing, generation=None):
        self.wing, self.generation = wing, generation or INSTALLED

    def initialize(self, comm):
        self.solver = Solver(self.wing, comm, *adflow_nodes(self.wing, comm.rank, comm.size))

    def get_mesh_coordinate_subsystem(self, scenario_name=None):
        return MeshOf(solver=self.solver, name=self.mesh_names[self.generation])

    def get_pre_coupling_subsystem(self, scenario_name=None):
        wing, solver = self.wing, self.solver
        return VolumeWarper(
            model=wing.model,
            mover=wing.mover,
            numbers=numbers_of_points(wing.surface.points, solver.walls, "surface"),
            rows=solver.rows,
            volume_name=self.volume_name,
        )

    def get_coupling_group_subsystem(self, scenario_name=None):
        return States(builder=self)

    def get_post_coupling_subsystem(self, scenario_name=None):
        return Functions(builder=self)

    def get_number_of_nodes(self, groupName=None):
        return len(self.solver.walls)


class DAFoam(ADflow):
    """DAFoamBuilder with our grid movement. Its mesh gives ``x_aero0`` beside MPhys 2 as well."""

    mesh_names = {1: "x_aero0", 2: "x_aero0"}
    of, flow_name, volume_name, states_name = "cruise.aero_post.CL", "patchV", "aero_vol_coords", "aero_states"
    modes = ("rev",)

    def initialize(self, comm):
        self.solver = Solver(self.wing, comm, *dafoam_nodes(self.wing, comm.rank, comm.size))


SOLVERS = {"ADflow": ADflow, "DAFoam": DAFoam}


class Study(Multipoint):
    """Mesh, geometry and scenario, connected as the documentations of MPhys, ADflow and DAFoam have it."""

    def initialize(self):
        self.options.declare("builder", recordable=False)

    def setup(self):
        builder = self.options["builder"]
        builder.initialize(self.comm)
        wing, names = builder.wing, GENERATIONS[builder.generation]
        geometry = SurfaceGeometry(
            model=wing.model,
            parametrization=wing.parametrization,
            surface=wing.surface,
            numbers=numbers_of_points(wing.surface.points, builder.solver.walls, "surface"),
            generation=builder.generation,
        )
        self.add_subsystem("mesh", builder.get_mesh_coordinate_subsystem())
        self.add_subsystem("geometry", geometry, promotes_inputs=list(DESIGN))
        self.mphys_add_scenario("cruise", ScenarioAerodynamic(aero_builder=builder))
        self.connect(f"mesh.{builder.mesh_names[builder.generation]}", f"geometry.{names.geometry_input}")
        self.connect(f"geometry.{names.geometry_output}", "cruise.x_aero")


def flown(builder, comm=None, mode="rev"):
    """A study, run."""
    problem = om.Problem(Study(builder=builder), comm=comm, reports=False)
    problem.setup(mode=mode)
    for name, value in {**DESIGN, f"cruise.{builder.flow_name}": FLOW[builder.flow_name]}.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


def totals(problem):
    """The total derivatives of a study, of its number of the flow in all variables."""
    builder = problem.model.options["builder"]
    return problem.compute_totals([builder.of], [*DESIGN, f"cruise.{builder.flow_name}"], return_format="array")
