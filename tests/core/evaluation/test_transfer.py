import numpy as np
import pytest
from topology_cases import ORIENTATIONS, box, grid_of, smooth_box, split, turned_and_shuffled, two_block_plate

from bspline_mdao.core.evaluation.family import refined_topology
from bspline_mdao.core.evaluation.transfer import CellTransfer, NodeTransfer
from bspline_mdao.errors import InputError
from bspline_mdao.grids.cells.cell_faces import CellFaces
from bspline_mdao.grids.topology.detection import find_topology

FACTORS = [1.5, 2.0, 2.25, 0.5, 3.0]


def turned_boxes(seed=0):
    """Blocks of a box of even cells, turned at random."""
    nodes = box(*(np.linspace(0.0, length, n) for length, n in ((2.0, 17), (1.0, 9), (3.0, 13))))
    return turned_and_shuffled(grid_of(*split(nodes, [8], [4], [6])), np.random.default_rng(seed))[0]


def centres(nodes, shapes):
    """Centres of the cells of all blocks, whose nodes are given in one array."""
    found, start = [], 0
    for shape in shapes:
        block = nodes[start : start + np.prod(shape)].reshape(*shape, 3)
        start += np.prod(shape)
        for axis in range(3):
            block = 0.5 * (np.delete(block, 0, axis) + np.delete(block, -1, axis))
        found.append(block.reshape(-1, 3))
    return np.concatenate(found)


def members(grid, factor):
    """Topologies of a grid and a member, and the nodes of both: the member's by interpolation in the index."""
    coarse = find_topology(grid)
    fine, nodes = refined_topology(coarse, factor), grid.to_vector().reshape(-1, 3)
    return coarse, fine, nodes, NodeTransfer.of(coarse, fine).prolong(nodes)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("order", [1, 2, 3])
def test_constants_are_kept(factor, order):
    coarse, fine, *_ = members(two_block_plate(), factor)
    transfer = CellTransfer.of(coarse, fine, order)
    np.testing.assert_allclose(transfer.prolong(np.ones((transfer.n_coarse, 2))), 1.0, atol=1e-13)
    weights = np.random.default_rng(2).uniform(0.5, 2.0, transfer.n_fine)
    np.testing.assert_allclose(transfer.restrict_means(np.ones(transfer.n_fine), weights), 1.0, atol=1e-13)


@pytest.mark.parametrize("factor", [2.0, 2.5, 3.0])
@pytest.mark.parametrize("seed", range(4))
def test_quadratics_are_kept_across_turned_interfaces(factor, seed):
    coarse, fine, nodes, fine_nodes = members(turned_boxes(seed), factor)
    rng = np.random.default_rng(seed)
    linear, square = rng.standard_normal(3), rng.standard_normal((3, 3))

    def mean(x, cells):
        """Mean of a quadratic over cells of the extents given."""
        return x @ linear + np.einsum("ci,ij,cj->c", x, square, x) + np.diag(square) @ cells**2 / 12.0

    step = np.array([2.0 / 16, 1.0 / 8, 3.0 / 12])
    at = [centres(x, t.shapes) for x, t in ((nodes, coarse), (fine_nodes, fine))]
    transfer = CellTransfer.of(coarse, fine)
    np.testing.assert_allclose(transfer.prolong(mean(at[0], step)), mean(at[1], step / factor), atol=1e-12)
    second = CellTransfer.of(coarse, fine, order=2)
    np.testing.assert_allclose(second.prolong(at[0]), at[1], atol=1e-13)


def test_smooth_fields_are_prolonged_at_third_order():
    def error(n):
        nodes = box(*(np.linspace(0.0, 1.0, n + 1) for _ in range(3)))
        half = n // 2
        blocks = split(nodes, [half], [half], [half])
        blocks[1], blocks[6] = ORIENTATIONS[29].apply(blocks[1]), ORIENTATIONS[14].apply(blocks[6])
        coarse, fine, nodes, fine_nodes = members(grid_of(*blocks), 2.0)
        f = [
            np.prod(np.sin(2.0 * centres(x, t.shapes) + [0.3, 0.7, 1.1]), 1)
            for x, t in ((nodes, coarse), (fine_nodes, fine))
        ]
        f = [value * np.sinc(2.0 * h / 2.0 / np.pi) ** 3 for value, h in zip(f, (1.0 / n, 0.5 / n))]  # cell means
        return np.abs(CellTransfer.of(coarse, fine).prolong(f[0]) - f[1]).max()

    assert np.log2(error(8) / error(16)) > 2.7


