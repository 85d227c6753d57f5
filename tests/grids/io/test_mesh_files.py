"""Meshes of CGNS and OpenFOAM: what is read, what is kept, what is refused."""

import gzip
import re

import h5py
import numpy as np
import pytest
from riding_cases import BOX, binary_folder, corners_of, mesh, su2_text, write_boxes_cgns

from bspline_mdao import InputError, fit_grid
from bspline_mdao.files import read_mesh, write_curved_grid, write_polymesh
from bspline_mdao.generators import brick_grid
from bspline_mdao.grids.cells.mesh_quality import mesh_quality
from bspline_mdao.grids.io.cgns import write_base
from bspline_mdao.grids.io.cgns_nodes import add_node
from bspline_mdao.grids.io.meshes import text_numbers
from bspline_mdao.grids.io.meshes.foam_lists import FoamFile
from bspline_mdao.meshes import MixedMesh
from bspline_mdao.splines import curved_grid


@pytest.fixture
def folder(tmp_path):
    write_polymesh(tmp_path / "polyMesh", brick_grid((5, 4, 6, 3)))
    (tmp_path / "polyMesh" / "cellZones").write_text("0\n(\n)\n")
    return tmp_path / "polyMesh"


@pytest.fixture
def cgns(tmp_path):
    write_boxes_cgns(tmp_path / "boxes.cgns")
    return tmp_path / "boxes.cgns"


def test_polyhedra_of_openfoam_have_the_volumes_of_the_blocks(folder):
    mesh = read_mesh(folder).mesh
    blocks = brick_grid((5, 4, 6, 3)).blocks
    volumes = [
        MixedMesh(b.nodes.reshape(-1, 3), {"hexahedron": corners_of(np.arange(b.nodes[..., 0].size).reshape(b.shape))})
        .quality()
        .volumes
        for b in blocks
    ]
    np.testing.assert_allclose(mesh.quality().volumes, np.abs(np.concatenate(volumes)), rtol=1e-12)
    assert len(mesh.markers["body"]) == len(mesh.into_fluid(mesh.markers["body"])) > 0


def test_the_folder_keeps_all_but_points(folder):
    read = read_mesh(folder)
    read.write(folder.parent / "moved" / "polyMesh", read.mesh.points * [1.0, 2.0, 1.0])
    moved = folder.parent / "moved" / "polyMesh"
    assert {path.name for path in moved.iterdir()} == {path.name for path in folder.iterdir()}
    for path in folder.iterdir():
        assert (path.read_bytes() == (moved / path.name).read_bytes()) == (path.name != "points")
    np.testing.assert_array_equal(read_mesh(moved).mesh.points, read.mesh.points * [1.0, 2.0, 1.0])
    read.write(moved, read.mesh.points)
    assert (moved / "points").read_bytes() == (folder / "points").read_bytes()


@pytest.mark.parametrize("piece", [4, 61, 1000])
def test_texts_that_are_taken_in_pieces_give_what_they_give_as_a_whole(folder, piece, monkeypatch):
    (folder.parent / "wing.su2").write_text(su2_text(mesh()))
    for path in (folder, folder.parent / "wing.su2"):
        whole = read_mesh(path)
        points = whole.mesh.points + np.random.default_rng(2).normal(size=whole.mesh.points.shape)
        points[::3] = whole.mesh.points[::3]
        for name, size in (("whole", text_numbers.PIECE), ("parts", piece)):
            monkeypatch.setattr(text_numbers, "PIECE", size)
            read = read_mesh(path)
            np.testing.assert_array_equal(read.mesh.points, whole.mesh.points)
            for found, expected in zip(read.mesh.cell_faces, whole.mesh.cell_faces):
                np.testing.assert_array_equal(found, expected)
            read.write(folder.parent / name / path.name, points)
        files = [(folder.parent / name / path.name) for name in ("whole", "parts")]
        first, second = ((file / "points" if file.is_dir() else file).read_bytes() for file in files)
        assert first == second
        monkeypatch.undo()


