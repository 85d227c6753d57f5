"""Camber surface, wake, and OpenAeroStruct's vortex lattice between them."""

import sys
from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest
from openmdao.utils.assert_utils import assert_check_partials

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.measures.camber_surface import SPACINGS, CamberSurface
from bspline_mdao.core.mesh.surface import SurfaceGrid
from bspline_mdao.flow.loads.induced_drag import Wake, least_drag
from bspline_mdao.flow.om.vortex_lattice import VortexLattice, WakeForces
from bspline_mdao.generators import Planform, Spacing, Wing, cambered_section, hh_wing_grid, rectangular_wing
from bspline_mdao.testing import total_difference

SWEPT = Wing(Planform(1.2, 2.0, 0.5, 25.0), cambered_section(0.1, 0.03))


def wall(wing, shape=(11, 9, 11)):
    grid = hh_wing_grid(wing, shape, Spacing(0.01, 0.02, 0.02, 0.02))
    return SurfaceGrid.of(fit_grid(grid, n_control=(6, 5, 6)))


@pytest.fixture(scope="module")
def swept():
    return wall(SWEPT)


@pytest.fixture(scope="module")
def mesh(swept):
    return CamberSurface.of(swept, 4, 7, span_spacing="tip")


def nodes_of(camber):
    return camber.evaluate(camber.surface.points)


@pytest.mark.slow
def test_camber_of_a_symmetric_wing_is_its_chord_plane_exactly():
    nodes = nodes_of(CamberSurface.of(wall(rectangular_wing()), 5, 6))
    planform = rectangular_wing().planform
    np.testing.assert_allclose(
        nodes[..., 0], planform.root_chord * np.linspace(0.0, 1.0, 5)[:, None] * np.ones(6), atol=1e-14
    )
    np.testing.assert_allclose(
        nodes[..., 1], -planform.semi_span * np.linspace(1.0, 0.0, 6) * np.ones((5, 1)), atol=1e-14
    )
    np.testing.assert_allclose(nodes[..., 2], 0.0, atol=1e-15)


@pytest.mark.slow
def test_camber_surface_follows_planform_and_camber_line_to_second_order_in_the_node_spacing():
    errors = []
    for shape in ((9, 5, 9), (17, 5, 17), (33, 5, 33)):
        nodes = nodes_of(CamberSurface.of(wall(SWEPT, shape), 6, 4, chord_spacing="cosine", ends=(0.0, 1.4)))
        chord = SWEPT.planform.x(1.0, -nodes[0, :, 1]) - SWEPT.planform.x(0.0, -nodes[0, :, 1])
        fractions = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 6))[:, None]
        np.testing.assert_allclose(nodes[..., 0], SWEPT.planform.x(fractions, -nodes[..., 1]), atol=1e-12)
        errors.append(np.abs(nodes[..., 2] - chord * 4.0 * 0.03 * fractions * (1.0 - fractions)).max())
    assert errors[2] < 0.05 * 0.03
    assert errors[0] / errors[2] > 10.0


@pytest.mark.slow
def test_camber_nodes_go_from_leading_to_trailing_edge_and_from_left_tip_to_root(mesh):
    nodes = nodes_of(mesh)
    assert (np.diff(nodes[..., 0], axis=0) > 0.0).all()
    assert (np.diff(nodes[..., 1], axis=1) > 0.0).all()
    np.testing.assert_allclose(nodes[0, [0, -1], 1], [-2.0, 0.0], atol=1e-15)
    steps = np.diff(nodes[0, :, 1])
    assert (np.diff(steps) > 0.0).all()  # closer towards the tip


@pytest.mark.slow
def test_camber_surface_is_linear_in_the_nodes_and_carried_by_affine_motions(mesh):
    points, rng = mesh.surface.points, np.random.default_rng(3)
    map_, shift = rng.standard_normal((3, 3)), rng.standard_normal(3)
    moved = points @ map_ + shift
    expected = (nodes_of(mesh) @ mesh.axes @ map_ + shift) @ mesh.axes.T
    np.testing.assert_allclose(mesh.evaluate(moved), expected, atol=1e-13)
    np.testing.assert_allclose(mesh.partials(points) @ moved.ravel(), mesh.evaluate(moved).ravel(), atol=1e-12)
    complex_mesh = mesh.evaluate(points + 1j * moved)
    np.testing.assert_allclose(complex_mesh.imag, mesh.evaluate(moved), atol=1e-12)


