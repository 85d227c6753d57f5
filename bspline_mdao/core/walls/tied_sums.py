"""Matrices of points of periodic sides: sums over all copies, each turned back, as in the whole wheel.

A point of a side sees its neighbours on the one side of it, and its copy sees the neighbours on the other side. With
the rotations T_c that map the point to its copies, and the matrices M_c of these, all of them have, up to these
rotations,

    M = sum_c T_c^T M_c T_c.

Edges between points of a side are seen by several copies, and count as a fraction in each. A point on the axis of a
sector sees the same in all sectors: its matrix is the mean over all turns about the axis. Both maps are symmetric.

Theory: ``docs/theory/topology.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...grids.topology.periodic_ties import Ties

__all__ = ["TiedSums"]

DECIMALS = 6
"""Decimals, of rotations and of shifts relative to the size, to which edges are the same up to a motion."""


@dataclass(frozen=True, eq=False)
class TiedSums:
    """Sums over the copies of points."""

    ties: Ties

    def of(self, matrices: np.ndarray) -> np.ndarray:
        """Matrices of all points, shape (n, 3, 3), with the sums of their groups; its own transpose."""
        ties, sums = self.ties, matrices.copy()
        back = np.einsum("nji,njk,nkl->nil", ties.turns, matrices[ties.copies], ties.turns)
        np.add.at(sums, ties.originals, back)
        ids, across = self._across
        sums[ids] = _mean_of_turns(sums[ids], across)
        sums[ties.copies] = np.einsum("nij,njk,nlk->nil", ties.turns, sums[ties.originals], ties.turns)
        return sums

    @property
    def _across(self) -> tuple[np.ndarray, np.ndarray]:
        """Points on axes, each once, and the projector of each across its axis, shape (n, 3, 3)."""
        ids, number = np.unique(self.ties.on_axis, return_inverse=True)
        across = np.zeros((len(ids), 3, 3))
        np.add.at(across, number, np.einsum("ni,nj->nij", self.ties.across, self.ties.across))
        return ids, across

    def fractions(self, starts: np.ndarray, neighbours: np.ndarray, size: float) -> np.ndarray:
        """Fraction with which each edge from a point to a neighbour counts: 1 / how many copies of the point see it."""
        # Edges are the same if they join copies of the same two points that have the same relative motion. A point on
        # an axis has no place in a sector.
        ties, n = self.ties, len(starts) - 1
        root, turns, shifts = np.arange(n), np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
        root[ties.copies], turns[ties.copies], shifts[ties.copies] = ties.originals, ties.turns, ties.shifts
        is_tied, is_on_axis = np.isin(root, ties.ids), np.isin(root, ties.on_axis)
        first = np.repeat(np.arange(n), np.diff(starts))
        sides = np.flatnonzero(is_tied[first] & is_tied[neighbours])
        a, b = first[sides], neighbours[sides]
        turn = np.einsum("nji,njk->nik", turns[a], turns[b]).reshape(-1, 9)
        shift = np.einsum("nji,nj->ni", turns[a], shifts[b] - shifts[a]) / size
        keys = np.column_stack([root[a], root[b], np.round(np.concatenate([turn, shift], axis=1), DECIMALS) + 0.0])
        keys[is_on_axis[a] | is_on_axis[b], 2:] = 0.0
        _, number, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        fractions = np.ones(len(neighbours))
        fractions[sides] = 1.0 / counts[number.ravel()]
        return fractions


def _mean_of_turns(matrices: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Mean over all turns about an axis, given the projector across it, both of shape (n, 3, 3)."""
    along = np.eye(3) - across
    on_axis = np.einsum("nij,nij->n", along, matrices)[:, None, None]
    rest = 0.5 * np.einsum("nij,nij->n", across, matrices)[:, None, None]
    skew = 0.5 * (matrices - matrices.transpose(0, 2, 1))
    return on_axis * along + rest * across + across @ skew @ across
