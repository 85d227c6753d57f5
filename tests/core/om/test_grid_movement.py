"""The whole chain in one group: names, initial values, totals and what is refused."""

import io

import numpy as np
import openmdao.api as om
import pytest
from component_cases import Heights, Shear, Swirl, movable_model, small_model
from mesh_cases import mesh_around_a_body

from bspline_mdao import DesignSurface, NLoptDriver, fit_grid
from bspline_mdao.core.design.parametrization import Parametrization
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.mesh.surface import SurfaceGrid
from bspline_mdao.core.movement.elasticity import LinearElasticity
from bspline_mdao.core.movement.inverse_distance import InverseDistance
from bspline_mdao.core.movement.rotations import Rotations
from bspline_mdao.core.om.grid_movement import GridMovement
from bspline_mdao.design import Local, Twist
from bspline_mdao.errors import InputError
from bspline_mdao.generators import Spacing, flat_plate_grid, infinite_wing_grid, naca_section
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import judge_move
from bspline_mdao.grids.topology.partition import Subdomain
from bspline_mdao.measures import EnclosedVolume, SurfaceArea
from bspline_mdao.meshes import LatticeSettings, MeshModel, MixedMesh
from bspline_mdao.names import (
    CONTROL_CORNER_KS,
    CONTROL_POINTS,
    CONTROL_POINTS_INITIAL,
    GRID,
    GRID_INITIAL,
    SURFACE,
    SURFACE_CONTROL_POINTS,
)
from bspline_mdao.testing import central_difference, check_totals


@pytest.fixture(scope="module")
def plate():
    """Wing grid of twelve blocks with a symmetry plane."""
    return fit_grid(flat_plate_grid((9, 8, 7)))


def problem_of(model, **options) -> om.Problem:
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("grid_movement", GridMovement(model=model, **options), promotes=["*"])
    problem.model.add_subsystem("size", om.ExecComp("f = sum(x**2)", x={"shape": 3 * model.n_nodes, "units": "m"}))
    problem.model.connect(GRID, "size.x")
    problem.setup()
    problem.run_model()
    return problem


@pytest.mark.slow
def test_the_table_of_wrong_partials_is_empty_with_the_tolerance_of_the_page(plate):
    wing, listed = DesignSurface.of(plate), io.StringIO()
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("shape", wing.grid_movement([Twist("twist", wing.axis, stations=3)]), promotes=["*"])
    problem.setup(mode="rev")
    problem.set_val("twist", [0.0, 1.0, 2.0])
    problem.run_model()
    problem.check_partials(abs_err_tol=1e-6, show_only_incorrect=True, out_stream=listed)
    assert listed.getvalue().strip() == ""
    problem.check_partials(show_only_incorrect=True, out_stream=listed)  # each entry within 1e-6 of itself
    assert "incorrect" in listed.getvalue()


def bent(model, amount=0.05):
    """Surface control points bent about the root, those on the symmetry plane in it."""
    mesh = moving_mesh(model)
    surface = model.control_points[mesh.surface_ids].copy()
    surface[:, 1] += amount * surface[:, 2] ** 2
    return surface.ravel()


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"fit": False}, {"live": True}, {"quality": False}, {"mover": Shear}])
def test_the_first_run_gives_the_baseline(plate, options):
    if "mover" in options:
        options = {"mover": options["mover"](moving_mesh(plate))}
    problem = problem_of(plate, **options)
    np.testing.assert_allclose(problem.get_val(GRID, units="m"), plate.regenerate().to_vector(), atol=1e-13)


@pytest.mark.slow
def test_the_chain_is_that_of_the_picture(plate):
    model = problem_of(plate).model
    names = [system.name for system in model.grid_movement.system_iter(recurse=False)]
    assert names == ["fit", "move", "evaluate", "quality"]
    outputs, inputs = (
        {meta["prom_name"] for _, meta in variables(prom_name=True, val=False, out_stream=None)}
        for variables in (model.list_outputs, model.list_inputs)
    )
    assert {CONTROL_POINTS_INITIAL, CONTROL_POINTS, GRID, "quality_ks"} <= outputs
    assert inputs - outputs == {GRID_INITIAL, SURFACE_CONTROL_POINTS, "size.x"}


