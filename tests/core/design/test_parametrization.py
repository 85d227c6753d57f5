"""Design variables of several kinds, one after the other, with linear constraints: values, derivatives, refusals."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest
from mover_cases import rotation
from parametrization_cases import surface_of
from scipy.sparse import vstack

from bspline_mdao import fit_grid
from bspline_mdao.core.design.displacement import Local
from bspline_mdao.core.design.free_form import FreeForm
from bspline_mdao.core.design.lattice import Lattice
from bspline_mdao.core.design.linear_constraints import EqualDisplacement, InPlane, Linked, Opposite, Pinned
from bspline_mdao.core.design.parametrization import Parametrization
from bspline_mdao.core.design.planform import Chord, Dihedral, Span, Sweep, Taper, ThicknessFactor, Twist
from bspline_mdao.core.design.reference_axis import ReferenceAxis
from bspline_mdao.core.design.selection import InBlock, InBox, SurfaceRows
from bspline_mdao.core.design.user_defined import UserVariable
from bspline_mdao.core.om.surface_control import SurfaceControl
from bspline_mdao.errors import InputError
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.topology.grid import Block, Grid
from bspline_mdao.movers import moving_mesh
from bspline_mdao.names import CONTROL_POINTS_INITIAL, SURFACE_CONTROL_POINTS

OBLIQUE = np.array([0.6, -0.3, 0.74])
STEP = 1e-40


@cache
def wing(is_oblique=False):
    """Control mesh about the M6 wing, its symmetry plane in or out of the coordinate planes."""
    grid = onera_m6_grid((11, 9, 11))
    turn = rotation() if is_oblique else np.eye(3)
    blocks = tuple(Block(block.nodes @ turn.T, block.name) for block in grid.blocks)
    return moving_mesh(fit_grid(Grid(blocks, grid.patches), n_control=(7, 5, 6)))


def beside_leading_edge(mesh, block, row):
    """Surface points one row behind the leading edge, on one side of the wing."""
    return InBlock(block, np.s_[row, :, 1:]) & SurfaceRows(np.arange(len(mesh.surface_ids)))


def with_planform():
    """Local, lattice and planform variables on a wing with a pinned root and twist pins."""
    mesh = wing()
    axis = ReferenceAxis.of(mesh, at=0.3, n=5)
    root = SurfaceRows(mesh.in_plane_rows)
    lower, upper = beside_leading_edge(mesh, 1, 1), beside_leading_edge(mesh, 4, 1)
    variables = [
        Local("bumps", InBox(low=(None, None, 0.5)) & ~upper & ~lower, "xz"),
        FreeForm("shape", Lattice.box(mesh, n=(4, 2, 3)), direction="y"),
        ThicknessFactor("thickness", axis, 3),
        Chord("chord", axis, [0.2, 1.0], order=2),
        Twist("twist", axis, 4),
        Sweep("sweep", axis, 3),
        Dihedral("dihedral", axis, 2),
    ]
    return Parametrization(mesh, variables, [Pinned(root), Opposite(upper, lower, "y")])


def with_lattice():
    """Planform variables of a lattice, its child, and the user's own, on an oblique wing with a stiff oblique tip."""
    mesh = wing(True)
    n = len(mesh.surface_ids)
    axis = ReferenceAxis.of(mesh, at=0.5, n=3)
    lattice = Lattice.box(mesh, n=(3, 2, 4), axes=rotation().T, margin=0.1)
    outer = (surface_of(mesh) @ rotation())[:, 2] > 0.7
    child = Lattice.box(surface_of(mesh)[outer], n=(3, 2, 4), axes=rotation().T, parent=lattice, continuity=0)
    swell = UserVariable(
        "swell",
        [0.0, 0.0],
        lambda x, v: x * (1.0 + v[0] * v[1] + v[0]) + v[1],
        lambda x, v: (
            (1.0 + v[0] * v[1] + v[0]) * np.tile(np.eye(3), (len(x), 1, 1)),
            np.stack([x * (1.0 + v[1]), x * v[0] + 1.0], axis=-1),
        ),
    )
    variables = [
        Span("span", axis, on=lattice),
        FreeForm("tip", child, direction="xyz"),
        swell,
        Sweep("sweep", axis, 2),
        Taper("taper", axis),
        Local("local", SurfaceRows([20, 24, 31]), OBLIQUE),
    ]
    constraints = [
        EqualDisplacement(np.arange(n - 5, n), OBLIQUE),
        InPlane([12, 18], [1.0, 2.0, 0.5]),
        Linked([24], [28], "x"),
    ]
    return Parametrization(mesh, variables, constraints)


