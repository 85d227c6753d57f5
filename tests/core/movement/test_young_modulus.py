"""Stiffness laws: their values by independent formulas, and their derivatives."""

import numpy as np
import pytest
from elastic_cases import crooked_box

from bspline_mdao.core.movement.young_modulus import (
    ConstantLaw,
    InverseVolumeLaw,
    OrthogonalityLaw,
    RegularisedMeasures,
    WallDistanceLaw,
)
from bspline_mdao.grids.cells.hexahedron import cell_quality
from bspline_mdao.testing import central_difference

LAWS = [OrthogonalityLaw(), InverseVolumeLaw(), InverseVolumeLaw(0.5, shape=1.5), WallDistanceLaw(1.5), ConstantLaw()]


def two_states(mesh, amount=0.05):
    random = np.random.default_rng(4)
    return mesh.points + amount * random.normal(size=mesh.points.shape), mesh.points


def folded_box():
    """Mesh with folded elements, collapsed edges and both hands."""
    return crooked_box(amount=0.55, is_collapsed=True)


def block_values(mesh, points, name):
    """A measure of all elements by the kernel of cell quality, with the mesh's own collapsed corners."""
    out, start = [], 0
    for ids in mesh.blocks:
        shape = tuple(n - 1 for n in ids.shape)
        degenerate_corners = mesh.degenerate_corners[start : start + np.prod(shape)].reshape(shape)
        out.append(getattr(cell_quality(points[ids], degenerate_corners), name).ravel())
        start += np.prod(shape)
    return np.concatenate(out)


def test_the_default_law_is_that_of_the_paper():
    mesh = crooked_box(amount=0.1, is_collapsed=True)
    initial, points = two_states(mesh)
    q_0, q = (block_values(mesh, x, "q") for x in (initial, points))
    expected = (q_0 / q) ** 2 / block_values(mesh, points, "volume")
    np.testing.assert_allclose(OrthogonalityLaw().modulus(mesh, initial, points), expected, rtol=1e-11)


def test_laws_start_from_the_volume_alone():
    mesh = crooked_box()
    at_start = [law.modulus(mesh, mesh.points, mesh.points) for law in (OrthogonalityLaw(), InverseVolumeLaw())]
    np.testing.assert_allclose(*at_start, rtol=1e-14)
    np.testing.assert_allclose(at_start[1], 1.0 / block_values(mesh, mesh.points, "volume"), rtol=1e-12)


def test_stiffness_falls_with_the_distance_from_the_surface():
    mesh = crooked_box(amount=0.0)
    heights = mesh.points[mesh.elements].mean(axis=1)[:, 2]
    modulus = WallDistanceLaw(2.0).modulus(mesh, mesh.points, mesh.points)
    np.testing.assert_allclose(modulus, 1.0 / (heights**2 + 0.5), rtol=1e-9)


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_laws_are_positive_and_finite_on_folded_and_collapsed_elements(law):
    mesh = folded_box()
    initial, points = two_states(mesh)
    assert (block_values(mesh, points, "min_corner") < 0.0).sum() > 10
    modulus = law.modulus(mesh, initial, points)
    assert np.isfinite(modulus).all()
    assert (modulus > 0.0).all()


@pytest.mark.parametrize("law", LAWS, ids=repr)
@pytest.mark.parametrize("make", [crooked_box, folded_box])
def test_derivatives_of_laws_agree_with_central_differences_and_are_transposed(law, make):
    mesh, random = make(), np.random.default_rng(8)
    initial, points = two_states(mesh)
    d_initial, d_points = random.normal(size=(2, *points.shape))
    change = law.modulus_jvp(mesh, initial, points, d_initial, d_points)
    modulus = law.modulus(mesh, initial, points)

    def at(h):
        return law.modulus(mesh, initial + h * d_initial, points + h * d_points)

    h = 2e-5 if make is crooked_box else 1e-6
    difference = central_difference(at, 2.0 * h, levels=2)
    scale = np.abs(change / modulus).max() + 1.0
    tolerance = 1e-9 if make is crooked_box else 1e-6  # floors of folded elements bend sharply
    np.testing.assert_allclose(difference / modulus, change / modulus, atol=tolerance * scale)
    bar = random.normal(size=modulus.shape) / modulus
    initial_bar, points_bar = law.modulus_vjp(mesh, initial, points, bar)
    terms = np.vdot(initial_bar, d_initial), np.vdot(points_bar, d_points)
    assert abs(np.vdot(bar, change) - sum(terms)) < 1e-11 * (np.linalg.norm(bar * modulus) * scale)


@pytest.mark.parametrize("weights", [(1.0, 0.0), (0.0, 1.0), (-2.0, -1.0)])
def test_measures_do_not_change_with_rigid_motion(weights):
    mesh = folded_box()
    by_corners = RegularisedMeasures.at(mesh, mesh.points).gradient(*weights)
    scale = np.abs(by_corners).max(axis=(1, 2))
    for axis in np.eye(3):
        for motion in (np.tile(axis, (mesh.n_points, 1)), np.cross(axis, mesh.points)):
            change = np.einsum("ecd,ecd->e", by_corners, motion[mesh.elements])
            assert (np.abs(change) < 1e-11 * scale * 6.0).all()


def test_orthogonality_does_not_depend_on_size_and_volume_does():
    mesh = folded_box()
    once, twice = RegularisedMeasures.at(mesh, mesh.points), RegularisedMeasures.at(mesh, 2.0 * mesh.points)
    np.testing.assert_allclose(twice.log_orthogonality, once.log_orthogonality, atol=1e-11)
    np.testing.assert_allclose(twice.log_volume, once.log_volume + np.log(8.0), atol=1e-11)
