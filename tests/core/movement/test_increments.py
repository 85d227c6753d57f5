"""The number of increments: a setting, chosen for the most extreme designs before anything runs."""

from dataclasses import dataclass, replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import DesignSurface, fit_grid
from bspline_mdao.core.design.named_deformations import parse_deformation
from bspline_mdao.core.movement.equilibrium import Equilibrium
from bspline_mdao.core.movement.fixed_interior import FixedInterior
from bspline_mdao.core.movement.increments import GOOD_RATIO, IncrementalMover
from bspline_mdao.core.movement.mover import IncrementReport, MovementReport
from bspline_mdao.core.om.control_mesh_move import ControlMeshMove
from bspline_mdao.design import Span, Twist
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.generators import fit_shape, flat_plate_grid, onera_m6_grid, rectangular_wing
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality
from bspline_mdao.movers import LinearElasticity, TorsionalSprings, increments_for, moving_mesh
from bspline_mdao.names import CONTROL_POINTS, SURFACE_CONTROL_POINTS

NEEDED = {30: 1, 60: 1, 90: 2, 120: 5}
"""Increments that a twist of the plate by so many degrees needs."""


@cache
def plate():
    """Model of a flat plate."""
    return fit_grid(flat_plate_grid((7, 6, 8)), n_control=(5, 4, 6), method="quasi_interpolant")


@cache
def plate_mesh():
    return moving_mesh(plate())


def twisted(mesh, degrees):
    """Surface points turned about the middle of the chord, the more the farther out."""
    x, y, z = mesh.points[mesh.surface_ids].T
    middle, angle = x.mean(), degrees * np.pi / 180.0 * z / z.max()
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.column_stack([middle + cosine * (x - middle) + sine * y, cosine * y - sine * (x - middle), z])


def ratio_with(mesh, surface, n_increments):
    mover = LinearElasticity(mesh, n_increments=n_increments)
    return mover.move(mesh.points, surface).report.increments[-1].corner_ratio


def chosen(mesh, *degrees):
    return increments_for(LinearElasticity(mesh), [twisted(mesh, each) for each in degrees])


# the choice


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "needed"), NEEDED.items())
def test_the_first_number_that_keeps_the_mesh_good_is_chosen(degrees, needed):
    mesh = plate_mesh()
    assert chosen(mesh, degrees) == needed
    for number in (1, 2, 5):
        assert (ratio_with(mesh, twisted(mesh, degrees), number) >= GOOD_RATIO) == (number >= needed)


@pytest.mark.slow
def test_the_worst_of_all_designs_counts_in_any_order_and_whatever_number_the_mover_has():
    mesh = plate_mesh()
    assert chosen(mesh, 30, 120, 90) == chosen(mesh, 120, 90, 30) == NEEDED[120]
    designs = [twisted(mesh, degrees) for degrees in (30, -90)]
    assert {increments_for(LinearElasticity(mesh, n_increments=m), designs) for m in (1, 3, 10)} == {NEEDED[90]}


def test_no_design_needs_more_than_one_increment():
    assert chosen(plate_mesh()) == 1


@pytest.mark.slow
def test_where_no_number_keeps_the_mesh_good_the_best_is_taken():
    mesh = plate_mesh()
    surface = twisted(mesh, 170)
    ratios = {m: ratio_with(mesh, surface, m) for m in (1, 2, 5, 10)}
    assert max(ratios.values()) < GOOD_RATIO
    assert ratios[chosen(mesh, 170)] == max(ratios.values())


def test_elements_that_were_folded_before_the_move_are_counted_and_no_cure_is_guessed():
    tangled = IncrementReport(None, 3, "element (1, 2, 3) of block 4", -0.1, -2.0, 5)
    told = MovementReport((tangled,), 0.1, n_invalid=7).tangling
    assert told.endswith("3 elements newly invalid at the end; 7 others are invalid before the move")
    assert MovementReport((tangled,), 0.1).tangling.endswith("3 elements newly invalid at the end")


@dataclass(frozen=True)
class Keeping:
    """Keeps a part of the smallest corner triple product with few increments, and all of it with more."""

    part: float
    mesh: object
    n_increments: int = 1

    def move(self, initial, surface):
        kept = 1.0 if self.n_increments > 2 else self.part
        return SimpleNamespace(report=SimpleNamespace(increments=[SimpleNamespace(corner_ratio=kept)]))


