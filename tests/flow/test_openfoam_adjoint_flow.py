"""The component of OpenFOAM's flow with its adjoint: totals, what is solved for them, and what is refused."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import InputError, fit_grid
from bspline_mdao.flow import OpenFoamFlow
from bspline_mdao.flow.openfoam.flow_adjoint import CoefficientGradient, FlowAdjoint
from bspline_mdao.flow.openfoam.flow_run import CaseFlow
from bspline_mdao.flow.openfoam.inviscid import InviscidCase
from bspline_mdao.flow.openfoam.wall_loads import WallLoads
from bspline_mdao.generators import naca_section, section_o_grid


@dataclass(frozen=True)
class Incompressible(InviscidCase):
    """A case by its speed, with friction; it is never written here."""

    speed_name = "speed"
    is_viscous = True


class Solved:
    """Linear coefficients in place of a flow, with their gradients."""

    def __init__(self, monkeypatch, n_nodes, n_faces):
        rng = np.random.default_rng(2)
        self.adjoints, self.n_faces = [], n_faces
        self.slopes = {
            name: CoefficientGradient(rng.normal(size=(n_nodes, 3)), rng.normal())
            for name in ("CL", "CD", "CMx", "CMy", "CMz")
        }
        monkeypatch.setattr(CaseFlow, "solve", self.solve)
        monkeypatch.setattr(FlowAdjoint, "gradient", self.gradient)

    def solve(self, nodes, alpha, speed, is_kept=True):
        CL, CD, *CM = (np.sum(s.nodes * nodes) + s.alpha * alpha for s in self.slopes.values())
        loads = WallLoads(CL, CD, np.array(CM), np.zeros(self.n_faces), np.zeros((self.n_faces, 3)))
        return SimpleNamespace(
            loads=loads, y_plus=(0.0, 1.0), convergence=SimpleNamespace(n_iterations=1), seconds=0.0, doubts=[]
        )

    def gradient(self, name, alpha, speed, loads):
        self.adjoints.append((name, alpha, speed))
        return self.slopes[name]


def posed(monkeypatch, tmp_path, mode="rev", **options):
    model = fit_grid(section_o_grid(naca_section(0.12), n_around=16, far=5.0))
    flow = OpenFoamFlow(
        model=model,
        folder=tmp_path,
        case=Incompressible(),
        reference_area=1.0,
        derivatives="adjoint",
        iprint=0,
        **options,
    )
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup(mode=mode)
    problem.final_setup()
    solved = Solved(monkeypatch, problem.get_val("grid").size // 3, problem.get_val("Cp").size)
    problem.run_model()
    return problem, solved


def test_totals_are_the_gradients_of_the_coefficients(monkeypatch, tmp_path):
    problem, solved = posed(monkeypatch, tmp_path)
    totals = problem.compute_totals(of=["CL", "CD", "CM"], wrt=["grid", "alpha"])
    slopes = list(solved.slopes.values())
    found = np.concatenate([totals[name, "grid"] for name in ("CL", "CD", "CM")])
    assert np.allclose(found, [slope.nodes.ravel() for slope in slopes], rtol=1e-13)
    turns = np.concatenate([totals[name, "alpha"] for name in ("CL", "CD", "CM")]).ravel()
    assert np.allclose(turns, [np.radians(slope.alpha) for slope in slopes], rtol=1e-13)


def test_one_adjoint_is_solved_for_each_coefficient_that_is_asked_for(monkeypatch, tmp_path):
    problem, solved = posed(monkeypatch, tmp_path)
    for _ in range(2):
        problem.compute_totals(of=["CD"], wrt=["grid", "alpha"])
    assert [name for name, *_ in solved.adjoints] == ["CD"]
    assert solved.adjoints[0][1:] == (pytest.approx(np.radians(2.0)), 30.0)


def test_a_design_that_failed_leaves_no_solution_to_take_derivatives_of(monkeypatch, tmp_path):
    problem, solved = posed(monkeypatch, tmp_path)
    designs, solve = [], solved.solve

    def failing(nodes, alpha, speed, is_kept=True):
        designs.append(alpha)
        if alpha > 1.0:
            raise om.AnalysisError("diverged")
        return solve(nodes, alpha, speed)

    monkeypatch.setattr(CaseFlow, "solve", staticmethod(failing))
    problem.set_val("alpha", 80.0)
    with pytest.raises(om.AnalysisError):
        problem.run_model()
    problem.set_val("alpha", 2.0)
    problem.run_model()
    assert np.allclose(
        designs, np.radians([80.0, 2.0])
    )  # the folder has the flow of the first until it is solved again


def test_other_outputs_forward_mode_and_compressible_flows_are_refused(monkeypatch, tmp_path):
    problem, _ = posed(monkeypatch, tmp_path)
    with pytest.raises(InputError, match="derivatives of CL, CD and CM in reverse mode only"):
        problem.compute_totals(of=["y_plus"], wrt=["grid"])
    forward, _ = posed(monkeypatch, tmp_path, mode="fwd")
    with pytest.raises(InputError, match="in reverse mode only; set up the problem with mode='rev'"):
        forward.compute_totals(of=["CL"], wrt=["alpha"])
    model = fit_grid(section_o_grid(naca_section(0.12), n_around=16, far=5.0))
    flow = OpenFoamFlow(model=model, folder=tmp_path, reference_area=1.0, derivatives="adjoint")
    refused = om.Problem(reports=None)
    refused.model.add_subsystem("flow", flow)
    with pytest.raises(InputError, match="adjoint is for incompressible viscous flows only"):
        refused.setup()
