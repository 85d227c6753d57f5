"""Where to start looking for a point in a B-spline mesh: samples of the volumes in search trees.

Each volume is sampled on a lattice that follows its spans, so that the samples are as clustered as the control mesh.
The convex hull property gives a rigorous bound the other way: no point of a volume lies outside the box of its control
points.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ..splines.mesh import BSplineMesh
from ..splines.volume import Volume, evaluate

__all__ = ["VolumeSamples", "nearest_samples", "sample_mesh", "span_lattice"]

SAMPLES_PER_SPAN = 4
"""Samples per span and direction."""

MIN_SAMPLES = 6
"""Least number of samples in a direction that is not degenerate."""

START_RANKS = (0, 7, 63, 1, 20, 200)
"""Which of the nearest samples to start from. Where samples are stretched, the nearest ones all lie in one column."""


@dataclass(frozen=True, eq=False)
class VolumeSamples:
    """Samples of one volume.

    Parameters
    ----------
    parameters : ndarray, shape (m, 3)
        Parameters of the samples, all inside the volume and none on its boundary.
    tree : scipy.spatial.cKDTree
        The samples in space.
    lower, upper : ndarray, shape (3,)
        Box of the control points.
    """

    parameters: np.ndarray
    tree: cKDTree
    lower: np.ndarray
    upper: np.ndarray

    def box_distance(self, points: np.ndarray) -> np.ndarray:
        """Lower bound of the distance of points, shape (n, 3), to the volume, shape (n,)."""
        beyond = np.maximum(np.maximum(self.lower - points, points - self.upper), 0.0)
        return np.sqrt(np.einsum("qx,qx->q", beyond, beyond))

    def starts(self, points: np.ndarray) -> np.ndarray:
        """Parameters to start from, shape (n, n_starts, 3), for points of shape (n, 3); the most promising first."""
        ranks = [rank for rank in START_RANKS if rank < len(self.parameters)]
        _, ids = self.tree.query(points, k=[rank + 1 for rank in ranks])
        return self.parameters[ids]


def sample_mesh(mesh: BSplineMesh, control_points: np.ndarray) -> list[VolumeSamples]:
    """Sample every volume of a mesh with control points of shape (n_control_points, 3)."""
    return [_sample_volume(volume, net) for volume, net in zip(mesh.volumes, mesh.nets(control_points))]


def nearest_samples(samples: list[VolumeSamples]):
    """Make a search over the samples of all volumes: points, shape (n, 3), to volumes (n,) and parameters (n, 3)."""
    tree = cKDTree(np.concatenate([s.tree.data for s in samples]))
    parameters = np.concatenate([s.parameters for s in samples])
    volumes = np.repeat(np.arange(len(samples)), [len(s.parameters) for s in samples])

    def search(points):
        _, ids = tree.query(points)
        return volumes[ids], parameters[ids]

    return search


def span_lattice(volume: Volume) -> np.ndarray:
    """Parameters of a lattice that follows the spans of a volume.

    With curved knots the spans in one direction depend on the parameters in the other two; a few substitutions place
    the lattice well enough.

    Returns
    -------
    ndarray, shape (m0, m1, m2, 3)
        Inside (0, 1); 0 in a degenerate direction.
    """
    stations = [_stations(knots) for knots in volume.knots]
    at = np.stack([a.ravel() for a in np.meshgrid(*stations, indexing="ij")], axis=1)
    parameters = at / [k.n_control - k.order + 1 for k in volume.knots]
    for _ in range(3):
        parameters = np.stack([_place(volume.knots[d], at[:, d], parameters, d) for d in range(3)], axis=1)
    return parameters.reshape(*(s.size for s in stations), 3)


def _stations(knots) -> np.ndarray:
    """Where the samples of one direction lie, counted in spans."""
    if knots.order == 1 and knots.n_control == 1:
        return np.zeros(1)
    n_spans = knots.n_control - knots.order + 1
    n_samples = max(SAMPLES_PER_SPAN * n_spans, MIN_SAMPLES)
    return (np.arange(n_samples) + 0.5) * n_spans / n_samples


def _place(knots, at: np.ndarray, parameters: np.ndarray, d: int) -> np.ndarray:
    """Parameters of stations ``at`` in direction ``d``, where the other two parameters are ``parameters``."""
    breaks = knots.values(parameters[:, (d + 1) % 3].copy(), parameters[:, (d + 2) % 3].copy())
    rows, span = np.arange(at.size), np.floor(at).astype(int)
    low, high = breaks[rows, knots.order - 1 + span], breaks[rows, knots.order + span]
    return low + (at - span) * (high - low)


def _sample_volume(volume: Volume, net: np.ndarray) -> VolumeSamples:
    parameters = span_lattice(volume).reshape(-1, 3)
    tree = cKDTree(evaluate(volume, net, parameters))
    return VolumeSamples(parameters, tree, net.min(axis=(0, 1, 2)), net.max(axis=(0, 1, 2)))
