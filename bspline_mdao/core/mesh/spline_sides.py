"""The sides of volumes that make up a surface: each a B-spline surface, with the numbers of its control points.

Theory: ``docs/theory/cad.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...grids.topology.boundary_surface import volume_behind
from ...grids.topology.sharing import boundary_sides
from ..model.fitted_model import FittedModel
from ..splines.side import VolumeSide
from .boundary import matching_patches, wall_patches

__all__ = ["SplineSide", "spline_sides"]


@dataclass(frozen=True, eq=False)
class SplineSide(OneLine):
    """A side of a volume on the boundary, with u x v into the fluid."""

    name: str  # for messages: the block, its side and the patch
    patch: str  # the patch
    surface: VolumeSide  # the surface
    ids: np.ndarray  # (N_u, N_v) of int, numbers of its control points


def spline_sides(
    model: FittedModel,  # the model
    # (n_control_points, 3), moved control points (m); the fitted ones by default
    control_points: np.ndarray | None = None,
    patches: str | Sequence[str] | None = None,  # patches by name or pattern (``"wing*"``); all walls by default
) -> list[SplineSide]:
    """Sides of a model's volumes that are on some patches, without those that have collapsed to lines."""
    topology, points = model.topology, model.control_points if control_points is None else control_points
    wanted = wall_patches(topology) if patches is None else matching_patches(topology, patches)
    found = []
    for face, number, side in boundary_sides(topology):
        if face.patch in wanted:
            ids, direction, end = model.mesh.control_ids[number], side // 2, side % 2
            layer = np.take(ids, -end, axis=direction)
            inner = np.take(ids, -2 if end else 1, axis=direction)
            if (layer == layer[:1]).all() or (layer == layer[:, :1]).all():
                continue
            u, v = (d for d in range(3) if d != direction)
            axes = (u, v) if volume_behind(layer, inner, model.control_points) > 0.0 else (v, u)
            surface = VolumeSide(model.mesh.volumes[number], points[ids], direction, end, axes)
            name = f"{topology.segment_names[number]} {'ijk'[direction]}{'max' if end else 'min'}, {face.patch}"
            found.append(SplineSide(name, str(face.patch), surface, layer if axes[0] < axes[1] else layer.T))
    return found
