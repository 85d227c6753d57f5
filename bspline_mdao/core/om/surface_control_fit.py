"""Surface control points fitted to surface nodes, as an OpenMDAO component."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import openmdao.api as om
from openmdao.vectors.vector import Vector

from ...names import SURFACE, SURFACE_CONTROL_POINTS
from ..fit.surface_fit import LOGGER, Followed, SurfaceMiss, follower_of
from ..mesh.moving_mesh import MovingMesh
from ..mesh.surface import SurfaceGrid
from ..mesh.surface_map import SurfaceMap
from ..model.movable import Movable
from ..movement.mover import PLANE_TOLERANCE
from .checked_along_edges import CheckedAlongEdges, check_along_edges, lines_among
from .component import (
    LastState,
    add_product,
    as_node_numbers,
    fails_together,
    failures_as_analysis_errors,
    finite_points,
)
from .model_option import declare_model


class SurfaceControlFit(CheckedAlongEdges, om.ExplicitComponent):
    """Let the surface control points follow surface nodes smoothly, and rigid motions exactly.

    They are a quasi-interpolant of the nodes, which does not oscillate at kinks as least squares do. `GridEvaluate`
    corrects the remaining error and puts the nodes exactly at their given positions. Control points on symmetry planes
    stay in them. See `bspline_mdao.core.fit.surface_fit`.

    ==========================  ======  =============  =====  ======================================================
    name                        role    shape          units  meaning
    ==========================  ======  =============  =====  ======================================================
    ``surface``                 input   (3 n)          m      nodes of the `SurfaceGrid`, or only ``numbers`` of them,
                                                              xyz interleaved
    ``surface_control_points``  output  (3 n_surface)  m      control points on the design surface, in the order of the
                                                              mesh's ``surface_ids``
    ==========================  ======  =============  =====  ======================================================

    Options
    -------
    model : FittedModel or MeshModel
        The fitted grid; or an unstructured mesh, whose surface control points are the nodes themselves.
    mesh : MovingMesh
        Its control mesh, which defines the design surface.
    surface : SurfaceGrid
        Which nodes.
    numbers : sequence of int, optional
        Which of these nodes are given; all by default.

    Raises
    ------
    InputError
        In ``setup``, if the nodes do not determine the control points, or also depend on others.
    om.AnalysisError
        In a run, if a node is not finite or leaves a symmetry plane.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import SurfaceControlFit, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.measures import SurfaceGrid
    >>> from bspline_mdao.movers import moving_mesh
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> surface = SurfaceGrid.of(model)
    >>> problem = om.Problem(reports=None)
    >>> component = SurfaceControlFit(model=model, mesh=moving_mesh(model), surface=surface)
    >>> _ = problem.model.add_subsystem("body", component, promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.set_val("surface", 1.1 * surface.points.ravel())
    >>> problem.run_model()
    >>> problem.get_val("surface_control_points").shape
    (78,)
    """

    is_linear = False
    """Whether the outputs depend linearly (affinely) on the inputs."""

    if TYPE_CHECKING:  # written by tools/write_signatures.py

        def __init__(
            self,
            *,
            model: Movable,
            mesh: MovingMesh,
            surface: SurfaceGrid,
            numbers: Sequence[int] | np.ndarray | None = None,
            **options: Any,
        ) -> None: ...

    def initialize(self) -> None:
        """Declare the options."""
        declare_model(self)
        self.options.declare("mesh", types=MovingMesh, recordable=False, desc="its control mesh, ready to move")
        self.options.declare("surface", types=SurfaceGrid, recordable=False, desc="which nodes")
        self.options.declare("numbers", default=None, recordable=False, desc="which of them are given")
        self._last = LastState()

    @property
    def miss(self) -> SurfaceMiss | None:
        """Distances between the nodes of the last run and the control points' surface; None before any run.

        Also None if control points are nodes, so there is no error.
        """
        if self._last.points is None:
            return None
        (nodes,) = self._last.points
        fitted = self._map.apply(self._last.state.control_points)[self._numbers]
        return self._follower.miss(fitted, nodes)

    @fails_together
    def setup(self) -> None:
        """Declare the variables in the sizes of the mesh and the surface."""
        model, mesh, surface = (self.options[name] for name in ("model", "mesh", "surface"))
        self._numbers = as_node_numbers(self.options["numbers"], surface.n_points, "numbers", self.msginfo)
        self._last, self._map = LastState(), SurfaceMap.of(model, mesh, surface)
        self._follower = follower_of(model, mesh, surface, self._numbers)
        on_planes = surface.on_planes(model)
        self._planes = [(np.isin(self._numbers, ids), normal) for ids, normal in on_planes]
        self.add_input(SURFACE, val=self._follower.baseline.ravel(), units="m")
        self.add_output(SURFACE_CONTROL_POINTS, val=mesh.points[mesh.surface_ids].ravel(), units="m")
        check_along_edges(self, SURFACE, lines_among(self._numbers, surface.lines))

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Fit the control points, and log their error at level INFO."""
        followed = self._followed(inputs)
        outputs[SURFACE_CONTROL_POINTS] = followed.control_points.ravel()
        if self.under_complex_step:
            outputs[SURFACE_CONTROL_POINTS] += 1j * followed.jvp(inputs[SURFACE].imag.reshape(-1, 3)).ravel()
        elif not self.under_approx and LOGGER.isEnabledFor(logging.INFO):
            LOGGER.info("%s: of control points alone, %s", self.msginfo, self.miss)

    @fails_together
    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose at the inputs."""
        followed = self._followed(inputs)
        products = {"jvp": followed.jvp, "vjp": followed.vjp}
        add_product(inputs, d_inputs, d_outputs, mode, **products, of=SURFACE_CONTROL_POINTS, wrt=SURFACE)

    def _followed(self, inputs: Vector) -> Followed:
        nodes = finite_points(inputs[SURFACE], SURFACE, self.msginfo).real
        with failures_as_analysis_errors(self):
            return self._last.at([nodes], self._follow)

    def _follow(self, nodes: np.ndarray) -> Followed:
        self._require_in_planes(nodes)
        return self._follower.at(nodes)

    def _require_in_planes(self, nodes: np.ndarray) -> None:
        """Refuse nodes that leave their symmetry planes."""
        for is_member, normal in self._planes:
            off = np.abs((nodes - self._follower.baseline)[is_member] @ normal)
            if off.max(initial=0.0) > PLANE_TOLERANCE * self.options["mesh"].size:
                number = np.flatnonzero(is_member)[np.argmax(off)]
                raise om.AnalysisError(
                    f"{self.msginfo}: point {number + 1} of '{SURFACE}' leaves its plane of symmetry by "
                    f"{off.max():.3g} m; keep the nodes on planes of symmetry in them"
                )
