"""Vectors in space and in the plane, for kernels and for arrays, and planes through points.

In kernels whose loops should become SIMD instructions a vector is a tuple of three numbers: no array, no allocation
(`row` to `add_to`). In NumPy it is a row of an array (`lengths` to `cross_2d`). The numbers are real or complex;
nothing is conjugated.
"""

from __future__ import annotations

import numpy as np
from numba import njit

PLANAR = 1e-5
"""A patch is planar if its points are within this fraction of its size from the plane."""

ALIGNED = 1e-5
"""A normal that deviates from a coordinate axis by less than this is set to that axis."""


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def row(points, n):
    """Row n of an array of vectors."""
    return points[n, 0], points[n, 1], points[n, 2]


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def add(u, v):
    """``u + v``."""
    return u[0] + v[0], u[1] + v[1], u[2] + v[2]


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def less(u, v):
    """``u - v``."""
    return u[0] - v[0], u[1] - v[1], u[2] - v[2]


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def scaled(factor, u):
    """``factor u``."""
    return factor * u[0], factor * u[1], factor * u[2]


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def dot(u, v):
    """``u . v``."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def cross(u, v):
    """``u x v``."""
    return u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def triple(u, v, w):
    """``(u x v) . w``."""
    return dot(cross(u, v), w)


@njit(cache=True, error_model="numpy", fastmath={"contract", "nsz", "reassoc"}, forceinline=True)
def add_to(points, n, u):
    """``points[n] += u``."""
    points[n, 0] += u[0]
    points[n, 1] += u[1]
    points[n, 2] += u[2]


def lengths(vectors: np.ndarray) -> np.ndarray:
    """Lengths, shape (...), of vectors, shape (..., d)."""
    return np.sqrt((vectors * vectors).sum(axis=-1))


def dots(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Products ``u . v``, shape (...), of vectors, shape (..., d)."""
    return (u * v).sum(axis=-1)


def unit_vectors(vectors: np.ndarray, otherwise: np.ndarray, least: float) -> np.ndarray:
    """Unit vectors, shape (..., d); ``otherwise``, of the same shape, where they are not longer than ``least``."""
    length = lengths(vectors)[..., None]
    return np.where(length > least, vectors / np.maximum(length, least), otherwise)


def cross_2d(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """``u x v`` in the plane, shape (n,): positive where v is to the left of u."""
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def is_line(points: np.ndarray) -> bool:
    """Whether points are on one line, which lies in many planes."""
    sizes = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return len(sizes) < 2 or sizes[1] <= PLANAR * sizes[0]


def nearest_plane(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Plane through points, shape (n, 3): unit normal, distances (n,) of the points, and the tolerance (m)."""
    centred = points - points.mean(axis=0)
    _, sizes, directions = np.linalg.svd(centred, full_matrices=len(points) < 3)
    axis = np.argmax(np.abs(directions[2]))
    is_axis = 1.0 - abs(directions[2, axis]) < ALIGNED**2 / 2.0
    normal = np.eye(3)[axis] if is_axis else directions[2]
    return normal, np.abs(centred @ directions[2]), PLANAR * sizes[0] / np.sqrt(len(points))
