"""A move on several processes: made by the first of them for all, or by all of them together.

Control points are the same on all processes, and so is the result of a mover. Up to a size the first process moves:
only it has a factor, and it sends moved points, products with derivatives, reports and errors to the others, 24 bytes
for each control point. Beyond this size all processes share the rows of the system, with MUMPS while its factor fits
into their total memory, and otherwise with conjugate gradients and a multigrid. The choice follows from the memory of
the factors, which the symbolic analysis knows, and can be overridden.

Theory: ``docs/theory/sparse_parallel.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...base.numerics.memory import available_bytes
from ...base.numerics.processes import node_of, on_first, together
from ...base.sparse.petsc import PetscCholesky, PetscMultigrid, has_petsc
from ...errors import InputError
from ..mesh.moving_mesh import MovingMesh
from .equilibrium_mover import EquilibriumMover
from .mover import Movement, MovementReport, Mover

__all__ = ["ALL_PROCESSES", "AUTO", "FIRST_PROCESS", "WAYS", "Placement", "SharedMovement", "shared_mover"]

AUTO, FIRST_PROCESS, ALL_PROCESSES = "auto", "first", "all"
WAYS = (AUTO, FIRST_PROCESS, ALL_PROCESSES)
"""Who moves: decided by memory, the first process, or all together."""

PART_OF_MEMORY = 0.5
"""Fraction of available memory that factors may take, the first process's or all machines' together."""

MUMPS_OVERHEAD = 1.5
"""Memory of MUMPS, with its work space, relative to a factor of `bspline_mdao.base.sparse.cholesky`."""


@dataclass(frozen=True)
class Placement:
    """Who moves, and why."""

    way: str  # "first" or "all"
    n_processes: int  # number of processes that need the result
    why: str  # reason

    def __str__(self) -> str:
        who = "the first of" if self.way == FIRST_PROCESS else "all"
        return f"on {who} {self.n_processes} processes ({self.why})"


def shared_mover(
    mover: Mover,  # any mover, the same on all processes
    comm: Any,  # the processes; for one process, the mover itself is returned
    way: str = AUTO,  # who moves; "all" is for movers that solve for equilibrium: elasticity and springs
) -> Mover:
    """Mover for the processes of a communicator, all of which call this, and later its moves and products."""
    if way not in WAYS:
        raise InputError(f"movement: processes '{way}'; give one of {', '.join(WAYS)}")
    if comm.size == 1:
        return mover
    settings: Any = mover
    placement, solver = on_first(comm, partial(_placed, settings, _memory(comm), comm.size, way))
    if isinstance(solver, PetscCholesky | PetscMultigrid):
        solver = replace(solver, comm=comm if placement.way == ALL_PROCESSES else None)
    if isinstance(mover, EquilibriumMover):
        mover = replace(settings, solver=solver)
    return _SharedMover(mover, comm, placement)


@dataclass(frozen=True, eq=False)
class _SharedMover:
    """A mover of several processes: each of its moves, and each product with a derivative, is collective."""

    mover: Mover  # the mover, on the first process or on all of them
    comm: Any  # the processes
    placement: Placement  # who moves

    @property
    def mesh(self) -> MovingMesh:
        """Mesh that is moved."""
        return self.mover.mesh

    def move(self, initial: np.ndarray, surface: np.ndarray, **options: Any) -> SharedMovement:
        """Move the first process's points (n_points, 3) with surface points (n_surface, 3), in metres; collective."""
        # all processes raise the mover's errors; options are passed to the mover's own ``move``
        movement: Movement | None = None
        if self.placement.way == ALL_PROCESSES:
            initial, surface = self.comm.bcast((initial, surface))
            movement = self.mover.move(initial, surface, **options)
        else:
            with together(self.comm):
                if self.comm.rank == 0:
                    movement = self.mover.move(initial, surface, **options)
        points, report = self.comm.bcast((movement.points, movement.report) if movement else None)
        if isinstance(report, MovementReport):
            report = replace(report, where=str(self.placement))
        return SharedMovement(self.comm, self.placement.way, movement, points, report)


@dataclass(frozen=True, eq=False)
class SharedMovement:
    """A movement of several processes: the same bits on all of them."""

    comm: Any  # the processes
    way: str  # who made it, "first" or "all"
    movement: Any  # the movement, if this process has it
    points: np.ndarray  # (n_points, 3), moved points (m)
    report: MovementReport  # report of the move, which says who moved

    @property
    def start(self) -> Any:
        """Data that the next move from the same points shares, on a process that has it."""
        return getattr(self.movement, "start", None)

    def jvp(self, d_initial: np.ndarray, d_surface: np.ndarray) -> np.ndarray:
        """Change of the points for changes of the initial points and of the surface points: collective."""
        return self._product("jvp", d_initial, d_surface)

    def vjp(self, bar: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Transpose of `jvp`: collective."""
        return self._product("vjp", bar)

    def _product(self, name: str, *vectors: np.ndarray) -> Any:
        """Product for the vectors of the first process, by whoever moved."""
        if self.way == FIRST_PROCESS:
            return on_first(self.comm, lambda: getattr(self.movement, name)(*vectors))
        return self.comm.bcast(getattr(self.movement, name)(*self.comm.bcast(vectors)))


def _placed(mover: Any, memory: int, n_processes: int, way: str) -> tuple[Placement, Any]:
    """Who moves, and with which solver, or None without a system; the first process decides."""
    first, everyone = (partial(Placement, way, n_processes) for way in (FIRST_PROCESS, ALL_PROCESSES))
    if not isinstance(mover, EquilibriumMover):
        if way == ALL_PROCESSES:
            raise InputError(
                f"movement: {type(mover).__name__} shares no system with other processes; give processes='first'"
            )
        return first(f"{type(mover).__name__} shares no system"), None
    solver: Any = mover.solver
    if way == FIRST_PROCESS:
        return first("as asked"), solver
    if isinstance(solver, PetscCholesky | PetscMultigrid):
        return everyone("the solver shares its rows"), solver
    predicted, limit = mover.predicted_bytes(), PART_OF_MEMORY * available_bytes()
    if way == AUTO and predicted is None:
        return first(f"{solver.name} has no parallel form"), solver
    needed = predicted or 0
    if way == AUTO and needed <= limit:
        return first(f"factors of {_gb(needed)}, up to {_gb(limit)}"), solver
    why = "as asked" if way == ALL_PROCESSES else f"factors of {_gb(needed)}, more than {_gb(limit)}"
    if not has_petsc():
        raise InputError(
            f"movement: all processes are to share the system ({why}), and petsc4py is not installed; install it "
            "(pip install \"bspline_mdao[mpi]\"), or give processes='first'"
        )
    fits = MUMPS_OVERHEAD * needed <= PART_OF_MEMORY * memory
    return everyone(why), PetscCholesky() if fits else PetscMultigrid()


def _memory(comm: Any) -> int:
    """Memory available on the machines of all processes together (bytes)."""
    node = node_of(comm)
    total = comm.allreduce(available_bytes() if node.rank == 0 else 0)
    node.Free()
    return total


def _gb(n_bytes: float) -> str:
    return f"{n_bytes / 1e9:.3g} GB"
