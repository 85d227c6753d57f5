"""The table of file formats: every line works, and one more line is a format more."""

import sys
import types
from pathlib import Path

import pytest
from topology_cases import box, grid_of

from bspline_mdao import InputError, read_grid, write_grid
from bspline_mdao.grids.io import files, formats
from bspline_mdao.grids.io.formats import (
    FORMATS,
    GridFormat,
    format_of_content,
    format_of_name,
    read_names,
    written_names,
)


@pytest.mark.parametrize("form", FORMATS, ids=lambda form: form.name)
def test_functions_of_a_format_are_there_and_its_names_are_its_own(form):
    assert callable(files._function(form, form.writer))
    assert not form.reader or callable(files._function(form, form.reader))
    names = [form.folder] if form.folder else [f"grid{suffix}" for suffix in form.suffixes]
    assert names
    for name in names:
        assert format_of_name(Path("folder") / name) is form


def test_names_in_help_are_those_of_the_table():
    assert read_names() == "PLOT3D or CGNS"
    assert (
        written_names()
        == ".xyz, .fmt (PLOT3D), .cgns, .vtm (ParaView), .dat (Tecplot), or a folder polyMesh (OpenFOAM)"
    )


def test_a_suffix_before_that_of_compression_counts_where_a_format_may_be_compressed():
    assert format_of_name(Path("a.xyz.gz")).name == "PLOT3D"
    assert format_of_name(Path("a.vtm.gz")) is None


@pytest.fixture
def simple_format(monkeypatch):
    """A format whose file is its signature and the nodes of one block, in a module and a line of its own."""

    def write(path, grid):
        Path(path).write_bytes(b"simple" + bytes(grid.shapes[0]) + grid.blocks[0].nodes.tobytes())

    def read(path):
        import numpy as np

        content = Path(path).read_bytes()
        return grid_of(np.frombuffer(content[9:]).reshape(*content[6:9], 3))

    module = types.ModuleType("bspline_mdao.grids.io.simple")
    module.write_simple, module.read_simple = write, read
    monkeypatch.setitem(sys.modules, module.__name__, module)
    form = GridFormat(
        "Simple", "simple", "write_simple", "read_simple", suffixes=(".simple",), signatures=((0, b"simple"),)
    )
    for where in (formats, files):
        monkeypatch.setattr(where, "FORMATS", (*FORMATS, form))
    return form


def test_a_format_is_a_module_and_a_line(tmp_path, simple_format):
    grid = grid_of(box([0.0, 1.0, 3.0], [0.0, 2.0], [0.0, 1.0, 2.0, 4.0]))
    write_grid(tmp_path / "a.simple", grid)
    assert (read_grid(tmp_path / "a.simple").blocks[0].nodes == grid.blocks[0].nodes).all()
    assert format_of_content(b"simple...") is simple_format
    assert read_names() == "PLOT3D, CGNS or Simple"
    assert written_names().endswith("a folder polyMesh (OpenFOAM), or .simple")
    with pytest.raises(InputError, match=r"name it \.vtm \(ParaView\), \.dat \(Tecplot\), \.cgns, \.simple, polyMesh"):
        write_grid(tmp_path / "a.other", grid)
