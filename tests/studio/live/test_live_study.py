"""Variables of a study as sliders: the grid is that of the study, which is written with the values of the moment."""

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao.errors import InputError
from bspline_mdao.studio.cli.live import LiveOptions, open_live
from bspline_mdao.studio.live.opened import studied_model
from bspline_mdao.studio.live.outputs import write_shape
from bspline_mdao.studio.live.session import Session
from bspline_mdao.studio.live.study_variables import MOST_SLIDERS

STUDY = """# of the tests
[grid]
file = "{file}"

[variables.twist]
stations = 4
values = [2, 4]
lower = [-2.0, -5.0]
upper = 5.0
start = [0.0, 1.0, 0.5, 2.0]  # deg

[variables.camber]
lower = 0.01
upper = 0.03

[flow]
kind = "lattice"
alpha = 3.0
Mach_number = 0.3

[objective]
of = "CL"
maximize = true
"""


@pytest.fixture
def study_file(wing_file):
    path = wing_file.parent / "study.toml"
    path.write_text(STUDY.format(file=wing_file.name))
    return path


@pytest.fixture
def studied(study_file):
    return studied_model(study_file)


def test_sliders_are_the_values_that_the_driver_has(studied):
    assert [slider.label for slider in studied.sliders] == ["twist 2", "twist 4", "camber"]
    assert [(slider.low, slider.high) for slider in studied.sliders] == [(-2.0, 5.0), (-5.0, 5.0), (0.0, 0.03)]
    assert [slider.step for slider in studied.sliders] == pytest.approx([0.1, 0.1, 1e-4])
    assert studied.first.values == (1.0, 2.0, 0.0)
    assert studied.neutral.values == (0.0, 0.0, 0.0)
    assert not studied.is_baseline(studied.neutral)  # station 3 is no variable, and is turned
    assert studied.words(studied.first) == ""


def test_the_grid_is_that_of_the_study_in_openmdao(studied):
    shape = studied.study.shape
    problem = om.Problem(
        shape.wing.grid_movement(shape.parametrization.variables, mover=shape.mover, fit=False), reports=None
    )
    problem.setup()
    problem.set_val("twist", [0.0, -1.5, 0.5, 3.0], units="deg")
    problem.set_val("camber", 0.02)
    problem.run_model()
    nodes = studied.at(studied.neutral.with_value(0, -1.5).with_value(1, 3.0).with_value(2, 0.02)).nodes
    np.testing.assert_allclose(nodes.ravel(), problem.get_val("grid"), rtol=0.0, atol=1e-14)
    assert np.linalg.norm(nodes - studied.baseline, axis=1).max() > 0.01


def test_the_study_is_written_with_the_values_of_the_moment(studied, study_file, tmp_path):
    session = Session(studied, tmp_path / "written")
    assert session.design == studied.first
    session.set(1, -3.25)
    assert session.update()
    assert session.write(".toml").endswith("study_live_1.toml written")
    written = tmp_path / "written" / "study_live_1.toml"
    text = written.read_text()
    assert "start = [0.0, 1.0, 0.5, -3.25]  # deg" in text
    assert text.count("start") == 1
    assert text.startswith("# of the tests")
    again = studied_model(written)
    assert again.first.values == (1.0, -3.25, 0.0)
    np.testing.assert_array_equal(again.at(again.first).nodes, session.shape.nodes)
    assert (study_file.read_text()) == STUDY.format(file="wing.h5")


def test_pulled_control_points_are_no_values_of_a_study(studied, tmp_path):
    shape = studied.at(studied.first.with_pull(5, (0.0, 0.002, 0.0)), with_lift=False)
    with pytest.raises(InputError, match="are not variables"):
        write_shape(tmp_path / "pulled.toml", studied, shape)
    assert list(tmp_path.iterdir()) == []


def test_even_pressures_have_no_start(study_file, tmp_path):
    text = study_file.read_text().replace('kind = "lattice"', 'kind = "euler"')
    study_file.write_text(f'{text}\n[driver]\neven_pressures = "camber"\n')
    live = studied_model(study_file)
    with pytest.raises(InputError, match=r"'even_pressures' of \[driver\] names 'camber', so that it has no start"):
        live.study.text((1.0, 2.0, 0.02), tmp_path)
    assert "0.25" in live.study.text((0.25, 2.0, 0.0), tmp_path)


def test_many_values_get_no_sliders_and_stay_where_the_study_starts(study_file):
    text = study_file.read_text().replace(
        "[variables.camber]", "[variables.bumps]\nkind = 'lattice'\nn = [12, 4, 4]\ndirection = 'y'\nwhere = ':, :, 1:'"
    )
    study_file.write_text(text.replace("lower = 0.01", "lower = -0.03\nstart = 0.001"))
    live = studied_model(study_file)
    assert len(live.sliders) == MOST_SLIDERS < live.study.n_values
    values = live.study.by_name(live.neutral.values)["bumps"]
    assert set(values[-5:]) == {0.001}


def test_what_a_study_says_by_itself_is_refused_as_an_option(study_file):
    pytest.importorskip("trame.app", reason="trame is not installed")
    for given in ({"deform": ("bend=60deg",)}, {"design": ("wing",)}, {"slide": ("far",)}):
        with pytest.raises(InputError, match=f"a study defines what moves and how; leave out --{next(iter(given))}"):
            open_live(study_file, LiveOptions(**given))


def test_a_study_that_moves_nothing_is_refused(study_file):
    text = study_file.read_text()
    study_file.write_text(
        text[: text.index("[variables.twist]")]
        + "[variables.alpha]\nlower = 0.0\nupper = 5.0\n\n"
        + text[text.index("[flow]") :]
    )
    with pytest.raises(InputError, match=r"study\.toml: no variable moves the grid"):
        studied_model(study_file)
