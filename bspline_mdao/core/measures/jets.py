"""Derivatives of a surface of triangles and quads at its nodes, by least-squares polynomials: osculating jets.

Around every node a plane of the baseline has coordinates u and v, and the nearby nodes are fitted by a polynomial in
them. The result are fixed combinations of the nodes for the derivatives of the surface with respect to u and v,
wherever the nodes move. Cells belong together at a node as long as there is no kink between them: at the trailing edge
of a wing, each side has its own derivatives.

Theory: ``docs/theory/geometry.rst``, "Curvature".

References
----------
F. Cazals and M. Pouget, Estimating differential quantities using polynomial fitting of osculating jets, *Computer Aided
Geometric Design* 22, 2005.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array
from scipy.sparse.csgraph import connected_components

from ...base.display import OneLine
from ...base.numerics.vectors import lengths
from ...grids.cells.quads import area_vectors

__all__ = ["DERIVATIVES", "SmoothCorners", "jets"]

DERIVATIVES = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))
"""Derivatives computed with respect to u and v: the five vectors of the fundamental forms."""

KINK = np.cos(np.deg2rad(60.0))
"""Cosine of the angle between neighbouring cells' normals from which there is a kink between them. Coarse meshes turn
by 30 to 40 degrees around a leading edge; a trailing edge turns by 160, a flat tip or a junction by 90."""

DEGREE, N_NEAR = 4, 18
"""Degree of the polynomials, with 15 terms, and minimum number of other nodes fitted: two rings of triangles. On an
elliptic leading edge with 48 nodes around it, radii are 1 to 3 % off; with degree 3 they are 5 to 7 % off."""

LEAST_DEGREE, LEAST_NEAR = 2, 7
"""The same if there are no more nodes, on a patch between kinks."""

NARROW = 2.0
"""Distance of the farthest node in standard deviations of the Gaussian weights."""

MOST_RINGS = 4
"""Number of rings of cells around a node searched for its neighbours."""

CHUNK = 4096
"""Places processed at a time, which bounds memory: about 6 kB for each."""

INDEPENDENT = 1e-4
"""Smallest singular value of the fit, relative to the largest: nodes that lie nearer to a curve have no derivatives
across it."""


@dataclass(frozen=True, eq=False)
class SmoothCorners(OneLine):
    """Cell corners of a surface, joined unless there is a kink between them: the places with a tangent plane."""

    points: np.ndarray  # (n_points, 3), nodes of the baseline (m)
    cells: np.ndarray  # int (n_cells, 4), corners of triangles and quads; triangles repeat their last corner

    @cached_property
    def corners(self) -> np.ndarray:
        """Cell and node of every corner, each once, int (n_corners, 2)."""
        is_new = self.cells != np.roll(self.cells, -1, axis=1)  # of a doubled corner, the last one
        cell, at = np.nonzero(is_new)
        return np.stack([cell, self.cells[cell, at]], axis=1)

    @cached_property
    def place_of_corner(self) -> np.ndarray:
        """Place of every corner, int (n_corners,)."""
        normals = area_vectors(self.points[self.cells])
        normals /= np.maximum(lengths(normals), np.finfo(float).tiny)[:, None]
        n = len(self.points)
        sides = np.stack([self.cells, np.roll(self.cells, -1, axis=1)], axis=-1).reshape(-1, 2)
        cell = np.repeat(np.arange(len(self.cells)), 4)
        is_side = sides[:, 0] != sides[:, 1]
        sides, cell = np.sort(sides[is_side], axis=1), cell[is_side]
        order = np.lexsort([cell, sides[:, 1], sides[:, 0]])
        sides, cell = sides[order], cell[order]
        is_pair = (sides[1:] == sides[:-1]).all(axis=1)
        first, second, shared = cell[:-1][is_pair], cell[1:][is_pair], sides[:-1][is_pair]
        is_smooth = (normals[first] * normals[second]).sum(axis=1) > KINK
        key = self.corners @ [n, 1]
        order = np.argsort(key)
        joined = []
        for end in range(2):
            pair = [(c * n + shared[:, end])[is_smooth] for c in (first, second)]
            joined.append([order[np.searchsorted(key, ids, sorter=order)] for ids in pair])
        starts, ends = (np.concatenate([pair[side] for pair in joined]) for side in range(2))
        graph = coo_array((np.ones(len(starts)), (starts, ends)), shape=(len(key), len(key)))
        return connected_components(graph)[1]

    @cached_property
    def nodes(self) -> np.ndarray:
        """Node of every place, int (n_places,)."""
        nodes = np.empty(self.place_of_corner.max() + 1, dtype=int)
        nodes[self.place_of_corner] = self.corners[:, 1]
        return nodes

    @cached_property
    def areas(self) -> np.ndarray:
        """Area of every place on the baseline (m^2), its corners' fractions of their cells; shape (n_places,)."""
        whole = lengths(area_vectors(self.points[self.cells]))
        cell = self.corners[:, 0]
        return np.bincount(self.place_of_corner, whole[cell] / np.bincount(cell)[cell])

    @cached_property
    def normals(self) -> np.ndarray:
        """Unit normal of every place on the baseline, shape (n_places, 3)."""
        vectors = area_vectors(self.points[self.cells])[self.corners[:, 0]]
        sums = np.stack([np.bincount(self.place_of_corner, column) for column in vectors.T], axis=1)
        return sums / np.maximum(lengths(sums), np.finfo(float).tiny)[:, None]

    @cached_property
    def neighbours(self) -> csr_array:
        """Places that share a cell, bool (n_places, n_places), including each itself."""
        n = len(self.nodes)
        incidence = coo_array(
            (np.ones(len(self.corners)), (self.corners[:, 0], self.place_of_corner)), shape=(len(self.cells), n)
        ).tocsr()
        return csr_array(incidence.T @ incidence + eye_array(n)) > 0


