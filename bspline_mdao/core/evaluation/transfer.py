"""Transfer of fields between two members of a grid family, in the parameter space of the blocks.

Members share the mapping from the parameters of a segment to space, and their indices run evenly over the same range of
parameters (`.family`). Therefore a cell of one member covers a box of cells of the other, in fractions of index.
Neither coordinates nor searches are needed, and members need not be nested.

Theory: ``docs/theory/transfer.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.sparse import block_diag, csc_array, csr_array, eye_array, hstack, kron, vstack

from ...base.display import OneLine
from ...errors import InputError
from ...grids.cells.line_neighbours import LineNeighbours
from ...grids.topology.topology import Topology

__all__ = ["CellTransfer", "NodeTransfer"]

TERMS = ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (2, 0, 0), (0, 2, 0), (0, 0, 2), (1, 1, 0), (1, 0, 1), (0, 1, 1))
"""Powers of the three directions in the polynomial of a cell."""

N_TERMS = {1: 1, 2: 4, 3: 10}
"""Terms of the polynomials by their order, the degree plus one."""


@dataclass(frozen=True, eq=False)
class CellTransfer(OneLine):
    """Transfer of cell values between members of a grid family, with exact transposes.

    Cells are numbered block after block, each in C order, as everywhere in the package. Fields may have any number of
    values per cell: shape (n_cells, ...). On several processes these are arrays of the whole grid.

    Parameters
    ----------
    overlaps : csr_array, shape (n_fine, n_coarse)
        Fraction of each fine cell that lies in each coarse one, in index space; rows sum to one.
    coefficients : csr_array, shape (n_terms n_coarse, n_coarse)
        Coefficients of the polynomials of all coarse cells, term after term, from their values.
    means : csr_array, shape (n_fine, n_terms n_coarse)
        Means over the fine cells of the terms of the coarse cells that they lie in.

    Examples
    --------
    >>> from bspline_mdao import find_topology
    >>> from bspline_mdao.generators import flat_plate_grid
    >>> from bspline_mdao.core.evaluation.family import refined_topology
    >>> topology = find_topology(flat_plate_grid((9, 9, 5)))
    >>> transfer = CellTransfer.of(topology, refined_topology(topology, 1.5))
    >>> bool(np.allclose(transfer.prolong(np.ones(transfer.n_coarse)), 1.0))
    True
    """

    overlaps: csr_array
    coefficients: csr_array
    means: csr_array

    @classmethod
    def of(cls, coarse: Topology, fine: Topology, order: int = 3) -> CellTransfer:
        """Relate the cells of two members.

        Parameters
        ----------
        coarse, fine : Topology
            Topologies of two members of one family, such as ``model.topology`` and ``model.member(2).topology``.
            Values are prolonged from the first to the second and restricted back; the first may be the finer one.
        order : int
            Order of the polynomials that represent a field in a coarse cell, the degree plus one: 1 for constant, 2 for
            linear, 3 for quadratic in index space.

        Raises
        ------
        InputError
            If the members are not of one family, or the order is not 1, 2 or 3.
        """
        if order not in N_TERMS:
            raise InputError(f"transfer of order {order!r}; give 1, 2 or 3")
        moments = [[_moments(*ends) for ends in block] for block in _cuts_of_both(coarse, fine)]
        terms = [
            block_diag([_product([block[d][power[d]] for d in range(3)]) for block in moments], format="csr")
            for power in TERMS[: N_TERMS[order]]
        ]
        coefficients = _coefficients(LineNeighbours.of(coarse))[: N_TERMS[order]]
        return cls(terms[0], vstack(coefficients, format="csr"), hstack(terms, format="csr"))

    @property
    def n_coarse(self) -> int:
        """Number of coarse cells."""
        return self.overlaps.shape[1]

    @property
    def n_fine(self) -> int:
        """Number of fine cells."""
        return self.overlaps.shape[0]

    def prolong(self, values: np.ndarray) -> np.ndarray:
        """Means over the fine cells of the polynomials through coarse values, shape (n_coarse, ...).

        The values themselves are the means of the polynomials, so the mean in index space is kept.
        """
        return _apply(self.means, _apply(self.coefficients, values))

    def prolong_transposed(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `prolong`."""
        return _apply(self.coefficients.T, _apply(self.means.T, bar))

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Mean over every fine cell of the coarse cells that it lies in; the transpose of `restrict_sums`."""
        return _apply(self.overlaps, values)

    def restrict_sums(self, sums: np.ndarray) -> np.ndarray:
        """Add up integral values of fine cells, such as residuals, over coarse ones; the total is conserved."""
        return _apply(self.overlaps.T, sums)

    def restrict_means(self, values: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Means over the coarse cells of fine values, with weights, shape (n_fine,), such as volumes.

        The sum of the values times the weights is conserved if a coarse cell weighs as much as the fine ones in it,
        ``restrict_sums(weights)``.
        """
        return _scaled(self.restrict_sums(_scaled(values, weights)), 1.0 / self.restrict_sums(weights))

    def restrict_means_transposed(self, bar: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """Transposed product of `restrict_means`, in the values."""
        return _scaled(self.spread(_scaled(bar, 1.0 / self.restrict_sums(weights))), weights)


@dataclass(frozen=True, eq=False)
class NodeTransfer(OneLine):
    """Interpolation of node values from one member of a grid family to another, finer or coarser.

    Cubic Hermite interpolation in the index, which folds stretched lines less than smoother interpolation does, or
    linear. Nodes that coincide with source nodes keep their values, so a coarser member of half the cells takes a
    subset of them. Nodes that blocks share get the same values if they had the same in the source.

    Parameters
    ----------
    matrix : csr_array, shape (n_nodes of the target, n_nodes of the source)

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao import find_topology
    >>> from bspline_mdao.generators import brick_grid
    >>> from bspline_mdao.splines import NodeTransfer
    >>> coarse, fine = (find_topology(brick_grid((n, n, n, n))) for n in (5, 9))
    >>> NodeTransfer.of(coarse, fine).prolong(np.ones(coarse.n_nodes)).shape == (fine.n_nodes,)
    True
    """

    matrix: csr_array

    @classmethod
    def of(cls, source: Topology, target: Topology, order: int = 4) -> NodeTransfer:
        """Relate the nodes of two members; order 2 for linear interpolation.

        Raises
        ------
        InputError
            If the members are not of one family, or the order is not 2 or 4.
        """
        if order not in (2, 4):
            raise InputError(f"interpolation of nodes of order {order!r}; give 2 or 4")
        lines = [[_interpolation(*ends, order) for ends in block] for block in _cuts_of_both(source, target)]
        return cls(block_diag([_product(block) for block in lines], format="csr"))

    def prolong(self, values: np.ndarray) -> np.ndarray:
        """Values at the nodes of the target from values at the nodes of the source, shape (n_nodes, ...)."""
        return _apply(self.matrix, values)

    def prolong_transposed(self, bar: np.ndarray) -> np.ndarray:
        """Transposed product of `prolong`."""
        return _apply(self.matrix.T, bar)


def _cuts_of_both(first: Topology, second: Topology) -> list[list[tuple[np.ndarray, np.ndarray]]]:
    """For each block and direction, node planes between segments in both members."""
    cuts = [[[_cuts(t, block, d) for d in range(3)] for block in range(len(t.shapes))] for t in (first, second)]
    if [[len(c) for c in block] for block in cuts[0]] != [[len(c) for c in block] for block in cuts[1]]:
        raise InputError(
            f"transfer from {first.source} to {second.source}: their blocks are not cut alike; give members of one "
            f"family, model.topology and model.member(factor).topology"
        )
    return [list(zip(*blocks)) for blocks in zip(*cuts)]


def _cuts(topology: Topology, block: int, d: int) -> np.ndarray:
    """Node planes of a block at which segments end in direction d."""
    ends = ((segment.lo[d], segment.hi[d]) for segment in topology.segments if segment.block == block)
    return np.array(sorted({end for pair in ends for end in pair}))


def _moments(coarse: np.ndarray, fine: np.ndarray) -> tuple[csr_array, csr_array, csr_array]:
    """Moments of the parts of a line's fine cells in coarse ones, relative to the fine cells: three matrices."""
    # With x the index in the coarse cell from its centre, the means of 1, x and (x^2 - 1/12) / 2 over each part, times
    # its fraction of the fine cell. Their means over a coarse cell are 1, 0 and 0.
    ends = np.interp(np.arange(fine[-1] + 1), fine, coarse)  # ends of the fine cells, in indices of the coarse line
    whole = np.rint(ends)
    ends = np.where(np.abs(ends - whole) < 1e-9, whole, ends)
    bounds = np.union1d(ends, np.arange(coarse[-1] + 1.0))
    a, b = bounds[:-1], bounds[1:]
    rows = np.searchsorted(ends, a, side="right") - 1
    columns = a.astype(int)
    fraction, (x, y) = (b - a) / np.diff(ends)[rows], (end - columns - 0.5 for end in (a, b))
    curve = 0.5 * ((x * x + x * y + y * y) / 3.0 - 1.0 / 12.0)
    shape = len(ends) - 1, int(coarse[-1])
    return tuple(csr_array((fraction * mean, (rows, columns)), shape) for mean in (1.0, 0.5 * (x + y), curve))


def _interpolation(source: np.ndarray, target: np.ndarray, order: int) -> csr_array:
    """Matrix of the interpolation along a line, one interval between cuts after the other."""
    matrix = np.zeros((target[-1] + 1, source[-1] + 1))
    for m in range(len(source) - 1):
        n, columns = target[m + 1] - target[m] + 1, np.eye(source[m + 1] - source[m] + 1)
        if order == 4:
            part = _hermite(columns, n)
        else:
            at = np.linspace(0.0, len(columns) - 1.0, n)
            part = np.stack([np.interp(at, np.arange(len(columns)), column) for column in columns], axis=1)
        rows, places = slice(target[m], target[m + 1] + 1), slice(source[m], source[m + 1] + 1)
        matrix[rows] = 0.0  # the plane at a cut has the same value from both sides
        matrix[rows, places] = part
    return csr_array(matrix)


def _hermite(values: np.ndarray, n: int) -> np.ndarray:
    """Cubic Hermite interpolation of rows at ``n`` evenly spread positions; rows at integers keep their values."""
    # Slopes are of fourth order inside and of third at the ends. On the strongly stretched lines of coarse grids, whose
    # coordinates grow exponentially, wider stencils at the ends fold cells.
    position = np.arange(n) * (len(values) - 1) / max(n - 1, 1)
    at = np.clip(position.astype(int), 0, max(len(values) - 2, 0))
    if len(values) == 1:
        return values[at]
    s, steps = (position - at)[:, None], np.diff(values, axis=0)
    slopes = _slopes(steps)
    low, high = slopes[at] - steps[at], slopes[at + 1] - steps[at]
    inner = values[at] + s * (steps[at] + (1.0 - s) * ((1.0 - s) * low - s * high))
    return np.where(s == 1.0, values[at + 1], inner)


def _slopes(h: np.ndarray) -> np.ndarray:
    """Slopes at integers from the differences between them."""
    if len(h) == 1:
        return h[[0, 0]]
    if len(h) == 2:
        return np.stack([3.0 * h[0] - h[1], h[0] + h[1], 3.0 * h[1] - h[0]]) / 2.0
    first, last = ([11 * a - 7 * b + 2 * c, 2 * a + 5 * b - c] for a, b, c in (h[:3], h[:-4:-1]))
    inner = (7.0 * (h[1:-2] + h[2:-1]) - h[:-3] - h[3:]) / 12.0
    return np.concatenate([np.array(first) / 6.0, inner, np.array(last[::-1]) / 6.0])


def _coefficients(lines: LineNeighbours) -> list[csr_array]:
    """Matrices of the coefficients of all cells in the order of `TERMS`: value, slopes, second differences."""
    same = eye_array(lines.n_cells, format="csr")
    beyond = [lines.beyond(slot) for slot in range(6)]
    slopes = [0.5 * (beyond[2 * d + 1] - beyond[2 * d]) for d in range(3)]
    bends = [beyond[2 * d + 1] - 2.0 * same + beyond[2 * d] for d in range(3)]
    stacked = vstack(slopes, format="csr")
    change = {
        (d, e): 0.5 * (lines.slopes_beyond(2 * d + 1, e) - lines.slopes_beyond(2 * d, e)) @ stacked
        for d, e in product(range(3), repeat=2)
        if d != e
    }
    twists = [0.5 * (change[d, e] + change[e, d]) for d, e in ((0, 1), (0, 2), (1, 2))]
    return [same, *slopes, *bends, *twists]


def _product(factors: list[csr_array]) -> csr_array:
    """Operator on a block in C order from operators along its directions."""
    return kron(factors[0], kron(factors[1], factors[2], format="csr"), format="csr")


def _apply(matrix: csr_array | csc_array, values: np.ndarray) -> np.ndarray:
    """Product of a matrix with any number of values per row."""
    return (matrix @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])


def _scaled(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Multiply all values of a cell by its weight."""
    return values * weights.reshape(-1, *[1] * (values.ndim - 1))
