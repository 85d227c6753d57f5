"""The Euler flow of MPhys at a given lift, with a hinge moment."""

import openmdao.api as om
import pytest

pytest.importorskip("mphys")

from bspline_mdao import fit_grid
from bspline_mdao.flow import HingeMoment
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.mphys import EulerBuilder


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
