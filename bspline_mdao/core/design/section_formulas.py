"""Formulas of wing sections, each in one place: rotation, scaling and shear.

A named deformation applies them by one amount (`bspline_mdao.core.design.deformation`: `RotateSections`, `ScaleChord`,
`ScaleThickness`, `ShearDownstream`, `ShearUpwards`); a design variable by one amount per station along an axis
(`bspline_mdao.core.design.planform`: `Twist`, `Chord`, `ThicknessFactor`, `Taper`, `Sweep`, `Dihedral`). All are
complex-safe in the amount. Theory: ``docs/theory/parametrization.rst`` and ``docs/theory/deformations.rst``.
"""

from __future__ import annotations

import numpy as np

__all__ = ["rotation", "scaling", "shear"]


def rotation(
    angle: np.ndarray | float,  # ndarray, any shape, angles (rad)
) -> np.ndarray:  # (..., 2, 2)
    """Return matrices of stream and normal coordinates that rotate sections, upstream end up."""
    cos, sin = np.cos(angle), np.sin(angle)
    return _matrices(cos, sin, -sin, cos)


def scaling(stream: np.ndarray | float, normal: np.ndarray | float) -> np.ndarray:
    """Return matrices, shape (..., 2, 2), that scale stream and normal coordinates by factors of any shape."""
    stream, normal = np.broadcast_arrays(stream, normal)
    return _matrices(stream, 0.0 * stream, 0.0 * normal, normal)  # zeros that are complex where the factors are


def shear(angle: np.ndarray | float) -> np.ndarray:
    """Return the shift of sections per length of span that is sheared by an angle (rad)."""
    return np.tan(angle)


def _matrices(a: np.ndarray | float, b: np.ndarray | float, c: np.ndarray | float, d: np.ndarray | float) -> np.ndarray:
    return np.stack([np.stack([a, b], axis=-1), np.stack([c, d], axis=-1)], axis=-2)
