"""An optimisation of a wing with one failure on the last rank: ``optimisation.py driver cases.sql``.

Every rank prints the optimum as JSON. All ranks take the same steps, and go on together after the failure.
"""

import json
import sys

import numpy as np
import openmdao.api as om
import pytest
from parametrization_cases import wing_model

from bspline_mdao import GridMovement, NLoptDriver
from bspline_mdao.base.numerics.processes import together, world
from bspline_mdao.design import Chord, Parametrization, ReferenceAxis, Twist
from bspline_mdao.measures import SurfaceArea, SurfaceGrid
from bspline_mdao.movers import LinearElasticity, moving_mesh

name, cases = sys.argv[1:]
comm = world()


class Distance(om.ExplicitComponent):
    """Squared distance of the surface from a target (m^2); fails once, on the last rank alone."""

    def initialize(self):
        self.options.declare("target")
        self.options.declare("n_good", desc="runs before the failure")

    def setup(self):
        self.add_input("surface", val=self.options["target"], units="m")
        self.add_output("distance")
        self.declare_partials("distance", "surface")
        self._n_good = self.options["n_good"]

    def compute(self, inputs, outputs):
        with together(self.comm):
            self._n_good -= comm.rank == comm.size - 1
            if self._n_good == -1:
                raise om.AnalysisError(f"run of rank {comm.rank} of {comm.size} failed")
        outputs["distance"] = np.sum((inputs["surface"] - self.options["target"]) ** 2)

    def compute_partials(self, inputs, partials):
        partials["distance", "surface"] = 2.0 * (inputs["surface"] - self.options["target"])


model = wing_model()
mesh = moving_mesh(model)
axis = ReferenceAxis.of(mesh)
variables = Parametrization(mesh, [Twist("twist", axis, stations=2), Chord("chord", axis, stations=2)])
surface = SurfaceGrid.of(model)
target = surface.points * [1.1, 1.0, 1.2] + np.linspace(0.0, 0.1, surface.n_points)[:, None] * [0.0, 0.0, 1.0]
problem = om.Problem(reports=None)
chain = GridMovement(
    model=model,
    parametrization=variables,
    mover=LinearElasticity(mesh, n_increments=1),
    measures=[SurfaceArea.of(surface, name="area")],
)
problem.model.add_subsystem("chain", chain, promotes=["*"])
problem.model.add_subsystem("distance_to", Distance(target=target.ravel(), n_good=4), promotes=["*"])
problem.model.add_design_var("twist", lower=-8.0, upper=8.0)
problem.model.add_design_var("chord", lower=0.8, upper=1.3)
problem.model.add_objective("distance", scaler=10.0)
problem.model.add_constraint("area", lower=1.05 * SurfaceArea.of(surface).evaluate(surface.points).item())
problem.model.add_constraint("corner_ks", lower=0.01)
if name == "scipy":
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-13, maxiter=60, disp=comm.rank == 0)
else:
    problem.driver = NLoptDriver(optimizer=name, ftol_abs=1e-13, ftol_rel=0.0, constraint_tolerance=1e-9, maxeval=200)
problem.driver.add_recorder(om.SqliteRecorder(cases, record_viewer_data=False))
problem.setup(mode="rev")
if name == "scipy":  # it has no way around a failure but to end
    with pytest.raises(om.AnalysisError, match=f"run of rank {comm.size - 1} of {comm.size} failed"):
        problem.run_driver()
result = problem.run_driver()
problem.cleanup()
numbers = {
    "success": bool(result.success),
    "runs": result.model_evals,
    "failed": getattr(problem.driver, "n_failed_analyses", 1),
    **{
        key: problem.get_val(key, get_remote=True).tolist()
        for key in ("twist", "chord", "distance", "area", "corner_ks")
    },
}
print(json.dumps(numbers))