@pytest.mark.parametrize(("part", "needed"), [(0.032, 1), (0.028, 5), (-0.1, 5)])
def test_a_mesh_is_good_while_it_keeps_three_per_cent_of_its_smallest_corner_triple_product(part, needed):
    mesh = plate_mesh()
    assert increments_for(Keeping(part, mesh), [mesh.points[mesh.surface_ids]]) == needed


@dataclass(frozen=True)
class Listed:
    """Keeps the part of a list by its number of increments, and notes what was tried; gives up where there is none."""

    parts: dict
    tried: list
    mesh: object
    n_increments: int = 1

    def move(self, initial, surface):
        self.tried.append(self.n_increments)
        if self.parts[self.n_increments] is None:
            raise MovementError("listed: no")
        part = self.parts[self.n_increments]
        return SimpleNamespace(report=SimpleNamespace(increments=[SimpleNamespace(corner_ratio=part)]))


@pytest.mark.parametrize(
    ("parts", "needed", "n_tried"),
    [
        ((-2.3, -1.8, -2.0, 1.0), 2, 3),  # five keep less than two: ten are not tried
        ((-0.1, -0.3, -0.3, 1.0), 1, 3),
        ((-0.5, -0.8, -0.1, 0.2), 10, 4),  # two keep less than one, which says nothing of five
        ((-0.5, -0.8, 0.1, None), 5, 3),
        ((-2.3, None, None, 0.1), 10, 4),  # to give up is no comparison
        ((-2.3, -1.8, -1.7, -1.9), 5, 4),
    ],
)
def test_ten_increments_are_tried_unless_five_keep_no_more_than_two(parts, needed, n_tried):
    mesh, tried = plate_mesh(), []
    mover = Listed(dict(zip((1, 2, 5, 10), parts)), tried, mesh)
    assert increments_for(mover, [mesh.points[mesh.surface_ids]]) == needed
    assert tried == [1, 2, 5, 10][:n_tried]


@dataclass(frozen=True)
class Fragile(IncrementalMover):
    """Gives up when the surface goes too far at once."""

    mesh: object
    n_increments: int = 1
    farthest: float = 0.02

    def _step(self, initial, before, surface):
        if np.abs(surface - before[self.mesh.surface_ids]).max() > self.farthest:
            raise MovementError("fragile: too far")
        return FixedInterior(self.mesh)._step(initial, before, surface)


def test_more_increments_are_chosen_where_a_mover_gives_up_and_the_most_where_it_does_with_all():
    mesh = plate_mesh()
    surface = mesh.points[mesh.surface_ids] + [0.0, 0.03, 0.0]
    assert increments_for(Fragile(mesh), [surface]) == 2
    assert increments_for(Fragile(mesh, farthest=1e-4), [surface]) == 10
    with pytest.raises(MovementError, match="increment 1 of 10: fragile: too far"):
        Fragile(mesh, n_increments=10, farthest=1e-4).move(mesh.points, surface)


def test_what_has_no_number_of_increments_is_refused():
    @dataclass(frozen=True)
    class Other:
        mesh: object

    with pytest.raises(InputError, match="Other has no number of increments to choose"):
        increments_for(Other(plate_mesh()), [])


@pytest.mark.slow
def test_the_baseline_is_factorised_once_for_all_designs(monkeypatch):
    mesh, made, factorized = plate_mesh(), [], Equilibrium.factorized
    monkeypatch.setattr(Equilibrium, "factorized", lambda *arguments: made.append(1) or factorized(*arguments))
    assert chosen(mesh, 30, -30, 60) == 1
    assert len(made) == 1


# extremes


def shape_of_plate():
    wing = DesignSurface.of(plate())
    variables = [Twist("twist", wing.axis, stations=3), Span("span", wing.axis)]
    return wing.parametrization(variables), wing.mesh.points[wing.mesh.surface_ids]


def test_extremes_are_each_variable_at_its_bounds_and_then_all_of_them():
    shape, surface = shape_of_plate()
    found = list(shape.extremes({"twist": ([0.0, -3.0, -9.0], 5.0), "span": (0.8, [1.5])}))
    twists, spans = ([0.0, -3.0, -9.0], [5.0, 5.0, 5.0]), ([0.8], [1.5])
    still = {"twist": np.zeros(3), "span": np.ones(1)}
    expected = []
    for twist, span in zip(map(np.array, twists), map(np.array, spans)):
        expected += [{**still, "twist": twist}, {**still, "span": span}, {"twist": twist, "span": span}]
    assert len(found) == len(expected)
    for points, values in zip(found, expected):
        np.testing.assert_array_equal(points, shape.apply(surface, values))
    assert len(list(shape.extremes({"span": (0.8, 1.5)}))) == 2