def test_faces_of_many_corners_are_cut_into_fans(folder):
    hexagon = [[np.cos(a), np.sin(a), z] for z in (0.0, 2.0) for a in np.arange(6) * np.pi / 3]
    sides = [f"4({k} {(k + 1) % 6} {(k + 1) % 6 + 6} {k + 6})" for k in range(6)]
    head = (folder / "points").read_text().partition("}")[0] + "}\n"
    texts = {
        "points": "12\n(\n" + "\n".join(f"({x!r} {y!r} {z!r})" for x, y, z in np.array(hexagon).tolist()) + "\n)\n",
        "faces": "8\n(\n6(0 5 4 3 2 1)\n6(6 7 8 9 10 11) // the lid\n" + "\n".join(sides) + "\n)\n",
        "owner": "8\n(\n0 0 0 0 0 0 0 0\n)\n",
        "neighbour": "0\n(\n)\n",
        "boundary": "1\n(\n wall { type wall; nFaces 8; startFace 0; }\n)\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(head + text)
    mesh = read_mesh(folder).mesh
    assert mesh.quality().volumes == pytest.approx([3.0 * 3.0**0.5])
    assert {name: len(faces) for name, faces in mesh.markers.items()} == {"wall": 14}


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        (
            "points",
            "format ascii",
            "format binary",
            "points: is binary, and its numbers do not end where 'LSB;label=32;",
        ),
        ("faces", "format ascii", "format binary", "is binary, of class faceList; write it as faceCompactList"),
        ("points", "format ascii;", 'format binary; arch "LSB";', "points: is binary of an unknown arch 'LSB'"),
        ("faces", "class faceList", "class faceCompactList", "faces: "),
        ("owner", "\n0\n", "\nx\n", "owner: is no list of whole numbers"),
        ("owner", "\n0\n", "\n-1000000000\n", "polyMesh: a face is of cell -1000000000"),
        ("owner", "\n0\n", "\n-5\n", "polyMesh: a face is of cell -5"),
        ("owner", "\n0\n", "\n2000000000\n", "of cell 2000000000, of cells with .* faces in all"),
        ("faces", "\n4(0 ", "\n4(999999 ", "has node 999999 of"),
        ("faces", "\n4(", "\n4(7 ", "announces .* faces"),
        ("faces", "4(1 ", "4(1) (", "announces .* faces and holds"),
        ("faces", "4(0", "5(0", "announces corners of faces and holds another number"),
        ("owner", "\n0\n", "\n0\0\n", r"owner: is no list of whole numbers \(.*x00"),
        ("owner", ")", "", "owner: its list does not end"),
        ("owner", "\n(", "\n/*(", "owner: "),
        ("points", ")\n", " 7)\n", "node 1 has too many coordinates: 4 words in its line, instead of 3"),
        ("points", "\n288\n", "\n" + "9" * 25 + "\n", "points: announces a list longer than the file"),
        ("boundary", "startFace", "start", "has no faces of the mesh"),
        ("boundary", "farfield", "body", "announces 2 patches and holds 1"),
    ],
)
def test_what_is_wrong_in_a_folder_is_said_in_one_line(folder, name, old, new, words):
    text = (folder / name).read_text()
    (folder / name).write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=words) as error:
        read_mesh(folder)
    assert "\n" not in str(error.value)


def test_lists_as_older_programs_wrote_them_are_read(folder):
    """A boundary without its number of patches, and neighbours of -1 for faces that have none."""
    markers, text = read_mesh(folder).mesh.markers, (folder / "boundary").read_text()
    head, _, body = (folder / "neighbour").read_text().rpartition("(")
    n, listed = int(head.split()[-1]), body.partition(")")[0]
    (folder / "neighbour").write_text(f"{head.rstrip()[: -len(str(n))]}{n + 3}\n({listed}\n-1 -1\n-1\n)\n")
    (folder / "boundary").write_text(re.sub(r"\n2\s*\n\(", "\n// by hand\n(", text))
    found = read_mesh(folder).mesh.markers
    assert list(found) == list(markers)
    for name, faces in markers.items():
        np.testing.assert_array_equal(found[name], faces)
    assert (folder / "boundary").read_text() != text


def test_comments_anywhere_cost_no_time_and_change_nothing(folder):
    mesh = read_mesh(folder).mesh
    for path in folder.iterdir():
        head, brace, body = path.read_text().partition("}")
        many = "/* FoamFile { format binary; } ( 7 ) */ // ) */ /*\n" * 5000  # two for every one took twice the time
        path.write_text("/* FoamFile { format binary; } */\n" + head + brace + many + body.replace("(\n", "( // ) 9\n"))
    commented = read_mesh(folder).mesh
    np.testing.assert_array_equal(commented.points, mesh.points)
    np.testing.assert_array_equal(commented.polyhedra[0], mesh.polyhedra[0])
    assert list(commented.markers) == list(mesh.markers)
    (folder / "owner").write_text((folder / "owner").read_text().rpartition("/* F")[0] + "/* " * 100_000)
    with pytest.raises(InputError, match="owner: holds no list"):
        read_mesh(folder)


