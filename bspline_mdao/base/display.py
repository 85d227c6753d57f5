"""Display of objects: one line at a prompt, a small table and a picture in a notebook, and ``plot``.

The drawing code is above all other folders, so it is imported by name, and only when something is drawn.
"""

from __future__ import annotations

import importlib
import os
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

__all__ = ["InNotebook", "OneLine", "Plottable", "in_brief"]

WIDTH = 120
"""Usual maximum number of characters in a line."""

FEW = 4
"""Maximum number of numbers, or list items, that are written out."""


class OneLine:
    """Prints as one line: the class and its fields, arrays by their shapes and long lists by their lengths."""

    def __init_subclass__(cls, **options: Any) -> None:
        """Keep the one-line form, or a base's version, which a dataclass would replace by one with all digits."""
        super().__init_subclass__(**options)
        cls.__repr__ = cls.__repr__  # type: ignore[method-assign]

    def __repr__(self) -> str:
        names = [item.name for item in fields(self) if item.repr] if is_dataclass(self) else list(vars(self))
        parts = [f"{name}={in_brief(getattr(self, name))}" for name in names if not name.startswith("_")]
        return _shortened(f"{type(self).__name__}({', '.join(parts)})")


def in_brief(value: Any) -> str:
    """Write a value in a few characters.

    Examples
    --------
    >>> in_brief(np.zeros((12, 3))), in_brief(np.array([1.0, 2.5])), in_brief((1, 2, 3, 4, 5))
    ('array(12, 3)', '[1, 2.5]', '5 x int')
    """
    if isinstance(value, np.ndarray):
        if value.ndim == 1 and value.size <= FEW and value.dtype.kind in "biuf":
            return f"[{', '.join(f'{x:.4g}' for x in value)}]"
        return f"array{value.shape}"
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, tuple | list):
        is_short = len(value) <= FEW and all(isinstance(item, str | int | float | None) for item in value)
        if is_short:
            return f"({', '.join(map(in_brief, value))})"
        return f"{len(value)} x {type(value[0]).__name__}"
    if isinstance(value, dict):
        return f"{len(value)} by name"
    if value is None or isinstance(value, str | int | bool):
        return repr(value)
    if isinstance(value, InNotebook):
        return repr(value)
    return type(value).__name__


def _shortened(text: str) -> str:
    if len(text) <= WIDTH:
        return text
    head = text[: WIDTH - len(", ...)")]
    return f"{head.rpartition(', ')[0] or head}, ...)"


class InNotebook(OneLine):
    """Shown in a notebook as a table and a picture; elsewhere as its line."""

    def _repr_html_(self) -> str | None:
        """Show a small table and, if quick, a picture; None if that fails, so the line is shown."""
        try:
            return _drawing("html").html_of(self)
        except Exception:  # on any error, a notebook falls back to the line
            return None


class Plottable(InNotebook):
    """An object that can be plotted: a grid, a fitted grid."""

    def plot(self, show: bool | None = None, file: str | os.PathLike | None = None, **how: Any) -> Any:
        """Plot it: in a window, in a notebook, or to a picture file.

        Parameters
        ----------
        show : str or sequence of str, optional
            What to show, see `bspline_mdao.plotting.plot`: surfaces (``"walls"``, ``"symmetry"``, ``"farfield"``,
            ``"boundary"``, ``"control mesh"``, names of patches), and one field that colours them (``"quality"``,
            ``"corner"``, ``"wall height"``, ``"block"``, ``"patch"``).
        file : path-like, optional
            PNG file to write, instead of a window.
        **how
            See `bspline_mdao.plotting.plot`: ``before``, ``direction``, ``up``, ``zoom``, ``size``, ``worst``.

        Returns
        -------
        pathlib.Path or pyvista.Plotter or None
            The file; otherwise the plotter of the window, or the notebook's output.

        Raises
        ------
        InputError
            If there is nothing of the kind, the file is not a PNG, or the drawing libraries are missing.
        """
        return _drawing("plot").plot(self, show, file, **how)


def _drawing(name: str) -> Any:
    """Import a drawing module of the package, which is above all others."""
    return importlib.import_module(f"bspline_mdao.studio.plotting.{name}")
