"""From surface nodes back to surface control points: least squares about a map that is all but linear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import SuperLU, splu

from ..errors import InputError, MovementError
from .mesh import MovingMesh
from .surface_map import SurfaceMap, SurfaceState

__all__ = ["FittedSurface", "SurfaceInverse"]

_SMALLEST_PIVOT = 1e-13
"""Pivot, relative to the largest, below which nodes do not determine the control points."""

_MOST_STEPS = 60
"""Steps after which nodes count as such that no control points are nearest to."""

_ROUND_OFF = 1e-15
"""A step is the last one where it is shorter than this part of what it changes."""


@dataclass(frozen=True, eq=False)
class SurfaceInverse:
    """Control points ``s`` whose nodes ``x(s) = A s + T(s) r + c`` are closest to the given ones, ``w``.

    With ``A+`` the pseudo-inverse of A, by its normal equations, the steps ``s <- s + P A+ (w - x(s))`` end where
    the difference is orthogonal to all that control points can do. Where no residual turns the second one is a step of
    refinement. P keeps control points in planes of symmetry, which least squares alone would leave where the nodes
    are those of no spline. Nodes of a spline surface give back its control points to round-off.

    Parameters
    ----------
    surface_map : SurfaceMap
        From control points to nodes.
    numbers : ndarray of int, shape (n,)
        Which of the nodes are given, in which order.
    mesh : MovingMesh
        Its surface points are those that are looked for.
    matrix : csr_array, shape (n, n_surface)
        A.
    factor : SuperLU
        Of the transpose of A times A.
    """

    surface_map: SurfaceMap
    numbers: np.ndarray
    mesh: MovingMesh
    matrix: csr_array
    factor: SuperLU

    def __reduce__(self):
        """Take the factor along as what it is made of: SuperLU cannot be pickled."""
        return SurfaceInverse.of, (self.surface_map, self.mesh, self.numbers)

    @classmethod
    def of(cls, surface_map: SurfaceMap, mesh: MovingMesh, numbers: np.ndarray | None = None) -> SurfaceInverse:
        """Invert the map of a surface.

        Parameters
        ----------
        surface_map : SurfaceMap
            From control points to nodes.
        mesh : MovingMesh
            The mesh that it was made for.
        numbers : ndarray of int, shape (n,), optional
            Which nodes are given, in which order; all of the surface in its own by default.

        Raises
        ------
        InputError
            If the nodes do not determine all surface control points.
        """
        numbers = np.arange(surface_map.matrix.shape[0]) if numbers is None else numbers
        matrix = csr_array(surface_map.matrix[numbers])
        return cls(surface_map, numbers, mesh, matrix, _factor(matrix))

    def at(self, nodes: np.ndarray) -> FittedSurface:
        """Control points and their derivative at nodes, shape (n, 3), in metres.

        Raises
        ------
        MovementError
            If the steps do not end.
        """
        initial = self.mesh.points[self.mesh.surface_ids]

        def step(control_points: np.ndarray) -> np.ndarray:
            state = self.surface_map.at(control_points)
            return self._slide(self._fit(nodes - state.nodes[self.numbers]))

        control_points = _refined(step, initial.copy())
        return FittedSurface(self, control_points, self.surface_map.at(control_points))

    def _fit(self, change: np.ndarray) -> np.ndarray:
        """A+ times a change of nodes."""
        return self.factor.solve(self.matrix.T @ change)

    def _fit_transpose(self, bar: np.ndarray) -> np.ndarray:
        return self.matrix @ self.factor.solve(bar, "T")

    def _slide(self, change: np.ndarray) -> np.ndarray:
        """Take what would leave planes of symmetry off a change of control points; its own transpose."""
        rows, normals, slid = self.mesh.rail_rows, self.mesh.rail_normals, change.copy()
        np.subtract.at(slid, rows, np.sum(change[rows] * normals, axis=1)[:, None] * normals)
        return slid


@dataclass(frozen=True, eq=False)
class FittedSurface:
    """Control points that were fitted to nodes, and their derivative.

    Parameters
    ----------
    of : SurfaceInverse
        What fitted them.
    control_points : ndarray, shape (n_surface, 3)
        The surface control points (m).
    state : SurfaceState
        The nodes of these control points.
    """

    of: SurfaceInverse
    control_points: np.ndarray
    state: SurfaceState

    @property
    def nodes(self) -> np.ndarray:
        """Where the control points put the nodes that were given, shape (n, 3), in metres."""
        return self.state.nodes[self.of.numbers]

    def jvp(self, change: np.ndarray) -> np.ndarray:
        """Change of the control points, shape (n_surface, 3), with that of the nodes, shape (n, 3)."""
        of = self.of

        def step(found: np.ndarray) -> np.ndarray:
            return of._slide(of._fit(change - self.state.jvp(found)[of.numbers]))

        return _refined(step, np.zeros_like(self.control_points))

    def vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `jvp`, shape (n, 3), of ``bar``, shape (n_surface, 3)."""
        of, slid = self.of, self.of._slide(bar)

        def step(found: np.ndarray) -> np.ndarray:
            nodes_bar = np.zeros_like(self.state.nodes)
            np.add.at(nodes_bar, of.numbers, of._fit_transpose(found))
            return of._slide(slid - self.state.vjp(nodes_bar))

        return of._fit_transpose(_refined(step, np.zeros_like(slid)))


def _refined(step: Callable[[np.ndarray], np.ndarray], values: np.ndarray) -> np.ndarray:
    """Add steps to values until these stay as they are, or get no shorter by rounding.

    Raises
    ------
    MovementError
        If they do not.
    """
    before = np.inf
    for number in range(_MOST_STEPS):
        change = step(values)
        values = values + change
        size, length = np.abs(values).max(), np.abs(change).max()
        if length <= _ROUND_OFF * size or (number > 1 and before <= 1e-12 * size and length > 0.5 * before):
            return values
        before = length
    raise MovementError(
        f"surface: no control points are found for these nodes in {_MOST_STEPS} steps, the last of {length:.3g} m; "
        f"take a smaller deformation"
    )


def _factor(matrix: csr_array) -> SuperLU:
    """Factor of the normal equations."""
    undetermined = InputError(
        f"surface: its {matrix.shape[0]} nodes do not determine the {matrix.shape[1]} control points of the design "
        f"surface; give the nodes of all its patches"
    )
    try:
        factor = splu((matrix.T @ matrix).tocsc())
    except RuntimeError as error:  # SuperLU met a zero pivot
        raise undetermined from error
    pivots = np.abs(factor.U.diagonal())
    if pivots.min() < _SMALLEST_PIVOT * pivots.max():
        raise undetermined
    return factor
