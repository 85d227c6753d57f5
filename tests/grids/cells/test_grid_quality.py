"""Quality of grids: derivatives of the cell measures, aggregates, distribution, inverted cells, component, command."""

import json
from pathlib import Path

import numpy as np
import openmdao.api as om
import pytest
from component_cases import movable_model, small_model, two_blocks

from bspline_mdao.core.om.quality import Quality
from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells import block_cells, grid_quality
from bspline_mdao.grids.cells.aggregates import AGGREGATES, KreisselmeierSteinhauser, PNorm
from bspline_mdao.grids.cells.cell_judge import BlocksJudge
from bspline_mdao.grids.cells.first_cells import FirstCells
from bspline_mdao.grids.cells.grid_quality import GridQuality, GridValues
from bspline_mdao.grids.cells.hexahedron import element_measures, element_measures_vjp
from bspline_mdao.grids.cells.orthogonality import orthogonality, orthogonality_jvp, orthogonality_vjp
from bspline_mdao.grids.cells.report import distribution, report_quality
from bspline_mdao.grids.io.files import write_grid
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.studio.cli.main import run
from bspline_mdao.testing import central_difference

CORNERS = np.array([[c & 1, (c >> 1) & 1, c >> 2] for c in range(8)], dtype=float)


def lattice(*shape):
    return np.stack(np.meshgrid(*(np.arange(float(n)) for n in shape), indexing="ij"), axis=-1)


def crooked(shape, amount=0.15, seed=1):
    return lattice(*shape) + amount * np.random.default_rng(seed).uniform(-1.0, 1.0, (*shape, 3))


def wedge():
    """Cells around the x axis, whose edges on the axis have collapsed."""
    x, r, angle = np.meshgrid(np.arange(4.0), np.arange(5.0) ** 1.3, [-0.3, 0.2, 0.6], indexing="ij")
    return np.stack([x + 0.1 * r, r * np.cos(angle), r * np.sin(angle)], axis=-1)


def planar():
    plane = crooked((5, 4, 1), seed=4)
    plane[..., 2] = 0.0
    return plane @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


GRIDS = {
    "unequal blocks": (crooked((4, 5, 6)), crooked((7, 3, 40), seed=2)),
    "left-handed": (crooked((4, 5, 6))[::-1], crooked((3, 4, 5), seed=5)),
    "collapsed": (wedge(), crooked((3, 4, 5))),
    "planar": (planar(), np.moveaxis(planar(), 2, 0), np.moveaxis(planar(), 2, 1)),
    "many chunks": (crooked((5, 40, 45)), crooked((12, 30, 31), seed=3)),
}
"""Blocks of grids that the measures must cope with."""

every_grid = pytest.mark.parametrize("blocks", GRIDS.values(), ids=GRIDS)


def grid_of(*blocks):
    """Grid whose blocks each have one wall, at the low end of their first direction with cells."""
    named = tuple(Block(np.ascontiguousarray(nodes), f"block {n}") for n, nodes in enumerate(blocks, start=1))
    directions = [min((d for d in range(3) if block.shape[d] > 1), default=0) for block in named]
    faces = tuple(Window.whole(n, b.shape).face(2 * d) for n, (b, d) in enumerate(zip(named, directions)))
    return Grid(named, (Patch("floor", "wall", faces),))


def nodes_of(grid):
    return grid.to_vector().reshape(-1, 3)


def elements(n=60, seed=0):
    """Crooked elements of both handednesses, some with corners left out."""
    rng = np.random.default_rng(seed)
    corners = CORNERS + 0.3 * rng.uniform(-1.0, 1.0, (n, 8, 3))
    degenerate_corners = np.where(rng.random(n) < 0.3, rng.integers(0, 256, n), 0).astype(np.uint8)
    return corners, rng.choice([-1, 1], n).astype(np.int8), degenerate_corners, rng.standard_normal(corners.shape)


