"""Mixed cells: volumes, folds, skins, and nodes next to walls."""

import numpy as np
import pytest
from riding_cases import HALVES, mesh

from bspline_mdao import InputError
from bspline_mdao.grids.cells.mixed_cells import first_heights
from bspline_mdao.meshes import MixedMesh

BOX = np.array([[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0], [0, 0, 5], [2, 0, 5], [2, 3, 5], [0, 3, 5]], dtype=float)

CELLS = {
    "tetra": (np.array([[0, 1, 2, 6]]), [5.0]),
    "pyramid": (np.array([[0, 1, 2, 3, 6]]), [10.0]),
    "wedge": (HALVES, [15.0, 15.0]),
    "hexahedron": (np.arange(8)[None], [30.0]),
}


@pytest.mark.parametrize("kind", CELLS)
def test_volumes_are_those_of_the_cells_whichever_way_they_go_round(kind):
    cells, volumes = CELLS[kind]
    for points in (BOX, BOX * [-1.0, 1.0, 1.0]):
        quality = MixedMesh(points, {kind: cells}).quality()
        np.testing.assert_allclose(quality.volumes, volumes, rtol=1e-14)
        assert not quality.is_inverted.any()


def test_a_cell_whose_face_is_pushed_through_is_inverted():
    box = MixedMesh(BOX, {"hexahedron": np.arange(8)[None]})
    pushed = BOX.copy()
    pushed[6] = [0.3, 0.3, 0.2]
    assert box.quality(pushed).volumes[0] > 0.0
    assert box.quality(pushed).is_inverted.all()


def test_volumes_are_those_of_vtk():
    pyvista = pytest.importorskip("pyvista", reason="the extra 'pictures' is not installed")
    cells = mesh().cells
    kinds = {pyvista.CellType.HEXAHEDRON: cells["hexahedron"], pyvista.CellType.PYRAMID: cells["pyramid"]}
    sizes = pyvista.UnstructuredGrid(kinds, mesh().points).compute_cell_sizes()["Volume"]
    quality = mesh().quality()
    assert not quality.is_inverted.any()
    np.testing.assert_allclose(quality.volumes, np.abs(sizes), rtol=0.1, atol=1e-3 * sizes.max())
    of_pyramids = slice(len(cells["hexahedron"]), None)
    assert quality.volumes[of_pyramids].sum() == pytest.approx(np.abs(sizes[of_pyramids]).sum(), rel=1e-2)


def test_the_skin_and_faces_in_any_direction_look_into_the_mesh():
    wedges = MixedMesh(BOX, {"wedge": HALVES})
    assert len(wedges.skin) == 8
    turned = wedges.into_fluid(np.array([[3, 2, 1, 0], [4, 5, 1, 0], [1, 2, 0, 0]]))
    assert {tuple(sorted(set(face))) for face in turned.tolist()} == {(0, 1, 2), (0, 1, 4, 5)}
    for face in turned:
        a, b, c, d = BOX[face]
        assert np.cross(c - a, d - b) @ (BOX.mean(axis=0) - a) > 0.0


def test_the_node_next_to_a_wall_is_at_the_end_of_the_edge_that_leads_off_it():
    box = MixedMesh(BOX, {"wedge": HALVES})
    floor = box.into_fluid(np.array([[0, 1, 2, 2], [0, 2, 3, 3]]))
    at, beside = first_heights(box, floor, np.arange(4))
    assert (at.tolist(), beside.tolist()) == ([0, 1, 2, 3], [4, 5, 6, 7])


def test_there_is_no_node_next_to_the_edge_of_a_plate_without_thickness():
    rng, ids = np.random.default_rng(3), np.arange(16).reshape(4, 4)
    plate = np.column_stack([*np.mgrid[0:4, 0:4].reshape(2, -1) + rng.uniform(-0.2, 0.2, (2, 16)), np.zeros(16)])
    tilted = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    tilted[0] *= np.linalg.det(tilted)
    points = np.concatenate([plate, plate + [0.0, 0.0, 1.0], plate - [0.0, 0.0, 1.0]]) @ tilted
    upper = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)
    cells = np.concatenate([np.hstack([upper, upper + 16]), np.hstack([upper + 32, upper])])
    mesh = MixedMesh(points, {"hexahedron": cells})
    at, beside = first_heights(mesh, upper, ids.ravel())
    assert (at.tolist(), beside.tolist()) == (ids.ravel().tolist(), (ids.ravel() + 16).tolist())
    at, _ = first_heights(mesh, np.concatenate([upper, rng.permutation(upper)[:, ::-1]]), ids.ravel())
    assert at.tolist() == []


