"""Grids, states and exact solutions for the tests of the Euler solver."""

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from topology_cases import (
    ORIENTATIONS,
    box,
    c_grid,
    grid_of,
    o_grid,
    patch,
    smooth_box,
    sphere_octants,
    split,
    two_block_plate,
)

from bspline_mdao.flow.euler.factor_pattern import factor_pattern
from bspline_mdao.flow.euler.far_field import FarVortex
from bspline_mdao.flow.euler.flow_grid import area_vectors
from bspline_mdao.flow.euler.gas import GAMMA, free_stream
from bspline_mdao.flow.euler.newton import solve_flow
from bspline_mdao.flow.euler.reconstruction import FARFIELD, FIRST, SLIP
from bspline_mdao.flow.euler.residual import Discretization
from bspline_mdao.flow.euler.sensor import OPEN, SHUT
from bspline_mdao.generators import FarField, Spacing, ball_grid, infinite_wing_grid, naca_section
from bspline_mdao.grids.cells.cell_faces import CellFaces
from bspline_mdao.grids.io.patch_guess import guess_patches
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Grid
from bspline_mdao.grids.topology.index_space import Window

AXES = np.eye(3)[[0, 2, 1]]
"""Downstream, along the span and up of the project's wing grids."""


def one_of_each_kind(nodes):
    """One block, its faces far fields at the ends of i, a wall and a symmetry plane along j, and far away along k."""
    face = Window.whole(0, nodes.shape[:3]).face
    ends = face(0), face(1), face(4), face(5)
    return grid_of(nodes, patches=[patch("farfield", *ends), patch("wall", face(2)), patch("symmetry", face(3))])


def collapsed_strip():
    """A box with a strip of faces without area."""
    nodes = box(np.arange(6.0), np.arange(5.0), np.arange(4.0))
    nodes[:, 0, 0] = nodes[:, 1, 0]
    return nodes


GRIDS = {
    "smooth box": lambda: grid_of(smooth_box(6, 5, 7)),
    "left-handed box": lambda: grid_of(smooth_box(6, 5, 7)[::-1]),
    "boxes": lambda: grid_of(*split(smooth_box(9, 7, 8), [3, 5], [4], [2, 5])),
    "one cell deep": lambda: grid_of(*split(smooth_box(9, 2, 6), [3, 6], [], [2])),
    "O-grid": lambda: grid_of(o_grid()),
    "cylinder about an axis": lambda: grid_of(o_grid(radius=0.0)),
    "pie": lambda: grid_of(*split(o_grid(radius=0.0, n_span=7), [4, 8, 12], [], [3])),
    "C-grid": lambda: grid_of(c_grid()),
    "C-grid with tip": lambda: grid_of(c_grid(span=2, n_span=6)),
    "hollow sphere": lambda: grid_of(*sphere_octants()),
    "full sphere": lambda: grid_of(*sphere_octants(inner=0.0)),
    "plate": two_block_plate,
    "collapsed strip": lambda: grid_of(collapsed_strip()),
    "all kinds": lambda: one_of_each_kind(smooth_box(6, 5, 7)),
}


@dataclass(frozen=True, eq=False)
class Case:
    """A grid and what the solver makes of it; states and directions are random but always the same."""

    nodes: np.ndarray
    discretization: Discretization
    stream: np.ndarray

    @property
    def faces(self):
        return self.discretization.faces

    @cached_property
    def areas(self):
        return area_vectors(self.nodes, self.faces.corners)

    @cached_property
    def states(self):
        """Free stream, each number changed by a tenth at most."""
        noise = np.random.default_rng(1).uniform(-0.1, 0.1, (self.faces.n_cells, 5))
        return self.discretization.uniform(self.stream) * (1.0 + noise) + 0.1 * noise[:, ::-1]

    @cached_property
    def linearization(self):
        return self.discretization.linearize(self.states, self.areas, self.stream)

    def residual(self, states=None, areas=None, stream=None):
        given = [states, areas, stream], [self.states, self.areas, self.stream]
        return self.discretization.residual(*(own if one is None else one for one, own in zip(*given)))

    @cached_property
    def pattern(self):
        return factor_pattern(self.discretization, np.linalg.norm(self.areas, axis=1))

    def solve(self, **options):
        return solve_flow(self.discretization, self.areas, self.stream, pattern=self.pattern, **options)

    def pressure_coefficients(self, states):
        """Numbers of the wall faces, and the pressure coefficients there."""
        walls, stencil = self.faces.faces_of("wall"), self.discretization.stencil
        weights = stencil.means[stencil.classes[walls]]
        pressure = np.sum(weights * states[stencil.cells[walls], 4], axis=1)
        return walls, (pressure - self.stream[4]) / (0.5 * self.stream[1:4] @ self.stream[1:4])

    def force(self, states, area):
        """Coefficient of the force on the walls."""
        walls, cp = self.pressure_coefficients(states)
        return cp @ self.areas[walls] / area


