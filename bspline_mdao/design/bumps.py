"""Random smooth bumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..mesh.frame import Plane

__all__ = ["Bumps", "random_bumps"]

_N_WAVES = 32


@dataclass(frozen=True, eq=False)
class Bumps:
    """Move points by a smooth vector field of their place: a sum of plane waves.

    A field moves both sides of a thin wing alike and keeps closed edges closed. Towards a plane of symmetry its normal
    component fades as ``1 - exp(-(d / reach)^2)`` with the distance d.

    Parameters
    ----------
    amount : float
        Height (m).
    waves, phases : ndarray, shape (n, 3) and (n,)
        Wave vectors (rad/m) and phases (rad).
    directions : ndarray, shape (n, 3)
        Displacement at the crest of each wave, by the height.
    reach : float
        Distance from a plane of symmetry over which bumps fade (m).
    planes : tuple of Plane
        Planes of symmetry, at right angles or parallel to each other.
    """

    amount: float
    waves: np.ndarray
    phases: np.ndarray
    directions: np.ndarray
    reach: float
    planes: tuple[Plane, ...] = ()

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres."""
        field = np.cos(points @ self.waves.T + self.phases) @ self.directions
        for plane in self.planes:
            faded = np.exp(-(((points @ plane.normal - plane.offset) / self.reach) ** 2))
            field = field - (faded * (field @ plane.normal))[:, None] * plane.normal
        return points + self.amount * field


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
    reach = 0.25 * wavelength
    unit = Bumps(1.0, waves, phases, directions, reach, planes)
    largest = np.linalg.norm(unit.apply(points) - points, axis=1).max()
    if not largest > 0.0:
        raise InputError("deformation: bumps move no point of this surface; all of it is on planes of symmetry")
    return Bumps(height, waves, phases, directions / largest, reach, planes)


def _directions(rng):
    """Directions that favour none, shape (n, 3)."""
    vectors = rng.standard_normal((_N_WAVES, 3))
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]
