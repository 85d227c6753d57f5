"""Whatever users make and hand on can be pickled and deep-copied, before and after it was used, with equal bits."""

import copy
import pickle
from functools import cache

import geometry_cases
import numpy as np
import openmdao.api as om
import pytest
from mover_cases import MOVERS
from parametrization_cases import CONSTRAINTS, OF_SECTIONS, VARIABLES, section_model, surface_of, wing_model
from scipy.sparse import issparse
from sliding_cases import wing_and_body_grid
from test_suite import kinds

from bspline_mdao import (
    ControlMeshMove,
    DesignSurface,
    EulerFlow,
    Fit,
    GridEvaluate,
    GridMovement,
    LatticeFlow,
    PointSet,
    Quality,
    SurfaceEvaluate,
    fit_grid,
)
from bspline_mdao.core.design.interior_points import InteriorPoints
from bspline_mdao.core.design.user_defined import UserVariable
from bspline_mdao.core.fit.surface_fit import SurfaceFollower
from bspline_mdao.core.mesh.surface import SurfaceGrid
from bspline_mdao.design import (
    Hinge,
    HingePoints,
    Junction,
    OfPart,
    OnPatch,
    Parametrization,
    Rotation,
    Translation,
)
from bspline_mdao.flow.euler.flow_grid import FlowGrid
from bspline_mdao.flow.euler.forces import FlowForces
from bspline_mdao.flow.euler.gas import free_stream
from bspline_mdao.movers import ComovingFrame, Cylinder, LinearElasticity, Rotations, moving_mesh


@cache
def mesh():
    return moving_mesh(wing_model())


@cache
def flow():
    return FlowGrid.of(wing_model().topology, nodes())


@cache
def nodes():
    return wing_model().regenerate().to_vector().reshape(-1, 3)


def grow(points, values):
    """A user's function, which can be pickled where it is one of a module."""
    return points * values


def growth(points, values):
    return np.tile(values * np.eye(3), (len(points), 1, 1)), points[:, :, None]


def noise(shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


def states():
    uniform = flow().discretization.uniform(free_stream(0.3, 0.1, flow().axes))
    return uniform * (1.0 + 0.1 * np.tanh(noise(uniform.shape)))


def regenerated(model):
    evaluator = model.evaluator()
    moved = model.control_points + 1e-3 * noise(model.control_points.shape)
    return [model.regenerate(moved).to_vector(), evaluator.adjoint(noise((model.n_nodes, 3)))]


def moved(mover):
    surface = surface_of(mover.mesh) * [1.0, 1.02, 1.01]
    movement = mover.move(mover.mesh.points, surface)
    return [movement.points, movement.jvp(*noise_of(mover.mesh)), *movement.vjp(noise(movement.points.shape))]


def noise_of(mesh):
    return noise(mesh.points.shape, 1), noise(surface_of(mesh).shape, 2)


def designed(parametrization):
    surface = surface_of(parametrization.mesh)
    values = {name: v + 0.1 * noise(v.shape) for name, v in parametrization.initial.items()}
    found = parametrization.partials(surface, values)
    return [parametrization.apply(surface, values), found.initial, *found.values.values()]


def measured(measure):
    points = measure.surface.points * [1.0, 1.02, 1.01]
    return [measure.evaluate(points), measure.partials(points)]


def flown(flow):
    areas, stream = flow.areas(nodes()), free_stream(0.3, 0.1, flow.axes)
    linearization = flow.discretization.linearize(states(), areas, stream)
    return [flow.discretization.residual(states(), areas, stream), linearization.state_vjp(noise(states().shape))]


def forced(forces):
    at = states(), nodes(), 0.1, 0.3
    bars = {"CL": np.ones(1), "CD_entropy": np.ones(1), "CD_induced": np.ones(1)}
    return [*forces.evaluate(*at).values(), *forces.vjp(*at, bars)[:2]]


def followed(follower):
    found = follower.at(follower.baseline + noise(follower.baseline.shape))
    return [found.control_points, found.vjp(noise(found.control_points.shape))]


def shifted(shift):
    return [
        shift.displacement(noise(shift.n_values)),
        shift.vjp(noise((shift.n_points, 3))),
        shift.apply(wing_model().control_points, noise(shift.n_values)),
    ]


def follower_of_half_a_surface():
    surface = SurfaceGrid.of(wing_model())
    return SurfaceFollower.of(wing_model(), mesh(), surface, np.arange(0, surface.n_points, 2))


def parametrized(variables, constraints=()):
    return lambda: Parametrization(mesh(), [make(mesh()) for make in variables], [make() for make in constraints])


def of_section(make):
    section = moving_mesh(section_model())
    return Parametrization(section, [make(section)])


USERS = {UserVariable: lambda mesh: UserVariable("growth", [1.0], grow, growth)}
TAPER = (VARIABLES[next(kind for kind in VARIABLES if kind.__name__ == "Taper")],)


def hinged():
    hinge = Hinge((0.6, 0.0, 0.2), (0.9, 0.1, 1.1))
    return Parametrization(mesh(), [HingePoints("line", hinge, "xy"), Rotation("flap", hinge)])


def joined():
    model = fit_grid(wing_and_body_grid(), n_control=(6, 6, 6))
    both, tube = DesignSurface.of_nodes(model), Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0)
    slide = OfPart(Translation("position", "x"), both.part("wing*").mesh)
    return Parametrization(both.mesh, [slide], junction=Junction(OnPatch(model, "body"), 0.9, tube))


