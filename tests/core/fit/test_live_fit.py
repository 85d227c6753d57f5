"""Derivatives of the fit through parameters and knots, against a dense complex-step reference."""

import numpy as np
import pytest
from fit_cases import ALL_SHAPES, FOLDING, bend, folded_block, grid_of, lattice

from bspline_mdao.core.fit.edge_knots import edge_knots, edge_knots_jvp, edge_knots_vjp
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.fit.least_squares import ReferenceNet, greville_sampling
from bspline_mdao.core.fit.live_fit import live_fit
from bspline_mdao.core.fit.parameters import (
    chord_length_parameters,
    chord_length_parameters_jvp,
    chord_length_parameters_vjp,
)
from bspline_mdao.core.fit.problem import problem_of_mesh
from bspline_mdao.errors import InputError
from bspline_mdao.grids.topology.index_space import whole_slices

EXPONENTS = {"chord_length": 1.0, "centripetal": 0.5, "uniform": 0.0}


def parameters_of(nodes, kind="chord_length"):
    """Parameters by powers of chord lengths, complex-safe and slow."""
    parameters = np.zeros(nodes.shape, dtype=nodes.dtype)
    for d in range(3):
        if nodes.shape[d] == 1:
            continue
        chords = np.diff(nodes, axis=d)
        lengths = np.cumsum(np.sqrt((chords**2).sum(axis=-1)) ** EXPONENTS[kind], axis=d)
        uniform = np.linspace(0, 1, nodes.shape[d])[1:].reshape([-1 if e == d else 1 for e in range(3)])
        total = lengths.take([-1], d)
        is_empty = np.abs(total) < 1e-10
        ratios = np.where(is_empty, uniform, lengths / np.where(is_empty, 1, total))
        np.moveaxis(parameters[..., d], d, 0)[1:] = np.moveaxis(ratios, d, 0)
    return parameters


def knots_of(parameters, d, n_control, order, kind):
    """Edge knots of direction d, shape (2, 2, N + p)."""
    lines = parameters[..., d].transpose(d, (d + 1) % 3, (d + 2) % 3)
    corners = np.zeros((2, 2, n_control + order), dtype=parameters.dtype)
    corners[..., n_control:] = 1
    n_spans = n_control + 1 - order
    places = np.arange(n_spans + 1) * ((len(lines) - 1) / n_spans)
    for s, t in np.ndindex(2, 2):
        line = lines[:, -s, -t]
        low = places.astype(int)
        high = np.minimum(low + 1, len(line) - 1)
        breaks = line[low] + (places - low) * (line[high] - line[low])
        if np.diff(breaks.real).min() < 1e-10:  # nodes coincide: a thousandth of uniform knots
            breaks = 0.999 * breaks + 0.001 * np.arange(n_spans + 1) / n_spans
        corners[s, t, order:n_control] = breaks[1:-1]
    return corners if kind == "curved" else np.broadcast_to(corners.mean(axis=(0, 1)), corners.shape)


def cox_de_boor(T, i, order, x):
    """Eq. (4), as it is printed."""
    if order == 1:
        last = T[i + 1].real == 1 and x.real >= 1
        return 1.0 if T[i].real <= x.real < T[i + 1].real or (last and T[i].real < 1) else 0.0
    value = 0.0
    if T[i + order - 1].real > T[i].real:
        value += (x - T[i]) / (T[i + order - 1] - T[i]) * cox_de_boor(T, i, order - 1, x)
    if T[i + order].real > T[i + 1].real:
        value += (T[i + order] - x) / (T[i + order] - T[i + 1]) * cox_de_boor(T, i + 1, order - 1, x)
    return value


