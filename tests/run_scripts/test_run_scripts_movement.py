"""The run scripts of Figures 4, 5, 7 and 8 and of the CPU times of section IV show what the paper shows."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


def assert_grids_are_valid(numbers):
    for name, grid in numbers.items():
        assert grid["n_inverted"] == 0, name
        assert 0.0 < grid["q_min"] < grid["q_mean"] < 1.0, name
        assert np.mean(grid["distribution"]) == pytest.approx(1.0), name  # the integral over bins of equal width


def assert_moves_are_converged_and_the_b_spline_is_cheaper(numbers):
    for move in (numbers["b_spline"], numbers["node_based"]):
        assert len(move["residuals"]) == 5
        assert max(move["residuals"]) < 1e-12
    assert numbers["node_based"]["n_points"] > 3 * numbers["b_spline"]["n_points"]
    assert numbers["node_based"]["cpu_seconds"] > numbers["b_spline"]["cpu_seconds"]


def test_figure4_m6_has_a_lower_first_peak_by_the_b_spline_mover(script, tmp_path):
    numbers = script("figure4_m6").main(figures=tmp_path)
    assert_grids_are_valid(numbers)
    assert_moves_are_converged_and_the_b_spline_is_cheaper(numbers)
    b_spline, node_based = numbers["b_spline"], numbers["node_based"]
    assert b_spline["lowest_peak"] <= node_based["lowest_peak"]
    assert abs(b_spline["lowest_peak_at"] - numbers["initial"]["lowest_peak_at"]) < 0.05
    assert b_spline["lowest_bin"] <= node_based["lowest_bin"]
    assert (tmp_path / "figure4_m6.png").stat().st_size > 20_000


def test_figure5_bwb_begins_almost_orthogonal_and_ends_valid_by_both_movers(script, tmp_path):
    numbers = script("figure5_bwb").main(figures=tmp_path)
    assert_grids_are_valid(numbers)
    assert_moves_are_converged_and_the_b_spline_is_cheaper(numbers)
    assert numbers["initial"]["q_min"] > 0.74  # as in the paper
    assert numbers["b_spline"]["lowest_bin"] <= numbers["node_based"]["lowest_bin"]
    assert (tmp_path / "figure5_bwb.png").stat().st_size > 20_000


def test_node_based_mover_takes_a_coarser_member_or_none(script):
    study, case = script("quality_distributions").study, script("morphs").BLENDED_WING_BODY
    assert set(study(case, paper=False, node_based="none")) == {"initial", "b_spline"}
    numbers = study(case, paper=False, node_based="coarse")
    assert numbers["node_based"]["n_cells"] == numbers["b_spline_same_size"]["n_cells"] == 12 * 5**3
    assert numbers["b_spline"]["n_cells"] == 12 * 10**3


def test_first_peak_is_found_past_the_first_bin(script):
    lowest_peak = script("quality_distributions").lowest_peak
    assert lowest_peak(np.array([5.0, 1.0, 1.1, 1.0, 3.0, 1.0, 8.0])) == 4
    assert lowest_peak(np.array([0.0, 0.0, 1.0, 2.0])) == 3


@pytest.mark.parametrize("has_renderer", [True, False])
def test_figures7_8_meshes_are_drawn_with_what_is_installed(script, tmp_path, monkeypatch, has_renderer):
    if has_renderer and not script("scenes").has_renderer():
        pytest.skip("PyVista does not render here")
    monkeypatch.setattr(script("scenes"), "has_renderer", lambda: has_renderer)
    numbers = script("figures7_8_meshes").main(figures=tmp_path)
    assert numbers["drawn_by"] == ("pyvista" if has_renderer else "matplotlib")
    for name, chord_lengths in (("figure7_m6", 0.9), ("figure8_bwb", 1.0)):
        assert numbers[name]["n_inverted"] == 0
        assert numbers[name]["largest_displacement"] > chord_lengths
        assert numbers[name]["n_surface_control_points"] < numbers[name]["n_control_points"] / 20
        assert (tmp_path / f"{name}.png").stat().st_size > 100_000


def test_a_missing_renderer_is_told_in_one_line(script, monkeypatch, capsys):
    scenes = script("scenes")
    monkeypatch.setattr(sys, "executable", "false")  # ends at once, as PyVista does without OpenGL
    assert not scenes.has_renderer.__wrapped__()
    message = capsys.readouterr().err
    assert "install libegl1" in message
    assert message.count("\n") == 1


def test_camera_looks_along_its_direction(script):
    camera = script("scenes").Camera(focus=(1.0, 2.0, 3.0), direction=(1.0, 1.0, 2.0), height=1.0)
    right, up, towards = camera.axes()
    np.testing.assert_allclose(camera.axes() @ camera.axes().T, np.eye(3), atol=1e-15)
    assert right[1] == 0.0
    assert up[1] > 0.0
    np.testing.assert_allclose(camera.project(np.array([1.0, 2.0, 3.0]) + 2.0 * towards), [0.0, 0.0, 2.0], atol=1e-15)


def test_section4_cpu_of_the_b_spline_mover_is_smaller_and_the_gap_grows(script, tmp_path):
    numbers = script("section4_cpu").main(figures=tmp_path)
    for name, paper_ratio in (("onera_m6", 441), ("blended_wing_body", 911)):
        case = numbers[name]
        assert case["ratio"]["paper"] == pytest.approx(paper_ratio, rel=2e-3)
        for kind in ("same_algorithm", "best_solvers"):
            ratio = case["ratio"][kind]
            assert 1.0 < ratio["measured"] < ratio["full_grid_at_least"] <= ratio["full_grid"]
        for times in case["node_based"].values():
            assert times["n_points"] == sorted(times["n_points"])
            assert times["exponent"] > 1.0
            assert case["full_grid"]["n_points"] > 2 * times["n_points"][-1]
        assert case["full_grid"]["is_extrapolated"]
        assert case["ratio"]["same_algorithm"]["full_grid"] > 2 * case["ratio"]["same_algorithm"]["measured"]
        assert min(case["node_based"]["conjugate_gradients"]["iterations"][-1]) > 100
    assert (tmp_path / "section4_cpu.png").stat().st_size > 20_000


def test_section4_cpu_stops_at_the_mesh_that_the_time_allows_and_extrapolates(script):
    section4_cpu = script("section4_cpu")
    series = section4_cpu.Series([100, 200, 400], [1.0, 4.0, 16.0], [[1]] * 3)
    assert series.exponent == pytest.approx(2.0)
    assert series.at(800) == pytest.approx(64.0)
    study = section4_cpu.prepare(script("morphs").BLENDED_WING_BODY, paper=False)
    for level in study.levels:
        study.measure(level, deadline=0.0)
    assert [len(times.n_points) for times in study.node_based.values()] == [1, 1]  # the first is always tried
    assert [len(times.n_points) for times in study.b_spline.values()] == [2, 2]
