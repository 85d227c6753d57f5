"""The OpenMDAO components agree with their kernels and their derivatives are exact."""

import importlib
import pkgutil
import tracemalloc

import numpy as np
import openmdao.api as om
import pytest
from cad_cases import body_of_walls
from component_cases import Heights, Lift, Shear, Swirl, movable_model, plain, small_model, two_blocks
from openmdao.utils.assert_utils import assert_check_partials
from riding_cases import joined

import bspline_mdao.core.om
from bspline_mdao.core.cad.tied_surface import TiedSurface
from bspline_mdao.core.design.cad_variables import CadPoints
from bspline_mdao.core.design.interior_points import InteriorPoints
from bspline_mdao.core.design.parametrization import Parametrization
from bspline_mdao.core.fit.fitting import fit_grid
from bspline_mdao.core.fit.least_squares import FitOperator
from bspline_mdao.core.measures.seam_smoothness import SeamSmoothness
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.mesh.surface import SurfaceGrid
from bspline_mdao.core.movement.elasticity import LinearElasticity
from bspline_mdao.core.movement.fixed_interior import FixedInterior
from bspline_mdao.core.movement.inverse_distance import InverseDistance
from bspline_mdao.core.movement.rotations import Rotations
from bspline_mdao.core.movement.springs import TorsionalSprings
from bspline_mdao.core.movement.transfinite import Transfinite
from bspline_mdao.core.om.cad_walls import CadWalls
from bspline_mdao.core.om.component import SparseComponent
from bspline_mdao.core.om.control_mesh_move import ControlMeshMove
from bspline_mdao.core.om.fit import Fit
from bspline_mdao.core.om.grid_evaluate import GridEvaluate
from bspline_mdao.core.om.interior_control import InteriorControl
from bspline_mdao.core.om.live_grid_evaluate import LiveGridEvaluate
from bspline_mdao.core.om.monotonic import Monotonic
from bspline_mdao.core.om.moved_points import MovedPoints
from bspline_mdao.core.om.point_set import PointSet
from bspline_mdao.core.om.quality import Quality
from bspline_mdao.core.om.ride import Ride
from bspline_mdao.core.om.seam_measure import SeamMeasure
from bspline_mdao.core.om.surface_control import SurfaceControl
from bspline_mdao.core.om.surface_control_fit import SurfaceControlFit
from bspline_mdao.core.om.surface_evaluate import SurfaceEvaluate
from bspline_mdao.core.om.surface_measure import SurfaceMeasure
from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.mixed_cells import MixedMesh
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.grids.topology.sharing import node_sharing
from bspline_mdao.names import (
    CONTROL_POINTS,
    CONTROL_POINTS_INITIAL,
    GRID,
    GRID_INITIAL,
    SURFACE,
    SURFACE_CONTROL_POINTS,
)
from bspline_mdao.testing import central_difference


def of(mover):
    """What makes a mover of a model."""
    return lambda model: mover(moving_mesh(model))


def parametrization(model):
    return Parametrization(moving_mesh(model), [Swirl("swirl", 5), Lift("lift")])


def points_of_faces(model):
    """Control points of faces that the walls are tied to."""
    return [CadPoints("faces", TiedSurface.of(model, body_of_walls(model, 1e-3)), direction="yz")]


def inner_points(model):
    return [InteriorPoints("inner")]


