"""Pages on meshes without structure: what they say, what is drawn, and how few triangles draw a large wall."""

from dataclasses import replace

import h5py
import numpy as np
import openmdao.api as om
import pytest
import sliding_cases
from mesh_cases import body_model, mesh_around_a_body, section_model, sector_mesh
from periodic_cases import passage, untied
from sliding_cases import lean
from test_report_page import Page

from bspline_mdao import DesignSurface, GridMovement, fit_grid, write_report
from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.mesh.boundary import moving_mesh
from bspline_mdao.core.om.drivers.case_history import read_history
from bspline_mdao.core.om.model_option import named_model
from bspline_mdao.design import Twist
from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.mesh_quality import mesh_quality
from bspline_mdao.grids.topology.periodic_gap import periodic_gaps
from bspline_mdao.movers import Rotations
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.cli.mesh_periodic import block_numbers, side_numbers
from bspline_mdao.studio.plotting.mesh_slices import mesh_slice
from bspline_mdao.studio.plotting.thinned_surface import thinned
from bspline_mdao.studio.report import openmdao_report
from bspline_mdao.studio.report.mesh_walls import MeshWalls, edge_lines
from bspline_mdao.studio.report.model_file import find_model
from bspline_mdao.studio.report.shape import Shape
from bspline_mdao.studio.report.subject import subject_of

pytest.importorskip("plotly", reason="plotly is not installed")
pytest.importorskip("jinja2", reason="jinja2 is not installed")


def turned(model: MeshModel) -> om.Problem:
    """A problem that turns the walls of a mesh twice, by 0 and by 4 degrees; set up, not run."""
    design = DesignSurface.of(model)
    problem = om.Problem(design.grid_movement([Twist("twist", design.axis, stations=1)], quality=["volume_ks"]))
    problem.model.add_design_var("twist", lower=-10.0, upper=10.0, units="deg")
    problem.model.add_objective("volume_ks")
    cases = om.ListGenerator([[("twist", [angle])] for angle in (0.0, 4.0)])
    problem.driver = om.DOEDriver(cases)
    return problem


def recorded(folder, model: MeshModel):
    """Run `turned` and return its case file."""
    problem, file = turned(model), folder / "cases.sql"
    problem.driver.add_recorder(om.SqliteRecorder(file))
    problem.driver.recording_options["includes"] = ["*control_points"]
    problem.setup()
    problem.run_driver()
    problem.cleanup()
    return file


def page_of(path) -> Page:
    return Page(path.read_text(encoding="utf-8"))


