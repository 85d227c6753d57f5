"""A section is one curve: what is added to it, and its points, whatever lies across the span."""

import numpy as np
import pytest
from parametrization_cases import section_model, surface_of, wing_model

from bspline_mdao import DesignSurface
from bspline_mdao.core.design.section_places import SectionPlaces
from bspline_mdao.core.design.variable import Layout
from bspline_mdao.core.mesh.control_net import surface_quads
from bspline_mdao.core.mesh.greville_surface import GrevilleSurface
from bspline_mdao.core.mesh.span_lines import span_lines
from bspline_mdao.design import (
    Camber,
    CamberModes,
    ClassShape,
    CurvePoints,
    FreeForm,
    HicksHenne,
    InBox,
    Lattice,
    Local,
    Nearest,
    ReferenceAxis,
    ThicknessModes,
    ThicknessPoints,
    Twist,
)
from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.quads import edges_of
from bspline_mdao.measures import LeadingEdgeRadius
from bspline_mdao.movers import moving_mesh

LAYERS = {"one layer": ((0.0, 1.3), 2), "three layers": ((0.0, 0.3, 0.4, 1.1), 3)}
FINE = {"n_around": 192, "n_control": (49, 9, 3)}

SHAPES = {
    "bumps": HicksHenne("v", (0.15, 0.4, 0.7), power=(2.0, 3.0, 4.0)),
    "bumps below": HicksHenne("v", 3, sides="lower"),
    "class shape": ClassShape("v", 3, trailing=True),
    "class shape with another nose": ClassShape("v", 2, exponents=(1.0, 0.8), nose=False),
    "camber": CamberModes("v", 3, leading=True, trailing=True),
    "thickness": ThicknessModes("v", 3),
    "thickness but the nose": ThicknessModes("v", 2, nose=False),
    "points of thickness": ThicknessPoints("v", 5),
}

shapes = pytest.mark.parametrize("variable", SHAPES.values(), ids=SHAPES)


def section(layers="three layers", **sizes):
    places, n = LAYERS[layers]
    sizes = {"n_control": (21, 9, n)} | sizes
    return DesignSurface.of(section_model(places, **sizes))


def moved(surface, variables, values, **options):
    """Nodes of a surface before and after, and its control points after."""
    mesh, shape = surface.mesh, surface.parametrization(variables, **options)
    points = mesh.points.copy()
    points[mesh.surface_ids] = shape.apply(surface_of(mesh), values)
    before, after = (surface.model.regenerate(p).to_vector().reshape(-1, 3) for p in (mesh.points, points))
    return before[surface.surface.rows], after[surface.surface.rows], points[mesh.surface_ids]


def parts_and_sides(nodes, chord=1.7):
    """Parts of the chord, sides and heights of nodes of a section whose chord lies along x and whose span along y."""
    trailing = nodes[np.argmax(nodes[:, 0])]
    leading = nodes[np.argmax(np.linalg.norm((nodes - trailing)[:, [0, 2]], axis=1))]
    along = (trailing - leading)[[0, 2]] / np.linalg.norm((trailing - leading)[[0, 2]])
    up = np.array([-along[1], along[0]])
    flat = (nodes - leading)[:, [0, 2]]
    return flat @ along / (flat @ along).max(), up, flat @ up


def lines_of(mesh):
    """Points of the curve, in all planes."""
    edges = edges_of(surface_quads(mesh))
    return span_lines(surface_of(mesh), edges, mesh.in_plane_rows, mesh.in_plane_normals)


@pytest.mark.parametrize("layers", LAYERS)
@shapes
def test_shapes_have_one_value_for_all_planes_and_move_them_alike(variable, layers):
    found = section(layers)
    n = variable.shapes(np.array([0.3]), np.ones(1)).shape[1]
    values = {"v": 0.01 * np.random.default_rng(1).normal(size=n)}
    assert found.parametrization([variable]).initial["v"].shape == (n,)
    *_, points = moved(found, [variable], values)
    mesh = found.mesh
    lines = lines_of(mesh)
    change = (points - surface_of(mesh))[lines]
    assert lines.shape == (20, LAYERS[layers][1])
    assert np.abs(change).max() > 1e-3
    np.testing.assert_allclose(change, change[:, :1] + np.zeros((1, lines.shape[1], 1)), atol=1e-14)


