"""Wings are drawn where they are: sections, planform, twist, span load and pressures."""

import numpy as np
import pytest
from mesh_cases import TETRAHEDRA
from riding_cases import joined
from scipy.spatial.transform import Rotation

from bspline_mdao import EulerFlow, GridMovement, LatticeFlow, fit_grid
from bspline_mdao.core.design.parametrization import Parametrization
from bspline_mdao.core.design.reference_axis import ReferenceAxis
from bspline_mdao.design import Twist
from bspline_mdao.errors import InputError
from bspline_mdao.generators import Planform, Spacing, Wing, hh_wing_grid, naca_section, onera_m6_grid, section_o_grid
from bspline_mdao.meshes import MeshModel, MixedMesh
from bspline_mdao.movers import LinearElasticity, moving_mesh
from bspline_mdao.plotting import (
    draw_ellipse,
    draw_planform,
    draw_pressures,
    draw_sections,
    draw_span_load,
    draw_twist,
    faces_around,
    figure,
    span_load_edges,
    wall_quads,
)
from bspline_mdao.studio.plotting.pressures import _chord_ends
from bspline_mdao.studio.plotting.wing_lines import strips_of
from bspline_mdao.studio.plotting.wings import wing_section, wing_sides

om = pytest.importorskip("openmdao.api")
pytest.importorskip("matplotlib", reason="matplotlib is not installed")


@pytest.fixture(scope="module")
def model():
    """Rectangular wing of chord 1 and semi-span 3."""
    wing = Wing(Planform(root_chord=1.0, semi_span=3.0), naca_section(0.12))
    grid = hh_wing_grid(wing, ((7, 9, 7), (7, 7), (9, 7)), Spacing(0.03, 0.05, 0.05, 0.08, root=0.5))
    return fit_grid(grid)


@pytest.fixture(scope="module")
def nodes(model):
    return model.regenerate().to_vector()


@pytest.fixture
def axes(tmp_path):
    with figure(tmp_path, "wing", (2.0, 2.0)) as canvas:
        yield canvas.subplots()


@pytest.mark.slow
def test_sides_and_sections_of_a_wing_are_found(model, nodes):
    upper, lower = wing_sides(model, nodes)
    assert upper.shape == lower.shape == (9, 9, 3)
    assert upper[..., 1].max() == pytest.approx(0.06, rel=0.02)
    np.testing.assert_allclose(upper * [1.0, -1.0, 1.0], lower, atol=1e-6)
    section = wing_section(model, nodes, part=0.5)
    assert np.ptp(section[:, 0]) == pytest.approx(1.0, abs=1e-3)
    assert np.ptp(section[:, 2]) < 0.05


@pytest.mark.slow
def test_planform_and_sections_have_the_sizes_of_the_wing(model, nodes, axes):
    draw_planform(axes, model, nodes, color="red")
    (outline,) = axes.lines
    np.testing.assert_allclose(np.ptp(outline.get_xydata(), axis=0), [3.0, 1.0], atol=1e-3)
    assert axes.yaxis_inverted()
    draw_sections(axes, model, nodes, parts=(0.1, 0.9), label="wing")
    first, second = (line.get_xydata() for line in axes.lines[1:])
    np.testing.assert_allclose(np.ptp(first, axis=0), [1.0, 0.12], rtol=0.02)
    np.testing.assert_allclose(second[:, 1].mean() - first[:, 1].mean(), -0.25, atol=1e-3)
    assert len(axes.get_legend_handles_labels()[1]) == 1


def test_the_section_of_an_o_grid_is_that_of_its_wall():
    profile = naca_section(0.12)
    model = fit_grid(section_o_grid(profile, 32, n_away=12), n_control=[(11, 7, 2)])
    nodes = model.regenerate().to_vector()
    wall = nodes.reshape(-1, 3)[np.unique(wall_quads(model))]
    section = wing_section(model, nodes, part=0.5)
    distances = np.linalg.norm(section[:, None, :2] - wall[:, :2], axis=-1).min(axis=1)
    np.testing.assert_allclose(distances, 0.0, atol=1e-12)
    assert len(np.unique(np.round(section[:, :2], 9), axis=0)) == 32


