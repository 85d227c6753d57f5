"""The commands ``init`` and ``optimize`` of meshes without structure: from the file of a mesh to an optimum."""

import runpy
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from mesh_cases import body_model, mesh_around_a_body
from riding_cases import plane_su2_text, su2_text
from test_cli import fails_as_expected, numbers
from test_cli_mesh import lines_but_nodes
from test_optimize import names_in, summary

from bspline_mdao.files import read_mesh, write_polymesh
from bspline_mdao.generators import brick_grid
from bspline_mdao.meshes import MixedMesh
from bspline_mdao.studio.cli.main import run

RESULTS = {"optimize.py", "model.h5", "cases.sql", "summary.csv", "grid_before.su2", "grid_after.su2"}

PAGE = {"report.html"} if find_spec("plotly") and find_spec("jinja2") else set()

BOX = """\
[grid]
file = "body.h5"

[variables.shape]
kind = "lattice"
n = [2, 2, 3]
direction = "z"
lower = -0.02
upper = 0.02

[objective]
of = "surface_area"
ref = 0.01

[output]
report = false

[constraints.volume]
lower = 1.0
"""


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def body(workplace):
    (workplace / "body.su2").write_text(su2_text(mesh_around_a_body()[0]) + "% the last line stays\n")
    assert run(["fit", "body.su2", "-o", "body.h5", "--spacing", "0.4"]) == 0
    (workplace / "study.toml").write_text(BOX)
    return workplace


@pytest.mark.slow
def test_a_draft_of_a_section_leads_to_less_skin_around_the_same_area(workplace, capsys):
    (workplace / "plane.su2").write_text(plane_su2_text())
    (workplace / "kinds.toml").write_text('[kinds]\n"airfoil" = "wall"\n')
    assert run(["init", "plane.su2", "--patches", "kinds.toml", "-o", "study.toml"]) == 0
    assert run(["optimize", "study.toml", "-o", "out", "--max-iterations", "6", "--json", "out.json"]) == 0
    shown, found, judged = capsys.readouterr().out, summary("out"), numbers("out.json")
    assert names_in("out") == RESULTS | PAGE
    assert float(found["surface_area"]["after"]) < 0.9987
    assert float(found["volume"]["after"]) == pytest.approx(1.0, abs=1e-6)
    for words in ("smallest area (m^2)", "inverted cells", "all 520 lattice elements", "heights of the first nodes"):
        assert words in shown
    assert judged["n_inverted"] == {"before": 0, "after": 0}
    assert judged["certificate"]["status"] == "valid"
    before, after = (read_mesh(f"out/grid_{when}.su2").mesh.points for when in ("before", "after"))
    np.testing.assert_array_equal(before, read_mesh("plane.su2").mesh.points)
    n = len(before) // 2
    assert np.abs(after - before).max() > 0.002
    np.testing.assert_array_equal(after[:n, :2], after[n:, :2])


@pytest.mark.slow
def test_variables_of_a_mesh_in_millimetres_are_shown_in_them_as_its_cells_are(workplace, capsys):
    (workplace / "plane.su2").write_text(plane_su2_text())
    (workplace / "kinds.toml").write_text('[kinds]\n"airfoil" = "wall"\n')
    assert run(["fit", "plane.su2", "--patches", "kinds.toml", "--units", "mm", "-o", "plane.h5"]) == 0
    assert run(["init", "plane.h5", "-o", "study.toml"]) == 0
    capsys.readouterr()
    assert run(["optimize", "study.toml", "-o", "out", "--max-iterations", "2"]) == 0
    shown = capsys.readouterr().out
    assert "shape[0] (mm)" in shown
    assert "smallest area (mm^2)" in shown
    assert "(m)" not in shown


@pytest.mark.slow
def test_a_study_of_a_mesh_gives_the_script_that_gives_the_same_and_goes_on(body, capsys):
    assert run(["optimize", "study.toml", "-o", "out", "--max-iterations", "3"]) == 0
    assert lines_but_nodes(Path("out/grid_after.su2").read_text()) == lines_but_nodes(Path("body.su2").read_text())
    text, moved = Path("out/summary.csv").read_text(), Path("out/grid_after.su2").read_bytes()
    for name in RESULTS - {"optimize.py"}:
        Path("out", name).unlink()
    runpy.run_path("out/optimize.py")
    assert (Path("out/summary.csv").read_text(), Path("out/grid_after.su2").read_bytes()) == (text, moved)
    first = float(summary("out")["surface_area"]["after"])
    assert run(["optimize", "study.toml", "-o", "out", "--restart", "--json", "out.json"]) == 0
    assert "recorded designs" in capsys.readouterr().out
    assert numbers("out.json")["evaluations_before"] > 2
    assert float(summary("out")["surface_area"]["after"]) < first - 1e-5
    Path("study.toml").write_text(BOX.replace("[2, 2, 3]", "[2, 3, 3]"))
    fails_as_expected(
        ["optimize", "study.toml", "-o", "out", "--restart"], capsys, "[variables.shape] n is [2, 3, 3], and was"
    )


