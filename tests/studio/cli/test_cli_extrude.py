"""The command ``extrude``: what it writes, tells and refuses."""

import numpy as np
import pytest
from test_cli import fails_as_expected, numbers

from bspline_mdao import FittedModel, Grid, find_topology, read_grid, write_grid
from bspline_mdao.core.generators.first_cell import first_cell_of
from bspline_mdao.generators import ball_grid, brick_grid
from bspline_mdao.grids import Block
from bspline_mdao.studio.cli.main import run


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, grid in (("ball", ball_grid((7, 6, 5, 3))), ("octant", brick_grid((5, 6, 4, 3), octant=True))):
        write_grid(f"{name}.xyz", Grid(tuple(Block(b.nodes[:, :, :1].copy(), b.name) for b in grid.blocks)))
    return tmp_path


def test_extrude_writes_a_grid_with_patches_that_fit_takes(workplace, capsys):
    argv = ["extrude", "ball.xyz", "-o", "out.cgns", "--first-cell", "0.01", "--layers", "8", "--outer", "3"]
    assert run([*argv, "--json", "n.json"]) == 0
    found, text = numbers("n.json"), capsys.readouterr().out
    grid = read_grid("out.cgns")
    assert [list(shape) for shape in grid.shapes] == found["blocks"]
    assert len(find_topology(grid).interfaces) == 12
    assert {patch.name: patch.kind for patch in grid.patches} == {"wall": "wall", "farfield": "farfield"}
    assert found["n_inverted"] == 0
    for words in ("out.cgns", "0 inverted", "within 1 %", "wall (wall)"):
        assert words in text
    assert run(["fit", "out.cgns", "-o", "out.h5"]) == 0
    assert run([*argv[:3], "model.h5", *argv[4:]]) == 0
    fitted = [FittedModel.load(name).regenerate().to_vector() for name in ("out.h5", "model.h5")]
    np.testing.assert_allclose(*fitted, atol=1e-9)


def test_extrude_takes_planes_by_their_normals(workplace):
    argv = [
        "extrude",
        "octant.xyz",
        "-o",
        "out.xyz",
        "--overwrite",
        "--first-cell",
        "0.01",
        "--layers",
        "9",
        "--outer",
        "4",
    ]
    planes = ["--symmetry", "x", "--symmetry", "0,-2,0", "--symmetry", "z"]
    assert run([*argv, *planes, "--json", "n.json"]) == 0
    assert list(numbers("n.json")["patches"].values()).count("symmetry") == 3
    assert run([*argv, "--symmetry", "none", "--json", "n.json"]) == 0
    assert numbers("n.json")["patches"]["edges"] == "farfield"


def test_extrude_takes_y_plus_and_tells_the_height_it_is(workplace, capsys):
    argv = ["extrude", "ball.xyz", "-o", "out.xyz", "--overwrite", "--layers", "12", "--outer", "3", "--json", "n.json"]
    assert run([*argv, "--y-plus", "30", "--reynolds", "1e5", "--length", "0.5"]) == 0
    asked = numbers("n.json")["heights"]["asked"]
    assert asked == first_cell_of(0.5, None, 30.0, 1e5)
    assert numbers("n.json")["walls"][0]["height_median"] == pytest.approx(asked, rel=0.01)
    told = "".join(capsys.readouterr())
    for words in ("y+ 30 of a plate of 0.5", f"of the {asked:.4g}"):
        assert words in told
    assert run([*argv, "--y-plus", "30", "--reynolds", "1e5"]) == 0  # of the middle side of the box, as the table is
    assert numbers("n.json")["walls"][0]["y_plus"] == pytest.approx(30.0, rel=0.01)


def test_extrude_takes_periodic_planes(workplace):
    argv = [
        "extrude",
        "octant.xyz",
        "-o",
        "out.xyz",
        "--overwrite",
        "--first-cell",
        "0.01",
        "--layers",
        "9",
        "--outer",
        "4",
    ]
    x, y = np.meshgrid(np.linspace(0, 1, 5), np.linspace(0, 2, 6), indexing="ij")
    write_grid("octant.xyz", Grid((Block(np.stack([x, y, 0.1 * np.sin(np.pi * y)], axis=-1)[:, :, None], "waves"),)))
    assert run([*argv, "--symmetry", "x", "--periodic", "0,2,0", "--json", "n.json"]) == 0
    assert numbers("n.json")["patches"]["periodic"] == "other"


def test_extrude_joins_a_background_that_inspect_and_fit_see(workplace, capsys):
    argv = ["extrude", "ball.xyz", "-o", "out.cgns", "--first-cell", "0.01", "--layers", "8", "--background", "6"]
    assert run([*argv, "--json", "n.json"]) == 0
    assert numbers("n.json")["patches"]["overset"] == "overset"
    capsys.readouterr()
    assert run(["inspect", "out.cgns"]) == 0
    assert "patches declared as overset: overset" in capsys.readouterr().out
    assert run(["fit", "out.cgns", "-o", "out.h5"]) == 0
    assert run(["move", "out.h5", "--design", "wall", "--deform", "pitch=5deg", "-o", "moved.cgns"]) == 0
    assert read_grid("moved.cgns").shapes == read_grid("out.cgns").shapes


def test_improve_raises_the_worst_cells_of_an_extruded_grid(workplace):
    argv = ["extrude", "octant.xyz", "-o", "out.cgns", "--first-cell", "0.05", "--layers", "9", "--outer", "4"]
    assert run([*argv, *(option for axis in "xyz" for option in ("--symmetry", axis))]) == 0
    assert run(["improve", "out.cgns", "-o", "better.cgns", "--json", "b.json", "--iterations", "8"]) == 0
    found = numbers("b.json")
    assert found["after"]["q_min"] > found["before"]["q_min"]
    assert read_grid("better.cgns").shapes == read_grid("out.cgns").shapes


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "first cells of no height"),
        (["--y-plus", "1"], "go together"),
        (["--first-cell", "0.01", "--symmetry", "1,a,2"], "no normal of a plane"),
        (["--first-cell", "0.01", "--layers", "2"], "give more layers"),
    ],
)
def test_bad_requests_leave_no_file(workplace, capsys, options, said):
    fails_as_expected(["extrude", "ball.xyz", "-o", "out.cgns", *options], capsys, said)
    assert not (workplace / "out.cgns").exists()
