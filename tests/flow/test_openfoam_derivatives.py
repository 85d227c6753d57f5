"""Derivatives of a flow by OpenFOAM's adjoint, with the solver where it is on the PATH."""

import shutil

import numpy as np
import pytest

from bspline_mdao import fit_grid
from bspline_mdao.flow.openfoam.case_folder import CaseFolder
from bspline_mdao.flow.openfoam.case_mesh import CaseMesh
from bspline_mdao.flow.openfoam.flow_adjoint import FlowAdjoint
from bspline_mdao.flow.openfoam.flow_run import CaseFlow
from bspline_mdao.flow.openfoam.rans_case import RansCase
from bspline_mdao.generators import naca_section, section_o_grid


class Laminar(RansCase):
    """The same solver without turbulence."""

    def files(self, stream):
        fields, settings = super().files(stream)
        settings["constant/turbulenceProperties"] = "simulationType laminar;"
        return {name: fields[name] for name in ("U", "p")}, settings


@pytest.mark.solver
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("adjointOptimisationFoam") is None, reason="OpenFOAM is not on the PATH")
def test_derivatives_of_lift_by_camber_and_angle_are_near_differences(tmp_path):
    model = fit_grid(section_o_grid(naca_section(0.12), n_around=64, far=8.0))
    axes, references = np.eye(3)[[0, 2, 1]], (1.0, 1.0, (0.25, 0.0, 0.0))
    case = Laminar(100.0, planes="empty", tolerance=1e-6)
    flow = CaseFlow(case, CaseMesh.of(model), CaseFolder(tmp_path), axes, references)
    nodes = flow.mesh.baseline
    x, y, _ = nodes.T
    camber = np.zeros(nodes.shape)
    camber[:, 1] = np.maximum(4.0 * x * (1.0 - x), 0.0) ** 2 * np.exp(-(y**2))
    found = FlowAdjoint.of(flow).gradient("CL", 0.05, 1.0, flow.solve(nodes, 0.05, 1.0).loads)

    def lift(shift, turn):
        return flow.solve(nodes + shift * camber, 0.05 + turn, 1.0, is_kept=False).loads.CL

    step = 2e-3
    assert np.sum(found.nodes * camber) == pytest.approx((lift(step, 0.0) - lift(-step, 0.0)) / (2.0 * step), rel=0.15)
    assert found.alpha == pytest.approx((lift(0.0, step) - lift(0.0, -step)) / (2.0 * step), rel=0.05)
