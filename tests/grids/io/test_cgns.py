"""CGNS grids."""

import shutil
import subprocess
from dataclasses import replace

import h5py
import numpy as np
import pytest
import tomlkit
from grid_cases import assert_same_grid, smooth_grid, smooth_nodes
from topology_cases import (
    c_grid,
    connected_rows,
    declared_connections,
    grid_of,
    o_grid,
    smooth_box,
    sphere_octants,
    split,
    turned_and_shuffled,
)

from bspline_mdao import family_member, fit_grid, write_grid
from bspline_mdao.core.evaluation.family import refined_topology
from bspline_mdao.errors import InputError
from bspline_mdao.generators import flat_plate_grid, onera_m6_grid
from bspline_mdao.grids.io.cgns import CgnsDialect, read_cgns, write_cgns
from bspline_mdao.grids.io.cgns_nodes import add_node, children, set_attributes, word
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.studio.cli.inspect import inspect_grid


def patched_grid():
    """A grid with three patches, one of them on a part of a face."""
    grid = smooth_grid(((4, 5, 6), (6, 4, 5)))
    whole = [Window.whole(block, shape) for block, shape in enumerate(grid.shapes)]
    patches = (
        Patch("wing", "wall", (whole[0].face(4), Window(1, (1, 0, 2), (5, 0, 4)))),
        Patch("plane", "symmetry", (whole[1].face(5),)),
        Patch("rim", "farfield", (whole[0].face(1), whole[1].face(1))),
    )
    return replace(grid, patches=patches)


def refusal(path):
    with pytest.raises(InputError) as caught:
        read_cgns(path)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_new_file_holds_nodes_names_and_patches(tmp_path):
    grid = patched_grid()
    write_cgns(tmp_path / "grid.cgns", grid)
    read = read_cgns(tmp_path / "grid.cgns")
    assert_same_grid(read, grid)
    assert read.patches == grid.patches
    assert [block.name for block in read.blocks] == ["block 1", "block 2"]


def test_flat_grid_becomes_two_dimensional_zones(tmp_path):
    grid = smooth_grid(((4, 5, 1), (6, 4, 1)))
    write_cgns(tmp_path / "grid.cgns", grid)
    assert_same_grid(read_cgns(tmp_path / "grid.cgns"), grid)


def test_zone_names_that_repeat_or_are_too_long_do_not_collide(tmp_path):
    grid = patched_grid()
    blocks = tuple(replace(block, name="wing" + "/" * 40) for block in grid.blocks)
    write_cgns(tmp_path / "grid.cgns", replace(grid, blocks=blocks))
    read = read_cgns(tmp_path / "grid.cgns")
    assert_same_grid(read, grid)
    assert {patch.windows for patch in read.patches} == {patch.windows for patch in grid.patches}


def test_copy_replaces_coordinates_and_keeps_everything_else(tmp_path):
    path = tmp_path / "grid.cgns"
    write_cgns(path, patched_grid())
    with h5py.File(path, "r+") as file:
        add_node(file["Base/block 1"], "Notes", "Descriptor_t", "kept")
    grid = read_cgns(path)
    moved = grid.with_vector(grid.to_vector() * 2.0)
    write_cgns(tmp_path / "moved.cgns", moved)
    read = read_cgns(tmp_path / "moved.cgns")
    assert_same_grid(read, moved)
    assert read.patches == grid.patches
    with h5py.File(tmp_path / "moved.cgns") as file:
        assert file["Base/block 1/Notes/ data"][()].tobytes() == b"kept"
    assert_same_grid(read_cgns(path), grid)


def test_grid_is_not_written_back_when_its_file_has_changed(tmp_path):
    path = tmp_path / "grid.cgns"
    write_cgns(path, smooth_grid())
    grid = read_cgns(path)
    write_cgns(path, smooth_grid(((4, 5, 6),)))
    with pytest.raises(InputError, match="has changed"):
        write_cgns(tmp_path / "out.cgns", grid)
    path.unlink()
    with pytest.raises(InputError, match="is gone"):
        write_cgns(tmp_path / "out.cgns", grid)
    assert list(tmp_path.iterdir()) == []


