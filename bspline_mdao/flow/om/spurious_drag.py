"""Drag from the errors of the grid: its parts, and a warning if it is optimised.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

import warnings

import numpy as np
import openmdao.api as om

from ...errors import InputError, SpuriousDragWarning
from ...names import GRID
from ..euler.drag_sources import DragSources, wave_drag
from ..euler.flow_grid import FlowGrid
from ..euler.forces import FlowForces
from ..loads.stream import RADIAN
from .derivative_mode import outputs_downstream

__all__ = [
    "drag_sources",
    "induced_and_least",
    "is_optimised",
    "refuse_no_induced_drag",
    "warn_below_the_ellipse",
    "warn_of_spurious_drag",
]

MOST_SPURIOUS = 0.1
"""Fraction of an optimised drag that may be spurious."""

ROUNDED = 5e-4
"""Fraction by which an induced drag may be below the minimum for its lift and wake. For an optimal rectangular wing it
is 5e-5, which the wake's sum leaves out; for a twist that oscillates with the errors of the grid it was 1e-3."""


def drag_sources(
    flow: FlowGrid,
    forces: FlowForces,
    states: np.ndarray,  # (n_cells, 5), A solution
    nodes: np.ndarray,  # (n_nodes, 3), the grid (m)
    alpha: float,  # alpha, mach: angle of attack (rad) and Mach number
    mach: float,
) -> DragSources:
    """Split the pressure drag into the drag of the wake, the drag of shocks, and spurious drag."""
    values = forces.evaluate(states, nodes, alpha, mach)
    total, induced = (float(np.ravel(values[name])[0]) for name in ("CD", "CD_induced"))
    wave = wave_drag(flow.discretization, states, flow.areas(nodes), mach) / forces.wing.coefficients.area
    return DragSources(total, induced, wave)


def refuse_no_induced_drag(component: om.ExplicitComponent, forces: FlowForces) -> None:
    """Refuse the induced drag as an objective or a constraint where there is no wake; sums with it are good."""
    if not forces.wing.induced.has_wake and f"{component.pathname}.CD_induced" in _wanted(component):
        raise InputError(
            "CD_induced is optimised or constrained, and is 0 whatever the shape: walls from one plane of symmetry to "
            "another, as of a section, have no wake; take CD, or CD_entropy"
        )


def is_optimised(component: om.ExplicitComponent, name: str) -> bool:
    """Whether an output of a component is an objective or a constraint of the problem, or one depends on it."""
    model = component._problem_meta["model_ref"]()
    return not _wanted(component).isdisjoint(outputs_downstream(model, {f"{component.pathname}.{name}"}))


def _wanted(component: om.ExplicitComponent) -> set[str]:
    """Outputs that are objectives or constraints of the problem of a component."""
    model = component._problem_meta["model_ref"]()
    return {meta["source"] for meta in model.get_responses(get_sizes=False).values()}


def warn_of_spurious_drag(path: str, sources: DragSources) -> None:
    """Warn if more than a tenth of an optimised drag is due to the grid."""
    part = sources.spurious / sources.total if sources.total else 0.0
    if abs(part) > MOST_SPURIOUS:
        is_none = round(sources.induced, 5) == 0.0  # as for sections
        induced = "" if is_none else f"induced {sources.induced:.5f} + "
        others = "" if is_none else ", or, without shocks, CD_induced or CD_induced + CD_entropy for CD"
        warnings.warn(
            f"{path}: CD is optimised, but {100.0 * part:.0f} % of it is the grid's: CD {sources.total:.5f} = "
            f"{induced}shocks {sources.wave:.5f} + spurious {sources.spurious:.5f}; an optimum would be one of these "
            f"errors. Take a finer member of the grid, model.member(1.5){others}",
            SpuriousDragWarning,
            stacklevel=2,
        )


def induced_and_least(flow: om.Group) -> tuple[float, float]:
    """Induced drag of an `EulerFlow` that has run on one process, and the minimum for its lift on its wake."""
    wing = flow.state.options["forces"].wing
    nodes, alpha = flow.get_val(GRID).reshape(-1, 3), RADIAN * flow.get_val("alpha", units="deg").item()
    lift, induced = (flow.get_val(name).item() for name in ("CL", "CD_induced"))
    area = wing.coefficients.area
    return induced, wing.induced.least(nodes, alpha, lift * area) / area


def warn_below_the_ellipse(path: str, induced: float, least: float) -> None:
    """Warn if the induced drag is less than the best load's for its lift: the grid does not resolve it."""
    if induced < (1.0 - ROUNDED) * least:
        warnings.warn(
            f"{path}: CD_induced is {induced:.6f}, {100.0 * (1.0 - induced / least):.2f} % below the drag of an "
            f"elliptical load, {least:.6f}, which no wing with this wake can have: the grid does not resolve the gain. "
            f"Take fewer or smoother variables, such as three stations of twist, or a finer member of the grid, "
            f"model.member(1.5)",
            SpuriousDragWarning,
            stacklevel=2,
        )
