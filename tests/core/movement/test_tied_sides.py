"""Moves of passages: both sides move alike, as in the whole wheel, by every mover, with exact derivatives."""

from types import SimpleNamespace

import numpy as np
import pytest
from mover_cases import (
    MOVERS,
    assert_derivative_is_exact,
    assert_derivative_is_transposed,
    in_symmetry,
    made,
    mesh_of,
)
from periodic_cases import cut_passage, passage, passage_nodes, untied
from topology_cases import grid_of, patch

from bspline_mdao import find_topology, fit_grid
from bspline_mdao.core.design.displacement import Local
from bspline_mdao.core.design.parametrization import Parametrization
from bspline_mdao.core.mesh.boundary import moving_grid, moving_mesh
from bspline_mdao.core.movement.equilibrium import Unknowns
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.periodic_ties import gap_between
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import ComovingFrame, DelaunayGraph, LinearElasticity, Rotations, Transfinite
from bspline_mdao.testing import central_difference

N_SECTORS = 5


def waves(points, size, seed=0):
    """Displacements of points that differ on both sides of a passage."""
    rng = np.random.default_rng(seed)
    return size * np.sin(points @ rng.uniform(-2.0, 2.0, (3, 3)) + rng.uniform(0.0, 3.0, 3))


def off_sides(mesh, change):
    """How differently copies move than their originals, turned, by the size of the mesh."""
    ties = mesh.ties
    turned = np.einsum("nij,nj->ni", ties.turns, change[ties.originals])
    return np.abs(turned - change[ties.copies]).max() / mesh.size


@pytest.mark.parametrize("motion", ["translation", "rotation"])
@pytest.mark.parametrize("kind", MOVERS)
def test_every_mover_moves_both_sides_alike_and_transposes_that(kind, motion):
    mesh = mesh_of(cut_passage(motion, seed=2))
    at_rest = mesh.points[mesh.surface_ids]
    increments = 10 if kind is DelaunayGraph else 2
    movement = made(kind, mesh, increments).move(mesh.points, at_rest + waves(at_rest, 0.004))
    change = movement.points - mesh.points
    assert off_sides(mesh, change) < 1e-15
    inner = np.setdiff1d(mesh.ties.ids, mesh.surface_ids)
    is_moved = np.linalg.norm(change[inner], axis=1) > 1e-4
    assert is_moved.mean() > (-1.0 if kind.__name__ == "FixedInterior" else 0.3)
    assert_derivative_is_transposed(movement)


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        *(
            (kind, {"motion": m})
            for kind in (Rotations, LinearElasticity, Transfinite)
            for m in ("translation", "rotation")
        ),
        (Rotations, {"hub": 0.0, "wall": 0}),
    ],
)
def test_derivatives_of_a_move_with_tied_sides_are_exact(kind, options):
    mesh = mesh_of(passage(5, 6, 4, **options))
    at_rest = mesh.points[mesh.surface_ids]
    surface = at_rest + in_symmetry(mesh, waves(at_rest, 0.02))
    assert_derivative_is_exact(made(kind, mesh, 2), mesh.points, surface, tolerance=1e-9, scale=0.01)


@pytest.mark.parametrize(
    ("kind", "hub", "side"),
    [
        (LinearElasticity, 0.0, 5),
        # a hub, and a disk; where axes end in planes, as at a casing around one, nothing turns with `Rotations`
        *((kind, *of) for kind in (LinearElasticity, Rotations) for of in ((1.0, 4), (0.0, 0))),
    ],
)
def test_a_sector_moves_as_it_does_in_the_whole_wheel(kind, hub, side):
    pitch = 2.0 * np.pi / N_SECTORS
    sector = passage_nodes((5, 6, 4), pitch=pitch, hub=hub)
    walls = [patch("wall", Window.whole(n, (5, 6, 4)).face(side)) for n in range(N_SECTORS)]
    wheel = [turned(sector, n * pitch) for n in range(N_SECTORS)]
    one, whole = mesh_of(grid_of(sector, patches=walls[:1])), mesh_of(grid_of(*wheel, patches=walls))
    at_rest = one.points[one.surface_ids]
    movement = made(kind, one, 2).move(one.points, at_rest + one.alike(waves(at_rest, 0.05)))
    surface = whole.points.copy()
    for n, ids in enumerate(whole.blocks):
        surface[ids] = turned(movement.points[one.blocks[0]], n * pitch)
    expected = made(kind, whole, 2).move(whole.points, surface[whole.surface_ids]).points
    np.testing.assert_allclose(movement.points[one.blocks[0]], expected[whole.blocks[0]], rtol=0, atol=1e-10)
    assert np.abs(movement.points - one.points).max() > 0.04


def turned(points, angle):
    """Points turned about x."""
    cos, sin = np.cos(angle), np.sin(angle)
    return points @ np.array([[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]])


def test_walls_that_are_asked_to_move_differently_on_both_sides_take_the_mean():
    mesh = mesh_of(passage(5, 6, 4))
    ties, asked = mesh.surface_ties, np.zeros((len(mesh.surface_ids), 3))
    asked[ties.originals[2]] = [0.03, 0.0, 0.0]
    moved = Rotations(mesh).move(mesh.points, mesh.points[mesh.surface_ids] + asked).points
    for row in (ties.originals[2], ties.copies[2]):
        change = (moved - mesh.points)[mesh.surface_ids[row]]
        np.testing.assert_allclose(change, [0.015, 0.0, 0.0], atol=1e-15)


