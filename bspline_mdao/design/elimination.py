"""Linear constraints among surface control points, handled by elimination.

The equations of all constraints, ``A d = 0`` on the displacements d, are solved for as many coordinates as they have
rank: these follow from the others, which stay as they are. The symmetry planes of the mesh are always among them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import block_array, coo_array, csr_array, vstack
from scipy.sparse.csgraph import connected_components

from ..mesh.mesh import MovingMesh
from .echelon import reduced_rows
from .equations import Equations, LinearConstraint, checked

__all__ = ["Elimination", "eliminate"]

SYMMETRY = "symmetry plane"
"""Name of the constraint that the symmetry planes of a mesh are."""


@dataclass(frozen=True, eq=False)
class Elimination:
    """Displacements that satisfy the constraints.

    Coordinates are numbered xyz interleaved, as the columns of `Equations` are.

    Parameters
    ----------
    mesh : MovingMesh
        Whose surface it is.
    matrix : csr_array, shape (3 n_surface, 3 n_surface)
        Gives displacements E d that satisfy the constraints from any displacements d: coordinates that depend on
        others follow from them, all others stay as they are. ``E E = E``, and ``A E = 0``.
    dependent, held : ndarray of bool, shape (3 n_surface,)
        Coordinates that follow from others, and those of them that cannot move.
    sources : ndarray of int, shape (3 n_surface,)
        The equation that each coordinate depends by; -1 where it does not.
    constraints : tuple of (str, Equations)
        Names and equations of all constraints, in the order in which ``sources`` counts.
    """

    mesh: MovingMesh
    matrix: csr_array
    dependent: np.ndarray
    held: np.ndarray
    sources: np.ndarray
    constraints: tuple[tuple[str, Equations], ...]

    def reason(self, coordinate: int) -> str:
        """Name the constraint, and its place, by which a coordinate depends on others; empty where it does not."""
        source = self.sources[coordinate]
        for name, equations in self.constraints:
            if 0 <= source < len(equations.at):
                place = self.mesh.place_of_point(self.mesh.surface_ids[equations.at[source]])
                return f"{name}: {place}"
            source -= len(equations.at) if source >= 0 else 0
        return ""


def eliminate(mesh: MovingMesh, points: np.ndarray, constraints: Sequence[LinearConstraint] = ()) -> Elimination:
    """Solve linear constraints for the coordinates that are to depend on others.

    An equation is redundant where it leaves the span of those before it by less than 1e-6 of its largest coefficient.
    Equations with one coordinate, which hold it, come first; then the symmetry planes and the constraints as declared.

    Parameters
    ----------
    mesh : MovingMesh
        Its symmetry planes are kept.
    points : ndarray, shape (n_surface, 3)
        Surface control points of the baseline (m).
    constraints : sequence of LinearConstraint
        What else is to hold.

    Returns
    -------
    Elimination

    Raises
    ------
    InputError
        If a constraint cannot be satisfied on this baseline; it is named.
    """
    named = [(SYMMETRY, _rails(mesh))]
    named += [(item.name, checked(item.name, item.equations(mesh, points), len(points))) for item in constraints]
    matrix = vstack([equations.matrix for _, equations in named], format="csr")
    preferred = np.concatenate([equations.preferred for _, equations in named])
    pivots, sources, rows = _solve(matrix, preferred)
    return _elimination(mesh, pivots, sources, rows, tuple(named))


def _rails(mesh: MovingMesh) -> Equations:
    """Surface points on symmetry planes stay in them."""
    return Equations.of(len(mesh.surface_ids), mesh.rail_rows[:, None], mesh.rail_normals[:, None, None])


def _solve(matrix: csr_array, preferred: np.ndarray) -> tuple[np.ndarray, np.ndarray, csr_array]:
    """Pivots, the equations that gave them, and their rows of coefficients with the sign of E."""
    group = _groups(matrix)
    order = np.lexsort((np.diff(matrix.indptr) > 1, group))
    is_first = np.diff(group[order], prepend=-1) != 0
    ordered = csr_array(matrix[order])
    parts = ordered.indptr.astype(np.int64), ordered.indices.astype(np.int64), ordered.data.astype(float)
    n, preferred = matrix.shape[1], preferred[order].astype(np.int64)
    pivots, sources, starts, columns, values = reduced_rows(*parts, n, preferred, is_first)
    rows = csr_array((-values, columns, starts), shape=(len(pivots), n))
    return pivots, order[sources], rows


def _groups(matrix: csr_array) -> np.ndarray:
    """Number of the group of each equation: groups share no coordinate."""
    joint = block_array([[None, matrix], [matrix.T, None]], format="csr")
    return connected_components(joint, directed=False)[1][: matrix.shape[0]]


def _elimination(mesh, pivots, sources, rows, named) -> Elimination:
    """Identity in the independent coordinates, and the rows of the dependent ones."""
    n = rows.shape[1]
    source = np.full(n, -1)
    source[pivots] = sources
    held = np.zeros(n, dtype=bool)
    held[pivots[np.diff(rows.indptr) == 0]] = True
    free, rows = np.flatnonzero(source < 0), rows.tocoo()
    lines, columns = np.concatenate([free, pivots[rows.row]]), np.concatenate([free, rows.col])
    values = np.concatenate([np.ones(len(free)), rows.data])
    matrix = coo_array((values, (lines, columns)), shape=(n, n)).tocsr()
    return Elimination(mesh, matrix, source >= 0, held, source, named)
