"""Symbolic analysis of an elimination: its tree, and the supernodes of the factor.

A supernode is a set of adjacent columns of the factor that share their rows and are eliminated as one dense front. The
*front* of a supernode has its own points first and then its *rows*, the later points coupled to them by elimination. A
fundamental supernode has no zero in its front. Merging one into its parent stores some zeros, but makes larger dense
matrices: it is done if a model of the time of a front says that it pays.

Theory: ``docs/theory/sparse.rst``, "Fronts".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

__all__ = ["Supernodes", "column_counts", "elimination_tree", "find_supernodes", "front_seconds", "postorder"]


class Supernodes(NamedTuple):
    """The elimination of a graph, as a forest of dense fronts."""

    order: np.ndarray  # int32 (n,), points in the order of their elimination
    rank: np.ndarray  # int32 (n,), position of every point in that order
    firsts: np.ndarray  # int32 (n_supernodes + 1,), first position of every supernode; children before their parents
    parents: np.ndarray  # int32 (n_supernodes,), parent of every supernode, -1 for a root
    row_starts: np.ndarray  # int64 (n_supernodes + 1,), where the rows of each start
    rows: np.ndarray  # int32 (n_rows,), positions coupled with each supernode, beyond its own, ascending


def find_supernodes(
    # the graph
    starts: np.ndarray,  # ndarray of int
    neighbours: np.ndarray,  # ndarray of int
    order: np.ndarray,  # int32 (n,), points in the desired order
) -> Supernodes:
    """Analyse the elimination of a graph in a given order, which is changed to an equivalent one."""
    # 1. Find the elimination tree and number it in postorder, which does not change the fill.
    # 2. Count the entries of the columns of the factor.
    # 3. Join columns to fundamental supernodes [1].
    # 4. Merge supernodes into their parents if storing some zeros pays [2] [3].
    # 5. Find the rows of every front.
    # - [1] J. W. H. Liu, E. G. Ng, B. W. Peyton, "On finding supernodes for sparse matrix computations", SIAM J. Matrix
    #   Anal. Appl. 14 (1993), 242-252.
    # - [2] I. S. Duff, J. K. Reid, "The multifrontal solution of indefinite sparse symmetric linear equations", ACM
    #   Trans. Math. Softw. 9 (1983), 302-325.
    # - [3] C. Ashcraft, R. Grimes, "The influence of relaxed supernode partitions on the multifrontal method", ACM
    #   Trans. Math. Softw. 15 (1989), 291-309.
    order, rank, parent = _in_postorder(starts, neighbours, order)  # step 1
    counts = column_counts(starts, neighbours, order, rank, parent)  # step 2
    members, sizes, parents = _merged(*_fundamental(parent, counts))  # steps 3 and 4
    order = order[members]
    rank = _inverse(order)
    firsts = np.concatenate(([0], np.cumsum(sizes))).astype(np.int32)
    row_starts, rows = _front_rows(starts, neighbours, order, rank, firsts, parents)  # step 5
    rows = rows[np.lexsort((rows, np.repeat(np.arange(len(sizes)), np.diff(row_starts))))]
    return Supernodes(order, rank, firsts, parents, row_starts, rows)


def _in_postorder(
    starts: np.ndarray, neighbours: np.ndarray, order: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Equivalent order that is a postorder of its elimination tree; its inverse; the tree."""
    rank = _inverse(order)
    parent = elimination_tree(starts, neighbours, order, rank)
    places = postorder(parent)
    new_place = _inverse(places)
    moved = parent[places]
    return order[places], new_place[rank], np.where(moved < 0, -1, new_place[moved]).astype(np.int32)


def _inverse(permutation: np.ndarray) -> np.ndarray:
    """Inverse of a permutation."""
    inverse = np.empty(len(permutation), np.int32)
    inverse[permutation] = np.arange(len(permutation), dtype=np.int32)
    return inverse


@njit(cache=True)
def elimination_tree(
    # graph of the matrix
    starts,  # ndarray of int
    neighbours,  # ndarray of int
    # point at every position of the order, and its inverse
    order,  # int32 (n,)
    rank,  # int32 (n,)
):  # int32 (n,), parent of every position; -1 for a root
    """Find the elimination tree of a symmetric pattern in a given order [1]."""
    # In the factor L of the reordered matrix, the parent of column j is the row of the first entry below the diagonal.
    # Row after row, for every entry of the matrix left of the diagonal:
    # 1. Climb from its column towards the root of its current subtree.
    # 2. Point every node on the way to the row, so that the next climb is short (path compression).
    # 3. If a root is reached, the row becomes its parent.
    # - [1] J. W. H. Liu, "The role of elimination trees in sparse factorization", SIAM J. Matrix Anal. Appl. 11 (1990),
    #   134-172.
    n = len(order)
    parent, ancestor = np.full(n, -1, np.int32), np.full(n, -1, np.int32)
    for row in range(n):
        point = order[row]
        for neighbour in neighbours[starts[point] : starts[point + 1]]:
            node = rank[neighbour]
            while node < row and node != -1:  # step 1
                above = ancestor[node]
                ancestor[node] = row  # step 2
                if above == -1:  # step 3
                    parent[node] = row
                node = above if above != row else -1
    return parent


