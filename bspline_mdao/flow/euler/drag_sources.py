"""Where drag comes from: shocks, by the entropy that they make, and what is left to the errors of the grid.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...base.numerics.processes import summed_number
from ...base.numerics.vectors import dots
from .entropy_drag import entropy_flux, entropy_scale, relative_entropy
from .gas import GAMMA
from .residual import Discretization

__all__ = ["DragSources", "wave_drag"]

SONIC = 0.95
"""Mach number along the pressure gradient from which on a cell lies in a shock."""

SMEARED = 2
"""Cells on both sides over which shocks are smeared."""

_STILL = 1e-12
"""Pressure differences, relative to the pressure, that count as rounding."""


class DragSources(NamedTuple):
    """Drag coefficient of the pressures on the walls, and its parts."""

    total: float  # ``CD``, of the pressures
    induced: float  # ``CD_induced``, from the wake
    wave: float  # from the entropy of shocks

    @property
    def spurious(self) -> float:
        """The rest, which comes from the discretization errors of the grid."""
        return self.total - self.induced - self.wave


def wave_drag(discretization: Discretization, states: np.ndarray, areas: np.ndarray, mach: float) -> float:
    """Drag of the entropy of shocks, divided by the dynamic pressure (m^2).

    Cells lie in a shock if the Mach number of the velocity along the pressure gradient is sonic, after van der Vooren
    and Destarac; cells within two cells of them count as well. The wave drag is their part of the drag of the entropy
    that leaves through the far field (`EntropyDrag`). States are a solution, shape (n_cells, 5), areas in m^2.

    References
    ----------
    J. van der Vooren, D. Destarac, "Drag/thrust analysis of jet-propelled transonic transport aircraft; definition of
    physical drag components", Aerosp. Sci. Technol. 8 (2004), 545-556.
    """
    faces, halo = discretization.faces, discretization.halo
    w, n = halo.extend(states), faces.n_inner
    left, right = w[faces.left], w[faces.right]
    pressure = left[:, 4].copy()
    pressure[:n] = 0.5 * (pressure[:n] + right[:, 4])
    gradient = np.stack([faces.sum_over_cells(pressure * areas[:, d]) for d in range(3)], axis=1)
    sizes = faces.sum_over_cells(np.linalg.norm(areas, axis=1), 1.0)
    steepness = np.linalg.norm(gradient, axis=1)
    is_steep = steepness > _STILL * states[:, 4] * sizes
    along = dots(states[:, 1:4], gradient) / np.where(is_steep, steepness, 1.0)
    shock = (is_steep & (along > SONIC * np.sqrt(GAMMA * states[:, 4] / states[:, 0]))).astype(float)
    for _ in range(SMEARED):
        seen = halo.extend(shock[:, None])[:, 0]
        across = np.zeros(faces.n_faces)
        across[:n] = np.maximum(seen[faces.left[:n]], seen[faces.right])
        shock = np.minimum(1.0, shock + faces.sum_over_cells(across, 1.0))
    outflow = left[:, 0] * dots(left[:, 1:4], areas) * relative_entropy(left)
    outflow[:n] = 0.5 * (outflow[:n] + right[:, 0] * dots(right[:, 1:4], areas[:n]) * relative_entropy(right))
    far = faces.faces_of("farfield")
    outflow[far] = entropy_flux(left[far], areas[far])
    is_closed = np.ones(faces.n_faces, dtype=bool)
    is_closed[:n], is_closed[far] = False, False
    outflow[is_closed] = 0.0
    return float(summed_number(halo.comm, shock @ faces.sum_over_cells(outflow)) / entropy_scale(mach))
