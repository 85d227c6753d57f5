"""The frame of SU2: x downstream and, in three dimensions, z up and y along the span; in two dimensions y up.

The grid's axes are rotated into it, never mirrored, so moments transform like forces. In three dimensions the span may
then be on the side of negative y. This makes no difference to a flow with a plane of symmetry, nor to forces that are
rotated back.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...base.checks import as_axes
from ...base.display import OneLine
from ...errors import InputError
from ..loads.stream import stream_axes

__all__ = ["Su2Frame"]


@dataclass(frozen=True, eq=False)
class Su2Frame(OneLine):
    """Directions of SU2 in the axes of the grid."""

    rows: np.ndarray  # (n_axes, 3), its coordinates are their products with ours
    axes: np.ndarray  # (3, 3), ours downstream, along the span and up

    @classmethod
    def of(cls, axes: str, across: int | None, what: str) -> Su2Frame:
        """Make it from the axes of a grid and, for a two-dimensional mesh, the axis normal to its plane."""
        downstream, span, up = as_axes(axes, what)
        if across is not None:
            if span[across] == 0.0:
                raise InputError(
                    f"{what}: axes={axes!r}, but the mesh is in the plane across {'xyz'[across]}; the second axis is "
                    f"that across the plane"
                )
            return cls(np.stack([downstream, up]), np.stack([downstream, span, up]))
        return cls(np.stack([downstream, np.cross(up, downstream), up]), np.stack([downstream, span, up]))

    @property
    def n_axes(self) -> int:
        """Dimensions of SU2's mesh."""
        return len(self.rows)

    @property
    def force_keys(self) -> tuple[str, ...]:
        """SU2's names of the forces along its axes, as objectives."""
        return ("FORCE_X", "FORCE_Y", "FORCE_Z")[: self.n_axes]

    @property
    def moment_rows(self) -> dict[str, np.ndarray]:
        """Directions in the grid's axes of the available moments, by SU2's names of them as objectives."""
        if self.n_axes == 2:
            return {"MOMENT_Z": np.cross(*self.rows)}
        return dict(zip(("MOMENT_X", "MOMENT_Y", "MOMENT_Z"), self.rows))

    def lift_and_drag(self, alpha: float) -> tuple[np.ndarray, np.ndarray]:
        """Weights (2, n_axes) of its forces in drag and lift at an angle (deg), and their derivatives by the angle."""
        drag, lift = stream_axes(np.radians(alpha), self.axes)
        return np.stack([drag, lift]) @ self.rows.T, np.radians(1.0) * np.stack([lift, -drag]) @ self.rows.T

    def references(self, area: float, chord: float, moments_about: np.ndarray) -> Mapping[str, object]:
        """Settings of the reference values."""
        point = np.zeros(3)
        point[: self.n_axes] = self.rows @ moments_about
        return {
            "REF_AREA": repr(float(area)),
            "REF_LENGTH": repr(float(chord)),
            **{f"REF_ORIGIN_MOMENT_{axis}": repr(float(value)) for axis, value in zip("XYZ", point)},
        }
