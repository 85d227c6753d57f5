"""The vortex lattice as a flow about a grid, with the variables of the other flows."""

import re
import warnings

import numpy as np
import openmdao.api as om
import pytest
from mesh_cases import TETRAHEDRA
from openmdao.utils.assert_utils import assert_check_partials
from riding_cases import joined
from scipy.sparse import csr_array, random_array
from scipy.spatial import cKDTree

from bspline_mdao import InputError, LatticeFlow, fit_grid
from bspline_mdao.core.mesh.surface import SurfaceGrid
from bspline_mdao.flow import ReferenceWarning
from bspline_mdao.flow.loads.force_coefficients import ForceCoefficients
from bspline_mdao.flow.loads.induced_drag import InducedDrag
from bspline_mdao.flow.loads.section_loads import SECTION_LOADS
from bspline_mdao.flow.loads.span_strips import SpanStrips
from bspline_mdao.flow.loads.wing_coefficients import WingCoefficients
from bspline_mdao.flow.om.lattice_flow import LatticeForces
from bspline_mdao.flow.om.vortex_lattice import VortexLattice
from bspline_mdao.generators import (
    Planform,
    Spacing,
    Wing,
    cambered_section,
    flat_plate_grid,
    hh_wing_grid,
    naca_section,
    onera_m6_grid,
)
from bspline_mdao.measures import CamberSurface
from bspline_mdao.meshes import MeshModel, MixedMesh
from bspline_mdao.testing import total_difference

AXES = np.eye(3)[[0, 2, 1]] * np.array([1.0, -1.0, 1.0])[:, None]
OUTPUTS = ("CL", "CD", "CM", "CD_induced", "span_load")


def model_of(wing):
    return fit_grid(hh_wing_grid(wing, (11, 7, 11), Spacing(0.01, 0.02, 0.02, 0.02)), n_control=(6, 5, 6))


@pytest.fixture(scope="module")
def rectangular():
    return model_of(Wing(Planform(1.0, 3.0), naca_section(0.12)))


@pytest.fixture(scope="module")
def swept():
    return model_of(Wing(Planform(1.2, 2.0, 0.5, 25.0), cambered_section(0.1, 0.03)))


def flow(model, mode="auto", values=None, **options):
    problem = om.Problem(reports=False)
    group = LatticeFlow(model=model, **{"reference_area": 3.0, "n_chord": 4, "n_span": 9, **options})
    problem.model.add_subsystem("flow", group, promotes=["*"])
    problem.setup(mode=mode)
    for name, value in {"alpha": 4.0, "Mach_number": 0.3, **(values or {})}.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


def found(problem):
    return np.concatenate([problem.get_val(name).ravel() for name in OUTPUTS])


def kernels(seed=0, n_strips=5, n_forces=8, n_nodes=11):
    """Coefficients of random forces, and arguments for them."""
    rng = np.random.default_rng(seed)
    trailing = csr_array(np.eye(n_strips + 1, n_nodes, k=2))
    leading = csr_array(np.eye(n_strips + 1, n_nodes, k=1) + 0.3 * np.eye(n_strips + 1, n_nodes, k=4))
    weights = random_array((n_strips, n_forces), density=0.6, rng=rng, format="csr")
    strips = SpanStrips(weights, trailing, leading, AXES, True)
    points = random_array((n_forces, n_nodes), density=0.5, rng=rng, format="csr")
    forces = ForceCoefficients(points, AXES, 2.5, 0.7, rng.standard_normal(3))
    nodes = rng.uniform(0.2, 1.0, (n_nodes, 3)) + np.linspace(3.0, 0.0, n_nodes)[:, None] * [0.2, 0.0, 1.0]
    return WingCoefficients.of(forces, InducedDrag.of(strips, nodes), nodes), (
        rng.standard_normal((n_forces, 3)),
        nodes,
        0.1,
    )


def test_coefficients_are_sums_of_forces_and_their_moments():
    wing, (forces, nodes, alpha) = kernels()
    kernel = wing.coefficients
    lift, drag, moment = kernel.evaluate(forces, nodes, alpha).values()
    total = forces.sum(axis=0) / kernel.area
    assert lift == pytest.approx(total[1] * np.cos(alpha) - total[0] * np.sin(alpha))
    assert drag == pytest.approx(total[0] * np.cos(alpha) + total[1] * np.sin(alpha))
    arms = kernel.points @ nodes - kernel.reference
    np.testing.assert_allclose(np.multiply(moment, 0.7 * 2.5), sum(np.cross(a, f) for a, f in zip(arms, forces)))


