"""How sure guesses at patches are: the cells beside a face bear witness, and what is wrong is not called sure."""

from dataclasses import replace

import numpy as np
import pytest

from bspline_mdao import find_topology, read_grid
from bspline_mdao.grids.io.patch_certainty import FaceGuess, how_sure, judge_place, judge_symmetry
from bspline_mdao.grids.io.patch_guess import guess_faces
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.grids.topology.index_space import Window


def shell(spacing):
    """A thick shell about a half cylinder on the plane y = 0, i around, j outwards, k along; a source of its own."""
    angle, radius, z = np.meshgrid(np.linspace(np.pi, 0, 13), spacing, np.linspace(-1, 2, 7), indexing="ij")
    nodes = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
    nodes[[0, -1], :, :, 1] = 0.0
    return Grid((Block(nodes, "shell"),), source="shell.xyz")


def levels(grid, faces=range(4)):
    guesses = guess_faces(grid, [Window.whole(0, grid.shapes[0]).face(face) for face in faces])
    return {guess.name: guess.level for guess in guesses}


def test_a_guess_is_sure_where_the_cells_beside_it_agree():
    assert levels(shell(np.geomspace(1, 30, 15))) == {"symmetry_y": "likely", "wall": "sure", "farfield": "sure"}


def test_a_guess_is_likely_where_the_cells_say_nothing():
    found = levels(shell(np.linspace(1, 30, 15)))
    assert (found["wall"], found["farfield"]) == ("likely", "likely")


def test_a_guess_is_unsure_where_the_cells_contradict_it():
    assert levels(shell(31.0 - np.geomspace(1, 30, 15)[::-1]))["farfield"] == "unsure"


@pytest.mark.parametrize(
    ("distance", "part", "expected"),
    [
        (0.29, 0.49, ("wall", "likely")),  # the place says nothing within 1.5 times the limit, 0.3
        (0.31, 2.1, ("farfield", "likely")),
        (0.29, 0.51, ("wall", "unsure")),
        (0.31, 1.9, ("farfield", "unsure")),
        (0.21, 1.0, ("wall", "unsure")),
        (0.19, 1.0, ("wall", "likely")),
        (0.44, None, ("farfield", "unsure")),
        (0.46, None, ("farfield", "likely")),
        (0.19, 0.49, ("wall", "sure")),
        (0.19, 2.1, ("wall", "unsure")),
        (0.46, 2.1, ("farfield", "sure")),
        (0.46, 0.49, ("farfield", "unsure")),
    ],
)
def test_place_and_cells_say_what_is_wall_and_far_field_and_how_sure(distance, part, expected):
    guess = judge_place(Window.whole(0, (4, 5, 6)).face(2), distance, part)
    assert (guess.kind, guess.level) == expected


@pytest.mark.parametrize(("part", "level"), [(None, "sure"), (0.21, "likely"), (1.0, "likely"), (0.19, "unsure")])
def test_a_plane_of_symmetry_is_unsure_where_its_first_cells_are_a_fifth_of_the_others(part, level):
    assert judge_symmetry(Window.whole(0, (4, 5, 6)).face(2), "symmetry_y", part).level == level


def test_planes_of_a_grid_one_cell_deep_are_sure_and_finely_resolved_ones_are_not():
    grid = shell(np.geomspace(1, 30, 15))
    thin = replace(grid, blocks=(replace(grid.blocks[0], nodes=grid.blocks[0].nodes[:, :, :2]),))
    assert levels(thin, [4, 5]) == {"symmetry_z": "sure"}
    nodes = grid.blocks[0].nodes.copy()
    nodes[..., 2] = np.geomspace(1e-3, 1, 7) - 1.0  # a half body on a floor
    floor = Grid((Block(nodes, "floor"),), source="floor.xyz")
    on_floor = guess_faces(floor, [Window.whole(0, floor.shapes[0]).face(face) for face in range(5)])
    (guess,) = (guess for guess in on_floor if guess.name == "symmetry_z")
    assert guess.level == "unsure"
    assert "as at walls" in guess.reason


def test_the_face_that_is_least_sure_stands_for_its_patch():
    windows = [Window.whole(0, (4, 5, 6)).face(face) for face in range(3)]
    found = zip(windows, ("likely", "unsure", "sure"), "abc")
    (certainty,) = how_sure([FaceGuess(window, "wall", "wall", level, reason) for window, level, reason in found])
    assert (certainty.level, certainty.reason, certainty.window) == ("unsure", "b", windows[1])
    assert certainty.n_windows == {"sure": 1, "likely": 1, "unsure": 1}


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
    guesses = guess_faces(replace(grid, patches=()), [face.window for face in boundary])
    for guess in guesses:
        nodes = grid.blocks[guess.window.block].nodes[guess.window.slices].reshape(-1, 3)
        tell = TRUTH[name]
        truth = tell(guess.kind, nodes.min(axis=0), nodes.max(axis=0)) if tell else declared[guess.window]
        assert guess.level == "unsure" or truth == guess.kind
    assert any(guess.level == "sure" for guess in guesses) == (name != "cgns_nozzle.cgns")  # whose cells are all alike
