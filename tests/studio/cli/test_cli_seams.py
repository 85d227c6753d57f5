"""The command ``seams``: what it tells and refuses."""

import numpy as np
import pytest
from seam_cases import globe_grid
from test_cli import fails_as_expected, numbers

from bspline_mdao import fit_grid
from bspline_mdao.generators import ball_grid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.studio.cli.main import run


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    model = fit_grid(globe_grid(), n_control=(5, 7, 4))
    model.save("globe.h5")
    mesh = moving_mesh(model)
    points = mesh.points[mesh.surface_ids]
    np.savetxt("moved.csv", points + 0.01 * np.random.default_rng(0).normal(size=points.shape), delimiter=",")
    return tmp_path


def test_seams_tells_kinks_of_a_model_and_what_a_design_has_made_of_them(workplace, capsys):
    assert run(["seams", "globe.h5", "--json", "fit.json"]) == 0
    assert "4 seams smooth to 5 deg: kinks up to 0.815 deg" in capsys.readouterr().out
    assert run(["seams", "globe.h5", "--deform", "moved.csv", "--json", "moved.json"]) == 0
    assert "4 seams smooth to 5 deg before, now: kinks up to" in capsys.readouterr().out
    fit, moved = numbers("fit.json"), numbers("moved.json")
    assert (fit["n_smooth"], moved["n_smooth"], len(fit["poles"])) == (4, 4, 2)
    assert fit["kink"] < 1.0 < 5.0 < moved["kink"]
    assert {seam["kink_before"] for seam in moved["seams"]} == {seam["kink"] for seam in fit["seams"]}
    assert run(["seams", "globe.h5", "--max-kink", "0.1"]) == 0
    assert "4 seams with kinks of more than 0.1 deg: edges of the surface" in capsys.readouterr().out


def test_seams_with_mirror_images_are_those_of_edges_in_planes_of_symmetry(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fit_grid(ball_grid((5, 5, 5, 5), octant=True)).save("octant.h5")
    for options, n_seams in ((), 3), (("--mirror",), 9):
        assert run(["seams", "octant.h5", *options]) == 0
        text = capsys.readouterr().out
        assert f"{n_seams} seams, 0 poles" in text
        assert text.count("| its mirror image") == n_seams - 3


def test_seams_refuses_what_it_cannot_measure(workplace, capsys):
    fails_as_expected(["seams", "none.h5"], capsys, "none.h5: there is no such file")
    fails_as_expected(["seams", "globe.h5", "--patch", "tail"], capsys, "no patch is called 'tail'")
    fails_as_expected(["seams", "globe.h5", "--deform", "fly=1"], capsys, "no deformation is called 'fly'")
    fails_as_expected(["seams", "globe.h5", "--json", "globe.h5"], capsys, "globe.h5: is read by this command")
