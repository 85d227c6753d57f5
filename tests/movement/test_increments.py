"""The number of increments that a move chooses: by what it needs, always the same, and in the report."""

import re
from dataclasses import dataclass
from functools import cache

import numpy as np
import openmdao.api as om
import pytest
from mover_cases import assert_derivative_is_exact, assert_derivative_is_transposed

from bspline_mdao import (
    LinearElasticity,
    fit_grid,
    fit_shape,
    flat_plate_grid,
    moving_mesh,
    onera_m6_grid,
    rectangular_wing,
)
from bspline_mdao.cells.grid_quality import GridQuality
from bspline_mdao.cells.report import report_quality
from bspline_mdao.design.named_deformations import parse_deformation
from bspline_mdao.errors import MovementError
from bspline_mdao.movement.equilibrium import Equilibrium
from bspline_mdao.movement.fixed_interior import FixedInterior
from bspline_mdao.movement.increments import GOOD_RATIO, IncrementalMover
from bspline_mdao.movement.mover import IncrementReport, MovementReport
from bspline_mdao.names import CONTROL_POINTS, CONTROL_POINTS_INITIAL, N_INCREMENTS, SURFACE_CONTROL_POINTS
from bspline_mdao.om.control_mesh_move import ControlMeshMove
from bspline_mdao.om.grid_movement import GridMovement

NEEDED = {30: 1, 60: 1, 90: 2, 120: 5}
"""Increments that a twist of the plate by so many degrees needs."""


@cache
def plate():
    """Model of a flat plate."""
    return fit_grid(flat_plate_grid((7, 6, 8)), n_control=(5, 4, 6), method="quasi_interpolant")


@cache
def plate_mesh():
    return moving_mesh(plate())


def twisted(mesh, degrees):
    """Surface points turned about the middle of the chord, the more the farther out."""
    x, y, z = mesh.points[mesh.surface_ids].T
    middle, angle = x.mean(), degrees * np.pi / 180.0 * z / z.max()
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.column_stack([middle + cosine * (x - middle) + sine * y, cosine * y - sine * (x - middle), z])


def ratio_with(mesh, surface, n_increments):
    mover = LinearElasticity(mesh, n_increments=n_increments)
    return mover.move(mesh.points, surface).report.increments[-1].corner_ratio


# a move


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "needed"), NEEDED.items())
def test_a_move_takes_the_first_number_that_keeps_the_mesh_good_and_tells_what_it_tried(degrees, needed):
    mesh = plate_mesh()
    surface = twisted(mesh, degrees)
    movement = LinearElasticity(mesh).move(mesh.points, surface)
    report = movement.report
    assert report.n_increments == len(report.increments) == needed
    assert [trial.n_increments for trial in report.tried] == [m for m in (1, 2, 5) if m <= needed]
    for trial in report.tried:
        assert trial.corner_ratio == ratio_with(mesh, surface, trial.n_increments)
        assert (trial.corner_ratio >= GOOD_RATIO) == (trial.n_increments == needed)
    given = LinearElasticity(mesh, n_increments=needed).move(mesh.points, surface)
    np.testing.assert_array_equal(movement.points, given.points)
    assert given.report.tried == ()


@pytest.mark.slow
def test_the_number_does_not_depend_on_moves_before():
    mesh, mover = plate_mesh(), LinearElasticity(plate_mesh())
    for degrees in (120, 30, 90, 120, 60):
        assert mover.move(mesh.points, twisted(mesh, degrees)).report.n_increments == NEEDED[degrees]


@pytest.mark.slow
def test_where_no_number_keeps_the_mesh_good_the_best_is_taken():
    mesh = plate_mesh()
    surface = twisted(mesh, 170)
    report = LinearElasticity(mesh).move(mesh.points, surface).report
    ratios = {m: ratio_with(mesh, surface, m) for m in (1, 2, 5, 10)}
    assert [trial.n_increments for trial in report.tried] == list(ratios)
    assert max(ratios.values()) < GOOD_RATIO
    assert report.increments[-1].corner_ratio == max(ratios.values())
    assert report.tangling


