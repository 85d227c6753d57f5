"""The movement of the control mesh in a problem: made once, followed where it tangles, right again after failures."""

import re
from dataclasses import dataclass, field, replace

import numpy as np
import openmdao.api as om
import pytest
from component_cases import Shear, movable_model
from topology_cases import grid_of

from bspline_mdao import NLoptDriver
from bspline_mdao.base.sparse import conjugate_gradient
from bspline_mdao.base.sparse.cholesky import Cholesky
from bspline_mdao.base.sparse.conjugate_gradient import ConjugateGradients
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.movement.elasticity import LinearElasticity
from bspline_mdao.core.movement.fixed_interior import FixedInterior
from bspline_mdao.core.movement.rotations import Rotations
from bspline_mdao.core.om.control_mesh_move import ControlMeshMove
from bspline_mdao.core.om.grid_movement import GridMovement
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.generators import flat_plate_grid
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.names import CONTROL_CORNER_KS, CONTROL_POINTS, CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS
from bspline_mdao.testing import central_difference

BOTH = [CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS]


@dataclass(frozen=True)
class Counting:
    """A mover that counts its moves."""

    mover: object
    moves: list = field(default_factory=list)

    @property
    def mesh(self):
        return self.mover.mesh

    def move(self, initial, surface):
        self.moves.append(surface)
        return self.mover.move(initial, surface)


@pytest.fixture(scope="module")
def mesh():
    return moving_mesh(movable_model())


def problem_of(mover, **options) -> om.Problem:
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("move", ControlMeshMove(mover=mover, **options), promotes=["*"])
    problem.setup()
    return problem


def lifted(mesh, height):
    """Surface, flat, raised in its middle: beyond the row above it the mesh tangles."""
    surface = mesh.points[mesh.surface_ids].copy()
    inner = np.ptp(surface, axis=0)
    surface[:, 2] += height * np.prod(np.sin(np.pi * (surface - surface.min(axis=0))[:, :2] / inner[:2]), axis=1)
    return surface.ravel()


def move_to(problem, surface):
    problem.set_val(SURFACE_CONTROL_POINTS, surface)
    problem.run_model()
    return problem.get_val(CONTROL_POINTS).copy()


def test_the_mesh_starts_at_its_baseline(mesh):
    problem = problem_of(FixedInterior(mesh))
    problem.run_model()
    np.testing.assert_array_equal(problem.get_val(CONTROL_POINTS, units="m"), mesh.points.ravel())


def test_surface_points_go_where_they_are_asked_to(mesh):
    surface = lifted(mesh, 0.05)
    moved = move_to(problem_of(Shear(mesh)), surface).reshape(-1, 3)
    np.testing.assert_array_equal(moved[mesh.surface_ids].ravel(), surface)
    np.testing.assert_array_equal(moved[mesh.fixed_ids], mesh.points[mesh.fixed_ids])
    assert np.abs(moved - mesh.points)[mesh.is_free.any(axis=1)].max() > 1e-3


def test_a_move_is_made_once_for_run_and_all_derivatives(mesh):
    mover = Counting(Shear(mesh))
    problem = problem_of(mover)
    move_to(problem, lifted(mesh, 0.05))
    for mode in ("fwd", "rev"):
        seeds = {name: np.ones(problem.get_val(name).size) for name in (BOTH if mode == "fwd" else [CONTROL_POINTS])}
        problem.compute_jacvec_product([CONTROL_POINTS], BOTH, mode, seeds)
    problem.compute_totals([CONTROL_POINTS], [SURFACE_CONTROL_POINTS])
    assert len(mover.moves) == 1
    move_to(problem, lifted(mesh, 0.06))
    assert len(mover.moves) == 2


