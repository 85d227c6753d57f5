"""The two planes between which a fitted section lies, for two-dimensional meshes.

Theory: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import numpy as np

from ...errors import InputError
from ...grids.cells.mixed_cells import MixedMesh
from ...grids.io.meshes.layer_of_cells import SectionSpan
from ...grids.topology.boundary_surface import BoundarySurface
from ..model.fitted_model import FittedModel
from ..walls.embedded_points import ON_PLANE

__all__ = ["require_planes_of_section", "section_span"]


def section_span(model: FittedModel) -> SectionSpan | None:
    """Find the two symmetry planes between which a fitted section lies.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.

    Returns
    -------
    SectionSpan or None
        None if the grid is not a section: it does not have two symmetry planes across one axis, at its two ends.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.meshes import section_span
    >>> section_span(fit_grid(brick_grid((5, 5, 5, 5)))) is None
    True
    """
    nodes, topology = model.grid_map().nodes, model.topology
    faces = [face for face in topology.boundary if face.kind == "symmetry"]
    if not faces:
        return None
    surface = BoundarySurface.of(topology, nodes, faces)
    quads = nodes[surface.rows][surface.quads]
    low, high = nodes.min(axis=0), nodes.max(axis=0)
    near = ON_PLANE * np.linalg.norm(high - low)
    ends = [(np.abs(quads - end) <= near).all(axis=1) for end in (low, high)]  # of quads, by axis
    for axis in range(3):
        at_low, at_high = (end[:, axis] for end in ends)
        if at_low.any() and at_high.any() and (at_low | at_high).all():
            return SectionSpan(axis, float(low[axis]), float(high[axis]))
    return None


def require_planes_of_section(model: FittedModel, mesh: MixedMesh) -> None:
    """Refuse a two-dimensional mesh file unless the fitted grid is a section between the same planes."""
    if mesh.n_copies == 1:
        return
    span = section_span(model)
    if span is None:
        raise InputError(
            f"{mesh.source}: is two-dimensional, and moves with a section only: a grid between two parallel "
            f"planes of symmetry; give such a model"
        )
    ends = mesh.points[[0, mesh.n_stored], span.axis] if mesh.n_stored else (span.low, span.high)
    if max(abs(ends[0] - span.low), abs(ends[1] - span.high)) > ON_PLANE * (span.high - span.low):
        raise InputError(
            f"{mesh.source}: is of two dimensions, and not taken between the planes of the section; read it by "
            f"read_mesh(..., span=section_span(model))"
        )
