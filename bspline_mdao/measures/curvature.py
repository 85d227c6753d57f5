"""Curvature of patches: its integral, and a bound of the largest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from ..cells.aggregates import KreisselmeierSteinhauser
from ..errors import InputError
from ..mesh.surface import SurfaceGrid
from .combinations import Combinations
from .fundamental_forms import Forms, face_differences, forms, forms_vjp
from .scalars import by_baseline, single_row

__all__ = ["Curvature"]

KINDS = {"total": (1.0, -2.0), "mean": (0.25, 0.0), "gaussian": (0.0, 1.0)}
"""Shares of the square of k1 + k2, and of k1 k2: k1^2 + k2^2, the square of the mean curvature, k1 k2."""

_NONE = 1e-9
"""Curvature, as an integral or relative to that of the surface's box, that is taken for none."""

_FLAT = 1e-9
"""Sine of the angle between the grid lines at a node below which it has no normal."""


@dataclass(frozen=True, eq=False)
class Curvature:
    r"""Integral of the curvature over patches, or a smooth upper bound of the largest.

    The curvature is :math:`k_1^2 + k_2^2`, the square of the mean curvature or :math:`k_1 k_2`, from differences of
    second order along the grid lines of every face, one-sided at its edges: kinks between faces do not count. Nodes
    without a normal on the baseline, where an edge of a face has collapsed, are left out. Make it by `integral` or
    `largest`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    differences : Combinations
        Five derivatives at every node of every face.
    weights : ndarray, shape (n,)
        Weights of the nodes in an integral over the numbers of the nodes.
    shares : tuple of float
        Which curvature; see `KINDS`.
    rule : KreisselmeierSteinhauser or None
        How the largest is bounded; None for the integral.
    scale : float
        What the result is divided by.
    units : str or None
        Units of the result.
    name : str
        Name of the output.
    """

    surface: SurfaceGrid
    differences: Combinations
    weights: np.ndarray
    shares: tuple[float, float]
    rule: KreisselmeierSteinhauser | None
    scale: float
    units: str | None
    name: str

    shape = (1,)
    """One number."""

    @classmethod
    def integral(
        cls,
        surface: SurfaceGrid,
        kind: str = "total",
        *,
        patches: str | Sequence[str] | None = None,
        relative: bool = False,
        name: str = "curvature",
    ) -> Curvature:
        """Integrate over the area, trapezoidally: a number without units.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        kind : str
            ``"total"``, ``"mean"`` or ``"gaussian"``.
        patches : str or sequence of str, optional
            Patches by name; all by default.
        relative : bool
            Divide by the integral on the baseline.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If the kind is unknown, a face is too narrow, or a flat baseline is to be the reference.
        """
        measure = cls(surface, *_places(surface, patches), _shares(kind), None, 1.0, None, name)
        return by_baseline(measure, _NONE) if relative else measure

    @classmethod
    def largest(
        cls,
        surface: SurfaceGrid,
        kind: str = "total",
        *,
        patches: str | Sequence[str] | None = None,
        relative: bool = False,
        rho: float = 100.0,
        name: str = "largest_curvature",
    ) -> Curvature:
        """Bound the largest curvature of a node from above, in 1/m^2.

        Parameters
        ----------
        surface : SurfaceGrid
            The surface.
        kind : str
            ``"total"``, ``"mean"`` or ``"gaussian"``.
        patches : str or sequence of str, optional
            Patches by name; all by default.
        relative : bool
            Divide by the bound on the baseline.
        rho : float
            Sharpness: the bound is above the largest by ln(n) / rho at most, in the largest size on the baseline.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If the kind is unknown, a face is too narrow, rho is not positive, or a flat baseline is to be the
            reference.
        """
        units = None if relative else "1/m**2"
        plain = cls(surface, *_places(surface, patches), _shares(kind), None, 1.0, units, name)
        size = max(np.abs(plain.densities(surface.points)).max(), 1.0 / surface.size**2)
        measure = replace(plain, rule=KreisselmeierSteinhauser(rho / size))
        return by_baseline(measure, _NONE / surface.size**2) if relative else measure

    def densities(self, points: np.ndarray) -> np.ndarray:
        """Curvature (1/m^2) at all nodes of all faces, shape (n,), of nodes, shape (n_points, 3)."""
        return self._densities(forms(self.differences.vectors(points)))

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Integral or bound, shape (1,), of nodes, shape (n_points, 3); real or complex."""
        found = forms(self.differences.vectors(points))
        densities = self._densities(found)
        if self.rule is None:
            return (self.weights * densities * np.sqrt(found.square)).sum(keepdims=True) / self.scale
        return -np.atleast_1d(self.rule.value(self.rule.part(-densities))) / self.scale

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (1, 3 n_points)."""
        vectors = self.differences.vectors(points)
        found = forms(vectors)
        by_density, by_square = self._bars(found)
        (by_mean, by_gaussian), (mean, gaussian, square) = self.shares, found
        bar = Forms(
            by_density * 2.0 * by_mean * mean / square**3,
            by_density * by_gaussian / square**2,
            by_square - by_density * (3.0 * by_mean * mean**2 / square + 2.0 * by_gaussian * gaussian) / square**3,
        )
        return single_row(self.differences.pull(forms_vjp(vectors, bar)))

    def _densities(self, found):
        by_mean, by_gaussian = self.shares
        return (by_mean * found.mean**2 / found.square + by_gaussian * found.gaussian) / found.square**2

    def _bars(self, found):
        """Derivatives in the densities and, besides them, in the squares of the areas."""
        densities = self._densities(found)
        if self.rule is None:
            weights, area = self.weights / self.scale, np.sqrt(found.square)
            return weights * area, 0.5 * weights * densities / area
        bound = self.rule.value(self.rule.part(-densities))
        return self.rule.weights(-densities, bound) / self.scale, np.zeros_like(densities)


def _shares(kind):
    if kind not in KINDS:
        raise InputError(f"curvature: no kind '{kind}'; choose from {', '.join(KINDS)}")
    return KINDS[kind]


def _places(surface, patches):
    """Derivatives and weights of all nodes with a normal."""
    faces = surface.part(surface.patches if patches is None else patches)
    for number in faces:
        if min(surface.faces[number].shape) < 3:
            raise InputError(f"curvature: {surface.names[number]} is less than 3 nodes wide; leave its patch out")
    matrices, weights = face_differences(surface, faces)
    along_i, along_j = matrices[0] @ surface.points, matrices[1] @ surface.points
    areas = np.linalg.norm(np.cross(along_i, along_j), axis=1)
    has_normal = areas > _FLAT * np.linalg.norm(along_i, axis=1) * np.linalg.norm(along_j, axis=1)
    return Combinations.of([matrix[has_normal] for matrix in matrices]), weights[has_normal]
