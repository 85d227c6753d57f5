"""Where a wing meets a body that keeps its shape: nodes slide on the body, and those beside them go along.

What design variables ask of the junction may lead off the body. Every node of the body has a tangent plane and
curvatures on the baseline (`bspline_mdao.core.measures.jets`), which make a paraboloid; a displacement d there becomes

    s(d) = (1 - n n^T) d + 1/2 n d^T K d ,

n being the unit normal and K the second fundamental form. What is left over of the wing's displacement fades into the
wing, and the slide of the junction fades into the body, over a distance. Theory: ``docs/theory/free_form.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array, kron
from scipy.spatial import cKDTree

from ...base.display import OneLine
from ...errors import InputError
from ..measures.jets import SmoothCorners, jets
from ..mesh.control_net import surface_quads
from .displacement import selector
from .selection import Where, rows_of
from .variable import Layout, MapPartials, block_diagonal, product_on_pattern, sum_on_pattern

__all__ = ["Junction"]

N_NEAREST = 4
"""Nodes of the junction whose displacements a node beside it takes, by the inverse of the square of their distances."""


@dataclass(frozen=True, eq=False)
class Junction(OneLine):
    """Let a wing slide on a body that keeps its shape.

    The design surface holds both. Whatever the variables do to the body is put aside: it keeps its shape, its nodes
    near the wing slide on it along with the wing, and the wing's root stays on it.

    Parameters
    ----------
    body : Selection or array_like of int
        Nodes of the body, those that it shares with the wing among them; numbers are rows of ``mesh.surface_ids``.
    reach : float
        Distance from the junction (m) over which displacements fade, on the wing and on the body.

    Examples
    --------
    >>> from bspline_mdao.design import InBox, Junction
    >>> Junction(InBox(high=(None, None, 0.5)), reach=0.8).reach
    0.8
    """

    body: Where
    reach: float

    def bind(self, layout: Layout) -> SlidingJunction:
        """Decide what depends on the baseline alone.

        Raises
        ------
        InputError
            If the wing does not meet the body, the body has a kink near it, or the reach is not positive.
        """
        if not self.reach > 0.0:
            raise InputError(f"junction: reach {self.reach}; give a positive distance in metres")
        mesh, points, quads = layout.mesh, layout.points[layout.rows()], surface_quads(layout.mesh)
        is_body = np.zeros(len(points), dtype=bool)
        is_body[rows_of(self.body, mesh, "junction: body")] = True
        on_body = is_body[quads].all(axis=1)
        junction = np.intersect1d(quads[on_body], quads[~on_body])
        if not len(junction):
            raise InputError("junction: no node is both of the body and of a face beside it; select other nodes")
        others = np.setdiff1d(quads[on_body], junction)
        wing = np.setdiff1d(quads[~on_body], junction)
        tree = cKDTree(points[junction])
        near_body = others[tree.query(points[others])[0] < self.reach]
        near_wing = wing[tree.query(points[wing])[0] < self.reach]
        body = np.concatenate([junction, near_body])
        normals, curvatures = _paraboloids(SmoothCorners(points, quads[on_body]), body, layout)
        return SlidingJunction(
            layout,
            junction=junction,
            near=near_body,
            resting=np.setdiff1d(others, near_body),
            normals=normals,
            curvatures=curvatures,
            into_wing=selector(near_wing, len(layout.points)) @ _fading(tree, points[near_wing], self.reach),
            into_body=_fading(tree, points[near_body], self.reach),
        )


@dataclass(frozen=True, eq=False)
class SlidingJunction(OneLine):
    """A junction that is bound to rows: a map without values."""

    layout: Layout
    junction: np.ndarray  # int (n,), rows of the junction
    near: np.ndarray  # int (m,), rows of the body within reach of it
    resting: np.ndarray  # int, the body's other rows
    normals: np.ndarray  # (n + m, 3), unit normals of the body at both
    curvatures: np.ndarray  # (n + m, 3, 3), its second fundamental form there (1/m)
    into_wing: csr_array  # (3 n_rows, 3 n), displacements of the rows by what is left over at the junction
    into_body: csr_array  # (3 m, 3 n), displacements of the body by the slides of the junction

    initial = np.zeros(0)
    """No values."""

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres; real or complex."""
        asked = points - self.layout.points
        slid, gone = self._slides(asked)
        left_over = (slid - asked[self.junction]).reshape(-1)
        moved = points + (self.into_wing @ left_over).reshape(-1, 3)
        moved[self.junction] = self.layout.points[self.junction] + slid
        moved[self.near] = self.layout.points[self.near] + self._slide(gone, len(self.junction))
        moved[self.resting] = self.layout.points[self.resting]
        return moved

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        asked, n, n_rows = points - self.layout.points, len(self.junction), len(self.layout.points)
        _, gone = self._slides(asked)
        picked = selector(self.junction, n_rows)
        slid = product_on_pattern(block_diagonal(self._rates(asked[self.junction], 0)), picked.T.tocsr())
        left_over = sum_on_pattern(slid, -picked.T.tocsr())
        body = product_on_pattern(block_diagonal(self._rates(gone, n)), product_on_pattern(self.into_body, slid))
        found = sum_on_pattern(
            self._others,
            product_on_pattern(self.into_wing, left_over),
            product_on_pattern(picked, slid),
            product_on_pattern(selector(self.near, n_rows), body),
        )
        return MapPartials(found, csr_array((3 * n_rows, 0)))

    @cached_property
    def _others(self) -> csr_array:
        """Ones for the coordinates that are not of the body."""
        kept = np.ones(len(self.layout.points))
        kept[np.concatenate([self.junction, self.near, self.resting])] = 0.0
        found = csr_array(diags_array(np.repeat(kept, 3)))
        found.eliminate_zeros()
        return found

    def _slides(self, asked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Slides of the junction, (n, 3), and what the body near it is asked to do, (m, 3)."""
        slid = self._slide(asked[self.junction], 0)
        return slid, (self.into_body @ slid.reshape(-1)).reshape(-1, 3)

    def _slide(self, asked: np.ndarray, first: int) -> np.ndarray:
        """Displacements on the body of asked ones, at its rows from one on."""
        normals, curvatures = (part[first : first + len(asked)] for part in (self.normals, self.curvatures))
        height = 0.5 * np.einsum("ni,nij,nj->n", asked, curvatures, asked) - (asked * normals).sum(axis=1)
        return asked + height[:, None] * normals

    def _rates(self, asked: np.ndarray, first: int) -> np.ndarray:
        """Derivatives of `_slide`, shape (n, 3, 3)."""
        normals, curvatures = (part[first : first + len(asked)] for part in (self.normals, self.curvatures))
        rise = np.einsum("nij,nj->ni", curvatures, asked) - normals
        return np.eye(3) + normals[:, :, None] * rise[:, None, :]


def _paraboloids(body: SmoothCorners, rows: np.ndarray, layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals, (n, 3), and second fundamental forms, (n, 3, 3), of a body at some of its nodes."""
    counts = np.bincount(body.nodes, minlength=len(body.points))
    order = np.argsort(body.nodes, kind="stable")
    places = order[np.searchsorted(body.nodes, rows, sorter=order)]
    matrices, is_found = jets(body, places)
    is_smooth = is_found & (counts[rows] == 1)
    if not is_smooth.all():
        place = layout.mesh.place_of_surface_point(int(rows[np.argmin(is_smooth)]))
        raise InputError(
            f"junction: the body has a kink at {place}, or too few nodes around it for a curvature; take a shorter "
            f"reach, or a finer mesh"
        )
    along_u, along_v, *second = (matrix @ body.points for matrix in matrices)
    normals = np.cross(along_u, along_v)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    uu, uv, vv = (np.sum(vector * normals, axis=1) for vector in second)
    form = np.stack([np.stack([uu, uv], axis=-1), np.stack([uv, vv], axis=-1)], axis=-2)
    parts = np.linalg.pinv(np.stack([along_u, along_v], axis=-1))  # (n, 2, 3), coordinates of tangent vectors
    return normals, np.einsum("nai,nab,nbj->nij", parts, form, parts)


def _fading(tree: cKDTree, points: np.ndarray, reach: float) -> csr_array:
    """Displacements of points, xyz interleaved, by those of the nodes of a junction: (3 m, 3 n)."""
    k = min(N_NEAREST, tree.n)
    distances, nearest = (np.reshape(found, (len(points), k)) for found in tree.query(points, k=k))
    part = distances[:, 0] / reach
    fade = 1.0 - part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    weights = distances**-2.0
    weights *= (fade / weights.sum(axis=1))[:, None]
    rows = np.repeat(np.arange(len(points)), k)
    matrix = csr_array((weights.ravel(), (rows, nearest.ravel())), shape=(len(points), tree.n))
    return csr_array(kron(matrix, eye_array(3), format="csr"))
