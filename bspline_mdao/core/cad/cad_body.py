"""Faces of a CAD file as one body: nodes are tied to them by (u, v), and control points move them.

A node x whose nearest point on the body is S(u, v) on one face moves with it at constant (u, v):

    x + S_new(u, v) - S_old(u, v) = x + B (P_new - P_old) ,

with the rational functions B there and the control points P: linear, and exactly x if nothing moves. Coincident control
points on boundaries of faces are one, so faces whose edges have the same splines stay joined. At other edges, such as
trimming edges, all control points that affect them are fixed, so the body stays closed however the rest moves. Theory:
``docs/theory/cad.rst``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array, vstack
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from ...base.checks import as_finite_points
from ...base.display import OneLine
from ...base.matching import matching_names
from ...base.text import counted
from ...errors import InputError
from .trimmed_face import TrimmedFace

__all__ = ["CadBody", "CadTie"]

JOINED = 1e-7
"""Distance, relative to the size of a body, at which control points and edges of two faces coincide."""

SAME_WEIGHT = 1e-9
"""Difference between weights of control points, from 0 to 1, that is rounding error."""

IDLE = 1e-12
"""Weight of a control point that counts as zero."""

GAP = 1e-3
"""Edges of two faces that separate by more than this fraction of their motion in a second file did not have the same
topology; refits, each to a tolerance, leave far less."""


CUT = (
    "one is cut there, and the cut has moved on it. Nodes keep their (u, v): cuts that stay where they are on both "
    "faces are supported, as where these move together; write faces untrimmed, or leave patches at this edge out of "
    "the design"
)
"""Why faces separate where an edge trims one of them, and what to do."""

OTHERWISE = "their parameters run otherwise; write both files in the same way, with the same options"
"""Why faces separate elsewhere."""


@dataclass(frozen=True, eq=False)
class CadTie(OneLine):
    """Where points are tied to the faces of a body. Made by `CadBody.tie`."""

    faces: np.ndarray  # int (n,), number of the face
    uv: np.ndarray  # (n, 2), parameters there, from 0 to 1
    distances: np.ndarray  # (n,), from the point to its position on the face (m)
    on_edge: np.ndarray  # bool (n,), whether that is on an edge that trims the face

    def only(self, rows: np.ndarray) -> CadTie:
        """Return the ties of some points."""
        return CadTie(self.faces[rows], self.uv[rows], self.distances[rows], self.on_edge[rows])


@dataclass(frozen=True, eq=False)
class CadBody(OneLine):
    """The faces of a CAD file as movable B-spline surfaces. Made by `CadShape.body`.

    Parameters
    ----------
    source : str
        The file.
    faces : tuple of TrimmedFace
        Its faces, in the order of the file: names, knots, weights and control points (m), and edges in (u, v).
    scale : float
        Length here per metre in the file.
    units : str
        Unit of length of the file: ``"m"``, ``"mm"``, ``"in"`` or ``"ft"``; metres for any other unit.
    origin : TopoDS_Shape, optional
        OpenCascade's own object, of B-splines, in millimetres, as the file has it.

    Examples
    --------
    >>> from bspline_mdao.files import read_cad
    >>> body = read_cad("wing.step").body  # doctest: +SKIP
    >>> tie = body.tie(nodes)  # the faces and (u, v) of nodes, shape (n, 3), and how far they are  # doctest: +SKIP
    >>> thicker = body.at(body.control_points * [1.0, 1.1, 1.0])  # doctest: +SKIP
    >>> moved = nodes + body.displacement(thicker, tie)  # doctest: +SKIP
    """

    source: str
    faces: tuple[TrimmedFace, ...]
    scale: float = 1.0
    units: str = "m"
    origin: Any = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the faces."""
        return tuple(face.name for face in self.faces)

    @cached_property
    def _net(self) -> np.ndarray:
        """Concatenated control points of all faces, shape (n_all, 3)."""
        return np.concatenate([face.surface.control_points.reshape(-1, 3) for face in self.faces])

    @cached_property
    def _starts(self) -> np.ndarray:
        """Row of the first control point of every face, and the total number."""
        return np.concatenate([[0], np.cumsum([face.surface.n_control for face in self.faces])])

    @cached_property
    def size(self) -> float:
        """Diagonal of the box around points of the faces (m)."""
        return float(np.linalg.norm(np.ptp(np.concatenate([face.points for face in self.faces]), axis=0)))

    @cached_property
    def _joined(self) -> float:
        """Distance (m) at which edges coincide."""
        return max(JOINED * self.size, *(face.tolerance for face in self.faces))

    @cached_property
    def ids(self) -> np.ndarray:
        """Number of each control point of all faces, shared by coincident ones on boundaries; int (n_all,)."""
        on_boundary = []
        for face, start in zip(self.faces, self._starts):
            mask = np.ones(face.surface.weights.shape, dtype=bool)
            mask[1:-1, 1:-1] = False
            on_boundary.append(start + np.flatnonzero(mask))
        rows = np.concatenate(on_boundary)
        pairs = rows[cKDTree(self._net[rows]).query_pairs(JOINED * self.size, output_type="ndarray")]
        n = len(self._net)
        links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
        found = connected_components(links, directed=False)[1]
        first = np.unique(found, return_index=True)[1]  # numbered in order of first occurrence
        order = np.empty(len(first), dtype=int)
        order[np.argsort(first)] = np.arange(len(first))
        return order[found]

    @cached_property
    def _firsts(self) -> np.ndarray:
        """Row of the first control point with each number."""
        return np.unique(self.ids, return_index=True)[1]

    @property
    def control_points(self) -> np.ndarray:
        """The control points (m), each once, shape (n, 3)."""
        return self._net[self._firsts]

    def within(
        self,
        faces: str | Sequence[str] | None = None,
        low: Sequence[float | None] = (None, None, None),
        high: Sequence[float | None] = (None, None, None),
    ) -> np.ndarray:
        """Choose control points by their faces, and by a box.

        Parameters
        ----------
        faces : str or sequence of str, optional
            Names or patterns of faces (``"wing*"``); all by default. Points shared with others are chosen, too.
        low, high : sequence of three floats, optional
            Corners of the box (m), None for no limit.

        Returns
        -------
        ndarray of bool, shape (n,)
            Whether each of ``control_points`` is chosen.

        Raises
        ------
        InputError
            If no face has such a name.
        """
        chosen = np.zeros(len(self._firsts), dtype=bool)
        named = matching_names(self.names, "*" if faces is None else faces, self.source, ("face", "faces"))
        for face, start, end in zip(self.faces, self._starts, self._starts[1:]):
            chosen[self.ids[start:end]] |= face.name in named
        for axis, (above, below) in enumerate(zip(low, high)):
            values = self.control_points[:, axis]
            chosen &= (above is None or values >= above) & (below is None or values <= below)
        return chosen

    def at(self, control_points: np.ndarray) -> CadBody:
        """Move the control points.

        Parameters
        ----------
        control_points : ndarray, shape (n, 3)
            New positions (m), in the order of ``control_points``.

        Returns
        -------
        CadBody
            The same faces, moved.

        Raises
        ------
        InputError
            If there are too many or too few, or they are not finite.
        """
        before = self.control_points
        change = as_finite_points(control_points, len(before), f"{self.source}: control points") - before
        moved = self._net + change[self.ids]
        parts = np.split(moved, self._starts[1:-1])
        surfaces = [face.surface.at(part) for face, part in zip(self.faces, parts)]
        body = replace(self, faces=tuple(replace(face, surface=s) for face, s in zip(self.faces, surfaces)))
        body.__dict__["ids"] = self.ids  # merged points stay merged
        return body

    def scaled(self, factor: float) -> CadBody:
        """Return the body in another unit; ``factor`` is its number per metre."""
        faces = [
            replace(
                face, surface=face.surface.at(factor * face.surface.control_points), tolerance=factor * face.tolerance
            )
            for face in self.faces
        ]
        return replace(self, faces=tuple(faces), scale=factor * self.scale)

    def tie(self, points: np.ndarray, names: Sequence[frozenset[str]] | None = None) -> CadTie:
        """Find the points on the faces nearest to points.

        Parameters
        ----------
        points : ndarray, shape (n, 3)
            The points (m).
        names : sequence of frozenset of str, optional
            Names of the faces to which each may be tied, shape (n,); all by default.

        Returns
        -------
        CadTie
        """
        points = np.asarray(points, dtype=float)
        allowed = np.ones((len(self.faces), len(points)), dtype=bool)
        if names is not None:
            kinds = {kind: number for number, kind in enumerate(dict.fromkeys(names))}
            of_kinds = np.array([[face.name in kind for kind in kinds] for face in self.faces])
            allowed = of_kinds[:, [kinds[kind] for kind in names]]
        bounds = [face.bounds(points) for face in self.faces]
        above = np.min([np.where(may, high, np.inf) for may, (_, high) in zip(allowed, bounds)], axis=0)
        tie = CadTie(
            np.zeros(len(points), dtype=int),
            np.zeros((len(points), 2)),
            np.full(len(points), np.inf),
            np.zeros(len(points), dtype=bool),
        )
        for number, (face, may, (low, _)) in enumerate(zip(self.faces, allowed, bounds)):
            rows = np.flatnonzero(may & (low <= above))
            if not len(rows):
                continue
            found = face.nearest(points[rows])
            nearer = found.distances < tie.distances[rows] - self._joined * 1e-3  # of equals, the first
            at = rows[nearer]
            tie.faces[at] = number
            tie.uv[at], tie.distances[at] = found.uv[nearer], found.distances[nearer]
            tie.on_edge[at] = found.on_edge[nearer]
        return tie

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distances of points, shape (n, 3), from the faces (m), shape (n,)."""
        return self.tie(points).distances

    def places(self, tie: CadTie) -> np.ndarray:
        """Positions (m) on the faces where points are tied, shape (n, 3)."""
        found = np.empty((len(tie.faces), 3))
        for number, rows in self._by_face(tie):
            found[rows] = self.faces[number].surface.points(tie.uv[rows])
        return found

    def matrix(self, tie: CadTie) -> csr_array:
        """Weights of control points at ties: shape (n, n_control_points), rows sum to one."""
        n, parts, order = len(self._firsts), [], []
        for number, rows in self._by_face(tie):
            found = self.faces[number].surface.matrix(tie.uv[rows]).tocoo()
            ids = self.ids[self._starts[number] : self._starts[number + 1]]
            parts.append(coo_array((found.data, (found.row, ids[found.col])), shape=(len(rows), n)).tocsr())
            order.append(rows)
        if not parts:
            return csr_array((0, n))
        return csr_array(vstack(parts, format="csr")[np.argsort(np.concatenate(order))])

    def _by_face(self, tie: CadTie) -> list[tuple[int, np.ndarray]]:
        """Numbers of faces, and the points tied to each."""
        return [(int(number), np.flatnonzero(tie.faces == number)) for number in np.unique(tie.faces)]

    def displacement(self, moved: CadBody, tie: CadTie) -> np.ndarray:
        """Displacements (m) of ties from this body to a moved one, shape (n, 3).

        Parameters
        ----------
        moved : CadBody
            The same faces with other control points, or other knots and degrees: made by `at` or `matched`.
        tie : CadTie
            Ties to this body.
        """
        return moved.places(tie) - self.places(tie)

    def displacement_rates(self, moved: CadBody, tie: CadTie, points: np.ndarray, changes: np.ndarray) -> np.ndarray:
        """Differentiate `displacement` along changes of the tied points, both (n, 3), with varying (u, v)."""
        found = np.empty((len(tie.faces), 3))
        for number, rows in self._by_face(tie):
            face, uv = self.faces[number], tie.uv[rows]
            by_points = face.rates(uv, points[rows], tie.on_edge[rows])
            steps = np.einsum("nic,nc->ni", by_points, changes[rows])
            tangents = moved.faces[number].surface.jets(uv).tangents - face.surface.jets(uv).tangents
            found[rows] = np.einsum("nic,ni->nc", tangents, steps)
        return found

    def control_points_of(self, other: CadBody) -> np.ndarray:
        """Control points (m) of matched faces with the same knots and degrees, in this body's order."""
        for ours, theirs in zip(self.faces, other.faces):
            one, two = ours.surface, theirs.surface
            alike = [len(a) == len(b) and np.allclose(a, b, atol=SAME_WEIGHT) for a, b in zip(one.knots, two.knots)]
            if one.degrees != two.degrees or not all(alike) or not np.allclose(one.weights, two.weights):
                raise InputError(
                    f"{other.source}: its face '{theirs.name}' has other knots than in {self.source}, so no file has "
                    f"shapes between them; write its own, or the walls of the moved model"
                )
        return other._net[self._firsts]

    @cached_property
    def joints(self) -> tuple[CadTie, CadTie]:
        """Points on edges shared by two faces, as ties to one face and to the other."""
        first, second = [], []
        for number, face in enumerate(self.faces):
            uv = face.edge_points
            points = face.surface.points(uv)
            here = CadTie(np.full(len(uv), number), uv, np.zeros(len(uv)), np.zeros(len(uv), dtype=bool))
            for other, neighbour in enumerate(self.faces):
                if other == number:
                    continue
                near = np.flatnonzero(neighbour.bounds(points)[0] <= self._joined)
                if not len(near):
                    continue
                found = neighbour.nearest(points[near])
                rows = near[found.distances <= self._joined]
                kept = found.distances <= self._joined
                first.append(here.only(rows))
                second.append(
                    CadTie(np.full(len(rows), other), found.uv[kept], found.distances[kept], found.on_edge[kept])
                )
        return _together(first), _together(second)

    @cached_property
    def is_fixed(self) -> np.ndarray:
        """Whether each control point is fixed, so that no edge opens; bool (n,)."""
        first, second = self.joints
        fixed = np.zeros(len(self._firsts), dtype=bool)
        if len(first.faces):
            ways = self.matrix(first), self.matrix(second)
            is_open = abs(ways[0] - ways[1]).max(axis=1).toarray().ravel() > SAME_WEIGHT
            for way in ways:
                reached = way[np.flatnonzero(is_open)]
                fixed[reached.indices[reached.data > IDLE]] = True
        return fixed

    def matched(self, other: CadBody) -> CadBody:
        """Return the faces of a second file in this body's order.

        Parameters
        ----------
        other : CadBody
            Faces of the same topology, with the same names or in the same order, with matching parameter directions and
            any knots and degrees.

        Returns
        -------
        CadBody

        Raises
        ------
        InputError
            If it has other faces, or if edges joined here are separate there.
        """
        what = f"{other.source}: is to be {self.source} moved"
        if len(other.faces) != len(self.faces):
            n = counted(len(other.faces), "face")
            raise InputError(f"{what}, and has {n}, not {len(self.faces)}; write both with the same topology")
        ours, theirs = _numbered(self.names), _numbered(other.names)
        if set(ours) == set(theirs):
            by_name = dict(zip(theirs, other.faces))
            found = replace(other, faces=tuple(by_name[key] for key in ours))
        elif not _is_named(self.names) or not _is_named(other.names):
            found = other
        else:
            missing = next(key[0] for key in ours if key not in theirs)
            raise InputError(f"{what}, and has no face '{missing}' in its place; give faces the same names")
        first, second = self.joints
        if len(first.faces):
            moves = [self.displacement(found, tie) for tie in (first, second)]
            gaps, largest = np.linalg.norm(moves[0] - moves[1], axis=1), max(np.abs(move).max() for move in moves)
            worst = int(np.argmax(gaps))
            if gaps[worst] > GAP * largest + 2.0 * (self._joined + found._joined):
                pair = self.faces[first.faces[worst]].name, self.faces[second.faces[worst]].name
                is_cut = any(self.faces[tie.faces[worst]].is_trimmed for tie in (first, second))
                raise InputError(
                    f"{what}, and its faces '{pair[0]}' and '{pair[1]}' come apart by {gaps[worst]:.3g} m along their "
                    f"edge: {CUT if is_cut else OTHERWISE}"
                )
        return found


def _together(ties: Sequence[CadTie]) -> CadTie:
    """Join ties."""
    if not ties:
        return CadTie(np.zeros(0, dtype=int), np.zeros((0, 2)), np.zeros(0), np.zeros(0, dtype=bool))
    return CadTie(*(np.concatenate([getattr(tie, name) for tie in ties]) for name in CadTie.__dataclass_fields__))


def _numbered(names: Sequence[str]) -> list[tuple[str, int]]:
    """Names, and how often each occurred before."""
    counts: Counter[str] = Counter()
    found = []
    for name in names:
        found.append((name, counts[name]))
        counts[name] += 1
    return found


def _is_named(names: Sequence[str]) -> bool:
    """Whether faces have names from their file, not only numbers."""
    return not all(name.startswith(NUMBERED) for name in names)


NUMBERED = "face "
"""Name of faces without one, followed by their number."""
