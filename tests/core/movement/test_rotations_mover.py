"""What the mover with rotations alone is to do: large angles at once, without memory."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from elastic_cases import assembled, crooked_box
from mover_cases import (
    CountingSolver,
    assert_derivative_is_exact,
    assert_derivative_is_transposed,
    assert_known_points_match,
    bent_surface,
    channel,
    in_symmetry,
    mesh_of,
    rotation,
    wing,
)
from scipy.spatial.transform import Rotation
from test_slivers import C_GRID, lost_in_differences, lost_in_products, noise, pitched, plate_in_its_wake, section
from topology_cases import box, grid_of, patch

from bspline_mdao.base.numerics.rotation_group import nearest_rotations
from bspline_mdao.base.sparse.solved_together import solved
from bspline_mdao.core.movement.element_rotations import ElementRotations
from bspline_mdao.core.movement.rotations import Rotations
from bspline_mdao.core.movement.target_gradients import TargetGradientElements
from bspline_mdao.core.movement.trilinear import SLOPES
from bspline_mdao.core.movement.young_modulus import InverseVolumeLaw
from bspline_mdao.errors import InputError
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.testing import central_difference

SIDES = {"one side": (0, 3, 5), "other side": (4, 0, 5)}
"""Ends of the windows of two sides of a block that meet at an edge."""

LAW = (0.7, -0.2, 0.6)


@cache
def enclosed():
    """Boxes all of whose boundary is surface."""
    return crooked_box(shape=(5, 4, 14), is_enclosed=True)


def twisted(points, angle):
    """Points turned about an axis along z that is none of the box, by an angle (degrees) in proportion to z."""
    angles = np.deg2rad(angle) * points[:, 2] / 13.0
    turns = Rotation.from_rotvec(angles[:, None] * np.array([[0.0, 0.0, 1.0]])).as_matrix()
    return np.einsum("nij,nj->ni", turns, points - [1.0, 2.0, 0.0])


def elements_and_target(seed=0):
    """Crooked elements, a target, and a field."""
    mesh, random = crooked_box(is_collapsed=seed == 0), np.random.default_rng(seed)
    points = mesh.points + 0.05 * random.normal(size=mesh.points.shape)
    elements = TargetGradientElements.of(mesh, InverseVolumeLaw(shape=0.5), LAW, points)
    return elements, random.normal(size=elements.target.shape), random.normal(size=(2, *points.shape))


def at_target(elements, target, points):
    mesh, stiffness = elements.mesh, elements.stiffness
    return TargetGradientElements(mesh, stiffness, LAW, points, stiffness.modulus(mesh, points, points), target)


def test_matrix_and_force_of_elements_with_target_gradients_agree():
    elements, _, (field, _) = elements_and_target()
    n = elements.mesh.n_points
    stiffness = assembled(elements.add_stiffness, elements.mesh.elements, n)
    force = elements.force(field[None])[0].ravel()
    np.testing.assert_allclose(stiffness @ field.ravel(), force, atol=1e-13 * np.abs(force).max())
    assert np.linalg.eigvalsh(stiffness)[3] > 1e-6  # translations alone are free, turns are not


def test_a_field_with_the_gradient_that_guides_it_needs_no_force():
    elements, _, _ = elements_and_target()
    gradient = np.random.default_rng(1).normal(size=(3, 3))
    at = at_target(elements, np.repeat(gradient[None], len(elements.target), axis=0), elements.points)
    force, alone = (one.force((elements.points @ gradient.T)[None]) for one in (at, elements))
    assert np.abs(force).max() < 1e-13 * np.abs(alone).max()


def test_derivatives_of_the_force_of_elements_with_target_gradients_are_exact_and_transposed():
    elements, target, field = elements_and_target()
    at, random = at_target(elements, target, elements.points), np.random.default_rng(2)
    d_points, d_target = random.normal(size=at.points.shape), random.normal(size=target.shape)

    def force(t):
        return at_target(elements, target + t * d_target, at.points + t * d_points).force(field).sum(axis=0)

    change = at.force_jvp(field, d_points, d_target).sum(axis=0)
    np.testing.assert_allclose(central_difference(force, 1e-4, levels=2), change, atol=1e-9 * np.abs(change).max())
    bar, d_field = random.normal(size=(1, *at.points.shape)), random.normal(size=(1, *at.points.shape))
    points_bar, target_bar, field_bar = at.force_vjp(field, bar)
    linear = elements.force(d_field)
    forward = (bar * (change + linear)).sum()
    reverse = (points_bar * d_points).sum() + (target_bar * d_target).sum() + (field_bar * d_field[0]).sum()
    assert abs(forward - reverse) < 1e-13 * np.linalg.norm(bar) * np.linalg.norm(change)


def strained(strength=0.2, n_folded=0):
    """Elements, and a displacement in two parts that turns and strains them all, and mirrors some."""
    elements, random = elements_and_target(seed=1)[0], np.random.default_rng(4)
    turn = Rotation.from_rotvec([0.3, -0.8, 1.1]).as_matrix()
    points = elements.points + strength * random.normal(size=elements.points.shape)
    for element in elements.mesh.elements[:: len(elements.modulus) // 3][:n_folded]:
        points[element, 2] = 2.0 * points[element, 2].mean() - points[element, 2]
    displacement = points @ turn.T - elements.points
    return elements, np.stack([0.9 * displacement, 0.1 * displacement])


def mean_gradients(elements, parts):
    """I and the mean gradient of every element."""
    seen = []
    for corners in elements.mesh.elements:
        f = np.einsum("gia,ad->gid", SLOPES, elements.points[corners])
        u = np.einsum("gia,ad->gid", SLOPES, parts.sum(axis=0)[corners])
        seen.append(np.eye(3) + np.mean(np.linalg.solve(f, u), axis=0).T)
    return np.array(seen)


@pytest.mark.parametrize("n_folded", [0, 3])
def test_rotations_of_elements_are_the_nearest_to_their_mean_gradients_folded_or_not(n_folded):
    elements, parts = strained(n_folded=n_folded)
    rotations, seen = ElementRotations.of(elements, parts).matrices, mean_gradients(elements, parts)
    u, _, v = np.linalg.svd(seen)
    flip = np.sign(np.linalg.det(u @ v))
    is_found = np.empty(len(seen), dtype=bool)
    nearest_rotations(seen, np.empty_like(seen), is_found, (0, len(seen)))
    assert (~is_found).any() == (n_folded > 0)
    u[:, :, 2] *= flip[:, None]
    np.testing.assert_allclose(rotations, u @ v, atol=1e-8)


def test_derivatives_of_the_rotations_of_elements_are_exact_and_transposed_folded_or_not():
    elements, parts = strained(n_folded=3)
    at, random = ElementRotations.of(elements, parts), np.random.default_rng(5)
    d_points, d_parts = random.normal(size=elements.points.shape), random.normal(size=parts.shape)

    def rotations(t):
        moved = replace(elements, points=elements.points + t * d_points)
        return ElementRotations.of(moved, parts + t * d_parts).matrices

    change, bar = at.jvp(d_points, d_parts), random.normal(size=at.matrices.shape)
    difference = central_difference(rotations, 1e-5, levels=2)
    np.testing.assert_allclose(difference, change, atol=1e-7 * np.abs(change).max())
    points_bar, parts_bar = at.vjp(bar)
    reverse = (points_bar * d_points).sum() + (parts_bar.sum(axis=0) * d_parts.sum(axis=0)).sum()
    assert abs((bar * change).sum() - reverse) < 1e-12 * np.linalg.norm(bar) * np.linalg.norm(change)


@pytest.mark.parametrize("angle", [1e-7, 30.0, 90.0, 179.99999, 180.0, 270.0, 359.0])
def test_a_rigid_motion_of_the_boundary_is_followed_at_any_angle(angle):
    mesh, axis = enclosed(), np.array([2.0, -3.0, 6.0]) / 7.0
    turn = Rotation.from_rotvec(np.deg2rad(angle) * axis).as_matrix()
    moved = (mesh.points - [3.0, 1.0, -2.0]) @ turn.T + [0.5, -4.0, 1.0]
    movement = Rotations(mesh).move(mesh.points, moved[mesh.surface_ids])
    assert np.abs(movement.points - moved).max() < 1e-13 * mesh.size
    assert_derivative_is_transposed(movement)


def test_a_tangled_mesh_is_reported_with_the_worst_element():
    mesh = channel()
    report = Rotations(mesh).move(*bent_surface(mesh, size=0.15)).report
    assert report.tangling.startswith("increment 1 of 1 inverts element (")


@pytest.mark.parametrize("n_repetitions", [-1, 1.5, True, None])
def test_what_is_no_number_of_repetitions_is_refused(n_repetitions):
    with pytest.raises(InputError, match=r"rotations: .* repetitions; give a whole number from 0"):
        Rotations(channel(), n_repetitions=n_repetitions)


@pytest.mark.parametrize("is_oblique", [False, True])
def test_a_turn_in_the_plane_of_symmetry_takes_along_all_that_is_free(is_oblique):
    mesh = channel(is_oblique, released=("farfield",))
    turn = Rotation.from_rotvec(2.5 * mesh.in_plane_normals[0]).as_matrix()
    moved = mesh.points @ turn.T
    points = Rotations(mesh).move(mesh.points, moved[mesh.surface_ids]).points
    assert np.abs(points - moved).max() < 1e-13 * mesh.size


def between_planes(angle):
    """A box between two planes of symmetry at an angle (degrees)."""
    x = box(np.linspace(0.0, 1.0, 5) ** 1.1, np.linspace(0.0, 1.2, 4), np.linspace(0.0, 0.8, 6) ** 1.2)
    x[..., 0], x[..., 1] = x[..., 0] + np.cos(np.deg2rad(angle)) * x[..., 1], np.sin(np.deg2rad(angle)) * x[..., 1]
    sides = [patch("symmetry", Window(0, (0, 0, 0), end), name=name) for name, end in SIDES.items()]
    return mesh_of(grid_of(x @ rotation().T, patches=[patch("wall", Window(0, (0, 0, 0), (4, 3, 0))), *sides]))


@pytest.mark.parametrize("angle", [90.0, 60.0])
def test_the_extension_balances_in_all_directions_that_points_turn_about_and_has_no_others(angle):
    mesh, random = between_planes(angle), np.random.default_rng(3)
    system, n_free = Rotations(mesh).start(mesh.points).rotations, mesh.is_free.sum(axis=1)
    given = random.normal(size=(len(mesh.surface_ids), 3))
    values = solved(system.field_task(given)).values
    np.testing.assert_array_equal(values[mesh.surface_ids], given)
    assert np.abs(values[n_free == 1]).max() == 0.0
    sliding = np.flatnonzero(n_free == 2)
    normals = mesh.frames[sliding, np.argmin(mesh.is_free[sliding], axis=1)]
    along = np.sum(values[sliding] * normals, axis=1)
    np.testing.assert_allclose(values[sliding], along[:, None] * normals, rtol=0, atol=1e-13 * np.abs(values).max())
    force = system.elements.force(values[None])[0]
    largest = np.abs(force).max()
    assert np.abs(force[n_free == 3]).max() < 1e-12 * largest
    assert np.abs(np.sum(force[sliding] * normals, axis=1)).max() < 1e-12 * largest


@pytest.mark.parametrize("angle", [90.0, 60.0])
def test_what_lies_on_two_planes_of_symmetry_slides_along_both_and_does_not_turn(angle):
    mesh = between_planes(angle)
    assert {1, 2, 3} <= set(mesh.is_free.sum(axis=1).tolist())
    initial, surface = bent_surface(mesh, size=0.1)
    on_both = np.flatnonzero(np.bincount(mesh.in_plane_rows, minlength=len(mesh.surface_ids)) == 2)
    for _ in range(200):  # planes that are not at right angles
        surface = mesh.points[mesh.surface_ids] + in_symmetry(mesh, surface - mesh.points[mesh.surface_ids])
    movement = Rotations(mesh).move(initial, surface)
    assert np.abs(movement.vectors.values[on_both]).max() == 0.0
    assert np.abs(movement.vectors.values).max() > 0.05
    assert_known_points_match(mesh, initial, surface, movement.points)
    assert_derivative_is_transposed(movement)
    assert_derivative_is_exact(Rotations(mesh), initial, surface, changes=along_the_surface)


def along_the_surface(mesh, seed):
    """Changes of initial points and surface, of the latter where it is in no plane."""
    random = np.random.default_rng(seed)
    inside = np.bincount(mesh.in_plane_rows, minlength=len(mesh.surface_ids)) == 0
    d_initial = mesh.slide(random.normal(size=mesh.points.shape))
    return d_initial, inside[:, None] * random.normal(size=(len(mesh.surface_ids), 3))


def test_a_twist_beyond_half_a_turn_keeps_its_sense():
    mesh = enclosed()
    movement = Rotations(mesh).move(mesh.points, twisted(mesh.points, 330.0)[mesh.surface_ids])
    z = mesh.points[mesh.surface_ids, 2]
    assert movement.vectors.values[z > 8.5, 2].min() > np.pi
    off = np.abs(movement.points - twisted(mesh.points, 330.0)).max()
    assert off < 0.25
    assert movement.report.increments[0].n_tangled == 0


@pytest.mark.parametrize("angle", [0.0, 175.0, 330.0])
def test_derivatives_are_exact_at_any_twist(angle):
    mesh = enclosed()
    surface = twisted(mesh.points, angle)[mesh.surface_ids]
    mover = Rotations(mesh)
    assert_derivative_is_transposed(mover.move(mesh.points, surface))
    assert_derivative_is_exact(mover, mesh.points, surface)


@pytest.mark.slow
def test_derivatives_are_exact_where_edges_are_collapsed():
    mesh = crooked_box(amount=0.1, is_collapsed=True)
    initial, surface = bent_surface(mesh, size=0.3)
    assert_derivative_is_transposed(Rotations(mesh).move(initial, surface))
    assert_derivative_is_exact(Rotations(mesh), initial, surface)


def test_moves_that_share_a_start_share_both_factors_and_have_the_bits_of_a_fresh_mover():
    mesh, solver = wing(), CountingSolver()
    mover = Rotations(mesh, solver=solver)
    surfaces = [bent_surface(mesh, size=size)[1] for size in (0.4, 0.1, 0.2)]
    start, found = None, []
    for surface in surfaces:
        movement = mover.move(mesh.points, surface, start=start)
        start = movement.start
        found.append(movement)
    assert len(solver.factorised) == 1
    assert all(movement.start.rotations is start.rotations for movement in found)
    again = Rotations(mesh).move(mesh.points, surfaces[-1])
    np.testing.assert_array_equal(found[-1].points, again.points)
    for mine, other in zip(found[-1].vjp(np.cos(mesh.points)), again.vjp(np.cos(mesh.points))):
        np.testing.assert_array_equal(mine, other)
    mover.move(1.01 * mesh.points, 1.01 * surfaces[0], start=start)
    assert len(solver.factorised) == 2


def test_points_are_a_smooth_function_of_the_design():
    mesh, mover = wing(), Rotations(wing())
    surface, start = bent_surface(mesh, size=0.2)[1], mover.start(mesh.points)
    step = surface - mesh.points[mesh.surface_ids]
    line = [mover.move(mesh.points, surface + t * step, start=start).points for t in np.linspace(-1.0, 0.0, 81)]
    coarse, fine = (np.abs(np.diff(part, n=3, axis=0)).max() for part in (line[::2], line))
    assert 7.0 < coarse / fine < 9.0  # third differences fall by 8 with half the step


@pytest.mark.slow
@pytest.mark.parametrize("is_turned", [False, True])
def test_slivers_leave_products_and_differences_exact(is_turned):
    mesh = plate_in_its_wake(is_turned)
    mover, surface = Rotations(mesh), pitched(mesh, is_turned)
    movement = mover.move(mesh.points, surface)
    lost = [lost_in_products(mesh, movement, seed) for seed in range(5)]
    by_surface, by_initial = np.median(lost, axis=0)
    assert by_surface < 1e-12
    assert by_initial < (1e-6 if is_turned else 1e-12)
    assert movement.report.digits > 14.0
    assert lost_in_differences(mover, surface, surface - mesh.points[mesh.surface_ids], h=3e-3) < 1e-9


@pytest.mark.slow
def test_products_on_a_c_grid_are_exact(real_grids):
    mesh, surface = section(real_grids, C_GRID, "valid")
    mover = Rotations(mesh)
    assert max(lost_in_products(mesh, mover.move(mesh.points, surface))) < 1e-12
    assert lost_in_differences(mover, surface, surface - mesh.points[mesh.surface_ids], h=3e-3) < 1e-9
    assert noise(mover, surface) < 1e-15
