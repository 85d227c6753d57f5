"""Boundary-layer grids, deformed drastically.

Grids with boundary layers through drastic changes of shape: inverted cells, and the heights of the first cells. It
takes half a minute on a small section, and an hour for all grids of ``--paper``. The output is a row for each grid,
deformation and way to move it: inverted cells, Q, and heights of the first cells relative to the baseline; a summary, a
table of comma-separated values, and pictures of the cells at the edges of walls.
"""

from __future__ import annotations

import csv
import os
import re
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Literal

import numpy as np
from threadpoolctl import threadpool_limits

import bspline_mdao as bm
from bspline_mdao.grids import GridQuality, Patch, Window, judge_move, with_guessed_patches
from bspline_mdao.movers import WallCorrection, move_nodes
from bspline_mdao.plotting import draw_first_heights, draw_wall_cells
from bspline_mdao.scripts import run
from bspline_mdao.splines import SurfaceFollower

SECTIONS = (*(f"pitch={angle}deg" for angle in (5, 20, 45)), *(f"thickness={factor}" for factor in (1.3, 0.8, 0.7)))
"""What is asked of sections between two planes."""

WINGS = (
    *(f"twist={angle}deg" for angle in (5, 20, 45)),
    *(f"bend={angle}deg@0.5" for angle in (30, 60)),
    *(f"stretch={factor}" for factor in (1.2, 1.5)),
    *SECTIONS[3:],
    *(f"sweep={angle}deg" for angle in (20, 30)),
)
"""What is asked of wings."""

FILES = {
    **dict.fromkeys(
        ("pyhyp_m6_9blocks.xyz", "aither_rae2822.xyz", "cfl3d_naca0012_cgrid.fmt", "mach_naca0012.cgns"), ()
    ),
    "cfl3d_cylinder_ogrid.fmt": (),
    "cfl3d_delta_wing.fmt.gz": (Window(0, (8, 0, 0), (24, 32, 0)), Window(0, (8, 32, 0), (24, 64, 0))),
}
"""Files of the folder of real grids whose first cells are much longer than high, with walls that no guess finds: the
two sides of a plate without thickness."""

PICTURED = {"pyhyp_m6_9blocks.xyz": "bend=30deg@0.5", "H-H wing": "twist=20deg", "section": "pitch=20deg"}
"""Deformations that are drawn, by grid."""

COLUMNS = ("inverted", "smallest Q by that before", "mean Q gained", "98 % of heights", "all heights")
"""Columns of the table, for each way."""

NO_QUALITY = 1e-9
"""A smallest Q below this belongs to flat cells, and nothing is compared with it."""

LEVELS = {"smallest": 0.0, "one_percent": 0.01, "median": 0.5, "ninety_nine_percent": 0.99, "largest": 1.0}
"""Quantiles of the heights."""

NAN = float("nan")


@dataclass(frozen=True)
class Outcome:
    """What became of a grid: cells that were valid before count, and heights relative to those before; CPU seconds."""

    grid: str
    deformation: str
    way: str
    n_inverted: int = 0
    q_before: float = NAN
    q_min: float = NAN
    mean_before: float = NAN
    q_mean: float = NAN
    smallest: float = NAN
    one_percent: float = NAN
    median: float = NAN
    ninety_nine_percent: float = NAN
    largest: float = NAN
    seconds: float = NAN
    failure: str = ""


class Splines:
    """A grid that moves with its control mesh."""

    def __init__(self, grid: bm.Grid, mover: Callable = bm.movers.Rotations, **options):
        self.model = bm.fit_grid(grid, **options)
        self.mesh = bm.movers.moving_mesh(self.model)
        self.mover = mover(self.mesh)

    def move(self, deformation: str) -> np.ndarray:
        """Nodes of the moved grid, shape (n_nodes, 3), in metres.

        With a wall layer the nodes of the walls are where the deformation puts them, as by the command ``move``.
        """
        model, points, grid_map = self.model, self.model.control_points, self.model.grid_map()
        asked, surface = bm.design.parse_deformation(deformation, model, self.mesh), bm.measures.SurfaceGrid.of(model)
        if not model.settings.wall_layer:
            moved = self.mover.move(points, asked.apply(points[self.mesh.surface_ids])).points
            return model.regenerate(moved).to_vector().reshape(-1, 3)
        wall = asked.apply_to_nodes(surface.points, surface.on_planes(model))
        moved = self.mover.move(points, SurfaceFollower.of(model, self.mesh, surface).at(wall).control_points).points
        correction = WallCorrection.of(model.topology, grid_map.nodes, surface.rows)
        return grid_map.meeting(correction).at(moved, wall).nodes

    def off_rigid(self) -> float:
        """Turn all control points by 90 degrees: largest distance from the turned grid, relative to the grid's size."""
        turn = np.array([[4.0, -8.0, 1.0], [4.0, 1.0, -8.0], [7.0, 4.0, 4.0]]) / 9.0  # about (2, -1, 2)
        points, nodes = self.model.control_points @ turn, self.model.regenerate().to_vector().reshape(-1, 3)
        off = self.model.regenerate(points).to_vector().reshape(-1, 3) - nodes @ turn
        return float(np.linalg.norm(off, axis=1).max() / np.ptp(nodes, axis=0).max())


