"""Bending and hinge moments, and loads of sections, of pressures that are known."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest
from scipy.sparse import csr_array

from bspline_mdao import EulerFlow, InputError, LatticeFlow, fit_grid
from bspline_mdao.flow import HingeMoment
from bspline_mdao.flow.euler.flow_grid import FlowGrid, area_vectors
from bspline_mdao.flow.euler.forces import FlowForces
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.loads.section_loads import SECTION_LOADS
from bspline_mdao.flow.loads.span_strips import SpanStrips
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.measures import SurfaceGrid

REFERENCES = {"area": 1.16, "chord": 0.7, "reference": (0.3, 0.1, -0.2)}
FLAP = HingeMoment("flap", chord=(0.7, 1.0), span=(0.3, 0.8))
FIXED = HingeMoment("fixed", axis=[(0.5, 0.0, 0.1), (0.7, 0.1, 1.0)], span=(0.0, 0.5), reference_chord=0.2)
MOMENTS = ("CM_bending", "CM_flap", "CM_fixed")


@cache
def wing():
    """An M6 wing of 1,536 cells."""
    return fit_grid(onera_m6_grid((7, 5, 5)))


@cache
def forces_of(axes="xzy", scale=1.0):
    """Forces of the wing, and nodes off the baseline; the span may point the other way."""
    nodes = wing().regenerate().to_vector().reshape(-1, 3) * [1.0, 1.0, scale]
    flow = FlowGrid.of(wing().topology, nodes, axes)
    within = np.ones(len(flow.walls.corners), dtype=bool)
    return FlowForces.of(flow, nodes, **REFERENCES, hinges=[(FLAP, within), (FIXED, within)]), nodes


def on_faces(forces, nodes):
    """Random forces on the wall faces, where they act, and the axes."""
    wall = forces.walls.corners
    return np.random.default_rng(0).standard_normal((len(wall), 3)), nodes[wall].mean(axis=1)


def test_derivatives_agree_with_complex_steps_and_their_transposes():
    forces, nodes = forces_of()
    rng = np.random.default_rng(1)
    flow = FlowGrid.of(wing().topology, nodes)
    states = flow.discretization.uniform(free_stream(0.4, 0.1, flow.axes))
    at = (states * rng.uniform(0.8, 1.2, states.shape), nodes + 1e-3 * rng.standard_normal(nodes.shape), 0.1, 0.4)
    along = [rng.standard_normal(np.shape(value)) if np.ndim(value) else rng.standard_normal() for value in at]
    stepped = forces.evaluate(*(a + 1e-30j * d for a, d in zip(at, along)))
    change = forces.jvp(*at, *along)
    for name in (*MOMENTS, *SECTION_LOADS):
        exact = np.imag(stepped[name]) / 1e-30
        np.testing.assert_allclose(change[name], exact, rtol=1e-10, atol=1e-12 * np.abs(exact).max(), err_msg=name)
        bar = rng.standard_normal(np.shape(change[name]))
        back = forces.vjp(*at, {name: bar})
        reverse, forward = sum(np.sum(np.asarray(b) * d) for b, d in zip(back, along)), np.sum(bar * change[name])
        assert abs(forward) > 1e-8
        assert reverse == pytest.approx(forward, rel=1e-11), name


def test_bending_moment_is_that_of_forces_times_their_distance_from_the_plane_on_either_side():
    for scale in (1.0, -1.0):
        forces, nodes = forces_of(scale=scale)
        loads, arms = on_faces(forces, nodes)
        out, up = scale * arms[:, 2], arms[:, 1] - 0.1
        expected = np.sum(out * loads[:, 1] - up * scale * loads[:, 2]) / (1.16 * 0.7)
        assert forces.wing.evaluate(loads, nodes, 0.1)["CM_bending"] == pytest.approx(expected, rel=1e-12)


def test_moment_about_given_axis_is_that_of_the_forces_in_the_box():
    forces, nodes = forces_of()
    loads, arms = on_faces(forces, nodes)
    start, end = map(np.array, FIXED.axis)
    moment = forces.wing.moments["CM_fixed"]
    span = nodes[forces.walls.corners][..., 2] / np.abs(nodes[forces.walls.corners][..., 2]).max()
    inside, outside = span.max(axis=1) < 0.5, span.min(axis=1) > 0.5
    assert np.all(moment.weights[inside] == 1.0)
    assert np.all(moment.weights[outside] == 0.0)
    cross = (moment.weights @ np.cross(arms - start, loads)) @ (end - start) / np.linalg.norm(end - start)
    found = forces.wing.evaluate(loads, nodes, 0.1)["CM_fixed"]
    assert found == pytest.approx(cross / (1.16 * 0.2), rel=1e-12)


@pytest.mark.parametrize("scale", [1.0, -1.0])
def test_lift_behind_the_hinge_turns_the_trailing_edge_up_on_either_side(scale):
    forces, nodes = forces_of(scale=scale)
    up = np.tile([0.0, 1.0, 0.0], (len(forces.walls.corners), 1))
    flap = forces.wing.moments["CM_flap"]
    assert forces.wing.evaluate(up, nodes, 0.0)["CM_flap"] < 0.0
    start, end = flap.ends @ nodes
    assert abs(start[2]) != pytest.approx(abs(end[2]))
    moved = nodes + [0.3, -0.2, 0.1]
    assert flap.evaluate(up, moved) == pytest.approx(flap.evaluate(up, nodes), rel=1e-10)


def whole_wing():
    """Nodes and quads around a wing with chord 1 and no plane of symmetry, its tips at -1.5 and 2."""
    angles, span = np.linspace(0.0, 2.0 * np.pi, 25)[:-1], np.linspace(-1.5, 2.0, 15)
    section = np.column_stack([0.5 + 0.5 * np.cos(angles), 0.06 * np.sin(angles)])
    nodes = np.array([[x, y, z] for z in span for x, y in section])
    ids = np.arange(len(nodes)).reshape(len(span), len(section))
    after = np.roll(ids, -1, axis=1)
    return nodes, np.stack([ids[:-1], after[:-1], after[1:], ids[1:]], axis=-1).reshape(-1, 4)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("span", [(0.25, 0.75), (-0.5, -0.25)])
def test_hinges_of_a_whole_wing_are_on_the_side_that_their_span_says(side, span):
    nodes, quads = whole_wing()
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, side], [0.0, 1.0, 0.0]])
    strips = SpanStrips.of(quads, nodes, axes, is_symmetric=False, n_strips=14)
    points = csr_array((np.full(quads.size, 0.25), quads.ravel(), np.arange(0, quads.size + 1, 4)))
    hinge = HingeMoment("flap", chord=(0.7, 1.0), span=span)
    moment = hinge.moment(points, (1.16, 0.7), strips, nodes, quads, np.ones(len(quads), dtype=bool))
    places, (low, high) = points @ nodes, np.sort(side * 2.0 * np.array(span))  # by the farther tip
    np.testing.assert_allclose(np.sort((moment.ends @ nodes)[:, 2]), [low, high], atol=1e-12)
    np.testing.assert_allclose((moment.ends @ nodes)[:, :2], [[0.7, 0.0]] * 2, atol=1e-12)
    is_near = (places[:, 2] > low - 0.25) & (places[:, 2] < high + 0.25)
    assert moment.weights[is_near & (places[:, 0] > 0.8)].any()
    assert not moment.weights[~is_near].any()
    lift = np.tile([0.0, 1.0, 0.0], (len(quads), 1))
    expected = -moment.weights @ (places[:, 0] - 0.7) / (1.16 * 0.7)
    assert moment.evaluate(lift, nodes) == pytest.approx(expected, rel=1e-12)
    assert expected < 0.0


def test_loads_of_sections_add_up_to_those_of_the_wing():
    forces, nodes = forces_of()
    loads, _ = on_faces(forces, nodes)
    alpha = 0.1
    found, strips = forces.wing.evaluate(loads, nodes, alpha), forces.wing.induced.strips
    np.testing.assert_allclose(found["strip_chord"] * found["strip_cl"], found["span_load"], rtol=1e-12)
    trace = strips.trailing @ nodes @ np.array([[0.0, -np.sin(alpha)], [0.0, np.cos(alpha)], [-1.0, 0.0]])
    widths = np.linalg.norm(np.diff(trace, axis=0), axis=1)
    assert np.sum(found["strip_cd"] * found["strip_chord"] * widths) == pytest.approx(found["CD"] * 1.16, rel=1e-12)
    assert np.all(np.diff(found["strip_span"]) < 0.0)
    root, tip = nodes[np.abs(nodes[:, 2]) < 1e-9], found["strip_chord"][0]
    assert tip < found["strip_chord"][-1] < np.ptp(root[:, 0])


def test_pressure_that_is_the_same_everywhere_hardly_loads_the_sections():
    forces, nodes = forces_of()
    areas = area_vectors(nodes, forces.walls.corners)
    found = forces.wing.evaluate(areas, nodes, 0.05)
    inner = slice(1, None)  # the first strip has the side of the tip
    assert np.abs(found["strip_cd"][inner]).max() < 0.1
    assert np.abs(found["strip_cl"][inner]).max() < 0.1


def flown(**options):
    problem = om.Problem(reports=False)
    flow = EulerFlow(model=wing(), reference_area=1.16, iprint=0, **options)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup(mode="rev")
    return problem


def test_part_of_the_wall_is_named_by_patch_or_surface():
    surface = SurfaceGrid.of(wing())
    name = surface.patches[0]
    hinges = [HingeMoment("a", patches=name), HingeMoment("b", patches=surface), HingeMoment("c")]
    problem = flown(hinges=[HingeMoment(h.name, patches=h.patches, axis=FIXED.axis) for h in hinges])
    problem.run_model()
    values = [problem.get_val(f"CM_{name}").item() for name in "abc"]
    assert values[1] == pytest.approx(values[2], rel=1e-12)
    assert abs(values[0]) > 0.0
    totals = problem.compute_totals(["CM_a", "CM_bending", "strip_cm"], ["alpha"])
    assert all(np.abs(total).min() > 0.0 for total in totals.values())


def test_lattice_has_the_same_names_and_nearly_the_same_bending_moment():
    euler, lattice = flown(), om.Problem(reports=False)
    lattice.model.add_subsystem("flow", LatticeFlow(model=wing(), reference_area=1.16), promotes=["*"])
    lattice.setup()
    for problem in (euler, lattice):
        problem.set_val("alpha", 3.0)
        problem.run_model()
    ratios = [euler.get_val(name) / lattice.get_val(name) for name in ("CL", "CM_bending")]
    assert ratios[1] == pytest.approx(ratios[0], rel=0.1)
    assert np.all(lattice.get_val("strip_cl") > 0.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"name": "my flap"}, "hinge 'my flap': give a name"),
        ({"name": "a", "chord": (1.0, 0.7)}, "chord .*the lower one first"),
        ({"name": "a", "axis": [(0.0, 0.0, 0.0)] * 2}, "give two different points"),
        ({"name": "a", "reference_area": 0.0}, "reference_area 0.0; give a positive number"),
    ],
)
def test_hinges_that_cannot_be_used_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        HingeMoment(**options)


def test_hinges_without_faces_or_with_a_name_that_is_there_are_refused():
    with pytest.raises(InputError, match="hinge a: none of its patches lies in chord"):
        flown(hinges=[HingeMoment("a", span=(-0.9, -0.5))])
    with pytest.raises(InputError, match="there is a moment CM_bending already; give another name"):
        flown(hinges=[HingeMoment("bending")])
