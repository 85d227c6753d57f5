"""Flows by SU2: derivatives through files are those of its functionals, and drivers go on after what fails.

A program stands in for SU2 (``su2_stand_in.py``); where SU2 itself is on the PATH, the last test runs it.
"""

import logging
import shutil

import numpy as np
import openmdao.api as om
import pytest
import su2_stand_in

from bspline_mdao import DesignSurface, InputError, fit_grid
from bspline_mdao.design import Twist
from bspline_mdao.files import read_mesh
from bspline_mdao.flow import Su2Flow
from bspline_mdao.flow.solver_process import locked_case
from bspline_mdao.generators import naca_section, onera_m6_grid, section_o_grid
from bspline_mdao.meshes import MeshModel

TRIANGLES = """\
NDIME= 2
NELEM= 8
{cells}
NPOIN= 8
{points}
NMARK= 2
MARKER_TAG= body
MARKER_ELEMS= 4
{body}
MARKER_TAG= far
MARKER_ELEMS= 4
{far}
"""


def ring(path):
    """A body of four corners in a far field of four, in two dimensions."""
    angle = 0.5 * np.pi * np.arange(4) + 0.2
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([circle * [0.6, 0.2], 3.0 * circle])
    after = (np.arange(4) + 1) % 4
    cells = [f"5 {i} {i + 4} {j + 4}\n5 {i} {j + 4} {j}" for i, j in enumerate(after)]
    body, far = ([f"3 {i + shift} {j + shift}" for i, j in enumerate(after)] for shift in (0, 4))
    lines = ["{:.17g} {:.17g}".format(*point) for point in points]
    parts = {"cells": cells, "points": lines, "body": body, "far": far}
    path.write_text(TRIANGLES.format(**{name: "\n".join(rows) for name, rows in parts.items()}))
    return MeshModel.of(read_mesh(path).mesh, {"body": "wall", "far": "farfield"}, mesh_file=path)


def problem_of(model, tmp_path, **options):
    problem = om.Problem(reports=None)
    settings = {"reference_area": 0.7, "reference_chord": 1.3, "moment_reference": (0.1, 0.2, 0.3), **options}
    problem.model.add_subsystem("flow", Su2Flow(model=model, case=tmp_path / "case", **settings), promotes=["*"])
    problem.setup(mode="rev")
    problem.set_val("Mach_number", 0.45)
    problem.set_val("alpha", 3.0, units="deg")
    return problem


@pytest.fixture
def stand_in(tmp_path, monkeypatch):
    su2_stand_in.install(tmp_path / "bin", monkeypatch)


def gradient_along(problem, of, step, **directions):
    """Totals along a direction in all inputs, and central differences, after a run."""
    totals = problem.compute_totals([*of], [*directions])
    found = [sum(totals[name, wrt] @ direction for wrt, direction in directions.items()) for name in of]
    at = {name: problem.get_val(name).copy() for name in directions}
    sides = []
    for sign in (1.0, -1.0):
        for name, direction in directions.items():
            problem.set_val(name, at[name] + sign * step * direction)
        problem.run_model()
        sides.append([problem.get_val(name).copy() for name in of])
    for name, value in at.items():
        problem.set_val(name, value)
    return np.concatenate(found), np.concatenate([(a - b) / (2.0 * step) for a, b in zip(*sides)])


@pytest.mark.parametrize("axes", ["xzy", "yzx"])
def test_totals_of_a_mesh_of_two_dimensions_are_those_of_the_functionals(tmp_path, stand_in, axes):
    problem, rng = problem_of(ring(tmp_path / "ring.su2"), tmp_path, axes=axes), np.random.default_rng(3)
    problem.run_model()
    low = rng.standard_normal((8, 3)) * [0.1, 0.1, 0.0]
    directions = {"grid": np.concatenate([low, low]).ravel(), "alpha": np.array([20.0]), "Mach_number": np.array([0.7])}
    found, differences = gradient_along(problem, ("CL", "CD", "CM"), 1e-4, **directions)
    assert np.abs(differences[[0, 1, 4]]).min() > 1e-2
    np.testing.assert_allclose(found, differences, rtol=0.0, atol=2e-7)


