"""Measures of the cells of a slab, and their derivatives in the nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .block_cells import Slab
from .hexahedron_elements import orthogonality, orthogonality_jvp, orthogonality_vjp
from .hexahedron_runs import as_points, block_jvp, block_measures, block_vjp


@dataclass(frozen=True)
class Measures:
    """Measures of the cells of a slab, or changes or adjoints of them.

    Parameters
    ----------
    q : ndarray, shape (n_cells,)
        Orthogonality, Eq. (9).
    triples : ndarray, shape (8, n_cells)
        Corner triple products; 1 at corners that are left out.
    jacobians : ndarray, shape (8, n_cells)
        Corner Jacobians by the volume of the cell on the baseline; infinite at corners that are left out.
    volume : ndarray, shape (n_cells,)
        Volumes by those of the baseline; infinite where there was none.
    """

    q: np.ndarray
    triples: np.ndarray
    jacobians: np.ndarray
    volume: np.ndarray

    @classmethod
    def zeros_like(cls, other: Measures) -> Measures:
        """Zeros of the shapes of another."""
        return cls(*(np.zeros_like(x) for x in (other.q, other.triples, other.jacobians, other.volume)))

    def of(self, aggregate: str) -> np.ndarray:
        """The numbers that an aggregate bounds."""
        fields = {"quality": self.q, "corner": self.triples, "jacobian": self.jacobians, "volume": self.volume}
        return fields[aggregate.partition("_")[0]]


def slab_measures(slab: Slab, nodes: np.ndarray) -> Measures:
    """Measure the cells of a slab of a grid with nodes (n_nodes, 3)."""
    triples, jacobians, volume = _empty(slab)
    points = as_points(slab.solid(nodes, slab.block.normal))
    block_measures(points, slab.left_out, slab.block.handedness, triples, jacobians, volume)
    _scale(slab, jacobians, volume, np.inf)
    return Measures(orthogonality(triples, axis=0), triples, jacobians, volume)


def slab_jvp(slab: Slab, nodes: np.ndarray, d_nodes: np.ndarray, measures: Measures) -> Measures:
    """Change of the measures with the nodes."""
    d_triples, d_jacobians, d_volume = _empty(slab)
    points, d_points = as_points(slab.solid(nodes, slab.block.normal)), as_points(slab.solid(d_nodes))
    block_jvp(points, d_points, slab.left_out, slab.block.handedness, d_triples, d_jacobians, d_volume)
    _scale(slab, d_jacobians, d_volume, 0.0)
    return Measures(orthogonality_jvp(measures.triples, d_triples, axis=0), d_triples, d_jacobians, d_volume)


def slab_vjp(slab: Slab, nodes: np.ndarray, measures: Measures, bar: Measures, nodes_bar: np.ndarray) -> None:
    """Add the adjoint of the nodes, from that of the measures, to ``nodes_bar`` (n_nodes, 3)."""
    triples_bar = bar.triples + orthogonality_vjp(measures.triples, bar.q, axis=0)
    inverse = slab.block.inverse_volume[slab.in_block]
    solid = slab.solid(nodes, slab.block.normal)
    solid_bar = np.zeros(solid.shape)
    block_vjp(
        as_points(solid), slab.left_out, slab.block.handedness,
        triples_bar, bar.jacobians * inverse, bar.volume * inverse, as_points(solid_bar),
    )  # fmt: skip
    slab.add(solid_bar, nodes_bar)


def _empty(slab):
    n = slab.left_out.size
    return np.empty((8, n)), np.empty((8, n)), np.empty(n)


def _scale(slab, jacobians, volume, without):
    """Divide by the volumes of the baseline; cells that had none get the value ``without``."""
    inverse = slab.block.inverse_volume[slab.in_block]
    had_none = inverse == 0.0
    jacobians *= np.where(had_none, 1.0, inverse)
    volume *= inverse
    if had_none.any():
        jacobians[:, had_none] = volume[had_none] = without