def test_derivatives_of_all_coefficients_agree_with_complex_steps_and_with_their_transpose():
    wing, at = kernels()
    rng, step = np.random.default_rng(1), 1e-30
    direction = [rng.standard_normal(np.shape(value)) for value in at]
    changes = wing.jvp(*at, *direction)
    stepped = wing.evaluate(*(value + 1j * step * d for value, d in zip(at, direction)))
    assert set(changes) == {*OUTPUTS, "CM_bending", *SECTION_LOADS}
    for name, change in changes.items():
        np.testing.assert_allclose(change, stepped[name].imag / step, rtol=1e-10, err_msg=name)
    for names in (tuple(changes), *((name,) for name in changes)):
        bars = {name: rng.standard_normal(np.shape(changes[name])) for name in names}
        dots = [np.sum(bar * d) for bar, d in zip(wing.vjp(*at, bars), direction)]
        assert sum(dots) == pytest.approx(sum(np.sum(bar * changes[name]) for name, bar in bars.items()), rel=1e-12)


@pytest.mark.slow
def test_partials_of_lattice_forces_agree_with_complex_steps(swept):
    camber, rng = CamberSurface.of(SurfaceGrid.of(swept), 3, 5), np.random.default_rng(2)
    problem = om.Problem(reports=False)
    component = LatticeForces(camber=camber, reference_area=1.7, reference_chord=0.8, moment_reference=(0.3, -0.1, 0.2))
    problem.model.add_subsystem("forces", component, promotes=["*"])
    problem.setup(force_alloc_complex=True)
    problem.set_val("panel_forces", rng.standard_normal((2, 4, 3)))
    problem.set_val("camber_surface", problem.get_val("camber_surface") + 0.05 * rng.standard_normal((3, 5, 3)))
    problem.set_val("alpha", 5.0)
    problem.run_model()
    problem.model.forces.set_check_partial_options("*", method="cs", directional=False)
    data = problem.check_partials(compact_print=True, out_stream=None)
    assert len(data["forces"]) == 36
    assert_check_partials(data, atol=1e-12, rtol=1e-10)


@pytest.mark.slow
def test_rectangular_wing_has_the_lift_of_its_vortex_lattice_and_the_induced_drag_of_its_planform(rectangular):
    coarse, fine = (flow(rectangular, n_chord=n, n_span=4 * n + 1) for n in (3, 5))
    lift, drag = fine.get_val("CL").item(), fine.get_val("CD_induced").item()
    assert lift == pytest.approx(0.3064, rel=0.015)
    assert coarse.get_val("CL").item() == pytest.approx(lift, rel=0.005)
    assert lift**2 / (np.pi * 6.0 * drag) == pytest.approx(0.985, abs=0.005)
    assert fine.get_val("CD").item() == pytest.approx(drag, rel=1e-3)


@pytest.mark.slow
def test_plate_of_no_thickness_has_a_lattice():
    found = flow(fit_grid(flat_plate_grid((9, 5, 9)), n_control=(5, 5, 5)), reference_area=2.0, n_span=17)
    found.set_val("Mach_number", 0.0)
    found.run_model()
    assert found.get_val("CL").item() == pytest.approx(0.2549, rel=0.02)
    assert found.get_val("CD_induced").item() == pytest.approx(0.0051, rel=0.02)


@pytest.mark.slow
def test_coefficients_are_those_of_the_lattice_in_half_wings(swept):
    """What is half of the lift, and has half of the area, has the same coefficients."""
    ours = flow(swept, reference_area=1.8, moment_reference=(0.2, 0.05, 0.0))
    lattice = om.Problem(reports=False)
    lattice.model.add_subsystem("flow", VortexLattice(n_chord=4, n_span=9, reference_area=3.6), promotes=["*"])
    lattice.setup()
    moment_reference = [0.2, 0.0, 0.05]
    for name, value in {"alpha": 4.0, "Mach_number": 0.3, "moment_reference": moment_reference}.items():
        lattice.set_val(name, value)
    lattice.set_val("camber_surface", ours.get_val("camber_surface"))
    lattice.run_model()
    assert ours.get_val("CL") == pytest.approx(lattice.get_val("CL_panels"), rel=1e-12)
    assert ours.get_val("CD") == pytest.approx(lattice.get_val("CD_panels"), rel=1e-12)
    assert ours.get_val("CD_induced") == pytest.approx(lattice.get_val("CD"), rel=5e-3)
    np.testing.assert_allclose(ours.get_val("span_load"), lattice.get_val("span_load"), rtol=5e-3)
    # OpenAeroStruct's moment is by the mean aerodynamic chord, its pitch positive upwards about the left wing's axis
    chord = -ours.get_val("CM")[2] / lattice.get_val("CM")[1]
    assert chord == pytest.approx(2.0 / 3.0 * 1.2 * (1.0 + 0.5 + 0.25) / 1.5, rel=0.02)


