"""The run scripts of the README picture and of the tables of real grids and of grids with boundary layers."""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest
from adaptation_cases import skewed_grid
from component_cases import two_blocks
from periodic_cases import blade_row

from bspline_mdao import InputError, fit_grid, write_grid
from bspline_mdao.core.fit.surface_fit import SurfaceFollower
from bspline_mdao.drivers import nlopt, scipy_slsqp
from bspline_mdao.files import read_mesh
from bspline_mdao.grids.cells.grid_quality import GridQuality
from bspline_mdao.grids.cells.report import report_quality
from bspline_mdao.grids.topology.periodic_ties import gap_between
from bspline_mdao.measures import SurfaceGrid
from bspline_mdao.movers import Rotations, moving_mesh

RUN_SCRIPTS = Path(__file__).parents[2] / "run_scripts"


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(RUN_SCRIPTS))
    return importlib.import_module


@pytest.mark.slow
def test_a_surface_becomes_a_volume_without_inverted_cells(script, tmp_path):
    numbers = script("surface_to_volume").main(figures=tmp_path)
    assert (numbers["n_surface"], numbers["n_nodes"]) == (1455, 71295)
    assert numbers["n_inverted"] == 0
    assert numbers["min_corner"] > 0.15
    assert numbers["corner_1_percent"] > 0.6
    assert numbers["heights"] > 0.95
    assert (tmp_path / "surface_to_volume.png").stat().st_size > 50_000


def test_control_mesh_is_drawn(script, tmp_path):
    numbers = script("control_mesh").main(figures=tmp_path)
    assert numbers["n_nodes"] == 12 * 23 * 33 * 17
    assert numbers["nodes_per_control_point"] > 20
    assert (
        numbers["n_wall_control_points"] == 2 * 9 * 7 - 9 - 7 - 5
    )  # two sides that share leading edge, tip, trailing edge
    assert (tmp_path / "control_mesh.png").stat().st_size > 50_000


def test_real_grids_table_tells_errors_by_cell_size_or_the_reason_of_refusal(script, tmp_path):
    write_grid(tmp_path / "two.xyz", two_blocks())
    (tmp_path / "rubbish.xyz").write_bytes(b"no grid")
    table = script("real_grids_table").main(folder=tmp_path)
    assert table["two.xyz"]["n_interfaces"] == 1
    assert 0.0 < table["two.xyz"]["rms"] < 1e-2
    assert 0.5 < table["two.xyz"]["local_rms"] / table["two.xyz"]["relative_rms"] < 2.0  # its cells are much alike
    assert table["rubbish.xyz"]["refused"].startswith("rubbish.xyz: ")
    assert "\n" not in table["rubbish.xyz"]["refused"]


def test_only_edges_with_a_length_count(script):
    x = np.stack(
        np.meshgrid([0.0, 1.0, 3.0], [0.0, 0.0, 5.0], [0.0], indexing="ij"), axis=-1
    )  # the first two lines coincide
    table = script("real_grids_table")
    np.testing.assert_allclose(table.mean_edges(x)[:, 0, 0], [1.0, 1.5, 2.0])
    np.testing.assert_allclose(table.mean_edges(x)[:, 1, 0], [3.0, (1.0 + 2.0 + 5.0) / 3.0, 3.5])
    np.testing.assert_allclose(table.shortest_edges(x)[:, 1, 0], [1.0, 1.0, 2.0])


def test_real_grids_table_needs_a_folder(script, monkeypatch):
    monkeypatch.delenv("BSPLINE_MDAO_GRIDS", raising=False)
    with pytest.raises(InputError, match="BSPLINE_MDAO_GRIDS"):
        script("real_grids_table").main()


@pytest.mark.slow
def test_every_real_grid_is_fitted_or_refused(script, real_grids):
    table = script("real_grids_table").main(folder=real_grids)
    assert len(table) > 15
    for name, row in table.items():
        assert "skipped" in row or "refused" in row or row["relative_rms"] < 0.5, name


