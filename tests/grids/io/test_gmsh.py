"""Meshes of Gmsh: which section is which, how many numbers they have, and what they may not be."""

import numpy as np
import pytest

from bspline_mdao import InputError
from bspline_mdao.files import read_mesh

POINTS = np.random.default_rng(9).standard_normal((5, 3))
LINES = [" ".join(map(repr, row)) for row in POINTS.tolist()]

OLD = "\n".join(
    [
        "$Comments",
        "$Nodes",
        "1",
        "1 0 0 0",
        "$EndNodes",
        "$EndComments",
        "$MeshFormat",
        "2.2 0 8",
        "$EndMeshFormat",
        "$PhysicalNames",
        "2",
        '2 4 "wing"',
        '3 1 "air"',
        "$EndPhysicalNames",
        "$Nodes",
        "5",
        *(f"{10 * k + 7} {line}" for k, line in enumerate(LINES)),
        "$EndNodes",
        "$Elements",
        "4",
        "1 4 2 1 1 7 17 27 37",
        "2 2 2 4 3 7 17 27",
        "3 2 2 -5 3 7 17 37",
        "4 4 2 1 1 17 27 37 47",
        "$EndElements",
        "",
    ]
)

NEW = "\n".join(
    [
        "$MeshFormat",
        "4.1 0 8",
        "$EndMeshFormat",
        "$PhysicalNames",
        "2",
        '2 4 "wing"',
        '2 6 "all of it"',
        "$EndPhysicalNames",
        "$Entities",
        "0 0 2 1",
        "3 0 0 0 1 1 1 2 4 6 0",
        "8 0 0 0 1 1 1 1 -5 0",
        "1 0 0 0 1 1 1 0 2 3 -8",
        "$EndEntities",
        "$Nodes",
        "3 5 7 47",
        "2 3 1 2",
        "7",
        "17",
        *(f"{line} 0.5 0.25" for line in LINES[:2]),
        "2 8 0 0",
        "3 1 0 3",
        "27",
        "37",
        "47",
        *LINES[2:],
        "$EndNodes",
        "$Elements",
        "3 4 1 4",
        "2 3 2 1",
        "2 7 17 27",
        "2 8 2 1",
        "3 7 17 37",
        "3 1 4 2",
        "1 7 17 27 37",
        "4 17 27 37 47",
        "$EndElements",
        "",
    ]
)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "wing.msh"


@pytest.mark.parametrize("text", [OLD, NEW], ids=["2.2", "4.1"])
def test_comments_are_no_nodes_and_a_face_is_of_all_its_groups(path, text):
    path.write_text(text)
    read = read_mesh(path)
    np.testing.assert_array_equal(read.mesh.points, POINTS)
    assert read.mesh.cells["tetra"].tolist() == [[0, 1, 2, 3], [1, 2, 3, 4]]
    groups = {"wing": [[0, 1, 2, 2]], "5": [[0, 1, 3, 3]]} | ({"all of it": [[0, 1, 2, 2]]} if text == NEW else {})
    assert {name: faces.tolist() for name, faces in read.mesh.markers.items()} == groups
    moved = POINTS.copy()
    moved[[1, 3]] += 0.5
    read.write(path.with_name("moved.msh"), moved)
    np.testing.assert_array_equal(read_mesh(path.with_name("moved.msh")).mesh.points, moved)
    changed = [a != b for a, b in zip(text.split("\n"), path.with_name("moved.msh").read_text().split("\n"))]
    assert [line for line, is_changed in zip(text.split("\n"), changed) if is_changed] == [
        line for line in text.split("\n") if LINES[1] in line or LINES[3] in line
    ]


