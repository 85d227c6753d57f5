"""The flow by the Euler equations as an OpenMDAO group: derivatives of every output, failures, warm starts."""

import warnings
from dataclasses import replace
from functools import cache

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import EulerFlow, FittedModel, GridMovement, InputError, fit_grid
from bspline_mdao.design import Local, OnPatch, Parametrization, ReferenceAxis, Twist
from bspline_mdao.flow import ReferenceWarning
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.forces import FlowForces
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.flow.euler.walls import Walls
from bspline_mdao.flow.om.references import warn_of_area
from bspline_mdao.generators import infinite_wing_grid, naca_section, onera_m6_grid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.testing import central_difference

COEFFICIENTS = ("CL", "CD", "CM", "CD_induced", "CD_entropy")
OUTPUTS = (*COEFFICIENTS, "span_load", "Cp")
STREAM = ("alpha", "Mach_number")


@cache
def wing() -> FittedModel:
    """A coarse M6 wing of 2,880 cells."""
    return fit_grid(onera_m6_grid((9, 7, 6)))


def problem(mode="auto", **options) -> om.Problem:
    """The flow about the wing at an angle of 3 degrees."""
    problem = om.Problem(reports=False)
    flow = EulerFlow(model=wing(), reference_area=1.16, moment_reference=(0.3, 0.1, -0.2), **options)
    problem.model.add_subsystem("flow", flow, promotes=["*"])
    problem.setup(mode=mode)
    problem.set_val("alpha", 3.0)
    return problem


def values(problem) -> np.ndarray:
    """These coefficients in one row."""
    return np.concatenate([problem.get_val(name).ravel() for name in COEFFICIENTS])


@pytest.fixture(scope="module")
def flown():
    """A tightly converged run, with differences that are good for seven digits."""
    flown = problem(tolerance=1e-12)
    flown.run_model()
    return flown


def random_forces(seed=0):
    """Forces, states far from uniform, nodes off the baseline."""
    rng, nodes = np.random.default_rng(seed), wing().regenerate().to_vector().reshape(-1, 3)
    flow = FlowGrid.of(wing().topology, nodes)
    states = flow.discretization.uniform(free_stream(0.4, 0.1, flow.axes))
    states *= rng.uniform(0.8, 1.2, states.shape)
    nodes = nodes + 1e-3 * rng.standard_normal(nodes.shape)
    return FlowForces.of(flow, nodes, 1.16, 0.7, (0.1, 0.2, 0.3)), (states, nodes, 0.1, 0.4)


def random_directions(at, seed=1):
    rng = np.random.default_rng(seed)
    return [rng.standard_normal(np.shape(value)) if np.ndim(value) else rng.standard_normal() for value in at]


