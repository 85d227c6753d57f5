"""Studies in TOML: what can be written, and what is said of what cannot."""

import re
from pathlib import Path

import numpy as np
import pytest
from study_cases import STUDY, study_of

from bspline_mdao import NLoptDriver
from bspline_mdao.base.checks import as_axes
from bspline_mdao.core.design.reference_axis import StationSpline
from bspline_mdao.errors import InputError
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.studio.study import keys
from bspline_mdao.studio.study.draft import study_draft
from bspline_mdao.studio.study.draft_body import GridBody
from bspline_mdao.studio.study.reader import read_study
from bspline_mdao.studio.study.script import study_script
from bspline_mdao.studio.study.toml_lines import key_lines, line_of
from bspline_mdao.studio.study.variable_kinds import VARIABLES


def test_lines_of_keys_are_those_of_the_text():
    text = (
        '# first\n[a]\nb = [1,\n  2, # ]\n  3]\n"c d" = """x\n[no]\ny = 1\n"""\n\n'
        '[a.e."f.g"]\nh.i = { j = "#", k = [{}] }\nl = \'\'\n'
    )
    found = key_lines(text)
    assert found == {
        ("a",): 2,
        ("a", "b"): 3,
        ("a", "c d"): 6,
        ("a", "e"): 11,
        ("a", "e", "f.g"): 11,
        ("a", "e", "f.g", "h"): 12,
        ("a", "e", "f.g", "h", "i"): 12,
        ("a", "e", "f.g", "l"): 13,
    }
    assert line_of(found, ("a", "e", "f.g", "h", "i", "j")) == 12
    assert line_of(found, ("z",)) is None


def test_what_is_left_out_has_its_default(tmp_path):
    study = study_of(tmp_path, STUDY)
    assert study.variables == {
        "twist": {
            "kind": "twist",
            **{"lower": -6.0, "upper": 6.0, "start": None, "ref": None, "at": 0.25},
            **{"stations": 3, "order": 4, "values": None, "patches": None},
        }
    }
    assert (study.flow["Mach_number"], study.flow["n_span"], study.driver["optimizer"]) == (0.3, 17, "LD_SLSQP")
    assert study.constraints["CL"] == {"of": "CL", "lower": None, "upper": None, "equals": 0.22, "ref": None}
    assert study.measures == {}


def test_a_measure_need_not_be_declared(tmp_path):
    text = STUDY + '\n[constraints.volume]\nlower = 1.0\n[constraints.thin]\nof = "thickness"\nlower = 0.8\n'
    study = study_of(tmp_path, text + "[measures.thickness]\nn_span = 3\n")
    assert study.measures["volume"] == {"kind": "volume", "patches": None, "relative": True}
    assert (study.measures["thickness"]["n_span"], study.measures["thickness"]["n_chord"]) == (3, 5)


