"""The run scripts with a flow of the whole grid show what the paper, other codes and the order of accuracy say."""

import importlib
from pathlib import Path

import numpy as np
import pytest

from bspline_mdao import fit_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.studio.plotting import scenes

pytestmark = pytest.mark.slow

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


@pytest.fixture
def without_renderer(monkeypatch):
    monkeypatch.setattr(scenes, "has_renderer", lambda: False)


def test_the_flow_about_the_blended_wing_body_is_solved_on_the_moved_grid(script, without_renderer, tmp_path):
    numbers = script("figure6_bwb_euler").main(quick=True, figures=tmp_path, fields=tmp_path / "body.vtm")
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
    assert (tmp_path / "body_walls.vtm").exists()


def test_drag_falls_with_the_spacing_of_a_grid_family(script, tmp_path):
    numbers = script("grid_family").main(quick=True, figures=tmp_path)
    for name, drag in (("wing", "spurious"), ("ball", "CD")):
        members, found = numbers[name]["members"], numbers[name]["convergence"]
        assert [member["residual"] < 1e-10 for member in members] == [True] * 4
        assert (np.diff([member[drag] for member in members]) < 0.0).all()
        assert found[drag]["order"] > 1.4
    assert numbers["wing"]["members"][3]["CL"] == pytest.approx(0.187, abs=0.01)
    assert (tmp_path / "grid_family.png").stat().st_size > 20_000


@pytest.mark.parametrize("order", [0.7, 2.0, 3.1])
def test_order_and_limit_of_a_power_of_the_spacing_are_found(script, order):
    spacings = np.array([1.5, 1.1, 0.6, 0.4])
    for n in (3, 4):
        found = script("grid_family").convergence(spacings[:n], 2.0 - 0.3 * spacings[:n] ** order)
        assert found[:2] == pytest.approx((order, 2.0), rel=1e-5)
        to_limit = script("grid_family").convergence(spacings[:n], 2.0 - 0.3 * spacings[:n] ** order, exact=2.0)
        assert to_limit[:2] == pytest.approx((order, 2.0))
    assert found.order_uncertainty == pytest.approx(0.0, abs=1e-4)


def test_values_that_turn_back_or_drift_apart_have_no_limit(script):
    spacings = np.array([1.5, 1.0, 0.75])
    for values in ([1.0, 2.0, 1.5], [1.0, 2.0, 4.0]):
        assert script("grid_family").convergence(spacings, np.array(values))[:2] == (None, None)


def test_the_lift_of_the_m6_is_that_of_the_vortex_lattice(script, tmp_path, monkeypatch):
    pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    monkeypatch.delenv("BSPLINE_MDAO_GRIDS", raising=False)
    monkeypatch.setenv("PATH", "")
    numbers = script("wing_flow_table").main(quick=True, openfoam=True, figures=tmp_path)
    assert numbers["hh_naca0012"] == {"skipped": "set BSPLINE_MDAO_GRIDS to the folder of the grid"}
    codes = numbers["onera_m6"]["codes"]
    assert codes["OpenFOAM"] == {"refused": "not installed"}
    assert codes["EulerFlow"]["CL"] == pytest.approx(codes["LatticeFlow"]["CL"], rel=0.09)
    assert codes["EulerFlow"]["CD_induced"] == pytest.approx(codes["LatticeFlow"]["CD_induced"], rel=0.25)
    assert (tmp_path / "wing_flow_table.png").stat().st_size > 20_000


def test_half_the_cells_of_the_rectangular_wing_have_the_lift_of_other_codes(script, real_grids, monkeypatch):
    monkeypatch.setenv("BSPLINE_MDAO_GRIDS", str(real_grids))
    table = script("wing_flow_table")
    found, reference = table.fly("hh_naca0012", *table.make_model("hh_naca0012", 0.5), False, 0)[0], table.REFERENCES
    found, reference = found["EulerFlow"], reference["hh_naca0012"]
    assert found["n_cells"] == 36864 / 8
    assert found["CL"] == pytest.approx(reference["ADflow"]["CL"], rel=0.03)
    assert found["CL"] == pytest.approx(reference["OpenFOAM"]["CL"], rel=0.05)
    assert found["CD"] < reference["ADflow"]["CD"]


def test_openfoam_is_named_where_it_is_missing(script, monkeypatch):
    table = script("wing_flow_table")
    monkeypatch.setattr(table, "openfoam_forces", lambda *arguments: None)
    model = fit_grid(onera_m6_grid((5, 5, 5)))
    codes, pressures = table.fly("onera_m6", model, 1.16, True, 0)
    assert codes["OpenFOAM"] == {"refused": "not installed"}
    quads, values = pressures["EulerFlow"]
    assert len(quads) == values.size
