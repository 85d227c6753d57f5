"""The result of adapting a grid to a flow.

Theory: ``docs/theory/adaptation.rst``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...base.display import OneLine
from ...core.design.interior_points import InteriorShift
from ...core.model.fitted_model import FittedModel
from ...grids.topology.grid import Grid
from ..euler.error_estimate import ErrorEstimate

__all__ = ["Adaptation"]


@dataclass(frozen=True, eq=False)
class Adaptation(OneLine):
    """A grid adapted to a flow, with the errors before and after.

    Parameters
    ----------
    baseline : FittedModel
        The given fitted grid.
    shift : InteriorShift
        The variables.
    values : ndarray, shape (n_values,)
        Their values.
    limits : dict of str to float
        The assumed value of each coefficient on infinitely fine grids.
    before, after : dict of str to ErrorEstimate
        Values and estimates of each coefficient on the given grid, and on the adapted one.
    flows : int
        Number of flows that were solved on the grid.
    seconds : float
        Wall-clock time.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.adaptation import adapt_grid
    >>> from bspline_mdao.generators import FarField, infinite_wing_grid, naca_section
    >>> model = fit_grid(infinite_wing_grid(naca_section(0.12), (17, 9), far_field=FarField(5.0)))
    >>> found = adapt_grid(model, mach=0.5, alpha=1.0, reference_area=1.0, limits={"CD": 0.0}, rounds=1, iterations=2)
    >>> found.ratio("CD") < 1.0
    True
    """

    baseline: FittedModel
    shift: InteriorShift
    values: np.ndarray
    limits: Mapping[str, float]
    before: Mapping[str, ErrorEstimate]
    after: Mapping[str, ErrorEstimate]
    flows: int
    seconds: float

    @property
    def is_better(self) -> bool:
        """Whether a better grid was found; if not, the grid is the given one."""
        return bool(self.values.any())

    @property
    def control_points(self) -> np.ndarray:
        """Control points of the adapted grid (m), shape (n_control_points, 3)."""
        return self.shift.apply(self.baseline.control_points, self.values)

    @cached_property
    def model(self) -> FittedModel:
        """Model of the adapted grid, for further work: the same parameters of the nodes, its own control points."""
        return replace(self.baseline, control_points=self.control_points)

    @property
    def grid(self) -> Grid:
        """The adapted grid."""
        return self.model.regenerate()

    def ratio(self, name: str) -> float:
        """Distance of a coefficient from its limit on the adapted grid, relative to the given one."""
        limit = self.limits[name]
        return abs(self.after[name].value - limit) / abs(self.before[name].value - limit)
