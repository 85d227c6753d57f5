"""Planform and section variables: what they do to a wing, their stations, and their derivatives."""

from dataclasses import replace

import numpy as np
import pytest

from bspline_mdao import DesignSurface, InputError, fit_grid
from bspline_mdao.core.design.hinge import Hinge
from bspline_mdao.core.design.lattice import Lattice
from bspline_mdao.core.design.parametrization import Parametrization
from bspline_mdao.core.design.planform import Camber, Chord, Dihedral, Span, Sweep, Taper, ThicknessFactor, Twist
from bspline_mdao.core.design.reference_axis import ReferenceAxis, StationSpline, chord_lines
from bspline_mdao.core.design.rotation import Rotation
from bspline_mdao.core.design.section_maps import SCALED_AFTER_TURN
from bspline_mdao.core.design.variable import Layout
from bspline_mdao.core.mesh.moving_mesh import MovingMesh
from bspline_mdao.generators import flat_plate_grid, onera_m6_grid
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import moving_mesh

KINDS = {
    "twist": lambda axis: Twist("v", axis, stations=4),
    "linear twist": lambda axis: Twist("v", axis, stations=(0.2, 0.5, 0.9), order=2),
    "chord": lambda axis: Chord("v", axis, stations=3),
    "chord alone": lambda axis: Chord("v", axis, stations=3, scales_thickness=False),
    "taper": lambda axis: Taper("v", axis),
    "thickness": lambda axis: ThicknessFactor("v", axis, stations=5),
    "camber": lambda axis: Camber("v", axis, stations=4),
    "span": lambda axis: Span("v", axis),
    "span of panels": lambda axis: Span("v", axis, stations=3, order=2),
    "sweep": lambda axis: Sweep("v", axis, stations=4),
    "dihedral": lambda axis: Dihedral("v", axis, stations=2),
}


SCALINGS = {
    "thickness": (lambda axis: ThicknessFactor("scale", axis), 1.1),
    "chord alone": (lambda axis: Chord("scale", axis, scales_thickness=False), 1.1),
    "chord": (lambda axis: Chord("scale", axis), 1.0),
}


@pytest.mark.parametrize("scaling", SCALINGS)
def test_a_scaling_after_a_twist_changes_its_angle_and_is_noted_as_of_deformations(scaling):
    wing = DesignSurface.of(fit_grid(flat_plate_grid((7, 7, 5))))
    (make, steeper), factor = SCALINGS[scaling], 1.0 / 1.1 if "chord" in scaling else 1.1
    points = wing.mesh.points[wing.mesh.surface_ids]
    twist, scale = Twist("twist", wing.axis), make(wing.axis)
    values = {"twist": np.array([5.0]), "scale": np.array([factor])}

    def slope(*variables):
        moved = Parametrization(wing.mesh, variables).apply(points, values)
        first, last = (moved[np.argmin(moved[:, 0])], moved[np.argmax(moved[:, 0])])
        return (first - last)[1] / (last - first)[0]

    assert slope(scale, twist) == pytest.approx(np.tan(np.radians(5.0)), rel=1e-9)
    assert slope(twist, scale) == pytest.approx(steeper * np.tan(np.radians(5.0)), rel=1e-9)
    assert Parametrization(wing.mesh, [scale, twist]).notes == ()
    assert Parametrization(wing.mesh, [twist, scale]).notes == (() if scaling == "chord" else (SCALED_AFTER_TURN,))


def test_a_thickness_after_a_flap_is_noted():
    wing = DesignSurface.of(fit_grid(flat_plate_grid((7, 7, 5))))
    flap, thickness = Rotation("flap", Hinge.on_chord(wing.mesh, 0.75), blend=0.1), ThicknessFactor("t", wing.axis)
    assert wing.parametrization([flap, thickness]).notes == (SCALED_AFTER_TURN,)
    assert wing.parametrization([thickness, flap]).notes == ()


@pytest.fixture(scope="module")
def m6():
    return moving_mesh(fit_grid(onera_m6_grid((15, 13, 13)), n_control=(7, 6, 6)))


