"""The sparse matrix of an `Evaluator`, from the same stored functions that its products use."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse
from numba import njit

from ..numerics.lanes import LANES
from ..splines.volume import basis_products, sub_net_ids
from .kernels import control_point_steps
from .runs import Runs


def assemble(runs: Sequence[Runs], control_ids, n_rows: int, n_control_points: int) -> scipy.sparse.csr_array:
    """Assemble the matrix.

    Parameters
    ----------
    runs : sequence of Runs
        The nodes of each volume.
    control_ids : sequence of ndarray of int, each of shape (N0 * N1 * N2,)
        Number of each control point of each volume.
    n_rows, n_control_points : int
        Shape of the matrix.

    Returns
    -------
    scipy.sparse.csr_array, shape (n_rows, n_control_points)
        Canonical: entries of one control point are summed, and columns ascend.
    """
    counts = np.zeros(n_rows + 1, dtype=np.int64)
    for r in runs:
        counts[1 + r.rows[: r.n_nodes].astype(np.int64)] = counts[1 + r.copy_rows.astype(np.int64)] = np.prod(r.orders)
    index_type = np.int32 if max(counts.sum(), n_control_points) < 2**31 else np.int64
    indptr = np.cumsum(counts).astype(index_type)
    indices, data = np.empty(indptr[-1], dtype=index_type), np.empty(indptr[-1])
    for r, ids in zip(runs, control_ids):
        _fill(r.orders, *r.arrays, ids, indptr, indices, data)
    matrix = scipy.sparse.csr_array((data, indices, indptr), shape=(n_rows, n_control_points))
    matrix.sum_duplicates()
    return matrix


@njit(cache=True, nogil=True, error_model="numpy")
def _fill(orders, n_control, starts, corners, basis, rows, copy_nodes, copy_rows, ids, indptr, indices, data):
    """Write the entries of the nodes of one volume, then those of their copies."""
    n_entries = orders[0] * orders[1] * orders[2]
    values, sub_net = np.empty(orders[0] + orders[1] + orders[2]), np.empty(n_entries, dtype=np.int64)
    for run in range(corners.size):
        sub_net_ids(orders, corners[run], control_point_steps(n_control, corners[run]), sub_net)
        for node in range(starts[run], starts[run + 1]):
            unpack(orders, basis, starts[run], starts[run + 1], node, values)
            first = indptr[rows[node]]
            basis_products(orders, values, data[first : first + n_entries])
            for m in range(n_entries):
                indices[first + m] = ids[sub_net[m]]
    for copy in range(copy_nodes.size):
        target, source = indptr[copy_rows[copy]], indptr[rows[copy_nodes[copy]]]
        indices[target : target + n_entries] = indices[source : source + n_entries]
        data[target : target + n_entries] = data[source : source + n_entries]


@njit(cache=True, nogil=True, error_model="numpy")
def unpack(orders, basis, start, end, node, values):
    """Write all functions of a node of the run ``start <= node < end`` to ``values``; the anchor's is 1 - the rest."""
    lane = (node - start) % LANES
    first = node - lane
    n = min(LANES, end - first)
    entry = first * (orders[0] + orders[1] + orders[2] - 3) + lane
    m = 0
    for d in range(3):
        anchor, values[m] = m, 1.0
        for _ in range(1, orders[d]):
            m += 1
            values[m] = basis[entry]
            values[anchor] -= basis[entry]
            entry += n
        m += 1
