"""Hinge moments about axes that design variables move: values, derivatives, and totals of a flow."""

import numpy as np
import openmdao.api as om
import pytest
from scipy.sparse import csr_array
from test_section_loads import FIXED, forces_of, on_faces, wing

from bspline_mdao import DesignSurface, EulerFlow, InputError
from bspline_mdao.design import Hinge, HingePoints, Rotation, Span
from bspline_mdao.flow import HingeMoment
from bspline_mdao.flow.loads.axis_moments import AxisMoment, HingeLoads, hinge_moment, hinge_moment_rates
from bspline_mdao.flow.om.moved_hinge import MovedHingeMoment

STEP = 1e-40
HINGE = Hinge((0.7, 0.0, 0.3), (0.95, 0.0, 1.0), name="flap_hinge")
MOMENT = HingeMoment("flap", chord=(0.65, 1.0), span=(0.2, 0.9), axis=HINGE, reference_chord=0.2)


def test_loads_give_the_moment_about_any_axis():
    forces, nodes = forces_of()
    loads, _ = on_faces(forces, nodes)
    fixed, axis = forces.wing.moments["CM_fixed"], np.array(FIXED.axis)
    made = HingeLoads("loads", fixed.points, fixed.weights, np.array([3.0, -1.0, 0.5]))
    found = hinge_moment(made.evaluate(loads, nodes, 0.0)["loads"], axis, made.origin) / fixed.volume
    assert found == pytest.approx(forces.wing.evaluate(loads, nodes, 0.0)["CM_fixed"], rel=1e-12)


def test_derivatives_of_loads_and_of_the_moment_are_exact_and_transposed():
    random = np.random.default_rng(2)
    points = csr_array(random.uniform(size=(5, 8)))
    made = HingeLoads("loads", points, random.uniform(size=5), np.array([0.3, 0.1, -0.2]))
    at, along = random.normal(size=(5, 3)), random.normal(size=(5, 3))
    nodes, d_nodes = random.normal(size=(2, 8, 3))
    exact = made.evaluate(at + 1j * STEP * along, nodes + 1j * STEP * d_nodes, 0.0)["loads"].imag / STEP
    found = made.jvp(at, nodes, 0.0, along, d_nodes, 0.0)["loads"]
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-13 * np.abs(exact).max())
    bar = random.normal(size=6)
    forces_bar, nodes_bar, _ = made.vjp(at, nodes, 0.0, {"loads": bar})
    assert np.vdot(forces_bar, along) + np.vdot(nodes_bar, d_nodes) == pytest.approx(bar @ found, rel=1e-12)
    loads, d_loads, axis, d_axis = *random.normal(size=(2, 6)), *random.normal(size=(2, 2, 3))
    of_loads, of_axis = hinge_moment_rates(loads, axis, made.origin)
    stepped = hinge_moment(loads + 1j * STEP * d_loads, axis + 1j * STEP * d_axis, made.origin)
    assert of_loads @ d_loads + np.vdot(of_axis, d_axis) == pytest.approx(stepped.imag / STEP, rel=1e-13)


def test_partials_of_the_component_are_those_of_complex_steps():
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("moment", MovedHingeMoment(hinge=MOMENT, volume=0.3), promotes=["*"])
    problem.setup(force_alloc_complex=True)
    problem.set_val("loads_flap", np.random.default_rng(0).normal(size=6))
    problem.run_model()
    (found,) = problem.check_partials(method="cs", out_stream=None).values()
    for each in found.values():
        assert each["abs error"].forward < 1e-13


def problem_of(*variables, hinges=(MOMENT,)):
    """A flap of the small M6 in the Euler flow."""
    surface = DesignSurface.of(wing())
    shape = surface.parametrization(variables)
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("move", surface.grid_movement(list(shape.variables), fit=False), promotes=["*"])
    flow = EulerFlow(model=wing(), reference_area=1.16, hinges=list(hinges), iprint=0)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup(mode="rev")
    problem.set_val("Mach_number", 0.4)
    problem.set_val("alpha", 3.0, units="deg")
    return problem