def reference(corners, handedness):
    """Corner triple products, Jacobians and volume by numpy, of real or complex corners."""
    sides = CORNERS.astype(int)
    at = lambda a, b, d: corners[:, a + 2 * b + 4 * d]  # noqa: E731
    triples, jacobians = [], []
    for a, b, d in sides:
        u, v, w = at(1, b, d) - at(0, b, d), at(a, 1, d) - at(a, 0, d), at(a, b, 1) - at(a, b, 0)
        jacobians.append(handedness * np.sum(np.cross(u, v) * w, axis=-1))
        triples.append(jacobians[-1] / np.sqrt(np.sum(u * u, -1) * np.sum(v * v, -1) * np.sum(w * w, -1)))
    volume = 0.0
    for point in 0.5 + (CORNERS - 0.5) / np.sqrt(3.0):
        value = np.where(sides == 1, point, 1.0 - point)
        slope = 2.0 * sides - 1.0
        shape = np.stack([np.prod(np.where(np.arange(3) == d, slope, value), axis=1) for d in range(3)])
        x, y, z = np.moveaxis(np.einsum("dc,ncx->ndx", shape, corners), 1, 0)
        volume = volume + handedness * np.sum(np.cross(x, y) * z, axis=-1) / 8.0
    return np.stack(triples, axis=-1), np.stack(jacobians, axis=-1), volume


@pytest.mark.slow
def test_measures_of_elements_agree_with_numpy():
    corners, handedness, degenerate_corners, _ = elements()
    measures, expected = element_measures(corners, handedness, degenerate_corners), reference(corners, handedness)
    is_out = (degenerate_corners[:, None] >> np.arange(8)) & 1 == 1
    assert is_out.any()
    np.testing.assert_allclose(measures.triples, np.where(is_out, 1.0, expected[0]), atol=1e-14)
    np.testing.assert_allclose(measures.jacobians, np.where(is_out, np.inf, expected[1]), atol=1e-14)
    np.testing.assert_allclose(measures.volume, expected[2], atol=1e-14)


@pytest.mark.slow
def test_adjoints_of_elements_are_transposes_of_the_complex_step():
    corners, handedness, degenerate_corners, d_corners = elements()
    changes = [part.imag / 1e-30 for part in reference(corners + 1e-30j * d_corners, handedness)]
    is_out = (degenerate_corners[:, None] >> np.arange(8)) & 1 == 1
    changes[0][is_out] = changes[1][is_out] = 0.0
    rng = np.random.default_rng(1)
    triples, jacobians, volume = (rng.standard_normal(x.shape) for x in changes)
    bar = element_measures_vjp(corners, handedness, degenerate_corners, triples, volume, jacobians)
    forward = np.vdot(triples, changes[0]) + np.vdot(jacobians, changes[1]) + volume @ changes[2]
    assert abs(forward - np.vdot(bar, d_corners)) < 1e-13 * np.linalg.norm(bar) * np.linalg.norm(d_corners)


def test_the_derivative_of_q_stands_corners_of_zero():
    triples = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 8))
    triples[0, 3] = triples[1, 0] = triples[2, 7] = triples[2, 1] = 0.0
    d_triples, q_bar = np.random.default_rng(1).standard_normal((5, 8)), np.arange(1.0, 6.0)
    change = orthogonality_jvp(triples, d_triples)
    np.testing.assert_allclose(change, orthogonality(triples + 1e-30j * d_triples).imag / 1e-30, atol=1e-15)
    np.testing.assert_allclose(q_bar @ change, np.vdot(orthogonality_vjp(triples, q_bar), d_triples), rtol=1e-13)


def test_arrays_of_elements_that_do_not_fit_are_refused():
    corners, handedness, degenerate_corners, _ = elements()
    with pytest.raises(InputError, match="do not fit"):
        element_measures(corners, handedness[:5], degenerate_corners)


@pytest.mark.slow
@every_grid
def test_aggregates_bound_the_minima_from_below_within_what_they_promise(blocks):
    grid = grid_of(*blocks)
    quality = GridQuality.of_baseline(grid, rho=30.0, p=12)
    values = quality.evaluate(nodes_of(grid), cells=True)
    report = report_quality(quality, nodes_of(grid))
    assert quality.n_cells == values.q.size == report.n_cells
    assert values.q.min() == pytest.approx(report.q_min, rel=1e-13)
    for least, name, n in (
        (report.q_min, "quality", report.n_cells),
        (report.min_corner, "corner", 8 * report.n_cells),
    ):
        ks, norm = values.aggregates[f"{name}_ks"], values.aggregates[f"{name}_pnorm"]
        assert least - np.log(n) / 30.0 - 1e-14 <= ks <= least + 1e-14
        assert 1.0 - n ** (1.0 / 12) * (1.0 - least) - 1e-14 <= norm <= least + 1e-14
    assert values.aggregates["volume_ks"] == pytest.approx(1.0 - np.log(report.n_cells) / 30.0, rel=1e-12)


