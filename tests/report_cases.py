"""An optimisation of few evaluations and its case file, for tests of what is made of it."""

import openmdao.api as om

from bspline_mdao import EulerFlow, GridMovement, fit_grid
from bspline_mdao.design import Parametrization, ReferenceAxis, Twist
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.studio.report.contents import INCLUDES


def small_model():
    return fit_grid(onera_m6_grid((5, 5, 5)))


def twisted_wing(model, reports=None, name=None):
    """Two steps of SciPy's SLSQP on the twist of a wing in a coarse flow; set up, not run."""
    mesh = moving_mesh(model)
    variables = Parametrization(mesh, [Twist("twist", ReferenceAxis.of(mesh), stations=2)])
    driver = om.ScipyOptimizeDriver(optimizer="SLSQP", maxiter=2, disp=False)
    problem = om.Problem(driver=driver, reports=reports, name=name)
    shape = GridMovement(model=model, parametrization=variables, quality=["corner_ks"])
    problem.model.add_subsystem("shape", shape, promotes=["*"])
    flow = EulerFlow(model=model, reference_area=1.16, tolerance=1e-8, iprint=-1)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.add_design_var("twist", lower=[-6.0, -3.0], upper=6.0, units="deg")
    problem.model.add_objective("CD_induced", scaler=100.0)
    problem.model.add_constraint("CL", equals=0.25)
    problem.model.add_constraint("corner_ks", lower=0.05)
    problem.setup(mode="fwd")
    return problem


def recorded_wing(folder, model, includes=INCLUDES, record_derivatives=True):
    """Run `twisted_wing` and return its case file."""
    problem, file = twisted_wing(model), folder / "wing.sql"
    problem.driver.add_recorder(om.SqliteRecorder(file))
    problem.driver.recording_options["includes"] = list(includes)
    problem.driver.recording_options["record_derivatives"] = record_derivatives
    problem.run_driver()
    problem.cleanup()
    return file