def test_moves_that_are_made_ahead_are_those_of_the_runs_that_ask_for_them_each_with_its_own_error():
    mesh = moving_mesh(fit_grid(flat_plate_grid((5, 5, 5))))
    at_rest = mesh.points[mesh.surface_ids]
    shears = [at_rest + np.outer(at_rest[:, 2], [0.0, slope, 0.0]) for slope in (0.1, 0.2, 0.05)]
    shears[1] += [0.0, 0.0, 0.1]  # out of the plane of symmetry
    surfaces = [shear.ravel() for shear in shears]
    problem, alone = problem_of(Rotations(mesh)), problem_of(Rotations(mesh))
    move = problem.model.move
    assert move.moves_together
    with move.noting() as requests:
        for surface in surfaces:
            with pytest.raises(om.AnalysisError, match="the move is noted"):
                move_to(problem, surface)
    move.move_ahead(requests)
    for surface in (surfaces[2], surfaces[0]):
        made = [movement for request, movement in move._ahead if np.array_equal(request[1].ravel(), surface)]
        found, expected = move_to(problem, surface), move_to(alone, surface)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * np.abs(expected).max())
        assert move.report is made[0].report
    errors = []
    for each in (problem, alone):
        with pytest.raises(om.AnalysisError) as error:
            move_to(each, surfaces[1])
        errors.append(str(error.value))
    assert errors[0] == errors[1]
    assert not move._ahead


def test_a_linearisation_at_other_inputs_is_right(mesh):
    """OpenMDAO may ask for products at inputs that were never run, and back again."""
    component = problem_of(Shear(mesh)).model.move
    rng = np.random.default_rng(1)
    d_surface, products = rng.standard_normal(3 * len(mesh.surface_ids)), {}
    for height in (0.05, 0.02, 0.05):
        inputs = {CONTROL_POINTS_INITIAL: mesh.points.ravel(), SURFACE_CONTROL_POINTS: lifted(mesh, height)}
        d_outputs = {CONTROL_POINTS: np.zeros(mesh.points.size)}
        component.compute_jacvec_product(inputs, {SURFACE_CONTROL_POINTS: d_surface}, d_outputs, "fwd")
        fresh = Shear(mesh).move(mesh.points, inputs[SURFACE_CONTROL_POINTS].reshape(-1, 3))
        exact = fresh.jvp(np.zeros_like(mesh.points), d_surface.reshape(-1, 3))
        np.testing.assert_array_equal(d_outputs[CONTROL_POINTS], exact.ravel())
        products.setdefault(height, []).append(d_outputs[CONTROL_POINTS])
    np.testing.assert_array_equal(*products[0.05])
    assert not np.array_equal(products[0.05][0], products[0.02][0])


def test_a_change_of_the_inputs_in_place_is_seen(mesh):
    """The vectors of OpenMDAO are written over; the last move must not hold on to them."""
    problem = problem_of(Shear(mesh))
    first, second = (move_to(problem, lifted(mesh, height)) for height in (0.05, 0.02))
    assert not np.array_equal(first, second)
    np.testing.assert_array_equal(move_to(problem, lifted(mesh, 0.05)), first)


def test_the_report_tells_of_every_increment(mesh):
    problem = problem_of(Shear(mesh, n_increments=3))
    assert problem.model.move.report is None
    move_to(problem, lifted(mesh, 0.05))
    report = problem.model.move.report
    assert len(report.increments) == 3
    assert report.first_tangled() is None
    assert report.increments[-1].min_corner > 0.0


def warnings_of(caplog):
    return [record.getMessage() for record in caplog.records if record.name == "bspline_mdao.core.om.control_mesh_move"]


def test_a_mesh_that_tangles_is_followed_and_the_log_names_the_worst_element_once(mesh, caplog):
    problem = problem_of(FixedInterior(mesh, n_increments=4))
    moved = move_to(problem, lifted(mesh, 0.6))
    assert mesh.tangled(moved.reshape(-1, 3)).n_tangled > 0
    number, first = problem.model.move.report.first_tangled()
    assert number > 1
    (warning,) = warnings_of(caplog)
    assert re.search(
        r"'move'.*increment \d of 4 inverts element \(\d+, \d+, 1\) of block \d .*control_corner_ks", warning
    )
    assert f"increment {number} of 4 inverts {first.place}" in warning
    assert "\n" not in warning
    move_to(problem, lifted(mesh, 0.7))
    assert len(warnings_of(caplog)) == 1
    move_to(problem, lifted(mesh, 0.05))
    move_to(problem, lifted(mesh, 0.6))
    assert len(warnings_of(caplog)) == 2


def test_a_mesh_that_does_not_tangle_is_no_warning(mesh, caplog):
    move_to(problem_of(FixedInterior(mesh)), lifted(mesh, 0.05))
    assert not warnings_of(caplog)


