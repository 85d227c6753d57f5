"""Boundary-layer grids: common deformations.

Common moves of grids with boundary layers, compared with IDWarp for the same wall nodes. It takes half a minute on a
small section, and a quarter of an hour for all grids of ``--paper``. Wall nodes are given: by named deformations, rigid
rotations, a local bump, smooth noise of a lattice, a flap behind a sharp hinge, and an upper side that is raised on its
own. The output is a row for each grid, motion and way to move it: newly inverted cells, Q, heights of the first cells
relative to the baseline, and CPU seconds of one design; with ``--recorded`` next to figures that were recorded
elsewhere.
"""

from __future__ import annotations

import csv
import os
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline
from threadpoolctl import threadpool_limits

import bspline_mdao as bm
from bspline_mdao.design import parse_deformation
from bspline_mdao.generators import Spacing, infinite_wing_grid, naca_section, onera_m6_grid
from bspline_mdao.grids import GridQuality, judge_move, with_guessed_patches
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import ComovingFrame, LinearElasticity, Rotations, WallCorrection, mesh_frame, moving_mesh
from bspline_mdao.scripts import run
from bspline_mdao.splines import SurfaceFollower

FILES = {
    "bwb": "../strangers/pyhyp_bwb_9blocks.xyz",
    "pyhyp_m6": "pyhyp_m6_9blocks.xyz",
    "rae2822": "aither_rae2822.xyz",
    "cgrid": "cfl3d_naca0012_cgrid.fmt",
    "mach_naca": "mach_naca0012.cgns",
    "tmr_nak": "../strangers/tmr_nak_a_fine_unified_141.p3dfmt",
}
"""Real grids by their names in the table."""

EVERY = {"_coarse": 2, "_quarter": 4}
"""What stands behind the name of a real grid of which every second or fourth node is taken."""

MADE = {
    "section": partial(infinite_wing_grid, naca_section(), (17, 21), Spacing(1e-5, 5e-3, 5e-3)),
    "section_fine": partial(infinite_wing_grid, naca_section(), (41, 65), Spacing(1e-6, 2e-3, 2e-3)),
    "hh_m6": partial(onera_m6_grid, (23, 41, 17), Spacing(off_wall=1e-5)),
    "hh_m6_fine": partial(onera_m6_grid, (21, 61, 15), Spacing(off_wall=1e-6)),
}
"""Grids that are made, of a section or the ONERA M6."""

DIRECT = ("rigid=30", "rigid=90", "rigid=180", "bump", "ffd_noise", "flap", "one_sided")
"""Motions that are made of the nodes themselves, see `Body.target`."""

SECTIONS = ("pitch=5deg", "pitch=20deg", "pitch=45deg", "thickness=0.7", "thickness=1.3", "bumps", *DIRECT)
"""What is asked of sections between two planes."""

WINGS = (
    *("twist=5deg", "twist=20deg", "twist=45deg", "bend=30deg@0.5", "bend=60deg@0.5", "bend=90deg@0.5", "stretch=1.5"),
    *("thickness=0.7", "thickness=1.3", "sweep=30deg", "dihedral=15deg", "chord=0.7", "chord=1.3", "pitch=20deg"),
    *("bumps", "winglet", *DIRECT),
)
"""What is asked of wings."""

WINGLET = "bend=90deg@0.8,length=0.1"
"""The last tenth of the span stands upright behind a short arc."""

WAYS = {
    "rotations": Rotations,
    "going along": lambda mesh: ComovingFrame(Rotations(mesh)),
    "10 increments": lambda mesh: LinearElasticity(mesh, n_increments=10),
}
"""Ways to move a control mesh: by the rotations of its surface; the same with a far field that follows the
rigid part of the motion, as a warper of only the walls does; and linear elasticity."""

NAN = float("nan")