def hand_written(path, names, track_order):
    with h5py.File(path, "w", track_order=track_order) as file:
        base = file.create_group("Base", track_order=track_order)
        set_attributes(base, "Base", "CGNSBase_t", "I4")
        base[" data"] = np.array([3, 3], np.int32)
        for number, name in enumerate(names):
            nodes = smooth_nodes((2, 3, 4), number)
            zone = add_node(base, name, "Zone_t", np.array([[2, 3, 4], [1, 2, 3], [0, 0, 0]], np.int32))
            add_node(zone, "ZoneType", "ZoneType_t", "Structured")
            coordinates = add_node(zone, "GridCoordinates", "GridCoordinates_t")
            for axis, letter in enumerate("XYZ"):
                add_node(coordinates, f"Coordinate{letter}", "DataArray_t", nodes[..., axis].T.astype(np.float32))


def test_zones_come_in_order_of_creation_or_else_of_their_numbers(tmp_path):
    names = ["zone 10", "zone 9", "zone 100"]
    hand_written(tmp_path / "tracked", names, True)
    assert [block.name for block in read_cgns(tmp_path / "tracked").blocks] == names
    hand_written(tmp_path / "plain", names, False)
    read = read_cgns(tmp_path / "plain")
    assert [block.name for block in read.blocks] == ["zone 9", "zone 10", "zone 100"]
    assert [block.nodes[0, 0, 0, 0] for block in read.blocks] == [1.0, 0.0, 2.0]


def test_links_are_followed_and_resolved_when_written(tmp_path):
    hand_written(tmp_path / "target.cgns", ["zone 1"], True)
    shutil.copy(tmp_path / "target.cgns", tmp_path / "linked.cgns")
    with h5py.File(tmp_path / "linked.cgns", "r+") as file:
        del file["Base/zone 1/GridCoordinates"]
        link = file["Base/zone 1"].create_group("GridCoordinates")
        set_attributes(link, "GridCoordinates", "", "LK")
        link[" link"] = h5py.ExternalLink("target.cgns", "/Base/zone 1/GridCoordinates")
    grid = read_cgns(tmp_path / "linked.cgns")
    target = read_cgns(tmp_path / "target.cgns")
    assert_same_grid(grid, target)
    moved = grid.with_vector(np.float32(2.0) * grid.to_vector())
    write_cgns(tmp_path / "moved.cgns", moved)
    assert_same_grid(read_cgns(tmp_path / "target.cgns"), target)
    (tmp_path / "target.cgns").unlink()
    assert_same_grid(read_cgns(tmp_path / "moved.cgns"), moved)
    assert "linked to" in refusal(tmp_path / "linked.cgns")


@pytest.mark.parametrize(
    ("bc_type", "kind"),
    [
        ("BCWallViscousHeatFlux", "wall"),
        ("BCSymmetryPlane", "symmetry"),
        ("BCOutflowSubsonic", "farfield"),
        ("BCExtrapolate", "other"),
    ],
)
def test_conditions_given_as_lists_of_points_or_cell_faces_are_face_windows(tmp_path, bc_type, kind):
    path = tmp_path / "grid.cgns"
    write_cgns(path, smooth_grid(((4, 5, 6),)))
    nodes = np.array([(i, j, 1) for i in (2, 3, 4) for j in (1, 2)], np.int32)
    with h5py.File(path, "r+") as file:
        zone_bc = add_node(file["Base/block 1"], "ZoneBC", "ZoneBC_t")
        by_nodes = add_node(zone_bc, "nodes", "BC_t", bc_type)
        add_node(by_nodes, "PointList", "IndexArray_t", nodes)
        by_cells = add_node(zone_bc, "cells", "BC_t", bc_type)
        add_node(by_cells, "PointRange", "IndexRange_t", np.array([[1, 2, 6], [3, 4, 6]], np.int32))
        add_node(by_cells, "GridLocation", "GridLocation_t", "KFaceCenter")
        scattered = add_node(zone_bc, "scattered", "BC_t", bc_type)
        add_node(scattered, "PointList", "IndexArray_t", nodes[[0, 1, 4, 5]])
    grid = read_cgns(path)
    assert grid.patches == (
        Patch("nodes", kind, (Window(0, (1, 0, 0), (3, 1, 0)),)),
        Patch("cells", kind, (Window(0, (0, 1, 5), (3, 4, 5)),)),
    )
    assert len(grid.dialect.ignored) == 1
    assert "'scattered'" in grid.dialect.ignored[0]