def most_nodes(model):
    """Numbers of most nodes of the surface, in disorder."""
    n = SurfaceGrid.of(model).n_points
    return np.random.default_rng(3).permutation(n)[n // 10 :]


def spline_cells(model):
    """The grid of a model as a mesh that rides."""
    points, cells = joined(model.regenerate())
    return MixedMesh(points, {"hexahedron": cells})


def wall_nodes(model):
    return SurfaceGrid.of(model).points[::3]


def heights(model):
    return Heights(SurfaceGrid.of(model))


def seam_kinks(model):
    return SeamSmoothness.kinks(model, moving_mesh(model), max_kink=170.0)


def seam_jumps(model):
    return SeamSmoothness.curvature_jumps(model, moving_mesh(model), max_kink=170.0)


PARTIALS = {
    "CadWalls": (CadWalls, {"variables": points_of_faces}, SURFACE, "faces"),
    "Fit": (Fit, {}, CONTROL_POINTS_INITIAL, GRID_INITIAL),
    "Fit live": (Fit, {"live": True}, CONTROL_POINTS_INITIAL, GRID_INITIAL),
    "GridEvaluate": (GridEvaluate, {}, GRID, CONTROL_POINTS),
    "GridEvaluate assembled": (GridEvaluate, {"assembled": True}, GRID, CONTROL_POINTS),
    "LiveGridEvaluate, control points": (LiveGridEvaluate, {}, GRID, CONTROL_POINTS),
    "LiveGridEvaluate, fitted control points": (LiveGridEvaluate, {}, GRID, CONTROL_POINTS_INITIAL),
    "LiveGridEvaluate, grid": (LiveGridEvaluate, {}, GRID, GRID_INITIAL),
    **{
        f"ControlMeshMove, {mover.__name__}, {wrt}": (ControlMeshMove, {"mover": of(mover)}, CONTROL_POINTS, wrt)
        for mover in (LinearElasticity, Rotations, TorsionalSprings, Transfinite, InverseDistance, FixedInterior, Shear)
        for wrt in (CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS)
    },
    **{
        f"InteriorControl, {wrt}": (InteriorControl, {"variables": inner_points}, CONTROL_POINTS, wrt)
        for wrt in ("inner", CONTROL_POINTS_INITIAL)
    },
    "Quality, cells": (Quality, {"cells": True}, "cell_quality", GRID),
    **{
        f"SurfaceControl, {wrt}": (SurfaceControl, {"parametrization": parametrization}, SURFACE_CONTROL_POINTS, wrt)
        for wrt in ("swirl", "lift", CONTROL_POINTS_INITIAL)
    },
    "SurfaceEvaluate": (
        SurfaceEvaluate,
        {"mesh": moving_mesh, "surface": SurfaceGrid.of},
        SURFACE,
        SURFACE_CONTROL_POINTS,
    ),
    **{
        f"SurfaceControlFit, {name}": (
            SurfaceControlFit,
            {"mesh": moving_mesh, "surface": SurfaceGrid.of, **options},
            SURFACE_CONTROL_POINTS,
            SURFACE,
        )
        for name, options in {"all nodes": {}, "some nodes": {"numbers": most_nodes}}.items()
    },
    **{
        f"GridEvaluate, asked for the wall, {wrt}": (GridEvaluate, {"surface": SurfaceGrid.of, **options}, GRID, wrt)
        for wrt, options in {SURFACE: {}, CONTROL_POINTS: {"numbers": most_nodes}}.items()
    },
    "PointSet": (PointSet, {"points": wall_nodes}, "points", SURFACE),
    **{
        f"Ride, {wrt}": (Ride, {"mesh": spline_cells, "asked": wrt == "wall"}, "mesh", wrt)
        for wrt in (CONTROL_POINTS, "wall")
    },
    "SurfaceMeasure": (SurfaceMeasure, {"measure": heights}, "heights", SURFACE),
    "SeamMeasure": (SeamMeasure, {"measure": seam_kinks}, "seam_kinks", SURFACE_CONTROL_POINTS),
    "SeamMeasure of curvature": (SeamMeasure, {"measure": seam_jumps}, "seam_curvature_jumps", SURFACE_CONTROL_POINTS),
    "Monotonic": (Monotonic, {"variable": "twist", "size": 6}, "twist_differences", "twist"),
    "Monotonic decreasing": (
        Monotonic,
        {"variable": "chord", "size": 7, "units": "m", "decreasing": True},
        "chord_differences",
        "chord",
    ),
}
"""Every component in every mode: class, options (or what makes them of a model), output, input."""

AWAY = {
    LiveGridEvaluate: [CONTROL_POINTS],
    ControlMeshMove: [SURFACE_CONTROL_POINTS],
    SurfaceControl: ["swirl", "lift"],
}
"""Inputs that start away from the baseline, so that all terms of the derivative matter."""

every_component = pytest.mark.parametrize(("component", "options", "of", "wrt"), PARTIALS.values(), ids=PARTIALS)


@pytest.fixture(scope="module")
def model():
    return movable_model()


def run_problem(component, model, **options) -> om.Problem:
    problem = om.Problem(reports=False)
    options = {name: option(model) if callable(option) else option for name, option in options.items()}
    if "model" in component().options:
        options["model"] = plain(model) if options.get("assembled") else model
    problem.model.add_subsystem("component", component(**options), promotes=["*"])
    problem.setup(force_alloc_complex=True)
    for name in AWAY.get(component, []):
        value = problem.get_val(name)
        problem.set_val(name, value + np.random.default_rng(7).normal(scale=0.02, size=value.shape))
    problem.run_model()
    return problem


def products(problem, of, wrt, forward_seed, reverse_seed):
    """Jacobian times one seed and transposed Jacobian times another."""
    problem.model.run_linearize()
    forward = problem.compute_jacvec_product([of], [wrt], "fwd", {wrt: forward_seed})[of]
    reverse = problem.compute_jacvec_product([of], [wrt], "rev", {of: reverse_seed})[wrt]
    return forward.ravel(), reverse.ravel()


def test_every_component_is_in_the_partials_table():
    shipped = set()
    for module in pkgutil.iter_modules(bspline_mdao.core.om.__path__):
        contents = vars(importlib.import_module(f"bspline_mdao.core.om.{module.name}")).values()
        shipped |= {
            c for c in contents if isinstance(c, type) and issubclass(c, om.ExplicitComponent | om.ImplicitComponent)
        }
    assert shipped - {om.ExplicitComponent, om.ImplicitComponent, SparseComponent, MovedPoints} == {
        case[0] for case in PARTIALS.values()
    }


@pytest.mark.slow
@every_component
def test_forward_and_reverse_products_are_transposes(model, component, options, of, wrt):
    rng = np.random.default_rng(1)
    problem = run_problem(component, model, **options)
    problem.set_val(wrt, problem.get_val(wrt) + 1e-3 * rng.standard_normal(problem.get_val(wrt).shape))
    problem.run_model()
    v, w = rng.standard_normal(problem.get_val(wrt).size), rng.standard_normal(problem.get_val(of).size)
    forward, reverse = products(problem, of, wrt, v, w)
    assert np.linalg.norm(forward) > 0.1
    scale = np.linalg.norm(forward) * np.linalg.norm(w)
    assert abs(forward @ w - v @ reverse) < 1e-12 * scale


@pytest.mark.slow
@every_component
def test_products_are_directional_derivatives(model, component, options, of, wrt):
    rng = np.random.default_rng(2)
    problem = run_problem(component, model, **options)
    start, v = problem.get_val(wrt).copy(), rng.standard_normal(problem.get_val(wrt).size)
    forward, _ = products(problem, of, wrt, v, np.zeros(problem.get_val(of).size))

    def output(step):
        problem.set_val(wrt, start + step * v)
        problem.run_model()
        return problem.get_val(of).ravel().copy()

    if problem.model.component.is_linear:
        difference = output(0.5) - output(-0.5)  # exact for a linear map, whatever the step
    else:
        difference = central_difference(output, 4e-3, levels=5)
    assert np.abs(difference - forward).max() < 1e-10 * np.abs(forward).max()


@every_component
def test_a_bare_check_partials_takes_one_direction_in_each_input_and_finds_no_fault(
    model, component, options, of, wrt, monkeypatch
):
    problem, runs = run_problem(component, model, **options), []
    compute = component.compute
    monkeypatch.setattr(component, "compute", lambda *arguments: runs.append(1) or compute(*arguments))
    np.random.seed(4)  # noqa: NPY002 - the generator that OpenMDAO takes directions from
    checked = problem.check_partials(out_stream=None)
    assert_check_partials(checked)
    checked = checked["component"][of, wrt]
    assert checked["J_fd"].shape == (problem.get_val(of).size, 1)
    assert np.abs(checked["J_fd"]).max() > 0.1
    assert len(runs) <= 2 + 4 * len(problem.model.component.list_inputs(out_stream=None))
    forward, reverse = checked["directional_fwd_rev"]
    assert abs(forward - reverse) < 1e-10 * np.linalg.norm(checked["J_fwd"]) * np.sqrt(len(checked["J_fwd"]))


class Tilted(Heights):
    """A user's own measure with one wrong derivative."""

    def partials(self, points):
        matrix = super().partials(points)
        matrix.data[7] *= 1.0 + 1e-3
        return matrix


def test_a_bare_check_partials_finds_one_wrong_entry_of_a_sparse_jacobian(model):
    problem = run_problem(SurfaceMeasure, model, measure=Tilted(SurfaceGrid.of(model)))
    with pytest.raises(ValueError, match="heights wrt surface"):
        assert_check_partials(problem.check_partials(out_stream=None))


def test_a_check_leaves_the_declared_jacobian_as_it_was(model):
    problem = run_problem(SurfaceMeasure, model, measure=heights(model))
    before = problem.compute_totals(["heights"], [SURFACE])["heights", SURFACE]
    problem.check_partials(out_stream=None)
    assert not problem.model.component.matrix_free
    np.testing.assert_array_equal(problem.compute_totals(["heights"], [SURFACE])["heights", SURFACE], before)
    assert np.count_nonzero(before)


@pytest.mark.parametrize("case", ["Fit", "GridEvaluate"])
def test_linear_products_are_those_of_both_parts_under_complex_step(model, case):
    component, options, of, wrt = PARTIALS[case]
    problem, random = run_problem(component, model, **options), np.random.default_rng(12)
    sizes = {name: problem.get_val(name).size for name in (of, wrt)}
    for mode, seed_of, result_of in (("fwd", wrt, of), ("rev", of, wrt)):
        seed = random.standard_normal(sizes[seed_of]) + 1j * random.standard_normal(sizes[seed_of])

        def product(part, seed_of=seed_of, result_of=result_of, mode=mode):
            vectors = {seed_of: part, result_of: np.zeros(sizes[result_of], dtype=part.dtype)}
            problem.model.component.compute_jacvec_product({wrt: problem.get_val(wrt)}, vectors, vectors, mode)
            return vectors[result_of]

        np.testing.assert_array_equal(product(seed), product(seed.real) + 1j * product(seed.imag))


@pytest.mark.parametrize("case", ["SurfaceMeasure", "SurfaceControl, swirl"])
def test_partials_that_vary_are_refused_under_complex_step(model, case):
    component, options, _, _ = PARTIALS[case]
    problem = run_problem(component, model, **options)
    problem.set_complex_step_mode(True)
    with pytest.raises(InputError, match=r"no complex step .* method='fd'"):
        problem.model.run_linearize()


@pytest.mark.slow
def test_totals_by_complex_steps_through_linear_components_are_exact(model):
    def totals(method):
        problem, size = om.Problem(reports=False), {"shape": 3 * model.n_nodes, "units": "m"}
        problem.model.add_subsystem("bend", om.ExecComp("x = a**2 * x_0", x=size, x_0=size, a=1.3))
        problem.model.connect("bend.x", GRID_INITIAL)
        problem.model.add_subsystem("fit", Fit(model=model), promotes=["*"])
        problem.model.add_subsystem("evaluate", GridEvaluate(model=model), promotes_outputs=["*"])
        problem.model.connect(CONTROL_POINTS_INITIAL, f"evaluate.{CONTROL_POINTS}")
        problem.model.add_subsystem("size", om.ExecComp("f = sum(x**2)", x=size))
        problem.model.connect(GRID, "size.x")
        if method:
            problem.model.approx_totals(method=method)
        problem.setup(force_alloc_complex=True)
        problem.set_val("bend.x_0", two_blocks().to_vector())
        problem.run_model()
        return problem.compute_totals(["size.f"], ["bend.a"])["size.f", "bend.a"].item()

    assert abs(totals("cs") - totals(None)) <= 1e-12 * abs(totals(None)) > 0.0


def test_totals_by_complex_steps_with_a_coloring_are_refused_in_one_line(model):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("quality", Quality(model=model), promotes=["*"])
    problem.model.add_objective("quality_ks")
    problem.model.add_design_var(GRID)
    problem.model.approx_totals(method="cs")
    problem.model.declare_coloring(method="cs", show_summary=False)
    problem.setup(force_alloc_complex=True)
    problem.run_model()
    with pytest.raises(InputError, match=r"no complex step .* method='fd'"):
        problem.compute_totals()


@pytest.mark.slow
def test_the_assembled_jacobian_is_the_matrix_free_one(model):
    totals = [
        run_problem(GridEvaluate, plain(model), assembled=assembled).compute_totals([GRID], [CONTROL_POINTS])
        for assembled in (False, True)
    ]
    matrix_free, assembled = (total[GRID, CONTROL_POINTS] for total in totals)
    np.testing.assert_allclose(assembled, matrix_free, atol=1e-15)


def test_a_matrix_of_a_map_that_is_not_linear_is_refused(model):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("evaluate", GridEvaluate(model=model, assembled=True))
    with pytest.raises(InputError, match=r"assembled=True needs a linear map; fit the grid with wall_layer=False"):
        problem.setup()


@pytest.mark.parametrize("options", [{}, {"corrections": 2}, {"method": "quasi_interpolant"}])
def test_fit_reproduces_the_control_points_of_the_model(options):
    model = small_model(**options)
    problem = run_problem(Fit, model)
    np.testing.assert_allclose(problem.get_val(CONTROL_POINTS_INITIAL), model.control_points.ravel(), atol=1e-13)


@pytest.mark.parametrize("keep_residual", [True, False])
def test_grid_evaluate_regenerates_what_the_model_does(keep_residual):
    model = small_model(keep_residual=keep_residual)
    problem = run_problem(GridEvaluate, model)
    moved = model.control_points + np.random.default_rng(3).normal(scale=0.01, size=model.control_points.shape)
    problem.set_val(CONTROL_POINTS, moved.ravel())
    problem.run_model()
    np.testing.assert_array_equal(problem.get_val(GRID), model.regenerate(moved).to_vector())


def chain(model, growth=1.0, **fit_options) -> om.Problem:
    """From the baseline grid through the fit, a growth of the control points and the evaluation to a number."""
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("fit", Fit(model=model, **fit_options), promotes=["*"])
    evaluate = LiveGridEvaluate if fit_options.get("live") else GridEvaluate
    size = {"shape": model.control_points.size, "units": "m"}
    problem.model.add_subsystem("move", om.ExecComp(f"b = {growth} * b_0", has_diag_partials=True, b=size, b_0=size))
    problem.model.connect(CONTROL_POINTS_INITIAL, "move.b_0")
    problem.model.add_subsystem("evaluate", evaluate(model=model), promotes_outputs=["*"])
    problem.model.connect("move.b", f"evaluate.{CONTROL_POINTS}")
    if evaluate is LiveGridEvaluate:
        problem.model.promotes("evaluate", inputs=[GRID_INITIAL, CONTROL_POINTS_INITIAL])
    problem.model.add_subsystem("size", om.ExecComp("f = sum(x**2)", x={"shape": 3 * model.n_nodes, "units": "m"}))
    problem.model.connect(GRID, "size.x")
    problem.setup()
    problem.run_model()
    problem.model.run_linearize()
    return problem


@pytest.mark.parametrize(("mode", "seed_of", "result_of"), [("fwd", GRID_INITIAL, GRID), ("rev", GRID, GRID_INITIAL)])
def test_the_total_of_the_chain_is_a_projection(model, mode, seed_of, result_of):
    """What the splines can represent is fitted by itself, so that applying the total twice changes nothing."""
    problem = chain(plain(model))

    def total(seed):
        return problem.compute_jacvec_product([GRID], [GRID_INITIAL], mode, {seed_of: seed})[result_of]

    once = total(np.random.default_rng(4).standard_normal(3 * model.n_nodes))
    assert np.linalg.norm(once) > 1.0
    np.testing.assert_allclose(total(once), once, atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("live", [False, True])
def test_taylor_remainder_of_the_totals_is_of_second_order(model, live):
    problem = chain(model, growth=1.3, live=live)
    start, value = problem.get_val(GRID_INITIAL).copy(), problem.get_val("size.f").item()
    v = np.random.default_rng(5).standard_normal(start.size)
    slope = (problem.compute_totals(["size.f"], [GRID_INITIAL])["size.f", GRID_INITIAL] @ v).item()
    steps, remainders = 1e-3 / 2.0 ** np.arange(4), []
    for step in steps:
        problem.set_val(GRID_INITIAL, start + step * v)
        problem.run_model()
        remainders.append(abs(problem.get_val("size.f").item() - value - step * slope))
    rates = np.log2(np.array(remainders[:-1]) / remainders[1:])
    assert (rates > 1.9).all()


@pytest.mark.slow
@pytest.mark.parametrize("component", [Fit, GridEvaluate, LiveGridEvaluate])
def test_matrix_free_components_hold_no_jacobian(component):
    """OpenMDAO allocates a full matrix for every declared partial that is not sparse, here 11 GB."""
    nodes = np.stack(np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in (33, 29, 25)), indexing="ij"), axis=-1)
    model = fit_grid(Grid((Block(nodes, "block 1"),)), n_control=(18, 17, 16))
    tracemalloc.start()
    problem = run_problem(component, model)
    problem.setup()
    problem.final_setup()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1e9


