"""VTK's unstructured grids: where their arrays are, how many numbers they have, and what they may not be."""

import base64
import re
import tracemalloc
import zlib

import numpy as np
import pytest

from bspline_mdao import InputError
from bspline_mdao.files import read_mesh

POINTS = np.random.default_rng(7).standard_normal((9, 3))
TETRA, HEXAHEDRON = [0, 1, 2, 8], [0, 1, 2, 3, 4, 5, 6, 7]

NORMS = '<InformationKey name="L2_NORM_RANGE" length="1"><Value index="0">3.5</Value></InformationKey>'
TEXT = f"""<?xml version="1.0"?>
<!-- <Points><DataArray type="Float64" NumberOfComponents="3" format="ascii">1 2 3</DataArray></Points> -->
<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" header_type="UInt64">
<UnstructuredGrid><Piece NumberOfPoints="9" NumberOfCells="2">
<PointData><DataArray type="Float64" Name="Points" format="ascii">{" 7" * 9}</DataArray></PointData>
<!-- <Points> --><Points>
<DataArray type="Float64" Name="Points" NumberOfComponents='3' format="ascii" RangeMax=">">{NORMS}
{" ".join(map(repr, POINTS.ravel().tolist()))}
</DataArray></Points>
<Cells><DataArray type="Int32" Name="connectivity" format="ascii">0 1 2 8 0 1 2 3 4 5 6 7</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">4 12</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">10 12</DataArray></Cells>
</Piece></UnstructuredGrid></VTKFile>
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "wing.vtu").write_text(TEXT)
    return tmp_path / "wing.vtu"


def test_comments_fields_and_notes_are_no_points(path):
    read = read_mesh(path)
    np.testing.assert_array_equal(read.mesh.points, POINTS)
    assert {kind: corners.tolist() for kind, corners in read.mesh.cells.items()} == {
        "tetra": [TETRA],
        "hexahedron": [HEXAHEDRON],
    }
    read.write(path.with_name("moved.vtu"), POINTS + 0.5)
    moved = path.with_name("moved.vtu").read_text()
    np.testing.assert_array_equal(read_mesh(path.with_name("moved.vtu")).mesh.points, POINTS + 0.5)
    assert moved.partition("3.5<")[0] == TEXT.partition("3.5<")[0]
    assert moved.rpartition("<Cells>")[2] == TEXT.rpartition("<Cells>")[2]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<VTKFile", '<!DOCTYPE VTKFile [<!ENTITY a "1">]><VTKFile', "declares a type of document"),
        ("<Piece", '<Piece NumberOfPoints="1" NumberOfCells="0"/><Piece', "has 2 pieces; merge them into one"),
        ("<Cells>", "<Cells><!--", "is no XML of VTK"),
        ('<Points>\n<DataArray type="Float64"', '<Points>\n<DataArray type="Int32"', "points are of type Int32 with 3"),
        ("NumberOfComponents='3'", "NumberOfComponents='2'", "with 2 coordinates each"),
        ('NumberOfPoints="9"', 'NumberOfPoints="8"', "announces 8 points and holds 9"),
        ('NumberOfPoints="9"', 'NumberOfPoints="-9"', "NumberOfPoints='-9' is no number of its size"),
        (
            'NumberOfCells="2"',
            'NumberOfCells="9000000000000"',
            "is no number of its size",
        ),
        ('NumberOfCells="2"', 'NumberOfCells="3"', "array offsets has 2 numbers, not 3"),
        ("4 12</", "4 60000000</", "array connectivity .*, not 60,000,000|larger than the file"),
        ("4 12</", "40000000000 12</", "cell 2 ends before it begins, at 12"),
        ("4 12</", "5 12</", "cell 1, of type 10, has 5 nodes"),
        ("4 12</", "4.5 12</", "array offsets is damaged"),
        ("10 12</", "10 42</", "has cells of type 42; known are 1, 2, 3"),
        ('"Int32" Name="conn', '"Float32" Name="conn', "array connectivity is of reals"),
        ("0 1 2 8", "0 1 2 9", "cells 'tetra': number 1 has node 9 of 9, from 0"),
        ("0 1 2 8", "0 1 <!-- 7 --> 2 8", "array connectivity is cut by comments"),
        ('Name="offsets" format="ascii"', 'Name="offsets" format="binary"', "array offsets is damaged"),
        (
            'Name="offsets" format="ascii"',
            'Name="offsets" format="appended"',
            "neither in ASCII nor binary nor",
        ),
        ('Name="offsets"', 'Name="types"', "has array types twice"),
        ('Name="offsets"', 'Name="offset"', "has no array offsets"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(path, old, new, words):
    assert old in TEXT
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(InputError, match=words) as error:
        read_mesh(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def compressed(*blocks, whole, last):
    """Text of blocks, which announce how large they are."""
    packed = [zlib.compress(block) for block in blocks]
    head = np.array([len(blocks), whole, last, *map(len, packed)], np.uint64)
    return (base64.b64encode(head.tobytes()) + base64.b64encode(b"".join(packed))).decode()


def in_blocks(text):
    """The file with this text in the place of its points."""
    found = TEXT.replace("<VTKFile ", '<VTKFile compressor="vtkZLibDataCompressor" ')
    found = re.sub(r"(format=\"ascii\" RangeMax=\">\">).*?(</DataArray>)", rf"\1{text}\2", found, count=1, flags=re.S)
    return found.replace('format="ascii" RangeMax', 'format="binary" RangeMax')


def test_blocks_that_are_as_large_as_they_announce_are_read(path):
    raw = POINTS.tobytes()
    for size in (50, 72, 216, 1000):
        parts = [raw[at : at + size] for at in range(0, len(raw), size)]
        last = len(raw) % size
        path.write_text(in_blocks(compressed(*parts, whole=size, last=last)))
        np.testing.assert_array_equal(read_mesh(path).mesh.points, POINTS)


@pytest.mark.parametrize("whole", [216, 2**34])
def test_a_block_that_grows_beyond_its_size_is_not_decompressed(path, whole):
    path.write_text(in_blocks(compressed(bytes(2**28), whole=whole, last=0)))  # 256 MiB of zeros in 256 KiB
    tracemalloc.start()
    with pytest.raises(InputError, match="array Points is damaged"):
        read_mesh(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 2**24