@pytest.mark.slow
def test_grids_with_boundary_layers_are_moved_measured_and_drawn(script, tmp_path):
    viscous = script("viscous_grids")
    numbers = viscous.main(figures=tmp_path, table=tmp_path / "table.csv")
    assert {row["deformation"] for row in numbers["rows"]} == {"pitch=5deg", "pitch=20deg"}
    assert all(row["q_before"] > 0.05 and not row["failure"] for row in numbers["rows"])
    assert {way: row["n_valid"] for way, row in numbers["summary"].items()} == {
        "least squares": 0,
        "default": 2,
        "inverse distance": 2,
    }
    assert numbers["summary"]["default"]["n_keep_heights"] == 2
    assert numbers["off_rigid"]["section"] < 1e-11
    lines = (tmp_path / "table.csv").read_text().splitlines()
    assert len(lines) == 3
    assert {line.count(",") for line in lines} == {1 + len(viscous.COLUMNS)}
    for name in ("viscous_section", "viscous_heights"):
        assert 5_000 < (tmp_path / f"{name}.png").stat().st_size < 200_000


@pytest.mark.slow
def test_moves_as_users_make_them_invert_no_cell_of_a_section_and_stand_beside_recorded_ones(script, tmp_path):
    moves = script("viscous_moves")
    recorded = Path(moves.__file__).parents[1] / "docs" / "_static" / "idwarp_recorded.csv"
    peers = moves.read_rows(recorded)
    assert {peer.way for peer in peers} == {"IDWarp", "IDWarp best", "IDWarp tight"}
    numbers = moves.main(ways=["rotations", "going along"], recorded=recorded, table=tmp_path / "table.csv")
    rows = {(row["motion"], row["way"]): row for row in numbers["rows"]}
    assert {motion for motion, _ in rows} == {"pitch=20deg", "thickness=1.3", "flap", "rigid=90"}
    assert all(row["n_inverted"] == 0 and not row["failure"] for row in rows.values())
    assert all(0.98 < row["p01"] <= row["p99"] < 1.02 for row in rows.values())
    assert rows["rigid=90", "going along"]["q_mean"] > rows["rigid=90", "rotations"]["q_mean"] + 0.05
    assert numbers["worse"] == {"rotations": [], "going along": []}
    assert moves.read_rows(tmp_path / "table.csv")[0].grid == "section"
    body = moves.Row("bwb", "twist=45deg", "rotations", n_inverted=1)
    assert moves.is_worse(body, {("bwb", "twist=45deg"): 0})
    assert not moves.is_worse(body, {("bwb", "twist=45deg"): 3})


@pytest.mark.slow
def test_inverse_distances_with_rotations_follow_a_rigid_motion(script):
    """Of the walls alone: all the rest of the grid goes with them, as far as its boundary."""
    viscous = script("viscous_grids")
    ((_, grid),) = viscous.collect(False, None, (), None)
    nodes = grid.to_vector().reshape(-1, 3)
    moved = viscous.WallDistances(grid).move("pitch=30deg")
    lengths = [np.linalg.norm(x[1:] - x[:1], axis=1) for x in (nodes, moved)]
    np.testing.assert_allclose(lengths[1], lengths[0], atol=1e-9)
    assert np.abs(moved - nodes).max() > 1.0


@pytest.mark.slow
def test_ride_along_takes_thin_wedges_along_and_draws_them(script, tmp_path):
    numbers = script("ride_along").main(quick=True, figures=tmp_path)
    assert numbers["n_inverted"] == 0
    for name in ("twist", "bend", "sweep"):
        moved = numbers[name]
        assert (moved["n_inverted"], moved["missed"], moved["off_plane"]) == (0, 0.0, 0.0)
        assert 0.95 < moved["heights"][0] <= moved["heights"][2] < 1.03
        assert moved["products"] < 1e-11
    assert (tmp_path / "ride_along.png").stat().st_size > 50_000


@pytest.mark.slow
def test_ride_section_takes_layers_of_two_dimensions_along_and_changes_nodes_alone(script, tmp_path):
    numbers = script("ride_section").main(quick=True, figures=tmp_path)
    for name in ("pitch", "thickness", "chord"):
        moved = numbers[name]
        assert (moved["n_inverted"], moved["missed"], moved["n_lines"]) == (0, 0.0, 0)
        assert moved["heights"][1] == pytest.approx(1.0, abs=1e-4)
        assert moved["apart"] < 1e-9
        assert moved["products"] < 1e-11
    np.testing.assert_allclose(numbers["pitch"]["heights"], 1.0, rtol=1e-6)  # at the trailing edge as well
    assert (tmp_path / "ride_section.png").stat().st_size > 50_000


