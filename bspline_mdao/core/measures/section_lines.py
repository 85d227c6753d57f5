"""Grid lines of a wing around its leading edge to the trailing edge, and the resulting plane sections.

Theory: ``docs/theory/geometry.rst``, "Leading and trailing edges".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np
from scipy.sparse import csr_array

from ...base.checks import as_numbers
from ...errors import InputError
from ..mesh.frame import Frame, surface_frame
from ..mesh.surface import SurfaceGrid

__all__ = ["GridLines", "SectionLines", "arc_parameters", "polynomial_weights", "stencil_matrix"]

_LEVEL = 1e-9
"""Fraction of the surface's size below which two nodes are at the same position along the stream or the span: round-off
of nodes meant to be so."""

_ALONG, _ACROSS = 0.9, 0.25
"""A line with one step along the stream by more than the first fraction of its length ends at a step by less than the
second: at the corner of a blunt trailing edge."""

_CUBIC = 4
"""Number of neighbouring lines from which a plane section is interpolated."""


@dataclass(frozen=True, eq=False)
class SectionLines:
    """Grid lines that cross the leading edge, from there along both sides to the trailing edge."""

    # Grid lines are not plane in general. The point of a plane section between lines is a fixed cubic combination of
    # the nodes at the same position in the order of neighbouring lines, such that it is in the plane on the baseline.

    frame: Frame  # directions along the stream, normal and along the span
    points: np.ndarray  # (n, 3), nodes of the surface on the baseline (m)
    # nodes of the upper and lower lines by span; the first is the leading edge, -1 follows the last
    sides: tuple[np.ndarray, np.ndarray]  # int each (n_lines, longest)

    @classmethod
    def of(
        cls,
        surface: SurfaceGrid,
        patches: str | Sequence[str] | None = None,  # patches of the wing by name; all by default
        # directions; found from the box of the wing by default, whose longest side is then the span
        frame: Frame | None = None,
    ) -> SectionLines:
        """Find the leading edge of a surface on the baseline, and the lines that cross it."""
        # A node is on the leading edge if a grid line arrives from downstream and returns there on the other side, and
        # ends further along the stream than along the span.
        wing = surface if patches is None else _only(surface, patches)
        ids = np.unique(wing.quads)
        frame = frame or surface_frame(surface.points[ids], surface.planes)
        local = frame.to_local(surface.points)
        level = _LEVEL * np.ptp(local[ids], axis=0).max()
        sides = _sides(GridLines.of(wing.quads, surface.n_points), local, level)
        span = local[sides[0][:, 0], 2]
        if len(span) == 0:
            cure = "; without lines there are Thickness and SectionThickness" if surface.cells else ""
            raise InputError(
                f"leading edge: no grid line of the surface turns round it; name the patches of the wing{cure}"
            )
        if np.diff(span).min(initial=np.inf) <= level:
            raise InputError("leading edge: there are two at the same place of the span; name the patches of one wing")
        return cls(frame, surface.points, sides)

    @property
    def plane(self) -> np.ndarray:
        """Directions along the stream and normal to it, shape (2, 3)."""
        return self.frame.axes[:2]

    @cached_property
    def span(self) -> np.ndarray:
        """Position of every baseline node along the span (m), shape (n,)."""
        return self.frame.to_local(self.points)[:, 2]

    @cached_property
    def fractions(self) -> np.ndarray:
        """Position of every node of the lines along its baseline chord, 0 to 1; shape (n,), 0 for other nodes."""
        stream = self.frame.to_local(self.points)[:, 0]
        edge = stream[self.sides[0][:, :1]]
        tail = np.mean([stream[self.trailing(side, 1)] for side in range(2)], axis=0)
        fractions = np.zeros(len(self.points))
        for nodes in self.sides:
            fractions[nodes[nodes >= 0]] = ((stream[nodes] - edge) / (tail - edge))[nodes >= 0]
        return fractions

    def leading(self, n: int) -> np.ndarray:
        """Nodes around the leading edge, shape (n_lines, 2 n + 1): n on the lower side, the edge, n on the upper."""
        # `InputError` if a line has fewer
        self._require(n + 1)
        upper, lower = self.sides
        return np.concatenate([lower[:, n:0:-1], upper[:, : n + 1]], axis=1)

    def trailing(self, side: int, n: int) -> np.ndarray:
        """Last n nodes of the lines of a side (0 upper, 1 lower) from the trailing edge forward, shape (n_lines, n)."""
        # `InputError` if a line has fewer
        self._require(n)
        last = (self.sides[side] >= 0).sum(axis=1) - 1
        return np.take_along_axis(self.sides[side], last[:, None] - np.arange(n), axis=1)

    def stations(
        self,
        nodes: np.ndarray,  # int (n_lines, k), nodes of all lines needed by the sections
        # fractions of the way from the first to the last line at the leading edge; by default one section for every
        # line that is not beyond the ends of its neighbours
        fractions: Sequence[float] | None,
    ) -> np.ndarray:  # (n_stations,), positions along the span (m)
        """Choose the planes of sections."""
        edge, z = self.span[self.sides[0][:, 0]], self.span[nodes]
        low, high = z[0].max() - 1e-9 * np.ptp(edge), z[-1].min() + 1e-9 * np.ptp(edge)
        if fractions is None:
            return edge[(edge >= low) & (edge <= high)]
        places = np.atleast_1d(as_numbers(fractions, "sections: stations"))
        wanted = edge[0] + places * np.ptp(edge)
        for fraction, position in zip(places, wanted):
            if not low <= position <= high:
                raise InputError(
                    f"sections: no grid lines around station {fraction}; take fractions of the span from "
                    f"{max((low - edge[0]) / np.ptp(edge), 0.0):.4f} to {min((high - edge[0]) / np.ptp(edge), 1.0):.4f}"
                )
        return wanted

    def cut(
        self,
        nodes: np.ndarray,  # int (n_lines, k), nodes of all lines at k positions of their order
        stations: np.ndarray,  # (n_stations,), positions of the sections along the span (m)
    ) -> csr_array:
        """Matrix of shape (n_stations k, n) that gives k points of every section from the nodes of the surface."""
        n_lines, k = nodes.shape
        width = min(_CUBIC, n_lines)
        # the line before the plane, position by position; the middle of the lines used, as far as they exist
        before = (self.span[nodes][:, None] < stations[:, None]).sum(axis=0) - 1
        first = np.clip(before - (width // 2 - 1), 0, n_lines - width)
        taken = nodes[first[..., None] + np.arange(width), np.arange(k)[:, None]].reshape(-1, width)
        offsets = self.span[taken] - np.repeat(stations, k)[:, None]
        weights = polynomial_weights(offsets, degree=width - 1, derivative=0)
        rows = np.repeat(np.arange(len(taken)), width)
        return csr_array((weights.ravel(), (rows, taken.ravel())), shape=(len(taken), len(self.points)))

    def _require(self, n: int) -> None:
        """Refuse lines of fewer than n nodes."""
        for side, name in zip(self.sides, ("upper", "lower")):
            counts = (side >= 0).sum(axis=1)
            if counts.min() < n:
                line = int(np.argmin(counts))
                raise InputError(
                    f"sections: {name} grid line {line + 1} along the span has {counts[line]} nodes from the leading "
                    f"to the trailing edge; {n} are needed"
                )


def _only(surface: SurfaceGrid, patches: str | Sequence[str]) -> SurfaceGrid:
    """The surface with the faces of some patches."""
    return surface.only(surface.part(patches))


def _sides(lines: GridLines, local: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Upper and lower lines from the leading edge, in the order of the span."""
    below, at, above = lines.behind, lines.at, lines.ahead
    stream, normal = local[:, 0], local[:, 1]
    is_front = np.minimum(stream[below], stream[above]) > stream[at] + level
    found = np.flatnonzero(is_front & (normal[above] > normal[below]))
    found = found[np.argsort(local[at[found], 2], kind="stable")]
    sides = [_to_trailing_edge(lines.walk(at[found], second[found]), local) for second in (above, below)]
    is_section = np.all([_runs_along_stream(side, local) for side in sides], axis=0)
    upper, lower = (side[is_section] for side in sides)
    return upper, lower


