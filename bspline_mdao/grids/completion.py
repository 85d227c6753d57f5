"""Completion of regions where round-off is as large as the cells.

In 4-byte data with a wall spacing of a few units in the last place, nodes near the wall cannot be paired one by one.
Away from the wall they can; the match found there maps the whole of one face to the other, and every quad whose
corners meet its image within round-off belongs to the region too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .coincidence import ROUND_OFF_UNITS
from .faces import Face, quad_corners
from .matching import Quads, Region
from .rectangles import Rectangle


def complete_regions(
    regions: Sequence[Region], faces: Sequence[Face], quads: Quads, is_free: np.ndarray, blocks, round_off: float
) -> list[Region]:
    """Extend regions over quads that meet within round-off.

    Parameters
    ----------
    regions : sequence of Region
        Regions found from coincident nodes, completed the largest first.
    faces, quads
        All faces and their quads.
    is_free : ndarray of bool, shape (n_quads,)
        Quads that may be added: not degenerate, not declared.
    blocks : sequence of ndarray, shape (ni, nj, nk, 3)
        Nodes of each block.
    round_off : float
        Relative precision of the data.
    """
    is_free = is_free.copy()
    for region in regions:
        is_free[region.pairs] = False
    completed = []
    for region in sorted(regions, key=lambda region: -len(region.pairs)):
        pairs = _meeting_quads(region, faces, quads, blocks, round_off)
        pairs = pairs[is_free[pairs].all(axis=1)]
        is_free[pairs] = False
        completed.append(replace(region, pairs=np.concatenate([region.pairs, pairs])))
    return sorted(completed, key=lambda region: (region.a, region.b, region.turn, region.shift))


def _meeting_quads(region: Region, faces: Sequence[Face], quads: Quads, blocks, round_off: float) -> np.ndarray:
    """Pairs of quads, the lower number first, that the map of a region carries onto each other within round-off."""
    a, b = faces[region.a], faces[region.b]
    overlap = _overlap(region, a, b)
    interface = region.interface(faces, overlap)
    here = blocks[interface.a.block][interface.a.slices]
    there = interface.orientation.apply(blocks[interface.b.block][interface.b.slices])
    gap = np.linalg.norm(here - there, axis=-1)
    is_met = (gap <= ROUND_OFF_UNITS * round_off * np.abs(here).max(axis=-1)).squeeze(a.normal)
    p, q = np.nonzero(quad_corners(is_met).all(axis=-1))
    p, q = p + overlap.lo[0], q + overlap.lo[1]
    r, s = region.carry_quads(p, q)
    starts = quads.starts(len(faces))
    pairs = np.stack([starts[region.a] + p * a.n_quads[1] + q, starts[region.b] + r * b.n_quads[1] + s], axis=1)
    return pairs[pairs[:, 0] < pairs[:, 1]]


def _overlap(region: Region, a: Face, b: Face) -> Rectangle:
    """Find the quads of face a that the map of a region carries into face b."""
    far = region.reverse().carry(Rectangle((0, 0), tuple(n - 1 for n in b.n_quads)))
    lo = tuple(max(index, 0) for index in far.lo)
    return Rectangle(lo, tuple(min(index, n - 1) for index, n in zip(far.hi, a.n_quads)))
