"""Periodic sides of real grids and meshes move alike, which files of others hold."""

import numpy as np
import pytest

from bspline_mdao import read_grid
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.grids.io.meshes.blocks import marked_grid
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.meshes import fit_mesh


def moved_alike(model: MeshModel, change: np.ndarray) -> np.ndarray:
    """Nodes behind walls that move by components along the axis, the radius and around, checked on both sides."""
    walls, (sides,) = model.mesh.points[model.wall_rows], model.periodic
    change = model.moving_mesh.with_copies(model.lattice.frame.directions(walls).space(change))
    nodes = model.node_map.at(model.mover.move(model.control_points, walls + change).points).nodes
    moved, size = nodes - model.mesh.points, np.linalg.norm(np.ptp(model.mesh.points, axis=0))
    first, second = moved[sides.pairs.T]
    assert np.abs(first).max() > 1e-4 * size
    np.testing.assert_allclose(sides.motion.turn(first), second, rtol=0, atol=1e-14 * size)
    assert abs(sides.gap(nodes) - sides.gap(model.mesh.points)) < 1e-14 * size
    np.testing.assert_allclose(nodes[model.wall_rows], walls + change, rtol=0, atol=1e-14 * size)
    is_valid = ~model.mesh.quality(model.mesh.points).is_inverted
    assert not model.mesh.quality(nodes).is_inverted[is_valid].any()
    return nodes


def inside(x: np.ndarray) -> np.ndarray:
    """A factor that is 0 at both ends of some coordinates, and 1 in the middle."""
    return np.sin(np.pi * (x - x.min()) / np.ptp(x)) ** 2


@pytest.mark.parametrize("name", ["transonic_stator_periodic", "centrifugal_blade"])
def test_cascades_of_su2_move_with_both_sides_alike(real_mesh, name):
    model = fit_mesh(real_mesh(name))
    frame, walls = model.lattice.frame, model.mesh.points[model.wall_rows]
    assert frame.is_cartesian == (name != "centrifugal_blade")
    if not frame.is_cartesian:
        assert abs(np.degrees(frame.motion.angle)) == pytest.approx(9.47, abs=1e-8)
    across = next(axis for axis, line in enumerate(model.lattice.lines) if line.is_tied)
    size = np.ptp(np.delete(frame.to_local(walls), across, axis=1), axis=0).max()
    step = 0.03 * size * np.delete(np.eye(3), across, axis=0)
    for change in (step[0], step[1], step[0] - step[1]):
        moved_alike(model, np.tile(change, (len(walls), 1)))


def test_a_passage_of_a_turbine_takes_a_bow_a_lean_and_a_casing(real_grids):
    whole = read_grid(real_grids / "nasa_vspt_turbine.xyz.gz")
    grid = Grid(tuple(Block(block.nodes[::4, ::4, ::4].copy(), block.name) for block in whole.blocks), (), "passage")
    marked = marked_grid(grid)
    model = MeshModel.of(marked.mesh, {name: guess.kind for name, guess in marked.kinds.items()})
    (sides,), frame = model.periodic, model.lattice.frame
    assert sides.motion.axis == (1.0, 0.0, 0.0)
    assert abs(sides.motion.angle) == pytest.approx(2.0 * np.pi / 55.0, abs=1e-14)
    x, radius, _ = frame.to_local(model.mesh.points[model.wall_rows]).T
    up = (radius - radius.min()) / np.ptp(radius)
    zero = np.zeros_like(x)
    for change in (
        [zero, zero, 0.3 * np.sin(np.pi * up) * inside(x)],
        [zero, 0.2 * up * inside(x), zero],
        [zero, zero, 0.3 * up * inside(x)],
    ):
        moved_alike(model, np.stack(change, axis=1))


@pytest.mark.parametrize(("grid", "folder", "n_on_axis"), [
    ("cfl3d_axibump.fmt", "grids", 0),
    ("gdtk_sphere3.g", "strangers", 129),
])  # fmt: skip
def test_thin_wedges_of_others_move_with_both_sides_alike_and_their_axis_along_itself(
    real_grids, grid, folder, n_on_axis
):
    stored = real_grids.parent / folder / grid
    if not stored.is_file():
        pytest.skip(f"{stored.name} is not there")
    model = fit_mesh(stored)
    frame = model.lattice.frame
    is_on_axis = frame.is_on_axis(model.mesh.points)
    assert is_on_axis.sum() == n_on_axis
    x = frame.to_local(model.mesh.points[model.wall_rows])[:, 0]
    rise = 0.02 * np.ptp(x) * inside(x)
    nodes = moved_alike(model, np.stack([0.5 * rise, rise, 0.0 * x], axis=1))
    moved = (nodes - model.mesh.points)[is_on_axis]
    np.testing.assert_array_equal(moved @ frame.axes[1:].T, 0.0)


def test_a_rotor_moves_behind_a_stator_and_both_rows_repeat_as_before(real_grids, tmp_path):
    """O-grids of blades in a background that repeats by a shift, with a plane that rotor and stator slide along."""
    parts = {
        ("stator", "wall"): [(b, "kmin") for b in (2, 4, 6)],
        ("rotor", "wall"): [(b, "kmin") for b in (8, 10, 12, 14)],
        ("ends", "symmetry"): [(b, face) for b in range(1, 15) for face in ("imin", "imax")],
        ("fringe", "overset"): [(b, "kmax") for b in range(2, 15, 2)],
        ("periodic_low", "other"): [(1, "kmin"), (7, "kmin")],
        ("periodic_high", "other"): [(5, "kmax"), (13, "kmax")],
        ("far", "farfield"): [(b, "jmin") for b in (1, 3, 5, 7)] + [(b, "jmax") for b in (7, 9, 11, 13)],
        ("between_rows", "other"): [(b, "jmax") for b in (1, 3, 5)] + [(b, "jmin") for b in (9, 11, 13)],
    }
    text = ""
    for (name, kind), faces in parts.items():
        listed = ", ".join(f'{{block = {block}, face = "{face}"}}' for block, face in faces)
        text += f'[[patch]]\nname = "{name}"\nkind = "{kind}"\nfaces = [{listed}]\n'
    (tmp_path / "patches.toml").write_text(text)
    model = fit_mesh(real_grids / "cfl3d_rotorstator.fmt", tmp_path / "patches.toml")
    assert model.kinds["between_rows"] == "other"  # as it was declared, though it looks like a wall
    walls, (sides,) = model.mesh.points[model.wall_rows], model.periodic
    np.testing.assert_allclose(sides.motion.shift, [0.0, 24.2351, 0.0], atol=1e-4)
    rotor = np.isin(model.wall_rows, np.unique(model.mesh.markers["rotor"]))
    for change in ([0.3, 0.3, 0.0], [-0.2, 0.4, 0.0]):
        asked = walls + np.outer(rotor, change)
        nodes = model.node_map.at(model.mover.move(model.control_points, asked).points).nodes
        assert not model.mesh.quality(nodes).is_inverted.any()
        first, second = (nodes - model.mesh.points)[sides.pairs.T]
        np.testing.assert_allclose(first, second, rtol=0.0, atol=1e-13)
        for name in ("far", "between_rows"):
            stays = np.unique(model.mesh.markers[name])
            np.testing.assert_array_equal(nodes[stays], model.mesh.points[stays])