WRONG = {
    "stations = 3 -> statoins = 3": "line 5: [variables.twist] 'statoins' is no key; did you mean 'stations'? the",
    "[variables.twist] -> [variables.tvist]": "line 4: [variables] 'tvist' is no kind, and has no key 'kind'; "
    "did you mean 'twist'? the kinds are twist, sweep",
    "[variables.twist] -> [variable.twist]": "line 4: 'variable' is no table; did you mean 'variables'? the tables are",
    "stations = 3 -> stations = 3.5": "line 5: [variables.twist] 'stations' is 3.5; give how many, up to 1,000, or a",
    "stations = 3 -> order = 3": "line 5: [variables.twist] 'order' is 3; give one of 2, 4",
    "stations = 3 -> kind = 'lift'": "line 5: [variables.twist] 'kind' is 'lift', which is no kind; ",
    "upper = 6.0 -> upper = -7.0": "line 7: [variables.twist] 'upper' is -7.0, not above lower = -6.0",
    "upper = 6.0 -> upper = [1.0, 2.0]": "line 7: [variables.twist] 'upper' has 2 numbers; give one number, or 3",
    "upper = 6.0 -> upper = 6.0\nvalues = [4]": "line 8: [variables.twist] 'values' is [4]; there are 3 stations",
    "upper = 6.0 -> ": "line 4: [variables] 'twist' has no key 'upper' (upper bound); give a number up to 1e20",
    'file = "@onera_m6" -> file = "m6.xyz"': "line 2: [grid] 'file' names 'm6.xyz', and there is no such file next to",
    'file = "@onera_m6" -> order = 4': "line 1: 'grid' has no key 'file' (PLOT3D or CGNS file,",
    'kind = "lattice" -> kind = "rans"': "line 10: [flow] 'kind' is 'rans'; the flows are lattice, euler",
    'kind = "lattice" -> kind = "lattice"\nmach = 0.3': "line 11: [flow] 'mach' is no key; did you mean",
    'kind = "lattice" -> kind = "euler"\ntrim = true': "line 11: [flow] 'trim' needs a target lift; give CL_",
    'of = "CD_induced" -> of = "CD_indcued"': "line 13: [objective] 'of' names 'CD_indcued', which does not exist; "
    "did you mean 'CD_induced'? there are CL,",
    'of = "CD_induced" -> of = "CD_entropy"': "line 13: [objective] 'of' names 'CD_entropy', which does not exist "
    'without another flow; take kind = "euler"',
    'of = "CD_induced" -> of = "CD_induced + thickness"': "line 13: [objective] 'of' names 'thickness', which is ",
    'of = "CD_induced" -> of = "sin(CD)"': "line 13: [objective] 'of' names 'sin(CD)'|is 'sin(CD)'",
    "equals = 0.22 -> equals = 0.22\nlower = 0.1": "line 15: [constraints] 'CL' has to have lower or upper or both, or",
    "[constraints.CL] -> [constraints.CLL]": "line 15: [constraints] 'CLL' names 'CLL', which does not exist; did",
    "max_iterations = 20 -> max_iterations = 0": "line 19: [driver] 'max_iterations' is 0; give a whole number",
    'max_iterations = 20 -> optimizer = "SLQSP"': "line 19: [driver] 'optimizer' is 'SLQSP', which is none; did you "
    "mean 'SLSQP'? those of SciPy are SLSQP, trust-constr",
    'max_iterations = 20 -> optimizer = "COBYLA"': "line 15: [constraints] 'CL' does not go with the optimizer COBYLA, "
    "which takes no equals; take SLSQP",
    "max_iterations = 20 -> options = { maxeval = 3 }": "line 19: [driver.options] 'maxeval' is the key max_iter",
    "max_iterations = 20 -> max_iterations = = 20": "line 19: is not TOML",
}


@pytest.mark.parametrize("edit", WRONG)
def test_what_is_wrong_is_named_with_its_line(tmp_path, edit):
    before, after = edit.split(" -> ")
    assert STUDY.count(before) == 1
    with pytest.raises(InputError) as error:
        study_of(tmp_path, STUDY.replace(before, after))
    message = str(error.value)
    assert message.startswith(f"{tmp_path / 'study.toml'}: ")
    assert any(part in message for part in WRONG[edit].split("|")), message


def test_names_that_something_else_has_are_refused(tmp_path):
    for name, words in {"grid": "is a name already in use", "CL": "is a name already in use"}.items():
        with pytest.raises(InputError, match=rf"line 4: \[variables\] '{name}' {words}"):
            study_of(tmp_path, STUDY.replace("[variables.twist]", f'[variables.{name}]\nkind = "twist"'))
    taken = STUDY.replace("[variables.twist]", "[variables.thickness]") + "[constraints.thickness]\nlower = 0.8\n"
    with pytest.raises(InputError, match="'thickness' is the name of a measure as well; call the variable otherwise"):
        study_of(tmp_path, taken)


