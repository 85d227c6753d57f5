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
    smallest = _smallest_length(nodes)
    for d in range(3):
        if nodes.shape[d] > 1:
            _parametrize_lines(np.moveaxis(nodes, d, 2), smallest, np.moveaxis(parameters[..., d], d, 2))
    return parameters


def chord_length_parameters_jvp(nodes: np.ndarray, parameters: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
    """Differentiate `chord_length_parameters` along a direction.

    Parameters
    ----------
    nodes, parameters : ndarray, shape (L0, L1, L2, 3)
        Nodes and their parameters.
    d_nodes : ndarray, shape (L0, L1, L2, 3)
        Direction.

    Returns
    -------
    ndarray, shape (L0, L1, L2, 3)
        Zero at the ends of all lines and on lines without length.
    """
    smallest, d_parameters = _smallest_length(nodes), np.zeros(nodes.shape)
    for d in range(3):
        if nodes.shape[d] > 1:
            lines = (np.moveaxis(array, d, 2) for array in (nodes, parameters[..., d], d_nodes, d_parameters[..., d]))
            _lines_jvp(*lines, smallest)
    return d_parameters


def chord_length_parameters_vjp(nodes: np.ndarray, parameters: np.ndarray, bar: np.ndarray) -> np.ndarray:
    """Transpose of `chord_length_parameters_jvp`: from ``bar`` of the parameters to that of the nodes."""
    smallest, nodes_bar = _smallest_length(nodes), np.zeros(nodes.shape)
    for d in range(3):
        if nodes.shape[d] > 1:
            lines = (np.moveaxis(array, d, 2) for array in (nodes, parameters[..., d], bar[..., d], nodes_bar))
            _lines_vjp(*lines, smallest)
    return nodes_bar


def _smallest_length(nodes: np.ndarray) -> float:
    """Length below which a line counts as collapsed."""
    return COLLAPSED * np.linalg.norm(np.ptp(nodes.reshape(-1, 3), axis=0))


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


@njit(cache=True)
def _unit_chord(nodes, i, j, q):
    """Components of the unit chord from node q - 1 to node q, and its length; zeros where there is none."""
    dx = nodes[i, j, q, 0] - nodes[i, j, q - 1, 0]
    dy = nodes[i, j, q, 1] - nodes[i, j, q - 1, 1]
    dz = nodes[i, j, q, 2] - nodes[i, j, q - 1, 2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    inverse = 1.0 / length if length > 0.0 else 0.0
    return dx * inverse, dy * inverse, dz * inverse, length


@njit(cache=True)
def _lines_jvp(nodes, parameters, d_nodes, d_parameters, smallest):
    """Write the derivatives of the parameters of the grid lines along axis 2."""
    n_0, n_1, n_line = parameters.shape
    for i in range(n_0):
        for j in range(n_1):
            length, d_length = 0.0, 0.0
            for q in range(1, n_line):
                ex, ey, ez, chord = _unit_chord(nodes, i, j, q)
                length += chord
                a, b = d_nodes[i, j, q], d_nodes[i, j, q - 1]
                d_length += ex * (a[0] - b[0]) + ey * (a[1] - b[1]) + ez * (a[2] - b[2])
                d_parameters[i, j, q] = d_length
            for q in range(1, n_line):
                change = d_parameters[i, j, q] - parameters[i, j, q] * d_length
                d_parameters[i, j, q] = change / length if length > smallest and q < n_line - 1 else 0.0


@njit(cache=True)
def _lines_vjp(nodes, parameters, bar, nodes_bar, smallest):
    """Add the cotangent of the nodes of the grid lines along axis 2."""
    n_0, n_1, n_line = parameters.shape
    for i in range(n_0):
        for j in range(n_1):
            length, total_bar = 0.0, 0.0
            for q in range(1, n_line):
                length += _unit_chord(nodes, i, j, q)[3]
                if q < n_line - 1:
                    total_bar -= bar[i, j, q] * parameters[i, j, q]
            if length <= smallest:
                continue
            chord_bar = total_bar  # of the chord that ends in node q: what all nodes from q on, and the total, need
            for q in range(n_line - 1, 0, -1):
                if q < n_line - 1:
                    chord_bar += bar[i, j, q]
                ex, ey, ez, _ = _unit_chord(nodes, i, j, q)
                factor = chord_bar / length
                nodes_bar[i, j, q, 0] += factor * ex
                nodes_bar[i, j, q, 1] += factor * ey
                nodes_bar[i, j, q, 2] += factor * ez
                nodes_bar[i, j, q - 1, 0] -= factor * ex
                nodes_bar[i, j, q - 1, 1] -= factor * ey
                nodes_bar[i, j, q - 1, 2] -= factor * ez
