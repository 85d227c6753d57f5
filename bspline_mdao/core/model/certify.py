"""Proofs that a grid, or a fitted model, is valid everywhere, not only at the corners of its cells.

Theory: ``docs/theory/validity.rst``.
"""

from __future__ import annotations

import numpy as np

from ...base.text import counted
from ...errors import InputError, MovementError
from ...grids.cells.certificate import Certificate, certify_cells
from ...grids.cells.grid_quality import GridQuality
from ...grids.topology.grid import Grid
from ..evaluation.spline_validity import certify_splines
from .fitted_model import FittedModel
from .movable import Movable

__all__ = ["certify", "require_valid_splines"]


def certify(what: Grid | FittedModel, control_points: np.ndarray | None = None) -> Certificate:
    """Prove which blocks of a grid are valid: their maps have a positive Jacobian everywhere.

    For a grid these are the trilinear maps of its cells. For a fitted model they are the maps of its grid's cells and
    the spline maps of its elements, the regions between knots. Lower bounds are Bernstein coefficients with their
    rounding errors included, so whatever is reported valid is valid.

    Parameters
    ----------
    what : Grid or FittedModel
        The grid or model to examine.
    control_points : ndarray, shape (n_control_points, 3), optional
        Moved control points of a model (m); its own by default. The model's own decide about handedness and collapsed
        edges.

    Returns
    -------
    Certificate
        ``valid``, ``invalid`` or ``undecided`` for every block, and where it is not valid.

    Raises
    ------
    InputError
        If ``what`` is neither, or control points are given with a grid, or have the wrong shape.

    Examples
    --------
    >>> from bspline_mdao import certify, fit_grid
    >>> from bspline_mdao.generators import brick_grid
    >>> model = fit_grid(brick_grid((5, 5, 5, 5)))
    >>> certify(model)
    Certificate(valid: all 384 cells valid; all 6 spline elements valid)
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


def require_valid_splines(
    model: Movable,  # the model
    control_points: np.ndarray,  # (n_control_points, 3), its control points after a move (m)
) -> None:
    """Refuse moved control points that make more elements of the splines provably invalid."""
    names, (mesh, moved) = model.spline_names, model.splines_at(control_points)
    baseline = model.splines_at(model.control_points)[1]
    after = certify_splines(mesh, moved, names, baseline)
    if not any(part.n_invalid for part in after):
        return
    before = certify_splines(mesh, baseline, names)
    worse = [new for new, old in zip(after, before) if new.n_invalid > old.n_invalid]
    if worse:
        others = f", and in {counted(len(worse) - 1, 'other block')}" if len(worse) > 1 else ""
        raise MovementError(
            f"movement: splines fold in {worse[0]}{others}; take a smaller step, or constrain certified_ks of Quality, "
            f"so drivers turn back in time"
        )