@njit(cache=True)
def postorder(parent):
    """Nodes of a forest, children (ascending) before their parents, every subtree contiguous; int32, shape (n,)."""
    n = len(parent)
    first_child, next_sibling = np.full(n + 1, -1, np.int32), np.full(n, -1, np.int32)
    for node in range(n - 1, -1, -1):
        next_sibling[node] = first_child[parent[node]]  # roots are children of an entry after the last
        first_child[parent[node]] = node
    result, stack, n_done, top = np.empty(n, np.int32), np.empty(n, np.int32), 0, 0
    stack[0] = root = first_child[n]
    while top >= 0 and root != -1:
        node = stack[top]
        child = first_child[node]
        if child != -1:
            first_child[node] = next_sibling[child]
            top += 1
            stack[top] = child
            continue
        result[n_done] = node
        n_done += 1
        top -= 1
        if top < 0 and next_sibling[root] != -1:
            root = next_sibling[root]
            stack[0], top = root, 0
    return result


@njit(cache=True)
def column_counts(starts, neighbours, order, rank, parent):
    """Count the entries of every column of the factor, including the diagonal, without making the factor [1]."""
    # The order must be a postorder of its tree. Every row i of the factor is a subtree with its root on the diagonal,
    # and column j holds row i when j is in that subtree; its leaves are among the entries of that row of the matrix.
    # The count of a column is a sum of weights over its descendants:
    # 1. Every leaf of the tree adds one, for its diagonal; every other node subtracts one from its parent for itself.
    # 2. A node is a leaf of row i if no descendant of it is one: nothing of its subtree has been seen in that row.
    # 3. A leaf of a row adds its path to the root,
    # 4. and subtracts the part shared with the previous leaf: the path from their lowest common ancestor.
    # 5. Sum the weights towards the roots.
    # - [1] J. R. Gilbert, E. G. Ng, B. W. Peyton, "An efficient algorithm to compute row and column counts for sparse
    #   Cholesky factorization", SIAM J. Matrix Anal. Appl. 15 (1994), 1075-1091.
    n = len(order)
    counts = np.zeros(n, np.int64)
    first = _first_descendants(parent)
    previous_leaf, newest_first = np.full(n, -1, np.int32), np.full(n, -1, np.int32)
    ancestor = np.arange(n).astype(np.int32)
    for node in range(n):
        if first[node] == node:  # step 1
            counts[node] += 1
        if parent[node] != -1:
            counts[parent[node]] -= 1
        for neighbour in neighbours[starts[order[node]] : starts[order[node] + 1]]:
            row = rank[neighbour]
            if row <= node or first[node] <= newest_first[row]:  # step 2
                continue
            newest_first[row] = first[node]
            counts[node] += 1  # step 3
            if previous_leaf[row] != -1:
                counts[_root(ancestor, previous_leaf[row])] -= 1  # step 4
            previous_leaf[row] = node
        if parent[node] != -1:
            ancestor[node] = parent[node]
    for node in range(n):  # step 5
        if parent[node] != -1:
            counts[parent[node]] += counts[node]
    return counts


@njit(cache=True)
def _first_descendants(parent):
    """Smallest node of the subtree of every node of a postordered forest."""
    first = np.arange(len(parent)).astype(np.int32)
    for node in range(len(parent)):
        if parent[node] != -1:
            first[parent[node]] = min(first[parent[node]], first[node])
    return first


@njit(cache=True)
def _root(ancestor, node):
    """Root of a node among the subtrees seen so far, with path compression."""
    root = node
    while ancestor[root] != root:
        root = ancestor[root]
    while ancestor[node] != root:
        ancestor[node], node = root, ancestor[node]
    return root


