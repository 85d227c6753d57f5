"""Mover of a background lattice: the smoothest displacement that matches the walls and rotates with them.

The displacement d of the lattice minimises

    E(d, R) = 1/2 sum_c d_c^T K d_c + 1/2 M |grad d - (R - I)|^2 + 1/2 sum_w s_w |A_w d - (w' - w)|^2 ,

    K = c sum_{a + b + c = 2} 2 / (a! b! c!) G_a (x) G_b (x) G_c ,

with the bending energy K of a thin plate [1], composed of the integrals of `.lattice_line`, the deviation of its
gradient from a rotation R (`.turned_gradients`), and the wall nodes w. R = exp([v]x) is the rotation of the walls as a
field of vectors v, which minimises E(v, I) with the walls' rotation vectors instead of w' - w. These are averaged over
spans first: at kinks of the walls, such as next to a part that moves separately, they jump from node to node, and a
field through all of them would rotate several times as far in between. So both fields have the baseline's matrix: one
factor for all designs, forward and reverse, and two solutions with it for each displacement.

Fixed nodes, such as nodes of a far field, count as walls with zero displacement. All nodes in one element of the
lattice share the weight ``stiffness``: neither the number of nodes nor any length matters. Control points on the
outside are fixed, points on planes slide and rotate about their normals, and points on sides reached by walls are free.

[1] J. Duchon, "Splines minimizing rotation-invariant semi-norms in Sobolev spaces", in Constructive Theory of Functions
of Several Variables, Lecture Notes in Mathematics 571, Springer, 1977, pp. 85-100.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, diags_array, kron

from ...base.display import OneLine
from ...base.numerics.rotation_group import turns, turns_jvp, turns_vjp
from ...base.numerics.stopwatch import working_seconds
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
from ..movement.rotation_field import SurfaceVectors, surface_rotations
from ..walls.rotations import LocalRotations
from .background_lattice import BackgroundLattice
from .lattice_frame import Directions
from .lattice_settings import DEFAULTS, LatticeSettings
from .turned_gradients import TurnedGradients

__all__ = ["ThinPlate", "ThinPlateMovement"]

EPSILON = float(np.finfo(float).eps)

BENDING = 0.2
"""Weight c of the bending energy relative to the gradients. With 0.1 cells at a deflected flap lose more volume; with 1
wings bent by 60 degrees have inverted cells."""

System = tuple[np.ndarray, np.ndarray, ScalarBlocksFactor]
"""Free unknowns, the components to which they apply, and the factor of their matrix."""


@dataclass(frozen=True, eq=False)
class ThinPlate(OneLine):
    """Moves the control points of a background lattice with the wall nodes.

    Parameters
    ----------
    mesh : MovingMesh
        Wall nodes, all or part of which are its surface, followed by the control points of the lattice.
    lattice : BackgroundLattice
        The lattice.
    at_rest : ndarray, shape (n, 3)
        Other, fixed nodes of the mesh (m).
    settings : LatticeSettings
        Settings, of which ``stiffness`` is used.

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
        """Number of wall nodes; nodes outside the surface stay."""
        return self.mesh.n_points - self.lattice.n_control

    def move(self, initial: np.ndarray, surface: np.ndarray) -> ThinPlateMovement:
        """Move points, shape (n_points, 3), with surface points, shape (n_surface, 3), both in metres."""
        start = working_seconds()
        check_request(self.mesh, initial, surface)
        points, ids = initial.copy(), self.mesh.surface_ids
        followed = self.follow(initial[ids], surface)
        points[self.n_walls :] += followed.displacement
        points[ids] = surface
        check_reach(self.mesh, initial, surface, points)
        tangling = self.mesh.tangled(points)
        solve = SolveReport("Cholesky", 0, 0.0, working_seconds() - start, self._digits)
        increment = IncrementReport(
            solve, tangling.n_tangled, tangling.place, tangling.min_corner, tangling.corner_ratio, tangling.n_invalid
        )
        report = MovementReport((increment,), working_seconds() - start, self.mesh.n_invalid)
        return ThinPlateMovement(followed, points, report)

    def follow(self, at_rest: np.ndarray, surface: np.ndarray) -> LatticeDisplacement:
        """Follow surface points from rest to new positions, both of shape (n_surface, 3)."""
        vectors = SurfaceVectors.of(self._surface, at_rest, surface)
        of_walls = self.wall_pull(self.averaged(self.axial(vectors.values)))
        at_places = self.turned.at_places(self.solved(of_walls, self.rotating))
        right = self.wall_pull(self.at_surface.local(surface - at_rest)) + self.turned.pull(turns(at_places))
        return LatticeDisplacement(self, vectors, at_places, self.in_space(self.solved(right, self.sliding)))

    def missed(self, of_surface: np.ndarray) -> np.ndarray:
        """Error of the lattice alone in displacements of the surface, shape (n_surface, 3)."""
        at_rest = self.wall_points[self.mesh.surface_ids]
        displacement = self.follow(at_rest, at_rest + of_surface).displacement
        return self.lattice.evaluator(at_rest).forward(displacement) - of_surface

    def wall_pull(self, of_surface: np.ndarray) -> np.ndarray:
        """Load of surface vectors, shape (n_surface, 3), on the unknowns; other walls stay."""
        of_walls = np.zeros((self.n_walls, 3))
        of_walls[self.mesh.surface_ids] = of_surface
        return self._walls.T @ (self._weights[:, None] * of_walls)

    def wall_pull_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `wall_pull`."""
        return (self._weights[:, None] * (self._walls @ bar))[self.mesh.surface_ids]

    def averaged(self, of_surface: np.ndarray) -> np.ndarray:
        """Average surface vectors, shape (n_surface, 3), over lengths that spans of the lattice can follow."""
        on_surface, means = self._means
        return on_surface @ (means @ of_surface)

    def averaged_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `averaged`."""
        on_surface, means = self._means
        return means.T @ (on_surface.T @ bar)

    def solved(self, right: np.ndarray, systems: tuple[System, ...]) -> np.ndarray:
        """Unknowns that balance loads, both of shape (n_unknowns, 3), zero if not free: symmetric."""
        found = np.zeros_like(right)
        for ids, components, factor in systems:
            found[np.ix_(ids, components)] = factor.solve(right[np.ix_(ids, components)])
        return found

    def in_space(self, unknowns: np.ndarray) -> np.ndarray:
        """Cartesian displacements of the control points, from the unknowns in the directions of the lattice."""
        return self.lattice.control_directions.space(self._unknowns @ unknowns)

    def in_space_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `in_space`."""
        return self._unknowns.T @ self.lattice.control_directions.local(bar)

    @cached_property
    def turned(self) -> TurnedGradients:
        """Gradients of the lattice at the places where its rotations are known."""
        return TurnedGradients(self.lattice)

    @cached_property
    def at_surface(self) -> Directions:
        """Directions of the lattice at the surface points."""
        return self.lattice.frame.directions(self.wall_points[self.mesh.surface_ids])

    def axial(self, vectors: np.ndarray) -> np.ndarray:
        """Rotation vectors of the surface, shape (n_surface, 3), in the directions of the lattice."""
        return self.lattice.frame.sign * self.at_surface.local(vectors)

    def axial_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `axial`."""
        return self.lattice.frame.sign * self.at_surface.space(bar)

    @cached_property
    def _surface(self) -> LocalRotations:
        """Local rotations at the surface points."""
        return surface_rotations(self.mesh)

    @cached_property
    def _unknowns(self) -> csr_array:
        """Control points from unknowns, shape (n_control, n_unknowns): tied points share an unknown."""
        matrix = csr_array(np.ones((1, 1)))
        for line in self.lattice.lines:
            matrix = kron(matrix, line.ties, format="csr")
        return csr_array(matrix)

    @cached_property
    def _walls(self) -> csr_array:
        """Displacements of wall nodes from the unknowns, shape (n_walls, n_unknowns)."""
        return csr_array(self.lattice.basis(self.wall_points).matrix() @ self._unknowns)

    @cached_property
    def _means(self) -> tuple[csr_array, csr_array]:
        """Values of the lattice's basis functions on the surface, and each function's mean over the surface."""
        ids = self.mesh.surface_ids
        on_surface = csr_array(self._walls[ids])
        weighted = csr_array(on_surface.T @ diags_array(self._weights[ids]))
        totals = weighted.sum(axis=1)
        return on_surface, csr_array(diags_array(1.0 / np.where(totals > 0.0, totals, 1.0)) @ weighted)

    @property
    def wall_points(self) -> np.ndarray:
        """Wall nodes on the baseline (m), shape (n_walls, 3)."""
        return self.mesh.points[: self.n_walls]

    @cached_property
    def _all_weights(self) -> np.ndarray:
        """Weights of wall nodes and of fixed nodes."""
        points = np.concatenate([self.wall_points, self.at_rest])
        element = self.lattice.elements(points)
        return self.settings.stiffness * self.lattice.refinement(points) / np.bincount(element)[element]

    @property
    def _weights(self) -> np.ndarray:
        return self._all_weights[: self.n_walls]

    @cached_property
    def sliding(self) -> tuple[System, ...]:
        """Systems for displacements."""
        return self._systems_of(self.mesh.is_free[self.n_walls :])

    @cached_property
    def rotating(self) -> tuple[System, ...]:
        """Systems for rotation vectors: a point rotates about an axis if it is free in both directions across it."""
        is_free = self.mesh.is_free[self.n_walls :]
        return self._systems_of(is_free[:, [1, 2, 0]] & is_free[:, [2, 0, 1]])

    def _systems_of(self, is_free: np.ndarray) -> tuple[System, ...]:
        """Systems for free components, shape (n_control, 3): components with the same unknowns share one."""
        groups: dict[bytes, tuple[np.ndarray, list[int]]] = {}
        for component in range(3):
            free = self._unknowns.T @ is_free[:, component].astype(float) > 0.0
            groups.setdefault(free.tobytes(), (np.flatnonzero(free), []))[1].append(component)
        found = []
        for key, (ids, components) in groups.items():
            if len(ids):
                if key not in self._factors:
                    self._factors[key] = factorize_scalars(csr_array(self._matrix[ids][:, ids]))
                found.append((ids, np.array(components), self._factors[key]))
        return tuple(found)

    @cached_property
    def _factors(self) -> dict[bytes, ScalarBlocksFactor]:
        """Factors by free unknowns: rotations and displacements share them except where planes meet."""
        return {}

    @cached_property
    def _matrix(self) -> csr_array:
        """Matrix of the unknowns, shape (n_unknowns, n_unknowns)."""
        resting = self.lattice.basis(self.at_rest).matrix() @ self._unknowns
        parts = ((self._walls, self._weights), (resting, self._all_weights[self.n_walls :]))
        matrix = BENDING * bending_energy(self.lattice) + self.turned.energy
        for part, weights in parts:
            matrix = matrix + part.T @ diags_array(weights) @ part
        return csr_array(matrix)

    @cached_property
    def _digits(self) -> float:
        """Number of correct digits of a displacement, estimated from cancellation in the elimination."""
        return digits_of(EPSILON * max(factor.factor.cancellation for _, _, factor in self.sliding + self.rotating))