@pytest.mark.parametrize("arch", ["LSB;label=32;scalar=64", "MSB;label=64;scalar=64", "LSB;label=64;scalar=32"])
def test_a_folder_in_binary_is_that_in_ascii_and_keeps_its_kind(folder, arch):
    made, mesh = binary_folder(folder, arch), read_mesh(folder).mesh
    read, kept = read_mesh(made), np.float32 if "scalar=32" in arch else np.float64
    np.testing.assert_array_equal(read.mesh.points, mesh.points.astype(kept))
    for part, same in zip(read.mesh.polyhedra, mesh.polyhedra):
        np.testing.assert_array_equal(part, same)
    for name, faces in mesh.markers.items():
        np.testing.assert_array_equal(read.mesh.markers[name], faces)
    read.write(made.parent / "moved" / "polyMesh", read.mesh.points + [0.25, 0.0, 0.0])
    moved = made.parent / "moved" / "polyMesh"
    np.testing.assert_array_equal(read_mesh(moved).mesh.points, (read.mesh.points + [0.25, 0.0, 0.0]).astype(kept))
    assert len((moved / "points").read_bytes()) == len((made / "points").read_bytes())
    read.write(moved, read.mesh.points)
    assert all((moved / path.name).read_bytes() == path.read_bytes() for path in made.iterdir())


def test_vtk_reads_the_moved_binary_folder_alike(folder, tmp_path):
    pyvista = pytest.importorskip("pyvista", reason="the extra 'pictures' is not installed")
    read = read_mesh(binary_folder(folder, "LSB;label=32;scalar=64"))
    read.write(tmp_path / "case" / "constant" / "polyMesh", read.mesh.points * [1.0, 1.0, 1.5])
    (tmp_path / "case" / "case.foam").touch()
    (tmp_path / "case" / "system").mkdir()
    (tmp_path / "case" / "system" / "controlDict").write_text("startTime 0; deltaT 1; writeInterval 1;\n")
    inside = pyvista.OpenFOAMReader(tmp_path / "case" / "case.foam").read()["internalMesh"]
    np.testing.assert_array_equal(inside.points, (read.mesh.points * [1.0, 1.0, 1.5]).astype(np.float32))
    sizes = inside.compute_cell_sizes()["Volume"]
    np.testing.assert_allclose(np.sort(read.mesh.quality(inside.points).volumes), np.sort(sizes), rtol=1e-4)


def test_a_compressed_folder_is_written_compressed_and_folders_in_it_are_kept(folder, tmp_path):
    points = read_mesh(folder).mesh.points
    for path in list(folder.iterdir()):
        path.with_name(f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes()))
        path.unlink()
    (folder / "sets").mkdir()
    (folder / "sets" / "some").write_text("1(0)")
    read = read_mesh(folder)
    np.testing.assert_array_equal(read.mesh.points, points)
    read.write(tmp_path / "moved" / "polyMesh", 2.0 * points)
    moved = tmp_path / "moved" / "polyMesh"
    assert {path.relative_to(moved) for path in moved.rglob("*")} == {
        path.relative_to(folder) for path in folder.rglob("*")
    }
    np.testing.assert_array_equal(read_mesh(moved).mesh.points, 2.0 * points)
    assert (moved / "sets" / "some").read_text() == "1(0)"
    (moved / "points").write_text("left behind")
    with pytest.raises(InputError, match=r"points: is there beside what would be points.gz; remove it"):
        read.write(moved, points)


def test_zones_that_touch_share_their_nodes(cgns):
    mesh = read_mesh(cgns).mesh
    assert (mesh.n_points, mesh.n_cells) == (12, 3)
    np.testing.assert_allclose(np.sort(mesh.quality().volumes), [15.0, 15.0, 30.0])
    assert {name: len(faces) for name, faces in mesh.markers.items()} == {"floor": 2}


