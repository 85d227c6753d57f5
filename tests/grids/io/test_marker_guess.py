"""What markers of meshes without structure are taken for, and how they are declared."""

import re

import numpy as np
import pytest
from mesh_cases import sector_mesh
from riding_cases import corners_of, mesh, plane_su2_text

from bspline_mdao import InputError
from bspline_mdao.files import read_mesh, write_polymesh
from bspline_mdao.generators import brick_grid
from bspline_mdao.grids.io.marker_guess import contradicting_guesses, kind_of_words
from bspline_mdao.grids.io.marker_kinds import draft_kinds, undecided
from bspline_mdao.meshes import MarkerGuess, MixedMesh, guess_kinds, marker_kinds, read_kinds, with_markers


def box(n=(6, 5, 4), hole=None, stretched=1.0):
    """A box of cells, without those in a hole, and its skin by sides ``a`` to ``f``, the hole as ``g``."""
    axes = [np.linspace(-1.0, 1.0, k + 1) for k in n]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) * [3.0 * stretched, 2.0, 1.0]
    cells = corners_of(np.arange(len(points)).reshape([k + 1 for k in n]))
    middles = points[cells].mean(axis=1)
    if hole is not None:
        cells = cells[(np.abs(middles) > hole).any(axis=1)]
    used, numbers = np.unique(cells, return_inverse=True)
    points, cells = points[used], numbers.reshape(cells.shape)
    skin = MixedMesh(points, {"hexahedron": cells}).skin
    markers = {}
    for axis in range(3):
        for name, end in zip(["ab", "cd", "ef"][axis], (points[:, axis].min(), points[:, axis].max())):
            markers[name] = skin[(points[skin][:, :, axis] == end).all(axis=1)]
    of_sides = np.concatenate([np.sort(faces, axis=1) for faces in markers.values()])
    rest = skin[[not (np.sort(face) == of_sides).all(axis=1).any() for face in skin]]
    return MixedMesh(points, {"hexahedron": cells}, markers | ({"g": rest} if len(rest) else {}))


def renamed(original, **names):
    """The mesh with markers of other names."""
    markers = {names.get(name, name): faces for name, faces in original.markers.items()}
    return MixedMesh(original.points, original.cells, markers)


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        (
            "wall",
            ["wall", "AIRFOIL", "lower_wall", "upperWing", "HeatedWall", "wall1", "Blades", "blade-hub", "naca0012"],
        ),
        ("wall", ["CYLINDER_heated", "viscous", "noslip", "BC_WALL"]),
        ("symmetry", ["symmetry", "SYMM", "sym_plane", "Symmetry-y", "reflect"]),
        ("farfield", ["farfield", "FAR", "INLET", "outlet_1", "inflow", "OutFlow", "in", "outer", "far_side"]),
        ("periodic", ["periodic1", "periodic_2", "cyclic_half0", "PER1"]),
        ("inner", ["domain_interface", "interior-fluid"]),
        ("other", ["x_m", "square", "internally", "inlet_wall", "outer_wing_wall", "marker", "7", ""]),
    ],
)
def test_words_of_names_say_what_they_say(kind, names):
    assert {name: kind_of_words(name) for name in names} == dict.fromkeys(names, kind)


def test_places_tell_the_wing_its_plane_and_the_far_field_without_names():
    guesses = guess_kinds(renamed(mesh(), wing="a", symmetry="b", far="c"))
    assert {name: guess.kind for name, guess in guesses.items()} == {"a": "wall", "b": "symmetry", "c": "farfield"}
    assert guesses["a"].sure == "sure"
    assert guesses["b"].sure == "likely"


def test_places_do_not_depend_on_unit_position_or_axes():
    turn, _ = np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))
    original = renamed(mesh(), wing="a", symmetry="b", far="c")
    other = MixedMesh(1e3 * (original.points @ turn) + [5.0, -70.0, 3.0], original.cells, original.markers)
    kinds = [{name: guess.kind for name, guess in guess_kinds(found).items()} for found in (original, other)]
    assert kinds[0] == kinds[1]


