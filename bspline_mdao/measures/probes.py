"""Probes: points of a surface that are fixed in its parameters, found where straight lines cross it.

A probe is a weighted mean of the corners of a quad, bilinear in its place on the baseline. It goes with the material of
the surface wherever that moves: a constant sparse linear map of the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ..checks import as_numbers
from ..errors import InputError
from ..mesh.surface import SurfaceGrid
from ..numerics.vector_arrays import lengths
from .crossings import body_intervals, find_crossings

__all__ = ["FLAT", "ROUND_OFF", "Probes", "checked_points", "opposite_probes"]

FLAT = 1e-9
"""Length, relative to the diagonal of the surface's box, that is taken for none."""

ROUND_OFF = 1e-13
"""Thickness, relative to the same, that has no direction."""


@dataclass(frozen=True, eq=False)
class Probes:
    """Points of a surface.

    Parameters
    ----------
    nodes : ndarray of int, shape (n, m)
        Nodes of each; they may repeat.
    weights : ndarray, shape (n, m)
        Their weights, of sum 1.
    """

    nodes: np.ndarray
    weights: np.ndarray

    @property
    def n_probes(self) -> int:
        """Number of probes."""
        return len(self.nodes)

    def at(self, points: np.ndarray) -> np.ndarray:
        """Places of the probes, shape (n, 3), of nodes, shape (n_points, 3); real or complex."""
        return np.einsum("nm,nmd->nd", self.weights, points[self.nodes])

    def matrix(self, n_points: int) -> csr_array:
        """The map of nodes to probes, shape (n, n_points)."""
        rows = np.repeat(np.arange(self.n_probes), self.nodes.shape[1])
        return csr_array((self.weights.ravel(), (rows, self.nodes.ravel())), shape=(self.n_probes, n_points))

    def take(self, rows: np.ndarray) -> Probes:
        """Some of the probes, in the order of ``rows``."""
        return Probes(self.nodes[rows], self.weights[rows])

    @classmethod
    def on_quads(cls, quads: np.ndarray, parameters: np.ndarray) -> Probes:
        """Probes on quads, shape (n, 4), at their parameters, shape (n, 2), from 0 to 1."""
        s, t = parameters.T
        return cls(quads, np.stack([(1 - s) * (1 - t), s * (1 - t), s * t, (1 - s) * t], axis=1))


def opposite_probes(
    surface: SurfaceGrid, points: np.ndarray, directions: np.ndarray, what: str = "probes"
) -> tuple[Probes, Probes]:
    """Find where lines through points enter and leave a body.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface, on its baseline.
    points : ndarray, shape (n, 3)
        A point of each line (m): inside the body, or near it.
    directions : ndarray, shape (3,) or (n, 3)
        Directions of the lines, of any length.
    what : str
        What the probes are for, for messages.

    Returns
    -------
    entries, exits : Probes
        Ends of that part of each line within the body which holds its point, or else is nearest to it. A line through a
        seam of the grid gets the quad of the lowest number.

    Raises
    ------
    InputError
        If an array has the wrong shape, a direction has no length, or a line does not cross the body.

    Notes
    -----
    Lines enter where they run against the normal into the fluid and leave where they run along it. Quads that a line
    grazes, within 1e-9 rad, do not count.
    """
    points, directions = checked_points(points, what), _checked_directions(directions, len(points), what)
    found = find_crossings(surface, points, directions)
    entries, exits = body_intervals(found, FLAT * surface.size)
    _require_all(entries.line, points, what)
    return tuple(Probes.on_quads(surface.quads[ends.quad], ends.parameters) for ends in (entries, exits))


def checked_points(points: np.ndarray, what: str) -> np.ndarray:
    """Return points as an array of shape (n, 3).

    Raises
    ------
    InputError
        If the shape is another, there is none, or one is not finite.
    """
    points = np.atleast_2d(as_numbers(points, what))
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InputError(f"{what}: points of shape {points.shape}; give shape (n, 3)")
    if not np.isfinite(points).all():
        raise InputError(
            f"{what}: point {int(np.argmin(np.isfinite(points).all(axis=1))) + 1} is not finite; repair it"
        )
    return points


def _checked_directions(directions, n, what):
    directions = as_numbers(directions, f"{what}: directions")
    if directions.shape not in ((3,), (n, 3)):
        raise InputError(f"{what}: directions of shape {directions.shape}; give shape (3,) or ({n}, 3)")
    directions = np.broadcast_to(directions, (n, 3))
    if not (np.isfinite(directions).all() and (lengths(directions) > 0.0).all()):
        raise InputError(f"{what}: a direction has no length, or is not finite; correct it")
    return directions


def _require_all(lines, points, what):
    """Refuse lines that do not cross the body."""
    missed = np.setdiff1d(np.arange(len(points)), lines)
    if len(missed):
        x, y, z = points[missed[0]]
        raise InputError(
            f"{what}: the line of probe {missed[0] + 1} of {len(points)}, through ({x:g}, {y:g}, {z:g}), does not "
            f"cross the surface from one side to the other; move it inside the surface, or turn it"
        )
