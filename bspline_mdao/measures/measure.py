"""What every measure of a surface is.

A measure gives one or more numbers for the nodes of a `SurfaceGrid`, and their sparse derivatives. A user's own measure
is any object with the members of `Measure`; `bspline_mdao.SurfaceMeasure` makes a component of it.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from scipy.sparse import csr_array

from ..mesh.surface import SurfaceGrid

__all__ = ["MEMBERS", "Measure"]

MEMBERS = ("name", "units", "shape", "surface", "evaluate", "partials")
"""What every measure has."""


class Measure(Protocol):
    """Numbers that tell something about a surface."""

    name: str
    """Name of the output."""

    units: str | None
    """Units of the numbers."""

    shape: tuple[int, ...]
    """Shape of the output."""

    surface: SurfaceGrid
    """The surface that is measured: what is discrete is decided on its baseline nodes, once and for all."""

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Measure nodes, shape (n, 3), in metres, real or complex; shape (size,), in the C order of ``shape``."""

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`: shape (size, 3 n), of a pattern that does not depend on the nodes."""
