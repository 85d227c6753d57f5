"""Meshes of Gmsh and VTK that meshio wrote: what it reads of them is kept, but for the nodes."""

import numpy as np
import pytest
from riding_cases import mesh

from bspline_mdao import InputError
from bspline_mdao.files import read_mesh

meshio = pytest.importorskip("meshio", reason="meshio is not installed")

KINDS = [("msh", {"file_format": form, "binary": b}) for form in ("gmsh", "gmsh22") for b in (True, False)]
KINDS += [("vtu", {"binary": False}), ("vtu", {"compression": None}), ("vtu", {"compression": "zlib"})]


@pytest.fixture(params=KINDS, ids=str)
def file(request, tmp_path):
    """Tetrahedra with a wall of triangles, and fields where the format has some; single precision in VTK's."""
    suffix, how = request.param
    rng = np.random.default_rng(5)
    points, tetra = rng.standard_normal((40, 3)), rng.integers(0, 40, (30, 4))
    cells = [("triangle", tetra[:7, :3]), ("tetra", tetra)]
    if suffix == "vtu":
        fields = {"point_data": {"p": rng.standard_normal(40)}, "cell_data": {"q": [np.arange(7.0), np.arange(30.0)]}}
        made = meshio.Mesh(points.astype(np.float32), cells, **fields)
    else:
        numbers = [np.full(7, 2), np.full(30, 1)]
        data = {"gmsh:physical": numbers, "gmsh:geometrical": numbers}
        tags = {"gmsh:dim_tags": np.array([(2, 2)] * 20 + [(3, 1)] * 20)} if how["file_format"] == "gmsh" else {}
        names = {"wing": np.array([2, 2]), "air": np.array([1, 3])}
        made = meshio.Mesh(points, cells, tags, data, names)
    meshio.write(tmp_path / f"wing.{suffix}", made, **how)
    return tmp_path / f"wing.{suffix}"


def test_all_but_nodes_comes_back(file):
    read, new = read_mesh(file), file.with_name(f"moved{file.suffix}")
    assert (read.mesh.n_points, read.mesh.n_cells) == (40, 30)
    markers = {name: len(faces) for name, faces in read.mesh.markers.items()}
    assert markers == ({"wing": 7} if file.suffix == ".msh" else {})
    moved = read.mesh.points * [1.0, 1.0, 1.25]
    read.write(new, moved)
    before, after = meshio.read(file), meshio.read(new)
    np.testing.assert_array_equal(after.points, moved.astype(before.points.dtype))
    assert after.points.dtype == before.points.dtype
    for old_block, new_block in zip(before.cells, after.cells):
        assert old_block.type == new_block.type
        np.testing.assert_array_equal(old_block.data, new_block.data)
    for old, now in ((before.point_data, after.point_data), (before.cell_data, after.cell_data)):
        assert list(old) == list(now)
        assert all(np.array_equal(a, b) for name in old for a, b in zip(old[name], now[name]))
    assert str(before.field_data) == str(after.field_data)
    read.write(new, read.mesh.points)
    assert new.read_bytes() == file.read_bytes()


def test_a_damaged_file_is_said_in_one_line(file):
    data = file.read_bytes()
    file.write_bytes(data[: len(data) // 3])
    with pytest.raises(InputError, match=file.name) as error:
        read_mesh(file)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("number", [900_000_000, -1, 40])
def test_a_corner_of_no_node_is_refused(tmp_path, number):
    points, tetra = np.random.default_rng(5).standard_normal((40, 3)), np.arange(12).reshape(3, 4)
    tetra[1, 2] = number
    meshio.write(tmp_path / "wing.vtu", meshio.Mesh(points, [("tetra", tetra)]))
    with pytest.raises(InputError, match=rf"wing.vtu: cells 'tetra': number 2 has node {number} of 40, from 0"):
        read_mesh(tmp_path / "wing.vtu")


def test_what_is_no_file_of_vtk_is_said_once_with_the_reason(tmp_path, capfd):
    path = tmp_path / "wing.vtu"
    for text, reason in (("NDIME= 2\n", "line 1, column 5"), ('<VTKFile type="PolyData"/>', "found PolyData")):
        path.write_text(text)
        with pytest.raises(InputError, match=rf"wing\.vtu: is no .* of VTK \(.*{reason}.*\); write it again"):
            read_mesh(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("version", "binary"), [(2.2, 0), (2.2, 1), (4.1, 0), (4.1, 1)])
def test_files_of_gmsh_itself_come_back(tmp_path, version, binary):
    gmsh = pytest.importorskip("gmsh", reason="gmsh is not installed")
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.option.setNumber("Mesh.Binary", binary)
    gmsh.model.occ.addBox(0, 0, 0, 1, 2, 3)
    gmsh.model.occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [1, 3], name="floor")
    gmsh.model.addPhysicalGroup(3, [1], name="air")
    gmsh.model.mesh.generate(3)
    gmsh.write(str(tmp_path / "box.msh"))
    gmsh.clear()
    read = read_mesh(tmp_path / "box.msh")
    assert read.mesh.quality().volumes.sum() == pytest.approx(6.0)
    assert set(read.mesh.markers) == {"floor"}
    read.write(tmp_path / "moved.msh", read.mesh.points + [0.5, 0.0, 1.0])
    counts = []
    for name in ("box", "moved"):
        gmsh.open(str(tmp_path / f"{name}.msh"))
        counts.append((gmsh.model.getPhysicalGroups(), [len(ids) for ids in gmsh.model.mesh.getElements(3)[1]]))
        points = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)
        gmsh.clear()
    gmsh.finalize()
    assert counts[0] == counts[1]
    np.testing.assert_allclose(points.min(axis=0), [0.5, 0.0, 1.0], atol=1e-15)


def test_appended_points_of_vtk_are_replaced(tmp_path):
    pyvista = pytest.importorskip("pyvista", reason="the extra 'pictures' is not installed")
    kinds = {pyvista.CellType.HEXAHEDRON: mesh().cells["hexahedron"], pyvista.CellType.PYRAMID: mesh().cells["pyramid"]}
    grid = pyvista.UnstructuredGrid(kinds, mesh().points)
    grid["p"] = np.arange(mesh().n_points, dtype=float)
    grid.save(tmp_path / "wing.vtu")
    read = read_mesh(tmp_path / "wing.vtu")
    read.write(tmp_path / "moved.vtu", read.mesh.points * [1.0, 2.0, 1.0])
    moved = pyvista.read(tmp_path / "moved.vtu")
    np.testing.assert_array_equal(moved.points, mesh().points * [1.0, 2.0, 1.0])
    np.testing.assert_array_equal(moved["p"], grid["p"])
    np.testing.assert_array_equal(moved.cells, grid.cells)
