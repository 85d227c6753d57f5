"""Outer boundaries that go along with the rigid part of the surface's motion."""

import numpy as np
import pytest
from mover_cases import channel, oblique_channel, random_changes, wing
from scipy.spatial.transform import Rotation

from bspline_mdao import MovementError
from bspline_mdao.core.walls.rigid_part import RigidPart
from bspline_mdao.movers import ComovingFrame, InverseDistance, LinearElasticity
from bspline_mdao.testing import central_difference

PLANES = {
    "no plane": np.zeros((0, 3)),
    "one plane": np.array([[0.6, 0.0, 0.8]]),
    "two planes": np.array([[0.6, 0.0, 0.8], [0.0, 1.0, 0.0]]),
}


def rigid(normals, angle, seed=0):
    """A rotation and a shift that keep planes."""
    along = np.linalg.svd(normals)[2][: len(normals)]
    shift = (np.eye(3) - along.T @ along) @ np.random.default_rng(seed).normal(size=3)
    axis = np.array([2.0, -1.0, 2.0]) / 3.0 if len(normals) == 0 else normals[0]
    turn = np.eye(3) if len(normals) > 1 else Rotation.from_rotvec(angle * axis).as_matrix()
    return turn, shift


@pytest.mark.parametrize("normals", PLANES.values(), ids=PLANES)
@pytest.mark.parametrize("degrees", [0, 30, 90, 180, 300])
def test_a_rigid_motion_is_found_by_any_angle(normals, degrees):
    rng = np.random.default_rng(1)
    turn, shift = rigid(normals, np.deg2rad(degrees))
    points = rng.normal(size=(23, 3)) * [3.0, 1.0, 0.2] + [1.0, -2.0, 0.5]
    motion = RigidPart(normals).at(points, points @ turn.T + shift)
    np.testing.assert_allclose(motion.rotation, turn, rtol=0, atol=1e-13)
    np.testing.assert_allclose(motion.shift, shift, rtol=0, atol=1e-13)
    np.testing.assert_allclose(motion.undo(motion.apply(points)), points, rtol=0, atol=1e-13)


@pytest.mark.parametrize(("between", "turns"), [(1e-5, True), (1e-3, False)])
def test_planes_are_one_but_for_single_precision_and_leave_no_rotation_where_they_are_two(between, turns):
    normal, turn = np.array([0.6, 0.0, 0.8]), Rotation.from_rotvec([0.3, 0.0, 0.4]).as_matrix()
    points = np.random.default_rng(4).normal(size=(23, 3))
    other = Rotation.from_rotvec([0.0, between, 0.0]).apply(normal)
    found = RigidPart(np.stack([normal, other])).at(points, points @ turn.T).rotation
    np.testing.assert_allclose(found, turn if turns else np.eye(3), rtol=0, atol=1e-4)


def test_points_in_a_plane_have_a_rotation():
    points = np.random.default_rng(2).normal(size=(17, 3)) * [1.0, 0.0, 2.0]
    turn = Rotation.from_rotvec([0.3, 2.0, -0.7]).as_matrix()
    np.testing.assert_allclose(RigidPart(np.zeros((0, 3))).at(points, points @ turn.T).rotation, turn, atol=1e-14)


@pytest.mark.parametrize("normals", PLANES.values(), ids=PLANES)
def test_derivatives_of_the_rigid_motion_are_exact_and_transposed(normals):
    rng = np.random.default_rng(3)
    points = rng.normal(size=(19, 3)) * [2.0, 1.0, 0.3]
    moved = points @ rigid(normals, 2.0)[0].T + 0.1 * rng.normal(size=points.shape)
    part, change, other = RigidPart(normals), rng.normal(size=points.shape), rng.normal(size=points.shape)
    found = part.at(points, moved).jvp(change, other)

    def at(t):
        motion = part.at(points + t * change, moved + t * other)
        return np.concatenate([motion.rotation.ravel(), motion.shift])

    forward = np.concatenate([found[0].ravel(), found[1]])
    np.testing.assert_allclose(central_difference(at, 1e-3), forward, rtol=0, atol=1e-9 * np.abs(forward).max())
    bars = rng.normal(size=(3, 3)), rng.normal(size=3)
    back = part.at(points, moved).vjp(*bars)
    expected = np.vdot(bars[0], found[0]) + np.vdot(bars[1], found[1])
    assert np.vdot(back[0], change) + np.vdot(back[1], other) == pytest.approx(expected, rel=1e-12)


def test_a_surface_that_is_turned_inside_out_is_refused():
    points = np.concatenate([np.eye(3), -np.eye(3)])  # no direction is the one that a turned-over set keeps best
    with pytest.raises(MovementError, match="the surface is turned inside out as a whole"):
        RigidPart(np.zeros((0, 3))).at(points, -points)


MESHES = {"channel": channel, "oblique channel": oblique_channel, "wing": wing}
MOVERS = {"elasticity": lambda mesh: LinearElasticity(mesh, n_increments=2), "inverse distance": InverseDistance}


