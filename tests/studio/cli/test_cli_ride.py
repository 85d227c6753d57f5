"""The command ``ride``: what it writes, tells and refuses."""

from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest
from mover_cases import flare_grid
from riding_cases import mesh, model, plane_mesh, plane_su2_text, section, su2_text, twisted, write_plane_cgns
from sliding_cases import surface_of
from test_cli import fails_as_expected, numbers

from bspline_mdao import GridEvaluate, fit_grid
from bspline_mdao.core.design.section_maps import SCALED_AFTER_TURN
from bspline_mdao.files import read_mesh
from bspline_mdao.movers import moving_mesh
from bspline_mdao.studio.cli.main import run

TWIST = ["--deform", "twist=10deg", "--mover", "elasticity", "--increments", "1"]


@pytest.fixture
def workplace(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    model().save("wing.h5")
    (tmp_path / "wing.su2").write_text(su2_text(mesh()))
    return tmp_path


@pytest.mark.slow
def test_ride_puts_the_walls_where_the_deformation_does_and_tells_of_cells_and_heights(workplace, capsys):
    arguments = ["ride", "wing.h5", "wing.su2", "-o", "moved.su2", *TWIST, "--json", "r.json"]
    assert run(arguments) == 0
    found, text = numbers("r.json"), capsys.readouterr().out
    assert (found["walls"], found["n_held"], found["n_inverted"]) == (["wing"], 0, {"before": 0, "after": 0})
    assert 0.98 < found["heights"]["p01"] < found["heights"]["p99"] < 1.02
    for words in ("walls: wing", "inverted cells", "heights of the first nodes", "moved.su2 written"):
        assert words in text
    moved, rows = read_mesh("moved.su2").mesh.points, np.unique(mesh().markers["wing"])
    asked = twisted()[1].apply_to_nodes(mesh().points[rows])
    np.testing.assert_allclose(moved[rows], asked, rtol=0, atol=1e-14)


@pytest.mark.slow
def test_ride_follows_the_best_case_of_an_optimisation_or_control_points_of_a_file(workplace):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("grid", GridEvaluate(model=model()), promotes=["*"])
    problem.driver.add_recorder(om.SqliteRecorder(str(workplace / "cases.sql")))
    problem.driver.recording_options["includes"] = ["*"]
    problem.setup()
    problem.set_val("control_points", twisted()[0].ravel())
    problem.run_driver()
    problem.cleanup()
    np.save("points.npy", twisted()[0])
    for known in (next(workplace.rglob("cases.sql")), "points.npy"):
        assert run(["ride", "wing.h5", "wing.su2", "--to", str(known), "-o", "to.su2", "--overwrite"]) == 0
        moved = read_mesh("to.su2").mesh.points
        assert np.linalg.norm(moved - mesh().points, axis=1).max() > 0.05


@pytest.mark.parametrize("suffix", ["su2", "cgns"])
def test_a_mesh_of_two_dimensions_is_counted_as_its_file_is(workplace, capsys, suffix):
    points, triangles, quads, lines = plane_mesh()
    section().save("section.h5")
    if suffix == "su2":
        (workplace / "plane.su2").write_text(plane_su2_text())
    else:
        write_plane_cgns("plane.cgns", [0, 1], 2)
    start = ["ride", "section.h5", f"plane.{suffix}", "-o", f"m.{suffix}", "--deform", "pitch=1deg"]
    assert run([*start, "--mover", "elasticity", "--increments", "1", "--json", "r.json"]) == 0
    found, text = numbers("r.json"), capsys.readouterr().out
    n_cells = len(triangles) + len(quads)
    assert (found["n_nodes"], found["n_cells"], found["n_wall_nodes"]) == (len(points), n_cells, len(lines))
    assert f"plane.{suffix}: {len(points):,} nodes, {n_cells:,} cells in two dimensions" in text
    assert f"walls: airfoil, {len(lines)} nodes, " in text


def turned(grid, by):
    """A grid with its coordinates times three factors."""
    return replace(grid, blocks=tuple(replace(block, nodes=block.nodes * by) for block in grid.blocks))


def area(corners):
    """Areas of polygons, shape (n, n_corners, 2)."""
    x, y = np.moveaxis(corners, -1, 0)
    return 0.5 * np.abs((x * np.roll(y, -1, axis=1) - y * np.roll(x, -1, axis=1)).sum(axis=1))


def test_a_mesh_of_two_dimensions_has_areas_whatever_the_span_of_its_section(workplace, capsys):
    points, triangles, quads, _ = plane_mesh()
    fit_grid(turned(section().regenerate(), [1.0, 1.0, 0.3])).save("section.h5")
    (workplace / "plane.su2").write_text(plane_su2_text())
    asked = ["--deform", "pitch=1deg", "--mover", "elasticity", "--increments", "1", "--allow-invalid"]
    assert run(["ride", "section.h5", "plane.su2", "-o", "m.su2", "--json", "r.json", *asked]) == 0
    least = min(area(points[triangles]).min(), area(points[quads]).min())
    assert numbers("r.json")["min_volume"]["before"] == pytest.approx(least, rel=1e-6)
    text = capsys.readouterr().out
    assert "smallest area (m^2)" in text
    assert "volume" not in text


def test_a_node_of_two_dimensions_outside_the_grid_is_counted_and_numbered_as_in_its_file(workplace, capsys):
    section().save("section.h5")
    lines, n = plane_su2_text().split("\n"), len(plane_mesh()[0])
    lines[lines.index(f"NPOIN= {n}") + 7] = "70.0 80.0 6"
    (workplace / "plane.su2").write_text("\n".join(lines))
    start = ["ride", "section.h5", "plane.su2", "-o", "m.su2", "--deform", "pitch=1deg"]
    fails_as_expected(start, capsys, f"plane.su2: 1 of {n:,} nodes are outside", "the first is node 7 at (70, 80")
    assert run([*start, "--hold-outside", "--allow-invalid", "--json", "r.json"]) == 0
    assert numbers("r.json")["n_held"] == 1
    assert "; 1 node held" in capsys.readouterr().out


def test_ride_says_of_a_deformation_what_move_says(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fit_grid(turned(section().regenerate(), [-1.0, -1.0, 1.0])).save("section.h5")
    text = plane_su2_text()
    nodes = "".join(f"{-x:.16e}  {-y:.16e} {n}\n" for n, (x, y) in enumerate(plane_mesh()[0].tolist()))
    head, tail = text.partition("NPOIN")[0], text[text.index("NMARK") :]
    (tmp_path / "plane.su2").write_text(f"{head}NPOIN= {len(plane_mesh()[0])}\n{nodes}{tail}")
    asked = ["--deform", "pitch=1deg+thickness=1.05", "--mover", "elasticity", "--increments", "1", "--allow-invalid"]
    assert run(["move", "section.h5", "-o", "moved.xyz", *asked]) == 0
    moved = capsys.readouterr()
    assert run(["ride", "section.h5", "plane.su2", "-o", "m.su2", *asked]) == 0
    ridden = capsys.readouterr()
    (blunt,) = [line for line in moved.err.splitlines() if "the blunt one" in line]
    (late,) = [line for line in moved.out.splitlines() if line == SCALED_AFTER_TURN]
    assert blunt in ridden.err.splitlines()
    assert late in ridden.out.splitlines()


@pytest.mark.slow
def test_ride_refuses_what_it_cannot_do_and_writes_nothing(workplace, capsys):
    start = ["ride", "wing.h5", "wing.su2"]
    fails_as_expected([*start, "-o", "m.su2"], capsys, "give either --deform or --to")
    fails_as_expected([*start, "-o", "m.stl", *TWIST], capsys, "m.stl: is no unstructured mesh")
    fails_as_expected([*start, "-o", "wing.su2", *TWIST], capsys, "wing.su2: is read by this command")
    fails_as_expected([*start, "-o", "m.su2", *TWIST, "--wall", "tail"], capsys, "no marker is 'tail'")
    steep = ["--deform", "twist=75deg", "--mover", "elasticity", "--increments", "1"]
    fails_as_expected([*start, "-o", "m.su2", *steep, "--json", "m.json"], capsys, "inverts", "nothing was written")
    np.save("few.npy", np.zeros((5, 3)))
    fails_as_expected([*start, "-o", "m.su2", "--to", "few.npy"], capsys, "few.npy")
    assert {path.name for path in workplace.iterdir()} == {"wing.h5", "wing.su2", "few.npy"}


def test_nodes_of_a_mesh_slide_on_the_patch_that_they_are_on(workplace, capsys):
    grid = flare_grid()
    fit_grid(grid).save("flare.h5")
    corners = grid.blocks[0].nodes[[-1, -1, -1, -2], [2, 2, 3, 2], [3, 4, 3, 3]]
    points = "".join(f"{x:.17g} {y:.17g} {z:.17g}\n" for x, y, z in corners)
    (workplace / "tetra.su2").write_text(f"NDIME= 3\nNELEM= 1\n10 0 1 2 3 0\nNPOIN= 4\n{points}NMARK= 0\n")
    start = [
        "ride",
        "flare.h5",
        "tetra.su2",
        "-o",
        "m.su2",
        "--overwrite",
        "--deform",
        "translate=0/1e-3/1e-3",
        "--fix",
        "side*",
    ]
    cone, off = surface_of(moving_mesh(fit_grid(grid), sliding="cone"), "cone"), []
    for more in ([], ["--slide", "cone"]):
        assert run([*start, *more]) == 0
        moved = read_mesh(workplace / "m.su2").mesh.points[:3]
        assert np.linalg.norm(moved - corners[:3], axis=1).max() > 1e-5
        off.append(cone.distances(moved).max())
    assert off[0] > 1e-6
    assert off[1] < 1e-14
    assert "nodes on patch 'cone' slide on a cone" in "".join(capsys.readouterr())
    np.save("to.npy", 1.01 * fit_grid(grid).control_points)
    assert run([*start[:6], "--to", "to.npy", "--slide", "cone", "--json", "r.json"]) == 0
    assert numbers("r.json")["sliding"][0]["patch"] == "patch 'cone'"
    assert numbers("r.json")["sliding_off"] < 1e-14