@pytest.fixture(scope="module")
def wing():
    return winglet_mesh(0.0)


@pytest.fixture(scope="module")
def winglet():
    return winglet_mesh(1.4)


def winglet_mesh(cant, counts=(6, 13, 2)):
    """A block above a plate of chord 1 to 0.6 and span 3 whose outer third is bent up by an angle; twisted by 4 deg."""
    part, out, height = np.meshgrid(*[np.linspace(0, 1, n) for n in counts], indexing="ij")
    length = 3.0 * out
    bent = cant * np.clip((length - 2.0) / 0.5, 0.0, 1.0)
    steps = np.linspace(0.0, 3.0, 3001)
    angles = cant * np.clip((steps - 2.0) / 0.5, 0.0, 1.0)
    z, y = (np.interp(length, steps, np.cumsum(f(angles)) * 1e-3 - 1e-3 * f(0.0)) for f in (np.cos, np.sin))
    chord, turn = 1.0 - 0.4 * out, np.radians(4.0)
    x = 0.3 * length + chord * np.cos(turn) * (part - 0.25)
    up = -chord * np.sin(turn) * (part - 0.25) + height
    points = np.stack([x, y + up * np.cos(bent), z - up * np.sin(bent)], axis=-1).reshape(-1, 3)
    ids = np.arange(len(points), dtype=np.int32).reshape(counts)
    surface = np.sort(ids[:, :, 0].ravel())
    is_free = np.ones(points.shape, dtype=bool)
    is_free[surface] = False
    on_plane = np.searchsorted(surface, ids[:, 0, 0])
    normals = np.broadcast_to([0.0, 0.0, 1.0], (len(on_plane), 3))
    return MovingMesh((ids,), ("block 1",), points, surface, is_free, None, on_plane, normals)


def surface_of(mesh):
    return mesh.points[mesh.surface_ids]


def bound(mesh, *variables):
    """Maps of variables, and the rows."""
    auxiliary = []
    for variable in variables:
        auxiliary += [item for item in variable.auxiliary if not any(item is known for known in auxiliary)]
    layout = Layout(mesh, tuple(auxiliary))
    return layout, [variable.bind(layout) for variable in variables]


def moved(mesh, *pairs):
    """All rows of a mesh after variables with their values."""
    layout, maps = bound(mesh, *[variable for variable, _ in pairs])
    points = layout.points
    for design_map, (_, values) in zip(maps, pairs):
        points = design_map.apply(points, np.broadcast_to(values, design_map.initial.shape))
    return layout, points


def section(mesh, points, place, tolerance=1e-6):
    """Points of the baseline's section at a place along the span."""
    return points[: len(mesh.surface_ids)][np.abs(surface_of(mesh)[:, 2] - place) < tolerance]


def distances(points):
    return np.linalg.norm(points[:, None] - points, axis=-1)


# stations


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("stations", [1, 2, 3, 6, (0.1, 0.25, 0.3, 0.8)])
def test_station_splines_reproduce_constants_and_interpolate(order, stations):
    spline = StationSpline.of(stations, order)
    at = np.random.default_rng(0).uniform(-0.5, 1.5, 40)
    np.testing.assert_allclose(spline.matrix(at).sum(axis=1), 1.0, atol=1e-14)
    np.testing.assert_allclose(spline.basis(np.array(spline.stations)), np.eye(spline.n_values), atol=1e-14)
    ends = np.array(spline.stations)[[0, -1]]
    np.testing.assert_array_equal(spline.basis(ends + [-0.3, 0.3]), spline.basis(ends))


@pytest.mark.parametrize(("order", "degree"), [(2, 1), (4, 2)])
def test_station_splines_reproduce_lines_and_parabolas(order, degree):
    spline = StationSpline.of((0.0, 0.15, 0.5, 0.8, 1.0), order)
    at = np.linspace(0.0, 1.0, 33)
    np.testing.assert_allclose(spline.matrix(at) @ np.array(spline.stations) ** degree, at**degree, atol=1e-14)


