"""Small fitted grids for the tests of components and command line."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array, eye_array

from bspline_mdao.core.design.variable import Layout, MapPartials, block_diagonal
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.moving_mesh import MovingMesh
from bspline_mdao.core.mesh.surface import SurfaceGrid
from bspline_mdao.core.movement.increments import in_increments
from bspline_mdao.core.movement.interpolation import interpolated_step
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window


def two_blocks(seed: int = 0) -> Grid:
    """Two blocks of unequal sizes with one interface, bent smoothly and differently in every direction."""
    rng = np.random.default_rng(seed)
    bend = rng.uniform(-0.15, 0.15, (3, 3))
    ends = ((0.0, 1.0, 7), (1.0, 2.5, 9))
    blocks = tuple(Block(_bent(*end, bend), f"block {n}") for n, end in enumerate(ends, start=1))
    return Grid(blocks, source="two blocks")


def _bent(start: float, stop: float, n: int, bend: np.ndarray) -> np.ndarray:
    axes = np.linspace(start, stop, n), np.linspace(0.0, 1.2, 8), np.linspace(0.0, 0.9, 6)
    x = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    twisted = x + 0.002 * np.prod(x, axis=-1, keepdims=True)  # or opposite sides were copies of each other: periodic
    return twisted + np.sin(2.0 * x) @ bend + np.cos(x[..., [1, 2, 0]]) @ bend.T


def small_model(**options):
    """Fit of `two_blocks` with unequal numbers of control points."""
    return fit_grid(two_blocks(), n_control=[(4, 6, 5), (6, 6, 5)], **options)


def plain(model):
    """The same model with the linear map of Eq. (3)."""
    return replace(model, settings=replace(model.settings, wall_layer=False))


def movable_model(**options):
    """Fit of `two_blocks` above a wall."""
    grid = two_blocks()
    wall = Patch(
        "floor", "wall", tuple(Window(n, (0, 0, 0), (i - 1, j - 1, 0)) for n, (i, j, _) in enumerate(grid.shapes))
    )
    grid = Grid(grid.blocks, (wall,), grid.source)
    return fit_grid(grid, n_control=[(4, 6, 5), (6, 6, 5)], **options)


@dataclass(frozen=True)
class Shear:
    """A user's own mover: takes every point along as the mean of the surface, the less the farther off it is.

    The share is a smooth function of the initial points, so that every derivative has something to show.
    """

    mesh: MovingMesh
    n_increments: int = 2

    def move(self, initial, surface):
        return in_increments(self.mesh, self.step, initial, surface, self.n_increments)

    def step(self, initial, before, surface):
        return interpolated_step(self.mesh, before, surface, _MeanDisplacement.of(self.mesh, before, surface))


@dataclass(frozen=True)
class _MeanDisplacement:
    mesh: MovingMesh
    points: np.ndarray
    mean: np.ndarray

    @classmethod
    def of(cls, mesh, points, surface):
        return cls(mesh, points, (surface - points[mesh.surface_ids]).mean(axis=0))

    @property
    def share(self):
        return np.exp(-self.points[:, 2:])

    @property
    def values(self):
        return self.share * self.mean

    def jvp(self, d_points, d_displacement):
        return self.share * d_displacement.mean(axis=0) - d_points[:, 2:] * self.values

    def vjp(self, bar):
        points_bar = np.zeros_like(bar)
        points_bar[:, 2] = -(bar * self.values).sum(axis=1)
        n_surface = len(self.mesh.surface_ids)
        return points_bar, np.tile((self.share * bar).sum(axis=0) / n_surface, (n_surface, 1))


@dataclass(frozen=True)
class Swirl:
    """A user's own variable: turns points about z by angles that are a polynomial of the height."""

    name: str
    n_values: int
    units = "rad"
    auxiliary = ()

    def bind(self, layout):
        return self

    @property
    def initial(self):
        return np.zeros(self.n_values)

    def apply(self, points, values):
        x, y, z = points.T
        cos, sin = np.cos(self.angle(z, values)), np.sin(self.angle(z, values))
        return np.stack([cos * x - sin * y, sin * x + cos * y, z], axis=1)

    def angle(self, z, values):
        return np.vander(z, self.n_values) @ values

    def partials(self, points, values):
        x, y, _ = self.apply(points, values).T
        d_angle = np.stack([-y, x, np.zeros_like(x)], axis=1)
        d_values = d_angle[:, :, None] * np.vander(points[:, 2], self.n_values)[:, None]
        steps = 1e-40j * np.eye(3)
        blocks = np.stack([self.apply(points + step, values).imag / 1e-40 for step in steps], axis=-1)
        return MapPartials(block_diagonal(blocks), csr_array(d_values.reshape(points.size, -1)))


@dataclass(frozen=True)
class Lift:
    """A user's own variable: lifts every third row by itself."""

    name: str
    units = "m"
    auxiliary = ()

    def bind(self, layout):
        return BoundLift(layout)


@dataclass(frozen=True)
class BoundLift:
    layout: Layout

    @property
    def initial(self):
        return np.zeros(len(self.layout.points[::3]))

    @property
    def matrix(self):
        entries = np.arange(len(self.initial))
        shape = (self.layout.points.size, len(entries))
        return csr_array((np.ones(len(entries)), (9 * entries + 2, entries)), shape=shape)

    def apply(self, points, values):
        return points + (self.matrix @ values).reshape(-1, 3)

    def partials(self, points, values):
        return MapPartials(eye_array(points.size, format="csr"), self.matrix)


@dataclass(frozen=True)
class Heights:
    """A user's own measure: x z of every second node, in two rows."""

    surface: SurfaceGrid
    name = "heights"
    units = "m**2"

    @property
    def shape(self):
        return 2, len(self.surface.points[::2]) // 2

    @property
    def nodes(self):
        return 2 * np.arange(np.prod(self.shape))

    def evaluate(self, points):
        return points[self.nodes, 0] * points[self.nodes, 2]

    def partials(self, points):
        rows = np.arange(len(self.nodes))
        entries = np.concatenate([points[self.nodes, 2], points[self.nodes, 0]])
        cols = np.concatenate([3 * self.nodes, 3 * self.nodes + 2])
        return csr_array((entries, (np.tile(rows, 2), cols)), shape=(len(rows), points.size))
