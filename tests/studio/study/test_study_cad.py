"""Studies move control points of named faces of a CAD file, and write the optimum as a file of the same names."""

import json

import numpy as np
import pytest
from cad_cases import needs_opencascade
from study_cases import study_of

from bspline_mdao import FittedModel, InputError, fit_grid, read_grid
from bspline_mdao.base.numerics.vectors import lengths
from bspline_mdao.design import CadPoints, CadShapes, TiedSurface, moved_body
from bspline_mdao.files import read_cad, write_cad, write_cad_body
from bspline_mdao.generators import ball_grid, onera_m6_grid
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.study.same_problem import check_same_problem, problem_of
from bspline_mdao.studio.study.script import study_script

STUDY = """\
[grid]
file = "wing.h5"
design = "wing*"

[variables.bumps]
kind = "cad_points"
file = "wing.step"
faces = ["wing_upper"]
direction = "y"
low = [-inf, 0.005, -inf]
lower = -0.02
upper = 0.02

[objective]
of = "surface_area"
ref = 0.01

[output]
report = false

[constraints.volume]
lower = 1.0

[driver]
max_iterations = 4
"""

WAY = """
[variables.way]
kind = "cad_shapes"
file = "wing.step"
to = ["a.step", "b.igs"]
lower = 0.0
upper = [0.5, 0.6]
"""


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("wing.step", "a.step", "b.igs", "a.xyz"):
        (tmp_path / name).write_text(name)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "wing.step").write_text("")
    fit_grid(onera_m6_grid((5, 5, 5))).save(tmp_path / "wing.h5")
    return tmp_path


@pytest.fixture(scope="module")
def wing(tmp_path_factory):
    """A model, and its walls as a file in millimetres."""
    folder = tmp_path_factory.mktemp("wing")
    model = fit_grid(onera_m6_grid((7, 7, 5)), n_control=(5, 5, 4))
    model.save(folder / "wing.h5")
    write_cad(folder / "wing.step", model, tolerance=1e-3, units="mm")
    return folder


def test_the_script_ties_walls_once_and_writes_the_faces_of_the_optimum(workplace):
    script = " ".join(study_script(study_of(workplace, STUDY), workplace).split())
    for line in (
        'tied = {"wing.step": bm.design.TiedSurface.of(model, HERE / "wing.step", "wing*")}',
        'where=tied["wing.step"].body.within(faces=["wing_upper"], low=(None, 0.005, None)), direction="y",',
        'variables = [cad["bumps"]]',
        'HERE / "wing_after.step", bm.design.moved_body([cad["bumps"]], {"bumps": problem.get_val("bumps")}),',
    ):
        assert line in script


def test_ways_to_other_files_have_a_value_each_and_leave_no_file_of_the_optimum(workplace):
    study = study_of(workplace, STUDY + WAY)
    script = " ".join(study_script(study, workplace).split())
    assert '[tied["wing.step"].shape(HERE / "a.step"), tied["wing.step"].shape(HERE / "b.igs")]' in script
    assert script.count("TiedSurface.of") == 1
    assert "write_cad_body" not in script
    assert study.cad_results == {}
    earlier = problem_of(study)
    assert study.variables["way"]["to"] == ["a.step", "b.igs"]
    (workplace / "b.igs").write_text("another")
    with pytest.raises(InputError, match=r"\[variables.way\] to is not the same as"):
        check_same_problem(study, earlier, "here")


FAULTS = {
    '"wing.step" -> "win.step"': "[variables.bumps] 'file' names 'win.step', and there is no such file",
    'file = "wing.step"\nfaces -> file = "a.xyz"\nfaces': "'file' is 'a.xyz', no CAD file by its name; end it in",
    '"a.step", -> "c.step",': "[variables.way] 'to' names 'c.step', and there is no such file",
    '"a.step", -> "a.xyz",': "[variables.way] 'to' is 'a.xyz', no CAD file by its name",
    "0.6] -> 0.6, 1.0]": "'upper' has 3 numbers; give one number, or 2",
    "to = -> scale = 25.4\nto =": "is of 'wing.step', to which [variables.bumps] ties walls with another scale; give",
    'file = "wing.step"\nto -> file = "other/wing.step"\nto': "'file' has the name of another file in [variables.",
    "low = -> high = [inf, 0.0, inf]\nlow =": "'high' is [inf, 0.0, inf], below low",
}


@pytest.mark.parametrize("edit", FAULTS)
def test_what_is_wrong_with_a_cad_file_is_named(workplace, edit):
    before, after = edit.split(" -> ")
    with pytest.raises(InputError) as error:
        study_of(workplace, (STUDY + WAY).replace(before, after, 1))
    assert FAULTS[edit] in str(error.value)


