"""Grids whose nodes slide on surfaces that are not planes."""

import logging

import numpy as np
import openmdao.api as om
import pytest
from mover_cases import rotation
from sliding_cases import lean, passage, passage_grid, rows_of, surface_of, wing_on_body_grid
from topology_cases import patch

from bspline_mdao import (
    DesignSurface,
    GridEvaluate,
    GridMovement,
    InputError,
    family_member,
    find_topology,
    fit_grid,
    read_grid,
)
from bspline_mdao.core.design.motion import UnsteadyGrid
from bspline_mdao.core.fit.live_fit import live_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.grids.topology.partition import Partition
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import ComovingFrame, Cone, Cylinder, LinearElasticity, Rotations, SplineSurface, moving_mesh
from bspline_mdao.testing import central_difference, check_totals, dot_test

CASES = {
    "cylinder": {},
    "turned": {"turn": rotation()},
    "two blocks": {"n_blocks": 2},
    "walls": {"hub": "wall", "casing": "wall"},
    "cone": {"contour": lambda x: 2.0 - 0.3 * x},
    "contour": {"contour": lambda x: 2.0 - 0.1 * np.sin(2.0 * x)},
    "symmetry": {"far": "symmetry", "contour": lambda x: 2.0 - 0.3 * x},
}
SLIDING = ["hub", "casing"]


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """A model, its mesh and map, and control points moved behind a blade that leans by 0.25 m at the casing."""
    options = CASES[request.param]
    model = passage(**options)
    mesh = moving_mesh(model, "blade", sliding=SLIDING)
    movement = Rotations(mesh).move(model.control_points, lean(mesh, 0.1, options.get("turn")))
    return model, mesh, model.map_sliding(mesh.slides, model), movement.points


@pytest.fixture(scope="module")
def simple():
    return passage()


def test_nodes_stay_on_their_surfaces_whatever_control_points_do(case):
    model, mesh, grid_map, points = case
    nodes, plain = grid_map.at(points).nodes, model.grid_map().at(points).nodes
    for name in SLIDING:
        rows, surface = rows_of(model, name), surface_of(mesh, name)
        heights = surface.levels(grid_map.nodes[rows]).values
        assert np.abs(surface.levels(nodes[rows]).values - heights).max() < 1e-14
        assert surface.distances(plain[rows]).max() > 1e-3  # without, they leave it
        assert np.linalg.norm(nodes[rows] - grid_map.nodes[rows], axis=1).max() > 0.03
    quality = GridQuality.of_baseline(model.regenerate())
    assert all(cells.is_valid.all() for cells in quality.cells(nodes))


def test_nodes_stay_in_planes_that_end_on_the_surfaces(case):
    model, mesh, grid_map, points = case
    nodes = grid_map.at(points).nodes
    for slide in mesh.slides[2:]:
        rows = rows_of(model, slide.what.split("'")[1])
        assert slide.surface.distances(nodes[rows]).max() < 1e-14
    assert len(mesh.slides) > 3


def test_at_rest_nothing_moves_and_shared_nodes_have_the_same_bits(case):
    model, _, grid_map, points = case
    at_rest, baseline = (m.at(model.control_points).nodes for m in (grid_map, model.grid_map()))
    np.testing.assert_array_equal(at_rest, baseline)
    nodes, copies = grid_map.at(points).nodes, grid_map.numbering.copies
    np.testing.assert_array_equal(nodes[copies[:, 0]], nodes[copies[:, 1]])


def test_derivatives_are_exact_and_transposed(case):
    _, _, grid_map, points = case
    state, rng = grid_map.at(points), np.random.default_rng(1)
    direction = rng.normal(size=points.shape)
    exact = state.jvp(control_points=direction)
    differences = central_difference(lambda h: grid_map.at(points + h * direction).nodes, 1e-4, levels=3)
    np.testing.assert_allclose(exact, differences, atol=1e-9 * np.abs(exact).max())
    pair = (lambda d: state.jvp(control_points=d)), (lambda bar: state.vjp(bar)["control_points"])
    assert dot_test(*pair, points.shape, state.nodes.shape) < 1e-14


