"""Stand-ins for ADflow and DAFoam in MPhys: their names, shapes, tags and distributed variables, and a made-up flow.

What they take over, of ``adflow/mphys/mphys_adflow.py`` 2.12 and ``dafoam/mphys/mphys_dafoam.py`` 4: the builders, what
scripts call of the solvers, the subsystems that scenarios get and the variables of these with their tags, which of
them are distributed, and that DAFoam has no forward derivatives. The flow is a sum of a function of all coordinates,
each with a weight by its place, so that every node out of order is noticed; a node that several processes hold counts
once. Nodes come in an order of their own, and in single precision.
"""

from types import ModuleType, SimpleNamespace

import numpy as np
import openmdao.api as om
from mphys import Builder, Multipoint

from bspline_mdao import fit_grid
from bspline_mdao.base.numerics.processes import summed
from bspline_mdao.core.movement.inverse_distance import InverseDistance
from bspline_mdao.core.om.mphys.conventions import GENERATIONS, INSTALLED
from bspline_mdao.core.om.mphys.geometry import SurfaceGeometry
from bspline_mdao.core.om.mphys.warper import VolumeWarper
from bspline_mdao.design import Parametrization, ReferenceAxis, Span, Twist
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.node_numbering import boundary_rows
from bspline_mdao.grids.topology.partition import Partition
from bspline_mdao.grids.topology.sharing import numbers_of_points, rows_of_points
from bspline_mdao.grids.topology.stored_grid import StoredGrid
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import moving_mesh

try:
    from mphys.scenarios import ScenarioAerodynamic
except ImportError:  # MPhys 1.x
    from mphys.scenario_aerodynamic import ScenarioAerodynamic

WAVES = np.array([[11.0, 3.0, 5.0], [7.0, 9.0, 2.0], [4.0, 8.0, 13.0]])


class Solver:
    """What scripts call of both solvers, and what the made-up flow has to know."""

    meshFamilyGroup, designSurfacesGroup = "allSurfaces", "designSurfaces"

    def __init__(self, comm, volume, walls):
        self.volume, self.walls = np.float64(volume), np.float64(walls)
        self.weights = (np.sin(self.volume @ WAVES) / copies_of(self.volume, comm)[:, None]).ravel()
        self.mesh = SimpleNamespace(getSolverGrid=self.volume.ravel().copy)

    def getSurfaceCoordinates(self, groupName=None, includeZipper=False):
        return self.walls.copy()


def copies_of(points, comm):
    """How often all processes together hold each point."""
    everywhere = [points] if comm.size == 1 else comm.allgather(points)
    _, place, counts = np.unique(np.concatenate(everywhere), axis=0, return_inverse=True, return_counts=True)
    start = sum(map(len, everywhere[: comm.rank]))
    return counts[place.ravel()[start : start + len(points)]]


def nodes_and_walls(grid):
    """Nodes of a grid, in single precision, which of them are on walls, and its topology."""
    topology, points = find_topology(grid), np.float32(grid.to_vector().reshape(-1, 3))
    is_wall = np.zeros(len(points), dtype=bool)
    is_wall[boundary_rows(topology, [face for face in topology.boundary if face.kind == "wall"])] = True
    return points, is_wall, topology


def adflow_nodes(grid, comm):
    """Nodes of ADflow's process: pieces of blocks, i fastest, those on interfaces in every piece; walls likewise."""
    points, is_wall, topology = nodes_and_walls(grid)
    subdomain = Partition.of(topology, comm.size).subdomain(comm.rank)
    pieces = zip(np.split(subdomain.rows, subdomain.starts[1:-1]), subdomain.shapes)
    rows = np.concatenate([np.zeros(0, dtype=int), *(piece.reshape(shape).T.ravel() for piece, shape in pieces)])
    return points[rows], points[rows[is_wall[rows]]]


def dafoam_nodes(grid, comm):
    """Nodes of DAFoam's process: a slab of them, each once, in no order; those between slabs in both.

    The last of several processes holds no wall, and some nodes of the wall are there twice.
    """
    points, is_wall, _ = nodes_and_walls(grid)
    walls, points = np.unique(points[is_wall], axis=0), np.unique(points, axis=0)
    low, high = np.quantile(points[:, 0], [comm.rank / comm.size, (comm.rank + 1) / comm.size])
    volume = points[(points[:, 0] >= low - 0.05) & (points[:, 0] <= high + 0.05)]
    holders = max(comm.size - 1, 1)
    mine = np.concatenate([walls[comm.rank :: holders], walls[5:9]]) if comm.rank < holders else walls[:0]
    return np.random.default_rng(comm.rank).permutation(volume), mine


