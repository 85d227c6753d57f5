"""The mover that a model gets by default."""

from __future__ import annotations

from functools import singledispatch

from ..mesh.moving_mesh import MovingMesh
from ..model.movable import Movable
from .mover import Mover
from .rotations import Rotations

__all__ = ["default_mover"]


@singledispatch
def default_mover(model: Movable, mesh: MovingMesh) -> Mover:
    """Make the mover of a model's control mesh: `Rotations`, unless its kind of model has another default."""
    return Rotations(mesh)
