"""Proofs that a grid, or a fitted model, is valid everywhere, not only at the corners of its cells.

Theory: ``docs/theory/validity.rst``.
"""

from __future__ import annotations

import numpy as np

from ..cells.certificate import Certificate, certify_cells
from ..cells.grid_quality import GridQuality
from ..errors import InputError
from ..evaluation.spline_validity import certify_splines
from ..topology.grid import Grid
from .fitted_model import FittedModel

__all__ = ["certify"]


def certify(what: Grid | FittedModel, control_points: np.ndarray | None = None) -> Certificate:
    """Prove which blocks of a grid are valid: whose maps have a positive Jacobian everywhere.

    Of a grid these are the trilinear maps of its cells; of a fitted model, the cells of its grid and the spline maps of
    its elements, the regions between knots. Lower bounds are Bernstein coefficients, their rounding errors included:
    what counts as valid is.

    Parameters
    ----------
    what : Grid or FittedModel
        What to look at.
    control_points : ndarray, shape (n_control_points, 3), optional
        Moved control points of a model (m); its own by default. Its own decide about handedness and collapsed edges.

    Returns
    -------
    Certificate
        ``valid``, ``invalid`` or ``undecided`` for every block, and where it is not valid.

    Raises
    ------
    InputError
        If it is neither, or control points come with a grid, or are of another shape.

    Examples
    --------
    >>> from bspline_mdao import brick_grid, certify, fit_grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> certify(model)
    Certificate(valid: all 384 cells of 6 blocks valid; all 6 spline elements of 6 blocks valid)
    """
    if isinstance(what, FittedModel):
        baseline = what.regenerate()
        grid = baseline if control_points is None else what.regenerate(control_points)
        points = what.control_points if control_points is None else np.asarray(control_points, dtype=float)
        splines = certify_splines(what.mesh, points, what.topology.segment_names, what.control_points)
    elif isinstance(what, Grid):
        if control_points is not None:
            raise InputError("certify: a grid has no control points; give the fitted model")
        baseline = grid = what
        splines = ()
    else:
        raise InputError(f"certify: a {type(what).__name__} has no cells; give a grid or a fitted model")
    cells = certify_cells(GridQuality.of_baseline(baseline), grid.to_vector().reshape(-1, 3))
    return Certificate(cells, splines)
