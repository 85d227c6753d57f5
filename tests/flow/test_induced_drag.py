"""Strips of a wing's wall, and the induced drag of the forces on them."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bspline_mdao import InputError, find_topology, read_grid
from bspline_mdao.core.fit.surface_fit import replace_nodes
from bspline_mdao.core.generators.target_shapes import lay_walls
from bspline_mdao.flow.loads.induced_drag import InducedDrag, Wake
from bspline_mdao.flow.loads.span_strips import SpanStrips
from bspline_mdao.generators import (
    BlendedWingBody,
    Rib,
    Spacing,
    Wing,
    ball_grid,
    cambered_section,
    flat_plate_grid,
    generic_blended_wing_body,
    hh_wing_grid,
    onera_d_section,
    onera_m6_planform,
    rectangular_wing,
)
from bspline_mdao.grids.cells.cell_faces import CellFaces

AXES = np.eye(3)[[0, 2, 1]]
"""Of the project's grids: x downstream, z along the span, y up."""

ALPHA = np.radians(4.0)


def upright(height):
    """A wing of semi-span 2 with a winglet of a height, nearly without a rounded corner between."""
    section = cambered_section(0.1, 0.02)
    ribs = (Rib(0.0, 0.0, 1.0, section), Rib(2.0, 0.3, 0.8, section), Rib(2.02, 0.3, 0.8, section, cant=90.0))
    return BlendedWingBody((*ribs, Rib(2.02 + height, 0.5, 0.5, section, cant=90.0)), blend=0.5, tip_length=0.02)


def wall(grid, shape=None):
    """Corners of the wall faces and nodes of a grid, laid on another shape."""
    topology, nodes = find_topology(grid), grid.to_vector().reshape(-1, 3)
    faces = CellFaces.of(topology, nodes)
    nodes = nodes if shape is None else replace_nodes(topology, nodes, lay_walls(grid, shape))
    return faces.corners_of("wall"), nodes


def plate(n_span=13):
    return flat_plate_grid((9, 5, n_span))


WALLS = {
    "rectangular": (rectangular_wing(), None, 16),
    "M6": (Wing(onera_m6_planform(), onera_d_section()), None, 12),
    "plate": (None, None, 12),
    "body with winglets": (None, generic_blended_wing_body(), 16),
    "upright winglets": (None, upright(0.4), 16),
}
"""Wings, None for a plate, shapes that they are laid on, and how many strips their lines make."""


@cache
def wall_of(name):
    wing, shape, n = WALLS[name]
    grid = plate(n + 1) if wing is None else hh_wing_grid(wing, (11, 5, n + 1), Spacing(0.01, 0.02, 0.02, 0.02))
    return wall(grid, shape)


def drag_of(corners, nodes, **options):
    return InducedDrag.of(SpanStrips.of(corners, nodes, AXES, **options), nodes)


def trace(drag, nodes, alpha=ALPHA):
    """Trace of the trailing edge, shape (n + 1, 2), and the axes of the Trefftz plane."""
    turn = np.stack([drag.strips.axes[1], np.cos(alpha) * AXES[2] - np.sin(alpha) * AXES[0]])
    return drag.strips.trailing @ nodes @ turn.T, turn


def forces_of(drag, nodes, load, seed=0):
    """Forces on the faces, unevenly spread, that add up to a load per length of the trace, and others downstream."""
    rng, shares = np.random.default_rng(seed), drag.strips.face_weights.T
    points, turn = trace(drag, nodes)
    widths = np.diff(points, axis=0)
    on_strips = load[:, None] * np.stack([-widths[:, 1], widths[:, 0]], axis=1) @ turn
    parts = shares.multiply(rng.uniform(0.5, 1.5, (shares.shape[0], 1))).tocsr()
    parts = parts / parts.sum(axis=0)
    stream = np.cos(ALPHA) * AXES[0] + np.sin(ALPHA) * AXES[2]
    return parts @ on_strips + rng.standard_normal((parts.shape[0], 1)) * stream


