"""CAD files: what OpenCascade reads back is the wall, sewn, closed, named and in the unit that was asked for."""

import importlib.util
import json
import sys

import numpy as np
import pytest

from bspline_mdao import InputError, fit_grid
from bspline_mdao.core.mesh.spline_sides import spline_sides
from bspline_mdao.files import read_cad, write_cad
from bspline_mdao.generators import ball_grid, onera_m6_grid
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.studio.cli.main import run

needs_opencascade = pytest.mark.skipif(
    importlib.util.find_spec("OCP") is None,
    reason='OpenCascade is not installed: pip install "bspline_mdao[cad]"',
)


@pytest.fixture(scope="module")
def ball():
    return fit_grid(ball_grid((9, 9, 9, 9)))


@pytest.fixture(scope="module")
def wing():
    return fit_grid(onera_m6_grid((9, 9, 7)))


def wall_points(model, points, n):
    """Points of the walls themselves at random parameters."""
    u, v = np.random.default_rng(5).random((2, n))
    return np.concatenate([side.surface.points(u, v) for side in spline_sides(model, points)])


def shaken(model, size):
    rng = np.random.default_rng(6)
    return model.control_points + size * rng.uniform(-1.0, 1.0, model.control_points.shape)


@needs_opencascade
@pytest.mark.parametrize(("suffix", "digits"), [("step", 1e-12), ("igs", 2e-9)])
def test_walls_with_straight_knots_are_read_back_exactly_as_one_closed_solid(ball, tmp_path, suffix, digits):
    points = shaken(ball, 0.01)
    report = write_cad(tmp_path / f"ball.{suffix}", ball, points)
    assert report.n_exact == len(report.faces) == 6
    assert report.n_solids == 1
    assert report.is_valid
    assert report.is_closed
    assert report.n_open == 0
    found = read_cad(tmp_path / f"ball.{suffix}")
    assert found.n_faces == 6
    assert found.distances(wall_points(ball, points, 20)).max() < digits
    off = wall_points(ball, points, 2) * 1.1
    assert found.distances(off).min() > 0.05  # the distance sees what is not there


@needs_opencascade
@pytest.mark.parametrize("suffix", ["stp", "iges"])
def test_walls_with_curved_knots_are_read_back_within_the_tolerance_open_at_the_symmetry_plane_alone(
    wing, tmp_path, suffix
):
    report = write_cad(tmp_path / f"wing.{suffix}", wing, tolerance=1e-5)
    assert report.n_exact == 0
    assert 1e-8 < report.error <= 1e-5
    assert report.distance <= 1e-5
    assert (report.n_open, report.n_on_symmetry) == (2, 2)
    assert report.is_valid
    assert report.is_closed
    found = read_cad(tmp_path / f"wing.{suffix}")
    assert found.distances(wall_points(wing, wing.control_points, 100)).max() <= 1e-5
    assert max(np.abs(edge[:, 2]).max() for edge in found.free_edges) < 1e-9
    rows = SurfaceGrid.of(wing).rows
    assert report.missed == pytest.approx(np.linalg.norm(wing.residual[rows], axis=1).max())


@needs_opencascade
@pytest.mark.parametrize("suffix", ["step", "igs"])
@pytest.mark.parametrize("units", ["mm", "in"])
def test_the_unit_is_that_of_the_file_and_the_wall_stays_where_it_is(ball, tmp_path, suffix, units):
    path = tmp_path / f"ball.{suffix}"
    write_cad(path, ball, units=units)
    word = {"mm": (".MILLI.,.METRE.", ",2,2HMM,"), "in": ("'INCH'", ",1,4HINCH,")}[units][suffix == "igs"]
    assert word in path.read_text()
    found = read_cad(path)
    assert found.unit == {"mm": ("millimetre", "MM"), "in": ("INCH", "INCH")}[units][suffix == "igs"]
    assert found.distances(wall_points(ball, ball.control_points, 2)).max() < 1e-7


@needs_opencascade
def test_faces_have_the_names_of_their_patches(wing, tmp_path):
    for name in ("wing.step", "wing.igs"):
        write_cad(tmp_path / name, wing)
        found = read_cad(tmp_path / name)
        assert found.names == ("wing_lower", "wing_upper")
        for face in found.body.faces:  # each has the name of its side
            assert (face.points[:, 1].mean() > 0.0) == (face.name == "wing_upper")
    write_cad(tmp_path / "upper.igs", wing, patches="*upper")
    text = (tmp_path / "upper.igs").read_text()
    assert "10Hwing_upper" in text
    assert "wing_lower" not in text


@needs_opencascade
def test_the_commands_write_cad_and_say_how_good_it_is(wing, tmp_path, capsys):
    model = tmp_path / "wing.h5"
    wing.save(model)
    done = run(["cad", str(model), "-o", str(tmp_path / "a.step"), "--json", str(tmp_path / "a.json")])
    assert done == 0
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert numbers["distance"] <= numbers["tolerance"]
    said = " ".join(capsys.readouterr().out.split())
    assert "0 of 2 faces exact, the others refitted to 2.1e-06 m; read back by OpenCascade: valid" in said
    assert "2 edges on planes of symmetry open, 0 elsewhere" in said
    moved = [str(tmp_path / name) for name in ("moved.xyz", "moved.step")]
    move = ["move", str(model), "--deform", "translate=0.1/0/0", "--mover", "transfinite", "-o", moved[0]]
    assert run([*move, "--surface", moved[1]]) == 0
    shifted = wall_points(wing, wing.control_points, 5) + [0.1, 0.0, 0.0]
    assert read_cad(moved[1]).distances(shifted).max() < 3e-6


@needs_opencascade
@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.stl", {}, "a.stl: no CAD file by its name; end it in .step, .stp, .iges, .igs"),
        ("a.step", {"units": "yd"}, "no unit is called 'yd'; choose one of m, mm, in, ft"),
        ("a.step", {"tolerance": -1.0}, "tolerance -1 m; give a positive length"),
        ("a.step", {"patches": "tail"}, "no patch is called 'tail'"),
    ],
)
def test_wrong_input_is_refused_in_one_line_and_leaves_nothing_behind(ball, tmp_path, name, options, message):
    with pytest.raises(InputError) as error:
        write_cad(tmp_path / name, ball, **options)
    assert message in str(error.value)
    assert len(str(error.value).splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@needs_opencascade
def test_a_file_that_is_no_cad_is_refused(tmp_path):
    path = tmp_path / "a.step"
    with pytest.raises(InputError, match="no such file"):
        read_cad(path)
    path.write_text("nothing\n")
    with pytest.raises(InputError, match="cannot read it as STEP"):
        read_cad(path)


def test_without_opencascade_one_line_says_what_to_install(ball, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "OCP", None)
    with pytest.raises(InputError, match=r'^CAD files need OpenCascade: pip install "bspline_mdao\[cad\]"$'):
        write_cad(tmp_path / "a.step", ball)
