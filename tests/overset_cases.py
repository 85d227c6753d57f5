"""Component grids that overlap: two balls in their own grids, which lie in a box of cells."""

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


def blocks_model(grid: Grid) -> MeshModel:
    """Blocks, joined or overlapping, that one lattice moves."""
    marked = marked_grid(grid)
    return MeshModel.of(marked.mesh, {name: guess.kind for name, guess in marked.kinds.items()}, LatticeSettings(0.5))
