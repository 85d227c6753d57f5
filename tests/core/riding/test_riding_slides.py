"""Meshes that ride on grids of which patches slide on surfaces that are not planes."""

from functools import cache

import numpy as np
import openmdao.api as om
import pytest
from riding_cases import joined
from sliding_cases import SIDES, lean, passage, passage_grid, surface_of

from bspline_mdao import Ride
from bspline_mdao.meshes import EmbeddedMesh, MixedMesh
from bspline_mdao.movers import Cylinder, Rotations, moving_mesh
from bspline_mdao.testing import central_difference, dot_test

SLIDING = ["hub", "casing"]


@cache
def passage_mesh(has_markers=True):
    """Hexahedra in the same passage with other nodes, and, if asked for, markers by their sides."""
    grid = passage_grid((10, 8, 9))
    points, cells = joined(grid)
    if not has_markers:
        return MixedMesh(points, {"hexahedron": cells})
    bare, markers = MixedMesh(points, {"hexahedron": cells}), {}
    for name, side in SIDES.items():
        end = [slice(None)] * 3
        end[side // 2] = -(side % 2)
        on_side = (points[bare.skin][:, :, None] == grid.blocks[0].nodes[tuple(end)].reshape(-1, 3)).all(axis=3)
        markers[name] = bare.skin[on_side.any(axis=2).all(axis=1)]
    return MixedMesh(points, {"hexahedron": cells}, markers)


@pytest.fixture(scope="module", params=["other", "wall", "no markers"])
def case(request):
    """A mesh that rides, the control mesh, and control points behind a blade that leans."""
    kind = "other" if request.param == "no markers" else request.param
    model = passage(hub=kind, casing=kind)
    mesh = moving_mesh(model, "blade", sliding=SLIDING)
    riding = EmbeddedMesh.of(model, passage_mesh(request.param != "no markers"), slides=mesh.slides)
    return model, riding, mesh, Rotations(mesh).move(model.control_points, lean(mesh, 0.1)).points


def on(points, radius):
    return np.abs(np.linalg.norm(points[:, 1:], axis=1) - radius) < 1e-12


def test_nodes_stay_on_the_surfaces_and_no_cell_folds(case):
    model, riding, mesh, points = case
    before, nodes = riding.mesh.points, riding.at(points).nodes
    plain = EmbeddedMesh.of(model, riding.mesh).at(points).nodes
    for name, radius in zip(SLIDING, (1.0, 2.0)):
        rows = on(before, radius)
        assert surface_of(mesh, name).distances(nodes[rows]).max() < 1e-14
        assert np.linalg.norm(nodes - before, axis=1)[rows].max() > 0.03
    assert surface_of(mesh, "casing").distances(plain[rows]).max() > 1e-3
    assert not riding.mesh.quality(nodes).is_inverted.any()
    np.testing.assert_array_equal(riding.at(model.control_points).nodes, before)


def test_slides_that_come_later_are_the_same(case):
    model, riding, mesh, points = case
    later = EmbeddedMesh.of(model, riding.mesh).with_slides(model, mesh.slides)
    np.testing.assert_array_equal(later.at(points).nodes, riding.at(points).nodes)


@pytest.mark.parametrize("is_asked", [False, True])
def test_derivatives_are_exact_and_transposed(case, is_asked):
    _, riding, mesh, points = case
    inputs, rng = {"control_points": points}, np.random.default_rng(2)
    if is_asked:
        wall = riding.mesh.points[riding.asked_rows]
        inputs["wall"] = wall + 0.01 * np.sin(3.0 * wall[:, ::-1])
        rows = riding.sliding.nodes.rows
        given, alone = np.intersect1d(rows, riding.asked_rows), np.setdiff1d(rows, riding.asked_rows)
        assert len(given) > 0
        assert (len(alone) == 0) == (len(given) == len(rows))
    state, surface = riding.at(*inputs.values()), surface_of(mesh, "casing")
    assert surface.distances(state.nodes[on(riding.mesh.points, 2.0)]).max() < 1e-14
    directions = {name: rng.normal(size=each.shape) for name, each in inputs.items()}
    exact = state.jvp(**directions)
    differences = central_difference(
        lambda h: riding.at(*(inputs[name] + h * directions[name] for name in inputs)).nodes, 1e-4, levels=3
    )
    np.testing.assert_allclose(exact, differences, atol=1e-8 * np.abs(exact).max())
    for name, each in inputs.items():
        pair = (lambda d, name=name: state.jvp(**{name: d})), (lambda bar, name=name: state.vjp(bar)[name])
        assert dot_test(*pair, each.shape, state.nodes.shape) < 1e-14


def test_nodes_keep_their_heights_over_a_surface_that_is_given():
    model = passage()
    tunnel = Cylinder((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 2.001)
    mesh = moving_mesh(model, "blade", sliding={"casing": tunnel})
    problem = om.Problem(reports=None)
    ride = Ride(model=model, mesh=passage_mesh(), slides=mesh.slides)
    problem.model.add_subsystem("ride", ride, promotes=["*"])
    problem.setup()
    problem.set_val("control_points", Rotations(mesh).move(model.control_points, lean(mesh, 0.1)).points.ravel())
    problem.run_model()
    nodes = problem.get_val("mesh").reshape(-1, 3)[on(passage_mesh().points, 2.0)]
    np.testing.assert_allclose(tunnel.levels(nodes).values, -1e-3, atol=1e-14)


def test_planes_alone_and_patches_that_no_node_is_on_change_nothing():
    model = passage()
    riding = EmbeddedMesh.of(model, passage_mesh())
    assert riding.with_slides(model, moving_mesh(model, "blade").slides) is riding
    corner = MixedMesh(passage_mesh().points[[0, 1, 9, 80]] + [0.05, 0.1, 0.2], {"tetra": np.array([[0, 1, 2, 3]])})
    assert EmbeddedMesh.of(model, corner, slides=moving_mesh(model, "blade", sliding=SLIDING).slides).sliding is None
