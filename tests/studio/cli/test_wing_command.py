"""The command ``wing``: models and grids of planforms and sections, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from bspline_mdao import FittedModel, read_grid
from bspline_mdao.generators import KinkedPlanform, Planform, Wing, airfoil, hh_wing_grid
from bspline_mdao.grids.cells.wall_spacing import flat_plate_y_plus
from bspline_mdao.studio.cli.main import run

PLANFORM = """[planform]
root_chord = 1.2
semi_span = 3.0
taper = 0.5
sweep = 20.0
{planform}
[sections]
root = "{root}"
tip = "naca0010"
[grid]
nodes = [6, 7, 5]
{grid}
"""


def written(planform="", root="naca2414", grid=""):
    """A file of a planform."""
    Path("wing.toml").write_text(PLANFORM.format(planform=planform, root=root, grid=grid))


@pytest.fixture
def said(tmp_path, monkeypatch, capsys):
    """Run the command in a folder of its own and return what it prints."""
    monkeypatch.chdir(tmp_path)

    def command(*arguments, status=0):
        assert run(["wing", "wing.toml", *arguments]) == status
        printed = capsys.readouterr()
        return printed.out if status == 0 else printed.err

    return command


def test_a_model_regenerates_the_grid_of_planform_and_sections(said):
    written()
    words = said("-o", "wing.h5", "--json", "wing.json")
    wing = Wing(Planform(1.2, 3.0, 0.5, 20.0), airfoil("naca2414").section, airfoil("naca0010").section)
    model, numbers = FittedModel.load("wing.h5"), json.loads(Path("wing.json").read_text())
    asked = hh_wing_grid(wing, (6, 7, 5))
    np.testing.assert_allclose(model.regenerate().to_vector(), asked.to_vector(), atol=1e-10)
    assert [patch.name for patch in model.regenerate().patches] == [patch.name for patch in asked.patches]
    assert "chords 1.2 and 0.6 m" in words
    assert "10 % at the tip" in words
    assert "warning" not in words
    assert numbers["n_inverted"] == 0
    assert numbers["aspect_ratio"] == pytest.approx(6.0 / 0.9)


KINKED = """[planform]
stations = [[0, 0, 1.6], [1.2, 0.9, 1.0], [4.0, 1.9, 0.5]]
{more}
[sections]
root = "naca2412"
[grid]
nodes = [7, 8, {n_span}]
"""


def test_a_wing_with_a_kink_has_blocks_that_end_there_and_a_model_with_its_corner(said):
    Path("wing.toml").write_text(KINKED.format(more="", n_span=13))
    words = said("-o", "wing.h5", "--json", "wing.json")
    model, numbers = FittedModel.load("wing.h5"), json.loads(Path("wing.json").read_text())
    assert "1 kink at 1.2 m" in words
    assert "18 blocks of 7 x 8 x 4 and 7 x 8 x 10 and 7 x 8 x 13 nodes" in words
    assert (numbers["n_inverted"], numbers["fit"]["n_invalid_control_elements"], numbers["kinks"]) == (0, 0, [1.2])
    assert numbers["aspect_ratio"] == pytest.approx(2.0 * 16.0 / (1.3 * 1.2 + 0.75 * 2.8))
    blocks = {block.name: block.nodes for block in model.regenerate().blocks}
    for panel, k in (("panel 1", -1), ("panel 2", 0)):
        kink = blocks[f"wing above {panel}"][:, 0, k]
        np.testing.assert_allclose(kink[[0, -1]], [[0.9, 0.0, 1.2], [1.9, 0.0, 1.2]], atol=1e-12)
        np.testing.assert_allclose(kink[:, 2], 1.2, atol=1e-12)
    assert run(["init", "wing.h5", "-o", "study.toml"]) == 0
    assert "twist" in Path("study.toml").read_text()


@pytest.mark.parametrize(
    ("more", "n_span", "complaint"),
    [
        ("taper = 0.5", 13, "[planform] stations, and taper as well; give one of both"),
        ("", 6, "6 nodes along 2 panels; give 7 at least"),
    ],
)
def test_stations_that_do_not_fit_are_refused(said, more, n_span, complaint):
    Path("wing.toml").write_text(KINKED.format(more=more, n_span=n_span))
    assert complaint in said("-o", "wing.h5", status=2).replace("'planform'", "[planform]")


STATIONS = """[planform]
tip_length = 0.1
{more}
[[stations]]
span = 0.0
leading = 0.0
chord = 1.6
{root}

[[stations]]
span = 1.2
leading = 0.9
chord = 1.0

[[stations]]
span = 2.5
leading = 1.2
chord = 0.8
section = "naca0010"

[[stations]]
span = 4.0
leading = 1.9
chord = 0.5
{tip}

