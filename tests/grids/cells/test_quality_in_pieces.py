"""Quality of a grid in pieces on several ranks: everything is that of one process, whatever is cut."""

import numpy as np
import pytest
from rank_cases import on_ranks

from bspline_mdao.errors import InputError
from bspline_mdao.generators import onera_m6_grid
from bspline_mdao.grids.cells.aggregates import AGGREGATES
from bspline_mdao.grids.cells.grid_quality import GridQuality, GridValues
from bspline_mdao.grids.cells.pieces import Pieces
from bspline_mdao.grids.cells.report import inverted_cells, judge_move, report_quality
from bspline_mdao.grids.topology.grid import Block, Grid, Patch
from bspline_mdao.grids.topology.index_space import Window
from bspline_mdao.grids.topology.partition import Partition, Subdomain

SETTINGS = {"rho": 20.0, "p": 8, "rho_height": 15.0}


def shell(shape, seed=1):
    """Crooked block about an elliptic cylinder, with its wall at kmin."""
    t, z, r = np.meshgrid(*(np.linspace(0.0, 1.0, n) for n in shape), indexing="ij")
    x = np.stack([(2.0 + r) * np.cos(2.0 * t), (1.0 + r) * np.sin(2.0 * t), z + 0.2 * r], axis=-1)
    return x + 0.02 * np.random.default_rng(seed).uniform(-1.0, 1.0, (*shape, 3))


def wedge(n=12):
    """Cells around the x axis. Edges on it have collapsed beside the size of the block, not beside that of a piece."""
    x, r, angle = np.meshgrid(np.arange(float(n)), np.arange(5.0) ** 1.3, [-0.3, 0.2, 0.6], indexing="ij")
    x = np.stack([x + 0.1 * r, r * np.cos(angle), r * np.sin(angle)], axis=-1)
    x[:, 0] += 4e-12 * np.random.default_rng(3).uniform(-1.0, 1.0, x[:, 0].shape)
    return x


def half_mirrored():
    """As many cells of one sign as of the other, the middle layer left-handed, most of the ends right-handed."""
    x = np.stack(np.meshgrid(*(np.arange(float(n)) for n in (11, 3, 3)), indexing="ij"), axis=-1)
    x[..., 0] = np.array([0, 1, 2, 3, 4, 3.5, 2.5, 1.5, 0.5, -0.5, -0.2])[:, None, None]
    return x


def planar():
    """A plane askew, crooked in itself and a little out of plane."""
    x = shell((14, 1, 5), seed=4)
    return x @ np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


GRIDS = {
    "shells": lambda: walled(shell((13, 6, 5)), shell((4, 5, 9), seed=2)[::-1], shell((3, 4, 3), seed=5)),
    "one block": lambda: walled(shell((5, 12, 4))),
    "thick": lambda: walled(shell((4, 5, 17), seed=6)[:, :, ::-1], face=5),
    "collapsed": lambda: walled(wedge(), wedge(5)[::-1]),
    "mirrored": lambda: walled(half_mirrored(), half_mirrored()[:, ::-1]),
    "planar": lambda: walled(planar(), np.moveaxis(planar()[:6], 2, 0), face=4),
    "line": lambda: walled(shell((3, 4, 5)), shell((9, 1, 1))),
    "wing": lambda: onera_m6_grid((7, 6, 5)),
}
"""Grids of blocks that are cut in every way."""


def walled(*blocks, face=4):
    """Grid whose blocks each have a wall of two windows, which meet in the middle of the face."""
    windows = []
    for number, nodes in enumerate(blocks):
        window = Window.whole(number, nodes.shape).face(face)
        d = int(np.argmax(window.shape))
        middle = window.hi[d] // 2
        ends = (window.lo[:d] + (middle,) + window.lo[d + 1 :], window.hi[:d] + (middle,) + window.hi[d + 1 :])
        windows += [Window(number, window.lo, ends[1]), Window(number, ends[0], window.hi)]
    named = tuple(Block(np.ascontiguousarray(nodes), f"zone {n}") for n, nodes in enumerate(blocks, start=1))
    return Grid(named, (Patch("skin", "wall", tuple(windows)), Patch("far", "farfield", ())))


def cut_at_random(shapes, n_ranks, seed=0):
    """Deal out pieces that are cut in random directions, some ranks of several pieces of one block, one with none."""
    rng, pieces = np.random.default_rng(seed), []
    todo = [Window.whole(number, shape) for number, shape in enumerate(shapes)]
    while todo:
        window = todo.pop(int(rng.integers(len(todo))))
        wide = [d for d in range(3) if window.shape[d] > 2]
        if not wide or len(pieces) + len(todo) > 2 * n_ranks + len(shapes):
            pieces.append(window)
            continue
        d = int(rng.choice(wide))
        at = int(rng.integers(window.lo[d] + 1, window.hi[d]))
        todo += [
            Window(window.block, window.lo, window.hi[:d] + (at,) + window.hi[d + 1 :]),
            Window(window.block, window.lo[:d] + (at,) + window.lo[d + 1 :], window.hi),
        ]
    ranks = rng.integers(0, max(1, n_ranks - 1), len(pieces))
    of_rank = ([pieces[n] for n in np.flatnonzero(ranks == rank)] for rank in range(n_ranks))
    return Partition(tuple(shapes), tuple(tuple(sorted(own, key=lambda w: (w.block, w.lo))) for own in of_rank))


def deals(grid):
    """Ways to deal a grid out to one to five ranks."""
    whole = [Window.whole(number, shape) for number, shape in enumerate(grid.shapes)]
    for n_ranks in range(1, 6):
        yield Partition(grid.shapes, tuple(tuple(whole[rank::n_ranks]) for rank in range(n_ranks)))
        yield cut_at_random(grid.shapes, n_ranks, seed=n_ranks)


