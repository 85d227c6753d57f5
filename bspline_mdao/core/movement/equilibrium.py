"""One increment of Eq. (8), K(b^(i-1)) (b^(i) - b^(i-1)) = f, for any elements with a linear force.

Theory: ``docs/theory/elasticity.rst``.

Let u be the displacement of an increment, prescribed on the surface and unknown at the free points, and F(u) = K u the
force of the elements. The free components of F(u) vanish: the right-hand side f is minus the force of the prescribed
displacement. Differentiated,

    K du_free = - (change of F with the points, at fixed u) - K du_prescribed,

and the transpose takes one solution with the same factor and the transposed derivative of F.

Elements that are a million times as long as they are high, as in boundary layers and wakes, make K so stiff against a
change of their height, and so soft against rotations, that rounding of K and of u leaves few digits or none. If the
factor shows this, solutions are refined: u is a sum of two parts, the second of which holds the rounding error of the
first [Wilkinson, Rounding Errors in Algebraic Processes (1963)], and F(u) comes from the elements, whose strains are
differences of neighbours, and not from a matrix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ...base.numerics.processes import ONE, together
from ...base.sparse.blocks import BlockMatrix, BlockPattern, slots
from ...base.sparse.distributed import DistributedPattern
from ...base.sparse.solved_together import Task
from ...grids.topology.periodic_ties import Ties
from ..mesh.moving_mesh import MovingMesh
from .row_sharing import RowSharing

__all__ = ["Balance", "Balanced", "Equilibrium", "Unknowns", "in_two"]

EPSILON = float(np.finfo(float).eps)

REFINE_ABOVE = 1e-11
"""Relative error, estimated by the factor, above which a move is refined: far below a visible effect on a mesh."""

REFINE_PRODUCTS_ABOVE = 1e-13
"""The same for products with derivatives, which must agree with each other better than they need to be exact."""

TOLERANCE = 1e-14
"""Relative error to refine to: a digit above the unit round-off, which the sums over elements lose."""

MAX_CORRECTIONS = 30
"""Most corrections; three or four are needed if they converge."""

LEAST_GAIN = 0.5
"""A correction that is not smaller than the last one by this factor is rounding, and ends the refinement."""


ALL = slice(None)
"""Ids of all elements, for an array without a copy of it."""


class Balanced(Protocol):
    """Elements to balance: their force is linear in the displacement, up to a constant, with a symmetric stiffness."""

    def add_stiffness(
        self, element_rows: np.ndarray, slots: np.ndarray, data: np.ndarray, element_ids: np.ndarray | slice = ALL
    ) -> None:
        """Add the stiffness of all elements, or of some, to blocks."""
        # See `bspline_mdao.core.movement.elasticity.add_stiffness`; rows and slots belong to these elements.

    def force(self, displacement: np.ndarray) -> np.ndarray:
        """Force on all points of a displacement, both sums of equally many parts, shape (n_parts, n_points, 3)."""


class Numbered(Protocol):
    """Numbering of the unknowns of the points, and their matrix: `Unknowns`, or a field's own."""

    @property
    def comm(self) -> Any:
        """Processes that share the rows of the matrix."""

    def matrix(self, add_stiffness: Callable[..., None]) -> Any:
        """Matrix of the stiffness that a function adds to blocks."""

    def gather(self, force: np.ndarray) -> np.ndarray:
        """Unknowns' components of a force, shape (n_points, 3)."""

    def scatter(self, unknowns: np.ndarray) -> np.ndarray:
        """Transpose of `gather`."""


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """The systems of a mesh, and their solution."""

    mesh: MovingMesh  # what is moved
    unknowns: Numbered  # numbering of the unknowns
    analysis: Any  # the solver's analysis of their pattern

    @classmethod
    def of(cls, mesh: MovingMesh, solver: Any) -> Equilibrium:
        """Number the unknowns of a mesh, and let a solver choose its elimination order."""
        # If the solver has a communicator, each of its processes assembles the rows that it owns, and all call this.
        comm = getattr(solver, "comm", None) or ONE
        unknowns = Unknowns(mesh, comm)
        with together(comm):
            pattern = unknowns.pattern
        return cls(mesh, unknowns, solver.analyze(pattern, mesh.points[unknowns.row_ids[unknowns.rows]]))

    def balance_task(
        self,
        elements: Balanced,  # elements with the force F
        factor: Any,  # factor of their stiffness
        prescribed: np.ndarray,  # (n_points, 3), displacement of the surface (m), 0 elsewhere
        load: np.ndarray,  # (n_parts, n_points, 3), load on the points, as a sum of parts
        above: float,  # estimate of the relative error above which the displacement is refined
    ) -> Task[Balance]:
        """Find the displacement u that is prescribed on the surface and has ``F(u) = load`` at the free points."""
        # Iterative refinement [Wilkinson 1963; Higham, Accuracy and Stability of Numerical Algorithms (2002), 12]:
        #
        # 1. solve K u = load - F(prescribed) with the factor;
        # 2. if its estimate of the error is too large, form the residual load - F(u) from both parts of u;
        # 3. solve K c = residual for a correction c;
        # 4. stop if corrections no longer shrink: the rest is rounding;
        # 5. add c to both parts of u, and stop if the next correction is expected to be below `TOLERANCE`.
        gather, scatter = self.unknowns.gather, self.unknowns.scatter
        solution = yield factor, gather(_less(load, elements.force(prescribed[None])))  # step 1
        parts, error = (prescribed + scatter(solution.x))[None], EPSILON * factor.cancellation
        size, last, n_steps = np.abs(solution.x).max(initial=0.0), 1.0, solution.iterations
        if size == 0.0 or not np.isfinite(size):
            return Balance(parts, n_steps, solution.residual, 0.0)
        if error <= above:
            return Balance(parts, n_steps, solution.residual, error)
        parts = in_two(parts)
        for _ in range(MAX_CORRECTIONS):
            residual = _less(load, elements.force(parts))  # step 2
            correction_of = yield factor, gather(residual)  # step 3
            correction = scatter(correction_of.x)
            change = np.abs(correction).max() / size
            if not change < LEAST_GAIN * last:  # step 4; also if it is not a number
                error = change
                break
            # step 5; corrections shrink by change / last, so the next one is about error
            parts, n_steps = _corrected(parts, correction), n_steps + max(correction_of.iterations, 1)
            error, last = change * change / last, change
            if error <= TOLERANCE:
                break
        return Balance(parts, n_steps, solution.residual, error)

    def factorized(self, elements: Balanced) -> Any:
        """Assemble and factorise the stiffness of elements."""
        with together(self.unknowns.comm):
            matrix = self.unknowns.matrix(elements.add_stiffness)
        return self.analysis.factorize(matrix)