def test_a_cgns_file_keeps_all_but_coordinates_and_their_precision(cgns):
    read = read_mesh(cgns)
    moved = read.mesh.points + 0.1 * np.random.default_rng(3).standard_normal(read.mesh.points.shape)
    read.write(cgns.with_name("moved.cgns"), moved)
    with h5py.File(cgns) as old, h5py.File(cgns.with_name("moved.cgns")) as new:
        names = []
        old.visit(names.append)
        changed = {n for n in names if isinstance(old[n], h5py.Dataset) and (old[n][()] != new[n][()]).any()}
        assert changed == {f"Base/{z}/GridCoordinates/Coordinate{a}/ data" for z in ("left", "right") for a in "XYZ"}
        for name in names:
            assert dict(old[name].attrs) == dict(new[name].attrs)
            assert not isinstance(old[name], h5py.Dataset) or old[name].dtype == new[name].dtype
    again = read_mesh(cgns.with_name("moved.cgns")).mesh.points
    np.testing.assert_allclose(again[np.lexsort(again.T)], moved[np.lexsort(moved.T)], rtol=0, atol=1e-6)
    read.write(cgns.with_name("same.cgns"), read.mesh.points)
    assert cgns.with_name("same.cgns").read_bytes() == cgns.read_bytes()


def test_what_is_wrong_in_a_cgns_mesh_is_said_in_one_line(cgns, tmp_path):
    with h5py.File(cgns, "r+") as file:
        file["Base/left/cells/ElementConnectivity/ data"][0] = 23
    with pytest.raises(InputError, match="zone 'left', section 'cells': its mixed elements are damaged"):
        read_mesh(cgns)
    (tmp_path / "old.cgns").write_bytes(b"\xc0\xa8\xa3\xa9ADF Database Version A02011>" + bytes(64))
    with pytest.raises(InputError, match="in ADF of version"):
        read_mesh(tmp_path / "old.cgns")


def put(path, place, values):
    """Put another value in the place of that of a node of a CGNS file."""
    with h5py.File(path, "r+") as file:
        del file[f"Base/{place}/ data"]
        file[f"Base/{place}/ data"] = values


@pytest.mark.parametrize(
    ("place", "values", "words"),
    [
        ("left/GridCoordinates/CoordinateX", BOX[:, 0].astype(np.int32), "zone 'left': CoordinateX is of int32, which"),
        ("left/GridCoordinates/CoordinateX", BOX[:, 0] + 0j, "zone 'left': CoordinateX is of complex128, which"),
        ("left/GridCoordinates/CoordinateY", BOX[:5, 1], "zone 'left': announces 8 nodes and holds 8, 5, 8 coord"),
        ("left/GridCoordinates/CoordinateY", np.full(8, np.nan), "boxes.cgns: nodes: number .* is .*nan.*, not finite"),
        ("left", np.array([[8], [9], [0]]), "zone 'left': announces 9 cells and holds 2"),
        ("left/cells/ElementRange", np.array([1, 2 * 10**9]), "announces 2,000,000,000 mixed elements of 14 numbers"),
        ("left/cells/ElementRange", np.array([1, -(10**9)]), "announces -1,000,000,000 mixed elements"),
        ("right/cells/ElementRange", np.array([1, 2 * 10**9]), "announces 2,000,000,000 elements and holds another"),
        ("right/cells/ElementConnectivity", np.arange(8) + 1.5, "ElementConnectivity is of float64, instead of"),
        ("right/cells/ElementConnectivity", np.arange(8) + 2, "section 'cells': has node 9 of 8"),
        ("left/ZoneBC/bc left/PointRange", np.array([[1.0, 3.0]]), "PointRange is of float64, instead of whole"),
    ],
)
def test_numbers_of_a_cgns_mesh_that_cannot_be_are_said_in_one_line(cgns, place, values, words):
    put(cgns, place, values)
    with pytest.raises(InputError, match=words) as error:
        read_mesh(cgns)
    assert "\n" not in str(error.value)


def test_a_condition_on_more_faces_than_there_can_be_takes_no_memory(cgns):
    for zone in ("left", "right"):
        put(cgns, f"{zone}/ZoneBC/bc {zone}/PointRange", np.array([[0, 2**40]]))
    assert {name: len(faces) for name, faces in read_mesh(cgns).mesh.markers.items()} == {"floor": 2}


