"""A B-spline mesh: volumes that share control points.

Theory: ``docs/theory/splines.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..shown import OneLine
from .volume import Volume


@dataclass(frozen=True, eq=False)
class BSplineMesh(OneLine):
    """Volumes whose control points come from one list, each shared point being in it once.

    Parameters
    ----------
    volumes : tuple of Volume
        One volume per block.
    control_ids : tuple of ndarray of int, each of shape (N0, N1, N2)
        For each volume, the number of each of its control points in the list.
    n_control_points : int
        Length of the list; every point in it belongs to a volume.

    Raises
    ------
    InputError
        If the parts do not fit together.
    """

    volumes: tuple[Volume, ...]
    control_ids: tuple[np.ndarray, ...]
    n_control_points: int

    def __post_init__(self):
        object.__setattr__(self, "volumes", tuple(self.volumes))
        object.__setattr__(self, "control_ids", tuple(np.ascontiguousarray(ids) for ids in self.control_ids))
        if len(self.volumes) != len(self.control_ids):
            raise InputError(
                f"B-spline mesh: {len(self.volumes)} volumes and {len(self.control_ids)} arrays of control point ids; "
                f"give one array per volume"
            )
        for number, (volume, ids) in enumerate(zip(self.volumes, self.control_ids), start=1):
            _check_ids(number, volume, ids, self.n_control_points)
        self._check_all_used()

    def _check_all_used(self):
        is_used = np.zeros(self.n_control_points, dtype=bool)
        for ids in self.control_ids:
            is_used[ids] = True
        if not is_used.all():
            raise InputError(
                f"B-spline mesh: control point {np.argmin(is_used) + 1} of {self.n_control_points} belongs to no "
                f"volume; number the control points without gaps"
            )

    def nets(self, control_points: np.ndarray) -> list[np.ndarray]:
        """Cut the list of control points into those of each volume.

        Parameters
        ----------
        control_points : ndarray, shape (n_control_points, ...)
            The list of control points.

        Returns
        -------
        list of ndarray, each of shape (N0, N1, N2, ...)
        """
        return [control_points[ids] for ids in self.control_ids]


def _check_ids(number: int, volume: Volume, ids: np.ndarray, n_control_points: int):
    if ids.shape != volume.n_control:
        raise InputError(
            f"B-spline mesh: volume {number} has {volume.n_control} control points and ids of shape {ids.shape}; "
            f"make them agree"
        )
    if not np.issubdtype(ids.dtype, np.integer):
        raise InputError(f"B-spline mesh: control point ids of volume {number} are {ids.dtype}; give integers")
    if ids.min() < 0 or ids.max() >= n_control_points:
        raise InputError(
            f"B-spline mesh: control point ids of volume {number} run from {ids.min()} to {ids.max()}; "
            f"keep them within 0 and {n_control_points - 1}"
        )
