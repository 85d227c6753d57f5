"""A wing slides on a body that keeps its shape, and what is beside the junction goes along."""

from dataclasses import replace

import numpy as np
import pytest
from parametrization_cases import assert_exact
from scipy.spatial import cKDTree

from bspline_mdao.core.design.reference_axis import StationSpline
from bspline_mdao.core.design.variable import Layout
from bspline_mdao.core.mesh.moving_mesh import MovingMesh
from bspline_mdao.core.sliding.fixed_surface import Cylinder
from bspline_mdao.core.sliding.spline_surface import SplineSurface
from bspline_mdao.design import Junction, Local, Parametrization, RadiusFactor, SurfaceRows, Translation
from bspline_mdao.errors import InputError, MovementError

RADIUS, CHORD, HEIGHT = 1.0, 0.8, 0.12
"""Of a body that is a cylinder along x, and of the wing's section, an ellipse of half axes CHORD and HEIGHT."""

N_AROUND, N_OUT = 40, 12


def wing_on_cylinder():
    """Triangles of a wing that goes out along z from a cylinder, and of this around it: the wing's nodes last."""
    angle = 2.0 * np.pi * np.arange(N_AROUND) / N_AROUND
    part = np.linspace(0.0, 1.0, N_OUT)[:, None]
    # of the cylinder, unrolled: from the section to a circle around it
    along = (1.0 - part) * CHORD * np.cos(angle) + part * 1.6 * np.cos(angle)
    around = (1.0 - part) * HEIGHT * np.sin(angle) + part * 1.3 * np.sin(angle)
    body = np.stack([along, RADIUS * np.sin(around), RADIUS * np.cos(around)], axis=-1)
    reach = np.linspace(0.0, 2.0, 9)[1:, None, None]
    wing = body[0] + reach * [0.2, 0.0, 1.0]
    rings = [*np.arange(body.size // 3).reshape(N_OUT, -1)]
    outer = [rings[0], *(body.size // 3 + np.arange(wing.size // 3)).reshape(len(wing), -1)]
    cells = [band(a, b) for a, b in zip(rings[1:], rings)] + [band(a, b) for a, b in zip(outer, outer[1:])]
    return np.concatenate([body.reshape(-1, 3), wing.reshape(-1, 3)]), np.concatenate(cells), body.size // 3


def band(first, second):
    a, b, c, d = first, np.roll(first, -1), np.roll(second, -1), second
    return np.concatenate([np.stack([a, b, c, c], axis=1), np.stack([a, c, d, d], axis=1)])


@pytest.fixture(scope="module")
def case():
    points, cells, n_body = wing_on_cylinder()
    n, none = len(points), np.zeros(0, dtype=int)
    mesh = MovingMesh(
        blocks=(),
        names=(),
        points=points,
        surface_ids=np.arange(n, dtype=np.int32),
        is_free=np.zeros((n, 3), dtype=bool),
        in_plane_rows=none,
        in_plane_normals=np.zeros((0, 3)),
        surface_faces=cells,
        markers=(("walls", np.arange(n), np.arange(1, n + 1)),),
    )
    return mesh, n_body


def test_the_root_stays_on_the_body_and_what_is_beside_goes_along(case):
    mesh, n_body = case
    points, reach = mesh.points, 0.5
    sliding = Junction(np.arange(n_body), reach).bind(Layout(mesh))
    asked = points + [0.05, 0.1, 0.02] + 0.05 * points[:, [1]] * [0.0, 1.0, 0.0]
    moved = sliding.apply(asked, sliding.initial)
    off = np.hypot(moved[:n_body, 1], moved[:n_body, 2]) - RADIUS
    root = slice(0, N_AROUND)
    assert np.abs(np.hypot(*asked[root, 1:].T) - RADIUS).max() > 0.02
    assert np.abs(off).max() < 4e-4  # asked to leave it by 100 times as much; there is no node where the wing was
    assert np.abs(off[N_AROUND:]).max() < 5e-5
    tangent = moved[root] - asked[root]  # the root goes to the nearest place on the body
    normals = moved[root] * [0.0, 1.0, 1.0]
    assert np.linalg.norm(np.cross(tangent, normals), axis=1).max() < 1e-3
    distance = np.linalg.norm(points[:, None] - points[None, root], axis=2).min(axis=1)
    is_far, is_body = distance >= reach, np.arange(len(points)) < n_body
    np.testing.assert_array_equal(moved[is_far & is_body], points[is_far & is_body])
    np.testing.assert_array_equal(moved[is_far & ~is_body], asked[is_far & ~is_body])
    change = (moved - points)[N_AROUND : 2 * N_AROUND]  # the first ring of the body goes along
    assert np.linalg.norm(change - (moved - points)[root], axis=1).max() < 0.25 * np.linalg.norm(change, axis=1).max()


def asked_of(points):
    """A wing that slides by a chord's third, turns by 10 degrees about its axis, and rises by 10."""
    c, s = np.cos(np.radians(10.0)), np.sin(np.radians(10.0))
    turned = points @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]).T
    risen = turned @ np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]]).T
    return risen + [0.25, 0.0, 0.0]


