"""Component grids that overlap move by one lattice: walls, fringes, nodes that blocks share."""

from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest
from overset_cases import CENTRES, LENGTH, overset_grid, wing_on_body

from bspline_mdao import DesignSurface, write_grid
from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.background.open_mesh_file import open_mesh_file
from bspline_mdao.design import Dihedral, Junction, OfPart, OnPatch, Translation, Twist
from bspline_mdao.grids.cells.overlap_change import OverlapChange
from bspline_mdao.grids.io.meshes.blocks import marked_grid
from bspline_mdao.grids.io.plane_grids import lift_plane_grid
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.meshes import fit_mesh
from bspline_mdao.movers import Cylinder
from bspline_mdao.testing import check_totals


@pytest.fixture(scope="module")
def case():
    """The grid, and its model."""
    marked = marked_grid(overset_grid())
    kinds = {name: guess.kind for name, guess in marked.kinds.items()}
    return marked, MeshModel.of(marked.mesh, kinds, LatticeSettings(spacing=0.3))


def bodies_apart(model: MeshModel) -> np.ndarray:
    """Where the walls are to be: one ball turns and goes away from the other, which grows."""
    mesh = model.mesh
    walls, is_first = mesh.points[model.wall_rows], np.isin(model.wall_rows, np.unique(mesh.markers["ball_1"]))
    c, s = np.cos(0.3), np.sin(0.3)
    turned = (walls - CENTRES[0]) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + CENTRES[0]
    return np.where(is_first[:, None], turned - [0.1, 0.0, 0.0], walls + 0.15 * (walls - CENTRES[1]))


def moved(model: MeshModel) -> np.ndarray:
    return model.node_map.at(model.mover.move(model.control_points, bodies_apart(model)).points).nodes


@pytest.mark.slow
def test_bodies_move_differently_with_exact_walls_valid_cells_and_the_far_field_at_rest(case):
    marked, model = case
    mesh, nodes = marked.mesh, moved(model)
    assert np.abs(nodes[model.wall_rows] - bodies_apart(model)).max() < 1e-13
    assert not mesh.quality(nodes).is_inverted.any()
    far = np.unique(mesh.markers["far"])
    np.testing.assert_array_equal(nodes[far], mesh.points[far])
    outer = np.unique(mesh.markers["overset"])
    assert np.linalg.norm(nodes[outer] - mesh.points[outer], axis=1).min() > 0.005


def test_nodes_that_blocks_share_stay_one_to_the_last_bit(case):
    marked, model = case
    before = marked.grid.to_vector().reshape(-1, 3)
    after = marked.mesh.nodes_of_file(moved(model))
    np.testing.assert_array_equal(marked.mesh.nodes_of_file(marked.mesh.points), before)
    _, first, inverse = np.unique(before, axis=0, return_index=True, return_inverse=True)
    assert len(first) < len(before) - 100
    np.testing.assert_array_equal(after, after[first][inverse.ravel()])


def test_fringes_keep_their_places_in_the_cells_of_others_which_a_grid_left_behind_does_not(case):
    marked, model = case
    mesh, nodes = marked.mesh, moved(model)
    fringe = np.unique(mesh.markers["overset"])
    change = OverlapChange.of(marked.grid, mesh, fringe, nodes)
    assert change.n_fringe == len(fringe) == change.n_donors
    assert change.median < 0.02
    assert change.largest < 0.08
    behind, box = nodes.copy(), mesh.numbers[-marked.grid.blocks[-1].nodes[..., 0].size :]
    behind[box] = mesh.points[box]
    assert OverlapChange.of(marked.grid, mesh, fringe, behind).largest > 0.3


def test_interpolated_nodes_by_blanking_are_fringes_too(case):
    marked, model = case
    blocks = list(marked.grid.blocks)
    iblank = np.ones(blocks[0].shape, dtype=np.int32)
    iblank[:, :, -2:] = -1
    blocks[0] = type(blocks[0])(blocks[0].nodes, blocks[0].name, iblank)
    grid = type(marked.grid)(tuple(blocks))
    change = OverlapChange.of(grid, marked.mesh, np.zeros(0, dtype=int), moved(model))
    assert change.n_fringe == 2 * iblank[:, :, 0].size


