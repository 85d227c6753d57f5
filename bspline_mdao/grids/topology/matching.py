"""Interfaces from the quads of block faces that lie on the same points.

Two quads on the same four points match in one of eight ways (*turns*): the tangent directions are parallel or crossed,
and each may run backwards. Quads that match by the same turn and the same shift of indices form a region of two faces;
the rectangles of a region are interfaces.

Next to a wall, round-off of the file can be as large as the cells, and nodes that belong together can be farther apart
than nodes of one cell, so they cannot be paired one by one. Two other facts determine what belongs together: a match
found elsewhere on the two faces maps the whole of one to the other, and the surfaces of the faces can be compared
without the thin cells across them. This completes the regions (`Meeting`).

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations_with_replacement

import numpy as np
from scipy.ndimage import label
from scipy.spatial import cKDTree

from .coincidence import NEAR_MISS_TOLERANCE, THIN_CELL_LIMIT, Coincidence
from .faces import Face, Rectangle, decompose, quad_corners
from .index_space import Interface, Orientation, Window
from .shell import Shell

MAX_RECTANGLES = 64
"""Largest number of rectangles of a region; more ragged regions keep the largest ones."""

_TURNS: list[tuple[int, ...]] = [(swap, flip0, flip1) for swap in (0, 1) for flip0 in (0, 1) for flip1 in (0, 1)]
_TURNED_CORNERS = np.array(
    [
        [(q ^ f1) + 2 * (p ^ f0) if swap else (p ^ f0) + 2 * (q ^ f1) for q in (0, 1) for p in (0, 1)]
        for swap, f0, f1 in _TURNS
    ]
)
"""Corner of the second quad that meets corner p + 2 q of the first, for each turn."""


@dataclass(frozen=True)
class Quads:
    """The quads of all faces, in order of the faces, each face in C order."""

    corners: np.ndarray  # (n, 4) of int, points at the corners
    # face, p, q: (n,) of int, face number and indices of the quad
    face: np.ndarray
    p: np.ndarray
    q: np.ndarray
    is_degenerate: np.ndarray  # (n,) of bool, true for quads without area, and for line faces without length

    @classmethod
    def of(cls, faces: Sequence[Face]) -> Quads:
        """Collect the quads of all faces."""
        corners = np.concatenate([face.quads() for face in faces])
        sizes = [face.n_quads[0] * face.n_quads[1] for face in faces]
        number = np.repeat(np.arange(len(faces)), sizes)
        p, q = (np.concatenate([np.indices(face.n_quads)[axis].ravel() for face in faces]) for axis in range(2))
        ordered = np.sort(corners, axis=1)
        n_points = 1 + np.count_nonzero(np.diff(ordered, axis=1), axis=1)
        needed = np.array([2 if face.is_line else 3 for face in faces])
        return cls(corners, number, p, q, n_points < needed[number])

    def starts(self, n_faces: int) -> np.ndarray:
        """Count the quads before each face."""
        return np.searchsorted(self.face, np.arange(n_faces))


@dataclass(frozen=True)
class Matches:
    """Quads that lie on the same points."""

    pairs: np.ndarray  # (n, 2) of int, pairs of quads that are one, the lower number first
    separated: np.ndarray  # (m, 2) of int, pairs of coincident quads of which at least one is declared
    ambiguous: np.ndarray  # (l,) of int, undeclared quads that coincide with two or more others


def match_quads(quads: Quads, is_declared: np.ndarray) -> Matches:
    """Find the quads that lie on the same points; declared ones, and those coincident with them, are kept apart."""
    live = np.flatnonzero(~quads.is_degenerate)
    keys = np.sort(quads.corners[live], axis=1)
    order = np.lexsort(keys.T)
    is_new = np.ones(len(live), dtype=bool)
    is_new[1:] = np.any(keys[order[1:]] != keys[order[:-1]], axis=1)
    group = np.cumsum(is_new) - 1
    size = np.bincount(group)[group]
    is_apart = (np.bincount(group, weights=is_declared[live[order]]) > 0)[group]
    is_second = ~is_new & ~is_apart & (size == 2)
    others = np.flatnonzero(~is_new & is_apart)
    first = np.flatnonzero(is_new)[group[others]]
    second = np.flatnonzero(is_second)
    member = live[order]
    return Matches(
        np.stack([member[second - 1], member[second]], axis=1),
        np.stack([member[first], member[others]], axis=1),
        member[~is_apart & (size > 2)],
    )


@dataclass(frozen=True)
class Region:
    """Quads of face a that match quads of face b by one turn and one shift of indices."""

    # Quad ``(p, q)`` of a meets the quad of b whose indices along p and q are ``shift[0] -+ p`` and ``shift[1] -+ q``.

    a: int
    b: int
    turn: int
    shift: tuple[int, ...]
    pairs: np.ndarray

    def map_quads(self, p: int | np.ndarray, q: int | np.ndarray) -> tuple:
        """Return the indices in face b of the quads that meet quads (p, q) of face a."""
        swap, flip0, flip1 = _TURNS[self.turn]
        ends = (self.shift[0] + (-p if flip0 else p), self.shift[1] + (-q if flip1 else q))
        return ends[::-1] if swap else ends

    def map_rectangle(self, rectangle: Rectangle) -> Rectangle:
        """Return the rectangle of face b that meets a rectangle of face a."""
        ends = self.map_quads(*rectangle.lo), self.map_quads(*rectangle.hi)
        return Rectangle(tuple(map(min, *ends)), tuple(map(max, *ends)))

    def reverse(self) -> Region:
        """Exchange the faces of the region, and the quads of its pairs."""
        swap, *flips = _TURNS[self.turn]
        shift = tuple(s if flip else -s for s, flip in zip(self.shift, flips))
        step = -1 if swap else 1
        turn = _TURNS.index((swap, *flips[::step]))
        return Region(self.b, self.a, turn, shift[::step], self.pairs[:, ::-1])

    def interface(self, faces: Sequence[Face], rectangle: Rectangle) -> Interface:
        """Make the interface over a rectangle of face a."""
        a, b = faces[self.a], faces[self.b]
        return Interface(a.part(rectangle), b.part(self.map_rectangle(rectangle)), _orientation(a, b, self.turn))


def find_regions(quads: Quads, pairs: np.ndarray) -> list[Region]:
    """Group pairs of quads by their faces, turn and shift, in that order."""
    # If more than one turn fits (across the flat direction of a line) the first, which does not flip, is taken.
    a, b = pairs.T
    fits = (quads.corners[b][:, _TURNED_CORNERS] == quads.corners[a][:, None]).all(axis=2)
    pairs, turn = pairs[fits.any(axis=1)], fits[fits.any(axis=1)].argmax(axis=1)
    a, b = pairs.T
    keys = np.stack([quads.face[a], quads.face[b], turn, *_shifts(quads, a, b, turn)], axis=1)
    kinds, kind = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(kind.ravel(), kind="stable")
    ends = np.cumsum(np.bincount(kind.ravel(), minlength=len(kinds)))
    return [_region(key, pairs[members]) for key, members in zip(kinds, np.split(order, ends[:-1]))]


def find_interfaces(faces: Sequence[Face], quads: Quads, regions: Sequence[Region]) -> list[Interface]:
    """Cut regions into rectangles, each an interface."""
    interfaces = []
    for region in regions:
        mask = np.zeros(faces[region.a].n_quads, dtype=bool)
        mask[quads.p[region.pairs[:, 0]], quads.q[region.pairs[:, 0]]] = True
        interfaces += [region.interface(faces, part) for part in decompose(mask, MAX_RECTANGLES)]
    return interfaces


def _region(kind: np.ndarray, pairs: np.ndarray) -> Region:
    """Make the region of pairs of one kind: faces, turn and shift."""
    a, b, turn, *shift = (int(value) for value in kind)
    return Region(a, b, turn, tuple(shift), pairs)


def _shifts(quads: Quads, a: np.ndarray, b: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shift of the indices of quads b along the p and q of quads a."""
    swap, flip0, flip1 = np.array(_TURNS)[turn].T
    along_p = np.where(swap, quads.q[b], quads.p[b])
    along_q = np.where(swap, quads.p[b], quads.q[b])
    return along_p + np.where(flip0, 1, -1) * quads.p[a], along_q + np.where(flip1, 1, -1) * quads.q[a]