def test_elements_that_were_folded_before_the_move_are_named_as_the_likely_cause():
    tangled = IncrementReport(None, 3, "element (1, 2, 3) of block 4", -0.1, -2.0, 5)
    told = MovementReport((tangled,), 0.1, n_invalid=7).tangling
    assert re.search(r"3 elements .* at the end; 7 others are .* before the move.*--method valid", told)
    assert MovementReport((tangled,), 0.1).tangling.endswith("3 elements newly invalid at the end")


@dataclass(frozen=True)
class Fragile(IncrementalMover):
    """Gives up when the surface goes too far at once."""

    mesh: object
    n_increments: int | str = "auto"
    farthest: float = 0.02

    def _step(self, initial, before, surface):
        if np.abs(surface - before[self.mesh.surface_ids]).max() > self.farthest:
            raise MovementError("fragile: too far")
        return FixedInterior(self.mesh)._step(initial, before, surface)


@pytest.mark.slow
def test_more_increments_are_tried_where_a_mover_gives_up_and_the_error_names_the_increment():
    mesh = plate_mesh()
    surface = mesh.points[mesh.surface_ids] + [0.0, 0.03, 0.0]
    report = Fragile(mesh).move(mesh.points, surface).report
    assert [(trial.n_increments, trial.failure) for trial in report.tried] == [
        (1, "increment 1 of 1: fragile: too far"),
        (2, ""),
    ]
    with pytest.raises(MovementError, match="increment 1 of 10: fragile: too far"):
        Fragile(mesh, farthest=1e-4).move(mesh.points, surface)


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [60, 90, 120])
def test_derivatives_are_exact_for_the_number_in_use(degrees):
    mesh, mover = plate_mesh(), LinearElasticity(plate_mesh())
    surface = twisted(mesh, degrees)
    assert_derivative_is_transposed(mover.move(mesh.points, surface))
    scale = 0.01 * np.ones((mesh.n_points, 1))
    assert_derivative_is_exact(mover, mesh.points, surface, scale=scale, tolerance=1e-7)


def test_what_is_tried_before_costs_no_more_than_a_quarter(monkeypatch):
    """Factorisations count: of a later move, and of a first one."""
    mesh, made, factorized = plate_mesh(), [], Equilibrium.factorized
    monkeypatch.setattr(Equilibrium, "factorized", lambda *arguments: made.append(1) or factorized(*arguments))

    def counts(mover):
        made.clear()
        first = mover.move(mesh.points, twisted(mesh, 30))  # makes the factor of the baseline
        mover.move(mesh.points, twisted(mesh, 120), start=first.start)
        return len(made)

    assert counts(LinearElasticity(mesh, n_increments=5)) == 1 + 2 * 4
    assert counts(LinearElasticity(mesh)) == 1 + 0 + (1 + 4)
    assert counts(LinearElasticity(mesh, n_increments=1)) == 1


# the three morphs


@pytest.mark.slow
@pytest.mark.parametrize(("request_", "most"), [("shape", 1), ("bend=60deg@0.7", 2), ("twist=30deg+stretch=1.5", 1)])
def test_a_wing_changes_shape_in_one_increment_or_two_and_no_cell_inverts(request_, most):
    model = fit_grid(onera_m6_grid((13, 15, 11)), n_control=(7, 8, 6), keep_residual=False, method="quasi_interpolant")
    mesh = moving_mesh(model)
    if request_ == "shape":
        surface = fit_shape(model, mesh.surface_ids, rectangular_wing())
    else:
        surface = parse_deformation(request_, model, mesh).apply(mesh.points[mesh.surface_ids])
    movement = LinearElasticity(mesh).move(mesh.points, surface)
    assert movement.report.n_increments <= most
    quality = GridQuality.of_baseline(model.regenerate())
    nodes = model.regenerate(movement.points).to_vector().reshape(-1, 3)
    assert report_quality(quality, nodes).n_inverted == 0


