"""The mover that a model gets where nobody names one."""

from __future__ import annotations

from functools import singledispatch

from ..mesh.moving_mesh import MovingMesh
from ..model.movable import Movable
from .mover import Mover
from .rotations import Rotations

__all__ = ["default_mover"]


@singledispatch
def default_mover(model: Movable, mesh: MovingMesh) -> Mover:
    """Make the mover of the control mesh of a model: `Rotations`, where its kind of model has no other one."""
    return Rotations(mesh)
