"""Linear elasticity in increments: what it must leave alone, what it must reproduce, and its derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from elastic_cases import assembled, crooked_box
from mover_cases import (
    CountingSolver,
    assert_derivative_is_exact,
    assert_derivative_is_transposed,
    bent_surface,
    channel,
    oblique_channel,
    plate,
    random_changes,
    spacings,
    wing,
)

from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.movement.elasticity import ElasticElements, LinearElasticity, lame_constants
from bspline_mdao.core.movement.equilibrium import Unknowns
from bspline_mdao.core.movement.young_modulus import ConstantLaw, InverseVolumeLaw, OrthogonalityLaw, WallDistanceLaw
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.grids.cells.hexahedron import element_measures
from bspline_mdao.grids.io.files import read_grid
from bspline_mdao.grids.io.patch_guess import guess_patches
from bspline_mdao.grids.topology.detection import find_topology

MESHES = [channel, oblique_channel, plate, wing]


def open_channel(is_oblique=False):
    return channel(is_oblique, released=("farfield",))


def collapsed():
    return crooked_box(amount=0.1, is_collapsed=True)


@pytest.mark.parametrize("n_increments", [1, 4])
@pytest.mark.parametrize("poisson_ratio", [-0.9, -0.2, 0.3, 0.45])
def test_patch_test_of_crooked_elements_of_both_hands(poisson_ratio, n_increments):
    mesh = crooked_box(is_enclosed=True)
    matrix = np.eye(3) + 0.4 * np.random.default_rng(2).normal(size=(3, 3))
    moved = mesh.points @ matrix + [0.1, 0.2, 0.3]
    mover = LinearElasticity(mesh, poisson_ratio, n_increments, ConstantLaw())
    np.testing.assert_allclose(mover.move(mesh.points, moved[mesh.surface_ids]).points, moved, atol=1e-12)


@pytest.mark.parametrize("n_increments", [1, 3])
def test_boundaries_turned_in_increments_turn_the_mesh(n_increments):
    mesh = crooked_box(amount=0.0, is_enclosed=True)  # one modulus for all elements, in every increment
    angle = 1.2
    turn = np.array([[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]])
    moved = mesh.points @ turn.T
    points = LinearElasticity(mesh, n_increments=n_increments).move(mesh.points, moved[mesh.surface_ids]).points
    np.testing.assert_allclose(points, moved, atol=1e-12)


@pytest.mark.slow
def test_stiffness_of_the_unknowns_is_that_of_the_elements_in_their_free_directions():
    mesh = oblique_channel()
    law, lame = OrthogonalityLaw(), lame_constants(0.2)
    modulus = law.modulus(mesh, mesh.points, mesh.points)
    elements = ElasticElements(mesh, law, lame, mesh.points, mesh.points, modulus)
    unknowns = Unknowns(mesh)
    matrix = unknowns.matrix(elements.add_stiffness)
    dense = assembled(elements.add_stiffness, mesh.elements, mesh.n_points)
    x = np.random.default_rng(0).normal(size=(matrix.pattern.n, 3))
    is_free = mesh.is_free[unknowns.point_ids]
    force = (dense @ unknowns.scatter(x).ravel()).reshape(-1, 3)
    np.testing.assert_allclose(
        matrix.dot(x), np.where(is_free, unknowns.gather(force), x), atol=1e-12 * np.abs(dense).max()
    )
    lower = matrix.to_scipy().toarray()
    assert np.linalg.eigvalsh(lower + np.tril(lower, -1).T).min() > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("law", [InverseVolumeLaw(), WallDistanceLaw(), ConstantLaw()], ids=repr)
def test_derivatives_are_exact_with_other_stiffness_laws(law):
    mover = LinearElasticity(open_channel(), 0.3, 3, law)
    initial, surface = bent_surface(mover.mesh, size=0.1)
    assert_derivative_is_transposed(mover.move(initial, surface))
    assert_derivative_is_exact(mover, initial, surface)


@pytest.mark.slow
def test_derivatives_are_exact_about_a_wing_and_with_collapsed_edges():
    for mesh in (wing(), collapsed()):
        mover = LinearElasticity(mesh, n_increments=2)
        initial, surface = bent_surface(mesh, size=0.05)
        assert_derivative_is_transposed(mover.move(initial, surface))
        assert_derivative_is_exact(mover, initial, surface, scale=10.0 * spacings(mesh))


def test_taylor_remainders_fall_with_the_square_of_the_step():
    mover = LinearElasticity(open_channel(), n_increments=5)
    initial, surface = bent_surface(mover.mesh, size=0.1)
    _, d_surface = random_changes(mover.mesh)
    movement = mover.move(initial, surface)
    value = np.sum(np.sin(movement.points))
    _, gradient = movement.vjp(np.cos(movement.points))
    steps = 1e-3 / 2.0 ** np.arange(5)
    values = [np.sum(np.sin(mover.move(initial, surface + h * d_surface).points)) for h in steps]
    remainders = np.abs(np.array(values) - value - steps * np.vdot(gradient, d_surface))
    np.testing.assert_allclose(np.log2(remainders[:-1] / remainders[1:]), 2.0, atol=0.05)


def test_moves_that_share_a_start_share_its_factor_and_others_are_not_mixed_up():
    solver = CountingSolver()
    mover = LinearElasticity(channel(), n_increments=3, solver=solver)
    initial, surface = bent_surface(mover.mesh)
    first = mover.move(initial, surface)
    assert len(solver.factorised) == 3
    mover.move(initial.copy(), surface + 0.0, start=first.start)
    assert len(solver.factorised) == 5
    other = mover.move(1.1 * initial, 1.1 * surface, start=first.start)
    assert len(solver.factorised) == 8
    np.testing.assert_array_equal(mover.move(initial, surface, start=other.start).points, first.points)
    assert len(solver.factorised) == 11
    np.testing.assert_array_equal(mover.move(initial, surface, start=mover.start(initial)).points, first.points)
    assert len(solver.factorised) == 14


def test_derivatives_without_kept_factors_are_the_same_and_factorise_again():
    mesh, solver = channel(), CountingSolver()
    initial, surface = bent_surface(mesh)
    kept = LinearElasticity(mesh, n_increments=3, keep_factors=True).move(initial, surface)
    lean = LinearElasticity(mesh, n_increments=3, solver=solver, keep_factors=False).move(initial, surface)
    assert len(solver.factorised) == 3
    for mine, other in zip(lean.vjp(kept.points), kept.vjp(kept.points)):
        np.testing.assert_array_equal(mine, other)
    assert len(solver.factorised) == 5


def test_factors_that_are_not_needed_any_more_make_room_for_the_next():
    mesh, solver = open_channel(), CountingSolver()
    initial, surface = bent_surface(mesh)
    mover = LinearElasticity(mesh, n_increments=3, solver=solver, keep_factors=False)
    mover.move(initial, surface)
    mover.move(1.01 * initial, 1.01 * surface)
    assert solver.n_alive == [0, 1, 1, 0, 1, 1]  # that of the first increment serves its derivative


def test_increments_keep_the_elements_of_a_large_move_better():
    mesh = open_channel()
    initial, surface = bent_surface(mesh, size=0.1)
    one, five = (LinearElasticity(mesh, n_increments=m).move(initial, surface).report for m in (1, 5))
    assert five.increments[-1].min_corner > one.increments[-1].min_corner


@pytest.mark.parametrize("poisson_ratio", [-1.0, 0.5, np.nan])
def test_poisson_ratios_out_of_range_are_refused(poisson_ratio):
    with pytest.raises(InputError, match=r"between -1 and 0\.5"):
        LinearElasticity(channel(), poisson_ratio)


class StiffAbove(ConstantLaw):
    """A user's own law: one modulus below a height, another above it."""

    def __init__(self, above):
        self.above = above

    def modulus(self, mesh, initial, points):
        """See `StiffnessLaw.modulus`."""
        return np.where(mesh.points[mesh.elements].mean(axis=1)[:, 2] > 0.4, self.above, 1.0)


