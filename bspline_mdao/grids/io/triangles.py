"""Triangulations of bodies, from STL (text and binary) and OBJ files: targets of fits, and bodies to avoid.

Lengths are as in the file: neither format has a unit. Corners of STL that are bitwise equal are one.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ...base.display import OneLine
from ...base.numerics.vectors import lengths
from ...errors import InputError

__all__ = ["Triangles", "read_triangles"]

HEADER, RECORD = 84, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""Binary STL: bytes before the triangles, of which the last four are their number, and the layout of each."""

CANDIDATES = 4_000_000
"""Pairs of points and triangles that are processed together."""


@dataclass(frozen=True, eq=False)
class Triangles(OneLine):
    """A body as triangles. Made by `read_triangles`.

    Parameters
    ----------
    source : str
        The file.
    points : ndarray, shape (n, 3)
        Corners.
    triangles : ndarray of int, shape (m, 3)
        Corners of each triangle, counter-clockwise from outside.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.files import Triangles
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> body = Triangles("one", corners, np.array([[0, 1, 2]]))
    >>> body.nearest(np.array([[0.2, 0.3, 0.5], [1.0, 1.0, 0.0]])).round(12).tolist()
    [[0.2, 0.3, 0.0], [0.5, 0.5, 0.0]]
    """

    source: str
    points: np.ndarray
    triangles: np.ndarray

    @cached_property
    def _balls(self) -> tuple[cKDTree, np.ndarray]:
        """Centres of the triangles, and the largest distances of their corners from these."""
        corners = self.points[self.triangles]
        centres = corners.mean(axis=1)
        return cKDTree(centres), lengths((corners - centres[:, None]).reshape(-1, 3)).reshape(-1, 3).max(axis=1)

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """Points of the triangles nearest to given ones, both of shape (n, 3)."""
        points = np.asarray(points, dtype=float)
        tree, radii = self._balls
        reach = tree.query(points)[0] + radii[tree.query(points)[1]] + radii.max()
        counts = tree.query_ball_point(points, reach, return_length=True)
        found, start = np.empty_like(points), 0
        while start < len(points):
            end = max(start + 1, start + int(np.searchsorted(np.cumsum(counts[start:]), CANDIDATES, side="right")))
            lists = tree.query_ball_point(points[start:end], reach[start:end])
            rows, numbers = np.repeat(np.arange(end - start), counts[start:end]), np.concatenate(lists).astype(int)
            places = nearest_places(points[start:end][rows], self.points[self.triangles[numbers]])
            away = lengths(places - points[start:end][rows])
            order = np.lexsort((away, rows))
            first = np.concatenate([[0], np.cumsum(counts[start:end])[:-1]])
            found[start:end] = places[order[first]]
            start = end
        return found

    def samples(self, spacing: float) -> np.ndarray:
        """Points all over the triangles, shape (n, 3), neighbours no farther than a spacing; they include the corners.

        They are the input of `bspline_mdao.measures.Clearance.from_points`.
        """
        if not spacing > 0.0:
            raise InputError(f"{self.source}: a spacing of {spacing:g}; give a positive length")
        corners = self.points[self.triangles]
        longest = lengths((corners - np.roll(corners, 1, axis=1)).reshape(-1, 3)).reshape(-1, 3).max(axis=1)
        counts = np.maximum(np.ceil(longest / spacing), 1).astype(int)
        found = []
        for count in np.unique(counts):
            i, j = (part.ravel() for part in np.indices((count + 1, count + 1)))
            kept = i + j <= count
            weights = np.stack([count - i - j, i, j], axis=1)[kept] / count
            found.append((weights @ corners[counts == count]).reshape(-1, 3))
        return np.unique(np.concatenate(found), axis=0)

    def distances(self, points: np.ndarray) -> np.ndarray:
        """Distances of points, shape (n, 3), from the triangles, shape (n,)."""
        return lengths(self.nearest(points) - np.asarray(points))