@shapes
def test_the_surface_moves_by_the_shapes_normal_to_the_chord(variable):
    found = section(**FINE)
    n = variable.shapes(np.array([0.3]), np.ones(1)).shape[1]
    values = np.random.default_rng(2).normal(size=n) * 0.02
    before, after, _ = moved(found, [variable], {"v": values})
    parts, up, heights = parts_and_sides(before)
    order = np.argsort(parts)
    camber = np.interp(parts, parts[order], np.convolve(np.pad(heights[order], 8, "edge"), np.ones(17) / 17, "valid"))
    change = after - before
    np.testing.assert_allclose(change[:, [0, 2]] - np.outer(change[:, [0, 2]] @ up, up), 0.0, atol=2e-4)
    np.testing.assert_allclose(change[:, 1], 0.0, atol=1e-12)
    is_clear = (parts > 0.02) & (parts < 0.98)
    sides = np.where(heights > camber, 1.0, -1.0)
    expected = variable.shapes(np.clip(parts, 0.0, 1.0), sides) @ values * np.ptp(before[:, 0])
    off = (change[:, [0, 2]] @ up - expected)[is_clear]
    assert np.abs(expected).max() > 2e-3
    assert np.abs(off).max() < 0.01 * np.abs(expected).max()


@shapes
def test_edges_stay_unless_their_heights_are_values(variable):
    found = section(**FINE)
    n = variable.shapes(np.array([0.3]), np.ones(1)).shape[1]
    before, after, _ = moved(found, [variable], {"v": np.full(n, 0.02)})
    parts, *_ = parts_and_sides(before)
    shifts = np.linalg.norm(after - before, axis=1)
    moves_leading, moves_trailing = getattr(variable, "leading", False), getattr(variable, "trailing", False)
    chord = np.ptp(before[:, 0])
    at_trailing = 0.02 * chord if moves_trailing else 0.0
    assert shifts[np.argmax(parts)] == pytest.approx(at_trailing, abs=1e-5 * chord)
    at_leading = 0.02 * chord if moves_leading else 0.0  # no node is at the edge itself
    assert shifts[np.argmin(parts)] == pytest.approx(at_leading, abs=4e-4 * chord)


@pytest.mark.parametrize(("variable", "is_kept"), [
    (ClassShape("v", 3), False), (ClassShape("v", 3, nose=False), True), (ThicknessModes("v", 3), False),
    (ThicknessPoints("v", 4), False), (ThicknessModes("v", 3, nose=False), True),
])  # fmt: skip
def test_the_nose_stays_round_and_keeps_its_radius_where_that_is_said(variable, is_kept):
    found = section(**FINE)
    n = variable.shapes(np.array([0.3]), np.ones(1)).shape[1]
    before, after, _ = moved(found, [variable], {"v": np.full(n, 0.01)})
    radius = LeadingEdgeRadius.at(found.surface, relative_to="baseline", n_nodes=4)
    root = np.sqrt(2.0 * LeadingEdgeRadius.at(found.surface, n_nodes=4).evaluate(before) / np.ptp(before[:, 0]))
    part = 1e-10
    rate = (variable.shapes(np.array([part]), np.ones(1)) @ np.full(n, 0.01)).item() / np.sqrt(part)
    expected = 1.0 if is_kept else ((root + rate) / root) ** 2  # y = sqrt(2 R x) near the nose
    np.testing.assert_allclose(radius.evaluate(after), expected, rtol=0.05)
    assert is_kept or expected > 1.1


def test_one_mode_of_camber_is_the_parabola():
    found = section(**FINE)
    before, after, _ = moved(found, [CamberModes("v", 1)], {"v": np.array([0.02])})
    _, parabola, _ = moved(found, [Camber("v", found.axis)], {"v": np.array([0.02])})
    assert np.abs(after - before).max() > 0.03
    np.testing.assert_allclose(after, parabola, atol=3e-4)


def test_modes_have_a_largest_value_of_one():
    parts = np.linspace(0.0, 1.0, 4001)
    for n in (1, 3, 6):
        for modes, size in ((CamberModes("v", n, leading=True), 1.0), (ThicknessModes("v", n), 0.5)):
            heights = modes.shapes(parts, np.ones(len(parts)))
            np.testing.assert_allclose(heights.max(axis=0), size, atol=1e-6)
    bumps = HicksHenne("v", (0.1, 0.37, 0.9), sides="upper", power=2.0).shapes(parts, np.ones(len(parts)))
    np.testing.assert_allclose(parts[bumps.argmax(axis=0)], [0.1, 0.37, 0.9], atol=1e-3)


