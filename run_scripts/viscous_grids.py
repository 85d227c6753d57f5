"""Grids with boundary layers through drastic changes of shape: what inverts, and how high the first cells are then."""

from __future__ import annotations

import csv
import os
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from common import run
from robustness_grids import judged, with_patches
from rotating_distance import RotatingDistance
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits
from viscous_pictures import draw_edges, draw_heights

from bspline_mdao import (
    FittedModel,
    Grid,
    InputError,
    MovementError,
    Spacing,
    SurfaceGrid,
    brick_grid,
    fit_grid,
    infinite_wing_grid,
    naca_section,
    onera_m6_grid,
    read_grid,
)
from bspline_mdao.cells.first_cells import FirstCells
from bspline_mdao.cells.grid_quality import GridQuality
from bspline_mdao.design.named_deformations import parse_deformation
from bspline_mdao.mesh.boundary import moving_mesh
from bspline_mdao.mesh.moving_mesh import MovingMesh
from bspline_mdao.movement.elasticity import LinearElasticity
from bspline_mdao.topology.grid import Patch
from bspline_mdao.topology.index_space import Window
from bspline_mdao.walls.miss_spread import MissSpread

WINGS = (
    *(f"twist={angle}deg" for angle in (5, 20, 45)),
    *(f"bend={angle}deg@0.5" for angle in (30, 60)),
    *(f"stretch={factor}" for factor in (1.2, 1.5)),
    *(f"thickness={factor}" for factor in (1.3, 0.8, 0.7)),
    *(f"sweep={angle}deg" for angle in (20, 30)),
)
"""What is asked of wings."""

SECTIONS = (*(f"pitch={angle}deg" for angle in (5, 20, 45)), *(f"thickness={factor}" for factor in (1.3, 0.8, 0.7)))
"""What is asked of sections between two planes."""

FILES = (
    "pyhyp_m6_9blocks.xyz",
    "aither_rae2822.xyz",
    "cfl3d_naca0012_cgrid.fmt",
    "mach_naca0012.cgns",
    "cfl3d_cylinder_ogrid.fmt",
    "cfl3d_delta_wing.fmt.gz",
)
"""Files of the folder of real grids whose first cells are much longer than high."""

WALLS = {"cfl3d_delta_wing.fmt.gz": (Window(0, (8, 0, 0), (24, 32, 0)), Window(0, (8, 32, 0), (24, 64, 0)))}
"""Walls that no guess finds: the two sides of a plate without thickness."""

PICTURED = {"pyhyp_m6_9blocks.xyz": ("bend=30deg@0.5",), "H-H wing": ("twist=20deg",), "section": ("pitch=20deg",)}
"""Deformations that are drawn, by grid."""

COLUMNS = ("inverted", "smallest Q by that before", "mean Q gained", "99 % of heights", "all heights")
"""What is told of each way in a table."""

NO_QUALITY = 1e-9
"""A smallest Q below this is that of flat cells, and nothing is compared with it."""

LEVELS = {"smallest": 0.0, "one_percent": 0.01, "median": 0.5, "ninety_nine_percent": 0.99, "largest": 1.0}
"""What is told of the heights, as quantiles."""


@dataclass(frozen=True)
class Outcome:
    """What became of a grid.

    Parameters
    ----------
    grid, deformation, way : str
        The case.
    n_inverted : int
        Cells that were valid before the move and are not after it.
    q_before, q_min : float
        Smallest Q of the cells that were valid before, before the move and after it.
    mean_before, q_mean : float
        Mean Q of all cells, before and after.
    smallest, one_percent, median, ninety_nine_percent, largest : float
        Heights of the first cells off the wall, along its normal, by those before the move.
    seconds : float
        CPU time of the move and the new grid.
    failure : str
        Why there is no grid; "" if there is one.
    """

    grid: str
    deformation: str
    way: str
    n_inverted: int = 0
    q_before: float = float("nan")
    q_min: float = float("nan")
    mean_before: float = float("nan")
    q_mean: float = float("nan")
    smallest: float = float("nan")
    one_percent: float = float("nan")
    median: float = float("nan")
    ninety_nine_percent: float = float("nan")
    largest: float = float("nan")
    seconds: float = float("nan")
    failure: str = ""


