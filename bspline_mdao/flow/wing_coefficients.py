"""What every flow tells of the forces on a wing, by the names that it has in OpenMDAO."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .force_coefficients import ForceCoefficients
from .induced_drag import InducedDrag

__all__ = ["WingCoefficients"]


@dataclass(frozen=True, eq=False)
class WingCoefficients:
    """Coefficients ``CL``, ``CD``, ``CM`` and ``CD_induced``, and the ``span_load`` (m).

    Parameters
    ----------
    coefficients : ForceCoefficients
        The first three.
    induced : InducedDrag
        The others.
    """

    coefficients: ForceCoefficients
    induced: InducedDrag

    def evaluate(self, forces: np.ndarray, nodes: np.ndarray, alpha) -> dict[str, np.ndarray]:
        """Give all of them for forces by the dynamic pressure (m^2), nodes (m) and an angle of attack (rad).

        Arguments are those of `ForceCoefficients.evaluate`.
        """
        at = forces, nodes, alpha
        return self._named(self.coefficients.evaluate(*at), *self.induced.evaluate(*at))

    def jvp(self, forces, nodes, alpha, d_forces, d_nodes, d_alpha) -> dict[str, np.ndarray]:
        """Derivatives of `evaluate` along a direction in all of its arguments."""
        at = forces, nodes, alpha, d_forces, d_nodes, d_alpha
        return self._named(self.coefficients.jvp(*at), *self.induced.jvp(*at))

    def vjp(self, forces, nodes, alpha, bars: dict) -> tuple[np.ndarray, np.ndarray, float]:
        """Apply the transpose of `jvp` to derivatives in some of the numbers, by name.

        Returns
        -------
        tuple
            Derivatives in the forces, shape (n_forces, 3), in the nodes, shape (n_nodes, 3), and in the angle (1/rad).
        """
        still = {"CL": 0.0, "CD": 0.0, "CM": np.zeros(3), "CD_induced": 0.0, "span_load": 0.0}
        lift, drag, moment, induced, load = (bars.get(name, zero) for name, zero in still.items())
        of_forces = self.coefficients.vjp(forces, nodes, alpha, np.hstack([lift, drag, moment]))
        of_wake = self.induced.vjp(forces, nodes, alpha, load, induced / self.coefficients.area)
        return tuple(a + b for a, b in zip(of_forces, of_wake))

    def _named(self, coefficients, load, drag):
        lift, drag_of_forces, *_ = coefficients
        return {
            "CL": lift,
            "CD": drag_of_forces,
            "CM": coefficients[2:],
            "CD_induced": drag / self.coefficients.area,
            "span_load": load,
        }
