"""Points of free-form boxes in files, and of the lattice around a mesh, are variables of studies."""

from pathlib import Path

import numpy as np
import pytest
from mesh_cases import mesh_around_a_body
from parametrization_cases import wing_model
from riding_cases import su2_text
from study_cases import study_of

from bspline_mdao import InputError, read_grid
from bspline_mdao.design import Lattice
from bspline_mdao.files import read_mesh
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.study.same_problem import check_same_problem, problem_of
from bspline_mdao.studio.study.script import study_script

HEAD = """\
[grid]
file = "@onera_m6"

[objective]
of = "surface_area"
ref = 0.01

[output]
report = false

"""

BOXES = """\
[variables.wing]
kind = "ffd"
file = "wing.xyz"
direction = "y"
where = ":, :, 1:"
lower = -0.1
upper = 0.1

[variables.tip]
kind = "ffd"
file = "wing.xyz"
parent = "wing"
continuity = -1
low = [-inf, -inf, 1.1]
lower = -0.1
upper = 0.1
"""

SU2_BOX = """\
FFD_NBOX= 1
FFD_TAG= MAIN
FFD_DEGREE_I= 1
FFD_DEGREE_J= 1
FFD_DEGREE_K= 1
FFD_BLENDING= BEZIER
FFD_CONTROL_POINTS= 8
"""


def written_box(path, points):
    """A box as pyGeo's files have it."""
    shape = " ".join(map(str, points.shape[:3]))
    path.write_text(f"1\n{shape}\n{' '.join(map(repr, points.transpose(3, 2, 1, 0).ravel().tolist()))}\n")


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written_box(tmp_path / "wing.xyz", Lattice.box(moving_mesh(wing_model()), (3, 2, 4), margin=0.2).control_points)
    return tmp_path


def test_the_script_reads_boxes_and_puts_a_child_into_the_box_above(workplace):
    script = study_script(study_of(workplace, HEAD + BOXES), workplace)
    for line in (
        'lattices["wing"] = bm.design.read_lattice(HERE / "wing.xyz")',
        'lattices["tip"] = bm.design.read_lattice(HERE / "wing.xyz", parent=lattices["wing"], continuity=-1)',
        'bm.design.FreeForm("wing", lattices["wing"], np.s_[:, :, 1:], direction="y"),',
        'bm.design.FreeForm("tip", lattices["tip"], lattices["tip"].within(low=(None, None, 1.1)), direction="xyz"),',
    ):
        assert line in script


FAULTS = {
    'file = "wing.xyz"\nparent -> parent': "'tip' has no key 'file' (file of the box",
    'file = "wing.xyz"\nparent -> file = "tip.xyz"\nparent': "[variables.tip] 'file' names 'tip.xyz', and there is no",
    'parent = "wing" -> parent = "wings"': "'parent' is 'wings', which is no box in a table above; did you mean 'wing'",
    'parent = "wing" -> parent = "tip"': "'parent' is 'tip', which is no box in a table above; there are wing",
    "low = [-inf, -inf, 1.1] -> low = [nan, 0, 0]": "'low' is [nan, 0, 0]; give a list of three numbers, -inf or inf",
    "1.1] -> 1.1]\nhigh = [inf, inf, 1.0]": "'high' is [inf, inf, 1.0], below low = [-inf, -inf, 1.1]",
    '1.1] -> 1.1]\nwhere = ":, :, 1:"': "'where' does not go with low and high; leave one of them out",
    'parent = "wing" -> box = 3': "'box' is 3; give a text",
    'direction = "y"\n -> parent = "tip"\n': "'parent' is 'tip', which is no box in a table above; write the table of",
    'kind = "ffd"\nfile = "wing.xyz"\ndirection -> kind = "free_lattice"\ndirection': "'where' is no key",
}


@pytest.mark.parametrize("edit", FAULTS)
def test_what_is_wrong_with_a_box_is_named(workplace, edit):
    before, after = edit.split(" -> ")
    assert BOXES.count(before) == 1
    with pytest.raises(InputError) as error:
        study_of(workplace, HEAD + BOXES.replace(before, after))
    assert FAULTS[edit] in str(error.value)


def test_points_of_a_lattice_around_a_mesh_are_none_of_a_grid_of_blocks(workplace):
    with pytest.raises(InputError, match=r"line 11: \[variables\] 'free_lattice' is for the lattice around an un"):
        study_of(workplace, f"{HEAD}[variables.free_lattice]\nlower = -0.1\nupper = 0.1\n")


def test_another_box_in_the_file_poses_another_problem(workplace):
    study = study_of(workplace, HEAD + BOXES)
    earlier = problem_of(study)
    check_same_problem(study, earlier, "out")
    written_box(workplace / "wing.xyz", np.moveaxis(np.indices((2, 2, 2)), 0, -1).astype(float))
    with pytest.raises(InputError, match=r"\[variables.wing\] file is not the same as in the run whose cases are in"):
        check_same_problem(study, earlier, "out")


def test_a_draft_of_a_mesh_names_the_box_in_its_file(workplace):
    corners = "\n".join(f"{i} {j} {k} {9 * i - 4} {9 * j - 4} {9 * k - 4}" for i, j, k in np.ndindex(2, 2, 2))
    (workplace / "body.su2").write_text(su2_text(mesh_around_a_body()[0]) + SU2_BOX + corners + "\n")
    assert run(["init", "body.su2", "-o", "study.toml"]) == 0
    lines = Path("study.toml").read_text().splitlines()
    at = lines.index("# [variables.free_form]  # instead of the above, or in addition")
    asked = [line.removeprefix("# ") for line in lines[at : at + 7] if not line.startswith("# or")]
    table = study_of(workplace, "\n".join([HEAD.replace("@onera_m6", "body.su2"), *asked, ""])).variables["free_form"]
    assert (table["kind"], table["file"], table["box"]) == ("ffd", "body.su2", "MAIN")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "kind"), [("@onera_m6:5x5x5", "ffd"), ("body.su2", "ffd"), ("body.su2", "free_lattice")]
)
def test_walls_are_shifted_by_all_points_alike(workplace, file, kind):
    """A box, and a lattice, whose points all move by one vector move what is in them by it."""
    (workplace / "body.su2").write_text(su2_text(mesh_around_a_body()[0]))
    head = HEAD.replace("@onera_m6", file)
    around = [[-9.0, -9.0, -9.0], [9.0, 9.0, 9.0]]
    written_box(workplace / "box.xyz", Lattice.box(np.array(around), (2, 3, 2)).control_points)
    bounds = 'direction = "x"\nlower = -0.1\nupper = 0.1\nstart = 0.01\n'
    of = {"ffd": 'file = "box.xyz"\n', "free_lattice": "spacing = 0.5\n"}[kind]
    more = "[driver]\nmax_iterations = 1\n"
    (workplace / "s.toml").write_text(f'{head}[variables.shape]\nkind = "{kind}"\n{of}{bounds}{more}')
    run(["optimize", "s.toml", "-o", "out"])
    if file == "body.su2":
        before, after = (read_mesh(f"out/grid_{when}.su2").mesh for when in ("before", "after"))
        rows = np.unique(before.markers["body"])
        change = after.points[rows] - before.points[rows]
    else:
        topology = find_topology(onera_m6_grid((5, 5, 5)))
        grids = [read_grid(f"out/grid_{when}.xyz").to_vector().reshape(-1, 3) for when in ("before", "after")]
        before, after = (SurfaceGrid.of_nodes(topology, nodes).points for nodes in grids)
        change = after - before
    np.testing.assert_allclose(change, [[0.01, 0.0, 0.0]] * len(change), atol=1e-10)