def test_a_fitted_model_needs_no_fit(tmp_path):
    (tmp_path / "m6.h5").write_bytes(b"")
    text = STUDY.replace("@onera_m6", "m6.h5")
    assert 'model = bm.FittedModel.load(HERE / "m6.h5")' in study_script(study_of(tmp_path, text), tmp_path)
    with pytest.raises(InputError, match=r"line 3: \[grid\] 'order' does not go with a fitted model"):
        study_of(tmp_path, text.replace('m6.h5"', 'm6.h5"\norder = 4'))


def test_there_has_to_be_a_file_of_text(tmp_path):
    with pytest.raises(
        InputError, match=r"no.toml: cannot be read .*; give a study, or draft one with 'bspline-mdao init"
    ):
        read_study(tmp_path / "no.toml")
    (tmp_path / "grid.xyz").write_bytes(bytes([0, 255, 254]))
    with pytest.raises(InputError, match="is not text; give a study in TOML"):
        read_study(tmp_path / "grid.xyz")


def test_the_script_names_files_as_seen_from_its_folder(tmp_path):
    (tmp_path / "wing.xyz").write_bytes(b"")
    (tmp_path / "wing.toml").write_text("")
    text = STUDY.replace('"@onera_m6"', '"wing.xyz"\npatches = "wing.toml"')
    script = study_script(study_of(tmp_path, text), tmp_path / "deep" / "out")
    assert 'bm.read_grid(HERE / "../../wing.xyz", HERE / "../../wing.toml")' in script
    compile(script, "script", "exec")
    assert max(map(len, script.splitlines())) <= 120


def test_the_script_makes_a_plane_grid_one_cell_deep_before_its_patches_are_read(tmp_path):
    (tmp_path / "section.xyz").write_bytes(b"")
    (tmp_path / "section.toml").write_text("")
    text = STUDY.replace('"@onera_m6"', '"section.xyz"\npatches = "section.toml"')
    script = study_script(study_of(tmp_path, text), tmp_path, is_plane=True)
    assert 'read_patches(HERE / "section.toml", bm.files.lift_plane_grid(bm.read_grid(HERE / "section.xyz")))' in script
    compile(script, "script", "exec")


@pytest.mark.parametrize(
    ("more", "bounds"),
    [
        ("", "(-6.0, 6.0)"),
        ("values = [3, 2]\n", "([0.0, -6.0, -6.0], [0.0, 6.0, 6.0])"),
        ("upper = [1.0, 2.0]\nvalues = [1, 3]\n", "([-6.0, 0.0, -6.0], [1.0, 0.0, 2.0])"),
    ],
)
def test_the_script_chooses_increments_at_the_bounds_of_what_moves(tmp_path, more, bounds):
    text = STUDY.replace("upper = 6.0\n", more if "upper" in more else f"upper = 6.0\n{more}", 1)
    text += '\n[movement]\nmover = "elasticity"\n'
    script = study_script(study_of(tmp_path, text), tmp_path)
    assert f'bounds = {{\n    "twist": {bounds},\n}}\n' in script
    assert "n_increments = bm.movers.increments_for(bm.movers.LinearElasticity(wing.mesh), designs)\n" in script
    assert "mover = bm.movers.LinearElasticity(wing.mesh, n_increments=n_increments)\n" in script
    compile(script, "script", "exec")


def test_the_script_takes_the_increments_and_the_ratio_of_the_study(tmp_path):
    movement = '[movement]\nmover = "elasticity"\nincrements = 3\npoisson_ratio = 0.1\n'
    script = study_script(study_of(tmp_path, f"{STUDY}\n{movement}"), tmp_path)
    assert "mover = bm.movers.LinearElasticity(wing.mesh, n_increments=3, poisson_ratio=0.1)\n" in script
    assert "increments_for" not in script
    script = study_script(study_of(tmp_path, f"{STUDY}\n{movement.replace('increments = 3', '')}"), tmp_path)
    assert "increments_for(bm.movers.LinearElasticity(wing.mesh, poisson_ratio=0.1), designs)\n" in script


