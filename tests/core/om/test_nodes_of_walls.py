"""Variables that move nodes of the walls of a fitted grid: a wing slides on a body of the same grid."""

import numpy as np
import openmdao.api as om
import pytest
from sliding_cases import rows_of, wing_and_body_grid

from bspline_mdao import DesignSurface, GridMovement, InputError, fit_grid
from bspline_mdao.design import (
    Dihedral,
    Junction,
    Local,
    OfPart,
    OnPatch,
    Parametrization,
    RadiusFactor,
    Translation,
    Twist,
)
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.measures import ProjectedArea
from bspline_mdao.movers import Cylinder, PatchedSurface, moving_mesh
from bspline_mdao.testing import check_totals

SHAPE = (11, 13, 11)
TUBE = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0)
MOVES = {
    "slide": {"position": 0.3},
    "twist": {"twist": [10.0, 10.0]},
    "rise": {"dihedral": 10.0},
    "all": {"position": 0.3, "twist": [10.0, 10.0], "dihedral": 10.0},
    "all back": {"position": -0.3, "twist": [-10.0, -5.0], "dihedral": -10.0},
}
"""A wing that moves by a tenth of the body's length (m), and angles (deg)."""


@pytest.fixture(scope="module")
def model():
    return fit_grid(wing_and_body_grid(SHAPE, off_wall=2e-4), n_control=(7, 7, 7))


@pytest.fixture(scope="module")
def problem(model):
    return posed(model, Junction(OnPatch(model, "body"), 0.9, TUBE))


def posed(model, junction, more=(), **options):
    """The movement of a wing's nodes, set up."""
    both = DesignSurface.of_nodes(model)
    wing = both.part("wing*")
    of_wing = Twist("twist", wing.axis, 2), Dihedral("dihedral", wing.axis), Translation("position", "x")
    variables = [*(OfPart(each, wing.mesh) for each in of_wing), *more]
    problem = om.Problem(reports=None)
    options = {"quality": ("volume_ks",), **options}
    movement = both.grid_movement(variables, junction=junction, **options)
    problem.model.add_subsystem("movement", movement, promotes=["*"])
    problem.setup(mode="rev")
    return problem


def moved(problem, values):
    """Nodes of the grid after some of the variables have changed, and the others have not."""
    for name in ("position", "twist", "dihedral"):
        problem.set_val(name, values.get(name, 0.0))
    problem.run_model()
    return problem.get_val("grid").reshape(-1, 3).copy()


def heights(nodes):
    """Distances of the first nodes from the body, but in the rows of cells along the wing's own layers."""
    return np.hypot(*np.moveaxis(nodes.reshape(6, *SHAPE, 3)[:, :, 4:, 1, 1:], -1, 0)) - 1.0


@pytest.mark.parametrize("name", MOVES)
def test_a_wing_slides_turns_and_rises_on_a_body_and_no_cell_folds(model, problem, name):
    nodes, before = moved(problem, MOVES[name]), model.local_nodes()
    off = np.hypot(*nodes[rows_of(model, "body"), 1:].T) - 1.0
    assert np.abs(off).max() < 1e-14
    assert np.linalg.norm(nodes - before, axis=1)[rows_of(model, "wing upper")].max() > 0.1
    cells = GridQuality.of_baseline(model.regenerate()).cells(nodes)
    assert all(of_block.is_valid.all() for of_block in cells)
    assert np.abs(heights(nodes) / heights(before) - 1.0).max() < 0.01


def test_at_rest_nothing_moves(model, problem):
    np.testing.assert_allclose(moved(problem, {}), model.local_nodes(), rtol=0.0, atol=1e-14)


def test_totals_are_those_of_differences(problem):
    moved(problem, {"position": 0.1, "twist": [3.0, -4.0], "dihedral": 2.0})
    check = check_totals(problem, ["volume_ks"], ["position", "twist", "dihedral"])
    assert check.transposed < 1e-12
    assert check.differences < 1e-8