@pytest.mark.parametrize(("order", "reach"), [(2, 1), (4, 2)])
def test_a_value_is_felt_by_the_intervals_next_to_its_station(order, reach):
    spline = StationSpline.of(9, order)
    at = np.random.default_rng(1).uniform(0.0, 1.0, 200)
    is_far = np.abs(at[:, None] - spline.stations) >= reach / 8.0
    assert not spline.matrix(at).toarray()[is_far].any()
    assert spline.matrix(at).nnz <= 2 * reach * len(at)


@pytest.mark.parametrize("order", [2, 4])
def test_integrals_of_station_splines_are_those_of_their_values(order):
    spline = StationSpline.of((0.1, 0.4, 0.7, 0.9), order)
    at = np.linspace(-0.2, 1.3, 15001)
    middle = spline.basis(0.5 * (at[1:] + at[:-1]))
    summed = np.cumsum(middle * np.diff(at)[:, None], axis=0)
    np.testing.assert_allclose(spline.integral(at[1:]) - spline.integral(at[0]), summed, atol=1e-8)


@pytest.mark.parametrize(
    ("stations", "order", "message"),
    [
        (0, 4, "at least one"),
        ((0.5, 0.2), 2, "ascend"),
        ((0.0, 1.2), 4, "ascend"),
        (3, 3, "order 3"),
        ((), 2, "ascend"),
    ],
)
def test_stations_that_make_no_spline_are_refused(stations, order, message):
    with pytest.raises(InputError, match=message):
        StationSpline.of(stations, order)


# axes


@pytest.mark.slow
@pytest.mark.parametrize("at", [0.0, 0.25, 0.6, 1.0])
def test_axis_of_the_m6_lies_at_its_part_of_the_chord(m6, at):
    axis = ReferenceAxis.of(m6, at=at, n=7)
    sweep, tip = np.tan(np.radians(30.0)), 0.562
    span = np.linspace(0.0, 1.4843, 7)
    chord = 1.0 + (tip - 1.0) * span / 1.4843
    expected = np.stack([sweep * span + at * chord, 0.0 * span, span], axis=1)
    np.testing.assert_allclose(axis.points, expected, atol=2e-6)


@pytest.mark.slow
def test_axis_of_a_finer_m6_is_that_of_its_surface_but_for_what_its_control_mesh_sticks_out():
    model = fit_grid(onera_m6_grid((25, 21, 13)), n_control=(11, 9, 6))
    span = np.linspace(0.0, 1.4843, 9)
    expected = np.tan(np.radians(30.0)) * span + 0.25 * (1.0 - 0.438 / 1.4843 * span)
    by_surface = ReferenceAxis.of(moving_mesh(model), surface=SurfaceGrid.of(model)).points
    by_control_mesh = ReferenceAxis.of(moving_mesh(model)).points
    np.testing.assert_allclose(by_surface, np.stack([expected, 0.0 * span, span], axis=1), atol=1e-5)
    np.testing.assert_allclose(by_control_mesh, by_surface, atol=2e-3)
    np.testing.assert_allclose(
        by_control_mesh[:, 1], 0.0, atol=1e-12
    )  # in the middle between control points of the nose


def test_chord_lines_end_in_the_middle_of_a_blunt_nose_and_base():
    nose = np.array(
        [[0.0, 0.0], [-0.001, 0.01], [0.5, 0.06], [1.0, 0.003], [1.0, -0.001], [0.5, -0.06], [-0.0011, -0.01]]
    )
    places = np.array([0.0, 0.3, 1.0])
    points = np.array([[x, y, z] for z in places for x, y in nose])
    ring = np.stack([np.arange(7), (np.arange(7) + 1) % 7], axis=1)
    quads = np.concatenate([np.column_stack([ring, ring[:, ::-1] + 7]) + 7 * n for n in range(2)])
    lines = chord_lines(points, quads, points[:, 2], np.array([0.0, 0.5, 1.2]), np.array([1.0, 0.0, 0.0]))
    np.testing.assert_allclose(lines.leading, [[-0.0011, 0.0, z] for z in (0.0, 0.5, 1.2)], atol=1e-4)
    np.testing.assert_allclose(lines.trailing, [[1.0, 0.001, z] for z in (0.0, 0.5, 1.2)], atol=1e-12)


