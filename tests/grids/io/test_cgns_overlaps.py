"""Periodic and overset sides that CGNS files declare, as programs write them: read, and written back untouched."""

from dataclasses import replace

import h5py
import numpy as np
import pytest
from riding_cases import add_elements, write_plane_cgns

from bspline_mdao.grids.cells.mixed_cells import MixedMesh
from bspline_mdao.grids.io.cgns import open_cgns, read_cgns, write_cgns
from bspline_mdao.grids.io.cgns_connections import periodic_of
from bspline_mdao.grids.io.cgns_nodes import add_node
from bspline_mdao.grids.io.meshes.blocks import marked_grid
from bspline_mdao.grids.io.meshes.cgns import read_cgns_mesh
from bspline_mdao.grids.io.patch_guess import guess_undeclared
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.length_unit import in_unit

SHAPE = (7, 6, 5)
SHIFT = (0.3, 0.0, 0.7)
ANGLE = 0.3


def duct(n_blocks=1, angle=0.0):
    """Blocks in a row along x whose sides kmin and kmax are plane, or turned about x by an angle."""
    i, j, k = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in SHAPE), indexing="ij")
    x, y, z = 2.0 * i + 0.1 * j * i * (1.0 - i), 1.0 + j + 0.1 * i * (1.0 - i), np.zeros_like(i)
    if angle:
        nodes = np.stack([x, y * np.cos(angle * k), y * np.sin(angle * k) + 1.5], axis=-1)
    else:
        nodes = np.stack([x, y, z], axis=-1) + k[..., None] * SHIFT
    return Grid(tuple(Block(nodes + [2.0 * n, 0.0, 0.0], f"zone {n + 1}") for n in range(n_blocks)), source="duct")


def add_periodic(node, center=(0.0, 0.0, 0.0), angle=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0), real=np.float32, unit=""):
    """Write a motion in single precision, as the CGNS library does, or as Cassiopee does, with the unit of angles."""
    periodic = add_node(
        add_node(node, "GridConnectivityProperty", "GridConnectivityProperty_t"), "Periodic", "Periodic_t"
    )
    for name, values in (("RotationCenter", center), ("RotationAngle", angle), ("Translation", shift)):
        array = add_node(periodic, name, "DataArray_t", np.array(values, real))
        if unit and name == "RotationAngle":
            stored = add_node(array, "DimensionalUnits", "DimensionalUnits_t", "x")
            del stored[" data"]
            words = "".join(word.ljust(32) for word in (*["Null"] * 4, unit))
            stored.create_dataset(" data", data=np.frombuffer(words.encode(), np.int8).reshape(5, 32))


def group_of(file, zone):
    """Where the connections of a zone are."""
    node = file[f"Base/{zone}"]
    found = node.get("ZoneGridConnectivity")
    return add_node(node, "ZoneGridConnectivity", "ZoneGridConnectivity_t") if found is None else found


def add_sides(file, zone, names, **motion):
    """Declare kmin and kmax of a zone as periodic, each with the motion to the other."""
    whole = Window.whole(0, SHAPE)
    faces = [np.array([face.lo, face.hi], np.int32) + 1 for face in (whole.face(4), whole.face(5))]
    for name, (here, there), sign in zip(names, (faces, faces[::-1]), (1.0, -1.0)):
        node = add_node(group_of(file, zone), name, "GridConnectivity1to1_t", zone)
        add_node(node, "PointRange", "IndexRange_t", here)
        add_node(node, "PointRangeDonor", "IndexRange_t", there)
        add_node(node, "Transform", '"int[IndexDimension]"', np.array([1, 2, 3], np.int32))
        signed = {key: sign * np.array(motion[key]) for key in ("angle", "shift") if key in motion}
        add_periodic(node, **{**motion, **signed})


