"""The elimination tree of a symmetric pattern in a given order, and how full the columns of its factor are.

In the factor L of the reordered matrix, the parent of column j is the row of the first entry below the diagonal. Every
row of L is a subtree with its root on the diagonal, whose leaves are among the entries of that row of the matrix
[Liu, The role of elimination trees in sparse factorization, SIAM J. Matrix Anal. Appl. 11 (1990)].
"""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["column_counts", "elimination_tree", "postorder"]


@njit(cache=True)
def elimination_tree(starts, neighbours, order, rank):
    """Parents in the elimination tree.

    Parameters
    ----------
    starts, neighbours : ndarray of int
        Graph of the matrix.
    order, rank : ndarray of int32, shape (n,)
        Point at every place of the order, and its inverse.

    Returns
    -------
    ndarray of int32, shape (n,)
        Parent of every place; -1 for a root.
    """
    n = len(order)
    parent, ancestor = np.full(n, -1, np.int32), np.full(n, -1, np.int32)
    for row in range(n):
        point = order[row]
        for neighbour in neighbours[starts[point] : starts[point + 1]]:
            node = rank[neighbour]
            while node < row and node != -1:
                above = ancestor[node]
                ancestor[node] = row
                if above == -1:
                    parent[node] = row
                node = above if above != row else -1
    return parent


@njit(cache=True)
def postorder(parent):
    """Nodes of a forest, children (ascending) before their parents, every subtree in one piece; int32, shape (n,)."""
    n = len(parent)
    first_child, next_sibling = np.full(n + 1, -1, np.int32), np.full(n, -1, np.int32)
    for node in range(n - 1, -1, -1):
        next_sibling[node] = first_child[parent[node]]  # roots hang on the entry behind the last
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
    """Entries of every column of the factor, the diagonal included; the order must be a postorder of its tree.

    Column j holds row i when j is in the subtree of row i. Walking from leaf to leaf of each such subtree, every leaf
    adds its path to the root and takes away what it shares with the leaf before it, the path from their lowest common
    ancestor [Gilbert, Ng and Peyton, SIAM J. Matrix Anal. Appl. 15 (1994)].
    """
    n = len(order)
    counts = np.zeros(n, np.int64)
    first = _first_descendants(parent)
    previous_leaf, newest_first = np.full(n, -1, np.int32), np.full(n, -1, np.int32)
    ancestor = np.arange(n).astype(np.int32)
    for node in range(n):
        if first[node] == node:
            counts[node] += 1
        if parent[node] != -1:
            counts[parent[node]] -= 1
        for neighbour in neighbours[starts[order[node]] : starts[order[node] + 1]]:
            row = rank[neighbour]
            if row <= node or first[node] <= newest_first[row]:
                continue
            newest_first[row] = first[node]
            counts[node] += 1
            if previous_leaf[row] != -1:
                counts[_root(ancestor, previous_leaf[row])] -= 1
            previous_leaf[row] = node
        if parent[node] != -1:
            ancestor[node] = parent[node]
    for node in range(n):
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
