"""Points of the lattice around a mesh are design variables of its walls."""

import numpy as np
import pytest
from mesh_cases import mesh_around_a_body, mesh_around_a_section, sector_model
from parametrization_cases import assert_exact

from bspline_mdao.core.design.variable import Layout
from bspline_mdao.design import FreeForm, Parametrization
from bspline_mdao.errors import InputError
from bspline_mdao.meshes import LatticeSettings, MeshModel, free_lattice
from bspline_mdao.movers import moving_mesh


@pytest.fixture(scope="module")
def model() -> MeshModel:
    return MeshModel.of(*mesh_around_a_body(), LatticeSettings(spacing=0.4))


def test_walls_move_as_the_mesh_does_by_the_points_of_its_lattice(model):
    lattice, mesh = free_lattice(model), moving_mesh(model)
    variable = FreeForm("shape", lattice, where=lattice.within(low=(-1.0, None, None), high=(1.0, None, None)))
    layout = Layout(mesh, variable.auxiliary)
    ids, directions = variable.places(layout)
    values = 0.1 * np.random.default_rng(1).normal(size=ids.shape)
    change = np.zeros_like(lattice.points)
    np.add.at(change, ids, values[:, None] * directions)
    moved = variable.bind(layout).apply(layout.points, values)[layout.rows()]
    net = model.lattice.evaluator(model.mesh.points[model.wall_rows])
    np.testing.assert_allclose(moved - layout.points[layout.rows()], net.forward(change), atol=1e-13)
    assert_exact(layout, variable)


def test_points_in_the_plane_stay_in_it_and_have_no_values_across(model):
    lattice = free_lattice(model)
    variable = FreeForm("shape", lattice, direction="xy")
    layout = Layout(moving_mesh(model), variable.auxiliary)
    ids, directions = variable.places(layout)
    is_on = np.abs(lattice.points[ids, 1]) < 1e-12
    assert 0 < is_on.sum() < len(ids)
    assert not directions[is_on, 1].any()
    assert directions[~is_on, 1].sum() == len(np.unique(ids[~is_on]))
    shape = Parametrization(layout.mesh, [variable])
    values = {"shape": 0.1 * np.random.default_rng(2).normal(size=len(ids))}
    by_itself = variable.bind(shape.layout).apply(shape.layout.points, values["shape"])[layout.rows()]
    surface = layout.points[layout.rows()]
    np.testing.assert_allclose(shape.apply(surface, values), by_itself, atol=1e-14)  # nothing is left to take off
    plane = lattice.within(high=(None, 1e-9, None))
    with pytest.raises(InputError, match="all of its lattice points lie in a plane of symmetry"):
        FreeForm("shape", lattice, where=plane, direction="y").places(layout)


def test_a_section_has_values_in_one_plane():
    model = MeshModel.of(*mesh_around_a_section())
    lattice = free_lattice(model)
    variable = FreeForm("shape", lattice, direction="xz")
    shape = Parametrization(moving_mesh(model), [variable])
    ids, _ = variable.places(shape.layout)
    heights = lattice.points[ids, 1]
    assert np.ptp(heights) == 0.0
    values = {"shape": 0.05 * np.random.default_rng(3).normal(size=len(ids))}
    surface = shape.layout.points[shape.layout.rows()]
    moved = shape.apply(surface, values) - surface
    first, second = shape.mesh.copies.T
    np.testing.assert_allclose(moved[first], moved[second], atol=1e-14)
    assert np.abs(moved).max() > 0.01


def test_a_lattice_around_an_axis_is_refused():
    with pytest.raises(InputError, match="goes around the axis of periodic sides, and is no box"):
        free_lattice(sector_model())
