"""Component grids that overlap: two balls, two cylinders, a wing on a body, each in a box of cells."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.generators import ball_grid
from bspline_mdao.grids import Patch, Window
from bspline_mdao.grids.io.meshes.blocks import marked_grid
from bspline_mdao.grids.topology.grid import Block, Grid

CENTRES = ((-0.8, 0.0, 0.0), (0.9, 0.3, 0.1))
RADII = (0.5, 0.35)


def component(number: int, shape: Sequence[int], off_wall: float | None) -> Grid:
    """Grid of six blocks around a ball, with a wall and an open outer boundary."""
    grid = ball_grid(tuple(shape), far=2.0, off_wall=off_wall)
    nodes = [RADII[number] * block.nodes + CENTRES[number] for block in grid.blocks]
    blocks = tuple(Block(x, f"ball {number + 1} block {n}") for n, x in enumerate(nodes, start=1))
    wall = next(patch for patch in grid.patches if patch.kind == "wall")
    return replace(grid, blocks=blocks, patches=(replace(wall, name=f"ball_{number + 1}"),))


def overset_grid(n: int = 5, n_background: int = 13, off_wall: float | None = None) -> Grid:
    """Both balls and the box, whose sides are a far field; outer boundaries of the balls' grids are undeclared."""
    parts = [component(0, (n, n, n, n + 1), off_wall), component(1, (n - 1, n - 1, n - 1, n), off_wall)]
    axes = [np.linspace(-size, size, n_background + extra) for size, extra in ((3.0, 4), (2.5, 0), (2.4, 1))]
    box = Block(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), "box")
    blocks: list[Block] = []
    patches: list[Patch] = []
    for part in parts:
        for patch in part.patches:
            windows = tuple(replace(w, block=w.block + len(blocks)) for w in patch.windows)
            patches.append(replace(patch, windows=windows))
        blocks += part.blocks
    whole = Window.whole(len(blocks), box.shape)
    far = Patch("far", "farfield", tuple(whole.face(side) for side in range(6)))
    return Grid((*blocks, box), (*patches, far), source="balls")


def two_cylinders() -> Grid:
    """Two cylinders between planes of symmetry, each in a ring of cells, which lie in a box: three blocks."""
    angles = np.linspace(0.0, -2.0 * np.pi, 25)
    angles[-1] = 0.0
    axes = np.linspace(-3.0, 3.0, 22), np.linspace(-2.0, 2.0, 17), np.array([0.0, 1.0])
    blocks: list[Block] = []
    patches: list[Patch] = []
    for name, radius, (x, y) in (("section", 0.5, (-0.7, 0.0)), ("flap", 0.3, (0.6, -0.2))):
        radii = np.geomspace(radius, 2.0 * radius, 9)
        theta, r, z = np.meshgrid(angles, radii, axes[2], indexing="ij")
        blocks.append(Block(np.stack([x + r * np.cos(theta), y + r * np.sin(theta), z], axis=-1), name))
        patches.append(Patch(name, "wall", (Window.whole(len(blocks) - 1, theta.shape).face(2),)))
    blocks.append(Block(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), "box"))
    wholes = [Window.whole(n, block.shape) for n, block in enumerate(blocks)]
    patches.append(Patch("far", "farfield", tuple(wholes[2].face(side) for side in range(4))))
    patches.append(Patch("sides", "symmetry", tuple(whole.face(side) for whole in wholes for side in (4, 5))))
    return Grid(tuple(blocks), tuple(patches), source="cylinders")


WING, LENGTH = (0.5, 0.15, 1.5), 5.0
"""Half axes of a wing, half an ellipsoid, and the length of the body that it is on (m), a half cylinder of radius 1."""


def wing_on_body() -> Grid:
    """A wing on a body: a grid with a collar on the body, in five blocks, one around the body, and a box (m)."""
    blocks: list[Block] = []
    of_wing: list[Window] = []
    of_collar: list[Window] = []
    for ball in ball_grid((9, 9, 9, 8), far=2.0, off_wall=4e-3).blocks:
        is_above = ball.nodes[..., 2] > -1e-9
        x = ball.nodes[np.ix_(*(np.flatnonzero(is_above.any(axis=axes)) for axes in ((1, 2), (0, 2), (0, 1))))]
        if not x.size:
            continue
        r = np.linalg.norm(x, axis=-1, keepdims=True)
        along, around, out = np.moveaxis(x / r * (np.array(WING) + 0.5 * (r - 1.0)), -1, 0)
        out = 1.0 + np.where(np.abs(out) < 1e-12, 0.0, out)
        nodes = np.stack([along, out * np.sin(around), out * np.cos(around)], axis=-1)
        for face in (Window.whole(len(blocks), x.shape[:3]).face(side) for side in range(6)):
            if np.allclose(r[face.slices], 1.0):
                of_wing.append(face)
            if np.all(out[face.slices] == 1.0):
                of_collar.append(face)
        blocks.append(Block(nodes, f"wing {len(blocks) + 1}"))
    ends = np.array([-0.5, 0.5]) * LENGTH
    radii = np.concatenate([[1.0], 1.0 + 2e-3 * np.cumsum(1.6 ** np.arange(11)), [1.9]])
    along, angle, r = np.meshgrid(
        np.linspace(*ends, 31), np.linspace(-0.5 * np.pi, 0.5 * np.pi, 21), radii, indexing="ij"
    )
    out = r * np.cos(angle)
    out[:, [0, -1]] = 0.0
    blocks.append(Block(np.stack([along, r * np.sin(angle), out], axis=-1), "body"))
    axes = np.linspace(*ends, 15), np.linspace(-3.0, 3.0, 12), np.linspace(0.0, 4.5, 11)
    blocks.append(Block(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1), "box"))
    body, box = (Window.whole(number, blocks[number].shape) for number in (5, 6))
    far = *(body.face(side) for side in (0, 1)), *(box.face(side) for side in (0, 1, 2, 3, 5))
    patches = [Patch("wing", "wall", tuple(of_wing)), Patch("collar", "wall", tuple(of_collar))]
    patches += [Patch("body", "wall", (body.face(4),)), Patch("far", "farfield", far)]
    patches.append(Patch("plane", "symmetry", (body.face(2), body.face(3), box.face(4))))
    return Grid(tuple(blocks), tuple(patches), source="wing on a body")


def blocks_model(grid: Grid) -> MeshModel:
    """Blocks, joined or overlapping, that one lattice moves."""
    marked = marked_grid(grid)
    return MeshModel.of(marked.mesh, {name: guess.kind for name, guess in marked.kinds.items()}, LatticeSettings(0.5))
