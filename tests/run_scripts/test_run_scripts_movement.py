"""The run scripts of Figures 4, 5, 7 and 8 and of the CPU times of section IV show what the paper shows."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from bspline_mdao.studio.plotting import scenes

pytestmark = pytest.mark.slow

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


def test_figures4_and_5_have_valid_grids_and_a_lower_first_peak_by_the_b_spline_mover(script, tmp_path):
    numbers = script("figures4_5_quality").main(figures=tmp_path)
    for name, found in numbers.items():
        assert_grids_are_valid(found)
        assert_moves_are_converged_and_the_b_spline_is_cheaper(found)
        assert found["b_spline"]["lowest_bin"] <= found["node_based"]["lowest_bin"]
        assert (tmp_path / f"{name}.png").stat().st_size > 20_000
    b_spline, node_based, initial = (numbers["figure4_m6"][name] for name in ("b_spline", "node_based", "initial"))
    assert b_spline["lowest_peak"] <= node_based["lowest_peak"]
    assert abs(b_spline["lowest_peak_at"] - initial["lowest_peak_at"]) < 0.05
    assert numbers["figure5_bwb"]["initial"]["q_min"] > 0.74  # as in the paper


def test_node_based_mover_takes_a_coarser_member_or_none(script):
    study = script("figures4_5_quality").study
    assert set(study("figure5_bwb", (11, 11, 11), (7, 7, 7), "none")) == {"initial", "b_spline"}
    numbers = study("figure5_bwb", (11, 11, 11), (7, 7, 7), "coarse")
    assert numbers["node_based"]["n_cells"] == numbers["b_spline_same_size"]["n_cells"] == 12 * 5**3
    assert numbers["b_spline"]["n_cells"] == 12 * 10**3


def test_first_peak_is_found_past_the_first_bin(script):
    lowest_peak = script("figures4_5_quality").lowest_peak
    assert lowest_peak(np.array([5.0, 1.0, 1.1, 1.0, 3.0, 1.0, 8.0])) == 4
    assert lowest_peak(np.array([0.0, 0.0, 1.0, 2.0])) == 3


@pytest.mark.parametrize("has_renderer", [True, False])
def test_figures7_8_meshes_are_drawn_with_what_is_installed(script, tmp_path, monkeypatch, has_renderer):
    if has_renderer and not scenes.has_renderer():
        pytest.skip("PyVista does not render here")
    monkeypatch.setattr(scenes, "has_renderer", lambda: has_renderer)
    numbers = script("figures7_8_meshes").main(figures=tmp_path)
    assert numbers["drawn_by"] == ("pyvista" if has_renderer else "matplotlib")
    for name, chord_lengths in (("figure7_m6", 0.9), ("figure8_bwb", 1.0)):
        assert numbers[name]["n_inverted"] == 0
        assert numbers[name]["largest_displacement"] > chord_lengths
        assert numbers[name]["n_surface_control_points"] < numbers[name]["n_control_points"] / 20
        assert (tmp_path / f"{name}.png").stat().st_size > 100_000


def test_section4_cpu_of_the_b_spline_mover_is_smaller_and_the_gap_grows(script, tmp_path):
    numbers = script("section4_cpu").main(figures=tmp_path)
    for name, paper_ratio in (("onera_m6", 441), ("blended_wing_body", 911)):
        case = numbers[name]
        assert case["ratio"]["paper"] == pytest.approx(paper_ratio, rel=2e-3)
        has_multigrid = "multigrid" in case["node_based"]
        ratio = case["ratio"]["same_algorithm"]
        assert 1.0 < ratio["measured"] < ratio["full_grid_at_least"] <= ratio["full_grid"]
        best = case["ratio"]["best_solvers"]
        assert 1.0 < best["measured"] <= best["full_grid"]
        for solver, times in case["node_based"].items():
            assert times["n_points"] == sorted(times["n_points"])
            is_full = case["full_grid"]["n_points"] == times["n_points"][-1]
            assert is_full if solver == "multigrid" else case["full_grid"]["n_points"] > 2 * times["n_points"][-1]
        assert case["full_grid"]["is_extrapolated"] is not has_multigrid
        assert case["ratio"]["same_algorithm"]["full_grid"] > 2 * case["ratio"]["same_algorithm"]["measured"]
        assert min(case["node_based"]["conjugate_gradients"]["iterations"][-1]) > 100
    assert (tmp_path / "section4_cpu.png").stat().st_size > 20_000


def test_section4_cpu_stops_at_the_mesh_that_the_time_allows_and_extrapolates(script):
    section4_cpu = script("section4_cpu")
    series = section4_cpu.Series([100, 200, 400], [1.0, 4.0, 16.0], [[1]] * 3)
    assert series.exponent == pytest.approx(2.0)
    assert series.at(800) == pytest.approx(64.0)
    found = section4_cpu.study("blended_wing_body", (9, 9, 9), (5, 5, 5), (0.5, 0.75), seconds=0.0)
    assert {len(times["n_points"]) for times in found["node_based"].values()} == {1}  # the first is always tried
    assert {len(times["n_points"]) for times in found["b_spline"].values()} == {2}


def test_flaps_turn_by_25_degrees_without_an_inverted_cell_and_a_section_by_any_angle(script, tmp_path):
    numbers = script("flap_deflection").main(quick=True, figures=tmp_path)
    for name, found in numbers.items():
        assert len(found["angles"]) == len(found["heights"]) == len(found["worst"]) == 11
        assert max(found["n_inverted"]) == 0, name
        assert min(found["worst"]) > (0.4 if name == "gap" else 0.95)
    for low, high in numbers["section"]["heights"]:
        assert 0.999 < low <= high < 1.001
    for low, high in numbers["wing"]["heights"]:
        assert 0.85 < low <= high < 1.15
    assert numbers["whole section"]["angles"][-1] == 400.0
    np.testing.assert_allclose(numbers["whole section"]["heights"], 1.0, atol=1e-9)
    assert (tmp_path / "flap_deflection.png").stat().st_size > 100_000
