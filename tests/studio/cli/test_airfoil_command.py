"""The command ``airfoil``: models, grids, numbers, what it says of sections, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from bspline_mdao import FittedModel, read_grid
from bspline_mdao.generators import airfoil_grid, naca_airfoil
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality
from bspline_mdao.studio.cli.main import run


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """Run the command in a folder of its own and return what it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    def command(*arguments, status=0):
        assert run(["airfoil", *arguments]) == status
        printed = capsys.readouterr()
        return "".join(printed) if status == 0 else printed.err

    return command


def lines(points):
    return "".join(f"{x:.6f} {y:.6f}\n" for x, y in points)


def test_a_model_has_the_wall_of_the_airfoil_and_no_invalid_element(said):
    words = said("naca2412", "-o", "foil.h5", "--around", "64", "--away", "24", "--json", "foil.json")
    model, numbers = FittedModel.load("foil.h5"), json.loads(Path("foil.json").read_text())
    assert "section: 12 % thick" in words
    assert "foil.h5 written" in words
    assert "warning" not in words
    np.testing.assert_allclose(
        model.regenerate().blocks[0].nodes, airfoil_grid("naca2412", 64, 24).blocks[0].nodes, atol=1e-11
    )
    assert [patch.name for patch in model.regenerate().patches] == ["airfoil", "farfield", "symmetry"]
    assert numbers["n_cells"] == 64 * 24
    assert numbers["n_inverted"] == numbers["fit"]["n_invalid_control_elements"] == 0
    assert numbers["fit"]["worst_on_walls"]["error"] < 2e-3
    assert (numbers["base"], numbers["unit"]) == (0.0, 1.0)


def test_a_c_grid_is_fitted_and_moved(said, capsys):
    assert "C-grid of 21 x 13 x 2, 33 x 13 x 2, 21 x 13 x 2 nodes" in said(
        "naca4412", "-o", "foil.h5", "--topology", "c", "--around", "32", "--away", "12", "--wake", "20"
    )
    assert run(["move", "foil.h5", "--deform", "pitch=3deg", "-o", "pitched.xyz"]) == 0
    assert "surface moved" in capsys.readouterr().out
    moved = read_grid("pitched.xyz")
    assert report_quality(GridQuality.of_baseline(moved), moved.to_vector().reshape(-1, 3)).n_inverted == 0
    np.testing.assert_allclose(moved.blocks[0].nodes[::-1, 0], moved.blocks[2].nodes[:, 0], atol=1e-12)


@pytest.mark.parametrize("name", ["foil.xyz", "foil.cgns"])
def test_a_grid_alone_is_written_by_its_suffix_with_layers_of_the_y_plus(said, name):
    words = said("cst:0.17,0.16/-0.17,-0.1", "-o", name, "--around", "48", "--y-plus", "1", "--reynolds", "2e6")
    assert f"{name} written" in words
    assert "y+" in words
    asked = airfoil_grid("cst:0.17,0.16/-0.17,-0.1", 48, y_plus=1.0, reynolds=2e6)
    np.testing.assert_allclose(read_grid(name).blocks[0].nodes, asked.blocks[0].nodes, atol=1e-12)


def test_the_y_plus_that_is_shown_is_the_one_that_was_asked_for_at_any_chord(said):
    layers = ("--y-plus", "2", "--reynolds", "2e6", "--chord", "0.3")
    said("naca0012", "-o", "f.xyz", "--around", "48", *layers, "--json", "f")
    (wall,) = json.loads(Path("f").read_text())["walls"]
    assert wall["y_plus"] == pytest.approx(2.0, rel=1e-6)


