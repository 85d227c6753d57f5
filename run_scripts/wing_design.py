"""Wings designed for little drag: what is solved, told and drawn of each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import openmdao.api as om
from common import GRAY, figure
from euler_runs import nodes_of
from flown_wing import FlownWing, optimise_with
from history import COLORS, draw_course, draw_objective
from optimisation import Drivers, Run, flow_in_one, set_up, write_n2
from totals import check_totals, move_at_random
from wing_drawings import draw_ellipse, draw_load, draw_planform, draw_sections, draw_twist

from bspline_mdao.cells.grid_quality import GridQuality
from bspline_mdao.cells.report import report_quality
from bspline_mdao.names import GRID

TOLD = ("CL", "CD", "CD_induced", "CD_entropy", "drag", "volume", "projected_area")
"""Outputs that are told of a wing where there are any."""

PARTS = (0.05, 0.5, 0.9)
"""Sections that are drawn, in parts of the half span."""


@dataclass(frozen=True)
class Size:
    """Nodes and control points of the rows of blocks, see `hh_wing_grid`, stations of variables, and a tolerance.

    The tolerance is that of the objective in units of the driver.
    """

    shape: tuple
    n_control: tuple
    stations: int
    tolerance: float


@dataclass(frozen=True, eq=False)
class Study:
    """A design, solved.

    Parameters
    ----------
    name : str
        Of its files.
    wing : FlownWing
        Where it starts.
    pose : callable
        Makes the problem, not set up.
    drag_unit : float
        For the figure.
    start : om.Problem
        The wing at the start.
    runs : dict of Run
        By the names of the drivers.
    """

    name: str
    wing: FlownWing
    pose: Callable[[], om.Problem]
    start: om.Problem
    runs: dict[str, Run]

    @classmethod
    def of(cls, name: str, wing: FlownWing, pose: Callable, drivers: Drivers, tolerance: float, figures) -> Study:
        """Solve a design with every driver; cases are recorded in the folder of the figures if there is one."""
        runs = optimise_with(drivers, pose, tolerance, 100, figures, name)
        return cls(name, wing, pose, set_up(pose()), runs)

    @property
    def wings(self) -> dict[str, om.Problem]:
        """Problems at the start and at the optima, by name."""
        return {"initial": self.start, **{name: found.problem for name, found in self.runs.items()}}

    def numbers(self) -> dict:
        """Collect ``n_nodes``, ``n_variables``, `told` of the ``initial`` wing and by ``drivers``, and ``totals``."""
        variables = self.start.model.get_design_vars()
        return {
            "n_nodes": self.wing.model.n_nodes,
            "n_variables": sum(self.start.get_val(name).size for name in variables),
            "initial": self.told(self.start),
            "drivers": {name: flow_in_one(found) | self.told(found.problem) for name, found in self.runs.items()},
            "totals": check_totals(move_at_random(set_up(self.pose())), n_directions=1, step=0.02, levels=2),
        }

    def draw(self, folder) -> None:
        """Draw planform, sections and load at the start and at the optima, and the histories; write the N2 diagram."""
        write_n2(self.start, folder, self.name)
        with figure(folder, self.name, (9.5, 9.0)) as canvas:
            (planform, sections), (load, twist), (drag, course) = canvas.subplots(3, 2)
            for name, problem in self.wings.items():
                style = {"color": COLORS.get(name, GRAY), "label": name}
                draw_planform(planform, self.wing.model, problem.get_val(GRID), style)
                draw_sections(sections, self.wing.model, problem.get_val(GRID), PARTS, style)
                draw_load(load, self.wing.strip_edges(problem), problem.get_val("span_load"), style)
                draw_twist(twist, self.wing.model, problem.get_val(GRID), style)
            draw_ellipse(load)
            draw_objective(drag, self.runs, "drag", 1e-4, "drag (counts)")
            draw_course(course, self.runs)
            planform.set(xlabel="$z$ (m)", ylabel="$x$ (m)", aspect="equal")
            planform.invert_yaxis()
            sections.set(xlabel="$x / c$", ylabel="$y / c$", aspect="equal")
            planform.legend()

    def told(self, problem: om.Problem) -> dict:
        """Give what of `TOLD` there is, the variables but those of single control points, and invalid cells."""
        names = {meta["prom_name"] for _, meta in problem.model.list_outputs(out_stream=None)}
        variables = [name for name in problem.model.get_design_vars() if not name.endswith("heights")]
        wanted = [*(name for name in TOLD if name in names), *variables]
        cells = report_quality(GridQuality.of_baseline(self.wing.model.regenerate()), nodes_of(problem))
        counts = {"min_corner": cells.min_corner, "n_inverted": cells.n_inverted}
        return {name: problem.get_val(name).copy().squeeze() for name in wanted} | counts