@every_component
def test_a_number_that_is_not_finite_is_an_analysis_error(model, component, options, of, wrt):
    problem = run_problem(component, model, **options)
    problem.set_val(wrt, np.nan, indices=4)
    with pytest.raises(om.AnalysisError, match=rf"{wrt}\[4\](, y of point 2,)? is nan"):
        problem.run_model()


@every_component
def test_a_vector_of_the_wrong_size_is_refused(model, component, options, of, wrt):
    problem = run_problem(component, model, **options)
    with pytest.raises(ValueError, match="shape"):
        problem.set_val(wrt, np.zeros(11))


@pytest.mark.parametrize("component", [Fit, GridEvaluate, LiveGridEvaluate])
def test_a_model_of_another_type_is_refused(component):
    with pytest.raises(TypeError, match="model"):
        component(model="wing.h5")


def test_a_grid_that_stays_is_fitted_once(model, monkeypatch):
    fitted, forward = [], FitOperator.forward

    def counted(operator, nodes):
        fitted.append(nodes)
        return forward(operator, nodes)

    monkeypatch.setattr(FitOperator, "forward", counted)
    problem = run_problem(Fit, model)
    first = problem.get_val("control_points_initial").copy()
    for _ in range(2):
        problem.run_model()
    still = problem.compute_jacvec_product(
        ["control_points_initial"], ["grid_initial"], "fwd", {"grid_initial": np.zeros(model.n_nodes * 3)}
    )
    assert len(fitted) == 1
    assert not still["control_points_initial"].any()
    problem.set_val("grid_initial", 2.0 * problem.get_val("grid_initial"))
    problem.run_model()
    np.testing.assert_allclose(problem.get_val("control_points_initial"), 2.0 * first, rtol=1e-12, atol=1e-12)
    assert len(fitted) == 2


