"""Interior control points as variables: which move, where to, and what stays."""

import numpy as np
import pytest
from adaptation_cases import skewed_grid, skewed_model

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.design.interior_points import InteriorPoints, control_lines
from bspline_mdao.core.mesh.boundary import boundary_points
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.testing import complex_step, dot_test


@pytest.fixture(scope="module")
def model():
    return skewed_model()


def random_nodes(model, shift, seed=3):
    values = np.random.default_rng(seed).uniform(shift.lower, shift.upper)
    return model.evaluator().forward(shift.displacement(values)), values


def test_displacements_are_linear_with_an_exact_transpose(model):
    shift, random = InteriorPoints("inner").bind(model), np.random.default_rng(5)
    assert dot_test(shift.displacement, shift.vjp, shift.n_values, (shift.n_points, 3)) < 1e-14
    x, v = random.normal(size=(2, shift.n_values))
    exact = complex_step(lambda some: shift.apply(model.control_points, some), x, v)
    np.testing.assert_allclose(exact, shift.displacement(v), rtol=1e-13, atol=1e-15)


def test_nodes_of_walls_and_of_undeclared_faces_stay_to_the_last_bit_and_those_of_planes_slide(model):
    shift = InteriorPoints("inner").bind(model)
    change, _ = random_nodes(model, shift)
    for face, _ in boundary_points(model.topology, model.topology.node_ids()):
        window = face.window
        start = sum(np.prod(shape) for shape in model.topology.shapes[: window.block])
        rows = start + np.arange(np.prod(model.topology.shapes[window.block])).reshape(
            model.topology.shapes[window.block]
        )
        own = change[rows[window.slices].ravel()]
        if face.kind == "symmetry":
            assert np.abs(own[:, 1]).max() == 0.0
            assert np.abs(own[:, [0, 2]]).max() > 0.01
        else:
            assert np.abs(own).max() == 0.0, face


def test_points_of_interfaces_move_with_both_blocks(model):
    change, _ = random_nodes(model, InteriorPoints("inner").bind(model))
    left, right = np.split(change, [9 * 8 * 10])
    left, right = left.reshape(9, 8, 10, 3)[-1], right.reshape(7, 8, 10, 3)[0]
    assert np.abs(left).max() > 0.01
    np.testing.assert_array_equal(left, right)


def test_a_value_of_one_goes_as_far_as_the_nearest_neighbour_on_the_line(model):
    shift = InteriorPoints("inner", reach=0.25).bind(model)
    net, ids = model.control_points[model.mesh.control_ids[0]], model.mesh.control_ids[0]
    step = net[3, 2, 2] - net[2, 2, 2], net[2, 2, 2] - net[1, 2, 2]
    own = shift.directions[shift.point_ids == ids[2, 2, 2]]
    assert len(own) == 3
    assert np.linalg.norm(own[0]) == pytest.approx(min(map(np.linalg.norm, step)), rel=1e-12)
    assert np.linalg.norm(np.cross(own[0], step[0] + step[1])) < 0.2 * np.linalg.norm(own[0])
    np.testing.assert_array_equal(shift.upper, 0.25)
    np.testing.assert_array_equal(shift.lower, -0.25)
    assert control_lines(model).shape == (shift.n_points, 3, 3)


def test_points_in_a_plane_have_two_values_and_inner_ones_three(model):
    shift = InteriorPoints("inner").bind(model)
    n0, n1 = (ids.shape for ids in model.mesh.control_ids)
    in_plane, inside = (n0[0] + n1[0] - 3) * (n0[2] - 2), (n0[0] + n1[0] - 3) * (n0[1] - 2) * (n0[2] - 2)
    counts = np.bincount(np.bincount(shift.point_ids))
    assert (counts[2], counts[3]) == (in_plane, inside)


def test_where_chooses_points_by_mask_or_by_number(model):
    whole = InteriorPoints("inner").bind(model)
    ids = np.unique(whole.point_ids)[::3]
    some = InteriorPoints("inner", where=ids).bind(model)
    assert set(some.point_ids) == set(ids)
    is_asked = np.zeros(whole.n_points, dtype=bool)
    is_asked[ids] = True
    masked = InteriorPoints("inner", where=is_asked).bind(model)
    np.testing.assert_array_equal(masked.point_ids, some.point_ids)


def test_a_planar_patch_slides_where_it_is_asked_to_and_a_curved_one_is_refused(model):
    with pytest.raises(InputError, match=r"floor.*is to slide, but leaves its plane"):
        InteriorPoints("inner", sliding="floor").bind(model)
    with pytest.raises(InputError, match="no patch is called 'lid'"):
        InteriorPoints("inner", sliding="lid").bind(model)


def test_what_cannot_be_used_is_refused_in_one_line(model):
    with pytest.raises(InputError, match=r"reach is 0\.5; give a number between 0 and 0.5"):
        InteriorPoints("inner", reach=0.5)
    with pytest.raises(InputError, match=f"the model has {len(model.control_points)} control points"):
        InteriorPoints("inner", where=[10**6]).bind(model)
    held = model.mesh.control_ids[0][:, :, 0].ravel()
    with pytest.raises(InputError, match=r"none of the .* that may move is asked for"):
        InteriorPoints("inner", where=held).bind(model)
    with pytest.raises(InputError, match="make it with fit_grid"):
        InteriorPoints("inner").bind(skewed_grid())
    flat = fit_grid(skewed_grid(planes=False), n_control=[(4, 2, 4), (4, 2, 4)], order=2)
    with pytest.raises(InputError, match="no control point to move: all of them are fixed"):
        InteriorPoints("inner").bind(flat)


def wedge(patches=()):
    """A block one cell deep between two planes through the axis, which a rotation by 4 degrees lays onto each other."""
    x, r, turn = np.meshgrid(np.linspace(0.0, 3.0, 7), np.linspace(1.0, 2.0, 6), np.radians([0.0, 4.0]), indexing="ij")
    r = r + 0.1 * np.sin(2.0 * x) * (2.0 - r)
    return Grid((Block(np.stack([x, r * np.cos(turn), r * np.sin(turn)], axis=-1), "block 1"),), patches)


def test_where_all_is_held_periodic_planes_are_named_with_what_lets_them_slide():
    whole = Window.whole(0, (7, 6, 2))
    declared = tuple(Patch(name, "other", (whole.face(side),)) for name, side in (("back", 5), ("front", 4)))
    undeclared = (
        r"all of them are fixed; .*; block 1 kmin and block 1 kmax are periodic planes, by a rotation about x by "
    )
    cases = {
        (): undeclared + r"4 deg: make patches of them \('bspline-mdao inspect GRID --draft FILE' .* \(--slide PATCH; ",
        declared: r"the patches back and front are periodic planes, .*: let them slide \(--slide back --slide front; ",
        declared[:1]: "back and block 1 kmin are periodic planes, .*: make patches of them",
    }
    for patches, expected in cases.items():
        held = fit_grid(wedge(patches), n_control=(5, 4, 2), order=3)
        with pytest.raises(InputError, match=expected) as refused:
            InteriorPoints("inner").bind(held)
        assert "\n" not in str(refused.value)
        assert str(refused.value).count("periodic") == 1
    slides = fit_grid(wedge(declared), n_control=(5, 4, 2), order=3)
    assert InteriorPoints("inner", sliding=("back", "front")).bind(slides).n_values == 2 * 2 * 3 * 2