def test_the_edge_of_a_given_wall_slides_and_its_other_nodes_are_where_they_are_given(simple):
    mesh, surface = moving_mesh(simple, "blade", sliding=SLIDING), SurfaceGrid.of(simple, "blade")
    grid_map, rng = simple.map_meeting(surface.rows, simple, mesh.slides), np.random.default_rng(2)
    given = surface.points + 0.02 * np.sin(3.0 * surface.points[:, ::-1])
    points = simple.control_points + 0.01 * np.sin(2.0 * simple.control_points[:, ::-1])
    state = grid_map.at(points, given)
    is_edge = np.isin(surface.rows, np.concatenate([rows_of(simple, name) for name in (*SLIDING, "inlet", "outlet")]))
    np.testing.assert_array_equal(state.nodes[surface.rows[~is_edge]], given[~is_edge])
    for name in SLIDING:
        assert surface_of(mesh, name).distances(state.nodes[rows_of(simple, name)]).max() < 1e-14
    plain = simple.grid_map().at(points).nodes[surface.rows]
    np.testing.assert_allclose(given - state.mismatch, plain, atol=1e-14)
    directions = [rng.normal(size=array.shape) for array in (points, given)]
    exact = state.jvp(*directions)
    differences = central_difference(
        lambda h: grid_map.at(points + h * directions[0], given + h * directions[1]).nodes, 1e-4, levels=3
    )
    np.testing.assert_allclose(exact, differences, atol=1e-9 * np.abs(exact).max())
    bar = rng.normal(size=exact.shape)
    bars = state.vjp(bar)
    back = np.vdot(bars["control_points"], directions[0]) + np.vdot(bars["surface"], directions[1])
    assert abs(back - np.vdot(bar, exact)) < 1e-13 * np.linalg.norm(bar) * np.linalg.norm(exact)


def test_layers_at_a_casing_keep_their_heights():
    grid = passage_grid((13, 13, 17), hub="wall", casing="wall", off_wall=1e-3)
    model = fit_grid(grid, n_control=(7, 7, 7))
    mesh = moving_mesh(model, "blade", sliding=SLIDING)
    movement = Rotations(mesh).move(model.control_points, lean(mesh, 0.04))
    nodes = model.map_sliding(mesh.slides, model).at(movement.points).nodes.reshape(13, 13, 17, 3)
    before = model.regenerate().blocks[0].nodes
    for end, inner in ((0, 1), (-1, -2)):
        ratio = np.linalg.norm(nodes[:, :, inner] - nodes[:, :, end], axis=-1)
        ratio /= np.linalg.norm(before[:, :, inner] - before[:, :, end], axis=-1)
        assert np.abs(nodes - before)[:, :, end].max() > 0.03
        assert abs(np.median(ratio) - 1.0) < 1e-3
        assert np.abs(ratio[:, 2:] - 1.0).max() < 0.04
        assert np.abs(ratio - 1.0).max() < 0.2  # in the corner, which the blade leans over


def test_a_wing_moves_along_a_round_body_by_a_tenth_of_its_length():
    model = fit_grid(wing_on_body_grid((17, 13, 17)), n_control=(7, 7, 7))
    before, cells = model.regenerate().to_vector().reshape(-1, 3), GridQuality.of_baseline(model.regenerate())
    n_inverted, ratios = {}, {}
    for sliding in ((), "body"):
        mesh = moving_mesh(model, "wing", sliding=sliding)
        movement = Rotations(mesh).move(model.control_points, mesh.points[mesh.surface_ids] + [0.3, 0.0, 0.0])
        nodes = model.map_sliding(mesh.slides, model).at(movement.points).nodes
        n_inverted[sliding] = sum(int((~found.is_valid).sum()) for found in cells.cells(nodes))
    assert (n_inverted["body"], n_inverted[()] > 100) == (0, True)
    body = rows_of(model, "body")
    np.testing.assert_allclose(np.linalg.norm(nodes[body, 1:], axis=1), 1.0, rtol=0.0, atol=1e-14)
    assert np.linalg.norm(nodes - before, axis=1)[body].max() > 0.29
    lines = [array.reshape(3, 17, 13, 17, 3) for array in (before, nodes)]
    ratios["body"] = np.divide(*(np.linalg.norm(n[:, :, :, 1] - n[:, :, :, 0], axis=-1) for n in lines))
    ratios["wing"] = np.divide(*(np.linalg.norm(n[1, :, 1] - n[1, :, 0], axis=-1) for n in lines))
    assert np.abs(ratios["body"] - 1.0).max() < 0.05
    assert np.abs(ratios["wing"] - 1.0).max() < 0.015


