"""ADflow: twist and camber of a swept wing.

Twist and camber of a swept wing by RANS and its discrete adjoint: ADflow with the movement of bspline_mdao. It needs
MPhys and ADflow, with IDWarp, baseclasses, mpi4py and petsc4py, as described on ADflow's installation page. The half
wing has a semi-span of three root chords, a taper of a half and a leading edge that is swept by 20 degrees. It starts
with NACA 0012 sections and no twist, at M 0.5, a Reynolds number of 5 million and a lift coefficient of 0.4. Angle of
attack, twist and camber at stations are the variables; thickness stays as it is. It takes four minutes, and ``mpirun -n
2 python`` shares the flow between two processes. The output is lift, drag, angle, twist and camber at the start and at
the optimum, the same on a finer grid that no optimiser saw, how the optimiser converged, and a picture of twist and
camber along the span. Grids as coarse as these show that the chain works, not the drag.
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
from bspline_mdao.design import Camber, Parametrization, ReferenceAxis, Twist
from bspline_mdao.drivers import recorded, scipy_slsqp
from bspline_mdao.generators import FarField, Planform, Spacing, Wing, hh_wing_grid, naca_section
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.mphys import SurfaceGeometry, VolumeWarper, numbers_of_points, rows_of_points
from bspline_mdao.plotting import BLUE, GRAY, figure
from bspline_mdao.scripts import pick_size, run

PLANFORM = Planform(root_chord=1.0, semi_span=3.0, taper=0.5, leading_edge_sweep=20.0)
CHORD = 0.75
"""Mean chord; times the semi-span it is the area of the half wing that the grid shows."""

MACH, REYNOLDS, LIFT, ALPHA = 0.5, 5e6, 0.4, 5.0
"""Conditions, with the Reynolds number of the root chord, and the angle of attack at the start (deg)."""

STATIONS = (0.0, 0.5, 1.0)
"""Along the span, from root to tip, of twist and camber; at the root the angle of attack is the twist."""

ANGLE, CAMBER, DRAG = 1.0, 0.01, 0.01
"""Units of angles (deg), of camber (chords) and of the objective."""

SPACING = Spacing(off_wall=3e-5, leading=1e-2, trailing=2e-2, tip=0.03, root=0.4)
"""Heights and lengths of the first cells (root chords): for y+ of some units."""

SIZES = {
    "quick": ((7, 11, 7), (13, 13), (7, 5), 12),
    "default": ((7, 13, 7), (15, 15), (9, 6), 12),
    "paper": ((13, 25, 13), (25, 25), (17, 11), 30),
}
"""Nodes of the rows of blocks along the stream, away from the wing and along the span; iterations at most."""

FINER = 1.3
"""Cells per direction of the finer grid relative to the grid's."""

SOLVER = {"equationType": "RANS", "liftIndex": 2, "MGCycle": "sg", "nCycles": 10000, "forcesAsTractions": False} | {
    **{"useNKSolver": True, "NKSwitchTol": 1e-4, "L2Convergence": 1e-12, "adjointL2Convergence": 1e-10},
    **{"printAllOptions": False, "printIntro": False, "printIterations": False, "printTiming": False},
}
"""Options of ADflow: no multigrid, approximate Newton steps, then Newton's."""


class Warped(ADflowBuilder):
    """ADflow, with the grid movement of bspline_mdao in place of IDWarp unless that is asked for."""

    def __init__(self, model: bm.FittedModel, folder: str, mover: str):
        self.model, self.mover, self.grid = model, mover, f"{folder}/wing_{model.n_nodes}.cgns"
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
    """The wing at one condition."""

    def initialize(self):
        """Declare the option."""
        self.options.declare("builder", recordable=False)

    def setup(self):
        """Connect mesh, geometry and scenario."""
        builder = self.options["builder"]
        builder.initialize(self.comm)
        mesh = moving_mesh(builder.model)
        axis = ReferenceAxis.of(mesh, at=1.0)
        shape = Parametrization(mesh, [Twist("twist", axis, STATIONS), Camber("camber", axis, STATIONS)])
        geometry = SurfaceGeometry(model=builder.model, numbers=builder.numbers, parametrization=shape)
        self.add_subsystem("angle", om.IndepVarComp("alpha", ALPHA, units="deg"), promotes=["*"])
        self.add_subsystem("mesh", builder.get_mesh_coordinate_subsystem())
        self.add_subsystem("geometry", geometry, promotes_inputs=["twist", "camber"])
        self.mphys_add_scenario("cruise", ScenarioAerodynamic(aero_builder=builder))
        self.connect("mesh.x_aero0_mesh", "geometry.x_aero0_geometry_input")
        self.connect("geometry.x_aero0_geometry_output", "cruise.x_aero")

    def configure(self):
        """State the condition, and the problem."""
        super().configure()
        references = {"areaRef": CHORD * PLANFORM.semi_span, "chordRef": CHORD, "evalFuncs": ["cl", "cd"]}
        stream = {"mach": MACH, "reynolds": REYNOLDS, "reynoldsLength": 1.0, "T": 288.15, "alpha": ALPHA}
        flow = AeroProblem(name="cruise", **stream, **references)
        flow.addDV("alpha", value=ALPHA, name="alpha", units="deg")
        self.cruise.coupling.mphys_set_ap(flow)
        self.cruise.aero_post.mphys_set_ap(flow)
        self.connect("alpha", ["cruise.coupling.alpha", "cruise.aero_post.alpha"])
        self.add_design_var("alpha", lower=-2.0, upper=10.0, ref=ANGLE, units="deg")
        self.add_design_var("twist", indices=[1, 2], lower=-8.0, upper=8.0, ref=ANGLE, units="deg")
        self.add_design_var("camber", lower=-0.01, upper=0.04, ref=CAMBER)
        self.add_constraint("cruise.aero_post.cl", equals=LIFT, ref=0.1)
        self.add_objective("cruise.aero_post.cd", ref=DRAG)


