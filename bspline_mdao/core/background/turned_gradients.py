"""Energy of a background lattice: how far the gradients of its displacement deviate from prescribed rotations.

    E(d) = h0^2 / 2 sum over spans of q integral of |grad d - (R - I)|^2 ,    q = prod over directions of t h0 / h^2 ,

Here h is the width that a span has unless a narrower one is requested, and t is the square of its actual width divided
by h. In q, h0 is the smallest h of each direction; before the sum it is the geometric mean of these. The energy has the
unit of a squared displacement and is independent of size. R is known at two Gauss points in each direction of each
span. This is exact if R is constant, so a rigid motion has zero energy.

In cylindrical coordinates, circumferential slopes are with respect to arc length: r0 / r times the slopes with respect
to the coordinate. The rotation of the directions is neglected. In a periodic sector its effect is small, because
nothing that is independent of the angle contributes to it.

All operators are products of one-dimensional matrices, applied one direction at a time.

Theory: ``docs/theory/background_lattice.rst``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.sparse import csr_array, kron

from ...base.display import OneLine
from .background_lattice import BackgroundLattice
from .lattice_frame import AROUND
from .lattice_line import LatticeLine

__all__ = ["TurnedGradients"]

NEAR = 1.0
"""Power of h0 / h. The stiffer narrow spans are relative to wide ones, the more of a rotation happens in the wide ones.
With 0, the smallest Q of an H-H grid whose wing is bent by 60 degrees is a third of what it is with 1."""

IN_GAPS = 2.0
"""Power of the relative width in t, for spans that a gap requests to be narrower. Bodies that move apart are better
served by bending only. With 0 or 1, cells next to a flap that leaves its wing are inverted."""

N_PLACES = 2
"""Gauss points in each direction of each span."""


@dataclass(frozen=True, eq=False)
class TurnedGradients(OneLine):
    """Gradients of a lattice at the places with known rotations, and their energy."""

    lattice: BackgroundLattice

    @cached_property
    def energy(self) -> csr_array:
        """Matrix of the energy of one component, shape (n_unknowns, n_unknowns)."""
        (x0, y0, z0), (x1, y1, z1) = (
            [line.products(m, self._weights_of(line)) for line in self.lattice.lines] for m in range(2)
        )
        y0_around = self.lattice.lines[1].products(0, self._weights_of(self.lattice.lines[1]), self._squared_steepness)
        across = kron(y1, z0) + kron(y0_around, z1)
        return csr_array(self._scale * (kron(x0, across) + kron(x1, kron(y0, z0))))

    def at_places(self, unknowns: np.ndarray) -> np.ndarray:
        """Fields of unknowns, shape (n_unknowns, m), at the places, shape (n_places, m)."""
        return self._applied([value for value, _, _ in self._tables], unknowns)

    def at_places_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `at_places`."""
        return self._applied([value.T for value, _, _ in self._tables], bar)

    def pull(self, turns: np.ndarray) -> np.ndarray:
        """Load of R - I at the places, shape (n_places, 3, 3), on the unknowns, shape (n_unknowns, 3)."""
        total = np.zeros((int(np.prod([value.shape[1] for value, _, _ in self._tables])), 3))
        for axis in self._directions:
            total += self._applied([matrix.T for matrix in self._weighted(axis)], turns[:, :, axis])
        return self._scale * total

    def pull_vjp(self, bar: np.ndarray) -> np.ndarray:
        """Transpose of `pull`."""
        turns_bar = np.zeros((int(np.prod([value.shape[0] for value, _, _ in self._tables])), 3, 3))
        for axis in self._directions:
            turns_bar[:, :, axis] = self._applied(self._weighted(axis), self._scale * bar)
        return turns_bar

    @property
    def _directions(self) -> list[int]:
        """Directions in which the field may change."""
        return [axis for axis, line in enumerate(self.lattice.lines) if not line.is_tied]

    @cached_property
    def _scale(self) -> float:
        """The factor h0^2 (m^2)."""
        smallest = [self.lattice.lines[axis].scales.min() for axis in self._directions]
        return float(np.prod(smallest) ** (2.0 / len(smallest)))

    @staticmethod
    def _weights_of(line: LatticeLine) -> np.ndarray:
        """Weights q of the spans of one direction (1/m)."""
        narrowed = np.diff(line.breaks) / line.scales
        return narrowed**IN_GAPS * (line.scales.min() / line.scales) ** NEAR / line.scales

    @cached_property
    def _tables(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """For each direction: values and slopes of unknowns at the places, and weights of the places."""
        found = []
        for line in self.lattice.lines:
            values, lengths = line.at_gauss_points(0, N_PLACES)
            slopes, _ = line.at_gauss_points(1, N_PLACES)
            weights = lengths if line.is_tied else lengths * np.repeat(self._weights_of(line), N_PLACES)
            found.append((values.toarray(), slopes.toarray(), weights))
        return found

    def _weighted(self, along: int) -> list[np.ndarray]:
        """Weighted slopes in one direction, and values in the others, of unknowns at the places."""
        found = [
            (slopes if axis == along else values) * weights[:, None]
            for axis, (values, slopes, weights) in enumerate(self._tables)
        ]
        if along == AROUND and not self.lattice.frame.is_cartesian:
            found[1] *= self.lattice.frame.steepness(self.lattice.lines[1].gauss_points(N_PLACES))[:, None]
        return found

    @property
    def _squared_steepness(self) -> Callable[[np.ndarray], np.ndarray] | None:
        """Factors of squared slopes in the third direction for each second coordinate (m); None if all are one."""
        frame = self.lattice.frame
        return None if frame.is_cartesian else lambda radii: frame.steepness(radii) ** 2

    @staticmethod
    def _applied(matrices: Sequence[np.ndarray], field: np.ndarray) -> np.ndarray:
        """Apply a matrix of each direction to fields on a net, shape (n, m)."""
        net = field.reshape(*(matrix.shape[1] for matrix in matrices), -1)
        for matrix in matrices:  # the first direction comes last, so all three end up in order
            net = np.tensordot(net, matrix, axes=(0, 1))
        return np.ascontiguousarray(np.moveaxis(net, 0, -1)).reshape(-1, field.shape[1])