def test_the_wing_goes_along_with_a_body_that_changes_its_shape(model):
    both = DesignSurface.of_nodes(model)
    axis = (0.0, 0.0, 0.0), (3.0, 0.0, 0.0)
    radius = OfPart(RadiusFactor("radius", axis, (0.0, 1.0)), both.part("body").mesh)
    junction = Junction(OnPatch(model, "body"), 0.9, TUBE, shape=["radius"])
    problem = posed(model, junction, [radius], quality=False)
    problem.set_val("radius", [1.1, 1.1])
    nodes = moved(problem, {"position": 0.1})
    np.testing.assert_allclose(np.hypot(*nodes[rows_of(model, "body"), 1:].T), 1.1, rtol=0.0, atol=1e-13)


def test_nodes_keep_their_heights_over_a_body_of_two_patches_whose_seam_is_below_the_wing(model):
    x, turn = np.meshgrid(np.linspace(-0.2, 3.2, 18), np.linspace(0.0, 1.2, 13), indexing="ij")
    side = np.stack([x, np.sin(turn), np.cos(turn)], axis=-1)
    surface = PatchedSurface([side, side * [1.0, -1.0, 1.0]])
    nodes = moved(posed(model, Junction(OnPatch(model, "body"), 0.9, surface), quality=False), {"twist": 10.0})
    rows, before = rows_of(model, "body"), model.local_nodes()
    assert np.linalg.norm(nodes - before, axis=1)[rows].max() > 0.02
    values = [surface.levels(each[rows]).values for each in (before, nodes)]
    assert np.abs(values[1] - values[0]).max() < 1e-13
    assert np.abs(np.hypot(*nodes[rows, 1:].T) - 1.0).max() < 1e-5


def test_measures_see_the_nodes_that_are_moved(model):
    both = DesignSurface.of_nodes(model, released="far")
    lift = Translation("rise", "z")
    group = both.grid_movement([lift], measures=[ProjectedArea.of(both.surface)], quality=False)
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("movement", group, promotes=["*"])
    problem.setup()
    problem.set_val("rise", 0.01)
    problem.run_model()
    nodes = problem.get_val("grid").reshape(-1, 3)[both.surface.rows]
    area = ProjectedArea.of(both.surface).evaluate(nodes)[0]
    assert problem.get_val("projected_area")[0] == pytest.approx(area, rel=1e-14)
    np.testing.assert_allclose(nodes, both.surface.points + [0.0, 0.0, 0.01], rtol=0.0, atol=1e-14)


def test_control_points_make_no_junction_and_say_what_does(model):
    both, junction = DesignSurface.of(model), Junction(OnPatch(model, "body"), 0.9, TUBE)
    with pytest.raises(InputError, match=r"control points of blocks are off .* DesignSurface.of_nodes\(model\)"):
        both.grid_movement([Translation("position", "x")], junction=junction)


def set_up(group):
    problem = om.Problem(reports=None)
    problem.model.add_subsystem("movement", group)
    problem.setup()


def test_what_does_not_go_with_variables_of_nodes_is_refused(model):
    both, bump, mesh = DesignSurface.of_nodes(model), Translation("position", "x"), moving_mesh(model)
    given = Parametrization(mesh, [Local("bumps", OnPatch(model, "wing upper"), "z")])
    refused = {
        "leave out 'fit'": both.grid_movement([bump], fit=True),
        "leave out 'numbers'": both.grid_movement([bump], numbers=[0]),
        "live=True does not follow nodes": both.grid_movement([bump], live=True),
        "both a parametrization and the nodes": both.grid_movement([bump], surface=both.part("wing*").surface),
        "would move the surface; give one": GridMovement(model=model, parametrization=given, surface=both.surface),
    }
    for said, group in refused.items():
        with pytest.raises(InputError, match=said):
            set_up(group)


def test_parts_that_are_not_designed_are_named(model):
    with pytest.raises(InputError, match="no patch is called 'tail'"):
        DesignSurface.of_nodes(model).part("tail")
