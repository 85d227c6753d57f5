"""Springs: stiffness by independent formulas, and what every mover must pass."""

from itertools import combinations

import numpy as np
import pytest
from elastic_cases import assembled, by_columns, crooked_box
from mover_cases import (
    assert_derivative_is_exact,
    assert_derivative_is_transposed,
    bent_surface,
    channel,
    spacings,
    wing,
)

from bspline_mdao.core.movement import springs
from bspline_mdao.core.movement.spring_gradients import N_LINEAL, N_SPRINGS
from bspline_mdao.core.movement.springs import TorsionalSprings

CUBE = np.array([(a, b, d) for d in (0.0, 1.0) for b in (0.0, 1.0) for a in (0.0, 1.0)])
ONE = np.arange(8, dtype=np.int32)[None]


def open_channel(is_oblique=False):
    return channel(is_oblique, released=("farfield",))


def crooked_cube(seed=0, amount=0.3):
    return CUBE + amount * np.random.default_rng(seed).uniform(-1.0, 1.0, (8, 3))


def arguments(x, sign=1, torsion=1.0, degenerate_corners=0):
    return x, ONE, np.array([sign], np.int8), np.array([degenerate_corners], np.uint8), torsion


def numbers(x):
    """All that the springs of an element resist, and the weight of each."""
    lengths = [(np.log(np.linalg.norm(x[p] - x[q])), p, q) for p, q in combinations(range(8), 2)]
    values = [length * {1: 0.5, 2: np.sqrt(0.5), 3: 1.0}[bin(p ^ q).count("1")] for length, p, q in lengths]
    for c in range(8):
        legs = [(x[c ^ m] - x[c]) / np.linalg.norm(x[c ^ m] - x[c]) for m in (1, 2, 4)]
        values += [np.log(np.tan(0.5 * np.arccos(legs[p] @ legs[q]))) for p, q in ((0, 1), (1, 2), (2, 0))]
        values.append(np.log(np.abs(np.linalg.det(legs))))
    return np.array(values)


@pytest.mark.parametrize(("torsion", "n_springs"), [(0.0, N_LINEAL), (1.0, N_SPRINGS)])
def test_stiffness_is_the_sum_of_squares_of_the_changes_of_lengths_angles_and_triple_products(torsion, n_springs):
    x, h = crooked_cube(), 1e-3
    at = lambda unit, t: numbers(x + t * unit.reshape(8, 3))[:n_springs]  # noqa: E731
    gradients = np.stack(
        [
            (45 * (at(e, h) - at(e, -h)) - 9 * (at(e, 2 * h) - at(e, -2 * h)) + at(e, 3 * h) - at(e, -3 * h)) / (60 * h)
            for e in np.eye(24)
        ]
    )
    stiffness = by_columns(lambda u: springs.force(*arguments(x, torsion=torsion), u[None])[0], 8)
    np.testing.assert_allclose(stiffness, gradients @ gradients.T, atol=1e-9 * np.abs(stiffness).max())


def test_lineal_stiffness_is_the_inverse_square_of_the_length():
    x = CUBE * [1.0, 1.0, 4.0]
    pull = np.zeros((8, 3))
    pull[4:, 2] = 1.0  # stretches the four vertical edges, eight face and four body diagonals
    force = springs.force(*arguments(x, torsion=0.0), pull[None])[0, 4:, 2].sum()
    lengths, counts = np.sqrt([16.0, 17.0, 18.0]), np.array([4, 8, 4]) * [0.25, 0.5, 1.0]
    assert force == pytest.approx(np.sum(counts * lengths**-2.0 * (4.0 / lengths) ** 2), rel=1e-14)


@pytest.mark.parametrize("torsion", [0.0, 1.0])
@pytest.mark.parametrize(("amount", "sign"), [(0.2, 1), (0.9, 1), (0.2, -1)])
def test_stiffness_is_symmetric_with_six_rigid_body_modes_and_otherwise_positive(torsion, amount, sign):
    x = crooked_cube(4, amount)
    args = arguments(x, sign, torsion)
    stiffness = by_columns(lambda u: springs.force(*args, u[None])[0], 8)
    from_blocks = assembled(lambda *rest: springs.add_stiffness(*args, *rest), ONE, 8)
    np.testing.assert_allclose(from_blocks, stiffness, atol=1e-13 * np.abs(stiffness).max())
    rigid = [*np.repeat(np.eye(3)[:, None], 8, axis=1), *(np.cross(axis, x) for axis in np.eye(3))]
    assert np.abs(stiffness @ np.reshape(rigid, (6, 24)).T).max() < 1e-12 * np.abs(stiffness).max()
    eigenvalues = np.linalg.eigvalsh(stiffness)
    assert np.abs(eigenvalues[:6]).max() < 1e-13 * eigenvalues[-1]
    assert eigenvalues[6] > 1e-9 * eigenvalues[-1]


def test_torsion_does_not_depend_on_the_size_of_the_mesh():
    x = crooked_cube()
    forces = [springs.force(*arguments(scale * x), scale * crooked_cube(7)[None]) for scale in (1.0, 10.0)]
    np.testing.assert_allclose(forces[1], forces[0] / 10.0, rtol=1e-11, atol=1e-12)


def test_degenerate_corners_have_no_torsion():
    x = crooked_cube()
    unit = crooked_cube(3)[None]
    lineal = springs.force(*arguments(x, torsion=0.0), unit)
    np.testing.assert_array_equal(springs.force(*arguments(x, degenerate_corners=255), unit), lineal)


def collapsed():
    return crooked_box(amount=0.1, is_collapsed=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "tolerance"),
    # rounding of the ill-conditioned torsional network of thin elements limits what differences can show
    [(collapsed, 1e-8), (wing, 1e-5)],
)
def test_derivatives_are_exact_about_a_wing_and_with_collapsed_edges(make, tolerance):
    mesh = make()
    mover = TorsionalSprings(mesh, n_increments=2)
    initial, surface = bent_surface(mesh, size=0.02)
    assert_derivative_is_transposed(mover.move(initial, surface))
    assert_derivative_is_exact(mover, initial, surface, tolerance, scale=10.0 * spacings(mesh))


def test_torsion_keeps_elements_better_than_lineal_springs_alone():
    mesh = open_channel()
    initial, surface = bent_surface(mesh, size=0.1)
    moves = (TorsionalSprings(mesh, torsion=torsion).move(initial, surface) for torsion in (0.0, 0.01))
    lineal, torsional = (move.report.increments[-1] for move in moves)
    assert torsional.min_corner > lineal.min_corner
