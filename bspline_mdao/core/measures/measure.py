"""The interface of every measure of a surface, and building blocks of measures.

A measure computes one or more numbers from the nodes of a `SurfaceGrid`, and their sparse derivatives. A user's own
measure is any object with the members of `Measure`; `bspline_mdao.SurfaceMeasure` makes a component of it. The
derivatives of a single number are one row, its gradient (`single_row`, `row_at`); a measure with one number per place
is made of `Combinations`. Theory: ``docs/theory/geometry.rst``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from scipy.sparse import csr_array, vstack

from ...base.display import OneLine
from ...errors import InputError
from ..mesh.surface import SurfaceGrid

__all__ = ["MEMBERS", "Combinations", "Measure", "relative_to_baseline", "row_at", "single_row"]


MEMBERS = ("name", "units", "shape", "surface", "evaluate", "partials")
"""Names of the members of `Measure`, by which a component recognises one."""


class Measure(Protocol):
    """One or more numbers that describe a surface."""

    @property
    def name(self) -> str:
        """Name of the output."""

    @property
    def units(self) -> str | None:
        """Units of the numbers."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the output."""

    @property
    def surface(self) -> SurfaceGrid:
        """The measured surface, on whose baseline nodes all discrete choices are made."""

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Measure nodes, shape (n, 3), in metres, real or complex; the result has the shape ``shape``."""

    def partials(self, points: np.ndarray) -> csr_array:
        """Differentiate `evaluate` in C order: shape (size, 3 n), with a pattern independent of the nodes."""


def relative_to_baseline(
    measure: Any,  # dataclass, measure with a field ``scale``, its divisor
    least: float,  # absolute value up to which there is nothing to divide by
) -> Any:
    """Return a measure divided by its value on the baseline."""
    value = float(measure.evaluate(measure.surface.points)[0])
    if not abs(value) > least:
        raise InputError(f"{measure.name}: {value:.3g} on the baseline, nothing to be relative to; take relative=False")
    return replace(measure, scale=measure.scale * value)


def single_row(gradient: np.ndarray) -> csr_array:
    """Derivatives of one number, shape (1, 3 n_points), from its gradient, shape (n_points, 3); zeros kept."""
    return row_at(np.arange(len(gradient)), gradient, len(gradient))


def row_at(
    ids: np.ndarray,  # int (n,), the nodes
    gradient: np.ndarray,  # (n, 3), derivatives with respect to their coordinates
    n_points: int,  # number of all nodes
) -> csr_array:
    """Derivatives of one number, shape (1, 3 n_points), that depends on some nodes: its gradient; zeros kept."""
    columns = (3 * ids[:, None] + np.arange(3)).ravel()
    return csr_array((gradient.ravel(), columns, np.array([0, len(columns)])), shape=(1, 3 * n_points))


@dataclass(frozen=True, eq=False)
class Combinations(OneLine):
    """Several vectors at each of n places, each a fixed combination of nodes: tangents, differences, chords."""

    # A number at each place, computed from its vectors, then has closed-form derivatives on a fixed pattern.

    stack: csr_array  # (n_kinds n, n_nodes), coefficients: all places for the first kind of vector, then for the next
    n_kinds: int  # vectors at each place
    pattern: csr_array  # int (n, n_nodes), nodes that belong to each place
    gather: csr_array  # (pattern.nnz, n_kinds n), from derivatives by vectors to derivatives by nodes of the pattern

    @classmethod
    def of(cls, matrices: Sequence[csr_array]) -> Combinations:
        """Combine the coefficients of every kind of vector, each of shape (n, n_nodes)."""
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
        """Vectors, shape (n_kinds, n, 3), from nodes, shape (n_nodes, 3)."""
        return (self.stack @ points).reshape(self.n_kinds, -1, 3)

    def chain(
        self,
        # derivatives of the number at every place with respect to its vectors, kind by kind
        gradients: Sequence[np.ndarray],  # each (n, 3)
    ) -> csr_array:
        """Differentiate one number per place with respect to the nodes, shape (n, 3 n_nodes)."""
        data = self.gather @ np.concatenate(gradients)
        columns = 3 * self.pattern.indices[:, None] + np.arange(3)
        shape = (self.n_places, 3 * self.pattern.shape[1])
        return csr_array((data.ravel(), columns.ravel(), 3 * self.pattern.indptr), shape=shape)

    def pull(self, gradients: Sequence[np.ndarray]) -> np.ndarray:
        """Differentiate the sum of the numbers of all places with respect to the nodes, shape (n_nodes, 3)."""
        return self.stack.T @ np.concatenate(gradients)
