"""Interfaces from the quads of block faces that lie on the same points.

Two quads on the same four points match in one of eight ways (*turns*): the tangent directions run along each other or
cross over, and each may run backwards. Quads that match by the same turn and the same shift of indices form a region
of two faces; the rectangles of a region are interfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .entities import Interface
from .faces import Face
from .index_space import Orientation
from .rectangles import Rectangle, decompose

MAX_RECTANGLES = 64
"""A region more ragged than this many rectangles keeps the largest ones."""

_TURNS = [(swap, flip0, flip1) for swap in (0, 1) for flip0 in (0, 1) for flip1 in (0, 1)]
_TURNED_CORNERS = np.array(
    [
        [(q ^ f1) + 2 * (p ^ f0) if swap else (p ^ f0) + 2 * (q ^ f1) for q in (0, 1) for p in (0, 1)]
        for swap, f0, f1 in _TURNS
    ]
)
"""Corner of the second quad that meets corner p + 2 q of the first, for each turn."""


@dataclass(frozen=True)
class Quads:
    """The quads of all faces, in order of the faces, each face in C order.

    Parameters
    ----------
    corners : ndarray of int, shape (n, 4)
        Points at the corners.
    face, p, q : ndarray of int, shape (n,)
        Face number and indices of the quad.
    is_degenerate : ndarray of bool, shape (n,)
        True for quads without area, and for line faces without length.
    """

    corners: np.ndarray
    face: np.ndarray
    p: np.ndarray
    q: np.ndarray
    is_degenerate: np.ndarray

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
    """Quads that lie on the same points.

    Parameters
    ----------
    pairs : ndarray of int, shape (n, 2)
        Pairs of quads that are one, the lower number first.
    kept_apart : ndarray of int, shape (m, 2)
        Pairs of quads that coincide but of which at least one is declared.
    crowded : ndarray of int, shape (l,)
        Undeclared quads that coincide with two or more others.
    """

    pairs: np.ndarray
    kept_apart: np.ndarray
    crowded: np.ndarray


def match_quads(quads: Quads, is_declared: np.ndarray) -> Matches:
    """Find the quads that lie on the same points; declared ones, and those they coincide with, are kept apart."""
    live = np.flatnonzero(~quads.is_degenerate)
    keys = np.sort(quads.corners[live], axis=1)
    order = np.lexsort(keys.T)
    is_new = np.ones(len(live), dtype=bool)
    is_new[1:] = np.any(keys[order[1:]] != keys[order[:-1]], axis=1)
    group = np.cumsum(is_new) - 1
    size = np.bincount(group)[group]
    is_apart = (np.bincount(group, weights=is_declared[live[order]]) > 0)[group]
    is_second = ~is_new & ~is_apart & (size == 2)
    follows = np.flatnonzero(~is_new & is_apart)
    leads = np.flatnonzero(is_new)[group[follows]]
    second = np.flatnonzero(is_second)
    member = live[order]
    return Matches(
        np.stack([member[second - 1], member[second]], axis=1),
        np.stack([member[leads], member[follows]], axis=1),
        member[~is_apart & (size > 2)],
    )


@dataclass(frozen=True)
class Region:
    """Quads of face a that match quads of face b by one turn and one shift of indices.

    Quad ``(p, q)`` of a meets the quad of b whose indices along p and q are ``shift[0] -+ p`` and ``shift[1] -+ q``.
    """

    a: int
    b: int
    turn: int
    shift: tuple[int, int]
    pairs: np.ndarray

    def carry_quads(self, p, q):
        """Carry indices: those in face b of the quads that meet quads (p, q) of face a."""
        swap, flip0, flip1 = _TURNS[self.turn]
        ends = (self.shift[0] + (-p if flip0 else p), self.shift[1] + (-q if flip1 else q))
        return ends[::-1] if swap else ends

    def carry(self, rectangle: Rectangle) -> Rectangle:
        """Carry a rectangle of face a to the one of face b that it meets."""
        ends = self.carry_quads(*rectangle.lo), self.carry_quads(*rectangle.hi)
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
        return Interface(a.part(rectangle), b.part(self.carry(rectangle)), _orientation(a, b, self.turn))


def find_regions(quads: Quads, pairs: np.ndarray) -> list[Region]:
    """Group pairs of quads by their faces, turn and shift, in that order.

    Where more than one turn fits (across the flat direction of a line) the first, which does not flip, is taken.
    """
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
    a, b, turn, *shift = (int(value) for value in kind)
    return Region(a, b, turn, tuple(shift), pairs)


def _shifts(quads: Quads, a: np.ndarray, b: np.ndarray, turn: np.ndarray):
    """Shift of the indices of quads b along the p and q of quads a."""
    swap, flip0, flip1 = np.array(_TURNS)[turn].T
    along_p = np.where(swap, quads.q[b], quads.p[b])
    along_q = np.where(swap, quads.p[b], quads.q[b])
    return along_p + np.where(flip0, 1, -1) * quads.p[a], along_q + np.where(flip1, 1, -1) * quads.q[a]


def _orientation(a: Face, b: Face, turn: int) -> Orientation:
    """Return the orientation of blocks that a turn of their faces makes."""
    swap, *flips = _TURNS[turn]
    perm, flip = [0, 0, 0], [False] * 3
    perm[a.normal], flip[a.normal] = b.normal, a.is_high == b.is_high
    for axis, d in enumerate(a.tangents):
        perm[d], flip[d] = b.tangents[axis ^ swap], bool(flips[axis])
    return Orientation(tuple(perm), tuple(flip))
