"""The neighbours around every node of a surface, in order, completed at rims by mirror images and continuations.

Theory: ``docs/theory/extrusion.rst``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ....errors import InputError
from .repeats import Repeats
from .surface import SurfaceMesh


class Rings(NamedTuple):
    """Neighbours of every node, counterclockwise around the outward normal, and their images beyond rims."""

    # The difference to neighbour k of node i is ``maps[image[k]] @ (x[nodes[k]] - x[i]) + shifts[image[k]]``
    starts: np.ndarray  # int (n + 1,)
    nodes: np.ndarray  # int (n_neighbours,)
    image: np.ndarray  # int (n_neighbours,), 0 for the neighbour itself
    maps: np.ndarray  # (n_maps, 3, 3)
    shifts: np.ndarray  # (n_maps, 3) (m)


class Fans(NamedTuple):
    """Neighbours of every node, counterclockwise; for nodes at the rim from one edge of it to the other."""

    starts: np.ndarray  # int (n + 1,)
    nodes: np.ndarray  # int (n_neighbours,)
    shift: np.ndarray  # int (n_neighbours,), translation of each, see `Repeats`
    is_open: np.ndarray  # bool (n,), nodes at the rim


def fans_of(mesh: SurfaceMesh, repeats: Repeats) -> Fans:
    """Sort the neighbours of the marching nodes; refuse nodes at which parts of the surface touch in a point."""
    # around the corner of a quad, the neighbour after it is followed by the one before it
    quads = mesh.quads
    previous = np.roll(quads, 1, axis=1)
    previous = np.where(previous == quads, np.roll(quads, 2, axis=1), previous)
    following = np.roll(quads, -1, axis=1)
    real = following != quads  # of a node that occurs twice in a row, the second counts for both
    here, after, before = quads[real], following[real], previous[real]
    here, after, before = repeats.unknown[here], repeats.keys(here, after), repeats.keys(here, before)
    order = np.lexsort((after, here))
    here, after, before = here[order], after[order], before[order]
    n = len(repeats.first)
    corner_starts = np.searchsorted(here, np.arange(n + 1))
    nodes, starts, is_open, bad = _chain(n, corner_starts, after, before)
    if bad >= 0:
        x, y, z = mesh.points[repeats.first[bad]]
        raise InputError(
            f"{mesh.source}: parts of the surface touch only in the point ({x:.6g}, {y:.6g}, {z:.6g}); give a surface "
            f"without such points"
        )
    nodes, shift = np.divmod(nodes[: starts[-1]], repeats.n_shifts)
    return Fans(starts, nodes, shift, is_open)


@njit(cache=True)
def _chain(n, corner_starts, after, before):
    """Chain the corners around every node."""
    starts = np.zeros(n + 1, np.int64)
    nodes = np.empty(len(after) + n, np.int64)
    is_open = np.zeros(n, np.bool_)
    at = 0
    for i in range(n):
        lo, hi = corner_starts[i], corner_starts[i + 1]
        first = after[lo]
        for k in range(lo, hi):
            found = False
            for m in range(lo, hi):
                found |= before[m] == after[k]
            if not found:
                first, is_open[i] = after[k], True
        node, count = first, 0
        for _ in range(hi - lo):
            nodes[at + count] = node
            count += 1
            step = -1
            for k in range(lo, hi):
                if after[k] == node:
                    step = before[k]
            if step < 0:
                return nodes, starts, is_open, i
            node = step
            if node == first:
                break
        if count != hi - lo or (not is_open[i] and node != first):
            return nodes, starts, is_open, i
        if is_open[i]:
            nodes[at + count] = node
            count += 1
        at += count
        starts[i + 1] = at
    return nodes, starts, is_open, -1


def complete_rings(
    fans: Fans,
    kinds: np.ndarray,  # int (n, 2), for nodes at the rim: maps of the rim's edges first and last in the fan
    maps: np.ndarray,  # (n_maps, 3, 3): 0 the identity, 1 the inversion, others mirrors at planes
    shifts: np.ndarray,  # (n_shifts, 3), translations of neighbours (m)
) -> Rings:
    """Add images of the fans of nodes at the rim, so that neighbours surround every node."""
    starts, nodes, image = _complete(fans.starts, fans.nodes, fans.shift, fans.is_open, kinds, len(shifts))
    of_both = np.repeat(maps, len(shifts), axis=0), np.einsum("mij,sj->msi", maps, shifts).reshape(-1, 3)
    return Rings(starts, nodes[: starts[-1]], image[: starts[-1]], *of_both)


@njit(cache=True)
def _complete(fan_starts, fan_nodes, fan_shift, is_open, kinds, n_shifts):
    """Fill the rings; the image of a neighbour is its map times ``n_shifts``, plus its translation."""
    n = len(is_open)
    starts = np.zeros(n + 1, np.int64)
    nodes = np.empty(2 * len(fan_nodes), np.int64)
    image = np.zeros(2 * len(fan_nodes), np.int64)
    at = 0
    for i in range(n):
        lo, hi = fan_starts[i], fan_starts[i + 1]
        for k in range(lo, hi):
            nodes[at], image[at] = fan_nodes[k], fan_shift[k]
            at += 1
        if is_open[i]:
            a, b = kinds[i, 0], kinds[i, 1]
            if a != b and hi - lo == 2:  # a corner: both edges are seen in the other's mirror
                nodes[at], image[at] = fan_nodes[lo], b * n_shifts + fan_shift[lo]
                nodes[at + 1], image[at + 1] = fan_nodes[hi - 1], a * n_shifts + fan_shift[hi - 1]
                at += 2
            elif a != b or hi - lo == 2:  # a corner with more cells, or without a mirror
                for k in range(lo, hi):
                    nodes[at], image[at] = fan_nodes[k], n_shifts + fan_shift[k]
                    at += 1
            elif a == 1:  # continued to the other side
                for k in range(lo + 1, hi - 1):
                    nodes[at], image[at] = fan_nodes[k], n_shifts + fan_shift[k]
                    at += 1
            else:
                for k in range(hi - 2, lo, -1):
                    nodes[at], image[at] = fan_nodes[k], a * n_shifts + fan_shift[k]
                    at += 1
        starts[i + 1] = at
    return starts, nodes, image
