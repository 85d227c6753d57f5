r"""Weights of mean states where grid lines turn or their spacing jumps.

The mean ``(-a + 7 b + 7 c - d) / 12`` is of the centre of a face where grid lines are smooth. Where they are not, as
about the edges of a wing in an H-H grid, it is of a point that is off by a part of a cell, and the flux of even a
linear field is wrong by its gradient times that. With the places :math:`\mathbf{x}_k` of the four cells' centres from
that of the face, the weights w are changed by :math:`\delta`, the sum of which is zero, such that

.. math::
    \delta^2 + \mu \, \mathbf{e} \cdot \mathbf{M}^{-1} \mathbf{e} , \qquad
    \mathbf{e} = \sum_k (w_k + \delta_k) \, \mathbf{x}_k ,

is least: distances count by the sizes of the two cells next to the face, whose edges :math:`\mathbf{h}_d` make
:math:`\mathbf{M} = \sum_d \mathbf{h}_d \mathbf{h}_d`. On smooth grids :math:`\delta` goes to zero as the square of the
spacing. Which faces have weights of their own is settled on the baseline; their weights are functions of the nodes,
differentiated here.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from ...base.numerics.halo import Halo
from ...base.numerics.processes import summed_number
from ...grids.cells.cell_faces import CellFaces
from .cell_shapes import (
    cell_shapes,
    cell_shapes_jvp,
    cell_shapes_vjp,
    face_centres,
    face_centres_jvp,
    face_centres_vjp,
)
from .reconstruction import Stencil

__all__ = ["Kinks"]

WORTH = 100.0
"""Weight of the square of a distance in cells, mu: one tenth is worth a change of the weights by one."""

SMALLEST, LARGEST = 0.01, 0.5
"""Changes of a weight: smaller ones are not worth a class of faces of their own, larger ones are kept below this."""

OUTER = 0.25
"""Most that the two outer cells weigh together. With more, the mean of what alternates along the line has the wrong
sign, cos(x) (1 - 4 OUTER sin(x)^2) < 0 at some phase x from a face to the next cells, and such waves run backwards."""

STRETCHED = 10.0
"""Second length of a cell by its least: a grid with more at most of its walls keeps the weights of smooth lines, since
with others Newton's steps do not converge on the spacing of boundary layers."""

ROUNDED = 1e-12
"""What is added to the diagonal of the matrix of a face, by its trace, so that it has an inverse."""


@dataclass(frozen=True, eq=False)
class Kinks:
    """Faces with weights of their own, and these as functions of the nodes. Made by `Kinks.of`.

    Nodes are those of this process and of others that it sees, and so are what is returned for them.

    Parameters
    ----------
    faces : CellFaces
    halo : Halo
        Exchange of cells with other processes.
    plain : Stencil
        With the weights of smooth lines.
    ids : ndarray of int, shape (n_kinked,)
        Numbers of the faces, all of them inner ones.
    n_of_grid : int
        Number of those of all processes.
    """

    faces: CellFaces
    halo: Halo
    plain: Stencil
    ids: np.ndarray
    n_of_grid: int

    @classmethod
    def of(cls, plain: Stencil, faces: CellFaces, nodes: np.ndarray, halo: Halo) -> Kinks:
        """Choose the faces by where their four cells are, where that is not where smooth lines have them.

        Parameters
        ----------
        plain : Stencil
            With the weights of smooth lines.
        faces : CellFaces
        nodes : ndarray, shape (n_nodes, 3)
            Baseline nodes (m).
        halo : Halo
            Exchange of cells with other processes.
        """
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
        own = self.plain.means[self.plain.classes[self.ids]] + self.changes(nodes)
        classes = self.plain.classes.astype(np.int32)
        classes[self.ids] = len(self.plain.means) + np.arange(len(self.ids))
        return replace(self.plain, means=np.concatenate([self.plain.means, own]), classes=classes)

    def changes(self, nodes: np.ndarray) -> np.ndarray:
        """Changes of the weights in the mean states of the faces, shape (n_kinked, 4); real or complex."""
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
    def _index(self):
        """Cells and plain weights of the faces."""
        return self.plain.cells[self.ids], self.plain.means[self.plain.classes[self.ids]]

    @property
    def _sides(self):
        """Cells of all faces, and the number of cells."""
        return self.faces.left, self.faces.right, self.faces.n_cells + self.faces.n_ghosts

    def _shapes(self, nodes):
        """Centres and area vectors of the faces, and centres and squares of edges of the cells."""
        middles, areas = face_centres(nodes, self.faces.corners)
        return middles, areas, *self._seen(cell_shapes(middles, areas, *self._sides))

    def _seen(self, shapes):
        """Arrays of cells, those of other processes taken from there."""
        return tuple(self.halo.extend(np.ascontiguousarray(self.halo.cut(part))) for part in shapes)


