"""Twist and planform with OpenAeroStruct.

Twist and planform of least induced drag at fixed lift: the regenerated wing in OpenAeroStruct's vortex lattice. It
takes a minute, and some hours at the paper's size. The output, for the twist of a rectangular wing, for its chord and
for the twist of a swept and tapered wing, is the span efficiencies next to Munk's optimum, how the optimisers
converged, a check of the totals, and a picture of loads, twists and planforms.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.design import Chord, Parametrization, ReferenceAxis, Sweep, Taper, Twist
from bspline_mdao.drivers import nlopt, recorded, scipy_slsqp
from bspline_mdao.flow import VortexLattice, Wake, least_drag
from bspline_mdao.generators import FarField, Spacing, hh_wing_grid, rectangular_wing
from bspline_mdao.measures import CamberSurface, SurfaceGrid
from bspline_mdao.movers import LinearElasticity, moving_mesh
from bspline_mdao.plotting import BLUE, GRAY, ORANGE, draw_ellipse, figure
from bspline_mdao.scripts import run
from bspline_mdao.testing import check_totals

LIFT, ALPHA, MACH = 0.5, 4.0, 0.3
"""Lift coefficient of the area of the rectangular wing, angle of attack (deg) where it is fixed, and Mach number."""

WORST_CORNER = 0.1
"""What the worst cell must keep of its corner triple product of 1, by the bound of `Quality`."""

TOLERANCE = 1e-10
"""Of the objective, the drag relative to the elliptical load's."""

STATIONS = 6
SIZES = {
    False: ((11, 9, 13), (7, 6, 8), (0.01, 0.02, 0.02, 0.02), (3, 11), 0.25),
    True: ((45, 65, 33), (13, 13, 9), (), (5, 31), 0.3),
}
"""Nodes and control points of the grid, its spacing, nodes of the lattice along chord and half span, and the bound of
the chords: where the tip shrinks further, the control mesh tangles. Small, and as the paper's M6 grid (True)."""

CASES = {
    "twist": "twist of the rectangular wing",
    "chord": "chord of the untwisted wing",
    "swept": "twist of a swept and tapered wing",
}
DRIVERS = {"SciPy SLSQP": scipy_slsqp, "NLopt LD_SLSQP": nlopt}
STYLES = {"initial": (GRAY, ":"), "SciPy SLSQP": (ORANGE, "-"), "NLopt LD_SLSQP": (BLUE, "--")}
"""Colours and lines, those that lie on others among them."""


class Wing:
    """The paper's rectangular wing with a lattice on its camber surface, in equal strips."""

    def __init__(self, paper: bool):
        shape, n_control, spacing, self.lattice_shape, self.least_chord = SIZES[paper]
        planform = rectangular_wing().planform
        grid = hh_wing_grid(rectangular_wing(), shape, Spacing(*spacing), FarField(10.0))
        self.model = bm.fit_grid(grid, n_control=n_control)
        self.mesh = moving_mesh(self.model)
        self.lattice = CamberSurface.of(SurfaceGrid.of(self.model, "wing*"), *self.lattice_shape)
        self.area, self.aspect_ratio = 2.0 * planform.root_chord * planform.semi_span, planform.aspect_ratio

    def problem(self, case: str) -> om.Problem:
        """Pose a case. Not yet set up."""
        trailing = ReferenceAxis.of(self.mesh, at=1.0)  # variables about it leave the trace of the wake alone
        twist, chord = Twist("twist", trailing, STATIONS), Chord("chord", trailing, STATIONS)
        swept = [Taper("taper", trailing), twist, Sweep("sweep", trailing)]
        parametrization = Parametrization(self.mesh, {"twist": [twist], "chord": [chord], "swept": swept}[case])
        geometry = bm.GridMovement(
            model=self.model,
            parametrization=parametrization,
            measures=[self.lattice],
            mover=LinearElasticity(self.mesh, n_increments=1),
            fit=False,
        )
        lattice = dict(zip(("n_chord", "n_span"), self.lattice_shape))
        flow = VortexLattice(**lattice, reference_area=self.area)
        problem = om.Problem(reports=None)
        top = problem.model
        top.add_subsystem("geometry", geometry, promotes=["*"])
        top.add_subsystem("flow", flow, promotes=["*"])
        top.set_input_defaults("Mach_number", val=MACH)
        top.set_input_defaults("alpha", val=ALPHA, units="deg")
        if case == "chord":
            top.add_design_var("chord", lower=self.least_chord, upper=1.5, ref=0.3)
            top.add_design_var("alpha", lower=-10.0, upper=10.0, ref=5.0, units="deg")
            top.add_constraint("S_mesh", equals=self.area, ref=self.area, units="m**2")
        else:
            top.add_design_var("twist", lower=-10.0, upper=10.0, ref=5.0, units="deg")
        if case == "swept":
            top.set_input_defaults("taper", val=0.5)
            top.set_input_defaults("sweep", val=25.0, units="deg")
        top.add_constraint("corner_ks", lower=WORST_CORNER)
        top.add_constraint("CL", equals=LIFT)
        top.add_objective("CD", ref=LIFT**2 / (np.pi * self.aspect_ratio))
        return problem