def polygons_file(folder, path, version, has_cells):
    """The mesh of a folder as polygons of CGNS 3 or 4, with cells that list them or with the polygons' parents."""
    mesh, (corners, sizes) = read_mesh(folder).mesh, FoamFile.read(folder, "faces").faces()
    owner, neighbour = (FoamFile.read(folder, name).labels() for name in ("owner", "neighbour"))
    n_faces, n_cells = len(sizes), int(owner.max()) + 1

    def add_lists(section, values, lengths):
        starts = np.concatenate([[0], np.cumsum(lengths)])
        if version == 4:
            add_node(section, "ElementStartOffset", "DataArray_t", starts)
        else:
            values = np.insert(values, starts[:-1], lengths)
        add_node(section, "ElementConnectivity", "DataArray_t", values)

    with h5py.File(path, "w", track_order=True) as file:
        zone = add_node(write_base(file, 3), "zone", "Zone_t", np.array([[mesh.n_points], [n_cells], [0]]))
        add_node(zone, "ZoneType", "ZoneType_t", "Unstructured")
        coordinates = add_node(zone, "GridCoordinates", "GridCoordinates_t")
        for axis, values in zip("XYZ", mesh.points.T):
            add_node(coordinates, f"Coordinate{axis}", "DataArray_t", np.ascontiguousarray(values))
        faces = add_node(zone, "faces", "Elements_t", np.array([22, 0], np.int32))
        add_node(faces, "ElementRange", "IndexRange_t", np.array([1, n_faces]))
        add_lists(faces, corners + 1, sizes)
        if has_cells:
            cells = add_node(zone, "cells", "Elements_t", np.array([23, 0], np.int32))
            add_node(cells, "ElementRange", "IndexRange_t", np.array([n_faces + 1, n_faces + n_cells]))
            listed = np.concatenate([np.arange(n_faces) + 1, -1 - np.arange(len(neighbour))])
            of = np.concatenate([owner, neighbour])
            add_lists(cells, listed[np.argsort(of, kind="stable")], np.bincount(of))
        else:
            parents = np.zeros((2, n_faces), dtype=np.int64)
            parents[0], parents[1, : len(neighbour)] = n_faces + 1 + owner, n_faces + 1 + neighbour
            add_node(faces, "ParentElements", "DataArray_t", parents)
        text = (folder / "boundary").read_text().partition("body")[2]
        first, n = (int(re.search(rf"{key} (\d+)", text)[1]) for key in ("startFace", "nFaces"))
        body = add_node(add_node(zone, "ZoneBC", "ZoneBC_t"), "body", "BC_t", "BCWall")
        add_node(body, "PointList", "IndexArray_t", np.arange(first + 1, first + n + 1)[:, None])
        add_node(body, "GridLocation", "GridLocation_t", "FaceCenter")
    return path


@pytest.mark.parametrize(("version", "has_cells"), [(4, True), (4, False), (3, True)])
def test_polygons_of_cgns_are_the_mesh_of_openfoam(folder, tmp_path, version, has_cells):
    path, mesh = polygons_file(folder, tmp_path / "polygons.cgns", version, has_cells), read_mesh(folder).mesh
    read = read_mesh(path)
    np.testing.assert_allclose(read.mesh.quality().volumes, mesh.quality().volumes, rtol=1e-14)
    assert read.mesh.stated["body"] == "BCWall"
    judged = [np.sort(mesh_quality(found).skewness) for found in (read.mesh, mesh)]
    np.testing.assert_allclose(*judged, rtol=1e-9, atol=1e-12)
    walls = (part.into_fluid(part.markers["body"]) for part in (read.mesh, mesh))
    assert {tuple(face) for face in next(walls).tolist()} == {tuple(face) for face in next(walls).tolist()}
    read.write(tmp_path / "moved.cgns", 2.0 * mesh.points)
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.cgns").mesh.points, 2.0 * mesh.points)
    read.write(tmp_path / "same.cgns", mesh.points)
    assert (tmp_path / "same.cgns").read_bytes() == path.read_bytes()


def test_polygons_without_conditions_have_markers_where_sections_are_on_the_boundary(folder, tmp_path):
    path = polygons_file(folder, tmp_path / "polygons.cgns", 4, True)
    with h5py.File(path, "r+") as file:
        del file["Base/zone/ZoneBC"]
    mesh = read_mesh(path).mesh
    assert len(mesh.markers["faces"]) == len(mesh.skin)
    with h5py.File(path, "r+") as file:
        file["Base/zone/faces/ElementStartOffset/ data"][-1] += 1
    with pytest.raises(InputError, match="section 'faces': its polygons or polyhedra do not end with the numbers"):
        read_mesh(path)
    with h5py.File(path, "r+") as file:
        file["Base/zone/faces/ElementStartOffset/ data"][-1] -= 1
        del file["Base/zone/cells"]
    with pytest.raises(InputError, match="has polygons but neither NFACE_n nor ParentElements"):
        read_mesh(path)