@pytest.mark.slow
def test_bounds_of_the_quality_can_be_named(plate):
    problem = problem_of(plate, quality=("height_low_ks", "height_high_ks"))
    assert 0.99 < problem.get_val("height_low_ks").item() < 1.0 < problem.get_val("height_high_ks").item() < 1.01
    with pytest.raises(KeyError):
        problem.get_val("quality_ks")


@pytest.mark.slow
def test_the_chain_with_variables_and_measures_is_that_of_the_picture(plate):
    parametrization = Parametrization(moving_mesh(plate), [Swirl("swirl", 2)])
    model = problem_of(plate, parametrization=parametrization, measures=[Heights(SurfaceGrid.of(plate))]).model
    names = [system.name for system in model.grid_movement.system_iter(recurse=False)]
    assert names == ["fit", "control", "evaluate_surface", "measure_heights", "move", "evaluate", "quality"]
    read, written = (
        {meta["prom_name"] for _, meta in variables(prom_name=True, val=False, out_stream=None)}
        for variables in (model.list_inputs, model.list_outputs)
    )
    assert read - written == {GRID_INITIAL, "swirl", "size.x"}
    assert {SURFACE_CONTROL_POINTS, SURFACE, "heights"} <= written


@pytest.mark.slow
def test_the_surface_is_that_of_the_grid(plate):
    surface = SurfaceGrid.of(plate)
    problem = problem_of(
        plate, parametrization=Parametrization(moving_mesh(plate), [Swirl("swirl", 2)]), measures=[Heights(surface)]
    )
    problem.set_val("swirl", [0.05, 0.02])
    problem.run_model()
    moved = problem.get_val(GRID).reshape(-1, 3)[surface.rows]
    assert np.abs(moved - surface.points).max() > 0.05
    np.testing.assert_allclose(problem.get_val(SURFACE).reshape(-1, 3), moved, atol=1e-14)


def waved(surface):
    """Nodes of a surface that no control points have, those on the symmetry plane in it."""
    nodes = surface.points.copy()
    nodes[:, 1] += 0.1 * nodes[:, 2] ** 2 + 0.004 * np.sin(9.0 * nodes[:, 0]) * np.cos(7.0 * nodes[:, 2])
    return nodes


def test_the_chain_of_given_nodes_measures_them_and_meets_them(plate):
    surface = SurfaceGrid.of(plate)
    problem = problem_of(plate, surface=surface, measures=[Heights(surface)])
    group = problem.model.grid_movement
    names = [system.name for system in group.system_iter(recurse=False)]
    assert names == ["fit", "fit_surface", "measure_heights", "move", "evaluate", "quality"]
    np.testing.assert_allclose(problem.get_val(GRID, units="m"), plate.regenerate().to_vector(), atol=1e-13)
    nodes = waved(surface)
    problem.set_val(SURFACE, nodes.ravel())
    problem.run_model()
    grid = problem.get_val(GRID).reshape(-1, 3)
    np.testing.assert_allclose(grid[surface.rows], nodes, rtol=0, atol=1e-12)
    assert 1e-3 < group.fit_surface.miss.largest < 0.05
    quality = GridQuality.of_baseline(plate.regenerate())
    assert all(cells.is_valid.all() for cells in quality.cells(grid))


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["fwd", "rev"])
def test_totals_of_given_nodes_are_those_of_differences(plate, mode):
    surface = SurfaceGrid.of(plate)
    mover = InverseDistance(moving_mesh(plate))
    problem = problem_of(plate, surface=surface, measures=[Heights(surface)], mover=mover)
    rng, nodes = np.random.default_rng(3), waved(surface)
    direction = rng.normal(size=nodes.shape)
    for ids, normal in surface.on_planes(plate):
        direction[ids] -= np.outer(direction[ids] @ normal, normal)
    of = ["quality_ks", "heights", "size.f"]

    def outputs(step):
        problem.set_val(SURFACE, (nodes + step * direction).ravel())
        problem.run_model()
        return np.concatenate([problem.get_val(name).ravel() for name in of])

    expected = central_difference(outputs, 1e-4, levels=3)
    outputs(0.0)
    totals = problem.compute_totals(of, [SURFACE])
    exact = np.concatenate([totals[name, SURFACE] @ direction.ravel() for name in of])
    np.testing.assert_allclose(exact, expected, rtol=1e-7)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parametrization": lambda plate: Parametrization(moving_mesh(plate), [Swirl("swirl", 2)])}, "give one"),
        ({"live": lambda plate: True}, "live=True does not follow nodes of a surface"),
        ({"measures": lambda plate: [Heights(SurfaceGrid.of(plate))]}, "of another surface than the nodes"),
        ({"numbers": lambda plate: [0, 99_999]}, "'numbers' are not numbers of nodes"),
        ({"numbers": lambda plate: [0, 1, 2]}, "its 3 nodes do not determine"),
    ],
)
def test_what_does_not_go_with_given_nodes_is_refused(plate, options, message):
    with pytest.raises(InputError, match=message):
        problem_of(plate, surface=SurfaceGrid.of(plate), **{name: make(plate) for name, make in options.items()})