def means(arc, coefficients):
    """Means between places on a half wing, from the tip (0) to the root (1), of a sum of sines of the angle."""
    angle = np.arccos(1.0 - arc)
    integral = sum(a * (_sine(k - 1, angle) - _sine(k + 1, angle)) for k, a in coefficients.items())
    return 0.5 * np.diff(integral) / np.diff(arc)


def _sine(k, angle):
    """sin(k angle) / k, also for k = 0."""
    return angle * np.sinc(k * angle / np.pi)


@pytest.mark.slow
@pytest.mark.parametrize("name", WALLS)
def test_lines_of_the_grid_divide_the_wing_into_strips_from_the_tip_to_the_root(name):
    corners, nodes = wall_of(name)
    strips = SpanStrips.of(corners, nodes, AXES)
    assert strips.n_strips == WALLS[name][2]
    np.testing.assert_array_equal(strips.face_weights.data, 1.0)
    np.testing.assert_array_equal(strips.face_weights.sum(axis=0), 1.0)
    counts = strips.face_weights.sum(axis=1)
    np.testing.assert_array_equal(counts, counts[0])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rectangular", "M6", "plate"])
def test_points_of_the_stations_run_along_the_trailing_edge(name):
    corners, nodes = wall_of(name)
    points, x = SpanStrips.of(corners, nodes, AXES).trailing @ nodes, nodes[corners].reshape(-1, 3)
    np.testing.assert_allclose(points[[0, -1], 2], [x[:, 2].max(), 0.0], atol=1e-12)
    assert (np.diff(points[:, 2]) < 0.0).all()
    level = np.abs(x[:, 2] - points[:, None, 2]) < 1e-9
    np.testing.assert_allclose(points[:, 0], np.where(level, x[:, 0], -np.inf).max(axis=1), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("shape", [generic_blended_wing_body(), upright(0.4)])
def test_body_with_winglets_has_the_strips_of_the_plate_that_it_was(shape):
    one, other = (SpanStrips.of(*wall(plate(17), shape), AXES) for shape in (None, shape))
    np.testing.assert_array_equal(other.face_weights.toarray(), one.face_weights.toarray())
    np.testing.assert_array_equal(other.trailing.toarray(), one.trailing.toarray())


@pytest.mark.slow
def test_strips_lie_between_the_planes_of_their_stations():
    corners, nodes = wall_of("plate")
    strips = SpanStrips.of(corners, nodes, AXES)
    stations, number = (strips.trailing @ nodes)[:, 2], strips.face_weights.argmax(axis=0)
    np.testing.assert_allclose(nodes[corners][..., 2].max(axis=1), stations[number], atol=1e-12)
    np.testing.assert_allclose(nodes[corners][..., 2].min(axis=1), stations[number + 1], atol=1e-12)


@pytest.mark.slow
def test_order_of_faces_and_of_their_corners_does_not_matter():
    corners, nodes = wall_of("M6")
    rng = np.random.default_rng(1)
    order, turns = rng.permutation(len(corners)), rng.integers(4, size=len(corners))
    mixed = np.take_along_axis(corners[order], (turns[:, None] + np.arange(4)) % 4, axis=1)
    one, other = SpanStrips.of(corners, nodes, AXES), SpanStrips.of(mixed, nodes, AXES)
    np.testing.assert_array_equal(other.face_weights.toarray(), one.face_weights.toarray()[:, order])
    np.testing.assert_array_equal(other.trailing.toarray(), one.trailing.toarray())


@pytest.mark.slow
def test_collapsed_quads_at_the_tip_join_the_strip_beside_them():
    corners, nodes = wall_of("plate")
    tip = nodes[corners][..., 2].max()
    width = SpanStrips.of(corners, nodes, AXES)
    inner = (width.trailing @ nodes)[1, 2]
    flat = nodes.copy()
    flat[np.abs(nodes[:, 2] - inner) < 1e-12, 2] = tip
    strips = SpanStrips.of(corners, flat, AXES)
    assert strips.n_strips == width.n_strips - 1
    np.testing.assert_array_equal(strips.face_weights.sum(axis=0), 1.0)


def test_walls_without_rows_around_them_are_shared_out_by_span():
    corners, nodes = wall(ball_grid((4, 5, 6, 3)))
    strips = SpanStrips.of(corners, nodes, AXES, is_symmetric=False, n_strips=6)
    np.testing.assert_allclose(strips.face_weights.sum(axis=0), 1.0, atol=1e-14)
    points, z = strips.trailing @ nodes, nodes[corners][..., 2]
    np.testing.assert_allclose(points[:, 2], np.linspace(z.min(), z.max(), 7), atol=1e-12)
    np.testing.assert_allclose(points[:, 0], points[::-1, 0], atol=1e-12)
    assert (points[1:-1, 0] > 0.0).all()


@pytest.mark.slow
def test_real_grids_have_strips(real_grids):
    corners, nodes = walls_within(real_grids / "hh_naca0012_12blocks.xyz", [-0.1, -0.1, -0.1], [1.1, 0.1, 3.1])
    assert SpanStrips.of(corners, nodes, AXES).n_strips == 16  # its own lines
    corners, nodes = walls_within(real_grids / "pyhyp_m6_9blocks.xyz", [-0.1, -0.1, -0.1], [1.2, 0.1, 1.3])
    trailing = SpanStrips.of(corners, nodes, AXES, n_strips=9).trailing @ nodes  # of a cap at the tip as well
    sweep = np.polyfit(*trailing[1:, [2, 0]].T, 1)[0]
    assert sweep == pytest.approx(np.tan(np.radians(15.8)), rel=0.01)


def walls_within(path, low, high):
    """Corners of the boundary faces that lie within a box and not in the plane of symmetry, and all nodes."""
    grid = read_grid(path)
    nodes = grid.to_vector().reshape(-1, 3)
    faces = CellFaces.of(find_topology(grid), nodes)
    corners = faces.corners[faces.n_inner :]
    is_inside = ((nodes[corners] > low) & (nodes[corners] < high)).all(axis=(1, 2))
    return corners[is_inside & (nodes[corners][..., 2].max(axis=1) > 1e-6)], nodes


def test_wall_without_span_is_refused():
    corners, nodes = wall_of("plate")
    with pytest.raises(InputError, match="no extent along the span") as error:
        SpanStrips.of(corners, nodes, np.eye(3))
    assert "\n" not in str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize("tip", [0.03, 0.005, 0.001])
@pytest.mark.parametrize("n", [16, 24])
def test_drag_of_an_elliptical_load_is_the_ideal_one_within_one_part_in_a_thousand(n, tip):
    grid = hh_wing_grid(rectangular_wing(), (5, 5, n + 1), Spacing(0.01, 0.02, 0.02, tip))
    corners, nodes = wall(grid)
    drag = drag_of(corners, nodes)
    points, _ = trace(drag, nodes)
    span = -points[0, 0]
    load = 0.3 * means(1.0 + points[:, 0] / span, {1: 1.0})
    found, area = drag.evaluate(forces_of(drag, nodes, load), nodes, ALPHA)
    np.testing.assert_allclose(found, load, rtol=1e-11)
    lift = 2.0 * load @ np.diff(points[:, 0])
    assert 2.0 * area == pytest.approx(lift**2 / (4.0 * np.pi * span**2), rel=1e-3)
    plain = Wake(points, 0.5 * load).drag
    assert plain < 0.985 * area  # what the strips alone would give


@pytest.mark.slow
def test_drag_of_other_loads_is_that_of_their_sines():
    corners, nodes = wall_of("rectangular")
    drag, sines = drag_of(corners, nodes), {1: 1.0, 3: -0.1, 5: 0.1, 7: -0.05}
    points, _ = trace(drag, nodes)
    load = means(1.0 + points[:, 0] / -points[0, 0], sines)
    _, area = drag.evaluate(forces_of(drag, nodes, load), nodes, ALPHA)
    assert area == pytest.approx(np.pi / 32.0 * sum(k * a**2 for k, a in sines.items()), rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["rectangular", "plate"])
def test_no_load_on_the_strips_of_a_flat_wing_beats_the_ellipse(name):
    corners, nodes = wall_of(name)
    drag = drag_of(corners, nodes)
    points, _ = trace(drag, nodes, 0.0)
    lift = np.diff(points[:, 0])
    influence = drag.loads.T @ Wake(drag.points @ points, np.zeros(64), True, drag.places).influence @ drag.loads / 4.0
    influence = influence + influence.T
    assert np.linalg.eigvalsh(influence).min() > -1e-12
    best = np.linalg.lstsq(influence, lift)[0]
    best /= lift @ best
    efficiency = 1.0 / (np.pi * points[0, 0] ** 2 * best @ influence @ best)
    assert efficiency == pytest.approx(1.0, abs=1e-3)
    assert efficiency < 1.0 + 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"is_symmetric": False}])