ICEM_NAMES = {
    "BC_WALL": "wall",
    "BC_INFLOW": "farfield",
    "bc-outflow_2": "farfield",
    "SYMM": "symmetry",
    "FAR": "farfield",
    "DEFAULT_SUBFACE": "other",
}


def test_conditions_say_themselves_what_they_are_beside_their_families(tmp_path):
    """ADflow gives surfaces the names of their families only so."""
    grid = smooth_grid(((4, 5, 6),))
    faces = {0: "wall", 2: "symmetry", 3: "farfield", 4: "overset", 5: "other"}
    patches = tuple(Patch(f"part {n}", kind, (Window.whole(0, (4, 5, 6)).face(n),)) for n, kind in faces.items())
    write_cgns(tmp_path / "grid.cgns", replace(grid, patches=patches))
    with h5py.File(tmp_path / "grid.cgns") as file:
        [(_, zone)] = children(file["Base"], "Zone_t")
        conditions = [condition for _, condition in children(zone["ZoneBC"], "BC_t")]
        told = [word(condition) for condition in conditions]
        names = [word(condition["FamilyName"]) for condition in conditions]
    assert told[:3] == ["BCWall", "BCSymmetryPlane", "BCFarfield"]
    assert told[3:] == ["FamilySpecified"] * 2
    assert names == [patch.name for patch in patches]
    assert [(p.name, p.kind) for p in read_cgns(tmp_path / "grid.cgns").patches] == [(p.name, p.kind) for p in patches]


@pytest.mark.parametrize("bc_type", ["UserDefined", "Null", "FamilySpecified"])
def test_kinds_are_those_of_family_names_where_the_type_says_nothing(tmp_path, bc_type):
    path = tmp_path / "grid.cgns"
    grid = smooth_grid(((4, 5, 6),))
    write_cgns(path, grid)
    with h5py.File(path, "r+") as file:
        for face, name in enumerate(ICEM_NAMES):
            add_condition(file["Base/block 1"], Window.whole(0, (4, 5, 6)).face(face), name, bc_type)
    assert {patch.name: patch.kind for patch in read_cgns(path).patches} == ICEM_NAMES


def add_condition(zone, window, family, bc_type="UserDefined"):
    """A boundary condition as ICEM writes it."""
    zone_bc = zone.get("ZoneBC") or add_node(zone, "ZoneBC", "ZoneBC_t")
    condition = add_node(zone_bc, f"SUBFACE {len(zone_bc) + 1}", "BC_t", bc_type)
    add_node(condition, "PointRange", "IndexRange_t", np.array([window.lo, window.hi], np.int32) + 1)
    add_node(condition, "FamilyName", "FamilyName_t", family)


def as_icem_writes_it(path, shapes):
    """Put a condition of no known kind on every face of every zone of a file."""
    with h5py.File(path, "r+") as file:
        zones = [zone for _, base in children(file, "CGNSBase_t") for _, zone in children(base, "Zone_t")]
        for block, (zone, shape) in enumerate(zip(zones, shapes)):
            for face in range(6):
                add_condition(zone, Window.whole(block, shape).face(face), "DEFAULT_SUBFACE")


@pytest.mark.slow
@pytest.mark.parametrize("has_connectivity", [True, False])
def test_all_blocks_of_a_file_of_icem_hang_together(tmp_path, has_connectivity):
    path = tmp_path / "icem.cgns"
    grid = grid_of(*split(smooth_box(9, 7, 8), [3, 5], [4], []))
    write_cgns(path, grid)
    if not has_connectivity:
        with h5py.File(path, "r+") as file:
            for _, zone in children(file["Base"], "Zone_t"):
                del zone["ZoneGridConnectivity"]
    expected = find_topology(grid)
    as_icem_writes_it(path, grid.shapes)
    topology = find_topology(read_cgns(path))
    assert topology.interfaces == expected.interfaces
    assert len(topology.interfaces) == 7
    assert (topology.links, topology.segments, topology.warnings) == (expected.links, expected.segments, ())
    assert {face.patch for face in topology.boundary} == {"DEFAULT_SUBFACE"}
    assert len(topology.boundary) == len(expected.boundary)