@pytest.mark.parametrize(
    ("text", "old", "new", "words"),
    [
        (OLD, "$Nodes\n5", "$Nodes\n6", "announces 6 and holds 5"),
        (OLD, "$Nodes\n5", "$Nodes\n-1", "it announces -1"),
        (OLD, "17 " + LINES[1], "7 " + LINES[1], "two nodes have one number"),
        (OLD, "17 " + LINES[1], "17.5 " + LINES[1], "not all have a number"),
        (OLD, LINES[1], LINES[1] + " 3", "node 2 has too many coordinates: 5 words in its line, instead of 4"),
        (OLD, "7 17 27 37\n2", "0 17 27 37\n2", "an element has node 0, which does not exist"),
        (OLD, "7 17 27 37\n2", "7 17 27\n2", "element 1 has not the numbers of its type 4"),
        (OLD, "2 2 2 4 3 7", "2 2 3 4 3 7", "element 2 has not the numbers of its type 2"),
        (OLD, "1 4 2 1 1", "1 140 2 1 1", "elements of type 140, which is not known"),
        (OLD, "$Elements\n4", "$Elements\n3", "announces 3 elements and holds 4"),
        (OLD, "$EndElements", "", r"section \$Elements does not end"),
        (OLD, "$EndMeshFormat", "9$EndMeshFormat", r"section \$MeshFormat does not end"),
        (OLD, "$PhysicalNames", "$Nodes\n$EndNodes\n$PhysicalNames", r"has \$Nodes twice"),
        (OLD, "$PhysicalNames", "7\n$PhysicalNames", "there is other text after"),
        (OLD, "$PhysicalNames\n2", "$PhysicalNames\n3", "announces 3 physical names and holds 2"),
        (OLD, "2.2 0 8", "2.1 0 8", "of Gmsh of version 2.1; save it as version 4.1 or 2.2"),
        (NEW, "3 1 0 3\n", "3 1 0 -1\n", "announces -1 numbers and ends before"),
        (NEW.replace("3 5 7", "900000000000 5 7"), "3 1 0 3\n", "3 1 0 -1\n", "announces -1 numbers and ends before"),
        (NEW, "3 1 0 3\n", "3 1 0 60000000000\n", "announces 60000000000 numbers and ends before"),
        (NEW, "3 5 7 47", "9000000000000 5 7 47", "announces .* numbers and ends before"),
        (NEW, "3 5 7 47", "2 5 7 47", "there is more than it announces"),
        (NEW, "3 5 7 47", "3 6 7 47", "announces 6 and holds 5"),
        (NEW, "2 3 1 2\n", "2 3 0 2\n", "nodes or elements are damaged"),
        (NEW, "\n37\n47", "\n37\n27", "two nodes have one number"),
        (NEW, "3 1 4 2", "3 1 4 -2", "announces -.* numbers and ends before"),
        (NEW, "3 1 4 2", "2 3 4 2", "elements of type 4 of entity 3 of dimension 2, which does not exist"),
        (NEW, "3 1 4 2", "3 2 4 2", "elements of type 4 of entity 2 of dimension 3, which does not exist"),
        (NEW, "3 4 1 4", "3 5 1 4", "announces 5 elements and holds 4"),
        (NEW, "0 0 2 1", "0 0 90000000000 1", "ends before"),
        (NEW, "$Entities", "$PartitionedEntities\n$EndPartitionedEntities\n$Entities", "is a mesh in several parts"),
        (NEW, "0.5 0.25", "0" * 200 + " 0.25", "a number is too long"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(path, text, old, new, words):
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=words) as error:
        read_mesh(path)
    assert str(error.value).startswith(f"{path}: ")
    assert "\n" not in str(error.value)


def test_nodes_of_any_number_take_no_memory_for_those_between(path):
    path.write_text(OLD.replace("47", str(2**50)))
    assert read_mesh(path).mesh.cells["tetra"].tolist() == [[0, 1, 2, 3], [1, 2, 3, 4]]


def test_types_of_elements_are_those_of_meshio():
    meshio = pytest.importorskip("meshio.gmsh.common", reason="meshio is not installed")
    from meshio._common import num_nodes_per_cell

    from bspline_mdao.grids.io.meshes.gmsh_elements import KINDS

    for kind, (_, _, numbers) in KINDS.items():
        for number, n in numbers.items():
            if number in meshio._gmsh_to_meshio_type:  # it knows no incomplete ones
                name = meshio._gmsh_to_meshio_type[number]
                assert (name.rstrip("0123456789"), num_nodes_per_cell[name]) == (kind, n)