@pytest.mark.slow
def test_wing_body_su2_moves_and_optimises_tetrahedra_from_their_file(script, tmp_path):
    pytest.importorskip("gmsh", reason='needs pip install "bspline_mdao[gmsh]"', exc_type=ImportError)
    wing_body = script("wing_body_su2")
    numbers = wing_body.main(quick=True, figures=tmp_path, output=tmp_path, drivers={"SciPy SLSQP": scipy_slsqp})
    assert numbers["n_cells"] > 5000
    baseline = read_mesh(tmp_path / "wing_body.su2").mesh
    assert list(baseline.markers) == ["symmetry", "fuselage", "wing", "farfield"]
    in_plane, on_fuselage = (np.unique(baseline.markers[name]) for name in ("symmetry", "fuselage"))
    assert set(numbers["moves"]) == {*wing_body.MOVES, "fuselage=1.3", "optimum"}
    for text, judged in numbers["moves"].items():
        assert judged["n_inverted"] == 0, text
        assert judged["smallest_ratio"] > 0.1, text
        nodes = read_mesh(tmp_path / f"{text}.su2").mesh.points
        np.testing.assert_allclose(nodes[in_plane, 2], 0.0, rtol=0, atol=1e-15)
        moved = np.linalg.norm(nodes - baseline.points, axis=1)
        assert moved.max() == pytest.approx(judged["displacement"], rel=1e-12)
        if text == "fuselage=1.3":
            width = np.ptp(nodes[on_fuselage, 2]) / np.ptp(baseline.points[on_fuselage, 2])
            assert width == pytest.approx(1.3, rel=1e-12)
        else:  # of the fuselage only the nodes that the wing has as well may move
            assert set(on_fuselage[moved[on_fuselage] > 0.0]) <= set(baseline.markers["wing"].ravel())
    best = numbers["best"]
    assert best["volume"].item() > 1.015 * numbers["volume"]
    assert best["surface_area"].item() < 1.0 + 1e-4
    assert best["projected_area"].item() == pytest.approx(1.0, abs=1e-4)
    assert 0.8 - 1e-4 < best["thickness"].min() <= best["thickness"].max() < 1.25 + 1e-4
    assert best["volume_ks"].item() > 0.4 - 1e-4
    assert numbers["totals"]["transposed"] < 1e-12
    assert numbers["totals"]["differences"] < 1e-8
    assert (tmp_path / "wing_body_su2.png").stat().st_size > 50_000


@pytest.mark.slow
def test_wing_slides_on_body_keeps_its_root_on_the_fuselage_and_trims(script, tmp_path):
    slides = script("wing_slides_on_body")
    numbers = slides.main(quick=True, figures=tmp_path, drivers={"NLopt LD_SLSQP": nlopt})
    assert set(numbers["moves"]) == {"baseline", *slides.MOVES, "optimum"}
    for text, judged in numbers["moves"].items():
        assert judged["n_inverted"] == 0, text
        assert judged["off_fuselage"] < 1e-10, text
        assert judged["smallest_ratio"] > 0.3, text
        assert 0.99 < judged["heights"][0] <= judged["heights"][1] < 1.01, text
    optimum = numbers["drivers"]["NLopt LD_SLSQP"]["optimum"]
    assert optimum["CL"].item() == pytest.approx(slides.LIFT, abs=1e-6)
    assert optimum["CM"][2] == pytest.approx(0.0, abs=1e-6)
    assert 0.2 < optimum["position"].item() < 0.5
    assert numbers["totals"]["transposed"] < 1e-11
    assert numbers["totals"]["differences"] < 1e-8
    assert (tmp_path / "wing_slides_on_body.png").stat().st_size > 50_000


