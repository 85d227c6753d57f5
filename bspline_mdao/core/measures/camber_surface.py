"""The camber surface of a wing as a structured mesh: midway between its upper and lower side.

The position of each mesh point between nodes is found on the baseline and kept: mesh points are material, and the mesh
is a linear function of the nodes.

Theory: ``docs/theory/geometry.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, kron, vstack

from ...base.checks import as_axes
from ...base.display import OneLine
from ...errors import InputError
from ..mesh.surface import SurfaceGrid
from .edge_cuts import cut_edges, edges_of_quads

__all__ = ["SPACINGS", "CamberSurface"]

SPACINGS = {
    "uniform": lambda n: np.linspace(0.0, 1.0, n),
    "cosine": lambda n: 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, n)),
    "tip": lambda n: np.sin(0.5 * np.linspace(0.0, np.pi, n)),
}
"""Fractions of chord or span by the number of nodes: uniform, clustered at both ends, or at the far end."""

_NEAR = 1e-9
"""Distance from a section, relative to the span, at which a node is on it."""

_SHORT = 1e-6
"""Chord, relative to the span, that counts as zero, as at the end of a round tip."""

_EDGE_ON = 1e-6
"""Component of a quad's unit normal below which it faces neither up nor down, as on a blunt trailing edge."""


@dataclass(frozen=True, eq=False)
class CamberSurface(OneLine):
    """Mesh of the camber surface in the order and the axes of OpenAeroStruct.

    Nodes run from the leading to the trailing edge and from the tip to the root; x points downstream, y from the left
    tip to the root and beyond, z up.

    Parameters
    ----------
    surface : SurfaceGrid
        The wing.
    weights : csr_array, shape (n_chord n_span, n)
        Weight of every node of the surface in every node of the mesh.
    axes : ndarray, shape (3, 3)
        Transformation from grid coordinates to mesh coordinates; a reflection if the grid is about the right wing.
    shape : tuple of int
        (n_chord, n_span, 3).
    name : str
        Name of the output.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.measures import CamberSurface, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 9, 7))))
    >>> CamberSurface.of(surface, n_chord=3, n_span=4).evaluate(surface.points).shape
    (3, 4, 3)
    """

    surface: SurfaceGrid
    weights: csr_array
    axes: np.ndarray
    shape: tuple[int, int, int]
    name: str = "camber_surface"

    units = "m"

    @classmethod
    def of(
        cls,
        surface: SurfaceGrid,
        n_chord: int,
        n_span: int,
        *,
        chord_spacing: str = "uniform",
        span_spacing: str = "uniform",
        axes: str = "xzy",
        ends: tuple[float, float] | None = None,
        name: str = "camber_surface",
    ) -> CamberSurface:
        """Make a mesh midway between the sides of a wing.

        The upper side is what faces up on the baseline, whatever the grid topology. Every section across the span is
        cut out of both sides, and both are divided at the same fractions of its chord.

        Parameters
        ----------
        surface : SurfaceGrid
            One half of a wing whose sections each have one upper and one lower side, such as the surface of
            ``"wing*"``.
        n_chord, n_span : int
            Number of nodes along the chord and along the span, at least 2.
        chord_spacing, span_spacing : str
            One of `SPACINGS`: "uniform", "cosine", or "tip" (clustered only at the tip).
        axes : str
            Axes of the grid that point downstream, along the span and up.
        ends : tuple of float, optional
            Coordinates along the span of the root and the tip (m), if the mesh is not to go from end to end.
        name : str
            Name of the output.

        Returns
        -------
        CamberSurface

        Raises
        ------
        InputError
            If a count, a spacing or the axes are invalid, or a section has no upper or no lower side.
        """
        turn = _turn(axes, surface.points)
        points = surface.points @ turn.T
        stations = _stations(points[:, 1], _fractions(span_spacing, n_span, "span"), ends)
        chord = _fractions(chord_spacing, n_chord, "chord")
        sides = _sides(surface.quads, points, is_mirrored=np.linalg.det(turn) < 0.0)
        rows = vstack([_section(points, sides, chord, station) for station in stations[::-1]], format="csr")
        order = np.arange(n_span * n_chord).reshape(n_span, n_chord).T.ravel()
        return cls(surface, csr_array(rows[order]), turn, (n_chord, n_span, 3), name)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Mesh (m), shape (n_chord, n_span, 3), from the nodes, shape (n, 3)."""
        return (self.weights @ points @ self.axes.T).reshape(self.shape)

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`: the same at all nodes."""
        return self._matrix

    @cached_property
    def _matrix(self) -> csr_array:
        return csr_array(kron(self.weights, csr_array(self.axes), format="csr"))


