"""Selections, normals, local and user-defined variables do what they say, with exact derivatives."""

from functools import cache

import numpy as np
import pytest
from mover_cases import channel, mesh_of, oblique_channel, plate, rotation
from parametrization_cases import assert_exact, surface_of, wing_model
from scipy.sparse import csr_array
from topology_cases import box, grid_of, patch

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.design.variable import Layout
from bspline_mdao.core.mesh.control_net import surface_normals, surface_quads
from bspline_mdao.design import (
    InBlock,
    InBox,
    Local,
    Nearest,
    NearPlane,
    OnPatch,
    OnSideOfPlane,
    Parametrization,
    SurfaceRows,
    UserVariable,
)
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.movers import moving_mesh
from bspline_mdao.testing import check_variable


@cache
def wing():
    return moving_mesh(wing_model())


@cache
def random_part():
    """A selection of a third of the wing's points, in no order."""
    n = len(wing().surface_ids)
    return SurfaceRows(np.random.default_rng(5).permutation(n)[: n // 3])


# Selections


def test_selections_obey_boolean_algebra():
    a, b = InBox(low=(0.3, None, None)), OnSideOfPlane((0.0, 0.0, 0.4), (0.0, 0.2, 1.0))
    m, n = a.mask(wing()), b.mask(wing())
    assert 0 < np.count_nonzero(m & n) < np.count_nonzero(m | n) < m.size
    np.testing.assert_array_equal((a & b).mask(wing()), m & n)
    np.testing.assert_array_equal((a | b).mask(wing()), m | n)
    np.testing.assert_array_equal((~a & ~b).mask(wing()), ~(m | n))
    np.testing.assert_array_equal((a & ~b | b).rows(wing()), np.flatnonzero(m | n))


def test_patches_are_selected_by_name_and_by_pattern():
    upper, lower = (OnPatch(wing_model(), f"wing_{side}") for side in ("upper", "lower"))
    y = surface_of(wing())[:, 1]
    assert OnPatch(wing_model(), "wing*").mask(wing()).all()
    assert OnPatch(wing_model(), ["wing_lower", "*upper"]).mask(wing()).all()
    assert (y[upper.rows(wing())] >= -1e-3).all()  # control points overshoot
    assert (y[lower.rows(wing())] <= 1e-3).all()
    assert np.abs(y[(upper & lower).rows(wing())]).max() < 1e-9  # edges


@pytest.mark.slow
def test_a_patch_of_another_model_is_refused():
    other = fit_grid(onera_m6_grid((9, 9, 7)), n_control=(5, 5, 4))
    with pytest.raises(InputError, match="give OnPatch the model of the mesh"):
        OnPatch(other, "wing*").rows(wing())
    with pytest.raises(InputError, match="no patch is called 'tail'"):
        OnPatch(wing_model(), "tail").rows(wing())


def test_a_box_includes_its_sides_and_may_be_open():
    x = surface_of(wing())
    side = x[7]
    assert InBox(low=side, high=side).mask(wing())[7]
    np.testing.assert_array_equal(InBox(high=(None, None, 0.5)).mask(wing()), x[:, 2] <= 0.5)
    with pytest.raises(InputError, match="low end above its high end"):
        InBox(low=(1.0, 0.0, 0.0), high=(0.0, 1.0, 1.0))


def test_blocks_are_indexed_as_arrays():
    mesh = channel()
    ids = mesh.blocks[1][1:3, :2, 0]
    rows = InBlock(1, np.s_[1:3, :2, 0]).rows(mesh)
    np.testing.assert_array_equal(mesh.surface_ids[rows], np.unique(ids[np.isin(ids, mesh.surface_ids)]))
    with pytest.raises(InputError, match=r"in block 2 at \[7, 0, 0\]"):
        InBlock(1, (7, 0, 0)).rows(mesh)
    with pytest.raises(InputError, match="no block has the number 2; give one from 0 to 1"):
        InBlock(2).rows(mesh)


@pytest.mark.slow
def test_nearest_points_are_as_many_as_asked_and_those_that_coincide():
    x, place = surface_of(wing()), np.array([0.6, 0.02, 0.7])
    by_distance = np.argsort(np.linalg.norm(x - place, axis=1))
    np.testing.assert_array_equal(Nearest(place, 4).rows(wing()), np.sort(by_distance[:4]))
    x = surface_of(plate())
    middle = np.argmin(np.linalg.norm(x - [0.5, 0.0, 1.0], axis=1))
    both = Nearest(x[middle]).rows(plate())
    assert len(both) == 2
    np.testing.assert_allclose(x[both[0]], x[both[1]], atol=1e-12)


def test_planes_select_a_side_or_a_neighbourhood():
    point, normal = np.array([0.4, 0.0, 0.6]), np.array([1.0, 0.3, -2.0])
    heights = (surface_of(wing()) - point) @ normal / np.linalg.norm(normal)
    np.testing.assert_array_equal(OnSideOfPlane(point, normal).mask(wing()), heights >= 0.0)
    np.testing.assert_array_equal(NearPlane(point, normal, 0.2).mask(wing()), np.abs(heights) <= 0.2)
    np.testing.assert_array_equal(NearPlane((0, 0, 0), (0, 0, 1)).rows(wing()), np.unique(wing().in_plane_rows))


@pytest.mark.parametrize(
    ("selection", "words"),
    [
        (InBox(low=(50.0, None, None)), r"in the box from \(50.0, None, None\)"),
        (Nearest((0.0, 0.0, 0.0)) & InBox(low=(0.5, None, None)), "nearest to .* and in the box"),
        (
            ~(OnSideOfPlane((0, 0, 0), (0, 0, 1)) | NearPlane((0, 0, 0), (1, 0, 0))),
            "not .*on the side .* or within 0 m",
        ),
        (SurfaceRows([]), "one of 0 given rows"),
    ],
)
def test_an_empty_selection_says_what_was_asked(selection, words):
    with pytest.raises(InputError, match=words):
        selection.rows(wing())


@pytest.mark.parametrize("rows", [[-1], [400], [0.5]])
def test_rows_that_do_not_exist_are_refused(rows):
    with pytest.raises(InputError, match="whole numbers from 0 to"):
        SurfaceRows(rows).rows(wing())


# Normals


def test_the_net_of_a_wing_is_closed_but_for_its_root():
    quads = surface_quads(wing())
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    edges = edges[edges[:, 0] != edges[:, 1]]
    found, counts = np.unique(edges, axis=0, return_counts=True)
    is_in_plane = np.isin(found, wing().in_plane_rows).all(axis=1)
    assert (counts[~is_in_plane] == 2).all()
    assert (counts[is_in_plane] == 1).all()


def test_normals_of_a_wing_point_into_the_fluid():
    mesh, x = wing(), surface_of(wing())
    normals = surface_normals(mesh)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-14)
    upper, lower = (OnPatch(wing_model(), f"wing_{side}").mask(mesh) for side in ("upper", "lower"))
    assert (normals[upper & ~lower, 1] > 0.0).all()
    assert (normals[lower & ~upper, 1] < 0.0).all()
    root = mesh.in_plane_rows
    assert np.abs(normals[root, 2]).max() < 1e-14
    assert normals[root[np.argmin(x[root, 0])], 0] < -0.99
    assert normals[root[np.argmax(x[root, 0])], 0] > 0.99


def test_normals_turn_with_the_surface_whatever_the_handedness_of_blocks():
    flat, turned = surface_normals(channel()), surface_normals(oblique_channel())
    np.testing.assert_allclose(flat, np.tile([0.0, 0.0, 1.0], (len(flat), 1)), atol=1e-14)
    np.testing.assert_allclose(turned, flat @ rotation().T, atol=1e-12)


def test_the_normal_on_a_ridge_halves_its_angle_however_the_sides_are_cut():
    nodes = box(np.array([0.0, 0.6, 1.0, 1.1, 1.7]), np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 4))
    x = nodes[..., 0] - 1.0
    nodes[..., 1] += 0.9 * np.maximum(x, 0.0)  # quads oblique on one side
    nodes[..., 2] += 0.5 * np.minimum(x, 0.0) - 2.0 * np.maximum(x, 0.0)
    mesh = mesh_of(grid_of(nodes, patches=[patch("wall", Window(0, (0, 0, 0), (4, 4, 0)))]))
    is_ridge = np.isclose(surface_of(mesh)[:, 0], 1.0) & (np.abs(surface_of(mesh)[:, 1] - 0.5) < 0.4)
    sides = np.array([[-0.5, 0.0, 1.0], [2.0, 0.0, 1.0]]) / np.sqrt([[1.25], [5.0]])
    between = sides.sum(axis=0) / np.linalg.norm(sides.sum(axis=0))
    np.testing.assert_allclose(surface_normals(mesh)[is_ridge], np.tile(between, (3, 1)), atol=1e-14)


