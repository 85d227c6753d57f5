"""Combinations of a design variable's values along which a response changes evenly, as scaling for optimizers.

Optimizers take steepest steps in the given variables, and learn curvatures one by one. Control point heights change
pressures more the shorter the wavelength they form together, by factors of 10 to 1000. Along the combinations of this
module all changes have the same size.

Theory: ``docs/theory/drivers.rst``, "Scaling of shapes".
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable

import numpy as np
import openmdao.api as om

from ....errors import DerivativeModeWarning, InputError
from ....grids.cells.cell_faces import CellFaces
from ....grids.cells.quads import area_vectors
from ....names import GRID
from ...model.fitted_model import FittedModel

__all__ = ["combine", "even_combinations", "even_pressures"]


def even_combinations(derivative: np.ndarray, least: float = 0.02) -> np.ndarray:
    """Find combinations of values that each change a response by one, along orthogonal vectors.

    Parameters
    ----------
    derivative : ndarray, shape (n_responses, n_values)
        Derivative of the response, such as pressures times the square roots of the areas they act on. It takes one
        forward product of the model per value.
    least : float
        Singular values below this fraction of the largest are raised to it, so combinations that hardly change the
        response stay bounded.

    Returns
    -------
    ndarray, shape (n_values, n_combinations)
        Values of the variable in the columns, for a unit of every combination.

    Raises
    ------
    InputError
        If the derivative is not a finite matrix, or is zero.

    Examples
    --------
    >>> import numpy as np
    >>> combinations = even_combinations(np.array([[3.0, 0.0], [0.0, 0.5], [4.0, 0.0]]))
    >>> np.abs(combinations).round(3).tolist()
    [[0.2, 0.0], [0.0, 2.0]]
    """
    derivative = np.asarray(derivative, dtype=float)
    if derivative.ndim != 2 or not np.isfinite(derivative).all() or not derivative.any():
        raise InputError(
            f"even combinations: a derivative of shape {derivative.shape}; give a finite matrix that is not zero"
        )
    _, values, vectors = np.linalg.svd(derivative, full_matrices=False)
    return vectors.T / np.maximum(values, least * values[0])


def even_pressures(
    problem: om.Problem,
    model: FittedModel,
    variable: str,
    pressures: Iterable[str] = ("Cp",),
    grid: str = GRID,
    linear_tolerance: float | None = None,
) -> np.ndarray:
    """Find combinations of a variable along which wall pressures change evenly, averaged over the walls.

    Parameters
    ----------
    problem : openmdao.api.Problem
        Chain from the variable, an input, to one or more flows. It is set up in forward mode and run.
    model : FittedModel
        The fitted grid of the flows.
    variable : str
        Name of the variable.
    pressures : iterable of str
        Names of the pressure coefficient outputs, as from `EulerFlow`; all have the same weight.
    grid : str
        Name of the grid that the flows are solved on.
    linear_tolerance : float, optional
        Tolerance of the flows' linear systems, by default their own; 1e-6 takes half the products.

    Returns
    -------
    ndarray, shape (n_values, n_combinations)
        As from `even_combinations`: a unit of each changes the root mean square of the pressure coefficients by one.

    Raises
    ------
    InputError
        If the pressures do not depend on the variable.

    Examples
    --------
    >>> from bspline_mdao import DesignSurface, EulerFlow, fit_grid
    >>> from bspline_mdao.design import Twist
    >>> from bspline_mdao.drivers import even_pressures
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> wing = DesignSurface.of(fit_grid(onera_m6_grid((5, 5, 5))))
    >>> problem = om.Problem(reports=None)
    >>> shape = wing.grid_movement([Twist("twist", wing.axis, stations=2)])
    >>> _ = problem.model.add_subsystem("shape", shape, promotes=["*"])
    >>> flow = EulerFlow(model=wing.model, reference_area=wing.planform_area, iprint=-1)
    >>> _ = problem.model.add_subsystem("flow", flow, promotes=["*"])
    >>> even_pressures(problem, wing.model, "twist").shape
    (2, 2)
    """
    problem.setup(mode="fwd")
    for component in problem.model.system_iter(recurse=True, typ=om.ImplicitComponent):
        if linear_tolerance is not None and "linear_tolerance" in component.options:
            component.options["linear_tolerance"] = linear_tolerance
    names = list(pressures)
    with warnings.catch_warnings():  # one linear solve per value is intended here
        for category in (DerivativeModeWarning, om.DerivativesWarning):
            warnings.simplefilter("ignore", category)
        problem.run_model()
        totals = problem.compute_totals(names, [variable])
    nodes = problem.get_val(grid).reshape(-1, 3)
    walls = CellFaces.of(model.topology, nodes).corners_of("wall")
    areas = np.linalg.norm(area_vectors(nodes[walls]), axis=1)
    weights = np.sqrt(areas / (len(names) * areas.sum()))[:, None]
    return even_combinations(np.vstack([weights * totals[name, variable] for name in names]))


def combine(name: str, combinations: np.ndarray, units: str | None = None) -> om.ExecComp:
    """Make a component that computes a variable from its input ``combinations``, zero at first.

    Parameters
    ----------
    name : str
        Name of the variable, which is zero on the baseline.
    combinations : ndarray, shape (n_values, n_combinations)
        For example from `even_combinations`.
    units : str, optional
        Units of the variable.

    Returns
    -------
    openmdao.api.ExecComp
        Add it before the subsystem that uses the variable.

    Examples
    --------
    >>> import numpy as np
    >>> import openmdao.api as om
    >>> from bspline_mdao.drivers import combine
    >>> problem = om.Problem(reports=None)
    >>> component = combine("y", np.array([[1.0, 0.0], [0.0, 2.0], [1.0, 0.0]]))
    >>> _ = problem.model.add_subsystem("body", component, promotes=["*"])
    >>> _ = problem.setup()
    >>> problem.set_val("combinations", [0.5, 1.0])
    >>> problem.run_model()
    >>> problem.get_val("y")
    array([0.5, 2. , 0.5])
    """
    n_values, n_combinations = combinations.shape
    return om.ExecComp(
        f"{name} = dot(columns, combinations)",
        columns={"val": combinations, "constant": True},
        combinations={"val": np.zeros(n_combinations)},
        **{name: {"shape": n_values, "units": units}},
        do_coloring=False,
    )