def _turn(axes: str, points: np.ndarray) -> np.ndarray:
    """Rows of the identity in the order of the axes, the second reversed if the tip is on the positive side."""
    turn = as_axes(axes, "camber surface")
    span = points @ turn[1]
    turn[1] *= -1.0 if span.max() > -span.min() else 1.0
    return turn


def _fractions(spacing: str, n: int, direction: str) -> np.ndarray:
    """Fractions of chord or span, ascending."""
    if spacing not in SPACINGS:
        raise InputError(
            f"camber surface: no spacing '{spacing}' along the {direction}; choose from {', '.join(SPACINGS)}"
        )
    if n < 2:
        raise InputError(f"camber surface: {n} nodes along the {direction}; give 2 at least")
    return SPACINGS[spacing](n)


def _stations(span: np.ndarray, fractions: np.ndarray, ends: tuple[float, float] | None) -> np.ndarray:
    """Coordinates y of the sections from the root to the tip, the root first."""
    root, tip = (span.max(), span.min()) if ends is None else (-abs(end) for end in ends)
    return root + (tip - root) * fractions


def _sides(quads: np.ndarray, points: np.ndarray, is_mirrored: bool) -> dict[str, np.ndarray]:
    """Edges, shape (n, 2), of the quads that face up and of the quads that face down."""
    x = points[quads]
    normals = np.cross(x[:, 2] - x[:, 0], x[:, 3] - x[:, 1])
    up = normals[:, 2] / np.maximum(np.linalg.norm(normals, axis=1), np.finfo(float).tiny)
    up = -up if is_mirrored else up
    return {"upper": edges_of_quads(quads[up > _EDGE_ON]), "lower": edges_of_quads(quads[up < -_EDGE_ON])}


def _section(points: np.ndarray, sides: dict[str, np.ndarray], fractions: np.ndarray, station: float) -> csr_array:
    """Weights of the nodes in the camber line at a station, at fractions of its chord."""
    cuts = [_cut(points, edges, station, f"{side} side") for side, edges in sides.items()]
    line = np.concatenate([cut @ points for cut in cuts])
    leading, trailing = line[np.argmin(line[:, 0])], line[np.argmax(line[:, 0])]
    chord = trailing - leading
    if not np.linalg.norm(chord) > _SHORT * np.ptp(points[:, 1]):
        raise InputError(_complaint(points, "wing", "chord", station))
    along = [(cut @ points - leading) @ chord / (chord @ chord) for cut in cuts]
    upper, lower = (_between(along_cut, fractions) @ cut for along_cut, cut in zip(along, cuts))
    return csr_array(0.5 * (upper + lower))


def _cut(points: np.ndarray, edges: np.ndarray, station: float, side: str) -> csr_array:
    """Weights of the nodes at the points where edges cross a station, shape (n_crossings, n)."""
    y = points[:, 1]
    section = cut_edges(edges, y - station, _NEAR * np.ptp(y))
    if len(section.nodes) < 2:
        raise InputError(_complaint(points, side, "section", station))
    return section.matrix(len(points))


def _complaint(points: np.ndarray, where: str, what: str, station: float) -> str:
    """Describe what a station lacks, and the allowed range of stations."""
    low, high = 0.0 - points[:, 1].max(), 0.0 - points[:, 1].min()
    return (
        f"camber surface: the {where} has no {what} at {abs(station):.6g} along the span, on which its nodes go from "
        f"{low:.6g} to {high:.6g}; give ends further inside, or other axes"
    )


def _between(along: np.ndarray, fractions: np.ndarray) -> csr_array:
    """Weights that interpolate points along a chord linearly at the fractions."""
    places, rows = np.unique(along, return_index=True)
    after = np.clip(np.searchsorted(places, fractions), 1, len(places) - 1)
    fraction = np.clip((fractions - places[after - 1]) / (places[after] - places[after - 1]), 0.0, 1.0)
    data = np.stack([1.0 - fraction, fraction], axis=1).ravel()
    columns = np.stack([rows[after - 1], rows[after]], axis=1).ravel()
    shape = (len(fractions), len(along))
    return csr_array((data, columns, 2 * np.arange(len(fractions) + 1)), shape=shape)
