"""Completion of regions where nodes do not quite meet.

Next to a wall, round-off of the file can be as large as the cells, and nodes that belong together can be farther apart
than nodes of one cell. They cannot be paired one by one. Two things tell what belongs together all the same: a match
found elsewhere on the two faces maps the whole of one to the other, and the surfaces of the faces can be compared on
their own, without the thin cells across them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from scipy.ndimage import label
from scipy.spatial import cKDTree

from .coincidence import NEAR_MISS_TOLERANCE, THIN_CELL_LIMIT, Coincidence
from .faces import Face, quad_corners
from .index_space import Window
from .matching import Quads, Region, find_regions, match_quads
from .rectangles import Rectangle


@dataclass(frozen=True)
class Meeting:
    """Faces of a grid and how far apart nodes that meet may be.

    Parameters
    ----------
    faces, quads
        All faces and their quads.
    is_free : ndarray of bool, shape (n_quads,)
        Quads that may meet others: not degenerate, not declared.
    blocks : sequence of ndarray, shape (ni, nj, nk, 3)
        Nodes of each block.
    coincidence : Coincidence
        What is known of single nodes.
    """

    faces: Sequence[Face]
    quads: Quads
    is_free: np.ndarray
    blocks: Sequence[np.ndarray]
    coincidence: Coincidence

    def complete(self, regions: Sequence[Region]) -> tuple[list[Region], list[Region]]:
        """Extend regions over the quads that their maps carry onto each other, the largest first.

        A quad is added whose corners meet within round-off of the file. One whose corners meet within
        `NEAR_MISS_TOLERANCE` of the local spacing is added as well if it lies in a hole of the region that has no open
        neighbour, and if most corners of the region with its holes meet as they are.

        Where round-off is as large as cells, surfaces are compared as well, and a quad that could be part of several
        regions goes to the largest.

        Returns
        -------
        completed : list of Region
            The regions.
        doubtful : list of Region
            Holes in them whose corners are up to a quarter of a cell apart, which are not filled.
        """
        completed = self._completed(regions)
        if self.coincidence.is_coarse:
            found = self._face_regions(completed)
            if found:
                completed = self._completed(_merged([*completed, *found]))
        is_free = self.is_free.copy()
        for region in completed:
            is_free[region.pairs] = False
        doubtful = (self._extended(region, is_free, THIN_CELL_LIMIT, 0.0) for region in completed)
        return completed, [
            replace(region, pairs=pairs[is_free[pairs].all(axis=1)]) for region, pairs in zip(completed, doubtful)
        ]

    def _completed(self, regions: Sequence[Region]) -> list[Region]:
        is_free = self.is_free.copy()
        if not self.coincidence.is_coarse:
            for region in regions:
                is_free[region.pairs] = False
        completed = []
        for region in sorted(regions, key=lambda region: -len(region.pairs)):
            if self.coincidence.is_coarse:
                region = replace(region, pairs=region.pairs[is_free[region.pairs].all(axis=1)])
            pairs = self._extended(region, is_free)
            is_free[pairs] = False
            if len(pairs):
                completed.append(replace(region, pairs=pairs))
        return sorted(completed, key=_key)

    def _extended(
        self, region: Region, is_free: np.ndarray, tolerance: float = NEAR_MISS_TOLERANCE, least_share: float = 0.5
    ) -> np.ndarray:
        """Pairs of quads, the lower number first, of a region and of what is free and belongs to it.

        Holes are filled whose corners are within a tolerance of their partners, by the local spacing, if a least share
        of the corners of the region meets.
        """
        share, distance, partner = self._carried(region)
        quads = np.arange(partner.size).reshape(partner.shape) + self.quads.starts(len(self.faces))[region.a]
        can_join = is_free[quads] & (partner >= 0) & is_free[partner]
        is_in = (share == 1.0) & can_join
        is_in[self.quads.p[region.pairs[:, 0]], self.quads.q[region.pairs[:, 0]]] = True
        holes = _bounded_holes((distance <= tolerance) & can_join & ~is_in, can_join & ~is_in)
        if holes.any() and share[is_in | holes].mean() >= least_share:
            is_in |= holes
        pairs = np.stack([quads[is_in], partner[is_in]], axis=1)
        return pairs[pairs[:, 0] < pairs[:, 1]]

    def _carried(self, region: Region) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Carry face a of a region to face b.

        Returns
        -------
        share : ndarray, shape `Face.n_quads`
            Share of the corners of each quad that are one with their partners, or within round-off of them.
        distance : ndarray, shape `Face.n_quads`
            Largest distance of the other corners, by the local spacing.
        partner : ndarray of int, shape `Face.n_quads`
            Quads of face b that they are carried to; -1 beyond it.
        """
        a, b = self.faces[region.a], self.faces[region.b]
        overlap = _overlap(region, a, b)
        interface = region.interface(self.faces, overlap)
        here, there = (self._at(side) for side in (interface.a, interface.b))
        gap = here[0] - interface.orientation.apply(there[0])
        spacing = np.minimum(here[1], interface.orientation.apply(there[1]))
        rounding = self.coincidence.rounding(here[0])
        is_met = (np.abs(gap).max(axis=-1) <= rounding) | (here[2] == interface.orientation.apply(there[2]))
        distance = np.where(is_met, 0.0, np.linalg.norm(gap, axis=-1) / spacing)
        inside = tuple(slice(lo, hi + 1) for lo, hi in zip(overlap.lo, overlap.hi))
        share, largest = np.zeros(a.n_quads), np.full(a.n_quads, np.inf)
        share[inside] = quad_corners(is_met.squeeze(a.normal)).mean(axis=-1)
        largest[inside] = quad_corners(distance.squeeze(a.normal)).max(axis=-1)
        partner = np.full(a.n_quads, -1)
        r, s = region.carry_quads(*np.mgrid[inside])
        partner[inside] = self.quads.starts(len(self.faces))[region.b] + r * b.n_quads[1] + s
        return share, largest, partner

    def _at(self, window: Window) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes of a face window, the spacing at them, and the points on which they lie."""
        known = self.coincidence
        return tuple(arrays[window.block][window.slices] for arrays in (self.blocks, known.spacing, known.ids))

    def _face_regions(self, regions: Sequence[Region]) -> list[Region]:
        """Find regions of quads that no region holds yet by comparing one surface with another."""
        is_free = self.is_free.copy()
        for region in regions:
            is_free[region.pairs] = False
        starts = [*self.quads.starts(len(self.faces)), len(is_free)]
        surfaces = [
            _Surface.of(number, face, self._at(face.window)[0], is_free[start:end], self.coincidence)
            for number, (face, start, end) in enumerate(zip(self.faces, starts, starts[1:]))
            if is_free[start:end].any() and not face.is_line
        ]
        found = []
        for f, g in combinations_with_replacement(surfaces, 2):
            for region in f.regions_with(g):
                pairs = region.pairs + [starts[f.number], starts[g.number] - (f is not g) * len(f.is_free)]
                found.append(replace(region, a=f.number, b=g.number, pairs=pairs))
        return found


@dataclass(frozen=True)
class _Surface:
    """A face on its own.

    Parameters
    ----------
    number : int
        Its number.
    face : Face
        The face.
    nodes : ndarray, shape (n, 3)
        Its nodes (m).
    reach : ndarray, shape (n,)
        How far a node may be from the one it meets (m): round-off, less where edges in the face are short.
    is_free : ndarray of bool, shape (n_quads,)
        Quads that may meet others.
    """

    number: int
    face: Face
    nodes: np.ndarray
    reach: np.ndarray
    is_free: np.ndarray

    @classmethod
    def of(cls, number: int, face: Face, nodes: np.ndarray, is_free: np.ndarray, coincidence: Coincidence) -> _Surface:
        nodes = nodes.squeeze(face.normal)
        shortest = np.full(nodes.shape[:2], np.inf)
        for axis in range(2):
            length = np.linalg.norm(np.diff(nodes, axis=axis), axis=-1)
            near = np.moveaxis(shortest, axis, 0)
            for part in (near[1:], near[:-1]):
                np.minimum(part, np.moveaxis(length, axis, 0), out=part)
        reach = np.minimum(coincidence.rounding(nodes), THIN_CELL_LIMIT * shortest)
        return cls(number, face, nodes.reshape(-1, 3), reach.ravel(), is_free)

    def regions_with(self, other: _Surface) -> list[Region]:
        """Find regions of this surface, as face 0, and another one, as face 1; of face 0 alone if it is the same."""
        here, there = self._met_nodes(other)
        if len(here) < 4:
            return []
        n = len(self.nodes)
        ids = np.arange(n + len(other.nodes))
        pair = [self] if self is other else [self, other]
        ids[here] = np.minimum(here, there) if self is other else n + there
        faces = [
            replace(surface.face, ids=part.reshape(surface.face.ids.shape))
            for surface, part in zip(pair, np.split(ids, [n]))
        ]
        quads = Quads.of(faces)
        quads.is_degenerate[~np.concatenate([surface.is_free for surface in pair])] = True
        pairs = match_quads(quads, np.zeros(len(quads.face), dtype=bool)).pairs
        return find_regions(quads, pairs)

    def _met_nodes(self, other: _Surface) -> tuple[np.ndarray, np.ndarray]:
        """Nodes of this surface that meet one of another surface, and those; of the same one, other nodes than they."""
        reach = self.reach.max(initial=0.0)
        low, high = other.nodes.min(axis=0) - reach, other.nodes.max(axis=0) + reach
        here = np.flatnonzero(((self.nodes >= low) & (self.nodes <= high)).all(axis=1))
        if len(here) < 4:
            return here, here
        distance, there = cKDTree(other.nodes).query(self.nodes[here], k=[2 if self is other else 1], p=np.inf)
        distance, there = distance[:, 0], there[:, 0]
        is_met = distance <= np.minimum(self.reach[here], other.reach[there])
        return here[is_met], there[is_met]


def _key(region: Region):
    return region.a, region.b, region.turn, region.shift


def _merged(regions: Sequence[Region]) -> list[Region]:
    """Make regions of the same faces, turn and shift one."""
    groups: dict[tuple, list[Region]] = {}
    for region in regions:
        groups.setdefault(_key(region), []).append(region)
    return [
        replace(group[0], pairs=np.unique(np.concatenate([region.pairs for region in group]), axis=0))
        for group in groups.values()
    ]


def _bounded_holes(is_hole: np.ndarray, is_open: np.ndarray) -> np.ndarray:
    """Pick the holes, made of quads that share edges, that have no open quad beside them that is not of a hole."""
    holes, n_holes = label(is_hole)
    padded = np.pad(is_open & ~is_hole, 1)
    beside = padded[2:, 1:-1] | padded[:-2, 1:-1] | padded[1:-1, 2:] | padded[1:-1, :-2]
    is_bounded = np.ones(n_holes + 1, dtype=bool)
    is_bounded[holes[beside]] = False
    is_bounded[0] = False
    return is_bounded[holes]


def _overlap(region: Region, a: Face, b: Face) -> Rectangle:
    """Find the quads of face a that the map of a region carries into face b."""
    far = region.reverse().carry(Rectangle((0, 0), tuple(n - 1 for n in b.n_quads)))
    lo = tuple(max(index, 0) for index in far.lo)
    return Rectangle(lo, tuple(min(index, n - 1) for index, n in zip(far.hi, a.n_quads)))