def test_the_script_moves_by_rotations_and_lets_the_far_field_go_along_if_it_is_told_to(tmp_path):
    script = study_script(study_of(tmp_path, STUDY), tmp_path)
    assert "mover = bm.movers.Rotations(wing.mesh)\n" in script
    assert "comoving" not in script
    script = study_script(study_of(tmp_path, f"{STUDY}\n[movement]\ncomoving = true\n"), tmp_path)
    assert ", mover=mover, comoving=True, quality=" in script


def test_the_grid_that_is_written_keeps_patches_that_slide_on_their_surfaces(tmp_path):
    moved = 'model.regenerate(problem.get_val("control_points").reshape(-1, 3)'
    text = study_script(study_of(tmp_path, STUDY), tmp_path)
    assert f"{moved})" in text
    text = study_script(study_of(tmp_path, STUDY.replace('m6"', 'm6"\nsliding = "far*"')), tmp_path)
    assert f"{moved}, wing.mesh.slides)" in text


@pytest.mark.parametrize("setting", ["increments = 3", "poisson_ratio = 0.1"])
def test_settings_of_elasticity_want_elasticity(tmp_path, setting):
    with pytest.raises(InputError, match=r"\[movement\] '.*' is for elasticity; add mover = \"elasticity\", or leave"):
        study_of(tmp_path, f"{STUDY}\n[movement]\n{setting}\n")


def test_an_axis_with_a_sign_is_refused_with_what_to_do(tmp_path):
    with pytest.raises(InputError, match=r"\[flow\] 'axes' is '-xzy'.* without signs: turn a grid whose axes"):
        study_of(tmp_path, STUDY.replace("[flow]\n", '[flow]\naxes = "-xzy"\n', 1))
    with pytest.raises(InputError, match=r"'-xzy'; name x, y and z .* without signs: turn a grid"):
        as_axes("-xzy", "flow")
    bumps = '[variables.bumps]\nkind = "control_points"\ndirection = "-y"\nlower = -0.1\nupper = 0.1\n'
    with pytest.raises(InputError, match=r"'direction' is '-y'.* without signs: values and bounds have them"):
        study_of(tmp_path, f"{STUDY}\n{bumps}")


def test_options_of_drivers_that_keys_set_are_theirs():
    options = NLoptDriver().options
    assert {"optimizer", "ftol_rel", "maxeval"} <= set(options)


def test_the_page_of_studies_has_every_key():
    page = (Path(__file__).parents[3] / "docs" / "study.rst").read_text()
    tables = [keys.GRID, keys.OBJECTIVE, keys.CONSTRAINT, keys.JUNCTION, keys.MOVEMENT, keys.DRIVER, keys.OUTPUT]
    tables += [flow.keys for flow in keys.FLOWS.values()] + list(keys.CONDITIONS.values())
    kinds = VARIABLES | keys.MEASURES
    tables += [kind.all_keys for kind in kinds.values()]
    missing = [key for table in tables for key in table if f"``{key}``" not in page]
    missing += [name for name in [*kinds, *keys.FLOWS] if f"``{name}``" not in page]
    missing += [name for name, meaning in keys.QUALITIES.items() if f"``{name}``\n     - {meaning}\n" not in page]
    assert missing == []
    assert re.search(r"\.\. code-block:: toml", page)


@pytest.mark.slow
def test_the_twist_that_is_drafted_of_a_wing_bends_once_at_most(tmp_path):
    grid = onera_m6_grid((5, 5, 5))
    draft = study_draft("@onera_m6:5x5x5", None, GridBody(grid, find_topology(grid)))
    spline, random = (
        StationSpline.of(study_of(tmp_path, draft).variables["twist"]["stations"]),
        np.random.default_rng(3),
    )
    values = random.normal(size=(spline.n_values, 50))
    slopes = np.sign(np.diff(spline.basis(np.linspace(0.0, 1.0, 201)) @ values, axis=0))
    assert np.max(np.sum(np.diff(slopes, axis=0) != 0.0, axis=0)) == 1