every_composition = pytest.mark.parametrize("compose", [with_planform, with_lattice])


def away(parametrization, seed=0, size=0.05):
    """Initial points off the baseline and values off the initial ones."""
    random = np.random.default_rng(seed)
    surface = surface_of(parametrization.mesh)
    initial = surface + 0.2 * size * random.normal(size=surface.shape)
    return initial, {name: v + size * random.normal(size=v.shape) for name, v in parametrization.initial.items()}


def equations(parametrization):
    return vstack([part.matrix for _, part in parametrization.elimination.constraints])


@pytest.mark.slow
@every_composition
def test_derivatives_in_every_variable_and_in_the_baseline_are_exact(compose):
    parametrization, random = compose(), np.random.default_rng(1)
    initial, values = away(parametrization)
    partials = parametrization.partials(initial, values)
    d_initial = random.normal(size=initial.shape)
    exact = parametrization.apply(initial + 1j * STEP * d_initial, values).imag.ravel() / STEP
    np.testing.assert_allclose(partials.initial @ d_initial.ravel(), exact, rtol=0, atol=1e-10 * np.abs(exact).max())
    for name, value in values.items():
        step = random.normal(size=value.shape)
        exact = parametrization.apply(initial, values | {name: value + 1j * STEP * step}).imag.ravel() / STEP
        assert np.abs(exact).max() > 1e-4  # in metres per degree, factor or metre
        np.testing.assert_allclose(
            partials.values[name] @ step, exact, rtol=0, atol=1e-10 * np.abs(exact).max(), err_msg=name
        )


@pytest.mark.slow
@every_composition
def test_component_products_are_transposed_and_exact(compose):
    parametrization, random = compose(), np.random.default_rng(2)
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("control", SurfaceControl(parametrization=parametrization), promotes=["*"])
    problem.setup()
    initial, values = away(parametrization, seed=3)
    points = parametrization.mesh.points.copy()
    points[parametrization.mesh.surface_ids] = initial
    for name, value in (values | {CONTROL_POINTS_INITIAL: points.ravel()}).items():
        problem.set_val(name, value)
    problem.run_model()
    problem.model.run_linearize()
    names = [CONTROL_POINTS_INITIAL, *values]
    seeds = {name: random.normal(size=problem.get_val(name).size) for name in names}
    bar = random.normal(size=initial.size)
    of, wrt = [SURFACE_CONTROL_POINTS], names
    forward = problem.compute_jacvec_product(of, wrt, "fwd", seeds)[SURFACE_CONTROL_POINTS]
    reverse = problem.compute_jacvec_product(of, wrt, "rev", {SURFACE_CONTROL_POINTS: bar})
    products = [reverse[name] @ seeds[name] for name in names]
    assert abs(bar @ forward - sum(products)) <= 1e-12 * np.linalg.norm(bar) * np.linalg.norm(forward)
    stepped = {name: value + 1j * STEP * seeds[name] for name, value in values.items()}
    d_initial = seeds[CONTROL_POINTS_INITIAL].reshape(-1, 3)[parametrization.mesh.surface_ids]
    exact = parametrization.apply(initial + 1j * STEP * d_initial, stepped).imag.ravel() / STEP
    np.testing.assert_allclose(forward, exact, rtol=0, atol=1e-10 * np.abs(exact).max())


@pytest.mark.slow
@every_composition
def test_maps_act_in_the_declared_order_on_what_those_before_have_moved(compose):
    parametrization = compose()
    initial, values = away(parametrization, seed=4)
    n = len(initial)
    rows = np.concatenate([initial, parametrization.layout.points[n:]])
    for variable in parametrization.variables:
        rows = variable.bind(parametrization.layout).apply(rows, values[variable.name])
    expected = initial.ravel() + parametrization.elimination.matrix @ (rows[:n] - initial).ravel()
    moved = parametrization.apply(initial, values)
    np.testing.assert_array_equal(moved.ravel(), expected)
    backwards = Parametrization(parametrization.mesh, parametrization.variables[::-1], parametrization.constraints)
    assert np.abs(backwards.apply(initial, values) - moved).max() > 1e-4