CYLINDER = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), RADIUS)


def test_nodes_stay_on_a_surface_that_is_given_to_rounding(case):
    mesh, n_body = case
    sliding = Junction(np.arange(n_body), 0.9, CYLINDER).bind(Layout(mesh))
    moved = sliding.apply(asked_of(mesh.points), sliding.initial)
    np.testing.assert_allclose(np.hypot(*moved[:n_body, 1:].T), RADIUS, rtol=0.0, atol=1e-14)
    normals = np.cross(*(moved[mesh.surface_faces[:, k]] - moved[mesh.surface_faces[:, 0]] for k in (1, 2)))[:n_body]
    before = np.cross(*(mesh.points[mesh.surface_faces[:, k]] - mesh.points[mesh.surface_faces[:, 0]] for k in (1, 2)))
    is_body = (mesh.surface_faces < n_body).all(axis=1)[:n_body]
    assert ((normals * before[:n_body]).sum(axis=1)[is_body] > 0.0).all()  # no triangle of the body turns over


def test_nodes_keep_their_heights_on_the_surface_through_those_of_the_body(case):
    mesh, n_body = case
    sliding = Junction(np.arange(n_body), 0.9).bind(Layout(mesh))
    moved = sliding.apply(asked_of(mesh.points), sliding.initial)
    assert np.abs(moved - mesh.points)[:n_body].max() > 0.2
    for nodes in (sliding.root, sliding.collar):
        (group,) = nodes.groups
        found = group.surfaces[0].levels(moved[nodes.rows]).values
        np.testing.assert_allclose(found, group.heights[0], rtol=0.0, atol=1e-14)
    assert np.abs(np.hypot(*moved[:n_body, 1:].T) - RADIUS).max() < 2e-3


def body_and_wing(mesh, n_body):
    """A wing that slides, and a body that bulges, at once."""
    radius = RadiusFactor("radius", [(-2.0, 0.0, 0.0), (2.0, 0.0, 0.0)], stations=5)
    junction = Junction(np.arange(n_body), 0.9, CYLINDER, shape=["radius"])
    return Parametrization(mesh, [radius, Translation("position", "xy")], junction=junction)


def test_a_wing_slides_on_a_body_whose_shape_changes_at_once(case):
    mesh, n_body = case
    shape = body_and_wing(mesh, n_body)
    values = {"radius": np.array([1.0, 1.1, 1.3, 0.9, 1.0]), "position": np.array([0.25, 0.06])}
    moved = shape.apply(mesh.points, values)
    x, distance = moved[:n_body, 0], np.hypot(*moved[:n_body, 1:].T)
    factors = StationSpline.of(5).basis((x + 2.0) / 4.0) @ values["radius"]
    np.testing.assert_allclose(distance, factors * RADIUS, rtol=0.0, atol=1e-14)
    assert np.ptp(distance) > 0.2
    is_far = np.linalg.norm(mesh.points[:, None] - mesh.points[None, :N_AROUND], axis=2).min(axis=1) >= 0.9
    is_far[:n_body] = False
    np.testing.assert_allclose(moved[is_far] - mesh.points[is_far], [[0.25, 0.06, 0.0]] * is_far.sum(), atol=1e-14)
    root = slice(n_body, n_body + N_AROUND)  # the wing's first ring goes along with the body below it
    step = 1e-6 * np.array([0.0, 0.0, 1.0, 0.0, 0.0])
    gone = shape.apply(mesh.points, {**values, "radius": values["radius"] + step}) - moved
    assert (gone[root, 2] > 0.5 * gone[:N_AROUND, 2].max()).any()


