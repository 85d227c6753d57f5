"""The elastic hexahedron: stiffness, forces and their derivatives, on elements as real meshes have them."""

import numpy as np
import pytest
from elastic_cases import assembled, by_columns, crooked_points

from bspline_mdao.core.movement import elasticity
from bspline_mdao.core.movement.trilinear import FLAT_ELEMENT, regularised, regularised_array

ONE = np.arange(8, dtype=np.int32)[None]
CUBE = np.array([(a, b, d) for d in (0.0, 1.0) for b in (0.0, 1.0) for a in (0.0, 1.0)])


def crooked_cube(seed=0, amount=0.3):
    return CUBE + amount * np.random.default_rng(seed).uniform(-1.0, 1.0, (8, 3))


def sheared_flat():
    """Element of which some Gauss points are on the rounded part of the floor: nearly flat, and partly folded."""
    return crooked_cube(3, 0.02) * np.array([1.0, 1.0, 0.01])


ELEMENTS = {
    "crooked": (crooked_cube(), 1),
    "left-handed": (crooked_cube(1)[[1, 0, 3, 2, 5, 4, 7, 6]], -1),
    "slender": (CUBE * np.array([1.0, 1e-3, 1e3]) + 1e-3 * (crooked_cube(2) - CUBE), 1),
    "folded": (crooked_cube(4, 0.9), 1),
    "mirrored": (crooked_cube(5), -1),
    "nearly flat": (sheared_flat(), 1),
}


def arguments(x, sign, modulus=1.7, poisson_ratio=-0.2):
    return x, ONE, np.array([sign], np.int8), np.array([modulus]), elasticity.lame_constants(poisson_ratio)


def reference_stiffness(x, sign, modulus, poisson_ratio):
    """Integral of B^T C B in Voigt notation, by 2 x 2 x 2 Gauss points."""
    lame, mu = elasticity.lame_constants(poisson_ratio)
    c = np.diag([2.0 * mu] * 3 + [mu] * 3)
    c[:3, :3] += lame
    total = np.zeros((24, 24))
    for point in 0.5 + (CUBE - 0.5) / np.sqrt(3.0):
        factors, slopes = np.where(CUBE == 1.0, point, 1.0 - point), 2.0 * CUBE - 1.0
        dn = np.stack([slopes[:, d] * np.delete(factors, d, axis=1).prod(axis=1) for d in range(3)], axis=1)
        jacobian = x.T @ dn
        dx, dy, dz = (dn @ np.linalg.inv(jacobian)).T
        b, o = np.zeros((6, 8, 3)), np.zeros(8)
        rows = (dx, o, o), (o, dy, o), (o, o, dz), (o, dz, dy), (dz, o, dx), (dy, dx, o)
        for row, values in enumerate(rows):
            b[row] = np.stack(values, axis=-1)
        b = b.reshape(6, 24)
        total += modulus * 0.125 * sign * np.linalg.det(jacobian) * b.T @ c @ b
    return total


