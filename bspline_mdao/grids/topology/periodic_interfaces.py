"""Interfaces with a motion: the two sides of a periodic pair, matched like faces of blocks that meet.

The nodes of one side, moved, lie on the nodes of the other. So its quads match quads there as in
`bspline_mdao.grids.topology.matching`, in any orientation and however both sides are cut into blocks. The result is
interfaces, by which blocks are cut into segments and linked. A pair with unmatched quads is not tied.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from .faces import Face, quad_corners
from .index_space import Interface, Window
from .matching import Quads, Region, find_interfaces, find_regions, match_quads, overlap_of
from .periodic_pair import Motion, PeriodicPair
from .rotation_fit import CLOSE
from .shell import OnFaces, Shell

__all__ = ["periodic_interfaces"]


def periodic_interfaces(
    pair: PeriodicPair,
    blocks: Sequence[Shell],  # nodes on the faces of all blocks (m)
    faces: Sequence[Face],  # faces of all blocks
    ids: Sequence[OnFaces],  # points on which nodes lie
) -> list[Interface]:  # side a is on the pair's windows, side b on the others; empty if nodes are not one to one
    """Match the two sides of a pair."""
    nodes, others = (np.concatenate([blocks[w.block].at(w).reshape(-1, 3) for w in side]) for side in _sides(pair))
    points = np.concatenate([ids[window.block].at(window).ravel() for window in pair.others])
    met = points[cKDTree(others).query(pair.motion.move(nodes))[1]]
    here = _masked(faces, pair.windows, np.split(met, np.cumsum([np.prod(w.shape) for w in pair.windows])[:-1]))
    there = _masked(faces, pair.others, [ids[window.block].at(window).ravel() for window in pair.others])
    both = [face for face, _ in (*here, *there)]
    quads = Quads.of(both)
    quads.is_degenerate[~np.concatenate([mask.ravel() for _, mask in (*here, *there)])] = True
    is_free, n_here = ~quads.is_degenerate, len(here)
    size = 2.0 * float(np.abs(np.concatenate([nodes, others]) - nodes.mean(axis=0)).max())
    regions = find_regions(quads, match_quads(quads, np.zeros(len(is_free), dtype=bool)).pairs)
    regions = sorted((r for r in regions if r.a < n_here <= r.b), key=lambda region: -len(region.pairs))
    found: list[Region] = []
    for region in regions:
        found.append(_completed(region, both, quads, blocks, pair.motion, CLOSE * size, is_free))
        is_free[found[-1].pairs] = False
    return [] if is_free.any() else find_interfaces(both, quads, [region for region in found if len(region.pairs)])


def _sides(pair: PeriodicPair) -> tuple[tuple[Window, ...], tuple[Window, ...]]:
    return pair.windows, pair.others


def _masked(
    faces: Sequence[Face], windows: Sequence[Window], points: Sequence[np.ndarray]
) -> list[tuple[Face, np.ndarray]]:
    """Faces that contain windows, with new points of their nodes, and which of their quads the windows cover."""
    found = []
    for face in faces:
        of_face = [n for n, window in enumerate(windows) if face.covered(window).any()]
        if of_face:
            ids, mask = np.full(face.ids.shape, -1), np.zeros(face.n_quads, dtype=bool)
            for n in of_face:
                ids[tuple(windows[n].slices[d] for d in face.tangents)] = points[n].reshape(
                    [windows[n].shape[d] for d in face.tangents]
                )
                mask |= face.covered(windows[n])
            found.append((replace(face, ids=ids), mask))
    return found


def _completed(
    region: Region,
    faces: Sequence[Face],
    quads: Quads,
    blocks: Sequence[Shell],
    motion: Motion,
    near: float,
    is_free: np.ndarray,
) -> Region:
    """Extend a region over all free quads that its map places onto each other: thin cells may be below round-off."""
    a, b = faces[region.a], faces[region.b]
    overlap = overlap_of(region, a, b)
    interface = region.interface(faces, overlap)
    here, there = (blocks[side.block].at(side) for side in (interface.a, interface.b))
    gap = motion.move(here.reshape(-1, 3)).reshape(here.shape) - interface.orientation.apply(there)
    is_met = quad_corners((np.linalg.norm(gap, axis=-1) <= near).squeeze(a.normal)).all(axis=-1)
    starts = quads.starts(len(faces))
    p, q = np.mgrid[tuple(slice(lo, hi + 1) for lo, hi in zip(overlap.lo, overlap.hi))]
    r, s = region.map_quads(p, q)
    pairs = np.stack([starts[region.a] + p * a.n_quads[1] + q, starts[region.b] + r * b.n_quads[1] + s], axis=-1)
    return replace(region, pairs=pairs[is_met & is_free[pairs].all(axis=-1)])