@pytest.mark.slow
def test_totals_of_a_hinge_moment_are_differences_in_the_angle_and_in_the_place_of_the_hinge():
    line = HingePoints("line", HINGE, "xy")
    problem = problem_of(line, Rotation("flap", HINGE, blend=0.2))
    at = {"line": np.array([0.01, -0.02, 0.015, 0.01]), "flap": np.array([6.0])}

    def moment(**values):
        for name, value in {**at, **values}.items():
            problem.set_val(name, value)
        problem.run_model()
        return problem.get_val("CM_flap").item()

    moment()
    np.testing.assert_allclose(
        problem.get_val("flap_hinge").reshape(2, 3), HINGE.points + [[0.01, -0.02, 0], [0.015, 0.01, 0]], atol=1e-14
    )
    totals = problem.compute_totals(["CM_flap"], ["flap", "line", "alpha"])
    for name, direction, step in (("flap", [1.0], 0.05), ("line", [0.3, -1.0, 0.5, 0.8], 2e-3)):
        sides = {k: moment(**{name: at[name] + k * step * np.array(direction)}) for k in (-2, -1, 1, 2)}
        difference = (8.0 * (sides[1] - sides[-1]) - (sides[2] - sides[-2])) / (12.0 * step)
        assert abs(difference) > 1e-4
        assert totals["CM_flap", name].ravel() @ direction == pytest.approx(difference, rel=1e-7)


@pytest.mark.slow
def test_a_hinge_that_goes_along_with_the_wing_gives_the_moment_about_where_it_is():
    surface = DesignSurface.of(wing())
    problem = problem_of(Span("span", surface.axis), Rotation("flap", HINGE, blend=0.2))
    problem.set_val("span", 1.2)
    problem.set_val("flap", -4.0)
    problem.run_model()
    moved = problem.get_val("flap_hinge").reshape(2, 3)
    np.testing.assert_allclose(moved, HINGE.points * [1.0, 1.0, 1.2], atol=1e-12)
    at_rest = HingeMoment("rest", chord=MOMENT.chord, span=MOMENT.span, axis=moved.tolist(), reference_chord=0.2)
    flow = om.Problem(EulerFlow(model=wing(), reference_area=1.16, hinges=[at_rest], iprint=0), reports=None)
    flow.setup()
    flow.set_val("Mach_number", 0.4)
    flow.set_val("alpha", 3.0, units="deg")
    flow.set_val("grid", problem.get_val("grid"))
    flow.run_model()
    assert problem.get_val("CM_flap").item() == pytest.approx(flow.get_val("CM_rest").item(), rel=1e-9)


def test_what_cannot_be_the_axis_of_a_hinge_moment_is_refused():
    with pytest.raises(InputError, match="hinge flap: its axis is a Hinge without a name; give it one"):
        HingeMoment("flap", axis=Hinge((0, 0, 0), (0, 0, 1)))
    with pytest.raises(InputError, match="hinge: the name 'my flap'; give one of letters"):
        Hinge((0, 0, 0), (0, 0, 1), name="my flap")
    surface = DesignSurface.of(wing())
    with pytest.raises(InputError, match="a hinge is called 'flap_hinge', as something else is; choose another"):
        surface.parametrization([Rotation("flap_hinge", HINGE)])
    again = Hinge((0.1, 0, 0), (0.1, 0, 1), name="flap_hinge")
    with pytest.raises(InputError, match="a hinge is called 'flap_hinge', as something else is"):
        surface.parametrization([Rotation("flap", HINGE), Rotation("tab", again)])


def test_a_fixed_axis_is_still_one_moment():
    forces, _ = forces_of()
    assert isinstance(forces.wing.moments["CM_fixed"], AxisMoment)
    assert forces.wing.hinge_loads == ()