@pytest.mark.parametrize("height", [0.0, 0.05, 0.4, 0.9])
@pytest.mark.parametrize("rho", [20.0, 300.0])
def test_the_bound_is_below_the_worst_corner_of_the_control_mesh_by_no_more_than_its_sharpness_says(mesh, height, rho):
    problem = problem_of(FixedInterior(mesh), rho=rho)
    moved = move_to(problem, lifted(mesh, height)).reshape(-1, 3)
    least, bound = mesh.tangled(moved).min_corner, problem.get_val(CONTROL_CORNER_KS).item()
    assert least - np.log(8 * len(mesh.elements)) / rho <= bound < least


def test_elements_that_are_invalid_on_the_baseline_do_not_count(mesh):
    points = mesh.points.copy()
    inner = mesh.blocks[0][2, 2, 2]
    points[inner] = points[mesh.blocks[0][3, 3, 3]]
    points[inner] += 0.5 * (points[inner] - mesh.points[inner])
    folded = replace(mesh, points=points)
    assert 0 < folded.n_invalid < len(folded.elements)
    problem = problem_of(FixedInterior(folded))
    problem.run_model()
    least = folded.tangled(points).min_corner
    assert 0.0 < least < 1.0
    assert least - np.log(8 * len(folded.elements)) / 100.0 <= problem.get_val(CONTROL_CORNER_KS).item() <= least


def test_the_bound_is_that_of_the_same_mesh_as_a_grid(mesh):
    """Where all elements are valid, it is `corner_ks` of a grid of the control points."""
    quality = GridQuality.of_baseline(grid_of(*(mesh.points[ids] for ids in mesh.blocks)))
    problem = problem_of(FixedInterior(mesh))
    moved = move_to(problem, lifted(mesh, 0.3)).reshape(-1, 3)
    nodes = np.concatenate([moved[ids].reshape(-1, 3) for ids in mesh.blocks])
    expected = quality.evaluate(nodes, ["corner_ks"]).aggregates["corner_ks"]
    assert problem.get_val(CONTROL_CORNER_KS).item() == pytest.approx(expected, rel=1e-12)


def test_a_sharpness_that_is_not_positive_is_refused(mesh):
    with pytest.raises(InputError, match=r"'move'.*rho is -1.0; give a positive number"):
        problem_of(FixedInterior(mesh), rho=-1.0)


@pytest.mark.parametrize("kind", [FixedInterior, Shear, LinearElasticity])
@pytest.mark.parametrize("height", [0.05, 0.6])
def test_forward_and_reverse_derivatives_of_the_bound_are_transposes_and_those_of_differences(mesh, kind, height):
    """On tangled control meshes too: a constraint has to lead back from there."""
    problem, rng = problem_of(kind(mesh, n_increments=2), rho=30.0), np.random.default_rng(7)
    points = {
        CONTROL_POINTS_INITIAL: mesh.points.ravel() + 1e-3 * rng.standard_normal(mesh.points.size),
        SURFACE_CONTROL_POINTS: lifted(mesh, height) + 1e-3 * rng.standard_normal(3 * len(mesh.surface_ids)),
    }
    directions = {name: rng.standard_normal(values.size) for name, values in points.items()}

    def bound(step):
        for name, values in points.items():
            problem.set_val(name, values + step * directions[name])
        problem.run_model()
        return problem.get_val(CONTROL_CORNER_KS).copy()

    expected = central_difference(bound, 2e-4, levels=4)
    bound(0.0)
    forward = problem.compute_jacvec_product([CONTROL_CORNER_KS], BOTH, "fwd", directions)[CONTROL_CORNER_KS].item()
    np.testing.assert_allclose(forward, expected, rtol=1e-6)
    bars = problem.compute_jacvec_product([CONTROL_CORNER_KS], BOTH, "rev", {CONTROL_CORNER_KS: np.ones(1)})
    terms = [bars[name] @ directions[name] for name in BOTH]
    assert abs(sum(terms) - forward) < 1e-12 * sum(
        np.linalg.norm(bars[n]) * np.linalg.norm(directions[n]) for n in BOTH
    )
    assert min(map(abs, terms)) > 0.0