def test_vtk_reads_the_moved_polygons_alike(folder, tmp_path):
    pyvista = pytest.importorskip("pyvista", reason="the extra 'pictures' is not installed")
    read = read_mesh(polygons_file(folder, tmp_path / "polygons.cgns", 4, True))
    read.write(tmp_path / "moved.cgns", read.mesh.points * [1.0, 1.0, 1.5])
    inside = pyvista.CGNSReader(tmp_path / "moved.cgns").read().combine()
    np.testing.assert_array_equal(inside.points, read.mesh.points * [1.0, 1.0, 1.5])
    sizes = inside.compute_cell_sizes()["Volume"]
    np.testing.assert_allclose(read.mesh.quality(inside.points).volumes, sizes, rtol=0.02)  # it cuts bent faces


@pytest.mark.parametrize("degree", [2, 3, 4])
def test_curved_elements_of_cgns_move_whole_and_count_by_their_corners(tmp_path, degree):
    model = fit_grid(brick_grid((5, 5, 5, 5)))
    write_curved_grid(tmp_path / "curved.cgns", curved_grid(model, degree))
    read = read_mesh(tmp_path / "curved.cgns")
    quality = read.mesh.quality()
    assert (read.mesh.n_cells, read.mesh.cells["hexahedron"].shape[1]) == (6 * 4**3, 8)
    assert read.mesh.n_points > read.mesh.n_cells * degree**3
    assert not quality.is_inverted.any()
    assert read.mesh.markers["body"].shape == (6 * 4**2, 4)
    read.write(tmp_path / "moved.cgns", 2.0 * read.mesh.points)
    np.testing.assert_array_equal(read_mesh(tmp_path / "moved.cgns").mesh.points, 2.0 * read.mesh.points)


@pytest.mark.parametrize("name", ["polyMesh", "boxes.cgns", "wing.su2"])
def test_nodes_that_are_none_are_not_written(folder, cgns, tmp_path, name):
    (tmp_path / "wing.su2").write_text(su2_text(mesh()))
    read = read_mesh(tmp_path / name)
    points, moved = read.mesh.points, tmp_path / "moved" / name
    wrong = points.copy()
    wrong[5, 1] = np.inf
    for values, words in (
        (wrong, r"nodes: number 6 of [\d,]+ is .*inf.*, not finite"),
        (points[:-1], "nodes of shape"),
        (points[0], "nodes of shape"),
        (points + 1j, "nodes are complex"),
    ):
        with pytest.raises(InputError, match=words):
            read.write(moved, values)
        assert not moved.exists()


def test_physical_names_in_cgns_of_gmsh_are_the_markers(tmp_path):
    gmsh, path = pytest.importorskip("gmsh"), tmp_path / "box.cgns"
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addBox(0.0, 0.0, 0.0, 1.0, 2.0, 3.0)
        gmsh.model.occ.synchronize()
        groups = {"body": [1, 2], "far field": [2, 3, 4]}
        for name, surfaces in groups.items():
            gmsh.model.addPhysicalGroup(2, surfaces, name=name)
        gmsh.model.addPhysicalGroup(3, [1], name="fluid")
        gmsh.model.mesh.generate(3)
        counts = {tag: len(gmsh.model.mesh.getElements(2, tag)[1][0]) for _, tag in gmsh.model.getEntities(2)}
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    if not path.exists():
        pytest.skip("this gmsh writes no CGNS")
    found = {name: len(faces) for name, faces in read_mesh(path).mesh.markers.items()}
    named = {name: sum(counts[tag] for tag in tags) for name, tags in groups.items()}
    assert {name: found[name] for name in groups} == named
    assert set(found) - set(groups) <= {"S_5", "S_6"}  # surfaces of no group


def test_a_family_of_cgns_has_the_name_that_it_refers_to_unless_that_is_a_family(cgns):
    with h5py.File(cgns, "r+", track_order=True) as file:
        for zone in ("left", "right"):
            for condition in file[f"Base/{zone}/ZoneBC"].values():
                if "FamilyName" in condition:
                    del condition["FamilyName"]
                add_node(condition, "FamilyName", "FamilyName_t", "flap")
        add_node(add_node(file["Base"], "flap", "Family_t"), "name", "FamilyName_t", "wing")
    assert {name: len(faces) for name, faces in read_mesh(cgns).mesh.markers.items()} == {"wing": 2}
    with h5py.File(cgns, "r+", track_order=True) as file:
        add_node(file["Base"], "wing", "Family_t")
    assert {name: len(faces) for name, faces in read_mesh(cgns).mesh.markers.items()} == {"flap": 2}