def dense_rows(parameters, n_control, orders, kind):
    """The matrix of Eq. (3) with its complex part."""
    points = parameters.reshape(-1, 3)
    factors = []
    for d in range(3):
        if n_control[d] == 1:
            factors.append(np.ones((len(points), 1)))
            continue
        c = knots_of(parameters, d, n_control[d], orders[d], kind)
        rows = []
        for point in points:
            x, s, t = np.roll(point, -d)
            T = (1 - s) * (1 - t) * c[0, 0] + s * (1 - t) * c[1, 0] + (1 - s) * t * c[0, 1] + s * t * c[1, 1]
            T[n_control[d] :] = 1  # the weights need not sum to 1 to the last bit
            rows.append([cox_de_boor(T, i, orders[d], x) for i in range(n_control[d])])
        factors.append(np.array(rows))
    return np.einsum("qi,qj,qk->qijk", *factors).reshape(len(points), -1)


def reference_fit(model, nodes):
    """Control points for complex nodes, one dense least squares after the other; also the matrix of every segment."""
    frozen = problem_of_mesh(model.topology, model.mesh)
    sizes = [(v.n_control, v.orders) for v in model.mesh.volumes]
    matrices = [
        dense_rows(parameters_of(nodes[rows], model.settings.parametrization), *size, model.settings.knots)
        for rows, size in zip(frozen.sharing.rows, sizes)
    ]
    b = np.zeros((model.mesh.n_control_points, 3), dtype=nodes.dtype)
    for entity in frozen.entities:
        if not len(entity.unknown_ids):
            continue
        inside = np.zeros(frozen.sharing.rows[entity.segment].shape, dtype=bool)
        inside[entity.inner] = True
        ids = model.mesh.control_ids[entity.segment].ravel()
        A = matrices[entity.segment][inside.ravel()]
        A_u = np.stack([A[:, ids == i].sum(axis=1) for i in entity.unknown_ids], axis=1)
        net = b[entity.control_ids]
        section = frozen.sharing.rows[entity.segment][whole_slices(entity.section)]
        orders = [p if m > 1 else 1 for p, m in zip(model.mesh.volumes[entity.segment].orders, net.shape)]
        places = [x if m > 1 else np.zeros(1) for x, m in zip(frozen.edge_places[entity.segment], net.shape)]
        sampling = greville_sampling(section, net.shape[:3], orders, len(nodes))
        reference = ReferenceNet.of(places, sampling)
        net = net.reshape(-1, 3)
        reference_net = reference.net(nodes.real, net.real) + 1j * reference.net(nodes.imag, net.imag)
        first = [np.flatnonzero(entity.columns == c)[0] for c in range(len(entity.unknown_ids))]
        b[entity.unknown_ids] = reference_net[first]
        b[entity.unknown_ids] += np.linalg.solve(A_u.T @ A_u, A_u.T @ (nodes[entity.rows] - A @ b[ids]))
    return frozen.mixture(model.parameters, model.candidate_weights).forward(b, nodes), matrices, frozen


@pytest.mark.slow
@pytest.mark.parametrize("kind", EXPONENTS)
@pytest.mark.parametrize("shape", ALL_SHAPES)
def test_parameter_derivatives_agree_with_complex_step_and_transpose(shape, kind):
    rng = np.random.default_rng(5)
    nodes = ALL_SHAPES[shape]().blocks[0].nodes
    direction, bar = rng.standard_normal((2, *nodes.shape))
    parameters = chord_length_parameters(nodes, EXPONENTS[kind])
    np.testing.assert_allclose(parameters, parameters_of(nodes, kind), atol=1e-14)
    forward = chord_length_parameters_jvp(nodes, parameters, direction, EXPONENTS[kind])
    assert np.any(forward) == (kind != "uniform")
    if shape != "wedge":  # at a collapsed line the length is not differentiable
        expected = parameters_of(nodes + 1e-30j * direction, kind).imag / 1e-30
        np.testing.assert_allclose(forward, expected, atol=1e-12 * np.abs(expected).max())
    reverse = chord_length_parameters_vjp(nodes, parameters, bar, EXPONENTS[kind])
    assert np.vdot(bar, forward) == pytest.approx(np.vdot(reverse, direction), rel=1e-12)