EVERY = pytest.mark.parametrize(
    ("mesh", "mover"),
    [
        pytest.param(MESHES[mesh], MOVERS[mover], id=f"{mesh}-{mover}", marks=() if is_cheap else pytest.mark.slow)
        for mesh in MESHES
        for mover in MOVERS
        for is_cheap in [mesh == "oblique channel" and mover == "inverse distance"]
    ],
)
"""Every mover of every mesh, one of them in the fast loop."""


def twisted(mesh, angle, seed=5):
    """Surface that turns about the normal of its plane and is a little off, in its planes of symmetry."""
    rng, (normal,) = np.random.default_rng(seed), mesh.plane_normals
    points = mesh.points[mesh.surface_ids]
    turn = Rotation.from_rotvec(angle * normal).as_matrix()
    off = 0.02 * np.sin(points @ rng.normal(size=(3, 3)) + rng.normal(size=3))
    off[mesh.in_plane_rows] -= (off[mesh.in_plane_rows] @ normal)[:, None] * normal
    return points @ turn.T + off + 0.3 * np.cross(normal, [1.0, 0.2, -0.5])


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_the_planes_of_a_mesh_are_those_in_which_points_slide(mesh):
    mesh = mesh()
    (normal,) = mesh.plane_normals
    assert np.abs(np.abs(mesh.in_plane_normals @ normal) - 1.0).max() < 1e-12
    assert len(mesh.in_plane_normals) > 3


@EVERY
@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_rigid_motion_of_the_surface_is_one_of_the_mesh(mesh, mover, degrees):
    mesh = mesh()
    (normal,) = mesh.plane_normals
    turn, shift = Rotation.from_rotvec(np.deg2rad(degrees) * normal).as_matrix(), np.cross(normal, [0.3, -1.0, 2.0])
    found = ComovingFrame(mover(mesh)).move(mesh.points, mesh.points[mesh.surface_ids] @ turn.T + shift).points
    np.testing.assert_allclose(found, mesh.points @ turn.T + shift, rtol=0, atol=1e-12 * mesh.size)


@pytest.mark.slow
def test_what_is_fixed_follows_the_rigid_part_and_what_slides_stays_in_its_plane():
    mesh = wing()
    (normal,) = mesh.plane_normals
    surface = twisted(mesh, 0.5)
    points = ComovingFrame(LinearElasticity(mesh, n_increments=1)).move(mesh.points, surface).points
    motion = RigidPart(mesh.plane_normals).at(mesh.points[mesh.surface_ids], surface)
    fixed = mesh.fixed_ids
    np.testing.assert_allclose(points[fixed], motion.apply(mesh.points[fixed]), rtol=0, atol=1e-12 * mesh.size)
    np.testing.assert_array_equal(points[mesh.surface_ids], surface)
    sliding = np.flatnonzero(mesh.is_free.sum(axis=1) == 2)
    assert np.abs((points - mesh.points)[sliding] @ normal).max() < 1e-13 * mesh.size
    assert mesh.tangled(points).n_tangled == 0


@EVERY
def test_derivatives_of_the_move_are_exact_and_transposed(mesh, mover):
    mesh = mesh()
    comoving, rng = ComovingFrame(mover(mesh), keep_factors=True), np.random.default_rng(6)
    surface = twisted(mesh, 1.2)
    d_initial, d_surface = random_changes(mesh, seed=6)
    assert np.abs(d_initial[mesh.surface_ids]).max() > 1.0  # the rigid motion depends on where the surface was
    movement = comoving.move(mesh.points, surface)
    np.testing.assert_array_equal(movement.points[mesh.surface_ids], surface)
    forward = movement.jvp(d_initial, d_surface)

    def at(t):
        return comoving.move(mesh.points + t * d_initial, surface + t * d_surface).points

    slope = central_difference(at, 1e-4)
    np.testing.assert_allclose(slope, forward, rtol=0, atol=1e-7 * np.abs(forward).max())
    bar = rng.normal(size=forward.shape)
    before = bar.copy()
    initial_bar, surface_bar = movement.vjp(bar)
    np.testing.assert_array_equal(bar, before)
    terms = bar * forward
    found = np.vdot(initial_bar, d_initial) + np.vdot(surface_bar, d_surface)
    assert abs(terms.sum() - found) < 1e-12 * np.abs(terms).sum()


@pytest.mark.slow
def test_a_later_move_takes_the_factor_of_the_first():
    mesh = wing()
    comoving = ComovingFrame(LinearElasticity(mesh, n_increments=1))
    first = comoving.move(mesh.points, twisted(mesh, 0.2))
    surface = twisted(mesh, 0.7, seed=7)
    again = comoving.move(mesh.points, surface, start=first.start)
    np.testing.assert_array_equal(again.points, comoving.move(mesh.points, surface).points)
