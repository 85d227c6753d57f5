"""The run scripts with a flow of the whole grid show what the paper, other codes and the order of accuracy say."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from bspline_mdao import fit_grid, onera_m6_grid

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


@pytest.fixture
def without_renderer(script, monkeypatch):
    monkeypatch.setattr(script("scenes"), "has_renderer", lambda: False)


def test_the_flow_about_the_blended_wing_body_is_solved_on_the_moved_grid(script, without_renderer, tmp_path):
    numbers = script("figure6_bwb_euler").main(quick=True, figures=tmp_path)
    assert numbers["n_cells"] == 6144
    assert numbers["residual"] < 1e-10
    assert 0.3 < numbers["CL"] < 0.45
    aspect_ratio = 2.0 * 1.86**2 / numbers["reference_area"]
    flat = numbers["CL"] ** 2 / (np.pi * aspect_ratio)
    assert 0.8 * flat < numbers["CD_induced"] < flat  # winglets save some of it
    assert 0.0 < numbers["CD_entropy"] < numbers["CD"]
    assert numbers["gradient_seconds"] > 0.0
    assert numbers["drawn_by"] == "matplotlib"
    assert (tmp_path / "figure6_bwb_euler.png").stat().st_size > 50_000


def test_drag_falls_with_the_spacing_of_a_grid_family(script, tmp_path):
    numbers = script("grid_family").main(quick=True, figures=tmp_path)
    for name in ("wing", "ball"):
        members, found = numbers[name]["members"], numbers[name]["convergence"]
        assert [member["residual"] < 1e-10 for member in members] == [True] * 3
        assert members[0]["CD"] > members[1]["CD"] > members[2]["CD"] > found["CD"]["limit"]
        assert found["CD"]["order"] > 1.5
        assert found["CD_entropy"]["order"] > 1.5
    assert numbers["wing"]["members"][2]["CL"] == pytest.approx(0.32, abs=0.01)
    assert (tmp_path / "grid_family.png").stat().st_size > 20_000


@pytest.mark.parametrize("order", [0.7, 2.0, 3.1])
def test_order_and_limit_of_a_power_of_the_spacing_are_found(script, order):
    spacings = np.array([1.5, 1.1, 0.6])
    found = script("grid_family").convergence(spacings, 2.0 - 0.3 * spacings**order)
    assert found == pytest.approx((order, 2.0))
    to_limit = script("grid_family").convergence(spacings, 2.0 - 0.3 * spacings**order, exact=2.0)
    assert to_limit == pytest.approx((order, 2.0))


def test_values_that_turn_back_or_drift_apart_have_no_limit(script):
    spacings = np.array([1.5, 1.0, 0.75])
    for values in ([1.0, 2.0, 1.5], [1.0, 2.0, 4.0]):
        assert script("grid_family").convergence(spacings, np.array(values)) == (None, None)


def test_the_lift_of_the_m6_is_that_of_the_vortex_lattice(script, tmp_path, monkeypatch):
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    monkeypatch.delenv("BSPLINE_MDAO_GRIDS", raising=False)
    monkeypatch.setenv("PATH", "")
    numbers = script("wing_flow_table").main(quick=True, openfoam=True, figures=tmp_path)
    assert numbers["hh_naca0012"] == {"skipped": "set BSPLINE_MDAO_GRIDS to the folder of the grid"}
    codes = numbers["onera_m6"]["codes"]
    assert codes["OpenFOAM"] == {"refused": "not installed"}
    assert codes["EulerFlow"]["CL"] == pytest.approx(codes["LatticeFlow"]["CL"], rel=0.06)
    assert codes["EulerFlow"]["CD_induced"] == pytest.approx(codes["LatticeFlow"]["CD_induced"], rel=0.15)
    assert (tmp_path / "wing_flow_table.png").stat().st_size > 20_000


def test_half_the_cells_of_the_rectangular_wing_have_the_lift_of_other_codes(script, real_grids, monkeypatch):
    monkeypatch.setenv("BSPLINE_MDAO_GRIDS", str(real_grids))
    table = script("wing_flow_table")
    case = table.CASES["hh_naca0012"]
    found = table.run_euler(table.Flight.of(case, case.sizes["quick"], iprint=0).problem)
    assert found["n_cells"] == 36864 / 8
    assert found["CL"] == pytest.approx(case.references["ADflow"]["CL"], rel=0.03)
    assert found["CL"] == pytest.approx(case.references["OpenFOAM"]["CL"], rel=0.05)
    assert found["CD"] < case.references["ADflow"]["CD"]


def test_faces_around_a_swept_section_run_from_the_trailing_edge_over_the_upper_side_and_back(script):
    sections = script("wall_sections")
    angle = np.linspace(0.0, 2.0 * np.pi, 9)
    outline = np.stack([0.5 + 0.5 * np.cos(angle), 0.1 * np.sin(angle)], axis=1)
    nodes = np.array([[(x + 0.6 * z, y, z) for z in (0.0, 1.0, 2.0)] for x, y in outline])
    quads = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2)
    shuffled = np.random.default_rng(0).permutation(16)
    around = shuffled.argsort().reshape(8, 2)
    quads = quads.reshape(-1, 4, 3)[shuffled]
    np.testing.assert_array_equal(sections.faces_around(quads, 1.5), around[:, 1])
    np.testing.assert_allclose(sections.chord_ends(quads[around[:, 1]]), [0.9, 1.9])


def test_painted_faces_have_the_colours_of_their_values(script, without_renderer, tmp_path):
    scenes, common = script("scenes"), script("common")
    points = np.array(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0]]
    )
    paint = scenes.Paint(
        points, np.array([[0, 1, 2, 3], [1, 4, 5, 2]]), np.array([-1.0, 0.5]), scenes.Normalize(-1.0, 0.5)
    )
    camera = scenes.Camera(focus=(1.0, 0.5, 0.0), direction=(0.0, 0.0, 1.0), height=2.0)
    with common.figure(tmp_path, "painted", (2.0, 2.0)) as canvas:
        axes = canvas.subplots()
        scenes.draw_scene(axes, scenes.Scene([], [], paint=paint), camera, (2.0, 2.0))
        colors = axes.collections[0].get_facecolors()
    np.testing.assert_allclose(colors, paint.mappable().to_rgba([-1.0, 0.5]))


def test_openfoam_is_named_where_it_is_missing(script, monkeypatch):
    runs = script("euler_runs")
    monkeypatch.setattr(runs, "openfoam_forces", lambda *arguments: None)
    model = fit_grid(onera_m6_grid((5, 5, 5)))
    problem = runs.flow_problem(model, runs.Condition(0.3, 3.0, 1.16), iprint=0)
    assert runs.run_openfoam(problem, model, runs.Condition(0.3, 3.0, 1.16)) == ({"refused": "not installed"}, None)
    assert len(runs.wall_quads(model)) == problem.get_val("Cp").size
