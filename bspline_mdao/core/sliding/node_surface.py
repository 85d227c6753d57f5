"""A smooth surface through the nodes of a body without a formula: triangles of a fuselage, quads of a wing.

Every node has a unit normal n and a second fundamental form K, hence a paraboloid near it. The surface is the zero set
of the paraboloids' mean, weighted by distance from the nodes [Shen, O'Brien, Shewchuk 2004; Kolluri 2005]:

    F(x) = sum_i w_i(x) q_i(x) / sum_i w_i(x),    q_i(x) = n_i . (x - p_i) - 1/2 (x - p_i)^T K_i (x - p_i) ,

    w_i(x) = (1 - s)^6 (35 s^2 + 18 s + 3)  with  s = |x - p_i| / r_i  within the reach r_i of the node, and 0 beyond

[Wendland 1995], which has four continuous derivatives. Nodes are on the surface up to the error of their neighbours'
paraboloids, which is of third order in the distance between nodes.

Theory: ``docs/theory/sliding.rst``.

References
----------
C. Shen, J. F. O'Brien and J. R. Shewchuk, Interpolating and approximating implicit surfaces from polygon soup, *ACM
Transactions on Graphics* 23, 2004. R. Kolluri, Provably good moving least squares, *Symposium on Discrete Algorithms*,
2005. H. Wendland, Piecewise polynomial, positive definite and compactly supported radial functions of minimal degree,
*Advances in Computational Mathematics* 4, 1995.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from ...errors import MovementError
from .fixed_surface import FixedSurface, Levels

__all__ = ["NodeSurface"]


@dataclass(frozen=True, eq=False, repr=False)
class NodeSurface(FixedSurface):
    """The surface through nodes with normals and curvatures."""

    points: np.ndarray  # (m, 3), the nodes (m)
    normals: np.ndarray  # (m, 3), unit normals, all to one side
    curvatures: np.ndarray  # (m, 3, 3), second fundamental forms (1/m)
    reaches: np.ndarray  # (m,), distance up to which each counts (m)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.points)

    def near(self, points: np.ndarray) -> np.ndarray:
        """Points on the nearest nodes' paraboloids: beyond the reach of nodes the function is not defined."""
        node = self._tree.query(points.real)[1]
        d, normals = points - self.points[node], self.normals[node]
        d = d - (d * normals).sum(axis=1)[:, None] * normals
        height = 0.5 * np.einsum("ni,nij,nj->n", d, self.curvatures[node], d)
        return self.points[node] + d + height[:, None] * normals

    def levels(self, points: np.ndarray) -> Levels:
        """See `FixedSurface.levels`; `MovementError` beyond the reach of all nodes."""
        at, node, starts = self._near(points.real)
        reach = self.reaches[node]
        d = points[at] - self.points[node]
        s = np.sqrt((d * d).sum(axis=1)) / reach
        # the weight, and its derivative in s divided by s, once and twice: these are polynomials in s
        weight = (1.0 - s) ** 6 * (35.0 * s**2 + 18.0 * s + 3.0)
        first, second = -56.0 * (1.0 - s) ** 5 * (5.0 * s + 1.0) / reach**2, 1680.0 * (1.0 - s) ** 4 / reach**4
        slope = first[:, None] * d
        bend = first[:, None, None] * np.eye(3) + second[:, None, None] * d[:, :, None] * d[:, None, :]
        turned = np.einsum("nij,nj->ni", self.curvatures[node], d)
        q, dq = (self.normals[node] * d).sum(axis=1) - 0.5 * (turned * d).sum(axis=1), self.normals[node] - turned
        cross = slope[:, :, None] * dq[:, None, :]
        of_q = bend * q[:, None, None] + cross + cross.swapaxes(1, 2)
        of_q -= weight[:, None, None] * self.curvatures[node]

        def total(terms: np.ndarray) -> np.ndarray:
            return np.add.reduceat(terms, starts)

        whole = total(weight)
        value = total(weight * q) / whole
        d_whole = total(slope)
        gradient = (total(slope * q[:, None] + weight[:, None] * dq) - value[:, None] * d_whole) / whole[:, None]
        mixed = gradient[:, :, None] * d_whole[:, None, :]
        hessian = total(of_q) - value[:, None, None] * total(bend) - mixed - mixed.swapaxes(1, 2)
        return Levels(value, gradient, hessian / whole[:, None, None])

    def _near(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pairs of points and nodes that reach them, sorted by points, and where each point's pairs start."""
        found = cKDTree(points).query_ball_point(self.points, self.reaches * (1.0 - 1e-15))
        counts = np.array([len(each) for each in found])
        at = np.concatenate([np.zeros(0, dtype=int), *found]).astype(int)
        node = np.repeat(np.arange(len(self.points)), counts)
        order = np.lexsort((node, at))
        at, node = at[order], node[order]
        starts = np.searchsorted(at, np.arange(len(points)))
        lost = np.bincount(at, minlength=len(points)) == 0
        if lost.any():
            place = points[np.argmax(lost)].round(6).tolist()
            raise MovementError(f"sliding: the point {place} is beyond the nodes of the body that are smooth")
        return at, node, starts
