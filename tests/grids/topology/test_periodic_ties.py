"""Sides that a motion lays onto each other are interfaces that carry it: matched, cut alike, and one set of points."""

from dataclasses import replace

import numpy as np
import pytest
from periodic_cases import PITCH, cut_passage, passage
from topology_cases import box, grid_of, patch

from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.model.fitted_model import FittedModel
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.periodic_pair import Motion, PeriodicPair
from bspline_mdao.grids.topology.periodic_ties import Ties, control_ties, gap_between, row_ties, sides_of
from bspline_mdao.grids.topology.sharing import direction_classes

MOTIONS = ("translation", "rotation")


def nodes_of(grid):
    return grid.to_vector().reshape(-1, 3)


def assert_ties_lay_nodes(grid, n_tied):
    """All nodes of both sides are tied, and copies are where the motion takes their originals."""
    topology = find_topology(grid)
    ties, nodes = row_ties(topology), nodes_of(grid)
    assert len(ties.ids) == n_tied
    np.testing.assert_allclose(ties.lay(nodes.copy()), nodes, atol=1e-12)
    assert np.linalg.norm(nodes[ties.copies] - nodes[ties.originals], axis=1).min() > 0.1
    return topology


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_block_is_tied_to_itself_across(motion):
    grid = passage(9, 8, 7, motion=motion)
    topology = assert_ties_lay_nodes(grid, 2 * 9 * 7)
    (tied,) = topology.periodic
    assert sides_of(topology, tied) == ("block 1 jmin", "block 1 jmax")
    assert tied.motion.is_translation == (motion == "translation")
    assert gap_between(topology, tied, nodes_of(grid)) < 1e-12
    off = nodes_of(grid)
    off[topology.layout.numbers[0][3, 0, 2]] += [0.0, 3e-4, -4e-4]
    assert gap_between(topology, tied, off) == pytest.approx(5e-4, rel=1e-9)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("motion", MOTIONS)
def test_sides_that_are_cut_and_turned_in_any_way_are_cut_alike_and_tied(motion, seed):
    topology = assert_ties_lay_nodes(cut_passage(motion, seed), 2 * 9 * 7)
    assert len(topology.segments) == 6  # cut at 3 and 5 on both sides
    (tied,) = topology.periodic
    assert len(tied.links) == 3
    classes = direction_classes(topology)
    assert len(np.unique(classes)) == 3 + 1 + 2  # three along the stream, one upwards, two across
    assert len(topology.boundary) == len(find_topology(cut_passage(motion, seed)).boundary)


def test_sides_of_other_nodes_are_not_tied():
    grid = passage(9, 8, 7, motion="translation")
    nodes = grid.blocks[0].nodes
    there = np.linspace(0.0, 1.0, 9)[:, None] ** 1.2
    nodes[:, -1, :, :2] = np.stack(np.broadcast_arrays(3.0 * there, 1.0 + 0.5 * np.sin(2.0 * there)), axis=-1)
    assert find_topology(grid).periodic == ()


def test_planes_that_a_file_declares_to_be_periodic_are_tied_and_those_of_a_box_are_not():
    grid = grid_of(box(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 2.0, 4), np.linspace(0.0, 3.0, 6)))
    whole = Window.whole(0, (5, 4, 6))
    grid = replace(grid, patches=(patch("wall", whole.face(4)),))
    assert find_topology(grid).periodic == ()
    pair = PeriodicPair((whole.face(2),), (whole.face(3),), Motion(shift=(0.0, 2.0, 0.0)))
    declared = replace(grid, periodic=(pair,))
    assert_ties_lay_nodes(declared, 2 * 5 * 6)
    walls = replace(declared, patches=(patch("wall", whole.face(2), whole.face(4)),))
    assert find_topology(walls).periodic == ()  # a wall is none of them, whatever the file says