def test_what_is_fixed_slides_or_is_left_out_on_one_side_is_so_on_the_other():
    grid = passage(5, 6, 4)
    whole = Window.whole(0, (5, 6, 4))
    lid = patch("farfield", whole.face(5), name="lid")
    grid = grid_of(grid.blocks[0].nodes, patches=[*grid.patches, lid])
    topology = find_topology(grid)
    mesh = mesh_of(grid)
    np.testing.assert_array_equal(mesh.is_free[mesh.ties.originals], mesh.is_free[mesh.ties.copies])
    ids = mesh.blocks[0]
    assert mesh.is_free[ids[1:-1, [0, -1], 1:-1]].all()
    assert not mesh.is_free[ids[:, [0, -1], -1]].any()  # the lid is at rest
    np.testing.assert_array_equal(mesh.is_free[ids[0, [0, -1], 1:-1]].sum(axis=-1), 2)  # planes across the axis
    fixed = moving_grid(topology, grid.to_vector().reshape(-1, 3), fixed="sides")[0]
    assert not fixed.is_free[ids[:, [0, -1]]].any()
    without = moving_grid(untied(topology), grid.to_vector().reshape(-1, 3))[0]
    assert without.ties is None
    assert not without.is_free[ids[:, [0, -1]]].any()


@pytest.mark.parametrize("motion", ["translation", "rotation"])
@pytest.mark.parametrize("walls_are_given", [False, True])
def test_nodes_of_both_sides_move_alike_with_exact_derivatives(motion, walls_are_given):
    model = fit_grid(cut_passage(motion, seed=3))
    mesh, nodes = moving_mesh(model), model.regenerate().to_vector().reshape(-1, 3)
    surface = SurfaceGrid.of(model)
    node_map = model.map_meeting(surface.rows, model) if walls_are_given else model.grid_map()
    inputs = [mesh.points + waves(mesh.points, 0.02)]
    inputs += [surface.points + waves(surface.points, 0.02)] * walls_are_given
    state, (tied,) = node_map.at(*inputs), model.topology.periodic
    assert gap_between(model.topology, tied, state.nodes) < 1e-14 * mesh.size
    assert np.abs(state.nodes - nodes).max() > 0.01
    np.testing.assert_array_equal(node_map.at(mesh.points, *[surface.points] * walls_are_given).nodes, nodes)
    rng = np.random.default_rng(5)
    changes, bar = [rng.normal(size=x.shape) for x in inputs], rng.normal(size=nodes.shape)
    forward, back = state.jvp(*changes), state.vjp(bar)
    there = sum(np.vdot(back[name], change) for name, change in zip(state.inputs, changes))
    assert np.vdot(bar, forward) == pytest.approx(there, rel=1e-12)

    def at(t):
        return node_map.at(*(x + t * change for x, change in zip(inputs, changes))).nodes

    difference = central_difference(at, 1e-3, levels=4)
    np.testing.assert_allclose(forward, difference, atol=1e-9 * np.abs(forward).max())


@pytest.mark.parametrize("motion", ["translation", "rotation"])
def test_design_variables_move_walls_on_both_sides_alike(motion):
    mesh = moving_mesh(fit_grid(passage(motion=motion), n_control=(5, 6, 4)))
    parametrization = Parametrization(mesh, [Local("hub", direction="xyz")])
    (name, initial), *_ = parametrization.initial.items()
    assert len(initial) == 3 * (5 * 6 - 5)  # those of one side follow the other
    values = np.random.default_rng(4).normal(size=len(initial))
    moved = parametrization.apply(mesh.points[mesh.surface_ids], {name: values})
    change = np.zeros(mesh.points.shape)
    change[mesh.surface_ids] = moved - mesh.points[mesh.surface_ids]
    on_hub = np.isin(mesh.ties.originals, mesh.surface_ids)
    turned_there = np.einsum("nij,nj->ni", mesh.ties.turns, change[mesh.ties.originals])[on_hub]
    np.testing.assert_allclose(turned_there, change[mesh.ties.copies[on_hub]], atol=1e-14)
    assert np.abs(turned_there).min() > 0.0


@pytest.mark.parametrize("options", [{"motion": "translation"}, {"motion": "rotation"}, {"hub": 0.0}])
def test_every_process_has_its_rows_of_the_matrix_that_tied_points_share(options):
    mesh = mesh_of(passage(5, 6, 4, **options))
    elements = LinearElasticity(mesh)._elements(mesh.points, mesh.points)
    one = Unknowns(mesh)

    def full(matrix):
        lower = np.tril(matrix.to_scipy().toarray())
        return lower + np.tril(lower, -1).T

    whole, n = full(one.matrix(elements.add_stiffness)), 0
    for rank in range(3):
        part = Unknowns(mesh, SimpleNamespace(size=3, rank=rank))
        matrix, rows = part.matrix(elements.add_stiffness), part.pattern.rows
        columns = (3 * rows[:, None] + np.arange(3)).ravel()
        expected = whole[3 * n : 3 * (n + part.pattern.n_owned)]
        found = full(matrix)[: len(expected)]
        np.testing.assert_allclose(found, expected[:, columns], atol=1e-13 * np.abs(whole).max())
        assert not np.delete(expected, columns, axis=1).any()
        n += part.pattern.n_owned
    assert n == len(one.row_ids) == len(one.point_ids) - len(one.ties.copies)


def test_a_frame_that_goes_along_leaves_tied_sides_to_the_mover():
    mesh = mesh_of(passage(5, 6, 4))
    surface = mesh.points[mesh.surface_ids] + [0.0, 0.03, 0.02]
    one, other = (
        mover.move(mesh.points, surface).points for mover in (Rotations(mesh), ComovingFrame(Rotations(mesh)))
    )
    np.testing.assert_array_equal(other, one)
