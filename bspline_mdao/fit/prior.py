"""Where control points go that the nodes do not determine.

A control mesh mimics a coarse grid, so the prior of an entity is the grid itself, sampled at the *Greville nodes*: the
mean node numbers of the ``p - 1`` inner knots of each basis function, which the edge-knot formula of section II.D
fixes before any parameter. What the boundary's control points differ from their samples is spread over the inside by
transfinite interpolation, in proportion to lengths along the edges (the Greville abscissae of the mean edge knots), so
that thin layers of cells stay layers. Both are fixed linear maps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, kron

from ..splines.volume import Volume
from .matrix_derivatives import edge_corners
from .transfinite import interpolate_boundary, interpolate_boundary_transpose


@dataclass(frozen=True, eq=False)
class Prior:
    """Linear map from the grid and the control points of a boundary to a whole control net.

    Parameters
    ----------
    blends : tuple of three ndarray, each of shape (N_d,)
        Where each control point stands between the ends of its direction, from 0 to 1.
    sampling : csr_array, shape (N0 N1 N2, n_rows), or None
        Samples of the grid at the Greville nodes; None for zero, where nothing leans on the prior.
    """

    blends: tuple[np.ndarray, ...]
    sampling: csr_array | None = None

    def net(self, nodes: np.ndarray, net: np.ndarray) -> np.ndarray:
        """Complete a net, shape (N0, N1, N2, 3), of which the boundary counts, from nodes, shape (n_rows, 3)."""
        if self.sampling is None:
            return interpolate_boundary(net, self.blends)
        samples = (self.sampling @ nodes).reshape(net.shape)
        return samples + interpolate_boundary(net - samples, self.blends)

    def net_transpose(self, bar: np.ndarray, nodes_bar: np.ndarray) -> np.ndarray:
        """Transpose of `net`: return the cotangent of the boundary and add that of the nodes to ``nodes_bar``."""
        net_bar = interpolate_boundary_transpose(bar, self.blends)
        if self.sampling is not None:
            nodes_bar += self.sampling.T @ (bar - net_bar).reshape(-1, 3)
        return net_bar


def greville_prior(blends, rows: np.ndarray, orders, n_rows: int) -> Prior:
    """Sample the nodes of a section.

    Parameters
    ----------
    blends : sequence of three ndarray, each of shape (N_d,)
        See `Prior`.
    rows : ndarray of int, shape (m0, m1, m2)
        Rows in the grid vector of all nodes of the section.
    orders : sequence of three int
        Orders of its directions.
    n_rows : int
        Length of the grid vector.

    Returns
    -------
    Prior
    """
    weights = [_line_weights(*line) for line in zip(rows.shape, map(len, blends), orders)]
    local = kron(kron(weights[0], weights[1]), weights[2], format="csr")
    shape = (local.shape[0], n_rows)
    return Prior(blends, csr_array((local.data, rows.ravel()[local.indices], local.indptr), shape=shape))


def edge_blends(volume: Volume) -> tuple[np.ndarray, ...]:
    """Greville abscissae of the mean edge knots of each direction of a volume, each of shape (N,)."""
    return tuple(_greville(edge_corners(k).mean(axis=(0, 1)), k.n_control, k.order) for k in volume.knots)


def greville_places(n_nodes: int, n_control: int, order: int) -> np.ndarray:
    """Real node numbers, from 0, of the control points of an edge.

    Examples
    --------
    >>> greville_places(n_nodes=9, n_control=6, order=3)
    array([0., 1., 3., 5., 7., 8.])
    """
    breaks = np.linspace(0, n_nodes - 1, n_control + 2 - order)
    knots = np.concatenate([np.repeat(breaks[0], order - 1), breaks, np.repeat(breaks[-1], order - 1)])
    return _greville(knots, n_control, order)


def _greville(knots: np.ndarray, n_control: int, order: int) -> np.ndarray:
    """Means of p - 1 consecutive inner knots; 0 for a single control point."""
    if n_control == 1:
        return np.zeros(1)
    return np.lib.stride_tricks.sliding_window_view(knots[1:-1], order - 1).mean(axis=1)


def _line_weights(n_nodes: int, n_control: int, order: int) -> coo_array:
    """Linear interpolation at the Greville places of a line, shape (n_control, n_nodes)."""
    places = greville_places(n_nodes, n_control, order)
    low = np.clip(places.astype(int), 0, max(n_nodes - 2, 0))
    high = np.minimum(low + 1, n_nodes - 1)
    share, row = places - low, np.arange(n_control)
    values, columns = np.concatenate([1 - share, share]), np.concatenate([low, high])
    return coo_array((values, (np.tile(row, 2), columns)), shape=(n_control, n_nodes))