THINGS = {
    "FittedModel": (wing_model, regenerated),
    **{kind.__name__: (lambda kind=kind: kind(mesh()), moved) for kind in MOVERS},
    "ComovingFrame": (lambda: ComovingFrame(LinearElasticity(mesh())), moved),
    **{
        f"Parametrization, {kind.__name__}": (parametrized([make]), designed)
        for kind, make in {**VARIABLES, **USERS}.items()
    },
    **{
        f"Parametrization, {kind.__name__}": (lambda make=make: of_section(make), designed)
        for kind, make in OF_SECTIONS.items()
    },
    "Parametrization, Junction": (joined, designed),
    "Parametrization, HingePoints": (hinged, designed),
    **{
        f"Parametrization, {kind.__name__}": (parametrized(TAPER, [make]), designed)
        for kind, make in CONSTRAINTS.items()
    },
    **{
        kind.__name__: (lambda make=make: make(geometry_cases.rectangular_wing()), measured)
        for kind, make in geometry_cases.MEASURES.items()
    },
    **{
        kind.__name__: (lambda make=make: make(geometry_cases.section_between_planes()), measured)
        for kind, make in geometry_cases.OF_SECTIONS.items()
    },
    "InteriorPoints": (lambda: InteriorPoints("inner").bind(wing_model()), shifted),
    "SurfaceGrid": (lambda: SurfaceGrid.of(wing_model()), lambda surface: [surface.points, surface.quads]),
    "SurfaceFollower": (follower_of_half_a_surface, followed),
    "FlowGrid": (flow, flown),
    "FlowForces": (lambda: FlowForces.of(flow(), nodes(), 1.16), forced),
}
"""What makes each thing, and what uses it and gives arrays or sparse matrices."""


def bits(found):
    """Bytes of arrays and of the parts of sparse matrices."""
    parts = [p for one in found for p in ((one.data, one.indices, one.indptr) if issparse(one) else (one,))]
    return [np.asarray(part).tobytes() for part in parts]


def pickled(thing):
    return pickle.loads(pickle.dumps(thing))


def test_every_mover_variable_constraint_and_measure_is_in_the_table():
    assert {kind.__name__ for kind in kinds("core.movement", "mesh", "move")} <= set(THINGS)
    assert set(THINGS) >= {"InteriorPoints"}  # binds to a model, others to a surface
    variables = {f"Parametrization, {kind.__name__}" for kind in kinds("core.design", "bind") - {InteriorPoints}}
    constraints = {f"Parametrization, {kind.__name__}" for kind in kinds("core.design", "equations")}
    measures = {kind.__name__ for kind in kinds("core.measures", "surface", "evaluate", "partials")}
    assert variables | constraints | measures <= set(THINGS)


@pytest.mark.slow
@pytest.mark.parametrize("name", THINGS)
def test_copies_give_equal_bits_before_and_after_the_original_was_used(name):
    make, use = THINGS[name]
    thing = make()
    early = [pickled(thing), copy.deepcopy(thing)]
    expected = bits(use(thing))
    assert sum(map(len, expected)) > 0
    for one in (*early, pickled(thing), copy.deepcopy(thing), thing):
        assert bits(use(one)) == expected


COMPONENTS = {
    "Fit": lambda: Fit(model=wing_model()),
    "ControlMeshMove": lambda: ControlMeshMove(mover=Rotations(mesh())),
    "GridEvaluate": lambda: GridEvaluate(model=wing_model()),
    "Quality": lambda: Quality(model=wing_model(), aggregates=("corner_ks",)),
    "GridMovement": lambda: GridMovement(model=wing_model()),
    "SurfaceEvaluate": lambda: SurfaceEvaluate(model=wing_model(), mesh=mesh(), surface=SurfaceGrid.of(wing_model())),
    "PointSet": lambda: PointSet(model=wing_model(), points=np.array([[4.0, 3.0, 0.2]])),
    "EulerFlow": lambda: EulerFlow(model=wing_model(), reference_area=1.2),
    "LatticeFlow": lambda: LatticeFlow(model=wing_model(), reference_area=1.2),
}
"""Components with options that OpenMDAO keeps out of records, and out of its own copies."""


def declared(component):
    """Options and variables of a component that was set up."""
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("copied", component, promotes=["*"])
    problem.setup()
    problem.final_setup()
    found = problem.model.list_vars(out_stream=None, prom_name=True, return_format="dict")
    values = {meta["prom_name"]: problem.get_val(meta["prom_name"]) for meta in found.values()}
    return {name for name, _ in component.options.items()}, values


@pytest.mark.parametrize("copied", [copy.deepcopy, pickled])
@pytest.mark.parametrize("name", COMPONENTS)
def test_copies_of_components_have_all_options_and_can_be_set_up(name, copied):
    component = COMPONENTS[name]()
    options, values = declared(COMPONENTS[name]())
    other = copied(component)
    found_options, found = declared(other)
    assert found_options == options
    assert found.keys() == values.keys()
    assert len(values) > 1
    for key in values:
        np.testing.assert_array_equal(found[key], values[key])
    if "model" in options:
        assert str(other.options["model_in_records"]).startswith(wing_model().checksum)