def test_control_points_slide_in_tangent_planes_where_nothing_ends_on_the_side_and_are_free_elsewhere(simple):
    mesh = moving_mesh(simple, "blade", sliding={"casing": None})
    ids = mesh.blocks[0]
    assert mesh.is_free[ids[1:-1, 1:-1, -1]].all()
    grid = passage_grid(n_blocks=2, blade="other")
    strut = moving_mesh(fit_grid(grid, n_control=(6, 5, 6)), "hub", fixed="blade", sliding="casing")
    inner = strut.blocks[0][1:-1, 1:-1, -1].ravel()
    np.testing.assert_array_equal(strut.is_free[inner].sum(axis=1), 2)
    radial = strut.points[inner] * [0.0, 1.0, 1.0]
    radial /= np.linalg.norm(radial, axis=1)[:, None]
    assert np.abs((strut.slide(np.ones_like(strut.points))[inner] * radial).sum(axis=1)).max() < 1e-14


def test_a_frame_that_goes_along_with_the_surface_stays_where_patches_slide_on_curved_surfaces(simple):
    mesh = moving_mesh(simple, "blade", sliding={"casing": None})
    surface = mesh.points[mesh.surface_ids] + [0.0, 0.02, 0.03]
    movers = Rotations(mesh), ComovingFrame(Rotations(mesh))
    points = [mover.move(simple.control_points, surface).points for mover in movers]
    np.testing.assert_allclose(*points, atol=1e-13)


def test_a_real_turbine_keeps_its_hub_and_casing(real_grids):
    whole = read_grid(real_grids / "nasa_vspt_turbine.xyz.gz")
    blocks = [Block(block.nodes[::8, ::10, ::4].copy(), block.name) for block in whole.blocks]
    faces = [face.window for face in find_topology(Grid(tuple(blocks))).boundary]
    kinds = {"hub": [w for w in faces if w.hi[1] == 0], "casing": [w for w in faces if w.lo[1] == 10]}
    kinds["blade"] = [w for w in faces if w.block == 0 and w.hi[2] == 0]
    kinds["rest"] = [w for w in faces if not any(w in found for found in kinds.values())]
    patches = [patch("wall" if name == "blade" else "other", *found, name=name) for name, found in kinds.items()]
    model = fit_grid(Grid(tuple(blocks), tuple(patches)), n_control=(9, 6, 6))
    mesh = moving_mesh(model, "blade", fixed="rest", sliding=SLIDING)
    points = mesh.points[mesh.surface_ids]
    angle = 0.001 * (np.linalg.norm(points[:, 1:], axis=1) - 18.15)
    c, s = np.cos(angle), np.sin(angle)
    leant = np.column_stack([points[:, 0], c * points[:, 1] - s * points[:, 2], s * points[:, 1] + c * points[:, 2]])
    grid_map = model.map_sliding(mesh.slides, model)
    nodes = grid_map.at(Rotations(mesh).move(model.control_points, leant).points).nodes
    for name, radius in (("hub", 18.14755), ("casing", 21.22255)):
        rows, surface = rows_of(model, name), surface_of(mesh, name)
        assert surface.radius == pytest.approx(radius, rel=1e-6)
        before, after = (surface.levels(array[rows]).values for array in (grid_map.nodes, nodes))
        assert np.abs(before).max() < 1e-5  # digits of the file
        # 1e-13 but for copies on the other side: they are turned about an axis as good as the digits of the file
        assert np.abs(after - before).max() < 1e-11 * radius
    assert np.linalg.norm(nodes - grid_map.nodes, axis=1)[rows].max() > 0.05


def test_a_surface_that_is_given_keeps_nodes_as_far_off_as_they_are_and_says_how_far(simple, caplog):
    tunnel = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.001)
    with caplog.at_level(logging.WARNING):
        mesh = moving_mesh(simple, "blade", sliding={"cas*": tunnel})
    (message,) = caplog.messages
    assert "patch casing: nodes are up to 0.001 m off the given Cylinder, node (" in message
    grid_map, rows = simple.map_sliding(mesh.slides, simple), rows_of(simple, "casing")
    movement = Rotations(mesh).move(simple.control_points, lean(mesh, 0.1))
    np.testing.assert_allclose(tunnel.levels(grid_map.at(movement.points).nodes[rows]).values, -1e-3, atol=1e-14)
    np.testing.assert_array_equal(grid_map.at(simple.control_points).nodes, grid_map.nodes)


