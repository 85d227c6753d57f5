"""Adapt a grid to a flow: interior control points move until lift or drag agree with finer grids.

Theory: ``docs/theory/adaptation.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ...base.numerics.stopwatch import working_seconds
from ...core.design.interior_points import InteriorPoints
from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ..functionals import numbers
from .adaptation import Adaptation
from .error_search import ErrorSearch, limits_of

__all__ = ["adapt_grid"]

ROUNDS, ITERATIONS = 4, 8
"""Default number of rounds, each with its own adjoints, and iterations of the optimiser in each."""


def adapt_grid(
    model: FittedModel,
    of: str | Iterable[str] = "CD",
    *,
    mach: float,
    alpha: float,
    limits: Mapping[str, float] | None = None,
    reach: float = 0.4,
    sliding: str | Sequence[str] = (),
    rounds: int = ROUNDS,
    iterations: int = ITERATIONS,
    progress: Callable[[float, str], None] | None = None,
    **flow: Any,
) -> Adaptation:
    """Move interior control points to reduce the adjoint's estimate of the error of lift or drag.

    Nodes of walls, of the far field and of undeclared faces stay bitwise the same, nodes of symmetry planes slide in
    them, and the number of nodes does not change.

    Parameters
    ----------
    model : FittedModel
        The fitted grid. Its residual is kept unchanged.
    of : str or iterable of str
        Scalar outputs of `EulerFlow`, such as ``CD``, except the moments of hinges.
    mach, alpha : float
        Mach number and angle of attack (deg) of the flow.
    limits : dict of str to float, optional
        The coefficients on infinitely fine grids, if known. By default they are extrapolated to second order from the
        flows on the grid and on the member with twice the cells in each direction.
    reach : float
        How far control points may move, relative to the distance to their nearest neighbours; below 0.5.
    sliding : str or sequence of str
        Planar patches whose nodes slide in their planes, in addition to symmetry planes.
    rounds, iterations : int
        Number of rounds, each with the adjoints of its initial grid, and largest number of iterations in each.
    progress : callable, optional
        Called with the fraction done and the current task.
    **flow
        Options of `EulerFlow`: the ``reference_area``, which has no default, ``axes`` and so on.

    Returns
    -------
    Adaptation
        With the given grid if no better one was found.

    Raises
    ------
    InputError
        If an option cannot be used, no control point may move, or the kinds of the boundary are unknown.
    om.AnalysisError
        If the flow on the given grid or on the finer one cannot be solved.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.adaptation import adapt_grid
    >>> from bspline_mdao.generators import FarField, infinite_wing_grid, naca_section
    >>> model = fit_grid(infinite_wing_grid(naca_section(0.12), (17, 9), far_field=FarField(5.0)))
    >>> found = adapt_grid(model, mach=0.5, alpha=1.0, reference_area=1.0, limits={"CD": 0.0}, rounds=1, iterations=2)
    >>> 0.0 < found.after["CD"].value < found.before["CD"].value
    True
    """
    names = [of] if isinstance(of, str) else list(of)
    _check(names, limits, rounds, iterations, flow)
    started = working_seconds()
    shift = InteriorPoints("interior", reach=reach, sliding=sliding).bind(model)
    report = progress or (lambda done, what: None)
    if limits is None:
        report(0.0, "flow on the finer member")
        limits = limits_of(model, names, mach, alpha, flow)
    search = ErrorSearch(model, shift, {name: float(limits[name]) for name in names}, mach, alpha, flow)
    for number in range(rounds):
        report((number + 1) / (rounds + 1), f"round {number + 1} of {rounds}")
        if not search.run_round(iterations):
            break
    return Adaptation(
        baseline=model,
        shift=shift,
        values=search.values,
        limits=search.limits,
        before=search.before,
        after=search.after,
        flows=search.flows,
        seconds=working_seconds() - started,
    )


def _check(names: list[str], limits: Mapping[str, float] | None, rounds: int, iterations: int, flow: dict) -> None:
    """Refuse options that cannot be used."""
    unknown = [name for name in names if name not in numbers("euler")]
    if unknown or not names:
        raise InputError(f"adapt to {', '.join(unknown) or 'nothing'}; give any of {', '.join(numbers('euler'))}")
    if limits is not None:
        for name in names:
            if name not in limits or not np.isfinite(limits[name]):
                raise InputError(f"adapt: limits has no number for {name}; give one, or leave limits out")
    for what, number in (("rounds", rounds), ("iterations", iterations)):
        if number < 1:
            raise InputError(f"adapt: {what} is {number}; give 1 or more")
    if flow.get("reference_area") is None:
        raise InputError("adapt: there is no reference_area; give the area of the modelled part, such as 1.0")
    if flow.get("trim"):
        raise InputError("adapt: the angle of attack is kept; leave trim out and give alpha of the trimmed flow")
