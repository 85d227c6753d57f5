"""Files that hold no structured grid are named for what they are, with what can be done with them."""

import sqlite3

import pytest

from bspline_mdao import InputError, open_grid, read_grid, write_grid
from bspline_mdao.generators import brick_grid
from bspline_mdao.grids.io.other_files import head_of_grid

HEADS = {
    "a.msh": (b"$MeshFormat\n4.1 0 8\n", "is a Gmsh mesh, .* give a PLOT3D or CGNS grid; .*ride MODEL.h5 .*a.msh'"),
    "a.su2": (b"% made by hand\n\n  % for a test\r\n NDIME= 2\n", "is an SU2 mesh, without structured blocks"),
    "a.vtu": (b'<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid">', "is a VTK mesh, without structured blocks"),
    "a.vtk": (b"# vtk DataFile Version 3.0\n", r"is a legacy VTK file, .* a PLOT3D or CGNS grid, or save .* as \.vtu"),
    "a.tec": (b' variables = "x" "y" "z"\n', "is a Tecplot file"),
    "a.step": (b"ISO-10303-21;\nHEADER;\n", "is a CAD file .STEP., of surfaces without a grid"),
}


@pytest.mark.parametrize("name", HEADS)
@pytest.mark.parametrize("read", [read_grid, open_grid])
def test_a_file_without_blocks_is_named(name, read, tmp_path):
    head, expected = HEADS[name]
    (tmp_path / name).write_bytes(head)
    with pytest.raises(InputError, match=expected) as refused:
        read(tmp_path / name)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("name", "expected"), [("a.vtm", "ParaView"), ("a.dat", "Tecplot"), ("polyMesh", "OpenFOAM")])
def test_what_is_written_and_not_read_is_named(name, expected, tmp_path):
    write_grid(tmp_path / name, brick_grid((4, 5, 6, 4)))
    with pytest.raises(InputError, match=f"{name}: is an? {expected} "):
        read_grid(tmp_path / name)


def test_recorded_cases_are_named(tmp_path):
    with sqlite3.connect(tmp_path / "cases.sql") as cases:
        cases.execute("CREATE TABLE iterations (counter INT)")
    cases.close()
    with pytest.raises(InputError, match=r"is a case file of an optimisation; .*report .*cases.sql' shows"):
        read_grid(tmp_path / "cases.sql")


@pytest.mark.parametrize("head", [b"", b"\n" * 4096, b"% " * 2048, b"\0\0\0\x04" * 1000, b"  3\n 5 6 7\n"])
def test_other_beginnings_are_taken_for_grids(head, tmp_path):
    (tmp_path / "a").write_bytes(head)
    assert head_of_grid(tmp_path / "a", 100) == head[:100]
