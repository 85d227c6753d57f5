"""Overset faces: declared in files, blanked, or found by where they are."""

from dataclasses import replace

import h5py
import numpy as np
from grid_cases import smooth_grid
from overset_cases import overset_grid

from bspline_mdao import find_topology, read_grid, write_grid
from bspline_mdao.grids import Patch, Window
from bspline_mdao.grids.io.patch_guess import guess_undeclared, overlap_of
from bspline_mdao.grids.topology.grid import Block, Grid


def guessed(grid: Grid) -> dict[Window, str]:
    return {guess.window: guess.kind for guess in guess_undeclared(grid, find_topology(grid))}


def test_outer_boundaries_of_components_are_overset_and_their_walls_are_walls_though_both_lie_inside_the_box():
    grid = overset_grid(off_wall=0.02)
    bare = replace(grid, patches=grid.patches[-1:])
    kinds = guessed(bare)
    walls = {window for patch in grid.patches[:2] for window in patch.windows}
    assert {window for window, kind in kinds.items() if kind == "wall"} == walls
    assert {kind for window, kind in kinds.items() if window not in walls} == {"overset"}
    assert "12 faces of no patch inside the blocks of others" in overlap_of(bare, find_topology(bare))


def test_a_face_whose_nodes_are_blanked_as_interpolated_is_overset_for_sure():
    grid = overset_grid()
    blocks = list(grid.blocks)
    for n, block in enumerate(blocks[:12]):
        iblank = np.ones(block.shape, dtype=np.int32)
        iblank[:, :, -1] = -13
        blocks[n] = replace(block, iblank=iblank)
    blanked = replace(grid, blocks=tuple(blocks))
    guesses = guess_undeclared(blanked, find_topology(blanked))
    assert {guess.level for guess in guesses if guess.kind == "overset"} == {"sure"}
    assert "12 faces blanked as interpolated" in overlap_of(blanked, find_topology(blanked))


def test_blocks_side_by_side_that_do_not_match_do_not_overlap():
    nodes = [
        np.stack(np.meshgrid(np.linspace(x, x + 1.0, 4), np.linspace(0, 1, n), np.linspace(0, 1, n), indexing="ij"), -1)
        for x, n in ((0.0, 5), (1.0, 6))
    ]
    grid = Grid(tuple(Block(x, f"block {n}") for n, x in enumerate(nodes, 1)))
    assert "overset" not in guessed(grid).values()
    assert not overlap_of(grid, find_topology(grid))


def test_overset_patches_come_back_from_cgns_also_as_other_programs_declare_them(tmp_path):
    grid = smooth_grid()
    patches = (Patch("outside", "overset", (Window.whole(0, grid.shapes[0]).face(1),)),)
    write_grid(tmp_path / "a.cgns", replace(grid, patches=patches))
    assert read_grid(tmp_path / "a.cgns").patches == patches
    with h5py.File(tmp_path / "a.cgns", "r+") as file:  # as cgnsutilities: beside the condition, not in its family
        zone = file["Base/block 1/ZoneBC/BC1"]
        file.move("Base/outside/BCOverset", f"{zone.name}/BCOverset")
    assert read_grid(tmp_path / "a.cgns").patches == patches