@pytest.mark.parametrize("factor", FACTORS)
def test_transposes_are_exact(factor):
    coarse, fine, *_ = members(turned_boxes(), factor)
    cells, nodes, rng = CellTransfer.of(coarse, fine), NodeTransfer.of(coarse, fine), np.random.default_rng(3)
    weights = rng.uniform(0.5, 2.0, cells.n_fine)
    pairs = [
        (cells.prolong, cells.prolong_transposed),
        (cells.spread, cells.restrict_sums),
        (nodes.prolong, nodes.prolong_transposed),
    ]
    for forward, backward in pairs:
        n = cells.n_coarse if forward != nodes.prolong else nodes.matrix.shape[1]
        x = rng.standard_normal((n, 5))
        y = forward(x)
        bar = rng.standard_normal(y.shape)
        np.testing.assert_allclose(np.vdot(y, bar), np.vdot(x, backward(bar)), rtol=0, atol=1e-14 * y.size)
    x, bar = rng.standard_normal((cells.n_fine, 5)), rng.standard_normal((cells.n_coarse, 5))
    left = np.vdot(cells.restrict_means(x, weights), bar)
    right = np.vdot(x, cells.restrict_means_transposed(bar, weights))
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-14 * x.size)


@pytest.mark.parametrize("factor", FACTORS)
def test_restriction_conserves(factor):
    grid = grid_of(*split(smooth_box(9, 7, 9), [4], [3], [4]))
    coarse, fine, _, fine_nodes = members(grid, factor)
    transfer, rng = CellTransfer.of(coarse, fine), np.random.default_rng(4)
    values, volumes = rng.standard_normal((transfer.n_fine, 5)), CellFaces.of(fine, fine_nodes).volumes(fine_nodes)
    np.testing.assert_allclose(transfer.restrict_sums(values).sum(axis=0), values.sum(axis=0), atol=1e-11)
    means, whole = transfer.restrict_means(values, volumes), transfer.restrict_sums(volumes)
    np.testing.assert_allclose(whole @ means, volumes @ values, atol=1e-13)
    back = transfer.restrict_means(transfer.prolong(means), np.ones(transfer.n_fine))
    if factor in (2.0, 3.0):  # nested members
        np.testing.assert_allclose(back, means, atol=1e-13)


@pytest.mark.parametrize("factor", [0.5, 1.5, 2.0])
def test_nodes_of_a_box_are_those_of_the_member(factor):
    grid = turned_boxes()
    coarse, fine, nodes, fine_nodes = members(grid, factor)
    linear = NodeTransfer.of(coarse, fine, order=2).prolong(nodes)
    np.testing.assert_allclose(linear, fine_nodes, atol=1e-13)  # even cells
    cubic = np.random.default_rng(5).standard_normal(4)
    line = np.polyval(cubic, np.linspace(0.0, 1.0, 9))
    block = np.broadcast_to(line[:, None, None], (9, 4, 5))
    one = find_topology(grid_of(smooth_box(9, 4, 5)))
    to = refined_topology(one, factor)
    found = NodeTransfer.of(one, to).prolong(block.reshape(-1)).reshape(to.shapes[0])
    np.testing.assert_allclose(found[:, 0, 0], np.polyval(cubic, np.linspace(0.0, 1.0, to.shapes[0][0])), atol=1e-13)


def test_what_cannot_be_transferred_is_refused():
    plate, boxes = find_topology(two_block_plate()), find_topology(turned_boxes())
    with pytest.raises(InputError, match="give members of one family"):
        CellTransfer.of(plate, boxes)
    with pytest.raises(InputError, match="give 1, 2 or 3"):
        CellTransfer.of(plate, plate, order=4)
    with pytest.raises(InputError, match="give 2 or 4"):
        NodeTransfer.of(plate, plate, order=3)