def test_nodes_of_plane_component_grids_count_once_and_keep_their_places_under_an_affine_move():
    turn, axes = np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]]), (np.linspace(-1.0, 1.0, 5), [0.0])
    inner = np.stack(np.meshgrid(axes[0], axes[0], axes[1], indexing="ij"), axis=-1) @ turn
    outer = 2.0 * np.stack(np.meshgrid(*[np.linspace(-1.0, 1.0, n) for n in (8, 9)], axes[1], indexing="ij"), axis=-1)
    grid = Grid((Block(inner, "inner"), Block(outer, "outer")), source="plane")
    mesh = marked_grid(lift_plane_grid(grid)).mesh
    assert mesh.n_copies == 2
    change = OverlapChange.of(grid, mesh, np.unique(mesh.markers["overset"]), mesh.points @ (turn * [1.3, 0.7, 1.0]))
    assert change.n_fringe == change.n_donors == 16
    assert max(change.largest, change.farthest) < 1e-9


@pytest.fixture(scope="module")
def sliding(tmp_path_factory):
    """A wing whose grid has a collar on the body of another: the model, and the movement of both, set up."""
    path = tmp_path_factory.mktemp("overset") / "wing.cgns"
    write_grid(path, wing_on_body())
    model = fit_mesh(path)
    both = DesignSurface.of(model)
    wing = both.part("wing")
    of_wing = Twist("twist", wing.axis, 2), Dihedral("dihedral", wing.axis), Translation("position", "x")
    junction = Junction(OnPatch(model, ["collar", "body"]), 1.5, Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0))
    problem = om.Problem(reports=None)
    movement = both.grid_movement(
        [OfPart(each, wing.mesh) for each in of_wing], junction=junction, quality=("volume_ks",)
    )
    problem.model.add_subsystem("movement", movement, promotes=["*"])
    problem.setup(mode="rev")
    return model, problem


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_wing_with_a_collar_slides_turns_and_rises_on_the_body_of_another_grid(sliding, sign, tmp_path):
    model, problem = sliding
    mesh, grid = model.mesh, wing_on_body()
    for name, value in {"position": 0.1 * LENGTH, "twist": 10.0, "dihedral": 10.0}.items():
        problem.set_val(name, sign * value)
    problem.run_model()
    open_mesh_file(model).write(tmp_path / "moved.cgns", problem.get_val("grid").reshape(-1, 3))
    nodes = fit_mesh(tmp_path / "moved.cgns").mesh.points
    gone = np.linalg.norm(nodes - mesh.points, axis=1)
    for name in ("collar", "body"):
        rows = np.unique(mesh.markers[name])
        np.testing.assert_allclose(np.hypot(*nodes[rows, 1:].T), 1.0, rtol=0.0, atol=1e-14)
        assert gone[rows].max() > 0.45
    assert not mesh.quality(nodes).is_inverted.any()
    fringe, change = np.unique(mesh.markers["overset"]), []
    for before in (mesh, replace(mesh, points=nodes)):
        change.append(OverlapChange.of(grid, before, fringe, nodes))
        assert change[-1].n_donors == change[-1].n_fringe > 800
    assert change[0].median < 0.006
    assert change[0].farthest < 0.2  # the next cell is the donor
    heights = [model.node_map.embedded.walls.heights(each) for each in (mesh.points, nodes)]
    ratios = (heights[1] / heights[0])[heights[0] < 4e-3]
    assert np.abs(np.quantile(ratios, [0.01, 0.99]) - 1.0).max() < 0.011
    assert np.abs(ratios - 1.0).max() < 0.05


def test_totals_of_a_wing_that_slides_on_the_body_of_another_grid_are_those_of_differences(sliding):
    _, problem = sliding
    for name, value in {"position": 0.2, "twist": [3.0, -4.0], "dihedral": 2.0}.items():
        problem.set_val(name, value)
    problem.run_model()
    check = check_totals(problem, ["volume_ks"], ["position", "twist", "dihedral"])
    assert check.transposed < 1e-12
    assert check.differences < 1e-7
