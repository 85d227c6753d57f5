"""Spans of a lattice: narrow at small bodies and in gaps, as stiff there as elsewhere, no more than memory holds."""

import re

import numpy as np
import pytest
from mesh_cases import mesh_around_a_body, mesh_around_two_sections

from bspline_mdao.core.background import lattice_spans
from bspline_mdao.core.background.lattice_line import LatticeLine
from bspline_mdao.core.background.lattice_settings import LatticeSettings
from bspline_mdao.core.background.mesh_model import MeshModel
from bspline_mdao.core.background.thin_gaps import thin_gaps
from bspline_mdao.core.background.wall_widths import graded_breaks
from bspline_mdao.errors import InputError

GAP = 0.03


@pytest.fixture(scope="module")
def two() -> MeshModel:
    """A section of two bodies that are close to each other."""
    return MeshModel.of(*mesh_around_two_sections(GAP))


def gaps_of(model: MeshModel):
    """Gaps that the lattice of a model does not resolve."""
    walls = np.searchsorted(model.wall_rows, model.walls.faces)
    return thin_gaps(model.lattice, model.mesh.points[model.wall_rows], walls)


def test_a_body_has_ten_spans_along_its_longest_side_and_a_gap_two_across(two):
    for name, length in (("main", 1.0), ("flap", 0.1)):
        rows = np.unique((two.mesh.markers or {})[name])
        ends = two.mesh.points[rows, 0].min(), two.mesh.points[rows, 0].max()
        breaks = two.lattice.lines[0].breaks
        assert np.diff(breaks)[(breaks[1:] > ends[0]) & (breaks[:-1] < ends[1])].max() <= 0.1001 * length * 1.8**0.5
    low = two.mesh.points[np.unique((two.mesh.markers or {})["flap"]), 1].max()
    breaks = two.lattice.lines[1].breaks
    in_gap = (breaks[1:] > low) & (breaks[:-1] < low + GAP)
    assert np.diff(breaks)[in_gap].max() <= 0.5 * GAP * 1.1
    assert not gaps_of(two)


def test_spans_grow_by_the_ratio_at_most_between_what_asks_for_narrow_ones():
    growth, asked = 1.6, [(0.0, 10.0, 1.0), (3.0, 3.3, 0.02), (7.0, 7.0, 0.005)]
    breaks = graded_breaks((0.0, 10.0), asked, growth)
    widths = np.diff(breaks)
    assert breaks[0] == 0.0
    assert breaks[-1] == 10.0
    ratios = widths[1:] / widths[:-1]
    assert max(ratios.max(), 1.0 / ratios.min()) < 1.05 * growth
    assert widths.max() <= 1.0
    assert widths[(breaks[1:] > 3.0) & (breaks[:-1] < 3.3)].max() < 0.02 * 1.3
    assert widths.min() < 0.006


def test_narrow_spans_are_as_stiff_as_the_wide_ones_that_they_replace():
    box, even = (0.0, 10.0), np.linspace(0.0, 10.0, 11)
    narrow = graded_breaks((0.0, 10.0), [(0.0, 10.0, 1.0), (4.0, 4.2, 0.03)], 1.8)
    energies = []
    for inner in (even, narrow):
        line = LatticeLine.between(box, inner, 1.0, 1.8, 1e9)
        knots = line.coordinate_knots
        square = (knots[1:-3] * knots[2:-2] + knots[1:-3] * knots[3:-1] + knots[2:-2] * knots[3:-1]) / 3.0  # of x^2
        assert len(square) == line.n_control
        energies.append([square @ (gram @ square) for gram in line.gram])
        assert line.gram[2].shape == (line.n_control, line.n_control)
    assert energies[1] == pytest.approx(energies[0], rel=1e-8)
    assert len(narrow) > 2 * len(even)


def test_walls_in_narrow_elements_weigh_as_much_less_as_there_is_less_of_them(two):
    walls = two.mesh.points[two.wall_rows]
    parts = [
        (np.diff(line.breaks) / line.scales)[line.spans(walls[:, axis])]
        for axis, line in enumerate(two.lattice.lines[:2])
    ]
    elements = two.lattice.elements(walls)
    weights = np.bincount(elements, two.mover._weights)[elements]
    np.testing.assert_allclose(weights, 1e4 * np.sqrt(parts[0] * parts[1]), rtol=1e-12)
    assert weights.min() < 3e3
    even = two.with_settings(LatticeSettings(spacing=0.1))
    elements = even.lattice.elements(walls)
    np.testing.assert_allclose(np.bincount(elements, even.mover._weights)[elements], 1e4, rtol=1e-12)


