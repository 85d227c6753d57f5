"""Target shapes of a wing (the moves of the paper's section IV): its wall nodes laid on another shape, and the fit.

A shape is a map from side, chord fraction and span fraction to space. The *chord fraction* is the fraction of a
section's arc from the leading to the trailing edge. The *span fraction* is the fraction of a line of constant chord
fraction from the symmetry plane to the tip, measured normal to the stream, so sweep does not count: along the spine and
over the rounded tip.

Theory: ``docs/theory/generators.rst``.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.interpolate import CubicSpline

from ...errors import InputError
from ...grids.io.triangles import Triangles
from ...grids.topology.grid import Grid
from ...grids.topology.index_space import Window
from ...grids.topology.sharing import node_sharing
from ..fit.surface_fit import fit_surface, replace_nodes
from ..mesh.surface import SurfaceGrid
from ..model.fitted_model import FittedModel

_SIDES = {"wing_lower": -1, "wing_upper": 1}


class Shape(Protocol):
    """A surface with two sides that meet at the leading edge, the trailing edge and the tip.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.generators import Planform, Wing, naca_section
    >>> wing = Wing(Planform(semi_span=3.0), naca_section(0.12))  # a wing is a shape, as is a BlendedWingBody
    >>> chord = np.broadcast_to([0.0, 0.5, 1.0], (len(wing.stations), 3))
    >>> wing.place(wing.sections(+1, chord))[[0, -1], :, 2].round(3).tolist()  # spans of the root and of the tip
    [[0.0, 0.0, 0.0], [3.0, 3.0, 3.0]]
    """

    stations: np.ndarray
    """Distances from the symmetry plane along the span, shape (m,), ascending (m)."""

    def sections(self, side: int, fractions: np.ndarray) -> np.ndarray:
        """Coordinate x and height, shape (m, n, 2), at fractions (m, n) of the section's arc at every station."""

    def place(self, sections: np.ndarray) -> np.ndarray:
        """Points in space, shape (m, n, 3), from points of the sections, shape (m, n, 2)."""


def fit_shape(model: FittedModel, surface_ids: np.ndarray, shape: Shape | Triangles) -> np.ndarray:
    """Fit the surface control points of a wing's model to another shape, or of any walls to triangles.

    Parameters
    ----------
    model : FittedModel
        Model of a grid about a wing with patches ``wing_upper`` and ``wing_lower`` of one face each, i along the chord
        and k along the span, as from `hh_wing_grid`; or of any grid with walls if the shape is triangles.
    surface_ids : ndarray of int, shape (n_surface,)
        Numbers of the control points of both patches, such as ``surface_ids`` of the moving mesh.
    shape : Shape or Triangles
        Target shape of the wing, for example `rectangular_wing` or `generic_blended_wing_body`. Wall nodes go to the
        nearest places of triangles, which must be close: within a fraction of a radius of curvature.

    Returns
    -------
    ndarray, shape (n_surface, 3)
        Surface control points (m). The distance of the surface from the shape is logged, see
        `bspline_mdao.core.fit.surface_fit.fit_surface`, which also returns it.

    Raises
    ------
    InputError
        If the patches are missing, or the control points do not make up whole faces.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import flat_plate_grid, generic_blended_wing_body
    >>> from bspline_mdao.movers import moving_mesh
    >>> model = fit_grid(flat_plate_grid((9, 9, 9)), n_control=(5, 5, 5))
    >>> mesh = moving_mesh(model)
    >>> surface = fit_shape(model, mesh.surface_ids, generic_blended_wing_body())
    >>> surface.shape == mesh.points[mesh.surface_ids].shape
    True
    """
    nodes = nodes_on_triangles(model, shape) if isinstance(shape, Triangles) else nodes_on_shape(model, shape)
    return fit_surface(model, surface_ids, nodes).control_points


def nodes_on_triangles(model: FittedModel, body: Triangles) -> np.ndarray:
    """All nodes of a model's grid, shape (n_nodes, 3), with nodes of walls at the nearest places of triangles."""
    surface, nodes = SurfaceGrid.of(model), model.regenerate().to_vector().reshape(-1, 3)
    moves = body.nearest(surface.points) - surface.points
    for numbers, normal in surface.on_planes(model):
        moves[numbers] -= np.outer(moves[numbers] @ normal, normal)
    source, of_row = node_sharing(model.topology).source_rows(), np.zeros_like(nodes)
    of_row[source[surface.rows]] = moves
    return nodes + of_row[source]  # in every block that has them


def nodes_on_shape(model: FittedModel, shape: Shape) -> np.ndarray:
    """All nodes of a model's grid, shape (n_nodes, 3), with nodes of the wing on another shape; see `fit_shape`.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import (
    ...     Planform, Wing, hh_wing_grid, naca_section, nodes_on_shape, rectangular_wing,
    ... )
    >>> model = fit_grid(hh_wing_grid(rectangular_wing(), (5, 5, 5)))
    >>> nodes_on_shape(model, Wing(Planform(semi_span=3.0, taper=0.5), naca_section(0.12))).shape
    (1500, 3)
    """
    grid = model.regenerate()
    return replace_nodes(model.topology, grid.to_vector().reshape(-1, 3), lay_walls(grid, shape))


def lay_walls(grid: Grid, shape: Shape) -> list[tuple[Window, np.ndarray]]:
    """Nodes of the walls (m) laid on another shape at the same fractions, in the shape of each window and 3."""
    windows = {patch.name: patch.windows for patch in grid.patches}
    for name in _SIDES:
        if len(windows.get(name, ())) != 1 or windows[name][0].shape[1] != 1:
            raise InputError(f"{grid.source}: needs one face along i and k as patch {name}; use a grid about a wing")
    walls = []
    for name, side in _SIDES.items():
        window = windows[name][0]
        fractions = _fractions(grid.blocks[window.block].nodes[window.slices][:, 0])
        walls.append((window, lay_nodes(shape, side, *fractions)[:, None]))
    return walls


def lay_nodes(shape: Shape, side: int, chord: np.ndarray, span: np.ndarray) -> np.ndarray:
    """Nodes (ni, nk, 3) on the upper (+1) or lower (-1) side of a shape at fractions (ni, nk), ascending along both."""
    stations = shape.stations
    along = stations / stations[-1]
    fractions = np.stack([np.interp(along, g, f) for f, g in zip(chord, span)], axis=1)
    sections = shape.sections(side, fractions)
    lines = shape.place(sections).swapaxes(0, 1)
    heights = sections[..., 1].T
    return np.stack([_divide(line, stations, h, g) for line, h, g in zip(lines, heights, span)])


def _fractions(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Chord and span fractions of wall nodes (ni, nk, 3)."""
    chord = _arc(nodes)
    span = _arc(nodes[..., 1:].swapaxes(0, 1)).T
    return chord / chord[-1], span / span[:, -1:]


def _arc(points: np.ndarray) -> np.ndarray:
    """Arc length along the first axis."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    return np.concatenate([np.zeros((1, *steps.shape[1:])), np.cumsum(steps, axis=0)])


def _divide(line: np.ndarray, stations: np.ndarray, heights: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Divide a line of samples (m, 3) at fractions of its length normal to the stream."""
    arc = _arc(np.stack([stations, heights], axis=1))
    nodes = CubicSpline(arc, line)(arc[-1] * fractions)
    nodes[[0, -1]] = line[[0, -1]]
    return nodes
