"""Meshes of cells as OpenFOAM's polyMesh: closed cells, in its order, with the markers as patches."""

import numpy as np
import pytest

from bspline_mdao.generators import brick_grid
from bspline_mdao.grids.cells.grid_mesh import grid_mesh
from bspline_mdao.grids.cells.mixed_cells import MixedMesh
from bspline_mdao.grids.cells.quads import area_vectors
from bspline_mdao.grids.io.mesh_polymesh import polymesh_of
from bspline_mdao.grids.topology.detection import find_topology


def mixed():
    """A wedge beside a hexahedron, and a tetrahedron and a pyramid on them, with nodes that are moved a little."""
    points = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1], [2, 0, 0], [2, 0, 1]]
        + [[0.5, 0.5, 2]],
        dtype=float,
    )
    points += np.random.default_rng(3).uniform(-0.05, 0.05, points.shape)
    cells = {
        "hexahedron": np.array([[0, 1, 2, 3, 4, 5, 6, 7]]),
        "wedge": np.array([[1, 8, 2, 5, 9, 6]]),
        "pyramid": np.array([[4, 5, 6, 7, 10]]),
        "tetra": np.array([[5, 9, 6, 10]]),
    }
    return MixedMesh(points, cells, {"floor": np.array([[0, 1, 2, 3], [1, 8, 2, 2]]), "side": np.array([[0, 1, 5, 4]])})


def polyhedra():
    """The same by the faces of its cells, which come in any order."""
    mesh = mixed()
    faces, cells = mesh.cell_faces
    order = np.random.default_rng(4).permutation(len(cells))
    return MixedMesh(mesh.points, {}, mesh.markers, (faces[order], cells[order]))


def blocks():
    """Cells of blocks."""
    grid = brick_grid((3, 5, 4, 3))
    return grid_mesh(grid, find_topology(grid), {})


@pytest.mark.parametrize("make", [mixed, polyhedra, blocks])
def test_faces_close_every_cell_and_give_its_volume_in_openfoams_order(make):
    mesh = make()
    found = polymesh_of(mesh, {"floor": "wall"})
    corners = found.points[found.corners]
    areas = area_vectors(corners)
    n_inner, n_cells = len(found.neighbour), mesh.n_cells
    sums, volumes = np.zeros((n_cells, 3)), np.zeros(n_cells)
    flux = np.array([pyramid(quad) for quad in corners])
    for cells, sign, rows in ((found.owner, 1.0, slice(None)), (found.neighbour, -1.0, slice(n_inner))):
        np.add.at(sums, cells, sign * areas[rows])
        np.add.at(volumes, cells, sign * flux[rows])
    np.testing.assert_allclose(sums, 0.0, atol=1e-14)
    np.testing.assert_allclose(volumes, mesh.quality().volumes, rtol=1e-12)
    assert (found.owner[:n_inner] < found.neighbour).all()
    order = np.lexsort((found.neighbour, found.owner[:n_inner]))
    np.testing.assert_array_equal(order, np.arange(n_inner))
    np.testing.assert_array_equal(found.points, mesh.points[found.rows])


def pyramid(quad):
    """Volume between a face and the origin; a face is cut into triangles around the mean of its corners."""
    distinct = quad[:3] if np.array_equal(quad[2], quad[3]) else quad
    middle = distinct.mean(axis=0)
    return sum(np.dot(middle, np.cross(a, b)) / 6.0 for a, b in zip(distinct, np.roll(distinct, -1, axis=0)))


def test_markers_become_patches_with_their_kinds_and_what_has_none_is_unassigned():
    found = polymesh_of(mixed(), {"floor": "wall"})
    assert [(patch.name, patch.kind, patch.stop - patch.start) for patch in found.boundary] == [
        ("floor", "wall", 2),
        ("side", None, 1),
        ("unassigned", None, 9),
    ]
    assert found.boundary[-1].stop == len(found.owner)
