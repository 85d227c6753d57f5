"""Fields of cells: quality, height at walls, block and patch."""

import numpy as np
import pytest

from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.cell_fields import cell_fields
from bspline_mdao.grids.cells.grid_quality import GridQuality


@pytest.fixture(scope="module")
def grid():
    return onera_m6_grid((7, 6, 5))


@pytest.fixture(scope="module")
def fields(grid):
    return cell_fields(grid)


def test_quality_is_that_of_the_report(grid, fields):
    quality = GridQuality.of_baseline(grid)
    for number, cells in enumerate(quality.cells(grid.to_vector().reshape(-1, 3))):
        np.testing.assert_array_equal(fields["Q"][number], cells.q)
        np.testing.assert_array_equal(fields["smallest_corner"][number], cells.min_corner)
        assert (fields["block"][number] == number + 1).all()


def test_heights_are_behind_walls_alone_and_lie_between_those_of_the_nodes(grid, fields):
    first = GridQuality.of_baseline(grid).first_cells
    heights = first.heights(grid.to_vector().reshape(-1, 3))
    n_faces = 0
    for patch in grid.patches:
        for window in patch.windows if patch.kind == "wall" else ():
            own = fields["wall_height"][window.block]
            low = [
                lo if lo < hi else min(lo, n - 2) for lo, hi, n in zip(window.lo, window.hi, grid.shapes[window.block])
            ]
            high = [hi if lo < hi else at + 1 for lo, hi, at in zip(window.lo, window.hi, low)]
            part = own[tuple(slice(*ends) for ends in zip(low, high))]
            assert np.isfinite(part).all()
            assert heights.min() <= part.min() <= part.max() <= heights.max()
            n_faces += part.size
    assert sum(np.isfinite(own).sum() for own in fields["wall_height"]) == n_faces > 0


def test_a_cell_at_a_wall_and_a_plane_of_symmetry_counts_for_the_wall(grid, fields):
    numbers = {patch.name: number for number, patch in enumerate(grid.patches, 1)}
    wall = next(patch for patch in grid.patches if patch.name == "wing_upper").windows[0]
    plane = next(
        w for patch in grid.patches if patch.kind == "symmetry" for w in patch.windows if w.block == wall.block
    )
    found = fields["patch"][wall.block]
    flat = next(d for d in range(3) if plane.lo[d] == plane.hi[d])
    at_plane = np.take(found, 0 if plane.lo[flat] == 0 else -1, axis=flat)
    assert {numbers["wing_upper"], numbers["symmetry"]} <= set(np.unique(at_plane).tolist())
    assert 0 in found
