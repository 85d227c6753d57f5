"""Preconditioner, linear systems and Newton steps of the Euler solver."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from euler_cases import case_of, one_of_each_kind, sphere_quarters
from topology_cases import smooth_box

from bspline_mdao.base.numerics.vec5 import zero_halves
from bspline_mdao.core.generators.wing import cambered_section
from bspline_mdao.flow.euler import factor_pattern as pattern_module
from bspline_mdao.flow.euler import newton
from bspline_mdao.flow.euler.block_factor import BLOCK, BlockFactor
from bspline_mdao.flow.euler.factor_pattern import FactorPattern, factor_pattern
from bspline_mdao.flow.euler.flux import ROUNDING
from bspline_mdao.flow.euler.gas import GAMMA
from bspline_mdao.flow.euler.krylov import RESTART, solve_refined, solve_roughly, solve_system
from bspline_mdao.flow.euler.newton import relative_residual
from bspline_mdao.flow.euler.newton_step import NewtonStep
from bspline_mdao.flow.euler.preconditioner import (
    COMPACT_DISSIPATION,
    FLAT,
    FLAT_ROUNDING,
    by_surface,
    carried_excess,
    compact_factor,
    time_terms,
)
from bspline_mdao.flow.euler.reconstruction import FIRST, INNER
from bspline_mdao.flow.euler.residual import SHOCK_THRESHOLD, Discretization
from bspline_mdao.flow.euler.settings import NEWTON
from bspline_mdao.generators import Spacing, flat_plate_grid, infinite_wing_grid

SINGLE = float(np.finfo(np.float32).eps)

HALF = 2.0**-8
"""Rounding of the numbers of a factor."""


@cache
def box_case(shock_threshold=0.0):
    return case_of(one_of_each_kind(smooth_box(6, 5, 7)), shock_threshold=shock_threshold)


@cache
def flat_case():
    """Cells two hundred times as long and wide as they are high."""
    return case_of(one_of_each_kind(smooth_box(6, 5, 7) * np.array([1.0, 0.005, 1.0])))


@cache
def sphere_case():
    (grid,) = sphere_quarters([6])
    return case_of(grid, mach=0.2, degrees=0.0, axes=np.eye(3))


@cache
def sphere_flow():
    return sphere_case().solve()


def dense(blocks, rows, columns, n):
    """Matrix of blocks at given rows and columns, those at the same place added."""
    matrix = np.zeros((n, n, BLOCK, BLOCK))
    np.add.at(matrix, (rows, columns), blocks)
    return matrix.transpose(0, 2, 1, 3).reshape(n * BLOCK, n * BLOCK)


def random_system(n=23, n_pairs=60, seed=0):
    """Pairs of neighbours, the blocks that each row has at the other, and the blocks on the diagonal."""
    rng = np.random.default_rng(seed)
    pairs = np.unique(np.sort(rng.integers(0, n, (n_pairs, 2)), axis=1), axis=0)
    left, right = pairs[pairs[:, 0] < pairs[:, 1]].T
    diagonal = rng.standard_normal((n, BLOCK, BLOCK)) + 12.0 * np.eye(BLOCK)
    return left, right, *rng.standard_normal((2, len(left), BLOCK, BLOCK)), diagonal


def couplings_of(left, right, n):
    """Random couplings of pairs, and a diagonal that is above their sums."""
    couplings = np.random.default_rng(2).uniform(0.1, 1.0, len(left))
    return couplings, np.bincount(np.append(left, right), np.append(couplings, couplings), n) + 0.1


def halves_of(numbers):
    """Numbers rounded to 16 bits of single precision, ties to even."""
    bits, halves = numbers.astype(np.float32).view(np.uint32), zero_halves(numbers.shape)
    halves[:] = (bits + 0x7FFF + ((bits >> 16) & 1)) >> 16
    return halves


def factor_of(left, right, at_right, at_left, diagonal, smallest):
    """Factor of the matrix with ``at_right`` in the left rows and ``at_left`` in the right rows."""
    pattern = FactorPattern.of(left, right, *couplings_of(left, right, len(diagonal)), smallest=smallest)
    lower, upper = np.zeros((2, len(pattern.columns), BLOCK, BLOCK))
    is_low = pattern.rank[left] > pattern.rank[right]
    lower[pattern.places] = np.where(is_low[:, None, None], at_right, at_left)
    upper[pattern.places] = np.where(is_low[:, None, None], at_left, at_right)
    placed = np.empty_like(diagonal)
    placed[pattern.rank] = diagonal
    return BlockFactor.of(pattern, halves_of(lower), halves_of(upper), placed.astype(np.float32))


def refined_by(factor, product, right):
    """Solution by a factor that is exact up to rounding, refined until that no longer shows."""
    x = np.zeros_like(right)
    for _ in range(4):
        x += factor.solve(right - product(x))
    return x


@pytest.mark.slow
def test_a_factor_with_all_fill_is_exact_to_the_halves_that_are_kept_of_its_numbers():
    left, right, at_right, at_left, diagonal = system = random_system()
    n = len(diagonal)
    blocks, cells = np.concatenate([at_right, at_left, diagonal]), np.arange(n)
    matrix = dense(blocks, np.concatenate([left, right, cells]), np.concatenate([right, left, cells]), n)
    factor = factor_of(*system, smallest=0.0)
    rhs = np.random.default_rng(1).standard_normal((n, BLOCK))
    np.testing.assert_allclose(factor.solve(rhs).ravel(), np.linalg.solve(matrix, rhs.ravel()), atol=HALF)
    refined = refined_by(factor, lambda x: (matrix @ x.ravel()).reshape(x.shape), rhs)
    np.testing.assert_allclose(refined.ravel(), np.linalg.solve(matrix, rhs.ravel()), atol=50 * SINGLE)
    transposed = np.linalg.solve(matrix.T, rhs.ravel())
    np.testing.assert_allclose(factor.into_transposed().solve(rhs).ravel(), transposed, atol=HALF)


def test_less_fill_is_less_exact_and_takes_fewer_blocks():
    system = random_system()
    rhs = np.random.default_rng(1).standard_normal((23, BLOCK))
    factors = [factor_of(*system, smallest=smallest) for smallest in (np.inf, 0.05, 0.0)]
    sizes = [len(factor.lower) for factor in factors]
    errors = [np.linalg.norm(factor.solve(rhs) - factors[-1].solve(rhs)) for factor in factors[:2]]
    assert sizes[0] == len(system[0]) < sizes[1] < sizes[2]
    assert errors[0] > errors[1] > 1e-3


def large_entries(matrix, order, smallest):
    """Pairs with a large entry in the factor of a matrix of numbers, and all neighbours, found one by one."""
    rest, kept = matrix[np.ix_(order, order)].astype(float), matrix[np.ix_(order, order)] != 0.0
    is_neighbour, first = kept.copy(), np.diag(rest).copy()
    for i in range(len(order)):
        for k in range(i):
            kept[i, k] = is_neighbour[i, k] or abs(rest[i, k]) > smallest * min(first[i], rest[k, k])
            if kept[i, k]:
                others = [j for j in range(k + 1, i) if kept[j, k]]
                rest[i, others] -= rest[i, k] * rest[others, k] / rest[k, k]
                rest[i, i] -= rest[i, k] ** 2 / rest[k, k]
    return {frozenset((order[i], order[k])) for i, k in np.argwhere(np.tril(kept, -1))}


@pytest.mark.parametrize("smallest", [0.02, 0.1])
def test_fill_is_kept_where_the_factor_of_the_areas_is_large(smallest):
    left, right, *_, diagonal = random_system()
    couplings, sums = couplings_of(left, right, len(diagonal))
    matrix = np.diag(sums)
    matrix[left, right] = matrix[right, left] = -couplings
    found = FactorPattern.of(left, right, couplings, sums, smallest=smallest)
    rows = np.repeat(found.order, np.diff(found.starts))
    expected = large_entries(matrix, found.order, smallest)
    assert {frozenset(pair) for pair in zip(rows, found.order[found.columns])} == expected
    assert len(left) < len(expected) < len(FactorPattern.of(left, right, couplings, sums, smallest=0.0).columns)


@pytest.mark.parametrize("smallest", [np.inf, 0.05, 0.0])
def test_solves_with_a_factor_and_its_transpose_agree(smallest):
    factor = factor_of(*random_system(), smallest=smallest)
    a, b = np.random.default_rng(2).standard_normal((2, 23, BLOCK))
    assert np.vdot(factor.solve(a), b) == pytest.approx(
        np.vdot(a, factor.into_transposed().solve(b)), abs=20.0 * SINGLE
    )


def test_the_transpose_of_a_transposed_factor_is_the_factor_to_the_last_bit():
    ours, theirs = (factor_of(*random_system(), smallest=0.05) for _ in range(2))
    once = theirs.into_transposed()
    assert once.is_transposed
    assert not np.array_equal(once.lower, ours.lower)
    twice = once.into_transposed()
    assert not twice.is_transposed
    for name in ("lower", "upper", "pivots"):
        np.testing.assert_array_equal(vars(twice)[name], vars(ours)[name])


def conserved_by_states(states):
    """Derivatives of the conserved quantities, by complex steps, shape (n, 5, 5)."""
    moved = states[:, None, :] + 1e-30j * np.eye(BLOCK)
    energy = moved[..., 4] / (GAMMA - 1.0) + 0.5 * moved[..., 0] * np.sum(moved[..., 1:4] ** 2, axis=-1)
    conserved = np.concatenate([moved[..., :1], moved[..., :1] * moved[..., 1:4], energy[..., None]], axis=-1)
    return conserved.imag.transpose(0, 2, 1) / 1e-30


def excess_of(case):
    """Half the speed that faces twenty times as large as the middle ones of both cells are rounded off by too much."""
    faces, sizes = case.faces, np.linalg.norm(case.areas, axis=1)
    of_cells = [
        np.concatenate([sizes[faces.left == c], sizes[: faces.n_inner][faces.right == c]]) for c in range(faces.n_cells)
    ]
    middle = np.array([np.sort(of_one)[::-1][2:4].mean() for of_one in of_cells])
    left, right, inner = faces.left[: faces.n_inner], faces.right, slice(0, faces.n_inner)
    part = np.maximum(FLAT_ROUNDING, ROUNDING * FLAT * np.maximum(middle[left], middle[right]) / sizes[inner])
    mean = 0.5 * (case.states[left] + case.states[right])
    through, sound = (
        np.sum(mean[:, 1:4] * case.areas[inner], axis=1),
        np.sqrt(GAMMA * mean[:, 4] / mean[:, 0]) * sizes[inner],
    )
    out = np.zeros(len(sizes))
    out[inner] = 0.5 * (np.hypot(through, ROUNDING * sound) - np.hypot(through, np.minimum(part, ROUNDING) * sound))
    return out


def compact_jacobian(case, dissipation):
    """The compact neighbour of the Jacobian, from the Jacobians of the faces, of flat ones with less of a jump."""
    stencil, faces, by_state = (
        case.discretization.stencil,
        case.faces,
        case.linearization.jacobians.values.astype(float),
    )
    mean, jump = by_state[..., :BLOCK], by_state[..., BLOCK:]
    inner = slice(0, faces.n_inner)
    left, right = faces.left[inner], faces.right
    half_way = 0.5 * (case.states[left] + case.states[right])
    jump[inner] += excess_of(case)[inner, None, None] * conserved_by_states(half_way)
    from_left = 0.5 * mean[inner] - dissipation * jump[inner]
    from_right = 0.5 * mean[inner] + dissipation * jump[inner]
    edge = slice(faces.n_inner, None)
    means, differences = stencil.means[stencil.classes[edge]], stencil.differences[stencil.lines[edge]]
    at_edge = means[:, 1, None, None] * mean[edge] + differences[:, FIRST, 1, None, None] * jump[edge]
    behind = means[:, [0, 2]].sum(axis=1)[:, None, None] * mean[edge]
    blocks = np.concatenate([from_left, from_right, -from_left, -from_right, at_edge, behind])
    rows = np.concatenate([left, left, right, right, faces.left[edge], faces.left[edge]])
    columns = np.concatenate([left, right, left, right, faces.left[edge], stencil.cells[edge, 0]])
    assert (stencil.roles[inner] == INNER).all()
    return dense(blocks, rows, columns, faces.n_cells)


def test_what_flat_faces_carry_is_rounded_off_by_less_in_the_preconditioner_and_in_cubes_nothing_is():
    np.testing.assert_array_equal(carried_excess(box_case().linearization), 0.0)
    expected = excess_of(flat_case())
    assert 0 < np.count_nonzero(expected) < len(expected)
    np.testing.assert_allclose(carried_excess(flat_case().linearization), expected, rtol=1e-5, atol=1e-12)


def test_on_large_grids_the_factor_has_more_fill_and_systems_take_fewer_products(monkeypatch):
    case = sphere_case()
    linearization = case.discretization.linearize(sphere_flow().states, case.areas, case.stream)
    right = np.random.default_rng(3).standard_normal((case.faces.n_cells, 5)).astype(np.float32)

    def blocks_and_products():
        pattern = factor_pattern(case.discretization, np.linalg.norm(case.areas, axis=1))
        factor = compact_factor(linearization, pattern, np.zeros((len(right), 5, 5)))
        system = by_surface(linearization.jacobians.product, factor.solve, case.discretization.sizes(case.areas))
        return len(pattern.columns), solve_system(*system, right, 1e-4).n_products

    plain = blocks_and_products()
    monkeypatch.setattr(pattern_module, "LARGE", case.faces.n_cells // 3)
    more = blocks_and_products()
    assert more[0] > 1.2 * plain[0]
    assert more[1] < plain[1]


@pytest.mark.parametrize("case_name", ["box_case", "flat_case"])
def test_the_preconditioner_is_a_factor_of_the_compact_neighbour_of_the_jacobian(monkeypatch, case_name):
    case = globals()[case_name]()
    diagonal = time_terms(case.discretization, case.states, case.areas)
    monkeypatch.setattr(pattern_module, "smallest_entry", lambda n_cells: 0.0)
    pattern = factor_pattern(case.discretization, np.linalg.norm(case.areas, axis=1))
    factor, cells = compact_factor(case.linearization, pattern, diagonal), np.arange(case.faces.n_cells)
    matrix = compact_jacobian(case, COMPACT_DISSIPATION) + dense(diagonal, cells, cells, len(cells))
    solved = refined_by(factor, lambda x: (matrix @ x.ravel()).reshape(x.shape), case.states)
    np.testing.assert_allclose((matrix @ solved.ravel()).reshape(solved.shape), case.states, atol=1e-4)
    np.testing.assert_allclose(factor.solve(case.states), solved, atol=30 * HALF * np.abs(solved).max())


def test_time_terms_are_the_conserved_quantities_by_the_states_times_half_the_wave_speeds():
    case = box_case()
    terms = time_terms(case.discretization, case.states, case.areas)
    rates = np.zeros(case.faces.n_cells)
    for cells, areas in ((case.faces.left, case.areas), (case.faces.right, case.areas[: case.faces.n_inner])):
        w, size = case.states[cells], np.linalg.norm(areas, axis=1)
        sound = np.sqrt(GAMMA * w[:, 4] / w[:, 0]) * size
        np.add.at(rates, cells, 0.5 * (np.abs(np.sum(w[:, 1:4] * areas, axis=1)) + sound))
    np.testing.assert_allclose(terms, rates[:, None, None] * conserved_by_states(case.states), atol=1e-13)


def test_a_linear_system_whose_cycles_do_not_get_on_is_given_up_after_the_first():
    case = sphere_case()
    linearization = case.discretization.linearize(sphere_flow().states, case.areas, case.stream)
    right = np.random.default_rng(3).standard_normal((case.faces.n_cells, 5))
    stuck = solve_system(linearization.state_jvp, lambda x: x, right, 1e-10, max_products=500, most_left=0.1)
    assert not stuck.is_converged
    assert stuck.n_products <= RESTART + 1


def test_vectors_stay_orthogonal_where_products_are_nearly_the_vectors():
    rng = np.random.default_rng(5)
    change, right = (1e-5 * rng.standard_normal((85, 85))).astype(np.float32), rng.standard_normal((17, 5))
    products = []

    def product(x):
        products.append(x.ravel().copy())
        return (x.ravel() + change @ x.ravel()).reshape(x.shape)

    solution = solve_system(product, lambda x: x.copy(), right.astype(np.float32), 1e-9, max_products=8)
    basis = np.stack(products[: solution.n_products])
    assert len(basis) > 2
    np.testing.assert_allclose(basis @ basis.T, np.eye(len(basis)), atol=1e-5)


def test_cycles_that_do_not_get_on_are_followed_by_longer_ones():
    right = np.zeros((9, 5))
    right[0, 0] = 1.0
    # of the shift of 45 numbers around, no fewer than 45 vectors tell anything of the solution
    solution = solve_system(lambda x: np.roll(x, 1), lambda x: x, right, 1e-10, max_products=200)
    np.testing.assert_allclose(solution.x, np.roll(right, -1), atol=1e-12)
    assert solution.n_products == RESTART + 1 + right.size


@pytest.mark.parametrize("is_transposed", [False, True])
def test_linear_systems_are_solved_forwards_and_transposed_with_one_factor(is_transposed):
    case = sphere_case()
    linearization = case.discretization.linearize(sphere_flow().states, case.areas, case.stream)
    factor = compact_factor(linearization, case.pattern, np.zeros((case.faces.n_cells, 5, 5)))
    product = linearization.state_vjp if is_transposed else linearization.state_jvp
    jacobians = linearization.jacobians
    rough = jacobians.transposed_product if is_transposed else jacobians.product
    precondition = (factor.into_transposed() if is_transposed else factor).solve
    right = np.random.default_rng(3).standard_normal((case.faces.n_cells, 5))
    solution = solve_refined(product, rough, precondition, right, 1e-10)
    assert solution.is_converged
    assert np.linalg.norm(product(solution.x) - right) < 2e-10 * np.linalg.norm(right)
    assert solution.n_products < 100


def test_a_refined_solution_of_a_hard_system_may_take_more_products_than_a_flow():
    diagonal = np.linspace(3e-5, 1.0, 1500).reshape(-1, 5)
    single, right = diagonal.astype(np.float32), np.random.default_rng(0).standard_normal(diagonal.shape)
    solution = solve_refined(lambda x: diagonal * x, lambda x: single * x, lambda y: y, right, 1e-14)
    assert solution.is_converged
    assert solution.n_products > 2000
    np.testing.assert_allclose(diagonal * solution.x, right, atol=2e-14 * np.linalg.norm(right))


def test_late_steps_have_jacobians_of_their_own_and_the_factor_of_the_one_before(monkeypatch):
    made = {"factors": 0, "jacobians": 0}

    def count(name, function):
        def counted(*args):
            made[name] += 1
            return function(*args)

        return counted

    monkeypatch.setattr(newton, "compact_factor", count("factors", newton.compact_factor))
    monkeypatch.setattr(Discretization, "linearize", count("jacobians", Discretization.linearize))
    kept = sphere_case().solve()
    assert kept.is_converged
    assert made["factors"] < made["jacobians"] == len(kept.history) - 1
    n_kept = made["factors"]
    made.update(factors=0, jacobians=0)
    fresh = sphere_case().solve(settings=replace(NEWTON, factor_kept_from=0.0))
    assert n_kept < made["factors"] == made["jacobians"]
    np.testing.assert_allclose(kept.states, fresh.states, atol=1e-9)
    assert sum(s.n_products for s in kept.history) < 1.2 * sum(s.n_products for s in fresh.history)


def test_a_linear_system_that_is_given_up_says_so():
    case = sphere_case()
    linearization = case.discretization.linearize(sphere_flow().states, case.areas, case.stream)
    right = np.random.default_rng(3).standard_normal((case.faces.n_cells, 5))
    assert not solve_system(linearization.state_jvp, lambda x: x, right, 1e-10, max_products=20).is_converged


def test_residuals_are_by_the_surfaces_of_cells():
    case, flow = sphere_case(), sphere_flow()
    sizes = case.discretization.sizes(case.areas)
    np.testing.assert_allclose(sizes[:, 0], case.faces.sizes(case.nodes), rtol=1e-14)
    uniform = case.residual(case.discretization.uniform(case.stream)) / sizes
    left = relative_residual(case.discretization, case.states, case.areas, case.stream)
    assert left == pytest.approx(np.linalg.norm(case.residual() / sizes) / np.linalg.norm(uniform), rel=1e-12)
    assert relative_residual(case.discretization, flow.states, case.areas, case.stream) == flow.residual


def test_the_last_steps_are_those_of_newton():
    history = sphere_flow().history
    assert sphere_flow().is_converged
    assert len(history) < 15
    assert all(step.length == 1.0 for step in history[-3:])
    assert history[-2].residual / history[-1].residual > 30.0


def test_a_step_solved_exactly_squares_the_residual():
    exact = replace(NEWTON, rough=1e-5, forcing=1e-5)  # what single precision can
    residuals = np.array([step.residual for step in sphere_case().solve(tolerance=1e-11, settings=exact).history])
    before = np.flatnonzero(residuals < 1e-2)[0]
    assert residuals[before + 1] < 10.0 * residuals[before] ** 2


def test_a_solution_starts_from_states_near_by_and_stays_where_it_has_converged():
    case, flow = sphere_case(), sphere_flow()
    again = case.solve(states=flow.states)
    assert len(again.history) == 1
    np.testing.assert_array_equal(again.states, flow.states)
    faster = replace(case, stream=case.stream * np.array([1.0, 1.01, 1.0, 1.0, 1.0]))
    warm, cold = faster.solve(states=flow.states + faster.stream - case.stream), faster.solve()
    assert warm.is_converged
    assert len(warm.history) < len(cold.history)
    np.testing.assert_allclose(warm.states, cold.states, atol=1e-8)


def test_a_linear_solve_that_fails_cuts_the_time_step_and_leaves_the_states(monkeypatch):
    calls = []

    def fails_at_second(*arguments, **options):
        calls.append(1)
        solution = solve_roughly(*arguments, **options)
        return replace(solution, left=1.0) if len(calls) == 2 else solution

    monkeypatch.setattr(newton, "solve_roughly", fails_at_second)
    flow = sphere_case().solve()
    failed = flow.history[2]
    assert failed.length == 0.0
    assert failed.residual == flow.history[1].residual
    assert flow.history[3].cfl < 0.5 * failed.cfl
    assert flow.is_converged


def test_an_update_that_is_not_finite_counts_as_a_failed_solve(monkeypatch):
    def is_nan(*arguments, **options):
        solution = solve_roughly(*arguments, **options)
        return replace(solution, x=solution.x * np.nan)

    monkeypatch.setattr(newton, "solve_roughly", is_nan)
    flow = sphere_case().solve(max_steps=3)
    assert not flow.is_converged
    assert np.isfinite(flow.states).all()
    assert [step.length for step in flow.history[1:]] == [0.0, 0.0, 0.0]


def test_density_and_pressure_stay_positive_however_large_the_update(monkeypatch):
    def overshoots(*arguments, **options):
        solution = solve_roughly(*arguments, **options)
        return replace(solution, x=-50.0 * np.abs(solution.x))

    monkeypatch.setattr(newton, "solve_roughly", overshoots)
    flow = sphere_case().solve(max_steps=4)
    assert flow.states[:, [0, 4]].min() > 0.0


def test_a_run_that_is_cut_off_says_so_and_tells_every_step():
    told = []
    flow = sphere_case().solve(max_steps=2, progress=lambda step, states: told.append(step))
    assert not flow.is_converged
    assert flow.residual > flow.tolerance
    assert tuple(told) == flow.history[1:]
    assert len(told) == 2


def test_long_time_steps_are_those_of_the_speeds_along_flat_cells():
    cubes = case_of(one_of_each_kind(np.stack(np.meshgrid(*3 * [np.arange(5.0)], indexing="ij"), axis=-1)))
    states = cubes.discretization.uniform(np.array([1.0, 0.0, 0.0, 0.0, 1.0]))
    short, long = (newton.time_terms(cubes.discretization, states, cubes.areas, is_long) for is_long in (False, True))
    np.testing.assert_allclose(long, short, rtol=1e-12)
    flat = cubes.areas * np.array([1.0, 100.0, 10.0])  # as the faces of cells 100 x 1 x 10 are
    rows = newton.time_terms(cubes.discretization, states, flat, True)[:, 0, 0]
    np.testing.assert_allclose(rows, 10.0 * long[:, 0, 0], rtol=1e-12)


def test_a_flow_with_long_time_steps_is_the_same():
    case, flow = sphere_case(), sphere_flow()
    again = case.solve(is_long=True)
    assert again.is_converged
    np.testing.assert_allclose(again.states, flow.states, atol=1e-8)


def test_a_run_ends_after_its_products():
    def run(residual, *n_products):
        return [NewtonStep(residual, 1.0, n, 1.0) for n in n_products]

    assert not newton._is_spent(NEWTON, run(1e-3, 700, 499))
    assert newton._is_spent(NEWTON, run(1e-3, 700, 500))
    assert newton._is_spent(NEWTON, run(1e-6, 1150, 60))


def test_a_run_that_converges_may_take_more_products():
    def run(*residuals):
        return [NewtonStep(residual, 1.0, 600, 1.0) for residual in residuals]

    assert not newton._is_spent(NEWTON, run(1e-5, 1e-6))
    assert newton._is_spent(NEWTON, run(1e-5, 4e-6))
    assert newton._is_spent(NEWTON, run(1e-2, 1e-3))


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        lambda: case_of(one_of_each_kind(smooth_box(5, 4, 6)), "farfield"),
        lambda: case_of(flat_plate_grid((7, 9, 5)), degrees=0.0),
    ],
    ids=["nothing in the way", "plate along the stream"],
)
def test_the_uniform_stream_is_a_solution_where_nothing_turns_it(case):
    case = case()
    flow = case.solve()
    assert flow.is_converged
    np.testing.assert_allclose(flow.states, case.discretization.uniform(case.stream), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_random_flows_about_random_sections_converge(seed):
    rng = np.random.default_rng(seed)
    section = cambered_section(rng.uniform(0.08, 0.15), rng.uniform(0.0, 0.03))
    grid = infinite_wing_grid(section, (9, 10), Spacing(0.03, 0.04, 0.04))
    conditions = {"mach": rng.uniform(0.3, 0.85), "degrees": rng.uniform(-2.0, 6.0)}
    solution = case_of(grid, shock_threshold=SHOCK_THRESHOLD, **conditions).solve()
    assert solution.is_converged
    assert sum(step.n_products for step in solution.history) < 300


def test_the_cfl_number_grows_with_care_after_a_shortened_step():
    def following(*lengths):
        return newton._next_cfl(NEWTON, [NewtonStep(1.0, 8.0, 1, length) for length in lengths], 1.0, 0.1, False)

    assert following(0.5) == 6.0
    assert following(0.5, 1.0) == following(0.5, 1.0, 1.0, 1.0) == 24.0
    assert following(0.5, 1.0, 1.0, 1.0, 1.0) == following(1.0) == 80.0
