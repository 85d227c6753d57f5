"""Free-form boxes (FFD) in mesh files of SU2.

Format: ``docs/theory/free_form.rst``.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ....base.display import OneLine
from ....errors import InputError
from ..disk import read_raw
from .layer_of_cells import UNIT

__all__ = ["FfdBox", "read_ffd_boxes"]

_TAG = re.compile(r"^[ \t]*FFD_TAG[ \t]*=", re.M)
_KEYWORD = re.compile(r"^[ \t]*((?:FFD|BSPLINE)_[A-Z_]+)[ \t]*=([^\n%]*)", re.M)

_DIRECTIONS = "IJK"

BEZIER, UNIFORM = "BEZIER", "BSPLINE_UNIFORM"
"""Kinds of blending functions. Older files do not name one; theirs are Bezier volumes."""


@dataclass(frozen=True, eq=False)
class FfdBox(OneLine):
    """A free-form box."""

    name: str  # its tag
    control_points: np.ndarray  # (n0, n1, n2, 3), m
    orders: tuple[int, int, int]  # order in each direction, with uniform knots


def read_ffd_boxes(path: str | os.PathLike) -> tuple[FfdBox, ...]:
    """Read the boxes of a file, in order; none if it has none."""
    content, source = read_raw(path).decode(errors="replace"), str(path)
    starts = [match.start() for match in _TAG.finditer(content)]
    return tuple(_read_box(content[a:b], source) for a, b in zip(starts, [*starts[1:], len(content)]))


def _read_box(text: str, source: str) -> FfdBox:
    """Read one box from its tag on."""
    found = [(match[1], match[2].strip(), match.end()) for match in _KEYWORD.finditer(text)]
    values = {name: value for name, value, _ in found}
    name = values["FFD_TAG"]
    what = f"{source}: FFD box '{name}'"
    degrees = [_whole(values.get(f"FFD_DEGREE_{d}"), f"FFD_DEGREE_{d}", what) for d in _DIRECTIONS[:2]]
    is_plane = "FFD_DEGREE_K" not in values
    degrees.append(1 if is_plane else _whole(values["FFD_DEGREE_K"], "FFD_DEGREE_K", what))
    shape = [degree + 1 for degree in degrees]
    end = next((end for name, _, end in found if name == "FFD_CONTROL_POINTS"), None)
    if end is None or min(shape) < 2:
        raise InputError(f"{what}: has no control points, or a degree below 1; write it again by SU2_DEF")
    n = _whole(values["FFD_CONTROL_POINTS"], "FFD_CONTROL_POINTS", what)
    lines = np.array(list(_numbers(text[end:], n, what))).reshape(-1, 6)
    places = lines[:, :3].astype(int)
    is_there = np.zeros(shape, dtype=bool)
    if n == np.prod(shape) and (places >= 0).all() and (places < shape).all():
        is_there[tuple(places.T)] = True
    if not is_there.all():
        raise InputError(f"{what}: {n} control points for degrees {degrees}; write it again by SU2_DEF")
    points = np.empty((*shape, 3))
    points[tuple(places.T)] = lines[:, 3:]
    if is_plane:  # between the planes of a two-dimensional mesh
        points[..., 2] = [0.0, UNIT]
    return FfdBox(name, points, _orders(values, shape, what))


def _orders(values: dict[str, str], shape: list[int], what: str) -> tuple[int, int, int]:
    """Order in each direction."""
    blending = values.get("FFD_BLENDING", BEZIER)
    if blending == BEZIER:
        i, j, k = shape
    elif blending == UNIFORM:
        i, j = (_whole(values.get(f"BSPLINE_ORDER_{d}"), f"BSPLINE_ORDER_{d}", what) for d in _DIRECTIONS[:2])
        k = _whole(values.get("BSPLINE_ORDER_K", "2"), "BSPLINE_ORDER_K", what)
    else:
        raise InputError(f"{what}: FFD_BLENDING={blending} is not known; {BEZIER} and {UNIFORM} are")
    return i, j, k


def _numbers(text: str, n: int, what: str) -> Iterator[list[float]]:
    """Rows of six numbers after a keyword."""
    rows = text.split("\n", n + 1)[1 : n + 1]
    for number, row in enumerate(rows, 1):
        try:
            values = [float(word) for word in row.split()]
        except ValueError:
            values = []
        if len(values) != 6:
            raise InputError(f"{what}: control point {number} is '{row.strip()[:40]}'; give i, j, k, x, y and z")
        yield values


def _whole(text: str | None, name: str, what: str) -> int:
    if text is None or not re.fullmatch(r"\d{1,6}", text):
        raise InputError(f"{what}: {name} is {text or 'missing'}; give a whole number")
    return int(text)