def _orientation(a: Face, b: Face, turn: int) -> Orientation:
    """Return the orientation of blocks for a turn of their faces."""
    swap, *flips = _TURNS[turn]
    perm, flip = [0, 0, 0], [False] * 3
    perm[a.normal], flip[a.normal] = b.normal, a.is_high == b.is_high
    for axis, d in enumerate(a.tangents):
        perm[d], flip[d] = b.tangents[axis ^ swap], bool(flips[axis])
    return Orientation(tuple(perm), tuple(flip))


@dataclass(frozen=True)
class Meeting:
    """Faces of a grid, and the largest distance between nodes that meet."""

    # faces, quads: all faces and their quads
    faces: Sequence[Face]
    quads: Quads
    is_free: np.ndarray  # (n_quads,) of bool, quads that may meet others: not degenerate, not declared
    blocks: Sequence[Shell]  # nodes on the faces of each block
    coincidence: Coincidence  # points, spacing and round-off of single nodes

    def complete(self, regions: Sequence[Region]) -> tuple[list[Region], list[Region]]:
        """Extend regions over the quads that their maps place onto each other, the largest first."""
        # Returns completed: the regions; doubtful: holes in them whose corners are up to a quarter of a cell apart,
        # which are not filled.
        #
        # 1. Completion: a quad is added if its corners meet within round-off of the file.
        # 2. Comparison of surfaces, where round-off is as large as cells: regions are found from faces on their own and
        #    completed in turn; a quad that could belong to several goes to the largest.
        # 3. Holes: a quad whose corners meet within `NEAR_MISS_TOLERANCE` of the local spacing is added if it lies in a
        # hole of the region without open neighbours, and if most corners of the region with its holes meet unchanged.
        completed = self._completed(regions)  # step 1, and step 3 in `_extended`
        if self.coincidence.is_coarse:
            found = self._face_regions(completed)  # step 2
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
        """Extend regions in order, the largest first, each over quads that no earlier one has taken."""
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
        self, region: Region, is_free: np.ndarray, tolerance: float = NEAR_MISS_TOLERANCE, least_fraction: float = 0.5
    ) -> np.ndarray:
        """Pairs of quads, the lower number first, of a region and of the free quads that belong to it."""
        # Holes are filled if their corners are within a tolerance of their partners, relative to the local spacing, and
        # a minimum fraction of the corners of the region meets.
        fraction, distance, partner = self._mapped(region)
        quads = np.arange(partner.size).reshape(partner.shape) + self.quads.starts(len(self.faces))[region.a]
        can_join = is_free[quads] & (partner >= 0) & is_free[partner]
        is_in = (fraction == 1.0) & can_join  # step 1
        is_in[self.quads.p[region.pairs[:, 0]], self.quads.q[region.pairs[:, 0]]] = True
        # step 3: a hole next to open quads is the rest of two faces that part, as behind a cusped trailing edge
        holes = _bounded_holes((distance <= tolerance) & can_join & ~is_in, can_join & ~is_in)
        if holes.any() and fraction[is_in | holes].mean() >= least_fraction:
            is_in |= holes
        pairs = np.stack([quads[is_in], partner[is_in]], axis=1)
        return pairs[pairs[:, 0] < pairs[:, 1]]

    def _mapped(self, region: Region) -> tuple[np.ndarray, ...]:
        """Map face a of a region to face b."""
        # Returns fraction: ndarray, shape `Face.n_quads`, fraction of the corners of each quad that coincide with their
        # partners, or are within round-off of them; distance: ndarray, shape `Face.n_quads`, largest distance of the
        # other corners, relative to the local spacing; partner: ndarray of int, shape `Face.n_quads`, quads of face b
        # to which they are mapped; -1 outside it.
        a, b = self.faces[region.a], self.faces[region.b]
        overlap = overlap_of(region, a, b)
        interface = region.interface(self.faces, overlap)
        here, there = (self._at(side) for side in (interface.a, interface.b))
        gap = here[0] - interface.orientation.apply(there[0])
        spacing = np.minimum(here[1], interface.orientation.apply(there[1]))
        rounding = self.coincidence.rounding(here[0])
        is_met = (np.abs(gap).max(axis=-1) <= rounding) | (here[2] == interface.orientation.apply(there[2]))
        distance = np.where(is_met, 0.0, np.linalg.norm(gap, axis=-1) / spacing)
        inside = tuple(slice(lo, hi + 1) for lo, hi in zip(overlap.lo, overlap.hi))
        fraction, largest = np.zeros(a.n_quads), np.full(a.n_quads, np.inf)
        fraction[inside] = quad_corners(is_met.squeeze(a.normal)).mean(axis=-1)
        largest[inside] = quad_corners(distance.squeeze(a.normal)).max(axis=-1)
        partner = np.full(a.n_quads, -1)
        r, s = region.map_quads(*np.mgrid[inside])
        partner[inside] = self.quads.starts(len(self.faces))[region.b] + r * b.n_quads[1] + s
        return fraction, largest, partner

    def _at(self, window: Window) -> tuple[np.ndarray, ...]:
        """Nodes of a face window, their spacing, and their points."""
        values = self.blocks, self.coincidence.spacing, self.coincidence.ids
        return tuple(blocks[window.block].at(window) for blocks in values)

    def _face_regions(self, regions: Sequence[Region]) -> list[Region]:
        """Find regions of quads that are in no region yet by comparing surfaces."""
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
    """A single face."""

    number: int  # its number
    face: Face  # the face
    nodes: np.ndarray  # (n, 3), its nodes (m)
    # (n,), largest distance of a node from its partner (m): round-off, or less if edges in the face are short
    reach: np.ndarray
    is_free: np.ndarray  # (n_quads,) of bool, quads that may meet others

    @classmethod
    def of(cls, number: int, face: Face, nodes: np.ndarray, is_free: np.ndarray, coincidence: Coincidence) -> _Surface:
        """Take a face with its nodes (ni, nj, nk, 3), and compute the largest distance of each from its partner."""
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
        """Find regions of this surface, as face 0, and another one, as face 1; only of face 0 if it is the same."""
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

    def _met_nodes(self, other: _Surface) -> tuple[np.ndarray, ...]:
        """Nodes of this surface that meet a node of another surface, and those; different nodes on the same surface."""
        reach = self.reach.max(initial=0.0)
        low, high = other.nodes.min(axis=0) - reach, other.nodes.max(axis=0) + reach
        here = np.flatnonzero(((self.nodes >= low) & (self.nodes <= high)).all(axis=1))
        if len(here) < 4:
            return here, here
        distance, there = cKDTree(other.nodes).query(self.nodes[here], k=[2 if self is other else 1], p=np.inf)
        distance, there = distance[:, 0], there[:, 0]
        is_met = distance <= np.minimum(self.reach[here], other.reach[there])
        return here[is_met], there[is_met]


