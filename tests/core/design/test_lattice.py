"""Lattices move what they embed, exactly and alone, together with their children and with axes."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from mover_cases import rotation
from parametrization_cases import assert_exact, surface_of, wing_model
from scipy.sparse import csr_array
from scipy.stats import binom

from bspline_mdao import InputError
from bspline_mdao.core.design.embedding import Embedding, fixed_points
from bspline_mdao.core.design.variable import Layout, MapPartials
from bspline_mdao.core.mesh.control_net import surface_quads
from bspline_mdao.core.splines.greville import greville_abscissae
from bspline_mdao.core.splines.knots import ConstantKnots
from bspline_mdao.core.splines.volume import Volume, evaluate
from bspline_mdao.design import FreeForm, InBox, Lattice, Local, OnPatch, OnSideOfPlane, Parametrization, UserVariable
from bspline_mdao.movers import moving_mesh

SHAPES = [((4, 2, 3), None), ((6, 3, 5), (4, 2, 3)), ((5, 4, 6), (5, 4, 6))]
"""Numbers of points and orders: the default, B-splines, Bezier."""

every_shape = pytest.mark.parametrize(("n", "orders"), SHAPES)


@cache
def wing():
    return moving_mesh(wing_model())


def bent_lattice(n=(5, 3, 4), orders=None, **options):
    """A lattice around the wing that is no box."""
    box = Lattice.box(wing(), n, orders, margin=0.4)
    x = box.control_points
    bend = np.stack([0.1 * np.sin(x[..., 2]), 0.05 * np.cos(3.0 * x[..., 0]), 0.1 * x[..., 0] * x[..., 1]], axis=-1)
    return Lattice(x + bend, orders, **options)


def parent_lattice():
    """A lattice around the wing and the lattice of its tip."""
    return Lattice.box(wing(), n=(4, 2, 4), margin=0.2)


def tip_lattice(**options):
    """A lattice around the outer part of the wing, which the surface enters through one side."""
    return Lattice.box(np.array([[0.25, -0.09, 0.55], [1.45, 0.09, 1.5]]), n=(4, 3, 5), margin=0.0, **options)


@dataclass(frozen=True)
class Axis:
    """Some auxiliary points."""

    points: np.ndarray


@dataclass(frozen=True, eq=False)
class Bending:
    """A nonlinear map of all rows, which depends on an axis as well."""

    layout: Layout
    axis: Axis
    initial = np.zeros(2)

    def apply(self, points, values):
        x, y, z = (points - points[self.layout.rows(self.axis)][0]).T
        return points + np.stack([values[0] * z**2, values[1] * x * z + values[0] ** 2 * y, 0.0 * x], axis=1)

    def partials(self, points, values):
        d_points_columns = [
            self.apply(points + step, values) for step in 1e-30j * np.eye(points.size).reshape(-1, *points.shape)
        ]
        d_values_columns = [self.apply(points, values + step) for step in 1e-30j * np.eye(2)]
        return MapPartials(*(full(np.stack(moved).imag / 1e-30) for moved in (d_points_columns, d_values_columns)))


def full(derivatives):
    """Sparse matrix with an entry everywhere, of derivatives of shape (n, n_rows, 3)."""
    matrix = derivatives.reshape(len(derivatives), -1).T
    n, m = matrix.shape
    return csr_array((matrix.ravel(), np.tile(np.arange(m), n), m * np.arange(n + 1)), shape=(n, m))


def place(lattice, points):
    """Points of the lattice's volume at coordinates."""
    return evaluate(lattice.volume, lattice.control_points, points)


# Lattices


@every_shape
def test_a_box_is_the_volume_of_proportional_coordinates(n, orders):
    random = np.random.default_rng(1)
    box = Lattice.box(random.normal(size=(20, 3)), n, orders, margin=0.1, axes=random.normal(size=(3, 3)))
    xi = random.random((50, 3))
    found, is_inside = box.locate(place(box, xi))
    assert is_inside.all()
    np.testing.assert_allclose(found, xi, atol=1e-13)


