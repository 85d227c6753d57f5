"""Lift and induced drag from the wake far downstream, in the Trefftz plane.

There the wake is a row of straight vortices that trail from the edges of the strips of a wing. With the circulation
``g_i`` of strip i, its trace ``t_i`` in the plane from one trailing vortex to the next and a point ``m_i`` of that,
its middle or another one, and the strengths ``s_j`` of the vortices at ``p_j``, the differences of the circulations::

    lift / (rho V) = sum_i g_i t_iy,     drag / rho = 1/(4 pi) sum_ij g_i s_j (m_i - p_j) . t_i / |m_i - p_j|^2
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

__all__ = ["Wake", "least_drag"]

_MIRROR = np.array([-1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Wake:
    """Vortices that trail from the strips of a wing, from the left tip to the right one or to the symmetry plane.

    Parameters
    ----------
    points : ndarray, shape (n + 1, 2)
        Where they cross the Trefftz plane: coordinates y, to the right, and z, up (m). Real or complex.
    circulations : ndarray, shape (n,)
        Of the strips between them (m^2/s), positive where they lift. Real or complex.
    is_symmetric : bool
        The right half is the mirror image about y = 0 and counts as well.
    places : float or ndarray, shape (n,)
        Where the downwash is taken, as a part of the way from one vortex to the next.
    """

    points: np.ndarray
    circulations: np.ndarray
    is_symmetric: bool = True
    places: float | np.ndarray = 0.5

    @property
    def lift(self):
        """Lift by density and speed (m^3/s)."""
        return self._halves * (self.circulations @ self._traces[:, 0])

    @property
    def drag(self):
        """Induced drag by density (m^4/s^2)."""
        return self.circulations @ self.influence @ self.circulations

    @cached_property
    def influence(self) -> np.ndarray:
        """Matrix of the drag as a quadratic form of the circulations, shape (n, n)."""
        kernel = sum(sign * _dot(arms, self._traces) / _dot(arms, arms) for sign, _, arms in self._images)
        return self._factor * (kernel[:, :-1] - kernel[:, 1:])

    def lift_gradients(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the lift in the points, shape (n + 1, 2), and in the circulations, shape (n,)."""
        points_bar = np.zeros_like(self.points)
        points_bar[:, 0] = -self._halves * self._strengths
        return points_bar, self._halves * self._traces[:, 0]

    def drag_gradients(self) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of the drag in the points, shape (n + 1, 2), and in the circulations, shape (n,)."""
        weights = self._factor * np.outer(self.circulations, self._strengths)[:, :, None]
        points_bar = np.zeros_like(self.points)
        for sign, mirror, arms in self._images:
            traces, square = self._traces[:, None], _dot(arms, arms)[..., None]
            arms_bar = sign * weights * (traces - 2.0 * _dot(arms, traces)[..., None] / square * arms) / square
            place_bar, traces_bar = arms_bar.sum(axis=1), (sign * weights * arms / square).sum(axis=1)
            points_bar[:-1] += (1.0 - self._parts) * place_bar - traces_bar
            points_bar[1:] += self._parts * place_bar + traces_bar
            points_bar -= mirror * arms_bar.sum(axis=0)
        return points_bar, (self.influence + self.influence.T) @ self.circulations

    @property
    def _halves(self) -> float:
        return 2.0 if self.is_symmetric else 1.0

    @property
    def _factor(self) -> float:
        return self._halves / (4.0 * np.pi)

    @property
    def _traces(self) -> np.ndarray:
        return np.diff(self.points, axis=0)

    @property
    def _parts(self) -> np.ndarray:
        """`places` as a factor of points."""
        return np.asarray(self.places)[..., None]

    @property
    def _strengths(self) -> np.ndarray:
        """Strength of every trailing vortex, shape (n + 1,)."""
        return np.diff(self.circulations, prepend=0.0, append=0.0)

    @cached_property
    def _images(self) -> list[tuple[float, np.ndarray, np.ndarray]]:
        """Sign and mirror of the vortices and of their image, and the arms (n, n + 1, 2) from them to the places."""
        places = (1.0 - self._parts) * self.points[:-1] + self._parts * self.points[1:]
        images = [(1.0, np.ones(2)), (-1.0, _MIRROR)] if self.is_symmetric else [(1.0, np.ones(2))]
        return [(sign, mirror, places[:, None] - mirror * self.points) for sign, mirror in images]


def least_drag(points: np.ndarray, lift: float, is_symmetric: bool = True) -> Wake:
    """Give the circulations of least induced drag for a lift and a trace of the wake (Munk).

    Parameters
    ----------
    points : ndarray, shape (n + 1, 2)
        Where the vortices cross the Trefftz plane (m), see `Wake`.
    lift : float
        Lift by density and speed (m^3/s).
    is_symmetric : bool
        As for `Wake`.

    Returns
    -------
    Wake
        The optimum: where the drag is stationary, the downwash by the trace's slope is the same along the span.

    Notes
    -----
    With n strips of one width across a whole flat wing of span b the least drag by density is
    ``2 lift^2 / (pi b^2) n / (n + 1)``: the discrete span efficiency is ``1 + 1/n``, not 1.
    """
    still = Wake(points, np.zeros(len(points) - 1), is_symmetric)
    _, lift_by_circulation = still.lift_gradients()
    circulations = np.linalg.solve(still.influence + still.influence.T, lift_by_circulation)
    return Wake(points, lift / (lift_by_circulation @ circulations) * circulations, is_symmetric)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of arms (n, m, 2) with arms, or with traces (n, 2) or (n, 1, 2)."""
    return np.sum(a * (b if b.ndim == 3 else b[:, None]), axis=-1)
