"""The grid of a study, with its variables as sliders."""

from __future__ import annotations

from pathlib import Path

from ...core.model.fitted_model import FittedModel
from ...errors import InputError
from ..study.reader import read_study
from ..study.shape_script import StudiedShape
from .shape import LiveModel
from .study_variables import StudyVariables

__all__ = ["studied_model"]


def studied_model(file: Path) -> LiveModel:
    """Read a study, and make its grid and its variables."""
    shape = StudiedShape.of(read_study(file))
    if not isinstance(shape.model, FittedModel):
        raise InputError(f"{file}: is a study of an unstructured mesh, which live does not show; see optimize")
    design = shape.study.grid["design"]
    return LiveModel(shape.model, shape.wing.mesh, shape.mover, design or None, study=StudyVariables.of(shape))
