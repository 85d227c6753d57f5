from dataclasses import dataclass, replace

import numpy as np
import pytest
from mover_cases import (
    assert_derivative_is_exact,
    assert_derivative_is_transposed,
    channel,
    channel_grid,
    mesh_of,
    oblique_channel,
    plate,
    rotation,
    wing,
)
from topology_cases import box, grid_of, patch, sphere_octants, two_block_plate

from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_grid, moving_mesh
from bspline_mdao.core.movement.increments import in_increments
from bspline_mdao.core.splines.greville import greville_abscissae
from bspline_mdao.core.splines.knots import BilinearKnots, ConstantKnots, open_uniform_knots
from bspline_mdao.core.splines.volume import Volume, evaluate
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Window

SIDES = {"xmin": 0, "xmax": 1, "ymin": 2, "ymax": 3, "zmin": 4, "zmax": 5}


def cube_mesh(shear=None, design=None, fixed=(), sliding=(), **kinds):
    """Mesh of a box with patches of the given kinds, sheared or turned by a matrix; ``zmin`` is the wall."""
    nodes = box(np.linspace(0.0, 1.0, 4), np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 6))
    nodes = nodes if shear is None else nodes @ shear.T
    whole = Window.whole(0, (4, 5, 6))
    kinds = {"zmin": "wall"} | kinds
    patches = [patch(kind, whole.face(SIDES[s]), name=s) for s, kind in kinds.items()]
    return mesh_of(grid_of(nodes, patches=patches), design=design, fixed=fixed, sliding=sliding)


def test_the_surface_goes_before_fixed_points_and_those_before_symmetry():
    mesh = channel()
    x, y, z = mesh.points.T
    is_far = (x == 0.0) | (x == 2.5) | (y == 1.0) | (z == z.max())
    np.testing.assert_array_equal(np.flatnonzero(z == 0.0), mesh.surface_ids)
    np.testing.assert_array_equal(np.flatnonzero(is_far & (z > 0.0)), mesh.fixed_ids)
    slides = (y == 0.0) & ~is_far & (z > 0.0)
    np.testing.assert_array_equal(mesh.is_free[slides], [[True, False, True]] * slides.sum())
    assert mesh.is_free[~slides & ~is_far & (z > 0.0)].all()
    assert mesh.frames is None


def test_an_oblique_symmetry_plane_frees_the_same_points_in_its_own_directions():
    mesh, straight = oblique_channel(), channel()
    np.testing.assert_array_equal(mesh.surface_ids, straight.surface_ids)
    np.testing.assert_array_equal(mesh.is_free.sum(axis=1), straight.is_free.sum(axis=1))
    normal = rotation()[:, 1]
    is_sliding = mesh.is_free.sum(axis=1) == 2
    random = np.random.default_rng(0).normal(size=mesh.points.shape)
    expected = random[is_sliding] - np.outer(random[is_sliding] @ normal, normal)
    np.testing.assert_allclose(mesh.slide(random)[is_sliding], expected, atol=1e-14)
    np.testing.assert_allclose(np.abs(mesh.in_plane_normals @ normal), 1.0)
    np.testing.assert_array_equal(mesh.in_plane_rows, straight.in_plane_rows)


@pytest.mark.slow
@pytest.mark.parametrize("make", [channel, oblique_channel, plate, wing])
def test_sliding_is_an_orthogonal_projection(make):
    mesh = make()
    a, b = np.random.default_rng(0).normal(size=(2, mesh.n_points, 3))
    np.testing.assert_allclose(mesh.slide(mesh.slide(a)), mesh.slide(a), atol=1e-14)
    np.testing.assert_allclose((mesh.slide(a) * b).sum(), (a * mesh.slide(b)).sum())
    np.testing.assert_array_equal(mesh.slide(a)[np.concatenate([mesh.surface_ids, mesh.fixed_ids])], 0.0)
    is_free = mesh.is_free.all(axis=1)
    np.testing.assert_allclose(mesh.slide(a)[is_free], a[is_free], atol=1e-15)


