"""Errors of lift, drag and other functionals by the adjoint, from a flow and a finer member without a solution.

Theory: ``docs/theory/error_estimates.rst``.

References
----------
D. A. Venditti, D. L. Darmofal, "Grid adaptation for functional outputs: application to two-dimensional inviscid flows",
J. Comput. Phys. 176 (2002), 40-69.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from ...base.numerics.vectors import dots
from ...core.evaluation.family import refined_topology
from ...core.evaluation.transfer import CellTransfer, NodeTransfer
from ...grids.topology.topology import Topology
from .adjoint import FlowTangent
from .flow_grid import FlowGrid
from .forces import FlowForces
from .newton import Field, advance
from .settings import NEWTON

__all__ = ["ErrorEstimate", "FinerMember", "FinerStates"]

RELAXED = 0.3
"""Remaining fraction of the residuals of prolonged states and adjoints on the finer member after relaxation."""


@dataclass(frozen=True, eq=False)
class ErrorEstimate(OneLine):
    """A functional on a grid, and its adjoint-based estimate on a finer member of the family."""

    value: float  # on the grid
    finer: float  # estimate for the finer member
    factor: float  # cells per direction of the finer member, relative to the grid
    # (n_cells,), contributions of the residuals in the cells of the grid to the difference of both
    contributions: np.ndarray
    # Error bound of the estimate itself: the adjoint correction of the value on the finer member, and the change due to
    # relaxing states and adjoint towards the finer member, both as absolute values
    remaining: float

    @property
    def error(self) -> float:
        """Excess of the value on the grid over the finer member."""
        return self.value - self.finer

    @property
    def limit(self) -> float:
        """Value on infinitely fine members if the order is two, as in smooth flow."""
        return self.value - self.error / (1.0 - self.factor**-2.0)

    @property
    def bound(self) -> float:
        """Sum of the absolute contributions: the error if none of them cancelled."""
        return float(np.sum(np.abs(self.contributions)))


@dataclass(frozen=True, eq=False)
class FinerMember:
    """A finer member of the family of a flow's grid, on which residuals are evaluated."""

    flow: FlowGrid  # of the finer member
    forces: FlowForces  # on it
    nodes: NodeTransfer  # of nodes to the finer member
    cells: CellTransfer  # of cells
    factor: float  # cells per direction, relative to the grid
    # tuple of two ndarray, each of shape (n, 3), nodes of the baseline, of the grid and of the finer member (m)
    baselines: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(
        cls,
        flow: FlowGrid,  # of the grid
        forces: FlowForces,  # on it
        topology: Topology,  # connections of its blocks
        nodes: np.ndarray,  # (n_nodes, 3), its nodes (m)
        axes: str,  # see `FlowGrid.of`
        factor: float,  # cells per direction of the finer member, relative to the grid; above 1
        # tuple of two ndarray, each of shape (n, 3), nodes of the baseline (m), and of its finer member; displacements
        # from them are interpolated
        baselines: tuple[np.ndarray, np.ndarray],
    ) -> FinerMember:
        """Refine the grid of a flow."""
        finer = refined_topology(topology, factor)
        to_nodes, scheme = NodeTransfer.of(topology, finer), flow.discretization
        finer_nodes = _displaced(to_nodes, baselines, nodes)
        fine_flow = FlowGrid.of(
            finer,
            finer_nodes,
            axes,
            dissipation=scheme.dissipation,
            shock_threshold=scheme.shock_threshold,
        )
        wing = forces.wing.coefficients
        references = wing.area, wing.chord, wing.reference
        fine_forces = FlowForces.of(fine_flow, finer_nodes, *references)
        return cls(fine_flow, fine_forces, to_nodes, CellTransfer.of(topology, finer), factor, baselines)

    def nodes_at(self, nodes: np.ndarray) -> np.ndarray:
        """Nodes of the finer member (m) from nodes of the grid, shape (n_nodes, 3); real or complex."""
        return _displaced(self.nodes, self.baselines, nodes)

    def prolonged(self, states: np.ndarray, nodes: np.ndarray, stream: np.ndarray) -> FinerStates:
        """Prolong the states of a flow, shape (n_cells, 5), on nodes, shape (n_nodes, 3), in a stream, shape (5,)."""
        x, w = self.nodes_at(nodes), self.cells.prolong(states)
        residual = self.flow.at(x).residual(w, self.flow.areas(x), stream)
        return FinerStates(x, w, residual, w, residual)

    def relaxed(self, states: np.ndarray, nodes: np.ndarray, stream: np.ndarray) -> FinerStates:
        """Prolong the states, and take an inexact Newton step on the finer member, of a safe length."""
        # The errors of prolonged states next to walls and edges are short-waved, and large enough there for
        # second-order terms; the step removes most of them.
        x, w = self.nodes_at(nodes), self.cells.prolong(states)
        field = Field(self.flow.at(x), self.flow.areas(x), stream)
        tangent = FlowTangent.of(field.discretization, w, field.areas, stream, self.flow.pattern)
        residual = field.residual(w)
        update = tangent.solve(-field.sizes * residual, RELAXED).x
        relaxed, left, _ = advance(NEWTON, field, w, residual, update)
        if field.norm(left) > field.norm(residual):
            relaxed, left = w, residual
        return FinerStates(x, w, field.sizes * residual, relaxed, field.sizes * left, tangent)

    def estimate(
        self,
        value: float,  # on the grid
        name: str,  # of an output of `FlowForces`, a scalar
        # (n_cells, 5), its adjoint on the grid; it is prolonged, and relaxed if the states are
        psi: np.ndarray,
        finer: FinerStates,  # of the flow
        alpha: float,  # alpha, mach: angle of attack (rad) and Mach number
        mach: float,
    ) -> ErrorEstimate:
        """Estimate a functional on the finer member after Venditti and Darmofal."""
        # With states w and an adjoint psi on the finer member, its functional J and residual R, it is ``J(w) - psi^T
        # R(w)``.

        def seen(states: np.ndarray) -> float:
            return float(np.ravel(self.forces.evaluate(states, finer.nodes, alpha, mach)[name])[0])

        psi = self.cells.prolong(psi)
        rough = seen(finer.prolonged) - float(np.sum(psi * finer.residual))
        if finer.tangent is not None:
            bar = self.forces.vjp(finer.states, finer.nodes, alpha, mach, {name: np.ones(1)})[0]
            lack = bar - finer.tangent.linearization.state_vjp(psi)
            psi = psi + finer.tangent.solve_transposed(lack, RELAXED).x
        change = -float(np.sum(psi * finer.left))
        found = seen(finer.states) + change
        contributions = self.cells.restrict_sums(dots(psi, finer.residual))
        return ErrorEstimate(value, found, self.factor, contributions, abs(change) + abs(found - rough))


def _displaced(transfer: NodeTransfer, baselines: tuple[np.ndarray, np.ndarray], nodes: np.ndarray) -> np.ndarray:
    """Nodes of the finer member of a grid: its baseline, displaced like the nodes of the grid."""
    return baselines[1] + transfer.prolong(nodes - baselines[0])


@dataclass(frozen=True, eq=False)
class FinerStates:
    """States of a flow on a finer member without a solution."""

    nodes: np.ndarray  # (n_nodes, 3), of the finer member (m)
    # prolonged, states: (n_cells, 5), interpolated from the grid; and, if relaxed, closer to the flow on the finer
    # member
    prolonged: np.ndarray
    # residual, left: (n_cells, 5), residuals of both
    residual: np.ndarray
    states: np.ndarray
    left: np.ndarray
    tangent: FlowTangent | None = None  # derivatives at the prolonged states; none if they are not relaxed