@pytest.mark.slow
def test_camber_surface_is_the_same_for_the_left_wing_and_for_other_axes(swept, mesh):
    x, y, z = swept.points.T
    turned = replace(swept, points=np.stack([x, -z, y], axis=1))  # z up
    left = replace(swept, points=np.stack([x, y, -z], axis=1), faces=tuple(face.T for face in swept.faces))
    for surface, axes in ((turned, "xyz"), (left, "xzy")):
        other = CamberSurface.of(surface, 4, 7, span_spacing="tip", axes=axes)
        np.testing.assert_allclose(nodes_of(other), nodes_of(mesh), atol=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"axes": "xyy"}, "downstream, along the span, up"),
        ({"n_chord": 1}, "1 nodes along the chord; give 2"),
        ({"span_spacing": "dense"}, "no spacing 'dense' along the span; choose from uniform, cosine, tip"),
        ({"ends": (0.0, 3.0)}, "the upper side has no section at 3 along the span"),
    ],
)
def test_camber_surface_refuses_what_it_cannot_cut(swept, options, message):
    with pytest.raises(InputError, match=message) as error:
        CamberSurface.of(swept, **{"n_chord": 3, "n_span": 4, **options})
    assert "\n" not in str(error.value)


def wake(is_symmetric, n=6, seed=0):
    rng = np.random.default_rng(seed)
    points = np.column_stack([np.linspace(-1.5, 0.0 if is_symmetric else 1.5, n + 1), np.zeros(n + 1)])
    points += 0.05 * rng.standard_normal(points.shape)
    points[-1, 0] *= not is_symmetric
    return Wake(points, rng.standard_normal(n), is_symmetric)


@pytest.mark.parametrize("is_symmetric", [True, False])
@pytest.mark.parametrize("force", ["lift", "drag"])
def test_wake_gradients_agree_with_complex_steps(is_symmetric, force):
    at, rng = wake(is_symmetric), np.random.default_rng(1)
    d_points, d_circulations = rng.standard_normal(at.points.shape), rng.standard_normal(6)
    stepped = Wake(at.points + 1e-30j * d_points, at.circulations + 1e-30j * d_circulations, is_symmetric)
    points_bar, circulations_bar = getattr(at, f"{force}_gradients")()
    slope = np.sum(points_bar * d_points) + circulations_bar @ d_circulations
    assert getattr(stepped, force).imag / 1e-30 == pytest.approx(slope, rel=1e-12)


def test_symmetric_wake_is_half_of_the_whole_one():
    half = wake(is_symmetric=True)
    mirrored = half.points[-2::-1] * [-1.0, 1.0]
    whole = Wake(
        np.concatenate([half.points, mirrored]), np.concatenate([half.circulations, half.circulations[::-1]]), False
    )
    assert whole.lift == pytest.approx(half.lift, rel=1e-13)
    assert whole.drag == pytest.approx(half.drag, rel=1e-13)


@pytest.mark.parametrize(("n", "is_symmetric", "n_strips"), [(5, True, 10), (12, True, 24), (7, False, 7)])
def test_least_drag_of_equal_strips_has_span_efficiency_one_plus_one_by_their_number(n, is_symmetric, n_strips):
    y = np.linspace(-1.5, 0.0 if is_symmetric else 1.5, n + 1)
    best = least_drag(np.column_stack([y, np.zeros(n + 1)]), 0.7, is_symmetric)
    assert best.lift == pytest.approx(0.7, rel=1e-13)
    assert 2.0 * 0.7**2 / (np.pi * 3.0**2 * best.drag) == pytest.approx(1.0 + 1.0 / n_strips, rel=1e-12)


def test_load_of_least_drag_is_an_ellipse_where_there_are_many_strips():
    y = np.linspace(-1.5, 0.0, 101)
    best = least_drag(np.column_stack([y, np.zeros(101)]), 1.0)
    ellipse = np.sqrt(1.0 - ((y[1:] + y[:-1]) / 3.0) ** 2)
    np.testing.assert_allclose(best.circulations[5:], (ellipse * 4.0 / (np.pi * 3.0))[5:], rtol=0.03)


