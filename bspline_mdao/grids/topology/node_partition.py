"""The nodes of an unstructured mesh on each of several processes: equal shares, in the order of its file.

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
    """Nodes distributed in consecutive ranges."""

    n_nodes: int
    n_ranks: int

    def subdomain(self, rank: int) -> Subdomain:
        """Return the nodes of a process."""
        first, last = (self.n_nodes * k // self.n_ranks for k in (rank, rank + 1))
        return Subdomain.of_rows(np.arange(first, last), self.n_nodes)
