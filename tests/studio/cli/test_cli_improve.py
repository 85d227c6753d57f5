"""The command ``improve``: what it writes, tells and refuses."""

import numpy as np
import pytest
from adaptation_cases import skewed_grid, skewed_model
from test_cli import fails_as_expected, numbers

from bspline_mdao import fit_grid, read_grid, write_grid
from bspline_mdao.generators import brick_grid
from bspline_mdao.studio.cli.main import run

FEW = ["--iterations", "8"]


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    skewed_model().save("skewed.h5")
    return tmp_path


def test_improve_writes_the_grid_and_tells_before_and_after(workplace, capsys):
    assert run(["improve", "skewed.h5", "-o", "better.xyz", "--json", "b.json", *FEW]) == 0
    found, text = numbers("b.json"), capsys.readouterr().out
    assert found["after"]["q_min"] > 1.2 * found["before"]["q_min"]
    assert (found["n_moved"] > 0, found["reason"]) == (True, "")
    assert [set(block) for block in found["blocks"]] == [{"before", "after"}] * 2
    for words in ("smallest Q", "mean Q", "left", "right", "floor", "within 0.01", "better.xyz written"):
        assert words in text
    grid, given = read_grid("better.xyz"), skewed_grid()
    for new, old in zip(grid.blocks, given.blocks):
        np.testing.assert_allclose(new.nodes[:, :, 0], old.nodes[:, :, 0], atol=1e-12)
    assert run(["quality", "better.xyz", "--baseline", "skewed.h5", "--json", "q.json"]) == 0
    assert numbers("q.json")["q_min"] == pytest.approx(found["after"]["q_min"], rel=1e-9)
    assert numbers("q.json")["newly_inverted"] == []


def test_improve_takes_a_grid_with_patches_as_well(workplace):
    write_grid("skewed.xyz", skewed_grid())
    run(["inspect", "skewed.xyz", "--draft", "skewed.toml"])
    arguments = ["improve", "skewed.xyz", "--patches", "skewed.toml", "--n-control", "5x5x6", "-o", "better.vtm"]
    assert run([*arguments, *FEW]) == 0
    assert (workplace / "better.vtm").exists()


@pytest.mark.slow
def test_improve_says_why_a_grid_cannot_be_improved_and_writes_nothing(workplace, capsys):
    arguments = ["improve", "@flat_plate:9x8x7", "-o", "no.xyz", "--json", "no.json", *FEW]
    fails_as_expected(arguments, capsys, "@flat_plate:9x8x7: cannot be improved: ", "nothing was written")
    assert not (workplace / "no.xyz").exists()
    assert not (workplace / "no.json").exists()


def test_improve_refuses_what_it_cannot_use(workplace, capsys):
    fails_as_expected(["improve", "skewed.h5", "--n-control", "5x5x5", "-o", "b.xyz"], capsys, "leave out --n-control")
    fails_as_expected(["improve", "skewed.h5", "--slide", "lid", "-o", "b.xyz"], capsys, "no patch is called 'lid'")
    fails_as_expected(["improve", "skewed.h5", "--reach", "0.7", "-o", "b.xyz"], capsys, "0.7")
    fails_as_expected(["improve", "skewed.h5", "-o", "skewed.h5"], capsys, "skewed.h5")
    assert {path.name for path in workplace.iterdir()} == {"skewed.h5"}


def test_models_and_grids_with_suffixes_of_each_other_are_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    grid = brick_grid((5, 5, 5, 5))
    fit_grid(grid).save("model.cgns")
    write_grid("grid.cgns", grid)
    (tmp_path / "grid.cgns").rename("grid.h5")
    for command in ("improve", "quality"):
        output = ["-o", "better.xyz"] if command == "improve" else []
        fails_as_expected([command, "model.cgns", *output], capsys, "is a fitted model", "refine model.cgns", ".h5")
        fails_as_expected([command, "grid.h5", *output], capsys, "is a CGNS grid", "name it .cgns")
    assert {path.name for path in tmp_path.iterdir()} == {"model.cgns", "grid.h5"}


def test_a_model_is_not_written_where_a_grid_is(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fit_grid(brick_grid((5, 5, 5, 5))).save("m.h5")
    for command in ("improve", "refine"):
        arguments = [command, "m.h5", "-o", "x.h5"]
        fails_as_expected(arguments, capsys, "x.h5: a grid is written here", "name it", ".cgns", "bspline-mdao fit")
    assert {path.name for path in tmp_path.iterdir()} == {"m.h5"}