def test_what_cannot_slide_is_refused(simple):
    far = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.5)
    with pytest.raises(InputError, match=r"patch casing: node \(.*\) of block 1 is 0.5 m off the given Cylinder, more"):
        moving_mesh(simple, "blade", sliding={"casing": far})
    with pytest.raises(InputError, match=r"patch blade is to slide, but leaves its plane by .* m, a cylinder by"):
        moving_mesh(simple, "hub", sliding="blade")
    with pytest.raises(InputError, match="patch 'blade' is to slide and is of the design surface; name the patches"):
        moving_mesh(simple, "blade", sliding="blade")
    with pytest.raises(
        InputError, match=r"'casing' is to slide on 2\.0; give a Cylinder, Cone, Sphere, Revolution, Spl"
    ):
        moving_mesh(simple, "blade", sliding={"casing": 2.0})
    with pytest.raises(InputError, match="no patch is called 'shroud'"):
        moving_mesh(simple, "blade", sliding={"shroud": far})
    with pytest.raises(InputError, match="to be both fixed and sliding"):
        moving_mesh(simple, "blade", fixed="casing", sliding={"casing": far})
    corner = simple.regenerate().blocks[0].nodes[0, 0, -1]
    with pytest.raises(InputError, match="is on the axis; fix or release it, or give another surface"):
        moving_mesh(simple, "blade", sliding={"casing": Cone(corner, (1.0, 0.0, 0.0), 0.1)})


def test_nodes_slide_on_a_surface_through_those_of_a_face_that_no_formula_has():
    model = passage(turn=rotation(), contour=lambda x: 2.0 - 0.1 * np.sin(2.0 * x))
    with pytest.raises(InputError, match="patch casing is to slide, but leaves its plane by"):
        moving_mesh(model, "blade", sliding="casing")
    wall = SplineSurface(model.regenerate().blocks[0].nodes[:, :, -1])
    mesh = moving_mesh(model, "blade", sliding={"casing": wall, "hub": None})
    points = Rotations(mesh).move(model.control_points, lean(mesh, 0.03, rotation())).points
    grid_map, rng = model.map_sliding(mesh.slides, model), np.random.default_rng(4)
    state, rows = grid_map.at(points), rows_of(model, "casing")
    assert wall.distances(state.nodes[rows]).max() < 1e-14
    assert wall.distances(model.grid_map().at(points).nodes[rows]).max() > 1e-3
    np.testing.assert_array_equal(grid_map.at(model.control_points).nodes, grid_map.nodes)
    direction = rng.normal(size=points.shape)
    exact = state.jvp(direction)
    differences = central_difference(lambda h: grid_map.at(points + h * direction).nodes, 1e-4, levels=3)
    np.testing.assert_allclose(exact, differences, atol=1e-7 * np.abs(exact).max())  # third derivatives jump at knots
    pair = (lambda d: state.jvp(control_points=d)), (lambda bar: state.vjp(bar)["control_points"])
    assert dot_test(*pair, points.shape, state.nodes.shape) < 1e-14


def test_grids_that_do_not_ask_have_the_map_that_they_had(simple):
    mesh = moving_mesh(simple, "blade")
    assert mesh.slides == ()
    assert simple.map_sliding(mesh.slides, simple) is simple.grid_map()


def test_a_model_regenerates_the_grid_with_nodes_on_their_surfaces(case):
    model, mesh, grid_map, points = case
    grid = model.regenerate(points, mesh.slides)
    np.testing.assert_array_equal(grid.to_vector().reshape(-1, 3), grid_map.at(points).nodes)