@pytest.mark.parametrize("poisson_ratio", [-0.9, -0.2, 0.0, 0.3, 0.49])
@pytest.mark.parametrize("name", ["crooked", "left-handed", "slender"])
def test_stiffness_of_valid_elements_is_the_integral_of_the_strain_energy(name, poisson_ratio):
    x, sign = ELEMENTS[name]
    stiffness = by_columns(lambda u: elasticity.force(*arguments(x, sign, 1.7, poisson_ratio), u[None])[0], 8)
    expected = reference_stiffness(x, sign, 1.7, poisson_ratio)
    np.testing.assert_allclose(stiffness, expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", ELEMENTS)
def test_assembled_blocks_are_the_stiffness_of_the_force(name):
    args = arguments(*ELEMENTS[name])
    from_force = by_columns(lambda u: elasticity.force(*args, u[None])[0], 8)
    from_blocks = assembled(lambda *rest: elasticity.add_stiffness(*args, *rest), ONE, 8)
    np.testing.assert_allclose(from_blocks, from_force, atol=1e-13 * np.abs(from_force).max())


@pytest.mark.parametrize("corners", [[0, 1, 2, 3, 4, 1, 5, 3], [0, 1, 0, 2, 3, 4, 3, 5], [4, 1, 2, 3, 0, 0, 0, 0]])
def test_collapsed_edges_and_any_numbering_assemble_the_same(corners):
    elements = np.array([corners], np.int32)
    n = elements.max() + 1
    x = np.zeros((n, 3))
    x[corners] = crooked_cube()
    args = x, elements, *arguments(x, 1)[2:]
    from_force = by_columns(lambda u: elasticity.force(*args, u[None])[0], n)
    from_blocks = assembled(lambda *rest: elasticity.add_stiffness(*args, *rest), elements, n)
    assert np.isfinite(from_force).all()
    np.testing.assert_allclose(from_blocks, from_force, atol=1e-13 * np.abs(from_force).max())


@pytest.mark.parametrize("name", ["crooked", "left-handed", "folded", "mirrored", "nearly flat"])
def test_stiffness_is_symmetric_with_six_rigid_body_modes_and_otherwise_positive(name):
    x, sign = ELEMENTS[name]
    stiffness = by_columns(lambda u: elasticity.force(*arguments(x, sign), u[None])[0], 8)
    np.testing.assert_allclose(stiffness, stiffness.T, atol=1e-13 * np.abs(stiffness).max())
    turns = [np.cross(axis, x) for axis in np.eye(3)]
    rigid = np.stack([*np.repeat(np.eye(3)[:, None], 8, axis=1), *turns]).reshape(6, 24)
    assert np.abs(stiffness @ rigid.T).max() < 1e-13 * np.abs(stiffness).max()
    eigenvalues = np.linalg.eigvalsh(stiffness)
    assert np.abs(eigenvalues[:6]).max() < 1e-13 * eigenvalues[-1]
    assert eigenvalues[6] > 1e-8 * eigenvalues[-1]


def mesh_of_many(dtype=float):
    """Elements of all kinds side by side, with random fields on them."""
    x = np.concatenate([x for x, _ in ELEMENTS.values()]).astype(dtype)
    n = len(ELEMENTS)
    signs = np.array([sign for _, sign in ELEMENTS.values()], np.int8)
    elements = np.arange(8 * n, dtype=np.int32).reshape(n, 8)
    elements[-1, 5] = elements[-1, 4]  # one of them has a collapsed edge
    rng = np.random.default_rng(11)
    return x, elements, signs, rng.uniform(0.5, 2.0, n).astype(dtype), elasticity.lame_constants(0.3), rng


@pytest.mark.slow
def test_change_of_the_force_is_its_complex_step():
    x, elements, signs, modulus, lame, rng = mesh_of_many(complex)
    u, dx, du = rng.normal(size=(3, *x.shape))
    dx *= np.ptp(x.real.reshape(-1, 8, 3), axis=1).min(axis=1).repeat(8)[:, None]  # an element's smallest extent
    d_modulus = rng.normal(size=modulus.shape)
    fixed = x.real.copy(), elements, signs, modulus.real.copy(), lame  # contiguous, as the kernels are compiled for
    change = (elasticity.force_jvp(*fixed, u[None], dx, d_modulus) + elasticity.force(*fixed, du[None]))[0]
    h = 1e-40
    moved = x + 1j * h * dx, elements, signs, modulus + 1j * h * d_modulus, lame
    step = elasticity.force(*moved, u[None] + 1j * h * du[None])[0].imag / h
    scale = np.abs(change).reshape(-1, 24).max(axis=1).repeat(8)[:, None]
    assert (np.abs(step - change) < 1e-12 * scale).all()


def test_reverse_is_the_transpose_of_forward():
    x, elements, signs, modulus, lame, rng = mesh_of_many()
    u, dx, du, bar = rng.normal(size=(4, *x.shape))
    force = elasticity.force(x, elements, signs, modulus, lame, u[None])[0]
    bar[elements] /= np.abs(force)[elements].max(axis=(1, 2), keepdims=True)
    d_modulus = rng.normal(size=modulus.shape)
    fixed = x, elements, signs, modulus, lame
    change = bar * (elasticity.force_jvp(*fixed, u[None], dx, d_modulus) + elasticity.force(*fixed, du[None]))[0]
    points_bar, modulus_bar, displacement_bar = elasticity.force_vjp(*fixed, u[None], bar[None])
    terms = points_bar * dx, modulus_bar * d_modulus, displacement_bar * du
    assert abs(change.sum() - sum(t.sum() for t in terms)) < 1e-13 * max(np.abs(t).sum() for t in (change, *terms))
    np.testing.assert_allclose(displacement_bar, elasticity.force(*fixed, bar[None])[0], rtol=1e-9)


def test_floor_leaves_large_values_and_is_positive_and_twice_differentiable():
    t = np.linspace(-1.0, 1.0, 4001)
    values, slopes = regularised_array(t, FLAT_ELEMENT)
    np.testing.assert_array_equal(values[t >= FLAT_ELEMENT], t[t >= FLAT_ELEMENT])
    assert values.min() > FLAT_ELEMENT / 2.0
    assert (slopes > 0.0).all()
    h = 1e-30
    for point in (-0.5, 0.0, 0.9 * FLAT_ELEMENT, 0.5):
        value, slope = regularised(point + 1j * h, FLAT_ELEMENT)
        assert value.imag / h == pytest.approx(slope.real, rel=1e-14)
    for epsilon in (1e-4, 1e-5):  # the slope leaves 1 with the square of the distance
        assert 1.0 - regularised(FLAT_ELEMENT * (1.0 - epsilon), FLAT_ELEMENT)[1] < 30.0 * epsilon**2


def test_forces_of_a_lattice_without_strain_vanish():
    x = crooked_points((3, 4, 2), 0.3)
    ids = np.arange(24).reshape(3, 4, 2)
    low, high = slice(None, -1), slice(1, None)
    corners = [ids[i, j, k].ravel() for k in (low, high) for j in (low, high) for i in (low, high)]
    elements = np.stack(corners, axis=-1).astype(np.int32)
    signs, modulus = np.ones(len(elements), np.int8), np.random.default_rng(0).uniform(1.0, 9.0, len(elements))
    turn = np.cross([0.3, -0.5, 0.8], x) + np.array([1.0, 2.0, 3.0])
    assert (
        np.abs(elasticity.force(x, elements, signs, modulus, elasticity.lame_constants(0.4), turn[None])).max() < 1e-12
    )


@pytest.mark.parametrize("poisson_ratio", [-0.6, -0.2, 0.0, 0.3, 0.45])
def test_a_bar_in_tension_has_youngs_modulus_and_thins_by_poissons_ratio(poisson_ratio):
    sizes, strain = np.array([2.0, 0.7, 1.3]), 0.01
    x = CUBE * sizes
    pulled = strain * x * [1.0, -poisson_ratio, -poisson_ratio]
    force = elasticity.force(*arguments(x, 1, modulus=1.7, poisson_ratio=poisson_ratio), pulled[None])[0]
    ends = force[CUBE[:, 0] == 1.0, 0].sum(), force[CUBE[:, 0] == 0.0, 0].sum()
    np.testing.assert_allclose(ends, np.array([1.7, -1.7]) * strain * sizes[1] * sizes[2], rtol=1e-12)
    np.testing.assert_allclose(force[:, 1:], 0.0, atol=1e-15)
