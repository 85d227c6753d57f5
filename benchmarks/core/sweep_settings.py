"""What each setting of the fit and of the layer at walls brings, with settings halved and doubled.

Grids are those of ``bench_flow_grids.py`` with every other node, three more of the folder that BSPLINE_MDAO_GRIDS
names, and one about the M6 with a boundary layer; all of their walls are twisted, bent and given bumps. The fit is
judged by its control points, errors and elements, with one cycle of parameter correction as well, the layer by what
the moves make of the cells::

    python benchmarks/core/sweep_settings.py {fit,layer} [NAME|NAME=VALUE...] [--grids GRID...]

All settings are swept, or those that are named, or take the values that are given. For each the largest change of each
measure is printed, in per cent, with the grid where it is; a setting that changes none by 2 % of any grid is not worth
its line. Smallest Q and corners count from `LEAST_Q` on: below, cells are lost. Counts of inverted cells and invalid
elements are summed over all grids.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from bench_following_faces import Judge

import bspline_mdao as bm
from bspline_mdao.core.fit.fitting import fit_blocks
from bspline_mdao.core.fit.settings import FITTING, FittingSettings
from bspline_mdao.core.fit.validity import corner_measures
from bspline_mdao.core.walls.grid_map import GridMap
from bspline_mdao.core.walls.settings import LAYER, LayerSettings
from bspline_mdao.core.walls.wall_correction import WallCorrection
from bspline_mdao.grids.cells.first_cells import FirstCells
from bspline_mdao.grids.cells.report import report_quality

sys.path.append(str(Path(__file__).parents[1] / "flow"))
from bench_flow_grids import CASES, from_file, thinned

MOVES = "twist=10deg", "bend=30deg", "bumps=4cells,seed=1"
"""What is asked of all walls; twists and bends are none of grids that end in two planes of symmetry."""

MORE = "cfl3d_cylinder_ogrid.fmt", "cfl3d_sduct.bin", "cfl3d_rotorstator.fmt"
"""Other grids of the folder."""

LEAST_Q = 1e-3
"""Smallest Q below which a cell is lost."""

STEP = {"pyhyp_m6_9blocks.xyz": 4, "section_o_grid": 4, "aither_rae2822.xyz": 4}
"""Of the nodes that are taken, where it is not 2."""


@dataclass(frozen=True, eq=False)
class Place:
    """The model of a grid, and how each move moves its control points and walls."""

    judge: Judge
    moves: dict[str, tuple[np.ndarray, np.ndarray]]

    @classmethod
    def of(cls, grid: bm.Grid) -> Place:
        """Fit a grid, and move it in all ways."""
        judge, moves = Judge(bm.fit_grid(grid, progress=False)), {}
        mover = bm.movers.Rotations(judge.mesh)
        for move in MOVES:
            try:
                deformation = bm.design.parse_deformation(move, judge.model, judge.mesh)
                wall = deformation.apply_to_nodes(judge.surface.points, judge.surface.on_planes(judge.model))
            except bm.InputError:
                continue
            asked = judge.follower.at(wall).control_points
            moves[move] = mover.move(judge.model.control_points, asked).points, wall
        return cls(judge, moves)

    def cells(self, settings: LayerSettings) -> dict[str, float]:
        """Cells after all moves, and how well heights of first cells are kept."""
        model = self.judge.model
        found: dict[str, float] = {}
        arguments = model.topology, model.mesh, model.parameters, model.control_points, model.residual
        grid_map = GridMap.of(*arguments, model.residual_lengths, True, model.evaluator(), settings)
        grid_map = grid_map.meeting(WallCorrection.of(model.topology, grid_map.nodes, self.judge.surface.rows))
        first = FirstCells.of_baseline(model.regenerate())
        for move, (points, wall) in self.moves.items():
            nodes = grid_map.at(points, wall).nodes
            report, ratios = report_quality(self.judge.quality, nodes), first.ratios(nodes)
            found |= {
                f"{move}: mean Q": report.q_mean,
                f"{move}: smallest Q": max(report.q_min, LEAST_Q),
                f"{move}: heights": 1.0 + float(np.abs(np.log(np.abs(ratios))).max(initial=0.0)),
                f"{move}: inverted": report.n_inverted,
            }
        return found


def fitted(grid: bm.Grid, settings: FittingSettings, **options: Any) -> bm.FittedModel:
    """Fit a grid with settings that `fit_grid` does not offer."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.h5"
        fit_blocks(grid, settings=settings, progress=False, **options).save(path)
        return bm.FittedModel.load(path)