@pytest.mark.parametrize("factor", [2.0, 1.5, 0.5])
def test_nodes_of_members_are_on_the_surfaces_and_stay_there(case, factor):
    model, mesh, _, points = case
    member, plain, offset = model.member(factor, mesh.slides), model.member(factor).local_nodes(), 0.0
    grids = member.local_nodes(), family_member(model, factor, points, mesh.slides).to_vector().reshape(-1, 3)
    for name in SLIDING:
        rows, surface = rows_of(member, name), surface_of(mesh, name)
        off = np.abs(surface.levels(model.local_nodes()[rows_of(model, name)]).values).max()  # digits of the fit
        for nodes in grids:
            assert np.abs(surface.levels(nodes[rows]).values).max() < 1e-14 + 2.0 * off
        offset = max(offset, surface.distances(plain[rows]).max())
    assert (offset > 1e-5) == (factor > 1.0)
    assert np.abs(grids[0] - plain).max() < 2.0 * offset + 1e-13
    copies = member.grid_map().numbering.copies
    for nodes in grids:
        np.testing.assert_array_equal(nodes[copies[:, 0]], nodes[copies[:, 1]])
    assert all(cells.is_valid.all() for cells in GridQuality.of_baseline(member.regenerate()).cells(grids[1]))


def test_members_keep_heights_over_a_surface_that_is_given(simple):
    tunnel = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.001)
    mesh = moving_mesh(simple, "blade", sliding={"casing": tunnel})
    member = simple.member(2.0, mesh.slides)
    values = tunnel.levels(member.local_nodes()[rows_of(member, "casing")]).values
    np.testing.assert_allclose(values, -1e-3, rtol=0.0, atol=1e-14)


def test_each_process_has_the_bits_of_the_whole_grid():
    model = passage(n_blocks=2)
    mesh = moving_mesh(model, "blade", sliding=SLIDING)
    points = model.control_points + 0.01 * np.sin(3.0 * model.control_points[:, ::-1])
    whole, rng = model.map_sliding(mesh.slides, model).at(points), np.random.default_rng(3)
    direction, bar = rng.normal(size=points.shape), rng.normal(size=whole.nodes.shape)
    bars = np.zeros_like(points)
    for rank in range(2):
        subdomain = Partition.of(model.topology, 2).subdomain(rank)
        part = model.part(subdomain).map_sliding(mesh.slides, model)
        state = part.at(points)
        np.testing.assert_array_equal(state.nodes[: part.n_asked], whole.nodes[subdomain.rows])
        np.testing.assert_allclose(
            state.jvp(direction)[: part.n_asked], whole.jvp(direction)[subdomain.rows], atol=1e-12
        )
        bars += state.vjp(part.padded(bar[subdomain.rows]))["control_points"]
    np.testing.assert_allclose(bars, whole.vjp(bar)["control_points"], atol=1e-11)


def problem_of(component):
    """A problem of one component."""
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("body", component)
    return problem


def movement_problem(model, mesh, **options):
    """The group, run at a blade that leans."""
    problem = om.Problem(GridMovement(model=model, mover=LinearElasticity(mesh), fit=False, **options), reports=None)
    problem.setup()
    problem.set_val("surface_control_points", lean(mesh, 0.05).ravel())
    problem.run_model()
    return problem


def test_the_group_keeps_nodes_on_their_surfaces_with_exact_totals(simple):
    wing = DesignSurface.of(simple, "blade", sliding=SLIDING)
    problem = movement_problem(simple, wing.mesh)
    nodes = problem.get_val("grid").reshape(-1, 3)
    for name in SLIDING:
        assert surface_of(wing.mesh, name).distances(nodes[rows_of(simple, name)]).max() < 1e-14
    check = check_totals(problem, ["grid"], ["surface_control_points"], n_directions=1)
    assert check.transposed < 1e-12
    assert check.differences < 1e-8


