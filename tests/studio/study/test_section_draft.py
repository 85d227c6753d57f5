"""Drafts for airfoils: least drag at a lift, the shape as one curve, area and thickness kept, on any blocks."""

from itertools import pairwise

import numpy as np
import pytest
from study_cases import study_of

from bspline_mdao import Grid, fit_grid, read_grid, write_grid
from bspline_mdao.generators import airfoil_grid, infinite_wing_grid, naca_section
from bspline_mdao.grids import Block, Patch, Window
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.study.draft import study_draft
from bspline_mdao.studio.study.draft_body import GridBody


def o_grid(n_blocks=1, depth=1.0, turn=(0, 1, 2), name="naca0012", far="farfield"):
    """O-grid in blocks side by side, of any depth, with its coordinates in another order."""
    nodes = airfoil_grid(name, 32, 12, far=10.0).blocks[0].nodes * [1.0, 1.0, depth]
    ends = np.linspace(0, 32, n_blocks + 1).astype(int)
    blocks = [nodes[a : b + 1][..., turn] for a, b in pairwise(ends)]
    if np.linalg.det(np.eye(3)[list(turn)]) < 0.0:
        blocks = [block[:, :, ::-1] for block in blocks]
    faces = [Window.whole(number, block.shape[:3]).face for number, block in enumerate(blocks)]
    sides = {"foil": ("wall", (2,)), "far": (far, (3,)), "planes": ("symmetry", (4, 5))}
    patches = tuple(Patch(n, kind, tuple(f(s) for f in faces for s in of)) for n, (kind, of) in sides.items())
    return Grid(tuple(Block(block, f"part {number}") for number, block in enumerate(blocks)), patches, source="O-grid")


def draft(folder, grid):
    write_grid(folder / "foil.cgns", grid)
    text = study_draft("foil.cgns", None, GridBody(grid, find_topology(grid)))
    return study_of(folder, text), text


@pytest.mark.parametrize("n_blocks", [1, 2, 3])
@pytest.mark.parametrize("depth", [1.0, 0.1, 20.0])
def test_an_airfoil_in_any_blocks_and_of_any_depth_gets_least_drag_at_a_lift(tmp_path, n_blocks, depth):
    study, text = draft(tmp_path, o_grid(n_blocks, depth))
    assert (study.flow["kind"], study.flow["trim"], study.flow["axes"]) == ("euler", True, "xzy")
    assert (study.flow["CL_target"], study.flow["Mach_number"]) == (0.5, 0.75)
    assert study.objective["of"] == "CD"
    assert set(study.constraints) == {"section_area", "section_thickness", "thickness", "corner_ks"}
    assert study.constraints["section_area"]["equals"] == 1.0
    assert study.constraints["section_thickness"]["equals"] == pytest.approx(0.12, abs=2e-3)
    assert {table["kind"] for table in study.variables.values()} == {"class_shape"}
    assert "lattice, for" not in text


def test_axes_are_those_of_the_grid(tmp_path):
    assert draft(tmp_path, o_grid(turn=(0, 2, 1)))[0].flow["axes"] == "xyz"
    assert draft(tmp_path, o_grid(turn=(2, 0, 1), depth=0.2))[0].flow["axes"] == "yxz"


def test_a_thick_section_is_flown_slower(tmp_path):
    machs = [draft(tmp_path, o_grid(name=name))[0].flow["Mach_number"] for name in ("naca0006", "naca0021")]
    assert machs == [0.81, 0.66]


def test_an_h_grid_about_a_section_is_an_airfoil_as_well(tmp_path):
    study, _ = draft(tmp_path, infinite_wing_grid(naca_section(0.12), (9, 7)))
    assert study.objective["of"] == "CD"


def test_a_c_grid_is_an_airfoil_as_well(tmp_path):
    study, _ = draft(tmp_path, airfoil_grid("naca0012", 32, 12, far=10.0, topology="C", n_wake=12))
    assert (study.objective["of"], study.flow["kind"], study.flow["trim"]) == ("CD", "euler", True)
    assert {table["kind"] for table in study.variables.values()} == {"class_shape"}


def test_where_no_flow_can_be_had_the_draft_says_why_and_nothing_untrue(tmp_path):
    study, text = draft(tmp_path, o_grid(far="other"))
    assert study.flow is None
    assert "a section has no span;\n# other boundaries are not symmetry and farfield alone." in text
    assert "no wing" not in text


