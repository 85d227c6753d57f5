"""What is gained if the far field moves with the rigid part of a motion, and where it is worse.

Grids all of whose walls are deformed and whose other faces are far field and symmetry: the M6, and those of the folder
that BSPLINE_MDAO_GRIDS names.

    python benchmarks/core/bench_comoving.py
"""

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from bench_following_faces import Judge, shown

import bspline_mdao as bm
from bspline_mdao.grids.cells.report import QualityReport
from bspline_mdao.grids.io.patch_guess import with_guessed_patches

REAL = (
    "hh_naca0012_12blocks.xyz",
    "cfl3d_cylinder_ogrid.fmt",
    "aither_rae2822.xyz",
    "cfl3d_naca0012_cgrid.fmt",
    "mach_naca0012.cgns",
)
"""Grids of the folder."""

MOVES = (
    *("pitch=2deg", "pitch=10deg", "pitch=45deg", "translate=0.05/0/0"),
    *("twist=2deg", "twist=10deg", "twist=45deg", "bend=10deg", "bend=45deg", "sweep=10deg", "dihedral=5deg"),
    *("thickness=1.1", "chord=1.1", "stretch=1.2", "bumps=2cells,seed=1"),
)
"""What is asked of all walls."""

SEEN = 1e-3
"""A change of the mean Q that counts."""


def grids() -> Iterator[tuple[str, bm.Grid]]:
    """Yield names and grids."""
    yield "M6", bm.generators.onera_m6_grid((13, 15, 11))
    folder = os.environ.get("BSPLINE_MDAO_GRIDS")
    for name in REAL if folder else ():
        yield name, with_guessed_patches(bm.read_grid(Path(folder) / name))


def compared(held: QualityReport, along: QualityReport) -> str:
    """Say whether going along is better, by cells first and by the mean Q then."""
    by_cells, by_mean = held.n_inverted - along.n_inverted, along.q_mean - held.q_mean
    gain = by_cells or (by_mean if abs(by_mean) > SEEN else 0.0)
    return "better" if gain > 0 else "worse" if gain < 0 else "same"


def main() -> None:
    """Print cells inverted, smallest and mean Q of all moves, the far field held and going along."""
    counts: Counter[str] = Counter()
    for name, grid in grids():
        judge = Judge(bm.fit_grid(grid))
        mover = bm.movers.Rotations(judge.mesh)
        for move in MOVES:
            reports = judge.after(move, mover, bm.movers.ComovingFrame(mover))
            if reports:
                result = compared(*reports)
                counts[result] += 1
                print(f"{name:26} {move:20} {' | '.join(map(shown, reports))}  {result}", flush=True)
    print(dict(counts))


if __name__ == "__main__":
    main()
