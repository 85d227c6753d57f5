"""The commands ``inspect`` and ``quality`` of meshes without structure."""

import numpy as np
import pytest
from riding_cases import plane_mesh, plane_su2_text, write_plane_cgns
from test_cli import fails_as_expected, numbers

from bspline_mdao import write_grid
from bspline_mdao.files import read_mesh, write_polymesh
from bspline_mdao.generators import brick_grid
from bspline_mdao.grids.io.meshes.files import is_mesh
from bspline_mdao.studio.cli.main import run


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plane.su2").write_text(plane_su2_text())
    return tmp_path


def test_inspect_tells_cells_markers_box_and_heights_of_a_plane_mesh(workplace, capsys):
    points, triangles, quads, lines = plane_mesh()
    assert run(["inspect", "plane.su2", "--json", "i.json", "--units", "mm", "--reynolds", "1e6"]) == 0
    found, text = numbers("i.json"), capsys.readouterr().out
    assert (found["dimensions"], found["n_nodes"], found["units"]) == (2, len(points), "mm")
    assert found["cells"] == {"triangle": len(triangles), "quad": len(quads)}
    assert found["box"] == {"low": [*points.min(axis=0), 0.0], "high": [*points.max(axis=0), 0.0]}
    (marker,) = [marker for marker in found["markers"] if marker["name"] == "airfoil"]
    assert (marker["kind"], marker["sureness"], marker["n_faces"]) == ("wall", "sure", len(lines))
    (wall,) = found["walls"]
    off = np.linalg.norm(points[:, None] - points[np.unique(lines)], axis=2)
    off[np.unique(lines)] = np.inf  # heights are less than the distances along edges
    assert 0.5 * off.min() < wall["quantiles"]["min"] <= wall["quantiles"]["median"] <= wall["quantiles"]["max"]
    assert wall["quantiles"]["min"] == wall["height_min"]
    assert wall["y_plus"] > 0.0
    assert found["n_unmarked_faces"] == 70  # of the outer rim
    assert found["to_declare"] is None
    proved = f"all {len(triangles) + len(quads):,} cells valid: their Jacobian is proved positive everywhere in them"
    for words in (
        "2 dimensions, unit of length: mm",
        "airfoil",
        "walls that can move: airfoil",
        "and move along",
        proved,
    ):
        assert words in text


def test_inspect_of_a_mesh_without_a_wall_says_what_to_declare_and_its_draft_is_one(workplace, capsys):
    path = workplace / "plane.su2"
    lines = path.read_text().replace("MARKER_TAG= airfoil", "MARKER_TAG= one")
    path.write_text(lines)
    (workplace / "k.toml").write_text('[kinds]\n"o*" = "farfield"\n')
    assert run(["inspect", "plane.su2", "--patches", "k.toml", "--draft", "d.toml", "--json", "i.json"]) == 0
    assert 'declare one, such as "one" = "wall"' in numbers("i.json")["to_declare"]
    assert "warning: plane.su2: no marker looks like a wall" in "".join(capsys.readouterr()).replace("\n", " ")
    (workplace / "d.toml").write_text((workplace / "d.toml").read_text().replace("farfield", "wall", 2))
    assert 'one = "wall"' in (workplace / "d.toml").read_text()
    assert run(["inspect", "plane.su2", "--patches", "d.toml", "--json", "i.json"]) == 0
    assert numbers("i.json")["to_declare"] is None
    (workplace / "k.toml").write_text('[kinds]\n"two" = "wall"\n')
    fails_as_expected(
        ["inspect", "plane.su2", "--patches", "k.toml"], capsys, "no marker is called 'two'; the markers are one"
    )


def test_quality_names_cells_that_a_move_inverted_and_compares_heights(workplace, capsys):
    read, (points, _, _, lines) = read_mesh("plane.su2"), plane_mesh()
    moved = read.mesh.points.copy()
    wall = np.unique(lines)
    n = len(points)
    assert run(["quality", "plane.su2", "--json", "q.json"]) == 0
    found = numbers("q.json")
    assert (found["n_inverted"], found["newly_inverted"]) == (0, None)
    volumes = read.mesh.quality().volumes
    assert found["min_volume"] == pytest.approx(volumes.min(), rel=1e-12)
    assert 0.0 < found["non_orthogonality"]["average"] < found["non_orthogonality"]["max"] < 90.0
    moved[:, 0] *= 2.0
    moved[:, 1] *= 2.0
    out = int(np.setdiff1d(np.arange(n), wall)[40])
    moved[[out, out + n], :2] = points.max(axis=0) * 3.0  # one node flies off
    read.write("moved.su2", moved)
    assert run(["quality", "moved.su2", "--baseline", "plane.su2", "--json", "q.json"]) == 0
    found, text = numbers("q.json"), capsys.readouterr().out
    assert found["n_inverted"] == len(found["newly_inverted"]) > 0
    proved = {part["block"]: part["n_invalid"] for part in found["certificate"]["cells"]}
    assert set(proved) == {"triangle", "quad"}
    assert sum(proved.values()) >= found["n_inverted"]
    assert found["certificate"]["status"] == "invalid"
    assert 0 < found["orientation"]["n_faces"] <= found["orientation"]["n_pyramids"]
    (heights,) = found["heights"]
    assert heights["ratios"]["median"] == pytest.approx(2.0)
    assert "was valid on the baseline" in text
    assert found["newly_inverted"][0]["cell"].split()[0] in ("triangle", "quad")
    write_polymesh("polyMesh", brick_grid((4, 4, 4, 4)))
    fails_as_expected(["quality", "moved.su2", "--baseline", "polyMesh"], capsys, "give the mesh that was moved")