@njit(cache=True, error_model="numpy")
def weight_changes(cells, weights, middles, centres, spreads):
    """Changes of the weights of the four cells in the mean states of faces, shape (n, 4); real or complex.

    Parameters
    ----------
    cells : ndarray of int, shape (n, 4)
    weights : ndarray, shape (n, 4)
        Weights of smooth lines.
    middles : ndarray, shape (n, 3)
        Centres of the faces (m).
    centres, spreads : ndarray, shapes (n_cells, 3) and (n_cells, 3, 3)
        Centres (m) and sums of the squares of the edges (m^2) of the cells.
    """
    out = np.zeros((len(cells), 4), centres.dtype)
    places, steps = np.zeros((4, 3), centres.dtype), np.zeros((4, 3), centres.dtype)
    inverse, miss, by = np.zeros((3, 3), centres.dtype), np.zeros(3, centres.dtype), np.zeros(4, centres.dtype)
    for f in range(len(cells)):
        _place(cells[f], weights[f], middles[f], centres, places, steps, miss)
        if not _invert(cells[f], steps, spreads, inverse):
            continue
        for k in range(4):
            for n in range(3):
                for m in range(3):
                    out[f, k] -= steps[k, n] * inverse[n, m] * miss[m]
        factor = _cut(out[f], weights[f], by)
        for k in range(4):
            out[f, k] *= factor
    return out


@njit(cache=True, error_model="numpy")
def weight_changes_jvp(cells, weights, middles, centres, spreads, d_middles, d_centres, d_spreads):
    """Change of `weight_changes` with the places and sizes."""
    out, free, d_free, by = np.zeros((len(cells), 4)), np.zeros(4), np.zeros(4), np.zeros(4)
    places, steps, d_places, d_steps = (np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((4, 3)))
    inverse, miss, d_miss, matrix = np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for f in range(len(cells)):
        near = cells[f]
        _place(near, weights[f], middles[f], centres, places, steps, miss)
        _place(near, weights[f], d_middles[f], d_centres, d_places, d_steps, d_miss)
        if not _invert(near, steps, spreads, inverse):
            continue
        matrix[:] = 0.5 / WORTH * (d_spreads[near[1]] + d_spreads[near[2]])
        for k in range(4):
            for n in range(3):
                for m in range(3):
                    matrix[n, m] += d_steps[k, n] * steps[k, m] + steps[k, n] * d_steps[k, m]
        rounding = ROUNDED * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2])
        push = _product(inverse, miss)
        of_push = _product(matrix, push)
        d_miss[0] -= of_push[0] + rounding * push[0]
        d_miss[1] -= of_push[1] + rounding * push[1]
        d_miss[2] -= of_push[2] + rounding * push[2]
        d_push = _product(inverse, d_miss)
        for k in range(4):
            free[k] = -_dot(steps[k], push)
            d_free[k] = -_dot(d_steps[k], push) - _dot(steps[k], d_push)
        factor, change = _cut(free, weights[f], by), 0.0
        for k in range(4):
            change += by[k] * d_free[k]
        for k in range(4):
            out[f, k] = factor * (d_free[k] - change * free[k])
    return out


@njit(cache=True, error_model="numpy")
def weight_changes_vjp(cells, weights, middles, centres, spreads, bar):
    """Transposed product of `weight_changes_jvp`: what middles, centres and spreads get."""
    middles_bar, centres_bar, spreads_bar = np.zeros_like(middles), np.zeros_like(centres), np.zeros_like(spreads)
    places, steps, steps_bar = np.zeros((4, 3)), np.zeros((4, 3)), np.zeros((4, 3))
    inverse, miss, matrix_bar = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
    free, free_bar, by, push_bar, mean_bar = np.zeros(4), np.zeros(4), np.zeros(4), np.zeros(3), np.zeros(3)
    for f in range(len(cells)):
        near = cells[f]
        _place(near, weights[f], middles[f], centres, places, steps, miss)
        if not _invert(near, steps, spreads, inverse):
            continue
        push = _product(inverse, miss)
        for k in range(4):
            free[k] = -_dot(steps[k], push)
        factor, along = _cut(free, weights[f], by), 0.0
        for k in range(4):
            along += free[k] * bar[f, k]
        push_bar[:] = 0.0
        for k in range(4):
            free_bar[k] = factor * (bar[f, k] - along * by[k])
            for n in range(3):
                push_bar[n] -= free_bar[k] * steps[k, n]
        miss_bar = _product(inverse, push_bar)
        for n in range(3):
            for m in range(3):
                matrix_bar[n, m] = -0.5 * (miss_bar[n] * push[m] + push[n] * miss_bar[m])
        rounding = ROUNDED * (matrix_bar[0, 0] + matrix_bar[1, 1] + matrix_bar[2, 2])
        for n in range(3):
            matrix_bar[n, n] += rounding
            mean_bar[n] = 0.0
        for n in range(3):
            for m in range(3):
                spreads_bar[near[1], n, m] += 0.5 / WORTH * matrix_bar[n, m]
                spreads_bar[near[2], n, m] += 0.5 / WORTH * matrix_bar[n, m]
        n_there = 0
        for k in range(4):
            is_there = _is_there(near, k)
            n_there += is_there
            of_step = _product(matrix_bar, steps[k])
            for n in range(3):
                steps_bar[k, n] = 2.0 * of_step[n] - free_bar[k] * push[n] if is_there else 0.0
                mean_bar[n] -= steps_bar[k, n]
        for k in range(4):
            for n in range(3):
                place_bar = weights[f, k] * miss_bar[n] + steps_bar[k, n]
                if _is_there(near, k):
                    place_bar += mean_bar[n] / n_there
                centres_bar[near[k], n] += place_bar
                middles_bar[f, n] -= place_bar
    return middles_bar, centres_bar, spreads_bar