def test_a_box_surrounds_what_it_is_made_for():
    axes = np.array([[1.0, 0.0, 0.5], [0.0, 3.0, 0.0], [0.5, 0.0, 1.0]])
    for box in (Lattice.box(wing(), margin=0.0), Lattice.box(wing(), margin=0.0, axes=axes)):
        xi, is_inside = box.locate(surface_of(wing()))
        assert is_inside.all()
        np.testing.assert_allclose([xi.min(axis=0), xi.max(axis=0)], [np.zeros(3), np.ones(3)], atol=1e-12)


@every_shape
def test_coordinates_in_a_bent_lattice_give_the_points_back(n, orders):
    lattice = bent_lattice(n, orders)
    xi, is_inside = lattice.locate(surface_of(wing()))
    assert is_inside.all()
    np.testing.assert_allclose(place(lattice, xi), surface_of(wing()), atol=1e-9)


@every_shape
def test_a_hexahedron_is_the_volume_of_trilinear_coordinates(n, orders):
    random = np.random.default_rng(4)
    corners = np.moveaxis(np.indices((2, 2, 2)), 0, -1) + random.uniform(-0.2, 0.2, (2, 2, 2, 3))
    lattice, (x, y, z) = Lattice.hexahedron(corners, n, orders), random.random((3, 40))
    ends = [np.stack([1.0 - s, s]) for s in (x, y, z)]
    points = np.einsum("aq,bq,cq,abcd->qd", *ends, corners)
    np.testing.assert_allclose(place(lattice, np.stack([x, y, z], axis=1)), points, atol=1e-14)
    np.testing.assert_allclose(lattice.locate(points)[0], np.stack([x, y, z], axis=1), atol=1e-9)


def test_a_swept_lattice_follows_the_wing_and_holds_it_all():
    box, swept = Lattice.box(wing(), margin=0.0), Lattice.swept(wing(), n=(4, 3, 5), margin=0.0)
    assert swept.locate(surface_of(wing()))[1].all()
    leading, trailing = swept.control_points[0, 0], swept.control_points[-1, 0]
    slopes = [(edge[-1, 0] - edge[0, 0]) / (edge[-1, 2] - edge[0, 2]) for edge in (leading, trailing)]
    np.testing.assert_allclose(slopes, np.tan(np.deg2rad([30.0, 15.8])), atol=0.03)  # those of the ONERA M6
    corners = swept.control_points[::3, ::2, ::4]
    chords, heights = corners[1, ..., 0] - corners[0, ..., 0], corners[:, 1, :, 1] - corners[:, 0, :, 1]
    assert chords.mean() * heights.mean() * np.ptp(corners[..., 2]) < 0.65 * np.ptp(box.points, axis=0).prod()
    assert np.all(Lattice.swept(wing(), margin=0.1).locate(swept.points)[1])


def test_default_orders_are_cubic_or_bezier():
    assert Lattice.box(wing(), n=(6, 2, 3)).orders == (4, 2, 3)


def test_knots_need_not_be_even_and_are_those_of_the_points():
    knots = [ConstantKnots([0.0] * 3 + [0.2] + [1.0] * 3, 3), *(ConstantKnots.uniform(n, 2) for n in (2, 3))]
    parameters = greville_abscissae(Volume.of(*knots))
    lattice = Lattice(parameters * [1.5, 0.2, 2.0], knots=knots)
    xi = np.random.default_rng(6).random((30, 3))
    np.testing.assert_allclose(lattice.locate(xi * [1.5, 0.2, 2.0])[0], xi, atol=1e-13)
    assert lattice.orders == (3, 2, 2)
    with pytest.raises(InputError, match=r"knots of \(4, 2, 3\) points, for \(4, 2, 3\); give theirs, and no orders"):
        Lattice(lattice.control_points, orders=2, knots=knots)


