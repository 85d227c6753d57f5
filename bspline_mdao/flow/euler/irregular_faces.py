r"""Weights of mean states at irregular faces: where grid lines turn or their spacing jumps.

The mean ``(-a + 7 b + 7 c - d) / 12`` is at the centre of a face if grid lines are smooth. If they are not, as near the
edges of a wing in an H-H grid, it is at a point that is off by a fraction of a cell, and the flux of even a linear
field is wrong by its gradient times this distance. With the places :math:`\mathbf{x}_k` of the centres of the four
cells relative to the centre of the face, the weights w are changed by :math:`\delta`, with zero sum, such that

.. math::
    \delta^2 + \mu \, \mathbf{e} \cdot \mathbf{M}^{-1} \mathbf{e} , \qquad
    \mathbf{e} = \sum_k (w_k + \delta_k) \, \mathbf{x}_k ,

is minimal: distances are relative to the sizes of the two cells next to the face, whose edges :math:`\mathbf{h}_d` make
:math:`\mathbf{M} = \sum_d \mathbf{h}_d \mathbf{h}_d`. On smooth grids :math:`\delta` goes to zero as the square of the
spacing. The baseline determines which faces have weights of their own; their weights are functions of the nodes,
differentiated here.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ...base.numerics.halo import Halo
from ...base.numerics.processes import summed_number
from ...base.numerics.vectors import add, add_to, row
from ...grids.cells.cell_faces import CellFaces
from .cell_shapes import (
    cell_shapes,
    cell_shapes_jvp,
    cell_shapes_vjp,
    face_centres,
    face_centres_jvp,
    face_centres_vjp,
)
from .irregular_bounds_derivatives import bounded_changes_jvp, bounded_changes_vjp
from .irregular_weights import bounded_changes, free_changes
from .irregular_weights_derivatives import free_changes_jvp, free_changes_vjp
from .reconstruction import Stencil

__all__ = ["IrregularFaces"]

SMALLEST = 0.01
"""Smaller changes of a weight do not justify a class of faces of their own."""

STRETCHED = 10.0
"""Ratio of a cell's second length to its smallest: grids with larger ratios at most of their walls keep the weights of
smooth lines, since Newton's method does not converge with others on the spacing of boundary layers."""