def _to_trailing_edge(lines: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Lines, shape (n, longest), cut where they no longer run along the stream."""
    steps = np.diff(local[lines], axis=1)
    along = steps[..., 0] / np.maximum(np.linalg.norm(steps, axis=2), np.finfo(float).tiny)
    has_gone_along = np.maximum.accumulate(along > _ALONG, axis=1)
    has_ended = (lines[:, 1:] < 0) | (along <= 0.0) | (has_gone_along & (along < _ACROSS))
    kept = lines.copy()
    kept[:, 1:][np.maximum.accumulate(has_ended, axis=1)] = -1
    return kept


def _runs_along_stream(lines: np.ndarray, local: np.ndarray) -> np.ndarray:
    """Whether lines end further along the stream than along the span from where they start."""
    last = np.take_along_axis(lines, (lines >= 0).sum(axis=1, keepdims=True) - 1, axis=1)[:, 0]
    way = local[last] - local[lines[:, 0]]
    return way[:, 0] > np.abs(way[:, 2])


@dataclass(frozen=True, eq=False)
class GridLines:
    """Grid lines of a surface of quads: which edge continues which straight through a node, across faces."""

    # Two edges at a node continue each other if no quad lies between them and neither has another such partner: the
    # opposite edges of the four at an ordinary node, and the edges along the boundary of the surface.

    # three successive nodes of a line; every triple occurs in both directions, in ascending order of the first two
    behind: np.ndarray  # int (n,)
    at: np.ndarray  # int (n,)
    ahead: np.ndarray  # int (n,)
    n_nodes: int  # number of nodes

    @classmethod
    def of(cls, quads: np.ndarray, n_nodes: int) -> GridLines:
        """Find the lines of quads, shape (n_quads, 4), numbered around; corners may coincide."""
        edges = _directed_edges(quads)
        turns = _turns(quads)
        pairs = _pairs_of_edges(edges, n_nodes)
        key = (edges[pairs[:, 0]] @ [n_nodes, 1]) * np.int64(n_nodes) + edges[pairs[:, 1], 1]
        between = (turns[:, :2] @ [n_nodes, 1]) * np.int64(n_nodes) + turns[:, 2]
        pairs = pairs[~np.isin(key, between)]
        partners = [np.bincount(numbers, minlength=len(edges)) for numbers in pairs.T]
        pairs = pairs[(partners[0][pairs[:, 0]] == 1) & (partners[1][pairs[:, 1]] == 1)]
        behind, at = edges[pairs[:, 0]].T
        return cls(behind, at, edges[pairs[:, 1], 1], n_nodes)

    def next(self, behind: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Node after two successive ones, each of shape (m,); -1 if the line ends."""
        keys, wanted = self.behind * self.n_nodes + self.at, behind * self.n_nodes + at
        place = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        return np.where((keys[place] == wanted) & (at >= 0), self.ahead[place], -1)

    def walk(self, start: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Follow lines from their first two nodes, each of shape (m,), to their ends; shape (m, longest), -1 behind."""
        # A closed line ends where it returns to its start.
        columns = [start, second]
        while (columns[-1] >= 0).any():
            following = self.next(columns[-2], columns[-1])
            columns.append(np.where(following == start, -1, following))
        return np.stack(columns[:-1], axis=1)


def _directed_edges(quads: np.ndarray) -> np.ndarray:
    """All edges in both directions, shape (n, 2), in ascending order, without zero-length ones."""
    ends = np.concatenate([quads[:, [corner, (corner + 1) % 4]] for corner in range(4)])
    ends = ends[ends[:, 0] != ends[:, 1]]
    return np.unique(np.concatenate([ends, ends[:, ::-1]]), axis=0)


def _turns(quads: np.ndarray) -> np.ndarray:
    """Successive corners of the quads in both directions, shape (n, 3)."""
    corners = [quads[:, [corner - 1, corner, (corner + 1) % 4]] for corner in range(4)]
    for corner in range(4):  # a side of zero length is skipped
        collapsed = quads[quads[:, corner] == quads[:, (corner + 1) % 4]]
        corners.append(collapsed[:, [corner - 1, corner, (corner + 2) % 4]])
    turns = np.concatenate(corners)
    return np.concatenate([turns, turns[:, ::-1]])


def _pairs_of_edges(edges: np.ndarray, n_nodes: int) -> np.ndarray:
    """Edge into a node and edge out of it to another one: numbers, shape (n, 2), ascending in the first."""
    first = np.searchsorted(edges[:, 0], np.arange(n_nodes + 1))
    degree = np.diff(first)[edges[:, 1]]
    into = np.repeat(np.arange(len(edges)), degree)
    out = first[edges[into, 1]] + np.arange(len(into)) - np.repeat(np.cumsum(degree) - degree, degree)
    keep = edges[into, 0] != edges[out, 1]
    return np.stack([into[keep], out[keep]], axis=1)


def arc_parameters(points: np.ndarray) -> np.ndarray:
    """Lengths along polylines from their first point, shape (n, k), from points, shape (n, k, d)."""
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2)
    return np.concatenate([np.zeros((len(points), 1)), np.cumsum(lengths, axis=1)], axis=1)


def polynomial_weights(
    parameters: np.ndarray,  # (n, k), distinct in each of n rows; the derivative is taken at 0
    degree: int,  # degree of the polynomials, less than k; with k - 1 they interpolate
    derivative: int,  # order of the derivative; 0 is the value
    is_used: np.ndarray | None = None,  # bool (n, k), values used; more than ``degree`` in every row
) -> np.ndarray:  # (n, k)
    """Return the weights of the values at k parameters in a derivative of the least-squares polynomial at parameter 0.

    Examples
    --------
    >>> polynomial_weights(np.array([[-1.0, 0.0, 1.0]]), degree=2, derivative=2).round(12)
    array([[ 1., -2.,  1.]])
    """
    # least squares by the pseudo-inverse of the powers; parameters up to one keep these well conditioned
    scale = np.abs(parameters).max(axis=1, keepdims=True)
    powers = (parameters / scale)[..., None] ** np.arange(degree + 1)
    if is_used is not None:
        powers *= is_used[..., None]
    return factorial(derivative) * np.linalg.pinv(powers)[:, derivative] / scale**derivative


def stencil_matrix(weights: np.ndarray) -> csr_array:
    """Matrix of shape (n, n k) that combines k successive values in every row, from weights of shape (n, k)."""
    n, k = weights.shape
    return csr_array((weights.ravel(), np.arange(n * k), k * np.arange(n + 1)), shape=(n, n * k))
