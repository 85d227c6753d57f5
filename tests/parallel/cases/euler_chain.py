"""What happens around a flow on several ranks: control points, checks and failures."""

import numpy as np
import openmdao.api as om
from mpi4py import MPI

from bspline_mdao import EulerFlow, GridEvaluate, InputError, fit_grid
from bspline_mdao.flow.om.flow_run import run_flow
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.partition import Partition, Subdomain

COMM = MPI.COMM_WORLD
OF, WRT = ("CL", "CD", "CM", "CD_induced"), ("control_points", "alpha")


def chain(model, comm=COMM, mode="rev", **options):
    """Control points to coefficients."""
    problem = om.Problem(reports=False, comm=comm)
    problem.model.add_subsystem("grid", GridEvaluate(model=model), promotes=["*"])
    flow = EulerFlow(model=model, reference_area=1.16, tolerance=1e-12, iprint=0, **options)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup(mode=mode)
    return problem


def totals_are_those_alone(model):
    """Values and totals with respect to all control points, by a random direction forward."""
    expected = None
    if COMM.rank == 0:
        alone = chain(model, MPI.COMM_SELF)
        expected = run_flow(alone), alone.compute_totals(OF, WRT)
    summary, totals = COMM.bcast(expected)
    problem = chain(model)
    ours = run_flow(problem)
    assert ours["n_cells"] == summary["n_cells"]
    np.testing.assert_allclose([ours["CL"], ours["CD"]], [summary["CL"], summary["CD"]], rtol=1e-10)
    for pair, block in problem.compute_totals(OF, WRT).items():
        assert np.abs(block - totals[pair]).max() < 1e-9 * np.abs(totals[pair]).max(), pair


def totals_at_fixed_lift_are_those_alone(model):
    """The angle is one for all, and so are totals, with respect to control points and the lift, of both modes."""
    of, wrt, expected = (*OF[1:], "alpha"), ("CL_target", "Mach_number"), None

    def flown(comm, mode):
        problem = chain(model, comm, mode, trim=True)
        problem.set_val("CL_target", 0.2)
        problem.run_model()
        points = (("control_points",) if mode == "rev" else ()) + wrt
        return problem.get_val("alpha").item(), problem.compute_totals(of, points)

    if COMM.rank == 0:
        expected = flown(MPI.COMM_SELF, "rev")
    angle, totals = COMM.bcast(expected)
    for mode in ("rev", "fwd"):
        ours, blocks = flown(COMM, mode)
        np.testing.assert_allclose(ours, angle, rtol=1e-9)
        for pair, block in blocks.items():
            assert np.abs(block - totals[pair]).max() < 1e-9 * np.abs(totals[pair]).max(), (mode, pair)


def checks_end(model):
    """A check of partials ends: those of the flow are left to one process, and it is said."""
    problem = chain(model)
    problem.run_model()
    assert not any(problem.check_partials(includes=["flow.*"], out_stream=None).values())


def raised(task, kind):
    """Words of what a task raises, the same on all ranks."""
    try:
        task()
    except kind as error:
        words = COMM.allgather(str(error))
        assert len(set(words)) == 1, words
        return words[0]
    raise AssertionError("nothing was raised")


def failures_are_those_of_all(model):
    """Nodes that are no numbers on one rank, cells inside out, flows that do not converge; and then it goes on."""
    problem = chain(model)
    problem.run_model()
    lift, points = problem.get_val("CL").item(), problem.get_val("control_points").copy()
    inside_out = points.reshape(-1, 3) * [1.0, 1.0, -1.0]
    problem.set_val("control_points", inside_out.ravel())
    assert raised(problem.run_model, om.AnalysisError)
    problem.set_val("control_points", points)
    problem.set_val("alpha", np.nan)
    assert ": alpha is nan" in raised(problem.run_model, om.AnalysisError)
    problem.set_val("alpha", 2.0)
    problem.run_model()
    np.testing.assert_allclose(problem.get_val("CL").item(), lift, rtol=1e-9)
    hasty = chain(model, max_steps=1)
    assert "did not converge" in raised(hasty.run_model, om.AnalysisError)
    other = Partition.of(model.topology, COMM.size + 1)
    assert f"one of {COMM.size + 1} processes" in raised(lambda: chain(model, partition=other), InputError)
    rows = Subdomain.of_rows([0, 1, 2], model.topology.n_nodes)
    assert "give its Partition" in raised(lambda: chain(model, partition=rows), InputError)


MODEL = fit_grid(onera_m6_grid((5, 5, 5)))
totals_are_those_alone(MODEL)
totals_at_fixed_lift_are_those_alone(MODEL)
checks_end(MODEL)
failures_are_those_of_all(MODEL)
print("done")
