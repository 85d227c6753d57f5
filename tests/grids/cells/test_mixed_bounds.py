"""Bounds of the Jacobians of single cells of mixed kinds, against samples of their maps."""

import numpy as np
import pytest

from bspline_mdao.grids.cells.bernstein import INVALID, UNDECIDED, VALID
from bspline_mdao.grids.cells.certificate import Certificate
from bspline_mdao.grids.cells.mixed_bounds import certify_mixed, jacobian_bounds
from bspline_mdao.grids.cells.mixed_cells import MixedMesh

CORNERS = {
    "tetra": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "pyramid": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 1]],
    "wedge": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [0, 1, 1]],
    "hexahedron": [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]],
}
LINE = np.linspace(0.0, 1.0, 11)


def slopes_at(kind, place):
    """Derivatives of the shape functions of VTK's cells by the three coordinates, written by hand."""
    r, s, t = place
    if kind == "tetra":
        return np.array([[-1, -1, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    if kind == "wedge":
        low, high = 1.0 - t, t
        flat, slopes = np.array([1.0 - r - s, r, s]), np.array([[-1, -1], [1, 0], [0, 1.0]])
        rows = [
            np.concatenate([weight * slopes, sign * flat[:, None]], axis=1) for weight, sign in ((low, -1), (high, 1))
        ]
        return np.concatenate(rows)
    ends = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    u, v = np.where(ends[:, 0], r, 1 - r), np.where(ends[:, 1], s, 1 - s)
    du, dv = np.where(ends[:, 0], 1.0, -1.0), np.where(ends[:, 1], 1.0, -1.0)
    base = np.stack([du * v, u * dv, u * v], axis=1)
    low, high = base * [1 - t, 1 - t, -1.0], base * [t, t, 1.0]
    if kind == "hexahedron":
        return np.concatenate([low, high])
    return np.concatenate([low, [[0.0, 0.0, 1.0]]])  # the map of the base at t = 0, which shrinks to the apex


def sampled(kind, corners):
    """Jacobians of cells, shape (n, n_samples)."""
    axes = LINE, LINE, [0.0] if kind == "pyramid" else LINE
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    if kind in ("tetra", "wedge"):
        places = places[places[:, 0] + places[:, 1] <= 1.0 + 1e-12]
    slopes = np.array([slopes_at(kind, place) for place in places])
    return np.linalg.det(np.einsum("spc,npx->nsxc", slopes, corners))


def mesh_of(kind, corners):
    n, m = corners.shape[:2]
    return MixedMesh(corners.reshape(-1, 3), {kind: np.arange(n * m).reshape(n, m)})


def shaken(kind, n, size, seed=0):
    """Cells whose corners are shaken, the first in place."""
    rng = np.random.default_rng(seed)
    corners = np.array(CORNERS[kind], dtype=float) + size * rng.uniform(-1.0, 1.0, (n, len(CORNERS[kind]), 3))
    corners[0] = CORNERS[kind]
    return corners @ (np.eye(3) + 0.3 * rng.normal(size=(3, 3)))


@pytest.mark.parametrize("kind", list(CORNERS))
def test_a_bound_is_never_above_the_samples_and_nothing_is_proved_that_they_contradict(kind):
    n_of = {VALID: 0, UNDECIDED: 0, INVALID: 0}
    for size in (0.2, 0.6):
        corners = shaken(kind, 150, size)
        status, bounds = jacobian_bounds(mesh_of(kind, corners))[kind]
        values = sampled(kind, corners)
        values = values if np.median(values) > 0.0 else -values
        least = values.min(axis=1)
        assert (bounds <= least + 1e-12 * np.abs(values).max()).all()
        assert (least[status == VALID] > 0.0).all()
        assert (status[least <= -1e-12] == INVALID).all()
        assert (bounds[status == VALID] > 0.0).all()
        for known in n_of:
            n_of[known] += int(np.count_nonzero(status == known))
    assert n_of[VALID] > 100
    assert n_of[INVALID] > 10
    assert n_of[UNDECIDED] == 0


def test_bounds_of_tetrahedra_are_six_times_their_volumes_and_those_of_straight_cells_their_jacobians():
    corners = shaken("tetra", 40, 0.2)
    mesh = mesh_of("tetra", corners)
    np.testing.assert_allclose(jacobian_bounds(mesh)["tetra"][1], 6.0 * mesh.quality().volumes, rtol=1e-13)
    for kind in ("wedge", "pyramid", "hexahedron"):
        (status, bounds), values = (
            jacobian_bounds(mesh_of(kind, shaken(kind, 1, 0.0)))[kind],
            sampled(kind, shaken(kind, 1, 0.0)),
        )
        assert status[0] == VALID
        np.testing.assert_allclose(bounds[0], np.abs(values).min(), rtol=1e-12)


def test_wedges_with_positive_corners_are_told_apart_by_what_is_between():
    wedge = np.array(CORNERS["wedge"], dtype=float)
    turned, folded = wedge.copy(), wedge.copy()
    c, s = np.cos(2.2), np.sin(2.2)  # by 126 degrees: a coefficient is negative, and the cell is valid
    turned[3:, :2] = wedge[3:, :2] @ [[c, s], [-s, c]]
    folded[3:, :2] = wedge[3:, :2] * [-2.0, -0.5]
    cells = np.stack([wedge, turned, folded])
    values = sampled("wedge", cells).reshape(3, -1, len(LINE))
    assert (values[:, :, [0, -1]] > 0.0).all()
    status, bounds = jacobian_bounds(mesh_of("wedge", cells))["wedge"]
    assert status.tolist() == [VALID, VALID, INVALID]
    least = values.min(axis=(1, 2))
    assert least[2] < 0.0 < bounds[1] <= least[1]
    assert (bounds <= least).all()


def test_a_mesh_of_several_kinds_is_summed_up_in_the_words_of_grids_whichever_way_its_cells_go_round():
    parts, points, start = {}, [], 0
    for kind in ("tetra", "wedge", "hexahedron"):
        corners = shaken(kind, 30, 0.05, seed=4) + np.array([5.0 * len(parts), 0.0, 0.0])
        if kind == "wedge":
            corners = corners[:, [0, 2, 1, 3, 5, 4]]
        if kind == "hexahedron":
            corners[7, [1, 2]] = corners[7, [2, 1]]
        parts[kind] = start + np.arange(corners[..., 0].size).reshape(corners.shape[:2])
        points.append(corners.reshape(-1, 3))
        start += points[-1].shape[0]
    mesh = MixedMesh(np.concatenate(points), parts)
    certificate = Certificate(certify_mixed(mesh))
    assert certificate.status == "invalid"
    assert certificate.lines() == [
        "89 of 90 cells valid: their Jacobian is proved positive everywhere in them, not only at corners; 1 invalid, "
        "0 undecided",
        "  hexahedron: 1 invalid of 30 cells, such as (8) invalid",
    ]
    assert Certificate(certify_mixed(mesh, 2.0 * mesh.points)).lines() == certificate.lines()
