"""Rigid links between the nodes of a surface and of a beam: displacements one way, loads the other.

Point i of the surface, at x_i, is linked to nodes k of the beam, at X_k with displacements t_k and rotations theta_k:

    u_i = sum_k w_ik (t_k + theta_k x (x_i - X_k))          displacements
    F_k = sum_i w_ik f_i                                    forces, and
    M_k = sum_i w_ik (x_i - X_k) x f_i                      moments, of the forces f_i on the surface

The loads are the transpose of the displacements: they do the same work, and have the same force and moment about any
point as the forces on the undisplaced surface. Weights are computed on the baseline and fixed. Rotations are small:
they are applied to first order.

Theory: ``docs/theory/aerostructure.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from ...base.checks import as_direction, as_finite_points
from ...base.display import OneLine
from ...base.numerics.vectors import dots
from ...errors import InputError

__all__ = ["RigidLinks"]

N_DOF = 6
"""Displacement and rotation of a node of the beam."""


@dataclass(frozen=True, eq=False)
class RigidLinks(OneLine):
    """Links to the nodes of a beam. Made by `RigidLinks.to_beam`.

    Parameters
    ----------
    weights : csr_array, shape (n_points, n_nodes)
        Weight of each node of the beam in each point; the weights of a point sum to 1.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.flow import RigidLinks
    >>> x, beam = np.array([[0.0, 0.1, 0.5]]), np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> links = RigidLinks.to_beam(x, beam)
    >>> u = np.array([[0.0, 0.2, 0.0, 0.0, 0.0, 0.0]] * 2)  # displacements (m) and rotations (rad) of the beam's nodes
    >>> links.displacements(x, beam, u).round(6)
    array([[0. , 0.2, 0. ]])
    """

    weights: csr_array

    @classmethod
    def to_beam(cls, points: np.ndarray, beam: np.ndarray, along: Sequence[float] | None = None) -> RigidLinks:
        """Link every point to the two ends of the nearest element of a beam, by the nearest place on it.

        Parameters
        ----------
        points : ndarray, shape (n_points, 3)
            Points of the surface on the baseline (m).
        beam : ndarray, shape (n_nodes, 3)
            Nodes of the beam on the baseline in order along it (m).
        along : sequence of three float, optional
            The only direction in which distances count, such as the span. Points in a plane of symmetry normal to it
            are then linked to the end of the beam there, and stay in the plane if this end is clamped, even for a swept
            beam.

        Raises
        ------
        InputError
            If the beam has fewer than two nodes, or neighbours coincide, or the direction is zero.
        """
        points = as_finite_points(points, len(points), "links: points of the surface")
        beam = as_finite_points(beam, len(beam), "links: nodes of the beam")
        if along is not None:
            direction = as_direction(along, "links: direction along the beam")
            points, beam = (np.outer(x @ direction, direction) for x in (points, beam))
        arms = np.diff(beam, axis=0)
        squares = dots(arms, arms)
        if not len(arms) or not squares.all():
            raise InputError("links: give the beam two nodes at least, and none beside the one before it")
        best, element, place = np.full(len(points), np.inf), np.zeros(len(points), dtype=int), np.zeros(len(points))
        for k, (start, arm, square) in enumerate(zip(beam, arms, squares)):  # few elements, many points
            at = np.clip((points - start) @ arm / square, 0.0, 1.0)
            distance = np.linalg.norm(points - start - at[:, None] * arm, axis=1)
            nearer = distance < best
            best[nearer], element[nearer], place[nearer] = distance[nearer], k, at[nearer]
        columns, weights = np.stack([element, element + 1], axis=1), np.stack([1.0 - place, place], axis=1)
        starts = 2 * np.arange(len(points) + 1)
        return cls(csr_array((weights.ravel(), columns.ravel(), starts), (len(points), len(beam))))

    def of_points(self, numbers: np.ndarray) -> RigidLinks:
        """Return the links of some of the points."""
        return RigidLinks(csr_array(self.weights[numbers]))

    def displacements(self, x: np.ndarray, beam: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Displacements of the points, shape (n_points, 3).

        Parameters
        ----------
        x : ndarray, shape (n_points, 3)
            The points before (m).
        beam : ndarray, shape (n_nodes, 3)
            Nodes of the beam before (m).
        u : ndarray, shape (n_nodes, 6)
            Their displacements (m) and rotations (rad).
        """
        t, theta = u[:, :3], u[:, 3:]
        return self.weights @ (t - np.cross(theta, beam)) + np.cross(self.weights @ theta, x)

    def displacements_jvp(
        self, x: np.ndarray, beam: np.ndarray, u: np.ndarray, d_x: np.ndarray, d_beam: np.ndarray, d_u: np.ndarray
    ) -> np.ndarray:
        """Change of the displacements along a direction in all arguments."""
        turned = self.weights @ -np.cross(u[:, 3:], d_beam) + np.cross(self.weights @ u[:, 3:], d_x)
        return self.displacements(x, beam, d_u) + turned

    def displacements_vjp(
        self, x: np.ndarray, beam: np.ndarray, u: np.ndarray, bar: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `displacements_jvp`: derivatives with respect to all arguments."""
        theta = u[:, 3:]
        return np.cross(bar, self.weights @ theta), np.cross(theta, self.weights.T @ bar), self.loads(x, beam, bar)

    def loads(self, x: np.ndarray, beam: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Forces (N) and moments (N m) on the nodes of the beam, shape (n_nodes, 6).

        Parameters
        ----------
        x : ndarray, shape (n_points, 3)
            The points of the surface (m).
        beam : ndarray, shape (n_nodes, 3)
            Nodes of the beam (m).
        forces : ndarray, shape (n_points, 3)
            Forces on the points (N).
        """
        sums = self.weights.T @ forces
        return np.hstack([sums, self.weights.T @ np.cross(x, forces) - np.cross(beam, sums)])

    def loads_jvp(
        self,
        x: np.ndarray,
        beam: np.ndarray,
        forces: np.ndarray,
        d_x: np.ndarray,
        d_beam: np.ndarray,
        d_forces: np.ndarray,
    ) -> np.ndarray:
        """Change of the loads along a direction in all arguments."""
        change = self.loads(x, beam, d_forces)
        change[:, 3:] += self.weights.T @ np.cross(d_x, forces) - np.cross(d_beam, self.weights.T @ forces)
        return change

    def loads_vjp(
        self, x: np.ndarray, beam: np.ndarray, forces: np.ndarray, bar: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Transpose of `loads_jvp`: derivatives with respect to all arguments."""
        moments_bar = bar[:, 3:]
        x_bar = np.cross(forces, self.weights @ moments_bar)
        beam_bar = np.cross(moments_bar, self.weights.T @ forces)
        return x_bar, beam_bar, self.displacements(x, beam, bar)
