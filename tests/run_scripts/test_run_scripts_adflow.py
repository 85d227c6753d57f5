"""ADflow flies our sections and wings, where it is installed: totals by its adjoint, forces on our nodes, optima."""

import importlib
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao.testing import total_difference

pytestmark = [pytest.mark.solver, pytest.mark.slow]
pytest.importorskip("adflow", reason="ADflow is not installed; its own pages say how")

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"
HEIGHT = 0.01
COEFFICIENTS = [f"cruise.aero_post.{name}" for name in ("cl", "cd", "cmz")]


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


@pytest.fixture
def section(script, tmp_path):
    """A section of the smallest size with random heights, flown."""
    adflow_section = script("adflow_section")
    *counts, _ = adflow_section.SIZES["quick"]
    builder = adflow_section.Warped(adflow_section.make_model(*counts), str(tmp_path), "ours")
    problem = om.Problem(adflow_section.Study(builder=builder), reports=None)
    problem.setup(mode="rev")
    problem.set_val("heights", 0.2 * HEIGHT * np.random.default_rng(4).normal(size=(12, 1)))
    problem.run_model()
    return problem


@pytest.mark.parametrize(("name", "unit"), [("alpha", 1.0), ("heights", HEIGHT)])
def test_totals_by_the_adjoint_behind_our_movement_are_differences(section, name, unit):
    """By steps so small that they stay between kinks of the flow's residual."""
    totals = section.compute_totals(COEFFICIENTS, [name])
    direction = unit * np.random.default_rng(3).normal(size=section.get_val(name).shape)
    differences = total_difference(section, COEFFICIENTS, {name: direction}, step=3e-4, levels=1)
    for of in COEFFICIENTS:
        assert differences[of] == pytest.approx(totals[of, name] @ direction.ravel(), rel=1e-4)


def test_forces_and_pressures_on_our_nodes_are_those_of_the_solver(script, section):
    nodes, forces = script("adflow_section").wall_of(section)
    turn, (along, up, _) = np.radians(section.get_val("alpha").item()), forces.sum(axis=0)
    moment = np.cross(nodes - [0.25, 0.0, 0.0], forces)[:, 2].sum()
    ours = [up * np.cos(turn) - along * np.sin(turn), up * np.sin(turn) + along * np.cos(turn), moment]
    np.testing.assert_allclose(ours, [section.get_val(of).item() for of in COEFFICIENTS], rtol=0.0, atol=1e-13)
    x, pressures = script("adflow_section").pressures_of(section)
    assert x[pressures.argmax()] < 0.02
    assert 0.9 < pressures.max() < 1.2  # where the flow is at rest, in theory 1.14
    assert pressures.min() < -1.0


def test_less_drag_at_the_same_lift_and_volume(script, tmp_path):
    adflow_section = script("adflow_section")
    numbers = adflow_section.main(quick=True, folder=str(tmp_path / "section"), figures=tmp_path)
    start, best = numbers["initial"], numbers["optimum"]
    assert numbers["failed"] == 0
    assert numbers["run"]["success"]
    assert best["CD"] < 0.6 * start["CD"]
    assert best["CL"] == pytest.approx(adflow_section.LIFT, abs=1e-5)
    assert best["least_thickness"] > adflow_section.THINNEST - 1e-6
    assert numbers["finer_optimum"]["CD"] < 0.5 * numbers["finer_initial"]["CD"]
    assert (tmp_path / "adflow_section.png").stat().st_size > 10_000


def test_less_drag_of_a_wing_at_the_same_lift_by_twist_and_camber(script, tmp_path):
    adflow_wing = script("adflow_wing")
    numbers = adflow_wing.main(quick=True, folder=str(tmp_path / "wing"), figures=tmp_path)
    assert numbers["failed"] == 0
    for prefix in ("", "finer_"):
        start, best = (numbers[f"{prefix}{name}"] for name in ("initial", "optimum"))
        assert start["CL"] == pytest.approx(adflow_wing.LIFT, abs=1e-5)
        assert best["CL"] == pytest.approx(adflow_wing.LIFT, abs=1e-5)
        assert best["CD"] < 0.97 * start["CD"]
    assert (tmp_path / "adflow_wing.png").stat().st_size > 10_000


def test_both_movers_fly_the_same_wing(script, tmp_path):
    adflow_wing = script("adflow_wing")
    *shape, _ = adflow_wing.SIZES["quick"]
    model, lifts = adflow_wing.make_model(*shape), {}
    for mover in ("ours", "IDWarp"):
        builder = adflow_wing.Warped(model, str(tmp_path), mover)
        problem = om.Problem(adflow_wing.Study(builder=builder), reports=None)
        problem.setup(mode="rev")
        problem.set_val("twist", [0.0, -0.3, 0.6], units="deg")
        problem.set_val("camber", [0.01, 0.005, 0.008])
        problem.run_model()
        lifts[mover] = problem.get_val("cruise.aero_post.cl").item()
    assert lifts["ours"] != lifts["IDWarp"]  # their grids differ away from the wing
    assert lifts["ours"] == pytest.approx(lifts["IDWarp"], rel=3e-3)