def values_of(path):
    """All values of a file but for coordinates."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, node: found.update({name: node[()]}) if isinstance(node, h5py.Dataset) else None)
    return {name: values for name, values in found.items() if "/Coordinate" not in name}


def assert_written_back(path, copy):
    """A moved grid keeps all that its file says."""
    grid = read_cgns(path)
    topology = replace(find_topology(grid), interfaces=())
    write_cgns(copy, grid.with_vector(1.5 * grid.to_vector()), topology)
    before, after = values_of(path), values_of(copy)
    assert before.keys() == after.keys()
    for name, values in before.items():
        np.testing.assert_array_equal(after[name], values)


def test_sides_that_a_shift_lays_onto_each_other_are_one_pair_though_planar_and_of_two_blocks(tmp_path):
    path, grid = tmp_path / "grid.cgns", duct(2)
    write_cgns(path, grid)
    with h5py.File(path, "r+") as file:
        for zone in ("zone 1", "zone 2"):
            add_sides(file, zone, ("low", "high"), shift=SHIFT)
    read = read_cgns(path)
    (pair,) = read.periodic
    whole = [Window.whole(n, SHAPE) for n in range(2)]
    assert set(pair.windows) == {block.face(4) for block in whole}
    assert set(pair.others) == {block.face(5) for block in whole}
    np.testing.assert_allclose(pair.motion.shift, SHIFT, rtol=1e-14)  # nodes have more digits than the file's reals
    assert read.dialect.ignored == ()
    assert {(patch.name, patch.kind) for patch in read.patches} == {("periodic_1a", "other"), ("periodic_1b", "other")}
    assert open_cgns(path).grid([1]).periodic[0].windows == (Window.whole(0, SHAPE).face(4),)
    kinds = marked_grid(read).kinds
    assert {kinds[name].kind for name in ("periodic_1a", "periodic_1b")} == {"periodic"}
    assert "translation by (0.3, 0, 0.7)" in kinds["periodic_1a"].why
    assert kinds["periodic_1a"].sure == "sure"
    assert "(0.3, 0, 0.7) mm" in str(in_unit(read, "mm").periodic[0].motion)
    assert_written_back(path, tmp_path / "copy.cgns")


@pytest.mark.parametrize(
    ("real", "unit", "scale", "sign"),
    [(np.float32, "", 1.0, 1.0), (np.float64, "Radian", 1.0, 1.0), (np.float64, "Degree", 180.0 / np.pi, -1.0)]
    + [(np.float32, "", 180.0 / np.pi, -1.0)],
)
def test_rotations_are_those_that_lay_the_nodes_onto_each_other_whatever_the_unit_and_the_direction(
    tmp_path, real, unit, scale, sign
):
    path = tmp_path / "grid.cgns"
    write_cgns(path, duct(angle=ANGLE))
    with h5py.File(path, "r+") as file:
        motion = {"center": (0.7, 0.0, 1.5), "angle": (sign * scale * ANGLE, 0.0, 0.0)}
        add_sides(file, "zone 1", ("a", "b"), real=real, unit=unit, **motion)
    read = read_cgns(path)
    (pair,) = read.periodic
    np.testing.assert_array_equal(pair.motion.axis, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(pair.motion.point, [0.0, 0.0, 1.5], atol=1e-6)
    assert abs(pair.motion.angle - ANGLE) < 1e-6
    assert (pair.windows, pair.others) == ((Window.whole(0, SHAPE).face(4),), (Window.whole(0, SHAPE).face(5),))
    assert "rotation about x" in marked_grid(read).kinds["periodic_1b"].why


def test_half_a_turn_is_a_pair_and_a_quarter_about_two_axes_as_well(tmp_path):
    half = duct(angle=np.pi)
    low, high = (half.blocks[0].nodes[:, :, k] for k in (0, -1))
    np.testing.assert_allclose(low * [1, -1, -1] + [0, 0, 3.0], high, atol=1e-12)
    write_cgns(tmp_path / "half.cgns", half)
    with h5py.File(tmp_path / "half.cgns", "r+") as file:
        add_sides(file, "zone 1", ("a", "b"), center=(0.0, 0.0, 1.5), angle=(np.pi, 0.0, 0.0))
        there = "Base/zone 1/ZoneGridConnectivity/b/GridConnectivityProperty/Periodic/RotationAngle/ data"
        file[there][0] = np.pi  # its own inverse, as well as by -180 degrees
    (pair,) = read_cgns(tmp_path / "half.cgns").periodic
    assert (len(pair.windows), len(pair.others)) == (1, 1)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # z after x: of it all, about (1, 1, 1)
    turn = turn @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    bottom = duct().blocks[0].nodes[:, :, 0]
    k = np.linspace(0.0, 1.0, SHAPE[2])[:, None]
    nodes = (1.0 - k) * bottom[:, :, None] + k * (bottom @ turn.T)[:, :, None]
    write_cgns(tmp_path / "two.cgns", Grid((Block(nodes, "zone 1"),)))
    with h5py.File(tmp_path / "two.cgns", "r+") as file:
        add_sides(file, "zone 1", ("a", "b"), angle=(0.5 * np.pi, 0.0, 0.5 * np.pi))
    (pair,) = read_cgns(tmp_path / "two.cgns").periodic
    np.testing.assert_allclose(pair.motion.move(bottom.reshape(-1, 3)), (bottom @ turn.T).reshape(-1, 3), atol=1e-6)


def test_lists_of_nodes_that_meet_one_by_one_are_sides_and_what_no_motion_lays_onto_the_other_is_reported(tmp_path):
    path = tmp_path / "grid.cgns"
    write_cgns(path, duct(2))
    with h5py.File(path, "r+") as file:
        i, j = np.meshgrid(np.arange(1, 8), np.arange(1, 7), indexing="ij")
        low, high = (np.stack([i.ravel(), j.ravel(), np.full(i.size, k)], axis=1) for k in (1, 5))
        for zone, name, kind, shift in (
            ("zone 1", "sides", "Abutting1to1", SHIFT),
            ("zone 2", "wrong", "Abutting1to1", (0.3, 0.0, 0.6)),
            ("zone 2", "patched", "Abutting", SHIFT),
        ):
            node = add_node(group_of(file, zone), name, "GridConnectivity_t", zone)
            add_node(node, "GridConnectivityType", "GridConnectivityType_t", kind)
            add_node(node, "PointList", "IndexArray_t", low)
            add_node(node, "PointListDonor", "IndexArray_t", high)
            add_periodic(node, shift=shift)
    read = read_cgns(path)
    (pair,) = read.periodic
    assert (pair.windows, pair.others) == ((Window.whole(0, SHAPE).face(4),), (Window.whole(0, SHAPE).face(5),))
    assert [line.split("'")[1] for line in read.dialect.ignored] == ["wrong", "patched"]
    assert "is of type Abutting, not Abutting1to1" in read.dialect.ignored[1]
    assert "does not map its nodes onto the donor's" in read.dialect.ignored[0]


def overlapping(path):
    """Write a box in a larger one, whose outer faces are a far field."""
    axes = [np.linspace(-1.0, 1.0, n) for n in (7, 6, 5)], [np.linspace(-3.0, 3.0, n) for n in (9, 8, 10)]
    blocks = [
        Block(np.stack(np.meshgrid(*each, indexing="ij"), axis=-1), f"zone {n}") for n, each in enumerate(axes, 1)
    ]
    whole = Window.whole(1, blocks[1].shape)
    far = Patch("far", "farfield", tuple(whole.face(side) for side in range(6)))
    write_cgns(path, Grid(tuple(blocks), (far,)))


def test_faces_of_overset_connections_are_overset_whatever_donor_they_name(tmp_path):
    path, whole = tmp_path / "grid.cgns", Window.whole(0, SHAPE)
    overlapping(path)
    with h5py.File(path, "r+") as file:
        for face, donor in ((0, "zone 1"), (1, "zone 1,zone 2"), (5, "zone 2")):  # as Cassiopee: itself, or a list
            node = add_node(group_of(file, "zone 1"), f"overlap.{face}", "GridConnectivity_t", donor)
            ends = np.array([whole.face(face).lo, whole.face(face).hi], np.int32) + 1
            add_node(node, "PointRange", "IndexRange_t", ends)
            add_node(node, "GridConnectivityType", "GridConnectivityType_t", "Overset")
            add_node(node, "CellListDonor", "IndexArray_t", np.ones((1, 3), np.int32))
            add_node(node, "InterpolantsDonor", "DataArray_t", np.ones((1, 3)))
    read = read_cgns(path)
    assert read.patches[1] == Patch("overset", "overset", tuple(whole.face(face) for face in (0, 1, 5)))
    assert read.dialect.ignored == ()
    assert all(block.iblank is None for block in read.blocks)
    guess = marked_grid(read).kinds["overset"]
    assert (guess.kind, guess.sure) == ("inner", "sure")
    assert_written_back(path, tmp_path / "copy.cgns")


def test_points_and_holes_of_hole_cutting_are_the_blanking_by_nodes_and_by_cells(tmp_path):
    path = tmp_path / "grid.cgns"
    overlapping(path)
    with h5py.File(path, "r+") as file:
        fringe = add_node(group_of(file, "zone 1"), "fringe", "GridConnectivity_t", "zone 2")  # as SUmb
        add_node(fringe, "GridConnectivityType", "GridConnectivityType_t", "Overset")
        add_node(fringe, "GridLocation", "GridLocation_t", "CellCenter")
        cells = np.argwhere(np.arange(4)[None, None, :] + np.zeros((6, 5, 1)) == 3) + 1
        add_node(fringe, "CellListDonor", "IndexArray_t", np.ones_like(cells))
        add_node(fringe, "PointList", "IndexArray_t", cells.astype(np.int32))
        holes = add_node(group_of(file, "zone 2"), "Holes", "OversetHoles_t")
        add_node(holes, "GridLocation", "GridLocation_t", "CellCenter")
        add_node(holes, "PointList", "IndexArray_t", np.argwhere(np.ones((2, 2, 3))) + [4, 4, 5])
        ranges = add_node(group_of(file, "zone 2"), "hole#1", "OversetHoles_t")  # as the test of the CGNS library
        for number, ends in enumerate([[[1, 1, 1], [1, 8, 2]], [[9, 8, 10], [9, 7, 10]]], start=1):
            add_node(ranges, f"PointRange{number}", "IndexRange_t", np.array(ends, np.int32))
        strange = add_node(group_of(file, "zone 2"), "strange", "GridConnectivity_t", "zone 3")
        add_node(strange, "GridConnectivityType", "GridConnectivityType_t", "Overset")
        add_node(strange, "PointList", "IndexArray_t", np.array([[5, 5, 5]], np.int32))
    read = read_cgns(path)
    first, second = (block.iblank for block in read.blocks)
    expected = np.ones(SHAPE, dtype=np.int32)
    expected[:, :, -1] = -2
    np.testing.assert_array_equal(first, expected)
    expected = np.ones((9, 8, 10), dtype=np.int32)
    expected[4, 4, 5:7] = 0  # inside the cells of the hole
    expected[0, :, :2] = 0
    expected[8, 6:, 9] = 0
    np.testing.assert_array_equal(second, expected)
    assert "'strange' is no rectangle of a face, and its donor 'zone 3' is no zone" in read.dialect.ignored[0]
    (face,) = (g for g in guess_undeclared(read, find_topology(read)) if g.window == Window.whole(0, SHAPE).face(5))
    assert (face.kind, face.level) == ("overset", "sure")
    window = Window(1, (3, 3, 4), (6, 5, 7))
    np.testing.assert_array_equal(open_cgns(path).read(window).iblank, second[window.slices])
    assert_written_back(path, tmp_path / "copy.cgns")


def prisms_file(path):
    """Write a layer of prisms, of which the triangles are of no condition and the quads of four."""
    n = 4
    x, y = (values.ravel() for values in np.meshgrid(np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, n), indexing="ij"))
    ids = np.arange(n * n).reshape(n, n)
    a, b, c, d = ids[:-1, :-1].ravel(), ids[1:, :-1].ravel(), ids[1:, 1:].ravel(), ids[:-1, 1:].ravel()
    low = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    prisms = np.concatenate([low, low + n * n], axis=1)
    points = np.concatenate([np.stack([x, y, np.full_like(x, z)], axis=1) for z in (0.0, 0.4)])
    write_plane_cgns(path, [0, 1], 3)
    with h5py.File(path, "r+", track_order=True) as file:
        del file["Base"]
        base = add_node(file, "Base", "CGNSBase_t", np.array([3, 3], np.int32))
        zone = add_node(base, "zone", "Zone_t", np.array([[len(points)], [len(prisms)], [0]], np.int32))
        add_node(zone, "ZoneType", "ZoneType_t", "Unstructured")
        coordinates = add_node(zone, "GridCoordinates", "GridCoordinates_t")
        for axis, values in zip("XYZ", points.T):
            add_node(coordinates, f"Coordinate{axis}", "DataArray_t", np.ascontiguousarray(values))
        add_elements(zone, "prisms", 14, (1, 18), prisms.ravel() + 1)
        add_elements(zone, "low", 5, (19, 36), low.ravel() + 1)
        add_elements(zone, "high", 5, (37, 54), low.ravel() + n * n + 1)
        edges = np.stack([ids[0, :-1], ids[0, 1:]], axis=1)
        quads = np.concatenate([edges, edges[:, ::-1] + n * n], axis=1)
        add_elements(zone, "wall", 7, (55, 57), quads.ravel() + 1)
    return points, low, n * n


def test_faces_of_a_mesh_that_connections_declare_are_markers_with_conditions_and_without(tmp_path):
    path = tmp_path / "mesh.cgns"
    points, low, n_plane = prisms_file(path)
    with h5py.File(path, "r+") as file:
        for name, donors, ends in (("to_high", (37, 54), (19, 36)), ("to_low", (19, 36), (37, 54))):
            node = add_node(group_of(file, "zone"), name, "GridConnectivity_t", "zone")
            add_node(node, "GridConnectivityType", "GridConnectivityType_t", "Abutting1to1")
            add_node(node, "GridLocation", "GridLocation_t", "FaceCenter")
            add_node(node, "PointList", "IndexArray_t", np.arange(ends[0], ends[1] + 1)[:, None])
            add_node(node, "PointListDonor", "IndexArray_t", np.arange(donors[0], donors[1] + 1)[:, None])
            add_periodic(node, shift=(0.0, 0.0, 0.4))
    read = read_cgns_mesh(path)
    assert set(read.mesh.markers) == {"wall", "to_high", "to_low"}
    np.testing.assert_array_equal(read.mesh.markers["to_high"][:, :3], low)
    np.testing.assert_array_equal(read.mesh.markers["to_low"][:, :3], low + n_plane)
    assert read.mesh.stated["to_low"] == "Periodic"
    with h5py.File(path, "r+") as file:
        condition = add_node(add_node(file["Base/zone"], "ZoneBC", "ZoneBC_t"), "body", "BC_t", "BCWall")
        add_node(condition, "PointRange", "IndexRange_t", np.array([[55, 57]], np.int32))
        add_node(condition, "GridLocation", "GridLocation_t", "FaceCenter")
        node = file["Base/zone/ZoneGridConnectivity/to_low"]
        del node["GridConnectivityProperty"], node["GridConnectivityType"]
        add_node(node, "GridConnectivityType", "GridConnectivityType_t", "Overset")
        assert periodic_of(node) is None
    read = read_cgns_mesh(path)
    assert set(read.mesh.markers) == {"body", "to_high", "to_low"}
    assert (read.mesh.stated["to_high"], read.mesh.stated["to_low"]) == ("Periodic", "Overset")
    assert isinstance(read.mesh, MixedMesh)
    read.write(tmp_path / "same.cgns", points)
    assert (tmp_path / "same.cgns").read_bytes() == path.read_bytes()
