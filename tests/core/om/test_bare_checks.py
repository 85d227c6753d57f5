"""``check_partials()`` and ``assert_check_partials`` without arguments pass on grids with viscous spacing."""

import numpy as np
import openmdao.api as om
import pytest
from component_cases import small_model
from euler_cases import with_guessed_patches
from openmdao.utils.assert_utils import assert_check_partials

from bspline_mdao import (
    ControlMeshMove,
    Fit,
    FittedModel,
    GridEvaluate,
    GridMovement,
    LiveGridEvaluate,
    PointSet,
    Quality,
    SurfaceControlFit,
    SurfaceEvaluate,
    SurfaceMeasure,
    fit_grid,
)
from bspline_mdao.generators import ball_grid
from bspline_mdao.grids.cells.aggregates import AGGREGATES
from bspline_mdao.grids.io.files import read_grid
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.measures import EnclosedVolume, SeamMeasure, SeamSmoothness, SurfaceGrid
from bspline_mdao.movers import LinearElasticity, TorsionalSprings, moving_mesh
from bspline_mdao.names import CONTROL_POINTS, GRID, SURFACE, SURFACE_CONTROL_POINTS
from bspline_mdao.testing import central_difference

FIRST_CELLS = (1e-5, 1e-6)


@pytest.fixture(scope="module", params=FIRST_CELLS)
def viscous(request) -> FittedModel:
    """Fit of a grid with first cells so high, 50 m wide."""
    return fit_grid(ball_grid((4, 5, 6, 10), far=25.0, off_wall=request.param))


def checked(component, seed: int = 0) -> dict:
    """What a user gets who calls ``check_partials`` on a component and asserts; none of it is empty or zero."""
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("checked", component)
    problem.setup()
    problem.run_model()
    np.random.seed(seed)  # noqa: NPY002 - where OpenMDAO draws the directions of checks
    found = problem.check_partials(out_stream=None)
    assert_check_partials(found)
    pairs = {pair: data for part in found.values() for pair, data in part.items()}
    assert pairs
    assert all(found.values())
    for pair, data in pairs.items():
        assert data["magnitude"].forward > 1e-3, pair
        assert data["magnitude"].fd > 1e-3, pair
    return pairs


def chain(model):
    return GridMovement(model=model, require_valid=False)


def sharp_quality(model):
    return Quality(model=model, aggregates=tuple(AGGREGATES), cells=True)


def elastic(model):
    return ControlMeshMove(mover=LinearElasticity(moving_mesh(model)))


def springs(model):
    return ControlMeshMove(mover=TorsionalSprings(moving_mesh(model)))


def surface(model):
    return SurfaceEvaluate(model=model, mesh=moving_mesh(model), surface=SurfaceGrid.of(model))


def surface_fit(model):
    return SurfaceControlFit(model=model, mesh=moving_mesh(model), surface=SurfaceGrid.of(model))


def given_walls(model):
    return GridEvaluate(model=model, surface=SurfaceGrid.of(model))


def volume(model):
    return SurfaceMeasure(measure=EnclosedVolume.of(SurfaceGrid.of(model)))


def seams(model):
    return SeamMeasure(measure=SeamSmoothness.kinks(model, moving_mesh(model), max_kink=170.0))


def points_at_walls(model):
    return PointSet(model=model, points=model.regenerate().blocks[0].nodes[1:-1, 1:-1, 1:-1].reshape(-1, 3))


def live_fit(model):
    return Fit(model=model, live=True)


def live_grid(model):
    return LiveGridEvaluate(model=model)


COMPONENTS = (
    chain,
    sharp_quality,
    elastic,
    surface,
    surface_fit,
    given_walls,
    volume,
    seams,
    points_at_walls,
    *(pytest.param(make, marks=pytest.mark.slow) for make in (springs, live_fit, live_grid)),
)


@pytest.mark.parametrize("make", COMPONENTS)
def test_a_bare_check_passes_next_to_viscous_walls(viscous, make):
    assert checked(make(viscous))


class BesideTheWall(GridEvaluate):
    """Products that are wrong by a hundredth at the node next to the wall, in both directions."""

    def compute_jacvec_product(self, inputs, d_inputs, d_outputs, mode):
        node = slice(3, 6)
        if mode == "rev":
            d_outputs[GRID][node] *= 1.0 + 1e-2
        super().compute_jacvec_product(inputs, d_inputs, d_outputs, mode)
        if mode == "fwd":
            d_outputs[GRID][node] *= 1.0 + 1e-2


