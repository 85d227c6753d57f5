"""Rotations about hinges, and the places of these, are variables of studies, on grids and on meshes."""

import re

import numpy as np
import pytest
from mesh_cases import mesh_around_a_body
from riding_cases import su2_text
from study_cases import study_of

from bspline_mdao import InputError
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.study.script import study_script

HEAD = """\
[grid]
file = "@onera_m6:7x7x7"

[objective]
of = "surface_area"
ref = 0.01

[output]
report = false

"""

FLAPS = """\
[variables.line]
kind = "hinge"
axis = [[0.7, 0.0, 0.3], [0.9, 0.0, 0.8]]
direction = "xy"
lower = -0.02
upper = [0.02, 0.02, 0.02, 0.03]

[variables.flap]
kind = "rotation"
hinge = "line"
blend = 0.2
ends = 0.3
lower = -5.0
upper = 5.0

[variables.tab]
kind = "rotation"
chord = 0.9
span = [0.4, 0.6]
patches = "*upper"
blend = 0.3
lower = -1.0
upper = 1.0
"""


def test_the_script_makes_hinges_and_what_turns_about_them(tmp_path):
    study = study_of(tmp_path, HEAD + FLAPS)
    script = study_script(study, tmp_path)
    for line in (
        '"line": bm.design.Hinge((0.7, 0.0, 0.3), (0.9, 0.0, 0.8)),',
        '"tab": bm.design.Hinge.on_chord(wing.mesh, 0.9, span=(0.4, 0.6)),',
        'bm.design.HingePoints("line", hinges["line"], direction="xy"),',
        'bm.design.Rotation("flap", hinges["line"], blend=0.2, ends=0.3),',
        'bm.design.Rotation("tab", hinges["tab"], bm.design.OnPatch(model, "*upper"), blend=0.3),',
    ):
        assert line in script
    assert study.n_values == 6


FAULTS = {
    'hinge = "line" -> hinge = "lines"': "'hinge' is 'lines', which is no hinge in a table above; did you mean 'line'",
    'hinge = "line" -> hinge = "tab"': "'hinge' is 'tab', which is no hinge in a table above; there are line",
    'hinge = "line"\n -> ': "[variables] 'flap' has no axis; give one of axis, chord or hinge",
    'hinge = "line" -> hinge = "line"\nchord = 0.7': "'hinge' has chord and hinge; give one of axis, chord or hinge",
    'hinge = "line" -> hinge = "line"\nspan = [0.1, 0.2]': "'span' is for a hinge along the chord; give chord",
    "chord = 0.9 -> chord = 1.9": "'chord' is 1.9; give a number from 0 to 1",
    "[0.9, 0.0, 0.8]] -> [0.7, 0.0, 0.3]]": "give a list of two different points, each of three numbers",
    "blend = 0.2\nends = 0.3\n -> ": "'flap' does not say what rotates; give blend for what is behind the hinge",
    "blend = 0.2\n -> patches = '*'\n": "'ends' is for what is behind the hinge; give blend as well",
    "blend = 0.2 -> blend = '__import__(\"os\")'": "'blend' is '__import__",
    "0.02, 0.03] -> 0.02]": "'upper' has 3 numbers; give one number, or 4",
    "upper = 5.0 -> upper = [5.0, 6.0]": "'upper' has 2 numbers; give one number, or 1",
    'kind = "hinge" -> kind = "hinges"': "'kind' is 'hinges', which is no kind; did you mean 'hinge'",
}


@pytest.mark.parametrize("edit", FAULTS)
def test_what_is_wrong_with_a_hinge_is_named_with_its_line(tmp_path, edit):
    before, after = edit.split(" -> ")
    assert FLAPS.count(before) == 1
    with pytest.raises(InputError) as error:
        study_of(tmp_path, HEAD + FLAPS.replace(before, after))
    assert FAULTS[edit] in str(error.value)
    assert re.search(r"line \d+: ", str(error.value))


@pytest.mark.slow
def test_a_study_turns_a_flap_of_a_mesh_without_structure(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    mesh, kinds = mesh_around_a_body()
    (tmp_path / "body.su2").write_text(su2_text(mesh))
    kinds_of = "\n".join(f'{name} = "{kind}"' for name, kind in kinds.items())
    (tmp_path / "kinds.toml").write_text(f"[kinds]\n{kinds_of}\n")
    (tmp_path / "study.toml").write_text(
        '[grid]\nfile = "body.su2"\npatches = "kinds.toml"\n\n'
        '[variables.rear]\nkind = "rotation"\naxis = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]\nblend = 0.2\n'
        "lower = -4.0\nupper = 5.0\nstart = 1.0\n\n"
        '[objective]\nof = "surface_area"\n\n[driver]\nmax_iterations = 2\n\n[output]\nreport = false\n'
    )
    assert run(["optimize", "study.toml", "-o", "out"]) == 0, capsys.readouterr()
    angle = float(re.search(r"rear\s+[^\n]*?([-\d.e]+)\s*$", capsys.readouterr().out, re.M)[1])
    assert np.isfinite(angle)
