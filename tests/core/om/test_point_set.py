"""Structures and probes follow the design variables: places, derivatives, refusals."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import GridMovement, InputError, PointSet, SurfaceControl, SurfaceEvaluate, fit_grid
from bspline_mdao.design import Parametrization, ReferenceAxis, Span, Sweep, Twist
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import InverseDistance, moving_mesh
from bspline_mdao.testing import check_totals

SPAN = 1.4843
DESIGN = {"twist": [0.0, 2.0, 4.0], "span": [1.2], "sweep": [5.0]}


@cache
def model():
    return fit_grid(onera_m6_grid((13, 9, 7)))


def variables(mesh):
    axis = ReferenceAxis.of(mesh)
    return [Twist("twist", axis, stations=3), Span("span", axis), Sweep("sweep", axis)]


def wing_box(n_ribs=6):
    """Nodes of ribs between two spars, the first in the plane of symmetry, shape (3 stations, ribs, heights, 3)."""
    xi, z, eta = np.meshgrid([0.2, 0.4, 0.6], np.linspace(0.0, 0.95 * SPAN, n_ribs), [-0.015, 0.015], indexing="ij")
    front, chord = 0.857753 * z / SPAN, 0.805891 + (0.4535 - 0.805891) * z / SPAN
    return np.stack([front + xi * chord, eta * chord, z], axis=-1)


def of_surface(points, **options):
    """Variables, surface and the points, without a movement of the grid."""
    problem, mesh = om.Problem(reports=False), moving_mesh(model())
    evaluate = SurfaceEvaluate(model=model(), mesh=mesh, surface=SurfaceGrid.of(model()))
    parts = {
        "control": SurfaceControl(parametrization=Parametrization(mesh, variables(mesh))),
        "evaluate": evaluate,
        "spars": PointSet(model=model(), points=points.reshape(-1, 3), name="spars", **options),
    }
    for name, part in parts.items():
        problem.model.add_subsystem(name, part, promotes=["*"])
    return run(problem)


def of_grid(points):
    """The whole chain, with points in the volumes as well."""
    problem, mesh = om.Problem(reports=False), moving_mesh(model())
    parametrization = Parametrization(mesh, variables(mesh))
    movement = GridMovement(model=model(), parametrization=parametrization, mover=InverseDistance(mesh), fit=False)
    problem.model.add_subsystem("movement", movement, promotes=["*"])
    problem.model.add_subsystem("points", PointSet(model=model(), points=points, tolerance=1e-6), promotes=["*"])
    return run(problem)


def run(problem):
    problem.setup(mode="rev")
    for name, value in DESIGN.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


def in_section(points, chords):
    """Points in the frame of their rib, along and across its middle, by the chord, shape (3, ribs, 2, 2)."""
    middle = points.mean(axis=2)
    x, y = (middle[2] - middle[0])[:, :2].T
    angle, arms = np.arctan2(y, x)[:, None], points - middle[1][None, :, None]
    along = arms[..., 0] * np.cos(angle) + arms[..., 1] * np.sin(angle)
    across = arms[..., 1] * np.cos(angle) - arms[..., 0] * np.sin(angle)
    return np.stack([along, across], axis=-1) / chords[:, None, None]


@pytest.mark.slow
def test_the_nodes_of_ribs_keep_their_place_in_the_section():
    before, after = wing_box(), of_surface(wing_box()).get_val("spars").reshape(wing_box().shape)
    chords = 0.805891 + (0.4535 - 0.805891) * before[0, :, 0, 2] / SPAN
    np.testing.assert_allclose(after[..., 2], 1.2 * before[..., 2], atol=2e-4)
    np.testing.assert_allclose(after[:, 0, :, 2], 0.0, atol=1e-14)  # in the plane of symmetry
    assert np.abs(after - before).max() > 0.25
    np.testing.assert_allclose(in_section(after, chords), in_section(before, chords), atol=2e-3)


@pytest.mark.slow
def test_points_beside_a_grid_are_those_beside_its_surface():
    probes = model().evaluator().forward(model().control_points)[[40, 300, 700]]
    beside = of_grid(np.concatenate([wing_box().reshape(-1, 3), probes])).get_val("points").reshape(-1, 3)
    np.testing.assert_allclose(beside[:-3], of_surface(wing_box()).get_val("spars").reshape(-1, 3), atol=1e-12)
    assert np.linalg.norm(beside[-3:] - probes, axis=1).max() > 1e-3


@pytest.mark.slow
def test_totals_of_structures_are_those_of_differences():
    problem = of_surface(wing_box())
    check = check_totals(problem, ["spars"], list(DESIGN), step=1e-2)
    assert check.transposed < 1e-12
    assert check.differences < 1e-8


def of_geometry(points, generation=None):
    """The same variables in the geometry of MPhys."""
    pytest.importorskip("mphys", reason="MPhys is not installed")
    from bspline_mdao.mphys import SurfaceGeometry

    problem, mesh = om.Problem(reports=False), moving_mesh(model())
    parametrization = Parametrization(mesh, variables(mesh))
    options = {"point_sets": {"x_struct0": points.reshape(-1, 3)}, "generation": generation}
    geometry = SurfaceGeometry(model=model(), parametrization=parametrization, **options)
    problem.model.add_subsystem("geometry", geometry, promotes=["*"])
    return run(problem)


@pytest.mark.parametrize(("generation", "name"), [(2, "x_struct0_geometry_output"), (1, "x_struct0")])
def test_the_geometry_of_mphys_moves_structures_alike(generation, name):
    found = of_geometry(wing_box(), generation).get_val(name)
    np.testing.assert_allclose(found, of_surface(wing_box()).get_val("spars"), atol=1e-13)


def test_totals_of_structures_in_mphys_are_those_of_differences():
    check = check_totals(of_geometry(wing_box(), 2), ["x_struct0_geometry_output"], list(DESIGN), step=1e-2)
    assert check.transposed < 1e-12
    assert check.differences < 1e-8


def test_structures_outside_the_surface_are_refused_by_number():
    points = np.concatenate([wing_box().reshape(-1, 3), [[0.4, 0.3, 0.5]]])
    with pytest.raises(InputError, match=r"x_struct0: 1 of 37 points are outside .*, the first is point 37") as error:
        of_geometry(points)
    assert "\n" not in str(error.value)


def test_points_that_are_nowhere_are_refused_by_number():
    points = np.concatenate([wing_box().reshape(-1, 3), [[0.4, 0.0, -0.5]]])
    with pytest.raises(InputError, match=r"points lie outside .* not inside the walls: point 37 at distance") as error:
        of_surface(points)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("seed", range(8))
def test_check_partials_takes_steps_that_suit_the_points_wherever_they_are(seed):
    random = np.random.default_rng(seed)
    inner = np.concatenate([block.nodes[1:-1, 1:-1, 1:-1].reshape(-1, 3) for block in model().regenerate().blocks])
    points = inner[random.permutation(len(inner))]
    points = points[np.linalg.norm(points, axis=1) > 3.0][:3]  # none follows a wall
    if seed % 2:
        points = np.concatenate([points, wing_box()[1, 2:4].reshape(-1, 3)])
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("points", PointSet(model=model(), points=points), promotes=["*"])
    problem.setup()
    problem.run_model()
    np.random.seed(seed)  # noqa: NPY002 - where OpenMDAO draws the directions of checks
    found = problem.check_partials(out_stream=None)["points"]
    assert problem.model.points.is_linear
    assert max(data["magnitude"].forward for data in found.values()) > 0.01
    for pair, data in found.items():
        assert data["abs error"].forward < 1e-6 * max(1.0, data["magnitude"].forward), pair
        assert data["abs error"].fwd_rev < 1e-12, pair
