"""Scenes are seen from where the camera stands, whatever library draws them."""

import sys

import numpy as np
import pytest

from bspline_mdao import fit_grid
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.plotting import Camera, Paint, Scene, draw_scene, figure, patch_faces
from bspline_mdao.studio.plotting import scenes
from bspline_mdao.studio.plotting.scenes import has_renderer

image = pytest.importorskip("matplotlib.image", reason="matplotlib is not installed")
CAMERA = Camera(focus=(1.0, 0.5, 0.0), direction=(0.0, 0.0, 1.0), height=2.0)
NET = np.stack(np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0], [0.0], indexing="ij"), axis=-1)[:, :, 0]
POINTS = np.array(
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0]]
)
PAINT = Paint(POINTS, np.array([[0, 1, 2, 3], [1, 4, 5, 2]]), np.array([-1.0, 0.5]), (-1.0, 0.5))


@pytest.fixture
def without_renderer(monkeypatch):
    monkeypatch.setattr(scenes, "has_renderer", lambda: False)


def test_a_missing_renderer_is_told_in_one_line(monkeypatch, capsys):
    monkeypatch.setattr(sys, "executable", "false")  # ends at once, as PyVista does without OpenGL
    assert not has_renderer.__wrapped__()
    message = capsys.readouterr().err
    assert "install libegl1" in message
    assert message.count("\n") == 1


def test_camera_looks_along_its_direction():
    camera = Camera(focus=(1.0, 2.0, 3.0), direction=(1.0, 1.0, 2.0), height=1.0)
    right, up, towards = camera.axes()
    np.testing.assert_allclose(camera.axes() @ camera.axes().T, np.eye(3), atol=1e-15)
    assert right[1] == 0.0
    assert up[1] > 0.0
    np.testing.assert_allclose(camera.project(np.array([1.0, 2.0, 3.0]) + 2.0 * towards), [0.0, 0.0, 2.0], atol=1e-15)


def test_painted_faces_have_the_colours_of_their_values(without_renderer, tmp_path):
    with figure(tmp_path, "painted", (2.0, 2.0)) as canvas:
        axes = canvas.subplots()
        assert draw_scene(axes, Scene([], [], paint=PAINT), CAMERA, (2.0, 2.0)) == "matplotlib"
    np.testing.assert_allclose(axes.collections[0].get_facecolors(), PAINT.mappable().to_rgba([-1.0, 0.5]))


def test_marks_are_drawn_over_walls_and_walls_over_planes(without_renderer, tmp_path):
    scene = Scene([NET + [0.0, 0.0, 0.2]], [NET], marks=np.array([[1.5, 0.5, 0.3]]))
    with figure(tmp_path, "scene", (2.0, 2.0)) as canvas:
        axes = canvas.subplots()
        draw_scene(axes, scene, CAMERA, (2.0, 2.0))
    faces = axes.collections[0].get_facecolors()
    assert len(faces) == 2 + 2 + 1
    np.testing.assert_allclose(axes.collections[0].get_paths()[0].vertices.min(axis=0), [-1.0, -0.5])
    is_red = (np.ptp(faces[:, :3], axis=1) > 0.5) & (faces[:, 0] > 0.5)
    assert is_red.tolist() == [False, False, False, False, True]
    pixels = image.imread(tmp_path / "scene.png")[..., :3]
    assert (np.abs(pixels - 1.0).max(axis=-1) > 0.02).mean() > 0.4


@pytest.mark.slow
def test_a_rendered_scene_fills_its_part_of_the_picture(tmp_path):
    if not has_renderer():
        pytest.skip("PyVista does not render here")
    with figure(tmp_path, "scene", (2.0, 2.0)) as canvas:
        axes = canvas.subplots()
        assert draw_scene(axes, Scene([NET], [], paint=None), CAMERA, (2.0, 2.0)) == "pyvista"
    pixels = image.imread(tmp_path / "scene.png")[..., :3]
    rows, columns = np.nonzero(np.abs(pixels - 1.0).max(axis=-1) > 0.1)
    assert (np.ptp(rows), np.ptp(columns)) == pytest.approx((399, 399), abs=12)  # the frame of the axes
    inside = np.abs(pixels[:, 200] - 1.0).max(axis=-1) > 0.1
    assert inside.mean() == pytest.approx(0.5, abs=0.05)  # the net is half as high as what is shown


@pytest.mark.slow
def test_faces_of_patches_are_cut_at_any_resolution():
    model = fit_grid(onera_m6_grid((7, 6, 5)), n_control=(5, 5, 4))
    nodes = [block.nodes for block in model.regenerate().blocks]
    for arrays, shape in ((nodes, (7, 5, 3)), (model.mesh.nets(model.control_points), (5, 4, 3))):
        faces = patch_faces(model, "wing", arrays)
        assert [face.shape for face in faces] == [shape, shape]
        np.testing.assert_allclose(faces[0][0], faces[1][0], atol=1e-9)  # one leading edge
