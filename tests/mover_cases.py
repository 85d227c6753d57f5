"""Small meshes, large moves and what every mover must pass, for the tests of movers."""

import weakref
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from topology_cases import box, grid_of, patch

from bspline_mdao.base.sparse.cholesky import Cholesky
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_grid, moving_mesh
from bspline_mdao.generators import flat_plate_grid, onera_m6_grid
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Orientation, Window
from bspline_mdao.movers import (
    DelaunayGraph,
    FixedInterior,
    InverseDistance,
    LinearElasticity,
    RadialBasis,
    Rotations,
    TorsionalSprings,
    Transfinite,
)
from bspline_mdao.testing import central_difference


def rotation(seed=3):
    """Orthogonal matrix of determinant 1 that has no coordinate axis."""
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return q * np.sign(np.linalg.det(q))


def channel_grid(turn=None):
    """Two boxes of unequal sizes in a row, the second left-handed, above a wall and beside a symmetry plane."""
    y, z = np.linspace(0.0, 1.0, 5) ** 1.2, np.linspace(0.0, 0.8, 6) ** 1.3
    first = box(np.linspace(0.0, 1.0, 4), y, z)
    second = Orientation((1, 0, 2), (False, False, False)).apply(box(np.linspace(1.0, 2.5, 6), y, z))
    nodes = [first, second] if turn is None else [first @ turn.T, second @ turn.T]
    walls = [Window(0, (0, 0, 0), (3, 4, 0)), Window(1, (0, 0, 0), (4, 5, 0))]
    planes = [Window(0, (0, 0, 0), (3, 0, 5)), Window(1, (0, 0, 0), (0, 5, 5))]
    far = [Window(0, (0, 0, 0), (0, 4, 5)), Window(0, (0, 4, 0), (3, 4, 5)), Window(0, (0, 0, 5), (3, 4, 5))]
    far += [Window(1, (4, 0, 0), (4, 5, 5)), Window(1, (0, 5, 0), (4, 5, 5)), Window(1, (0, 0, 5), (4, 5, 5))]
    return grid_of(*nodes, patches=[patch("wall", *walls), patch("symmetry", *planes), patch("farfield", *far)])


def flare_grid(shape=(8, 5, 7), swirl=0.0):
    """A quarter of a body of revolution about x: its wall ends on a plane of symmetry and, downstream, on a cone.

    With a swirl (rad/m) the planes at the ends of the turn become curved faces of a periodic pair.
    """
    n_along, n_around, n_off = shape
    x, off = np.linspace(0.0, 2.0, n_along) ** 1.1, 0.0125 * (1.8 ** np.arange(n_off) - 1.0)
    x, turn, off = np.meshgrid(x, np.linspace(0.0, 0.5 * np.pi, n_around), off, indexing="ij")
    radius, turn = 0.5 + 0.1 * x**2 + off, turn + swirl * x
    nodes = np.stack([x * (1.0 + 0.3 * off), radius * np.cos(turn), radius * np.sin(turn)], axis=-1)
    whole, kind = Window.whole(0, shape), "other" if swirl else "symmetry"
    sides = [patch(kind, whole.face(side), name=f"side {side}") for side in (2, 3)]
    ends = [patch("symmetry", whole.face(0)), patch("other", whole.face(1), name="cone")]
    return grid_of(nodes, patches=[patch("wall", whole.face(4)), *sides, *ends, patch("farfield", whole.face(5))])


def mesh_of(grid, **options):
    """Every node of a grid as a moving mesh."""
    return moving_grid(find_topology(grid), grid.to_vector().reshape(-1, 3), **options)[0]


@cache
def channel(is_oblique=False, released=()):
    """Moving mesh of `channel_grid`, its symmetry plane in or out of the coordinate planes, its far field held."""
    fixed = () if "farfield" in released else "farfield"
    return mesh_of(channel_grid(rotation() if is_oblique else None), fixed=fixed, released=released)


def oblique_channel(released=()):
    """`channel` turned."""
    return channel(True, released)


@cache
def plate():
    """Moving mesh about a flat plate, whose two sides coincide."""
    return mesh_of(flat_plate_grid((6, 5, 7)))


@cache
def wing():
    """Control mesh about a wing: twelve blocks with unequal numbers of control points."""
    return moving_mesh(fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)))


