"""Smooth seams between sides of blocks: one tangent plane for both sides (G1), as linear equations.

Theory: ``docs/theory/linear_constraints.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import bsr_array, coo_array, csr_array, diags_array, eye_array, kron
from scipy.sparse.linalg import lsqr

from ...base.display import OneLine
from ...errors import InputError
from ..mesh.moving_mesh import MovingMesh
from ..mesh.seams import mirror_seams_of_mesh, poles_of_mesh, seams_of_mesh
from .elimination import Equations
from .leading_equations import leading_equations
from .seam_relations import SeamRelations, pole_relations, relations_along
from .selection import Where, rows_of

__all__ = ["TangentContinuity"]

COARSEST = 0.1
"""Largest fraction of the largest singular value below which equations are dropped, however large kinks are."""

EXACT = 1e-12
"""Smallest such fraction: anything smaller is round-off."""

NEIGHBOUR, FOLLOWER = 0.01, 0.1
"""Preference as dependent points of neighbours of a seam relative to points on it, by default and if requested."""

SNAP = 0.003
"""Damping of a step that removes kinks, as a fraction of the largest singular value."""

MOST_STEPS = 20
"""Maximum number of steps that remove kinks."""

NO_KINK = 1e-9
"""Kink that counts as zero (deg)."""

GAIN = 0.9
"""A step that leaves more than this fraction of the largest kink is the last."""


@dataclass(frozen=True, eq=False)
class TangentContinuity(OneLine):
    """Keep one tangent plane (G1) at seams between sides of blocks, at noses, within a surface, and at poles.

    Everywhere on a seam the derivatives into both sides and the one along it keep their baseline relation
    ``L + r R + s T = 0``; the control points around a pole, where an edge has collapsed, stay in one plane with it. The
    points on the seam follow their neighbours on both sides, unless something else constrains them.

    Parameters
    ----------
    where : Selection, array_like of int or None
        Points on seams; numbers are rows of ``mesh.surface_ids``, and other selected points are ignored. By default all
        seam points where the baseline is smooth.
    max_kink : float
        Largest angle between the baseline's tangent planes that counts as smooth (deg).
    tolerance : float
        Approximate fraction of a kink that may remain: combinations of control points whose effect on the relation,
        relative to the largest, is smaller stay free. With 0.1, the largest value, only points on seams become
        dependent; with smaller values also some next to them. 1e-12, the smallest, enforces all that knots permit: if
        grid lines meet obliquely at the seam, its edge then moves as one polynomial. A baseline with kinks defines its
        relations only to within these, in radians, so larger kinks replace the tolerance, up to 0.1.
    followers : Selection, array_like of int or None
        Points next to seams preferred as dependent points: points that no variable moves.
    mirror : bool
        Constrain edges in symmetry planes as well, where the other side is the mirror image: the surface stays
        perpendicular to the plane. A plane in which the surface slides counts as a symmetry plane.
    name : str
        For messages.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.constraints import TangentContinuity
    >>> from bspline_mdao.generators import ball_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> mesh = moving_mesh(fit_grid(ball_grid((5, 5, 5, 5))))
    >>> smooth = TangentContinuity(max_kink=30.0)
    >>> smooth.equations(mesh, mesh.points[mesh.surface_ids]).matrix.shape[1] == 3 * mesh.surface_ids.size
    True
    """

    where: Where | None = None
    max_kink: float = 5.0
    tolerance: float = COARSEST
    followers: Where | None = None
    mirror: bool = True
    name: str = "tangent continuity"

    def __post_init__(self) -> None:
        if not EXACT <= self.tolerance <= COARSEST:
            raise InputError(
                f"linear constraint '{self.name}': a tolerance of {self.tolerance:g}; give {EXACT:g} to {COARSEST:g}"
            )

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``L + r R + s T = 0`` on the derivatives of displacements, along all smooth parts of seams.

        Raises
        ------
        InputError
            If no point is on a seam, or the baseline has a kink at a requested one.
        """
        relations = self._relations(mesh, points, is_linear=True)
        relations = relations.part(self._chosen(mesh, relations))
        least = np.clip(np.radians(relations.kinks), self.tolerance, COARSEST)
        allowed = _allowed(mesh)
        matrix = _on(allowed, relations)
        wish = np.full(len(points), NEIGHBOUR)
        if self.followers is not None:
            wish[rows_of(self.followers, mesh, f"linear constraint '{self.name}': followers")] = FOLLOWER
        wish[relations.at] = 1.0
        main = np.asarray(abs(allowed).argmax(axis=0)).ravel()
        reduced, dependents = leading_equations(matrix, np.repeat(least, 3), wish[main // 3])
        return Equations(csr_array(reduced @ allowed.T), main[dependents] // 3, main[dependents])

    def snapped(self, mesh: MovingMesh, points: np.ndarray) -> np.ndarray:
        """Points with smooth seams: small changes that remove existing kinks.

        A fit has small kinks, which the equations preserve, since they constrain displacements. Start from these points
        instead. They come from damped Gauss-Newton steps, each the least in the sum of squares, as long as the largest
        kink decreases.

        Parameters
        ----------
        mesh : MovingMesh
            The control mesh, whose symmetry planes keep their points.
        points : ndarray, shape (n_surface, 3)
            Surface control points (m).

        Returns
        -------
        ndarray, shape (n_surface, 3)
        """
        allowed = _allowed(mesh)
        relations = self._relations(mesh, points, is_linear=False)
        chosen = self._chosen(mesh, relations)
        relations = relations.part(chosen)
        for _ in range(MOST_STEPS):
            largest = relations.kinks.max()
            matrix, right = _normal_parts(relations, points, allowed)
            change = lsqr(matrix, right, damp=SNAP, atol=EXACT, btol=EXACT, iter_lim=20 * matrix.shape[1])[0]
            found = points - (allowed @ change).reshape(-1, 3)
            after = self._relations(mesh, found, is_linear=False).part(chosen)
            if not after.kinks.max() < largest:
                break
            points, relations = found, after
            if after.kinks.max() < NO_KINK or after.kinks.max() > GAIN * largest:
                break
        return points

    def _relations(self, mesh: MovingMesh, points: np.ndarray, *, is_linear: bool) -> SeamRelations:
        """Relations at all places on all seams and poles."""
        seams = seams_of_mesh(mesh) + (mirror_seams_of_mesh(mesh) if self.mirror else [])
        parts = [relations_along(seam, points, mesh.size) for seam in seams]
        parts += [pole_relations(pole, points, mesh.size, is_linear=is_linear) for pole in poles_of_mesh(mesh)]
        return SeamRelations.joined(parts, len(points))

    def _chosen(self, mesh: MovingMesh, relations: SeamRelations) -> np.ndarray:
        """Whether each place is wanted and smooth."""
        is_wanted, is_smooth = np.ones(len(relations.at), dtype=bool), relations.kinks <= self.max_kink
        if self.where is not None:
            wanted = rows_of(self.where, mesh, f"linear constraint '{self.name}'")
            is_wanted = np.isin(relations.at, wanted)
        if not is_wanted.any() or (self.where is None and not is_smooth.any()):
            raise InputError(
                f"linear constraint '{self.name}': no point is on a seam at which the surface is smooth; leave it out"
            )
        if self.where is not None and not is_smooth[is_wanted].all():
            worst = np.argmax(np.where(is_wanted, relations.kinks, 0.0))
            raise InputError(
                f"linear constraint '{self.name}': the surface has a kink of {relations.kinks[worst]:.3g} deg at "
                f"{mesh.place_of_surface_point(relations.at[worst])}; leave it out, or raise max_kink from "
                f"{self.max_kink:g}"
            )
        return is_wanted & is_smooth


def _allowed(mesh: MovingMesh) -> csr_array:
    """Columns of unit displacements that keep the surface control points on their planes, shape (3 n, n_free)."""
    n, rows = len(mesh.surface_ids), mesh.in_plane_rows
    counts = np.bincount(rows, minlength=n)
    normals = np.zeros((n, 3, 3))
    normals[rows, np.arange(len(rows)) - np.searchsorted(rows, rows)] = mesh.in_plane_normals
    frames, is_free = np.tile(np.eye(3), (n, 1, 1)), ~(normals != 0.0).any(axis=1)
    is_oblique = (np.abs(normals) == 1.0).sum(axis=(1, 2)) != counts
    frames[is_oblique] = np.linalg.svd(normals[is_oblique])[2]  # rows of the normals' space come first
    is_free[is_oblique] = np.arange(3) >= counts[is_oblique, None]
    point, direction = np.nonzero(is_free)
    coordinates = 3 * point[:, None] + np.arange(3)
    columns = np.repeat(np.arange(len(point)), 3)
    entries = coo_array((frames[point, direction].ravel(), (coordinates.ravel(), columns)), shape=(3 * n, len(point)))
    allowed = csr_array(entries)
    allowed.eliminate_zeros()
    return allowed


def _on(allowed: csr_array, relations: SeamRelations) -> csr_array:
    """Weights of allowed displacements in the combinations of points that must vanish, shape (3 n, n_free)."""
    scaled = diags_array(relations.sizes, format="csr") @ relations.weights
    n, mirrors = len(relations.at), relations.mirrors
    blocks = np.eye(3) - mirrors[:, :, None] * mirrors[:, None, :]  # only components in symmetry planes
    in_planes = bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n)).tocsr()
    found = csr_array(csr_array(in_planes @ kron(scaled, eye_array(3), format="csr")) @ allowed)
    found.eliminate_zeros()
    return found


def _normal_parts(relations: SeamRelations, points: np.ndarray, allowed: csr_array) -> tuple[csr_array, np.ndarray]:
    """Derivatives of the components of all relations along the mean normals, and these components."""
    n = len(relations.at)
    columns = 3 * np.arange(n)[:, None] + np.arange(3)
    entries = (relations.normals.ravel(), (np.repeat(np.arange(n), 3), columns.ravel()))
    along = csr_array(coo_array(entries, shape=(n, 3 * n)))
    matrix = along @ _on(allowed, relations)
    right = relations.sizes * ((relations.weights @ points) * relations.normals).sum(axis=1)
    return csr_array(matrix), right
