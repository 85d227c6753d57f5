"""A B-spline mesh: volumes that share control points.

Theory: ``docs/theory/splines.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...errors import InputError
from .volume import Volume


@dataclass(frozen=True, eq=False)
class BSplineMesh(OneLine):
    """Volumes whose control points come from one list with each shared point once."""

    volumes: tuple[Volume, ...]  # one volume per block
    # for each volume, the number of each of its control points in the list
    control_ids: tuple[np.ndarray, ...]  # int each (N0, N1, N2)
    n_control_points: int  # length of the list; every point in it belongs to a volume

    def __post_init__(self) -> None:
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

    def _check_all_used(self) -> None:
        is_used = np.zeros(self.n_control_points, dtype=bool)
        for ids in self.control_ids:
            is_used[ids] = True
        if not is_used.all():
            raise InputError(
                f"B-spline mesh: control point {np.argmin(is_used) + 1} of {self.n_control_points} belongs to no "
                f"volume; number the control points without gaps"
            )

    def nets(
        self,
        control_points: np.ndarray,  # (n_control_points, ...), the list of control points
    ) -> list[np.ndarray]:  # each (N0, N1, N2, ...)
        """Gather the control points of each volume from the list."""
        return [control_points[ids] for ids in self.control_ids]


def _check_ids(number: int, volume: Volume, ids: np.ndarray, n_control_points: int) -> None:
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
