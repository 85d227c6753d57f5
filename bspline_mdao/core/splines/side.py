"""One side of a B-spline volume as a surface, with its edges as ordinary B-spline curves.

On a side the third parameter is 0 or 1. Its knots may still be curved: each direction's knots depend on the other
parameter. Along an edge they are constant, so edges are ordinary B-spline curves. Theory: ``docs/theory/cad.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from .knots import ConstantKnots
from .volume import Volume, evaluate, evaluate_gradients, evaluate_hessians

__all__ = ["VolumeSide"]

STRAIGHT = 1e-14
"""Knots that vary by less are straight: round-off of numbers up to one."""

HESSIAN = ((0, 1, 2), (1, 3, 4), (2, 4, 5))
"""Column of each second derivative in the result of `evaluate_hessians`."""


@dataclass(frozen=True, eq=False)
class VolumeSide(OneLine):
    """A side of a volume, as a surface of two parameters (u, v)."""

    volume: Volume
    net: np.ndarray  # (N0, N1, N2, d), its control points (m)
    # the side is at this parameter, 0 or 1, of this direction of the volume, 0 to 2
    direction: int
    end: int
    axes: tuple[int, int]  # directions of the volume that are u and v

    @property
    def control_points(self) -> np.ndarray:
        """Control points of the surface, shape (N_u, N_v, d)."""
        layer = np.take(self.net, -self.end, axis=self.direction)
        return layer if self.axes[0] < self.axes[1] else layer.swapaxes(0, 1)

    @property
    def orders(self) -> tuple[int, int]:
        """Orders in u and v."""
        u, v = (self.volume.orders[a] for a in self.axes)
        return u, v

    def parameters(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Parameters of the volume, shape (n, 3), from the surface's, each of shape (n,)."""
        found = np.full((len(u), 3), float(self.end))
        found[:, self.axes[0]], found[:, self.axes[1]] = u, v
        return found

    def points(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Points, shape (n, d), at parameters of shape (n,)."""
        return evaluate(self.volume, self.net, self.parameters(u, v))

    def gradients(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """First derivatives in u and v, shape (n, d, 2), at parameters of shape (n,)."""
        return evaluate_gradients(self.volume, self.net, self.parameters(u, v))[..., list(self.axes)]

    def hessians(self, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Second derivatives in uu, uv and vv, shape (n, d, 3), at parameters of shape (n,)."""
        a, b = self.axes
        columns = [HESSIAN[a][a], HESSIAN[a][b], HESSIAN[b][b]]
        return evaluate_hessians(self.volume, self.net, self.parameters(u, v))[..., columns]

    def knots(self, axis: int, other: np.ndarray) -> np.ndarray:
        """Knots in u (axis 0) or v (axis 1), shape (n, N + p), at values of the other parameter, shape (n,)."""
        d = self.axes[axis]
        pair = (other, other)
        at = self.parameters(*pair)
        return self.volume.knots[d].values(at[:, (d + 1) % 3].copy(), at[:, (d + 2) % 3].copy())

    def edge_knots(self, axis: int, end: int) -> ConstantKnots:
        """Knots in u (axis 0) or v (axis 1) along the edge where the other parameter is 0 or 1."""
        return ConstantKnots(self.knots(axis, np.array([float(end)]))[0], self.orders[axis])

    @property
    def is_straight(self) -> bool:
        """Whether its knots are constant: then it is an ordinary tensor-product B-spline."""
        at = np.linspace(0.0, 1.0, 5)
        return all(np.ptp(self.knots(axis, at), axis=0).max() <= STRAIGHT for axis in (0, 1))
