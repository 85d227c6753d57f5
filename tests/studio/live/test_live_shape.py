"""A shape that is deformed while one looks on is the grid that ``move`` makes, and its numbers are those of others."""

import numpy as np
import openmdao.api as om
import pytest

from bspline_mdao import FittedModel, LatticeFlow, fit_grid, read_grid
from bspline_mdao.errors import InputError, MovementError
from bspline_mdao.generators import airfoil_grid, brick_grid
from bspline_mdao.grids import GridQuality, judge_move, report_quality
from bspline_mdao.studio.cli.main import run
from bspline_mdao.studio.live.drawn import Drawn
from bspline_mdao.studio.live.history import Design, History
from bspline_mdao.studio.live.outputs import free_name, write_shape
from bspline_mdao.studio.live.part import corners_of
from bspline_mdao.studio.live.shape import LiveModel
from bspline_mdao.studio.live.variables import asked_slider


def number(live, name):
    return [slider.name for slider in live.sliders].index(name)


def moved(model_file, deform, path):
    assert run(["move", str(model_file), "--deform", deform, "-o", str(path), "--allow-invalid"]) == 0
    return read_grid(path).to_vector().reshape(-1, 3)


def a_row(live):
    """A control point of the surface that is in no plane of symmetry."""
    return int(np.setdiff1d(np.arange(len(live.mesh.surface_ids)), live.mesh.in_plane_rows)[5])


def test_sliders_give_the_grid_of_move_to_the_last_bit(live, wing_file, tmp_path):
    design = live.neutral.with_value(number(live, "twist"), 4.0).with_value(number(live, "stretch"), 1.15)
    live.at(live.neutral.with_value(number(live, "sweep"), 3.0))  # the factor of another move is used again
    assert live.words(design) == "twist=4deg+stretch=1.15"
    expected = moved(wing_file, live.words(design), tmp_path / "moved.xyz")
    np.testing.assert_array_equal(live.at(design).nodes, expected)


def test_pulled_control_points_give_the_grid_of_move_with_their_file(live, wing_file, tmp_path):
    design = live.neutral.with_value(number(live, "twist"), 2.0).with_pull(a_row(live), (0.0, 0.01, 0.0))
    shape = live.at(design)
    assert write_shape(tmp_path / "surface.csv", live, shape) == (tmp_path / "surface.csv",)
    expected = moved(wing_file, str(tmp_path / "surface.csv"), tmp_path / "moved.xyz")
    np.testing.assert_allclose(shape.nodes, expected, rtol=0.0, atol=1e-14)


def test_the_neutral_design_is_the_model(live):
    shape = live.at(live.neutral)
    np.testing.assert_array_equal(shape.nodes, live.model.local_nodes())
    np.testing.assert_array_equal(shape.heights, 1.0)
    assert shape.n_inverted == 0


def test_a_pull_keeps_planes_of_symmetry(live):
    row, normal = live.mesh.in_plane_rows[0], live.mesh.in_plane_normals[0]
    surface, _ = live.deformed(live.neutral.with_pull(int(row), tuple(0.01 * normal + [0.002, 0.0, 0.0])))
    change = surface[row] - live.model.control_points[live.mesh.surface_ids[row]]
    assert abs(change @ normal) < 1e-16
    assert np.linalg.norm(change) > 1e-3