# What a lattice moves


@every_shape
@pytest.mark.parametrize("make", [lambda n, p: Lattice.box(wing(), n, p), bent_lattice], ids=["box", "bent"])
def test_weights_are_a_partition_of_unity(make, n, orders):
    weights = Embedding.of(make(n, orders), Layout(wing())).weights
    np.testing.assert_allclose(weights.sum(axis=1), 1.0, atol=1e-13)
    assert weights.min() >= 0.0


@pytest.mark.slow
@every_shape
@pytest.mark.parametrize(
    ("make", "tolerance"),
    [(lambda n, p: Lattice.box(wing(), n, p), 1e-13), (bent_lattice, 1e-8)],  # a bent one finds points up to 1e-9
    ids=["box", "bent"],
)
def test_an_affine_motion_of_the_lattice_is_one_of_the_surface(make, tolerance, n, orders):
    lattice = make(n, orders)
    matrix, shift = np.eye(3) + 0.3 * rotation(), np.array([0.1, -0.2, 0.3])
    displacement = lattice.points @ matrix.T + shift - lattice.points
    variable = FreeForm("shape", lattice)
    layout = Layout(wing(), variable.auxiliary)
    values = displacement[variable.point_ids(layout)].ravel()
    moved = variable.bind(layout).apply(layout.points, values)[layout.rows()]
    np.testing.assert_allclose(moved, surface_of(wing()) @ matrix.T + shift, atol=tolerance)


def test_orders_equal_to_the_number_of_points_make_bernstein_polynomials():
    lattice = Lattice.box(wing(), n=(4, 3, 5), orders=(4, 3, 5))
    xi, _ = lattice.locate(surface_of(wing()))
    one = [np.stack([binom.pmf(i, n - 1, xi[:, d]) for i in range(n)]) for d, n in enumerate((4, 3, 5))]
    expected = np.einsum("iq,jq,kq->qijk", *one).reshape(len(xi), -1)
    np.testing.assert_allclose(Embedding.of(lattice, Layout(wing())).weights.toarray(), expected, atol=1e-14)


def test_derivatives_are_exact_and_linear_in_the_values():
    for lattice in (Lattice.box(wing(), n=(4, 2, 3)), bent_lattice(orders=(3, 3, 2)), tip_lattice()):
        variable = FreeForm("shape", lattice, direction="zx")
        assert_exact(Layout(wing(), variable.auxiliary), variable)


def test_points_outside_stay():
    lattice = tip_lattice()
    parametrization = Parametrization(wing(), [FreeForm("tip", lattice)])
    values = np.random.default_rng(3).normal(size=parametrization.initial["tip"].shape)
    is_moved = (parametrization.apply(surface_of(wing()), {"tip": values}) != surface_of(wing())).any(axis=1)
    _, is_inside = lattice.locate(surface_of(wing()))
    assert 0 < is_moved.sum() < len(is_moved)
    assert not is_moved[~is_inside].any()


def test_where_and_direction_choose_values():
    lattice = Lattice.box(wing(), n=(4, 2, 3))
    variable = FreeForm("shape", lattice, where=np.s_[1:, :, 2], direction="y")
    layout = Layout(wing(), variable.auxiliary)
    numbers = np.arange(24).reshape(4, 2, 3)[1:, :, 2].ravel()
    np.testing.assert_array_equal(variable.point_ids(layout), numbers)
    moved = variable.bind(layout).apply(layout.points, np.arange(1.0, 7.0))[layout.rows(lattice)] - lattice.points
    expected = np.zeros((24, 3))
    expected[numbers, 1] = np.arange(1.0, 7.0)
    np.testing.assert_allclose(moved, expected, atol=1e-15)


