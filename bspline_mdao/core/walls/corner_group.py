"""Corners of spans that see each other, the rotations of their surroundings, and how these are smoothed.

Corners on walls are one group, those on other boundary faces, in planes that slide, and inside are others; see
`.rotation_map`. A group takes the rotations of groups before it as given where `.rotation_filter` joins their corners.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array, eye_array

from .rotation_filter import RotationFilter
from .rotations import LocalRotations, Rotations

__all__ = ["CornerGroup"]


@dataclass(frozen=True, eq=False)
class CornerGroup:
    """Corners that see each other: their numbers, and which of them take their rotation from here, smoothed or not."""

    ids: np.ndarray
    belongs: np.ndarray
    rotations: LocalRotations
    in_sight: csr_array
    filter: RotationFilter | None

    @classmethod
    def of(
        cls, points: np.ndarray, lengths: np.ndarray, ids, belongs, is_apart: bool, edges=None, quads=None
    ) -> CornerGroup:
        """Gather a group; one that is apart is not smoothed towards the corners of others."""
        place = np.full(len(points), -1)
        place[ids] = np.arange(len(ids))
        edges, quads = (None if numbers is None else place[numbers] for numbers in (edges, quads))
        rotations = LocalRotations.of(points[ids], edges=edges, quads=quads, fixed=np.flatnonzero(~belongs))
        pairs = [eye_array(len(ids), format="coo").coords]
        pairs += [] if edges is None else [edges.T]
        pairs += [] if quads is None else [quads[:, [m, n]].T for m in range(4) for n in range(m)]
        first, second = np.concatenate(pairs, axis=1)
        in_sight = coo_array((np.ones(len(first)), (first, second)), shape=(len(ids), len(ids))).tocsr()
        in_sight = csr_array(in_sight + in_sight.T)
        scales = rotations.scales * belongs[rotations.neighbours] if is_apart else rotations.scales
        smoothing = RotationFilter.of(rotations.starts, rotations.neighbours, scales, lengths[ids], belongs)
        in_sight = in_sight if rotations.mix is None else csr_array(in_sight @ in_sight)
        return cls(ids, belongs, rotations, in_sight, smoothing)

    def at(self, initial: np.ndarray, moved: np.ndarray, matrices: np.ndarray) -> Rotations:
        """Write the rotations of a move; exactly the identity where nothing in sight has moved."""
        rotations = self.rotations.at(initial[self.ids], moved[self.ids])
        is_still = self.in_sight @ (initial != moved).any(axis=1)[self.ids].astype(float) == 0.0
        belongs = np.where(is_still[:, None, None], np.eye(3), rotations.matrices)[self.belongs]
        matrices[self.ids[self.belongs]] = belongs.reshape(-1, 9)
        self._smooth(matrices, np.eye(3).ravel())
        return rotations

    def jvp(
        self, rotations: Rotations, d_initial: np.ndarray | None, d_moved: np.ndarray, d_matrices: np.ndarray
    ) -> None:
        """Write the change of the rotations, with changes of all corners at first, or None, and now."""
        ids = self.ids
        change = rotations.jvp(None if d_initial is None else d_initial[ids], d_moved[ids])
        d_matrices[ids[self.belongs]] = change[self.belongs].reshape(-1, 9)
        self._smooth(d_matrices, np.zeros(9))

    def _smooth(self, matrices: np.ndarray, rest: np.ndarray) -> None:
        """Smooth rotations, or changes of them, in place; those at rest stay exactly."""
        if self.filter is not None:
            free, given = self.ids[self.filter.free], self.ids[self.filter.given]
            matrices[free] = rest + self.filter.forward(matrices[free] - rest, matrices[given] - rest)

    def pull(
        self,
        # (n_corners, 9), groups come in reverse order; what smoothing hands on to corners of groups before this is
        # added
        bar: np.ndarray,
    ) -> np.ndarray:
        """Derivatives with respect to the rotations of the group before smoothing, from those with respect to all."""
        if self.filter is not None:
            free, given = self.ids[self.filter.free], self.ids[self.filter.given]
            bar[free], given_bar = self.filter.transpose(bar[free])
            bar[given] += given_bar
        return np.where(self.belongs[:, None], bar[self.ids], 0.0).reshape(-1, 3, 3)

    def add_dependencies(self, needed: np.ndarray) -> np.ndarray:
        """Add to a mask of corners those that smoothing joins with them; return the corners that all these see."""
        wanted = self.belongs & needed[self.ids]
        if self.filter is not None and wanted.any():
            free, given = self.filter.joined(wanted)
            wanted[free] = True
            needed[self.ids[given]] = True
        return self.ids[self.in_sight[np.flatnonzero(wanted)].indices]
