"""A smooth surface of several patches, each through rows of points; nodes slide across its seams.

Each patch continues smoothly beyond its edges, by its own spline. Within half a cell of a seam both sides count, with
weights that are equal at the seam and have two continuous derivatives,

    F = sum_i w_i F_i / sum_i w_i,      w_i = s(u_i) s(1 - u_i) s(v_i) s(1 - v_i),

with the signed distance F_i from patch i, and the parameters u_i and v_i of its point nearest to p. So the function of
space has no jump across seams, and neither have closest points. The derivatives of u(p), for which (S - p) . S_a = 0,
are, with M_ab = S_a . S_b + (S - p) . S_ab,

    M_ab u_b,k  = S_a,k
    M_ab u_b,kl = S_ac,k u_c,l + S_ab,l u_b,k - D_abc u_b,k u_c,l
    D_abc       = S_bc . S_a + S_b . S_ac + S_c . S_ab + (S - p) . S_abc .

Theory: ``docs/theory/sliding.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...errors import InputError, MovementError
from .fixed_surface import FixedSurface, Levels
from .spline_surface import SplineSurface

__all__ = ["PatchedSurface"]

TOGETHER = 0.1
"""Nearest points on two patches are one place of the surface if they are nearer to each other than this fraction of a
cell; a point beyond a thin body is another place."""

SMOOTH = np.cos(np.deg2rad(20.0))
"""Patches that meet at more than 20 degrees have a kink, and no closest point moves smoothly across it."""


@dataclass(frozen=True, eq=False, repr=False)
class PatchedSurface(FixedSurface):
    """A smooth surface of several patches, such as a fuselage of two sides, on which nodes slide across the seams.

    Parameters
    ----------
    patches : sequence of array_like, each of shape (n, m, 3)
        Rows of points (m) of each patch, as for `SplineSurface`. Patches that meet have an edge in common, with the
        same points or others. A closed surface takes at least two patches.

    Raises
    ------
    InputError
        If a patch is not such rows, a patch meets no other, or two meet with a kink.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.movers import PatchedSurface
    >>> x, turn = np.meshgrid(np.linspace(0.0, 3.0, 7), np.linspace(0.0, np.pi / 2, 21), indexing="ij")
    >>> tube = np.stack([x, np.cos(turn), np.sin(turn)], axis=-1)
    >>> half = PatchedSurface([tube, tube * [1.0, -1.0, 1.0]])  # on either side of the crown
    >>> half.distances(np.array([[1.5, 0.0, 1.25]])).round(5)
    array([0.25])
    """

    patches: Sequence[np.ndarray]

    def __post_init__(self) -> None:
        if not len(self.patches):
            raise InputError("patched surface: no patch; give rows of points of each")
        self._signs  # noqa: B018 - patches that do not fit together are refused here

    @cached_property
    def _sides(self) -> tuple[SplineSurface, ...]:
        return tuple(map(SplineSurface, self.patches))

    @cached_property
    def _signs(self) -> np.ndarray:
        """Signs that make the normals of all patches point to one side."""
        n = len(self._sides)
        signs, todo = np.zeros(n), [0]
        signs[0] = 1.0
        while todo:
            at = todo.pop()
            for other in np.flatnonzero(signs == 0.0):
                alike = self._alike(at, int(other))
                if alike:
                    signs[other] = alike * signs[at]
                    todo.append(int(other))
        if (signs == 0.0).any():
            raise InputError(
                f"patched surface: patch {np.argmin(np.abs(signs)) + 1} meets none of the others at an edge"
            )
        return signs

    def _alike(self, one: int, other: int) -> float:
        """Whether normals of two patches agree where they meet: 1 or -1; 0 where they do not meet."""
        first, second = self._sides[one], self._sides[other]
        uv = first.edge
        places, normals = first.point(uv), first.normal(uv)
        there, is_near = second.feet(places)
        is_near &= second.is_within(there)
        is_near &= np.linalg.norm(second.point(there) - places, axis=1) <= TOGETHER * second.cell(there)
        if np.count_nonzero(is_near) < 2:  # they meet at a corner, not along an edge
            return 0.0
        cosines = (second.normal(there[is_near]) * normals[is_near]).sum(axis=1)
        worst = int(np.argmin(np.abs(cosines)))
        if np.abs(cosines[worst]) < SMOOTH:
            place = places[is_near][worst].round(6).tolist()
            raise InputError(f"patched surface: patches {one + 1} and {other + 1} meet with a kink at {place}")
        return float(np.sign(cosines[worst]))

    def levels(self, points: np.ndarray) -> Levels:
        """Distance from the surface; for complex points to first order, as a complex step needs."""
        if np.iscomplexobj(points):
            real, step = self.levels(points.real), points.imag
            values = real.values + 1j * (real.gradients * step).sum(axis=1)
            return Levels(values, real.gradients + 1j * np.einsum("nij,nj->ni", real.hessians, step), real.hessians)
        found = [side.feet(points) for side in self._sides]
        feet = np.array([side.point(uv) for side, (uv, _) in zip(self._sides, found)])
        away = np.linalg.norm(feet - points, axis=2)
        is_on = np.array([side.is_within(uv) & ok for side, (uv, ok) in zip(self._sides, found)])
        away[~is_on] = np.inf
        nearest, rows = np.argmin(away, axis=0), np.arange(len(points))
        if len(points) and not is_on[nearest, rows].all():
            place = points[np.argmin(is_on[nearest, rows])].round(6).tolist()
            raise MovementError(f"patched surface: no point of it is near {place}; give a surface that continues there")
        sums = _Weighted.zeros(len(points))
        for number, side in enumerate(self._sides):
            uv, apart = found[number][0], np.linalg.norm(feet[number] - feet[nearest, rows], axis=1)
            counts = np.flatnonzero(is_on[number] & (apart <= TOGETHER * side.cell(uv)))
            sums.add(counts, *side.weighted(uv[counts], points[counts], self._signs[number]))
        return sums.quotient()


@dataclass(frozen=True, eq=False)
class _Weighted:
    """Sums of weights w and of their products with functions, with gradients and Hessians."""

    weights: Levels
    products: Levels

    @classmethod
    def zeros(cls, n: int) -> _Weighted:
        return cls(*(Levels(np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3))) for _ in range(2)))

    def add(self, rows: np.ndarray, w: Levels, f: Levels) -> None:
        """Add a weight and a function at some points."""
        for total, part in zip(self.weights, w):
            total[rows] += part
        mixed = np.einsum("ni,nj->nij", w.gradients, f.gradients)
        self.products.values[rows] += w.values * f.values
        self.products.gradients[rows] += w.values[:, None] * f.gradients + f.values[:, None] * w.gradients
        hessians = w.values[:, None, None] * f.hessians + f.values[:, None, None] * w.hessians
        self.products.hessians[rows] += hessians + mixed + mixed.swapaxes(1, 2)

    def quotient(self) -> Levels:
        """Mean of the functions by their weights."""
        w, p = self.weights, self.products
        values = p.values / w.values
        gradients = (p.gradients - values[:, None] * w.gradients) / w.values[:, None]
        mixed = np.einsum("ni,nj->nij", w.gradients, gradients)
        hessians = p.hessians - values[:, None, None] * w.hessians - mixed - mixed.swapaxes(1, 2)
        return Levels(values, gradients, hessians / w.values[:, None, None])