def test_derivatives_of_body_and_wing_at_once_are_exact(case):
    mesh, n_body = case
    shape = body_and_wing(mesh, n_body)
    random, values = np.random.default_rng(7), {"radius": np.array([1.0, 1.1, 1.3, 0.9, 1.1]), "position": [0.2, 0.05]}
    partials, pattern = shape.partials(mesh.points, values), shape.pattern
    for name, value in values.items():
        by = random.normal(size=len(value))
        moved = shape.apply(mesh.points, {**values, name: np.array(value) + 1e-30j * by})
        np.testing.assert_allclose(partials.values[name] @ by, moved.imag.ravel() / 1e-30, rtol=1e-11, atol=1e-12)
        outside = abs(partials.values[name]) > 1e-15
        assert (outside.astype(float) - outside.multiply(pattern.values[name] != 0.0)).sum() == 0
    by = random.normal(size=mesh.points.shape)
    moved = shape.apply(mesh.points + 1e-30j * by, values)
    np.testing.assert_allclose(partials.initial @ by.ravel(), moved.imag.ravel() / 1e-30, rtol=1e-11, atol=1e-11)


def test_a_variable_of_the_body_that_there_is_not_is_named(case):
    mesh, n_body = case
    junction = Junction(np.arange(n_body), 0.9, CYLINDER, shape=["bulge"])
    with pytest.raises(InputError, match="the junction names 'bulge' as a variable of the body's shape; there are pos"):
        Parametrization(mesh, [Translation("position", "x")], junction=junction)


def test_a_wing_that_leaves_the_smooth_part_of_the_body_is_named(case):
    mesh, n_body = case
    sliding = Junction(np.arange(n_body), 0.9).bind(Layout(mesh))
    with pytest.raises(MovementError, match=r"the point .* is beyond the nodes of the body that are smooth"):
        sliding.apply(mesh.points + [5.0, 0.0, 0.0], sliding.initial)


def test_nothing_moves_while_the_wing_rests(case):
    mesh, n_body = case
    sliding = Junction(np.arange(n_body), 0.5).bind(Layout(mesh))
    np.testing.assert_allclose(sliding.apply(mesh.points, sliding.initial), mesh.points, atol=1e-15)


def test_displacements_beside_a_junction_do_not_jump_where_other_nodes_of_it_are_nearest(case):
    points, reach = case[0].points[:N_AROUND], 3.0
    start, end = np.array([1.1, 0.03, 0.9]), np.array([-0.9, 0.5, 0.8])
    path = start + np.linspace(0.0, 1.0, 2001)[:, None] * (end - start)
    nearest, junction = cKDTree(points), Junction(np.arange(N_AROUND), reach)
    matrix = junction._fading(nearest, path)[::3, ::3].toarray()
    assert len(np.unique(nearest.query(path)[1])) > 10
    part = nearest.query(path)[0] / reach
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0 - part**3 * (10.0 - 15.0 * part + 6.0 * part**2), rtol=1e-13)
    assert np.abs(np.diff(matrix, axis=0)).max() < 0.02 < matrix.max() < 1.0
    angle = 2.0 * np.pi * np.arange(24) / 24.0
    ring = cKDTree(np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1))
    on_axis = Junction(np.arange(24), 2.0)._fading(ring, np.array([[0.0, 0.0, 0.0]]))[0, ::3].toarray()
    np.testing.assert_allclose(np.sort(on_axis)[-16:], 0.5 / 16.0, rtol=1e-12)


def test_a_node_of_another_grid_at_one_of_the_junction_goes_along_with_this_wholly(case):
    points = case[0].points[:N_AROUND]
    matrix = Junction(np.arange(N_AROUND), 0.9)._fading(cKDTree(points), points[[7, 30]])[::3, ::3].toarray()
    np.testing.assert_array_equal(matrix, np.eye(N_AROUND)[[7, 30]])


def test_what_is_within_the_rigid_distance_goes_along_wholly_and_fades_smoothly_from_there(case):
    mesh, n_body = case
    points, reach, rigid = mesh.points, 0.9, 0.3
    sliding = Junction(np.arange(n_body), reach, CYLINDER, rigid=rigid).bind(Layout(mesh))
    shift = np.array([0.2, 0.0, 0.15])
    moved = sliding.apply(points + shift, sliding.initial)
    slid = moved[:N_AROUND] - points[:N_AROUND] - shift  # what is left over at the root
    distance = np.linalg.norm(points[:, None] - points[None, :N_AROUND], axis=2).min(axis=1)
    is_wing = np.arange(len(points)) >= n_body
    band = moved[is_wing & (distance < rigid)] - points[is_wing & (distance < rigid)] - shift
    assert len(band) == N_AROUND
    assert np.abs(slid).max() > 0.1
    # it is a mean over neighbours along the junction
    np.testing.assert_allclose(band, slid, rtol=0.0, atol=0.06 * np.abs(slid).max())
    faded = Junction(np.arange(n_body), reach, CYLINDER).bind(Layout(mesh)).apply(points + shift, sliding.initial)
    lost = faded[n_body : n_body + N_AROUND] - points[n_body : n_body + N_AROUND] - shift
    assert np.linalg.norm(lost, axis=1).max() < 0.95 * np.linalg.norm(slid, axis=1).max()
    at = np.linspace(0.0, 0.9, 1801)[:, None] * [0.0, 0.0, 1.0]
    fade = (
        Junction(np.arange(1), reach, rigid=rigid)._fading(cKDTree(np.zeros((1, 3))), at[1:])[::3, ::3].toarray()[:, 0]
    )
    np.testing.assert_array_equal(fade[at[1:, 2] <= rigid], 1.0)
    assert np.abs(np.diff(fade, 2)).max() < 20.0 * (0.5e-3) ** 2 / (reach - rigid) ** 2  # continuous second derivatives
    np.testing.assert_allclose(np.hypot(*moved[:n_body, 1:].T), RADIUS, rtol=0.0, atol=1e-14)


