"""The optimisations reach their known answers with both drivers, by exact derivatives, in problems that read well."""

import importlib
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest
from openmdao.core.component import Component
from openmdao.visualization.n2_viewer.n2_viewer import _get_viewer_data

pytestmark = pytest.mark.slow

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


def assert_ran_well(runs, evaluations, optimality):
    for name, run in runs.items():
        assert run["success"], name
        assert run["violation"] < 1e-7, name
        assert run["optimality"] < optimality, name
        assert run["gradients"] <= run["evaluations"] < evaluations, name
        assert sum(run["shares"].values()) == pytest.approx(1.0)
        assert min(run["shares"].values()) >= 0.0
    assert {name.split()[0] for name in runs} == {"SciPy", "NLopt"}


def assert_totals_are_exact(totals):
    assert totals["transposed"] < 1e-12
    assert totals["differences"] < 1e-7


def assert_drawn(folder, name):
    assert (folder / f"{name}.png").stat().st_size > 20_000
    page = (folder / f"{name}.html").read_text(encoding="utf-8")
    assert len(page) > 100_000
    assert "<html" in page[:2000].lower()


def test_inverse_design_finds_the_target_to_1e_8(script, tmp_path, monkeypatch):
    """More than 200 variables by NLopt; fewer by both drivers, as SLSQP takes four evaluations a variable."""
    inverse_design = script("inverse_design")
    by_nlopt = {name: driver for name, driver in inverse_design.DRIVERS.items() if name.startswith("NLopt")}
    many = inverse_design.main(increments=1, figures=tmp_path, drivers=by_nlopt)
    monkeypatch.setitem(inverse_design.SIZES, False, ((7, 6, 5), (5, 4, 5), 1, "y"))
    few = inverse_design.main()
    assert many["n_variables"] >= 200
    assert few["n_variables"] >= 30
    assert_ran_well({**few["drivers"], **many["drivers"]}, evaluations=1000, optimality=1e-9)
    for numbers in (many, few):
        for run in numbers["drivers"].values():
            assert run["objective"] < 1e-16  # the square of 1e-8
            assert run["relative_error_of_variables"] < 1e-8
            assert run["largest_distance"] < 1e-8 * numbers["initial_distance"]
        assert_totals_are_exact(numbers["totals"])
    assert_drawn(tmp_path, "inverse_design")


def test_min_area_body_becomes_a_ball_at_second_order(script, tmp_path, monkeypatch):
    min_area_body = script("min_area_body")
    monkeypatch.setitem(min_area_body.SIZES, False, ((9, 17, 33), (5,)))
    numbers = min_area_body.main(figures=tmp_path)
    assert numbers["area"] == pytest.approx(4.835975862049409, rel=1e-14)
    assert_ran_well(numbers["drivers"], evaluations=100, optimality=1e-3)
    for run in numbers["drivers"].values():
        errors = run["errors"][5]
        assert errors[-1] < 3e-4
        assert (np.diff(errors) < 0.0).all()
        assert (errors > 0.0).all()  # no polyhedron has less area than the ball
        np.testing.assert_allclose(run["orders"][5], 2.0, atol=0.1)
        assert 0.0 < run["of_splines"][5] < 1.5e-4
        assert run["roundness"] < 5e-3
    first, second = (run["objective"] for run in numbers["drivers"].values())
    assert first == pytest.approx(second, rel=1e-8)
    assert numbers["n_inverted"] == 0
    assert numbers["min_corner"] > 0.5
    assert_totals_are_exact(numbers["totals"])
    assert_drawn(tmp_path, "min_area_body")


def test_smooth_seams_keeps_a_swelling_ball_smooth_where_it_gets_a_kink_without(script, tmp_path, monkeypatch):
    smooth_seams = script("smooth_seams")
    monkeypatch.setitem(smooth_seams.SIZES, False, (9, 5))
    numbers = smooth_seams.main(figures=tmp_path, folder=tmp_path)
    free, nearly, smooth, fair = (numbers[name] for name in ("free", "nearly", "smooth", "fair"))
    assert numbers["snapped_kink"] < 1e-3 * numbers["fitted_kink"]
    assert free["kink"] > 30.0
    assert nearly["kink"] < 1.0
    assert smooth["kink"] < 0.01
    assert fair["kink"] < 0.01
    assert fair["curvature"] < 0.4 < 1.0 < smooth["curvature"]
    for body in (free, nearly, smooth, fair):
        assert body["success"]
        assert body["violation"] < 1e-8
        assert body["cad"] is None or (body["cad"]["n_solids"] == 1 and body["cad"]["distance"] < 1e-9)
    assert_totals_are_exact(numbers["totals"])
    assert (tmp_path / "smooth_seams.png").stat().st_size > 20_000


