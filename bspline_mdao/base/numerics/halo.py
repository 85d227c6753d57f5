"""Halo: array rows of other processes, which a process sees after its own.

The rows are fixed once. Sums accumulated at them return the same way, in the order of the processes, so the transpose
is exact and always the same to the last bit.

Theory: ``docs/theory/euler.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .processes import ONE

__all__ = ["ALONE", "Halo"]


@dataclass(frozen=True, eq=False)
class Halo:
    """Exchange of rows with other processes. Made by `of`; `ALONE` for one process, which sends nothing."""

    comm: Any  # the processes
    # rows of this process, and visible rows of others
    n_owned: int = 0
    n_ghosts: int = 0
    sent: tuple[tuple[int, np.ndarray], ...] = ()  # processes that see rows of this one, and which
    # processes whose rows this one sees, and where these are behind its own
    received: tuple[tuple[int, slice], ...] = ()

    @classmethod
    def of(
        cls,
        comm: Any,  # communicator, the processes
        n_owned: int,  # rows of this process
        # process with each requested row, and its number there; own rows and repetitions are allowed
        ranks: np.ndarray,  # int (n,)
        rows: np.ndarray,  # int (n,)
    ) -> tuple[Halo, np.ndarray]:  # places int (n,): positions of the requested rows in extended arrays
        """Determine the visible rows: a collective call."""
        if comm.size == 1:
            return cls(comm, n_owned), rows
        foreign = np.flatnonzero(ranks != comm.rank)
        keys = np.stack([ranks[foreign], rows[foreign]])
        (at, numbers), ghosts = np.unique(keys, axis=1, return_inverse=True)
        ends = np.searchsorted(at, np.arange(comm.size + 1))
        asked = comm.alltoall([numbers[first:end] for first, end in zip(ends[:-1], ends[1:])])
        places = np.array(rows)
        places[foreign] = n_owned + ghosts.ravel()
        received = tuple(
            (rank, slice(int(n_owned + first), int(n_owned + end)))
            for rank, (first, end) in enumerate(zip(ends[:-1], ends[1:]))
            if end > first
        )
        sent = tuple((rank, numbers) for rank, numbers in enumerate(asked) if len(numbers))
        return cls(comm, n_owned, len(at), sent, received), places

    def owners(self) -> np.ndarray:
        """Owning process of each row of extended arrays."""
        out = np.full(self.n_owned + self.n_ghosts, self.comm.rank)
        for rank, part in self.received:
            out[part] = rank
        return out

    def extend(self, owned: np.ndarray) -> np.ndarray:
        """Append the rows of others to this process's rows: shape (n_owned + n_ghosts, ...)."""
        # One process gets its array back.
        if self.comm.size == 1:
            return owned
        seen = np.empty((self.n_owned + self.n_ghosts, *owned.shape[1:]), owned.dtype)
        seen[: self.n_owned] = owned
        arriving = [self.comm.Irecv(seen[part], source=rank) for rank, part in self.received]
        buffers = [(rank, owned[rows]) for rank, rows in self.sent]
        leaving = [self.comm.Isend(buffer, dest=rank) for rank, buffer in buffers]
        for request in arriving + leaving:
            request.Wait()
        return seen

    def fold(self, seen: np.ndarray) -> np.ndarray:
        """Transposed product of `extend`: add values at the rows of others to these rows, on their processes."""
        if self.comm.size == 1:
            return seen
        owned = seen[: self.n_owned].copy()
        buffers = [np.empty((len(rows), *seen.shape[1:]), seen.dtype) for _, rows in self.sent]
        arriving = [self.comm.Irecv(buffer, source=rank) for (rank, _), buffer in zip(self.sent, buffers)]
        parts = [(rank, np.ascontiguousarray(seen[part])) for rank, part in self.received]
        leaving = [self.comm.Isend(part, dest=rank) for rank, part in parts]
        for request in arriving + leaving:
            request.Wait()
        for (_, rows), buffer in zip(self.sent, buffers):
            owned[rows] += buffer
        return owned

    def cut(self, seen: np.ndarray) -> np.ndarray:
        """Drop the rows of others."""
        return seen if self.comm.size == 1 else seen[: self.n_owned]

    def pad(self, owned: np.ndarray) -> np.ndarray:
        """Transposed product of `cut`: zeros at the rows of others."""
        if self.comm.size == 1:
            return owned
        return np.concatenate([owned, np.zeros((self.n_ghosts, *owned.shape[1:]), owned.dtype)])


ALONE = Halo(ONE)
"""Halo of a single process."""