def test_sizes_of_cells_are_areas_in_a_plane_and_have_the_unit_that_is_said(workplace, capsys):
    for command in ("inspect", "quality"):
        assert run([command, "plane.su2", "--units", "mm"]) == 0
        text = capsys.readouterr().out
        assert "smallest area" in text
        assert "mm^2" in text
        assert "min (mm)" in text


def test_a_mesh_is_compared_with_the_model_from_which_it_was_moved(workplace, capsys):
    # no wall by its name: the model knows what was declared
    (workplace / "plane.su2").write_text(plane_su2_text().replace("MARKER_TAG= airfoil", "MARKER_TAG= farfield"))
    (workplace / "k.toml").write_text('[kinds]\nfarfield = "wall"\n')
    assert run(["fit", "plane.su2", "--patches", "k.toml", "--units", "mm", "-o", "m.h5"]) == 0
    assert run(["move", "m.h5", "--deform", "translate=0.01/0/0", "-o", "moved.su2"]) == 0
    assert run(["quality", "moved.su2", "--baseline", "plane.su2", "--patches", "k.toml", "--json", "a.json"]) == 0
    capsys.readouterr()
    assert run(["quality", "moved.su2", "--baseline", "m.h5", "--json", "b.json"]) == 0
    assert "smallest area (mm^2)" in capsys.readouterr().out
    file, model = numbers("a.json"), numbers("b.json")
    assert file["heights"]
    assert {**file, "baseline": "m.h5"} == model
    (workplace / "moved.su2").write_text(plane_su2_text())
    fails_as_expected(["quality", "moved.su2", "--baseline", "missing.h5"], capsys, "missing.h5")


def test_nodes_in_no_cell_are_said_by_inspect_and_fit_and_written_back(workplace, capsys):
    n, text = len(plane_mesh()[0]), plane_su2_text()
    unused = [f"{x} {y} {n + k}" for k, (x, y) in enumerate([(0.1, 0.0), (7.0, 3.0), (-1.0, 2.0)])]
    text = text.replace(f"NPOIN= {n}", f"NPOIN= {n + 3}").replace("NMARK=", "\n".join([*unused, "NMARK="]))
    (workplace / "more.su2").write_text(text)
    said = "3 nodes in no cell: kept in the file, moved along, and counted in the size of the mesh"
    for name, n_unused in (("more", 3), ("plane", 0)):
        for command in (["inspect", f"{name}.su2"], ["fit", f"{name}.su2", "-o", f"{name}.h5"]):
            found = f"{name}_{command[0]}.json"
            assert run([*command, "--json", found]) == 0
            assert numbers(found)["n_unused_nodes"] == n_unused
            assert (said in capsys.readouterr().out) == (n_unused == 3)
    assert run(["move", "more.h5", "--deform", "pitch=2deg", "-o", "moved.su2"]) == 0
    assert read_mesh("moved.su2").mesh.n_stored == n + 3


def test_a_polymesh_has_polyhedra_and_kinds_of_its_types(workplace, capsys):
    write_polymesh("polyMesh", brick_grid((4, 5, 6, 4)))
    assert run(["inspect", "polyMesh", "--json", "i.json"]) == 0
    found = numbers("i.json")
    assert found["cells"] == {"polyhedron": found["n_cells"]}
    assert {m["name"]: m["reason"] for m in found["markers"]}["body"] == "its file says wall"
    assert run(["quality", "polyMesh", "--json", "q.json"]) == 0
    assert (numbers("q.json")["n_inverted"], numbers("q.json")["certificate"]) == (0, None)
    text = capsys.readouterr().out
    assert f"{found['n_cells']:,} polyhedra, which have no map: nothing is proved of them" in text
    assert "is proved positive" not in text


def test_cgns_is_a_mesh_or_a_grid_by_what_is_in_it(workplace, capsys):
    write_plane_cgns(workplace / "mesh.cgns", [0, 1], 2)
    write_grid("grid.cgns", brick_grid((4, 4, 4, 4)))
    (workplace / "broken.cgns").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    assert [is_mesh(f"{name}.cgns") for name in ("mesh", "grid", "broken", "missing")] == [True, False, False, False]
    assert run(["inspect", "mesh.cgns", "--json", "i.json"]) == 0
    assert numbers("i.json")["dimensions"] == 2
    assert run(["inspect", "grid.cgns", "--json", "i.json"]) == 0
    assert "blocks" in numbers("i.json")


def test_help_says_that_the_baseline_may_be_the_model_of_a_grid_or_of_a_mesh(capsys):
    assert run(["quality", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "--baseline GRID|MODEL.h5 Grid or unstructured mesh before the move, or its model" in said
    assert "quality moved.su2 --baseline mesh.h5" in said
