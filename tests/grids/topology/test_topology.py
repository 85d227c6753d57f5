import os
import time
from dataclasses import replace

import numpy as np
import pytest
from topology_cases import (
    ORIENTATIONS,
    PLATE_NODES,
    are_same_partition,
    box,
    c_grid,
    grid_of,
    labels_of_points,
    labels_of_rows,
    o_grid,
    patch,
    smooth_box,
    sphere_octants,
    split,
    turned_and_shuffled,
    twelve_block_plate,
    two_block_plate,
)

from bspline_mdao.errors import InputError
from bspline_mdao.generators import (
    Spacing,
    ball_grid,
    brick_grid,
    flat_plate_grid,
    infinite_wing_grid,
    naca_section,
    onera_m6_grid,
)
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.segments import MAX_SEGMENTS
from bspline_mdao.grids.topology.sharing import node_sharing
from bspline_mdao.grids.topology.topology import Topology


def labels_of(grid):
    """Topology of a grid, and the label that its links give each node."""
    topology = find_topology(grid)
    return topology, labels_of_rows(topology, node_sharing(topology))


def assert_interfaces_meet(grid, topology):
    for interface in topology.interfaces:
        a, b = (grid.blocks[side.block].nodes[side.slices] for side in (interface.a, interface.b))
        np.testing.assert_allclose(a, interface.orientation.apply(b), atol=1e-9)


def assert_faces_are_accounted_for(topology: Topology):
    """Interfaces, boundary and collapsed faces cover every cell of every face exactly once."""
    sides = [side for interface in topology.interfaces for side in (interface.a, interface.b)]
    windows = [*sides, *(face.window for face in topology.boundary), *topology.collapsed]
    for block, shape in enumerate(topology.shapes):
        for d in range(3):
            across = [t for t in range(3) if t != d]
            for end in (0, shape[d] - 1):
                covered = np.zeros([shape[t] - 1 for t in across], dtype=int)
                for window in windows:
                    if window.block == block and window.lo[d] == window.hi[d] == end:
                        covered[tuple(slice(window.lo[t], window.hi[t]) for t in across)] += 1
                assert (covered == 1).all()


@pytest.mark.parametrize("turn", ORIENTATIONS)
def test_a_split_box_has_one_interface_however_its_blocks_are_turned(turn):
    left, right = split(smooth_box(9, 5, 4), [5], [], [])
    grid = grid_of(left, turn.apply(right))
    topology, labels = labels_of(grid)
    (interface,) = topology.interfaces
    assert interface.a == Window(0, (5, 0, 0), (5, 4, 3))
    assert interface.orientation == turn.inverse()
    assert_interfaces_meet(grid, topology)
    assert_faces_are_accounted_for(topology)
    assert are_same_partition(labels, labels_of_points(grid))


CONFORMING = {  # blocks, made when asked for, then the number of interfaces, collapsed windows and segments
    "boxes": (lambda: split(smooth_box(9, 7, 8), [3, 5], [4], [2, 5]), 33, 0, 18),
    "o_grid": (lambda: [o_grid()], 1, 0, 1),
    "two_half_o_grids": (lambda: split(o_grid(), [8], [], []), 2, 0, 2),
    "cylinder_about_an_axis": (lambda: [o_grid(radius=0.0)], 1, 1, 1),
    "pie": (lambda: split(o_grid(radius=0.0, n_span=7), [4, 8, 12], [], [3]), 12, 8, 8),
    "c_grid": (lambda: [c_grid()], 1, 0, 3),
    "c_grid_with_tip": (lambda: [c_grid(span=2, n_span=6)], 2, 0, 8),
    "c_grid_with_tip_split": (lambda: split(c_grid(span=2, n_span=6), [5, 13], [], []), 4, 0, 8),
    "hollow_sphere": (lambda: sphere_octants(), 12, 8, 8),
    "full_sphere": (lambda: sphere_octants(inner=0.0), 12, 16, 8),
    "undeclared_plate": (lambda: [block.nodes for block in twelve_block_plate(False).blocks], 20, 0, 12),
    "edge_neighbours": (lambda: split(smooth_box(7, 8, 4), [3], [4], [])[::3], 0, 0, 2),
    "corner_neighbours": (lambda: split(smooth_box(7, 8, 5), [3], [4], [2])[::7], 0, 0, 2),
    "one_cell_deep": (lambda: split(smooth_box(9, 2, 6), [3, 6], [], [2]), 7, 0, 6),
    "one_node_deep": (lambda: split(smooth_box(9, 1, 6), [3, 6], [], [2]), 7, 0, 6),
    "one_node_deep_o_grid": (lambda: [o_grid(n_span=1)], 1, 0, 1),
    "one_node_deep_disc": (lambda: [o_grid(n_span=1, radius=0.0)], 1, 1, 1),
    "one_node_deep_c_grid": (lambda: [c_grid(n_span=1)], 1, 0, 3),
}


