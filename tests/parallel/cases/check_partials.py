"""The first call of a user: check_partials of the chain, on every process."""

import warnings

import numpy as np
import openmdao.api as om

import bspline_mdao as bm
from bspline_mdao.base.numerics.processes import world

np.random.seed(1)  # noqa: NPY002 - where OpenMDAO draws the directions of checks: products may be small along some
model = bm.fit_grid(bm.generators.flat_plate_grid((5, 6, 5)), n_control=(4, 5, 4))
problem = om.Problem()
problem.model.add_subsystem("chain", bm.GridMovement(model=model, fit=False), promotes=["*"])
problem.setup()
points = problem.get_val("surface_control_points").reshape(-1, 3)
problem.set_val("surface_control_points", (points * (1.03, 1.05, 1.0)).ravel())
problem.run_model()
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    found = problem.check_partials(out_stream=None)

assert found.pop("chain.quality") == {}
left_out = [str(one.message) for one in caught if "check on one process" in str(one.message)]
assert len(left_out) == (1 if world().rank == 0 else 0), left_out
assert {path: len(pairs) for path, pairs in found.items()} == {"chain.move": 4, "chain.evaluate": 1}
for pairs in found.values():
    for pair, data in pairs.items():
        forward, dot = data["magnitude"].forward, data["abs error"].fwd_rev
        assert forward > (1e-4 if pair[0] == "control_corner_ks" else 1e-3), pair
        assert dot < 1e-12 * max(1.0, forward), (pair, dot)
        assert data["abs error"].forward < 1e-6 * forward, (pair, data["abs error"])
print("checked")
