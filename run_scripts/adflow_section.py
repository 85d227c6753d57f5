"""ADflow: a transonic section.

A transonic section by RANS and its discrete adjoint: ADflow with the grid movement of bspline_mdao. It needs MPhys and
ADflow, with IDWarp, baseclasses, mpi4py and petsc4py, as described on ADflow's installation page. The section starts as
the NACA 0012 at M 0.73, a Reynolds number of 6.5 million and a lift coefficient of 0.5; points of a lattice and the
angle of attack are variables. It takes ten minutes, and two with ``--quick``; with ``mpirun -n 2 python`` two processes
share the flow. The output is lift, drag and angle at the start and at the optimum, the same on a finer grid that no
optimiser saw, how the optimiser converged, and a picture of the pressures.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import openmdao.api as om
from adflow.mphys import ADflowBuilder
from baseclasses import AeroProblem
from mphys import Multipoint
from mphys.scenarios import ScenarioAerodynamic
from scipy.optimize import root_scalar

import bspline_mdao as bm
from bspline_mdao.design import FreeForm, Lattice, Parametrization
from bspline_mdao.drivers import recorded, scipy_slsqp
from bspline_mdao.generators import naca_section, section_o_grid
from bspline_mdao.measures import EnclosedVolume, SurfaceGrid, Thickness
from bspline_mdao.movers import moving_mesh
from bspline_mdao.mphys import SurfaceGeometry, VolumeWarper, numbers_of_points, rows_of_points
from bspline_mdao.plotting import BLUE, GRAY, figure
from bspline_mdao.scripts import pick_size, run

MACH, REYNOLDS, LIFT, ALPHA = 0.73, 6.5e6, 0.5, 2.9
"""Conditions, and the angle of attack at the start (deg)."""

THINNEST, PLACES = 0.9, (0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95)
"""Lower bounds of the thickness at these parts of the chord, relative to the NACA 0012's."""

CORNERS, HEIGHT = [[0.0, -0.07, 0.0], [1.0, 0.07, 1.0]], 0.01
"""Of the lattice, and the unit of the heights of its points (chords)."""

DRAG, FINER = 0.01, 1.5
"""Unit of the objective, and the cells per direction of the finer grid relative to the grid's."""

SIZES = {"quick": (48, 32, 25), "default": (96, 48, 40), "paper": (192, 104, 60)}
"""Cells around the section and away from it, and iterations at most."""

SOLVER = {"equationType": "RANS", "liftIndex": 2, "MGCycle": "sg", "nCycles": 10000, "forcesAsTractions": False} | {
    **{"useNKSolver": True, "NKSwitchTol": 1e-4, "L2Convergence": 1e-12, "adjointL2Convergence": 1e-10},
    **{"printAllOptions": False, "printIntro": False, "printIterations": False, "printTiming": False},
}
"""Options of ADflow: no multigrid, approximate Newton steps, then Newton's."""


class Warped(ADflowBuilder):
    """ADflow, with the grid movement of bspline_mdao in place of IDWarp unless that is asked for."""

    def __init__(self, model: bm.FittedModel, folder: str, mover: str):
        self.model, self.mover, self.grid = model, mover, f"{folder}/section_{model.n_nodes}.cgns"
        options = SOLVER | {"gridFile": self.grid, "outputDirectory": folder}
        super().__init__(options, restart_failed_analysis=True, write_solution=False)

    def initialize(self, comm):
        """Write the grid, start ADflow on it and find its nodes in the model."""
        if comm.rank == 0:
            bm.write_grid(self.grid, self.model.regenerate())
        comm.barrier()
        super().initialize(comm)
        wall = self.solver.getSurfaceCoordinates(groupName=self.solver.meshFamilyGroup, includeZipper=True)
        self.numbers = numbers_of_points(SurfaceGrid.of(self.model).points, wall, "surface", comm)
        volume = self.solver.mesh.getSolverGrid()
        self.rows = rows_of_points(bm.open_grid(self.grid), self.model.topology, volume, comm=comm)

    def get_pre_coupling_subsystem(self, scenario_name=None):
        """Make what moves the grid."""
        if self.mover == "IDWarp":
            return super().get_pre_coupling_subsystem(scenario_name)
        return VolumeWarper(model=self.model, numbers=self.numbers, rows=self.rows, volume_name="adflow_vol_coords")


