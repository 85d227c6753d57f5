"""Faces of files have common knots along the edges that they share: edges stay closed whatever control points do."""

import numpy as np
import pytest
from cad_cases import needs_opencascade

from bspline_mdao import fit_grid
from bspline_mdao.base.numerics.vectors import lengths
from bspline_mdao.core.cad.common_knots import with_common_knots
from bspline_mdao.core.cad.side_knots import starting_knots, union_of
from bspline_mdao.core.cad.tensor_surface import tensor_surface
from bspline_mdao.core.mesh.spline_sides import spline_sides
from bspline_mdao.files import read_cad, write_cad
from bspline_mdao.generators import ball_grid, onera_m6_grid
from bspline_mdao.splines import ConstantKnots


@pytest.fixture(scope="module")
def bent():
    """A ball that is bent, so that the knots of its six faces are curved, and those of neighbours differ."""
    grid = ball_grid((9, 9, 9, 9))
    x = grid.to_vector().reshape(-1, 3)
    waves = [np.sin(1.3 * x[:, 1] + 0.4) * x[:, 0], np.cos(x[:, 2]) * x[:, 1] ** 2, 0.7 * x[:, 0] * x[:, 1]]
    return fit_grid(grid.with_vector((x + 0.05 * np.stack(waves, axis=1)).ravel()), n_control=(6, 6, 5))


@needs_opencascade
@pytest.mark.parametrize("tolerance", [1e-4, 1e-8])
def test_edges_of_written_faces_stay_closed_whatever_control_points_do(bent, tmp_path, tolerance):
    report = write_cad(tmp_path / "bent.step", bent, tolerance=tolerance)
    assert report.n_exact == 0
    assert report.error <= tolerance
    assert report.is_closed
    body = read_cad(tmp_path / "bent.step").body
    first, second = body.joints
    assert len(first.faces) > 1000
    assert not body.is_fixed.any()
    moved = body.at(body.control_points + 0.1 * np.random.default_rng(1).normal(size=body.control_points.shape))
    for faces in (body, moved):
        assert lengths(faces.places(first) - faces.places(second)).max() < 1e-12
    assert lengths(moved.places(first) - body.places(first)).max() > 0.1


def test_neighbours_that_were_refined_otherwise_get_the_same_knots_and_stay_what_they_were(bent):
    sides = spline_sides(bent)
    known = starting_knots(sides)
    tolerances = 10.0 ** np.linspace(-8.0, -3.0, len(sides))
    own = [tensor_surface(s.surface, t, s.name, known=k) for s, t, k in zip(sides, tolerances, known)]
    shared = with_common_knots(sides, own)
    counts = [{k.n_control for s in surfaces for k in s.knots} for surfaces in (own, shared)]
    assert len(counts[0]) > 2
    assert len(counts[1]) < len(counts[0])
    at = np.random.default_rng(2).random((2, 30))
    for before, after in zip(own, shared):
        np.testing.assert_allclose(after.lattice(*at), before.lattice(*at), atol=1e-14)
        assert after.control_points.shape[:2] == tuple(k.n_control for k in after.knots)


def test_knots_that_differ_by_single_precision_are_one_in_their_union():
    rng = np.random.default_rng(3)
    inner = np.sort(rng.random(4))
    ends = np.zeros(4), np.ones(4)
    parts = [
        ConstantKnots(np.concatenate([ends[0], knots, ends[1]]), 4)
        for knots in (inner, inner[1:] + 3e-8, np.repeat(inner[:1], 2))
    ]
    union, same = union_of(parts)
    np.testing.assert_allclose(union.knots[4:-4], np.sort(np.append(inner, inner[0])), atol=1e-7)
    for part, found in zip(parts, same):
        assert len(found.knots) == len(part.knots)
        assert np.isin(found.knots, union.knots).all()


@needs_opencascade
@pytest.mark.parametrize("tolerance", [3e-4, 1e-4, 3e-5, 1e-6])
def test_no_tolerance_is_missed_between_the_parameters_of_the_fit(tmp_path, tolerance):
    model = fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4))
    report = write_cad(tmp_path / "wing.step", model, tolerance=tolerance)
    assert report.error <= tolerance
    assert report.distance <= tolerance
