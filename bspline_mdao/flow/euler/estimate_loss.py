"""A smooth measure of the adjoint-based errors of a grid, differentiated with respect to its states and nodes.

    c = P^T (P psi . R_f(P w, N x)),    value = sum_c (sqrt(c^2 + s^2) - s)

The contributions c of the cells are as in `.error_estimate`: the residual on a finer member of prolonged states and
nodes, weighted with a prolonged adjoint, which is frozen here.

Theory: ``docs/theory/adaptation.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...base.numerics.vectors import dots
from .error_estimate import FinerMember

__all__ = ["EstimateLoss", "WeightedAdjoint"]


@dataclass(frozen=True, eq=False)
class WeightedAdjoint:
    """The adjoint of a functional, and the scales of its contributions."""

    psi: np.ndarray  # (n_cells, 5), adjoint on the grid
    bound: float  # the sum of all absolute contributions that counts one
    width: float  # contributions below this count by their squares


@dataclass(frozen=True, eq=False)
class EstimateLoss:
    """Sum over the functionals of all absolute contributions, each divided by its bound."""

    member: FinerMember  # the finer member on which residuals are evaluated
    adjoints: Sequence[WeightedAdjoint]  # one for each functional
    stream: np.ndarray  # (5,), the free stream

    def value(self, states: np.ndarray, nodes: np.ndarray) -> float:
        """Loss of states, shape (n_cells, 5), on nodes, shape (n_nodes, 3), in metres; real or complex."""
        w, x = self._finer(states, nodes)
        residual = self.member.flow.at(x).residual(w, self.member.flow.areas(x), self.stream)
        return sum(self._count(adjoint, residual)[0] for adjoint in self.adjoints)

    def gradient(self, states: np.ndarray, nodes: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Loss, and its derivatives with respect to the states, (n_cells, 5), and the nodes, (n_nodes, 3)."""
        member = self.member
        w, x = self._finer(states, nodes)
        scheme, areas = member.flow.at(x), member.flow.areas(x)
        residual = scheme.residual(w, areas, self.stream)
        total, bar = 0.0, np.zeros_like(residual)
        for adjoint in self.adjoints:
            value, slopes, psi = self._count(adjoint, residual)
            total += value
            bar += psi * member.cells.spread(slopes)[:, None]
        tangent = scheme.linearize(w, areas, self.stream)
        states_bar = member.cells.prolong_transposed(tangent.state_vjp(bar))
        nodes_bar = member.nodes.prolong_transposed(member.flow.nodes_vjp(x, tangent, bar))
        return float(total), states_bar, nodes_bar

    def _finer(self, states: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States and nodes of the finer member."""
        return self.member.cells.prolong(states), self.member.nodes_at(nodes)

    def _count(self, adjoint: WeightedAdjoint, residual: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Loss of a functional, its derivatives by the contributions, and its adjoint on the finer member."""
        psi = self.member.cells.prolong(adjoint.psi)
        contributions = self.member.cells.restrict_sums(dots(psi, residual))
        rounded = np.sqrt(contributions**2 + adjoint.width**2)
        value = np.sum(rounded - adjoint.width) / adjoint.bound
        return value, contributions / rounded / adjoint.bound, psi