def test_a_grid_has_the_unit_that_was_asked_for_and_chord_and_first_cell_are_in_it(said):
    asked = ("naca0012", "--around", "48", "--chord", "300", "--first-cell", "0.2")
    words = said(*asked, "--units", "mm", "-o", "foil.cgns")
    assert "min (mm)" in words
    grid = read_grid("foil.cgns")
    assert grid.unit == "mm"
    assert np.ptp(grid.blocks[0].nodes[:, 0, :, 0]) == pytest.approx(300.0, rel=1e-6)
    said(*asked, "--units", "in", "-o", "foil.h5")
    assert FittedModel.load("foil.h5").header.length_unit == "in"
    assert "lengths for metres, and these are in mm" in said(*asked, "--units", "mm", "-o", "case/constant/polyMesh")
    said(*asked, "-o", "plain.cgns")
    assert read_grid("plain.cgns").length_unit == "m"


def test_what_is_done_to_a_blunt_shifted_or_inclined_file_is_said(said):
    Path("foil.dat").write_text("2412\n" + lines(100.0 * naca_airfoil("2412", blunt=True).points[::4]))
    words = said("foil.dat", "-o", "foil.xyz", "--around", "32", "--away", "8")
    assert "the chord is 100.008 long there: scaled to 1 m" in words
    assert "the trailing edge is 0.252 % thick: it is closed by a wedge off both sides" in words
    Path("shifted.dat").write_text(lines(naca_airfoil("2412").points[::4] + [0.3, 0.0]))
    words = said("shifted.dat", "-o", "foil.xyz", "--overwrite", "--around", "32", "--away", "8")
    assert "the chord is 1.00008 long there: scaled to 1 m, with the nose at the origin" in words
    assert "the chord is inclined" not in words
    turned = naca_airfoil("2412").points[::4] @ [[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]]
    Path("turned.dat").write_text(lines(turned))
    words = said("turned.dat", "-o", "foil.xyz", "--overwrite", "--around", "32", "--away", "8")
    assert "the chord is inclined by 5.82 deg there, nose up, and stays so: angles of attack add to it" in words
    thick = said("cst:0.2,0.2/-0.2,-0.2/0.03", "-o", "thick.xyz", "--overwrite", "--around", "32", "--away", "8")
    assert "warning: the trailing edge is 3 % thick" in thick


def test_a_file_of_too_few_points_is_warned_of(said):
    for step, is_warned in ((40, True), (8, False)):
        Path("few.dat").write_text(lines(naca_airfoil("0012").points[::step]))
        words = said("few.dat", "-o", "few.xyz", "--overwrite", "--around", "32", "--away", "8")
        assert ("warning: 11 points are too few to determine the outline" in words) == is_warned


def test_where_a_cusp_inverts_a_cell_of_an_o_grid_a_c_grid_is_named_which_has_none(said):
    cusped = ("cst:0.17,0.16,0.3/-0.17,-0.1,0.3", "-o", "foil.xyz", "--overwrite", "--around", "64", "--away", "32")
    refused = said(*cusped, status=2)
    assert (
        "1 inverted cell, the worst cell (1, 1, 1) of around the airfoil; nothing was written; give --topo" in refused
    )
    assert refused.endswith("give --topology C, or more cells --around, or --allow-invalid to write it\n")
    assert refused.count("\n") == 1
    assert not list(Path().iterdir())
    words = said(*cusped, "--allow-invalid")
    assert "warning: 1 inverted cell; give --topology C, or more cells --around" in words
    assert "foil.xyz written" in words
    assert "0 inverted" in said(*cusped, "--topology", "C")


def test_init_says_that_it_drafts_no_bound_of_the_cells_where_some_are_inverted(said, capsys):
    warned = "warning: draft.toml: no bound of corner_ks is drafted: it is -0.0"
    for name, is_warned in (("cst:0.17,0.16,0.3/-0.17,-0.1,0.3", True), ("naca0012", False)):
        said(name, "-o", "foil.cgns", "--overwrite", "--around", "32", "--away", "16", "--allow-invalid")
        assert run(["init", "foil.cgns", "-o", "draft.toml", "--overwrite"]) == 0
        assert (warned in capsys.readouterr().err) == is_warned
        assert ("[constraints.corner_ks]" in Path("draft.toml").read_text()) != is_warned