@pytest.mark.slow
def test_totals_through_the_movement_of_a_grid_of_blocks_are_those_of_the_functionals(tmp_path, stand_in):
    model = fit_grid(onera_m6_grid((5, 6, 5)))
    wing = DesignSurface.of(model)
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("shape", wing.grid_movement([Twist("twist", wing.axis, stations=3)]), promotes=["*"])
    flow = Su2Flow(model=model, reference_area=0.75, case=tmp_path / "case")
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup(mode="rev")
    problem.set_val("Mach_number", 0.45)
    problem.set_val("twist", [0.0, 1.0, -2.0], units="deg")
    problem.run_model()
    directions = {"twist": np.array([0.0, -30.0, 50.0]), "alpha": np.array([20.0])}
    found, differences = gradient_along(problem, ("CL", "CD", "CM"), 1e-3, **directions)
    assert np.abs(differences).min() > 1e-4
    np.testing.assert_allclose(found, differences, rtol=1e-5, atol=1e-7)


def test_forward_products_are_those_of_reverse_ones(tmp_path, stand_in):
    problem = problem_of(ring(tmp_path / "ring.su2"), tmp_path)
    problem.run_model()
    flow, rng = problem.model.flow, np.random.default_rng(5)
    of, wrt = {"CL": 1, "CD": 1, "CM": 3}, {"grid": 48, "alpha": 1, "Mach_number": 1}
    seeds, directions = ({name: rng.standard_normal(n) for name, n in sizes.items()} for sizes in (of, wrt))
    ahead, back = ({name: np.zeros(n) for name, n in sizes.items()} for sizes in (of, wrt))
    flow.compute_jacvec_product(flow._inputs, directions, ahead, "fwd")
    flow.compute_jacvec_product(flow._inputs, back, seeds, "rev")
    left, right = (sum(a[name] @ b[name] for name in a) for a, b in ((seeds, ahead), (back, directions)))
    np.testing.assert_allclose(left, right, rtol=1e-13)


def test_pressures_are_at_the_nodes_of_the_walls(tmp_path, stand_in):
    model = ring(tmp_path / "ring.su2")
    problem = problem_of(model, tmp_path)
    problem.run_model()
    rows, points = problem.model.flow.wall_nodes, problem.get_val("grid").reshape(-1, 3)
    np.testing.assert_array_equal(rows, np.arange(4))
    moment = su2_stand_in.mean_square(points[:8, :2])
    expected = su2_stand_in.pressures(points[:, :2], moment, 0.45, np.radians(3.0))[rows]
    np.testing.assert_allclose(problem.get_val("Cp"), expected, rtol=1e-14)


def test_lift_and_drag_take_two_adjoints_and_each_is_solved_once(tmp_path, stand_in):
    problem = problem_of(ring(tmp_path / "ring.su2"), tmp_path)
    problem.run_model()
    problem.compute_totals(["CL", "CD"], ["alpha"])
    first = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "case").glob("restart_adj_*")}
    assert sorted(first) == ["restart_adj_cfx.csv", "restart_adj_cfy.csv"]
    problem.compute_totals(["CL", "CD"], ["alpha"])
    assert {path.name: path.stat().st_mtime_ns for path in (tmp_path / "case").glob("restart_adj_*")} == first


def test_a_flow_starts_from_the_last_one_of_the_same_cells(tmp_path, stand_in):
    model = ring(tmp_path / "ring.su2")
    problem = problem_of(model, tmp_path)
    for alpha in (1.0, 2.0):
        problem.set_val("alpha", alpha, units="deg")
        problem.run_model()
    cold = problem_of(model, tmp_path, warm_start=False)
    cold.run_model()
    wing = problem_of(fit_grid(section_o_grid(naca_section(0.12), n_around=8, far=5.0)), tmp_path)
    wing.run_model()
    assert (tmp_path / "case" / "starts").read_text().split() == ["NO", "YES", "NO", "NO"]