@pytest.fixture(scope="module")
def mesh_wing():
    """A swept wing in tetrahedra, on a plane of symmetry."""
    points, cells = joined(onera_m6_grid((13, 17, 5)))
    corners = cells[:, TETRAHEDRA].reshape(-1, 4)
    skin = MixedMesh(points, {"tetra": corners}).skin
    in_plane, is_far = (points[skin][..., 2] == 0.0).all(axis=1), np.abs(points[skin]).max(axis=(1, 2)) > 3.0
    markers = {"symmetry": skin[in_plane], "far": skin[is_far & ~in_plane], "Wing": skin[~in_plane & ~is_far]}
    kinds = {"Wing": "wall", "symmetry": "symmetry", "far": "farfield"}
    return MeshModel.of(MixedMesh(points, {"tetra": corners}, markers), kinds)


def test_sides_and_sections_of_a_mesh_are_those_of_its_wing(mesh_wing, axes):
    nodes = mesh_wing.mesh.points
    blocks = onera_m6_grid((13, 17, 5))
    windows = {patch.name: patch.windows[0] for patch in blocks.patches}
    outline = [blocks.blocks[w.block].nodes[w.slices][:, 0] for w in (windows["wing_upper"], windows["wing_lower"])]
    upper, lower = wing_sides(mesh_wing, nodes.ravel())
    assert upper.shape == lower.shape
    assert (upper[1:-1, :, 1] > lower[1:-1, :, 1]).all()
    for edge in (0, -1):  # straight ones
        leading = outline[0][edge]
        expected = np.interp(upper[edge, :, 2], leading[:, 2], leading[:, 0])
        np.testing.assert_allclose(upper[edge, :, 0], expected, atol=4e-3)
        np.testing.assert_allclose(upper[edge], lower[edge], atol=1e-12)
    section = wing_section(mesh_wing, nodes, part=0.4)
    np.testing.assert_allclose(section[:, 2], 0.4 * nodes[mesh_wing.wall_rows, 2].max(), atol=1e-12)
    np.testing.assert_array_equal(section[0], section[-1])
    assert section[0, 0] == section[:, 0].min()
    half = int(np.argmax(section[:, 0]))
    assert section[1:half, 1].mean() > 0.01 > -0.01 > section[half + 1 : -1, 1].mean()
    draw_planform(axes, mesh_wing, nodes)
    draw_sections(axes, mesh_wing, nodes)
    draw_twist(axes, mesh_wing, nodes @ Rotation.from_rotvec([0.0, 0.0, -0.1]).as_matrix().T)
    np.testing.assert_allclose(axes.lines[-1].get_ydata(), np.degrees(0.1), atol=0.02)


def test_a_mesh_has_no_strips_of_a_flow(mesh_wing):
    with pytest.raises(InputError, match="has no strips of a flow; a LatticeFlow in the problem gives its span load"):
        strips_of(mesh_wing)


@pytest.mark.slow
def test_twist_is_positive_with_the_leading_edge_up(model, nodes, axes):
    mesh = moving_mesh(model)
    twist = Twist("twist", ReferenceAxis.of(mesh, at=1.0), 2)
    movement = GridMovement(
        model=model, parametrization=Parametrization(mesh, [twist]), mover=LinearElasticity(mesh), fit=False
    )
    problem = om.Problem(movement, reports=None)
    problem.setup()
    problem.set_val("twist", [0.0, 4.0], units="deg")
    problem.run_model()
    draw_twist(axes, model, problem.get_val("grid"))
    y, angle = axes.lines[0].get_data()
    np.testing.assert_allclose(y[[0, -1]], [0.0, 1.0])
    np.testing.assert_allclose(angle[[0, -1]], [0.0, 4.0], atol=0.05)