@njit(cache=True)
def _fundamental(parent, counts):
    """Join adjacent columns with equal rows: first column of each supernode, its size, rows, and parent."""
    # A column is joined with the previous one if it is its parent and has one entry less. That joins more than the
    # definition requires, namely an only child: other children add no new row.
    n = len(parent)
    supernode, firsts, n_supernodes = np.empty(n, np.int32), np.empty(n + 1, np.int32), 0
    for column in range(n):
        if column == 0 or parent[column - 1] != column or counts[column - 1] != counts[column] + 1:
            firsts[n_supernodes] = column
            n_supernodes += 1
        supernode[column] = n_supernodes - 1
    firsts[n_supernodes] = n
    sizes, n_rows = np.empty(n_supernodes, np.int64), np.empty(n_supernodes, np.int64)
    parents = np.full(n_supernodes, -1, np.int32)
    for s in range(n_supernodes):
        last = firsts[s + 1] - 1
        sizes[s], n_rows[s] = firsts[s + 1] - firsts[s], counts[last] - 1
        if parent[last] != -1:
            parents[s] = supernode[parent[last]]
    return firsts[:n_supernodes], sizes, n_rows, parents


@njit(cache=True)
def front_seconds(size, n_rows):
    """Model of the time (s) of a front with given numbers of own points and rows."""
    # Arithmetic at 35 Gflop/s, traffic of the update and of the panel, and 4 microseconds for calls. These are
    # constants, so supernodes, and with them all round-off, are the same on every machine.
    pivots, rest = 3.0 * size, 3.0 * n_rows
    arithmetic = pivots * (pivots * pivots / 3.0 + pivots * rest + rest * rest)
    return arithmetic / 3.5e10 + 6e-10 * rest * rest + 2e-9 * pivots * (pivots + rest) + 4e-6


@njit(cache=True)
def _merged(firsts, sizes, n_rows, parents):
    """Merge supernodes into their parents if `front_seconds` says that it saves time."""
    # Returns the columns in their new order, the sizes and the parents of the supernodes that remain.
    n = len(sizes)
    into, sizes_0 = np.arange(n).astype(np.int32), sizes.copy()
    for child in range(n):
        parent = parents[child]
        if parent == -1:
            continue
        apart = front_seconds(sizes[child], n_rows[child]) + front_seconds(sizes[parent], n_rows[parent])
        if front_seconds(sizes[child] + sizes[parent], n_rows[parent]) <= apart:
            into[child] = parent
            sizes[parent] += sizes[child]
    for child in range(n - 1, -1, -1):
        into[child] = into[into[child]]
    return _collect(into, firsts, sizes_0, sizes, parents)


@njit(cache=True)
def _collect(into, firsts, sizes_0, sizes, parents):
    """Make the columns of each merged supernode contiguous, keeping the order of the supernodes."""
    n = len(into)
    number, n_kept = np.full(n, -1, np.int32), 0
    ends = np.zeros(n, np.int64)
    n_columns = 0
    for s in range(n):
        if into[s] == s:
            number[s] = n_kept
            ends[s] = n_columns
            n_columns += sizes[s]
            n_kept += 1
    members = np.empty(n_columns, np.int32)
    new_sizes, new_parents = np.empty(n_kept, np.int64), np.full(n_kept, -1, np.int32)
    for s in range(n):
        target = into[s]
        for column in range(firsts[s], firsts[s] + sizes_0[s]):
            members[ends[target]] = column
            ends[target] += 1
        if target == s:
            new_sizes[number[s]] = sizes[s]
            if parents[s] != -1:
                new_parents[number[s]] = number[into[parents[s]]]
    return members, new_sizes, new_parents


@njit(cache=True)
def _front_rows(starts, neighbours, order, rank, firsts, parents):
    """Rows of every supernode: from the matrix and from its children, without its own points."""
    n_supernodes = len(parents)
    first_child, next_sibling = np.full(n_supernodes, -1, np.int32), np.full(n_supernodes, -1, np.int32)
    row_starts, rows = np.zeros(n_supernodes + 1, np.int64), np.empty(16 * len(order) + 16, np.int32)
    seen = np.full(len(order), -1, np.int32)
    for s in range(n_supernodes):
        end = row_starts[s]
        if len(rows) < end + len(order):
            rows = np.concatenate((rows, np.empty(len(rows) + len(order), np.int32)))
        for place in range(firsts[s], firsts[s + 1]):
            for neighbour in neighbours[starts[order[place]] : starts[order[place] + 1]]:
                end = _add_row(rank[neighbour], s, firsts[s + 1], seen, rows, end)
        child = first_child[s]
        while child != -1:
            for row in rows[row_starts[child] : row_starts[child + 1]]:
                end = _add_row(row, s, firsts[s + 1], seen, rows, end)
            child = next_sibling[child]
        row_starts[s + 1] = end
        if parents[s] != -1:
            next_sibling[s] = first_child[parents[s]]
            first_child[parents[s]] = s
    return row_starts, rows[: row_starts[n_supernodes]].copy()


@njit(cache=True)
def _add_row(row, supernode, first_row, seen, rows, end):
    """Append a row that is new to the supernode; return the new end of the list."""
    if row < first_row or seen[row] == supernode:
        return end
    seen[row] = supernode
    rows[end] = row
    return end + 1
