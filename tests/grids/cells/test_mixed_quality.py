"""Bounds of cells of mixed kinds: what they are below, their derivatives, and cells that are named."""

import numpy as np
import pytest
from mesh_cases import body_model, combs, mesh_around_a_body, section_model

from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.grid_quality import GridValues
from bspline_mdao.grids.cells.mixed_cells import MixedMesh, _wall_normals
from bspline_mdao.grids.cells.mixed_quality import MixedQuality, MixedReport
from bspline_mdao.grids.cells.node_heights import NodeHeights
from bspline_mdao.grids.cells.pyramids import Pyramids
from bspline_mdao.grids.cells.quads import rings

CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1.0]])

NONE = np.zeros((0, 4), dtype=int)


def mixed(rng) -> MixedMesh:
    """A hexahedron, a pyramid on it, a prism and a tetrahedron beside it, and a polyhedron, all a little bent."""
    more = np.array([[0.5, 0.5, 1.8], [2.0, 0.4, 0.1], [1.9, 0.5, 1.1], [1.5, 1.8, 0.3]])
    points = np.concatenate([CUBE, more]) + 0.05 * rng.standard_normal((12, 3))
    cells = {
        "hexahedron": np.array([[0, 1, 2, 3, 4, 5, 6, 7]]),
        "pyramid": np.array([[4, 5, 6, 7, 8]]),
        "wedge": np.array([[1, 9, 2, 5, 10, 6]]),
        "tetra": np.array([[1, 9, 2, 11]]),
    }
    # seen from a polyhedron, the corner of a triangle that is there twice may come first
    polyhedron = np.array([[0, 0, 1, 3], [0, 4, 1, 1], [1, 4, 3, 3], [3, 4, 0, 0]])[:, ::-1]
    return MixedMesh(points, cells, polyhedra=(np.ascontiguousarray(polyhedron), np.zeros(4, dtype=int)))


def volumes(x, faces, cells, n):
    """Volumes of pyramids, real or complex, one face after the other."""
    middles, areas = [], []
    for face in faces:
        corners = x[[id for k, id in enumerate(face) if id != face[k - 1]]]
        middles.append(corners.mean(axis=0))
        areas.append(0.5 * sum(np.cross(corners[k], corners[k + 1]) for k in range(-1, len(corners) - 1)))
    middles, areas = np.array(middles), np.array(areas)
    sizes = np.sqrt((areas * areas).sum(axis=1))
    centres = [(sizes[:, None] * middles)[cells == c].sum(axis=0) / sizes[cells == c].sum() for c in range(n)]
    return ((middles - np.array(centres)[cells]) * areas).sum(axis=1) / 3.0


def test_pyramids_are_those_of_every_kind_of_cell_and_their_products_are_exact():
    rng = np.random.default_rng(1)
    mesh = mixed(rng)
    found = Pyramids.of(mesh.points, *mesh.cell_faces, mesh.n_cells)
    expected = volumes(mesh.points, *mesh.cell_faces, mesh.n_cells)
    np.testing.assert_allclose(found.volumes, expected, rtol=0, atol=1e-15)
    direction = rng.standard_normal(mesh.points.shape)
    step = volumes(mesh.points + 1e-30j * direction, *mesh.cell_faces, mesh.n_cells).imag / 1e-30
    np.testing.assert_allclose(found.jvp(direction), step, rtol=0, atol=1e-14)
    bar = rng.standard_normal(len(step))
    assert np.vdot(found.vjp(bar), direction) == pytest.approx(bar @ step, rel=1e-13)


