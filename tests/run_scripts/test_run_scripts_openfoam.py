"""The optimisations with OpenFOAM: posed as they say, one line where it is missing, less drag where it is there."""

import importlib
import shutil
from functools import partial
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao.core.model.fitted_model import FittedModel
from bspline_mdao.flow import RansCase
from bspline_mdao.plotting import wall_quads
from bspline_mdao.scripts import run

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


class ThinAirfoil(om.ExplicitComponent):
    """Stands in for the flow: lift by angle and camber, a moment by camber, drag by the angle squared."""

    def initialize(self):
        self.options.declare("model", types=FittedModel)
        for name in ("case", "folder", "time_limit", "reference_area", "moment_reference"):
            self.options.declare(name)

    def setup(self):
        nodes = self.options["model"].regenerate().to_vector()
        self.quads = wall_quads(self.options["model"])
        self.add_input("grid", val=nodes, units="m")
        self.add_input("alpha", units="deg")
        self.add_input("speed", units="m/s")
        for name, shape in {"CL": 1, "CD": 1, "CM": 3, "Cp": len(self.quads), "y_plus": 2, "n_iterations": 1}.items():
            self.add_output(name, shape=shape)

    def compute(self, inputs, outputs):
        heights = inputs["grid"].reshape(-1, 3)[np.unique(self.quads), 1]
        camber, angle = heights.mean(), np.radians(inputs["alpha"].item())
        outputs["CL"] = 6.0 * (angle + 4.0 * camber)
        outputs["CD"] = 0.01 + 0.2 * angle**2
        outputs["CM"] = [0.0, 0.0, 4.0 * camber]


@pytest.mark.slow
def test_the_section_gets_the_camber_that_its_moment_allows(script, tmp_path, monkeypatch):
    openfoam_airfoil = script("openfoam_airfoil")
    monkeypatch.setattr(openfoam_airfoil, "OpenFoamFlow", ThinAirfoil)
    monkeypatch.setattr(openfoam_airfoil.shutil, "which", lambda program: program)
    monkeypatch.setitem(openfoam_airfoil.SIZES, "quick", ((32, 8, 1e-3), (48, 12, 1e-3), 9, 60))
    numbers = openfoam_airfoil.main(quick=True, figures=tmp_path)
    found, start = numbers["optimum"], numbers["NACA 0012"]
    angle = 1.0 / 6.0 - 0.08  # lift is 6 (angle + 4 camber), and 4 camber is at most 0.08
    assert found["success"]
    for flown in (found, found["finer"]):
        assert flown["CL"] == pytest.approx(1.0, abs=2e-4)
        assert np.radians(flown["alpha"]) == pytest.approx(angle, abs=2e-3)
        assert flown["moment"] < 0.081
        assert flown["thinnest"] > 0.749
        assert flown["volume"] > 0.999
    assert start["CD"] == pytest.approx(0.01 + 0.2 / 36.0, rel=1e-3)
    assert found["CD"] == pytest.approx(0.01 + 0.2 * angle**2, rel=1e-2)
    assert numbers["n_variables"] == 7
    assert (tmp_path / "openfoam_airfoil.png").stat().st_size > 20_000
    cases = om.CaseReader(str(tmp_path / "openfoam_airfoil.sql"))
    assert len(cases.list_cases("driver", out_stream=None)) >= 3


@pytest.mark.parametrize("name", ["openfoam_airfoil", "openfoam_wing"])
def test_openfoam_is_named_in_one_line_where_it_is_missing(name, script, monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    with pytest.raises(SystemExit) as ended:
        run(script(name).main, ["--quick"])
    assert ended.value.code == 2
    message = capsys.readouterr().err
    assert "simpleFoam of OpenFOAM is not on the PATH; on Debian: apt-get install openfoam" in message
    assert message.count("\n") == 1


@pytest.mark.solver
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("simpleFoam") is None, reason="simpleFoam is not on the PATH: install OpenFOAM")
def test_the_section_has_less_drag_in_turbulent_flow_on_the_finer_grid_as_well(script, monkeypatch):
    openfoam_airfoil = script("openfoam_airfoil")
    monkeypatch.setattr(openfoam_airfoil, "RansCase", partial(RansCase, tolerance=1e-5))
    monkeypatch.setitem(openfoam_airfoil.SIZES, "quick", ((96, 64, 6e-6), (128, 64, 6e-6), 7, 3))
    monkeypatch.setattr(openfoam_airfoil, "DRAG", 5e-4)  # longer steps, as there are two
    monkeypatch.setattr(openfoam_airfoil, "VIOLATION", 0.1)  # which leave the lift by more; designs are trimmed
    numbers = openfoam_airfoil.main(quick=True)
    start, found = numbers["NACA 0012"], numbers["optimum"]
    for before, after in ((start, found), (start["finer"], found["finer"])):
        assert after["CL"] == pytest.approx(1.0, abs=1e-3)
        assert after["CD"] < 0.99 * before["CD"]
    assert found["y_plus"][1] < 3.0
    assert found["thinnest"] > 0.7
    assert found["moment"] < 0.1
