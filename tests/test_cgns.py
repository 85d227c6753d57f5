"""CGNS grids."""

import shutil
from dataclasses import replace

import h5py
import numpy as np
import pytest
from grid_cases import assert_same_grid, smooth_grid, smooth_nodes

from bspline_mdao.errors import InputError
from bspline_mdao.grids.cgns import read_cgns, write_cgns
from bspline_mdao.grids.cgns_nodes import add_node, set_attributes
from bspline_mdao.grids.index_space import Window
from bspline_mdao.grids.multiblock import Grid, Patch


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
    assert set(read.patches) == set(grid.patches)
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


@pytest.mark.parametrize("name", REAL_GRIDS)
def test_real_grid_is_read_whole_and_written_back_alike(real_grids, tmp_path, name):
    grid = read_cgns(real_grids / name)
    n_blocks, n_nodes, kinds = REAL_GRIDS[name]
    assert (len(grid.blocks), grid.n_nodes) == (n_blocks, n_nodes)
    assert {patch.name: patch.kind for patch in grid.patches} == kinds
    assert grid.dialect.ignored == ()
    write_cgns(tmp_path / "copy.cgns", grid)
    write_cgns(tmp_path / "new.cgns", Grid(grid.blocks, grid.patches))
    for written in ("copy.cgns", "new.cgns"):
        read = read_cgns(tmp_path / written)
        assert_same_grid(read, grid)
        assert read.patches == grid.patches
