"""Moved faces of CAD files go back to files with their names, their edges and their topology."""

from dataclasses import replace

import numpy as np
import pytest
from cad_cases import foreign_file, needs_opencascade

from bspline_mdao import InputError, fit_grid
from bspline_mdao.base.numerics.vectors import lengths
from bspline_mdao.files import read_cad, write_cad, write_cad_body
from bspline_mdao.generators import onera_m6_grid

pytestmark = needs_opencascade


def test_moved_faces_go_back_to_a_file_with_their_names(tmp_path):
    write_cad(tmp_path / "wing.step", fit_grid(onera_m6_grid((9, 9, 7)), n_control=(6, 5, 4)), tolerance=1e-5)
    body = read_cad(tmp_path / "wing.step").body
    moved = body.at(body.control_points * [1.0, 1.3, 1.0])
    found = write_cad_body(tmp_path / "thick.step", moved, units="mm")
    assert found.face_names == body.names
    assert found.unit == "millimetre"
    assert found.is_valid
    uv = np.random.default_rng(5).random((40, 2))
    for ours, theirs in zip(moved.faces, found.body.faces):
        np.testing.assert_allclose(theirs.surface.points(uv), ours.surface.points(uv), atol=1e-9)


def test_trimmed_faces_of_a_stranger_go_back_closed_and_valid(tmp_path):
    stranger = read_cad(foreign_file(tmp_path / "a.step"))
    points, free = stranger.body.control_points, ~stranger.body.is_fixed[:, None]
    shifts = np.random.default_rng(6).uniform(-0.005, 0.005, points.shape)
    again = write_cad_body(tmp_path / "b.step", stranger.body.at(points + free * shifts))
    assert again.is_valid
    assert (again.n_solids, again.n_faces, len(again.free_edges)) == (3, 8, 0)
    ball = stranger.body.at(points + free * shifts).faces[7].points[::50]
    assert again.distances(ball).max() < 1e-8
    assert stranger.distances(ball).max() > 1e-3
    assert lengths(again.body.control_points - points).max() > 1e-3


def test_faces_of_no_file_and_other_names_are_refused_and_leave_nothing_behind(tmp_path):
    body = read_cad(foreign_file(tmp_path / "a.step")).body
    with pytest.raises(InputError, match="are of no file; take the faces of read_cad"):
        write_cad_body(tmp_path / "b.step", replace(body, origin=None))
    with pytest.raises(InputError, match="no CAD file by its name"):
        write_cad_body(tmp_path / "b.stl", body)
    assert [path.name for path in tmp_path.iterdir()] == ["a.step"]
