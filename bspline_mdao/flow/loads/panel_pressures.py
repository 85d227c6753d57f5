"""Pressure differences across the panels of a lattice, from the forces on them.

The difference of the pressure coefficients below and above a thin wing is the force along the normal of the panel
divided by its area and the dynamic pressure: ``delta_Cp = F . N / N . N``, with the area vector ``N`` of the panel,
half the cross product of its diagonals, which points up. It is positive where the panel lifts.
"""

from __future__ import annotations

import numpy as np

__all__ = ["panel_pressures", "panel_pressures_jvp", "panel_pressures_vjp"]


def panel_pressures(
    forces: np.ndarray,  # (n - 1, m - 1, 3), forces on the panels divided by the dynamic pressure (m^2)
    # (n, m, 3), nodes of the lattice (m), from the leading edge on, and from the left tip to the root
    nodes: np.ndarray,
) -> np.ndarray:
    """Differences of the pressure coefficients below and above panels, shape (n - 1, m - 1); real or complex."""
    normals = _area_vectors(nodes)
    return _dot(forces, normals) / _dot(normals, normals)


def panel_pressures_jvp(forces: np.ndarray, nodes: np.ndarray, d_forces: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
    """Derivative of `panel_pressures` along a direction in both arguments, shape (n - 1, m - 1)."""
    normals, d_normals = _area_vectors(nodes), _area_vectors_jvp(nodes, d_nodes)
    square = _dot(normals, normals)
    values = _dot(forces, normals) / square
    return (_dot(d_forces, normals) + _dot(forces - 2.0 * values[..., None] * normals, d_normals)) / square


def panel_pressures_vjp(
    forces: np.ndarray, nodes: np.ndarray, bar: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:  # forces_bar: (n - 1, m - 1, 3); nodes_bar: (n, m, 3)
    """Apply the transpose of `panel_pressures_jvp` to derivatives with respect to the differences."""
    normals = _area_vectors(nodes)
    square = _dot(normals, normals)
    values = _dot(forces, normals) / square
    scaled = (bar / square)[..., None]
    first, second = _diagonals(nodes)
    normals_bar = 0.5 * scaled * (forces - 2.0 * values[..., None] * normals)
    first_bar, second_bar = np.cross(second, normals_bar), np.cross(normals_bar, first)
    nodes_bar = np.zeros(nodes.shape, np.result_type(nodes, bar, forces))
    nodes_bar[1:, 1:] += first_bar
    nodes_bar[:-1, :-1] -= first_bar
    nodes_bar[:-1, 1:] += second_bar
    nodes_bar[1:, :-1] -= second_bar
    return scaled * normals, nodes_bar


def _diagonals(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return nodes[1:, 1:] - nodes[:-1, :-1], nodes[:-1, 1:] - nodes[1:, :-1]


def _area_vectors(nodes: np.ndarray) -> np.ndarray:
    return 0.5 * np.cross(*_diagonals(nodes))


def _area_vectors_jvp(nodes: np.ndarray, d_nodes: np.ndarray) -> np.ndarray:
    (first, second), (d_first, d_second) = _diagonals(nodes), _diagonals(d_nodes)
    return 0.5 * (np.cross(d_first, second) + np.cross(first, d_second))


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sum(a * b, axis=-1)
