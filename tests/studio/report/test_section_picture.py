"""The picture of a section: curves through the nodes of the wall, what is refused, and when it is drawn."""

import numpy as np
import pytest
from parametrization_cases import section_model

from bspline_mdao import InputError, fit_grid
from bspline_mdao.generators import airfoil, airfoil_grid, onera_m6_grid
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.plotting import plot_section
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.report.section_picture import _outlines

FLOW = """\
[grid]
file = "foil.h5"
[variables.camber_modes]
lower = -0.01
upper = 0.01
[flow]
kind = "euler"
Mach_number = 0.4
[objective]
of = "CL"
maximize = true
[driver]
max_iterations = 2
[output]
report = false
estimate_errors = false
"""


@pytest.mark.parametrize("name", ["naca0012", "naca23012"])
def test_a_section_is_drawn_as_the_curve_through_its_nodes_and_not_as_a_polygon(name):
    surface = SurfaceGrid.of(fit_grid(airfoil_grid(name, 64, 8, far=6.0), n_control=[(65, 5, 2)]))
    (line,) = _outlines(surface.points, surface.quads)
    assert distances(surface.points[:, :2], line).max() < 1e-12
    true = airfoil(name).points
    assert distances(line, true).max() < 5e-5
    middles = 0.5 * (line[:-8:8] + line[8::8])
    assert distances(middles, true).max() > 5e-4


def distances(points, line):
    """Distances of points from a polygon."""
    starts, steps = line[:-1], np.diff(line, axis=0)
    starts, steps = (each[np.linalg.norm(steps, axis=1) > 0.0] for each in (starts, steps))
    away = points[:, None] - starts
    part = np.clip(np.sum(away * steps, axis=-1) / np.sum(steps**2, axis=-1), 0.0, 1.0)
    return np.linalg.norm(away - part[..., None] * steps, axis=-1).min(axis=1)


@pytest.mark.parametrize("axes", ["xzy", "zyx"])
def test_the_picture_of_a_section_is_among_the_results_in_any_axes(tmp_path, monkeypatch, axes):
    pytest.importorskip("matplotlib", reason="the extra pictures is not installed")
    monkeypatch.chdir(tmp_path)
    order = np.argsort(["xyz".index(letter) for letter in axes])
    section_model((0.0, 0.7), tuple(int(n) for n in np.array([0, 2, 1])[order]), 1.0, 32, (17, 8, 2)).save("foil.h5")
    (tmp_path / "study.toml").write_text(FLOW.replace('kind = "euler"', f'kind = "euler"\naxes = "{axes}"'))
    assert run(["optimize", "study.toml", "-o", "out"]) == 0
    assert (tmp_path / "out" / "section.png").read_bytes().startswith(b"\x89PNG")


def test_no_picture_is_drawn_where_the_study_says_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    section_model((0.0, 0.7), (0, 1, 2), 1.0, 32, (17, 8, 2)).save("foil.h5")
    (tmp_path / "study.toml").write_text(FLOW.replace("report", "picture = false\nreport"))
    assert run(["optimize", "study.toml", "-o", "out"]) == 0
    assert not (tmp_path / "out" / "section.png").exists()
    assert "plot_section" not in (tmp_path / "out" / "optimize.py").read_text()


def test_wings_and_other_suffixes_are_refused(tmp_path):
    with pytest.raises(InputError, match="is no grid about a section, one layer of cells deep; draw wings by `plot`"):
        plot_section(tmp_path / "wing.png", tmp_path / "cases.sql", fit_grid(onera_m6_grid((5, 5, 5))))
    with pytest.raises(InputError, match=r"section.pdf: the picture of a section is a PNG file"):
        plot_section(tmp_path / "section.pdf", tmp_path / "cases.sql", section_model())
