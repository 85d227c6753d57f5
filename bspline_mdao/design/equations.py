"""Linear equations among the displacements of surface control points: what a linear constraint hands over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array

from ..errors import InputError
from ..mesh.mesh import MovingMesh

__all__ = ["Equations", "LinearConstraint"]


@dataclass(frozen=True, eq=False)
class Equations:
    """Homogeneous equations ``matrix @ d = 0`` on displacements d of the surface control points, xyz interleaved.

    Parameters
    ----------
    matrix : csr_array, shape (n_equations, 3 n_surface)
        Coefficients.
    at : ndarray of int, shape (n_equations,)
        The surface control point that each equation is about, for messages.
    preferred : ndarray of int, shape (n_equations,)
        The coordinate, of 3 n_surface, that each equation would rather have follow the others; -1 for any.
    """

    matrix: csr_array
    at: np.ndarray
    preferred: np.ndarray

    @classmethod
    def of(cls, n_surface: int, rows: np.ndarray, coefficients: np.ndarray, follower: int = -1) -> Equations:
        """Collect q equations about each of m groups of k points.

        Parameters
        ----------
        n_surface : int
            Number of surface control points.
        rows : ndarray of int, shape (m, k)
            The points of each group.
        coefficients : ndarray, broadcast to shape (m, q, k, 3)
            What the displacements of the points are multiplied by.
        follower : int
            Number, in its group, of the point that is to follow the others: in the coordinate of its largest
            coefficient.
        """
        rows = np.asarray(rows, dtype=np.int64)
        coefficients = np.broadcast_to(coefficients, (len(rows), *np.shape(coefficients)[-3:]))
        m, q, k, _ = coefficients.shape
        columns = np.broadcast_to((3 * rows[:, :, None] + np.arange(3))[:, None], coefficients.shape)
        starts = np.arange(m * q + 1) * (3 * k)
        shape = (m * q, 3 * n_surface)
        matrix = csr_array((coefficients.flatten(), columns.flatten(), starts), shape=shape)
        matrix.sum_duplicates()
        matrix.eliminate_zeros()
        main = np.abs(coefficients[:, :, follower]).argmax(axis=-1)
        return cls(matrix, np.repeat(rows[:, follower], q), (3 * rows[:, follower, None] + main).ravel())


class LinearConstraint(Protocol):
    """A linear constraint among surface control points."""

    name: str
    """For messages."""

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations on the displacements from these surface control points, shape (n_surface, 3), in metres.

        Raises
        ------
        InputError
            If the constraint cannot be satisfied: it names the constraint and the place.
        """


def checked(name: str, equations: Equations, n_surface: int) -> Equations:
    """Refuse equations of a wrong shape, about points that do not exist, or with coefficients that are not finite."""
    n, width = equations.matrix.shape
    if width != 3 * n_surface or not len(equations.at) == len(equations.preferred) == n:
        raise InputError(
            f"linear constraint '{name}': equations of shape ({n}, {width}) at {len(equations.at)} points; "
            f"give one point for each and shape (n, {3 * n_surface})"
        )
    for what, numbers, stop in (("point", equations.at, n_surface), ("coordinate", equations.preferred, width)):
        if n and not (numbers.min() >= -1 and numbers.max() < stop):
            raise InputError(f"linear constraint '{name}': there is no {what} {numbers.max()}; give 0 to {stop - 1}")
    if not np.isfinite(equations.matrix.data).all():
        raise InputError(f"linear constraint '{name}': a coefficient is not finite; check what it is made of")
    return equations