@pytest.mark.slow
def test_turbine_sector_moves_both_sides_alike(script, tmp_path):
    turbine = script("turbine_sector")
    numbers = turbine.main(quick=True, figures=tmp_path)
    assert numbers["n_cells"] == 1824
    assert numbers["gap"] < 1e-14
    for name in turbine.MOVES:
        moved = numbers[name]
        assert moved["gap"] < 1e-14, name
        assert moved["n_inverted"] == 0, name
        assert moved["smallest_ratio"] > 0.3, name
        assert moved["heights"][1] == pytest.approx(1.0, abs=0.06), name
        assert moved["displacement"] > 0.005, name
        assert moved["products"] < 1e-11, name
    assert (tmp_path / "turbine_sector.png").stat().st_size > 50_000


@pytest.mark.slow
def test_the_same_moves_of_blocks_around_the_blade_keep_both_sides_alike_and_first_cells_as_high(script):
    turbine = script("turbine_sector")
    grid = blade_row(turbine, {})
    model = fit_grid(grid)
    mesh, surface, (tied,) = moving_mesh(model), SurfaceGrid.of(model), model.topology.periodic
    assert len(tied.links) == 3
    mover, quality = Rotations(mesh), GridQuality.of_baseline(grid)
    for name, amounts in turbine.MOVES.items():
        wall = blade_row(turbine, amounts).to_vector().reshape(-1, 3)[surface.rows]
        moved = mover.move(mesh.points, SurfaceFollower.of(model, mesh, surface).at(wall).control_points)
        nodes = model.map_meeting(surface.rows, model).at(moved.points, wall).nodes
        np.testing.assert_allclose(nodes[surface.rows], wall, atol=1e-14)
        assert gap_between(model.topology, tied, nodes) < 1e-14, name
        report = report_quality(quality, nodes)
        assert report.n_inverted == 0, name
        for wall_heights in report.heights:
            assert wall_heights.ratio_median == pytest.approx(1.0, abs=0.06), (name, wall_heights.patch)
        assert np.linalg.norm(nodes - grid.to_vector().reshape(-1, 3), axis=1).max() > 0.005, name


def test_wing_body_su2_says_in_one_line_that_gmsh_is_missing(script, monkeypatch):
    monkeypatch.setitem(sys.modules, "gmsh", None)
    with pytest.raises(InputError, match=r"the mesh is made by Gmsh \(.*\): pip install 'bspline_mdao\[gmsh\]'"):
        script("wing_body_su2").main(quick=True)


@pytest.mark.slow
def test_a_grid_that_the_user_names_is_asked_what_the_user_asks(script, tmp_path):
    grids = script("viscous_grids")
    ((_, section),) = grids.collect(False, None, (), None)
    write_grid(tmp_path / "mine.xyz", section)
    numbers = grids.main(grid=[str(tmp_path / "mine.xyz")], deform=["pitch=1deg"], ways=["inverse distance"])
    ((row),) = numbers["rows"]
    assert (row["grid"], row["n_inverted"], row["deformation"]) == ("mine.xyz", 0, "pitch=1deg")


@pytest.mark.slow
def test_improve_grids_raises_a_grid_and_needs_a_folder(script, monkeypatch, tmp_path):
    monkeypatch.delenv("BSPLINE_MDAO_GRIDS", raising=False)
    table = script("improve_grids")
    with pytest.raises(InputError, match="no folder of grids"):
        table.main()
    write_grid(tmp_path / "skewed.xyz", skewed_grid())
    (tmp_path / "none.xyz").write_text("1 2 3")
    found = table.main(figures=tmp_path, folder=str(tmp_path), grid=("skewed.xyz", "none.xyz"))
    assert (tmp_path / "improve_skewed.png").stat().st_size > 20_000
    row = found["skewed.xyz"]
    assert row["q_min"][1] > 1.1 * row["q_min"][0]
    assert row["reason"] == ""
    assert row["wall_motion"] < 1e-13
    assert row["largest_fall"] <= 1e-9
    assert "none.xyz" in found["none.xyz"]["refused"]


def test_improve_grids_names_the_grids_of_the_folder_where_one_is_missing(script, tmp_path):
    (tmp_path / "folder").mkdir()
    for name in ("b.xyz", "a.cgns"):
        (tmp_path / name).touch()
    with pytest.raises(InputError, match=r"^wrong.xyz: no such file in .*; the files there are a.cgns, b.xyz$"):
        script("improve_grids").main(folder=str(tmp_path), grid=("b.xyz", "wrong.xyz"))
