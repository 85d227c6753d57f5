"""Plane cuts through a wing: where they are, and the leading and trailing edge that they have on the baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..deformations.frame import surface_frame
from ..errors import InputError
from .probes import FLAT, Probes
from .surface import SurfaceGrid

__all__ = ["Cut", "cuts_along_span", "section_edges"]

_LAST = 1e-6
"""Part of the chord by which the corners of a blunt trailing edge may differ along the stream."""


@dataclass(frozen=True, eq=False)
class Cut:
    """A plane, and the direction of the stream in it.

    Parameters
    ----------
    origin : ndarray, shape (3,)
        A point of the plane (m).
    normal : ndarray, shape (3,)
        Normal of the plane, of any length; along the span of the wing there.
    stream : ndarray, shape (3,)
        Direction from the leading to the trailing edge, roughly.

    Raises
    ------
    InputError
        If the stream runs along the normal, or one of them has no length.
    """

    origin: np.ndarray
    normal: np.ndarray
    stream: np.ndarray

    def __post_init__(self):
        if not np.linalg.norm(np.cross(self.normal, self.stream)) > 0.0:
            raise InputError(f"cut: normal {self.normal} and stream {self.stream}; give two different directions")


def cuts_along_span(surface: SurfaceGrid, fractions: Sequence[float]) -> tuple[Cut, ...]:
    """Cut a wing across its span.

    Parameters
    ----------
    surface : SurfaceGrid
        The wing.
    fractions : sequence of float
        Fractions of the span, from 0 to 1, from the plane of symmetry that the wing starts on (`surface_frame`).

    Returns
    -------
    tuple of Cut
    """
    frame = surface_frame(surface.points, surface.planes)
    stream, _, span = frame.axes
    return tuple(Cut(frame.origin + fraction * frame.span * span, span, stream) for fraction in fractions)


def section_edges(surface: SurfaceGrid, cuts: Sequence[Cut], what: str = "sections") -> tuple[Probes, Probes]:
    """Find the leading and the trailing edge of plane sections.

    Parameters
    ----------
    surface : SurfaceGrid
        The wing, on its baseline.
    cuts : sequence of Cut
        The planes.
    what : str
        What the sections are for, for messages.

    Returns
    -------
    leading, trailing : Probes
        One probe of either for every cut. The trailing edge is the furthest point along the stream, or half-way between
        two that are equally far; the leading edge is the point furthest from it. Both are found where the plane cuts
        the edges of quads.

    Raises
    ------
    InputError
        If a plane does not cut the surface, or touches it in one point.
    """
    edges = _edges(surface.quads)
    found = [_ends(surface, edges, cut, f"{what}: section {n} of {len(cuts)}") for n, cut in enumerate(cuts, start=1)]
    nodes, weights = (np.array(values) for values in zip(*found))
    return Probes(nodes[:, 0], weights[:, 0]), Probes(nodes[:, 1], weights[:, 1])


def _edges(quads):
    """All edges, each once, shape (n, 2)."""
    ends = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    return np.unique(ends[ends[:, 0] != ends[:, 1]], axis=0)


def _ends(surface, edges, cut, what):
    """Nodes and weights, each of shape (2, 4), of the leading and the trailing edge of one section."""
    nodes, weights = _cut_edges(surface, edges, cut, what)
    places = np.einsum("nm,nmd->nd", weights, surface.points[nodes])
    along = places @ cut.stream
    last = np.flatnonzero(along >= along.max() - _LAST * np.ptp(along))
    across = places[last] @ np.cross(cut.normal, cut.stream)
    trailing = last[[np.argmin(across), np.argmax(across)]]
    chord = np.linalg.norm(places - places[trailing].mean(axis=0), axis=1)
    leading = np.argmax(chord)
    if chord[leading] <= FLAT * surface.size:
        raise InputError(f"{what}: the plane only touches the surface, so that there is no chord; move it")
    ends = np.array([[leading, leading], trailing])
    return nodes[ends].reshape(2, 4), 0.5 * weights[ends].reshape(2, 4)


def _cut_edges(surface, edges, cut, what):
    """Nodes and weights, each of shape (n, 2), of the points where a plane cuts edges."""
    height = (surface.points - cut.origin) @ (cut.normal / np.linalg.norm(cut.normal))
    height[np.abs(height) < FLAT * surface.size] = 0.0
    first, second = height[edges].T
    is_cut = (first * second <= 0.0) & (first != second)
    if not is_cut.any():
        x, y, z = cut.origin
        raise InputError(f"{what}: the plane through ({x:g}, {y:g}, {z:g}) does not cut the surface; move it")
    share = (first / np.where(is_cut, first - second, 1.0))[is_cut]
    return edges[is_cut], np.stack([1.0 - share, share], axis=1)