WEDGE = np.array([[1.0, 0.4, 0.1], [0.0, 1.0, 0.2], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    "shear", [np.eye(3), rotation(), WEDGE, rotation() @ WEDGE], ids=["box", "turned", "wedge", "both"]
)
def test_points_on_two_symmetry_planes_slide_along_their_edge(shear):
    mesh = cube_mesh(shear, xmin="symmetry", ymin="symmetry")
    edge = mesh.blocks[0][0, 0, 1:-1]
    np.testing.assert_array_equal(mesh.is_free[edge].sum(axis=1), 1)
    along = shear[:, 2] / np.linalg.norm(shear[:, 2])
    random = np.random.default_rng(0).normal(size=mesh.points.shape)
    np.testing.assert_allclose(mesh.slide(random)[edge], np.outer(random[edge] @ along, along), atol=1e-14)
    corner = np.searchsorted(mesh.surface_ids, mesh.blocks[0][0, 0, 0])
    np.testing.assert_allclose(mesh.in_plane_normals[mesh.in_plane_rows == corner] @ along, 0.0, atol=1e-14)
    assert (mesh.in_plane_rows == corner).sum() == 2


def test_a_point_on_three_symmetry_planes_is_fixed():
    mesh = cube_mesh(rotation(), xmin="symmetry", ymin="symmetry", zmin="symmetry", xmax="wall")
    assert mesh.blocks[0][0, 0, 0] in mesh.fixed_ids


def test_two_patches_of_one_plane_are_one_constraint():
    wall, plane, far = channel_grid(rotation()).patches
    halves = (replace(plane, windows=plane.windows[:1]), replace(plane, name="other half", windows=plane.windows[1:]))
    mesh = mesh_of(replace(channel_grid(rotation()), patches=(wall, *halves, far)), fixed="farfield")
    assert (mesh.is_free.sum(axis=1) != 1).all()
    np.testing.assert_array_equal(mesh.in_plane_rows, oblique_channel().in_plane_rows)


@pytest.mark.parametrize("kind", ["other", "farfield", None])
@pytest.mark.parametrize("shear", [np.eye(3), rotation() @ WEDGE], ids=["box", "turned"])
def test_planes_that_the_surface_ends_on_slide_unless_they_are_walls(shear, kind):
    sides = dict.fromkeys(("xmin", "zmax") if kind else (), kind)
    mesh = cube_mesh(shear, **sides, xmax="wall", ymin="wall", **{"ymax": "symmetry"}, design="zmin")
    ids = mesh.blocks[0]
    normal = np.linalg.inv(shear)[0]  # of the plane x = 0
    random = np.random.default_rng(1).normal(size=mesh.points.shape)
    slid = mesh.slide(random)
    np.testing.assert_allclose(slid[ids[0, 1:-1, 1:-1]] @ normal, 0.0, atol=1e-13)
    assert (mesh.is_free[ids[0, 1:-1, 1:-1]].sum(axis=-1) == 2).all()
    for held in (ids[:, :, -1], ids[-1], ids[:, 0]):  # the lid is not touched, the others are walls
        np.testing.assert_array_equal(slid[held], 0.0)
    assert len(mesh.planes) == (kind != "farfield")
    assert len(mesh.in_plane_rows) == 4  # those of the plane of symmetry
    assert [what for what, _ in mesh.obstacles] == ["patch 'xmax'", "patch 'ymin'"]


def test_a_plane_slides_as_a_whole_though_the_surface_ends_on_a_part_of_it():
    x, y, z = np.linspace(0.0, 1.0, 4), np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 7)
    lower, upper = box(x, y, z[:4]), box(x, y, z[3:])
    whole = Window.whole(0, (4, 5, 4)), Window.whole(1, (4, 5, 4))
    patches = [patch("wall", whole[0].face(4)), patch("other", *(window.face(0) for window in whole), name="side")]
    mesh = mesh_of(grid_of(lower, upper, patches=patches))
    inner = np.unique(np.concatenate([ids[0, 1:-1].ravel() for ids in mesh.blocks]))
    inner = inner[(mesh.points[inner, 2] > 0.0) & (mesh.points[inner, 2] < 1.0)]
    np.testing.assert_array_equal(mesh.is_free[inner], [[False, True, True]] * len(inner))