def test_live_grid_evaluate_regenerates_the_baseline_it_is_given(model):
    """Not only that of the model: with the control points unmoved, any grid comes back."""
    problem = run_problem(LiveGridEvaluate, model)
    other = problem.get_val(GRID_INITIAL) + np.random.default_rng(8).normal(scale=0.01, size=3 * model.n_nodes)
    copies = node_sharing(model.topology).copies
    other.reshape(-1, 3)[copies[:, 0]] = other.reshape(-1, 3)[copies[:, 1]]
    problem.set_val(GRID_INITIAL, other)
    problem.set_val(CONTROL_POINTS, problem.get_val(CONTROL_POINTS_INITIAL))
    problem.run_model()
    np.testing.assert_allclose(problem.get_val(GRID), other, atol=1e-14)


def test_live_grid_evaluate_without_a_residual_is_the_mapping_alone():
    model = small_model(keep_residual=False)
    problem = run_problem(LiveGridEvaluate, model)
    problem.set_val(GRID_INITIAL, two_blocks().to_vector())
    problem.set_val(CONTROL_POINTS, model.control_points.ravel())
    problem.run_model()
    assert CONTROL_POINTS_INITIAL not in problem.model.component._var_rel_names["input"]
    np.testing.assert_allclose(problem.get_val(GRID), model.regenerate().to_vector(), atol=1e-13)
    v, w = np.random.default_rng(9).standard_normal((2, 3 * model.n_nodes))
    forward, reverse = products(problem, GRID, GRID_INITIAL, v, w)
    assert abs(forward @ w - v @ reverse) < 1e-12 * np.linalg.norm(forward) * np.linalg.norm(w)