@pytest.mark.parametrize("name", CONFORMING)
def test_links_join_exactly_the_nodes_that_coincide(name):
    make, *numbers = CONFORMING[name]
    blocks = make()
    grid = grid_of(*blocks)
    topology, labels = labels_of(grid)
    assert are_same_partition(labels, labels_of_points(grid))
    assert [len(topology.interfaces), len(topology.collapsed), len(topology.segments)] == numbers
    assert topology.near_misses == ()
    assert topology.warnings == ()
    assert_interfaces_meet(grid, topology)
    if not name.startswith("one_node_deep"):
        assert_faces_are_accounted_for(topology)


@pytest.mark.parametrize(
    "make",
    [
        lambda: onera_m6_grid((7, 8, 6), Spacing(off_wall=1e-6)),
        lambda: flat_plate_grid((7, 6, 8)),
        lambda: infinite_wing_grid(naca_section(), (9, 7)),
        lambda: ball_grid((5, 6, 7, 4)),
        lambda: brick_grid((5, 6, 7, 4), octant=True),
    ],
    ids=["onera_m6", "flat_plate", "infinite_wing", "ball", "brick"],
)
def test_every_cell_of_every_face_of_a_generated_grid_is_described_once(make):
    grid = make()
    topology = find_topology(grid)
    assert topology.collapsed == ()
    assert len(topology.segments) == len(grid.blocks)
    assert_faces_are_accounted_for(topology)


@pytest.mark.slow
@pytest.mark.parametrize("name", CONFORMING)
def test_turning_and_renumbering_blocks_changes_nothing_but_numbers(name):
    make, *numbers = CONFORMING[name]
    blocks = make()
    before, labels = labels_of(grid_of(*blocks))
    for seed in range(3):
        grid, old_rows = turned_and_shuffled(grid_of(*blocks), np.random.default_rng(seed))
        topology, new_labels = labels_of(grid)
        assert are_same_partition(new_labels, labels[old_rows])
        assert [len(topology.interfaces), len(topology.collapsed), len(topology.segments)] == numbers
        assert len(topology.boundary) == len(before.boundary)


def test_a_c_grid_is_cut_where_the_wake_begins():
    topology = find_topology(grid_of(c_grid(n_wake=5, n_wing=8)))
    (interface,) = topology.interfaces
    assert interface.a == Window(0, (0, 0, 0), (5, 3, 0))
    assert interface.b == Window(0, (21, 0, 0), (26, 3, 0))
    assert interface.orientation.flip[0]
    assert [(segment.lo[0], segment.hi[0]) for segment in topology.segments] == [(0, 5), (5, 21), (21, 26)]


