"""Surface control points that make a wing of one shape another: the moves of the paper's section IV."""

from __future__ import annotations

import numpy as np

from ..fit.surface_fit import fit_surface, replace_nodes
from ..model.fitted_model import FittedModel
from .shape import Shape, lay_walls

__all__ = ["fit_shape", "nodes_on_shape"]


def fit_shape(model: FittedModel, surface_ids: np.ndarray, shape: Shape) -> np.ndarray:
    """Fit the surface control points of a wing's model to another shape.

    Parameters
    ----------
    model : FittedModel
        Model of a grid about a wing with patches ``wing_upper`` and ``wing_lower``, see `lay_walls`.
    surface_ids : ndarray of int, shape (n_surface,)
        Numbers of the control points of both patches, such as ``surface_ids`` of the moving mesh.
    shape : Shape
        What the wing is to become, for example `rectangular_wing` or `generic_blended_wing_body`.

    Returns
    -------
    ndarray, shape (n_surface, 3)
        Surface control points (m). How far the surface misses the shape is logged, see
        `bspline_mdao.fit.surface_fit.fit_surface`, which also returns it.

    Raises
    ------
    InputError
        If the patches are not there, or the control points are not those of whole faces.

    Examples
    --------
    >>> from bspline_mdao import fit_grid, flat_plate_grid
    >>> from bspline_mdao.generators import generic_blended_wing_body
    >>> from bspline_mdao.mesh.boundary import moving_mesh
    >>> model = fit_grid(flat_plate_grid((9, 9, 9)), n_control=(5, 5, 5))
    >>> mesh = moving_mesh(model)
    >>> surface = fit_shape(model, mesh.surface_ids, generic_blended_wing_body())
    >>> surface.shape == mesh.points[mesh.surface_ids].shape
    True
    """
    return fit_surface(model, surface_ids, nodes_on_shape(model, shape)).control_points


def nodes_on_shape(model: FittedModel, shape: Shape) -> np.ndarray:
    """All nodes of a model's grid, shape (n_nodes, 3), those of the wing laid on another shape; see `fit_shape`."""
    grid = model.regenerate()
    return replace_nodes(model.topology, grid.to_vector().reshape(-1, 3), lay_walls(grid, shape))