@pytest.mark.slow
def test_forces_agree_with_complex_steps_in_states_nodes_angle_and_mach_number():
    forces, at = random_forces()
    along = random_directions(at)
    found = forces.jvp(*at, *along)
    for name, value in forces.evaluate(*(a + 1e-30j * d for a, d in zip(at, along))).items():
        exact = np.imag(value) / 1e-30
        np.testing.assert_allclose(found[name], exact, rtol=1e-10, atol=1e-12 * np.abs(exact).max(), err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("name", OUTPUTS)
def test_products_with_the_forces_are_transposes(name):
    forces, at = random_forces()
    along = random_directions(at)
    change = np.atleast_1d(forces.jvp(*at, *along)[name])
    bar = np.random.default_rng(2).standard_normal(change.shape)
    back = forces.vjp(*at, {name: bar})
    reverse = sum(np.sum(np.asarray(b) * d) for b, d in zip(back, along))
    assert abs(change @ bar) > 1e-8
    assert reverse == pytest.approx(change @ bar, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", STREAM)
def test_totals_by_the_stream_agree_with_differences_of_converged_flows(flown, name):
    start = flown.get_val(name).copy()
    totals = flown.compute_totals(COEFFICIENTS, [name])

    def run(step):
        flown.set_val(name, start + step)
        flown.run_model()
        return values(flown)

    exact = central_difference(run, 2e-2 if name == "alpha" else 2e-3, levels=2)
    run(0.0)
    found = np.concatenate([totals[of, name].ravel() for of in COEFFICIENTS])
    np.testing.assert_allclose(found, exact, rtol=1e-7, atol=1e-8 * np.abs(exact).max())


@pytest.mark.slow
def test_totals_by_nodes_of_the_grid_agree_with_differences_of_converged_flows(flown):
    nodes, rng = flown.get_val("grid").copy(), np.random.default_rng(3)
    totals = flown.compute_totals(COEFFICIENTS, ["grid"])
    by_node = np.concatenate([totals[of, "grid"].reshape(-1, nodes.size) for of in COEFFICIENTS])
    entries = rng.choice(np.flatnonzero(np.abs(by_node).max(axis=0) > 1e-3 * np.abs(by_node).max()), 4, replace=False)
    for entry in entries:

        def run(step, entry=entry):
            flown.set_val("grid", nodes + step * (np.arange(nodes.size) == entry))
            flown.run_model()
            return values(flown)

        exact = central_difference(run, 2e-4, levels=2)
        run(0.0)
        np.testing.assert_allclose(by_node[:, entry], exact, rtol=1e-7, atol=1e-7 * np.abs(exact).max())


@pytest.mark.slow
def test_forward_and_adjoint_totals_agree():
    totals = []
    for mode in ("fwd", "rev"):
        flown = problem(mode)
        flown.run_model()
        totals.append(flown.compute_totals(COEFFICIENTS, STREAM))
    for key, forward in totals[0].items():
        assert np.abs(totals[1][key] - forward).max() < 1e-11 * np.abs(forward).max(), key


@pytest.mark.slow
def test_rigid_translation_changes_no_force(flown):
    totals = flown.compute_totals(["CL", "CD", "CD_induced", "CD_entropy"], ["grid"])
    for key, total in totals.items():
        by_node = total.reshape(-1, 3)
        moves = by_node[:, :2] if key[0] == "CD_induced" else by_node  # whose wake knows the plane of symmetry
        assert np.abs(moves.sum(axis=0)).max() < 1e-11 * np.abs(by_node).sum()


@pytest.mark.slow
def test_chain_from_design_variables_to_lift_has_a_taylor_remainder_of_second_order():
    model = wing()
    mesh = moving_mesh(model)
    variables = [
        Twist("twist", ReferenceAxis.of(mesh, at=0.25), stations=3),
        Local("bumps", OnPatch(model, "wing*"), "y"),
    ]
    chain = om.Problem(reports=False)
    movement = GridMovement(model=model, parametrization=Parametrization(mesh, variables))
    chain.model.add_subsystem("movement", movement, promotes=["*"])
    chain.model.add_subsystem("flow", EulerFlow(model=model, reference_area=1.16, tolerance=1e-12), promotes=["*"])
    chain.setup(mode="rev")
    chain.run_model()
    names, rng = ("twist", "bumps", "alpha"), np.random.default_rng(4)
    starts = {name: chain.get_val(name).copy() for name in names}
    scales = {"twist": 1.0, "bumps": 1e-3, "alpha": 1.0}
    along = {name: scales[name] * rng.standard_normal(start.shape) for name, start in starts.items()}
    totals = chain.compute_totals(["CL"], names)
    slope = sum((totals["CL", name] @ along[name].ravel()).item() for name in names)

    def lift(step):
        for name in names:
            chain.set_val(name, starts[name] + step * along[name])
        chain.run_model()
        return chain.get_val("CL").item()

    remainders = [abs(lift(step) - lift(0.0) - step * slope) for step in (0.1, 0.05, 0.025)]
    rates = np.log2(np.divide(remainders[:-1], remainders[1:]))
    assert np.all(rates > 1.9)


@pytest.mark.slow
def test_flow_that_does_not_converge_is_refused_with_its_history_and_the_next_one_is_solved():
    flown = problem()
    flown.run_model()
    states, lift = flown.get_val("states").copy(), flown.get_val("CL").item()
    flown.model.flow.state.options["max_steps"] = 1
    flown.set_val("alpha", 6.0)
    with pytest.raises(
        om.AnalysisError,
        match=r"did not converge: residual .* after 1 steps .* largest in block \d+, cell \(.*Mach number is "
        r".*; take a smaller angle or Mach number",
    ) as error:
        flown.run_model()
    assert "\n" not in str(error.value)
    np.testing.assert_array_equal(flown.get_val("states"), states)
    with pytest.raises(om.AnalysisError, match="no derivatives at a residual of"):
        flown.compute_totals(["CL"], ["alpha"])
    flown.model.flow.state.options["max_steps"] = 50
    flown.set_val("alpha", 3.0)
    flown.run_model()
    assert flown.get_val("CL").item() == pytest.approx(lift, rel=1e-9)


@pytest.mark.slow
def test_node_that_is_not_finite_is_refused():
    flown = problem()
    flown.set_val("grid", np.nan, indices=7)
    with pytest.raises(om.AnalysisError, match=r"grid\[7\], y of point 3, is nan"):
        flown.run_model()


@pytest.mark.slow
def test_cells_with_negative_volumes_are_counted_and_the_worst_is_named_before_the_solver_starts():
    flown = problem()
    state = flown.model.flow.state
    faces, nodes = state.options["flow"].faces, flown.get_val("grid").reshape(-1, 3).copy()
    cell = int(np.ravel_multi_index((3, 2, 1), faces.layout.shapes[0]))
    corners = np.unique(faces.corners[faces.left == cell])
    nodes[corners] = 2.0 * nodes[corners].mean(axis=0) - nodes[corners]  # inside out, as its own mirror image
    flown.set_val("grid", nodes.ravel())
    n_negative = np.count_nonzero(faces.volumes(nodes) < 0.0)
    assert n_negative > 0
    with pytest.raises(om.AnalysisError, match=rf"{n_negative} of 2880 cells have negative volumes.*block 1, cell"):
        flown.run_model()
    assert state.solution is None


@pytest.mark.slow
def test_next_design_starts_from_the_last_states():
    flown = problem()
    flown.run_model()
    state = flown.model.flow.state
    cold = sum(step.n_products for step in state.solution.history)
    flown.set_val("alpha", 3.5)
    flown.run_model()
    assert sum(step.n_products for step in state.solution.history) < 0.8 * cold
    carried = state.solution.history[0].residual
    flown.set_val("alpha", 3.0)
    flown.set_val("states", flown.get_val("states") + 1e-12)  # of no solution: they are taken as they are
    flown.run_model()
    assert carried < 0.3 < state.solution.history[0].residual


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("reference_area", None, "reference area None; give a positive number of square metres"),
        ("reference_area", 0.0, "reference area 0.0"),
        ("reference_chord", "long", "reference chord long; give a positive number of metres"),
        ("moment_reference", (0.0, 1.0), "moment reference .* give the coordinates x, y and z of a point"),
        ("axes", "xzz", "axes 'xzz'; name x, y and z"),
    ],
)
def test_options_that_cannot_be_used_are_refused(option, value, message):
    options = {"reference_area": 1.16, option: value}
    with pytest.raises(InputError, match=message):
        om.Problem(EulerFlow(model=wing(), **options), reports=False).setup()