def test_of_two_dimensions_the_closed_line_inside_is_the_wall(tmp_path):
    path = tmp_path / "plane.su2"
    path.write_text(plane_su2_text().replace("airfoil", "one"))
    found = guess_kinds(read_mesh(path).mesh)
    assert found["one"].kind == "wall"


def test_a_body_inside_a_box_is_a_wall_and_the_sides_are_not():
    kinds = {name: guess.kind for name, guess in guess_kinds(box((12, 10, 8), 0.3)).items()}
    assert kinds.pop("g") == "wall"
    assert "wall" not in kinds.values()


def test_a_box_has_no_wall_that_can_be_told_and_the_message_says_what_to_declare():
    brick = box()
    guesses = guess_kinds(brick)
    assert {guess.kind for guess in guesses.values()} == {"other"}
    assert {guess.sure for guess in guesses.values()} == {"unsure"}
    message = undecided(brick, guesses)
    assert 'no marker looks like a wall; declare one, such as "NAME" = "wall" below [kinds]' in message
    assert "a, b, c, d, e, f" in message
    assert not undecided(mesh(), guess_kinds(mesh()))
    assert "has no markers" in undecided(brick, {})


def test_the_marker_that_is_proposed_as_a_wall_is_no_plane_side():
    brick = box()
    guesses = guess_kinds(brick) | {"d": MarkerGuess("other", "unsure", "near the middle")}
    assert 'declare one, such as "d" = "wall"' in undecided(brick, guesses)
    guesses["c"] = MarkerGuess("symmetry", "sure", "by its name")
    assert 'declare one, such as "d" = "wall"' in undecided(brick, guesses)


def test_a_declared_wall_tells_which_sides_are_symmetry(tmp_path):
    path = tmp_path / "kinds.toml"
    path.write_text('[kinds]\n"e" = "wall"\n')
    guesses = marker_kinds(box(), path)
    assert (guesses["e"].kind, guesses["e"].sure) == ("wall", "sure")
    assert [guesses[name].kind for name in "abcd"] == ["symmetry"] * 4
    assert guesses["f"].kind != "symmetry"


def test_a_wall_that_ends_in_a_side_at_another_angle_tells_nothing_of_it(tmp_path):
    path, brick = tmp_path / "kinds.toml", box()
    path.write_text('[kinds]\n"e" = "wall"\n')
    leaning = brick.points + np.outer(brick.points[:, 2], [0.7, 0.0, 0.0])
    guesses = marker_kinds(MixedMesh(leaning, brick.cells, brick.markers), path)
    assert [name for name, guess in guesses.items() if guess.kind == "symmetry"] == ["c", "d"]


def test_faces_with_cells_on_both_sides_are_inner_whatever_they_are_called():
    brick = box((4, 3, 2))
    middle = np.array([[0, 1, 4, 3]]) + 1 * 12  # any faces between cells
    faces = brick.cell_faces[0]
    shared = faces[(brick.points[faces][:, :, 0] == brick.points[faces[:, :1], 0]).all(axis=1)]
    shared = shared[np.abs(brick.points[shared][:, 0, 0]) < 3.0][: len(middle) + 2]
    markers = {"middle": shared, "wall": shared[:1], "lost": np.array([[0, 1, 2, 10]]), **brick.markers}
    guesses = guess_kinds(MixedMesh(brick.points, brick.cells, markers))
    assert (guesses["middle"].kind, guesses["middle"].sure) == ("inner", "sure")
    assert (guesses["wall"].kind, guesses["wall"].sure) == ("inner", "unsure")
    assert (guesses["lost"].kind, guesses["lost"].sure) == ("other", "unsure")


def test_a_curved_marker_is_no_symmetry_and_two_planes_may_be():
    bent = renamed(mesh(), wing="symmetry_1", symmetry="plane")
    assert guess_kinds(bent)["symmetry_1"].kind == "other"
    brick = box()
    markers = {"sym": np.concatenate([brick.markers["a"], brick.markers["b"], brick.markers["c"]])}
    assert guess_kinds(MixedMesh(brick.points, brick.cells, markers))["sym"].kind == "symmetry"