@pytest.mark.slow
def test_stations_of_a_straight_axis_are_those_of_the_span(m6):
    layout = Layout(m6, (axis := ReferenceAxis.of(m6, n=5),))
    attached = axis.attach(layout)
    np.testing.assert_allclose(attached.stations, layout.points[:, 2] / 1.4843, atol=1e-12)
    centres = attached.weights @ layout.points[attached.axis_rows]
    np.testing.assert_allclose(centres[:, 2], layout.points[:, 2], atol=1e-12)
    np.testing.assert_allclose(centres[attached.axis_rows], axis.points, atol=1e-14)


@pytest.mark.slow
def test_chord_parts_and_lengths_are_those_of_the_sections(m6):
    layout = Layout(m6, (axis := ReferenceAxis.of(m6, n=5),))
    attached = axis.attach(layout)
    chord = 1.0 + (0.562 - 1.0) * attached.stations
    np.testing.assert_allclose(attached.chord_lengths, chord, atol=3e-6)
    part = (layout.points[:, 0] - np.tan(np.radians(30.0)) * layout.points[:, 2]) / chord
    np.testing.assert_allclose(attached.chord_parts, part, atol=3e-6)


def curved_axis(mesh):
    """Quarter-chord points of `winglet_mesh`."""
    points = surface_of(mesh).reshape(6, 13, 3)
    return ReferenceAxis(0.75 * points[0] + 0.25 * points[-1], is_curved=True)


def test_a_curved_axis_turns_sections_with_a_winglet(winglet):
    axis = curved_axis(winglet)
    attached = axis.attach(Layout(winglet, (axis,)))
    np.testing.assert_allclose(
        attached.stations[:78].reshape(6, 13), np.broadcast_to(np.linspace(0, 1, 13), (6, 13)), atol=0.02
    )
    np.testing.assert_allclose(attached.section_axes[0], [[1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(attached.section_axes[77], [[1, 0, 0], [0, np.cos(1.4), -np.sin(1.4)]], atol=1e-3)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((3, 2)), "shape"),
        (np.zeros((1, 3)), "shape"),
        (np.array([[0.0, 0, 1], [0, 0, 0]]), "point 2 is not further along"),
    ],
)
def test_axes_that_do_not_go_out_are_refused(wing, points, message):
    with pytest.raises(InputError, match=message):
        (axis := ReferenceAxis(points)).attach(Layout(wing, (axis,)))


def test_a_section_without_chord_is_named(wing):
    pointed = wing.points.copy()
    rows = wing.surface_ids.reshape(6, 13)[:, -1]
    pointed[rows] = pointed[rows[2]]
    with pytest.raises(InputError, match="no chord; end the axis short of it"):
        ReferenceAxis.of(replace(wing, points=pointed))
    assert ReferenceAxis.of(replace(wing, points=pointed), span=(0.0, 0.9)).points[-1, 2] == pytest.approx(2.7)


# derivatives