def test_frozen_components_say_that_they_are_linear(model):
    assert run_problem(Fit, model).model.component.is_linear
    assert run_problem(GridEvaluate, plain(model)).model.component.is_linear
    assert not run_problem(GridEvaluate, model).model.component.is_linear
    assert not run_problem(Fit, model, live=True).model.component.is_linear


def test_frozen_products_do_not_depend_on_the_input(model):
    v = np.random.default_rng(6).standard_normal(3 * model.n_nodes)
    problem = run_problem(Fit, model)
    before, _ = products(problem, CONTROL_POINTS_INITIAL, GRID_INITIAL, v, np.zeros(model.control_points.size))
    problem.set_val(GRID_INITIAL, problem.get_val(GRID_INITIAL) + v)
    problem.run_model()
    after, _ = products(problem, CONTROL_POINTS_INITIAL, GRID_INITIAL, v, np.zeros(model.control_points.size))
    np.testing.assert_array_equal(before, after)


class Moody(Heights):
    """A user's own measure that drops what is zero on the baseline."""

    def partials(self, points):
        matrix = super().partials(points)
        if np.array_equal(points, self.surface.points):
            matrix.data[5] = 0.0
            matrix.eliminate_zeros()
        return matrix


def test_a_pattern_that_changes_is_refused(model):
    problem = run_problem(SurfaceMeasure, model, measure=Moody(SurfaceGrid.of(model)))
    problem.set_val(SURFACE, problem.get_val(SURFACE) + 0.1)
    problem.run_model()
    with pytest.raises(InputError, match=r"'heights': the derivative of entry 3 in entry \d+ was not in the pattern"):
        problem.model.run_linearize()
