"""Airfoils by their names, and in files of two columns: Selig's, Lednicer's and plain ones."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np

from ...errors import InputError
from .airfoil import Airfoil, cst_airfoil, naca_airfoil
from .outline_checks import check_outline

__all__ = ["airfoil", "read_airfoil"]

_NACA = re.compile(r"naca[ _-]?(.*)", re.ASCII | re.IGNORECASE)

_LARGEST = 10_000_000
"""Most bytes of a file."""

_JUMP = 0.75
"""Step between points, relative to the total length, that begins the other side."""

_NEAR = 0.05
"""Fraction of the length within which points are at the trailing edge."""

_BASE, _STRAIGHT = 0.01, np.sqrt(0.75)
"""Longest step on half of a base, relative to the total length, and cosine of the largest turn of sides."""

_NEXT = 999.0
"""Both numbers of a line between two elements, as XFOIL and MSES have it."""


def airfoil(name: str | PathLike, blunt: bool = False) -> Airfoil:
    """Make an airfoil from a name: NACA digits, coefficients of class and shape functions, or a file.

    Parameters
    ----------
    name : str or path-like
        ``naca2412`` or ``naca23012``; ``cst:0.17,0.16,0.15/-0.17,-0.1,-0.15``, the coefficients of the upper and of the
        lower side from the nose on, followed by ``/0.002`` for a blunt trailing edge of that height; or a file, see
        `read_airfoil`.
    blunt : bool
        Keep the trailing edge of NACA sections open as in their definition; others are as given.

    Returns
    -------
    Airfoil
        Its outline.

    Raises
    ------
    InputError
        If there is no such airfoil.

    Examples
    --------
    >>> from bspline_mdao.generators import airfoil
    >>> airfoil("cst:0.17,0.16,0.15/-0.17,-0.1,-0.15/0.002").base.__round__(6)
    0.002
    """
    text = str(name)
    if text.lower().startswith("cst:"):
        return _of_coefficients(text)
    digits = _NACA.fullmatch(text)
    if digits and not Path(text).is_file():
        return naca_airfoil(digits[1], blunt)
    return read_airfoil(text)


def read_airfoil(path: str | PathLike, symmetric: bool = False) -> Airfoil:
    r"""Read an airfoil from a file with two columns, x and y.

    Parameters
    ----------
    path : path-like
        File. Points run around the section from the trailing edge, either side first (Selig), or along one side and
        then along the other (Lednicer, with or without the line of counts). Lines of words are titles or remarks, and
        so is a line of digits before the points; ``#`` and ``!`` begin comments. Blanks, tabs, commas and semicolons
        separate. Any unit will do: percent of the chord, millimetres.
    symmetric : bool
        The file has only one side of a symmetric section.

    Returns
    -------
    Airfoil
        Its outline as in the file. A trailing edge is blunt if its two corners differ; points of the base between them
        are left out.

    Raises
    ------
    InputError
        If the file has no outline; the message names the line.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from bspline_mdao.generators import naca_airfoil, read_airfoil
    >>> text = "".join(f"{100 * x:.5f} {100 * y:.5f}\n" for x, y in naca_airfoil("4415").points)
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder, "percent.dat")
    ...     _ = path.write_text(f"4415\n{text}")
    ...     print(round(read_airfoil(path).chord, 1))
    100.0
    """
    rows, counts = _rows(Path(path))
    points = np.array([row.values for row in rows])
    if not np.isfinite(points).all():
        number = int(np.argmin(np.isfinite(points).all(axis=1)))
        raise InputError(f"{path}: line {rows[number].line}: {rows[number].text} is not finite; correct it")
    order = _around(points, counts)
    if symmetric:
        order, points = _mirrored(order, points)
        rows = [*rows, *rows]
    check_outline(points[order], str(path), lambda number: f"line {rows[order[number]].line}")
    return Airfoil(points[order], Path(path).name)


@dataclass(frozen=True)
class _Row:
    """Numbers of a line."""

    line: int  # number of the line, from 1
    text: str  # the line
    values: tuple[float, ...]  # its numbers


def _of_coefficients(text: str) -> Airfoil:
    """Airfoil of ``cst:upper/lower`` or ``cst:upper/lower/base``."""
    try:
        upper, lower, *rest = [[float(a) for a in side.split(",")] for side in text[4:].split("/")]
        (base,) = rest[0] if rest else [0.0]
        if len(rest) > 1:
            raise ValueError
    except ValueError:
        raise InputError(
            f"{text}: write coefficients as cst:UPPER/LOWER, or cst:UPPER/LOWER/BASE, numbers with commas between "
            f"them, such as cst:0.17,0.16,0.15/-0.17,-0.1,-0.15/0.002"
        ) from None
    return cst_airfoil(upper, lower, base)


def _rows(path: Path) -> tuple[list[_Row], tuple[int, int] | None]:
    """Lines with points, and how many each side has if the file says so."""
    try:
        size = path.stat().st_size
        data = path.read_bytes() if size <= _LARGEST else b"\0"
    except OSError as error:
        raise InputError(
            f"{path}: {error.strerror or error}; an airfoil is a file, NACA digits such as naca0012, or cst:UPPER/LOWER"
        ) from error
    if b"\0" in data:
        raise InputError(f"{path}: is not text in two columns; give a file of points, or a name such as naca0012")
    rows: list[_Row] = []
    for number, line in enumerate(data.decode("utf-8-sig", errors="replace").splitlines(), 1):
        text = re.split(r"[#!]", line)[0].strip()
        words = re.split(r"[\s,;]+", text.strip(",; \t"))
        values = [_number(word) for word in words]
        if rows and values == [_NEXT, _NEXT]:
            raise InputError(f"{path}: line {number}: '{text}' separates elements; give a file of one element")
        if None not in values:
            rows.append(_Row(number, text, tuple(value for value in values if value is not None)))
        elif rows and len(rows[-1].values) > 1 and values[0] is not None and not re.search("[A-Za-z]{3}", text):
            raise InputError(f"{path}: line {number}: '{text[:60]}' is not a point; give two numbers, x and y")
    width = len(rows[-1].values) if rows else 0
    while rows and len(rows[0].values) != width:  # titles of digits
        rows.pop(0)
    for row in rows:
        if width not in (2, 3) or len(row.values) != width:
            raise InputError(f"{path}: line {row.line}: '{row.text[:60]}' is not a point; give two numbers, x and y")
    if width == 3:
        rows = _plane(rows, path)
    if not rows:
        raise InputError(f"{path}: has no points; give two columns, x and y")
    return _without_counts(rows, path)


def _number(word: str) -> float | None:
    """Number in a word, also with a Fortran exponent; None if it is not a number."""
    try:
        return float(re.sub(r"(?<=[\d.])[dD](?=[-+\d])", "e", word))
    except ValueError:
        return None


def _plane(rows: Sequence[_Row], path: Path) -> list[_Row]:
    """Rows of points in space without their third column, which must be constant."""
    if len({row.values[2] for row in rows}) > 1:
        raise InputError(f"{path}: line {rows[0].line}: has three columns, and the third one varies; give x and y")
    return [_Row(row.line, row.text, row.values[:2]) for row in rows]


def _without_counts(rows: list[_Row], path: Path) -> tuple[list[_Row], tuple[int, int] | None]:
    """Remove the line of counts, or a title of two numbers, from the points."""
    first, rest = rows[0], rows[1:]
    counts = tuple(int(value) if np.isfinite(value) else 0 for value in first.values)
    if counts == first.values and min(counts) > 1 and sum(counts) == len(rest):
        return rest, (counts[0], counts[1])
    values = np.array([row.values for row in rest]).reshape(-1, 2)
    far = np.abs(first.values).max() > 2.0 * np.abs(values[np.isfinite(values)]).max(initial=0.0) + 1.0
    if not (counts == first.values and far and rest):
        return rows, None
    if "." in first.text:
        raise InputError(
            f"{path}: line {first.line}: says that there are {counts[0]} and {counts[1]} points, and {len(rest)} "
            f"follow; correct it"
        )
    return rest, None


def _around(points: np.ndarray, counts: tuple[int, int] | None) -> np.ndarray:
    """Order of points of a file from the trailing edge along the upper side around the nose and back."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    size = np.ptp(points[:, 0]) if len(points) else 0.0
    order = np.arange(len(points))
    splits = [counts[0]] if counts else (np.flatnonzero(steps > _JUMP * size) + 1).tolist()
    if len(splits) == 1 and 1 < splits[0] < len(points) - 1:
        sides = [order[: splits[0]], order[splits[0] :]]
        first, second = (side if points[side[0], 0] < points[side[-1], 0] else side[::-1] for side in sides)
        order = np.concatenate([first[::-1], second])
    else:
        order = _from_tail(points, order, size)
    nose = points[:, 0].min() + 1e-3 * size  # where both sides of a file have the nose, or it occurs twice
    is_again = (np.diff(points[order], axis=0) == 0.0).all(axis=1) & (points[order[1:], 0] < nose)
    order = order[np.append(True, ~is_again)]
    order = _without_base(points, _without_base(points, order, size)[::-1], size)[::-1]
    x, y = points[order].T
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    return order if area >= 0.0 else order[::-1]