@needs_opencascade
def test_the_optimum_is_a_file_of_the_same_names_and_unit_that_walls_of_the_grid_are_on(wing, tmp_path, capsys):
    (wing / "study.toml").write_text(STUDY)
    arguments = [
        "optimize",
        str(wing / "study.toml"),
        "-o",
        str(tmp_path / "out"),
        "--json",
        str(tmp_path / "out.json"),
    ]
    assert run(arguments) == 0
    numbers = json.loads((tmp_path / "out.json").read_text())["cad"][0]
    assert numbers["result"] == "wing_after.step"
    said = " ".join("".join(capsys.readouterr()).split())
    assert "wing_after.step: faces move walls by up to" in said
    assert ("the grid has too few control points for such moves" in said) == (
        numbers["missed"] > 0.1 * numbers["moved"]
    )
    before, after = read_cad(wing / "wing.step"), read_cad(tmp_path / "out" / "wing_after.step")
    assert after.face_names == before.face_names
    assert after.unit == before.unit == "millimetre"
    assert after.is_valid
    upper, lower = (np.array([face.name == f"wing_{side}" for face in after.body.faces]) for side in ("upper", "lower"))
    moves = [
        np.abs(b.surface.control_points - a.surface.control_points).max()
        for a, b in zip(before.body.faces, after.body.faces)
    ]
    assert np.max(moves, where=upper, initial=0.0) > 1e-4
    assert np.max(moves, where=lower, initial=0.0) < 1e-9
    model = FittedModel.load(wing / "wing.h5")
    tied = TiedSurface.of(model, before.body)
    nodes = read_grid(tmp_path / "out" / "grid_after.xyz").to_vector().reshape(-1, 3)[tied.surface.rows]
    asked = tied.surface.points + tied.body.displacement(tied.body.matched(after.body), tied.tie)
    assert lengths(nodes - asked).max() == pytest.approx(numbers["missed"], rel=1e-6)
    assert lengths(asked - tied.surface.points).max() == pytest.approx(numbers["moved"], rel=1e-6)


@needs_opencascade
def test_twist_beside_control_points_leaves_no_file_and_the_command_says_so(wing, tmp_path, capsys):
    text = STUDY + "\n[variables.twist]\nstations = 2\nlower = -1.0\nupper = 1.0\n"
    (wing / "twist.toml").write_text(text)
    arguments = ["optimize", str(wing / "twist.toml"), "-o", str(tmp_path / "out"), "--max-iterations", "1"]
    assert run(arguments) == 0
    said = " ".join("".join(capsys.readouterr()).split())
    assert "no CAD file will be written with the optimum: twist moves walls as well" in said
    assert not (tmp_path / "out" / "wing_after.step").exists()


@needs_opencascade
def test_init_drafts_control_points_of_the_faces_of_a_file(wing, tmp_path, capsys):
    draft = tmp_path / "draft.toml"
    grid, cad = str(wing / "wing.h5"), str(wing / "wing.step")
    assert run(["init", grid, "--cad", cad, "-o", str(draft)]) == 0
    study = study_of(tmp_path, draft.read_text())
    shape = study.variables["shape"]
    assert (shape["kind"], shape["direction"]) == ("cad_points", "y")
    assert sorted(shape["faces"]) == ["wing_lower", "wing_upper"]
    assert "twist" not in study.variables
    assert list(study.cad_results.values()) == ["wing_after.step"]


@needs_opencascade
def test_control_points_are_chosen_by_faces_and_boxes(wing):
    body = read_cad(wing / "wing.step").body
    points, upper, lower = body.control_points, body.within("*upper"), body.within("wing_lower")
    assert (upper | lower).all()
    assert 0 < np.count_nonzero(upper & lower) < np.count_nonzero(upper)  # edges of both
    assert (points[upper & ~lower][:, 1] > 0.0).mean() > 0.9
    np.testing.assert_array_equal(body.within(low=(None, 0.0, None), high=(0.5, None, None)),
                                  (points[:, 1] >= 0.0) & (points[:, 0] <= 0.5))  # fmt: skip
    with pytest.raises(InputError, match="no face is called 'tail'; the faces are wing_lower, wing_upper"):
        body.within("tail")


@needs_opencascade
def test_moves_of_several_variables_add_up_in_one_file(tmp_path):
    model = fit_grid(ball_grid((5, 5, 5, 5)))
    write_cad(tmp_path / "ball.step", model)
    tied = TiedSurface.of(model, tmp_path / "ball.step")
    points = tied.body.control_points
    bumps = CadPoints("bumps", tied, direction="x")
    larger = CadShapes("larger", tied, [tied.body.at(1.5 * points)])
    values = np.random.default_rng(8).normal(size=len(bumps.initial))
    body = moved_body([bumps, larger], {"bumps": values, "larger": 0.5})
    asked = bumps.body_at(values).control_points + 0.25 * points
    np.testing.assert_allclose(body.control_points, asked, atol=1e-12)
    found = read_cad_points(write_cad_body(tmp_path / "moved.step", body), len(asked))
    np.testing.assert_allclose(found, asked, atol=1e-9)
    other = CadPoints("other", TiedSurface.of(model, tmp_path / "ball.step"))
    with pytest.raises(InputError, match="variables are of different walls; make all with one TiedSurface"):
        moved_body([bumps, other], {"bumps": values, "other": 0.0})
    with pytest.raises(InputError, match="no variable moves the walls"):
        moved_body([], {})


def read_cad_points(shape, n):
    points = shape.body.control_points
    assert len(points) == n
    return points
