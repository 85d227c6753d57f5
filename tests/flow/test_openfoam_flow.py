"""The component with OpenFOAM: what a stand-in writes is read, failures are taken by drivers, forces are OpenFOAM's."""

import errno
import os
import shutil

import numpy as np
import openmdao.api as om
import pytest
from openfoam_stand_ins import CONVERGED, SOLVER, stand_in

from bspline_mdao import Grid, InputError, NLoptDriver, ScipyDriver, fit_grid
from bspline_mdao.flow import OpenFoamFlow, ReferenceWarning
from bspline_mdao.flow.openfoam.case_folder import CaseFolder
from bspline_mdao.grids.topology.grid import Block, Patch
from bspline_mdao.grids.topology.index_space import Window

needs_solver = [
    pytest.mark.solver,
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("rhoSimpleFoam") is None, reason="rhoSimpleFoam is not on the PATH"),
]

Q = 0.7e5 * 0.3**2
"""Dynamic pressure at Mach 0.3 (Pa)."""


@pytest.fixture(scope="module")
def floor():
    """A fitted box of 1 m."""
    return box(1.0)


def box(width):
    """A fitted box whose lowest side, of 1 m and a width (m), is a wall."""
    nodes = np.stack(np.meshgrid(*[np.linspace(0.0, 1.0, 5)] * 3, indexing="ij"), axis=-1)
    patch = Patch("floor", "wall", (Window.whole(0, (5, 5, 5)).face(4),))
    return fit_grid(Grid((Block(nodes * [1.0, width, 1.0], "box"),), (patch,)))


def put_solver(tmp_path, monkeypatch, failure="", end=CONVERGED):
    """Put the solver on the PATH."""
    stand_in(tmp_path / "bin", monkeypatch, "rhoSimpleFoam", SOLVER.replace("FAILURE", failure).replace("END", end))


def flow_of(model, tmp_path, driver=None, **options):
    """A problem with the flow, and its angle of attack as the design variable."""
    options = {"reference_area": 1.0, "iprint": 0, "axes": "xyz", **options}
    flow = OpenFoamFlow(model=model, folder=tmp_path / "case", **options)
    problem = om.Problem(driver=driver, reports=None)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.model.add_design_var("alpha", lower=-20.0, upper=20.0, units="deg")
    problem.model.add_objective("CL", scaler=-20.0)
    problem.model.approx_totals(method="fd", step=1e-3, form="forward")
    problem.setup()
    problem.set_val("alpha", 1.0)
    return problem


def test_coefficients_are_those_of_the_pressure_on_the_wall(floor, tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch)
    references = {"reference_area": 0.5, "reference_chord": 2.0, "moment_reference": (0.25, 0.0, 0.0)}
    problem = flow_of(floor, tmp_path, **references)
    nodes = floor.local_nodes() * [2.0, 1.0, 1.0]  # a wall of 2 m^2, in the middle of which the force is
    problem.set_val("grid", nodes.ravel())
    problem.set_val("alpha", 0.0)
    with pytest.warns(ReferenceWarning):
        problem.run_model()
    Cp = 9000.0 / Q
    np.testing.assert_allclose(problem.get_val("Cp"), np.full(16, Cp), rtol=1e-12)
    np.testing.assert_allclose(problem.get_val("CL"), -Cp * 2.0 / 0.5, rtol=1e-12)
    np.testing.assert_allclose(problem.get_val("CD"), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        problem.get_val("CM"), [-2.0 * Cp, 3.0 * Cp, 0.0] / np.array(2.0 * 0.5 / 0.5), rtol=1e-12
    )
    assert problem.get_val("n_iterations") == 2


def test_a_run_starts_from_the_last_solution_and_the_same_design_is_not_run_again(floor, tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch)
    problem = flow_of(floor, tmp_path)
    for alpha in (1.0, 2.0, 2.0):
        problem.set_val("alpha", alpha)
        problem.run_model()
    flow_of(floor, tmp_path).run_model()  # another process, say
    starts = [float(line.split()[-1].rstrip(";")) for line in (tmp_path / "starts").read_text().splitlines()]
    np.testing.assert_allclose(starts, [100000.0, 104000.0, 101000.0], rtol=1e-9)
    case = tmp_path / "case"
    assert sorted(path.name for path in case.iterdir() if path.is_dir()) == ["0", "2", "constant", "solution", "system"]


def test_differences_start_from_the_solution_of_their_design_and_leave_it(floor, tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch)
    problem = flow_of(floor, tmp_path)
    problem.run_model()
    slope = problem.compute_totals(["CL"], ["alpha"])["CL", "alpha"].item()
    assert slope == pytest.approx(-1000.0 / Q * (2 * (1.0 - 3.0)), rel=3e-3)
    problem.set_val("alpha", 2.0)
    problem.run_model()
    starts = [float(line.split()[-1].rstrip(";")) for line in (tmp_path / "starts").read_text().splitlines()]
    np.testing.assert_allclose(starts, [100000.0, 104000.0, 104000.0], rtol=1e-9)


def test_derivatives_that_are_not_there_are_refused(floor, tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch)
    problem = om.Problem(reports=None)
    flow = OpenFoamFlow(model=floor, folder=tmp_path / "case", reference_area=1.0, iprint=0, axes="xyz")
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup()
    problem.run_model()
    with pytest.raises(InputError, match=r"has no derivatives; give .* or call approx_totals\(\)"):
        problem.compute_totals(["CL"], ["alpha"])


