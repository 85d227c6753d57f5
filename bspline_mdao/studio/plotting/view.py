"""What pictures show of a state, whatever its cells: of blocks in `.block_view`, of other meshes in `.mesh_view`."""

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

    styles: Mapping[str, FieldStyle]  # fields that there may be, by the names that users give
    defaults: tuple[str, ...]  # surfaces that are shown where none is named and no field is

    def __init__(self, state: Snapshot):
        self.state = state

    @property
    def title(self) -> str:
        """What pictures call it."""
        return self.state.title

    @property
    @abstractmethod
    def kinds(self) -> Mapping[str, str]:
        """Kinds of its patches by their names."""

    @property
    @abstractmethod
    def is_planar(self) -> bool:
        """Whether it is a plane, which is seen as a plane of symmetry is."""

    @property
    def across(self) -> int | None:
        """Axis across the plane of a mesh of two dimensions."""
        return None

    @abstractmethod
    def knows(self, name: str) -> bool:
        """Whether a surface may be named so that is neither a patch nor one of `SURFACES`."""

    @abstractmethod
    def sheets(self, surfaces: Sequence[str], look: FieldStyle | None) -> list[AnySheet]:
        """All surfaces that there are, with the field; ``surfaces`` are wanted."""

    @abstractmethod
    def marks(self, look: FieldStyle | None, most: int) -> np.ndarray:
        """Places that are marked where a field colours (m), shape (n, 3)."""


@singledispatch
def view_of(grid: Any, state: Snapshot) -> View:
    """Take what pictures show of a state with a grid."""
    raise InputError(f"{state.title}: nothing is known of a {type(grid).__name__}; give a Grid or a MixedMesh")
