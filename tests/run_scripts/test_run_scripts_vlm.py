"""The optimisations with OpenAeroStruct reach what theory says, or agree with each other."""

import importlib
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.slow

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


def assert_totals_are_exact(numbers):
    totals = numbers["totals"]
    assert totals["transposed"] < 1e-10
    assert totals["differences"] < 3e-7  # rounding of the smallest steps: 1.2e-7 of the swept wing
    assert totals["errors"][0] / totals["errors"][1] == pytest.approx(4.0, abs=0.1)  # as the step is halved


def test_wing_twist_vlm_reaches_munks_least_drag_with_every_driver(script, tmp_path, monkeypatch):
    """On half the nodes of what the script takes, and 6 strips: as many as stations."""
    twist, n_strips = script("wing_twist_vlm"), 6
    size = (9, 7, 9), (5, 5, 6), (0.01, 0.02, 0.02, 0.02), (2, n_strips + 1), 0.25
    monkeypatch.setitem(twist.SIZES, False, size)
    numbers = twist.main(figures=tmp_path)
    for name, gap in (("twist", 1e-7), ("chord", 1e-6), ("swept", 1e-5)):
        case = numbers[name]
        assert_totals_are_exact(case)
        assert case["initial"]["gap"] > 0.01
        assert len(case["drivers"]) >= 1
        for found in case["drivers"].values():
            assert found["success"]
            assert -1e-12 < found["gap"] < gap
            assert found["violation"] < 1e-6
            assert found["evaluations"] < 100
            assert sum(found["shares"].values()) == pytest.approx(1.0)
    for found in numbers["twist"]["drivers"].values():
        assert found["efficiency"] == pytest.approx(1.0 + 0.5 / n_strips, rel=1e-7)
    assert (tmp_path / "wing_twist_vlm.png").stat().st_size > 50_000
    assert (tmp_path / "wing_twist_vlm.html").exists()


def test_wing_aerostructural_saves_fuel_with_every_driver_alike(script, tmp_path):
    numbers = script("wing_aerostructural").main(figures=tmp_path)
    assert_totals_are_exact(numbers)
    initial, drivers = numbers["initial"], numbers["drivers"]
    burns = [found["fuel_burn"] for found in drivers.values()]
    np.testing.assert_allclose(burns, burns[0], rtol=1e-7)
    assert burns[0] == pytest.approx(10.73508, rel=1e-5)
    for found in drivers.values():
        assert found["success"]
        assert found["optimality"] < 1e-4
        assert abs(found["failure"]) < 1e-6  # as thin as the stress allows
        assert found["structural_mass"] < 0.4 * initial["structural_mass"]
        assert found["centre_of_lift"] < initial["centre_of_lift"] - 0.01
    assert (tmp_path / "wing_aerostructural.png").stat().st_size > 30_000
    assert (tmp_path / "wing_aerostructural.html").exists()


def test_lattice_wing_is_the_rectangle_of_the_paper(script):
    wing = script("wing_twist_vlm").Wing(paper=False)
    nodes = wing.lattice.evaluate(wing.lattice.surface.points)
    assert nodes[-1, 0, 0] == pytest.approx(0.49664)
    assert -nodes[0, 0, 1] / nodes[-1, 0, 0] == pytest.approx(2.989, abs=1e-3)
    assert wing.area == pytest.approx(2.0 * nodes[-1, 0, 0] * -nodes[0, 0, 1])


def test_euler_aerostructural_bends_the_wing_and_has_exact_totals(script, tmp_path):
    pytest.importorskip("mphys", reason="MPhys is not installed")
    numbers = script("euler_aerostructural").main(figures=tmp_path)
    rigid, *bent = numbers["flights"].values()
    assert rigid["tip"] < 1e-5
    assert np.all(np.diff([flight["tip"] for flight in (rigid, *bent)]) > 0.02)
    assert np.all(np.diff([flight["CL"] for flight in (rigid, *bent)]) < -0.01)
    assert all(flight["washout"] > 0.3 for flight in bent)
    assert all(flight["iterations"] < 15 for flight in bent)
    totals = numbers["totals"]
    assert totals["transposed"] < 2e-9
    assert totals["differences"] < 2e-7
    assert totals["errors"][1] < 0.3 * totals["errors"][0]  # of second order in the step
    assert (tmp_path / "euler_aerostructural.png").stat().st_size > 30_000


def test_parallel_wing_trims_the_wing_at_the_least_induced_drag(script):
    numbers = script("parallel_wing").main(quick=True)
    initial, optimal = numbers["initial"], numbers["optimal"]
    assert numbers["success"]
    assert optimal["CL"] == pytest.approx(0.35, rel=1e-5)
    assert optimal["CM"] < 0.19 + 1e-5
    assert optimal["CD_induced"] < initial["CD_induced"] * (optimal["CL"] / initial["CL"]) ** 2
    assert [each["nodes"] for each in numbers["processes"]] == [numbers["n_nodes"]]
