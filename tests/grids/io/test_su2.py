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
        ("\n12 ", "\n12 0 ", "element 1, of kind 12, has 10 numbers of nodes instead of 8"),
        ("\n9 ", "\n9 0 0 ", "marker 'wing': element 1, of kind 9, has 6 numbers of nodes instead of 4"),
        ("\n9 ", "\n13 ", "marker 'wing': has elements of kind 13; known are 5, 9, 1"),
        ("\n9 ", "\n9 -1 ", "marker 'wing': number 1 has node -1 of"),
        (" 3\n  ", " 3\n  7.0 ", "node 5 has too many coordinates: 5 words in its line, instead of 4"),
        (" 0\n  ", " 0\n  1.0 % ", "node 2 has too few coordinates: 1 words in its line, instead of 4"),
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
    with pytest.raises(InputError, match=r"wing.stl: is no unstructured mesh; give .*\.su2"):
        read_mesh(tmp_path / "wing.stl")


def replace_lines(path, which, change):
    """Change the lines of a file that a function takes, by their numbers."""
    lines = path.read_text().split("\n")
    path.write_text("\n".join(change(line) if which(n, line) else line for n, line in enumerate(lines)))


ZONE = """IZONE= {zone}
NDIME= 2
NELEM= 2
{cells}
NPOIN= 4
{x} 0.0 0
{y} 0.0 1
{y} 1.0 2
{x} 1.0 3
NMARK= 2
MARKER_TAG= lower wall
MARKER_ELEMS= 1
SEND_TO= 0
3 0 1
MARKER_TAG= side_{zone}
MARKER_ELEMS= 1
3 1 2 0
"""

TURNED = {1: "5 0 1 2\n5 0 2 3", 2: "5 2 1 0\n5 3 2 0"}


def zones_text(n_zones=2):
    """Two squares beside each other, in zones of their own that go round the other way, and what is behind meshes."""
    parts = [ZONE.format(zone=zone, cells=TURNED[zone], x=float(zone), y=zone + 1.0) for zone in (1, 2)]
    others = ["NPERIODIC= 2", "PERIODIC_INDEX= 0", "0 0 0", "PERIODIC_INDEX= 1", "0 1 0"]
    boxes = ["FFD_NBOX= 2", "FFD_TAG= ONE", "FFD_TAG= TWO", "FFD_CONTROL_POINTS= 1", "0 0 0 0.5 0.5 0.5", ""]
    return "\n".join([f"NZONE= {n_zones}", "AOA_OFFSET= 1.5", *parts, *others, *boxes])


def test_zones_are_one_mesh_whose_nodes_follow_each_other_and_all_else_is_kept(tmp_path):
    path, moved_path = tmp_path / "zones.su2", tmp_path / "moved.su2"
    path.write_text(zones_text())
    read = read_mesh(path)
    mesh, n = read.mesh, 8
    assert (mesh.n_stored, mesh.n_cells, list(mesh.markers)) == (n, 4, ["lower wall", "side_1", "side_2"])
    np.testing.assert_array_equal(mesh.points[:n, 0], [1, 2, 2, 1, 2, 3, 3, 2])
    np.testing.assert_array_equal(mesh.markers["lower wall"][:, :2], [[0, 1], [4, 5]])
    np.testing.assert_array_equal(mesh.markers["side_2"][:, :2], [[5, 6]])
    assert not mesh.quality().is_inverted.any()  # though the second zone goes round the other way
    read.write(moved_path, mesh.points + [0.0, 0.25, 0.0] * (mesh.points[:, :1] > 2.5))
    old, new = (p.read_text().split("\n") for p in (path, moved_path))
    changed = [n for n, (a, b) in enumerate(zip(old, new)) if a != b]
    assert [new[n] for n in changed] == ["3.0 0.25 1", "3.0 1.25 2"]
    assert min(changed) > old.index("IZONE= 2")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("NZONE= 2", "NZONE= 3", "announces 3 zones and holds 2"),
        ("IZONE= 2", "IZONE= 3", "has IZONE=3 instead of 2"),
        ("IZONE= 2\nNDIME= 2", "IZONE= 2\nNDIME= 3", "has zones of 2 and of 3 dimensions"),
        ("5 2 1 0", "5 2 1 4", "zone 2: cells 'triangle': number 1 has node 4 of 4"),
        ("3 0 1\nMARKER_TAG= side_1", "3 0 5\nMARKER_TAG= side_1", "zone 1: marker 'lower wall': .* node 5 of 4"),
        ("IZONE= 2\nNDIME= 2\nNELEM= 2", "IZONE= 2\nNDIME= 2\nNELEM= 3", "zone 2: announces 3 elements"),
        ("AOA_OFFSET= 1.5", "NDIME= 2", "has NDIME before the first IZONE"),
    ],
)
def test_what_is_wrong_in_a_zone_is_said_with_its_number(tmp_path, old, new, words):
    path = tmp_path / "zones.su2"
    path.write_text(zones_text().replace(old, new, 1))
    with pytest.raises(InputError, match=words) as error:
        read_mesh(path)
    assert "\n" not in str(error.value)