@pytest.mark.parametrize("mach", [0.0, -0.3, np.nan])
def test_mach_number_that_is_not_positive_is_refused(mach):
    flown = problem()
    flown.set_val("Mach_number", mach)
    with pytest.raises(om.AnalysisError, match="Mach_number is"):
        flown.run_model()


@pytest.mark.slow
def test_complex_step_through_a_flow_is_refused():
    flown = om.Problem(reports=False)
    flown.model.add_subsystem("flow", EulerFlow(model=wing(), reference_area=1.16), promotes=["*"])
    flown.model.approx_totals("cs")
    flown.setup(force_alloc_complex=True)
    flown.run_model()
    with pytest.raises(InputError, match="there is no complex step through it"):
        flown.compute_totals(["CL"], ["alpha"])


def test_plane_of_symmetry_away_from_span_0_is_refused():
    nodes = wing().regenerate().to_vector().reshape(-1, 3)
    with pytest.raises(InputError, match="plane of symmetry is at span 1; shift the grid"):
        FlowForces.of(FlowGrid.of(wing().topology, nodes), nodes + np.array([0.0, 0.0, 1.0]), 1.16)


def n_warnings(run) -> int:
    """How often a call warns of references."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run()
    return sum(issubclass(each.category, ReferenceWarning) for each in caught)


def test_a_reference_area_in_another_unit_is_warned_of():
    for area, is_warned in (
        (1.16e6, True),
        (1.16e-6, True),
        (1.16, False),
        (0.58, False),
        (2.32, False),
        (20.0, False),
    ):
        flow = EulerFlow(model=wing(), reference_area=area)
        assert n_warnings(om.Problem(flow, reports=False).setup) == is_warned


def test_no_area_that_is_usual_for_a_missile_a_disk_a_fin_or_a_thin_section_is_warned_of():
    def warned(area, views):  # faces on both sides of a body with these areas seen along x, y and z
        faces = np.diag(views)
        return n_warnings(lambda: warn_of_area("flow", area, np.concatenate([faces, -faces])))

    assert not warned(0.785, (0.785, 15.0, 15.0))
    assert not warned(0.785, (0.785, 0.0, 0.0))
    assert not warned(2.0, (0.2, 0.0, 2.0))
    assert not warned(1e-3, (1e-4, 1e-3, 0.0))
    assert warned(1.0, (1e-4, 1e-3 / 2, 0.0))
    assert warned(1.0, (1e5, 1e6, 0.0))


@pytest.mark.slow
def test_wing_between_two_planes_of_symmetry_has_no_induced_drag():
    model = fit_grid(infinite_wing_grid(naca_section(0.12), (9, 7)))
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    flow = FlowGrid.of(model.topology, nodes)
    forces = FlowForces.of(flow, nodes, 1.0)
    rng, states = np.random.default_rng(5), flow.discretization.uniform(free_stream(0.4, 0.1, flow.axes))
    found = forces.evaluate(states * rng.uniform(0.9, 1.1, states.shape), nodes, 0.1, 0.4)
    assert found["CD_induced"] == 0.0
    assert np.abs(found["span_load"]).min() > 0.0


def test_body_without_walls_is_refused():
    model = wing()
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    flow = FlowGrid.of(model.topology, nodes)
    patches = tuple(replace(patch, kind="farfield") for patch in flow.faces.boundary)
    faces = replace(flow.faces, boundary=patches)
    open_flow = replace(flow, discretization=replace(flow.discretization, faces=faces), walls=Walls.of(faces))
    with pytest.raises(InputError, match="no patch is a wall"):
        FlowForces.of(open_flow, nodes, 1.16)


def test_boundary_that_is_not_declared_is_named():
    from component_cases import small_model

    flown = om.Problem(EulerFlow(model=small_model(), reference_area=1.0), reports=False)
    with pytest.raises(InputError, match=r"patch 'unassigned' .* is of no kind; declare it as one of wall, symmetry"):
        flown.setup()