@pytest.mark.slow
@every_composition
def test_constraints_hold_however_far_everything_moves(compose):
    parametrization = compose()
    initial, values = away(parametrization, seed=5, size=0.3)
    moved = parametrization.apply(initial, values) - initial
    assert np.abs(moved).max() > 0.3
    np.testing.assert_allclose(equations(parametrization) @ moved.ravel(), 0.0, atol=1e-14 * np.abs(moved).max())
    kept = parametrization.elimination.fixed.reshape(-1, 3)
    np.testing.assert_array_equal((parametrization.apply(initial, values))[kept], initial[kept])


@pytest.mark.slow
@every_composition
def test_nothing_moves_at_the_initial_values(compose):
    parametrization = compose()
    initial, _ = away(parametrization, seed=6)
    for points in (initial, surface_of(parametrization.mesh)):
        np.testing.assert_allclose(parametrization.apply(points, parametrization.initial), points, atol=1e-14)


@pytest.mark.slow
@every_composition
def test_derivatives_stay_within_the_declared_pattern_and_need_all_of_it(compose):
    parametrization = compose()
    declared = parametrization.pattern
    partials = [parametrization.partials(*away(parametrization, seed)) for seed in (7, 8, 9)]
    for name in ["initial", *parametrization.initial]:
        pattern = declared.initial if name == "initial" else declared.values[name]
        found = [part.initial if name == "initial" else part.values[name] for part in partials]
        found = sum(abs(matrix) for matrix in found).toarray() != 0.0
        assert not (found & (pattern.toarray() == 0.0)).any(), name
        assert found.sum() >= 0.5 * pattern.nnz, name  # what is left out is zero by geometry


def test_variables_of_sections_and_of_the_planform_commute_because_the_axis_is_carried():
    mesh, random = wing(), np.random.default_rng(10)
    axis = ReferenceAxis.of(mesh, at=0.25, n=6)
    kinds = [Twist("twist", axis, 3), Sweep("sweep", axis), Dihedral("dihedral", axis), Chord("chord", axis, 2)]
    orders = [Parametrization(mesh, [kinds[n] for n in random.permutation(4)]) for _ in range(4)]
    assert len({tuple(variable.name for variable in order.variables) for order in orders}) > 2
    initial, values = away(orders[0], seed=11)
    values["twist"] *= 100.0
    moved = [order.apply(initial, values) for order in orders]
    np.testing.assert_allclose(moved[1], moved[0], atol=1e-14)
    np.testing.assert_allclose(moved[2], moved[0], atol=1e-14)
    np.testing.assert_allclose(moved[3], moved[0], atol=1e-14)


def test_one_carried_object_has_one_set_of_rows():
    mesh = wing()
    axis, other = ReferenceAxis.of(mesh, n=4), ReferenceAxis.of(mesh, n=4)
    parametrization = Parametrization(mesh, [Twist("a", axis), Twist("b", axis), Twist("c", other)])
    assert len(parametrization.layout.points) == len(mesh.surface_ids) + 4 + 4


@pytest.mark.parametrize(
    ("variables", "constraints", "message"),
    [
        (
            [Local("a", SurfaceRows([9, 12]), "y")],
            [Pinned([12], name="root")],
            r"a\[1\] moves nothing.*\(root: point \(.*\) of",
        ),
        (
            [Local("a", SurfaceRows([12]))],
            [Linked([9], [12], name="edge")],
            r"a\[0\] moves nothing.*\(edge: .* nor do 2 more",
        ),
        ([Local("a", SurfaceRows([0]))], [], r"a\[2\] moves nothing.*\(symmetry plane: point "),
        ([Local("a", SurfaceRows([9])), Local("a", SurfaceRows([7]))], [], "two variables are called 'a'"),
    ],
)
def test_what_can_have_no_effect_is_named_with_its_reason(variables, constraints, message):
    with pytest.raises(InputError, match=message):
        Parametrization(wing(), variables, constraints)
