"""Pictures of meshes without structure: markers, slices, the lattice, and fields on the faces of their cells."""

from dataclasses import replace

import numpy as np
import openmdao.api as om
import pytest
from mesh_cases import body_model, section_model, smooth_change

from bspline_mdao import DesignSurface, InputError
from bspline_mdao.design import Twist
from bspline_mdao.flow import Snapshot
from bspline_mdao.grids.cells.mesh_quality import mesh_quality
from bspline_mdao.grids.cells.mixed_quality import MixedQuality
from bspline_mdao.plotting import plot, sheets_of
from bspline_mdao.studio.plotting import plot as drawing
from bspline_mdao.studio.plotting.html import html_of
from bspline_mdao.studio.plotting.panels import Panel, camera_of
from bspline_mdao.studio.plotting.scenes import polygons
from bspline_mdao.studio.plotting.view import view_of

image = pytest.importorskip("matplotlib.image", reason="matplotlib is not installed")
SIZE = (240, 160)


@pytest.fixture
def by_matplotlib(monkeypatch):
    monkeypatch.setattr(drawing, "has_renderer", lambda: False)


def moved(model) -> Snapshot:
    """A mesh after a smooth move."""
    change = smooth_change(model, np.random.default_rng(5), 0.03)
    points = model.mover.move(model.control_points, model.mesh.points[model.wall_rows] + change).points
    return Snapshot(model.with_nodes(model.node_map.at(points).nodes), "after", model, points)


def coloured(path) -> float:
    """Part of the pixels that is coloured."""
    return float((np.ptp(image.imread(path)[..., :3], axis=-1) > 0.1).mean())


@pytest.mark.parametrize("show", [None, "boundary", "quality", ("walls", "lattice"), ("body", "slice y=0.5")])
def test_a_mesh_is_plotted_into_a_picture(show, by_matplotlib, tmp_path):
    path = body_model().plot(show, tmp_path / "mesh.png", size=SIZE)
    pixels = image.imread(path)[..., :3]
    assert pixels.shape[:2] == (160, 240)
    assert (pixels.min(axis=-1) < 0.9).mean() > 0.01


def test_before_and_after_stand_side_by_side_in_the_same_colours(by_matplotlib, tmp_path):
    model = section_model()
    plot(moved(model), "displacement", tmp_path / "both.png", before=model, size=SIZE)
    assert image.imread(tmp_path / "both.png").shape[:2] == (160, 480)
    assert coloured(tmp_path / "both.png") > 0.05


def test_fields_of_a_face_are_those_of_the_cell_behind_it():
    model, state = body_model(), moved(body_model())
    found = {
        "quality": mesh_quality(state.grid).cell_angles,
        "pyramid": MixedQuality.of(model.mesh, model.walls.faces).cell_ratios(state.grid.points),
    }
    faces, cells = model.mesh.cell_faces
    for name, of_cells in found.items():
        (sheet,) = sheets_of(state, ("body",), name)
        (values,) = sheet.values.values()
        assert len(sheet.quads) == len(model.mesh.markers["body"])
        for quad, value in zip(sheet.corners[sheet.quads[:40]], values):
            ends = np.abs(state.grid.points[faces] - quad).max(axis=(1, 2)) == 0.0
            assert value in of_cells[cells[ends]]


def test_a_slice_parts_the_cells_on_either_side():
    mesh = body_model().mesh
    (sheet,) = sheets_of(body_model(), ("slice y=0.6",))
    middles = sheet.corners[sheet.quads].mean(axis=1)
    assert np.ptp(middles[:, 0]) > 0.8 * np.ptp(mesh.points[:, 0])
    assert np.abs(middles[:, 1] - 0.6).max() < 0.25  # a cell is as high as that
    is_in_body = (np.abs(middles[:, 0]) < 0.1) & (np.abs(middles[:, 2]) < 0.2)
    assert not is_in_body.any()


def test_a_section_is_seen_across_its_plane_with_the_stream_to_the_right():
    state = Snapshot.of(section_model())
    panel = Panel.of(state, ("walls", "symmetry"), None, 0)
    right, up, towards = camera_of([panel]).axes()
    assert right == pytest.approx([1.0, 0.0, 0.0], abs=1e-9)
    assert up[2] > 0.99
    assert abs(towards[1]) > 0.99
    assert camera_of([panel], focus=(0.5, 0.0, 0.0)).focus == (0.5, 0.0, 0.0)
    (plane,) = sheets_of(state, ("symmetry",))
    assert len(plane.quads) == section_model().mesh.n_cells


def test_the_lattice_moves_with_its_control_points():
    model, state = body_model(), moved(body_model())
    before, after = (sheets_of(what, ("lattice",))[0] for what in (model, state))
    assert np.array_equal(before.quads, after.quads)
    n = len(model.wall_rows)
    shift = np.linalg.norm(after.corners - before.corners, axis=1).max()
    assert 0.0 < shift <= np.linalg.norm(state.control_points[n:] - model.control_points[n:], axis=1).max()
    ends = np.stack([before.corners[before.quads], before.corners[np.roll(before.quads, 1, axis=1)]])
    assert (np.abs(ends[0] - ends[1]) > 1e-9).sum(axis=-1).max() == 1  # its lines are along its directions


@pytest.mark.parametrize(
    ("show", "advice"),
    [
        ("wing", "no 'wing'; choose from walls.*patches body, far_00"),
        ("Cp", "no 'Cp'"),
        ("slice y=9.0", "no cell is at 'slice y=9.0'"),
        (("quality", "pyramid"), "one field at a time"),
    ],
)
def test_what_cannot_be_shown_is_said_in_one_line(show, advice, tmp_path):
    with pytest.raises(InputError, match=advice):
        body_model().plot(show, tmp_path / "a.png")


def test_a_bare_mesh_is_shown_by_guessed_markers_and_has_no_lattice():
    mesh = body_model().mesh
    assert view_of(mesh, Snapshot.of(mesh)).kinds["body"] == "wall"
    with pytest.raises(InputError, match="fit it first"):
        sheets_of(mesh, ("lattice",))
    state = Snapshot.of(body_model())
    with pytest.raises(InputError, match="name it body"):
        replace(state, title="body").write("body.vtm")


def test_a_problem_on_a_mesh_is_shown_as_it_is_now():
    design = DesignSurface.of(section_model())
    problem = om.Problem(design.grid_movement([Twist("twist", design.axis, stations=1)]), reports=None)
    problem.setup()
    problem.set_val("twist", 3.0)
    problem.run_model()
    (sheet,) = sheets_of(problem, ("airfoil",), "displacement")
    assert sheet.values["displacement"].max() > 1e-3


def test_a_notebook_shows_a_table_and_a_picture():
    text = html_of(body_model())
    assert "tetra" in text
    assert "data:image/png" in text


def test_triangles_have_three_corners_for_pyvista():
    quads = np.array([[0, 1, 2, 2], [1, 2, 3, 4]])
    assert polygons(quads).tolist() == [3, 0, 1, 2, 4, 1, 2, 3, 4]
