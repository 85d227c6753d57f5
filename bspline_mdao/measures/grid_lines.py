"""Grid lines of a surface of quads: where they run straight on through a node, whatever the faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["GridLines"]


@dataclass(frozen=True, eq=False)
class GridLines:
    """Which edge continues which.

    Two edges at a node continue each other if no quad lies between them and neither has another such partner: the
    opposite ones of the four at an ordinary node, and those along the rim of the surface.

    Parameters
    ----------
    behind, at, ahead : ndarray of int, shape (n,)
        Three successive nodes of a line; every triple is there in both directions, in ascending order of the first two.
    n_nodes : int
        Number of nodes.
    """

    behind: np.ndarray
    at: np.ndarray
    ahead: np.ndarray
    n_nodes: int

    @classmethod
    def of(cls, quads: np.ndarray, n_nodes: int) -> GridLines:
        """Find the lines of quads, shape (n_quads, 4), numbered around; corners may coincide."""
        edges = _directed_edges(quads)
        turns = _turns(quads)
        pairs = _pairs_of_edges(edges, n_nodes)
        key = (edges[pairs[:, 0]] @ [n_nodes, 1]) * np.int64(n_nodes) + edges[pairs[:, 1], 1]
        between = (turns[:, :2] @ [n_nodes, 1]) * np.int64(n_nodes) + turns[:, 2]
        pairs = pairs[~np.isin(key, between)]
        partners = [np.bincount(numbers, minlength=len(edges)) for numbers in pairs.T]
        pairs = pairs[(partners[0][pairs[:, 0]] == 1) & (partners[1][pairs[:, 1]] == 1)]
        return cls(*edges[pairs[:, 0]].T, edges[pairs[:, 1], 1], n_nodes)

    def next(self, behind: np.ndarray, at: np.ndarray) -> np.ndarray:
        """Node after two successive ones, each of shape (m,); -1 where the line ends."""
        keys, wanted = self.behind * self.n_nodes + self.at, behind * self.n_nodes + at
        place = np.minimum(np.searchsorted(keys, wanted), max(len(keys) - 1, 0))
        return np.where((keys[place] == wanted) & (at >= 0), self.ahead[place], -1)

    def walk(self, start: np.ndarray, second: np.ndarray) -> np.ndarray:
        """Follow lines from their first two nodes, each of shape (m,), to their ends; shape (m, longest), -1 behind.

        A line that closes is left where it has come round.
        """
        columns = [start, second]
        while (columns[-1] >= 0).any():
            following = self.next(columns[-2], columns[-1])
            columns.append(np.where(following == start, -1, following))
        return np.stack(columns[:-1], axis=1)


def _directed_edges(quads):
    """All edges in both directions, shape (n, 2), in ascending order, without those of no length."""
    ends = np.concatenate([quads[:, [corner, (corner + 1) % 4]] for corner in range(4)])
    ends = ends[ends[:, 0] != ends[:, 1]]
    return np.unique(np.concatenate([ends, ends[:, ::-1]]), axis=0)


def _turns(quads):
    """Successive corners of the quads in both directions, shape (n, 3)."""
    corners = [quads[:, [corner - 1, corner, (corner + 1) % 4]] for corner in range(4)]
    for corner in range(4):  # a side of no length is passed over
        collapsed = quads[quads[:, corner] == quads[:, (corner + 1) % 4]]
        corners.append(collapsed[:, [corner - 1, corner, (corner + 2) % 4]])
    turns = np.concatenate(corners)
    return np.concatenate([turns, turns[:, ::-1]])


def _pairs_of_edges(edges, n_nodes):
    """Edge into a node and edge out of it to another one: numbers, shape (n, 2), ascending in the first."""
    first = np.searchsorted(edges[:, 0], np.arange(n_nodes + 1))
    degree = np.diff(first)[edges[:, 1]]
    into = np.repeat(np.arange(len(edges)), degree)
    out = first[edges[into, 1]] + np.arange(len(into)) - np.repeat(np.cumsum(degree) - degree, degree)
    keep = edges[into, 0] != edges[out, 1]
    return np.stack([into[keep], out[keep]], axis=1)