def test_types_of_openfoam_and_cgns_count_before_names(tmp_path):
    write_polymesh(tmp_path / "polyMesh", brick_grid((5, 5, 5, 5)))
    boundary = tmp_path / "polyMesh" / "boundary"
    found = guess_kinds(read_mesh(tmp_path / "polyMesh").mesh)
    assert found["body"].kind == "wall"
    assert found["body"].why == "its file says wall"
    boundary.write_text(boundary.read_text().replace("wall;", "symmetryPlane;"))
    read = read_mesh(tmp_path / "polyMesh").mesh
    assert read.stated["body"] == "symmetryPlane"
    assert guess_kinds(read)["body"].kind == "symmetry"
    brick = box()
    stated = MixedMesh(brick.points, brick.cells, brick.markers, stated={"a": "BCWallViscous", "c": "FamilySpecified"})
    assert guess_kinds(stated)["a"].why == "its file says BCWallViscous"
    assert guess_kinds(stated)["c"].kind == "symmetry"


def test_sides_that_a_rotation_lays_onto_each_other_are_periodic_whatever_they_are_called():
    sector = renamed(sector_mesh()[0], per_1="left", per_2="right")
    found = guess_kinds(sector)
    assert [found[name].kind for name in ("left", "right", "body")] == ["periodic", "periodic", "wall"]
    assert re.fullmatch(r"a rotation about .* by 28\.6479 deg maps it onto right", found["left"].why)
    assert found["left"].sure == "likely"


def test_sides_of_boxes_and_bodies_that_repeat_are_not_periodic():
    assert not {guess.kind for guess in guess_kinds(box(n=(4, 4, 4))).values()} & {"periodic"}
    whole = box(n=(8, 4, 4), hole=0.6)
    left = (whole.points[whole.markers["g"]].mean(axis=1)[:, 0] < 0.0).nonzero()[0]
    right = np.setdiff1d(np.arange(len(whole.markers["g"])), left)
    halves = {"h": whole.markers["g"][left], "k": whole.markers["g"][right]}
    assert len(left) == len(right) > 0
    found = guess_kinds(MixedMesh(whole.points, whole.cells, halves))
    assert not {guess.kind for guess in found.values()} & {"periodic"}


def test_a_mesh_without_markers_gets_those_of_its_sides_and_parts():
    bare = MixedMesh(mesh().points, mesh().cells)
    found = with_markers(bare)
    guesses = guess_kinds(found)
    walls = [name for name, guess in guesses.items() if guess.kind == "wall"]
    planes = [name for name, guess in guesses.items() if guess.kind == "symmetry"]
    assert planes == ["z_min"]
    (wall,) = walls
    np.testing.assert_array_equal(np.unique(found.markers[wall]), np.unique(mesh().markers["wing"]))
    assert sum(map(len, found.markers.values())) == len(bare.skin)
    assert with_markers(found) is found
    with_hole = box((12, 10, 8), 0.3)
    named = with_markers(MixedMesh(with_hole.points, with_hole.cells))
    assert list(named.markers) == ["x_min", "x_max", "y_min", "y_max", "z_min", "z_max", "part_1"]
    assert len(named.markers["part_1"]) == len(with_hole.markers["g"])


def test_a_plane_mesh_without_markers_gets_them_in_its_plane_alone(tmp_path):
    path = tmp_path / "plane.su2"
    path.write_text(plane_su2_text())
    read = read_mesh(path).mesh
    found = with_markers(MixedMesh(read.points, read.cells, n_copies=2))
    (wall,) = [name for name, guess in guess_kinds(found).items() if guess.kind == "wall"]
    np.testing.assert_array_equal(np.unique(found.markers[wall]), np.unique(read.markers["airfoil"]))
    assert not any(name.startswith("z") for name in found.markers)