@pytest.mark.slow
def test_moments_are_about_the_axes_of_the_grid(rectangular):
    at_origin, aft = (flow(rectangular, moment_reference=place) for place in ((0.0, 0.0, 0.0), (0.25, 0.0, 1.0)))
    lift = at_origin.get_val("CL").item()
    roll, _, pitch = at_origin.get_val("CM")
    assert -roll / lift == pytest.approx(4.0 / np.pi, rel=0.06)  # the ellipse's centre of lift
    assert 0.2 < pitch / lift < 0.26
    upwards = lift * np.cos(np.radians(4.0)) + at_origin.get_val("CD").item() * np.sin(np.radians(4.0))
    np.testing.assert_allclose((aft.get_val("CM") - [roll, 0.0, pitch])[::2], [upwards, -0.25 * upwards], rtol=1e-9)


@pytest.mark.slow
def test_area_and_chord_scale_the_coefficients(rectangular):
    one, other = flow(rectangular), flow(rectangular, reference_area=6.0, reference_chord=0.5)
    for name, factor in {"CL": 0.5, "CD": 0.5, "CD_induced": 0.5, "CM": 1.0, "span_load": 1.0}.items():
        np.testing.assert_allclose(other.get_val(name), factor * one.get_val(name), rtol=1e-12)


@pytest.mark.slow
def test_a_reference_area_in_another_unit_is_warned_of():
    model = fit_grid(onera_m6_grid((9, 8, 7)))
    words = r"reference area is 1\.16e\+06 m\^2, and the walls as seen from above have 1\.1\d m\^2; check its unit"
    for area, is_warned in ((1.16e6, True), (1.16, False), (0.75, False)):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", ReferenceWarning)
            om.Problem(LatticeFlow(model=model, reference_area=area, n_span=5), reports=False).setup()
        found = [str(each.message) for each in caught if issubclass(each.category, ReferenceWarning)]
        assert len(found) == is_warned
        assert not is_warned or re.search(words, found[0])


def test_span_load_adds_up_to_the_lift(rectangular):
    problem = flow(rectangular)
    strips = np.diff(problem.get_val("camber_surface")[0, :, 1])
    assert problem.get_val("span_load") @ strips / 3.0 == pytest.approx(problem.get_val("CL").item(), rel=1e-12)
    load = problem.get_val("span_load")
    assert (np.diff(load) > 0.0).all()  # from the tip to the root


def test_lattice_that_ends_a_quarter_strip_short_has_an_elliptical_optimum():
    """n strips of a half wing: the discrete efficiency falls short of 1 by about 1 / (16 n^2)."""
    for n, error in ((8, 1e-3), (16, 3e-4)):
        y = -3.0 * n / (n + 0.25) * np.linspace(1.0, 0.0, n + 1)
        nodes = np.column_stack([0.0 * y, 0.0 * y, -y])
        edge = csr_array(np.eye(n + 1))
        strips = SpanStrips(csr_array(np.eye(n)), edge, edge, AXES, is_symmetric=True)
        drag = InducedDrag.of_vortices(strips)
        lift, hessian = np.diff(y), np.array([gradient(drag, nodes, load) for load in np.eye(n)])
        best = np.linalg.solve(hessian, lift)
        best = best / (lift @ best)
        efficiency = 2.0 / (np.pi * 36.0 * 0.5 * best @ hessian @ best)
        assert efficiency == pytest.approx(1.0, abs=error)


def gradient(drag, nodes, load):
    """Derivative of the drag of a flat wing in the loads of its strips."""
    widths = np.diff(-nodes[:, 2])
    forces = np.outer(load * widths, AXES[2])
    return drag.vjp(forces, nodes, 0.0, np.zeros(len(load)), 1.0)[0][:, 1] * widths


def test_what_is_not_the_wing_does_not_count(rectangular):
    problem = flow(rectangular)
    before, rng = found(problem), np.random.default_rng(3)
    surface = SurfaceGrid.of(rectangular)
    nodes = problem.get_val("grid").reshape(-1, 3)
    moved = nodes + 0.1 * rng.standard_normal(nodes.shape)
    moved[surface.rows] = nodes[surface.rows]
    problem.set_val("grid", moved.ravel())
    problem.run_model()
    np.testing.assert_array_equal(found(problem), before)
    problem.set_val("grid", (nodes + [0.5, 0.2, 0.0]).ravel())
    problem.run_model()
    shift = np.cross([0.5, 0.2, 0.0], force(problem))
    np.testing.assert_allclose(found(problem) - before, [0.0, 0.0, *shift, *np.zeros(9)], atol=1e-10)


