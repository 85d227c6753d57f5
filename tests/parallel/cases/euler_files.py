"""Files of a flow on several ranks: those that one process reads, and the other way round."""

import sys
from pathlib import Path

import numpy as np
import openmdao.api as om
from mpi4py import MPI
from parallel_checks import raised_everywhere

from bspline_mdao import EulerFlow, GridEvaluate, InputError, fit_grid
from bspline_mdao.flow import HingeMoment
from bspline_mdao.generators import onera_m6_grid

COMM, MODEL = MPI.COMM_WORLD, fit_grid(onera_m6_grid((5, 5, 5)))
OUTPUTS = ("CM_bending", "CM_flap", "strip_cl", "strip_cd", "strip_cm", "strip_chord")


def problem(comm=COMM, **options):
    """The flow about the wing, set up."""
    problem = om.Problem(reports=False, comm=comm)
    problem.model.add_subsystem("grid", GridEvaluate(model=MODEL), promotes=["*"])
    hinges = [HingeMoment("flap", chord=(0.6, 1.0), patches="wing*")]
    flow = EulerFlow(model=MODEL, reference_area=1.16, tolerance=1e-12, iprint=0, hinges=hinges, **options)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup(mode="rev")
    return problem


def run(problem):
    """Run it, and count the products with the Jacobian."""
    problem.run_model()
    return sum(step.n_products for step in problem.model.flow.state.solution.history)


def main(folder: Path):
    """Write on several ranks and read on one, and the other way round."""
    alone, ours = None, problem()
    run(ours)
    if COMM.rank == 0:
        alone = problem(MPI.COMM_SELF)
        run(alone)
        alone.model.flow.save_states(folder / "one.h5")
        alone.model.flow.write_fields(folder / "one.vtm")
    expected = COMM.bcast({name: alone.get_val(name) for name in OUTPUTS} if alone else None)
    for name, value in expected.items():
        np.testing.assert_allclose(ours.get_val(name), value, rtol=1e-8, atol=1e-10, err_msg=name)
    totals = ours.compute_totals(["CM_flap", "CM_bending"], ["control_points"])
    others = COMM.bcast(alone.compute_totals(["CM_flap", "CM_bending"], ["control_points"]) if alone else None)
    for pair, total in totals.items():
        assert np.abs(total - others[pair]).max() < 1e-8 * np.abs(others[pair]).max(), pair
    ours.model.flow.save_states(folder / "many.h5")
    ours.model.flow.write_fields(folder / "many.vtm")
    again = problem(restart=folder / "one.h5")
    assert run(again) <= 30
    if COMM.rank == 0:
        assert run(problem(MPI.COMM_SELF, restart=folder / "many.h5")) <= 30
    refused = raised_everywhere(COMM, lambda: problem(restart=folder / "none.h5"))
    assert isinstance(refused, InputError)
    print("as alone")


main(Path(sys.argv[1]))