@pytest.mark.slow
def test_normals_of_a_plate_without_thickness_stick_out_of_its_edges():
    x, normals = surface_of(plate()), surface_normals(plate())
    low, high = x.min(axis=0), x.max(axis=0)
    is_front, is_back, is_tip = x[:, 0] < low[0] + 1e-9, x[:, 0] > high[0] - 1e-9, x[:, 2] > high[2] - 1e-9
    np.testing.assert_allclose(normals[is_front & ~is_tip][:, 0], -1.0, atol=1e-9)
    np.testing.assert_allclose(normals[is_back & ~is_tip][:, 0], 1.0, atol=1e-9)
    np.testing.assert_allclose(normals[is_tip & ~is_front & ~is_back][:, 2], 1.0, atol=1e-9)
    np.testing.assert_allclose(np.abs(normals[~is_tip & ~is_front & ~is_back][:, 1]), 1.0, atol=1e-9)


# Local variables


def test_local_values_displace_the_selected_points_and_no_others():
    mesh = wing()
    rows = random_part().rows(mesh)
    parametrization = Parametrization(
        mesh, [Local("free", random_part() & OnSideOfPlane((0, 0, 0.1), (0, 0, 1)), "zx")]
    )
    rows = rows[surface_of(mesh)[rows, 2] >= 0.1]
    values = np.random.default_rng(2).normal(size=2 * len(rows))
    moved = parametrization.apply(surface_of(mesh), {"free": values}) - surface_of(mesh)
    expected = np.zeros_like(moved)
    expected[rows, 2], expected[rows, 0] = values[::2], values[1::2]
    np.testing.assert_allclose(moved, expected, atol=1e-15)