def test_pieces_of_a_polygon_make_one_pyramid_with_exact_products():
    rng, mesh = np.random.default_rng(4), combs()
    points = mesh.points + 0.2 * np.sin(2.0 * mesh.points @ rng.standard_normal((3, 3)))
    found, (of_rows, cells) = mesh.pyramids(points), mesh.sides
    pieces = volumes(points, *mesh.cell_faces, mesh.n_cells)
    assert len(cells) == 8 * mesh.n_cells
    assert len(pieces) == 14 * mesh.n_cells
    np.testing.assert_array_equal(cells[of_rows], mesh.cell_faces[1])
    np.testing.assert_allclose(found.volumes, [pieces[of_rows == k].sum() for k in range(len(cells))], atol=1e-14)
    assert (pieces < 0.0).any()  # a piece may look the wrong way in a polygon that does not
    assert not mesh.quality(points).is_inverted.any()
    direction, bar = rng.standard_normal(points.shape), rng.standard_normal(len(cells))
    step = volumes(points + 1e-30j * direction, *mesh.cell_faces, mesh.n_cells).imag / 1e-30
    expected = np.bincount(of_rows, step)
    np.testing.assert_allclose(found.jvp(direction), expected, atol=1e-13)
    assert np.vdot(found.vjp(bar), direction) == pytest.approx(bar @ expected, rel=1e-12)


def test_bounds_of_polyhedra_are_those_of_whole_polygons():
    rng = np.random.default_rng(5)
    mesh = combs()
    quality = MixedQuality.of(mesh, NONE, rho=30.0)
    nodes = mesh.points + 0.2 * np.sin(2.0 * mesh.points @ rng.standard_normal((3, 3)))
    values = quality.evaluate(nodes)
    assert 0.0 < values.aggregates["volume_ks"] < quality.report(nodes).min_ratio
    assert quality.newly_inverted(nodes) == ""
    direction = rng.standard_normal(nodes.shape)
    change = quality.jvp(nodes, direction, values).aggregates["volume_ks"]
    reverse = quality.vjp(nodes, values, GridValues({"volume_ks": 1.7}))
    assert np.vdot(reverse, direction) == pytest.approx(1.7 * change, rel=1e-11)
    nodes[:, 2] *= -1.0
    assert quality.newly_inverted(nodes).startswith("polyhedron ")


def test_heights_are_along_normals_and_their_products_are_exact():
    rng, model = np.random.default_rng(2), body_model()
    heights = NodeHeights.of(model.mesh, model.walls.faces)
    assert len(heights.rows) > 50
    np.testing.assert_allclose(heights.ratios(1.3 * model.mesh.points), 1.3, rtol=1e-13)
    nodes = model.mesh.points + 0.01 * np.sin(3.0 * model.mesh.points)
    direction, step = np.sin(nodes @ rng.standard_normal((3, 3))), 1e-3
    at = {k: heights.ratios(nodes + k * step * direction) for k in (-2, -1, 1, 2)}
    slopes = (8.0 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12.0 * step)
    found, bar = heights.jvp(nodes, direction), rng.standard_normal(len(heights.rows))
    assert np.abs(slopes - found).max() < 1e-9 * np.abs(found).max()
    assert np.vdot(heights.vjp(nodes, bar), direction) == pytest.approx(bar @ found, rel=1e-12)


def test_heights_do_not_depend_on_which_corner_a_triangle_has_twice():
    model = body_model()
    faces = np.concatenate([model.walls.faces[:, [0, 1, 2, 2]], model.walls.faces[:, [0, 2, 3, 3]]])
    turned = faces[:, [1, 2, 0, 0]]
    ids, points = np.unique(faces), model.mesh.points
    np.testing.assert_allclose(_wall_normals(points, turned, ids), _wall_normals(points, faces, ids), atol=1e-15)
    heights, again = NodeHeights.of(model.mesh, faces), NodeHeights.of(model.mesh, turned)
    np.testing.assert_allclose(again.baseline, heights.baseline, rtol=1e-13)