def sphere(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Quads of a sphere and, at its poles, triangles."""
    theta, phi = np.linspace(0.0, np.pi, n), np.linspace(0.0, 2.0 * np.pi, 2 * n, endpoint=False)
    ring = np.stack([np.cos(phi), np.sin(phi), 0.0 * phi], axis=1)
    points = np.concatenate(
        [[[0.0, 0.0, 1.0]], *(ring * np.sin(t) + [0.0, 0.0, np.cos(t)] for t in theta[1:-1]), [[0.0, 0.0, -1.0]]]
    )
    ids = 1 + np.arange((n - 2) * 2 * n).reshape(n - 2, 2 * n)
    after = np.roll(ids, -1, axis=1)
    quads = np.stack([ids[:-1], ids[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    north = np.stack([0 * ids[0], ids[0], after[0], after[0]], axis=1)
    south = np.stack([after[-1], ids[-1], 0 * ids[0] + len(points) - 1, 0 * ids[0] + len(points) - 1], axis=1)
    return points, np.concatenate([north, quads, south])


@pytest.mark.slow
def test_a_mesh_has_a_page_of_its_own(tmp_path):
    body_model().save(tmp_path / "body.h5")
    assert run(["report", str(tmp_path / "body.h5"), "-o", str(tmp_path / "body.html"), "--triangles", "100"]) == 0
    page = page_of(tmp_path / "body.html")
    assert [a["id"] for a in page.all("section")] == ["space", "sections", "quality", "heights", "contents"]
    mesh, lattice = body_model().mesh, body_model().lattice
    assert f"{mesh.n_points:,} nodes, {mesh.n_cells:,} cells, {lattice.n_control:,} control points" in page.text
    assert f"{mesh_quality(mesh).angles.max():.4g}" in page.text
    for words in (*mesh.markers, "cells: tetra", "move as prescribed", "stay in their plane"):
        assert words in page.text
    assert "edges are contracted" in page.text
    drawn = {trace["meta"]["layer"] for trace in page.charts["space"]["data"]}
    assert drawn == {"walls", "lines", "control", "symmetry", "worst"}
    assert {"sections", "cells0", "leading-edge", "trailing-edge", "lattice", "quality"} <= set(page.charts)


def test_gaps_of_periodic_sides_and_distances_of_nodes_that_slide_are_those_of_move(tmp_path):
    mesh, kinds = sector_mesh()
    model = MeshModel.of(mesh, {**kinds, "floor": "sliding"}, LatticeSettings(spacing=0.3))
    nodes = mesh.points + 0.01 * np.random.default_rng(3).standard_normal(mesh.points.shape)
    shapes = Shape("Before", mesh.points, None), Shape("After", nodes, None)
    sides, slide = subject_of(model).misses(shapes)
    (told,) = side_numbers(model.periodic, mesh, nodes)
    assert sides == ("per_1 and per_2", f"a {told['motion']}", [told["gap_before"], told["gap"]])
    assert slide[2] == [model.sliding_nodes.off(mesh.points), model.sliding_nodes.off(nodes)]
    assert slide[2][0] < 1e-9 < 1e-3 < slide[2][1]
    write_report(tmp_path / "sector.html", model)
    page = page_of(tmp_path / "sector.html")
    assert "interfaces" in [a["id"] for a in page.all("section")]
    for words in ("Periodic sides and fixed surfaces", "per_1 and per_2", "nodes of floor", slide[1]):
        assert words in page.text


def test_nodes_of_blocks_that_slide_are_shown_on_their_surfaces_and_their_distances_told(tmp_path):
    model = sliding_cases.passage()
    mesh = moving_mesh(model, "blade", sliding=["hub", "casing"])
    movement = Rotations(mesh).move(model.control_points, lean(mesh, 0.05))
    subject = subject_of(model, mesh.slides)
    on, off = (subject_of(model, slides).nodes_at(movement.points) for slides in (mesh.slides, ()))
    shapes = Shape("Before", subject.nodes_at(), None), Shape("After", on, None), Shape("Without", off, None)
    *_, (what, how, misses) = subject.misses(shapes)
    assert what == "nodes of patch 'hub', patch 'casing'"
    assert how.startswith("sliding on ")
    assert max(misses[:2]) < 1e-12 < 1e-8 < misses[2]
    write_report(tmp_path / "passage.html", model, slides=mesh.slides)
    assert what in page_of(tmp_path / "passage.html").text
    problem = om.Problem(GridMovement(model=model, mover=Rotations(mesh), fit=False, quality=False), reports=None)
    problem.setup()
    assert openmdao_report._slides(problem) == mesh.slides
    with pytest.raises(InputError, match="leave 'slides' out"):
        subject_of(MeshModel.of(*sector_mesh(), LatticeSettings(spacing=0.3)), mesh.slides)


@pytest.mark.parametrize("is_tied", [True, False])
def test_all_periodic_pairs_of_blocks_are_listed_with_their_gaps_before_and_after(is_tied):
    model = fit_grid(passage())
    model = model if is_tied else replace(model, topology=untied(model.topology))
    nodes = model.regenerate().to_vector().reshape(-1, 3)
    moved = nodes.copy()
    moved[np.ravel_multi_index((5, 0, 3), (9, 8, 7))] += [0.0, 0.012, 0.016]
    shapes = Shape("Before", nodes, None), Shape("After", moved, None), Shape("Again", nodes, None)
    ((sides, how, misses),) = subject_of(model).misses(shapes)
    assert sides.count("block 1") == 2
    assert how == "a rotation about x by 17.1887 deg"
    assert max(misses[0], misses[2]) < 1e-12
    assert misses[1] == pytest.approx(0.02, rel=1e-9)
    grids = [model.header.grid(model.topology.shapes, of) for of in (nodes, moved)]
    (numbers,) = block_numbers(model.topology, *grids)
    assert (numbers["gap_before"], numbers["gap"]) == (misses[0], misses[1])
    assert len(periodic_gaps(model.topology, *grids)) == (0 if is_tied else 1)


@pytest.mark.slow
def test_an_optimisation_on_a_mesh_is_shown_before_and_after(tmp_path):
    model = section_model()
    model.save(tmp_path / "section.h5")
    model = MeshModel.load(tmp_path / "section.h5")
    file = recorded(tmp_path, model)
    numbers = write_report(tmp_path / "page.html", file.parent)  # the model is found by its checksum
    page = page_of(tmp_path / "page.html")
    assert not any("grid is not shown" in text for text in numbers["missing"])
    assert {"history", "variables", "diagram", "contents"} <= {a["id"] for a in page.all("section")}
    assert {trace["name"] for trace in page.charts["sections"]["data"]} == {"Before", "After"}
    assert {"cells0", "cells1", "ratios"} <= set(page.charts)
    with h5py.File(tmp_path / "section.h5", "r+") as stored:
        stored.attrs["checksum"] = "another"
    assert "is not the model" in find_model(file, named_model(read_history(file).options))[1]


@pytest.mark.slow
def test_openmdao_makes_the_page_of_a_chain_on_a_mesh(tmp_path, monkeypatch):
    monkeypatch.setenv("OPENMDAO_WORKDIR", str(tmp_path))
    problem = turned(body_model())
    problem.setup()
    problem.final_setup()
    problem.get_reports_dir().mkdir(parents=True, exist_ok=True)
    openmdao_report._record(problem)
    problem.run_driver()
    openmdao_report._write(problem)
    problem.cleanup()
    page = page_of(problem.get_reports_dir() / openmdao_report.PAGE)
    assert {"space", "history", "quality", "contents", "diagram"} <= {a["id"] for a in page.all("section")}


def test_a_sphere_of_few_triangles_is_closed_and_near_the_whole_one():
    points, faces = sphere(40)
    walls = MeshWalls.of(points, faces, np.zeros(len(faces), dtype=int), 600)
    assert walls.n_of_all == 2 * len(faces) - 4 * 40
    assert 300 < walls.n_triangles <= 600
    ends = np.sort(np.concatenate([walls.drawn[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    assert (np.unique(ends, axis=0, return_counts=True)[1] == 2).all()
    middles = points[walls.drawn].mean(axis=1)
    assert np.linalg.norm(middles, axis=1).min() > 0.95
    normals = np.cross(*(points[walls.drawn[:, k]] - points[walls.drawn[:, 0]] for k in (1, 2)))
    assert (np.sum(normals * middles, axis=1) > 0.0).all() or (np.sum(normals * middles, axis=1) < 0.0).all()


def test_sharp_edges_and_seams_of_markers_stay_where_they_are():
    n = 30
    ids = np.arange(n * n).reshape(n, n)
    x, y = np.meshgrid(np.linspace(0.0, 1.0, n), np.linspace(0.0, 1.0, n), indexing="ij")
    points = np.stack([x, y, np.abs(x - x[10, 0])], axis=-1).reshape(-1, 3)  # a roof
    quads = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1)
    marker = np.broadcast_to(np.arange(n - 1) < 17, (n - 1, n - 1)).astype(int)
    walls = MeshWalls.of(points, quads.reshape(-1, 4), marker.ravel(), 100)
    assert walls.n_triangles <= 100
    kept = points[walls.drawn]
    areas = 0.5 * np.linalg.norm(np.cross(kept[:, 1] - kept[:, 0], kept[:, 2] - kept[:, 0]), axis=1)
    assert areas.sum() == pytest.approx(np.sqrt(2.0), rel=1e-12)  # no corner, edge or ridge is lost
    for axis, place in ((0, x[10, 0]), (1, y[0, 17])):
        across = kept[..., axis] - place
        assert not ((across.min(axis=1) < -1e-9) & (across.max(axis=1) > 1e-9)).any()


def test_few_triangles_are_all_drawn():
    points, faces = sphere(6)
    triangles = faces[faces[:, 2] == faces[:, 3]][:, :3]
    assert thinned(points, triangles, np.zeros(len(triangles), dtype=int), 1000) is triangles


def test_lines_pass_every_edge_once():
    points, faces = sphere(7)
    edges = np.unique(np.sort(faces[:, :2], axis=1), axis=0)
    lines = edge_lines(points, edges)
    is_line = ~np.isnan(lines[:-1, 0]) & ~np.isnan(lines[1:, 0])
    drawn = np.sort(np.stack([np.linalg.norm(lines[1:] - lines[:-1], axis=1)[is_line]]))
    lengths = np.sort(np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1))
    np.testing.assert_allclose(drawn[0], lengths, atol=1e-12)
    assert len(lines) < 2.5 * len(edges)


def test_a_slice_of_cells_fills_the_box_around_the_body():
    mesh, _ = mesh_around_a_body()
    ends = mesh_slice(mesh, mesh.points, 1, 0.31, np.array([[-9.0] * 3, [9.0] * 3]))
    assert np.allclose(ends[..., 1], 0.31)
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    for axis in (0, 2):
        assert (ends[..., axis].min(), ends[..., axis].max()) == pytest.approx((low[axis], high[axis]))
    middles = ends.mean(axis=1)
    assert not ((np.abs(middles[:, 0]) < 0.1) & (np.abs(middles[:, 2]) < 0.1)).any()  # none in the body