def main(paper: bool = False, figures=None, drivers=DRIVERS) -> dict:
    """Find the least induced drag of every case with every driver.

    Parameters
    ----------
    paper : bool
        12 blocks of 45 x 65 x 33 nodes and 30 strips per half wing; some 15,000 nodes and 10 strips by default.
    figures : path-like, optional
        Folder for ``wing_twist_vlm.png`` and the N2 diagram ``wing_twist_vlm.html``.
    drivers : dict
        Makers of drivers by name.

    Returns
    -------
    dict
        For each case ``totals``, see `check_totals`, `efficiencies` of the ``initial`` wing, and by ``drivers`` the
        same and what `RecordedRun.numbers` returns.
    """
    wing, numbers, wings = Wing(paper), {}, {}
    for case in CASES:
        start = started(wing.problem(case))
        runs = {}
        for driver, make_driver in drivers.items():
            problem = wing.problem(case)
            problem.driver = make_driver(TOLERANCE, 100)
            with recorded(problem) as runs[driver]:
                problem.run_driver()
        wings[case] = {"initial": start, **{name: found.problem for name, found in runs.items()}}
        numbers[case] = {
            "totals": check_totals(perturbed(wing, case))._asdict(),
            "initial": efficiencies(start),
            "drivers": {name: efficiencies(each.problem) | each.numbers("flow") for name, each in runs.items()},
        }
    if figures:
        draw(figures, wings)
        om.n2(wings["chord"]["initial"], outfile=str(Path(figures) / "wing_twist_vlm.html"), show_browser=False)
    return numbers


def started(problem: om.Problem) -> om.Problem:
    """Run a problem where it starts."""
    problem.setup(mode="rev")
    problem.run_model()
    return problem


def perturbed(wing: Wing, case: str) -> om.Problem:
    """Run a case off the symmetry of the initial wing, where some derivatives vanish."""
    problem = started(wing.problem(case))
    for name in problem.model.get_design_vars():
        problem.set_val(name, problem.get_val(name) + np.linspace(0.3, 0.0, problem.get_val(name).size))
    problem.run_model()
    return problem


def wake_of(problem: om.Problem) -> Wake:
    """The wake of a wing at unit speed, the circulations twice as large: its load."""
    trailing, alpha = problem.get_val("camber_surface")[-1], problem.get_val("alpha", units="rad").item()
    heights = trailing[:, 2] * np.cos(alpha) - trailing[:, 0] * np.sin(alpha)
    return Wake(np.column_stack([trailing[:, 1], heights]), problem.get_val("span_load"))


def efficiencies(problem: om.Problem) -> dict:
    """Compare a wing with the ellipse and with Munk's optimum.

    Returns
    -------
    dict
        Span ``efficiency``; ``munk``, the efficiency of the load of least drag on the same wake; the ``gap``, by how
        much the drag is above it; and ``panel_efficiency``, from the forces on the bound vortices.
    """
    wake = wake_of(problem)
    span, best = -2.0 * wake.points[0, 0], least_drag(wake.points, wake.lift)
    elliptic, panel_lift = 2.0 * wake.lift**2 / (np.pi * span**2), problem.get_val("CL_panels").item()
    panel_drag = problem.get_val("CD_panels").item() / panel_lift**2
    return {
        "efficiency": elliptic / wake.drag,
        "munk": elliptic / best.drag,
        "gap": wake.drag / best.drag - 1.0,
        "panel_efficiency": problem.get_val("S_ref").item() / (np.pi * span**2 * panel_drag),
    }


def draw(folder, wings: dict) -> None:
    """Draw span load, twist and planform of every case, before and after."""
    with figure(folder, "wing_twist_vlm", size=(10.0, 7.5)) as canvas:
        panels = canvas.subplots(3, len(wings), sharex=True, sharey="row")
        for (case, problems), (load, twist, planform) in zip(wings.items(), panels.T):
            for name, problem in problems.items():
                color, line = STYLES.get(name, (GRAY, "-"))
                style, wake = {"color": color, "label": name, "linestyle": line}, wake_of(problem)
                span, middles = -2.0 * wake.points[0, 0], -(wake.points[1:, 0] + wake.points[:-1, 0])
                leading, trailing = problem.get_val("camber_surface")[[0, -1]]
                (x, y, z), y = (trailing - leading).T, -2.0 * leading[:, 1] / span
                load.plot(middles / span, wake.circulations * span / wake.lift, **style)
                twist.plot(y, np.degrees(np.arctan2(-z, x)), **style)
                planform.plot(y, np.column_stack([leading[:, 0], trailing[:, 0]]), **style)
            best = least_drag(wake.points, 1.0).circulations * span
            load.plot(middles / span, best, "k.", markersize=4, label="Munk, same strips")
            draw_ellipse(load)
            load.set(title=CASES[case], xlabel="")
            planform.set(xlabel="$2 y / b$", xlim=(0.0, 1.0))
        for axes, label in zip(panels[:, 0], ("load relative to its mean", "twist (deg)", "$x$ (m)")):
            axes.set_ylabel(label)
        panels[2, 0].invert_yaxis()


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/wing_twist_vlm.png'