def test_a_c_grid_keeps_the_base_and_says_so(said):
    small = ("--topology", "C", "--around", "32", "--away", "8", "--wake", "20")
    words = said("cst:0.2,0.2/-0.2,-0.2/0.03", "-o", "foil.h5", *small)
    assert "the trailing edge is 3 % thick: it is kept, a wall with a block behind it; --base closed closes it" in words
    assert [patch.name for patch in FittedModel.load("foil.h5").regenerate().patches] == [
        "airfoil", "base", "farfield", "symmetry"
    ]  # fmt: skip
    assert "0.252 % thick: it is kept" in said("naca0012", "-o", "foil.xyz", "--overwrite", *small, "--base", "wall")
    words = said("cst:0.2,0.2/-0.2,-0.2/0.003", "-o", "foil.xyz", "--overwrite", *small, "--base", "closed")
    assert "no point by more than 0.15 % of the chord\n" in words
    words = said("cst:0.2,0.2/-0.2,-0.2/0.003", "-o", "foil.xyz", "--overwrite", *small[2:6])
    assert "no point by more than 0.15 % of the chord; --topology C keeps it" in words
    assert "its trailing edge is sharp" in said(
        "cst:0.2/-0.2", "-o", "foil.xyz", "--overwrite", *small, "--base", "wall", status=2
    )


def test_one_side_of_a_file_is_mirrored_by_an_option(said):
    Path("half.txt").write_text(lines(naca_airfoil("0012").points[200::-4]))
    assert "--symmetric" in said("half.txt", "-o", "foil.xyz", status=2)
    assert "12 % thick" in said("half.txt", "-o", "foil.xyz", "--around", "32", "--away", "8", "--symmetric")
    nodes = read_grid("foil.xyz").blocks[0].nodes[:, 0, 0]
    np.testing.assert_allclose(nodes[:, 1], -nodes[::-1, 1], atol=1e-9)


def test_help_says_what_an_airfoil_is_which_need_a_file_and_how_long_its_chord_becomes(said):
    words = " ".join(said("--help").split())
    assert "four or five NACA digits" in words
    assert "a file of points in Selig or Lednicer order, or two plain columns, in any unit: it is scaled to" in words
    assert "such as the NACA 6-series, need such a file" in words


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["naca12", "-o", "f.h5"], "NACA '12': give four or five digits"),
        (["naca64-215", "-o", "f.h5"], "those of the 6-series, need a file of points"),
        (["nowhere.dat", "-o", "f.h5"], "nowhere.dat: No such file"),
        (["naca0012", "-o", "f.foo"], "no '.foo' files are written"),
        (["naca0012", "-o", "f.h5", "--around", "33"], "33 cells around it"),
        (["naca0012", "-o", "f.h5", "--y-plus", "1"], "y+ and the Reynolds number go together"),
        (["naca0012", "-o", "f.h5", "--symmetric"], "is not a file"),
        (["naca0012", "-o", "f.h5", "--first-cell", "-1"], "--first-cell"),
    ],
)
def test_what_cannot_be_made_is_one_line_and_nothing_is_written(said, arguments, message):
    error = said(*arguments, status=2)
    assert message in error
    assert error.count("\n") == 1
    assert not list(Path().iterdir())


def test_a_section_that_would_change_along_the_span_is_warned_of(tmp_path, capsys):
    model = str(tmp_path / "foil.h5")
    assert run(["airfoil", "naca0012", "--around", "32", "--away", "12", "-o", model]) == 0
    warned = "the walls are a section, the same along the span, and 'twist' and 'sweep' would change it along the span"
    for name, deform, is_warned in (("a.xyz", "twist=3deg+sweep=2deg", True), ("b.xyz", "pitch=3deg", False)):
        assert run(["move", model, "--deform", deform, "-o", str(tmp_path / name)]) == 0
        assert (warned in " ".join(capsys.readouterr().err.split())) == is_warned