def make_model(*shape) -> bm.FittedModel:
    """Make the grid of twelve blocks about the wing, and fit it."""
    wing = Wing(PLANFORM, naca_section(0.12))
    return bm.fit_grid(hh_wing_grid(wing, shape, SPACING, FarField(20.0, 0.05)))


def main(
    paper: bool = False,
    figures=None,
    quick: bool = False,
    mover: Literal["ours", "IDWarp"] = "ours",
    folder: str = "adflow_wing",
) -> dict:
    """Find twist and camber.

    Parameters
    ----------
    paper, quick : bool
        Another of `SIZES`; the quick one stops after some iterations.
    figures : path-like, optional
        Folder for ``adflow_wing.png``.
    mover : {"ours", "IDWarp"}
        What moves the grid behind the same variables.
    folder : path-like
        Folder for what ADflow reads and writes.

    Returns
    -------
    dict
        ``n_nodes`` of the grid and of the finer one; the ``run``, see `RecordedRun.numbers`; how many analyses have
        ``failed``; and ``initial``, ``optimum``, ``finer_initial`` and ``finer_optimum``, see `at_lift`.
    """
    *shape, iterations = pick_size(SIZES, paper, quick)
    Path(folder).mkdir(exist_ok=True, parents=True)
    model = make_model(*shape)
    models = model, model.member(FINER)
    problem, finer = (om.Problem(Study(builder=Warped(each, folder, mover)), reports=None) for each in models)
    problem.driver = scipy_slsqp(1e-3, iterations)
    with recorded(problem) as done:
        initial = at_lift(problem)
        problem.run_driver()
    found = {"n_nodes": [each.n_nodes for each in models], "run": done.numbers()}
    found |= {"failed": problem.driver.n_failed_analyses, "initial": initial, "optimum": at_lift(problem)}
    finer.setup()
    found["finer_initial"] = at_lift(finer)
    for name in ("alpha", "twist", "camber"):
        finer.set_val(name, problem.get_val(name))
    found["finer_optimum"] = at_lift(finer)
    if figures and problem.comm.rank == 0:
        draw(figures, found)
    return found


def at_lift(problem: om.Problem) -> dict:
    """Find the angle of attack (deg) of the lift, and return the numbers of flow and wing there."""

    def miss(alpha: float) -> float:
        problem.set_val("alpha", alpha, units="deg")
        problem.run_model()
        return problem.get_val("cruise.aero_post.cl").item() - LIFT

    start = problem.get_val("alpha", units="deg").item()
    alpha = root_scalar(miss, x0=start, x1=start - miss(start) / 0.08, xtol=1e-5).root
    flow = {"CL": LIFT + miss(alpha), "CD": problem.get_val("cruise.aero_post.cd").item(), "alpha": alpha}
    return flow | {name: problem.get_val(name).tolist() for name in ("twist", "camber")}


def draw(folder, found: dict) -> None:
    """Draw angles and camber along the span."""
    with figure(folder, "adflow_wing", size=(8.0, 3.6)) as canvas:
        angle, camber = canvas.subplots(1, 2)
        for name, color in (("initial", GRAY), ("optimum", BLUE)):
            style = {"color": color, "label": f"{name}: {1e4 * found[name]['CD']:.1f} counts"}
            angle.plot(STATIONS, np.add(found[name]["alpha"], found[name]["twist"]), "o", **style)
            camber.plot(STATIONS, 100.0 * np.array(found[name]["camber"]), "o", **style)
        angle.legend(fontsize=8)
        for axes, label in zip((angle, camber), ("angle of sections (deg)", "camber (% of the chord)")):
            axes.set(xlabel="part of the span", ylabel=label)


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/adflow_wing.png'
