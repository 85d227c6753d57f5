"""Nodes from control points whose vectors refer to local directions, which differ from place to place.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from .evaluator import Evaluator

__all__ = ["TurnedEvaluator"]

Turn = Callable[[np.ndarray], np.ndarray]
"""A linear map of each vector separately."""


@dataclass(frozen=True, eq=False)
class TurnedEvaluator(OneLine):
    """The linear map from vectors of control points to vectors of nodes through components of both."""

    basis: Evaluator  # from components of the control points to components of the nodes
    # components of the vectors of control points and of nodes, and their transposes
    to_control: Turn
    from_control: Turn
    to_nodes: Turn
    from_nodes: Turn

    def forward(self, control_points: np.ndarray) -> np.ndarray:
        """Vectors of the nodes from vectors of the control points, shape (n_control_points, 3)."""
        return self.from_nodes(self.basis.forward(np.ascontiguousarray(self.to_control(control_points))))

    def adjoint(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `forward`."""
        return self.from_control(self.basis.adjoint(np.ascontiguousarray(self.to_nodes(bar))))