def test_quality_constrained_cube_tangles_without_the_constraint_and_turns_with_it(script, tmp_path):
    numbers = script("quality_constrained").main(figures=tmp_path)
    for kind, evaluations in (("unconstrained", 100), ("constrained", 600)):
        assert_ran_well(numbers[kind], evaluations, optimality=1e-6)
        for run in numbers[kind].values():
            assert run["objective"] < 1e-12
            assert run["corners"] < 1e-6
            assert run["planes"] < 1e-6
    for run in numbers["unconstrained"].values():
        assert run["n_inverted"] > 10
        assert run["min_corner"] < -0.1
    for run in numbers["constrained"].values():
        assert run["n_inverted"] == 0
        assert run["min_corner"] > 0.1
    assert_totals_are_exact(numbers["totals"])
    assert_drawn(tmp_path, "quality_constrained")


@pytest.fixture(scope="module")
def problems():
    """Small problems of all scripts of this file, set up and run where no derivative is zero."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
        names = ("inverse_design", "min_area_body", "quality_constrained", "wing_twist_vlm")
        inverse, body, cube, lattice = map(importlib.import_module, names)
        monkeypatch.setitem(lattice.SIZES, False, ((5, 6, 7), (4, 4, 5), (0.03, 0.04, 0.04, 0.04), (2, 5), 0.25))
        ready = [
            inverse.started(inverse.InverseDesign((6, 5, 5), (5, 4, 4), 2, "xyz")),
            body.started(body.Body(5, 4)),
            cube.started(cube.Turn(5, 4, 2)),
            lattice.perturbed(lattice.Wing(False), "chord"),
        ]
    return dict(zip(names, ready))


def test_every_component_has_a_reader_and_no_option_is_too_large_to_show(problems):
    for name, problem in problems.items():
        data = _get_viewer_data(problem)
        sources = {connection["src"].rpartition(".")[0] for connection in data["connections_list"]}
        responses = {meta["source"].rpartition(".")[0] for meta in problem.model.get_responses().values()}
        components = {part_of(component.pathname) for component in components_of(problem)}
        assert len(components) >= 4, name
        assert components - {part_of(source) for source in sources | responses} == set(), name
        assert "Too Large to Display" not in str(data["tree"]), name


def test_partials_of_every_problem_agree_with_differences(problems, monkeypatch):
    monkeypatch.setattr(np.random, "random", np.random.default_rng(3).random)  # OpenMDAO draws directions with it
    for name, problem in problems.items():
        components = {component.pathname: component for component in components_of(problem)}
        for component in components.values():  # along a direction where there is no Jacobian, else entry by entry
            settings = {"form": "central", "step": 1e-7, "step_calc": "abs", "directional": component.matrix_free}
            component.set_check_partial_options("*", method="fd", **settings)
        data = problem.check_partials(method="fd", out_stream=None)
        assert set(data) == set(components)
        for path, pairs in data.items():
            assert max(np.abs(pair["J_fwd"]).max() for pair in pairs.values() if "J_fwd" in pair) > 0.0, (name, path)
            for key, pair in pairs.items():
                if "method" in components[path]._subjacs_info.get(tuple(f"{path}.{one}" for one in key), {}):
                    continue  # OpenAeroStruct has it by differences itself, by design variables alone
                exact, difference = (np.asarray(pair[jacobian]) for jacobian in ("J_fwd", "J_fd"))
                assert part_of(path) == "flow" or np.abs(exact).max() > 0.0, (name, path, key)
                assert np.abs(exact - difference).max() < max(5e-5 * np.abs(exact).max(), 1e-12), (name, path, key)


def part_of(pathname):
    """The component, or the flow solver as a whole: it offers more than one problem reads."""
    return "flow" if pathname.startswith("flow.") else pathname


def components_of(problem):
    """All components of a problem that compute something."""
    everything = problem.model.system_iter(recurse=True, typ=Component)
    computing = (component for component in everything if component.get_io_metadata("output"))  # others judge
    return (component for component in computing if not isinstance(component, om.IndepVarComp))
