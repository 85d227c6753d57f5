"""Errors of the coefficients of a solved flow, by its adjoint and a finer member of its grid.

Theory: ``docs/theory/error_estimates.rst``.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import openmdao.api as om

from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ...names import GRID
from ..euler.error_estimate import ErrorEstimate, FinerMember
from ..euler.flow_grid import FlowGrid
from ..euler.forces import FlowForces
from ..euler.gas import N_STATES, free_stream
from ..functionals import numbers
from ..loads.stream import RADIAN
from .euler_flow import EulerFlow

__all__ = ["error_estimate"]

ADJOINT_TOLERANCE = 1e-6
"""Residual of the adjoints: their relative error is the relative error of the estimate."""


def error_estimate(
    problem: om.Problem, of: Iterable[str] = ("CL", "CD"), factor: float = 2.0, flow: EulerFlow | None = None
) -> dict[str, ErrorEstimate]:
    """Estimate the errors of coefficients from the adjoint and the residual on a finer member of the grid's family.

    The flow on the finer member is not solved. The cost is an adjoint for each coefficient and, on the finer member,
    the faces, one Jacobian and its factor, and some products for the states and for each adjoint: a third to a half of
    the time of a flow there, and its memory. The angle of attack is kept, in trimmed flow as well.

    Parameters
    ----------
    problem : openmdao.api.Problem
        A problem that has been run, with an `EulerFlow`.
    of : iterable of str
        Scalar outputs of `EulerFlow`, such as ``CD``, except the moments of hinges.
    factor : float
        Cells per direction of the finer member, relative to the grid; more than 1.
    flow : EulerFlow, optional
        The flow to use, if there are several.

    Returns
    -------
    dict
        An `ErrorEstimate` for each coefficient: its ``value``, the value on the ``finer`` member, the ``error``, the
        ``limit`` at second order, and ``contributions`` of all cells.

    Raises
    ------
    InputError
        If there is no flow or more than one, a coefficient is unknown, the factor is not above 1, the flow is on
        several processes, or the finer member has cells of negative volume.
    om.AnalysisError
        If the flow has not been solved, or an adjoint cannot be solved.

    Examples
    --------
    >>> import openmdao.api as om
    >>> from bspline_mdao import EulerFlow, fit_grid
    >>> from bspline_mdao.adaptation import error_estimate
    >>> from bspline_mdao.generators import FarField, infinite_wing_grid, naca_section
    >>> model = fit_grid(infinite_wing_grid(naca_section(0.12), (17, 9), far_field=FarField(5.0)))
    >>> problem = om.Problem(EulerFlow(model=model, reference_area=1.0, iprint=0), reports=None)
    >>> _ = problem.setup()
    >>> problem.set_val("alpha", 2.0, units="deg")
    >>> problem.set_val("Mach_number", 0.5)
    >>> problem.run_model()
    >>> estimate = error_estimate(problem, of=["CD"])["CD"]
    >>> estimate.contributions.size, 0.0 < estimate.finer < estimate.value
    (768, True)
    """
    flow, names = flow or _only_flow(problem), list(of)
    unknown = [name for name in names if name not in numbers("euler")]
    if unknown:
        raise InputError(f"error estimate of {', '.join(unknown)}; give any of {', '.join(numbers('euler'))}")
    if not factor > 1.0:
        raise InputError(f"error estimate with a member of factor {factor!r}; give a number above 1, such as 2")
    if flow.comm.size > 1:
        raise InputError("error estimate on several processes; run it on one, from the states of a restart file")
    grid, forces = flow.state.options["flow"], flow.state.options["forces"]
    states, nodes = flow.get_val("states").reshape(-1, N_STATES), flow.get_val(GRID).reshape(-1, 3)
    alpha, mach = RADIAN * flow.get_val("alpha", units="deg").item(), flow.get_val("Mach_number").item()
    stream = free_stream(mach, alpha, grid.axes)
    values = forces.evaluate(states, nodes, alpha, mach)
    member = finer_member(flow.options["model"], grid, forces, nodes, flow.options["axes"], factor)
    member.flow.require_volumes(member.nodes_at(nodes))
    bars = [forces.vjp(states, nodes, alpha, mach, {name: np.ones(1)})[0] for name in names]
    adjoints = [flow.state.adjoint(bar, ADJOINT_TOLERANCE) for bar in bars]
    finer = member.relaxed(states, nodes, stream)
    return {
        name: member.estimate(float(np.ravel(values[name])[0]), name, psi, finer, alpha, mach)
        for name, psi in zip(names, adjoints)
    }


def finer_member(
    model: FittedModel, flow: FlowGrid, forces: FlowForces, nodes: np.ndarray, axes: str, factor: float
) -> FinerMember:
    """Finer member of the grid of a flow: from the model, ``model.member(factor)``, displaced like the nodes."""
    baseline, finer = (each.regenerate().to_vector().reshape(-1, 3) for each in (model, model.member(factor)))
    return FinerMember.of(flow, forces, model.topology, nodes, axes, factor, (baseline, finer))


def _only_flow(problem: om.Problem) -> EulerFlow:
    """The only flow of a problem."""
    flows = list(problem.model.system_iter(include_self=True, recurse=True, typ=EulerFlow))
    if len(flows) != 1:
        found = ", ".join(flow.pathname for flow in flows) or "none"
        raise InputError(f"error estimate: a problem with one EulerFlow is wanted, it has {found}; give it as flow=...")
    return flows[0]