def test_lattice_points_that_move_nothing_are_left_out():
    wide = Lattice.box(np.array([[-0.1, -4.0, -0.1], [1.6, 4.0, 1.6]]), n=(4, 9, 4), orders=(4, 3, 4), margin=0.0)
    variable = FreeForm("shape", wide, direction="y")
    layout = Layout(wing(), variable.auxiliary)
    left = np.unique(np.unravel_index(variable.point_ids(layout), (4, 9, 4))[1])
    np.testing.assert_array_equal(left, [3, 4, 5])
    assert Parametrization(wing(), [variable]).initial["shape"].size == 48


def test_only_the_asked_selection_moves():
    upper = OnPatch(wing_model(), "wing_upper") & OnSideOfPlane((0, 0, 0.2), (0, 0, 1))
    variable = FreeForm("shape", Lattice.box(wing(), n=(3, 2, 3), moves=upper), direction="y")
    layout = Layout(wing(), variable.auxiliary)
    moved = variable.bind(layout).apply(layout.points, np.full(18, 0.1)) - layout.points
    np.testing.assert_allclose(moved[layout.rows(), 1], np.where(upper.mask(wing()), 0.1, 0.0), atol=1e-15)


# Continuity


@pytest.mark.parametrize("continuity", [-1, 0, 1, 2])
def test_fixed_layers_are_those_at_the_side_that_the_surface_passes(continuity):
    fixed = fixed_points(tip_lattice(continuity=continuity), Layout(wing())).reshape(4, 3, 5)
    expected = np.zeros((4, 3, 5), dtype=bool)
    expected[:, :, : continuity + 1] = True
    np.testing.assert_array_equal(fixed, expected)


def test_a_lattice_around_everything_holds_nothing():
    for lattice in (Lattice.box(wing()), bent_lattice()):
        assert not fixed_points(lattice, Layout(wing(), (lattice,))).any()


@pytest.mark.parametrize("continuity", [0, 1, 2])
def test_the_displacement_ends_with_the_continuity_asked_for(continuity):
    lattice = tip_lattice(continuity=continuity, orders=(4, 3, 5))
    variable = FreeForm("tip", lattice, direction="y")
    layout = Layout(wing(), variable.auxiliary)
    values = np.random.default_rng(2).random(variable.bind(layout).initial.shape)
    displacement = np.zeros(60)
    displacement[variable.point_ids(layout)] = values
    heights = np.array([1e-2, 1e-3])
    xi = np.stack([np.full(2, 0.3), np.full(2, 0.6), heights], axis=1)
    near = evaluate(lattice.volume, displacement.reshape(4, 3, 5, 1), xi)[:, 0]
    rate = np.log10(near[0] / near[1])
    assert rate == pytest.approx(continuity + 1, abs=0.1)


# Children


def test_a_parent_carries_its_child_and_what_is_in_both_moves_once():
    parent = parent_lattice()
    child = tip_lattice(parent=parent)
    variables = FreeForm("wing", parent), FreeForm("tip", child)
    layout = Layout(wing(), child.auxiliary)
    matrix = np.eye(3) + 0.2 * rotation()
    displacement = parent.points @ matrix.T - parent.points
    moved = variables[0].bind(layout).apply(layout.points, displacement.ravel())
    np.testing.assert_allclose(moved, layout.points @ matrix.T, atol=1e-13)


def test_a_lattice_carries_the_children_of_its_children():
    first = parent_lattice()
    second = tip_lattice(parent=first)
    third = Lattice.box(second.points, n=(2, 2, 3), margin=-0.2, parent=second)
    layout = Layout(wing(), third.auxiliary)
    design_map = FreeForm("wing", first).bind(layout)
    moved = design_map.apply(layout.points, np.tile([0.1, -0.2, 0.3], first.points.shape[0]))
    np.testing.assert_allclose(moved - layout.points, np.tile([0.1, -0.2, 0.3], (len(moved), 1)), atol=1e-14)