@pytest.mark.slow
@pytest.mark.parametrize("mesh_name", ["m6", "winglet"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("is_initial", [False, True])
def test_partials_are_exact_transposed_and_of_one_pattern(request, mesh_name, kind, is_initial):
    mesh = request.getfixturevalue(mesh_name)
    axis = curved_axis(mesh) if mesh_name == "winglet" else ReferenceAxis.of(mesh, n=4)
    layout, (design_map,) = bound(mesh, KINDS[kind](axis))
    rng = np.random.default_rng(3)
    n_values = len(design_map.initial)
    values = design_map.initial + (0.0 if is_initial else rng.uniform(-0.5, 0.5, n_values))
    points = layout.points + 0.05 * rng.standard_normal(layout.points.shape)
    partials = design_map.partials(points, values)
    d_points, d_values, bar = (
        rng.standard_normal(points.shape),
        rng.standard_normal(n_values),
        rng.standard_normal(points.size),
    )
    step = 1e-40
    moved_by_points = design_map.apply(points + 1j * step * d_points, values).imag.ravel() / step
    moved_by_values = design_map.apply(points, values + 1j * step * d_values).imag.ravel() / step
    np.testing.assert_allclose(partials.points @ d_points.ravel(), moved_by_points, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(partials.values @ d_values, moved_by_values, rtol=1e-10, atol=1e-12)
    forward = bar @ (partials.points @ d_points.ravel() + partials.values @ d_values)
    reverse = (partials.points.T @ bar) @ d_points.ravel() + (partials.values.T @ bar) @ d_values
    assert forward == pytest.approx(reverse, rel=1e-12)
    at_start = design_map.partials(layout.points, design_map.initial)
    for now, then in ((partials.points, at_start.points), (partials.values, at_start.values)):
        np.testing.assert_array_equal(now.indptr, then.indptr)
        np.testing.assert_array_equal(now.indices, then.indices)


@pytest.mark.parametrize("kind", KINDS)
def test_rates_agree_with_differences(m6, kind):
    axis = ReferenceAxis.of(m6)
    layout, (design_map,) = bound(m6, KINDS[kind](axis))
    rng = np.random.default_rng(4)
    values = design_map.initial + rng.uniform(-0.3, 0.3, len(design_map.initial))
    for k, step in enumerate(1e-4 * np.eye(len(values))):
        ends = [design_map.apply(layout.points, values + sign * step).ravel() for sign in (1, -1)]
        column = design_map.partials(layout.points, values).values.toarray()[:, k]
        np.testing.assert_allclose(column, np.subtract(*ends) / 2e-4, atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_initial_values_move_nothing(m6, kind):
    layout, (design_map,) = bound(m6, KINDS[kind](ReferenceAxis.of(m6)))
    np.testing.assert_array_equal(design_map.apply(layout.points, design_map.initial), layout.points)


@pytest.mark.parametrize("mesh_name", ["m6", "winglet"])
@pytest.mark.parametrize("kind", KINDS)
def test_points_of_the_symmetry_plane_stay_in_it(request, mesh_name, kind):
    mesh = request.getfixturevalue(mesh_name)
    axis = curved_axis(mesh) if mesh_name == "winglet" else ReferenceAxis.of(mesh)
    values = np.random.default_rng(5).uniform(0.5, 2.0)
    layout, (design_map,) = bound(mesh, KINDS[kind](axis))
    noise = 0.05 * np.random.default_rng(6).standard_normal(layout.points.shape)
    noise[mesh.in_plane_rows, 2] = noise[layout.rows(axis), 2] = 0.0
    before = layout.points + noise
    points = design_map.apply(before, np.full(len(design_map.initial), values))
    assert np.abs(points - before).max() > 1e-3
    np.testing.assert_allclose(points[mesh.in_plane_rows, 2], 0.0, atol=1e-14)


@pytest.mark.parametrize("kind", [Twist, Chord, ThicknessFactor])
def test_the_first_section_of_a_curved_axis_that_leaves_its_plane_obliquely_is_in_the_plane(m6, kind):
    span = np.linspace(0.0, 1.4843, 6)[:, None]
    axis = ReferenceAxis(span * [0.5, 0.7, 1.0] + [0.25, 0.0, 0.0], is_curved=True)
    layout, points = moved(m6, (kind("v", axis), 3.0))
    is_at_begin = np.abs(axis.attach(layout).stations[m6.in_plane_rows]) < 1e-12
    np.testing.assert_allclose(points[layout.rows(axis)], axis.points, atol=1e-14)
    flat = points[m6.in_plane_rows][is_at_begin | (layout.points[m6.in_plane_rows, 1] <= 0.0)]
    assert len(flat) > 3
    np.testing.assert_allclose(flat[:, 2], 0.0, atol=1e-14)


def test_composition_of_all_kinds_differentiates_exactly(m6):
    axis, aft = ReferenceAxis.of(m6, n=5), ReferenceAxis.of(m6, at=0.7, n=2)
    made = [replace(make(aft if n % 2 else axis), name=name) for n, (name, make) in enumerate(KINDS.items())]
    parametrization = Parametrization(m6, made)
    rng = np.random.default_rng(6)
    values = {name: start + rng.uniform(-0.2, 0.2, len(start)) for name, start in parametrization.initial.items()}
    surface = surface_of(m6)
    partials = parametrization.partials(surface, values)
    for name, matrix in partials.values.items():
        d_values = rng.standard_normal(len(values[name]))
        stepped = parametrization.apply(surface, values | {name: values[name] + 1e-40j * d_values}).imag / 1e-40
        np.testing.assert_allclose(matrix @ d_values, stepped.ravel(), rtol=1e-10, atol=1e-12)


# what they do


def test_twist_turns_sections_rigidly_about_the_axis(m6):
    axis = ReferenceAxis.of(m6, at=0.4)
    layout, points = moved(m6, (Twist("twist", axis, stations=5), [3.0, 10.0, -20.0, 40.0, 90.0]))
    np.testing.assert_array_equal(points[:, 2], layout.points[:, 2])
    for place in (0.0, 1.4843):
        np.testing.assert_allclose(
            distances(section(m6, points, place)), distances(section(m6, layout.points, place)), atol=1e-13
        )
    np.testing.assert_allclose(points[layout.rows(axis)], axis.points, atol=1e-14)
    tip = section(m6, points, 1.4843)
    np.testing.assert_allclose(np.ptp(tip, axis=0), [0.0, 0.562, 0.0], atol=1e-5)  # at 90 deg, nose up


def test_positive_twist_raises_the_nose(m6):
    layout, points = moved(m6, (Twist("twist", ReferenceAxis.of(m6)), 5.0))
    nose = np.argmin(layout.points[:, 0])
    assert points[nose, 1] == pytest.approx(0.25 * np.sin(np.radians(5.0)), abs=1e-6)


def test_span_scales_the_span_and_nothing_else(m6):
    layout, points = moved(m6, (Span("span", ReferenceAxis.of(m6)), 1.7))
    np.testing.assert_allclose(points, layout.points * [1.0, 1.0, 1.7], atol=1e-13)


def test_span_of_panels_stretches_each_by_its_factor(m6):
    axis = replace(ReferenceAxis.of(m6, n=3), order=2)
    span = Span("span", axis, stations=(0.5, 0.5 + 1e-9), order=2)
    layout, points = moved(m6, (span, [1.0, 2.0]))
    z = layout.points[:, 2]
    np.testing.assert_allclose(points[:, 2], np.where(z < 0.74215, z, 2 * z - 0.74215), atol=1e-8)


def test_sweep_and_dihedral_incline_the_axis_by_their_angles(m6):
    axis = ReferenceAxis.of(m6)
    layout, points = moved(m6, (Sweep("sweep", axis), 12.0), (Dihedral("dihedral", axis), 5.0))
    slopes = np.tan(np.radians([12.0, 5.0, 0.0]))
    np.testing.assert_allclose(points - layout.points, np.outer(layout.points[:, 2], slopes), atol=1e-13)


def test_sweep_at_stations_adds_up_along_the_span(m6):
    axis = ReferenceAxis.of(m6, n=3)
    layout, points = moved(m6, (Sweep("sweep", axis, stations=2, order=2), [0.0, 30.0]))
    t = layout.points[:, 2] / 1.4843
    np.testing.assert_allclose((points - layout.points)[:, 0], np.tan(np.pi / 6) * 1.4843 * t**2 / 2, atol=1e-12)


def test_sections_keep_their_shape_under_sweep_dihedral_and_span(m6):
    axis = ReferenceAxis.of(m6)
    layout, points = moved(
        m6,
        (Sweep("a", axis, stations=3), [5, 20, 30]),
        (Dihedral("b", axis, stations=2), [2, 30]),
        (Span("c", axis), 2.0),
    )
    for place in (0.0, 1.4843):
        before, after = (section(m6, rows, place) for rows in (layout.points, points))
        np.testing.assert_allclose(after - after[0], before - before[0], atol=1e-13)


def test_sweep_is_an_angle_of_the_stretched_wing(m6):
    axis = ReferenceAxis.of(m6)
    layout, points = moved(m6, (Span("span", axis), 2.0), (Sweep("sweep", axis), 20.0))
    np.testing.assert_allclose(
        (points - layout.points)[:, 0], 2 * np.tan(np.radians(20)) * layout.points[:, 2], atol=1e-13
    )


@pytest.mark.parametrize("shift", ["sweep", "dihedral"])
def test_twist_after_a_shift_equals_the_shift_after_twist(m6, shift):
    axis = ReferenceAxis.of(m6)
    twist = Twist("twist", axis, stations=4), [0.0, 5.0, -8.0, 20.0]
    other = (Sweep if shift == "sweep" else Dihedral)("other", axis, stations=3), [3.0, 10.0, 25.0]
    np.testing.assert_allclose(moved(m6, twist, other)[1], moved(m6, other, twist)[1], atol=1e-13)


def test_chord_leaves_the_axis_and_thickness_over_chord(m6):
    axis = ReferenceAxis.of(m6, at=0.6)
    layout, points = moved(m6, (Chord("chord", axis, stations=3), [2.0, 0.7, 1.5]))
    np.testing.assert_allclose(points[layout.rows(axis)], axis.points, atol=1e-14)
    root, wide = section(m6, layout.points, 0.0), section(m6, points, 0.0)
    np.testing.assert_allclose(np.ptp(wide, axis=0), 2.0 * np.ptp(root, axis=0), rtol=1e-12)
    alone = moved(m6, (Chord("chord", axis, scales_thickness=False), 2.0))[1]
    np.testing.assert_allclose(np.ptp(section(m6, alone, 0.0), axis=0), np.ptp(root, axis=0) * [2, 1, 1], rtol=1e-12)


def test_taper_gives_the_tip_chord(m6):
    axis = ReferenceAxis.of(m6)
    layout, points = moved(m6, (Taper("taper", axis), 0.4))
    for place, factor in ((0.0, 1.0), (1.4843, 0.4)):
        before, after = (section(m6, rows, place) for rows in (layout.points, points))
        np.testing.assert_allclose(np.ptp(after, axis=0), factor * np.ptp(before, axis=0), rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(
        moved(m6, (Taper("taper", axis), 0.4))[1], moved(m6, (Chord("c", axis, 2), [1, 0.4]))[1], atol=1e-13
    )


def test_thickness_scales_heights_above_the_chord_line(wing):
    """Of a plate twisted by 4 deg the chord line is the plate itself: it stays, and heights off it are scaled."""
    axis = ReferenceAxis.of(wing)
    layout, (thicken,) = bound(wing, ThicknessFactor("thickness", axis))
    points = layout.points.copy()
    np.testing.assert_allclose(thicken.apply(points, np.array([3.0])), points, atol=1e-9)
    normal = np.array([np.sin(np.radians(4.0)), np.cos(np.radians(4.0)), 0.0])
    points[: layout.n_surface] += 0.1 * normal
    thicker = thicken.apply(points, np.array([3.0])) - points
    np.testing.assert_allclose(
        thicker[: layout.n_surface], np.broadcast_to(0.2 * normal, (layout.n_surface, 3)), atol=1e-9
    )


def test_camber_raises_the_middle_of_the_chord_by_its_part(m6):
    axis = ReferenceAxis.of(m6)
    layout, points = moved(m6, (Camber("camber", axis), 0.05))
    chord = 1.0 + (0.562 - 1.0) * layout.points[:, 2] / 1.4843
    part = (layout.points[:, 0] - np.tan(np.radians(30.0)) * layout.points[:, 2]) / chord
    np.testing.assert_allclose(points[:, 1] - layout.points[:, 1], 0.05 * chord * 4 * part * (1 - part), atol=2e-6)
    np.testing.assert_allclose(points[:, [0, 2]], layout.points[:, [0, 2]], rtol=0.0, atol=1e-16)
    s_shaped = Camber("camber", axis, line=lambda part: part * (1 - part) * (0.5 - part))
    raised = moved(m6, (s_shaped, 0.1))[1][:, 1] - layout.points[:, 1]
    np.testing.assert_allclose(raised, 0.1 * chord * part * (1 - part) * (0.5 - part), atol=2e-6)


def test_a_twisted_winglet_turns_about_its_own_span(winglet):
    axis = curved_axis(winglet)
    layout, points = moved(winglet, (Twist("twist", axis), 10.0))
    rows = winglet.surface_ids.reshape(6, 13)
    tip = np.searchsorted(winglet.surface_ids, rows[:, -1])
    np.testing.assert_allclose(distances(points[tip]), distances(layout.points[tip]), atol=1e-3)
    out = np.array([0.0, np.sin(1.4), np.cos(1.4)])
    np.testing.assert_allclose((points - layout.points)[tip] @ out, 0.0, atol=1e-3)


def test_sweep_of_a_curved_axis_counts_its_length_up_the_winglet(winglet):
    axis = curved_axis(winglet)
    layout, points = moved(winglet, (Sweep("sweep", axis), 20.0))
    shift = (points - layout.points)[layout.rows(axis)]
    np.testing.assert_allclose(shift[:, 0], np.tan(np.radians(20)) * np.linspace(0, 3, 13), rtol=0.02, atol=1e-12)
    assert not shift[:, 1:].any()


def test_values_beyond_the_ends_of_an_axis_are_those_of_its_ends(m6):
    axis = ReferenceAxis.of(m6, span=(0.3, 0.8))
    layout, points = moved(m6, (Twist("twist", axis, stations=2), [7.0, 7.0]))
    np.testing.assert_allclose(points, moved(m6, (Twist("twist", axis), 7.0))[1], atol=1e-14)
    layout, points = moved(m6, (Span("span", axis), 2.0))
    z = layout.points[:, 2]
    np.testing.assert_allclose(points[:, 2], np.maximum(z, 2.0 * z - 0.3 * 1.4843), atol=1e-12)


# on a lattice


@pytest.mark.parametrize("kind", [Sweep, Dihedral, Span, Chord, Twist])
def test_affine_variables_on_a_lattice_do_to_the_wing_what_they_do_without(m6, kind):
    lattice, axis = Lattice.box(m6, n=(4, 3, 5)), ReferenceAxis.of(m6)
    value = 1.5 if kind.neutral else 12.0
    axis = replace(axis, points=axis.points * [0.0, 1.0, 1.0] + [0.3, 0.0, 0.0])  # unswept: twist and chord are affine
    there = moved(m6, (kind("v", axis, on=lattice), value))[1][: len(m6.surface_ids)]
    np.testing.assert_allclose(there, moved(m6, (kind("v", axis), value))[1][: len(there)], atol=1e-12)


def test_a_variable_on_a_lattice_moves_the_wing_and_its_axis_as_the_lattice_does(m6):
    lattice, axis = Lattice.box(m6, n=(4, 3, 5)), ReferenceAxis.of(m6)
    variables = [Sweep("sweep", axis, stations=3, on=lattice), Twist("twist", axis, stations=3, on=lattice)]
    assert variables[0].auxiliary == (axis, lattice)
    parametrization = Parametrization(m6, variables)
    values, rng = {"sweep": np.array([3.0, 9.0, 20.0]), "twist": np.array([0.0, 5.0, -10.0])}, np.random.default_rng(8)
    partials = parametrization.partials(surface_of(m6), values)
    for name in values:
        d_values = rng.standard_normal(3)
        stepped = parametrization.apply(surface_of(m6), values | {name: values[name] + 1e-40j * d_values}).imag / 1e-40
        np.testing.assert_allclose(partials.values[name] @ d_values, stepped.ravel(), rtol=1e-10, atol=1e-12)
    free = Parametrization(m6, [replace(variable, on=None) for variable in variables])
    there, direct = (made.apply(surface_of(m6), values) for made in (parametrization, free))
    assert 1e-6 < np.abs(there - direct).max() < 0.05  # a lattice smoothes what is not affine
