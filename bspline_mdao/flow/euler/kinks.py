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
spacing. Weights are those of the baseline: they do not change with the shape, so that the residual depends on the nodes
by the area vectors alone, and its derivatives stay exact.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numba import njit

from ...cells.cell_faces import CellFaces
from ...numerics.halo import Halo
from ...numerics.processes import summed_number
from .reconstruction import MEAN, Stencil

__all__ = ["with_kinks"]

WORTH = 100.0
"""Weight of the square of a distance in cells, mu: one tenth is worth a change of the weights by one."""

SMALLEST, LARGEST = 0.01, 0.5
"""Changes of a weight: smaller ones are not worth a class of faces of their own, larger ones are cut to this."""

STRETCHED = 10.0
"""Second length of a cell by its least: a grid with more at most of its walls keeps the weights of smooth lines, since
with others Newton's steps do not converge on the spacing of boundary layers."""


def with_kinks(stencil: Stencil, faces: CellFaces, nodes: np.ndarray, halo: Halo) -> Stencil:
    """Weigh the four cells of inner faces by where they are, where that is not where smooth lines have them.

    Parameters
    ----------
    stencil : Stencil
        With the weights of smooth lines.
    faces : CellFaces
    nodes : ndarray, shape (n_nodes, 3)
        Baseline nodes (m).
    halo : Halo
        Exchange of cells with other processes.
    """
    centres, spreads = cell_shapes(faces.corners, faces.left, faces.right, nodes, faces.n_cells + faces.n_ghosts)
    centres, spreads = (halo.extend(np.ascontiguousarray(halo.cut(part))) for part in (centres, spreads))
    lengths = np.linalg.eigvalsh(spreads[faces.left[faces.faces_of("wall")]])
    flat = lengths[:, 1] > STRETCHED**2 * lengths[:, 0]
    if 2 * summed_number(halo.comm, int(flat.sum())) > summed_number(halo.comm, len(flat)):
        return stencil
    inner = slice(0, faces.n_inner)
    changes = weight_changes(*stencil.part(inner), faces.corners[inner], nodes, centres, spreads)
    kinked = np.flatnonzero(np.abs(changes).max(axis=1, initial=0.0) > SMALLEST)
    own = stencil.weights[stencil.classes[kinked]]
    own[:, MEAN] += changes[kinked]
    classes = stencil.classes.astype(np.int32)
    classes[kinked] = len(stencil.weights) + np.arange(len(kinked))
    return replace(stencil, weights=np.concatenate([stencil.weights, own]), classes=classes)


@njit(cache=True, error_model="numpy")
def _face_centre(nodes, corners):
    """Centre of area of a face of two triangles, and its area vector; the mean of its corners where it has no area."""
    a, b, c, d = nodes[corners[0]], nodes[corners[1]], nodes[corners[2]], nodes[corners[3]]
    one, other = 0.5 * np.cross(b - a, c - a), 0.5 * np.cross(c - a, d - a)
    p, q = np.sqrt(np.sum(one * one)), np.sqrt(np.sum(other * other))
    third, fourth = 0.5 * np.cross(b - a, d - a), 0.5 * np.cross(c - b, d - b)
    r, t = np.sqrt(np.sum(third * third)), np.sqrt(np.sum(fourth * fourth))
    if p + q + r + t == 0.0:
        return 0.25 * (a + b + c + d), one + other
    first = p * (a + b + c) + q * (a + c + d) + r * (a + b + d) + t * (b + c + d)
    return first / (3.0 * (p + q + r + t)), one + other


@njit(cache=True, error_model="numpy")
def cell_shapes(corners, left, right, nodes, n_cells):
    """Centres of volume of cells, shape (n_cells, 3), and sums of the squares of their three edges, (n_cells, 3, 3).

    A cell is the pyramids of its faces about the mean of their centres, which is its centre where it has no volume.
    """
    middles, counts = np.zeros((n_cells, 3)), np.zeros(n_cells)
    for f in range(len(corners)):
        centre, _ = _face_centre(nodes, corners[f])
        for side in range(2 if f < len(right) else 1):
            cell = left[f] if side == 0 else right[f]
            middles[cell] += centre
            counts[cell] += 1.0
    moments, volumes, sizes = np.zeros((n_cells, 3)), np.zeros(n_cells), np.zeros(n_cells)
    for cell in range(n_cells):
        middles[cell] /= max(counts[cell], 1.0)
    for f in range(len(corners)):
        centre, area = _face_centre(nodes, corners[f])
        for side in range(2 if f < len(right) else 1):
            cell = left[f] if side == 0 else right[f]
            arm = centre - middles[cell]
            volume = (1.0 if side == 0 else -1.0) * np.sum(area * arm) / 3.0
            volumes[cell] += volume
            sizes[cell] += abs(volume)
            moments[cell] += 0.75 * volume * arm
    spreads = np.zeros((n_cells, 3, 3))
    for cell in range(n_cells):
        if volumes[cell] > 1e-3 * sizes[cell]:
            middles[cell] += moments[cell] / volumes[cell]
    for f in range(len(corners)):
        centre, _ = _face_centre(nodes, corners[f])
        for side in range(2 if f < len(right) else 1):
            cell = left[f] if side == 0 else right[f]
            arm = centre - middles[cell]
            for n in range(3):
                spreads[cell, n] += 2.0 * arm[n] * arm
    return middles, spreads


@njit(cache=True, error_model="numpy")
def weight_changes(cells, weights, classes, roles, corners, nodes, centres, spreads):
    """Changes of the weights of the four cells in the mean states of inner faces, shape (n_inner, 4)."""
    out, places, there = np.zeros((len(cells), 4)), np.zeros((4, 3)), np.zeros(4)
    matrix, miss = np.zeros((3, 3)), np.zeros(3)
    for f in range(len(cells)):
        near, w = cells[f], weights[classes[f]]
        centre, _ = _face_centre(nodes, corners[f])
        there[0], there[1] = (1.0 if near[0] != near[1] else 0.0), 1.0
        there[2], there[3] = 1.0, (1.0 if near[3] != near[2] else 0.0)
        mean, miss[:] = np.zeros(3), 0.0
        for k in range(4):
            places[k] = centres[near[k]] - centre
            miss += w[MEAN, k] * places[k]
            mean += there[k] * places[k] / there.sum()
        matrix[:] = 0.5 / WORTH * (spreads[near[1]] + spreads[near[2]])
        for k in range(4):
            places[k] = there[k] * (places[k] - mean)
            for n in range(3):
                matrix[n] += places[k, n] * places[k]
        size = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
        for n in range(3):
            matrix[n, n] += 1e-12 * size
        rows = np.cross(matrix[1], matrix[2]), np.cross(matrix[2], matrix[0]), np.cross(matrix[0], matrix[1])
        determinant = np.sum(matrix[0] * rows[0])
        if not determinant > 0.0:
            continue
        push = (rows[0] * miss[0] + rows[1] * miss[1] + rows[2] * miss[2]) / determinant
        largest = 0.0
        for k in range(4):
            out[f, k] = -np.sum(places[k] * push)
            largest = max(largest, abs(out[f, k]))
        if largest > LARGEST:
            out[f] *= LARGEST / largest
    return out