def test_heights_among_some_nodes_are_those_of_all():
    rng, model = np.random.default_rng(4), body_model()
    heights, n = NodeHeights.of(model.mesh, model.walls.faces), model.mesh.n_points
    nodes = np.union1d(np.unique(model.walls.faces), rng.choice(n, n // 2, replace=False))
    some, points = heights.among(nodes), model.mesh.points + 0.01 * rng.standard_normal((n, 3))
    is_here = np.isin(heights.next_rows, nodes)
    assert 0 < is_here.sum() < len(is_here)
    np.testing.assert_array_equal(nodes[some.rows], heights.rows[is_here])
    np.testing.assert_array_equal(some.heights(points[nodes]), heights.heights(points)[is_here])


@pytest.mark.parametrize("make", [body_model, section_model])
def test_aggregates_bound_the_worst_and_their_products_are_exact(make):
    rng, model = np.random.default_rng(3), make()
    quality = model.judge(None, None, rho=20.0, p=8, rho_height=30.0)
    waves = 1.2 * np.eye(3)
    nodes = model.mesh.points + 0.005 * np.sin(model.mesh.points @ waves)
    values = quality.evaluate(nodes)
    assert tuple(values.aggregates) == ("volume_ks", "height_low_ks", "height_high_ks")
    report = quality.report(nodes)
    slack = np.log(len(quality.counted)) / 20.0
    assert report.min_ratio - slack < values.aggregates["volume_ks"] < report.min_ratio
    low, high = report.heights
    assert low - 0.3 < values.aggregates["height_low_ks"] < low
    assert high < values.aggregates["height_high_ks"] < high + 0.3
    direction, step = np.sin(nodes @ rng.standard_normal((3, 3))), 1e-4
    change = quality.jvp(nodes, direction, values).aggregates
    at = {k: quality.evaluate(nodes + k * step * direction).aggregates for k in (-2, -1, 1, 2)}
    for name, found in change.items():
        slope = (8.0 * (at[1][name] - at[-1][name]) - (at[2][name] - at[-2][name])) / (12.0 * step)
        assert slope == pytest.approx(found, rel=1e-7, abs=1e-7)
    seeds = {name: rng.standard_normal() for name in change}
    reverse = np.vdot(quality.vjp(nodes, values, GridValues(seeds)), direction)
    assert reverse == pytest.approx(sum(seeds[name] * change[name] for name in seeds), rel=1e-11)


def test_a_cell_that_is_inverted_is_named_with_the_marker_next_to_it():
    model = body_model()
    quality, nodes = model.judge(None, None, rho=100.0, p=8, rho_height=100.0), model.mesh.points.copy()
    assert quality.newly_inverted(nodes) == ""
    row = quality.heights.rows[0]
    nodes[quality.heights.next_rows[0]] = nodes[row] - 0.2 * (nodes[quality.heights.next_rows[0]] - nodes[row])
    message = quality.newly_inverted(nodes)
    assert message.startswith("tetra ")
    assert "next to marker 'body'" in message
    assert quality.evaluate(nodes, ["volume_ks"]).aggregates["volume_ks"] < 0.0


def test_cells_that_are_inverted_on_the_baseline_are_nobodys_fault():
    mesh, _ = mesh_around_a_body()
    points = mesh.points.copy()
    inner = np.setdiff1d(np.arange(len(points)), np.concatenate(list(mesh.markers.values())))[0]
    points[inner] += [0.0, 1.5, 0.0]
    folded = MixedMesh(points, mesh.cells, mesh.markers)
    quality = MixedQuality.of(folded, NONE)
    assert quality.was_inverted.any()
    assert quality.newly_inverted(points) == ""
    assert 0.8 < quality.evaluate(points, ["volume_ks"]).aggregates["volume_ks"] < 1.0


def test_what_cells_of_mixed_kinds_have_not_is_refused_in_one_line():
    quality = MixedQuality.of(mesh_around_a_body()[0], NONE)
    assert quality.aggregates == ("volume_ks",)
    with pytest.raises(InputError, match=r"'corner_ks' is for hexahedra in blocks.*choose from volume_ks"):
        quality.require(["corner_ks"])
    with pytest.raises(InputError, match=r"'height_low_ks'.*no nodes next to a wall"):
        quality.require(["height_low_ks"])
    with pytest.raises(InputError, match=r"no aggregate 'beauty'; choose from volume_ks"):
        quality.require(["beauty"])
    with pytest.raises(InputError, match=r"Q of every cell.*leave 'cells' out"):
        quality.require([], cells=True)


def test_each_cell_has_its_least_pyramid_by_that_before_and_a_name():
    model, rng = section_model(), np.random.default_rng(7)
    mesh, quality = model.mesh, MixedQuality.of(model.mesh, model.walls.faces)
    nodes = mesh.points + 1e-3 * rng.normal(size=mesh.points.shape)
    ratios, report = quality.cell_ratios(nodes), quality.report(nodes)
    assert ratios.min() == report.min_ratio
    assert ((ratios <= 0.0) == mesh.quality(nodes).is_inverted).all()
    assert quality.cell_ratios(mesh.points) == pytest.approx(np.ones(mesh.n_cells))
    assert mesh.cell_counts == {"triangle": mesh.n_cells}
    assert mesh.cell_name(mesh.n_cells - 1) == f"triangle {mesh.n_cells:,}"


@pytest.mark.parametrize(("name", "n_ranks"), [("body", 3), ("combs", 2), ("mixed", 4)])
def test_cells_that_are_dealt_out_are_judged_as_all_are(name, n_ranks):
    rng = np.random.default_rng(8)
    mesh = {"body": lambda: body_model().mesh, "combs": combs, "mixed": lambda: mixed(rng)}[name]()
    walls = body_model().walls.faces if name == "body" else NONE
    if name == "combs":  # faces of polyhedra in any order of cells, and the pieces of a polygon together
        (faces, cells), polygons = mesh.polyhedra, mesh.polygons
        order = np.argsort(np.random.default_rng(0).permutation(polygons.max() + 1)[polygons], kind="stable")
        mesh = MixedMesh(mesh.points, {}, polyhedra=(faces[order], cells[order]), polygons=polygons[order])
    whole = MixedQuality.of(mesh, walls)
    parts = [MixedQuality.of(mesh, walls, rank=rank, n_ranks=n_ranks) for rank in range(n_ranks)]
    assert sum(part.cells.n for part in parts) == mesh.n_cells
    assert max(part.cells.n for part in parts) <= mesh.n_cells // n_ranks + 1
    nodes = mesh.points + (0.3 if name == "combs" else 0.03) * rng.standard_normal(mesh.points.shape)
    values = whole.evaluate(nodes)
    joined = parts[0].joined([part.parts(nodes, whole.aggregates) for part in parts])
    assert joined.aggregates == pytest.approx(values.aggregates, rel=1e-13)
    direction, bar = rng.standard_normal(nodes.shape), GridValues(dict.fromkeys(values.aggregates, 1.3))
    changes = [part.jvp(nodes, direction, values).aggregates for part in parts]
    expected = whole.jvp(nodes, direction, values).aggregates
    assert {key: sum(change[key] for change in changes) for key in expected} == pytest.approx(expected, rel=1e-11)
    found, wanted = sum(part.vjp(nodes, values, bar) for part in parts), whole.vjp(nodes, values, bar)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    assert MixedReport.joined([part.report(nodes) for part in parts]) == whole.report(nodes)
    nodes[:, 2] *= -1.0
    assert whole.named([part.worst_new(nodes) for part in parts]) == whole.newly_inverted(nodes) != ""


def test_rings_go_around_quads_and_triangles_once():
    quads = np.array([[0, 1, 2, 3], [4, 5, 6, 6], [7, 7, 8, 9]])
    assert rings(quads).tolist() == [0, 1, 2, 3, 0, -1, 4, 5, 6, 4, -1, 7, 8, 9, 7, -1]