# the component


def problem_of(mover=None, **options):
    problem = om.Problem(reports=False)
    move = ControlMeshMove(mover=mover or LinearElasticity(plate_mesh()), **options)
    problem.model.add_subsystem("move", move, promotes=["*"])
    problem.setup()
    return problem


def run_at(problem, degrees):
    problem.set_val(SURFACE_CONTROL_POINTS, twisted(plate_mesh(), degrees).ravel())
    problem.run_model()
    return problem.get_val(CONTROL_POINTS).copy(), problem.get_val(N_INCREMENTS)


def test_the_number_of_a_problem_only_grows_and_earlier_designs_follow(caplog):
    problem, numbers = problem_of(), []
    for degrees in (0, 30, 90, 60, 120, 30):
        points, number = run_at(problem, degrees)
        numbers.append(number)
        fresh, _ = run_at(problem_of(LinearElasticity(plate_mesh(), n_increments=number)), degrees)
        np.testing.assert_array_equal(points, fresh)
    assert numbers == [1, 1, 2, 2, 5, 5]
    messages = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert len(messages) == 2
    assert "'move' <class ControlMeshMove>: 2 increments from this design on, 1 before it" in messages[0]
    problem.setup()
    assert run_at(problem, 30)[1] == 1


def test_designs_decide_for_themselves_where_that_is_wanted(caplog):
    problem = problem_of(keep_increments=False)
    assert [run_at(problem, degrees)[1] for degrees in (120, 30, 90)] == [5, 1, 2]
    group = om.Problem(GridMovement(model=plate(), fit=False, quality=False, keep_increments=False), reports=False)
    group.setup()
    assert not group.model.move.options["keep_increments"]


@pytest.mark.slow
def test_totals_are_those_of_the_number_in_use_before_and_after_it_grows():
    problem, rng = problem_of(), np.random.default_rng(0)
    mesh = plate_mesh()
    bar = rng.normal(size=mesh.points.size)
    for degrees, number in ((60, 1), (90, 2), (60, 2)):
        run_at(problem, degrees)
        product = problem.compute_jacvec_product(
            [CONTROL_POINTS], [SURFACE_CONTROL_POINTS], "rev", {CONTROL_POINTS: bar}
        )
        given = LinearElasticity(mesh, n_increments=number).move(mesh.points, twisted(mesh, degrees))
        exact = given.vjp(bar.reshape(-1, 3))[1]
        np.testing.assert_array_equal(product[SURFACE_CONTROL_POINTS], exact.ravel())
    totals = problem.compute_totals([CONTROL_POINTS], [SURFACE_CONTROL_POINTS])
    assert np.abs(totals[CONTROL_POINTS, SURFACE_CONTROL_POINTS]).max() > 0.1


def test_a_product_at_a_design_of_before_is_of_the_number_in_use():
    problem, mesh = problem_of(), plate_mesh()
    for degrees in (60, 90):
        run_at(problem, degrees)
    d_surface = np.random.default_rng(1).normal(size=3 * len(mesh.surface_ids))
    d_outputs = {CONTROL_POINTS: np.zeros(mesh.points.size)}
    inputs = {CONTROL_POINTS_INITIAL: mesh.points.ravel(), SURFACE_CONTROL_POINTS: twisted(mesh, 60).ravel()}
    problem.model.move.compute_jacvec_product(inputs, {SURFACE_CONTROL_POINTS: d_surface}, d_outputs, "fwd")
    given = LinearElasticity(mesh, n_increments=2).move(mesh.points, twisted(mesh, 60))
    exact = given.jvp(np.zeros_like(mesh.points), d_surface.reshape(-1, 3))
    np.testing.assert_array_equal(d_outputs[CONTROL_POINTS], exact.ravel())


