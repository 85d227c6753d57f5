"""Shapes that wings become: the rectangular wing, the blended-wing body, and the fit of their surfaces."""

from dataclasses import replace

import numpy as np
import pytest
from fit_cases import two_blocks

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.fit.surface_fit import LOGGER, fit_surface
from bspline_mdao.core.generators.blended_wing_body import corner_widths, rounded_weights
from bspline_mdao.core.generators.target_shapes import lay_nodes, lay_walls
from bspline_mdao.core.generators.wing import flat_section
from bspline_mdao.generators import (
    BlendedWingBody,
    Planform,
    Rib,
    Wing,
    cambered_section,
    fit_shape,
    flat_plate_grid,
    generic_blended_wing_body,
    naca_section,
    nodes_on_shape,
    onera_d_section,
    onera_m6_grid,
    onera_m6_planform,
    rectangular_wing,
)
from bspline_mdao.grids.topology.grid import Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import moving_mesh


@pytest.fixture(scope="module")
def m6_grid():
    return onera_m6_grid((17, 13, 15))


@pytest.fixture(scope="module")
def plate():
    return fit_grid(flat_plate_grid((45, 7, 45)), n_control=(9, 5, 9))


def fractions(ni, nk):
    f, g = np.linspace(0.0, 1.0, ni) ** 1.2, np.linspace(0.0, 1.0, nk) ** 0.8
    return np.broadcast_to(f[:, None], (ni, nk)), np.broadcast_to(g, (ni, nk))


def walls_of(nodes, grid):
    """Lower and upper wall, each (ni, nk, 3)."""
    grid = grid.with_vector(nodes.ravel())
    return grid.blocks[1].nodes[:, -1], grid.blocks[4].nodes[:, 0]


