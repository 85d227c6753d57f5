"""Combinations of variables change a response evenly, and are variables of an optimisation."""

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import DesignSurface, EulerFlow, InputError, fit_grid
from bspline_mdao.design import Twist
from bspline_mdao.drivers import combine, even_combinations, even_pressures
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.cell_faces import CellFaces
from bspline_mdao.grids.cells.quads import area_vectors


def test_all_combinations_change_the_response_by_one_along_orthogonal_vectors():
    derivative = np.random.default_rng(5).normal(size=(7, 4)) * [1.0, 0.3, 2.0, 0.1]
    changes = derivative @ even_combinations(derivative, least=0.0)
    np.testing.assert_allclose(changes.T @ changes, np.eye(4), atol=1e-13)


def test_combinations_that_hardly_matter_stay_bounded():
    derivative = np.diag([2.0, 1.0, 1e-9])
    np.testing.assert_allclose(np.abs(even_combinations(derivative, least=0.1)), np.diag([0.5, 1.0, 5.0]))


def test_a_derivative_that_scales_nothing_is_refused():
    for derivative in (np.zeros((3, 2)), np.ones(3), np.array([[np.nan, 1.0]])):
        with pytest.raises(InputError, match="give a finite matrix that is not zero"):
            even_combinations(derivative)


def test_the_variable_is_the_sum_of_its_combinations_in_both_modes():
    columns = np.random.default_rng(6).normal(size=(5, 3))
    for mode in ("fwd", "rev"):
        problem = om.Problem(reports=None)
        problem.model.add_subsystem("combine", combine("heights", columns, units="m"), promotes=["*"])
        problem.setup(mode=mode)
        problem.set_val("combinations", [1.0, -2.0, 0.5])
        problem.run_model()
        np.testing.assert_allclose(problem.get_val("heights", units="cm"), 100.0 * columns @ [1.0, -2.0, 0.5])
        totals = problem.compute_totals(["heights"], ["combinations"])
        np.testing.assert_allclose(totals["heights", "combinations"], columns, rtol=1e-12)


def test_pressures_change_evenly_along_the_combinations():
    """A stand-in for flows: pressures that are linear in the values, on the walls of a fitted wing."""
    rng, model = np.random.default_rng(7), fit_grid(onera_m6_grid((5, 5, 5)))
    nodes = model.regenerate().to_vector()
    faces = CellFaces.of(model.topology, nodes.reshape(-1, 3))
    walls = nodes.reshape(-1, 3)[faces.corners_of("wall")]
    first, second = rng.normal(size=(2, len(walls), 3)) * [1.0, 20.0, 2.0]
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("grid", om.IndepVarComp("grid", nodes), promotes=["*"])
    for name, columns in {"slow": first, "fast": second}.items():
        flow = om.ExecComp("Cp = dot(columns, heights)", columns=columns, heights=np.zeros(3), Cp=np.zeros(len(walls)))
        problem.model.add_subsystem(name, flow, promotes_inputs=["heights"])
    columns = even_pressures(problem, model, "heights", ["slow.Cp", "fast.Cp"])
    areas = np.linalg.norm(area_vectors(walls), axis=1)
    changes = [response @ columns for response in (first, second)]
    means = np.mean([np.einsum("fc,f,fd->cd", each, areas / areas.sum(), each) for each in changes], axis=0)
    np.testing.assert_allclose(means, np.eye(3), atol=1e-12)


@pytest.mark.slow
def test_scales_of_flows_are_taken_from_rough_solves_without_warnings_of_the_mode(recwarn):
    wing = DesignSurface.of(fit_grid(onera_m6_grid((5, 5, 5))))
    values, tolerances = [], []
    for tolerance in (1e-6, None):
        problem = om.Problem(reports=None)
        shape = wing.grid_movement([Twist("twist", wing.axis, stations=3)])
        problem.model.add_subsystem("shape", shape, promotes=["*"])
        flow = EulerFlow(model=wing.model, reference_area=wing.planform_area, iprint=-1)
        problem.model.add_subsystem("flow", flow, promotes=["*"])
        problem.model.add_design_var("twist")
        problem.model.add_objective("CL")
        values.append(even_pressures(problem, wing.model, "twist", linear_tolerance=tolerance))
        tolerances.append(problem.model.flow.state.options["linear_tolerance"])
    assert tolerances == [1e-6, 1e-14]
    np.testing.assert_allclose(*values, rtol=1e-4)
    told = [str(each.message) for each in recwarn]
    assert not [text for text in told if "linear solves of the flow" in text or "Inefficient choice" in text]
