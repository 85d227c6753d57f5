"""The optimisations with a flow of the whole grid reach what theory says, by exact derivatives, with every driver."""

import importlib
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"

IDEAL = 0.00746
"""Induced drag of an elliptical load at a lift coefficient of 0.375 and an aspect ratio of 6."""

TOLERANCE = 1e-3
"""Of quick designs: change of the drag in units of 0.01, and violation of constraints."""


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


@pytest.fixture
def one_driver(script):
    """A driver of NLopt alone, to save time."""
    drivers = script("optimisation").DRIVERS
    return {name: make for name, make in drivers.items() if name.startswith("NLopt")}


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
        assert found["optimality"] < 5e-3
        assert (np.diff(found["twist"]) < 0.0).all()
    assert_drawn_and_recorded(tmp_path, "twist_induced_drag", n_drivers=2)


def test_m6_lift_constrained_saves_drag_within_its_constraints(script, tmp_path):
    numbers = script("m6_lift_constrained").main(quick=True, flow="vortex", figures=tmp_path)
    assert_totals_are_exact(numbers["totals"])
    elliptical = 0.25**2 / (np.pi * 3.8)
    for found in numbers["drivers"].values():
        assert_feasible(found)
        assert found["CL"] == pytest.approx(0.25, rel=TOLERANCE)
        assert found["volume"] > 1.0 - TOLERANCE
        assert found["CD_induced"] == pytest.approx(elliptical, rel=5e-3)
    assert_drawn_and_recorded(tmp_path, "m6_lift_constrained", n_drivers=2)


def test_plate_to_aircraft_becomes_a_wing_on_the_grid_of_the_plate(script, tmp_path):
    numbers = script("plate_to_aircraft").main(quick=True, flow="vortex", figures=tmp_path)
    assert_totals_are_exact(numbers["totals"])
    assert numbers["initial"]["volume"] == pytest.approx(0.0, abs=1e-12)
    elliptical = 0.3**2 / (np.pi * 9.0)
    for found in numbers["drivers"].values():
        assert_feasible(found)
        assert found["CL"] == pytest.approx(0.3, rel=TOLERANCE)
        assert found["volume"] > 0.08 * (1.0 - TOLERANCE)
        assert found["span"] == pytest.approx(1.5)
        assert found["CD_induced"] == pytest.approx(elliptical, rel=5e-3)
    assert_drawn_and_recorded(tmp_path, "plate_to_aircraft", n_drivers=2)


def assert_feasible(found):
    assert found["success"]
    assert found["violation"] < TOLERANCE
    assert found["projected_area"] == pytest.approx(1.0, abs=TOLERANCE)
    assert found["n_inverted"] == 0
    assert found["min_corner"] > 0.05


def test_course_of_recorded_cases_is_that_of_the_problem(script, tmp_path):
    optimisation = script("optimisation")
    runs = {}
    for name, make in optimisation.DRIVERS.items():
        runs[name] = optimisation.optimise(scaled_problem, make(1e-14, 50), tmp_path / f"{name}.sql")
    for run in runs.values():
        course, values = run.course, run.history["g"].ravel()
        np.testing.assert_allclose(course.violations, np.abs(values - 2.0) / 4.0, atol=1e-15)
        n, x = course.differentiated[-1], run.problem.get_val("x")
        assert course.residuals[-1] < 1e-4 * course.residuals[0]
        assert (np.diff(course.differentiated) > 0).all()
        assert n < len(values)
        assert 4.0 * x[0] ** 3 == pytest.approx(6.0 * x[1], rel=1e-5)
    # at the start the gradient is (4, 6), in units of the driver (1.2, 1.8); what is along (1, 1) the constraint holds
    np.testing.assert_allclose(runs["NLopt LD_SLSQP"].course.residuals[0], 0.6 / np.sqrt(2.0))


def scaled_problem():
    """Least ``x0^4 + 3 x1^2`` with ``x0 + x1 = 2``, in units that all differ from 1."""
    problem = om.Problem(reports=None)
    component = om.ExecComp(["f = x[0]**4 + 3*x[1]**2", "g = x[0] + x[1]"], x=np.ones(2))
    component.options["do_coloring"] = False
    problem.model.add_subsystem("functions", component, promotes=["*"])
    problem.model.add_design_var("x", ref=4.0, ref0=1.0)
    problem.model.add_objective("f", ref=10.0)
    problem.model.add_constraint("g", equals=2.0, ref=4.0)
    return problem


def test_twist_in_euler_flow_comes_near_the_ellipse_on_few_cells(script, monkeypatch, one_driver):
    twist = script("twist_induced_drag")
    rows = ((5, 7, 5), (5, 5), (9, 5)), ((4, 5, 4), (4, 4), (5, 4))
    monkeypatch.setitem(twist.SIZES, "quick", twist.Size(*rows, twist.Spacing(0.06, 0.08, 0.08, 0.15), 3, 1e-5))
    numbers = twist.main(quick=True, drivers=one_driver)
    assert_totals_are_exact(numbers["totals"])
    (found,) = numbers["drivers"].values()
    assert found["success"]
    assert found["CL"] == pytest.approx(0.375, rel=1e-4)
    assert found["above_ideal"] < 0.6 * numbers["initial"]["above_ideal"]
    assert found["twist"][-1] < -1.0
    assert found["shares"]["flow"] > 0.3


