"""What an outer face that follows a wall is worth: moves with it fixed, with its patch released, and as they are.

A body of revolution whose wall ends on a cone, a channel with curved ends, a wing that ends on a curved wall, and grids
of the folder that BSPLINE_MDAO_GRIDS names whose walls end on curved faces.

    python benchmarks/core/bench_following_faces.py
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

import bspline_mdao as bm
from bspline_mdao.core.fit.surface_fit import SurfaceFollower
from bspline_mdao.core.movement.mover import Mover
from bspline_mdao.core.walls.grid_map import GridMap
from bspline_mdao.core.walls.wall_correction import WallCorrection
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import QualityReport, report_quality
from bspline_mdao.grids.io.patch_guess import with_guessed_patches
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window

REAL = "cgns_5blocks.cgns", "cfl3d_sduct.bin", "cfl3d_rotorstator.fmt"
"""Grids of the folder on whose curved faces walls end; those of the last are periodic, and stay."""

MOVES = (
    "twist=2deg",
    "pitch=3deg",
    "bend=5deg",
    "sweep=3deg",
    "stretch=1.05",
    "chord=1.03",
    "thickness=1.05",
    "bumps=1cells,seed=1",
    "translate=0.01/0/0",
)
"""Modest changes of all walls."""

SIDES = "imin", "imax", "jmin", "jmax", "kmin", "kmax"


def one_block(nodes: np.ndarray, **kinds: str) -> Grid:
    """Make a grid of one block; its wall is ``kmin``, kinds of the other sides are given by their names."""
    whole = Window.whole(0, nodes.shape[:3])
    named = {"kmin": "wall", "kmax": "farfield", **kinds}
    return Grid((Block(nodes, "block 1"),), patches=tuple(
        Patch(name, named.get(name, "other"), (whole.face(side),)) for side, name in enumerate(SIDES)
    ))  # fmt: skip


def sphere_cone(shape: tuple[int, int, int] = (31, 9, 25)) -> Grid:
    """Make a sector about a sphere with a cone behind it, all lines normal to the wall, which ends on a cone."""
    arc, turn = (np.linspace(0.0, 1.0, n) for n in shape[:2])
    end, s = np.radians(80.0), (0.05 + 0.95 * arc) * (np.radians(80.0) + 2.0)
    at, along = np.minimum(s, end), np.maximum(s - end, 0.0)
    normal = np.stack([-np.cos(at), np.sin(at)], axis=-1)
    place = np.stack([1.0 - np.cos(at) + along * np.sin(end), np.sin(at) + along * np.cos(end)], axis=-1)
    spaced = np.cumsum([0.0, *1.25 ** np.arange(shape[2] - 1)])
    height = (0.4 + 0.5 * s / s[-1])[:, None] * spaced / spaced[-1]
    x, r = np.moveaxis(place[:, None] + height[..., None] * normal[:, None], -1, 0)
    turn = np.radians(40.0) * turn[None, :, None]
    nodes = [x[:, None] + 0.0 * turn, r[:, None] * np.cos(turn), r[:, None] * np.sin(turn)]
    return one_block(np.stack(nodes, axis=-1))


def channel(shape: tuple[int, int, int] = (21, 9, 17)) -> Grid:
    """Make a channel over a floor with a hump, all of whose ends and sides are curved."""
    x, y, z = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    z = z**1.8
    bulge = 0.25 * np.sin(np.pi * z / 1.5) + 0.1 * np.cos(2.0 * y)
    nodes = [2.0 * x + bulge * (2.0 * x - 1.0), y + 0.08 * np.sin(3.0 * z) * (2.0 * y - 1.0)]
    return one_block(np.stack([*nodes, z + 0.1 * np.sin(np.pi * x) * (1.0 - z)], axis=-1))


def wing_to_a_wall(shape: tuple[int, int, int] = (33, 13, 13)) -> Grid:
    """Make an O-grid about an elliptic wing between a plane of symmetry and a curved wall that does not move."""
    around, span, off = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    angle, radius = 2.0 * np.pi * around, 0.5 * 20.0**off
    x, y = radius * np.cos(angle), radius * (0.3 + 0.7 * off) * np.sin(angle)
    z = span * (3.0 + 0.4 * np.cos(0.3 * x) * np.cos(0.25 * y))
    nodes = np.stack([x, y, z], axis=-1)
    nodes[-1] = nodes[0]
    grid = one_block(nodes, jmin="symmetry")
    return replace(grid, patches=grid.patches[2:])  # imin and imax are one


def grids() -> Iterator[tuple[str, Grid]]:
    """Yield names and grids, those of the folder with guessed patches where they declare none."""
    yield "sphere-cone", sphere_cone()
    yield "channel", channel()
    yield "wing to a wall", wing_to_a_wall()
    folder = os.environ.get("BSPLINE_MDAO_GRIDS")
    for name in REAL if folder else ():
        yield name, with_guessed_patches(bm.read_grid(Path(folder) / name))


@dataclass(frozen=True, eq=False)
class Judge:
    """What moves of all walls make of the cells of a model's grid."""

    model: bm.FittedModel

    @cached_property
    def mesh(self) -> bm.movers.MovingMesh:
        """The control mesh."""
        return bm.movers.moving_mesh(self.model)

    @cached_property
    def surface(self) -> bm.measures.SurfaceGrid:
        """All walls."""
        return bm.measures.SurfaceGrid.of(self.model)

    @cached_property
    def follower(self) -> SurfaceFollower:
        """Control points of moved walls."""
        return SurfaceFollower.of(self.model, self.mesh, self.surface)

    @cached_property
    def quality(self) -> GridQuality:
        """Cells of the baseline."""
        return GridQuality.of_baseline(self.model.regenerate())

    @cached_property
    def grid_map(self) -> GridMap:
        """The map to the grid, with the walls' nodes where they are asked to be."""
        grid_map = self.model.grid_map()
        return grid_map.meeting(WallCorrection.of(self.model.topology, grid_map.nodes, self.surface.rows))

    def after(self, move: str, *movers: Mover) -> list[QualityReport]:
        """Report on the cells after a move by each mover; nothing where the move is not one of this surface."""
        planes = self.surface.on_planes(self.model)
        try:
            wall = bm.design.parse_deformation(move, self.model, self.mesh).apply_to_nodes(self.surface.points, planes)
        except bm.InputError:
            return []
        asked, reports = self.follower.at(wall).control_points, []
        for mover in movers:
            points = mover.move(self.model.control_points, asked).points
            nodes = self.grid_map.at(points, wall).nodes
            reports.append(report_quality(self.quality, nodes))
        return reports


def shown(report: QualityReport) -> str:
    """Inverted cells, smallest and mean Q."""
    return f"{report.n_inverted:5d} {report.q_min:9.1e} {report.q_mean:.4f}"


def main() -> None:
    """Print cells inverted, smallest and mean Q of all moves."""
    for name, grid in grids():
        judge = Judge(bm.fit_grid(grid))
        following = judge.mesh.following
        names = tuple(what.split("'")[1] for what, _ in following)
        fixed = bm.movers.moving_mesh(judge.model, fixed=[ids for _, ids in following])
        movers = [
            bm.movers.Rotations(mesh)
            for mesh in (fixed, bm.movers.moving_mesh(judge.model, released=names), judge.mesh)
        ]
        print(f"{name}: {', '.join(names) or 'nothing'} follows; fixed | released | as it is")
        for move in MOVES:
            reports = judge.after(move, *movers)
            print(f"    {move:22} {' | '.join(map(shown, reports)) or 'not applicable'}", flush=True)


if __name__ == "__main__":
    main()