@pytest.mark.slow
@every_grid
def test_products_with_the_jacobian_are_transposes_and_directional_derivatives(blocks):
    grid, rng = grid_of(*blocks), np.random.default_rng(7)
    quality = GridQuality.of_baseline(grid, rho=10.0, p=6, rho_height=10.0)
    d_nodes = rng.standard_normal((grid.n_nodes, 3))
    nodes = nodes_of(grid) + 0.01 * rng.standard_normal(d_nodes.shape)
    values = quality.evaluate(nodes, cells=True)
    change = quality.jvp(nodes, d_nodes, values)
    bar = GridValues({name: rng.standard_normal() for name in AGGREGATES}, rng.standard_normal(quality.n_cells))
    nodes_bar = quality.vjp(nodes, values, bar)
    forward = sum(bar.aggregates[name] * change.aggregates[name] for name in AGGREGATES) + bar.q @ change.q
    assert abs(forward - np.vdot(nodes_bar, d_nodes)) < 1e-13 * np.linalg.norm(nodes_bar) * np.linalg.norm(d_nodes)

    def outputs(step):
        moved = quality.evaluate(nodes + step * d_nodes, cells=True)
        return np.concatenate([list(moved.aggregates.values()), moved.q])

    exact = np.concatenate([list(change.aggregates.values()), change.q])
    difference = central_difference(outputs, 1e-3, levels=5)
    assert np.abs(difference - exact).max() < 1e-9 * np.abs(exact).max()


def bounds_by_numpy(grid, quality, nodes):
    """Aggregates of the measures of all cells, with nothing left out: of real or complex nodes, without poles."""
    parts = []
    for block in quality.blocks:
        x = block.nodes_of(nodes)
        at = [x[tuple(slice(a, n - 1 + a) for a, n in zip(side, x.shape))] for side in CORNERS.astype(int)]
        corners = np.stack(at, axis=3).reshape(-1, 8, 3)
        triples, jacobians, volume = reference(corners, block.handedness)
        scale = block.inverse_volume
        parts.append((np.prod(triples, axis=1), triples.ravel(), (jacobians.T * scale).ravel(), volume * scale))
    q, triples, jacobians, volume = (np.concatenate(column) for column in zip(*parts))
    ks, norm = (
        KreisselmeierSteinhauser(quality.rho),
        lambda x: 1.0 - np.sum((1.0 - x) ** quality.p) ** (1.0 / quality.p),
    )
    bound = lambda x: ks.value(ks.part(x))  # noqa: E731
    found = bound(q), norm(q), bound(triples), norm(triples), bound(jacobians), bound(volume)
    return dict(zip(("quality_ks", "quality_pnorm", "corner_ks", "corner_pnorm", "jacobian_ks", "volume_ks"), found))


@pytest.mark.parametrize(("rho", "p"), [(3.0, 2), (100.0, 64), (1e4, 301)])
def test_bounds_and_their_derivatives_are_those_of_all_numbers_by_the_complex_step(rho, p):
    """However many terms are so small that they are left out."""
    grid, rng = (
        grid_of(*GRIDS["unequal blocks"], *GRIDS["left-handed"], crooked((3, 12, 18), seed=9)),
        np.random.default_rng(6),
    )
    quality = GridQuality.of_baseline(grid, rho=rho, p=p)
    d_nodes = rng.standard_normal((grid.n_nodes, 3))
    nodes = nodes_of(grid) + 0.1 * rng.standard_normal(d_nodes.shape)
    expected = bounds_by_numpy(grid, quality, nodes + 1e-40j * d_nodes)
    values = quality.evaluate(nodes, list(expected))
    change = quality.jvp(nodes, d_nodes, values)
    for name, of_all in expected.items():
        assert values.aggregates[name] == pytest.approx(of_all.real, rel=1e-13)
        assert change.aggregates[name] == pytest.approx(of_all.imag / 1e-40, rel=1e-11)
        bar = quality.vjp(nodes, values, GridValues({name: 1.7}))
        norms = np.linalg.norm(bar) * np.linalg.norm(d_nodes)
        assert abs(np.vdot(bar, d_nodes) - 1.7 * of_all.imag / 1e-40) < 1e-13 * norms


