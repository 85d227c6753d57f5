"""Curvature of patches: its integral, and a smooth upper bound of its maximum.

The two fundamental forms come from differences along the grid lines of structured faces, with node numbers as
parameters, or from polynomials that fit the nodes of triangles and quads around each node. Theory:
``docs/theory/geometry.rst``, "Curvature".

References
----------
M. P. do Carmo, *Differential Geometry of Curves and Surfaces*, 1976, section 3-3: mean and Gaussian curvature from the
coefficients of the fundamental forms.

G. Kreisselmeier and R. Steinhauser, Systematic control design by optimizing a vector performance index, *IFAC
Symposium on Computer Aided Design of Control Systems*, 1979: the bound.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.sparse import block_array, csr_array, eye_array, kron

from ...base.display import OneLine
from ...base.numerics.vectors import dots
from ...errors import InputError
from ...grids.cells.aggregates import KreisselmeierSteinhauser
from ..mesh.surface import SurfaceGrid
from .jets import SmoothCorners, jets
from .measure import Combinations, relative_to_baseline, single_row

__all__ = ["Curvature", "Forms", "difference_matrices", "face_differences", "forms", "forms_vjp"]

KINDS = {"total": (1.0, -2.0), "mean": (0.25, 0.0), "gaussian": (0.0, 1.0)}
"""Coefficients of (k1 + k2)^2 and of k1 k2 for k1^2 + k2^2, the squared mean curvature, and k1 k2."""

_NONE = 1e-9
"""Curvature, as an integral or relative to the curvature of the surface's box, that may be round-off of the
differences."""

_FLAT = 1e-9
"""Sine of the angle between grid lines below which a node has no normal."""


@dataclass(frozen=True, eq=False)
class Curvature(OneLine):
    r"""Integral of the curvature over patches, or a smooth upper bound of its maximum.

    The curvature is :math:`k_1^2 + k_2^2`, the squared mean curvature or :math:`k_1 k_2`, from second-order differences
    along the grid lines of every face, one-sided at its edges: kinks between faces are ignored. Nodes without a normal
    on the baseline, where an edge of a face has collapsed, are left out. On unstructured triangles and quads,
    derivatives come from polynomials that fit the nodes around each node, separately on each side of a kink, see
    `bspline_mdao.core.measures.jets`. Make it by `integral` or `largest`.

    Parameters
    ----------
    surface : SurfaceGrid
        The surface.
    differences : Combinations
        Five derivatives at every node of every face.
    weights : ndarray, shape (n,)
        Weights of the nodes in an integral over node numbers.
    coefficients : tuple of float
        Coefficients of one of the `KINDS` of curvature.
    rule : KreisselmeierSteinhauser or None
        Smooth bound of the maximum; None for the integral.
    scale : float
        Divisor of the result.
    units : str or None
        Units of the result.
    name : str
        Name of the output.

    Examples
    --------
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.generators import onera_m6_grid
    >>> from bspline_mdao.measures import Curvature, SurfaceGrid
    >>> surface = SurfaceGrid.of(fit_grid(onera_m6_grid((9, 9, 7))))
    >>> curvature = Curvature.integral(surface, relative=True)
    >>> curvature.evaluate(2.0 * surface.points)
    array([1.])
    """

    surface: SurfaceGrid
    differences: Combinations
    weights: np.ndarray
    coefficients: tuple[float, float]
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
        """Integrate over the area by the trapezoidal rule: a dimensionless number.

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
            If the kind is unknown, a face is too narrow, or the reference would be a flat baseline.
        """
        differences, weights = _places(surface, patches)
        measure = cls(surface, differences, weights, _coefficients(kind), None, 1.0, None, name)
        return relative_to_baseline(measure, _NONE) if relative else measure

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
        """Bound the largest nodal curvature from above, in 1/m^2.

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
            Sharpness: the bound exceeds the maximum by at most ln(n) / rho, in units of the baseline's largest
            magnitude.
        name : str
            Name of the output.

        Raises
        ------
        InputError
            If the kind is unknown, a face is too narrow, rho is not positive, or the reference would be a flat
            baseline.
        """
        units = None if relative else "1/m**2"
        differences, weights = _places(surface, patches)
        plain = cls(surface, differences, weights, _coefficients(kind), None, 1.0, units, name)
        size = max(np.abs(plain.densities(surface.points)).max(), 1.0 / surface.size**2)
        measure = replace(plain, rule=KreisselmeierSteinhauser(rho / size))
        return relative_to_baseline(measure, _NONE / surface.size**2) if relative else measure

    def densities(self, points: np.ndarray) -> np.ndarray:
        """Curvature (1/m^2) at all nodes of all faces, shape (n,), from nodes, shape (n_points, 3)."""
        return self._densities(forms(self.differences.vectors(points)))

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Integral or bound, shape (1,), from nodes, shape (n_points, 3); real or complex."""
        found = forms(self.differences.vectors(points))
        densities = self._densities(found)
        if self.rule is None:
            return (self.weights * densities * np.sqrt(found.square)).sum(keepdims=True) / self.scale
        return -np.atleast_1d(self.rule.value(self.rule.part(-densities))) / self.scale

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate`, shape (1, 3 n_points)."""
        vectors = self.differences.vectors(points)
        found = forms(vectors)
        density_bar, square_bar = self._bars(found)
        (c_mean, c_gaussian), (mean, gaussian, square) = self.coefficients, found
        bar = Forms(
            density_bar * 2.0 * c_mean * mean / square**3,
            density_bar * c_gaussian / square**2,
            square_bar - density_bar * (3.0 * c_mean * mean**2 / square + 2.0 * c_gaussian * gaussian) / square**3,
        )
        return single_row(self.differences.pull(forms_vjp(vectors, bar)))

    def _densities(self, found: Forms) -> np.ndarray:
        c_mean, c_gaussian = self.coefficients
        return (c_mean * found.mean**2 / found.square + c_gaussian * found.gaussian) / found.square**2

    def _bars(self, found: Forms) -> tuple[np.ndarray, np.ndarray]:
        """Cotangents of the densities, and additional ones of the squared areas."""
        densities = self._densities(found)
        if self.rule is None:
            weights, area = self.weights / self.scale, np.sqrt(found.square)
            return weights * area, 0.5 * weights * densities / area
        bound = self.rule.value(self.rule.part(-densities))
        return self.rule.weights(-densities, bound) / self.scale, np.zeros_like(densities)


def _coefficients(kind: str) -> tuple[float, float]:
    if kind not in KINDS:
        raise InputError(f"curvature: no kind '{kind}'; choose from {', '.join(KINDS)}")
    return KINDS[kind]


def _places(surface: SurfaceGrid, patches: str | Sequence[str] | None) -> tuple[Combinations, np.ndarray]:
    """Differences and weights of all nodes with a normal."""
    faces = surface.part(surface.patches if patches is None else patches)
    if surface.cells:
        return _smooth_places(surface, faces)
    for number in faces:
        if min(surface.faces[number].shape) < 3:
            raise InputError(f"curvature: {surface.names[number]} is less than 3 nodes wide; leave its patch out")
    matrices, weights = face_differences(surface, faces)
    along_i, along_j = matrices[0] @ surface.points, matrices[1] @ surface.points
    areas = np.linalg.norm(np.cross(along_i, along_j), axis=1)
    has_normal = areas > _FLAT * np.linalg.norm(along_i, axis=1) * np.linalg.norm(along_j, axis=1)
    return Combinations.of([matrix[has_normal] for matrix in matrices]), weights[has_normal]


def _smooth_places(surface: SurfaceGrid, faces: tuple[int, ...]) -> tuple[Combinations, np.ndarray]:
    """Derivatives at nodes of triangles and quads, separately on each side of a kink, and their areas."""
    corners = SmoothCorners(surface.points, np.concatenate([surface.cells[number] for number in faces]))
    matrices, is_found = jets(corners, np.arange(len(corners.nodes)))
    if not is_found.any():
        raise InputError(
            f"curvature: no node of {surface.names[faces[0]]} has enough others near it without a kink between them; "
            f"leave its patch out, or take a finer mesh"
        )
    return Combinations.of([csr_array(matrix[is_found]) for matrix in matrices]), corners.areas[is_found]


class Forms(NamedTuple):
    """Numerators of the curvatures and the area, with node numbers as parameters; each of shape (n,)."""

    mean: np.ndarray  # ``E n - 2 F m + G l``, twice the mean curvature times the area to the third
    gaussian: np.ndarray  # ``l n - m^2``, the Gaussian curvature times the area to the fourth
    square: np.ndarray  # square of the area, ``E G - F^2``


def forms(
    vectors: np.ndarray,  # (5, n, 3), first derivatives along i and j, second derivatives ii, ij and jj
) -> Forms:
    """Return the numerators of the curvatures from derivatives of the surface."""
    along_i, along_j, *second = vectors
    normal = np.cross(along_i, along_j)
    (e, f, g), (l, m, n) = _metric(along_i, along_j), (dots(part, normal) for part in second)
    return Forms(e * n - 2.0 * f * m + g * l, l * n - m * m, dots(normal, normal))


def forms_vjp(vectors: np.ndarray, bar: Forms) -> list[np.ndarray]:
    """Pull cotangents of the result of `forms` back to the five vectors, each of shape (n, 3)."""
    along_i, along_j, *second = vectors
    normal = np.cross(along_i, along_j)
    (e, f, g), (l, m, n) = _metric(along_i, along_j), (dots(part, normal) for part in second)
    e_bar, f_bar, g_bar = bar.mean * n, -2.0 * bar.mean * m, bar.mean * l
    l_bar, m_bar = bar.mean * g + bar.gaussian * n, -2.0 * (bar.mean * f + bar.gaussian * m)
    bars = [part[:, None] for part in (l_bar, m_bar, bar.mean * e + bar.gaussian * l)]
    normal_bar = 2.0 * bar.square[:, None] * normal + sum(part * vector for part, vector in zip(bars, second))
    along_i_bar = _times(2.0 * e_bar, along_i) + _times(f_bar, along_j) + np.cross(along_j, normal_bar)
    along_j_bar = _times(2.0 * g_bar, along_j) + _times(f_bar, along_i) + np.cross(normal_bar, along_i)
    return [along_i_bar, along_j_bar, *(part * normal for part in bars)]


def face_differences(
    surface: SurfaceGrid,
    faces: tuple[int, ...],  # numbers of its faces, at least three nodes wide each way
) -> tuple[list[csr_array], np.ndarray]:
    """Return the matrices for the five vectors of `forms` at all nodes of some faces."""
    # returns matrices each (n, n_points): first differences along i and j, second differences ii, ij and jj, with a
    # spacing of one
    # returns weights (n,): weights of the trapezoidal rule
    chosen = [surface.faces[number] for number in faces]
    matrices = [_on_face(ids, surface.n_points) for ids in chosen]
    weights = [np.outer(*(_trapezoidal(n) for n in ids.shape)).ravel() for ids in chosen]
    return [csr_array(block_array([[part] for part in kind])) for kind in zip(*matrices)], np.concatenate(weights)


def difference_matrices(n: int) -> tuple[csr_array, csr_array]:
    """Matrices (n, n) of the first and second differences of n numbers in a row, of second order; n is at least 3."""
    # With three numbers the second differences at the ends are of first order.
    first, second = np.zeros((2, n, n))
    inner = np.arange(1, n - 1)
    first[inner, inner - 1], first[inner, inner + 1] = -0.5, 0.5
    second[inner, inner - 1], second[inner, inner], second[inner, inner + 1] = 1.0, -2.0, 1.0
    end = [2.0, -5.0, 4.0, -1.0] if n > 3 else [1.0, -2.0, 1.0]  # one-sided
    first[0, :3], first[-1, :-4:-1] = [-1.5, 2.0, -0.5], [1.5, -2.0, 0.5]
    second[0, : len(end)], second[-1, : -len(end) - 1 : -1] = end, end
    return csr_array(first), csr_array(second)


def _on_face(ids: np.ndarray, n_points: int) -> list[csr_array]:
    (first_i, second_i), (first_j, second_j) = (difference_matrices(n) for n in ids.shape)
    here_i, here_j = (eye_array(n) for n in ids.shape)
    pick = csr_array((np.ones(ids.size), (np.arange(ids.size), ids.ravel())), shape=(ids.size, n_points))
    pairs = ((first_i, here_j), (here_i, first_j), (second_i, here_j), (first_i, first_j), (here_i, second_j))
    return [csr_array(kron(*pair)) @ pick for pair in pairs]


def _trapezoidal(n: int) -> np.ndarray:
    return np.concatenate([[0.5], np.ones(n - 2), [0.5]])


def _metric(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return dots(u, u), dots(u, v), dots(v, v)


def _times(factors: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return factors[:, None] * vectors