FAILURES = {
    "divergence": ("kill -FPE $$", CONVERGED, "the flow diverged"),
    "a number that is none": (
        "",
        "echo 'Time = 3'; echo 'x:  Solving for Ux, Initial residual = nan,'",
        "residual of Ux is",
    ),
    "no convergence": ("", "", "not converged after 2 iterations, last residuals p 1.0e-07; give it more"),
    "no fields": ("", f"rm -r $case/1 $case/2; {CONVERGED}", "no fields were written"),
    "half a field": (
        "",
        f"head -c 150 $case/0/p > $case/2/p; {CONVERGED}",
        "on patch floor: it is not whole",
    ),
}


@pytest.mark.parametrize("name", FAILURES)
def test_a_failure_is_an_analysis_error_and_the_last_solution_stays(name, floor, tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch)
    problem = flow_of(floor, tmp_path)
    problem.run_model()
    failure, end, words = FAILURES[name]
    put_solver(tmp_path, monkeypatch, failure, end)
    problem.set_val("alpha", 2.0)
    with pytest.raises(om.AnalysisError, match=words):
        problem.run_model()
    put_solver(tmp_path, monkeypatch)
    problem.run_model()
    assert problem.get_val("Cp")[0] == pytest.approx(1000.0 / Q, rel=1e-9)
    last = (tmp_path / "starts").read_text().splitlines()[-1]
    assert float(last.split()[-1].rstrip(";")) == pytest.approx(104000.0, rel=1e-9)


def test_a_disk_that_is_full_when_the_solution_is_kept_is_an_analysis_error(floor, tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch)
    problem = flow_of(floor, tmp_path)

    def full(source, target, **_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(target))

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copytree", full)
        with pytest.raises(om.AnalysisError, match=r"No space left on device \(.*solution.new\); free some space"):
            problem.run_model()
    problem.run_model()
    assert problem.get_val("Cp")[0] == pytest.approx(4000.0 / Q, rel=1e-9)


def test_a_disk_that_is_full_while_a_case_is_written_is_an_analysis_error(floor, tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch)
    problem = flow_of(floor, tmp_path)
    problem.run_model()
    problem.set_val("alpha", 2.0)
    put, place = os.replace, str(tmp_path / "case" / "system")

    def full(source, target):
        if str(target).startswith(place):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(target))
        put(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        with pytest.raises(om.AnalysisError, match=r"No space left on device \(.*system.*\); free some space"):
            problem.run_model()
    problem.run_model()
    assert problem.get_val("Cp")[0] == pytest.approx(1000.0 / Q, rel=1e-9)


DEAL, GATHER, RUN = (
    "ls $case; cp $case/system/decomposeParDict $case/../dealt; mkdir $case/processor0",
    "touch $case/../gathered_$3",
    'printf "%s " "$@" > $case/../mpirun; shift 2; exec "$@"',
)


def test_several_processes_have_slices_across_the_longest_side_of_the_walls(tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch)
    for program, script in {"decomposePar": DEAL, "reconstructPar": GATHER}.items():
        stand_in(tmp_path / "bin", monkeypatch, program, f"case=$2; {script}")
    stand_in(tmp_path / "bin", monkeypatch, "mpirun", f"case=$5; {RUN}")
    flow_of(box(2.0), tmp_path, n_processes=3).run_model()
    case = tmp_path / "case"
    assert (tmp_path / "mpirun").read_text() == f"-n 3 rhoSimpleFoam -case {case} -parallel "
    assert "numberOfSubdomains 3; method simple; simpleCoeffs { n (1 3 1)" in (tmp_path / "dealt").read_text()
    assert (tmp_path / "gathered_-latestTime").exists()
    assert not list(case.glob("processor*"))


def test_what_is_not_converged_is_taken_if_so_asked(floor, tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch, end="")
    problem = flow_of(floor, tmp_path, unconverged="take")
    problem.run_model()
    assert problem.get_val("Cp")[0] == pytest.approx(4000.0 / Q, rel=1e-9)


def test_cells_without_volume_are_an_analysis_error_before_the_solver_runs(floor, tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch)
    problem = flow_of(floor, tmp_path)
    nodes = floor.local_nodes()
    nodes[62, 2] = 3.0
    problem.set_val("grid", nodes.ravel())
    with pytest.raises(om.AnalysisError, match="negative volumes"):
        problem.run_model()
    assert not (tmp_path / "runs").exists()


def test_a_second_run_in_the_folder_is_refused(floor, tmp_path, monkeypatch):
    put_solver(tmp_path, monkeypatch)
    problem = flow_of(floor, tmp_path)
    with CaseFolder(tmp_path / "case").locked(), pytest.raises(InputError, match="another run is at work in it"):
        problem.run_model()


DRIVERS = {
    "SLSQP of SciPy": lambda: ScipyDriver(optimizer="SLSQP", tol=1e-8, disp=False),
    "SLSQP of NLopt": lambda: NLoptDriver(optimizer="LD_SLSQP"),
}


@pytest.mark.parametrize("name", DRIVERS)
def test_a_driver_goes_on_where_the_flow_about_a_design_diverges(name, floor, tmp_path, monkeypatch):
    diverges = 'if awk "BEGIN { exit !($alpha > 5) }"; then echo run >> $case/../failed; exit 136; fi'
    put_solver(tmp_path, monkeypatch, diverges)
    driver = DRIVERS[name]()
    problem = flow_of(floor, tmp_path, driver)
    problem.run_driver()
    assert len((tmp_path / "failed").read_text().splitlines()) >= 1
    assert problem.get_val("alpha").item() == pytest.approx(3.0, abs=2e-3)
