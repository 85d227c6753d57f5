"""Where a wing meets a body: nodes slide on the body, and nearby nodes follow.

Design variables may move the junction off the body. So its nodes are projected to the nearest points on the body's
surface, keeping their baseline offset. The surface is one of the fixed surfaces that nodes slide on; if none is given
it is the smooth surface through the body's nodes, from their normals and curvatures. The rest of the wing's
displacement fades into the wing, and the slide of the junction fades into the body, over a distance. Variables of the
body's own shape follow: they move the body's nodes from where they have slid to, and their effect on the junction fades
into the wing as well. Theory: ``docs/theory/free_form.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array, kron
from scipy.spatial import cKDTree

from ...base.display import OneLine
from ...errors import InputError
from ..measures.jets import SmoothCorners, jets
from ..mesh.control_net import surface_quads
from ..sliding.fixed_surface import FixedSurface, Plane, require_near
from ..sliding.node_surface import NodeSurface
from ..sliding.sliding_nodes import Slide, SlidingNodes, SlidNodes
from .displacement import selector
from .selection import Where, rows_of
from .variable import DesignMap, Layout, MapPartials, block_diagonal, product_on_pattern, sum_on_pattern

__all__ = ["Junction"]

REACH = 1.5
"""Distance within which a body node contributes to the surface, relative to the longest edge there. On a cylinder with
ten edges along its radius the surface error is 6e-5 of the radius; with twice the reach 26e-5, with 1.2 4e-5 and fewer
neighbours."""

SAME_PLANE = 6
"""Decimals to which the normals of one plane agree."""

ROUGH = 0.07
"""Largest distance between the surface and a node, as a fraction of its longest edge. For an ellipsoid with two edges
along its radius it is at most 0.06, and sliding nodes leave it by 1 % of the radius; for a cylinder with edges of 48
degrees it is 0.1, and sliding nodes leave it by 20 %."""

N_NEAREST = 16
"""Number of junction nodes whose displacements a nearby node takes, weighted by their inverse squared distances less
the next node's: so the set of nodes changes where their weight is zero. Without this, the four nearest change between
two rows of nodes behind the wing that are 2e-4 m apart, and 12 cells of the wing on a fuselage fold."""

AS_NEAR = 1e-9
"""Relative difference in distance below which nodes count as equally near: on the axis of a round junction all nodes
are equally near, with equal weights."""


@dataclass(frozen=True, eq=False)
class Junction(OneLine):
    """Let a wing slide on a body that keeps its shape.

    The design surface contains both. The variables' effect on the body is discarded, except for variables of its own
    shape: its nodes near the wing slide on it with the wing, and the wing's root stays on it. For a fitted
    block-structured grid the design surface must be of nodes, `bspline_mdao.DesignSurface.of_nodes`; for an
    unstructured mesh it always is.

    Parameters
    ----------
    body : Selection or array_like of int
        Nodes of the body, including nodes shared with the wing; numbers are rows of ``mesh.surface_ids``.
    reach : float
        Distance from the junction (m) over which displacements fade, on the wing and on the body: about three times as
        far as the wing is to slide.
    surface : FixedSurface, optional
        The surface of the body: a formula, such as a `Cylinder`, or a `PatchedSurface` of its faces. By default a
        smooth surface through the body's nodes.
    shape : sequence of str
        Names of variables of the body's own shape, applied after the wing has slid. If they move points depending on
        their current position, as `RadiusFactor` does, the junction stays on the reshaped body.
    rigid : float
        Distance from the junction (m), less than ``reach``, within which everything, such as a fillet, moves rigidly:
        displacements fade from there on.

    Examples
    --------
    >>> from bspline_mdao.design import InBox, Junction
    >>> Junction(InBox(high=(None, None, 0.5)), reach=0.8).reach
    0.8
    """

    body: Where
    reach: float
    surface: FixedSurface | None = None
    shape: Sequence[str] = ()
    rigid: float = 0.0

    def bind(self, layout: Layout) -> SlidingJunction:
        """Compute what depends only on the baseline.

        Raises
        ------
        InputError
            If the mesh has block control points, the wing does not meet the body, the body has a kink near the wing,
            its nodes are far off the given surface, the reach is not positive, or ``rigid`` is not within it.
        """
        if layout.mesh.parameters is not None:
            raise InputError(
                "junction: control points of blocks are off wing and body, and nodes would not stay on the body; make "
                "the design surface of nodes, DesignSurface.of_nodes(model), or lay a lattice around the grid (fit "
                "--lattice)"
            )
        if not self.reach > 0.0:
            raise InputError(f"junction: reach {self.reach}; give a positive distance in metres")
        if not 0.0 <= self.rigid < self.reach:
            raise InputError(f"junction: rigid {self.rigid}; give a distance in metres, 0 or more, below {self.reach}")
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
        surface = self.surface or _through_nodes(SmoothCorners(points, quads[on_body]), body, layout)
        if self.surface is not None:
            near, cure = "the size of the body near it", "leave it out"
            require_near(surface, points[body], lambda n: mesh.place_of_surface_point(body[n]), "junction", near, cure)
        return SlidingJunction(
            layout,
            junction=junction,
            near=near_body,
            resting=np.setdiff1d(others, near_body),
            root=_sliding(surface, junction, layout),
            collar=_sliding(surface, near_body, layout),
            into_wing=selector(near_wing, len(layout.points)) @ self._fading(tree, points[near_wing]),
            into_body=self._fading(tree, points[near_body]),
        )

    def _fading(self, tree: cKDTree, points: np.ndarray) -> csr_array:
        """Map from displacements of junction nodes to displacements of points, xyz interleaved: (3 m, 3 n)."""
        k = min(N_NEAREST, tree.n)
        distances, nearest = (np.reshape(found, (len(points), k + 1)) for found in tree.query(points, k=k + 1))
        part = np.maximum(distances[:, 0] - self.rigid, 0.0) / (self.reach - self.rigid)
        fade = 1.0 - part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
        # nodes of another grid may coincide with a junction node; missing nodes are at infinity
        apart = np.maximum(distances, np.finfo(float).tiny)
        closeness = apart[:, :1] / apart
        weights = (closeness[:, :-1] - closeness[:, -1:]) ** 2
        weights[weights[:, 0] < AS_NEAR**2] = 1.0
        weights *= (fade / weights.sum(axis=1))[:, None]
        nearest = nearest[:, :-1]
        rows = np.repeat(np.arange(len(points)), k)
        matrix = csr_array((weights.ravel(), (rows, nearest.ravel())), shape=(len(points), tree.n))
        return csr_array(kron(matrix, eye_array(3), format="csr"))


@dataclass(frozen=True, eq=False)
class SlidingJunction(OneLine):
    """A junction bound to rows: a map without values."""

    layout: Layout
    junction: np.ndarray  # int (n,), rows of the junction
    near: np.ndarray  # int (m,), rows of the body within reach of it
    resting: np.ndarray  # int, the body's other rows
    # both on the body's surface, and in their symmetry planes
    root: SlidingNodes
    collar: SlidingNodes
    into_wing: csr_array  # (3 n_rows, 3 n), displacements of the rows by the remaining displacement at the junction
    into_body: csr_array  # (3 m, 3 n), displacements of the body by the slides of the junction

    initial = np.zeros(0)
    """No values."""

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres; real or complex."""
        root, collar = self._closest(points)
        left_over = (root.points - points[self.junction]).reshape(-1)
        moved = points + (self.into_wing @ left_over).reshape(-1, 3)
        moved[self.junction], moved[self.near] = root.points, collar.points
        moved[self.resting] = self.layout.points[self.resting]
        return moved

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        root, collar = self._closest(points)
        n_rows = len(points)
        picked = selector(self.junction, n_rows)
        slid = product_on_pattern(block_diagonal(root.jacobians), picked.T.tocsr())
        left_over = sum_on_pattern(slid, -picked.T.tocsr())
        body = product_on_pattern(block_diagonal(collar.jacobians), product_on_pattern(self.into_body, slid))
        found = sum_on_pattern(
            self._others,
            product_on_pattern(self.into_wing, left_over),
            product_on_pattern(picked, slid),
            product_on_pattern(selector(self.near, n_rows), body),
        )
        return MapPartials(found, csr_array((3 * n_rows, 0)))

    def shaped(self, of_body: DesignMap) -> ShapedBody:
        """Return the map of a variable of the body's own shape."""
        body = np.concatenate([self.junction, self.near, self.resting])
        return ShapedBody(of_body, body, self.junction, self.into_wing)

    @cached_property
    def _others(self) -> csr_array:
        """Ones for the coordinates outside the body."""
        kept = np.ones(len(self.layout.points))
        kept[np.concatenate([self.junction, self.near, self.resting])] = 0.0
        return _picking(np.repeat(kept, 3))

    def _closest(self, points: np.ndarray) -> tuple[SlidNodes, SlidNodes]:
        """Where the junction slides to, and where the nearby body follows."""
        root = self.root.at(points[self.junction])
        gone = self.into_body @ (root.points - self.layout.points[self.junction]).reshape(-1)
        return root, self.collar.at(self.layout.points[self.near] + gone.reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class ShapedBody(OneLine):
    """A variable of the shape of a body, which the wing's root follows."""

    of_body: DesignMap  # of all rows
    body: np.ndarray  # int, rows of the body
    junction: np.ndarray  # int (n,), rows shared with the wing
    into_wing: csr_array  # (3 n_rows, 3 n), displacements of the rows by the junction's displacements

    @property
    def initial(self) -> np.ndarray:
        """Values at which nothing moves."""
        return self.of_body.initial

    def apply(self, points: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Move all rows, shape (n_rows, 3), in metres; real or complex."""
        asked = self.of_body.apply(points, values)
        gone = (asked - points)[self.junction].reshape(-1)
        moved = points + (self.into_wing @ gone).reshape(-1, 3)
        moved[self.body] = asked[self.body]
        return moved

    def partials(self, points: np.ndarray, values: np.ndarray) -> MapPartials:
        """Differentiate `apply`."""
        found, n = self.of_body.partials(points, values), points.size
        is_body = np.zeros(n)
        is_body[(3 * self.body[:, None] + np.arange(3)).ravel()] = 1.0
        kept, others = (_picking(mask) for mask in (is_body, 1.0 - is_body))
        fading = product_on_pattern(self.into_wing, selector(self.junction, len(points)).T.tocsr())
        gone = sum_on_pattern(found.points, -eye_array(n, format="csr"))
        return MapPartials(
            sum_on_pattern(others, product_on_pattern(kept, found.points), product_on_pattern(fading, gone)),
            sum_on_pattern(product_on_pattern(kept, found.values), product_on_pattern(fading, found.values)),
        )


def _picking(mask: np.ndarray) -> csr_array:
    """Diagonal matrix of a mask of ones and zeros."""
    found = csr_array(diags_array(mask))
    found.eliminate_zeros()
    return found


def _sliding(surface: FixedSurface, rows: np.ndarray, layout: Layout) -> SlidingNodes:
    """Nodes by their rows, ascending, on a surface and in their symmetry planes."""
    mesh, points = layout.mesh, layout.points
    normals, which = np.unique(np.round(mesh.in_plane_normals, SAME_PLANE), axis=0, return_inverse=True)
    slides, members = [Slide("junction", surface)], [rows]
    for number in range(len(normals)):
        of_plane = which.ravel() == number
        normal, ids = mesh.in_plane_normals[np.argmax(of_plane)], mesh.in_plane_rows[of_plane]
        slides.append(Slide("junction", Plane(normal, float(points[ids[0]] @ normal))))
        members.append(np.intersect1d(ids, rows))
    return SlidingNodes.of_members(slides, members, points)


def _through_nodes(body: SmoothCorners, rows: np.ndarray, layout: Layout) -> NodeSurface:
    """The surface through the body nodes that are not on a kink; some of them must not be."""
    matrices, is_found = jets(body, np.arange(len(body.nodes)))
    counts = np.bincount(body.nodes, minlength=len(body.points))
    places = np.flatnonzero(is_found & (counts[body.nodes] == 1))
    nodes = body.nodes[places]
    is_smooth = np.isin(rows, nodes)
    if not is_smooth.all():
        place = layout.mesh.place_of_surface_point(int(rows[np.argmin(is_smooth)]))
        raise InputError(
            f"junction: the body has a kink at {place}, or too few nodes around it for a curvature; take a shorter "
            f"reach, or a finer mesh"
        )
    along_u, along_v, *second = (csr_array(matrix)[places] @ body.points for matrix in matrices)
    normals = np.cross(along_u, along_v)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    uu, uv, vv = (np.sum(vector * normals, axis=1) for vector in second)
    form = np.stack([np.stack([uu, uv], axis=-1), np.stack([uv, vv], axis=-1)], axis=-2)
    parts = np.linalg.pinv(np.stack([along_u, along_v], axis=-1))  # (n, 2, 3), coordinates of tangent vectors
    curvatures = np.einsum("nai,nab,nbj->nij", parts, form, parts)
    longest = np.zeros(len(body.points))
    for first, other in ((body.cells, np.roll(body.cells, 1, axis=1)), (body.cells, np.roll(body.cells, -1, axis=1))):
        np.maximum.at(longest, first, np.linalg.norm(body.points[first] - body.points[other], axis=2))
    surface = NodeSurface(body.points[nodes], normals, curvatures, REACH * longest[nodes])
    off = np.abs(surface.levels(body.points[rows]).values) / longest[rows]
    worst = int(np.argmax(off))
    if off[worst] > ROUGH:
        raise InputError(
            f"junction: the smooth surface through the body's nodes misses "
            f"{layout.mesh.place_of_surface_point(rows[worst])} by {off[worst]:.2g} of its edges: they are too few for "
            f"one; give the surface, or a finer mesh"
        )
    return surface
