"""Search for values of interior control points at which lift and drag agree with finer grids.

    x = x_0 + A E v,    loss = sum_J nu ((J - J_limit) / (J_0 - J_limit))^2 + bound / bound_0  + price of flat corners

Rounds of L-BFGS reduce the loss with the adjoints of their initial grids. Each evaluation solves the flow, and one
adjoint system for the gradient, which is exact while those adjoints are frozen. The variables are steps in which
control points move together, see `bspline_mdao.core.adaptation.stiffness`.

Theory: ``docs/theory/adaptation.rst``.

References
----------
J. Nocedal, Updating quasi-Newton matrices with limited storage, *Mathematics of Computation* 35(151), 1980.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import openmdao.api as om
from scipy.optimize import minimize

from ...core.adaptation.loss import price, price_slope
from ...core.adaptation.stiffness import StiffValues
from ...core.design.interior_points import InteriorShift
from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ...grids.cells.grid_quality import GridQuality, GridValues
from ...names import GRID
from ..euler.error_estimate import ErrorEstimate
from ..euler.estimate_loss import EstimateLoss, WeightedAdjoint
from ..euler.gas import N_STATES, free_stream
from ..loads.stream import RADIAN
from .error_estimate import ADJOINT_TOLERANCE, finer_member
from .euler_flow import EulerFlow

__all__ = ["ErrorSearch", "flow_problem", "limits_of"]

CORNER = "corner_ks"
"""The smooth bound of the corners of all cells, which is kept in part."""

PARTS = (1.0, 0.5, 0.25, 0.125)
"""Fractions of a round's step to try: with a smaller one the adjoints change less."""


@dataclass(frozen=True)
class SearchSettings:
    """Weights of the loss, and tolerances of flows and adjoints."""

    factor: float = 2.0
    """Cells per direction of the finer member, relative to the grid."""

    width: float = 0.1
    """Contributions below this fraction of their mean count by their squares."""

    corner_sharpness: float = 300.0
    """Sharpness rho of the smooth bound of corners."""

    corner_part: float = 0.25
    """Fraction of the bound that is kept."""

    failed: float = 1e3
    """Loss of a grid whose flow cannot be solved: it makes the optimiser take smaller steps."""

    distance: float = 2.0
    """Weight nu of the squared distance from the limit, relative to a bound."""

    gradient_tolerance: float = 1e-5
    """Residual of the adjoint systems of gradients."""

    closest: float = 1e-12
    """Smallest distance from the limit by which errors are scaled."""


SEARCH = SearchSettings()