def test_curved_faces_do_not_slide_but_follow():
    grid = channel_grid()
    grid = replace(grid, patches=(*grid.patches[:2], replace(grid.patches[2], kind="other")))
    x, z = grid.blocks[0].nodes[..., 0], grid.blocks[0].nodes[..., 2]
    x += 0.1 * z * (1.0 - x)  # the low end in x is oblique, and planar still
    assert len(mesh_of(grid).planes) == 4
    x += 0.1 * z**2 * (1.0 - x)
    mesh = mesh_of(grid)
    assert len(mesh.planes) == 3
    assert not mesh.obstacles
    assert mesh.is_free[mesh.blocks[0][0, 1:-1, 1:-1]].all()
    assert [what for what, _ in mesh_of(grid, fixed="farfield").obstacles] == ["patch 'farfield'"]


def test_patches_slide_where_they_are_asked_to():
    mesh = cube_mesh(zmax="farfield", xmin="wall", design="zmin", sliding=["zmax", "xmin"])
    ids = mesh.blocks[0]
    np.testing.assert_array_equal(mesh.is_free[ids[1:-1, 1:-1, -1]], [[[True, True, False]] * 3] * 2)
    np.testing.assert_array_equal(mesh.is_free[ids[0, 1:-1, 1:-1]], [[[False, True, True]] * 4] * 3)
    np.testing.assert_array_equal(mesh.surface_ids[mesh.in_plane_rows], ids[0, :, 0])
    with pytest.raises(InputError, match="patch 'zmax' is to be both fixed and sliding; choose one"):
        cube_mesh(zmax="farfield", sliding="zmax", fixed="z*ax")
    grid = channel_grid()
    grid.blocks[0].nodes[2, :, -1, 2] += 1e-3
    with pytest.raises(
        InputError, match=r"patch farfield is to slide, but leaves its plane by .* m, .*, or fix or release it"
    ):
        mesh_of(grid, sliding="farfield")


def test_an_element_that_tangles_beside_a_fixed_patch_says_so():
    mesh = cube_mesh(xmin="other", fixed="xmin")
    points = mesh.points.copy()
    points[mesh.blocks[0][1:, :, 0], 0] -= 0.5
    tangling = mesh.tangled(points)
    assert tangling.place == (
        "element (1, 1, 1) of block 1 on patch 'xmin', which is fixed where the surface ends on it"
    )


def test_a_symmetry_patch_that_is_not_planar_is_refused():
    grid = channel_grid()
    grid.blocks[0].nodes[2, 0, 2, 1] += 1e-3
    with pytest.raises(InputError, match=r"kind symmetry, but leaves its plane by .* m; mend the grid, or make its"):
        mesh_of(grid)


def octant():
    """Mesh of an eighth of a spherical shell between three symmetry planes, with a pole line on two of them."""
    whole = Window.whole(0, (4, 5, 6))
    planes = [patch("symmetry", whole.face(side), name=f"plane {side}") for side in (3, 4, 5)]
    return mesh_of(grid_of(sphere_octants()[0], patches=[patch("wall", whole.face(0)), *planes]))


def test_the_points_of_a_pole_line_between_symmetry_planes_slide_along_it():
    mesh = octant()
    pole = np.unique(mesh.blocks[0][1:-1, 0, :])
    assert len(pole) == 2
    np.testing.assert_array_equal(mesh.is_free[pole], [[False, False, True]] * 2)


def test_the_points_of_a_pole_line_inside_are_free():
    blocks = sphere_octants()
    walls = [Window.whole(n, (4, 5, 6)).face(0) for n in range(8)]
    mesh = mesh_of(grid_of(*blocks, patches=[patch("wall", *walls)]))
    pole = np.unique(mesh.blocks[0][1:-1, 0, :])
    assert mesh.is_free[pole].all()
    assert mesh.frames is None


def test_collapsed_corners_are_left_out_of_the_judgement_of_wedges():
    mesh = octant()
    n_wedges = 3 * 5
    assert (mesh.degenerate_corners > 0).sum() == n_wedges
    assert mesh.tangled(mesh.points).n_tangled == 0
    moved = mesh.points.copy()
    moved[mesh.blocks[0][1, 1, 2]] *= 3.0
    assert mesh.tangled(moved).n_tangled > 0


