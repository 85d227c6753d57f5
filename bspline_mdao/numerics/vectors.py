"""Vectors of three numbers as tuples, for kernels whose loops are to vectorise: no array, no allocation.

The numbers are real or complex; nothing is conjugated.
"""

from __future__ import annotations

from numba import njit

__all__ = ["add", "add_to", "cross", "dot", "less", "row", "scaled", "triple"]


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