class WallDistances:
    """A grid all of whose nodes follow its wall nodes, to which the deformation is applied."""

    def __init__(self, grid: bm.Grid):
        self.nodes, self.model = grid.to_vector().reshape(-1, 3), bm.fit_grid(grid)

    def move(self, deformation: str) -> np.ndarray:
        """Nodes of the moved grid, shape (n_nodes, 3), in metres."""
        surface = bm.measures.SurfaceGrid.of(self.model)
        target = surface.points
        for point_map in bm.design.parse_deformation(deformation, self.model, bm.movers.moving_mesh(self.model)).maps:
            target = point_map.apply(target)
        return move_nodes(self.nodes, surface, target)


WAYS: dict[str, Callable] = {
    "least squares": partial(Splines, mover=bm.movers.LinearElasticity, method="least_squares", wall_layer=False),
    "default": Splines,
    "inverse distance": WallDistances,
}
"""Ways to move a grid: each is made of a grid and moves it by a deformation."""


def main(
    paper: bool = False,
    figures=None,
    folder: str | None = None,
    grid: Sequence[str] = (),
    patches: str | None = None,
    deform: Sequence[str] = (),
    ways: Sequence[Literal["least squares", "default", "inverse distance"]] = tuple(WAYS),
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
        Folder of real grids; the environment variable ``BSPLINE_MDAO_GRIDS`` by default, and none without it.
    grid : sequence of str
        Files to take instead.
    patches : str, optional
        Patches of these files.
    deform : sequence of str
        Deformations to use instead.
    ways : sequence of str
        Ways that are compared: all by default.
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
        is_section = all(2 in shape for shape in body.shapes)  # one cell deep
        asked = deform or ((SECTIONS if is_section else WINGS) if paper or grid else SECTIONS[:2])
        outcomes += [outcome for way in ways for outcome in Baseline(name, body).attempts(way, asked)]
    if table:
        write_table(table, outcomes)
    if figures:
        draw(figures, grids, [way for way in ways if way != "inverse distance"])
    return {
        "rows": [asdict(outcome) for outcome in outcomes],
        "summary": {way: summary([one for one in outcomes if one.way == way]) for way in ways},
        "off_rigid": {name: Splines(body).off_rigid() for name, body in grids.items()},
    }


def collect(paper: bool, folder, files: Sequence[str], patches):
    """Name the grids and make them ready, one at a time."""
    for file in files:
        yield Path(file).name, with_guessed_patches(bm.read_grid(file, patches))
    if files:
        return
    if not paper:
        spacing = bm.generators.Spacing(off_wall=1e-5, leading=5e-3, trailing=5e-3)
        yield "section", bm.generators.infinite_wing_grid(bm.generators.naca_section(), (17, 21), spacing)
        return
    for name, windows in FILES.items() if folder else ():
        real = bm.read_grid(Path(folder) / name)
        yield name, with_guessed_patches(replace(real, patches=(Patch("wall", "wall", windows),)) if windows else real)
    yield "H-H wing", bm.generators.onera_m6_grid((23, 41, 17), bm.generators.Spacing(off_wall=1e-5))
    yield "brick", bm.generators.brick_grid((13, 9, 25, 33), size=(1.0, 0.2, 3.0), far=20.0, off_wall=1e-5)
    yield (
        "H-H section",
        bm.generators.infinite_wing_grid(bm.generators.naca_section(), (33, 49), bm.generators.Spacing(off_wall=1e-6)),
    )


@dataclass(frozen=True, eq=False)
class Baseline:
    """A grid before it moves, with patches."""

    name: str
    grid: bm.Grid

    @cached_property
    def quality(self) -> GridQuality:
        """Its cells, and the heights of the first ones."""
        return GridQuality.of_baseline(self.grid)

    @cached_property
    def judged(self) -> tuple[int, float, float]:
        """Inverted cells, smallest and mean Q."""
        return judge_move(self.quality, self.grid.to_vector().reshape(-1, 3))

    def attempts(self, way: str, deformations: Sequence[str]) -> list[Outcome]:
        """Move the grid by each deformation in one way, and judge and print what comes of it."""
        cases = [Outcome(self.name, deformation, way) for deformation in deformations]
        try:
            mover = WAYS[way](self.grid)
            cases = [self.attempt(case, mover) for case in cases]
        except bm.InputError as error:
            cases = [replace(case, failure=str(error)) for case in cases]
        for case in cases:
            print(*(f"{x:.4g}" if isinstance(x, float) else x for x in asdict(case).values()), sep="  ", flush=True)
        return cases

    def attempt(self, case: Outcome, mover) -> Outcome:
        """Move the grid by one deformation, and judge what comes of it."""
        try:
            with threadpool_limits(1):
                start = time.process_time()
                nodes = mover.move(case.deformation)
                seconds = time.process_time() - start
        except (bm.InputError, bm.MovementError) as error:
            return replace(case, failure=str(error))
        _, q_before, mean_before = self.judged
        heights = np.quantile(self.quality.first_cells.ratios(nodes), list(LEVELS.values())).tolist()
        measures = {"q_before": q_before, "mean_before": mean_before, "seconds": seconds, **dict(zip(LEVELS, heights))}
        return replace(case, **measures, **judge_move(self.quality, nodes)._asdict())


def draw(folder, grids: dict[str, bm.Grid], ways: Sequence[str]) -> None:
    """Draw the edges of grids before and after a move, and the heights of their first cells."""
    ratios = {}
    for name in filter(PICTURED.get, grids):
        grid, deformation, cells = grids[name], PICTURED[name], GridQuality.of_baseline(grids[name]).first_cells
        moved = {way: WAYS[way](grid).move(deformation) for way in ways}
        ratios[f"{Path(name).stem}\n{deformation}"] = {way: cells.ratios(nodes) for way, nodes in moved.items()}
        file = f"viscous_{re.sub(r'[^a-z0-9]', '_', Path(name).stem.lower())}"
        draw_wall_cells(folder, file, grid, {"before": grid.to_vector().reshape(-1, 3)} | moved)
    draw_first_heights(folder, "viscous_heights", ratios)


def summary(cases: Sequence[Outcome]) -> dict:
    """Sum up the cases of one way."""
    done = [case for case in cases if not case.failure]
    return {
        "n_cases": len(cases),
        "n_failed": len(cases) - len(done),
        "n_valid": sum(case.n_inverted == 0 for case in done),
        "n_keep_heights": sum(case.one_percent >= 0.998 and case.ninety_nine_percent <= 1.002 for case in done),
        "smallest_height": min((case.smallest for case in done), default=np.nan),
        "seconds": sum(case.seconds for case in done),
    }


def write_table(path, outcomes: Sequence[Outcome]) -> None:
    """Write a line for each case as comma-separated values; each cell has the values of all ways in turn."""
    cases = {}
    for o in outcomes:
        ratio = f"{o.q_min / o.q_before:.2f}" if o.q_before > NO_QUALITY else "-"
        heights = f"{o.one_percent:.3f} to {o.ninety_nine_percent:.3f}", f"{o.smallest:.2f} to {o.largest:.2f}"
        cells = (f"{o.n_inverted}", ratio, f"{o.q_mean - o.mean_before:+.3f}", *heights)
        row = cases.setdefault((Path(o.grid).stem, o.deformation), [])
        row.append(["-"] * len(COLUMNS) if o.failure else cells)
    ways = " / ".join(dict.fromkeys(o.way for o in outcomes))
    with open(path, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["grid", "deformation", f"{COLUMNS[0]}: {ways}", *COLUMNS[1:]])
        writer.writerows([*case, *map(" / ".join, zip(*rows))] for case, rows in cases.items())


if __name__ == "__main__":
    run(main)

# sphinx_gallery_thumbnail_path = '_static/viscous_heights.png'
