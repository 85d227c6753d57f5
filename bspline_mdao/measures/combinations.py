"""Vectors that are fixed combinations of nodes, from which measures are made place by place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, vstack

__all__ = ["Combinations"]


@dataclass(frozen=True, eq=False)
class Combinations:
    """Several vectors at each of n places, every one a fixed combination of nodes: tangents, differences, chords.

    A number of each place, made of its vectors, then has closed-form derivatives on a fixed pattern.

    Parameters
    ----------
    stack : csr_array, shape (n_kinds n, n_nodes)
        Coefficients: all places of the first kind of vector, then all of the next.
    n_kinds : int
        Vectors at each place.
    pattern : csr_array of int, shape (n, n_nodes)
        Which nodes belong to a place.
    gather : csr_array, shape (pattern.nnz, n_kinds n)
        From derivatives in the vectors to those in the nodes of the pattern.
    """

    stack: csr_array
    n_kinds: int
    pattern: csr_array
    gather: csr_array

    @classmethod
    def of(cls, matrices: Sequence[csr_array]) -> Combinations:
        """Take the coefficients of every kind of vector, each of shape (n, n_nodes)."""
        stack = csr_array(vstack(matrices, format="csr"))
        n_places, n_nodes = matrices[0].shape
        entries = stack.tocoo()
        keys = (entries.row % n_places) * np.int64(n_nodes) + entries.col
        unique, number = np.unique(keys, return_inverse=True)
        places = (np.arange(len(unique)), (unique // n_nodes, unique % n_nodes))
        pattern = csr_array(places, shape=(n_places, n_nodes))
        gather = csr_array((entries.data, (number, entries.row)), shape=(len(unique), stack.shape[0]))
        return cls(stack, len(matrices), pattern, gather)

    @property
    def n_places(self) -> int:
        """Number of places."""
        return self.pattern.shape[0]

    def vectors(self, points: np.ndarray) -> np.ndarray:
        """Vectors, shape (n_kinds, n, 3), of nodes, shape (n_nodes, 3)."""
        return (self.stack @ points).reshape(self.n_kinds, -1, 3)

    def chain(self, gradients: Sequence[np.ndarray]) -> csr_array:
        """Differentiate one number per place in the nodes, shape (n, 3 n_nodes).

        Parameters
        ----------
        gradients : sequence of ndarray, each of shape (n, 3)
            Derivatives of the number of every place in its vectors, kind by kind.
        """
        data = self.gather @ np.concatenate(gradients)
        columns = 3 * self.pattern.indices[:, None] + np.arange(3)
        shape = (self.n_places, 3 * self.pattern.shape[1])
        return csr_array((data.ravel(), columns.ravel(), 3 * self.pattern.indptr), shape=shape)

    def pull(self, gradients: Sequence[np.ndarray]) -> np.ndarray:
        """Differentiate the sum of the numbers of all places in the nodes, shape (n_nodes, 3)."""
        return self.stack.T @ np.concatenate(gradients)
