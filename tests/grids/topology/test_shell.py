"""Shells of blocks: what the topology of a grid is found from."""

from dataclasses import replace

import numpy as np
import pytest
from topology_cases import c_grid, grid_of, o_grid, smooth_box, twelve_block_plate

from bspline_mdao import open_grid, write_grid
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Window, face_layers
from bspline_mdao.grids.topology.shell import OnFaces, Shell


@pytest.mark.parametrize("shape", [(4, 5, 6), (2, 3, 4), (1, 5, 4), (3, 1, 1)])
def test_windows_of_faces_are_those_of_the_block(shape):
    nodes = np.random.default_rng(1).normal(size=(*shape, 3))
    shell, whole = Shell.of(nodes), Window.whole(0, shape)
    labels = np.random.default_rng(2).integers(0, 99, len(shell.points))
    on_faces = OnFaces(shell.nodes, labels, -1)
    for face in (face for face in range(6) if shape[face // 2] > 1):
        window = whole.face(face)
        np.testing.assert_array_equal(shell.at(window), nodes[window.slices])
        np.testing.assert_array_equal(on_faces.at(window), on_faces.dense()[window.slices])
        np.testing.assert_array_equal(on_faces.face(face), on_faces.at(window).squeeze(face // 2))
        if shape[face // 2] > 1 and window.shape.index(1) == face // 2:
            for one, other in zip(shell.layers(window), face_layers(nodes, window)):
                np.testing.assert_array_equal(one, other)
    inside = on_faces.dense()[tuple(slice(1, -1) if n > 1 else slice(None) for n in shape)]
    assert (inside == -1).all() or 1 in shape


def test_a_shell_is_a_small_part_of_a_block():
    nodes = smooth_box(60, 60, 60)
    shell = Shell.of(nodes)
    arrays = [shell.points, shell.nodes.numbers, shell.samples, *shell.inner_layers]
    assert sum(array.nbytes for array in arrays) < 0.25 * nodes.nbytes


@pytest.mark.parametrize("suffix", ["xyz", "cgns"])
@pytest.mark.parametrize("make", [c_grid, o_grid, twelve_block_plate])
def test_a_grid_in_a_file_has_the_topology_of_one_in_memory(make, suffix, tmp_path):
    grid = make()
    grid = grid if hasattr(grid, "blocks") else grid_of(grid)
    write_grid(tmp_path / f"grid.{suffix}", grid)
    found = find_topology(replace(open_grid(tmp_path / f"grid.{suffix}"), patches=grid.patches, connections=()))
    assert found == replace(find_topology(grid), source=found.source)
