"""The Euler flow and a beam in a scenario of MPhys: loads, displacements, totals, wiring."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import InputError, fit_grid
from bspline_mdao.design import Parametrization, ReferenceAxis, Twist
from bspline_mdao.flow.loads.rigid_links import RigidLinks
from bspline_mdao.flow.om.aerostructure import Spar
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import moving_mesh

mphys = pytest.importorskip("mphys", reason="MPhys is not installed")
pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")

from mphys.scenarios import ScenarioAerodynamic, ScenarioAeroStructural  # noqa: E402

from bspline_mdao.core.om.mphys.geometry import SurfaceGeometry  # noqa: E402
from bspline_mdao.flow.om.mphys.beam import Beam, BeamBuilder  # noqa: E402
from bspline_mdao.flow.om.mphys.builders import EulerBuilder, FlowBuilder  # noqa: E402
from bspline_mdao.flow.om.mphys.rigid_links import RigidLinkBuilder  # noqa: E402

BEAM = np.linspace([0.95, 0.0, 1.4843], [0.3, 0.0, 0.0], 5)
SPAR = Spar((0.004, 0.006))
CONDITIONS = {"angle_of_attack": 3.0, "mach_number": 0.3, "dynamic_pressure": 2e4}


@cache
def wing():
    return fit_grid(onera_m6_grid((7, 6, 5)))


def euler(scenario="aerostructural"):
    return EulerBuilder(wing(), scenario=scenario, reference_area=0.75, iprint=0)


class Study(mphys.Multipoint):
    """A flexible wing with twist."""

    def initialize(self):
        self.options.declare("aero", recordable=False)

    def setup(self):
        aero, beam, mesh = self.options["aero"], BeamBuilder(BEAM, SPAR, (0.03, 0.04)), moving_mesh(wing())
        twist = Twist("twist", ReferenceAxis.of(mesh), stations=2)
        geometry = SurfaceGeometry(model=wing(), parametrization=Parametrization(mesh, [twist]))
        links = RigidLinks.to_beam(SurfaceGrid.of(wing()).points, BEAM, along=[0.0, 0.0, 1.0])
        self.add_subsystem("mesh", aero.get_mesh_coordinate_subsystem())
        self.add_subsystem("beam_mesh", beam.get_mesh_coordinate_subsystem())
        self.add_subsystem("geometry", geometry, promotes_inputs=["twist"])
        builders = {"aero_builder": aero, "struct_builder": beam, "ldxfer_builder": RigidLinkBuilder(links)}
        solvers = [kind(maxiter=30, atol=1e-10, rtol=1e-11, use_aitken=True, iprint=-1) for kind in SOLVERS]
        self.mphys_add_scenario("cruise", ScenarioAeroStructural(**builders), *solvers)
        self.connect("mesh.x_aero0_mesh", "geometry.x_aero0_geometry_input")
        self.connect("geometry.x_aero0_geometry_output", "cruise.x_aero0")
        self.connect("beam_mesh.x_struct0_mesh", "cruise.x_struct0")


SOLVERS = om.NonlinearBlockGS, om.LinearBlockGS


def flown(aero, **conditions):
    problem = om.Problem(Study(aero=aero), reports=False)
    problem.setup(mode="rev")
    for name, value in conditions.items():
        problem.set_val(f"cruise.{name}", value)
    problem.set_val("twist", [0.0, 1.0])
    problem.run_model()
    return problem


@pytest.fixture(scope="module")
def coupled():
    return flown(euler(), **CONDITIONS)


@pytest.mark.slow
def test_the_wing_bends_up_and_the_beam_carries_what_the_flow_presses(coupled):
    names = "x_aero0", "u_aero", "f_aero", "x_aero"
    jig, displacements, forces, nodes = (coupled.get_val(f"cruise.{name}").reshape(-1, 3) for name in names)
    loads = coupled.get_val("cruise.f_aero_struct").reshape(-1, 6)
    np.testing.assert_allclose(nodes, jig + displacements, atol=1e-15)
    np.testing.assert_allclose(loads[:, :3].sum(axis=0), forces.sum(axis=0), rtol=1e-9)
    work = np.sum(loads * coupled.get_val("cruise.u_struct").reshape(-1, 6))
    assert np.sum(forces * displacements) == pytest.approx(work, rel=1e-7)
    assert 0.02 < displacements[:, 1].max() < 0.2
    np.testing.assert_array_equal(displacements[jig[:, 2] == 0.0], 0.0)  # the root is clamped
    drag = forces.sum(axis=0) @ [np.cos(np.radians(3.0)), np.sin(np.radians(3.0)), 0.0]
    assert drag == pytest.approx(2e4 * 0.75 * coupled.get_val("cruise.CD").item(), rel=1e-7)


@pytest.mark.slow
def test_totals_of_the_coupled_wing_are_those_of_differences(coupled):
    of = ["cruise.CL", "cruise.CD", "cruise.failure"]
    steps = {"twist": 0.1, "cruise.spar_thickness": 4e-5}  # far above the noise of the coupled states
    totals, along, found = coupled.compute_totals(of, list(steps)), np.array([1.0, -0.6]), []
    starts = {name: coupled.get_val(name).copy() for name in steps}
    for h in (1.0, -1.0, 0.5, -0.5):
        for name, step in steps.items():
            coupled.set_val(name, starts[name] + h * step * along)
        coupled.run_model()
        found.append(np.concatenate([coupled.get_val(output).ravel() for output in of]))
    for name, start in starts.items():
        coupled.set_val(name, start)
    exact = (4.0 * (found[2] - found[3]) - 0.5 * (found[0] - found[1])) / 3.0
    parts = np.array([step * np.concatenate([totals[o, name] @ along for o in of]) for name, step in steps.items()])
    np.testing.assert_allclose(parts.sum(axis=0), exact, rtol=2e-6)
    assert (np.abs(parts) > 0.01 * np.abs(exact)).all()  # an error of either would be seen


def test_a_grid_that_is_moved_before_the_coupling_is_refused():
    with pytest.raises(InputError, match=r"'x_aero' comes from .*, which runs later; .*aerostructural") as error:
        flown(euler("aerodynamic"))
    assert "\n" not in str(error.value)


def test_loads_without_a_dynamic_pressure_are_refused():
    with pytest.raises(InputError, match="dynamic_pressure is nan; give the free stream's"):
        flown(euler())


def test_a_flow_without_forces_is_refused():
    builder = FlowBuilder(wing(), om.Group, results={}, scenario="aerostructural")
    with pytest.raises(
        InputError, match="the flow has no output 'wall_forces', which an aerostructural scenario needs"
    ):
        om.Problem(builder.get_coupling_group_subsystem(), reports=False).setup()


def test_scenarios_that_do_not_exist_are_refused():
    with pytest.raises(InputError, match="EulerBuilder: there is no scenario 'aeroelastic'; give one of"):
        euler("aeroelastic")


def test_beams_of_one_node_are_refused():
    with pytest.raises(InputError, match="beam: give two nodes at least, from the tip to the root"):
        BeamBuilder(BEAM[:1], SPAR, (0.03,))


def test_a_cantilever_bends_as_a_bernoulli_beam():
    """A force at the tip of a straight tube: F L^3 / (3 E I), to the shear that the beam leaves out."""
    nodes, thickness, radius, length = np.linspace([0.0, 0.0, 2.0], [0.0, 0.0, 0.0], 9), 0.002, 0.05, 2.0
    problem = om.Problem(Beam(nodes=nodes, spar=Spar((thickness,) * 4), radius=(radius,) * 4), reports=False)
    problem.setup()
    loads = np.zeros((9, 6))
    loads[0, 1] = 100.0
    problem.set_val("f_aero_struct", loads.ravel())
    problem.run_model()
    inertia = 0.25 * np.pi * (radius**4 - (radius - thickness) ** 4)
    tip = problem.get_val("u_struct").reshape(-1, 6)[0]
    assert tip[1] == pytest.approx(100.0 * length**3 / (3.0 * 70e9 * inertia), rel=1e-6)
    area = np.pi * (radius**2 - (radius - thickness) ** 2)
    assert problem.get_val("structural_mass") == pytest.approx(2.0 * 2.0 * area * length * 2800.0, rel=1e-10)


@pytest.mark.slow
def test_an_aerostructural_builder_flies_an_aerodynamic_scenario_too():
    class Rigid(mphys.Multipoint):
        def setup(self):
            aero = euler()
            self.add_subsystem("mesh", aero.get_mesh_coordinate_subsystem())
            self.mphys_add_scenario("cruise", ScenarioAerodynamic(aero_builder=aero))
            self.connect("mesh.x_aero0_mesh", "cruise.x_aero")

    problem = om.Problem(Rigid(), reports=False)
    problem.setup()
    for name, value in CONDITIONS.items():
        problem.set_val(f"cruise.{name}", value)
    problem.run_model()
    assert problem.get_val("cruise.f_aero").reshape(-1, 3).sum(axis=0)[1] > 0.0