def test_least_drag_of_a_lift_is_that_of_the_ellipse_and_no_load_has_less(options):
    corners, nodes = wall_of("plate")
    drag, rng = drag_of(corners, nodes, **options), np.random.default_rng(6)
    points, _ = trace(drag, nodes)
    span = np.ptp(points[:, 0]) * (2.0 if drag.strips.is_symmetric else 1.0)
    both = 2.0 if drag.strips.is_symmetric else 1.0  # halves that lift
    assert drag.least(nodes, ALPHA, 0.3) == pytest.approx((both * 0.3) ** 2 / (np.pi * span**2) / both, rel=2e-4)
    for _ in range(3):
        load = rng.uniform(0.5, 1.5, drag.strips.n_strips)
        _, area = drag.evaluate(forces_of(drag, nodes, load), nodes, ALPHA)
        assert drag.least(nodes, ALPHA, load @ np.diff(points[:, 0])) < area


@pytest.mark.slow
def test_pressures_of_a_tip_vortex_on_a_narrow_strip_hardly_count():
    grid = hh_wing_grid(rectangular_wing(), (5, 5, 17), Spacing(0.01, 0.02, 0.02, 0.02))
    corners, nodes = wall(grid)
    drag = drag_of(corners, nodes)
    points, _ = trace(drag, nodes)
    load = 0.4 * means(1.0 + points[:, 0] / -points[0, 0], {1: 1.0})
    _, smooth = drag.evaluate(forces_of(drag, nodes, load), nodes, ALPHA)
    load[0] += 0.15
    _, rough = drag.evaluate(forces_of(drag, nodes, load), nodes, ALPHA)
    assert smooth < rough < 1.02 * smooth
    assert Wake(points, 0.5 * load).drag > 1.2 * Wake(points, 0.5 * (load - 0.15 * (np.arange(16) == 0))).drag


