"""Errors of lift, drag and other functionals by the adjoint, from a flow and a finer member that it is not solved on.

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
"""Part that states and adjoints on the finer member leave of what their equations lack there after prolongation."""


@dataclass(frozen=True, eq=False)
class ErrorEstimate(OneLine):
    """A functional on a grid, and what the adjoint says of it on a finer member of the family."""

    value: float  # on the grid
    finer: float  # as estimated for the finer member
    factor: float  # cells per direction of the finer member, divided by those of the grid
    # (n_cells,), what the residuals in the cells of the grid contribute to the difference of both
    contributions: np.ndarray
    # A measure of the estimate's own error: what the adjoint changes of the value that is seen on the finer member, and
    # what is changed by bringing states and adjoint nearer to those of the finer member, both without signs
    remaining: float

    @property
    def error(self) -> float:
        """What the value on the grid has too much, compared with the finer member."""
        return self.value - self.finer

    @property
    def limit(self) -> float:
        """Value on infinitely fine members where the order is two, as it is for smooth flow."""
        return self.value - self.error / (1.0 - self.factor**-2.0)

    @property
    def bound(self) -> float:
        """Sum of the contributions without their signs: the error if none of them cancelled."""
        return float(np.sum(np.abs(self.contributions)))


@dataclass(frozen=True, eq=False)
class FinerMember:
    """A finer member of the family of a flow's grid, to look at residuals on."""

    flow: FlowGrid  # of the finer member
    forces: FlowForces  # on it
    nodes: NodeTransfer  # of nodes to the finer member
    cells: CellTransfer  # of cells
    factor: float  # cells per direction, relative to those of the grid
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
        factor: float,  # cells per direction of the finer member, relative to those of the grid; above 1
        # tuple of two ndarray, each of shape (n, 3), nodes of the baseline (m), and of the member of that;
        # displacements from them are interpolated
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
        """Nodes of the finer member (m), for those of the grid, shape (n_nodes, 3); real or complex."""
        return _displaced(self.nodes, self.baselines, nodes)

    def prolonged(self, states: np.ndarray, nodes: np.ndarray, stream: np.ndarray) -> FinerStates:
        """Prolong the states of a flow, shape (n_cells, 5), on nodes, shape (n_nodes, 3), in a stream, shape (5,)."""
        x, w = self.nodes_at(nodes), self.cells.prolong(states)
        residual = self.flow.at(x).residual(w, self.flow.areas(x), stream)
        return FinerStates(x, w, residual, w, residual)

    def relaxed(self, states: np.ndarray, nodes: np.ndarray, stream: np.ndarray) -> FinerStates:
        """Prolong the states, and take an inexact step of Newton's method on the finer member, as long as is safe."""
        # What the prolonged states are wrong by next to walls and edges is short, and large enough there for terms of
        # second order; the step takes most of it away.
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
        name: str,  # of the output of `FlowForces`, a single number
        # (n_cells, 5), its adjoint on the grid. It is prolonged, and with relaxed states relaxed as well.
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
    """Nodes of the finer member of a grid: those of its baseline, displaced as the nodes of the grid are."""
    return baselines[1] + transfer.prolong(nodes - baselines[0])


@dataclass(frozen=True, eq=False)
class FinerStates:
    """States of a flow on a finer member that it is not solved on."""

    nodes: np.ndarray  # (n_nodes, 3), of the finer member (m)
    # prolonged, states: (n_cells, 5), interpolated from the grid; and nearer to the flow on the finer member, where
    # they are relaxed
    prolonged: np.ndarray
    # residual, left: (n_cells, 5), residuals of both
    residual: np.ndarray
    states: np.ndarray
    left: np.ndarray
    tangent: FlowTangent | None = None  # derivatives at the prolonged states; none where they are not relaxed