@dataclass(frozen=True)
class Row:
    """What became of a grid: cells that were valid before count, 1 % and 99 % of heights by those before."""

    grid: str
    motion: str
    way: str
    n_inverted: int = 0
    q_min: float = NAN
    q_mean: float = NAN
    p01: float = NAN
    p99: float = NAN
    seconds: float = NAN
    failure: str = ""


def main(
    paper: bool = False,
    folder: str | None = None,
    grid: Sequence[str] = (),
    motion: Sequence[str] = (),
    ways: Sequence[str] = tuple(WAYS),
    recorded: str | None = None,
    table: str | None = None,
) -> dict:
    """Move grids with boundary layers as users do.

    Parameters
    ----------
    paper : bool
        All grids and motions; by default a small section, and four motions.
    folder : path-like, optional
        Folder of real grids; the environment variable ``BSPLINE_MDAO_GRIDS`` by default.
    grid : sequence of str
        Names out of `FILES`, with an ending out of `EVERY` or none, names out of `MADE`, or files to take instead.
    motion : sequence of str
        Motions to make instead.
    ways : sequence of str
        Names out of `WAYS`; all by default.
    recorded : path-like, optional
        File of comma-separated values with rows that were recorded elsewhere, such as
        ``docs/_static/idwarp_recorded.csv``.
    table : path-like, optional
        File for all rows as comma-separated values.

    Returns
    -------
    dict
        ``rows``: a `Row` each; ``worse``: motions of each way that invert cells where no recorded way does.
    """
    folder = Path(folder or os.environ.get("BSPLINE_MDAO_GRIDS", "."))
    thinned = [name + ending for ending in EVERY for name in ("bwb", "pyhyp_m6")]
    names = grid or ([*FILES, *list(MADE)[1:], *thinned] if paper else ["section"])
    rows = [row for name in names for row in Body(name, grid_of(name, folder)).rows(motion, ways, paper or bool(grid))]
    peers = read_rows(recorded) if recorded else []
    done = {(row.grid, row.motion) for row in rows}
    fewest = {(r.grid, r.motion): r.n_inverted for r in sorted(peers, key=lambda r: -r.n_inverted)}
    worse = {way: [f"{r.grid} {r.motion}" for r in rows if r.way == way and is_worse(r, fewest)] for way in ways}
    if table:
        write_rows(table, [*rows, *(peer for peer in peers if (peer.grid, peer.motion) in done)])
    return {"rows": [asdict(row) for row in rows], "worse": worse}


def is_worse(row: Row, fewest: dict) -> bool:
    """Whether a move fails or inverts cells where none of the recorded ways does."""
    return fewest.get((row.grid, row.motion)) == 0 and bool(row.failure or row.n_inverted)


def grid_of(name: str, folder: Path) -> bm.Grid:
    """Read or make a grid, with patches: guessed where there are none."""
    if name in MADE:
        return MADE[name]()
    stem, n = next(((name.removesuffix(end), n) for end, n in EVERY.items() if name.endswith(end)), (name, 1))
    grid = bm.read_grid(folder / FILES.get(stem, name))
    if n > 1:
        grid = bm.Grid(tuple(replace(b, nodes=b.nodes[::n, ::n, ::n].copy()) for b in grid.blocks), source=name)
    return with_guessed_patches(grid)


