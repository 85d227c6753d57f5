"""The run scripts of Figures 1 to 3 give the numbers that the paper implies."""

import importlib
import json
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


def exact_basis(T, order, i, xi):
    """Eq. (2) in exact arithmetic."""
    if order == 1:
        return Fraction(T[i] <= xi < T[i + 1])
    left, right = T[i + order - 1] - T[i], T[i + order] - T[i + 1]
    total = (xi - T[i]) / left * exact_basis(T, order - 1, i, xi) if left else 0
    return total + ((T[i + order] - xi) / right * exact_basis(T, order - 1, i + 1, xi) if right else 0)


def test_figure_1_shows_the_exact_basis(script):
    numbers = script("figure1_basis").main()
    T = [Fraction(k).limit_denominator(10) for k in (0, 0, 0, 0, 0.1, 0.2, 0.5, 1, 1, 1, 1)]
    expected = [[float(exact_basis(T, 4, i, xi)) for i in range(7)] for xi in T[4:7]]
    assert numbers["n_functions"] == 7
    np.testing.assert_allclose(numbers["values_at_inner_knots"], expected, atol=1e-15)
    assert numbers["partition_of_unity_error"] < 1e-15
    assert numbers["maxima"][[0, -1]].tolist() == [1.0, 1.0]
    assert (np.diff(numbers["maxima_at"]) > 0).all()


def test_figure_2_shows_how_control_points_and_parameters_set_the_spacing(script):
    numbers = script("figure2_mesh1d").main()
    assert numbers["end_slope_ratio"] == pytest.approx(3.0)
    assert 2.0 < numbers["uniform"]["spacing_ratio"] < 3.0
    assert numbers["uniform_parameters"]["spacing_ratio"] == pytest.approx(1.0, abs=1e-12)
    adapted = numbers["adapted"]
    finest = np.argmin(np.diff(adapted["mesh"]))
    closest = np.argmin(np.diff(adapted["control_points"]))
    assert adapted["control_points"][closest - 1] < adapted["mesh"][finest] < adapted["control_points"][closest + 2]
    assert adapted["spacing_ratio"] > 2 * numbers["uniform"]["spacing_ratio"]


def test_figure_3_shows_a_smooth_basis_function_that_moves(script):
    numbers = script("figure3_modified_basis").main()
    assert (np.diff(numbers["peak_at"]) > 0.1).all()
    assert numbers["partition_of_unity_error"] < 2e-15
    assert max(numbers["jumps"]) < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["figure1_basis", "figure2_mesh1d", "figure3_modified_basis"])
def test_script_writes_what_it_is_told_to_and_nothing_else(name, tmp_path):
    command = [sys.executable, RUN_SCRIPTS / f"{name}.py", "--paper", "--json", "numbers.json", "--figures", "figures"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    assert json.loads((tmp_path / "numbers.json").read_text())
    figures = list((tmp_path / "figures").iterdir())
    assert figures
    assert all(f.suffix == ".png" and f.stat().st_size > 10_000 for f in figures)
    assert {p.name for p in tmp_path.iterdir()} == {"numbers.json", "figures"}


@pytest.mark.slow
def test_walls_of_curved_elements_come_nearer_to_the_splines_with_their_degree(script, tmp_path):
    found = script("curved_elements").main(quick=True, figures=tmp_path)["order 4"]
    assert found["degree 1"]["order"][-1] > 1.8
    assert found["degree 2"]["distance"][-1] < 0.05 * found["degree 1"]["distance"][-1]
    assert min(found["degree 2"]["worst_jacobian"]) > 0
    assert {"curved_elements.png", "ball.cgns", "ball.msh"} <= {path.name for path in tmp_path.iterdir()}