def test_the_fold_around_a_wing_tip_becomes_pairs_of_rectangles():
    topology = find_topology(grid_of(c_grid(n_wake=5, n_wing=8, n_span=6, span=2)))
    assert sorted((interface.a.lo, interface.a.hi) for interface in topology.interfaces) == [
        ((0, 0, 0), (5, 2, 0)),
        ((0, 2, 0), (13, 5, 0)),
    ]
    (wing,) = [face.window for face in topology.boundary if face.window.hi[2] == 0]
    assert wing == Window(0, (5, 0, 0), (21, 2, 0))
    assert len(topology.segments) == 8


def test_a_window_of_a_face_may_be_an_interface():
    nodes = smooth_box(9, 8, 7)
    grid = grid_of(nodes[:5], nodes[4:, 2:6, 1:4].transpose(1, 2, 0, 3))
    topology, labels = labels_of(grid)
    (interface,) = topology.interfaces
    assert interface.a == Window(0, (4, 2, 1), (4, 5, 3))
    assert len(topology.segments) == 9 + 1
    assert are_same_partition(labels, labels_of_points(grid))


def test_cuts_are_carried_through_interfaces():
    nodes = smooth_box(13, 8, 7)
    grid = grid_of(nodes[:4], nodes[3:7].transpose(1, 2, 0, 3)[::-1], nodes[6:9], nodes[8:, 3:])
    topology, labels = labels_of(grid)
    assert len(topology.segments) == 2 + 2 + 2 + 1
    assert are_same_partition(labels, labels_of_points(grid))


def test_faces_that_do_not_match_one_to_one_are_boundary():
    left, right = split(smooth_box(9, 5, 5), [4], [], [])
    topology = find_topology(grid_of(left, right[:, ::2, ::2]))
    assert topology.interfaces == ()
    assert len(topology.boundary) == 12
    assert topology.near_misses == ()


def test_a_face_that_nearly_meets_another_is_reported_and_is_boundary():
    left, right = split(smooth_box(9, 5, 6), [4], [], [])
    for gap, is_interface, is_reported in ((1e-6, True, False), (1e-3, False, True), (0.1, False, False)):
        shift = gap * np.linalg.norm(np.diff(left, axis=2), axis=-1).min()
        topology = find_topology(grid_of(left, right + [0.0, 0.0, shift]))
        assert len(topology.interfaces) == is_interface
        assert len(topology.near_misses) == is_reported
    topology = find_topology(grid_of(left, right + [0.0, 0.0, 1e-4]))
    (miss,) = topology.near_misses
    assert (miss.window, miss.other) == (Window(0, (4, 0, 0), (4, 4, 5)), Window(1, (0, 0, 0), (0, 4, 5)))
    assert miss.gap == pytest.approx(1e-4)
    assert 1e-4 * miss.spacing < miss.gap < 1e-2 * miss.spacing


@pytest.mark.parametrize("kind", ["wall", "symmetry", "farfield"])
def test_a_declared_face_and_the_one_it_coincides_with_are_boundary(kind):
    left, right = split(smooth_box(9, 5, 6), [4], [], [])
    window = Window.whole(1, right.shape[:3]).face(0)
    topology, labels = labels_of(grid_of(left, right, patches=[patch(kind, window, name="lid")]))
    assert topology.interfaces == ()
    assert topology.near_misses == ()
    assert [(face.window, face.kind) for face in topology.boundary if face.patch == "lid"] == [(window, kind)]
    assert Window.whole(0, left.shape[:3]).face(1) in [face.window for face in topology.boundary]
    assert len(np.unique(labels)) == len(labels)
    (warning,) = topology.warnings
    assert warning.startswith(
        f"patch 'lid' of kind {kind} on block 2 (1, 1-5, 1-6) coincides with block 1 (5, 1-5, 1-6)"
    )