def _key(region: Region) -> tuple:
    """Return the unique sort key of a region."""
    return region.a, region.b, region.turn, region.shift


def _merged(regions: Sequence[Region]) -> list[Region]:
    """Merge regions with the same faces, turn and shift."""
    groups: dict[tuple, list[Region]] = {}
    for region in regions:
        groups.setdefault(_key(region), []).append(region)
    return [
        replace(group[0], pairs=np.unique(np.concatenate([region.pairs for region in group]), axis=0))
        for group in groups.values()
    ]


def _bounded_holes(is_hole: np.ndarray, is_open: np.ndarray) -> np.ndarray:
    """Pick the holes, made of quads that share edges, whose open neighbours are all quads of holes."""
    holes, n_holes = label(is_hole)
    padded = np.pad(is_open & ~is_hole, 1)
    neighbours = padded[2:, 1:-1] | padded[:-2, 1:-1] | padded[1:-1, 2:] | padded[1:-1, :-2]
    is_bounded = np.ones(n_holes + 1, dtype=bool)
    is_bounded[holes[neighbours]] = False
    is_bounded[0] = False
    return is_bounded[holes]


def overlap_of(region: Region, a: Face, b: Face) -> Rectangle:
    """Find the quads of face a that the map of a region takes into face b."""
    far = region.reverse().map_rectangle(Rectangle((0, 0), tuple(n - 1 for n in b.n_quads)))
    lo = tuple(max(index, 0) for index in far.lo)
    return Rectangle(lo, tuple(min(index, n - 1) for index, n in zip(far.hi, a.n_quads)))
