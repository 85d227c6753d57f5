"""A report says where the worst cells are, also when none is inverted."""

import numpy as np
from mover_cases import flare_grid

from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import MOST_WORST, inverted_cells, patches_of, report_quality


def test_the_worst_cells_are_those_with_the_smallest_corners():
    grid = onera_m6_grid((9, 8, 7))
    nodes = grid.to_vector().reshape(-1, 3)
    quality = GridQuality.of_baseline(grid)
    report = report_quality(quality, nodes)
    corners = np.sort(np.concatenate([cells.min_corner.ravel() for cells in quality.cells(nodes)]))
    assert report.n_inverted == 0
    np.testing.assert_array_equal([cell.corner for cell in report.worst], corners[:MOST_WORST])
    cells = {block.name: (b, cells) for b, block, cells in zip(range(99), grid.blocks, quality.cells(nodes))}
    patches = {patch.name: patch for patch in grid.patches}
    for worst in report.worst:
        number, measures = cells[worst.block]
        at = worst.i - 1, worst.j - 1, worst.k - 1
        assert (measures.min_corner[at], measures.q[at]) == (worst.corner, worst.q)
        corners_of_cell = grid.blocks[number].nodes[tuple(slice(n, n + 2) for n in at)].reshape(-1, 3)
        np.testing.assert_allclose(worst.place, corners_of_cell.mean(axis=0), rtol=1e-14)
        if worst.patch:
            windows = [w for w in patches[worst.patch].windows if w.block == number]
            assert any(_touches(at, window) for window in windows)


def test_a_cell_that_is_made_the_worst_is_found_with_its_wall():
    grid = onera_m6_grid((9, 8, 7))
    window = next(patch for patch in grid.patches if patch.name == "wing_upper").windows[0]
    at = tuple(n // 2 for n in window.hi)
    flat = next(d for d in range(3) if window.lo[d] == window.hi[d])
    cell = tuple(
        window.lo[d] if d == flat and window.lo[d] == 0 else min(n, grid.shapes[window.block][d] - 2)
        for d, n in enumerate(at)
    )
    nodes = [block.nodes.copy() for block in grid.blocks]
    inner = tuple(c + (1 if d == flat else 0) for d, c in enumerate(cell))
    towards = tuple(c + (1 if d == (flat + 1) % 3 else 0) for d, c in enumerate(inner))
    nodes[window.block][inner] += 1.9 * (nodes[window.block][towards] - nodes[window.block][inner])
    moved = np.concatenate([x.reshape(-1, 3) for x in nodes])
    report = report_quality(GridQuality.of_baseline(grid), moved)
    found = {(cell.block, cell.patch) for cell in report.worst}
    assert report.worst[0].block == grid.blocks[window.block].name
    assert (grid.blocks[window.block].name, "wing_upper") in found


def test_cells_that_are_all_alike_are_the_first_ones():
    x = np.stack(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij"), axis=-1)
    from bspline_mdao.grids.topology.grid import Block, Grid

    grid = Grid((Block(x, "box"),))
    report = report_quality(GridQuality.of_baseline(grid), grid.to_vector().reshape(-1, 3))
    assert [(cell.i, cell.j, cell.k) for cell in report.worst[:4]] == [(1, 1, 1), (1, 1, 2), (1, 1, 3), (1, 2, 1)]
    assert not any(cell.patch for cell in report.worst)


def _touches(cell, window) -> bool:
    """Whether a cell is behind a face window."""
    return all((lo <= c < hi) if lo < hi else c in (lo, lo - 1) for c, lo, hi in zip(cell, window.lo, window.hi))


def test_an_inverted_cell_names_every_patch_on_which_it_has_a_face():
    grid = flare_grid((4, 5, 4))
    quality, nodes = GridQuality.of_baseline(grid), grid.blocks[0].nodes.copy()
    nodes[-1, 2, 1] = nodes[-3, 2, 1]  # behind the cells at the cone
    found = inverted_cells(quality, quality.cells(nodes.reshape(-1, 3)))
    first, last = ("symmetry", "side 2", "wall"), ("cone", "side 3", "farfield")
    assert found
    for cell in found:
        ends = zip((cell.i, cell.j, cell.k), (3, 4, 3), first, last)
        assert set(cell.patches) == {name for n, end, *sides in ends for name, at in zip(sides, (1, end)) if n == at}
    assert patches_of(found)[0] == "cone"
