"""Patches from TOML and neutral map files, and the draft of one."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from grid_cases import smooth_grid

from bspline_mdao.errors import InputError
from bspline_mdao.grids.io.files import read_grid, write_grid
from bspline_mdao.grids.io.patch_guess import draft_patches, guess_patches, with_guessed_patches
from bspline_mdao.grids.io.patches import read_patches
from bspline_mdao.grids.topology.detection import find_topology
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import FACE_NAMES, Window

WING = """
[[patch]]
name = "wing"     # a comment
kind = "wall"
faces = [
    { block = 1, face = "kmin" },
    { block = "tip", face = "jmax", i = [2, 6], k = [1, 3] },
]
"""


def named_grid():
    grid = smooth_grid()
    return replace(grid, blocks=(grid.blocks[0], replace(grid.blocks[1], name="tip")))


def read_text(tmp_path, text, grid=None):
    (tmp_path / "patches").write_text(text)
    return read_patches(tmp_path / "patches", grid or named_grid()).patches


def refusal(tmp_path, text, grid=None):
    with pytest.raises(InputError) as caught:
        read_text(tmp_path, text, grid)
    message = str(caught.value)
    assert "\n" not in message
    assert str(tmp_path) in message
    return message


def test_faces_are_named_by_block_number_or_name_and_ranges_count_from_one(tmp_path):
    (patch,) = read_text(tmp_path, WING)
    assert patch == Patch("wing", "wall", (Window(0, (0, 0, 0), (3, 4, 0)), Window(1, (1, 3, 0), (5, 3, 2))))


def test_patch_of_the_same_name_takes_the_place_of_the_grids(tmp_path):
    grid = named_grid()
    window = Window.whole(0, grid.shapes[0]).face(4)
    old, other = Patch("wing", "other", (window,)), Patch("rim", "farfield", (Window.whole(0, (4, 5, 6)).face(1),))
    patches = read_text(tmp_path, WING, replace(grid, patches=(old, other)))
    assert [(patch.name, patch.kind) for patch in patches] == [("wing", "wall"), ("rim", "farfield")]


def test_kinds_of_patches_from_elsewhere_are_declared_by_pattern(tmp_path):
    grid = named_grid()
    whole = Window.whole(0, grid.shapes[0])
    declared = tuple(Patch(f"F{face}", "other", (whole.face(face),)) for face in range(3))
    text = '[kinds]\nF0 = "interface"\n"F[12]" = "symmetry"\n'
    patches = read_text(tmp_path, text, replace(grid, patches=declared))
    assert [(patch.name, patch.kind) for patch in patches] == [("F1", "symmetry"), ("F2", "symmetry")]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("kmin", "kmim", "'kmim' is not a face; write one of imin"),
        ("block = 1", "block = 3", "block 3 is not in the grid"),
        ("block = 1", "block = 0", "block 0 is not in the grid"),
        ("block = 1", "block = true", "block True is not in the grid"),
        ('"tip"', '"tap"', "block 'tap' is not in the grid"),
        ("[2, 6]", "[2, 7]", "i = [2, 7] is no range of nodes; write [first, last] within 1 to 6"),
        ("[2, 6]", "[0, 6]", "within 1 to 6"),
        ("[2, 6]", "[6, 2]", "no range"),
        ("[2, 6]", "[3, 3]", "no range"),
        ("[2, 6]", "[1.5, 3]", "no range"),
        ("[2, 6]", "5", "no range"),
        ("i = [2, 6]", "j = [1, 2]", "jmax has no range in j"),
        ("kind =", "knid =", "key 'knid' is not known; the keys are faces, kind, name"),
        ("k = [1, 3]", "range = 1", "key 'range' is not known"),
        ('"wall"', '"wal"', "kind 'wal' is not one of wall, symmetry, farfield, overset, other"),
        ('"wall"', "3", "kind 3 is not one of"),
        ('name = "wing"', "", "patch 1 has no name"),
        ("[[patch]]", "[patch]", "double brackets"),
        ("[[patch]]", "[[patches]]", "key 'patches' is not known"),
        ("[[patch]]", "[[patch]", "is not TOML"),
        ('block = "tip", face = "jmax", i', 'block = 1, face = "kmin", i', "no range"),
        ('{ block = "tip", face = "jmax", i = [2, 6], k = [1, 3] }', '{ block = 1, face = "kmin" }', "twice"),
        ("[[patch]]", "include = 3\n[[patch]]", "'include' is not"),
        ("[[patch]]", 'include = "none"\n[[patch]]', "cannot be read"),
        ("[[patch]]", '[kinds]\nwimg = "wall"\n[[patch]]', "no patch is named 'wimg'"),
        ("[[patch]]", '[kinds]\nwing = "wool"\n[[patch]]', "'wool' is not one of"),
    ],
)
def test_mistake_in_toml_is_named_in_one_line(tmp_path, old, new, said):
    assert old in WING
    assert said in refusal(tmp_path, WING.replace(old, new))


def test_two_patches_that_share_part_of_a_face_are_refused(tmp_path):
    second = WING.replace("wing", "plate").replace('"tip", face = "jmax", i = [2, 6]', '2, face = "jmax", i = [1, 3]')
    second = second.replace('{ block = 1, face = "kmin" },', "")
    assert "patches 'wing' and 'plate' both claim part of a face of tip" in refusal(tmp_path, WING + second)
    neighbour = second.replace("[1, 3]", "[1, 2]", 1)
    assert len(read_text(tmp_path, WING + neighbour)) == 2


def test_faces_that_meet_at_an_edge_do_not_overlap(tmp_path):
    faces = "".join(f'{{ block = 1, face = "{name}" }}, ' for name in FACE_NAMES)
    (patch,) = read_text(tmp_path, f'[[patch]]\nname = "all"\nkind = "wall"\nfaces = [{faces}]')
    assert len(patch.windows) == 6


def two_boxes():
    """Two unit boxes side by side; the j of the first runs against the k of the second."""
    x, y, z = np.meshgrid(np.linspace(0, 1, 4), np.linspace(0, 1, 5), np.linspace(0, 1, 6), indexing="ij")
    left = np.stack([x, y, z], axis=-1)
    right = left.copy()
    right[..., 0] += 1.0
    turned = right.transpose(0, 2, 1, 3)[:, :, ::-1]
    return Grid((Block(left, "block 1"), Block(np.ascontiguousarray(turned), "block 2")))


NMF = """# Neutral map file \\
 2 \\
 1  4 5 6
 2  4 6 5