@pytest.mark.parametrize("direction", ["x", "xyz", "normal", (1.0, -2.0, 0.5), "field", "two fields"])
def test_local_derivatives_are_exact_in_every_direction(direction):
    n = len(random_part().rows(wing()))
    fields = np.random.default_rng(8).normal(size=(n, 3, 2))
    direction = {"field": fields[..., 0], "two fields": fields}.get(direction, direction)
    assert_exact(Layout(wing()), Local("free", random_part(), direction))


def test_a_displacement_along_the_normal_stays_in_the_symmetry_plane():
    root = NearPlane((0, 0, 0), (0, 0, 1))
    parametrization = Parametrization(wing(), [Local("swell", root, "normal")])
    values = np.full_like(parametrization.initial["swell"], 0.01)
    moved = parametrization.apply(surface_of(wing()), {"swell": values}) - surface_of(wing())
    np.testing.assert_allclose(np.linalg.norm(moved[root.rows(wing())], axis=1), 0.01, rtol=1e-12)


@pytest.mark.parametrize(
    ("direction", "words"),
    [
        ("w", "no direction is called 'w'"),
        ("xx", "no direction is called 'xx'"),
        ("", "no direction is called"),
        (np.ones((4, 3)), "directions of shape"),
        ((0.0, 0.0, 0.0), "zero or not finite"),
        ((0.0, np.nan, 1.0), "zero or not finite"),
    ],
)
def test_directions_that_are_none_are_refused(direction, words):
    with pytest.raises(InputError, match=f"'free': .*{words}"):
        Local("free", random_part(), direction).bind(Layout(wing()))


# Variables of the user


def swell(points, values):
    """Scale about the origin, by another factor along y, and bend."""
    y = np.stack([0 * points[:, 0], points[:, 0] ** 2 * values[1] ** 3, 0 * points[:, 0]], axis=1)
    return points * (1.0 + values[0]) + y