def test_an_adjoint_whose_flow_was_overwritten_solves_it_again(tmp_path, stand_in):
    model = ring(tmp_path / "ring.su2")
    problem, other = problem_of(model, tmp_path), problem_of(model, tmp_path)
    problem.run_model()
    expected = problem.compute_totals(["CL"], ["grid"])["CL", "grid"]
    problem.run_model()
    problem.model.flow._gradients.clear()
    other.set_val("alpha", -8.0, units="deg")
    other.run_model()
    np.testing.assert_array_equal(problem.compute_totals(["CL"], ["grid"])["CL", "grid"], expected)
    assert (tmp_path / "case" / "starts").read_text().split() == ["NO", "YES", "YES"]


def test_keys_of_a_configuration_that_are_replaced_are_named(tmp_path, stand_in, caplog):
    path = tmp_path / "mine.cfg"
    path.write_text("SOLVER= EULER\nCFL_NUMBER= 7\nAOA= 1.25\nREF_AREA= 3\n")
    with caplog.at_level(logging.INFO, "bspline_mdao"):
        problem_of(ring(tmp_path / "ring.su2"), tmp_path, config=path).run_model()
    assert f"REF_AREA, AOA of {path} set for flow.cfg" in caplog.text
    assert "CFL_NUMBER= 7\n" in (tmp_path / "case" / "flow.cfg").read_text()
    assert path.read_text().count("AOA= 1.25") == 1


def test_forces_without_one_of_the_walls_are_refused(tmp_path, stand_in, monkeypatch):
    model = ring(tmp_path / "ring.su2")
    problem = problem_of(model, tmp_path)
    problem.run_model()
    problem.setup()
    force = type(problem.model.flow._pressures).force
    monkeypatch.setattr(type(problem.model.flow._pressures), "force", lambda *given: 1.1 * force(*given))
    with pytest.raises(InputError, match=r"by its pressures on the walls; check MARKER_MONITORING, to"):
        problem.run_model()


ERROR = r"""
printf 'first\n\nError in "void CSolver::SetResidual_RMS()":\n-----------\nSU2 has diverged (NaN detected).\n'
printf -- '------------------------------ Error Exit -------------------------------\n'
exit 1
"""


@pytest.mark.parametrize(
    ("script", "said"),
    [
        (
            ERROR,
            r"SU2 has diverged \(NaN detected\); take a smaller step, or a smaller CFL_NUMBER\nThe end of .*SU2_CFD:",
        ),
        ("echo all well; kill -KILL $$", "was ended by SIGKILL, by a user or for lack of memory"),
        ("sleep 30", "stopped at its time limit of 0.3 s"),
        ("exit 0", r"history.csv: was not written \(No such file or directory\); check the log"),
        (
            "echo; echo 'Maximum number of iterations reached (ITER = 7) before convergence.'",
            "not converged in 7 iterations; raise ITER, CFL_NUMBER",
        ),
    ],
    ids=["diverged", "killed", "hangs", "writes nothing", "not converged"],
)
def test_a_solver_that_fails_is_an_analysis_error_with_the_end_of_its_log(tmp_path, monkeypatch, script, said):
    su2_stand_in.install(tmp_path / "bin", monkeypatch, script)
    problem = problem_of(ring(tmp_path / "ring.su2"), tmp_path, time_limit=0.3)
    with pytest.raises(om.AnalysisError, match=said):
        problem.run_model()


def test_a_missing_solver_or_adjoint_says_what_to_install(tmp_path, monkeypatch):
    su2_stand_in.install(tmp_path / "bin", monkeypatch, programs=["SU2_CFD"])
    problem = problem_of(ring(tmp_path / "ring.su2"), tmp_path, adjoint_program="SU2_NONE_AD")
    problem.run_model()
    with pytest.raises(om.AnalysisError, match=r"SU2_NONE_AD is not on the PATH; install SU2 .*enable-autodiff=true"):
        problem.compute_totals(["CL"], ["alpha"])
    problem = problem_of(ring(tmp_path / "ring.su2"), tmp_path, program="SU2_NONE")
    with pytest.raises(om.AnalysisError, match="SU2_NONE is not on the PATH; install SU2 7 or 8"):
        problem.run_model()


def test_a_failed_flow_does_not_start_the_next_one(tmp_path, stand_in, monkeypatch):
    problem = problem_of(ring(tmp_path / "ring.su2"), tmp_path)
    problem.run_model()
    su2_stand_in.install(tmp_path / "failing", monkeypatch, "exit 3")
    problem.set_val("alpha", 9.0, units="deg")
    with pytest.raises(om.AnalysisError, match="ended with status 3"):
        problem.run_model()
    su2_stand_in.install(tmp_path / "failing", monkeypatch)
    problem.run_model()
    assert (tmp_path / "case" / "starts").read_text().split() == ["NO", "NO"]