class Study(Multipoint):
    """The section at one condition."""

    def initialize(self):
        """Declare the option."""
        self.options.declare("builder", recordable=False)

    def setup(self):
        """Connect mesh, geometry and scenario."""
        builder = self.options["builder"]
        builder.initialize(self.comm)
        geometry = SurfaceGeometry(model=builder.model, numbers=builder.numbers, **shape_of(builder.model))
        self.add_subsystem("angle", om.IndepVarComp("alpha", ALPHA, units="deg"), promotes=["*"])
        self.add_subsystem("mesh", builder.get_mesh_coordinate_subsystem())
        self.add_subsystem("geometry", geometry, promotes_inputs=["heights"], promotes_outputs=["thickness", "volume"])
        self.mphys_add_scenario("cruise", ScenarioAerodynamic(aero_builder=builder))
        self.connect("mesh.x_aero0_mesh", "geometry.x_aero0_geometry_input")
        self.connect("geometry.x_aero0_geometry_output", "cruise.x_aero")

    def configure(self):
        """State the condition, and the problem."""
        super().configure()
        references = {"areaRef": 1.0, "chordRef": 1.0, "xRef": 0.25, "evalFuncs": ["cl", "cd", "cmz"]}
        stream = {"mach": MACH, "reynolds": REYNOLDS, "reynoldsLength": 1.0, "T": 288.15, "alpha": ALPHA}
        flow = AeroProblem(name="cruise", **stream, **references)
        flow.addDV("alpha", value=ALPHA, name="alpha", units="deg")
        self.cruise.coupling.mphys_set_ap(flow)
        self.cruise.aero_post.mphys_set_ap(flow)
        self.connect("alpha", ["cruise.coupling.alpha", "cruise.aero_post.alpha"])
        self.add_design_var("alpha", lower=-2.0, upper=8.0, units="deg")
        self.add_design_var("heights", lower=-0.03, upper=0.03, ref=HEIGHT)
        self.add_constraint("cruise.aero_post.cl", equals=LIFT)
        self.add_constraint("thickness", lower=THINNEST)
        self.add_constraint("volume", lower=1.0)
        self.add_objective("cruise.aero_post.cd", ref=DRAG)


def make_model(n_around: int, n_away: int) -> bm.FittedModel:
    """Make the O-grid about the section, with first cells for y+ about 1, and fit it."""
    return bm.fit_grid(section_o_grid(naca_section(0.12), n_around, far=50.0, n_away=n_away, off_wall=5e-6))


def shape_of(model: bm.FittedModel) -> dict:
    """Points of a lattice around the section that move up and down, both planes alike, and what is measured."""
    mesh, wall = moving_mesh(model), SurfaceGrid.of(model)
    first, second = (np.searchsorted(mesh.surface_ids, mesh.blocks[0][:-1, 0, k]) for k in range(2))
    heights = FreeForm("heights", Lattice.box(CORNERS, n=(8, 2, 2), margin=0.01), np.s_[1:-1, :, 0], "y")
    places = np.column_stack([PLACES, np.zeros(len(PLACES)), np.full(len(PLACES), 0.5)])
    thickness = Thickness.at(wall, places, np.array([0.0, 1.0, 0.0]), relative=True)
    parametrization = Parametrization(mesh, [heights], [bm.constraints.Linked(first, second)])
    return {"parametrization": parametrization, "measures": [thickness, EnclosedVolume.of(wall, relative=True)]}


