"""Faces of meshes without structure, as OpenFOAM's checkMesh judges them."""

import numpy as np
import pytest
from mesh_cases import combs
from riding_cases import corners_of

from bspline_mdao.files import read_mesh, write_polymesh
from bspline_mdao.generators import brick_grid
from bspline_mdao.grids.cells.mesh_quality import mesh_quality
from bspline_mdao.grids.cells.mixed_cells import FACES
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
    assert found.cell_angles == pytest.approx(2 * [np.degrees(np.arctan(0.5))])
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


def cut(kind):
    """The bricks, cut into cells of a kind; pyramids are around their middles."""
    whole = bricks()
    corners = whole.cells["hexahedron"]
    if kind == "pyramid":
        tops = whole.n_points + np.arange(len(corners))
        cells = [np.column_stack([corners[:, face[::-1]], tops]) for face in FACES["hexahedron"]]
        return MixedMesh(
            np.concatenate([whole.points, whole.points[corners].mean(axis=1)]), {kind: np.concatenate(cells)}
        )
    parts = np.array(
        {
            "hexahedron": [range(8)],
            "wedge": [[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]],
            "tetra": [[0, 1, 2, 6], [0, 2, 3, 6], [0, 3, 7, 6], [0, 7, 4, 6], [0, 4, 5, 6], [0, 5, 1, 6]],
        }[kind]
    )
    return MixedMesh(whole.points, {kind: corners[:, parts].reshape(-1, parts.shape[1])})


MESHES = {kind: lambda kind=kind: cut(kind) for kind in FACES} | {"combs": combs}
SHIFTS = np.array([[3.1, 1.7, 2.3], [2.9, -2.1, 1.3], [-1.9, 3.7, 2.7]])


def shaken(kind, size):
    """A mesh, and its nodes shifted by waves of some size: short ones, so that faces are warped."""
    mesh = MESHES[kind]()
    return mesh, mesh.points + size * np.sin(mesh.points @ (1.9 * SHIFTS) + [0.3, 1.1, 2.0])


@pytest.mark.parametrize(
    ("kind", "size", "measures", "counts"),  # as checkMesh of OpenFOAM 1912 prints them
    [
        ("tetra", 0.4, (161.716, 62.5125, 119.706, -0.130063), (32, 41, 8, 147, 164)),
        ("pyramid", 0.15, (70.8535, 28.4798, 1.62833, 0.00823252), (1, 0, 0, 0, 0)),
        ("pyramid", 0.4, (175.613, 72.2092, 246.224, -0.0886844), (51, 98, 20, 192, 250)),
        ("wedge", 0.4, (160.861, 44.8648, 2.21177, 0.0181548), (2, 4, 0, 13, 17)),
        ("hexahedron", 0.9, (168.803, 74.4727, 1.68922, 0.0202126), (4, 16, 0, 34, 46)),
        ("combs", 0.4, (76.107, 28.981, 3.10797, 0.497762), (3, 0, 0, 0, 0)),
        ("combs", 0.9, (156.019, 65.2674, 6.03679, -0.22032), (11, 20, 5, 43, 54)),
    ],
)
def test_angles_skewness_volumes_and_pyramids_are_those_that_checkmesh_prints(kind, size, measures, counts):
    mesh, points = shaken(kind, size)
    found = mesh_quality(mesh, points)
    printed = found.angles.max(), found.mean_angle, found.skewness.max(), found.volumes.min()
    assert tuple(float(f"{number:.6g}") for number in printed) == measures
    n_faces = found.n_severe, found.n_beyond, found.n_skewed, found.n_wrong_faces
    assert (*n_faces, found.n_wrong_pyramids) == counts