def grids(names: list[str]) -> Iterator[tuple[str, bm.Grid]]:
    """Yield names and grids, those whose names have one of these parts."""
    viscous = bm.generators.onera_m6_grid((15, 17, 13), bm.generators.Spacing(off_wall=1e-5))
    cases = {name: thinned(case.grid(), STEP.get(name, 2) if case.is_thinned else 1) for name, case in CASES.items()}
    more = {name: thinned(from_file(name), 2) for name in MORE}
    for name, grid in {"viscous M6": viscous, **cases, **more}.items():
        if not names or any(part in name for part in names):
            yield name, grid


def elements(grid: bm.Grid, settings: FittingSettings) -> dict[str, float]:
    """Control points, errors and elements of a fit, with and without parameter correction."""
    found: dict[str, float] = {}
    for label, corrections in (("plain", 0), ("corrected", 1)):
        model = fitted(grid, settings, corrections=corrections)
        corners = np.concatenate([part.ravel() for part in corner_measures(model.mesh.nets(model.control_points))])
        found |= {
            f"{label}: control points": model.report.n_control_points,
            f"{label}: RMS": float(np.linalg.norm(model.report.rms)),
            f"{label}: largest error": float(np.max(model.report.max_error)),
            f"{label}: mean corner": float(corners.mean()),
            f"{label}: smallest corner": max(float(corners.min()), LEAST_Q),
            f"{label}: invalid": model.report.n_invalid,
        }
    return found


def variants(defaults: Any, names: list[str]) -> Iterator[tuple[str, Any]]:
    """Settings that differ from the defaults in one, with a label."""
    for field in fields(defaults):
        value = getattr(defaults, field.name)
        given = [name.split("=")[1] for name in names if name.startswith(f"{field.name}=")]
        if given:
            others = [type(value)(float(other)) for other in given]
        elif isinstance(value, tuple):
            others = [tuple(factor * part for part in value) for factor in (0.5, 2.0)]
        else:
            others = [type(value)(factor * value) for factor in (0.5, 2.0)]
        for other in others if not names or field.name in names or given else ():
            yield f"{field.name} {other}", replace(defaults, **{field.name: other})


def is_count(measure: str) -> bool:
    """Whether a measure is a number of failures, zero at best."""
    return measure.endswith(("inverted", "invalid"))


def print_row(
    label: str, found: dict[str, dict[str, float]], base: dict[str, dict[str, float]], seconds: float
) -> None:
    """Print the largest change of every kind of measure."""
    changes: dict[str, tuple[float, str]] = {}
    for name, measures in found.items():
        for measure, value in measures.items():
            kind, was = measure.split(": ")[-1], base[name][measure]
            change = value - was if is_count(kind) else 100.0 * (value - was) / max(abs(was), 1e-300)
            if is_count(kind):
                changes[kind] = changes.get(kind, (0.0, ""))[0] + change, ""
            elif abs(change) >= abs(changes.get(kind, (0.0, ""))[0]):
                changes[kind] = change, f" {name}"
    texts = [f"{kind} {change:+.3g}{'' if is_count(kind) else ' %'}{at}" for kind, (change, at) in changes.items()]
    print(f"{label:24} {seconds:6.1f} s  {', '.join(t for t in texts if '+0 ' not in t) or 'nothing'}", flush=True)


def main(what: str, names: list[str], only: list[str]) -> None:
    """Print a row for each setting that is swept."""
    warnings.simplefilter("ignore")
    measure: dict[str, Callable[[Any], dict[str, float]]] = {}
    for name, grid in grids(only):
        measure[name] = partial(elements, grid) if what == "fit" else Place.of(grid).cells
    defaults = FITTING if what == "fit" else LAYER
    base = {name: measured(defaults) for name, measured in measure.items()}
    for name, measures in base.items():
        print(f"{name}: " + ", ".join(f"{kind} {value:.4g}" for kind, value in measures.items()))
    for label, settings in variants(defaults, names):
        start = time.process_time()
        found = {name: measured(settings) for name, measured in measure.items()}
        print_row(label, found, base, time.process_time() - start)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("fit", "layer"))
    parser.add_argument("names", nargs="*")
    parser.add_argument("--grids", nargs="+", default=[])
    given = parser.parse_args()
    main(given.what, given.names, given.grids)
