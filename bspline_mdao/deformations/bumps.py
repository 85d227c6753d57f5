"""Random smooth bumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .frame import Plane

__all__ = ["Bumps", "random_bumps"]

_N_WAVES = 32


@dataclass(frozen=True, eq=False)
class Bumps:
    """Move points by a smooth vector field of their place: a sum of plane waves.

    A field moves both sides of a thin wing alike, keeps closed edges closed, and leaves planes of symmetry in place
    since it is the mean of itself and its mirror images.

    Parameters
    ----------
    amount : float
        Height (m).
    waves, phases : ndarray, shape (n, 3) and (n,)
        Wave vectors (rad/m) and phases (rad).
    directions : ndarray, shape (n, 3)
        Displacement at the crest of each wave, by the height.
    planes : tuple of Plane
        Planes of symmetry, at right angles to each other.
    """

    amount: float
    waves: np.ndarray
    phases: np.ndarray
    directions: np.ndarray
    planes: tuple[Plane, ...] = ()

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres."""
        return points + self.amount * self._field(points, self.planes)

    def _field(self, points, planes):
        if not planes:
            return np.cos(points @ self.waves.T + self.phases) @ self.directions
        plane, *others = planes
        mirrored = points - 2.0 * np.outer(points @ plane.normal - plane.offset, plane.normal)
        image = self._field(mirrored, others)
        image = image - 2.0 * np.outer(image @ plane.normal, plane.normal)
        return 0.5 * (self._field(points, others) + image)


def random_bumps(
    points: np.ndarray, height: float, wavelength: float, seed: int, planes: tuple[Plane, ...] = ()
) -> Bumps:
    """Draw random bumps.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Points of the surface (m).
    height : float
        Largest displacement of these points (m).
    wavelength : float
        Shortest wavelength (m); the longest is twice that.
    seed : int
        Of the random numbers.
    planes : tuple of Plane
        Planes of symmetry.

    Returns
    -------
    Bumps

    Raises
    ------
    InputError
        If no point can move.
    """
    rng = np.random.default_rng(seed)
    waves, directions = _directions(rng), _directions(rng)
    waves *= 2.0 * np.pi / wavelength * rng.uniform(0.5, 1.0, (_N_WAVES, 1))
    phases = rng.uniform(0.0, 2.0 * np.pi, _N_WAVES)
    unit = Bumps(1.0, waves, phases, directions, planes)
    largest = np.linalg.norm(unit.apply(points) - points, axis=1).max()
    if not largest > 0.0:
        raise InputError("deformation: bumps move no point of this surface; all of it is on planes of symmetry")
    return Bumps(height, waves, phases, directions / largest, planes)


def _directions(rng):
    """Directions that favour none, shape (n, 3)."""
    vectors = rng.standard_normal((_N_WAVES, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]
