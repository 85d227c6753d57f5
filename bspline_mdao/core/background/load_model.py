"""Models of any kind from their files."""

from __future__ import annotations

import os

from ..model.fitted_model import FittedModel
from .mesh_file import is_mesh_model
from .mesh_model import MeshModel

__all__ = ["load_model"]


def load_model(path: str | os.PathLike) -> FittedModel | MeshModel:
    """Read the model of a block-structured grid or of an unstructured mesh; `InputError` if it is invalid."""
    return MeshModel.load(path) if is_mesh_model(path) else FittedModel.load(path)
