"""Deformations by CAD files: points follow the faces they are nearest to.

A point x whose nearest point on the old faces is S(u, v) moves to x + S_new(u, v) - S_old(u, v). Theory:
``docs/theory/cad.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ..cad.cad_body import CadBody

__all__ = ["CadDeformation"]


@dataclass(frozen=True, eq=False)
class CadDeformation(OneLine):
    """Move points by ``amount`` times the displacement of the nearest points on the faces of a CAD file."""

    body: CadBody  # the faces before
    moved: CadBody  # the same faces after
    amount: float = 1.0
    off: float = 0.0  # largest distance of a wall node from the faces before (m)

    @property
    def note(self) -> str:
        """Its line in a report."""
        return (
            f"walls, within {self.off:.2g} m of the faces of {self.body.source}, go where {self.moved.source} has these"
        )

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres; real, or complex by a step."""
        tie = self.body.tie(points.real)
        moves = self.body.displacement(self.moved, tie)
        if np.iscomplexobj(points):  # parameters change with the points
            moves = moves + 1j * self.body.displacement_rates(self.moved, tie, points.real, points.imag)
        return points + self.amount * moves
