"""Cells next to walls are drawn where they are, inverted ones in red, and heights in the order of their size."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_cases import body_model, section_model

from bspline_mdao.errors import InputError
from bspline_mdao.flow import Snapshot
from bspline_mdao.generators import Spacing, infinite_wing_grid, naca_section
from bspline_mdao.plotting import RED, draw_first_heights, draw_wall_cells
from bspline_mdao.studio.plotting import boundary_layers
from bspline_mdao.studio.plotting.edge_cells import edge_cells_of

image = pytest.importorskip("matplotlib.image", reason="matplotlib is not installed")
colors = pytest.importorskip("matplotlib.colors")


@pytest.mark.slow
def test_inverted_cells_at_the_wall_are_red(tmp_path):
    grid = infinite_wing_grid(naca_section(), (9, 13), Spacing(off_wall=1e-3, leading=5e-3, trailing=5e-3))
    nodes = grid.to_vector().reshape(-1, 3)
    broken = grid.with_vector(nodes.ravel().copy())
    for patch in grid.patches:
        for window in patch.windows if patch.kind == "wall" else ():
            flat = window.shape.index(1)
            layers = np.moveaxis(broken.blocks[window.block].nodes, flat, 0)[:: 1 if window.lo[flat] == 0 else -1]
            layers[[1, 2]] = layers[[2, 1]]
    broken = broken.to_vector().reshape(-1, 3)
    draw_wall_cells(tmp_path, "cells", grid, {"before": nodes, "after": broken})
    pixels = image.imread(tmp_path / "cells.png")[..., :3]
    is_red = np.abs(pixels - colors.to_rgb(RED)).max(axis=-1) < 0.3
    half = len(pixels) // 2
    assert not is_red[:half].any()
    assert is_red[half:].sum() > 50
    assert ((pixels < 0.2).all(axis=-1)).sum() > 100  # the wall


@pytest.mark.parametrize(("make", "n_views"), [(section_model, 2), (body_model, 3)], ids=["section", "body"])
def test_inverted_cells_of_a_mesh_are_red_in_its_slices(tmp_path, make, n_views):
    model, random = make(), np.random.default_rng(1)
    nodes = model.mesh.points
    cells = edge_cells_of(model.mesh, Snapshot.of(model))
    assert len(cells.edges) == n_views
    broken = nodes.copy()
    rows = np.setdiff1d(np.arange(len(nodes)), model.wall_rows)
    broken[rows] += 0.3 * random.normal(size=(len(rows), 3)) * (np.ptp(nodes, axis=0) > 1.0)
    for edge in cells.edges:
        before, after = (cells.around(edge, each, 0.5) for each in (nodes, broken))
        assert (len(before.bad), len(after.bad) > 3) == (0, True)
        assert len(before.good) > 10
        right, side = cells.directions.seen(edge)[0], -1.0 if edge == "leading edge" else 1.0
        assert before.centre[0] == pytest.approx(side * (side * nodes[model.wall_rows, right]).max(), abs=1e-2)
    draw_wall_cells(tmp_path, "cells", model, {"before": nodes, "after": broken})
    pixels = image.imread(tmp_path / "cells.png")[..., :3]
    is_red = np.abs(pixels - colors.to_rgb(RED)).max(axis=-1) < 0.3
    half = len(pixels) // 2
    assert 50 * is_red[:half].sum() < is_red[half:].sum()  # colours are few, so that some thin lines are nearly red
    assert is_red[half:].sum() > 500


def test_a_mesh_without_walls_is_refused():
    mesh = replace(body_model().mesh, markers={})
    with pytest.raises(InputError, match="no marker is a wall; give the model of the mesh, with their kinds"):
        edge_cells_of(mesh, Snapshot.of(mesh))


def test_heights_are_drawn_from_the_lowest_to_the_highest(tmp_path, monkeypatch):
    drawn, plain = [], boundary_layers.figure

    class Kept:
        def __init__(self, *arguments, **keywords):
            self.figure = plain(*arguments, **keywords)

        def __enter__(self):
            drawn.append(self.figure.__enter__())
            return drawn[-1]

        def __exit__(self, *error):
            return self.figure.__exit__(*error)

    monkeypatch.setattr(boundary_layers, "figure", Kept)
    ratios = np.array([1.1, 0.1, 0.9, 5.0])
    draw_first_heights(tmp_path, "heights", {"pitch": {"one": ratios, "two": np.ones(4)}})
    (axes,) = drawn[0].axes
    np.testing.assert_allclose(axes.lines[0].get_xydata(), [[0.0, 0.4], [100 / 3, 0.9], [200 / 3, 1.1], [100.0, 2.5]])
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["one", "two"]
