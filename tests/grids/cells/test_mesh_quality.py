"""Faces of meshes without structure, as OpenFOAM's checkMesh judges them."""

import numpy as np
import pytest
from riding_cases import corners_of

from bspline_mdao.files import read_mesh, write_polymesh
from bspline_mdao.generators import brick_grid
from bspline_mdao.grids.cells.mesh_quality import mesh_quality
from bspline_mdao.meshes import MixedMesh

AXES = (np.linspace(0.0, 2.0, 4), np.linspace(0.0, 3.0, 5), np.linspace(0.0, 1.0, 3))


def bricks(change=lambda points: points):
    """Bricks of equal size, with other nodes."""
    points = np.stack(np.meshgrid(*AXES, indexing="ij"), axis=-1).reshape(-1, 3)
    return MixedMesh(change(points), {"hexahedron": corners_of(np.arange(60).reshape(4, 5, 3))})


def as_polyhedra(mesh):
    """The mesh by its faces, quads cut into two triangles that are one polygon: as readers cut polygons into fans."""
    faces, cells = mesh.cell_faces
    first = np.sort(faces, axis=1)
    keys, polygons = np.unique(first, axis=0, return_inverse=True)
    seen = np.zeros(len(keys), dtype=bool)
    parts = []
    for face, cell, polygon in zip(faces.tolist(), cells.tolist(), polygons.ravel().tolist()):
        a = face.index(min(face))  # both cells cut it from one corner
        loop = face[a:] + face[:a]
        if not seen[polygon]:
            pieces = [[loop[0], loop[1], loop[2], loop[2]], [loop[0], loop[2], loop[3], loop[3]]]
        else:
            other = [loop[0], *loop[:0:-1]]
            pieces = [[other[0], other[1], other[2], other[2]], [other[0], other[2], other[3], other[3]]]
            pieces = [piece[::-1] for piece in pieces]
        seen[polygon] = True
        parts += [(piece, cell, polygon) for piece in pieces]
    quads, of_cells, of_polygons = (np.array(part) for part in zip(*parts))
    return MixedMesh(mesh.points, {}, None, (quads, of_cells), polygons=of_polygons)


def test_bricks_are_orthogonal_without_skewness():
    found = mesh_quality(bricks())
    assert found.angles.max() < 1e-5  # the cosine is 1 but for rounding
    assert found.mean_angle < 1e-5
    assert found.skewness.max() < 1e-14
    assert len(found.angles) == 2 * 4 * 2 + 3 * 3 * 2 + 3 * 4 * 1
    assert len(found.skewness) == 24 * 6 - len(found.angles)
    np.testing.assert_allclose(found.volumes, 2.0 * 3.0 / 24.0, rtol=1e-13)


def test_bricks_that_are_sheared_have_the_angle_of_the_shear():
    angle = np.radians(25.0)
    found = mesh_quality(bricks(lambda x: x + np.outer(x[:, 1], [np.tan(angle), 0.0, 0.0])))
    n_along = 2 * 4 * 2  # faces across x lean: their normals leave the lines between cells by the shear
    assert (np.abs(np.sort(found.angles)[-n_along - 18 :] - 25.0) < 1e-9).sum() == n_along + 18
    assert found.skewness.max() < 1.0


def test_a_step_between_two_cells_is_skewness_and_angle_by_hand():
    low = np.array(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float
    )
    top = low[4:] + [1.0, 0.0, 1.0]  # the upper cell leans along x
    two = MixedMesh(
        np.concatenate([low, top]), {"hexahedron": np.array([[0, 1, 2, 3, 4, 5, 6, 7], [4, 5, 6, 7, 8, 9, 10, 11]])}
    )
    found = mesh_quality(two)
    np.testing.assert_allclose(found.middles, [[0.5, 0.5, 0.5], [1.0, 0.5, 1.5]], atol=1e-14)
    assert found.angles == pytest.approx([np.degrees(np.arctan(0.5))])
    # the line between the middles meets the face in x = 0.75, 0.25 off its middle, from which the face reaches 0.5; the
    # normals from the upper middle meet the two leaning sides at half of their reach, and the top at its edge
    assert np.isclose(found.skewness, 0.5).sum() == 3
    assert (np.isclose(found.skewness, 1.0).sum(), np.isclose(found.skewness, 0.0).sum()) == (1, 7)


def test_pieces_of_polygons_are_judged_as_the_faces_that_they_make():
    rng = np.random.default_rng(8)
    shaken = bricks(lambda points: points + 0.05 * rng.standard_normal(points.shape))
    whole, pieces = mesh_quality(shaken), mesh_quality(as_polyhedra(shaken))
    np.testing.assert_allclose(np.sort(pieces.angles), np.sort(whole.angles), rtol=1e-9)
    np.testing.assert_allclose(np.sort(pieces.skewness), np.sort(whole.skewness), rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(pieces.middles, whole.middles, rtol=1e-12)
    assert pieces.mean_angle == pytest.approx(whole.mean_angle, rel=1e-9)


def test_it_does_not_depend_on_unit_position_or_axes_nor_on_the_order_of_cells():
    rng = np.random.default_rng(9)
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    shaken = bricks(lambda points: points + 0.05 * rng.standard_normal(points.shape))
    found = mesh_quality(shaken)
    cells = {"hexahedron": rng.permutation(shaken.cells["hexahedron"])}
    other = mesh_quality(MixedMesh(1e3 * shaken.points @ turn + 7.0, cells))
    np.testing.assert_allclose(np.sort(other.angles), np.sort(found.angles), rtol=1e-9)
    np.testing.assert_allclose(np.sort(other.skewness), np.sort(found.skewness), rtol=1e-9, atol=1e-12)


def test_a_polymesh_has_the_figures_of_its_hexahedra(tmp_path):
    write_polymesh(tmp_path / "polyMesh", brick_grid((5, 4, 6, 5)))
    read = read_mesh(tmp_path / "polyMesh").mesh
    found = mesh_quality(read)
    assert len(found.skewness) == len(np.unique(read.polygons))
    assert not found.is_inverted.any()
