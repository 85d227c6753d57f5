"""Grids of curved hexahedra: elements with polynomial sides, for high-order solvers.

An element of degree d has (d + 1)^3 nodes at evenly spaced places of its reference cube; its map is the polynomial of
degree d in each direction through them. Theory: ``docs/theory/high_order.rst``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.polynomial.legendre import leggauss

from ...base.display import OneLine
from ...errors import InputError
from .bezier import lagrange_validity
from .hexahedron import COLLAPSE_TOLERANCE

__all__ = ["CurvedGrid", "CurvedPatch"]

CHUNK = 2**11
"""Number of elements whose Jacobians are computed at a time."""


@dataclass(frozen=True, eq=False)
class CurvedPatch(OneLine):
    """Curved faces of elements on the boundary, with one name."""

    name: str  # name of the patch
    kind: str  # its kind: ``wall``, ``symmetry``, ``farfield``, ``overset`` or ``other``
    # nodes of every face on its lattice; the cross product of the two directions points out of the grid
    faces: np.ndarray  # int (n, d + 1, d + 1)


@dataclass(frozen=True, eq=False)
class CurvedGrid(OneLine):
    """Curved hexahedra that fill a grid, with one numbering of nodes. Made by `bspline_mdao.splines.curved_grid`.

    Parameters
    ----------
    degree : int
        Degree d of the elements.
    nodes : ndarray, shape (n_nodes, 3)
        Nodes (m), each once.
    elements : ndarray of int, shape (n, d + 1, d + 1, d + 1)
        Nodes of every element on its lattice; right-handed.
    patches : tuple of CurvedPatch
        The boundary; faces without a name are the patch ``boundary``.
    places : ndarray of int, shape (n, 4)
        Block and cell of the family member, from 0, of every element.
    source : str
        Where the grid came from, for messages.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import ball_grid
    >>> from bspline_mdao.splines import curved_grid
    >>> grid = curved_grid(fit_grid(ball_grid((5, 5, 5, 5), far=4.0)), degree=3)
    >>> grid.elements.shape, [(patch.name, len(patch.faces)) for patch in grid.patches]
    ((384, 4, 4, 4), [('body', 96), ('farfield', 96)])
    """

    degree: int
    nodes: np.ndarray
    elements: np.ndarray
    patches: tuple[CurvedPatch, ...]
    places: np.ndarray
    source: str = "grid"

    @cached_property
    def is_collapsed(self) -> np.ndarray:
        """Elements that have a node more than once, because edges or faces have collapsed; shape (n,)."""
        ordered = np.sort(self.elements.reshape(len(self.elements), -1), axis=1)
        return (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)

    def volumes(self) -> np.ndarray:
        """Volume of every element (m^3), by a rule that is exact for its polynomials; shape (n,)."""
        n_points = (3 * self.degree + 1) // 2
        weights = leggauss(n_points)[1] / 2.0
        parts = [np.einsum("nabc,a,b,c->n", J, *[weights] * 3) for _, J in self._jacobians(_gauss(n_points))]
        return np.concatenate(parts)

    def areas(self, patch: str) -> np.ndarray:
        """Area of every face of a patch (m^2), by Gauss's rule of 2 d + 2 points per direction; shape (n,).

        Parameters
        ----------
        patch : str
            Its name.

        Raises
        ------
        InputError
            If there is no such patch.
        """
        faces = self._patch(patch).faces
        points, weights = leggauss(2 * self.degree + 2)
        values, slopes = lagrange(self.degree, (points + 1.0) / 2.0)
        x = self.nodes[faces]
        x_a = np.einsum("nabx,pa,qb->npqx", x, slopes, values, optimize=True)
        x_b = np.einsum("nabx,pa,qb->npqx", x, values, slopes, optimize=True)
        return np.einsum("npq,p,q->n", np.linalg.norm(np.cross(x_a, x_b), axis=-1), weights / 2.0, weights / 2.0)

    def worst_jacobians(self) -> np.ndarray:
        """Smallest determinant of every element's map, relative to the largest; shape (n,).

        It is sampled at Gauss points, and at the nodes of elements that have not collapsed. An element with a value of
        0 or less is inverted; one with a positive value may still be inverted between the points: see `statuses`.
        """
        worst = np.empty(len(self.elements))
        largest = np.empty(len(self.elements))
        for part, J in self._jacobians(_gauss(self.degree + 1)):
            flat = J.reshape(len(J), -1)
            worst[part], largest[part] = flat.min(axis=1), np.abs(flat).max(axis=1)
        for part, J in self._jacobians(tuple(np.linspace(0.0, 1.0, self.degree + 1))):
            flat, counts = J.reshape(len(J), -1), ~self.is_collapsed[part]
            worst[part][counts] = np.minimum(worst[part], flat.min(axis=1))[counts]
            largest[part][counts] = np.maximum(largest[part], np.abs(flat).max(axis=1))[counts]
        return worst / np.where(largest > 0.0, largest, 1.0)

    def statuses(self) -> np.ndarray:
        """What is proved about every element by lower bounds of its Jacobian, shape (n,), see `lagrange_validity`.

        On collapsed edges the Jacobian may be zero.

        Returns
        -------
        ndarray of uint8
            `bspline_mdao.grids.cells.bernstein.VALID`, ``UNDECIDED`` or ``INVALID``.
        """
        shortest = COLLAPSE_TOLERANCE * float(np.linalg.norm(np.ptp(self.nodes, axis=0)))
        status = np.empty(len(self.elements), dtype=np.uint8)
        for start in range(0, len(self.elements), CHUNK):
            part = slice(start, start + CHUNK)
            status[part] = lagrange_validity(self.nodes[self.elements[part]], shortest=shortest)[0]
        return status

    def _jacobians(self, points: tuple[float, ...]) -> Iterator[tuple[slice, np.ndarray]]:
        """Determinants of some elements at the products of points in [0, 1], shape (n, P, P, P)."""
        values, slopes = lagrange(self.degree, np.array(points))
        for start in range(0, len(self.elements), CHUNK):
            part = slice(start, start + CHUNK)
            x = self.nodes[self.elements[part]]
            columns = [
                np.einsum("nabcx,pa,qb,rc->npqrx", x, *(slopes if d == e else values for e in range(3)), optimize=True)
                for d in range(3)
            ]
            yield part, np.einsum("npqrx,npqrx->npqr", columns[0], np.cross(columns[1], columns[2]))

    def points(self, patch: str, n: int) -> np.ndarray:
        """Points of the faces of a patch at n x n evenly spaced places of each; shape (n_faces, n, n, 3).

        Parameters
        ----------
        patch : str
            Its name.
        n : int
            Points per direction, both ends included.

        Raises
        ------
        InputError
            If there is no such patch.
        """
        values, _ = lagrange(self.degree, np.linspace(0.0, 1.0, n))
        return np.einsum("nabx,pa,qb->npqx", self.nodes[self._patch(patch).faces], values, values, optimize=True)

    def _patch(self, name: str) -> CurvedPatch:
        for patch in self.patches:
            if patch.name == name:
                return patch
        names = ", ".join(patch.name for patch in self.patches)
        raise InputError(f"{self.source}: no patch '{name}'; there are {names}")


@cache
def _gauss(n: int) -> tuple[float, ...]:
    return tuple((leggauss(n)[0] + 1.0) / 2.0)


def lagrange(
    degree: int,  # their degree d
    points: np.ndarray,  # (n,), where they are evaluated
) -> tuple[np.ndarray, np.ndarray]:  # values, slopes each (n, d + 1)
    """Lagrange polynomials through evenly spaced places of [0, 1], and their derivatives."""
    places = np.linspace(0.0, 1.0, degree + 1)
    values, slopes = np.ones((2, len(points), degree + 1))
    for m, place in enumerate(places):
        others = np.delete(places, m)
        scale = np.prod(place - others)
        factors = points[:, None] - others
        values[:, m] = factors.prod(axis=1) / scale
        slopes[:, m] = sum(np.delete(factors, k, axis=1).prod(axis=1) for k in range(degree)) / scale
    return values, slopes