def test_a_span_load_is_drawn_relative_to_its_mean(axes):
    edges = np.array([2.0, 1.5, 0.5, 0.0])
    draw_span_load(axes, edges, np.array([1.0, 2.0, 3.0]))
    curve, (y, load) = axes.lines[0].get_xydata(), axes.lines[1].get_data()
    np.testing.assert_allclose(y, [0.875, 0.5, 0.125])
    np.testing.assert_allclose(load, np.array([1.0, 2.0, 3.0]) / 2.0)
    np.testing.assert_allclose(curve[:: len(curve) // 2], axes.lines[1].get_xydata())
    draw_ellipse(axes)
    y, load = axes.lines[2].get_data()
    assert np.trapezoid(load, y) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("flow", [EulerFlow, LatticeFlow])
def test_strips_of_the_span_load_end_at_the_tip_and_the_root(model, nodes, flow):
    if flow is LatticeFlow:
        pytest.importorskip("openaerostruct", reason="OpenAeroStruct is not installed")
    problem = om.Problem(flow(model=model, reference_area=3.0), reports=None)
    problem.setup()
    problem.set_val("grid", nodes)
    problem.final_setup()
    if flow is LatticeFlow:
        problem.run_model()
    edges = span_load_edges(model, problem)
    assert edges.size == problem.get_val("span_load").size + 1
    assert edges[0] == pytest.approx(3.0, rel=0.02)  # a lattice ends where there still is a chord
    assert edges[-1] == pytest.approx(0.0, abs=1e-12)
    assert (np.diff(edges) < 0.0).all()


def test_faces_around_a_swept_section_run_from_the_trailing_edge_over_the_upper_side_and_back():
    angle = np.linspace(0.0, 2.0 * np.pi, 9)
    outline = np.stack([0.5 + 0.5 * np.cos(angle), 0.1 * np.sin(angle)], axis=1)
    nodes = np.array([[(x + 0.6 * z, y, z) for z in (0.0, 1.0, 2.0)] for x, y in outline])
    quads = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2)
    shuffled = np.random.default_rng(0).permutation(16)
    around = shuffled.argsort().reshape(8, 2)
    quads = quads.reshape(-1, 4, 3)[shuffled]
    np.testing.assert_array_equal(faces_around(quads, 1.5), around[:, 1])
    np.testing.assert_allclose(_chord_ends(quads[around[:, 1]]), [0.9, 1.9])


def test_faces_around_a_section_are_one_strip_where_lines_between_strips_waver():
    angle = np.linspace(0.0, 2.0 * np.pi, 9)
    z = [0.0, 1.0, 2.0] + 1e-3 * np.random.default_rng(1).normal(size=(9, 3))
    x, y = (
        np.repeat(np.array(values)[:, None], 3, axis=1) for values in (0.5 + 0.5 * np.cos(angle), 0.1 * np.sin(angle))
    )
    nodes = np.stack([x, y, z], axis=-1)
    quads = np.stack([nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]], axis=2).reshape(-1, 4, 3)
    found = faces_around(quads, 1.0)
    assert len(found) == 8
    assert len(set(found % 2)) == 1


def test_pressures_are_drawn_over_the_chord_with_suction_above(model, nodes, axes):
    quads = nodes.reshape(-1, 3)[wall_quads(model)]
    pressures = quads[..., 1].mean(axis=1)  # one for each face: its height
    draw_pressures(axes, quads, pressures, 1.5, color="blue")
    x, height = axes.lines[0].get_data()
    assert 0.0 < x.min() < 0.1 < 0.9 < x.max() < 1.0
    assert height[: len(x) // 2].min() > 0.0 > height[len(x) // 2 + 1 :].max()
    assert axes.yaxis_inverted()
    faces = pressures[faces_around(quads, 1.5)]
    np.testing.assert_allclose(height[:: axes.lines[0].get_markevery()], faces, atol=1e-12)  # where markers are
    assert len(height) > 4 * len(faces)  # a curve