@njit(cache=True, error_model="numpy", inline="always")
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, error_model="numpy", inline="always")
def _product(matrix, vector):
    """Product of a matrix and a vector, as three numbers."""
    return _dot(matrix[0], vector), _dot(matrix[1], vector), _dot(matrix[2], vector)


@njit(cache=True, error_model="numpy", inline="always")
def _is_there(near, k):
    """Whether one of the four cells is no stand-in for a missing one."""
    return not ((k == 0 and near[0] == near[1]) or (k == 3 and near[3] == near[2]))


@njit(cache=True, error_model="numpy")
def _place(near, weights, middle, centres, places, steps, miss):
    """Fill in the places of the cells from the face, their steps from the middle of these, and where the mean is.

    It is linear in the middle and the centres; steps of missing cells are zero.
    """
    mean, n_there = np.zeros_like(miss), 0
    miss[:] = 0.0
    for k in range(4):
        for d in range(3):
            places[k, d] = centres[near[k], d] - middle[d]
            miss[d] += weights[k] * places[k, d]
        if _is_there(near, k):
            n_there += 1
            mean += places[k]
    for k in range(4):
        for d in range(3):
            steps[k, d] = places[k, d] - mean[d] / n_there if _is_there(near, k) else 0.0


@njit(cache=True, error_model="numpy")
def _invert(near, steps, spreads, inverse):
    """Fill in the inverse of the matrix of a face, ``sum_k steps steps^T + M / mu``; False where it has none."""
    m = 0.5 / WORTH * (spreads[near[1]] + spreads[near[2]])
    for k in range(4):
        for n in range(3):
            for j in range(3):
                m[n, j] += steps[k, n] * steps[k, j]
    rounding = ROUNDED * (m[0, 0] + m[1, 1] + m[2, 2])
    for n in range(3):
        m[n, n] += rounding
    for n in range(3):
        a, b = (n + 1) % 3, (n + 2) % 3
        for j in range(3):
            c, d = (j + 1) % 3, (j + 2) % 3
            inverse[j, n] = m[a, c] * m[b, d] - m[a, d] * m[b, c]
    determinant = m[0, 0] * inverse[0, 0] + m[0, 1] * inverse[1, 0] + m[0, 2] * inverse[2, 0]
    if not determinant.real > 0.0:
        return False
    inverse /= determinant
    return True


@njit(cache=True, error_model="numpy")
def _cut(changes, weights, by):
    """Factor that keeps changes of weights below what is allowed; ``by`` receives minus the gradient of its logarithm.

    It is ``(1 + sum_k (changes_k / LARGEST)^8 + (outer / room)^8)^(-1/8)``, smooth, and 1 to 0.05 % up to half of both.
    """
    outer, room = changes[0] + changes[3], OUTER - weights[0] - weights[3]
    total, beyond = 1.0 + 0.0 * outer, 0.0 * outer
    if outer.real > 0.0:
        beyond = _seventh(outer / room) / room
        total += beyond * outer
    for k in range(4):
        by[k] = _seventh(changes[k] / LARGEST) / LARGEST
        total += by[k] * changes[k]
    for k in range(4):
        by[k] = (by[k] + beyond) / total if k == 0 or k == 3 else by[k] / total
    return 1.0 / np.sqrt(np.sqrt(np.sqrt(total)))


@njit(cache=True, error_model="numpy", inline="always")
def _seventh(x):
    """Seventh power; that of a complex number keeps a small imaginary part, as ``**`` does not."""
    return x * x * x * x * x * x * x
