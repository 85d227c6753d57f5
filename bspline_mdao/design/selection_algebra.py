"""Selections of surface control points, and what is made of them by ``&``, ``|`` and ``~``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..mesh.mesh import MovingMesh

__all__ = ["Selection"]


class Selection(ABC):
    """Some of the surface control points of a mesh."""

    @abstractmethod
    def mask(self, mesh: MovingMesh) -> np.ndarray:
        """Whether each surface control point is selected, shape (n_surface,), on the baseline."""

    @abstractmethod
    def __str__(self) -> str:
        """What is asked for, for messages."""

    def rows(self, mesh: MovingMesh) -> np.ndarray:
        """Rows of the selected points in ``mesh.surface_ids``, ascending.

        Raises
        ------
        InputError
            If there are none, or what is asked for does not exist.
        """
        rows = np.flatnonzero(self.mask(mesh))
        if not len(rows):
            raise InputError(f"selection: none of the {len(mesh.surface_ids)} surface control points is {self}")
        return rows

    def __and__(self, other: Selection) -> Selection:
        return _Both(self, other) if isinstance(other, Selection) else NotImplemented

    def __or__(self, other: Selection) -> Selection:
        return _Either(self, other) if isinstance(other, Selection) else NotImplemented

    def __invert__(self) -> Selection:
        return _Not(self)


@dataclass(frozen=True, eq=False)
class _Both(Selection):
    a: Selection
    b: Selection

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        return self.a.mask(mesh) & self.b.mask(mesh)

    def __str__(self) -> str:
        return f"({self.a} and {self.b})"


@dataclass(frozen=True, eq=False)
class _Either(Selection):
    a: Selection
    b: Selection

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        return self.a.mask(mesh) | self.b.mask(mesh)

    def __str__(self) -> str:
        return f"({self.a} or {self.b})"


@dataclass(frozen=True, eq=False)
class _Not(Selection):
    a: Selection

    def mask(self, mesh: MovingMesh) -> np.ndarray:
        return ~self.a.mask(mesh)

    def __str__(self) -> str:
        return f"not {self.a}"
