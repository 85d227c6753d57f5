"""The design surface of a fitted grid and the objects made for it: one place to start.

Mesh, surface, axis, parametrization and the group `GridMovement` must share one model and one design surface.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from ..design.junction import Junction
from ..design.parametrization import Parametrization
from ..design.reference_axis import ReferenceAxis
from ..design.variable import Variable
from ..measures.area import ProjectedArea
from ..measures.measure import Measure
from ..measures.thickness import within_edges
from ..mesh.boundary import Selection, moving_mesh
from ..mesh.curved_sides import Sliding
from ..mesh.moving_mesh import MovingMesh
from ..mesh.node_mesh import node_mesh, part_of_nodes
from ..mesh.surface import SurfaceGrid
from ..model.model import Model
from ..model.movable import Movable
from ..movement.default_mover import default_mover
from .grid_movement import GridMovement

__all__ = ["DesignSurface"]


@dataclass(frozen=True, eq=False)
class DesignSurface(OneLine):
    """The design surface of a fitted grid, with its control mesh, nodes, axis and edges. Made by `of`.

    Its attributes are the objects otherwise made by hand from the same model and patches:

    ===================  ===============================================================================================
    attribute            is
    ===================  ===============================================================================================
    ``model``            the fitted grid
    ``mesh``             ``moving_mesh(model, design)``: the control mesh that moves
    ``surface``          ``SurfaceGrid.of(model, design)``: the nodes that are measured
    ``axis``             ``ReferenceAxis.of(mesh)``: the quarter chord; `axis_at` for another part of the chord
    ``leading_edge``     points on the edges of sections across the span, as in ``Thickness.grid``; for a wing that
    ``trailing_edge``    starts at a fuselage, from where sections are complete
    ``planform_area``    area of ``surface`` seen along the normal to its planform (m^2): half the wing's if the grid
                                                  shows one half
    `part`               some of its patches, for variables and measures of their own
    `parametrization`    ``Parametrization(mesh, variables, constraints)``
    `grid_movement`      ``GridMovement(model=model, parametrization=..., measures=...)``
    ===================  ===============================================================================================

    Parameters
    ----------
    model : FittedModel, LocalModel or MeshModel
        The fitted grid, an unstructured mesh, or one process's part of it.
    mesh : MovingMesh
        Its control mesh.
    surface : SurfaceGrid
        The nodes of the design surface.
    control_mesh : MovingMesh, optional
        The control mesh, if ``mesh`` has the surface nodes instead, see `of_nodes`.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import Twist
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> wing = DesignSurface.of(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)))
    >>> round(wing.planform_area, 3)
    1.159
    >>> twist = Twist("twist", wing.axis, stations=3)
    >>> wing.parametrization([twist]).initial["twist"]
    array([0., 0., 0.])
    """

    model: Movable
    mesh: MovingMesh
    surface: SurfaceGrid
    control_mesh: MovingMesh | None = None

    @classmethod
    def of(
        cls,
        model: Movable,
        design: str | Sequence[str] | None = None,
        *,
        fixed: Selection | Sequence[Selection] = (),
        released: str | Sequence[str] = (),
        sliding: Sliding = (),
    ) -> DesignSurface:
        """Take patches of a fitted grid as the design surface.

        Parameters
        ----------
        model : FittedModel, LocalModel or MeshModel
            The fitted grid, an unstructured mesh, or one process's part of it.
        design : str or sequence of str, optional
            Patches by name or pattern (``"wing*"``); all walls by default.
        fixed, released, sliding
            What the rest of the boundary does, see `moving_mesh`.

        Returns
        -------
        DesignSurface

        Raises
        ------
        InputError
            As `moving_mesh`.
        """
        mesh = moving_mesh(model, design, fixed, released, sliding)
        return cls(model, mesh, SurfaceGrid.of(model, design))

    @classmethod
    def of_nodes(
        cls,
        model: Model,
        design: str | Sequence[str] | None = None,
        *,
        fixed: Selection | Sequence[Selection] = (),
        released: str | Sequence[str] = (),
        sliding: Sliding = (),
    ) -> DesignSurface:
        """Take the nodes of patches as the design surface, instead of their control points.

        Variables move the nodes, control points follow them, and the grid matches them exactly. So a wing can slide on
        a body with a `Junction`, and the nodes on both are exactly where the variables put them.

        Parameters
        ----------
        model : FittedModel
            The fitted grid, one-to-one.
        design, fixed, released, sliding
            As of `of`.

        Returns
        -------
        DesignSurface

        Raises
        ------
        InputError
            As `moving_mesh`; also if the grid has periodic faces.
        """
        control_mesh, surface = moving_mesh(model, design, fixed, released, sliding), SurfaceGrid.of(model, design)
        return cls(model, node_mesh(model, surface), surface, control_mesh)

    def part(self, design: str | Sequence[str]) -> DesignSurface:
        """Take some of its patches, such as a flap, for variables and measures of their own.

        Parameters
        ----------
        design : str or sequence of str
            Design patches by name or pattern (``"flap*"``).

        Returns
        -------
        DesignSurface
            With axis, edges and nodes of the part; its variables move it as `OfPart`.

        Raises
        ------
        InputError
            If there is no such patch, or one of them is not designed.
        """
        if self.control_mesh is not None:
            mesh = part_of_nodes(self.mesh, self.surface, design)
            return DesignSurface(self.model, mesh, SurfaceGrid.of(self.model, design), self.control_mesh)
        mesh = moving_mesh(self.model, design)
        idle = self.mesh.surface_rows[mesh.surface_ids] < 0
        if idle.any():
            where = mesh.place_of_surface_point(int(np.argmax(idle)))
            raise InputError(f"part of a design surface: {where} is not designed; take patches that are")
        return DesignSurface(self.model, mesh, SurfaceGrid.of(self.model, design))

    @cached_property
    def axis(self) -> ReferenceAxis:
        """The quarter chord from the root to the tip, one object for all variables."""
        return self.axis_at(0.25)

    def axis_at(self, part: float, **options: Any) -> ReferenceAxis:
        """Find the axis at another fraction of the chord: 0 is the leading edge, 1 the trailing edge.

        Parameters
        ----------
        part : float
            Fraction of the chord, the same in every section.
        **options
            ``n``, ``span`` and ``surface`` of `ReferenceAxis.of`.

        Returns
        -------
        ReferenceAxis

        Raises
        ------
        InputError
            As `ReferenceAxis.of`.
        """
        return ReferenceAxis.of(self.mesh, at=part, **options)

    @property
    def leading_edge(self) -> np.ndarray:
        """Points of the leading edge on the baseline (m), shape (n, 3), from 2 % to 98 % of the span."""
        return self._edges[0]

    @property
    def trailing_edge(self) -> np.ndarray:
        """Points of the trailing edge on the baseline (m), shape (n, 3), from 2 % to 98 % of the span."""
        return self._edges[1]

    @cached_property
    def _edges(self) -> tuple[np.ndarray, np.ndarray]:
        return within_edges(self.surface, chord=(0.0, 1.0))

    @cached_property
    def planform_area(self) -> float:
        """Area of the surface on the baseline as seen along the normal to its planform (m^2)."""
        return float(ProjectedArea.of(self.surface).evaluate(self.surface.points)[0])

    def parametrization(
        self, variables: Sequence[Variable], constraints: Sequence = (), junction: Junction | None = None
    ) -> Parametrization:
        """Combine design variables, and linear constraints among control points, into one parametrization of its mesh.

        Parameters
        ----------
        variables : sequence of Variable
            Applied in this order.
        constraints : sequence of LinearConstraint
            Handled by elimination.
        junction : Junction, optional
            Where a wing slides on a body that keeps its shape; the design surface contains both.

        Returns
        -------
        Parametrization

        Raises
        ------
        InputError
            As `Parametrization`.
        """
        return Parametrization(self.mesh, variables, constraints, junction)

    def grid_movement(
        self,
        variables: Sequence[Variable],
        constraints: Sequence = (),
        measures: Sequence[Measure] = (),
        junction: Junction | None = None,
        **options: Any,
    ) -> GridMovement:
        """Make the group that moves the grid with the design variables.

        Parameters
        ----------
        variables, constraints, junction
            See `parametrization`.
        measures : sequence of Measure
            What is measured of ``surface``, or of other surfaces of the model.
        **options
            Other options of `GridMovement`, such as a ``mover`` of ``mesh``, or of ``control_mesh``.

        Returns
        -------
        GridMovement

        Raises
        ------
        InputError
            As `Parametrization`.
        """
        parametrization = self.parametrization(variables, constraints, junction)
        if self.control_mesh is not None:
            options = {"mover": default_mover(self.model, self.control_mesh), "surface": self.surface, **options}
        return GridMovement(model=self.model, parametrization=parametrization, measures=measures, **options)
