"""Smoothness across the seams of the surface: control points next to a seam stay in line with those on it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..mesh.mesh import MovingMesh
from .equations import Equations
from .pairing import Where, place_of, rows_of
from .seams import surface_seams

__all__ = ["Collinear"]


@dataclass(frozen=True, eq=False)
class Collinear:
    """Control points across seams between sides of blocks stay in line, in the ratio of the baseline (G1).

    The points on the seam follow their two neighbours, where nothing else holds them.

    Parameters
    ----------
    where : Selection, array_like of int or None
        Points on seams, as rows of ``mesh.surface_ids`` in case of numbers; what else is selected is left out. By
        default all at which the baseline is smooth.
    max_kink : float
        Largest angle of the baseline between the two sides at which it counts as smooth (deg).
    name : str
        For messages.
    """

    where: Where | None = None
    max_kink: float = 5.0
    name: str = "collinear"

    def equations(self, mesh: MovingMesh, points: np.ndarray) -> Equations:
        """Equations ``(d_+ - d_0) + r (d_- - d_0) = 0`` at each point of a seam, where r is the ratio of the lengths.

        Raises
        ------
        InputError
            If no point is on a seam, or the baseline has a kink at one that was asked for.
        """
        triples = surface_seams(mesh)
        if self.where is not None:
            triples = triples[np.isin(triples[:, 1], rows_of(self.where, mesh, f"linear constraint '{self.name}'"))]
        before, after = np.diff(points[triples], axis=1).transpose(1, 0, 2)
        kinks = _angles(before, after)
        is_smooth = kinks <= self.max_kink
        self._check(mesh, triples, kinks, is_smooth)
        ratios = _lengths(after[is_smooth]) / _lengths(before[is_smooth])
        weights = np.stack([ratios, -(1.0 + ratios), np.ones_like(ratios)], axis=1) / (1.0 + ratios)[:, None]
        coefficients = weights[:, None, :, None] * np.eye(3)[:, None]
        return Equations.of(len(points), triples[is_smooth], coefficients, follower=1)

    def _check(self, mesh, triples, kinks, is_smooth):
        """Refuse to be about nothing, and kinks where smoothness was asked for."""
        if not len(triples) or (self.where is None and not is_smooth.any()):
            raise InputError(
                f"linear constraint '{self.name}': no point is on a seam at which the surface is smooth; leave it out"
            )
        if self.where is not None and not is_smooth.all():
            worst = np.argmax(np.where(is_smooth, -np.inf, kinks))
            raise InputError(
                f"linear constraint '{self.name}': the surface has a kink of {kinks[worst]:.3g} deg at "
                f"{place_of(mesh, triples[worst, 1])}; leave it out, or raise max_kink from {self.max_kink:g}"
            )


def _angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles between vectors (deg), shape (n,); 180 where one has no length."""
    crossed = _lengths(np.cross(a, b))
    angles = np.degrees(np.arctan2(crossed, np.sum(a * b, axis=-1)))
    return np.where(_lengths(a) * _lengths(b) > 0.0, angles, 180.0)


def _lengths(vectors: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vectors, axis=-1)