def test_a_bound_as_a_constraint_keeps_the_control_mesh_from_tangling(mesh):
    problem = height_problem(mesh, NLoptDriver(optimizer="LD_SLSQP"), upper=5.0)
    problem.model.add_constraint(CONTROL_CORNER_KS, lower=0.05)
    problem.setup()
    problem.set_val("h", 0.01)
    problem.run_driver()
    assert problem.get_val(CONTROL_CORNER_KS).item() == pytest.approx(0.05, abs=1e-5)
    assert problem.get_val("h").item() > 0.02
    assert mesh.tangled(problem.get_val(CONTROL_POINTS).reshape(-1, 3)).min_corner > 0.05


def test_a_mover_that_gives_up_is_an_analysis_error(mesh):
    class Stuck(Shear):
        def step(self, initial, before, surface):
            raise MovementError("elasticity: increment 1 has no solution; take a smaller step")

    problem = problem_of(Stuck(mesh))
    with pytest.raises(om.AnalysisError, match=r"'move'.*increment 1 has no solution"):
        problem.run_model()
    assert problem.model.move.report is None


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["fwd", "rev"])
def test_a_product_that_fails_is_an_analysis_error(mesh, mode, monkeypatch):
    problem = problem_of(LinearElasticity(mesh, n_increments=2, solver=ConjugateGradients()))
    move_to(problem, lifted(mesh, 0.05))
    monkeypatch.setattr(conjugate_gradient, "_iterate", lambda *arguments: (1e-7 * arguments[2], 1))
    seeds = {SURFACE_CONTROL_POINTS if mode == "fwd" else CONTROL_POINTS: np.ones(mesh.points.size)}
    seeds = {name: seed[: problem.get_val(name).size] for name, seed in seeds.items()}
    with pytest.raises(om.AnalysisError, match=r"'move'.*: conjugate gradients: the residual stays at"):
        problem.compute_jacvec_product([CONTROL_POINTS], [SURFACE_CONTROL_POINTS], mode, seeds)


def test_random_products_by_conjugate_gradients_at_their_defaults_are_those_of_a_direct_solver(mesh):
    def products(solver):
        problem, random = problem_of(LinearElasticity(mesh, n_increments=2, solver=solver)), np.random.default_rng(3)
        move_to(problem, lifted(mesh, 0.05))
        v, w = random.standard_normal((2, mesh.points.size))
        forward = problem.compute_jacvec_product([CONTROL_POINTS], BOTH[:1], "fwd", {CONTROL_POINTS_INITIAL: v})
        reverse = problem.compute_jacvec_product([CONTROL_POINTS], BOTH[:1], "rev", {CONTROL_POINTS: w})
        forward, reverse = forward[CONTROL_POINTS].ravel(), reverse[CONTROL_POINTS_INITIAL].ravel()
        assert abs(forward @ w - v @ reverse) < 1e-11 * np.linalg.norm(forward) * np.linalg.norm(w)
        return forward

    direct = products(Cholesky())
    np.testing.assert_allclose(products(ConjugateGradients()), direct, atol=1e-10 * np.abs(direct).max())


@pytest.mark.parametrize("mover", [FixedInterior, Shear])
def test_a_problem_recovers_from_an_infeasible_request(mesh, mover):
    problem, good = problem_of(mover(mesh)), lifted(mesh, 0.05)
    with pytest.raises(om.AnalysisError):
        move_to(problem, np.full(good.size, np.nan))
    move_to(problem, lifted(mesh, 5.0))
    after, fresh = move_to(problem, good), problem_of(mover(mesh))
    np.testing.assert_array_equal(after, move_to(fresh, good))
    totals = [p.compute_totals([CONTROL_POINTS], [SURFACE_CONTROL_POINTS]) for p in (problem, fresh)]
    np.testing.assert_array_equal(*(total[CONTROL_POINTS, SURFACE_CONTROL_POINTS] for total in totals))


def height_problem(mesh, driver, upper) -> om.Problem:
    """Raise the surface by one number as high as the driver dares; cells of the grid must not turn inside out."""
    problem = om.Problem(driver=driver, reports=False)
    start = lifted(mesh, 0.0)
    raised = om.ExecComp("s = s0 + h * d", s={"shape": start.size, "units": "m"}, s0=start, d=lifted(mesh, 1.0) - start)
    problem.model.add_subsystem("raise", raised, promotes=["h", ("s", SURFACE_CONTROL_POINTS)])
    movement = GridMovement(model=movable_model(), mover=FixedInterior(mesh), fit=False, quality=False)
    problem.model.add_subsystem("movement", movement, promotes=["*"])
    size = {"shape": mesh.points.size, "units": "m"}
    problem.model.add_subsystem("fall", om.ExecComp("f = -sum(b[2::3])", b=size), promotes=[("b", CONTROL_POINTS), "f"])
    problem.model.add_design_var("h", lower=0.0, upper=upper)
    problem.model.add_objective("f")
    problem.setup()
    problem.set_val("h", 0.01)
    return problem


