"""Derivative checks of design variables, such as users' own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ..base.display import OneLine
from ..core.design.variable import Layout, Variable
from ..core.mesh.moving_mesh import MovingMesh
from .derivatives import central_difference

__all__ = ["VariableCheck", "check_variable"]

STEPS = 10.0 ** -np.arange(1, 6)
"""Steps of `check_variable`; the best one counts, as differences are inaccurate at long and at short steps."""

AWAY = 1e-2
"""Perturbation of the baseline in `check_variable`: of points relative to the size of the mesh, of values absolute."""

GOOD = 1e-7
"""Largest relative difference that is attributed to the differences."""


@dataclass(frozen=True)
class VariableCheck(OneLine):
    """How well the derivatives of a variable agree with differences.

    Parameters
    ----------
    points_error, values_error : float
        Largest deviation of the derivatives with respect to the points, and to the values, relative to the largest
        derivative along the same direction. About 1e-10 is round-off.
    points_place, values_place : str
        The point where it is largest.
    """

    points_error: float
    values_error: float
    points_place: str
    values_place: str

    @property
    def is_good(self) -> bool:
        """Whether both are within 1e-7."""
        return max(self.points_error, self.values_error) <= GOOD


def check_variable(variable: Variable, mesh: MovingMesh, n_directions: int = 3, seed: int = 0) -> VariableCheck:
    """Compare the derivatives of a variable, such as a `UserVariable`, with central differences of fourth order.

    Parameters
    ----------
    variable : Variable
        The variable.
    mesh : MovingMesh
        A mesh whose surface it moves.
    n_directions : int
        Random directions, each for the points and for the values.
    seed : int
        Seed of the directions and of the perturbed points and values at which the derivatives are compared.

    Returns
    -------
    VariableCheck

    Raises
    ------
    InputError
        If the variable does not suit the mesh, or does not return what it should.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.design import Local
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.movers import moving_mesh
    >>> from bspline_mdao.testing import check_variable
    >>> mesh = moving_mesh(fit_grid(onera_m6_grid((5, 5, 5))))
    >>> check_variable(Local("heights", direction="y"), mesh).is_good
    True
    """
    layout, random = Layout(mesh, tuple(variable.auxiliary)), np.random.default_rng(seed)
    design_map = variable.bind(layout)
    points = layout.points + AWAY * mesh.size * random.uniform(-1.0, 1.0, layout.points.shape)
    values = design_map.initial + AWAY * random.uniform(-1.0, 1.0, design_map.initial.shape)
    partials = design_map.partials(points, values)
    in_points = mesh.size * random.uniform(-1.0, 1.0, (n_directions, *points.shape))
    in_values = random.uniform(-1.0, 1.0, (n_directions, *values.shape))
    points_error, points_row = _compare(lambda d: design_map.apply(points + d, values), partials.points, in_points)
    values_error, values_row = _compare(lambda d: design_map.apply(points, values + d), partials.values, in_values)
    return VariableCheck(points_error, values_error, _place(layout, points_row), _place(layout, values_row))


def _compare(function: Callable, jacobian: csr_array, directions: np.ndarray) -> tuple[float, int]:
    """Largest relative deviation of a Jacobian along directions, and the row of points where it occurs."""
    worst, row = -1.0, 0
    for direction in directions:
        exact = (jacobian @ direction.ravel()).reshape(-1, 3)
        found = (central_difference(lambda h: function(h * direction), 2.0 * step, 2) for step in STEPS)  # noqa: B023
        off = min((np.abs(exact - difference) for difference in found), key=np.max)
        error = off.max() / max(np.abs(exact).max(), np.finfo(float).tiny)
        if error > worst:
            worst, row = float(error), int(np.argmax(off.max(axis=1)))
    return worst, row


def _place(layout: Layout, row: int) -> str:
    """Name a row for a message."""
    if row < layout.n_surface:
        return layout.mesh.place_of_surface_point(row)
    return f"auxiliary point {row - layout.n_surface + 1}"