def main(
    paper: bool = False,
    figures=None,
    quick: bool = False,
    mover: Literal["ours", "IDWarp"] = "ours",
    folder: str = "adflow_section",
) -> dict:
    """Find the section.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`; the quick one stops after some iterations.
    figures : path-like, optional
        Folder for ``adflow_section.png``.
    mover : {"ours", "IDWarp"}
        What moves the grid behind the same variables.
    folder : path-like
        Folder for what ADflow reads and writes.

    Returns
    -------
    dict
        ``n_variables``; the ``run``, see `RecordedRun.numbers`; how many analyses have ``failed``; and ``initial``,
        ``optimum``, ``finer_initial`` and ``finer_optimum``, see `at_lift`.
    """
    *counts, iterations = pick_size(SIZES, paper, quick)
    Path(folder).mkdir(exist_ok=True, parents=True)
    models = make_model(*counts), make_model(*(round(FINER * n) for n in counts))
    problem, finer = (om.Problem(Study(builder=Warped(model, folder, mover)), reports=None) for model in models)
    problem.driver = scipy_slsqp(1e-4, iterations)
    with recorded(problem) as done:
        initial, pressures = at_lift(problem), {"NACA 0012": pressures_of(problem)}
        problem.run_driver()
    found = {"n_variables": problem.get_val("heights").size + 1, "run": done.numbers()}
    found |= {"failed": problem.driver.n_failed_analyses, "initial": initial, "optimum": at_lift(problem)}
    pressures["optimum"] = pressures_of(problem)
    finer.setup()
    found["finer_initial"] = at_lift(finer)
    for name in ("alpha", "heights"):
        finer.set_val(name, problem.get_val(name))
    if figures and problem.comm.rank == 0:
        draw(figures, pressures)
    return found | {"finer_optimum": at_lift(finer)}


def at_lift(problem: om.Problem) -> dict:
    """Find the angle of attack (deg) of the lift, and return the numbers of the flow there."""

    def miss(alpha: float) -> float:
        problem.set_val("alpha", alpha, units="deg")
        problem.run_model()
        return problem.get_val("cruise.aero_post.cl").item() - LIFT

    start = problem.get_val("alpha", units="deg").item()
    alpha = root_scalar(miss, x0=start, x1=start - miss(start) / 0.15, xtol=1e-5).root
    lift, thinnest = LIFT + miss(alpha), problem.get_val("thickness").min()
    drag, moment = (problem.get_val(f"cruise.aero_post.{name}").item() for name in ("cd", "cmz"))
    return {"CL": lift, "CD": drag, "CM": moment, "alpha": alpha, "least_thickness": thinnest}


def wall_of(problem: om.Problem) -> np.ndarray:
    """Nodes of the section, and forces on them over the dynamic pressure, from all processes; shape (2, n, 3)."""
    builder = problem.model.options["builder"]
    moved, flow = problem.get_val("cruise.x_aero", get_remote=False), builder.solver.curAP
    wall = np.zeros((2, *SurfaceGrid.of(builder.model).points.shape))
    mine = builder.numbers, moved.reshape(-1, 3), builder.solver.getForces() / (0.5 * flow.rho * flow.V**2)
    for numbers, nodes, forces in builder.solver.comm.allgather(mine):
        wall[0, numbers] = nodes
        np.add.at(wall[1], numbers, forces)
    return wall


def pressures_of(problem: om.Problem) -> tuple[np.ndarray, np.ndarray]:
    """Places along the chord and pressure coefficients around the section."""
    model = problem.model.options["builder"].model
    ring = numbers_of_points(SurfaceGrid.of(model).points, model.regenerate().blocks[0].nodes[:, 0, 0], "surface")
    nodes, forces = wall_of(problem)[:, ring, :2]
    halves = 0.25 * np.diff(nodes, axis=0)[:, ::-1] * [-1.0, 1.0]  # of the faces between two nodes, outward
    outward = halves + np.roll(halves, 1, axis=0)
    return nodes[:-1, 0], -(forces[:-1] * outward).sum(axis=1) / (outward**2).sum(axis=1)


def draw(folder, found: dict[str, tuple]) -> None:
    """Draw pressures."""
    with figure(folder, "adflow_section", size=(7.0, 4.0)) as canvas:
        axes = canvas.subplots()
        for (name, places), color in zip(found.items(), (GRAY, BLUE)):
            axes.plot(*places, color=color, label=name)
        axes.set(xlabel="$x$, chords", ylabel="$C_p$", ylim=axes.get_ylim()[::-1])
        axes.legend()


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/adflow_section.png'