@dataclass(eq=False)
class Body:
    """A grid, fitted, and its wall nodes in the frame of the body: along the stream, upwards, along the span (m)."""

    name: str
    grid: bm.Grid

    def __post_init__(self):
        self.model = bm.fit_grid(self.grid)
        self.mesh, self.surface = moving_mesh(self.model), SurfaceGrid.of(self.model)
        self.frame = mesh_frame(self.mesh)
        self.local = self.frame.to_local(self.surface.points)
        self.is_section = all(2 in shape for shape in self.grid.shapes)  # one cell deep

    def rows(self, motions: Sequence[str], ways: Sequence[str], is_whole: bool) -> list[Row]:
        """Make every motion in every way, and print what comes of it."""
        some = "pitch=20deg", "thickness=1.3", "flap", "rigid=90"
        motions = motions or ((SECTIONS if self.is_section else WINGS) if is_whole else some)
        quality, grid_map = GridQuality.of_baseline(self.grid), self.model.grid_map()
        follower = SurfaceFollower.of(self.model, self.mesh, self.surface)
        grid_map = grid_map.meeting(WallCorrection.of(self.model.topology, grid_map.nodes, self.surface.rows))
        found = []
        for way in ways:
            mover, start = WAYS[way](self.mesh), {}
            for motion in motions:
                wall, row = self.target(motion), Row(self.name, motion, way)
                try:
                    with threadpool_limits(1):
                        begin = time.process_time()
                        moved = mover.move(self.model.control_points, follower.at(wall).control_points, **start)
                        nodes = grid_map.at(moved.points, wall).nodes
                        seconds = time.process_time() - begin
                    start = {} if moved.start is None else {"start": moved.start}
                    heights = np.quantile(quality.first_cells.ratios(nodes), [0.01, 0.99]).tolist()
                    row = Row(self.name, motion, way, *judge_move(quality, nodes), *heights, seconds)
                except bm.MovementError as error:
                    row = replace(row, failure=str(error))
                print(*(f"{x:.4g}" if isinstance(x, float) else x for x in asdict(row).values()), sep="  ", flush=True)
                found.append(row)
        return found

    def target(self, motion: str) -> np.ndarray:
        """Wall nodes of a motion, shape (n, 3), in metres; lengths of `DIRECT` in chords of the middle of the span."""
        first, last = self.edges()
        frame, local = self.frame, self.local.copy()
        chord = float(np.diff(self.cut(0.5))[0])
        (x, _, s), along = local.T, (local[:, 0] - first) / (last - first)
        if motion.startswith("rigid"):
            angle = np.deg2rad(float(motion.partition("=")[2]))
            centre = np.array([0.25 * frame.chord, frame.middle_at(0.0)[1]])
            cos, sin = np.cos(angle), np.sin(angle)
            local[:, :2] = centre + (local[:, :2] - centre) @ [[cos, -sin], [sin, cos]]
        elif motion == "bump":  # 5 % of the chord on the upper side
            up = self.surface_normals() @ frame.axes[1] > 0.0
            middle = np.flatnonzero(up)[np.argmin(np.hypot(along - 0.5, s / frame.span - 0.5)[up])]
            across = np.zeros_like(s) if self.is_section else (s - s[middle]) / (0.25 * frame.span)
            r = np.hypot((along - along[middle]) / 0.4, across)
            local[:, 1] += np.where(up & (r < 1.0), 0.05 * chord * np.cos(0.5 * np.pi * r) ** 2, 0.0)
        elif motion == "ffd_noise":  # 1 % of the chord, of a lattice of 6 x 3 x 6 control points
            counts, low, high = (6, 3, 6), local.min(axis=0), local.max(axis=0)
            lattice = np.random.default_rng(7).standard_normal(counts)
            lattice = np.broadcast_to(lattice[:, :, :1], counts) if self.is_section else lattice
            places = (local - low) / (high - low)
            field = np.einsum("ni,nj,nk,ijk->n", *(splines(n, u) for n, u in zip(counts, places.T)), lattice)
            local[:, 1] += 0.01 * chord * field / np.abs(field).max()
        elif motion == "flap":  # the last quarter by 10 degrees
            behind, angle = np.maximum(x - first - 0.75 * (last - first), 0.0), np.deg2rad(10.0)
            local[:, :2] += np.stack([behind * (np.cos(angle) - 1.0), -behind * np.sin(angle)], axis=1)
        elif motion == "one_sided":  # half of the height above the middle of the span's line, nothing at the edges
            t, height = np.clip(along, 0.0, 1.0), local[:, 1] - frame.middle_at(s)[1]
            local[:, 1] += 8.0 * (t * (1.0 - t)) ** 2 * np.maximum(height, 0.0)
        else:
            words = {"bumps": f"bumps={0.02 * chord:.6g},seed=1,wavelength={0.5 * chord:.6g}", "winglet": WINGLET}
            asked = parse_deformation(words.get(motion, motion), self.model, self.mesh)
            return asked.apply_to_nodes(self.surface.points, self.surface.on_planes(self.model))
        shift = np.where((local == self.local).all(axis=1)[:, None], 0.0, frame.to_space(local) - self.surface.points)
        for ids, normal in self.surface.on_planes(self.model):
            shift[ids] -= np.outer(shift[ids] @ normal, normal)
        return self.surface.points + shift

    def edges(self) -> tuple[np.ndarray, np.ndarray]:
        """Leading and trailing edge, along the stream, at the span of every wall node: straight between 19 cuts."""
        if self.is_section:
            return tuple(np.full(len(self.local), edge) for edge in self.cut(0.5))
        stations, t = np.linspace(0.001, 0.9, 19), self.local[:, 2] / self.frame.span  # short of a round tip
        ends = np.array([self.cut(station) for station in stations]).T
        beyond = np.maximum(t - stations[-1], 0.0) / (stations[-1] - stations[-3])
        return tuple(np.interp(t, stations, edge) + beyond * (edge[-1] - edge[-3]) for edge in ends)

    def cut(self, station: float) -> tuple[float, float]:
        """Leading and trailing edge of the wall at a part of the span, by its quads."""
        quads, s = self.surface.quads, station * self.frame.span
        a, b = (self.local[np.concatenate([quads[:, (n + k) % 4] for n in range(4)])] for k in (0, 1))
        is_cut = (a[:, 2] - s) * (b[:, 2] - s) <= 0.0
        a, b = a[is_cut], b[is_cut]
        length = b[:, 2] - a[:, 2]
        x = a[:, 0] + np.divide(s - a[:, 2], length, out=np.zeros(len(a)), where=length != 0.0) * (b[:, 0] - a[:, 0])
        return x.min(), x.max()

    def surface_normals(self) -> np.ndarray:
        """Area vectors around every wall node."""
        quads, points, total = self.surface.quads, self.surface.points, np.zeros_like(self.surface.points)
        area = np.cross(points[quads[:, 2]] - points[quads[:, 0]], points[quads[:, 3]] - points[quads[:, 1]])
        for n in range(4):
            np.add.at(total, quads[:, n], area)
        return total


