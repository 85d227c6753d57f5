"""Certified validity of cells and curved elements: what is called valid is, in exact arithmetic as well."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from bspline_mdao.core.generators.shell import ball_grid
from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells import jacobian_bounds
from bspline_mdao.grids.cells.bernstein import INVALID, MAX_HALVINGS, UNDECIDED, VALID
from bspline_mdao.grids.cells.bezier import lagrange_validity
from bspline_mdao.grids.cells.cell_loops import as_points
from bspline_mdao.grids.cells.grid_quality import GridQuality, GridValues

CUBE = np.array([[c & 1, c >> 1 & 1, c >> 2] for c in range(8)], dtype=float)


def first_bounds(corners):
    """Points, bits and first bounds of hexahedra (n, 8, 3): every other cell of a block of one row."""
    x = np.empty((2, 2, 2 * len(corners), 3))
    for c in range(8):
        x[c & 1, c >> 1 & 1, c >> 2 :: 2] = corners[:, c]
    points, bits = as_points(x), np.zeros((1, 1, 2 * len(corners) - 1), dtype=np.uint8)
    bounds = np.empty((3, bits.size))
    jacobian_bounds.block_bounds(points, bits, 1.0, *bounds)
    return points, bits, bounds


def statuses(corners):
    """Statuses of hexahedra (n, 8, 3)."""
    points, bits, bounds = first_bounds(corners)
    bounds[0, 1::2] = bounds[2, 1::2] + 1.0  # the cells between are left out
    status = np.empty(bits.size, dtype=np.uint8)
    jacobian_bounds.decide_cells(points, bits, 1.0, 0.0, *bounds, MAX_HALVINGS, status)
    return status[::2]


def is_left_open(corners):
    """Which hexahedra the first bound does not decide."""
    bound, corner, margin = first_bounds(corners)[2][:, ::2]
    return (bound <= margin) & (corner > margin)


def least_of_samples(corners, n):
    """Smallest Jacobian of trilinear cells at n x n x n points."""
    t, least = np.linspace(0.0, 1.0, n), np.full(len(corners), np.inf)
    ends = {False: lambda s: (1.0 - s, s), True: lambda s: (-1.0, 1.0)}
    for at in product(t, t, t):
        columns = []
        for d in range(3):
            factors = [ends[d == e](at[e]) for e in range(3)]
            shapes = np.array([np.prod([f[c >> e & 1] for e, f in enumerate(factors)]) for c in range(8)])
            columns.append(shapes @ corners)
        a, b, c = columns
        least = np.minimum(least, np.einsum("nc,nc->n", np.cross(a, b), c))
    return least


def exact_corner_jacobian(corners, at):
    """Jacobian at a corner of one cell, without rounding."""
    x = [[Fraction(v) for v in point] for point in corners.tolist()]
    signs = [-1 if at >> d & 1 else 1 for d in range(3)]
    a, b, c = ([s * (q - p) for p, q in zip(x[at], x[at ^ (1 << d)])] for d, s in enumerate(signs))
    cross = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return sum(p * q for p, q in zip(cross, c))


@pytest.mark.slow
def test_no_cell_of_a_million_is_falsely_valid():
    rng, n_valid, n_undecided = np.random.default_rng(0), 0, 0
    for scale in np.linspace(0.3, 0.9, 10):
        corners = CUBE + rng.uniform(-scale, scale, (100_000, 8, 3))
        corners *= 10.0 ** rng.uniform(-4.0, 0.0, (100_000, 1, 3))  # cells of boundary layers
        status = statuses(corners)
        kept = corners[status == VALID]
        assert (least_of_samples(kept[:5000], 5) > 0.0).all()
        assert (least_of_samples(kept[is_left_open(kept)], 9) > 0.0).all()  # those that halving has proved
        n_valid, n_undecided = n_valid + (status == VALID).sum(), n_undecided + (status == UNDECIDED).sum()
    assert 100_000 < n_valid < 900_000
    assert n_undecided < 200


def near_degenerate_cells(n):
    """Cells with the three edges of corner 0 in a plane, but for the rounding of coordinates."""
    rng = np.random.default_rng(1)
    corners = CUBE + rng.uniform(-0.1, 0.1, (n, 8, 3))
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    corners[:, 4] = corners[:, 0] + rng.uniform(0.2, 0.9, (n, 1)) * a + rng.uniform(0.2, 0.9, (n, 1)) * b
    return corners


def test_flat_corners_are_not_called_valid_where_rounding_hides_their_sign():
    corners = near_degenerate_cells(2000)
    is_truly_bad = np.array([exact_corner_jacobian(cell, 0) <= 0 for cell in corners])
    assert 300 < is_truly_bad.sum() < 1700
    assert not (is_truly_bad & (statuses(corners) == VALID)).any()


def test_without_the_margin_of_rounding_some_would_be():
    corners = CUBE + np.zeros((4000, 8, 3))
    rng = np.random.default_rng(2)
    a, b = rng.uniform(0.5, 1.0, (2, 4000, 3))
    corners[:, 1], corners[:, 2] = a, b
    corners[:, 4] = rng.uniform(0.2, 0.9, (4000, 1)) * a + rng.uniform(0.2, 0.9, (4000, 1)) * b
    corners[:, 3], corners[:, 5], corners[:, 6], corners[:, 7] = (
        a + b,
        a + corners[:, 4],
        b + corners[:, 4],
        a + b + corners[:, 4],
    )
    least = np.array([[jacobian_bounds.triple(*(cell[[1, 2, 4]] - cell[0]))] for cell in corners])[:, 0]
    is_truly_bad = np.array([exact_corner_jacobian(cell, 0) <= 0 for cell in corners])
    assert (is_truly_bad & (least > 0.0)).sum() > 10  # rounding has turned their sign
    assert not (is_truly_bad & (statuses(corners) == VALID)).any()


def test_halving_decides_what_the_first_bound_leaves_open():
    corners = CUBE + np.random.default_rng(3).uniform(-0.45, 0.45, (40_000, 8, 3))
    is_open = is_left_open(corners)
    status = statuses(corners)
    assert is_open.sum() > 30
    assert (status[is_open] == VALID).sum() > 10
    assert (status[is_open] == UNDECIDED).sum() <= 2


def lagrange_nodes(degree, n, rng):
    axis = np.linspace(0.0, 1.0, degree + 1)
    cube = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    return cube + rng.uniform(-0.5, 0.5, (n, *cube.shape)) * rng.uniform(0.0, 1.0, (n, 1, 1, 1, 1)) / degree


def sampled_jacobian(nodes, n):
    """Smallest Jacobian of Lagrange hexahedra at n x n x n points, by polynomials fitted to the shape functions."""
    degree = nodes.shape[1] - 1
    powers = np.linalg.inv(np.vander(np.linspace(0.0, 1.0, degree + 1), increasing=True))
    t = np.linspace(0.0, 1.0, n)
    values = np.vander(t, degree + 1, increasing=True) @ powers
    slopes = (np.vander(t, degree + 1, increasing=True)[:, :-1] * np.arange(1, degree + 1)) @ powers[1:]
    columns = [
        np.einsum("ai,bj,ck,nijkd->nabcd", *(slopes if d == e else values for e in range(3)), nodes, optimize=True)
        for d in range(3)
    ]
    return np.linalg.det(np.stack(columns, axis=-1)).min(axis=(1, 2, 3))


@pytest.mark.parametrize("degree", [1, 2, 3, 4])
def test_no_curved_element_is_falsely_valid_and_bounds_are_below_all_values(degree):
    nodes = lagrange_nodes(degree, 120, np.random.default_rng(degree))
    status, bound = lagrange_validity(nodes)
    least, is_valid = sampled_jacobian(nodes, 9), status == VALID
    assert is_valid.sum() > 10
    assert (bound[is_valid] <= least[is_valid] * (1.0 + 1e-9)).all()
    assert (bound[is_valid] > 0.0).all()
    assert (status[least <= 0.0] != VALID).all()
    assert (status == UNDECIDED).sum() <= 2


def test_left_handed_and_collapsed_elements_are_judged_by_what_is_left():
    nodes = lagrange_nodes(2, 20, np.random.default_rng(5)) * [1.0, 1.0, -1.0]
    assert np.array_equal(lagrange_validity(nodes, -1)[0], lagrange_validity(nodes * [1.0, 1.0, -1.0])[0])
    axis = np.linspace(0.0, 1.0, 3)
    wedge = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    wedge[..., 0] *= wedge[..., 2]  # the face zeta = 0 is a line
    assert lagrange_validity(wedge[None], shortest=1e-12)[0][0] == VALID
    assert lagrange_validity(wedge[None, ..., [1, 0, 2]], shortest=1e-12)[0][0] == INVALID
    with pytest.raises(InputError, match="curved elements: nodes of shape"):
        lagrange_validity(nodes[0])


@pytest.mark.slow
def test_the_bound_for_constraints_is_below_every_jacobian_and_its_derivatives_are_exact():
    grid, rng = ball_grid((4, 5, 6, 4), far=3.0), np.random.default_rng(6)
    quality = GridQuality.of_baseline(grid, rho=40.0)
    nodes = grid.to_vector().reshape(-1, 3)
    nodes = nodes + rng.uniform(-0.02, 0.02, nodes.shape)
    values = quality.evaluate(nodes, ["certified_ks", "jacobian_ks", "volume_ks"])
    assert values.aggregates["certified_ks"] < values.aggregates["jacobian_ks"]
    d_nodes, seeds = rng.standard_normal(nodes.shape), {name: rng.standard_normal() for name in values.aggregates}
    changes = quality.jvp(nodes, d_nodes, values).aggregates
    forward = sum(seeds[name] * changes[name] for name in seeds)
    reverse = float((quality.vjp(nodes, values, GridValues(seeds)) * d_nodes).sum())
    assert abs(forward - reverse) < 1e-12 * abs(forward)
    change = corner_coefficients(nodes, quality, d_nodes)
    step = [corner_coefficients(nodes + h * d_nodes, quality) for h in (-1.0, 1.0, -2.0, 2.0)]
    # coefficients are cubic in the nodes: this difference of five points is exact
    assert np.allclose(change, (8.0 * (step[1] - step[0]) - (step[3] - step[2])) / 12.0, rtol=1e-10, atol=1e-10)


def corner_coefficients(nodes, quality, d_nodes=None):
    """Bernstein coefficients of the first block, or their change."""
    block = quality.blocks[0]
    points, out = as_points(block.nodes_of(nodes)), np.empty((27, block.n_cells))
    if d_nodes is None:
        jacobian_bounds.block_coefficients(points, block.degenerate_corners, float(block.handedness), 0.0, out)
    else:
        changes = as_points(block.nodes_of(d_nodes))
        jacobian_bounds.coefficients_jvp(points, changes, block.degenerate_corners, float(block.handedness), out)
    return out