@pytest.mark.parametrize("name", AGGREGATES)
def test_taylor_remainder_of_every_aggregate_is_of_second_order(name):
    grid = grid_of(*GRIDS["unequal blocks"])
    quality, nodes = GridQuality.of_baseline(grid, rho=20.0, p=8, rho_height=15.0), nodes_of(grid)
    d_nodes = np.random.default_rng(3).standard_normal(nodes.shape)
    values = quality.evaluate(nodes, [name])
    slope = quality.jvp(nodes, d_nodes, values).aggregates[name]
    steps = 1e-3 / 2.0 ** np.arange(4)
    moved = [quality.evaluate(nodes + step * d_nodes, [name]).aggregates[name] for step in steps]
    remainders = np.abs(np.array(moved) - values.aggregates[name] - slope * steps)
    assert (np.log2(remainders[:-1] / remainders[1:]) > 1.9).all()


def test_results_do_not_depend_on_the_number_of_threads(monkeypatch):
    monkeypatch.setattr(block_cells, "CHUNK_CELLS", 3000)
    grid = grid_of(*GRIDS["many chunks"])
    one, two = (GridQuality.of_baseline(grid, n_threads=n) for n in (1, 2))
    assert sum(len(list(block.chunks())) for block in one.blocks) > 2
    values = one.evaluate(nodes_of(grid))
    assert values.aggregates == two.evaluate(nodes_of(grid)).aggregates
    bars = [q.vjp(nodes_of(grid), values, GridValues(dict.fromkeys(AGGREGATES, 1.0))) for q in (one, two)]
    np.testing.assert_array_equal(*bars)


@pytest.mark.parametrize("rule", [KreisselmeierSteinhauser(1e4), PNorm(400)])
def test_sharp_aggregates_neither_overflow_nor_lose_the_extreme(rule):
    x = np.array([-0.9, 0.2, 0.9, 1.0, -0.9])
    value = rule.value(rule.join([rule.part(x[:2]), rule.part(x[2:])]))
    assert value == pytest.approx(-0.9, abs=5e-3)
    np.testing.assert_allclose(rule.weights(x, value), [0.5, 0.0, 0.0, 0.0, 0.5], atol=5e-3)


@pytest.mark.parametrize("rule", [KreisselmeierSteinhauser(20.0), PNorm(9)])
def test_parts_join_to_the_whole(rule):
    x = np.random.default_rng(0).uniform(-1.0, 1.0, 37)
    whole = rule.value(rule.part(x))
    assert rule.value(rule.join([rule.part(part) for part in np.split(x, [5, 6, 20])])) == pytest.approx(
        whole, rel=1e-14
    )


@pytest.mark.parametrize(("kind", "setting"), [(KreisselmeierSteinhauser, -1.0), (PNorm, 1), (PNorm, 2.5)])
def test_settings_of_aggregates_that_cannot_be_used_are_refused(kind, setting):
    with pytest.raises(InputError, match="give a"):
        kind(setting)


def test_perfect_cells_have_p_norms_of_one_and_no_derivative():
    grid = grid_of(lattice(3, 4, 5))
    quality = GridQuality.of_baseline(grid)
    values = quality.evaluate(nodes_of(grid), ["quality_pnorm"])
    assert values.aggregates["quality_pnorm"] == 1.0
    assert not quality.vjp(nodes_of(grid), values, GridValues({"quality_pnorm": 1.0})).any()


def test_the_distribution_integrates_to_one_and_counts_negative_q_apart():
    q = np.concatenate([np.random.default_rng(0).uniform(0.0, 1.0, 999), [-0.3, -0.1, 1.0 + 1e-15, np.nan]])
    found = distribution(q, n_bins=17)
    assert np.sum(found.density * np.diff(found.edges)) == pytest.approx(1.0, rel=1e-14)
    np.testing.assert_allclose(found.edges, np.linspace(0.0, 1.0, 18))
    assert found.n_negative == 3
    with pytest.raises(InputError, match="at least 1"):
        distribution(q, n_bins=0)


