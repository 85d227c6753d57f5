"""Damaged files: each is read rightly or refused in one line, in bounded time and memory."""

import gzip
import time
import tracemalloc
import warnings

import numpy as np
import pytest
from fuzz_cases import N_MUTATIONS, mutate
from grid_cases import smooth_grid

from bspline_mdao.errors import InputError
from bspline_mdao.grids.io.cgns import write_cgns
from bspline_mdao.grids.io.files import read_grid
from bspline_mdao.grids.io.patch_guess import draft_patches
from bspline_mdao.grids.io.patches import read_patches
from bspline_mdao.grids.io.plot3d import write_plot3d
from bspline_mdao.grids.io.plot3d_dialect import Plot3dDialect
from bspline_mdao.grids.topology.grid import Grid, Patch
from bspline_mdao.grids.topology.index_space import Window

pytestmark = pytest.mark.slow

SECONDS = 5.0
PEAK_BYTES = 200e6

DIALECTS = [
    Plot3dDialect("ascii"),
    Plot3dDialect("ascii", n_dimensions=2, has_iblank=True),
    Plot3dDialect("fortran", ">", 4, has_iblank=True),
    Plot3dDialect("fortran", marker_bytes=8, records="plane", layout="planes"),
    Plot3dDialect("raw"),
    Plot3dDialect("raw", ">", 4, has_block_count=False),
    Plot3dDialect("raw", compression="gzip"),
    Plot3dDialect("raw", compression="xz"),
    Plot3dDialect("fortran", header="joined", has_iblank=True),
    Plot3dDialect("raw", header="spread", integer_bytes=8),
]

NMF = b"""2
1 4 5 6
2 6 4 5
'wall 1'    1 1  1 4  1 5
SYMMETRY-Y  1 5  1 6  1 4
ONE-TO-ONE  1 1  1 4  1 5  1 1  1 4  1 5  FALSE
"""


def assert_read_or_refused(read, path):
    """Run one case; give whether it was read."""
    start = time.perf_counter()
    try:
        grid = read(path)
    except InputError as error:
        message = str(error)
        assert message.count("\n") == 0, message
        assert len(message) < 600
        assert str(path) in message
        return False
    finally:
        assert time.perf_counter() - start < SECONDS
    assert isinstance(grid, Grid)
    assert np.isfinite(grid.to_vector()).all()
    for patch in grid.patches:
        for window in patch.windows:
            shape = grid.shapes[window.block]
            assert all(0 <= lo <= hi < n for lo, hi, n in zip(window.lo, window.hi, shape))
    return True


def check_mutations(read, data, path, seed, compress=bytes):
    """Try mutations of ``data``; neither all nor none of them may be readable."""
    random = np.random.default_rng(seed)
    n_read = 0
    tracemalloc.start()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(N_MUTATIONS):
            path.write_bytes(compress(mutate(data, random)))
            n_read += assert_read_or_refused(read, path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < PEAK_BYTES
    assert n_read < N_MUTATIONS
    return n_read


@pytest.mark.parametrize("dialect", DIALECTS, ids=str)
def test_damaged_plot3d_is_read_or_refused_in_one_line(tmp_path, dialect):
    shapes = ((4, 5, 6), (6, 4, 5)) if dialect.n_dimensions == 3 else ((5, 7, 1), (6, 4, 1))
    grid = smooth_grid(shapes if dialect.has_block_count else shapes[:1], dialect.n_dimensions, dialect.has_iblank)
    write_plot3d(tmp_path / "grid", grid, dialect)
    check_mutations(read_grid, (tmp_path / "grid").read_bytes(), tmp_path / "grid", 1)


def test_damaged_grid_in_a_sound_gzip_file_is_read_or_refused_in_one_line(tmp_path):
    write_plot3d(tmp_path / "grid", smooth_grid(), Plot3dDialect("raw"))
    check_mutations(
        read_grid, (tmp_path / "grid").read_bytes(), tmp_path / "grid", 2, compress=lambda data: gzip.compress(data, 1)
    )


def test_damaged_cgns_is_read_or_refused_in_one_line(tmp_path):
    grid = smooth_grid()
    patches = (Patch("wing", "wall", (Window.whole(0, grid.shapes[0]).face(0),)),)
    write_cgns(tmp_path / "grid", Grid(grid.blocks, patches))
    assert check_mutations(read_grid, (tmp_path / "grid").read_bytes(), tmp_path / "grid", 3) > 0


@pytest.mark.parametrize("kind", ["toml", "nmf"])
def test_damaged_patches_file_is_read_or_refused_in_one_line(tmp_path, kind):
    grid = smooth_grid()
    whole = [Window.whole(block, shape) for block, shape in enumerate(grid.shapes)]
    patches = (
        Patch("wing", "wall", (whole[0].face(0), Window(1, (1, 0, 0), (5, 0, 2)))),
        Patch("far", "farfield", (whole[1].face(5),)),
    )
    data = NMF if kind == "nmf" else draft_patches(grid, patches).encode() + b'[kinds]\n"*" = "wall"\n'
    window = Patch("old", "other", (whole[1].face(0),))
    grid = Grid(grid.blocks, () if kind == "nmf" else (window,))
    assert check_mutations(lambda path: read_patches(path, grid), data, tmp_path / "patches", 4) > 0