def in_symmetry(mesh, displacement):
    """Displacement of the surface points, without what would leave a symmetry plane."""
    displacement = displacement.copy()
    for _ in range(2):  # planes that are not perpendicular would need more
        across = (displacement[mesh.in_plane_rows] * mesh.in_plane_normals).sum(axis=1)
        np.subtract.at(displacement, mesh.in_plane_rows, across[:, None] * mesh.in_plane_normals)
    return displacement


def bent_surface(mesh, size=0.15, seed=0):
    """Initial points near the baseline, and a surface bent and shifted far, that stays on symmetry planes."""
    random = np.random.default_rng(seed)
    initial = mesh.points + mesh.slide(random.normal(scale=1e-4, size=mesh.points.shape))
    x = mesh.points[mesh.surface_ids]
    extent = np.ptp(x, axis=0).max()
    modes = np.sin(x / extent @ random.uniform(-3.0, 3.0, (3, 3)) + random.uniform(0.0, 3.0, 3))
    return initial, x + in_symmetry(mesh, size * extent * modes)


def random_changes(mesh, seed=1):
    """Changes of initial points and surface along which a move may be differentiated."""
    random = np.random.default_rng(seed)
    d_initial = random.normal(size=mesh.points.shape)
    d_initial[mesh.surface_ids] = in_symmetry(mesh, d_initial[mesh.surface_ids])
    return d_initial, in_symmetry(mesh, random.normal(size=(len(mesh.surface_ids), 3)))


def assert_known_points_match(mesh, initial, surface, points):
    """Surface points are where they were asked to be, held ones stay, and all others keep what they may not change."""
    np.testing.assert_array_equal(points[mesh.surface_ids], surface)
    np.testing.assert_array_equal(points[mesh.fixed_ids], initial[mesh.fixed_ids])
    inner = np.delete(np.arange(mesh.n_points), mesh.surface_ids)
    change = points - initial
    np.testing.assert_allclose((change - mesh.slide(change))[inner], 0.0, atol=1e-15 * mesh.size)


def assert_derivative_is_transposed(movement, seed=2, tolerance=1e-11):
    """Dot test of the products with the derivative of a move and with its transpose."""
    random = np.random.default_rng(seed)
    n_surface = len(movement.surface_ids)
    d_initial, d_surface = random.normal(size=movement.points.shape), random.normal(size=(n_surface, 3))
    bar = random.normal(size=movement.points.shape)
    d_points = movement.jvp(d_initial, d_surface)
    initial_bar, surface_bar = movement.vjp(bar)
    forward, reverse = (bar * d_points).sum(), (initial_bar * d_initial).sum() + (surface_bar * d_surface).sum()
    scale = np.linalg.norm(bar) * np.linalg.norm(d_points)
    assert abs(forward - reverse) <= tolerance * scale


@dataclass(frozen=True)
class CountingSolver:
    """The default solver, with a list of the matrices that were factorised."""

    solver: object = field(default_factory=Cholesky)
    factorised: list = field(default_factory=list)
    factors: list = field(default_factory=list)
    n_alive: list = field(default_factory=list)
    """Factors that still existed at each factorisation."""

    @property
    def name(self):
        return self.solver.name

    def analyze(self, pattern, points):
        return CountingAnalysis(self.solver.analyze(pattern, points), self)


@dataclass(frozen=True)
class CountingAnalysis:
    analysis: object
    counts: CountingSolver

    def factorize(self, matrix):
        self.counts.factorised.append(matrix)
        self.counts.n_alive.append(sum(factor() is not None for factor in self.counts.factors))
        factor = self.analysis.factorize(matrix)
        self.counts.factors.append(weakref.ref(factor))
        return factor


def spacings(mesh):
    """Length of the shortest edge at every point, shape (n_points, 1)."""
    shortest = np.full((mesh.n_points, 1), np.inf)
    for ids in mesh.blocks:
        for d in range(3):
            start, end = np.moveaxis(ids, d, 0)[:-1].ravel(), np.moveaxis(ids, d, 0)[1:].ravel()
            lengths = np.linalg.norm(mesh.points[end] - mesh.points[start], axis=1)[:, None]
            lengths[lengths == 0.0] = np.inf
            np.minimum.at(shortest, start, lengths)
            np.minimum.at(shortest, end, lengths)
    return shortest


