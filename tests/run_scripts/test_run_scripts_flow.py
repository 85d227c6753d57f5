"""The optimisations with a flow of the whole grid reach what theory says, by exact derivatives."""

import importlib
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao.drivers import nlopt

pytestmark = pytest.mark.slow

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"

IDEAL = 0.00746
"""Induced drag of an elliptical load at a lift coefficient of 0.375 and an aspect ratio of 6."""

TOLERANCE = 1e-3
"""Of quick designs: change of the drag in units of 0.01, and violation of constraints."""


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


ONE_DRIVER = {"NLopt LD_SLSQP": nlopt}
"""A driver of NLopt alone, to save time."""


def assert_totals_are_exact(totals, differences=1e-5):
    assert totals["transposed"] < 1e-9
    assert totals["differences"] < differences


def assert_drawn_and_recorded(folder, name, n_drivers):
    assert (folder / f"{name}.png").stat().st_size > 50_000
    assert (folder / f"{name}.html").stat().st_size > 100_000
    cases = list(folder.glob(f"{name}_*.sql"))
    assert len(cases) == n_drivers
    for file in cases:
        assert len(om.CaseReader(str(file)).list_cases("driver", out_stream=None)) >= 3


def test_twist_induced_drag_is_that_of_the_ellipse_in_a_vortex_lattice(script, tmp_path):
    numbers = script("twist_induced_drag").main(quick=True, flow="vortex", figures=tmp_path)
    assert_totals_are_exact(numbers["totals"])
    assert numbers["initial"]["above_ideal"] > 0.005
    assert {name.split()[0] for name in numbers["drivers"]} == {"SciPy", "NLopt"}
    for found in numbers["drivers"].values():
        assert found["success"]
        assert found["CL"] == pytest.approx(0.375, abs=1e-6)
        assert found["CD_induced"] == pytest.approx(IDEAL, rel=2e-3)
        assert found["optimality"] < 1e-4
        assert found["finer"]["above_ideal"] == pytest.approx(found["above_ideal"], abs=5e-3)
        assert (np.diff(found["twist"]) < 0.0).all()
    assert_drawn_and_recorded(tmp_path, "twist_induced_drag", n_drivers=2)


def test_m6_lift_constrained_saves_drag_within_its_constraints(script, tmp_path):
    numbers = script("m6_lift_constrained").main(quick=True, flow="vortex", figures=tmp_path, drivers=ONE_DRIVER)
    assert_totals_are_exact(numbers["totals"])
    elliptical = 0.25**2 / (np.pi * 3.8)
    for found in numbers["drivers"].values():
        assert_feasible(found)
        assert found["CL"] == pytest.approx(0.25, rel=TOLERANCE)
        assert found["volume"] > 1.0 - TOLERANCE
        assert found["CD_induced"] == pytest.approx(elliptical, rel=5e-3)
    assert_drawn_and_recorded(tmp_path, "m6_lift_constrained", n_drivers=1)


def test_plate_to_aircraft_becomes_a_wing_on_the_grid_of_the_plate(script, tmp_path):
    numbers = script("plate_to_aircraft").main(quick=True, flow="vortex", figures=tmp_path, drivers=ONE_DRIVER)
    assert_totals_are_exact(numbers["totals"])
    assert numbers["initial"]["volume"] == pytest.approx(0.0, abs=1e-12)
    elliptical = 0.3**2 / (np.pi * 9.0)
    for found in numbers["drivers"].values():
        assert_feasible(found)
        assert found["CL"] == pytest.approx(0.3, rel=TOLERANCE)
        assert found["volume"] > 0.08 * (1.0 - TOLERANCE)
        assert found["span"] == pytest.approx(1.5)
        assert found["CD_induced"] == pytest.approx(elliptical, rel=5e-3)
    assert_drawn_and_recorded(tmp_path, "plate_to_aircraft", n_drivers=1)


def assert_feasible(found):
    assert found["success"]
    assert found["violation"] < TOLERANCE
    assert found["projected_area"] == pytest.approx(1.0, abs=TOLERANCE)
    assert found["n_inverted"] == 0
    assert found["min_corner"] > 0.05


def test_twist_in_euler_flow_comes_near_the_ellipse_on_few_cells(script, monkeypatch):
    twist = script("twist_induced_drag")
    rows = ((5, 7, 5), (5, 5), (9, 5)), ((4, 5, 4), (4, 4), (5, 4))
    monkeypatch.setitem(twist.SIZES, "quick", (*rows, (0.06, 0.08, 0.08, 0.15), 3, 1e-5))
    numbers = twist.main(quick=True, drivers=ONE_DRIVER)
    assert_totals_are_exact(numbers["totals"])
    (found,) = numbers["drivers"].values()
    assert found["success"]
    assert found["CL"] == pytest.approx(0.375, rel=1e-4)
    assert found["above_ideal"] < 0.6 * numbers["initial"]["above_ideal"]
    assert found["twist"][-1] < -1.0
    assert found["shares"]["flow"] > 0.3


def test_pressure_target_is_found_to_1e_6_by_its_pressures(script):
    numbers = script("pressure_target").main(quick=True)
    assert_totals_are_exact(numbers["totals"])
    assert numbers["n_variables"] == 2 * 5 * 4
    for found in numbers["drivers"].values():
        assert found["success"]
        assert found["objective"] < 1e-12  # the square of 1e-6
        assert found["relative_error_of_variables"] < 1e-6
        assert found["evaluations"] < 40


