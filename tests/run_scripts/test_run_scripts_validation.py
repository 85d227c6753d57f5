"""The scripts of validation find what is known, within what their small sizes allow."""

import importlib
from pathlib import Path

import numpy as np
import pytest

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


def test_bodies_whose_flow_is_known_have_its_pressures_and_lift_and_no_drag(script, tmp_path):
    numbers = script("validation_exact").main(quick=True, figures=tmp_path)
    for body in numbers.values():
        assert max(member["residual"] for member in body["members"]) < 1e-8
        assert body["orders"]["CD"] > 1.9
        assert body["orders"]["CD_entropy"] > 1.9
    cylinder, sphere, section = (numbers[name]["members"][-1] for name in ("cylinder", "sphere", "section"))
    assert cylinder["Cp_min"] == pytest.approx(cylinder["Cp_min_exact"], rel=0.02)
    assert sphere["Cp_min"] == pytest.approx(sphere["Cp_min_exact"], rel=0.01)
    assert (abs(cylinder["CL"]), abs(sphere["CL"])) == pytest.approx((0.0, 0.0), abs=1e-7)
    assert numbers["cylinder"]["orders"]["Cp_error"] > 1.8
    assert section["CL_incompressible"] == pytest.approx(section["CL_exact"], rel=0.01)
    assert abs(section["CD"]) < 3e-3
    assert (tmp_path / "validation_exact.png").stat().st_size > 50_000


def test_exact_pressures_are_those_of_the_expansions(script):
    exact = script("validation_exact")
    angle = np.linspace(0.1, 3.0, 7)
    speed = 2.0 * np.sin(angle) + 0.01 * (2 / 3 * np.sin(angle) - 1 / 2 * np.sin(3.0 * angle))
    np.testing.assert_allclose(exact.cylinder(np.cos(angle), 0.1), exact.pressure(speed, 0.1), rtol=1e-12)
    assert exact.sphere(0.0, 0.2) == pytest.approx(-1.2712, abs=1e-4)
    z, speed, lift = exact.joukowski(np.linspace(0.0, 2.0 * np.pi, 20001)[1:-1])
    steps, cp = np.diff(z), 1.0 - 0.5 * (speed[1:] ** 2 + speed[:-1] ** 2)
    force = np.sum(1j * steps * cp) * np.exp(-1j * np.radians(exact.ALPHA))
    assert force == pytest.approx(1j * lift, abs=2e-6)