def assert_derivative_is_exact(mover, initial, surface, tolerance=1e-8, seed=1, scale=1.0, changes=random_changes):
    """Central difference of eighth order at its best step, with respect to initial points and surface in turn.

    The changes are random numbers times ``scale``, a number or one for each point. Rounding by the step is what limits
    a difference, and depends on the processor: the first step is the widest one whose own error is small for most.
    """
    movement, (d_initial, d_surface) = mover.move(initial, surface), changes(mover.mesh, seed)
    scale = np.broadcast_to(scale, (mover.mesh.n_points, 1))
    d_initial, d_surface = scale * d_initial, scale[mover.mesh.surface_ids] * d_surface
    for d_i, d_s in ((d_initial, 0.0 * d_surface), (0.0 * d_initial, d_surface)):
        exact = movement.jvp(d_i, d_s)
        steps = (1e-4, 3e-5, 1e-5, 3e-6, 2e-4)
        errors = (np.abs(_difference(mover, initial, surface, d_i, d_s, h) - exact).max() for h in steps)
        assert any(error <= tolerance * np.abs(exact).max() for error in errors)


def _difference(mover, initial, surface, d_initial, d_surface, h):
    def points(t):
        return mover.move(initial + t * d_initial, surface + t * d_surface).points

    return central_difference(points, 8.0 * h, levels=4)


def both_sides(mesh):
    """Points of the `plate` on its lower and on its upper side, in one order; at its rim they are the same."""
    return mesh.blocks[1][:, -1].ravel(), mesh.blocks[4][:, 0].ravel()


def opened(mesh, opening=0.1):
    """Surface of the `plate` whose two sides are moved apart."""
    lower, upper = both_sides(mesh)
    points = mesh.points.copy()
    points[lower[lower != upper], 1] -= opening
    points[upper[lower != upper], 1] += opening
    return points[mesh.surface_ids]


def changes_in_planes(mesh, seed):
    """Changes of initial points and surface that leave the points of the symmetry plane in it, known ones and others.

    A plane of known points that is not quite plane gains tetrahedra as flat as it is.
    """
    d_initial = np.random.default_rng(seed).uniform(-1.0, 1.0, mesh.points.shape)
    normal = mesh.in_plane_normals[0]
    is_on_plane = np.abs((mesh.points - mesh.points[mesh.surface_ids[mesh.in_plane_rows[0]]]) @ normal) < 1e-12
    d_initial[is_on_plane] -= np.outer(d_initial[is_on_plane] @ normal, normal)
    return d_initial, d_initial[mesh.surface_ids] + in_symmetry(mesh, np.ones((len(mesh.surface_ids), 3)))


def irregular(mesh, size=0.02):
    """Initial points without five of them on a sphere, so that small changes connect the graph as before."""
    return mesh.points + size * changes_in_planes(mesh, seed=4)[0]


@dataclass(frozen=True)
class MoverCase:
    """How a mover is tried.

    Attributes
    ----------
    bend, slope_bend : float
        Bends of the surface, by its extent, that it follows in three increments, and in one where it is differentiated.
    default : int or None
        Increments that it makes where nothing is said; None where it takes no number of them.
    translates : bool
        Whether everything follows a translation of the surface where the far field may.
    turns : bool
        Whether the move turns with the mesh: not where lengths are relative to its size, that of a box along the axes.
    is_graph : bool
        Whether it connects the points anew in each increment: derivatives are those of one connection, and the far
        field has to stay.
    """

    bend: float = 0.15
    slope_bend: float = 0.15
    default: int | None = 1
    translates: bool = True
    turns: bool = True
    is_graph: bool = False

    @property
    def has_increments(self):
        """Whether it takes a number of increments."""
        return self.default is not None


MOVERS = {
    LinearElasticity: MoverCase(slope_bend=0.05, default=5),
    Rotations: MoverCase(slope_bend=0.03, default=None),  # with more, some points turn by half a turn, either way
    TorsionalSprings: MoverCase(bend=0.05, slope_bend=0.05, default=5),
    Transfinite: MoverCase(),
    RadialBasis: MoverCase(translates=False, turns=False),
    InverseDistance: MoverCase(turns=False),
    DelaunayGraph: MoverCase(bend=0.03, slope_bend=0.03, translates=False, turns=False, is_graph=True),
    FixedInterior: MoverCase(translates=False),
}
"""Every mover of the package; `test_every_mover` tries all of them."""


def made(kind, mesh, n_increments):
    """Mover of a kind, with a number of increments where it takes one."""
    return kind(mesh, n_increments=n_increments) if MOVERS[kind].has_increments else kind(mesh)