# types \\
'one-to-one'  1 4  1 5  1 6   2 3  1 6  5 1  TRUE
SYMMETRY-Y    1 5  1 6  1 4
'far away'    2 4  6 1  1 5
'B1'          1 1  1 4  1 5
viscous       1 6  2 4  1 3   # comment
"""


def test_neutral_map_file_gives_patches_in_cyclic_face_directions(tmp_path):
    assert read_text(tmp_path, NMF, two_boxes()) == (
        Patch("SYMMETRY-Y", "symmetry", (Window(0, (0, 0, 0), (3, 0, 5)),)),
        Patch("far away", "farfield", (Window(1, (3, 0, 0), (3, 5, 4)),)),
        Patch("B1", "other", (Window(0, (0, 0, 0), (3, 4, 0)),)),
        Patch("viscous", "wall", (Window(0, (0, 4, 1), (2, 4, 3)),)),
    )


def test_swap_behind_one_side_of_a_neutral_map_says_nothing(tmp_path):
    lines = NMF.split("\n")
    lines[6:9] = [f"{line}  {word}" for line, word in zip(lines[6:9], ("FALSE", "'true'", ".F."))]
    assert read_text(tmp_path, "\n".join(lines), two_boxes()) == read_text(tmp_path, NMF, two_boxes())


def test_blocks_of_a_neutral_map_that_are_all_numbered_1_are_known_by_their_place(tmp_path):
    text = NMF.replace(" 2  4 6 5", " 1  4 6 5")
    assert read_text(tmp_path, text, two_boxes()) == read_text(tmp_path, NMF, two_boxes())
    swapped = NMF.replace(" 1  4 5 6\n 2  4 6 5", " 1  4 6 5\n 1  4 5 6")
    assert "line 3: '1  4 6 5' is not 'block ni nj nk' = 1 (4, 5, 6)" in refusal(tmp_path, swapped, two_boxes())


def test_connection_that_has_a_name_of_its_own_is_left_to_the_topology(tmp_path):
    text = NMF.replace("'one-to-one'  1 4  1 5  1 6   2 3  1 6  5 1  TRUE", "'A' 1 4 1 5 1 6\n'C' 2 3 1 6 1 5")
    topology = find_topology(replace(two_boxes(), patches=read_text(tmp_path, text, two_boxes())))
    assert len(topology.interfaces) == 1
    assert {face.patch for face in topology.boundary} == {None, "SYMMETRY-Y", "far away", "B1", "viscous"}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (" 2 \\\n", " 3 \\\n", "describes 3 blocks, the grid has 2"),
        ("1  4 5 6", "1  4 5 7", "line 3: '1  4 5 7' is not 'block ni nj nk' = 1 (4, 5, 6)"),
        ("5 1  TRUE", "5 1  FALSE", "joins (5, 6) nodes to (6, 5)"),
        ("5 1  TRUE", "1 5  TRUE", "the two sides are up to 1 apart"),
        ("5 1  TRUE", "5 1  MAYBE", "swap is 'MAYBE'"),
        ("2 3  1 6", "2 7  1 6", "there is no face 7 of block 2"),
        ("1 5  1 6  1 4", "1 5  1 6  1 5", "1 to 5 is no range of i of block 1, 1 to 4"),
        ("1 5  1 6  1 4", "1 5  1 6  1", "is not 'type B1 F1 S1 E1 S2 E2'"),
        ("1 5  1 6  1 4", "1 5  1 6  1 x", "line 7: 'SYMMETRY-Y"),
        ("2 3  1 6  5 1  TRUE", "", "names one side of a connection"),
        ("2 3  1 6  5 1  TRUE", "TRUE", "names one side of a connection"),
        ("1 5  1 6  1 4", "1 5  1 6  1 4  7", "swap is '7'"),
        ("2  4 6 5", "3  4 6 5", "line 4: '3  4 6 5' is not 'block ni nj nk' = 2 (4, 6, 5)"),
    ],
)
def test_mistake_in_neutral_map_is_named_in_one_line(tmp_path, old, new, said):
    assert old in NMF
    assert said in refusal(tmp_path, NMF.replace(old, new), two_boxes())


def test_toml_may_include_a_neutral_map_and_say_what_its_names_mean(tmp_path):
    (tmp_path / "map.nmf").write_text(NMF)
    text = 'include = "map.nmf"\n[kinds]\n"B*" = "wall"\nviscous = "interface"\n'
    patches = read_text(tmp_path, text, two_boxes())
    assert [(patch.name, patch.kind) for patch in patches][2:] == [("B1", "wall")]


def test_published_neutral_map_is_read(real_grids, tmp_path):
    path = real_grids.parent / "geometry" / "example.nmf"
    if not path.exists():
        pytest.skip("no example.nmf beside the real grids")
    shapes = [(25, 49, 33), (73, 49, 33), (73, 49, 33), (25, 49, 33)]
    patches = read_patches(path, smooth_grid(shapes)).patches
    assert len(patches) == 24
    assert patches[0] == Patch("symm1", "symmetry", (Window(0, (0, 0, 0), (24, 48, 0)),))
    assert patches[10] == Patch("bwing", "other", (Window(1, (0, 0, 0), (72, 0, 32)),))


def half_annulus():
    """A thick shell about a half cylinder on the plane y = 0, i around, j outwards, k along."""
    angle, radius, z = np.meshgrid(
        np.linspace(np.pi, 0, 13), np.geomspace(1, 30, 15), np.linspace(-1, 2, 7), indexing="ij"
    )
    nodes = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=-1)
    nodes[[0, -1], :, :, 1] = 0.0
    return Grid((Block(nodes, "shell"),), source="shell.xyz")


def test_guess_finds_symmetry_wall_and_far_field():
    grid = half_annulus()
    whole = Window.whole(0, grid.shapes[0])
    patches = guess_patches(grid, [whole.face(face) for face in range(4)])
    assert patches == (
        Patch("symmetry_y", "symmetry", (whole.face(0), whole.face(1))),
        Patch("wall", "wall", (whole.face(2),)),
        Patch("farfield", "farfield", (whole.face(3),)),
    )


def test_what_is_declared_stays_and_the_rest_is_guessed():
    grid = half_annulus()
    body = Patch("body", "wall", (Window.whole(0, grid.shapes[0]).face(2),))
    guessed = with_guessed_patches(replace(grid, patches=(body,)))
    assert guessed.patches[0] == body
    windows = [window for patch in guessed.patches for window in patch.windows]
    assert len(windows) == len(set(windows)) == 6
    assert with_guessed_patches(guessed) is guessed


def test_sides_of_a_grid_one_cell_deep_are_symmetry_planes():
    grid = half_annulus()
    thin = replace(grid, blocks=(replace(grid.blocks[0], nodes=grid.blocks[0].nodes[:, :, :2]),))
    whole = Window.whole(0, thin.shapes[0])
    assert guess_patches(thin, [whole.face(4), whole.face(5)])[0].name == "symmetry_z"


def test_draft_reads_back_as_the_same_patches(tmp_path):
    grid = named_grid()
    patches = (
        Patch('odd "name" # = [', "wall", (Window(0, (0, 0, 0), (3, 4, 0)), Window(1, (1, 3, 0), (5, 3, 2)))),
        Patch("rim", "farfield", (Window(1, (5, 0, 0), (5, 3, 4)),)),
    )
    text = draft_patches(grid, patches)
    assert text.startswith("# Patches of grid: a draft")
    assert read_text(tmp_path, text, grid) == patches
    assert read_text(tmp_path, draft_patches(grid, ()), grid) == ()


def test_grid_is_read_by_content_and_written_by_dialect_or_name(tmp_path):
    grid = smooth_grid()
    (tmp_path / "patches.toml").write_text(WING.replace('"tip"', "2"))
    for name in ("a.fmt", "a.xyz", "a.fmt.gz", "a.cgns"):
        write_grid(tmp_path / name, grid)
        disguised = Path(tmp_path / name).rename(tmp_path / "disguised.dat")
        read = read_grid(disguised, tmp_path / "patches.toml")
        assert (read.shapes, read.patches[0].name) == (grid.shapes, "wing")
        if name != "a.cgns":
            write_grid(tmp_path / "again", read)
            assert (tmp_path / "again").read_bytes() == disguised.read_bytes()
    write_grid(tmp_path / "a.vtm", grid)
    assert (tmp_path / "a" / "0002.vts").exists()
    (tmp_path / "adf").write_bytes(b"\xc0\xa8\xa3\xa9ADF Database Version A02012>" + bytes(500))
    with pytest.raises(InputError, match="in ADF of version"):
        read_grid(tmp_path / "adf")


def test_a_name_that_promises_another_format_is_refused(tmp_path):
    for name in ("a.vtk", "a.VTS", "a.h5"):
        with pytest.raises(InputError, match=r"name it \.vtm"):
            write_grid(tmp_path / name, smooth_grid())
    assert not list(tmp_path.iterdir())