@pytest.mark.slow
def test_drag_with_upright_winglets_is_the_limit_of_many_strips():
    corners, nodes = wall(plate(33), upright(0.4))
    drag = drag_of(corners, nodes)
    points, _ = trace(drag, nodes)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    load = means(arc / arc[-1], {1: 1.0, 3: -0.1})
    _, area = drag.evaluate(forces_of(drag, nodes, load), nodes, ALPHA)
    plain = [many_strips(arc, points, n) for n in (400, 800)]
    assert area == pytest.approx(2.0 * plain[1] - plain[0], rel=3e-3)
    assert area < 0.9 * flat_drag(arc, points)


def many_strips(arc, points, n):
    """Drag of equal strips along the same trace, first order in their number."""
    at = np.linspace(0.0, arc[-1], n + 1)
    fine = np.stack([np.interp(at, arc, x) for x in points.T], axis=1)
    return Wake(fine, 0.5 * means(at / arc[-1], {1: 1.0, 3: -0.1})).drag


def flat_drag(arc, points):
    """Least drag of the same lift on a flat wing of the same span."""
    load = means(arc / arc[-1], {1: 1.0, 3: -0.1})
    return (load @ np.diff(points[:, 0])) ** 2 / (2.0 * np.pi * points[:, 0].min() ** 2)


