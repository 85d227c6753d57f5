"""Nodes of Gmsh's files, format 2.2 and 4.1, in ASCII and binary: found, and replaced in place.

Format: the reference manual of Gmsh, section "Gmsh file formats".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .gmsh_sections import BinaryNumbers, GmshFile, TextNumbers
from .stored_mesh import StoredPoints
from .text_numbers import TextPoints

__all__ = ["find_gmsh_nodes"]


@dataclass(frozen=True, eq=False)
class _BinaryNodes:
    """Nodes in binary."""

    data: bytes  # the whole file
    # first byte of the nodes of each part, their number, and the bytes from one to the next
    parts: tuple[tuple[int, int, int], ...]

    @property
    def values(self) -> np.ndarray:
        """The nodes, shape (n, 3)."""
        return np.concatenate([np.zeros((0, 3)), *(self._view(self.data, *part) for part in self.parts)])

    def replaced(self, values: np.ndarray) -> bytes:
        """Return the file with new nodes, shape (n, 3)."""
        new, first = bytearray(self.data), 0
        for start, n, step in self.parts:
            self._view(new, start, n, step)[:] = values[first : first + n]
            first += n
        return bytes(new)

    @staticmethod
    def _view(data: bytes | bytearray, start: int, n: int, step: int) -> np.ndarray:
        return np.ndarray((n, 3), dtype="<f8", buffer=data, offset=start, strides=(step, 8))


def find_gmsh_nodes(file: GmshFile) -> tuple[StoredPoints, np.ndarray]:
    """Find the nodes of a file."""
    # Returns stored: the nodes in the bytes of the file; tags: (n,) of int, their numbers, each once.
    if file.is_old:
        stored, tags = _old_binary(file) if file.is_binary else _old_text(file)
    else:
        stored, tags = _by_entity(file)
    if len(np.unique(tags)) != len(tags):
        raise ValueError("two nodes have one number")
    return stored, tags


def _old_binary(file: GmshFile) -> tuple[StoredPoints, np.ndarray]:
    """Nodes of version 2.2: a number and three reals each."""
    n, start = file.counted("Nodes")
    numbers = BinaryNumbers(file, start, file.sections["Nodes"][1])
    numbers.skip(n, 28)
    numbers.require_end()
    tags = np.ndarray((n,), dtype="<i4", buffer=file.data, offset=start, strides=(28,))
    return _BinaryNodes(file.data, ((start + 4, n, 28),)), tags.astype(np.int64)


def _old_text(file: GmshFile) -> tuple[StoredPoints, np.ndarray]:
    """Nodes of version 2.2: a number and three reals in each line."""
    n, start = file.counted("Nodes")
    span = start, file.sections["Nodes"][1]
    points = TextPoints.of(file.data, span, 3, file.source, before=1)
    tags = TextPoints.of(file.data, span, 1, file.source, behind=3).values[:, 0]
    if len(tags) != n or (tags != np.round(tags)).any() or np.abs(tags).max(initial=0) >= 2**53:
        raise ValueError(f"it announces {n} and holds {len(tags)}, or not all have a number")
    return points, tags.astype(np.int64)


def _by_entity(file: GmshFile) -> tuple[StoredPoints, np.ndarray]:
    """Nodes of version 4.1, entity after entity: numbers, then reals, followed by parameters."""
    numbers = file.numbers("Nodes")
    n_entities, n_nodes, _, _ = numbers.take("size", 4).tolist()
    tags, parts, spans = [np.zeros(0, dtype=np.int64)], [], [np.zeros((0, 3, 2), dtype=np.int64)]
    for _ in range(n_entities):
        dimension, _, is_parametric = numbers.take("int", 3).tolist()
        n = int(numbers.take("size", 1)[0])
        if not (0 <= dimension <= 3 and 0 <= is_parametric <= 1):
            raise ValueError(f"an entity of dimension {dimension}")
        n_reals = 3 + dimension * is_parametric
        tags.append(numbers.take("size", n))
        if isinstance(numbers, TextNumbers):
            spans.append(numbers.places(n * n_reals).reshape(n, n_reals, 2)[:, :3])
        else:
            parts.append((numbers.skip(n, 8 * n_reals), n, 8 * n_reals))
    numbers.require_end()
    joined = np.concatenate(tags)
    if len(joined) != n_nodes:
        raise ValueError(f"it announces {n_nodes} and holds {len(joined)}")
    if file.is_binary:
        return _BinaryNodes(file.data, tuple(parts)), joined
    return TextPoints.at(file.data, np.concatenate(spans), file.source), joined
