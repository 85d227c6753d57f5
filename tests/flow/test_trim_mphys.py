"""The Euler flow of MPhys at a given lift, with hinge moments."""

import numpy as np
import openmdao.api as om
import pytest

pytest.importorskip("mphys")

from mphys import Multipoint
from mphys_cases import ScenarioAerodynamic

from bspline_mdao import DesignSurface, fit_grid
from bspline_mdao.design import Hinge, HingePoints, Rotation
from bspline_mdao.flow import HingeMoment
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.mphys import EulerBuilder, SurfaceGeometry


@pytest.mark.slow
def test_flow_of_a_scenario_takes_a_lift_and_gives_angle_and_hinge_moment():
    model = fit_grid(onera_m6_grid((5, 5, 5)))
    hinges = [HingeMoment("flap", chord=(0.6, 1.0))]
    builder = EulerBuilder(model, reference_area=1.16, trim=True, hinges=hinges, iprint=0)
    problem = om.Problem(reports=False)
    builder.initialize(problem.comm)
    problem.model.add_subsystem("aero", builder.get_coupling_group_subsystem(), promotes=["*"])
    problem.setup(mode="rev")
    problem.set_val("aero_vol_coords", model.regenerate().to_vector())
    problem.set_val("CL_target", 0.15)
    problem.run_model()
    assert problem.get_val("CL").item() == pytest.approx(0.15, abs=1e-9)
    assert 1.0 < problem.get_val("alpha", units="deg").item() < 5.0
    totals = problem.compute_totals(["CM_flap", "CM_bending", "CL"], ["CL_target"])
    assert totals["CL", "CL_target"].item() == pytest.approx(1.0, rel=1e-10)
    assert totals["CM_flap", "CL_target"].item() < 0.0 < totals["CM_bending", "CL_target"].item()


class Cruise(Multipoint):
    """A wing with a flap, whose hinge goes from the geometry to the flow."""

    def initialize(self):
        self.options.declare("builder", recordable=False)
        self.options.declare("geometry", recordable=False)

    def setup(self):
        builder = self.options["builder"]
        builder.initialize(self.comm)
        self.add_subsystem("mesh", builder.get_mesh_coordinate_subsystem())
        self.add_subsystem("geometry", self.options["geometry"], promotes_inputs=["line", "flap"])
        self.mphys_add_scenario("cruise", ScenarioAerodynamic(aero_builder=builder))
        self.connect("mesh.x_aero0_mesh", "geometry.x_aero0_geometry_input")
        self.connect("geometry.x_aero0_geometry_output", "cruise.x_aero")
        self.connect("geometry.flap_hinge", "cruise.flap_hinge")


@pytest.mark.slow
def test_a_scenario_takes_the_hinge_from_the_geometry():
    model = fit_grid(onera_m6_grid((7, 5, 5)))
    wing, hinge = DesignSurface.of(model), Hinge((0.7, 0.0, 0.3), (0.95, 0.0, 1.0), name="flap_hinge")
    shape = wing.parametrization([HingePoints("line", hinge, "xy"), Rotation("flap", hinge, blend=0.2)])
    moment = HingeMoment("flap", chord=(0.65, 1.0), axis=hinge)
    builder = EulerBuilder(model, reference_area=1.16, hinges=[moment], generation=2, iprint=0)
    geometry = SurfaceGeometry(model=model, parametrization=shape, generation=2)
    problem = om.Problem(Cruise(builder=builder, geometry=geometry), reports=False)
    problem.setup(mode="rev")
    step, direction = 2e-3, np.array([0.3, -1.0, 0.5, 0.8])
    found = {}
    for k in (-1, 1, 0):
        problem.set_val("line", k * step * direction)
        problem.run_model()
        found[k] = problem.get_val("cruise.CM_flap").item()
    np.testing.assert_allclose(problem.get_val("cruise.flap_hinge"), hinge.points.ravel(), atol=1e-14)
    totals = problem.compute_totals(["cruise.CM_flap"], ["line"])["cruise.CM_flap", "line"].ravel()
    assert totals @ direction == pytest.approx((found[1] - found[-1]) / (2.0 * step), rel=1e-4)
    assert abs(totals @ direction) > 1e-3
