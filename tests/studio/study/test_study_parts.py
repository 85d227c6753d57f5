"""Components of several patches by name: variables of a part alone, and the clearance between two of them."""

import numpy as np
import pytest
from mesh_cases import mesh_around_two_sections
from riding_cases import su2_text
from study_cases import study_of

from bspline_mdao import InputError
from bspline_mdao.files import read_mesh
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.study.same_problem import check_same_problem, problem_of
from bspline_mdao.studio.study.script import study_script

STUDY = """\
[families]
flap = "f*"
both = ["main", "flap"]

[grid]
file = "sections.su2"
patches = "kinds.toml"

[variables.shape]
kind = "lattice"
n = [3, 2, 2]
direction = "y"
patches = "flap"
lower = -0.02
upper = 0.04

[measures.gap]
kind = "clearance"
patches = "flap"
to = "main"

[objective]
of = "gap"
maximize = true

[constraints.surface_area]
upper = 1.05

[driver]
max_iterations = 6

[output]
report = false
"""


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sections.su2").write_text(su2_text(mesh_around_two_sections(0.05)[0]))
    (tmp_path / "kinds.toml").write_text('[kinds]\nmain = "wall"\nflap = "wall"\nfar = "farfield"\n')
    return tmp_path


def test_families_stand_for_their_patches_wherever_patches_are_named(workplace):
    text = STUDY.replace('patches = "kinds.toml"', 'patches = "kinds.toml"\ndesign = ["both", "f*"]')
    study = study_of(workplace, text)
    assert study.grid["design"] == ["main", "flap", "f*"]
    assert study.grid["patches"] == "kinds.toml"
    assert study.variables["shape"]["patches"] == "f*"
    assert (study.measures["gap"]["patches"], study.measures["gap"]["to"]) == ("f*", "main")


AXES = """\
[variables.first]
kind = "twist"
patches = "flap"
lower = -1.0
upper = 1.0

[variables.second]
kind = "chord"
patches = ["flap", "main"]
at = 0.5
lower = 0.9
upper = 1.1

[variables.fourth]
kind = "translation"
patches = "flap"
direction = "xy"
lower = [-0.1, -0.2]
upper = 0.1

[variables.fifth]
kind = "radius"
axis = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
stations = 3
values = [2]
lower = 0.9
upper = 1.1

[variables.third]
kind = "taper"
at = 0.5
lower = 0.9
upper = 1.1

"""


def test_variables_of_a_part_have_axes_and_boxes_of_it(workplace):
    script = study_script(study_of(workplace, STUDY.replace("[measures.gap]", AXES + "[measures.gap]")), workplace)
    for line in (
        'parts = {"f*": wing.part("f*"), "f*, main": wing.part(["f*", "main"])}',
        'axes = {("f*, main", 0.5): parts["f*, main"].axis_at(0.5), 0.5: wing.axis_at(0.5)}',
        'bm.design.FreeForm("shape", bm.design.Lattice.box(parts["f*"].mesh, (3, 2, 2)), direction="y"),',
        'bm.design.OfPart(bm.design.Twist("first", parts["f*"].axis, stations=1), parts["f*"].mesh),',
        'bm.design.Chord("second", axes["f*, main", 0.5], stations=1), parts["f*, main"].mesh',
        'bm.design.Taper("third", axes[0.5])',
        'bm.design.RadiusFactor("fifth", [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], stations=3),',
        'bm.design.OfPart(bm.design.Translation("fourth", direction="xy"), parts["f*"].mesh),',
        'bm.measures.Clearance.between(surfaces["f*, main"], "f*", "main", name="gap")',
    ):
        assert line in script


JUNCTION = """\
[junction]
body = "main"
reach = 0.8

"""


def test_a_wing_slides_on_the_body_of_a_junction(workplace):
    study = study_of(workplace, STUDY.replace("[driver]", JUNCTION + "[driver]"))
    script = study_script(study, workplace)
    assert 'junction=bm.design.Junction(bm.design.OnPatch(model, "main"), reach=0.8)' in script
    earlier = problem_of(study)
    changed = study_of(workplace, STUDY.replace("[driver]", JUNCTION.replace("0.8", "0.9") + "[driver]"))
    with pytest.raises(InputError, match=r"\[junction\] reach is 0.9, and was 0.8"):
        check_same_problem(changed, earlier, "out")
    shaped = STUDY.replace("[driver]", JUNCTION.replace("0.8", '0.8\nshape = "shape"') + "[driver]")
    assert 'reach=0.8, shape=["shape"])' in study_script(study_of(workplace, shaped), workplace)
    fillet = STUDY.replace("[driver]", JUNCTION.replace("0.8", "0.8\nrigid = 0.1") + "[driver]")
    assert "reach=0.8, rigid=0.1)" in study_script(study_of(workplace, fillet), workplace)
    with pytest.raises(InputError, match=r"\[junction\] 'rigid' is 0.8; give less than reach, which is 0.8"):
        study_of(workplace, fillet.replace("rigid = 0.1", "rigid = 0.8"))
    with pytest.raises(InputError, match=r"\[junction\] 'shape' names 'bulge', which is no variable; there are shape"):
        study_of(workplace, shaped.replace('shape = "shape"', 'shape = "bulge"'))
    with pytest.raises(InputError, match="'junction' has no key 'reach'"):
        study_of(workplace, STUDY.replace("[driver]", JUNCTION.replace("reach = 0.8\n", "") + "[driver]"))


FAULTS = {
    'flap = "f*" -> flap = 3': "line 2: [families] 'flap' is 3; give a name or pattern such as 'wing*', or a list",
    'flap = "f*" -> "f l" = "f*"': "line 2: [families] 'f l' is no name; give one of letters",
    '[families]\nflap = "f*"\nboth = ["main", "flap"] -> families = 3': "'families' is no table; write [families] and",
    'to = "main"\n -> ': "'gap' has no key 'to' (patches on the other side); give a name or pattern",
    '[measures.gap]\nkind = "clearance"\npatches = "flap"\nto = "main"\n\n[objective]\nof = "gap" -> '
    '[objective]\nof = "clearance"': "without [measures.clearance]; add it with patches and to",
}


@pytest.mark.parametrize("edit", FAULTS)
def test_what_is_wrong_with_a_part_is_named(workplace, edit):
    before, after = edit.split(" -> ")
    assert STUDY.count(before) == 1
    with pytest.raises(InputError) as error:
        study_of(workplace, STUDY.replace(before, after))
    assert FAULTS[edit] in str(error.value)


@pytest.mark.slow
def test_a_study_opens_the_gap_of_a_flap_and_leaves_the_rest(workplace):
    (workplace / "study.toml").write_text(STUDY)
    assert run(["optimize", "study.toml", "-o", "out"]) == 0
    before, after = (read_mesh(f"out/grid_{when}.su2").mesh for when in ("before", "after"))
    main, flap = (np.unique(before.markers[name]) for name in ("main", "flap"))
    np.testing.assert_array_equal(after.points[main], before.points[main])
    gaps = [np.linalg.norm(m.points[main][:, None] - m.points[flap], axis=2).min() for m in (before, after)]
    assert gaps[1] > gaps[0] + 0.005