def pinched():
    """A block with two coincident layers of nodes, and five nodes on an edge that are all but coincident."""
    nodes = bend(lattice(13, 9, 8))
    nodes[:, 5] = nodes[:, 6]
    nodes[4:9, 0, 0] = nodes[6, 0, 0] + 1e-12 * np.outer(np.arange(5), [1.0, 0.5, 0.2])  # apart, lest they be a seam
    return grid_of(nodes)


NARROW = {"n_control": (8, 5, 5), "order": 3}
"""So many control points that knots of `pinched` coincide."""


def together(nodes, direction):
    """A direction in which nodes that coincide stay together: the lengths of lines are differentiable along it."""
    _, first, group = np.unique(nodes.reshape(-1, 3), axis=0, return_index=True, return_inverse=True)
    return direction.reshape(-1, 3)[first][group.ravel()].reshape(direction.shape)


CASES = {
    "coincident nodes": (NARROW, pinched),
    "coincident nodes, constant knots": ({"knots": "constant", **NARROW}, pinched),
    "curved": ({}, lambda: grid_of(bend(lattice(9, 8, 7)))),
    "constant knots": ({"knots": "constant"}, lambda: grid_of(bend(lattice(8, 7, 9)))),
    "mixed orders": ({"order": (2, 3, 5)}, lambda: grid_of(bend(lattice(8, 9, 9)))),
    "fallback": (FOLDING, folded_block),
    "no least squares": ({"method": "quasi_interpolant"}, lambda: grid_of(bend(lattice(8, 8, 7)))),
    "flat": ({}, lambda: grid_of(bend(lattice(12, 1, 11)))),
    "two blocks": ({}, lambda: grid_of(bend(lattice(7, 8, 5)), bend(lattice(8, 8, 5) + [1, 0, 0])[::-1])),
    "centripetal": ({"parametrization": "centripetal"}, lambda: grid_of(bend(lattice(9, 8, 7)))),
    "uniform": ({"parametrization": "uniform"}, lambda: grid_of(bend(lattice(8, 7, 7)))),
    "o-grid": ({}, lambda: ALL_SHAPES["o_grid"](13, 7, 4)),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_live_derivatives_agree_with_complex_step(case):
    rng = np.random.default_rng(6)
    options, make = CASES[case]
    grid = make()
    model, nodes = fit_grid(grid, **options), grid.to_vector().reshape(-1, 3)
    live = live_fit(model, nodes)
    np.testing.assert_allclose(live.control_points, model.control_points, atol=1e-14)
    direction = together(nodes, rng.standard_normal(nodes.shape))
    b, matrices, problem = reference_fit(model, nodes + 1e-30j * direction)
    np.testing.assert_allclose(live.control_points, b.real, atol=1e-11)
    expected = b.imag / 1e-30
    np.testing.assert_allclose(live.jvp(direction), expected, atol=1e-10 * np.abs(expected).max())
    moved = model.control_points + 0.1 * rng.standard_normal(b.shape)
    d_moved = rng.standard_normal(b.shape)
    found = live.mapping.jvp(moved, direction, d_moved)
    for rows, own, ids, A in zip(problem.sharing.rows, problem.sharing.is_evaluated, model.mesh.control_ids, matrices):
        points = A @ (moved + 1e-30j * d_moved)[ids.ravel()]
        is_local = own.ravel()
        expected = points.imag[is_local] / 1e-30
        np.testing.assert_allclose(found[rows.ravel()[is_local]], expected, atol=1e-10 * np.abs(expected).max())


OPTIONS = [{}, {"method": "quasi_interpolant"}, {"knots": "constant", "order": 3}]


@pytest.mark.slow
@pytest.mark.parametrize("shape", [*ALL_SHAPES.values(), pinched, folded_block])
@pytest.mark.parametrize("options", OPTIONS)
def test_live_transposes_pass_the_dot_test(shape, options):
    rng = np.random.default_rng(9)
    grid, options = shape(), options | {pinched: NARROW, folded_block: FOLDING}.get(shape, {})
    model, nodes = fit_grid(grid, **options), grid.to_vector().reshape(-1, 3)
    live = live_fit(model, nodes)
    x, bar = rng.standard_normal((2, *nodes.shape))
    b, b_bar = rng.standard_normal((2, *live.control_points.shape))
    forward, reverse = live.jvp(x), live.vjp(b_bar)
    scale = np.linalg.norm(forward) * np.linalg.norm(b_bar)
    assert abs(np.vdot(b_bar, forward) - np.vdot(reverse, x)) < 1e-12 * scale
    forward = live.mapping.jvp(live.control_points, x, b)
    x_bar, control_bar = live.mapping.vjp(live.control_points, bar)
    scale = np.linalg.norm(forward) * np.linalg.norm(bar)
    assert abs(np.vdot(bar, forward) - np.vdot(x_bar, x) - np.vdot(control_bar, b)) < 1e-12 * scale


def test_parameter_derivatives_of_coincident_nodes_agree_with_complex_step_and_transpose():
    rng = np.random.default_rng(11)
    nodes = pinched().blocks[0].nodes
    direction, bar = rng.standard_normal((2, *nodes.shape))
    direction = together(nodes, direction)
    parameters = chord_length_parameters(nodes)
    forward = chord_length_parameters_jvp(nodes, parameters, direction)
    expected = parameters_of(nodes + 1e-30j * direction).imag / 1e-30
    np.testing.assert_allclose(forward, expected, atol=1e-12 * np.abs(expected).max())
    reverse = chord_length_parameters_vjp(nodes, parameters, bar)
    assert np.vdot(bar, forward) == pytest.approx(np.vdot(reverse, direction), rel=1e-12)


@pytest.mark.parametrize("is_narrow", [False, True])
def test_edge_knot_derivatives_are_differences_and_transposes(is_narrow):
    """Linear in the parameters, so that any step will do."""
    rng, n_control, order = np.random.default_rng(12), 8, 3
    parameters = np.concatenate([[0.0], np.sort(rng.random(11)), [1.0]])
    if is_narrow:
        parameters[3:7] = parameters[3]
    assert (np.diff(np.interp(np.linspace(0, 12, 7), np.arange(13), parameters)).min() == 0.0) == is_narrow
    direction, bar = 1e-3 * rng.standard_normal(13), rng.standard_normal(n_control + order)
    direction[3:7] = direction[3] if is_narrow else direction[3:7]
    direction[[0, -1]] = 0.0
    forward = edge_knots_jvp(parameters, n_control, order, direction)
    difference = edge_knots(parameters + direction, n_control, order) - edge_knots(parameters, n_control, order)
    np.testing.assert_allclose(forward, difference, atol=1e-15)
    reverse = edge_knots_vjp(parameters, n_control, order, bar)
    assert abs(forward @ bar - reverse @ direction) < 1e-14 * np.linalg.norm(forward) * np.linalg.norm(bar)
    assert np.linalg.norm(forward) > 1e-4


def test_moving_the_whole_grid_moves_the_control_points():
    grid = grid_of(bend(lattice(9, 8, 7)))
    nodes = grid.to_vector().reshape(-1, 3)
    live = live_fit(fit_grid(grid), nodes)
    shift = np.broadcast_to([1.0, -2.0, 3.0], nodes.shape)
    np.testing.assert_allclose(
        live.jvp(shift), np.broadcast_to([1.0, -2.0, 3.0], live.control_points.shape), atol=1e-11
    )
    np.testing.assert_allclose(live.jvp(nodes), live.control_points, atol=1e-10)  # growth keeps all parameters


def test_corrected_and_given_parameters_are_refused():
    grid = grid_of(bend(lattice(9, 8, 7)))
    nodes = grid.to_vector().reshape(-1, 3)
    model = fit_grid(grid)
    with pytest.raises(InputError, match="does not follow the grid"):
        live_fit(fit_grid(grid, corrections=1), nodes)
    with pytest.raises(InputError, match="does not follow the grid"):
        live_fit(fit_grid(grid, knots=[model.mesh.volumes[0].knots]), nodes)
    with pytest.raises(InputError, match="does not follow the grid"):
        live_fit(fit_grid(grid, parametrization=model.parameters), nodes)