def test_a_stiffness_law_of_the_user_is_followed():
    mesh = open_channel()
    initial, surface = bent_surface(mesh, size=0.05)
    stiff, even = (LinearElasticity(mesh, n_increments=1, stiffness=law) for law in (StiffAbove(1e6), ConstantLaw()))
    is_above = mesh.points[:, 2] > 0.6
    bends = [
        np.linalg.norm(np.diff(mover.move(initial, surface).points[is_above] - initial[is_above], axis=0))
        for mover in (stiff, even)
    ]
    assert bends[0] < 0.5 * bends[1]


@pytest.mark.parametrize("bad", [-1.0, np.nan])
def test_a_stiffness_that_cannot_be_solved_is_told(bad):
    mesh = channel()
    with pytest.raises(MovementError):
        LinearElasticity(mesh, stiffness=StiffAbove(bad)).move(mesh.points, mesh.points[mesh.surface_ids] + 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["pyhyp_m6_9blocks.xyz", "cfl3d_delta_wing.fmt.gz", "cfl3d_sduct.bin"])
def test_stiffness_is_positive_definite_on_fitted_meshes_with_folded_elements(real_grids, name):
    grid = read_grid(real_grids / name)
    windows = [face.window for face in find_topology(grid).boundary]
    model = fit_grid(replace(grid, patches=guess_patches(grid, windows)), method="least_squares")
    mesh = moving_mesh(model, design="*")
    triples = element_measures(mesh.points[mesh.elements], mesh.handedness, mesh.degenerate_corners).triples
    assert triples.min() < -0.1
    report = LinearElasticity(mesh, n_increments=2).move(mesh.points, 1.05 * mesh.points[mesh.surface_ids]).report
    assert max(increment.solve.residual for increment in report.increments) < 1e-10