def test_elements_list_their_corners_with_i_fastest():
    mesh = channel()
    n_first = 3 * 4 * 5
    i, j, k = 1, 2, 3
    corners = [mesh.blocks[0][i + a, j + b, k + c] for c in (0, 1) for b in (0, 1) for a in (0, 1)]
    np.testing.assert_array_equal(mesh.elements[(i * 4 + j) * 5 + k], corners)
    np.testing.assert_array_equal(mesh.elements[n_first], mesh.blocks[1][:2, :2, :2].transpose(2, 1, 0).ravel())
    assert mesh.place((i * 4 + j) * 5 + k) == "element (2, 3, 4) of block 1"
    assert mesh.place(n_first + 1) == "element (1, 1, 2) of block 2"
    with pytest.raises(IndexError):
        mesh.place(len(mesh.elements))


def test_points_are_named_by_the_first_block_that_holds_them():
    mesh = channel()
    assert mesh.place_of_point(mesh.blocks[0][3, 1, 2]) == "point (4, 2, 3) of block 1"
    assert mesh.place_of_point(mesh.blocks[1][1, 4, 5]) == "point (2, 5, 6) of block 2"
    with pytest.raises(IndexError):
        mesh.place_of_point(mesh.n_points)


def test_blocks_that_nothing_joins_to_the_surface_are_told():
    rows = [np.arange(5.0) / 4.0, np.arange(4.0) / 3.0, np.arange(6.0) / 5.0]
    first, second, third = (box(*rows) + [shift, 0.0, 0.0] for shift in (0.0, 1.0, 3.0))
    grid = grid_of(first, second, third, patches=[patch("wall", Window.whole(1, (5, 4, 6)).face(4))])
    assert mesh_of(grid).stranded_blocks() == ("block 3",)
    assert channel().stranded_blocks() == ()


def test_handedness_is_that_of_each_block():
    mesh = channel()
    np.testing.assert_array_equal(mesh.handedness, np.repeat([1, -1], [3 * 4 * 5, 4 * 5 * 5]))


def test_elements_tangle_in_left_handed_blocks_as_in_others():
    mesh = channel()
    for ids, name in zip(mesh.blocks, mesh.names):
        moved = mesh.points.copy()
        moved[ids[2, 2, 2], 2] += 2.0
        tangling = mesh.tangled(moved)
        assert 4 <= tangling.n_tangled <= 8
        assert tangling.place.endswith(name)
        assert tangling.min_corner < 0.0
    assert mesh.tangled(mesh.points * [1.0, 1.0, -1.0]).n_tangled == len(mesh.elements)


def test_elements_that_are_invalid_on_the_baseline_do_not_count():
    mesh = channel()
    folded = mesh.points.copy()
    folded[mesh.blocks[0][1, 2, 2], 2] += 2.0
    n_folded = mesh.tangled(folded).n_tangled
    assert n_folded > 0
    assert replace(mesh, points=folded).tangled(folded).n_tangled == 0
    assert replace(mesh, points=folded).tangled(-folded).n_tangled == len(mesh.elements) - n_folded


def test_the_worst_element_is_told_though_others_are_not_finite_too():
    mesh = channel()
    moved = mesh.points.copy()
    moved[mesh.blocks[0][1, 1, 1]] = np.nan
    tangling = mesh.tangled(moved)
    assert tangling.n_tangled == 8
    assert tangling.place.startswith("element (1, 1, 1) of block 1")
    assert not tangling.min_corner > 0.0


def test_fixed_points_and_patches_stay_and_released_patches_are_free():
    topology = find_topology(channel_grid())
    nodes = channel_grid().to_vector().reshape(-1, 3)
    inner = channel().blocks[0][1, 1, 2:4]
    mesh, _ = moving_grid(topology, nodes, fixed=["symm*", inner], released="farfield")
    y, z = mesh.points[:, 1:].T
    np.testing.assert_array_equal(mesh.fixed_ids, np.union1d(np.flatnonzero((y == 0.0) & (z > 0.0)), inner))
    assert mesh.is_free[(z == z.max()) & (y > 0.0)].all()
    free, _ = moving_grid(topology, nodes, released=("symmetry", "farfield"))
    assert not len(free.fixed_ids)
    assert free.is_free[free.points[:, 2] > 0.0].all()


