"""Surface points from a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import InputError

__all__ = ["SUFFIXES", "GivenPoints", "read_points"]

SUFFIXES = (".csv", ".dat", ".npy", ".txt")
"""Files that hold points, NumPy's own and text with three numbers a line, parted by commas or blanks."""


@dataclass(frozen=True, eq=False)
class GivenPoints:
    """Put points where a list says, wherever they are; ``amount`` of the way.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        New places (m).
    amount : float
        1 goes all the way, 0 leaves the points where they are.
    """

    points: np.ndarray
    amount: float = 1.0

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Move points (n, 3), in metres."""
        return self.amount * self.points + (1.0 - self.amount) * points


def read_points(path, n_points: int) -> np.ndarray:
    """Read points from a file.

    Parameters
    ----------
    path : path-like
        ``.npy``: shape (n, 3), or (3 n,) with xyz interleaved. ``.csv``, ``.dat``, ``.txt``: three numbers a line,
        commas or blanks between them; a heading and lines that begin with ``#`` are passed over.
    n_points : int
        How many there should be.

    Returns
    -------
    ndarray, shape (n_points, 3)

    Raises
    ------
    InputError
        If the file cannot be read, or does not hold ``n_points`` points of finite coordinates.
    """
    path = Path(path)
    try:
        values = np.load(path, allow_pickle=False) if path.suffix == ".npy" else _read_text(path)
        values = np.asarray(values, dtype=np.float64)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); check the name") from None
    except (ValueError, TypeError, EOFError) as error:
        raise InputError(
            f"{path}: not a list of points ({str(error).splitlines()[0]}); see the documentation"
        ) from None
    if values.size != 3 * n_points or (values.ndim == 2 and values.shape[1] != 3) or values.ndim > 2:
        raise InputError(
            f"{path}: an array of shape {values.shape}; the surface has {n_points} points of 3 coordinates"
        )
    points = values.reshape(-1, 3)
    is_bad = ~np.isfinite(points).all(axis=1)
    if is_bad.any():
        raise InputError(f"{path}: point {np.argmax(is_bad) + 1} is not finite; repair the file")
    return points


def _read_text(path):
    """Rows of numbers; the first line may be a heading."""
    lines = path.read_text(encoding="utf-8-sig").replace(",", " ").splitlines()
    rows = [line.split() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if rows and not _is_numeric(rows[0]):
        rows = rows[1:]
    if any(len(row) != 3 for row in rows):
        number = next(n for n, row in enumerate(rows, start=1) if len(row) != 3)
        raise ValueError(f"point {number} has {len(rows[number - 1])} coordinates")
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def _is_numeric(words):
    try:
        [float(word) for word in words]
    except ValueError:
        return False
    return True