@pytest.mark.slow
def test_an_optimizer_stops_with_the_error_and_the_problem_goes_on(mesh):
    """SLSQP of SciPy cannot back off, and OpenMDAO raises what a run raised when SLSQP is done."""
    problem = height_problem(mesh, om.ScipyOptimizeDriver(optimizer="SLSQP", disp=False), upper=0.6)
    with pytest.raises(
        om.AnalysisError, match=r"cell \(\d, \d, \d\) of block \d is inverted, .*lie on 'floor'.*smaller step"
    ):
        problem.run_driver()
    fresh = height_problem(mesh, om.ScipyOptimizeDriver(optimizer="SLSQP", disp=False), upper=0.6)
    for p in (problem, fresh):
        p.set_val("h", 0.05)
        p.run_model()
    np.testing.assert_array_equal(problem.get_val(CONTROL_POINTS), fresh.get_val(CONTROL_POINTS))
    np.testing.assert_array_equal(*(p.compute_totals()["f", "h"] for p in (problem, fresh)))


def test_an_optimizer_within_bounds_reaches_them(mesh):
    problem = height_problem(mesh, om.ScipyOptimizeDriver(optimizer="SLSQP", disp=False), upper=0.06)
    assert problem.run_driver().success
    assert problem.get_val("h").item() == pytest.approx(0.06)


def test_a_driver_that_backs_off_goes_on_to_the_next_case(mesh):
    cases = [[("h", 0.02)], [("h", 5.0)], [("h", 0.04)]]
    problem = height_problem(mesh, om.DOEDriver(om.ListGenerator(cases)), upper=6.0)
    successes = []
    problem.driver._run_solve_nonlinear = recorded(problem, problem.driver._run_solve_nonlinear, successes)
    problem.run_driver()
    assert [is_success for is_success, _ in successes] == [True, False, True]
    fresh = height_problem(mesh, None, upper=6.0)
    fresh.set_val("h", 0.04)
    fresh.run_model()
    np.testing.assert_array_equal(successes[-1][1], fresh.get_val(CONTROL_POINTS))


def recorded(problem, run, successes):
    def run_and_record():
        successes.append((False, None))
        run()
        successes[-1] = (True, problem.get_val(CONTROL_POINTS).copy())

    return run_and_record


def test_complex_step_is_refused_in_one_line(mesh):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("move", ControlMeshMove(mover=FixedInterior(mesh)), promotes=["*"])
    problem.setup(force_alloc_complex=True)
    problem.run_model()
    problem.check_partials(method="cs", out_stream=None)  # takes its own differences
    problem.model.move.set_check_partial_options("*", method="cs", directional=True)
    with pytest.raises(InputError, match=r"no complex step .* method='fd'"):
        problem.check_partials(out_stream=None)


@pytest.mark.parametrize("mover", [None, "elasticity", FixedInterior])
def test_what_is_no_mover_is_refused(mover):
    with pytest.raises(InputError, match=r"is no mover; give an object with mesh and move"):
        problem_of(mover)


@pytest.mark.slow
def test_a_difference_step_may_leave_a_symmetry_plane():
    mesh = moving_mesh(fit_grid(flat_plate_grid((9, 9, 9)), n_control=(5, 5, 5)))
    assert len(mesh.in_plane_rows)
    problem = problem_of(FixedInterior(mesh))
    problem.run_model()
    (checks,) = problem.check_partials(out_stream=None).values()
    check = checks[CONTROL_POINTS, SURFACE_CONTROL_POINTS]
    moved = check["J_fd"].reshape(-1, 3)[mesh.surface_ids]
    assert np.count_nonzero(moved) >= moved.size - 2  # coordinates next to a power of two may stay
    assert np.all(moved[mesh.points[mesh.surface_ids][:, 2] == 0.0] != 0.0)
    np.testing.assert_allclose(check["J_fwd"], check["J_fd"], atol=1e-7)
