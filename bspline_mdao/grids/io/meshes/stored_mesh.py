"""Meshes whose nodes have places in the bytes of one file: new nodes take these places, and all else stays.

Format: ``docs/theory/ride.rst``.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from ....base.display import OneLine
from ...cells.mixed_cells import MixedMesh
from ..disk import replaced_file

__all__ = ["StoredMesh", "StoredPoints"]


class StoredPoints(Protocol):
    """Nodes in the bytes of a file."""

    @property
    def values(self) -> np.ndarray:
        """The nodes, shape (n, 3)."""

    def replaced(self, values: np.ndarray) -> bytes:
        """Return the bytes with new nodes."""


@dataclass(frozen=True, eq=False)
class StoredMesh(OneLine):
    """A mesh and its file."""

    mesh: MixedMesh  # the mesh
    stored: StoredPoints  # the file, with the places of the nodes

    def write(self, path: str | os.PathLike, points: np.ndarray) -> None:
        """Write the file with new nodes, shape (n, 3); all else stays, to the last byte."""
        points = self.mesh.as_nodes(points)
        with replaced_file(path) as temporary:
            Path(temporary).write_bytes(self.stored.replaced(points))
