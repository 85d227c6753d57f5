"""A fitted grid about a wing in a flow of the whole grid: what the optimisations with such a flow share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
import openmdao.api as om
from euler_runs import wall_quads
from lattice_wing import moved_grid
from optimisation import Drivers, optimise

from bspline_mdao import (
    EulerFlow,
    FittedModel,
    LatticeFlow,
    OnPatch,
    SurfaceGrid,
    moving_mesh,
)
from bspline_mdao.design.reference_axis import ReferenceAxis
from bspline_mdao.design.selection import Selection
from bspline_mdao.design.variable import Variable
from bspline_mdao.flow.span_strips import SpanStrips
from bspline_mdao.measures.measure import Measure
from bspline_mdao.mesh.moving_mesh import MovingMesh
from bspline_mdao.names import GRID


class Flow(NamedTuple):
    """A kind of flow: its group, and what of its drag an optimiser is given."""

    group: type[om.Group]
    drag: str


FLOWS = {"euler": Flow(EulerFlow, "CD_induced + CD_entropy"), "vortex": Flow(LatticeFlow, "CD_induced")}
"""By name. Of the forces on the wall the drag is mostly that of the grid: it is taken from the wake and the entropy."""

OPTIONS = {
    "flow": {"choices": tuple(FLOWS), "default": "euler", "help": "Euler equations or vortex lattice"},
    "quick": {"action": "store_true", "help": "a variant of about a minute"},
}
"""Options of the command line."""


STREAM_AXES = np.eye(3)[[0, 2, 1]]
"""Downstream, along the span, up."""


class Scale(NamedTuple):
    """Reference lengths of the half model: area (m^2), chord and the point that moments are about (m)."""

    area: float
    chord: float = 1.0
    moment_reference: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class FlownWing:
    """A wing that is designed in a flow.

    Parameters
    ----------
    model : FittedModel
        The fitted grid, its x axis downstream and its y axis up.
    flow : str
        One of `FLOWS`.
    scale : Scale
        What coefficients are made with, whatever becomes of the wing.
    n_increments : int
        Of the mover.
    """

    model: FittedModel
    flow: str
    scale: Scale
    n_increments: int = 1

    @cached_property
    def mesh(self) -> MovingMesh:
        """Its control mesh."""
        return moving_mesh(self.model)

    @cached_property
    def surface(self) -> SurfaceGrid:
        """Its wall."""
        return SurfaceGrid.of(self.model, "wing*")

    @cached_property
    def sides(self) -> Selection:
        """Control points on one side or the other: not those of the edges and the tip, which the sides share."""
        upper, lower = (OnPatch(self.model, f"wing_{side}") for side in ("upper", "lower"))
        return (upper & ~lower) | (lower & ~upper)

    def axis(self, at: float) -> ReferenceAxis:
        """Axis at a part of the chord."""
        return ReferenceAxis.of(self.mesh, at=at)

    def problem(self, variables: Sequence[Variable], mach: float, measures: Sequence[Measure] = ()) -> om.Problem:
        """Wire variables, measures, grid with its quality, and the flow with its ``drag``. Not yet set up."""
        problem, (make_flow, drag) = om.Problem(reports=None), FLOWS[self.flow]
        geometry = moved_grid(self.model, self.mesh, variables, measures, self.n_increments)
        reference = {f"reference_{name}": getattr(self.scale, name) for name in ("area", "chord")}
        flow = make_flow(model=self.model, **reference, moment_reference=self.scale.moment_reference)
        problem.model.add_subsystem("geometry", geometry, promotes=["*"])
        problem.model.add_subsystem("flow", flow, promotes=["*"])
        problem.model.add_subsystem("drag", om.ExecComp(f"drag = {drag}"), promotes=["*"])
        problem.model.set_input_defaults("Mach_number", val=mach)
        return problem

    def strip_edges(self, problem: om.Problem) -> np.ndarray:
        """Where the strips of ``span_load`` begin and end along the half span (m), from the tip to the root."""
        if self.flow == "vortex":
            return -problem.get_val("camber_surface")[-1, :, 1]
        strips = SpanStrips.of(self.wall_quads, self.baseline, STREAM_AXES)
        return np.abs(strips.trailing @ problem.get_val(GRID).reshape(-1, 3) @ strips.axes[1])

    @cached_property
    def baseline(self) -> np.ndarray:
        """Nodes of the grid where the design starts, shape (n, 3) (m)."""
        return self.model.regenerate().to_vector().reshape(-1, 3)

    @cached_property
    def wall_quads(self) -> np.ndarray:
        """Rows of the grid at the corners of the wall faces, shape (n, 4), in the order of ``Cp``."""
        return wall_quads(self.model)


def control_counts(rows: Sequence[Sequence[int]]) -> list[tuple[int, int, int]]:
    """Control points of every block of a wing's grid, of counts per row as `hh_wing_grid` takes those of nodes."""
    return [(stream, normal, span) for span, normal, stream in product(*rows[::-1])]


def size_of(sizes: dict, paper: bool, quick: bool):
    """Pick ``"paper"``, ``"quick"`` or else ``"default"`` of the sizes of a problem."""
    return sizes["paper" if paper else "quick" if quick else "default"]


def optimise_with(drivers: Drivers, make_problem, tolerance: float, n_iterations: int, cases: Path | None, name: str):
    """Solve a problem with every driver; the cases are kept in a folder if there is one.

    Returns
    -------
    dict of Run
        By the names of the drivers.
    """
    files = {key: cases and Path(cases) / f"{name}_{key.lower().replace(' ', '_')}.sql" for key in drivers}
    return {key: optimise(make_problem, make(tolerance, n_iterations), files[key]) for key, make in drivers.items()}