@dataclass(frozen=True, eq=False)
class IrregularFaces:
    """Faces with weights of their own, and these as functions of the nodes. Made by `IrregularFaces.of`."""

    # Nodes are those of this process and of others that it sees, as are the adjoints returned for them.

    faces: CellFaces
    halo: Halo  # exchange of cells with other processes
    plain: Stencil  # with the weights of smooth lines
    ids: np.ndarray  # (n_irregular,) of int, numbers of the faces, all of them inner ones
    n_of_grid: int  # number on all processes

    @classmethod
    def of(
        cls,
        plain: Stencil,  # with the weights of smooth lines
        faces: CellFaces,
        nodes: np.ndarray,  # (n_nodes, 3), baseline nodes (m)
        halo: Halo,  # exchange of cells with other processes
    ) -> IrregularFaces:
        """Choose the faces whose four cells are not where smooth lines would have them."""
        every = cls(faces, halo, plain, np.arange(faces.n_inner), faces.n_inner)
        spreads = every._shapes(nodes)[-1]
        lengths = np.linalg.eigvalsh(spreads[faces.left[faces.faces_of("wall")]])
        flat = lengths[:, 1] > STRETCHED**2 * lengths[:, 0]
        if 2 * summed_number(halo.comm, int(flat.sum())) > summed_number(halo.comm, len(flat)):
            return replace(every, ids=every.ids[:0], n_of_grid=0)
        ids = np.flatnonzero(np.abs(every.changes(nodes)).max(axis=1, initial=0.0) > SMALLEST)
        return replace(every, ids=ids, n_of_grid=int(summed_number(halo.comm, len(ids))))

    def stencil(self, nodes: np.ndarray) -> Stencil:
        """Cells and weights of all faces on a grid, shape (n_nodes, 3), in metres; real or complex."""
        if not self.n_of_grid:
            return self.plain
        changed = self.plain.means[self.plain.classes[self.ids]] + self.changes(nodes)
        classes = self.plain.classes.copy()
        classes[self.ids] = len(self.plain.means) + np.arange(len(self.ids))
        return replace(self.plain, means=np.concatenate([self.plain.means, changed]), classes=classes)

    def changes(self, nodes: np.ndarray) -> np.ndarray:
        """Changes of the weights in the mean states of the faces, shape (n_irregular, 4); real or complex."""
        middles, _, centres, spreads = self._shapes(nodes)
        return weight_changes(*self._index, middles[self.ids], centres, spreads)

    def changes_jvp(self, nodes: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
        """Change of `changes` with the nodes."""
        middles, areas, centres, spreads = self._shapes(nodes)
        d_middles, d_areas = face_centres_jvp(nodes, self.faces.corners, d_nodes)
        d_shapes = self._seen(cell_shapes_jvp(middles, areas, *self._sides, d_middles, d_areas))
        at = middles[self.ids], centres, spreads
        return weight_changes_jvp(*self._index, *at, d_middles[self.ids], *d_shapes)

    def changes_vjp(self, nodes: np.ndarray, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `changes_jvp`, shape (n_nodes, 3)."""
        middles, areas, centres, spreads = self._shapes(nodes)
        found = weight_changes_vjp(*self._index, middles[self.ids], centres, spreads, bar)
        centres_bar, spreads_bar = (self.halo.pad(self.halo.fold(part)) for part in found[1:])
        sides = self.faces.left, self.faces.right
        middles_bar, areas_bar = cell_shapes_vjp(middles, areas, *sides, centres_bar, spreads_bar)
        middles_bar[self.ids] += found[0]
        return face_centres_vjp(nodes, self.faces.corners, middles_bar, areas_bar)

    @property
    def _index(self) -> tuple[np.ndarray, np.ndarray]:
        """Cells and plain weights of the faces."""
        return self.plain.cells[self.ids], self.plain.means[self.plain.classes[self.ids]]

    @property
    def _sides(self) -> tuple[np.ndarray, np.ndarray, int]:
        """Cells of all faces, and the number of cells."""
        return self.faces.left, self.faces.right, self.faces.n_cells + self.faces.n_ghosts

    def _shapes(self, nodes: np.ndarray) -> tuple:
        """Centres and area vectors of the faces, and centres and squares of edges of the cells."""
        middles, areas = face_centres(nodes, self.faces.corners)
        return middles, areas, *self._seen(cell_shapes(middles, areas, *self._sides))

    def _seen(self, shapes: tuple[np.ndarray, ...]) -> tuple[np.ndarray, ...]:
        """Arrays of cells, extended by the cells of other processes."""
        return tuple(self.halo.extend(np.ascontiguousarray(self.halo.cut(part))) for part in shapes)


@njit(cache=True, error_model="numpy")
def weight_changes(
    cells: np.ndarray,  # (n, 4) of int
    weights: np.ndarray,  # (n, 4), weights of smooth lines
    middles: np.ndarray,  # (n, 3), centres of the faces (m)
    # centres, spreads: (n_cells, 3) and (n_cells, 3, 3), centres (m) and sums of the squares of the edges (m^2) of the
    # cells
    centres: np.ndarray,
    spreads: np.ndarray,
) -> np.ndarray:
    """Changes of the weights of the four cells in the mean states of faces, shape (n, 4); real or complex."""
    out = np.zeros((len(cells), 4), centres.dtype)
    for f in range(len(cells)):
        changed = _four(weights, f)
        free, determinant = free_changes(_face(f, cells[f], middles, centres, spreads), changed, *_are_there(cells[f]))
        if determinant.real > 0.0:
            _put(out, f, bounded_changes(free, changed, _is_more(free)))
    return out


@njit(cache=True, error_model="numpy")
def weight_changes_jvp(cells, weights, middles, centres, spreads, d_middles, d_centres, d_spreads):
    """Change of `weight_changes` with the places and sizes."""
    out = np.zeros((len(cells), 4))
    for f in range(len(cells)):
        changed, (has_first, has_last) = _four(weights, f), _are_there(cells[f])
        face = _face(f, cells[f], middles, centres, spreads)
        free, determinant = free_changes(face, changed, has_first, has_last)
        if determinant > 0.0:
            d_face = _face(f, cells[f], d_middles, d_centres, d_spreads)
            d_free, _ = free_changes_jvp(face, changed, has_first, has_last, d_face)
            _put(out, f, bounded_changes_jvp(free, changed, _is_more(free), d_free))
    return out


@njit(cache=True, error_model="numpy")
def weight_changes_vjp(cells, weights, middles, centres, spreads, bar):
    """Transposed product of `weight_changes_jvp`: adjoints of middles, centres and spreads."""
    middles_bar, centres_bar, spreads_bar = np.zeros_like(middles), np.zeros_like(centres), np.zeros_like(spreads)
    for f in range(len(cells)):
        near, changed, (has_first, has_last) = cells[f], _four(weights, f), _are_there(cells[f])
        face = _face(f, near, middles, centres, spreads)
        free, determinant = free_changes(face, changed, has_first, has_last)
        if determinant > 0.0:
            free_bar = bounded_changes_vjp(free, changed, _is_more(free), _four(bar, f))
            bars = free_changes_vjp(face, changed, has_first, has_last, (free_bar, 0.0))
            add_to(middles_bar, f, bars[0])
            add_to(centres_bar, near[0], bars[1])
            add_to(centres_bar, near[1], bars[2])
            add_to(centres_bar, near[2], bars[3])
            add_to(centres_bar, near[3], bars[4])
            for n in range(3):
                add_to(spreads_bar[near[1]], n, bars[5][n])
                add_to(spreads_bar[near[2]], n, bars[5][n])
    return middles_bar, centres_bar, spreads_bar


@njit(cache=True, error_model="numpy", inline="always")
def _face(f, near, middles, centres, spreads):
    """The arguments of `free_changes` for a face."""
    one, other = spreads[near[1]], spreads[near[2]]
    spread = (
        add(row(one, 0), row(other, 0)),
        add(row(one, 1), row(other, 1)),
        add(row(one, 2), row(other, 2)),
    )
    places = row(centres, near[0]), row(centres, near[1]), row(centres, near[2]), row(centres, near[3])
    return row(middles, f), *places, spread


@njit(cache=True, error_model="numpy", inline="always")
def _are_there(near):
    """Whether the first and the last of four cells exist, rather than standing in for missing ones, as numbers."""
    return (1.0 if near[0] != near[1] else 0.0), (1.0 if near[3] != near[2] else 0.0)


@njit(cache=True, error_model="numpy", inline="always")
def _is_more(changes):
    """Whether the two outer cells gain weight, as a number."""
    return 1.0 if (changes[0] + changes[3]).real > 0.0 else 0.0


@njit(cache=True, error_model="numpy", inline="always")
def _four(values, f):
    return values[f, 0], values[f, 1], values[f, 2], values[f, 3]


@njit(cache=True, error_model="numpy", inline="always")
def _put(values, f, four):
    for k in range(4):
        values[f, k] = four[k]