def test_plate_in_euler_flow_becomes_a_wing_of_less_drag_on_few_cells(script, monkeypatch):
    plate = script("plate_to_aircraft")
    rows = ((5, 7, 5), (5, 5), (7, 5)), ((4, 5, 4), (4, 4), (4, 4))
    monkeypatch.setitem(plate.SIZES, "quick", (*rows, 2, 1e-3))
    numbers = plate.main(quick=True, drivers=ONE_DRIVER)
    assert_totals_are_exact(numbers["totals"])
    (found,) = numbers["drivers"].values()
    assert_feasible(found)
    assert found["volume"] > 0.08 * (1.0 - TOLERANCE)
    assert found["CL"] == pytest.approx(0.3, rel=TOLERANCE)
    assert found["CL"] > 1.2 * numbers["initial"]["CL"]
    assert found["CD_induced"] + found["CD_entropy"] == pytest.approx(found["drag"], rel=1e-12)
    by_lift = [wing["drag"] / wing["CL"] ** 2 for wing in (found, numbers["initial"])]
    assert by_lift[0] < 0.6 * by_lift[1]


def test_the_multipoint_section_moves_one_grid_for_both_flows(script, tmp_path):
    numbers = script("multipoint_section").main(quick=True, figures=tmp_path, drivers=ONE_DRIVER)
    assert_totals_are_exact(numbers["totals"])
    (found,) = numbers["drivers"].values()
    for wing in (numbers["initial"], found, found["finer"]):
        assert wing["slow"]["CL"] == pytest.approx(0.4, abs=1e-9)
        assert wing["fast"]["CL"] == pytest.approx(0.4, abs=1e-9)
        assert wing["drag"] == pytest.approx(0.5 * (wing["slow"]["CD"] + wing["fast"]["CD"]), rel=1e-12)
    assert found["drag"] < 0.8 * numbers["initial"]["drag"]
    assert found["finer"]["drag"] < 0.8 * numbers["initial"]["finer"]["drag"]
    assert found["thinnest"] > 0.85 - 1e-8
    assert_drawn_and_recorded(tmp_path, "multipoint_section", n_drivers=1)


def test_the_transonic_m6_saves_drag_on_the_finer_grid_as_well(script, tmp_path):
    numbers = script("m6_transonic").main(quick=True, figures=tmp_path, drivers=ONE_DRIVER)
    assert_totals_are_exact(numbers["totals"])
    (found,) = numbers["drivers"].values()
    for wing in (numbers["initial"], found, found["finer"]):
        assert wing["CL"] == pytest.approx(0.27, abs=1e-9)
    assert found["CD"] < numbers["initial"]["CD"]
    assert found["finer"]["CD"] < numbers["initial"]["finer"]["CD"]
    assert found["thinnest"] > 0.9 - 1e-8
    assert_drawn_and_recorded(tmp_path, "m6_transonic", n_drivers=1)


def test_every_level_of_the_m6_goes_on_from_the_one_before(script, tmp_path, monkeypatch):
    levels = script("m6_levels")
    rows = ((5, 7, 5), (5, 5), (6, 5)), ((4, 6, 4), (4, 4), (5, 4))
    monkeypatch.setitem(levels.SIZES, "quick", (*rows, 1, 1e-3, 2))
    numbers = levels.main(quick=True, figures=tmp_path)
    assert_totals_are_exact(numbers["totals"])
    assert sum(knots.size for knots in numbers["knots"]) == 1
    assert numbers["n_variables"][0] < numbers["n_variables"][1] < numbers["n_variables"][2]
    assert 0.0 < numbers["used"][0] < numbers["used"][1] < 1.0
    files = [om.CaseReader(str(tmp_path / f"m6_levels_{number}.sql")) for number in (1, 2, 3)]
    names = [file.list_cases("driver", out_stream=None) for file in files]
    first = [file.get_case(each[0])["drag"].item() for file, each in zip(files, names)]
    lowest = [min(file.get_case(name)["drag"].item() for name in each) for file, each in zip(files, names)]
    assert first[0] > first[1] > first[2]
    assert all(later < 1.01 * before for before, later in zip(lowest, first[1:]))
    assert (tmp_path / "m6_levels.png").stat().st_size > 50_000


def test_no_thinner_section_has_less_drag_at_zero_lift(script, tmp_path):
    numbers = script("adodg1_naca0012").main(quick=True, figures=tmp_path, drivers=ONE_DRIVER)
    assert_totals_are_exact(numbers["totals"])
    (found,) = numbers["drivers"].values()
    assert found["lowest"] > -1e-9
    assert found["violation"] < 1e-8
    assert not found["cold"] < (1.0 - 1e-6) * found["drag"]  # of two flows, that of the optimum is the one of less drag
    assert found["drag"] < 0.8 * numbers["initial"]["drag"]
    assert np.nanmin(list(found["finer"].values())) < 0.8 * numbers["initial"]["finer"]["drag"]
    assert_drawn_and_recorded(tmp_path, "adodg1_naca0012", n_drivers=1)