@dataclass(frozen=True, eq=False)
class Splines:
    """A grid that moves with its control mesh.

    Parameters
    ----------
    model : FittedModel
        The fit.
    mesh : MovingMesh
        Its control mesh.
    """

    model: FittedModel
    mesh: MovingMesh

    @classmethod
    def of(cls, grid: Grid, **options) -> Splines:
        """Fit a grid."""
        model = fit_grid(grid, **options)
        return cls(model, moving_mesh(model))

    def move(self, deformation: str) -> np.ndarray:
        """Nodes of the moved grid, shape (n_nodes, 3), in metres.

        With a wall layer the nodes of the walls are where the deformation puts them, as by the command ``move``.
        """
        model, points = self.model, self.model.control_points
        asked = parse_deformation(deformation, model, self.mesh)
        moved = LinearElasticity(self.mesh).move(points, asked.apply(points[self.mesh.surface_ids])).points
        if not model.settings.wall_layer:
            return model.regenerate(moved).to_vector().reshape(-1, 3)
        surface, grid_map = SurfaceGrid.of(model), model.grid_map()
        wall = asked.apply_to_nodes(surface.points, surface.on_planes(model))
        return grid_map.at(moved, MissSpread.of(model.topology, grid_map.nodes, surface.rows), wall).nodes

    def off_rigid(self) -> float:
        """Turn all control points by 90 degrees; largest distance from the grid turned alike, by the grid's size."""
        turn = Rotation.from_rotvec(0.5 * np.pi * np.array([2.0, -1.0, 2.0]) / 3.0).as_matrix()
        points, nodes = self.model.control_points @ turn, self.model.regenerate().to_vector().reshape(-1, 3)
        off = self.model.regenerate(points).to_vector().reshape(-1, 3) - nodes @ turn
        return float(np.linalg.norm(off, axis=1).max() / np.ptp(nodes, axis=0).max())


DEFAULT = "default"
"""The way that is taken without any option."""

WAYS: dict[str, Callable] = {
    "least squares": partial(Splines.of, method="least_squares", wall_layer=False),
    DEFAULT: Splines.of,
    "inverse distance": RotatingDistance,
}
"""Ways to move a grid: each is made of a grid and moves it by a deformation."""


def main(
    paper: bool = False,
    figures=None,
    folder=None,
    grid: Sequence[str] = (),
    patches: str | None = None,
    deform: Sequence[str] = (),
    ways: Sequence[str] = tuple(WAYS),
    table: str | None = None,
) -> dict:
    """Move grids with boundary layers and see what becomes of their cells.

    Parameters
    ----------
    paper : bool
        All grids and deformations; by default a small section, pitched by 5 and 20 degrees.
    figures : path-like, optional
        Folder for pictures of leading edge, trailing edge and tip.
    folder : path-like, optional
        Where real grids are; the environment variable ``BSPLINE_MDAO_GRIDS`` by default, and none without it.
    grid : sequence of str
        Files to take instead.
    patches : str, optional
        Patches of these files.
    deform : sequence of str
        Deformations to ask for instead.
    ways : sequence of str
        Those of `WAYS` that are compared.
    table : path-like, optional
        File for a table of comma-separated values, see `write_table`.

    Returns
    -------
    dict
        ``rows``, an `Outcome` each; ``summary``: cases of each way, how many of them invert nothing, and how many keep
        their heights; ``off_rigid``: of each grid, see `Splines.off_rigid`, by the default.
    """
    grids = dict(collect(paper, folder or os.environ.get("BSPLINE_MDAO_GRIDS"), grid, patches))
    outcomes = []
    for name, body in grids.items():
        asked = deform or (requests(body) if paper or grid else SECTIONS[:2])
        for way in ways:
            found = Baseline(name, body).attempts(way, asked)
            show(found)
            outcomes += found
    if table:
        write_table(table, outcomes)
    if figures:
        draw(figures, grids, [way for way in ways if way != "inverse distance"])
    return {
        "rows": [vars(outcome) for outcome in outcomes],
        "summary": summary(outcomes),
        "off_rigid": {name: WAYS[DEFAULT](body).off_rigid() for name, body in grids.items()},
    }