def test_a_bare_check_finds_a_wrong_product_in_the_first_cell(viscous):
    heights = np.linalg.norm(np.diff(viscous.regenerate().blocks[0].nodes[0, 0], axis=0), axis=-1)
    assert heights[0] < 2e-5
    with pytest.raises(ValueError, match="grid wrt control_points"):
        checked(BesideTheWall(model=viscous))


@pytest.mark.parametrize("step", [1e-4, 1e-5])
def test_steps_that_a_user_sets_are_metres(step):
    problem, at = om.Problem(reports=None), []
    part = problem.model.add_subsystem("checked", Quality(model=small_model(), aggregates=["corner_ks"]))
    problem.setup()
    part.set_check_partial_options(GRID, step=step, directional=True)
    problem.run_model()
    start, compute = problem.get_val(f"checked.{GRID}").copy(), part.compute
    part.compute = lambda inputs, outputs: at.append(inputs[GRID].copy()) or compute(inputs, outputs)
    problem.check_partials(out_stream=None)
    moves = [np.abs(nodes - start).max() for nodes in at if not np.array_equal(nodes, start)]
    assert len(moves) == 2
    np.testing.assert_allclose(moves, step, rtol=0.05)


RELATIVES = {
    "GridEvaluate": (lambda model: GridEvaluate(model=model), CONTROL_POINTS, GRID),
    "SurfaceEvaluate": (surface, SURFACE_CONTROL_POINTS, SURFACE),
    "SurfaceControlFit": (surface_fit, SURFACE, SURFACE_CONTROL_POINTS),
    "PointSet": (points_at_walls, CONTROL_POINTS, "points"),
}


@pytest.mark.parametrize("name", RELATIVES)
def test_complex_steps_are_the_product_itself_which_runs_on_real_numbers_prove(name):
    make, wrt, of = RELATIVES[name]
    problem, random, step = om.Problem(reports=None), np.random.default_rng(7), 2.0**-60
    model = fit_grid(ball_grid((5, 6, 7, 8), far=5.0, off_wall=1e-2))
    problem.model.add_subsystem("checked", make(model), promotes=["*"])
    problem.setup(force_alloc_complex=True)
    problem.run_model()
    start = problem.get_val(wrt).copy()
    direction = random.standard_normal(start.size)

    def run(values):
        problem.set_val(wrt, values)
        problem.run_model()
        return problem.get_val(of).copy()

    product = problem.compute_jacvec_product([of], [wrt], "fwd", {wrt: direction})[of]
    problem.set_complex_step_mode(True)
    stepped = run(start + 1j * step * direction).imag / step
    problem.set_complex_step_mode(False)
    np.testing.assert_array_equal(stepped, product)
    difference = central_difference(lambda h: run(start + h * direction), 2e-4, levels=3)
    assert np.abs(product).max() > 0.1
    np.testing.assert_allclose(difference, product, atol=1e-9 * np.abs(product).max())


REAL_GRIDS = ("aither_rae2822.xyz", "mach_naca0012.cgns", "cfl3d_axibump.fmt")


def every_fourth(grid: Grid) -> Grid:
    """A grid of one block without most of its nodes along the wall; its cells are as high as they were."""
    (block,) = grid.blocks
    along = int(np.argmax(block.nodes.shape))
    nodes = block.nodes.take(range(0, block.nodes.shape[along], 4), axis=along)
    return Grid((Block(nodes, block.name),), source=grid.source)


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL_GRIDS)
def test_a_bare_check_passes_on_viscous_grids_of_other_projects(real_grids, name):
    grid = with_guessed_patches(every_fourth(read_grid(real_grids / name)))
    assert checked(chain(fit_grid(grid)))


def test_a_bare_check_leaves_collapsed_edges_alone():
    ends = ((0.0, 1.0, 7), (0.2, 1.0, 9), (0.0, 0.8, 7))
    x, angle, radius = np.meshgrid(*(np.linspace(*end) for end in ends), indexing="ij")
    nodes = np.stack([x, radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
    assert checked(live_fit(fit_grid(Grid((Block(nodes, "sector"),)))))