@pytest.mark.slow
def test_two_walls_move_by_variables_of_their_own(workplace):
    """The nose of a block goes upstream, and the rest of it up."""
    mesh, _ = mesh_around_a_body()
    faces = mesh.markers["body"]
    is_nose = (mesh.points[faces][..., 0] < 0.0).any(axis=1)
    markers = {**mesh.markers, "body": faces[~is_nose], "nose": faces[is_nose]}
    Path("body.su2").write_text(su2_text(MixedMesh(mesh.points, mesh.cells, markers)))
    Path("kinds.toml").write_text('[kinds]\n"body" = "wall"\n"nose" = "wall"\n')
    tables = "".join(
        f'[variables.{name}]\nkind = "control_points"\npatches = "{name}"\ndirection = "{direction}"\n'
        f"lower = {-size}\nupper = {size}\nstart = {size}\n"
        for name, direction, size in (("nose", "x", 0.01), ("body", "z", 0.02))
    )
    head, tail = '[grid]\nfile = "body.su2"\npatches = "kinds.toml"\n', BOX.partition("[objective]")[2]
    Path("study.toml").write_text(f"{head}{tables}[objective]{tail}")
    run(["optimize", "study.toml", "-o", "out", "--max-iterations", "1"])
    before, after = (read_mesh(f"out/grid_{when}.su2").mesh for when in ("before", "after"))
    change = np.abs(after.points - before.points)
    nose, body = (np.unique(before.markers[name]) for name in ("nose", "body"))
    assert change[np.setdiff1d(nose, body)].max(axis=0) == pytest.approx([0.01, 0.0, 0.0], abs=1e-12)
    assert change[np.setdiff1d(body, nose)].max(axis=0) == pytest.approx([0.0, 0.0, 0.02], abs=1e-12)


@pytest.mark.slow
def test_a_folder_of_openfoam_is_optimised_and_another_one_does_not_go_on(workplace, capsys):
    write_polymesh("case/polyMesh", brick_grid((4, 4, 4, 4)))
    Path("study.toml").write_text(BOX.replace("body.h5", "case/polyMesh").replace("0.02\n\n", "0.02\nstart = 0.01\n\n"))
    run(["optimize", "study.toml", "-o", "out", "--max-iterations", "1"])
    written = {f"grid_{when}/polyMesh" for when in ("before", "after")}
    listed = capsys.readouterr().out.splitlines()[-1]
    assert all(name in listed for name in written)
    for name in ("faces", "owner", "boundary"):
        assert Path("out/grid_after/polyMesh", name).read_bytes() == Path("case/polyMesh", name).read_bytes()
    assert Path("out/grid_before/polyMesh/points").read_bytes() == Path("case/polyMesh/points").read_bytes()
    before, after = (read_mesh(f"out/grid_{when}/polyMesh").mesh.points for when in ("before", "after"))
    assert np.abs(after - before)[:, 2].max() > 0.005
    write_polymesh("case/polyMesh", brick_grid((4, 5, 4, 4)))
    arguments = ["optimize", "study.toml", "-o", "out", "--restart"]
    fails_as_expected(arguments, capsys, "[grid] file is not the same as in the run whose cases are in out")


def test_a_run_that_cannot_write_its_mesh_does_not_begin(body, capsys):
    Path("body.su2").rename("other.su2")
    fails_as_expected(["optimize", "study.toml", "-o", "out"], capsys, "body.su2: is not there", "put it back")
    assert not Path("out").exists()


def test_init_says_which_marker_has_to_be_declared(workplace, capsys):
    text = su2_text(mesh_around_a_body()[0]).replace("MARKER_TAG= body", "MARKER_TAG= x_p")
    (workplace / "body.su2").write_text(text)
    Path("kinds.toml").write_text('[kinds]\n"x_p" = "farfield"\n')
    arguments = ["init", "body.su2", "--patches", "kinds.toml", "-o", "study.toml"]
    fails_as_expected(arguments, capsys, "body.su2: no marker", "wall")
    assert not Path("study.toml").exists()


MESH_STUDIES = {
    "Euler": (
        '[flow]\nkind = "euler"\n',
        ("line 16: [flow] 'kind' is 'euler', which is solved on fitted grids of blocks", "take 'lattice'"),
    ),
    "corners": (
        "[constraints.corner_ks]\nlower = 0.1\n",
        ("line 15: [constraints] 'corner_ks' names 'corner_ks', which needs hexahedra", "volume_ks"),
    ),
    "movement": ('[movement]\nmover = "elasticity"\n', ("line 15: 'movement' is for grids of blocks; the lattice",)),
    "format": ('[output]\ngrid = "cgns"\n', ("line 16: [output] 'grid' is for grids of blocks; a mesh is written",)),
}


@pytest.mark.parametrize("name", MESH_STUDIES)
def test_what_needs_a_grid_of_blocks_is_refused_with_key_and_line(workplace, capsys, name):
    more, words = MESH_STUDIES[name]
    body_model().save("body.h5")
    Path("study.toml").write_text(BOX.replace("[output]\nreport = false\n", more))
    fails_as_expected(["optimize", "study.toml", "-o", "out"], capsys, *words)


@pytest.mark.parametrize("key", ["n_control = [4, 4, 4]", 'fixed = "far"', 'patches = "kinds.toml"', "spacing = 0.3"])
def test_keys_of_a_grid_that_a_model_of_a_mesh_has_not_are_refused(workplace, capsys, key):
    body_model().save("body.h5")
    Path("kinds.toml").touch()
    Path("study.toml").write_text(BOX.replace('"body.h5"', f'"body.h5"\n{key}'))
    fails_as_expected(["optimize", "study.toml", "-o", "out"], capsys, f"line 3: [grid] '{key.split()[0]}'")
