"""The ordinary chain with a mesh without structure: baseline, derivatives, sections, parts of walls, optimisation."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest
from mesh_cases import body_model, mesh_around_a_body, section_model, sector_mesh, smooth_change
from openmdao.utils.assert_utils import assert_check_partials

from bspline_mdao import DesignSurface, GridMovement, PointSet
from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.background.thin_plate import ThinPlate
from bspline_mdao.core.movement.default_mover import default_mover
from bspline_mdao.core.om.model_option import named_model
from bspline_mdao.design import Chord, FreeForm, Lattice, Local, OnPatch, OnSideOfPlane, Sweep, Twist
from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.mixed_cells import MixedMesh
from bspline_mdao.grids.topology.partition import Subdomain
from bspline_mdao.measures import (
    Clearance,
    EnclosedVolume,
    LeadingEdgeRadius,
    PlaneClearance,
    ProjectedArea,
    SectionThickness,
    SurfaceArea,
    SurfaceGrid,
    Thickness,
    TrailingEdgeAngle,
)
from bspline_mdao.movers import moving_mesh
from bspline_mdao.mphys import SurfaceGeometry, VolumeWarper
from bspline_mdao.testing import check_totals

HEIGHTS = ("volume_ks", "height_low_ks", "height_high_ks")


def problem_of(model: MeshModel, variables, measures=(), **options) -> om.Problem:
    design = DesignSurface.of(model)
    shape = design.parametrization(variables(design))
    options = {"quality": HEIGHTS, **options}
    group = GridMovement(model=model, parametrization=shape, measures=[make(design) for make in measures], **options)
    problem = om.Problem(group, reports=False)
    problem.setup(force_alloc_complex=True)
    problem.run_model()
    return problem


def of_body(design):
    box = Lattice.box(design.mesh, n=(3, 3, 2))
    return [
        Twist("twist", design.axis, stations=3),
        Sweep("sweep", design.axis, stations=2),
        FreeForm("shape", box, direction="z"),
    ]


def of_section(design):
    upper = OnSideOfPlane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    box = Lattice.box(design.mesh, n=(3, 2, 3))
    return [
        Twist("pitch", design.axis, stations=1),
        Chord("chord", design.axis, stations=1),
        Local("bumps", upper, "z"),
        FreeForm("shape", box, direction="z"),
    ]


MEASURES = {
    "body": (
        lambda design: EnclosedVolume.of(design.surface),
        lambda design: SurfaceArea.of(design.surface),
        lambda design: ProjectedArea.of(design.surface),
        lambda design: Thickness.grid(design.surface, 3, 2),
    ),
    "section": (
        lambda design: EnclosedVolume.of(design.surface),
        lambda design: Thickness.at(design.surface, [[0.1, 0.15, 0.0]], (0.0, 0.0, 1.0)),
    ),
}


@cache
def moved(which: str) -> om.Problem:
    """The chain at a design that is not the baseline."""
    model, variables = (body_model(), of_body) if which == "body" else (section_model(), of_section)
    problem, rng = problem_of(model, variables, MEASURES[which]), np.random.default_rng(4)
    for variable in problem.model.control.options["parametrization"].variables:
        values = problem.get_val(variable.name)
        scale = {"deg": 2.0, "m": 0.003, None: 0.02}[variable.units]
        problem.set_val(variable.name, values + scale * rng.standard_normal(values.shape))
    problem.run_model()
    return problem


@pytest.mark.parametrize(("model", "variables"), [(body_model, of_body), (section_model, of_section)])
def test_the_first_run_gives_the_baseline_to_the_last_bit(model, variables):
    problem = problem_of(model(), variables)
    np.testing.assert_array_equal(problem.get_val("grid").reshape(-1, 3), model().mesh.points)
    assert 0.8 < problem.get_val("volume_ks").item() < 1.0
    assert [system.name for system in problem.model.system_iter(recurse=False)][1:] == [
        "control",
        "move",
        "evaluate",
        "quality",
    ]


@pytest.mark.slow
@pytest.mark.parametrize("which", ["body", "section"])
def test_partial_derivatives_of_the_whole_group_are_exact(which):
    data = moved(which).check_partials(out_stream=None)
    pairs = {(name, *pair) for name, found in data.items() for pair in found}
    assert {(of, wrt) for _, of, wrt in pairs} >= {
        ("grid", "control_points"),
        ("control_points", "surface_control_points"),
        ("control_corner_ks", "surface_control_points"),
        ("surface", "surface_control_points"),
        ("volume", "surface"),
        *((name, "grid") for name in HEIGHTS),
    }
    for name, found in data.items():
        for pair, errors in found.items():
            assert errors["rel error"].reverse is not None, (name, pair)
    assert_check_partials(data)


@pytest.mark.slow
@pytest.mark.parametrize("which", ["body", "section"])
def test_totals_are_differences_to_1e_6_in_both_directions(which):
    problem = moved(which)
    of = ["volume", "thickness", *HEIGHTS] + (["surface_area", "projected_area"] if which == "body" else [])
    wrt = ["twist", "shape"] if which == "body" else ["pitch", "bumps"]
    totals = problem.compute_totals(of, wrt)
    problem.run_model()
    rng, start = np.random.default_rng(7), {name: problem.get_val(name).copy() for name in wrt}
    directions = {name: rng.standard_normal(values.shape) for name, values in start.items()}
    step, at = 1e-5, {}
    for k in (-2, -1, 1, 2):
        for name in wrt:
            problem.set_val(name, start[name] + k * step * directions[name])
        problem.run_model()
        at[k] = {name: problem.get_val(name).ravel().copy() for name in of}
    for name in wrt:
        problem.set_val(name, start[name])
    problem.run_model()
    for name in of:
        found = sum(totals[name, variable] @ directions[variable] for variable in wrt)
        slope = (8.0 * (at[1][name] - at[-1][name]) - (at[2][name] - at[-2][name])) / (12.0 * step)
        np.testing.assert_allclose(slope, found, rtol=0, atol=1e-6 * np.abs(found).max())
        assert np.abs(found).max() > 1e-6


def test_both_planes_of_a_section_move_alike_and_stay_planes():
    problem, n = moved("section"), section_model().mesh.n_stored
    nodes, baseline = problem.get_val("grid").reshape(-1, 3), section_model().mesh.points
    assert np.abs(nodes - baseline)[:, [0, 2]].max() > 0.005
    np.testing.assert_allclose(nodes[:n, [0, 2]], nodes[n:, [0, 2]], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(nodes[:, 1], baseline[:, 1])
    # single points have one value for both planes
    initial = problem.model.control.options["parametrization"].initial
    assert initial["bumps"].size == 13


@cache
def two_walls() -> MeshModel:
    """The mesh around a body whose upstream part is a wall of its own."""
    mesh, kinds = mesh_around_a_body()
    faces = mesh.markers["body"]
    is_nose = (mesh.points[faces][..., 0] < 0.0).any(axis=1)
    markers = {**mesh.markers, "body": faces[~is_nose], "nose": faces[is_nose]}
    return MeshModel.of(MixedMesh(mesh.points, mesh.cells, markers), {**kinds, "nose": "wall"}, LatticeSettings(0.5))


def test_a_part_of_the_walls_moves_and_the_others_stay():
    model, rng = two_walls(), np.random.default_rng(5)
    mesh = moving_mesh(model, "no*")
    surface = SurfaceGrid.of(model, "nose")
    np.testing.assert_array_equal(mesh.points[mesh.surface_ids], surface.points)
    assert (surface.patches, len(SurfaceGrid.of(model).patches)) == (("nose",), 2)
    mover = default_mover(model, mesh)
    assert isinstance(mover, ThinPlate)
    change = np.array([0.03, 0.0, 0.02])
    movement = mover.move(model.control_points, mesh.points[mesh.surface_ids] + change)
    nodes = model.node_map.at(movement.points).nodes
    np.testing.assert_allclose(nodes[surface.rows], surface.points + change, rtol=0, atol=1e-15)
    others = np.setdiff1d(model.wall_rows, surface.rows)
    assert len(others) > 20
    np.testing.assert_array_equal(nodes[others], model.mesh.points[others])
    d_surface, d_initial = rng.standard_normal(surface.points.shape), rng.standard_normal(model.control_points.shape)
    bar = rng.standard_normal(d_initial.shape)
    initial_bar, surface_bar = movement.vjp(bar)
    forward = np.vdot(bar, movement.jvp(d_initial, d_surface))
    assert np.vdot(initial_bar, d_initial) + np.vdot(surface_bar, d_surface) == pytest.approx(forward, rel=1e-12)


def test_nodes_of_walls_are_named_by_their_markers():
    model = two_walls()
    mesh = moving_mesh(model)
    for names in ("nose", "b*"):
        surface, nose = SurfaceGrid.of(model, names), OnPatch(model, names)
        np.testing.assert_array_equal(model.wall_rows[mesh.surface_ids[nose.mask(mesh)]], surface.rows)
    assert OnPatch(model, "nose").mask(moving_mesh(model, "nose")).all()
    with pytest.raises(InputError, match="no marker is called 'tail'; the markers are body, nose"):
        OnPatch(model, "tail").mask(mesh)
    for marker, ids, numbers in mesh.markers:
        assert mesh.place_of_point(int(ids[-1])).startswith(f"node {numbers[-1]} of marker '")
        faces = np.concatenate([model.mesh.markers[name] for name in (marker,)])
        assert numbers[-1] - 1 in faces
    assert mesh.place_of_point(mesh.n_points - 1).endswith("of the lattice")


@pytest.mark.slow
def test_a_solver_gives_the_walls_in_any_order_and_some_twice():
    """The warper of MPhys: every node of the walls is met to the last bit, and derivatives are exact."""
    model, rng = body_model(), np.random.default_rng(3)
    surface = SurfaceGrid.of(model)
    numbers = np.concatenate([rng.permutation(surface.n_points), [3, 4]])
    problem = om.Problem(VolumeWarper(model=model, numbers=numbers), reports=False)
    problem.setup()
    asked = (surface.points + smooth_change(model, rng, 0.02))[numbers]
    problem.set_val("x_aero", asked.ravel())
    problem.run_model()
    nodes = problem.get_val("aero_vol_coords").reshape(-1, 3)
    np.testing.assert_array_equal(nodes[surface.rows][numbers], asked)
    assert problem.model.miss is None
    data = problem.check_partials(out_stream=None)
    assert ("surface_control_points", "surface") in data["movement.fit_surface"]
    assert ("grid", "surface") not in data["movement.evaluate"]
    assert_check_partials(data)


@pytest.mark.slow
def test_a_solver_gets_its_surface_by_the_variables():
    design = DesignSurface.of(body_model())
    shape = design.parametrization([Twist("twist", design.axis, stations=2)])
    measures = [EnclosedVolume.of(design.surface)]
    geometry = SurfaceGeometry(model=design.model, parametrization=shape, measures=measures, generation=2)
    problem = om.Problem(geometry, reports=False)
    problem.setup()
    problem.set_val("x_aero0_geometry_input", design.surface.points.ravel())
    problem.set_val("twist", [0.0, 3.0], units="deg")
    problem.run_model()
    found = problem.get_val("x_aero0_geometry_output").reshape(-1, 3)
    np.testing.assert_array_equal(found, problem.get_val("surface").reshape(-1, 3))
    assert 0.01 < np.abs(found - design.surface.points).max() < 0.05


def test_points_in_the_body_ride_on_walls_and_others_on_the_lattice():
    model, inside = body_model(), np.array([[0.0, 0.3, 0.1], [-0.1, 0.5, -0.2]])
    for points, wrt in ((inside, "surface"), (np.concatenate([inside, [[1.0, 0.5, 0.5]]]), "control_points")):
        problem = om.Problem(reports=False)
        problem.model.add_subsystem("points", PointSet(model=model, points=points), promotes=["*"])
        problem.setup()
        problem.run_model()
        np.testing.assert_allclose(problem.get_val("points").reshape(-1, 3), points, rtol=0, atol=1e-15)
        moved = problem.get_val(wrt).reshape(-1, 3) * [1.1, 1.0, 1.0]
        problem.set_val(wrt, moved.ravel())
        problem.run_model()
        stretched = points * [1.1, 1.0, 1.0]
        np.testing.assert_allclose(problem.get_val("points").reshape(-1, 3), stretched, rtol=0, atol=1e-13)
        assert_check_partials(problem.check_partials(out_stream=None))


def test_measures_of_triangles_and_quads_are_those_of_the_shapes():
    """A block of 0.45 x 0.75 x ... by its own planes, and an ellipse of 24 points; derivatives by complex steps."""
    body, section = SurfaceGrid.of(body_model()), SurfaceGrid.of(section_model())
    sides = np.ptp(body.points, axis=0)
    ellipse = section.points[: len(section.points) // 2, ::2]
    across = np.roll(ellipse, -1, axis=0)
    inside = 0.5 * abs(np.sum(ellipse[:, 0] * across[:, 1] - ellipse[:, 1] * across[:, 0]))
    skin = np.sum(np.linalg.norm(across - ellipse, axis=1))
    wanted = {
        EnclosedVolume.of(body): np.prod(sides),
        SurfaceArea.of(body): 2.0 * sides[1] * (sides[0] + sides[2]) + sides[0] * sides[2],
        ProjectedArea.of(body, (0.0, 0.0, 1.0)): sides[0] * sides[1],
        Thickness.at(body, [[0.0, 0.3, 0.0]], (0.0, 0.0, 1.0)): sides[2],
        Clearance.from_points(body, "body", np.array([[0.0, 3.0, 0.0]]), rho=1e5): 3.0 - sides[1],
        PlaneClearance.of(body, "body", (0.0, -1.0, 0.0), (0.0, 1.0, 0.0), rho=1e5): 1.0,
        EnclosedVolume.of(section): 0.3 * inside,
        SurfaceArea.of(section): 0.3 * skin,
        SectionThickness.at(section, [0.5], [0.5]): 0.16,
        LeadingEdgeRadius.at(section): 0.08**2 / 0.5,
    }
    rng = np.random.default_rng(8)
    for measure, value in wanted.items():
        points = measure.surface.points
        rel = 0.01 if isinstance(measure, LeadingEdgeRadius | Clearance | PlaneClearance) else 1e-9
        np.testing.assert_allclose(measure.evaluate(points), value, rtol=rel)
        direction = np.sin(points @ rng.standard_normal((3, 3)))
        step = measure.evaluate(points + 1e-30j * direction).imag.ravel() / 1e-30
        assert np.abs(step).max() > 1e-3
        np.testing.assert_allclose(measure.partials(points) @ direction.ravel(), step, rtol=1e-11, atol=1e-12)


@pytest.mark.slow
def test_slsqp_finds_the_shortest_skin_of_a_section_of_fixed_area():
    """Free-form points of a box within bounds; at the end no step within these shortens it any more."""
    model = section_model()
    design = DesignSurface.of(model)
    box = Lattice.box(design.mesh, n=(3, 2, 3))
    shape = design.parametrization([FreeForm("shape", box, direction="xz")])
    volume, area = EnclosedVolume.of(design.surface, relative=True), SurfaceArea.of(design.surface, relative=True)
    group = GridMovement(model=model, parametrization=shape, measures=[volume, area], quality=("volume_ks",))
    problem = om.Problem(group, reports=False)
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-8, maxiter=60, disp=False)
    problem.model.add_design_var("shape", lower=-0.03, upper=0.03)
    problem.model.add_objective("surface_area")
    problem.model.add_constraint("volume", equals=1.0)
    problem.model.add_constraint("volume_ks", lower=0.05)
    problem.setup()
    assert problem.run_driver().success
    assert problem.get_val("volume").item() == pytest.approx(1.0, abs=1e-7)
    assert problem.get_val("surface_area").item() < 0.985
    assert not model.mesh.quality(problem.get_val("grid").reshape(-1, 3)).is_inverted.any()
    totals = problem.compute_totals(["surface_area", "volume", "volume_ks"], ["shape"])
    values, gradient = problem.get_val("shape"), totals["surface_area", "shape"].ravel()
    is_free, active = np.abs(values) < 0.03 - 1e-9, [totals["volume", "shape"].ravel()]
    if problem.get_val("volume_ks").item() < 0.05 + 1e-6:
        active.append(totals["volume_ks", "shape"].ravel())
    rows = np.array(active)[:, is_free]
    left = gradient[is_free] - rows.T @ np.linalg.lstsq(rows.T, gradient[is_free], rcond=None)[0]
    assert np.abs(left).max() < 1e-4 * np.abs(gradient).max()


def test_designs_that_invert_cells_are_refused():
    problem = problem_of(section_model(), of_section)
    problem.set_val("bumps", -0.3)
    with pytest.raises(om.AnalysisError, match=r"triangle \d+ at .*, next to marker 'airfoil', is inverted, and \d+ "):
        problem.run_model()


def test_splines_of_the_lattice_are_certified():
    problem = problem_of(section_model(), of_section, certify=True)
    problem.set_val("bumps", -0.3)
    with pytest.raises(om.AnalysisError, match=r"splines fold in .*the lattice"):
        problem.run_model()


def test_case_files_name_the_mesh_by_its_checksum_and_file(tmp_path):
    model, problem = section_model(), om.Problem(reports=False)
    problem.model.add_subsystem("movement", GridMovement(model=model, quality=False), promotes=["*"])
    problem.setup()
    model.save(tmp_path / "section.h5")
    options = {"movement": dict(problem.model.movement.options.items())}
    again = MeshModel.load(tmp_path / "section.h5")
    assert named_model(options) == (again.checksum, str(tmp_path / "section.h5"))


def test_what_a_mesh_has_not_is_refused_in_one_line():
    model = body_model()
    surface = SurfaceGrid.of(model)
    with pytest.raises(InputError, match="comoving=True moves the outer boundary, and the outer boundary of mesh"):
        om.Problem(GridMovement(model=model, comoving=True), reports=False).setup()
    with pytest.raises(InputError, match="a lattice needs no fit"):
        om.Problem(GridMovement(model=model, fit=True), reports=False).setup()
    with pytest.raises(InputError, match="node 306 of marker 'body' is not given, nor are 49 others"):
        om.Problem(GridMovement(model=model, surface=surface, numbers=np.arange(10)), reports=False).setup()
    with pytest.raises(InputError, match="a subdomain of 10 nodes, but the mesh has"):
        model.part(Subdomain.of_rows(np.arange(10), 10))
    with pytest.raises(InputError, match=r"1 of 2 points lie outside the mesh .* the first is point 2 at distance 6"):
        model.embed_points(np.array([[0.0, 0.3, 0.0], [10.0, 0.0, 0.0]]))
    with pytest.raises(InputError, match="marker body has triangles, through which no grid lines go; give stations"):
        LeadingEdgeRadius.at(surface)
    with pytest.raises(InputError, match="marker body has triangles, through which no grid lines go; give stations"):
        TrailingEdgeAngle.at(surface)
    with pytest.raises(InputError, match="'fixed' is of grids of blocks"):
        moving_mesh(model, fixed="far_00")
    with pytest.raises(InputError, match="no marker is called 'tail'; the markers are body"):
        moving_mesh(model, "tail")


def test_both_sides_of_a_sector_move_alike_by_design_variables_and_totals_are_exact():
    def variables(design):
        box = Lattice.box(design.mesh, n=(3, 2, 2))
        return [FreeForm("shape", box, direction="z"), Local("bumps", OnPatch(design.model, "floor"), "z")]

    mesh, kinds = sector_mesh(axis=(1.0, 0.0, 0.0))
    model, rng = MeshModel.of(mesh, kinds, LatticeSettings(spacing=0.4)), np.random.default_rng(6)
    problem = problem_of(model, variables, MEASURES["body"][1:2])
    for name in ("shape", "bumps"):
        problem.set_val(name, 0.02 * rng.standard_normal(problem.get_val(name).shape))
    problem.run_model()
    nodes = problem.get_val("grid").reshape(-1, 3)
    assert max(sides.gap(nodes) for sides in model.periodic) < 1e-14
    assert np.abs(nodes - model.mesh.points).max() > 0.01
    totals = check_totals(problem, ["grid", "surface_area"], ["shape", "bumps"], n_directions=1)
    assert totals.transposed < 1e-12
    assert totals.differences < 1e-8