def test_least_drag_is_less_than_that_of_any_other_load_of_the_same_lift():
    best, rng = least_drag(wake(is_symmetric=True).points, 1.0), np.random.default_rng(4)
    for _ in range(5):
        other = Wake(best.points, best.circulations + 0.1 * rng.standard_normal(6))
        assert best.drag < (best.lift / other.lift) ** 2 * other.drag


def lattice(nodes, mode="auto", **values):
    problem = om.Problem(reports=False)
    options = {"reference_area": values.pop("reference_area", None)}
    group = VortexLattice(n_chord=nodes.shape[0], n_span=nodes.shape[1], **options)
    problem.model.add_subsystem("flow", group, promotes=["*"])
    problem.setup(mode=mode)
    for name, value in {"camber_surface": nodes, **values}.items():
        problem.set_val(name, value)
    problem.run_model()
    return problem


FLIGHT = {"alpha": 3.0, "Mach_number": 0.4, "velocity": 60.0, "density": 0.9, "moment_reference": [0.3, 0.0, 0.1]}
OUTPUTS = ("CL", "CD", "CL_panels", "CD_panels", "CM", "span_load", "S_ref")


def test_panel_forces_are_those_of_openaerostruct(mesh):
    nodes = nodes_of(mesh)
    surface = {"name": "wing", "symmetry": True, "S_ref_type": "projected", "mesh": nodes, "with_viscous": False,
               "with_wave": False, "CL0": 0.0, "CD0": 0.0, "k_lam": 0.05, "c_max_t": 0.3}  # fmt: skip
    from openaerostruct.aerodynamics.aero_groups import AeroPoint

    problem = om.Problem(reports=False)
    promotes = ["v", "alpha", "Mach_number", "rho", "cg", "CL", "CD", "CM"]
    problem.model.add_subsystem("point", AeroPoint(surfaces=[surface], compressible=True), promotes=promotes)
    for name, value in {"v": 60.0, "rho": 0.9, "alpha": 3.0, "cg": FLIGHT["moment_reference"]}.items():
        units = {"v": "m/s", "rho": "kg/m**3", "alpha": "deg", "cg": "m"}[name]
        problem.model.set_input_defaults(name, val=value, units=units)
    problem.model.set_input_defaults("Mach_number", val=0.4)
    problem.setup()
    problem.set_val("point.wing.def_mesh", nodes)
    problem.set_val("point.aero_states.wing_def_mesh", nodes)
    problem.run_model()
    ours = lattice(nodes, **FLIGHT)
    for name, theirs in (("CL_panels", "CL"), ("CD_panels", "CD"), ("CM", "CM")):
        np.testing.assert_allclose(ours.get_val(name), problem.get_val(theirs), rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("mach", [0.0, 0.6])
def test_wake_and_panels_agree_on_a_flat_wing_at_a_small_angle(mach):
    nodes = nodes_of(CamberSurface.of(wall(rectangular_wing()), 4, 9))
    found = lattice(nodes, alpha=0.1, Mach_number=mach)
    for name in ("CL", "CD"):
        assert found.get_val(f"{name}_panels") == pytest.approx(found.get_val(name), rel=1e-4)
    strips = np.diff(nodes[0, :, 1])
    assert 2.0 * strips @ found.get_val("span_load") / found.get_val("S_ref") == pytest.approx(found.get_val("CL"))


class Twisted(om.ExplicitComponent):
    """Lattice of a wing of aspect ratio 6 whose strips turn about the trailing edge, by heights of the leading edge."""

    def initialize(self):
        self.options.declare("y")

    def setup(self):
        self._y, self._x = self.options["y"], np.linspace(0.0, 1.0, 3)[:, None]
        n = len(self._y)
        self.add_input("rise", np.zeros(n), units="m")
        self.add_output("camber_surface", shape=(3, n, 3), units="m")
        columns, slopes = np.tile(np.arange(n), 3), np.repeat(1.0 - self._x, n)
        self.declare_partials("*", "*", rows=3 * np.arange(3 * n) + 2, cols=columns, val=slopes)

    def compute(self, inputs, outputs):
        outputs["camber_surface"] = np.stack(
            np.broadcast_arrays(self._x, self._y, (1.0 - self._x) * inputs["rise"]), -1
        )


@pytest.mark.slow
@pytest.mark.parametrize(("spacing", "abuse"), [("uniform", 1.15), ("tip", 5.0)])
def test_free_twist_drives_the_drag_of_the_panels_below_munks_but_never_that_of_the_wake(spacing, abuse):
    """Why the optimisations take the drag of the wake: the panels leave out the forces on chordwise vortices."""
    problem, y = om.Problem(reports=False), -3.0 * SPACINGS[spacing](11)[::-1]
    problem.model.add_subsystem("twist", Twisted(y=y), promotes=["*"])
    problem.model.add_subsystem("flow", VortexLattice(n_chord=3, n_span=11), promotes=["*"])
    problem.model.add_design_var("rise", lower=-0.5, upper=0.5, ref=0.1)
    problem.model.add_constraint("CL_panels", equals=0.5)
    problem.model.add_objective("CD_panels", ref=0.01)
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", tol=1e-9, maxiter=100, disp=False)
    problem.setup(mode="rev")
    problem.run_driver()
    lift, drag, lift_of_panels, drag_of_panels = (
        problem.get_val(name).item() for name in ("CL", "CD", "CL_panels", "CD_panels")
    )
    munk = 2.0 / (np.pi * 36.0 * least_drag(np.column_stack([y, 0.0 * y]), 1.0).drag)
    assert lift_of_panels**2 / (np.pi * 6.0 * drag_of_panels) > abuse * munk
    assert lift**2 / (np.pi * 6.0 * drag) < munk


def test_coefficients_do_not_depend_on_speed_and_density_and_refer_to_the_area_given(mesh):
    nodes = nodes_of(mesh)
    reference, other = lattice(nodes, **FLIGHT), lattice(nodes, **{**FLIGHT, "velocity": 200.0, "density": 0.1})
    fixed = lattice(nodes, **FLIGHT, reference_area=7.0)
    for name in OUTPUTS[:5]:
        np.testing.assert_allclose(other.get_val(name), reference.get_val(name), rtol=1e-12)
        scale = reference.get_val("S_ref") / 7.0
        np.testing.assert_allclose(fixed.get_val(name), scale * reference.get_val(name), rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["fwd", "rev"])
def test_totals_agree_with_extrapolated_differences(mesh, mode):
    rng = np.random.default_rng(2)
    nodes = nodes_of(mesh) + 0.02 * rng.standard_normal(mesh.shape) * [1.0, 0.0, 1.0]
    problem, names = lattice(nodes, mode, **FLIGHT), ["camber_surface", "alpha", "Mach_number", "moment_reference"]
    totals = problem.compute_totals(list(OUTPUTS), names)
    for name in names:
        direction = (0.1 if name == "camber_surface" else 1.0) * rng.standard_normal(problem.get_val(name).shape)
        exact = np.concatenate([np.atleast_2d(totals[of, name]) @ direction.ravel() for of in OUTPUTS])
        found = np.concatenate([*total_difference(problem, OUTPUTS, {name: direction}).values()])
        np.testing.assert_allclose(exact, found, atol=1e-10 * max(1.0, abs(exact).max()))


def test_partials_of_wake_forces_agree_with_complex_steps(mesh):
    problem, rng = om.Problem(reports=False), np.random.default_rng(5)
    problem.model.add_subsystem("wake", WakeForces(n_chord=4, n_span=7), promotes=["*"])
    problem.setup(force_alloc_complex=True)
    problem.set_val("camber_surface", nodes_of(mesh) + 0.05 * rng.standard_normal(mesh.shape))
    problem.set_val("circulations", rng.standard_normal(18))
    for name, value in {"alpha": 5.0, "Mach_number": 0.5, "velocity": 3.0, "S_ref": 2.0}.items():
        problem.set_val(name, value)
    problem.run_model()
    problem.model.wake.set_check_partial_options("*", method="cs", step=1e-40)
    data = problem.check_partials(compact_print=True, out_stream=None)
    assert len(data["wake"]) == 18
    assert_check_partials(data, atol=1e-13, rtol=1e-10)


def test_what_to_install_is_told_in_one_line(monkeypatch, mesh):
    for name in [name for name in sys.modules if name.split(".")[0] == "openaerostruct"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "openaerostruct", None)
    with pytest.raises(InputError, match=r'pip install "bspline_mdao\[vlm\]"') as error:
        lattice(nodes_of(mesh))
    assert "\n" not in str(error.value)