def test_a_child_moves_only_itself_and_what_is_inside():
    parent = parent_lattice()
    child = tip_lattice(parent=parent)
    layout = Layout(wing(), child.auxiliary)
    design_map = FreeForm("tip", child).bind(layout)
    moved = design_map.apply(layout.points, np.full_like(design_map.initial, 0.1)) != layout.points
    assert not moved[layout.rows(parent)].any()
    assert moved[layout.rows(child)].any()
    assert not moved[layout.rows()][~child.locate(surface_of(wing()))[1]].any()


def test_lattices_that_are_no_children_stay():
    parent, other = parent_lattice(), tip_lattice()
    layout = Layout(wing(), (parent, other))
    design_map = FreeForm("wing", parent).bind(layout)
    moved = design_map.apply(layout.points, np.full_like(design_map.initial, 0.1))
    np.testing.assert_array_equal(moved[layout.rows(other)], other.points)


def test_axes_inside_go_along():
    lattice, axis = (
        Lattice.box(wing(), n=(4, 2, 4)),
        Axis(np.array([[0.3, 0.0, 0.1], [0.7, 0.0, 1.2], [9.0, 0.0, 9.0]])),
    )
    layout = Layout(wing(), (axis, lattice))
    design_map = FreeForm("wing", lattice).bind(layout)
    moved = design_map.apply(layout.points, np.full_like(design_map.initial, 0.1))
    np.testing.assert_allclose(moved[layout.rows(axis)] - axis.points, [[0.1] * 3, [0.1] * 3, [0.0] * 3], atol=1e-14)


# Leading


@pytest.mark.parametrize("make", [tip_lattice, bent_lattice, lambda: Lattice.box(wing(), n=(4, 2, 3))])
def test_derivatives_of_a_led_map_are_exact(make):
    lattice, axis = make(), Axis(np.array([[0.5, 0.01, 0.8]]))

    class OnLattice:
        def bind(self, layout):
            return lattice.extend(layout, Bending(layout, axis))

    assert_exact(Layout(wing(), (axis, lattice)), OnLattice())


def test_a_led_affine_map_is_the_map_itself():
    lattice, turn = Lattice.box(wing(), n=(4, 2, 3)), rotation()

    class Affine:
        initial = np.zeros(1)

        def apply(self, points, values):
            return points + values[0] * (points @ turn.T)

    layout = Layout(wing(), (lattice,))
    extended, values = lattice.extend(layout, Affine()), np.array([0.3])
    np.testing.assert_allclose(extended.apply(layout.points, values), Affine().apply(layout.points, values), atol=1e-13)


def test_an_extended_map_leaves_fixed_layers_alone():
    lattice = tip_lattice()
    layout = Layout(wing(), (lattice, Axis(np.zeros((1, 3)))))
    extended = lattice.extend(layout, Bending(layout, layout.auxiliary[1]))
    moved = (extended.apply(layout.points, np.array([0.1, 0.2])) != layout.points).any(axis=1)[layout.rows(lattice)]
    np.testing.assert_array_equal(moved.reshape(4, 3, 5), ~fixed_points(lattice, layout).reshape(4, 3, 5))


# Together


def composition():
    """Local, parent, child and user-defined variables."""
    parent = parent_lattice()
    user = UserVariable(
        "swell",
        [0.0],
        lambda x, v: x * (1.0 + v[0]) ** 2,
        lambda x, v: (np.tile((1.0 + v[0]) ** 2 * np.eye(3), (len(x), 1, 1)), 2.0 * (1.0 + v[0]) * x[:, :, None]),
    )
    return Parametrization(
        wing(),
        [
            Local("bumps", InBox(high=(None, None, 0.8)), "normal"),
            FreeForm("wing", parent, direction="xy"),
            user,
            FreeForm("tip", tip_lattice(parent=parent), direction="y"),
        ],
    )


