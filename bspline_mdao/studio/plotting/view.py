"""Pictures of a state, whatever its cells: of blocks in `.block_view`, of other meshes in `.mesh_view`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import singledispatch
from typing import Any

import numpy as np

from ...errors import InputError
from ...flow.om.snapshots import Snapshot
from .field_styles import FieldStyle
from .surfaces import AnySheet

__all__ = ["View", "view_of"]


class View(ABC):
    """Surfaces of a state, fields on them, and cells that are marked."""

    styles: Mapping[str, FieldStyle]  # available fields, by the names that users type
    defaults: tuple[str, ...]  # surfaces to show if neither surfaces nor a field are named

    def __init__(self, state: Snapshot):
        self.state = state

    @property
    def title(self) -> str:
        """Its name in pictures."""
        return self.state.title

    @property
    @abstractmethod
    def kinds(self) -> Mapping[str, str]:
        """Kinds of its patches by their names."""

    @property
    @abstractmethod
    def is_planar(self) -> bool:
        """Whether it is a plane, which is seen like a plane of symmetry."""

    @property
    def across(self) -> int | None:
        """Axis normal to the plane of a two-dimensional mesh."""
        return None

    @abstractmethod
    def knows(self, name: str) -> bool:
        """Whether this is the name of a surface that is neither a patch nor in `SURFACES`."""

    @abstractmethod
    def sheets(self, surfaces: Sequence[str], look: FieldStyle | None) -> list[AnySheet]:
        """All available surfaces, with the field; ``surfaces`` are the requested ones."""

    @abstractmethod
    def marks(self, look: FieldStyle | None, most: int) -> np.ndarray:
        """Places to mark in pictures of a field (m), shape (n, 3)."""


@singledispatch
def view_of(grid: Any, state: Snapshot) -> View:
    """Take the view of a state with a grid."""
    raise InputError(f"{state.title}: nothing is known of a {type(grid).__name__}; give a Grid or a MixedMesh")