def faces_of(grid, kinds=None):
    """Faces of a grid, its patches of other kinds: one for all, or by name."""
    faces = CellFaces.of(find_topology(grid), grid.to_vector().reshape(-1, 3))
    if kinds is None:
        return faces
    new = [kinds if isinstance(kinds, str) else kinds.get(patch.name, patch.kind) for patch in faces.boundary]
    return replace(faces, boundary=tuple(replace(patch, kind=kind) for patch, kind in zip(faces.boundary, new)))


def case_of(grid, kinds=None, mach=0.3, degrees=4.0, axes=AXES, **settings):
    """Case of a grid."""
    stream = free_stream(mach, np.radians(degrees), axes)
    discretization = Discretization.of(faces_of(grid, kinds), **settings)
    return Case(grid.to_vector().reshape(-1, 3), discretization, stream)


@cache
def every_kind(shock_threshold=0.0):
    """One left-handed block with all boundary conditions, some of its faces moved together until they have no area."""
    nodes = smooth_box(6, 5, 4)[::-1]
    case = case_of(one_of_each_kind(nodes), mach=mach_of_cases(shock_threshold), shock_threshold=shock_threshold)
    moved = nodes.copy()
    moved[:, 0, 0] = moved[:, 1, 0]
    return replace(case, nodes=moved.reshape(-1, 3))


@cache
def two_cells_across(shock_threshold=0.0):
    """A block of two cells in one direction: along it third differences are zero."""
    grid = one_of_each_kind(smooth_box(6, 5, 3))
    return case_of(grid, mach=mach_of_cases(shock_threshold), shock_threshold=shock_threshold)


@cache
def turned_blocks(shock_threshold=0.0):
    """Three blocks that are permuted, one of them two cells deep, and the far field around."""
    left, middle, right = split(smooth_box(8, 4, 5), [2, 5], [], [])
    grid = grid_of(left, ORIENTATIONS[29].apply(middle), ORIENTATIONS[14].apply(right))
    return case_of(grid, "farfield", mach=mach_of_cases(shock_threshold), shock_threshold=shock_threshold)


@cache
def lifting_section(shock_threshold=0.0):
    """A section between planes of symmetry, with a vortex in the far field."""
    grid = section_grid(7, 5)
    case = case_of(grid, mach=mach_of_cases(shock_threshold), shock_threshold=shock_threshold)
    discretization = case.discretization
    seen = discretization.faces, discretization.stencil, case.nodes, AXES, discretization.halo
    return replace(case, discretization=replace(discretization, vortex=FarVortex.of(*seen)))


def section_grid(n_away, n_side, distance=5.0):
    """Grid about a section with these nodes, a chord of one and the far field at some chords."""
    return infinite_wing_grid(
        naca_section(0.12), ((n_away, n_side, n_away), n_away), Spacing(0.05, 0.05, 0.05), FarField(distance)
    )


def mach_of_cases(shock_threshold):
    """Free stream of the cases above: the gate of the sensor of shocks, if there is one, is half open."""
    return np.sqrt(0.5 * (SHUT + OPEN)) if shock_threshold else 0.3