def test_a_parametrization_of_another_design_surface_is_refused(plate):
    parametrization = Parametrization(moving_mesh(plate, design="wing_upper"), [Swirl("swirl", 2)])
    with pytest.raises(InputError, match="different design surfaces"):
        problem_of(plate, parametrization=parametrization, mover=LinearElasticity(moving_mesh(plate)))


def test_measures_of_different_surfaces_stand_side_by_side():
    mesh, kinds = mesh_around_a_body()
    body = mesh.markers["body"]
    is_front = mesh.points[body, 0].mean(axis=1) < 0.0
    markers = mesh.markers | {"front": body[is_front], "rear": body[~is_front]}
    del markers["body"]
    mesh = MixedMesh(mesh.points, mesh.cells, markers)
    del kinds["body"]
    model = MeshModel.of(mesh, {**kinds, "front": "wall", "rear": "wall"}, LatticeSettings(spacing=0.6))
    front = DesignSurface.of(model, "front")
    rear, whole = SurfaceGrid.of(model, "rear"), SurfaceGrid.of(model)
    volume = EnclosedVolume.of(whole)
    measures = [SurfaceArea.of(front.surface), volume, SurfaceArea.of(rear, name="area_of_rear")]
    bump = Local("bump", direction="xz")
    shape = front.grid_movement([bump], measures=measures, quality=False, require_valid=False)
    problem = om.Problem(shape, reports=None)
    problem.model.add_design_var("bump")
    for measure in measures:
        problem.model.add_constraint(measure.name, lower=0.0)
    problem.setup()
    problem.set_val("bump", 0.005 * np.random.default_rng(4).normal(size=problem.get_val("bump").shape))
    problem.run_model()
    nodes = problem.get_val(GRID).reshape(-1, 3)
    for measure in measures:
        np.testing.assert_allclose(problem.get_val(measure.name), measure.evaluate(nodes[measure.surface.rows]))
    totals = check_totals(problem, n_directions=1)
    assert totals.transposed < 1e-12
    assert totals.differences < 1e-7
    with pytest.raises(InputError, match="the name 'surface_area' of a measure is taken"):
        problem_of(model, measures=[SurfaceArea.of(front.surface), SurfaceArea.of(rear)])


