"""Plane cuts through a wing: where they are, and the leading and trailing edge that they have on the baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..mesh.frame import surface_frame
from ..mesh.surface import SurfaceGrid
from .edge_cuts import cut_edges, edges_of_quads
from .probes import FLAT, Probes

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
    edges = edges_of_quads(surface.quads)
    found = [_ends(surface, edges, cut, f"{what}: section {n} of {len(cuts)}") for n, cut in enumerate(cuts, start=1)]
    nodes, weights = (np.array(values) for values in zip(*found))
    return Probes(nodes[:, 0], weights[:, 0]), Probes(nodes[:, 1], weights[:, 1])


def _ends(surface, edges, cut, what):
    """Nodes and weights, each of shape (2, 4), of the leading and the trailing edge of one section."""
    section = _section(surface, edges, cut, what)
    places = section.at(surface.points)
    along = places @ cut.stream
    last = np.flatnonzero(along >= along.max() - _LAST * np.ptp(along))
    across = places[last] @ np.cross(cut.normal, cut.stream)
    trailing = last[[np.argmin(across), np.argmax(across)]]
    chord = np.linalg.norm(places - places[trailing].mean(axis=0), axis=1)
    leading = np.argmax(chord)
    if chord[leading] <= FLAT * surface.size:
        raise InputError(f"{what}: the plane only touches the surface, so that there is no chord; move it")
    ends = np.array([[leading, leading], trailing])
    return section.nodes[ends].reshape(2, 4), 0.5 * section.weights[ends].reshape(2, 4)


def _section(surface, edges, cut, what):
    """Points where a plane cuts edges, at least one."""
    heights = (surface.points - cut.origin) @ (cut.normal / np.linalg.norm(cut.normal))
    section = cut_edges(edges, heights, FLAT * surface.size)
    if not len(section.nodes):
        x, y, z = cut.origin
        raise InputError(f"{what}: the plane through ({x:g}, {y:g}, {z:g}) does not cut the surface; move it")
    return section
