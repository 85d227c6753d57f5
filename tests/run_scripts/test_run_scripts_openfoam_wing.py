"""The wing with OpenFOAM: posed as it says, and less drag where the solver is there."""

import importlib
import shutil
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import fit_grid
from bspline_mdao.core.model.fitted_model import FittedModel
from bspline_mdao.flow import RansCase
from bspline_mdao.generators import Wing, hh_wing_grid, naca_section
from bspline_mdao.plotting import wall_quads

TIP_ANGLE, CAMBER = -0.04, 0.02
"""Twist (rad) and camber (chords) of least drag in the stand-in."""


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "run_scripts"))
    return importlib.import_module


class ThinWing(om.ExplicitComponent):
    """Stands in for the flow: lift by angle and camber, drag by what the tip's twist and the root's camber lack."""

    def initialize(self):
        self.options.declare("model", types=FittedModel)
        for name in ("case", "folder", "time_limit", "reference_area"):
            self.options.declare(name)

    def setup(self):
        nodes = self.options["model"].regenerate().to_vector()
        self.quads = wall_quads(self.options["model"])
        walls, at = nodes.reshape(-1, 3), np.unique(self.quads)
        self.tip = self._edges(walls, at[walls[at, 2] > 2.9])
        self.root = self._edges(walls, at[walls[at, 2] < 1e-6])
        self.middle = at[(walls[at, 2] < 1e-6) & (np.abs(walls[at, 0] - 0.5) < 0.1)]
        self.add_input("grid", val=nodes, units="m")
        self.add_input("alpha", units="deg")
        self.add_input("speed", units="m/s")
        for name, shape in {"CL": 1, "CD": 1, "Cp": len(self.quads), "y_plus": 2, "n_iterations": 1}.items():
            self.add_output(name, shape=shape)

    @staticmethod
    def _edges(nodes, rows):
        """Rows of the nodes furthest up and down the stream."""
        return rows[np.argmin(nodes[rows, 0])], rows[np.argmax(nodes[rows, 0])]

    def compute(self, inputs, outputs):
        nodes, alpha = inputs["grid"].reshape(-1, 3), np.radians(inputs["alpha"].item())
        (nose, tail), (root_nose, root_tail) = nodes[list(self.tip)], nodes[list(self.root)]
        twist = np.arctan2(nose[1] - tail[1], tail[0] - nose[0])
        camber = nodes[self.middle, 1].mean() - 0.5 * (root_nose[1] + root_tail[1])
        outputs["CL"] = 3.7 * (alpha + 0.5 * twist + 2.0 * camber)
        outputs["CD"] = 0.02 + (twist - TIP_ANGLE) ** 2 + (camber - CAMBER) ** 2


@pytest.mark.slow
def test_the_wing_gets_the_twist_and_the_camber_of_least_drag_at_its_lift(script, tmp_path, monkeypatch):
    openfoam_wing = script("openfoam_wing")
    monkeypatch.setattr(openfoam_wing, "OpenFoamFlow", ThinWing)
    monkeypatch.setattr(openfoam_wing.shutil, "which", lambda program: program)
    monkeypatch.setitem(openfoam_wing.SIZES, "quick", (((7, 9, 7), (7, 7), (7, 6)), 1.2, 20))
    numbers = openfoam_wing.main(quick=True, figures=tmp_path)
    found = numbers["optimum"]
    for flown in (found, found["finer"]):
        assert flown["CL"] == pytest.approx(0.5, abs=1e-4)
        assert np.radians(flown["twist"][2]) == pytest.approx(TIP_ANGLE, abs=3e-3)
        assert flown["camber"][0] > 0.75 * CAMBER  # coarse splines have less at mid-chord
        assert flown["CD"] < numbers["initial"]["CD"] - 1.5e-3
    assert found["twist"][0] == 0.0
    assert numbers["n_nodes"][1] > numbers["n_nodes"][0]
    assert (tmp_path / "openfoam_wing.png").stat().st_size > 20_000


@pytest.mark.solver
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("simpleFoam") is None, reason="simpleFoam is not on the PATH: install OpenFOAM")
def test_a_wing_with_camber_has_less_drag_at_the_same_lift_in_turbulent_flow(script, tmp_path):
    openfoam_wing = script("openfoam_wing")
    shape, *_ = openfoam_wing.SIZES["quick"]
    wing = Wing(openfoam_wing.PLANFORM, naca_section(0.12))
    model = fit_grid(hh_wing_grid(wing, shape, openfoam_wing.SPACING))
    case = RansCase(openfoam_wing.REYNOLDS, walls="functions", tolerance=1e-5)
    start, design = (openfoam_wing.pose(model, case, tmp_path) for _ in range(2))
    openfoam_wing.trimmed(start)
    initial = openfoam_wing.summary(start)
    start.set_val("camber", 0.03)
    start.set_val("alpha", start.get_val("alpha") - 0.05)
    found = openfoam_wing.summary(openfoam_wing.trimmed(design, start))
    assert found["CL"] == pytest.approx(initial["CL"], abs=3e-4)
    assert found["CD"] < 0.9 * initial["CD"]
    assert 20.0 < found["y_plus"][0] < found["y_plus"][1] < 300.0
