"""Grids for ParaView, read back from the files' own description."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from grid_cases import smooth_grid

from bspline_mdao.errors import InputError
from bspline_mdao.grids.io.vtk import write_vtk

DTYPES = {"Float64": "=f8", "Float32": "=f4", "Int32": "=i4"}


def read_piece(path):
    """Extent and arrays of a structured grid file, arrays in VTK's order, shape (n, n_components)."""
    head, appended = path.read_bytes().split(b'<AppendedData encoding="raw">\n_', 1)
    piece = ElementTree.fromstring(head + b"</VTKFile>").find("StructuredGrid/Piece")
    arrays = {}
    for element in piece.iter("DataArray"):
        start = int(element.get("offset"))
        length = int(np.frombuffer(appended, np.uint64, 1, start)[0])
        data = np.frombuffer(appended[start + 8 : start + 8 + length], DTYPES[element.get("type")])
        arrays[element.get("Name")] = data.reshape(-1, int(element.get("NumberOfComponents")))
    return piece.get("Extent"), arrays


def test_blocks_and_fields_come_back_with_i_running_fastest(tmp_path):
    grid = smooth_grid(has_iblank=True)
    random = np.random.default_rng(5)
    cells = [tuple(n - 1 for n in shape) for shape in grid.shapes]
    speed = [random.random(shape + (3,)) for shape in grid.shapes]
    quality = [random.random(shape).astype(np.float32) for shape in cells]
    write_vtk(tmp_path / "out.vtm", grid, {"speed <m/s>": speed}, {"Q": quality})
    index = ElementTree.parse(tmp_path / "out.vtm").getroot()
    files = [element.get("file") for element in index.iter("DataSet")]
    assert [element.get("name") for element in index.iter("DataSet")] == ["block 1", "block 2"]
    for b, (block, file) in enumerate(zip(grid.blocks, files)):
        extent, arrays = read_piece(tmp_path / file)
        assert extent == " ".join(f"0 {n - 1}" for n in block.shape)
        for axis in range(3):
            np.testing.assert_array_equal(arrays["Points"][:, axis], block.nodes[..., axis].ravel(order="F"))
            np.testing.assert_array_equal(arrays["speed <m/s>"][:, axis], speed[b][..., axis].ravel(order="F"))
        np.testing.assert_array_equal(arrays["Q"][:, 0], quality[b].ravel(order="F"))
        np.testing.assert_array_equal(arrays["iblank"][:, 0], block.iblank.ravel(order="F"))


def test_field_that_does_not_fit_is_refused_before_anything_is_written(tmp_path):
    grid = smooth_grid()
    shapes = grid.shapes
    for fields in [
        {"a": [np.zeros(shapes[0])]},
        {"a": [np.zeros(shapes[0]), np.zeros((6, 5, 4))]},
        {"a": [np.zeros(shape, complex) for shape in shapes]},
    ]:
        with pytest.raises(InputError, match=re.escape("node field 'a'")):
            write_vtk(tmp_path / "out.vtm", grid, fields)
    with pytest.raises(InputError, match="suffix"):
        write_vtk(tmp_path / "out", grid)
    assert list(tmp_path.iterdir()) == []


def test_block_with_one_node_in_k_has_one_layer_of_cells(tmp_path):
    grid = smooth_grid(((4, 5, 1),))
    write_vtk(tmp_path / "out.vtm", grid, cell_fields={"Q": [np.arange(12.0).reshape(3, 4, 1)]})
    extent, arrays = read_piece(tmp_path / "out" / "0001.vts")
    assert extent == "0 3 0 4 0 0"
    assert arrays["Q"][1, 0] == 4.0


def test_vtk_itself_reads_the_files(tmp_path):
    xml = pytest.importorskip("vtkmodules.vtkIOXML", reason="vtk is not installed")
    grid = smooth_grid()
    write_vtk(tmp_path / "out.vtm", grid)
    reader = xml.vtkXMLMultiBlockDataReader()
    reader.SetFileName(str(tmp_path / "out.vtm"))
    reader.Update()
    blocks = [reader.GetOutput().GetBlock(number) for number in range(2)]
    assert [block.GetNumberOfPoints() for block in blocks] == [120, 120]
    assert blocks[1].GetPoint(1) == tuple(grid.blocks[1].nodes[1, 0, 0])