@dataclass(frozen=True, eq=False)
class Balance:
    """A displacement that balances a load on the free points."""

    # (n_parts, n_points, 3), the displacement (m) as a sum of parts: one, or two if it was refined
    parts: np.ndarray
    n_steps: int  # iterations of the solver, or corrections
    residual: float  # relative residual of the first system
    error: float  # estimate of its error relative to the largest displacement


@dataclass(frozen=True, eq=False)
class _Assembly:
    """Rows that the elements of a process add to, before points share rows, and how points share them."""

    pattern: BlockPattern
    element_ids: np.ndarray | slice  # elements to assemble
    element_rows: np.ndarray  # int32 (n_elements, 8), row in the pattern of each of their corners, -1 for none
    points: np.ndarray  # int (pattern.n,), place of every row among the points that may move
    sharing: RowSharing | None  # None if no points share a row


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Numbering of the points that may move, and the matrix of the points that this process owns."""

    # Points of periodic sides share a row. Their elements are assembled in rows of their own, each turned into a frame
    # that turns with the side. The blocks of all points that share a row are added: P^T K P, with u = P x.

    mesh: MovingMesh  # what is moved
    # processes that share the rows of the matrix, by default only this one; all else is the same on all of them
    comm: Any = ONE

    @cached_property
    def point_ids(self) -> np.ndarray:
        """Points that may move, ascending: one for each block row before any are shared."""
        return np.flatnonzero(self.mesh.is_free.any(axis=1)).astype(np.int32)

    @cached_property
    def ties(self) -> Ties | None:
        """The ties of these points, by their places among them; None if none are tied."""
        if self.mesh.ties is None:
            return None
        return self.mesh.ties.numbered(self._places) or None

    @property
    def row_ids(self) -> np.ndarray:
        """Point of each block row of the matrix, ascending; the original if points share it."""
        return self.point_ids if self.ties is None else np.delete(self.point_ids, self.ties.copies)

    @cached_property
    def _places(self) -> np.ndarray:
        """Place of every point among the points that may move; -1 if it may not."""
        rows = np.full(self.mesh.n_points, -1, dtype=np.int32)
        rows[self.point_ids] = np.arange(len(self.point_ids), dtype=np.int32)
        return rows

    @cached_property
    def _shared_rows(self) -> np.ndarray:
        """Row of every point that may move; its original's row if points share it."""
        if self.ties is None:
            return np.arange(len(self.point_ids), dtype=np.int32)
        rows = np.empty(len(self.point_ids), dtype=np.int32)
        is_original = np.ones(len(rows), dtype=bool)
        is_original[self.ties.copies] = False
        rows[is_original] = np.arange(np.count_nonzero(is_original))
        rows[self.ties.copies] = rows[self.ties.originals]
        return rows

    @cached_property
    def _assembly(self) -> _Assembly:
        element_points, rows = self._places[self.mesh.elements], self._shared_rows
        n_points, n = len(self.point_ids), int(rows.max(initial=-1)) + 1
        element_rows = np.where(element_points >= 0, rows[element_points], -1) if len(rows) else element_points
        if self.comm.size == 1:
            pattern, here = BlockPattern.of_elements(element_points, n_points), np.arange(n_points)
            if self.ties is None:
                return _Assembly(pattern, ALL, element_points, here, None)
            shared = BlockPattern.of_elements(element_rows, n)
            return _Assembly(pattern, ALL, element_points, here, RowSharing.of(pattern, shared, rows))
        shared, element_ids, element_rows = DistributedPattern.of_local_elements(element_rows, n, self.comm)
        if self.ties is None:
            return _Assembly(shared, element_ids, element_rows, shared.rows, None)
        # elements at an owned row are the elements at all points that share it
        element_points = element_points[element_ids]
        here, places = np.unique(element_points[element_points >= 0]), np.full(n_points + 1, -1, dtype=np.int32)
        places[here] = np.arange(len(here))
        row_here = np.full(n, -1, dtype=np.int32)
        row_here[shared.rows] = np.arange(shared.n)
        pattern = BlockPattern.of_elements(places[element_points], len(here))
        sharing = RowSharing.of(pattern, shared, row_here[rows[here]])
        return _Assembly(pattern, element_ids, places[element_points], here, sharing)

    @property
    def pattern(self) -> BlockPattern:
        """Pattern of the stiffness; a `DistributedPattern` if there are several processes."""
        of = self._assembly
        return of.pattern if of.sharing is None else of.sharing.pattern

    @property
    def element_rows(self) -> np.ndarray:
        """Block row of every corner of the elements before any are shared, -1 for none, (n_elements, 8)."""
        return self._assembly.element_rows

    @property
    def rows(self) -> np.ndarray | slice:
        """Rows of the whole matrix that the pattern has."""
        return self.pattern.rows if isinstance(self.pattern, DistributedPattern) else ALL

    @cached_property
    def slots(self) -> np.ndarray:
        """Place of every pair of corners before any rows are shared, see `bspline_mdao.base.sparse.blocks.slots`."""
        return slots(self._assembly.pattern, self.element_rows)

    def assembled(self, add_stiffness: Callable[..., None]) -> BlockMatrix:
        """Stiffness of the points before any share a row, in Cartesian axes."""
        of = self._assembly
        data = np.zeros((of.pattern.n_blocks, 3, 3))
        add_stiffness(of.element_rows, self.slots, data, of.element_ids)
        return BlockMatrix(of.pattern, data)

    def matrix(
        self,
        # ``add_stiffness(element_rows, slots, data, element_ids)`` adds the stiffness of elements to the blocks, shape
        # (n_blocks, 3, 3)
        add_stiffness: Callable[..., None],
    ) -> BlockMatrix:
        """Stiffness of the unknowns."""
        whole = self.assembled(add_stiffness)
        self._restrain(whole.data)
        sharing = self._assembly.sharing
        return whole if sharing is None else BlockMatrix(self.pattern, sharing.added(whole.data))

    def gather(self, force: np.ndarray) -> np.ndarray:
        """Components of a force, shape (n_points, 3), along the free directions: shape (n_rows, 3)."""
        in_frames = self._turned(force[self.point_ids]) * self._is_free
        if self.ties is None:
            return in_frames
        total = np.zeros((len(self.row_ids), 3), dtype=in_frames.dtype)
        np.add.at(total, self._shared_rows, in_frames)
        return total

    def scatter(self, unknowns: np.ndarray) -> np.ndarray:
        """Transpose of `gather`."""
        displacement = np.zeros((self.mesh.n_points, 3), dtype=unknowns.dtype)
        in_frames = unknowns[self._shared_rows] * self._is_free
        if self._frames is not None:
            in_frames = np.einsum("nij,ni->nj", self._frames, in_frames)
        displacement[self.point_ids] = in_frames
        return displacement

    @cached_property
    def _is_free(self) -> np.ndarray:
        is_free = self.mesh.is_free[self.point_ids]
        if self.ties is not None:
            is_free[self.ties.copies] = is_free[self.ties.originals]
        return is_free

    @cached_property
    def _frames(self) -> np.ndarray | None:
        ties, frames = self.ties, self.mesh.frames
        if ties is None or (frames is None and (ties.turns == np.eye(3)).all()):
            return None if frames is None else frames[self.point_ids]
        of_points = np.tile(np.eye(3), (len(self.point_ids), 1, 1)) if frames is None else frames[self.point_ids]
        of_points[ties.copies] = of_points[ties.originals] @ ties.turns.transpose(0, 2, 1)
        return of_points

    def _turned(self, vectors: np.ndarray) -> np.ndarray:
        return vectors if self._frames is None else np.einsum("nij,nj->ni", self._frames, vectors)

    @cached_property
    def _restrained(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Entries, with rows and columns, of points with their own frame or a fixed direction."""
        pattern, points = self._assembly.pattern, self._assembly.points
        is_special: Any = ~self._is_free[points].all(axis=1)
        if self._frames is not None:
            is_special |= (self._frames[points] != np.eye(3)).any(axis=(1, 2))
        rows = np.repeat(np.arange(pattern.n, dtype=np.int32), np.diff(pattern.indptr))
        entries = np.flatnonzero(is_special[rows] | is_special[pattern.indices])
        return entries, rows[entries], pattern.indices[entries]

    def _restrain(self, data: np.ndarray) -> None:
        """Transform blocks to the frames of their points, with the identity in fixed directions."""
        entries, rows, columns = self._restrained
        blocks, points = data[entries], self._assembly.points
        is_free = self._is_free[points]
        if self._frames is not None:
            frames = self._frames[points]
            blocks = frames[rows] @ blocks @ frames[columns].transpose(0, 2, 1)
        blocks *= is_free[rows][:, :, None] & is_free[columns][:, None, :]
        is_diagonal = rows == columns
        blocks[is_diagonal] += ~is_free[rows[is_diagonal]][:, :, None] * np.eye(3)
        data[entries] = blocks


def in_two(parts: np.ndarray) -> np.ndarray:
    """The same sum of parts, as a sum of two."""
    return parts if len(parts) == 2 else np.stack([parts[0], np.zeros_like(parts[0])])


def _corrected(parts: np.ndarray, correction: np.ndarray) -> np.ndarray:
    """Add a correction to a sum of two parts: two again, the second below the last digit of the first."""
    first, lost = _sum(parts[0], correction)
    return np.stack(_sum(first, lost + parts[1]))


def _less(load: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Difference of two sums of parts, rounded once, shape (n_points, 3)."""
    first, lost = _sum(load[0], -force[0])
    return first + (lost + (load[1:].sum(axis=0) - force[1:].sum(axis=0)))


def _sum(a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum, and its exact rounding error [Knuth, The Art of Computer Programming 2, 4.2.2]."""
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)