def test_pressure_target_is_found_to_1e_6_by_its_pressures(script, monkeypatch):
    target, drivers = script("pressure_target"), script("optimisation").UNCONSTRAINED
    rows = ((5, 9, 5), (6, 6), (7, 5)), ((4, 7, 4), (4, 4), (5, 4))
    monkeypatch.setitem(target.SIZES, "quick", target.Size(*rows, 1e-15))
    numbers = target.main(quick=True, drivers=drivers)
    assert_totals_are_exact(numbers["totals"])
    assert numbers["n_variables"] == 2 * 5 * 4
    for found in numbers["drivers"].values():
        assert found["success"]
        assert found["objective"] < 1e-12  # the square of 1e-6
        assert found["relative_error_of_variables"] < 1e-6
        assert found["evaluations"] < 40


def test_plate_in_euler_flow_becomes_a_wing_of_less_drag_on_few_cells(script, monkeypatch, one_driver):
    plate, wing_design = script("plate_to_aircraft"), script("wing_design")
    rows = ((5, 7, 5), (5, 5), (7, 5)), ((4, 5, 4), (4, 4), (4, 4))
    monkeypatch.setitem(plate.SIZES, "quick", wing_design.Size(*rows, 2, 1e-3))
    numbers = plate.main(quick=True, drivers=one_driver)
    assert_totals_are_exact(numbers["totals"])
    (found,) = numbers["drivers"].values()
    assert_feasible(found)
    assert found["volume"] > 0.08 * (1.0 - TOLERANCE)
    assert found["CL"] == pytest.approx(0.3, rel=TOLERANCE)
    assert found["CL"] > 1.2 * numbers["initial"]["CL"]
    assert found["CD_induced"] + found["CD_entropy"] == pytest.approx(found["drag"], rel=1e-12)
    by_lift = [wing["drag"] / wing["CL"] ** 2 for wing in (found, numbers["initial"])]
    assert by_lift[0] < 0.6 * by_lift[1]


def test_flown_wing_knows_where_the_strips_of_the_span_load_end(script):
    twist, flown_wing = script("twist_induced_drag"), script("flown_wing")
    assert flown_wing.control_counts(((4, 5, 6), (7, 8), (9, 10)))[4:9] == [
        *((5, 8, 9), (6, 8, 9)),
        *((4, 7, 10), (5, 7, 10), (6, 7, 10)),
    ]
    for flow in flown_wing.FLOWS:
        wing = twist.make_wing(twist.SIZES["quick"], flow)
        problem = wing.problem([], mach=0.0)
        problem.setup()
        problem.final_setup()
        problem.model.geometry.run_solve_nonlinear()
        if flow == "vortex":
            problem.model.flow.run_solve_nonlinear()
        edges = wing.strip_edges(problem)
        assert edges.size == problem.get_val("span_load").size + 1
        assert edges[0] == pytest.approx(3.0, rel=0.02)  # a lattice ends where there still is a chord
        assert edges[-1] == pytest.approx(0.0, abs=1e-12)
        assert (np.diff(edges) < 0.0).all()


def test_wing_drawings_find_the_sections_of_a_wing(script):
    drawings, twist = script("wing_drawings"), script("twist_induced_drag")
    wing = twist.make_wing(twist.SIZES["quick"], "vortex")
    upper, lower = drawings.wing_sides(wing.model, wing.baseline.ravel())
    assert upper.shape == lower.shape == (9, 9, 3)
    assert upper[..., 1].max() == pytest.approx(0.06, rel=0.02)
    np.testing.assert_allclose(upper * [1.0, -1.0, 1.0], lower, atol=1e-6)
    section = drawings.section_of(wing.model, wing.baseline.ravel(), part=0.5)
    assert np.ptp(section[:, 0]) == pytest.approx(1.0, abs=1e-3)
    assert np.ptp(section[:, 2]) < 0.05


def test_mismatch_is_the_weighted_square_of_the_differences(script):
    target, weights = np.array([1.0, -2.0, 0.5]), np.array([0.5, 2.0, 3.0])
    problem, component = om.Problem(reports=None), script("mismatch").Mismatch
    problem.model.add_subsystem("match", component(source="Cp", target=target, weights=weights), promotes=["*"])
    problem.setup(force_alloc_complex=True)
    problem.set_val("Cp", [2.0, 1.0, -0.5])
    problem.run_model()
    assert problem.get_val("mismatch") == pytest.approx(0.5 * 1.0 + 2.0 * 9.0 + 3.0 * 1.0)
    (pairs,) = problem.check_partials(method="cs", out_stream=None).values()
    pair = pairs["mismatch", "Cp"]
    np.testing.assert_allclose(pair["J_fwd"], pair["J_fd"], rtol=1e-14)