@dataclass(frozen=True, eq=False)
class LatticeDisplacement(OneLine):
    """Displacement of a lattice that follows its surface, and the derivative."""

    mover: ThinPlate
    vectors: SurfaceVectors  # rotations of the surface points
    at_places: np.ndarray  # (n_places, 3), rotation vectors at the places where they are prescribed
    displacement: np.ndarray  # (n_control, 3), of the control points of the lattice (m)

    def jvp(self, d_at_rest: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the displacement from changes of the surface points at rest and moved, both (n_surface, 3)."""
        mover = self.mover
        d_vectors = self.vectors.jvp(d_at_rest, d_surface)
        d_of_walls = mover.wall_pull(mover.averaged(mover.axial(d_vectors)))
        d_at_places = mover.turned.at_places(mover.solved(d_of_walls, mover.rotating))
        right = mover.wall_pull(mover.at_surface.local(d_surface - d_at_rest))
        right += mover.turned.pull(turns_jvp(self.at_places, d_at_places))
        return mover.in_space(mover.solved(right, mover.sliding))

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`, from shape (n_control, 3)."""
        mover = self.mover
        right_bar = mover.solved(mover.in_space_vjp(bar), mover.sliding)
        by_places = turns_vjp(self.at_places, mover.turned.pull_vjp(right_bar))
        turned_bar = mover.solved(mover.turned.at_places_vjp(by_places), mover.rotating)
        by_vectors = mover.axial_vjp(mover.averaged_vjp(mover.wall_pull_vjp(turned_bar)))
        at_rest_bar, surface_bar = self.vectors.vjp(by_vectors)
        by_walls = mover.at_surface.space(mover.wall_pull_vjp(right_bar))
        return at_rest_bar - by_walls, surface_bar + by_walls


@dataclass(frozen=True, eq=False)
class ThinPlateMovement(OneLine):
    """A move of a background lattice, with its derivative."""

    followed: LatticeDisplacement
    points: np.ndarray  # (n_points, 3), moved points (m)
    report: MovementReport

    def jvp(self, d_initial: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points from changes of the initial points and of the surface points."""
        mover, change = self.followed.mover, d_initial.copy()
        ids = mover.mesh.surface_ids
        change[mover.n_walls :] += self.followed.jvp(d_initial[ids], d_surface)
        change[ids] = d_surface
        return change

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`."""
        mover, initial_bar = self.followed.mover, bar.copy()
        ids = mover.mesh.surface_ids
        at_rest_bar, surface_bar = self.followed.vjp(bar[mover.n_walls :])
        initial_bar[ids] = at_rest_bar
        return initial_bar, bar[ids] + surface_bar


def bending_energy(lattice: BackgroundLattice) -> csr_array:
    """Matrix of the bending energy of one component, shape (n_unknowns, n_unknowns)."""
    (x0, x1, x2), (y0, y1, y2), (z0, z1, z2) = (line.gram for line in lattice.lines)
    both = kron(y2, z0) + kron(y0, z2) + 2.0 * kron(y1, z1)
    one = 2.0 * (kron(y1, z0) + kron(y0, z1))
    return csr_array(kron(x0, both) + kron(x1, one) + kron(x2, kron(y0, z0)))