@pytest.mark.parametrize("declared", [(0,), (1,), (0, 1)])
def test_nodes_that_coincide_beat_a_patch_of_no_known_kind(declared):
    blocks = split(smooth_box(9, 5, 6), [4], [], [])
    windows = [Window(0, (4, 0, 0), (4, 4, 5)), Window(1, (0, 0, 0), (0, 4, 5))]
    unknown = patch("other", *(windows[side] for side in declared), name="DEFAULT_SUBFACE")
    topology, labels = labels_of(grid_of(*blocks, patches=[unknown]))
    assert topology == find_topology(grid_of(*blocks))
    assert are_same_partition(labels, labels_of_points(grid_of(*blocks)))
    assert topology.warnings == ()


def test_what_is_left_of_a_patch_of_no_known_kind_is_boundary():
    nodes = smooth_box(9, 8, 7)
    unknown = patch("other", Window(0, (4, 0, 0), (4, 7, 6)), name="side")
    topology = find_topology(grid_of(nodes[:5], nodes[4:, 2:6, 1:4], patches=[unknown]))
    (interface,) = topology.interfaces
    assert interface.a == Window(0, (4, 2, 1), (4, 5, 3))
    left = [face.window for face in topology.boundary if face.patch == "side"]
    assert sum(np.prod([n - 1 for n in window.shape[1:]]) for window in left) == 7 * 6 - 3 * 2
    assert not any(window.overlaps(interface.a) for window in left)
    assert_faces_are_accounted_for(topology)


def test_a_wall_on_one_side_beats_a_patch_of_no_known_kind_on_the_other():
    blocks = split(smooth_box(9, 5, 6), [4], [], [])
    unknown = patch("other", Window(0, (4, 0, 0), (4, 4, 5)), name="FIN")
    wall = patch("wall", Window(1, (0, 0, 0), (0, 4, 5)), name="lid")
    topology = find_topology(grid_of(*blocks, patches=[unknown, wall]))
    assert topology.interfaces == ()
    assert {face.patch for face in topology.boundary} == {None, "FIN", "lid"}
    assert "patch 'lid' of kind wall on block 2" in topology.warnings[0]


@pytest.mark.parametrize("step", [1, -1])
def test_a_patch_of_known_kind_counts_where_one_of_no_known_kind_covers_it_too(step):
    blocks = split(smooth_box(9, 5, 6), [4], [], [])
    window = Window(1, (0, 0, 0), (0, 4, 5))
    patches = [patch("other", window, name="DEFAULT_SUBFACE"), patch("wall", window, name="lid")]
    assert find_topology(grid_of(*blocks, patches=patches[::step])).interfaces == ()


def test_the_two_walls_of_a_plate_are_not_reported():
    assert find_topology(twelve_block_plate()).warnings == ()


def connected(grid, shift=0.0, **options):
    """The grid with its topology's connections, the second block displaced, and more patches."""
    blocks = (grid.blocks[0], replace(grid.blocks[1], nodes=grid.blocks[1].nodes + shift))
    return replace(grid, blocks=blocks, connections=find_topology(grid).interfaces, **options)


def test_connections_that_the_nodes_do_not_bear_out_are_reported():
    grid = grid_of(*split(smooth_box(9, 5, 6), [4], [], []))
    assert find_topology(connected(grid)).warnings == ()
    (warning,) = find_topology(connected(grid, shift=2.0)).warnings
    assert warning == (
        "the file connects block 1 (5, 1-5, 1-6) to block 2 (1, 1-5, 1-6), whose nodes are up to 3.46 m apart: "
        "taken as boundary; mend the nodes, unless it is periodic"
    )
    wall = patch("wall", Window(1, (0, 0, 0), (0, 4, 5)), name="lid")
    (warning,) = find_topology(connected(grid, patches=(wall,))).warnings
    assert warning.startswith("patch 'lid' of kind wall")


def test_an_interface_on_a_patch_that_the_file_does_not_connect_is_reported():
    grid = grid_of(*split(smooth_box(9, 5, 6), [4], [3], []))
    interfaces = find_topology(grid).interfaces
    fin = patch("other", interfaces[0].a, interfaces[0].b, name="FIN")
    topology = find_topology(replace(grid, patches=(fin,), connections=interfaces[1:]))
    assert topology.interfaces == interfaces
    (warning,) = topology.warnings
    assert "the file does not connect them" in warning
    assert "make patch 'FIN' a wall" in warning


