"""Figures are written in one style, and what is missing for them is said in one line."""

import subprocess
import sys

import numpy as np
import pytest

import bspline_mdao.plotting
from bspline_mdao import InputError
from bspline_mdao.plotting import BLUE, draw_net, figure
from bspline_mdao.studio.plotting.figures import net_quads, require

image = pytest.importorskip("matplotlib.image", reason="matplotlib is not installed")


@pytest.mark.slow
def test_importing_the_pictures_loads_no_library_that_draws():
    code = (
        "import sys, bspline_mdao.plotting as p\n"
        "p.draw_net; p.draw_scene; p.draw_first_heights; p.draw_designs\n"
        "print(sorted({'matplotlib', 'pyvista', 'PIL'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.stdout.strip() == "[]", done.stderr


def test_every_public_name_can_be_imported():
    for name in bspline_mdao.plotting.__all__:
        assert getattr(bspline_mdao.plotting, name) is not None


def test_a_missing_library_is_an_error_that_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)  # as if it were not installed
    message = r'pictures need matplotlib: pip install "bspline_mdao\[pictures\]"$'
    with pytest.raises(InputError, match=message), figure(tmp_path / "new", "empty", (1.0, 1.0)):
        pass
    assert not (tmp_path / "new").exists()
    with pytest.raises(InputError, match="pictures need no_such_library"):
        require("no_such_library.part")


def test_a_figure_is_saved_with_what_was_drawn_into_it(tmp_path):
    with figure(tmp_path / "new", "lines", (2.0, 1.0)) as canvas:
        axes = canvas.subplots()
        axes.axvspan(0.0, 1.0, color="red")
        axes.set(xlim=(0.0, 1.0))
        axes.set_axis_off()
    pixels = image.imread(tmp_path / "new" / "lines.png")
    assert pixels.shape[:2] == (200, 400)
    assert (np.abs(pixels[..., :3] - [1.0, 0.0, 0.0]).max(axis=-1) < 0.01).mean() > 0.8


def test_a_figure_of_few_colours_is_a_smaller_file_of_the_same_picture(tmp_path):
    lines = np.random.default_rng(0).uniform(size=(2, 200, 2))
    for name, n_colours in (("all", None), ("few", 16)):
        with figure(tmp_path, name, (2.0, 1.0), n_colours) as canvas:
            canvas.subplots().plot(*lines, color="blue", linewidth=0.2)
    every, few = (image.imread(tmp_path / f"{name}.png")[..., :3] for name in ("all", "few"))
    assert np.abs(every - few).mean() < 0.03
    assert len(np.unique(few.reshape(-1, 3), axis=0)) <= 16 < len(np.unique(every.reshape(-1, 3), axis=0))
    assert 2 * (tmp_path / "few.png").stat().st_size < (tmp_path / "all.png").stat().st_size


def test_a_thin_line_keeps_its_colour_beside_a_map_of_many(tmp_path):
    for name, n_colours in (("all", None), ("few", 32)):
        with figure(tmp_path, name, (4.0, 2.0), n_colours) as canvas:
            shades, line = canvas.subplots(1, 2)
            shades.pcolormesh(np.random.default_rng(1).uniform(size=(12, 10)), cmap="turbo")
            line.plot(np.random.default_rng(2).uniform(size=5), color=BLUE, linewidth=1.0)
    every, few = (np.rint(255.0 * image.imread(tmp_path / f"{name}.png")[..., :3]) for name in ("all", "few"))
    is_line = (np.abs(every - [0x00, 0x72, 0xB2]) < 1.0).all(axis=-1)
    assert is_line.any()
    assert np.abs(few - every)[is_line].max() < 24.0


def test_a_net_is_drawn_by_the_lines_of_both_directions(tmp_path):
    net = np.random.default_rng(0).normal(size=(3, 4, 2))
    with figure(tmp_path, "net", (1.0, 1.0)) as canvas:
        axes = canvas.subplots()
        draw_net(axes, net, color="blue")
    lines = [line.get_xydata() for line in axes.lines]
    assert len(lines) == 3 + 4
    for line, expected in zip(lines, [*net, *net.swapaxes(0, 1)]):
        np.testing.assert_array_equal(line, expected)


def test_quads_of_a_net_go_around():
    i, j = np.meshgrid(np.arange(3.0), np.arange(4.0), indexing="ij")
    quads = net_quads(np.stack([i, j], axis=-1))
    assert quads.shape == (6, 4, 2)
    np.testing.assert_array_equal(quads[0], [[0, 0], [1, 0], [1, 1], [0, 1]])
