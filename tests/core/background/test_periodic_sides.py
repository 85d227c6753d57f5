"""Periodic sides that are copies of each other by a shift move alike."""

import numpy as np
import pytest
from mesh_cases import periodic_mesh, periodic_model
from scipy.interpolate import BSpline

from bspline_mdao.core.background.lattice_line import LatticeLine
from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.grids.io.cgns_periodic import with_periodic_patches
from bspline_mdao.grids.io.meshes.blocks import marked_grid
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.periodic_pair import Motion, PeriodicPair


@pytest.fixture(scope="module")
def model() -> MeshModel:
    """The mesh between periodic sides."""
    return periodic_model()


def asked(model: MeshModel, size: float) -> np.ndarray:
    """Displacements of the walls that are the same on copies, and none at both ends of the floor."""
    walls, pairs = model.mesh.points[model.wall_rows], model.moving_mesh.copies
    change = size * np.sin(walls @ [[1.0, 2.0, 0.3], [0.0, 0.0, 0.0], [2.0, 1.0, 0.5]] + [0.3, 1.0, 2.0])
    change *= ((walls[:, :1] + 1.5) * (2.0 - walls[:, :1])) / 3.0
    change[pairs[:, 1]] = change[pairs[:, 0]]
    return change


def test_a_line_that_repeats_itself_has_two_derivatives_where_its_ends_meet():
    line, rng = LatticeLine.periodic(0.3, 1.7, 0.4, 0.6), np.random.default_rng(0)
    control = line.ties @ rng.normal(size=line.n_unknowns)
    spline = BSpline(line.coordinate_knots, control, line.degree)
    for m in range(3):
        low, high = spline(0.3, nu=m), spline(2.0, nu=m)
        assert abs(low - high) < 1e-11 * max(1.0, abs(low))
    assert control[0] == control[-1]
    assert line.ties.min() >= 0.0
    np.testing.assert_allclose(line.ties.sum(axis=1), 1.0, rtol=1e-13)
    assert line.n_unknowns == line.n_control - 3
    assert line.parameters(np.array([0.3 + 0.5 * 1.7 - 3.4])) == pytest.approx(0.5, abs=1e-14)


def test_both_sides_move_alike_and_the_cells_between_stay_valid(model):
    (sides,) = model.periodic
    assert sides.period == pytest.approx(1.0)
    assert model.lattice.lines[1].is_periodic
    walls, change = model.mesh.points[model.wall_rows], asked(model, 0.05)
    nodes = model.node_map.at(model.mover.move(model.control_points, walls + change).points).nodes
    moved = nodes - model.mesh.points
    assert np.abs(moved[sides.pairs[:, 0]]).max() > 0.02
    np.testing.assert_allclose(moved[sides.pairs[:, 0]], moved[sides.pairs[:, 1]], rtol=0, atol=1e-15)
    np.testing.assert_allclose(nodes[model.wall_rows], walls + change, rtol=0, atol=1e-15)
    assert not model.mesh.quality(nodes).is_inverted.any()
    assert np.array_equal(model.node_map.at(model.control_points).nodes, model.mesh.points)


def test_the_lattice_itself_is_what_moves_both_sides_alike(model):
    (sides,) = model.periodic
    walls = model.mesh.points[model.wall_rows]
    displacement = model.mover.follow(walls, walls + asked(model, 0.05)).displacement
    on = [model.lattice.evaluator(model.mesh.points[sides.pairs[:, k]]).forward(displacement) for k in (0, 1)]
    np.testing.assert_allclose(*on, rtol=0, atol=1e-14)
    assert np.abs(on[0]).max() > 0.02


def test_walls_that_end_on_periodic_sides_are_copies_too(model):
    pairs = model.moving_mesh.copies
    assert len(pairs) == 12
    walls = model.mesh.points[model.wall_rows]
    np.testing.assert_allclose(walls[pairs[:, 1]] - walls[pairs[:, 0]], np.tile([0.0, 1.0, 0.0], (12, 1)), atol=1e-12)