def test_patterns_declare_and_a_draft_comes_back(tmp_path):
    path, brick = tmp_path / "kinds.toml", box()
    path.write_text('[kinds]\n"[ab]" = "symmetry"\n"*" = "wall"\n')
    assert read_kinds(path, brick) == {"a": "symmetry", "b": "symmetry", **dict.fromkeys("cdef", "wall")}
    odd = renamed(brick, a="w*", b="[x]", c='"q?')
    path.write_text(draft_kinds(odd, guess_kinds(odd)))
    assert read_kinds(path, odd) == {name: guess.kind for name, guess in guess_kinds(odd).items()}


@pytest.mark.parametrize(
    ("declared", "doubtful"),
    [
        ({"wing": "wall", "symmetry": "symmetry", "far": "farfield"}, ""),
        ({"wing": "other", "symmetry": "other", "far": "other"}, ""),
        ({"wing": "farfield", "symmetry": "periodic", "far": "sliding"}, ""),
        ({"symmetry": "wall"}, "symmetry"),
        ({"symmetry": "farfield"}, "symmetry"),
        ({"far": "symmetry"}, "far"),
        ({"far": "wall"}, "far"),
    ],
)
def test_declared_kinds_are_doubted_where_a_sure_guess_contradicts_them(declared, doubtful):
    assert " ".join(contradicting_guesses(mesh(), declared)) == doubtful


def test_declared_kinds_that_have_a_use_are_not_doubted_though_guesses_differ():
    brick = box()
    sides = renamed(brick, a="inlet", b="outer", c="slip_wall_sym", d="plane", e="sym")
    assert not contradicting_guesses(sides, {"inlet": "symmetry", "outer": "wall", "slip_wall_sym": "wall"})
    assert not contradicting_guesses(sides, {"plane": "wall", "sym": "symmetry", "f": "farfield"})
    near = renamed(mesh(), wing="farfield", far="a")  # a wing of a misleading name
    assert not contradicting_guesses(near, {"farfield": "wall", "a": "farfield"})
    casing = renamed(mesh(), far="outer")
    assert not contradicting_guesses(casing, {"outer": "wall"})
    floor = {"lower_wall": brick.markers["e"]}  # an inviscid wall
    slip = MixedMesh(brick.points, brick.cells, floor, stated={"lower_wall": "symmetryPlane"})
    assert not contradicting_guesses(slip, {"lower_wall": "wall"})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('[kinds]\n"wing" = "wall"\n', "no marker is called 'wing'; the markers are a, b, c, d, e, f"),
        ('[kinds]\na = "wal"\n', "'a' = 'wal' is not one of wall, symmetry, farfield, periodic, inner, sliding, other"),
        ('[kind]\na = "wall"\n', "key 'kind' is not known"),
        ('[[patch]]\nname = "a"\n', r'has faces of blocks, and mesh has markers; write \[kinds\] .* "a" = "wall"'),
        ("kinds = 3\n", "'kinds' is not a table"),
        ("kinds = [\n", "is not TOML"),
        ("6\n", "is a neutral map of a structured grid"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, text, words):
    path = tmp_path / "kinds.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=words) as error:
        read_kinds(path, box())
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)


REAL = {
    "centrifugal_blade": "farfield farfield wall wall periodic periodic",
    "mesh_RAE2822_turb": "wall farfield",
    "mesh_NACA0012_lam_hybrid_v2": "wall farfield",
    "mesh_square_turb_hybrid": "farfield farfield farfield wall farfield",
    "mesh_brick_prism_ffd": "other other other other other other",
    "rotating_cylinders": "farfield farfield farfield farfield inner inner inner wall inner",
    "transonic_stator_periodic": "farfield farfield wall periodic periodic",
}
"""What markers of meshes of other projects are, in their order."""


@pytest.mark.slow
@pytest.mark.parametrize("name", REAL)
def test_markers_of_real_meshes_are_told(real_mesh, name):
    assert [guess.kind for guess in guess_kinds(read_mesh(real_mesh(name)).mesh).values()] == REAL[name].split()
