"""Triangulations: files of all dialects give one body, and its nearest places are those of all triangles."""

import struct

import numpy as np
import pytest

from bspline_mdao import DesignSurface, InputError, fit_grid
from bspline_mdao.base.numerics.vectors import lengths
from bspline_mdao.files import Triangles, read_triangles
from bspline_mdao.generators import ball_grid, fit_shape
from bspline_mdao.grids.io.triangles import nearest_places
from bspline_mdao.measures import SurfaceGrid


def ball(n=2):
    """A sphere of radius 1.1 in triangles, off the middle, whose corners are the same in four bytes."""
    points = np.concatenate([np.eye(3), -np.eye(3)])
    corners = [(i, j, k) for i in (0, 3) for j in (1, 4) for k in (2, 5)]
    faces = np.array([[a, b, c] if np.linalg.det(points[[a, b, c]]) > 0.0 else [a, c, b] for a, b, c in corners])
    for _ in range(n):
        a, b, c = (points[faces[:, k]] for k in range(3))
        ab, bc, ca = (x / lengths(x)[:, None] for x in (a + b, b + c, c + a))
        parts = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
        points, ids = np.unique(parts.reshape(-1, 3).round(12), axis=0, return_inverse=True)
        faces = ids.reshape(-1, 3)
    return Triangles("ball", (1.1 * points + [0.01, 0.02, -0.01]).astype("f4").astype(float), faces)


def written(body, path, dialect):
    if dialect == "obj":
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in body.points.tolist()]
        n = len(body.points)
        lines += [f"f {a + 1}/1/1 {b + 1}//2 {c - n}" for a, b, c in body.triangles.tolist()]
        path.write_text("# a ball\n" + "\n".join(lines) + "\n")
    elif dialect == "text":
        facets = [
            "facet normal 0 0 0\n outer loop\n"
            + "".join(f"  vertex {x!r} {y!r} {z!r}\n" for x, y, z in t)
            + " endloop\nendfacet\n"
            for t in body.points[body.triangles].tolist()
        ]
        path.write_text("solid ball\n" + "".join(facets) + "endsolid ball\n")
    else:  # some programs begin binary files with "solid", too
        records = [struct.pack("<12fH", *np.zeros(3), *t.ravel(), 0) for t in body.points[body.triangles]]
        path.write_bytes(b"solid by a stranger".ljust(80) + struct.pack("<I", len(records)) + b"".join(records))
    return path


@pytest.mark.parametrize(("dialect", "suffix"), [("text", "stl"), ("binary", "STL"), ("obj", "obj")])
def test_files_of_all_dialects_give_the_same_body(tmp_path, dialect, suffix):
    body = ball()
    found = read_triangles(written(body, tmp_path / f"ball.{suffix}", dialect))
    assert len(found.points) == len(body.points)
    np.testing.assert_array_equal(found.points[found.triangles], body.points[body.triangles])


def test_nearest_places_are_those_of_all_triangles():
    body, rng = ball(1), np.random.default_rng(1)
    points = rng.uniform(-2.0, 2.0, (50, 3))
    every = body.points[body.triangles]
    best = [min(lengths(nearest_places(np.tile(x, (len(every), 1)), every) - x)) for x in points]
    np.testing.assert_allclose(body.distances(points), best, rtol=1e-13)
    weights = rng.dirichlet([1.0, 1.0, 1.0], len(every))
    on = np.einsum("nk,nkc->nc", weights, every)
    normal = np.cross(every[:, 1] - every[:, 0], every[:, 2] - every[:, 0])
    above = on + 0.01 * normal / lengths(normal)[:, None]
    np.testing.assert_allclose(body.nearest(above), on, atol=1e-12)


def test_samples_are_on_the_body_no_farther_apart_than_asked():
    body = ball(1)
    samples = body.samples(0.1)
    assert body.distances(samples).max() < 1e-12
    rng = np.random.default_rng(2)
    places = body.nearest(rng.normal(size=(200, 3)))
    assert max(lengths(samples - place).min() for place in places) < 0.1


def test_walls_are_fitted_to_triangles():
    model, body = fit_grid(ball_grid((9, 9, 9, 9))), ball(4)
    design = DesignSurface.of(model)
    ids = design.mesh.surface_ids
    moved = model.control_points.copy()
    moved[ids] = fit_shape(model, ids, body)
    surface = SurfaceGrid.of(model)
    before = body.distances(surface.points).max()
    after = body.distances(model.evaluator().forward(moved).reshape(-1, 3)[surface.rows]).max()
    assert before > 0.05
    assert after < 0.01


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.ply", b"ply", "no triangulation by its name; end it in .stl, .obj"),
        ("a.stl", b"solid a\nendsolid a\n", "no triangle is in it"),
        ("a.stl", b"solid\nvertex 0 0 0\nvertex 1 0 0\n", "is damaged (2 corners, no multiple of three)"),
        ("a.stl", b"\0" * 80 + struct.pack("<I", 7), "is damaged (84 bytes, fewer than"),
        ("a.obj", b"v 0 0 0\nf 1 2 3\n", "is damaged (a face has corner 3, and there are 1)"),
        ("a.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "corner 1 is not finite"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path, name, data, message):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError) as error:
        read_triangles(tmp_path / name)
    assert message in str(error.value)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_triangles(tmp_path / "none.stl")