@pytest.mark.parametrize(
    ("fixed", "expected"),
    [
        (9, {9}),
        ([9, 11], {9, 11}),
        (np.array([9, 11]), {9, 11}),
        (["symmetry", 9, np.array([11])], {9, 11}),
        ((), set()),
        (np.array([]), set()),
    ],
)
def test_points_to_fix_are_taken_in_any_form(fixed, expected):
    mesh = mesh_of(channel_grid(), fixed=fixed, released="farfield")
    assert set(mesh.fixed_ids[mesh.points[mesh.fixed_ids, 1] > 0.0]) == expected


@pytest.mark.parametrize("fixed", [[-1], [10_000], [1.5], np.ones(216, dtype=bool), [[None]]])
def test_points_to_fix_that_do_not_exist_are_refused(fixed):
    with pytest.raises(InputError, match="fixed points: give numbers from 0 to 269"):
        mesh_of(channel_grid(), fixed=fixed)


@pytest.mark.parametrize("option", ["design", "fixed", "released", "sliding"])
def test_a_patch_that_does_not_exist_is_refused_with_those_that_do(option):
    with pytest.raises(InputError, match="no patch is called 'wimg'; the patches are farfield, symmetry, wall"):
        mesh_of(channel_grid(), **{option: "wimg"})


def test_a_grid_without_walls_asks_for_its_design_surface():
    grid = replace(channel_grid(), patches=channel_grid().patches[1:])
    with pytest.raises(InputError, match="name the patches in 'design'"):
        mesh_of(grid)
    assert len(mesh_of(grid, design="sym*").surface_ids) == 9 * 6
    with pytest.raises(InputError, match="no point is on the design surface"):
        mesh_of(grid, design=())


def test_planar_blocks_are_refused():
    grid = grid_of(box(np.linspace(0, 1, 4), np.linspace(0, 1, 5), [0.0]))
    with pytest.raises(InputError, match="block 1 is planar"):
        mesh_of(grid)


def test_a_grid_is_gathered_from_the_points_of_its_mesh_though_blocks_are_cut():
    grid = two_block_plate()
    topology = find_topology(grid)
    mesh, point_ids = moving_grid(topology, grid.to_vector().reshape(-1, 3))
    np.testing.assert_array_equal(mesh.points[point_ids], grid.to_vector().reshape(-1, 3))
    assert len(mesh.blocks) == len(topology.segments) > 2
    assert len(mesh.surface_ids) == 2 * 5 * 5 - (5 + 4 + 4)  # the rim but for the root is one
    assert (mesh.points[mesh.surface_ids, 2] == 0.0).all()


def test_the_control_mesh_has_the_points_of_the_model_and_their_parameters():
    model = fit_grid(channel_grid(), n_control=[(4, 5, 4), (5, 4, 4)])
    mesh = moving_mesh(model)
    assert mesh.points is model.control_points
    assert [places.shape for places in mesh.parameters] == [(*ids.shape, 3) for ids in mesh.blocks]
    assert all((np.diff(places[..., d], axis=d) > 0.0).all() for places in mesh.parameters for d in range(3))
    np.testing.assert_allclose(mesh.points[mesh.surface_ids, 2], 0.0, atol=1e-14)
    assert len(mesh.surface_ids) == (4 + 4 - 1) * 5


def test_greville_abscissae_are_the_coefficients_of_the_parameters_themselves():
    volume = Volume.of(*(ConstantKnots.uniform(n, p) for n, p in ((6, 4), (5, 3), (4, 2))))
    parameters = np.random.default_rng(0).uniform(size=(30, 3))
    np.testing.assert_allclose(evaluate(volume, greville_abscissae(volume), parameters), parameters, atol=1e-14)