def collect(paper: bool, folder, files: Sequence[str], patches):
    """Name the grids and make them ready, one at a time."""
    for file in files:
        yield Path(file).name, with_patches(read_grid(file, patches))
    if files:
        return
    if not paper:
        yield (
            "section",
            infinite_wing_grid(naca_section(), (17, 21), Spacing(off_wall=1e-5, leading=5e-3, trailing=5e-3)),
        )
        return
    for name in FILES if folder else ():
        real = read_grid(Path(folder) / name)
        if name in WALLS:
            real = replace(real, patches=(Patch("wall", "wall", WALLS[name]),))
        yield name, with_patches(real)
    yield "H-H wing", onera_m6_grid((23, 41, 17), Spacing(off_wall=1e-5))
    yield "brick", brick_grid((13, 9, 25, 33), size=(1.0, 0.2, 3.0), far=20.0, off_wall=1e-5)
    yield "H-H section", infinite_wing_grid(naca_section(), (33, 49), Spacing(off_wall=1e-6))


def requests(grid: Grid) -> tuple[str, ...]:
    """What is asked of a grid: of one that is a cell deep, what can be asked of a section."""
    return SECTIONS if all(2 in shape for shape in grid.shapes) else WINGS


@dataclass(frozen=True, eq=False)
class Baseline:
    """A grid before it moves.

    Parameters
    ----------
    name : str
        Its name.
    grid : Grid
        The grid, with patches.
    """

    name: str
    grid: Grid

    @cached_property
    def nodes(self) -> np.ndarray:
        """All nodes, shape (n_nodes, 3), in metres."""
        return self.grid.to_vector().reshape(-1, 3)

    @cached_property
    def quality(self) -> GridQuality:
        """Its cells."""
        return GridQuality.of_baseline(self.grid)

    @cached_property
    def first_cells(self) -> FirstCells:
        """The heights of its first cells."""
        return FirstCells.of_baseline(self.grid)

    @cached_property
    def judged(self) -> tuple[int, float, float]:
        """Inverted cells, smallest and mean Q."""
        return judged(self.quality, self.nodes)

    def attempts(self, way: str, deformations: Sequence[str]) -> list[Outcome]:
        """Move the grid by each deformation in one way, and judge what comes of it."""
        try:
            mover = WAYS[way](self.grid)
        except InputError as error:
            return [Outcome(self.name, deformation, way, failure=str(error)) for deformation in deformations]
        return [self.attempt(Outcome(self.name, deformation, way), mover) for deformation in deformations]

    def attempt(self, case: Outcome, mover) -> Outcome:
        """Move the grid by one deformation, and judge what comes of it."""
        try:
            with threadpool_limits(1):
                start = time.process_time()
                nodes = mover.move(case.deformation)
                seconds = time.process_time() - start
        except (InputError, MovementError) as error:
            return replace(case, failure=str(error))
        _, q_before, mean_before = self.judged
        n_inverted, q_min, q_mean = judged(self.quality, nodes)
        told = dict(zip(LEVELS, np.quantile(self.first_cells.ratios(nodes), list(LEVELS.values())).tolist()))
        told |= {"n_inverted": n_inverted, "q_min": q_min, "q_mean": q_mean, "seconds": seconds}
        return replace(case, q_before=q_before, mean_before=mean_before, **told)