class Reference:
    """What one process finds, at random nodes, in random directions and with random seeds."""

    def __init__(self, grid):
        rng = np.random.default_rng(11)
        self.baseline = grid.to_vector().reshape(-1, 3)
        self.nodes = self.baseline + 0.01 * rng.standard_normal(self.baseline.shape)
        self.direction = rng.standard_normal(self.baseline.shape)
        self.quality = GridQuality.of_baseline(grid, **SETTINGS)
        self.values = self.quality.evaluate(self.nodes, cells=True)
        self.change = self.quality.jvp(self.nodes, self.direction, self.values)
        self.bar = GridValues(
            {name: rng.standard_normal() for name in self.values.aggregates}, rng.standard_normal(self.quality.n_cells)
        )
        self.nodes_bar = self.quality.vjp(self.nodes, self.values, self.bar)
        self.report = report_quality(self.quality, self.nodes, 20)
        self.judged = judge_move(self.quality, self.nodes)
        self.newly = inverted_cells(self.quality, self.quality.cells(self.nodes), newly=True)


def close(found, expected, tolerance=1e-13):
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=tolerance * np.max(np.abs(expected), initial=1.0))


@pytest.mark.parametrize("name", GRIDS)
def test_any_deal_of_pieces_finds_what_one_process_finds(name):
    grid = GRIDS[name]()
    one = Reference(grid)
    for partition in deals(grid):
        on_ranks(partition.n_ranks, lambda comm, partition=partition: compare(one, grid, partition, comm))


def compare(one, grid, partition, comm):
    """Compare the subdomain of one rank, and all aggregates and reports."""
    subdomain = partition.subdomain(comm.rank)
    pieces = Pieces(partition, tuple(block.name for block in grid.blocks), grid.patches, comm=comm)
    quality = GridQuality.of_pieces(pieces, one.baseline[subdomain.rows], **SETTINGS)
    nodes, direction = one.nodes[subdomain.rows], one.direction[subdomain.rows]
    cells = subdomain.cells
    assert quality.n_cells == cells.size
    values = quality.evaluate(nodes, cells=True)
    close(values.q, one.values.q[cells])
    change = quality.jvp(nodes, direction, values)
    for found, expected in ((values, one.values), (change, one.change)):
        assert list(found.aggregates) == list(expected.aggregates)
        close(list(found.aggregates.values()), list(expected.aggregates.values()))
    close(change.q, one.change.q[cells])
    nodes_bar = np.zeros_like(one.nodes_bar)
    bar = quality.vjp(nodes, values, GridValues(one.bar.aggregates, one.bar.q[cells]))
    np.add.at(nodes_bar, subdomain.rows, bar)
    close(sum(comm.allgather(nodes_bar)), one.nodes_bar)
    report, judged = report_quality(quality, nodes, 20), judge_move(quality, nodes)
    newly = inverted_cells(quality, quality.cells(nodes), newly=True)
    if pieces.has_split_planes:  # the sum that gives their normals has another order
        close(judged, one.judged)
        assert report.n_inverted == one.report.n_inverted
        assert [str(cell) for cell in newly] == [str(cell) for cell in one.newly]
    else:
        assert judged == one.judged
        assert repr(report) == repr(one.report)
        assert newly == one.newly


def test_products_are_transposes_where_copies_of_nodes_differ():
    """A rank that holds a node of a cut gives its own derivative of it."""
    grid = GRIDS["shells"]()
    baseline = grid.to_vector().reshape(-1, 3)

    def products(comm):
        partition = cut_at_random(grid.shapes, comm.size, seed=5)
        rows, rng = partition.subdomain(comm.rank).rows, np.random.default_rng(comm.rank)
        pieces = Pieces(partition, tuple(block.name for block in grid.blocks), grid.patches, comm=comm)
        quality = GridQuality.of_pieces(pieces, baseline[rows], **SETTINGS)
        nodes = baseline[rows] + 0.01 * rng.standard_normal((rows.size, 3))
        values = quality.evaluate(nodes, cells=True)
        change = quality.jvp(nodes, direction := rng.standard_normal(nodes.shape), values)
        seeds = dict(zip(AGGREGATES, np.random.default_rng(99).standard_normal(len(AGGREGATES))))
        bar = GridValues(seeds, rng.standard_normal(quality.n_cells))
        forward = sum(seeds[name] * change.aggregates[name] for name in AGGREGATES)
        return forward, bar.q @ change.q, np.vdot(quality.vjp(nodes, values, bar), direction)

    forward, of_cells, reverse = zip(*on_ranks(3, products))
    assert forward[0] + sum(of_cells) == pytest.approx(sum(reverse), rel=1e-12)


def test_a_block_at_one_point_is_named_on_all_ranks():
    grid = walled(shell((4, 5, 6)), shell((4, 5, 6)), np.ones((3, 3, 3, 3)))
    partition = Partition(grid.shapes, tuple((Window.whole(n, shape),) for n, shape in enumerate(grid.shapes)))
    names = tuple(block.name for block in grid.blocks)

    def message(comm):
        nodes = grid.blocks[comm.rank].nodes.reshape(-1, 3)
        with pytest.raises(InputError) as caught:
            GridQuality.of_pieces(Pieces(partition, names, grid.patches, "box.xyz", comm), nodes)
        return str(caught.value)

    assert set(on_ranks(3, message)) == {"box.xyz: all nodes of block 3 are at one point; leave it out"}


def test_a_subdomain_of_rows_has_no_cells():
    with pytest.raises(InputError, match="has no cells"):
        _ = Subdomain.of_rows([1, 2], 5).cells
