"""Units of lengths: read of the file, or given, kept, shown and written; no number is rescaled."""

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
from grid_cases import smooth_grid

from bspline_mdao import FittedModel, fit_grid, write_grid
from bspline_mdao.errors import InputError
from bspline_mdao.generators import ball_grid
from bspline_mdao.grids.io.cgns import open_cgns, read_cgns, write_cgns
from bspline_mdao.grids.io.cgns_nodes import add_node
from bspline_mdao.grids.topology.length_unit import LENGTH_UNITS, in_unit
from bspline_mdao.grids.topology.periodic_pair import Motion
from bspline_mdao.studio.cli.main import run


def in_words(path, words, data_class="Dimensional", where="Base"):
    """Write a CGNS file whose node at a place says the unit of lengths in CGNS's words."""
    write_cgns(path, smooth_grid())
    with h5py.File(path, "a") as file:
        if "DataClass" in file["Base"]:
            del file["Base/DataClass"]
        add_node(file[where], "DataClass", "DataClass_t", data_class)
        letters = np.frombuffer("".join(word.ljust(32) for word in words).encode(), np.int8).reshape(5, 32)
        node = add_node(file[where], "Units", "DimensionalUnits_t", "x")
        del node[" data"]
        node.create_dataset(" data", data=letters)
    return path


@pytest.mark.parametrize(
    ("word", "unit"),
    [("Meter", "m"), ("Centimeter", "cm"), ("Inch", "in"), ("Foot", "ft"), ("Millimeter", "mm"), ("Null", "")],
)
def test_units_of_cgns_are_read_and_nodes_stay(tmp_path, word, unit):
    path = in_words(tmp_path / "grid.cgns", ["Gram", word, "Second", "Kelvin", "Degree"])
    read = read_cgns(path)
    assert read.unit == open_cgns(path).unit == unit
    np.testing.assert_array_equal(read.to_vector(), smooth_grid().to_vector())


def test_the_innermost_node_that_says_a_unit_counts_and_data_without_dimension_have_none(tmp_path):
    words = ["Null", "Inch", "Null", "Null", "Null"]
    path = in_words(tmp_path / "a.cgns", words, where="Base/block 1")
    with pytest.raises(InputError, match=r"lengths are in in /Base/block 1 and not stated in /Base/block 2; write all"):
        read_cgns(path)
    path = in_words(tmp_path / "b.cgns", words, "NondimensionalParameter")
    assert read_cgns(path).unit == ""


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["", *LENGTH_UNITS])
def test_a_unit_is_kept_by_the_model_and_by_cgns_files_that_are_written(tmp_path, unit):
    grid = replace(ball_grid((4, 4, 4, 3), far=4.0), unit=unit)
    fit_grid(grid).save(tmp_path / "ball.h5")
    moved = FittedModel.load(tmp_path / "ball.h5").regenerate()
    assert moved.unit == unit
    write_grid(tmp_path / "new.cgns", moved)
    again = read_cgns(tmp_path / "new.cgns")
    assert again.unit == unit
    write_cgns(tmp_path / "copy.cgns", again)
    assert read_cgns(tmp_path / "copy.cgns").unit == unit
    np.testing.assert_array_equal(read_cgns(tmp_path / "copy.cgns").to_vector(), moved.to_vector())


def test_a_unit_that_the_user_gives_goes_into_the_copy_of_a_file_without_one(tmp_path):
    write_cgns(tmp_path / "grid.cgns", smooth_grid())
    write_cgns(tmp_path / "copy.cgns", in_unit(read_cgns(tmp_path / "grid.cgns"), "ft"))
    assert read_cgns(tmp_path / "copy.cgns").unit == "ft"
    with pytest.raises(InputError, match="its file says that lengths are in ft, not mm; leave out --units"):
        in_unit(read_cgns(tmp_path / "copy.cgns"), "mm")
    with pytest.raises(InputError, match="no unit is called 'mile'; choose one of m, cm, mm, in, ft"):
        in_unit(smooth_grid(), "mile")


def test_motions_of_periodic_faces_are_in_the_unit_of_the_grid():
    assert str(Motion(shift=(0.0, 2.0, 0.0), unit="mm")).endswith(" mm")
    assert str(Motion((0.0, 0.0, 1.0), 0.5, (1.0, 0.0, 0.0), unit="in")).count(" in ") == 1


@pytest.mark.slow
def test_commands_show_lengths_in_the_unit_that_is_given(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    grid = replace(ball_grid((5, 5, 5, 4), far=4.0))
    write_grid("ball.cgns", grid)
    write_grid("inch.cgns", replace(grid, unit="in"))

    def said(*arguments):
        assert run(list(arguments)) == 0
        return " ".join("".join(capfd.readouterr()).split())

    told = said("inspect", "ball.cgns", "--units", "mm", "--json", "i.json")
    assert "unit of length: mm" in told
    assert "first heights at min (mm)" in told
    assert json.loads((tmp_path / "i.json").read_text())["units"] == "mm"
    assert "first heights at min (in)" in said("inspect", "inch.cgns")
    assert "first heights at min (m)" in said("inspect", "ball.cgns")
    assert "RMS (mm)" in said("fit", "ball.cgns", "-o", "ball.h5", "--units", "mm")
    told = said("move", "ball.h5", "--deform", "translate=0.01/0/0", "-o", "moved.cgns")
    assert "surface moved by up to 0.01 mm" in told
    assert "smallest volume (mm^3)" in told
    assert read_cgns("moved.cgns").unit == "mm"
    assert "first heights at nodes min (mm)" in said("quality", "moved.cgns", "--baseline", "ball.h5")
    assert "these are in mm: scale the points by 0.001" in said("refine", "ball.h5", "-o", "polyMesh")
    for command in (["inspect", "ball.h5"], ["quality", "ball.h5"], ["quality", "inch.cgns"]):
        assert run([*command, "--units", "ft"]) == 2
        assert "--units" in capfd.readouterr().err