def test_two_numbers_behind_coordinates_are_kept_and_parts_that_meet_are_no_boundary(file):
    first = file.read_text().split("\n").index(f"NPOIN= {mesh().n_points}")
    replace_lines(file, lambda n, _: first < n <= first + mesh().n_points, lambda line: f"{line} 7")
    text = (
        file.read_text()
        .replace("NMARK= 3", "NMARK= 5")
        .replace(
            "\nFFD_NBOX",
            "".join(f"\nMARKER_TAG= SEND_RECEIVE\nMARKER_ELEMS= 2\nSEND_TO= {side}\n1 0 1\n1 5 1" for side in (1, -1))
            + "\nFFD_NBOX",
        )
    )
    file.write_text(text.replace(f"NPOIN= {mesh().n_points}", f"NPOIN= {mesh().n_points}\t7"))
    read = read_mesh(file)
    assert list(read.mesh.markers) == list(mesh().markers)
    np.testing.assert_array_equal(read.mesh.points, mesh().points)
    read.write(file.with_name("moved.su2"), mesh().points * 2.0)
    line = file.with_name("moved.su2").read_text().split("\n")[first + 4]
    assert line.endswith(" 3 7")
    assert line.split()[:3] == list(map(repr, (2.0 * mesh().points[3]).tolist()))


REAL = {
    "centrifugal_blade": (8108, 2, ["inflow", "outflow", "wall1", "wall2", "periodic1", "periodic2"]),
    "mesh_NACA0012_lam_hybrid_v2": (23317, 2, ["airfoil", "farfield"]),
    "mesh_RAE2822_turb": (13937, 2, ["AIRFOIL", "FARFIELD"]),
    "mesh_RAE2822_turb_ffd": (13937, 2, ["AIRFOIL", "FARFIELD"]),
    "mesh_brick_prism_ffd": (16800, 1, ["x_m", "x_p", "y_m", "y_p", "z_m", "z_p"]),
    "mesh_brick_pyra_ffd": (14030, 1, ["x_m", "x_p", "y_m", "y_p", "z_m", "z_p"]),
    "mesh_square_turb_hybrid": (18780, 2, ["inlet", "lower", "outlet", "square", "upper"]),
    "rotating_cylinders": (18522, 2, ["inlet", "up", "down", "outlet", "domain_interface", "external_interface"]),
    "transonic_stator_periodic": (17545, 2, ["inflow", "outflow", "airfoil", "periodic_1", "periodic_2"]),
}
"""Nodes, copies of each and first markers of meshes of other projects."""


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_real_meshes_are_read_without_inverted_cells_and_written_as_they_were(real_mesh, tmp_path, name):
    path, (n_points, n_copies, markers) = real_mesh(name), REAL[name]
    read = read_mesh(path)
    assert (read.mesh.n_stored, read.mesh.n_copies) == (n_points, n_copies)
    assert list(read.mesh.markers)[: len(markers)] == markers
    assert not read.mesh.quality().is_inverted.any()
    read.write(tmp_path / "same.su2", read.mesh.points)
    assert (tmp_path / "same.su2").read_bytes() == path.read_bytes()