def nearest_places(
    points: np.ndarray,  # (n, 3)
    corners: np.ndarray,  # (n, 3, 3), corners of a triangle for each point
) -> np.ndarray:  # (n, 3)
    """Return the point of each triangle that is nearest to its point: inside, or on the nearest of its sides."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    square = np.maximum((normal**2).sum(axis=1), np.finfo(float).tiny)
    over = ((points - a) * normal).sum(axis=1) / square
    best = points - over[:, None] * normal
    sides = [(a, b), (b, c), (c, a)]
    inside = [(np.cross(end - start, best - start) * normal).sum(axis=1) >= 0.0 for start, end in sides]
    is_inside = np.all(inside, axis=0) & (normal.any(axis=1))
    distance = np.where(is_inside, lengths(best - points), np.inf)
    for start, end in sides:
        along = end - start
        length = np.maximum((along**2).sum(axis=1), np.finfo(float).tiny)
        part = np.clip(((points - start) * along).sum(axis=1) / length, 0.0, 1.0)
        place = start + part[:, None] * along
        away = lengths(place - points)
        is_nearer = away < distance
        best, distance = np.where(is_nearer[:, None], place, best), np.minimum(distance, away)
    return best


def read_triangles(path: str | os.PathLike) -> Triangles:
    """Read a triangulation.

    Parameters
    ----------
    path : path-like
        A file ``.stl``, text or binary, or ``.obj``, whose faces may have more than three corners.

    Returns
    -------
    Triangles

    Raises
    ------
    InputError
        If the file cannot be read, has no triangle, or numbers are not finite.

    Examples
    --------
    >>> from bspline_mdao.files import read_triangles
    >>> body = read_triangles("fuselage.stl")  # doctest: +SKIP
    >>> body.distances(nodes).max()  # doctest: +SKIP
    0.0021
    """
    path = Path(path)
    readers = {".stl": _read_stl, ".obj": _read_obj}
    if path.suffix.lower() not in readers:
        raise InputError(f"{path}: no triangulation by its name; end it in {', '.join(readers)}")
    try:
        points, triangles = readers[path.suffix.lower()](path.read_bytes())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error}); check the name") from None
    except (ValueError, IndexError) as error:
        raise InputError(f"{path}: is damaged ({str(error).splitlines()[0]}); write it again") from None
    if not len(triangles):
        raise InputError(f"{path}: no triangle is in it; name a file of a surface")
    if not np.isfinite(points).all():
        raise InputError(f"{path}: corner {int(np.argmin(np.isfinite(points).all(axis=1))) + 1} is not finite")
    return Triangles(str(path), points, triangles)


def _read_stl(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Corners and triangles of STL, binary if the length of the file matches its number of triangles."""
    n = int.from_bytes(data[HEADER - 4 : HEADER], "little") if len(data) >= HEADER else -1
    if n >= 0 and len(data) >= HEADER + n * RECORD.itemsize and not (data[:5] == b"solid" and b"facet" in data[:1000]):
        corners = np.frombuffer(data, RECORD, n, HEADER)["corners"].astype(float).reshape(-1, 3)
    elif data[:5].lower() == b"solid":
        words = [line.split() for line in data.decode("utf-8", "replace").splitlines() if "vertex" in line.lower()]
        corners = np.array([[float(word) for word in line[1:4]] for line in words]).reshape(-1, 3)
    else:
        raise ValueError(f"{len(data)} bytes, fewer than its number of triangles takes")
    if len(corners) % 3:
        raise ValueError(f"{len(corners)} corners, no multiple of three")
    points, ids = np.unique(corners, axis=0, return_inverse=True)
    return points, ids.reshape(-1, 3)


def _read_obj(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Corners and triangles of OBJ: faces with more corners become fans; negative numbers count from the end."""
    points: list[list[float]] = []
    triangles: list[tuple[int, int, int]] = []
    for line in data.decode("utf-8", "replace").splitlines():
        words = line.split("#")[0].split()
        if words[:1] == ["v"]:
            points.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            numbers = [int(word.split("/")[0]) for word in words[1:]]
            ids = [number - 1 if number > 0 else len(points) + number for number in numbers]
            triangles += [(ids[0], second, third) for second, third in zip(ids[1:-1], ids[2:])]
    found = np.array(triangles, dtype=int).reshape(-1, 3)
    if len(found) and (found.min() < 0 or found.max() >= len(points)):
        raise ValueError(f"a face has corner {found.max() + 1}, and there are {len(points)}")
    return np.array(points, dtype=float).reshape(-1, 3), found