class SurfaceMesh(om.ExplicitComponent):
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
        shape = {"shape_by_conn": True} if builder.flow_name is None else {"shape": size}
        self.volume, self.states, self.flow = builder.volume_name, builder.states_name, None
        self.add_input(self.volume, **shape, distributed=True, tags=["mphys_coupling"])
        self.add_output(self.states, shape=size, distributed=True, tags=["mphys_coupling"])
        if builder.flow_name is not None:
            self.add_flow(builder.flow_name, [10.0, 2.0], "mphys_coupling")

    def add_flow(self, name, value, tag, **options):
        self.flow = name
        self.add_input(name, val=value, tags=[tag], **options)

    def mphys_set_ap(self, problem):
        value, options = problem.variables["aoa"]
        self.add_flow("aoa", value, "mphys_input", **options)

    def slope(self, inputs, wave):
        return self.weights * wave(inputs[self.volume] + 0.1 * inputs[self.flow].sum())

    def compute(self, inputs, outputs):
        outputs[self.states] = self.slope(inputs, np.sin)

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        slope = self.slope(inputs, np.cos)
        if mode == "fwd" and mode in self.options["builder"].modes:
            if self.volume in d_inputs:
                d_outputs[self.states] += slope * d_inputs[self.volume]
            if self.flow in d_inputs:
                d_outputs[self.states] += 0.1 * slope * d_inputs[self.flow].sum()
        elif mode == "rev":
            if self.volume in d_inputs:
                d_inputs[self.volume] += slope * d_outputs[self.states]
            if self.flow in d_inputs:
                d_inputs[self.flow] += summed(self.comm, np.array([0.1 * slope @ d_outputs[self.states]]))


class Functions(om.ExplicitComponent):
    """ADflowFunctions, DAFoamFunctions: numbers of the whole flow, from states and nodes of all processes."""

    def initialize(self):
        self.options.declare("builder", recordable=False)

    def setup(self):
        builder = self.options["builder"]
        self.weights, self.names = builder.solver.weights, (builder.states_name, builder.volume_name)
        for name in self.names:
            self.add_input(name, distributed=True, shape_by_conn=True, tags=["mphys_coupling"])
        self.functions = list(builder.functions)
        for name in self.functions:
            self.add_output(name, shape=1)

    def mphys_set_ap(self, problem):
        value, options = problem.variables["aoa"]
        self.add_input("aoa", val=value, tags=["mphys_input"], **options)
        self.functions = list(problem.evalFuncs)
        for name in self.functions:
            self.add_output(name, shape=1, tags=["mphys_result"])

    def slopes(self, inputs, number):
        states, volume = self.names
        return {states: np.full(len(inputs[states]), number + 1.0), volume: 2.0 * self.weights * inputs[volume]}

    def compute(self, inputs, outputs):
        states, volume = self.names
        for number, name in enumerate(self.functions):
            local = (number + 1.0) * inputs[states].sum() + self.weights @ inputs[volume] ** 2
            outputs[name] = summed(self.comm, np.array([local]))

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        for number, of in enumerate(self.functions):
            slopes = {name: slope for name, slope in self.slopes(inputs, number).items() if name in d_inputs}
            if of in d_outputs and mode == "fwd":
                local = sum(slope @ d_inputs[name] for name, slope in slopes.items())
                d_outputs[of] += summed(self.comm, np.array([local]))
            elif of in d_outputs:
                for name, slope in slopes.items():
                    d_inputs[name] += slope * d_outputs[of]


class ADflowBuilder(Builder):
    """ADflow's builder; the aerodynamic problem of a scenario adds its inputs and outputs."""

    mesh_names = {1: "x_aero0", 2: "x_aero0_mesh"}
    volume_name, states_name, flow_name, functions = "adflow_vol_coords", "adflow_states", None, ()
    modes, generation, nodes_of, grid = ("rev", "fwd"), INSTALLED, staticmethod(adflow_nodes), None

    def __init__(self, options, mesh_options=None, scenario="aerodynamic"):
        self.options, self.mesh_options = options, mesh_options

    def initialize(self, comm):
        self.solver = Solver(comm, *self.nodes_of(self.grid, comm))

    def get_mesh_coordinate_subsystem(self, scenario_name=None):
        return SurfaceMesh(solver=self.solver, name=self.mesh_names[self.generation])

    def get_coupling_group_subsystem(self, scenario_name=None):
        return States(builder=self)

    def get_post_coupling_subsystem(self, scenario_name=None):
        return Functions(builder=self)

    def get_number_of_nodes(self, groupName=None):
        return len(self.solver.walls)


class DAFoamBuilder(ADflowBuilder):
    """DAFoam's builder. Its mesh gives ``x_aero0`` beside MPhys 2 as well."""

    mesh_names = {1: "x_aero0", 2: "x_aero0"}
    volume_name, states_name, flow_name, functions = "aero_vol_coords", "aero_states", "patchV", ("CL", "CD")
    modes, nodes_of = ("rev",), staticmethod(dafoam_nodes)

    def initialize(self, comm):
        super().initialize(comm)
        self.DASolver = self.solver