def test_mirrored_cells_have_q_of_one_and_are_named_as_inverted():
    nodes = lattice(6, 3, 2)
    nodes[3:, :, :, 0] -= 2.0  # the third layer runs backwards
    grid = grid_of(lattice(3, 3, 3), nodes)
    report = report_quality(GridQuality.of_baseline(grid), nodes_of(grid))
    assert report.q_min == 1.0
    assert (report.n_inverted, report.min_corner, report.min_volume) == (2, -1.0, -1.0)
    assert [str(cell) for cell in report.inverted] == ["cell (3, 1, 1) of block 2", "cell (3, 2, 1) of block 2"]


def test_a_grid_that_mirrors_as_a_whole_is_inverted_by_its_baseline():
    grid = grid_of(lattice(3, 4, 5))
    quality = GridQuality.of_baseline(grid)
    report = report_quality(quality, nodes_of(grid) * [1.0, 1.0, -1.0])
    assert report.n_inverted == quality.n_cells == 24


def test_a_grid_without_cells_is_refused():
    with pytest.raises(InputError, match="no block"):
        GridQuality.of_baseline(grid_of(lattice(5, 1, 1)))


def component(model=None, **options):
    problem = om.Problem(reports=False)
    problem.model.add_subsystem("quality", Quality(model=model or movable_model(), **options), promotes=["*"])
    problem.setup()
    problem.run_model()
    return problem


def test_the_component_gives_what_the_kernel_gives():
    settings, grid = {"rho": 25.0, "p": 10, "rho_height": 40.0}, movable_model().regenerate()
    problem = component(aggregates=AGGREGATES, cells=True, **settings)
    expected = GridQuality.of_baseline(grid, **settings).evaluate(nodes_of(grid), cells=True)
    for name, value in expected.aggregates.items():
        assert problem.get_val(name).item() == pytest.approx(value, rel=1e-10)
    np.testing.assert_allclose(problem.get_val("cell_quality"), expected.q, rtol=1e-10)
    assert problem.model.quality.report().q_min == pytest.approx(expected.q.min(), rel=1e-10)


def test_totals_of_all_outputs_agree_with_differences():
    problem = component(aggregates=AGGREGATES, rho=20.0, p=8, rho_height=20.0)
    assert np.abs(problem.compute_totals(["corner_ks"], ["grid"])["corner_ks", "grid"]).max() > 1e-3
    forward = problem.compute_jacvec_product(
        list(AGGREGATES), ["grid"], "fwd", {"grid": np.random.default_rng(0).standard_normal(problem["grid"].size)}
    )
    start, v = problem["grid"].copy(), np.random.default_rng(0).standard_normal(problem["grid"].size)

    def outputs(step):
        problem["grid"] = start + step * v
        problem.run_model()
        return np.concatenate([problem.get_val(name) for name in AGGREGATES])

    exact = np.concatenate([forward[name] for name in AGGREGATES])
    np.testing.assert_allclose(central_difference(outputs, 2e-4, levels=5), exact, atol=1e-8 * np.abs(exact).max())


@pytest.mark.parametrize("aggregates", [None, ("volume_ks",)], ids=["with corners", "without corners"])
def test_an_inverted_cell_is_an_analysis_error_where_validity_is_required_and_runs_go_on_after_it(aggregates):
    problem = component(require_valid=True, aggregates=aggregates)
    start = problem["grid"].copy()
    nodes = problem["grid"].reshape(-1, 3)[: 7 * 8 * 6].reshape(7, 8, 6, 3)
    nodes[3, 4, 2] = nodes[5, 6, 4]
    with pytest.raises(om.AnalysisError, match=r"cell \(\d, \d, \d\) of block 1 is inverted"):
        problem.run_model()
    problem["grid"] = start
    problem.run_model()
    assert problem.get_val("volume_ks") > 0.0


