"""Points of structures and other disciplines that move with the surface of a geometry.

Theory: ``docs/theory/body_points.rst``.
"""

from __future__ import annotations

import openmdao.api as om
from openmdao.vectors.vector import Vector

from ....names import SURFACE
from ...mesh.surface import SurfaceGrid
from ...walls.body_points import Body, BodyPoints, require_contained
from ..check_directions import check_along_directions
from ..component import LINEAR_STEP, add_bar, fails_together, finite_points
from ..model_option import Copied
from .conventions import COORDINATES, names_of, point_set_names

__all__ = ["RidingPoints"]


class RidingPoints(Copied, om.ExplicitComponent):
    """Move points inside a surface with the surface.

    ==============================  ======  =======  =====  ============================================================
    name                            role    shape    units  meaning
    ==============================  ======  =======  =====  ============================================================
    ``x_struct0_geometry_input``    input   (3 n)           points on the baseline (m)
    ``surface``                     input   (3 m)    m      nodes of the `SurfaceGrid`
    ``x_struct0_geometry_output``   output  (3 n)           the points, moved (m)
    ==============================  ======  =======  =====  ============================================================

    ``x_struct0`` stands for the name of the set; in MPhys 1.x these are ``x_struct_in`` and ``x_struct0``. On several
    processes each has all points.

    Options
    -------
    name : str
        Name of the set.
    points : ndarray, shape (n, 3)
        The points on the baseline (m).
    surface : SurfaceGrid
        The surface that moves them.
    generation : int, optional
        1 or 2: the MPhys whose names are used; by default the one that is installed.

    Raises
    ------
    InputError
        In ``setup``, with the number of the first point that is outside the surface.
    om.AnalysisError
        In a run, if an input is not finite.
    """

    def initialize(self) -> None:
        """Declare the options."""
        self.options.declare("name", types=str, desc="name of the set")
        self.options.declare("points", recordable=False, desc="the points on the baseline, m")
        self.options.declare("surface", types=SurfaceGrid, recordable=False, desc="the surface that moves them")
        self.options.declare("generation", default=None, desc="MPhys whose names are used")

    def setup(self) -> None:
        """Embed the points in the surface, and declare the variables."""
        surface, name, points = (self.options[option] for option in ("surface", "name", "points"))
        body, tags = Body(surface.points, surface.quads), names_of(self.options["generation"], self.msginfo).input_tags
        points = require_contained(body, points, f"{self.msginfo}: {name}")
        self._ride, self._n_nodes = BodyPoints.of(body, points), surface.n_points
        self._wrt, self._of = point_set_names(name, self.options["generation"], self.msginfo)
        self.add_input(self._wrt, val=points.ravel(), tags=list(tags))
        self.add_input(SURFACE, val=surface.points.ravel(), units="m")
        self.add_output(self._of, val=points.ravel(), tags=COORDINATES)
        check_along_directions(self, LINEAR_STEP)

    @fails_together
    def compute(self, inputs: Vector, outputs: Vector) -> None:
        """Add the displacement."""
        nodes = finite_points(inputs[SURFACE], SURFACE, self.msginfo)
        points = finite_points(inputs[self._wrt], self._wrt, self.msginfo)
        outputs[self._of] = (points + self._ride.forward(nodes - self.options["surface"].points)).ravel()

    def compute_jacvec_product(self, inputs: Vector, d_inputs: Vector, d_outputs: Vector, mode: str) -> None:
        """Apply the Jacobian or its transpose."""
        if self._of not in d_outputs:
            return
        if mode == "fwd":
            if self._wrt in d_inputs:
                d_outputs[self._of] += d_inputs[self._wrt]
            if SURFACE in d_inputs:
                d_outputs[self._of] += self._ride.forward(d_inputs[SURFACE].reshape(-1, 3)).ravel()
            return
        add_bar(d_inputs, self._wrt, d_outputs[self._of])
        add_bar(d_inputs, SURFACE, self._ride.adjoint(d_outputs[self._of].reshape(-1, 3)))