def test_points_that_two_pairs_join_form_one_group():
    whole = Window.whole(0, (5, 4, 6))
    nodes = box(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 2.0, 4), np.linspace(0.0, 3.0, 6))
    shifts = (1.0, 0.0, 0.0), (0.0, 2.0, 0.0)
    pairs = (
        PeriodicPair((whole.face(2 * d),), (whole.face(2 * d + 1),), Motion(shift=shift))
        for d, shift in enumerate(shifts)
    )
    grid = replace(grid_of(nodes, patches=[patch("wall", whole.face(4))]), periodic=tuple(pairs))
    ties = row_ties(find_topology(grid))
    np.testing.assert_allclose(ties.lay(nodes_of(grid)), nodes_of(grid), atol=1e-15)
    corners = find_topology(grid).layout.numbers[0][::4, ::3, 2].ravel()
    assert (ties.originals[np.isin(ties.copies, corners)] == corners[0]).sum() == 3
    assert len(ties.copies) == 6 * (3 + 2 + 3)  # one side of each pair, and three corners of four


def test_points_on_the_axis_move_along_it_alone():
    ties = row_ties(find_topology(passage(5, 6, 4, hub=0.0)))
    nodes = nodes_of(passage(5, 6, 4, hub=0.0))
    np.testing.assert_array_equal(np.unique(np.hypot(*nodes[ties.on_axis, 1:].T)), 0.0)
    assert len(np.unique(ties.on_axis)) == 5
    random = np.random.default_rng(2).normal(size=nodes.shape)
    moved = ties.alike(random.copy())[np.unique(ties.on_axis)]
    np.testing.assert_allclose(moved[:, 1:], 0.0, atol=1e-15)
    assert np.abs(moved[:, 0]).min() > 0.01


@pytest.mark.parametrize("hub", [0.0, 2.0])
def test_what_points_do_alike_is_an_orthogonal_projection(hub):
    grid = passage(5, 6, 4, hub=hub)
    ties, rng = row_ties(find_topology(grid)), np.random.default_rng(3)
    one, other = rng.normal(size=(2, grid.n_nodes, 3))
    alike, others = ties.alike(one.copy()), ties.alike(other.copy())
    np.testing.assert_allclose(ties.alike(alike.copy()), alike, atol=1e-14)
    assert np.vdot(alike, other) == pytest.approx(np.vdot(one, others), rel=1e-12)
    turn = np.array([[1, 0, 0], [0, np.cos(PITCH), -np.sin(PITCH)], [0, np.sin(PITCH), np.cos(PITCH)]])
    np.testing.assert_allclose(alike[ties.originals] @ turn.T, alike[ties.copies], atol=1e-14)
    shift = 0.3 * np.eye(3)[0]
    np.testing.assert_allclose(ties.alike(np.tile(shift, (grid.n_nodes, 1))), np.tile(shift, (grid.n_nodes, 1)))


def test_groups_that_are_not_there_as_a_whole_are_left_out():
    motion = Motion(shift=(1.0, 0.0, 0.0))
    ties = Ties.of([(np.array([3, 5]), np.array([7, 9]), motion), (np.array([7]), np.array([8]), motion)])
    np.testing.assert_array_equal(ties.groups_of(np.array([8])), [3, 7, 8])
    numbers = np.full(10, -1)
    numbers[[3, 5, 7, 9]] = [1, 2, 0, 4]
    left = ties.numbered(numbers)
    np.testing.assert_array_equal(np.stack([left.originals, left.copies]), [[2], [4]])


@pytest.mark.parametrize("method", ["valid", "least_squares", "quasi_interpolant"])
@pytest.mark.parametrize("motion", MOTIONS)
def test_a_fit_gives_both_sides_the_same_control_points_and_residual_but_for_the_motion(motion, method, tmp_path):
    grid = cut_passage(motion, seed=4)
    model = fit_grid(grid, method=method)
    ties, points = control_ties(model.topology, model.mesh.control_ids), model.control_points
    np.testing.assert_array_equal(ties.lay(points.copy()), points)
    np.testing.assert_allclose(model.regenerate().to_vector(), grid.to_vector(), atol=1e-15)
    of_nodes = row_ties(model.topology)
    turned = np.einsum("nij,nj->ni", of_nodes.turns, model.residual[of_nodes.originals])
    np.testing.assert_allclose(turned, model.residual[of_nodes.copies], atol=1e-14)
    assert np.abs(turned).max() > 1e-6
    model.save(tmp_path / "passage.h5")
    assert FittedModel.load(tmp_path / "passage.h5").topology == model.topology