@every_grid
@pytest.mark.parametrize("amount", [0.0, 0.05, 3.0])
def test_the_smallest_corner_of_solid_blocks_comes_with_their_bound(blocks, amount):
    grid = grid_of(*blocks)
    judge = BlocksJudge.of_baseline(grid, baseline=nodes_of(grid))
    nodes = nodes_of(grid) + amount * np.random.default_rng(8).uniform(-1.0, 1.0, (grid.n_nodes, 3))
    found = judge.evaluate(nodes).min_corner
    assert judge.evaluate(nodes, ["quality_ks"]).min_corner is None
    if 1 in np.ravel(grid.shapes):
        assert found is None
    else:
        assert found == pytest.approx(min(cells.min_corner.min() for cells in judge.cells(nodes)), rel=1e-12)
        assert (judge.newly_inverted(nodes) == "") == (found > 0.0)
        nodes[-1] = np.nan
        assert np.isnan(judge.evaluate(nodes).min_corner)


def test_an_unknown_aggregate_is_refused():
    with pytest.raises(InputError, match="no aggregate 'skewness'; choose from quality_ks"):
        component(aggregates=("skewness",))


def test_heights_are_refused_where_no_patch_is_a_wall():
    with pytest.raises(InputError, match=r"'height_low_ks': no wall of the grid .* declare the patches"):
        component(small_model(), aggregates=("quality_ks", "height_low_ks"))
    quality = GridQuality.of_baseline(two_blocks())
    assert not [name for name in quality.evaluate(nodes_of(two_blocks())).aggregates if name.startswith("height")]
    with pytest.raises(InputError, match="no wall"):
        quality.evaluate(nodes_of(two_blocks()), ["height_high_ks"])


@every_grid
def test_aggregates_of_heights_bound_them_from_below_and_above(blocks):
    grid = grid_of(*blocks)
    quality, nodes = GridQuality.of_baseline(grid, rho_height=50.0), nodes_of(grid)
    nodes = nodes + 0.02 * np.random.default_rng(4).standard_normal(nodes.shape)
    ratios = quality.first_cells.ratios(nodes)
    found = quality.evaluate(nodes, ["height_low_ks", "height_high_ks"]).aggregates
    slack = np.log(len(ratios)) / 50.0
    assert ratios.min() - slack <= found["height_low_ks"] < ratios.min() < ratios.max() < found["height_high_ks"]
    assert found["height_high_ks"] <= ratios.max() + slack


def test_cells_are_measured_for_aggregates_of_cells_alone(monkeypatch):
    """And heights for those of heights."""
    grid = grid_of(*GRIDS["unequal blocks"])
    quality, nodes, d_nodes = GridQuality.of_baseline(grid), nodes_of(grid), np.ones((grid.n_nodes, 3))

    def evaluate_all(names):
        values = quality.evaluate(nodes, names)
        quality.jvp(nodes, d_nodes, values)
        quality.vjp(nodes, values, GridValues(dict.fromkeys(names, 1.0)))

    monkeypatch.setattr(grid_quality, "chunk_bounds", None)
    evaluate_all(["height_low_ks", "height_high_ks"])
    monkeypatch.undo()
    monkeypatch.setattr(FirstCells, "ratios", None)
    evaluate_all(["quality_ks", "volume_ks"])


def test_the_command_tells_what_the_cells_are_like(tmp_path, capsys):
    grid = two_blocks()
    write_grid(tmp_path / "two.xyz", grid)
    assert run(["quality", str(tmp_path / "two.xyz"), "--bins", "20", "--json", str(tmp_path / "q.json")]) == 0
    found = json.loads((tmp_path / "q.json").read_text())
    report = report_quality(GridQuality.of_baseline(grid), nodes_of(grid), 20)
    for name in ("q_min", "q_mean", "n_inverted", "min_corner", "min_volume", "n_cells"):
        assert found[name] == pytest.approx(getattr(report, name), rel=1e-6)
    assert np.mean(found["histogram"]["density"]) == pytest.approx(1.0)
    assert "smallest Q" in capsys.readouterr().out