def with_guessed_patches(grid: Grid) -> Grid:
    """Give what no patch claims the patches that its shape suggests."""
    return replace(grid, patches=guess_patches(grid, [face.window for face in find_topology(grid).boundary]))


def sphere_quarters(steps, n_sphere=24, n_off=48, far=20.0):
    """Quarters of a ball's grid with every ``step``-th node of one fine grid; half of the blocks are left-handed."""
    fine = ball_grid((n_sphere + 1, n_sphere + 1, n_sphere + 1, n_off + 1), far=far, off_wall=0.03, octant=True)
    for step in steps:
        blocks = [block.nodes[::step, ::step, ::step] for block in fine.blocks]
        patches = [_mirrored(one, step) for one in fine.patches if one.name != "symmetry_x"]
        yield grid_of(*blocks, *(nodes * [-1.0, 1.0, 1.0] for nodes in blocks), patches=patches)


def _mirrored(fine, step):
    """A patch of the octant on both sides."""
    windows = [Window(w.block, *(tuple(n // step for n in end) for end in (w.lo, w.hi))) for w in fine.windows]
    return patch(fine.kind, *windows, *(replace(w, block=w.block + 3) for w in windows), name=fine.name)


def bend(n, wave=0.1, n_span=1):
    """Quarter of an annulus between the walls r = 1 and 1.384, with wavy grid lines inside."""
    a, b, c = np.moveaxis(box(*(np.linspace(0.0, 1.0, m + 1) for m in (n, n, n_span))), -1, 0)
    bump = wave * np.sin(np.pi * a) * np.sin(np.pi * b) * (1.0 + 0.5 * np.sin(np.pi * c) * (n_span > 1))
    r, angle = 1.0 + 0.384 * (a + bump), 0.5 * np.pi * (b + 0.7 * bump)
    return np.stack([r * np.cos(angle), r * np.sin(angle), 0.4 * c], axis=-1)


def bend_grid(nodes):
    """A bend with walls, open ends, and planes of symmetry."""
    face = Window.whole(0, nodes.shape[:3]).face
    kinds = {"wall": (0, 1), "farfield": (2, 3), "symmetry": (4, 5)}
    return grid_of(nodes, patches=[patch(kind, *map(face, sides)) for kind, sides in kinds.items()])


def vortex(points, mach=0.5):
    """Isentropic vortex about z: states at points, the Mach number that of the speed at r = 1."""
    x, y, _ = points.T
    r = np.hypot(x, y)
    rho = (1.0 + 0.5 * (GAMMA - 1.0) * mach**2 * (1.0 - 1.0 / r**2)) ** (1.0 / (GAMMA - 1.0))
    return np.stack([rho, -mach * y / r**2, mach * x / r**2, 0.0 * r, rho**GAMMA / GAMMA], axis=1)


def cell_centres(nodes):
    """Mean of the corners of the cells of a block."""
    for axis in range(3):
        low, high = ([slice(None)] * 3 for _ in range(2))
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        nodes = 0.5 * (nodes[tuple(low)] + nodes[tuple(high)])
    return nodes.reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class OpenEnds(Discretization):
    """A far field whose faces have states of their own on them, and take those inside from two cells.

    The flux of the solver's far field is kept.
    """

    ends: np.ndarray | None = None

    @classmethod
    def around(cls, faces, ends):
        """Take the states, shape (n_faces, 5), where the far field's faces are."""
        plain = Discretization.of(faces)
        means, differences = plain.stencil.means.copy(), plain.stencil.differences.copy()
        (far,) = np.unique(plain.stencil.lines[plain.stencil.roles == FARFIELD])
        means[far, :2], differences[far, FIRST, :2] = (-0.25, 0.75), (0.5, -1.5)
        return cls(faces, replace(plain.stencil, means=means, differences=differences), ends=ends)

    def outside(self, states, areas, stream):
        return self.ends


def slip_faces(case):
    """Numbers of the faces of walls and symmetry planes."""
    return np.flatnonzero(case.discretization.stencil.roles == SLIP)