[grid]
nodes = [7, 8, 16]
"""


def test_stations_have_sections_of_their_own(said):
    Path("wing.toml").write_text(STATIONS.format(more="", root='section = "naca2414"', tip='section = "naca4412"'))
    words = said("-o", "wing.h5", "--json", "wing.json")
    form = KinkedPlanform([[0.0, 0.0, 1.6], [1.2, 0.9, 1.0], [2.5, 1.2, 0.8], [4.0, 1.9, 0.5]])
    root, middle, tip = (airfoil(name).section for name in ("naca2414", "naca0010", "naca4412"))
    asked = hh_wing_grid(Wing(form, root, tip, 0.1, [(2.5, middle)]), (7, 8, 16))
    found = FittedModel.load("wing.h5").regenerate().to_vector()
    np.testing.assert_allclose(found, asked.to_vector(), atol=1e-10)
    assert "sections: 14.01 % thick at the root, 12.01 % at the tip, 10 % at 2.5 m" in words
    numbers = json.loads(Path("wing.json").read_text())
    assert numbers["thickness_between"] == [[2.5, pytest.approx(0.1, abs=1e-3)]]
    assert (numbers["n_inverted"], numbers["kinks"]) == (0, [1.2, 2.5])


def test_a_tip_without_a_section_has_the_last_one(said):
    Path("wing.toml").write_text(STATIONS.format(more="", root='section = "naca2414"', tip=""))
    assert "10 % at the tip" in said("-o", "wing.xyz")


@pytest.mark.parametrize(
    ("more", "root", "tip", "complaint"),
    [
        ("", "", "", "line 4: 'stations' '1' has no key 'section' at the root"),
        ("taper = 0.5", 'section = "naca2414"', "", "line 3: [planform] 'taper' and [[stations]] as well; give one of"),
        ("", 'section = "naca2414"', 'section = "naca24"', "line 25: [stations.4] 'section' "),
        ("", 'section = "naca2414"', "sektion = 3", "line 25: [stations.4] 'sektion' is no key; did you mean"),
        ("", 'section = "naca2414"\n[[stations]]\nspan = 0.0', "", "line 9: 'stations' '2' has no key 'leading'"),
    ],
)
def test_what_is_wrong_in_a_station_is_named_with_its_line(said, more, root, tip, complaint):
    Path("wing.toml").write_text(STATIONS.format(more=more, root=root, tip=tip))
    assert complaint in said("-o", "wing.h5", status=2).replace("[stations] '1'", "'stations' '1'").replace(
        "[stations] '2'", "'stations' '2'"
    )


def test_spacings_of_the_file_are_those_of_the_grid(said):
    written(grid="y_plus = 30.0\nreynolds = 3e5\nleading = 0.05\nfar = 7.5")
    words = said("-o", "wing.cgns", "--json", "wing.json")
    grid, walls = read_grid("wing.cgns"), json.loads(Path("wing.json").read_text())["walls"]
    assert flat_plate_y_plus(walls[0]["height_max"], 3e5 / 1.2, 1.2) == pytest.approx(30.0, rel=0.1)
    assert np.abs(grid.to_vector().reshape(-1, 3)[:, 1]).max() == pytest.approx(7.5, rel=1e-9)
    assert max(map(len, words.splitlines()[:9])) <= 120
    assert "y+" in words


def test_a_section_of_a_file_is_looked_for_beside_the_planform(said, tmp_path, monkeypatch):
    written(root="sections/foil.dat")
    Path("sections").mkdir()
    Path("sections/foil.dat").write_text("\n".join(f"{x:.9f} {y:.9f}" for x, y in airfoil("naca2414").points))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir("elsewhere")
    assert run(["wing", "../wing.toml", "-o", "wing.xyz"]) == 0
    found = read_grid("wing.xyz").to_vector()
    monkeypatch.chdir("..")
    written()
    said("-o", "digits.xyz")
    np.testing.assert_allclose(found, read_grid("digits.xyz").to_vector(), atol=1e-7)


@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"planform": "tapper = 0.5"}, "line 6: [planform] 'tapper' is no key; did you mean 'taper'?"),
        ({"planform": "tip_length = -1"}, "line 6: [planform] 'tip_length' is -1; give a positive number"),
        ({"root": "nowhere.dat"}, "line 8: [sections] 'root' nowhere.dat: No such file"),
        ({"root": "naca24"}, "line 8: [sections] 'root' "),
        ({"grid": "y_plus = 1.0"}, "'grid' first cells: y+ and the Reynolds number go together"),
        ({"grid": "first_cell = 5.0"}, "'grid' "),
        ({"grid": "[twist]\ntip = -3"}, "'twist' is no table"),
    ],
)
def test_what_is_wrong_in_a_planform_is_named_with_its_line_and_nothing_is_written(said, changed, complaint):
    written(**changed)
    (line,) = said("-o", "wing.h5", status=2).splitlines()
    assert "wing.toml: " in line
    assert complaint in line
    assert not Path("wing.h5").exists()


def test_a_file_that_is_none_is_named(said):
    assert "cannot be read" in said("-o", "wing.h5", status=2)
    Path("wing.toml").write_bytes(b"\xff\xfe\x00")
    assert "is not text" in said("-o", "wing.h5", status=2)
