"""Files of curved hexahedra: the name determines the format. Theory: ``docs/theory/high_order.rst``."""

from __future__ import annotations

import importlib
import os
from pathlib import Path

from ...errors import InputError
from ..cells.curved_grid import CurvedGrid
from .formats import CURVED_FORMATS, GridFormat, curved_names

__all__ = ["curved_format", "write_curved_grid"]


def curved_format(path: str | os.PathLike) -> GridFormat:
    """Return the format of curved elements for the name of a file."""
    for form in CURVED_FORMATS:
        if form.suffix_of(Path(path)) in form.suffixes:
            return form
    raise InputError(f"{path}: curved elements are written as {curved_names()}; name such a file")


def write_curved_grid(path: str | os.PathLike, grid: CurvedGrid) -> None:
    """Write curved hexahedra, whole or not at all.

    Parameters
    ----------
    path : path-like
        The file to create or replace: ``.cgns`` (sections HEXA_8, HEXA_27, HEXA_64 or HEXA_125, and QUAD of every
        patch with a boundary condition) or ``.msh`` (Gmsh 4.1, through meshio; patches are physical groups).
    grid : CurvedGrid
        The elements, see `bspline_mdao.splines.curved_grid`.

    Raises
    ------
    InputError
        If the name is of another format, meshio is missing, or the file cannot be written.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from bspline_mdao import fit_grid
    >>> from bspline_mdao.files import write_curved_grid
    >>> from bspline_mdao.generators import ball_grid
    >>> from bspline_mdao.splines import curved_grid
    >>> path = pathlib.Path(tempfile.mkdtemp(), "ball.cgns")
    >>> write_curved_grid(path, curved_grid(fit_grid(ball_grid((5, 5, 5, 5), far=4.0)), degree=2))
    >>> path.exists()
    True
    """
    form = curved_format(path)
    getattr(importlib.import_module(f".{form.module}", __package__), form.writer)(path, grid)