def draw(folder, grids: dict[str, Grid], ways: Sequence[str]) -> None:
    """Draw the edges of grids before and after a move, and the heights of their first cells."""
    ratios = {}
    for name in filter(PICTURED.get, grids):
        grid, cells = grids[name], FirstCells.of_baseline(grids[name])
        for deformation in PICTURED[name]:
            moved = {way: WAYS[way](grid).move(deformation) for way in ways}
            ratios[f"{Path(name).stem}\n{deformation}"] = {way: cells.ratios(nodes) for way, nodes in moved.items()}
            before = {"before": grid.to_vector().reshape(-1, 3)}
            draw_edges(folder, f"viscous_{re.sub(r'[^a-z0-9]', '_', Path(name).stem.lower())}", grid, before | moved)
    draw_heights(folder, "viscous_heights", ratios)


def summary(outcomes: Sequence[Outcome]) -> dict:
    """Sum up the cases of each way."""
    found = {}
    for way in dict.fromkeys(outcome.way for outcome in outcomes):
        cases = [outcome for outcome in outcomes if outcome.way == way]
        done = [case for case in cases if not case.failure]
        found[way] = {
            "n_cases": len(cases),
            "n_failed": len(cases) - len(done),
            "n_valid": sum(case.n_inverted == 0 for case in done),
            "n_keep_heights": sum(case.one_percent >= 0.998 and case.ninety_nine_percent <= 1.002 for case in done),
            "smallest_height": min((case.smallest for case in done), default=np.nan),
            "seconds": sum(case.seconds for case in done),
        }
    return found


def show(outcomes: Sequence[Outcome]) -> None:
    """Print rows of the table."""
    for o in outcomes:
        told = o.failure or (
            f"{o.n_inverted:6d} inverted, Q {o.q_before:9.2e} -> {o.q_min:9.2e} ({o.q_min / o.q_before:5.2f}), "
            f"mean {o.mean_before:.4f} -> {o.q_mean:.4f}, heights {o.smallest:.3f} {o.one_percent:.4f} {o.median:.4f} "
            f"{o.ninety_nine_percent:.4f} {o.largest:.3f}, {o.seconds:.1f} s"
        )
        print(f"{o.grid:26s} {o.way:16s} {o.deformation:14s} {told}", flush=True)


def write_table(path, outcomes: Sequence[Outcome]) -> None:
    """Write a line for each case as comma-separated values; each cell tells of the ways in turn."""
    cases = {}
    for outcome in outcomes:
        cases.setdefault((Path(outcome.grid).stem, outcome.deformation), []).append(cells_of(outcome))
    ways = " / ".join(dict.fromkeys(outcome.way for outcome in outcomes))
    with open(path, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["grid", "deformation", f"{COLUMNS[0]}: {ways}", *COLUMNS[1:]])
        writer.writerows([*case, *map(" / ".join, zip(*rows))] for case, rows in cases.items())


def cells_of(outcome: Outcome) -> list[str]:
    """What a table tells of an outcome."""
    if outcome.failure:
        return ["-"] * len(COLUMNS)
    by_before = outcome.q_min / outcome.q_before if outcome.q_before > NO_QUALITY else np.nan
    low, high = outcome.one_percent, outcome.ninety_nine_percent
    return [
        f"{outcome.n_inverted}",
        "-" if np.isnan(by_before) else f"{by_before:.2f}",
        f"{outcome.q_mean - outcome.mean_before:+.3f}",
        f"{low:.3f} to {high:.3f}",
        f"{outcome.smallest:.2f} to {outcome.largest:.2f}",
    ]


if __name__ == "__main__":
    run(
        main,
        __doc__,
        folder={"help": "folder of real grids"},
        grid={"nargs": "+", "default": (), "metavar": "FILE", "help": "grids to take instead"},
        patches={"metavar": "FILE", "help": "patches of these grids"},
        deform={"nargs": "+", "default": (), "metavar": "SPEC", "help": "deformations to ask for instead"},
        ways={"nargs": "+", "default": tuple(WAYS), "choices": tuple(WAYS), "help": "ways that are compared"},
        table={"metavar": "FILE.csv", "help": "write a table to FILE.csv"},
    )