def test_inspect_tells_boundary_from_interfaces_of_one_patch_and_drafts_the_boundary(tmp_path, capsys):
    path, draft = tmp_path / "icem.cgns", tmp_path / "draft.toml"
    grid = grid_of(*split(smooth_box(9, 7, 8), [5], [], []))
    write_cgns(path, grid)
    as_icem_writes_it(path, grid.shapes)
    inspect_grid(str(path), None, draft, None)
    said = " ".join(capsys.readouterr().out.split())
    assert "DEFAULT_SUBFACE interface 2 block 1 imax, block 2 imin" in said
    assert "1 interface, 10 boundary faces" in said
    (patch,) = tomlkit.parse(draft.read_text())["patch"]
    assert len(patch["faces"]) == 10


def test_five_blocks_of_icem_have_the_eleven_interfaces_that_the_file_declares(real_grids, tmp_path):
    path = tmp_path / "icem.cgns"
    shutil.copy(real_grids / "cgns_5blocks.cgns", path)
    as_icem_writes_it(path, read_cgns(path).shapes)
    grid = read_cgns(path)
    topology = find_topology(grid)
    assert (len(topology.interfaces), len(grid.connections), topology.warnings) == (11, 11, ())
    assert topology.node_ids()[0].max() < topology.n_nodes - 1


def hub(n_around=13):
    """Two octants of a ball and half a disc about its axis: faces with collapsed edges, to lines and to points."""
    return grid_of(*sphere_octants(inner=0.0)[:2], *split(o_grid(n_around, radius=0.0), [6], [], []))


WRITTEN_GRIDS = {
    "M6 wing": lambda: onera_m6_grid((7, 8, 6)),
    "plate": lambda: flat_plate_grid((7, 8, 6)),
    "O-grid": lambda: grid_of(o_grid()),
    "C-grid with a tip": lambda: grid_of(c_grid(span=2, n_span=6)),
    "C-grid with a tip, cut": lambda: grid_of(*split(c_grid(span=2, n_span=6), [5, 13], [], [])),
    "boxes": lambda: grid_of(*split(smooth_box(9, 7, 8), [3, 5], [4], [2, 5])),
    "part of a face": lambda: grid_of(smooth_box(9, 8, 7)[:5], smooth_box(9, 8, 7)[4:, 2:6, 1:4]),
    "balls and axes": hub,
    "full sphere": lambda: grid_of(*sphere_octants(inner=0.0)),
}


def turned(grid, seed):
    """The grid with its blocks turned and renumbered, where it has no patches."""
    return grid if grid.patches else turned_and_shuffled(grid, np.random.default_rng(seed))[0]


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITTEN_GRIDS)
def test_interfaces_are_written_as_the_standard_asks_and_read_back(tmp_path, name):
    grid = turned(WRITTEN_GRIDS[name](), seed=5)
    topology = find_topology(grid)
    write_grid(tmp_path / "grid.cgns", grid)
    read = read_cgns(tmp_path / "grid.cgns")
    assert (read.connections, read.patches, read.dialect.ignored) == (topology.interfaces, grid.patches, ())
    assert replace(find_topology(read), source=topology.source) == topology
    zones, nodes, links = declared_connections(tmp_path / "grid.cgns")
    assert len(links) == 2 * len(topology.interfaces) > 0
    assert zones == [block.name for block in grid.blocks]
    for zone, a_range, donor, b_range, transform in links:
        here, there = (nodes[zones.index(end)] for end in (zone, donor))
        np.testing.assert_allclose(*connected_rows(here, there, a_range, b_range, transform), atol=1e-8)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("cgnscheck"), reason="needs cgnscheck of the CGNS tools")
@pytest.mark.parametrize("name", WRITTEN_GRIDS)
def test_cgnscheck_finds_nothing_wrong(tmp_path, name):
    write_grid(tmp_path / "grid.cgns", turned(WRITTEN_GRIDS[name](), seed=6))
    checked = subprocess.run(["cgnscheck", tmp_path / "grid.cgns"], capture_output=True, text=True, check=True)
    assert "ERROR" not in checked.stdout + checked.stderr
    assert "WARNING" not in checked.stdout + checked.stderr