@pytest.mark.parametrize("along", [[0, 1, 2, 3, 4, 5, 6, 7], [0, 4, 5, 1, 3, 7, 6, 2], [0, 3, 7, 4, 1, 2, 6, 5]])
def test_thin_cells_of_a_sheet_that_is_bent_by_more_than_it_is_high_are_not_inverted(along):
    rng, height = np.random.default_rng(6), 1e-4
    floor = BOX[:4] + np.outer(rng.standard_normal(4), [0.0, 0.0, 1.0])
    points = np.concatenate([floor, floor + [0.0, 0.0, height]])
    hexahedron = np.array([along])
    kinds = {"hexahedron": hexahedron, "wedge": hexahedron[:, HALVES].reshape(-1, 6)}
    for kind, cells in kinds.items():
        quality = MixedMesh(points, {kind: cells}).quality()
        assert quality.volumes.sum() == pytest.approx(6.0 * height)
        assert not quality.is_inverted.any()
        turned = MixedMesh(BOX, {kind: cells}).quality(points * [1.0, 1.0, -1.0])
        assert turned.is_inverted.all()


TETRA = {"tetra": np.array([[0, 1, 2, 6]])}
SIDES = np.array([[0, 2, 1, 1], [0, 1, 6, 6], [1, 2, 6, 6], [2, 0, 6, 6]])


@pytest.mark.parametrize(
    ("points", "cells", "more", "words"),
    [
        (BOX, {"tetra": np.array([[0, 1, 2, 3], [0, 1, 2, 8]])}, {}, "cells 'tetra': number 2 has node 8 of 8, from 0"),
        (BOX, {"tetra": np.array([[0, 1, -1, 6]])}, {}, "cells 'tetra': number 1 has node -1 of 8"),
        (BOX, {"wedge": np.array([[0, 1, 2, 6]])}, {}, r"cells 'wedge' are int64 of shape \(1, 4\); give .* \(n, 6\)"),
        (BOX, {"tetra": np.array([[0.0, 1.0, 2.0, 6.0]])}, {}, "cells 'tetra' are float64"),
        (BOX, {"voxel": np.arange(8)[None]}, {}, "has cells 'voxel'; known are tetra, pyramid, wedge, hexahedron"),
        (BOX, TETRA, {"markers": {"wing": np.array([[0, 1, 2, 2**40]])}}, "marker 'wing': number 1 has node 10995"),
        (BOX, TETRA, {"n_copies": 2, "markers": {"wing": np.array([[0, 1, 6, 9]])}}, "has node 5 of 4"),
        (np.where(BOX == 5.0, np.nan, BOX), TETRA, {}, "nodes: number 5 of 8 is .*nan.*, not finite"),
        (BOX + 0j, TETRA, {}, "nodes are complex"),
        (BOX[:, :2], TETRA, {}, r"nodes of shape \(8, 2\)"),
        (BOX, {}, {"polyhedra": (SIDES, np.array([0, 0, 0, -5]))}, "a face is of cell -5"),
        (BOX, {}, {"polyhedra": (SIDES, np.array([0, 0, 0, 2 * 10**9]))}, "of cell 2000000000, of cells with 4 faces"),
        (BOX, {}, {"polyhedra": (SIDES, np.array([0, 0, 0, 2]))}, "cell 1 of 3, from 0, has no faces"),
        (BOX, {}, {"polyhedra": (SIDES + 4, np.array([0, 0, 0, 0]))}, "faces of cells: number 2 has node 10 of 8"),
        (BOX, {}, {"polyhedra": (SIDES, np.array([0, 0, 0]))}, "not one whole number each"),
    ],
)
def test_numbers_of_no_node_or_cell_are_no_mesh(points, cells, more, words):
    with pytest.raises(InputError, match=rf"^mesh: .*{words}") as error:
        MixedMesh(points, cells, **more)
    assert "\n" not in str(error.value)
