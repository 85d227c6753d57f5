"""Chord-length parameters of the nodes of a block, section II.D."""

from __future__ import annotations

import numpy as np
from numba import njit

COLLAPSED = 1e-12
"""A grid line shorter than this fraction of the block's size has no length; its parameters are uniform."""


def chord_length_parameters(nodes: np.ndarray) -> np.ndarray:
    """Chord-length parameters of all nodes, section II.D.

    Each grid line is parametrized on its own: ``xi_q`` is its length up to node q divided by its whole length. A line
    without length gets uniform parameters, a direction of one node the parameter 0.

    Parameters
    ----------
    nodes : ndarray, shape (L0, L1, L2, 3)
        Nodes, in metres.

    Returns
    -------
    ndarray, shape (L0, L1, L2, 3)
        Parameters xi, eta and zeta, exactly 0 and 1 at the two ends of every line.

    Examples
    --------
    >>> nodes = np.zeros((3, 1, 1, 3))
    >>> nodes[:, 0, 0, 0] = [0.0, 1.0, 4.0]
    >>> chord_length_parameters(nodes)[:, 0, 0]
    array([[0.  , 0.  , 0.  ],
           [0.25, 0.  , 0.  ],
           [1.  , 0.  , 0.  ]])
    """
    parameters = np.zeros(nodes.shape)
    smallest = COLLAPSED * np.linalg.norm(np.ptp(nodes.reshape(-1, 3), axis=0))
    for d in range(3):
        if nodes.shape[d] > 1:
            _parametrize_lines(np.moveaxis(nodes, d, 2), smallest, np.moveaxis(parameters[..., d], d, 2))
    return parameters


@njit(cache=True)
def _parametrize_lines(nodes, smallest, parameters):
    """Write the parameters of the grid lines along axis 2."""
    n_0, n_1, n_line = parameters.shape
    for i in range(n_0):
        for j in range(n_1):
            length = 0.0
            for q in range(1, n_line):
                dx = nodes[i, j, q, 0] - nodes[i, j, q - 1, 0]
                dy = nodes[i, j, q, 1] - nodes[i, j, q - 1, 1]
                dz = nodes[i, j, q, 2] - nodes[i, j, q - 1, 2]
                length += np.sqrt(dx * dx + dy * dy + dz * dz)
                parameters[i, j, q] = length
            for q in range(1, n_line):
                parameters[i, j, q] = parameters[i, j, q] / length if length > smallest else q / (n_line - 1)
