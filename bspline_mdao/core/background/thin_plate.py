"""Mover of a background lattice: the displacement of least bending that goes through the walls.

The displacement d of the lattice makes least

    E(d) = 1/2 sum_c d_c^T K d_c + 1/2 sum_w s_w |A_w d - (w' - w)|^2 ,

    K = sum_{a + b + c = 2} 2 / (a! b! c!) G_a (x) G_b (x) G_c ,

with the bending energy K of a thin plate [1], made of the integrals of `.lattice_line`, and the nodes w of the walls.
Nodes that stay, such as those of a far field, are among them, with no displacement. All nodes in one element of the
lattice share the weight ``stiffness``: neither the number of nodes nor any length matters. Control points on the
outside stay, those on planes slide, and those on sides that walls reach are free. The system is that of the baseline:
one factor for all designs, both ways.

[1] J. Duchon, "Splines minimizing rotation-invariant semi-norms in Sobolev spaces", in Constructive Theory of Functions
of Several Variables, Lecture Notes in Mathematics 571, Springer, 1977, pp. 85-100.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array, kron

from ...base.display import OneLine
from ...base.sparse.scalar_blocks import ScalarBlocksFactor, factorize_scalars
from ..mesh.moving_mesh import MovingMesh
from ..movement.mover import (
    IncrementReport,
    MovementReport,
    SolveReport,
    check_reach,
    check_request,
    digits_of,
)
from .background_lattice import BackgroundLattice
from .lattice_settings import DEFAULTS, LatticeSettings

__all__ = ["ThinPlate", "ThinPlateMovement"]

EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class ThinPlate(OneLine):
    """Moves the control points of a background lattice behind the nodes of walls.

    Parameters
    ----------
    mesh : MovingMesh
        Nodes of the walls, which are its surface or a part of it, and after them the control points of the lattice.
    lattice : BackgroundLattice
        The lattice.
    at_rest : ndarray, shape (n, 3)
        Other nodes of the mesh that are to stay (m).
    settings : LatticeSettings
        Of them, the ``stiffness``.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.meshes import MeshModel, MixedMesh, ThinPlate
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0]])
    >>> tetrahedra, floor = np.array([[0, 1, 2, 3], [1, 4, 2, 3]]), np.array([[0, 1, 2, 2]])
    >>> model = MeshModel.of(MixedMesh(corners, {"tetra": tetrahedra}, {"floor": floor}), {"floor": "wall"})
    >>> mover = ThinPlate(model.moving_mesh, model.lattice)
    >>> mover.move(model.control_points, model.control_points[: mover.n_walls]).report.n_increments
    1
    """

    mesh: MovingMesh
    lattice: BackgroundLattice
    at_rest: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    settings: LatticeSettings = DEFAULTS

    @property
    def n_walls(self) -> int:
        """Number of nodes of walls; those that are not of the surface stay."""
        return self.mesh.n_points - self.lattice.n_control

    def move(self, initial: np.ndarray, surface: np.ndarray) -> ThinPlateMovement:
        """Move points, shape (n_points, 3), behind surface points, shape (n_surface, 3), both in metres."""
        start = time.perf_counter()
        check_request(self.mesh, initial, surface)
        points, ids = initial.copy(), self.mesh.surface_ids
        points[self.n_walls :] += self.displacement(self.on_walls(surface - initial[ids]))
        points[ids] = surface
        check_reach(self.mesh, initial, surface, points)
        tangling = self.mesh.tangled(points)
        solve = SolveReport("Cholesky", 0, 0.0, time.perf_counter() - start, self._digits)
        increment = IncrementReport(
            solve, tangling.n_tangled, tangling.place, tangling.min_corner, tangling.corner_ratio, tangling.n_invalid
        )
        report = MovementReport((increment,), time.perf_counter() - start, self.mesh.n_invalid)
        return ThinPlateMovement(self, points, report)

    def displacement(self, of_walls: np.ndarray) -> np.ndarray:
        """Displacements of the control points, shape (n_control, 3), of those of the walls, shape (n_walls, 3)."""
        of_lattice = np.zeros((self.lattice.n_control, 3))
        right = self._walls.T @ (self._weights[:, None] * (of_walls @ self.lattice.axes.T))
        for ids, components, factor in self._systems:
            part = np.zeros((right.shape[0], len(components)))
            part[ids] = factor.solve(right[np.ix_(ids, components)])
            of_lattice[:, components] = self._unknowns @ part
        return of_lattice @ self.lattice.axes

    def missed(self, of_walls: np.ndarray) -> np.ndarray:
        """What the lattice alone misses of displacements of the walls, shape (n_walls, 3)."""
        return self.lattice.evaluator(self.wall_points).forward(self.displacement(of_walls)) - of_walls

    def displacement_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `displacement`, from shape (n_control, 3)."""
        bar = self._unknowns.T @ (bar @ self.lattice.axes.T)
        solved = np.zeros_like(bar)
        for ids, components, factor in self._systems:
            solved[np.ix_(ids, components)] = factor.solve(bar[np.ix_(ids, components)])
        return (self._weights[:, None] * (self._walls @ solved)) @ self.lattice.axes

    def on_walls(self, of_surface: np.ndarray) -> np.ndarray:
        """Displacements of the walls, shape (n_walls, 3), of those of the surface, shape (n_surface, 3)."""
        of_walls = np.zeros((self.n_walls, 3))
        of_walls[self.mesh.surface_ids] = of_surface
        return of_walls

    @cached_property
    def _unknowns(self) -> csr_array:
        """Control points from unknowns, shape (n_control, n_unknowns): those that are tied have the same."""
        matrix = csr_array(np.ones((1, 1)))
        for line in self.lattice.lines:
            matrix = kron(matrix, line.ties, format="csr")
        return csr_array(matrix)

    @cached_property
    def _walls(self) -> csr_array:
        """Displacements of the nodes of walls from the unknowns, shape (n_walls, n_unknowns)."""
        return csr_array(self.lattice.evaluator(self.wall_points).matrix() @ self._unknowns)

    @property
    def wall_points(self) -> np.ndarray:
        """Nodes of walls on the baseline (m), shape (n_walls, 3)."""
        return self.mesh.points[: self.n_walls]

    @cached_property
    def _all_weights(self) -> np.ndarray:
        """Weights of the nodes of walls, and of those at rest."""
        points = np.concatenate([self.wall_points, self.at_rest])
        element = self.lattice.elements(points)
        return self.settings.stiffness * self.lattice.refinement(points) / np.bincount(element)[element]

    @property
    def _weights(self) -> np.ndarray:
        return self._all_weights[: self.n_walls]

    @cached_property
    def _systems(self) -> tuple[tuple[np.ndarray, np.ndarray, ScalarBlocksFactor], ...]:
        """Unknowns that are free, the components for which it is these, and the factor of their matrix."""
        matrix, found = self._matrix, []
        for ids, components in self._free:
            found.append((ids, components, factorize_scalars(csr_array(matrix[ids][:, ids]))))
        return tuple(found)

    @cached_property
    def _free(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Unknowns that are free, and the components for which it is these."""
        is_free = self.mesh.is_free[self.n_walls :]
        groups: dict[bytes, tuple[np.ndarray, list[int]]] = {}
        for component in range(3):
            free = self._unknowns.T @ is_free[:, component].astype(float) > 0.0
            groups.setdefault(free.tobytes(), (np.flatnonzero(free), []))[1].append(component)
        return [(ids, np.array(components)) for ids, components in groups.values() if len(ids)]

    @cached_property
    def _matrix(self) -> csr_array:
        """Matrix of the unknowns, shape (n_unknowns, n_unknowns)."""
        resting = self.lattice.evaluator(self.at_rest).matrix() @ self._unknowns
        parts = ((self._walls, self._weights), (resting, self._all_weights[self.n_walls :]))
        matrix = bending_energy(self.lattice)
        for part, weights in parts:
            matrix = matrix + part.T @ diags_array(weights) @ part
        return csr_array(matrix)

    @cached_property
    def _digits(self) -> float:
        """Correct digits of a displacement, by what elimination cancels."""
        return digits_of(EPSILON * max(factor.factor.cancellation for _, _, factor in self._systems))


@dataclass(frozen=True, eq=False)
class ThinPlateMovement(OneLine):
    """A move of a background lattice, with its derivative."""

    mover: ThinPlate
    points: np.ndarray  # (n_points, 3), moved points (m)
    report: MovementReport

    def jvp(self, d_initial: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points with those of the initial points and of the surface points."""
        ids, change = self.mover.mesh.surface_ids, d_initial.copy()
        change[self.mover.n_walls :] += self.mover.displacement(self.mover.on_walls(d_surface - d_initial[ids]))
        change[ids] = d_surface
        return change

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        ids, initial_bar = self.mover.mesh.surface_ids, bar.copy()
        of_surface = self.mover.displacement_vjp(bar[self.mover.n_walls :])[ids]
        initial_bar[ids] = -of_surface
        return initial_bar, bar[ids] + of_surface


def bending_energy(lattice: BackgroundLattice) -> csr_array:
    """Matrix of the bending energy of one component, shape (n_unknowns, n_unknowns)."""
    (x0, x1, x2), (y0, y1, y2), (z0, z1, z2) = (line.gram for line in lattice.lines)
    both = kron(y2, z0) + kron(y0, z2) + 2.0 * kron(y1, z1)
    one = 2.0 * (kron(y1, z0) + kron(y0, z1))
    return csr_array(kron(x0, both) + kron(x1, one) + kron(x2, kron(y0, z0)))
