"""Step 5: is it an optimum? The derivatives, the first-order conditions, and the design on a finer grid."""

import openmdao.api as om
from optimise import pose, row

import bspline_mdao as bm
from bspline_mdao.testing import check_totals, perturb_design

model = bm.FittedModel.load("wing.h5")
problem = pose(model)
optimum = om.CaseReader("wing.sql").get_case(-1).get_val("twist", units="deg")
problem.set_val("twist", optimum, units="deg")
problem.run_model()
gradient, violation = bm.optimality_of(problem)
print(f"at the optimum: gradient {gradient:.0e}, violation {violation:.0e} (scaled)")

check = check_totals(perturb_design(problem), n_directions=1, step=0.05, levels=2)
print(f"near it: differences agree with the adjoint to {check.differences:.0e}")

finer = pose(model.member(1.5))
print(f"on {finer.get_val('grid').size // 3:,} nodes instead of {model.n_nodes:,}:")
row("before", finer)
finer.set_val("twist", optimum, units="deg")
finer.run_model()
row("after", finer)