def node_values(path, label):
    """Values of all nodes of a label whose value is a word."""
    found = []
    with h5py.File(path) as file:
        file.visititems(lambda _, node: found.append(word(node)) if node.attrs.get("label") == label else None)
    return found


def test_collapsed_faces_are_written_as_degenerate_lines_and_points(tmp_path):
    grid = hub()
    write_cgns(tmp_path / "grid.cgns", grid)
    types = node_values(tmp_path / "grid.cgns", b"BC_t")
    assert sorted(types) == ["BCDegenerateLine"] * 4 + ["BCDegeneratePoint"] * 2
    axis = next(window for window in find_topology(grid).collapsed if window.block == 2)
    write_cgns(tmp_path / "grid.cgns", replace(grid, patches=(Patch("axis", "other", (axis,)),)))
    assert sorted(node_values(tmp_path / "grid.cgns", b"BC_t")).count("BCDegenerateLine") == 3


@pytest.mark.slow
def test_a_moved_grid_is_written_with_the_interfaces_of_the_baseline(tmp_path):
    grid = WRITTEN_GRIDS["boxes"]()
    topology = find_topology(grid)
    apart = grid.with_vector(grid.to_vector() + 0.1 * np.repeat(np.arange(grid.n_nodes), 3))
    write_grid(tmp_path / "grid.cgns", apart, topology)
    assert read_cgns(tmp_path / "grid.cgns").connections == topology.interfaces


def test_a_finer_member_of_a_grid_from_cgns_is_a_new_file(tmp_path):
    baseline = grid_of(
        *split(smooth_box(9, 8, 6), [4], [], []), patches=[Patch("lid", "wall", (Window(0, (0, 0, 0), (4, 7, 0)),))]
    )
    write_cgns(tmp_path / "grid.cgns", baseline)
    model = fit_grid(read_cgns(tmp_path / "grid.cgns"))
    topology = refined_topology(model.topology, 2.0)
    write_grid(tmp_path / "fine.cgns", family_member(model, 2.0), topology)
    fine = read_cgns(tmp_path / "fine.cgns")
    assert fine.shapes == ((9, 15, 11), (9, 15, 11))
    assert fine.patches == (Patch("lid", "wall", (Window(0, (0, 0, 0), (8, 14, 0)),)),)
    assert find_topology(fine).interfaces == fine.connections == topology.interfaces
    assert isinstance(family_member(model, 1.0).dialect, CgnsDialect)


@pytest.mark.slow
@pytest.mark.parametrize("n_kept", [0, 1])
def test_a_copy_gets_the_connections_that_its_file_lacks(tmp_path, n_kept):
    path = tmp_path / "grid.cgns"
    grid = grid_of(*split(smooth_box(9, 7, 8), [5], [4], []))
    write_cgns(path, grid)
    with h5py.File(path, "r+") as file:
        for _, zone in children(file["Base"], "Zone_t")[n_kept:]:
            del zone["ZoneGridConnectivity"]
    read = read_cgns(path)
    assert len(read.connections) == 2 * n_kept
    write_cgns(tmp_path / "copy.cgns", read)
    copy = read_cgns(tmp_path / "copy.cgns")
    assert set(copy.connections) == set(find_topology(grid).interfaces)
    write_cgns(tmp_path / "again.cgns", copy)
    assert len(node_values(tmp_path / "again.cgns", b"GridConnectivity1to1_t")) == 8 - 2 * n_kept


@pytest.mark.slow
def test_connections_that_fit_no_zone_or_have_no_periodic_motion_are_reported(tmp_path):
    path = tmp_path / "grid.cgns"
    write_cgns(path, WRITTEN_GRIDS["boxes"]())
    with h5py.File(path, "r+") as file:
        first, second, third = (node for _, node in connections_of(file["Base/block 1"]))
        add_node(add_node(first, "Property", "GridConnectivityProperty_t"), "Periodic", "Periodic_t")
        second[" data"][:1] = ord("x")
        third["Transform/ data"][:] = [1, 1, 3]
    read = read_cgns(path)
    assert len(read.connections) == 33
    assert [line.split("'")[1] for line in read.dialect.ignored] == ["Interface3", "Interface5", "Interface1"]
    assert read.periodic == ()