def test_greville_abscissae_of_curved_knots_are_the_means_at_their_own_place():
    random = np.random.default_rng(0)
    knots = []
    for n, p in ((6, 4), (7, 4), (5, 3)):
        corners = np.tile(open_uniform_knots(n, p), (2, 2, 1))
        corners[..., p:n] += random.uniform(-0.4, 0.4, (2, 2, n - p)) / (n - p + 1)
        knots.append(BilinearKnots(corners, p))
    places = greville_abscissae(Volume.of(*knots))
    for d, p in enumerate((4, 4, 3)):
        at = knots[d].values(places[..., (d + 1) % 3].ravel(), places[..., (d + 2) % 3].ravel())
        index = np.indices(places.shape[:3])[d].ravel()
        means = [row[i + 1 : i + p].mean() for row, i in zip(at, index)]
        np.testing.assert_allclose(places[..., d].ravel(), means, atol=1e-14)
    np.testing.assert_array_equal(places[0, ..., 0], 0.0)
    np.testing.assert_allclose(places[:, -1, :, 1], 1.0, atol=1e-15)


@dataclass(frozen=True, eq=False)
class Twist:
    """Increment that depends on everything: each point follows a product of initial points, points and surface."""

    initial: np.ndarray
    before: np.ndarray
    surface: np.ndarray
    report: None = None

    @property
    def points(self):
        return self.before + np.sin(self.initial) * self.before * self.surface.mean(axis=0)

    def jvp(self, d_initial, d_before, d_surface):
        pull = self.surface.mean(axis=0)
        d_points = d_before + np.cos(self.initial) * d_initial * self.before * pull
        return d_points + np.sin(self.initial) * (d_before * pull + self.before * d_surface.mean(axis=0))

    def vjp(self, bar):
        pull, sines = self.surface.mean(axis=0), np.sin(self.initial)
        surface_bar = np.broadcast_to((sines * self.before * bar).sum(axis=0) / len(self.surface), self.surface.shape)
        return np.cos(self.initial) * self.before * pull * bar, bar + sines * pull * bar, surface_bar


@dataclass(frozen=True)
class Twister:
    """Mover whose increments are twists."""

    mesh: object
    n_increments: int

    def move(self, initial, surface):
        return in_increments(self.mesh, Twist, initial, surface, self.n_increments)


@pytest.mark.parametrize("n_increments", [1, 2, 5])
def test_derivatives_go_through_all_increments(n_increments):
    mover = Twister(channel(), n_increments)
    initial = 0.1 * mover.mesh.points
    surface = initial[mover.mesh.surface_ids] + [0.01, 0.0, 0.01]
    assert_derivative_is_transposed(mover.move(initial, surface))
    assert_derivative_is_exact(mover, initial, surface)


def test_the_surface_goes_in_equal_increments_along_straight_lines():
    mesh, seen = channel(), []

    def step(initial, before, surface):
        seen.append(surface)
        return Twist(0.0 * initial, before, surface)

    start = mesh.points[mesh.surface_ids]
    surface = start + np.random.default_rng(0).normal(size=start.shape) * [1.0, 0.0, 1.0]
    movement = in_increments(mesh, step, mesh.points, surface, 3)
    np.testing.assert_allclose(seen[0], start + (surface - start) / 3.0, atol=1e-14)
    np.testing.assert_allclose(seen[1], start + 2.0 * (surface - start) / 3.0, atol=1e-14)
    assert seen[2] is surface
    assert len(movement.report.increments) == 3
    assert movement.report.first_tangled() is None


def test_requests_that_nothing_can_follow_are_refused():
    mesh = channel()
    points, surface = mesh.points, mesh.points[mesh.surface_ids]
    with pytest.raises(InputError, match="0 increments; give a whole number from 1"):
        in_increments(mesh, Twist, points, surface, 0)
    with pytest.raises(InputError, match=r"surface points of shape \(5, 3\)"):
        in_increments(mesh, Twist, points, surface[:5], 1)
    bad = points.copy()
    bad[6, 1] = np.inf
    with pytest.raises(MovementError, match="point 7 is not finite"):
        in_increments(mesh, Twist, bad, surface, 1)
    off = surface.copy()
    off[mesh.in_plane_rows[2], 1] = -1e-3
    with pytest.raises(MovementError, match=r"point \(3, 1, 1\) of block 1 leaves its symmetry plane by 0.001 m"):
        in_increments(mesh, Twist, points, off, 1)