def test_points_of_thickness_are_a_smooth_partition_nowhere_negative_and_each_of_a_part_of_the_chord():
    parts = np.linspace(0.0, 1.0, 4001)
    heights = ThicknessPoints("v", 8).shapes(parts, np.ones(len(parts)))
    assert heights.min() == 0.0
    inside = (parts > 0.15) & (parts < 0.96)  # at the edges those that stay are part of the sum
    np.testing.assert_allclose(heights[inside].sum(axis=1), 0.5, atol=1e-12)
    assert ((heights > 0.0).sum(axis=1) <= 4).all()
    np.testing.assert_array_equal(np.diff(parts[heights.argmax(axis=0)]) > 0.0, True)
    np.testing.assert_array_equal(ThicknessPoints("v", 8).shapes(parts, -np.ones(len(parts))), -heights)


def test_control_points_interpolate_at_greville_abscissae():
    for mesh in (section().mesh, moving_mesh(wing_model())):
        surface, random = GrevilleSurface.of(mesh), np.random.default_rng(3)
        asked = random.normal(size=(len(mesh.surface_ids), 2))
        np.testing.assert_allclose(surface.matrix @ surface.control(asked), asked, atol=1e-10)
        np.testing.assert_allclose(surface.matrix @ surface_of(mesh), surface.points, atol=1e-12)
        np.testing.assert_allclose(surface.matrix.sum(axis=1), 1.0, atol=1e-12)


def test_sides_and_parts_are_those_of_the_section():
    places = SectionPlaces.of(Layout(section(**FINE).mesh))
    heights = places.surface.points @ [0.0, 0.0, 1.0]
    middle = (places.parts > 0.1) & (places.parts < 0.9)
    assert (places.sides[middle & (heights > 0.04)] == 1.0).all()
    assert (places.sides[middle & (heights < 0.0)] == -1.0).all()
    assert (places.parts.min(), places.parts.max()) == pytest.approx((0.0, 1.0), abs=2e-4)
    np.testing.assert_allclose(places.chords, np.ptp(places.surface.points[:, 0]), rtol=1e-3)


@pytest.mark.parametrize("variable", [HicksHenne, CamberModes, ClassShape, ThicknessModes, ThicknessPoints])
def test_stations_have_values_of_their_own_on_wings(variable):
    wing = DesignSurface.of(wing_model())
    axis = ReferenceAxis.of(wing.mesh)
    made = variable("v", 2, axis=axis, stations=(0.0, 0.5, 1.0), order=2)
    n = made.shapes(np.array([0.3]), np.ones(1)).shape[1]
    values = np.zeros((3, n))
    values[0] = 0.02
    before, after, points = moved(wing, [made], {"v": values.ravel()})
    span, shift = before[:, 2] / before[:, 2].max(), np.abs(after - before).max(axis=1)
    assert shift[span < 0.1].max() > 5e-3
    assert shift[span > 0.7].max() < 0.05 * shift.max()
    assert np.abs((points - surface_of(wing.mesh))[:, 2]).max() < 1e-12


@pytest.mark.parametrize("layers", LAYERS)
def test_points_of_the_curve_have_one_value_each(layers):
    found = section(layers)
    n_directions = {"normal": 1, "xz": 2}
    for direction, n in n_directions.items():
        for edges, n_points in ((False, 18), (True, 20)):
            points = CurvePoints("v", direction=direction, edges=edges)
            assert found.parametrization([points]).initial["v"].size == n * n_points
    one = CurvePoints("v", Nearest((0.9, 0.0, 0.2)))
    assert found.parametrization([one]).initial["v"].size == 1
    ahead = CurvePoints("v", InBox(high=(0.5, None, None)), direction="z")
    values = np.random.default_rng(4).normal(size=found.parametrization([ahead]).initial["v"].size)
    *_, points = moved(found, [ahead], {"v": values})
    mesh = found.mesh
    lines = lines_of(mesh)
    change = (points - surface_of(mesh))[lines]
    np.testing.assert_allclose(change, change[:, :1] + np.zeros((1, lines.shape[1], 1)), atol=1e-14)
    np.testing.assert_allclose(np.sort(change[:, 0, 2][change[:, 0, 2] != 0.0]), np.sort(values), atol=1e-14)