def swell_blocks(points, values):
    d_points = np.tile((1.0 + values[0]) * np.eye(3), (len(points), 1, 1)).astype(float)
    d_points[:, 1, 0] = 2.0 * points[:, 0] * values[1] ** 3
    d_values = np.zeros((len(points), 3, 2))
    d_values[..., 0] = points
    d_values[:, 1, 1] = 3.0 * points[:, 0] ** 2 * values[1] ** 2
    return d_points, d_values


def swell_dense(points, values):
    blocks, d_values = swell_blocks(points, values)
    matrix = np.zeros((points.size, points.size))
    for n, block in enumerate(blocks):
        matrix[3 * n : 3 * n + 3, 3 * n : 3 * n + 3] = block
    return matrix, d_values.reshape(-1, 2)


def swell_sparse(points, values):
    """Sparse matrices that have all their entries, zeros included."""
    n = np.arange(len(points))
    rows = np.concatenate([np.arange(3 * len(n)), 3 * n + 1])
    columns = np.concatenate([np.arange(3 * len(n)), 3 * n])
    data = np.concatenate([np.full(3 * len(n), 1.0 + values[0]), 2.0 * points[:, 0] * values[1] ** 3])
    return csr_array((data, (rows, columns)), shape=(points.size, points.size)), swell_dense(points, values)[1]


@pytest.mark.parametrize("derivative", [swell_blocks, swell_dense, swell_sparse])
def test_user_derivatives_may_be_blocks_dense_or_sparse(derivative):
    assert_exact(Layout(wing()), UserVariable("swell", [0.0, 0.0], swell, derivative))


def test_the_check_passes_right_derivatives_and_names_wrong_ones():
    def wrong(points, values):
        d_points, d_values = swell_blocks(points, values)
        d_values[5] *= 1.001
        return d_points, d_values

    good = check_variable(UserVariable("swell", [0.0, 0.0], swell, swell_blocks), wing())
    assert good.is_good
    assert max(good.points_error, good.values_error) < 1e-9
    bad = check_variable(UserVariable("swell", [0.0, 0.0], swell, wrong), wing())
    assert not bad.is_good
    assert bad.points_error < 1e-9
    assert bad.values_place == wing().place_of_point(wing().surface_ids[5])


def test_the_check_serves_any_variable():
    assert check_variable(Local("free", random_part(), "normal"), wing()).is_good


def bad_user(function=swell, derivative=swell_blocks, initial=(0.0, 0.0)):
    return UserVariable("swell", initial, function, derivative)


@pytest.mark.parametrize(
    ("variable", "words"),
    [
        (bad_user(function=lambda x, v: x[:-1]), "points of shape"),
        (bad_user(function=lambda x, v: np.where(x == x[3, 0], np.nan, x)), r"moves point \(.*\) of block .* to"),
        (bad_user(derivative=lambda x, v: swell_blocks(x, v)[0]), "the derivative is no pair"),
        (bad_user(derivative=lambda x, v: (np.eye(3), swell_blocks(x, v)[1])), r"d_points .* has shape \(3, 3\)"),
        (bad_user(derivative=lambda x, v: (swell_blocks(x, v)[0], x)), "d_values .* has shape"),
        (bad_user(derivative=lambda x, v: (swell_blocks(x, v)[0] * np.inf, x)), "d_points .* not finite for point"),
        (bad_user(initial=(0.5, 0.0)), "the initial values move a point by"),
        (bad_user(initial=(np.nan, 0.0)), "finite numbers"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_wrong_user_functions_are_refused(variable, words):
    with pytest.raises(InputError, match=f"'swell': .*{words}"):
        variable.bind(Layout(wing())).partials(surface_of(wing()), np.zeros(2))


def test_entries_that_appear_later_are_refused():
    def appearing(points, values):
        d_points, d_values = swell_dense(points, values)
        return csr_array(d_points), d_values

    bound = UserVariable("swell", [0.0, 0.0], swell, appearing).bind(Layout(wing()))
    with pytest.raises(InputError, match="entries that it had not on the baseline"):
        bound.partials(surface_of(wing()), np.array([0.0, 0.3]))
