"""A flexible wing in Euler flow on several ranks: lift, bending, loads and a total are those of one."""

import numpy as np
import openmdao.api as om
from mphys import Multipoint
from mphys.scenarios import ScenarioAeroStructural
from mpi4py import MPI

from bspline_mdao import fit_grid
from bspline_mdao.base.numerics.processes import world
from bspline_mdao.design import Parametrization, ReferenceAxis, Twist
from bspline_mdao.flow import RigidLinks
from bspline_mdao.flow.om.aerostructure import Spar
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.mphys import BeamBuilder, EulerBuilder, RigidLinkBuilder, SurfaceGeometry

comm, model = world(), fit_grid(onera_m6_grid((7, 6, 5)))
BEAM = np.linspace([0.95, 0.0, 1.4], [0.3, 0.0, 0.0], 5)


class Study(Multipoint):
    """The wing with twist, its beam inside it."""

    def setup(self):
        aero = EulerBuilder(model, scenario="aerostructural", reference_area=0.75, iprint=0)
        beam, mesh = BeamBuilder(BEAM, Spar((0.004, 0.006)), (0.03, 0.04)), moving_mesh(model)
        links = RigidLinkBuilder(RigidLinks.to_beam(SurfaceGrid.of(model).points, BEAM, along=[0.0, 0.0, 1.0]))
        variables = Parametrization(mesh, [Twist("twist", ReferenceAxis.of(mesh), stations=2)])
        geometry = SurfaceGeometry(model=model, parametrization=variables, point_sets={"x_struct0": BEAM})
        for builder in (aero, beam, links):
            builder.initialize(self.comm)
        self.add_subsystem("mesh", aero.get_mesh_coordinate_subsystem())
        self.add_subsystem("beam_mesh", beam.get_mesh_coordinate_subsystem())
        self.add_subsystem("geometry", geometry, promotes_inputs=["twist"])
        scenario = ScenarioAeroStructural(aero_builder=aero, struct_builder=beam, ldxfer_builder=links)
        settings = {"rtol": 1e-11, "atol": 1e-11, "use_aitken": True, "iprint": -1}
        solvers = om.NonlinearBlockGS(maxiter=30, **settings), om.LinearBlockGS(maxiter=8, **settings)
        self.mphys_add_scenario("cruise", scenario, *solvers)
        self.connect("mesh.x_aero0_mesh", "geometry.x_aero0_geometry_input")
        self.connect("geometry.x_aero0_geometry_output", "cruise.x_aero0")
        self.connect("beam_mesh.x_struct0_mesh", "geometry.x_struct0_geometry_input")
        self.connect("geometry.x_struct0_geometry_output", "cruise.x_struct0")


def flown(comm):
    problem = om.Problem(Study(), reports=False, comm=comm)
    problem.setup(mode="rev")
    for name, value in {"angle_of_attack": 3.0, "mach_number": 0.3, "dynamic_pressure": 2e4}.items():
        problem.set_val(f"cruise.{name}", value)
    problem.set_val("twist", [0.0, 1.0])
    problem.run_model()
    values = [problem.get_val(name) for name in ("cruise.CL", "cruise.failure", "cruise.u_struct")]
    return values, [problem.compute_totals(["cruise.CL"], ["twist"])["cruise.CL", "twist"]]


for found, expected, close in zip(flown(comm), flown(MPI.COMM_SELF), (1e-8, 1e-6)):
    for here, alone in zip(found, expected):
        np.testing.assert_allclose(here, alone, rtol=0, atol=close * np.abs(alone).max())