def splines(n: int, u: np.ndarray) -> np.ndarray:
    """Clamped uniform B-splines, at most cubic: values, shape (len(u), n)."""
    degree = min(3, n - 1)
    knots = np.concatenate([np.zeros(degree), np.linspace(0.0, 1.0, n - degree + 1), np.ones(degree)])
    return BSpline.design_matrix(np.clip(u, 0.0, 1.0 - 1e-14), knots, degree).toarray()


def read_rows(path) -> list[Row]:
    """Rows out of a file of comma-separated values."""
    kinds = {"n_inverted": int} | dict.fromkeys(("q_min", "q_mean", "p01", "p99", "seconds"), float)
    with open(path, newline="") as file:
        return [Row(**{k: kinds.get(k, str)(v) for k, v in line.items()}) for line in csv.DictReader(file)]


def write_rows(path, rows: Sequence[Row]) -> None:
    """Write rows, grouped by motion."""
    order = {key: n for n, key in enumerate(dict.fromkeys((row.grid, row.motion) for row in rows))}
    with open(path, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(asdict(rows[0]))
        for row in sorted(rows, key=lambda row: order[row.grid, row.motion]):
            writer.writerow(f"{x:.6g}" if isinstance(x, float) else x for x in asdict(row).values())


if __name__ == "__main__":
    run(main)