def connections_of(zone):
    return [item for _, group in children(zone, "ZoneGridConnectivity_t") for item in children(group, CONNECTION)]


CONNECTION = "GridConnectivity1to1_t"


def test_a_condition_that_does_not_go_with_its_name_counts_and_is_reported(tmp_path):
    grid = replace(patched_grid(), patches=(Patch("BC_INFLOW", "wall", (Window(0, (0, 0, 0), (3, 4, 0)),)),))
    write_cgns(tmp_path / "grid.cgns", grid)
    read = read_cgns(tmp_path / "grid.cgns")
    assert read.patches == grid.patches
    (warning,) = find_topology(read).warnings
    assert warning == "patch 'BC_INFLOW' is of kind wall by its condition, though its name says farfield"


@pytest.mark.parametrize("name", ["wall", "fin"])
def test_a_patch_of_no_known_kind_stays_one_whatever_its_name(tmp_path, name):
    grid = replace(patched_grid(), patches=(Patch(name, "other", (Window(0, (0, 0, 0), (3, 4, 0)),)),))
    write_cgns(tmp_path / "grid.cgns", grid)
    assert read_cgns(tmp_path / "grid.cgns").patches == grid.patches


def test_what_cannot_be_read_is_refused_in_one_true_line(tmp_path):
    path = tmp_path / "grid.cgns"

    def broken(change):
        write_cgns(path, smooth_grid())
        with h5py.File(path, "r+") as file:
            change(file)
        return refusal(path)

    def replace_data(name, data):
        def change(file):
            del file[name]
            file[name] = data

        return change

    unstructured = np.frombuffer(b"Unstructured", np.int8)
    assert "not structured" in broken(replace_data("Base/block 1/ZoneType/ data", unstructured))
    huge = np.array([[2**30] * 3, [2**30 - 1] * 3, [0] * 3])
    assert "announces" in broken(replace_data("Base/block 1/ data", huge))
    coordinate = "Base/block 2/GridCoordinates/CoordinateY/ data"
    assert "CoordinateY" in broken(replace_data(coordinate, np.zeros((4, 3, 2))))
    bad = smooth_grid().blocks[1].nodes[..., 1].T.copy()
    bad[2, 1, 3] = np.nan
    assert "block 2: node (4, 2, 3) has y = nan" in broken(replace_data(coordinate, bad))
    assert "Cartesian" in broken(lambda file: file.move(coordinate[:-6], coordinate[:-7] + "R"))
    assert "without a CGNS base" in broken(lambda file: file.__delitem__("Base"))


REAL_GRIDS = {
    "cgns_5blocks.cgns": (5, 2_620, {}),
    "cgns_nozzle.cgns": (12, 15_228, {"inflow": "farfield", "sym": "symmetry", "wall": "wall", "outflow": "farfield"}),
    "mach_naca0012.cgns": (1, 63_210, {"wall": "wall", "Far": "farfield", "Sym": "symmetry"}),
    "hopr_sphere_20blocks.cgns": (
        20,
        28_616,
        dict.fromkeys(["BC_inflow", "BC_mantel", "BC_outflow", "BC_sphere"], "wall"),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL_GRIDS)
def test_real_grid_is_read_whole_and_written_back_alike(real_grids, tmp_path, name):
    grid = read_cgns(real_grids / name)
    n_blocks, n_nodes, kinds = REAL_GRIDS[name]
    assert (len(grid.blocks), grid.n_nodes) == (n_blocks, n_nodes)
    assert {patch.name: patch.kind for patch in grid.patches} == kinds
    doubtful = [line.split("'")[1] for line in grid.dialect.ignored]
    assert doubtful == (["BC_inflow", "BC_outflow"] if name.startswith("hopr") else [])
    write_cgns(tmp_path / "copy.cgns", grid)
    write_cgns(tmp_path / "new.cgns", Grid(grid.blocks, grid.patches))
    for written in ("copy.cgns", "new.cgns"):
        read = read_cgns(tmp_path / written)
        assert_same_grid(read, grid)
        assert read.patches == grid.patches