# the fit of a surface


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"corrections": 2},
        {"method": "quasi_interpolant"},
        {"method": "least_squares"},
        {"knots": "constant"},
        {"keep_residual": False},
    ],
    ids=str,
)
def test_unmoved_nodes_give_back_the_models_surface_control_points(m6_grid, options):
    model = fit_grid(m6_grid, n_control=(7, 6, 5), **options)
    ids = moving_mesh(model).surface_ids
    surface = fit_surface(model, ids, model.regenerate().to_vector().reshape(-1, 3)).control_points
    np.testing.assert_allclose(surface, model.control_points[ids], atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("keep_residual", [True, False])
def test_a_fit_tells_how_far_the_surface_misses_its_target_and_where(m6_grid, keep_residual, caplog):
    model = fit_grid(m6_grid, n_control=(7, 6, 5), keep_residual=keep_residual)
    mesh, wall = moving_mesh(model), SurfaceGrid.of(model)
    baseline = model.regenerate().to_vector().reshape(-1, 3)
    bent = baseline + np.outer(0.1 * np.abs(baseline[:, 2] - 0.6), [0.0, 1.0, 0.0])  # a kink that no spline has
    found = fit_surface(model, mesh.surface_ids, bent)
    moved = model.control_points.copy()
    moved[mesh.surface_ids] = found.control_points
    distances = np.linalg.norm(model.regenerate(moved).to_vector().reshape(-1, 3) - bent, axis=1)[wall.rows]
    miss = found.miss
    assert miss.largest == pytest.approx(distances.max(), rel=1e-9)
    assert miss.rms == pytest.approx(np.sqrt(np.mean(distances**2)), rel=1e-9)
    assert miss.n_nodes == wall.n_points
    assert miss.size == pytest.approx(np.linalg.norm(np.ptp(bent[wall.rows], axis=0)))
    block, index = int(miss.block.split()[1]) - 1, tuple(np.array(miss.node) - 1)
    worst = wall.rows[np.argmax(distances)]
    np.testing.assert_array_equal(m6_grid.blocks[block].nodes[index], m6_grid.to_vector().reshape(-1, 3)[worst])
    assert miss.patch in ("wing_upper", "wing_lower")
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    for part in (
        f"{miss.largest:.3g} m at most",
        f"{miss.rms:.3g} m RMS",
        miss.patch,
        f"node {miss.node} of {miss.block}",
    ):
        assert part in record.getMessage()


@pytest.mark.slow
def test_a_surface_that_is_met_is_told_to_those_who_ask(m6_grid, caplog):
    model = fit_grid(m6_grid, n_control=(7, 6, 5))
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    with caplog.at_level("INFO", logger=LOGGER.name):
        miss = fit_surface(model, moving_mesh(model).surface_ids, nodes).miss
    assert miss.largest < 1e-13
    assert [record.levelname for record in caplog.records] == ["INFO"]


@pytest.mark.slow
def test_surface_that_is_a_spline_is_fitted_exactly_and_needs_no_other_nodes(m6_grid):
    model = fit_grid(m6_grid, n_control=(7, 6, 5), keep_residual=False, method="least_squares")
    ids, rng = moving_mesh(model).surface_ids, np.random.default_rng(3)
    moved = model.control_points.copy()
    moved[ids] += 0.05 * rng.standard_normal((len(ids), 3))
    nodes = model.evaluator().forward(moved)
    interior = np.concatenate([np.pad(np.ones(np.subtract(s, 2), bool), 1).ravel() for s in model.topology.shapes])
    nodes[interior] = 1e3  # inner nodes of blocks do not count
    np.testing.assert_allclose(fit_surface(model, ids, nodes).control_points, moved[ids], atol=1e-11)


@pytest.mark.slow
def test_a_surface_that_turns_as_a_whole_turns_its_control_points_where_they_fall_back_as_well(m6_grid):
    model = fit_grid(m6_grid, n_control=(7, 6, 5))
    ids = moving_mesh(model).surface_ids
    assert (model.candidate_weights[ids, 0] < 1).any()
    turn, _ = np.linalg.qr(np.random.default_rng(5).standard_normal((3, 3)))
    found = fit_surface(model, ids, model.regenerate().to_vector().reshape(-1, 3) @ turn).control_points
    np.testing.assert_allclose(found, model.control_points[ids] @ turn, atol=1e-12)


def test_faces_of_blocks_that_meet_are_fitted_together():
    grid = two_blocks()
    windows = [Window.whole(b, s).face(f) for (b, s), f in zip(enumerate(grid.shapes), (2, 3))]
    model = fit_grid(replace(grid, patches=(Patch("skin", "wall", tuple(windows)),)), n_control=(6, 6, 6))
    ids = moving_mesh(model).surface_ids
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    np.testing.assert_allclose(
        fit_surface(model, ids, nodes + [0.1, 0.2, 0.3]).control_points, model.control_points[ids] + [0.1, 0.2, 0.3]
    )


@pytest.mark.slow
def test_control_points_that_are_not_whole_faces_are_refused(m6_grid):
    model = fit_grid(m6_grid, n_control=(7, 6, 5))
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    with pytest.raises(InputError, match=r"control point \d belongs to no face of the surface"):
        fit_surface(model, np.array([0, 1, 2]), nodes)
    with pytest.raises(InputError, match=r"nodes of shape \(5, 3\)"):
        fit_surface(model, np.array([0]), nodes[:5])


# nodes laid on a shape


@pytest.mark.slow
def test_wing_laid_on_itself_stays_where_it_is(m6_grid):
    model = fit_grid(m6_grid, n_control=(7, 6, 5))
    nodes = nodes_on_shape(model, Wing(onera_m6_planform(), onera_d_section()))
    np.testing.assert_allclose(nodes, m6_grid.to_vector().reshape(-1, 3), atol=6e-3)
    root = np.s_[:, 0]
    for new, old in zip(walls_of(nodes, m6_grid), (m6_grid.blocks[1].nodes[:, -1], m6_grid.blocks[4].nodes[:, 0])):
        np.testing.assert_allclose(new[root], old[root], atol=5e-4)


@pytest.mark.slow
def test_nodes_that_blocks_share_move_together_and_no_others_do(m6_grid):
    model = fit_grid(m6_grid, n_control=(7, 6, 5))
    before, nodes = m6_grid.to_vector().reshape(-1, 3), nodes_on_shape(model, rectangular_wing())
    blocks = m6_grid.with_vector(nodes.ravel()).blocks
    lower, upper = walls_of(nodes, m6_grid)
    for upstream, wall, downstream in ((blocks[0], lower, blocks[2]), (blocks[3], upper, blocks[5])):
        j = -1 if wall is lower else 0
        np.testing.assert_array_equal(upstream.nodes[-1, j], wall[0])
        np.testing.assert_array_equal(downstream.nodes[0, j], wall[-1])
    ni, nk = upper.shape[:2]
    n_copies = 2 * ni * nk + 4 * nk + 2 * ni + 4  # walls, the edges in blocks before and behind, the tip outboard
    assert np.count_nonzero((np.abs(nodes - before) > 1e-9).any(axis=1)) <= n_copies
    np.testing.assert_array_equal(blocks[10].nodes[:, 0, 0], upper[:, -1])


@pytest.mark.slow
@pytest.mark.parametrize("shape", [rectangular_wing(), generic_blended_wing_body()], ids=["wing", "body"])
def test_two_sides_meet_at_the_edges_and_the_root_is_plane(shape):
    lower, upper = (lay_nodes(shape, side, *fractions(13, 17)) for side in (-1, 1))
    for edge in (np.s_[0], np.s_[-1], np.s_[:, -1]):
        np.testing.assert_array_equal(lower[edge], upper[edge])
    np.testing.assert_array_equal(upper[:, 0, 2], 0.0)
    assert (np.linalg.norm(upper[1:-1, :-1] - lower[1:-1, :-1], axis=-1) > 1e-4).all()


def test_grid_without_a_wing_is_refused(m6_grid):
    with pytest.raises(InputError, match="patch wing_lower"):
        lay_walls(two_blocks(), rectangular_wing())
    with pytest.raises(InputError, match="patch wing_upper"):
        lay_walls(replace(m6_grid, patches=m6_grid.patches[1:]), rectangular_wing())


# the rectangular wing


def test_rectangular_wing_is_of_three_chords_and_naca_0012_sections():
    wing = rectangular_wing()
    assert wing.planform.root_chord == 0.49664
    assert wing.planform.semi_span / wing.planform.root_chord == pytest.approx(3.0, abs=0.012)
    for side in (-1, 1):
        nodes = lay_nodes(wing, side, *fractions(41, 21))
        on_span = nodes[..., 2] < wing.planform.semi_span - wing.rounded_length
        x, y = np.moveaxis(nodes[on_span], -1, 0)[:2] / 0.49664
        half = 0.6 * (0.2969 * np.sqrt(x) - 0.1260 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
        np.testing.assert_allclose(y, side * half, atol=2e-5)
        np.testing.assert_allclose(nodes[[0, -1], :, 0], [[0.0] * 21, [0.49664] * 21], atol=1e-15)


@pytest.mark.slow
def test_surface_control_points_of_the_rectangular_wing_give_the_wing(m6_grid):
    model = fit_grid(onera_m6_grid((33, 9, 25)), n_control=(11, 6, 9))
    mesh, moved = moving_mesh(model), model.control_points.copy()
    moved[mesh.surface_ids] = fit_shape(model, mesh.surface_ids, rectangular_wing())
    on_wing = walls_of(nodes_on_shape(model, rectangular_wing()), model.regenerate())
    for fitted, wanted in zip(walls_of(model.evaluator().forward(moved), model.regenerate()), on_wing):
        assert np.linalg.norm(fitted - wanted, axis=-1).max() < 1e-3  # the paper's own fit misses 2e-3


# the blended-wing body


def test_rounded_polygon_has_a_continuous_curvature_and_is_exact_between_its_corners():
    stations = np.array([0.0, 0.5, 1.3, 2.0])
    values, widths = np.array([1.0, -0.3, 0.4, 0.1]), corner_widths(stations, 0.8, is_mirrored=True)
    at = np.linspace(0.0, 2.0, 20_001)
    weights = rounded_weights(at, stations, widths)
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-14)
    polygon = weights @ values
    h = at[1]
    curvature = np.diff(polygon, 2) / h**2
    assert np.abs(np.diff(curvature)).max() < 60.0 * h  # Lipschitz, where a jump would be of order 10
    assert (polygon[1] - polygon[0]) / h == pytest.approx(0.0, abs=1e-3)  # no corner in the mirror
    outside = (np.abs(at[:, None] - stations) > widths).all(axis=1)
    np.testing.assert_allclose(polygon[outside], np.interp(at, stations, values)[outside], atol=1e-14)


def test_winglets_turn_up_and_lengths_along_the_spine_are_kept():
    body = generic_blended_wing_body()
    leading_edge = lay_nodes(body, 1, *fractions(5, 401))[0]
    steps = np.diff(leading_edge[:, 1:], axis=0)
    angle = np.degrees(np.arctan2(*steps.T))
    assert angle.max() > 60.0
    assert angle.min() > -1.0
    assert np.degrees(np.arctan2(*np.diff(leading_edge[:60, 1:], axis=0).T)).max() < 5.0
    assert np.linalg.norm(steps, axis=1).sum() == pytest.approx(body.developed_span, rel=1e-5)


@pytest.mark.slow
def test_upper_side_of_a_winglet_faces_inboard_and_twist_raises_the_nose():
    body = generic_blended_wing_body()
    lower, upper = (lay_nodes(body, side, *fractions(21, 61)) for side in (-1, 1))
    on_winglet = upper[0, :-3, 1] > 0.2
    assert on_winglet.sum() > 5
    assert (upper[1:-1, :-3][:, on_winglet, 2] < lower[1:-1, :-3][:, on_winglet, 2]).all()
    ribs = tuple(Rib(span, 0.0, 2.0, flat_section(), twist=30.0) for span in (0.0, 1.0))
    plate = lay_nodes(BlendedWingBody(ribs), 1, *fractions(5, 7))
    np.testing.assert_allclose(plate[-1, :, :2] - plate[0, :, :2], [[np.sqrt(3.0), -1.0]] * 7, atol=1e-12)


@pytest.mark.slow
def test_centre_body_is_thick_and_the_surface_is_smooth_across_the_symmetry_plane():
    lower, upper = (lay_nodes(generic_blended_wing_body(), side, *fractions(81, 401)) for side in (-1, 1))
    thickness = (upper - lower)[..., 1].max(axis=0)
    chord = upper[-1, :, 0] - upper[0, :, 0]
    assert thickness[0] / chord[0] > 0.14
    assert thickness[0] > 5.0 * thickness[250]
    slope = np.diff(upper[:, :2], axis=1)[:, 0]
    assert np.abs(slope[:, :2] / slope[:, 2:]).max() < 0.05  # of the first of 400 intervals


@pytest.mark.slow
def test_flat_plate_becomes_the_blended_wing_body(plate):
    mesh, moved = moving_mesh(plate), plate.control_points.copy()
    moved[mesh.surface_ids] = fit_shape(plate, mesh.surface_ids, generic_blended_wing_body())
    on_body = walls_of(nodes_on_shape(plate, generic_blended_wing_body()), plate.regenerate())
    for fitted, wanted in zip(walls_of(plate.evaluator().forward(moved), plate.regenerate()), on_body):
        assert np.linalg.norm(fitted - wanted, axis=-1).max() < 0.015  # 1 % of the body's length
    edge = walls_of(plate.evaluator().forward(moved), plate.regenerate())[1][0]
    assert np.degrees(np.arctan2(*(edge[-1] - edge[-12])[1:])) > 60.0
    np.testing.assert_allclose(moved[mesh.surface_ids[mesh.in_plane_rows], 2], 0.0, atol=1e-14)


def test_straight_ribs_make_the_trapezoidal_wing():
    section = naca_section(0.12)
    body = BlendedWingBody((Rib(0.0, 0.0, 1.0, section), Rib(1.5, 0.6, 0.5, section)), blend=0.0)
    wing = Wing(Planform(1.0, 1.5, 0.5, np.degrees(np.arctan(0.4))), section)
    np.testing.assert_allclose(lay_nodes(body, 1, *fractions(9, 11)), lay_nodes(wing, 1, *fractions(9, 11)), atol=1e-5)


def test_cambered_section_is_its_camber_line_and_thickness():
    section = cambered_section(0.12, 0.03, reflex=1.5)
    x = np.linspace(0.0, 1.0, 51)
    upper, lower = (np.interp(x, *side.T) for side in (section.upper, section.lower))
    np.testing.assert_allclose(0.5 * (upper + lower), 0.12 * x * (1 - x) * (1 - 1.5 * x), atol=2e-5)
    symmetric = np.interp(x, *naca_section(0.12).upper.T)
    np.testing.assert_allclose(0.5 * (upper - lower), symmetric, atol=1e-12)
    assert cambered_section(0.1, 0.0).thickness == naca_section(0.1).thickness


@pytest.mark.parametrize(
    ("spans", "change", "message"),
    [
        ((0.1, 1.0), {}, "ascending from 0"),
        ((0.0, 1.0, 1.0), {}, "ascending from 0"),
        ((0.0,), {}, "two or more"),
        ((0.0, 1.0), {"chord": 0.0}, "rib 1 has chord 0"),
        ((0.0, 1.0), {"cant": 30.0}, "no cant there"),
        ((0.0, 1.0), {"twist": 60.0}, "twist up to 45"),
    ],
)
def test_impossible_bodies_are_refused(spans, change, message):
    ribs = [Rib(span, 0.0, 1.0, flat_section()) for span in spans]
    with pytest.raises(InputError, match=message):
        BlendedWingBody((replace(ribs[0], **change), *ribs[1:]))