class ErrorSearch:
    """The current grid: the last accepted values, and their references."""

    def __init__(
        self,
        model: FittedModel,
        shift: InteriorShift,
        limits: Mapping[str, float],
        mach: float,
        alpha: float,
        options: Mapping,
    ):
        self.model, self.shift, self.limits = model, shift, dict(limits)
        self.mach, self.alpha, self.options = mach, RADIAN * alpha, options
        self.evaluator, grid = model.evaluator(), model.regenerate()
        self.nodes = grid.to_vector().reshape(-1, 3)
        self.quality = GridQuality.of_baseline(grid, rho=SEARCH.corner_sharpness)
        bound = self.quality.evaluate(self.nodes, (CORNER,)).aggregates[CORNER]
        self.least_corner = bound - (1.0 - SEARCH.corner_part) * abs(bound)
        self.flows, self.stiff = 0, StiffValues.of(model, shift)
        self.values = shift.initial
        self.before: dict[str, ErrorEstimate] = {}
        self.before = self.after = self.look(self.values)

    def pose(self, values: np.ndarray) -> None:
        """Set up the flow on the grid of some values, which determines the faces with weights of their own."""
        model = replace(self.model, control_points=self.shift.apply(self.model.control_points, values))
        self.problem = flow_problem(model, self.mach, self.alpha / RADIAN, self.options)
        self.problem.final_setup()
        self.flow, self.forces = (self.problem.model.state.options[name] for name in ("flow", "forces"))
        self.stream = free_stream(self.mach, self.alpha, self.flow.axes)
        axes = self.problem.model.options["axes"]
        self.member = finer_member(self.model, self.flow, self.forces, self.nodes_at(values), axes, SEARCH.factor)

    def nodes_at(self, values: np.ndarray) -> np.ndarray:
        """Nodes of the grid (m): nodes that no control point moves are bitwise unchanged."""
        return self.nodes + self.evaluator.forward(self.shift.displacement(values))

    def run_round(self, iterations: int) -> bool:
        """Take the step of L-BFGS, or a fraction of it, if it is better with its own adjoints; return whether it is."""
        stiff = self.stiff.at(self.values)

        def loss(steps: np.ndarray) -> tuple[float, np.ndarray]:
            values = stiff.values(steps)
            value, bar = self.loss(values)
            return value, stiff.vjp(values, bar)

        settings = {"maxiter": iterations, "maxfun": 2 * iterations, "maxcor": 30}
        found = minimize(loss, np.zeros(self.shift.n_values), jac=True, method="L-BFGS-B", options=settings)
        for part in PARTS:
            values = stiff.values(part * found.x)
            try:
                seen = self.look(values)
            except (om.AnalysisError, InputError):  # a finer member with cells of negative volume is refused
                continue
            if self.score(seen) < self.score(self.after):
                self.values, self.after = values, seen
                return True
        return False

    def score(self, estimates: Mapping[str, ErrorEstimate]) -> float:
        """Measure for comparing grids: the loss without the price of corners."""
        ratios = (self.distance(estimate.value, name) ** 2 for name, estimate in estimates.items())
        return SEARCH.distance * sum(ratios) + sum(e.bound / self.before[name].bound for name, e in estimates.items())

    def distance(self, value: float, name: str) -> float:
        """Distance of a coefficient from its limit, relative to the given grid."""
        return (value - self.limits[name]) / self.scale(name)

    def scale(self, name: str) -> float:
        """Distance from the limit on the given grid."""
        return max(abs(self.before[name].value - self.limits[name]), SEARCH.closest)

    def solve(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Nodes and states of the flow."""
        nodes = self.nodes_at(values)
        self.problem.set_val(GRID, nodes.ravel())
        self.flows += 1
        self.problem.run_model()
        return nodes, self.problem.get_val("states").reshape(-1, N_STATES).copy()

    def look(self, values: np.ndarray) -> dict[str, ErrorEstimate]:
        """Set up the flow again, estimate the errors of all coefficients, and keep the loss with their adjoints."""
        self.pose(values)
        nodes, states = self.solve(values)
        try:
            self.member.flow.require_volumes(self.member.nodes_at(nodes))
        except InputError as error:
            raise InputError(f"adapt: on the finer member of the grid {error}; give a grid of more cells") from None
        estimates, adjoints, finer = {}, [], self.member.prolonged(states, nodes, self.stream)
        for name in self.limits:
            bar = self.forces.vjp(states, nodes, self.alpha, self.mach, {name: np.ones(1)})[0]
            psi = self.problem.model.state.adjoint(bar, ADJOINT_TOLERANCE)
            value = self.problem.get_val(name).item()
            estimates[name] = self.member.estimate(value, name, psi, finer, self.alpha, self.mach)
            bound = (self.before or estimates)[name].bound
            adjoints.append(WeightedAdjoint(psi, bound, SEARCH.width * bound / len(states)))
        self.estimate_loss = EstimateLoss(self.member, adjoints, self.stream)
        return estimates

    def loss(self, values: np.ndarray) -> tuple[float, np.ndarray]:
        """Loss of a grid, and its derivative with respect to the values."""
        nodes = self.nodes_at(values)
        found = self.quality.evaluate(nodes, (CORNER,))
        gain = found.aggregates[CORNER] - self.least_corner
        loss, nodes_bar = price(gain), self.quality.vjp(nodes, found, GridValues({CORNER: price_slope(gain)}))
        try:
            error, error_bar = self.error_loss(values)
        except om.AnalysisError:
            error, error_bar = SEARCH.failed, np.zeros_like(nodes_bar)
        return loss + error, self.shift.vjp(self.evaluator.adjoint(nodes_bar + error_bar))

    def error_loss(self, values: np.ndarray) -> tuple[float, np.ndarray]:
        """Loss without the price of corners, and its derivative with respect to the nodes, including the flow."""
        nodes, states = self.solve(values)
        loss, states_bar, nodes_bar = self.estimate_loss.gradient(states, nodes)
        bars = {}
        for name in self.limits:
            off = self.distance(self.problem.get_val(name).item(), name)
            loss += SEARCH.distance * off**2
            bars[name] = np.array([2.0 * SEARCH.distance * off / self.scale(name)])
        from_states, from_nodes, _, _ = self.forces.vjp(states, nodes, self.alpha, self.mach, bars)
        adjoint = self.problem.model.state.adjoint(states_bar + from_states, SEARCH.gradient_tolerance)
        tangent = self.flow.at(nodes).linearize(states, self.flow.areas(nodes), self.stream)
        return loss, nodes_bar + from_nodes - self.flow.nodes_vjp(nodes, tangent, adjoint)


def flow_problem(model: FittedModel, mach: float, alpha: float, options: Mapping) -> om.Problem:
    """Set up a flow at a Mach number and an angle of attack (deg)."""
    problem = om.Problem(EulerFlow(model=model, **{"iprint": 0, **options}), reports=None)
    problem.setup(mode="rev")
    problem.set_val("Mach_number", mach)
    problem.set_val("alpha", alpha, units="deg")
    return problem


def limits_of(
    model: FittedModel, names: Sequence[str], mach: float, alpha: float, options: Mapping
) -> dict[str, float]:
    """Limits extrapolated to second order from the flows on a grid and on its finer member."""
    values = []
    for member in (model, model.member(SEARCH.factor)):
        problem = flow_problem(member, mach, alpha, options)
        problem.run_model()
        values.append([problem.get_val(name).item() for name in names])
    return {name: fine - (coarse - fine) / (SEARCH.factor**2 - 1.0) for name, coarse, fine in zip(names, *values)}