def test_derivatives_are_exact(case):
    mesh, n_body = case
    junction = Junction(np.arange(n_body), 0.5)
    assert_exact(Layout(mesh), junction)
    assert_exact(Layout(mesh), Junction(np.arange(n_body), 0.5, CYLINDER, rigid=0.2))
    rows = np.concatenate([np.arange(0, N_AROUND, 3), np.arange(n_body, len(mesh.points), 7)])
    shape = Parametrization(mesh, [Local("bumps", SurfaceRows(rows))], junction=junction)
    random = np.random.default_rng(1)
    values = {"bumps": 0.02 * random.normal(size=shape.initial["bumps"].shape)}
    step = random.normal(size=values["bumps"].shape)
    moved = shape.apply(mesh.points, {"bumps": values["bumps"] + 1e-30j * step})
    partials = shape.partials(mesh.points, values)
    np.testing.assert_allclose(partials.values["bumps"] @ step, moved.imag.ravel() / 1e-30, atol=1e-13)


def component():
    """Nodes in rows of the body of a component grid of its own, around and under the wing."""
    along, around = np.meshgrid(np.linspace(-2.5, 2.5, 41), np.linspace(-1.4, 1.4, 33), indexing="ij")
    return np.stack([along, RADIUS * np.sin(around), RADIUS * np.cos(around)], axis=-1)


@pytest.mark.parametrize(
    ("surface", "off"),
    [(CYLINDER, 1e-14), (SplineSurface(component()), 1e-5), (None, 2e-4)],
    ids=lambda of: str(of)[:8],
)
def test_walls_of_grids_that_overlap_slide_on_one_body(case, surface, off):
    mesh, n_body = case
    n, body = len(mesh.points), component()
    ids = n + np.arange(body.size // 3).reshape(body.shape[:2])
    quads = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)
    points = np.concatenate([mesh.points, body.reshape(-1, 3)])
    both = replace(
        mesh,
        points=points,
        surface_ids=np.arange(len(points), dtype=np.int32),
        is_free=np.zeros(points.shape, dtype=bool),
        surface_faces=np.concatenate([mesh.surface_faces, quads]),
        markers=(("walls", np.arange(len(points)), np.arange(1, len(points) + 1)),),
    )
    of_body = np.concatenate([np.arange(n_body), ids.ravel()])
    sliding = Junction(of_body, 0.9, surface).bind(Layout(both))
    moved = sliding.apply(asked_of(points), sliding.initial)
    assert np.abs(np.hypot(*moved[of_body, 1:].T) - RADIUS).max() < off
    gone = moved - points
    distances, nearest = cKDTree(points[N_AROUND:n_body]).query(body.reshape(-1, 3))
    is_near = distances < 0.05  # there both go the same way
    apart = gone[ids.ravel()[is_near]] - gone[N_AROUND + nearest[is_near]]
    assert np.linalg.norm(apart, axis=1).max() < 0.15 * np.abs(gone[of_body]).max()


def test_what_makes_no_junction_is_refused(case):
    mesh, n_body = case
    layout = Layout(mesh)
    with pytest.raises(InputError, match="reach 0; give a positive distance"):
        Junction(np.arange(n_body), 0).bind(layout)
    with pytest.raises(InputError, match=r"rigid 0.5; give a distance in metres, 0 or more, below 0.5"):
        Junction(np.arange(n_body), 0.5, rigid=0.5).bind(layout)
    with pytest.raises(InputError, match="no node is both of the body and of a face beside it"):
        Junction(np.arange(len(mesh.points)), 0.5).bind(layout)
    other = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.1 * RADIUS)
    with pytest.raises(InputError, match=r"node \d+ of marker 'walls' is 0.1 m off the given Cylinder, more than"):
        Junction(np.arange(n_body), 0.5, other).bind(layout)