def test_the_grid_is_that_of_the_parts(plate):
    problem = problem_of(plate)
    problem.set_val(SURFACE_CONTROL_POINTS, bent(plate))
    problem.run_model()
    mover = Rotations(moving_mesh(plate))
    moved = mover.move(plate.control_points, bent(plate).reshape(-1, 3)).points
    np.testing.assert_allclose(problem.get_val(GRID), plate.regenerate(moved).to_vector(), atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("options", [{}, {"fit": False}, {"live": True}])
def test_taylor_remainder_is_of_second_order_down_to_round_off(plate, options):
    problem = problem_of(plate, quality=False, **options)
    start = bent(plate)
    direction = bent(plate, 1.0) - bent(plate, 0.0) + 0.3 * (start * np.tile([1.0, 0.0, 0.0], start.size // 3))

    def value(step):
        problem.set_val(SURFACE_CONTROL_POINTS, start + step * direction)
        problem.run_model()
        return problem.get_val("size.f").item()

    at_start = value(0.0)
    slope = (
        problem.compute_totals(["size.f"], [SURFACE_CONTROL_POINTS])["size.f", SURFACE_CONTROL_POINTS] @ direction
    ).item()
    steps = 1e-2 / 4.0 ** np.arange(6)
    remainders = np.array([abs(value(step) - at_start - step * slope) for step in steps])
    is_above = remainders > 1e-11 * abs(at_start)
    assert is_above[:4].all()
    rates = np.log(remainders[:-1] / remainders[1:]) / np.log(4.0)
    np.testing.assert_allclose(rates[is_above[1:]], 2.0, atol=0.1)


@pytest.mark.parametrize("live", [False, True])
def test_forward_and_reverse_totals_are_transposes(live):
    model = movable_model()
    problem = problem_of(model, live=live)
    rng = np.random.default_rng(2)
    problem.set_val(
        SURFACE_CONTROL_POINTS,
        problem.get_val(SURFACE_CONTROL_POINTS)
        + 0.02 * rng.standard_normal(problem.get_val(SURFACE_CONTROL_POINTS).shape),
    )
    problem.run_model()
    of, wrt = [GRID, "quality_ks"], [GRID_INITIAL, SURFACE_CONTROL_POINTS]
    v, w = ({name: rng.standard_normal(problem.get_val(name).size) for name in names} for names in (wrt, of))
    problem.model.run_linearize()
    forward, reverse = (problem.compute_jacvec_product(of, wrt, mode, seed) for mode, seed in (("fwd", v), ("rev", w)))
    left, right = (sum(np.vdot(a[name], b[name]) for name in b) for a, b in ((forward, w), (reverse, v)))
    scale = sum(np.linalg.norm(forward[name]) * np.linalg.norm(w[name]) for name in of)
    assert abs(left - right) < 1e-11 * scale


@pytest.mark.slow
@pytest.mark.parametrize("quality", [True, False, ("volume_ks",)])
def test_cells_that_turn_inside_out_are_refused_by_name_and_the_chain_goes_on(plate, quality):
    problem, fresh = (problem_of(plate, mover=InverseDistance(moving_mesh(plate)), quality=quality) for _ in range(2))
    problem.set_val(SURFACE_CONTROL_POINTS, bent(plate, 300.0))
    with pytest.raises(
        om.AnalysisError, match=r"grid_movement\.quality.*cell \(\d, \d, \d\) of .* is inverted, .*smaller step"
    ):
        problem.run_model()
    for p in (problem, fresh):
        p.set_val(SURFACE_CONTROL_POINTS, bent(plate))
        p.run_model()
    np.testing.assert_array_equal(problem.get_val(GRID), fresh.get_val(GRID))
    totals = [p.compute_totals(["size.f"], [SURFACE_CONTROL_POINTS]) for p in (problem, fresh)]
    np.testing.assert_array_equal(*(total["size.f", SURFACE_CONTROL_POINTS] for total in totals))


def test_inverted_cells_are_passed_on_where_that_is_wanted(plate):
    options = {"mover": InverseDistance(moving_mesh(plate)), "require_valid": False}
    problem = problem_of(plate, **options)
    problem.set_val(SURFACE_CONTROL_POINTS, bent(plate, 300.0))
    problem.run_model()
    assert problem.get_val("corner_ks").item() < 0.0
    names = [system.name for system in problem_of(plate, quality=False, **options).model.grid_movement.system_iter()]
    assert names == ["fit", "move", "evaluate"]


def viscous_section():
    """Section with first cells of 1e-6 chords."""
    spacing = Spacing(off_wall=1e-6, leading=1e-2, trailing=1e-2, tip=1e-2)
    return fit_grid(infinite_wing_grid(naca_section(0.12), (25, 17), spacing))


def turned(model, degrees):
    """Surface control points turned about the line at a quarter of the chord, from nothing at one end on."""
    mesh = moving_mesh(model)
    points = mesh.points[mesh.surface_ids]
    angle = np.deg2rad(degrees) * (points[:, 2] - points[:, 2].min()) / np.ptp(points[:, 2])
    x, y = points[:, 0] - 0.25, points[:, 1]
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([0.25 + c * x - s * y, s * x + c * y, points[:, 2]], axis=1).ravel()


@pytest.mark.parametrize("degrees", [45.0, 60.0])
def test_a_twist_that_tangles_the_control_mesh_of_boundary_layers_but_no_cell_is_followed(degrees):
    model = viscous_section()
    mesh = moving_mesh(model)
    problem = problem_of(model, mover=LinearElasticity(mesh, n_increments=1), fit=False)
    problem.set_val(SURFACE_CONTROL_POINTS, turned(model, degrees))
    problem.run_model()
    assert mesh.tangled(problem.get_val(CONTROL_POINTS).reshape(-1, 3)).n_tangled
    assert problem.get_val(CONTROL_CORNER_KS).item() < 0.0
    quality = GridQuality.of_baseline(model.regenerate())
    assert judge_move(quality, problem.get_val(GRID).reshape(-1, 3)).n_inverted == 0


@pytest.mark.slow
def test_a_twist_that_is_bounded_by_the_cells_is_found_in_a_few_runs_though_the_control_mesh_tangles():
    wing = DesignSurface.of(viscous_section())
    problem = om.Problem(driver=NLoptDriver(optimizer="LD_SLSQP"), reports=False)
    twist, mover = Twist("twist", wing.axis, stations=1), LinearElasticity(wing.mesh, n_increments=1)
    problem.model.add_subsystem("movement", wing.grid_movement([twist], mover=mover, fit=False), promotes=["*"])
    problem.model.add_design_var("twist", lower=-90.0, upper=90.0, units="deg", ref=10.0)
    problem.model.add_objective("twist", units="deg", ref=-10.0)
    problem.model.add_constraint("corner_ks", lower=0.02)
    problem.setup()
    problem.set_val("twist", 0.0, units="deg")
    problem.run_driver()
    assert problem.get_val("corner_ks").item() == pytest.approx(0.02, abs=1e-6)
    assert problem.get_val("twist", units="deg")[0] > 60.0
    assert problem.get_val(CONTROL_CORNER_KS).item() < 0.0
    assert problem.driver.iter_count <= 12
    assert problem.driver.n_failed_analyses == 0


def test_an_upstream_component_may_give_the_surface(plate):
    problem = om.Problem(reports=False)
    start = bent(plate, 0.0)
    raised = om.ExecComp("s = s0 + h * d", s={"shape": start.size, "units": "m"}, s0=start, d=bent(plate, 1.0) - start)
    problem.model.add_subsystem("bend", raised, promotes=["h", ("s", SURFACE_CONTROL_POINTS)])
    problem.model.add_subsystem("grid_movement", GridMovement(model=plate), promotes=["*"])
    problem.setup()
    problem.set_val("h", 0.05)
    problem.run_model()
    np.testing.assert_array_equal(problem.get_val(SURFACE_CONTROL_POINTS), bent(plate))


def test_a_mover_of_another_model_is_refused(plate):
    with pytest.raises(InputError, match=r"not the control mesh of .*moving_mesh"):
        problem_of(plate, mover=Shear(moving_mesh(movable_model())))


def test_what_is_no_mover_is_refused(plate):
    with pytest.raises(InputError, match="is no mover"):
        problem_of(plate, mover="elasticity")


def test_a_grid_that_changes_needs_a_fit(plate):
    with pytest.raises(InputError, match="live=True needs fit=True"):
        problem_of(plate, live=True, fit=False)


def test_a_model_without_walls_is_told_what_to_name():
    with pytest.raises(InputError, match="no patch is a wall"):
        problem_of(small_model())


@pytest.mark.slow
def test_a_local_model_gives_the_grid_and_the_totals_of_the_model(plate):
    subdomain = plate.local_model(Subdomain.of_grid(plate.topology))
    found = []
    for model in (plate, subdomain):
        problem = problem_of(model, **({"fit": False} if model is plate else {}))
        points = problem.get_val(SURFACE_CONTROL_POINTS)
        problem.set_val(SURFACE_CONTROL_POINTS, points * np.tile((1.1, 1.05, 1.0), len(points) // 3))
        problem.run_model()
        totals = problem.compute_totals(["size.f", "quality_ks"], [SURFACE_CONTROL_POINTS])
        found.append([problem.get_val(GRID), *totals.values()])
    assert np.abs(found[0][1]).max() > 1.0
    for whole, part in zip(*found):
        np.testing.assert_array_equal(part, whole)


@pytest.mark.parametrize("options", [{"fit": True}, {"live": True}, {"surface": True}])
def test_a_local_model_has_neither_a_fit_nor_given_nodes(plate, options):
    subdomain = plate.local_model(Subdomain.of_grid(plate.topology))
    if "surface" in options:
        options = {**options, "surface": SurfaceGrid.of(subdomain)}
    with pytest.raises(InputError, match=r"a local model has neither .* leave out 'fit', 'live' and 'surface'"):
        problem_of(subdomain, **options)


def test_splines_that_fold_are_refused_where_they_are_to_be_certified(plate):
    mesh = moving_mesh(plate)
    problem = problem_of(plate, mover=InverseDistance(mesh), fit=False, require_valid=False, certify=True)
    problem.run_model()
    surface = mesh.points[mesh.surface_ids]
    for height, is_refused in ((0.02, False), (30.0, True), (0.02, False)):
        lifted = surface + height * np.sin(3.0 * surface[:, :1]) * [0.0, 1.0, 0.0]
        problem.set_val(SURFACE_CONTROL_POINTS, lifted.ravel())
        if is_refused:
            with pytest.raises(om.AnalysisError, match=r"splines fold .*block \d.* invalid of .*smaller step"):
                problem.run_model()
        else:
            problem.run_model()


@pytest.mark.slow
def test_outer_boundaries_go_along_where_that_is_asked_for(plate):
    problem, mesh = problem_of(plate, comoving=True, fit=False), moving_mesh(plate)
    shift, points = np.array([0.3, -0.2, 0.0]), plate.control_points[mesh.surface_ids]
    problem.set_val(SURFACE_CONTROL_POINTS, (points + shift).ravel())
    problem.run_model()
    moved = problem.get_val(GRID).reshape(-1, 3)
    np.testing.assert_allclose(moved, plate.regenerate().to_vector().reshape(-1, 3) + shift, rtol=0, atol=1e-12)
    problem.set_val(SURFACE_CONTROL_POINTS, bent(plate))
    problem.run_model()
    rng, value = np.random.default_rng(9), bent(plate)
    direction = rng.normal(size=points.shape)
    direction[mesh.in_plane_rows, 2] = 0.0
    total = problem.compute_totals("size.f", SURFACE_CONTROL_POINTS)["size.f", SURFACE_CONTROL_POINTS]

    def at(t):
        problem.set_val(SURFACE_CONTROL_POINTS, value + t * direction.ravel())
        problem.run_model()
        return problem.get_val("size.f").item()

    assert central_difference(at, 1e-4) == pytest.approx((total @ direction.ravel()).item(), rel=1e-7)
