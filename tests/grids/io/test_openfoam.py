"""Grids for OpenFOAM: order, closed cells, patches, collapsed faces, and what OpenFOAM itself says of them."""

import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from topology_cases import box, c_grid, grid_of, o_grid, patch, smooth_box, sphere_octants, split, turned_and_shuffled

from bspline_mdao import InputError, find_topology, fit_grid, write_grid
from bspline_mdao.files import CaseField, read_mesh, write_case, write_polymesh
from bspline_mdao.generators import ball_grid, flat_plate_grid, onera_m6_grid
from bspline_mdao.grids.cells.hexahedron import cell_quality
from bspline_mdao.grids.cells.mesh_quality import mesh_quality
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.studio.cli.main import run

PROGRAM = shutil.which("checkMesh")
SETTINGS = {
    "controlDict": "deltaT 1; endTime 1; writeInterval 1;",
    "fvSchemes": " ".join(f"{part}Schemes {{}}" for part in ("grad", "div", "laplacian", "interpolation", "snGrad")),
    "fvSolution": "",
}


def turned_box():
    """Eight curved blocks in random order, turned at random, left-handed ones among them."""
    grid, _ = turned_and_shuffled(grid_of(*split(smooth_box(6, 7, 8), [2], [4], [3])), np.random.default_rng(3))
    return grid


def rounded_wedge():
    """One cell about an axis in 4-byte reals: its two sides meet there but for the last bit."""
    angle, radius, along = np.ix_([-0.1, 0.1], np.linspace(0.0, 1.0, 6), np.linspace(0.0, 2.0, 4))
    wedge = np.stack(np.broadcast_arrays(radius * np.cos(angle), radius * np.sin(angle), along), axis=-1)
    wedge = (wedge + [1.0, 2.0, 3.0]).astype(np.float32)
    wedge[1, 0] = np.nextafter(wedge[1, 0], np.float32(9.0))
    return grid_of(wedge)


CASES = {
    "wing": lambda: onera_m6_grid((9, 9, 7)),
    "plate": lambda: flat_plate_grid((7, 8, 9)),
    "ball": lambda: ball_grid((4, 5, 6, 5), off_wall=0.1),
    "turned": turned_box,
    "poles": lambda: grid_of(*sphere_octants()),
    "wedge": rounded_wedge,
    "axis": lambda: grid_of(o_grid(radius=0.0)),
    "around": lambda: grid_of(o_grid()),
    "fold": lambda: grid_of(c_grid(span=2)),
}
COLLAPSED = ("poles", "wedge", "axis")


@dataclass
class Mesh:
    """A mesh as it is in the files."""

    points: np.ndarray
    faces: list[list[int]]
    owner: np.ndarray
    neighbour: np.ndarray
    boundary: dict[str, tuple[str, int, int]]

    @property
    def sides(self):
        """Faces, cells beside them, and whether the area vector points out of these (1) or into them (-1)."""
        n, inner = len(self.owner), len(self.neighbour)
        faces, cells = np.concatenate([np.arange(n), np.arange(inner)]), np.append(self.owner, self.neighbour)
        return faces, cells, np.append(np.ones(n), -np.ones(inner))

    def areas(self):
        """Area vector of every face, by triangles from its first corner."""
        fans = [self.points[face[1:]] - self.points[face[0]] for face in self.faces]
        return np.array([0.5 * np.cross(fan[:-1], fan[1:]).sum(axis=0) for fan in fans])

    def sums(self, values):
        """Sum of what leaves each cell through its faces."""
        faces, cells, signs = self.sides
        total = np.zeros((self.owner.max() + 1, values.shape[1]))
        np.add.at(total, cells, signs[:, None] * values[faces])
        return total


def entries(file):
    """Text between the outer parentheses of a list, after its head, and the length that is given."""
    text = file.read_text()
    match = re.search(r"\}\s*(\d+)\s*\((.*)\)\s*$", text, re.DOTALL)
    return match[2], int(match[1])


def numbers(file, n_columns, kind):
    text, n = entries(file)
    values = np.array(re.sub(r"[()]", " ", text).split(), dtype=kind).reshape(-1, n_columns)
    assert len(values) == n
    return values