@pytest.mark.slow
def test_what_is_drafted_of_an_airfoil_runs_and_loses_drag(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fit_grid(o_grid(2, 0.3)).save("foil.h5")
    assert run(["init", "foil.h5", "-o", "study.toml"]) == 0
    assert run(["optimize", "study.toml", "-o", "out"]) == 0
    table = capsys.readouterr().out
    assert "section_area" in table
    before, after = (read_grid(f"out/grid_{when}.xyz") for when in ("before", "after"))
    for old, new in zip(before.blocks, after.blocks):
        assert np.abs(new.nodes - old.nodes).max() > 1e-4
        np.testing.assert_allclose(new.nodes[:, :, 0, :2], new.nodes[:, :, 1, :2], atol=1e-12)
    (line,) = (line for line in (tmp_path / "out" / "summary.csv").read_text().splitlines() if "objective" in line)
    assert "CD" in line


def drafted(folder, *arguments):
    """The study that ``init`` drafts of an airfoil with these arguments."""
    write_grid(folder / "foil.cgns", o_grid())
    assert run(["init", "foil.cgns", "-o", "study.toml", *arguments]) == 0
    return study_of(folder, (folder / "study.toml").read_text())


def test_several_mach_numbers_are_conditions_whose_drags_have_one_mean(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study = drafted(tmp_path, "--mach", "0.7", "--mach", "0.725", "--lift", "0.6", "--lift", "0.4")
    found = {name: (table["Mach_number"], table["CL_target"]) for name, table in study.conditions.items()}
    assert found == {"mach_070": (0.7, 0.6), "mach_0725": (0.725, 0.4)}
    assert study.objective["of"] == "CD"
    assert all(table["trim"] for table in study.conditions.values())


def test_several_lifts_are_conditions_at_one_mach_number(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study = drafted(tmp_path, "--mach", "0.7", "--lift", "0.3", "--lift", "0.6")
    assert list(study.conditions) == ["mach_070_lift_030", "mach_070_lift_060"]


def test_one_mach_number_and_lift_are_those_of_the_flow(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study = drafted(tmp_path, "--mach", "0.6", "--lift", "0.7")
    assert (study.flow["Mach_number"], study.flow["CL_target"], study.conditions) == (0.6, 0.7, {})


@pytest.mark.slow
@pytest.mark.parametrize("machs", [("0.7",), ("0.7", "0.74")])
def test_lift_by_drag_is_the_largest_at_an_angle_that_is_free_and_has_friction(tmp_path, monkeypatch, machs):
    monkeypatch.chdir(tmp_path)
    study = drafted(tmp_path, "--lift-to-drag", *(word for mach in machs for word in ("--mach", mach)))
    assert study.objective["maximize"]
    assert study.objective["of"].count("0.006") == len(machs)
    assert "alpha" in study.variables
    assert run(["optimize", "study.toml", "-o", "out", "--max-iterations", "1"]) == 0
    rows = [row.split(",") for row in (tmp_path / "out" / "summary.csv").read_text().splitlines()]
    before = {row[1].rpartition(".")[0] + row[1].rpartition(".")[2]: float(row[2]) for row in rows[1:]}
    names = list(study.conditions) or [""]
    ratios = [before[f"{name}CL"] / (before[f"{name}CD"] + 0.006) for name in names]
    assert float(rows[1][2]) == pytest.approx(sum(ratios), rel=1e-12)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--mach", "0.7", "--mach", "0.7"], "a flight condition is given twice"),
        (["--mach", "0.7", "--mach", "0.72", *["--lift", "0.3"] * 3], "--mach is given 2 times and --lift 3 times"),
        (["--lift-to-drag", "--lift", "0.3"], "--lift does not go with --lift-to-drag"),
    ],
)
def test_conditions_that_do_not_go_together_are_refused(tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    write_grid(tmp_path / "foil.cgns", o_grid())
    assert run(["init", "foil.cgns", "-o", "study.toml", *arguments]) == 2
    assert words in capsys.readouterr().err


def test_mach_numbers_of_what_is_no_airfoil_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run(["init", "@onera_m6:7x7x5", "-o", "study.toml", "--mach", "0.7"]) == 2
    assert "is no section in Euler flow; --mach, --lift and --lift-to-drag are of airfoils" in capsys.readouterr().err