@pytest.mark.parametrize("options", [{}, {"keep_residual": False}, {"keep_residual": False, "wall_layer": False}])
def test_nodes_keep_their_heights_over_surfaces_from_any_baseline_with_exact_derivatives(options):
    model, rng = fit_grid(passage_grid(), n_control=(6, 5, 6), **options), np.random.default_rng(5)
    given = {name: Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), radius) for name, radius in zip(SLIDING, (1.0, 2.0))}
    mesh = moving_mesh(model, "blade", sliding=given)
    grid_map, nodes = model.map_sliding(mesh.slides, model), model.local_nodes()
    baseline = nodes + 0.01 * np.sin(4.0 * nodes[:, ::-1])
    initial = model.control_points + 0.002 * np.sin(3.0 * model.control_points)
    inputs = [baseline, initial, Rotations(mesh).move(model.control_points, lean(mesh, 0.05)).points]
    state = live_grid(model, baseline, grid_map).at(*inputs[:0:-1])
    at_rest = live_grid(model, baseline, grid_map).at(initial, initial).nodes
    for name in SLIDING:
        rows, surface = rows_of(model, name), surface_of(mesh, name)
        heights = [surface.levels(each[rows]).values for each in (state.nodes, at_rest)]
        assert np.abs(heights[1] - heights[0]).max() < 1e-14
        assert np.abs(heights[1]).max() > 1e-3
    directions = [rng.normal(size=each.shape) for each in inputs]
    exact = state.jvp(*directions)

    def at(h):
        x, b0, b = (each + h * direction for each, direction in zip(inputs, directions))
        return live_grid(model, x, grid_map).at(b, b0).nodes

    differences = central_difference(at, 1e-5, levels=3)
    np.testing.assert_allclose(exact, differences, atol=1e-8 * np.abs(exact).max())
    bar = rng.normal(size=exact.shape)
    bars = state.vjp(bar)
    back = sum(np.vdot(bars[name], direction) for name, direction in zip(state.inputs, directions))
    assert abs(back - np.vdot(bar, exact)) < 1e-13 * np.linalg.norm(bar) * np.linalg.norm(exact)


def test_a_live_group_keeps_nodes_on_their_surfaces_with_transposed_totals(simple):
    mesh = moving_mesh(simple, "blade", sliding=SLIDING)
    group = GridMovement(model=simple, mover=LinearElasticity(mesh, n_increments=1), live=True, quality=False)
    problem = om.Problem(group, reports=None)
    problem.setup()
    problem.set_val("surface_control_points", lean(mesh, 0.05).ravel())
    problem.run_model()
    nodes = problem.get_val("grid").reshape(-1, 3)
    for name in SLIDING:
        assert surface_of(mesh, name).distances(nodes[rows_of(simple, name)]).max() < 1e-14
    of, wrt, rng = ["grid"], ["surface_control_points", "grid_initial"], np.random.default_rng(6)
    seeds = {name: rng.normal(size=problem.get_val(name).size) for name in (*of, *wrt)}
    problem.model.run_linearize()
    change = problem.compute_jacvec_product(of, wrt, "fwd", {name: seeds[name] for name in wrt})["grid"]
    bars = problem.compute_jacvec_product(of, wrt, "rev", {"grid": seeds["grid"]})
    back = sum(np.vdot(bars[name], seeds[name]) for name in wrt)
    assert abs(back - np.vdot(change, seeds["grid"])) < 1e-12 * np.linalg.norm(change) * np.linalg.norm(seeds["grid"])


def test_components_that_cannot_follow_a_surface_refuse_it(simple):
    mesh = moving_mesh(simple, "blade", sliding=SLIDING)
    with pytest.raises(InputError, match="assembled=True does not go with a surface, given or slid on"):
        problem_of(GridEvaluate(model=simple, mesh=mesh, assembled=True)).setup()
    other = moving_mesh(passage(n_control=(5, 5, 5)), "blade", sliding=SLIDING)
    with pytest.raises(InputError, match="the mesh is not the control mesh of"):
        problem_of(GridEvaluate(model=simple, mesh=other)).setup()


def test_grids_in_time_keep_nodes_on_their_surfaces(simple):
    mesh = moving_mesh(simple, "blade", sliding=SLIDING)

    def motion(time, rest):
        ahead, behind = (lean(mesh, 0.1 * (time + h)) for h in (1e-6, -1e-6))
        return lean(mesh, 0.1 * time), (ahead - behind) / 2e-6

    state = UnsteadyGrid(simple, Rotations(mesh), motion).at(0.7)
    for name in SLIDING:
        rows, surface = rows_of(simple, name), surface_of(mesh, name)
        assert surface.distances(state.nodes[rows]).max() < 1e-14
        normals = surface.levels(state.nodes[rows]).gradients
        assert np.abs((normals * state.velocities[rows]).sum(axis=1)).max() < 1e-14
        assert np.abs(state.velocities[rows]).max() > 0.05