def _from_tail(points: np.ndarray, order: np.ndarray, size: float) -> np.ndarray:
    """Order of a closed line from the trailing edge, wherever it begins."""
    x = points[:, 0]
    is_closed = len(points) > 2 and np.linalg.norm(points[0] - points[-1]) < _NEAR * size
    if not is_closed or x[[0, -1]].min() > x.max() - _NEAR * size:
        return order
    order = order[:-1] if (points[0] == points[-1]).all() else order
    at = np.flatnonzero(x[order] > x.max() - 1e-6 * size)
    order = np.roll(order, -at[-1])
    return np.append(order, order[0]) if len(at) == 1 else order


def _without_base(points: np.ndarray, order: np.ndarray, size: float) -> np.ndarray:
    """Order without the points at its beginning that are on the base of a blunt trailing edge."""
    for _ in range(len(order) - 2):
        first, second = np.diff(points[order[:3]], axis=0)
        lengths = np.linalg.norm(first), np.linalg.norm(second)
        if lengths[0] > _BASE * size or first @ second > _STRAIGHT * lengths[0] * lengths[1]:
            break
        order = order[1:]
    return order


def _mirrored(order: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Order and points of a symmetric section whose file has one side."""
    n = len(points)
    order = order if points[order[0], 0] > points[order[-1], 0] else order[::-1]
    sides = np.concatenate([points * [1.0, np.sign(points[:, 1].sum()) or 1.0], points * [1.0, 0.0]])
    sides[n:, 1] = -sides[:n, 1]
    again = order[::-1] + n
    return np.concatenate([order, again[1:] if sides[order[-1], 1] == 0.0 else again]), sides