def force(problem):
    """Coefficients of the forces along the axes of the grid, the one along the span left out."""
    alpha, lift, drag = np.radians(4.0), problem.get_val("CL").item(), problem.get_val("CD").item()
    forces = problem.get_val("flow.forces.panel_forces").sum(axis=(0, 1))
    along = [drag * np.cos(alpha) - lift * np.sin(alpha), lift * np.cos(alpha) + drag * np.sin(alpha)]
    return np.array([*along, -forces[1] / 3.0])


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["fwd", "rev"])
def test_totals_agree_with_extrapolated_differences(swept, mode):
    rng, n = np.random.default_rng(4), 3 * swept.n_nodes
    direction = {"grid": 0.1 * rng.standard_normal(n), "alpha": np.ones(1), "Mach_number": np.ones(1)}
    problem = flow(swept, mode, n_chord=3, n_span=5)
    if mode == "rev":
        totals = problem.compute_totals(list(OUTPUTS), list(direction))
        exact = {
            name: np.concatenate([np.atleast_2d(totals[of, name]) @ d for of in OUTPUTS])
            for name, d in direction.items()
        }
    else:
        exact = {name: forward(swept, name, d) for name, d in direction.items()}
    for name, step in direction.items():
        expected = np.concatenate([*total_difference(problem, OUTPUTS, {name: step}).values()])
        np.testing.assert_allclose(exact[name], expected, atol=1e-9 * max(1.0, abs(expected).max()))


def forward(model, name, direction):
    """Derivatives of all outputs along a direction in an input, in forward mode."""
    problem = flow(model, "fwd", n_chord=3, n_span=5)
    products = problem.compute_jacvec_product(list(OUTPUTS), [name], "fwd", {name: direction}, linearize=True)
    return np.concatenate([products[of].ravel() for of in OUTPUTS])


def test_wall_without_a_camber_surface_is_refused_in_one_line(rectangular):
    with pytest.raises(InputError, match="downstream, along the span, up") as error:
        flow(rectangular, axes="xyy")
    assert "\n" not in str(error.value)


def test_folded_panels_are_counted_and_named_before_the_lattice_is_solved(rectangular):
    problem = flow(rectangular)
    before = problem.get_val("CL").item()
    grid = problem.get_val("grid").reshape(-1, 3).copy()
    rows = problem.model.flow.camber.options["measure"].surface.rows
    tip = rows[grid[rows, 2] > 2.4]
    grid[tip, 0] = 1.0 - grid[tip, 0]  # leading edge behind the trailing edge
    problem.set_val("grid", grid.ravel())
    with pytest.raises(om.AnalysisError, match=r"\d+ of 24 panels of .* are folded, the first .* the axes"):
        problem.run_model()
    assert problem.get_val("CL").item() == before


@pytest.mark.slow
def test_a_mesh_without_structure_has_the_loads_of_the_grid_with_its_nodes():
    """Hexahedra of the grid, with other numbers of their nodes; to about a hundredth, as tetrahedra as well."""
    grid = onera_m6_grid((5, 7, 5))
    points, cells = joined(grid)
    places = cKDTree(points).query(grid.to_vector().reshape(-1, 3))[1]
    of_grid = flow(fit_grid(grid), reference_area=0.75, n_span=5)
    baseline = found(of_grid)
    for corners, rtol in (({"hexahedron": cells}, 1e-12), ({"tetra": cells[:, TETRAHEDRA].reshape(-1, 4)}, 0.01)):
        skin = MixedMesh(points, corners).skin
        in_plane, is_far = (points[skin][..., 2] == 0.0).all(axis=1), np.abs(points[skin]).max(axis=(1, 2)) > 3.0
        markers = {"wing": skin[~in_plane & ~is_far], "symmetry": skin[in_plane], "far": skin[is_far & ~in_plane]}
        kinds = {"wing": "wall", "symmetry": "symmetry", "far": "farfield"}
        problem = flow(MeshModel.of(MixedMesh(points, corners, markers), kinds), reference_area=0.75, n_span=5)
        np.testing.assert_allclose(found(problem), baseline, rtol=rtol, atol=rtol)
        nodes = points + 0.02 * np.sin(points @ np.random.default_rng(2).normal(size=(3, 3)))
        for each, moved in ((problem, nodes), (of_grid, nodes[places])):
            each.set_val("grid", moved.ravel())
            each.run_model()
        np.testing.assert_allclose(found(problem), found(of_grid), rtol=rtol, atol=rtol)
        assert np.abs(found(of_grid) - baseline).max() > 0.02