def test_a_section_of_one_layer_moves_alike_in_both_planes_whatever_the_variable():
    one, three = section("one layer"), section()
    assert one.mesh.copies.shape == (20, 2)
    assert three.mesh.copies.shape == (0, 2)
    assert one.parametrization([Local("v", direction="xz")]).initial["v"].size == 40
    assert three.parametrization([Local("v", direction="xz")]).initial["v"].size == 120
    box = FreeForm("v", Lattice.box(one.mesh, (8, 2, 2)), direction="z")  # two of the span, which move it alike
    assert one.parametrization([box]).initial["v"].size == 16
    assert three.parametrization([FreeForm("v", Lattice.box(three.mesh, (8, 2, 2)))]).initial["v"].size > 32
    ids, directions = box.places(one.parametrization([box]).layout)
    np.testing.assert_array_equal(directions, np.tile([0.0, 0.0, 1.0], (16, 1)))
    assert len(np.unique(box.lattice.points[ids][:, [0, 2]].round(9), axis=0)) == 16
    *_, points = moved(one, [box], {"v": np.full(16, 0.3)})
    np.testing.assert_allclose((points - surface_of(one.mesh))[:, 2], 0.3, atol=1e-12)
    values = np.random.default_rng(5).normal(size=one.parametrization([box]).initial["v"].size)
    for variables, given in (([box], values), ([Twist("v", one.axis)], np.array([7.0]))):
        *_, points = moved(one, variables, {"v": given})
        first, second = (points - surface_of(one.mesh))[one.mesh.copies].swapaxes(0, 1)
        assert np.abs(first).max() > 0.01
        np.testing.assert_allclose(first, second, atol=1e-14)


def test_what_is_no_section_is_none():
    wing = moving_mesh(wing_model())
    assert lines_of(wing) is None
    assert not wing.copies.size
    bent = section().mesh
    points = surface_of(bent).copy()
    points[7, 0] += 1e-3
    assert span_lines(points, edges_of(surface_quads(bent)), bent.in_plane_rows, bent.in_plane_normals) is None
    with pytest.raises(InputError, match="'points': the surface is no section, the same from one plane"):
        DesignSurface.of(wing_model()).parametrization([CurvePoints("points")])


def test_half_of_a_section_ends_on_its_own_plane_of_symmetry_as_well():
    random = np.random.default_rng(6)
    flat = np.cumsum(random.uniform(0.1, 0.3, (7, 2)), axis=0)
    points = np.concatenate([np.column_stack([flat, np.full(7, place)]) for place in (-0.4, 0.9, 1.2)])
    numbers = np.arange(21).reshape(3, 7)
    quads = np.stack([numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]], axis=-1).reshape(-1, 4)
    at_nose, on_planes = numbers[:, 0], numbers[[0, -1]].ravel()
    normals = np.repeat([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [3, 14], axis=0)
    lines = span_lines(points, edges_of(quads), np.concatenate([at_nose, on_planes]), normals)
    np.testing.assert_array_equal(lines, numbers.T)
    assert span_lines(points, edges_of(quads), at_nose, normals[:3]) is None


@pytest.mark.parametrize(("make", "message"), [
    (lambda: HicksHenne("v", (0.01, 0.5), power=2.0), "at 0.01 of the chord makes a kink at the nose; move it back, or "
     "take a power above 3.32"),
    (lambda: HicksHenne("v", (0.0, 0.5)), "give parts of the chord between 0 and 1, or how many"),
    (lambda: HicksHenne("v", 0), "give parts of the chord between 0 and 1, or how many"),
    (lambda: HicksHenne("v", 3, power=(3.0, 3.0)), "a positive power, or one for each of 3 bumps"),
    (lambda: HicksHenne("v", 3, sides="left"), "sides out of upper and lower"),
    (lambda: ClassShape("v", 0), "'v': degree 0; give a whole number from 1 to 50"),
    (lambda: ClassShape("v", 3, exponents=(0.3, 1.0)), "give two numbers, from 0.5 on and positive"),
    (lambda: CamberModes("v", 2.5), "'v': n 2.5; give a whole number"),
    (lambda: ThicknessModes("v", 51), "'v': n 51; give a whole number"),
    (lambda: ThicknessPoints("v", 0), "'v': n 0; give a whole number from 1 to 50"),
    (lambda: ThicknessModes("v", 3, axis=0.25), "the axis is of type float; give a ReferenceAxis"),
])  # fmt: skip
def test_shapes_that_cannot_be_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()
    with pytest.raises(InputError, match="no point but those at the edges is selected"):
        section().parametrization([CurvePoints("v", InBox(low=(1.699, None, None)))])
