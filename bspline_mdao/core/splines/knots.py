"""Knots of one parameter direction as functions of the other two parameters (curved knots), Eq. (5), section II.C.

The knots ``T_1 .. T_{N+p}`` of a direction are open: the first ``p`` are 0, the last ``p`` are 1. The ``N - p`` inner
ones may depend on the other two parameters ``(s, t)``, taken in cyclic order: ``(eta, zeta)`` for the knots in xi,
``(zeta, xi)`` for eta and ``(xi, eta)`` for zeta. Theory: ``docs/theory/splines.rst``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numba import njit

from ...base.display import OneLine
from ...errors import InputError


class Knots(Protocol):
    """Knots of one parameter direction."""

    # All methods take the other two parameters as arrays of shape (n,) and return new C-contiguous arrays.

    @property
    def order(self) -> int:
        """Order p of the basis, its degree plus one."""

    @property
    def n_control(self) -> int:
        """Number of control points N in this direction."""

    def values(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Knots, shape (n, N + p)."""

    def gradients(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """First derivatives of the knots in s and t, shape (n, N + p, 2)."""

    def hessians(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Second derivatives of the knots in ss, st and tt, shape (n, N + p, 3)."""


def open_uniform_knots(
    n_control: int,  # number of control points N
    order: int,  # order p, at most N
) -> np.ndarray:  # (N + p,)
    """Open knots with evenly spaced inner knots.

    Examples
    --------
    >>> open_uniform_knots(n_control=5, order=3)
    array([0.        , 0.        , 0.        , 0.33333333, 0.66666667,
           1.        , 1.        , 1.        ])
    """
    # `InputError` if there are fewer control points than the order
    _check_counts(n_control, order)
    inner = np.arange(1, n_control - order + 1) / (n_control - order + 1)
    return _with_ends(inner, order)


@dataclass(frozen=True, eq=False)
class ConstantKnots(OneLine):
    """Knots that do not depend on the other parameters: the ordinary B-spline basis, Eq. (2).

    Parameters
    ----------
    knots : array_like, shape (N + p,)
        Open knots. Inner ones may be repeated up to ``p - 1`` times.
    order : int
        Order p.

    Raises
    ------
    InputError
        If the knots are not of this form.

    Examples
    --------
    >>> from bspline_mdao.splines import ConstantKnots
    >>> ConstantKnots.uniform(n_control=6, order=4).knots.round(3)
    array([0.   , 0.   , 0.   , 0.   , 0.333, 0.667, 1.   , 1.   , 1.   ,
           1.   ])
    """

    knots: np.ndarray
    order: int

    def __post_init__(self) -> None:
        knots = np.array(self.knots, dtype=float)
        _check_open(knots, self.order, n_dimensions=1, multiplicity=max(self.order - 1, 1))
        object.__setattr__(self, "knots", knots)

    @classmethod
    def uniform(cls, n_control: int, order: int) -> ConstantKnots:
        """Evenly spaced knots, `open_uniform_knots`; ``uniform(1, 1)`` is a degenerate direction."""
        return cls(open_uniform_knots(n_control, order), order)

    @property
    def n_control(self) -> int:
        """Number of control points N."""
        return self.knots.size - self.order

    def values(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Knots, shape (n, N + p)."""
        return np.tile(self.knots, (s.size, 1))

    def gradients(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Zeros, shape (n, N + p, 2)."""
        return np.zeros((s.size, self.knots.size, 2))

    def hessians(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Zeros, shape (n, N + p, 3)."""
        return np.zeros((s.size, self.knots.size, 3))


@dataclass(frozen=True, eq=False)
class BilinearKnots(OneLine):
    """Knots blended from the four parallel edges of a block, Eq. (5).

    Parameters
    ----------
    corners : array_like, shape (2, 2, N + p)
        Open knots on the edges, ``corners[a, b]`` at ``s = a`` and ``t = b``. Inner ones must increase strictly.
    order : int
        Order p.

    Raises
    ------
    InputError
        If the knots are not of this form.

    Examples
    --------
    >>> import numpy as np
    >>> from bspline_mdao.splines import BilinearKnots
    >>> knots = np.array([0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0])
    >>> BilinearKnots(np.tile(knots, (2, 2, 1)), order=3).n_control
    4
    """

    corners: np.ndarray
    order: int

    def __post_init__(self) -> None:
        corners = np.array(self.corners, dtype=float, order="C")
        _check_open(corners, self.order, n_dimensions=3, multiplicity=1)
        object.__setattr__(self, "corners", corners)

    @property
    def n_control(self) -> int:
        """Number of control points N."""
        return self.corners.shape[2] - self.order

    def values(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Knots, shape (n, N + p)."""
        out = np.empty((s.size, self.corners.shape[2]))
        _blend(self.corners, s, t, out)
        return out

    def gradients(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """First derivatives of the knots in s and t, shape (n, N + p, 2)."""
        out = np.empty((s.size, self.corners.shape[2], 2))
        _blend_slopes(self.corners, s, t, out)
        return out

    def hessians(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Second derivatives of the knots in ss, st and tt, shape (n, N + p, 3)."""
        c = self.corners
        hessians = np.zeros((s.size, c.shape[2], 3))
        hessians[..., 1] = c[1, 1] - c[1, 0] - c[0, 1] + c[0, 0]
        return hessians


@njit(cache=True, error_model="numpy")
def bilinear_knots(
    corners,  # (2, 2, N + p), knots on the four edges
    # the other two parameters
    s,
    t,
    out,  # (N + p,), receives the knots
):
    """Write the knots of Eq. (5) at one point to ``out``, for use inside numba kernels."""
    # Nested linear interpolation keeps the end knots at exactly 0 and 1 and reproduces the edges to the last bit.
    for i in range(corners.shape[2]):
        low = (1.0 - s) * corners[0, 0, i] + s * corners[1, 0, i]
        high = (1.0 - s) * corners[0, 1, i] + s * corners[1, 1, i]
        out[i] = (1.0 - t) * low + t * high


@njit(cache=True, error_model="numpy", forceinline=True)
def bilinear_slopes(corners, s, t, first, end, d_s, d_t):
    """Write the derivatives of the knots ``first .. end - 1`` of Eq. (5) to ``d_s`` and ``d_t``, shape (N + p,)."""
    for i in range(first, end):
        d_s[i] = (1.0 - t) * (corners[1, 0, i] - corners[0, 0, i]) + t * (corners[1, 1, i] - corners[0, 1, i])
        d_t[i] = (1.0 - s) * (corners[0, 1, i] - corners[0, 0, i]) + s * (corners[1, 1, i] - corners[1, 0, i])


@njit(cache=True, error_model="numpy", nogil=True)
def _blend(corners, s, t, out):
    for q in range(s.size):
        bilinear_knots(corners, s[q], t[q], out[q])


@njit(cache=True, error_model="numpy")
def _blend_slopes(corners, s, t, out):
    for q in range(s.size):
        bilinear_slopes(corners, s[q], t[q], 0, corners.shape[2], out[q, :, 0], out[q, :, 1])


@dataclass(frozen=True, eq=False)
class FunctionKnots(OneLine):
    """Knots given by the user's own functions of the other two parameters.

    The functions give only the ``N - p`` inner knots, which must increase strictly between 0 and 1. For a mapping that
    is ``p - 2`` times continuously differentiable, they must be so too. Knots of this kind cannot be stored in a file.

    Parameters
    ----------
    order, n_control : int
        Order p and number of control points N.
    value : callable
        ``value(s, t)`` with arrays of shape (n,) returns the inner knots, shape (n, N - p).
    gradient : callable
        Returns their derivatives in s and t, shape (n, N - p, 2).
    hessian : callable, optional
        Returns their second derivatives in ss, st and tt, shape (n, N - p, 3). Needed only for second derivatives.

    Raises
    ------
    InputError
        If an array has the wrong shape or the knots do not increase strictly, here or when they are evaluated.

    Examples
    --------
    >>> import numpy as np
    >>> knots = FunctionKnots(
    ...     order=4,
    ...     n_control=5,
    ...     value=lambda s, t: 0.5 + 0.2 * np.sin(np.pi * s[:, None]),
    ...     gradient=lambda s, t: np.stack([0.2 * np.pi * np.cos(np.pi * s), 0 * t], axis=-1)[:, None],
    ... )
    >>> knots.values(np.array([0.5]), np.array([0.0]))
    array([[0. , 0. , 0. , 0. , 0.7, 1. , 1. , 1. , 1. ]])
    """

    order: int
    n_control: int
    value: Callable[[np.ndarray, np.ndarray], np.ndarray]
    gradient: Callable[[np.ndarray, np.ndarray], np.ndarray]
    hessian: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None

    def __post_init__(self) -> None:
        _check_counts(self.n_control, self.order)
        s, t = (a.ravel() for a in np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9)))
        self.values(s, t)
        self.gradients(s, t)
        if self.hessian is not None:
            self.hessians(s, t)

    def values(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Knots, shape (n, N + p)."""
        knots = _with_ends(self._call("value", s, t), self.order)
        breaks = knots[:, self.order - 1 : self.n_control + 1]
        is_bad = ~(np.diff(breaks) > 0)
        if is_bad.any():
            q, i = np.argwhere(is_bad)[0]
            raise InputError(
                f"knot function: knots {breaks[q, i]:g} and {breaks[q, i + 1]:g} at s = {s[q]:g}, t = {t[q]:g} do not "
                f"increase; make the inner knots increase strictly between 0 and 1"
            )
        return knots

    def gradients(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """First derivatives of the knots in s and t, shape (n, N + p, 2)."""
        return self._pad(self._call("gradient", s, t, 2))

    def hessians(self, s: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Second derivatives of the knots in ss, st and tt, shape (n, N + p, 3)."""
        if self.hessian is None:
            raise InputError("knot function: second derivatives are needed here; give `hessian` to FunctionKnots")
        return self._pad(self._call("hessian", s, t, 3))

    def _call(self, name: str, s: np.ndarray, t: np.ndarray, *components: int) -> np.ndarray:
        result = np.asarray(getattr(self, name)(s, t), dtype=float)
        expected = (s.size, self.n_control - self.order, *components)
        if result.shape != expected:
            raise InputError(f"knot function: `{name}` gave shape {result.shape}; return shape {expected}")
        return result

    def _pad(self, derivatives: np.ndarray) -> np.ndarray:
        return np.pad(derivatives, ((0, 0), (self.order, self.order), (0, 0)))


def knots_to_array(knots: Knots) -> np.ndarray:
    """Return the array that stores constant (1-D) or bilinear (3-D) knots in a file."""
    if isinstance(knots, ConstantKnots):
        return knots.knots
    if isinstance(knots, BilinearKnots):
        return knots.corners
    raise InputError(f"{type(knots).__name__} cannot be saved to a file; use ConstantKnots or BilinearKnots")


def knots_from_array(array: np.ndarray, order: int) -> Knots:
    """Return the knots that `knots_to_array` stored; `InputError` if the array is not of knots of this order."""
    return (BilinearKnots if np.ndim(array) == 3 else ConstantKnots)(array, order)


def _with_ends(inner: np.ndarray, order: int) -> np.ndarray:
    """Open knots from the inner ones along the last axis."""
    ends = inner.shape[:-1] + (order,)
    return np.concatenate([np.zeros(ends), inner, np.ones(ends)], axis=-1)


def _check_counts(n_control: int, order: int) -> None:
    """Raise `InputError` unless ``n_control`` control points are enough for the order."""
    if order < 1:
        raise InputError(f"knots: order {order}; the order is at least 1 (4 is cubic)")
    if n_control < order:
        raise InputError(f"knots: {n_control} control points for order {order}; use at least {order} or a lower order")


def _check_open(
    knots: np.ndarray,  # (N + p,) or (2, 2, N + p), knots along the last axis
    order: int,  # order p
    n_dimensions: int,  # dimensions that the array must have, 1 or 3
    multiplicity: int,  # how often an inner knot may be repeated
) -> None:
    """Raise `InputError` unless the knots are open."""
    if knots.ndim != n_dimensions or knots.shape[:-1] not in ((), (2, 2)):
        expected = "(N + p,)" if n_dimensions == 1 else "(2, 2, N + p)"
        raise InputError(f"knots: an array of shape {knots.shape}; give shape {expected}")
    n_control = knots.shape[-1] - order
    _check_counts(n_control, order)
    if not np.isfinite(knots).all():
        raise InputError("knots: a value is not finite; give numbers from 0 to 1")
    if (knots[..., :order] != 0).any() or (knots[..., n_control:] != 1).any():
        raise InputError(f"knots: they are not open; the first {order} must be 0 and the last {order} must be 1")
    _check_increasing(knots, order, n_control, multiplicity)


def _check_increasing(knots: np.ndarray, order: int, n_control: int, multiplicity: int) -> None:
    """Check that the knots do not decrease and at most ``multiplicity`` inner ones are equal."""
    falls = np.argwhere(np.diff(knots) < 0)
    if len(falls):
        i = falls[0, -1] + 1
        raise InputError(f"knots: knot {i + 1} is below knot {i}; make the inner knots increase from 0 to 1")
    first = order - multiplicity
    repeats = np.argwhere(knots[..., order : n_control + multiplicity] <= knots[..., first:n_control])
    if len(repeats):
        i = first + repeats[0, -1] + 1
        raise InputError(
            f"knots: knots {i} to {i + multiplicity} are equal; inner knots lie between 0 and 1 and at most "
            f"{multiplicity} may be equal"
        )