def plate_labels(grid):
    """Labels by point and, inside the plate and along its root, by side."""
    points = grid.to_vector().reshape(-1, 3)
    x, y, z = points.T
    (le, te), tip = PLATE_NODES[[3, 7], 0, 0, 0], PLATE_NODES[0, 4, 0, 1]
    is_inside = (np.abs(z) < 1e-9) & (x > le + 1e-9) & (x < te - 1e-9) & (y < tip - 1e-9)
    above = np.concatenate([np.full(block.nodes.size // 3, block.nodes[..., 2].mean() > 0) for block in grid.blocks])
    return labels_of_points(grid) * 2 + (is_inside & above)


@pytest.mark.parametrize("plate", [twelve_block_plate, two_block_plate])
def test_sides_of_a_declared_plate_part_inside_and_along_the_root_and_meet_at_its_edges(plate):
    grid = plate()
    topology, labels = labels_of(grid)
    assert are_same_partition(labels, plate_labels(grid))
    assert_interfaces_meet(grid, topology)


@pytest.mark.parametrize("plate", [twelve_block_plate, two_block_plate])
def test_an_undeclared_plate_is_an_interface(plate):
    grid = plate(is_declared=False)
    _, labels = labels_of(grid)
    assert are_same_partition(labels, labels_of_points(grid))


def test_sides_of_a_plate_part_where_blocks_meet_in_the_middle_of_it():
    cuts = ([3, 5, 7], [2, 4], [3])
    blocks = split(PLATE_NODES, *cuts)
    walls = [
        Window.whole(2 * (3 * i + j) + above, blocks[2 * (3 * i + j) + above].shape[:3]).face(4 if above else 5)
        for i in (1, 2)
        for j in (0, 1)
        for above in (0, 1)
    ]
    grid = grid_of(*blocks, patches=[patch("wall", *walls)])
    _, labels = labels_of(grid)
    assert are_same_partition(labels, plate_labels(grid))


@pytest.mark.slow
def test_one_declared_side_parts_both():
    declared = twelve_block_plate()
    one_side = grid_of(
        *(block.nodes for block in declared.blocks), patches=[patch("wall", declared.patches[0].windows[0])]
    )
    assert are_same_partition(labels_of(one_side)[1], labels_of(declared)[1])


def test_a_declared_window_inside_a_face_is_cut_out():
    nodes = smooth_box(9, 8, 7)
    window = Window(0, (2, 0, 3), (5, 0, 6))
    topology = find_topology(grid_of(nodes, patches=[patch("wall", window)]))
    assert len(topology.segments) == 3 * 1 * 2
    assert_faces_are_accounted_for(topology)


def test_a_collapsed_face_is_no_interface_with_the_one_it_lies_on():
    topology = find_topology(grid_of(*split(o_grid(radius=0.0), [8], [], [])))
    assert {tuple(window.hi) for window in topology.collapsed} == {(8, 0, 3)}
    assert {(collapse.section, collapse.direction) for collapse in topology.collapses} == {((None, 0, None), 0)}


def test_a_window_of_a_face_may_be_collapsed():
    i, j = np.arange(9)[:, None, None], np.arange(6)[None, :, None]
    width = np.maximum(np.abs(i - 2.0), i - 2.0) * (i > 2)
    k = np.arange(5)[None, None, :]
    nodes = np.stack(np.broadcast_arrays(i * 1.0, (width + k) * (j - 2.5), k + 0.0 * j), axis=-1)
    topology = find_topology(grid_of(nodes))
    assert topology.collapsed == (Window(0, (0, 0, 0), (2, 5, 0)),)
    assert len(topology.segments) == 2
    assert (0, (None, None, 0), 1) in [(c.segment, c.section, c.direction) for c in topology.collapses]


def test_a_collapsed_strip_one_cell_wide_is_listed_but_not_cut_out():
    nodes = box(np.arange(6.0), np.arange(5.0), np.arange(4.0))
    nodes[:, 0, 0] = nodes[:, 1, 0]
    topology = find_topology(grid_of(nodes))
    assert topology.collapsed == (Window(0, (0, 0, 0), (5, 1, 0)),)
    assert (len(topology.segments), topology.collapses) == (1, ())


def test_thin_viscous_cells_do_not_hide_an_interface():
    wall = np.concatenate(([0.0], np.cumsum(1e-6 * 1.5 ** np.arange(30))))
    grid = grid_of(*split(box(np.linspace(0, 1, 7), np.linspace(0, 1, 4), wall), [3], [], [4]))
    topology, labels = labels_of(grid)
    assert len(topology.interfaces) == 4
    assert are_same_partition(labels, labels_of_points(grid, digits=10))


def test_an_interface_is_whole_though_round_off_is_as_large_as_the_wall_spacing():
    rng = np.random.default_rng(3)
    wall = 100.0 + np.concatenate(([0.0], np.cumsum(1.5e-5 * 1.5 ** np.arange(25))))
    blocks = split(box(np.linspace(90, 91, 7), np.linspace(0, 1, 4), wall), [3], [], [])
    ulp = np.spacing(np.float32(100.0))
    noisy = [(block + rng.uniform(-0.6, 0.6, block.shape) * ulp).astype(np.float32).astype(float) for block in blocks]
    topology = find_topology(grid_of(noisy[0], noisy[1][:, ::-1].transpose(0, 2, 1, 3)))
    (interface,) = topology.interfaces
    assert interface.a == Window(0, (3, 0, 0), (3, 3, 25))
    assert len(topology.segments) == 2


@pytest.mark.slow
def test_more_segments_than_allowed_are_not_cut():
    nodes = smooth_box(5, 41, 41)
    pegs = [nodes[4:, j : j + 3, k : k + 3] + 0.0 for j in range(0, 40, 4) for k in range(0, 40, 4)]
    pegs = [np.concatenate([peg, peg + [0.5, 0.0, 0.0]]) for peg in pegs]
    topology = find_topology(grid_of(nodes, *pegs))
    assert sum(segment.block == 0 for segment in topology.segments) <= MAX_SEGMENTS
    assert 0 < len(topology.interfaces) < len(pegs)
    assert "too many segments" in topology.warnings[0]
    assert topology.warnings[-1] == f"and {len(pegs) - len(topology.interfaces) - 20} more like these"


@pytest.mark.slow
def test_a_grid_of_rubbish_is_sorted_out_quickly():
    rng = np.random.default_rng(4)
    rubbish = [rng.integers(0, 3, (25, 26, 27, 3)) for _ in range(2)]
    start = time.perf_counter()
    topology = find_topology(grid_of(*rubbish))
    assert time.perf_counter() - start < 10.0
    assert len(topology.segments) <= 2 * MAX_SEGMENTS


def test_three_faces_on_one_place_are_boundary_with_a_warning():
    left, right = split(smooth_box(9, 5, 6), [4], [], [])
    topology = find_topology(grid_of(left, right, right))
    assert all(0 not in (interface.a.block, interface.b.block) for interface in topology.interfaces)
    assert any("coincides with two or more" in warning for warning in topology.warnings)


@pytest.mark.parametrize("case", ["given twice", "folded"])
def test_blocks_on_top_of_each_other_are_reported(case):
    nodes = smooth_box(9, 5, 6)
    folded = nodes.copy()
    folded[5:] = nodes[3::-1]
    grid = grid_of(nodes, ORIENTATIONS[31].apply(nodes)) if case == "given twice" else grid_of(folded)
    topology = find_topology(grid)
    assert topology.repeated == (((0, 1),) if case == "given twice" else ())
    assert len(topology.interfaces) == len(topology.warnings) - len(topology.repeated) == 6 - (case == "folded")
    assert all("cells of both on the same side" in warning for warning in topology.warnings[len(topology.repeated) :])


def test_a_block_that_is_given_once_more_is_found_whatever_it_touches():
    left, right = split(smooth_box(9, 5, 6), [4], [], [])
    plate = Patch("plate", "wall", (Window(0, (0, 0, 0), (4, 4, 0)), Window(2, (0, 0, 0), (4, 4, 0))))
    assert find_topology(grid_of(left, right)).repeated == ()
    assert find_topology(grid_of(left, right, ORIENTATIONS[17].apply(right))).repeated == ((1, 2),)
    topology = find_topology(grid_of(left, right, left, patches=(plate,)))
    assert topology.repeated == ((0, 2),)
    assert "block 3 repeats block 1; leave one out" in topology.warnings


def test_a_block_without_extent_is_refused():
    with pytest.raises(InputError, match="all nodes of block 2 are at one point; leave it out"):
        find_topology(grid_of(smooth_box(4, 5, 6), np.ones((3, 4, 5, 3))))


def test_bad_nodes_and_patches_are_refused_in_one_line():
    nodes = smooth_box(5, 4, 3)
    broken = nodes.copy()
    broken[1, 2, 0, 1] = np.nan
    with pytest.raises(InputError, match=r"block 1 has a node that is not finite at \(2, 3, 1\)"):
        find_topology(grid_of(broken))
    for window, what in (
        (Window(1, (0, 0, 0), (0, 3, 2)), "block 2"),
        (Window(0, (1, 0, 0), (1, 3, 2)), "not on a face"),
    ):
        with pytest.raises(InputError, match=what) as error:
            find_topology(grid_of(nodes, patches=[patch("wall", window, name="lid")]))
        assert "lid" in str(error.value)
        assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_topology_holds_for_every_later_shape():
    grid = twelve_block_plate()
    moved = grid.with_vector(grid.to_vector() + 0.3 * np.sin(np.arange(3 * grid.n_nodes)))
    topology = find_topology(grid)
    assert find_topology(moved).interfaces == ()
    assert topology == find_topology(grid)
    assert topology.shapes == moved.shapes


READ_GRIDS = {
    "aither_multiblock_cylinder.xyz": (2, 0, 2),
    "aither_rae2822.xyz": (1, 0, 3),
    "aither_uniform_10blocks.xyz": (9, 0, 10),
    "cfl3d_axibump.fmt": (0, 0, 1),
    "cfl3d_cylinder_ogrid.fmt": (1, 0, 1),
    "cfl3d_delta_wing.fmt.gz": (1, 1, 4),
    "cfl3d_ejector_nozzle.p3dfmt": (2, 0, 5),
    "cfl3d_naca0012_cgrid.fmt": (1, 0, 3),
    "cfl3d_rotorstator.fmt": (12, 0, 14),
    "cfl3d_sduct.bin": (1, 2, 4),
    "hh_naca0012_12blocks.xyz": (19, 0, 12),
    "multi-ascii.xyz": (1, 0, 2),
    "nasa_vspt_turbine.xyz.gz": (2, 0, 5),
    "pyhyp_m6_9blocks.xyz": (16, 0, 9),
    "vtk_bluntfin.bin": (0, 1, 1),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", READ_GRIDS)
def test_real_grids_have_the_topology_that_their_authors_gave_them(real_grids, name):
    plot3d = pytest.importorskip("bspline_mdao.grids.io.plot3d")
    topology = find_topology(plot3d.read_plot3d(os.fspath(real_grids / name)))
    assert (len(topology.interfaces), len(topology.collapsed), len(topology.segments)) == READ_GRIDS[name]
    assert_faces_are_accounted_for(topology)
    assert topology.near_misses == ()
    assert topology.warnings == ()