def test_derivatives_of_a_composition_are_exact_forward_and_reverse():
    parametrization, random = composition(), np.random.default_rng(6)
    surface = surface_of(wing()) + 0.01 * random.normal(size=(len(wing().surface_ids), 3))
    values = {name: v + 0.05 * random.normal(size=v.shape) for name, v in parametrization.initial.items()}
    steps = {name: random.normal(size=v.shape) for name, v in values.items()}
    d_surface, bar = random.normal(size=surface.shape), random.normal(size=surface.size)
    partials = parametrization.partials(surface, values)
    stepped = {name: v + 1e-30j * steps[name] for name, v in values.items()}
    exact = parametrization.apply(surface + 1e-30j * d_surface, stepped).imag.ravel() / 1e-30
    forward = partials.initial @ d_surface.ravel() + sum(partials.values[name] @ steps[name] for name in values)
    np.testing.assert_allclose(forward, exact, rtol=1e-10, atol=1e-12)
    reverse = (partials.initial.T @ bar) @ d_surface.ravel()
    reverse += sum((partials.values[name].T @ bar) @ steps[name] for name in values)
    assert reverse == pytest.approx(bar @ exact, rel=1e-12)


def test_nothing_moves_at_the_initial_values():
    moved = composition().apply(surface_of(wing()), composition().initial)
    np.testing.assert_array_equal(moved, surface_of(wing()))


def test_the_root_stays_in_its_plane_whatever_the_lattice_does():
    parametrization = Parametrization(wing(), [FreeForm("wing", Lattice.box(wing(), n=(3, 2, 3)))])
    values = np.random.default_rng(4).normal(size=parametrization.initial["wing"].shape)
    moved = parametrization.apply(surface_of(wing()), {"wing": values}) - surface_of(wing())
    assert np.abs(moved[wing().in_plane_rows, 2]).max() == 0.0
    assert np.abs(moved[wing().in_plane_rows, :2]).min() > 0.0


# Refusals


def test_quads_of_the_surface_are_part_of_it():
    assert np.unique(surface_quads(wing())).size == len(wing().surface_ids)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Lattice(np.zeros((2, 2, 1, 3))), r"points of shape \(2, 2, 1, 3\)"),
        (lambda: Lattice(np.full((2, 2, 2, 3), np.nan)), r"point \(1, 1, 1\) is not finite"),
        (lambda: Lattice.box(wing(), n=(3, 3, 3), orders=4), "control points"),
        (lambda: Lattice.box(wing(), n=(3, 3, 3), orders=1), "give 2 .linear. at least"),
        (lambda: Lattice.box(wing(), n=(3, 3)), "give numbers for three directions"),
        (lambda: Lattice.box(wing(), orders=(3, 3)), "give numbers for three directions"),
        (lambda: Lattice.box(np.array([[0.0, 0, 0], [1, 0, 1]])), "no extent along axis 2"),
        (lambda: Lattice.box(wing(), axes=np.ones((3, 3))), "lie in one plane"),
        (lambda: bent_lattice(parent=tip_lattice()), r"points lie outside the parent, the first is point \(1, 1, 1\)"),
    ],
)
def test_what_is_no_lattice_is_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


@pytest.mark.parametrize(
    ("lattice", "options", "words"),
    [
        (lambda: Lattice.box(np.array([[5.0, 5, 5], [6, 6, 6]])), {}, "no surface control point is inside"),
        (
            lambda: tip_lattice(moves=InBox(high=(None, None, 0.6))),
            {},
            r"of the \d+ points it is to move lie outside",
        ),
        (lambda: tip_lattice(continuity=4), {}, "60 are fixed for continuity"),
        (tip_lattice, {"where": np.s_[:, :, 9]}, "'shape': where: index 9"),
        (tip_lattice, {"direction": np.ones((7, 3))}, "'shape': directions of shape"),
        (tip_lattice, {"direction": "normal"}, "no direction is called 'normal'"),
    ],
)
def test_what_moves_nothing_is_refused(lattice, options, words):
    variable = FreeForm("shape", lattice(), **options)
    with pytest.raises(InputError, match=words):
        variable.bind(Layout(wing(), variable.auxiliary))
