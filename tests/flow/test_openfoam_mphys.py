"""OpenFOAM in scenarios of MPhys, by a stand-in: each has a folder, and flows about the grid that was moved."""

import numpy as np
import openmdao.api as om
import pytest
from openfoam_stand_ins import PRESSURE_SOLVER, stand_in

from bspline_mdao import Grid, fit_grid
from bspline_mdao.grids.topology.grid import Block, Patch
from bspline_mdao.grids.topology.index_space import Window

pytest.importorskip("mphys", reason="MPhys is not installed")

from mphys import Multipoint
from mphys.scenarios import ScenarioAerodynamic

from bspline_mdao.mphys import OpenFoamBuilder


@pytest.mark.slow
def test_each_scenario_flows_in_its_folder_about_the_moved_grid(tmp_path, monkeypatch):
    stand_in(tmp_path / "bin", monkeypatch, "rhoSimpleFoam", PRESSURE_SOLVER)
    nodes = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 5)] * 3, indexing="ij"), axis=-1)
    patch = Patch("floor", "wall", (Window.whole(0, (5, 5, 5)).face(4),))
    model = fit_grid(Grid((Block(nodes, "box"),), (patch,)))
    builder = OpenFoamBuilder(model, tmp_path / "cases", reference_area=1.0, axes="xyz", iprint=0)

    class Study(Multipoint):
        def setup(self):
            builder.initialize(self.comm)
            self.add_subsystem("mesh", builder.get_mesh_coordinate_subsystem())
            for name in ("cruise", "climb"):
                self.mphys_add_scenario(name, ScenarioAerodynamic(aero_builder=builder))
                self.connect("mesh.x_aero0_mesh", f"{name}.x_aero")

    problem = om.Problem(Study(), reports=None)
    problem.setup()
    for name, alpha in (("cruise", 1.0), ("climb", 4.0)):
        problem.set_val(f"{name}.angle_of_attack", alpha, units="deg")
    problem.run_model()
    q = 0.7e5 * 0.3**2
    for name, alpha in (("cruise", 1.0), ("climb", 4.0)):
        lift = -1000.0 * (alpha - 3.0) ** 2 / q * np.cos(np.radians(alpha))
        assert problem.get_val(f"{name}.CL").item() == pytest.approx(lift, rel=1e-6)
        assert (tmp_path / "cases" / name / "solution" / "p").is_file()