def jets(
    surface: SmoothCorners,
    at: np.ndarray,  # int (n,), places
) -> tuple[list[csr_array], np.ndarray]:
    """Find the derivatives at places as combinations of nodes."""
    # returns one matrix (n, n_points) for each of `DERIVATIVES`, and whether each place has derivatives, bool (n,)
    # 1. Rings of cells are added until there are enough nodes.
    # 2. Nodes get coordinates in the plane of the place, at their true distance.
    # 3. Polynomials are fitted, with more weight for nearer nodes.
    rows: list[np.ndarray] = []
    columns: list[np.ndarray] = []
    values: list[np.ndarray] = []
    is_found = np.zeros(len(at), dtype=bool)
    one = surface.neighbours
    reach, left = csr_array(eye_array(len(surface.nodes), format="csr")[at]) > 0, np.arange(len(at))
    for ring in range(1, MOST_RINGS + 1):  # step 1
        reach = csr_array(reach @ one) > 0
        counts = np.diff(reach.indptr)
        is_last = ring == MOST_RINGS
        for degree, least, is_tried in ((DEGREE, N_NEAR, True), (LEAST_DEGREE, LEAST_NEAR, is_last)):
            ready = np.flatnonzero((counts > least) & ~is_found[left]) if is_tried else np.zeros(0, dtype=int)
            for chosen in _alike(ready, counts):
                count = counts[chosen[0]]
                near = reach.indices[reach.indptr[chosen][:, None] + np.arange(count)]
                places = at[left[chosen]]
                weights, is_good = _fit(surface, places, near, degree)
                kept = left[chosen][is_good]
                is_found[kept] = True
                rows.append(np.repeat(kept, count))
                columns.append(surface.nodes[near[is_good]].ravel())
                values.append(weights[is_good].transpose(1, 0, 2).reshape(len(DERIVATIVES), -1))
        still = np.flatnonzero(~is_found[left])
        reach, left = reach[still], left[still]
        if not len(left):
            break
    shape, none = (len(at), len(surface.points)), np.zeros(0, dtype=int)
    row, column = np.concatenate([none, *rows]), np.concatenate([none, *columns])
    parts = np.concatenate([np.zeros((len(DERIVATIVES), 0)), *values], axis=1)
    return [csr_array((part, (row, column)), shape=shape) for part in parts], is_found


def _alike(ready: np.ndarray, counts: np.ndarray) -> Iterator[np.ndarray]:
    """Split places into groups with equal numbers of nearby nodes, none longer than `CHUNK`."""
    for count in np.unique(counts[ready]):
        chosen = ready[counts[ready] == count]
        yield from (chosen[start : start + CHUNK] for start in range(0, len(chosen), CHUNK))


def _fit(surface: SmoothCorners, places: np.ndarray, near: np.ndarray, degree: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights of nearby nodes in the derivatives at places, (n, 5, n_near), and whether there are derivatives."""
    middle = surface.points[surface.nodes[places]]
    offsets = surface.points[surface.nodes[near]] - middle[:, None]
    distance = np.linalg.norm(offsets, axis=2)
    local = offsets @ tangents(surface.normals[places]).transpose(0, 2, 1)  # step 2
    flat = np.linalg.norm(local, axis=2)
    uv = local * (distance / np.where(flat > 0.0, flat, 1.0))[..., None]
    # coordinates in which nodes are equally far away in all directions: cells may be long and narrow
    value, vector = np.linalg.eigh(np.einsum("nki,nkj->nij", uv, uv))
    scale = np.sqrt(np.maximum(value, np.finfo(float).tiny))
    is_spread = value[:, 0] > INDEPENDENT**2 * value[:, 1]
    whiten = np.einsum("nia,na,nja->nij", vector, 1.0 / np.where(is_spread[:, None], scale, 1.0), vector)
    uv = uv @ whiten
    distance = np.linalg.norm(uv, axis=2)
    size = distance.max(axis=1)[:, None]
    uv, whiten = uv / size[..., None], whiten / size[..., None]
    terms = [(a, total - a) for total in range(degree + 1) for a in range(total, -1, -1)]
    basis = np.stack([uv[..., 0] ** a * uv[..., 1] ** b for a, b in terms], axis=-1)
    weight = np.exp(-0.5 * (NARROW * distance / size) ** 2)  # step 3
    basis *= weight[..., None]
    left, singular, right = np.linalg.svd(basis, full_matrices=False)
    is_good = is_spread & (singular[:, -1] > INDEPENDENT * singular[:, 0])
    divisors = np.where(is_good[:, None], singular, 1.0)
    inverse = np.einsum("nst,ns,nks->ntk", right, 1.0 / divisors, left) * weight[:, None, :]
    u, v, uu, uv_, vv = (factorial(a) * factorial(b) * inverse[:, terms.index((a, b))] for a, b in DERIVATIVES)
    first = np.einsum("nia,ank->ink", whiten, np.stack([u, v]))
    second = np.einsum("nia,njb,abnk->ijnk", whiten, whiten, np.stack([np.stack([uu, uv_]), np.stack([uv_, vv])]))
    return np.stack([*first, second[0, 0], second[0, 1], second[1, 1]], axis=1), is_good


def tangents(normals: np.ndarray) -> np.ndarray:
    """Two unit vectors perpendicular to each unit normal, shape (n, 2, 3)."""
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]
    first = np.cross(normals, axis)
    first /= lengths(first)[:, None]
    return np.stack([first, np.cross(normals, first)], axis=1)
