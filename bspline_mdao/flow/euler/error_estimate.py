"""Errors of lift, drag and other functionals by the adjoint, from a flow and a finer member that it is not solved on.

Theory: ``docs/theory/error_estimates.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...evaluation.family import refined_topology
from ...evaluation.transfer import CellTransfer, NodeTransfer
from ...numerics.vectors import dots
from ...shown import OneLine
from ...topology.topology import Topology
from .flow_grid import FlowGrid
from .forces import FlowForces

__all__ = ["ErrorEstimate", "FinerMember"]


@dataclass(frozen=True, eq=False)
class ErrorEstimate(OneLine):
    """A functional on a grid, and what the adjoint says of it on a finer member of the family.

    Parameters
    ----------
    value : float
        On the grid.
    finer : float
        As estimated for the finer member.
    factor : float
        Cells per direction of the finer member, divided by those of the grid.
    contributions : ndarray, shape (n_cells,)
        What the residuals in the cells of the grid contribute to the difference of both.
    remaining : float
        Size of the terms that the estimate leaves out, a measure of its own error: what the residuals contribute with
        the adjoint's difference between quadratic and linear prolongation, without signs.
    """

    value: float
    finer: float
    factor: float
    contributions: np.ndarray
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
    """A finer member of the family of a flow's grid, to look at residuals on.

    Parameters
    ----------
    flow : FlowGrid
        Of the finer member.
    forces : FlowForces
        On it.
    nodes : NodeTransfer
        Of nodes to the finer member.
    cells, linear : CellTransfer
        Of cells, and one of an order less.
    factor : float
        Cells per direction, relative to those of the grid.
    """

    flow: FlowGrid
    forces: FlowForces
    nodes: NodeTransfer
    cells: CellTransfer
    linear: CellTransfer
    factor: float

    @classmethod
    def of(
        cls, flow: FlowGrid, forces: FlowForces, topology: Topology, nodes: np.ndarray, axes: str, factor: float
    ) -> FinerMember:
        """Refine the grid of a flow.

        Parameters
        ----------
        flow : FlowGrid
            Of the grid.
        forces : FlowForces
            On it.
        topology : Topology
            Connections of its blocks.
        nodes : ndarray, shape (n_nodes, 3)
            Its nodes (m).
        axes : str
            See `FlowGrid.of`.
        factor : float
            Cells per direction of the finer member, relative to those of the grid; above 1.
        """
        finer = refined_topology(topology, factor)
        to_nodes, scheme = NodeTransfer.of(topology, finer), flow.discretization
        fine_flow = FlowGrid.of(
            finer,
            to_nodes.prolong(nodes),
            axes,
            dissipation=scheme.dissipation,
            shock_threshold=scheme.shock_threshold,
        )
        wing = forces.wing.coefficients
        references = wing.area, wing.chord, wing.reference
        fine_forces = FlowForces.of(fine_flow, to_nodes.prolong(nodes), *references)
        cells, linear = (CellTransfer.of(topology, finer, order) for order in (3, 2))
        return cls(fine_flow, fine_forces, to_nodes, cells, linear, factor)

    def estimate(
        self, value: float, name: str, psi: np.ndarray, states: np.ndarray, nodes: np.ndarray, stream, alpha, mach
    ) -> ErrorEstimate:
        """Estimate a functional on the finer member after Venditti and Darmofal.

        With the states w and the adjoint psi of the grid, both prolonged, the functional J and the residual R of the
        finer member, it is ``J(w) - psi^T R(w)``.

        Parameters
        ----------
        value : float
            On the grid.
        name : str
            Of the output of `FlowForces`, a single number.
        psi : ndarray, shape (n_cells, 5)
            Its adjoint on the grid.
        states, nodes, stream, alpha, mach
            Of the grid, see `FlowForces.evaluate`; the free stream, shape (5,).

        References
        ----------
        D. A. Venditti, D. L. Darmofal, "Grid adaptation for functional outputs: application to two-dimensional inviscid
        flows", J. Comput. Phys. 176 (2002), 40-69.
        """
        w, x = self.cells.prolong(states), self.nodes.prolong(nodes)
        residual = self.flow.at(x).residual(w, self.flow.areas(x), stream)
        change = -dots(self.cells.prolong(psi), residual)
        left_out = dots(self.cells.prolong(psi) - self.linear.prolong(psi), residual)
        seen = self.forces.evaluate(w, x, alpha, mach)[name]
        finer = float(np.ravel(seen)[0]) + float(np.sum(change))
        contributions = self.cells.restrict_sums(-change)
        return ErrorEstimate(value, finer, self.factor, contributions, float(np.sum(np.abs(left_out))))