def test_two_runs_in_one_folder_are_refused(tmp_path, stand_in):
    problem = problem_of(ring(tmp_path / "ring.su2"), tmp_path)
    with locked_case(tmp_path / "case"), pytest.raises(InputError, match="another run is at work in it"):
        problem.run_model()


def test_what_does_not_fit_is_refused(tmp_path, stand_in):
    model = ring(tmp_path / "ring.su2")
    with pytest.raises(InputError, match="reference area None; give a positive number"):
        problem_of(model, tmp_path, reference_area=None)
    viscous = tmp_path / "viscous.cfg"
    viscous.write_text("SOLVER= NAVIER_STOKES\n")
    problem = problem_of(model, tmp_path, config=viscous)
    problem.run_model()
    totals = problem.compute_totals(["CL"], ["alpha", "Mach_number"])
    assert totals["CL", "alpha"] != 0.0
    assert np.isnan(totals["CL", "Mach_number"])
    problem.model.add_design_var("Mach_number")
    problem.setup(mode="rev")
    with pytest.raises(InputError, match=r"set INIT_OPTION= TD_CONDITIONS, or leave Mach_number out"):
        problem.run_model()


def section(path, n=32, layers=12):
    """A section of 12 % in quads, from its trailing edge around, the layers growing to a far field at 20 chords."""
    angle = 2.0 * np.pi * np.arange(n) / n
    x = 0.5 + 0.5 * np.cos(angle)
    half = 0.6 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    body = np.stack([x, np.where(angle > np.pi, -half, half)], axis=1)
    circle = 20.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1) + [0.5, 0.0]
    parts = (np.exp(4.5 * np.linspace(0.0, 1.0, layers)) - 1.0) / (np.exp(4.5) - 1.0)
    points = np.concatenate([body + part * (circle - body) for part in parts])
    around = np.stack([np.arange(n), (np.arange(n) + 1) % n], axis=1)
    rows = [around + n * layer for layer in range(layers)]
    cells = [f"9 {a} {b} {d} {c}" for low, up in zip(rows, rows[1:]) for (a, b), (c, d) in zip(low, up)]
    lines = [f"NDIME= 2\nNELEM= {len(cells)}", *cells, f"NPOIN= {len(points)}"]
    lines += ["{:.17g} {:.17g}".format(*point) for point in points]
    lines.append("NMARK= 2")
    for name, ends in (("body", rows[0]), ("far", rows[-1])):
        lines += [f"MARKER_TAG= {name}\nMARKER_ELEMS= {n}", *(f"3 {a} {b}" for a, b in ends)]
    path.write_text("\n".join(lines) + "\n")
    return MeshModel.of(read_mesh(path).mesh, {"body": "wall", "far": "farfield"}, mesh_file=path)


@pytest.mark.solver
@pytest.mark.slow
@pytest.mark.skipif(not (shutil.which("SU2_CFD") and shutil.which("SU2_CFD_AD")), reason="SU2 is not on the PATH")
@pytest.mark.parametrize("wrt", ["grid", "alpha", "Mach_number"])
def test_totals_by_su2_itself_are_those_of_differences(tmp_path, wrt):
    model = section(tmp_path / "section.su2")
    problem, rng = problem_of(model, tmp_path, reference_area=1.0), np.random.default_rng(7)
    problem.run_model()
    points = model.mesh.points[: model.mesh.n_stored]
    near = np.exp(-np.linalg.norm(points - [0.5, 0.0, 0.0], axis=1))[:, None]
    bumps = rng.standard_normal(points.shape) * near * [2e-2, 2e-2, 0.0]
    direction = np.concatenate([bumps, bumps]).ravel() if wrt == "grid" else np.ones(1)
    found, differences = gradient_along(problem, ("CL", "CD", "CM"), 1e-3, **{wrt: direction})
    np.testing.assert_allclose(found, differences, rtol=1e-4, atol=1e-7)
