"""Meshes without structure for ParaView: cells of all kinds, in the order of the mesh, with their fields."""

import re

import numpy as np
import pytest
from mesh_cases import combs, mesh_around_a_body, mesh_around_a_section

from bspline_mdao.errors import InputError
from bspline_mdao.files import read_mesh
from bspline_mdao.generators import brick_grid
from bspline_mdao.grids.cells.grid_mesh import grid_mesh
from bspline_mdao.grids.cells.mixed_cells import MixedMesh
from bspline_mdao.grids.io.meshes.vtu_output import write_vtu, write_vtu_faces
from bspline_mdao.grids.topology.detection import find_topology

SIDES = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]


@pytest.fixture
def pyvista():
    return pytest.importorskip("pyvista", reason="PyVista is not installed")


def mixed():
    """Pyramids in a cube, a wedge and a tetrahedron on it, and combs of polyhedra beside them."""
    corners = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.3) for z in (0.0, 0.7)])
    own = np.concatenate([corners, corners.mean(axis=0)[None], [[2.0, 0.0, 0.3], [2.0, 1.3, 0.4], [2.5, 0.2, 2.0]]])
    comb = combs()
    faces, cells = comb.polyhedra
    points = np.concatenate([own, comb.points + [10.0, 0.0, 0.0]])
    of_kind = {
        "tetra": np.array([[4, 9, 10, 11]]),
        "pyramid": np.array([[*side, 8] for side in SIDES]),
        "wedge": np.array([[4, 5, 9, 6, 7, 10]]),
    }
    return MixedMesh(points, of_kind, None, (faces + len(own), cells), polygons=comb.polygons)


@pytest.mark.parametrize("make", [mixed, combs, lambda: mesh_around_a_body()[0]], ids=["mixed", "combs", "body"])
def test_cells_come_in_the_order_of_the_mesh_with_their_volumes_and_fields(tmp_path, pyvista, make):
    mesh, random = make(), np.random.default_rng(1)
    fields = {"a b": random.normal(size=(mesh.n_points, 3))}, {"number": np.arange(mesh.n_cells)}
    write_vtu(tmp_path / "mesh.vtu", mesh, *fields)
    found = pyvista.read(tmp_path / "mesh.vtu")
    np.testing.assert_array_equal(found.points, mesh.points)
    np.testing.assert_array_equal(found.point_data["a b"], fields[0]["a b"])
    np.testing.assert_array_equal(found.cell_data["number"], np.arange(mesh.n_cells))
    volumes = found.compute_cell_sizes(length=False, area=False).cell_data["Volume"]
    np.testing.assert_allclose(np.abs(volumes), mesh.quality().volumes, rtol=1e-9)


def test_a_mesh_of_two_dimensions_is_its_plane(tmp_path, pyvista):
    mesh, _ = mesh_around_a_section()
    heights = np.arange(float(mesh.n_points))
    write_vtu(tmp_path / "plane.vtu", mesh, {"height": heights}, {"volume": mesh.quality().volumes})
    found = pyvista.read(tmp_path / "plane.vtu")
    np.testing.assert_array_equal(found.points, mesh.points[: mesh.n_stored])
    np.testing.assert_array_equal(found.point_data["height"], heights[: mesh.n_stored])
    areas = found.compute_cell_sizes(length=False, volume=False).cell_data["Area"]
    ratios = areas / found.cell_data["volume"]
    np.testing.assert_allclose(ratios, ratios[0], rtol=1e-12)


def test_what_is_written_is_read_as_a_mesh(tmp_path):
    grid = brick_grid((4, 5, 3, 4))
    mesh = grid_mesh(grid, find_topology(grid), {})
    write_vtu(tmp_path / "mesh.vtu", mesh)
    again = read_mesh(tmp_path / "mesh.vtu").mesh
    np.testing.assert_array_equal(again.points, mesh.points)
    np.testing.assert_array_equal(again.cells["hexahedron"], mesh.cells["hexahedron"])


def test_faces_bring_their_nodes_alone(tmp_path, pyvista):
    mesh, _ = mesh_around_a_body()
    faces = mesh.markers["body"]
    write_vtu_faces(
        tmp_path / "walls.vtu", mesh.points, faces, {"x": mesh.points[:, 0]}, {"face": np.arange(len(faces))}
    )
    found = pyvista.read(tmp_path / "walls.vtu")
    assert (found.n_points, found.n_cells) == (len(np.unique(faces)), len(faces))
    np.testing.assert_array_equal(found.point_data["x"], found.points[:, 0])
    np.testing.assert_allclose(found.cell_centers().points[3], mesh.points[faces[3, :3]].mean(axis=0), atol=1e-12)


def test_fields_that_do_not_fit_are_refused(tmp_path):
    mesh, _ = mesh_around_a_body()
    with pytest.raises(InputError, match=re.escape("field 'x' has (3,) values of type float64; give")):
        write_vtu(tmp_path / "mesh.vtu", mesh, {"x": np.zeros(3)})
    assert not (tmp_path / "mesh.vtu").exists()
