"""A recorded optimisation, whose history every rank has."""

import json

import openmdao.api as om

from bspline_mdao.drivers import recorded, scipy_slsqp

problem = om.Problem(reports=None, driver=scipy_slsqp(1e-8, 20))
problem.model.add_subsystem("bowl", om.ExecComp("f = (x - 3) ** 2"), promotes=["*"])
problem.model.add_design_var("x", lower=-5.0, upper=5.0)
problem.model.add_objective("f")
with recorded(problem) as run:
    problem.run_driver()
print(json.dumps({"f": run.history["f"].tolist(), "residuals": run.convergence.residuals.tolist()}))