class AeroProblem:
    """The aerodynamic problem of ADflow."""

    def __init__(self, name, evalFuncs, **conditions):
        self.evalFuncs, self.variables = evalFuncs, {}

    def addDV(self, key, value, name, units=None):
        self.variables[name] = value, {"units": units}


def stand_ins(grid):
    """Modules that scripts import, by name, of solvers that read a grid."""
    modules = {name: ModuleType(name) for name in ("adflow", "adflow.mphys", "baseclasses", "dafoam", "dafoam.mphys")}
    modules["adflow.mphys"].ADflowBuilder = type("ADflowBuilder", (ADflowBuilder,), {"grid": grid})
    modules["dafoam.mphys"].DAFoamBuilder = type("DAFoamBuilder", (DAFoamBuilder,), {"grid": grid})
    modules["baseclasses"].AeroProblem = AeroProblem
    return modules


BUILDERS = {"ADflow": ADflowBuilder, "DAFoam": DAFoamBuilder}
DESIGN = {"twist": [1.0, -2.0, 3.0], "span": [1.1]}
FLOW = {"ADflow": {"cruise.coupling.aoa": 3.0}, "DAFoam": {"cruise.patchV": [10.0, 2.0]}}
FUNCTION = {"ADflow": "cruise.aero_post.cl", "DAFoam": "cruise.aero_post.CL"}


class Wing:
    """A small wing, its variables and its mover."""

    def __init__(self, shape=(7, 6, 5)):
        self.grid = onera_m6_grid(shape)
        self.model = fit_grid(self.grid)
        mesh = moving_mesh(self.model)
        axis = ReferenceAxis.of(mesh)
        self.surface, self.mover = SurfaceGrid.of(self.model), InverseDistance(mesh)
        self.parametrization = Parametrization(mesh, [Twist("twist", axis, stations=3), Span("span", axis)])

    def builder(self, solver, generation):
        """Builder of a solver with our grid movement: all that there is to write."""
        wing, parent = self, BUILDERS[solver]

        class Warped(parent):
            grid = wing.grid

            def initialize(self, comm):
                super().initialize(comm)
                self.numbers = numbers_of_points(wing.surface.points, self.solver.walls, "surface", comm)
                stored = StoredGrid.of(wing.grid)
                self.rows = rows_of_points(stored, wing.model.topology, self.solver.volume, comm=comm)

            def get_pre_coupling_subsystem(self, scenario_name=None):
                nodes = {"numbers": self.numbers, "rows": self.rows, "volume_name": self.volume_name}
                return VolumeWarper(model=wing.model, mover=wing.mover, **nodes)

        builder = Warped({})
        builder.generation = generation
        return builder


class Study(Multipoint):
    """Mesh, geometry and scenario, connected as the documentations of MPhys, ADflow and DAFoam have it."""

    def initialize(self):
        self.options.declare("wing", recordable=False)
        self.options.declare("solver")
        self.options.declare("generation")

    def setup(self):
        wing, generation = self.options["wing"], self.options["generation"]
        builder, names = wing.builder(self.options["solver"], generation), GENERATIONS[generation]
        builder.initialize(self.comm)
        self.builder = builder
        design = {"model": wing.model, "parametrization": wing.parametrization, "surface": wing.surface}
        geometry = SurfaceGeometry(**design, numbers=builder.numbers, generation=generation)
        self.add_subsystem("mesh", builder.get_mesh_coordinate_subsystem())
        self.add_subsystem("geometry", geometry, promotes_inputs=list(DESIGN))
        self.mphys_add_scenario("cruise", ScenarioAerodynamic(aero_builder=builder))
        self.connect(f"mesh.{builder.mesh_names[generation]}", f"geometry.{names.geometry_input}")
        self.connect(f"geometry.{names.geometry_output}", "cruise.x_aero")

    def configure(self):
        super().configure()
        if self.options["solver"] == "ADflow":
            problem = AeroProblem("cruise", evalFuncs=["cl", "cd"])
            problem.addDV("alpha", value=1.0, name="aoa", units="deg")
            self.cruise.coupling.mphys_set_ap(problem)
            self.cruise.aero_post.mphys_set_ap(problem)


def flown(wing, solver, generation, comm=None, mode="rev"):
    """A study, run."""
    problem = om.Problem(Study(wing=wing, solver=solver, generation=generation), comm=comm, reports=False)
    problem.setup(mode=mode)
    for name, value in {**DESIGN, **FLOW[solver]}.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


def totals(problem):
    """The total derivatives of a study, of its number of the flow in all variables."""
    solver = problem.model.options["solver"]
    return problem.compute_totals([FUNCTION[solver]], [*DESIGN, *FLOW[solver]], return_format="array")
