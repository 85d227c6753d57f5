"""Which nodes of a mesh without structure each of several processes holds: as many, in the order of its file.

Theory: ``docs/parallel.rst``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.display import OneLine
from .partition import Subdomain

__all__ = ["NodePartition"]


@dataclass(frozen=True)
class NodePartition(OneLine):
    """Nodes dealt out one after another."""

    n_nodes: int
    n_ranks: int

    def subdomain(self, rank: int) -> Subdomain:
        """Return what a process holds."""
        first, last = (self.n_nodes * k // self.n_ranks for k in (rank, rank + 1))
        return Subdomain.of_rows(np.arange(first, last), self.n_nodes)