@pytest.mark.slow
def test_lift_of_a_strip_is_taken_across_its_trace():
    corners, nodes = wall_of("upright winglets")
    drag = drag_of(corners, nodes)
    load = np.linspace(1.0, 2.0, drag.strips.n_strips)
    forces = forces_of(drag, nodes, load)
    np.testing.assert_allclose(drag.evaluate(forces, nodes, ALPHA)[0], load, rtol=1e-10)
    tip = drag.strips.face_weights[[0]].T @ np.ones(1)
    upwards = forces + tip[:, None] * AXES[2]  # along the upright tip, up to the angle of attack
    np.testing.assert_allclose(drag.evaluate(upwards, nodes, 0.0)[0][0], drag.evaluate(forces, nodes, 0.0)[0][0])


@pytest.mark.slow
def test_whole_wing_has_twice_the_drag_of_its_half():
    corners, nodes = wall_of("M6")
    half = drag_of(corners, nodes)
    points, _ = trace(half, nodes)
    forces = forces_of(half, nodes, means(1.0 + points[:, 0] / -points[0, 0], {1: 1.0}))
    mirror, n = np.array([1.0, 1.0, -1.0]), len(nodes)
    rows = np.where(np.abs(nodes[:, 2]) < 1e-12, np.arange(n), n + np.arange(n))  # the root's nodes are one
    whole_corners, whole_nodes = np.concatenate([corners, rows[corners]]), np.concatenate([nodes, nodes * mirror])
    whole = drag_of(whole_corners, whole_nodes, is_symmetric=False, n_strips=24)
    _, area = whole.evaluate(np.concatenate([forces, forces * mirror]), whole_nodes, ALPHA)
    assert area == pytest.approx(2.0 * half.evaluate(forces, nodes, ALPHA)[1], rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "options"), [*((name, {}) for name in WALLS), ("M6", {"is_symmetric": False})])
def test_derivatives_agree_with_complex_steps_and_with_their_transpose(name, options):
    corners, nodes = wall_of(name)
    drag, rng = drag_of(corners, nodes, **options), np.random.default_rng(2)
    nodes = nodes + 1e-4 * rng.standard_normal(nodes.shape)
    forces = rng.standard_normal((len(corners), 3))
    d_forces, d_nodes, d_alpha = rng.standard_normal(forces.shape), 1e-3 * rng.standard_normal(nodes.shape), 0.7
    d_load, d_area = drag.jvp(forces, nodes, ALPHA, d_forces, d_nodes, d_alpha)
    step = 1e-30j
    load, area = drag.evaluate(forces + step * d_forces, nodes + step * d_nodes, ALPHA + step * d_alpha)
    np.testing.assert_allclose(d_load, load.imag / 1e-30, rtol=1e-10, atol=1e-10 * np.abs(d_load).max())
    assert d_area == pytest.approx(area.imag / 1e-30, rel=1e-10)
    load_bar, area_bar = rng.standard_normal(len(d_load)), 0.3
    bars = drag.vjp(forces, nodes, ALPHA, load_bar, area_bar)
    dots = [np.sum(bar * d) for bar, d in zip(bars, (d_forces, d_nodes, d_alpha))]
    expected = load_bar @ d_load + area_bar * d_area
    assert sum(dots) == pytest.approx(expected, rel=1e-12, abs=1e-12 * np.abs(dots).max())


@pytest.mark.slow
def test_drag_and_load_stay_where_the_wing_is_carried_along():
    corners, nodes = wall_of("body with winglets")
    drag = drag_of(corners, nodes)
    forces = np.random.default_rng(3).standard_normal((len(corners), 3))
    load, area = drag.evaluate(forces, nodes, ALPHA)
    moved_load, moved_area = drag.evaluate(forces, nodes + [0.3, -0.2, 0.0], ALPHA)
    np.testing.assert_allclose(moved_load, load, rtol=1e-12)
    assert moved_area == pytest.approx(area, rel=1e-12)
    mirrored = replace(drag, strips=replace(drag.strips, axes=drag.strips.axes * np.array([1.0, -1.0, 1.0])[:, None]))
    mirrored_load, mirrored_area = mirrored.evaluate(forces * [1.0, 1.0, -1.0], nodes * [1.0, 1.0, -1.0], ALPHA)
    np.testing.assert_allclose(mirrored_load, load, rtol=1e-12)
    assert mirrored_area == pytest.approx(area, rel=1e-12)