def read(folder):
    text, n_faces = entries(folder / "faces")
    lines = text.split("\n")[1:-1]
    assert len(lines) == n_faces
    faces = [[int(word) for word in line[2:-1].split()] for line in lines]
    assert [int(line[0]) for line in lines] == [len(face) for face in faces]
    text, n_patches = entries(folder / "boundary")
    pattern = r"(\S+)\s*\{\s*type (\w+);\s*nFaces (\d+);\s*startFace (\d+);\s*\}"
    found = re.findall(pattern, text)
    assert len(found) == n_patches
    return Mesh(
        numbers(folder / "points", 3, float),
        faces,
        numbers(folder / "owner", 1, int).ravel(),
        numbers(folder / "neighbour", 1, int).ravel(),
        {name: (kind, int(n), int(start)) for name, kind, n, start in found},
    )


@pytest.fixture(scope="module")
def meshes(tmp_path_factory):
    """Folder, grid and mesh of every case."""
    made = {}
    for name, case in CASES.items():
        folder, grid = tmp_path_factory.mktemp(name) / "constant" / "polyMesh", case()
        write_grid(folder, grid)
        made[name] = folder, grid, read(folder)
    return made


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_faces_are_in_the_order_of_openfoam(meshes, case):
    _, _, mesh = meshes[case]
    inner = mesh.owner[: len(mesh.neighbour)]
    assert np.all(inner < mesh.neighbour)
    pairs = list(zip(inner.tolist(), mesh.neighbour.tolist()))
    assert pairs == sorted(pairs)
    starts = len(mesh.neighbour)
    for _, n_faces, start in mesh.boundary.values():
        assert start == starts
        starts += n_faces
    assert starts == len(mesh.faces)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_every_cell_is_closed_and_has_its_volume(meshes, case):
    _, grid, mesh = meshes[case]
    areas, centres = mesh.areas(), np.array([mesh.points[face].mean(axis=0) for face in mesh.faces])
    size = np.abs(areas).max()
    np.testing.assert_allclose(mesh.sums(areas), 0.0, atol=1e-13 * size)
    expected = np.concatenate([np.abs(cell_quality(block.nodes).volume).ravel() for block in grid.blocks])
    volumes = mesh.sums((centres * areas).sum(axis=1)[:, None] / 3.0).ravel()
    np.testing.assert_allclose(volumes, expected, rtol=0.2, atol=1e-12 * expected.max())
    assert np.all(volumes > 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_no_point_is_idle_and_no_face_without_area(meshes, case):
    _, _, mesh = meshes[case]
    assert set(np.concatenate(mesh.faces).tolist()) == set(range(len(mesh.points)))
    assert all(len(set(face)) == len(face) >= 3 for face in mesh.faces)
    assert np.linalg.norm(mesh.areas(), axis=1).min() > 1e-12
    has_triangles = any(len(face) == 3 for face in mesh.faces)
    assert has_triangles == (case in COLLAPSED)


@pytest.mark.slow
@pytest.mark.parametrize("case", [case for case in CASES if case not in ("plate", "fold")])
def test_a_shared_point_is_written_once(meshes, case):
    _, _, mesh = meshes[case]
    rounded = np.unique(np.round(mesh.points, 6) + 0.0, axis=0)
    assert len(rounded) == len(mesh.points)


@pytest.mark.slow
def test_patches_keep_their_names_and_get_their_types(meshes):
    _, _, wing = meshes["wing"]
    types = {"wing_upper": "wall", "wing_lower": "wall", "symmetry": "symmetry", "farfield": "patch"}
    assert {name: kind for name, (kind, _, _) in wing.boundary.items()} == types
    assert wing.boundary["wing_upper"][1] == 8 * 6
    assert set(meshes["turned"][2].boundary) == {"unassigned"}


@pytest.mark.slow
def test_the_two_sides_of_a_plate_stay_apart(meshes):
    _, grid, mesh = meshes["plate"]
    n_inner = sum(3 * n * m * k - n * m - m * k - k * n for n, m, k in (np.array(shape) - 1 for shape in grid.shapes))
    topology = find_topology(grid)
    n_between = sum(np.prod([max(n - 1, 1) for n in pair.a.shape]) for pair in topology.interfaces)
    assert len(mesh.neighbour) == n_inner + n_between
    assert mesh.boundary["wing_upper"][1] == mesh.boundary["wing_lower"][1] == 6 * 8


@pytest.mark.slow
def test_the_topology_of_the_baseline_keeps_a_plate_open(tmp_path):
    grid = flat_plate_grid((5, 5, 5))
    bare = grid_of(*(block.nodes for block in grid.blocks))
    write_polymesh(tmp_path / "kept", bare, find_topology(grid))
    write_polymesh(tmp_path / "found", bare)
    assert "wing_upper" in read(tmp_path / "kept").boundary
    assert set(read(tmp_path / "found").boundary) == {"unassigned"}


def test_points_come_back_to_the_last_bit(tmp_path):
    nodes = smooth_box(4, 5, 6)
    write_polymesh(tmp_path / "polyMesh", grid_of(nodes))
    written = {tuple(point) for point in read(tmp_path / "polyMesh").points}
    assert written == {tuple(point) for point in nodes.reshape(-1, 3)}


def test_names_are_made_fit_for_openfoam_and_must_stay_apart(tmp_path):
    face, other = (Window.whole(0, (4, 5, 6)).face(number) for number in (0, 1))
    boxed = smooth_box(4, 5, 6)
    write_polymesh(tmp_path / "polyMesh", grid_of(boxed, patches=[patch("wall", face, name="upper side")]))
    assert set(read(tmp_path / "polyMesh").boundary) == {"upper_side", "unassigned"}
    alike = [patch("wall", face, name="a b"), patch("wall", other, name="a_b")]
    with pytest.raises(InputError, match=r"patch a b: another patch is 'a_b' to OpenFOAM"):
        write_polymesh(tmp_path / "other", grid_of(boxed, patches=alike))
    assert not (tmp_path / "other").exists()


def test_nothing_is_half_written(tmp_path):
    folder = tmp_path / "polyMesh"
    (folder / "neighbour").mkdir(parents=True)
    (folder / "points").write_text("as it was")
    with pytest.raises(InputError, match="neighbour: is a folder, not a file"):
        write_polymesh(folder, grid_of(smooth_box(4, 5, 6)))
    assert sorted(os.listdir(folder)) == ["neighbour", "points"]
    assert (folder / "points").read_text() == "as it was"
    with pytest.raises(InputError, match="cannot be written"):
        write_polymesh(folder / "points" / "polyMesh", grid_of(smooth_box(4, 5, 6)))


@pytest.mark.slow
def test_the_command_line_writes_for_openfoam_twice_over(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    fit_grid(onera_m6_grid((9, 9, 9))).save("m6.h5")
    Path("case/constant").mkdir(parents=True)
    for factor, n_cells in ((1, 12 * 8**3), (0.5, 12 * 4**3)):
        assert run(["refine", "m6.h5", "--factor", str(factor), "-o", "case/constant/polyMesh", "--overwrite"]) == 0
        mesh = read(Path("case/constant/polyMesh"))
        assert mesh.owner.max() + 1 == n_cells
        assert set(mesh.boundary) == {"wing_upper", "wing_lower", "symmetry", "farfield"}


CONDITIONS = {"wall": "type slip;", "symmetry": "type symmetry;", "other": "type fixedValue; value uniform (1 0 0);"}


@pytest.mark.slow
def test_a_case_has_its_mesh_fields_and_settings(tmp_path):
    fields = {
        "U": CaseField("[0 1 -1 0 0 0 0]", (1.0, 0.5, 0.0), CONDITIONS),
        "p": CaseField("[0 2 -2 0 0 0 0]", 2.5, {"other": "type zeroGradient;"}),
    }
    settings = {"system/controlDict": "endTime 1;\n", "constant/turbulenceProperties": "simulationType laminar;\n"}
    write_case(tmp_path / "case", onera_m6_grid((5, 6, 7)), fields, settings)
    mesh = read(tmp_path / "case" / "constant" / "polyMesh")
    velocity, pressure = ((tmp_path / "case" / "0" / name).read_text() for name in "Up")
    assert velocity.startswith("FoamFile { version 2.0; format ascii; class volVectorField; object U; }\n")
    assert "dimensions [0 1 -1 0 0 0 0];\ninternalField uniform (1.0 0.5 0.0);\n" in velocity
    assert "internalField uniform 2.5;" in pressure
    kinds = {"wing_upper": "wall", "wing_lower": "wall", "symmetry": "symmetry", "farfield": "other"}
    assert set(mesh.boundary) == set(kinds)
    for name, kind in kinds.items():
        assert f"{name} {{ {CONDITIONS[kind]} }}\n" in velocity
        assert f"{name} {{ type zeroGradient; }}\n" in pressure
    for place, text in settings.items():
        head = f"FoamFile {{ version 2.0; format ascii; class dictionary; object {Path(place).name}; }}\n"
        assert (tmp_path / "case" / place).read_text() == head + text


@pytest.mark.slow
@pytest.mark.parametrize(
    ("field", "settings", "message"),
    [
        (
            CaseField("[]", 1.0, {"wall": "type slip;"}),
            {},
            "no condition for patch 'symmetry' of kind symmetry; add it",
        ),
        (CaseField("[]", (1.0, 2.0), CONDITIONS), {}, r"'U' has a value of shape \(2,\); give a number or three"),
        (CaseField("[]", 1.0, CONDITIONS), {"controlDict": ""}, "'controlDict' is no place in a case"),
        (CaseField("[]", 1.0, CONDITIONS), {"../controlDict": ""}, "is no place in a case"),
    ],
)
def test_a_case_that_cannot_be_is_refused_and_nothing_is_written(tmp_path, field, settings, message):
    with pytest.raises(InputError, match=message):
        write_case(tmp_path / "case", onera_m6_grid((5, 6, 7)), {"U": field}, settings)
    assert not (tmp_path / "case").exists()


def check_mesh(case):
    """What OpenFOAM says of a case."""
    (case / "system").mkdir()
    for name, text in SETTINGS.items():
        (case / "system" / name).write_text(
            f"FoamFile {{ version 2.0; format ascii; class dictionary; object {name}; }}\n{text}\n"
        )
    environment = {"WM_PROJECT_DIR": "/usr/share/openfoam", **os.environ}
    return subprocess.run([PROGRAM, "-case", case], env=environment, capture_output=True, text=True, check=True).stdout


@pytest.mark.skipif(PROGRAM is None, reason="OpenFOAM is not installed: its checkMesh is not run")
@pytest.mark.parametrize("case", CASES)
def test_openfoam_finds_topology_and_geometry_of_the_mesh_right(meshes, case):
    folder, _, mesh = meshes[case]
    report = check_mesh(folder.parents[1])
    for line in ("Boundary definition", "Cell to face addressing", "Point usage", "Face vertices"):
        assert f"{line} OK." in report
    assert "Number of regions: 1 (OK)." in report
    assert "Face pyramids OK." in report
    assert "Cell volumes OK." in report
    assert f"cells:            {mesh.owner.max() + 1}\n" in report
    assert "Upper triangular ordering OK." in report
    found = mesh_quality(read_mesh(folder).mesh)
    printed = re.search(r"non-orthogonality Max: (\S+) average: (\S+)", report)
    angles = found.angles.max(initial=0.0), found.mean_angle
    assert angles == pytest.approx([float(word) for word in printed.groups()], rel=1e-5, abs=1e-4)  # 1 - cos is rounded
    assert f"Max skewness = {found.skewness.max():.6g} OK." in report
    assert f"Min volume = {found.volumes.min():.6g}. Max volume = {found.volumes.max():.6g}." in report
    assert (found.n_beyond, found.n_skewed, found.n_wrong_faces) == (0, 0, 0)


def test_cells_with_negative_volumes_are_refused_with_their_number_and_the_worst(tmp_path):
    grid = grid_of(box(np.arange(5.0), np.arange(4.0), np.arange(3.0)))
    nodes = grid.blocks[0].nodes.copy()
    nodes[2, 1:3, 1] += [2.5, 0.0, 0.0]  # behind the nodes that follow
    with pytest.raises(
        InputError, match=r"\d+ of 24 cells have negative volumes, the worst -[\d.]+ m\^3 in block 1, cell"
    ):
        write_polymesh(tmp_path / "polyMesh", grid_of(nodes))
    assert not (tmp_path / "polyMesh").exists()