def largest_good_angle(mesh):
    """Angle, within 1e-9 degrees, up to which one increment keeps the plate good."""
    low, high = 60.0, 90.0
    while high - low > 1e-9:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ratio_with(mesh, twisted(mesh, middle), 1) >= GOOD_RATIO else (low, middle)
    return low


def twist_problem(driver=None, mover=None):
    """The plate turned by one number; the objective is how far it is from two increments by 95 degrees."""
    problem, mesh = om.Problem(driver=driver, reports=False), plate_mesh()

    class Turn(om.ExplicitComponent):
        def setup(self):
            self.add_input("angle", 0.0)
            self.add_output(SURFACE_CONTROL_POINTS, twisted(mesh, 0.0).ravel(), units="m")
            self.declare_partials("*", "*", method="cs")

        def compute(self, inputs, outputs):
            outputs[SURFACE_CONTROL_POINTS] = twisted(mesh, inputs["angle"]).ravel()

    problem.model.add_subsystem("turn", Turn(), promotes=["*"])
    problem.model.add_subsystem("move", ControlMeshMove(mover=mover or LinearElasticity(mesh)), promotes=["*"])
    target = LinearElasticity(mesh, n_increments=2).move(mesh.points, twisted(mesh, 95)).points.ravel()
    miss = om.ExecComp("f = sum((b - target)**2)", b={"shape": target.size, "units": "m"}, target=target)
    problem.model.add_subsystem("miss", miss, promotes=[("b", CONTROL_POINTS), "f"])
    problem.model.add_design_var("angle", lower=0.0, upper=105.0, ref=50.0)
    problem.model.add_objective("f")
    problem.setup()
    return problem


@pytest.mark.slow
def test_finite_differences_across_the_angle_at_which_the_number_grows_are_of_one_number():
    problem = twist_problem()
    problem.set_val("angle", largest_good_angle(plate_mesh()))
    problem.run_model()
    assert problem.get_val(N_INCREMENTS) == 1
    exact = problem.compute_totals(["f"], ["angle"])["f", "angle"].item()
    problem.model.approx_totals(method="fd", step=1e-4, form="central")
    differences = problem.compute_totals(["f"], ["angle"])["f", "angle"].item()
    assert differences == pytest.approx(exact, rel=1e-5)
    assert problem.get_val(N_INCREMENTS) == 1


@pytest.mark.slow
def test_an_optimisation_goes_on_where_the_number_grows_and_records_it(tmp_path):
    problem = twist_problem(om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-12, disp=False))
    problem.driver.add_recorder(om.SqliteRecorder(str(tmp_path / "cases.sql")))
    problem.driver.recording_options["includes"] = ["*"]
    problem.set_val("angle", 40.0)
    assert problem.run_driver().success
    assert problem.get_val("angle").item() == pytest.approx(95.0, abs=1e-4)
    problem.cleanup()
    reader = om.CaseReader(str(tmp_path / "cases.sql"))
    numbers = [reader.get_case(name).get_val(N_INCREMENTS) for name in reader.list_cases("driver", out_stream=None)]
    assert numbers == sorted(numbers)
    assert {1, 2} <= set(numbers)
    restart = twist_problem(mover=LinearElasticity(plate_mesh(), n_increments=numbers[-1]))
    restart.set_val("angle", problem.get_val("angle"))
    restart.run_model()
    np.testing.assert_array_equal(restart.get_val("f"), problem.get_val("f"))


def test_cases_of_a_study_do_not_depend_on_their_order_where_each_decides_for_itself():
    values = []
    for angles in ((40.0, 95.0, 60.0), (95.0, 60.0, 40.0)):
        problem = twist_problem()
        problem.model.move.options["keep_increments"] = False
        found = {}
        for angle in angles:
            problem.set_val("angle", angle)
            problem.run_model()
            found[angle] = (problem.get_val("f").item(), problem.get_val(N_INCREMENTS))
        values.append(found)
    assert values[0] == values[1]
    assert [number for _, number in values[0].values()] == [1, 2, 1]