@pytest.mark.parametrize(
    ("bounds", "message"),
    [
        ({"sweep": (0.0, 1.0)}, "no variable is called 'sweep'; there are twist, span"),
        ({"twist": ([0.0, 1.0], 1.0)}, r"bounds of 'twist' are of shape \(2,\); give a number, or shape \(3,\)"),
    ],
)
def test_bounds_that_fit_no_variable_are_refused(bounds, message):
    with pytest.raises(InputError, match=message):
        list(shape_of_plate()[0].extremes(bounds))


# the three morphs


@pytest.mark.slow
@pytest.mark.parametrize(("request_", "most"), [("shape", 1), ("bend=60deg@0.7", 2), ("twist=30deg+stretch=1.5", 1)])
def test_a_wing_changes_shape_in_one_increment_or_two_and_no_cell_inverts(request_, most):
    model = fit_grid(onera_m6_grid((13, 15, 11)), n_control=(7, 8, 6), keep_residual=False, method="quasi_interpolant")
    mesh = moving_mesh(model)
    if request_ == "shape":
        surface = fit_shape(model, mesh.surface_ids, rectangular_wing())
    else:
        surface = parse_deformation(request_, model, mesh).apply(mesh.points[mesh.surface_ids])
    mover = LinearElasticity(mesh)
    mover = replace(mover, n_increments=increments_for(mover, [surface]))
    movement = mover.move(mesh.points, surface)
    assert movement.report.n_increments <= most
    quality = GridQuality.of_baseline(model.regenerate())
    nodes = model.regenerate(movement.points).to_vector().reshape(-1, 3)
    assert report_quality(quality, nodes).n_inverted == 0


# the component


def problem_of(mover):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("move", ControlMeshMove(mover=mover), promotes=["*"])
    problem.setup()
    return problem


def run_at(problem, degrees):
    problem.set_val(SURFACE_CONTROL_POINTS, twisted(plate_mesh(), degrees).ravel())
    problem.run_model()
    bar = np.random.default_rng(3).normal(size=plate_mesh().points.size)
    product = problem.compute_jacvec_product([CONTROL_POINTS], [SURFACE_CONTROL_POINTS], "rev", {CONTROL_POINTS: bar})
    return problem.get_val(CONTROL_POINTS).copy(), product[SURFACE_CONTROL_POINTS]


@pytest.mark.slow
@pytest.mark.parametrize("kind", [LinearElasticity, TorsionalSprings])
def test_the_control_mesh_and_its_derivative_are_functions_of_the_design_alone(kind):
    """Whatever was evaluated before, and whatever the mesh is like: no number jumps."""
    problem = problem_of(kind(plate_mesh()))
    fresh = {degrees: run_at(problem_of(kind(plate_mesh())), degrees) for degrees in (0, 30, 120)}
    for degrees in (30, 120, 0, 30, 120):
        for found, expected in zip(run_at(problem, degrees), fresh[degrees]):
            np.testing.assert_array_equal(found, expected)
        assert problem.model.move.report.n_increments == 5


def largest_good_angle(mesh):
    """Angle, within 1e-7 degrees, up to which one increment keeps the plate good."""
    low, high = 60.0, 90.0
    while high - low > 1e-7:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if ratio_with(mesh, twisted(mesh, middle), 1) >= GOOD_RATIO else (low, middle)
    return low


@pytest.mark.slow
def test_the_control_mesh_does_not_jump_where_one_increment_begins_to_be_too_few():
    mesh, mover = plate_mesh(), LinearElasticity(plate_mesh())
    angle, step = largest_good_angle(mesh), 1e-5
    assert [chosen(mesh, angle + side * step) for side in (-1, 1)] == [1, 2]
    low, middle, high = (mover.move(mesh.points, twisted(mesh, angle + side * step)).points for side in (-1, 0, 1))
    assert 1e-8 < np.abs(high - low).max() < 1e-5
    assert np.abs(high - 2.0 * middle + low).max() < 1e-10