def test_both_planes_of_a_section_are_pulled_alike():
    live = LiveModel(fit_grid(airfoil_grid("naca0012", 32, 12, far=8.0)))
    assert [slider.name for slider in live.sliders] == ["thickness", "chord", "pitch"]
    assert live.lift.why_not
    original, copy = live.mesh.copies[len(live.mesh.copies) // 2]
    surface, _ = live.deformed(live.neutral.with_pull(int(original), (0.0, 0.003, 0.0)))
    change = surface - live.model.control_points[live.mesh.surface_ids]
    np.testing.assert_allclose(change[copy], change[original], atol=1e-16)


def test_measures_are_those_of_the_whole_grid(live):
    shape = live.at(live.neutral.with_value(number(live, "twist"), 6.0))
    quality = GridQuality.of_baseline(live.model.regenerate())
    report = report_quality(quality, shape.nodes)
    np.testing.assert_array_equal(shape.q, quality.evaluate(shape.nodes, (), cells=True).q)
    assert shape.q.min() == report.q_min
    assert shape.n_inverted == judge_move(quality, shape.nodes).n_inverted
    first = report.worst[0]
    assert shape.corners[shape.worst[0]] == pytest.approx(first.corner, rel=1e-12)
    assert live.place_of(shape.worst[0]).startswith(f"({first.i}, {first.j}, {first.k}) of")
    np.testing.assert_allclose(live.middles(shape.nodes, shape.worst[:1])[0], first.place, rtol=1e-12)


@pytest.mark.parametrize("seen", [(), (True, 2, 0.4), (False, 0, 1.0)])
def test_a_part_has_the_bits_of_the_whole_grid(live, seen):
    part = live.part_of(Drawn.of(live.model.topology, *seen).cells)
    turned = live.neutral.with_value(number(live, "twist"), 7.0)
    for design in (live.neutral, turned, turned.with_pull(a_row(live), (0.3, 0.01, 0.0))):
        shape, whole = live.at(design, part=part), live.at(design)
        np.testing.assert_array_equal(shape.nodes[part.rows], whole.nodes[part.rows])
        np.testing.assert_array_equal(shape.q[part.cells], whole.q[part.cells])
        np.testing.assert_array_equal(shape.corners[part.cells], whole.corners[part.cells])
        np.testing.assert_array_equal(shape.heights, whole.heights)
        np.testing.assert_array_equal(shape.thickness, whole.thickness)
        np.testing.assert_array_equal(shape.new, np.intersect1d(whole.new, part.cells))
        assert np.isin(shape.worst, part.cells).all()
        assert np.isinf(np.delete(shape.q, part.cells)).all()
        again = live.completed(shape)
        np.testing.assert_array_equal(again.nodes, whole.nodes)
        np.testing.assert_array_equal(again.worst, whole.worst)
        assert again.lift == whole.lift
    assert len(part.rows) < len(live.baseline)


def test_a_part_has_the_worst_cells_of_the_baseline(live):
    part, whole = live.part_of(np.zeros(0, dtype=int)), live.at(live.neutral)
    shape = live.at(live.neutral, part=part)
    assert np.isin(whole.worst, part.cells).all()
    assert shape.q.min() == whole.q.min()
    np.testing.assert_array_equal(shape.heights, whole.heights)
    np.testing.assert_array_equal(shape.thickness, whole.thickness)


def test_the_lift_is_that_of_the_lattice_flow(live):
    pytest.importorskip("openaerostruct", reason="openaerostruct is not installed")
    shape = live.at(live.neutral.with_value(number(live, "twist"), 3.0))
    area = live.lift.lattice.area
    problem = om.Problem(LatticeFlow(model=live.model, reference_area=area), reports=None)
    problem.setup()
    problem.set_val("grid", shape.nodes.ravel())
    problem.set_val("alpha", live.lift.alpha, units="deg")
    problem.set_val("Mach_number", live.lift.mach)
    problem.run_model()
    assert shape.lift == pytest.approx(problem.get_val("CL").item(), rel=1e-12)
    assert live.at(shape.design, with_lift=False).lift is None


def test_a_body_that_is_no_wing_has_no_lift_and_says_why():
    live = LiveModel(fit_grid(brick_grid((5, 5, 5, 5))))
    shape = live.at(live.neutral)
    assert shape.lift is None
    assert live.lift.why_not
    assert live.sliders


def test_tangled_cells_are_counted_and_named(live):
    row = a_row(live)
    shape = live.at(live.neutral.with_pull(row, (1.0, 0.0, 0.0)), with_lift=False)
    assert shape.n_inverted > 0
    assert shape.corners[shape.worst[0]] <= 0.0


def test_what_cannot_be_deformed_is_an_error_of_one_line(live):
    with pytest.raises((InputError, MovementError)):
        live.at(live.neutral.with_pull(a_row(live), (np.nan, 0.0, 0.0)))


def test_the_sliders_asked_for_go_to_their_ends_and_back():
    slider = asked_slider("rotate=25deg@chord 0.7,blend=0.05")
    assert (slider.low, slider.high, slider.neutral) == (-25.0, 25.0, 0.0)
    assert slider.words(5.0) == "rotate=5deg@chord 0.7,blend=0.05"
    assert asked_slider("stretch=1.25").low == pytest.approx(0.8)
    for text in ("translate=0.1/0/0", "stretch=1", "twist=0deg", "twist=1deg+stretch=2", "twist=0.1rad"):
        with pytest.raises(InputError, match="deformation"):
            asked_slider(text)


def test_history_goes_back_and_forth_and_a_drag_is_one_step():
    start = Design((0.0, 1.0))
    history = History(start)
    for value in (0.1, 0.2, 0.3):
        history.change(start.with_value(0, value), "twist")
    history.settle()
    history.change(history.now.with_value(0, 0.4), "twist")
    assert len(history.before) == 2
    assert history.undo()
    assert history.now.values == (0.3, 1.0)
    assert history.undo()
    assert history.now == start
    assert not history.undo()
    assert history.redo()
    assert history.now.values == (0.3, 1.0)
    history.change(history.now.with_pull(3, (1.0, 0.0, 0.0)), "point 3")
    assert not history.redo()
    assert history.now.with_pull(3, (0.0, 0.0, 0.0)).pulls == ()


def test_what_is_drawn_is_of_the_grid(live):
    topology, nodes = live.model.topology, live.baseline
    walls = Drawn.of(topology)
    assert walls.n_walls == len(walls.quads)
    np.testing.assert_array_equal(np.unique(nodes[walls.rows], axis=0), np.unique(live.surface.points, axis=0))
    for symmetry, direction in ((True, None), (True, 2), (False, 0)):
        drawn = Drawn.of(topology, symmetry, direction, 0.4)
        assert len(drawn.quads) > drawn.n_walls == walls.n_walls
        corners = corners_of(live.model, drawn.cells)  # rows of the nodes of the cell at each quad
        assert all(np.isin(rows, of_cell).all() for rows, of_cell in zip(drawn.rows[drawn.quads], corners))
    rows = live.quality.first_cells.wall_rows
    found = walls.of_nodes(rows, np.full(len(rows), 2.0), 1.0)
    assert set(np.unique(found)) <= {1.0, 2.0}
    assert np.mean(found == 2.0) > 0.9


def test_files_of_a_shape_hold_it(live, tmp_path):
    shape = live.at(live.neutral.with_value(number(live, "twist"), 5.0), with_lift=False)
    write_shape(tmp_path / "moved.xyz", live, shape)
    np.testing.assert_array_equal(read_grid(tmp_path / "moved.xyz").to_vector().reshape(-1, 3), shape.nodes)
    study, file = write_shape(tmp_path / "study.toml", live, shape)
    assert f'file = "{file.name}"' in study.read_text()
    np.testing.assert_allclose(FittedModel.load(file).local_nodes(), shape.nodes, rtol=0.0, atol=1e-13)
    with pytest.raises(InputError, match="another name"):
        write_shape(tmp_path / "study.toml", live, shape)
    assert free_name(tmp_path, "study", ".toml").name == "study_1.toml"


@pytest.mark.slow
def test_a_snapshot_is_a_report_and_walls_are_cad(live, tmp_path):
    shape = live.at(live.neutral.with_value(number(live, "twist"), 5.0), with_lift=False)
    pytest.importorskip("plotly", reason="plotly is not installed")
    pytest.importorskip("jinja2", reason="jinja2 is not installed")
    write_shape(tmp_path / "wing.html", live, shape)
    assert "twist=5deg" in (tmp_path / "wing.html").read_text()
    pytest.importorskip("OCP", reason="OpenCascade is not installed")
    write_shape(tmp_path / "wing.step", live, shape)
    assert (tmp_path / "wing.step").read_text().startswith("ISO-10303-21")
