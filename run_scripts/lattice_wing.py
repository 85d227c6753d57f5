"""The paper's rectangular wing with a lattice on its camber surface: what the optimisations with a flow share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import openmdao.api as om

from bspline_mdao import (
    CamberSurface,
    FittedModel,
    GridMovement,
    LinearElasticity,
    Spacing,
    fit_grid,
    hh_wing_grid,
    moving_mesh,
    rectangular_wing,
)
from bspline_mdao.design.parametrization import Parametrization
from bspline_mdao.design.reference_axis import ReferenceAxis
from bspline_mdao.design.variable import Variable
from bspline_mdao.measures.measure import Measure
from bspline_mdao.mesh.moving_mesh import MovingMesh
from bspline_mdao.mesh.surface import SurfaceGrid

WORST_CORNER = 0.1
"""What the worst cell must keep of its corner triple product of 1, by the bound of `Quality`."""

LINES = {"initial": ":", "NLopt LD_SLSQP": "--"}
"""Styles of lines in figures, those that lie on others among them."""


@dataclass(frozen=True)
class Size:
    """Nodes and control points of the grid, nodes of the lattice, stations of variables, and the bound of their chords.

    Where the chord of the tip shrinks further than that bound, the control mesh tangles.
    """

    shape: tuple[int, int, int]
    n_control: tuple[int, int, int]
    n_chord: int
    n_span: int
    stations: int
    least_chord: float


SIZES = {
    False: Size((11, 9, 13), (7, 6, 8), n_chord=3, n_span=11, stations=6, least_chord=0.25),
    True: Size((45, 65, 33), (13, 13, 9), n_chord=5, n_span=31, stations=6, least_chord=0.3),
}
"""Small and at the paper's size of the M6 grid."""


@dataclass(frozen=True, eq=False)
class RectangularWing:
    """The fitted grid about the paper's rectangular wing, and what the optimisations share.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.
    size : Size
        Its size and the lattice's.
    """

    model: FittedModel
    size: Size

    @classmethod
    def of(cls, paper: bool, **changes: int) -> RectangularWing:
        """Make and fit the grid of one of `SIZES`, some of its entries changed."""
        size = replace(SIZES[paper], **changes)
        spacing = Spacing() if paper else Spacing(0.01, 0.02, 0.02, 0.02)
        return cls(fit_grid(hh_wing_grid(rectangular_wing(), size.shape, spacing), n_control=size.n_control), size)

    @cached_property
    def mesh(self) -> MovingMesh:
        """Its control mesh."""
        return moving_mesh(self.model)

    @cached_property
    def lattice(self) -> CamberSurface:
        """The lattice: equal strips, for which the discrete optimum is known in closed form."""
        return CamberSurface.of(SurfaceGrid.of(self.model, "wing*"), self.size.n_chord, self.size.n_span)

    @cached_property
    def trailing_edge(self) -> ReferenceAxis:
        """Axis that variables work about, so that they leave the trace of the wake alone."""
        return ReferenceAxis.of(self.mesh, at=1.0)

    @cached_property
    def area(self) -> float:
        """Area of the whole wing (m^2)."""
        planform = rectangular_wing().planform
        return 2.0 * planform.root_chord * planform.semi_span

    @property
    def aspect_ratio(self) -> float:
        """Aspect ratio of the whole wing."""
        return rectangular_wing().planform.aspect_ratio

    def problem(self, variables: Sequence[Variable], flow: om.Group) -> om.Problem:
        """Wire variables, surface, grid with its quality, and a flow. Not yet set up."""
        problem = om.Problem(reports=None)
        geometry = moved_grid(self.model, self.mesh, variables, [self.lattice])
        problem.model.add_subsystem("geometry", geometry, promotes=["*"])
        problem.model.add_subsystem("flow", flow, promotes=["*"])
        problem.model.add_constraint("corner_ks", lower=WORST_CORNER)
        return problem


def started(problem: om.Problem) -> om.Problem:
    """Run a problem where it starts."""
    problem.setup(mode="rev")
    problem.run_model()
    return problem


def moved_grid(
    model: FittedModel,
    mesh: MovingMesh,
    variables: Sequence[Variable],
    measures: Sequence[Measure],
    n_increments: int = 1,
) -> GridMovement:
    """Chain from variables to a grid that is moved by elasticity, its measures and its quality."""
    return GridMovement(
        model=model,
        parametrization=Parametrization(mesh, variables),
        measures=measures,
        mover=LinearElasticity(mesh, n_increments=n_increments),
        fit=False,
    )