def test_a_small_body_that_leaves_a_large_one_takes_the_cells_between_along(two):
    rows = np.searchsorted(two.wall_rows, np.unique((two.mesh.markers or {})["flap"]))
    change = np.zeros((len(two.wall_rows), 3))
    change[rows, :2] = [0.02, 0.4 * GAP]
    asked = two.mesh.points[two.wall_rows] + change
    worst = []
    for model in (two, two.with_settings(LatticeSettings(spacing=0.1))):
        movement = model.mover.move(model.control_points, asked)
        lattice = movement.points[len(asked) :] - model.lattice.control_points
        missed = model.lattice.evaluator(model.mesh.points[model.wall_rows]).forward(lattice) - change
        nodes = model.node_map.at(movement.points).nodes
        volumes = model.mesh.quality(nodes).volumes / model.mesh.quality().volumes
        worst.append((np.linalg.norm(missed, axis=1).max(), volumes.min()))
    assert worst[0][0] < 0.25 * worst[1][0]
    assert worst[0][1] > 0.3
    assert worst[0][1] > 1.1 * worst[1][1]


def test_gaps_thinner_than_a_span_are_named_with_how_thin_they_are(two):
    (gap,) = gaps_of(two.with_settings(LatticeSettings(spacing=0.1)))
    assert gap.width == pytest.approx(GAP, rel=0.2)
    assert gap.span == pytest.approx(0.1, rel=0.15)
    walls = two.mesh.points[two.wall_rows]
    assert np.linalg.norm(walls[gap.rows[0]] - walls[gap.rows[1]]) == pytest.approx(gap.width)


def test_a_lattice_that_memory_does_not_hold_is_refused_with_a_spacing_that_it_does(monkeypatch):
    mesh, kinds = mesh_around_a_body()
    with pytest.raises(
        InputError, match=r"control points takes .* GB to move, and .* take --spacing .* of 'fit'"
    ) as refused:
        MeshModel.of(mesh, kinds, LatticeSettings(spacing=1e-3))
    assert "\n" not in str(refused.value)
    monkeypatch.setattr(lattice_spans, "available_bytes", lambda: 1e8)
    with pytest.raises(InputError) as refused:
        MeshModel.of(mesh, kinds, LatticeSettings(spacing=0.05))
    spacing = float(re.search(r"--spacing ([\d.e-]+) of", str(refused.value))[1])
    assert MeshModel.of(mesh, kinds, LatticeSettings(spacing=spacing)).lattice.n_control > 1000
    with pytest.raises(InputError):
        MeshModel.of(mesh, kinds, LatticeSettings(spacing=0.7 * spacing))


def test_small_bodies_have_wider_spans_where_a_lattice_would_be_too_large(two, monkeypatch):
    monkeypatch.setattr(lattice_spans, "WITHOUT_ASKING", 0.3 * lattice_spans.factor_bytes(two.lattice))
    fewer = two.with_settings(LatticeSettings())
    assert fewer.lattice.spacing > 1.5 * two.lattice.spacing
    assert lattice_spans.factor_bytes(fewer.lattice) <= lattice_spans.WITHOUT_ASKING


def test_refined_spans_are_kept_in_the_file_of_a_model(tmp_path, two):
    settings = LatticeSettings(refined=((0, 0.1, 0.2, 0.01), (1, -0.05, 0.0, 0.02)))
    model = two.with_settings(settings)
    model.save(tmp_path / "two.h5")
    found = MeshModel.load(tmp_path / "two.h5")
    assert found.settings == settings
    assert all(np.array_equal(a.breaks, b.breaks) for a, b in zip(found.lattice.lines, model.lattice.lines))
    breaks = model.lattice.lines[0].breaks
    assert np.diff(breaks)[(breaks[1:] > 0.1) & (breaks[:-1] < 0.2)].max() < 0.0115


def test_a_far_field_at_a_thousand_sizes_takes_few_spans_and_those_near_the_walls_stay_as_they_are():
    inner = np.linspace(0.0, 1.0, 11)
    near, far = (LatticeLine.between((-end, end), inner, 0.1, 1.8, 10.0) for end in (100.0, 1000.0))
    assert far.n_control <= near.n_control + 4
    assert far.n_control <= 37
    for line in (near, far):
        widths = np.diff(line.breaks)
        ratios = widths[1:] / widths[:-1]
        assert max(ratios.max(), 1.0 / ratios.min()) < 1.8**3 * 1.001
        is_near = (line.breaks[:-1] > -10.0) & (line.breaks[1:] < 10.0)
        assert np.allclose(
            widths[is_near][5:], np.diff(near.breaks)[(near.breaks[:-1] > -10) & (near.breaks[1:] < 10)][5:]
        )
        assert np.array_equal(line.breaks[[0, -1]], [-line.breaks[-1], line.breaks[-1]])