def test_the_command_compares_heights_at_walls_with_a_baseline(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    model = movable_model()
    model.save("floor.h5")
    grid = model.regenerate()
    nodes = grid.blocks[1].nodes
    nodes[:, :, 1] += 0.5 * (nodes[:, :, 1] - nodes[:, :, 0])
    write_grid("moved.xyz", grid)
    assert run(["quality", "moved.xyz", "--baseline", "floor.h5", "--json", "q.json"]) == 0
    (floor,) = json.loads(Path("q.json").read_text())["heights"]
    assert (floor["patch"], floor["ratio_min"], floor["ratio_max"]) == ("floor", pytest.approx(1.0), pytest.approx(1.5))
    assert floor["highest"]["block"] == "block 2"
    said = capsys.readouterr().err
    assert (
        "warning: the first cells at 'floor' are 1 to 1.5 times as high as before (1 % to 99 %), and so is y+" in said
    )
    assert run(["quality", "floor.h5", "--json", "q.json"]) == 0
    (floor,) = json.loads(Path("q.json").read_text())["heights"]
    assert floor["height_median"] > 0.0
    assert "ratio_min" not in floor
    assert "first heights at" in capsys.readouterr().out
    assert run(["quality", "moved.xyz", "--json", "q.json"]) == 0
    assert json.loads(Path("q.json").read_text())["heights"] == []
    assert "first cells" not in capsys.readouterr().out


def test_the_command_names_cells_that_were_valid_on_the_baseline(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    grid = two_blocks()
    grid.blocks[1].nodes[4, 4, 3] = grid.blocks[1].nodes[2, 2, 1]
    write_grid("folded.xyz", grid)
    write_grid("two.xyz", two_blocks())
    assert run(["quality", "folded.xyz", "--baseline", "two.xyz", "--json", "q.json"]) == 0
    assert json.loads(Path("q.json").read_text())["newly_inverted"]
    assert "of block 2 was valid on the baseline" in capsys.readouterr().out
    assert run(["quality", "folded.xyz", "--baseline", "folded.xyz", "--json", "q.json"]) == 0
    assert json.loads(Path("q.json").read_text())["newly_inverted"] == []
    write_grid("one.xyz", Grid(grid.blocks[:1]))
    assert run(["quality", "one.xyz", "--baseline", "two.xyz"]) == 2
    assert "give the grid that was moved" in capsys.readouterr().err


def test_the_command_names_inverted_cells_and_measures_models(tmp_path, capsys):
    grid = two_blocks()
    grid.blocks[1].nodes[4, 4, 3] = grid.blocks[1].nodes[2, 2, 1]
    write_grid(tmp_path / "bad.xyz", grid)
    small_model().save(tmp_path / "two.h5")
    assert run(["quality", str(tmp_path / "bad.xyz")]) == 0
    assert ") of block 2 has corner triple product -" in capsys.readouterr().out
    assert run(["quality", str(tmp_path / "two.h5")]) == 0
    assert run(["quality", str(tmp_path / "none.xyz")]) == 2


@every_grid
@pytest.mark.parametrize("amount", [0.0, 0.05, 3.0])
def test_numbers_to_keep_of_a_grid_are_those_of_its_cells(blocks, amount):
    grid = grid_of(*blocks)
    nodes = grid.to_vector().reshape(-1, 3)
    judge = BlocksJudge.of_baseline(grid, baseline=nodes, n_threads=1)
    nodes = nodes + amount * np.random.default_rng(8).uniform(-1.0, 1.0, nodes.shape)
    found, cells = judge.summary(nodes), judge.cells(nodes)
    q, corners, volumes = (
        np.concatenate([getattr(of, name).ravel() for of in cells]) for name in ("q", "min_corner", "volume")
    )
    were = np.concatenate([block.first_cell + block.was_invalid for block in judge.blocks]).astype(int)
    expected = [q.min(), q.mean(), corners.min(), volumes.min()]
    names = "q_min", "q_mean", "min_corner", "min_volume"
    np.testing.assert_allclose([found[name] for name in names], expected, rtol=1e-12)
    assert found["n_inverted"] == np.count_nonzero(corners <= 0.0)
    assert found["n_newly_inverted"] == found["n_inverted"] - np.count_nonzero(corners[were] <= 0.0)
    nodes[0] = np.nan
    assert np.isnan(judge.summary(nodes)["q_mean"])
