"""The whole map from control points to the grid: baseline, rigid motions, planes, walls, derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from topology_cases import c_grid

from bspline_mdao import MovementError, fit_grid
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.core.movement.elasticity import LinearElasticity
from bspline_mdao.core.walls.grid_map import GridMap
from bspline_mdao.core.walls.wall_correction import WallCorrection
from bspline_mdao.generators import flat_plate_grid, onera_m6_grid
from bspline_mdao.grids.cells.first_cells import FirstCells
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.sharing import boundary_sections, node_sharing
from bspline_mdao.grids.topology.topology import BoundaryFace
from bspline_mdao.movers import moving_mesh


def map_of(model, wall_layer=True, n_threads=None):
    """Map of a model, with all that is known of its walls or without."""
    evaluator = model.evaluator().with_threads(n_threads)
    arguments = model.topology, model.mesh, model.parameters, model.control_points
    return GridMap.of(*arguments, model.residual, model.residual_lengths, wall_layer, evaluator)


def without_kinds(model):
    """The same model of a grid whose boundary nobody has declared."""
    faces = tuple(BoundaryFace(face.window) for face in model.topology.boundary)
    return replace(model, topology=replace(model.topology, boundary=faces))


@pytest.fixture(scope="module")
def wing():
    return fit_grid(onera_m6_grid((11, 10, 9)), n_control=(7, 6, 5), order=(4, 3, 4))


@pytest.fixture(scope="module")
def plate():
    return fit_grid(flat_plate_grid((9, 8, 7)), n_control=(6, 5, 4), keep_residual=False)


@pytest.fixture(params=["wing", "no walls", "no residual"])
def model(request, wing, plate):
    return {"wing": wing, "no walls": without_kinds(wing), "no residual": plate}[request.param]


def moved(model, rng, size=2e-3):
    """Control points of a model that turned by a fifth of a radian and are a little off."""
    turn = Rotation.from_rotvec(0.2 * rng.standard_normal(3)).as_matrix()
    return model.control_points @ turn.T + size * rng.standard_normal(model.control_points.shape)


@pytest.mark.slow
def test_control_points_of_the_baseline_give_the_baseline(model):
    grid_map = map_of(model)
    fitted = model.evaluator().forward(model.control_points)
    baseline = fitted if model.residual is None else fitted + model.residual
    np.testing.assert_allclose(grid_map.at(model.control_points).nodes, baseline, rtol=0, atol=1e-15 * np.ptp(baseline))


def test_nodes_in_planes_see_the_same_with_and_without_others(wing):
    rotation_map, rng = map_of(wing).rotation_map, np.random.default_rng(4)
    rows = np.unique(np.concatenate([face.rows for face in rotation_map.faces]))
    whole = rotation_map.rows(rows)
    assert (whole.planes >= 0).any()
    for last in rng.integers(30, len(rows), size=20):
        some = np.unique([*rng.integers(last, size=30), last])
        found = rotation_map.rows(rows[some])
        np.testing.assert_array_equal(found.planes, whole.planes[some])
        np.testing.assert_array_equal(found.corners, whole.corners[some])
        np.testing.assert_array_equal(found.weights, whole.weights[some])


@pytest.mark.slow
@pytest.mark.parametrize("axis", range(3))
def test_a_quarter_turn_of_all_control_points_turns_all_nodes(model, axis):
    """Planes of symmetry turn with the rest."""
    turn = Rotation.from_rotvec(np.pi / 2 * np.eye(3)[axis]).as_matrix()
    grid_map = map_of(model)
    found = grid_map.at(model.control_points @ turn.T + [1.0, -2.0, 3.0]).nodes
    asked = grid_map.nodes @ turn.T + [1.0, -2.0, 3.0]
    np.testing.assert_allclose(found, asked, rtol=0, atol=1e-14 * np.ptp(grid_map.nodes))


@pytest.mark.slow
def test_without_walls_vectors_of_the_residual_turn_with_the_grid(wing):
    grid_map = map_of(without_kinds(wing))
    assert grid_map.following is None
    b = moved(wing, np.random.default_rng(1), size=0.0)
    turned = grid_map.at(b).nodes - wing.evaluator().forward(b)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=1), np.linalg.norm(wing.residual, axis=1), atol=1e-14)
    assert np.abs(turned - wing.residual).max() > 1e-3


@pytest.mark.slow
def test_without_the_layer_the_map_is_that_of_the_paper(wing, plate):
    for model in (wing, plate):
        grid_map = map_of(model, wall_layer=False)
        b = moved(model, np.random.default_rng(2))
        fitted = model.evaluator().forward(b)
        np.testing.assert_array_equal(
            grid_map.at(b).nodes, fitted if model.residual is None else fitted + model.residual
        )
        assert grid_map.is_linear
        assert not map_of(model).is_linear


@pytest.mark.slow
def test_what_does_not_move_stays_to_the_bit(wing):
    """Held boundaries, and nodes in planes of symmetry along the normal."""
    rng, b = np.random.default_rng(3), wing.control_points.copy()
    grid_map, sharing = map_of(wing), node_sharing(wing.topology)
    is_held, rows = np.zeros(len(b), dtype=bool), {"symmetry": [], "farfield": []}
    for (face, ids), (_, nodes) in zip(
        boundary_sections(wing.topology, wing.mesh.control_ids), boundary_sections(wing.topology, sharing.rows)
    ):
        is_held[ids] |= face.kind not in ("wall", "symmetry")
        rows.get(face.kind, []).append(nodes.ravel())
    in_plane = b[:, 2] == 0.0
    step = 5e-3 * rng.standard_normal(b.shape)
    step[in_plane, 2] = 0.0
    step[is_held] = 0.0
    found = grid_map.at(b + step).nodes
    held, plane = (np.concatenate(rows[kind]) for kind in ("farfield", "symmetry"))
    np.testing.assert_array_equal(found[held], grid_map.nodes[held])
    np.testing.assert_array_equal(found[plane, 2], grid_map.nodes[plane, 2])
    assert len(plane) > 100 < len(held)


@pytest.mark.slow
def test_copies_have_equal_bits(model):
    found, copies = map_of(model).at(moved(model, np.random.default_rng(4))).nodes, node_sharing(model.topology).copies
    np.testing.assert_array_equal(found[copies[:, 0]], found[copies[:, 1]])


def asked_of(model, rng):
    """A map, the correction of all wall nodes but some, and the map that meets these."""
    grid_map = map_of(model)
    rows = grid_map.following.rows
    rows = np.sort(rng.permutation(rows)[len(rows) // 10 :])
    correction = WallCorrection.of(model.topology, grid_map.nodes, rows)
    return grid_map, correction, grid_map.meeting(correction)


@pytest.mark.slow
def test_wall_nodes_are_where_they_are_asked_to_be(wing):
    rng = np.random.default_rng(7)
    grid_map, correction, meeting = asked_of(wing, rng)
    b = moved(wing, rng)
    wall = grid_map.at(b).nodes[correction.rows] + 0.003 * rng.standard_normal((len(correction.rows), 3))
    state = meeting.at(b, wall)
    np.testing.assert_allclose(state.nodes[correction.rows], wall, rtol=0, atol=1e-14 * np.ptp(wall))
    np.testing.assert_array_equal(state.nodes, state.nodes[node_sharing(wing.topology).source_rows()])
    np.testing.assert_allclose(state.mismatch, wall - grid_map.at(b).nodes[correction.rows], rtol=0, atol=1e-14)


def test_wall_nodes_that_are_asked_to_be_where_they_are_change_nothing(wing):
    rng = np.random.default_rng(8)
    grid_map, correction, meeting = asked_of(wing, rng)
    b = moved(wing, rng)
    nodes = grid_map.at(b).nodes
    np.testing.assert_allclose(meeting.at(b, nodes[correction.rows]).nodes, nodes, rtol=0, atol=1e-13)


def test_results_do_not_depend_on_the_number_of_threads(wing):
    rng = np.random.default_rng(6)
    b, v, bar = moved(wing, rng), rng.standard_normal(wing.control_points.shape), rng.standard_normal((wing.n_nodes, 3))
    found = []
    for n_threads in (1, 2):
        state = map_of(wing, n_threads=n_threads).at(b)
        found.append([state.nodes, state.jvp(v), state.vjp(bar)["control_points"]])
    for one, two in zip(*found):
        np.testing.assert_array_equal(one, two)


@pytest.fixture(scope="module")
def section():
    """A C-grid with cells of 1e-4 at the wall, and its control points after a pitch by 20 degrees."""
    thin = np.unique(np.rint(200 * np.linspace(0.0, 1.0, 19) ** 2)).astype(int)
    nodes = c_grid(n_wake=8, n_wing=16, n_off=201, n_span=2)[:, :, thin]
    whole = Window.whole(0, nodes.shape[:3])
    wall = Patch("section", "wall", (Window(0, (8, 0, 0), (40, 1, 0)),))
    rim = Patch("rim", "farfield", (whole.face(5), whole.face(0), whole.face(1)))
    sides = Patch("sides", "symmetry", (whole.face(2), whole.face(3)))
    model = fit_grid(Grid((Block(nodes, "block 1"),), (wall, rim, sides)))
    mesh = moving_mesh(model)
    surface = parse_deformation(("pitch=20deg",), model, mesh).apply(model.control_points[mesh.surface_ids])
    moved = LinearElasticity(mesh, n_increments=5).move(model.control_points, surface).points
    return model, moved


def test_first_cells_keep_their_heights_where_a_section_pitches(section):
    model, moved = section
    cells = FirstCells.of_baseline(model.regenerate())
    ratios, fixed = (cells.ratios(map_of(model, layer).at(moved).nodes) for layer in (True, False))
    assert 0.998 < ratios.min() <= ratios.max() < 1.002
    assert np.abs(fixed - 1.0).max() > 0.01


def test_first_cells_of_family_members_keep_their_heights_as_well(section):
    model, moved = section
    member = model.member(0.5)
    ratios = FirstCells.of_baseline(member.regenerate()).ratios(member.grid_map().at(moved).nodes)
    assert 0.998 < ratios.min() <= ratios.max() < 1.002


@pytest.mark.slow
def test_surroundings_that_turn_inside_out_are_an_error(wing):
    with pytest.raises(MovementError, match="inside out"):
        map_of(wing).at(wing.control_points * [1.0, 1.0, -1.0])
