"""Drag that is the grid's: what it is made of, and a warning where it is optimised.

Theory: ``docs/theory/far_field.rst``.
"""

from __future__ import annotations

import warnings

import numpy as np
import openmdao.api as om

from ...errors import SpuriousDragWarning
from ...names import GRID
from ..euler.drag_sources import DragSources, wave_drag
from ..euler.flow_grid import FlowGrid
from ..euler.forces import FlowForces
from ..loads.stream import RADIAN
from .derivative_mode import outputs_downstream

__all__ = ["drag_sources", "induced_and_least", "is_optimised", "warn_below_the_ellipse", "warn_of_spurious_drag"]

MOST_SPURIOUS = 0.1
"""Part of the drag that may be spurious where it is optimised."""

ROUNDED = 5e-4
"""Part by which an induced drag may be below the least of its lift and wake. An optimal rectangular wing is by 5e-5,
what the wake's sum leaves out; a twist that oscillates with the errors of the grid was by 1e-3."""


def drag_sources(
    flow: FlowGrid,
    forces: FlowForces,
    states: np.ndarray,  # (n_cells, 5), A solution
    nodes: np.ndarray,  # (n_nodes, 3), the grid (m)
    alpha: float,  # alpha, mach: angle of attack (rad) and Mach number
    mach: float,
) -> DragSources:
    """Divide the drag of the pressures into that of the wake, of shocks, and what is spurious."""
    values = forces.evaluate(states, nodes, alpha, mach)
    total, induced = (float(np.ravel(values[name])[0]) for name in ("CD", "CD_induced"))
    wave = wave_drag(flow.discretization, states, flow.areas(nodes), mach) / forces.wing.coefficients.area
    return DragSources(total, induced, wave)


def is_optimised(component: om.ExplicitComponent, name: str) -> bool:
    """Whether an output of a component is an objective or a constraint of the problem, or one depends on it."""
    model = component._problem_meta["model_ref"]()
    wanted = {meta["source"] for meta in model.get_responses(get_sizes=False).values()}
    return not wanted.isdisjoint(outputs_downstream(model, {f"{component.pathname}.{name}"}))


def warn_of_spurious_drag(path: str, sources: DragSources) -> None:
    """Warn where more than a tenth of a drag that is optimised is of the grid."""
    part = sources.spurious / sources.total if sources.total else 0.0
    if abs(part) > MOST_SPURIOUS:
        is_none = round(sources.induced, 5) == 0.0  # as of sections
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
    """Induced drag of an `EulerFlow` that has run on one process, and the least of any load of its lift on its wake."""
    wing = flow.state.options["forces"].wing
    nodes, alpha = flow.get_val(GRID).reshape(-1, 3), RADIAN * flow.get_val("alpha", units="deg").item()
    lift, induced = (flow.get_val(name).item() for name in ("CL", "CD_induced"))
    area = wing.coefficients.area
    return induced, wing.induced.least(nodes, alpha, lift * area) / area


def warn_below_the_ellipse(path: str, induced: float, least: float) -> None:
    """Warn where the induced drag is less than that of the best load for its lift: the grid does not resolve it."""
    if induced < (1.0 - ROUNDED) * least:
        warnings.warn(
            f"{path}: CD_induced is {induced:.6f}, {100.0 * (1.0 - induced / least):.2f} % below that of an elliptical "
            f"load, {least:.6f}, which no wing with this wake can have: the grid does not resolve what was gained. "
            f"Take fewer or smoother variables, such as three stations of twist, or a finer member of the grid, "
            f"model.member(1.5)",
            SpuriousDragWarning,
            stacklevel=2,
        )