def test_products_between_periodic_sides_agree_and_are_differences_of_the_nodes(model):
    rng, step = np.random.default_rng(1), 1e-3
    walls, change = model.mesh.points[model.wall_rows], asked(model, 0.05)
    direction = 0.1 * rng.normal(size=change.shape)  # other on copies
    direction[model.moving_mesh.in_plane_rows, 0] = 0.0
    movement = model.mover.move(model.control_points, walls + change)
    state = model.node_map.at(movement.points)
    forward = state.jvp(movement.jvp(np.zeros_like(model.control_points), direction))
    nodes = {
        k: model.node_map.at(model.mover.move(model.control_points, walls + change + k * step * direction).points).nodes
        for k in (-2, -1, 1, 2)
    }
    differences = (8.0 * (nodes[1] - nodes[-1]) - (nodes[2] - nodes[-2])) / (12.0 * step)
    assert np.abs(differences - forward).max() < 1e-8 * np.abs(forward).max()
    bar = rng.normal(size=state.nodes.shape)
    reverse = movement.vjp(state.vjp(bar)["control_points"])[1]
    size = np.linalg.norm(bar) * np.linalg.norm(forward)
    assert abs(np.vdot(bar, forward) - np.vdot(reverse, direction)) < 1e-12 * size


def test_sides_that_are_no_copies_by_a_shift_stay():
    model = MeshModel.of(*periodic_mesh(lean=0.1, twist=0.1), LatticeSettings(spacing=0.4))
    assert model.periodic == ()
    rows = np.unique((model.mesh.markers or {})["per_1"])
    assert np.isin(np.setdiff1d(rows, model.wall_rows), model.rows_at_rest).all()


def channel(motion: Motion) -> Grid:
    """A bent channel of one block with a wall below, whose sides are declared as periodic by a motion."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in (9, 7, 6)), indexing="ij")
    turned = motion.axis[0] * motion.angle * k
    y, z = 1.0 + j, 0.2 * np.sin(3.0 * i)
    nodes = np.stack([3.0 * i, y * np.cos(turned) - z * np.sin(turned), y * np.sin(turned) + z * np.cos(turned)], -1)
    nodes += k[..., None] * motion.shift
    whole = Window.whole(0, (9, 7, 6))
    wall, far = Patch("floor", "wall", (whole.face(2),)), Patch("far", "farfield", (whole.face(0), whole.face(1)))
    roof = Patch("roof", "farfield", (whole.face(3),))
    pairs = (PeriodicPair((whole.face(4),), (whole.face(5),), motion),)
    patches = with_periodic_patches((wall, far, roof), pairs)
    return Grid((Block(nodes, "block 1"),), patches, "channel", periodic=pairs)


@pytest.mark.parametrize("motion", [Motion(shift=(0.0, 0.0, 0.8)), Motion(axis=(1.0, 0.0, 0.0), angle=0.4)])
def test_sides_that_a_file_declares_are_tied(motion):
    marked = marked_grid(channel(motion))
    kinds = {name: guess.kind for name, guess in marked.kinds.items()}
    assert (kinds["periodic_1a"], kinds["periodic_1b"]) == ("periodic", "periodic")
    model = MeshModel.of(marked.mesh, kinds, LatticeSettings(spacing=0.4))
    (sides,) = model.periodic
    assert set(sides.markers) == {"periodic_1a", "periodic_1b"}
    assert sides.gap(model.mesh.points) < 1e-14
    assert model.lattice.frame.is_cartesian == motion.is_translation
    if motion.is_translation:
        np.testing.assert_allclose(np.abs(sides.motion.shift), motion.shift, atol=1e-12)
    else:
        np.testing.assert_allclose(sides.motion.axis, motion.axis, atol=1e-12)
        assert abs(sides.motion.angle) == pytest.approx(motion.angle, abs=1e-12)
