"""SU2 meshes: what is read, what is kept, what is refused."""

import numpy as np
import pytest
from riding_cases import mesh, su2_text

from bspline_mdao import InputError
from bspline_mdao.files import read_mesh


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "wing.su2"
    path.write_text(su2_text(mesh()))
    return path


def test_a_mesh_comes_in_as_it_was(file):
    found = read_mesh(file).mesh
    np.testing.assert_array_equal(found.points, mesh().points)
    for kind, cells in mesh().cells.items():
        np.testing.assert_array_equal(found.cells[kind], cells)
    assert {name: len(faces) for name, faces in found.markers.items()} == {k: len(v) for k, v in mesh().markers.items()}


def test_all_but_the_nodes_that_moved_is_kept_to_the_last_byte(file):
    read, rng = read_mesh(file), np.random.default_rng(4)
    points = mesh().points.copy()
    moved = rng.choice(len(points), 50, replace=False)
    points[moved] += rng.standard_normal((50, 3))
    read.write(file.with_name("moved.su2"), points)
    old, new = (path.read_bytes().split(b"\n") for path in (file, file.with_name("moved.su2")))
    first = old.index(f"NPOIN= {len(points)}".encode()) + 1
    assert [n for n, (a, b) in enumerate(zip(old, new)) if a != b] == sorted((first + moved).tolist())
    assert all(new[first + n].endswith(b" %d" % n) for n in moved)
    np.testing.assert_array_equal(read_mesh(file.with_name("moved.su2")).mesh.points, points)
    read.write(file.with_name("same.su2"), mesh().points)
    assert file.with_name("same.su2").read_bytes() == file.read_bytes()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("NDIME= 3", "NDIME= 4", "has NDIME=4; only 2 and 3 dimensions"),
        ("NDIME= 3", "NDIME= 2", "has elements of kind 12; known are 5, 9"),
        ("NDIME= 3", "NDIM= 3", "has no NDIME"),
        ("NPOIN= {n_points}", "NPOIN= 7", "announces 7 nodes"),
        ("NELEM= {n_cells}", "NELEM= x", "NELEM=x is no number"),
        ("NELEM= {n_cells}", "NELEM= {one_cell_more}", "elements and holds"),
        ("\n12 ", "\n99 ", "has elements of kind 99"),
        ("\n12 ", "\n12 999999", "has node"),
        ("\n12 ", "\n12 0 ", "element 1, of kind 12, has 10 numbers of nodes in the place of 8"),
        ("\n9 ", "\n9 0 0 ", "marker 'wing': element 1, of kind 9, has 6 numbers of nodes in the place of 4"),
        ("\n9 ", "\n13 ", "marker 'wing': has elements of kind 13; known are 5, 9, 1"),
        ("\n9 ", "\n9 -1 ", "marker 'wing': number 1 has node -1 of"),
        (" 3\n  ", " 3\n  7.0 ", "node 5 has too many coordinates: 5 words in its line, in the place of 4"),
        (" 0\n  ", " 0\n  1.0 % ", "node 2 has too few coordinates: 1 words in its line, in the place of 4"),
        (" 1\n  -1", " 1\n % 1", "announces .* nodes and holds"),
        (" 0\n  ", " 0.5\n  ", "node 1 has 0.5 behind its 3 coordinates, which is no number of a node"),
        ("\t", "0" * 200 + "\t", "a coordinate of 223 characters is no number"),
        ("\t", "nan\t", "a coordinate is no number"),
        ("e-01\t", "e+999\t", "nodes: number .* not finite"),
        ("MARKER_TAG= symmetry", "MARKER_TAG= wing", "has elements of marker 'wing' twice"),
        ("NMARK= 3", "NMARK= 4", "announces 4 markers and holds 3"),
        ("NMARK= 3", "NMARK= " + "9" * 30, "NMARK=9+ is no number"),
        ("% made by hand", "NDIME= 3", "several zones"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(file, old, new, words):
    numbers = {"n_points": mesh().n_points, "n_cells": mesh().n_cells, "one_cell_more": mesh().n_cells + 1}
    file.write_text(file.read_text().replace(old.format(**numbers), new.format(**numbers), 1))
    with pytest.raises(InputError, match=words) as error:
        read_mesh(file)
    assert str(file) in str(error.value)
    assert "\n" not in str(error.value)


def test_other_names_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"wing.stl: is no mesh that can ride along; give .*\.su2"):
        read_mesh(tmp_path / "wing.stl")
