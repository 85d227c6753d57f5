"""How sure guesses at patches are: the cells beside a face bear witness, and what is wrong is not called sure."""

from dataclasses import replace

import numpy as np
import pytest

from bspline_mdao import find_topology, read_grid
from bspline_mdao.io.patch_certainty import how_sure
from bspline_mdao.io.patch_guess import guess_patches
from bspline_mdao.topology.grid import Block, Grid, Patch
from bspline_mdao.topology.index_space import Window


def shell(spacing):
    """A thick shell about a half cylinder on the plane y = 0, i around, j outwards, k along; a source of its own."""
    angle, radius, z = np.meshgrid(np.linspace(np.pi, 0, 13), spacing, np.linspace(-1, 2, 7), indexing="ij")
    nodes = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
    nodes[[0, -1], :, :, 1] = 0.0
    return Grid((Block(nodes, "shell"),), source="shell.xyz")


def levels(grid, faces=range(4)):
    patches = guess_patches(grid, [Window.whole(0, grid.shapes[0]).face(face) for face in faces])
    return {patch.name: certainty.level for patch, certainty in zip(patches, how_sure(grid, patches))}


def test_a_guess_is_sure_where_the_cells_beside_it_agree():
    assert levels(shell(np.geomspace(1, 30, 15))) == {"symmetry_y": "likely", "wall": "sure", "farfield": "sure"}


def test_a_guess_is_likely_where_the_cells_say_nothing():
    found = levels(shell(np.linspace(1, 30, 15)))
    assert (found["wall"], found["farfield"]) == ("likely", "likely")


def test_a_guess_is_unsure_where_the_cells_contradict_it():
    assert levels(shell(31.0 - np.geomspace(1, 30, 15)[::-1]))["farfield"] == "unsure"


def test_planes_of_a_grid_one_cell_deep_are_sure_and_finely_resolved_ones_are_not():
    grid = shell(np.geomspace(1, 30, 15))
    thin = replace(grid, blocks=(replace(grid.blocks[0], nodes=grid.blocks[0].nodes[:, :, :2]),))
    assert levels(thin, [4, 5]) == {"symmetry_z": "sure"}
    x, y, z = np.meshgrid(np.linspace(-1, 1, 9), np.geomspace(1e-3, 1, 8) - 1e-3, np.linspace(-1, 1, 7), indexing="ij")
    floor = Grid((Block(np.stack([x, y, z], axis=-1), "floor"),), source="floor.xyz")
    patch = Patch("symmetry_y", "symmetry", (Window.whole(0, (9, 8, 7)).face(2),))
    (certainty,) = how_sure(floor, [patch])
    assert certainty.level == "unsure"
    assert "as at walls" in certainty.reason


def test_the_face_that_is_least_sure_stands_for_its_patch():
    grid = shell(np.geomspace(1, 30, 15))
    inner, outer = (Window.whole(0, grid.shapes[0]).face(face) for face in (2, 3))
    (certainty,) = how_sure(grid, [Patch("wall", "wall", (inner, outer))])
    assert (certainty.level, certainty.window) == ("unsure", outer)
    assert certainty.n_windows == {"sure": 1, "likely": 0, "unsure": 1}


TRUTH = {
    "cfl3d_ejector_nozzle.p3dfmt": lambda kind, low, high: kind,
    "vtk_bluntfin.bin": lambda kind, low, high: "wall" if high[2] == 0.0 else kind,
    "pyhyp_m6_9blocks.xyz": lambda kind, low, high: kind,
    "cgns_nozzle.cgns": None,
    "mach_naca0012.cgns": None,
}
"""Kinds of faces by their boxes where guesses are right but for a few; None where the file declares them."""


@pytest.mark.slow
@pytest.mark.parametrize("name", TRUTH)
def test_what_is_sure_is_right_on_grids_of_others(real_grids, name):
    grid = read_grid(real_grids / name)
    boundary = find_topology(grid).boundary
    declared = {face.window: face.kind for face in boundary}
    patches = guess_patches(grid, [face.window for face in boundary])
    n_sure = 0
    for patch, certainty in zip(patches, how_sure(grid, patches)):
        for window in patch.windows:
            (alone,) = how_sure(grid, [replace(patch, windows=(window,))])
            nodes = grid.blocks[window.block].nodes[window.slices].reshape(-1, 3)
            tell = TRUTH[name]
            truth = tell(patch.kind, nodes.min(axis=0), nodes.max(axis=0)) if tell else declared[window]
            assert alone.level != "sure" or truth == patch.kind
            assert alone.level == "unsure" or truth == patch.kind
            n_sure += alone.level == "sure"
        assert sum(certainty.n_windows.values()) == len(patch.windows)
    assert (n_sure > 0) == (name != "cgns_nozzle.cgns")  # whose cells are all alike
