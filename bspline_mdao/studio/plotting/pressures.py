"""Pressures on walls: x points downstream, y up, and z along the span."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...core.model.fitted_model import FittedModel
from ...grids.cells.cell_faces import CellFaces
from ...grids.cells.quads import area_vectors
from .smooth_lines import PIECES, curve_through

__all__ = ["draw_pressures", "faces_around", "wall_quads"]


def wall_quads(model: FittedModel) -> np.ndarray:
    """Find the corners of the wall faces of a grid, in the order of the output ``Cp`` of `EulerFlow`.

    Parameters
    ----------
    model : FittedModel
        The fitted grid.

    Returns
    -------
    ndarray of int, shape (n_faces, 4)
        Rows of the corners in the nodes of the grid.
    """
    return CellFaces.of(model.topology, model.regenerate().to_vector().reshape(-1, 3)).corners_of("wall")


def faces_around(quads: np.ndarray, place: float) -> np.ndarray:
    """Find the strip of wall faces at a station along the span, from the trailing edge over the upper side and back.

    Parameters
    ----------
    quads : ndarray, shape (n, 4, 3)
        Corners of the wall faces (m), half the cross product of the diagonals pointing into the body.
    place : float
        Coordinate z (m).

    Returns
    -------
    ndarray of int
        Numbers of the faces.
    """
    across, middle = np.sort(quads[..., 2], axis=1), quads[..., 2].mean(axis=1)
    # by the middles of the sides between neighbours, so that faces of a twisted wing do not overlap
    inner, outer = across[:, :2].mean(axis=1), across[:, 2:].mean(axis=1)
    place = middle[np.argmin(np.abs(middle - place))]  # off the lines between strips, which need not be straight
    around = np.flatnonzero((inner <= place) & (place < outer))
    order = quads[around, :, 0].mean(axis=1)
    is_upper = area_vectors(quads[around])[:, 1] < 0.0
    upper, lower = around[is_upper], around[~is_upper]
    return np.concatenate([upper[np.argsort(-order[is_upper])], lower[np.argsort(order[~is_upper])]])


def draw_pressures(axes: Any, quads: np.ndarray, pressures: np.ndarray, place: float, **style: Any) -> None:
    """Draw the pressure coefficients around a station along the span as a curve through the faces.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Where to draw.
    quads : ndarray, shape (n, 4, 3)
        Corners of the wall faces (m).
    pressures : ndarray, shape (n,)
        Pressure coefficients of the faces.
    place : float
        Coordinate z (m).
    **style
        Keywords of ``plot``; markers are at the faces.
    """
    around = faces_around(quads, place)
    leading, trailing = _chord_ends(quads[around])
    x = (quads[around, :, 0].mean(axis=1) - leading) / (trailing - leading)
    curve = curve_through(np.stack([x, pressures[around]], axis=1))
    axes.plot(*curve.T, **{"markevery": PIECES} | style)
    axes.set(xlabel="$x / c$", ylabel="$C_p$")
    if not axes.yaxis_inverted():
        axes.invert_yaxis()


def _chord_ends(quads: np.ndarray) -> np.ndarray:
    """Leading and trailing edge in the middle of a strip of faces, shape (n, 4, 3), that may be swept (m)."""
    x, z = quads[..., 0], quads[..., 2]
    is_inner = z < z.mean(axis=1, keepdims=True)
    return np.mean([(x[side].min(), x[side].max()) for side in (is_inner, ~is_inner)], axis=0)
